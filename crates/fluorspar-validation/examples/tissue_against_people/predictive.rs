//! A person fitted under one lamp, or two, and predicted under another.

use std::sync::Arc;

use fluorspar::sampling::Z_95;
use fluorspar::spectral::Fluorophore;
use fluorspar::tissue::fit::{Fit, MeasuredFluorescence, MeasuredReflectance, TissueFit};
use fluorspar::tissue::{DiscreteOrdinates, Population};
use fluorspar_experiment::preset;
use fluorspar_report::figures::PlotCurve;

use crate::catalogue;
use crate::figures::Overlay;
use crate::reference::{
    DAYS, Fallible, LAMPS, Lamp, Measured, NORM, Reference, Shape, counts, median, wavelengths,
};

/// Error of shapes, relative: what fits of people leave, and predictions add.
const SHAPE_ERROR: f64 = 0.05;
/// Standard deviation of the logarithm of levels: spot and distance differ between records.
const LEVEL: f64 = 0.3;
/// Wavelengths up to which porphyrin hardly counts, nm.
const GREEN_NM: f64 = 610.0;

fn find(name: &str) -> Option<Arc<Fluorophore>> {
    catalogue(name)
}

fn fit(prior: &Population) -> TissueFit<'_> {
    TissueFit { prior, find: &find, solver: DiscreteOrdinates::DIFFUSE }
}

fn record(lamp: &Lamp, place: &str, (shape, level): &(Shape, f64)) -> MeasuredFluorescence {
    let kept: Vec<(f64, f64)> = wavelengths()
        .into_iter()
        .zip(shape)
        .filter(|(nm, _)| counts(place, lamp.name, *nm))
        .map(|(nm, v)| (nm, v * level))
        .collect();
    MeasuredFluorescence {
        name: format!("{place} under {} nm", lamp.name),
        viewing: lamp.viewing.clone(),
        wavelengths_nm: kept.iter().map(|(nm, _)| *nm).collect(),
        values: kept.iter().map(|(_, v)| *v).collect(),
        relative_error: SHAPE_ERROR,
        scale_uncertainty: LEVEL,
    }
}

/// A place of the mouth in all people.
struct Place<'a> {
    name: &'a str,
    site: &'a str,
    lamps: &'a [Lamp],
    measured: Vec<Measured>,
}

/// Relative errors over 500 to 700 nm and over 500 to 610 nm.
type Errors = [f64; 2];

impl Place<'_> {
    /// Root mean square of (predicted - measured) / measured.
    fn errors(&self, lamp: usize, predicted: &[f64], measured: &[f64]) -> Errors {
        [700.0, GREEN_NM].map(|last| {
            let squares: Vec<f64> = wavelengths()
                .iter()
                .enumerate()
                .filter(|(_, nm)| **nm <= last && counts(self.name, LAMPS[lamp], **nm))
                .map(|(i, _)| (predicted[i] / measured[i] - 1.0).powi(2))
                .collect();
            (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
        })
    }

    /// The population of the other three: their medians under all lamps, and their reflectance.
    fn population_without(&self, person: &str, reference: &Reference) -> Fallible<Population> {
        let prior = Population::of(&preset::site(self.site)?).widened(2.0);
        let others = |name: &str| name != person;
        let records: Vec<MeasuredFluorescence> = self
            .lamps
            .iter()
            .zip(&self.measured)
            .map(|(lamp, m)| record(lamp, self.name, &m.votes(others)))
            .collect();
        let known = |name: &&str| self.name == "tongue" || *name != "S1";
        let files: Vec<String> = DAYS
            .iter()
            .map(|(name, _)| *name)
            .filter(|name| others(name))
            .filter(known)
            .map(|name| format!("oe_{}_{}.csv", name.to_lowercase(), self.name))
            .collect();
        let nm: Vec<f64> = (0..=31).map(|i| 400.0 + 10.0 * f64::from(i)).collect();
        let values = reference.mean_reflectance(&files, &nm)?;
        let white =
            MeasuredReflectance { name: "reflectance".into(), wavelengths_nm: nm, values, error: 0.015 };
        let found = fit(&prior).fit(&[white], &records)?;
        Ok(Population::of(&found.site))
    }

    fn person_fit(&self, prior: &Population, person: &str, lamps: &[usize]) -> Fallible<Fit> {
        let records: Vec<MeasuredFluorescence> = lamps
            .iter()
            .filter_map(|&l| Some(record(&self.lamps[l], self.name, &self.measured[l].person(person)?)))
            .collect();
        Ok(fit(prior).fit(&[], &records)?)
    }
}

