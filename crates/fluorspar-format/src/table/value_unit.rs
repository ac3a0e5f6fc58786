//! Units of the values of spectra as tables name them, and what the values are in the quantity that is asked for.

/// Wavelength of a photon of 1 eV, nm: a responsivity of R A/W at λ nm is R · 1239.84 / λ electrons per photon.
const NM_OF_ONE_EV: f64 = 1_239.841_984;

/// What spectra are read for: their values are converted to it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SpectrumQuantity {
    /// Whatever the file holds, as stored.
    #[default]
    Stored,
    /// Transmittance or reflectance, 0 to 1.
    Fraction,
    /// Transmittance, 0 to 1.
    Transmittance,
    /// Power per nm, of any scale.
    SpectralPower,
    /// Electrons per photon.
    QuantumEfficiency,
    /// Power on or from an area per nm: W/(m² nm) or W/(sr m² nm).
    AbsolutePower,
    /// Coefficients, 1/mm.
    Coefficient,
}

impl SpectrumQuantity {
    pub(crate) fn is_fraction(self) -> bool {
        matches!(self, Self::Fraction | Self::Transmittance)
    }

    /// What values of a column with this header are multiplied by, where they are absolute; otherwise `None`.
    ///
    /// # Errors
    /// The unit, where it is none of this quantity.
    pub(crate) fn absolute_factor(self, header: &str) -> Result<Option<f64>, String> {
        let stated = stated_unit(header);
        let factor = match self {
            Self::AbsolutePower => match stated {
                StatedUnit::Unstated => (!is_relative(header)).then_some(1.0),
                StatedUnit::Known(ValueUnit::Energy) => power_factor(header),
                _ => None,
            },
            Self::Coefficient => coefficient_factor(header, &stated),
            _ => return Ok(None),
        };
        factor.map(Some).ok_or_else(|| match stated {
            StatedUnit::Known(unit) => unit.in_words(Self::Stored).unwrap_or("fractions").to_owned(),
            StatedUnit::Unknown(unit) => unit,
            StatedUnit::Unstated => header.to_owned(),
        })
    }

    /// The unit that absolute values become.
    pub(crate) fn absolute_unit(self) -> &'static str {
        if self == Self::Coefficient { "1/mm to base e" } else { "W/(m² nm), of radiance W/(sr m² nm)" }
    }
}

/// Lengths in mm.
const LENGTHS_MM: [(&str, f64); 12] = [
    ("mm", 1.0),
    ("millimeter", 1.0),
    ("millimetre", 1.0),
    ("cm", 10.0),
    ("centimeter", 10.0),
    ("centimetre", 10.0),
    ("m", 1000.0),
    ("meter", 1000.0),
    ("metre", 1000.0),
    ("µm", 1e-3),
    ("μm", 1e-3),
    ("um", 1e-3),
];
/// Words for logarithms to base 10.
const DECADIC: [&str; 9] = ["absorbance", "abs", "od", "db", "decadic", "decimal", "log", "log10", "lg"];

/// What coefficients in the unit of a header are multiplied by to be in 1/mm; `None` of other quantities.
fn coefficient_factor(header: &str, stated: &StatedUnit) -> Option<f64> {
    let lower = &*header.to_lowercase();
    let words: Vec<&str> =
        lower.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).collect();
    // "Abs. coefficient" is of absorption
    let is_decadic = |word: &&str| DECADIC.contains(word) && !(*word == "abs" && lower.contains("coef"));
    let is_natural = words.iter().any(|word| ["natural", "nat", "ln"].contains(word))
        || words.windows(2).any(|pair| ["log", "base"].contains(&pair[0]) && pair[1] == "e");
    let of_amounts = ["mol", "/g", "/mg", "g-1"].iter().any(|unit| with_signs(lower).contains(unit));
    if is_relative(lower) || of_amounts || is_multiplied(lower) || !is_natural && words.iter().any(is_decadic)
    {
        return None;
    }
    // The length of a cuvette has a number: "absorption at 1 cm"
    let is_length = |word: &str| {
        word.starts_with(char::is_alphabetic) && (word.ends_with("cm") || word.starts_with("centimet"))
    };
    let names_length = |pair: &[&str]| is_length(pair[1]) && pair[0].parse::<f64>().is_err();
    match lengths_of(lower)[..] {
        // A is an absorbance, a may be natural
        [_] if header.starts_with('A') && words[0] == "a" && !is_natural => None,
        [mm] => Some(1.0 / mm),
        [] if words.first().is_some_and(|word| is_length(word)) || words.windows(2).any(names_length) => None,
        [] => bracketed(lower)
            .map_or(*stated == StatedUnit::Unstated, |unit| NO_UNIT.contains(&unit))
            .then_some(1.0),
        _ => None,
    }
}

