//! How much a camera and its lights differ from their description, from frames of targets that are known.

use std::f64::consts::PI;

use serde::Serialize;

use super::region_signal::CameraResponse;
use crate::pipeline::capture::direct_light::{axis_point, irradiance_on};
use crate::pipeline::capture::film_irradiance::behind_filter;
use crate::render::direct_exitance;
use crate::sensor::MeasuredNumber;
use crate::spectral::{Curve, Fluorophore, MAX_WAVELENGTH_NM, MIN_WAVELENGTH_NM, WavelengthGrid};
use crate::study::{Capture, Study};

/// What stands on the axis in the plane in focus, and faces the camera.
#[derive(Clone, Debug, PartialEq)]
pub enum KnownTarget {
    /// A matte surface under the lights of the capture.
    Tile {
        /// Its diffuse reflectance.
        reflectance: Curve,
        /// What it fluoresces with, and its concentration.
        fluorophore: Option<(Fluorophore, f64)>,
    },
    /// A source of a radiance, W/(sr m² nm); relative where only its spectrum is known.
    Source {
        /// Its radiance.
        radiance: Curve,
        /// Whether that is absolute.
        is_absolute: bool,
    },
}

/// A target as a camera recorded it.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedTarget {
    /// Name.
    pub name: String,
    /// Capture whose lights and filters were used.
    pub capture: String,
    /// What it is.
    pub target: KnownTarget,
    /// Standard error of what is known of it, relative.
    pub uncertainty: f64,
    /// Whether the viewing filters were in place.
    pub has_filters: bool,
    /// Channels with a usable level: name, measured digital numbers per second, electrons per second of the description.
    pub channels: Vec<(String, MeasuredNumber, f64)>,
}

/// Whether the quantum efficiency of a channel is that of the description.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EfficiencyScale {
    /// Channel.
    pub channel: String,
    /// Factor on its quantum efficiency, lens included; where not absolute, with a mean of 1 over the channels.
    pub factor: MeasuredNumber,
    /// Whether a known radiance makes it absolute.
    pub is_absolute: bool,
}

/// How strong the lights of a capture are.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LightScale {
    /// Capture.
    pub capture: String,
    /// Factor on the drives of its lights; where no efficiency is absolute, the product of both.
    pub factor: MeasuredNumber,
    /// Whether it is that of the lights alone.
    pub is_absolute: bool,
    /// Largest relative deviation of a channel of a target from it.
    pub residual: f64,
}

/// What of the excitation passes the viewing filters.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FilterLeakage {
    /// Capture.
    pub capture: String,
    /// Channel.
    pub channel: String,
    /// Measured level with the filters over that without.
    pub passed: MeasuredNumber,
    /// The same by the description.
    pub described: f64,
}

/// What known targets tell of a camera and its lights.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CameraScales {
    /// Efficiencies by channel; none without a source.
    pub efficiencies: Vec<EfficiencyScale>,
    /// Lights by capture.
    pub lights: Vec<LightScale>,
    /// Leaks by capture and channel.
    pub leaks: Vec<FilterLeakage>,
}

/// Electrons per second that a target frees in a pixel of each channel on the axis, by the description of camera and lights. `None` without
/// lens, sensor or light.
#[must_use]
pub fn target_rates(
    study: &Study,
    capture: &Capture,
    target: &KnownTarget,
    has_filters: bool,
) -> Option<Vec<f64>> {
    let (sensor, plain) = (study.camera.sensor.as_ref()?, &study.camera.lens.as_ref()?.equation);
    let filtered = study.camera.lens_behind_filters()?;
    let lens = if has_filters { behind_filter(&filtered, capture).into_owned() } else { plain.clone() };
    let step_nm = 1.0;
    let bins = ((MAX_WAVELENGTH_NM - MIN_WAVELENGTH_NM) / step_nm) as usize;
    let edges: Vec<f64> = (0..=bins).map(|edge| MIN_WAVELENGTH_NM + step_nm * edge as f64).collect();
    let grid = WavelengthGrid::from_edges(&edges).ok()?;
    let camera = CameraResponse::new(&lens, sensor, &grid, None);
    let bands = match target {
        KnownTarget::Source { radiance, .. } => radiance.bin_averages(&grid),
        KnownTarget::Tile { reflectance, fluorophore } => {
            let light = irradiance_on(study, capture, &[axis_point(study)])?;
            let mut exitance = light.times(reflectance).bin_averages(&grid);
            if let Some((fluorophore, concentration)) = fluorophore {
                let emitted = direct_exitance(&fluorophore.eem, &grid, &light);
                exitance.iter_mut().zip(emitted).for_each(|(sum, emitted)| *sum += concentration * emitted);
            }
            exitance.into_iter().map(|m| m / PI).collect()
        }
    };
    Some((0..camera.channels().len()).map(|channel| camera.channel_electrons(channel, &bands, 1.0)).collect())
}

/// Relative deviation of channels from a description that is not told from noise when they are averaged.
const DESCRIBED: f64 = 0.05;

