//! The page of a design search: what is best, what it costs, what it rests on, and what it can't tell apart.

use fluorspar::design::{Design, DesignSpace, FineBands, Merits, Score, Sensitivity, WorstCase};

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
    /// All designs.
    pub space: &'a DesignSpace,
    /// Those that were evaluated, by number.
    pub scores: &'a [(u64, Score)],
    /// The best, in order.
    pub best: &'a [JudgedDesign],
    /// Those that no other dominates.
    pub front: &'a [JudgedDesign],
    /// Designs to compare with.
    pub compared: &'a [JudgedDesign],
    /// What a quarter more of each assumed number does.
    pub sensitivities: &'a [Sensitivity],
    /// The best design within tolerances.
    pub worst_case: Option<&'a WorstCase>,
    /// The resolved file.
    pub design_toml: &'a str,
    /// Its digest.
    pub sha256: &'a str,
}

/// Designs told in the table of the best.
const SHOWN: usize = 10;
/// Sensitivities told.
const MOST_SENSITIVITIES: usize = 15;
/// Side of a simulated patch, pixels.
const PATCH_PX: usize = 40;
/// Seed of the noise of simulated patches.
const PATCH_SEED: u64 = 1;

/// The figures of the page by the stems of their files: spectra of the best design, simulated captures, loss of all designs, lights.
/// None where no design is feasible.
pub fn design_figures(found: &DesignFindings<'_>) -> Vec<(&'static str, Figure)> {
    let Some(best) = found.best.first() else { return Vec::new() };
    vec![
        ("spectra", spectra_figure(found.space, best)),
        ("captures", captures_figure(found, best)),
        ("designs", front_figure(found)),
        ("lights", light_map(found)),
    ]
}

/// The page of a design search.
pub fn design_report(found: &DesignFindings<'_>) -> ReportData {
    let mut sections = Vec::new();
    if let Some(best) = found.best.first() {
        sections.push(best_section(found, best));
        sections.push(captures_section(found, best));
        sections.push(blind_section(found, best));
        sections.push(choices_section(found));
        sections.push(assumptions_section(found));
    }
    ReportData {
        title: found.title.into(),
        overview: None,
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
        rerun_command: "fluorspar design optimize DESIGN.toml".into(),
    }
}