/// Whether a header in lower case multiplies its unit: "[10^3 1/cm]", "1/mm x1000".
fn is_multiplied(lower: &str) -> bool {
    let parted = |c: char| c.is_whitespace() || "[](),;/·".contains(c);
    let unit = bracketed(lower).filter(|unit| !lengths_of(unit).is_empty());
    let first = unit.and_then(|unit| unit.split(parted).next()).unwrap_or_default();
    (first != "1" && first.starts_with(|c: char| c.is_ascii_digit()))
        || lower.split(parted).skip(1).any(is_times)
}

/// Whether a word is a factor: "x1000", "10^3".
fn is_times(word: &str) -> bool {
    word.strip_prefix(['x', '×', '*']).is_some_and(|of| of.parse::<f64>().is_ok())
        || word.strip_prefix("10").is_some_and(|of| of.starts_with(['^', '*', '⁻', '²', '³', '⁴', '⁵', '⁶']))
}

/// A text with one spelling of exponents.
fn with_signs(lower: &str) -> String {
    let plain = lower.replace(['^', '{', '}', '\u{b7}'], "").replace("⁻¹", "-1");
    plain.replace(['\u{2212}', '\u{2013}'], "-").replace('_', " ").replace(" -1", "-1")
}

/// Lengths that a text in lower case names as those that something is per, in mm: `1/cm`, `per_cm`, `cm^-1`.
pub(crate) fn lengths_of(lower: &str) -> Vec<f64> {
    let plain = with_signs(lower).replace(" / ", "/").replace("/ ", "/");
    let ends = |text: &str| !text.starts_with(char::is_alphanumeric);
    let is_per = |(place, _): (usize, &str), length: &str| {
        let (before, behind) = (&plain[..place], &plain[place + length.len()..]);
        let is_in_front = before.ends_with('/') || before.ends_with("per ");
        // "M-1cm-1"
        let is_behind =
            behind.strip_prefix("-1").is_some_and(|rest| !rest.starts_with(|c: char| c.is_ascii_digit()));
        let begins = !before.ends_with(char::is_alphanumeric) || before.ends_with("-1");
        let is_word = begins && (ends(behind) || is_behind);
        is_word && (is_in_front || is_behind)
    };
    let mut found = LENGTHS_MM.to_vec();
    found.retain(|(length, _)| plain.match_indices(length).any(|place| is_per(place, length)));
    found.into_iter().map(|(_, mm)| mm).collect()
}

/// What powers in the unit of a header are multiplied by to be in W/(m² nm); `None` of energies.
fn power_factor(header: &str) -> Option<f64> {
    let whole = header.to_lowercase();
    let lower = bracketed(&whole).filter(|unit| unit.contains('w')).unwrap_or(&whole);
    let words: Vec<&str> = lower
        .split(|c: char| !(c.is_alphabetic() || "µμ".contains(c)))
        .filter(|word| !word.is_empty())
        .collect();
    let is_energy = |word: &&str| ["j", "mj", "uj", "µj", "μj", "joule", "joules"].contains(word);
    if words.iter().any(is_energy) {
        return None;
    }
    let of_power = |word: &&str| POWERS_W.iter().find(|(name, _)| name == word).map(|(_, watts)| *watts);
    let Some(place) = words.iter().position(|word| of_power(word).is_some()) else { return Some(1.0) };
    // A factor before the unit: "10^-3 W/m2", "x1000 (W/m2)"
    let before = lower.find(words[place]).map_or("", |at| lower[..at].trim_end_matches([' ', '*', '·', '×']));
    if before.ends_with(|c: char| c.is_ascii_digit()) || whole.split_whitespace().any(is_times) {
        return None;
    }
    // What stands behind it as far as these are units: "irradiance at 10 cm" says nothing of an area
    let per: Vec<&str> =
        words[place + 1..].iter().copied().take_while(|word| UNITS_BEHIND.contains(word)).collect();
    let has = |names: &[&str]| per.iter().any(|word| names.contains(word));
    let per_area = [(["cm", "sqcm"], 1e4), (["mm", "sqmm"], 1e6)];
    let area = per_area.into_iter().find(|(names, _)| has(names)).map_or(1.0, |(_, factor)| factor);
    let step = if has(&["µm", "μm", "um"]) { 1e-3 } else { 1.0 };
    Some(of_power(&words[place]).unwrap_or(1.0) * area * step)
}

