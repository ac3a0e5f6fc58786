//! From how deep light comes.

use crate::{Axis, Dash, Figure, Ink, Panel, Series};

/// Share of the light of a channel from above each depth.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthCurve {
    /// Name of the channel.
    pub name: String,
    /// Depth, um, and share from above it, 0 to 1.
    pub points: Vec<[f64; 2]>,
}

/// Share of the light from above each depth, up to the depth of 98 % of it, one line per channel.
pub fn share_by_depth(curves: &[DepthCurve], what: &str) -> Figure {
    let shown = |curve: &DepthCurve| {
        curve.points.iter().copied().filter(|[_, share]| *share < 0.98).collect::<Vec<_>>()
    };
    let reach = curves.iter().flat_map(|curve| shown(curve).into_iter().map(|[depth_um, _]| depth_um));
    let x = Axis::from_zero("depth below the surface", "µm", reach);
    let mut panel = Panel::new(x, Axis::linear("share of the light from above", "", [0.0, 1.0]));
    for (index, curve) in curves.iter().enumerate() {
        let ink = Ink::of_channel(&curve.name, index);
        panel = panel.with(Series::dashed(curve.name.clone(), ink, shown(curve), Dash::cycle(index)));
    }
    Figure::new(format!("Depth of the light: {what}"), panel).explained(
        "Share of the fluorescence of each channel that comes from above a depth. Where a line crosses one half is its \
         median depth.",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_channel_has_its_line_and_depths_their_unit() {
        let curve = |name: &str, scale: f64| DepthCurve {
            name: name.into(),
            points: (0..=20).map(|i| [scale * f64::from(i), f64::from(i) / 20.0]).collect(),
        };
        let svg = share_by_depth(&[curve("R", 40.0), curve("G", 20.0)], "tongue").to_svg();
        assert!(
            svg.contains("tongue") && svg.contains("µm") && svg.contains(">R<") && svg.contains(">G<"),
            "{svg}"
        );
    }
}
