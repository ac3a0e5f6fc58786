//! The region of a study in all channels of all frames: cameras of one channel behind filters, and of many.

use super::frame_light::frame_light;
use super::region_light::region_electrons;
use super::region_signal::CameraResponse;
use super::targets::noise_of;
use crate::analysis::{
    ChannelSignal, OtherLight, PixelSelection, SceneOnSensor, SignalRatio, SignalSummary, UnmixedTerm,
    Unmixing, UnmixingTerm,
};
use crate::image::LightPath;
use crate::pipeline::PipelineError;
use crate::pipeline::capture::film_irradiance::behind_filter;
use crate::pipeline::capture::{CapturedFrame, SeenComponents};
use crate::render::direct_exitance;
use crate::sensor::Sensor;
use crate::study::{AnalysisPlan, Capture, Study};

/// What is measured, and by what.
#[derive(Clone, Copy)]
pub(super) struct Measured<'a> {
    pub(super) study: &'a Study,
    pub(super) sensor: &'a Sensor,
    pub(super) plan: &'a AnalysisPlan,
    pub(super) frames: &'a [CapturedFrame],
    pub(super) region: &'a PixelSelection,
    pub(super) scene: Option<SceneOnSensor<'a>>,
    pub(super) components: Option<&'a SeenComponents<'a>>,
}

/// Levels, ratios, and fluorophores of a region.
///
/// What is unmixed are the channels of the analyzed frame and of the further ones of the analysis; without these, of all frames under the
/// same lights, as a filter wheel takes them. The fluorophores are those of the bulk one by one and the porphyrin, or the bulk as a whole
/// and the porphyrin, where there are fewer channels or these can't tell them apart.
///
/// # Errors
/// A film that can't be used.
pub(super) fn channel_analysis(measured: &Measured<'_>) -> Result<SignalSummary, PipelineError> {
    let Measured { study, sensor, frames, region, .. } = *measured;
    let mut summary = SignalSummary::default();
    for (frame, capture) in frames.iter().filter_map(|frame| Some((frame, study.capture(&frame.raw.label)?)))
    {
        let same_size = (frame.developed.width, frame.developed.height) == (region.width, region.height);
        if !same_size || lit_groups(capture).is_empty() {
            continue;
        }
        let k = frame.raw.dn_per_electron;
        let noise = noise_of(&frame.developed, &frame.raw, sensor);
        let of_frame = [k, sensor.light_s(frame.raw.exposure_s)];
        summary.signals.extend(ChannelSignal::of_frame(&frame.developed, region, &noise, of_frame));
    }
    let rate = |signal: &ChannelSignal| signal.electrons / signal.exposure_s;
    if let Some(strongest) = summary.signals.iter().max_by(|a, b| rate(a).total_cmp(&rate(b))) {
        let others = summary.signals.iter().filter(|signal| *signal != strongest);
        summary.ratios = others.filter_map(|signal| SignalRatio::new(signal, strongest)).collect();
    }
    summary.unmixing = unmixing(measured, &summary.signals)?;
    Ok(summary)
}

/// Light groups that a capture switches on.
fn lit_groups(capture: &Capture) -> Vec<&str> {
    capture.frame.lights.iter().filter(|(_, drive)| **drive > 0.0).map(|(group, _)| group.as_str()).collect()
}

/// Frames whose channels are taken apart.
fn unmixed_frames<'a>(measured: &Measured<'a>) -> Vec<(&'a CapturedFrame, &'a Capture)> {
    let Measured { study, plan, frames, .. } = *measured;
    let Some(analyzed) = study.capture(&plan.frame) else { return Vec::new() };
    let enters = |label: &str, capture: &Capture| {
        label == plan.frame
            || plan.further_frames.iter().any(|further| further == label)
            || (plan.further_frames.is_empty() && lit_groups(capture) == lit_groups(analyzed))
    };
    let known = frames.iter().filter_map(|frame| Some((frame, study.capture(&frame.raw.label)?)));
    known.filter(|(frame, capture)| enters(&frame.raw.label, capture)).collect()
}

fn unmixing(measured: &Measured<'_>, signals: &[ChannelSignal]) -> Result<Option<Unmixing>, PipelineError> {
    let Measured { plan, .. } = *measured;
    let frames = unmixed_frames(measured);
    let entered = |label: &str| frames.iter().any(|(frame, _)| frame.raw.label == label);
    let signals: Vec<&ChannelSignal> = signals.iter().filter(|signal| entered(&signal.frame)).collect();
    let Some(responses) = responses(measured, &frames, &signals) else { return Ok(None) };
    let find = |name: &str| responses.iter().find(|term| term.fluorophores[0] == name);
    let bulk: Vec<(&UnmixingTerm, f64)> = plan
        .bulk
        .iter()
        .filter(|(name, _)| plan.porphyrin.as_ref() != Some(name))
        .filter_map(|(name, amount)| Some((find(name)?, *amount)))
        .collect();
    let porphyrin = plan.porphyrin.as_deref().and_then(find);
    let apart: Vec<UnmixingTerm> =
        bulk.iter().map(|(term, _)| (*term).clone()).chain(porphyrin.cloned()).collect();
    let whole = (bulk.len() > 1).then(|| UnmixingTerm {
        fluorophores: bulk.iter().flat_map(|(term, _)| term.fluorophores.clone()).collect(),
        electrons: (0..signals.len())
            .map(|i| bulk.iter().map(|(term, a)| a * term.electrons[i]).sum())
            .collect(),
    });
    let together: Vec<UnmixingTerm> = whole.into_iter().chain(porphyrin.cloned()).collect();
    let found = Unmixing::new(&signals, &apart).or_else(|| Unmixing::new(&signals, &together));
    found.map(|unmixing| with_truth(measured, &frames, unmixing)).transpose()
}

