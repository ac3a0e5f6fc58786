//! The figures of a report, from plain data.
//!
//! Each function chooses round axis limits, draws names and units, and writes an explanation that a reader who has seen only
//! the paper's abstract can follow.

mod chain;
mod chromaticity;
mod eem;
mod filters;
mod histogram;
mod lens;
mod lights;
mod mixture;
mod photon_transfer;
mod picture;
mod radiance;
mod reflectance;
mod sensor;
mod share_map;
mod sweep;
mod tissue;

pub use chain::chain;
pub use chromaticity::{ChromaticityPlot, chromaticity};
pub use eem::{EemMap, eem_maps, emission};
pub use filters::filters;
pub use histogram::{ChannelValues, histograms};
pub use lens::{lens_drawing, lens_field, lens_mtf, lens_spots};
pub use lights::{LIGHT_DECADES, lights};
pub use mixture::{MixturePlot, mixture_fit};
pub use photon_transfer::{PhotonTransferPlot, SnrPlot, photon_transfer, signal_to_noise};
pub use picture::{PorphyrinQuantity, picture, pictures, porphyrin_map, porphyrin_maps};
pub use radiance::{radiance_by_component, spectral_readings};
pub use reflectance::reflectances;
pub use sensor::sensor_response;
pub(crate) use share_map::ShareMap;
pub use share_map::{share_map, share_map_of_blocks};
pub use sweep::{SweptQuantity, swept_quantities, swept_spectra};
pub use tissue::{
    EstimatedCurve, SpectrumFit, light_by_depth, light_by_radius, light_sources_by_depth, spectrum_fits,
    tissue_reflectance,
};

/// A function of wavelength with a name.
#[derive(Clone, Debug, PartialEq)]
pub struct PlotCurve {
    /// Name in the legend.
    pub name: String,
    /// Wavelengths, nm, increasing.
    pub wavelength_nm: Vec<f64>,
    /// One value per wavelength.
    pub value: Vec<f64>,
}

impl PlotCurve {
    /// A curve from its samples.
    pub fn new(name: impl Into<String>, wavelength_nm: Vec<f64>, value: Vec<f64>) -> Self {
        Self { name: name.into(), wavelength_nm, value }
    }

    fn points(&self) -> Vec<[f64; 2]> {
        self.mapped(|value| value)
    }

    fn mapped(&self, f: impl Fn(f64) -> f64) -> Vec<[f64; 2]> {
        self.wavelength_nm.iter().zip(&self.value).map(|(&nm, &value)| [nm, f(value)]).collect()
    }

    fn peak(&self) -> f64 {
        self.value.iter().copied().filter(|value| value.is_finite()).fold(0.0, f64::max)
    }
}

/// Wavelength limits that hold all curves, on multiples of 10 nm.
fn wavelength_limits<'a>(curves: impl IntoIterator<Item = &'a PlotCurve>) -> [f64; 2] {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for nm in curves.into_iter().flat_map(|curve| &curve.wavelength_nm) {
        low = low.min(*nm);
        high = high.max(*nm);
    }
    if low < high { [(low / 10.0).floor() * 10.0, (high / 10.0).ceil() * 10.0] } else { [350.0, 750.0] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Figure, Raster, Scale};

    fn swept(curves: &[PlotCurve]) -> [SweptQuantity; 1] {
        let curves = curves.iter().map(|curve| (curve.name.clone(), curve.points())).collect();
        [SweptQuantity { label: "depth".into(), unit: "µm".into(), curves }]
    }

    fn all(
        curves: &[PlotCurve],
        map: &EemMap,
        plot: &ChromaticityPlot,
        values: &[ChannelValues],
    ) -> Vec<Figure> {
        let raster = Raster::from_fn(2, 1, |_, _| [9; 3]);
        vec![
            lights(curves, curves),
            filters(curves),
            eem_maps(std::slice::from_ref(map), Some(385.0)),
            eem_maps(&[], None),
            emission(curves, "light", "each at concentration 1", ["emission", "W"], Some([450.0, 700.0])),
            sensor_response(curves, &[("filtered".into(), curves.to_vec())]),
            radiance_by_component(curves.first(), curves.last(), curves, "tongue", Scale::Linear),
            radiance_by_component(None, None, curves, "tongue", Scale::Log10),
            spectral_readings("readings", curves),
            chromaticity(plot),
            histograms("blue", values, 4000.0, Some("ambient")),
            picture("picture", raster, Some([0.0, 0.0, 1.0, 1.0])),
            swept_spectra("spectra", ["reflectance", ""], curves),
            swept_quantities("sweep", "blood", 0.5, &swept(curves)),
        ]
    }

    #[test]
    fn every_figure_stands_any_data() {
        let nan = f64::NAN;
        let curve = |value: [f64; 3]| PlotCurve::new("c", vec![400.0, 500.0, 600.0], value.to_vec());
        let odd = [curve([0.0; 3]), curve([nan, -1.0, f64::INFINITY]), PlotCurve::new("", vec![], vec![])];
        let map = |values: Vec<f64>, columns| EemMap {
            name: "m".into(),
            excitation_nm: [300.0, 400.0],
            emission_nm: [400.0, 500.0],
            columns,
            values,
        };
        let plot = ChromaticityPlot {
            pixels: vec![[nan, 0.5], [0.3, 0.3]],
            fluorophores: vec![("out of view".into(), [7.0, 0.1]), ("NaN".into(), [nan, nan])],
            mixture_line: Some([[0.1, 0.5], [0.8, 0.1]]),
            ..ChromaticityPlot::default()
        };
        let values = [ChannelValues { name: "R".into(), values: vec![f32::NAN, -9e9, 9e9, 5.0] }];
        let mut figures = all(&odd, &map(vec![nan, 0.0, 1.0, 2.0], 2), &plot, &values);
        figures.extend(all(&[], &map(vec![], 0), &ChromaticityPlot::default(), &[]));
        let points = vec![[nan, 1.0], [0.0, 0.0], [-1.0, f64::INFINITY], [1e9, 1e-9]];
        figures.extend([vec![], points].map(|points| {
            photon_transfer(&PhotonTransferPlot {
                points,
                gain_dn_per_e: nan,
                ..PhotonTransferPlot::default()
            })
        }));
        figures.extend(
            [vec![], vec![[nan, -1.0], [0.0, 3.0]]].map(|temporal| {
                signal_to_noise(&SnrPlot { temporal, threshold_e: nan, ..SnrPlot::default() })
            }),
        );
        for figure in figures {
            let svg = figure.to_svg();
            assert!(!svg.contains("NaN\"") && !svg.contains("inf"), "{}", figure.title);
            assert!(figure.to_png().is_ok(), "{}", figure.title);
            let svg_size = svg.split('"').nth(3).and_then(|width| width.parse::<f64>().ok());
            let png_width =
                crate::figure::png_size(&figure.to_png().unwrap()).map(|[width, _]| f64::from(width));
            assert_eq!(png_width, svg_size.map(|width| 2.0 * width), "{}", figure.title);
        }
    }
}
