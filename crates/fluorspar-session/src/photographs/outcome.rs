//! What many photographs say: tables and a page.

use std::collections::BTreeMap;

use fluorspar::analysis::lie_apart;
use fluorspar::findings::FindingId;
use fluorspar_experiment::Warning;
use fluorspar_format::{OutputFolder, csv_cell};
use fluorspar_report::{
    PhotographResults, PlacedNumber, ReportPicture, photographs_report, warnings_by_kind,
};

use super::estimate::{EstimatedPhotograph, GUESS, IntervalKind, PatientEstimate, picture_of};
use super::pairing::Photograph;
use super::proposal::Proposed;
use super::table::{MISSING, PhotographRow, photographs_csv};
use super::{AnalyzedPhotographs, FailedPhotograph, PhotographWork, TABLE};
use crate::values::csv;
use crate::{Job, Result};

/// Pictures on a page at most.
const PICTURES: usize = 200;

/// Marks numbers that lie apart from the same ones of the other photographs.
pub(super) fn mark_apart(done: &mut [(&Photograph, EstimatedPhotograph)]) {
    let mut groups: BTreeMap<(String, FindingId, Option<String>), Vec<&mut PatientEstimate>> =
        BTreeMap::new();
    for estimate in done.iter_mut().flat_map(|(_, found)| &mut found.estimates) {
        let key = (estimate.number.region.clone(), estimate.number.quantity, estimate.number.channel.clone());
        groups.entry(key).or_default().push(estimate);
    }
    for ((_, quantity, _), mut group) in groups {
        let straight =
            |estimate: &&mut PatientEstimate| quantity.value_range()?.straightened(estimate.number.value?);
        let values: Vec<Option<f64>> = group.iter().map(straight).collect();
        let known: Vec<f64> = values.iter().copied().flatten().collect();
        let mut apart = lie_apart(&known).into_iter();
        for (estimate, value) in group.iter_mut().zip(values) {
            estimate.lies_apart = value.is_some() && apart.next().unwrap_or(false);
        }
    }
}

/// Says of which regions some are guesses and others were placed.
fn mixed_regions(done: &[(&Photograph, EstimatedPhotograph)]) -> Vec<Warning> {
    let mut counts: BTreeMap<&str, [usize; 2]> = BTreeMap::new();
    for [name, _, verdict] in done.iter().flat_map(|(photograph, _)| &photograph.regions) {
        counts.entry(name).or_default()[usize::from(verdict == GUESS)] += 1;
    }
    let is_mixed = |(name, [placed, guessed]): (&str, [usize; 2])| {
        let text = format!(
            "{name}: {guessed} of these regions are guesses, which end elsewhere than the {placed} that were placed or confirmed; compare numbers of \
             regions that are placed alike"
        );
        (placed > 0 && guessed > 0).then(|| text.into())
    };
    counts.into_iter().filter_map(is_mixed).collect()
}

/// Writes the table of estimates and the page.
pub(super) fn write_estimates(
    work: &PhotographWork<'_>,
    folder: OutputFolder,
    done: &[(&Photograph, EstimatedPhotograph)],
    failures: Vec<FailedPhotograph>,
    job: &Job,
) -> Result<AnalyzedPhotographs> {
    job.warn(&mixed_regions(done));
    let estimates: Vec<PatientEstimate> =
        done.iter().flat_map(|(_, found)| found.estimates.clone()).collect();
    let apart =
        |found: &EstimatedPhotograph| found.estimates.iter().filter(|estimate| estimate.lies_apart).count();
    let mut shown: Vec<_> = done.iter().collect();
    shown.sort_by_key(|(_, found)| std::cmp::Reverse(apart(found)));
    let picture = |(photograph, found): &&(&Photograph, EstimatedPhotograph)| {
        Ok(ReportPicture {
            png: picture_of(found)?,
            title: format!("{}, visit {}", photograph.patient, photograph.visit),
            caption: regions_of(found).join(", "),
        })
    };
    let pictures = shown.iter().take(PICTURES).map(picture).collect::<Result<Vec<_>>>()?;
    let page = page(work, &estimates, pictures, &failures);
    let files = [
        ("patients.csv".to_owned(), patients_csv(&estimates).into_bytes()),
        ("results.json".into(), serde_json::to_vec_pretty(&estimates)?),
        ("report.html".into(), page.into_bytes()),
    ];
    let folder = folder.finish_with(files)?;
    job.status(format!("Open {}", folder.join("report.html").display()));
    Ok(AnalyzedPhotographs { folder, photographs: done.len(), estimates, failures })
}

fn regions_of(found: &EstimatedPhotograph) -> Vec<&str> {
    let mut regions: Vec<&str> =
        found.estimates.iter().map(|estimate| estimate.number.region.as_str()).collect();
    regions.dedup();
    regions
}

