//! How tissue of one site varies: among people, and from place to place within a person.

use rand::RngExt;
use rand_distr::StandardNormal;

use super::site::Site;
use crate::sampling::random::{Key, KeyedRng};

/// How the values of a parameter scatter around the typical one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spread {
    /// Log-normal: a factor whose logarithm has the stated standard deviation.
    Factor,
    /// Normal: a difference with the stated standard deviation, in the unit of the parameter.
    Difference,
}

/// Parameters of a [`Site`] that vary together.
#[derive(Clone, Debug, PartialEq)]
pub struct Variation {
    /// Name: that of its parameters without the layer.
    pub name: &'static str,
    /// The parameters, which share one draw.
    pub parameters: &'static [&'static str],
    /// What it is in words, without a unit.
    pub title: &'static str,
    /// The fluorophore whose strength it is, with which light goes in proportion; `None` for what absorbs, scatters, or has a size.
    pub fluorophore: Option<&'static str>,
    /// Distribution.
    pub spread: Spread,
    /// Standard deviation among people; of the logarithm where [`Self::spread`] is a factor.
    pub between_people: f64,
    /// Standard deviation among places of one person, likewise.
    pub within_person: f64,
}

/// A factor on parameters that share one draw: name, title, parameters, standard deviation among people.
const fn factor(
    name: &'static str,
    title: &'static str,
    parameters: &'static [&'static str],
    between_people: f64,
) -> Variation {
    let within_person = WITHIN_OVER_BETWEEN * between_people;
    let (fluorophore, spread) = (None, Spread::Factor);
    Variation { name, parameters, title, fluorophore, spread, between_people, within_person }
}

