//! Report of a run.

use fluorspar::analysis::{Analysis, BlockShares, median};
use fluorspar::image::{ComponentImage, LightPath};
use fluorspar::pipeline::{AnalyzedFrame, CapturedFrame, FrameLeak, RegionRadiance};
use fluorspar::scene::Scene;
use fluorspar::sensor::{SensorModel, SpectralQe};
use fluorspar::spectral::{Curve, Fluorophore};
use fluorspar::study::{Camera, Lens, Study};
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::schema::{ExperimentFile, SpectrumReference};
use fluorspar_experiment::{ResolvedExperiment, Warning};
use fluorspar_format::FrameFact;

use super::dark_frames::{dark_frames, leaking_frames};
use super::depth_section::depth_section;
use super::overview::overview;
use super::regions_section::{region_warnings, regions_section};
use super::safety_section::{exceeded_limits, risk_group_warning, safety_section};
use super::view_filters::{ViewFilters, assumed_blocking, view_band, view_filter_of};
use super::words::{NO_LIGHT, Words};
use super::{FrameOrigin, RunResults};
use crate::figures::{
    ChannelValues, ChromaticityPlot, EemMap, PlotCurve, chromaticity, eem_maps, emission, filters,
    histograms, lights, radiance_by_component, sensor_response, share_map, share_map_of_blocks,
    spectral_readings,
};
use crate::page::{glossary_section, plain_text};
use crate::{
    Figure, Number, NumberMatrix, NumberTable, Origin, ReportData, ReportItem, Scale, Section,
    analysis_section,
};

/// A figure and the name of its files.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedFigure {
    /// File name without ending.
    pub stem: String,
    /// The figure.
    pub figure: Figure,
}

/// The page of a run and its figures.
#[derive(Clone, Debug, PartialEq)]
pub struct RunReport {
    /// The page.
    pub page: ReportData,
    /// All figures of the page, to be saved beside it.
    pub figures: Vec<NamedFigure>,
}

/// 95 % of a two-dimensional normal cloud lie within this many standard deviations: `sqrt(-2 ln 0.05)`.
const ELLIPSE_95: f64 = 2.447_746_83;

struct Builder {
    figures: Vec<NamedFigure>,
}

impl Builder {
    fn item(&mut self, stem: &str, figure: Figure, caption: &str) -> ReportItem {
        self.figures.push(NamedFigure { stem: stem.into(), figure: figure.clone() });
        ReportItem::Figure { figure, caption: caption.into(), stem: stem.into() }
    }

    fn show(&mut self, section: Section, stem: &str, figure: Figure, caption: &str) -> Section {
        section.with(self.item(stem, figure, caption))
    }
}

/// Warns of an image with fewer samples than its render wanted. `labels` is the image, of which only samples count. An error that is small
/// enough is no early end.
#[must_use]
pub fn stopped_early(labels: &ComponentImage, wanted: u32, ended_by_error: bool) -> Option<Warning> {
    let held = labels.samples_per_pixel;
    let text = format!("The render was stopped early: {held} of {wanted} samples per pixel.");
    (held < wanted && !ended_by_error).then(|| text.into())
}

/// Builds the page of a run and its figures.
pub fn run_report(run: &RunResults<'_>) -> RunReport {
    let mut builder = Builder { figures: Vec::new() };
    let words = &Words::of(run.experiment);
    let record = &run.experiment.record;
    let (mut sections, overview) = rayon::join(|| sections(run, &mut builder), || overview(run, words));
    let mut warnings = record.warnings.clone();
    if let Some(analyzed) = &run.evaluation.analysis {
        let of_regions = region_warnings(&analyzed.analysis, &run.evaluation.regions);
        let all = analyzed.analysis.warnings.iter().chain(&of_regions);
        warnings.extend(all.cloned());
    }
    let Study { render, time_limit_s, .. } = &run.experiment.study;
    let ended_by_error = render.error_target.is_some() && time_limit_s.is_none();
    let stopped = |image: &ComponentImage| stopped_early(image, render.samples_per_pixel, ended_by_error);
    warnings.extend(run.components.and_then(stopped));
    let safety = run.evaluation.safety.iter();
    warnings.extend(safety.clone().flat_map(exceeded_limits).map(Warning::from));
    warnings.extend(safety.filter_map(risk_group_warning).map(Warning::from));
    warnings.extend(dark_frames(run.experiment, &run.evaluation.frames).into_iter().map(Warning::from));
    warnings.extend(leaking_frames(&run.evaluation.leaks).into_iter().map(Warning::from));
    let mut page = ReportData {
        title: record.title.clone(),
        overview: Some(overview),
        live: run.live.cloned(),
        lead: words.lead(run),
        headline: Vec::new(),
        warnings,
        sections: Vec::new(),
        provenance: provenance(run),
        experiment_toml: record.resolved_toml.clone(),
        input_files: record.inputs.iter().map(|input| input.path.display().to_string()).collect(),
        rerun_command: match run.frames_from {
            FrameOrigin::Simulated => "fluorspar run report.html".into(),
            FrameOrigin::Given => String::new(),
        },
    };
    page.sections.append(&mut sections);
    let bulk = run.experiment.study.analysis.as_ref().map_or(&[][..], |analysis| &analysis.bulk);
    let bulk: Vec<String> = bulk.iter().map(|(name, _)| title_of(run, name)).collect();
    page.sections.extend(glossary_section(&plain_text(&page), words.wanted().as_ref(), &bulk));
    RunReport { page, figures: builder.figures }
}

