//! From deviations of a population to spectra, with derivatives.

use std::collections::BTreeSet;

use nalgebra::DVector;
use rayon::prelude::*;

use super::{
    CORRELATION_NM, Derivatives, Linearized, MeasuredFluorescence, MeasuredReflectance, TissueFit,
    TissueFitError, Unknowns,
};
use crate::tissue::{EffectiveTissue, LayeredTissue, Level, Population};

/// Step between solutions, nm.
const SOLUTION_STEP_NM: f64 = 5.0;
/// Step of differences, in standard deviations of the prior.
const DIFFERENCE: f64 = 0.05;

/// Spectra of tissues of one population, as they were measured.
pub(super) struct Forward<'a> {
    fit: &'a TissueFit<'a>,
    pub(super) reflectances: &'a [MeasuredReflectance],
    pub(super) fluorescences: &'a [MeasuredFluorescence],
    nodes_nm: Vec<f64>,
    /// Of each variation: whether it changes nothing but strengths of fluorophores.
    only_strengths: Vec<bool>,
}

/// Spectra of one tissue.
struct Spectra {
    /// Of each measured reflectance.
    reflectances: Vec<Vec<f64>>,
    /// Of each measured fluorescence, what leaks.
    leaks: Vec<Vec<f64>>,
    /// Emission of each part under each light, and the variation that holds its strength.
    parts: Vec<(Option<usize>, Vec<Vec<f64>>)>,
}

impl<'a> Forward<'a> {
    pub(super) fn new(
        fit: &'a TissueFit<'a>,
        reflectances: &'a [MeasuredReflectance],
        fluorescences: &'a [MeasuredFluorescence],
    ) -> Result<Self, TissueFitError> {
        let typical = fit.prior.typical();
        let tissue = typical.tissue(fit.find)?;
        let strengths: Vec<&str> = tissue
            .layers
            .iter()
            .flat_map(|layer| layer.fluorophores.iter().map(move |held| (layer, held)))
            .filter_map(|(layer, held)| typical.strength_parameter(&layer.name, &held.fluorophore.name))
            .collect();
        let absent = |name: &str| typical.get(name).is_ok_and(|value| value == 0.0);
        let only_strengths = |variation: &super::super::Variation| {
            variation.parameters.iter().all(|name| strengths.contains(name) || absent(name))
        };
        let only_strengths = fit.prior.variations().iter().map(only_strengths).collect();
        let nodes_nm = nodes(reflectances, fluorescences);
        Ok(Self { fit, reflectances, fluorescences, nodes_nm, only_strengths })
    }

    pub(super) fn prior(&self) -> &Population {
        self.fit.prior
    }

    /// Number of deviations; scales follow them among the unknowns.
    pub(super) fn deviations(&self) -> usize {
        self.only_strengths.len()
    }

    /// Place among the unknowns of the scale of a fluorescence.
    pub(super) fn scale_at(&self, record: usize) -> Option<usize> {
        let free = |records: &[MeasuredFluorescence]| records.iter().filter(|r| r.has_free_scale()).count();
        let before = self.deviations() + free(&self.fluorescences[..record]);
        self.fluorescences[record].has_free_scale().then_some(before)
    }

    fn unknowns(&self) -> usize {
        self.deviations() + self.fluorescences.iter().filter(|record| record.has_free_scale()).count()
    }

    /// The typical tissue, with each free scale at its best.
    pub(super) fn start(&self) -> Result<Unknowns, TissueFitError> {
        let mut start = DVector::zeros(self.unknowns());
        let typical = self.solve(&vec![0.0; self.deviations()])?;
        for (record, measured) in self.fluorescences.iter().enumerate() {
            if let Some(at) = self.scale_at(record) {
                let model = self.total(&typical, start.as_slice(), record);
                let overlap: f64 = model.iter().zip(&measured.values).map(|(m, v)| m * v).sum();
                let square: f64 = model.iter().map(|m| m * m).sum();
                start[at] = (overlap / square).max(1e-30).ln();
            }
        }
        if start.iter().all(|value| value.is_finite()) { Ok(start) } else { Err(TissueFitError::NotFinite) }
    }

    /// The tissue of some deviations, but with typical strengths of fluorophores.
    fn tissue(&self, deviations: &[f64]) -> Result<LayeredTissue, TissueFitError> {
        let optical: Vec<f64> = deviations
            .iter()
            .zip(&self.only_strengths)
            .map(|(deviation, only_strength)| if *only_strength { 0.0 } else { *deviation })
            .collect();
        Ok(self.fit.prior.tissue_at(&optical).tissue(self.fit.find)?)
    }

