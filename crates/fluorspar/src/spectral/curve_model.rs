//! Analytic spectral curves: lights, filters, reflectances and quantum efficiencies as equations with few
//! parameters.
//!
//! A [`CurveModel`] is what a data file holds under `[curve]`. It is checked once with [`CurveModel::validate`]
//! and then evaluated anywhere with [`CurveModel::eval`]; the wavelength grid is the caller's.

use std::f64::consts::LN_2;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::hemoglobin;
use crate::units::check_range;

/// Second radiation constant `h c / k` in nm K (CODATA 2018, exact SI constants).
const SECOND_RADIATION_CONSTANT_NM_K: f64 = 1.438_776_877e7;

/// Scale of the logistic function per unit of its 10-90 % width: `1 / (2 ln 9)`.
const LOGISTIC_SCALE_PER_WIDTH: f64 = 0.227_559_806_656_709_33;

/// Order of the super-Gaussian that stands for a notch.
const NOTCH_ORDER: i32 = 6;

/// A spectral curve given by an equation.
///
/// All wavelengths and widths are in nm, in vacuum and at normal incidence. The value has the unit that the
/// file around the curve states (relative power, transmittance, reflectance, electrons per photon).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum CurveModel {
    /// The same value at every wavelength.
    Constant {
        /// The value.
        value: f64,
    },
    /// Linear interpolation between points; 0 outside the first and the last one.
    Table {
        /// Wavelengths in nm, rising.
        wavelength_nm: Vec<f64>,
        /// One value for each wavelength.
        value: Vec<f64>,
    },
    /// Spectrum of a light-emitting diode, 1 at its peak.
    ///
    /// With `x = lambda - peak_nm` and `w` the full width of the side on which `x` lies,
    /// `core = exp(-ln 2 |2 x / w|^shape)` and
    /// `S = core + (1 - core) * sum of level * exp(-|x| / decay_nm)` over the tails of that side.
    /// A Gaussian (`shape` 2) with two widths is the usual model of an LED; the exponential tails stand for
    /// phonon-assisted and defect emission, which a Gaussian misses by orders of magnitude.
    Led {
        /// Wavelength of the peak in nm.
        peak_nm: f64,
        /// Twice the half width at half maximum of the core on the short-wavelength side, nm.
        fwhm_short_nm: f64,
        /// Twice the half width at half maximum of the core on the long-wavelength side, nm.
        fwhm_long_nm: f64,
        /// Exponent of the core: 2 is a Gaussian, less is more pointed, more is flatter. 1 to 10.
        #[serde(default = "gaussian_exponent")]
        shape: f64,
        /// Exponential tails; none leaves the core alone.
        #[serde(default)]
        tails: Vec<Tail>,
    },
    /// Sum of Gaussians with two widths over a constant:
    /// `base + sum of weight * exp(-ln 2 (2 (lambda - peak) / w)^2)`, `w` by the side of the peak.
    Bands {
        /// Constant below the bands.
        #[serde(default)]
        base: f64,
        /// The bands.
        bands: Vec<Band>,
    },
    /// Transmittance of a filter made of edges and notches:
    /// `T = floor + (peak - floor) * product of edges * product of (1 - notch)`, `floor = 10^-optical_density`.
    ///
    /// A long-pass edge is `1 / (1 + exp(-(lambda - cut) / s))` with `s = width / (2 ln 9)`, so that `cut` is
    /// its 50 % point and `width` reaches from 10 % to 90 %; a short-pass edge is its mirror image. A notch is
    /// `exp(-ln 2 (2 (lambda - center) / fwhm)^6)`.
    Edges {
        /// Transmittance in the middle of a wide pass band.
        peak: f64,
        /// Optical density of the blocking bands; the transmittance never falls below `10^-optical_density`.
        optical_density: f64,
        /// The edges; a long-pass and a short-pass one make a band-pass.
        #[serde(default)]
        edges: Vec<Edge>,
        /// Stop bands inside the pass band.
        #[serde(default)]
        notches: Vec<Notch>,
    },
    /// Sum of logistic steps over a constant:
    /// `base + sum of height / (1 + exp(-(lambda - center) / s))`, `s = width / (2 ln 9)`; never below 0.
    Sigmoids {
        /// Value far below the first step.
        base: f64,
        /// The steps; a negative height steps down.
        #[serde(default)]
        steps: Vec<Step>,
    },
    /// Spectral radiance of a black body by Planck's law, relative to its value at `reference_nm`:
    /// `(reference / lambda)^5 * (exp(c2 / (reference T)) - 1) / (exp(c2 / (lambda T)) - 1)`.
    Blackbody {
        /// Temperature in K.
        temperature_k: f64,
        /// Wavelength in nm at which the value is 1.
        #[serde(default = "blackbody_reference_nm")]
        reference_nm: f64,
    },
    /// Diffuse reflectance of tissue perfused with blood, see [`BloodDiffuse`].
    BloodDiffuse(BloodDiffuse),
}

