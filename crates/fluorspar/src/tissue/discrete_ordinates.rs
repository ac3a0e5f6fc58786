//! Light transport in plane layers by discrete ordinates: the deterministic solver.
//!
//! Radiance is followed in a number of directions per hemisphere. In each layer the equation of transfer becomes a symmetric
//! eigenproblem, solved once ([`LayerModes`]); layers and interfaces are joined from the bottom up by adding (van de Hulst,
//! Multiple Light Scattering, 1980), and the light is followed down again. Fluence is a sum of exponentials in each layer,
//! known at every depth. Light is averaged over azimuth, which fluence, reflectance and transmittance do not notice.

use std::f64::consts::PI;
use std::rc::Rc;

use nalgebra::{DMatrix, DVector};

use super::angular_quadrature::{AngularQuadrature, Ordinate, cosine};
use super::beam_source::BeamSource;
use super::fresnel_interface::fresnel_reflectance;
use super::layer_modes::{KnownModes, LayerModes};
use super::light_field::{BeamFluence, LayerField, LeavingLight, LightField};
use super::optical_layer::OpticalStack;
use super::tissue_error::{TissueError, check};

/// Light that falls on a stack from above, with an irradiance of 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Incidence {
    /// The same radiance from every direction.
    Lambertian,
    /// One direction.
    Collimated {
        /// Cosine of the direction to the normal, in the medium above; 0.01 to 1.
        cosine: f64,
    },
}

impl Incidence {
    /// Along the normal.
    pub const NORMAL: Self = Self::Collimated { cosine: 1.0 };

    /// Refuses a cosine outside its range.
    pub(super) fn validate(&self) -> Result<(), TissueError> {
        let Self::Collimated { cosine } = *self else { return Ok(()) };
        check("light", "cosine", cosine, [0.01, 1.0], "it is the cosine of the angle to the normal")
    }
}

/// The solver, with the number of directions that it follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DiscreteOrdinates {
    nodes_per_hemisphere: usize,
}

impl DiscreteOrdinates {
    /// 8 directions per hemisphere: diffuse light in tissue to 0.1 %.
    pub const COARSE: Self = Self { nodes_per_hemisphere: 8 };
    /// 16 directions per hemisphere: diffuse light in tissue to 3e-5.
    pub const DIFFUSE: Self = Self { nodes_per_hemisphere: 16 };
    /// 32 directions per hemisphere: collimated light, too, to 3e-4.
    pub const WORKING: Self = Self { nodes_per_hemisphere: 32 };
    /// 64 directions per hemisphere: collimated light to 1e-4, also with an anisotropy of 0.97.
    pub const PRECISE: Self = Self { nodes_per_hemisphere: 64 };

    /// A solver with another number of directions per hemisphere, 8 to 128. Stacks of several refractive indices have at
    /// least four between any two critical angles. Time grows with the cube.
    ///
    /// # Errors
    /// A number outside that range.
    pub fn new(nodes_per_hemisphere: usize) -> Result<Self, TissueError> {
        let hint = "32 give 3e-4, 64 give 1e-4";
        check("solver", "nodes_per_hemisphere", nodes_per_hemisphere as f64, [8.0, 128.0], hint)?;
        Ok(Self { nodes_per_hemisphere })
    }

    /// Light in a stack of layers.
    ///
    /// # Errors
    /// A stack or an incidence with numbers outside their ranges, and layers whose scattering is too narrow for the number of
    /// directions.
    pub fn solve(&self, stack: &OpticalStack, incidence: Incidence) -> Result<LightField, TissueError> {
        self.solve_knowing(&mut KnownModes::default(), stack, incidence)
    }

    /// [`Self::solve`] for one of several stacks, with the modes of layers that others had.
    pub(super) fn solve_knowing(
        &self,
        known: &mut KnownModes,
        stack: &OpticalStack,
        incidence: Incidence,
    ) -> Result<LightField, TissueError> {
        stack.validate()?;
        incidence.validate()?;
        let indices: Vec<f64> = stack.layers.iter().map(|layer| layer.refractive_index).collect();
        let outside = [stack.index_above, stack.index_below];
        let quadrature = AngularQuadrature::new(self.nodes_per_hemisphere, &indices, outside);
        let problem = Problem::new(known, stack, &quadrature, incidence)?;
        let (field, basic_radiance) =
            problem.solve(incidence).ok_or(TissueError::Unsolvable { layer: None })?;
        Ok(field.into_field(stack, quadrature, basic_radiance))
    }
}

/// One layer of a [`Problem`].
struct SolverLayer {
    thickness_mm: f64,
    index: f64,
    modes: Rc<LayerModes>,
    beam: Option<LayerBeam>,
}

