//! Textures as sums of spectra, each with a weight over the surface.

use std::path::PathBuf;
use std::sync::Arc;

use fluorspar::material::{ImageTexture, ReflectanceTerm, ScalarTexture};
use fluorspar::quote::excerpt;
use fluorspar::spectral::Curve;
use fluorspar_format::{PbrtError, PbrtKind, PbrtParameter, PbrtPlace, TextureImage, Transfer, read_texture};
use glam::Vec2;

use crate::convert::Convert;
use crate::given::Given;
use crate::rgb::primaries;
use crate::spectrum::Role;

/// A sum of spectra with weights.
pub(crate) type Terms = Vec<ReflectanceTerm>;

/// Pixels a side of what is sampled because it has no form of its own.
const SAMPLED_SIDE: usize = 1024;
/// Most textures that are sampled, 4 MiB each.
const MOST_SAMPLED: usize = 64;
/// Most spectra of which a texture is a sum.
const MOST_TERMS: usize = 16;
/// Most textures within textures.
const MOST_NESTED: usize = 64;

/// A sum of one spectrum.
pub(crate) fn uniform(curve: Curve) -> Terms {
    vec![ReflectanceTerm { spectrum: curve, weight: ScalarTexture::Constant(1.0) }]
}

/// How texture coordinates are mapped: `(uscale u + udelta, vscale v + vdelta)`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Mapping {
    scale: Vec2,
    delta: Vec2,
}

impl Mapping {
    fn is_plain(self) -> bool {
        self.scale == Vec2::ONE && self.delta == Vec2::ZERO
    }
}

