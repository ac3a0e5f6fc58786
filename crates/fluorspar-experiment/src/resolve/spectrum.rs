//! Spectra and textures from references.

use std::sync::Arc;

use super::context::{Context, Resolved, STRENGTH};
use crate::cache::cached_surface_map;
use crate::error::Place;
use crate::preset::{self, CurvePreset, PresetKind};
use crate::schema::{
    AnatomyMap, CheckerMap, DorsalTongueMap, FilePath, MatlabSpectrum, NameOrTable, SpectrumReference,
    SpectrumTable, TextureReference, TextureTable,
};
use fluorspar::material::{ImageTexture, ScalarTexture};
use fluorspar::optics::Filter;
use fluorspar::spectral::{Curve, CurveModel, MAX_WAVELENGTH_NM, MIN_WAVELENGTH_NM, WavelengthGrid};
use fluorspar::units::number_text;
use fluorspar_anatomy::PorphyrinRamp;
use fluorspar_format::{
    FormatError, NamedCurve, SpectrumColumns, SpectrumOptions, SpectrumQuantity, Transfer, read_spectra,
    read_texture_png,
};

/// Largest value of a spectrum that is scaled to a power or a radiance, and largest factor on a file's values: it leaves room for
/// counts and photons per second.
const LARGEST_RELATIVE: f64 = 1e30;

/// Role of a spectrum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    Light,
    Filter,
    Reflectance,
    /// Electrons per photon, up to two below 300 nm.
    QuantumEfficiency,
    /// Values with a unit of their own: anything from 0 up.
    Absolute,
    /// Radiance or irradiance, W/(sr m² nm) or W/(m² nm).
    AbsolutePower,
    /// Coefficients, 1/mm.
    Coefficient,
}

impl Role {
    fn is_fraction(self) -> bool {
        matches!(self, Self::Filter | Self::Reflectance | Self::QuantumEfficiency)
    }

    /// What the values of a file become.
    fn quantity(self) -> SpectrumQuantity {
        match self {
            Self::Light => SpectrumQuantity::SpectralPower,
            Self::Filter => SpectrumQuantity::Transmittance,
            Self::Reflectance => SpectrumQuantity::Fraction,
            Self::QuantumEfficiency => SpectrumQuantity::QuantumEfficiency,
            Self::Absolute => SpectrumQuantity::Stored,
            Self::AbsolutePower => SpectrumQuantity::AbsolutePower,
            Self::Coefficient => SpectrumQuantity::Coefficient,
        }
    }

    fn preset(self, name: &str) -> (PresetKind, Result<CurvePreset, preset::PresetError>) {
        match self {
            Self::Light | Self::Absolute | Self::AbsolutePower | Self::Coefficient => {
                (PresetKind::Light, preset::light_spectrum(name))
            }
            Self::Filter | Self::QuantumEfficiency => (PresetKind::Filter, preset::filter(name)),
            Self::Reflectance => (PresetKind::Reflectance, preset::reflectance(name)),
        }
    }
}

