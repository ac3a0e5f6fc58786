//! What a render produces: radiance kept apart by light group and by fluorescence event.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::SpectralImage;
use crate::spectral::{Radiance, WavelengthGrid};

/// What kind of light a component holds.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Light {
    /// Light that never fluoresced (R).
    Reflected,
    /// Light whose one fluorescence event was in the named fluorophore.
    Fluorescence(String),
    /// Light that fluoresced more than once.
    MultipleFluorescence,
}

/// Label of one component: which light group excited it and what happened to it.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Component {
    /// Name of the light group.
    pub light_group: String,
    /// What happened to the light.
    pub light: Light,
}

impl Component {
    /// `group.reflected`, `group.fluorescence.NAME` or `group.multiple`: used for file layers and tables.
    pub fn label(&self) -> String {
        match &self.light {
            Light::Reflected => format!("{}.reflected", self.light_group),
            Light::Fluorescence(name) => format!("{}.fluorescence.{name}", self.light_group),
            Light::MultipleFluorescence => format!("{}.multiple", self.light_group),
        }
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

/// Geometry seen by each pixel's centre, `[row, col]`.
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
    /// `[component, row, col, band]`.
    pub data: Vec<f32>,
    /// Paths averaged per pixel.
    pub samples_per_pixel: u32,
    /// Geometry behind each pixel.
    pub features: FeatureMaps,
}

impl ComponentImage {
    /// A black image.
    pub fn zeros(grid: WavelengthGrid, width: usize, height: usize, components: Vec<Component>) -> Self {
        let data = vec![0.0; components.len() * width * height * grid.len()];
        Self { grid, width, height, components, data, samples_per_pixel: 0, features: FeatureMaps::default() }
    }

    fn range(&self, component: usize) -> Range<usize> {
        let len = self.width * self.height * self.grid.len();
        component * len..(component + 1) * len
    }

    /// Values of one component, `[row, col, band]`.
    pub fn component(&self, component: usize) -> &[f32] {
        &self.data[self.range(component)]
    }

    /// Number of the component with this label.
    pub fn find(&self, label: &Component) -> Option<usize> {
        self.components.iter().position(|c| c == label)
    }

    /// Names of all light groups, in order of first use.
    pub fn light_groups(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        for component in &self.components {
            if !names.contains(&component.light_group) {
                names.push(component.light_group.clone());
            }
        }
        names
    }

    /// `sum weight(component) * component`: any change of drive current or (to first order) concentration.
    /// A component whose weight is zero is skipped.
    pub fn recombine(&self, weight: impl Fn(&Component) -> f64) -> SpectralImage<Radiance> {
        let mut image = SpectralImage::zeros(self.grid.clone(), self.width, self.height);
        for (index, component) in self.components.iter().enumerate() {
            let factor = weight(component) as f32;
            if factor == 0.0 {
                continue;
            }
            for (sum, value) in image.data_mut().iter_mut().zip(self.component(index)) {
                *sum += factor * value;
            }
        }
        image
    }

    /// Rounds every value, features included, to the 24 bits that component files of runs keep (a relative error of at most
    /// 1.5e-5), so that what is made of the image now and what is made of the file are the same to the last bit.
    pub fn round_to_24_bits(&mut self) {
        let features = &mut self.features;
        let normals = features.normal.as_flattened_mut().iter_mut();
        let uv = features.uv.as_flattened_mut().iter_mut();
        for value in self.data.iter_mut().chain(&mut features.depth_m).chain(normals).chain(uv) {
            let rounded = f32::from_bits((value.to_bits().saturating_add(0x80)) & !0xff);
            // Rounding up must not make the largest numbers infinite; infinite depth stays.
            *value = if rounded.is_finite() || value.is_infinite() {
                rounded
            } else {
                f32::from_bits(value.to_bits() & !0xff)
            };
        }
    }

    /// Everything that one light group excites.
    pub fn light_group(&self, name: &str) -> SpectralImage<Radiance> {
        self.recombine(|component| if component.light_group == name { 1.0 } else { 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_keeps_15_bits_of_mantissa() {
        let labels = vec![Component { light_group: "blue".into(), light: Light::Reflected }];
        let mut image = ComponentImage::zeros(WavelengthGrid::default(), 1, 1, labels);
        let values = [0.0, 1.0, -1.0, 1.234_567_8, 7.654_321e-20, 1e-42, f32::MAX, -f32::MAX];
        image.data[..values.len()].copy_from_slice(&values);
        image.features.depth_m = vec![0.123_456_79, f32::INFINITY];
        image.features.normal = vec![[0.577_350_3; 3]];
        image.round_to_24_bits();
        let features = &image.features;
        assert!(features.depth_m[0].to_bits() & 0xff == 0 && features.depth_m[1] == f32::INFINITY);
        assert!(features.normal[0][0].to_bits() & 0xff == 0);
        let once = image.clone();
        for (rounded, value) in image.data.iter().zip(values) {
            assert_eq!(rounded.to_bits() & 0xff, 0, "{value}");
            assert!((rounded - value).abs() <= 1.6e-5 * value.abs() + 1e-42, "{value}: {rounded}");
        }
        image.round_to_24_bits();
        assert_eq!(image, once);
    }
}
