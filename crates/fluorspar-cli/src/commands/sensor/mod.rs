//! `fluorspar sensor`: measure sensors.

mod characterize;
mod list;
mod show;

pub(crate) use list::run as list;
pub(crate) use show::{Options as ShowOptions, run as show};

use std::path::{Path, PathBuf};

use clap::ValueHint;
use fluorspar::names::did_you_mean;
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{ResolvedSensor, parse_sensor};
use fluorspar_session::{Changes, read_text};

use crate::commands::subcommands::subcommands;
use crate::error::CliError;
use crate::message::Messages;
use crate::values::{Override, as_typed, sets};

subcommands! {
    /// Characterize a sensor with simulated flats and darks as in EMVA 1288, and draw its photon-transfer curve.
    Characterize(characterize::Options) => characterize::run,
}

/// Which sensor.
#[derive(Clone, Debug, clap::Args)]
struct SensorArgs {
    /// Sensor file (.toml with a [sensor] section; or an experiment), or the name of a built-in sensor.
    #[arg(value_name = "SENSOR", value_hint = ValueHint::FilePath)]
    sensor: String,
    #[command(flatten)]
    changes: Changes,
}

impl SensorArgs {
    /// Reads the sensor and prints its warnings.
    fn resolve(&self, messages: Messages) -> Result<ResolvedSensor, CliError> {
        let (name, path) = (self.sensor.as_str(), Path::new(&self.sensor));
        let overrides = self.changes.overrides();
        let resolved = if self.is_file() {
            let base_dir = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
            parse_sensor(&read_text(path)?, name, base_dir, &sets(&overrides))
                .map_err(|error| as_typed(error, &overrides))?
        } else {
            let known = preset::names(PresetKind::Sensor);
            if !known.contains(&name) {
                let hint = did_you_mean(name, known.iter().copied());
                return Err(CliError::Input(format!(
                    "there is no sensor \"{name}\"{hint} Known: {}. A file ends in .toml",
                    known.join(", ")
                )));
            }
            of_catalogue(name, &overrides)?
        };
        messages.warnings(&resolved.warnings);
        Ok(resolved)
    }

    fn is_file(&self) -> bool {
        let path = Path::new(&self.sensor);
        path.extension().is_some() || self.sensor.contains(['/', '\\']) || path.exists()
    }

    /// Every file that the sensor was read from.
    fn files(&self, resolved: &ResolvedSensor) -> Vec<PathBuf> {
        let own = self.is_file().then(|| PathBuf::from(&self.sensor));
        own.into_iter().chain(resolved.inputs.iter().cloned()).collect()
    }

    /// A name for files: of the preset, or of the file without its ending.
    fn stem(&self) -> String {
        let stem = Path::new(&self.sensor).file_stem();
        stem.map_or_else(|| "sensor".into(), |stem| stem.to_string_lossy().into_owned())
    }
}

/// A sensor of the catalogue with changes.
fn of_catalogue(name: &str, overrides: &[Override]) -> Result<ResolvedSensor, CliError> {
    // Written by the serializer: a title may hold quotation marks.
    let title = toml::Value::String(preset::sensor(name)?.title);
    let text = format!("format = 1\ntitle = {title}\n[sensor]\npreset = \"{name}\"\n");
    Ok(parse_sensor(&text, &format!("built-in {name}"), Path::new("."), &sets(overrides))
        .map_err(|error| as_typed(error, overrides))?)
}
