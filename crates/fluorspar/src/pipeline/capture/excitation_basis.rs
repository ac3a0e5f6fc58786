//! Renders that keep excitation apart by wavelength, and images of them under other light spectra.

use std::ops::Range;

use crate::image::film::TILE;
use crate::image::{
    BasisBuilder, Component, ComponentImage, ExcitationImage, FeatureMaps, Film, FilmLayout, GroupBasis,
    LightPath, RelitComponent,
};
use crate::pipeline::{LightOutsideBasis, PipelineError};
use crate::render::{FilmRenderer, RenderSettings, Share, are_in_proportion, excitation_responses};
use crate::scene::Scene;
use crate::spectral::{Curve, ExcitationNodes, NodesError};
use crate::study::Study;

/// Share of a light that may lie outside the nodes.
const MOST_OUTSIDE: f64 = 1e-3;
/// Estimated relative error of what a light excites in a scene, from the nodes alone.
fn node_error(scene: &Scene, nodes: &ExcitationNodes, light: &Curve) -> f64 {
    nodes.error(light, &excitation_responses(scene))
}

/// Renders a scene with the excitation basis of its settings, in bands of rows whose film fits into the memory limit. `fill` renders
/// what the film of a band lacks, and returns whether nothing is lacking.
///
/// Returns the image under the lights as they are, to the last bit that of a render without a basis, and the basis; `None` where
/// `fill` ended before the last band was full.
///
/// # Errors
/// Those of `fill`.
pub fn render_with_basis<E>(
    renderer: &FilmRenderer,
    settings: &RenderSettings,
    scene: &Scene,
    mut fill: impl FnMut(&Share, &mut Film) -> Result<bool, E>,
) -> Result<Option<(ComponentImage, ExcitationImage)>, E> {
    let layout = renderer.layout();
    let at_once = super::tile_rows_at_once(scene, settings).unwrap_or(1);
    let basis = settings.excitation_basis.iter();
    let named = |group: usize| scene.light_groups[group].name.clone();
    let groups =
        basis.flat_map(|basis| basis.groups.iter().map(move |group| (named(*group), basis.nodes.clone())));
    let mut collected = Collected::new(&layout, groups.collect());
    for first in (0..layout.tile_rows()).step_by(at_once) {
        let band = first..(first + at_once).min(layout.tile_rows());
        let mut film = Film::of_tile_rows(layout.clone(), Default::default(), band.clone());
        let share = Share::TileRange(layout.tiles_of_rows(band.clone()));
        let whole = fill(&share, &mut film)?;
        if !whole && (band.len() < layout.tile_rows() || film.least_samples() == 0) {
            return Ok(None);
        }
        let rows = layout.pixel_rows(band);
        collected.add(rows.clone(), &film.into_rows(rows));
    }
    Ok(Some(collected.finish(renderer.features())))
}

/// The image of a film, and the excitation basis where it keeps light apart by excitation wavelength: what [`render_with_basis`] makes of the
/// same samples, to the last bit.
///
/// # Errors
/// A film whose labels name no valid nodes.
pub fn image_and_basis(film: Film) -> Result<(ComponentImage, Option<ExcitationImage>), NodesError> {
    let layout = film.layout().clone();
    let mut groups: Vec<(String, Vec<f64>)> = Vec::new();
    for component in &layout.components {
        let Some(nm) = component.node_nm else { continue };
        match groups.iter_mut().find(|(name, _)| *name == component.light_group) {
            Some((_, nodes)) if nodes.contains(&nm) => {}
            Some((_, nodes)) => nodes.push(nm),
            None => groups.push((component.light_group.clone(), vec![nm])),
        }
    }
    if groups.is_empty() {
        return Ok((film.into_image(), None));
    }
    let groups = groups.into_iter().map(|(name, nodes)| Ok((name, ExcitationNodes::new(nodes)?)));
    let mut collected = Collected::new(&layout, groups.collect::<Result<_, NodesError>>()?);
    let features = film.features().clone();
    let rows = 0..layout.height;
    collected.add(rows.clone(), &film.into_rows(rows));
    let (image, basis) = collected.finish(features);
    Ok((image, Some(basis)))
}

/// What a render with a basis has given so far.
struct Collected {
    image: ComponentImage,
    /// Components of the film that are components of the image.
    own: Vec<usize>,
    groups: Vec<CollectedGroup>,
    samples: Vec<u32>,
}

struct CollectedGroup {
    light_group: String,
    nodes: ExcitationNodes,
    /// For each light path the components of the film that hold it node by node, and its short form.
    parts: Vec<(Vec<usize>, BasisBuilder)>,
}

