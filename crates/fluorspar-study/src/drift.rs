//! What a change of the program or of its experiment changed.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::ValueHint;
use fluorspar::analysis::{Norm, NormError};
use fluorspar_session::{Error, Job, Result};
use serde::{Deserialize, Serialize};

use crate::compare::region_of;
use crate::norm::{NormFile, read_norm};
use crate::store::{Study, StudyArgs};

/// Which analyses are compared.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct DriftOptions {
    /// The study.
    #[command(flatten)]
    #[serde(flatten)]
    pub args: StudyArgs,
    /// Earlier version of the program, or the beginning of the digest of its experiment [default: the one before the last].
    #[arg(long, value_name = "VERSION")]
    pub from: Option<String>,
    /// Later one [default: the last].
    #[arg(long, value_name = "VERSION")]
    pub to: Option<String>,
    /// Norm whose limits are watched.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub norm: Option<PathBuf>,
}

/// What changed.
#[derive(Clone, Debug, Serialize)]
pub struct Drift {
    /// Experiment and version of the earlier numbers.
    pub from: [String; 2],
    /// Experiment and version of the later ones.
    pub to: [String; 2],
    /// Each number.
    pub quantities: Vec<QuantityDrift>,
    /// People who cross a limit of the norm.
    pub crossing: Vec<String>,
    /// Numbers that can't be held against the norm, and why.
    pub left_out: Vec<String>,
}

/// What changed of a number.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct QuantityDrift {
    /// Name of the region.
    pub region: String,
    /// The number, with its channel.
    pub quantity: String,
    /// Regions that both estimated.
    pub n: usize,
    /// Median of later less earlier.
    pub median: f64,
    /// 95 % of the changes are no larger, either way.
    pub largest: f64,
}

/// A number by region digest, region name, quantity, channel and person.
type Key = (String, String, String, String, String);

/// A number of a person.
struct Number {
    value: f64,
    age: Option<f64>,
    site: String,
}

/// Compares the numbers of two analyses of the same regions.
///
/// # Errors
/// Fewer than two analyses, or names that fit none or several.
pub fn drift(options: &DriftOptions, _: &Job) -> Result<Drift> {
    let study = Study::open(&options.args.study)?;
    let known: Vec<[String; 2]> = study.index.rows(
        "SELECT analysis, version FROM estimate GROUP BY analysis, version ORDER BY max(seq)",
        [],
        |row| Ok([row.get(0)?, row.get(1)?]),
    )?;
    let [.., before, last] = &known[..] else {
        return Err(Error::Input(
            "all numbers are of one analysis: after an upgrade, or a change of camera.toml, `fluorspar study analyze STUDY --missing` adds those of \
             the new one"
                .into(),
        ));
    };
    let from = named(&known, options.from.as_deref(), before)?;
    let to = named(&known, options.to.as_deref(), last)?;
    let (earlier, later) = (values(&study, &from)?, values(&study, &to)?);
    let mut changes: BTreeMap<(String, String), Vec<f64>> = BTreeMap::new();
    let norm = options.norm.as_deref().map(read_norm).transpose()?;
    let fitted = norm.as_ref().map(|norm| norm.fit()).transpose()?;
    let (mut crossing, mut left_out) = (Vec::new(), Vec::new());
    for (key, after) in &later {
        let Some(before) = earlier.get(key) else { continue };
        let (_, region, quantity, channel, subject) = key;
        let name = format!("{quantity} {channel}").trim_end().to_owned();
        changes.entry((region.clone(), name.clone())).or_default().push(after.value - before.value);
        let is_of_norm = |(norm, _): &(&NormFile, &Norm)| {
            region_of(norm, region) && norm.quantity == *quantity && norm.channel == *channel
        };
        if let Some((_, fitted)) = norm.as_ref().zip(fitted.as_ref()).filter(is_of_norm) {
            match way(fitted, before.value, after) {
                Ok(Some(way)) => crossing.push(format!(
                    "{subject}: {name} of {region} goes {way} the norm, from {} to {}",
                    before.value, after.value
                )),
                Ok(None) => {}
                Err(error) => left_out.push(format!("{subject}: {name} of {region}: {error}")),
            }
        }
    }
    let quantities = changes
        .into_iter()
        .map(|((region, quantity), changes)| drift_of(region, quantity, changes))
        .collect();
    Ok(Drift { from, to, quantities, crossing, left_out })
}

