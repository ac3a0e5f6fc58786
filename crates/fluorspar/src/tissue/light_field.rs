//! Light in and around a stack of layers, as the deterministic solver found it.

use super::angular_quadrature::{AngularQuadrature, cosine};
use super::beam_source::difference_quotient;
use super::fresnel_interface::fresnel_reflectance;
use super::optical_layer::OpticalStack;

/// Light in a stack of layers per unit of irradiance from above.
///
/// `specular_reflectance + reflectance + transmittance + absorbed = 1` to rounding.
pub struct LightField {
    /// Share of the light that the uppermost surface reflects at once.
    pub specular_reflectance: f64,
    /// Share of the light that leaves above after it was inside.
    pub reflectance: f64,
    /// Share of the light that leaves below, the unscattered beam included.
    pub transmittance: f64,
    /// Share of the light that each layer absorbs.
    pub absorbed: Vec<f64>,
    pub(super) layers: Vec<LayerField>,
    pub(super) leaving: LeavingLight,
}

/// Light that leaves above.
pub(super) struct LeavingLight {
    pub(super) quadrature: AngularQuadrature,
    /// Upward radiance just below the surface over the square of the index, at the ordinates of the first layer, 1/sr.
    pub(super) basic_radiance: Vec<f64>,
    pub(super) index_above: f64,
    pub(super) index_of_first: f64,
}

/// Fluence in one layer: modes, and a beam in both directions.
pub(super) struct LayerField {
    pub(super) thickness_mm: f64,
    pub(super) decay_per_mm: Vec<f64>,
    /// Fluence of each mode at the top and at the bottom.
    pub(super) top: Vec<f64>,
    pub(super) bottom: Vec<f64>,
    pub(super) beam: Option<BeamFluence>,
}

/// Fluence of a beam and of what one layer scatters out of it, per unit of flux.
pub(super) struct BeamFluence {
    pub(super) decay_per_mm: f64,
    /// 1 / cosine.
    pub(super) unscattered: f64,
    /// Of each mode, times [`difference_quotient`].
    pub(super) scattered: Vec<f64>,
    /// Flux that enters at the top and at the bottom.
    pub(super) flux: [f64; 2],
}

impl LayerField {
    /// Fluence at a depth below the top of the layer.
    fn fluence(&self, z: f64) -> f64 {
        let h = self.thickness_mm;
        let modes = self.decay_per_mm.iter().zip(self.top.iter().zip(&self.bottom));
        let diffuse: f64 = modes
            .map(|(&k, (top, bottom))| top * hyperbolic(k, h - z, h) + bottom * hyperbolic(k, z, h))
            .sum();
        let beam = |b: &BeamFluence| {
            b.flux[0] * b.at(&self.decay_per_mm, z) + b.flux[1] * b.at(&self.decay_per_mm, h - z)
        };
        diffuse + self.beam.as_ref().map_or(0.0, beam)
    }
}

impl BeamFluence {
    fn at(&self, decay_per_mm: &[f64], z: f64) -> f64 {
        let scattered = self.scattered.iter().zip(decay_per_mm);
        self.unscattered * (-self.decay_per_mm * z).exp()
            + scattered.map(|(s, &k)| s * difference_quotient(self.decay_per_mm, k, z)).sum::<f64>()
    }
}

/// `sinh(k x) / sinh(k h)`.
fn hyperbolic(k: f64, x: f64, h: f64) -> f64 {
    if k * h < 1e-6 {
        return x / h;
    }
    (-k * (h - x)).exp() * (-2.0 * k * x).exp_m1() / (-2.0 * k * h).exp_m1()
}

impl LightField {
    /// Fluence (light from all directions, W/m² per W/m² of irradiance) at a depth below the top of a layer, mm.
    ///
    /// Layers count from 0, the uppermost. Depths are held within the layer; 0 for a layer that does not exist.
    #[must_use]
    pub fn layer_fluence(&self, layer: usize, depth_mm: f64) -> f64 {
        self.layers.get(layer).map_or(0.0, |field| field.fluence(depth_mm.clamp(0.0, field.thickness_mm)))
    }

    /// Fluence at a depth below the surface, mm. On an interface it is that of the layer below, which differs from that
    /// above where the refractive indices do; depths are held within the stack.
    #[must_use]
    pub fn fluence(&self, depth_mm: f64) -> f64 {
        let mut below_top = depth_mm;
        for (layer, field) in self.layers.iter().enumerate() {
            if below_top < field.thickness_mm || layer + 1 == self.layers.len() {
                return self.layer_fluence(layer, below_top);
            }
            below_top -= field.thickness_mm;
        }
        0.0
    }

    /// Radiance, per unit of irradiance, 1/sr, that leaves above under a cosine to the normal (0 to 1) after it was inside.
    /// Averaged over azimuth.
    #[must_use]
    pub fn radiance_above(&self, cosine_outside: f64) -> f64 {
        let leaving = &self.leaving;
        let mu = cosine_outside.clamp(0.0, 1.0);
        let lateral = leaving.index_above * (1.0 - mu * mu).sqrt();
        if lateral >= leaving.index_of_first {
            return 0.0;
        }
        let inside = cosine(lateral, leaving.index_of_first);
        let passes = 1.0 - fresnel_reflectance(inside, leaving.index_of_first, leaving.index_above);
        passes
            * leaving.index_above.powi(2)
            * leaving.quadrature.interpolate(&leaving.basic_radiance, lateral)
    }
}

impl LeavingLight {
    pub(super) fn new(stack: &OpticalStack, quadrature: AngularQuadrature, basic_radiance: Vec<f64>) -> Self {
        Self {
            quadrature,
            basic_radiance,
            index_above: stack.index_above,
            index_of_first: stack.layers[0].refractive_index,
        }
    }
}
