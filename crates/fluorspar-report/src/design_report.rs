//! The page of a design search: what is best, what it costs, what it rests on, and what it can't tell apart.

use fluorspar::analysis::DETECTION_Z;
use fluorspar::design::{
    Criterion, Design, DesignSpace, FilteredFluorescence, FineBands, Merits, Score, Sensitivity, WorstCase,
};
use fluorspar::pipeline::DesignEstimate;
use fluorspar::units::digits_text;

use crate::design_recommendation::{analyte_share, limit_in_words, recommendation, recommended};
use crate::design_remarks::{best_case, ideal_edges};
use crate::figures::PlotCurve;
use crate::{
    Axis, ColorBar, ColorMap, Dash, Figure, Ink, Label, Number, NumberTable, Panel, Raster, ReportData,
    ReportItem, Section, Series, SeriesShape,
};

/// A design with its figures of merit.
#[derive(Clone, Debug, PartialEq)]
pub struct JudgedDesign {
    /// Name.
    pub name: String,
    /// The design.
    pub design: Design,
    /// Its figures of merit.
    pub merits: Merits,
    /// What its viewing filter does to the fluorescence; `None` where nothing that fluoresces is seen.
    pub fluorescence: Option<FilteredFluorescence>,
    /// What an analysis of its frames would say of the porphyrin; `None` where that is not asked for, or the region is not tissue of the mouth.
    pub estimate: Option<DesignEstimate>,
}

/// What a search found.
#[derive(Clone, Copy, Debug)]
pub struct DesignFindings<'a> {
    /// Title of the problem.
    pub title: &'a str,
    /// Its description; may be empty.
    pub description: &'a str,
    /// What designs are ranked by, in words.
    pub criterion: &'a str,
    /// How designs were chosen, in words.
    pub search: &'a str,
    /// The action of `fluorspar design` that chose them.
    pub action: &'a str,
    /// All designs.
    pub space: &'a DesignSpace,
    /// Those that were evaluated, by number.
    pub scores: &'a [(u64, Score)],
    /// Why some of them have no loss, in words; empty where all have one.
    pub left_out: &'a str,
    /// The best, in order.
    pub best: &'a [JudgedDesign],
    /// Those that no other dominates.
    pub front: &'a [JudgedDesign],
    /// Designs to compare with.
    pub compared: &'a [JudgedDesign],
    /// What a quarter more of each assumed number does.
    pub sensitivities: &'a [Sensitivity],
    /// The first of the best within tolerances.
    pub worst_cases: &'a [WorstCase],
    /// The resolved file.
    pub design_toml: &'a str,
    /// Its digest.
    pub sha256: &'a str,
}

/// Designs told in the table of the best.
const SHOWN: usize = 20;
/// Sensitivities told.
const MOST_SENSITIVITIES: usize = 15;
/// Side of a simulated patch, pixels.
const PATCH_PX: usize = 40;
/// Seed of the noise of simulated patches.
const PATCH_SEED: u64 = 1;

/// The figures of the page by the stems of their files: spectra of the recommended design, simulated captures, loss of all designs, lights.
/// None where no design is feasible.
pub fn design_figures(found: &DesignFindings<'_>) -> Vec<(&'static str, Figure)> {
    let Some((_, recommended)) = recommended(found) else { return Vec::new() };
    vec![
        ("spectra", spectra_figure(found.space, recommended)),
        ("captures", captures_figure(found.space, &shown(found, recommended).take(2).collect::<Vec<_>>())),
        ("designs", front_figure(found)),
        ("lights", lights_figure(found)),
    ]
}

/// The page of a design search.
pub fn design_report(found: &DesignFindings<'_>) -> ReportData {
    let mut sections = Vec::new();
    if let Some((_, recommended)) = recommended(found) {
        let all: Vec<&JudgedDesign> = shown(found, recommended).collect();
        let pair = &all[..all.len().min(2)];
        let titled = |title: &str, section: Section| Section { title: title.into(), ..section };
        sections.push(titled("The recommended design", spectra_section(found.space, &all)));
        let title = "Captures of the recommended design and of another";
        sections.push(titled(title, captures_section(found.space, pair)));
        sections.push(blind_section(found.space, &all));
        sections.push(choices_section(found));
        sections.push(assumptions_section(found));
    }
    ReportData {
        title: found.title.into(),
        overview: None,
        live: None,
        lead: lead(found),
        headline: headline(found),
        warnings: Vec::new(),
        sections,
        provenance: vec![
            ("designs".into(), format!("{}, {} evaluated", found.space.len(), found.scores.len())),
            ("search".into(), found.search.into()),
            ("sha256".into(), found.sha256.into()),
            ("version".into(), env!("CARGO_PKG_VERSION").into()),
        ],
        experiment_toml: found.design_toml.into(),
        input_files: Vec::new(),
        rerun_command: format!("fluorspar design {} report.html", found.action),
    }
}

/// A design and those to compare it with.
fn shown<'a>(
    found: &DesignFindings<'a>,
    judged: &'a JudgedDesign,
) -> impl Iterator<Item = &'a JudgedDesign> + use<'a> {
    std::iter::once(judged).chain(found.compared)
}

