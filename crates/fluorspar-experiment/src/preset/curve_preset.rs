//! Spectra of the catalogue: lights, filters, reflectances and quantum efficiencies.

use std::sync::LazyLock;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::catalogue::{damaged, parse_text, text};
use super::kind::{PresetError, PresetKind};
use fluorspar::spectral::{Curve, CurveModel};

/// Longest wavelength of an entry, nm.
const MOST_NM: f64 = 30_000.0;

/// Quantity of a curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CurveQuantity {
    /// Spectral power per nm, relative to the peak.
    RelativeSpectralPower,
    /// Fraction of light passed, 0 to 1.
    Transmittance,
    /// Fraction of light reflected diffusely, 0 to 1.
    Reflectance,
    /// Electrons per photon, 0 to 1.
    QuantumEfficiency,
}

impl CurveQuantity {
    /// What spectra of a kind are.
    pub(super) fn of(kind: PresetKind) -> Self {
        match kind {
            PresetKind::Light => Self::RelativeSpectralPower,
            PresetKind::Filter => Self::Transmittance,
            PresetKind::Reflectance => Self::Reflectance,
            _ => Self::QuantumEfficiency,
        }
    }

    fn is_fraction(self) -> bool {
        self != Self::RelativeSpectralPower
    }
}

/// How a model was fitted to data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurveFit {
    /// The data, by the name of their file.
    pub reference: String,
    /// Root mean square of model minus data, in the unit of the quantity.
    pub rms: f64,
    /// Wavelengths over which it holds, nm.
    pub range_nm: [f64; 2],
    /// Notes on the fit.
    #[serde(default)]
    pub note: String,
}

/// Spectra of the catalogue: one equation, or one for each channel of a sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpectraPreset<M> {
    /// Name by which files refer to it.
    pub name: String,
    /// Name for people.
    pub title: String,
    /// Description and caveats.
    pub description: String,
    /// Where the numbers come from.
    pub source: String,
    /// Quantity of the values.
    pub quantity: CurveQuantity,
    /// Wavelengths between which the models hold, nm.
    pub valid_nm: [f64; 2],
    /// Fields that are assumed rather than measured.
    pub assumed: Vec<String>,
    /// Effective refractive index of an interference filter, whose curve moves to shorter wavelengths at an angle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effective_index: Option<f64>,
    /// How the models were fitted; `None` where there was nothing to fit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fit: Option<CurveFit>,
    /// The equations.
    #[serde(rename = "curve")]
    pub model: M,
}

/// A spectrum of the catalogue with one curve.
pub type CurvePreset = SpectraPreset<CurveModel>;

/// Quantum efficiencies of the channels of a sensor, by name.
pub type QuantumEfficiencyPreset = SpectraPreset<toml::Table>;

impl CurvePreset {
    /// The curve over 200 to 1200 nm. Outside `valid_nm` it is an extrapolation.
    pub fn curve(&self) -> Curve {
        Curve::from_model(&self.model)
    }

    /// The curve of an interference filter for light at an angle to its normal:
    /// `T(lambda) = T0(lambda / sqrt(1 - (sin angle / n)^2))`. A filter without `effective_index` does not change.
    pub fn curve_at_angle(&self, angle_deg: f64) -> Curve {
        let Some(index) = self.effective_index.filter(|_| angle_deg != 0.0) else { return self.curve() };
        let sine = angle_deg.to_radians().sin() / index;
        let shift = (1.0 - sine * sine).max(0.0).sqrt();
        Curve::from_fn(200.0, 1200.0, |nm| self.model.eval(nm / shift))
    }
}

impl QuantumEfficiencyPreset {
    /// Names of the channels, in the order of the file.
    pub fn channel_names(&self) -> Vec<&str> {
        self.model.keys().map(String::as_str).collect()
    }

    /// Electrons per photon of each channel.
    ///
    /// # Errors
    /// When the embedded file is damaged.
    pub fn channels(&self) -> Result<Vec<(String, Curve)>, PresetError> {
        self.models()?.into_iter().map(|(name, model)| Ok((name, Curve::from_model(&model)))).collect()
    }

    fn models(&self) -> Result<Vec<(String, CurveModel)>, PresetError> {
        let kind = PresetKind::QuantumEfficiency;
        let model = |(channel, value): (&String, &toml::Value)| {
            let model: CurveModel = value
                .clone()
                .try_into()
                .map_err(|error| damaged(kind, &self.name, format!("curve.{channel}: {error}")))?;
            Ok((channel.clone(), model))
        };
        self.model.iter().map(model).collect()
    }
}

/// Relative spectral power of a light source.
///
/// # Errors
/// When there is no such light.
pub fn light_spectrum(name: &str) -> Result<CurvePreset, PresetError> {
    curve(PresetKind::Light, name, text(PresetKind::Light, name)?)
}

/// Transmittance of a filter.
///
/// # Errors
/// When there is no such filter.
pub fn filter(name: &str) -> Result<CurvePreset, PresetError> {
    curve(PresetKind::Filter, name, text(PresetKind::Filter, name)?)
}

