//! What a layered tissue looks like from above: reflectance and fluorescence as if it were a surface.
//!
//! Light that is emitted evenly in all directions at a depth `z` leaves above with the probability `phi_m(z) / (4 n^2)`, where
//! `phi_m` is the fluence that diffuse light of the emitted wavelength has there: light paths can be reversed. So
//!
//! `F(m, x) = integral s Y(m|x) / Y(at) phi_x(z) phi_m(z) / (4 n^2) dz`
//!
//! needs one solution per wavelength, not per pair, and is a short sum of products of a function of the excitation and one of
//! the emission (Welch et al., Lasers Surg. Med. 21, 166, 1997; Swartling et al., J. Opt. Soc. Am. A 20, 714, 2003).
//!
//! **Below the surface.** Where something else reflects at the surface (a wet coat), the tissue must come without it. With `E`
//! and `I` the reflectances of the surface for diffuse light from outside and from inside, `R_b` is defined by
//! `R = (1 - E) (1 - I) R_b / (1 - I R_b)` (Saunderson, J. Opt. Soc. Am. 32, 727, 1942) and `F_b` by
//! `F(m, x) = (1 - E) / (1 - I R_b(x)) F_b(m, x) (1 - I) / (1 - I R_b(m))`: a surface that follows these relations upon `R_b` and
//! `F_b` gives back `R` and `F` under diffuse light exactly, whatever the light does inside.

use std::slice;
use std::sync::Arc;

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::depth_quadrature::{DepthNode, depth_nodes};
use super::discrete_ordinates::{DiscreteOrdinates, Incidence};
use super::fresnel_interface::diffuse_reflectance;
use super::layer_modes::KnownModes;
use super::layered_tissue::{LayeredTissue, TissueFluorophore};
use super::low_rank::compress;
use super::tissue_error::TissueError;
use crate::interruption::end_if_interrupted;
use crate::spectral::{Curve, Fluorophore, PhotonEem, SeparableTerm, Stokes, WavelengthGrid, YieldDensity};

/// Step between solutions, nm: fine enough for the bands of hemoglobin.
const SOLUTION_STEP_NM: f64 = 2.5;
/// Step of the curves of a compressed matrix, nm.
const TERM_STEP_NM: f64 = 1.0;
/// Relative error of compressed matrices, in the Frobenius norm.
pub const COMPRESSION_ERROR: f64 = 1e-4;

/// Where light is counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// Outside: the surface of the tissue is included, its specular reflection is not.
    AboveSurface,
    /// Inside, for something that reflects at the surface by itself.
    BelowSurface,
}

/// A fluorophore in one layer of an [`EffectiveTissue`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LayerFluorophore {
    /// Number of the layer, from 0.
    pub layer: usize,
    /// Number of the fluorophore in that layer, from 0.
    pub fluorophore: usize,
}

/// Reflectance and fluorescence of a layered tissue under diffuse light.
#[derive(Clone, Debug)]
pub struct EffectiveTissue {
    tissue: LayeredTissue,
    wavelengths_nm: Vec<f64>,
    /// At each wavelength.
    solutions: Vec<Solution>,
    nodes: Vec<DepthNode>,
    surface: Surface,
}

/// The smooth surface under diffuse light.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Surface {
    external: f64,
    internal: f64,
}

#[derive(Clone, Debug)]
pub(super) struct Solution {
    /// Above the surface, without specular reflection.
    reflectance: f64,
    /// At each depth node, per unit of irradiance from above.
    fluence: Vec<f64>,
    absorbed: Vec<f64>,
}

impl Solution {
    /// All its numbers.
    pub(super) fn values(&self) -> impl Iterator<Item = f64> {
        std::iter::once(self.reflectance)
            .chain(self.fluence.iter().copied())
            .chain(self.absorbed.iter().copied())
    }
}

impl Surface {
    /// `R_b` of a reflectance above the surface.
    fn below(self, above: f64) -> f64 {
        above / ((1.0 - self.external) * (1.0 - self.internal) + self.internal * above)
    }

