//! A scene as an experiment file, with the meshes, maps and spectra that it names.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

use fluorspar::geometry::{MeshInstances, TriangleMesh};
use fluorspar::light::{ConeEdge, Emitter, EnvironmentMap, Light, PointPattern};
use fluorspar::material::{Coated, ImageTexture, Lambertian, Material, ScalarTexture, Scattering};
use fluorspar::optics::PerspectiveCamera;
use fluorspar::scene::{Object, Scene, Shape, SurfaceEmission};
use fluorspar::spectral::{Curve, Fluorophore, Stokes, YieldDensity, YieldUnit};
use fluorspar::study::Study;
use fluorspar_experiment::schema::{
    Aim, CheckerMap, ConductorSection, DielectricSection, DiffuseSection, DiscShape, DistantLight,
    DistantStrength, EdgeBins, EmissionSection, EmissionSides, EmitterSection, EnvironmentLight,
    EnvironmentMapReference, EnvironmentStrength, ExperimentFile, FilePath, FluorophoreSection,
    FluorophoreSource, GlossSection, ImageMap, LensOrNumber, LightFrame, LightSection, MaterialSection,
    MatrixSource, MeshShape, MetalIndex, MetalReference, MixSection, NoiseMap, ObjectSection, PlacesSection,
    PointLight, ReflectanceReference, ReflectanceTermSection, ScatteringSection, ShapeSection,
    SourceStrength, SpectralSection, SpectrumReference, SpectrumTable, SphereShape, SpotLight,
    TextureReference, TextureTable, TwoSidedSection,
};
use fluorspar_format::{FormatError, eem_csv, write_atomically, write_gray_png, write_ply};
use glam::{Vec2, Vec3};

use crate::convert::PbrtStudy;

/// Most entries of a list of an experiment file.
const MOST_ENTRIES: usize = 10_000;

/// A scene in the form of another program, and the files beside it: an experiment that says what a scene of pbrt says, or the reverse.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvertedScene {
    /// The scene.
    pub text: String,
    /// What of the scene it does not hold.
    pub lost: Vec<String>,
    /// Files that it names, by their names in the folder that they share.
    files: Vec<(String, Companion)>,
}

/// A file beside an experiment.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Companion {
    Mesh(Arc<TriangleMesh>),
    Image { width: usize, height: usize, values: Vec<f32> },
    Text(String),
}

impl ConvertedScene {
    pub(crate) fn new(text: String, lost: Vec<String>, files: Vec<(String, Companion)>) -> Self {
        Self { text, lost, files }
    }

    /// Names of the files in the folder that the text names.
    pub fn files(&self) -> impl Iterator<Item = &str> {
        self.files.iter().map(|(name, _)| name.as_str())
    }

    /// Writes the files that the text names into their folder, which must be there.
    ///
    /// # Errors
    /// A file that can't be written.
    pub fn write_files(&self, folder: &Path) -> Result<(), FormatError> {
        for (name, companion) in &self.files {
            let path = folder.join(name);
            match companion {
                Companion::Mesh(mesh) => write_ply(&path, mesh)?,
                Companion::Image { width, height, values } => write_gray_png(&path, *width, *height, values)?,
                Companion::Text(text) => {
                    write_atomically(&path, |file| std::io::Write::write_all(file, text.as_bytes()))?;
                }
            }
        }
        Ok(())
    }
}

/// Writes a scene as an experiment. The files that it names lie in `folder`, a name relative to the experiment file.
///
/// # Errors
/// A scene with more objects, materials or lights than an experiment file takes.
pub fn to_experiment(loaded: &PbrtStudy, title: &str, folder: &str) -> Result<ConvertedScene, String> {
    let scene = &loaded.study.scene;
    let counts = [
        ("objects", scene.objects.len()),
        ("materials", scene.materials.len()),
        ("lights", scene.lights.len()),
    ];
    if let Some((what, count)) = counts.iter().find(|(_, count)| *count > MOST_ENTRIES) {
        return Err(format!(
            "the scene has {count} {what}; an experiment file takes at most {MOST_ENTRIES}. Join shapes of one material into \
             meshes"
        ));
    }
    let mut writer = SceneWriter::new(folder, scene);
    let file = writer.file(&loaded.study, title);
    let SceneWriter { mut lost, files, .. } = writer;
    lost.dedup();
    let body = fluorspar_experiment::file_text(&file).map_err(|error| error.to_string())?;
    let mut text = format!("# {title}, a scene of pbrt, {} scene convert\n", fluorspar_format::WRITTEN_BY);
    let remarks = loaded.messages.iter().zip(&loaded.remarks).filter(|(_, remark)| remark.matters);
    for line in remarks.map(|(line, _)| line).chain(&lost) {
        let _ = writeln!(text, "# {}", line.replace(char::is_control, " "));
    }
    text.push_str(&body);
    Ok(ConvertedScene { text, lost, files })
}

