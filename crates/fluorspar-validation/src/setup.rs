//! What the cases run on: the camera as a flat sample, the mouth, and measured data of others.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use fluorspar::image::ComponentImage;
use fluorspar::pipeline::{PipelineError, PredictError};
use fluorspar::render::{RenderControl, RenderError, render};
use fluorspar::sensor::{Sensor, SensorProblem};
use fluorspar::spectral::{Curve, Fluorophore};
use fluorspar::study::{FlatSample, Study};
use fluorspar_experiment::preset::{self, PresetError, PresetKind};
use fluorspar_experiment::{DEFAULT_SAMPLE, ExperimentError, parse, parse_sample, resolve};
use fluorspar_format::{FormatError, NamedCurve, Negative, SpectrumOptions, read_spectra};
use thiserror::Error;

/// The experiment whose mouth the cases render: surface materials, as in the paper.
pub(super) const MOUTH: &str = "oraleye-2021-surface";
/// Name of the porphyrin.
pub(super) const PORPHYRIN: &str = "protoporphyrin_ix";
/// The four other fluorophores of the paper.
pub(super) const BULK: [&str; 4] = ["nadh", "fad", "elastin", "collagen"];

/// Why a validation can't be run. A check that does not hold is no error.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ValidationError {
    /// The flat sample or the mouth.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// The catalogue.
    #[error(transparent)]
    Preset(#[from] PresetError),
    /// The prediction of the flat sample.
    #[error(transparent)]
    Predict(#[from] PredictError),
    /// The sensor of the flat sample.
    #[error(transparent)]
    Sensor(#[from] SensorProblem),
    /// Frames of the mouth.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// The render of the mouth.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A file of measured data.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// The flat sample has no such part.
    #[error(
        "the flat sample has no {0}, which the case compares with the paper; take back the change that removed it"
    )]
    Lacks(&'static str),
    /// The work was stopped.
    #[error("interrupted: some cases were not run, and nothing was written")]
    Interrupted,
}

/// What the cases run on.
#[derive(Clone, Copy, Debug)]
pub struct Setup<'a> {
    /// Changes of the flat sample that describes the camera, `path=value`.
    pub changes: &'a [String],
    /// Folder of measured data of others; cases that need them are skipped without it.
    pub reference: Option<&'a Path>,
    /// Set to stop the work.
    pub stop: &'a AtomicBool,
}

impl Setup<'_> {
    /// The flat sample with the user's changes and those of a case.
    pub(super) fn sample(&self, changes: &[&str]) -> Result<FlatSample, ValidationError> {
        if self.stop.load(Ordering::Relaxed) {
            return Err(ValidationError::Interrupted);
        }
        let all: Vec<String> =
            self.changes.iter().cloned().chain(changes.iter().map(|change| (*change).to_owned())).collect();
        let text = preset::text(PresetKind::Sample, DEFAULT_SAMPLE)?;
        Ok(parse_sample(text, DEFAULT_SAMPLE, Path::new("."), &all)?.sample)
    }

    /// The flat sample with other fluorophores, without reflected light.
    pub(super) fn glowing(&self, amounts: &[(&str, f64)]) -> Result<FlatSample, ValidationError> {
        let mut sample = self.sample(&[])?;
        sample.reflectance = Curve::constant(0.0);
        sample.fluorophores = amounts
            .iter()
            .map(|&(name, amount)| Ok((fluorophore(name)?, amount)))
            .collect::<Result<_, PresetError>>()?;
        Ok(sample)
    }

    /// The mouth with some changes, `path=value`.
    pub(super) fn mouth(&self, changes: &[String]) -> Result<Study, ValidationError> {
        let text = preset::text(PresetKind::Experiment, MOUTH)?;
        Ok(resolve(&parse(text, MOUTH, Path::new("."), changes)?)?.study)
    }

    /// Renders a mouth.
    pub(super) fn render(&self, study: &Study) -> Result<ComponentImage, ValidationError> {
        let control = RenderControl { stop: self.stop, progress: &|_| {} };
        let image = render(&study.scene, &study.render, &control)?;
        if self.stop.load(Ordering::Relaxed) { Err(ValidationError::Interrupted) } else { Ok(image) }
    }

    /// Measured spectra of a file below the folder of data; `None` without the folder or the file. Negative values are kept.
    pub(super) fn measured(&self, file: &str) -> Result<Option<Vec<NamedCurve>>, ValidationError> {
        let Some(path) = self.reference_file(file) else { return Ok(None) };
        let options = SpectrumOptions {
            negative: Negative::Keep,
            skip_empty_cells: true,
            ..SpectrumOptions::default()
        };
        Ok(Some(read_spectra(&path, &options)?.curves))
    }

    /// A file below the folder of data, if it is there.
    pub(super) fn reference_file(&self, file: &str) -> Option<PathBuf> {
        self.reference.map(|folder| folder.join(file)).filter(|path| path.is_file())
    }
}

/// A fluorophore of the catalogue at unit concentration.
pub(super) fn fluorophore(name: &str) -> Result<Fluorophore, PresetError> {
    Ok(preset::fluorophore(name)?.fluorophore())
}

/// The sensor of a sample.
pub(super) fn sensor(sample: &FlatSample) -> Result<&Sensor, ValidationError> {
    sample.camera.sensor.as_ref().ok_or(ValidationError::Lacks("sensor"))
}

/// Samples of a curve for a figure.
pub(super) fn plotted(
    name: &str,
    curve: &Curve,
    [first, last]: [f64; 2],
) -> fluorspar_report::figures::PlotCurve {
    let nm: Vec<f64> = (0..=(last - first) as usize).map(|i| first + i as f64).collect();
    let values = nm.iter().map(|&nm| curve.at(nm)).collect();
    fluorspar_report::figures::PlotCurve::new(name, nm, values)
}
