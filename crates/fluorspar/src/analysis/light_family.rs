//! A family of tissues as seen by some channels: sources of light whose colors depend on a few coordinates of the tissue.
//!
//! Electrons of datum `i` (a channel of a frame) are
//!
//! `m_i = g_f [ sum_k a_k exp(D_ki(x)) (1 + q exp(V_ki(x))) + p exp(D_pi(x)) (1 + q exp(V_pi(x))) ]`
//!
//! with the coordinates `x` (blood, saturation, depth), amounts `a_k` of the sources, the amount `p` of the porphyrin, the share
//! `q` of light that the tissue reflects once more before it leaves, and the gain `g_f` of the frame. `D` and `V` are cubic
//! polynomials that were fitted to solutions of light transport. Everything but `p` is a nuisance and a standard normal number in
//! its own scale: `x = c tanh(s u / c)`, `a_k = median exp(sd u)`, and so on.

use nalgebra::{DMatrix, DVector};

/// Bound of the coordinates, in standard deviations: solutions were made for such tissue only.
const LARGEST_COORDINATE: f64 = 3.5;

/// Terms of a polynomial of third degree in some coordinates, and their slopes.
pub struct CubicTerms {
    /// Value of each term.
    pub values: Vec<f64>,
    /// Slope of each term, `[coordinate][term]`.
    pub slopes: Vec<Vec<f64>>,
}

impl CubicTerms {
    /// All products of up to three coordinates.
    #[must_use]
    pub fn new(x: &[f64]) -> Self {
        let mut terms = Self { values: vec![1.0], slopes: vec![vec![0.0]; x.len()] };
        for i in 0..x.len() {
            terms.push(x, &[i]);
            for j in i..x.len() {
                terms.push(x, &[i, j]);
                for k in j..x.len() {
                    terms.push(x, &[i, j, k]);
                }
            }
        }
        terms
    }

    fn push(&mut self, x: &[f64], factors: &[usize]) {
        self.values.push(factors.iter().map(|&factor| x[factor]).product());
        for (coordinate, slopes) in self.slopes.iter_mut().enumerate() {
            let slope = |place: usize| -> f64 {
                let others = factors.iter().enumerate().filter(|(other, _)| *other != place);
                others.map(|(_, &factor)| x[factor]).product()
            };
            let places = (0..factors.len()).filter(|&place| factors[place] == coordinate);
            slopes.push(places.map(slope).sum());
        }
    }

    fn sum(&self, coefficients: &[f64]) -> f64 {
        dot(&self.values, coefficients)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// What kind of uncertainty a nuisance stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NuisanceGroup {
    /// Blood, its saturation, depth.
    Tissue,
    /// Amounts of the fluorophores.
    Fluorophores,
    /// Light that comes from or by way of other surfaces.
    Surroundings,
    /// Light that never fluoresced.
    Leak,
    /// Errors of the library of spectra.
    Library,
    /// How much light there is.
    Brightness,
}

impl NuisanceGroup {
    /// All groups.
    pub const ALL: [Self; 6] =
        [Self::Tissue, Self::Fluorophores, Self::Surroundings, Self::Leak, Self::Library, Self::Brightness];

    /// Its name for people.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Tissue => "blood, saturation and depth",
            Self::Fluorophores => "mix of the bulk",
            Self::Surroundings => "indirect light and light of teeth",
            Self::Leak => "leaked light",
            Self::Library => "errors of the library of spectra",
            Self::Brightness => "brightness",
        }
    }
}

/// A source of light.
#[derive(Clone, Debug, PartialEq)]
pub struct FamilySource {
    /// Name.
    pub name: String,
    /// What its amount stands for.
    pub group: NuisanceGroup,
    /// Amount in the middle of the prior; the porphyrin's is that of the middle of its slab.
    pub median: f64,
    /// Standard deviation of the logarithm of the amount.
    pub log_sd: f64,
    /// Whether its light fluoresced.
    pub fluorescent: bool,
    /// Coefficients of the logarithm of the electrons of a unit amount, `[datum][term]`.
    pub direct: Vec<Vec<f64>>,
    /// Coefficients of the logarithm of the ratio that one more reflection by the tissue makes, `[datum][term]`.
    pub once_more: Vec<Vec<f64>>,
}

/// A coordinate of the tissue.
#[derive(Clone, Debug, PartialEq)]
pub struct FamilyCoordinate {
    /// Name.
    pub name: String,
    /// Width of the prior, in units of the coordinate, in which the polynomials are.
    pub sd: f64,
}

