//! What ran, in words: lights by wavelength, filters, scene, the fluorophore that is looked for.

use fluorspar::analysis::Analyte;
use fluorspar::spectral::Curve;
use fluorspar::study::Capture;
use fluorspar_experiment::ResolvedExperiment;
use fluorspar_experiment::schema::{EfficiencyReference, ExperimentFile, LightSection, SpectrumReference};

use super::view_filters::view_band;
use super::{FrameOrigin, RunResults};

/// Lights whose half maximum is wider are called by what they cover, not by a peak, nm.
const NARROW_LIGHT_NM: f64 = 80.0;
/// Objects that are named one by one.
const MOST_OBJECTS: usize = 4;

/// What stands for the lights of a capture that switches none on.
pub(super) const NO_LIGHT: &str = "no light";

/// The words of one run.
pub(super) struct Words<'a> {
    experiment: &'a ResolvedExperiment,
    file: Option<&'a ExperimentFile>,
}

impl<'a> Words<'a> {
    pub(super) fn of(experiment: &'a ResolvedExperiment) -> Self {
        Self { experiment, file: experiment.record.experiment.as_deref() }
    }

    /// Whether the scene is a parametric mouth.
    pub(super) fn is_mouth(&self) -> bool {
        self.file.is_some_and(|file| file.mouth.is_some())
    }

    /// The scene: a mouth, or its objects by name.
    pub(super) fn scene(&self) -> String {
        let objects = &self.experiment.study.scene.objects;
        let name = |name: &str| name.replace('_', " ");
        let listed = match objects.as_slice() {
            [] => "an empty scene".into(),
            [one] => name(&one.name),
            several if several.len() <= MOST_OBJECTS => {
                several.iter().map(|object| name(&object.name)).collect::<Vec<_>>().join(", ")
            }
            many => format!("{} objects", many.len()),
        };
        if self.is_mouth() { format!("a mouth of {} parts", objects.len()) } else { listed }
    }

    /// The lights of a capture: their spectra and the names that the experiment gives these.
    pub(super) fn lights(&self, capture: &Capture) -> String {
        let scene = &self.experiment.study.scene;
        let mut texts: Vec<String> = Vec::new();
        for light in &scene.lights {
            let group = &scene.light_groups[light.group].name;
            if capture.frame.drive(group) == 0.0 {
                continue;
            }
            let spectrum = spectrum_words(&light.spectrum);
            let text = match self.light_section(group).map(|section| &section.spectrum) {
                Some(SpectrumReference::Text(name)) => format!("{spectrum} ({})", file_name(name.as_str())),
                _ => spectrum,
            };
            if !texts.contains(&text) {
                texts.push(text);
            }
        }
        for object in &scene.objects {
            if let Some(emission) = &object.emission {
                let group = &scene.light_groups[emission.group].name;
                if capture.frame.drive(group) != 0.0 {
                    texts.push(format!("{} that shines", object.name.replace('_', " ")));
                }
            }
        }
        if texts.is_empty() { NO_LIGHT.into() } else { texts.join(" and ") }
    }

    /// The section of the first light of a group.
    fn light_section(&self, group: &str) -> Option<&LightSection> {
        self.file?.light.iter().find(|light| light.group.as_deref().unwrap_or(&light.name) == group)
    }

    /// Power of the emitters of each group as the experiment states it, and how the captures drive them:
    /// `"blue" 8 x 2000 mW, driven at 2 times that in frame "blue"`.
    pub(super) fn powers(&self) -> Vec<String> {
        let groups = self.experiment.study.scene.light_groups.iter();
        let power = |group: &str| {
            let emitter = &self.light_section(group)?.emitter;
            let mw = emitter.power_mw()?;
            let stated = match emitter.count() {
                1 => format!("\"{group}\" {mw} mW"),
                count => format!("\"{group}\" {count} x {mw} mW"),
            };
            Some(stated + &self.drive(group))
        };
        groups.filter_map(|group| power(&group.name)).collect()
    }

    /// How captures drive a light group where that is not its stated power.
    fn drive(&self, group: &str) -> String {
        let captures = &self.experiment.study.captures;
        let of = |capture: &Capture| (capture.frame.drive(group), capture.frame.label.clone());
        let driven: Vec<(f64, String)> = captures.iter().map(of).filter(|(drive, _)| *drive > 0.0).collect();
        if driven.iter().all(|(drive, _)| *drive == 1.0) {
            return String::new();
        }
        let text = |(drive, label): &(f64, String)| format!("{drive} times that in frame \"{label}\"");
        format!(", driven at {}", driven.iter().map(text).collect::<Vec<_>>().join(" and "))
    }

    /// The name of the quantum efficiency, if the experiment names one.
    pub(super) fn efficiency(&self) -> Option<String> {
        match &self.file?.sensor.as_ref()?.quantum_efficiency {
            EfficiencyReference::Text(name) => Some(file_name(name.as_str()).to_owned()),
            EfficiencyReference::Columns(table) => Some(file_name(table.csv.as_str()).to_owned()),
            EfficiencyReference::Channels(_) => None,
        }
    }

    /// The viewing filter in words; `None` without one.
    pub(super) fn filter(&self) -> Option<String> {
        self.filter_words(&self.experiment.study.camera.view_filter.transmittance)
    }

    /// A filter by what it passes; `None` of one that passes all the same.
    fn filter_words(&self, filter: &Curve) -> Option<String> {
        let study = &self.experiment.study;
        let range = (study.scene.grid.start_nm(), study.scene.grid.end_nm());
        view_band(filter, range).map(|[from, to]| {
            if to >= range.1 - 1.0 {
                format!("a filter that passes from {from:.0} nm on")
            } else if from <= range.0 + 1.0 {
                format!("a filter that passes up to {to:.0} nm")
            } else {
                format!("a filter that passes {from:.0} to {to:.0} nm")
            }
        })
    }

