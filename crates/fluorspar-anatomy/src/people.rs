//! Plausible people: dimensions drawn together, so that large teeth sit in large arches.

use super::dental_arch::{Arch, Jaw};
use super::math::{exp, ln, sin_cos};
use super::noise::lattice;
use super::parameters::MouthParameters;

/// Smallest and largest overall Bolton ratio of a sampled person: lower over upper widths of the twelve teeth from
/// first molar to first molar (populations: 92.3 to 93.4 %, Smith and others 2000).
pub const BOLTON_RANGE: (f64, f64) = (0.89, 0.96);

/// Standard deviation of a standard normal number that is cut at [`CUT`].
const OF_CUT: f64 = 0.91622;
const CUT: f64 = 2.2;

/// Normal number of mean 0 and standard deviation 1 of a person and a quantity, cut at 2.4.
fn normal(seed: u32, quantity: u32) -> f64 {
    for attempt in 0..16 {
        let number = |channel: u32| lattice(seed, quantity as i32, attempt, 900 + channel);
        let (radius, angle) = ((-2.0 * ln(number(0).max(1e-12))).sqrt(), number(1));
        let value = radius * sin_cos(2.0 * std::f64::consts::PI * angle).1;
        if value.abs() < CUT {
            return value / OF_CUT;
        }
    }
    0.0
}

/// A person: shape, teeth and plaque, in the default pose.
///
/// One factor for the size of the body is shared by all lengths with the loading given below, the rest of each
/// spread is its own (loadings assumed; means and spreads: Wheeler's table and Magne and others 2003 for teeth, Mina
/// and others 2017 for arches, Farkas for lips, Korkhaus for the palate, the Edinburgh measurements for the tongue).
/// The depth of each arch is solved so that its teeth have room, but for a little crowding or spacing.
pub fn sample_person(seed: u32) -> MouthParameters {
    let female = lattice(seed, 0, 0, 899) < 0.5;
    let size = 0.8 * normal(seed, 0) + if female { -0.45 } else { 0.45 };
    // Mean, standard deviation, loading on the size of the body, quantity.
    let draw = |mean: f64, spread: f64, loading: f64, quantity: u32| {
        mean + spread * (loading * size + (1.0 - loading * loading).sqrt() * normal(seed, quantity))
    };
    let mut p = MouthParameters { seed, ..MouthParameters::default() };
    p.tooth_scale = draw(1.02, 0.04, 0.4, 1).clamp(0.92, 1.12);
    let bolton = draw(0.9275, 0.014, 0.0, 2).clamp(BOLTON_RANGE.0 + 0.003, BOLTON_RANGE.1 - 0.003);
    p.lower_tooth_factor = 1.0;
    p.lower_tooth_factor = bolton / p.bolton_ratio();
    p.arch_exponent = draw(0.5, 0.022, 0.0, 3).clamp(0.45, 0.56);
    // Width follows the teeth in part; the rest is crowding or spacing, which the depth takes up.
    p.upper_arch_width_mm = (53.5 * p.tooth_scale + draw(0.0, 1.5, 0.3, 4)).clamp(47.0, 61.0);
    p.lower_arch_width_mm = (p.upper_arch_width_mm - 3.0 + 0.5 * normal(seed, 5)).clamp(45.0, 58.0);
    for jaw in [Jaw::Upper, Jaw::Lower] {
        let wanted = draw(1.0, 0.018, 0.0, if jaw == Jaw::Upper { 6 } else { 7 });
        let (mut low, mut high) = if jaw == Jaw::Upper { (34.0, 54.0) } else { (32.0, 52.0) };
        for _ in 0..40 {
            let depth = 0.5 * (low + high);
            match jaw {
                Jaw::Upper => p.upper_arch_depth_mm = depth,
                Jaw::Lower => p.lower_arch_depth_mm = depth,
            }
            let (room, needed) = Arch::room_mm(&p, jaw);
            if room < wanted * needed {
                low = depth;
            } else {
                high = depth;
            }
        }
    }
    // 42 % of the distance between the molars, here 0.72 of the width of the arch.
    p.palate_height_mm = (0.375 * p.upper_arch_width_mm + draw(0.0, 1.5, 0.0, 8)).clamp(15.0, 25.0);
    p.overjet_mm = exp(draw(0.9, 0.3, 0.0, 9)).clamp(0.8, 5.5);
    p.tooth_irregularity = exp(0.45 * normal(seed, 10)).clamp(0.3, 2.4);
    // How much dentin shows, 0.12 in the median, is log-normal (assumed); teeth differ more by their enamel
    p.tooth_shade = (0.12 * exp(draw(0.0, 1.0, 0.0, 19)) - 0.12).min(0.6);
    p.plaque = exp(draw(0.0, 0.6, 0.0, 20)).clamp(0.2, 3.0);
    p.tongue_width_mm = draw(48.0, 2.6, 0.5, 11).clamp(41.0, 55.0).min(0.94 * p.lower_arch_width_mm);
    p.tongue_length_mm = (if female { 80.0 } else { 84.0 } + draw(0.0, 3.5, 0.4, 12)).clamp(71.0, 94.0);
    p.tongue_thickness_mm = draw(21.0, 1.6, 0.4, 13).clamp(17.0, 25.5);
    p.lip_opening_width_mm = (if female { 55.2 } else { 59.5 } + draw(0.0, 2.9, 0.3, 14)).clamp(48.0, 68.0);
    p.uvula_length_mm = draw(12.0, 1.8, 0.1, 15).clamp(8.0, 16.0);
    p.tonsil_size = draw(0.4, 0.2, 0.0, 16).clamp(0.0, 1.0);
    p.papilla_scale = draw(1.0, 0.2, 0.0, 17).clamp(0.5, 1.5);
    // How far people can open: 51 ± 6 mm in men, 45 ± 5.5 mm in women; nine tenths of it for the image.
    let most = if female { 45.0 + 5.5 * normal(seed, 18) } else { 51.0 + 6.0 * normal(seed, 18) };
    p.jaw_opening_mm = (0.9 * most).clamp(30.0, 58.0);
    // Wisdom teeth in a quarter of all places; now and then another tooth is lost.
    p.missing_teeth.retain(|number| lattice(seed, i32::from(*number), 1, 898) < 0.75);
    for number in [14, 16, 24, 26, 35, 36, 45, 46] {
        if lattice(seed, number, 2, 898) < 0.03 {
            p.missing_teeth.push(number as u8);
        }
    }
    p
}