/// A family of tissues before a camera, with what is known of it beforehand.
#[derive(Clone, Debug, PartialEq)]
pub struct LightFamily {
    /// What the prior is, for people.
    pub prior: String,
    /// Coordinates of the tissue.
    pub coordinates: Vec<FamilyCoordinate>,
    /// Everything but the porphyrin.
    pub sources: Vec<FamilySource>,
    /// The porphyrin.
    pub porphyrin: FamilySource,
    /// Probability, before the measurement, that there is none of it.
    pub probability_of_none: f64,
    /// Share of the light that is reflected once more: median and standard deviation of the logarithm.
    pub indirect: Option<[f64; 2]>,
    /// Labels of the frames.
    pub frames: Vec<String>,
    /// Frame of each datum, the frame whose share is asked for being number 0.
    pub frame_of: Vec<usize>,
    /// Standard deviation of the logarithm of the brightness that all frames share.
    pub gain_log_sd: f64,
    /// The same of the brightness of each frame by itself; none for a single frame.
    pub lamp_log_sd: f64,
    /// Relative error of the electrons of each datum by itself, by the spectra of the library and by the polynomials.
    pub model_error: Vec<f64>,
    /// Relative error by the spectra of the library that each channel has alike in all frames: what emits is the same.
    pub common_error: f64,
    /// Channel of each datum.
    pub channel_of: Vec<usize>,
}

/// Electrons of a family for given nuisances, with slopes.
pub(super) struct FamilyPoint {
    /// Electrons of each datum.
    pub(super) electrons: Vec<f64>,
    /// Slopes of the electrons by the nuisances, `[datum, nuisance]`.
    pub(super) slopes: DMatrix<f64>,
    /// Electrons of each datum that the porphyrin emitted.
    pub(super) porphyrin: Vec<f64>,
    /// Logarithm of porphyrin over other fluorescence in the first frame; 0 without either.
    pub(super) log_odds: f64,
    /// Its slopes.
    pub(super) log_odds_slopes: DVector<f64>,
}

/// Electrons of one source in one datum with slopes by coordinates and by `ln q`.
struct SourceValue {
    value: f64,
    by_coordinate: Vec<f64>,
    by_log_indirect: f64,
}

impl LightFamily {
    /// Names of the nuisances with their groups, in order.
    #[must_use]
    pub fn nuisances(&self) -> Vec<(String, NuisanceGroup)> {
        let coordinates = self.coordinates.iter().map(|c| (c.name.clone(), NuisanceGroup::Tissue));
        let sources = self.sources.iter().map(|source| (source.name.clone(), source.group));
        let mut names: Vec<_> = coordinates.chain(sources).collect();
        if self.indirect.is_some() {
            names.push(("indirect light".into(), NuisanceGroup::Surroundings));
        }
        for channel in 0..self.channels() {
            names
                .push((format!("spectra of the library in channel {}", channel + 1), NuisanceGroup::Library));
        }
        names.push(("brightness".into(), NuisanceGroup::Brightness));
        if self.frames.len() > 1 {
            let lamp = |frame: &String| (format!("brightness of {frame}"), NuisanceGroup::Brightness);
            names.extend(self.frames.iter().map(lamp));
        }
        names
    }

    /// Number of channels.
    fn channels(&self) -> usize {
        self.channel_of.iter().max().map_or(0, |largest| largest + 1)
    }

    /// The same family with a group of nuisances known: held in the middle of the prior.
    #[must_use]
    pub fn with_known(&self, group: NuisanceGroup) -> Self {
        let mut family = self.clone();
        let known = |of: NuisanceGroup| of == group;
        if known(NuisanceGroup::Tissue) {
            family.coordinates.iter_mut().for_each(|coordinate| coordinate.sd = 0.0);
        }
        family.sources.iter_mut().filter(|source| known(source.group)).for_each(|source| source.log_sd = 0.0);
        if let (Some(indirect), true) = (&mut family.indirect, known(NuisanceGroup::Surroundings)) {
            indirect[1] = 0.0;
        }
        if known(NuisanceGroup::Library) {
            family.common_error = 0.0;
            family.model_error.fill(0.0);
        }
        if known(NuisanceGroup::Brightness) {
            (family.gain_log_sd, family.lamp_log_sd) = (0.0, 0.0);
        }
        family
    }

    /// The same family with a prior of another width: standard deviations of coordinates, amounts and indirect light times a
    /// factor.
    #[must_use]
    pub fn widened(&self, factor: f64) -> Self {
        let mut family = self.clone();
        family.coordinates.iter_mut().for_each(|coordinate| coordinate.sd *= factor);
        family.sources.iter_mut().for_each(|source| source.log_sd *= factor);
        family.porphyrin.log_sd *= factor;
        if let Some(indirect) = &mut family.indirect {
            indirect[1] *= factor;
        }
        family
    }

    /// Electrons for nuisances, each in standard deviations of its prior, and an amount of porphyrin.
    #[must_use]
    pub fn electrons(&self, nuisances: &[f64], porphyrin: f64) -> Vec<f64> {
        self.point(nuisances, porphyrin).electrons
    }