/// The sections below the first screen, each folded.
fn sections(run: &RunResults<'_>, builder: &mut Builder) -> Vec<Section> {
    let evaluation = run.evaluation;
    let mut sections: Vec<Section> = regions_section(run).into_iter().collect();
    if !evaluation.frames.is_empty() {
        sections.push(frames_section(run, builder));
    }
    sections.extend(leak_section(run));
    if let Some(analyzed) = &evaluation.analysis {
        sections.push(result_section(run, analyzed, builder));
    }
    if let Some(radiance) = &evaluation.region_radiance {
        sections.push(radiance_section(run, radiance, builder));
    }
    if let Some((section, figure)) = depth_section(run) {
        sections.push(match figure {
            Some(figure) => builder.show(section, "depth", figure, ""),
            None => section,
        });
    }
    if !evaluation.spectra.is_empty() {
        sections.push(spectroradiometer_section(run, builder));
    }
    sections.extend(evaluation.safety.as_ref().and_then(safety_section));
    sections.push(parts_section(run, builder));
    sections.push(assumptions_section(run));
    sections
}

/// Excitation light in the frames: which electrons are signal, and which are excitation light that passed the filters.
fn leak_section(run: &RunResults<'_>) -> Option<Section> {
    let leaks = &run.evaluation.leaks;
    if leaks.is_empty() {
        return None;
    }
    let place = match &run.evaluation.analysis {
        Some(analyzed) => format!("over {}", analyzed.analysis.region_description),
        None => "over the whole frame".into(),
    };
    let title = "How much excitation light leaks through the filter";
    let mut section = Section::new(title).folded(leaks_in_words(leaks)).say(format!(
        "Every electron comes from light that was only reflected or from light that a fluorophore gave off. In a \
         fluorescence frame reflected light is a disturbance, the leak: it adds to every channel, is shaped by gloss and \
         reflectance, and looks like fluorescence that is not there. Means {place}, without noise."
    ));
    section = section.with(ReportItem::Matrix(leak_matrix(leaks)));
    for leak in leaks {
        if let (Some(ratio), false) = (leak.leak_ratio, leak.is_reflectance()) {
            let caption = format!("Frame \"{}\", {:.1} ms", leak.frame, 1e3 * leak.exposure_s);
            let rows = leak_ratio_rows(leak, ratio);
            section = section.with(ReportItem::Table(NumberTable { caption, rows }));
        }
    }
    Some(section)
}

/// The leak of each fluorescence frame.
fn leaks_in_words(leaks: &[FrameLeak]) -> String {
    let words = leaks.iter().filter_map(|leak| match (leak.is_reflectance(), leak.leak_ratio) {
        (false, Some(ratio)) => {
            Some(format!("frame \"{}\": {} % of the fluorescence", leak.frame, percent(ratio)))
        }
        _ => None,
    });
    let words = words.collect::<Vec<_>>().join(", ");
    if words.is_empty() { "every frame is one of reflected light".into() } else { words }
}

/// Electrons of reflected light and of fluorescence in each channel of each frame.
fn leak_matrix(leaks: &[FrameLeak]) -> NumberMatrix {
    let names = leaks.first().map_or(&[][..], |leak| &leak.channels);
    let columns =
        ["Light in the frame".into()].into_iter().chain(names.iter().map(|c| format!("{}, e-", c.name)));
    let row = |leak: &FrameLeak, kind: &str, of: &dyn Fn(&fluorspar::pipeline::ChannelLeak) -> f64| {
        let name = format!("frame \"{}\", {kind}", leak.frame);
        std::iter::once(name).chain(leak.channels.iter().map(|c| electrons(of(c)))).collect::<Vec<String>>()
    };
    let rows = leaks.iter().flat_map(|leak| {
        let kind = if leak.is_reflectance() { "reflected (the signal)" } else { "reflected (the leak)" };
        [row(leak, kind, &|c| c.reflected_e), row(leak, "fluorescence", &|c| c.fluorescent_e)]
    });
    NumberMatrix {
        caption: "Mean electrons per pixel".into(),
        rows: rows.collect(),
        columns: columns.collect(),
        note: String::new(),
    }
}

