//! Smooth interfaces between media, and their averages over diffuse light.

/// Reflectance of a smooth interface for unpolarized light that arrives in the medium of index `from` under a cosine, by
/// Fresnel's equations; 1 beyond the critical angle.
#[must_use]
pub fn fresnel_reflectance(cosine: f64, from: f64, into: f64) -> f64 {
    if from.total_cmp(&into).is_eq() {
        return 0.0;
    }
    let sine_squared = (from / into).powi(2) * (1.0 - cosine * cosine);
    if sine_squared >= 1.0 {
        return 1.0;
    }
    let refracted = (1.0 - sine_squared).sqrt();
    let s = (from * cosine - into * refracted) / (from * cosine + into * refracted);
    let p = (into * cosine - from * refracted) / (into * cosine + from * refracted);
    0.5 * (s * s + p * p)
}

/// Reflectance of a smooth interface for diffuse (Lambertian) light that arrives in the medium of index `from`:
/// `integral 2 mu r(mu) dmu`. Both directions are tied by `(1 - r_in) n_in^2 = (1 - r_out) n_out^2`.
#[must_use]
pub fn diffuse_reflectance(from: f64, into: f64) -> f64 {
    if from > into {
        return 1.0 - (1.0 - diffuse_reflectance(into, from)) * (into / from).powi(2);
    }
    // Simpson's rule in sqrt(mu): the integrand is smooth there.
    const STEPS: usize = 400;
    let integrand = |u: f64| 4.0 * u.powi(3) * fresnel_reflectance(u * u, from, into);
    let sum: f64 = (0..=STEPS)
        .map(|i| {
            let weight = if i == 0 || i == STEPS { 1.0 } else { [2.0, 4.0][i % 2] };
            weight * integrand(i as f64 / STEPS as f64)
        })
        .sum();
    sum / (3.0 * STEPS as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Index; reflectance at normal incidence; of diffuse light from outside; of diffuse light from inside.
    const AIR: [[f64; 4]; 7] = [
        [1.33, 0.02006, 0.06593, 0.47195],
        [1.37, 0.02437, 0.07220, 0.50567],
        [1.40, 0.02778, 0.07681, 0.52899],
        [1.45, 0.03374, 0.08437, 0.5645],
        [1.50, 0.04, 0.09178, 0.59635],
        [1.54, 0.0452, 0.09762, 0.6195],
        [1.63, 0.05738, 0.11051, 0.66521],
    ];

    #[test]
    fn averages_over_angle_are_those_of_fresnel() {
        for [n, normal, external, internal] in AIR {
            assert!((fresnel_reflectance(1.0, 1.0, n) - normal).abs() < 1e-5, "{n}");
            assert!((diffuse_reflectance(1.0, n) - external).abs() < 1e-5, "{n}");
            assert!((diffuse_reflectance(n, 1.0) - internal).abs() < 1e-5, "{n}");
        }
        assert_eq!(diffuse_reflectance(1.4, 1.4), 0.0);
    }

    #[test]
    fn reflection_is_total_beyond_the_critical_angle() {
        let critical = (1.0 - (1.0f64 / 1.4).powi(2)).sqrt();
        assert_eq!(fresnel_reflectance(critical - 1e-9, 1.4, 1.0), 1.0);
        assert!(fresnel_reflectance(critical + 1e-3, 1.4, 1.0) < 0.8);
        let (outside, inside) = (0.3f64, (1.0 - (1.0 - 0.09) / 1.96f64).sqrt());
        let [there, back] = [fresnel_reflectance(outside, 1.0, 1.4), fresnel_reflectance(inside, 1.4, 1.0)];
        assert!((there - back).abs() < 1e-14);
    }
}