/// What a page says of a design, and of others beside it: figures of merit, bounds and spectra, simulated captures, what is least told apart.
pub fn design_sections(space: &DesignSpace, designs: &[&JudgedDesign]) -> Vec<Section> {
    let merits = designs.iter().map(|judged| {
        ReportItem::Table(NumberTable { caption: judged.name.clone(), rows: merit_numbers(judged) })
    });
    let merits = merits.fold(Section::new("In short"), Section::with);
    vec![
        merits,
        spectra_section(space, designs),
        captures_section(space, designs),
        blind_section(space, designs),
    ]
}

fn lead(found: &DesignFindings<'_>) -> Vec<String> {
    let mut lead = Vec::new();
    if !found.description.is_empty() {
        lead.push(found.description.to_owned());
    }
    lead.push(format!("Designs are ranked by {}; less is better.", found.criterion));
    lead.extend(recommendation(found));
    lead.extend(best_case(found.space.problem()));
    for compared in found.compared {
        let region = &compared.merits.regions[0];
        if region.rank < region.weights.len() {
            lead.push(format!(
                "{} leaves the Fisher matrix singular: it sees {} independent combinations of {} weights.",
                compared.name,
                region.rank,
                region.weights.len()
            ));
        }
    }
    lead
}

/// Four digits.
pub(crate) fn digits(value: f64) -> String {
    if value.is_finite() { digits_text(value, 4) } else { "not seen".into() }
}

fn headline(found: &DesignFindings<'_>) -> Vec<Number> {
    let Some((place, recommended)) = recommended(found) else { return Vec::new() };
    let value = match found.space.problem().criterion {
        Criterion::Contrast(k) => {
            recommended.merits.regions.first().and_then(|region| *region.contrast_values.get(k)?)
        }
        _ => None,
    };
    let of_value =
        value.map_or_else(String::new, |value| yardstick(value, recommended.merits.loss, recommended));
    let meaning = format!("of {}, {}{of_value}", recommended.name, found.criterion);
    let mut numbers = vec![Number::computed("loss", digits(recommended.merits.loss), "", meaning)];
    if let Some(worst) = found.worst_cases.get(place) {
        let meaning = "the same at the worst end of all tolerances, after calibration";
        numbers.push(Number::computed("within tolerances", digits(worst.loss), "", meaning));
    }
    if let Some(best) = found.best.first().filter(|_| place > 0) {
        let meaning = format!("loss of {}, the best as meant", best.name);
        numbers.push(Number::computed("least loss as meant", digits(best.merits.loss), "", meaning));
    }
    numbers.extend(further_numbers(recommended));
    numbers
}

/// All figures of merit of a design.
fn merit_numbers(judged: &JudgedDesign) -> Vec<Number> {
    let merits = &judged.merits;
    let broken = match &merits.broken[..] {
        [] => "what designs are ranked by; less is better".into(),
        broken => format!("breaks the limit of {}", broken.join(" and ")),
    };
    let number = |name: &str, value, meaning: &str| Number::computed(name, digits(value), "", meaning);
    let mut numbers = vec![Number::computed("loss", digits(merits.loss), "", broken)];
    numbers.extend(further_numbers(judged));
    let meaning = "of fluorescence: the sum over the channels, one pixel each";
    numbers.push(number("electrons", merits.fluorescence_e, meaning));
    numbers.push(number(
        "saturation",
        merits.saturation,
        "electrons of the brightest pixel over what it holds",
    ));
    numbers.extend((merits.cost != 0.0).then(|| number("price", merits.cost, "")));
    numbers
}

/// The figures of merit of a design beside its loss that decide.
fn further_numbers(judged: &JudgedDesign) -> Vec<Number> {
    let mut numbers = Vec::new();
    let merits = &judged.merits;
    numbers.extend(judged.estimate.iter().map(|estimate| {
        let share = estimate.visible.in_patches.map_or_else(|| "none".into(), |share| digits(100.0 * share));
        let meaning =
            "told from none, in patches over a tenth of the region: by the estimate that analyzes frames";
        Number::computed("smallest porphyrin share seen", share, "%", meaning)
    }));
    numbers.push(Number::computed("time", digits(merits.time_s * 1e3), "ms", "of all exposures"));
    numbers.push(Number::computed(
        "leak",
        digits(100.0 * merits.leak),
        "%",
        "reflected electrons over those of fluorescence, at most",
    ));
    numbers.extend(judged.fluorescence.iter().map(|fluorescence| {
        let meaning = "of the electrons of fluorescence pass the viewing filter";
        Number::computed("fluorescence kept", digits(100.0 * fluorescence.kept), "%", meaning)
    }));
    for (name, margin, meaning) in [
        ("tissue margin", merits.tissue_margin, "limit over exposure of the tissue, all exposures together"),
        (
            "eye margin",
            merits.eye_margin,
            "limit over exposure of an eye that looks into the lights, all exposures together",
        ),
    ] {
        numbers.extend(margin.map(|margin| Number::computed(name, digits(margin), "", meaning)));
    }
    numbers
}

