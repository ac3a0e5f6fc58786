//! Adjoint-driven Russian roulette (Vorba and Krivanek 2016, doi:10.1145/2897824.2925912): a path survives with the
//! probability of its expected remaining contribution, estimated on coarse bins of wavelength.
//!
//! Light at one wavelength may matter only because it excites, light at another only because it is seen. A path
//! therefore carries two coarse throughputs from the camera on: that of light which has not fluoresced on the sampled
//! part of the path, and that of light which has fluoresced there once. Their products with the light that may still
//! arrive, the spectrum of every light group and the emission of every fluorophore, are the shares of each component that
//! the path can still contribute; the largest of them is the survival probability. Any probability above zero leaves the
//! estimate unbiased. This one keeps a path whose blue can still excite though its red is absorbed, and the reverse.
//!
//! Each component is judged on its own scale, and paths do not depend on concentrations: a fluorophore counts as if it
//! returned all light of the light sources. Indirect light is estimated by the interreflection gain `1 / (1 - r)`, with
//! the mean reflectance `r` around the visible surfaces; of the component of a fluorophore, a vertex that is excited
//! sends only the part that has not come from elsewhere.

use super::fluorescence_operator::FluorescenceOperator;
use crate::material::BsdfValue;
use crate::scene::Scene;
use crate::spectral::{Curve, WavelengthGrid};

/// Coarse bins of equal width.
pub(super) const BINS: usize = 8;
/// A coarse spectrum.
pub(super) type Coarse = [f32; BINS];

/// Bins with less than this share of a light source's power are treated as dark. It is small compared with the eighth of an even
/// spectrum; it decides how long paths are, not their expected value.
const DARK_SHARE: f32 = 1e-3;

/// The fluorophores and light sources of a scene on coarse bins.
#[derive(Debug)]
pub(super) struct RouletteModel {
    grid: Option<WavelengthGrid>,
    /// Light of each group that arrives at a surface, on a scale on which the bins of its direct light sum to 1. Dark
    /// groups are left out.
    groups: Vec<Coarse>,
    /// 1 where any light group shines, else 0.
    lit: Coarse,
    /// For each fluorophore, the shares of the bins in its light that arrives at a surface; zero for one that no light group of
    /// the grid excites.
    emission: Vec<Coarse>,
    /// For each fluorophore, `[excitation][emission]`; scaled so that the light group that excites it best comes back whole.
    fluorescence: Vec<[Coarse; BINS]>,
}

/// Throughput of a path from the camera on, on coarse bins.
#[derive(Clone, Copy, Debug)]
pub(super) struct CoarseThroughput {
    /// Of light that does not fluoresce on the sampled part of the path.
    elastic: Coarse,
    /// Of light that fluoresces once there.
    fluorescent: Coarse,
}

impl CoarseThroughput {
    /// That of a path that starts at the camera.
    pub(super) const CAMERA: Self = Self { elastic: [1.0; BINS], fluorescent: [0.0; BINS] };
}

impl RouletteModel {
    /// Coarse bins on the grid of a scene, with everything left to [`Self::fill_in`].
    pub(super) fn new(grid: &WavelengthGrid) -> Self {
        let (start, end) = (grid.start_nm(), grid.end_nm());
        let edges: Vec<f64> = (0..=BINS).map(|i| start + (end - start) * i as f64 / BINS as f64).collect();
        let grid = WavelengthGrid::from_edges(&edges).ok();
        Self { grid, groups: Vec::new(), lit: [0.0; BINS], emission: Vec::new(), fluorescence: Vec::new() }
    }

