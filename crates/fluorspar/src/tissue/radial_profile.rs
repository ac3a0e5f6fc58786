//! How far from where it enters light leaves a tissue: reflected, and after fluorescence.
//!
//! Photons are traced once for each way in which layers scatter; absorption at any wavelength and in any state is put in afterwards.
//! Fluorescence is the excitation that passes a place, and light of the emission from there, which by reciprocity is what would pass
//! there of a beam from above: its distance is the sum of both, each turned by any angle.

use rayon::prelude::*;

use super::discrete_ordinates::Incidence;
use super::layered_tissue::LayeredTissue;
use super::monte_carlo::{Recorded, Ways, trace_ways};
use super::optical_layer::{OpticalLayer, OpticalStack};
use super::radial_mixture::{GAUSSIANS, RINGS, Shares, fit, ring};
use crate::sampling::random::Key;

/// Wavelengths of the excitation of fluorescence, nm: on either side of the Soret band of hemoglobin, and on it.
pub const EXCITATIONS_NM: [f64; 3] = [385.0, 415.0, 450.0];
/// Photons that are traced for each way of scattering: counts in rings of a tenth of the light are good to 5 %,
/// and their mixtures to less.
pub(crate) const PHOTONS: u64 = 4096;
/// Wavelengths at which photons are traced, nm; between them the shares of the mixtures are interpolated.
const TRACED_NM: [f64; 4] = [395.0, 480.0, 570.0, 680.0];
/// Wavelengths of the profiles, nm: bands and gaps of hemoglobin.
static REFLECTED_NM: [f64; 24] = [
    350.0, 385.0, 400.0, 410.0, 420.0, 430.0, 440.0, 450.0, 465.0, 480.0, 500.0, 520.0, 535.0, 542.0, 550.0,
    560.0, 570.0, 577.0, 585.0, 600.0, 620.0, 650.0, 700.0, 780.0,
];
/// Number of wavelengths of the emission of fluorescence.
const EMISSIONS: usize = 11;
/// Wavelengths of the emission of fluorescence, nm.
pub(crate) static EMITTED_NM: [f64; EMISSIONS] =
    [430.0, 460.0, 490.0, 520.0, 542.0, 560.0, 577.0, 600.0, 635.0, 680.0, 750.0];
/// For every so many photons that are followed to where they leave, one is asked where it passes: it passes many places.
const PASSING: u64 = 4;
/// Photons for each pair of places that is drawn in each slice of a layer.
const PER_PAIR: u64 = 4;
/// Thickness of the uppermost slice of a thick layer, mm; each slice below is twice as thick.
const SLICE_MM: f64 = 0.1;
/// Least absorption with which photons are traced, 1/mm: without any they might wander on forever.
const LEAST_PER_MM: f64 = 1e-3;
/// Ways that a slice holds at least; a thinner slice looks above and below itself, as fluence changes little there.
const LEAST_WAYS: usize = 64;
/// Slices of a layer at most.
const SLICES: usize = 6;

/// Mixtures of Gaussians against wavelength; the ends are held.
#[derive(Clone, Debug, PartialEq)]
pub struct RadialProfile {
    /// Wavelengths, nm, rising.
    wavelengths_nm: &'static [f64],
    /// Shares of the Gaussians of [`super::gaussian_mm`] at each; they add up to 1.
    shares: Vec<Shares>,
}

/// Profiles of one tissue.
#[derive(Clone, Debug, PartialEq)]
pub struct TissueProfiles {
    /// Reflected light, by its wavelength.
    pub reflected: RadialProfile,
    /// Fluorescence of each fluorophore by its name, of all layers together, for each of [`EXCITATIONS_NM`] by the wavelength of the
    /// emission.
    pub fluorescence: Vec<(String, [RadialProfile; 3])>,
}

impl RadialProfile {
    /// Shares of the Gaussians at a wavelength.
    #[must_use]
    pub fn at(&self, wavelength_nm: f64) -> [f32; GAUSSIANS] {
        let (low, high, t) = neighbors(self.wavelengths_nm, wavelength_nm);
        blend(&self.shares[low], &self.shares[high], t)
    }

    /// All its shares, wavelength by wavelength.
    pub(crate) fn values(&self) -> &[f32] {
        self.shares.as_flattened()
    }