/// How large the leak is, and what the filter does against it.
fn leak_ratio_rows(leak: &FrameLeak, ratio: f64) -> Vec<Number> {
    let mut rows = Vec::new();
    rows.push(Number::computed(
        "Leak",
        percent(ratio),
        "%",
        "reflected per fluorescence electrons, all channels together; below 1 % it can be forgotten, at 100 % half of \
         the image is excitation light",
    ));
    if let Some(before) = leak.ratio_before {
        rows.push(Number::computed(
            "Reflected over fluorescence, before the filter",
            if before < 10.0 { format!("{before:.2}") } else { format!("{before:.0}") },
            "photons per photon",
            "what the filter has to deal with",
        ));
    }
    let behind = &leak.behind_filters;
    if let Some(density) = behind.reflected_density {
        rows.push(Number::computed(
            "Optical density for the excitation light",
            format!("{density:.2}"),
            "",
            "minus the decimal logarithm of the share of reflected photons that passes the filter: 3 is one in a thousand",
        ));
    }
    rows.push(Number::computed(
        "Fluorescence passed",
        format!("{:.0}", 100.0 * behind.fluorescence_passed),
        "%",
        "share of the fluorescence photons that the filter lets through",
    ));
    if let Some(share) = behind.leak_in_pass_band {
        rows.push(Number::computed(
            "Leak inside the pass band",
            format!("{:.0}", 100.0 * share),
            "%",
            "share of the leaking photons at wavelengths that the filter is meant to pass: the tail of the light source, which only a \
             filter on the light source can remove",
        ));
    }
    rows
}

/// The title of a fluorophore, as the pictures of the matrices have it.
fn title_of(run: &RunResults<'_>, name: &str) -> String {
    let scene = &run.experiment.study.scene;
    let own = scene.fluorophores.iter().find(|f| f.name == name).map(|f| f.title.clone());
    // One that is looked for need not be in the scene
    own.or_else(|| preset::fluorophore(name).ok().map(|preset| preset.title.clone()))
        .unwrap_or_else(|| name.to_owned())
}

/// Electrons with as many digits as tell something.
pub(super) fn electrons(value: f64) -> String {
    if value >= 100.0 {
        format!("{value:.0}")
    } else if value >= 1.0 {
        format!("{value:.1}")
    } else {
        format!("{value:.3}")
    }
}

/// A ratio in per cent, with as many digits as tell something.
pub(super) fn percent(ratio: f64) -> String {
    let value = 100.0 * ratio;
    if (1e-12..0.005).contains(&value) {
        return "below 0.01".into();
    }
    if value >= 1.0 { format!("{value:.1}") } else { format!("{value:.2}") }
}

fn provenance(run: &RunResults<'_>) -> Vec<(String, String)> {
    let ResolvedExperiment { study, record } = run.experiment;
    let scene = &study.scene;
    let mut list = vec![
        ("Fluorspar".into(), env!("CARGO_PKG_VERSION").into()),
        ("Experiment SHA-256".into(), record.sha256.clone()),
        ("Seed".into(), study.render.seed.to_string()),
    ];
    if let Some(components) = run.components {
        let grid = &components.grid;
        let size = format!("{} x {} pixels, {} bands", components.width, components.height, grid.len());
        list.push(("Samples per pixel".into(), components.samples_per_pixel.to_string()));
        list.push(("Image".into(), size));
        list.push(("Bands".into(), format!("{} to {} nm", scene.grid.start_nm(), scene.grid.end_nm())));
        list.push(("Components".into(), components.components.len().to_string()));
    }
    list
}

pub(super) fn percent_saturated(frame: &CapturedFrame) -> f64 {
    let saturated = frame.developed.saturated.iter().filter(|s| **s).count();
    100.0 * saturated as f64 / frame.developed.saturated.len().max(1) as f64
}

/// Exposures and levels of all frames, and their histograms.
fn frames_section(run: &RunResults<'_>, builder: &mut Builder) -> Section {
    let (frames, study) = (&run.evaluation.frames, &run.experiment.study);
    let words = Words::of(run.experiment);
    let clipped = frames.iter().map(|frame| (percent_saturated(frame), &frame.raw.label));
    let worst = clipped.max_by(|a, b| a.0.total_cmp(&b.0));
    let clipped = worst
        .map_or_else(String::new, |(share, label)| format!("; {share:.2} % of frame \"{label}\" clipped"));
    let noun = if frames.len() == 1 { "frame" } else { "frames" };
    let mut section = Section::new("Frames")
        .folded(format!("{} {noun}{clipped}; levels and histograms", frames.len()))
        .with(ReportItem::Matrix(frame_matrix(frames)));
    if !run.described_frames.is_empty() {
        section = section.with(ReportItem::Matrix(told_matrix(run.described_frames)));
    }
    for frame in frames {
        let capture = study.capture(&frame.raw.label);
        let figure = frame_histograms(frame, capture.and_then(|c| c.subtract.as_deref()));
        // A dark frame is to lie at the left
        let is_lit = capture.is_some_and(|c| words.lights(c) != NO_LIGHT);
        let advice = if is_lit && is_far_left(frame) {
            "This frame fills only the far left: a longer exposure or more light would use more of the sensor's range."
        } else {
            ""
        };
        section = builder.show(section, &format!("histogram_{}", frame.raw.label), figure, advice);
    }
    section
}

/// Levels above this share of full scale use the sensor's range.
const FAR_LEFT: f64 = 0.1;

/// Whether hardly any value of a frame, one of a thousand, is above the far left of its histogram.
fn is_far_left(frame: &CapturedFrame) -> bool {
    let developed = &frame.developed;
    let level = FAR_LEFT * developed.full_scale_dn;
    let above = developed.data.iter().filter(|&&value| f64::from(value) > level).count();
    1000 * above <= developed.data.len() && !developed.saturated.contains(&true)
}

