//! What a cohort says: tables, JSON and a page.

use std::collections::BTreeMap;

use fluorspar::analysis::Analyte;
use fluorspar::findings::{CohortQuantity, FindingId, PersonFinding, cohort_findings};
use fluorspar_experiment::schema::LesionSection;
use fluorspar_experiment::{CohortStudy, Warning, people_csv};
use fluorspar_format::{FileFormat, OutputFolder, csv_cell};
use fluorspar_report::{CohortResults, cohort_figures, cohort_report};
use serde::{Serialize, Serializer};
use serde_json::{Value, json};

use super::work::CohortWork;
use crate::figure_file::figure_files;
use crate::photographs::camera_digest;
use crate::values::csv;
use crate::{Job, Result};

/// What is found in all people of a cohort.
#[derive(Clone, Debug)]
pub struct CohortOutcome(pub CohortResults);

/// Room for the tables and the page: a view has some hundred lines, the table of people a line of 2 kB.
pub(super) fn room_bytes(cohort: &CohortStudy) -> u64 {
    let people = u64::from(cohort.people.count);
    (64 << 20) + people * (4096 + (32 << 10) * cohort.views.len() as u64)
}

/// Warns of lesions that are measured in nobody.
pub(super) fn unseen(lesions: &[LesionSection], findings: &[(u32, PersonFinding)]) -> Vec<Warning> {
    let is_seen = |lesion: &LesionSection| {
        let of = |(_, finding): &(u32, PersonFinding)| {
            let quantity = &finding.quantity;
            quantity.id == FindingId::TargetContrast && quantity.name.as_ref() == Some(&lesion.name)
        };
        findings.iter().any(of)
    };
    let warn = |lesion: &LesionSection| {
        let statement = format!("Lesion \"{}\" is measured in nobody", lesion.name);
        Warning::explained(statement, "No view shows enough of it; people.views names the views")
    };
    lesions.iter().filter(|lesion| !is_seen(lesion)).map(warn).collect()
}

impl CohortOutcome {
    pub(super) fn of(work: &CohortWork, findings: Vec<(u32, PersonFinding)>) -> Result<Self> {
        let all: Vec<PersonFinding> = findings.iter().map(|(_, finding)| finding.clone()).collect();
        let cohort = work.cohort.clone();
        let analysis = cohort.experiment.file.analysis.as_ref();
        let porphyrin = analysis.and_then(|analysis| analysis.porphyrin.as_deref());
        let analyte =
            porphyrin.map_or_else(Analyte::default, |name| Analyte::new(name, &name.replace('_', " ")));
        let frame = analysis.map_or_else(String::new, |analysis| analysis.frame.clone());
        let (title, sha256) = (work.title().to_owned(), work.sha256.clone());
        let (said, toml, inputs) = (cohort_findings(&all), work.toml()?, work.inputs.clone());
        Ok(Self(CohortResults { title, said, cohort, findings, frame, analyte, toml, inputs, sha256 }))
    }

    /// Writes the folder.
    pub(super) fn write(self, work: &CohortWork, folder: OutputFolder, job: &Job) -> Result<Self> {
        let people = work.people()?;
        let camera = camera_digest(&work.source, &work.cohort.experiment)?;
        job.warn(&unseen(self.0.cohort.lesions(), &self.0.findings));
        let mut files = vec![
            ("results.json".to_owned(), serde_json::to_vec_pretty(&self)?),
            ("people.csv".into(), people_csv(&people, false)?.into_bytes()),
            ("cohort.csv".into(), self.table(&camera[..16]).into_bytes()),
            ("ranges.csv".into(), self.ranges().into_bytes()),
            ("report.html".into(), cohort_report(&self.0).to_html().into_bytes()),
        ];
        for (stem, figure) in cohort_figures(&self.0) {
            files.extend(figure_files(stem, &figure)?);
        }
        let place = folder.finish_with(files)?;
        job.status(format!("Open {}", place.join("report.html").display()));
        Ok(self)
    }

    /// Every number of every person, a line each, with the digest of the camera.
    fn table(&self, camera: &str) -> String {
        let lesions = self.0.cohort.lesions();
        let with = |person: u32| -> String {
            let held = lesions.iter().filter(|lesion| self.0.cohort.has_lesion(person, lesion));
            held.map(|lesion| lesion.name.as_str()).collect::<Vec<_>>().join(" ")
        };
        let with: BTreeMap<u32, String> =
            self.0.cohort.numbers().map(|person| (person, with(person))).collect();
        let row = |(person, finding): &(u32, PersonFinding)| {
            let [low, high] = finding.interval.unwrap_or_default();
            let numbers = [finding.value, low, high, finding.reference].map(number);
            let lesion = u8::from(finding.has_lesion);
            format!(
                "{person},{},{lesion},{},{},{camera}",
                names(&finding.quantity),
                numbers.join(","),
                csv_cell(&with[person])
            )
        };
        let heads = format!("person,{NAMES},has_lesion_here,value,low,high,reference,lesions,camera");
        csv(&heads, self.0.findings.iter().map(row))
    }

    /// The ranges of people without lesions, a line each.
    fn ranges(&self) -> String {
        let row = |range: &fluorspar::findings::NormalRange| {
            let of = &range.statistics;
            let ends = range.tolerance.map_or([None; 2], |t| [Some(t.low), Some(t.high)]);
            let numbers = [Some(of.median), Some(of.p05), Some(of.p95), ends[0], ends[1]].map(number);
            format!("{},{},{}", names(&range.quantity), of.n, numbers.join(","))
        };
        let heads = format!("{NAMES},people,median,p05,p95,tolerance_low,tolerance_high");
        csv(&heads, self.0.said.ranges.iter().map(row))
    }
}

/// Columns of what a number is of.
const NAMES: &str = "view,part,frame,channel,name,quantity,unit";

fn names(of: &CohortQuantity) -> String {
    let id =
        serde_json::to_value(of.id).ok().and_then(|id| id.as_str().map(str::to_owned)).unwrap_or_default();
    let text = |text: &Option<String>| text.clone().unwrap_or_default();
    let cells = [of.view.clone(), of.part.clone(), text(&of.frame), text(&of.channel), text(&of.name), id];
    let cells: Vec<_> = cells.iter().map(|cell| csv_cell(cell)).collect();
    format!("{},{}", cells.join(","), csv_cell(of.id.unit()))
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

impl Serialize for CohortOutcome {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let all: Value = json!({
            "format": FileFormat::RESULTS.version(),
            "provenance": {
                "program": "fluorspar",
                "version": env!("CARGO_PKG_VERSION"),
                "sha256": self.0.sha256,
                "cohort_toml": self.0.toml,
            },
            "people": self.0.cohort.people,
            "findings": self.0.findings.len(),
            "ranges": self.0.said.ranges,
            "agreements": self.0.said.agreements,
            "separations": self.0.said.separations,
        });
        all.serialize(serializer)
    }
}