/// A beam in a layer: downward flux at the top, upward flux at the bottom, and what is scattered out of one of unit flux.
struct LayerBeam {
    source: BeamSource,
    flux: [f64; 2],
}

/// What lies below some level: how it reflects, and what it emits upward by itself.
struct Below {
    reflection: DMatrix<f64>,
    emission: DVector<f64>,
}

/// How light at the top of a layer becomes light at its bottom: `down = passing * down at the top + emission`.
struct Descent {
    passing: DMatrix<f64>,
    emission: DVector<f64>,
    /// What lies below the layer.
    below: Below,
    /// The layer and all below it.
    at_top: Below,
}

struct Problem<'a> {
    stack: &'a OpticalStack,
    ordinates: &'a [Ordinate],
    layers: Vec<SolverLayer>,
    /// Unscattered light: share that comes back out, and that goes through.
    unscattered: [f64; 2],
}

/// [`LightField`] but for what is known outside of the problem.
struct Solved {
    specular_reflectance: f64,
    reflectance: f64,
    transmittance: f64,
    absorbed: Vec<f64>,
    layers: Vec<LayerField>,
}

impl Solved {
    fn into_field(
        self,
        stack: &OpticalStack,
        quadrature: AngularQuadrature,
        basic_radiance: Vec<f64>,
    ) -> LightField {
        LightField {
            specular_reflectance: self.specular_reflectance,
            reflectance: self.reflectance,
            transmittance: self.transmittance,
            absorbed: self.absorbed,
            layers: self.layers,
            leaving: LeavingLight::new(stack, quadrature, basic_radiance),
        }
    }
}

impl<'a> Problem<'a> {
    fn new(
        known: &mut KnownModes,
        stack: &'a OpticalStack,
        quadrature: &'a AngularQuadrature,
        incidence: Incidence,
    ) -> Result<Self, TissueError> {
        let ordinates = &quadrature.ordinates;
        let mut layers = Vec::with_capacity(stack.layers.len());
        for (number, layer) in stack.layers.iter().enumerate() {
            let index = layer.refractive_index;
            let inside = &ordinates[..quadrature.number_in(index)];
            let modes = known.of(layer, inside).ok_or(TissueError::Unsolvable { layer: Some(number + 1) })?;
            layers.push(SolverLayer { thickness_mm: layer.thickness_mm, index, modes, beam: None });
        }
        let mut problem = Self { stack, ordinates, layers, unscattered: [0.0, 0.0] };
        if let Incidence::Collimated { cosine } = incidence {
            problem.follow_beam(stack.index_above * (1.0 - cosine * cosine).sqrt());
        }
        Ok(problem)
    }

    /// Indices of the media from above to below.
    fn media(&self) -> Vec<f64> {
        let layers = self.layers.iter().map(|layer| layer.index);
        [self.stack.index_above].into_iter().chain(layers).chain([self.stack.index_below]).collect()
    }

    /// Follows a beam of unit irradiance through all layers, with its reflections between the interfaces.
    fn follow_beam(&mut self, lateral: f64) {
        let media = self.media();
        let interface = |i: usize| interface_reflectance(lateral, media[i], media[i + 1]);
        let sources: Vec<Option<BeamSource>> = self
            .layers
            .iter()
            .map(|layer| {
                let mu = cosine(lateral, layer.index);
                let known = &self.ordinates[..layer.modes.cosines.len()];
                (mu > 0.0).then(|| BeamSource::new(&layer.modes, known, layer.index, mu, layer.thickness_mm))
            })
            .collect();
        let passing: Vec<f64> = sources
            .iter()
            .zip(&self.layers)
            .map(|(source, layer)| source.as_ref().map_or(0.0, |s| s.transmittance(layer.thickness_mm)))
            .collect();
        // below[i]: reflectance of all that lies below layer i, its lower interface included.
        let count = self.layers.len();
        let mut below = vec![interface(count); count];
        for i in (1..count).rev() {
            let [r, top] = [interface(i), passing[i].powi(2) * below[i]];
            below[i - 1] = r + (1.0 - r).powi(2) * top / (1.0 - r * top);
        }
        let mut down = 1.0;
        for (i, source) in sources.into_iter().enumerate() {
            let [r, top] = [interface(i), passing[i].powi(2) * below[i]];
            down *= (1.0 - r) / (1.0 - r * top);
            if i == 0 {
                self.unscattered[0] = (1.0 - r) * top * down;
            }
            let at_bottom = down * passing[i];
            if let Some(source) = source {
                self.layers[i].beam = Some(LayerBeam { source, flux: [down, at_bottom * below[i]] });
            }
            down = at_bottom;
        }
        self.unscattered[1] = down * (1.0 - interface(count));
    }

