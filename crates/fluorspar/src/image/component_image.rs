//! The result of a render: radiance by light group and fluorescence event.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{ComponentFactors, SpectralBasis, SpectralImage};
use crate::spectral::{Radiance, WavelengthGrid};

/// Pixels whose spectra are formed at once: what they add up to stays in the cache.
const AT_ONCE: usize = 1024;

/// Which light paths a component holds, by their fluorescence events.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LightPath {
    /// LightPath that never fluoresced (R).
    Reflected,
    /// LightPath whose one fluorescence event was in the named fluorophore.
    Fluorescence(String),
    /// LightPath that fluoresced more than once.
    MultipleFluorescence,
}

/// Label of one component: which light excited it and what happened to it.
///
/// In files, light group and excitation node are one name: [`Component::group_label`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ComponentText", into = "ComponentText")]
pub struct Component {
    /// Name of the light group in the scene.
    pub light_group: String,
    /// Excitation node, nm, whose hat function excites instead of the spectrum of the group, where a render keeps nodes apart.
    pub node_nm: Option<f64>,
    /// Light path: reflected, or its fluorescence events.
    pub light: LightPath,
}

impl Component {
    /// A component that all light of a group excites.
    ///
    /// ```
    /// use fluorspar::image::{Component, LightPath};
    ///
    /// let elastin = Component::of_group("blue", LightPath::Fluorescence("elastin".into()));
    /// assert_eq!(elastin.label(), "blue.fluorescence.elastin");
    /// ```
    pub fn of_group(light_group: &str, light: LightPath) -> Self {
        Self { light_group: light_group.into(), node_nm: None, light }
    }

    /// Name of the light group with the excitation node, if any, as in files: `blue@405nm`.
    pub fn group_label(&self) -> String {
        let group = &self.light_group;
        self.node_nm.map_or_else(|| group.clone(), |nm| format!("{group}@{nm}nm"))
    }

    /// `group.reflected`, `group.fluorescence.NAME` or `group.multiple`: used for file layers and tables.
    pub fn label(&self) -> String {
        match &self.light {
            LightPath::Reflected => format!("{}.reflected", self.group_label()),
            LightPath::Fluorescence(name) => format!("{}.fluorescence.{name}", self.group_label()),
            LightPath::MultipleFluorescence => format!("{}.multiple", self.group_label()),
        }
    }
}

/// A component as it is written to files: its excitation node is part of the group's name.
#[derive(Serialize, Deserialize)]
struct ComponentText {
    light_group: String,
    light: LightPath,
}

impl From<Component> for ComponentText {
    fn from(component: Component) -> Self {
        Self { light_group: component.group_label(), light: component.light }
    }
}

impl TryFrom<ComponentText> for Component {
    type Error = String;

    /// Names without a node are those of light groups.
    fn try_from(ComponentText { light_group, light }: ComponentText) -> Result<Self, String> {
        let Some((group, part)) = light_group.rsplit_once('@') else {
            return Ok(Self { light_group, node_nm: None, light });
        };
        if let Some(nm) = part.strip_suffix("nm").and_then(|nm| nm.parse().ok()) {
            return Ok(Self { light_group: group.into(), node_nm: Some(nm), light });
        }
        let is_number = |text: &str| text.parse::<f64>().is_ok();
        let is_bin = part.split_once('-').is_some_and(|(first, last)| is_number(first) && is_number(last));
        if part == "rest" || is_bin {
            return Err(format!(
                "\"{light_group}\" is an excitation bin, which renders no longer have; render again with excitation_basis_nm"
            ));
        }
        Ok(Self { light_group, node_nm: None, light })
    }
}

/// Where a radiance image was seen from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// Position of the entrance pupil, m.
    pub position_m: [f32; 3],
    /// Unit vector along the optical axis.
    pub forward: [f32; 3],
    /// Unit vector to the right of the image.
    pub right: [f32; 3],
    /// Tangent of half the horizontal field of view.
    pub tan_half_width: f32,
}

impl View {
    /// Camera matrix of an image of this size: `[u, v, 1]` is its product with `[right, down, forward]` over `forward`, with `u` and `v`
    /// in pixels from the middle of the upper left one.
    pub fn matrix_px(&self, width: usize, height: usize) -> [[f64; 3]; 3] {
        let focal = 0.5 * width as f64 / f64::from(self.tan_half_width);
        let middle = |pixels: usize| 0.5 * (pixels as f64 - 1.0);
        [[focal, 0.0, middle(width)], [0.0, focal, middle(height)], [0.0, 0.0, 1.0]]
    }
}

