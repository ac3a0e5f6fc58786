//! Hazards: effective quantity, limit, margin, exposures per day.

use serde::Serialize;

use super::illumination::{blue_light_field_rad, thermal_field_rad};
use super::{ActionSpectrum, Illumination};

/// A hazard to eye or skin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Hazard {
    /// Actinic ultraviolet on eye or skin: `E_s t <= 30 J/m²` in 8 hours.
    ActinicUv,
    /// Near ultraviolet on the eye: `E_UVA t <= 1e4 J/m²` up to 1000 s, then `E_UVA <= 10 W/m²`.
    NearUv,
    /// Photochemical damage of the retina: `L_B t <= 1e6 J/(m² sr)` up to 1e4 s, then `L_B <= 100 W/(m² sr)`.
    BlueLight,
    /// The same for sources under 11 mrad: `E_B t <= 100 J/m²` up to 100 s, then `E_B <= 1 W/m²`.
    BlueLightSmallSource,
    /// Burns of the retina: `L_R <= 5e4 / (alpha t^0.25) W/(m² sr)`, 10 µs to 10 s.
    RetinalThermal,
    /// Burns of the retina by light that is hardly seen: `L_IR <= 6000 / alpha W/(m² sr)`, beyond 10 s.
    RetinalThermalWeakStimulus,
    /// Infrared on cornea and lens: `E_IR <= 18000 t^-0.75 W/m²` up to 1000 s, then 100 W/m².
    InfraredEye,
    /// Burns of the skin: `E t <= 2e4 t^0.25 J/m²` up to 10 s.
    SkinThermal,
}

/// Exposed tissue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ExposedTissue {
    /// An eye that looks into the light.
    Eye(RetinalObserver),
    /// Skin, its limits divided by a factor: 1 for skin, more for mucosa.
    Skin {
        /// By what the limits are divided.
        safety_factor: f64,
    },
}

/// Observer whose retina is exposed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RetinalObserver {
    /// An eye with its lens.
    Normal,
    /// An eye without its lens, or an infant's: `A(lambda)` in place of `B(lambda)`.
    Aphakic,
}

/// One hazard of one exposure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Assessment {
    /// The hazard.
    pub hazard: Hazard,
    /// Symbol of the quantity, for instance "E_UVA t".
    pub quantity: &'static str,
    /// Its value.
    pub value: f64,
    /// Its limit for this exposure.
    pub limit: f64,
    /// Unit of both.
    pub unit: &'static str,
    /// Limit over value; null where nothing of the light counts.
    pub margin: Option<f64>,
    /// Seconds of this light in 8 hours that the limit allows; null where there is no such budget: burns happen or do not
    /// in each exposure.
    pub daily_seconds: Option<f64>,
    /// Equal exposures in 8 hours that the limit allows; null as above.
    pub exposures_per_day: Option<u64>,
}

/// A day of work, 8 hours, over which doses are counted, s (IEC 62471:2006, 4.3).
pub const DAY_S: f64 = 8.0 * 3600.0;
/// What is smaller as a whole is a small source, rad.
const SMALL_SUBTENSE_RAD: f64 = 0.011;
/// Luminance below which a source is not a strong visual stimulus is 10 cd/m²; this share of the radiant power below 780 nm
/// stands for it.
const WEAK_STIMULUS_SHARE: f64 = 1e-3;

/// Assesses every hazard of one exposure of `duration_s` to a light.
///
/// Sources: IEC 62471:2006, 4.3.1 to 4.3.8. Durations beyond 8 hours count as 8 hours; thermal limits, which end at 10 s,
/// hold on.
pub fn assess(light: &Illumination, duration_s: f64, target: ExposedTissue) -> Vec<Assessment> {
    let duration_s = duration_s.min(DAY_S);
    match target {
        ExposedTissue::Eye(observer) => {
            let mut list = vec![
                dose(
                    Hazard::ActinicUv,
                    "E_s t",
                    light.irradiance(ActionSpectrum::ActinicUv),
                    duration_s,
                    30.0,
                    "J/m²",
                ),
                dose(
                    Hazard::NearUv,
                    "E_UVA t",
                    light.irradiance(ActionSpectrum::UvA),
                    duration_s,
                    1e4,
                    "J/m²",
                ),
            ];
            list.extend(retina(light, duration_s, observer));
            let infrared = light.irradiance(ActionSpectrum::InfraredEye);
            let limit = if duration_s <= 1000.0 { 18_000.0 * duration_s.powf(-0.75) } else { 100.0 };
            list.push(rate(Hazard::InfraredEye, "E_IR", infrared, limit, "W/m²"));
            list
        }
        ExposedTissue::Skin { safety_factor } => {
            let actinic = light.irradiance(ActionSpectrum::ActinicUv);
            let all = light.irradiance(ActionSpectrum::SkinThermal);
            let thermal_j_per_m2 = 2e4 * duration_s.min(10.0).powf(0.25) / safety_factor;
            vec![
                dose(Hazard::ActinicUv, "E_s t", actinic, duration_s, 30.0 / safety_factor, "J/m²"),
                rate(Hazard::SkinThermal, "E t", all * duration_s.min(10.0), thermal_j_per_m2, "J/m²"),
            ]
        }
    }
}

