//! A family of tissues as seen by some channels: sources of light whose colors depend on a few coordinates of the tissue.
//!
//! Electrons of datum `i` (a channel of a frame) are
//!
//! `m_i = g_f c_i [ sum_k a_k exp(D_ki(x)) (1 + q exp(V_ki(x))) + p exp(D_pi(x)) (1 + q exp(V_pi(x))) ]`
//!
//! with the coordinates `x` (blood, saturation, depth), amounts `a_k` of the sources, the amount `p` of the porphyrin, the share
//! `q` of light that the tissue reflects once more before it leaves, the gain `g_f` of the frame, and errors `c_i = exp(L_i u)` of
//! the library of spectra, which channels that see the same wavelengths share, and by layers and scattering. `D` and `V` are cubic
//! polynomials that were fitted to solutions of light transport. Everything but `p` is a nuisance and a standard normal number in its own scale:
//! `x = c tanh(s u / c)`, `a_k = median exp(sd u)`, and so on.

use fluorspar_accel::{self as accel, Simd, Work};
use nalgebra::{DMatrix, DVector};

use super::Analyte;

/// Bound of the coordinates, in standard deviations: solutions were made for such tissue only.
const LARGEST_COORDINATE: f64 = 3.5;

/// Numbers that are summed side by side.
type Lanes = [f64; LANES];
const LANES: usize = 8;

/// Terms of a polynomial of third degree in some coordinates, and their slopes.
pub struct CubicTerms {
    /// Value of each term.
    pub values: Vec<f64>,
    /// Value of each term and its slopes by the coordinates, eight of these numbers at a time, `[group][term]`.
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
        let groups = (1 + x.len()).div_ceil(LANES);
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
            lanes.push(std::array::from_fn(|lane| number(LANES * group + lane)));
        }
    }
}

/// Sums of pairs of polynomials with the same terms, eight numbers at a time, compiled for each instruction set.
struct Polynomials<'a> {
    terms: &'a [Vec<Lanes>],
    /// Coefficients of each pair.
    pairs: &'a [[&'a [f64]; 2]],
}

impl Work for Polynomials<'_> {
    /// `[pair][group of terms]`.
    type Output = Vec<[Lanes; 2]>;

    #[inline(always)]
    fn run<L: accel::Lanes>(self, _: L) -> Self::Output {
        let mut sums = Vec::with_capacity(self.pairs.len() * self.terms.len());
        for [first, second] in self.pairs {
            for terms in self.terms {
                // In variables of their own, which are kept in registers
                let (mut a, mut b) = ([0.0; LANES], [0.0; LANES]);
                for ((term, first), second) in terms.iter().zip(*first).zip(*second) {
                    for lane in 0..LANES {
                        a[lane] += term[lane] * first;
                        b[lane] += term[lane] * second;
                    }
                }
                sums.push([a, b]);
            }
        }
        sums
    }
}

/// Exponentials of the polynomials of all sources for the same terms, compiled for each instruction set.
struct Exponentials<'a> {
    terms: &'a [Lanes],
    family: &'a LightFamily,
}

impl Work for Exponentials<'_> {
    /// As [`UnitLight::pairs`].
    type Output = Vec<[f64; 2]>;

    #[inline(always)]
    fn run<L: accel::Lanes>(self, _: L) -> Self::Output {
        let LightFamily { sources, porphyrin, frame_of, .. } = self.family;
        let mut found = Vec::with_capacity((sources.len() + 1) * frame_of.len());
        for source in sources.iter().chain([porphyrin]) {
            for (direct, once_more) in source.direct.iter().zip(&source.once_more) {
                found.push([direct, once_more].map(|coefficients| sum_of(self.terms, coefficients).exp()));
            }
        }
        found
    }
}

/// Sum of products, eight at a time.
#[inline(always)]
fn sum_of(terms: &[Lanes], coefficients: &[f64]) -> f64 {
    let mut sums = [0.0; LANES];
    let (whole, rest) = coefficients.as_chunks::<LANES>();
    for (terms, coefficients) in terms.iter().zip(whole) {
        for lane in 0..LANES {
            sums[lane] += terms[lane] * coefficients[lane];
        }
    }
    for ((sum, term), coefficient) in sums.iter_mut().zip(terms.iter().skip(whole.len()).flatten()).zip(rest)
    {
        *sum += term * coefficient;
    }
    sums.iter().sum()
}

