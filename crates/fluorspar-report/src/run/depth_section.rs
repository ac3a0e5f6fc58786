//! Depths of fluorescence in the report.

use fluorspar::pipeline::DepthOfLight;

use super::RunResults;
use crate::figures::light_sources_by_depth;
use crate::{Figure, Number, NumberTable, ReportItem, Section};

/// From how deep the fluorescence comes that each channel sees, and the figure of the analyzed tissue; nothing without layered
/// tissue.
pub(super) fn depth_section(run: &RunResults<'_>) -> Option<(Section, Option<Figure>)> {
    let depths = &run.evaluation.depths;
    let analyzed = analyzed_tissue(run)?;
    let of_tissue: Vec<&DepthOfLight> = depths.iter().filter(|depth| depth.tissue == analyzed).collect();
    let note = brief(&of_tissue);
    let note = format!("half from above, in {}: {}", analyzed.replace('_', " "), note);
    let mut section = Section::new("From how deep the light of each channel comes").folded(note).say(
        "Light enters the tissue, is scattered and absorbed, and excites fluorophores on its way; what they give off has to find its \
         way out. Half of the fluorescence that a channel sees comes from above the median depth, nine tenths from above the second \
         one. Each tissue in its mean state over its surfaces, under the direct light, weighted by filters and quantum efficiency.",
    );
    let own: Vec<&DepthOfLight> = depths.iter().filter(|depth| depth.tissue == analyzed).collect();
    if let Some(sentence) = deepest_and_shallowest(&own) {
        section = section.say(sentence);
    }
    let frame = shown_frame(run, &own);
    let mut rows = Vec::new();
    for depth in &own {
        rows.push(depth_row(&format!("Frame \"{}\": {}", depth.frame, depth.channel), depth));
        rows.extend(depth.layers.iter().map(|layer| {
            Number::computed(
                format!("Frame \"{}\": {} from the {}", depth.frame, depth.channel, layer.name),
                format!("{:.0}", 100.0 * layer.share),
                "%",
                "share of this layer in the fluorescence of the channel",
            )
        }));
    }
    let caption = format!("Tissue \"{analyzed}\"");
    section = section.with(ReportItem::Table(NumberTable { caption, rows }));
    let others: Vec<Number> = depths
        .iter()
        .filter(|depth| depth.tissue != analyzed && depth.frame == frame)
        .map(|depth| depth_row(&format!("{}: {}", depth.tissue, depth.channel), depth))
        .collect();
    if !others.is_empty() {
        let caption = format!("Other tissues, frame \"{frame}\"");
        section = section.with(ReportItem::Table(NumberTable { caption, rows: others }));
    }
    Some((section, figure(run, &own, frame)))
}

/// Median depths of some channels, each frame by its name where there are several.
fn brief(depths: &[&DepthOfLight]) -> String {
    let several = frames_differ(depths);
    depths.iter().take(3).map(|depth| brief_of(depth, several)).collect::<Vec<_>>().join(", ")
}

fn frames_differ(depths: &[&DepthOfLight]) -> bool {
    depths.windows(2).any(|pair| pair[0].frame != pair[1].frame)
}

/// The median depth of a channel, of a frame that is named where there are several.
fn brief_of(depth: &DepthOfLight, several_frames: bool) -> String {
    match several_frames {
        true => format!("{} of frame \"{}\" {:.0} µm", depth.channel, depth.frame, depth.median_um),
        false => format!("{} {:.0} µm", depth.channel, depth.median_um),
    }
}

/// The frame that the figure shows: the analyzed one, else the first.
fn shown_frame<'d>(run: &RunResults<'_>, depths: &[&'d DepthOfLight]) -> &'d str {
    let analyzed = run.experiment.study.analysis.as_ref().map(|analysis| analysis.frame.as_str());
    let own = depths.iter().find(|depth| Some(depth.frame.as_str()) == analyzed);
    own.or(depths.first()).map_or("", |depth| depth.frame.as_str())
}

/// Medians that are this close, relative to the deeper one, are about the same: tissue is not known any better.
const SAME_DEPTH: f64 = 0.02;

/// Which channel sees deepest and which least deep, in a sentence; `None` of one alone.
fn deepest_and_shallowest(depths: &[&DepthOfLight]) -> Option<String> {
    let by_median = |a: &&&DepthOfLight, b: &&&DepthOfLight| a.median_um.total_cmp(&b.median_um);
    let (deep, shallow) = (depths.iter().max_by(by_median)?, depths.iter().min_by(by_median)?);
    if depths.len() < 2 {
        return None;
    }
    let [deepest, least] = [deep, shallow].map(|depth| brief_of(depth, frames_differ(depths)));
    Some(match deep.median_um - shallow.median_um > SAME_DEPTH * deep.median_um {
        true => format!("By the medians {deepest} comes from deepest here and {least} from least deep."),
        false => format!("All come from about the same depth here: {least} to {deepest}."),
    })
}

/// The tissue of the analyzed region, otherwise the first one.
fn analyzed_tissue<'r>(run: &RunResults<'r>) -> Option<&'r str> {
    let depths = &run.evaluation.depths;
    let parts = run.experiment.study.analysis.as_ref().map_or(&[][..], |analysis| &analysis.parts);
    let of_region = depths.iter().find(|depth| depth.parts.iter().any(|part| parts.contains(part)));
    of_region.or(depths.first()).map(|depth| depth.tissue.as_str())
}