/// What frames of a camera are, side by side, as `describe` words it.
fn told_matrix(frames: &[(String, Vec<FrameFact>)]) -> NumberMatrix {
    let mut keys: Vec<&str> = Vec::new();
    let mut remarks: Vec<String> = Vec::new();
    for fact in frames.iter().flat_map(|(_, facts)| facts) {
        if !keys.contains(&fact.key) {
            keys.push(fact.key);
        }
        let remark = format!("{}: {}.", fact.key, fact.remark);
        if !fact.remark.is_empty() && !remarks.contains(&remark) {
            remarks.push(remark);
        }
    }
    let value = |facts: &[FrameFact], key: &str| {
        let fact = facts.iter().find(|fact| fact.key == key);
        fact.map_or_else(String::new, |fact| match fact.value.as_str() {
            "" => fact.source.word().into(),
            value => value.into(),
        })
    };
    let row = |key: &&str| {
        std::iter::once((*key).to_owned()).chain(frames.iter().map(|(_, facts)| value(facts, key))).collect()
    };
    let names = frames.iter().map(|(name, _)| name.clone());
    NumberMatrix {
        caption: "What the given frames are".into(),
        columns: std::iter::once("Value".to_owned()).chain(names).collect(),
        rows: keys.iter().map(row).collect(),
        note: remarks.join(" "),
    }
}

/// Exposure, clipping and the median of each channel of all frames.
fn frame_matrix(frames: &[CapturedFrame]) -> NumberMatrix {
    let channels = frames.first().map_or(&[][..], |frame| &frame.developed.channels);
    let columns = ["Frame", "ms", "gain", "clipped, %"].map(String::from).into_iter();
    let columns = columns.chain(channels.iter().map(|name| format!("{name}, DN")));
    let row = |frame: &CapturedFrame| {
        let developed = &frame.developed;
        let n = developed.channels.len();
        let mut row = vec![
            frame.raw.label.clone(),
            format!("{:.3}", frame.raw.exposure_s * 1e3),
            format!("{}", frame.raw.gain),
            format!("{:.2}", percent_saturated(frame)),
        ];
        row.extend((0..n).map(|c| {
            let values = developed.data.iter().skip(c).step_by(n).map(|&v| f64::from(v));
            let at_least = if percent_saturated(frame) >= 50.0 { "at least " } else { "" };
            median(values).map_or_else(String::new, |median| format!("{at_least}{median:.1}"))
        }));
        row
    };
    let full = frames.first().map_or(0.0, |frame| frame.developed.full_scale_dn);
    NumberMatrix {
        caption: "Exposures, and medians over the whole frame".into(),
        columns: columns.collect(),
        rows: frames.iter().map(row).collect(),
        note: format!("Black level subtracted; full scale is {full:.0} DN."),
    }
}

fn frame_histograms(frame: &CapturedFrame, subtracted: Option<&str>) -> Figure {
    let developed = &frame.developed;
    let n = developed.channels.len();
    let values = |c: usize| developed.data.iter().copied().skip(c).step_by(n).collect();
    let channels: Vec<ChannelValues> = developed
        .channels
        .iter()
        .enumerate()
        .map(|(c, name)| ChannelValues { name: name.clone(), values: values(c) })
        .collect();
    histograms(&frame.raw.label, &channels, developed.full_scale_dn, subtracted)
}

/// The blocks by which the share of a region was estimated.
pub(super) fn blocks_of(analysis: &Analysis) -> Option<&BlockShares> {
    analysis.posterior.as_ref().filter(|posterior| !posterior.is_no_estimate())?.blocks.as_ref()
}

fn result_section(run: &RunResults<'_>, analyzed: &AnalyzedFrame, builder: &mut Builder) -> Section {
    let analysis = &analyzed.analysis;
    let mut figures = Vec::new();
    if !analyzed.chromaticity.chromaticity.is_empty() {
        let plot = chromaticity_plot(run, analyzed);
        let note = match analysis.mixture {
            Some(_) => "The sensor's noise spreads pixels about the line.",
            None => "The sensor's noise spreads pixels of one color.",
        };
        figures.push(builder.item("chromaticity", plot, note));
    }
    let by_blocks = blocks_of(analysis).and_then(|shares| share_map_of_blocks(shares, &analysis.analyte));
    let on_line = || analyzed.porphyrin.as_ref().and_then(|map| share_map(map, &analysis.analyte));
    if let Some(figure) = by_blocks.or_else(on_line) {
        figures.push(builder.item("share_map", figure, ""));
    }
    let region = &analysis.region_description;
    let note = match (&analysis.r, &analysis.g) {
        (Some(r), Some(g)) => {
            format!("{region}: r {:.3}, g {:.3}; {} pixels", r.mean, g.mean, analysis.counts.valid)
        }
        _ => format!("{region}; {} pixels", analysis.counts.valid),
    };
    analysis_section(analysis, figures, run.frames_from).folded(note)
}