    /// What turns fluence under light from above into fluence under light below the surface; its square turns `F` into `F_b`.
    fn fluence_factor(self, reflectance_above: f64) -> f64 {
        let between = 1.0 - self.internal * self.below(reflectance_above);
        between / ((1.0 - self.external) * (1.0 - self.internal)).sqrt()
    }
}

impl EffectiveTissue {
    /// Solves a tissue at some wavelengths, nm, rising. Between them fluence is interpolated.
    ///
    /// # Errors
    /// A tissue with numbers outside their ranges; fewer than two wavelengths, or wavelengths that do not rise or lie outside
    /// 200 to 1200 nm.
    pub fn new(
        tissue: &LayeredTissue,
        wavelengths_nm: &[f64],
        solver: DiscreteOrdinates,
    ) -> Result<Self, TissueError> {
        Self::several(slice::from_ref(tissue), wavelengths_nm, solver).map(|mut solved| solved.swap_remove(0))
    }

    /// Solves several tissues at the same wavelengths, as [`Self::new`] does, which takes less time where they have layers in common.
    pub(crate) fn several(
        tissues: &[LayeredTissue],
        wavelengths_nm: &[f64],
        solver: DiscreteOrdinates,
    ) -> Result<Vec<Self>, TissueError> {
        tissues.iter().try_for_each(LayeredTissue::validate)?;
        let rise = wavelengths_nm.len() > 1 && wavelengths_nm.windows(2).all(|pair| pair[1] > pair[0]);
        if !rise || !wavelengths_nm.iter().all(|nm| (200.0..=1200.0).contains(nm)) {
            return Err(TissueError::Wavelengths);
        }
        let nodes: Vec<_> = tissues.iter().map(|tissue| depth_nodes(tissue, wavelengths_nm)).collect();

        // Solve all tissues at one wavelength after the other
        let solve = |&nm: &f64| {
            let mut known = KnownModes::default();
            let of_tissue = |(tissue, nodes): (&LayeredTissue, &Vec<DepthNode>)| {
                end_if_interrupted();
                let field = solver.solve_knowing(&mut known, &tissue.optics(nm), Incidence::Lambertian)?;
                let fluence =
                    nodes.iter().map(|node| field.layer_fluence(node.layer, node.depth_mm)).collect();
                Ok(Solution { reflectance: field.reflectance, fluence, absorbed: field.absorbed })
            };
            tissues.iter().zip(&nodes).map(of_tissue).collect()
        };
        let by_wavelength =
            wavelengths_nm.par_iter().map(solve).collect::<Result<Vec<Vec<Solution>>, TissueError>>()?;

        // Gather the solutions of each tissue
        let mut solutions: Vec<Vec<Solution>> = vec![Vec::new(); tissues.len()];
        for at_wavelength in by_wavelength {
            solutions
                .iter_mut()
                .zip(at_wavelength)
                .for_each(|(of_tissue, solution)| of_tissue.push(solution));
        }
        let solved = tissues.iter().zip(nodes).zip(solutions);
        let solved = solved.map(|((tissue, nodes), solutions)| {
            Self::from_solutions(tissue, wavelengths_nm, nodes, solutions)
        });
        Ok(solved.collect())
    }

    fn from_solutions(
        tissue: &LayeredTissue,
        wavelengths_nm: &[f64],
        nodes: Vec<DepthNode>,
        solutions: Vec<Solution>,
    ) -> Self {
        let index = tissue.surface_index();
        let surface =
            Surface { external: diffuse_reflectance(1.0, index), internal: diffuse_reflectance(index, 1.0) };
        Self { tissue: tissue.clone(), wavelengths_nm: wavelengths_nm.to_vec(), solutions, nodes, surface }
    }

    /// At each wavelength.
    pub(super) fn solutions(&self) -> &[Solution] {
        &self.solutions
    }

