//! An analysis in plain words.

use fluorspar::analysis::{Analysis, TargetDetection};
use fluorspar::findings::{Finding, FindingId, region_findings};

use super::report_data::{NumberMatrix, ReportItem, Section};
use crate::FrameOrigin;
use crate::findings::{ASSUMED_GAIN, FindingWords, PIXELS, TABLES, matrix, number, render_noise};

/// One analysis: its figures first, then the tables: chromaticity, signals and targets, porphyrin share, predicted fluorophores, pixels
/// used and levels.
pub fn analysis_section(analysis: &Analysis, figures: Vec<ReportItem>, from: FrameOrigin) -> Section {
    let how = match from {
        FrameOrigin::Simulated => "the simulated sensor image, in the way they would be from a recorded one",
        FrameOrigin::Given => "recorded frames",
    };
    // Say what a camera would not have
    let known: Vec<&str> = [
        analysis.mixture.as_ref().map(|_| "the ends of the line"),
        analysis.truth.as_ref().map(|_| "the true share"),
        analysis.budget.as_ref().map(|_| "what moves the estimate"),
    ]
    .into_iter()
    .flatten()
    .collect();
    let known = match from {
        FrameOrigin::Simulated if analysis.truth.is_some() || analysis.budget.is_some() => {
            format!(" From the render, which no camera has, come {}.", known.join(", "))
        }
        _ => String::new(),
    };
    let mut section = Section::new(format!("What the frame \"{}\" says", analysis.frame)).say(format!(
        "Region: {}. Levels, colors and estimates are computed from {how}.{known}",
        analysis.region_description
    ));
    section.items.extend(figures);
    let (findings, words) = (region_findings(analysis), FindingWords::of(&analysis.analyte));
    let (colors, others) = TABLES.split_at(1);
    section.items.extend(colors.iter().filter_map(|table| table.of(&findings, &words)));
    if analysis.signals.is_some() {
        section = section.with(ReportItem::Matrix(signal_matrix(&findings, analysis.gain_is_assumed)));
    }
    if !analysis.targets.is_empty() {
        section = section.with(ReportItem::Matrix(target_matrix(&findings, &analysis.targets)));
    }
    section.items.extend(others.iter().filter_map(|table| table.of(&findings, &words)));
    if let Some(posterior) = &analysis.posterior {
        section = section.say(format!("Assumed of the tissue: {}.", posterior.prior));
    }
    if !analysis.fluorophores.is_empty() {
        section = section.with(ReportItem::Matrix(fluorophore_matrix(analysis)));
    }
    section.items.extend(PIXELS.of(&findings, &words));
    section
}

/// Predicted chromaticity of each fluorophore.
fn fluorophore_matrix(analysis: &Analysis) -> NumberMatrix {
    let rows = analysis.fluorophores.iter().map(|fluorophore| {
        let [r, g] = match fluorophore.chromaticity {
            Some(point) => point.map(|share| format!("{share:.3}")),
            None => ["dark", "dark"].map(String::from),
        };
        let weight = fluorophore.bulk_weight.map_or_else(|| "-".into(), number);
        vec![fluorophore.name.replace('_', " "), r, g, weight]
    });
    NumberMatrix {
        caption: "Predicted fluorophores".into(),
        columns: ["Fluorophore", "r", "g", "weight in the bulk"].map(String::from).into(),
        rows: rows.collect(),
        note: "Where each fluorophore alone would lie, through these filters and this sensor, from the model of this experiment.".into(),
    }
}

