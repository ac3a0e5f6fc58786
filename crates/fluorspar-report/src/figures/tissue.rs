//! Light in layered tissue: where it leaves around a beam, and how deep it goes.

use super::{PlotCurve, wavelength_limits};
use crate::{Axis, Dash, Figure, Ink, Label, Panel, Series, SeriesShape};

/// Estimates along a line, with their standard errors.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimatedCurve {
    /// Name in the legend.
    pub name: String,
    /// Position, value and standard error of the value.
    pub points: Vec<[f64; 3]>,
}

impl EstimatedCurve {
    /// Whether a point is worth drawing: known to better than half of its value.
    fn is_known(&[_, value, error]: &[f64; 3]) -> bool {
        value > 0.0 && error < 0.5 * value
    }

    /// The line, and the band of one standard error on both sides.
    fn series(&self, index: usize) -> [Series; 2] {
        let known = || self.points.iter().filter(|point| Self::is_known(point));
        let upper = known().map(|[x, value, error]| [*x, value + error]);
        let lower = known().map(|[x, value, error]| [*x, value - error]);
        let mut outline: Vec<[f64; 2]> = upper.collect();
        outline.extend(lower.collect::<Vec<_>>().into_iter().rev());
        let line = known().map(|[x, value, _]| [*x, *value]).collect();
        let ink = Ink::cycle(index);
        [
            Series::unnamed(ink, SeriesShape::Area { outline, opacity: 0.25 }),
            Series::dashed(self.name.clone(), ink, line, Dash::cycle(index)),
        ]
    }
}

/// Positions that hold everything worth drawing, from zero.
fn reach(curves: &[EstimatedCurve]) -> f64 {
    let points = curves.iter().flat_map(|curve| &curve.points);
    points.filter(|point| EstimatedCurve::is_known(point)).map(|point| point[0]).fold(0.0, f64::max)
}

/// Light that leaves per area against the distance from the beam, mm and 1/mm².
pub fn light_by_radius(curves: &[EstimatedCurve]) -> Figure {
    let values = curves.iter().flat_map(|curve| &curve.points).map(|point| point[1]);
    let x = Axis::from_zero("distance from the beam", "mm", [reach(curves)]);
    let mut panel = Panel::new(x, Axis::decades("leaving share of the light per area", "1/mm²", values, 6));
    for series in curves.iter().enumerate().flat_map(|(index, curve)| curve.series(index)) {
        panel = panel.with(series);
    }
    Figure::new("Light leaving the tissue", panel).explained(
        "Share of the incident light that leaves per area, against the distance from where the beam enters. Bands are one \
         standard error; what is known to less than half of its value is left out.",
    )
}

/// The name of a layer beside a dot that lies within the layer: of a thin one the name itself lies beyond its interfaces.
fn layer_name(at: [f64; 2], name: &str) -> [Series; 2] {
    let dot = SeriesShape::Markers { points: vec![at], radius: 2.5, hollow: false };
    let label = Label { at, text: name.into() };
    [Series::unnamed(Ink::Muted, dot), Series::unnamed(Ink::Muted, SeriesShape::Labels(vec![label]))]
}

