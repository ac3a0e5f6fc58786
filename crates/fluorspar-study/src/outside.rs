//! What people and their numbers are called outside of the clinic.

use std::collections::BTreeMap;

use fluorspar_format::{ParquetColumn, csv_cell, parquet_table};
use fluorspar_session::Result;

use crate::deidentify::{age_band, channel_outside, code, listed};
use crate::norm::outcomes;
use crate::query::{QueryOptions, rows};
use crate::store::Study;

/// Names of regions that may leave; others become numbers.
const REGIONS: [&str; 20] = [
    "tongue",
    "lips",
    "lip",
    "teeth",
    "tooth",
    "gingiva",
    "gums",
    "palate",
    "cheek",
    "floor",
    "dorsal_tongue",
    "ventral_tongue",
    "lateral_tongue",
    "hard_palate",
    "soft_palate",
    "buccal_mucosa",
    "floor_of_mouth",
    "facial_skin",
    "lesion",
    "analysis",
];

/// What a person is called outside, and what is told.
pub(crate) struct Outside {
    pub(crate) code: String,
    /// As the study has it, where it is of the list.
    pub(crate) sex: String,
    /// The line of participants.tsv.
    pub(crate) line: String,
    /// Visits by their label, in order.
    pub(crate) visits: BTreeMap<String, usize>,
}

impl Outside {
    /// The number of a visit.
    pub(crate) fn visit(&self, session: &str) -> usize {
        self.visits.get(session).copied().unwrap_or_default()
    }
}

/// People who may leave, by their pseudonyms, and how many others there are.
pub(crate) fn people(study: &Study, secret: &str) -> Result<(BTreeMap<String, Outside>, usize)> {
    let sql = "SELECT s.subject, CASE WHEN s.site = '' THEN (SELECT site FROM study LIMIT 1) ELSE s.site END, s.sex, s.age, s.skin, s.smoker,
                      s.consent = 'yes' AND s.withdrawn = 0
               FROM subject s ORDER BY s.subject";
    let (mut people, outcomes) = (BTreeMap::new(), outcomes(&study.index)?);
    let all = study.index.rows(sql, [], |row| {
        let subject: String = row.get(0)?;
        let text = |column: usize| row.get::<_, String>(column);
        let (site, sex, skin, smoker) = (text(1)?, text(2)?, text(4)?, text(5)?);
        let lesion = outcomes.get(&subject).map_or("", |is_ill| if *is_ill { "yes" } else { "no" });
        let id = code(secret, "subject", &subject);
        let sex = listed(&sex, &["female", "male", "other", "f", "m", "d"]);
        let cells = [
            format!("sub-{id}"),
            site_code(secret, &site),
            sex.clone(),
            age_band(row.get(3)?),
            listed(&skin, &["i", "ii", "iii", "iv", "v", "vi", "1", "2", "3", "4", "5", "6"]),
            listed(&smoker, &["yes", "no", "former"]),
            lesion.to_owned(),
        ];
        let line = cells.map(|cell| if cell.is_empty() { "n/a".into() } else { cell }).join("\t") + "\n";
        Ok((subject, Outside { code: id, sex, line, visits: BTreeMap::new() }, row.get::<_, bool>(6)?))
    })?;
    let count = all.len();
    people.extend(
        all.into_iter().filter(|(_, _, may_leave)| *may_leave).map(|(subject, person, _)| (subject, person)),
    );
    for (subject, person) in &mut people {
        let sql = "SELECT session, min(visit) FROM photograph WHERE subject = ? GROUP BY session";
        let mut visits: Vec<[String; 2]> =
            study.index.rows(sql, [subject], |row| Ok([row.get(0)?, row.get(1)?]))?;
        visits.sort_by_cached_key(|[session, visit]| (natural(visit), session.clone()));
        person.visits = visits.into_iter().map(|[session, _]| session).zip(1..).collect();
    }
    let left_out = count - people.len();
    Ok((people, left_out))
}

/// What a site is called outside: never a number.
fn site_code(secret: &str, site: &str) -> String {
    if site.is_empty() { String::new() } else { format!("site-{}", code(secret, "site", site)) }
}

/// A key by which words are in the order of the numbers in them: 2 before 10.
fn natural(word: &str) -> Vec<(u64, String)> {
    let mut parts: Vec<String> = Vec::new();
    for c in word.chars() {
        match parts.last_mut() {
            Some(last) if last.ends_with(|of: char| of.is_ascii_digit()) == c.is_ascii_digit() => {
                last.push(c)
            }
            _ => parts.push(c.into()),
        }
    }
    parts.into_iter().map(|part| (part.parse().unwrap_or(u64::MAX), part)).collect()
}

