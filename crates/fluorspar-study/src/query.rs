//! Numbers of a study.

use fluorspar_session::Result;
use serde::{Deserialize, Serialize};

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
}

/// The last numbers of every region that is not wrong.
///
/// # Errors
/// A study that can't be opened.
pub fn query(options: &QueryOptions, _: &fluorspar_session::Job) -> Result<Vec<QueriedRow>> {
    rows(&Study::asked(&options.args.study)?.0, options)
}

/// The last numbers of regions that are not wrong, by person, region and quantity: those of the camera of now, where it has any. Conditions
/// follow.
const LAST: &str = "SELECT p.subject, p.session, e.region, e.quantity, e.channel, e.value, e.low, e.high, e.interval_kind, s.withdrawn,
           CASE WHEN s.site = '' THEN (SELECT site FROM study LIMIT 1) ELSE s.site END, s.age, s.consent, e.analysis, e.version,
           e.photograph, r.verdict
    FROM estimate e
    JOIN photograph p ON p.photograph = e.photograph
    JOIN subject s ON s.subject = p.subject
    JOIN region r ON r.region_sha256 = e.region_sha256 AND r.current = 1
    WHERE e.seq = (SELECT o.seq FROM estimate o WHERE o.region_sha256 = e.region_sha256 AND o.quantity = e.quantity AND o.channel = e.channel
                   ORDER BY o.analysis = (SELECT analysis FROM setup LIMIT 1) DESC, o.seq DESC LIMIT 1)";

/// The last numbers of an index that options ask for.
pub(crate) fn rows(index: &Index, options: &QueryOptions) -> Result<Vec<QueriedRow>> {
    let columns =
        [("p.subject", &options.subject), ("e.region", &options.region), ("e.quantity", &options.quantity)];
    // A condition that is there for none of its values would keep the tables from being looked up by it
    let given = || columns.iter().filter_map(|(column, value)| Some((column, value.as_ref()?)));
    let conditions: String = given().map(|(column, _)| format!(" AND {column} = ?")).collect();
    let values = rusqlite::params_from_iter(given().map(|(_, value)| value));
    let sql = format!("{LAST}{conditions} ORDER BY p.subject, p.session, e.photograph, e.region, e.seq");
    index.rows(&sql, values, |row| {
        let ends: [Option<f64>; 2] = [row.get(6)?, row.get(7)?];
        Ok(QueriedRow {
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
        })
    })
}
