//! Excitation-emission matrices, and what they give under one light.

use fluorspar::spectral::Fluorophore;

use super::{PlotCurve, wavelength_limits};
use crate::{Axis, ColorBar, ColorMap, Dash, Figure, Ink, Panel, Raster, Series, SeriesShape};

/// The excitation-emission matrix of one fluorophore, on bins of equal width.
#[derive(Clone, Debug, PartialEq)]
pub struct EemMap {
    /// Name.
    pub name: String,
    /// First and last edge of the excitation bins, nm.
    pub excitation_nm: [f64; 2],
    /// First and last edge of the emission bins, nm.
    pub emission_nm: [f64; 2],
    /// Number of excitation bins: columns.
    pub columns: usize,
    /// Values, `[emission, excitation]`, rows from the shortest emission wavelength.
    pub values: Vec<f64>,
}

impl EemMap {
    /// The matrix of a fluorophore, sampled at the centers of this many excitation and emission bins between these edges, nm.
    pub fn of(
        fluorophore: &Fluorophore,
        excitation_nm: [f64; 2],
        emission_nm: [f64; 2],
        [columns, rows]: [usize; 2],
    ) -> Self {
        let values = (0..rows)
            .flat_map(|row| (0..columns).map(move |column| (row, column)))
            .map(|(row, column)| {
                let emission = at_center(emission_nm, row, rows);
                fluorophore.eem.at(emission, at_center(excitation_nm, column, columns))
            })
            .collect();
        Self { name: fluorophore.title.clone(), excitation_nm, emission_nm, columns, values }
    }

    fn rows(&self) -> usize {
        self.values.len() / self.columns.max(1)
    }
}

/// Where a matrix is zero because emission would need more energy than the excitation brought.
const FORBIDDEN: [u8; 3] = [198, 202, 207];

fn at_center([first, last]: [f64; 2], bin: usize, bins: usize) -> f64 {
    first + (last - first) * (bin as f64 + 0.5) / bins as f64
}

/// Heat maps of all matrices, excitation along x and emission along y, each relative to its own largest value.
pub fn eem_maps(maps: &[EemMap], light_peak_nm: Option<f64>) -> Figure {
    let color_bar = ColorBar { axis: Axis::linear("relative", "", [0.0, 1.0]), map: ColorMap::Viridis };
    let columns = maps.len().clamp(1, 3);
    let mut panels = Vec::new();
    for (index, map) in maps.iter().enumerate() {
        let rows = map.rows();
        if rows == 0 || map.columns == 0 {
            continue;
        }
        let peak = map.values.iter().copied().filter(|value| value.is_finite()).fold(0.0, f64::max);
        let raster = Raster::from_fn(map.columns, rows, |row, col| {
            let row = rows - 1 - row;
            let value = map.values[row * map.columns + col];
            let excitation = at_center(map.excitation_nm, col, map.columns);
            if value == 0.0 && at_center(map.emission_nm, row, rows) <= excitation {
                return FORBIDDEN;
            }
            ColorMap::Viridis.color(if peak > 0.0 { value / peak } else { 0.0 })
        });
        let mut panel = Panel::new(
            Axis::linear("excitation", "nm", map.excitation_nm),
            Axis::linear("emission", "nm", map.emission_nm),
        )
        .sized(215.0, 215.0)
        .titled(map.name.clone())
        .with(Series::unnamed(
            Ink::Text,
            SeriesShape::Picture { x: map.excitation_nm, y: map.emission_nm, raster },
        ));
        if let Some(peak_nm) = light_peak_nm {
            let points = vec![[peak_nm, map.emission_nm[0]], [peak_nm, map.emission_nm[1]]];
            let shape = SeriesShape::Line { points, width: 1.5, dash: Dash::Dashed };
            panel = panel.with(Series::unnamed(Ink::Rgb(255, 255, 255), shape));
        }
        if (index + 1) % columns == 0 {
            panel.color_bar = Some(color_bar.clone());
        }
        panels.push(panel);
    }
    let line = light_peak_nm
        .map(|nm| format!(" The dashed line marks the excitation light's peak at {nm:.0} nm."))
        .unwrap_or_default();
    Figure::grid("Excitation-emission matrices", panels, columns).explained(format!(
        "Each fluorophore takes in light at one wavelength (horizontal) and gives off light at a longer one (vertical). Brightness \
         is the strength relative to that fluorophore's own maximum, so colors cannot be compared between the maps. The gray \
         triangle is where the emission would need more energy than the excitation brought.{line}"
    ))
}

