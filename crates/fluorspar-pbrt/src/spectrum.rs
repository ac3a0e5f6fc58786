//! Spectra of parameters: pairs of wavelength and value, files of them, names, black bodies, colors.

use fluorspar::quote::excerpt;
use fluorspar::spectral::{Curve, StandardObserver, WavelengthGrid, daylight_d65, linear_srgb};
use fluorspar_experiment::preset;
use fluorspar_format::{PbrtError, PbrtKind, PbrtParameter, PbrtPlace, PbrtValues, read_text_bounded};

use crate::convert::{Convert, Emission};
use crate::rgb::color_spectrum;

/// Largest file with a spectrum, bytes.
const MAX_SPECTRUM_BYTES: u64 = 64 << 20;

/// What a spectrum is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    /// A reflectance or transmittance: colors are smooth spectra.
    Reflectance,
    /// A refractive index and the like, which have values at all wavelengths.
    Index,
    /// The light of a source.
    Light,
}

/// A light spectrum and the factor that makes it absolute.
pub(crate) struct LightSpectrum {
    pub(crate) curve: Curve,
    /// Factor for what pbrt-v4 calls one nit; 1 for absolute spectra.
    pub(crate) scale: f64,
}

/// Real part of glasses at 587.6 nm. \[values of the makers, from memory\]
const GLASSES: &[(&str, f64)] = &[
    ("glass-BK7", 1.5168),
    ("glass-BAF10", 1.67003),
    ("glass-F5", 1.60342),
    ("glass-FK51A", 1.48656),
    ("glass-LASF9", 1.85025),
    ("glass-SF5", 1.67271),
    ("glass-SF10", 1.72828),
    ("glass-SF11", 1.78472),
];

/// Metals of pbrt and those of the catalogue.
const METALS: &[(&str, &str)] = &[("Ag", "silver"), ("Al", "aluminum"), ("Au", "gold"), ("Cu", "copper")];

