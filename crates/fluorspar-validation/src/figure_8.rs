//! Figure 8: chromaticities of the tongues of three people, here three levels of porphyrin on one tongue.

use fluorspar::analysis::{LineEstimate, Statistics};
use fluorspar::image::{ComponentFactors, ComponentImage, LightPath};
use fluorspar::pipeline::{Evaluation, evaluate};
use fluorspar::study::Study;

use super::check::{Check, Outcome, Verdict, number};
use super::people;
use super::setup::{PORPHYRIN, Setup, ValidationError};
use fluorspar_report::figures::{ChromaticityPlot, chromaticity, pictures};
use fluorspar_report::{Figure, Panel, Raster};

/// Porphyrin of each subject over that of the built-in tongue, whose strongest spot glows as the strongest of about ten people.
const SUBJECTS: [(&str, f64); 3] = [("little", 0.1), ("some", 0.4), ("much", 1.0)];
/// Pixels and paths of the render; the sensor has two pixels for each of the render, as large together as the real one.
const PICTURE: [usize; 2] = [120, 90];
const SAMPLES: usize = 96;
const COARSER: f64 = 4.0;

/// What the pixels of one subject's tongue show.
struct Subject {
    name: &'static str,
    evaluation: Evaluation,
    /// Median place on the line and its spread, 5th to 95th percentile.
    position: Statistics,
    /// Standard deviation across the line over the standard error that the noise of a pixel gives.
    across: f64,
    /// The same along the line.
    along: f64,
}

