//! Reads scenes: directives, their stack of attributes, and files that include others.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use flate2::read::GzDecoder;
use glam::{DMat4, DVec3};

use super::error::{Fault, PbrtError, PbrtPlace};
use super::parameter::{PbrtKind, PbrtParameter, parameters};
use super::scene::{
    PbrtEntity, PbrtInstance, PbrtMaterial, PbrtPlaced, PbrtRemark, PbrtScene, PbrtShape, PbrtTexture,
    PbrtVersion,
};
use super::token::{Token, Tokens, number};
use super::transform::{inverse, look_at, rotate};
use crate::store::input::read_bounded;
use fluorspar::names::did_you_mean;
use fluorspar::quote::excerpt;

/// Largest file that is read, bytes.
const MAX_FILE_BYTES: u64 = 1 << 30;
/// Most bytes of all files of a scene; one that is included twice counts twice.
const MAX_SCENE_BYTES: u64 = 4 << 30;
/// Bytes that a file counts at least: opening one takes about as long, and files of a few bytes have an end, too.
const LEAST_FILE_BYTES: u64 = 16 << 10;
/// Most files within files.
const MAX_INCLUDE_DEPTH: usize = 32;
/// Most blocks within blocks.
const MAX_BLOCK_DEPTH: usize = 4096;
/// Most values of all parameters.
const MAX_VALUES: usize = 400_000_000;

/// Every directive of the format.
const DIRECTIVES: &[&str] = &[
    "Accelerator",
    "ActiveTransform",
    "AreaLightSource",
    "Attribute",
    "AttributeBegin",
    "AttributeEnd",
    "Camera",
    "ColorSpace",
    "ConcatTransform",
    "CoordSysTransform",
    "CoordinateSystem",
    "Film",
    "Identity",
    "Import",
    "Include",
    "Integrator",
    "LightSource",
    "LookAt",
    "MakeNamedMaterial",
    "MakeNamedMedium",
    "Material",
    "MediumInterface",
    "NamedMaterial",
    "ObjectBegin",
    "ObjectEnd",
    "ObjectInstance",
    "Option",
    "PixelFilter",
    "Renderer",
    "ReverseOrientation",
    "Rotate",
    "Sampler",
    "Scale",
    "Shape",
    "SurfaceIntegrator",
    "Texture",
    "Transform",
    "TransformBegin",
    "TransformEnd",
    "TransformTimes",
    "Translate",
    "Volume",
    "VolumeIntegrator",
    "WorldBegin",
    "WorldEnd",
];

/// Types that only version 4 has.
const V4_CLASSES: &[&str] = &[
    "diffuse",
    "coateddiffuse",
    "coatedconductor",
    "diffusetransmission",
    "dielectric",
    "thindielectric",
    "conductor",
    "interface",
    "measured",
    "bilinearmesh",
    "rgb",
    "spectral",
    "gbuffer",
    "spherical",
    "zsobol",
    "paddedsobol",
    "pmj02bn",
    "independent",
    "simplepath",
    "simplevolpath",
    "lightpath",
    "randomwalk",
];

/// Options of version 4, in small letters.
const OPTIONS: &[&str] = &[
    "disablepixeljitter",
    "disabletexturefiltering",
    "disablewavelengthjitter",
    "displacementedgescale",
    "forcediffuse",
    "msereferenceimage",
    "msereferenceout",
    "pixelstats",
    "rendercoordsys",
    "seed",
    "wavefront",
];

/// Reads a scene file and the files that it includes.
///
/// # Errors
/// Anything that is not such a scene, with file, line and column; files that can't be read, that include themselves, or
/// that are larger than any sensible scene.
pub fn read_pbrt(path: &Path) -> Result<PbrtScene, PbrtError> {
    let mut reader = Reader::default();
    reader.read_file(path, None)?;
    reader.finish()
}

