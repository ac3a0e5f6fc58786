//! Risk groups of lamps.

use serde::Serialize;

use super::illumination::{blue_light_field_rad, thermal_field_rad};
use super::{ActionSpectrum, Illumination};

/// Risk group of a lamp in continuous operation: IEC 62471:2006, 6.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub enum RiskGroup {
    /// Exempt: no hazard.
    #[serde(rename = "exempt")]
    Exempt,
    /// Low risk.
    #[serde(rename = "1")]
    Low,
    /// Moderate risk.
    #[serde(rename = "2")]
    Moderate,
    /// High risk.
    #[serde(rename = "3")]
    High,
}

impl RiskGroup {
    /// `exempt`, `1`, `2` or `3`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exempt => "exempt",
            Self::Low => "1",
            Self::Moderate => "2",
            Self::High => "3",
        }
    }

    /// Meaning of the group for a lamp in continuous operation, and its consequences for a device: IEC 62471:2006, 6.1.
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Exempt => "no photobiological hazard, however long one looks into it",
            Self::Low => {
                "low risk: no hazard as people usually behave, though there is one for those who look into it for long"
            }
            Self::Moderate => {
                "moderate risk: no hazard as long as people turn away from glare or heat. Ultraviolet neither dazzles \
                 nor feels hot: let the lamp shine for the frames only, and warn of it"
            }
            Self::High => {
                "high risk: a hazard even for a short look when the lamp shines continuously. Let it shine for the frames only, \
                 with hardware that ends each pulse, lower its power, put it farther away, or have eyes covered. In use the \
                 margins of captures count"
            }
        }
    }
}

/// One quantity of the classification.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RiskQuantity {
    /// Its symbol.
    pub quantity: &'static str,
    /// Its value.
    pub value: f64,
    /// Unit.
    pub unit: &'static str,
    /// Largest value of the exempt group, of group 1 and of group 2.
    pub group_limits: [f64; 3],
    /// The group that it alone gives.
    pub group: RiskGroup,
}

impl RiskQuantity {
    /// Time after which continuous light at this level reaches the exposure limit, s; `None` where it never does, and for
    /// quantities that are limited at once. IEC 62471:2006, 4.3.1, 4.3.2 and 4.3.3.
    pub fn seconds_to_limit(&self) -> Option<f64> {
        let (dose, longest_s) = match self.quantity {
            "E_s" => (30.0, 28_800.0),
            "E_UVA" => (1e4, 1e3),
            "L_B" => (1e6, 1e4),
            _ => return None,
        };
        Some(dose / self.value).filter(|seconds| *seconds <= longest_s)
    }
}

/// The group of a lamp, the worst of its quantities, from the light at the distance of the test (200 mm for lamps that
/// are not for general lighting). Of several ways to drive it each quantity is that of the worst; `None` without any.
pub fn risk_group(lights: &[Illumination]) -> Option<(RiskGroup, Vec<RiskQuantity>)> {
    let list = lights.iter().map(quantities).reduce(|worst, next| {
        let worse = |(a, b): (RiskQuantity, RiskQuantity)| {
            // Limits of heat are those of its own subtense
            let share = |q: &RiskQuantity| q.value / q.group_limits[0];
            if (b.group, share(&b)) > (a.group, share(&a)) { b } else { a }
        };
        worst.into_iter().zip(next).map(worse).collect()
    })?;
    Some((list.iter().map(|q| q.group).max()?, list))
}

/// Every quantity of one light.
fn quantities(light: &Illumination) -> Vec<RiskQuantity> {
    // Times of the groups for heat: 10, 10 and 0.25 s, each with its field, below which no source counts as smaller.
    let fields = [10.0, 10.0, 0.25].map(thermal_field_rad);
    let thermal = fields.map(|field| light.hottest(ActionSpectrum::RetinalThermal, field));
    let (thermal_levels, [low, _, moderate]) = (thermal.map(|hot| hot.0), thermal.map(|hot| hot.1));
    // Times of the groups for blue light: 1e4, 100 and 0.25 s, each with its field.
    let blue = |seconds| light.averaged_radiance(ActionSpectrum::BlueLight, blue_light_field_rad(seconds));
    let blue_levels = [blue(1e4), blue(100.0), blue(0.25)];
    let irradiance = |weight| light.irradiance(weight);
    let mut list: Vec<RiskQuantity> = [
        ("E_s", irradiance(ActionSpectrum::ActinicUv), "W/m²", [0.001, 0.003, 0.03]),
        ("E_UVA", irradiance(ActionSpectrum::UvA), "W/m²", [10.0, 33.0, 100.0]),
        ("E_IR", irradiance(ActionSpectrum::InfraredEye), "W/m²", [100.0, 570.0, 3200.0]),
    ]
    .map(|(quantity, value, unit, group_limits)| {
        let group = group([value; 3], group_limits);
        RiskQuantity { quantity, value, unit, group_limits, group }
    })
    .into();
    let group_limits = [28_000.0 / low, 28_000.0 / low, 71_000.0 / moderate];
    list.push(RiskQuantity {
        quantity: "L_R",
        value: thermal_levels[0],
        unit: "W/(m² sr)",
        group_limits,
        group: group(thermal_levels, group_limits),
    });
    let group_limits = [100.0, 1e4, 4e6];
    list.push(RiskQuantity {
        quantity: "L_B",
        value: blue_levels[1],
        unit: "W/(m² sr)",
        group_limits,
        group: group(blue_levels, group_limits),
    });
    list
}