    /// Sets light groups and fluorophores of a scene, from the spectrum of each light group, on any scale, and the
    /// interreflection gain: all light that arrives at a surface over the light that arrives directly.
    pub(super) fn fill_in(&mut self, scene: &Scene, groups: &[Option<Curve>], gain: &Coarse) {
        // Put the light of each group on coarse bins, interreflection included
        for spectrum in groups.iter().flatten() {
            if let Some(shares) = normalized(self.coarse(spectrum)) {
                self.groups.push(product(&shares, gain));
                for (lit, share) in self.lit.iter_mut().zip(&shares) {
                    if *share > DARK_SHARE {
                        *lit = 1.0;
                    }
                }
            }
        }
        for fluorophore in &scene.fluorophores {
            // Tabulate the operator on coarse bins, column by column
            let mut matrix = [[0.0; BINS]; BINS];
            if let Some(grid) = &self.grid {
                let operator = FluorescenceOperator::new(&fluorophore.eem, grid, None);
                for (excitation, column) in matrix.iter_mut().enumerate() {
                    let mut unit = [0.0; BINS];
                    unit[excitation] = 1.0;
                    column.copy_from_slice(&operator.product(1.0, &unit));
                }
            }

            // Find the light group that excites it best, and scale the operator to return all of its light
            let arriving = |group: &Coarse| -> Coarse {
                let mut sum = [0.0; BINS];
                for (share, column) in group.iter().zip(&matrix) {
                    sum.iter_mut().zip(column).for_each(|(sum, value)| *sum += share * value);
                }
                product(&sum, gain)
            };
            let best = self
                .groups
                .iter()
                .map(arriving)
                .max_by(|a, b| a.iter().sum::<f32>().total_cmp(&b.iter().sum()));
            let total = best.map_or(0.0, |emission| emission.iter().sum::<f32>());
            if total > 0.0 {
                matrix.iter_mut().flatten().for_each(|value| *value /= total);
            } else {
                matrix = [[0.0; BINS]; BINS];
            }
            self.emission.push(best.and_then(normalized).unwrap_or([0.0; BINS]));
            self.fluorescence.push(matrix);
        }
    }

    /// A spectrum on the coarse bins.
    pub(super) fn coarse(&self, curve: &Curve) -> Coarse {
        let mut values = [0.0; BINS];
        if let Some(grid) = &self.grid {
            let averages = curve.bin_averages(grid);
            values.iter_mut().zip(&averages).for_each(|(value, mean)| *value = *mean as f32);
        }
        values
    }

    /// Multiplies the throughput by what a vertex scatters, in the direction in which the path continues.
    pub(super) fn scatter(
        &self,
        throughput: &mut CoarseThroughput,
        scattering: &BsdfValue,
        spectrum: &Coarse,
        fluorophores: &[usize],
    ) {
        let factor = 1.0 / scattering.pdf;
        let CoarseThroughput { elastic, fluorescent } = *throughput;
        for bin in 0..BINS {
            let reflected = (scattering.diffuse * spectrum[bin] + scattering.gloss).max(0.0) * factor;
            throughput.elastic[bin] = reflected * elastic[bin];
            throughput.fluorescent[bin] = reflected * fluorescent[bin];
        }
        if scattering.fluorescent > 0.0 {
            // Each fluorophore is a component of its own: the one that gives most counts, not their sum.
            let mut excites = [0.0_f32; BINS];
            for fluorophore in fluorophores {
                for (most, column) in excites.iter_mut().zip(&self.fluorescence[*fluorophore]) {
                    *most = most.max(dot(column, &elastic));
                }
            }
            let factor = scattering.fluorescent * factor;
            for (sum, value) in throughput.fluorescent.iter_mut().zip(&excites) {
                *sum += factor * value;
            }
        }
    }

    /// Expected remaining contribution: the largest share of a component that the path can still contribute. Reflected light
    /// counts in the bin where its share is largest, as every band is judged on its own scale.
    pub(super) fn expected_contribution(&self, throughput: &CoarseThroughput) -> f32 {
        let mut largest = 0.0_f32;
        for (&elastic, &lit) in throughput.elastic.iter().zip(&self.lit) {
            largest = largest.max(elastic * lit);
        }
        let mut excites = 0.0_f32;
        for group in &self.groups {
            excites = excites.max(dot(group, &throughput.fluorescent));
        }
        for emission in &self.emission {
            largest = largest.max(dot(emission, &throughput.elastic) + excites);
        }
        largest
    }
}

fn product(a: &Coarse, b: &Coarse) -> Coarse {
    std::array::from_fn(|bin| a[bin] * b[bin])
}

impl CoarseThroughput {
    /// Divides by the probability with which the path survived.
    pub(super) fn survive(&mut self, probability: f32) {
        self.elastic.iter_mut().chain(&mut self.fluorescent).for_each(|value| *value /= probability);
    }
}