/// Mean of numbers weighted by their errors and by how well channels are described; its error is that of noise, or of how they scatter.
fn weighted_mean(numbers: &[MeasuredNumber]) -> Option<MeasuredNumber> {
    let weight = |m: &MeasuredNumber| ((m.error() / m.value).powi(2) + DESCRIBED * DESCRIBED).recip();
    let sum: f64 = numbers.iter().map(weight).sum();
    let mean_of =
        |f: &dyn Fn(&MeasuredNumber) -> f64| numbers.iter().map(|m| weight(m) * f(m)).sum::<f64>() / sum;
    let mean = mean_of(&|m| m.value);
    let of_noise = numbers.iter().map(|m| (weight(m) * m.error()).powi(2)).sum::<f64>().sqrt() / sum;
    let scatter = mean_of(&|m| (m.value - mean).powi(2)) / numbers.len().saturating_sub(1).max(1) as f64;
    (!numbers.is_empty()).then(|| MeasuredNumber::new(mean, of_noise.max(scatter.sqrt())))
}

/// The same number with a further relative standard error.
fn less_sure(number: MeasuredNumber, relative: f64) -> MeasuredNumber {
    MeasuredNumber::new(number.value, number.error().hypot(relative * number.value))
}

impl CameraScales {
    /// What recorded targets tell, where the system gain is known, DN/e-.
    #[must_use]
    pub fn of(targets: &[RecordedTarget], gain: MeasuredNumber) -> Self {
        let efficiencies = efficiencies(targets, gain);
        let mut captures: Vec<&str> = targets.iter().map(|target| target.capture.as_str()).collect();
        captures.sort_unstable();
        captures.dedup();
        let lights =
            captures.iter().filter_map(|capture| light(targets, capture, gain, &efficiencies)).collect();
        let leaks = captures.iter().flat_map(|capture| leaks(targets, capture)).collect();
        Self { efficiencies, lights, leaks }
    }
}

/// Measured over described, without what all channels share: gain and the uncertainty of the target.
fn ratios(target: &RecordedTarget, gain: MeasuredNumber) -> impl Iterator<Item = (&str, MeasuredNumber)> {
    let lit = target.channels.iter().filter(|(_, _, described)| *described > 0.0);
    lit.map(move |(channel, rate, described)| (channel.as_str(), rate.times(1.0 / (gain.value * described))))
}

fn efficiencies(targets: &[RecordedTarget], gain: MeasuredNumber) -> Vec<EfficiencyScale> {
    let source = |target: &&RecordedTarget| match target.target {
        KnownTarget::Source { is_absolute, .. } => Some(is_absolute),
        KnownTarget::Tile { .. } => None,
    };
    // The source that is known best
    let rank = |target: &&RecordedTarget| (source(target) != Some(true), (1e9 * target.uncertainty) as u64);
    let Some(best) = targets.iter().filter(|target| source(target).is_some()).min_by_key(rank) else {
        return Vec::new();
    };
    let is_absolute = source(&best) == Some(true);
    let found: Vec<(&str, MeasuredNumber)> = ratios(best, gain).collect();
    let mean = found.iter().map(|(_, ratio)| ratio.value).sum::<f64>() / found.len().max(1) as f64;
    let factor = |ratio: MeasuredNumber| match is_absolute {
        true => less_sure(ratio, best.uncertainty.hypot(gain.error() / gain.value)),
        false => ratio.times(1.0 / mean),
    };
    let scale = |(channel, ratio): (&str, MeasuredNumber)| EfficiencyScale {
        channel: channel.into(),
        factor: factor(ratio),
        is_absolute,
    };
    found.into_iter().map(scale).collect()
}

/// Tiles of a capture, and whether they fluoresce.
fn tiles<'a>(
    targets: &'a [RecordedTarget],
    capture: &str,
) -> impl Iterator<Item = (&'a RecordedTarget, bool)> {
    let of_it = targets.iter().filter(move |target| target.capture == capture);
    of_it.filter_map(|target| match &target.target {
        KnownTarget::Tile { fluorophore, .. } => Some((target, fluorophore.is_some())),
        KnownTarget::Source { .. } => None,
    })
}

/// The lights of a capture from its tiles. Those behind the viewing filters count where they fluoresce, or none is seen without filters.
fn light(
    targets: &[RecordedTarget],
    capture: &str,
    gain: MeasuredNumber,
    efficiencies: &[EfficiencyScale],
) -> Option<LightScale> {
    let tiles: Vec<(&RecordedTarget, bool)> = tiles(targets, capture).collect();
    // Of a tile that does not fluoresce filters pass what leaks
    let is_direct = |(tile, fluoresces): &&(&RecordedTarget, bool)| *fluoresces || !tile.has_filters;
    let has_direct = tiles.iter().any(|tile| is_direct(&tile));
    let used: Vec<&RecordedTarget> =
        tiles.iter().filter(|tile| is_direct(tile) == has_direct).map(|(tile, _)| *tile).collect();
    let of = |channel: &str| efficiencies.iter().find(|scale| scale.channel == channel);
    let corrected = |(channel, ratio): (&str, MeasuredNumber)| match of(channel) {
        Some(scale) => ratio.times(1.0 / scale.factor.value),
        None => ratio,
    };
    let all: Vec<MeasuredNumber> = used.iter().flat_map(|tile| ratios(tile, gain)).map(corrected).collect();
    let mean = weighted_mean(&all)?;
    let known = used.iter().map(|tile| tile.uncertainty).fold(f64::INFINITY, f64::min);
    let is_absolute = efficiencies.first().is_some_and(|scale| scale.is_absolute);
    // The gain is part of an absolute efficiency, and cancels
    let of_camera = match efficiencies.first() {
        Some(scale) if is_absolute => scale.factor.error() / scale.factor.value,
        _ => gain.error() / gain.value,
    };
    let residual = all.iter().map(|ratio| (ratio.value / mean.value - 1.0).abs()).fold(0.0, f64::max);
    let factor = less_sure(mean, known.hypot(of_camera));
    Some(LightScale { capture: capture.into(), factor, is_absolute, residual })
}