    /// What [`Self::new`] made, from the [`Solution::values`] at each wavelength; `None` where there are too few.
    pub(super) fn of_values(
        tissue: &LayeredTissue,
        wavelengths_nm: &[f64],
        values: &mut impl Iterator<Item = f64>,
    ) -> Option<Self> {
        let nodes = depth_nodes(tissue, wavelengths_nm);
        let mut several = |count: usize| -> Option<Vec<f64>> {
            let taken: Vec<f64> = values.by_ref().take(count).collect();
            (taken.len() == count && taken.iter().all(|value| value.is_finite())).then_some(taken)
        };
        let solution = |_: &f64| {
            let reflectance = *several(1)?.first()?;
            let (fluence, absorbed) = (several(nodes.len())?, several(tissue.layers.len())?);
            Some(Solution { reflectance, fluence, absorbed })
        };
        let solutions = wavelengths_nm.iter().map(solution).collect::<Option<_>>()?;
        Some(Self::from_solutions(tissue, wavelengths_nm, nodes, solutions))
    }

    /// Solves a tissue for all bands of a grid: every 2.5 nm or finer, the ends of the grid included.
    ///
    /// # Errors
    /// A tissue with numbers outside their ranges.
    pub fn for_grid(tissue: &LayeredTissue, grid: &WavelengthGrid) -> Result<Self, TissueError> {
        Self::several_for_grid(slice::from_ref(tissue), grid).map(|mut solved| solved.swap_remove(0))
    }

    /// Solves several tissues for all bands of a grid, as [`Self::for_grid`] does.
    pub(crate) fn several_for_grid(
        tissues: &[LayeredTissue],
        grid: &WavelengthGrid,
    ) -> Result<Vec<Self>, TissueError> {
        let (start, end) = (grid.start_nm(), grid.end_nm());
        Self::several(tissues, &steps(start, end, SOLUTION_STEP_NM), DiscreteOrdinates::DIFFUSE)
    }

    /// The tissue.
    #[must_use]
    pub fn tissue(&self) -> &LayeredTissue {
        &self.tissue
    }

    /// Reflectance of the surface alone for diffuse light from outside: what [`Level::AboveSurface`] leaves out.
    #[must_use]
    pub fn specular_reflectance(&self) -> f64 {
        self.surface.external
    }

    /// Reflectance against wavelength; 0 outside of the wavelengths that were solved.
    #[must_use]
    pub fn reflectance(&self, level: Level) -> Curve {
        self.curve(|solution| match level {
            Level::AboveSurface => solution.reflectance,
            Level::BelowSurface => self.surface.below(solution.reflectance),
        })
    }

    fn curve(&self, value: impl Fn(&Solution) -> f64) -> Curve {
        let values: Vec<f64> = self.solutions.iter().map(value).collect();
        // Wavelengths were checked; values are finite.
        Curve::new(self.wavelengths_nm.clone(), values).unwrap_or_else(|_| Curve::constant(0.0))
    }

    /// All fluorophores of all layers, from above to below.
    #[must_use]
    pub fn parts(&self) -> Vec<LayerFluorophore> {
        let layers = self.tissue.layers.iter().enumerate();
        layers
            .flat_map(|(layer, contents)| {
                (0..contents.fluorophores.len())
                    .map(move |fluorophore| LayerFluorophore { layer, fluorophore })
            })
            .collect()
    }

    fn contents(&self, part: LayerFluorophore) -> Option<&TissueFluorophore> {
        self.tissue.layers.get(part.layer)?.fluorophores.get(part.fluorophore)
    }

