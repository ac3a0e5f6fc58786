//! Scenes of pbrt as experiments of one render.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::ValueEnum;
use fluorspar::digest::sha256_hex;
use fluorspar::spectral::WavelengthGrid;
use fluorspar::study::Study;
use fluorspar_experiment::{FileRecord, InputFile, ResolvedExperiment, Warning, parse, resolve};
use fluorspar_pbrt::{Emission, PbrtOptions, PbrtStudy, check_light, load, to_experiment};
use fluorspar_session::{ExperimentArgs, ExperimentSource, ResourceLimits};

use crate::error::CliError;
use crate::values::{Override, as_typed, sets};

/// Lines of an error that names what has no counterpart.
const MOST_LINES: usize = 50;

/// Heading of the options for scenes of pbrt.
const PBRT: &str = "Scenes of pbrt";

/// How a scene of pbrt (.pbrt) is taken.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct PbrtArgs {
    /// Length of one unit of the scene; the file does not say it [default: m].
    #[arg(help_heading = PBRT, long, value_enum)]
    unit: Option<Unit>,
    /// Refuse a scene with anything that has no counterpart, instead of warnings.
    #[arg(help_heading = PBRT, long)]
    strict: bool,
    /// What the spectra of lights mean in version 4, where they are given wavelength by wavelength [default: absolute].
    #[arg(help_heading = PBRT, long, value_enum, value_name = "MEANING")]
    light_spectra: Option<LightSpectra>,
    /// Bands of the render: first and last middle and step, nm [default: 350:750:5].
    #[arg(help_heading = PBRT, long, value_name = "FIRST:LAST:STEP")]
    bands: Option<Bands>,
    /// Let rough metals and glass lose the light that they scatter more than once, as pbrt does.
    #[arg(help_heading = PBRT, long)]
    single_scattering: bool,
}

/// A unit of length.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Unit {
    /// Meters.
    M,
    /// Centimeters.
    Cm,
    /// Millimeters.
    Mm,
}

/// What spectra of lights mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum LightSpectra {
    /// Radiance, W/(sr m² nm), as they stand; W/(sr nm) of points, W/(m² nm) of distant lights.
    Absolute,
    /// Shapes, each scaled to one nit as pbrt-v4 does.
    Photometric,
}

/// Bands of equal width.
#[derive(Clone, Debug)]
struct Bands(WavelengthGrid);

impl FromStr for Bands {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<f64> = text.split(':').map_while(|part| part.parse().ok()).collect();
        let [first, last, step] = numbers[..] else {
            return Err("must be FIRST:LAST:STEP, nm, for instance 365:705:5".into());
        };
        WavelengthGrid::uniform(first, last, step).map(Self).map_err(|error| error.to_string())
    }
}