/// Levels of all channels of all frames.
fn signal_matrix(findings: &[Finding], gain_is_assumed: bool) -> NumberMatrix {
    let gain = match gain_is_assumed {
        true => format!(" Electrons and signal to noise {ASSUMED_GAIN}."),
        false => String::new(),
    };
    let row = |finding: &Finding| {
        let (frame, channel) = (finding.frame.as_deref()?, finding.channel.as_deref()?);
        Some(if channel == "mono" {
            format!("frame \"{frame}\"")
        } else {
            format!("{channel} of frame \"{frame}\"")
        })
    };
    let column = |finding: &Finding| {
        let name = match finding.id {
            FindingId::MeanSignal => "mean, electrons",
            FindingId::MeanLevel => "DN",
            FindingId::PixelSnr => "signal to noise",
            _ => return None,
        };
        Some(name.to_owned())
    };
    NumberMatrix {
        caption: "Signals of the region".into(),
        note: "Mean of the pixels that are not saturated, with its 95 % by sensor noise alone, and the signal to noise of one pixel. Where \
               pixels are saturated a mean is a lower limit."
            .to_owned()
            + &gain,
        ..matrix(findings, "Signal", row, column)
    }
}

/// Targets in frames, one row each.
fn target_matrix(findings: &[Finding], targets: &[TargetDetection]) -> NumberMatrix {
    let row = |finding: &Finding| {
        Some(format!("{}, frame \"{}\"", finding.name.as_deref()?, finding.frame.as_deref()?))
    };
    let column = |finding: &Finding| {
        let channel = finding.channel.as_deref().unwrap_or_default();
        Some(match finding.id {
            FindingId::TargetContrast => format!("contrast {channel}"),
            FindingId::TargetSeparationOfPixel => "d' a pixel".into(),
            FindingId::TargetSeparation => "d'".into(),
            FindingId::TargetSeparationOfSensor => "d' of the sensor".into(),
            FindingId::SmallestDiameter => format!("smallest diameter, {}", finding.unit),
            FindingId::FramesNeeded => "frames".into(),
            _ => return None,
        })
    };
    let wanted = targets.first().map_or(0.0, |target| target.wanted_d_prime);
    let note = |t: &TargetDetection| Some(format!(" {}, {}: {}.", t.target, t.frame, render_noise_words(t)?));
    let of_render: String = targets.iter().filter_map(note).collect();
    NumberMatrix {
        caption: "How well targets are told from what lies around them".into(),
        note: format!(
            "Contrast: difference over background. d' is the distance of target and background in standard deviations: of one pixel; of the \
             whole target in the noise and structure of the frame, neighbors correlated as they are (Hotelling observer); and in the sensor's \
             noise alone. Diameter of a disc of this contrast on the surface of the target, and number of averaged frames, for d' {wanted}. \
             Noise of the render is taken out; intervals are 95 % by the noise of frame and render.{of_render}"
        ),
        ..matrix(findings, "Target, frame", row, column)
    }
}

/// That the noise of the render was taken out, and how many samples make it small; `None` where it is small.
pub(crate) fn render_noise_words(target: &TargetDetection) -> Option<String> {
    Some(render_noise(target.render_noise?, target.samples_needed?))
}

#[cfg(test)]
mod tests {
    use fluorspar::analysis::{AnalysisSettings, ChannelNoise, LineNoise, RegionOfInterest, analyze_region};
    use fluorspar::image::ChannelImage;

    use super::*;

    #[test]
    fn an_analysis_without_a_single_usable_pixel_still_makes_a_section() {
        let image = ChannelImage {
            width: 2,
            height: 1,
            channels: ["R", "G", "B"].map(String::from).to_vec(),
            data: vec![0.0; 6],
            saturated: vec![false; 2],
            noise_floor_dn: 2.0,
            full_scale_dn: 4000.0,
            shares: vec![0.25, 0.5, 0.25],
            interpolation: None,
            subtracted: None,
            calibration: None,
            label: "dark".into(),
        };
        let noise = ChannelNoise {
            floor_dn: 2.0,
            dn_per_electron: 0.5,
            gain_spread: 0.0,
            lines: LineNoise::default(),
        };
        let settings = AnalysisSettings::new(RegionOfInterest::default(), noise);
        let (analysis, ..) = analyze_region(&image, None, None, None, &settings).unwrap();
        let section = analysis_section(&analysis, Vec::new(), FrameOrigin::Given);
        assert_eq!(section.title, "What the frame \"dark\" says");
        // Without a pixel that tells a color the words and the table of pixels remain.
        assert_eq!(section.items.len(), 2);
    }
}