fn page(
    work: &PhotographWork<'_>,
    estimates: &[PatientEstimate],
    pictures: Vec<ReportPicture>,
    failures: &[FailedPhotograph],
) -> String {
    let number = |estimate: &PatientEstimate| PlacedNumber {
        place: [estimate.patient.clone(), estimate.visit.clone(), estimate.number.region.clone()],
        frame: estimate.capture.clone(),
        id: estimate.number.quantity,
        channel: estimate.number.channel.clone(),
        value: estimate.number.value,
        interval: estimate.number.interval,
        is_of_pixels: estimate.number.interval_kind == IntervalKind::Pixels,
        lies_apart: estimate.lies_apart,
    };
    let results = PhotographResults {
        title: format!("{} photographs", pictures.len()),
        experiment: &work.source.name,
        numbers: estimates.iter().map(number).collect(),
        pictures,
        warnings: warnings_by_kind(&warnings_of(estimates)),
        failures: failures
            .iter()
            .map(|failed| (failed.frame.display().to_string(), failed.why.clone()))
            .collect(),
        is_proposal: false,
    };
    photographs_report(&results).to_html()
}

/// The warnings of each region.
fn warnings_of(estimates: &[PatientEstimate]) -> Vec<Vec<String>> {
    let of_region = |a: &PatientEstimate, b: &PatientEstimate| {
        (&a.frame, &a.number.region) == (&b.frame, &b.number.region)
    };
    estimates.chunk_by(of_region).map(|of| of[0].number.warnings.clone()).collect()
}

/// A line each estimate.
fn patients_csv(estimates: &[PatientEstimate]) -> String {
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    let row = |estimate: &PatientEstimate| {
        let word = |value: serde_json::Result<serde_json::Value>| {
            value.ok().and_then(|value| value.as_str().map(str::to_owned)).unwrap_or_default()
        };
        let [low, high] = estimate.number.interval.map_or([None; 2], |ends| ends.map(Some));
        let cells = [
            estimate.patient.clone(),
            estimate.visit.clone(),
            estimate.capture.clone(),
            estimate.frame.display().to_string(),
            estimate.number.region.clone(),
            word(serde_json::to_value(estimate.number.quantity)),
            estimate.number.channel.clone().unwrap_or_default(),
            estimate.number.quantity.unit().to_owned(),
            number(estimate.number.value),
            number(low),
            number(high),
            word(serde_json::to_value(estimate.number.interval_kind)),
            estimate.number.pixels.to_string(),
            u8::from(estimate.lies_apart).to_string(),
            estimate.number.warnings.join(" | "),
        ];
        cells.map(|cell| csv_cell(&cell).into_owned()).join(",")
    };
    let heads = "patient,visit,capture,frame,region,quantity,channel,unit,value,low,high,interval,pixels,lies_apart,warnings";
    csv(heads, estimates.iter().map(row))
}

/// Says in which photographs a region was not guessed that was in most, and gives each a line to complete: what is ill may look like no
/// tongue.
fn add_unguessed(proposed: &mut [Proposed]) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let has = |of: &Proposed, name: &str| of.rows.iter().any(|row| row.region == name);
    for name in ["tongue", "lips", "teeth"] {
        let lacking = || proposed.iter().filter(|of| !has(of, name));
        if lacking().count() == 0 || 2 * lacking().count() >= proposed.len() {
            continue;
        }
        let titles: Vec<&str> = lacking().map(|of| of.picture.title.as_str()).collect();
        let text = format!(
            "No {name} was found in {}: draw it, or this person is left out. Lines with the verdict \"{MISSING}\" wait for the place",
            titles.join("; ")
        );
        warnings.push(text.into());
        for of in proposed.iter_mut().filter(|of| !has(of, name)) {
            if let Some(first) = of.rows.first().cloned() {
                let (region, verdict) = (name.to_owned(), MISSING.to_owned());
                of.rows.insert(0, PhotographRow { region, place: String::new(), verdict, ..first });
                of.picture.caption += &format!("; no {name} was found");
            }
        }
    }
    warnings
}

/// Writes the table to complete, and the page with the guesses.
pub(super) fn write_proposal(
    work: &PhotographWork<'_>,
    folder: OutputFolder,
    mut proposed: Vec<Proposed>,
    failures: Vec<FailedPhotograph>,
    job: &Job,
) -> Result<AnalyzedPhotographs> {
    let failures: Vec<FailedPhotograph> = work.failures().into_iter().chain(failures).collect();
    let warnings = add_unguessed(&mut proposed);
    job.warn(&warnings);
    let rows: Vec<_> = proposed.iter().flat_map(|photograph| photograph.rows.clone()).collect();
    let photographs = proposed.len();
    let results = PhotographResults {
        title: format!("{photographs} photographs, regions to place"),
        experiment: &work.source.name,
        numbers: Vec::new(),
        pictures: proposed.into_iter().map(|photograph| photograph.picture).take(PICTURES).collect(),
        warnings,
        failures: failures
            .iter()
            .map(|failed| (failed.frame.display().to_string(), failed.why.clone()))
            .collect(),
        is_proposal: true,
    };
    let page = photographs_report(&results).to_html();
    let folder = folder.finish_with([
        (TABLE.to_owned(), photographs_csv(&rows)?),
        ("report.html".to_owned(), page.into_bytes()),
    ])?;
    let table = folder.join(TABLE);
    job.status(format!(
        "No region is placed. Look at the guesses: {}\nIn {} write \"right\" as verdict of those that are, strike wrong lines, or write \"wrong\"; draw others on the \
         pictures in {}. Then: fluorspar analyze {} --experiment {} --out numbers",
        folder.join("report.html").display(),
        table.display(),
        folder.join("previews").display(),
        table.display(),
        work.options.experiment.as_deref().unwrap_or_default()
    ));
    Ok(AnalyzedPhotographs { folder, photographs, estimates: Vec::new(), failures })
}
