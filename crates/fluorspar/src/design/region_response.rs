//! What a region sends to the camera, for any light.

use std::f64::consts::PI;

use crate::spectral::{
    Curve, FINE_STEP_NM, Fluorophore, PhotonEem, Stokes, WavelengthGrid, YieldDensity, power_and_moment,
};

/// Excitation at which parts of a region count in ratios, and the emission over which they do, nm.
const REFERENCE_NM: f64 = 405.0;
const COUNTED_NM: [f64; 2] = [500.0, 700.0];

/// How a light is described by a few numbers: its power in each of them. They add up to all power within the basis.
#[derive(Clone, Debug, PartialEq)]
pub enum ExcitationBasis {
    /// Hats: power between two nodes, nm, is shared between them by distance. A response is that to a line at the node; between
    /// nodes it is linear.
    Nodes(Vec<f64>),
    /// Boxes: all power in a bin counts alike. A response is that to even light in the bin.
    Bins(WavelengthGrid),
}

impl ExcitationBasis {
    /// Hats every `step_nm` from `first_nm` to at least `last_nm`.
    pub fn every(first_nm: f64, last_nm: f64, step_nm: f64) -> Self {
        let steps = ((last_nm - first_nm) / step_nm - 1e-9).ceil().max(1.0) as usize;
        Self::Nodes((0..=steps).map(|k| first_nm + k as f64 * step_nm).collect())
    }

    /// How many numbers describe a light.
    pub fn len(&self) -> usize {
        match self {
            Self::Nodes(nodes) => nodes.len(),
            Self::Bins(bins) => bins.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// First and last wavelength that it describes, nm.
    pub fn span_nm(&self) -> [f64; 2] {
        match self {
            Self::Nodes(nodes) => {
                [nodes.first().copied().unwrap_or(0.0), nodes.last().copied().unwrap_or(0.0)]
            }
            Self::Bins(bins) => [bins.start_nm(), bins.end_nm()],
        }
    }

    /// Wavelength of each number, nm: the node, or the center of the bin.
    pub fn centers_nm(&self) -> Vec<f64> {
        match self {
            Self::Nodes(nodes) => nodes.clone(),
            Self::Bins(bins) => bins.centers_nm(),
        }
    }

    /// A light in this basis: the unit of its spectrum times nm.
    pub fn coefficients(&self, light: &Curve) -> Vec<f64> {
        let nodes = match self {
            Self::Bins(bins) => {
                return bins.edges_nm().windows(2).map(|edges| light.integral(edges[0], edges[1])).collect();
            }
            Self::Nodes(nodes) => nodes,
        };
        let mut found = vec![0.0; nodes.len()];
        for (k, pair) in nodes.windows(2).enumerate() {
            let (all, above) = power_and_moment(light, pair[0], pair[1]);
            found[k] += all - above;
            found[k + 1] += above;
        }
        found
    }

    /// Share of a light's power, 0 to 1, that it does not describe.
    pub fn share_outside(&self, light: &Curve) -> f64 {
        let all = light.total();
        let [first, last] = self.span_nm();
        if all > 0.0 { (1.0 - light.integral(first, last) / all).clamp(0.0, 1.0) } else { 0.0 }
    }
}

/// Fluorescence of one fluorophore of a region.
#[derive(Clone, Debug, PartialEq)]
pub struct FluorescenceResponse {
    /// Name of the fluorophore.
    pub name: String,
    /// Its amount, in the unit of its fluorophore; 1 where the scene says how much there is.
    pub amount: f64,
    /// Radiance at this amount, `[emission band][number of the excitation basis]`, W/(sr m² nm) per unit of light.
    pub radiance: Vec<f64>,
}

/// Everything that a region sends to the camera, for any light: fluorescence linear in the light within the basis, and reflected
/// light by wavelength. A flat sample gives it exactly, a render with an excitation basis for a region of its image. Designs of
/// lights, filters, sensors and exposures are arithmetic on it.
///
/// The unit of light is 1 W/m² on a flat sample; in a render it is that of the light group, 1 W, at its place.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionResponse {
    /// Name of the region.
    pub name: String,
    /// Emission bands.
    pub grid: WavelengthGrid,
    /// Basis of the light.
    pub excitation: ExcitationBasis,
    /// Fluorescence, by fluorophore.
    pub fluorescence: Vec<FluorescenceResponse>,
    /// Reflected radiance per spectral unit of light, 1/sr on a flat sample: `R / pi`.
    pub reflected: Curve,
}

impl RegionResponse {
    /// A flat, matte region: its diffuse reflectance, and fluorophores with amounts. Eq. 3 of the paper for lines at the
    /// nodes, `L = Y_e(lo|li) / pi`, averaged over the bands on fine samples.
    pub fn flat(
        name: &str,
        grid: &WavelengthGrid,
        nodes_nm: &[f64],
        reflectance: &Curve,
        fluorophores: &[(Fluorophore, f64)],
    ) -> Self {
        let response = |(fluorophore, amount): &(Fluorophore, f64)| FluorescenceResponse {
            name: fluorophore.name.clone(),
            amount: *amount,
            radiance: line_responses(fluorophore, *amount, grid, nodes_nm),
        };
        Self {
            name: name.into(),
            grid: grid.clone(),
            excitation: ExcitationBasis::Nodes(nodes_nm.to_vec()),
            fluorescence: fluorophores.iter().map(response).collect(),
            reflected: reflectance.scaled(1.0 / PI),
        }
    }