fn retina(light: &Illumination, duration_s: f64, observer: RetinalObserver) -> Vec<Assessment> {
    let weight = match observer {
        RetinalObserver::Normal => ActionSpectrum::BlueLight,
        RetinalObserver::Aphakic => ActionSpectrum::AphakicBlueLight,
    };
    let radiance = light.averaged_radiance(weight, blue_light_field_rad(duration_s));
    let mut list = vec![dose(Hazard::BlueLight, "L_B t", radiance, duration_s, 1e6, "J/(m² sr)")];
    if light.extent_rad() < SMALL_SUBTENSE_RAD {
        let irradiance = light.irradiance(weight);
        list.push(dose(Hazard::BlueLightSmallSource, "E_B t", irradiance, duration_s, 100.0, "J/m²"));
    }
    list.extend(retina_thermal(light, duration_s));
    list
}

/// The retina as it is heated, by light that is seen and by infrared without it.
fn retina_thermal(light: &Illumination, duration_s: f64) -> Vec<Assessment> {
    let field = thermal_field_rad(duration_s);
    let (thermal, alpha) = light.hottest(ActionSpectrum::RetinalThermal, field);
    let limit = 5e4 / (alpha * duration_s.clamp(1e-5, 10.0).powf(0.25));
    let mut list = vec![rate(Hazard::RetinalThermal, "L_R", thermal, limit, "W/(m² sr)")];
    let infrared = light.irradiance(ActionSpectrum::RetinalInfrared);
    let all = light.total_irradiance();
    if duration_s > 10.0 && infrared > 0.0 && all - infrared < WEAK_STIMULUS_SHARE * all {
        let (radiance, alpha) = light.hottest(ActionSpectrum::RetinalInfrared, field);
        list.push(rate(Hazard::RetinalThermalWeakStimulus, "L_IR", radiance, 6000.0 / alpha, "W/(m² sr)"));
    }
    list
}

impl Hazard {
    /// Seconds up to which a dose is the limit; from then on it is the level that gives this dose in them. `None` of burns.
    fn until_s(self) -> Option<f64> {
        match self {
            Self::ActinicUv => Some(f64::INFINITY),
            Self::NearUv => Some(1000.0),
            Self::BlueLight => Some(1e4),
            Self::BlueLightSmallSource => Some(100.0),
            _ => None,
        }
    }
}

/// How often exposures in turn, `(seconds, hazards)` each, may be repeated in 8 hours until a hazard that adds up reaches its limit; `None` of
/// burns, and without light.
pub fn repeats_per_day(hazard: Hazard, exposures: &[(f64, &[Assessment])]) -> Option<u64> {
    let until_s = hazard.until_s()?;
    let all_s: f64 = exposures.iter().map(|(seconds, _)| seconds).sum();
    let mut shares: Vec<[f64; 2]> = Vec::new();
    for (seconds, hazards) in exposures {
        let of_it = hazards.iter().filter(|of| of.hazard == hazard && of.value > 0.0);
        shares.extend(of_it.map(|of| [of.value / of.limit * (seconds / until_s).max(1.0), *seconds]));
    }
    // The strongest first: light that is weak enough to last thins no dose of others
    shares.sort_by(|a, b| (b[0] / b[1]).total_cmp(&(a[0] / a[1])));
    let (mut dose, mut dose_s) = (0.0, 0.0);
    for [share, seconds] in shares {
        if (dose + share) * until_s <= dose_s + seconds {
            break;
        }
        (dose, dose_s) = (dose + share, dose_s + seconds);
    }
    (all_s > 0.0).then(|| ((1.0 / dose).min(DAY_S / all_s) * (1.0 + 1e-12)) as u64)
}

/// A hazard that adds up over the day: `level t <= limit` up to [`Hazard::until_s`], from then on `level <= lasting`.
fn dose(
    hazard: Hazard,
    quantity: &'static str,
    level: f64,
    duration_s: f64,
    limit: f64,
    unit: &'static str,
) -> Assessment {
    let until_s = hazard.until_s().unwrap_or(f64::INFINITY);
    let (value, lasting) = (level * duration_s, limit / until_s);
    // Past `until_s` the level counts; over the same time it is this dose.
    let limit_here = if duration_s > until_s { lasting * duration_s } else { limit };
    let daily_seconds = if level <= lasting { DAY_S } else { (limit / level).min(DAY_S) };
    Assessment {
        hazard,
        quantity,
        value,
        limit: limit_here,
        unit,
        margin: (value > 0.0).then(|| limit_here / value),
        daily_seconds: Some(daily_seconds),
        exposures_per_day: (duration_s > 0.0).then(|| (daily_seconds / duration_s * (1.0 + 1e-12)) as u64),
    }
}

