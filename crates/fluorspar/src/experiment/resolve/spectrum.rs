//! Spectra and textures from references.

use std::sync::Arc;

use super::context::{Context, Resolved, STRENGTH};
use crate::anatomy::{PorphyrinRamp, shared_surface_map};
use crate::experiment::document::is_path;
use crate::experiment::error::Place;
use crate::experiment::schema::{
    DorsalTongueMap, SpectrumReference, SpectrumTable, TextureReference, TextureTable,
};
use crate::format::{
    CsvColumns, CsvSpectrumOptions, FormatError, NamedCurve, Transfer, read_spectrum_csv, read_texture_png,
};
use crate::material::{ImageTexture, ScalarTexture};
use crate::optics::Filter;
use crate::preset::{self, CurvePreset};
use crate::spectral::{Curve, CurveModel, MAX_WAVELENGTH_NM, MIN_WAVELENGTH_NM, WavelengthGrid};
use crate::units::number_text;

/// Largest value of a spectrum that is scaled to a power or a radiance, and largest factor on a file's values: it leaves room for
/// counts and photons per second.
const LARGEST_RELATIVE: f64 = 1e30;

/// What a spectrum is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::experiment) enum Role {
    Light,
    Filter,
    Reflectance,
    /// Values with a unit of their own: anything from 0 up.
    Absolute,
}

impl Role {
    fn is_fraction(self) -> bool {
        matches!(self, Self::Filter | Self::Reflectance)
    }

    fn preset(self, name: &str) -> Result<CurvePreset, preset::PresetError> {
        match self {
            Self::Light | Self::Absolute => preset::light_spectrum(name),
            Self::Filter => preset::filter(name),
            Self::Reflectance => preset::reflectance(name),
        }
    }
}