    /// The share of the porphyrin in the fluorescence electrons of the first frame.
    #[must_use]
    pub fn share(&self, nuisances: &[f64], porphyrin: f64) -> f64 {
        if porphyrin > 0.0 { 1.0 / (1.0 + (-self.point(nuisances, porphyrin).log_odds).exp()) } else { 0.0 }
    }

    pub(super) fn point(&self, nuisances: &[f64], porphyrin: f64) -> FamilyPoint {
        let (n, tissue) = (self.frame_of.len(), self.coordinates.len());
        let sources = tissue + self.sources.len();
        let library = sources + usize::from(self.indirect.is_some());
        let gain = library + self.channels();

        // Bring nuisances to their scales
        let scaled = |(u, coordinate): (&f64, &FamilyCoordinate)| {
            let bent = (coordinate.sd * u / LARGEST_COORDINATE).tanh();
            (LARGEST_COORDINATE * bent, coordinate.sd * (1.0 - bent * bent))
        };
        let (x, x_slopes): (Vec<f64>, Vec<f64>) = nuisances.iter().zip(&self.coordinates).map(scaled).unzip();
        let terms = CubicTerms::new(&x);
        let [indirect, indirect_sd] = match self.indirect {
            Some([median, sd]) => [median * (sd * nuisances[sources]).exp(), sd],
            None => [0.0; 2],
        };
        let lamp_sd = if self.frames.len() > 1 { self.lamp_log_sd } else { 0.0 };
        let gain_of = |frame: usize| {
            let own = if self.frames.len() > 1 { lamp_sd * nuisances[gain + 1 + frame] } else { 0.0 };
            (self.gain_log_sd * nuisances[gain] + own).exp()
        };

        // Add up the sources
        let mut point = FamilyPoint {
            electrons: vec![0.0; n],
            slopes: DMatrix::zeros(n, nuisances.len()),
            porphyrin: vec![0.0; n],
            log_odds: 0.0,
            log_odds_slopes: DVector::zeros(nuisances.len()),
        };
        let mut sums = [0.0; 2];
        let mut sum_slopes = [DVector::zeros(nuisances.len()), DVector::zeros(nuisances.len())];
        let amounts = self.sources.iter().enumerate().map(|(k, source)| {
            (Some(tissue + k), source, source.median * (source.log_sd * nuisances[tissue + k]).exp())
        });
        let all = amounts.chain((porphyrin > 0.0).then_some((None, &self.porphyrin, porphyrin)));
        for (place, source, amount) in all {
            for datum in 0..n {
                let SourceValue { value, by_coordinate, by_log_indirect } =
                    source.value(datum, &terms, indirect);
                let spectra = library + self.channel_of[datum];
                let error = (self.common_error * nuisances[spectra]).exp();
                let value = amount * gain_of(self.frame_of[datum]) * value * error;
                let is_porphyrin = place.is_none();
                let counted =
                    (self.frame_of[datum] == 0 && source.fluorescent).then_some(usize::from(is_porphyrin));
                point.electrons[datum] += value;
                if is_porphyrin {
                    point.porphyrin[datum] = value;
                }
                if let Some(kind) = counted {
                    sums[kind] += value;
                }
                let mut slope = |nuisance: usize, slope: f64| {
                    point.slopes[(datum, nuisance)] += slope;
                    if let Some(kind) = counted {
                        sum_slopes[kind][nuisance] += slope;
                    }
                };
                for (i, by) in by_coordinate.iter().enumerate() {
                    slope(i, value * by * x_slopes[i]);
                }
                if let Some(place) = place {
                    slope(place, value * source.log_sd);
                }
                if self.indirect.is_some() {
                    slope(sources, value * by_log_indirect * indirect_sd);
                }
                slope(spectra, value * self.common_error);
                slope(gain, value * self.gain_log_sd);
                if self.frames.len() > 1 {
                    slope(gain + 1 + self.frame_of[datum], value * lamp_sd);
                }
            }
        }
        if sums[0] > 0.0 && sums[1] > 0.0 {
            point.log_odds = (sums[1] / sums[0]).ln();
            point.log_odds_slopes = &sum_slopes[1] / sums[1] - &sum_slopes[0] / sums[0];
        }
        point
    }
}

impl FamilySource {
    /// Electrons of a unit amount without gain; slopes are of their logarithm.
    fn value(&self, datum: usize, terms: &CubicTerms, indirect: f64) -> SourceValue {
        let direct = terms.sum(&self.direct[datum]).exp();
        let again = indirect * terms.sum(&self.once_more[datum]).exp();
        let by_log_indirect = again / (1.0 + again);
        let by_coordinate = terms
            .slopes
            .iter()
            .map(|slopes| {
                dot(slopes, &self.direct[datum]) + by_log_indirect * dot(slopes, &self.once_more[datum])
            })
            .collect();
        SourceValue { value: direct * (1.0 + again), by_coordinate, by_log_indirect }
    }
}
