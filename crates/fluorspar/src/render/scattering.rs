//! What a material does to light at one point, for one direction of view: values, densities and samples, all scalar.
//!
//! A lobe that depends on the wavelength is written as `diffuse * spectrum + gloss`, with one spectrum per vertex: the
//! diffuse reflectance, the reflectance of a metal at normal incidence, the transmittance of a clear body.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::compiled_scene::{CompiledMaterial, CompiledScattering, CompiledScene};
use crate::material::conductor::{mirror_lobe, white_microfacets};
use crate::material::{
    AlbedoTable, CoatAlbedo, ConductorReflectance, DielectricAlbedo, MIN_ROUGHNESS, coat, dielectric,
};
use crate::sampling::warp;

/// Value of a BSDF for one incident direction: throughput factors, cosine included, in 1/sr; of a delta lobe without the delta
/// function.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct BsdfValue {
    /// Times the spectrum of the vertex. May be negative where `gloss` outweighs it.
    pub(super) diffuse: f32,
    /// Of the fluorescence operators.
    pub(super) fluorescent: f32,
    /// The same for all wavelengths. May be negative where `diffuse` outweighs it.
    pub(super) gloss: f32,
    /// Density with which the direction is drawn, 1/sr. For a mirror direction the probability of drawing it.
    pub(super) pdf: f32,
}

/// A direction drawn for the path to go on.
#[derive(Clone, Copy, Debug)]
pub(super) struct BsdfSample {
    /// Unit direction of the arriving light, local, away from the surface.
    pub(super) incident: Vec3,
    pub(super) value: BsdfValue,
    /// Delta lobe: skipped by next-event estimation.
    pub(super) delta: bool,
}

/// A material at a point.
pub(super) struct Bsdf<'a> {
    form: Form<'a>,
    /// Unit direction to the viewer, local, z > 0.
    outgoing: Vec3,
    /// Chance to draw from the cosine lobe instead of the specular one.
    cosine_probability: f32,
}

enum Form<'a> {
    Lambertian,
    Coated {
        table: &'a CoatAlbedo,
        alpha: f32,
        /// Share of light that passes the coat on the way out, and the mean share that it reflects.
        pass_out: f32,
        mean: f32,
    },
    Dielectric {
        table: &'a DielectricAlbedo,
        /// `None` is smooth.
        alpha: Option<f32>,
        inside: bool,
        /// Index on the far side over that on the side of the viewer.
        eta: f32,
        fluoresces: bool,
    },
    Conductor {
        metal: &'a ConductorReflectance,
        viewer: usize,
        /// Albedo of microfacets that reflect everything.
        white: &'a AlbedoTable,
        alpha: Option<f32>,
    },
}

/// Least share of samples for the light that rough microfacets scatter more than once.
const LEAST_COSINE: f32 = 0.02;
/// Share of samples for the fluorescence of clear bodies and metals.
const FLUORESCENT_SHARE: f32 = 0.4;

impl CompiledScene {
    /// The material of an object at a point: draws one of a mixture and reuses what is left of the number.
    #[inline]
    pub(super) fn material_at(&self, mut material: usize, uv: Vec2, front: bool, choice: &mut f32) -> usize {
        loop {
            match &self.materials[material].scattering {
                CompiledScattering::Mix { first, second, amount } => {
                    let amount = amount.at(uv).clamp(0.0, 1.0);
                    if *choice < amount {
                        *choice /= amount;
                        material = *second;
                    } else {
                        *choice = ((*choice - amount) / (1.0 - amount)).clamp(0.0, 0.999_999_9);
                        material = *first;
                    }
                }
                CompiledScattering::TwoSided { front: ahead, back } => {
                    material = if front { *ahead } else { *back };
                }
                _ => return material,
            }
        }
    }

