//! Figure 6 (g): measured radiance of tongues as sums of fluorophores. The paper's two spectra are not public; spectra that its authors
//! published later stand in for them.

use fluorspar::analysis::{FitError, NonnegativeFit, fit_attenuated, fit_nonnegative};
use fluorspar::pipeline::predict;
use fluorspar::spectral::blood_transmittance;
use fluorspar_format::{NamedCurve, read_text_bounded};

use super::check::{Check, Outcome, Verdict, number};
use super::setup::{BULK, PORPHYRIN, Setup, ValidationError};
use crate::{Axis, Dash, Figure, Ink, Panel, Series, SeriesShape};

/// Where the measured spectra are valid, nm; they are scaled to 1 at 520 nm.
const RANGE_NM: [usize; 2] = [500, 700];
const NORM_NM: f64 = 520.0;

/// Tongues of two people of 2019 under a 405 nm LED: little and much porphyrin.
const TONGUES: &str = "tissue/tongue2019_led405_led425_led450.csv";
const PEOPLE: [(&str, &str); 2] =
    [("little porphyrin", "led405_s001_m1"), ("much porphyrin", "led405_s007_m1")];

/// Spectra of tongues and inner lips, their index, the terms of the published fit and its blood.
const SPECTRA: &str = "tissue/oe_tongue_lip_fluorescence.csv";
const INDEX: &str = "tissue/oe_tongue_lip_fluorescence_index.csv";
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
    let terms = catalogue_terms(setup)?;
    let mixtures = PEOPLE
        .iter()
        .map(|&(title, column)| {
            let curve = people.iter().find(|curve| curve.name == column);
            let curve = curve.ok_or(ValidationError::Lacks("column of the measured tongue"))?;
            Ok(Mixture {
                title,
                fit: fitted(fit_nonnegative(&terms.values, &samples(curve)))?,
                data: samples(curve),
            })
        })
        .collect::<Result<Vec<_>, ValidationError>>()?;
    let densities: Vec<Check> =
        DENSITIES.iter().map(|density| spectra.check(density)).collect::<Result<_, _>>()?;
    let close = densities
        .iter()
        .zip(DENSITIES)
        .filter(|(check, (_, _, _, printed))| (check.computed / printed - 1.0).abs() <= 0.01);
    let [little, much] = [0, 1].map(|person: usize| mixtures[person].fit.terms[terms.porphyrin]);
    let reason = format!(
        "The paper's two spectra and weights are not public. In its authors' later spectra porphyrin is {} ({} to {}) and {} ({} to {}) \
         units per unit of signal at 520 nm; residuals of {} and {} of that signal, from blood that no weight describes, make \
         weights of the other four unreliable. With blood in one layer, as its authors published later, {} of 8 optical densities \
         come out within 1 %.",
        number(little.weight),
        number(little.interval[0]),
        number(little.interval[1]),
        number(much.weight),
        number(much.interval[0]),
        number(much.interval[1]),
        number(mixtures[0].fit.rms),
        number(mixtures[1].fit.rms),
        close.count()
    );
    Ok(Outcome::new(Verdict::NotPublic, reason)
        .check(
            Check::at_least(
                "lower end of porphyrin in the tongue with much, over the upper end in that with little",
                1.0,
                much.interval[0] / little.interval[1],
                "",
                "95 % intervals that do not overlap",
            )
            .said("the porphyrins concentrations differed for the two participants"),
        )
        .checks(densities)
        .lacks("the two spectra of Fig. 6 (g) under the 385 nm LED, which are not public")
        .show("figure_6g_mixtures", figure(&terms, &mixtures)))
}

fn fitted<T>(fit: Result<T, FitError>) -> Result<T, ValidationError> {
    fit.map_err(|_| ValidationError::Lacks("finite spectrum from 500 to 700 nm"))
}

