//! What a search of designs found: as JSON and CSV, and as a report.

use std::collections::BTreeMap;

use fluorspar::analysis::Analyte;
use fluorspar::design::{
    Criterion, Design, DesignSpace, Score, Sensitivity, WorstCase, pareto_front, sensitivities, worst_case,
};
use fluorspar::pipeline::design_estimate;
use fluorspar_format::{FileFormat, OutputFolder, csv_cell};
use fluorspar_report::{DesignFindings, JudgedDesign, design_figures, design_report, recommended};
use serde::{Serialize, Serializer};
use serde_json::{Value, json};

use super::PreparedProblem;
use crate::figure_file::figure_files;
use crate::values::csv;
use crate::{Error, Job, Result};

/// Room for the tables and the report.
pub(super) const FOLDER_BYTES: u64 = 64 << 20;

/// Designs among which sensitivities look for another best.
const RIVALS: usize = 10;

/// Scores of the designs that were evaluated.
pub(super) struct Found {
    /// By number.
    pub(super) scores: Vec<(u64, Score)>,
    /// How they were chosen, in words.
    pub(super) search: String,
    /// The action that chose them.
    pub(super) action: &'static str,
}

/// The best designs of a search.
pub struct DesignOutcome {
    /// The problem.
    pub problem: PreparedProblem,
    /// Scores of what was evaluated, by number of the design.
    pub scores: Vec<(u64, Score)>,
    /// How designs were chosen, in words.
    pub search: String,
    action: &'static str,
    /// Number of those that can do it.
    pub feasible: usize,
    /// Why the others can't, in words.
    pub left_out: String,
    /// The best first.
    pub best: Vec<JudgedDesign>,
    front: Vec<JudgedDesign>,
    /// Those that the file names.
    pub compared: Vec<JudgedDesign>,
    /// What the best rests on.
    pub sensitivities: Vec<Sensitivity>,
    /// Within tolerances, of the first of the best.
    pub worst_cases: Vec<WorstCase>,
}

pub(super) fn judged(space: &DesignSpace, name: String, design: Design) -> JudgedDesign {
    let merits = space.evaluate(&design);
    let fluorescence = space.filtered_fluorescence(&design);
    JudgedDesign { name, design, merits, fluorescence, estimate: None }
}

/// Designs of which it is told what an analysis of their frames would find, of the best.
const ESTIMATED: usize = 3;

/// Adds what an analysis of the frames of a design would say of its first region, where a contrast asks for porphyrin.
pub(super) fn estimate(problem: &PreparedProblem, judged: &mut JudgedDesign) -> Result<()> {
    let space = &problem.space;
    let p = space.problem();
    let is_asked =
        p.contrasts.iter().any(|contrast| contrast.part.iter().any(|name| Analyte::names_porphyrin(name)));
    let (Some(Some(prior)), true) = (problem.resolved.priors.first(), is_asked) else { return Ok(()) };
    let found = design_estimate(space, &judged.design, 0, Analyte::names_porphyrin, prior);
    judged.estimate = found.map_err(|error| Error::Input(error.to_string()))?;
    Ok(())
}

/// The designs of the file to compare with.
pub(super) fn compared(problem: &PreparedProblem) -> Result<Vec<JudgedDesign>> {
    let of = |compared: &fluorspar_experiment::ComparedDesign| {
        let mut judged = judged(&problem.space, compared.name.clone(), compared.design.clone());
        estimate(problem, &mut judged)?;
        Ok(judged)
    };
    problem.resolved.compared.iter().map(of).collect()
}