/// Bounds of a design by region, as a table.
fn bounds(space: &DesignSpace, judged: &JudgedDesign) -> Vec<ReportItem> {
    let p = space.problem();
    let table = |(region, merits): (&fluorspar::design::RegionModel, &fluorspar::design::RegionMerits)| {
        let response = &region.response;
        let weights = response.fluorescence.iter().zip(&merits.weights).map(|(part, sd)| {
            let meaning = "bound on the relative standard deviation of its weight, all that is unknown included, the gain too";
            Number::computed(&part.name, digits(*sd), "", meaning)
        });
        let values = merits.contrasts.iter().zip(&merits.contrast_values);
        let contrasts = p.contrasts.iter().zip(values).map(|(contrast, (sd, value))| {
            let yardstick = value.map_or_else(String::new, |value| yardstick(value, *sd, judged));
            let meaning =
                format!("bound on the standard deviation{yardstick}; {}", contrast.part.join(" + "));
            Number::computed(&contrast.name, digits(*sd), "", meaning)
        });
        let caption = format!("{}: {}", judged.name, response.name);
        ReportItem::Table(NumberTable { caption, rows: weights.chain(contrasts).collect() })
    };
    p.regions_of(judged.design.geometry).zip(&judged.merits.regions).map(table).collect()
}

/// What the standard deviation of a contrast is to be judged by: the contrast itself, and the change that can be detected with errors of 5 %
/// either way (Currie 1968).
fn yardstick(value: f64, sd: f64, judged: &JudgedDesign) -> String {
    // The estimate knows the limit, people included
    if !sd.is_finite() || judged.estimate.is_some() {
        return format!(" of a value of {}", digits(value));
    }
    let told = DETECTION_Z * sd;
    let verdict = if value.abs() < told { ", so that the value itself can't be told from zero" } else { "" };
    format!(" of a value of {}; a change of {} can be detected{verdict}", digits(value), digits(told))
}

/// Bounds of designs, and the spectra of the first.
fn spectra_section(space: &DesignSpace, designs: &[&JudgedDesign]) -> Section {
    let bounds = designs.iter().flat_map(|judged| bounds(space, judged));
    let section = bounds.fold(Section::new("Bounds and spectra"), Section::with);
    let caption = "Lights, filters and channels are relative to their own peaks; the fluorophores under a light to the highest of \
                   them. Where a channel sees two fluorophores at once, only their ratio between channels and lights tells them apart.";
    designs
        .iter()
        .take(1)
        .fold(section, |section, judged| section.show(spectra_figure(space, judged), caption))
}

/// Lights, filters, channels and fluorescence of a design.
fn spectra_figure(space: &DesignSpace, judged: &JudgedDesign) -> Figure {
    let (p, design) = (space.problem(), &judged.design);
    let Some(region) = p.regions_of(design.geometry).next() else { return Figure::grid("", Vec::new(), 1) };
    let response = &region.response;
    let bands = FineBands::of(&response.grid);
    let limits =
        [p.lights[design.lights[0]].peak_nm.min(response.grid.start_nm()) - 30.0, response.grid.end_nm()];
    let axis = || Axis::linear("relative", "", [0.0, 1.05]);
    let line = |curve: &PlotCurve, ink, dash| {
        let top = curve.value.iter().copied().fold(1e-300, f64::max);
        let points = curve.wavelength_nm.iter().zip(&curve.value).map(|(nm, v)| [*nm, v / top]).collect();
        Series::dashed(curve.name.clone(), ink, points, dash)
    };
    let mut optics =
        Panel::new(Axis::wavelength(limits), axis()).sized(620.0, 230.0).titled("lights, filters, channels");
    // One legend stands for all panels: a color or a stroke pattern of its own for each curve
    let inks = Ink::of_fluorophores(response.fluorescence.iter().map(|f| f.name.as_str()));
    let light_inks = Ink::besides(&inks, design.lights.len());
    for (&light, &ink) in design.lights.iter().zip(&light_inks) {
        let choice = &p.lights[light];
        let spectrum = &choice.spectrum;
        let curve =
            PlotCurve::new(&choice.name, spectrum.wavelengths_nm().to_vec(), spectrum.values().to_vec());
        optics = optics.with(line(&curve, ink, Dash::Solid));
        let filter = p.filters[design.filter].transmittance(choice.peak_nm);
        let nm: Vec<f64> =
            (0..=400).map(|s| limits[0] + (limits[1] - limits[0]) * f64::from(s) / 400.0).collect();
        let value = nm.iter().map(|&nm| filter.at(nm)).collect();
        let curve = PlotCurve::new(format!("filter with {}", choice.name), nm, value);
        optics = optics.with(line(&curve, ink, Dash::Dashed));
    }
    let camera = &p.cameras[design.camera];
    for (c, (name, value)) in camera.channels.iter().zip(camera.relative_sensitivity()).enumerate() {
        let curve = PlotCurve::new(format!("channel {name}"), bands.fine.centers_nm(), value);
        optics = optics.with(line(&curve, Ink::of_channel(name, c), Dash::DashDotted));
    }
    let mut panels = vec![optics];
    for &light in &design.lights {
        let title = format!("fluorescence under {}", p.lights[light].name);
        let spectra = response.fluorescence_under(&p.lights[light].spectrum);
        let top = spectra.iter().flatten().copied().fold(1e-300, f64::max);
        let mut panel = Panel::new(Axis::wavelength(limits), axis()).sized(620.0, 200.0).titled(title);
        for ((part, spectrum), ink) in response.fluorescence.iter().zip(&spectra).zip(&inks) {
            let points =
                response.grid.centers_nm().iter().zip(spectrum).map(|(nm, v)| [*nm, v / top]).collect();
            panel = panel.with(Series::dashed(part.name.clone(), *ink, points, ink.fluorophore_dash()));
        }
        panels.push(panel);
    }
    Figure::grid(format!("Spectra of {}", judged.name), panels, 1).explained(
        "Above: lights, the filters in front of the sensor and the sensitivity of its channels, each relative to its own peak. Below: \
         what each fluorophore of the first region emits under a light, relative to the highest of them.",
    )
}