/// A measured spectrum and its fit.
struct Mixture {
    title: &'static str,
    data: Vec<f64>,
    fit: NonnegativeFit,
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

/// Emission of the catalogue's fluorophores under a 405 nm LED.
struct Terms {
    names: Vec<&'static str>,
    values: Vec<Vec<f64>>,
    porphyrin: usize,
}

fn catalogue_terms(setup: &Setup<'_>) -> Result<Terms, ValidationError> {
    let names: Vec<&'static str> = BULK.iter().copied().chain([PORPHYRIN, "chlorophyll_a"]).collect();
    let amounts: Vec<(&str, f64)> = names.iter().map(|&name| (name, 1.0)).collect();
    let mut sample = setup.glowing(&amounts)?;
    let light = ["light.spectrum=\"led_405\"", "light.filters=[\"short_pass_450\"]"];
    sample.irradiance = setup.sample(&light)?.irradiance;
    let prediction = predict(&sample)?;
    let nm = &prediction.wavelength_nm;
    let curve = |name: &&str| {
        let values = prediction.radiance.fluorescence.get(*name).cloned().unwrap_or_default();
        fluorspar::spectral::Curve::new(nm.clone(), values)
            .map_err(|_| ValidationError::Lacks("fluorescence"))
    };
    let curves = names.iter().map(curve).collect::<Result<Vec<_>, _>>()?;
    let values = curves.iter().map(|curve| wavelengths().map(|nm| curve.at(nm)).collect()).collect();
    Ok(Terms { porphyrin: BULK.len(), names, values })
}

/// The spectra of the later study.
struct Spectra {
    /// Site, subject and spectrum of each that was taken under 405 or 415 nm.
    measured: Vec<(String, String, NamedCurve)>,
    /// Emission terms, and extinction of oxygenated blood, 1 at its largest.
    terms: Vec<Vec<f64>>,
    extinction: Vec<f64>,
}

impl Spectra {
    /// `None` where a file is missing.
    fn read(setup: &Setup<'_>) -> Result<Option<Self>, ValidationError> {
        let Some(index) = setup.reference_file(INDEX) else { return Ok(None) };
        let index = read_text_bounded(&index, 1 << 20)?;
        let Some((spectra, blood)) = setup.measured(SPECTRA)?.zip(setup.measured(BLOOD)?) else {
            return Ok(None);
        };
        let Some(blood) = blood.into_iter().next() else { return Ok(None) };
        let mut terms = Vec::new();
        for name in TERMS {
            let columns = setup.measured(&format!("fluorophores/toolbox/{name}.csv"))?;
            let emission = columns.into_iter().flatten().find(|column| column.name == "emission");
            let Some(emission) = emission else { return Ok(None) };
            terms.push(wavelengths().map(|nm| emission.curve.at(nm)).collect());
        }
        let [center, deviation] = PSEUDO_KERATIN_NM;
        terms.push(wavelengths().map(|nm| (-0.5 * ((nm - center) / deviation).powi(2)).exp()).collect());
        let largest = blood.curve.max();
        Ok(Some(Self {
            measured: labeled(&index, spectra),
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
            .filter(|(at, of, _)| at == site && of == subject)
            .map(|(_, _, curve)| curve)
            .collect();
        let density = |data: &[f64]| {
            let fit = fit_attenuated(&self.terms[..terms], &self.extinction, data, 40.0);
            fitted(fit).map(|fit| fit.optical_density)
        };
        let scaled: Vec<Vec<f64>> = curves.iter().map(|curve| samples(curve)).collect();
        let raw: Vec<Vec<f64>> =
            curves.iter().map(|curve| wavelengths().map(|nm| curve.curve.at(nm)).collect()).collect();
        let ways = [density(&mean(&scaled))?, density(&median(&scaled))?, density(&mean(&raw))?];
        let spread = ways.iter().copied().fold(f64::NEG_INFINITY, f64::max)
            - ways.iter().copied().fold(f64::INFINITY, f64::min);
        let why = format!(
            "1 %, or the spread between the mean of {} scaled spectra, their median and the mean of the raw ones: how the authors \
             averaged is not published",
            curves.len()
        );
        let what = format!("optical density of blood before collagen, {site} of {subject}");
        Ok(Check::near(what, printed, spread.max(0.01 * printed), ways[0], "", why))
    }
}

/// Spectra under 405 and 415 nm with site and subject, from the lines of the index: column, file, date, subject, site, light.
fn labeled(index: &str, spectra: Vec<NamedCurve>) -> Vec<(String, String, NamedCurve)> {
    let lines: Vec<Vec<&str>> = index.lines().map(|line| line.split(',').collect()).collect();
    let label = |curve: NamedCurve| {
        let line = lines.iter().find(|cells| cells.first() == Some(&curve.name.as_str()))?;
        let (subject, site, light) = (line.get(3)?, line.get(4)?, line.get(5)?);
        ["405", "415"].contains(light).then(|| ((*site).to_owned(), (*subject).to_owned(), curve))
    };
    spectra.into_iter().filter_map(label).collect()
}

fn mean(spectra: &[Vec<f64>]) -> Vec<f64> {
    let at = |i: usize| spectra.iter().map(|spectrum| spectrum[i]).sum::<f64>() / spectra.len() as f64;
    (0..wavelengths().count()).map(at).collect()
}

fn median(spectra: &[Vec<f64>]) -> Vec<f64> {
    let at = |i: usize| {
        let mut values: Vec<f64> = spectra.iter().map(|spectrum| spectrum[i]).collect();
        values.sort_by(f64::total_cmp);
        let middle = values.len() / 2;
        if values.len() % 2 == 0 { 0.5 * (values[middle - 1] + values[middle]) } else { values[middle] }
    };
    (0..wavelengths().count()).map(at).collect()
}

/// Above: measured spectrum, fit and terms of each tongue. Below: residuals, with the absorption of blood for comparison.
fn figure(terms: &Terms, mixtures: &[Mixture]) -> Figure {
    let nm: Vec<f64> = wavelengths().collect();
    let points = |values: &[f64]| -> Vec<[f64; 2]> { nm.iter().zip(values).map(|(&x, &y)| [x, y]).collect() };
    let x = || Axis::wavelength(RANGE_NM.map(|nm| nm as f64));
    let above = |mixture: &Mixture| {
        let y = Axis::from_zero("radiance, 1 at 520 nm", "", mixture.data.iter().copied());
        let dots = SeriesShape::Dots { points: points(&mixture.data), radius: 1.6, opacity: 0.9 };
        let mut panel = Panel::new(x(), y).sized(380.0, 260.0).titled(mixture.title);
        panel = panel.with(Series { name: Some("measured".into()), ink: Ink::Text, shape: dots });
        panel = panel.with(Series::line("fit", Ink::Muted, points(&mixture.fit.fitted)));
        let inks = Ink::of_fluorophores(terms.names.iter().copied());
        for ((name, values), (term, ink)) in
            terms.names.iter().zip(&terms.values).zip(mixture.fit.terms.iter().zip(inks))
        {
            if term.is_free {
                let weighted: Vec<f64> = values.iter().map(|value| term.weight * value).collect();
                panel = panel.with(Series::dashed(*name, ink, points(&weighted), ink.fluorophore_dash()));
            }
        }
        panel
    };
    let largest = mixtures.iter().flat_map(|m| &m.fit.residual).fold(0.0f64, |a, b| a.max(b.abs()));
    // Blood in front of the fluorophores dips where it absorbs
    let blood: Vec<f64> = nm.iter().map(|&nm| blood_transmittance(nm, 30.0) - 1.0).collect();
    let below = |mixture: &Mixture| {
        let y = Axis::linear("measured less fit", "", [-1.1 * largest, 1.1 * largest]);
        let zero =
            SeriesShape::Line { points: vec![[500.0, 0.0], [700.0, 0.0]], width: 1.0, dash: Dash::Solid };
        Panel::new(x(), y)
            .sized(380.0, 160.0)
            .with(Series::unnamed(Ink::Muted, zero))
            .with(Series::line("residual", Ink::PALETTE[0], points(&mixture.fit.residual)))
            .with(Series::dashed(
                "30 um of blood, transmittance less 1",
                Ink::PALETTE[1],
                points(&blood),
                Dash::Dotted,
            ))
    };
    let panels = mixtures.iter().map(above).chain(mixtures.iter().map(below)).collect();
    Figure::grid("Measured tongues as sums of fluorophores", panels, mixtures.len().max(1)).explained(
        "Above: dots are radiance measured on two tongues under a 405 nm LED, the gray line is the best sum of the catalogue's fluorophores \
         with weights that are not negative; fluorophores without a line have weight zero. Below: what is left. Dips near 540 and \
         580 nm are those of blood in front of the fluorophores, which a sum of emissions can't make.",
    )
}