impl DesignOutcome {
    pub(super) fn of(problem: PreparedProblem, found: Found) -> Result<Self> {
        let space = &problem.space;
        let scores: Vec<Score> = found.scores.iter().map(|(_, score)| *score).collect();
        let mut ranked: Vec<usize> = (0..scores.len()).filter(|&k| scores[k].loss.is_finite()).collect();
        ranked.sort_by(|&a, &b| scores[a].loss.total_cmp(&scores[b].loss).then(a.cmp(&b)));
        let judge = |&place: &usize| {
            let design = space.design(found.scores[place].0);
            judged(space, space.describe(&design), design)
        };
        let keep = problem.resolved.search.keep as usize;
        let mut best: Vec<JudgedDesign> = ranked.iter().take(keep).map(judge).collect();
        best.iter_mut().take(ESTIMATED).try_for_each(|judged| estimate(&problem, judged))?;
        let front: Vec<JudgedDesign> = pareto_front(&scores).iter().take(keep).map(judge).collect();
        let rivals: Vec<Design> = best.iter().take(RIVALS).map(|judged| judged.design.clone()).collect();
        let failed = |error: fluorspar::design::DesignError| Error::Input(error.to_string());
        let within = |design: &Design| {
            worst_case(space.problem(), design, &problem.resolved.tolerance).map_err(failed)
        };
        let worst_cases = rivals.iter().map(within).collect::<Result<Vec<_>, _>>()?;
        let Found { scores, search, action } = found;
        Ok(Self {
            feasible: ranked.len(),
            left_out: left_out(space, &scores),
            best,
            front,
            compared: compared(&problem)?,
            sensitivities: sensitivities(space.problem(), &rivals).map_err(failed)?,
            worst_cases,
            problem,
            scores,
            search,
            action,
        })
    }

    /// Writes the folder.
    pub(super) fn write(self, folder: OutputFolder, job: &Job) -> Result<Self> {
        let space = &self.problem.space;
        let lines = self.best.iter().map(|judged| design_json(space, judged).to_string() + "\n");
        let mut files = vec![
            ("results.json".to_owned(), serde_json::to_vec_pretty(&self)?),
            ("designs.csv".into(), table_csv(space, &self.best).into_bytes()),
            ("designs.jsonl".into(), lines.collect::<String>().into_bytes()),
            ("report.html".into(), self.with_findings(design_report).to_html().into_bytes()),
        ];
        for (stem, figure) in self.with_findings(design_figures) {
            files.extend(figure_files(stem, &figure)?);
        }
        let place = folder.finish_with(files)?;
        job.status(format!("Open {}", place.join("report.html").display()));
        Ok(self)
    }

    fn as_json(&self) -> Value {
        let space = &self.problem.space;
        let all =
            |list: &[JudgedDesign]| -> Vec<Value> { list.iter().map(|d| design_json(space, d)).collect() };
        let recommended = self.with_findings(|found| space.number(&recommended(found)?.1.design));
        json!({
            "format": FileFormat::RESULTS.version(),
            "provenance": provenance(&self.problem),
            "search": self.search,
            "designs": space.len(),
            "evaluated": self.scores.len(),
            "feasible": self.feasible,
            "left_out": (!self.left_out.is_empty()).then_some(&self.left_out),
            "criterion": criterion_text(space),
            "recommended": recommended,
            "best": all(&self.best),
            "pareto_front": all(&self.front),
            "compared": all(&self.compared),
            "sensitivity": self.sensitivities,
            "worst_case": self.worst_cases.first(),
            "worst_cases": self.worst_cases,
        })
    }

    /// What the page and its figures are made of.
    pub fn with_findings<T>(&self, make: impl FnOnce(&DesignFindings<'_>) -> T) -> T {
        let problem = &self.problem;
        let record = &problem.resolved.record;
        make(&DesignFindings {
            title: problem.title(),
            description: &record.description,
            criterion: &criterion_text(&problem.space),
            search: &self.search,
            action: self.action,
            space: &problem.space,
            scores: &self.scores,
            left_out: &self.left_out,
            best: &self.best,
            front: &self.front,
            compared: &self.compared,
            sensitivities: &self.sensitivities,
            worst_cases: &self.worst_cases,
            design_toml: &record.resolved_toml,
            sha256: &record.sha256,
        })
    }
}

impl Serialize for DesignOutcome {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.as_json().serialize(serializer)
    }
}

/// Designs without a loss of which it is asked why, at most.
const ASKED_WHY: usize = 500;