/// Pixels of the region, fluorophores and their line by sensor chromaticity.
fn chromaticity_plot(run: &RunResults<'_>, analyzed: &AnalyzedFrame) -> Figure {
    let analysis = &analyzed.analysis;
    let points = analyzed.region.pixels.iter().filter_map(|&pixel| analyzed.chromaticity.at(pixel)).collect();
    chromaticity(&ChromaticityPlot {
        region: analysis.region_description.clone(),
        pixels: points,
        fluorophores: analysis
            .fluorophores
            .iter()
            .filter_map(|f| f.chromaticity.map(|point| (title_of(run, &f.name), point)))
            .collect(),
        target: analysis.analyte.clone(),
        mixture_line: analysis.mixture.as_ref().map(|m| [m.bulk, m.porphyrin]),
        ellipse: analysis.ellipse.map(|e| e.outline(ELLIPSE_95, 90)).unwrap_or_default(),
        people: analysis.posterior.as_ref().map_or_else(Vec::new, |posterior| posterior.people.clone()),
        people_hold_pigment: analysis.posterior.as_ref().is_some_and(|posterior| posterior.red.is_some()),
    })
}

fn radiance_section(run: &RunResults<'_>, radiance: &RegionRadiance, builder: &mut Builder) -> Section {
    let curve =
        |name: &str, values: &[f64]| PlotCurve::new(name, radiance.wavelength_nm.clone(), values.to_vec());
    let glow: Vec<PlotCurve> =
        radiance.fluorescence.iter().map(|(name, v)| curve(&title_of(run, name), v)).collect();
    let region =
        run.evaluation.analysis.as_ref().map_or_else(String::new, |a| a.analysis.region_description.clone());
    let (reflected, total) = (curve("reflected", &radiance.reflected), curve("sum", &radiance.total));
    let strongest = glow.iter().max_by(|a, b| sum(&a.value).total_cmp(&sum(&b.value)));
    let note = strongest.map_or_else(
        || "reflected light only".into(),
        |curve| format!("most of the fluorescence comes from {}", curve.name),
    );
    let mut section = Section::new("The light of the region, by origin").folded(note).say(format!(
        "Mean spectral radiance of {region} ({} pixels of the render), before filter and lens. It is the quantity that a \
         spectroradiometer would measure there.",
        radiance.pixels
    ));
    // Of a region with one fluorophore there is nothing of the kind
    let elsewhere = if glow.len() > 1 {
        " Light of a fluorophore that the region does not hold, if there is any, was given off elsewhere and reflected here."
    } else {
        ""
    };
    section = builder.show(
        section,
        "radiance_log",
        radiance_by_component(Some(&total), Some(&reflected), &glow, &region, Scale::Log10),
        &format!("Logarithmic: where reflected light of the lights exceeds fluorescence, the filters must keep it away.{elsewhere}"),
    );
    builder.show(
        section,
        "radiance_linear",
        radiance_by_component(None, None, &glow, &region, Scale::Linear),
        "Fluorescence alone, linear.",
    )
}

fn sum(values: &[f64]) -> f64 {
    values.iter().sum()
}

fn spectroradiometer_section(run: &RunResults<'_>, builder: &mut Builder) -> Section {
    let readings = run.evaluation.spectra.len();
    let note = if readings == 1 { "one reading".into() } else { format!("{readings} readings") };
    let mut section = Section::new("What a spectroradiometer reads").folded(note).say(
        "Spectral radiance from the place of the camera, behind the instrument's filter, through its slit, with its stray \
         light and noise.",
    );
    for (index, spectrum) in run.evaluation.spectra.iter().enumerate() {
        let reading = &spectrum.reading;
        let curve =
            |name: &str, values: &[f64]| PlotCurve::new(name, reading.wavelength_nm.clone(), values.to_vec());
        let curves = [curve("expected", &reading.expected), curve("reading", &reading.reading)];
        let title = format!("{}, with the lights of \"{}\"", spectrum.name, spectrum.capture);
        let figure = spectral_readings(title, &curves);
        let caption = format!(
            "{}. Noise of the reading: {:.1e} W/(sr m² nm).",
            spectrum.target, reading.standard_deviation
        );
        section = builder.show(section, &format!("spectroradiometer_{}", index + 1), figure, &caption);
    }
    section
}

/// A curve on every nanometer of the rendered range.
fn fine(name: &str, curve: &Curve, range: (f64, f64)) -> PlotCurve {
    let steps = (range.1 - range.0).round() as usize;
    let nm: Vec<f64> =
        (0..=steps).map(|i| range.0 + i as f64 * (range.1 - range.0) / steps.max(1) as f64).collect();
    let values = nm.iter().map(|&x| curve.at(x)).collect();
    PlotCurve::new(name, nm, values)
}