    /// A material that is no mixture, seen from `outgoing` on the front or on the back.
    #[inline]
    pub(super) fn bsdf<'a>(
        &'a self,
        material: &'a CompiledMaterial,
        uv: Vec2,
        front: bool,
        outgoing: Vec3,
    ) -> Bsdf<'a> {
        let fluoresces = !material.fluorophores.is_empty();
        let rough = |alpha: f32| (alpha >= MIN_ROUGHNESS).then_some(alpha.min(1.0));
        let (form, cosine_probability) = match &material.scattering {
            CompiledScattering::Dielectric { table, roughness } => {
                let (table, alpha) = (&self.dielectrics[*table], rough(roughness.at(uv)));
                let index = table.refractive_index();
                let eta = if front { index } else { 1.0 / index };
                let lost =
                    alpha.map_or(0.0, |alpha| table.loss(!front, outgoing.z, alpha).0.max(LEAST_COSINE));
                let share = if fluoresces { FLUORESCENT_SHARE } else { 0.0 };
                (Form::Dielectric { table, alpha, inside: !front, eta, fluoresces }, lost.max(share))
            }
            CompiledScattering::Conductor { metal, roughness } => {
                let alpha = rough(roughness.at(uv));
                let lost =
                    alpha.map_or(0.0, |a| (1.0 - white_microfacets().at(outgoing.z, a).0).max(LEAST_COSINE));
                let share = if fluoresces { FLUORESCENT_SHARE } else { 0.0 };
                let metal = &self.metals[*metal];
                let viewer = metal.viewer(outgoing.z);
                (Form::Conductor { metal, viewer, white: white_microfacets(), alpha }, lost.max(share))
            }
            _ => match &material.coat {
                None => (Form::Lambertian, 1.0),
                Some((table, roughness)) => {
                    let alpha = roughness.at(uv).clamp(MIN_ROUGHNESS, 1.0);
                    let table = &self.coats[*table];
                    let (albedo, mean) = table.at(outgoing.z, alpha);
                    let pass_out = 1.0 - albedo;
                    let base = pass_out * material.albedo_bound.min(1.0);
                    let coat = if base <= 0.0 { 1.0 } else { (albedo / (albedo + base)).clamp(0.1, 0.9) };
                    (Form::Coated { table, alpha, pass_out, mean }, 1.0 - coat)
                }
            },
        };
        Bsdf { form, outgoing, cosine_probability }
    }
}