/// Why designs have no loss, in words: which limits they break, or that they do not see what is asked for. Empty where all have one.
fn left_out(space: &DesignSpace, scores: &[(u64, Score)]) -> String {
    let lost: Vec<u64> =
        scores.iter().filter(|(_, s)| !s.loss.is_finite()).map(|(number, _)| *number).collect();
    if lost.is_empty() {
        return String::new();
    }
    // Even steps through all of them
    let step = lost.len().div_ceil(ASKED_WHY);
    let asked: Vec<u64> = lost.iter().copied().step_by(step).collect();
    let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
    for &number in &asked {
        let broken = space.evaluate(&space.design(number)).broken;
        let reason = match &broken[..] {
            [] => "do not see what is asked for".to_owned(),
            broken => format!("break the limit of {}", broken.join(" and ")),
        };
        *reasons.entry(reason).or_default() += 1;
    }
    let mut reasons: Vec<(String, usize)> = reasons.into_iter().collect();
    reasons.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let reasons: Vec<String> = reasons.iter().map(|(reason, count)| format!("{count} {reason}")).collect();
    let of = if step > 1 { format!(", of which {} were looked at", asked.len()) } else { String::new() };
    format!("{} of {} designs are left out{of}: {}", lost.len(), scores.len(), reasons.join(", "))
}

pub(super) fn provenance(problem: &PreparedProblem) -> Value {
    let record = &problem.resolved.record;
    json!({
        "program": "fluorspar",
        "version": env!("CARGO_PKG_VERSION"),
        "sha256": record.sha256,
        "warnings": record.warnings,
        "design_toml": record.resolved_toml,
    })
}

/// What designs are ranked by, in words.
pub fn criterion_text(space: &DesignSpace) -> String {
    let p = space.problem();
    match p.criterion {
        Criterion::Minimax => "the worst relative standard deviation of a weight".into(),
        Criterion::D => "the volume of the error ellipsoid (D)".into(),
        Criterion::A => "the mean variance of the weights (A)".into(),
        Criterion::E => "the worst combination of weights (E)".into(),
        Criterion::Contrast(k) => {
            format!(
                "the standard deviation of {}",
                p.contrasts.get(k).map_or("a contrast", |c| c.name.as_str())
            )
        }
        Criterion::Detection => "1 / d' of the cohort".into(),
        Criterion::Leak => "the leak, reflected electrons per fluorescent electron".into(),
    }
}

/// A design with everything about it; what is not seen is null.
pub(super) fn design_json(space: &DesignSpace, judged: &JudgedDesign) -> Value {
    let p = space.problem();
    let (design, merits) = (&judged.design, &judged.merits);
    let lights: Vec<&str> = design.lights.iter().map(|&k| p.lights[k].name.as_str()).collect();
    let shares =
        p.regions_of(design.geometry).next().zip(judged.fluorescence.as_ref()).map(|(region, of)| {
            let names = region.response.fluorescence.iter().map(|f| f.name.clone());
            names.zip(of.shares.iter().map(|share| json!(share))).collect::<serde_json::Map<_, _>>()
        });
    let regions: Vec<Value> = p
        .regions_of(design.geometry)
        .zip(&merits.regions)
        .map(|(region, found)| {
            let names = region.response.fluorescence.iter().map(|f| f.name.clone());
            let weights: serde_json::Map<String, Value> =
                names.zip(&found.weights).map(|(name, sd)| (name, finite(*sd))).collect();
            let contrasts: serde_json::Map<String, Value> = p
                .contrasts
                .iter()
                .zip(&found.contrasts)
                .map(|(c, sd)| (c.name.clone(), finite(*sd)))
                .collect();
            let values: serde_json::Map<String, Value> = p
                .contrasts
                .iter()
                .zip(&found.contrast_values)
                .map(|(c, value)| (c.name.clone(), json!(value)))
                .collect();
            json!({
                "name": region.response.name,
                "relative_sd": weights,
                "contrast_sd": contrasts,
                "contrast": values,
                "rank": found.rank,
                "weights": found.weights.len(),
                "electrons": found.electrons,
                "signal_to_noise": found.signal_to_noise,
                "leak": finite(found.leak),
                "saturation": found.saturation,
                "least_told_apart": found.bound.weakest_directions(2),
            })
        })
        .collect();
    json!({
        "name": judged.name,
        "number": space.number(design),
        "lights": lights,
        "view_filter": p.filters[design.filter].name,
        "sensor": p.cameras[design.camera].name,
        "f_number": p.lenses[design.lens].f_number,
        "geometry": p.geometries.get(design.geometry).map(|geometry| &geometry.name),
        "drive": p.drives[design.drive],
        "times_ms": merits.times_s.iter().map(|s| s * 1e3).collect::<Vec<f64>>(),
        "total_ms": merits.time_s * 1e3,
        "loss": finite(merits.loss),
        "broken_limits": merits.broken,
        "electrons": merits.electrons,
        "fluorescence_e": merits.fluorescence_e,
        "fluorescence_kept": judged.fluorescence.as_ref().map(|fluorescence| fluorescence.kept),
        "fluorescence_shares": shares,
        "cost": merits.cost,
        "leak": finite(merits.leak),
        "saturation": merits.saturation,
        "tissue_margin": merits.tissue_margin,
        "eye_margin": merits.eye_margin,
        "detectability": merits.detectability,
        "color_separability": merits.color_separability,
        "estimate": judged.estimate,
        "regions": regions,
    })
}