fn lead(found: &DesignFindings<'_>) -> Vec<String> {
    let mut lead = Vec::new();
    if !found.description.is_empty() {
        lead.push(found.description.to_owned());
    }
    lead.push(format!("Designs are ranked by {}; less is better.", found.criterion));
    lead.push(match found.best.first() {
        Some(best) => format!("The best is {}.", best.name),
        None => "No design keeps to all limits and sees what is asked for.".into(),
    });
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
fn digits(value: f64) -> String {
    if !value.is_finite() {
        "not seen".into()
    } else if value == 0.0 {
        "0".into()
    } else if (1e-3..1e5).contains(&value.abs()) {
        let places = (3.0 - value.abs().log10().floor()).clamp(0.0, 6.0) as usize;
        format!("{value:.places$}")
    } else {
        format!("{value:.3e}")
    }
}

fn headline(found: &DesignFindings<'_>) -> Vec<Number> {
    let Some(best) = found.best.first() else { return Vec::new() };
    let mut numbers = vec![Number::computed("loss", digits(best.merits.loss), "", found.criterion)];
    if let Some(worst) = found.worst_case {
        let meaning = "the same at the worst end of all tolerances, after calibration";
        numbers.push(Number::computed("within tolerances", digits(worst.loss), "", meaning));
    }
    let merits = &best.merits;
    numbers.push(Number::computed("time", digits(merits.time_s * 1e3), "ms", "of all exposures"));
    numbers.push(Number::computed(
        "leak",
        digits(merits.leak),
        "",
        "reflected per fluorescent electron, at most",
    ));
    if let Some(margin) = merits.safety_margin {
        numbers.push(Number::computed(
            "safety margin",
            digits(margin),
            "",
            "limit over exposure of the tissue",
        ));
    }
    numbers
}

/// Bounds of a design by region, as a table.
fn bounds(found: &DesignFindings<'_>, judged: &JudgedDesign) -> Vec<ReportItem> {
    let p = found.space.problem();
    let table = |(region, merits): (&fluorspar::design::RegionModel, &fluorspar::design::RegionMerits)| {
        let response = &region.response;
        let weights = response.fluorescence.iter().zip(&merits.weights).map(|(part, sd)| {
            let meaning = "bound on the relative standard deviation of its weight";
            Number::computed(&part.name, digits(*sd), "", meaning)
        });
        let contrasts = p.contrasts.iter().zip(&merits.contrasts).map(|(contrast, sd)| {
            let meaning = format!("bound on the standard deviation; {}", contrast.part.join(" + "));
            Number::computed(&contrast.name, digits(*sd), "", meaning)
        });
        let caption = format!("{}: {}", judged.name, response.name);
        ReportItem::Table(NumberTable { caption, rows: weights.chain(contrasts).collect() })
    };
    p.regions_of(judged.design.geometry).zip(&judged.merits.regions).map(table).collect()
}

fn best_section(found: &DesignFindings<'_>, best: &JudgedDesign) -> Section {
    let mut section = Section::new("The best design");
    for item in bounds(found, best) {
        section = section.with(item);
    }
    for compared in found.compared {
        for item in bounds(found, compared) {
            section = section.with(item);
        }
    }
    let caption = "Everything relative to its own peak. Where a channel sees two fluorophores at once, only their ratio \
                   between channels and lights tells them apart.";
    section.show(spectra_figure(found.space, best), caption)
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
    Figure::grid("Spectra of the best design", panels, 1).explained(
        "Above: lights, the filters in front of the sensor and the sensitivity of its channels. Below: what each fluorophore of \
         the first region emits under each light, all on one scale.",
    )
}

fn captures_section(found: &DesignFindings<'_>, best: &JudgedDesign) -> Section {
    let caption = "Noise of photons and of the readout only.";
    Section::new("Captures of the best and of another").show(captures_figure(found, best), caption)
}

fn captures_figure(found: &DesignFindings<'_>, best: &JudgedDesign) -> Figure {
    let mut panels = Vec::new();
    for judged in std::iter::once(best).chain(found.compared.iter().take(1)) {
        for (region, model) in found.space.problem().regions_of(judged.design.geometry).enumerate() {
            let raster = patches(found.space, &judged.design, region);
            let title = format!("{}: {}", judged.name, model.response.name);
            panels.push(patch_panel(found.space, &judged.design, raster).titled(title));
        }
    }
    let columns = panels.len().clamp(1, 2);
    Figure::grid("Simulated captures", panels, columns).explained(
        "Each square is a patch of the region as one channel records it, with the noise of single pixels: a row for each exposure, \
         a column for each channel. Gray follows the electrons to the power of 0.45; white is 1.3 times the brightest mean of that design.",
    )
}

/// Patches with the names of exposures to the left and of channels above.
fn patch_panel(space: &DesignSpace, design: &Design, raster: Raster) -> Panel {
    const CELL: f64 = 90.0;
    let p = space.problem();
    let channels = &p.cameras[design.camera].channels;
    let mut exposures: Vec<&str> = design.lights.iter().map(|&k| p.lights[k].name.as_str()).collect();
    exposures.extend(p.white.as_ref().map(|_| "white"));
    let (columns, rows) = (channels.len() as f64, exposures.len() as f64);
    let left = exposures.iter().map(|name| name.chars().count()).max().unwrap_or(0) as f64 * 0.085 + 0.1;
    let above = channels
        .iter()
        .enumerate()
        .map(|(c, name)| Label { at: [c as f64 + 0.1, rows + 0.08], text: name.clone() });
    let beside = exposures
        .iter()
        .enumerate()
        .map(|(k, name)| Label { at: [-left, rows - k as f64 - 0.5], text: (*name).to_owned() });
    let labels = above.chain(beside).collect();
    let [wide, high] = [columns + left, rows + 0.35];
    let picture = SeriesShape::Picture { x: [0.0, columns], y: [0.0, rows], raster };
    Panel::new(Axis::hidden([-left, columns]), Axis::hidden([0.0, high]))
        .sized(CELL * wide, CELL * high)
        .with(Series::unnamed(Ink::Text, picture))
        .with(Series::unnamed(Ink::Text, SeriesShape::Labels(labels)))
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

fn blind_section(found: &DesignFindings<'_>, best: &JudgedDesign) -> Section {
    let mut section = Section::new("What is least told apart").say(
        "Each line is a joint change of the weights that changes the data least. A plus and a minus mean that one can stand for \
         the other.",
    );
    for judged in std::iter::once(best).chain(found.compared) {
        for (region, merits) in
            found.space.problem().regions_of(judged.design.geometry).zip(&judged.merits.regions)
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
    let row = |judged: &JudgedDesign| {
        let merits = &judged.merits;
        let meaning = format!(
            "{} ms, leak {}, saturation {}, price {}",
            digits(merits.time_s * 1e3),
            digits(merits.leak),
            digits(merits.saturation),
            digits(merits.cost)
        );
        Number::computed(&judged.name, digits(merits.loss), "", meaning)
    };
    let best = NumberTable {
        caption: "The best designs".into(),
        rows: found.best.iter().take(SHOWN).map(row).collect(),
    };
    let front = NumberTable {
        caption: "No design is better than these in loss, time, price and number of exposures at once".into(),
        rows: found.front.iter().take(SHOWN).map(row).collect(),
    };
    Section::new("All designs")
        .show(front_figure(found), "")
        .show(light_map(found), "")
        .with(ReportItem::Table(best))
        .with(ReportItem::Table(front))
}

/// A quantity of a design that is drawn.
type Objective = fn(&Score) -> f64;

/// Loss against the objective that varies most: price, time, or the number of exposures.
fn front_figure(found: &DesignFindings<'_>) -> Figure {
    let objectives: [(&str, &str, Objective); 3] = [
        ("price", "", |s| s.cost),
        ("time", "ms", |s| s.time_s * 1e3),
        ("exposures", "", |s| s.exposures as f64),
    ];
    let seen: Vec<&Score> = found.scores.iter().map(|(_, s)| s).filter(|s| s.loss.is_finite()).collect();
    let distinct = |pick: Objective| {
        let mut values: Vec<u64> = seen.iter().take(5000).map(|s| (pick(s) * 1e6).round() as u64).collect();
        values.sort_unstable();
        values.dedup();
        values.len()
    };
    let counts = objectives.map(|(_, _, pick)| distinct(pick));
    let chosen = (0..3).fold(2, |best, k| if counts[k] > counts[best] { k } else { best });
    let (label, unit, pick) = objectives[chosen];
    let points: Vec<[f64; 2]> = seen.iter().map(|s| [pick(s), s.loss]).collect();
    let (low, high) = points.iter().fold((f64::INFINITY, 0.0f64), |(a, b), p| (a.min(p[1]), b.max(p[1])));
    let y = Axis::log10("loss", "", [low * 0.8, (high * 1.2).min(low * 1e4)]);
    let x = Axis::from_zero(label, unit, points.iter().map(|p| p[0] * 1.1));
    let marks = |designs: &[JudgedDesign]| -> Vec<[f64; 2]> {
        let score = |d: &JudgedDesign| Score {
            loss: d.merits.loss,
            time_s: d.merits.time_s,
            cost: d.merits.cost,
            exposures: d.design.lights.len(),
        };
        designs.iter().map(score).filter(|s| s.loss.is_finite()).map(|s| [pick(&s), s.loss]).collect()
    };
    let front = SeriesShape::Markers { points: marks(found.front), radius: 5.0, hollow: false };
    let other = SeriesShape::Markers { points: marks(found.compared), radius: 6.0, hollow: true };
    let label = found
        .best
        .first()
        .map(|best| Label { at: marks(std::slice::from_ref(best))[0], text: best.name.clone() });
    let mut panel = Panel::new(x, y)
        .with(Series::unnamed(Ink::Muted, SeriesShape::Dots { points, radius: 1.5, opacity: 0.5 }))
        .with(Series { name: Some("front".into()), ink: Ink::cycle(0), shape: front })
        .with(Series { name: Some("compared".into()), ink: Ink::cycle(1), shape: other });
    panel = panel.with(Series::unnamed(Ink::Text, SeriesShape::Labels(label.into_iter().collect())));
    Figure::new("Loss of all designs", panel).explained(
        "Each dot is a design that keeps to all limits. Those of the front are not beaten in loss, time, price and number of \
         exposures at once.",
    )
}

/// The least loss with each light, or with each pair of lights.
fn light_map(found: &DesignFindings<'_>) -> Figure {
    let lights = &found.space.problem().lights;
    let count = lights.len();
    let mut least = vec![f64::INFINITY; count * count];
    for (number, score) in found.scores {
        let design = found.space.design(*number);
        for &a in &design.lights {
            for &b in &design.lights {
                if a < b || design.lights.len() == 1 {
                    let cell = &mut least[a * count + b];
                    *cell = cell.min(score.loss);
                }
            }
        }
    }
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
    let even = even_peaks(&peaks_nm);
    let (range, words, unit) = match even {
        Some(range_nm) => (range_nm, "peak", "nm"),
        None => ([0.0, count as f64], "number", ""),
    };
    // Names where the axes count lights
    let names = (0..if even.is_some() { 0 } else { count })
        .map(|k| Label { at: [k as f64 + 1.1, k as f64 + 0.5], text: lights[k].name.clone() });
    let shown = names.step_by(count.div_ceil(9).max(1)).collect();
    let axis = |which: &str| Axis::linear(format!("{words} of the {which} light"), unit, range);
    let (x, y) = (axis("shorter"), axis("longer"));
    let mut panel = Panel::new(x, y)
        .sized(480.0, 480.0)
        .with(Series::unnamed(Ink::Text, SeriesShape::Picture { x: range, y: range, raster }))
        .with(Series::unnamed(Ink::Text, SeriesShape::Labels(shown)));
    panel.color_bar = Some(ColorBar {
        axis: Axis::log10("inverse of the least loss", "", [1.0 / high, 1.0 / low]),
        map: ColorMap::Viridis,
    });
    Figure::new("Which lights", panel).explained(
        "The least loss of all designs with these two lights, and of single lights on the diagonal. Bright is good, gray is not \
         seen or breaks a limit.",
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
        let meaning =
            if s.other_best { "another design is then the best" } else { "the best stays the best" };
        Number::computed(&s.assumption, format!("{:+.2}", 100.0 * s.loss_change), "%", meaning)
    });
    let table = NumberTable {
        caption: "Loss with a quarter more of each assumed number".into(),
        rows: rows.collect(),
    };
    let mut section = Section::new("What it rests on").with(ReportItem::Table(table));
    if let Some(worst) = found.worst_case {
        let shifts: Vec<String> = worst.light_shifts_nm.iter().map(|nm| format!("{nm:+} nm")).collect();
        section = section.say(format!(
            "At the worst end of the tolerances (lights {}, filter {:+} nm, light at {} degrees) the loss is {}, and the largest leak \
             within them is {}. The spectra as made are taken to be known then: without a calibration there is a bias besides.",
            shifts.join(" and "),
            worst.filter_shift_nm,
            worst.angle_deg,
            digits(worst.loss),
            digits(worst.leak)
        ));
    }
    section
}
