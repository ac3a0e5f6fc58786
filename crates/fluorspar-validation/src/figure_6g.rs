//! Figure 6 (g): measured radiance of tongues as sums of fluorophores. The paper's two spectra are not public; spectra that its authors
//! published later stand in for them.

use fluorspar::analysis::{
    BloodBefore, FitError, FittedWeight, MixtureComponent, MixtureFit, SpectralMixture,
};
use fluorspar::spectral::oxyhemoglobin_extinction;
use fluorspar_format::NamedCurve;

use super::check::{Check, Outcome, Verdict, number};
use super::people::{self, Measured, SPECTRA};
use super::setup::{BULK, PORPHYRIN, Setup, ValidationError, fluorophore};
use fluorspar_report::{Axis, Dash, Figure, Ink, Panel, Series, SeriesShape};

/// Where the measured spectra are valid, nm; they are scaled to 1 at 520 nm.
const RANGE_NM: [usize; 2] = [500, 700];
const NORM_NM: f64 = 520.0;

/// Tongues of two people of 2019 under a 405 nm LED: little and much porphyrin. Their long-pass cuts at 520 nm.
const TONGUES: &str = "tissue/tongue2019_led405_led425_led450.csv";
const PEOPLE_NM: [usize; 3] = [540, 700, 5];
const PEOPLE: [(&str, &str); 2] =
    [("little porphyrin", "led405_s001_m1"), ("much porphyrin", "led405_s007_m1")];

/// What tongues are made of besides: fluorophores of deposits and of the coating, and blood before deep collagen.
const BESIDES: [&str; 3] = ["lipopigment", BIOFILM, "biofilm_chlorophyll"];
const BIOFILM: &str = "biofilm_porphyrin";
/// Deep collagen, below blood; the other one is that of the paper's five.
const DEEP: &str = "collagen below blood";
/// Largest optical density that is looked for.
const LARGEST_DENSITY: f64 = 40.0;

/// The terms of the published fit and its blood.
const BLOOD: &str = "blood/hemoglobin_oxy_molar_extinction.csv";
const TERMS: [&str; 4] = ["collagen1_smooth", "fad_webfluor", "porphyrinbjurshammar", "chlorophylla_7"];
/// Fifth term, a broad band that the authors call pseudo-keratin: center and standard deviation, nm.
const PSEUDO_KERATIN_NM: [f64; 2] = [425.1, 386.7];
/// Published optical densities of blood: site, subject, number of terms, density.
const DENSITIES: [(&str, &str, usize, f64); 8] = [
    ("tongue", "S1", 5, 9.97),
    ("tongue", "S2", 5, 11.75),
    ("tongue", "S3", 5, 9.50),
    ("tongue", "S4", 5, 13.22),
    ("lip", "S1", 2, 11.54),
    ("lip", "S2", 2, 9.13),
    ("lip", "S3", 2, 6.32),
    ("lip", "S4", 2, 5.97),
];

