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

use super::Analyte;

/// Bound of the coordinates, in standard deviations: solutions were made for such tissue only.
const LARGEST_COORDINATE: f64 = 3.5;

/// Numbers that are summed side by side.
type Lanes = [f64; 4];

/// Terms of a polynomial of third degree in some coordinates, and their slopes.
pub struct CubicTerms {
    /// Value of each term.
    pub values: Vec<f64>,
    /// Value of each term and its slopes by the coordinates, four of these numbers at a time, `[group][term]`.
    lanes: Vec<Vec<Lanes>>,
}

/// Values of all products of up to three coordinates, in the order of [`CubicTerms`].
fn cubic_values(x: &[f64]) -> Vec<f64> {
    let mut values = vec![1.0];
    for i in 0..x.len() {
        values.push(x[i]);
        for j in i..x.len() {
            values.push(x[i] * x[j]);
            values.extend(x[j..].iter().map(|third| x[i] * x[j] * third));
        }
    }
    values
}

impl CubicTerms {
    /// All products of up to three coordinates.
    #[must_use]
    pub fn new(x: &[f64]) -> Self {
        let groups = (1 + x.len()).div_ceil(4);
        let mut terms = Self { values: Vec::new(), lanes: vec![Vec::new(); groups] };
        terms.push(x, &[]);
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
        let value = factors.iter().map(|&factor| x[factor]).product();
        let slope = |coordinate: usize| -> f64 {
            let without = |place: usize| -> f64 {
                let others = factors.iter().enumerate().filter(|(other, _)| *other != place);
                others.map(|(_, &factor)| x[factor]).product()
            };
            (0..factors.len()).filter(|&place| factors[place] == coordinate).map(without).sum()
        };
        self.values.push(value);
        let number = |lane: usize| match lane {
            0 => value,
            lane if lane <= x.len() => slope(lane - 1),
            _ => 0.0,
        };
        for (group, lanes) in self.lanes.iter_mut().enumerate() {
            lanes.push([0, 1, 2, 3].map(|lane| number(4 * group + lane)));
        }
    }

    /// Value of the polynomial with some coefficients, and its slopes by the coordinates, four of these numbers at a time.
    fn sum(&self, coefficients: &[f64], sums: &mut [Lanes]) {
        for (sum, terms) in sums.iter_mut().zip(&self.lanes) {
            // In variables of their own, which are kept in registers; without calls, which little optimization leaves in
            let [mut a, mut b, mut c, mut d] = [0.0; 4];
            for (term, coefficient) in terms.iter().zip(coefficients) {
                a += term[0] * coefficient;
                b += term[1] * coefficient;
                c += term[2] * coefficient;
                d += term[3] * coefficient;
            }
            *sum = [a, b, c, d];
        }
    }
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

impl FamilySource {
    /// Whether its light is that of plant pigment, which is red as that of porphyrin is.
    pub(super) fn is_pigment(&self) -> bool {
        self.fluorescent && Analyte::names_plant_pigment(&self.name)
    }
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
    /// Width of the prior over that of the population.
    pub width: f64,
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
    /// The same of all red emission, porphyrin and plant pigment, over other fluorescence; its slopes are empty without either.
    pub(super) red_log_odds: f64,
    pub(super) red_log_odds_slopes: DVector<f64>,
}

/// Electrons of a unit amount of one source in one datum, without gain; slopes are of their logarithm.
struct SourceValue<'a> {
    terms: &'a CubicTerms,
    /// Share of the light that is reflected once more.
    indirect: Option<f64>,
    /// Logarithm of the electrons with its slopes by the coordinates, and the same of what one more reflection makes.
    direct: Vec<Lanes>,
    once_more: Vec<Lanes>,
    electrons: f64,
    by_log_indirect: f64,
}

impl<'a> SourceValue<'a> {
    fn new(terms: &'a CubicTerms, indirect: Option<f64>) -> Self {
        let none = vec![[0.0; 4]; terms.lanes.len()];
        Self { terms, indirect, direct: none.clone(), once_more: none, electrons: 0.0, by_log_indirect: 0.0 }
    }

