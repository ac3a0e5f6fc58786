//! What a camera sees of a family of tissues: light transport solved for some hundred tissues of a site, and cubic polynomials
//! between them.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use nalgebra::{Cholesky, DMatrix};
use statrs::distribution::{ContinuousCDF, Normal};

use super::region_signal::CameraResponse;
use crate::analysis::{CubicTerms, FamilyCoordinate, FamilySource, LightFamily, NuisanceGroup};
use crate::spectral::{Curve, WavelengthGrid};
use crate::study::TissuePrior;
use crate::tissue::fit::missing_red;
use crate::tissue::{
    DiscreteOrdinates, EffectiveTissue, LayerFluorophore, LayeredTissue, Level, Population, Site,
    TissueError, Variation,
};
use crate::units::photons_per_joule;

/// Tissues that are solved for each term of the polynomials.
const SOLVED_PER_TERM: usize = 3;
/// Spread of these tissues, in standard deviations of the population: wide enough for a prior of twice the usual width.
const DESIGN_SPREAD: f64 = 1.8;
/// Lines that stand for the spectrum of the light.
const MOST_LINES: usize = 6;
/// Electrons of a unit amount below this share of the brightest source count as none.
const DARK: f64 = 1e-12;

/// Standard deviation of the logarithm of the amount of porphyrin, where there is some.
const PORPHYRIN_LOG_SD: f64 = 1.3;
/// Strength of porphyrin in the middle of the slab where the site states none, 1/mm.
const PORPHYRIN_PER_MM: f64 = 1.0e-3;
/// Probability beforehand that there is no porphyrin.
const PROBABILITY_OF_NONE: f64 = 0.5;
/// Light of teeth that the wet surface mirrors in their own color, over that of teeth on the region: a reflectance for diffuse light
/// between 0.03 (head-on) and 0.08, median and log sd. \[assumed\]
const MIRRORED: [f64; 2] = [0.05, 0.8];
/// Leaked light over that of the model, log sd: gloss, errors of filters.
const LEAK_LOG_SD: f64 = 0.3;
/// Gloss as a reflectance, median and log sd. \[assumed\]
const GLOSS: [f64; 2] = [0.005, 1.0];
/// Distance over which errors of the library go together, nm.
const LIBRARY_CORRELATION_NM: f64 = 20.0;
/// Brightness: distance, angle, power; and that of each frame against the others.
const GAIN_LOG_SD: f64 = 1.0;
const LAMP_LOG_SD: f64 = 0.3;

/// Families that are kept: those of a few regions with the sites that they may be taken for.
const MOST_KEPT: usize = 24;

/// One frame of a family.
#[derive(Clone, Debug, PartialEq)]
pub struct FamilyFrame {
    /// Label.
    pub label: String,
    /// Irradiance on the region, W/(m² nm).
    pub irradiance: Curve,
    /// The camera for light that is even within each band.
    pub camera: CameraResponse,
    /// The camera for light that has the shape of the irradiance within each band.
    pub camera_of_reflected: CameraResponse,
    /// Numbers of the channels that are measured, in the order of the data; [`CameraResponse::seeing_channels`] are those of use.
    pub channels: Vec<usize>,
    /// Electrons for each per second: the exposure time, s, where no strobe cuts it and no pixels are joined.
    pub time_s: f64,
}

/// Electrons of each source in each datum, direct and over direct after one more reflection.
struct Solved {
    /// `[source][datum]`.
    direct: Vec<Vec<f64>>,
    once_more: Vec<Vec<f64>>,
}

/// The family of a prior before a camera: the measured channels of each frame, in this order. The share counts the electrons of R, G
/// and B of the first frame, or of all its channels where it lacks one of these.
///
/// # Errors
/// A site without mucosa's parameters, as a tooth; parameters that can't be solved, a frame without channels (as no wavelengths).
pub fn tissue_family(
    prior: &TissuePrior,
    frames: &[FamilyFrame],
    grid: &WavelengthGrid,
) -> Result<LightFamily, TissueError> {
    family_by(DiscreteOrdinates::DIFFUSE, prior, frames, grid)
}