impl Convert<'_> {
    /// The spectrum of a parameter that is not a texture.
    pub(crate) fn spectrum(&mut self, parameter: &PbrtParameter, role: Role) -> Result<Curve, PbrtError> {
        let at = parameter.at;
        match (&parameter.values, parameter.kind) {
            (PbrtValues::Texts(texts), _) => {
                let name = texts.first().map_or("", String::as_str);
                match self.named_spectrum(name, role, at)? {
                    Some(curve) => Ok(curve),
                    None => self.spectrum_file(name, role, at),
                }
            }
            (PbrtValues::Numbers(numbers), PbrtKind::Spectrum) => self.curve_of_pairs(numbers, role, at),
            (PbrtValues::Numbers(numbers), PbrtKind::Rgb) => self.color(numbers, role, at),
            (PbrtValues::Numbers(numbers), PbrtKind::Xyz) => {
                let xyz = <[f64; 3]>::try_from(numbers.as_slice()).unwrap_or_default();
                self.color(&linear_srgb(xyz), role, at)
            }
            (PbrtValues::Numbers(numbers), PbrtKind::Blackbody) => self.black_body(numbers, at),
            (PbrtValues::Numbers(numbers), _) if numbers.len() == 1 => Ok(Curve::constant(numbers[0])),
            _ => {
                let message = format!(
                    "\"{}\" is not a spectrum; give rgb, spectrum or blackbody",
                    excerpt(&parameter.name)
                );
                Err(self.error(at, message))
            }
        }
    }

    fn color(&mut self, rgb: &[f64], role: Role, at: PbrtPlace) -> Result<Curve, PbrtError> {
        let Ok(rgb) = <[f64; 3]>::try_from(rgb) else {
            return Err(self.error(at, format!("a color has 3 numbers, not {}", rgb.len())));
        };
        if rgb.iter().any(|value| *value < 0.0) {
            self.remark(at, "a color has components below 0; they count as 0");
        }
        let curve = color_spectrum(rgb);
        Ok(if role == Role::Light && self.is_v4() { curve.times(&daylight_d65()) } else { curve })
    }

    /// Planck's law with its maximum at 1; in version 3 times a factor.
    fn black_body(&mut self, numbers: &[f64], at: PbrtPlace) -> Result<Curve, PbrtError> {
        let (kelvins, factor) = match *numbers {
            [kelvins] => (kelvins, 1.0),
            [kelvins, factor] => (kelvins, factor),
            _ => {
                let message = "blackbody takes a temperature in kelvins, in version 3 followed by a factor";
                return Err(self.error(at, message));
            }
        };
        if !(100.0..=1e6).contains(&kelvins) {
            return Err(self.error(at, format!("a black body of {kelvins} K; give 100 to 1000000 kelvins")));
        }
        Ok(planck(kelvins).scaled(factor))
    }

    /// Pairs of wavelength and value, in any order.
    fn curve_of_pairs(&mut self, numbers: &[f64], role: Role, at: PbrtPlace) -> Result<Curve, PbrtError> {
        let mut pairs: Vec<(f64, f64)> = numbers.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect();
        if let [(_, value)] = pairs[..] {
            return Ok(Curve::constant(value));
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        // Steps: two values at one wavelength.
        for i in 1..pairs.len() {
            if pairs[i].0 <= pairs[i - 1].0 {
                pairs[i].0 = pairs[i - 1].0 + 1e-4;
            }
        }
        let (Some(&(first, low)), Some(&(last, high))) = (pairs.first(), pairs.last()) else {
            return Err(self.error(at, "a spectrum without values; give pairs of wavelength (nm) and value"));
        };
        let grid = &self.options.grid;
        let (start, end) = (grid.start_nm(), grid.end_nm());
        let holds = !self.is_v4() || role == Role::Index;
        if first > start || last < end {
            let beyond =
                if holds { "its first and last values hold beyond" } else { "it is 0 beyond, as in pbrt-v4" };
            let text = format!("the spectrum covers {first} to {last} nm of {start} to {end} nm; {beyond}");
            self.remark(at, text);
        }
        if holds {
            if first > 200.0 {
                pairs.insert(0, (200.0, low));
            }
            if last < 1200.0 {
                pairs.push((1200.0, high));
            }
        }
        let (nm, values) = pairs.into_iter().unzip();
        Curve::new(nm, values).map_err(|error| self.error(at, error.to_string()))
    }

    /// A text file of pairs; `#` begins a comment.
    fn spectrum_file(&mut self, name: &str, role: Role, at: PbrtPlace) -> Result<Curve, PbrtError> {
        let path = self.tree.path_of(at, name);
        let text = read_text_bounded(&path, MAX_SPECTRUM_BYTES).map_err(|error| {
            let known = "; spectra known by name: stdillum-D65, stdillum-A, illum-..., metal-..., glass-...";
            let hint = if name.contains('.') { "" } else { known };
            self.error(at, format!("{}: {}{hint}", path.display(), error.problem()))
        })?;
        let numbers = numbers_of(&text)
            .map_err(|(line, problem)| self.error(at, format!("{}:{line}: {problem}", path.display())))?;
        if !numbers.len().is_multiple_of(2) {
            let message = format!(
                "{}: {} numbers do not form pairs of wavelength (nm) and value",
                path.display(),
                numbers.len()
            );
            return Err(self.error(at, message));
        }
        self.read.push(path);
        self.curve_of_pairs(&numbers, role, at)
    }

    /// A spectrum that pbrt knows by name; `None` for names that it does not know.
    fn named_spectrum(&mut self, name: &str, role: Role, at: PbrtPlace) -> Result<Option<Curve>, PbrtError> {
        if let Some((_, index)) = GLASSES.iter().find(|(known, _)| *known == name) {
            self.remark(at, format!("\"{name}\": its index is {index} at all wavelengths"));
            return Ok(Some(Curve::constant(*index)));
        }
        match name {
            "stdillum-D65" => return Ok(Some(daylight_d65())),
            // CIE 15: a Planckian radiator at 2856 K.
            "stdillum-A" => return Ok(Some(planck(2856.0))),
            _ => {}
        }
        if let Some(metal) = name.strip_prefix("metal-")
            && let Some((symbol, part)) = metal.split_once('-')
        {
            let Some((_, preset_name)) = METALS.iter().find(|(known, _)| *known == symbol) else {
                let message = format!(
                    "no data for \"{}\"; known are Ag, Al, Au and Cu. Give its spectra",
                    excerpt(name)
                );
                return Err(self.error(at, message));
            };
            let preset = preset::metal(preset_name).map_err(|error| self.error(at, error.to_string()))?;
            let (n, k) = preset.index();
            return Ok(Some(self.held(if part == "k" { &k } else { &n }, role, at)?));
        }
        if name.starts_with("stdillum-") || name.starts_with("illum-") || name.starts_with("glass-") {
            let message = format!(
                "no data for \"{}\"; known are stdillum-A, stdillum-D65 and glasses such as glass-BK7. Give its spectrum",
                excerpt(name)
            );
            return Err(self.error(at, message));
        }
        Ok(None)
    }

    fn held(&mut self, curve: &Curve, role: Role, at: PbrtPlace) -> Result<Curve, PbrtError> {
        let pairs = curve.wavelengths_nm().iter().zip(curve.values());
        let numbers: Vec<f64> = pairs.flat_map(|(nm, value)| [*nm, *value]).collect();
        self.curve_of_pairs(&numbers, role, at)
    }

    /// The spectrum of a light, or the usual one where there is none: 1 in version 3, D65 in version 4. `photometric` says
    /// that `power` or `illuminance` sets the amount.
    pub(crate) fn light_spectrum(
        &mut self,
        parameter: Option<&PbrtParameter>,
        at: PbrtPlace,
        photometric: bool,
    ) -> Result<LightSpectrum, PbrtError> {
        let curve = match parameter {
            Some(parameter) => self.spectrum(parameter, Role::Light)?,
            None if self.is_v4() => daylight_d65(),
            None => Curve::constant(1.0),
        };
        if let Some(value) = curve.values().iter().find(|value| **value < 0.0) {
            return Err(
                self.error(at, format!("the spectrum of a light is {value}; give values of 0 or more"))
            );
        }
        if !self.is_v4() {
            return Ok(LightSpectrum { curve, scale: 1.0 });
        }
        let is_color = parameter.is_some_and(|p| matches!(p.kind, PbrtKind::Rgb | PbrtKind::Xyz));
        if parameter.is_some_and(is_measured) && !photometric && self.options.emission == Emission::Absolute {
            self.note(at, "the spectrum of the light is taken as absolute; pbrt-v4 would scale it to 1 nit");
            return Ok(LightSpectrum { curve, scale: 1.0 });
        }
        let candelas = if is_color { luminance(&daylight_d65()) } else { luminance(&curve) };
        if candelas <= 0.0 {
            let message = "the light has no visible part by which pbrt-v4 sets its amount; give a spectrum without power";
            return Err(self.error(at, message));
        }
        Ok(LightSpectrum { curve, scale: 1.0 / candelas })
    }
}