/// Fluence against depth, mm, with the lower end, mm, and the name of each layer.
pub fn light_by_depth(curves: &[EstimatedCurve], layers: &[(f64, String)]) -> Figure {
    let values = curves.iter().flat_map(|curve| &curve.points).map(|point| point[1]);
    let x = Axis::from_zero("depth", "mm", [reach(curves)]);
    let y = Axis::from_zero("fluence per irradiance", "", values);
    let mut panel = Panel::new(x.clone(), y.clone());
    let mut top = 0.0;
    for (bottom, name) in layers.iter().filter(|_| y.limits[1] > 0.0) {
        if top < x.limits[1] {
            let at = [0.5 * (top + bottom.min(x.limits[1])), 0.96 * y.limits[1]];
            for series in layer_name(at, name) {
                panel = panel.with(series);
            }
        }
        if *bottom < x.limits[1] {
            let points = vec![[*bottom, y.limits[0]], [*bottom, y.limits[1]]];
            let line = SeriesShape::Line { points, width: 1.0, dash: Dash::Dotted };
            panel = panel.with(Series::unnamed(Ink::Muted, line));
        }
        top = *bottom;
    }
    for series in curves.iter().enumerate().flat_map(|(index, curve)| curve.series(index)) {
        panel = panel.with(series);
    }
    Figure::new("Light in the tissue", panel).explained(
        "Light that passes a point from all directions (fluence), relative to the light on the surface, against the depth. \
         Light that is scattered back passes again, so there may be more than fell in. Bands are one standard error; dotted \
         lines are the interfaces of the layers, a dot lies in the layer that its name tells.",
    )
}

/// Reflectance of tissue against wavelength.
pub fn tissue_reflectance(title: &str, curves: &[PlotCurve]) -> Figure {
    let y = Axis::from_zero("reflectance", "", curves.iter().map(PlotCurve::peak));
    let mut panel = Panel::new(Axis::wavelength(wavelength_limits(curves)), y);
    for (index, curve) in curves.iter().enumerate() {
        let (ink, dash) = (Ink::cycle(index), Dash::cycle(index));
        panel = panel.with(Series::dashed(curve.name.clone(), ink, curve.points(), dash));
    }
    Figure::new(format!("Reflectance: {title}"), panel).explained(
        "Light that comes back from inside the tissue, without what its surface reflects at once: of diffuse light from all \
         directions, of a beam along the normal, and of diffuse light below the surface, as a renderer needs it that adds the \
         surface itself. The dips at 540 and 580 nm and around 415 nm are those of blood.",
    )
}

/// Share of the light of each channel that arises above a depth, um, with the lower end, um, and the name of each layer.
pub fn light_sources_by_depth(
    title: &str,
    channels: &[(String, Vec<[f64; 2]>)],
    layers: &[(f64, String)],
) -> Figure {
    // To nine tenths of the light and a little more; a tail of some percent comes from much deeper, beyond the axis.
    let shown = channels.iter().flat_map(|(_, points)| points).filter(|[_, share]| *share <= 0.97);
    let reach = shown.map(|[depth_um, _]| *depth_um);
    let x = Axis::from_zero("depth below the surface", "µm", reach);
    let y = Axis::linear("share of the light from above this depth", "", [0.0, 1.0]);
    let mut panel = Panel::new(x.clone(), y);
    let mut top = 0.0;
    for (number, (bottom, name)) in layers.iter().enumerate() {
        if top < x.limits[1] {
            let at = [0.5 * (top + bottom.min(x.limits[1])), 0.97 - 0.055 * (number % 3) as f64];
            for series in layer_name(at, name) {
                panel = panel.with(series);
            }
        }
        if *bottom < x.limits[1] {
            let points = vec![[*bottom, 0.0], [*bottom, 1.0]];
            let line = SeriesShape::Line { points, width: 1.0, dash: Dash::Dotted };
            panel = panel.with(Series::unnamed(Ink::Muted, line));
        }
        top = *bottom;
    }
    for (index, (name, points)) in channels.iter().enumerate() {
        let ink = Ink::of_channel(name, index);
        panel = panel.with(Series::dashed(name.clone(), ink, points.clone(), Dash::cycle(index)));
    }
    Figure::new(format!("Where fluorescence arises: {title}"), panel).explained(
        "The share of the fluorescence of each channel that arises above a depth: half of the light comes from above where its \
         line crosses 0.5. Dotted lines are the interfaces of the layers, a dot lies in the layer that its name tells.",
    )
}

/// A measured spectrum and its fit.
#[derive(Clone, Debug, PartialEq)]
pub struct SpectrumFit {
    /// Name.
    pub name: String,
    /// Wavelengths, nm, increasing.
    pub wavelength_nm: Vec<f64>,
    /// As measured.
    pub measured: Vec<f64>,
    /// As fitted.
    pub model: Vec<f64>,
}