/// Diffuse reflectance of a surface.
///
/// # Errors
/// When there is no such reflectance.
pub fn reflectance(name: &str) -> Result<CurvePreset, PresetError> {
    curve(PresetKind::Reflectance, name, text(PresetKind::Reflectance, name)?)
}

/// All diffuse reflectances as curves, in the order of their names: the colors that matter to images of tissue. They are evaluated
/// once.
pub fn reflectance_curves() -> Vec<Curve> {
    static CURVES: LazyLock<Vec<Curve>> = LazyLock::new(|| {
        super::names(PresetKind::Reflectance)
            .into_iter()
            .filter_map(|name| reflectance(name).ok())
            .map(|entry| entry.curve())
            .collect()
    });
    CURVES.clone()
}

/// Quantum efficiencies of a sensor.
///
/// # Errors
/// When there is no such entry.
pub fn quantum_efficiency(name: &str) -> Result<QuantumEfficiencyPreset, PresetError> {
    quantum_efficiency_of(name, text(PresetKind::QuantumEfficiency, name)?)
}

/// The quantum efficiencies that the text of a file describes.
pub(super) fn quantum_efficiency_of(name: &str, text: &str) -> Result<QuantumEfficiencyPreset, PresetError> {
    let kind = PresetKind::QuantumEfficiency;
    let preset: QuantumEfficiencyPreset = preset(kind, name, text)?;
    for (channel, model) in preset.models()? {
        check_model(kind, name, &format!("curve.{channel}"), &model, true, preset.valid_nm)?;
    }
    Ok(preset)
}

/// The curve that the text of a file describes.
pub(super) fn curve(kind: PresetKind, name: &str, text: &str) -> Result<CurvePreset, PresetError> {
    let preset: CurvePreset = preset(kind, name, text)?;
    check_model(kind, name, "curve", &preset.model, preset.quantity.is_fraction(), preset.valid_nm)?;
    Ok(preset)
}

/// Spectra of a quantity.
fn preset<M: DeserializeOwned>(
    kind: PresetKind,
    name: &str,
    text: &str,
) -> Result<SpectraPreset<M>, PresetError> {
    let preset: SpectraPreset<M> = parse_text(kind, name, text)?;
    check_name(kind, name, &preset.name)?;
    if preset.quantity != CurveQuantity::of(kind) {
        return Err(damaged(kind, name, format!("quantity is {:?}", preset.quantity)));
    }
    // Models are looked at in fine steps
    let [first, last] = preset.valid_nm;
    if !(0.0 <= first && first < last && last <= MOST_NM) {
        let message = format!("valid_nm must be two growing wavelengths from 0 to {MOST_NM}, nm");
        return Err(damaged(kind, name, message));
    }
    Ok(preset)
}

pub(super) fn check_name(kind: PresetKind, file: &str, name: &str) -> Result<(), PresetError> {
    if file == name { Ok(()) } else { Err(damaged(kind, file, format!("it calls itself \"{name}\""))) }
}

fn check_model(
    kind: PresetKind,
    name: &str,
    field: &str,
    model: &CurveModel,
    is_fraction: bool,
    valid_nm: [f64; 2],
) -> Result<(), PresetError> {
    model.validate().map_err(|(at, message)| damaged(kind, name, format!("{field}.{at}: {message}")))?;
    let largest = Curve::from_fn(valid_nm[0], valid_nm[1], |nm| model.eval(nm)).max();
    if is_fraction && largest > 1.0 {
        return Err(damaged(kind, name, format!("{field} reaches {largest}, more than 1")));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::names;
    use super::*;

    #[test]
    fn every_curve_loads_and_is_plausible() {
        for name in names(PresetKind::Light) {
            let light = light_spectrum(name).unwrap();
            let peak = Curve::from_fn(light.valid_nm[0], light.valid_nm[1], |nm| light.model.eval(nm)).max();
            assert!((0.9..1.1).contains(&peak), "{name}: a relative spectrum has peak 1, this one {peak}");
        }
        for name in names(PresetKind::Filter) {
            filter(name).unwrap();
        }
        for name in names(PresetKind::Reflectance) {
            reflectance(name).unwrap();
        }
        for name in names(PresetKind::QuantumEfficiency) {
            assert!(!quantum_efficiency(name).unwrap().channels().unwrap().is_empty());
        }
        let rgb = quantum_efficiency("consumer_rgb_cmos").unwrap();
        assert_eq!(rgb.channel_names(), ["R", "G", "B"]);
    }

    #[test]
    fn a_tilted_interference_filter_cuts_earlier() {
        let preset = filter("short_pass_425").unwrap();
        let cut = |curve: &Curve| {
            let at = |nm: &f64| curve.at(*nm) < 0.475;
            (3800..4400).map(|i| f64::from(i) * 0.1).find(at).unwrap()
        };
        let ratio = cut(&preset.curve_at_angle(30.0)) / cut(&preset.curve());
        assert!((ratio - (1.0_f64 - (0.5 / 1.8_f64).powi(2)).sqrt()).abs() < 2e-3, "{ratio}");
    }
}
