//! A scene for programs that draw: surfaces in a color each, camera and lights.

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_2, PI};

use fluorspar::geometry::TriangleMesh;
use fluorspar::light::{Emitter, Light, PointPattern};
use fluorspar::material::{Material, Scattering};
use fluorspar::scene::Scene;
use fluorspar::spectral::{Curve, Reflectance, StandardObserver, WavelengthGrid, linear_srgb};
use fluorspar_format::{GltfCamera, GltfLight, GltfLightKind};
use glam::Vec3;

use crate::experiment::{file_name, unique_names};
use crate::material::internal_reflectance;
use crate::shape::mesh_in_place;
use crate::write::{mean_weights, sum_of_terms};

/// What of a scene glTF holds.
#[derive(Clone, Debug)]
pub struct DrawnScene {
    /// Surfaces, in meters.
    pub parts: Vec<DrawnPart>,
    /// The camera; none of parallel rays.
    pub camera: Option<GltfCamera>,
    /// Lights with a place or a direction.
    pub lights: Vec<GltfLight>,
    /// What of the scene it does not hold.
    pub lost: Vec<String>,
}

/// A surface.
#[derive(Clone, Debug)]
pub struct DrawnPart {
    /// Its name, in letters, digits, `_` and `-`.
    pub name: String,
    /// Name of its material, likewise.
    pub material: String,
    /// Its color under even light, linear sRGB.
    pub color: [f64; 3],
    /// Its mesh.
    pub mesh: TriangleMesh,
}

/// A scene as glTF holds it, under lights whose groups have these drives.
pub fn to_gltf(scene: &Scene, drive: &dyn Fn(&str) -> f64) -> DrawnScene {
    let mut lost =
        vec!["what materials do but for their color: gloss, spectra, fluorescence, maps".to_owned()];
    let colors = Colors::new(&scene.grid);
    let parts = drawn_parts(scene, &colors);
    let emitting = scene.objects.iter().filter(|object| object.emission.is_some());
    lost.extend(
        emitting.map(|object| format!("what \"{}\" emits: surfaces are no lights there", object.name)),
    );
    let camera = &scene.camera;
    let view = camera.view().map(|view| {
        let aspect = camera.width as f64 / camera.height as f64;
        let vertical_field = 2.0 * (f64::from(view.tan_half_width) / aspect).atan();
        GltfCamera {
            position: camera.position,
            forward: camera.forward,
            up: camera.up,
            vertical_field,
            aspect,
        }
    });
    if camera.lens.is_some() || camera.aperture.is_some() {
        lost.push("the lens or aperture of the camera: all is in focus there".into());
    }
    if view.is_none() {
        lost.push("the camera: its rays are parallel, or its window is off its axis".into());
    }
    let mut lights = Vec::new();
    for light in &scene.lights {
        let drive = drive(&scene.light_groups[light.group].name);
        match drawn(light, drive, &colors) {
            Some(light) => lights.push(light),
            None if drive > 0.0 => {
                lost.push(format!("light \"{}\", which comes from everywhere", light.name))
            }
            None => {}
        }
    }
    DrawnScene { parts, camera: view, lights, lost }
}

fn drawn_parts(scene: &Scene, colors: &Colors) -> Vec<DrawnPart> {
    let names = |all: Vec<&str>| -> Vec<String> {
        let plain: Vec<String> = all.into_iter().map(|name| file_name(name).replace('.', "_")).collect();
        unique_names(plain.iter().map(String::as_str))
    };
    let materials = names(scene.materials.iter().map(|material| material.name.as_str()).collect());
    let objects = names(scene.objects.iter().map(|object| object.name.as_str()).collect());
    let mut known: HashMap<usize, [f64; 3]> = HashMap::new();
    let mut color =
        |number: usize| *known.entry(number).or_insert_with(|| colors.of(&scene.materials[number], scene));
    let parts = scene.objects.iter().zip(objects).map(|(object, name)| DrawnPart {
        name,
        material: materials[object.material].clone(),
        color: color(object.material),
        mesh: mesh_in_place(&object.shape),
    });
    parts.collect()
}