/// Families of the other sites that the tissue may be of ([`TissuePrior::others`]), by a coarse solver, which is off by less than the
/// errors of the library; none where the site is certain.
///
/// # Errors
/// Those of [`tissue_family`].
pub fn other_tissue_families(
    prior: &TissuePrior,
    frames: &[FamilyFrame],
    grid: &WavelengthGrid,
) -> Result<Vec<LightFamily>, TissueError> {
    let is_other = |site: &&Site| prior.site_probability < 1.0 && site.name() != prior.site.name();
    let family = |site: &Site| {
        let other = TissuePrior { site: site.clone(), ..prior.clone() };
        family_by(DiscreteOrdinates::COARSE, &other, frames, grid)
    };
    prior.others.iter().filter(is_other).map(family).collect()
}

/// What a family was made of.
#[derive(PartialEq)]
struct MadeOf {
    ordinates: DiscreteOrdinates,
    prior: TissuePrior,
    frames: Vec<FamilyFrame>,
    grid: WavelengthGrid,
}

/// Families that were made last: regions of one frame, and frames of one camera, ask for the same ones. They change no result.
static KEPT: Mutex<VecDeque<(MadeOf, LightFamily)>> = Mutex::new(VecDeque::new());

fn family_by(
    ordinates: DiscreteOrdinates,
    prior: &TissuePrior,
    frames: &[FamilyFrame],
    grid: &WavelengthGrid,
) -> Result<LightFamily, TissueError> {
    // On these a family does not rest
    let prior = TissuePrior { others: Vec::new(), site_probability: 1.0, ..prior.clone() };
    let of = MadeOf { ordinates, prior, frames: frames.to_vec(), grid: grid.clone() };
    let kept = || KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, family)) = kept().iter().find(|(made_of, _)| *made_of == of) {
        return Ok(family.clone());
    }
    let family = made_family(ordinates, &of.prior, frames, grid)?;
    let mut kept = kept();
    kept.truncate(MOST_KEPT - 1);
    kept.push_front((of, family.clone()));
    Ok(family)
}

fn made_family(
    ordinates: DiscreteOrdinates,
    prior: &TissuePrior,
    frames: &[FamilyFrame],
    grid: &WavelengthGrid,
) -> Result<LightFamily, TissueError> {
    if frames.is_empty() || frames.iter().any(|frame| frame.channels.is_empty()) {
        return Err(TissueError::Wavelengths);
    }
    let typical = with_porphyrin(&prior.site)?;
    let (population, layers) = (Population::of(&typical), Population::of_layers(&typical));
    let coordinates = population.restricted(is_coordinate);
    let x = design(coordinates.variations().len());
    let names = source_names(prior)?;
    let solver = FamilySolver::new(ordinates, prior, frames, grid)?;
    let of_layers = (0..=layers.variations().len()).map(|layer| {
        let mut deviations = vec![0.0; layer];
        deviations.iter_mut().last().into_iter().for_each(|last| *last = prior.width);
        layers.tissue_at(&deviations)
    });
    let tissues = x
        .iter()
        .map(|x| coordinates.tissue_at(x))
        .chain(of_layers)
        .map(|site| tissue_of(prior, &site))
        .collect::<Result<Vec<_>, TissueError>>()?;
    let effective = solver.effective(&tissues)?;
    let mut solved: Vec<Solved> = effective.par_iter().map(|tissue| solver.sources(tissue, &names)).collect();
    let of_layers = solved.split_off(x.len());
    let fit = PolynomialFit::new(&x).ok_or(TissueError::Unsolvable { layer: None })?;
    let data: Vec<(usize, usize)> =
        (0..frames.len()).flat_map(|frame| frames[frame].channels.iter().map(move |c| (frame, *c))).collect();
    let (mut sources, model_error) = fit_sources(&fit, &solved, &names, prior, &population, data.len());
    let library = [solver.library_errors(&effective[0], &data), log_changes(&of_layers, &sources)];
    let porphyrin = sources.remove(0);
    let indirect = prior.site.surroundings().indirect;
    let rgb = frames[0].camera.rgb().filter(|rgb| rgb.iter().all(|c| frames[0].channels.contains(c)));
    Ok(LightFamily {
        tissue: prior.site.name().into(),
        prior: describe(prior),
        width: prior.width,
        coordinates: coordinates
            .variations()
            .iter()
            .map(|variation| FamilyCoordinate { name: variation.title.into(), sd: prior.width })
            .collect(),
        layers: layers.variations().iter().map(|layer| layer.title.into()).collect(),
        sources,
        porphyrin,
        probability_of_none: PROBABILITY_OF_NONE,
        indirect: prior.teeth.is_some().then_some([indirect[0], prior.width * indirect[1]]),
        frames: frames.iter().map(|frame| frame.label.clone()).collect(),
        frame_of: data.iter().map(|(frame, _)| *frame).collect(),
        channel_of: data.iter().map(|(frame, c)| frames[*frame].camera.channels()[*c].clone()).collect(),
        counted: data.iter().map(|(frame, c)| *frame == 0 && rgb.is_none_or(|rgb| rgb.contains(c))).collect(),
        gain_log_sd: GAIN_LOG_SD,
        lamp_log_sd: LAMP_LOG_SD,
        model_error,
        library: DMatrix::from_columns(&library.iter().flat_map(|of| of.column_iter()).collect::<Vec<_>>()),
    })
}