fn group(values: [f64; 3], limits: [f64; 3]) -> RiskGroup {
    let groups = [RiskGroup::Exempt, RiskGroup::Low, RiskGroup::Moderate];
    let within = |i: &usize| values[*i] <= limits[*i];
    (0..3).find(within).map_or(RiskGroup::High, |i| groups[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::safety::ApparentSource;
    use crate::spectral::Curve;

    /// Practically one wavelength, from 50 mrad.
    fn lamp(nm: f64, irradiance: f64) -> Illumination {
        let spectrum = Curve::new(vec![nm - 0.1, nm, nm + 0.1], vec![0.0, 10.0, 0.0]).unwrap();
        let source = ApparentSource {
            spectrum: 0,
            irradiance_factor: irradiance,
            direction: [0.0, 0.0, 1.0],
            subtense_rad: 0.05,
            solid_angle_sr: 0.0025,
        };
        Illumination { spectra: vec![spectrum], sources: vec![source] }
    }

    #[test]
    fn uva_decides_the_group_of_a_385_nm_lamp() {
        let at = |irradiance: f64| risk_group(&[lamp(385.0, irradiance)]).unwrap();
        for (irradiance, expected) in [
            (9.0, RiskGroup::Exempt),
            (20.0, RiskGroup::Low),
            (90.0, RiskGroup::Moderate),
            (110.0, RiskGroup::High),
        ] {
            let (worst, list) = at(irradiance);
            let uva = list.iter().find(|q| q.quantity == "E_UVA").unwrap();
            assert!((uva.value - irradiance).abs() < 1e-6 * irradiance);
            assert_eq!(uva.group, expected);
            // 1e4 J/m²; below 10 W/m² there is no end.
            let seconds = (irradiance > 10.0).then_some(1e4 / irradiance);
            assert_eq!(uva.seconds_to_limit().map(f64::round), seconds.map(f64::round));
            assert!(worst >= expected);
        }
        // 0.013 * 9 / 0.0025 = 47 W/(m² sr) and S: 5e-4 W/m²: exempt altogether.
        assert_eq!(at(9.0).0, RiskGroup::Exempt);
    }

    /// 500 W/m² at 600 nm from 2 mrad: averaged over the field of 10 s the limit of that field is exceeded, and at 0.25 s that of 2 mrad.
    #[test]
    fn a_small_source_is_judged_in_the_field_of_each_time() {
        let spectrum = Curve::new(vec![599.9, 600.0, 600.1], vec![0.0, 10.0, 0.0]).unwrap();
        let source = ApparentSource {
            spectrum: 0,
            irradiance_factor: 500.0,
            direction: [0.0, 0.0, 1.0],
            subtense_rad: 0.002,
            solid_angle_sr: std::f64::consts::PI * 1e-6,
        };
        let light = Illumination { spectra: vec![spectrum], sources: vec![source] };
        let (_, list) = risk_group(std::slice::from_ref(&light)).unwrap();
        let heat = list.iter().find(|q| q.quantity == "L_R").unwrap();
        let field = thermal_field_rad(10.0);
        let expected = 500.0 / (std::f64::consts::FRAC_PI_4 * field * field);
        assert!((heat.value / expected - 1.0).abs() < 1e-3, "{heat:?} {expected}");
        assert!((heat.group_limits[0] * field / 28_000.0 - 1.0).abs() < 1e-9, "{heat:?}");
        assert_eq!(heat.group, RiskGroup::High);
    }

    #[test]
    fn each_quantity_is_that_of_the_worst_way_to_drive_a_lamp() {
        let (violet, white) = (lamp(385.0, 194.0), lamp(550.0, 1000.0));
        for lights in [[violet.clone(), white.clone()], [white, violet]] {
            let (worst, list) = risk_group(&lights).unwrap();
            assert_eq!(worst, RiskGroup::High);
            assert!((list.iter().find(|q| q.quantity == "E_UVA").unwrap().value / 194.0 - 1.0).abs() < 1e-6);
        }
        assert_eq!(risk_group(&[]), None);
    }
}