/// What directives change and blocks restore.
#[derive(Clone, Debug)]
struct State {
    /// From the current frame to the world.
    to_world: DMat4,
    material: Option<usize>,
    /// Name of a material that is defined later, with the place that asks for it.
    awaited_material: Option<(String, PbrtPlace)>,
    area_light: Option<usize>,
    is_reversed: bool,
    /// Whether transforms apply at the start of the exposure.
    is_start_active: bool,
    /// Parameters that `Attribute` gives to all that follows, by the kind of directive.
    defaults: BTreeMap<&'static str, Vec<PbrtParameter>>,
    /// What the block redefined, and what it was before: in version 3 textures and named materials belong to the block, and version 4
    /// redefines none.
    redefined: Vec<Redefined>,
}

/// A name that a block gave to something else.
#[derive(Clone, Debug)]
enum Redefined {
    Texture(String, [Option<usize>; 2]),
    Material(String, usize),
}

impl Default for State {
    fn default() -> Self {
        Self {
            to_world: DMat4::IDENTITY,
            material: None,
            awaited_material: None,
            area_light: None,
            is_reversed: false,
            is_start_active: true,
            defaults: BTreeMap::new(),
            redefined: Vec::new(),
        }
    }
}

/// A block that is open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Block {
    Attribute,
    Transform,
    Object,
}

impl Block {
    fn name(self) -> &'static str {
        match self {
            Self::Attribute => "Attribute",
            Self::Transform => "Transform",
            Self::Object => "Object",
        }
    }
}

#[derive(Debug, Default)]
struct Reader {
    scene: PbrtScene,
    state: State,
    blocks: Vec<(Block, State, PbrtPlace)>,
    frames: BTreeMap<String, DMat4>,
    /// Last textures of each name: of numbers, of spectra.
    textures: BTreeMap<String, [Option<usize>; 2]>,
    /// Open object.
    object: Option<usize>,
    objects: BTreeMap<String, usize>,
    /// Shapes whose materials are named but not defined yet.
    awaiting: Vec<(usize, String, PbrtPlace)>,
    /// Files that are being read, outermost first.
    open_files: Vec<PathBuf>,
    bytes: u64,
    values_left: Option<usize>,
}

type Outcome<T> = Result<T, Fault>;

impl Reader {
    fn finish(mut self) -> Result<PbrtScene, PbrtError> {
        if let Some((block, _, at)) = self.blocks.pop() {
            let name = block.name();
            return Err(self.scene.error(at, format!("{name}Begin is never closed; add {name}End")));
        }
        for (shape, name, at) in std::mem::take(&mut self.awaiting) {
            match self.scene.named_materials.get(&name) {
                Some(&material) => self.scene.shapes[shape].material = Some(material),
                // Version 3 goes on with a matte one.
                None if self.scene.version == PbrtVersion::V3 => {
                    let text = format!(
                        "\"{}\" is taken as matte, as in pbrt-v3: no MakeNamedMaterial defines it{}",
                        excerpt(&name),
                        did_you_mean(&name, self.scene.named_materials.keys().map(String::as_str))
                    );
                    self.remark(at, text, true);
                }
                None => return Err(self.unknown_material(&name, at)),
            }
        }
        self.resolve_late_textures()?;
        Ok(self.scene)
    }

    fn unknown_material(&self, name: &str, at: PbrtPlace) -> PbrtError {
        let known = self.scene.named_materials.keys().map(String::as_str);
        let hint = did_you_mean(name, known);
        self.scene.error(at, format!("no MakeNamedMaterial defines \"{}\"{hint}", excerpt(name)))
    }

    /// Finds textures that were named before they were defined.
    fn resolve_late_textures(&mut self) -> Result<(), PbrtError> {
        let known = &self.textures;
        let mut missing = None;
        let mut resolve = |entity: &mut PbrtEntity| {
            for parameter in entity.parameters.iter_mut().filter(|p| p.kind == PbrtKind::Texture) {
                let name = parameter.texts().and_then(|texts| texts.first()).cloned().unwrap_or_default();
                if parameter.texture == [None; 2] {
                    match known.get(&name) {
                        Some(found) => parameter.texture = *found,
                        None => missing = missing.take().or(Some((name, parameter.at))),
                    }
                }
            }
        };
        let PbrtScene { materials, textures, shapes, .. } = &mut self.scene;
        materials.iter_mut().for_each(|material| resolve(&mut material.entity));
        textures.iter_mut().for_each(|texture| resolve(&mut texture.entity));
        shapes.iter_mut().for_each(|shape| resolve(&mut shape.entity));
        match missing {
            None => Ok(()),
            Some((name, at)) => {
                let hint = did_you_mean(&name, self.textures.keys().map(String::as_str));
                Err(self.scene.error(at, format!("no Texture defines \"{}\"{hint}", excerpt(&name))))
            }
        }
    }

