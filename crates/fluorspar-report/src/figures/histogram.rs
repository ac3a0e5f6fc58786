//! How often each level occurs in a capture.

use crate::Dash;
use crate::{Axis, Figure, Ink, Panel, Series, SeriesShape};

const BINS: usize = 128;

/// All values of one channel of a capture.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelValues {
    /// Channel name.
    pub name: String,
    /// Values, DN above black.
    pub values: Vec<f32>,
}

/// Histograms of a capture's channels on one logarithmic count axis, from below black to saturation. `subtracted` names the
/// capture that was subtracted from it.
pub fn histograms(
    capture: &str,
    channels: &[ChannelValues],
    full_scale_dn: f64,
    subtracted: Option<&str>,
) -> Figure {
    let lowest = channels
        .iter()
        .flat_map(|channel| &channel.values)
        .fold(0.0f64, |low, &value| if value.is_finite() { low.min(f64::from(value)) } else { low });
    let low = lowest.max(-0.1 * full_scale_dn);
    let width = (full_scale_dn * 1.02 - low) / BINS as f64;
    let mut counted = Vec::new();
    for channel in channels {
        let mut counts = [0usize; BINS];
        for &value in channel.values.iter().filter(|value| value.is_finite()) {
            let bin = ((f64::from(value) - low) / width).floor().clamp(0.0, (BINS - 1) as f64);
            counts[bin as usize] += 1;
        }
        counted.push(counts);
    }
    let most = counted.iter().flatten().copied().max().unwrap_or(1).max(10) as f64;
    let mut panel = Panel::new(
        Axis::linear("value above black", "DN", [low, low + BINS as f64 * width]),
        Axis::log10(
            "pixels per level bin",
            format!("bin = {width:.0} DN"),
            [0.7, 10f64.powf(most.log10() + 0.15)],
        ),
    )
    .sized(620.0, 260.0);
    for (index, (channel, counts)) in channels.iter().zip(&counted).enumerate() {
        let ink = Ink::of_channel(&channel.name, index);
        let steps = counts.iter().enumerate().flat_map(|(bin, &count)| {
            let left = low + bin as f64 * width;
            [[left, count as f64], [left + width, count as f64]]
        });
        panel = panel.with(Series::dashed(channel.name.clone(), ink, steps.collect(), Dash::Solid));
    }
    let shape = SeriesShape::Line {
        points: vec![[full_scale_dn, 0.5], [full_scale_dn, 1e12]],
        width: 1.5,
        dash: Dash::Dashed,
    };
    panel = panel.with(Series { name: Some("saturation".into()), ink: Ink::Muted, shape });
    let beyond = subtracted.map_or_else(String::new, |name| {
        format!(
            " Saturated pixels lie a little to both sides of the line, since the frame \"{name}\" was subtracted, which has \
             noise of its own."
        )
    });
    Figure::new(format!("Levels of the frame \"{capture}\""), panel).explained(format!(
        "How many pixels have which level, in digital numbers (DN) above the dark level. A pile at the dashed line is saturated: \
         its true value is unknown.{beyond}"
    ))
}