/// Geometry seen by each pixel's center, `[row, col]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FeatureMaps {
    /// Distance along the camera ray, m; infinite where nothing is seen.
    pub depth_m: Vec<f32>,
    /// Shading normal in world coordinates; zero where nothing is seen.
    pub normal: Vec<[f32; 3]>,
    /// Index into `part_names` plus one; 0 where nothing is seen.
    pub part: Vec<u16>,
    /// Texture coordinates; zero where there are none.
    pub uv: Vec<[f32; 2]>,
    /// Names of the scene's objects.
    pub part_names: Vec<String>,
    /// Name of the material of each object, same order as `part_names`.
    pub material_names: Vec<String>,
    /// The camera; none where it is not known.
    pub view: Option<View>,
}

impl FeatureMaps {
    /// Distance along the optical axis of what an image `width` pixels wide sees, m: its median over the pixels that see something.
    pub fn median_distance_m(&self, width: usize) -> Option<f64> {
        let view = self.view?;
        let height = self.depth_m.len() / width.max(1);
        let [[focal, _, u], [_, _, v], _] = view.matrix_px(width, height);
        let along = |(pixel, depth): (usize, &f32)| {
            let [x, y] = [(pixel % width) as f64 - u, (pixel / width) as f64 - v];
            f64::from(*depth) / (1.0 + (x * x + y * y) / (focal * focal)).sqrt()
        };
        let mut seen: Vec<f64> =
            self.depth_m.iter().enumerate().map(along).filter(|distance| distance.is_finite()).collect();
        let middle = seen.len().checked_sub(1)? / 2;
        Some(*seen.select_nth_unstable_by(middle, f64::total_cmp).1)
    }
}

/// How the spectra of each component are stored: as coefficients on a basis, or all bands.
pub type ComponentBases = Vec<Option<Arc<SpectralBasis>>>;

/// Radiance images kept apart by component, `[component, row, col, band]`, W/(sr m² nm), at the rendered powers
/// and concentrations. Their plain sum is the radiance that a camera would see with all light groups on.
#[derive(Clone, Debug, PartialEq)]
pub struct ComponentImage {
    /// The wavelength grid.
    pub grid: WavelengthGrid,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Label of each component.
    pub components: Vec<Component>,
    /// Of each component its basis; empty where all bands of all are stored.
    pub bases: ComponentBases,
    /// `[component, row, col, coefficient]`.
    pub data: Vec<f32>,
    /// Paths averaged per pixel; the fewest of any pixel where they differ.
    pub samples_per_pixel: u32,
    /// Paths averaged in each pixel, `[row, col]`; empty where all have `samples_per_pixel`.
    pub samples: Vec<u32>,
    /// Geometry behind each pixel.
    pub features: FeatureMaps,
    /// How far the samples scatter, where the render kept that.
    pub statistics: Option<SampleStatistics>,
    /// Settings of the noise reduction, JSON, if the image went through one: such an image proves nothing.
    pub denoised: Option<String>,
}

/// Sums whose statistics a render keeps besides the components.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum StatisticsKind {
    /// None.
    #[default]
    None,
    /// The sum of each light group.
    LightGroups,
    /// Every component.
    Components,
}

/// Two half-buffers and the variance of the mean, `[statistic, row, col, band]`.
///
/// The halves are the means over even and over odd blocks of samples (see [`crate::image::Film`]); they hold about
/// equally many samples. The variance comes from the scatter of the blocks: samples of one pixel are stratified
/// against each other, so it is an upper bound on average, not an unbiased estimate. Infinite below two samples.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleStatistics {
    /// Which sums these are.
    pub of: StatisticsKind,
    /// Name of each light group, or label of each component.
    pub names: Vec<String>,
    /// Mean of the first half, W/(sr m² nm).
    pub half_a: Vec<f32>,
    /// Mean of the second half, W/(sr m² nm).
    pub half_b: Vec<f32>,
    /// Variance of the mean of all samples, (W/(sr m² nm))².
    pub variance: Vec<f32>,
}

impl ComponentImage {
    /// A black image of all bands.
    pub fn zeros(grid: WavelengthGrid, width: usize, height: usize, components: Vec<Component>) -> Self {
        let data = vec![0.0; components.len() * width * height * grid.len()];
        Self {
            grid,
            width,
            height,
            components,
            bases: Vec::new(),
            data,
            samples_per_pixel: 0,
            samples: Vec::new(),
            features: FeatureMaps::default(),
            statistics: None,
            denoised: None,
        }
    }

    /// The basis of a component that is not stored with all bands.
    pub fn basis(&self, component: usize) -> Option<&SpectralBasis> {
        self.bases.get(component)?.as_deref()
    }