/// A light as a point: its intensity ahead is that of the surface that shines. `None` of dark ones and of environments.
fn drawn(light: &Light, drive: f64, colors: &Colors) -> Option<GltfLight> {
    let total = drive * light.spectrum.total();
    // Intensity ahead of cos^g, W/sr
    let ahead = |exponent: f32| total * (f64::from(exponent) + 1.0) / (2.0 * PI);
    // The format's spots fall by the square of the cosine's share of the way to their edge: a third of what the cone holds
    let edge = |exponent: f32| (1.0 - 3.0 / (f64::from(exponent) + 1.0)).max(0.0).acos();
    let lobe = |exponent: f32| (GltfLightKind::Spot([0.0, edge(exponent)]), ahead(exponent));
    let (position, direction, (kind, radiant)) = match &light.emitter {
        Emitter::Disc(disc) => (disc.center, disc.normal, lobe(disc.exponent)),
        Emitter::Annulus(ring) => (ring.center, ring.normal, lobe(ring.exponent)),
        Emitter::Rectangle(sheet) => (
            sheet.corner + 0.5 * (sheet.edge_u + sheet.edge_v),
            sheet.edge_u.cross(sheet.edge_v).normalize_or(Vec3::Z),
            lobe(sheet.exponent),
        ),
        Emitter::Sphere(ball) => (ball.center, Vec3::NEG_Z, (GltfLightKind::Point, 0.25 * total / PI)),
        Emitter::Point(point) => match &point.pattern {
            PointPattern::Even => (point.position, Vec3::NEG_Z, (GltfLightKind::Point, 0.25 * total / PI)),
            PointPattern::Lobe { axis, exponent } => (point.position, *axis, lobe(*exponent)),
            PointPattern::Cone(cone) => {
                // The inner one must lie below the outer one there
                let [inner, outer] = cone.angles_deg().map(|deg| deg.to_radians().min(FRAC_PI_2));
                let angles = [inner.min(0.999 * outer), outer];
                (point.position, cone.axis(), (GltfLightKind::Spot(angles), total / cone.solid_angle_sr()))
            }
        },
        Emitter::Distant(distant) => (Vec3::ZERO, distant.direction, (GltfLightKind::Directional, total)),
        Emitter::Environment | Emitter::EnvironmentMap(_) => return None,
    };
    let name = light.name.to_string();
    (total > 0.0).then(|| GltfLight {
        name,
        position,
        direction,
        color: colors.of_light(&light.spectrum),
        kind,
        radiant,
    })
}

/// Colors of spectra.
struct Colors {
    grid: WavelengthGrid,
    observer: StandardObserver,
}

impl Colors {
    fn new(grid: &WavelengthGrid) -> Self {
        Self { grid: grid.clone(), observer: StandardObserver::new(grid) }
    }

    fn rgb(&self, curve: &Curve) -> [f64; 3] {
        let values = curve.on_grid::<Reflectance>(&self.grid);
        let values: Vec<f32> = values.values().iter().map(|value| *value as f32).collect();
        linear_srgb(self.observer.xyz(&values))
    }

    /// Diffuse color under even light, from 0 to 1; metals at normal incidence, glass white, mixtures as their first part.
    fn of(&self, material: &Material, scene: &Scene) -> [f64; 3] {
        let even = self.rgb(&Curve::constant(1.0));
        let of_curve = |curve: &Curve, factor: f64| {
            let rgb = self.rgb(curve);
            std::array::from_fn(|c| (factor * rgb[c] / even[c]).clamp(0.0, 1.0))
        };
        match &material.scattering {
            Scattering::Lambertian(base) => of_curve(&sum_of_terms(base, &mean_weights(base).0), 1.0),
            Scattering::Coated(coated) => {
                // What a coat lets in of even light: it lets out 1 / n² as much
                let index = f64::from(coated.coat.refractive_index);
                let passed = index * index * (1.0 - internal_reflectance(index));
                of_curve(&sum_of_terms(&coated.base, &mean_weights(&coated.base).0), passed)
            }
            Scattering::Conductor(metal) => {
                let at = |nm: f64| {
                    let (n, k) = (metal.n.at(nm), metal.k.at(nm));
                    ((n - 1.0).powi(2) + k * k) / ((n + 1.0).powi(2) + k * k)
                };
                of_curve(&Curve::from_fn(self.grid.start_nm(), self.grid.end_nm(), at), 1.0)
            }
            Scattering::Dielectric(_) => [1.0; 3],
            Scattering::Mixture(mixture) => self.of(&scene.materials[mixture.first], scene),
            Scattering::TwoSided(sides) => self.of(&scene.materials[sides.front], scene),
        }
    }

    /// Color of a light, its largest part 1; white where it is invisible.
    fn of_light(&self, spectrum: &Curve) -> [f64; 3] {
        let rgb = self.rgb(spectrum).map(|value| value.max(0.0));
        let most = rgb.iter().copied().fold(0.0, f64::max);
        if most > 0.0 { rgb.map(|value| value / most) } else { [1.0; 3] }
    }
}