    /// Fluorescent radiance under a light, `[fluorophore][emission band]`, W/(sr m² nm).
    pub fn fluorescence_under(&self, light: &Curve) -> Vec<Vec<f64>> {
        let coefficients = self.excitation.coefficients(light);
        self.fluorescence.iter().map(|f| bands_of(&f.radiance, &coefficients)).collect()
    }

    /// The same region with amounts that have a common unit: each fluorophore counts by the light that it sends from 500 to 700 nm
    /// under light of 405 nm, so that a ratio of amounts is one of fluorescence.
    #[must_use]
    pub fn counted_by_light(mut self) -> Self {
        let line = Curve::from_fn(REFERENCE_NM - 1.0, REFERENCE_NM + 1.0, |_| 0.5);
        let emitted = self.fluorescence_under(&line);
        let grid = &self.grid;
        let counted = |band: usize| {
            let is_counted = (COUNTED_NM[0]..=COUNTED_NM[1]).contains(&grid.center_nm(band));
            if is_counted { grid.width_nm(band) } else { 0.0 }
        };
        for (part, spectrum) in self.fluorescence.iter_mut().zip(emitted) {
            part.amount = spectrum.iter().enumerate().map(|(band, value)| value * counted(band)).sum();
        }
        self
    }
}

/// A matrix of rows by band times the light.
pub(super) fn bands_of(matrix: &[f64], coefficients: &[f64]) -> Vec<f64> {
    let row = |row: &[f64]| row.iter().zip(coefficients).map(|(m, c)| m * c).sum();
    matrix.chunks_exact(coefficients.len().max(1)).map(row).collect()
}

/// Radiance per W/m² of lines, `[band][node]`.
fn line_responses(
    fluorophore: &Fluorophore,
    amount: f64,
    grid: &WavelengthGrid,
    nodes_nm: &[f64],
) -> Vec<f64> {
    let mut radiance = Vec::with_capacity(grid.len() * nodes_nm.len());
    let density = LineDensity::new(fluorophore, nodes_nm);
    for edge in grid.edges_nm().windows(2) {
        let samples = ((edge[1] - edge[0]) / FINE_STEP_NM).ceil().max(1.0) as usize;
        let step = (edge[1] - edge[0]) / samples as f64;
        let mut sums = vec![0.0; nodes_nm.len()];
        for sample in 0..samples {
            density.add(edge[0] + (sample as f64 + 0.5) * step, nodes_nm, &mut sums);
        }
        radiance.extend(sums.into_iter().map(|sum| amount * sum / (samples as f64 * PI)));
    }
    radiance
}

/// Energy yield density of a fluorophore at the nodes of excitation.
struct LineDensity<'a> {
    eem: &'a PhotonEem,
    /// Of each separable term the excitation at the nodes, and the emission; empty for a full matrix.
    terms: Vec<(Vec<f64>, &'a Curve)>,
}

impl<'a> LineDensity<'a> {
    fn new(fluorophore: &'a Fluorophore, nodes_nm: &[f64]) -> Self {
        let eem = &fluorophore.eem;
        let terms = match eem.density() {
            YieldDensity::Separable(terms) => terms
                .iter()
                .map(|term| (nodes_nm.iter().map(|&nm| term.excitation.at(nm)).collect(), &term.emission))
                .collect(),
            YieldDensity::Table(_) => Vec::new(),
        };
        Self { eem, terms }
    }