impl Convert<'_> {
    /// The number of a parameter, or its texture.
    pub(crate) fn weight(&mut self, parameter: &PbrtParameter) -> Result<ScalarTexture, PbrtError> {
        if parameter.kind != PbrtKind::Texture {
            return match parameter.numbers().and_then(<[f64]>::first) {
                Some(value) => Ok(ScalarTexture::Constant(*value as f32)),
                None => Err(self.error(parameter.at, "a number or a texture must stand here")),
            };
        }
        match parameter.texture[0] {
            Some(index) => self.float_texture(index, 0),
            None => Err(self.of_the_other_kind(parameter, "float")),
        }
    }

    /// The spectrum of a parameter, or its texture.
    pub(crate) fn terms(&mut self, parameter: &PbrtParameter, role: Role) -> Result<Terms, PbrtError> {
        if parameter.kind != PbrtKind::Texture {
            return Ok(uniform(self.spectrum(parameter, role)?));
        }
        match parameter.texture {
            [_, Some(index)] => self.spectrum_texture(index, 0),
            // Numbers are spectra that are the same at all wavelengths.
            [Some(index), None] => {
                let weight = self.float_texture(index, 0)?;
                Ok(vec![ReflectanceTerm { spectrum: Curve::constant(1.0), weight }])
            }
            [None, None] => Err(self.of_the_other_kind(parameter, "spectrum")),
        }
    }

    fn of_the_other_kind(&self, parameter: &PbrtParameter, wanted: &str) -> PbrtError {
        let name =
            parameter.texts().and_then(<[String]>::first).map_or_else(String::new, |name| excerpt(name));
        self.error(parameter.at, format!("no texture of {wanted} is called \"{name}\""))
    }

    fn check_depth(&self, at: PbrtPlace, depth: usize) -> Result<(), PbrtError> {
        if depth < MOST_NESTED {
            return Ok(());
        }
        let message = format!(
            "textures are nested more than {MOST_NESTED} deep; remove a texture that contains itself"
        );
        Err(self.error(at, message))
    }

    /// A parameter of a texture of numbers.
    fn inner_weight(
        &mut self,
        given: &Given<'_>,
        name: &str,
        usual: f32,
        depth: usize,
    ) -> Result<ScalarTexture, PbrtError> {
        match given.find(name) {
            None => Ok(ScalarTexture::Constant(usual)),
            Some(parameter) => match (parameter.kind, parameter.texture[0]) {
                (PbrtKind::Texture, Some(index)) => self.float_texture(index, depth + 1),
                (PbrtKind::Texture, None) => Err(self.of_the_other_kind(parameter, "float")),
                (PbrtKind::Spectrum | PbrtKind::Rgb, _) => {
                    // Version 3 takes a spectrum for the amount of a mixture.
                    let curve = self.spectrum(parameter, Role::Index)?;
                    let grid = &self.options.grid;
                    let mean = curve.bin_averages(grid).iter().sum::<f64>() / grid.len() as f64;
                    Ok(ScalarTexture::Constant(mean as f32))
                }
                _ => self.weight(parameter),
            },
        }
    }

    /// A parameter of a texture of spectra.
    fn inner_terms(
        &mut self,
        given: &Given<'_>,
        name: &str,
        usual: f64,
        depth: usize,
    ) -> Result<Terms, PbrtError> {
        match given.find(name) {
            None => Ok(uniform(Curve::constant(usual))),
            Some(parameter) => match (parameter.kind, parameter.texture) {
                (PbrtKind::Texture, [_, Some(index)]) => self.spectrum_texture(index, depth + 1),
                (PbrtKind::Texture, [Some(index), None]) => {
                    let weight = self.float_texture(index, depth + 1)?;
                    Ok(vec![ReflectanceTerm { spectrum: Curve::constant(1.0), weight }])
                }
                (PbrtKind::Texture, [None, None]) => Err(self.of_the_other_kind(parameter, "spectrum")),
                // A factor may exceed 1 where an image does not: it belongs to the weight.
                (PbrtKind::Float, _) => {
                    let weight = self.weight(parameter)?;
                    Ok(vec![ReflectanceTerm { spectrum: Curve::constant(1.0), weight }])
                }
                _ => Ok(uniform(self.spectrum(parameter, Role::Reflectance)?)),
            },
        }
    }

    fn float_texture(&mut self, index: usize, depth: usize) -> Result<ScalarTexture, PbrtError> {
        if let Some(known) = self.weights.get(&index) {
            return Ok(known.clone());
        }
        let tree = self.tree;
        let entity = &tree.textures[index].entity;
        self.check_depth(entity.at, depth)?;
        let given = Given::new(entity);
        let texture = match entity.class.as_str() {
            "constant" => self.inner_weight(&given, "value", 1.0, depth)?,
            "scale" => {
                let [a, b] = scale_names(&given);
                let (a, b) =
                    (self.inner_weight(&given, a, 1.0, depth)?, self.inner_weight(&given, b, 1.0, depth)?);
                self.product(a, b, entity.at)?
            }
            "mix" | "directionmix" => {
                let (a, b) = (
                    self.inner_weight(&given, "tex1", 0.0, depth)?,
                    self.inner_weight(&given, "tex2", 1.0, depth)?,
                );
                let amount = if entity.class == "mix" {
                    self.inner_weight(&given, "amount", 0.5, depth)?
                } else {
                    self.remark(
                        entity.at,
                        "a mixture by direction has no counterpart; both parts count half",
                    );
                    given.used(&["dir"]);
                    ScalarTexture::Constant(0.5)
                };
                self.sampled(
                    entity.at,
                    |uv| {
                        let share = amount.at(uv);
                        a.at(uv) * (1.0 - share) + b.at(uv) * share
                    },
                    &[&a, &b, &amount],
                )?
            }
            "bilerp" => {
                let corner = |name: &str, usual: f32| given.number(name).map_or(usual, |value| value as f32);
                let (v00, v01) = (corner("v00", 0.0), corner("v01", 1.0));
                let (v10, v11) = (corner("v10", 0.0), corner("v11", 1.0));
                let map = self.mapping(&given);
                self.sampled(
                    entity.at,
                    |uv| {
                        let st = uv * map.scale + map.delta;
                        (1.0 - st.x) * ((1.0 - st.y) * v00 + st.y * v01)
                            + st.x * ((1.0 - st.y) * v10 + st.y * v11)
                    },
                    &[],
                )?
            }
            "imagemap" => {
                let image = self.image(&given)?;
                let gray = gray_of(&image);
                let map = self.mapping(&given);
                self.placed_image(gray, &image, map, entity.at)?
            }
            "checkerboard" => {
                let (a, b) = (
                    self.inner_weight(&given, "tex1", 1.0, depth)?,
                    self.inner_weight(&given, "tex2", 0.0, depth)?,
                );
                match (a.constant(), b.constant()) {
                    (Some(a), Some(b)) => self.checkers(&given, a, b)?,
                    _ => {
                        let share = self.checkers(&given, 0.0, 1.0)?;
                        self.sampled(
                            entity.at,
                            |uv| if share.at(uv) > 0.5 { b.at(uv) } else { a.at(uv) },
                            &[&a, &b, &share],
                        )?
                    }
                }
            }
            class => {
                let text = format!("Texture \"{}\" has no counterpart; it is 1/2 everywhere", excerpt(class));
                self.remark(entity.at, text);
                let names: Vec<&str> = entity.parameters.iter().map(|p| p.name.as_str()).collect();
                given.used(&names);
                ScalarTexture::Constant(0.5)
            }
        };
        given.finish("Texture", &mut self.remarks);
        self.weights.insert(index, texture.clone());
        Ok(texture)
    }

    fn spectrum_texture(&mut self, index: usize, depth: usize) -> Result<Terms, PbrtError> {
        if let Some(known) = self.terms.get(&index) {
            return Ok(known.clone());
        }
        let tree = self.tree;
        let entity = &tree.textures[index].entity;
        let at = entity.at;
        self.check_depth(at, depth)?;
        let given = Given::new(entity);
        let terms = match entity.class.as_str() {
            "constant" => self.inner_terms(&given, "value", 1.0, depth)?,
            "scale" => {
                let [a, b] = scale_names(&given);
                let a = self.inner_terms(&given, a, 1.0, depth)?;
                let b = self.inner_terms(&given, b, 1.0, depth)?;
                self.product_of_sums(&a, &b, at)?
            }
            "mix" | "directionmix" => {
                let a = self.inner_terms(&given, "tex1", 0.0, depth)?;
                let b = self.inner_terms(&given, "tex2", 1.0, depth)?;
                let amount = if entity.class == "mix" {
                    self.inner_weight(&given, "amount", 0.5, depth)?
                } else {
                    self.remark(at, "a mixture by direction has no counterpart; both parts count half");
                    given.used(&["dir"]);
                    ScalarTexture::Constant(0.5)
                };
                self.blend(a, b, &amount, at)?
            }
            "checkerboard" => {
                let a = self.inner_terms(&given, "tex1", 1.0, depth)?;
                let b = self.inner_terms(&given, "tex2", 0.0, depth)?;
                let share = self.checkers(&given, 0.0, 1.0)?;
                self.blend(a, b, &share, at)?
            }
            "imagemap" => self.image_terms(&given)?,
            class => {
                self.remark(
                    at,
                    format!("Texture \"{}\" has no counterpart; it is 1/2 everywhere", excerpt(class)),
                );
                let names: Vec<&str> = entity.parameters.iter().map(|p| p.name.as_str()).collect();
                given.used(&names);
                uniform(Curve::constant(0.5))
            }
        };
        given.finish("Texture", &mut self.remarks);
        if terms.len() > MOST_TERMS {
            let message =
                format!("this texture is a sum of {} spectra; up to {MOST_TERMS} are kept", terms.len());
            return Err(self.error(at, message));
        }
        self.terms.insert(index, terms.clone());
        Ok(terms)
    }

    /// `a (1 - amount) + b amount`.
    fn blend(
        &mut self,
        a: Terms,
        b: Terms,
        amount: &ScalarTexture,
        at: PbrtPlace,
    ) -> Result<Terms, PbrtError> {
        let rest = match amount {
            ScalarTexture::Constant(value) => ScalarTexture::Constant(1.0 - value),
            ScalarTexture::Checker { columns, rows, low, high } => {
                ScalarTexture::Checker { columns: *columns, rows: *rows, low: 1.0 - low, high: 1.0 - high }
            }
            ScalarTexture::Image { image, low, high } => {
                ScalarTexture::Image { image: Arc::clone(image), low: 1.0 - low, high: 1.0 - high }
            }
            other => self.sampled(at, |uv| 1.0 - other.at(uv), &[other])?,
        };
        let mut sum = Terms::new();
        for (terms, share) in [(a, &rest), (b, amount)] {
            for term in terms {
                let weight = self.product(term.weight, share.clone(), at)?;
                sum.push(ReflectanceTerm { weight, ..term });
            }
        }
        sum.retain(|term| term.weight.constant() != Some(0.0));
        Ok(sum)
    }

    fn product_of_sums(&mut self, a: &Terms, b: &Terms, at: PbrtPlace) -> Result<Terms, PbrtError> {
        if a.len() * b.len() > MOST_TERMS {
            let message = format!(
                "this product is a sum of {} spectra; up to {MOST_TERMS} are kept",
                a.len() * b.len()
            );
            return Err(self.error(at, message));
        }
        let mut sum = Terms::new();
        for left in a {
            for right in b {
                let weight = self.product(left.weight.clone(), right.weight.clone(), at)?;
                sum.push(ReflectanceTerm { spectrum: left.spectrum.times(&right.spectrum), weight });
            }
        }
        Ok(sum)
    }

    /// The product of two weights; products of products are sampled.
    fn product(
        &mut self,
        a: ScalarTexture,
        b: ScalarTexture,
        at: PbrtPlace,
    ) -> Result<ScalarTexture, PbrtError> {
        let scaled = |factor: f32, texture: &ScalarTexture| match texture {
            ScalarTexture::Image { image, low, high } => Some(ScalarTexture::Image {
                image: Arc::clone(image),
                low: low * factor,
                high: high * factor,
            }),
            ScalarTexture::Checker { columns, rows, low, high } => Some(ScalarTexture::Checker {
                columns: *columns,
                rows: *rows,
                low: low * factor,
                high: high * factor,
            }),
            _ => None,
        };
        match (a.constant(), b.constant()) {
            (Some(a), Some(b)) => return Ok(ScalarTexture::Constant(a * b)),
            (Some(1.0), _) => return Ok(b),
            (_, Some(1.0)) => return Ok(a),
            (Some(0.0), _) | (_, Some(0.0)) => return Ok(ScalarTexture::Constant(0.0)),
            (Some(factor), _) => {
                if let Some(texture) = scaled(factor, &b) {
                    return Ok(texture);
                }
            }
            (_, Some(factor)) => {
                if let Some(texture) = scaled(factor, &a) {
                    return Ok(texture);
                }
            }
            (None, None) => {}
        }
        let is_leaf = |texture: &ScalarTexture| !matches!(texture, ScalarTexture::Product(..));
        if is_leaf(&a) && is_leaf(&b) {
            return Ok(ScalarTexture::Product(Box::new(a), Box::new(b)));
        }
        self.sampled(at, |uv| a.at(uv) * b.at(uv), &[&a, &b])
    }

    /// A function over the unit square, constant where all that it depends on is.
    fn sampled(
        &mut self,
        at: PbrtPlace,
        value: impl Fn(Vec2) -> f32,
        of: &[&ScalarTexture],
    ) -> Result<ScalarTexture, PbrtError> {
        if !of.is_empty() && of.iter().all(|texture| texture.constant().is_some()) {
            return Ok(ScalarTexture::Constant(value(Vec2::ZERO)));
        }
        self.sampled += 1;
        if self.sampled > MOST_SAMPLED {
            let message =
                format!("more than {MOST_SAMPLED} textures that have to be sampled; use images instead");
            return Err(self.error(at, message));
        }
        self.note(
            at,
            format!(
                "the texture is sampled at {SAMPLED_SIDE} x {SAMPLED_SIDE} points of the unit square of u, v"
            ),
        );
        let side = SAMPLED_SIDE as f32;
        let pixel = |i: usize| {
            let (col, row) = (i % SAMPLED_SIDE, i / SAMPLED_SIDE);
            value(Vec2::new((col as f32 + 0.5) / side, 1.0 - (row as f32 + 0.5) / side)).max(0.0)
        };
        let data = (0..SAMPLED_SIDE * SAMPLED_SIDE).map(pixel).collect();
        self.image_texture(SAMPLED_SIDE, SAMPLED_SIDE, data, at)
    }

    fn image_texture(
        &self,
        width: usize,
        height: usize,
        data: Vec<f32>,
        at: PbrtPlace,
    ) -> Result<ScalarTexture, PbrtError> {
        let image =
            ImageTexture::new(width, height, data).map_err(|error| self.error(at, error.to_string()))?;
        Ok(ScalarTexture::Image { image: Arc::new(image), low: 0.0, high: 1.0 })
    }

    /// A function of a weight; images are changed pixel by pixel.
    pub(crate) fn changed(
        &mut self,
        texture: ScalarTexture,
        change: impl Fn(f32) -> f32,
        at: PbrtPlace,
    ) -> Result<ScalarTexture, PbrtError> {
        match texture {
            ScalarTexture::Constant(value) => Ok(ScalarTexture::Constant(change(value))),
            ScalarTexture::Checker { columns, rows, low, high } => {
                Ok(ScalarTexture::Checker { columns, rows, low: change(low), high: change(high) })
            }
            other => self.sampled(at, |uv| change(other.at(uv)), &[&other]),
        }
    }

    fn mapping(&mut self, given: &Given<'_>) -> Mapping {
        let kind = given.text("mapping").unwrap_or("uv");
        if kind != "uv" {
            self.remark(
                given.entity.at,
                format!("mapping \"{}\": u and v of the shape are used", excerpt(kind)),
            );
            given.used(&["v1", "v2"]);
        }
        let number = |name: &str, usual: f64| given.number(name).unwrap_or(usual) as f32;
        Mapping {
            scale: Vec2::new(number("uscale", 1.0), number("vscale", 1.0)),
            delta: Vec2::new(number("udelta", 0.0), number("vdelta", 0.0)),
        }
    }

    /// Fields of side 1 after the mapping: `even` where the sum of their numbers is even.
    fn checkers(&mut self, given: &Given<'_>, even: f32, odd: f32) -> Result<ScalarTexture, PbrtError> {
        let at = given.entity.at;
        given.used(&["aamode"]);
        if given.number("dimension").is_some_and(|n| n == 3.0) {
            self.remark(at, "a checkerboard in space has no counterpart; that of u and v is used");
        }
        let map = self.mapping(given);
        let whole = |scale: f32| scale >= 1.0 && scale.fract() == 0.0 && scale <= 1e6;
        if map.delta == Vec2::ZERO && whole(map.scale.x) && whole(map.scale.y) {
            let [columns, rows] = [map.scale.x as u32, map.scale.y as u32];
            return Ok(ScalarTexture::Checker { columns, rows, low: even, high: odd });
        }
        self.sampled(
            at,
            |uv| {
                let st = (uv * map.scale + map.delta).floor();
                if (st.x + st.y).rem_euclid(2.0) < 0.5 { even } else { odd }
            },
            &[],
        )
    }

    /// The pixels of an `imagemap`, with `scale` and `invert` applied.
    fn image(&mut self, given: &Given<'_>) -> Result<Arc<TextureImage>, PbrtError> {
        let at = given.entity.at;
        let Some(name) = given.text("filename") else {
            return Err(self.error(at, "an imagemap needs an image; add \"string filename\" \"FILE.png\""));
        };
        given.used(&["filter", "maxanisotropy", "trilinear", "noFiltering"]);
        if let Some(wrap) = given.text("wrap").filter(|wrap| *wrap != "repeat") {
            let wrap = excerpt(wrap);
            self.remark(at, format!("\"wrap\" \"{wrap}\": images repeat beyond the unit square of u, v"));
        }
        let is_linear = self.is_linear(given);
        let transfer = if is_linear { Transfer::Linear } else { Transfer::Srgb };
        let path = self.tree.path_of(at, name);
        let scale = given.number("scale").unwrap_or(1.0) as f32;
        let invert = given.flag("invert").unwrap_or(false);
        let key = (path.clone(), format!("{is_linear} {scale} {invert}"));
        if let Some(known) = self.images.get(&key) {
            return Ok(Arc::clone(known));
        }
        let mut image = read_texture(&path, transfer).map_err(|error| self.error(at, error.to_string()))?;
        for value in &mut image.data {
            let scaled = *value * scale;
            *value = if invert { 1.0 - scaled } else { scaled }.max(0.0);
        }
        self.read.push(path);
        let image = Arc::new(image);
        self.images.insert(key, Arc::clone(&image));
        Ok(image)
    }

    /// Whether the numbers of an `imagemap` are amounts, and not those of a screen.
    fn is_linear(&mut self, given: &Given<'_>) -> bool {
        let encoding = given.text("encoding").unwrap_or("sRGB").to_string();
        let is_linear = given.flag("gamma") == Some(false) || encoding == "linear";
        if encoding.starts_with("gamma") {
            let message = format!("encoding \"{}\": the curve of sRGB is used", excerpt(&encoding));
            self.remark(given.entity.at, message);
        }
        is_linear
    }

    /// An image as three primaries, or as gray.
    fn image_terms(&mut self, given: &Given<'_>) -> Result<Terms, PbrtError> {
        let at = given.entity.at;
        let image = self.image(given)?;
        let map = self.mapping(given);
        if image.channels < 3 {
            let weight = self.placed_image(gray_of(&image), &image, map, at)?;
            return Ok(vec![ReflectanceTerm { spectrum: Curve::constant(1.0), weight }]);
        }
        let mut terms = Terms::new();
        for (channel, spectrum) in primaries().into_iter().enumerate() {
            let plane =
                image.data.chunks_exact(image.channels).map(|pixel| pixel[channel].min(1.0)).collect();
            terms.push(ReflectanceTerm { spectrum, weight: self.placed_image(plane, &image, map, at)? });
        }
        Ok(terms)
    }

    fn placed_image(
        &mut self,
        plane: Vec<f32>,
        image: &TextureImage,
        map: Mapping,
        at: PbrtPlace,
    ) -> Result<ScalarTexture, PbrtError> {
        let texture = self.image_texture(image.width, image.height, plane, at)?;
        if map.is_plain() {
            return Ok(texture);
        }
        self.sampled(at, |uv| texture.at(uv * map.scale + map.delta), &[&texture])
    }

    /// The path of an image that a shape or material names, for its record.
    pub(crate) fn note_read(&mut self, path: PathBuf) {
        self.read.push(path);
    }
}

/// Names of the factors of a `scale`: version 4 calls them `tex` and `scale`.
fn scale_names(given: &Given<'_>) -> [&'static str; 2] {
    if given.entity.find("tex").is_some() || given.entity.find("scale").is_some() {
        ["tex", "scale"]
    } else {
        ["tex1", "tex2"]
    }
}

/// Gray of every pixel: the mean of its colors.
fn gray_of(image: &TextureImage) -> Vec<f32> {
    let colors = if image.channels < 3 { 1 } else { 3 };
    image
        .data
        .chunks_exact(image.channels)
        .map(|pixel| pixel[..colors].iter().sum::<f32>() / colors as f32)
        .collect()
}