    fn solve(&self, deviations: &[f64]) -> Result<Spectra, TissueFitError> {
        self.solve_tissue(&self.tissue(deviations)?)
    }

    fn solve_tissue(&self, tissue: &LayeredTissue) -> Result<Spectra, TissueFitError> {
        let prior = self.fit.prior;
        let effective = EffectiveTissue::new(tissue, &self.nodes_nm, self.fit.solver)?;
        let reflectance = effective.reflectance(Level::AboveSurface);
        let reflectances = self
            .reflectances
            .iter()
            .map(|record| record.wavelengths_nm.iter().map(|&nm| reflectance.at(nm)).collect())
            .collect();
        let leak = |record: &MeasuredFluorescence| {
            let seen = |&nm: &f64| reflectance.at(nm) * record.viewing.leaked(nm);
            record.wavelengths_nm.iter().map(seen).collect()
        };
        let parts = effective.parts().into_iter().map(|part| {
            let layer = &tissue.layers[part.layer];
            let held = &layer.fluorophores[part.fluorophore].fluorophore.name;
            let parameter = prior.typical().strength_parameter(&layer.name, held);
            let variation = parameter.and_then(|name| {
                prior.variations().iter().position(|variation| variation.parameters.contains(&name))
            });
            let seen = |record: &MeasuredFluorescence| {
                record.viewing.fluorescence(&effective, part, &record.wavelengths_nm)
            };
            (variation, self.fluorescences.iter().map(seen).collect())
        });
        Ok(Spectra {
            reflectances,
            leaks: self.fluorescences.iter().map(leak).collect(),
            parts: parts.collect(),
        })
    }

    /// Factor on typical strengths.
    fn factor(&self, variation: Option<usize>, deviations: &[f64]) -> f64 {
        variation.map_or(1.0, |v| (deviations[v] * self.fit.prior.variations()[v].standard_deviation()).exp())
    }

    /// A fluorescence of scale 1.
    fn total(&self, spectra: &Spectra, deviations: &[f64], record: usize) -> Vec<f64> {
        let mut total = spectra.leaks[record].clone();
        for (variation, emission) in &spectra.parts {
            let factor = self.factor(*variation, deviations);
            total.iter_mut().zip(&emission[record]).for_each(|(sum, value)| *sum += factor * value);
        }
        total
    }

    /// All spectra one after the other, of scale 1, and their derivatives by the deviations.
    fn spectra(&self, deviations: &[f64]) -> Result<(Vec<f64>, Derivatives), TissueFitError> {
        let joined = |spectra: &Spectra| {
            let fluorescences =
                (0..self.fluorescences.len()).flat_map(|record| self.total(spectra, deviations, record));
            spectra.reflectances.iter().flatten().copied().chain(fluorescences).collect::<Vec<f64>>()
        };
        let here = self.solve(deviations)?;
        let values = joined(&here);
        let moved = |variation: usize| {
            let mut deviations = deviations.to_vec();
            deviations[variation] += DIFFERENCE;
            self.tissue(&deviations)
        };
        let optical: Vec<usize> = (0..self.deviations()).filter(|v| !self.only_strengths[*v]).collect();
        let tissues = optical.iter().map(|v| moved(*v)).collect::<Result<Vec<_>, _>>()?;
        let solved: Vec<Spectra> =
            tissues.par_iter().map(|tissue| self.solve_tissue(tissue)).collect::<Result<_, _>>()?;
        let mut derivatives = Derivatives::zeros(values.len(), self.deviations());
        for (variation, spectra) in optical.iter().zip(&solved) {
            for (i, (after, before)) in joined(spectra).iter().zip(&values).enumerate() {
                derivatives[(i, *variation)] = (after - before) / DIFFERENCE;
            }
        }
        let first = values.len() - self.fluorescences.iter().map(|r| r.values.len()).sum::<usize>();
        for (variation, emission) in &here.parts {
            let Some(v) = variation.filter(|v| self.only_strengths[*v]) else { continue };
            let slope =
                self.factor(*variation, deviations) * self.fit.prior.variations()[v].standard_deviation();
            for (i, value) in emission.iter().flatten().enumerate() {
                derivatives[(first + i, v)] += slope * value;
            }
        }
        Ok((values, derivatives))
    }

