//! Figure 6 (a-f): images with a mask of porphyrin. The paper adds a masked porphyrin image to a bulk image; here the mask lies on
//! the tongue, and both are compared.

use std::sync::Arc;

use fluorspar::image::{Component, ComponentImage, FeatureMaps, LightPath};
use fluorspar::material::{ImageTexture, ScalarTexture};
use fluorspar::pipeline::CameraResponse;
use fluorspar::study::Study;

use super::check::{Check, Outcome, Verdict, number};
use super::setup::{PORPHYRIN, Setup, ValidationError};
use fluorspar_report::figures::pictures;
use fluorspar_report::{ColorMap, Figure, Raster};

/// Pixels and paths of the renders.
const PICTURE: [usize; 2] = [120, 90];
const SAMPLES: usize = 32;
/// Texture pixels of the mask.
const MASK: usize = 128;
/// Concentration inside the mask, units of the catalogue.
const AMOUNT: f32 = 0.9;
/// The masked tissue.
const TISSUE: &str = "tongue_dorsum";

/// Electrons of each pixel in R: porphyrin of the recipe and of the scene, and light of all else.
struct Images {
    mask: Vec<f32>,
    recipe: Vec<f64>,
    scene: Vec<f64>,
    bulk: Vec<f64>,
    /// Porphyrin everywhere on the tongue, light that met no other surface before or after.
    direct: Vec<f64>,
    /// The same, all light.
    everywhere: Vec<f64>,
}

pub(super) fn run(setup: &Setup<'_>) -> Result<Outcome, ValidationError> {
    let images = render(setup)?;
    let inside = core(&images.mask);
    let none: Vec<f32> = images.mask.iter().map(|m| f32::from(u8::from(*m == 0.0))).collect();
    let outside = core(&none);
    let sum = |values: &[f64], pixels: &[usize]| pixels.iter().map(|&pixel| values[pixel]).sum::<f64>();
    let excess = sum(&images.recipe, &inside) / sum(&images.scene, &inside) - 1.0;
    let indirect = sum(&images.everywhere, &inside) / sum(&images.direct, &inside) - 1.0;
    let missing =
        sum(&images.scene, &outside) / sum(&images.scene, &(0..images.mask.len()).collect::<Vec<_>>());
    // Both renders take the same paths, so that a pixel's ratio scatters by what differs between pixels only
    let ratios: Vec<f64> = inside.iter().map(|&i| images.recipe[i] / images.scene[i] - 1.0).collect();
    let error = standard_error(&ratios);
    let reason = format!(
        "The recipe (porphyrin image x mask + bulk image) is {} % too bright in porphyrin light inside the mask and leaves out the {} % \
         of it that reach the camera from elsewhere: indirect light of porphyrin that the mask removes is kept, and light it sends to \
         its surroundings is cut off. With the mask on the tongue itself both are right. Masks, mesh and sensor of the \
         paper's images are not public.",
        number(100.0 * excess),
        number(100.0 * missing)
    );
    Ok(Outcome::new(Verdict::Corrected, reason)
        .checks(checks(excess, [3.0 * error, indirect], missing))
        .show("figure_6_masks", figure(&images)))
}

fn checks(excess: f64, [least, most]: [f64; 2], missing: f64) -> [Check; 3] {
    let what = "porphyrin light of the recipe over that of the scene inside the mask, less 1";
    let why = "three standard errors over the pixels: the recipe is too bright";
    let bright = Check::at_least(what, least, excess, "", why);
    let why = "indirect over direct porphyrin light with porphyrin everywhere: the excess is a part of it";
    let bounded = Check::at_most("the same", most, excess, "", why);
    let what = "porphyrin light from outside the mask over all of it, in the scene";
    let around = Check::at_least(what, f64::MIN_POSITIVE, missing, "", "the recipe has none there");
    [bright.said("the rendered image is the masked porphyrin image plus the bulk image"), bounded, around]
}

fn standard_error(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt()
}

/// Pixels wholly in a mask: their neighbors are in it, too.
fn core(mask: &[f32]) -> Vec<usize> {
    let [width, height] = PICTURE;
    let whole = |pixel: usize| mask[pixel] >= 1.0;
    (0..mask.len())
        .filter(|&pixel| {
            let (row, column) = (pixel / width, pixel % width);
            (1..height - 1).contains(&row)
                && (1..width - 1).contains(&column)
                && [pixel, pixel - 1, pixel + 1, pixel - width, pixel + width].into_iter().all(whole)
        })
        .collect()
}

/// A patch in the middle of the back of the tongue: an ellipse in texture coordinates, from the left edge to the right one and from
/// the tip to the root.
fn patch() -> Vec<f32> {
    let texel = |index: usize| {
        let (row, column) = (index / MASK, index % MASK);
        let across = (column as f32 + 0.5) / MASK as f32 - 0.5;
        // Rows run from the root
        let along = 1.0 - (row as f32 + 0.5) / MASK as f32 - 0.38;
        if (across / 0.22).hypot(along / 0.18) < 1.0 { 1.0 } else { 0.0 }
    };
    (0..MASK * MASK).map(texel).collect()
}