/// An experiment as it grows.
struct SceneWriter<'a> {
    folder: &'a str,
    lost: Vec<String>,
    files: Vec<(String, Companion)>,
    spectra: Vec<(Curve, String)>,
    images: Vec<(Arc<ImageTexture>, String)>,
    materials: Vec<String>,
    /// Factors on the concentrations of fluorophores: their yields may be 1 at most.
    amounts: Vec<f64>,
}

impl<'a> SceneWriter<'a> {
    fn new(folder: &'a str, scene: &Scene) -> Self {
        Self {
            folder,
            lost: Vec::new(),
            files: Vec::new(),
            spectra: Vec::new(),
            images: Vec::new(),
            materials: unique_names(scene.materials.iter().map(|material| material.name.as_str())),
            amounts: Vec::new(),
        }
    }

    fn file(&mut self, study: &Study, title: &str) -> ExperimentFile {
        let scene = &study.scene;
        let mut file = ExperimentFile {
            title: title.into(),
            spectral: SpectralSection::Edges(EdgeBins { edges_nm: scene.grid.edges_nm().to_vec() }),
            ..ExperimentFile::default()
        };
        let camera = &self.centered(&scene.camera);
        file.render.width_px = u32::try_from(camera.width).unwrap_or(u32::MAX);
        file.render.height_px = u32::try_from(camera.height).unwrap_or(u32::MAX);
        file.render.samples_per_pixel = study.render.samples_per_pixel;
        file.render.max_depth = study.render.max_depth;
        file.render.seed = study.render.seed;
        file.camera.position_mm = mm(camera.position);
        // What is in focus at a kilometer is so beyond
        let focus = camera.aperture.as_ref().map_or(0.1, |aperture| aperture.focus().min(1e3));
        file.camera.look_at_mm = mm(camera.position + focus * camera.forward);
        if let Some(aperture) = &camera.aperture {
            file.camera.aperture_mm = LensOrNumber::Number(2e3 * f64::from(aperture.radius()));
        }
        file.camera.up = numbers(camera.up);
        match camera.parallel_half_width_m {
            Some(half) => {
                file.camera.parallel_width_mm = Some(2e3 * f64::from(half));
            }
            None => {
                let degrees = 2.0 * f64::from(camera.tan_half_width).atan().to_degrees();
                file.camera.horizontal_field_deg = LensOrNumber::Number(degrees);
            }
        }
        if camera.lens.is_some() {
            self.lost.push(
                "the lens: the camera is a pinhole in its entrance pupil; add [lens] with type = \"traced\", and a [sensor] of the \
                 width of the film"
                    .into(),
            );
        }
        for fluorophore in &scene.fluorophores {
            let section = self.fluorophore(fluorophore);
            file.fluorophore.push(section);
        }
        for (number, material) in scene.materials.iter().enumerate() {
            let section = self.material(number, material, scene);
            file.material.push(section);
        }
        let names = unique_names(scene.objects.iter().map(|object| object.name.as_str()));
        for (object, name) in scene.objects.iter().zip(names) {
            let section = self.object(object, name, scene);
            file.object.push(section);
        }
        for light in &scene.lights {
            self.light(light, scene, &mut file.light);
        }
        file
    }

    /// The camera whose image, about its axis, holds the window that a camera sees.
    fn centered(&mut self, camera: &PerspectiveCamera) -> PerspectiveCamera {
        let off = camera.center.abs();
        if off == Vec2::ZERO {
            return camera.clone();
        }
        self.lost.push(
            "the camera sees a window off its axis: the experiment's image is the one about the axis that holds it".into(),
        );
        // The offset is in halves of the width for both sides.
        let (width, height) = (camera.width as f32, camera.height as f32);
        let whole = |side: f32| (side - 1e-3).ceil();
        let wide = whole(width * (1.0 + off.x));
        let scale = wide / width;
        PerspectiveCamera {
            tan_half_width: camera.tan_half_width * scale,
            parallel_half_width_m: camera.parallel_half_width_m.map(|half| half * scale),
            center: Vec2::ZERO,
            width: wide as usize,
            height: whole(height + width * off.y) as usize,
            ..camera.clone()
        }
    }