    /// Values that a pixel of a component is stored with.
    pub fn values_per_pixel(&self, component: usize) -> usize {
        self.basis(component).map_or(self.grid.len(), |basis| basis.len())
    }

    /// Values that the whole image is stored with.
    pub fn stored_values(&self) -> usize {
        let per_pixel: usize =
            (0..self.components.len()).map(|component| self.values_per_pixel(component)).sum();
        self.width * self.height * per_pixel
    }

    fn range(&self, component: usize) -> Range<usize> {
        let before: usize = (0..component).map(|component| self.values_per_pixel(component)).sum();
        let pixels = self.width * self.height;
        pixels * before..pixels * (before + self.values_per_pixel(component))
    }

    /// Values of one component as they are stored, `[row, col, coefficient]`.
    pub fn stored(&self, component: usize) -> &[f32] {
        &self.data[self.range(component)]
    }

    /// Values of one component as they are stored, to be changed.
    pub fn stored_mut(&mut self, component: usize) -> &mut [f32] {
        let range = self.range(component);
        &mut self.data[range]
    }

    /// Values of one component, `[row, col, band]`.
    pub fn component(&self, component: usize) -> Cow<'_, [f32]> {
        let stored = self.stored(component);
        let Some(basis) = self.basis(component) else { return Cow::Borrowed(stored) };
        let (bands, len) = (self.grid.len().max(1), basis.len().max(1));
        let mut values = vec![0.0; self.width * self.height * self.grid.len()];
        let parts = values.par_chunks_mut(AT_ONCE * bands).zip(stored.par_chunks(AT_ONCE * len));
        parts.for_each(|(out, stored)| add_spectra(basis, 1.0, stored, out, bands));
        Cow::Owned(values)
    }

    /// All bands of one pixel of a component.
    pub fn spectrum(&self, component: usize, pixel: usize) -> Cow<'_, [f32]> {
        let len = self.values_per_pixel(component);
        let stored = &self.stored(component)[pixel * len..][..len];
        let Some(basis) = self.basis(component) else { return Cow::Borrowed(stored) };
        let mut spectrum = vec![0.0; self.grid.len()];
        basis.add(1.0, stored, &mut spectrum);
        Cow::Owned(spectrum)
    }

    /// Values of all bands of all components, `[component, row, col, band]`.
    pub fn all_values(&self) -> Cow<'_, [f32]> {
        if self.bases.iter().all(Option::is_none) {
            return Cow::Borrowed(&self.data);
        }
        (0..self.components.len()).flat_map(|component| self.component(component).into_owned()).collect()
    }

    /// Number of the component with this label.
    pub fn find(&self, label: &Component) -> Option<usize> {
        self.components.iter().position(|c| c == label)
    }

    /// Names of the light groups in the scene, in order of first use.
    pub fn light_groups(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        for component in &self.components {
            if !names.contains(&component.light_group) {
                names.push(component.light_group.clone());
            }
        }
        names
    }

    /// Multiplies the values of each component. Statistics of the samples do not follow, and are dropped.
    pub fn scale(&mut self, factors: &ComponentFactors) {
        for component in 0..self.components.len() {
            let (len, range) = (self.values_per_pixel(component), self.range(component));
            for (pixel, spectrum) in self.data[range].chunks_mut(len.max(1)).enumerate() {
                let factor = factors.at(component, pixel);
                if factor != 1.0 {
                    spectrum.iter_mut().for_each(|value| *value = (factor * f64::from(*value)) as f32);
                }
            }
        }
        self.statistics = None;
    }

    /// `sum weight(component) * component`: any change of drive current or (to first order) concentration.
    /// A component whose weight is zero is skipped.
    pub fn recombine(&self, weight: impl Fn(&Component) -> f64) -> SpectralImage<Radiance> {
        let bands = self.grid.len().max(1);
        let mut image = SpectralImage::zeros(self.grid.clone(), self.width, self.height);
        let factors: Vec<f32> = self.components.iter().map(|component| weight(component) as f32).collect();
        let chunks = image.data_mut().par_chunks_mut(AT_ONCE * bands).enumerate();
        chunks.for_each(|(chunk, out)| {
            let lit = factors.iter().enumerate().filter(|(_, factor)| **factor != 0.0);
            for (component, &factor) in lit {
                let len = self.values_per_pixel(component);
                let first = chunk * AT_ONCE * len;
                let stored = &self.stored(component)[first..first + out.len() / bands * len];
                match self.basis(component) {
                    Some(basis) => add_spectra(basis, factor, stored, out, bands),
                    None => out.iter_mut().zip(stored).for_each(|(sum, value)| *sum += factor * value),
                }
            }
        });
        image
    }

    /// Rounds every value, features included, as component files of runs keep them, so that what is made of the image now and what is
    /// made of the file are the same to the last bit: to 24 bits (a relative error of at most 1.5e-5), and the coefficients of a
    /// basis to steps that those of a pixel share ([`SpectralBasis`]).
    pub fn round_as_stored(&mut self) {
        let features = &mut self.features;
        let normals = features.normal.as_flattened_mut().iter_mut();
        let uv = features.uv.as_flattened_mut().iter_mut();
        round_to_24_bits(features.depth_m.iter_mut().chain(normals).chain(uv));
        for component in 0..self.components.len() {
            let (range, len) = (self.range(component), self.values_per_pixel(component).max(1));
            let basis = self.bases.get(component).cloned().flatten();
            let chunks = self.data[range].par_chunks_mut(len << 12);
            chunks.for_each(|values| {
                if let Some(basis) = &basis {
                    values.chunks_exact_mut(len).for_each(|pixel| basis.round(pixel, 1));
                }
                round_to_24_bits(values);
            });
        }
    }

    /// Everything that one light group excites.
    pub fn light_group(&self, name: &str) -> SpectralImage<Radiance> {
        self.recombine(|component| if component.light_group == name { 1.0 } else { 0.0 })
    }
}