fn parts_section(run: &RunResults<'_>, builder: &mut Builder) -> Section {
    let study = &run.experiment.study;
    let scene = &study.scene;
    let range = (scene.grid.start_nm(), scene.grid.end_nm());
    let light_curves = light_curves(scene, range);
    let count =
        |count: usize, one: &str| if count == 1 { format!("1 {one}") } else { format!("{count} {one}s") };
    let note = format!(
        "spectra of {} and {}, filter, quantum efficiency, camera",
        count(light_curves.len(), "light"),
        count(scene.fluorophores.len(), "fluorophore")
    );
    let mut section = Section::new("Lights, filters, fluorophores and sensor").folded(note);
    let views = ViewFilters::of(study);
    // Beside filters none is no line at 1
    let any = views.iter().any(|view| view.is_filtered);
    let (drawn, open): (Vec<&ViewFilters>, Vec<&ViewFilters>) =
        views.iter().partition(|view| view.is_filtered || !any);
    let view_curves: Vec<PlotCurve> =
        drawn.iter().map(|view| fine(&view.name(), &view.transmittance, range)).collect();
    if !light_curves.is_empty() {
        section = builder.show(
            section,
            "lights",
            lights(&light_curves, &view_curves),
            "Each light source behind its own filters, relative to its maximum. Where a light source and the viewing filter overlap, its light leaks.",
        );
    }
    let open: Vec<String> = open.iter().map(|view| format!("Without a filter: {}.", view.frames)).collect();
    section = builder.show(section, "view_filter", filters(&view_curves), &open.concat());
    if !scene.fluorophores.is_empty() {
        section = fluorophore_figures(run, builder, section, range);
    }
    if let Some(sensor) = &study.camera.sensor {
        let figure = sensor_figure(&study.camera, &views, sensor.qe(), range);
        section = builder.show(section, "sensor", figure, "");
    }
    section.with(ReportItem::Table(NumberTable { caption: "Camera".into(), rows: camera_rows(run) }))
}

/// Quantum efficiency alone, and behind lens and filters: those of each frame of a wheel.
fn sensor_figure(camera: &Camera, views: &[ViewFilters], qe: &SpectralQe, range: (f64, f64)) -> Figure {
    let curves = |qe: &SpectralQe| -> Vec<PlotCurve> {
        qe.channels().iter().map(|c| fine(&c.name, &c.curve, range)).collect()
    };
    let behind = |view: &ViewFilters| {
        let lens = &camera.lens.as_ref()?.equation.transmittance;
        let name = if view.frames.is_empty() { "filtered" } else { &view.frames };
        Some((name.to_owned(), curves(&qe.behind(&lens.times(&view.transmittance)))))
    };
    let filtered: Vec<(String, Vec<PlotCurve>)> = views.iter().filter_map(behind).collect();
    sensor_response(&curves(qe), &filtered)
}

/// Spectrum of the first light of each group, relative to its maximum.
fn light_curves(scene: &Scene, range: (f64, f64)) -> Vec<PlotCurve> {
    let mut curves: Vec<PlotCurve> = Vec::new();
    for light in &scene.lights {
        let group = &scene.light_groups[light.group].name;
        let name = format!("light \"{group}\"");
        if !curves.iter().any(|l| l.name == name) {
            let peak = light.spectrum.max().max(f64::MIN_POSITIVE);
            curves.push(fine(&name, &light.spectrum.scaled(1.0 / peak), range));
        }
    }
    curves
}

/// Matrices of the fluorophores, and what they emit under the light of the analyzed frame.
fn fluorophore_figures(
    run: &RunResults<'_>,
    builder: &mut Builder,
    section: Section,
    range: (f64, f64),
) -> Section {
    let study = &run.experiment.study;
    let scene = &study.scene;
    let frame = study.analysis.as_ref().map(|a| a.frame.as_str());
    let light = scene.lights.iter().find(|light| {
        let group = &scene.light_groups[light.group].name;
        let capture = study.captures.iter().find(|c| Some(c.frame.label.as_str()) == frame);
        capture.is_some_and(|c| c.frame.drive(group) > 0.0)
    });
    let peak = light.map(|l| l.spectrum.peak_nm());
    let nominal = light.zip(peak).and_then(|(light, peak_nm)| {
        let group = &scene.light_groups[light.group].name;
        nominal_wavelength(run.experiment.record.experiment.as_deref()?, group, peak_nm)
    });
    let maps: Vec<EemMap> = scene.fluorophores.iter().map(|f| eem_map(f, range)).collect();
    let section = builder.show(section, "eem", eem_maps(&maps, peak), &nominal.unwrap_or_default());
    let Some(light) = light else { return section };
    let photons = Curve::from_fn(range.0, range.1, |nm| light.spectrum.at(nm) * nm);
    let total = photons.total().max(f64::MIN_POSITIVE);
    let curves: Vec<PlotCurve> = scene
        .fluorophores
        .iter()
        .map(|f| fine(&f.title, &f.eem.photon_exitance(&photons.scaled(1.0 / total), range), range))
        .collect();
    let figure = emission(
        &curves,
        &format!("the light \"{}\"", scene.light_groups[light.group].name),
        "each at concentration 1",
        ["emitted photons", "1/nm per photon"],
        view_band(&view_filter_of(study, frame), range),
    );
    builder.show(section, "emission", figure, "")
}