/// Light of a unit amount of each source in each datum, `[source][datum]` with the porphyrin last.
pub(super) struct UnitLight {
    /// Electrons, and those after one more reflection by the tissue over them.
    pairs: Vec<[f64; 2]>,
}

/// What kind of uncertainty a nuisance stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NuisanceGroup {
    /// Blood, its saturation, layers, scattering.
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
            Self::Tissue => "blood, layers and scattering",
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

    /// Coefficients of what it emits and of what one more reflection makes of it, of each datum.
    fn pairs(&self) -> impl Iterator<Item = [&[f64]; 2]> {
        self.direct.iter().zip(&self.once_more).map(|(direct, once_more)| [&direct[..], &once_more[..]])
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
    /// Names of what varies too little for polynomials: layers, scattering.
    pub layers: Vec<String>,
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
    /// Changes of the logarithms of all data, one row each: by the spectra of the library, `L` of the covariance `L L^T`, and by one standard
    /// deviation of each of the layers.
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
    /// Logarithm of the electrons with its slopes by the coordinates, and the same of what one more reflection makes.
    sums: &'a [[Lanes; 2]],
    electrons: f64,
    by_log_indirect: f64,
}

impl<'a> SourceValue<'a> {
    /// `indirect` is the share of the light that is reflected once more.
    fn new(sums: &'a [[Lanes; 2]], indirect: Option<f64>) -> Self {
        let [direct, once_more] = sums[0].map(|lanes| lanes[0].exp());
        let again = indirect.map_or(0.0, |indirect| indirect * once_more);
        Self { sums, electrons: direct * (1.0 + again), by_log_indirect: again / (1.0 + again) }
    }

    fn by_coordinate(&self, coordinate: usize) -> f64 {
        let (group, lane) = ((1 + coordinate) / LANES, (1 + coordinate) % LANES);
        let [direct, once_more] = &self.sums[group];
        direct[lane] + self.by_log_indirect * once_more[lane]
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
        names.extend(self.layers.iter().map(|layer| (layer.clone(), NuisanceGroup::Tissue)));
        names.push(("brightness".into(), NuisanceGroup::Brightness));
        if self.frames.len() > 1 {
            let lamp = |frame: &String| (format!("brightness of {frame}"), NuisanceGroup::Brightness);
            names.extend(self.frames.iter().map(lamp));
        }
        names
    }

    /// Groups that the family holds and whose knowledge would tell something of the share.
    pub(super) fn groups_that_may_be_known(&self) -> impl Iterator<Item = NuisanceGroup> + use<> {
        let held: Vec<NuisanceGroup> = self.nuisances().into_iter().map(|(_, group)| group).collect();
        let may_be = move |group: &NuisanceGroup| *group != NuisanceGroup::Brightness && held.contains(group);
        NuisanceGroup::ALL.into_iter().filter(may_be)
    }

    /// The same family with a group of nuisances known: held in the middle of the prior.
    #[must_use]
    pub fn with_known(&self, group: NuisanceGroup) -> Self {
        let mut family = self.clone();
        let known = |of: NuisanceGroup| of == group;
        if known(NuisanceGroup::Tissue) {
            family.coordinates.iter_mut().for_each(|coordinate| coordinate.sd = 0.0);
            family.scale_layers(0.0);
        }
        family.sources.iter_mut().filter(|source| known(source.group)).for_each(|source| source.log_sd = 0.0);
        if let (Some(indirect), true) = (&mut family.indirect, known(NuisanceGroup::Surroundings)) {
            indirect[1] = 0.0;
        }
        if known(NuisanceGroup::Library) {
            family.know_library();
            family.model_error.fill(0.0);
        }
        if known(NuisanceGroup::Brightness) {
            (family.gain_log_sd, family.lamp_log_sd) = (0.0, 0.0);
        }
        family
    }

    fn scale_layers(&mut self, factor: f64) {
        self.library.columns_mut(self.frame_of.len(), self.layers.len()).scale_mut(factor);
    }

    /// Takes the spectra of the library for exact.
    pub(super) fn know_library(&mut self) {
        self.library.columns_mut(0, self.frame_of.len()).fill(0.0);
    }

    /// The same family with a prior of another width: standard deviations of coordinates, layers, amounts and indirect light times a
    /// factor.
    #[must_use]
    pub fn widened(&self, factor: f64) -> Self {
        let mut family = self.clone();
        family.width *= factor;
        family.coordinates.iter_mut().for_each(|coordinate| coordinate.sd *= factor);
        family.scale_layers(factor);
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
        self.electrons_of(&self.unit_light(nuisances), nuisances, porphyrin)
    }