    /// Fluence at all depth nodes of a layer, at any wavelength, with the surface taken off if need be.
    fn fluence(&self, layer: usize, wavelength_nm: f64, level: Level) -> Vec<f64> {
        let known = &self.wavelengths_nm;
        if !(known[0]..=known[known.len() - 1]).contains(&wavelength_nm) {
            return vec![0.0; self.nodes.iter().filter(|node| node.layer == layer).count()];
        }
        let after = known.partition_point(|&nm| nm <= wavelength_nm).clamp(1, known.len() - 1);
        let t = (wavelength_nm - known[after - 1]) / (known[after] - known[after - 1]);
        let [low, high] = [&self.solutions[after - 1], &self.solutions[after]];
        let factor = |solution: &Solution| match level {
            Level::AboveSurface => 1.0,
            Level::BelowSurface => self.surface.fluence_factor(solution.reflectance),
        };
        let [low_factor, high_factor] = [(1.0 - t) * factor(low), t * factor(high)];
        let of_layer = self.nodes.iter().enumerate().filter(|(_, node)| node.layer == layer);
        of_layer.map(|(i, _)| low_factor * low.fluence[i] + high_factor * high.fluence[i]).collect()
    }

    /// Weight of each depth node of a layer: `w / (4 n^2)`, mm.
    fn escape_weights(&self, layer: usize) -> Vec<f64> {
        let of_layer = self.nodes.iter().filter(|node| node.layer == layer);
        of_layer.map(|node| node.weight_mm / (4.0 * node.refractive_index.powi(2))).collect()
    }

    /// `F(m, x)`: photons that leave above per nm of emission and per photon of diffuse light, 1/nm. 0 for a part that does not
    /// exist.
    #[must_use]
    pub fn yield_density(
        &self,
        part: LayerFluorophore,
        emission_nm: f64,
        excitation_nm: f64,
        level: Level,
    ) -> f64 {
        let Some(contents) = self.contents(part) else { return 0.0 };
        let at = |nm| self.fluence(part.layer, nm, level);
        let (emitted, excited) = (at(emission_nm), at(excitation_nm));
        let escape = self.escape_weights(part.layer);
        let overlap: f64 = emitted.iter().zip(&excited).zip(escape).map(|((m, x), w)| m * x * w).sum();
        overlap * contents.scale_per_mm() * contents.fluorophore.eem.at(emission_nm, excitation_nm)
    }

    /// Photons per nm that a part gives off above, at each of some emission wavelengths, under light of several lines.
    ///
    /// `light` has wavelengths, nm, and the photons that fall on the surface at each. The result has their unit, per nm; zeros
    /// for a part that does not exist.
    #[must_use]
    pub fn emission(
        &self,
        part: LayerFluorophore,
        light: &[(f64, f64)],
        emission_nm: &[f64],
        level: Level,
    ) -> Vec<f64> {
        let Some(contents) = self.contents(part).filter(|_| !light.is_empty()) else {
            return vec![0.0; emission_nm.len()];
        };
        let light_nm: Vec<f64> = light.iter().map(|(nm, _)| *nm).collect();
        let yields = contents.fluorophore.eem.densities(emission_nm, &light_nm);
        self.emission_of(part, light, &yields, &self.overlaps(part.layer, &light_nm, emission_nm, level))
    }

    /// [`Self::emission`] with the yield densities of the fluorophore ([`PhotonEem::densities`]) and the [`Self::overlaps`] of the layer
    /// known, both `[emission][light]`: the parts of a layer share the latter.
    pub(crate) fn emission_of(
        &self,
        part: LayerFluorophore,
        light: &[(f64, f64)],
        yields: &[f64],
        overlaps: &[f64],
    ) -> Vec<f64> {
        let scale = self.contents(part).map_or(0.0, TissueFluorophore::scale_per_mm);
        let lines = light.len().max(1);
        let emitted = |(yields, overlaps): (&[f64], &[f64])| -> f64 {
            let of_line = |((density, overlap), (_, photons)): ((&f64, &f64), &(f64, f64))| {
                density * scale * photons * overlap
            };
            yields.iter().zip(overlaps).zip(light).map(of_line).sum()
        };
        yields.chunks(lines).zip(overlaps.chunks(lines)).map(emitted).collect()
    }