/// A filling or a crown of a person.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DrawnRestoration {
    /// FDI number of the tooth.
    pub tooth: u8,
    /// Letters of its surfaces, as [`super::RestoredSurfaces`] reads them.
    pub surfaces: &'static str,
    /// `amalgam`, `composite` or `ceramic`.
    pub material: &'static str,
}

/// Shares of teeth with a filling or crown by place from the midline, upper and lower (which teeth: assumed), of a person of the median.
const RESTORED: [[f64; 8]; 2] =
    [[0.05, 0.05, 0.03, 0.1, 0.16, 0.34, 0.27, 0.22], [0.01, 0.01, 0.01, 0.06, 0.14, 0.34, 0.27, 0.22]];
/// Standard deviation of the logarithm of the factor of a person on them: with it people have 5.4 restored teeth, and a tenth none, as of
/// American adults, of whom nine of ten have had caries, and these six fillings (CDC, Oral Health Surveillance Reports 2019 and 2024).
const RESTORED_SPREAD: f64 = 1.0;
/// Surfaces of fillings, each as frequent as the others, of front teeth and the rest (assumed).
const FRONT_FILLINGS: [&str; 4] = ["m", "d", "mi", "b"];
const SIDE_FILLINGS: [&str; 7] = ["o", "o", "o", "mo", "do", "do", "mod"];
/// Shares of crowns among restorations, and of amalgam among fillings of premolars and molars (assumed).
const CROWNS: f64 = 0.12;
const AMALGAM: f64 = 0.35;

/// Fillings and crowns of a person, tooth by tooth. They depend on the number of the person alone.
pub fn sample_restorations(seed: u32, missing: &[u8]) -> Vec<DrawnRestoration> {
    let of_person = exp(RESTORED_SPREAD * normal(seed, 21));
    let teeth = (1..=4u8).flat_map(|quadrant| (1..=8u8).map(move |place| (quadrant, place)));
    teeth
        .filter_map(|(quadrant, place)| {
            let tooth = 10 * quadrant + place;
            let number = |channel: u32| lattice(seed, i32::from(tooth), channel as i32, 897);
            let share = RESTORED[usize::from(quadrant > 2)][usize::from(place) - 1];
            if missing.contains(&tooth) || number(0) >= (of_person * share).min(0.95) {
                return None;
            }
            let fillings: &[&str] = if place > 3 { &SIDE_FILLINGS } else { &FRONT_FILLINGS };
            let filling = fillings[(number(1) * fillings.len() as f64) as usize];
            let (surfaces, material) = match (number(2) < CROWNS, place > 3 && number(3) < AMALGAM) {
                (true, _) => ("mobdl", "ceramic"),
                (false, true) => (filling, "amalgam"),
                (false, false) => (filling, "composite"),
            };
            Some(DrawnRestoration { tooth, surfaces, material })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::{normal, sample_person, sample_restorations};
    use crate::RestoredSurfaces;

    /// Their mean, six in nine of ten, and the share of people without, over 2000 people to four standard errors.
    #[test]
    fn people_have_as_many_fillings_as_adults() {
        let counts = (1..=2000).map(|seed| {
            let missing = sample_person(seed).missing_teeth;
            let drawn = sample_restorations(seed, &missing);
            assert!(drawn.iter().all(|one| RestoredSurfaces::parse(one.surfaces).is_some()));
            assert!(drawn.iter().all(|one| !missing.contains(&one.tooth)));
            drawn.len() as f64
        });
        let counts: Vec<f64> = counts.collect();
        let mean = counts.iter().sum::<f64>() / 2000.0;
        let sd = (counts.iter().map(|count| (count - mean).powi(2)).sum::<f64>() / 1999.0).sqrt();
        assert!((mean - 5.4).abs() < 4.0 * sd / 2000f64.sqrt(), "{mean} {sd}");
        let none = counts.iter().filter(|count| **count == 0.0).count() as f64 / 2000.0;
        assert!((none - 0.1).abs() < 4.0 * (0.1f64 * 0.9 / 2000.0).sqrt(), "{none}");
    }

    /// To four standard errors, `1 / sqrt(2 n)`.
    #[test]
    fn cut_numbers_have_a_standard_deviation_of_1() {
        let squares: f64 = (1..=20_000).map(|seed| normal(seed, 3).powi(2)).sum();
        assert!(((squares / 2e4).sqrt() - 1.0).abs() < 0.02, "{squares}");
    }
}