/// Polynomials of all sources, and the error that they leave in each datum.
fn fit_sources(
    fit: &PolynomialFit,
    solved: &[Solved],
    names: &[String],
    prior: &TissuePrior,
    population: &Population,
    data: usize,
) -> (Vec<FamilySource>, Vec<f64>) {
    let mut squares = vec![0.0; data];
    let mut source = |(number, name): (usize, &String)| {
        let mut curves = [Vec::new(), Vec::new()];
        for (datum, square) in squares.iter_mut().enumerate() {
            let log = |values: &dyn Fn(&Solved) -> f64| -> Vec<f64> {
                solved.iter().map(|solved| values(solved).max(f64::MIN_POSITIVE).ln()).collect()
            };
            let (direct, error) = fit.fit(&log(&|solved| solved.direct[number][datum]));
            let (once_more, _) = fit.fit(&log(&|solved| solved.once_more[number][datum]));
            if solved[0].direct[number][datum] > DARK {
                *square += error * error / names.len() as f64;
            }
            curves[0].push(direct);
            curves[1].push(once_more);
        }
        let [direct, once_more] = curves;
        let SourcePrior { group, median, log_sd, fluorescent } = source_prior(name, prior, population);
        FamilySource { name: name.replace('_', " "), group, median, log_sd, fluorescent, direct, once_more }
    };
    let sources = names.iter().enumerate().map(&mut source).collect();
    (sources, squares.into_iter().map(f64::sqrt).collect())
}

/// What each tissue does to the logarithms of the light of the first, `[datum, tissue]`.
fn log_changes(solved: &[Solved], sources: &[FamilySource]) -> DMatrix<f64> {
    let log = |solved: &Solved, datum: usize| -> f64 {
        let electrons = sources.iter().zip(&solved.direct).map(|(source, of)| source.median * of[datum]);
        electrons.sum::<f64>().ln()
    };
    let change = |datum, tissue: usize| log(&solved[tissue + 1], datum) - log(&solved[0], datum);
    DMatrix::from_fn(solved[0].direct[0].len(), solved.len() - 1, change)
}

/// The prior in words.
fn describe(prior: &TissuePrior) -> String {
    let mouth = if prior.teeth.is_some() { " in a mouth" } else { "" };
    let site = prior.site.name().replace('_', " ");
    format!("{site}{mouth} ({} times as varied as the population)", prior.width)
}

/// Whether a variation is one of the tissue's optics, on which light depends in another way than in proportion.
fn is_coordinate(variation: &Variation) -> bool {
    variation.fluorophore.is_none()
}