/// Which way a number of a person crosses a limit, if it does.
fn way(norm: &Norm, before: f64, after: &Number) -> Result<Option<&'static str>, NormError> {
    let [low, high] = norm.range(after.age, &after.site)?;
    let [was_inside, is_inside] = [before, after.value].map(|value| (low..=high).contains(&value));
    Ok((was_inside != is_inside).then_some(if is_inside { "into" } else { "out of" }))
}

fn named(known: &[[String; 2]], wanted: Option<&str>, default: &[String; 2]) -> Result<[String; 2]> {
    let Some(wanted) = wanted else { return Ok(default.clone()) };
    let fits = |[analysis, version]: &&[String; 2]| version == wanted || analysis.starts_with(wanted);
    let mut found = known.iter().filter(fits);
    match (found.next(), found.next()) {
        (Some(one), None) => Ok(one.clone()),
        (one, _) => {
            let all: Vec<String> =
                known.iter().map(|[analysis, version]| format!("{version} ({})", &analysis[..8])).collect();
            let why = if one.is_some() { "several analyses are" } else { "no analysis is" };
            Err(Error::Input(format!("{why} called \"{wanted}\"; the study has {}", all.join(", "))))
        }
    }
}

fn values(study: &Study, [analysis, version]: &[String; 2]) -> Result<BTreeMap<Key, Number>> {
    let sql = "SELECT e.region_sha256, e.region, e.quantity, e.channel, p.subject, e.value, s.age,
               CASE WHEN s.site = '' THEN (SELECT site FROM study LIMIT 1) ELSE s.site END FROM estimate e
               JOIN photograph p ON p.photograph = e.photograph JOIN subject s ON s.subject = p.subject
               JOIN region r ON r.region_sha256 = e.region_sha256 AND r.current = 1
               WHERE e.analysis = ? AND e.version = ? AND e.value IS NOT NULL AND s.withdrawn = 0";
    let rows = study.index.rows(sql, [analysis, version], |row| {
        let key = (row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?, row.get(4)?);
        Ok((key, Number { value: row.get(5)?, age: row.get(6)?, site: row.get(7)? }))
    })?;
    Ok(rows.into_iter().collect())
}

fn drift_of(region: String, quantity: String, mut changes: Vec<f64>) -> QuantityDrift {
    let n = changes.len();
    changes.sort_by(f64::total_cmp);
    let median = 0.5 * (changes[(n - 1) / 2] + changes[n / 2]);
    let mut sizes: Vec<f64> = changes.iter().map(|change| change.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let largest = sizes[((0.95 * n as f64).ceil() as usize).clamp(1, n) - 1];
    QuantityDrift { region, quantity, n, median, largest }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fluorspar::analysis::{NormPerson, NormSums};
    use fluorspar::findings::FindingId;

    #[test]
    fn a_shift_is_what_was_added() {
        let found = drift_of("tongue".into(), "red_share".into(), vec![0.02, 0.01, -0.05, 0.01]);
        assert_eq!((found.n, found.median, found.largest), (4, 0.01, 0.05));
    }

    /// A number that falls with the years is that of an old person, not of a young one.
    #[test]
    fn people_cross_the_limits_of_their_age_and_site() {
        let of_age = |age: f64, k: u32| 0.6 - 0.005 * age + 0.004 * f64::from(k % 3);
        let person = |k: u32| {
            let age = 20.0 + 5.0 * f64::from(k);
            NormPerson { site: "north".into(), age: Some(age), values: vec![of_age(age, k)], error: None }
        };
        let people: Vec<NormPerson> = (0..13).map(person).collect();
        let other = people.iter().map(|person| NormPerson { site: "south".into(), ..person.clone() });
        let all: Vec<NormPerson> = people.iter().cloned().chain(other).collect();
        let range = FindingId::ChromaticityR.value_range().unwrap();
        let norm = NormSums::of(&all, range, true).fit().unwrap();
        let crosses = |age: Option<f64>, site: &str| {
            way(&norm, of_age(20.0, 1), &Number { value: of_age(80.0, 1), age, site: site.into() })
        };
        assert_eq!(crosses(Some(20.0), "north"), Ok(Some("out of")));
        assert_eq!(crosses(Some(80.0), "south"), Ok(Some("into")));
        assert_eq!(crosses(None, "north"), Err(NormError::NoAge));
        assert_eq!(crosses(Some(20.0), "west"), Err(NormError::OtherSite("west".into())));
    }
}