    /// A profile of reflected light with these [`Self::values`].
    pub(crate) fn of_reflected(values: &[f32]) -> Option<Self> {
        Self::of_values(&REFLECTED_NM, values)
    }

    /// A profile of fluorescence with these [`Self::values`].
    pub(crate) fn of_emitted(values: &[f32]) -> Option<Self> {
        Self::of_values(&EMITTED_NM, values)
    }

    fn of_values(wavelengths_nm: &'static [f64], values: &[f32]) -> Option<Self> {
        let (shares, rest) = values.as_chunks();
        let fits = rest.is_empty() && shares.len() == wavelengths_nm.len();
        fits.then(|| Self { wavelengths_nm, shares: shares.to_vec() })
    }
}

/// The two of rising wavelengths on either side of one, and how far it is from the first to the second, 0 to 1.
fn neighbors(known_nm: &[f64], wavelength_nm: f64) -> (usize, usize, f64) {
    let last = known_nm.len() - 1;
    let high = known_nm.partition_point(|nm| *nm <= wavelength_nm).clamp(1.min(last), last);
    let low = high.saturating_sub(1);
    if high == low {
        return (low, high, 0.0);
    }
    let t = (wavelength_nm - known_nm[low]) / (known_nm[high] - known_nm[low]);
    (low, high, t.clamp(0.0, 1.0))
}

fn blend(low: &Shares, high: &Shares, t: f64) -> Shares {
    std::array::from_fn(|k| low[k] + t as f32 * (high[k] - low[k]))
}

/// Layers of a tissue as its photons meet them: neighbors that are alike in all but their fluorophores are one.
struct MetLayers {
    /// Numbers of the layers of the tissue in each.
    members: Vec<std::ops::Range<usize>>,
    /// At [`TRACED_NM`], without absorption.
    stacks: Vec<OpticalStack>,
    /// Absorption of each, `[layer]`, 1/mm, at [`REFLECTED_NM`], [`EMITTED_NM`] and [`EXCITATIONS_NM`].
    reflected: Vec<Vec<f64>>,
    emitted: Vec<Vec<f64>>,
    exciting: Vec<Vec<f64>>,
}

impl MetLayers {
    fn new(tissue: &LayeredTissue) -> Self {
        let all = |nm: &[f64]| nm.iter().map(|nm| tissue.optics(*nm)).collect::<Vec<_>>();
        let [reflected, emitted, exciting] = [&REFLECTED_NM[..], &EMITTED_NM, &EXCITATIONS_NM].map(all);
        let traced = all(&TRACED_NM);
        // Join layers that are alike
        let alike = |stack: &OpticalStack, a: usize, b: usize| {
            let same_thickness = |layer: OpticalLayer| OpticalLayer { thickness_mm: 0.0, ..layer };
            same_thickness(stack.layers[a]) == same_thickness(stack.layers[b])
        };
        let mut members: Vec<std::ops::Range<usize>> = Vec::new();
        for layer in 0..tissue.layers.len() {
            let joins = |before: usize| {
                reflected.iter().chain(&emitted).chain(&exciting).all(|stack| alike(stack, before, layer))
            };
            match members.last_mut() {
                Some(last) if joins(last.start) => last.end = layer + 1,
                _ => members.push(layer..layer + 1),
            }
        }
        let joined = |stack: &OpticalStack| {
            let layer = |members: &std::ops::Range<usize>| {
                let thickness: f64 = stack.layers[members.clone()].iter().map(|l| l.thickness_mm).sum();
                // To 1 nm, so that a film on a layer leaves their sum as it was
                let thickness_mm = (1e6 * thickness).round() * 1e-6;
                OpticalLayer { thickness_mm, absorption_per_mm: 0.0, ..stack.layers[members.start] }
            };
            OpticalStack { layers: members.iter().map(layer).collect(), ..stack.clone() }
        };
        let absorption = |stacks: &[OpticalStack]| -> Vec<Vec<f64>> {
            let of_stack = |stack: &OpticalStack| {
                members.iter().map(|members| stack.layers[members.start].absorption_per_mm).collect()
            };
            stacks.iter().map(of_stack).collect()
        };
        let [reflected, emitted, exciting] =
            [&reflected, &emitted, &exciting].map(|stacks| absorption(stacks));
        Self { stacks: traced.iter().map(joined).collect(), members, reflected, emitted, exciting }
    }

