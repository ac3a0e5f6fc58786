//! Several regions of one frame, a row each.

use fluorspar::analysis::{Analysis, PixelSelection};
use fluorspar::findings::{Caveat, Finding, FindingId, region_findings};
use fluorspar::pipeline::AnalyzedRegion;
use fluorspar_experiment::{ResolvedExperiment, Warning};

use super::RunResults;
use super::words::Words;
use crate::findings::{ASSUMED_GAIN, answering_share, number, value};
use crate::{NumberMatrix, ReportItem, Section};

/// The regions with that of the analysis; `None` where there is no other.
pub(super) fn regions_section(run: &RunResults<'_>) -> Option<Section> {
    let main = &run.evaluation.analysis.as_ref()?.analysis;
    let regions = &run.evaluation.regions;
    let matrix = regions_matrix(run.experiment, main, regions)?;
    // The folded section tells the estimates, the first thing that a reader wants of a region
    let brief = |region: &AnalyzedRegion| match region.in_view().map(|seen| share_text(&seen.analysis)) {
        Some(Some((share, _))) => format!("{} {share}", region.name),
        Some(None) => region.name.clone(),
        None => format!("{} {NOT_IN_VIEW}", region.name),
    };
    let list = regions.iter().map(brief).collect::<Vec<_>>().join("; ");
    let note = match matrix.columns.iter().any(|column| column.starts_with(SHARE)) {
        true => format!("{} share, %: {list}", Words::of(run.experiment).target()),
        false => list,
    };
    Some(Section::new("Regions").folded(note).with(ReportItem::Matrix(matrix)))
}

/// The regions of a frame, a row each, that of the analysis first: estimate, truth where it is known, detection limit, signal. `None`
/// where there is no other.
#[must_use]
pub fn regions_matrix(
    experiment: &ResolvedExperiment,
    main: &Analysis,
    regions: &[AnalyzedRegion],
) -> Option<NumberMatrix> {
    if regions.is_empty() {
        return None;
    }
    let words = Words::of(experiment);
    let of_region = |region: &AnalyzedRegion| {
        let plan = experiment.study.regions.iter().find(|plan| plan.name == region.name);
        let own = plan.filter(|plan| plan.analysis.porphyrin.is_some());
        // Another fluorophore than that of the analysis is named
        let name = match own.map(|plan| experiment.study.analyte(&plan.analysis)) {
            Some(own) if words.wanted().as_ref() != Some(&own) => format!("{} ({own})", region.name),
            _ => region.name.clone(),
        };
        match region.in_view() {
            Some(seen) => row(&name, &seen.analysis),
            None => row_out_of_view(&name),
        }
    };
    let mut rows: Vec<Vec<String>> =
        std::iter::once(row(&main.region_description, main)).chain(regions.iter().map(of_region)).collect();
    let share = share_heading(main, regions);
    let channels: Vec<&str> = main.channels.iter().map(|channel| channel.name.as_str()).collect();
    let channels = channels.join(", ");
    let mut columns: Vec<String> =
        ["Region", "pixels", &share, "true share, %", "smallest share seen, %"].map(String::from).into();
    columns.extend([format!("signal {channels}, e-"), format!("signal to noise {channels}")]);
    // What no region has needs no column
    let is_there: Vec<bool> = (0..columns.len()).map(|k| rows.iter().any(|row| row[k] != NOTHING)).collect();
    let of_interest = |row: Vec<String>| {
        row.into_iter().zip(&is_there).filter(|(_, is_there)| **is_there).map(|(cell, _)| cell).collect()
    };
    rows = rows.into_iter().map(of_interest).collect();
    let columns: Vec<String> = of_interest(columns);
    let mut note = String::new();
    if columns.contains(&share) {
        note += &format!(
            "{} share of the light of each region, where its tissue is known for all that is not known of it, else on the mixture line. ",
            words.target().capitalized()
        );
    }
    note += "Signal and signal to noise are those of the median pixel, saturated ones included: a lower limit where half of them are.";
    if main.gain_is_assumed {
        note += &format!(" Both {ASSUMED_GAIN}.");
    }
    Some(NumberMatrix { caption: format!("Regions of frame \"{}\"", main.frame), columns, rows, note })
}

