//! The light of a frame, kept apart by what its spectrum looks like within a band.
//!
//! A band of a render holds one number. Behind a filter whose edge is steeper than a band is wide, it matters how the light
//! is spread within it: reflected light has the spectrum of its source there, which may fall by decades toward the edge of the
//! viewing filter, and the mean of a product is not the product of means. Fluorescence is smooth.

use super::direct_light::group_spectrum;
use crate::image::{ComponentImage, LightPath, SpectralImage};
use crate::sensor::CaptureFrame;
use crate::spectral::{Curve, Radiance, Transmittance, WavelengthGrid};
use crate::study::Study;

/// Radiance of one shape.
pub(in crate::pipeline) struct ShapedRadiance {
    pub(in crate::pipeline) radiance: SpectralImage<Radiance>,
    /// Spectrum within each band, up to a factor; `None` is even.
    pub(in crate::pipeline) shape: Option<Curve>,
}

/// Splits the light of a frame: all fluorescence, then reflected light by light group. The sum is
/// [`super::frame_radiance`]. One image is made at a time.
pub(in crate::pipeline) fn light_by_shape<'a>(
    study: &'a Study,
    frame: &'a CaptureFrame,
    components: &'a ComponentImage,
) -> impl Iterator<Item = ShapedRadiance> + 'a {
    let fluorescence = std::iter::once_with(move || ShapedRadiance {
        radiance: components.recombine(|c| match c.light {
            LightPath::Reflected => 0.0,
            _ => frame.drive(&c.light_group),
        }),
        shape: None,
    });
    let reflected = components.components.iter().filter(|c| c.light == LightPath::Reflected);
    let reflected =
        reflected.filter(|c| frame.drive(&c.light_group) != 0.0).map(move |component| ShapedRadiance {
            radiance: components.recombine(
                |c| {
                    if c == component { frame.drive(&c.light_group) } else { 0.0 }
                },
            ),
            shape: group_spectrum(study, &component.light_group),
        });
    fluorescence.chain(reflected)
}

/// Transmittance of a filter for light of a spectral shape over that for a flat spectrum, per band.
pub(super) fn transmittance_ratio(
    filter: &Curve,
    shape: Option<&Curve>,
    grid: &WavelengthGrid,
) -> Option<Vec<f64>> {
    let shaped = filter.on_grid_under::<Transmittance>(grid, shape?);
    let even = filter.on_grid::<Transmittance>(grid);
    let ratio = |(shaped, even): (&f64, &f64)| if *even > 0.0 { shaped / even } else { 1.0 };
    Some(shaped.values().iter().zip(even.values()).map(ratio).collect())
}