    /// Least absorption of each layer at any of the wavelengths.
    fn least_absorption(&self) -> Vec<f64> {
        let all = self.reflected.iter().chain(&self.emitted).chain(&self.exciting);
        all.fold(vec![f64::INFINITY; self.members.len()], |mut least, at| {
            least.iter_mut().zip(at).for_each(|(least, value)| *least = least.min(*value));
            least
        })
    }
}

/// Ways through layers that scatter alike, and the absorption with which they were traced.
#[derive(Default)]
struct TracedLayers {
    stacks: Vec<OpticalStack>,
    absorption_per_mm: Vec<f64>,
    /// Pairs in each slice of a layer.
    pairs: usize,
    /// Of a beam, where they leave, at each of [`TRACED_NM`].
    reflected: Vec<Ways>,
    /// Of a beam, where they pass, at the first.
    exciting: Ways,
    /// Of light from all directions, where they pass, at each: that which leaves in all directions.
    emitted: Vec<Ways>,
}

impl TracedLayers {
    /// Traces photons with the absorption that is known by now.
    fn trace(&mut self, photons: u64) {
        for (number, stack) in self.stacks.iter().enumerate() {
            let mut stack = stack.clone();
            for (layer, absorption) in stack.layers.iter_mut().zip(&self.absorption_per_mm) {
                layer.absorption_per_mm = *absorption;
            }
            let passing = photons.div_ceil(PASSING);
            self.pairs = photons.div_ceil(PER_PAIR) as usize;
            if number == 0 {
                self.exciting = trace_ways(&stack, Incidence::NORMAL, passing, Recorded::Passed);
            }
            self.reflected.push(trace_ways(&stack, Incidence::NORMAL, photons, Recorded::Left));
            self.emitted.push(trace_ways(&stack, Incidence::Lambertian, passing, Recorded::Passed));
        }
    }

    /// More absorption than the ways were traced with.
    fn more(&self, absorption_per_mm: &[f64]) -> Vec<f32> {
        let pairs = absorption_per_mm.iter().zip(&self.absorption_per_mm);
        pairs.map(|(value, traced)| (value - traced) as f32).collect()
    }
}

/// Profiles of tissues, `photons` traced for each way of scattering. Tissues that scatter alike share them, so that their noise is the
/// same.
#[must_use]
pub fn radial_profiles(tissues: &[LayeredTissue], photons: u64) -> Vec<TissueProfiles> {
    let met: Vec<MetLayers> = tissues.iter().map(MetLayers::new).collect();

    // Trace photons once for all tissues that scatter alike, with the least absorption of any
    let mut traced: Vec<TracedLayers> = Vec::new();
    let mut place = Vec::with_capacity(met.len());
    for layers in &met {
        let number = traced.iter().position(|known| known.stacks == layers.stacks).unwrap_or_else(|| {
            let (stacks, least) = (layers.stacks.clone(), vec![f64::INFINITY; layers.members.len()]);
            traced.push(TracedLayers { stacks, absorption_per_mm: least, ..TracedLayers::default() });
            traced.len() - 1
        });
        let least = &mut traced[number].absorption_per_mm;
        let absorbed = layers.least_absorption().into_iter().map(|value| value.max(LEAST_PER_MM));
        least.iter_mut().zip(absorbed).for_each(|(least, value)| *least = least.min(value));
        place.push(number);
    }
    traced.iter_mut().for_each(|layers| layers.trace(photons));

    // Put in the absorption of each tissue
    let profiles = |(tissue, (layers, place)): (&LayeredTissue, (&MetLayers, &usize))| TissueProfiles {
        reflected: reflected(layers, &traced[*place]),
        fluorescence: fluorescence(tissue, layers, &traced[*place]),
    };
    tissues.par_iter().zip(met.par_iter().zip(&place)).map(profiles).collect()
}

