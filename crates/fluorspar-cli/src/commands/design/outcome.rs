//! What a search found: in words, as JSON and CSV, and as a report.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use fluorspar::design::{
    Criterion, Design, DesignSpace, Score, Sensitivity, Tolerances, WorstCase, pareto_front, sensitivities,
    worst_case,
};
use fluorspar_experiment::TolerancesSection;
use fluorspar_format::{FileFormat, OutputFolder, csv_cell, write_atomically};
use fluorspar_report::{
    DesignFindings, JudgedDesign, best_case, design_figures, design_report, ideal_edges, recommendation,
};
use serde_json::{Value, json};

use super::Problem;
use crate::args::Answer;
use crate::commands::table::{align, short};
use crate::commands::{print_json, print_text};
use crate::error::CliError;
use crate::message::Messages;

/// Room for the tables and the report.
pub(super) const FOLDER_BYTES: u64 = 64 << 20;

/// Designs among which sensitivities look for another best.
const RIVALS: usize = 10;

/// Designs that are told in words.
const SHOWN: usize = 20;

/// Scores of the designs that were evaluated.
pub(super) struct Found {
    /// By number.
    pub(super) scores: Vec<(u64, Score)>,
    /// How they were chosen, in words.
    pub(super) search: String,
    /// The action that chose them.
    pub(super) action: &'static str,
}

/// The best of a search.
pub(super) struct Outcome {
    found: Found,
    feasible: usize,
    /// Why the others are not, in words.
    left_out: String,
    best: Vec<JudgedDesign>,
    front: Vec<JudgedDesign>,
    compared: Vec<JudgedDesign>,
    sensitivities: Vec<Sensitivity>,
    /// Of the first [`RIVALS`] of the best.
    worst_cases: Vec<WorstCase>,
}

/// Tolerances of a file as the library takes them.
fn tolerances(section: &TolerancesSection) -> Tolerances {
    Tolerances {
        light_nm: section.light_nm,
        filter_nm: section.filter_nm,
        angle_deg: section.angle_deg,
        effective_index: section.effective_index,
    }
}

pub(super) fn judged(space: &DesignSpace, name: String, design: Design) -> JudgedDesign {
    let merits = space.evaluate(&design);
    let fluorescence = space.filtered_fluorescence(&design);
    JudgedDesign { name, design, merits, fluorescence }
}

/// The designs of the file to compare with.
pub(super) fn compared(problem: &Problem) -> Vec<JudgedDesign> {
    let of = |compared: &fluorspar_experiment::ComparedDesign| {
        judged(&problem.space, compared.name.clone(), compared.design.clone())
    };
    problem.resolved.compared.iter().map(of).collect()
}

impl Outcome {
    pub(super) fn of(problem: &Problem, found: Found) -> Result<Self, CliError> {
        let space = &problem.space;
        let scores: Vec<Score> = found.scores.iter().map(|(_, score)| *score).collect();
        let mut ranked: Vec<usize> = (0..scores.len()).filter(|&k| scores[k].loss.is_finite()).collect();
        ranked.sort_by(|&a, &b| scores[a].loss.total_cmp(&scores[b].loss).then(a.cmp(&b)));
        let judge = |&place: &usize| {
            let design = space.design(found.scores[place].0);
            judged(space, space.describe(&design), design)
        };
        let keep = problem.resolved.search.keep as usize;
        let best: Vec<JudgedDesign> = ranked.iter().take(keep).map(judge).collect();
        let front: Vec<JudgedDesign> = pareto_front(&scores).iter().take(keep).map(judge).collect();
        let rivals: Vec<Design> = best.iter().take(RIVALS).map(|judged| judged.design.clone()).collect();
        let failed = |error: fluorspar::design::DesignError| CliError::Input(error.to_string());
        let tolerances = tolerances(&problem.resolved.tolerance);
        let within = |design: &Design| worst_case(space.problem(), design, &tolerances).map_err(failed);
        let worst_cases = rivals.iter().map(within).collect::<Result<Vec<_>, _>>()?;
        Ok(Self {
            feasible: ranked.len(),
            left_out: left_out(space, &found.scores),
            best,
            front,
            compared: compared(problem),
            sensitivities: sensitivities(space.problem(), &rivals).map_err(failed)?,
            worst_cases,
            found,
        })
    }

    /// Writes the folder and tells what is in it.
    pub(super) fn write(
        self,
        problem: &Problem,
        folder: OutputFolder,
        answer: &Answer,
    ) -> Result<(), CliError> {
        let json = self.as_json(problem);
        let put = |name: &str, bytes: &[u8]| {
            write_atomically(&folder.path().join(Path::new(name)), |file| file.write_all(bytes))
                .map_err(|error| folder.at_its_place(error))
        };
        put("results.json", serde_json::to_string_pretty(&json)?.as_bytes())?;
        put("designs.csv", table_csv(&problem.space, &self.best).as_bytes())?;
        let lines: Vec<String> =
            self.best.iter().map(|judged| design_json(&problem.space, judged).to_string() + "\n").collect();
        put("designs.jsonl", lines.concat().as_bytes())?;
        put("report.html", self.with_findings(problem, design_report).to_html().as_bytes())?;
        for (stem, figure) in self.with_findings(problem, design_figures) {
            put(&format!("{stem}.svg"), figure.to_svg().as_bytes())?;
            put(&format!("{stem}.png"), &figure.to_png()?)?;
        }
        let place = folder.finish()?;
        if answer.json {
            print_json(&json)?;
        } else {
            print_text(&self.describe(problem))?;
        }
        Messages::default().status(format!("Open {}", place.join("report.html").display()));
        Ok(())
    }