/// A hazard of each exposure on its own.
fn rate(hazard: Hazard, quantity: &'static str, value: f64, limit: f64, unit: &'static str) -> Assessment {
    Assessment {
        hazard,
        quantity,
        value,
        limit,
        unit,
        margin: (value > 0.0).then(|| limit / value),
        daily_seconds: None,
        exposures_per_day: None,
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::safety::ApparentSource;
    use crate::spectral::Curve;

    /// Light of practically one wavelength, of an irradiance and a subtense.
    fn line(nm: f64, irradiance: f64, subtense_rad: f64) -> Illumination {
        let width = 0.01;
        let spectrum = Curve::new(vec![nm - width, nm, nm + width], vec![0.0, 1.0 / width, 0.0]).unwrap();
        let source = ApparentSource {
            spectrum: 0,
            irradiance_factor: irradiance,
            direction: [0.0, 0.0, 1.0],
            subtense_rad,
            solid_angle_sr: 0.25 * PI * subtense_rad * subtense_rad,
        };
        Illumination { spectra: vec![spectrum], sources: vec![source] }
    }

    fn find(list: &[Assessment], hazard: Hazard) -> &Assessment {
        list.iter().find(|a| a.hazard == hazard).unwrap()
    }

    fn near(got: f64, expected: f64) {
        // The line is 0.01 nm wide on either side: S changes by 4 % per nm, B by 60 % within 5 nm.
        assert!((got - expected).abs() < 1e-3 * expected, "{got}, expected {expected}");
    }

    /// 1000 W/m² at 385 nm for 10 s from a lamp of 50 mrad, by hand.
    #[test]
    fn a_monochromatic_source_at_385_nm() {
        let light = line(385.0, 1000.0, 0.05);
        let list = assess(&light, 10.0, ExposedTissue::Eye(RetinalObserver::Normal));
        let uva = find(&list, Hazard::NearUv);
        near(uva.value, 1e4);
        near(uva.margin.unwrap(), 1.0);
        assert_eq!((uva.limit, uva.unit), (1e4, "J/m²"));
        near(uva.daily_seconds.unwrap(), 10.0);
        let actinic = find(&list, Hazard::ActinicUv);
        near(actinic.value, 1000.0 * 5.3e-5 * 10.0);
        near(actinic.margin.unwrap(), 30.0 / 0.53);
        assert_eq!(actinic.exposures_per_day, Some(56));
        // L = E / (pi alpha² / 4) = 5.093e5 W/(m² sr).
        let radiance = 1000.0 / (0.25 * PI * 0.0025);
        let blue = find(&list, Hazard::BlueLight);
        near(blue.value, 0.013 * radiance * 10.0);
        near(blue.margin.unwrap(), 1e6 / (0.013 * radiance * 10.0));
        let thermal = find(&list, Hazard::RetinalThermal);
        near(thermal.value, 0.13 * radiance);
        near(thermal.limit, 5e4 / (0.05 * 10f64.powf(0.25)));
        assert!(list.iter().all(|a| a.hazard != Hazard::BlueLightSmallSource));
        let infrared = find(&list, Hazard::InfraredEye);
        assert_eq!((infrared.value, infrared.margin), (0.0, None));
        // Without a lens in the eye, 2.31 in place of 0.013.
        let aphakic = assess(&light, 10.0, ExposedTissue::Eye(RetinalObserver::Aphakic));
        near(find(&aphakic, Hazard::BlueLight).value, 2.31 * radiance * 10.0);
        // Skin: 2e4 t^0.25 / t = 3557 W/m² for 10 s; mucosa with its factor of ten.
        let skin = assess(&light, 10.0, ExposedTissue::Skin { safety_factor: 1.0 });
        near(find(&skin, Hazard::SkinThermal).margin.unwrap(), 3556.56 / 1000.0);
        let mucosa = assess(&light, 10.0, ExposedTissue::Skin { safety_factor: 10.0 });
        near(find(&mucosa, Hazard::SkinThermal).margin.unwrap(), 0.355_656);
        near(find(&mucosa, Hazard::ActinicUv).limit, 3.0);
    }

    #[test]
    fn short_and_long_exposures_have_their_own_limits() {
        // 30 ms: 3.3e5 W/m² of UV-A.
        let list = assess(&line(385.0, 1e4 / 0.03, 0.05), 0.03, ExposedTissue::Eye(RetinalObserver::Normal));
        near(find(&list, Hazard::NearUv).margin.unwrap(), 1.0);
        // Beyond 1000 s: 10 W/m², and below it there is no end.
        for (irradiance, margin, day) in [(20.0, 0.5, 500.0), (5.0, 2.0, DAY_S)] {
            let list =
                assess(&line(385.0, irradiance, 0.05), 2000.0, ExposedTissue::Eye(RetinalObserver::Normal));
            let uva = find(&list, Hazard::NearUv);
            near(uva.margin.unwrap(), margin);
            near(uva.daily_seconds.unwrap(), day);
        }
        // A small source at 440 nm: 100 J/m² up to 100 s; the radiance over 11 mrad says nearly the same:
        // 1e6 * pi/4 * 0.011² = 95 J/m².
        let list = assess(&line(440.0, 10.0, 0.001), 10.0, ExposedTissue::Eye(RetinalObserver::Normal));
        near(find(&list, Hazard::BlueLightSmallSource).margin.unwrap(), 1.0);
        near(find(&list, Hazard::BlueLight).margin.unwrap(), 0.950_33);
        // Infrared for 100 s: 18000 * 100^-0.75 = 569.2 W/m²; and nothing visible: 6000 / alpha.
        let list = assess(&line(850.0, 569.21, 0.05), 100.0, ExposedTissue::Eye(RetinalObserver::Normal));
        near(find(&list, Hazard::InfraredEye).margin.unwrap(), 1.0);
        let weak = find(&list, Hazard::RetinalThermalWeakStimulus);
        near(weak.limit, 1.2e5);
        near(weak.value, 569.21 / (0.25 * PI * 0.0025));
        // No light, no margin.
        let list = assess(&Illumination::default(), 1.0, ExposedTissue::Eye(RetinalObserver::Normal));
        assert!(list.iter().all(|a| a.margin.is_none() && a.value == 0.0));
    }

    /// Light that is weak enough to last takes and thins nothing of the dose of strong light. By hand, of near ultraviolet: 1e4 J/m².
    #[test]
    fn doses_of_exposures_in_turn_add_up() {
        let repeats = |exposures: &[(f64, f64)]| {
            let eye = ExposedTissue::Eye(RetinalObserver::Normal);
            let seen = |(level, s): &(f64, f64)| (*s, assess(&line(385.0, *level, 0.05), *s, eye));
            let seen: Vec<_> = exposures.iter().map(seen).collect();
            let seen: Vec<_> = seen.iter().map(|(s, hazards)| (*s, &hazards[..])).collect();
            repeats_per_day(Hazard::NearUv, &seen).unwrap() as f64
        };
        near(repeats(&[(20.0, 0.5)]), 1000.0);
        near(repeats(&[(30.0, 1.0), (20.0, 0.5)]), 250.0);
        near(repeats(&[(1e-4, 1.0), (20.0, 0.5)]), 1000.0);
        near(repeats(&[(9.0, 0.1), (20.0, 0.5)]), 1e4 / 10.9);
        near(repeats(&[(5.0, 2.0), (1e-4, 2.0)]), DAY_S / 4.0);
        let eye = assess(&line(385.0, 5.0, 0.05), 2.0, ExposedTissue::Eye(RetinalObserver::Normal));
        assert_eq!(repeats_per_day(Hazard::RetinalThermal, &[(2.0, &eye)]), None);
    }

    #[test]
    fn times_to_the_limit_at_100_w_per_m2_of_leds() {
        // Gaussian, 12 nm wide; small source: 55 s at 385, 3.9 s at 405, 1.2 s at 420 nm, computed once with another
        // program. UV-A: 100 s over the share below 400 nm, by the normal distribution function.
        let led = |nm: f64| {
            let sigma = 12.0 / (8.0 * std::f64::consts::LN_2).sqrt();
            let curve = Curve::from_fn(300.0, 600.0, |x| (-0.5 * ((x - nm) / sigma).powi(2)).exp());
            let spectrum = curve.scaled(1.0 / curve.total());
            Illumination { spectra: vec![spectrum], ..line(nm, 100.0, 0.0) }
        };
        let seconds = |nm: f64, hazard: Hazard| {
            let list = assess(&led(nm), 1.0, ExposedTissue::Eye(RetinalObserver::Normal));
            find(&list, hazard).daily_seconds.unwrap()
        };
        for (nm, expected) in [(385.0, 55.0), (405.0, 3.9), (420.0, 1.2)] {
            let got = seconds(nm, Hazard::BlueLightSmallSource);
            assert!((got - expected).abs() < 0.03 * expected, "{nm}: {got}");
        }
        for (nm, expected) in [(365.0, 100.0), (385.0, 100.163), (395.0, 119.512), (405.0, 612.50)] {
            let got = seconds(nm, Hazard::NearUv);
            assert!((got - expected).abs() < 2e-3 * expected, "{nm}: {got}");
        }
    }
}
