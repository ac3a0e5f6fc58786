//! The filters in front of the sensor: one that stays, and those of a wheel, which each capture has for itself.

use fluorspar::spectral::{Curve, CurveModel};
use fluorspar::study::{Capture, Study};
use fluorspar_experiment::preset;
use fluorspar_experiment::schema::{ExperimentFile, SpectrumReference};

/// What captures with light are seen through.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ViewFilters {
    /// Frames that are seen through it, in words; empty where all are, through a filter that stays.
    pub(super) frames: String,
    /// The filter that stays, times that of the captures.
    pub(super) transmittance: Curve,
    /// Whether there is a filter at all.
    pub(super) is_filtered: bool,
}

impl ViewFilters {
    /// All filters of a study, those of equal captures once. Without a wheel one alone.
    pub(super) fn of(study: &Study) -> Vec<Self> {
        let fixed = &study.camera.view_filter.transmittance;
        let is_fixed = (200..=1200).any(|nm| (fixed.at(f64::from(nm)) - 1.0).abs() > 1e-9);
        if study.captures.iter().all(|capture| capture.filter.is_none()) {
            let (frames, transmittance) = (String::new(), fixed.clone());
            return vec![Self { frames, transmittance, is_filtered: is_fixed }];
        }
        let has_light = |capture: &&Capture| capture.frame.lights.values().any(|&drive| drive > 0.0);
        let mut found: Vec<(&Option<Curve>, Vec<String>)> = Vec::new();
        for capture in study.captures.iter().filter(has_light) {
            let name = format!("\"{}\"", capture.frame.label);
            match found.iter_mut().find(|(filter, _)| **filter == capture.filter) {
                Some((_, names)) => names.push(name),
                None => found.push((&capture.filter, vec![name])),
            }
        }
        let of = |(filter, names): (&Option<Curve>, Vec<String>)| {
            let noun = if names.len() == 1 { "frame" } else { "frames" };
            Self {
                frames: format!("{noun} {}", names.join(", ")),
                transmittance: filter.as_ref().map_or_else(|| fixed.clone(), |filter| fixed.times(filter)),
                is_filtered: is_fixed || filter.is_some(),
            }
        };
        found.into_iter().map(of).collect()
    }

    /// Its name in figures.
    pub(super) fn name(&self) -> String {
        if self.frames.is_empty() { "in front of the lens".into() } else { self.frames.clone() }
    }
}

/// What the frame of a name is seen through.
pub(super) fn view_filter_of(study: &Study, frame: Option<&str>) -> Curve {
    let fixed = &study.camera.view_filter.transmittance;
    let own = frame.and_then(|frame| study.capture(frame)).and_then(|capture| capture.filter.as_ref());
    own.map_or_else(|| fixed.clone(), |own| fixed.times(own))
}

/// Where a filter passes at least half of its maximum.
pub(super) fn view_band(filter: &Curve, range: (f64, f64)) -> Option<[f64; 2]> {
    let nodes: Vec<f64> = (0..=(range.1 - range.0) as usize).map(|i| range.0 + i as f64).collect();
    let peak = nodes.iter().map(|&nm| filter.at(nm)).fold(0.0, f64::max);
    let passed: Vec<f64> = nodes.into_iter().filter(|&nm| filter.at(nm) >= 0.5 * peak).collect();
    let (first, last) = (*passed.first()?, *passed.last()?);
    (last - first < range.1 - range.0 - 2.0).then_some([first, last])
}

/// Filters in front of the sensor.
fn viewing(file: &ExperimentFile) -> impl Iterator<Item = &SpectrumReference> {
    file.view_filter.filters.iter().chain(file.capture.iter().flat_map(|capture| &capture.filters))
}

/// Filters on the lights.
fn on_lights(file: &ExperimentFile) -> impl Iterator<Item = &SpectrumReference> {
    file.light.iter().flat_map(|light| &light.filters)
}

/// Those of some filters that are of the catalogue and whose blocking is assumed, by its optical density.
fn assumed_densities<'f>(filters: impl Iterator<Item = &'f SpectrumReference>) -> Vec<(f64, Vec<&'f str>)> {
    let mut densities: Vec<(f64, Vec<&str>)> = Vec::new();
    for reference in filters {
        let SpectrumReference::Text(name) = reference else { continue };
        let name = name.as_str();
        let Ok(filter) = preset::filter(name) else { continue };
        let CurveModel::Edges { optical_density, .. } = filter.model else { continue };
        if !filter.assumed.iter().any(|field| field == "curve") {
            continue;
        }
        match densities.iter_mut().find(|(known, _)| *known == optical_density) {
            Some((_, names)) if names.contains(&name) => {}
            Some((_, names)) => names.push(name),
            None => densities.push((optical_density, vec![name])),
        }
    }
    densities.sort_by(|a, b| a.0.total_cmp(&b.0));
    densities
}