/// Each measured spectrum with its fit, two in a row.
pub fn spectrum_fits(title: &str, fits: &[SpectrumFit]) -> Figure {
    let panels = fits.iter().map(|fit| {
        let [measured, model] = [("measured", &fit.measured), ("model", &fit.model)]
            .map(|(name, values)| PlotCurve::new(name, fit.wavelength_nm.clone(), values.clone()));
        let y = Axis::from_zero("value", "", [measured.peak(), model.peak()]);
        let dots = SeriesShape::Markers { points: measured.points(), radius: 2.5, hollow: true };
        Panel::new(Axis::wavelength(wavelength_limits([&measured])), y)
            .sized(400.0, 260.0)
            .titled(fit.name.clone())
            .with(Series { name: Some(measured.name.clone()), ink: Ink::Text, shape: dots })
            .with(Series::line(model.name.clone(), Ink::PALETTE[1], model.points()))
    });
    Figure::grid(title, panels.collect(), 2)
        .explained("Circles are what was measured, lines the most probable tissue, each with its own scale where that is unknown.")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_reach_as_far_as_something_is_known() {
        let points = vec![[0.1, 1.0, 0.1], [0.9, 0.1, 0.01], [5.0, 0.01, 0.009], [9.0, 0.0, 0.0]];
        let curves = [EstimatedCurve { name: "reflected".into(), points }];
        for figure in
            [light_by_radius(&curves), light_by_depth(&curves, &[(0.2, "skin".into()), (9.0, "fat".into())])]
        {
            let limits = figure.panels[0].x.limits;
            assert_eq!(limits, [0.0, 1.0]);
            let svg = figure.to_svg();
            assert!(svg.contains("reflected") && svg.contains("mm"), "{svg}");
        }
        let empty = [EstimatedCurve { name: "nothing".into(), points: vec![[0.5, 0.0, 0.0]] }];
        assert!(light_by_radius(&empty).to_svg().contains("nothing"));
        assert!(light_by_depth(&empty, &[(1.0, "skin".into())]).to_svg().contains("nothing"));
    }

    #[test]
    fn depths_leave_through_the_end_of_the_axis() {
        let points = vec![[0.0, 0.0], [80.0, 0.5], [90.0, 0.9], [4e3, 1.0]];
        let figure = light_sources_by_depth("lip", &[("R".into(), points.clone())], &[]);
        let panel = &figure.panels[0];
        assert!(panel.x.limits[1] < 200.0, "{:?}", panel.x.limits);
        let SeriesShape::Line { points: drawn, .. } = &panel.series[0].shape else { panic!("no line") };
        assert_eq!(*drawn, points);
    }

    #[test]
    fn spectra_and_depths_of_any_content_are_drawn() {
        let curve = PlotCurve::new("of diffuse light", vec![400.0, 500.0], vec![0.1, f64::NAN]);
        let depths = vec![[0.0, 0.0], [80.0, 0.5], [400.0, 1.0]];
        let fit = SpectrumFit {
            name: "white".into(),
            wavelength_nm: vec![400.0, 500.0],
            measured: vec![0.2, -0.1],
            model: vec![0.2, 0.1],
        };
        let layers = [(100.0, "keratin".to_string()), (9e3, "stroma".to_string())];
        let figures = [
            tissue_reflectance("lip", &[curve]),
            light_sources_by_depth("lip", &[("R".into(), depths)], &layers),
            light_sources_by_depth("lip", &[("R".into(), vec![])], &layers),
            spectrum_fits("lip", &[fit]),
            spectrum_fits("lip", &[]),
        ];
        for figure in figures {
            let svg = figure.to_svg();
            assert!(!svg.contains("NaN\"") && !svg.contains("inf\""), "{}", figure.title);
        }
    }
}