const fn layer(title: &'static str, parameter: &'static [&'static str; 1]) -> Variation {
    factor(parameter[0], title, parameter, 0.2)
}

/// A factor on the strength of a fluorophore: its name, title, standard deviation among people, and where it is in layers these.
macro_rules! strength {
    ($fluorophore:literal, $title:literal, $between_people:expr $(, $layer:literal)*) => {
        Variation {
            fluorophore: Some($fluorophore),
            ..factor(
                concat!($fluorophore, "_per_mm"),
                $title,
                strength!(@parameters $fluorophore $(, $layer)*),
                $between_people,
            )
        }
    };
    (@parameters $fluorophore:literal) => { &[concat!($fluorophore, "_per_mm")] };
    (@parameters $fluorophore:literal, $upper:literal, $lower:literal) => {
        &[concat!($upper, "_", $fluorophore, "_per_mm"), concat!($lower, "_", $fluorophore, "_per_mm")]
    };
}

/// Chromaticities of tongues and lips scatter a fifth as much within a person as among four people (0.003 to 0.010 against
/// 0.025 to 0.04).
const WITHIN_OVER_BETWEEN: f64 = 0.2;
/// Correlation of a parameter at two sites of one person. \[assumed\]: yields of tongue and lip of four people correlate by 0.6, -0.5 and 0.3 under
/// lights of 405, 415 and 450 nm.
const ALIKE_IN_PERSON: f64 = 0.5;
/// Standard deviation of the logarithm of the strength of a fluorophore.
const STRENGTH: f64 = 0.45;

/// What varies in mucosa and skin. The widths were chosen so that chromaticities behind a long-pass under lights of 405, 415 and
/// 450 nm scatter as those of tongues and lips of four people; oxygen saturation, superficial and deep blood and thickness are
/// independent of each other. \[assumed: four people hold no more\] Melanin: \[assumed\].
const SOFT: &[Variation] = &[
    factor("superficial_blood_fraction", "superficial blood fraction", &["superficial_blood_fraction"], 0.6),
    factor("deep_blood_fraction", "deep blood fraction", &["deep_blood_fraction"], 0.5),
    Variation {
        name: "oxygen_saturation",
        parameters: &["oxygen_saturation"],
        title: "oxygen saturation",
        fluorophore: None,
        spread: Spread::Difference,
        between_people: 0.05,
        within_person: 0.01,
    },
    factor("epithelium_thickness_um", "epithelium thickness", &["epithelium_thickness_um"], 0.35),
    factor("melanin_fraction", "melanin fraction", &["melanin_fraction"], 0.5),
    strength!("biofilm_porphyrin", "biofilm porphyrin", 0.85),
    strength!("biofilm_chlorophyll", "biofilm chlorophyll", 1.0),
    strength!("keratin", "keratin", STRENGTH),
    strength!("nadh", "nadh", STRENGTH),
    strength!("fad", "fad", STRENGTH),
    strength!("flavin_aggregate", "flavin aggregate", STRENGTH),
    strength!("collagen", "collagen", STRENGTH, "superficial", "deep"),
    strength!("elastin", "elastin", STRENGTH, "superficial", "deep"),
    strength!("lipopigment", "lipopigment", STRENGTH, "superficial", "deep"),
];

/// Scattering of the stroma, without which the lightness of gums spreads half as far as measured.
const STROMA_SCATTERING: Variation = layer("stroma scattering", &["stroma_reduced_scattering_per_mm"]);

/// What [`SOFT`] holds fixed but the thickness of the biofilm, which acts as the strengths of what it holds do. \[assumed: no work tells how much
/// people differ in these\]
const LAYERS: &[Variation] = &[
    layer("keratin thickness", &["keratin_thickness_um"]),
    layer("stroma thickness", &["superficial_stroma_thickness_um"]),
    layer("background absorption", &["background_per_mm"]),
    layer("slope of the background", &["background_slope_per_nm"]),
    layer("keratin scattering", &["keratin_scattering_per_mm"]),
    layer("epithelium scattering", &["epithelium_scattering_per_mm"]),
    STROMA_SCATTERING,
    layer("power of stroma scattering", &["stroma_scattering_power"]),
    layer("superficial vessel radius", &["superficial_vessel_radius_um"]),
    layer("deep vessel radius", &["deep_vessel_radius_um"]),
    layer("hemoglobin", &["hemoglobin_g_per_l"]),
];

/// What varies in teeth. \[assumed\]
const TOOTH: &[Variation] = &[
    factor("enamel_thickness_um", "enamel thickness", &["enamel_thickness_um"], 0.2),
    factor("dentin_background_per_mm", "dentin background", &["dentin_background_per_mm"], 0.3),
    strength!("enamel", "enamel", STRENGTH),
    strength!("dentin", "dentin", STRENGTH),
];

/// What people differ in besides. Of enamel as much as gives incisors a standard deviation of about 3 in b of CIELAB \[assumed\].
const OF_PEOPLE: &[Variation] = &[
    STROMA_SCATTERING,
    factor("enamel_background_per_mm", "enamel background", &["enamel_background_per_mm"], 0.3),
    factor("enamel_scattering_per_mm", "enamel scattering", &["enamel_scattering_per_mm"], 0.3),
];

impl Variation {
    /// Standard deviation over people and places together.
    #[must_use]
    pub fn standard_deviation(&self) -> f64 {
        self.between_people.hypot(self.within_person)
    }

    /// A value that lies so far from a typical one: `value exp(shift)` or `value + shift`.
    #[must_use]
    pub fn shifted(&self, value: f64, shift: f64) -> f64 {
        match self.spread {
            Spread::Factor => value * shift.exp(),
            Spread::Difference => value + shift,
        }
    }

    /// Moves the parameters of a site, as far as their ranges allow.
    fn shift(&self, site: &mut Site, shift: f64) {
        for name in self.parameters {
            if let Ok(value) = site.get(name) {
                site.set_within_range(name, self.shifted(value, shift));
            }
        }
    }
}

/// The tissue of one site in all people: the typical one, and what varies.
///
/// Draws are functions of a [`KeyedRng`] alone. A person is a population, too: the one of all places of this person.
///
/// ```
/// use fluorspar::sampling::random::Key;
/// use fluorspar::tissue::{Population, Site};
/// fn two_places_of_a_person(typical: &Site) -> [Site; 2] {
///     let person = Population::of(typical).person(Key::new(7));
///     [0, 1].map(|place| person.draw(&mut Key::new(7).with(place).rng()))
/// }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Population {
    typical: Site,
    variations: Vec<Variation>,
}