fn captures_section(space: &DesignSpace, designs: &[&JudgedDesign]) -> Section {
    let caption = "Noise of photons and of the readout only.";
    Section::new("Simulated captures").show(captures_figure(space, designs), caption)
}

fn captures_figure(space: &DesignSpace, designs: &[&JudgedDesign]) -> Figure {
    let mut panels = Vec::new();
    for judged in designs {
        for (region, model) in space.problem().regions_of(judged.design.geometry).enumerate() {
            let raster = patches(space, &judged.design, region);
            let title = format!("{}: {}", judged.name, model.response.name);
            panels.push(patch_panel(space, &judged.design, raster).titled(title));
        }
    }
    // Below each other: beside each other nine channels would be wider than a page
    Figure::grid("Simulated captures", panels, 1).explained(
        "Each square is a patch of the region as one channel records it, with the noise of single pixels: a row for each exposure, \
         a column for each channel. Gray follows the electrons to the power of 0.45; white is 1.3 times the brightest mean of that design.",
    )
}

/// Patches, the axes named by exposures and channels.
fn patch_panel(space: &DesignSpace, design: &Design, raster: Raster) -> Panel {
    const CELL: f64 = 90.0;
    let p = space.problem();
    let channels = &p.cameras[design.camera].channels;
    let lights = design.lights.iter().map(|&k| p.lights[k].name.clone());
    let exposures = lights.chain(p.white.as_ref().map(|_| "white".to_owned()));
    let (x, y) = (Axis::named("channel", channels.iter().cloned()), Axis::named("", exposures));
    let [width, height] = [&x, &y].map(|axis| CELL * (axis.limits[1] - axis.limits[0]).abs());
    // Names of rows stand from the top down
    let picture = SeriesShape::Picture { x: x.limits, y: [y.limits[1], y.limits[0]], raster };
    Panel::new(x, y.downward()).sized(width, height).with(Series::unnamed(Ink::Text, picture))
}

/// Noisy patches, a row for each exposure, a column for each channel.
fn patches(space: &DesignSpace, design: &Design, region: usize) -> Raster {
    let pixels = space.sample_electrons(design, region, PATCH_PX * PATCH_PX, PATCH_SEED);
    let mean = |patch: &Vec<f64>| patch.iter().sum::<f64>() / patch.len().max(1) as f64;
    let top = pixels.iter().flatten().map(mean).fold(1e-9, f64::max);
    let columns = pixels.iter().map(Vec::len).max().unwrap_or(1).max(1);
    let cell = PATCH_PX + 2;
    Raster::from_fn(columns * cell, pixels.len().max(1) * cell, |row, col| {
        let patch = pixels.get(row / cell).and_then(|channels| channels.get(col / cell));
        let (y, x) = (row % cell, col % cell);
        match patch {
            Some(patch) if y < PATCH_PX && x < PATCH_PX => {
                let gray = (255.0 * (patch[y * PATCH_PX + x] / (1.3 * top)).clamp(0.0, 1.0).powf(0.45)) as u8;
                [gray; 3]
            }
            _ => [90, 90, 110],
        }
    })
}

fn blind_section(space: &DesignSpace, designs: &[&JudgedDesign]) -> Section {
    let mut section = Section::new("What is least told apart").say(
        "Each line is a joint change of the weights that changes the data least. A plus and a minus mean that one can stand for \
         the other.",
    );
    for judged in designs {
        for (region, merits) in space.problem().regions_of(judged.design.geometry).zip(&judged.merits.regions)
        {
            let response = &region.response;
            let singular = response.fluorescence.len() - merits.rank;
            for blind in merits.bound.weakest_directions(singular.max(1)) {
                let mut parts: Vec<(f64, &str)> = blind
                    .changes
                    .iter()
                    .copied()
                    .zip(response.fluorescence.iter().map(|f| f.name.as_str()))
                    .collect();
                parts.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
                let kept = parts.iter().filter(|(change, _)| change.abs() > 0.1);
                let words: Vec<String> = kept.map(|(change, name)| format!("{change:+.2} {name}")).collect();
                let error = blind.standard_deviation.map_or_else(
                    || "nothing bounds it".to_owned(),
                    |sd| format!("standard deviation {}", digits(sd)),
                );
                section = section.say(format!(
                    "{}, {}: {} ({error})",
                    judged.name,
                    response.name,
                    words.join(", ")
                ));
            }
        }
    }
    section
}

