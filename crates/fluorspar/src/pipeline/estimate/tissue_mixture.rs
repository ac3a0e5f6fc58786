//! Fluorophores of layered tissue as the components of a measured spectrum.

use std::f64::consts::PI;
use std::sync::Arc;

use crate::analysis::{BloodBefore, MixtureComponent};
use crate::spectral::Fluorophore;
use crate::tissue::fit::Viewing;
use crate::tissue::{CachedSolutions, DiscreteOrdinates, Site, TissueError};

/// The parameter whose blood lies before most of what fluoresces.
pub const TISSUE_BLOOD: &str = "superficial_blood_fraction";
/// Tissue is solved with so many amounts of blood.
const AMOUNTS: usize = 13;
/// Least and largest of them, over that of the site.
const FACTORS: [f64; 2] = [0.125, 8.0];
/// Step between solutions, nm.
const STEP_NM: f64 = 5.0;
/// Excitation that is known, nm.
const FIRST_NM: f64 = 350.0;

/// How one spectrum of a tissue was taken.
#[derive(Clone, Copy, Debug)]
pub struct TissueView<'a> {
    /// Light and filter.
    pub viewing: &'a Viewing,
    /// Irradiance of the light, W/m².
    pub irradiance_w_per_m2: f64,
    /// Wavelengths of the samples, nm, rising, up to 800.
    pub wavelengths_nm: &'a [f64],
}

