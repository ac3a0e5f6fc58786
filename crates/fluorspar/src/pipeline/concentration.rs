//! Other concentrations of fluorophores in a finished render.
//!
//! Fluorescence is proportional to the concentration of its fluorophore, and no light path depends on concentrations. So the
//! components of light that fluoresced once follow a factor exactly. Light that fluoresced twice follows the product of two
//! factors, of which the render did not keep apart which: it takes the square of the mean factor, weighted by the light of each
//! fluorophore, and what that may be wrong by is told. A mask scales what its pixels show, with the light in them that was emitted
//! elsewhere and reflected there, which a new render would not change.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::PipelineError;
use crate::image::{ChannelPlanes, ComponentFactors, ComponentImage, LightPath};
use crate::study::{ConcentrationChange, PaintedFactor, Study};

/// Factors on the components of a render that give it the concentrations of a study. `rendered` holds the factors by name that it
/// was rendered with, where they are not 1. Light that fluoresced more than once stays as it is: see [`scale_multiple`].
///
/// # Errors
/// A fluorophore that was rendered with the factor 0, a mask of other proportions than the image.
pub fn concentration_factors(
    rendered: &BTreeMap<String, f64>,
    wanted: &Study,
    components: &ComponentImage,
) -> Result<ComponentFactors, PipelineError> {
    let mut factors = ComponentFactors::ones(components.components.len());
    for (number, component) in components.components.iter().enumerate() {
        let LightPath::Fluorescence(name) = &component.light else { continue };
        let before = rendered.get(name).copied().unwrap_or(1.0);
        let change = wanted.concentrations.iter().find(|change| change.fluorophore == *name);
        let after = change.map_or(1.0, |change| change.factor);
        let painted = change.and_then(|change| change.painted.as_ref());
        if before == 0.0 && (after != 0.0 || painted.is_some()) {
            return Err(PipelineError::OtherScene(format!(
                "concentration.{name}, which was rendered as 0 and has no light to scale,"
            )));
        }
        match (change, painted) {
            (Some(ConcentrationChange { factor: outside, .. }), Some(painted)) => {
                factors.even[number] = if before == 0.0 { 1.0 } else { 1.0 / before };
                factors.maps[number] = Some(painted_map(name, painted, *outside, components)?);
            }
            _ if before != after => factors.even[number] = after / before,
            _ => {}
        }
    }
    Ok(factors)
}

/// Factors of a mask on the pixels of an image: the mean of the mask over each.
fn painted_map(
    name: &str,
    painted: &PaintedFactor,
    outside: f64,
    components: &ComponentImage,
) -> Result<Arc<[f32]>, PipelineError> {
    let PaintedFactor { inside, width, height, mask } = painted;
    let (columns, rows) = (components.width, components.height);
    let proportion = (width * rows) as f64 / (height * columns) as f64;
    if (proportion - 1.0).abs() > 0.01 {
        return Err(PipelineError::OtherProportions {
            name: name.into(),
            mask: [*width, *height],
            image: [columns, rows],
        });
    }
    let span = |index: usize, count: usize, size: usize| {
        let first = index * size / count;
        first..((index + 1) * size / count).max(first + 1)
    };
    let factor = |pixel: usize| {
        let (lines, across) = (span(pixel / columns, rows, *height), span(pixel % columns, columns, *width));
        let samples = (lines.len() * across.len()) as f64;
        let sum: f64 =
            lines.flat_map(|line| across.clone().map(move |col| f64::from(mask[line * width + col]))).sum();
        (outside + (inside - outside) * sum / samples) as f32
    };
    Ok((0..columns * rows).map(factor).collect())
}

/// What changed concentrations leave uncertain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MultipleUncertainty {
    /// Light that fluoresced more than once over all light of its light group, in electrons, after the change.
    pub share: f64,
    /// Most that the light of the group may be wrong by, as a share of it: as if all light that fluoresced twice had done so in
    /// the one fluorophore of the least or of the largest factor. What it is wrong by is far less: a tenth of it and below.
    pub largest_error: f64,
}

/// Scales light that fluoresced more than once, for factors on that which fluoresced once: by the square of their mean, weighted by
/// the electrons of each fluorophore. The true factor lies between the squares of the least and the largest one (counting light
/// that fluoresced twice). Returns the worst uncertainty of all light groups; `None` where no concentration changes.
pub fn scale_multiple(
    factors: &mut ComponentFactors,
    components: &ComponentImage,
    planes: &ChannelPlanes,
) -> Option<MultipleUncertainty> {
    let mut worst: Option<MultipleUncertainty> = None;
    for group in components.group_labels() {
        let of_group = |(number, label): (usize, &crate::image::Component)| {
            (label.group_label() == group).then(|| (number, label.light.clone()))
        };
        let members: Vec<(usize, LightPath)> =
            components.components.iter().enumerate().filter_map(of_group).collect();
        let once = members.iter().filter(|(_, light)| matches!(light, LightPath::Fluorescence(_)));
        let sums: Vec<FactorSum> = once.map(|(number, _)| FactorSum::of(*number, factors, planes)).collect();
        let twice = members.iter().find(|(_, light)| *light == LightPath::MultipleFluorescence);
        let (Some((twice, _)), true) = (twice, sums.iter().any(|sum| !sum.is_one())) else { continue };
        let before: f64 = sums.iter().map(|sum| sum.before).sum();
        if before <= 0.0 {
            continue;
        }
        let after: f64 = sums.iter().map(|sum| sum.after).sum();
        let factor = (after / before).powi(2);
        factors.even[*twice] *= factor;
        let lit = || sums.iter().filter(|sum| sum.before > 0.0);
        let least = lit().map(|sum| sum.range[0]).fold(f64::INFINITY, f64::min).powi(2);
        let most = lit().map(|sum| sum.range[1]).fold(0.0, f64::max).powi(2);
        let light = FactorSum::of(*twice, &ComponentFactors::ones(factors.even.len()), planes).before;
        let reflected = members.iter().filter(|(_, light)| *light == LightPath::Reflected);
        let reflected: f64 = reflected.map(|(number, _)| FactorSum::of(*number, factors, planes).after).sum();
        let total = (reflected + after + factor * light).max(f64::MIN_POSITIVE);
        let found = MultipleUncertainty {
            share: factor * light / total,
            largest_error: light * (most - factor).max(factor - least) / total,
        };
        if worst.is_none_or(|worst| found.largest_error > worst.largest_error) {
            worst = Some(found);
        }
    }
    worst
}

/// Electrons of a component before and after a change of its concentration.
struct FactorSum {
    before: f64,
    after: f64,
    /// Least and largest factor of a pixel.
    range: [f64; 2],
}

impl FactorSum {
    fn of(component: usize, factors: &ComponentFactors, planes: &ChannelPlanes) -> Self {
        let mut sum = Self { before: 0.0, after: 0.0, range: [f64::INFINITY, f64::NEG_INFINITY] };
        for channel in 0..planes.channels {
            for (pixel, value) in planes.plane(component, channel).iter().enumerate() {
                let factor = factors.at(component, pixel);
                sum.before += f64::from(*value);
                sum.after += factor * f64::from(*value);
                sum.range = [sum.range[0].min(factor), sum.range[1].max(factor)];
            }
        }
        sum
    }

    fn is_one(&self) -> bool {
        self.range == [1.0; 2]
    }
}