/// One exponential tail of [`CurveModel::Led`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Tail {
    /// Side of the peak on which the tail lies.
    pub side: Side,
    /// Height relative to the peak to which the tail extrapolates at the peak wavelength.
    pub level: f64,
    /// Distance in nm over which the tail falls to 1/e.
    pub decay_nm: f64,
}

/// One band of [`CurveModel::Bands`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Band {
    /// Wavelength of the peak in nm.
    pub peak_nm: f64,
    /// Twice the half width at half maximum on the short-wavelength side, nm.
    pub fwhm_short_nm: f64,
    /// Twice the half width at half maximum on the long-wavelength side, nm.
    pub fwhm_long_nm: f64,
    /// Value at the peak.
    pub weight: f64,
}

/// One edge of [`CurveModel::Edges`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Edge {
    /// Side of the edge that passes.
    pub pass: Side,
    /// Wavelength in nm at which the edge passes 50 %.
    pub cut_nm: f64,
    /// Distance in nm between 10 % and 90 %.
    pub width_nm: f64,
}

/// One stop band of [`CurveModel::Edges`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Notch {
    /// Middle of the stop band in nm.
    pub center_nm: f64,
    /// Full width at half depth in nm.
    pub fwhm_nm: f64,
}

/// One step of [`CurveModel::Sigmoids`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// Wavelength in nm at which half of the step is done.
    pub center_nm: f64,
    /// Distance in nm between 10 % and 90 % of the step.
    pub width_nm: f64,
    /// Change of the value across the step; may be negative.
    pub height: f64,
}

/// The short-wavelength or the long-wavelength side.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// Shorter wavelengths.
    Short,
    /// Longer wavelengths.
    Long,
}

/// Diffuse reflectance of a deep, evenly perfused tissue below a thin bloody and a thin pigmented layer.
///
/// The deep tissue follows the diffusion result of Flock et al., IEEE Trans. Biomed. Eng. 36:1162 (1989):
///
/// `R = a' / (1 + 2 k (1 - a') + (1 + 2 k / 3) sqrt(3 (1 - a')))`, `a' = mus' / (mus' + mua)`,
/// `k = (1 + r) / (1 - r)`, `r = -1.440 n^-2 + 0.710 n^-1 + 0.668 + 0.0636 n` (Groenhuis 1983),
///
/// without the light that the surface itself reflects (gloss belongs to the material, not to this curve).
/// `mus' = scattering_per_cm (lambda / 500)^-scattering_power` (Jacques, Phys. Med. Biol. 58:R37, 2013);
/// `mua = background_per_cm exp(-(lambda - 500) / background_decay_nm) + blood_fraction mub C(vessel_radius_um)`;
/// `mub = ln(10) (hemoglobin_g_per_l / 64500) [S eps_HbO2 + (1 - S) eps_Hb]`; `C(r) = (1 - exp(-2 mub r)) / (2 mub r)`
/// corrects for blood that sits in vessels (Svaasand et al., Lasers Med. Sci. 10:55, 1995; Verkruysse et al.,
/// Phys. Med. Biol. 42:51, 1997).
///
/// Diffuse light crosses the two thin layers twice, at twice their thickness each time, so R is multiplied by
/// `exp(-4 mub C(4 um) superficial_blood_um)` and by `exp(-melanin_depth (lambda / 500)^-3.5)`.
///
/// The equation fixes only the ratio of absorption to scattering: the numbers describe a reflectance, they do
/// not measure a tissue.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BloodDiffuse {
    /// Reduced scattering coefficient at 500 nm in 1/cm.
    pub scattering_per_cm: f64,
    /// Exponent with which scattering falls with wavelength.
    pub scattering_power: f64,
    /// Absorption of the bloodless tissue at 500 nm in 1/cm.
    pub background_per_cm: f64,
    /// Distance in nm over which the background absorption falls to 1/e.
    pub background_decay_nm: f64,
    /// Volume fraction of blood (and myoglobin, as blood) in the deep tissue, 0 to 1.
    pub blood_fraction: f64,
    /// Oxygen saturation, 0 to 1.
    pub saturation: f64,
    /// Effective radius of the deep vessels in um; 0 spreads the blood evenly.
    pub vessel_radius_um: f64,
    /// Thickness in um to which the blood of the superficial capillaries would add up.
    #[serde(default)]
    pub superficial_blood_um: f64,
    /// Hemoglobin in whole blood, g/L.
    #[serde(default = "whole_blood_g_per_l")]
    pub hemoglobin_g_per_l: f64,
    /// Refractive index of the tissue, 1 to 2.
    #[serde(default = "tissue_index")]
    pub refractive_index: f64,
    /// Optical depth of the melanin at 500 nm for the way in and out together.
    #[serde(default)]
    pub melanin_depth: f64,
}