pub(super) fn run(setup: &Setup<'_>) -> Result<Outcome, ValidationError> {
    let study = study(setup)?;
    let image = setup.render(&study)?;
    let one = |&(name, level): &(&'static str, f64)| subject(name, evaluate(&study, &scaled(&image, level))?);
    let subjects = SUBJECTS.iter().map(one).collect::<Result<Vec<Subject>, ValidationError>>()?;

    let medians: Vec<f64> = subjects.iter().map(|subject| subject.position.median).collect();
    let across = subjects.iter().map(|subject| subject.across).fold(0.0, f64::max);
    let strongest = subjects.last().map_or([f64::NAN; 2], |subject| [subject.along, subject.across]);
    let reason = format!(
        "Three levels of porphyrin: pixels of the tongue stretch along the line ({} standard errors of a pixel in the strongest), and \
         across it by {} standard errors at most. Median places on the line: {}. The paper's frames are not public; real frames go \
         through `fluorspar analyze --frame`.",
        number(strongest[0]),
        number(across),
        medians.iter().map(|median| number(*median)).collect::<Vec<_>>().join(", ")
    );
    let step = medians.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    Ok(Outcome::new(Verdict::Reproduced, reason)
        .checks(checks(step, across, strongest[0] / strongest[1]))
        .lacks("the three frames of Fig. 8 (a-c), which are not public")
        .show("figure_8_subjects", figure(&subjects, people::panels(setup)?)))
}

/// The mouth before a sensor with fewer and larger pixels.
fn study(setup: &Setup<'_>) -> Result<Study, ValidationError> {
    let [width, height] = PICTURE;
    setup.mouth(&[
        format!("render.width_px={width}"),
        format!("render.height_px={height}"),
        format!("render.samples_per_pixel={SAMPLES}"),
        "mouth.detail=0.4".to_owned(),
        format!("sensor.columns={}", 2 * width),
        format!("sensor.rows={}", 2 * height),
        // As wide together as the real ones, as sensitive each
        format!("sensor.pixel_size_um={:?}", 2.5 * COARSER),
        format!("sensor.fill_factor={:?}", 0.99 / (COARSER * COARSER)),
    ])
}

fn checks(step: f64, across: f64, slenderness: f64) -> [Check; 3] {
    let what = "smallest step of the median place on the line from one subject to the next";
    let rising =
        Check::at_least(what, f64::MIN_POSITIVE, step, "", "more porphyrin lies nearer to porphyrin");
    let what = "largest spread across the line over the standard error of a pixel";
    let why = "1 is noise alone; interpolation of colors, indirect light of other colors and the render's own noise add to it";
    let straight = Check::at_most(what, MOST_ACROSS, across, "", why);
    let what = "spread along the line of the strongest over that across it";
    let long = Check::at_least(what, 2.0, slenderness, "", "a cloud twice as long as wide has a direction");
    [
        rising.said("the primary difference is explained by the porphyrins concentration"),
        straight.said("the data fall along a line"),
        long.said("in the direction of the porphyrins"),
    ]
}

/// Spread across the line that is still called a line.
const MOST_ACROSS: f64 = 2.0;

/// The same image with other porphyrin: first fluorescence is linear in the concentration.
fn scaled(image: &ComponentImage, level: f64) -> ComponentImage {
    let porphyrin = LightPath::Fluorescence(PORPHYRIN.into());
    let mut factors = ComponentFactors::ones(image.components.len());
    for (component, factor) in image.components.iter().zip(&mut factors.even) {
        if component.light == porphyrin {
            *factor = level;
        }
    }
    let mut scaled = image.clone();
    scaled.scale(&factors);
    scaled
}

fn subject(name: &'static str, evaluation: Evaluation) -> Result<Subject, ValidationError> {
    let lacking = || ValidationError::Lacks("analysis of the tongue");
    let map =
        evaluation.analysis.as_ref().and_then(|analyzed| analyzed.porphyrin.as_ref()).ok_or_else(lacking)?;
    let estimates: Vec<LineEstimate> = map.estimates.iter().map(|(_, estimate)| *estimate).collect();
    let statistics =
        |of: &dyn Fn(&LineEstimate) -> f64| Statistics::of(estimates.iter().map(of)).ok_or_else(lacking);
    let position = statistics(&|e| e.position)?;
    // Half of the range from the 16th to the 84th percentile would do; quartiles are at hand. 1.349 of a normal distribution.
    let spread = |of: &Statistics| (of.p75 - of.p25) / 1.349;
    let across = spread(&statistics(&|e| e.distance)?) / statistics(&|e| e.distance_standard_error)?.median;
    let along = spread(&position) / statistics(&|e| e.position_standard_error)?.median;
    Ok(Subject { name, position, across, along, evaluation })
}

/// Frames above, chromaticities below, one column for each subject; behind them people, of whom spectra were measured.
fn figure(subjects: &[Subject], measured: Option<Vec<Panel>>) -> Figure {
    let frames: Vec<(String, Raster)> = subjects
        .iter()
        .filter_map(|subject| {
            let preview = subject.evaluation.previews.last()?;
            let raster = Raster::from_rgb8(preview.width, preview.height, &preview.rgb)?;
            Some((format!("{} porphyrin", subject.name), raster))
        })
        .collect();
    let mut figure = pictures("Tongues with three levels of porphyrin", frames, subjects.len());
    figure.panels.extend(subjects.iter().filter_map(plot));
    let simulated = "Above: the frame under the 385 nm LED. Below: each dot is one pixel of the back of the tongue in sensor chromaticity. The \
                     dots lie along the dashed line from bulk to porphyrin, the farther the more porphyrin there is.";
    let Some(panels) = measured else { return figure.explained(simulated) };
    figure.panels.extend(panels.into_iter().map(|panel| panel.sized(300.0, 300.0)));
    figure.explained(format!(
        "{simulated} Last: real people through the same camera, one mark for each spectrum measured under 405 or 415 nm; lips hollow, tongues \
         filled."
    ))
}

fn plot(subject: &Subject) -> Option<Panel> {
    let analyzed = subject.evaluation.analysis.as_ref()?;
    let mixture = analyzed.analysis.mixture.as_ref()?;
    let pixels = analyzed.region.pixels.iter().filter_map(|&pixel| analyzed.chromaticity.at(pixel)).collect();
    let plot = ChromaticityPlot {
        region: "the tongue".into(),
        pixels,
        fluorophores: vec![(PORPHYRIN.into(), mixture.porphyrin)],
        mixture_line: Some([mixture.bulk, mixture.porphyrin]),
        ..ChromaticityPlot::default()
    };
    let panel = chromaticity(&plot).panels.into_iter().next()?;
    Some(panel.sized(300.0, 300.0).titled(format!("{} porphyrin, simulated", subject.name)))
}
