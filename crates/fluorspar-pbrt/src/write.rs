//! A scene as one of pbrt: version 4, or pbrt-v3-spectral where something fluoresces, which version 4 does not know.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::fmt::Write as _;
use std::sync::Arc;

use fluorspar::geometry::{MeshInstances, TriangleMesh};
use fluorspar::light::{ConeEdge, Emitter, Light, PointEmitter, PointPattern, SpotCone};
use fluorspar::material::{Coated, Lambertian, Material, Mixture, ScalarTexture, Scattering};
use fluorspar::optics::PerspectiveCamera;
use fluorspar::render::RenderSettings;
use fluorspar::scene::{Object, Scene, Shape};
use fluorspar::spectral::Curve;
use fluorspar::units::LUMINOUS_EFFICACY_LM_PER_W;
use glam::{Mat4, Vec2, Vec3};

use crate::experiment::{Companion, ConvertedScene, file_name, unique_names};
use crate::material::internal_reflectance;
use crate::photolumi::{Bands, band_matrix};
use crate::spectrum::luminance;

/// Points along u and v at which textures are averaged.
const SIDE: usize = 24;
/// Radius of the disc that stands for a point that shines as a surface does, m.
const POINT_RADIUS_M: f32 = 5e-4;

/// Writes a scene as one of pbrt, in meters, under lights whose groups have these drives. The files that it names lie in `folder`, a name
/// relative to the scene.
pub fn to_pbrt(
    scene: &Scene,
    render: &RenderSettings,
    drive: &dyn Fn(&str) -> f64,
    title: &str,
    folder: &str,
) -> ConvertedScene {
    let mut writer = PbrtWriter {
        scene,
        drive,
        folder,
        is_v4: scene.materials.iter().all(|material| material.fluorophores.is_empty()),
        names: quotable(scene.materials.iter().map(|material| material.name.as_str())),
        text: String::new(),
        lost: BTreeMap::new(),
        files: Vec::new(),
        spectra: Vec::new(),
    };
    writer.view(&scene.camera, render);
    writer.materials();
    scene.lights.iter().for_each(|light| writer.light(light));
    let names = quotable(scene.objects.iter().map(|object| object.name.as_str()));
    scene.objects.iter().zip(names).for_each(|(object, name)| writer.object(object, &name));
    let PbrtWriter { text: body, lost, files, is_v4, .. } = writer;
    let line =
        |((what, instead), names): ((&str, String), Vec<String>)| match names.iter().all(String::is_empty) {
            true => format!("{what}: {instead}"),
            false => format!("{what} {}: {instead}", names.join(", ")),
        };
    let lost: Vec<String> = lost.into_iter().map(line).collect();
    let version = if is_v4 { "pbrt, version 4" } else { "pbrt-v3-spectral" };
    let title = title.replace(char::is_control, " ");
    let mut text = format!(
        "# {title}, a scene of {version} in meters, {} scene convert\n",
        fluorspar_format::WRITTEN_BY
    );
    lost.iter().for_each(|line| text += &format!("# {}\n", line.replace(char::is_control, " ")));
    ConvertedScene::new(text + &body, lost, files)
}

/// A file of pbrt as it grows.
struct PbrtWriter<'a> {
    scene: &'a Scene,
    drive: &'a dyn Fn(&str) -> f64,
    folder: &'a str,
    is_v4: bool,
    /// Names of the materials.
    names: Vec<String>,
    text: String,
    /// What is not as it was, and what it is instead, with the names of all that it is said of.
    lost: BTreeMap<(&'static str, String), Vec<String>>,
    files: Vec<(String, Companion)>,
    spectra: Vec<(Curve, String)>,
}