fn leaks(targets: &[RecordedTarget], capture: &str) -> Vec<FilterLeakage> {
    let tiles = |has_filters: bool| {
        let all = tiles(targets, capture).filter(|(_, fluoresces)| !fluoresces);
        all.map(|(tile, _)| tile).filter(move |tile| tile.has_filters == has_filters)
    };
    // One tile, with and without: another reflects another share of the light
    let pair = tiles(true)
        .find_map(|behind| Some((behind, tiles(false).find(|open| open.target == behind.target)?)));
    let Some((behind, open)) = pair else { return Vec::new() };
    let leak = |(channel, rate, described): &(String, MeasuredNumber, f64)| {
        let (_, whole, of_whole) = open.channels.iter().find(|(other, ..)| other == channel)?;
        let ratio = rate.over(*whole);
        // Nothing can be less than none: a chance level below the dark one leaves a limit
        let passed = MeasuredNumber {
            low: ratio.low.max(0.0),
            ..MeasuredNumber::new(ratio.value.max(0.0), ratio.error())
        };
        (whole.low > 0.0 && *of_whole > 0.0).then(|| FilterLeakage {
            capture: capture.into(),
            channel: channel.clone(),
            passed,
            described: described / of_whole,
        })
    };
    behind.channels.iter().filter_map(leak).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(name: &str, has_filters: bool, channels: &[(f64, f64)]) -> RecordedTarget {
        let named = ["R", "G"].into_iter().zip(channels);
        RecordedTarget {
            name: name.into(),
            capture: "blue".into(),
            target: KnownTarget::Tile { reflectance: Curve::constant(0.9), fluorophore: None },
            uncertainty: 0.02,
            has_filters,
            channels: named
                .map(|(n, (dn, e))| (n.to_owned(), MeasuredNumber::new(*dn, 1e-3 * dn), *e))
                .collect(),
        }
    }

    #[test]
    fn lights_and_efficiencies_are_told_apart_only_by_a_known_radiance() {
        let gain = MeasuredNumber::new(0.5, 0.005);
        // Efficiencies of 0.8 and 1.2 of the sheet's, lights of 1.5 of it
        let open = tile("tile", false, &[(0.5 * 0.8 * 1.5 * 1e6, 1e6), (0.5 * 1.2 * 1.5 * 1e6, 1e6)]);
        let behind = tile("leak", true, &[(0.5 * 0.8 * 1.5 * 1e2, 50.0), (0.5 * 1.2 * 1.5 * 1e2, 50.0)]);
        let source = RecordedTarget {
            target: KnownTarget::Source { radiance: Curve::constant(1.0), is_absolute: true },
            ..tile("sphere", true, &[(0.5 * 0.8 * 1e5, 1e5), (0.5 * 1.2 * 1e5, 1e5)])
        };
        let all = CameraScales::of(&[open.clone(), behind.clone(), source], gain);
        assert!((all.efficiencies[0].factor.value - 0.8).abs() < 1e-9 && all.efficiencies[0].is_absolute);
        assert!((all.lights[0].factor.value - 1.5).abs() < 1e-9 && all.lights[0].residual < 1e-9, "{all:?}");
        // Gain of 1 %, target of 2 %
        assert!((all.efficiencies[0].factor.error() / 0.8 - 0.02236).abs() < 1e-3, "{all:?}");
        assert!(
            (all.leaks[1].passed.value - 1e-4).abs() < 1e-12 && (all.leaks[1].described - 5e-5).abs() < 1e-12
        );
        let without = CameraScales::of(&[open.clone(), behind.clone()], gain);
        assert!(without.efficiencies.is_empty() && !without.lights[0].is_absolute);
        let light = &without.lights[0];
        assert!((light.factor.value - 1.5).abs() < 1e-3 && light.factor.error() > 0.2, "{without:?}");
        assert!(light.residual > 0.19, "{without:?}");
        // A gray tile without the filters says nothing of what a white one behind them should have sent
        let gray = KnownTarget::Tile { reflectance: Curve::constant(0.2), fluorophore: None };
        let gray = RecordedTarget { target: gray, ..open };
        assert!(CameraScales::of(&[gray, behind], gain).leaks.is_empty());
    }
}