impl Collected {
    /// Nothing yet, of the light groups that the film keeps apart at these nodes.
    fn new(layout: &FilmLayout, groups: Vec<(String, ExcitationNodes)>) -> Self {
        let labels = &layout.components;
        let own: Vec<usize> = (0..labels.len()).filter(|c| labels[*c].node_nm.is_none()).collect();
        let pixels = layout.width * layout.height;
        let bands = layout.grid.len();
        let groups = groups.into_iter().map(|(light_group, nodes)| {
            let part = |(light, of_path): (LightPath, Vec<usize>)| {
                let level = |c: &usize| &layout.levels[c * bands..(c + 1) * bands];
                let means: Vec<f32> = if light == LightPath::Reflected {
                    (0..bands).map(|band| of_path.iter().map(|c| level(c)[band]).sum()).collect()
                } else {
                    of_path.iter().flat_map(|c| level(c).iter().copied()).collect()
                };
                (of_path, BasisBuilder::new(light, pixels, &means, bands))
            };
            let parts = node_paths(labels, &light_group).into_iter().map(part).collect();
            CollectedGroup { light_group, nodes, parts }
        });
        let groups = groups.collect();
        let components = own.iter().map(|c| labels[*c].clone()).collect();
        let image = ComponentImage::zeros(layout.grid.clone(), layout.width, layout.height, components);
        Self { image, own, groups, samples: vec![0; pixels] }
    }

    /// Adds finished rows.
    fn add(&mut self, rows: Range<usize>, part: &ComponentImage) {
        let (width, bands) = (part.width, part.grid.len());
        let (plane, row) = (self.image.width * self.image.height * bands, width * bands);
        for (component, of_film) in self.own.iter().enumerate() {
            let target = component * plane + rows.start * row;
            let values = part.stored(*of_film);
            self.image.data[target..target + values.len()].copy_from_slice(values);
        }
        let samples = &mut self.samples[rows.start * width..rows.end * width];
        if part.samples.is_empty() {
            samples.fill(part.samples_per_pixel);
        } else {
            samples.copy_from_slice(&part.samples);
        }
        // Some rows at a time: all nodes of a light path lie side by side while they are brought into the short form
        for first in (0..rows.len()).step_by(TILE) {
            let some = first..(first + TILE).min(rows.len());
            let pixels = some.start * width..some.end * width;
            for (components, builder) in self.groups.iter_mut().flat_map(|group| &mut group.parts) {
                let mut values =
                    gathered(part, components, pixels.clone(), *builder.light() == LightPath::Reflected);
                let len = values.len() / pixels.len().max(1);
                builder.add(rows.start * width + pixels.start, bands, &mut values, len);
            }
        }
    }

    fn finish(self, features: FeatureMaps) -> (ComponentImage, ExcitationImage) {
        let Self { mut image, groups, samples, .. } = self;
        let least = samples.iter().copied().min().unwrap_or(0);
        image.samples_per_pixel = least;
        if samples.iter().any(|count| *count != least) {
            image.samples = samples;
        }
        image.features = features;
        let group = |CollectedGroup { light_group, nodes, parts }: CollectedGroup| GroupBasis {
            light_group,
            nodes,
            components: parts.into_iter().map(|(_, builder)| builder.finish()).collect(),
        };
        let groups = groups.into_iter().map(group).collect();
        let (width, height) = (image.width, image.height);
        (image, ExcitationImage { width, height, groups })
    }
}

/// The nodes of a light group by the path of their light: the numbers of their components.
fn node_paths(labels: &[Component], light_group: &str) -> Vec<(LightPath, Vec<usize>)> {
    let mut paths: Vec<(LightPath, Vec<usize>)> = Vec::new();
    for (number, label) in labels.iter().enumerate() {
        if label.node_nm.is_none() || label.light_group != light_group {
            continue;
        }
        match paths.iter_mut().find(|(light, _)| *light == label.light) {
            Some((_, of_path)) => of_path.push(number),
            None => paths.push((label.light.clone(), vec![number])),
        }
    }
    paths
}

/// Pixels of some components side by side, `[pixel][component][band]`, or their sum, `[pixel][band]`.
fn gathered(image: &ComponentImage, components: &[usize], pixels: Range<usize>, summed: bool) -> Vec<f32> {
    let bands = image.grid.len();
    let len = if summed { bands } else { components.len() * bands };
    let mut values = vec![0.0; pixels.len() * len];
    for (number, component) in components.iter().enumerate() {
        let offset = if summed { 0 } else { number * bands };
        let of = &image.stored(*component)[pixels.start * bands..pixels.end * bands];
        for (target, spectrum) in values.chunks_exact_mut(len).zip(of.chunks_exact(bands)) {
            let target = &mut target[offset..offset + bands];
            target.iter_mut().zip(spectrum).for_each(|(sum, value)| *sum += value);
        }
    }
    values
}