/// One prediction.
struct Outcome {
    from: Vec<usize>,
    to: usize,
    model: Errors,
    unchanged: Errors,
    ratio: Errors,
    unseen: Errors,
    /// Share of the wavelengths whose measured value lies within the interval of 95 %.
    held: f64,
}

/// What is known of a person: measured shapes by lamp, those of the others, and the prior that the others give.
struct Person<'a> {
    name: &'static str,
    place: &'a Place<'a>,
    prior: Population,
    shapes: Vec<Shape>,
    others: Vec<Shape>,
}

impl<'a> Person<'a> {
    fn new(name: &'static str, place: &'a Place<'a>, reference: &Reference) -> Fallible<Self> {
        let own = place.measured.iter().filter_map(|m| m.person(name)).map(|(shape, _)| shape);
        let others = place.measured.iter().map(|m| m.votes(|other| other != name).0);
        let prior = place.population_without(name, reference)?;
        Ok(Self { name, place, prior, shapes: own.collect(), others: others.collect() })
    }

    /// Mean of a baseline over the lamps that were seen.
    fn mean(&self, from: &[usize], of: impl Fn(usize, usize) -> f64) -> Shape {
        let at = |i| from.iter().map(|&f| of(f, i)).sum::<f64>() / from.len() as f64;
        (0..wavelengths().len()).map(at).collect()
    }

    /// Predicted ratios to 520 nm with the half widths of their intervals of 95 %.
    fn predicted(&self, fitted: &Fit, to: usize) -> Fallible<Vec<(f64, f64)>> {
        let predicted = fit(&self.prior).predict(fitted, &self.place.lamps[to].viewing, &wavelengths())?;
        let widened = |(value, sd): (f64, f64)| (value, Z_95 * sd.hypot(SHAPE_ERROR * value));
        Ok(predicted.shape(NORM).into_iter().map(widened).collect())
    }

    fn outcome(&self, from: &[usize], to: usize, predicted: &[(f64, f64)]) -> Outcome {
        let measured = &self.shapes[to];
        let errors = |shape: &[f64]| self.place.errors(to, shape, measured);
        let model: Shape = predicted.iter().map(|(value, _)| *value).collect();
        let inside = |((value, half), measured): (&(f64, f64), &f64)| (measured - value).abs() <= *half;
        let held = predicted.iter().zip(measured).filter(|pair| inside(*pair)).count();
        let ratio = |f: usize, i: usize| self.shapes[f][i] * self.others[to][i] / self.others[f][i];
        Outcome {
            from: from.to_vec(),
            to,
            model: errors(&model),
            unchanged: errors(&self.mean(from, |f, i| self.shapes[f][i])),
            ratio: errors(&self.mean(from, ratio)),
            unseen: errors(&self.others[to]),
            held: held as f64 / predicted.len() as f64,
        }
    }

