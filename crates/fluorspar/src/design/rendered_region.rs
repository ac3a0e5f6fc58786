//! What a region of a rendered image sends, for any light.

use super::region_response::{ExcitationBasis, FluorescenceResponse, RegionResponse};
use crate::image::{GroupBasis, LightPath};
use crate::spectral::{Curve, WavelengthGrid};

/// Name of the light that fluoresced more than once.
const MULTIPLE: &str = "multiple";

impl RegionResponse {
    /// The mean over pixels of a render under a light group that it keeps apart by excitation wavelength. A pixel is its number, row
    /// by row, with a factor: how much of its light arrives on the film, compared with the axis. Light that fluoresced more than
    /// once is a fluorophore of its own, `multiple`.
    pub fn of_render(name: &str, grid: &WavelengthGrid, group: &GroupBasis, pixels: &[(usize, f64)]) -> Self {
        let mut region = Self {
            name: name.into(),
            grid: grid.clone(),
            excitation: ExcitationBasis::Nodes(group.nodes.nodes_nm().to_vec()),
            fluorescence: Vec::new(),
            reflected: Curve::constant(0.0),
        };
        for component in group.components.iter().filter(|component| component.rank > 0) {
            let mean = component.mean_of(pixels);
            let name = match &component.light {
                LightPath::Reflected => {
                    let reflected = Curve::new(grid.centers_nm(), mean);
                    region.reflected = reflected.unwrap_or_else(|_| Curve::constant(0.0));
                    continue;
                }
                LightPath::Fluorescence(name) => name.clone(),
                LightPath::MultipleFluorescence => MULTIPLE.into(),
            };
            let of_band = |band: usize| {
                group.nodes.line_responses(mean.iter().skip(band).step_by(grid.len()).copied().collect())
            };
            let radiance = (0..grid.len()).flat_map(of_band).collect();
            region.fluorescence.push(FluorescenceResponse { name, amount: 1.0, radiance });
        }
        region
    }

    /// Fluorophores of the region that send a share of its fluorescence or more under some excitation, in their order: the others are what
    /// surfaces around it throw on it.
    pub fn own_fluorophores(&self, least_share: f64) -> Vec<String> {
        let nodes = self.excitation.len();
        let sum_at = |f: &FluorescenceResponse, node: usize| -> f64 {
            f.radiance.iter().skip(node).step_by(nodes).map(|value| value.max(0.0)).sum()
        };
        let total_at = |node| self.fluorescence.iter().map(|f| sum_at(f, node)).sum::<f64>();
        let totals: Vec<f64> = (0..nodes).map(total_at).collect();
        let is_own = |f: &&FluorescenceResponse| {
            f.name != MULTIPLE && (0..nodes).any(|node| sum_at(f, node) > least_share * totals[node])
        };
        self.fluorescence.iter().filter(is_own).map(|f| f.name.clone()).collect()
    }

    /// The same region with the weights of some fluorophores only. The light of the others, and what fluoresced more than once, is
    /// shared among them, in proportion at each excitation and emission: nothing is lost, and nobody estimates what is not there. A
    /// fluorophore that the region does not hold is dark.
    #[must_use]
    pub fn with_weights_of(&self, names: &[String]) -> Self {
        let is_kept = |f: &&FluorescenceResponse| names.contains(&f.name);
        let sum = |parts: &[&FluorescenceResponse]| -> Vec<f64> {
            let mut sum = vec![0.0; self.grid.len() * self.excitation.len()];
            for part in parts {
                sum.iter_mut().zip(&part.radiance).for_each(|(sum, value)| *sum += value);
            }
            sum
        };
        let all = sum(&self.fluorescence.iter().collect::<Vec<_>>());
        let kept = sum(&self.fluorescence.iter().filter(is_kept).collect::<Vec<_>>());
        let factor = |k: usize| if kept[k] > 0.0 { (all[k] / kept[k]).max(0.0) } else { 1.0 };
        let with_share = |name: &String| {
            let own = self.fluorescence.iter().find(|f| f.name == *name);
            let radiance = match own {
                Some(own) => own.radiance.iter().enumerate().map(|(k, value)| value * factor(k)).collect(),
                None => vec![0.0; all.len()],
            };
            FluorescenceResponse { name: name.clone(), amount: own.map_or(0.0, |own| own.amount), radiance }
        };
        Self { fluorescence: names.iter().map(with_share).collect(), ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_of_others_is_shared_and_none_is_lost() {
        let part = |name: &str, values: [f64; 4]| FluorescenceResponse {
            name: name.into(),
            amount: 1.0,
            radiance: values.into(),
        };
        let region = RegionResponse {
            name: "x".into(),
            grid: WavelengthGrid::uniform(500.0, 510.0, 10.0).unwrap(),
            excitation: ExcitationBasis::Nodes(vec![380.0, 400.0]),
            fluorescence: vec![
                part("a", [3.0, 1.0, 2.0, 1.0]),
                part("b", [1.0, 1.0, 0.0, 3.0]),
                part("c", [0.001, 0.0, 0.001, 0.0]),
                part(MULTIPLE, [0.2, 0.1, 0.3, 0.1]),
            ],
            reflected: Curve::constant(0.0),
        };
        let own = region.own_fluorophores(0.01);
        assert_eq!(own, ["a", "b"]);
        let shared = region.with_weights_of(&own);
        for k in 0..4 {
            let sum =
                |region: &RegionResponse| -> f64 { region.fluorescence.iter().map(|f| f.radiance[k]).sum() };
            assert!((sum(&shared) - sum(&region)).abs() < 1e-12);
        }
        // In proportion: 3 to 1 of 4.201
        assert!((shared.fluorescence[0].radiance[0] - 3.0 * 4.201 / 4.0).abs() < 1e-12);
    }
}
