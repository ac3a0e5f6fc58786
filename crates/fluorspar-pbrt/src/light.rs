//! Lights, and what shapes emit.

use std::f64::consts::PI;

use fluorspar::light::{
    ConeEdge, DistantEmitter, Emitter, EnvironmentLayer, EnvironmentMap, Light, PointEmitter, PointPattern,
    SpotCone,
};
use fluorspar::quote::excerpt;
use fluorspar::scene::{Shape, SurfaceEmission};
use fluorspar::spectral::{Curve, daylight_d65};
use fluorspar_format::{PbrtError, PbrtPlaced, TextureImage, Transfer, read_texture};
use glam::{DMat3, DMat4, DVec3, Vec3};

use crate::convert::Convert;
use crate::given::Given;
use crate::rgb::primaries;
use crate::spectrum::{LightSpectrum, luminance};

/// Most rows of an environment map; finer images are averaged.
const MOST_ROWS: usize = 1024;
/// Samples of the image across each pixel of the map.
const SAMPLES: usize = 2;

impl Convert<'_> {
    /// All lights without shapes.
    pub(crate) fn lights(&mut self) -> Result<(), PbrtError> {
        let tree = self.tree;
        for placed in &tree.lights {
            self.light(placed)?;
        }
        Ok(())
    }

    fn light(&mut self, placed: &PbrtPlaced) -> Result<(), PbrtError> {
        let given = Given::new(&placed.entity);
        let at = placed.entity.at;
        given.used(&["samples", "nsamples"]);
        let map = self.scene_from_world() * placed.to_world;
        let (from, to) = (given.point("from", [0.0; 3]), given.point("to", [0.0, 0.0, 1.0]));
        let direction = (map.transform_point3(to) - map.transform_point3(from)).try_normalize();
        let position = map.transform_point3(from).as_vec3();
        let class = placed.entity.class.as_str();
        let (spectrum, emitter) = match class {
            "point" => {
                // Intensity in all directions.
                let spectrum = self.scaled(&given, "I", Some(("power", 4.0 * PI)))?;
                (
                    spectrum.scaled(4.0 * PI),
                    Emitter::from(PointEmitter { position, pattern: PointPattern::Even }),
                )
            }
            "distant" => {
                let Some(direction) = direction else {
                    return Err(self.error(at, "\"from\" and \"to\" are the same point; move one of them"));
                };
                let spectrum = self.scaled(&given, "L", Some(("illuminance", 1.0)))?;
                (spectrum, Emitter::from(DistantEmitter { direction: direction.as_vec3() }))
            }
            "spot" => {
                let Some(direction) = direction else {
                    return Err(self.error(at, "\"from\" and \"to\" are the same point; move one of them"));
                };
                let cone = self.spot(&given, direction.as_vec3());
                let spectrum = self.scaled(&given, "I", Some(("power", cone.solid_angle_sr())))?;
                let pattern = PointPattern::Cone(cone);
                (spectrum.scaled(cone.solid_angle_sr()), Emitter::from(PointEmitter { position, pattern }))
            }
            "infinite" | "exinfinite" => match given.text("filename").or(given.text("mapname")) {
                None => (self.scaled(&given, "L", Some(("illuminance", PI)))?, Emitter::Environment),
                Some(name) => self.environment(&given, name, &placed.to_world)?,
            },
            _ => {
                self.remark(
                    at,
                    format!("LightSource \"{}\" has no counterpart and is left out", excerpt(class)),
                );
                return Ok(());
            }
        };
        if given.find("portal").is_some() {
            self.note(at, "\"portal\": light comes from all directions; what hides it must be in the scene");
        }
        given.finish("LightSource", &mut self.remarks);
        if spectrum.max() > 0.0 {
            let name = format!("{class}_{}", self.lights.len()).into();
            self.lights.push(Light { name, group: 0, spectrum, crossed_polarizers: false, emitter });
        } else {
            self.note(at, "the light is dark and is left out");
        }
        Ok(())
    }

    /// The absolute spectrum of a light: parameter, `scale`, and the parameter of version 4 that sets its amount, with
    /// what that is for a light of 1.
    fn scaled(
        &mut self,
        given: &Given<'_>,
        name: &str,
        amount: Option<(&str, f64)>,
    ) -> Result<Curve, PbrtError> {
        let wanted =
            amount.and_then(|(name, of_one)| Some(given.number(name).filter(|value| *value > 0.0)? / of_one));
        let wanted = wanted.filter(|_| self.is_v4());
        let LightSpectrum { curve, scale } =
            self.light_spectrum(given.find(name), given.entity.at, wanted.is_some())?;
        let factor = self.factor(given)?;
        Ok(factor.applied(&curve.scaled(scale * wanted.unwrap_or(1.0))))
    }

    /// What `scale` multiplies: a number, in version 3 a spectrum.
    fn factor(&mut self, given: &Given<'_>) -> Result<Factor, PbrtError> {
        let Some(parameter) = given.find("scale") else { return Ok(Factor::Number(1.0)) };
        match given.number("scale") {
            Some(number) => Ok(Factor::Number(number)),
            None => Ok(Factor::Spectrum(self.spectrum(parameter, crate::spectrum::Role::Reflectance)?)),
        }
    }

    /// The cone of a spot. Version 4 lets its edge fall by a smooth step of the cosine, version 3 by a fourth power.
    fn spot(&self, given: &Given<'_>, axis: Vec3) -> SpotCone {
        let outer = given.number("coneangle").unwrap_or(30.0).clamp(0.01, 180.0);
        let delta = given.number("conedeltaangle").or(given.number("conedelta")).unwrap_or(5.0);
        let edge = if self.is_v4() { ConeEdge::SmoothStep } else { ConeEdge::FourthPower };
        SpotCone::new(axis, [outer - delta.clamp(0.0, outer), outer], edge)
    }

    /// An environment from an image.
    fn environment(
        &mut self,
        given: &Given<'_>,
        name: &str,
        to_world: &DMat4,
    ) -> Result<(Curve, Emitter), PbrtError> {
        let at = given.entity.at;
        let path = self.tree.path_of(at, name);
        let image = read_texture(&path, Transfer::Srgb).map_err(|error| self.error(at, error.to_string()))?;
        self.note_read(path);
        let is_square = image.width == image.height;
        if self.is_v4() && !is_square {
            self.remark(
                at,
                "the image is not square: it is taken as longitude and latitude, not as an equal-area map",
            );
        }
        let look = if self.is_v4() && is_square { equal_area } else { latitude_longitude };
        let matrix = DMat3::from_mat4(self.turn() * *to_world).inverse();
        if !matrix.is_finite() {
            return Err(self.error(at, "the transform of this light flattens space; change it"));
        }
        let height = image.height.clamp(8, MOST_ROWS);
        let planes = planes(&image, height, |direction| look(matrix * direction));
        let light = daylight_d65();
        let spectra = if self.is_v4() {
            let one = 1.0 / luminance(&light);
            primaries().map(|primary| primary.times(&light).scaled(one))
        } else {
            primaries()
        };
        let spectra: Vec<Curve> = if planes.len() == 1 {
            let [r, g, b] = &spectra;
            let nm = (200..=1200).step_by(5).map(f64::from);
            let (nm, values) = nm.map(|nm| (nm, r.at(nm) + g.at(nm) + b.at(nm))).unzip();
            vec![Curve::new(nm, values).map_err(|error| self.error(at, error.to_string()))?]
        } else {
            spectra.into()
        };
        let layers =
            spectra.into_iter().zip(planes).map(|(spectrum, factors)| EnvironmentLayer { spectrum, factors });
        let layers: Vec<EnvironmentLayer> =
            layers.filter(|layer| layer.factors.iter().any(|f| *f > 0.0)).collect();
        let map = EnvironmentMap::new(2 * height, height, layers, 0.0)
            .map_err(|error| self.error(at, error.to_string()))?;

        // L and scale are factors on the image
        let mut factor = Curve::constant(1.0);
        if let Some(parameter) = given.find("L").filter(|_| !self.is_v4()) {
            factor = self.spectrum(parameter, crate::spectrum::Role::Reflectance)?;
        }
        let scale = self.factor(given)?;
        factor = scale.applied(&factor);
        if let Some(wanted) = given.number("illuminance").filter(|value| *value > 0.0) {
            self.remark(
                at,
                "\"illuminance\": the mean of the map over all directions counts as if it were even",
            );
            let mean = luminance(&map.mean_spectrum());
            factor = Curve::constant(wanted / (PI * mean));
        }
        Ok((factor, Emitter::from(map)))
    }

    /// The emission of a shape.
    pub(crate) fn area_light(&mut self, index: usize, shape: &Shape) -> Result<SurfaceEmission, PbrtError> {
        let tree = self.tree;
        let entity = &tree.area_lights[index];
        let given = Given::new(entity);
        given.used(&["samples", "nsamples"]);
        if !["diffuse", "area"].contains(&entity.class.as_str()) {
            let text = format!(
                "AreaLightSource \"{}\" has no counterpart; it is taken as diffuse",
                excerpt(&entity.class)
            );
            self.remark(entity.at, text);
        }
        if given.find("filename").is_some() {
            self.remark(entity.at, "\"filename\": the light is the same all over the surface");
        }
        let is_two_sided = given.flag("twosided").unwrap_or(false);
        let sides = if is_two_sided { 2.0 } else { 1.0 };
        let radiance = self.scaled(&given, "L", Some(("power", sides * PI * area_m2(shape))))?;
        given.finish("AreaLightSource", &mut self.remarks);
        Ok(SurfaceEmission { group: 0, radiance, is_one_sided: !is_two_sided })
    }
}