impl Bsdf<'_> {
    /// Whether light may arrive from behind.
    pub(super) fn transmits(&self) -> bool {
        matches!(self.form, Form::Dielectric { .. })
    }

    /// Weight of a term of the material's spectrum here, where its texture has `value`: for metals by the angle of view.
    #[inline]
    pub(super) fn term_weight(&self, term: usize, value: f32) -> f32 {
        match &self.form {
            Form::Conductor { metal, viewer, .. } => metal.weights(*viewer)[term],
            _ => value,
        }
    }

    /// Light from a direction, mirror directions left out.
    #[inline]
    pub(super) fn evaluate(&self, incident: Vec3) -> BsdfValue {
        let outgoing = self.outgoing;
        if incident.z == 0.0 || (incident.z < 0.0 && !self.transmits()) {
            return BsdfValue::default();
        }
        let lambert = incident.z.abs() / PI;
        match &self.form {
            Form::Lambertian => {
                BsdfValue { diffuse: lambert, fluorescent: lambert, gloss: 0.0, pdf: lambert }
            }
            Form::Coated { table, alpha, pass_out, mean } => {
                let pass_in = 1.0 - table.at(incident.z, *alpha).0;
                let (gloss, pdf) = coat::eval_and_pdf(outgoing, incident, *alpha, table.refractive_index());
                BsdfValue {
                    diffuse: lambert * pass_in * pass_out / (1.0 - mean),
                    fluorescent: lambert * pass_in,
                    gloss,
                    pdf: (1.0 - self.cosine_probability) * pdf + self.cosine_probability * lambert,
                }
            }
            Form::Dielectric { table, alpha, inside, eta, fluoresces } => {
                let behind = incident.z < 0.0;
                let fluorescent = if *fluoresces {
                    // Half of the light that a thin film emits leaves to either side.
                    let eta = if behind { 1.0 / eta } else { *eta };
                    0.5 * lambert * (1.0 - coat::fresnel(incident.z.abs(), eta))
                } else {
                    0.0
                };
                let Some(alpha) = *alpha else {
                    let pdf = self.cosine_probability * 0.5 * lambert;
                    return BsdfValue { diffuse: 0.0, fluorescent, gloss: 0.0, pdf };
                };
                let (value, pdf) = if behind {
                    dielectric::transmission(outgoing, incident, alpha, *eta)
                } else {
                    dielectric::reflection(outgoing, incident, alpha, *eta)
                };
                let value = value + table.diffuse(*inside, outgoing, incident, alpha);
                let through = self.transmitted_share();
                let side = if behind { through } else { 1.0 - through };
                let pdf = (1.0 - self.cosine_probability) * pdf + self.cosine_probability * side * lambert;
                let (diffuse, gloss) = if behind { (value, 0.0) } else { (0.0, value) };
                BsdfValue { diffuse, fluorescent, gloss, pdf }
            }
            Form::Conductor { metal, viewer, white, alpha } => {
                let fluorescent = lambert * (1.0 - metal.largest_at(incident.z));
                let Some(alpha) = *alpha else {
                    let pdf = self.cosine_probability * lambert;
                    return BsdfValue { diffuse: 0.0, fluorescent, gloss: 0.0, pdf };
                };
                let half = (outgoing + incident).normalize_or_zero();
                let (pdf, lobe) =
                    if half.z > 0.0 { mirror_lobe(outgoing, incident, half, alpha) } else { (0.0, 0.0) };
                let (a, b) = metal.at_angle(*viewer, outgoing.dot(half));
                let (albedo_o, mean) = white.at(outgoing.z, alpha);
                let albedo_i = white.at(incident.z, alpha).0;
                let multiple =
                    lambert * (1.0 - albedo_o).max(0.0) * (1.0 - albedo_i).max(0.0) / (1.0 - mean).max(1e-6);
                let (c, d) = metal.multiple(*viewer, alpha);
                BsdfValue {
                    diffuse: lobe * a + multiple * c,
                    fluorescent,
                    gloss: lobe * b + multiple * d,
                    pdf: (1.0 - self.cosine_probability) * pdf + self.cosine_probability * lambert,
                }
            }
        }
    }

    /// Draws a direction for the path to go on; `None` ends the path.
    #[inline]
    pub(super) fn sample(&self, choice: f32, u: [f32; 2]) -> Option<BsdfSample> {
        let specular_probability = 1.0 - self.cosine_probability;
        if choice >= specular_probability {
            let rest = (choice - specular_probability) / self.cosine_probability;
            let mut incident = warp::cosine_hemisphere(u);
            if self.transmits() && rest < self.transmitted_share() {
                incident.z = -incident.z;
            }
            return self.drawn(incident);
        }
        let choice = choice / specular_probability;
        let outgoing = self.outgoing;
        match &self.form {
            Form::Lambertian => None,
            Form::Coated { alpha, .. } => self.drawn(coat::sample(outgoing, *alpha, u)?.incident),
            Form::Dielectric { alpha: Some(alpha), eta, .. } => {
                self.drawn(dielectric::sample(outgoing, *alpha, *eta, choice, u)?)
            }
            Form::Conductor { alpha: Some(alpha), .. } => {
                self.drawn(coat::sample(outgoing, *alpha, u)?.incident)
            }
            Form::Dielectric { alpha: None, eta, .. } => {
                let reflected = coat::fresnel(outgoing.z, *eta);
                let mut scattering = BsdfValue::default();
                let incident = if choice < reflected {
                    scattering.gloss = reflected;
                    scattering.pdf = reflected * specular_probability;
                    Vec3::new(-outgoing.x, -outgoing.y, outgoing.z)
                } else {
                    // Radiance over the square of the index is kept.
                    scattering.diffuse = (1.0 - reflected) / (eta * eta);
                    scattering.pdf = (1.0 - reflected) * specular_probability;
                    dielectric::refract(outgoing, Vec3::Z, *eta)?
                };
                Some(BsdfSample { incident, value: scattering, delta: true })
            }
            Form::Conductor { metal, viewer, alpha: None, .. } => {
                let (a, b) = metal.at_angle(*viewer, outgoing.z);
                let scattering =
                    BsdfValue { diffuse: a, fluorescent: 0.0, gloss: b, pdf: specular_probability };
                let incident = Vec3::new(-outgoing.x, -outgoing.y, outgoing.z);
                Some(BsdfSample { incident, value: scattering, delta: true })
            }
        }
    }

    #[inline]
    fn drawn(&self, incident: Vec3) -> Option<BsdfSample> {
        let scattering = self.evaluate(incident);
        (scattering.pdf > 0.0).then_some(BsdfSample { incident, value: scattering, delta: false })
    }

    /// Share of the cosine lobe that looks for light behind the surface.
    fn transmitted_share(&self) -> f32 {
        match &self.form {
            Form::Dielectric { fluoresces: true, .. } | Form::Dielectric { alpha: None, .. } => 0.5,
            Form::Dielectric { table, inside, alpha: Some(alpha), .. } => {
                table.transmitted_share(*inside, *alpha)
            }
            _ => 0.0,
        }
    }
}
