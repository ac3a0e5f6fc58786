//! Report of a run.

use fluorspar::analysis::Statistics;
use fluorspar::image::LightPath;
use fluorspar::pipeline::{AnalyzedFrame, CapturedFrame, FrameLeak, Preview, RegionRadiance};
use fluorspar::scene::Scene;
use fluorspar::sensor::{SensorModel, SpectralQe};
use fluorspar::spectral::{Curve, Fluorophore};
use fluorspar::study::{Camera, Capture, Lens};
use fluorspar_experiment::ResolvedExperiment;
use fluorspar_experiment::preset::{self, PresetKind};

use super::RunResults;
use super::depth_section::depth_section;
use super::safety_section::safety_section;
use crate::figures::{
    ChannelValues, ChromaticityPlot, EemMap, PlotCurve, chromaticity, eem_maps, emission, filters,
    histograms, lights, picture, porphyrin_maps, radiance_by_component, sensor_response, spectral_readings,
};
use crate::{
    Figure, Number, NumberTable, Origin, Raster, ReportData, ReportItem, ReportPicture, Scale, Section,
    analysis_section, glossary_section,
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
        ReportItem::Figure { figure, caption: caption.into() }
    }

    fn show(&mut self, section: Section, stem: &str, figure: Figure, caption: &str) -> Section {
        section.with(self.item(stem, figure, caption))
    }
}

/// Builds the page of a run and its figures.
pub fn run_report(run: &RunResults<'_>) -> RunReport {
    let mut builder = Builder { figures: Vec::new() };
    let (study, record, evaluation) = (&run.experiment.study, &run.experiment.record, run.evaluation);
    let frame_of_interest = study.analysis.as_ref().map(|a| a.frame.as_str());
    let leak = evaluation.analyzed_leak().and_then(|leak| leak.leak_ratio);

    let mut sections = vec![camera_section(run, &mut builder)];
    sections.extend(leak_section(run));
    if let Some(analyzed) = &run.evaluation.analysis {
        sections.push(result_section(run, analyzed, &mut builder));
    }
    if let Some(radiance) = &evaluation.region_radiance {
        sections.push(radiance_section(run, radiance, leak, &mut builder));
    }
    if let Some((section, figure)) = depth_section(run) {
        sections.push(match figure {
            Some(figure) => builder.show(section, "depth", figure, ""),
            None => section,
        });
    }
    if !run.evaluation.spectra.is_empty() {
        sections.push(spectroradiometer_section(run, &mut builder));
    }
    sections.extend(evaluation.safety.as_ref().and_then(safety_section));
    sections.push(parts_section(run, &mut builder));
    sections.push(assumptions_section(run));
    sections.push(glossary_section());

    let mut warnings: Vec<String> = record.warnings.iter().map(ToString::to_string).collect();
    if let Some(analyzed) = &run.evaluation.analysis {
        warnings.extend(analyzed.analysis.warnings.iter().cloned());
    }
    if run.components.samples_per_pixel < study.render.samples_per_pixel {
        warnings.push(format!(
            "The render was stopped early: {} of {} samples per pixel.",
            run.components.samples_per_pixel, study.render.samples_per_pixel
        ));
    }
    let page = ReportData {
        title: record.title.clone(),
        lead: lead(run, frame_of_interest),
        headline: headline(run, leak),
        warnings,
        sections,
        provenance: provenance(run),
        experiment_toml: record.resolved_toml.clone(),
        rerun_command: "fluorspar run report.html".into(),
    };
    RunReport { page, figures: builder.figures }
}

fn lead(run: &RunResults<'_>, frame: Option<&str>) -> Vec<String> {
    let mut lead = Vec::new();
    if !run.experiment.record.description.is_empty() {
        lead.push(run.experiment.record.description.clone());
    }
    lead.push(
        "Everything on this page was computed: a three-dimensional scene with lights of known power was rendered as \
         spectra, every kind of light kept apart; a lens and filters formed an image of it; a sensor model with its \
         noise recorded it; and the recorded numbers were analyzed as those of a real camera would be."
            .into(),
    );
    if frame.is_some() {
        lead.push(
            "Under violet light, tissue glows faintly. Most of the glow is broad and green-blue and comes from several \
             molecules at once (the bulk: elastin, collagen, FAD, keratin). Porphyrins, made by bacteria on the tongue, \
             glow red. The ratio of the color channels tells the two apart, whatever the brightness."
                .into(),
        );
    }
    lead
}