/// An error of a curve: the field, and a sentence that states the problem and how to fix it.
pub type CurveProblem = (String, String);

/// Radius in um of the capillaries in the superficial layer of [`BloodDiffuse`].
const CAPILLARY_RADIUS_UM: f64 = 4.0;

/// Exponent of melanin absorption in [`BloodDiffuse`] (Jacques 2013).
const MELANIN_POWER: f64 = 3.5;

const CM_PER_UM: f64 = 1e-4;

fn gaussian_exponent() -> f64 {
    2.0
}

fn blackbody_reference_nm() -> f64 {
    560.0
}

fn whole_blood_g_per_l() -> f64 {
    150.0
}

fn tissue_index() -> f64 {
    1.4
}

/// `exp(-ln 2 |2 x / fwhm|^exponent)`.
fn bell(x: f64, fwhm: f64, exponent: f64) -> f64 {
    (-LN_2 * (2.0 * x / fwhm).abs().powf(exponent)).exp()
}

/// Logistic step from 0 to 1, 50 % at `x = 0`, `width` from 10 % to 90 %.
fn logistic(x: f64, width: f64) -> f64 {
    1.0 / (1.0 + (-x / (width * LOGISTIC_SCALE_PER_WIDTH)).exp())
}

fn side_of(x: f64) -> Side {
    if x < 0.0 { Side::Short } else { Side::Long }
}

fn by_side(x: f64, short: f64, long: f64) -> f64 {
    match side_of(x) {
        Side::Short => short,
        Side::Long => long,
    }
}

fn interpolate(wavelength_nm: &[f64], value: &[f64], at: f64) -> f64 {
    let after = wavelength_nm.partition_point(|w| *w <= at);
    let (Some(low), Some(first)) = (after.checked_sub(1), value.get(after.wrapping_sub(1))) else {
        return 0.0;
    };
    match (wavelength_nm.get(after), value.get(after)) {
        (Some(high), Some(second)) => {
            let t = (at - wavelength_nm[low]) / (high - wavelength_nm[low]);
            first + t * (second - first)
        }
        // at or past the last point
        _ if wavelength_nm[low] >= at => *first,
        _ => 0.0,
    }
}

impl CurveModel {
    /// The same tissue under melanin of another depth. `None` of a curve that has no melanin.
    #[must_use]
    pub fn with_melanin_depth(&self, melanin_depth: f64) -> Option<Self> {
        match self {
            Self::BloodDiffuse(tissue) => Some(Self::BloodDiffuse(BloodDiffuse { melanin_depth, ..*tissue })),
            _ => None,
        }
    }

