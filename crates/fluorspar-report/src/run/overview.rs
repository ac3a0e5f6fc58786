//! The first screen of a report: the frame with region and map, the estimate, and the numbers that decide about a design.

use std::collections::BTreeMap;
use std::path::Path;

use fluorspar::analysis::{Analysis, ExclusionCounts, PixelSelection, Statistics};
use fluorspar::findings::{Finding, FindingId, region_findings};
use fluorspar::pipeline::{
    AnalyzedFrame, AnalyzedRegion, CapturedFrame, ColorRendering, DisplayImage, Preview, for_display,
    on_sensor, preview,
};
use fluorspar::spectral::Fluorophore;
use fluorspar::study::Capture;
use fluorspar_experiment::schema::{ASSUMED_PHOTON_YIELD, FluorophoreSection};
use fluorspar_experiment::{InputFile, ResolvedExperiment};
use rayon::prelude::*;

use super::region_outline::region_outline;
use super::regions_section::region_names;
use super::report::{blocks_of, electrons, percent, percent_saturated};
use super::safety_section::eye_safe_captures;
use super::view_filters::assumed_blocking_in_short;
use super::words::{NO_LIGHT, Words, capital};
use super::{FrameOrigin, RunResults};
use crate::figure::rgba_png;
use crate::figures::ShareMap;
use crate::findings::{
    ASSUMED_GAIN, FindingWords, ShareAnswer, answering_share, number, undivided_red, value,
};
use crate::page::render_noise_words;
use crate::{Answer, ColorMap, Contribution, Contributions, FrameView, MapOverlay, Number, Overview, Raster};

/// Changes of the share below it round to nothing.
const LEAST_CHANGE: f64 = 5e-5;
/// Contributions to the error that the first screen lists.
const CONTRIBUTIONS: usize = 3;

/// The first screen.
pub(super) fn overview(run: &RunResults<'_>, words: &Words<'_>) -> Overview {
    Overview {
        views: views(run, words),
        answer: run.evaluation.analysis.as_ref().and_then(|analyzed| answer(&analyzed.analysis)),
        cards: cards(run, words),
        assumed: assumed(run, words),
    }
}

/// Images of the frames that have light, the analyzed one first.
fn views(run: &RunResults<'_>, words: &Words<'_>) -> Vec<FrameView> {
    let study = &run.experiment.study;
    let analyzed = run.evaluation.analysis.as_ref();
    let is_analyzed = |frame: &CapturedFrame| analyzed.is_some_and(|a| a.analysis.frame == frame.raw.label);
    let shown = run.evaluation.frames.iter().filter_map(|frame| {
        let capture = study.capture(&frame.raw.label)?;
        let is_lit = words.lights(capture) != NO_LIGHT || run.frames_from == FrameOrigin::Given;
        is_lit.then_some((frame, capture))
    });
    let mut shown: Vec<_> = shown.collect();
    shown.sort_by_key(|(frame, _)| !is_analyzed(frame));
    let view = |(frame, capture)| view(run, words, frame, capture, analyzed.filter(|_| is_analyzed(frame)));
    shown.into_par_iter().filter_map(view).collect()
}

fn view(
    run: &RunResults<'_>,
    words: &Words<'_>,
    frame: &CapturedFrame,
    capture: &Capture,
    analyzed: Option<&AnalyzedFrame>,
) -> Option<FrameView> {
    let shown = for_display(&frame.developed, frame.raw.dn_per_electron);
    let mut image: Preview = preview(&shown.image, &ColorRendering::of_frame(&run.experiment.study, capture));
    // Noise of the last bits would be most of the page.
    let step = if analyzed.is_some() { 2 } else { 3 };
    image.rgb.iter_mut().for_each(|value| *value = (*value / step * step).saturating_add(step / 2));
    let png = Raster::from_rgb8(image.width, image.height, &image.rgb)?.to_png()?;
    let label = &frame.raw.label;
    let lights = match words.lights(capture) {
        // Who recorded the frame may have had a lamp of his own: that of the room
        none if none == NO_LIGHT && run.frames_from == FrameOrigin::Given => {
            "none of the experiment's lights".into()
        }
        lights => lights,
    };
    let mut caption = format!("Frame \"{label}\": {lights}, {:.1} ms", 1e3 * frame.raw.exposure_s);
    if !shown.done.is_empty() {
        caption += &format!(". {}", capital(&shown.done));
    }
    caption.push('.');
    let mut links = vec![("image".into(), format!("preview_{label}.png"))];
    links.extend(run.raw_ending.map(|ending| ("raw".into(), format!("raw_{label}.{ending}"))));
    Some(FrameView {
        name: format!("Frame \"{label}\""),
        png,
        size: [image.width, image.height],
        caption,
        alt: seen(&image, frame, analyzed),
        outline: analyzed.map_or_else(Vec::new, |analyzed| outlines(run, analyzed, shown.block)),
        names: analyzed.map_or_else(Vec::new, |analyzed| {
            let main = (analyzed.analysis.region_description.as_str(), &analyzed.region);
            region_names(main, &run.evaluation.regions, shown.block)
        }),
        map: analyzed.and_then(|analyzed| share_overlay(analyzed, &shown, words)),
        links,
    })
}