/// A factor on a spectrum.
enum Factor {
    Number(f64),
    Spectrum(Curve),
}

impl Factor {
    fn applied(&self, curve: &Curve) -> Curve {
        match self {
            Self::Number(number) => curve.scaled(*number),
            Self::Spectrum(spectrum) => curve.times(spectrum),
        }
    }
}

fn area_m2(shape: &Shape) -> f64 {
    match shape {
        Shape::Mesh(mesh) => mesh.area_m2(),
        Shape::Sphere { radius_m, .. } => 4.0 * PI * f64::from(*radius_m).powi(2),
        Shape::Disc { radius_m, .. } => PI * f64::from(*radius_m).powi(2),
        Shape::Instances(_) => 0.0,
    }
}

/// Place in the unit square of an image of longitude and latitude about z: v from the pole.
fn latitude_longitude(direction: DVec3) -> [f64; 2] {
    let d = direction.normalize_or(DVec3::Z);
    let u = d.y.atan2(d.x).rem_euclid(2.0 * PI) / (2.0 * PI);
    [u, d.z.clamp(-1.0, 1.0).acos() / PI]
}

/// Place in the unit square of an equal-area map of the sphere (Clarberg, Fast equal-area mapping of the (hemi)sphere using
/// SIMD, 2008).
fn equal_area(direction: DVec3) -> [f64; 2] {
    let d = direction.normalize_or(DVec3::Z);
    let [x, y, z] = d.abs().to_array();
    let radius = (1.0 - z).max(0.0).sqrt();
    let (long, short) = (x.max(y), x.min(y));
    let angle = if long == 0.0 { 0.0 } else { (short / long).atan() * 2.0 / PI };
    let angle = if x < y { 1.0 - angle } else { angle };
    let (mut u, mut v) = (radius - radius * angle, radius * angle);
    if d.z < 0.0 {
        (u, v) = (1.0 - v, 1.0 - u);
    }
    [0.5 * (1.0 + u.copysign(d.x)), 0.5 * (1.0 + v.copysign(d.y))]
}