    /// A file beside the experiment: its path in the text.
    fn add(&mut self, name: String, companion: Companion) -> FilePath {
        let is_taken = self.files.iter().any(|(other, _)| *other == name);
        let name = if is_taken { format!("{}_{name}", self.files.len()) } else { name };
        let path = format!("{}/{name}", self.folder);
        self.files.push((name, companion));
        FilePath::from(path)
    }

    fn spectrum(&mut self, curve: &Curve) -> SpectrumReference {
        let values = curve.values();
        if curve.range_nm() == (200.0, 1200.0) && values.iter().all(|value| *value == values[0]) {
            return SpectrumReference::Constant(values[0]);
        }
        let known = self.spectra.iter().find(|(other, _)| other == curve).map(|(_, path)| path.clone());
        let path = known.unwrap_or_else(|| {
            let mut text = format!("# {}\nwavelength_nm,value\n", fluorspar_format::WRITTEN_BY);
            for (nm, value) in curve.wavelengths_nm().iter().zip(values) {
                let _ = writeln!(text, "{nm},{value}");
            }
            let path = self.add(format!("spectrum_{}.csv", self.spectra.len()), Companion::Text(text));
            self.spectra.push((curve.clone(), path.as_str().into()));
            path.as_str().into()
        });
        SpectrumReference::Table(SpectrumTable {
            csv: FilePath::from(path),
            column: None,
            unit: None,
            scale: None,
            outside: None,
        })
    }

    /// A texture times a factor.
    fn texture(&mut self, texture: &ScalarTexture, factor: f64) -> TextureReference {
        let scaled = |value: f32| f64::from(value) * factor;
        let table = match texture {
            ScalarTexture::Constant(value) => return TextureReference::Constant(scaled(*value)),
            ScalarTexture::Image { image, low, high } => {
                let (path, top) = self.image(image);
                let (low, high) = (scaled(*low), scaled(*high));
                let high = low + (high - low) * f64::from(top);
                TextureTable::Image(ImageMap { image: path, srgb: false, low, high, times: None })
            }
            ScalarTexture::Checker { columns, rows, low, high } => TextureTable::Checker(CheckerMap {
                checker: [*columns, *rows],
                low: scaled(*low),
                high: scaled(*high),
                times: None,
            }),
            ScalarTexture::Noise { cells, seed, low, high } => TextureTable::Noise(NoiseMap {
                noise: cells.map(f64::from),
                seed: *seed,
                low: scaled(*low),
                high: scaled(*high),
                times: None,
            }),
            ScalarTexture::Product(first, second) => return self.product(first, second, factor),
        };
        TextureReference::Map(Box::new(table))
    }

    fn product(&mut self, first: &ScalarTexture, second: &ScalarTexture, factor: f64) -> TextureReference {
        let (first, second) = match first.constant() {
            Some(value) => return self.texture(second, factor * f64::from(value)),
            None => (self.texture(first, factor), self.texture(second, 1.0)),
        };
        let TextureReference::Map(mut table) = first else { return first };
        let times = match table.as_mut() {
            TextureTable::Image(map) => &mut map.times,
            TextureTable::Checker(map) => &mut map.times,
            TextureTable::Noise(map) => &mut map.times,
            _ => return TextureReference::Map(table),
        };
        if times.is_some() {
            self.lost.push("a product of more than two textures: two of them are kept".into());
        }
        *times = Some(second);
        TextureReference::Map(table)
    }

    /// An image as a file, and the value of its white.
    fn image(&mut self, image: &Arc<ImageTexture>) -> (FilePath, f32) {
        let top = if image.max() > 0.0 { image.max() } else { 1.0 };
        if let Some((_, path)) =
            self.images.iter().find(|(other, _)| Arc::ptr_eq(other, image) || other == image)
        {
            return (FilePath::from(path.clone()), top);
        }
        let (width, height) = image.size();
        let values = image.values().iter().map(|value| value / top).collect();
        let name = format!("map_{}.png", self.images.len());
        let path = self.add(name, Companion::Image { width, height, values });
        if self.images.is_empty() {
            self.lost.push("maps are stored in 16 bits: steps of 1/65535 of their largest value".into());
        }
        self.images.push((Arc::clone(image), path.as_str().into()));
        (path, top)
    }