/// Powers in W.
const POWERS_W: [(&str, f64); 12] = [
    ("w", 1.0),
    ("watt", 1.0),
    ("watts", 1.0),
    ("kw", 1e3),
    ("mw", 1e-3),
    ("mwatt", 1e-3),
    ("µw", 1e-6),
    ("μw", 1e-6),
    ("uw", 1e-6),
    ("µwatt", 1e-6),
    ("uwatt", 1e-6),
    ("nw", 1e-9),
];
/// What a power may be per.
const UNITS_BEHIND: [&str; 13] =
    ["per", "m", "cm", "mm", "sqm", "sqcm", "sqmm", "nm", "µm", "μm", "um", "sr", "steradian"];

/// Unit of the values of a spectrum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ValueUnit {
    /// Fractions of 1.
    Fraction,
    /// Percent.
    Percent,
    /// Optical density or absorbance: minus the decimal logarithm of what passes or returns.
    OpticalDensity,
    /// Decibels of what passes: 0 and below, or, of a loss, 0 and above.
    Decibel,
    /// Amperes per watt.
    AmperesPerWatt,
    /// Photons, moles of photons.
    Photons,
    /// Counts of a spectrometer whose response is not divided out. They are taken for photons.
    Counts,
    /// Energy or power.
    Energy,
}

impl ValueUnit {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Fraction,
        Self::Percent,
        Self::OpticalDensity,
        Self::Decibel,
        Self::AmperesPerWatt,
        Self::Photons,
        Self::Counts,
        Self::Energy,
    ];

    /// Its name in options and files of experiments.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Fraction => "fraction",
            Self::Percent => "percent",
            Self::OpticalDensity => "od",
            Self::Decibel => "db",
            Self::AmperesPerWatt => "a_per_w",
            Self::Photons => "photons",
            Self::Counts => "counts",
            Self::Energy => "energy",
        }
    }

    /// What is done with values in it, for the line that says how a file was read; `None` where nothing is.
    fn in_words(self, quantity: SpectrumQuantity) -> Option<&'static str> {
        Some(match self {
            Self::Fraction => return None,
            Self::Energy => "energy",
            Self::Percent => "percent",
            Self::OpticalDensity => "optical density",
            Self::Decibel => "decibels",
            Self::AmperesPerWatt => "amperes per watt",
            Self::Photons if quantity == SpectrumQuantity::SpectralPower => {
                "photons, weighted with 1 / wavelength"
            }
            Self::Photons => "photons",
            Self::Counts if quantity == SpectrumQuantity::SpectralPower => {
                "counts, taken for photons; the spectrometer's response is not divided out"
            }
            Self::Counts => "counts",
        })
    }
}

/// What a header says of the unit of values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum StatedUnit {
    /// Nothing, or that they are relative.
    Unstated,
    /// This one.
    Known(ValueUnit),
    /// Words in brackets that mean nothing here.
    Unknown(String),
}

/// Words in brackets that state no unit.
const NO_UNIT: [&str; 7] = ["dimensionless", "unitless", "0-1", "0..1", "0 to 1", "", "nm"];

/// Words in brackets for values of any scale.
const RELATIVE: [&str; 15] = [
    "a.u.",
    "a. u.",
    "au",
    "a.u",
    "arb",
    "arb.",
    "arb. units",
    "arb.u.",
    "arbitrary",
    "arbitrary units",
    "rel",
    "rel.",
    "relative",
    "normalized",
    "norm.",
];

/// Whether a header says that its values are of any scale.
pub(crate) fn is_relative(header: &str) -> bool {
    let lower = header.to_lowercase();
    let is_word = |word: &str| ["relative", "rel", "normalized", "normalised", "norm"].contains(&word);
    bracketed(&lower).is_some_and(|unit| RELATIVE.contains(&unit))
        || lower.split(|c: char| !c.is_alphanumeric()).any(is_word)
}