    /// Reads a file; `from` is the place that includes it.
    fn read_file(&mut self, path: &Path, from: Option<PbrtPlace>) -> Result<(), PbrtError> {
        let refuse = |scene: &PbrtScene, message: String| match from {
            Some(at) => scene.error(at, message),
            None => PbrtError { file: path.into(), at: None, message },
        };
        let identity = path.canonicalize().unwrap_or_else(|_| path.into());
        if self.open_files.contains(&identity) {
            let message = format!("{} includes itself; remove this line", path.display());
            return Err(refuse(&self.scene, message));
        }
        if self.open_files.len() == MAX_INCLUDE_DEPTH {
            let message = format!("more than {MAX_INCLUDE_DEPTH} files within files are not read; join some");
            return Err(refuse(&self.scene, message));
        }
        let bytes = read_plain(path).map_err(|message| {
            let message = if from.is_some() { format!("{}: {message}", path.display()) } else { message };
            refuse(&self.scene, message)
        })?;
        self.bytes += (bytes.len() as u64).max(LEAST_FILE_BYTES);
        if self.bytes > MAX_SCENE_BYTES {
            let message = format!(
                "the files of the scene hold more than {} GiB, each counted as often as it is included and as {} KiB at least; \
                 put meshes into .ply files and repeated parts into objects",
                MAX_SCENE_BYTES >> 30,
                LEAST_FILE_BYTES >> 10
            );
            return Err(refuse(&self.scene, message));
        }
        let file = u32::try_from(self.scene.files.len()).unwrap_or(u32::MAX);
        self.scene.files.push(path.into());
        self.open_files.push(identity);
        let mut tokens = Tokens::new(&bytes);
        loop {
            match self.directive(&mut tokens, file) {
                Ok(Some(Next::Directive)) => {}
                Ok(Some(Next::Include(name, at))) => {
                    let path = self.scene.path_of(at, &name);
                    self.read_file(&path, Some(at))?;
                }
                Ok(Some(Next::Import(name, at))) => {
                    let path = self.scene.path_of(at, &name);
                    let (state, depth) = (self.state.clone(), self.blocks.len());
                    self.read_file(&path, Some(at))?;
                    if self.blocks.len() != depth {
                        return Err(self
                            .scene
                            .error(at, "the imported file does not close all of its blocks"));
                    }
                    self.state = state;
                }
                Ok(None) => break,
                Err(Fault { at: [line, column], message }) => {
                    return Err(self.scene.error(PbrtPlace { file, line, column }, message));
                }
            }
        }
        if let Some([line, column]) = tokens.comma() {
            let text = "numbers are followed by commas, which are passed over; write them without";
            self.remark(PbrtPlace { file, line, column }, text, true);
        }
        self.open_files.pop();
        Ok(())
    }

    /// Reads one directive; `None` at the end of the file.
    fn directive(&mut self, tokens: &mut Tokens<'_>, file: u32) -> Outcome<Option<Next>> {
        let Some((token, spot)) = tokens.next()? else { return Ok(None) };
        let Token::Word(word) = token else {
            return Err(Fault::new(spot, "a directive such as Shape must stand here; is one missing above?"));
        };
        let word = String::from_utf8_lossy(word);
        let at = PbrtPlace { file, line: spot[0], column: spot[1] };
        if matches!(word.as_ref(), "Include" | "Import") {
            let name = text(tokens, spot, "the name of a file")?;
            if word == "Import" {
                self.scene.version = PbrtVersion::V4;
                return Ok(Some(Next::Import(name, at)));
            }
            return Ok(Some(Next::Include(name, at)));
        }
        let mut line = Line { tokens, spot, at };
        if self.transform(&word, &mut line)?
            || self.block(&word, &mut line)?
            || self.setting(&word, &mut line)?
        {
            return Ok(Some(Next::Directive));
        }
        if self.content(&word, &mut line)? {
            return Ok(Some(Next::Directive));
        }
        let hint = did_you_mean(&word, DIRECTIVES.iter().copied());
        Err(Fault::new(spot, format!("{} is not a directive{hint}", excerpt(&word))))
    }