pub(super) fn run(setup: &Setup<'_>) -> Result<Outcome, ValidationError> {
    let Some((people, spectra)) = setup.measured(TONGUES)?.zip(Spectra::read(setup)?) else {
        let reason = "The paper's two spectra are not public. Spectra of other tongues that its authors published are compared instead where \
                      --reference names their folder.";
        return Ok(Outcome::new(Verdict::Skipped, reason)
            .lacks(format!("{TONGUES}, {SPECTRA} and the files that go with it")));
    };
    let terms = Terms::new(setup)?;
    let of_person = |&(title, column): &(&'static str, &str)| {
        let curve = people.iter().find(|curve| curve.name == column);
        fitted(terms.fit(title, curve.ok_or(ValidationError::Lacks("column of the measured tongue"))?))
    };
    let mixtures = PEOPLE.iter().map(of_person).collect::<Result<Vec<_>, ValidationError>>()?;
    let densities: Vec<Check> =
        DENSITIES.iter().map(|density| spectra.check(density)).collect::<Result<_, _>>()?;
    let [little, much] = [0, 1].map(|person: usize| &mixtures[person].fit.weights[terms.porphyrin]);
    let rms = |fit: &dyn Fn(&Mixture) -> f64| mixtures.iter().map(fit).fold(0.0, f64::max);
    let what = "lower end of porphyrin in the tongue with much, over the upper end in that with little";
    let ratio = much.interval[0] / little.interval[1];
    let apart = Check::at_least(what, 1.0, ratio, "", "95 % intervals that do not overlap");
    let what = "largest residual with blood and coating over that of the paper's five";
    let ratio = rms(&|mixture| mixture.fit.rms / mixture.five.rms);
    let better = Check::at_most(what, 1.0, ratio, "", "more terms fit better, if they are those of a tongue");
    Ok(Outcome::new(Verdict::NotPublic, reason(&mixtures, [little, much], &densities))
        .check(apart.said("the porphyrins concentrations differed for the two participants"))
        .check(better)
        .checks(densities)
        .lacks("the two spectra of Fig. 6 (g) under the 385 nm LED, which are not public")
        .show("figure_6g_mixtures", figure(&mixtures)))
}

fn reason(mixtures: &[Mixture], porphyrin: [&FittedWeight; 2], densities: &[Check]) -> String {
    let off = |(check, (_, _, _, printed)): (&Check, (_, _, _, f64))| (check.computed / printed - 1.0).abs();
    let close = densities.iter().zip(DENSITIES).map(off).filter(|off| *off <= 0.01).count();
    let rms = |fit: &dyn Fn(&Mixture) -> f64| number(mixtures.iter().map(fit).fold(0.0, f64::max));
    let [little, much] = porphyrin
        .map(|t| format!("{} ({} to {})", number(t.weight), number(t.interval[0]), number(t.interval[1])));
    format!(
        "The paper's two spectra and weights are not public. Sums of its five fluorophores leave up to {} of the largest signal of two \
         tongues that its authors measured later; with blood before deep collagen and fluorophores of coating and deposits {} are \
         left, and porphyrin stands at {little} and {much} units. With blood in one layer, as they published themselves, {close} of \
         8 optical densities come out within 1 %.",
        rms(&|mixture| mixture.five.rms / mixture.largest()),
        rms(&|mixture| mixture.fit.rms / mixture.largest()),
    )
}

fn fitted<T>(fit: Result<T, FitError>) -> Result<T, ValidationError> {
    fit.map_err(|_| ValidationError::Lacks("finite spectrum from 500 to 700 nm"))
}

/// A measured spectrum and two fits.
struct Mixture {
    title: &'static str,
    data: Vec<f64>,
    /// By the paper's five fluorophores.
    five: MixtureFit,
    /// By those of a tongue, blood before deep collagen.
    fit: MixtureFit,
}

impl Mixture {
    fn largest(&self) -> f64 {
        self.data.iter().copied().fold(f64::MIN_POSITIVE, f64::max)
    }
}

/// Wavelengths of all fits, nm.
fn wavelengths() -> impl Iterator<Item = f64> + Clone {
    (RANGE_NM[0]..=RANGE_NM[1]).map(|nm| nm as f64)
}

/// A measured spectrum at these wavelengths, 1 at 520 nm.
fn samples(measured: &NamedCurve) -> Vec<f64> {
    let norm = measured.curve.at(NORM_NM);
    wavelengths().map(|nm| measured.curve.at(nm) / norm).collect()
}

/// Wavelengths at which the two tongues were measured, nm.
fn people_nm() -> Vec<f64> {
    let [first, last, step] = PEOPLE_NM;
    (first..=last).step_by(step).map(|nm| nm as f64).collect()
}

/// Emission of the catalogue's fluorophores under a 405 nm LED at the wavelengths of the two tongues.
struct Terms {
    /// The paper's five.
    five: SpectralMixture,
    /// Those of a tongue; the first, collagen, lies below blood.
    tongue: SpectralMixture,
    porphyrin: usize,
}