/// A matrix as a picture: excitation up to 550 nm.
fn eem_map(fluorophore: &Fluorophore, range: (f64, f64)) -> EemMap {
    EemMap::of(fluorophore, [range.0, 550.0_f64.min(range.1)], [range.0, range.1], [80, 90])
}

/// The section of a light group in an experiment, its spectrum a name of the catalogue.
fn catalogue_spectrum<'a>(file: &'a ExperimentFile, group: &str) -> Option<&'a str> {
    let light = file.light.iter().find(|light| light.group.as_deref() == Some(group))?;
    let SpectrumReference::Text(name) = &light.spectrum else { return None };
    Some(name.as_str()).filter(|name| preset::names(PresetKind::Light).contains(name))
}

/// Peaks that are this far from what the LED is sold as are pointed out, nm.
const NOMINAL_TOLERANCE_NM: f64 = 1.0;

/// Why the peak of an LED is not where its name says; nothing where it is.
fn nominal_wavelength(file: &ExperimentFile, group: &str, peak_nm: f64) -> Option<String> {
    let name = catalogue_spectrum(file, group)?;
    let nominal_nm: f64 = name.strip_prefix("led_")?.parse().ok()?;
    let source = preset::light_spectrum(name).ok()?.source;
    ((nominal_nm - peak_nm).abs() > NOMINAL_TOLERANCE_NM).then(|| {
        format!(
            "An LED is sold by the class of its wavelength: this one, {name}, as {nominal_nm:.0} nm, while the spectrum used here \
             peaks at {peak_nm:.0} nm. {source}"
        )
    })
}

fn camera_rows(run: &RunResults<'_>) -> Vec<Number> {
    let camera = &run.experiment.study.camera;
    let mut rows = Vec::new();
    if let Some(Lens { equation: lens, .. }) = &camera.lens {
        let size = "size of the image over that of the object";
        rows.extend([
            Number::computed("Focal length", lens.focal_length_mm.to_string(), "mm", "of the ideal lens")
                .from(stated()),
            Number::computed("f-number", lens.f_number.to_string(), "", "focal length over aperture")
                .from(stated()),
            Number::computed("Magnification", format!("{:.4}", lens.magnification().abs()), "", size),
        ]);
    }
    if let Some(sensor) = &camera.sensor {
        rows.extend(sensor_rows(sensor.model(), run.frames_from));
    }
    rows
}

/// A value of the experiment or of one of its presets, which say where it comes from.
fn stated() -> Origin {
    Origin::Stated("in the experiment below, or the preset that it names".into())
}

/// Rows of the sensor: published where a value is that of Table 1 of the paper, else as the experiment states it. A recorded frame comes
/// from another sensor than the paper's, whatever the numbers are.
fn sensor_rows(m: &SensorModel, from: FrameOrigin) -> Vec<Number> {
    let published = SensorModel::default();
    let table = |is_published: bool| match (is_published, from) {
        (true, FrameOrigin::Simulated) => Origin::Published("Table 1 of Lyu et al. 2021".into()),
        (false, FrameOrigin::Simulated) => stated(),
        (_, FrameOrigin::Given) => Origin::Assumed("by the experiment; a frame does not tell it".into()),
    };
    let of_size = match from {
        FrameOrigin::Simulated => stated(),
        FrameOrigin::Given => Origin::Computed,
    };
    let noise = match m.read_noise_mv {
        Some(mv) => format!("noise of a dark pixel, rms: {mv} mV over the conversion gain"),
        None => "noise of a dark pixel, rms".into(),
    };
    let of_noise = match table(m.read_noise_electrons() == published.read_noise_electrons()) {
        // Millivolts are stated; electrons follow from them and the conversion gain
        Origin::Stated(_) if m.read_noise_mv.is_some() => Origin::Computed,
        origin => origin,
    };
    let of_pitch = table(m.pixel_size_um == published.pixel_size_um);
    let of_well = table(m.well_capacity_e == published.well_capacity_e);
    let of_prnu = table(m.prnu_percent == published.prnu_percent);
    let size = format!("{} x {}", m.columns, m.rows);
    let row = |name, value: String, unit, meaning: &str, origin| {
        Number::computed(name, value, unit, meaning).from(origin)
    };
    vec![
        row("Pixels", size, "pixels", "columns and rows of the sensor", of_size),
        row("Pixel pitch", m.pixel_size_um.to_string(), "µm", "side of one pixel", of_pitch),
        row("Full well", format!("{:.0}", m.well_capacity_e), "e-", "electrons that a pixel holds", of_well),
        row("Read noise", format!("{:.1}", m.read_noise_electrons()), "e-", &noise, of_noise),
        row("PRNU", m.prnu_percent.to_string(), "%", "spread of sensitivity from pixel to pixel", of_prnu),
    ]
}

