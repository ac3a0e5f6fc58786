//! Numbers of a study.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use fluorspar_session::{Error, Result, UNCONFIRMED};
use serde::{Deserialize, Serialize};

use crate::import::{PATIENT, label_of};
use crate::index::Index;
use crate::store::{Study, StudyArgs};

/// Verdict of a region that nobody looked at.
const GUESS: &str = "guess";

/// Which numbers.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct QueryOptions {
    /// The study.
    #[command(flatten)]
    #[serde(flatten)]
    pub args: StudyArgs,
    /// Person whose numbers alone are taken.
    #[arg(long, value_name = "NAME")]
    pub subject: Option<String>,
    /// Name of the regions whose numbers are taken.
    #[arg(long = "region-name", value_name = "NAME")]
    pub region: Option<String>,
    /// Number that is taken, as patients.csv calls it: red_share, chromaticity_r, ...
    #[arg(long, value_name = "NAME")]
    pub quantity: Option<String>,
}

/// A number of a person.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct QueriedRow {
    /// The pseudonym.
    pub subject: String,
    /// The visit.
    pub session: String,
    /// Name of the region.
    pub region: String,
    /// What the number is.
    pub quantity: String,
    /// The channel that it is of; may be empty.
    pub channel: String,
    /// The number.
    pub value: Option<f64>,
    /// Ends of its interval.
    pub interval: Option<[f64; 2]>,
    /// What the interval holds.
    pub interval_kind: String,
    /// Whether the person withdrew.
    pub withdrawn: bool,
    /// Where the person is examined.
    pub site: String,
    /// Years at the first visit.
    pub age: Option<f64>,
    /// As the study has it.
    pub consent: String,
    /// Digest of the experiment.
    pub analysis: String,
    /// Version of the program.
    pub version: String,
    /// The photograph.
    pub photograph: String,
    /// What somebody who looked at the region says of it; `guess` is what nobody looked at.
    pub verdict: String,
}

impl QueriedRow {
    /// Whether nobody confirmed the region, which follows color: it may leave out just what is looked for.
    pub(crate) fn is_guess(&self) -> bool {
        self.verdict == GUESS
    }

    /// The interval of its error: the spread of the pixels is no error of their middle.
    pub(crate) fn own_interval(&self) -> Option<[f64; 2]> {
        self.interval.filter(|_| ["estimate", "sensor_noise"].contains(&self.interval_kind.as_str()))
    }
}

/// The last numbers of every region that is not wrong.
///
/// # Errors
/// A study that can't be opened.
pub fn query(options: &QueryOptions, _: &fluorspar_session::Job) -> Result<Vec<QueriedRow>> {
    let (index, _) = Study::asked(&options.args.study)?;
    let subject = options.subject.as_deref().map(|written| person(&index, written)).transpose()?;
    rows(&index, &QueryOptions { subject, ..options.clone() })
}

/// The label of a person as tables write it.
///
/// # Errors
/// A person whom the study does not have.
pub(crate) fn person(index: &Index, written: &str) -> Result<String> {
    let label = label_of(PATIENT, written)?;
    let known: Vec<String> =
        index.rows("SELECT subject FROM subject WHERE subject = ?", [&label], |row| row.get(0))?;
    if known.is_empty() {
        return Err(Error::Input(format!("the study has no person {written}")));
    }
    Ok(label)
}

/// What numbers are looked up by: a person, or what they are. The order of the tables is the order in which they are read.
const BY_PERSON: &str = "photograph p CROSS JOIN region r ON r.photograph = p.photograph
    CROSS JOIN estimate e ON e.region_sha256 = r.region_sha256";
const BY_QUANTITY: &str = "estimate e CROSS JOIN region r ON r.region_sha256 = e.region_sha256
    CROSS JOIN photograph p ON p.photograph = e.photograph";
