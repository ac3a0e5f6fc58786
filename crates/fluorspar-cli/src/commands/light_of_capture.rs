//! Under which light the components of a render are summed: that of one capture.

use std::path::Path;

use fluorspar::image::Component;
use fluorspar::sensor::CaptureFrame;
use fluorspar::study::Study;
use fluorspar::units::number_text;
use fluorspar_experiment::{Experiment, parse};
use fluorspar_format::Provenance;
use serde_json::{Value, json};

use crate::error::CliError;
use crate::message::Messages;

/// How an image has all lights.
pub(crate) const APART: &str = ", all lights apart: --components";

/// The capture whose light an image has.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct CaptureOption {
    /// Capture whose light groups are on, at its drives, in an image without --components, in the preview, or in a scene of another program
    /// [default: the experiment's first capture with light; without captures all light groups, at the stated power].
    #[arg(long, value_name = "NAME")]
    capture: Option<String>,
}

impl CaptureOption {
    /// The light of a study.
    pub(crate) fn of_study(&self, study: &Study) -> Result<CaptureLight, CliError> {
        let frames: Vec<&CaptureFrame> = study.captures.iter().map(|capture| &capture.frame).collect();
        let lights = frames.iter().map(|frame| (frame.label.as_str(), frame.lights.iter().collect()));
        self.of(&lights.collect::<Vec<_>>())
    }

    /// Refuses the option where all lights are kept. `why` says so.
    pub(crate) fn check_none(&self, why: &str) -> Result<(), CliError> {
        match &self.capture {
            None => Ok(()),
            Some(name) => Err(CliError::Input(format!("--capture {name}: {why}; leave the option out"))),
        }
    }

    /// The light of the experiment that a film was rendered from.
    pub(crate) fn of_film(&self, provenance: &Provenance) -> Result<CaptureLight, CliError> {
        let experiment = experiment_of_film(provenance)?;
        let captures = experiment.iter().flat_map(|experiment| &experiment.file.capture);
        let lights = captures.map(|capture| (capture.name.as_str(), capture.light_groups.iter().collect()));
        self.of(&lights.collect::<Vec<_>>())
    }

    fn of(&self, captures: &[Lights<'_>]) -> Result<CaptureLight, CliError> {
        let is_lit = |(_, lights): &&Lights<'_>| lights.iter().any(|(_, drive)| **drive > 0.0);
        let known: Vec<&str> = captures.iter().map(|(name, _)| *name).collect();
        let chosen = match &self.capture {
            None => captures.iter().find(is_lit).or(captures.first()),
            Some(wanted) => {
                let found = captures.iter().find(|(name, _)| name == wanted);
                Some(found.ok_or_else(|| {
                    CliError::Input(match known.is_empty() {
                        true => format!(
                            "--capture {wanted}: the experiment has no captures; leave the option out"
                        ),
                        false => format!(
                            "--capture {wanted}: there is no such capture; the captures are {}",
                            known.join(", ")
                        ),
                    })
                })?)
            }
        };
        let on = chosen.map(|(name, lights)| {
            let lights = lights.iter().filter(|(_, drive)| **drive > 0.0);
            (name.to_string(), lights.map(|(group, drive)| (group.to_string(), **drive)).collect())
        });
        let known = known.into_iter().map(String::from).collect();
        Ok(CaptureLight { on, known, is_typed: self.capture.is_some() })
    }
}

/// The experiment that a film was rendered from; `None` of a scene of pbrt, of which films hold comments alone.
pub(crate) fn experiment_of_film(provenance: &Provenance) -> Result<Option<Experiment>, CliError> {
    let text = &provenance.resolved_experiment_toml;
    let is_empty = text.lines().all(|line| line.is_empty() || line.starts_with('#'));
    Ok((!is_empty).then(|| parse(text, "the film's experiment", Path::new("."), &[])).transpose()?)
}

/// A capture and the drives of its light groups.
type Lights<'a> = (&'a str, Vec<(&'a String, &'a f64)>);

/// The light of one capture; all light groups at their stated power where there are no captures.
#[derive(Clone, Debug, Default)]
pub(crate) struct CaptureLight {
    /// The capture, and the light groups that are on in it with their drives.
    on: Option<(String, Vec<(String, f64)>)>,
    /// Names of all captures.
    known: Vec<String>,
    /// Whether the capture was asked for.
    is_typed: bool,
}

impl CaptureLight {
    /// What a component counts in the sum.
    pub(crate) fn weight(&self, component: &Component) -> f64 {
        self.drive(&component.light_group)
    }

    /// Drive of a light group.
    pub(crate) fn drive(&self, light_group: &str) -> f64 {
        let Some((_, lights)) = &self.on else { return 1.0 };
        lights.iter().find(|(group, _)| group == light_group).map_or(0.0, |(_, drive)| *drive)
    }

    /// Refuses the choice of a light for files that hold every light apart.
    pub(crate) fn check_sums(&self, sums: bool) -> Result<(), CliError> {
        if self.is_typed && !sums {
            return Err(CliError::Input(
                "--capture: with --components every light group stands apart; leave one of the two out"
                    .into(),
            ));
        }
        Ok(())
    }

    /// Says which lights are on. `apart` is how all of them are had.
    pub(crate) fn say(&self, messages: Messages, apart: &str) {
        let Some((name, lights)) = &self.on else { return };
        let one = |(group, drive): &(String, f64)| match *drive {
            1.0 => format!("\"{group}\""),
            drive => format!("\"{group}\" x {}", number_text(drive)),
        };
        let lights: Vec<String> = lights.iter().map(one).collect();
        let lights = if lights.is_empty() {
            "no light".into()
        } else {
            format!("light group {}", lights.join(" and "))
        };
        let others: Vec<&str> = self.known.iter().map(String::as_str).filter(|other| other != name).collect();
        let others = match others.is_empty() {
            true => String::new(),
            false => format!("; others: --capture {}{apart}", others.join(" or ")),
        };
        messages.status(format!("Light of the capture \"{name}\": {lights}{others}"));
    }

    /// The capture as JSON, null where there is none.
    pub(crate) fn json(&self) -> Value {
        let Some((name, lights)) = &self.on else { return Value::Null };
        let drives: serde_json::Map<String, Value> =
            lights.iter().map(|(group, drive)| (group.clone(), json!(drive))).collect();
        json!({ "name": name, "light_groups": drives })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_experiment_of_a_film_that_cannot_be_read_is_an_error_and_a_scene_of_pbrt_has_none() {
        let found = |text: &str| experiment_of_film(&Provenance::new("", text, 1, 1));
        assert!(found("# A scene of pbrt, one unit 1 m\n# sha256 0 \"a.pbrt\"\n").unwrap().is_none());
        assert!(found("format = 1\nbase = \"flat-patch\"\n").unwrap().is_some());
        let said = found("format = 7\nbase = \"flat-patch\"\n").unwrap_err().to_string();
        assert!(said.contains("the film's experiment:1: format: the file has format 7"), "{said}");
    }
}