impl PbrtWriter<'_> {
    fn line(&mut self, line: impl AsRef<str>) {
        self.text.push_str(line.as_ref());
        self.text.push('\n');
    }

    fn lost(&mut self, what: &'static str, name: &str, instead: impl Into<String>) {
        let names = self.lost.entry((what, instead.into())).or_default();
        if !names.iter().any(|known| known == name) {
            names.push(name.to_owned());
        }
    }

    fn add(&mut self, name: String, companion: Companion) -> String {
        let is_taken = self.files.iter().any(|(other, _)| *other == name);
        let name = if is_taken { format!("{}_{name}", self.files.len()) } else { name };
        let path = format!("{}/{name}", self.folder);
        self.files.push((name, companion));
        path
    }

    /// Camera, film, sampler and integrator. The world of pbrt is left-handed as its camera sees it: the camera mirrors it.
    fn view(&mut self, camera: &PerspectiveCamera, render: &RenderSettings) {
        if camera.lens.is_some() {
            self.lost("the lens", "", "the camera is a pinhole in its entrance pupil");
        }
        let (from, to) = (words(camera.position), words(camera.position + camera.forward));
        self.line(format!("Scale -1 1 1\nLookAt {from}  {to}  {}", words(camera.up)));
        let (width, height) = (camera.width as f64, camera.height as f64);
        // The window in halves of the narrower side, or for parallel rays in meters
        let narrow = f64::from(camera.tan_half_width) * (height / width).min(1.0);
        let half = match camera.parallel_half_width_m {
            Some(half) => f64::from(half),
            None => (width / height).max(1.0),
        };
        let [x, y] = camera.center.to_array().map(|offset| f64::from(offset) * half);
        let [left, right, low, high] =
            [x - half, x + half, y - half * height / width, y + half * height / width];
        let window = format!("\"float screenwindow\" [ {left} {right} {low} {high} ]");
        match camera.parallel_half_width_m {
            Some(_) => self.line(format!("Camera \"orthographic\" {window}")),
            None => {
                let fov = 2.0 * narrow.atan().to_degrees();
                let window = if camera.center == Vec2::ZERO { String::new() } else { window };
                let aperture = camera.aperture.as_ref().map_or_else(String::new, |aperture| {
                    let [radius, focus] = [aperture.radius(), aperture.focus()];
                    format!("\"float lensradius\" {radius} \"float focaldistance\" {focus} ")
                });
                self.line(format!("Camera \"perspective\" \"float fov\" {fov} {aperture}{window}"));
            }
        }
        let (film, sampler) = if self.is_v4 { ("rgb", "zsobol") } else { ("image", "sobol") };
        self.line(format!(
            "Film \"{film}\" \"integer xresolution\" {width} \"integer yresolution\" {height}"
        ));
        self.line(format!("Sampler \"{sampler}\" \"integer pixelsamples\" {}", render.samples_per_pixel));
        self.line(format!("Integrator \"path\" \"integer maxdepth\" {}\nWorldBegin", render.max_depth));
    }

    /// A parameter with a spectrum. Outside its samples it is 0, but for an index, which holds there.
    fn spectrum(&mut self, name: &str, curve: &Curve, is_index: bool) -> String {
        let (nm, values) = (curve.wavelengths_nm(), curve.values());
        let (first, last) = curve.range_nm();
        let before = (!is_index && first > 200.0).then_some((first - 1e-3, 0.0));
        let behind = (!is_index && last < 1200.0).then_some((last + 1e-3, 0.0));
        let samples = nm.iter().copied().zip(values.iter().copied());
        let pairs: Vec<(f64, f64)> = before.into_iter().chain(samples).chain(behind).collect();
        if pairs.len() <= 6 {
            let pairs: Vec<String> = pairs.iter().map(|(nm, value)| format!("{nm} {value}")).collect();
            return format!("\"spectrum {name}\" [ {} ]", pairs.join("  "));
        }
        let known = self.spectra.iter().find(|(other, _)| other == curve).map(|(_, path)| path.clone());
        let path = known.unwrap_or_else(|| {
            let mut text = format!("# {}\n", fluorspar_format::WRITTEN_BY);
            pairs.iter().for_each(|(nm, value)| text += &format!("{nm} {value}\n"));
            let path = self.add(format!("spectrum_{}.spd", self.spectra.len()), Companion::Text(text));
            self.spectra.push((curve.clone(), path.clone()));
            path
        });
        format!("\"spectrum {name}\" \"{path}\"")
    }

    /// Light of an absolute spectrum. Version 4 scales every spectrum to an integral of 1 with the luminous efficiency: it is given so, and
    /// `scale` undoes it.
    fn emitted(&mut self, name: &str, curve: &Curve) -> String {
        let seen = luminance(curve) / LUMINOUS_EFFICACY_LM_PER_W;
        if !self.is_v4 || seen <= 0.0 {
            return self.spectrum(name, curve, false);
        }
        let spectrum = self.spectrum(name, &curve.scaled(1.0 / seen), false);
        format!("{spectrum} \"float scale\" {seen}")
    }

    /// All materials; mixtures after their parts.
    fn materials(&mut self) {
        let scene = self.scene;
        let (mixed, plain): (Vec<usize>, Vec<usize>) = (0..scene.materials.len())
            .partition(|number| matches!(scene.materials[*number].scattering, Scattering::Mixture(_)));
        for number in plain.into_iter().chain(mixed) {
            let material = &scene.materials[number];
            let scattering = self.scattering(&material.scattering, &material.name);
            let fluorescence = self.fluorescence(front_of(scene, material));
            if material.normal_map.is_some() {
                self.lost("the normal map of", &material.name, "the surface is smooth");
            }
            let name = &self.names[number];
            let line = format!("MakeNamedMaterial \"{name}\" \"string type\" {scattering}{fluorescence}");
            self.line(line);
        }
        // The surface of lights, which reflects nothing
        let black = if self.is_v4 { "diffuse\" \"spectrum reflectance" } else { "matte\" \"spectrum Kd" };
        self.line(format!(
            "MakeNamedMaterial \"black of lights\" \"string type\" \"{black}\" [ 200 0  1200 0 ]"
        ));
    }

    fn scattering(&mut self, scattering: &Scattering, name: &str) -> String {
        match scattering {
            Scattering::Lambertian(base) => {
                let reflectance = self.reflectance(base, name);
                match self.is_v4 {
                    true => format!("\"diffuse\" {}", self.spectrum("reflectance", &reflectance, false)),
                    false => format!("\"matte\" {}", self.spectrum("Kd", &reflectance, false)),
                }
            }
            Scattering::Coated(coated) => self.coated(coated, name),
            Scattering::Dielectric(glass) => {
                let rough = self.roughness(&glass.roughness, name);
                let kind = if self.is_v4 { "dielectric" } else { "glass" };
                let text = format!("\"{kind}\" \"float eta\" {} {rough}", glass.refractive_index);
                let is_clear = glass.transmittance == Curve::constant(1.0);
                if is_clear || self.is_v4 {
                    if !is_clear {
                        self.lost("the color of glass", name, "it is clear");
                    }
                    return text;
                }
                format!("{text} {}", self.spectrum("Kt", &glass.transmittance, false))
            }
            Scattering::Conductor(metal) => {
                let rough = self.roughness(&metal.roughness, name);
                let [n, k] = [("eta", &metal.n), ("k", &metal.k)]
                    .map(|(name, curve)| self.spectrum(name, curve, true));
                format!("\"{}\" {n} {k} {rough}", if self.is_v4 { "conductor" } else { "metal" })
            }
            Scattering::Mixture(mixture) => self.mixture(mixture, name),
            Scattering::TwoSided(sides) => {
                self.lost("the back of", name, "it is as its front");
                let front = &self.scene.materials[sides.front];
                self.scattering(&front.scattering, &front.name)
            }
        }
    }

    fn mixture(&mut self, mixture: &Mixture, name: &str) -> String {
        let amount = self.mean(&mixture.amount, name, "the map of the share of");
        let [first, second] = [mixture.first, mixture.second].map(|part| self.names[part].clone());
        match self.is_v4 {
            true => {
                format!("\"mix\" \"string materials\" [ \"{first}\" \"{second}\" ] \"float amount\" {amount}")
            }
            // The amount is that of the first there
            false => format!(
                "\"mix\" \"string namedmaterial1\" \"{second}\" \"string namedmaterial2\" \"{first}\" \"spectrum amount\" \
                 [ 200 {amount}  1200 {amount} ]"
            ),
        }
    }

    /// A base below a coat: in version 4 as it is below it, in version 3 as it is seen, with the reflectance of the coat.
    fn coated(&mut self, Coated { base, coat }: &Coated, name: &str) -> String {
        let (reflectance, index) = (self.reflectance(base, name), f64::from(coat.refractive_index));
        let rough = self.roughness(&coat.roughness, name);
        if coat.smoothing_m > 0.0 {
            self.lost("a film that evens out the relief of", name, "it follows the relief");
        }
        if !self.is_v4 {
            let mirrored = ((index - 1.0) / (index + 1.0)).powi(2);
            let base = self.spectrum("Kd", &reflectance, false);
            return format!(
                "\"substrate\" {base} \"spectrum Ks\" [ 200 {mirrored}  1200 {mirrored} ] {rough}"
            );
        }
        let inside = internal_reflectance(index);
        let below = |seen: &f64| seen / (1.0 - inside + seen * inside);
        let values = reflectance.values().iter().map(below).collect();
        let below = Curve::new(reflectance.wavelengths_nm().to_vec(), values).unwrap_or(reflectance);
        format!(
            "\"coateddiffuse\" {} \"float eta\" {index} {rough}",
            self.spectrum("reflectance", &below, false)
        )
    }

    /// Alpha of GGX, which both versions take as it is where they are told not to map it.
    fn roughness(&mut self, alpha: &ScalarTexture, name: &str) -> String {
        let alpha = self.mean(alpha, name, "the map of the roughness of");
        format!("\"float uroughness\" {alpha} \"float vroughness\" {alpha} \"bool remaproughness\" false")
    }

    /// The mean of a texture over the unit square.
    fn mean(&mut self, texture: &ScalarTexture, material: &str, what: &'static str) -> f64 {
        if let Some(value) = texture.constant() {
            return f64::from(value);
        }
        self.lost(what, material, "its mean everywhere");
        unit_square().map(|uv| f64::from(texture.at(uv))).sum::<f64>() / (SIDE * SIDE) as f64
    }

    /// Mean weights of the terms of a reflectance.
    fn weights(&mut self, base: &Lambertian, name: &str) -> Vec<f64> {
        let (weights, varies) = mean_weights(base);
        if varies {
            self.lost("the maps of the color of", name, "their mean everywhere");
        }
        weights
    }

    fn reflectance(&mut self, base: &Lambertian, name: &str) -> Curve {
        if base.states.as_ref().is_some_and(|states| !states.profiles.is_empty()) {
            self.lost("how far light spreads in", name, "it leaves where it enters");
        }
        let weights = self.weights(base, name);
        sum_of_terms(base, &weights)
    }

    /// All fluorophores of a material as one matrix.
    fn fluorescence(&mut self, material: &Material) -> String {
        let weights = material.diffuse().map(|base| self.weights(base, &material.name)).unwrap_or_default();
        let mut parts = Vec::new();
        for amount in &material.fluorophores {
            let concentration =
                self.mean(&amount.concentration, &material.name, "the map of the concentration of");
            match &amount.in_tissue {
                None => parts.push((concentration, &self.scene.fluorophores[amount.fluorophore].eem)),
                Some(tissue) => {
                    let weight = weights.get(tissue.term).copied().unwrap_or(1.0);
                    parts.push((concentration * weight, tissue.eem.as_ref()));
                }
            }
        }
        if parts.is_empty() {
            return String::new();
        }
        let bands = Bands::of(&self.scene.grid);
        let mut text =
            format!(" \"photolumi fluorescence\" [ {} {} {}", bands.first_nm, bands.step_nm, bands.last_nm());
        for (number, value) in band_matrix(&parts, bands).into_iter().enumerate() {
            text.push(if number.is_multiple_of(bands.count) { '\n' } else { ' ' });
            let _ = match value {
                0.0 => write!(text, "0"),
                value => write!(text, "{value:.6e}"),
            };
        }
        text + " ]"
    }

    fn object(&mut self, object: &Object, name: &str) {
        let material = front_of(self.scene, &self.scene.materials[object.material]);
        let alpha = match &material.opacity {
            None => String::new(),
            Some(opacity) => {
                format!("\"float alpha\" {}", self.mean(opacity, &material.name, "the map of the opacity of"))
            }
        };
        self.line(format!("AttributeBegin # {name}"));
        if let Some(emission) = &object.emission {
            let drive = (self.drive)(&self.scene.light_groups[emission.group].name);
            if drive > 0.0 && matches!(object.shape, Shape::Instances(_)) {
                self.lost("the light of", name, "copies of a surface are no lights there");
            } else if drive > 0.0 {
                self.area_light(&emission.radiance.scaled(drive), emission.is_one_sided);
            }
        }
        self.line(format!("NamedMaterial \"{}\"", self.names[object.material]));
        let stem = file_name(name);
        match &object.shape {
            Shape::Mesh(mesh) => self.mesh(&stem, mesh, &alpha),
            Shape::Sphere { center, radius_m } => {
                self.line(format!(
                    "Translate {}\nShape \"sphere\" \"float radius\" {radius_m} {alpha}",
                    words(*center)
                ));
            }
            Shape::Disc { center, normal, radius_m } => self.disc(*center, *normal, [0.0, *radius_m], &alpha),
            Shape::Instances(instances) => self.instances(instances, name, &alpha),
        }
        self.line("AttributeEnd");
    }

    fn instances(&mut self, instances: &MeshInstances, name: &str, alpha: &str) {
        for (number, mesh) in instances.meshes.iter().enumerate() {
            self.line(format!("ObjectBegin \"{name} {number}\""));
            self.mesh(&format!("{}_{number}", file_name(name)), mesh, alpha);
            self.line("ObjectEnd");
        }
        for instance in &instances.instances {
            let (m, t) = (instance.to_world.matrix3, instance.to_world.translation);
            let axes = [m.x_axis, m.y_axis, m.z_axis].map(|axis| axis.extend(0.0));
            let place = concat(Mat4::from_cols(axes[0], axes[1], axes[2], t.extend(1.0)));
            self.line(format!(
                "AttributeBegin {place} ObjectInstance \"{name} {}\" AttributeEnd",
                instance.mesh
            ));
        }
    }

    fn mesh(&mut self, stem: &str, mesh: &Arc<TriangleMesh>, alpha: &str) {
        let path = self.add(format!("{stem}.ply"), Companion::Mesh(Arc::clone(mesh)));
        self.line(format!("Shape \"plymesh\" \"string filename\" \"{path}\" {alpha}"));
    }

    /// A disc, perhaps with a hole, about its normal.
    fn disc(&mut self, center: Vec3, normal: Vec3, [inner, outer]: [f32; 2], alpha: &str) {
        let right = normal.any_orthonormal_vector();
        let axes = [right, normal.cross(right), normal].map(|axis| axis.extend(0.0));
        let place = Mat4::from_cols(axes[0], axes[1], axes[2], center.extend(1.0));
        let hole = if inner > 0.0 { format!("\"float innerradius\" {inner}") } else { String::new() };
        self.line(format!("{} Shape \"disk\" \"float radius\" {outer} {hole} {alpha}", concat(place)));
    }

    fn area_light(&mut self, radiance: &Curve, is_one_sided: bool) {
        let spectrum = self.emitted("L", radiance);
        self.line(format!("AreaLightSource \"diffuse\" {spectrum} \"bool twosided\" {}", !is_one_sided));
    }

    fn light(&mut self, light: &Light) {
        let drive = (self.drive)(&self.scene.light_groups[light.group].name);
        if drive <= 0.0 {
            return;
        }
        if light.crossed_polarizers {
            self.lost("the polarizers of light", &light.name.to_string(), "what the surface mirrors is seen");
        }
        let whole = light.whole_spectrum().scaled(drive);
        self.line("AttributeBegin");
        match &light.emitter {
            Emitter::Distant(distant) => {
                let spectrum = self.emitted("L", &whole);
                let to = words(distant.direction);
                self.line(format!(
                    "LightSource \"distant\" {spectrum} \"point from\" [ 0 0 0 ] \"point to\" [ {to} ]"
                ));
            }
            Emitter::Environment | Emitter::EnvironmentMap(_) => {
                if matches!(light.emitter, Emitter::EnvironmentMap(_)) {
                    self.lost("the map of light", &light.name.to_string(), "its mean comes from everywhere");
                }
                let spectrum = self.emitted("L", &whole);
                self.line(format!("LightSource \"infinite\" {spectrum}"));
            }
            Emitter::Point(point) => self.point(point, &whole, &light.name.to_string()),
            surface => self.surface(surface, &whole, &light.name.to_string()),
        }
        self.line("AttributeEnd");
    }

    fn point(&mut self, point: &PointEmitter, power: &Curve, name: &str) {
        let from = words(point.position);
        match &point.pattern {
            PointPattern::Even => {
                let spectrum = self.emitted("I", &power.scaled(0.25 / PI));
                self.line(format!("LightSource \"point\" {spectrum} \"point from\" [ {from} ]"));
            }
            PointPattern::Cone(cone) => {
                if self.is_v4 != (cone.edge() == ConeEdge::SmoothStep) {
                    self.lost("how the edge falls of light", name, "as in this version of pbrt");
                }
                let spectrum = self.emitted("I", &power.scaled(1.0 / cone.solid_angle_sr()));
                let (to, [inner, outer]) = (words(point.position + cone.axis()), cone.angles_deg());
                self.line(format!(
                    "LightSource \"spot\" {spectrum} \"point from\" [ {from} ] \"point to\" [ {to} ] \"float coneangle\" {outer} \
                     \"float conedeltaangle\" {}",
                    outer - inner
                ));
            }
            PointPattern::Lobe { axis, exponent } => match is_lambertian(*exponent) {
                false => self.lobe(point.position, *axis, *exponent, power, name),
                true => {
                    let area = PI * f64::from(POINT_RADIUS_M).powi(2);
                    self.area_light(&power.scaled(1.0 / (PI * area)), true);
                    self.line("NamedMaterial \"black of lights\"");
                    self.disc(point.position, *axis, [0.0, POINT_RADIUS_M], "");
                }
            },
        }
    }

    /// Light that falls as `cos^g`: a spot of the same intensity ahead, and as wide as makes its power the same.
    fn lobe(&mut self, position: Vec3, axis: Vec3, exponent: f32, power: &Curve, name: &str) {
        let instead = format!("a spot of the same power and the same intensity ahead for cos^{exponent:.2}");
        self.lost("the pattern of light", name, instead);
        let (edge, mean) = match self.is_v4 {
            true => (ConeEdge::SmoothStep, 0.5),
            false => (ConeEdge::FourthPower, 0.2),
        };
        let cos = 1.0 - 1.0 / (mean * (f64::from(exponent) + 1.0));
        let outer = cos.max(-1.0).acos().to_degrees();
        let pattern = PointPattern::Cone(SpotCone::new(axis, [0.0, outer], edge));
        self.point(&PointEmitter { position, pattern }, power, name);
    }

    /// A surface that emits its power to one side, a sphere to all, and reflects nothing.
    fn surface(&mut self, emitter: &Emitter, power: &Curve, name: &str) {
        let ring = |inner: f32, outer: f32| PI * (f64::from(outer).powi(2) - f64::from(inner).powi(2));
        let (area, middle, axis, exponent) = match emitter {
            Emitter::Disc(disc) => (ring(0.0, disc.radius_m), disc.center, disc.normal, disc.exponent),
            Emitter::Annulus(of) => (ring(of.inner_radius_m, of.radius_m), of.center, of.normal, of.exponent),
            Emitter::Rectangle(sheet) => {
                let cross = sheet.edge_u.cross(sheet.edge_v);
                let middle = sheet.corner + 0.5 * (sheet.edge_u + sheet.edge_v);
                (f64::from(cross.length()), middle, cross.normalize_or(Vec3::Z), sheet.exponent)
            }
            Emitter::Sphere(ball) => (4.0 * PI * f64::from(ball.radius_m).powi(2), ball.center, Vec3::Z, 1.0),
            _ => return,
        };
        if !is_lambertian(exponent) {
            self.lost("the size of light", name, "it is a point");
            return self.lobe(middle, axis, exponent, power, name);
        }
        self.area_light(&power.scaled(1.0 / (PI * area)), true);
        self.line("NamedMaterial \"black of lights\"");
        match emitter {
            Emitter::Disc(disc) => self.disc(disc.center, disc.normal, [0.0, disc.radius_m], ""),
            Emitter::Annulus(ring) => {
                self.disc(ring.center, ring.normal, [ring.inner_radius_m, ring.radius_m], "")
            }
            Emitter::Sphere(ball) => {
                self.line(format!(
                    "Translate {}\nShape \"sphere\" \"float radius\" {}",
                    words(ball.center),
                    ball.radius_m
                ));
            }
            Emitter::Rectangle(sheet) => {
                let (a, u, v) = (sheet.corner, sheet.edge_u, sheet.edge_v);
                let corners: Vec<String> = [a, a + u, a + u + v, a + v].into_iter().map(words).collect();
                let corners = corners.join("  ");
                self.line(format!(
                    "Shape \"trianglemesh\" \"integer indices\" [ 0 1 2  0 2 3 ] \"point P\" [ {corners} ]"
                ));
            }
            _ => {}
        }
    }
}