/// Outlines of the regions that are not the whole frame, and of the targets.
fn outlines(run: &RunResults<'_>, analyzed: &AnalyzedFrame, block: usize) -> Vec<Vec<[f64; 2]>> {
    let regions =
        std::iter::once(analyzed).chain(run.evaluation.regions.iter().filter_map(AnalyzedRegion::in_view));
    let mut lines: Vec<_> =
        regions.filter(|a| is_part(a)).flat_map(|a| region_outline(&a.region, block)).collect();
    let Some(targets) = &analyzed.targets else { return lines };
    for number in 1..=targets.names.len() {
        let is_target = |pixel: &usize| usize::from(targets.labels[*pixel]) == number;
        let pixels = (0..targets.labels.len()).filter(is_target).collect();
        let selection = PixelSelection { width: targets.width, height: targets.height, pixels };
        lines.extend(region_outline(&selection, block));
    }
    lines
}

/// Whether a region leaves something of the frame out.
fn is_part(analyzed: &AnalyzedFrame) -> bool {
    analyzed.region.pixels.len() < analyzed.region.width * analyzed.region.height
}

/// What is seen in a frame: how bright it is, where, and the region.
fn seen(image: &Preview, frame: &CapturedFrame, analyzed: Option<&AnalyzedFrame>) -> String {
    let luminance: Vec<u32> =
        image.rgb.chunks_exact(3).map(|p| u32::from(p[0]) + 2 * u32::from(p[1]) + u32::from(p[2])).collect();
    let bright = luminance.iter().filter(|&&l| l > 4 * 160).count();
    let dark = luminance.iter().filter(|&&l| l < 4 * 40).count();
    let share = |count: usize| 100.0 * count as f64 / luminance.len().max(1) as f64;
    let mut text = format!(
        "Frame \"{}\": {:.0} % of the image is bright, {:.0} % is dark.",
        frame.raw.label,
        share(bright),
        share(dark)
    );
    if let Some(AnalyzedFrame { analysis, region, .. }) = analyzed.filter(|a| is_part(a)) {
        let count = region.pixels.len().max(1);
        let col = region.pixels.iter().map(|p| p % region.width).sum::<usize>() / count;
        let row = region.pixels.iter().map(|p| p / region.width).sum::<usize>() / count;
        let third = |at: usize, of: usize, names: [&'static str; 3]| names[(3 * at / of.max(1)).min(2)];
        let colors: Vec<String> = analysis
            .channels
            .iter()
            .filter_map(|c| c.statistics.map(|s| format!("{} {:.0}", c.name, s.median)))
            .collect();
        let brightness = match analysis.counts.saturated_share() {
            Some(share) => format!("{:.0} % of it is saturated", 100.0 * share),
            None => format!("medians {} DN", colors.join(", ")),
        };
        text += &format!(
            " The outlined region, {}, fills {:.1} % of it around its {} {}; {brightness}.",
            analysis.region_description,
            100.0 * count as f64 / (region.width * region.height).max(1) as f64,
            third(row, region.height, ["upper", "middle", "lower"]),
            third(col, region.width, ["left", "center", "right"]),
        );
    }
    text
}

/// Shares of blocks, those of the estimate or means on the mixture line, as colors whose opacity grows with the share; blocks that the
/// estimate marks are outlined.
fn share_overlay(analyzed: &AnalyzedFrame, shown: &DisplayImage, words: &Words<'_>) -> Option<MapOverlay> {
    let by_blocks = blocks_of(&analyzed.analysis).and_then(ShareMap::of_blocks);
    let is_by_blocks = by_blocks.is_some();
    let map = match by_blocks {
        Some(map) => map,
        None => ShareMap::of(analyzed.porphyrin.as_ref()?, &analyzed.region.pixels)?,
    };
    let top = map.top();
    // Colors at the resolution of the image, within the region only
    let width = analyzed.region.width;
    let [columns, rows] = [map.columns, map.rows].map(|n| (n * map.block).div_ceil(shown.block));
    let mut pixels = vec![[0u8; 4]; columns * rows];
    for &pixel in &analyzed.region.pixels {
        let Some((x, y)) = (pixel % width).checked_sub(map.left).zip((pixel / width).checked_sub(map.above))
        else {
            continue;
        };
        let (col, row) = (x / map.block, y / map.block);
        if col >= map.columns || row >= map.rows {
            continue;
        }
        let Some(value) = map.values[row * map.columns + col] else { continue };
        let height = (f64::from(value) / top).clamp(0.0, 1.0);
        let [r, g, b] = ColorMap::Viridis.color(height);
        let color = match is_outline(&map, [x, y], shown.block) {
            true => [255; 4],
            false => [r, g, b, (235.0 * height.sqrt()) as u8],
        };
        pixels[y / shown.block * columns + x / shown.block] = color;
    }
    let target = words.target();
    let averaged = match map.block {
        1 => String::new(),
        block => format!(", mean over {block} x {block} pixels of the sensor"),
    };
    let (of_what, outlined) = match is_by_blocks {
        true => {
            ("of the fluorescence", "; outlined where it is above 2 % but for at most 5 % of the outlined")
        }
        false => ("of the light, on the mixture line", ""),
    };
    Some(MapOverlay {
        name: format!("{} share", target.capitalized()),
        // Who looks for targets sees them first
        is_second: !analyzed.analysis.targets.is_empty(),
        png: rgba_png(columns, rows, &pixels)?,
        frame: [
            map.left as f64 / shown.block as f64,
            map.above as f64 / shown.block as f64,
            columns as f64,
            rows as f64,
        ],
        label: format!("{target} share {of_what}"),
        limits: [0.0, top],
        caption: format!(
            "Map: {target} share {of_what}{averaged}{outlined}; no color where it is zero or no pixel counts, 98 % of the blocks are \
             below {top:.3}.",
        ),
    })
}

/// Whether a pixel of a marked block lies within a pixel of the picture from a block that is not.
fn is_outline(map: &ShareMap, [x, y]: [usize; 2], reach: usize) -> bool {
    let block = |x: isize, y: isize| {
        let side = map.block as isize;
        map.is_marked(x.div_euclid(side), y.div_euclid(side))
    };
    let (x, y, reach) = (x as isize, y as isize, reach as isize);
    let beside = [[reach, 0], [-reach, 0], [0, reach], [0, -reach]];
    block(x, y) && beside.iter().any(|[right, down]| !block(x + right, y + down))
}

/// The verdict, the truth, and what makes it uncertain. `None` where no share is estimated.
fn answer(analysis: &Analysis) -> Option<Answer> {
    let findings = region_findings(analysis);
    let words = FindingWords::of(&analysis.analyte);
    let of = |id: FindingId| findings.iter().filter(move |finding| finding.id == id);
    let of_analyte = ShareAnswer::of(&findings, &analysis.analyte)?;
    let share = answering_share(&findings)?;
    let truth = |finding: &Finding| {
        finding.reference.map_or_else(String::new, |truth| format!("True: {} %", number(100.0 * truth)))
    };
    // The sum of what the camera can't divide comes first, each estimate with its own truth
    let (asked, answer, other) = match undivided_red(&findings) {
        Some(red) => {
            let answer = ShareAnswer::of_share(red, &analysis.analyte);
            (red, answer, [of_analyte.sentence(), truth(share)].join(". "))
        }
        None => (share, of_analyte, String::new()),
    };
    let width = share.interval.map(|[low, high]| high - low).filter(|width| *width > 0.0);
    let narrower = |finding: &Finding| {
        let [low, high] = finding.interval?;
        Some((finding.name.clone()?, width? - (high - low)))
    };
    let mut budget: Vec<(String, f64)> = of(FindingId::ShareWithout).filter_map(narrower).collect();
    budget.retain(|(_, less)| width.is_some_and(|width| *less > 0.005 * width));
    let others: Vec<(String, f64)> = of(FindingId::UnmixedShare)
        .filter(|other| share.id == FindingId::UnmixedShare && other.name != share.name)
        .filter_map(|other| Some((other.name.clone()?, other.value?)))
        .collect();
    let in_percent = |part: f64| format!("{:.0} %", 100.0 * part);
    Some(Answer {
        quantity: format!(
            "{}, in frame \"{}\", {}",
            words.name(asked),
            analysis.frame,
            analysis.region_description
        ),
        value: answer.headline.replace('-', "−"),
        interval: answer.rest.replace('-', "−"),
        truth: truth(asked),
        other: other.trim_end_matches(". ").replace('-', "−"),
        budgets: vec![
            contributions("Would narrow the interval, if known:", budget, width, |less| {
                in_percent(less / width.unwrap_or(1.0))
            }),
            contributions("The other shares:", others, Some(1.0), in_percent),
            line_budget(analysis),
        ],
    })
}

/// What moves the estimate on the mixture line; without rows where that is not known.
fn line_budget(analysis: &Analysis) -> Contributions {
    let Some(budget) = analysis.budget.as_ref().filter(|_| analysis.posterior.is_none()) else {
        return Contributions::default();
    };
    let mut parts: Vec<(String, f64)> =
        budget.terms.iter().map(|item| (item.source.clone(), item.change)).collect();
    parts.push(("sensor noise, half of 95 %".into(), budget.sensor_noise));
    parts.retain(|(_, change)| change.abs() >= LEAST_CHANGE);
    let text = |change: f64| format!("{:+.2} %", 100.0 * change).replace('-', "−");
    contributions("What moves it:", parts, None, text)
}

/// The largest contributions with their texts, relative to the whole that they are parts of, or to the largest where there is none.
fn contributions(
    title: &str,
    mut all: Vec<(String, f64)>,
    whole: Option<f64>,
    text: impl Fn(f64) -> String,
) -> Contributions {
    all.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    let largest = all.first().map_or(1.0, |(_, change)| change.abs());
    let full = whole.unwrap_or(largest).max(f64::MIN_POSITIVE);
    all.truncate(CONTRIBUTIONS);
    let row =
        |(name, change): (String, f64)| Contribution { name, text: text(change), size: change.abs() / full };
    Contributions { title: title.into(), rows: all.into_iter().map(row).collect() }
}

fn cards(run: &RunResults<'_>, words: &Words<'_>) -> Vec<Number> {
    let evaluation = run.evaluation;
    let analyzed = evaluation.analysis.as_ref();
    let label = analyzed.map(|analyzed| analyzed.analysis.frame.as_str());
    let lit = |frame: &&CapturedFrame| {
        run.experiment.study.capture(&frame.raw.label).is_some_and(|c| words.lights(c) != NO_LIGHT)
    };
    let of_interest = match label {
        Some(label) => evaluation.frames.iter().find(|frame| frame.raw.label == label),
        None => evaluation.frames.iter().rfind(lit),
    };
    let mut cards = Vec::new();
    if let Some(analyzed) = analyzed {
        cards.extend(target_cards(&analyzed.analysis));
        cards.extend(detection_card(&analyzed.analysis));
        cards.extend(contrast_card(analyzed, words));
    }
    let leak =
        of_interest.and_then(|frame| evaluation.leaks.iter().find(|leak| leak.frame == frame.raw.label));
    if let Some(ratio) = leak.filter(|leak| !leak.is_reflectance()).and_then(|leak| leak.leak_ratio) {
        let place = if analyzed.is_some() { "in the region" } else { "over the whole frame" };
        let meaning = format!("reflected excitation light per fluorescence electron, {place}");
        cards.push(Number::computed("Leak", percent(ratio), "%", meaning));
    }
    if let Some(frame) = of_interest {
        cards.push(signal_card(frame, analyzed));
        let in_region = analyzed.map_or_else(String::new, |a| {
            format!(", {} of {} in the region", a.analysis.counts.saturated, a.analysis.counts.total())
        });
        // The other frames of the run clip on their own
        let others = evaluation.frames.iter().filter(|other| other.raw.label != frame.raw.label);
        let clipped = others.clone().filter(|other| other.developed.saturated.contains(&true));
        let clipped: Vec<String> =
            clipped.map(|f| format!("; \"{}\": {:.2} %", f.raw.label, percent_saturated(f))).collect();
        let others = match (others.count(), clipped.is_empty()) {
            (0, _) => String::new(),
            (_, true) => "; none in other frames".into(),
            (_, false) => clipped.concat(),
        };
        cards.push(Number::computed(
            "Clipped pixels",
            format!("{:.2}", percent_saturated(frame)),
            "%",
            format!("of frame \"{}\"{}{in_region}{others}", frame.raw.label, clipped_part(run, frame)),
        ));
    }
    cards.extend(evaluation.safety.as_ref().and_then(eye_safe_captures));
    cards
}

/// The part that shows most of the clipped pixels of a frame, of which it must be half; all teeth are one.
fn clipped_part(run: &RunResults<'_>, frame: &CapturedFrame) -> String {
    let developed = &frame.developed;
    let scene = run.components.and_then(|components| on_sensor(&run.experiment.study, components));
    let Some(scene) = scene else { return String::new() };
    let features = &scene.components.features;
    let (width, height) = (developed.width, developed.height);
    let name_at = |pixel: usize| {
        let behind = scene.scene_pixel(pixel / width, pixel % width, width, height)?;
        let part = usize::from(*features.part.get(behind)?).checked_sub(1)?;
        let name = features.part_names.get(part)?;
        Some(if name.starts_with("tooth_") { "teeth" } else { name })
    };
    let clipped = (0..width * height).filter(|pixel| developed.saturated[*pixel]);
    let mut all = 0;
    let mut by_part: BTreeMap<&str, usize> = BTreeMap::new();
    for pixel in clipped {
        all += 1;
        *by_part.entry(name_at(pixel).unwrap_or_default()).or_default() += 1;
    }
    let most = by_part.into_iter().max_by_key(|(_, count)| *count);
    let most = most.filter(|(name, count)| !name.is_empty() && 2 * count >= all);
    most.map_or_else(String::new, |(name, _)| format!(", most on {}", name.replace('_', " ")))
}

/// How well the first target is seen, in the frame that shows it best.
fn target_cards(analysis: &Analysis) -> Vec<Number> {
    let Some(first) = analysis.targets.first() else { return Vec::new() };
    let of_first = analysis.targets.iter().filter(|t| t.target == first.target);
    let Some(t) = of_first.max_by(|a, b| a.d_prime.total_cmp(&b.d_prime)) else { return Vec::new() };
    let findings = region_findings(analysis);
    let is_its = |finding: &&Finding| {
        finding.name.as_ref() == Some(&t.target) && finding.frame.as_ref() == Some(&t.frame)
    };
    let of = |id: FindingId| findings.iter().filter(is_its).find(move |finding| finding.id == id);
    let strongest = t.channels.iter().max_by(|a, b| a.cnr.total_cmp(&b.cnr));
    let contrast =
        strongest.and_then(|c| Some((c, c.contrast?))).map_or_else(String::new, |(c, contrast)| {
            format!("; contrast {contrast:+.3} in {}", c.name).replace('-', "−")
        });
    let frames = match t.frames_needed {
        Some(1) => String::new(),
        Some(count) => format!("; the mean of {count} frames shows the target itself"),
        None => "; no number of frames shows the target itself: the structure of its background stays".into(),
    };
    let render = render_noise_words(t).map_or_else(String::new, |words| format!("; {words}"));
    let mut cards = vec![Number::computed(
        format!("d' of \"{}\"", t.target),
        of(FindingId::TargetSeparation).map_or_else(|| number(t.d_prime), value),
        "",
        format!(
            "all its {} pixels in frame \"{}\", where it is seen best; {} one pixel{contrast}",
            t.pixels,
            t.frame,
            number(t.d_prime_pixel)
        ),
    )];
    cards.extend(of(FindingId::SmallestDiameter).map(|diameter| {
        let meaning = format!(
            "of a disc like \"{}\" that one frame \"{}\" shows with d' {}{frames}{render}",
            t.target, t.frame, t.wanted_d_prime
        );
        Number::computed("Smallest visible diameter", value(diameter), diameter.unit, meaning)
    }));
    cards
}

/// The smallest share that is told from the blank, and where the simulation knows the share that is there, how much of it that is. Another
/// light changes the share of the light of the same amount, so that only the latter compares lights.
fn detection_card(analysis: &Analysis) -> Option<Number> {
    if analysis.posterior.is_some() {
        let findings = region_findings(analysis);
        let of = |id: FindingId| findings.iter().find(|finding| finding.id == id);
        let (patches, evenly) = (of(FindingId::VisibleInPatches)?, of(FindingId::VisibleEvenly)?);
        let limit = patches.name.as_ref().map_or_else(String::new, |limit| format!("; limited by {limit}"));
        let meaning = format!(
            "told from none in patches over a tenth of the region; where it is spread evenly {} %{limit}",
            value(evenly)
        );
        return Some(Number::computed("Smallest share seen", value(patches), "% of the light", meaning));
    }
    let limit = analysis.detection_limit()?;
    let there = analysis.truth.as_ref().map(|truth| truth.share).filter(|share| *share > 0.0);
    let beside = match (there, &analysis.budget) {
        (Some(there), _) => format!("; {} % of the true share", percent(limit / there)),
        (None, Some(budget)) => {
            format!(", beyond the blank of {} %", number(100.0 * budget.blank)).replace('-', "−")
        }
        (None, None) => String::new(),
    };
    let meaning = format!("smallest share above sensor noise{beside}");
    Some(Number::computed("Detection limit", number(100.0 * limit), "% of the light", meaning))
}

/// How far light with and without the fluorophore lie apart, or two spots.
fn contrast_card(analyzed: &AnalyzedFrame, words: &Words<'_>) -> Option<Number> {
    let analysis = &analyzed.analysis;
    // The channels that tell them apart best
    let spots =
        region_findings(analysis).into_iter().filter(|finding| finding.id == FindingId::SpotSeparation);
    let best = spots.max_by(|a, b| a.value.unwrap_or(0.0).total_cmp(&b.value.unwrap_or(0.0)));
    if let Some(spot) = best {
        let meaning =
            format!("per pixel between the two spots, by {}", spot.name.as_deref().unwrap_or_default());
        return Some(Number::computed("d'", value(&spot), "", meaning));
    }
    if analysis.posterior.is_some() {
        return None;
    }
    let porphyrin = analyzed.porphyrin.as_ref()?;
    let errors = analyzed.region.pixels.iter().filter_map(|&pixel| porphyrin.at(pixel));
    let error = Statistics::of(errors.map(|e| e.position_standard_error))?.median;
    let position = analysis.mixture.as_ref()?.region?.estimate.position;
    let (distance, of) = match &analysis.budget {
        Some(budget) => (budget.share - budget.blank, "the region with and without it"),
        None => (position, "the region's share and none"),
    };
    let name = format!("d' of the {}", words.target());
    if distance <= 0.0 {
        // A distance has no sign: the pixels look no more like the fluorophore than those without it
        let from = if analysis.budget.is_some() { "above the blank" } else { "above zero" };
        let share = format!("{position:.4}").replace('-', "−");
        let meaning =
            format!("one pixel; the share on the mixture line, {share}, is not {from}, so nothing is seen");
        return Some(Number::computed(name, "0", "", meaning));
    }
    let meaning = format!("one pixel, between {of}; {} pixels averaged: {:.1}", 100, 10.0 * distance / error);
    Some(Number::computed(name, format!("{:.2}", distance / error), "", meaning))
}

/// Electrons and signal-to-noise ratio of a pixel, by channel. The median is that of all pixels: the unsaturated ones of a region that is
/// saturated are its dim rim. Where half of the pixels are saturated, it is no more than a lower limit.
fn signal_card(frame: &CapturedFrame, analyzed: Option<&AnalyzedFrame>) -> Number {
    let per_electron = frame.raw.dn_per_electron.max(f64::MIN_POSITIVE);
    let developed = &frame.developed;
    let n = developed.channels.len();
    let pixels = match analyzed {
        Some(analyzed) => analyzed.region.pixels.clone(),
        None => (0..developed.saturated.len()).collect(),
    };
    let saturated = pixels.iter().filter(|&&pixel| developed.saturated.get(pixel) == Some(&true)).count();
    let counts = ExclusionCounts { saturated, valid: pixels.len() - saturated, ..Default::default() };
    let is_limit = saturated > 0 && 2 * saturated >= pixels.len();
    let (mut names, mut signal, mut snr) = (Vec::new(), Vec::new(), Vec::new());
    for (c, name) in developed.channels.iter().enumerate() {
        let values = pixels.iter().filter_map(|&pixel| developed.data.get(pixel * n + c));
        let Some(statistics) = Statistics::of(values.map(|&v| f64::from(v))) else { continue };
        let median = statistics.median.max(0.0);
        let variance = match analyzed {
            Some(analyzed) => analyzed.analysis.settings.noise.variance(median),
            None => developed.noise_floor_dn.powi(2) + per_electron * median,
        };
        names.push(name.as_str());
        signal.push(electrons(median / per_electron));
        snr.push(format!("{:.1}", median / variance.sqrt().max(f64::MIN_POSITIVE)));
    }
    let place = analyzed.map_or("whole frame", |_| "region");
    let mut meaning = format!("median pixel of the {place}, {}", names.join(", "));
    match is_limit {
        true => meaning += "; it is saturated, so there is no signal to noise",
        false => meaning += &format!("; signal to noise {}", snr.join(", ")),
    }
    if let Some(share) = counts.saturated_share() {
        meaning += &format!("; {:.0} % of the {place} is saturated", 100.0 * share);
    }
    if frame.raw.gain_is_assumed {
        meaning += &format!("; {ASSUMED_GAIN}");
    }
    let at_least = if is_limit { "at least " } else { "" };
    Number::computed("Signal", format!("{at_least}{}", signal.join(", ")), "e-", meaning)
}

/// Which spectra of fluorophores are models, and which are measured, in a file that the experiment read; of these the yields that are stated.
fn spectra_rest_on(
    fluorophores: &[Fluorophore],
    inputs: &[InputFile],
    sections: &[FluorophoreSection],
) -> Vec<String> {
    let file = |fluorophore: &Fluorophore| {
        let source = Path::new(&fluorophore.source);
        let file = inputs.iter().map(|input| input.path.as_path()).find(|path| *path == source)?;
        Some(file.file_name().unwrap_or(file.as_os_str()).to_string_lossy().into_owned())
    };
    let mut sentences = Vec::new();
    let models = fluorophores.iter().filter(|fluorophore| file(fluorophore).is_none()).count();
    if models > 0 {
        let noun = if models == 1 { "one fluorophore" } else { &format!("{models} fluorophores") };
        sentences
            .push(format!("Spectra and yields of {noun} are models; ratios are more reliable than levels."));
    }
    let measured: Vec<String> =
        fluorophores.iter().filter_map(|f| Some(format!("{} ({})", f.title, file(f)?))).collect();
    if !measured.is_empty() {
        let stated = fluorophores.iter().filter(|f| file(f).is_some()).filter_map(|f| {
            let photon_yield = sections.iter().find(|section| section.name == f.name)?.photon_yield?;
            let assumed = (photon_yield == ASSUMED_PHOTON_YIELD)
                .then_some(", which `fluorophore import` assumes where none is given");
            Some(format!("{} {photon_yield}{}", f.title, assumed.unwrap_or_default()))
        });
        let stated: Vec<String> = stated.collect();
        let stated = if stated.is_empty() { String::new() } else { format!(" ({})", stated.join(", ")) };
        sentences.push(format!(
            "Measured spectra: {}; photons out per photon in as the experiment states{stated}.",
            measured.join(", ")
        ));
    }
    sentences
}

/// What the spectra of a scene rest on.
pub(crate) fn scene_rests_on(experiment: &ResolvedExperiment) -> Vec<String> {
    let record = &experiment.record;
    let file = record.experiment.as_deref();
    let sections = file.map_or(&[][..], |file| &file.fluorophore);
    let mut sentences = spectra_rest_on(&experiment.study.scene.fluorophores, &record.inputs, sections);
    sentences.extend(file.and_then(assumed_blocking_in_short));
    sentences
}

/// What the numbers rest on.
fn assumed(run: &RunResults<'_>, words: &Words<'_>) -> Vec<String> {
    let mut sentences = Vec::new();
    let powers = words.powers();
    if !powers.is_empty() {
        sentences.push(format!("Powers of lights before filters, as stated ({}).", powers.join(", ")));
    }
    sentences.extend(scene_rests_on(run.experiment));
    if let Some(efficiency) = words.efficiency() {
        sentences.push(format!("Quantum efficiency: {efficiency}."));
    }
    if let Some(posterior) = run.evaluation.analysis.as_ref().and_then(|a| a.analysis.posterior.as_ref()) {
        sentences.push(format!("Tissue: {}.", posterior.prior));
    }
    sentences
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::atomic::AtomicBool;

    use fluorspar::{pipeline, render};
    use fluorspar_experiment::{parse, resolve};

    use fluorspar::findings::Caveat;

    use super::super::regions_section::regions_matrix;
    use super::*;

    /// The signal of a patch does not fall when its exposure grows until it clips, and nothing tells the noise of what clips.
    #[test]
    fn a_saturated_region_is_not_told_as_a_dim_one() {
        let changes = ["sensor.columns=64", "sensor.rows=48"].map(String::from);
        let text = "format = 1\nbase = \"flat-patch\"";
        let experiment = resolve(&parse(text, "patch", Path::new("."), &changes).unwrap()).unwrap();
        let study = &experiment.study;
        let control = render::RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
        let components = render::render(&study.scene, &study.render, &control).unwrap();
        let evaluation = pipeline::evaluate(study, &components).unwrap();
        let mut analyzed = evaluation.analysis.unwrap();
        let label = analyzed.analysis.frame.clone();
        let mut frame = evaluation.frames.into_iter().find(|frame| frame.raw.label == label).unwrap();
        let first = |card: &Number| -> f64 {
            let value = card.value.trim_start_matches("at least ");
            value.split(", ").next().unwrap().parse().unwrap()
        };
        let seen = signal_card(&frame, Some(&analyzed));
        assert!(seen.meaning.contains("signal to noise ") && !seen.meaning.contains("saturated"), "{seen:?}");
        let red = |analysis: &Analysis, id: FindingId| {
            let is_red = |finding: &Finding| finding.id == id && finding.channel.as_deref() == Some("R");
            region_findings(analysis).into_iter().find(is_red)
        };
        let seen_level = red(&analyzed.analysis, FindingId::MedianSignal).unwrap();
        assert!(!seen_level.has(&Caveat::LowerLimit), "{seen_level:?}");
        assert!(red(&analyzed.analysis, FindingId::PixelSnr).is_some());

        // A distance has no sign, and a share below the blank is none at all
        let words = Words::of(&experiment);
        let there = contrast_card(&analyzed, &words).unwrap();
        assert!(there.value.parse::<f64>().unwrap() > 0.0, "{there:?}");
        let mut below = analyzed.clone();
        let budget = below.analysis.budget.as_mut().unwrap();
        budget.share = budget.blank - 0.01;
        let card = contrast_card(&below, &words).unwrap();
        assert!(
            card.value == "0" && card.meaning.contains("is not above the blank, so nothing is seen"),
            "{card:?}"
        );

        // Nine of ten pixels clip, at levels that the others keep below
        let n = frame.developed.channels.len();
        let full = frame.developed.full_scale_dn as f32;
        let pixels = analyzed.region.pixels.clone();
        for &pixel in pixels.iter().filter(|&&pixel| pixel % 10 != 0) {
            frame.developed.saturated[pixel] = true;
            frame.developed.data[pixel * n..][..n].fill(full);
        }
        let saturated = pixels.iter().filter(|&&pixel| pixel % 10 != 0).count();
        analyzed.analysis.counts =
            ExclusionCounts { saturated, valid: pixels.len() - saturated, ..Default::default() };
        let clipped = signal_card(&frame, Some(&analyzed));
        assert!(clipped.value.starts_with("at least ") && first(&clipped) > first(&seen), "{clipped:?}");
        assert!(clipped.meaning.contains("90 % of the region is saturated"), "{clipped:?}");
        assert!(!clipped.meaning.contains("signal to noise "), "{clipped:?}");
        // Neither the table of regions nor a comparison takes the rim for the region
        analyzed.analysis.channels[0].median_of_all = Some(f64::from(full));
        let full_level = red(&analyzed.analysis, FindingId::MedianSignal).unwrap();
        assert!(full_level.has(&Caveat::LowerLimit) && full_level.value > seen_level.value, "{full_level:?}");
        assert_eq!(red(&analyzed.analysis, FindingId::PixelSnr), None);
        // Results of older versions have the median of the others alone
        analyzed.analysis.channels[1].median_of_all = None;
        let signals =
            region_findings(&analyzed.analysis).into_iter().filter(|f| f.id == FindingId::MedianSignal);
        assert_eq!(signals.count(), 2);
        let main = &analyzed.analysis;
        let lip = pipeline::AnalyzedRegion { name: "lip".into(), analyzed: Ok(analyzed.clone()) };
        let matrix = regions_matrix(&experiment, main, &[lip]).unwrap();
        assert!(
            matrix.rows.iter().all(|row| row
                .iter()
                .any(|cell| cell.starts_with("at least ") && cell.ends_with("(90 % saturated)"))),
            "{matrix:?}"
        );
        assert!(matrix.columns.iter().all(|column| !column.starts_with("signal to noise")), "{matrix:?}");
    }

    #[test]
    fn only_models_are_called_models() {
        let text = "format = 1\nbase = \"flat-patch\"";
        let experiment = resolve(&parse(text, "patch", Path::new("."), &[]).unwrap()).unwrap();
        let [mut dye, model] = [0, 1].map(|k| experiment.study.scene.fluorophores[k].clone());
        dye.title = "my dye".into();
        dye.source = "/data/dye.csv".into();
        let inputs = [InputFile { path: "/data/dye.csv".into(), sha256: String::new() }];
        let measured =
            "Measured spectra: my dye (dye.csv); photons out per photon in as the experiment states";
        assert_eq!(spectra_rest_on(std::slice::from_ref(&dye), &inputs, &[]), [format!("{measured}.")]);
        // A yield that import assumed is told as such, a stated one by its number
        let told = |photon_yield: f64| {
            let text = format!("name = \"{}\"\nsource = \"nadh\"\nphoton_yield = {photon_yield:?}", dye.name);
            let section: FluorophoreSection = fluorspar_format::read_toml(&text).unwrap();
            spectra_rest_on(std::slice::from_ref(&dye), &inputs, &[section]).remove(0)
        };
        let assumed = " (my dye 0.001, which `fluorophore import` assumes where none is given).";
        assert_eq!(told(0.001), format!("{measured}{assumed}"));
        assert_eq!(told(0.2), format!("{measured} (my dye 0.2)."));
        let both = spectra_rest_on(&[dye, model], &inputs, &[]);
        assert!(
            both[0].starts_with("Spectra and yields of one fluorophore are models")
                && both[1] == format!("{measured}.")
        );
    }

    /// The limit of the share itself is lowest under the light that excites porphyrin least: at 450 nm a share of the light holds more
    /// porphyrin than at 405 nm. Relative to the share that is there the limits stand in the order in which the lights show it.
    #[test]
    fn the_detection_limit_ranks_lights_as_they_show_porphyrin() {
        let under = |light: &str| {
            let changes = [
                format!("light.blue.spectrum={light}"),
                "light.blue.filters=[]".into(),
                "sensor.columns=64".into(),
                "sensor.rows=48".into(),
            ];
            let text = "format = 1\nbase = \"flat-patch\"";
            let study = resolve(&parse(text, "patch", Path::new("."), &changes).unwrap()).unwrap().study;
            let control = render::RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
            let components = render::render(&study.scene, &study.render, &control).unwrap();
            let analysis = pipeline::evaluate(&study, &components).unwrap().analysis.unwrap().analysis;
            let card = detection_card(&analysis).unwrap();
            let limit = analysis.budget.unwrap().detection_limit;
            assert!(card.value == number(100.0 * limit), "{card:?}");
            let of_truth = card.meaning.split(" % of the true share").next().unwrap();
            (limit, of_truth.rsplit(' ').next().unwrap().parse::<f64>().unwrap())
        };
        let (by_385, by_405, by_450) = (under("led_385"), under("led_405"), under("led_450"));
        assert!(by_450.0 < by_385.0 && by_385.0 < by_405.0, "{by_385:?} {by_405:?} {by_450:?}");
        assert!(by_405.1 < by_385.1 && by_385.1 < by_450.1, "{by_385:?} {by_405:?} {by_450:?}");
    }
}