    /// One fluorescence of scale 1, and its derivatives by the deviations.
    pub(super) fn spectrum(
        &self,
        deviations: &[f64],
        record: usize,
    ) -> Result<(Vec<f64>, Derivatives), TissueFitError> {
        let (values, derivatives) = self.spectra(deviations)?;
        let before: usize = self.reflectances.iter().map(|r| r.values.len()).sum::<usize>()
            + self.fluorescences[..record].iter().map(|r| r.values.len()).sum::<usize>();
        let number = self.fluorescences[record].values.len();
        Ok((values[before..before + number].to_vec(), derivatives.rows(before, number).into_owned()))
    }

    /// Scale of a fluorescence.
    pub(super) fn scale(&self, unknowns: &Unknowns, record: usize) -> f64 {
        self.scale_at(record).map_or(1.0, |at| unknowns[at].exp())
    }

    /// Spectra in the order of the residuals, each with its scale.
    pub(super) fn scaled(&self, unknowns: &Unknowns) -> Result<Vec<Vec<f64>>, TissueFitError> {
        let deviations = &unknowns.as_slice()[..self.deviations()];
        let spectra = self.solve(deviations)?;
        let fluorescence = |record: usize| {
            let scale = self.scale(unknowns, record);
            self.total(&spectra, deviations, record).into_iter().map(|value| scale * value).collect()
        };
        let fluorescences = (0..self.fluorescences.len()).map(fluorescence);
        Ok(spectra.reflectances.iter().cloned().chain(fluorescences).collect())
    }

    /// Residuals of data and prior, with derivatives.
    pub(super) fn linearize(&self, unknowns: &Unknowns) -> Result<Linearized, TissueFitError> {
        let deviations = &unknowns.as_slice()[..self.deviations()];
        let (values, slopes) = self.spectra(deviations)?;
        let free_scales = self.fluorescences.iter().filter(|r| r.scale_uncertainty.is_finite());
        let priors = self.deviations() + free_scales.filter(|r| r.has_free_scale()).count();
        let mut residuals = Unknowns::zeros(values.len() + priors);
        let mut derivatives = Derivatives::zeros(residuals.len(), self.unknowns());
        let mut row = 0;
        for record in self.reflectances {
            let weight = 1.0 / (record.error * inflation(&record.wavelengths_nm));
            for measured in &record.values {
                residuals[row] = weight * (values[row] - measured);
                derivatives.view_mut((row, 0), (1, self.deviations())).copy_from(&(slopes.row(row) * weight));
                row += 1;
            }
        }
        for (number, record) in self.fluorescences.iter().enumerate() {
            let (scale, at) = (self.scale(unknowns, number), self.scale_at(number));
            let inflation = inflation(&record.wavelengths_nm);
            for (measured, error) in record.values.iter().zip(record.errors()) {
                let weight = 1.0 / (error * inflation);
                residuals[row] = weight * (scale * values[row] - measured);
                let slopes = slopes.row(row) * (weight * scale);
                derivatives.view_mut((row, 0), (1, self.deviations())).copy_from(&slopes);
                if let Some(at) = at {
                    derivatives[(row, at)] = weight * scale * values[row];
                }
                row += 1;
            }
        }
        for v in 0..self.deviations() {
            (residuals[row], derivatives[(row, v)]) = (unknowns[v], 1.0);
            row += 1;
        }
        for (number, record) in self.fluorescences.iter().enumerate() {
            if let Some(at) = self.scale_at(number).filter(|_| record.scale_uncertainty.is_finite()) {
                residuals[row] = unknowns[at] / record.scale_uncertainty;
                derivatives[(row, at)] = 1.0 / record.scale_uncertainty;
                row += 1;
            }
        }
        Ok(Linearized { residuals, derivatives })
    }
}

/// Factor on errors of samples that lie nearer than residuals are independent.
fn inflation(wavelengths_nm: &[f64]) -> f64 {
    let last = wavelengths_nm.len() - 1;
    let step = (wavelengths_nm[last] - wavelengths_nm[0]) / last as f64;
    (CORRELATION_NM / step).max(1.0).sqrt()
}

/// Multiples of the step around everything that is lit or seen.
fn nodes(reflectances: &[MeasuredReflectance], fluorescences: &[MeasuredFluorescence]) -> Vec<f64> {
    let mut numbers = BTreeSet::new();
    let seen = reflectances
        .iter()
        .flat_map(|record| record.wavelengths_nm.clone())
        .chain(fluorescences.iter().flat_map(|record| record.wavelengths_nm.clone()))
        .chain(fluorescences.iter().flat_map(|record| record.viewing.photons()).map(|line| line.0));
    for nm in seen {
        let place = nm / SOLUTION_STEP_NM;
        numbers.extend([place.floor() as u32, place.ceil() as u32]);
    }
    numbers.into_iter().map(|number| SOLUTION_STEP_NM * f64::from(number)).collect()
}