    fn as_json(&self, problem: &Problem) -> Value {
        let space = &problem.space;
        let all =
            |list: &[JudgedDesign]| -> Vec<Value> { list.iter().map(|d| design_json(space, d)).collect() };
        json!({
            "format": FileFormat::RESULTS.version(),
            "provenance": provenance(problem),
            "search": self.found.search,
            "designs": space.len(),
            "evaluated": self.found.scores.len(),
            "feasible": self.feasible,
            "left_out": (!self.left_out.is_empty()).then_some(&self.left_out),
            "criterion": criterion_text(space),
            "best": all(&self.best),
            "pareto_front": all(&self.front),
            "compared": all(&self.compared),
            "sensitivity": self.sensitivities,
            "worst_case": self.worst_cases.first(),
            "worst_cases": self.worst_cases,
        })
    }

    fn describe(&self, problem: &Problem) -> String {
        let space = &problem.space;
        let mut text = format!(
            "{}\n\n{} designs, {} evaluated ({}), {} feasible\n",
            title(problem),
            space.len(),
            self.found.scores.len(),
            self.found.search,
            self.feasible
        );
        if !self.left_out.is_empty() && !self.best.is_empty() {
            text += &format!("{}\n", self.left_out);
        }
        if !self.best.is_empty() {
            text += &format!("ranked by {}\n", criterion_text(space));
        }
        for sentence in self.with_findings(problem, recommendation) {
            text += &format!("{sentence}\n");
        }
        text += &remarks(space);
        if !self.best.is_empty() {
            text.push('\n');
            text += &table(space, self.best.iter().take(SHOWN), &self.worst_cases);
            text += &format!("{}\n", legend(space, self.best.first()));
            if self.best.len().min(SHOWN) > self.worst_cases.len() {
                text += &format!(
                    "Tolerances are tried for the {} best; - of the others\n",
                    self.worst_cases.len()
                );
            }
            if self.best.len() > SHOWN {
                text += &format!("{} more in designs.csv\n", self.best.len() - SHOWN);
            }
        }
        text += match problem.resolved.names_compared {
            true => "\ncompared\n",
            false => "\ncompared with what the file names first\n",
        };
        text += &table(space, self.compared.iter(), &[]);
        if let (Some(best), Some(worst)) = (self.best.first(), self.worst_cases.first()) {
            let broken = match &worst.broken[..] {
                [] => String::new(),
                broken => format!(", and breaks the limit of {}", broken.join(", ")),
            };
            text += &format!(
                "\nwithin tolerances {}, the best as meant, has a loss of {} (as meant {}), a leak of {} %{broken}\n",
                best.name,
                short(worst.loss),
                short(best.merits.loss),
                short(100.0 * worst.leak)
            );
        }
        for sensitivity in self.sensitivities.iter().take(5) {
            text += &format!(
                "a quarter more of {}: loss {:+.1} %, a quarter less {:+.1} %{}\n",
                sensitivity.assumption,
                100.0 * sensitivity.loss_change,
                100.0 * sensitivity.loss_change_of_less,
                if sensitivity.other_best {
                    "; another design is then the best, one way or the other"
                } else {
                    ""
                }
            );
        }
        text
    }