/// Excitation light in the frames: which electrons are signal, and which are excitation light that passed the filters.
fn leak_section(run: &RunResults<'_>) -> Option<Section> {
    if run.evaluation.leaks.is_empty() {
        return None;
    }
    let place = match &run.evaluation.analysis {
        Some(analyzed) => format!("over {}", analyzed.analysis.region_description),
        None => "over the whole frame".into(),
    };
    let mut section = Section::new("How much excitation light leaks through the filter").say(format!(
        "Every electron comes from light that was only reflected or from light that a fluorophore gave off. In a \
         fluorescence frame reflected light is a disturbance, the leak: it adds to every channel, is shaped by gloss and \
         reflectance, and looks like fluorescence that is not there. Means {place}, without noise."
    ));
    for leak in &run.evaluation.leaks {
        let mut rows = channel_leak_rows(leak);
        if let (Some(ratio), false) = (leak.leak_ratio, leak.is_reflectance()) {
            rows.extend(leak_ratio_rows(leak, ratio));
        }
        let caption = format!("Frame \"{}\", {:.1} ms", leak.frame, 1e3 * leak.exposure_s);
        section = section.with(ReportItem::Table(NumberTable { caption, rows }));
    }
    Some(section)
}

/// Electrons of reflected light and of fluorescence in each channel.
fn channel_leak_rows(leak: &FrameLeak) -> Vec<Number> {
    let kind = if leak.is_reflectance() {
        "reflected light, here the signal"
    } else {
        "reflected excitation light: the leak"
    };
    let mut rows = Vec::new();
    for channel in &leak.channels {
        let name = &channel.name;
        rows.push(Number::computed(
            format!("{name}: reflected"),
            electrons(channel.reflected_e),
            "e- per pixel",
            kind,
        ));
        rows.push(Number::computed(
            format!("{name}: fluorescence"),
            electrons(channel.fluorescent_e),
            "e- per pixel",
            "electrons of light that a fluorophore gave off",
        ));
    }
    rows
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
            format!("{before:.0}"),
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
    scene.fluorophores.iter().find(|f| f.name == name).map_or_else(|| name.to_owned(), |f| f.title.clone())
}

/// Electrons with as many digits as tell something.
fn electrons(value: f64) -> String {
    if value >= 100.0 {
        format!("{value:.0}")
    } else if value >= 1.0 {
        format!("{value:.1}")
    } else {
        format!("{value:.3}")
    }
}

/// A ratio in per cent, with as many digits as tell something.
fn percent(ratio: f64) -> String {
    let value = 100.0 * ratio;
    if value >= 1.0 { format!("{value:.1}") } else { format!("{value:.2}") }
}