    /// Adds the density at an emission wavelength; photons become energy by the ratio of wavelengths.
    fn add(&self, emission_nm: f64, nodes_nm: &[f64], sums: &mut [f64]) {
        if self.terms.is_empty() {
            for (sum, &nm) in sums.iter_mut().zip(nodes_nm) {
                *sum += self.eem.at(emission_nm, nm) * nm / emission_nm;
            }
            return;
        }
        let masked = self.eem.stokes() == Stokes::Mask;
        for (excitation, emission) in &self.terms {
            let factor = self.eem.scale() * emission.at(emission_nm) / emission_nm;
            for ((sum, &nm), excited) in sums.iter_mut().zip(nodes_nm).zip(excitation) {
                if !masked || emission_nm > nm {
                    *sum += factor * excited * nm;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::predict;
    use crate::sensor::CaptureFrame;
    use crate::spectral::SeparableTerm;
    use crate::study::{Camera, FlatSample, FluorescenceModel};

    fn bell(center_nm: f64, width_nm: f64) -> Curve {
        Curve::from_fn(300.0, 800.0, |nm| (-((nm - center_nm) / width_nm).powi(2)).exp())
    }

    fn fluorophore() -> Fluorophore {
        let emission = bell(520.0, 35.0);
        let emission = emission.scaled(1.0 / emission.total());
        let term = SeparableTerm { excitation: bell(390.0, 30.0).scaled(1e-3), emission };
        Fluorophore {
            name: "test".into(),
            title: "test".into(),
            eem: PhotonEem::separable(vec![term], Stokes::Mask),
            excitation_range_nm: (350.0, 450.0),
            emission_range_nm: (450.0, 750.0),
            source: "test".into(),
        }
    }

    #[test]
    fn a_basis_keeps_power_and_mean_wavelength() {
        let light = bell(403.3, 9.0).scaled(2.0);
        let hats = ExcitationBasis::every(340.0, 500.0, 5.0);
        let found = hats.coefficients(&light);
        let power: f64 = found.iter().sum();
        let mean = found.iter().zip(hats.centers_nm()).map(|(c, nm)| c * nm).sum::<f64>() / power;
        // The curve is piecewise linear on 0.5 nm; its first moment is exact there as well.
        assert!((power / light.total() - 1.0).abs() < 1e-12, "{power}");
        assert!((mean - 403.3).abs() < 1e-3, "{mean}");
        let bins = ExcitationBasis::Bins(WavelengthGrid::uniform(340.0, 500.0, 5.0).unwrap());
        assert!((bins.coefficients(&light).iter().sum::<f64>() / light.total() - 1.0).abs() < 1e-12);
        assert!(hats.share_outside(&bell(340.0, 9.0)) > 0.49);
        assert_eq!((hats.len(), bins.len()), (33, 33));
    }

    /// Hats of 2 nm against the integral of `predict`: the error of linear interpolation is at most `step²/8` of the curvature
    /// of the excitation spectrum, `2/30²` of its peak, so 1.1e-3 of the peak; averaged over a light of 9 nm it is smaller.
    #[test]
    fn a_flat_region_sends_what_predict_says() {
        let grid = WavelengthGrid::default();
        let nodes = ExcitationBasis::every(340.0, 500.0, 2.0).centers_nm();
        let reflectance = Curve::from_fn(300.0, 800.0, |nm| 0.1 + (nm - 300.0) * 4e-4);
        let held = vec![(fluorophore(), 0.7)];
        let region = RegionResponse::flat("patch", &grid, &nodes, &reflectance, &held);
        for peak_nm in [375.0, 405.0, 421.0] {
            let light = bell(peak_nm, 9.0).scaled(3.0);
            let sample = FlatSample {
                grid: grid.clone(),
                irradiance: light.clone(),
                reflectance: reflectance.clone(),
                fluorophores: held.clone(),
                porphyrin: None,
                model: FluorescenceModel::Physical,
                camera: Camera::default(),
                exposure: CaptureFrame {
                    label: "x".into(),
                    lights: std::collections::BTreeMap::new(),
                    exposure_ms: Some(1.0),
                    auto_exposure: None,
                    gain: 1.0,
                },
            };
            let expected = predict(&sample).unwrap().radiance;
            let largest = expected.fluorescence["test"].iter().copied().fold(0.0, f64::max);
            for (ours, theirs) in
                region.fluorescence_under(&light)[0].iter().zip(&expected.fluorescence["test"])
            {
                assert!((ours - theirs).abs() < 1.1e-3 * largest, "{peak_nm}: {ours} {theirs}");
            }
            let reflected = light.times(&region.reflected).bin_averages(&grid);
            for (ours, theirs) in reflected.iter().zip(&expected.reflected) {
                assert!((ours - theirs).abs() < 1e-12, "{ours} {theirs}");
            }
        }
    }
}