    /// Directives that change the current transform.
    fn transform(&mut self, word: &str, line: &mut Line<'_, '_>) -> Outcome<bool> {
        let to_world = self.state.to_world;
        let next = match word {
            "Identity" => DMat4::IDENTITY,
            "Translate" => to_world * DMat4::from_translation(DVec3::from_array(line.numbers()?)),
            "Scale" => to_world * DMat4::from_scale(DVec3::from_array(line.numbers()?)),
            "Rotate" => {
                let [angle, x, y, z] = line.numbers()?;
                let turn = rotate(angle, DVec3::new(x, y, z));
                to_world
                    * turn.ok_or_else(|| {
                        line.fault("the axis of Rotate has no length; give one such as 0 0 1")
                    })?
            }
            "LookAt" => {
                let [a, b, c, d, e, f, g, h, i] = line.numbers()?;
                let frame = look_at(DVec3::new(a, b, c), DVec3::new(d, e, f), DVec3::new(g, h, i));
                let problem =
                    "LookAt looks at the place where it stands, or along its up vector; change one of them";
                to_world * frame.ok_or_else(|| line.fault(problem))?
            }
            "Transform" => DMat4::from_cols_array(&line.numbers::<16>()?),
            "ConcatTransform" => to_world * DMat4::from_cols_array(&line.numbers::<16>()?),
            "CoordinateSystem" => {
                let name = line.text("the name of a frame")?;
                self.frames.insert(name, to_world);
                return Ok(true);
            }
            "CoordSysTransform" => {
                let name = line.text("the name of a frame")?;
                match self.frames.get(&name) {
                    Some(frame) => *frame,
                    None => {
                        let hint = did_you_mean(&name, self.frames.keys().map(String::as_str));
                        return Err(
                            line.fault(format!("no CoordinateSystem defines \"{}\"{hint}", excerpt(&name)))
                        );
                    }
                }
            }
            "ActiveTransform" => {
                let which = line.word()?;
                self.state.is_start_active = match which.as_str() {
                    "StartTime" | "All" => true,
                    "EndTime" => false,
                    _ => return Err(line.fault("ActiveTransform takes StartTime, EndTime or All")),
                };
                if which == "EndTime" {
                    self.remark(
                        line.at,
                        "ActiveTransform EndTime: motion within an exposure is left out",
                        true,
                    );
                }
                return Ok(true);
            }
            "TransformTimes" => {
                let _: [f64; 2] = line.numbers()?;
                self.remark(line.at, "TransformTimes: motion within an exposure is left out", false);
                return Ok(true);
            }
            _ => return Ok(false),
        };
        if !next.is_finite() {
            return Err(
                line.fault(format!("{word} makes a transform that is not finite; change its numbers"))
            );
        }
        if self.state.is_start_active {
            self.state.to_world = next;
        }
        Ok(true)
    }