/// Design of the solutions: Halton points as normal deviates, `[tissue][coordinate]`.
fn design(coordinates: usize) -> Vec<Vec<f64>> {
    let radical_inverse = |mut index: usize, base: usize| {
        let (mut value, mut place) = (0.0, 1.0 / base as f64);
        while index > 0 {
            value += place * (index % base) as f64;
            index /= base;
            place /= base as f64;
        }
        value
    };
    let Ok(normal) = Normal::new(0.0, DESIGN_SPREAD) else { return Vec::new() };
    let terms = CubicTerms::new(&vec![0.0; coordinates]).values.len();
    let bases = [2, 3, 5, 7, 11, 13, 17, 19];
    let point = |i: usize| {
        bases.iter().take(coordinates).map(|base| normal.inverse_cdf(radical_inverse(i, *base))).collect()
    };
    (1..=SOLVED_PER_TERM * terms).map(point).collect()
}

struct SourcePrior {
    group: NuisanceGroup,
    median: f64,
    log_sd: f64,
    fluorescent: bool,
}

/// Sources that are not fluorophores of the site.
const LEAK: &str = "leaked_light";
const GLOSS_NAME: &str = "gloss";
const TEETH_NAME: &str = "light_of_teeth";
const MIRRORED_NAME: &str = "mirrored_light_of_teeth";
/// The porphyrin of the sites.
const PORPHYRIN: &str = "biofilm_porphyrin";

/// Names of the sources: the porphyrin first.
fn source_names(prior: &TissuePrior) -> Result<Vec<String>, TissueError> {
    let tissue = tissue_of(prior, &with_porphyrin(&prior.site)?)?;
    let mut names = vec![PORPHYRIN.to_owned()];
    for held in tissue.layers.iter().flat_map(|layer| &layer.fluorophores) {
        if !names.contains(&held.fluorophore.name) {
            names.push(held.fluorophore.name.clone());
        }
    }
    if prior.teeth.is_some() {
        names.extend([TEETH_NAME.into(), MIRRORED_NAME.into()]);
    }
    names.extend([LEAK.into(), GLOSS_NAME.into()]);
    Ok(names)
}

fn source_prior(name: &str, prior: &TissuePrior, population: &Population) -> SourcePrior {
    let of_population = || {
        let variation = population.variations().iter().find(|variation| variation.fluorophore == Some(name));
        variation.map_or(0.0, Variation::standard_deviation)
    };
    let teeth = prior.site.surroundings().teeth;
    let (group, median, log_sd, fluorescent) = match name {
        TEETH_NAME => (NuisanceGroup::Surroundings, teeth[0], prior.width * teeth[1], false),
        MIRRORED_NAME => {
            (NuisanceGroup::Surroundings, MIRRORED[0] * teeth[0], prior.width * MIRRORED[1], false)
        }
        LEAK => (NuisanceGroup::Leak, 1.0, LEAK_LOG_SD, false),
        GLOSS_NAME => (NuisanceGroup::Leak, GLOSS[0], GLOSS[1], false),
        PORPHYRIN => (NuisanceGroup::Fluorophores, 1.0, PORPHYRIN_LOG_SD, true),
        _ => (NuisanceGroup::Fluorophores, 1.0, prior.width * of_population(), true),
    };
    SourcePrior { group, median, log_sd, fluorescent }
}

/// The site with the porphyrin of the middle of the slab, if it has none.
fn with_porphyrin(site: &Site) -> Result<Site, TissueError> {
    let mut site = site.clone();
    if site.get("biofilm_porphyrin_per_mm")? == 0.0 {
        site.set("biofilm_porphyrin_per_mm", PORPHYRIN_PER_MM)?;
    }
    Ok(site)
}

fn tissue_of(prior: &TissuePrior, site: &Site) -> Result<LayeredTissue, TissueError> {
    site.tissue(&|name| prior.fluorophores.iter().find(|fluorophore| fluorophore.name == name).cloned())
}

/// What stays the same for all tissues of a family.
struct FamilySolver<'a> {
    ordinates: DiscreteOrdinates,
    prior: &'a TissuePrior,
    frames: Vec<FrameLines<'a>>,
    bands_nm: Vec<f64>,
    nodes_nm: Vec<f64>,
}

/// A frame with its light as lines and bands.
struct FrameLines<'a> {
    frame: &'a FamilyFrame,
    /// Wavelength, nm, and photons, 1/(s m²).
    lines: Vec<(f64, f64)>,
    /// Irradiance in each band, W/(m² nm).
    irradiance: Vec<f64>,
    /// Yield densities of each fluorophore of the prior for all bands and lines, 1/nm, `[band][line]`.
    yields: Vec<Vec<f64>>,
    /// Radiance of teeth under the same light, W/(sr m² nm).
    teeth: Vec<f64>,
}

