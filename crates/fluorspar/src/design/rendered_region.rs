//! What a region of a rendered image sends, for any light.

use super::region_response::{ExcitationBasis, FluorescenceResponse, RegionResponse};
use crate::image::{GroupBasis, LightPath};
use crate::spectral::{Curve, WavelengthGrid};

impl RegionResponse {
    /// The mean over pixels of a render, whose numbers count row by row, under a light group that it keeps apart by excitation
    /// wavelength. Light that fluoresced more than once is a fluorophore of its own, `multiple`.
    pub fn of_render(name: &str, grid: &WavelengthGrid, group: &GroupBasis, pixels: &[usize]) -> Self {
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
                LightPath::MultipleFluorescence => "multiple".into(),
            };
            let of_band = |band: usize| {
                group.nodes.line_responses(mean.iter().skip(band).step_by(grid.len()).copied().collect())
            };
            let radiance = (0..grid.len()).flat_map(of_band).collect();
            region.fluorescence.push(FluorescenceResponse { name, amount: 1.0, radiance });
        }
        region
    }
}