/// Heading of the column of estimates, before what their intervals hold.
const SHARE: &str = "share, % (95 %";

/// The heading with what the intervals hold: the sensor's noise alone, or in all what moves the estimate.
fn share_heading(main: &Analysis, regions: &[AnalyzedRegion]) -> String {
    let all =
        std::iter::once(main).chain(regions.iter().filter_map(|region| Some(&region.in_view()?.analysis)));
    let kinds: Vec<bool> = all.filter_map(share_text).map(|(_, noise_alone)| noise_alone).collect();
    match (kinds.contains(&true), kinds.contains(&false)) {
        (true, false) => format!("{SHARE} by sensor noise alone)"),
        (false, _) => format!("{SHARE} in all)"),
        (true, true) => {
            format!("{SHARE} in all, or by sensor noise alone where no tissue or budget is known)")
        }
    }
}

/// What stands where a region has no such number.
const NOTHING: &str = "-";
/// What stands in place of the pixels of a region that no pixel shows.
const NOT_IN_VIEW: &str = "not in view";

/// What the analyses of further regions warn of, each once, and not what that of the frame says already; and which are not in view.
#[must_use]
pub fn region_warnings(main: &Analysis, regions: &[AnalyzedRegion]) -> Vec<Warning> {
    let of_region = |region: &AnalyzedRegion| {
        let about = format!("Region \"{}\"", region.name);
        match &region.analyzed {
            Ok(seen) => {
                let own = seen.analysis.warnings.iter().filter(|warning| !main.warnings.contains(warning));
                own.map(|warning| warning.about(&about)).collect::<Vec<_>>()
            }
            Err(why) => vec![Warning::from(format!("{NOT_IN_VIEW}: {why}")).about(&about)],
        }
    };
    regions.iter().flat_map(of_region).collect()
}

/// The estimate as tables have it, and whether its interval holds the sensor's noise alone.
fn share_text(analysis: &Analysis) -> Option<(String, bool)> {
    let findings = region_findings(analysis);
    let share = answering_share(&findings)?;
    Some((value(share), share.has(&Caveat::SensorNoiseAlone)))
}

fn row(name: &str, analysis: &Analysis) -> Vec<String> {
    let findings = region_findings(analysis);
    // Those of the frame of the analysis
    let of = |id: FindingId| {
        let is_its = |finding: &&Finding| {
            finding.id == id && finding.frame.as_ref().is_none_or(|frame| *frame == analysis.frame)
        };
        let alone = |finding: &Finding| {
            let keep = |caveat: &Caveat| !matches!(caveat, Caveat::Saturated(_));
            let caveats = finding.caveats.iter().filter(|caveat| keep(caveat)).cloned().collect();
            value(&Finding { caveats, ..finding.clone() })
        };
        let texts: Vec<String> = findings.iter().filter(is_its).map(alone).collect();
        if texts.is_empty() { NOTHING.into() } else { texts.join(", ") }
    };
    let truth =
        findings.iter().find(|finding| finding.id == FindingId::TrueShare).and_then(|truth| truth.value);
    let truth = truth.map_or_else(|| NOTHING.into(), |share| number(100.0 * share));
    let saturated = analysis.counts.saturated_share();
    let saturated =
        saturated.map_or_else(String::new, |share| format!(" ({:.0} % saturated)", 100.0 * share));
    let signal = match of(FindingId::MedianSignal) {
        nothing if nothing == NOTHING => nothing,
        // Once is enough
        limits if limits.contains(AT_LEAST) => {
            format!("{AT_LEAST}{}{saturated}", limits.replace(AT_LEAST, ""))
        }
        signal => signal + &saturated,
    };
    vec![
        name.to_owned(),
        analysis.counts.total().to_string(),
        answering_share(&findings).map_or_else(|| NOTHING.into(), value),
        truth,
        match of(FindingId::VisibleInPatches) {
            nothing if nothing == NOTHING => of(FindingId::DetectionLimit),
            seen => seen,
        },
        signal,
        of(FindingId::PixelSnr),
    ]
}

