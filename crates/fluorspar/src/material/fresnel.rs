//! Fresnel reflectance of smooth surfaces.

/// Unpolarized Fresnel reflectance of a smooth dielectric seen from outside; `cos` is that of the angle of incidence.
#[inline]
pub fn dielectric_fresnel(cos: f32, refractive_index: f32) -> f32 {
    let cos = cos.clamp(0.0, 1.0);
    let sin2_t = (1.0 - cos * cos) / (refractive_index * refractive_index);
    let cos_t = (1.0 - sin2_t).max(0.0).sqrt();
    let parallel = (refractive_index * cos - cos_t) / (refractive_index * cos + cos_t);
    let perpendicular = (cos - refractive_index * cos_t) / (cos + refractive_index * cos_t);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// Unpolarized Fresnel reflectance of a conductor with the complex index `n + i k`; `cos` is that of the angle of
/// incidence. Born and Wolf, Principles of Optics, Sec. 14.2, in real arithmetic.
pub fn conductor_fresnel(cos: f64, n: f64, k: f64) -> f64 {
    let cos2 = (cos * cos).clamp(0.0, 1.0);
    let sin2 = 1.0 - cos2;
    let (n2, k2) = (n * n, k * k);
    let t0 = n2 - k2 - sin2;
    let a2_b2 = (t0 * t0 + 4.0 * n2 * k2).sqrt();
    let a = (0.5 * (a2_b2 + t0)).max(0.0).sqrt();
    let perpendicular = (a2_b2 - 2.0 * a * cos + cos2) / (a2_b2 + 2.0 * a * cos + cos2);
    let cross = 2.0 * a * cos * sin2;
    let parallel =
        perpendicular * (cos2 * a2_b2 + sin2 * sin2 - cross) / (cos2 * a2_b2 + sin2 * sin2 + cross);
    0.5 * (perpendicular + parallel)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fresnel_matches_textbook_values() {
        assert!((dielectric_fresnel(1.0, 1.5) - 0.04).abs() < 1e-6);
        assert!((dielectric_fresnel(1.0, 1.40) - 0.027_78).abs() < 1e-5);
        assert!((dielectric_fresnel(0.0, 1.5) - 1.0).abs() < 1e-6);
        // Brewster's angle: only one polarization is reflected.
        let brewster = 1.5_f32.atan();
        let reflected = 0.5 * (2.0 * brewster - std::f32::consts::FRAC_PI_2).sin().powi(2);
        assert!((dielectric_fresnel(brewster.cos(), 1.5) - reflected).abs() < 1e-5);
    }

    #[test]
    fn a_conductor_without_extinction_is_a_dielectric() {
        for cos in [0.05, 0.3, 0.7, 1.0] {
            let dielectric = dielectric_fresnel(cos as f32, 1.5);
            assert!((conductor_fresnel(cos, 1.5, 0.0) - f64::from(dielectric)).abs() < 1e-5, "{cos}");
        }
        // Normal incidence: ((n - 1)^2 + k^2) / ((n + 1)^2 + k^2).
        let (n, k) = (0.789, 5.85);
        let expected = ((n - 1.0_f64).powi(2) + k * k) / ((n + 1.0_f64).powi(2) + k * k);
        assert!((conductor_fresnel(1.0, n, k) - expected).abs() < 1e-12);
        assert!((conductor_fresnel(0.0, n, k) - 1.0).abs() < 1e-12);
    }
}