impl PbrtArgs {
    /// The first option that is given.
    fn given(&self) -> Option<&'static str> {
        let options = [
            ("--unit", self.unit.is_some()),
            ("--strict", self.strict),
            ("--light-spectra", self.light_spectra.is_some()),
            ("--bands", self.bands.is_some()),
            ("--single-scattering", self.single_scattering),
        ];
        options.into_iter().find_map(|(name, is_given)| is_given.then_some(name))
    }

    /// Refuses options of scenes of pbrt where there is none.
    pub(crate) fn check_none(&self, name: &str) -> Result<(), CliError> {
        match self.given() {
            None => Ok(()),
            Some(option) => {
                Err(CliError::Input(format!("{option} is for scenes of pbrt; {name} is not one")))
            }
        }
    }

    fn options(&self) -> PbrtOptions {
        PbrtOptions {
            unit_m: [1.0, 0.01, 0.001][self.unit.unwrap_or(Unit::M) as usize],
            emission: match self.light_spectra {
                Some(LightSpectra::Photometric) => Emission::Photometric,
                _ => Emission::Absolute,
            },
            grid: self.bands.as_ref().map_or_else(WavelengthGrid::default, |bands| bands.0.clone()),
            single_scattering: self.single_scattering,
        }
    }

    /// Reads a scene, and what is to be said about it.
    pub(crate) fn load(&self, path: &Path) -> Result<(PbrtStudy, Vec<Warning>), CliError> {
        let loaded = load(path, &self.options())?;
        self.check_strict(&loaded)?;
        let warnings = self.warnings(&loaded);
        Ok((loaded, warnings))
    }

    /// Resolves an experiment of any kind.
    pub(crate) fn resolve(
        &self,
        source: &ExperimentSource,
        args: &ExperimentArgs,
        limits: &ResourceLimits,
    ) -> Result<ResolvedExperiment, CliError> {
        if let Some(path) = source.pbrt_scene() {
            return self.scene(path, source, args, limits);
        }
        self.check_none(&source.name)?;
        let time_limit = limits.overrides().into_iter();
        source.resolve(&args.overrides().into_iter().chain(time_limit).collect::<Vec<_>>())
    }

    fn scene(
        &self,
        path: &Path,
        source: &ExperimentSource,
        args: &ExperimentArgs,
        limits: &ResourceLimits,
    ) -> Result<ResolvedExperiment, CliError> {
        if args.render.error.is_some() {
            return Err(CliError::Input(
                "--error is for experiment files; of a scene of pbrt --set, --spp, --seed, --depth and --statistics change \
                 something"
                    .into(),
            ));
        }
        let (loaded, warnings) = self.load(path)?;
        let changed = match args.changes.overrides().as_slice() {
            [] => None,
            changes => Some(changed_study(&loaded, source, changes)?),
        };
        let PbrtStudy { study, files, .. } = loaded;
        let mut study = changed.unwrap_or(study);
        check_light(&study.scene)
            .map_err(|problem| CliError::Input(format!("{}: {problem}", path.display())))?;
        study.time_limit_s = limits.time_limit;
        let render = &mut study.render;
        render.samples_per_pixel = args.render.spp.unwrap_or(render.samples_per_pixel);
        render.seed = args.render.seed.seed.unwrap_or(render.seed);
        render.max_depth = args.render.depth.unwrap_or(render.max_depth);
        render.statistics = args.render.statistics.unwrap_or_default();
        let mut resolved = resolved_text(&files, &self.options());
        for change in &args.changes.set {
            resolved.push_str(&format!("# --set {change:?}\n"));
        }
        let inputs = files.into_iter().map(|(path, sha256)| InputFile { path, sha256 }).collect();
        let record = FileRecord {
            title: source.stem.clone(),
            description: String::new(),
            output_folder: None,
            warnings,
            inputs,
            base_files: Vec::new(),
            sha256: sha256_hex([&resolved]),
            resolved_toml: resolved,
            experiment: None,
        };
        Ok(ResolvedExperiment { study, record })
    }

    fn check_strict(&self, loaded: &PbrtStudy) -> Result<(), CliError> {
        let lines: Vec<&str> = shown(loaded).filter(|(_, matters)| *matters).map(|(line, _)| line).collect();
        if !self.strict || lines.is_empty() {
            return Ok(());
        }
        let rest = lines.len().saturating_sub(MOST_LINES);
        let more = if rest > 0 { format!("\n  and {rest} more") } else { String::new() };
        Err(CliError::Input(format!(
            "--strict: the scene has {} thing{} without counterpart; change it, or leave --strict out:\n  {}{more}",
            lines.len(),
            if lines.len() == 1 { "" } else { "s" },
            lines[..lines.len() - rest].join("\n  ")
        )))
    }

    /// What has no counterpart, line by line; what does not show is counted.
    fn warnings(&self, loaded: &PbrtStudy) -> Vec<Warning> {
        let mut list = Vec::new();
        if self.unit.is_none() {
            let text = "one unit of the scene is taken as 1 m; if it is not, give --unit cm or --unit mm";
            list.push(Warning::from(text.to_string()));
        }
        for (line, matters) in shown(loaded) {
            list.push(match matters {
                true => Warning::from(line.to_string()),
                false => Warning::summarized(line, "the scene says what has no effect here"),
            });
        }
        let scene = loaded.study.scene.warnings();
        list.extend(scene.iter().map(|warning| Warning::summarized(warning.to_string(), warning.summary())));
        list
    }
}

/// A scene with changes: as an experiment, whose files are written for a moment.
pub(crate) fn changed_study(
    loaded: &PbrtStudy,
    source: &ExperimentSource,
    changes: &[Override],
) -> Result<Study, CliError> {
    let no_room =
        |error: std::io::Error| CliError::Failed(format!("can't write a temporary folder: {error}"));
    let folder = tempfile::tempdir().map_err(no_room)?;
    let converted = to_experiment(loaded, &source.stem, ".").map_err(CliError::Input)?;
    converted.write_files(folder.path())?;
    let parsed = parse(&converted.text, &source.name, folder.path(), &sets(changes));
    let resolved = parsed.and_then(|parsed| resolve(&parsed)).map_err(|error| as_typed(error, changes))?;
    Ok(resolved.study)
}

/// Lines of what has no counterpart, and whether it may show.
fn shown(loaded: &PbrtStudy) -> impl Iterator<Item = (&str, bool)> {
    loaded.messages.iter().zip(&loaded.remarks).map(|(line, remark)| (line.as_str(), remark.matters))
}

/// What stands for the experiment in the image: comments, as TOML has no scenes of pbrt.
fn resolved_text(files: &[(PathBuf, String)], options: &PbrtOptions) -> String {
    let mut text = format!(
        "# A scene of pbrt, one unit {} m, spectra of lights {:?}; `fluorspar render` reads it.\n",
        options.unit_m, options.emission
    );
    for (path, sha256) in files {
        text.push_str(&format!("# sha256 {sha256} {:?}\n", path.display().to_string()));
    }
    text
}