impl Terms {
    fn new(setup: &Setup<'_>) -> Result<Self, ValidationError> {
        let light = ["light.spectrum=\"led_405\"", "light.filters=[\"short_pass_450\"]"];
        let irradiance = setup.sample(&light)?.irradiance;
        let of = |names: &[&str]| {
            let component = |name: &&str| {
                let of_catalogue = if *name == DEEP { "collagen" } else { name };
                let values = fluorophore(of_catalogue)?.radiance_under(&irradiance, &people_nm());
                Ok(MixtureComponent { name: (*name).to_string(), values })
            };
            names.iter().map(component).collect::<Result<Vec<_>, ValidationError>>()
        };
        let five: Vec<&str> = BULK.into_iter().chain([PORPHYRIN]).collect();
        let tongue: Vec<&str> = [DEEP].into_iter().chain(BULK).chain(BESIDES).collect();
        let blood = BloodBefore::Layer {
            extinction: people_nm().into_iter().map(oxyhemoglobin_extinction).collect(),
            below: vec![0],
            largest: LARGEST_DENSITY,
        };
        Ok(Self {
            porphyrin: tongue.iter().position(|name| *name == BIOFILM).unwrap_or_default(),
            five: fitted(SpectralMixture::new(people_nm(), of(&five)?, BloodBefore::None))?,
            tongue: fitted(SpectralMixture::new(people_nm(), of(&tongue)?, blood))?,
        })
    }

    fn fit(&self, title: &'static str, measured: &NamedCurve) -> Result<Mixture, FitError> {
        let norm = measured.curve.at(PEOPLE_NM[0] as f64);
        let data: Vec<f64> = people_nm().into_iter().map(|nm| measured.curve.at(nm) / norm).collect();
        let (five, fit) = (self.five.fit(&data, None)?, self.tongue.fit(&data, None)?);
        Ok(Mixture { title, five, fit, data })
    }
}

/// The spectra of the later study.
struct Spectra {
    measured: Vec<Measured>,
    /// Emission terms.
    terms: Vec<MixtureComponent>,
    /// Extinction of oxygenated blood, 1 at its largest.
    extinction: Vec<f64>,
}

impl Spectra {
    /// `None` where a file is missing.
    fn read(setup: &Setup<'_>) -> Result<Option<Self>, ValidationError> {
        let Some((measured, blood)) = people::read(setup)?.zip(setup.measured(BLOOD)?) else {
            return Ok(None);
        };
        let Some(blood) = blood.into_iter().next() else { return Ok(None) };
        let mut terms = Vec::new();
        for name in TERMS {
            let columns = setup.measured(&format!("fluorophores/toolbox/{name}.csv"))?;
            let emission = columns.into_iter().flatten().find(|column| column.name == "emission");
            let Some(emission) = emission else { return Ok(None) };
            let values = wavelengths().map(|nm| emission.curve.at(nm)).collect();
            terms.push(MixtureComponent { name: name.into(), values });
        }
        let [center, deviation] = PSEUDO_KERATIN_NM;
        let broad = wavelengths().map(|nm| (-0.5 * ((nm - center) / deviation).powi(2)).exp());
        terms.push(MixtureComponent { name: "pseudo-keratin".into(), values: broad.collect() });
        let largest = blood.curve.max();
        Ok(Some(Self {
            measured,
            terms,
            extinction: wavelengths().map(|nm| blood.curve.at(nm) / largest).collect(),
        }))
    }