/// Names that differ and can stand in quotes.
fn quotable<'n>(names: impl Iterator<Item = &'n str>) -> Vec<String> {
    let plain = |name: &str| name.replace(|letter: char| letter.is_control() || "\"\\".contains(letter), "_");
    let plain: Vec<String> = names.map(plain).collect();
    unique_names(plain.iter().map(String::as_str))
}

/// Mean weights of the terms of a reflectance over the unit square, and whether they vary there.
pub(crate) fn mean_weights(base: &Lambertian) -> (Vec<f64>, bool) {
    let mut sums = vec![0.0; base.reflectance.len()];
    let first = base.weights_at(Vec2::splat(0.5));
    let mut varies = false;
    for uv in unit_square() {
        let weights = base.weights_at(uv);
        varies |= weights.iter().zip(&first).any(|(a, b)| (a - b).abs() > 1e-4);
        sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += f64::from(weight));
    }
    (sums.iter().map(|sum| sum / (SIDE * SIDE) as f64).collect(), varies)
}

/// The terms of a reflectance with these weights, together.
pub(crate) fn sum_of_terms(base: &Lambertian, weights: &[f64]) -> Curve {
    let terms: Vec<(&Curve, f64)> =
        base.reflectance.iter().map(|term| &term.spectrum).zip(weights.iter().copied()).collect();
    match terms.as_slice() {
        [] => Curve::constant(0.0),
        [(curve, 1.0)] => (*curve).clone(),
        terms => {
            let mut nm: Vec<f64> =
                terms.iter().flat_map(|(curve, _)| curve.wavelengths_nm()).copied().collect();
            nm.sort_by(f64::total_cmp);
            nm.dedup();
            let sum = |nm: &f64| terms.iter().map(|(curve, weight)| weight * curve.at(*nm)).sum();
            let values = nm.iter().map(sum).collect();
            Curve::new(nm, values).unwrap_or_else(|_| Curve::constant(0.0))
        }
    }
}

/// What reflects, fluoresces and lets through in a material: of two sides the front.
fn front_of<'a>(scene: &'a Scene, material: &'a Material) -> &'a Material {
    match &material.scattering {
        Scattering::TwoSided(sides) => &scene.materials[sides.front],
        _ => material,
    }
}

/// Whether light that falls as `cos^g` leaves as that of a matte surface.
fn is_lambertian(exponent: f32) -> bool {
    (exponent - 1.0).abs() < 1e-3
}

/// Points of the unit square, evenly.
fn unit_square() -> impl Iterator<Item = Vec2> {
    let at = |cell: usize| (cell as f32 + 0.5) / SIDE as f32;
    (0..SIDE * SIDE).map(move |number| Vec2::new(at(number % SIDE), at(number / SIDE)))
}

fn words(vector: Vec3) -> String {
    format!("{} {} {}", vector.x, vector.y, vector.z)
}

/// The transform of what follows, column by column.
fn concat(place: Mat4) -> String {
    let numbers: Vec<String> = place.to_cols_array().iter().map(f32::to_string).collect();
    format!("ConcatTransform [ {} ]", numbers.join(" "))
}