impl Context<'_> {
    /// The curve of a reference; an interference filter of the catalogue is taken at an angle.
    pub(crate) fn spectrum(
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
            SpectrumReference::Text(NameOrTable::File(path)) => {
                let table =
                    SpectrumTable { csv: path.clone(), column: None, scale: None, unit: None, outside: None };
                self.table(at, &table, role, grid)?
            }
            SpectrumReference::Text(NameOrTable::Name(name)) => {
                let (kind, preset) = role.preset(name);
                let preset = preset.map_err(|error| self.error(at, error))?;
                self.note_preset("curve", name, &preset);
                self.note_entry(at, kind, name)?;
                self.note_range(at, preset.valid_nm, grid);
                preset.curve_at_angle(angle_deg)
            }
            SpectrumReference::Table(table) => self.table(at, table, role, grid)?,
            SpectrumReference::Matlab(column) => self.matlab(at, column, role, grid)?,
        };
        self.check_values(at, reference, &curve, role)?;
        Ok(curve)
    }

    /// A filter of a reference, with the effective index of the catalogue, or the given one for files and equations.
    pub(crate) fn filter(
        &mut self,
        at: &Place,
        reference: &SpectrumReference,
        index_of_others: Option<f64>,
        grid: &WavelengthGrid,
    ) -> Resolved<Filter> {
        let curve = self.spectrum(at, reference, Role::Filter, 0.0, grid)?;
        let effective_index = match reference {
            SpectrumReference::Constant(_) => None,
            SpectrumReference::Text(NameOrTable::Name(name)) => {
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

    fn table(
        &mut self,
        at: &Place,
        table: &SpectrumTable,
        role: Role,
        grid: &WavelengthGrid,
    ) -> Resolved<Curve> {
        let columns = match &table.column {
            Some(name) => SpectrumColumns::Named(vec![name.clone()]),
            None => SpectrumColumns::One,
        };
        // Who gives a factor speaks of the values as they are stored
        let is_stored = table.scale.is_some() && table.unit.is_none();
        let quantity = if is_stored { SpectrumQuantity::Stored } else { role.quantity() };
        let unit = table.unit.map(Into::into);
        let options = SpectrumOptions { columns, quantity, unit, ..SpectrumOptions::default() };
        let curve = self.spectra(at, &table.csv, &options)?.swap_remove(0).curve;
        let Some(outside) = table.outside else { return self.scaled(at, curve, table.scale, grid) };
        self.within(&at.field("outside"), outside, [0.0, STRENGTH[1]], "")?;
        let curve = match table.scale {
            Some(_) => self.scaled(at, curve, table.scale, grid)?,
            None => curve,
        };
        Ok(with_outside(&curve, outside))
    }

    fn matlab(
        &mut self,
        at: &Place,
        file: &MatlabSpectrum,
        role: Role,
        grid: &WavelengthGrid,
    ) -> Resolved<Curve> {
        let column = file.column.unwrap_or(1).to_string();
        let table = SpectrumTable {
            csv: file.mat.clone(),
            column: Some(column),
            scale: file.scale,
            unit: None,
            outside: None,
        };
        self.table(at, &table, role, grid)
    }

    /// A curve of a file, times a factor; warns where the grid goes beyond its data.
    fn scaled(
        &mut self,
        at: &Place,
        curve: Curve,
        scale: Option<f64>,
        grid: &WavelengthGrid,
    ) -> Resolved<Curve> {
        let (first, last) = curve.range_nm();
        self.note_range(at, [first, last], grid);
        match scale {
            None => Ok(curve),
            Some(scale) => {
                let at = at.field("scale");
                Ok(curve.scaled(self.within(&at, scale, [1.0 / LARGEST_RELATIVE, LARGEST_RELATIVE], "")?))
            }
        }
    }

    /// Columns of a file of spectra, at least one; what was taken of the file, and as what, is told.
    pub(crate) fn spectra(
        &mut self,
        at: &Place,
        file: &FilePath,
        options: &SpectrumOptions,
    ) -> Resolved<Vec<NamedCurve>> {
        self.note_input(at, file)?;
        let spectra = read_spectra(file.as_ref(), options).map_err(|error| self.file_error(at, &error))?;
        if !spectra.read_as.is_empty() {
            self.warn(at, format!("the file is read as {}", spectra.read_as.join("; ")));
        }
        if spectra.curves.is_empty() {
            return self.fail(at, "the file has no column of values");
        }
        Ok(spectra.curves)
    }

    /// An error of a reader; it names its file itself.
    pub(crate) fn file_error(&self, at: &Place, error: &FormatError) -> crate::ExperimentError {
        self.error(at, error.to_string()).without_value()
    }

    fn check_values(
        &self,
        at: &Place,
        reference: &SpectrumReference,
        curve: &Curve,
        role: Role,
    ) -> Resolved<()> {
        let most = match role {
            Role::Filter | Role::Reflectance => 1.0,
            Role::QuantumEfficiency => 2.0,
            Role::Light => LARGEST_RELATIVE,
            Role::Absolute | Role::AbsolutePower | Role::Coefficient => STRENGTH[1],
        };
        let bad = |value: &f64| !(0.0..=most).contains(value);
        let Some(index) = curve.values().iter().position(bad) else {
            if !role.is_fraction() && curve.integral(MIN_WAVELENGTH_NM, MAX_WAVELENGTH_NM) <= 0.0 {
                let message = "the spectrum is zero from 200 to 1200 nm; are its wavelengths in nanometers?";
                return self.fail(at, message);
            }
            return Ok(());
        };
        let number = curve.values()[index];
        let [value, nm] = [number, curve.wavelengths_nm()[index]].map(number_text);
        let is_number = matches!(reference, SpectrumReference::Constant(_));
        let place = if is_number { String::new() } else { format!(" at {nm} nm") };
        let most = number_text(most);
        if role.is_fraction() {
            let hint = match reference {
                _ if number <= 1.0 || number > 100.0 => "",
                SpectrumReference::Constant(_) => ". If it is a percentage, divide it by 100",
                SpectrumReference::Text(_) => {
                    ". If the values are percentages, give the file as { csv = \"FILE\", unit = \"percent\" }"
                }
                SpectrumReference::Table(_) | SpectrumReference::Matlab(_) => {
                    ". If the values are percentages, set unit = \"percent\" or scale = 0.01, or divide the given scale by 100"
                }
                SpectrumReference::Model(_) => ". If the values are percentages, divide them by 100",
            };
            return self.fail(at, format!("the value {value}{place} is not between 0 and {most}{hint}"));
        }
        self.fail(at, format!("the value {value}{place} is not between 0 and {most}"))
    }

    /// A texture from its reference. Values must be between 0 and `highest`.
    pub(crate) fn texture(
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
    fn dorsal_tongue(&self, at: &Place, map: &DorsalTongueMap, highest: f64) -> Resolved<ScalarTexture> {
        self.within(&at.field("peak"), map.peak, [0.0, highest], "")?;
        self.within(&at.field("sigma"), map.sigma, [0.01, 10.0], "of the tongue's width")?;
        self.within(&at.field("full_at"), map.full_at, [0.01, 1.0], "of the tongue's length")?;
        self.within(&at.field("patchiness"), map.patchiness, [0.0, 1.0], "")?;
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
        let [low, high] = table.range().unwrap_or([0.0, highest]);
        let low = self.within(&at.field("low"), low, [0.0, highest], "")? as f32;
        let high = self.within(&at.field("high"), high, [0.0, highest], "")? as f32;
        let texture = match table {
            TextureTable::Image(map) => {
                let at = at.field("image");
                self.note_input(&at, &map.image)?;
                let transfer = if map.srgb { Transfer::Srgb } else { Transfer::Linear };
                let image =
                    read_texture_png(map.image.as_ref(), transfer).map_err(|e| self.file_error(&at, &e))?;
                let gray = image.data.chunks_exact(image.channels).map(gray).collect();
                let image = ImageTexture::new(image.width, image.height, gray)
                    .map_err(|e| self.error(&at, e.to_string()))?;
                ScalarTexture::Image { image: Arc::new(image), low, high }
            }
            TextureTable::Checker(CheckerMap { checker: [columns, rows], .. }) => {
                for fields in [*columns, *rows] {
                    self.whole_within(&at.field("checker"), u64::from(fields), [1, 10_000])?;
                }
                ScalarTexture::Checker { columns: *columns, rows: *rows, low, high }
            }
            TextureTable::Noise(map) => {
                for value in map.noise {
                    self.within(&at.field("noise"), value, [0.1, 1e4], "cells")?;
                }
                let cells = map.noise.map(|value| value as f32);
                ScalarTexture::Noise { cells, seed: map.seed, low, high }
            }
            TextureTable::DorsalTongue(map) => {
                self.dorsal_tongue(&at.field("dorsal_tongue"), &map.dorsal_tongue, highest)?
            }
            TextureTable::Anatomy(map) => self.anatomy_map(at, map, [low, high])?,
        };
        match table.times() {
            None => Ok(texture),
            Some(other) => {
                let other = self.texture(&at.field("times"), other, highest)?;
                Ok(ScalarTexture::Product(Box::new(texture), Box::new(other)))
            }
        }
    }

    fn anatomy_map(&self, at: &Place, map: &AnatomyMap, [low, high]: [f32; 2]) -> Resolved<ScalarTexture> {
        let at = at.field("anatomy");
        let Some(mouth) = &self.mouth else {
            return self.fail(&at, "a map of the anatomy needs a [mouth]; add one, or use noise or an image");
        };
        let Some(tissue) = map.tissue.or(self.tissue) else {
            let message = "which tissue's map? Add tissue = \"tongue_dorsum\" or another";
            return self.fail(&at, message);
        };
        let mut person = mouth.clone();
        person.seed = map.seed.unwrap_or(person.seed);
        let baked = cached_surface_map(map.anatomy, tissue, &person);
        let image = ImageTexture::new(baked.columns, baked.rows, baked.values.clone())
            .map_err(|e| self.error(&at, e.to_string()))?;
        Ok(ScalarTexture::Image { image: Arc::new(image), low, high })
    }
}

/// A curve with a value of its own at all wavelengths beyond its data.
fn with_outside(curve: &Curve, outside: f64) -> Curve {
    /// Beside the last sample, nm.
    const BESIDE_NM: f64 = 1e-6;
    let (first, last) = curve.range_nm();
    let left = [(MIN_WAVELENGTH_NM.min(first - 1.0), outside), (first - BESIDE_NM, outside)];
    let right = [(last + BESIDE_NM, outside), (MAX_WAVELENGTH_NM.max(last + 1.0), outside)];
    let data = curve.wavelengths_nm().iter().copied().zip(curve.values().iter().copied());
    let (nm, values) = left.into_iter().chain(data).chain(right).unzip();
    Curve::new(nm, values).unwrap_or_else(|_| curve.clone())
}

/// Pixels across and along a map of the back of a tongue: seven to the finest features of its patches.
const DORSAL_TONGUE_PX: [usize; 2] = [512, 1024];

/// Gray value of a pixel: the only channel, or the mean of red, green and blue; alpha is left out.
pub(super) fn gray(pixel: &[f32]) -> f32 {
    let colors = match pixel.len() {
        2 => 1,
        4 => 3,
        n => n,
    };
    pixel[..colors].iter().sum::<f32>() / colors as f32
}