fn headline(run: &RunResults<'_>, leak: Option<f64>) -> Vec<Number> {
    let mut numbers = Vec::new();
    if let Some(analyzed) = &run.evaluation.analysis {
        let analysis = &analyzed.analysis;
        if let Some(posterior) = &analysis.posterior {
            let [low, high] = posterior.interval;
            numbers.push(Number::computed(
                "Porphyrin share of the light",
                format!("{:.3} ({low:.3} to {high:.3})", posterior.median),
                "",
                format!(
                    "median and 95 % interval with everything that is not known of the tissue ({}); no porphyrin: {:.0} % probable",
                    posterior.prior,
                    100.0 * posterior.probability_of_none
                ),
            ));
        }
        // Amounts in layered tissue are factors on what it holds: their ratio tells nothing.
        if let (Some(region), None) = (analysis.mixture.as_ref().and_then(|m| m.region), &analysis.posterior)
        {
            let e = &region.estimate;
            numbers.push(Number::computed(
                "Porphyrin fraction on the mixture line",
                format!("{:.3}", e.fraction),
                "",
                format!(
                    "porphyrin over porphyrin and bulk, from the mean color, if the bulk were known; sensor noise alone leaves {:.4} to {:.4} open",
                    e.fraction_interval[0], e.fraction_interval[1]
                ),
            ));
        }
        if let Some(truth) = &analysis.truth {
            numbers.push(Number::computed(
                "True porphyrin share",
                format!("{:.3}", truth.share),
                "",
                "electrons of porphyrin light over those of all fluorescence of the region, as the simulation knows them",
            ));
        }
        if let (Some(r), Some(g)) = (&analysis.r, &analysis.g) {
            numbers.push(Number::computed(
                "Sensor chromaticity",
                format!("{:.3}, {:.3}", r.median, g.median),
                "r, g",
                "median of R/(R+G+B) and G/(R+G+B) over the region",
            ));
        }
        if let Some(frame) = run.evaluation.frames.iter().find(|f| f.raw.label == analysis.frame) {
            let green = analysis.channels.iter().find(|c| c.name == "G").and_then(|c| c.statistics.as_ref());
            if let Some(green) = green {
                numbers.push(Number::computed(
                    "Signal in green",
                    format!("{:.0}", green.median / frame.raw.dn_per_electron),
                    "e-",
                    "median electrons per pixel over the region: the light budget of the design",
                ));
            }
        }
    }
    if let Some(leak) = leak {
        numbers.push(Number::computed(
            "Filter leak",
            percent(leak),
            "%",
            "electrons of reflected excitation light per electron of fluorescence in the region; 1 % can be forgotten, 100 % can't be used",
        ));
    }
    numbers
}

fn provenance(run: &RunResults<'_>) -> Vec<(String, String)> {
    let ResolvedExperiment { study, record } = run.experiment;
    let scene = &study.scene;
    vec![
        ("Fluorspar".into(), env!("CARGO_PKG_VERSION").into()),
        ("Experiment SHA-256".into(), record.sha256.clone()),
        ("Seed".into(), study.render.seed.to_string()),
        ("Samples per pixel".into(), run.components.samples_per_pixel.to_string()),
        (
            "Image".into(),
            format!("{} x {} pixels, {} bands", scene.camera.width, scene.camera.height, scene.grid.len()),
        ),
        ("Bands".into(), format!("{} to {} nm", scene.grid.start_nm(), scene.grid.end_nm())),
        ("Components".into(), run.components.components.len().to_string()),
    ]
}

fn percent_saturated(frame: &CapturedFrame) -> f64 {
    let saturated = frame.developed.saturated.iter().filter(|s| **s).count();
    100.0 * saturated as f64 / frame.developed.saturated.len().max(1) as f64
}

fn camera_section(run: &RunResults<'_>, builder: &mut Builder) -> Section {
    let evaluation = run.evaluation;
    let study = &run.experiment.study;
    let shown = evaluation.frames.iter().zip(&evaluation.previews).zip(&study.captures);
    let pictures = shown
        .filter_map(|((frame, preview), capture)| frame_picture(&study.scene, frame, preview, capture))
        .collect();
    let rows = evaluation.frames.iter().flat_map(frame_rows).collect();
    let mut section = Section::new("What the camera sees")
        .say(
            "One picture per exposure, each under its own lights. The white frame shows the mouth as the eye would see it. \
             In the fluorescence frame the excitation light is blocked by the filter: what is left is the glow of teeth \
             (brightest) and tissue, red where porphyrins are.",
        )
        .with(ReportItem::Pictures(pictures))
        .with(ReportItem::Table(NumberTable { caption: "Frames".into(), rows }));
    for frame in &evaluation.frames {
        let capture = study.captures.iter().find(|c| c.frame.label == frame.raw.label);
        let figure = frame_histograms(frame, capture.and_then(|c| c.subtract.as_deref()));
        let stem = format!("histogram_{}", frame.raw.label);
        // The frame that is analyzed is shown; the others are saved only.
        if study.analysis.as_ref().is_some_and(|a| a.frame == frame.raw.label) {
            section = builder.show(section, &stem, figure, "");
        } else {
            builder.figures.push(NamedFigure { stem, figure });
        }
    }
    section
}

