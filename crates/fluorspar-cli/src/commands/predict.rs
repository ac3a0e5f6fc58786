//! `fluorspar predict`: a flat sample in words.

use std::path::Path;

use fluorspar::pipeline::{ChannelPrediction, Prediction};
use fluorspar::study::FlatSample;
use fluorspar_experiment::{ResolvedSample, SampleCompatibility};
use fluorspar_session::PredictedSample;

use super::table::{align, short};

/// Channels as people name them: R, G and B first, in this order.
fn in_usual_order(prediction: &Prediction) -> Vec<(&String, &ChannelPrediction)> {
    let place = |name: &str| ["R", "G", "B"].iter().position(|usual| *usual == name).unwrap_or(3);
    let mut channels: Vec<_> = prediction.channels.iter().collect();
    channels.sort_by_key(|(name, _)| place(name));
    channels
}

/// The irradiance, and how much of it the wavelengths of the sample leave out.
fn light_on_sample(sample: &FlatSample, inside: f64) -> String {
    let all = sample.irradiance.total();
    if (all - inside).abs() <= 1e-5 * all {
        return format!("{} W/m2", short(all));
    }
    let (from, to) = (sample.grid.start_nm(), sample.grid.end_nm());
    format!("{} W/m2 ({} of it between {from} and {to} nm, the rest is left out)", short(all), short(inside))
}

pub(crate) fn describe(
    PredictedSample { sample: resolved, source, prediction, .. }: &PredictedSample,
) -> String {
    let title = if resolved.record.title.is_empty() {
        Path::new(source)
            .file_name()
            .map_or_else(|| source.into(), |name| name.to_string_lossy().into_owned())
    } else {
        resolved.record.title.clone()
    };
    let mut text = format!("{title}\n\n");
    for (name, value) in facts(resolved, prediction) {
        text += &format!("{name:<20} {value}\n");
    }
    let channels = in_usual_order(prediction);
    text += &format!("\n{}", align(&radiance_rows(&resolved.sample, prediction, &channels), &[]));
    if !channels.is_empty() {
        text += &format!("\n{}", align(&channel_rows(&channels), &[]));
    }
    text
}

/// Integral of a density over the bands of a sample.
fn integral(sample: &FlatSample, values: &[f64]) -> f64 {
    values.iter().zip(sample.grid.widths_nm()).map(|(v, w)| v * w).sum()
}

/// Wavelength of the largest value, a dash without any.
fn peak_nm(prediction: &Prediction, values: &[f64]) -> String {
    let best = (0..values.len()).fold(0, |best, b| if values[b] > values[best] { b } else { best });
    if values.iter().any(|v| *v > 0.0) { format!("{}", prediction.wavelength_nm[best]) } else { "-".into() }
}

/// What is known of the sample as a whole.
fn facts(resolved: &ResolvedSample, prediction: &Prediction) -> Vec<(&'static str, String)> {
    let sample = &resolved.sample;
    let light = light_on_sample(sample, integral(sample, &prediction.irradiance));
    let peak = peak_nm(prediction, &prediction.irradiance);
    let mut facts = vec![("light on the sample", format!("{light}, peak at {peak} nm"))];
    if let Some(value) = prediction.photon_yield_500_700 {
        facts.push(("photons out", format!("{value:.3e} between 500 and 700 nm per photon in")));
    }
    if let Some(seconds) = prediction.exposure_s {
        facts.push(("exposure", format!("{} ms, gain {}", short(seconds * 1e3), sample.exposure.gain)));
    }
    if let Some(leak) = prediction.leak_ratio {
        facts.push(("leak", format!("{} reflected per fluorescent electron", short(leak))));
    }
    if let Some(porphyrin) = &prediction.porphyrin {
        let estimate = &porphyrin.measured.estimate;
        let [low, high] = estimate.fraction_interval;
        let value = format!(
            "{:.4} from the color of one pixel ({low:.4} to {high:.4} by sensor noise), true {:.4}; of {} over it and one unit of all others, \
             no share of the light",
            estimate.fraction, porphyrin.true_fraction, porphyrin.name
        );
        facts.push(("ratio of amounts", value));
    }
    if resolved.compatibility == SampleCompatibility::ToolboxEem {
        let value = "the authors' toolbox: matrices of peak 1, so fluorescence has no absolute level";
        facts.push(("equations", value.into()));
    }
    facts
}

/// Table of the light that leaves the sample: what is reflected, by fluorophore, and all of it.
fn radiance_rows(
    sample: &FlatSample,
    prediction: &Prediction,
    channels: &[(&String, &ChannelPrediction)],
) -> Vec<Vec<String>> {
    let head = ["radiance from the sample", "W/(sr m2)", "peak nm"].map(String::from).into_iter();
    let electrons = channels.iter().map(|(name, _)| format!("{name} e-"));
    let mut rows: Vec<Vec<String>> = vec![head.chain(electrons).chain(["r".into(), "g".into()]).collect()];
    let mut add = |name: &str, values: &[f64], electrons: Vec<f64>, rg: Option<[f64; 2]>| {
        let mut row = vec![name.to_string(), short(integral(sample, values)), peak_nm(prediction, values)];
        row.extend(electrons.into_iter().map(|e| format!("{e:.1}")));
        let cell = |i: usize| rg.map_or_else(|| "-".into(), |rg| format!("{:.4}", rg[i]));
        row.extend([cell(0), cell(1)]);
        rows.push(row);
    };
    let by_channel = |pick: &dyn Fn(&ChannelPrediction) -> f64| {
        channels.iter().map(|(_, channel)| pick(channel)).collect::<Vec<f64>>()
    };
    add("reflected", &prediction.radiance.reflected, by_channel(&|c| c.electrons_reflected), None);
    for (name, values) in &prediction.radiance.fluorescence {
        let rg = prediction.fluorophore_chromaticity.get(name).and_then(Option::as_ref).map(|c| [c.r, c.g]);
        let electrons = by_channel(&|c| c.electrons_fluorescence.get(name).copied().unwrap_or(0.0));
        add(name, values, electrons, rg);
    }
    let rg = prediction.chromaticity.as_ref().map(|c| [c.r, c.g]);
    add("total", &prediction.radiance.total, by_channel(&|c| c.electrons), rg);
    if channels.is_empty() {
        rows.iter_mut().for_each(|row| row.truncate(3));
    }
    rows
}

/// Table of the signal of each channel.
fn channel_rows(channels: &[(&String, &ChannelPrediction)]) -> Vec<Vec<String>> {
    let head = ["channel", "electrons", "volts", "DN", "noise DN", ""].map(String::from).to_vec();
    let row = |(name, c): &(&String, &ChannelPrediction)| {
        vec![
            (*name).clone(),
            format!("{:.1}", c.electrons),
            format!("{:.5}", c.volts),
            format!("{:.1}", c.dn),
            format!("{:.2}", c.noise_dn),
            if c.saturated { "saturated" } else { "" }.into(),
        ]
    };
    std::iter::once(head).chain(channels.iter().map(row)).collect()
}
