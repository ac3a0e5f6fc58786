//! Regions beside that of `[analysis]`: `--named-region NAME=WHERE`.

use std::path::Path;

use fluorspar::pipeline::{AnalyzedFrame, CapturedFrame, SeenComponents, analyze_seen};
use fluorspar_experiment::{Experiment, ResolvedExperiment, resolve};

use crate::error::CliError;
use crate::experiment_source::ExperimentSource;
use crate::values::{Override, as_typed};

/// A region as it was typed.
#[derive(Clone, Debug)]
pub(super) struct RegionOption {
    pub(super) name: String,
    /// `--named-region` with its value.
    typed: String,
    /// Fields of `[analysis]` and their values.
    fields: Vec<(String, String)>,
}

/// Fields that tell where the region of `[analysis]` lies: not those of another region.
const PLACE: [&str; 4] = ["rectangle_px", "polygon_px", "mask", "compared_px"];
/// Fields that tell what it is made of: not those of other parts.
const CONTENT: [&str; 2] = ["bulk", "tissue"];

/// Reads the regions of the command line.
pub(super) fn region_options(texts: &[String]) -> Result<Vec<RegionOption>, CliError> {
    let mut regions: Vec<RegionOption> = Vec::with_capacity(texts.len());
    for text in texts {
        let region = region_option(text)?;
        if regions.iter().any(|other| other.name == region.name) {
            let name = &region.name;
            return Err(CliError::Input(format!(
                "--named-region {text}: there are two regions \"{name}\"; rename one"
            )));
        }
        regions.push(region);
    }
    Ok(regions)
}

fn region_option(text: &str) -> Result<RegionOption, CliError> {
    let wrong = |why: &str| {
        CliError::Input(format!(
            "--named-region {text}: {why}; write a name and parts, a rectangle (column, row, width, height), a polygon, a mask or fields of [analysis]: \
             lip=lower_lip, lip=430,350,100,80, 'lip=[[430,350],[530,350],[480,450]]', lip=mask.png, 'lip={{parts=[\"lower_lip\"], inset_px=3}}'"
        ))
    };
    let (name, place) = text.split_once('=').ok_or_else(|| wrong("there is no ="))?;
    let (name, place) = (name.trim(), place.trim());
    if name.is_empty() || place.is_empty() {
        return Err(wrong("a name or a place is missing"));
    }
    let quoted = |part: &str| super::quoted(part.trim());
    let is_mask = |path: &Path| {
        let ending = path.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase);
        ending.is_some_and(|ending| ["png", "tif", "tiff", "npy"].contains(&ending.as_str()))
    };
    let words: Vec<&str> = place.split(',').collect();
    let is_number = |word: &&str| word.trim().parse::<f64>().is_ok();
    let fields = if place.starts_with('{') {
        fields_of_table(place).ok_or_else(|| wrong("this is no table of TOML"))?
    } else if place.starts_with("[[") {
        vec![("polygon_px".into(), place.into())]
    } else if place.starts_with('[') {
        vec![("rectangle_px".into(), place.into())]
    } else if words.iter().all(is_number) {
        vec![("rectangle_px".into(), format!("[{place}]"))]
    } else if is_mask(Path::new(place)) {
        vec![("mask".into(), quoted(place))]
    } else {
        let parts: Vec<String> = words.iter().map(|word| quoted(word)).collect();
        vec![("parts".into(), format!("[{}]", parts.join(", ")))]
    };
    if let Some((field, _)) = fields.iter().find(|(field, _)| field == "frame" || field == "compared_px") {
        return Err(wrong(&format!("{field} is of the whole analysis, not of a region")));
    }
    Ok(RegionOption { name: name.into(), typed: format!("--named-region {text}"), fields })
}

/// The fields of an inline table.
fn fields_of_table(text: &str) -> Option<Vec<(String, String)>> {
    let table: toml::Table = format!("region = {text}").parse().ok()?;
    let fields = table.get("region")?.as_table()?;
    Some(fields.iter().map(|(field, value)| (field.clone(), value.to_string())).collect())
}