    /// Value at a wavelength in nm.
    ///
    /// Finite and not negative for every curve that [`CurveModel::validate`] accepts; 0 where the wavelength is
    /// not a positive finite number.
    #[must_use]
    pub fn eval(&self, wavelength_nm: f64) -> f64 {
        if !(wavelength_nm.is_finite() && wavelength_nm > 0.0) {
            return 0.0;
        }
        match self {
            Self::Constant { value } => *value,
            Self::Table { wavelength_nm: at, value } => interpolate(at, value, wavelength_nm),
            Self::Led { peak_nm, fwhm_short_nm, fwhm_long_nm, shape, tails } => {
                let x = wavelength_nm - peak_nm;
                let core = bell(x, by_side(x, *fwhm_short_nm, *fwhm_long_nm), *shape);
                let tail: f64 = tails
                    .iter()
                    .filter(|tail| tail.side == side_of(x))
                    .map(|tail| tail.level * (-x.abs() / tail.decay_nm).exp())
                    .sum();
                core + (1.0 - core) * tail
            }
            Self::Bands { base, bands } => {
                let sum: f64 = bands
                    .iter()
                    .map(|band| {
                        let x = wavelength_nm - band.peak_nm;
                        band.weight * bell(x, by_side(x, band.fwhm_short_nm, band.fwhm_long_nm), 2.0)
                    })
                    .sum();
                base + sum
            }
            Self::Edges { peak, optical_density, edges, notches } => {
                let floor = 10f64.powf(-optical_density);
                let passed: f64 = edges
                    .iter()
                    .map(|edge| {
                        let x = wavelength_nm - edge.cut_nm;
                        match edge.pass {
                            Side::Long => logistic(x, edge.width_nm),
                            Side::Short => logistic(-x, edge.width_nm),
                        }
                    })
                    .product();
                let kept: f64 = notches
                    .iter()
                    .map(|notch| {
                        let x = wavelength_nm - notch.center_nm;
                        1.0 - bell(x, notch.fwhm_nm, f64::from(NOTCH_ORDER))
                    })
                    .product();
                floor + (peak - floor) * passed * kept
            }
            Self::Sigmoids { base, steps } => {
                let sum: f64 = steps
                    .iter()
                    .map(|step| step.height * logistic(wavelength_nm - step.center_nm, step.width_nm))
                    .sum();
                (base + sum).max(0.0)
            }
            Self::Blackbody { temperature_k, reference_nm } => {
                let c = SECOND_RADIATION_CONSTANT_NM_K / temperature_k;
                // exp(a - b) (1 - exp(-a)) / (1 - exp(-b)) equals (exp(a) - 1) / (exp(b) - 1) without overflow
                let (a, b) = (c / reference_nm, c / wavelength_nm);
                (reference_nm / wavelength_nm).powi(5) * (a - b).exp() * (-a).exp_m1() / (-b).exp_m1()
            }
            Self::BloodDiffuse(tissue) => tissue.reflectance(wavelength_nm),
        }
    }