    /// The fluorophore whose share is estimated; `None` where no share is asked for.
    pub(super) fn wanted(&self) -> Option<Analyte> {
        let study = &self.experiment.study;
        let plan = study.analysis.as_ref().filter(|plan| plan.porphyrin.is_some())?;
        Some(study.analyte(plan))
    }

    /// The same in texts that stand only where a share is asked for.
    pub(super) fn target(&self) -> Analyte {
        self.wanted().unwrap_or_default()
    }

    /// The sentences under the title: what was recorded, by what.
    pub(super) fn lead(&self, run: &RunResults<'_>) -> Vec<String> {
        let study = &self.experiment.study;
        let is_there = |capture: &Capture| {
            let label = &capture.frame.label;
            run.frames_from == FrameOrigin::Simulated
                || run.evaluation.frames.iter().any(|frame| frame.raw.label == *label)
        };
        let lit =
            study.captures.iter().filter(|capture| is_there(capture) && self.lights(capture) != NO_LIGHT);
        let wheel = study.captures.iter().any(|capture| is_there(capture) && capture.filter.is_some());
        let frames: Vec<String> = lit
            .map(|capture| {
                // Doubled drives are light that the stated power does not tell
                let drives: Vec<f64> =
                    capture.frame.lights.values().copied().filter(|drive| *drive > 0.0).collect();
                let drive = match drives.as_slice() {
                    [only] if *only != 1.0 => format!(" at {only} times its stated power"),
                    several if several.iter().any(|drive| *drive != 1.0) => {
                        let texts: Vec<String> = several.iter().map(f64::to_string).collect();
                        format!(" at {} times their stated powers", texts.join(" and "))
                    }
                    _ => String::new(),
                };
                let own = match &capture.filter {
                    Some(filter) => self.filter_words(filter).map(|own| format!(" through {own}")),
                    // Beside frames of a wheel one without a filter is told
                    None if wheel => Some(" without a filter of its own".into()),
                    None => None,
                };
                let (lights, own) = (self.lights(capture), own.unwrap_or_default());
                format!("\"{}\" under {lights}{drive}{own}", capture.frame.label)
            })
            .collect();
        let sensor = study.camera.sensor.as_ref().map(|sensor| {
            let model = sensor.model();
            let channels: Vec<&str> = sensor.qe().channels().iter().map(|c| c.name.as_str()).collect();
            format!("by a sensor of {} x {} pixels ({})", model.columns, model.rows, channels.join(", "))
        });
        let filter = self.filter().map(|filter| format!("through {filter}"));
        let seen: Vec<String> = filter.into_iter().chain(sensor).collect();
        let what = match run.frames_from {
            FrameOrigin::Simulated => format!("Simulated: {}", self.scene()),
            FrameOrigin::Given => {
                "Recorded frames, analyzed with the lights, filters and camera that the experiment assumes"
                    .into()
            }
        };
        let mut sentence = what;
        if !frames.is_empty() {
            sentence +=
                &format!("; {} {}", if frames.len() == 1 { "frame" } else { "frames" }, frames.join(", "));
        }
        if !seen.is_empty() {
            sentence += &format!("; seen {}", seen.join(", "));
        }
        vec![sentence + "."]
    }
}

/// A spectrum by its peak and width, or by its range.
fn spectrum_words(spectrum: &Curve) -> String {
    let peak = spectrum.peak_nm();
    let [from, to] = half_maximum(spectrum);
    let white = spectrum.integral(480.0, 650.0) > 0.3 * spectrum.total();
    if to - from > NARROW_LIGHT_NM || white {
        let kind = if white { "white light" } else { "broad light" };
        return format!("{kind} around {:.0} nm", centroid(spectrum));
    }
    format!("light of {peak:.0} nm, {:.0} nm wide", to - from)
}

fn centroid(spectrum: &Curve) -> f64 {
    let (from, to) = spectrum.range_nm();
    let (mut sum, mut moment) = (0.0, 0.0);
    let mut nm = from.max(200.0);
    while nm <= to.min(1200.0) {
        sum += spectrum.at(nm);
        moment += nm * spectrum.at(nm);
        nm += 1.0;
    }
    if sum > 0.0 { moment / sum } else { spectrum.peak_nm() }
}

/// Where a spectrum falls to half of its peak on both sides of it, nm.
fn half_maximum(spectrum: &Curve) -> [f64; 2] {
    let (peak, half) = (spectrum.peak_nm(), 0.5 * spectrum.max());
    let reach = |step: f64| {
        let mut nm = peak;
        while spectrum.at(nm) > half && (nm - peak).abs() < 500.0 {
            nm += step;
        }
        nm
    };
    [reach(-0.5), reach(0.5)]
}

/// The last part of a path; a name of the catalogue as it is.
fn file_name(name: &str) -> &str {
    name.rsplit(['/', '\\']).next().unwrap_or(name)
}

/// With a capital letter.
pub(crate) fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use fluorspar_experiment::preset;

    #[test]
    fn lights_are_called_by_what_they_are() {
        let words = |name: &str| spectrum_words(&preset::light_spectrum(name).unwrap().curve());
        assert!(words("led_405").starts_with("light of 40"), "{}", words("led_405"));
        assert!(words("white_led").starts_with("white light"), "{}", words("white_led"));
    }
}
