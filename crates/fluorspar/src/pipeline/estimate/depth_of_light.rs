//! From how deep the fluorescence of layered tissue comes that the channels of a camera see.

use serde::Serialize;

use super::frame_light::frame_light;
use crate::pipeline::capture::film_irradiance::behind_filter;
use crate::spectral::Curve;
use crate::study::{Capture, Study, StudyTissue};
use crate::tissue::{EffectiveTissue, TissueError};

/// Depths of the fluorescence of one tissue that one channel sees in one frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DepthOfLight {
    /// Label of the frame.
    pub frame: String,
    /// Name of the tissue's material.
    pub tissue: String,
    /// Parts of the scene that are made of it.
    pub parts: Vec<String>,
    /// Name of the channel.
    pub channel: String,
    /// Mean depth below the surface, um.
    pub mean_um: f64,
    /// Depth above which half of the light comes from, um.
    pub median_um: f64,
    /// Depth above which nine tenths of the light come from, um.
    pub depth_90_um: f64,
    /// Depths above which 0, 5, ..., 95 % and all of the light come from, um.
    pub quantiles_um: Vec<f64>,
    /// Share of the light of each layer, from above.
    pub layers: Vec<LayerShare>,
}

/// Share of a layer in the light of a channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LayerShare {
    /// Name of the layer.
    pub name: String,
    /// Its share, 0 to 1.
    pub share: f64,
}

/// The light of a frame, in photons, and what each channel sees of the light that comes back.
struct SeenFrame<'a> {
    label: &'a str,
    photons: Curve,
    channels: Vec<(&'a str, Curve)>,
}

/// Depths of the fluorescence of all tissues of a study in some of its captures, by channel.
///
/// Under the direct light of the frame where the camera's axis meets the plane in focus, weighted by lens, filters and
/// quantum efficiency; each tissue in its mean state over its surfaces, with its fluorescence alone.
///
/// # Errors
/// Tissues that the solver refuses.
pub fn depths_of_light(study: &Study, captures: &[&Capture]) -> Result<Vec<DepthOfLight>, TissueError> {
    let (Some(lens), Some(sensor)) = (study.camera.lens_behind_filters(), &study.camera.sensor) else {
        return Ok(Vec::new());
    };
    let qe = sensor.effective_qe();
    let mut depths = Vec::new();
    // Spectra of each frame, in photons
    let frames: Vec<SeenFrame<'_>> = captures
        .iter()
        .filter_map(|capture| {
            let light = frame_light(study, capture, None)?;
            let (first, last) = light.range_nm();
            let photons = light.times(&Curve::from_fn(first, last, |nm| nm));
            let filters = &behind_filter(&lens, capture).transmittance;
            let channels = qe.channels().iter().map(|c| (c.name.as_str(), filters.times(&c.curve))).collect();
            Some(SeenFrame { label: &capture.frame.label, photons, channels })
        })
        .collect();
    if frames.is_empty() {
        return Ok(depths);
    }
    let tissues: Vec<_> = study.tissues.iter().map(|tissue| tissue.tissue.clone()).collect();
    let solved = EffectiveTissue::several_for_grid(&tissues, &study.scene.grid)?;
    for (tissue, solved) in study.tissues.iter().zip(&solved) {
        for SeenFrame { label, photons, channels } in &frames {
            let curves: Vec<&Curve> = channels.iter().map(|(_, curve)| curve).collect();
            let profiles = solved.depths_of_fluorescence(photons, &curves);
            let of_channel = channels.iter().zip(profiles).filter_map(|((channel, _), profile)| {
                Some(DepthOfLight {
                    frame: (*label).into(),
                    tissue: tissue.name.clone(),
                    parts: tissue.parts.clone(),
                    channel: (*channel).into(),
                    mean_um: profile.mean_um()?,
                    median_um: profile.quantile_um(0.5)?,
                    depth_90_um: profile.quantile_um(0.9)?,
                    quantiles_um: (0..=20)
                        .map(|twentieth| profile.quantile_um(0.05 * f64::from(twentieth)))
                        .collect::<Option<_>>()?,
                    layers: layers(tissue, &profile.layer_shares),
                })
            });
            depths.extend(of_channel);
        }
    }
    Ok(depths)
}

fn layers(tissue: &StudyTissue, shares: &[f64]) -> Vec<LayerShare> {
    let layers = tissue.tissue.layers.iter().zip(shares);
    layers.map(|(layer, share)| LayerShare { name: layer.name.clone(), share: *share }).collect()
}