impl Context<'_> {
    /// The curve of a reference; an interference filter of the catalogue is taken at an angle.
    pub(in crate::experiment) fn spectrum(
        &mut self,
        at: &Place,
        reference: &SpectrumReference,
        role: Role,
        angle_deg: f64,
        grid: &WavelengthGrid,
    ) -> Resolved<Curve> {
        let curve = match reference {
            SpectrumReference::Constant(value) => Curve::constant(*value),
            SpectrumReference::Model(model) => {
                let curve = self.model(at, model)?;
                if let Some(range) = model.valid_nm() {
                    self.note_range(at, range, grid);
                }
                curve
            }
            SpectrumReference::Name(name) if is_path(name) => {
                let table = SpectrumTable { csv: name.clone(), column: None, scale: None };
                self.table(at, &table, grid)?
            }
            SpectrumReference::Name(name) => {
                let preset = role.preset(name).map_err(|error| self.error(at, error.to_string()))?;
                self.note_preset("curve", name, &preset);
                self.note_range(at, preset.valid_nm, grid);
                preset.curve_at_angle(angle_deg)
            }
            SpectrumReference::Table(table) => self.table(at, table, grid)?,
        };
        self.check_values(at, &curve, role)?;
        Ok(curve)
    }

    /// A filter of a reference, with the effective index of the catalogue, or the given one for files and equations.
    pub(in crate::experiment) fn filter(
        &mut self,
        at: &Place,
        reference: &SpectrumReference,
        index_of_others: Option<f64>,
        grid: &WavelengthGrid,
    ) -> Resolved<Filter> {
        let curve = self.spectrum(at, reference, Role::Filter, 0.0, grid)?;
        let effective_index = match reference {
            SpectrumReference::Constant(_) => None,
            SpectrumReference::Name(name) if !is_path(name) => {
                preset::filter(name).ok().and_then(|preset| preset.effective_index)
            }
            _ => index_of_others,
        };
        Ok(Filter { curve, effective_index })
    }

    fn model(&self, at: &Place, model: &CurveModel) -> Resolved<Curve> {
        match model.validate() {
            Ok(()) => match model {
                CurveModel::Table { wavelength_nm, value } => {
                    Curve::new(wavelength_nm.clone(), value.clone())
                        .map_err(|error| self.error(at, error.to_string()))
                }
                _ => Ok(Curve::from_model(model)),
            },
            Err((field, message)) => self.fail(&at.fields(&field), message),
        }
    }

    fn table(&mut self, at: &Place, table: &SpectrumTable, grid: &WavelengthGrid) -> Resolved<Curve> {
        let columns = match &table.column {
            Some(name) => CsvColumns::Named(vec![name.clone()]),
            None => CsvColumns::Numbered(vec![1]),
        };
        let options = CsvSpectrumOptions { columns, ..CsvSpectrumOptions::default() };
        let curve = self.csv(at, &table.csv, &options)?.swap_remove(0).curve;
        let (first, last) = curve.range_nm();
        self.note_range(at, [first, last], grid);
        match table.scale {
            None => Ok(curve),
            Some(scale) => {
                let at = at.field("scale");
                Ok(curve.scaled(self.within(&at, scale, [1.0 / LARGEST_RELATIVE, LARGEST_RELATIVE], "")?))
            }
        }
    }

    /// Columns of a CSV file of spectra, at least one.
    pub(in crate::experiment) fn csv(
        &mut self,
        at: &Place,
        file: &str,
        options: &CsvSpectrumOptions,
    ) -> Resolved<Vec<NamedCurve>> {
        self.note_input(at, file)?;
        let curves =
            read_spectrum_csv(file.as_ref(), options).map_err(|error| self.file_error(at, &error))?;
        if curves.is_empty() { self.fail(at, "the file has no column of values") } else { Ok(curves) }
    }

    /// An error of a reader; it names its file itself.
    pub(in crate::experiment) fn file_error(
        &self,
        at: &Place,
        error: &FormatError,
    ) -> crate::experiment::ExperimentError {
        self.error(at, error.to_string()).without_value()
    }

    fn check_values(&self, at: &Place, curve: &Curve, role: Role) -> Resolved<()> {
        let most = match role {
            Role::Filter | Role::Reflectance => 1.0,
            Role::Light => LARGEST_RELATIVE,
            Role::Absolute => STRENGTH[1],
        };
        let bad = |value: &f64| !(0.0..=most).contains(value);
        let Some(index) = curve.values().iter().position(bad) else {
            if matches!(role, Role::Light | Role::Absolute)
                && curve.integral(MIN_WAVELENGTH_NM, MAX_WAVELENGTH_NM) <= 0.0
            {
                let message = "the spectrum is zero from 200 to 1200 nm; are its wavelengths in nanometres?";
                return self.fail(at, message);
            }
            return Ok(());
        };
        let number = curve.values()[index];
        let [value, nm] = [number, curve.wavelengths_nm()[index]].map(number_text);
        if role.is_fraction() {
            let hint = if number > 1.0 && number <= 100.0 { "; percent? Give fractions" } else { "" };
            return self.fail(at, format!("the value {value} at {nm} nm is not between 0 and 1{hint}"));
        }
        let most = number_text(most);
        self.fail(at, format!("the value {value} at {nm} nm is not between 0 and {most}"))
    }

    /// A texture from its reference. Values must be between 0 and `highest`.
    pub(in crate::experiment) fn texture(
        &mut self,
        at: &Place,
        reference: &TextureReference,
        highest: f64,
    ) -> Resolved<ScalarTexture> {
        match reference {
            TextureReference::Constant(value) => {
                self.within(at, *value, [0.0, highest], "")?;
                Ok(ScalarTexture::Constant(*value as f32))
            }
            TextureReference::Map(table) => self.texture_map(at, table, highest),
        }
    }

    /// Porphyrin on the back of a tongue as an image.
    fn dorsal_tongue(&self, at: &Place, map: &DorsalTongueMap) -> Resolved<ScalarTexture> {
        if map.peak == 0.0 {
            return Ok(ScalarTexture::Constant(0.0));
        }
        let ramp = PorphyrinRamp {
            sigma: map.sigma as f32,
            full_at: map.full_at as f32,
            patchiness: map.patchiness as f32,
            seed: map.seed,
        };
        let [columns, rows] = DORSAL_TONGUE_PX;
        let image = ImageTexture::new(columns, rows, ramp.bake(columns, rows))
            .map_err(|error| self.error(at, error.to_string()))?;
        Ok(ScalarTexture::Image { image: Arc::new(image), low: 0.0, high: map.peak as f32 })
    }

    fn texture_map(&mut self, at: &Place, table: &TextureTable, highest: f64) -> Resolved<ScalarTexture> {
        let kinds = [
            table.image.is_some(),
            table.checker.is_some(),
            table.noise.is_some(),
            table.dorsal_tongue.is_some(),
            table.anatomy.is_some(),
        ];
        if kinds.iter().filter(|given| **given).count() != 1 {
            return self.fail(at, "give exactly one of image, checker, noise, dorsal_tongue, anatomy");
        }
        if table.tissue.is_some() && table.anatomy.is_none() {
            return self
                .fail(&at.field("tissue"), "only a map of the anatomy belongs to a tissue; remove it");
        }
        let names = ["image", "checker", "noise", "dorsal_tongue", "anatomy"];
        let map = names.into_iter().zip(kinds).find(|(_, given)| *given).map_or("", |(name, _)| name);
        for (key, is_given, maps) in [
            ("low", table.low.is_some(), &["image", "checker", "noise", "anatomy"][..]),
            ("high", table.high.is_some(), &["image", "checker", "noise", "anatomy"][..]),
            ("seed", table.seed.is_some(), &["noise", "anatomy"][..]),
            ("srgb", table.srgb.is_some(), &["image"][..]),
        ] {
            if is_given && !maps.contains(&map) {
                let inside =
                    if map == "dorsal_tongue" { ", which has its own fields inside its braces" } else { "" };
                let message = format!("belongs to {}, not to {map}{inside}; remove it", maps.join(", "));
                return self.fail(&at.field(key), message);
            }
        }
        let low = self.within(&at.field("low"), table.low.unwrap_or(0.0), [0.0, highest], "")? as f32;
        let high = self.within(&at.field("high"), table.high.unwrap_or(1.0), [0.0, highest], "")? as f32;
        let texture = if let Some(file) = &table.image {
            let at = at.field("image");
            self.note_input(&at, file)?;
            let transfer = if table.srgb == Some(true) { Transfer::Srgb } else { Transfer::Linear };
            let image = read_texture_png(file.as_ref(), transfer).map_err(|e| self.file_error(&at, &e))?;
            let grey = image.data.chunks_exact(image.channels).map(grey).collect();
            let image = ImageTexture::new(image.width, image.height, grey)
                .map_err(|e| self.error(&at, e.to_string()))?;
            ScalarTexture::Image { image: Arc::new(image), low, high }
        } else if let Some([columns, rows]) = table.checker {
            for fields in [columns, rows] {
                self.whole_within(&at.field("checker"), u64::from(fields), [1, 10_000])?;
            }
            ScalarTexture::Checker { columns, rows, low, high }
        } else if let Some(cells) = table.noise {
            for value in cells {
                self.within(&at.field("noise"), value, [0.1, 1e4], "cells")?;
            }
            let cells = cells.map(|value| value as f32);
            ScalarTexture::Noise { cells, seed: table.seed.unwrap_or(1), low, high }
        } else if let Some(map) = &table.dorsal_tongue {
            let inner = at.field("dorsal_tongue");
            self.within(&inner.field("peak"), map.peak, [0.0, highest], "")?;
            self.within(&inner.field("sigma"), map.sigma, [0.01, 10.0], "of the tongue's width")?;
            self.within(&inner.field("full_at"), map.full_at, [0.01, 1.0], "of the tongue's length")?;
            self.within(&inner.field("patchiness"), map.patchiness, [0.0, 1.0], "")?;
            self.dorsal_tongue(&inner, map)?
        } else if let Some(map) = table.anatomy {
            let at = at.field("anatomy");
            let Some(mouth) = &self.mouth else {
                return self
                    .fail(&at, "a map of the anatomy needs a [mouth]; add one, or use noise or an image");
            };
            let Some(tissue) = table.tissue.or(self.tissue) else {
                let message = "which tissue's map? Add tissue = \"tongue_dorsum\" or another";
                return self.fail(&at, message);
            };
            let mut person = mouth.clone();
            person.seed = table.seed.unwrap_or(person.seed);
            let baked = shared_surface_map(map, tissue, &person);
            let image = ImageTexture::new(baked.columns, baked.rows, baked.values.clone())
                .map_err(|e| self.error(&at, e.to_string()))?;
            ScalarTexture::Image { image: Arc::new(image), low, high }
        } else {
            return self.fail(at, "give exactly one of image, checker, noise, dorsal_tongue, anatomy");
        };
        match &table.times {
            None => Ok(texture),
            Some(other) => {
                let other = self.texture(&at.field("times"), other, highest)?;
                Ok(ScalarTexture::Product(Box::new(texture), Box::new(other)))
            }
        }
    }
}

/// Pixels across and along a map of the back of a tongue: seven to the finest features of its patches.
const DORSAL_TONGUE_PX: [usize; 2] = [512, 1024];

/// Grey value of a pixel: the only channel, or the mean of red, green and blue; alpha is left out.
pub(super) fn grey(pixel: &[f32]) -> f32 {
    let colours = match pixel.len() {
        2 => 1,
        4 => 3,
        n => n,
    };
    pixel[..colours].iter().sum::<f32>() / colours as f32
}