/// Spellings of amperes per watt.
const RESPONSIVITY: [&str; 8] = ["a/w", "a / w", "a w-1", "a w^-1", "a w⁻¹", "a·w-1", "a·w^-1", "a·w⁻¹"];

/// The factor of the prefix with which a text names a unit: 1e-3 of `mA/W`; `None` where it doesn't.
fn prefix(lower: &str, unit: &str) -> Option<f64> {
    lower.match_indices(unit).find_map(|(place, _)| {
        let is_longer = lower[place + unit.len()..].starts_with(char::is_alphanumeric);
        match lower[..place].rsplit(|c: char| !c.is_alphanumeric()).next()? {
            _ if is_longer => None,
            "" => Some(1.0),
            "m" => Some(1e-3),
            "µ" | "μ" | "u" => Some(1e-6),
            _ => None,
        }
    })
}

/// What the values of a column with this header are multiplied by to be in the unit that [`stated_unit`] finds.
pub(crate) fn factor_of(header: &str) -> f64 {
    let lower = header.to_lowercase();
    let factor =
        |units: &[&str]| units.iter().find_map(|unit| prefix(&lower, unit)).filter(|factor| *factor != 1.0);
    factor(&RESPONSIVITY).or_else(|| factor(&["od", "au", "abs", "absorbance"])).unwrap_or(1.0)
}

/// The unit that a text names: a header, or a line about the units of a file. What stands in brackets at its end says it better than the name of a
/// sample before.
pub(crate) fn stated_unit(text: &str) -> StatedUnit {
    let lower = text.to_lowercase().replace("w.length", "wavelength");
    match bracketed(&lower).map(unit_in) {
        Some(StatedUnit::Known(unit)) => StatedUnit::Known(unit),
        _ => unit_in(&lower),
    }
}

fn unit_in(lower: &str) -> StatedUnit {
    let words: Vec<&str> = lower
        .split(|c: char| !(c.is_alphanumeric() || c == 'µ' || c == 'μ'))
        .filter(|w| !w.is_empty())
        .collect();
    let has = |names: &[&str]| words.iter().any(|word| names.contains(word));
    let starts = |names: &[&str]| words.iter().any(|word| names.iter().any(|name| word.starts_with(name)));
    let known = StatedUnit::Known;
    // A power over 1 mW, and logarithms: neither values nor an attenuation
    let logarithm = words.iter().find(|word| ["dbm", "dbw", "log", "log10", "lg", "ln"].contains(*word));
    if let Some(logarithm) = logarithm {
        return StatedUnit::Unknown((*logarithm).to_owned());
    }
    // Of an energy or a wave number, which falls where the wavelength rises
    const OTHER_STEPS: [&str; 7] = ["/ev", " ev-1", " ev^-1", "per ev", "/cm-1", "/cm^-1", "(cm-1)-1"];
    if let Some(step) = OTHER_STEPS.iter().find(|step| lower.contains(**step)) {
        return StatedUnit::Unknown(format!("{} of {}", lower.trim(), step.trim()));
    }
    let percents = ["percent", "prozent", "procent", "pourcent", "porcent"];
    // The concentration in the name of a sample, "Intralipid 1%", is no unit
    let is_percent = lower.match_indices('%').any(|(at, _)| {
        let before = lower[..at].trim_end();
        !(before.ends_with(|c: char| c.is_ascii_digit()) && before.starts_with(char::is_alphabetic))
    });
    let is_per_cent = words.windows(2).any(|pair| pair == ["per", "cent"]);
    if is_percent || is_per_cent || starts(&percents) || has(&["pct"]) {
        return known(ValueUnit::Percent);
    }
    if RESPONSIVITY.iter().any(|unit| prefix(lower, unit).is_some()) || starts(&["ampere"]) {
        return known(ValueUnit::AmperesPerWatt);
    }
    if starts(&["efficiency"])
        || has(&["qe", "eqe", "iqe"])
        || lower.contains("/photon")
        || lower.contains("per photon")
    {
        return StatedUnit::Unstated;
    }
    if has(&["db", "decibel", "decibels"]) {
        return known(ValueUnit::Decibel);
    }
    if starts(&["photon", "quanta", "µmol", "μmol", "umol", "mmol", "einstein"])
        || has(&["mol", "pfd", "ppfd", "ypfd", "qntm", "quantum"])
    {
        return known(ValueUnit::Photons);
    }
    let is_energy = starts(&["irradi", "radian", "watt", "µwatt", "µw", "μw", "uw", "mwatt"])
        || has(&["w", "mw", "nw", "power", "j", "mj", "uj", "µj", "joule", "joules", "energy"]);
    if is_energy {
        return known(ValueUnit::Energy);
    }
    let joined = words.concat();
    let is_density =
        ["opticaldensity", "optdensity", "optischedichte"].iter().any(|name| joined.contains(name));
    // "OD6", "ODavg"
    let is_od = |rest: &str| rest.parse::<f64>().is_ok() || ["avg", "mean", "min", "max"].contains(&rest);
    if is_density
        || starts(&["absorban", "extinktion"])
        || has(&["od", "abs", "mod", "mau", "mabs"])
        || (words.len() == 1 && joined.strip_prefix("od").is_some_and(is_od))
    {
        return known(ValueUnit::OpticalDensity);
    }
    if starts(&["count"]) || has(&["adc", "dn", "scope", "cps"]) {
        return known(ValueUnit::Counts);
    }
    if has(&["fraction", "fractions"]) {
        return known(ValueUnit::Fraction);
    }
    match bracketed(lower) {
        Some(unit) if NO_UNIT.contains(&unit) || RELATIVE.contains(&unit) => StatedUnit::Unstated,
        Some(unit) if unit.parse::<f64>().is_err() && unit != "-" => StatedUnit::Unknown(unit.to_owned()),
        _ => StatedUnit::Unstated,
    }
}