fn depth_row(name: &str, depth: &DepthOfLight) -> Number {
    Number::computed(
        name,
        format!("{:.0} / {:.0}", depth.median_um, depth.depth_90_um),
        "µm",
        format!("half and nine tenths of the fluorescence come from above; mean {:.0} µm", depth.mean_um),
    )
}

/// Share of the light from above each depth, by channel, with the layers of the tissue.
fn figure(run: &RunResults<'_>, depths: &[&DepthOfLight], frame: &str) -> Option<Figure> {
    let name = &depths.first()?.tissue;
    let tissue = &run.experiment.study.tissues.iter().find(|known| known.name == *name)?.tissue;
    let bottoms = tissue.bottoms_um();
    let of_frame = depths.iter().filter(|depth| depth.frame == frame);
    let channels = of_frame.map(|depth| (depth.channel.clone(), cumulative(depth, &bottoms)));
    let title = format!("{}, frame \"{frame}\"", name.replace('_', " "));
    Some(light_sources_by_depth(&title, &channels.collect::<Vec<_>>(), &bottoms))
}

/// The share of the light from above each depth, um: at the quantiles, and at the interfaces, where lines bend.
fn cumulative(depth: &DepthOfLight, bottoms: &[(f64, String)]) -> Vec<[f64; 2]> {
    let last = depth.quantiles_um.len().saturating_sub(1).max(1) as f64;
    let quantiles = depth.quantiles_um.iter().enumerate();
    let mut points: Vec<[f64; 2]> = quantiles.map(|(place, um)| [*um, place as f64 / last]).collect();
    let mut above = 0.0;
    points.extend(bottoms.iter().zip(&depth.layers).map(|((bottom_um, _), layer)| {
        above += layer.share;
        [*bottom_um, above]
    }));
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points
}

#[cfg(test)]
mod tests {
    use fluorspar::pipeline::LayerShare;

    use super::*;

    #[test]
    fn depths_of_several_frames_name_them() {
        let depth = |frame: &str, median_um| DepthOfLight {
            frame: frame.into(),
            channel: "mono".into(),
            tissue: "tongue".into(),
            parts: Vec::new(),
            mean_um: median_um,
            median_um,
            depth_90_um: median_um,
            quantiles_um: Vec::new(),
            layers: Vec::new(),
        };
        let [green, red] = [depth("green_band", 276.0), depth("red_band", 278.0)];
        assert_eq!(brief(&[&green]), "mono 276 µm");
        assert_eq!(
            brief(&[&green, &red]),
            "mono of frame \"green_band\" 276 µm, mono of frame \"red_band\" 278 µm"
        );
        // What is said of them follows from the numbers
        let said = deepest_and_shallowest(&[&green, &red]).unwrap();
        assert!(said.starts_with("All come from about the same depth here"), "{said}");
        let channel =
            |name: &str, median_um| DepthOfLight { channel: name.into(), ..depth("blue", median_um) };
        let [r, g, b] = [channel("R", 269.0), channel("G", 284.0), channel("B", 240.0)];
        assert_eq!(
            deepest_and_shallowest(&[&r, &g, &b]).unwrap(),
            "By the medians G 284 µm comes from deepest here and B 240 µm from least deep."
        );
        assert_eq!(deepest_and_shallowest(&[&r]), None);
    }

    #[test]
    fn lines_bend_at_the_interfaces_of_layers() {
        let layer = |name: &str, share| LayerShare { name: name.into(), share };
        let depth = DepthOfLight {
            frame: String::new(),
            channel: "R".into(),
            tissue: String::new(),
            parts: Vec::new(),
            mean_um: 90.0,
            median_um: 90.0,
            depth_90_um: 170.0,
            quantiles_um: vec![0.0, 90.0, 190.0],
            layers: vec![layer("biofilm", 0.17), layer("stroma", 0.83)],
        };
        let points = cumulative(&depth, &[(20.0, "biofilm".into()), (2000.0, "stroma".into())]);
        assert_eq!(points, [[0.0, 0.0], [20.0, 0.17], [90.0, 0.5], [190.0, 1.0], [2000.0, 1.0]]);
    }
}