    fn fluorophore(&mut self, fluorophore: &Fluorophore) -> FluorophoreSection {
        let eem = &fluorophore.eem;
        let mut text = format!("# {}\n# unit: photons\n", fluorspar_format::WRITTEN_BY);
        if let YieldDensity::Table(table) = eem.density() {
            text += &eem_csv(&table.excitation_nm, &table.emission_nm, &table.values);
        }
        let best = best_yield(fluorophore);
        let amount = best.max(1.0);
        self.amounts.push(amount);
        let name = format!("{}.csv", file_name(&fluorophore.name));
        let eem_csv = self.add(name, Companion::Text(text));
        FluorophoreSection {
            name: fluorophore.name.clone(),
            title: None,
            source: FluorophoreSource::Matrix(MatrixSource {
                eem_csv,
                unit: Some(YieldUnit::Photons),
                sample: None,
            }),
            photon_yield: Some(best / amount),
            stokes: Some(eem.stokes()),
            allow_negative: false,
            // What the mask leaves out is in the table, too.
            allow_anti_stokes: true,
            empty_cells: Default::default(),
        }
    }

    fn concentrations(&mut self, material: &Material, scene: &Scene) -> BTreeMap<String, TextureReference> {
        let mut all = BTreeMap::new();
        for amount in &material.fluorophores {
            let factor = self.amounts[amount.fluorophore];
            let texture = self.texture(&amount.concentration, factor);
            all.insert(scene.fluorophores[amount.fluorophore].name.clone(), texture);
        }
        all
    }

    fn material(&mut self, number: usize, material: &Material, scene: &Scene) -> MaterialSection {
        let concentrations = self.concentrations(material, scene);
        let scattering = match &material.scattering {
            Scattering::Lambertian(base) => ScatteringSection::Diffuse(DiffuseSection {
                reflectance: self.reflectance(base),
                gloss: None,
                concentrations,
            }),
            Scattering::Coated(Coated { base, coat }) => ScatteringSection::Diffuse(DiffuseSection {
                reflectance: self.reflectance(base),
                gloss: Some(GlossSection {
                    refractive_index: f64::from(coat.refractive_index),
                    roughness: self.texture(&coat.roughness, 1.0),
                    smoothing_mm: 1e3 * f64::from(coat.smoothing_m),
                }),
                concentrations,
            }),
            Scattering::Dielectric(dielectric) => ScatteringSection::Dielectric(DielectricSection {
                refractive_index: f64::from(dielectric.refractive_index),
                roughness: self.texture(&dielectric.roughness, 1.0),
                transmittance: self.spectrum(&dielectric.transmittance),
                single_scattering: dielectric.single_scattering,
                concentrations,
            }),
            Scattering::Conductor(conductor) => {
                let (n, k) = (self.spectrum(&conductor.n), self.spectrum(&conductor.k));
                ScatteringSection::Conductor(ConductorSection {
                    metal: MetalReference::Index(MetalIndex { n, k }),
                    roughness: self.texture(&conductor.roughness, 1.0),
                    single_scattering: conductor.single_scattering,
                    concentrations,
                })
            }
            Scattering::Mixture(mixture) => ScatteringSection::Mix(MixSection {
                first: self.materials[mixture.first].clone(),
                second: self.materials[mixture.second].clone(),
                amount: self.texture(&mixture.amount, 1.0),
            }),
            Scattering::TwoSided(sides) => ScatteringSection::TwoSided(TwoSidedSection {
                front: self.materials[sides.front].clone(),
                back: self.materials[sides.back].clone(),
            }),
        };
        if material.normal_map.is_some() {
            self.lost.push(format!("the normal map of material \"{}\"", self.materials[number]));
        }
        MaterialSection {
            name: self.materials[number].clone(),
            opacity: material.opacity.as_ref().map(|opacity| self.texture(opacity, 1.0)),
            normal_map: None,
            scattering,
        }
    }

    fn reflectance(&mut self, base: &Lambertian) -> ReflectanceReference {
        if let [term] = base.reflectance.as_slice()
            && term.weight.constant() == Some(1.0)
        {
            return ReflectanceReference::Spectrum(self.spectrum(&term.spectrum));
        }
        let terms = base.reflectance.iter().map(|term| ReflectanceTermSection {
            spectrum: self.spectrum(&term.spectrum),
            weight: self.texture(&term.weight, 1.0),
        });
        let terms: Vec<ReflectanceTermSection> = terms.collect();
        match terms.is_empty() {
            true => ReflectanceReference::Spectrum(SpectrumReference::Constant(0.0)),
            false => ReflectanceReference::Sum(terms),
        }
    }