const COLUMNS: &str = "p.subject, p.session, e.region, e.quantity, e.channel, e.value, e.low, e.high, e.interval_kind, s.withdrawn,
    CASE WHEN s.site = '' THEN (SELECT site FROM study LIMIT 1) ELSE s.site END, s.age, s.consent, e.analysis, e.version, e.photograph,
    r.verdict, e.region_sha256, e.analysis = (SELECT analysis FROM setup LIMIT 1), e.seq";

/// What makes the numbers of a region of a row doubtful.
pub(crate) fn warnings_of(index: &Index, row: &QueriedRow) -> Result<Vec<String>> {
    let sql = "SELECT w.warning FROM region r JOIN warning w ON w.region_sha256 = r.region_sha256
        WHERE r.photograph = ? AND r.region = ? AND r.current = 1 AND w.analysis = ? AND w.version = ?";
    let mut all: Vec<String> =
        index.rows(sql, [&row.photograph, &row.region, &row.analysis, &row.version], |row| row.get(0))?;
    // Somebody may have looked at it since
    all.retain(|warning| row.is_guess() || warning != UNCONFIRMED);
    Ok(all)
}

/// Which of the numbers of a region count, least first: those of the camera of now, and the last.
type Rank = (bool, i64);

/// The last numbers that options ask for of regions that are not wrong, by person, visit and region: those of the camera of now, where it has
/// any.
pub(crate) fn rows(index: &Index, options: &QueryOptions) -> Result<Vec<QueriedRow>> {
    // With the + numbers of a person are not looked up among those of all people
    let (tables, quantity) =
        if options.subject.is_some() { (BY_PERSON, "+e.quantity") } else { (BY_QUANTITY, "e.quantity") };
    let columns =
        [("p.subject", &options.subject), ("e.region", &options.region), (quantity, &options.quantity)];
    // A condition that is there for none of its values would keep the tables from being looked up by it
    let given = || columns.iter().filter_map(|(column, value)| Some((column, value.as_ref()?)));
    let conditions: String = given().map(|(column, _)| format!(" AND {column} = ?")).collect();
    let values = rusqlite::params_from_iter(given().map(|(_, value)| value));
    let sql = format!(
        "SELECT {COLUMNS} FROM {tables} CROSS JOIN subject s ON s.subject = p.subject WHERE r.current = 1{conditions}"
    );
    let mut last: HashMap<[String; 3], (Rank, QueriedRow)> = HashMap::new();
    for (region, rank, row) in index.rows(&sql, values, read_row)? {
        let key = [region, row.quantity.clone(), row.channel.clone()];
        match last.entry(key) {
            Entry::Occupied(before) if before.get().0 > rank => {}
            entry => drop(entry.insert_entry((rank, row))),
        }
    }
    let mut last: Vec<_> = last.into_values().collect();
    last.sort_by(|((_, a_seq), a), ((_, b_seq), b)| {
        (&a.subject, &a.session, &a.photograph, &a.region, a_seq).cmp(&(
            &b.subject,
            &b.session,
            &b.photograph,
            &b.region,
            b_seq,
        ))
    });
    Ok(last.into_iter().map(|(_, row)| row).collect())
}

/// A row, its rank, and the digest of its region.
fn read_row(row: &rusqlite::Row<'_>) -> rusqlite::Result<(String, Rank, QueriedRow)> {
    let ends: [Option<f64>; 2] = [row.get(6)?, row.get(7)?];
    let rank = (row.get::<_, Option<bool>>(18)?.unwrap_or(false), row.get(19)?);
    let found = QueriedRow {
        subject: row.get(0)?,
        session: row.get(1)?,
        region: row.get(2)?,
        quantity: row.get(3)?,
        channel: row.get(4)?,
        value: row.get(5)?,
        interval: ends[0].zip(ends[1]).map(|(low, high)| [low, high]),
        interval_kind: row.get(8)?,
        withdrawn: row.get(9)?,
        site: row.get(10)?,
        age: row.get(11)?,
        consent: row.get(12)?,
        analysis: row.get(13)?,
        version: row.get(14)?,
        photograph: row.get(15)?,
        verdict: row.get(16)?,
    };
    Ok((row.get(17)?, rank, found))
}