/// Preview of a frame with what it shows; none if it can't be drawn.
fn frame_picture(
    scene: &Scene,
    frame: &CapturedFrame,
    preview: &Preview,
    capture: &Capture,
) -> Option<ReportPicture> {
    let png = Raster::from_rgb8(preview.width, preview.height, &preview.rgb)?.to_png()?;
    let raw = &frame.raw;
    let what = if scene.light_groups.iter().any(|group| capture.frame.drive(&group.name) > 0.0) {
        "Developed for the eye and scaled to its own brightest parts."
    } else {
        "No light is on: the colored specks are nothing but the noise of the sensor, a few digital numbers, stretched \
         until they can be seen."
    };
    let caption = format!(
        "{:.1} ms, gain {}; {:.2} % of pixels saturated. {what}",
        raw.exposure_s * 1e3,
        raw.gain,
        percent_saturated(frame)
    );
    Some(ReportPicture { png, title: format!("Frame \"{}\"", raw.label), caption })
}

/// Exposure of a frame and the median of each channel.
fn frame_rows(frame: &CapturedFrame) -> Vec<Number> {
    let label = &frame.raw.label;
    let n = frame.developed.channels.len();
    let mut rows = vec![Number::computed(
        format!("{label}: exposure"),
        format!("{:.3}", frame.raw.exposure_s * 1e3),
        "ms",
        "time during which light was collected",
    )];
    for (c, name) in frame.developed.channels.iter().enumerate() {
        let values = frame.developed.data.iter().skip(c).step_by(n).map(|&v| f64::from(v));
        if let Some(s) = Statistics::of(values) {
            rows.push(Number::computed(
                format!("{label}: median {name}"),
                format!("{:.1}", s.median),
                "DN",
                format!(
                    "over the whole frame, black level subtracted; full scale is {:.0} DN",
                    frame.developed.full_scale_dn
                ),
            ));
        }
    }
    rows
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

fn result_section(run: &RunResults<'_>, analyzed: &AnalyzedFrame, builder: &mut Builder) -> Section {
    let analysis = &analyzed.analysis;
    let points = analyzed.region.pixels.iter().filter_map(|&pixel| analyzed.chromaticity.at(pixel)).collect();
    let plot = chromaticity(&ChromaticityPlot {
        region: analysis.region_description.clone(),
        pixels: points,
        fluorophores: analysis
            .fluorophores
            .iter()
            .filter_map(|f| f.chromaticity.map(|point| (title_of(run, &f.name), point)))
            .collect(),
        mixture_line: analysis.mixture.as_ref().map(|m| [m.bulk, m.porphyrin]),
        ellipse: analysis.ellipse.map(|e| e.outline(ELLIPSE_95, 90)).unwrap_or_default(),
    });
    let mut figures =
        vec![builder.item("chromaticity", plot, "The sensor's noise spreads pixels about the line.")];
    let frame = run
        .evaluation
        .frames
        .iter()
        .zip(&run.evaluation.previews)
        .find(|(f, _)| f.raw.label == analysis.frame);
    if let (Some(porphyrin), Some((frame, preview))) = (&analyzed.porphyrin, frame) {
        let gray: Vec<u8> = preview.rgb.chunks_exact(3).map(|p| p[1].max(p[0])).collect();
        let fits = gray.len() == frame.developed.width * frame.developed.height;
        for (stem, figure) in porphyrin_maps(porphyrin, fits.then_some(gray.as_slice())) {
            figures.push(builder.item(stem, figure, ""));
        }
        if let (Some([col, row, w, h]), Some(raster)) = (
            run.experiment.study.analysis.as_ref().and_then(|a| a.rectangle_px),
            Raster::from_rgb8(preview.width, preview.height, &preview.rgb),
        ) {
            let rectangle = [col, row, w, h].map(f64::from);
            figures.push(builder.item("region", picture("Region of interest", raster, Some(rectangle)), ""));
        }
    }
    analysis_section(analysis, figures)
}

fn radiance_section(
    run: &RunResults<'_>,
    radiance: &RegionRadiance,
    leak: Option<f64>,
    builder: &mut Builder,
) -> Section {
    let curve =
        |name: &str, values: &[f64]| PlotCurve::new(name, radiance.wavelength_nm.clone(), values.to_vec());
    let glow: Vec<PlotCurve> =
        radiance.fluorescence.iter().map(|(name, v)| curve(&title_of(run, name), v)).collect();
    let region =
        run.evaluation.analysis.as_ref().map_or_else(String::new, |a| a.analysis.region_description.clone());
    let (reflected, total) = (curve("reflected", &radiance.reflected), curve("sum", &radiance.total));
    let mut section = Section::new("The light that leaves the tissue").say(format!(
        "Mean spectral radiance of {region} ({} pixels of the render), before filter and lens. It is the quantity that a \
         spectroradiometer would measure there.",
        radiance.pixels
    ));
    if let Some(leak) = leak {
        section = section.say(format!(
            "Through lens, filter and sensor, reflected excitation light makes {} % of the fluorescence signal of this region.",
            percent(leak)
        ));
    }
    section = builder.show(
        section,
        "radiance_log",
        radiance_by_component(Some(&total), Some(&reflected), &glow, &region, Scale::Log10),
        "Logarithmic: reflected excitation light exceeds fluorescence by orders of magnitude, which is why the filters decide the \
         design. A fluorophore that this tissue does not hold glows elsewhere, as dentin and enamel do in the teeth; its light \
         is reflected here.",
    );
    builder.show(
        section,
        "radiance_linear",
        radiance_by_component(None, None, &glow, &region, Scale::Linear),
        "Fluorescence alone, linear.",
    )
}

fn spectroradiometer_section(run: &RunResults<'_>, builder: &mut Builder) -> Section {
    let mut section = Section::new("What a spectroradiometer reads").say(
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
    let mut section = Section::new("Lights, filters, tissue and sensor");

    let light_curves = light_curves(scene, range);
    let view = fine("in front of the lens", &study.camera.view_filter.transmittance, range);
    if !light_curves.is_empty() {
        section = builder.show(
            section,
            "lights",
            lights(&light_curves, std::slice::from_ref(&view)),
            "Each light source behind its own filters, relative to its maximum. Where a light source and the viewing filter overlap, its light leaks.",
        );
    }
    section = builder.show(section, "view_filter", filters(std::slice::from_ref(&view)), "");
    if !scene.fluorophores.is_empty() {
        section = fluorophore_figures(run, builder, section, range);
    }
    if let Some(sensor) = &study.camera.sensor {
        let figure = sensor_figure(&study.camera, sensor.qe(), range);
        section = builder.show(section, "sensor", figure, "");
    }
    section.with(ReportItem::Table(NumberTable { caption: "Camera".into(), rows: camera_rows(run) }))
}

/// Quantum efficiency alone, and behind lens and filters.
fn sensor_figure(camera: &Camera, qe: &SpectralQe, range: (f64, f64)) -> Figure {
    let curves = |qe: &SpectralQe| -> Vec<PlotCurve> {
        qe.channels().iter().map(|c| fine(&c.name, &c.curve, range)).collect()
    };
    let lens = camera.lens_behind_filters();
    let filtered = lens.map_or_else(Vec::new, |lens| curves(&qe.behind(&lens.transmittance)));
    sensor_response(&curves(qe), &filtered)
}

/// Spectrum of the first light of each group, relative to its maximum.
fn light_curves(scene: &Scene, range: (f64, f64)) -> Vec<PlotCurve> {
    let mut curves: Vec<PlotCurve> = Vec::new();
    for light in &scene.lights {
        let group = &scene.light_groups[light.group].name;
        if !curves.iter().any(|l| l.name == *group) {
            let peak = light.spectrum.max().max(f64::MIN_POSITIVE);
            curves.push(fine(group, &light.spectrum.scaled(1.0 / peak), range));
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
        nominal_wavelength(&run.experiment.record.resolved_toml, group, peak_nm)
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
        ["emitted photons", "per nm and photon that arrives"],
        view_band(&study.camera.view_filter.transmittance, range),
    );
    builder.show(section, "emission", figure, "")
}

/// A matrix as a picture: excitation up to 550 nm.
fn eem_map(fluorophore: &Fluorophore, range: (f64, f64)) -> EemMap {
    EemMap::of(fluorophore, [range.0, 550.0_f64.min(range.1)], [range.0, range.1], [80, 90])
}

/// The section of a light group in an experiment, its spectrum a name of the catalogue.
fn catalogue_spectrum(experiment_toml: &str, group: &str) -> Option<String> {
    let table: toml::Table = experiment_toml.parse().ok()?;
    let text = |light: &toml::Value, key: &str| light.get(key).and_then(|v| v.as_str()).map(String::from);
    let lights = table.get("light")?.as_array()?;
    let light = lights.iter().find(|light| text(light, "group").as_deref() == Some(group))?;
    text(light, "spectrum").filter(|name| preset::names(PresetKind::Light).contains(&name.as_str()))
}

/// Peaks that are this far from what the LED is sold as are pointed out, nm.
const NOMINAL_TOLERANCE_NM: f64 = 1.0;

/// Why the peak of an LED is not where its name says; nothing where it is.
fn nominal_wavelength(experiment_toml: &str, group: &str, peak_nm: f64) -> Option<String> {
    let name = catalogue_spectrum(experiment_toml, group)?;
    let nominal_nm: f64 = name.strip_prefix("led_")?.parse().ok()?;
    let source = preset::light_spectrum(&name).ok()?.source;
    ((nominal_nm - peak_nm).abs() > NOMINAL_TOLERANCE_NM).then(|| {
        format!(
            "An LED is sold by the class of its wavelength: this one, {name}, as {nominal_nm:.0} nm, while the spectrum used here \
             peaks at {peak_nm:.0} nm. {source}"
        )
    })
}

/// Where a filter passes at least half of its maximum.
fn view_band(filter: &Curve, range: (f64, f64)) -> Option<[f64; 2]> {
    let nodes: Vec<f64> = (0..=(range.1 - range.0) as usize).map(|i| range.0 + i as f64).collect();
    let peak = nodes.iter().map(|&nm| filter.at(nm)).fold(0.0, f64::max);
    let passed: Vec<f64> = nodes.into_iter().filter(|&nm| filter.at(nm) >= 0.5 * peak).collect();
    let (first, last) = (*passed.first()?, *passed.last()?);
    (last - first < range.1 - range.0 - 2.0).then_some([first, last])
}

fn camera_rows(run: &RunResults<'_>) -> Vec<Number> {
    let camera = &run.experiment.study.camera;
    let mut rows = Vec::new();
    let assumed = || Origin::Assumed("see the experiment below: its comments say what is published".into());
    if let Some(Lens { equation: lens, .. }) = &camera.lens {
        rows.push(
            Number::computed("Focal length", format!("{}", lens.focal_length_mm), "mm", "of the ideal lens")
                .from(assumed()),
        );
        rows.push(
            Number::computed("f-number", format!("{}", lens.f_number), "", "focal length over aperture")
                .from(assumed()),
        );
        rows.push(Number::computed(
            "Magnification",
            format!("{:.4}", lens.magnification().abs()),
            "",
            "size of the image over that of the object",
        ));
    }
    if let Some(sensor) = &camera.sensor {
        rows.extend(sensor_rows(sensor.model()));
    }
    rows
}

/// Rows of the sensor: published where a value is that of Table 1 of the paper, assumed where it is not.
fn sensor_rows(m: &SensorModel) -> Vec<Number> {
    let assumed = || Origin::Assumed("see the experiment below: its comments say what is published".into());
    let mut rows = Vec::new();
    let published = SensorModel::default();
    let table = |is_published: bool| match is_published {
        true => Origin::Published("Table 1 of Lyu et al. 2021".into()),
        false => assumed(),
    };
    rows.push(
        Number::computed(
            "Pixels",
            format!("{} x {}", m.columns, m.rows),
            "pixels",
            "columns and rows of the sensor",
        )
        .from(assumed()),
    );
    rows.push(
        Number::computed("Pixel pitch", format!("{}", m.pixel_size_um), "µm", "side of one pixel")
            .from(table(m.pixel_size_um == published.pixel_size_um)),
    );
    rows.push(
        Number::computed(
            "Full well",
            format!("{:.0}", m.well_capacity_e),
            "e-",
            "electrons that a pixel holds",
        )
        .from(table(m.well_capacity_e == published.well_capacity_e)),
    );
    rows.push(
        Number::computed(
            "Read noise",
            format!("{:.1}", m.read_noise_electrons()),
            "e-",
            "noise of a dark pixel, rms",
        )
        .from(table(m.read_noise_electrons() == published.read_noise_electrons())),
    );
    rows.push(
        Number::computed(
            "PRNU",
            format!("{}", m.prnu_percent),
            "%",
            "spread of sensitivity from pixel to pixel",
        )
        .from(table(m.prnu_percent == published.prnu_percent)),
    );
    rows
}

fn assumptions_section(run: &RunResults<'_>) -> Section {
    let scene = &run.experiment.study.scene;
    let terms: Vec<(String, String)> = scene
        .fluorophores
        .iter()
        .map(|f| {
            let text = format!(
                "{} Excitation backed by data from {:.0} to {:.0} nm, emission from {:.0} to {:.0} nm.",
                f.source,
                f.excitation_range_nm.0,
                f.excitation_range_nm.1,
                f.emission_range_nm.0,
                f.emission_range_nm.1
            );
            (f.title.clone(), text)
        })
        .collect();
    let silent: Vec<&str> = run
        .components
        .components
        .iter()
        .enumerate()
        .filter_map(|(index, component)| match &component.light {
            LightPath::Fluorescence(name) if run.components.component(index).iter().all(|&v| v == 0.0) => {
                Some(name.as_str())
            }
            _ => None,
        })
        .collect();
    let mut section = Section::new("Where the numbers come from").say(
        "Spectra of fluorophores, lights, filters and tissue are models: published measurements described by a few \
         numbers each. Absolute fluorescence yields are set to the level measured on tongues, lips and teeth; \
         concentrations are relative to that. What nobody has published for this camera (power of the light sources, lens, quantum \
         efficiency) is assumed, marked so in the experiment file, and can be changed there.",
    );
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
        let rows = sensor_rows(&paper);
        for name in NAMES {
            assert_eq!(word(&rows, name), "published", "{name}");
        }
        // The paper does not say how many pixels there are.
        assert_eq!(word(&rows, "Pixels"), "assumed");
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
            let rows = sensor_rows(&model);
            for (other, name) in NAMES.into_iter().enumerate() {
                let expected = if other == index { "assumed" } else { "published" };
                assert_eq!(word(&rows, name), expected, "{name} after change {index}");
            }
        }
        // Another sensor of the catalogue.
        let other = sensor_rows(&of_catalogue("pi_camera_3"));
        for name in NAMES {
            assert_eq!(word(&other, name), "assumed", "{name}");
        }
    }

    #[test]
    fn an_led_that_peaks_beside_its_name_is_explained() {
        let toml = |spectrum: &str| {
            format!("[[light]]\nname = \"a\"\ngroup = \"blue\"\nspectrum = \"{spectrum}\"\n")
        };
        let said = nominal_wavelength(&toml("led_385"), "blue", 381.7).unwrap();
        assert!(said.contains("as 385 nm") && said.contains("382 nm") && said.contains("measure"), "{said}");
        for (spectrum, group, peak_nm) in [
            ("led_385", "blue", 385.4),
            ("led_385", "white", 381.7),
            ("white_led", "blue", 450.0),
            ("led_385.csv", "blue", 381.7),
        ] {
            assert_eq!(nominal_wavelength(&toml(spectrum), group, peak_nm), None, "{spectrum}");
        }
    }
}
