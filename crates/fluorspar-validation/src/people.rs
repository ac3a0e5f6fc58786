//! Measured radiance of tongues and inner lips of four people, of the study that the paper's authors published later.

use fluorspar::analysis::{MixtureLine, sensor_chromaticity};
use fluorspar::pipeline::{CameraResponse, predict};
use fluorspar::spectral::Curve;
use fluorspar::study::FlatSample;
use fluorspar_format::{NamedCurve, read_text_bounded};

use super::check::{Check, Outcome, Verdict, number};
use super::setup::{Setup, ValidationError, sensor};
use fluorspar_report::figures::{ChromaticityPlot, chromaticity};
use fluorspar_report::{Axis, Ink, Panel, Series, SeriesShape};

/// The spectra, W/(sr m² nm), and the list of who and what they show.
pub(super) const SPECTRA: &str = "tissue/oe_tongue_lip_fluorescence.csv";
const INDEX: &str = "tissue/oe_tongue_lip_fluorescence_index.csv";
/// Where they are valid, nm.
const RANGE_NM: [f64; 2] = [500.0, 700.0];
/// The four people.
const PEOPLE: [&str; 4] = ["S1", "S2", "S3", "S4"];
/// Porphyrin of the coating of tongues.
const PORPHYRIN: &str = "biofilm_porphyrin";

/// One measured spectrum.
pub(super) struct Measured {
    pub(super) site: String,
    pub(super) person: String,
    pub(super) spectrum: NamedCurve,
}

/// The spectra under 405 and 415 nm LEDs; `None` where a file is missing.
pub(super) fn read(setup: &Setup<'_>) -> Result<Option<Vec<Measured>>, ValidationError> {
    let (Some(index), Some(spectra)) = (setup.reference_file(INDEX), setup.measured(SPECTRA)?) else {
        return Ok(None);
    };
    let index = read_text_bounded(&index, 1 << 20)?;
    // Column, file, date, subject, site, light, current, place, comment, flag: what is flagged was misnamed, and its authors left it out
    let lines: Vec<Vec<&str>> = index.lines().map(|line| line.split(',').collect()).collect();
    let label = |spectrum: NamedCurve| {
        let line = lines.iter().find(|cells| cells.first() == Some(&spectrum.name.as_str()))?;
        let (person, site, light) = (line.get(3)?, line.get(4)?, line.get(5)?);
        let wanted = ["405", "415"].contains(light) && line.get(9).is_none_or(|flag| flag.is_empty());
        wanted.then(|| Measured { site: (*site).into(), person: (*person).into(), spectrum })
    };
    Ok(Some(spectra.into_iter().filter_map(label).collect()))
}

/// One person's tongue on the line from the own lip to porphyrin.
struct Person {
    name: &'static str,
    /// `(r, g)` of each spectrum.
    lip: Vec<[f64; 2]>,
    tongue: Vec<[f64; 2]>,
    /// Mean place of the spectra of the tongue on the line, and its standard error.
    position: [f64; 2],
}

/// The four people, and R, G and B of porphyrin.
type PeopleAndPorphyrin = (Vec<Person>, [f64; 3]);

/// People on the way to porphyrin; `None` where a file is missing.
fn people(setup: &Setup<'_>) -> Result<Option<PeopleAndPorphyrin>, ValidationError> {
    let Some(measured) = read(setup)? else { return Ok(None) };
    let sample = setup.sample(&[])?;
    let camera = Camera::new(&sample)?;
    let porphyrin = camera.fluorophore(setup, PORPHYRIN)?;
    let people = PEOPLE.map(|name| person(name, &measured, &camera, porphyrin));
    Ok(Some((people.into_iter().collect::<Result<Vec<Person>, ValidationError>>()?, porphyrin)))
}

/// The plane of chromaticities with the measured people, whole and enlarged, to stand beside simulated ones; `None` where a file is
/// missing.
pub(super) fn panels(setup: &Setup<'_>) -> Result<Option<Vec<Panel>>, ValidationError> {
    let Some((people, porphyrin)) = people(setup)? else { return Ok(None) };
    Ok(Some(figure(&people, porphyrin).panels))
}

/// Tongues lie from lips in the direction of porphyrin, for each person.
pub(super) fn run(setup: &Setup<'_>) -> Result<Outcome, ValidationError> {
    let Some((people, porphyrin)) = people(setup)? else {
        let reason = "Spectra of tongues and lips that the paper's authors published later are put through this camera where \
                      --reference names their folder.";
        return Ok(Outcome::new(Verdict::Skipped, reason).lacks(format!("{SPECTRA} and {INDEX}")));
    };
    let checks = people.iter().map(|person| {
        let [position, error] = person.position;
        let what =
            format!("place of the tongue of {} from lip to porphyrin, in standard errors", person.name);
        let why = "three standard errors of the mean over the spectra of the tongue";
        Check::at_least(what, 3.0, position / error, "", why).said("porphyrins on the dorsal side of tongues")
    });
    let places: Vec<String> = people.iter().map(|person| number(person.position[0])).collect();
    let reason = format!(
        "Measured spectra of four people (405 and 415 nm) put through this camera: each tongue lies from the person's own lip toward \
         porphyrin, by {} of the way. Lips, which have none, are no point: blood moves them along the same line. The paper's three \
         frames are not public.",
        places.join(", ")
    );
    Ok(Outcome::new(Verdict::Reproduced, reason)
        .checks(checks)
        .show("figure_8_measured", figure(&people, porphyrin)))
}