/// What stands in the last brackets of a text.
fn bracketed(text: &str) -> Option<&str> {
    let (open, close) = if text.trim_end().ends_with(']') { ('[', ']') } else { ('(', ')') };
    let inside = text.trim_end().strip_suffix(close)?.trim_end_matches(close);
    inside.rfind(open).map(|place| inside[place + 1..].trim())
}

/// How values in a unit become a quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Conversion {
    unit: ValueUnit,
    quantity: SpectrumQuantity,
    /// Decibels of a loss, which count up.
    is_loss: bool,
}

impl Conversion {
    /// From a unit to a quantity; `loss` where decibels count what is lost.
    ///
    /// # Errors
    /// Values that can't be it, in words.
    pub(crate) fn new(unit: ValueUnit, quantity: SpectrumQuantity, is_loss: bool) -> Result<Self, String> {
        let fits = match (quantity, unit) {
            (SpectrumQuantity::Stored, _) | (_, ValueUnit::Percent | ValueUnit::Fraction) => true,
            (SpectrumQuantity::AbsolutePower | SpectrumQuantity::Coefficient, _) => true,
            (SpectrumQuantity::Fraction | SpectrumQuantity::Transmittance, unit) => {
                matches!(unit, ValueUnit::OpticalDensity | ValueUnit::Decibel)
            }
            (SpectrumQuantity::SpectralPower, unit) => {
                matches!(unit, ValueUnit::Photons | ValueUnit::Counts | ValueUnit::Energy)
            }
            (SpectrumQuantity::QuantumEfficiency, unit) => unit == ValueUnit::AmperesPerWatt,
        };
        let wanted = match quantity {
            SpectrumQuantity::Stored | SpectrumQuantity::AbsolutePower | SpectrumQuantity::Coefficient => {
                "any"
            }
            SpectrumQuantity::Fraction => "a transmittance or reflectance",
            SpectrumQuantity::Transmittance => "a transmittance",
            SpectrumQuantity::SpectralPower => "the spectrum of a light",
            SpectrumQuantity::QuantumEfficiency => "a quantum efficiency",
        };
        match fits {
            true => Ok(Self { unit, quantity, is_loss }),
            false => Err(format!(
                "its values are {}, not {wanted}",
                unit.in_words(SpectrumQuantity::Stored).unwrap_or("fractions")
            )),
        }
    }

