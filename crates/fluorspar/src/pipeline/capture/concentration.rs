//! Other concentrations of fluorophores in a finished render.
//!
//! Fluorescence is proportional to the concentration of its fluorophore, and no light path depends on concentrations. So the
//! components of light that fluoresced once follow a factor exactly. Light that fluoresced twice follows the product of two
//! factors, of which the render did not keep apart which: it takes the square of the mean factor, weighted by the light of each
//! fluorophore, and what that may be wrong by is told. A mask scales what its pixels show, with the light in them that was emitted
//! elsewhere and reflected there, which a new render would not change.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::capture_planes::CapturePlanes;
use super::film_response::FilmResponse;
use crate::image::{ChannelPlanes, ComponentFactors, ComponentImage, ComponentRows, LightPath, PreparedRows};
use crate::pipeline::PipelineError;
use crate::study::{Capture, ConcentrationChange, PaintedFactor, Study};

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
/// the electrons of each fluorophore in the first capture that switches the light group on. The true factor lies between the squares of
/// the least and the largest one (counting light that fluoresced twice).
///
/// Returns the worst uncertainty of a light group in a capture that switches it on; `None` where no concentration of such light
/// changes.
pub fn scale_multiple(
    factors: &mut ComponentFactors,
    components: &ComponentImage,
    planes: &CapturePlanes,
    captures: &[Capture],
) -> Option<MultipleUncertainty> {
    let mut worst: Option<MultipleUncertainty> = None;
    for label in components.light_groups() {
        let Some(group) = GroupMembers::of(&label, components).filter(|group| group.is_changed(factors))
        else {
            continue;
        };
        // Planes of the captures that see the group, each once
        let mut seen: Vec<usize> = Vec::new();
        for (capture, number) in captures.iter().zip(&planes.of_capture) {
            if capture.frame.drive(group.light_group) != 0.0 && !seen.contains(number) {
                seen.push(*number);
            }
        }
        let Some(first) = seen.first() else { continue };
        let Some(factor) = group.mean_factor(factors, &planes.planes[*first]) else { continue };
        let factor = factor * factor;
        let found = seen.iter().map(|number| group.uncertainty(factors, &planes.planes[*number], factor));
        let found = found.max_by(|a, b| a.largest_error.total_cmp(&b.largest_error));
        worst = worst.into_iter().chain(found).max_by(|a, b| a.largest_error.total_cmp(&b.largest_error));
        factors.even[group.twice] *= factor;
    }
    worst
}

impl CapturePlanes {
    /// Planes of captures with what changed concentrations ask beyond factors on their components: light that fluoresced twice is
    /// scaled ([`scale_multiple`]), and where a lens mixes pixels the planes are formed anew with painted masks before it, which
    /// `factors` then hold no longer. `rows` are the spectra, of which those of the `wanted` components are read. Returns what stays
    /// uncertain.
    ///
    /// # Errors
    /// Rows that can't be read.
    pub fn with_concentrations<R: ComponentRows>(
        mut self,
        responses: &[FilmResponse],
        (components, captures): (&ComponentImage, &[Capture]),
        factors: &mut ComponentFactors,
        rows: &R,
        wanted: impl Fn(usize) -> bool + Sync,
    ) -> Result<(Self, Option<MultipleUncertainty>), R::Error> {
        let uncertainty = scale_multiple(factors, components, &self, captures);
        if factors.has_maps() && !responses.iter().all(FilmResponse::is_local) {
            let rows = PreparedRows { rows, factors, width: components.width };
            let all: Vec<&FilmResponse> = responses.iter().collect();
            self.planes = FilmResponse::planes(&all, wanted, &rows)?;
            factors.maps.fill(None);
        }
        Ok((self, uncertainty))
    }
}

/// Components of the light of one group, by number.
struct GroupMembers<'a> {
    light_group: &'a str,
    reflected: Vec<usize>,
    once: Vec<usize>,
    twice: usize,
}

impl<'a> GroupMembers<'a> {
    /// The components of a group; `None` where no light is kept that fluoresced more than once.
    fn of(label: &str, components: &'a ComponentImage) -> Option<Self> {
        let (mut reflected, mut once, mut twice) = (Vec::new(), Vec::new(), None);
        for (number, component) in components.components.iter().enumerate() {
            if component.light_group != label {
                continue;
            }
            match component.light {
                LightPath::Reflected => reflected.push(number),
                LightPath::Fluorescence(_) => once.push(number),
                LightPath::MultipleFluorescence => twice = Some(number),
            }
        }
        let twice = twice?;
        Some(Self { light_group: &components.components[twice].light_group, reflected, once, twice })
    }

    fn is_changed(&self, factors: &ComponentFactors) -> bool {
        self.once.iter().any(|&number| factors.even[number] != 1.0 || factors.maps[number].is_some())
    }

    /// Factor on all light that fluoresced once; `None` where there is none.
    fn mean_factor(&self, factors: &ComponentFactors, planes: &ChannelPlanes) -> Option<f64> {
        let sums = self.once.iter().map(|number| FactorSum::of(*number, factors, planes));
        let (before, after) =
            sums.fold((0.0, 0.0), |(before, after), sum| (before + sum.before, after + sum.after));
        (before > 0.0).then(|| after / before)
    }

    /// What a factor on light that fluoresced more than once leaves uncertain in some planes.
    fn uncertainty(
        &self,
        factors: &ComponentFactors,
        planes: &ChannelPlanes,
        factor: f64,
    ) -> MultipleUncertainty {
        let sum_of = |number: &usize| FactorSum::of(*number, factors, planes);
        let once: Vec<FactorSum> = self.once.iter().map(sum_of).filter(|sum| sum.before > 0.0).collect();
        let least = once.iter().map(|sum| sum.range[0]).fold(f64::INFINITY, f64::min).powi(2);
        let most = once.iter().map(|sum| sum.range[1]).fold(0.0, f64::max).powi(2);
        let light = sum_of(&self.twice).before;
        let others = self.reflected.iter().map(|number| sum_of(number).after).sum::<f64>()
            + once.iter().map(|sum| sum.after).sum::<f64>();
        let total = (others + factor * light).max(f64::MIN_POSITIVE);
        MultipleUncertainty {
            share: factor * light / total,
            largest_error: light * (most - factor).max(factor - least).max(0.0) / total,
        }
    }
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
}