    /// What layers and interfaces do to light, from the bottom up.
    fn descents(&self) -> Option<Vec<Descent>> {
        let mut descents: Vec<Descent> = Vec::with_capacity(self.layers.len());
        let media = self.media();
        for (i, layer) in self.layers.iter().enumerate().rev() {
            let number = layer.modes.cosines.len();
            let below = match descents.last() {
                None => Below {
                    reflection: DMatrix::from_diagonal(&self.reflectances(
                        media[i + 1],
                        media[i + 2],
                        number,
                    )),
                    emission: DVector::zeros(number),
                },
                Some(lower) => self.through_interface(&lower.at_top, media[i + 1], media[i + 2], number)?,
            };
            descents.push(layer.upon(below)?);
        }
        descents.reverse();
        Some(descents)
    }

    /// What lies below an interface, seen through it from a medium with `number` directions.
    fn through_interface(&self, lower: &Below, above: f64, below: f64, number: usize) -> Option<Below> {
        if above.total_cmp(&below).is_eq() {
            return Some(Below { reflection: lower.reflection.clone(), emission: lower.emission.clone() });
        }
        let inside = lower.emission.len();
        let reflected = self.reflectances(above, below, number.max(inside));
        let passing = crossing(&reflected, inside, number);
        let between = returning(&reflected, &lower.reflection).lu();
        let refracted = between.solve(&passing)?;
        let mut reflection = passing.tr_mul(&(&lower.reflection * refracted));
        for j in 0..number {
            reflection[(j, j)] += reflected[j];
        }
        let back = reflected.rows(0, inside).component_mul(&lower.emission);
        let emission = passing.tr_mul(&(&lower.reflection * between.solve(&back)? + &lower.emission));
        Some(Below { reflection, emission })
    }

    /// Reflectance of an interface at the first `number` directions, from either side.
    fn reflectances(&self, above: f64, below: f64, number: usize) -> DVector<f64> {
        let at = |o: &Ordinate| interface_reflectance(o.lateral, above, below);
        DVector::from_iterator(number, self.ordinates[..number].iter().map(at))
    }

    fn solve(&self, incidence: Incidence) -> Option<(Solved, Vec<f64>)> {
        let descents = self.descents()?;
        let media = self.media();
        let number = self.layers[0].modes.cosines.len();
        let roots =
            DVector::from_iterator(self.ordinates.len(), self.ordinates.iter().map(|o| o.etendue.sqrt()));
        let flux = |light: &DVector<f64>| 2.0 * PI * roots.rows(0, light.len()).dot(light);
        let surface = self.reflectances(media[0], media[1], number);
        let mut entering = DVector::zeros(number);
        let specular_reflectance = match incidence {
            Incidence::Lambertian => {
                let radiance = 1.0 / (PI * media[0] * media[0]);
                for j in 0..number {
                    entering[j] = radiance * (1.0 - surface[j]) * roots[j];
                }
                1.0 - flux(&entering)
            }
            Incidence::Collimated { cosine } => fresnel_reflectance(cosine, media[0], media[1]),
        };
        let top = &descents[0].at_top;
        let back = surface.component_mul(&top.emission);
        let mut down = returning(&surface, &top.reflection).lu().solve(&(entering + back))?;
        let mut up = &top.reflection * &down + &top.emission;
        let basic_radiance: Vec<f64> = up.iter().zip(&roots).map(|(x, root)| x / root).collect();
        let leaving = up.component_mul(&surface.map(|r| 1.0 - r));
        let reflectance = flux(&leaving) + self.unscattered[0];
        let (mut absorbed, mut layers) = (Vec::new(), Vec::new());
        let mut transmittance = self.unscattered[1];
        for (i, (layer, descent)) in self.layers.iter().zip(&descents).enumerate() {
            let down_bottom = &descent.passing * &down + &descent.emission;
            let up_bottom = &descent.below.reflection * &down_bottom + &descent.below.emission;
            let net = flux(&down) - flux(&up) - flux(&down_bottom) + flux(&up_bottom);
            absorbed.push(net + layer.taken_from_beam());
            layers.push(layer.field(&roots, &down + &up, &down_bottom + &up_bottom));
            if let Some(next) = descents.get(i + 1) {
                (down, up) = self.enter_next(next, media[i + 1], media[i + 2], down_bottom)?;
            } else {
                let passing =
                    self.reflectances(media[i + 1], media[i + 2], down_bottom.len()).map(|r| 1.0 - r);
                transmittance += flux(&down_bottom.component_mul(&passing));
            }
        }
        Some((Solved { specular_reflectance, reflectance, transmittance, absorbed, layers }, basic_radiance))
    }

