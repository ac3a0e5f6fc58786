//! Memory estimates of a render, before it starts.

use fluorspar_accel::memory_is_available;

use super::component_labels::component_labels;
use super::error::RenderError;
use super::settings::{ComponentBands, RenderSettings};
use crate::image::StatisticsKind;
use crate::image::film::{TILE, film_bytes};
use crate::material::Material;
use crate::scene::{Object, Scene, Shape};

/// Coefficients of a component as mouths were seen to need them.
const USUAL_COEFFICIENTS: usize = 11;

/// Memory that a render's images need, bytes: the film, from which the result is made in place. With bases of components, which a pilot
/// finds, as much as mouths were seen to need.
pub fn memory_bytes(scene: &Scene, settings: &RenderSettings) -> u64 {
    let groups = settings.spectrum_number(scene.light_groups.len());
    let components = groups * (scene.fluorophores.len() + 2);
    let planes = components
        + 2 * match settings.film_statistics() {
            StatisticsKind::None => 0,
            StatisticsKind::LightGroups => groups,
            StatisticsKind::Components => components,
        };
    let bands = match settings.film_bands() {
        ComponentBands::All => scene.grid.len(),
        ComponentBands::Basis => scene.grid.len().min(USUAL_COEFFICIENTS),
    };
    film_bytes(scene.camera.width, scene.camera.height, bands * planes)
}

/// Memory of what a render with an excitation basis keeps of the whole image besides the film, bytes: the image under the lights as
/// they are, and about as many spectra of each component as mouths were seen to need. Nothing without a basis.
pub fn basis_bytes(scene: &Scene, settings: &RenderSettings) -> u64 {
    const SPECTRA: u64 = 32;
    let Some(basis) = &settings.excitation_basis else { return 0 };
    let kinds = scene.fluorophores.len() + 2;
    let own = scene.light_groups.len() * kinds;
    let (width, height) = (scene.camera.width, scene.camera.height);
    let image = film_bytes(width, height, scene.grid.len() * own) / 2;
    image + 4 * SPECTRA * (basis.groups.len() * kinds * width * height) as u64
}

/// Memory of what belongs to the whole image when it is rendered some rows at a time, bytes: feature maps, materials and
/// numbers of samples of all pixels.
pub fn whole_image_bytes(scene: &Scene) -> u64 {
    const PER_PIXEL: u64 = 4 + 12 + 2 + 8 + 2 + 4;
    PER_PIXEL * scene.camera.width as u64 * scene.camera.height as u64
}

/// Memory of the film of one row of tiles, bytes.
pub fn tile_row_bytes(scene: &Scene, settings: &RenderSettings) -> u64 {
    let height = scene.camera.height.max(1);
    let rows = height.div_ceil(TILE.min(height)) as u64;
    memory_bytes(scene, settings) / rows
}

/// Memory that preparing the surfaces takes at its peak, bytes, estimated from their numbers: vertices, triangles and the tree,
/// and what building the tree takes beside them. Ten million triangles of a scan were seen to take 3.2 GB.
pub fn surface_bytes(scene: &Scene) -> u64 {
    const PER_TRIANGLE: u64 = 320;
    const PER_INSTANCE: u64 = 320;
    let of_object = |object: &Object| match &object.shape {
        Shape::Mesh(mesh) => PER_TRIANGLE * mesh.triangles.len() as u64,
        Shape::Instances(many) => {
            let kept: u64 = many.meshes.iter().map(|mesh| mesh.triangles.len() as u64).sum();
            PER_TRIANGLE * kept + PER_INSTANCE * many.instances.len() as u64
        }
        Shape::Sphere { .. } | Shape::Disc { .. } => 0,
    };
    let of_surfaces: u64 = scene.objects.iter().map(of_object).sum();
    of_surfaces + scene.materials.iter().map(tissue_bytes).sum::<u64>()
}

/// Memory of the solved states of layered tissue, bytes, as measured.
fn tissue_bytes(material: &Material) -> u64 {
    const PER_STATE: u64 = 640 << 10;
    let terms =
        material.fluorophores.iter().filter_map(|amount| amount.in_tissue.as_ref().map(|held| held.term));
    let states = terms.max().map_or(0, |last| last as u64 + 1);
    PER_STATE * states
}

/// Asks the system for the memory of images and surfaces before anything is made.
pub(super) fn request_memory(scene: &Scene, image_bytes: u64) -> Result<(), RenderError> {
    let surface_bytes = surface_bytes(scene);
    if memory_is_available(image_bytes.saturating_add(surface_bytes)) {
        return Ok(());
    }
    Err(RenderError::NoMemory {
        image_bytes,
        surface_bytes,
        width: scene.camera.width,
        height: scene.camera.height,
        bands: scene.grid.len(),
    })
}

/// Refuses films that are larger than the memory limit.
pub(super) fn check_memory(scene: &Scene, settings: &RenderSettings) -> Result<(), RenderError> {
    let needed = memory_bytes(scene, settings);
    if needed > settings.memory_limit_bytes {
        return Err(RenderError::TooLarge {
            needed_bytes: needed,
            limit_bytes: settings.memory_limit_bytes,
            components: component_labels(scene, settings).len(),
            width: scene.camera.width,
            height: scene.camera.height,
            bands: scene.grid.len(),
        });
    }
    Ok(())
}