fn render(setup: &Setup<'_>) -> Result<Images, ValidationError> {
    let study = setup.mouth(&[
        format!("render.width_px={}", PICTURE[0]),
        format!("render.height_px={}", PICTURE[1]),
        format!("render.samples_per_pixel={SAMPLES}"),
        "mouth.detail=0.4".to_owned(),
    ])?;
    let image = ImageTexture::new(MASK, MASK, patch()).map_err(|_| ValidationError::Lacks("mask"))?;
    let mask = ScalarTexture::Image { image: Arc::new(image), low: 0.0, high: AMOUNT };
    let uniform = with_porphyrin(&study, &ScalarTexture::Constant(AMOUNT))?;
    let mut shallow = uniform.clone();
    shallow.render.max_depth = 1;
    let (everywhere, direct) = (setup.render(&uniform)?, setup.render(&shallow)?);
    let scene = setup.render(&with_porphyrin(&study, &mask)?)?;

    let red = RedChannel::new(&study)?;
    let mask = mask_of_pixels(&scene.features, &mask);
    let everywhere = red.electrons(&everywhere, is_porphyrin);
    Ok(Images {
        recipe: everywhere.iter().zip(&mask).map(|(light, m)| light * f64::from(*m)).collect(),
        scene: red.electrons(&scene, is_porphyrin),
        bulk: red.electrons(&scene, |component| component.light_group == "blue" && !is_porphyrin(component)),
        direct: red.electrons(&direct, is_porphyrin),
        everywhere,
        mask,
    })
}

fn is_porphyrin(component: &Component) -> bool {
    component.light_group == "blue" && component.light == LightPath::Fluorescence(PORPHYRIN.into())
}

/// What the red channel collects.
struct RedChannel {
    camera: CameraResponse,
    channel: usize,
}

impl RedChannel {
    fn new(study: &Study) -> Result<Self, ValidationError> {
        let lens = study.camera.lens_behind_filters().ok_or(ValidationError::Lacks("lens"))?;
        let sensor = study.camera.sensor.as_ref().ok_or(ValidationError::Lacks("sensor"))?;
        let camera = CameraResponse::new(&lens, sensor, &study.scene.grid, None);
        let channel = camera.rgb().ok_or(ValidationError::Lacks("channel R, G or B"))?[0];
        Ok(Self { camera, channel })
    }

    /// Electrons of each pixel from some components, e-, in 30 ms.
    fn electrons(&self, image: &ComponentImage, wanted: impl Fn(&Component) -> bool) -> Vec<f64> {
        let sum = image.recombine(|component| f64::from(u8::from(wanted(component))));
        let spectra = sum.data().chunks_exact(sum.bands());
        let radiance = spectra.map(|pixel| pixel.iter().map(|v| f64::from(*v)).collect::<Vec<f64>>());
        radiance.map(|radiance| self.camera.channel_electrons(self.channel, &radiance, 0.03)).collect()
    }
}

/// The mask that pixels are multiplied with: that of the point at the center of each.
fn mask_of_pixels(features: &FeatureMaps, mask: &ScalarTexture) -> Vec<f32> {
    let at = |pixel: usize| {
        let part = usize::from(features.part[pixel]).checked_sub(1);
        let tissue = part.and_then(|part| features.material_names.get(part));
        let value = mask.at(features.uv[pixel].into()) / AMOUNT;
        if tissue.is_some_and(|name| name == TISSUE) { value } else { 0.0 }
    };
    (0..features.part.len()).map(at).collect()
}

/// The study with this porphyrin on the tongue and none elsewhere.
fn with_porphyrin(study: &Study, concentration: &ScalarTexture) -> Result<Study, ValidationError> {
    let mut study = study.clone();
    let scene = &mut study.scene;
    let porphyrin = scene.fluorophores.iter().position(|fluorophore| fluorophore.name == PORPHYRIN);
    let porphyrin = porphyrin.ok_or(ValidationError::Lacks("porphyrin"))?;
    for material in &mut scene.materials {
        let on_tongue = material.name == TISSUE;
        for amount in material.fluorophores.iter_mut().filter(|amount| amount.fluorophore == porphyrin) {
            amount.concentration =
                if on_tongue { concentration.clone() } else { ScalarTexture::Constant(0.0) };
        }
    }
    Ok(study)
}

fn figure(images: &Images) -> Figure {
    let [width, height] = PICTURE;
    let total = |porphyrin: &[f64]| -> Vec<f64> {
        porphyrin.iter().zip(&images.bulk).map(|(porphyrin, bulk)| porphyrin + bulk).collect()
    };
    let (recipe, scene) = (total(&images.recipe), total(&images.scene));
    let white = white_level(&scene);
    let gray = |values: &[f64]| {
        Raster::from_fn(width, height, |row, column| {
            let share = (values[row * width + column] / white).clamp(0.0, 1.0);
            [(255.0 * share.powf(1.0 / 2.2)) as u8; 3]
        })
    };
    // From -3 % to 3 % of the brightness
    let difference = Raster::from_fn(width, height, |row, column| {
        let pixel = row * width + column;
        ColorMap::Viridis.color(0.5 + (recipe[pixel] / scene[pixel].max(1e-9) - 1.0) / 0.06)
    });
    let shown = vec![
        ("red channel, the paper's recipe".to_owned(), gray(&recipe)),
        ("red channel, mask on the tongue".to_owned(), gray(&scene)),
        ("recipe over scene, -3 % to +3 %".to_owned(), difference),
    ];
    pictures("A mask of porphyrin: recipe and scene", shown, 3).explained(
        "First: the porphyrin image, rendered with porphyrin everywhere on the tongue, times the mask, plus the bulk image, as in the \
         paper. Second: the mask is the concentration on the tongue, and light goes between its parts. Third: their ratio; yellow \
         is too bright, violet too dark. Inside the mask the recipe keeps light of porphyrin that is no longer there; around \
         it the light is missing that the masked porphyrin sends out.",
    )
}

/// What is shown white: all but the brightest two of a hundred values are below.
fn white_level(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() * 98 / 100).copied().unwrap_or(1.0).max(f64::MIN_POSITIVE)
}