/// Emission of each fluorophore under one light; `amount` says how much of each, as in "each at concentration 1", `quantity`
/// and `unit` what is drawn. `view_band_nm` is where a viewing filter passes at least half of its maximum; the rest is gray.
pub fn emission(
    curves: &[PlotCurve],
    light: &str,
    amount: &str,
    [quantity, unit]: [&str; 2],
    view_band_nm: Option<[f64; 2]>,
) -> Figure {
    let limits = wavelength_limits(curves);
    let y = Axis::from_zero(quantity, unit, curves.iter().map(PlotCurve::peak));
    let mut panel = Panel::new(Axis::wavelength(limits), y);
    for shade in view_band_nm.into_iter().flat_map(|band| blocked(band, curves, limits)) {
        panel = panel.with(shade);
    }
    let inks = Ink::of_fluorophores(curves.iter().map(|curve| curve.name.as_str()));
    for (curve, ink) in curves.iter().zip(inks) {
        panel = panel.with(Series::dashed(curve.name.clone(), ink, curve.points(), ink.fluorophore_dash()));
    }
    let overlap = if curves.len() > 1 {
        " Where curves overlap, a channel sees the light of both: only ranges where their shapes differ tell them apart."
    } else {
        ""
    };
    let gray = if view_band_nm.is_some() {
        " Little or nothing of what lies in the gray ranges reaches the sensor."
    } else {
        ""
    };
    Figure::new(format!("Emission under {light}"), panel)
        .explained(format!("What each fluorophore would give off under {light}, {amount}.{overlap}{gray}"))
}

/// Shades over the wavelengths outside a band that the viewing filter passes. Nothing is known of it where there are no curves: a band that
/// goes to their end goes on.
fn blocked([low, high]: [f64; 2], curves: &[PlotCurve], limits: [f64; 2]) -> Vec<Series> {
    let name = Some("viewing filter passes less than half".to_owned());
    let shade =
        |x| Series { name: name.clone(), ink: Ink::Muted, shape: SeriesShape::Span { x, opacity: 0.22 } };
    let nm = || curves.iter().flat_map(|curve| curve.wavelength_nm.iter().copied());
    let (first, last) = (nm().fold(f64::INFINITY, f64::min), nm().fold(f64::NEG_INFINITY, f64::max));
    // The band is known to 1 nm
    let below = (low - first > 1.0).then_some([limits[0], low]);
    let above = (last - high > 1.0).then_some([high, limits[1]]);
    below.into_iter().chain(above).map(shade).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A long-pass filter passes on where the curves end before the axis does.
    #[test]
    fn only_what_the_filter_blocks_is_gray() {
        let curve = PlotCurve::new("dye", vec![350.0, 600.0, 752.5], vec![0.0, 1.0, 0.2]);
        let spans = |band| {
            let figure =
                emission(std::slice::from_ref(&curve), "light", "1 each", ["photons", ""], Some(band));
            let shapes = figure.panels[0].series.iter().map(|series| series.shape.clone());
            let span = |shape| if let SeriesShape::Span { x, .. } = shape { Some(x) } else { None };
            shapes.filter_map(span).collect::<Vec<[f64; 2]>>()
        };
        assert_eq!(spans([640.0, 752.0]), [[350.0, 640.0]]);
        assert_eq!(spans([350.0, 650.0]), [[650.0, 760.0]]);
        assert_eq!(spans([476.0, 700.0]), [[350.0, 476.0], [700.0, 760.0]]);
    }
}