    /// The optical density of one site of one subject beside the published one.
    fn check(
        &self,
        &(site, subject, terms, printed): &(&str, &str, usize, f64),
    ) -> Result<Check, ValidationError> {
        let curves: Vec<&NamedCurve> = self
            .measured
            .iter()
            .filter(|measured| measured.site == site && measured.person == subject)
            .map(|measured| &measured.spectrum)
            .collect();
        if curves.is_empty() {
            return Err(ValidationError::Lacks("measured spectrum of each site of each subject"));
        }
        let scaled: Vec<Vec<f64>> = curves.iter().map(|curve| samples(curve)).collect();
        let (extinction, below) = (self.extinction.clone(), vec![0]);
        let blood = BloodBefore::Layer { extinction, below, largest: LARGEST_DENSITY };
        let nm = wavelengths().collect();
        let mixture = fitted(SpectralMixture::new(nm, self.terms[..terms].to_vec(), blood))?;
        let spectra: Vec<(&[f64], Option<&[f64]>)> =
            scaled.iter().map(|spectrum| (spectrum.as_slice(), None)).collect();
        let density = fitted(mixture.common_blood(&spectra))?;
        let why = format!("1 %: one density for {} spectra, each with weights of its own", curves.len());
        let what = format!("optical density of blood before collagen, {site} of {subject}");
        Ok(Check::near(what, printed, 0.01 * printed, density, "", why))
    }
}

/// Above: measured spectrum, fits and terms of each tongue. Below: residuals.
fn figure(mixtures: &[Mixture]) -> Figure {
    let panels = mixtures.iter().map(spectrum).chain(mixtures.iter().map(residual)).collect();
    Figure::grid("Measured tongues as sums of fluorophores", panels, mixtures.len().max(1)).explained(
        "Above: dots are radiance measured on two tongues under a 405 nm LED. The dashed line is the best sum of the paper's five \
         fluorophores with weights that are not negative, the solid one that with blood before deep collagen (the first collagen) \
         and with the fluorophores of coating and deposits; thin lines are its terms, those without a line have weight zero. \
         Below: what either leaves.",
    )
}

fn points(values: &[f64]) -> Vec<[f64; 2]> {
    people_nm().into_iter().zip(values).map(|(nm, &value)| [nm, value]).collect()
}

fn wavelength_axis() -> Axis {
    Axis::wavelength([PEOPLE_NM[0] as f64, PEOPLE_NM[1] as f64])
}

fn spectrum(mixture: &Mixture) -> Panel {
    let y = Axis::from_zero(
        "radiance, 1 at 540 nm",
        "",
        mixture.data.iter().copied().chain([1.1 * mixture.largest()]),
    );
    let dots = SeriesShape::Dots { points: points(&mixture.data), radius: 2.2, opacity: 0.9 };
    let mut panel = Panel::new(wavelength_axis(), y)
        .sized(380.0, 260.0)
        .titled(mixture.title)
        .with(Series { name: Some("measured".into()), ink: Ink::Text, shape: dots })
        .with(Series::dashed("the paper's five", Ink::Muted, points(&mixture.five.fitted), Dash::Dashed))
        .with(Series::line("with blood and coating", Ink::Text, points(&mixture.fit.fitted)));
    let weights = &mixture.fit.weights;
    let inks = Ink::of_fluorophores(weights.iter().map(|weight| weight.name.as_str()));
    let parts = weights.iter().zip(&mixture.fit.contributions).zip(inks);
    for ((weight, values), ink) in parts.filter(|((weight, _), _)| weight.is_free) {
        let shape = SeriesShape::Line { points: points(values), width: 1.2, dash: ink.fluorophore_dash() };
        panel = panel.with(Series { name: Some(weight.name.clone()), ink, shape });
    }
    panel
}

fn residual(mixture: &Mixture) -> Panel {
    let largest = mixture.five.residual.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    let y = Axis::linear("measured less fit", "", [-1.1 * largest, 1.1 * largest]);
    Panel::new(wavelength_axis(), y)
        .sized(380.0, 160.0)
        .with(Series::dashed("the paper's five", Ink::Muted, points(&mixture.five.residual), Dash::Dashed))
        .with(Series::line("with blood and coating", Ink::Text, points(&mixture.fit.residual)))
}