    fn object(&mut self, object: &Object, name: String, scene: &Scene) -> ObjectSection {
        let stem = file_name(&name);
        let shape = match &object.shape {
            Shape::Sphere { center, radius_m } => ShapeSection::Sphere(SphereShape {
                center_mm: mm(*center),
                radius_mm: 1e3 * f64::from(*radius_m),
            }),
            Shape::Disc { center, normal, radius_m } => ShapeSection::Disc(DiscShape {
                center_mm: mm(*center),
                normal: numbers(*normal),
                radius_mm: 1e3 * f64::from(*radius_m),
            }),
            Shape::Mesh(mesh) => self.mesh(&stem, mesh, PlacesSection::default()),
            Shape::Instances(instances) => {
                let places = self.add(format!("{stem}_places.csv"), Companion::Text(places_text(instances)));
                let places = PlacesSection { instance: Vec::new(), instance_file: Some(places) };
                match instances.meshes.first() {
                    Some(mesh) => self.mesh(&stem, mesh, places),
                    None => self.mesh(&stem, &Arc::default(), places),
                }
            }
        };
        ObjectSection {
            name,
            material: self.materials[object.material].clone(),
            transform: None,
            emission: object.emission.as_ref().map(|emission| self.emission(emission, scene)),
            shape,
        }
    }

    fn mesh(&mut self, stem: &str, mesh: &Arc<TriangleMesh>, places: PlacesSection) -> ShapeSection {
        let file = self.add(format!("{stem}.ply"), Companion::Mesh(Arc::clone(mesh)));
        ShapeSection::Mesh(MeshShape { file, unit_mm: 1000.0, displacement: None, places })
    }

    fn emission(&mut self, emission: &SurfaceEmission, scene: &Scene) -> EmissionSection {
        EmissionSection {
            group: scene.light_groups[emission.group].name.clone(),
            spectrum: self.spectrum(&emission.radiance),
            radiance_w_per_sr_m2: emission.radiance.total(),
            sides: if emission.is_one_sided { EmissionSides::Front } else { EmissionSides::Both },
        }
    }

    fn light(&mut self, light: &Light, scene: &Scene, list: &mut Vec<LightSection>) {
        let total = light.spectrum.total();
        let power = SourceStrength::Power { power_mw: 1e3 * total };
        let emitter = match &light.emitter {
            Emitter::Point(point) => match point.pattern {
                PointPattern::Even => EmitterSection::Point(PointLight {
                    frame: LightFrame::Scene,
                    position_mm: mm(point.position),
                    strength: power,
                }),
                PointPattern::Lobe { axis, exponent } => EmitterSection::Spot(SpotLight {
                    half_angle_deg: Some(half_angle_deg(f64::from(exponent))),
                    ..spot(point.position, axis, power)
                }),
                PointPattern::Cone(cone) => EmitterSection::Spot(SpotLight {
                    cone_deg: Some(cone.angles_deg()),
                    edge: Some(cone.edge()).filter(|edge| *edge != ConeEdge::SmoothStep),
                    ..spot(point.position, cone.axis(), power)
                }),
            },
            Emitter::Distant(distant) => EmitterSection::Distant(DistantLight {
                frame: LightFrame::Scene,
                aim: Some(Aim::Direction { direction: numbers(distant.direction) }),
                strength: DistantStrength { irradiance_w_per_m2: total },
            }),
            Emitter::Environment => EmitterSection::Environment(EnvironmentLight {
                strength: EnvironmentStrength { radiance_w_per_sr_m2: total },
                map: None,
            }),
            Emitter::EnvironmentMap(map) => return self.environment(light, map, scene, list),
            _ => {
                self.lost.push(format!("light \"{}\", of a kind that scenes of pbrt don't have", light.name));
                return;
            }
        };
        list.push(self.light_section(&light.name.to_string(), &light.spectrum, emitter, scene));
    }

    fn light_section(
        &mut self,
        name: &str,
        spectrum: &Curve,
        emitter: EmitterSection,
        scene: &Scene,
    ) -> LightSection {
        LightSection {
            name: name.into(),
            group: scene.light_groups.first().map(|group| group.name.clone()),
            spectrum: self.spectrum(spectrum),
            filters: Vec::new(),
            filter_angle_deg: 0.0,
            crossed_polarizers: false,
            emitter,
        }
    }