fn assumptions_section(run: &RunResults<'_>) -> Section {
    let scene = &run.experiment.study.scene;
    let terms: Vec<(String, String)> = scene
        .fluorophores
        .iter()
        .map(|f| {
            let text = format!(
                "{}. Excitation backed by data from {:.0} to {:.0} nm, emission from {:.0} to {:.0} nm.",
                f.source.trim_end().trim_end_matches('.'),
                f.excitation_range_nm.0,
                f.excitation_range_nm.1,
                f.emission_range_nm.0,
                f.emission_range_nm.1
            );
            (f.title.clone(), text)
        })
        .collect();
    let dark = |components: &ComponentImage| -> Vec<String> {
        let all = components.components.iter().enumerate();
        all.filter_map(|(index, component)| match &component.light {
            LightPath::Fluorescence(name) if components.stored(index).iter().all(|&v| v == 0.0) => {
                Some(title_of(run, name))
            }
            _ => None,
        })
        .collect()
    };
    let silent = run.components.map(dark).unwrap_or_default();
    let note = match scene.fluorophores.len() {
        0 => "no fluorophores".into(),
        1 => "source and range of one fluorophore".into(),
        n => format!("sources and ranges of {n} fluorophores"),
    };
    let mut section = Section::new("Where the numbers come from").folded(note);
    let description = &run.experiment.record.description;
    if !description.is_empty() {
        section = section.say(description.clone());
    }
    section = section.say(
        "Spectra of the catalogue are models: published measurements described by a few numbers each. What is assumed is \
         marked so in the files of the catalogue and can be changed in the experiment.",
    );
    let file = run.experiment.record.experiment.as_deref();
    if let Some(blocking) = file.and_then(assumed_blocking) {
        section = section.say(blocking);
    }
    if !silent.is_empty() {
        let mut names = silent;
        names.dedup();
        section = section.say(format!(
            "Fluorophores that gave no light at all under some light source: {}.",
            names.join(", ")
        ));
    }
    section.with(ReportItem::Terms(terms))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn word(rows: &[Number], name: &str) -> &'static str {
        match rows.iter().find(|row| row.name == name).unwrap().origin {
            Origin::Published(_) => "published",
            Origin::Assumed(_) => "assumed",
            Origin::Stated(_) => "stated",
            _ => "other",
        }
    }

    fn of_catalogue(name: &str) -> SensorModel {
        let text = format!("format = 1\n[sensor]\npreset = \"{name}\"\n");
        let sensor =
            fluorspar_experiment::parse_sensor(&text, "test", std::path::Path::new("."), &[]).unwrap();
        sensor.sensor.model().clone()
    }

    #[test]
    fn only_values_of_the_paper_are_marked_as_published() {
        const NAMES: [&str; 4] = ["Pixel pitch", "Full well", "Read noise", "PRNU"];
        let paper = of_catalogue("lyu_2021_table_1");
        let rows = sensor_rows(&paper, FrameOrigin::Simulated);
        for name in NAMES {
            assert_eq!(word(&rows, name), "published", "{name}");
        }
        // A frame of another camera is not that of the paper.
        for name in NAMES {
            assert_eq!(word(&sensor_rows(&paper, FrameOrigin::Given), name), "assumed", "{name}");
        }
        // The paper does not say how many pixels there are.
        assert_eq!(word(&rows, "Pixels"), "stated");
        // One value changed: its mark goes, the others stay.
        let change: [fn(&mut SensorModel); 4] = [
            |m| m.pixel_size_um += 0.5,
            |m| m.well_capacity_e *= 1.001,
            |m| m.read_noise_mv = m.read_noise_mv.map(|mv| 1.1 * mv),
            |m| m.prnu_percent = 0.0,
        ];
        for (index, change) in change.into_iter().enumerate() {
            let mut model = paper.clone();
            change(&mut model);
            let rows = sensor_rows(&model, FrameOrigin::Simulated);
            for (other, name) in NAMES.into_iter().enumerate() {
                // Its millivolts are stated, its electrons follow from them and the well
                let is_read_noise = name == "Read noise";
                let own = if is_read_noise { "other" } else { "stated" };
                let is_changed = other == index || is_read_noise && index == 1;
                let expected = if is_changed { own } else { "published" };
                assert_eq!(word(&rows, name), expected, "{name} after change {index}");
            }
        }
        // Another sensor of the catalogue.
        let other = sensor_rows(&of_catalogue("pi_camera_3"), FrameOrigin::Simulated);
        for name in NAMES {
            assert_eq!(word(&other, name), "stated", "{name}");
        }
    }

    #[test]
    fn an_led_that_peaks_beside_its_name_is_explained() {
        let file = |spectrum: &str| -> ExperimentFile {
            let light = format!(
                "[[light]]\nname = \"a\"\ngroup = \"blue\"\ntype = \"point\"\nstrength.power_mw = 1.0\nspectrum = \"{spectrum}\"\n"
            );
            fluorspar_format::read_toml(&format!("format = 1\n{light}")).unwrap()
        };
        let said = nominal_wavelength(&file("led_385"), "blue", 381.7).unwrap();
        assert!(said.contains("as 385 nm") && said.contains("382 nm") && said.contains("measure"), "{said}");
        for (spectrum, group, peak_nm) in [
            ("led_385", "blue", 385.4),
            ("led_385", "white", 381.7),
            ("white_led", "blue", 450.0),
            ("led_385.csv", "blue", 381.7),
        ] {
            assert_eq!(nominal_wavelength(&file(spectrum), group, peak_nm), None, "{spectrum}");
        }
    }
}