fn choices_section(found: &DesignFindings<'_>) -> Section {
    let is_priced = found.scores.iter().any(|(_, score)| score.cost != 0.0);
    let row = |judged: &JudgedDesign, worst: Option<&WorstCase>| {
        let merits = &judged.merits;
        let mut meaning = vec![
            format!("{} electrons of fluorescence", digits(merits.fluorescence_e)),
            format!("{} ms", digits(merits.time_s * 1e3)),
            format!("leak {} %", digits(100.0 * merits.leak)),
            judged.fluorescence.as_ref().map_or_else(String::new, |fluorescence| {
                format!("{} % of the fluorescence kept by the filter", digits(100.0 * fluorescence.kept))
            }),
            analyte_share(found, judged).map_or_else(String::new, |(names, share)| {
                format!("{} % of it {names}", digits(100.0 * share))
            }),
            format!("saturation {}", digits(merits.saturation)),
            merits
                .tissue_margin
                .map_or_else(String::new, |margin| format!("tissue margin {}", digits(margin))),
            if is_priced { format!("price {}", digits(merits.cost)) } else { String::new() },
        ];
        // Where designs are ranked by leak, what that costs in the contrasts
        let contrasts = found.space.problem().contrasts.iter().zip(&merits.regions[0].contrasts);
        meaning.extend(
            contrasts
                .filter(|_| found.space.problem().criterion == Criterion::Leak)
                .map(|(contrast, sd)| format!("standard deviation of {} {}", contrast.name, digits(*sd))),
        );
        meaning.extend(worst.map(|worst| {
            let broken = match &worst.broken[..] {
                [] => String::new(),
                broken => format!(", where it breaks the limit of {}", broken.join(", ")),
            };
            format!("loss within tolerances {}{broken}", digits(worst.loss))
        }));
        meaning.retain(|words| !words.is_empty());
        Number::computed(&judged.name, digits(merits.loss), "", meaning.join(", "))
    };
    let rows = found.best.iter().take(SHOWN).enumerate();
    let best = NumberTable {
        caption: "The best designs, by loss; electrons are the sum over the channels, one pixel each".into(),
        rows: rows.map(|(place, judged)| row(judged, found.worst_cases.get(place))).collect(),
    };
    let front = NumberTable {
        caption: "No design is better than these in loss, time, price and number of exposures at once".into(),
        rows: found.front.iter().take(SHOWN).map(|judged| row(judged, None)).collect(),
    };
    Section::new("All designs")
        .show(front_figure(found), "")
        .show(lights_figure(found), "")
        .with(ReportItem::Table(best))
        .with(ReportItem::Table(front))
}

/// Label of an axis of numbers of exposures.
const EXPOSURES: &str = "exposures";

/// What designs are drawn against.
struct Across {
    label: &'static str,
    unit: &'static str,
    of: Box<dyn Fn(&Score) -> f64>,
    /// What that is, in words.
    words: &'static str,
    /// Whether it is the place by loss.
    is_place: bool,
}

impl Across {
    /// Price, time, or the number of exposures, whichever varies most; the place by loss where none does.
    fn of(seen: &[&Score]) -> Self {
        type Objective = fn(&Score) -> f64;
        let objectives: [(&str, &str, Objective); 3] = [
            ("price", "", |s| s.cost),
            ("time", "ms", |s| s.time_s * 1e3),
            (EXPOSURES, "", |s| s.exposures as f64),
        ];
        let distinct = |pick: Objective| {
            let mut values: Vec<u64> =
                seen.iter().take(5000).map(|s| (pick(s) * 1e6).round() as u64).collect();
            values.sort_unstable();
            values.dedup();
            values.len()
        };
        let counts = objectives.map(|(_, _, pick)| distinct(pick));
        let chosen = (0..3).fold(2, |best, k| if counts[k] > counts[best] { k } else { best });
        if counts[chosen] > 1 {
            let (label, unit, pick) = objectives[chosen];
            let words = "Of price, time and number of exposures the one that varies most is drawn.";
            return Self { label, unit, of: Box::new(pick), words, is_place: false };
        }
        let mut losses: Vec<f64> = seen.iter().map(|s| s.loss).collect();
        losses.sort_by(f64::total_cmp);
        let place = move |s: &Score| 1.0 + losses.partition_point(|loss| *loss < s.loss) as f64;
        let words = "All cost the same, in the same time and as many exposures, so they stand in the order of their loss.";
        Self { label: "place by loss", unit: "", of: Box::new(place), words, is_place: true }
    }
}

/// Designs and lights whose names are written in figures, at most.
const MOST_NAMES: usize = 12;

/// Designs that have a row each in their figure, at most.
const MOST_ROWS: usize = 24;

/// Height of a row, px.
const ROW: f64 = 26.0;

