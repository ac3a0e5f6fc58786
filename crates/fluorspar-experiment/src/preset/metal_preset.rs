//! Metals of the catalogue.

use serde::{Deserialize, Serialize};

use super::catalogue::{damaged, parse};
use super::curve_preset::check_name;
use super::kind::{PresetError, PresetKind};
use fluorspar::spectral::{Curve, CurveModel};

/// A metal of the catalogue: its complex refractive index.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MetalPreset {
    /// Name by which files refer to it.
    pub name: String,
    /// Name for people.
    pub title: String,
    /// Description and caveats.
    pub description: String,
    /// Where the numbers come from.
    pub source: String,
    /// Wavelengths between which they hold, nm.
    pub valid_nm: [f64; 2],
    /// Real part.
    pub n: CurveModel,
    /// Extinction coefficient.
    pub k: CurveModel,
}

impl MetalPreset {
    /// Real part and extinction coefficient over `valid_nm`.
    pub fn index(&self) -> (Curve, Curve) {
        (Curve::from_model(&self.n), Curve::from_model(&self.k))
    }
}

/// Complex refractive index of a metal.
///
/// # Errors
/// When there is no such metal.
pub fn metal(name: &str) -> Result<MetalPreset, PresetError> {
    let preset: MetalPreset = parse(PresetKind::Metal, name)?;
    check_name(PresetKind::Metal, name, &preset.name)?;
    for (field, model) in [("n", &preset.n), ("k", &preset.k)] {
        model
            .validate()
            .map_err(|(at, message)| damaged(PresetKind::Metal, name, format!("{field}.{at}: {message}")))?;
    }
    Ok(preset)
}

#[cfg(test)]
mod tests {
    use super::super::names;
    use super::*;
    use fluorspar::material::fresnel::conductor_fresnel;
    use fluorspar::material::microfacet::white_microfacets;
    use fluorspar::material::{Conductor, ConductorReflectance, ScalarTexture};
    use fluorspar::spectral::WavelengthGrid;

    /// Reflectances at normal incidence as handbooks give them, to two hundredths.
    #[test]
    fn metals_reflect_as_they_should() {
        for (name, nm, expected) in
            [("aluminum", 550.0, 0.92), ("stainless_steel", 550.0, 0.64), ("iron", 550.0, 0.52)]
        {
            let (n, k) = metal(name).unwrap().index();
            let reflectance = conductor_fresnel(1.0, n.at(nm), k.at(nm));
            assert!((reflectance - expected).abs() < 0.02, "{name}: {reflectance}");
        }
    }

    /// The renderer keeps the spectrum of a point of view apart from the angles of rough microfacets.
    #[test]
    fn reflectances_at_other_angles_are_fitted_closely() {
        for name in names(PresetKind::Metal) {
            let (n, k) = metal(name).unwrap().index();
            let conductor = Conductor {
                n: n.clone(),
                k: k.clone(),
                roughness: ScalarTexture::Constant(0.2),
                single_scattering: false,
            };
            let fit = ConductorReflectance::new(&conductor, &WavelengthGrid::default(), white_microfacets());
            // At the viewer's own angle, all that a mirror needs.
            for cos in [0.05_f32, 0.2, 0.45, 0.7, 0.95] {
                let viewer = fit.viewer(cos);
                let (a, b) = fit.at_angle(viewer, cos);
                for (band, value) in fit.spectrum(viewer).iter().enumerate() {
                    let nm = WavelengthGrid::default().center_nm(band);
                    let exact = conductor_fresnel(cos.into(), n.at(nm), k.at(nm));
                    let error = (f64::from(a * value + b) - exact).abs();
                    assert!(error < 2e-3, "{name}: {cos} {nm}: {error}");
                }
            }
            let (largest, mean) = (fit.largest_error(), fit.mean_error());
            // The worst is a viewer at grazing angles, who sees a flat spectrum that tells nothing of the metal; most where the
            // metal is colored.
            let limits = if ["copper", "gold"].contains(&name) { [0.32, 0.03] } else { [0.15, 0.02] };
            assert!(
                largest < limits[0] && mean < limits[1],
                "{name}: {largest} at worst, {mean} in the mean"
            );
        }
    }
}