    fn evaluate(&mut self, source: &FamilySource, datum: usize) {
        self.terms.sum(&source.direct[datum], &mut self.direct);
        self.electrons = self.direct[0][0].exp();
        if let Some(indirect) = self.indirect {
            self.terms.sum(&source.once_more[datum], &mut self.once_more);
            let again = indirect * self.once_more[0][0].exp();
            self.by_log_indirect = again / (1.0 + again);
            self.electrons *= 1.0 + again;
        }
    }

    fn by_coordinate(&self, coordinate: usize) -> f64 {
        let (group, lane) = ((1 + coordinate) / 4, (1 + coordinate) % 4);
        self.direct[group][lane] + self.by_log_indirect * self.once_more[group][lane]
    }
}

/// A coordinate of the tissue from its nuisance, and its slope.
fn scaled(u: f64, coordinate: &FamilyCoordinate) -> (f64, f64) {
    let bent = (coordinate.sd * u / LARGEST_COORDINATE).tanh();
    (LARGEST_COORDINATE * bent, coordinate.sd * (1.0 - bent * bent))
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
        family.width *= factor;
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
        let places = self.places();
        let x: Vec<f64> = nuisances.iter().zip(&self.coordinates).map(|(u, c)| scaled(*u, c).0).collect();
        let terms = cubic_values(&x);
        let exponential = |coefficients: &[f64]| {
            terms.iter().zip(coefficients).map(|(term, coefficient)| term * coefficient).sum::<f64>().exp()
        };
        let indirect = self.indirect.map(|[median, sd]| median * (sd * nuisances[places.indirect]).exp());
        let (gains, errors) = (self.gains(nuisances, places.gain), self.library_factors(nuisances));
        let amounts = self.sources.iter().enumerate().map(|(k, source)| {
            (source, source.median * (source.log_sd * nuisances[places.sources + k]).exp())
        });
        let all: Vec<(&FamilySource, f64)> =
            amounts.chain([(&self.porphyrin, porphyrin)]).filter(|(_, amount)| *amount > 0.0).collect();
        let of_datum = |datum: usize| {
            let of_source = |(source, amount): &(&FamilySource, f64)| {
                let again = indirect.map_or(0.0, |indirect| indirect * exponential(&source.once_more[datum]));
                amount * exponential(&source.direct[datum]) * (1.0 + again)
            };
            gains[self.frame_of[datum]] * errors[datum] * all.iter().map(of_source).sum::<f64>()
        };
        (0..self.frame_of.len()).map(of_datum).collect()
    }

    /// The largest share of the counted electrons that the sources of a group may send: all of them two standard deviations brighter than
    /// in the middle of the prior.
    #[must_use]
    pub fn largest_share_of(&self, group: NuisanceGroup) -> f64 {
        const DEVIATIONS: f64 = 2.0;
        let is_it = |source: &FamilySource| source.group == group;
        let mut nuisances = vec![0.0; self.nuisances().len()];
        let places = self.places();
        for (k, _) in self.sources.iter().enumerate().filter(|(_, source)| is_it(source)) {
            nuisances[places.sources + k] = DEVIATIONS;
        }
        let mut without = self.clone();
        without.sources.iter_mut().filter(|source| is_it(source)).for_each(|source| source.median = 0.0);
        let sum = |electrons: Vec<f64>| -> f64 {
            electrons.iter().zip(&self.counted).filter(|(_, counted)| **counted).map(|(e, _)| e).sum()
        };
        let all = sum(self.electrons(&nuisances, self.porphyrin.median));
        1.0 - sum(without.electrons(&nuisances, self.porphyrin.median)) / all.max(f64::MIN_POSITIVE)
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
        let (x, x_slopes): (Vec<f64>, Vec<f64>) =
            nuisances.iter().zip(&self.coordinates).map(|(u, c)| scaled(*u, c)).unzip();
        let terms = CubicTerms::new(&x);
        let indirect = self.indirect.map(|[median, sd]| median * (sd * nuisances[places.indirect]).exp());
        let gains = self.gains(nuisances, places.gain);
        let errors = self.library_factors(nuisances);

        // Add up the sources: the porphyrin, plant pigment, other fluorescence, and light that does not count
        let mut sums = [0, 1, 2, 3].map(|_| Sums::none(n, nuisances.len()));
        let amounts = self.sources.iter().enumerate().map(|(k, source)| {
            let amount = source.median * (source.log_sd * nuisances[places.sources + k]).exp();
            (Some(places.sources + k), source, amount)
        });
        let all = amounts.chain((porphyrin > 0.0).then_some((None, &self.porphyrin, porphyrin)));
        let mut of_unit = SourceValue::new(&terms, indirect);
        for (place, source, amount) in all {
            let kind = match place {
                None => PORPHYRIN,
                Some(_) if source.is_pigment() => PIGMENT,
                Some(_) if source.fluorescent => BULK,
                Some(_) => NOT_COUNTED,
            };
            for datum in 0..n {
                of_unit.evaluate(source, datum);
                let value = amount * gains[self.frame_of[datum]] * errors[datum] * of_unit.electrons;
                let sum = &mut sums[kind];
                sum.electrons[datum] += value;
                for (i, x_slope) in x_slopes.iter().enumerate() {
                    sum.slopes[(datum, i)] += value * of_unit.by_coordinate(i) * x_slope;
                }
                if let Some(place) = place {
                    sum.slopes[(datum, place)] += value * source.log_sd;
                }
                if let Some([_, sd]) = self.indirect {
                    sum.slopes[(datum, places.indirect)] += value * of_unit.by_log_indirect * sd;
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
    fn point_of(&self, [porphyrin, pigment, bulk, rest]: &[Sums; 4]) -> FamilyPoint {
        let n = self.frame_of.len();
        let unknowns = porphyrin.slopes.ncols();
        let mut point = FamilyPoint {
            electrons: (0..n)
                .map(|i| {
                    porphyrin.electrons[i] + pigment.electrons[i] + bulk.electrons[i] + rest.electrons[i]
                })
                .collect(),
            slopes: &porphyrin.slopes + &pigment.slopes + &bulk.slopes + &rest.slopes,
            porphyrin: porphyrin.electrons.clone(),
            log_odds: 0.0,
            log_odds_slopes: DVector::zeros(unknowns),
            red_log_odds: 0.0,
            red_log_odds_slopes: DVector::zeros(0),
        };
        let counted = |sum: &Sums| -> (f64, DVector<f64>) {
            let (mut total, mut slopes) = (0.0, DVector::zeros(unknowns));
            for datum in (0..n).filter(|datum| self.counted[*datum]) {
                total += sum.electrons[datum];
                slopes += sum.slopes.row(datum).transpose();
            }
            (total, slopes)
        };
        let (of_porphyrin, by_porphyrin) = counted(porphyrin);
        let (of_pigment, by_pigment) = counted(pigment);
        let (of_bulk, by_bulk) = counted(bulk);
        if of_porphyrin > 0.0 && of_bulk > 0.0 {
            let others = of_pigment + of_bulk;
            point.log_odds = (of_porphyrin / others).ln();
            point.log_odds_slopes = &by_porphyrin / of_porphyrin - (&by_pigment + &by_bulk) / others;
        }
        if of_pigment > 0.0 && of_bulk > 0.0 {
            let red = of_porphyrin + of_pigment;
            point.red_log_odds = (red / of_bulk).ln();
            point.red_log_odds_slopes = (by_porphyrin + by_pigment) / red - by_bulk / of_bulk;
        }
        point
    }
}

/// Kinds of light in sums.
const PORPHYRIN: usize = 0;
const PIGMENT: usize = 1;
const BULK: usize = 2;
const NOT_COUNTED: usize = 3;

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
