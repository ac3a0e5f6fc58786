//! A family of tissues as seen by some channels: sources of light whose colors depend on a few coordinates of the tissue.
//!
//! Electrons of datum `i` (a channel of a frame) are
//!
//! `m_i = g_f c_i [ sum_k a_k exp(D_ki(x)) (1 + q exp(V_ki(x))) + p exp(D_pi(x)) (1 + q exp(V_pi(x))) ]`
//!
//! with the coordinates `x` (blood, saturation, depth), amounts `a_k` of the sources, the amount `p` of the porphyrin, the share
//! `q` of light that the tissue reflects once more before it leaves, the gain `g_f` of the frame, and errors `c_i = exp(L_i u)` of
//! the library of spectra, which channels that see the same wavelengths share. `D` and `V` are cubic polynomials that were fitted
//! to solutions of light transport. Everything but `p` is a nuisance and a standard normal number in its own scale:
//! `x = c tanh(s u / c)`, `a_k = median exp(sd u)`, and so on.

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
    /// Name of the tissue, that of its site.
    pub tissue: String,
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
    /// Channel of each datum.
    pub channel_of: Vec<String>,
    /// Whether the electrons of a datum count in the share: those of R, G and B of the first frame, or of all its channels.
    pub counted: Vec<bool>,
    /// Standard deviation of the logarithm of the brightness that all frames share.
    pub gain_log_sd: f64,
    /// The same of the brightness of each frame by itself; none for a single frame.
    pub lamp_log_sd: f64,
    /// Relative error of the electrons of each datum by itself, by the polynomials.
    pub model_error: Vec<f64>,
    /// Relative errors by the spectra of the library: `L` of the covariance `L L^T` of the logarithms of all data, one row each.
    pub library: DMatrix<f64>,
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
        let library = |(channel, frame): (&String, &usize)| {
            let name = format!("spectra of the library in {channel} of {}", self.frames[*frame]);
            (name, NuisanceGroup::Library)
        };
        names.extend(self.channel_of.iter().zip(&self.frame_of).map(library));
        names.push(("brightness".into(), NuisanceGroup::Brightness));
        if self.frames.len() > 1 {
            let lamp = |frame: &String| (format!("brightness of {frame}"), NuisanceGroup::Brightness);
            names.extend(self.frames.iter().map(lamp));
        }
        names
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
            family.library.fill(0.0);
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

    /// Factors on the electrons of the data by errors of the library, for nuisances.
    #[must_use]
    pub fn library_factors(&self, nuisances: &[f64]) -> Vec<f64> {
        let places = self.places();
        let errors = DVector::from_column_slice(&nuisances[places.library..places.gain]);
        (&self.library * errors).iter().map(|error| error.exp()).collect()
    }

    /// Where the kinds of nuisances begin.
    fn places(&self) -> Places {
        let sources = self.coordinates.len();
        let indirect = sources + self.sources.len();
        let library = indirect + usize::from(self.indirect.is_some());
        Places { sources, indirect, library, gain: library + self.frame_of.len() }
    }

    /// Gain of each frame, without that which only one frame has by itself.
    fn gains(&self, nuisances: &[f64], gain: usize) -> Vec<f64> {
        let own = |frame: usize| {
            if self.frames.len() > 1 { self.lamp_log_sd * nuisances[gain + 1 + frame] } else { 0.0 }
        };
        (0..self.frames.len()).map(|frame| (self.gain_log_sd * nuisances[gain] + own(frame)).exp()).collect()
    }

    pub(super) fn point(&self, nuisances: &[f64], porphyrin: f64) -> FamilyPoint {
        let n = self.frame_of.len();
        let places = self.places();

        // Bring nuisances to their scales
        let scaled = |(u, coordinate): (&f64, &FamilyCoordinate)| {
            let bent = (coordinate.sd * u / LARGEST_COORDINATE).tanh();
            (LARGEST_COORDINATE * bent, coordinate.sd * (1.0 - bent * bent))
        };
        let (x, x_slopes): (Vec<f64>, Vec<f64>) = nuisances.iter().zip(&self.coordinates).map(scaled).unzip();
        let terms = CubicTerms::new(&x);
        let [indirect, indirect_sd] = match self.indirect {
            Some([median, sd]) => [median * (sd * nuisances[places.indirect]).exp(), sd],
            None => [0.0; 2],
        };
        let gains = self.gains(nuisances, places.gain);
        let errors = self.library_factors(nuisances);

        // Add up the sources: the porphyrin, other fluorescence, and light that does not count
        let mut sums = [0, 1, 2].map(|_| Sums::none(n, nuisances.len()));
        let amounts = self.sources.iter().enumerate().map(|(k, source)| {
            let amount = source.median * (source.log_sd * nuisances[places.sources + k]).exp();
            (Some(places.sources + k), source, amount)
        });
        let all = amounts.chain((porphyrin > 0.0).then_some((None, &self.porphyrin, porphyrin)));
        for (place, source, amount) in all {
            let kind = match place {
                None => PORPHYRIN,
                Some(_) if source.fluorescent => BULK,
                Some(_) => NOT_COUNTED,
            };
            for datum in 0..n {
                let SourceValue { value, by_coordinate, by_log_indirect } =
                    source.value(datum, &terms, indirect);
                let value = amount * gains[self.frame_of[datum]] * errors[datum] * value;
                let sum = &mut sums[kind];
                sum.electrons[datum] += value;
                for (i, by) in by_coordinate.iter().enumerate() {
                    sum.slopes[(datum, i)] += value * by * x_slopes[i];
                }
                if let Some(place) = place {
                    sum.slopes[(datum, place)] += value * source.log_sd;
                }
                if self.indirect.is_some() {
                    sum.slopes[(datum, places.indirect)] += value * by_log_indirect * indirect_sd;
                }
            }
        }
        sums.iter_mut().for_each(|sum| self.add_slopes_of_factors(sum, &places));
        self.point_of(&sums)
    }

    /// Adds the slopes by what multiplies all light of a datum: errors of the library and gains.
    fn add_slopes_of_factors(&self, sum: &mut Sums, places: &Places) {
        for (datum, &value) in sum.electrons.iter().enumerate() {
            for error in 0..self.frame_of.len() {
                sum.slopes[(datum, places.library + error)] += value * self.library[(datum, error)];
            }
            sum.slopes[(datum, places.gain)] += value * self.gain_log_sd;
            if self.frames.len() > 1 {
                sum.slopes[(datum, places.gain + 1 + self.frame_of[datum])] += value * self.lamp_log_sd;
            }
        }
    }

    /// All light together, and the odds of the porphyrin in the data that count.
    fn point_of(&self, [porphyrin, bulk, rest]: &[Sums; 3]) -> FamilyPoint {
        let n = self.frame_of.len();
        let unknowns = porphyrin.slopes.ncols();
        let mut point = FamilyPoint {
            electrons: (0..n)
                .map(|i| porphyrin.electrons[i] + bulk.electrons[i] + rest.electrons[i])
                .collect(),
            slopes: &porphyrin.slopes + &bulk.slopes + &rest.slopes,
            porphyrin: porphyrin.electrons.clone(),
            log_odds: 0.0,
            log_odds_slopes: DVector::zeros(unknowns),
        };
        let counted = |sum: &Sums| -> (f64, DVector<f64>) {
            let data = (0..n).filter(|datum| self.counted[*datum]);
            data.fold((0.0, DVector::zeros(unknowns)), |(total, slopes), datum| {
                (total + sum.electrons[datum], slopes + sum.slopes.row(datum).transpose())
            })
        };
        let ((of_porphyrin, by_porphyrin), (of_bulk, by_bulk)) = (counted(porphyrin), counted(bulk));
        if of_porphyrin > 0.0 && of_bulk > 0.0 {
            point.log_odds = (of_porphyrin / of_bulk).ln();
            point.log_odds_slopes = by_porphyrin / of_porphyrin - by_bulk / of_bulk;
        }
        point
    }
}

/// Kinds of light in sums.
const PORPHYRIN: usize = 0;
const BULK: usize = 1;
const NOT_COUNTED: usize = 2;

/// Electrons of some sources in each datum, with slopes `[datum, nuisance]`.
struct Sums {
    electrons: Vec<f64>,
    slopes: DMatrix<f64>,
}

impl Sums {
    fn none(data: usize, nuisances: usize) -> Self {
        Self { electrons: vec![0.0; data], slopes: DMatrix::zeros(data, nuisances) }
    }
}

/// Number of the first nuisance of each kind; coordinates begin at 0.
struct Places {
    sources: usize,
    indirect: usize,
    library: usize,
    gain: usize,
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
