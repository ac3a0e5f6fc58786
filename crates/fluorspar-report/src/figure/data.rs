//! What a figure shows, in numbers and in words.

use std::fmt::Write;

use fluorspar::units::digits_text;
use fluorspar_format::csv_cell;

use super::{Axis, Figure, Scale, SeriesShape};

impl Figure {
    /// The points of all lines, dots and markers as CSV: panel, series, x, y, in the units of the axes. `None` where the figure has
    /// none, as an image has.
    pub fn to_csv(&self) -> Option<String> {
        let mut csv = String::new();
        for (number, panel) in self.panels.iter().enumerate() {
            let title = if panel.title.is_empty() { format!("{}", number + 1) } else { panel.title.clone() };
            for series in &panel.series {
                let Some(points) = series.shape.points() else { continue };
                let Some(name) = &series.name else { continue };
                for [x, y] in points.iter().filter(|point| point.iter().all(|v| v.is_finite())) {
                    let _ = writeln!(csv, "{},{},{x},{y:e}", csv_cell(&title), csv_cell(name));
                }
            }
        }
        let panel = self.panels.first()?;
        let axes = format!("{},{}", csv_cell(&panel.x.title()), csv_cell(&panel.y.title()));
        (!csv.is_empty()).then(|| format!("panel,series,{axes}\n{csv}"))
    }

    /// What is seen: the peak of each line over wavelengths, the range of the rest.
    pub(crate) fn seen(&self) -> String {
        let mut words = Vec::new();
        // What stands over names is not high or low
        for panel in self.panels.iter().filter(|panel| panel.y.names.is_empty()) {
            for series in &panel.series {
                let (Some(name), Some(points)) = (&series.name, series.shape.points()) else { continue };
                let inside = points.iter().filter(|p| is_inside(&panel.x, p[0]) && p[1].is_finite());
                let highest = inside.clone().copied().max_by(|a, b| a[1].total_cmp(&b[1]));
                let lowest = inside.copied().min_by(|a, b| a[1].total_cmp(&b[1]));
                let (Some([x, high]), Some([_, low])) = (highest, lowest) else { continue };
                // A line across the figure marks a value.
                if points.len() < 3 || high == low {
                    continue;
                }
                let place = format!("{} {}", digits_text(x, 3), panel.x.unit);
                let sentence = format!("{name}: highest at {}, {}", place.trim_end(), value(&panel.y, high));
                if !words.contains(&sentence) {
                    words.push(sentence);
                }
            }
        }
        if words.is_empty() { String::new() } else { format!("Seen: {}.", words.join("; ")) }
    }
}

impl SeriesShape {
    fn points(&self) -> Option<&[[f64; 2]]> {
        match self {
            Self::Line { points, .. } | Self::Dots { points, .. } | Self::Markers { points, .. } => {
                Some(points)
            }
            _ => None,
        }
    }
}

fn is_inside(axis: &Axis, value: f64) -> bool {
    let [first, last] = axis.limits;
    (first.min(last)..=first.max(last)).contains(&value)
}

fn value(axis: &Axis, value: f64) -> String {
    let value = match axis.scale {
        Scale::Log10 => format!("{value:.1e}"),
        Scale::Linear => digits_text(value, 3),
    };
    format!("{value} {}", axis.unit).trim_end().to_owned()
}

#[cfg(test)]
mod tests {
    use crate::{Axis, ColorBar, ColorMap, Figure, Ink, Panel, Series};

    #[test]
    fn a_line_comes_back_as_rows_and_as_words() {
        let y = Axis::from_zero("emission", "1/nm", [0.02]);
        let line = Series::line("dye, red", Ink::Text, vec![[500.0, 0.001], [610.0, 0.02], [700.0, 0.0]]);
        let figure = Figure::new("Emission", Panel::new(Axis::wavelength([400.0, 700.0]), y).with(line));
        let csv = figure.to_csv().unwrap();
        assert_eq!(csv.lines().next(), Some("panel,series,wavelength (nm),emission (1/nm)"));
        assert_eq!(csv.lines().nth(2), Some("1,\"dye, red\",610,2e-2"));
        assert_eq!(figure.seen(), "Seen: dye, red: highest at 610 nm, 0.0200 1/nm.");
        let empty = Figure::new("", Panel::new(Axis::hidden([0.0, 1.0]), Axis::hidden([0.0, 1.0])));
        assert_eq!((empty.to_csv(), empty.seen()), (None, String::new()));
    }

    #[test]
    fn a_narrow_figure_fits_a_telephone() {
        let x = || Axis::wavelength([400.0, 700.0]);
        let panel = || Panel::new(x(), Axis::from_zero("power", "W/nm", [0.8]));
        let figure = Figure::grid("", vec![panel(), panel().sized(340.0, 280.0)], 2).narrow(330.0);
        let svg = figure.to_page_svg();
        let width: f64 = svg.split('"').nth(3).unwrap().parse().unwrap();
        assert!(width <= 331.0, "{width}");
    }

    #[test]
    fn the_color_bar_of_a_narrow_figure_keeps_its_numbers() {
        let hidden = || Axis::hidden([0.0, 1.0]);
        let axis = Axis::linear("porphyrin share", "%", [0.0, 40.0]);
        let color_bar = Some(ColorBar { axis, map: ColorMap::Viridis });
        let panel = Panel { color_bar, ..Panel::new(hidden(), hidden()).sized(500.0, 300.0) };
        let svg = Figure::new("", panel).narrow(330.0).to_page_svg();
        for text in [">porphyrin share (%)<", ">0<", ">40<"] {
            assert_eq!(svg.matches(text).count(), 1, "{text} in {svg}");
        }
    }
}