fn reflected(layers: &MetLayers, traced: &TracedLayers) -> RadialProfile {
    let rings: Vec<Vec<usize>> = traced.reflected.iter().map(rings_of).collect();
    let counted_with = |number: usize, absorption: &[f64]| {
        let weights = traced.reflected[number].weights(&traced.more(absorption));
        let mut counted = [0.0; RINGS];
        for (weight, ring) in weights.iter().zip(&rings[number]) {
            if let Some(sum) = counted.get_mut(*ring) {
                *sum += f64::from(*weight);
            }
        }
        counted
    };
    let shares = REFLECTED_NM.iter().zip(&layers.reflected).map(|(nm, absorption)| {
        let (low, high, t) = neighbors(&TRACED_NM, *nm);
        fit(&mixed(&counted_with(low, absorption), &counted_with(high, absorption), t))
    });
    RadialProfile { shares: shares.collect(), wavelengths_nm: &REFLECTED_NM }
}

/// Light in rings between two wavelengths at which photons were traced: of each the same amount.
fn mixed(low: &[f64; RINGS], high: &[f64; RINGS], t: f64) -> [f64; RINGS] {
    let factor = |counted: &[f64; RINGS], share: f64| {
        let total: f64 = counted.iter().sum();
        if total > 0.0 { share / total } else { 0.0 }
    };
    let (of_low, of_high) = (factor(low, 1.0 - t), factor(high, t));
    std::array::from_fn(|ring| of_low * low[ring] + of_high * high[ring])
}

fn rings_of(ways: &Ways) -> Vec<usize> {
    ways.radius_mm.iter().map(|radius| ring(*radius)).collect()
}

/// Two places of about the same depth, one on a way of the excitation, one on a way of the emission, and how far they are apart when
/// either is turned about the beam at random.
struct Pair {
    exciting: u32,
    emitted: u32,
    ring: usize,
    /// Ways that it stands for, per mm of depth.
    weight: f64,
}

/// Depths of the slices of a layer, mm.
fn slices(top: f64, bottom: f64) -> Vec<[f64; 2]> {
    let thickness = bottom - top;
    if thickness <= 4.0 * SLICE_MM {
        let edge = |number: f64| top + thickness * number / 3.0;
        return (0..3).map(|number| [edge(f64::from(number)), edge(f64::from(number + 1))]).collect();
    }
    let edge = |number: usize| (top + SLICE_MM * ((1 << number) - 1) as f64).min(bottom);
    let all = (0..SLICES).map(|number| [edge(number), edge(number + 1)]);
    all.filter(|[upper, lower]| lower > upper).collect()
}

/// Ways that pass between two depths, or near enough that there are [`LEAST_WAYS`], and how far apart these depths are, mm.
fn inside(ways: &Ways, [upper, lower]: [f64; 2]) -> (Vec<u32>, f64) {
    let mut margin = 0.0;
    loop {
        let range = (upper - margin).max(0.0)..lower + margin;
        let depths = ways.depth_mm.iter().enumerate();
        let here = depths.filter(|(_, depth)| range.contains(&f64::from(**depth)));
        let found: Vec<u32> = here.map(|(number, _)| number as u32).collect();
        if found.len() >= LEAST_WAYS.min(ways.depth_mm.len()) {
            return (found, range.end - range.start);
        }
        margin = 2.0 * margin.max(0.25 * (lower - upper)).max(1e-5);
    }
}

/// Pairs in a layer between two depths.
fn pairs(exciting: &Ways, emitted: &Ways, [top, bottom]: [f64; 2], in_slice: usize) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for [upper, lower] in slices(top, bottom) {
        let (first, first_mm) = inside(exciting, [upper, lower]);
        let (second, second_mm) = inside(emitted, [upper, lower]);
        if first.is_empty() || second.is_empty() {
            continue;
        }
        let by_depth = (first.len() as f64 / first_mm) * (second.len() as f64 / second_mm);
        let weight = by_depth * (lower - upper) / in_slice as f64;
        for number in 0..in_slice {
            let key = Key::new(number as u64);
            let chosen = |list: &[u32], id: u64| list[(key.with(id).value() % list.len() as u64) as usize];
            let (exciting_way, emitted_way) = (chosen(&first, 1), chosen(&second, 2));
            let turn = std::f64::consts::TAU * (key.with(3).value() >> 11) as f64 / (1_u64 << 53) as f64;
            let a = f64::from(exciting.radius_mm[exciting_way as usize]);
            let b = f64::from(emitted.radius_mm[emitted_way as usize]);
            let distance = (a * a + b * b + 2.0 * a * b * turn.cos()).max(0.0).sqrt();
            pairs.push(Pair {
                exciting: exciting_way,
                emitted: emitted_way,
                ring: ring(distance as f32),
                weight,
            });
        }
    }
    pairs
}