impl<'a> FamilySolver<'a> {
    fn new(
        ordinates: DiscreteOrdinates,
        prior: &'a TissuePrior,
        frames: &'a [FamilyFrame],
        grid: &WavelengthGrid,
    ) -> Result<Self, TissueError> {
        let bands_nm = grid.centers_nm();
        let mut nodes_nm: Vec<f64> = Vec::new();
        let mut prepared = Vec::with_capacity(frames.len());
        for frame in frames {
            let irradiance = frame.irradiance.bin_averages(grid);
            let lines = lines(&irradiance, grid);
            let lines_nm: Vec<f64> = lines.iter().map(|(nm, _)| *nm).collect();
            let yields = prior.fluorophores.iter().map(|held| held.eem.densities(&bands_nm, &lines_nm));
            let yields = yields.collect();
            nodes_nm.extend(lines_nm);
            prepared.push(FrameLines { frame, lines, irradiance, yields, teeth: Vec::new() });
        }
        // Every 5 nm where hemoglobin has its bands, otherwise every 10 nm, between the ends of the grid
        let (first, last) = (bands_nm[0], bands_nm[bands_nm.len() - 1]);
        nodes_nm.extend([first, last]);
        let steps = (0..).map(|i| 400.0 + 5.0 * f64::from(i)).take_while(|nm| *nm < 1000.0);
        nodes_nm.extend(
            steps.filter(|nm| {
                (*nm > first && *nm < last) && ((520.0..=600.0).contains(nm) || nm % 10.0 == 0.0)
            }),
        );
        nodes_nm.sort_by(f64::total_cmp);
        nodes_nm.dedup_by(|a, b| (*a - *b).abs() < 1.0);
        let mut solver = Self { ordinates, prior, frames: prepared, bands_nm, nodes_nm };
        if let Some(tooth) = &prior.teeth {
            let tooth = tissue_of(prior, tooth)?;
            let teeth = EffectiveTissue::new(&tooth, &solver.nodes_nm, ordinates)?;
            let radiances: Vec<Vec<f64>> =
                solver.frames.iter().map(|frame| solver.radiance(&teeth, frame)).collect();
            for (frame, radiance) in solver.frames.iter_mut().zip(radiances) {
                frame.teeth = radiance;
            }
        }
        Ok(solver)
    }

    fn effective(&self, tissues: &[LayeredTissue]) -> Result<Vec<EffectiveTissue>, TissueError> {
        self.prior.kept.solve(tissues, &self.nodes_nm, self.ordinates)
    }

    /// Fluorescence of each fluorophore of the prior under the light of a frame, W/(sr m² nm), `[fluorophore][band]`; `None` of those
    /// that the tissue does not hold.
    fn radiances(&self, tissue: &EffectiveTissue, frame: &FrameLines<'_>) -> Vec<Option<Vec<f64>>> {
        let lines_nm: Vec<f64> = frame.lines.iter().map(|(nm, _)| *nm).collect();
        let mut photons: Vec<Option<Vec<f64>>> = vec![None; self.prior.fluorophores.len()];
        for (layer, contents) in tissue.tissue().layers.iter().enumerate() {
            if contents.fluorophores.is_empty() {
                continue;
            }
            let overlaps = tissue.overlaps(layer, &lines_nm, &self.bands_nm, Level::AboveSurface);
            for (fluorophore, held) in contents.fluorophores.iter().enumerate() {
                let Some(number) = self.number_of(&held.fluorophore.name) else { continue };
                let part = LayerFluorophore { layer, fluorophore };
                let more = tissue.emission_of(part, &frame.lines, &frame.yields[number], &overlaps);
                let sum = photons[number].get_or_insert_with(|| vec![0.0; more.len()]);
                sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
            }
        }
        for (photons, nm) in photons.iter_mut().flatten().flat_map(|all| all.iter_mut().zip(&self.bands_nm)) {
            *photons = *photons / photons_per_joule(*nm) / std::f64::consts::PI;
        }
        photons
    }