    /// Checks that every number is finite and in its range, that tables rise and that widths are positive.
    ///
    /// It does not check that a reflectance or a transmittance stays at or below 1: the curve does not know
    /// what it stands for.
    ///
    /// # Errors
    /// The first invalid field, and a sentence that states the problem and how to fix it.
    pub fn validate(&self) -> Result<(), CurveProblem> {
        match self {
            Self::Constant { value } => not_negative("value", *value),
            Self::Table { wavelength_nm, value } => check_table(wavelength_nm, value),
            Self::Led { peak_nm, fwhm_short_nm, fwhm_long_nm, shape, tails } => {
                positive("peak_nm", *peak_nm)?;
                positive("fwhm_short_nm", *fwhm_short_nm)?;
                positive("fwhm_long_nm", *fwhm_long_nm)?;
                within("shape", *shape, 1.0, 10.0)?;
                for (i, tail) in tails.iter().enumerate() {
                    within(&format!("tails[{i}].level"), tail.level, 0.0, 1.0)?;
                    positive(&format!("tails[{i}].decay_nm"), tail.decay_nm)?;
                }
                for side in [Side::Short, Side::Long] {
                    let sum: f64 = tails.iter().filter(|tail| tail.side == side).map(|tail| tail.level).sum();
                    if sum > 1.0 {
                        return Err((
                            "tails".to_owned(),
                            format!(
                                "the levels on the {side:?} side add up to {sum}; a tail cannot exceed the peak, so keep their sum at or below 1"
                            ),
                        ));
                    }
                }
                Ok(())
            }
            Self::Bands { base, bands } => {
                not_negative("base", *base)?;
                for (i, band) in bands.iter().enumerate() {
                    positive(&format!("bands[{i}].peak_nm"), band.peak_nm)?;
                    positive(&format!("bands[{i}].fwhm_short_nm"), band.fwhm_short_nm)?;
                    positive(&format!("bands[{i}].fwhm_long_nm"), band.fwhm_long_nm)?;
                    not_negative(&format!("bands[{i}].weight"), band.weight)?;
                }
                Ok(())
            }
            Self::Edges { peak, optical_density, edges, notches } => {
                positive("peak", *peak)?;
                within("optical_density", *optical_density, 0.0, 15.0)?;
                if *peak < 10f64.powf(-optical_density) {
                    return Err((
                        "peak".to_owned(),
                        format!(
                            "{peak} is below the blocking floor 10^-{optical_density}; raise peak or optical_density"
                        ),
                    ));
                }
                for (i, edge) in edges.iter().enumerate() {
                    positive(&format!("edges[{i}].cut_nm"), edge.cut_nm)?;
                    positive(&format!("edges[{i}].width_nm"), edge.width_nm)?;
                }
                for (i, notch) in notches.iter().enumerate() {
                    positive(&format!("notches[{i}].center_nm"), notch.center_nm)?;
                    positive(&format!("notches[{i}].fwhm_nm"), notch.fwhm_nm)?;
                }
                Ok(())
            }
            Self::Sigmoids { base, steps } => {
                not_negative("base", *base)?;
                for (i, step) in steps.iter().enumerate() {
                    positive(&format!("steps[{i}].center_nm"), step.center_nm)?;
                    positive(&format!("steps[{i}].width_nm"), step.width_nm)?;
                    within(&format!("steps[{i}].height"), step.height, -LARGEST, LARGEST)?;
                }
                Ok(())
            }
            Self::Blackbody { temperature_k, reference_nm } => {
                within("temperature_k", *temperature_k, 300.0, 50_000.0)?;
                within("reference_nm", *reference_nm, 100.0, 10_000.0)
            }
            Self::BloodDiffuse(tissue) => tissue.validate(),
        }
    }

    /// Where the curve rests on data, nm; `None` for equations that hold at every wavelength.
    ///
    /// A table ends with its first and last point, unless it has fallen below 1 % of its maximum there; tissue ends with
    /// the extinction of hemoglobin, which is held constant beyond.
    #[must_use]
    pub fn valid_nm(&self) -> Option<[f64; 2]> {
        match self {
            Self::Table { wavelength_nm, value } => {
                let least = 0.01 * value.iter().copied().fold(0.0, f64::max);
                let end = |nm: Option<&f64>, value: Option<&f64>, dark: f64| match (nm, value) {
                    (Some(nm), Some(value)) if *value > least => *nm,
                    _ => dark,
                };
                let first = end(wavelength_nm.first(), value.first(), 0.0);
                let last = end(wavelength_nm.last(), value.last(), f64::INFINITY);
                Some([first, last])
            }
            Self::BloodDiffuse(_) => Some(hemoglobin::RANGE_NM),
            Self::Constant { .. }
            | Self::Led { .. }
            | Self::Bands { .. }
            | Self::Edges { .. }
            | Self::Sigmoids { .. }
            | Self::Blackbody { .. } => None,
        }
    }
}

impl BloodDiffuse {
    /// Diffuse reflectance at a wavelength in nm, 0 to 1.
    #[must_use]
    pub fn reflectance(&self, wavelength_nm: f64) -> f64 {
        let ratio = wavelength_nm / 500.0;
        let blood = hemoglobin::absorption_per_cm(wavelength_nm, self.hemoglobin_g_per_l, self.saturation);
        let absorption = self.background_per_cm * (-(wavelength_nm - 500.0) / self.background_decay_nm).exp()
            + self.blood_fraction * blood * packaging(blood, self.vessel_radius_um);
        let scattering = self.scattering_per_cm * ratio.powf(-self.scattering_power);
        let albedo = scattering / (scattering + absorption);
        let n = self.refractive_index;
        let inside = -1.440 / (n * n) + 0.710 / n + 0.668 + 0.0636 * n;
        let k = (1.0 + inside) / (1.0 - inside);
        let lost = 1.0 - albedo;
        let deep = albedo / (1.0 + 2.0 * k * lost + (1.0 + 2.0 * k / 3.0) * (3.0 * lost).sqrt());
        let superficial =
            4.0 * blood * packaging(blood, CAPILLARY_RADIUS_UM) * self.superficial_blood_um * CM_PER_UM;
        let melanin = self.melanin_depth * ratio.powf(-MELANIN_POWER);
        deep * (-superficial - melanin).exp()
    }