/// Adds all bands of pixels `[pixel][coefficient]` times a factor to `[pixel][band]`.
fn add_spectra(basis: &SpectralBasis, factor: f32, stored: &[f32], out: &mut [f32], bands: usize) {
    let pixels = out.chunks_exact_mut(bands).zip(stored.chunks_exact(basis.len().max(1)));
    pixels.for_each(|(out, stored)| basis.add(factor, stored, out));
}

/// Rounds values to 24 bits: 15 of the mantissa.
pub(super) fn round_to_24_bits<'a>(values: impl IntoIterator<Item = &'a mut f32>) {
    for value in values {
        let rounded = f32::from_bits((value.to_bits().saturating_add(0x80)) & !0xff);
        // Rounding up must not make the largest numbers infinite; infinite depth stays.
        *value = if rounded.is_finite() || value.is_infinite() {
            rounded
        } else {
            f32::from_bits(value.to_bits() & !0xff)
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn excitation_nodes_are_part_of_the_group_in_files() {
        for (node_nm, name) in [(None, "blue"), (Some(402.5), "blue@402.5nm")] {
            let component = Component { node_nm, ..Component::of_group("blue", LightPath::Reflected) };
            let text = serde_json::to_string(&component).unwrap();
            assert_eq!(text, format!(r#"{{"light_group":"{name}","light":"reflected"}}"#));
            assert_eq!(serde_json::from_str::<Component>(&text).unwrap(), component);
        }
        // A name that only looks like one with a node
        let named = Component::of_group("blue@night", LightPath::Reflected);
        let text = serde_json::to_string(&named).unwrap();
        assert_eq!(serde_json::from_str::<Component>(&text).unwrap(), named);
        for bin in ["380-390.5", "rest"] {
            let text = format!(r#"{{"light_group":"blue@{bin}","light":"reflected"}}"#);
            let said = serde_json::from_str::<Component>(&text).unwrap_err().to_string();
            assert!(said.contains("render again with excitation_basis_nm"), "{said}");
        }
    }

    #[test]
    fn rounding_keeps_15_bits_of_mantissa() {
        let labels = vec![Component::of_group("blue", LightPath::Reflected)];
        let mut image = ComponentImage::zeros(WavelengthGrid::default(), 1, 1, labels);
        let values = [0.0, 1.0, -1.0, 1.234_567_8, 7.654_321e-20, 1e-42, f32::MAX, -f32::MAX];
        image.data[..values.len()].copy_from_slice(&values);
        image.features.depth_m = vec![0.123_456_79, f32::INFINITY];
        image.features.normal = vec![[0.577_350_3; 3]];
        image.round_as_stored();
        let features = &image.features;
        assert!(features.depth_m[0].to_bits() & 0xff == 0 && features.depth_m[1] == f32::INFINITY);
        assert!(features.normal[0][0].to_bits() & 0xff == 0);
        let once = image.clone();
        for (rounded, value) in image.data.iter().zip(values) {
            assert_eq!(rounded.to_bits() & 0xff, 0, "{value}");
            assert!((rounded - value).abs() <= 1.6e-5 * value.abs() + 1e-42, "{value}: {rounded}");
        }
        image.round_as_stored();
        assert_eq!(image, once);
    }
}
