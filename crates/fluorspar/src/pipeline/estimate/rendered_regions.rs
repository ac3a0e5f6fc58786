//! Regions of renders as the design of a camera takes them.

use crate::analysis::{RegionError, RegionOfInterest, SceneOnSensor};
use crate::design::{RegionModel, RegionResponse};
use crate::geometry::OrientedPoint;
use crate::image::{ComponentImage, GroupBasis};
use crate::optics::Vignetting;
use crate::scene::irradiance::direct_irradiance;
use crate::study::Study;

/// Share of the fluorescence of a region below which a fluorophore is not its own, but thrown on it by what is around.
const OWN_SHARE: f64 = 0.01;
/// Pixels of a region, at most about, whose irradiance is looked at.
const LIT_PIXELS: usize = 256;

/// A render with an excitation basis, of which regions are taken.
#[derive(Clone, Copy, Debug)]
pub struct BasisRender<'a> {
    /// The study that was rendered.
    pub study: &'a Study,
    /// The image, of which only labels and features count.
    pub image: &'a ComponentImage,
    /// The light group whose place the lights of a design take.
    pub group: &'a GroupBasis,
}

/// A region as each of some renders shows it, in their order. The weights are those of the fluorophores that send a hundredth of its
/// fluorescence or more in one of them; what else it sends is shared among these ([`RegionResponse::with_weights_of`]), and each counts
/// by its light ([`RegionResponse::counted_by_light`]). Pixels count by how much of their light arrives on the film: by the cosine fourth
/// law, unless the lens of the study has no vignetting.
///
/// # Errors
/// A region that a render does not show.
pub fn rendered_regions(
    name: &str,
    region: &RegionOfInterest,
    renders: &[BasisRender<'_>],
) -> Result<Vec<RegionModel>, RegionError> {
    let mut found = Vec::new();
    for render in renders {
        found.push(whole_region(name, region, render)?);
    }
    let mut own: Vec<String> = Vec::new();
    let first = found.first().map_or(1, |region| region.pixels).max(1) as f64;
    for WholeRegion { response, .. } in &found {
        let new = response.own_fluorophores(OWN_SHARE);
        own.extend(new.into_iter().filter(|name| !own.contains(name)).collect::<Vec<_>>());
    }
    let model = |WholeRegion { response, irradiance_per_w, pixels }: WholeRegion| {
        let response = response.with_weights_of(&own).counted_by_light();
        let pixel_share = pixels as f64 / first;
        RegionModel { pixel_share, ..RegionModel::rendered(response, irradiance_per_w) }
    };
    Ok(found.into_iter().map(model).collect())
}

/// All that a region sends.
struct WholeRegion {
    response: RegionResponse,
    /// Its largest irradiance for each watt of the first light of the group, W/m².
    irradiance_per_w: f64,
    /// Pixels of the render that show it.
    pixels: usize,
}

fn whole_region(
    name: &str,
    region: &RegionOfInterest,
    render: &BasisRender<'_>,
) -> Result<WholeRegion, RegionError> {
    let (image, camera) = (render.image, &render.study.scene.camera);
    let selected = region.select(image.width, image.height, Some(SceneOnSensor::filling(image)))?.pixels;
    let has_falloff = match &render.study.camera.lens {
        Some(lens) => lens.equation.vignetting == Vignetting::Cos4,
        None => true,
    };
    let ray =
        |pixel: usize| camera.ray((pixel % image.width) as f32 + 0.5, (pixel / image.width) as f32 + 0.5);
    let weight = |pixel: usize| {
        let cosine = if has_falloff { f64::from(ray(pixel).1.dot(camera.forward)) } else { 1.0 };
        (pixel, cosine.powi(4))
    };
    let pixels: Vec<(usize, f64)> = selected.iter().map(|&pixel| weight(pixel)).collect();
    let response = RegionResponse::of_render(name, &image.grid, render.group, &pixels);
    let points = selected.iter().step_by(selected.len().div_ceil(LIT_PIXELS).max(1)).filter_map(|&pixel| {
        let (origin, direction) = ray(pixel);
        let depth = image.features.depth_m.get(pixel).filter(|depth| depth.is_finite())?;
        let normal = glam::Vec3::from_array(*image.features.normal.get(pixel)?).as_dvec3().try_normalize()?;
        Some(OrientedPoint { position: (origin + direction * *depth).as_dvec3(), normal })
    });
    let irradiance_per_w = points.map(|point| group_irradiance_per_w(render, point)).fold(0.0, f64::max);
    Ok(WholeRegion { response, irradiance_per_w, pixels: selected.len() })
}

/// Irradiance of a point by the group, unshaded, for each watt of its first light.
fn group_irradiance_per_w(render: &BasisRender<'_>, point: OrientedPoint) -> f64 {
    let scene = &render.study.scene;
    let named = scene.light_groups.iter().position(|group| group.name == render.group.light_group);
    let Some(group) = named else { return 0.0 };
    let first = scene.group_spectra(group).first().map_or(0.0, |spectrum| spectrum.total());
    let parts = direct_irradiance(scene, &[point]);
    let of_group = parts.iter().filter(|part| part.group == group);
    of_group.map(|part| part.factor * part.spectrum.total()).sum::<f64>() / first.max(f64::MIN_POSITIVE)
}