    /// How well light of each line and light of each emission wavelength reach one another in a layer: `integral of fluence(line)
    /// fluence(emission) / (4 n^2) over depth`, mm, `[emission][line]`. By reciprocity the second is what leaves of light from there.
    pub(crate) fn overlaps(
        &self,
        layer: usize,
        light_nm: &[f64],
        emission_nm: &[f64],
        level: Level,
    ) -> Vec<f64> {
        let escape = self.escape_weights(layer);
        let arriving = |nm: &f64| -> Vec<f64> {
            self.fluence(layer, *nm, level).iter().zip(&escape).map(|(x, w)| x * w).collect()
        };
        let arriving: Vec<Vec<f64>> = light_nm.iter().map(arriving).collect();
        let mut overlaps = Vec::with_capacity(light_nm.len() * emission_nm.len());
        for nm in emission_nm {
            let leaving = self.fluence(layer, *nm, level);
            let with = |arriving: &Vec<f64>| arriving.iter().zip(&leaving).map(|(x, m)| x * m).sum::<f64>();
            overlaps.extend(arriving.iter().map(with));
        }
        overlaps
    }

    /// The fluorescence of a part as the excitation-emission matrix of a surface, a sum of few products that is within
    /// [`COMPRESSION_ERROR`] of it. The factors may be negative; their sum is not, but for that error.
    ///
    /// # Errors
    /// A part that does not exist.
    pub fn eem(&self, part: LayerFluorophore, level: Level) -> Result<PhotonEem, TissueError> {
        let contents = self.contents(part).ok_or(TissueError::NoSuchPart)?;
        let (first, last) = (self.wavelengths_nm[0], self.wavelengths_nm[self.wavelengths_nm.len() - 1]);
        let nm = steps(first, last, TERM_STEP_NM);
        let eem = &contents.fluorophore.eem;
        let [emission, excitation] = factors(eem, &nm);
        let escape = self.escape_weights(part.layer);
        let fluence = DMatrix::from_row_iterator(
            nm.len(),
            escape.len(),
            nm.iter().flat_map(|&nm| self.fluence(part.layer, nm, level)),
        );
        let mut weighted = fluence.clone();
        for (mut column, weight) in weighted.column_iter_mut().zip(&escape) {
            column.scale_mut(*weight);
        }
        // Fewer depths first: the matrix of the depths is the same for all species of the fluorophore.
        let [leaving, arriving] = compress(weighted, fluence, 0.1 * COMPRESSION_ERROR)
            .ok_or(TissueError::Unsolvable { layer: None })?;
        let [left, right] = compress(
            products(&leaving, &emission),
            products(&arriving, &excitation),
            0.9 * COMPRESSION_ERROR,
        )
        .ok_or(TissueError::Unsolvable { layer: None })?;
        let curve = |column: usize, matrix: &DMatrix<f64>| {
            Curve::new(nm.clone(), matrix.column(column).iter().copied().collect())
                .unwrap_or_else(|_| Curve::constant(0.0))
        };
        let terms = (0..left.ncols())
            .map(|term| SeparableTerm { excitation: curve(term, &right), emission: curve(term, &left) })
            .collect();
        Ok(PhotonEem::separable(terms, eem.stokes()).scaled(contents.scale_per_mm()))
    }

    /// A part as a fluorophore of a surface at concentration 1: [`Self::eem`] under the name `fluorophore in layer`.
    ///
    /// # Errors
    /// A part that does not exist.
    pub fn fluorophore(&self, part: LayerFluorophore, level: Level) -> Result<Fluorophore, TissueError> {
        let contents = self.contents(part).ok_or(TissueError::NoSuchPart)?;
        let layer = &self.tissue.layers[part.layer].name;
        let known: &Arc<Fluorophore> = &contents.fluorophore;
        Ok(Fluorophore {
            name: format!("{} in {layer}", known.name),
            title: format!("{} in {layer}", known.title),
            eem: self.eem(part, level)?,
            ..Fluorophore::clone(known)
        })
    }