    fn validate(&self) -> Result<(), CurveProblem> {
        positive("scattering_per_cm", self.scattering_per_cm)?;
        within("scattering_power", self.scattering_power, 0.0, 6.0)?;
        not_negative("background_per_cm", self.background_per_cm)?;
        // a shorter decay would let the exponential overflow in the far ultraviolet
        within("background_decay_nm", self.background_decay_nm, 5.0, 1e6)?;
        within("blood_fraction", self.blood_fraction, 0.0, 1.0)?;
        within("saturation", self.saturation, 0.0, 1.0)?;
        not_negative("vessel_radius_um", self.vessel_radius_um)?;
        not_negative("superficial_blood_um", self.superficial_blood_um)?;
        not_negative("hemoglobin_g_per_l", self.hemoglobin_g_per_l)?;
        within("refractive_index", self.refractive_index, 1.0, 2.0)?;
        not_negative("melanin_depth", self.melanin_depth)
    }
}

/// Share of its absorption that blood keeps when it sits in vessels of a radius in um:
/// `(1 - exp(-2 mua r)) / (2 mua r)`.
fn packaging(absorption_per_cm: f64, radius_um: f64) -> f64 {
    let depth = 2.0 * absorption_per_cm * radius_um * CM_PER_UM;
    if depth > 0.0 { -(-depth).exp_m1() / depth } else { 1.0 }
}

/// Largest number of a model: beyond any quantity of a curve, and far from the end of single precision.
const LARGEST: f64 = 1e12;
/// Smallest width or height that counts as positive.
const SMALLEST: f64 = 1e-12;

fn positive(field: &str, value: f64) -> Result<(), CurveProblem> {
    within(field, value, SMALLEST, LARGEST)
}

fn not_negative(field: &str, value: f64) -> Result<(), CurveProblem> {
    within(field, value, 0.0, LARGEST)
}

fn within(field: &str, value: f64, low: f64, high: f64) -> Result<(), CurveProblem> {
    check_range(value, [low, high], "give a number in that range")
        .map_err(|message| (field.to_owned(), message))
}

/// Each wavelength must lie above the one before it.
fn check_rising(wavelength_nm: &[f64]) -> Result<(), CurveProblem> {
    match wavelength_nm.windows(2).position(|pair| pair[1] <= pair[0]) {
        None => Ok(()),
        Some(i) => Err((
            format!("wavelength_nm[{}]", i + 1),
            format!(
                "{} does not rise above {} before it; sort the table by wavelength and drop repeated ones",
                wavelength_nm[i + 1],
                wavelength_nm[i]
            ),
        )),
    }
}