/// Luminance of a radiance, cd/m².
pub(crate) fn luminance(radiance: &Curve) -> f64 {
    let Ok(grid) = WavelengthGrid::uniform(360.0, 830.0, 1.0) else { return 0.0 };
    let values: Vec<f32> = radiance.bin_averages(&grid).into_iter().map(|value| value as f32).collect();
    StandardObserver::new(&grid).xyz(&values)[1]
}

/// Whether a spectrum is given in numbers, and not as a color or by the name of a standard illuminant.
fn is_measured(parameter: &PbrtParameter) -> bool {
    let mut names = parameter.texts().into_iter().flatten();
    parameter.kind == PbrtKind::Spectrum && !names.any(|name| name.starts_with("stdillum-"))
}

/// The numbers of a text; `#` begins a comment. A problem comes with its line.
fn numbers_of(text: &str) -> Result<Vec<f64>, (usize, String)> {
    let mut numbers = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default();
        for word in line.split([' ', '\t', ',', ';', '\r']).filter(|word| !word.is_empty()) {
            match word.parse::<f64>() {
                Ok(value) if value.is_finite() => numbers.push(value),
                _ => return Err((index + 1, format!("\"{}\" is not a number", excerpt(word)))),
            }
        }
    }
    Ok(numbers)
}

/// Planck's law per wavelength, 1 at its maximum, from 200 to 1200 nm.
fn planck(kelvins: f64) -> Curve {
    // Second radiation constant, nm K, and x = c2 / (lambda T) of the maximum (Wien).
    const C2_NM_K: f64 = 1.438_776_877e7;
    const X_PEAK: f64 = 4.965_114_231_744_276;
    let shape = |x: f64| x.powi(5) / x.exp_m1();
    Curve::from_fn(200.0, 1200.0, |nm| shape(C2_NM_K / (nm * kelvins)) / shape(X_PEAK))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_bodies_peak_by_wiens_law() {
        let curve = planck(5000.0);
        assert!((curve.peak_nm() - 2.897_771_955e6 / 5000.0).abs() <= 0.5, "{}", curve.peak_nm());
        assert!((curve.max() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn luminance_counts_lumens() {
        let line = Curve::new(vec![554.0, 555.0, 556.0], vec![0.0, 1.0, 0.0]).unwrap();
        assert!((luminance(&line) / 683.0 - 1.0).abs() < 1e-3, "{}", luminance(&line));
    }
}