    /// A value at a wavelength, nm.
    pub(crate) fn of(self, nm: f64, value: f64) -> f64 {
        if self.quantity == SpectrumQuantity::Stored {
            return value;
        }
        match self.unit {
            ValueUnit::Fraction | ValueUnit::Energy => value,
            ValueUnit::Percent => 0.01 * value,
            ValueUnit::OpticalDensity => 10_f64.powf(-value),
            ValueUnit::Decibel if self.is_loss => 10_f64.powf(-0.1 * value),
            ValueUnit::Decibel => 10_f64.powf(0.1 * value),
            ValueUnit::AmperesPerWatt => value * NM_OF_ONE_EV / nm,
            ValueUnit::Photons | ValueUnit::Counts => value / nm,
        }
    }

    /// A standard error of a value at a wavelength, nm.
    pub(crate) fn of_error(self, nm: f64, value: f64, error: f64) -> f64 {
        match self.unit {
            _ if self.quantity == SpectrumQuantity::Stored => error,
            ValueUnit::OpticalDensity => std::f64::consts::LN_10 * self.of(nm, value) * error,
            ValueUnit::Decibel => 0.1 * std::f64::consts::LN_10 * self.of(nm, value) * error,
            _ => self.of(nm, error),
        }
    }

    /// What is said of it; `None` where values stay as they are.
    pub(crate) fn in_words(self) -> Option<&'static str> {
        match self.quantity {
            SpectrumQuantity::Stored => None,
            _ => self.unit.in_words(self.quantity).filter(|_| self.unit != ValueUnit::Energy),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absolute_values_are_in_one_unit_or_refused() {
        use SpectrumQuantity::{AbsolutePower, Coefficient};
        for (quantity, header, factor) in [
            (AbsolutePower, "irradiance", 1.0),
            (AbsolutePower, "W/(m2 nm)", 1.0),
            (AbsolutePower, "irradiance (µW/cm²/nm)", 1e-2),
            (AbsolutePower, "irradiance (mW/m2/nm)", 1e-3),
            (AbsolutePower, "radiance (W m-2 sr-1 um-1)", 1e-3),
            (AbsolutePower, "E [W/cm^2/nm]", 1e4),
            (AbsolutePower, "irradiance at 10 cm (mW/m2/nm)", 1e-3),
            (AbsolutePower, "irradiance in W/m2/nm at 5 mm", 1.0),
            (AbsolutePower, "energy", 1.0),
            (Coefficient, "mua", 1.0),
            (Coefficient, "mua (1/mm)", 1.0),
            (Coefficient, "mua (cm-1)", 0.1),
            (Coefficient, "absorption [1/m]", 1e-3),
            (Coefficient, "absorption_per_cm", 0.1),
            (Coefficient, "mu_a_cm-1", 0.1),
            (Coefficient, "mua cm^-1", 0.1),
            (Coefficient, "mu_a (1 / cm)", 0.1),
            (Coefficient, "mu_a (1/cm, at 1 mM)", 0.1),
            (Coefficient, "# unit: 1/cm", 0.1),
            (Coefficient, "absorption_per_mm", 1.0),
            (Coefficient, "absorption at 5 mm", 1.0),
            (Coefficient, "absorption in 1 cm cuvettes", 1.0),
            (Coefficient, "mua per centimeter", 0.1),
            (Coefficient, "mua 1/centimeter", 0.1),
            (Coefficient, "mua cm\u{2212}1", 0.1),
            (Coefficient, "absorption cm\u{2013}1", 0.1),
            (Coefficient, "ua [cm^-1]", 0.1),
            (Coefficient, "Abs. coefficient (1/cm)", 0.1),
            (Coefficient, "absorption coeff. a (log e) cm-1", 0.1),
            (Coefficient, "natural log absorption (1/cm)", 0.1),
            (Coefficient, "A_nat (1/cm)", 0.1),
            (Coefficient, "mua, 10 mg/ml (1/cm)", 0.1),
            (Coefficient, "a", 1.0),
            (Coefficient, "mua_mm", 1.0),
        ] {
            let found = quantity.absolute_factor(header).unwrap().unwrap();
            assert!((found / factor - 1.0).abs() < 1e-12, "{header}: {found}");
        }
        for (quantity, header) in [
            (AbsolutePower, "photon flux (µmol m-2 s-1 nm-1)"),
            (AbsolutePower, "counts"),
            (AbsolutePower, "T (%)"),
            (AbsolutePower, "dose (mJ/cm2)"),
            (AbsolutePower, "L (a.u.)"),
            (AbsolutePower, "radiance (10^-3 W/(sr m2 nm))"),
            (AbsolutePower, "radiance x1000 (W/(sr m2 nm))"),
            (Coefficient, "mua (a.u.)"),
            (Coefficient, "molar_extinction_per_cm_per_M"),
            (Coefficient, "epsilon (M-1 cm-1)"),
            (Coefficient, "absorbance"),
            (Coefficient, "epsilon (1/(mol cm))"),
            (Coefficient, "epsilon M-1cm-1"),
            (Coefficient, "extinction cm-1M-1"),
            (Coefficient, "extinction L g-1 cm-1"),
            (Coefficient, "absorption (dB/cm)"),
            (Coefficient, "absorption OD/cm"),
            (Coefficient, "absorbance (1/cm)"),
            (Coefficient, "A (1/cm)"),
            (Coefficient, "decadic (1/cm)"),
            (Coefficient, "a (log10) 1/cm"),
            (Coefficient, "mua [10^3 1/cm]"),
            (Coefficient, "mua (1000/cm)"),
            (Coefficient, "mua (x10 1/cm)"),
            (Coefficient, "mua 1/mm x1000"),
            (Coefficient, "ODcm-1"),
            (Coefficient, "mua_cm"),
        ] {
            assert!(quantity.absolute_factor(header).is_err(), "{header}");
        }
        assert_eq!(SpectrumQuantity::Fraction.absolute_factor("T (%)"), Ok(None));
    }

    #[test]
    fn units_are_read_from_words() {
        use ValueUnit::*;
        for (text, unit) in [
            ("Transmittance(%)", Percent),
            ("Transmission [percent]", Percent),
            ("absorbance", OpticalDensity),
            ("OD", OpticalDensity),
            ("optical_density", OpticalDensity),
            ("Opt. Density", OpticalDensity),
            ("Extinktion", OpticalDensity),
            ("OD6", OpticalDensity),
            ("ODavg", OpticalDensity),
            ("IL (dB)", Decibel),
            ("R (A/W)", AmperesPerWatt),
            ("PFD(umol m-2 s-1)", Photons),
            ("photon flux (umol m-2 s-1 nm-1)", Photons),
            ("Abs. irradiance [µW/cm²/nm]", Energy),
            ("Intensity [counts]", Counts),
            ("filter 50% (Abs)", OpticalDensity),
            ("S (mA/W)", AmperesPerWatt),
            ("Responsivity / A W-1", AmperesPerWatt),
        ] {
            assert_eq!(stated_unit(text), StatedUnit::Known(unit), "{text}");
        }
        for text in [
            "T (0-1)",
            "data/wavelength",
            "R",
            "Intensity (a.u.)",
            "red",
            "QE (e-/photon)",
            "quantum efficiency",
            "transmittance",
        ] {
            assert_eq!(stated_unit(text), StatedUnit::Unstated, "{text}");
        }
        for (text, unit) in
            [("flux (erg)", "erg"), ("Power (dBm)", "dbm"), ("log10(T)", "log10"), ("T [perc]", "perc")]
        {
            assert_eq!(stated_unit(text), StatedUnit::Unknown(unit.into()));
        }
        assert_eq!([factor_of("S (mA/W)"), factor_of("mOD"), factor_of("A/W")], [1e-3, 1e-3, 1.0]);
    }

    #[test]
    fn conversions_follow_their_definitions() {
        let of = |unit, quantity, nm, value| Conversion::new(unit, quantity, false).unwrap().of(nm, value);
        assert_eq!(of(ValueUnit::OpticalDensity, SpectrumQuantity::Fraction, 500.0, 2.0), 0.01);
        assert_eq!(of(ValueUnit::Decibel, SpectrumQuantity::Fraction, 500.0, -20.0), 0.01);
        // 0.27 A/W at 610 nm
        let qe = of(ValueUnit::AmperesPerWatt, SpectrumQuantity::QuantumEfficiency, 610.0, 0.27);
        assert!((qe - 0.548_8).abs() < 1e-4, "{qe}");
        // As many photons at 400 as at 800 nm have twice the energy
        let energy = |nm| of(ValueUnit::Photons, SpectrumQuantity::SpectralPower, nm, 1.0);
        assert_eq!(energy(400.0) / energy(800.0), 2.0);
        assert!(Conversion::new(ValueUnit::OpticalDensity, SpectrumQuantity::SpectralPower, false).is_err());
    }
}