fn check_table(wavelength_nm: &[f64], value: &[f64]) -> Result<(), CurveProblem> {
    if wavelength_nm.len() != value.len() {
        return Err((
            "value".to_owned(),
            format!(
                "{} values for {} wavelengths; give one value for each wavelength",
                value.len(),
                wavelength_nm.len()
            ),
        ));
    }
    if wavelength_nm.len() < 2 {
        return Err((
            "wavelength_nm".to_owned(),
            "a table needs two points or more; use type = \"constant\" for a single value".to_owned(),
        ));
    }
    for (i, (at, v)) in wavelength_nm.iter().zip(value).enumerate() {
        positive(&format!("wavelength_nm[{i}]"), *at)?;
        not_negative(&format!("value[{i}]"), *v)?;
    }
    check_rising(wavelength_nm)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn led() -> CurveModel {
        CurveModel::Led {
            peak_nm: 385.0,
            fwhm_short_nm: 10.0,
            fwhm_long_nm: 16.0,
            shape: 2.0,
            tails: vec![Tail { side: Side::Long, level: 0.05, decay_nm: 20.0 }],
        }
    }

    fn band_pass(optical_density: f64) -> CurveModel {
        CurveModel::Edges {
            peak: 0.95,
            optical_density,
            edges: vec![
                Edge { pass: Side::Long, cut_nm: 475.0, width_nm: 6.0 },
                Edge { pass: Side::Short, cut_nm: 700.0, width_nm: 12.0 },
            ],
            notches: vec![],
        }
    }

    fn tissue() -> BloodDiffuse {
        BloodDiffuse {
            scattering_per_cm: 22.46,
            scattering_power: 1.205,
            background_per_cm: 0.7,
            background_decay_nm: 180.0,
            blood_fraction: 0.08,
            saturation: 0.9,
            vessel_radius_um: 60.0,
            superficial_blood_um: 0.8,
            hemoglobin_g_per_l: 150.0,
            refractive_index: 1.4,
            melanin_depth: 0.0,
        }
    }

    fn close(got: f64, want: f64, tolerance: f64) {
        assert!((got - want).abs() <= tolerance, "{got} is not {want}");
    }

    fn problem(curve: &CurveModel) -> CurveProblem {
        match curve.validate() {
            Err(problem) => problem,
            Ok(()) => panic!("accepted {curve:?}"),
        }
    }

    #[test]
    fn led_peak_widths_and_tail() {
        let led = led();
        close(led.eval(385.0), 1.0, 1e-15);
        close(led.eval(380.0), 0.5, 1e-12);
        let tail_at_half = 0.05 * (-8.0f64 / 20.0).exp();
        close(led.eval(393.0), 0.5 + 0.5 * tail_at_half, 1e-12);
        close(led.eval(485.0), 0.05 * (-5.0f64).exp(), 1e-9);
        assert!(led.eval(350.0) < 1e-10, "no tail on the short side");
    }

    #[test]
    fn edges_cut_width_and_floor() {
        let filter = band_pass(5.0);
        close(filter.eval(475.0), 0.475, 1e-5);
        close(filter.eval(478.0) / 0.95, 0.9, 1e-4);
        close(filter.eval(472.0) / 0.95, 0.1, 1e-4);
        close(filter.eval(385.0), 1e-5, 1e-9);
        close(filter.eval(600.0), 0.95, 1e-6);
        close(filter.eval(700.0), 0.475, 1e-5);
    }

    #[test]
    fn notch_blocks_its_middle_and_halves_at_its_width() {
        let curve = CurveModel::Edges {
            peak: 1.0,
            optical_density: 4.0,
            edges: vec![],
            notches: vec![Notch { center_nm: 590.0, fwhm_nm: 20.0 }],
        };
        close(curve.eval(590.0), 1e-4, 1e-12);
        close(curve.eval(580.0), 0.5, 1e-4);
        close(curve.eval(560.0), 1.0, 1e-9);
    }

    #[test]
    fn bands_have_two_widths() {
        let curve = CurveModel::Bands {
            base: 0.1,
            bands: vec![Band { peak_nm: 550.0, fwhm_short_nm: 40.0, fwhm_long_nm: 100.0, weight: 0.6 }],
        };
        close(curve.eval(550.0), 0.7, 1e-12);
        close(curve.eval(530.0), 0.4, 1e-12);
        close(curve.eval(600.0), 0.4, 1e-12);
    }

    #[test]
    fn sigmoids_step_up_and_never_below_zero() {
        let step = |height| CurveModel::Sigmoids {
            base: 0.2,
            steps: vec![Step { center_nm: 500.0, width_nm: 20.0, height }],
        };
        close(step(0.4).eval(500.0), 0.4, 1e-12);
        close(step(0.4).eval(510.0), 0.2 + 0.4 * 0.9, 1e-12);
        close(step(-0.4).eval(700.0), 0.0, 0.0);
    }

    #[test]
    fn logistic_scale_is_that_of_the_10_90_width() {
        close(LOGISTIC_SCALE_PER_WIDTH, 0.5 / 9f64.ln(), 1e-15);
    }

    #[test]
    fn table_is_linear_inside_and_zero_outside() {
        let curve =
            CurveModel::Table { wavelength_nm: vec![400.0, 500.0, 600.0], value: vec![1.0, 2.0, 0.5] };
        for (at, want) in [(399.9, 0.0), (400.0, 1.0), (450.0, 1.5), (500.0, 2.0), (600.0, 0.5), (600.1, 0.0)]
        {
            close(curve.eval(at), want, 1e-12);
        }
    }

    #[test]
    fn blackbody_is_one_at_its_reference_and_peaks_by_wien() {
        let curve = CurveModel::Blackbody { temperature_k: 5000.0, reference_nm: 560.0 };
        close(curve.eval(560.0), 1.0, 1e-12);
        let peak = 2.897_771_955e6 / 5000.0;
        assert!(curve.eval(peak) > curve.eval(peak - 2.0));
        assert!(curve.eval(peak) > curve.eval(peak + 2.0));
        // CIE standard illuminant A is a radiator of 2855.5 K with c2 = 1.4388e7 nm K: 9.80 at 380 nm, 100 at 560
        let a = CurveModel::Blackbody { temperature_k: 2855.5, reference_nm: 560.0 };
        close(a.eval(380.0), 0.0980, 2e-4);
        assert!(a.eval(1e-3) >= 0.0 && a.eval(1e-3).is_finite());
    }

    #[test]
    fn bloodless_tissue_without_absorption_is_white() {
        let white = BloodDiffuse {
            background_per_cm: 0.0,
            blood_fraction: 0.0,
            superficial_blood_um: 0.0,
            ..tissue()
        };
        close(white.reflectance(550.0), 1.0, 1e-12);
    }

    #[test]
    fn tissue_shows_the_bands_of_oxygenated_blood() {
        let r = |nm| tissue().reflectance(nm);
        assert!(r(416.0) < r(385.0) && r(416.0) < r(460.0));
        assert!(r(542.0) < r(560.0) && r(576.0) < r(560.0));
        assert!(r(650.0) > 2.0 * r(576.0));
        let bloodier = BloodDiffuse { blood_fraction: 0.16, ..tissue() };
        assert!(bloodier.reflectance(550.0) < r(550.0));
        let darker = BloodDiffuse { melanin_depth: 0.5, ..tissue() };
        close(darker.reflectance(500.0), r(500.0) * (-0.5f64).exp(), 1e-12);
    }

    #[test]
    fn packaging_lies_between_its_limits() {
        close(packaging(100.0, 0.0), 1.0, 0.0);
        close(packaging(1e-9, 10.0), 1.0, 1e-9);
        // 2 mua r = 2
        close(packaging(1000.0, 10.0), (1.0 - (-2.0f64).exp()) / 2.0, 1e-12);
    }

    #[test]
    fn accepted_curves_are_finite_and_not_negative_everywhere() {
        let curves = [
            led(),
            band_pass(5.0),
            CurveModel::BloodDiffuse(tissue()),
            CurveModel::Blackbody { temperature_k: 300.0, reference_nm: 100.0 },
        ];
        for curve in &curves {
            assert!(curve.validate().is_ok(), "{curve:?}");
            for nm in [f64::NAN, f64::INFINITY, -5.0, 0.0, 1e-3, 1.0, 200.0, 385.0, 750.0, 1e5] {
                let value = curve.eval(nm);
                assert!(value.is_finite() && value >= 0.0, "{curve:?} at {nm}: {value}");
            }
        }
    }

    #[test]
    fn rejections_name_the_field() {
        let mut curve = led();
        if let CurveModel::Led { tails, .. } = &mut curve {
            tails[0].decay_nm = 0.0;
        }
        let (field, message) = problem(&curve);
        assert_eq!(field, "tails[0].decay_nm");
        assert!(message.contains("outside 1e-12 to 1e12"), "{message}");

        assert_eq!(problem(&CurveModel::Constant { value: f64::NAN }).0, "value");
        assert_eq!(problem(&CurveModel::Constant { value: -0.1 }).0, "value");
        assert_eq!(problem(&band_pass(-1.0)).0, "optical_density");
        assert_eq!(problem(&band_pass(0.01)).0, "peak");
        let (field, message) =
            problem(&CurveModel::Table { wavelength_nm: vec![400.0, 400.0], value: vec![1.0, 1.0] });
        assert_eq!(field, "wavelength_nm[1]");
        assert!(message.contains("sort"), "{message}");
        assert_eq!(
            problem(&CurveModel::Table { wavelength_nm: vec![400.0, 500.0], value: vec![1.0] }).0,
            "value"
        );
        let bad = BloodDiffuse { saturation: 1.2, ..tissue() };
        assert_eq!(problem(&CurveModel::BloodDiffuse(bad)).0, "saturation");
    }
}