fn person(
    name: &'static str,
    measured: &[Measured],
    camera: &Camera,
    porphyrin: [f64; 3],
) -> Result<Person, ValidationError> {
    let of = |site: &str| -> Vec<[f64; 3]> {
        let here = measured.iter().filter(|spectrum| spectrum.site == site && spectrum.person == name);
        here.map(|measured| camera.rgb(&measured.spectrum.curve)).collect()
    };
    let (lip, tongue) = (of("lip"), of("tongue"));
    let lacking = || ValidationError::Lacks("measured lip and tongue of each of the four people");
    // Each spectrum counts alike, whatever the current of the LED
    let scaled = |rgb: &[f64; 3]| rgb.map(|value| value / rgb.iter().sum::<f64>());
    let mean = [0, 1, 2].map(|c: usize| lip.iter().map(|rgb| scaled(rgb)[c]).sum::<f64>());
    let line = MixtureLine::new(mean, porphyrin).map_err(|_| lacking())?;
    let places: Vec<f64> =
        tongue.iter().filter_map(|rgb| line.project(*rgb, [1.0; 3])).map(|e| e.position).collect();
    if places.len() < 2 {
        return Err(lacking());
    }
    let n = places.len() as f64;
    let center = places.iter().sum::<f64>() / n;
    let variance = places.iter().map(|place| (place - center).powi(2)).sum::<f64>() / (n - 1.0);
    let points = |rgb: Vec<[f64; 3]>| rgb.into_iter().filter_map(sensor_chromaticity).collect();
    Ok(Person { name, lip: points(lip), tongue: points(tongue), position: [center, (variance / n).sqrt()] })
}

/// The camera of the sample for light from 500 to 700 nm.
struct Camera<'a> {
    sample: &'a FlatSample,
    response: CameraResponse,
    rgb: [usize; 3],
}

impl<'a> Camera<'a> {
    fn new(sample: &'a FlatSample) -> Result<Self, ValidationError> {
        let lens = sample.camera.lens_behind_filters().ok_or(ValidationError::Lacks("lens"))?;
        let response = CameraResponse::new(&lens, sensor(sample)?, &sample.grid, None);
        let rgb = response.rgb().ok_or(ValidationError::Lacks("channel R, G or B"))?;
        Ok(Self { sample, response, rgb })
    }

    /// R, G and B of a radiance, e- in a second.
    fn rgb(&self, radiance: &Curve) -> [f64; 3] {
        let bins = radiance.clipped(RANGE_NM[0], RANGE_NM[1]).bin_averages(&self.sample.grid);
        self.rgb.map(|channel| self.response.channel_electrons(channel, &bins, 1.0))
    }

    /// R, G and B of a fluorophore under the sample's light.
    fn fluorophore(&self, setup: &Setup<'_>, name: &str) -> Result<[f64; 3], ValidationError> {
        let prediction = predict(&setup.glowing(&[(name, 1.0)])?)?;
        let radiance = prediction.radiance.fluorescence.get(name).cloned().unwrap_or_default();
        let curve = Curve::new(prediction.wavelength_nm, radiance);
        Ok(self.rgb(&curve.map_err(|_| ValidationError::Lacks("fluorescence"))?))
    }
}

fn figure(people: &[Person], porphyrin: [f64; 3]) -> fluorspar_report::Figure {
    let fluorophores = sensor_chromaticity(porphyrin).map(|point| (PORPHYRIN.to_owned(), point));
    let plot =
        ChromaticityPlot { fluorophores: fluorophores.into_iter().collect(), ..ChromaticityPlot::default() };
    let mut figure = chromaticity(&plot).titled("Tongues and lips of four people through this camera").explained(
        "Each circle is one spectrum measured under a 405 or 415 nm LED, from 500 to 700 nm: hollow on the inner lip, filled on the back of the \
         tongue. Tongues lie from the same person's lip toward porphyrin.",
    );
    figure.panels.truncate(1);
    figure.panels =
        figure.panels.into_iter().map(|panel| panel.titled("measured: all chromaticities")).collect();
    figure.panels.push(enlarged(people));
    for (number, panel) in figure.panels.iter_mut().enumerate() {
        // Lips last: tongues reach over them
        for (site, hollow) in [("tongue", false), ("lip", true)] {
            for (index, person) in people.iter().enumerate() {
                let points = if hollow { &person.lip } else { &person.tongue };
                panel.series.push(Series {
                    name: (number == 0).then(|| format!("measured {site} of {}", person.name)),
                    ink: Ink::cycle(index),
                    shape: SeriesShape::Markers { points: points.clone(), radius: 3.0, hollow },
                });
            }
        }
    }
    figure
}

/// Axes around what was measured.
fn enlarged(people: &[Person]) -> Panel {
    let around = |coordinate: usize| {
        let points = people.iter().flat_map(|person| person.lip.iter().chain(&person.tongue));
        let (low, high) = points.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), point| {
            (low.min(point[coordinate]), high.max(point[coordinate]))
        });
        [(20.0 * low).floor() / 20.0, (20.0 * high).ceil() / 20.0]
    };
    let [x, y] = [("r = R / (R + G + B)", 0), ("g = G / (R + G + B)", 1)]
        .map(|(label, coordinate)| Axis::linear(label, "", around(coordinate)));
    Panel::new(x, y).titled("measured: enlarged")
}