    /// What the page and its figures are made of.
    fn with_findings<T>(&self, problem: &Problem, make: impl FnOnce(&DesignFindings<'_>) -> T) -> T {
        let record = &problem.resolved.record;
        make(&DesignFindings {
            title: &title(problem),
            description: &record.description,
            criterion: &criterion_text(&problem.space),
            search: &self.found.search,
            action: self.found.action,
            space: &problem.space,
            scores: &self.found.scores,
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

fn title(problem: &Problem) -> String {
    let record = &problem.resolved.record;
    if record.title.is_empty() { problem.source.stem.clone() } else { record.title.clone() }
}

pub(super) fn provenance(problem: &Problem) -> Value {
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
pub(super) fn criterion_text(space: &DesignSpace) -> String {
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
        "regions": regions,
    })
}

fn finite(value: f64) -> Value {
    if value.is_finite() { json!(value) } else { Value::Null }
}

/// What the numbers rest on, a line each: that nothing is unknown, and, where the leak counts, what is assumed of ideal edges.
pub(super) fn remarks(space: &DesignSpace) -> String {
    let p = space.problem();
    let is_mixed = p.filters.iter().any(|filter| filter.long_pass.is_none());
    let counts = p.criterion == Criterion::Leak || p.limits.leak.is_some() || is_mixed;
    let edges = ideal_edges(p).filter(|_| counts);
    best_case(p).into_iter().chain(edges).map(|remark| remark + "\n").collect()
}

/// What the columns of [`table`] mean.
pub(super) fn legend(space: &DesignSpace, first: Option<&JudgedDesign>) -> String {
    let values =
        |k: usize| first.and_then(|judged| *judged.merits.regions.first()?.contrast_values.get(k)?);
    let of_contrast = |(k, name): (usize, &str)| {
        let value = values(k).map_or_else(String::new, |value| format!(" of a value of {}", short(value)));
        format!("; {name}: its standard deviation{value}")
    };
    let names = space.problem().contrasts.iter().map(|contrast| contrast.name.as_str());
    let of_contrasts: String = names.enumerate().map(of_contrast).collect();
    let ratios = match space.problem().contrasts.is_empty() {
        true => "",
        // `predict` tells another one
        false => {
            "\nSuch a ratio is one of the light that fluorophores send from 500 to 700 nm under 405 nm, of plain surfaces one of their \
             concentrations; the ratio of amounts of `predict` is another"
        }
    };
    format!(
        "A fluorophore's column is the relative standard deviation of its weight{of_contrasts}; fluorescence e-: the sum over the channels, one pixel each, \
         reflected light left out; kept: what the viewing filter lets pass of them; leak: reflected over fluorescent electrons; tissue margin: limit \
         over exposure of the tissue{ratios}"
    )
}

/// A table for people: loss, each weight of the first region, electrons of fluorescence, time, leak, and the worst loss within tolerances of
/// those for which it is known.
pub(super) fn table<'a>(
    space: &DesignSpace,
    designs: impl Iterator<Item = &'a JudgedDesign>,
    worst: &[WorstCase],
) -> String {
    let p = space.problem();
    let first = p.regions_of(0).next().map_or(&[][..], |region| &region.response.fluorescence);
    let names = first.iter().map(|f| f.name.clone());
    let head = ["design".to_owned(), "loss".into()].into_iter().chain(names);
    let contrasts = p.contrasts.iter().map(|c| c.name.clone());
    let tail = ["fluorescence e-", "kept", "ms", "leak", "tissue margin"].into_iter();
    let tail = tail.chain((!worst.is_empty()).then_some("loss within tolerances")).chain([""]);
    let mut rows: Vec<Vec<String>> = vec![head.chain(contrasts).chain(tail.map(String::from)).collect()];
    for (place, judged) in designs.enumerate() {
        let merits = &judged.merits;
        let number = |value: f64| if value.is_finite() { short(value) } else { "not seen".into() };
        let region = &merits.regions[0];
        let mut row = vec![judged.name.clone(), number(merits.loss)];
        row.extend(region.weights.iter().chain(&region.contrasts).map(|sd| number(*sd)));
        let kept = judged.fluorescence.as_ref();
        let kept = kept.map_or_else(|| "-".into(), |of| format!("{:.1} %", 100.0 * of.kept));
        let leak = format!("{} %", short(100.0 * merits.leak));
        row.extend([short(merits.fluorescence_e), kept, short(merits.time_s * 1e3), leak]);
        row.push(merits.tissue_margin.map_or_else(|| "-".into(), short));
        if !worst.is_empty() {
            row.push(worst.get(place).map_or_else(|| "-".into(), |worst| number(worst.loss)));
        }
        let singular = region.rank < region.weights.len();
        let made = worst.get(place).map_or(&[][..], |worst| &worst.broken);
        let note = match (&merits.broken[..], singular) {
            ([], false) if !made.is_empty() => format!("breaks {} within tolerances", made.join(", ")),
            ([], false) => String::new(),
            ([], true) => format!("singular: {} of {} seen", region.rank, region.weights.len()),
            (broken, _) => format!("breaks {}", broken.join(", ")),
        };
        row.push(note);
        rows.push(row);
    }
    let last = rows[0].len() - 1;
    align(&rows, &[last])
}

/// The best designs as a table of a spreadsheet; weights and contrasts by region.
fn table_csv(space: &DesignSpace, designs: &[JudgedDesign]) -> String {
    let p = space.problem();
    let mut head: Vec<String> =
        ["number", "lights", "view_filter", "sensor", "f_number", "drive", "geometry", "loss"]
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
    let mut lines = vec![csv_line(&head)];
    for judged in designs {
        let (design, merits) = (&judged.design, &judged.merits);
        let lights: Vec<&str> = design.lights.iter().map(|&k| p.lights[k].name.as_str()).collect();
        let number = |value: f64| if value.is_finite() { format!("{value}") } else { String::new() };
        let mut row = vec![
            space.number(design).map_or_else(String::new, |number| number.to_string()),
            lights.join(" + "),
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
        lines.push(csv_line(&row));
    }
    lines.concat()
}

fn csv_line(cells: &[String]) -> String {
    cells.iter().map(|cell| csv_cell(cell)).collect::<Vec<_>>().join(",") + "\n"
}