/// The loss of a few designs, each in a row of its own with its name, the best above. A compared design that is none of them has its row below.
fn ranked_figure(found: &DesignFindings<'_>, words: &str) -> Figure {
    let mut names: Vec<String> = found.best.iter().map(|judged| judged.name.clone()).collect();
    let row_of = |design: &Design| found.best.iter().position(|judged| judged.design == *design);
    let mut row = |judged: &JudgedDesign| {
        row_of(&judged.design).unwrap_or_else(|| {
            names.push(judged.name.clone());
            names.len() - 1
        })
    };
    let mut marks = |designs: &[JudgedDesign]| -> Vec<[f64; 2]> {
        let seen = designs.iter().filter(|judged| judged.merits.loss.is_finite());
        seen.map(|judged| [judged.merits.loss, (row(judged) + 1) as f64]).collect()
    };
    let (all, front, compared) = (marks(found.best), marks(found.front), marks(found.compared));
    let worst = found.worst_cases.iter().enumerate().filter(|(_, worst)| worst.loss.is_finite());
    let worst: Vec<[f64; 2]> = worst.map(|(place, worst)| [worst.loss, (place + 1) as f64]).collect();
    let losses = || all.iter().chain(&compared).chain(&worst).map(|point| point[0]);
    let (low, high) = losses().fold((f64::INFINITY, 0.0f64), |(a, b), loss| (a.min(loss), b.max(loss)));
    let x = Axis::log10("loss", "", [low * 0.8, (high * 1.2).min(low * 1e4)]);
    let height = ROW * names.len().max(3) as f64;
    let panel = Panel::new(x, Axis::named("design", names).downward()).sized(520.0, height);
    let panel = with_marks(panel, "within tolerances", Ink::cycle(2), (worst, 4.0, true));
    let panel = with_marks(panel, "as meant", Ink::Muted, (all, 4.0, false));
    let panel = with_marks(panel, "front", Ink::cycle(0), (front, 5.0, false));
    let panel = with_marks(panel, "compared", Ink::cycle(1), (compared, 6.0, true));
    Figure::new("Loss of all designs", panel).explained(format!(
        "Each row is a design that keeps to all limits. Those of the front are not beaten in loss, time, price and number of exposures at \
         once. {words}{}",
        missing_in_words(found, 0)
    ))
}

/// Loss against what varies most among designs.
fn front_figure(found: &DesignFindings<'_>) -> Figure {
    let seen: Vec<&Score> = found.scores.iter().map(|(_, s)| s).filter(|s| s.loss.is_finite()).collect();
    let Across { label, unit, of: pick, words, is_place } = Across::of(&seen);
    let is_count = label == EXPOSURES;
    if is_place && found.best.len() == seen.len() && seen.len() <= MOST_ROWS {
        return ranked_figure(found, words);
    }
    let points: Vec<[f64; 2]> = seen.iter().map(|s| [pick(s), s.loss]).collect();
    let (low, high) = points.iter().fold((f64::INFINITY, 0.0f64), |(a, b), p| (a.min(p[1]), b.max(p[1])));
    let top = (high * 1.2).min(low * 1e4);
    let beyond = points.iter().filter(|point| point[1] > top).count();
    let y = Axis::log10("loss", "", [low * 0.8, top]);
    let x = match is_place {
        true => Axis::linear(label, unit, [0.0, seen.len() as f64 + 1.0]),
        false if is_count => Axis::from_zero(label, unit, points.iter().map(|p| p[0] + 0.5)).of_counts(),
        false => Axis::from_zero(label, unit, points.iter().map(|p| p[0] * 1.1)),
    };
    let marks = |designs: &[JudgedDesign]| -> Vec<[f64; 2]> {
        let score = |d: &JudgedDesign| Score {
            loss: d.merits.loss,
            time_s: d.merits.time_s,
            cost: d.merits.cost,
            exposures: d.design.lights.len(),
        };
        designs.iter().map(score).filter(|s| s.loss.is_finite()).map(|s| [pick(&s), s.loss]).collect()
    };
    let also = recommended(found).filter(|(place, _)| *place > 0).map(|(_, judged)| judged);
    let labels = found.best.iter().take(1).chain(also).flat_map(|judged| {
        let at = marks(std::slice::from_ref(judged));
        at.into_iter().map(|at| Label { at, text: judged.name.clone() })
    });
    let labels = labels.collect();
    let dots = SeriesShape::Dots { points, radius: 1.5, opacity: 0.5 };
    let panel = Panel::new(x, y).with(Series::unnamed(Ink::Muted, dots));
    let panel = with_marks(panel, "front", Ink::cycle(0), (marks(found.front), 5.0, false));
    let panel = with_marks(panel, "compared", Ink::cycle(1), (marks(found.compared), 6.0, true));
    let panel = panel.with(Series::unnamed(Ink::Text, SeriesShape::Labels(labels)));
    Figure::new("Loss of all designs", panel).explained(format!(
        "Each dot is a design that keeps to all limits. Those of the front are not beaten in loss, time, price and number of \
         exposures at once. {words}{}",
        missing_in_words(found, beyond)
    ))
}

/// A panel with marks of a radius, hollow or not, where there are any: a legend names nothing that is not drawn.
fn with_marks(
    panel: Panel,
    name: &str,
    ink: Ink,
    (points, radius, hollow): (Vec<[f64; 2]>, f64, bool),
) -> Panel {
    if points.is_empty() {
        return panel;
    }
    let shape = SeriesShape::Markers { points, radius, hollow };
    panel.with(Series { name: Some(name.into()), ink, shape })
}