/// Columns of the numbers.
const COLUMNS: [&str; 12] = [
    "participant_id",
    "site",
    "visit",
    "region",
    "quantity",
    "channel",
    "value",
    "low",
    "high",
    "interval",
    "analysis",
    "version",
];

/// Cells of a number in the order of the columns; empty where there is none.
pub(crate) type NumberCells = [String; COLUMNS.len()];

/// The numbers of people who may leave.
pub(crate) fn numbers(
    study: &Study,
    people: &BTreeMap<String, Outside>,
    secret: &str,
) -> Result<Vec<NumberCells>> {
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    let mut regions: BTreeMap<String, usize> = BTreeMap::new();
    let mut channels: BTreeMap<String, usize> = BTreeMap::new();
    let mut all = Vec::new();
    for row in rows(&study.index, &QueryOptions::default())? {
        let Some(person) = people.get(&row.subject) else { continue };
        let (next, next_channel) = (regions.len() + 1, channels.len());
        let number_of_channel = *channels.entry(row.channel.clone()).or_insert(next_channel);
        let channel = channel_outside(&row.channel, number_of_channel);
        let known = listed(&row.region, &REGIONS);
        let region = if known.is_empty() {
            format!("region-{}", regions.entry(row.region).or_insert(next))
        } else {
            known
        };
        all.push([
            format!("sub-{}", person.code),
            site_code(secret, &row.site),
            person.visit(&row.session).to_string(),
            region,
            row.quantity,
            if channel.len() == 1 { channel.to_uppercase() } else { channel },
            number(row.value),
            number(row.interval.map(|ends| ends[0])),
            number(row.interval.map(|ends| ends[1])),
            row.interval_kind,
            row.analysis,
            row.version,
        ]);
    }
    // By codes, not by names
    all.sort_by(|a, b| a[0].cmp(&b[0]));
    Ok(all)
}

/// Numbers as one table.
pub(crate) fn numbers_csv(numbers: &[NumberCells]) -> String {
    let line =
        |cells: &NumberCells| cells.iter().map(|cell| csv_cell(cell)).collect::<Vec<_>>().join(",") + "\n";
    COLUMNS.join(",") + "\n" + &numbers.iter().map(line).collect::<String>()
}

/// Numbers as files of Parquet by site and camera, whose values stand in the names of folders as Hive has them. `name` is that of the study
/// among others whose files are put beside these.
pub(crate) fn numbers_parquet(numbers: &[NumberCells], name: &str) -> Vec<(String, Vec<u8>)> {
    let mut parts: BTreeMap<String, Vec<&NumberCells>> = BTreeMap::new();
    for cells in numbers {
        let [_, site, .., analysis, _] = cells;
        let site = if site.is_empty() { "__HIVE_DEFAULT_PARTITION__" } else { site };
        // Nothing of a log that was tampered with becomes a path
        let device: String = analysis.chars().filter(char::is_ascii_alphanumeric).take(12).collect();
        let folder = format!("estimates/site={site}/device=camera-{device}");
        parts.entry(folder).or_default().push(cells);
    }
    let column = |cells: &[&NumberCells], at: usize| match COLUMNS[at] {
        "visit" => ParquetColumn::Whole(cells.iter().map(|row| row[at].parse().ok()).collect()),
        "value" | "low" | "high" => {
            ParquetColumn::Number(cells.iter().map(|row| row[at].parse().ok()).collect())
        }
        _ => ParquetColumn::Text(cells.iter().map(|row| row[at].clone()).collect()),
    };
    let file = |(folder, cells): (String, Vec<&NumberCells>)| {
        let own = (0..COLUMNS.len()).filter(|at| COLUMNS[*at] != "site");
        let columns: Vec<_> = own.map(|at| (COLUMNS[at], column(&cells, at))).collect();
        (format!("{folder}/{name}.parquet"), parquet_table(&columns))
    };
    parts.into_iter().map(file).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn visits_are_in_the_order_of_their_numbers() {
        let mut visits = ["10", "1.10", "v2", "2", "1.2", "1", "v10"];
        visits.sort_by_key(|visit| natural(visit));
        assert_eq!(visits, ["1", "1.2", "1.10", "2", "10", "v2", "v10"]);
    }
}