/// The fluorophores of a site, each over all layers that hold it, as components of its radiance, W/(sr m² nm). A weight of 1 is what
/// the site holds. The blood before them is [`TISSUE_BLOOD`], from an eighth to eight times that of the site as far as its range
/// goes; light passes all layers there and back ([`crate::tissue::EffectiveTissue`]).
///
/// # Errors
/// A site without such blood; tissue that can't be solved.
pub fn tissue_mixture(
    site: &Site,
    find: &dyn Fn(&str) -> Option<Arc<Fluorophore>>,
    view: TissueView<'_>,
    kept: &CachedSolutions,
) -> Result<(Vec<MixtureComponent>, BloodBefore), TissueError> {
    let typical = site.get(TISSUE_BLOOD)?;
    let range = site.parameters().find(|(parameter, _)| parameter.name == TISSUE_BLOOD);
    let [least, most] = range.map_or([typical; 2], |(parameter, _)| parameter.range);
    let [low, high] = [(FACTORS[0] * typical).max(least.max(1e-5)), (FACTORS[1] * typical).min(most)];
    let node = |i: usize| low * (high / low).powf(i as f64 / (AMOUNTS - 1) as f64);
    let amounts: Vec<f64> = (0..AMOUNTS).map(node).collect();
    let with_blood = |amount: &f64| {
        let mut site = site.clone();
        site.set(TISSUE_BLOOD, *amount)?;
        site.tissue(find)
    };
    let mut tissues = vec![site.tissue(find)?];
    tissues.extend(amounts.iter().map(with_blood).collect::<Result<Vec<_>, _>>()?);
    let last = view.wavelengths_nm.last().copied().unwrap_or(FIRST_NM) + STEP_NM;
    let steps = ((last - FIRST_NM) / STEP_NM).ceil().max(1.0) as usize;
    let solved_nm: Vec<f64> = (0..=steps).map(|i| FIRST_NM + STEP_NM * i as f64).collect();
    let solved = kept.solve(&tissues, &solved_nm, DiscreteOrdinates::DIFFUSE)?;
    let names: Vec<&str> = site
        .fluorophores()
        .iter()
        .copied()
        .filter(|name| {
            tissues[0].layers.iter().flat_map(|l| &l.fluorophores).any(|f| f.fluorophore.name == *name)
        })
        .collect();
    let scale = view.irradiance_w_per_m2 / PI;
    let of_all = |effective: &crate::tissue::EffectiveTissue| -> Vec<Vec<f64>> {
        let layers = &effective.tissue().layers;
        let of_one = |name: &&str| {
            let mut sum = vec![0.0; view.wavelengths_nm.len()];
            for part in effective.parts() {
                if layers[part.layer].fluorophores[part.fluorophore].fluorophore.name == *name {
                    let emitted = view.viewing.fluorescence(effective, part, view.wavelengths_nm);
                    sum.iter_mut().zip(emitted).for_each(|(sum, emitted)| *sum += scale * emitted);
                }
            }
            sum
        };
        names.iter().map(of_one).collect()
    };
    let typical = names.iter().zip(of_all(&solved[0]));
    let components = typical.map(|(name, values)| MixtureComponent { name: (*name).to_string(), values });
    let values = solved[1..].iter().map(of_all).collect();
    Ok((components.collect(), BloodBefore::Tissue { amounts, values }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::SpectralMixture;
    use crate::spectral::Curve;
    use crate::tissue::EffectiveTissue;
    use crate::tissue::fit::Viewing;
    use crate::tissue::site_tests::lip;

    /// Fluorophores of one broad band each.
    fn find(name: &str) -> Option<Arc<Fluorophore>> {
        use crate::spectral::{BandTerm, LogNormalBand, Stokes, YieldUnit};
        let center = 460.0 + 25.0 * (name.len() % 9) as f64;
        let band = |peak_nm: f64| LogNormalBand { peak_nm, fwhm_per_cm: 3000.0, skew: 1.0, weight: 1.0 };
        let term = BandTerm { excitation: vec![band(400.0)], emission: vec![band(center)] };
        Some(Arc::new(Fluorophore::from_bands(
            name,
            name,
            &[term],
            YieldUnit::Photons,
            Stokes::Mask,
            1e-3,
            (350.0, 450.0),
            (400.0, 750.0),
            "made up",
        )))
    }

    /// A tissue with twice the blood and other amounts comes back: what the components say is what the solver says.
    #[test]
    fn blood_and_amounts_of_a_solved_tissue_come_back() {
        let light = Curve::new(vec![400.0, 405.0, 410.0], vec![0.0, 1.0, 0.0]).unwrap();
        let viewing = Viewing::new(&light, Curve::constant(1.0)).unwrap();
        let nm: Vec<f64> = (0..41).map(|i| 500.0 + 5.0 * f64::from(i)).collect();
        let site = lip();
        let view = TissueView { viewing: &viewing, irradiance_w_per_m2: 10.0, wavelengths_nm: &nm };
        let (components, blood) = tissue_mixture(&site, &find, view, &CachedSolutions::default()).unwrap();
        let mut other = site.clone();
        other.set(TISSUE_BLOOD, 2.0 * site.get(TISSUE_BLOOD).unwrap()).unwrap();
        let solved_nm: Vec<f64> = (0..=72).map(|i| 350.0 + 5.0 * f64::from(i)).collect();
        let tissue = other.tissue(&find).unwrap();
        let effective = EffectiveTissue::new(&tissue, &solved_nm, DiscreteOrdinates::DIFFUSE).unwrap();
        let mut radiance = vec![0.0; nm.len()];
        for part in effective.parts() {
            let emitted = viewing.fluorescence(&effective, part, &nm);
            radiance.iter_mut().zip(emitted).for_each(|(sum, value)| *sum += value * 10.0 / PI);
        }
        let mixture = SpectralMixture::new(nm.clone(), components, blood).unwrap();
        // Interpolated between amounts that are a factor 1.41 apart: twice the blood is one of them.
        let amount = 2.0 * site.get(TISSUE_BLOOD).unwrap();
        let fixed = mixture.behind(amount).fit(&radiance, None).unwrap();
        assert!(fixed.relative_rms < 1e-9, "{}", fixed.relative_rms);
        let found = mixture.common_blood(&[(&radiance, None)]).unwrap();
        assert!((found / amount - 1.0).abs() < 0.05, "{found} {amount}");
    }
}