/// Which designs have no dot and why, as sentences that go on a text; empty where all have one.
fn missing_in_words(found: &DesignFindings<'_>, beyond: usize) -> String {
    let mut words = String::new();
    let evaluated = found.scores.len() as u64;
    if evaluated < found.space.len() {
        words += &format!(" {evaluated} of {} designs were evaluated.", found.space.len());
    }
    if !found.left_out.is_empty() {
        words += &format!(" {}.", found.left_out);
    }
    if beyond > 0 {
        let designs = if beyond == 1 { "1 design has" } else { &format!("{beyond} designs have") };
        words += &format!(" {designs} a loss beyond the upper edge.");
    }
    words
}

/// The lights without a finite least loss by name, as a sentence that goes on a text; empty where there are none.
fn unseen_lights(names: impl Iterator<Item = String>) -> String {
    let names: Vec<String> = names.collect();
    let more = names.len().saturating_sub(MOST_NAMES);
    let shown = names.iter().take(MOST_NAMES).cloned().collect::<Vec<_>>().join(", ");
    match (names.len(), more) {
        (0, _) => String::new(),
        (_, 0) => format!(" Left out: {shown}."),
        _ => format!(" Left out: {shown} and {more} more."),
    }
}

/// The least loss with each light, or with each pair of lights.
fn lights_figure(found: &DesignFindings<'_>) -> Figure {
    let mut designs = found.scores.iter().map(|(number, _)| found.space.design(*number));
    if designs.all(|design| design.lights.len() == 1) { single_lights(found) } else { light_map(found) }
}

/// The least loss of the designs with each light first; infinite where there is none.
fn least_losses(found: &DesignFindings<'_>) -> Vec<f64> {
    let mut least = vec![f64::INFINITY; found.space.problem().lights.len()];
    for (number, score) in found.scores {
        let cell = &mut least[found.space.design(*number).lights[0]];
        *cell = cell.min(score.loss);
    }
    least
}

/// The least loss of the designs with each light, where each design has one.
fn single_lights(found: &DesignFindings<'_>) -> Figure {
    let lights = &found.space.problem().lights;
    let least = least_losses(found);
    let seen = || least.iter().copied().enumerate().filter(|(_, loss)| loss.is_finite());
    let (low, high) = seen().fold((f64::INFINITY, 0.0f64), |(a, b), (_, loss)| (a.min(loss), b.max(loss)));
    let (low, high) = if low.is_finite() { (low, high) } else { (1.0, 10.0) };
    let points = seen().map(|(light, loss)| [lights[light].peak_nm, loss]).collect();
    let step = seen().count().div_ceil(MOST_NAMES).max(1);
    let name = |(light, loss): (usize, f64)| Label {
        at: [lights[light].peak_nm, loss],
        text: format!("{}: {}", lights[light].name, digits(loss)),
    };
    let labels = seen().step_by(step).map(name).collect();
    let peaks = || lights.iter().map(|light| light.peak_nm);
    let (first, last) = (peaks().fold(f64::INFINITY, f64::min), peaks().fold(0.0, f64::max));
    // Names stand to the right of their marks
    let margin_nm = (0.1 * (last - first)).max(5.0);
    let x = Axis::linear("peak of the light", "nm", [first - margin_nm, last + 3.0 * margin_nm]);
    let y = Axis::log10("least loss", "", [low * 0.8, high * 1.2]);
    let marks = SeriesShape::Markers { points, radius: 5.0, hollow: false };
    let panel = Panel::new(x, y)
        .with(Series::unnamed(Ink::cycle(0), marks))
        .with(Series::unnamed(Ink::Text, SeriesShape::Labels(labels)));
    let unseen = least.iter().zip(lights).filter(|(loss, _)| !loss.is_finite());
    let unseen = unseen_lights(unseen.map(|(_, light)| light.name.clone()));
    Figure::new("Which light", panel).explained(format!(
        "The least loss of all designs with this light. A light under which nothing is seen, or that breaks a limit in every design, is left \
         out.{unseen}"
    ))
}

/// The least loss of designs with each pair of so many lights, in either order, on the diagonal of those with one light; infinite where there
/// is none.
fn least_of_pairs(count: usize, losses: impl Iterator<Item = (Vec<usize>, f64)>) -> Vec<f64> {
    let mut least = vec![f64::INFINITY; count * count];
    for (lights, loss) in losses {
        for &a in &lights {
            for &b in &lights {
                if a != b || lights.len() == 1 {
                    let cell = &mut least[a * count + b];
                    *cell = cell.min(loss);
                }
            }
        }
    }
    least
}