impl RegionOption {
    /// What this region changes in an experiment, after other changes.
    fn overrides(&self, parsed: &Experiment) -> Vec<Override> {
        let Some(analysis) = &parsed.file.analysis else { return Vec::new() };
        let has_parts = self.fields.iter().any(|(field, _)| field == "parts");
        let place = [
            analysis.rectangle_px.is_some(),
            analysis.polygon_px.is_some(),
            analysis.mask.is_some(),
            analysis.compared_px.is_some(),
        ];
        let content =
            [analysis.bulk.is_some(), analysis.tissue.is_some()].map(|is_there| is_there && has_parts);
        let taken =
            PLACE.iter().zip(place).chain(CONTENT.iter().zip(content)).filter(|(_, is_taken)| *is_taken);
        let mut all: Vec<Override> =
            taken.map(|(field, _)| Override::unset(&format!("analysis.{field}"))).collect();
        let set = |field: &str, value: &str| {
            Override::of_option(&format!("analysis.{field}"), value, self.typed.clone())
        };
        if !has_parts {
            all.push(set("parts", "[]"));
        }
        all.extend(self.fields.iter().map(|(field, value)| set(field, value)));
        all
    }
}

/// What all regions share.
pub(super) struct RegionsOf<'a> {
    pub(super) source: &'a ExperimentSource,
    /// The experiment of the analysis, and its changes.
    pub(super) parsed: &'a Experiment,
    pub(super) overrides: &'a [Override],
    pub(super) frames: &'a [CapturedFrame],
    pub(super) components: Option<&'a SeenComponents<'a>>,
}

impl RegionsOf<'_> {
    /// Analyzes each region as that of `[analysis]`. `adapt` makes an experiment that of the frames.
    pub(super) fn analyzed(
        &self,
        regions: &[RegionOption],
        adapt: impl Fn(&mut ResolvedExperiment),
    ) -> Result<Vec<(String, AnalyzedFrame)>, CliError> {
        let mut analyzed = Vec::with_capacity(regions.len());
        for region in regions {
            let overrides = [self.overrides, &region.overrides(self.parsed)].concat();
            let parsed = self.source.parse(&overrides)?;
            let mut experiment = resolve(&parsed).map_err(|error| as_typed(error, &overrides))?;
            adapt(&mut experiment);
            if let Some(plan) = &mut experiment.study.analysis {
                // Targets are told once, of the whole frame
                plan.targets.clear();
                if let (None, [part, ..]) = (self.components, plan.parts.as_slice()) {
                    return Err(CliError::Input(format!(
                        "{}: the region is the part \"{part}\", but its pixels are known only from the component image; give that of the run with \
                         --component-image, or say where it lies: {}=COLUMN,ROW,WIDTH,HEIGHT",
                        region.typed, region.name
                    )));
                }
            }
            let found = analyze_seen(&experiment.study, self.components, self.frames)
                .map_err(|error| CliError::Input(format!("{}: {error}", region.typed)))?;
            analyzed.extend(found.map(|found| (region.name.clone(), found)));
        }
        Ok(analyzed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_told_by_their_form() {
        let fields = |text: &str| region_option(text).unwrap().fields;
        let one = |field: &str, value: &str| vec![(field.to_owned(), value.to_owned())];
        assert_eq!(fields("lip=lower_lip, upper_lip"), one("parts", "[\"lower_lip\", \"upper_lip\"]"));
        assert_eq!(fields("a=1,2,30,40"), one("rectangle_px", "[1,2,30,40]"));
        assert_eq!(fields("a=[1,2,30,40]"), one("rectangle_px", "[1,2,30,40]"));
        assert_eq!(fields("a=[[1,2],[3,4],[5,0]]"), one("polygon_px", "[[1,2],[3,4],[5,0]]"));
        assert_eq!(fields("a=b/mask.PNG"), one("mask", "\"b/mask.PNG\""));
        assert_eq!(fields("a={parts=[\"x\"], inset_px=3}").len(), 2);
        for text in ["lip", "=lip", "lip=", "a={parts=", "a={frame=\"white\"}"] {
            let error = region_option(text).unwrap_err().to_string();
            assert!(
                error.contains(&format!("--named-region {text}: ")) && error.contains("lip=lower_lip"),
                "{error}"
            );
        }
        assert!(region_options(&["a=b".into(), "a=c".into()]).is_err());
    }
}