/// How well the filters of the catalogue block, where that is assumed, in a short sentence without their names.
pub(super) fn assumed_blocking_in_short(file: &ExperimentFile) -> Option<String> {
    let range = |who: &str, densities: Vec<(f64, Vec<&str>)>| {
        let (least, most) = (densities.first()?.0, densities.last()?.0);
        let to = if least < most { format!(" to {most}") } else { String::new() };
        Some(format!("{who} {least}{to}"))
    };
    let of_viewing = range("viewing filters", assumed_densities(viewing(file)));
    let of_lights = range("filters on the lights", assumed_densities(on_lights(file)));
    let both: Vec<String> = of_viewing.into_iter().chain(of_lights).collect();
    (!both.is_empty()).then(|| format!("Assumed optical density of blocking: {}.", both.join(", ")))
}

/// How well the filters of the catalogue block, where that is assumed, in a sentence: what leaks goes with it.
pub(super) fn assumed_blocking(file: &ExperimentFile) -> Option<String> {
    let densities = assumed_densities(viewing(file).chain(on_lights(file))).into_iter();
    let each: Vec<String> =
        densities.map(|(density, names)| format!("{density} ({})", names.join(", "))).collect();
    (!each.is_empty()).then(|| {
        format!(
            "The blocking of these filters is assumed, and the leak depends on it: optical density {}.",
            each.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use fluorspar_experiment::{parse, resolve};

    use super::*;

    const WHEEL: &str = r#"
format = 1
base = "flat-patch"
unset = ["view_filter", "analysis", "capture.blue"]
[[capture]]
name = "green_band"
light_groups = { blue = 1.0 }
filters = ["band_pass_525_45"]
exposure_ms = 2.0
[[capture]]
name = "red_band"
light_groups = { blue = 1.0 }
filters = ["band_pass_635_50"]
exposure_ms = 2.0
[[capture]]
name = "open"
light_groups = { blue = 1.0 }
exposure_ms = 2.0
"#;

    #[test]
    fn each_frame_of_a_wheel_is_seen_through_its_own_filter() {
        let experiment = resolve(&parse(WHEEL, "wheel", Path::new("."), &[]).unwrap()).unwrap();
        let found = ViewFilters::of(&experiment.study);
        let named = |name: &str| found.iter().find(|of| of.name().contains(name)).unwrap();
        assert!(named("green_band").is_filtered && !named("open").is_filtered, "{found:?}");
        for (name, passed_nm, blocked_nm) in [("green_band", 525.0, 635.0), ("red_band", 635.0, 525.0)] {
            let curve = &named(name).transmittance;
            assert!(curve.at(passed_nm) > 0.9 && curve.at(blocked_nm) < 1e-4, "{name}");
            let same = view_filter_of(&experiment.study, Some(name));
            assert_eq!(same.at(passed_nm), curve.at(passed_nm));
        }
        let file = experiment.record.experiment.as_deref().unwrap();
        let said = assumed_blocking(file).unwrap();
        assert!(said.contains("optical density 5 (band_pass_525_45, band_pass_635_50"), "{said}");
        // The first screen has no room for their names
        let short = assumed_blocking_in_short(file).unwrap();
        assert!(short.contains("viewing filters 5") && !short.contains("band_pass"), "{short}");
        // Those of lights are told apart
        let mut stated = file.clone();
        stated.light[0].filters = viewing(file).cloned().collect();
        stated.capture.iter_mut().for_each(|capture| capture.filters.clear());
        let short = assumed_blocking_in_short(&stated).unwrap();
        assert!(short.contains("filters on the lights") && !short.contains("viewing"), "{short}");
    }

    #[test]
    fn a_filter_that_stays_is_told_once() {
        let study =
            resolve(&parse("format = 1\nbase = \"flat-patch\"", "patch", Path::new("."), &[]).unwrap());
        let found = ViewFilters::of(&study.unwrap().study);
        assert!(found.len() == 1 && found[0].name() == "in front of the lens", "{found:?}");
    }
}