    /// Directives that open and close blocks, and those that only change attributes.
    fn block(&mut self, word: &str, line: &mut Line<'_, '_>) -> Outcome<bool> {
        match word {
            "AttributeBegin" => self.open(Block::Attribute, line)?,
            "TransformBegin" => self.open(Block::Transform, line)?,
            "AttributeEnd" => self.close(Block::Attribute, line)?,
            "TransformEnd" => self.close(Block::Transform, line)?,
            "ObjectBegin" => self.begin_object(line)?,
            "ObjectEnd" => {
                self.close(Block::Object, line)?;
                self.object = None;
            }
            "WorldBegin" => {
                self.state.to_world = DMat4::IDENTITY;
                self.frames.insert("world".into(), DMat4::IDENTITY);
            }
            "WorldEnd" => {}
            "ReverseOrientation" => self.state.is_reversed = !self.state.is_reversed,
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Begins the definition of an object.
    fn begin_object(&mut self, line: &mut Line<'_, '_>) -> Outcome<()> {
        let name = line.text("the name of an object")?;
        if self.object.is_some() {
            return Err(line.fault("an object can't hold the definition of another; add ObjectEnd before it"));
        }
        self.open(Block::Object, line)?;
        self.object = Some(self.scene.objects.len());
        self.objects.insert(name.clone(), self.scene.objects.len());
        self.scene.objects.push(name);
        Ok(())
    }

    fn open(&mut self, block: Block, line: &Line<'_, '_>) -> Outcome<()> {
        if self.blocks.len() == MAX_BLOCK_DEPTH {
            return Err(line.fault(format!("more than {MAX_BLOCK_DEPTH} blocks within blocks are not read")));
        }
        self.blocks.push((block, self.state.clone(), line.at));
        if block != Block::Transform {
            self.state.redefined.clear();
        }
        Ok(())
    }

    fn close(&mut self, block: Block, line: &Line<'_, '_>) -> Outcome<()> {
        let name = block.name();
        match self.blocks.pop() {
            // A block of transforms restores nothing else in version 3.
            Some((Block::Transform, state, _)) if block == Block::Transform => {
                self.state.to_world = state.to_world
            }
            Some((open, state, _)) if open == block => {
                for redefined in std::mem::replace(&mut self.state, state).redefined.into_iter().rev() {
                    match redefined {
                        Redefined::Texture(name, before) => drop(self.textures.insert(name, before)),
                        Redefined::Material(name, before) => {
                            self.scene.named_materials.insert(name, before);
                        }
                    }
                }
            }
            Some((open, _, at)) => {
                let message = format!(
                    "{name}End closes the {}Begin of line {}; add {0}End before it",
                    open.name(),
                    at.line
                );
                return Err(line.fault(message));
            }
            None => return Err(line.fault(format!("no {name}Begin is open here; remove this {name}End"))),
        }
        Ok(())
    }

    /// Directives that speak of the whole scene.
    fn setting(&mut self, word: &str, line: &mut Line<'_, '_>) -> Outcome<bool> {
        match word {
            "Camera" => {
                let entity = self.entity(line, None)?;
                let to_world = inverse(&self.state.to_world)
                    .ok_or_else(|| line.fault("the transform of the camera has no inverse; change it"))?;
                self.frames.insert("camera".into(), to_world);
                self.scene.settings.camera = Some(PbrtPlaced { entity, to_world });
            }
            "Film" => self.scene.settings.film = Some(self.entity(line, None)?),
            "Sampler" => self.scene.settings.sampler = Some(self.entity(line, None)?),
            "Integrator" | "SurfaceIntegrator" => {
                self.scene.settings.integrator = Some(self.entity(line, None)?)
            }
            "PixelFilter" => {
                let entity = self.entity(line, None)?;
                let text = format!(
                    "PixelFilter \"{}\": pixels are plain means of their samples",
                    excerpt(&entity.class)
                );
                self.remark(line.at, text, false);
            }
            "Accelerator" | "Renderer" | "VolumeIntegrator" => {
                let entity = self.entity(line, None)?;
                let text =
                    format!("{word} \"{}\": the picture does not depend on it", excerpt(&entity.class));
                self.remark(line.at, text, false);
            }
            "ColorSpace" => {
                self.scene.version = PbrtVersion::V4;
                let name = line.text("the name of a color space")?;
                if name != "srgb" {
                    let text = format!("ColorSpace \"{}\": colors are taken as sRGB", excerpt(&name));
                    self.remark(line.at, text, true);
                }
            }
            "Option" => {
                self.scene.version = PbrtVersion::V4;
                let name = line.text("the name of an option")?;
                let value = line.value()?;
                self.option(&name, &value, line.at);
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// `Option "seed" 7`. The name may be written in any case, with a type before it.
    fn option(&mut self, name: &str, value: &str, at: PbrtPlace) {
        let word = name.split_ascii_whitespace().last().unwrap_or_default();
        let plain: String = word.to_lowercase().chars().filter(|c| !matches!(c, '-' | '_')).collect();
        let name = excerpt(word);
        match plain.as_str() {
            "seed" => {
                self.scene.settings.seed = value.parse().ok();
                if self.scene.settings.seed.is_none() {
                    self.remark(
                        at,
                        "Option \"seed\": no whole number of 0 or more; the usual seed is used",
                        true,
                    );
                }
            }
            "forcediffuse" if value == "true" => {
                let text = format!("Option \"{name}\": materials stay as they are, not diffuse");
                self.remark(at, text, true);
            }
            _ if OPTIONS.contains(&plain.as_str()) => {
                self.remark(at, format!("Option \"{name}\": it has no effect here"), false);
            }
            _ => {
                let hint = did_you_mean(&plain, OPTIONS.iter().copied());
                self.remark(at, format!("Option \"{name}\" is not known and left out{hint}"), true);
            }
        }
    }

    /// Directives that make up the scene.
    fn content(&mut self, word: &str, line: &mut Line<'_, '_>) -> Outcome<bool> {
        match word {
            "Attribute" => self.attribute(line)?,
            "Texture" => self.texture(line)?,
            "Material" => {
                let entity = self.entity(line, Some("material"))?;
                self.state.material = Some(self.scene.materials.len());
                self.state.awaited_material = None;
                self.scene.materials.push(PbrtMaterial { name: None, entity });
            }
            "MakeNamedMaterial" => self.named_material(line)?,
            "NamedMaterial" => {
                let name = line.text("the name of a material")?;
                self.state.material = self.scene.named_materials.get(&name).copied();
                self.state.awaited_material = self.state.material.is_none().then_some((name, line.at));
            }
            "LightSource" => {
                let entity = self.entity(line, Some("light"))?;
                self.scene.lights.push(PbrtPlaced { entity, to_world: self.state.to_world });
            }
            "AreaLightSource" => {
                let entity = self.entity(line, Some("light"))?;
                self.state.area_light = Some(self.scene.area_lights.len());
                self.scene.area_lights.push(entity);
            }
            "Shape" => self.shape(line)?,
            "ObjectInstance" => self.instance(line)?,
            "MakeNamedMedium" | "Volume" => {
                let entity = self.entity(line, Some("medium"))?;
                let text = format!("{word} \"{}\": participating media are left out", excerpt(&entity.class));
                self.remark(line.at, text, true);
            }
            "MediumInterface" => {
                let names = line.texts();
                if names?.iter().any(|name| !name.is_empty()) {
                    self.remark(line.at, "MediumInterface: participating media are left out", true);
                }
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// `Attribute "shape" "float radius" 2`: a parameter of all shapes that follow.
    fn attribute(&mut self, line: &mut Line<'_, '_>) -> Outcome<()> {
        self.scene.version = PbrtVersion::V4;
        let targets = ["shape", "light", "material", "medium", "texture"];
        let name = line.text("one of shape, light, material, medium, texture")?;
        let Some(target) = targets.into_iter().find(|target| *target == name) else {
            let hint = did_you_mean(&name, targets);
            return Err(line.fault(format!("Attribute knows no \"{}\"{hint}", excerpt(&name))));
        };
        let given = self.parameters(line)?;
        let list = self.state.defaults.entry(target).or_default();
        list.retain(|old| !given.iter().any(|new| new.name == old.name));
        list.extend(given);
        Ok(())
    }

    fn texture(&mut self, line: &mut Line<'_, '_>) -> Outcome<()> {
        let name = line.text("the name of a texture")?;
        let of_spectra = match line.text("the type of a texture, float or spectrum")?.as_str() {
            "float" => false,
            "spectrum" | "color" => true,
            other => {
                let message = format!("a texture is of float or spectrum, not of \"{}\"", excerpt(other));
                return Err(line.fault(message));
            }
        };
        let entity = self.entity(line, Some("texture"))?;
        let known = self.textures.entry(name.clone()).or_default();
        if known[usize::from(of_spectra)].is_some() {
            self.state.redefined.push(Redefined::Texture(name.clone(), *known));
        }
        known[usize::from(of_spectra)] = Some(self.scene.textures.len());
        self.scene.textures.push(PbrtTexture { name, of_spectra, entity });
        Ok(())
    }

    fn named_material(&mut self, line: &mut Line<'_, '_>) -> Outcome<()> {
        let name = line.text("the name of a material")?;
        let mut entity = PbrtEntity { class: String::new(), parameters: self.parameters(line)?, at: line.at };
        match entity.text("type") {
            Some(class) => entity.class = class.to_string(),
            None => {
                let message =
                    format!("material \"{}\" has no type; add \"string type\" \"diffuse\"", excerpt(&name));
                return Err(line.fault(message));
            }
        }
        entity.parameters.retain(|parameter| parameter.name != "type");
        let entity = self.complete(entity, Some("material"));
        let before = self.scene.named_materials.insert(name.clone(), self.scene.materials.len());
        self.state.redefined.extend(before.map(|before| Redefined::Material(name.clone(), before)));
        self.scene.materials.push(PbrtMaterial { name: Some(name), entity });
        Ok(())
    }

    fn shape(&mut self, line: &mut Line<'_, '_>) -> Outcome<()> {
        let entity = self.entity(line, Some("shape"))?;
        if let Some((name, at)) = &self.state.awaited_material {
            self.awaiting.push((self.scene.shapes.len(), name.clone(), *at));
        }
        self.scene.shapes.push(PbrtShape {
            entity,
            to_world: self.state.to_world,
            is_reversed: self.state.is_reversed,
            material: self.state.material,
            area_light: self.state.area_light,
            object: self.object,
        });
        Ok(())
    }

    fn instance(&mut self, line: &mut Line<'_, '_>) -> Outcome<()> {
        let name = line.text("the name of an object")?;
        if self.object.is_some() {
            return Err(line.fault("an object can't hold instances of others; add ObjectEnd before it"));
        }
        let Some(&object) = self.objects.get(&name) else {
            let hint = did_you_mean(&name, self.objects.keys().map(String::as_str));
            return Err(line.fault(format!("no ObjectBegin defines \"{}\"{hint}", excerpt(&name))));
        };
        self.scene.instances.push(PbrtInstance { object, to_world: self.state.to_world, at: line.at });
        Ok(())
    }

    /// The class and the parameters behind a directive; `kind` is what `Attribute` calls it.
    fn entity(&mut self, line: &mut Line<'_, '_>, kind: Option<&str>) -> Outcome<PbrtEntity> {
        let Some((Token::Text(class), _)) = line.tokens.next()? else {
            return Err(line.fault("this directive needs its type in quotes, for instance Shape \"sphere\""));
        };
        let class = class.into_owned();
        if V4_CLASSES.contains(&class.as_str()) && !(class == "diffuse" && kind == Some("light")) {
            self.scene.version = PbrtVersion::V4;
        }
        let entity = PbrtEntity { class, parameters: self.parameters(line)?, at: line.at };
        Ok(self.complete(entity, kind))
    }

    fn parameters(&mut self, line: &mut Line<'_, '_>) -> Outcome<Vec<PbrtParameter>> {
        let mut replaced = Vec::new();
        let budget = self.values_left.get_or_insert(MAX_VALUES);
        let list = parameters(line.tokens, line.at.file, budget, &mut replaced)?;
        for former in replaced {
            let text = format!("parameter \"{}\" is given twice: the last one counts", excerpt(&former.name));
            self.remark(former.at, text, false);
        }
        Ok(list)
    }

    /// Adds what `Attribute` gives, and finds the textures that are named.
    fn complete(&mut self, mut entity: PbrtEntity, kind: Option<&str>) -> PbrtEntity {
        if let Some(defaults) = kind.and_then(|kind| self.state.defaults.get(kind)) {
            let missing = defaults.iter().filter(|default| entity.find(&default.name).is_none());
            let missing: Vec<PbrtParameter> = missing.cloned().collect();
            entity.parameters.extend(missing);
        }
        if kind == Some("material") && V4_CLASSES.contains(&entity.class.as_str()) {
            self.scene.version = PbrtVersion::V4;
        }
        for parameter in entity.parameters.iter_mut().filter(|p| p.kind == PbrtKind::Texture) {
            let name = parameter.texts().and_then(|texts| texts.first());
            if let Some(found) = name.and_then(|name| self.textures.get(name)) {
                parameter.texture = *found;
            }
        }
        entity
    }

    fn remark(&mut self, at: PbrtPlace, text: impl Into<String>, matters: bool) {
        self.scene.remarks.push(PbrtRemark { at, text: text.into(), matters });
    }
}

/// What follows in a file.
enum Next {
    Directive,
    Include(String, PbrtPlace),
    Import(String, PbrtPlace),
}

/// The words behind a directive.
struct Line<'t, 'a> {
    tokens: &'t mut Tokens<'a>,
    spot: [u32; 2],
    at: PbrtPlace,
}

impl Line<'_, '_> {
    fn fault(&self, message: impl Into<String>) -> Fault {
        Fault::new(self.spot, message)
    }

    fn text(&mut self, what: &str) -> Outcome<String> {
        text(self.tokens, self.spot, what)
    }

    /// All texts that follow.
    fn texts(&mut self) -> Outcome<Vec<String>> {
        let mut list = Vec::new();
        while let Some((Token::Text(_), _)) = self.tokens.peek()? {
            list.push(self.text("a text")?);
        }
        Ok(list)
    }

    /// A word, a number or a text, with or without brackets.
    fn value(&mut self) -> Outcome<String> {
        let is_list = matches!(self.tokens.peek()?, Some((Token::Open, _)));
        if is_list {
            self.tokens.next()?;
        }
        let value = match self.tokens.next()? {
            Some((Token::Word(word), _)) => String::from_utf8_lossy(word).into_owned(),
            Some((Token::Text(text), _)) => text.into_owned(),
            _ => return Err(self.fault("a value must follow this name")),
        };
        if is_list && !matches!(self.tokens.next()?, Some((Token::Close, _))) {
            return Err(self.fault("one value must follow this name"));
        }
        Ok(value)
    }

    fn word(&mut self) -> Outcome<String> {
        match self.tokens.next()? {
            Some((Token::Word(word), _)) => Ok(String::from_utf8_lossy(word).into_owned()),
            _ => Err(self.fault("a word must follow this directive")),
        }
    }

    /// So many numbers, with or without brackets.
    fn numbers<const N: usize>(&mut self) -> Outcome<[f64; N]> {
        let missing = format!("{N} numbers must follow this directive");
        let mut numbers = [0.0; N];
        let is_list = matches!(self.tokens.peek()?, Some((Token::Open, _)));
        if is_list {
            self.tokens.next()?;
        }
        for value in &mut numbers {
            match self.tokens.next()? {
                Some((Token::Word(word), at)) => *value = number(word, at)?,
                _ => return Err(self.fault(missing)),
            }
        }
        if is_list && !matches!(self.tokens.next()?, Some((Token::Close, _))) {
            return Err(self.fault(missing));
        }
        Ok(numbers)
    }
}

fn text(tokens: &mut Tokens<'_>, spot: [u32; 2], what: &str) -> Outcome<String> {
    match tokens.next()? {
        Some((Token::Text(text), _)) => Ok(text.into_owned()),
        _ => Err(Fault::new(spot, format!("{what} must follow this directive, in quotes"))),
    }
}

/// The content of a file, unpacked if it is compressed.
fn read_plain(path: &Path) -> Result<Vec<u8>, String> {
    let bytes = read_bounded(path, MAX_FILE_BYTES).map_err(|error| error.problem().to_string())?;
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return Ok(bytes);
    }
    let mut plain = Vec::new();
    let mut decoder = std::io::Read::take(GzDecoder::new(bytes.as_slice()), MAX_FILE_BYTES + 1);
    std::io::Read::read_to_end(&mut decoder, &mut plain)
        .map_err(|error| format!("the gzip data are damaged: {error}. Copy the file again"))?;
    if plain.len() as u64 > MAX_FILE_BYTES {
        return Err(format!(
            "it is larger than {} GiB when decompressed; put meshes into .ply files",
            MAX_FILE_BYTES >> 30
        ));
    }
    Ok(plain)
}