/// The least loss with each pair of lights, in either order.
fn light_map(found: &DesignFindings<'_>) -> Figure {
    let lights = &found.space.problem().lights;
    let count = lights.len();
    let losses = found.scores.iter().map(|(number, score)| (found.space.design(*number).lights, score.loss));
    let least = least_of_pairs(count, losses);
    let finite = || least.iter().copied().filter(|loss| loss.is_finite());
    let low = finite().fold(f64::INFINITY, f64::min);
    let high = finite().fold(0.0, f64::max).min(low * 1e3).max(low * 1.001);
    let (low, high) = if low.is_finite() { (low, high) } else { (1.0, 10.0) };
    let scale = (480.0 / count as f64).clamp(1.0, 60.0).round() as usize;
    let raster = Raster::from_fn(count * scale, count * scale, |row, col| {
        // Rows of a picture run downward
        let (a, b) = (col / scale, count - 1 - row / scale);
        let loss = least[a * count + b];
        if loss.is_finite() {
            ColorMap::Viridis.color(((high / loss).ln() / (high / low).ln()).clamp(0.0, 1.0))
        } else {
            [225, 225, 225]
        }
    });
    let peaks_nm: Vec<f64> = lights.iter().map(|light| light.peak_nm).collect();
    let (x, y) = match even_peaks(&peaks_nm) {
        Some(range_nm) => {
            let axis = |which: &str| Axis::linear(format!("peak of {which} light"), "nm", range_nm);
            (axis("one"), axis("the other"))
        }
        // Lights that are not evenly spaced bear their names at the sides
        None => {
            let names = || lights.iter().map(|light| light.name.clone());
            (Axis::named("one light", names()), Axis::named("the other light", names()))
        }
    };
    let picture = SeriesShape::Picture { x: x.limits, y: y.limits, raster };
    let mut panel = Panel::new(x, y).sized(480.0, 480.0).with(Series::unnamed(Ink::Text, picture));
    panel.color_bar = Some(ColorBar {
        axis: Axis::log10("inverse of the least loss", "", [1.0 / high, 1.0 / low]),
        map: ColorMap::Viridis,
    });
    Figure::new("Which lights", panel).explained(
        "The least loss of all designs with these two lights, the one of the column and the one of the row, in either order, and of \
         single lights on the diagonal. Bright is good. Gray: no design with these lights keeps to all limits and sees what is asked for.",
    )
}

/// Where the cells of peaks, nm, that follow each other in equal steps begin and end; `None` for others.
fn even_peaks(peaks_nm: &[f64]) -> Option<[f64; 2]> {
    let [first, second, ..] = *peaks_nm else { return None };
    let step = second - first;
    let is_even = peaks_nm.iter().enumerate().all(|(k, nm)| (nm - first - k as f64 * step).abs() < 1e-6);
    let last = first + step * (peaks_nm.len() - 1) as f64;
    (step > 0.0 && is_even).then_some([first - 0.5 * step, last + 0.5 * step])
}

fn assumptions_section(found: &DesignFindings<'_>) -> Section {
    let rows = found.sensitivities.iter().take(MOST_SENSITIVITIES).map(|s| {
        let best = match (s.other_best, found.worst_cases.len()) {
            (true, _) => "another design is then the best, one way or the other",
            (false, 0 | 1) => "there is no other design to compare with",
            (false, _) => "it stays the best of them either way",
        };
        let meaning = format!("{:+.2} % with a quarter less; {best}", 100.0 * s.loss_change_of_less);
        Number::computed(&s.assumption, format!("{:+.2}", 100.0 * s.loss_change), "%", meaning)
    });
    let of = found.best.first().map_or("", |best| best.name.as_str());
    let table = NumberTable {
        caption: format!(
            "Loss of {of}, the best as meant, with a quarter more of each assumed number; it is compared with the {} best",
            found.worst_cases.len()
        ),
        rows: rows.collect(),
    };
    let mut section = Section::new("What it rests on").with(ReportItem::Table(table));
    let place = recommended(found).map_or(0, |(place, _)| place);
    if let Some((worst, judged)) = found.worst_cases.get(place).zip(found.best.get(place)) {
        let shifts: Vec<String> = worst.light_shifts_nm.iter().map(|nm| format!("{nm:+} nm")).collect();
        let broken: String = worst
            .excesses
            .iter()
            .map(|excess| format!(" Somewhere within them {}.", limit_in_words(excess)))
            .collect();
        section = section.say(format!(
            "At the worst end of the tolerances (lights {}, filter {:+} nm, light at {} degrees) the loss of {} is {}, and its largest leak \
             within them is {} %.{broken} The spectra as made are taken to be known then: without a calibration there is a bias besides.",
            shifts.join(" and "),
            worst.filter_shift_nm,
            worst.angle_deg,
            judged.name,
            digits(worst.loss),
            digits(100.0 * worst.leak)
        ));
    }
    ideal_edges(found.space.problem()).into_iter().fold(section, Section::say)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_of_lights_has_its_loss_in_either_order() {
        let none = f64::INFINITY;
        let losses = [(vec![0], 3.0), (vec![0, 2], 1.0), (vec![2, 0], 2.0), (vec![1], none)];
        let least = least_of_pairs(3, losses.into_iter());
        assert_eq!(least, [3.0, none, 1.0, none, none, none, 1.0, none, none]);
    }

    #[test]
    fn a_legend_names_only_what_is_drawn() {
        let axis = || Axis::linear("", "", [0.0, 1.0]);
        let empty =
            with_marks(Panel::new(axis(), axis()), "compared", Ink::cycle(1), (Vec::new(), 6.0, true));
        assert!(empty.series.is_empty());
        let one = with_marks(empty, "front", Ink::cycle(0), (vec![[0.5, 0.5]], 5.0, false));
        assert_eq!(one.series.len(), 1);
    }
}