    /// Light below an interface, downward and upward, from the downward light above it.
    fn enter_next(
        &self,
        next: &Descent,
        above: f64,
        below: f64,
        down: DVector<f64>,
    ) -> Option<(DVector<f64>, DVector<f64>)> {
        let lower = &next.at_top;
        let inside = lower.emission.len();
        let entered = if above.total_cmp(&below).is_eq() {
            down
        } else {
            let reflected = self.reflectances(above, below, down.len().max(inside));
            let back = reflected.rows(0, inside).component_mul(&lower.emission);
            let source = crossing(&reflected, inside, down.len()) * down + back;
            returning(&reflected, &lower.reflection).lu().solve(&source)?
        };
        let up = &lower.reflection * &entered + &lower.emission;
        Some((entered, up))
    }
}

impl SolverLayer {
    /// This layer upon what lies below it.
    fn upon(&self, below: Below) -> Option<Descent> {
        let (r, t) = (&self.modes.reflection, &self.modes.transmission);
        let number = self.modes.cosines.len();
        let [up, down] = self.scattered_beam(number);
        let between = (DMatrix::identity(number, number) - r * &below.reflection).lu();
        let passing = between.solve(t)?;
        let emission = between.solve(&(down + r * &below.emission))?;
        let at_top = Below {
            reflection: r + t * (&below.reflection * &passing),
            emission: up + t * (&below.reflection * &emission + &below.emission),
        };
        Some(Descent { passing, emission, below, at_top })
    }

    /// Light that the layer alone scatters out of a beam and that leaves at its top and at its bottom.
    fn scattered_beam(&self, number: usize) -> [DVector<f64>; 2] {
        let Some(LayerBeam { source, flux: [down, up] }) = &self.beam else {
            return [DVector::zeros(number), DVector::zeros(number)];
        };
        [&source.up * *down + &source.down * *up, &source.down * *down + &source.up * *up]
    }

    /// Flux that a beam loses in this layer.
    fn taken_from_beam(&self) -> f64 {
        let lost =
            |b: &LayerBeam| (b.flux[0] + b.flux[1]) * (1.0 - b.source.transmittance(self.thickness_mm));
        self.beam.as_ref().map_or(0.0, lost)
    }

    /// Fluence from the sums `S` at the top and at the bottom.
    fn field(&self, roots: &DVector<f64>, mut top: DVector<f64>, mut bottom: DVector<f64>) -> LayerField {
        let modes = &self.modes;
        let number = modes.cosines.len();
        let per_sum =
            DVector::from_iterator(number, (0..number).map(|i| 2.0 * PI * roots[i] / modes.cosines[i]));
        let per_mode = modes.sums.tr_mul(&per_sum);
        let beam = self.beam.as_ref().map(|LayerBeam { source, flux }| {
            let [near, far] = [0.0, self.thickness_mm].map(|z| source.particular(modes, z).0);
            top -= &near * flux[0] + &far * flux[1];
            bottom -= far * flux[0] + near * flux[1];
            let amplitude = |(j, &k)| per_mode[j] * source.amplitude(j, k);
            BeamFluence {
                decay_per_mm: source.decay_per_mm,
                unscattered: 1.0 / source.cosine,
                scattered: modes.decay_per_mm.iter().enumerate().map(amplitude).collect(),
                flux: *flux,
            }
        });
        let of_modes = |sums: DVector<f64>| {
            let q = modes.differences.tr_mul(&sums);
            q.component_mul(&per_mode).iter().copied().collect()
        };
        LayerField {
            thickness_mm: self.thickness_mm,
            decay_per_mm: modes.decay_per_mm.clone(),
            top: of_modes(top),
            bottom: of_modes(bottom),
            beam,
        }
    }
}

/// Reflectance of an interface for light with `n sin(theta) = lateral`; 1 where one of the media has no such direction.
fn interface_reflectance(lateral: f64, above: f64, below: f64) -> f64 {
    if lateral >= above.min(below) {
        return 1.0;
    }
    fresnel_reflectance(cosine(lateral, above), above, below)
}

/// Transmission of an interface, from `from` into `into` directions.
fn crossing(reflected: &DVector<f64>, into: usize, from: usize) -> DMatrix<f64> {
    DMatrix::from_fn(into, from, |row, column| if row == column { 1.0 - reflected[row] } else { 0.0 })
}

/// `1 - r R`: light between an interface and what lies below it.
fn returning(reflected: &DVector<f64>, below: &DMatrix<f64>) -> DMatrix<f64> {
    let number = below.nrows();
    DMatrix::from_fn(number, number, |row, column| {
        f64::from(u8::from(row == column)) - reflected[row] * below[(row, column)]
    })
}