    fn overlay(&self, from: usize, to: usize, predicted: &[(f64, f64)]) -> Overlay {
        let model = predicted.iter().map(|(value, _)| *value).collect();
        let [seen, asked] = [from, to].map(|lamp| LAMPS[lamp]);
        Overlay {
            title: format!("{} of {}, {seen} to {asked} nm", self.place.name, self.name),
            measured: self.shapes[to].clone(),
            range: Vec::new(),
            models: vec![
                PlotCurve::new("predicted", wavelengths(), model),
                PlotCurve::new("shape unchanged", wavelengths(), self.shapes[from].clone()),
            ],
            band: predicted.iter().map(|(value, half)| [value - half, value + half]).collect(),
        }
    }
}

/// Fits everyone under one lamp and under two, and predicts the others; prints the porphyrin that each fit found.
fn outcomes(place: &Place<'_>, reference: &Reference, overlays: &mut Vec<Overlay>) -> Fallible<Vec<Outcome>> {
    let mut found = Vec::new();
    for (name, _) in DAYS {
        let person = Person::new(name, place, reference)?;
        let mut porphyrin = Vec::new();
        for from in [vec![0], vec![1], vec![2], vec![0, 1], vec![0, 2], vec![1, 2], vec![0, 1, 2]] {
            let fitted = place.person_fit(&person.prior, name, &from)?;
            let amount = fitted.parameters.iter().find(|p| p.name == "biofilm_porphyrin_per_mm");
            if let Some(p) = amount.filter(|_| from.len() != 2) {
                let [low, high] = p.interval_95.map(|end| 1e3 * end);
                porphyrin.push(format!("{:.2} ({low:.2} to {high:.2})", 1e3 * p.value));
            }
            for to in (0..LAMPS.len()).filter(|to| !from.contains(to)) {
                let predicted = person.predicted(&fitted, to)?;
                found.push(person.outcome(&from, to, &predicted));
                if from == [0] && to == 2 {
                    overlays.push(person.overlay(0, 2, &predicted));
                }
            }
        }
        if !porphyrin.is_empty() {
            println!(
                "  porphyrin of the biofilm of {name}, 1e-3/mm, fitted under 405, 415, 450 nm, all: {}",
                porphyrin.join(", ")
            );
        }
    }
    Ok(found)
}

/// Predicts everyone at one place; prints medians over people, in percent.
pub(crate) fn predictive(reference: &Reference, site: &str, name: &str) -> Fallible<Vec<Overlay>> {
    let lamps = &reference.lamps;
    let measured = lamps.iter().map(|lamp| reference.measured(name, lamp)).collect();
    let place = Place { name, site, lamps, measured };
    let mut overlays = Vec::new();
    println!(
        "{name}: predicted spectra, relative rms in percent, medians of people; 500 to 700 nm (500 to 610 nm)"
    );
    let outcomes = outcomes(&place, reference, &mut overlays)?;
    println!("  from > to           model        unchanged    x ratio      others' median  within interval");
    let line = |label: &str, chosen: &dyn Fn(&Outcome) -> bool| {
        let chosen: Vec<&Outcome> = outcomes.iter().filter(|outcome| chosen(outcome)).collect();
        let cell = |errors: &dyn Fn(&Outcome) -> Errors| {
            let at = |i: usize| 100.0 * median(chosen.iter().map(|outcome| errors(outcome)[i]).collect());
            format!("{:4.1} ({:4.1})", at(0), at(1))
        };
        let held = chosen.iter().map(|outcome| outcome.held).sum::<f64>() / chosen.len() as f64;
        println!(
            "  {label:<18}  {}  {}  {}  {}     {:.0} %",
            cell(&|o| o.model),
            cell(&|o| o.unchanged),
            cell(&|o| o.ratio),
            cell(&|o| o.unseen),
            100.0 * held
        );
    };
    for (from, to) in [(0, 1), (0, 2), (1, 2), (1, 0), (2, 0), (2, 1)] {
        line(&format!("{} > {}", LAMPS[from], LAMPS[to]), &|o| o.from == [from] && o.to == to);
    }
    line("one light > other", &|o| o.from.len() == 1);
    line("two lights > third", &|o| o.from.len() == 2);
    Ok(overlays)
}