    /// A light for each layer of a map.
    fn environment(
        &mut self,
        light: &Light,
        map: &EnvironmentMap,
        scene: &Scene,
        list: &mut Vec<LightSection>,
    ) {
        let (width, height) = map.size();
        for (number, layer) in map.layers().iter().enumerate() {
            let top = layer.factors.iter().copied().fold(0.0, f32::max);
            let values = layer.factors.iter().map(|value| value / top).collect();
            let name = format!("{}_{number}", light.name);
            let file =
                self.add(format!("{}.png", file_name(&name)), Companion::Image { width, height, values });
            let spectrum = light.spectrum.times(&layer.spectrum).scaled(f64::from(top));
            let emitter = EmitterSection::Environment(EnvironmentLight {
                strength: EnvironmentStrength { radiance_w_per_sr_m2: spectrum.total() },
                map: Some(EnvironmentMapReference::File(file)),
            });
            list.push(self.light_section(&name, &spectrum, emitter, scene));
        }
        self.lost.push(format!(
            "what light \"{}\" has below 1/65535 of its brightest pixel: its map is stored in 16 bits",
            light.name
        ));
    }
}

/// Photons out per photon in at the best excitation, as an experiment file takes it from a matrix.
fn best_yield(fluorophore: &Fluorophore) -> f64 {
    let YieldDensity::Table(table) = fluorophore.eem.density() else { return 1.0 };
    let ends = |nodes: &[f64]| (nodes[0], nodes[nodes.len() - 1]);
    let (excitation, emission) = (ends(&table.excitation_nm), ends(&table.emission_nm));
    let unmasked = fluorophore.eem.clone().with_stokes(Stokes::Off);
    let steps = ((excitation.1 - excitation.0).ceil() as usize).max(1);
    (0..=steps)
        .map(|step| (excitation.0 + step as f64).min(excitation.1))
        .map(|nm| unmasked.photon_yield(nm, emission.0, emission.1))
        .fold(f64::MIN_POSITIVE, f64::max)
}

/// A spot that does not say its pattern.
fn spot(position: Vec3, axis: Vec3, strength: SourceStrength) -> SpotLight {
    SpotLight {
        frame: LightFrame::Scene,
        position_mm: mm(position),
        aim: Some(Aim::Direction { direction: numbers(axis) }),
        half_angle_deg: None,
        cone_deg: None,
        edge: None,
        strength,
    }
}

/// The angle at which `cos^g` is one half.
fn half_angle_deg(exponent: f64) -> f64 {
    if exponent <= 0.0 { 90.0 - 1e-9 } else { 0.5_f64.powf(1.0 / exponent).acos().to_degrees() }
}

/// Twelve numbers a place, displacements in mm.
fn places_text(instances: &MeshInstances) -> String {
    let mut text = format!("# {}: xx, xy, xz, mm, yx, ...\n", fluorspar_format::WRITTEN_BY);
    for instance in &instances.instances {
        let (m, t) = (instance.to_world.matrix3, instance.to_world.translation);
        let row = |r: usize| [m.x_axis[r], m.y_axis[r], m.z_axis[r], 1e3 * t[r]];
        let numbers: Vec<String> = (0..3).flat_map(row).map(|number| number.to_string()).collect();
        let _ = writeln!(text, "{}", numbers.join(","));
    }
    text
}

/// Names that are not empty and differ.
pub(crate) fn unique_names<'n>(names: impl Iterator<Item = &'n str>) -> Vec<String> {
    let mut taken = std::collections::BTreeSet::new();
    let unique = |name: &str| {
        let base = if name.trim().is_empty() { "unnamed" } else { name };
        let numbered = (2..).map(|number| format!("{base}_{number}"));
        let free = std::iter::once(base.to_string()).chain(numbered).find(|name| !taken.contains(name));
        let free = free.unwrap_or_default();
        taken.insert(free.clone());
        free
    };
    names.map(unique).collect()
}

/// A name that every disk takes.
pub(crate) fn file_name(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    name.chars().map(plain).take(100).collect::<String>().trim_start_matches('.').to_string()
}

fn mm(point: Vec3) -> [f64; 3] {
    numbers(point).map(|value| 1e3 * value)
}

fn numbers(vector: Vec3) -> [f64; 3] {
    vector.to_array().map(f64::from)
}