/// Light in rings by excitation and emission, of one layer: `[excitation][emission]`.
type Counted = [[[f64; RINGS]; EMISSIONS]; EXCITATIONS_NM.len()];

fn fluorescence(
    tissue: &LayeredTissue,
    layers: &MetLayers,
    traced: &TracedLayers,
) -> Vec<(String, [RadialProfile; 3])> {
    // Weigh the ways of the excitation, and those of the emission as traced at the wavelengths on either side
    let exciting: Vec<Vec<f32>> =
        layers.exciting.iter().map(|a| traced.exciting.weights(&traced.more(a))).collect();
    let emitted_at = |number: usize| -> Vec<Vec<f32>> {
        let used = |nm: &f64| {
            let (low, high, _) = neighbors(&TRACED_NM, *nm);
            low == number || high == number
        };
        let of = |(nm, absorption): (&f64, &Vec<f64>)| {
            if used(nm) { traced.emitted[number].weights(&traced.more(absorption)) } else { Vec::new() }
        };
        EMITTED_NM.iter().zip(&layers.emitted).map(of).collect()
    };
    let emitted: Vec<Vec<Vec<f32>>> = (0..TRACED_NM.len()).map(emitted_at).collect();

    // Count pairs in the layers that fluoresce
    let mut top = 0.0;
    let mut names: Vec<String> = Vec::new();
    let mut sums: Vec<Vec<Box<Counted>>> = Vec::new();
    for layer in &tissue.layers {
        let bottom = top + 1e-3 * layer.thickness_um;
        if !layer.fluorophores.is_empty() {
            let counted: Vec<Box<Counted>> = (0..TRACED_NM.len())
                .map(|number| {
                    let found = pairs(&traced.exciting, &traced.emitted[number], [top, bottom], traced.pairs);
                    count(&found, &exciting, &emitted[number])
                })
                .collect();
            for held in &layer.fluorophores {
                let name = &held.fluorophore.name;
                let place = names.iter().position(|known| known == name).unwrap_or_else(|| {
                    names.push(name.clone());
                    let empty = || Box::new([[[0.0; RINGS]; EMISSIONS]; EXCITATIONS_NM.len()]);
                    sums.push((0..TRACED_NM.len()).map(|_| empty()).collect());
                    names.len() - 1
                });
                for (sum, counted) in sums[place].iter_mut().zip(&counted) {
                    let all = sum.as_flattened_mut().as_flattened_mut().iter_mut();
                    let added = counted.as_flattened().as_flattened();
                    all.zip(added).for_each(|(sum, light)| *sum += held.scale_per_mm() * light);
                }
            }
        }
        top = bottom;
    }
    let profile = |counted: &[Box<Counted>], excitation: usize| {
        let shares = EMITTED_NM.iter().enumerate().map(|(emission, nm)| {
            let (low, high, t) = neighbors(&TRACED_NM, *nm);
            let [low, high] = [low, high].map(|number| &counted[number][excitation][emission]);
            fit(&mixed(low, high, t))
        });
        RadialProfile { shares: shares.collect(), wavelengths_nm: &EMITTED_NM }
    };
    let profiles = sums.iter().map(|counted| std::array::from_fn(|excitation| profile(counted, excitation)));
    names.into_iter().zip(profiles).collect()
}

/// Light of pairs in rings.
fn count(pairs: &[Pair], exciting: &[Vec<f32>], emitted: &[Vec<f32>]) -> Box<Counted> {
    let mut counted: Box<Counted> = Box::new([[[0.0; RINGS]; EMISSIONS]; EXCITATIONS_NM.len()]);
    for pair in pairs.iter().filter(|pair| pair.ring < RINGS) {
        for (by_emission, exciting) in counted.iter_mut().zip(exciting) {
            let arriving = pair.weight * f64::from(exciting[pair.exciting as usize]);
            for (rings, emitted) in by_emission.iter_mut().zip(emitted).filter(|(_, e)| !e.is_empty()) {
                rings[pair.ring] += arriving * f64::from(emitted[pair.emitted as usize]);
            }
        }
    }
    counted
}