/// What stands before a lower limit.
const AT_LEAST: &str = "at least ";

fn row_out_of_view(name: &str) -> Vec<String> {
    let rest = std::iter::repeat_n(NOTHING, 5);
    [name, NOT_IN_VIEW].into_iter().chain(rest).map(String::from).collect()
}

/// Share of a frame by which a name keeps away from its sides, and from its upper and lower edge, where it would be cut off.
const NAME_MARGIN: [f64; 2] = [0.1, 0.05];

/// Where the name of a region stands in a frame, in pixels divided by `block`: the middle of its longest row of pixels, which lies within it
/// whatever its shape. Rows at the rim of the frame count where there are no others.
fn label_place(region: &PixelSelection, block: usize) -> Option<[f64; 2]> {
    let joins = |a: &usize, b: &usize| *b == *a + 1 && !b.is_multiple_of(region.width);
    let middle = |run: &[usize]| {
        let middle = run[run.len() / 2];
        [middle % region.width, middle / region.width].map(|at| at as f64 + 0.5)
    };
    let is_inner = |run: &[usize]| {
        let sides = [region.width, region.height].map(|side| side as f64);
        let at = middle(run);
        (0..2).all(|axis| {
            let margin = NAME_MARGIN[axis] * sides[axis];
            (margin..=sides[axis] - margin).contains(&at[axis])
        })
    };
    let rank = |run: &[usize]| (is_inner(run), run.len());
    let best =
        region.pixels.chunk_by(joins).reduce(|best, run| if rank(run) > rank(best) { run } else { best })?;
    Some(middle(best).map(|at| at / block as f64))
}

/// Names and places of all regions, that of the analysis by its description; none where it is alone.
pub(super) fn region_names(
    main: (&str, &PixelSelection),
    regions: &[AnalyzedRegion],
    block: usize,
) -> Vec<(String, [f64; 2])> {
    if regions.is_empty() {
        return Vec::new();
    }
    let others = regions.iter().filter_map(|region| Some((region.name.as_str(), &region.in_view()?.region)));
    let all = std::iter::once(main).chain(others);
    all.filter_map(|(name, region)| Some((name.to_owned(), label_place(region, block)?))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stand_within_their_regions() {
        // A ring: its middle is not of it
        let (width, height) = (9, 7);
        let is_rim =
            |p: &usize| [0, width - 1].contains(&(p % width)) || [0, height - 1].contains(&(p / width));
        let pixels: Vec<usize> = (0..width * height).filter(is_rim).collect();
        let ring = PixelSelection { width, height, pixels };
        let [x, y] = label_place(&ring, 1).unwrap();
        assert!(is_rim(&(y as usize * width + x as usize)), "{x} {y}");
        assert_eq!(label_place(&ring, 1), Some([4.5, 0.5]));
        // A long row at the very edge of a frame, and a short one inside: the name is not cut off
        let row = |y: usize, from: usize, to: usize| (y * 100 + from)..(y * 100 + to);
        let pixels: Vec<usize> = row(60, 40, 50).chain(row(99, 20, 80)).collect();
        let lip = PixelSelection { width: 100, height: 100, pixels };
        assert_eq!(label_place(&lip, 2), Some([22.75, 30.25]));
        let edge = PixelSelection { width: 100, height: 100, pixels: row(99, 20, 80).collect() };
        assert_eq!(label_place(&edge, 1), Some([50.5, 99.5]));
        assert_eq!(label_place(&PixelSelection { width, height, pixels: Vec::new() }, 1), None);
    }
}