    /// Fluorescence of all fluorophores together under the light of a frame, W/(sr m² nm).
    fn radiance(&self, tissue: &EffectiveTissue, frame: &FrameLines<'_>) -> Vec<f64> {
        let mut sum = vec![0.0; self.bands_nm.len()];
        for radiance in self.radiances(tissue, frame).into_iter().flatten() {
            sum.iter_mut().zip(radiance).for_each(|(sum, more)| *sum += more);
        }
        sum
    }

    /// Number of a fluorophore of the prior.
    fn number_of(&self, name: &str) -> Option<usize> {
        self.prior.fluorophores.iter().position(|fluorophore| fluorophore.name == name)
    }

    /// `L` of the covariance `L L^T` of the logarithms of the data by errors of the library, for the light of one tissue.
    ///
    /// A spectrum of the library is off by `library_error` at each wavelength, and at wavelengths within
    /// [`LIBRARY_CORRELATION_NM`] in the same way (`exp(-(distance / length)² / 2)`); a channel averages over what it sees. Half of
    /// the variance is that of emission spectra, which all frames share, half that of what each light excites. Under blue light the
    /// coat of tongues emits red that the library lacks.
    fn library_errors(&self, tissue: &EffectiveTissue, data: &[(usize, usize)]) -> DMatrix<f64> {
        let seen = self.seen_shares(tissue, data);
        let is_coated = self.prior.site.get("biofilm_chlorophyll_per_mm").is_ok_and(|held| held > 0.0);
        let red = |datum: usize| -> f64 {
            let light_nm = mean_nm(&self.frames[data[datum].0].lines);
            let missing =
                seen[datum].iter().zip(&self.bands_nm).map(|(s, nm)| s * missing_red(light_nm, *nm));
            if is_coated { missing.sum() } else { 0.0 }
        };
        let bands = &self.bands_nm;
        let shared = |i: usize, j: usize| -> f64 {
            let near = |a: f64, b: f64| (-0.5 * ((a - b) / LIBRARY_CORRELATION_NM).powi(2)).exp();
            let with = |a: f64| -> f64 { seen[j].iter().zip(bands).map(|(s, b)| s * near(a, *b)).sum() };
            seen[i].iter().zip(bands).filter(|(s, _)| **s > 0.0).map(|(s, a)| s * with(*a)).sum()
        };
        let covariance = DMatrix::from_fn(data.len(), data.len(), |i, j| {
            let same = if data[i].0 == data[j].0 { 1.0 } else { 0.5 };
            let smooth = self.prior.library_error.powi(2) * same * shared(i, j);
            // Rounding must not make it singular
            smooth + red(i) * red(j) + if i == j { 1e-10 } else { 0.0 }
        });
        Cholesky::new(covariance).map_or_else(|| DMatrix::zeros(data.len(), data.len()), |found| found.l())
    }

    /// Of the electrons of each datum, a channel of a frame, the shares of the bands.
    fn seen_shares(&self, tissue: &EffectiveTissue, data: &[(usize, usize)]) -> Vec<Vec<f64>> {
        let radiances: Vec<Vec<f64>> = self.frames.iter().map(|frame| self.radiance(tissue, frame)).collect();
        let shares = |&(frame, channel): &(usize, usize)| {
            let weights = self.frames[frame].frame.camera.channel_weights(channel);
            let electrons: Vec<f64> = weights.iter().zip(&radiances[frame]).map(|(w, l)| w * l).collect();
            let total = electrons.iter().sum::<f64>().max(f64::MIN_POSITIVE);
            electrons.into_iter().map(|e| e / total).collect()
        };
        data.iter().map(shares).collect()
    }