impl Population {
    /// The population around a typical tissue. What this does not hold (parameters of value 0) does not vary.
    #[must_use]
    pub fn of(typical: &Site) -> Self {
        Self::varying(typical, SOFT.iter().chain(TOOTH))
    }

    /// What people are drawn from: [`Self::of`], the scattering of the stroma and the enamel.
    #[must_use]
    pub fn of_people(typical: &Site) -> Self {
        Self::varying(typical, SOFT.iter().chain(TOOTH).chain(OF_PEOPLE))
    }

    /// The population of what [`Self::of`] holds fixed: thickness of layers, background absorption, scattering, vessels.
    #[must_use]
    pub fn of_layers(typical: &Site) -> Self {
        Self::varying(typical, LAYERS.iter())
    }

    fn varying<'a>(typical: &Site, variations: impl Iterator<Item = &'a Variation>) -> Self {
        let holds = |name: &&str| typical.get(name).is_ok_and(|value| value != 0.0);
        let varies = |variation: &&Variation| variation.parameters.iter().any(&holds);
        let variations = variations.filter(varies).cloned().collect();
        Self { typical: typical.clone(), variations }
    }

    /// The typical tissue: the median of every parameter.
    #[must_use]
    pub fn typical(&self) -> &Site {
        &self.typical
    }

    /// What varies, each independently of the others.
    #[must_use]
    pub fn variations(&self) -> &[Variation] {
        &self.variations
    }

    /// The same with all standard deviations multiplied, for instance to see what a prior does.
    #[must_use]
    pub fn widened(&self, factor: f64) -> Self {
        let mut wider = self.clone();
        for variation in &mut wider.variations {
            variation.between_people *= factor;
            variation.within_person *= factor;
        }
        wider
    }

    /// The same with only those variations that a function keeps.
    #[must_use]
    pub fn restricted(&self, keep: impl Fn(&Variation) -> bool) -> Self {
        let variations = self.variations.iter().filter(|variation| keep(variation)).cloned().collect();
        Self { typical: self.typical.clone(), variations }
    }

    /// The tissue that lies so many standard deviations (people and places together) from the typical one, one number for each
    /// of [`Self::variations`]; numbers that are missing count as 0. Values stay within the ranges of their parameters.
    #[must_use]
    pub fn tissue_at(&self, deviations: &[f64]) -> Site {
        let mut site = self.typical.clone();
        for (variation, deviation) in self.variations.iter().zip(deviations) {
            variation.shift(&mut site, deviation * variation.standard_deviation());
        }
        site
    }

    /// The person of a key: the population of the places of this site in that person, whose other sites deviate alike in part.
    #[must_use]
    pub fn person(&self, key: Key) -> Self {
        let mut person = self.clone();
        for variation in &mut person.variations {
            let of_person = key.with_text(variation.name);
            // All teeth of a person are alike
            let site = if self.typical.is_mucosa() { self.typical.name() } else { "teeth" };
            let of_site = of_person.with_text(site);
            let deviation = ALIKE_IN_PERSON.sqrt() * of_person.normal()
                + (1.0 - ALIKE_IN_PERSON).sqrt() * of_site.normal();
            variation.shift(&mut person.typical, deviation * variation.between_people);
            variation.between_people = 0.0;
        }
        person
    }

    /// Draws the tissue of some place of some person; of a [`Self::person`], some place of that one.
    #[must_use]
    pub fn draw(&self, rng: &mut KeyedRng) -> Site {
        let deviations: Vec<f64> = self.variations.iter().map(|_| rng.sample(StandardNormal)).collect();
        self.tissue_at(&deviations)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tissue::site_tests::{lip, tongue};

    fn logs(sites: &[Site], name: &str) -> Vec<f64> {
        sites.iter().map(|site| site.get(name).unwrap().ln()).collect()
    }

    fn mean_and_deviation(values: &[f64]) -> [f64; 2] {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        [mean, (squares / (values.len() - 1) as f64).sqrt()]
    }

    /// Mean and standard deviation of n normal numbers have standard errors of `sd / sqrt(n)` and `sd / sqrt(2 n)`; four of
    /// them.
    #[test]
    fn draws_scatter_as_stated_among_people_and_within_a_person() {
        let population = Population::of(&tongue());
        let n = 4000;
        let drawn: Vec<Site> = (0..n).map(|i| population.draw(&mut Key::new(1).with(i).rng())).collect();
        let person = population.person(Key::new(2));
        let places: Vec<Site> = (0..n).map(|i| person.draw(&mut Key::new(3).with(i).rng())).collect();
        for (name, between) in [("superficial_blood_fraction", 0.6), ("deep_collagen_per_mm", STRENGTH)] {
            let within = WITHIN_OVER_BETWEEN * between;
            for (sites, center, sd) in
                [(&drawn, population.typical(), within.hypot(between)), (&places, person.typical(), within)]
            {
                let [mean, found] = mean_and_deviation(&logs(sites, name));
                let off = mean - center.get(name).unwrap().ln();
                let error = sd / (n as f64).sqrt();
                assert!(
                    off.abs() < 4.0 * error && (found - sd).abs() < 3.0 * error,
                    "{name}: {off}, {found}"
                );
            }
        }
    }

    #[test]
    fn layers_are_what_the_population_holds_fixed() {
        let [people, layers] = [Population::of(&tongue()), Population::of_layers(&tongue())];
        let typical = people.typical();
        let moved = layers.tissue_at(&vec![1.0; layers.variations().len()]);
        for (parameter, value) in moved.parameters() {
            let factor = value / typical.get(parameter.name).unwrap().max(f64::MIN_POSITIVE);
            let varies =
                |of: &Population| of.variations().iter().any(|v| v.parameters.contains(&parameter.name));
            let expected = if varies(&layers) { 1.04_f64.sqrt() * 0.2 } else { 0.0 };
            assert!(value == 0.0 || (factor.ln() - expected).abs() < 1e-9, "{}: {factor}", parameter.name);
            assert!(!(varies(&layers) && varies(&people)), "{}", parameter.name);
        }
        assert_eq!(layers.variations().len(), 11);
    }

    #[test]
    fn what_varies_together_keeps_its_ratio_and_what_is_absent_stays_absent() {
        let population = Population::of(&lip()).widened(3.0);
        assert!(
            population
                .variations()
                .iter()
                .all(|v| !v.name.contains("porphyrin") && !v.name.contains("enamel"))
        );
        for i in 0..200 {
            let site = population.draw(&mut Key::new(5).with(i).rng());
            let saturation = site.get("oxygen_saturation").unwrap();
            assert!(
                (0.0..=1.0).contains(&saturation) && site.get("biofilm_porphyrin_per_mm").unwrap() == 0.0
            );
        }
        let tongue = Population::of(&tongue());
        let site = tongue.tissue_at(&[1.0; 13]);
        let names = ["superficial_lipopigment_per_mm", "deep_lipopigment_per_mm"];
        let [a, b] = names.map(|name| site.get(name).unwrap() / tongue.typical().get(name).unwrap());
        assert!((a - b).abs() < 1e-12 && (a.ln() / STRENGTH - 1.04_f64.sqrt()).abs() < 1e-9, "{a} {b}");
        assert_eq!(tongue.tissue_at(&[]), *tongue.typical());
        let none = tongue.restricted(|_| false);
        assert_eq!(none.draw(&mut Key::new(1).rng()), *tongue.typical());
    }
}