fn finite(value: f64) -> Value {
    if value.is_finite() { json!(value) } else { Value::Null }
}

/// The best designs as a table of a spreadsheet; weights and contrasts by region.
fn table_csv(space: &DesignSpace, designs: &[JudgedDesign]) -> String {
    let p = space.problem();
    let mut head: Vec<String> =
        ["number", "lights", "times_ms", "view_filter", "sensor", "f_number", "drive", "geometry", "loss"]
            .map(String::from)
            .into();
    for region in p.regions_of(0) {
        let of = |name: &str| format!("{}: {name}", region.response.name);
        head.extend(region.response.fluorescence.iter().map(|f| of(&format!("sd {}", f.name))));
        head.extend(p.contrasts.iter().map(|c| of(&format!("sd {}", c.name))));
    }
    head.extend(
        [
            "electrons",
            "fluorescence_e",
            "fluorescence_kept",
            "total_ms",
            "cost",
            "leak",
            "saturation",
            "tissue_margin",
            "eye_margin",
            "detectability",
        ]
        .map(String::from),
    );
    let row = |judged: &JudgedDesign| {
        let (design, merits) = (&judged.design, &judged.merits);
        let lights: Vec<&str> = design.lights.iter().map(|&k| p.lights[k].name.as_str()).collect();
        let number = |value: f64| if value.is_finite() { format!("{value}") } else { String::new() };
        let mut row = vec![
            space.number(design).map_or_else(String::new, |number| number.to_string()),
            lights.join(" + "),
            merits.times_s.iter().map(|s| number((1e6 * s).round() / 1e3)).collect::<Vec<_>>().join(" + "),
            p.filters[design.filter].name.clone(),
            p.cameras[design.camera].name.clone(),
            number(p.lenses[design.lens].f_number),
            number(p.drives[design.drive]),
            p.geometries.get(design.geometry).map_or_else(String::new, |geometry| geometry.name.clone()),
            number(merits.loss),
        ];
        for region in &merits.regions {
            row.extend(region.weights.iter().chain(&region.contrasts).map(|sd| number(*sd)));
        }
        row.extend([merits.electrons, merits.fluorescence_e].map(number));
        row.push(
            judged.fluorescence.as_ref().map_or_else(String::new, |fluorescence| number(fluorescence.kept)),
        );
        row.push(number(merits.time_s * 1e3));
        row.extend([merits.cost, merits.leak, merits.saturation].map(number));
        row.extend(
            [merits.tissue_margin, merits.eye_margin, merits.detectability]
                .map(|value| value.map_or_else(String::new, number)),
        );
        csv_line(&row)
    };
    csv(&csv_line(&head), designs.iter().map(row))
}

fn csv_line(cells: &[String]) -> String {
    cells.iter().map(|cell| csv_cell(cell)).collect::<Vec<_>>().join(",")
}