    /// All sources of one tissue.
    fn sources(&self, tissue: &EffectiveTissue, names: &[String]) -> Solved {
        let reflectance = tissue.reflectance(Level::AboveSurface);
        let reflectance: Vec<f64> = self.bands_nm.iter().map(|nm| reflectance.at(*nm)).collect();
        let mut solved = Solved { direct: Vec::new(), once_more: Vec::new() };
        let mut emitted: Vec<Vec<Option<Vec<f64>>>> =
            self.frames.iter().map(|frame| self.radiances(tissue, frame)).collect();
        for name in names {
            let (mut direct, mut once_more) = (Vec::new(), Vec::new());
            for (frame, emitted) in self.frames.iter().zip(&mut emitted) {
                let reflected = || frame.irradiance.iter().map(|e| e / std::f64::consts::PI);
                let (radiance, camera): (Vec<f64>, _) = match name.as_str() {
                    LEAK => (
                        reflected().zip(&reflectance).map(|(l, r)| l * r).collect(),
                        &frame.frame.camera_of_reflected,
                    ),
                    GLOSS_NAME => (reflected().collect(), &frame.frame.camera_of_reflected),
                    TEETH_NAME => (
                        frame.teeth.iter().zip(&reflectance).map(|(l, r)| l * r).collect(),
                        &frame.frame.camera,
                    ),
                    MIRRORED_NAME => (frame.teeth.clone(), &frame.frame.camera),
                    name => {
                        let held = self.number_of(name).and_then(|number| emitted[number].take());
                        (held.unwrap_or_else(|| vec![0.0; self.bands_nm.len()]), &frame.frame.camera)
                    }
                };
                let again: Vec<f64> = radiance.iter().zip(&reflectance).map(|(l, r)| l * r).collect();
                for &channel in &frame.frame.channels {
                    let signal = camera.channel_electrons(channel, &radiance, frame.frame.time_s).max(DARK);
                    let after = camera.channel_electrons(channel, &again, frame.frame.time_s);
                    direct.push(signal);
                    once_more.push((after / signal).max(1e-3));
                }
            }
            solved.direct.push(direct);
            solved.once_more.push(once_more);
        }
        solved
    }
}

/// The light in few lines: bands in order, joined until each line has its share of the photons, at their mean wavelength to
/// 0.001 nm: the same for any power of the light, so that solved tissues serve them all.
fn lines(irradiance: &[f64], grid: &WavelengthGrid) -> Vec<(f64, f64)> {
    let photons: Vec<f64> = irradiance
        .iter()
        .enumerate()
        .map(|(band, e)| e * grid.width_nm(band) * photons_per_joule(grid.center_nm(band)))
        .collect();
    let all: f64 = photons.iter().sum();
    let mut lines = Vec::new();
    let (mut sum, mut moment) = (0.0, 0.0);
    for (band, photons) in photons.iter().enumerate() {
        sum += photons;
        moment += photons * grid.center_nm(band);
        let last = band + 1 == irradiance.len();
        if sum > 0.0 && (sum >= all / MOST_LINES as f64 || last) {
            lines.push(((moment / sum * 1e3).round() * 1e-3, sum));
            (sum, moment) = (0.0, 0.0);
        }
    }
    lines
}

/// Mean wavelength of lines, nm.
fn mean_nm(lines: &[(f64, f64)]) -> f64 {
    let photons: f64 = lines.iter().map(|line| line.1).sum();
    lines.iter().map(|(nm, photons)| nm * photons).sum::<f64>() / photons.max(f64::MIN_POSITIVE)
}

/// Least squares by the cubic terms of a design.
struct PolynomialFit {
    terms: DMatrix<f64>,
    solution: DMatrix<f64>,
}

impl PolynomialFit {
    fn new(x: &[Vec<f64>]) -> Option<Self> {
        let rows: Vec<f64> = x.iter().flat_map(|x| CubicTerms::new(x).values).collect();
        let columns = rows.len() / x.len().max(1);
        let terms = DMatrix::from_row_slice(x.len(), columns, &rows);
        let solution = (terms.transpose() * &terms).cholesky()?.solve(&terms.transpose());
        Some(Self { terms, solution })
    }

    /// Coefficients, and the root mean square that they leave, corrected for their number.
    fn fit(&self, values: &[f64]) -> (Vec<f64>, f64) {
        let values = nalgebra::DVector::from_column_slice(values);
        let coefficients = &self.solution * &values;
        let rest = &self.terms * &coefficients - &values;
        let free = (values.len() - coefficients.len()).max(1) as f64;
        (coefficients.iter().copied().collect(), (rest.norm_squared() / free).sqrt())
    }
}