    /// Light of all sources, the porphyrin last, in tissue with the coordinates of nuisances.
    pub(super) fn unit_light(&self, nuisances: &[f64]) -> UnitLight {
        let x: Vec<f64> = nuisances.iter().zip(&self.coordinates).map(|(u, c)| scaled(*u, c).0).collect();
        let values = cubic_values(&x);
        // Eight terms at a time, which are added up in the end
        let terms: Vec<Lanes> = values
            .chunks(LANES)
            .map(|some| std::array::from_fn(|lane| some.get(lane).copied().unwrap_or_default()))
            .collect();
        UnitLight { pairs: Simd::detect().run(Exponentials { terms: &terms, family: self }) }
    }

    /// [`Self::electrons`] where the light of units is known.
    pub(super) fn electrons_of(&self, light: &UnitLight, nuisances: &[f64], porphyrin: f64) -> Vec<f64> {
        let mut electrons = vec![0.0; self.frame_of.len()];
        self.each_source(light, nuisances, porphyrin, |_, datum, e| electrons[datum] += e);
        electrons
    }

    /// [`Self::share`] where the light of units is known.
    pub(super) fn share_of(&self, light: &UnitLight, nuisances: &[f64], porphyrin: f64) -> f64 {
        let [mut of_porphyrin, mut all] = [0.0; 2];
        self.each_source(light, nuisances, porphyrin, |source, datum, e| {
            if self.counted[datum] && source.is_none_or(|source| source.fluorescent) {
                all += e;
                of_porphyrin += if source.is_none() { e } else { 0.0 };
            }
        });
        if of_porphyrin < all { of_porphyrin / all } else { 0.0 }
    }

    /// Tells the electrons of each source in each datum; the porphyrin is no source by itself.
    fn each_source(
        &self,
        light: &UnitLight,
        nuisances: &[f64],
        porphyrin: f64,
        mut tell: impl FnMut(Option<&FamilySource>, usize, f64),
    ) {
        let (places, data) = (self.places(), self.frame_of.len());
        let indirect =
            self.indirect.map_or(0.0, |[median, sd]| median * (sd * nuisances[places.indirect]).exp());
        let (gains, errors) = (self.gains(nuisances, places.gain), self.library_factors(nuisances));
        let amount = |(k, source): (usize, &FamilySource)| {
            source.median * (source.log_sd * nuisances[places.sources + k]).exp()
        };
        let amounts = self.sources.iter().enumerate().map(amount).chain([porphyrin]);
        for ((number, amount), pairs) in amounts.enumerate().zip(light.pairs.chunks(data)) {
            for (datum, [direct, once_more]) in pairs.iter().enumerate().filter(|_| amount > 0.0) {
                let value = amount * direct * (1.0 + indirect * once_more);
                tell(self.sources.get(number), datum, gains[self.frame_of[datum]] * errors[datum] * value);
            }
        }
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

    /// Factors on the electrons of the data by errors of the library and by layers, for nuisances.
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
        Places { sources, indirect, library, gain: library + self.library.ncols() }
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
        let all: Vec<_> =
            amounts.chain((porphyrin > 0.0).then_some((None, &self.porphyrin, porphyrin))).collect();
        let pairs: Vec<[&[f64]; 2]> = all.iter().flat_map(|(_, source, _)| source.pairs()).collect();
        let polynomials = Simd::detect().run(Polynomials { terms: &terms.lanes, pairs: &pairs });
        let mut of_unit = polynomials.chunks(terms.lanes.len());
        for (place, source, amount) in all {
            let kind = match place {
                None => PORPHYRIN,
                Some(_) if source.is_pigment() => PIGMENT,
                Some(_) if source.fluorescent => BULK,
                Some(_) => NOT_COUNTED,
            };
            for (datum, of_unit) in of_unit.by_ref().take(n).enumerate() {
                let of_unit = SourceValue::new(of_unit, indirect);
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

    /// Adds the slopes by what multiplies all light of a datum: errors of the library, layers and gains.
    fn add_slopes_of_factors(&self, sum: &mut Sums, places: &Places) {
        for (datum, &value) in sum.electrons.iter().enumerate() {
            for error in 0..self.library.ncols() {
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