fn dot(a: &Coarse, b: &Coarse) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn normalized(values: Coarse) -> Option<Coarse> {
    let total: f32 = values.iter().sum();
    (total > 0.0).then(|| values.map(|value| value / total))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::LightGroup;
    use crate::material::Material;
    use crate::optics::PerspectiveCamera;
    use crate::spectral::{PhotonEem, SeparableTerm, Stokes};
    use glam::Vec3;

    fn band(center: f64) -> Curve {
        Curve::from_fn(200.0, 1000.0, |nm| (-0.5 * ((nm - center) / 15.0).powi(2)).exp())
    }

    /// A light at 390 nm and a dye that emits at 640 nm, with a yield of a thousandth.
    fn model(gain: f32) -> RouletteModel {
        let term =
            SeparableTerm { excitation: band(390.0).scaled(1e-3), emission: band(640.0).scaled(1.0 / 37.6) };
        let scene = Scene {
            grid: WavelengthGrid::uniform(352.5, 747.5, 5.0).unwrap(),
            objects: Vec::new(),
            materials: vec![Material::default()],
            fluorophores: vec![crate::spectral::Fluorophore {
                name: "dye".into(),
                title: "dye".into(),
                eem: PhotonEem::separable(vec![term], Stokes::Mask),
                excitation_range_nm: (300.0, 800.0),
                emission_range_nm: (300.0, 800.0),
                source: "made up".into(),
            }],
            light_groups: vec![LightGroup { name: "lamp".into() }],
            lights: Vec::new(),
            camera: PerspectiveCamera::look_at(Vec3::Z, Vec3::ZERO, Vec3::Y, 50.0, 4, 4).unwrap(),
        };
        let mut model = RouletteModel::new(&scene.grid);
        model.fill_in(&scene, &[Some(band(390.0))], &[gain; BINS]);
        model
    }

    /// One bounce with a reflectance per coarse bin; a fluorescent surface takes part with its whole irradiance.
    fn bounce(
        model: &RouletteModel,
        throughput: &mut CoarseThroughput,
        blue: f32,
        red: f32,
        fluoresces: bool,
    ) {
        let scattering = BsdfValue { diffuse: 1.0, fluorescent: 1.0, gloss: 0.0, pdf: 1.0 };
        let spectrum = std::array::from_fn(|bin| if bin < BINS / 2 { blue } else { red });
        let list: &[usize] = if fluoresces { &[0] } else { &[] };
        model.scatter(throughput, &scattering, &spectrum, list);
    }

    #[test]
    fn everything_counts_at_the_camera() {
        assert!((model(1.0).expected_contribution(&CoarseThroughput::CAMERA) - 1.0).abs() < 1e-5);
    }

    /// Surfaces that absorb the light but reflect the emission: the path can still hit something that fluoresces.
    #[test]
    fn a_path_whose_red_is_seen_goes_on_though_its_blue_is_spent() {
        let model = model(1.0);
        let mut throughput = CoarseThroughput::CAMERA;
        for _ in 0..4 {
            bounce(&model, &mut throughput, 0.01, 0.9, false);
        }
        assert!(
            (model.expected_contribution(&throughput) - 0.9_f32.powi(4)).abs() < 0.01,
            "{}",
            model.expected_contribution(&throughput)
        );
    }

    /// After a surface that fluoresces, blue light excites it, whatever becomes of the red.
    #[test]
    fn a_path_whose_blue_excites_goes_on_though_its_red_is_spent() {
        let model = model(1.0);
        let mut throughput = CoarseThroughput::CAMERA;
        bounce(&model, &mut throughput, 0.01, 0.01, true);
        assert!(
            (model.expected_contribution(&throughput) - 1.0).abs() < 0.05,
            "{}",
            model.expected_contribution(&throughput)
        );
        bounce(&model, &mut throughput, 0.8, 0.01, false);
        assert!(
            (model.expected_contribution(&throughput) - 0.8).abs() < 0.05,
            "{}",
            model.expected_contribution(&throughput)
        );
    }

    /// Where indirect light is as bright as direct light, the fluorescence that arrives is twice what one vertex sends.
    #[test]
    fn one_vertex_excites_a_part_of_what_a_bright_room_sends() {
        let model = model(2.0);
        assert!((model.expected_contribution(&CoarseThroughput::CAMERA) - 1.0).abs() < 1e-5);
        let mut throughput = CoarseThroughput::CAMERA;
        bounce(&model, &mut throughput, 0.0, 0.0, true);
        assert!(
            (model.expected_contribution(&throughput) - 0.5).abs() < 0.05,
            "{}",
            model.expected_contribution(&throughput)
        );
    }

    #[test]
    fn a_path_that_can_do_neither_ends() {
        let model = model(1.0);
        let mut throughput = CoarseThroughput::CAMERA;
        for _ in 0..3 {
            bounce(&model, &mut throughput, 0.05, 0.05, false);
        }
        assert!(model.expected_contribution(&throughput) < 2e-4);
    }
}