/// The image as rows of the scene's environment map, gray or in three planes. `place` gives the place in the unit square of
/// the image, v from the top, for a direction of the scene.
fn planes(image: &TextureImage, height: usize, place: impl Fn(DVec3) -> [f64; 2]) -> Vec<Vec<f32>> {
    let colors = if image.channels < 3 { 1 } else { 3 };
    let width = 2 * height;
    let mut planes = vec![vec![0.0; width * height]; colors];
    for pixel in 0..width * height {
        let mut sums = [0.0_f32; 3];
        for sample in 0..SAMPLES * SAMPLES {
            let part = |index: usize| (index as f64 + 0.5) / SAMPLES as f64;
            let longitude =
                2.0 * PI * (((pixel % width) as f64 + part(sample % SAMPLES)) / width as f64 - 0.5);
            let polar = PI * ((pixel / width) as f64 + part(sample / SAMPLES)) / height as f64;
            let direction =
                DVec3::new(polar.sin() * longitude.sin(), polar.cos(), -polar.sin() * longitude.cos());
            let [u, v] = place(direction);
            let column = ((u * image.width as f64) as usize).min(image.width - 1);
            let row = ((v * image.height as f64) as usize).min(image.height - 1);
            let first = (row * image.width + column) * image.channels;
            for (sum, value) in sums.iter_mut().zip(&image.data[first..first + colors]) {
                *sum += value.max(0.0) / (SAMPLES * SAMPLES) as f32;
            }
        }
        for (plane, sum) in planes.iter_mut().zip(sums) {
            plane[pixel] = sum;
        }
    }
    planes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_have_their_places_in_either_map() {
        assert_eq!(latitude_longitude(DVec3::Z)[1], 0.0);
        assert_eq!(latitude_longitude(DVec3::NEG_Y), [0.75, 0.5]);
        // The pole is the middle of the square, the other one its corners, the equator the diamond between.
        assert_eq!(equal_area(DVec3::Z), [0.5, 0.5]);
        assert_eq!(equal_area(DVec3::NEG_Z), [1.0, 1.0]);
        assert_eq!((equal_area(DVec3::X), equal_area(DVec3::NEG_Y)), ([1.0, 0.5], [0.5, 0.0]));
        // A cap of a tenth of the sphere covers a tenth of the square.
        let side = 400;
        let mut inside = 0;
        for i in 0..side * side {
            let (z, phi) =
                (1.0 - 2.0 * (i / side) as f64 / side as f64, 2.0 * PI * (i % side) as f64 / side as f64);
            let r = (1.0 - z * z).sqrt();
            let [u, v] = equal_area(DVec3::new(r * phi.cos(), r * phi.sin(), z));
            inside += usize::from(u < 0.5 && v < 0.25);
        }
        assert!((inside as f64 / (side * side) as f64 - 0.125).abs() < 5e-3, "{inside}");
    }
}