    /// The largest share of photons that leave again, reflected or as fluorescence, over all wavelengths; at most 1 for a
    /// tissue that gives no more light than it gets.
    #[must_use]
    pub fn largest_photon_return(&self) -> f64 {
        let parts: Vec<_> =
            self.parts().into_iter().filter_map(|part| self.eem(part, Level::AboveSurface).ok()).collect();
        let mut sums: Vec<f64> =
            self.solutions.iter().map(|s| s.reflectance + self.surface.external).collect();
        for eem in parts {
            for (sum, more) in sums.iter_mut().zip(eem.total_yields(&self.wavelengths_nm)) {
                *sum += more;
            }
        }
        sums.into_iter().fold(0.0, f64::max)
    }

    /// From how deep the fluorescence comes that some channel of a sensor sees.
    ///
    /// `excitation` is the spectrum of the light in photons per nm, of any scale; `channel` weighs the emitted photons of each
    /// wavelength: a filter times a quantum efficiency.
    #[must_use]
    pub fn depth_of_fluorescence(&self, excitation: &Curve, channel: &Curve) -> DepthProfile {
        let mut profiles = self.depths_of_fluorescence(excitation, &[channel]);
        profiles.pop().unwrap_or_else(|| DepthProfile::new(&self.tissue, &[], &[]))
    }

    /// [`Self::depth_of_fluorescence`] of several channels under the same light.
    #[must_use]
    pub fn depths_of_fluorescence(&self, excitation: &Curve, channels: &[&Curve]) -> Vec<DepthProfile> {
        /// Light below this share of its brightest wavelength excites nothing that counts.
        const DARK: f64 = 1e-6;
        let nm = steps(
            self.wavelengths_nm[0],
            self.wavelengths_nm[self.wavelengths_nm.len() - 1],
            SOLUTION_STEP_NM,
        );
        let light: Vec<f64> = nm.iter().map(|&nm| excitation.at(nm)).collect();
        let brightest = light.iter().copied().fold(0.0, f64::max);
        let lit: Vec<usize> = (0..nm.len()).filter(|&x| light[x] > DARK * brightest).collect();
        let weights: Vec<Vec<f64>> =
            channels.iter().map(|channel| nm.iter().map(|&nm| channel.at(nm)).collect()).collect();
        let mut by_node = vec![vec![0.0; self.nodes.len()]; channels.len()];
        for part in self.parts() {
            let Some(contents) = self.contents(part) else { continue };
            let eem = &contents.fluorophore.eem;
            let escape = self.escape_weights(part.layer);
            let fluence: Vec<Vec<f64>> =
                nm.iter().map(|&nm| self.fluence(part.layer, nm, Level::AboveSurface)).collect();
            let Some(first) = self.nodes.iter().position(|node| node.layer == part.layer) else { continue };
            for &x in &lit {
                let emitted: Vec<f64> = nm.iter().map(|&m| eem.at(m, nm[x])).collect();
                for (k, escape) in escape.iter().enumerate() {
                    let arriving = light[x] * fluence[x][k] * escape * contents.scale_per_mm();
                    for (nodes, weight) in by_node.iter_mut().zip(&weights) {
                        let seen = emitted.iter().zip(weight).zip(&fluence);
                        nodes[first + k] += arriving * seen.map(|((e, w), f)| e * w * f[k]).sum::<f64>();
                    }
                }
            }
        }
        by_node.iter().map(|by_node| DepthProfile::new(&self.tissue, &self.nodes, by_node)).collect()
    }
}

/// Wavelengths from one to another, at most a step apart.
fn steps(from_nm: f64, to_nm: f64, step_nm: f64) -> Vec<f64> {
    let number = ((to_nm - from_nm) / step_nm).ceil().max(1.0) as usize;
    (0..=number).map(|i| from_nm + (to_nm - from_nm) * i as f64 / number as f64).collect()
}