/// A render under the lights of another study, of which an excitation basis gives what has changed.
#[derive(Debug)]
pub struct RelitImage<'a> {
    /// The study that the image then shows: the rendered one with the spectra of the other.
    pub shown: Study,
    /// For each component what takes its place, where that is something else.
    pub components: Vec<Option<RelitComponent<'a>>>,
    /// Names of the light groups whose spectra changed in their form, each with the largest error of its light that is estimated.
    pub changed: Vec<(String, f64)>,
}

/// Gives the light groups of a render the spectra that they have in another study, where the basis keeps them. Of the image only the
/// labels count.
///
/// # Errors
/// A spectrum with light beyond the nodes.
pub fn relight_with_basis<'a>(
    rendered: &Study,
    wanted: &Study,
    labels: &ComponentImage,
    basis: &'a ExcitationImage,
) -> Result<RelitImage<'a>, PipelineError> {
    let mut relit = RelitImage {
        shown: rendered.clone(),
        components: vec![None; labels.components.len()],
        changed: Vec::new(),
    };
    for of_group in &basis.groups {
        let named = |study: &Study| {
            study.scene.light_groups.iter().position(|group| group.name == of_group.light_group)
        };
        let (Some(old), Some(new)) = (named(rendered), named(wanted)) else { continue };
        let Some(light) = new_spectrum(&rendered.scene, old, &wanted.scene, new) else { continue };
        let outside = of_group.nodes.share_outside(&light);
        // Also refuses a spectrum without light, whose share is not a number
        if outside.is_nan() || outside > MOST_OUTSIDE {
            return Err(LightOutsideBasis {
                group: of_group.light_group.clone(),
                percent: 100.0 * outside,
                span_nm: of_group.nodes.span_nm(),
            }
            .into());
        }
        for (component, relit_component) in
            of_group.components.iter().zip(of_group.relit(&labels.grid, &light))
        {
            let is_this = |c: &crate::image::Component| {
                c.light_group == of_group.light_group && c.light == component.light && c.node_nm.is_none()
            };
            if let Some(index) = labels.components.iter().position(is_this) {
                relit.components[index] = Some(relit_component);
            }
        }
        let error = node_error(&wanted.scene, &of_group.nodes, &light) + of_group.error();
        relit.changed.push((of_group.light_group.clone(), error));
        take_spectra(&mut relit.shown.scene, old, &wanted.scene, new);
    }
    Ok(relit)
}

/// Spectrum of the first light of a group, where that of any of its lights has changed and all have changed alike.
fn new_spectrum(rendered: &Scene, old: usize, wanted: &Scene, new: usize) -> Option<Curve> {
    let (before, after) = (rendered.group_spectra(old), wanted.group_spectra(new));
    let same_number = before.len() == after.len() && !after.is_empty();
    if !same_number || before == after {
        return None;
    }
    // Lights keep their shares of the power of the group
    let share = |lights: &[std::borrow::Cow<'_, Curve>], i: usize| lights[i].total() / lights[0].total();
    let alike = (0..after.len()).all(|i| {
        are_in_proportion(&after[0], &after[i]) && (share(&before, i) / share(&after, i) - 1.0).abs() < 1e-6
    });
    alike.then(|| after[0].clone().into_owned())
}

/// Gives the lights of a group the spectra that those of another scene have.
fn take_spectra(scene: &mut Scene, old: usize, from: &Scene, new: usize) {
    let lights: Vec<&Curve> = from.lights.iter().filter(|l| l.group == new).map(|l| &l.spectrum).collect();
    for (light, spectrum) in scene.lights.iter_mut().filter(|light| light.group == old).zip(lights) {
        light.spectrum = spectrum.clone();
    }
    let surfaces = from.objects.iter().filter_map(|object| object.emission.as_ref());
    let surfaces: Vec<&Curve> = surfaces.filter(|of| of.group == new).map(|of| &of.radiance).collect();
    let own = scene.objects.iter_mut().filter_map(|object| object.emission.as_mut());
    for (emission, radiance) in own.filter(|of| of.group == old).zip(surfaces) {
        emission.radiance = radiance.clone();
    }
}