/// Electrons that one unit of each fluorophore gives in each signal, under direct light; `None` without light or lens.
fn responses(
    measured: &Measured<'_>,
    frames: &[(&CapturedFrame, &Capture)],
    signals: &[&ChannelSignal],
) -> Option<Vec<UnmixingTerm>> {
    let Measured { study, sensor, plan, region, scene, .. } = *measured;
    let lens = study.camera.lens_behind_filters()?;
    let grid = &study.scene.grid;
    let mut terms: Vec<UnmixingTerm> = plan
        .fluorophores
        .iter()
        .map(|f| UnmixingTerm { fluorophores: vec![f.name.clone()], electrons: vec![0.0; signals.len()] })
        .collect();
    for (frame, capture) in frames {
        let light = frame_light(study, capture, scene.map(|scene| (scene, region)))?;
        let camera = CameraResponse::new(&behind_filter(&lens, capture), sensor, grid, None);
        for (term, fluorophore) in terms.iter_mut().zip(&plan.fluorophores) {
            let exitance = direct_exitance(&fluorophore.eem, grid, &light);
            let radiance: Vec<f64> = exitance.into_iter().map(|m| m / std::f64::consts::PI).collect();
            let electrons = camera.electrons(&radiance, sensor.frame_light_s(frame.raw.exposure_s));
            for (signal, value) in signals.iter().zip(&mut term.electrons) {
                let channel = camera.channels().iter().position(|name| *name == signal.channel);
                if let Some(channel) = channel.filter(|_| signal.frame == frame.raw.label) {
                    *value = electrons[channel];
                }
            }
        }
    }
    terms.retain(|term| term.electrons.iter().sum::<f64>() > 0.0);
    Some(terms)
}

/// The shares that a simulation knows: electrons of light that fluoresced once, by the fluorophores of each term and by those that no term
/// has. Of two terms, porphyrin and bulk, the fit puts whatever is no porphyrin into the bulk, and so does the truth.
fn with_truth(
    measured: &Measured<'_>,
    frames: &[(&CapturedFrame, &Capture)],
    mut unmixing: Unmixing,
) -> Result<Unmixing, PipelineError> {
    let Some(components) = measured.components else { return Ok(unmixing) };
    let known: Vec<&String> = unmixing.terms.iter().flat_map(|term| &term.fluorophores).collect();
    let light_of = |is: &dyn Fn(&String) -> bool| -> Result<f64, PipelineError> {
        let is = |light: &LightPath| matches!(light, LightPath::Fluorescence(name) if is(name));
        let mut sum = 0.0;
        for (frame, capture) in frames {
            // Signals are means of the pixels that are not saturated
            let saturated = &frame.developed.saturated;
            let pixels = measured.region.pixels.iter().copied();
            let pixels = pixels.filter(|&pixel| saturated.get(pixel) != Some(&true)).collect();
            let unsaturated = PixelSelection { pixels, ..*measured.region };
            let means = region_electrons(measured.study, components, capture, frame, &unsaturated, &is)?;
            sum += means.iter().sum::<f64>();
        }
        Ok(sum)
    };
    let mut electrons = unmixing
        .terms
        .iter()
        .map(|term| light_of(&|name| term.fluorophores.contains(name)))
        .collect::<Result<Vec<f64>, _>>()?;
    let others = light_of(&|name| !known.contains(&name))?;
    let all = electrons.iter().sum::<f64>() + others;
    if all > 0.0 {
        let of_porphyrin = |term: &UnmixedTerm| measured.plan.porphyrin.iter().eq(term.fluorophores.iter());
        let bulk = match unmixing.terms.as_slice() {
            [bulk, last] if of_porphyrin(last) && !of_porphyrin(bulk) => Some(0),
            _ => None,
        };
        if let Some(bulk) = bulk {
            electrons[bulk] += others;
        }
        unmixing.terms.iter_mut().zip(electrons).for_each(|(term, sum)| term.true_share = Some(sum / all));
        unmixing.true_share_of_others =
            Some(OtherLight { share: others / all, counts_as_bulk: bulk.is_some() });
    }
    Ok(unmixing)
}