/// `[emission, excitation]` of a matrix before the Stokes mask, one column for each term.
fn factors(eem: &PhotonEem, nm: &[f64]) -> [DMatrix<f64>; 2] {
    let unmasked = eem.clone().with_stokes(Stokes::Off);
    match eem.density() {
        YieldDensity::Separable(terms) => [
            DMatrix::from_fn(nm.len(), terms.len(), |row, term| {
                eem.scale() * terms[term].emission.at(nm[row])
            }),
            DMatrix::from_fn(nm.len(), terms.len(), |row, term| terms[term].excitation.at(nm[row])),
        ],
        YieldDensity::Table(table) => {
            // The columns of the table, with linear interpolation between them.
            let columns = &table.excitation_nm;
            let hat = |nm: f64, column: usize| {
                let toward = |neighbor: f64| {
                    1.0 - ((nm - columns[column]) / (neighbor - columns[column])).clamp(0.0, 1.0)
                };
                let below = if nm >= columns[column] {
                    1.0
                } else {
                    column.checked_sub(1).map_or(0.0, |c| toward(columns[c]))
                };
                let above = if nm <= columns[column] {
                    1.0
                } else {
                    columns.get(column + 1).map_or(0.0, |&c| toward(c))
                };
                below * above
            };
            [
                DMatrix::from_fn(nm.len(), columns.len(), |row, column| {
                    unmasked.unmasked(nm[row], columns[column])
                }),
                DMatrix::from_fn(nm.len(), columns.len(), |row, column| hat(nm[row], column)),
            ]
        }
    }
}

/// All products of a column of one matrix with a column of another, row by row.
fn products(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let columns = b.ncols();
    DMatrix::from_fn(a.nrows(), a.ncols() * columns, |row, column| {
        a[(row, column / columns)] * b[(row, column % columns)]
    })
}

/// Where in a tissue light comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthProfile {
    /// Share of each layer; together 1, or all 0 where there is no light.
    pub layer_shares: Vec<f64>,
    /// Depth below the surface, um, and the share of the light from above it, rising from 0 to 1.
    cumulative: Vec<(f64, f64)>,
}

impl DepthProfile {
    fn new(tissue: &LayeredTissue, nodes: &[DepthNode], by_node: &[f64]) -> Self {
        let total: f64 = by_node.iter().sum();
        let mut layer_shares = vec![0.0; tissue.layers.len()];
        let mut cumulative = vec![(0.0, 0.0)];
        let (mut depth_um, mut share) = (0.0, 0.0);
        for (node, light) in nodes.iter().zip(by_node) {
            // The weights of Gauss are the widths of the slices around the nodes.
            depth_um += 1e3 * node.weight_mm;
            if total > 0.0 {
                share += light / total;
                layer_shares[node.layer] += light / total;
            }
            cumulative.push((depth_um, share));
        }
        Self { layer_shares, cumulative }
    }

    /// Mean depth, um; none where there is no light.
    #[must_use]
    pub fn mean_um(&self) -> Option<f64> {
        let slices = self.cumulative.windows(2);
        let mean = slices.map(|pair| (pair[1].1 - pair[0].1) * 0.5 * (pair[0].0 + pair[1].0)).sum();
        (self.cumulative.last()?.1 > 0.0).then_some(mean)
    }

    /// Depth, um, above which a share of the light comes from; none where there is no light or the share is not within 0 to 1.
    #[must_use]
    pub fn quantile_um(&self, share: f64) -> Option<f64> {
        let last = self.cumulative.last()?;
        if !(0.0..=1.0).contains(&share) || last.1 <= 0.0 {
            return None;
        }
        let after = self.cumulative.partition_point(|(_, s)| *s < share).clamp(1, self.cumulative.len() - 1);
        let ([z0, s0], [z1, s1]) =
            (<[f64; 2]>::from(self.cumulative[after - 1]), <[f64; 2]>::from(self.cumulative[after]));
        let t = if s1 > s0 { ((share - s0) / (s1 - s0)).clamp(0.0, 1.0) } else { 0.0 };
        Some(z0 + t * (z1 - z0))
    }
}
