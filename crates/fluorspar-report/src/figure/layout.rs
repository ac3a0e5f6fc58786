//! Lays a figure out as marks: panels, axes, legend and series.
//!
//! The name of a vertical axis is set upright above it: a reader need not tilt the head, and no text is rotated.

use super::drawing::{Anchor, Drawing, Frame, Mark, dashed};
use super::scale::Tick;
use super::{Axis, ColorBar, Figure, Ink, Label, Panel, Raster, Series, SeriesShape, font, labels};

const TITLE_SIZE: u32 = 16;
const LABEL_SIZE: u32 = 13;
const TICK_SIZE: u32 = 12;
/// Distance of the lines of a panel's title, px.
const TITLE_LINE: f64 = 19.0;
const EDGE: f64 = 14.0;
const BAR_WIDTH: f64 = 16.0;

/// Room around the area inside the axes.
struct Margins {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
}

pub(super) fn lay_out(figure: &Figure) -> Drawing {
    let margins: Vec<Margins> = figure.panels.iter().map(margins).collect();
    let columns = figure.columns.min(figure.panels.len()).max(1);
    let rows = figure.panels.len().div_ceil(columns);
    let largest = |keep: &dyn Fn(usize) -> bool, value: &dyn Fn(usize) -> f64| {
        (0..figure.panels.len()).filter(|&i| keep(i)).map(value).fold(0.0, f64::max)
    };
    // Panels of a column share their left edge, panels of a row their top edge.
    let column_left: Vec<f64> =
        (0..columns).map(|c| largest(&|i| i % columns == c, &|i| margins[i].left)).collect();
    let column_width: Vec<f64> = (0..columns)
        .map(|c| {
            let inner = |i: usize| {
                (figure.panels[i].size[0] + margins[i].right)
                    .max(heading_width(&figure.panels[i]) - margins[i].left)
            };
            column_left[c] + largest(&|i| i % columns == c, &inner)
        })
        .collect();
    let row_top: Vec<f64> = (0..rows).map(|r| largest(&|i| i / columns == r, &|i| margins[i].top)).collect();
    let row_height: Vec<f64> = (0..rows)
        .map(|r| {
            row_top[r] + largest(&|i| i / columns == r, &|i| figure.panels[i].size[1] + margins[i].bottom)
        })
        .collect();

    let panels_width: f64 = column_width.iter().sum();
    let title_width = font::width(&figure.title, f64::from(TITLE_SIZE));
    let width = (panels_width.max(title_width) + 2.0 * EDGE).ceil();
    let mut marks = Vec::new();
    let mut y = EDGE;
    if !figure.title.is_empty() {
        y += f64::from(TITLE_SIZE);
        marks.push(text_mark([EDGE, y], &figure.title, TITLE_SIZE, Anchor::Start, Ink::Text));
        y += 10.0;
    }
    y = legend(figure, width - 2.0 * EDGE, y, &mut marks);
    for (row, height) in row_height.iter().enumerate() {
        let mut x = EDGE;
        for col in 0..columns {
            if let Some(panel) = figure.panels.get(row * columns + col) {
                let [w, h] = panel.size;
                let frame = Frame {
                    left: (x + column_left[col]).round(),
                    top: (y + row_top[row]).round(),
                    width: w,
                    height: h,
                };
                draw_panel(panel, frame, margins[row * columns + col].left, &mut marks);
            }
            x += column_width[col];
        }
        y += height;
    }
    Drawing { width, height: (y + EDGE - 6.0).ceil(), marks }
}

fn text_mark(at: [f64; 2], text: &str, size: u32, anchor: Anchor, ink: Ink) -> Mark {
    Mark::Text { at, text: text.to_owned(), size, anchor, ink }
}

/// As many ticks as have room for their texts.
fn x_ticks(panel: &Panel) -> Vec<Tick> {
    // Names stand closer than numbers: each of a row of channels is to be read
    let (room, gap) = if panel.x.names.is_empty() { (44.0, 16.0) } else { (20.0, 6.0) };
    let mut most = (panel.size[0] / room) as usize;
    loop {
        let ticks = panel.x.ticks(most);
        let labeled = ticks.iter().filter(|tick| tick.text.is_some()).count().max(2) - 1;
        if most <= 2 || panel.size[0] / labeled as f64 >= widest(&ticks) + gap {
            return ticks;
        }
        most -= 1;
    }
}

fn y_ticks(axis: &Axis, height: f64) -> Vec<Tick> {
    // Names need no more room than their lines
    let room = if axis.names.is_empty() { 44.0 } else { 14.0 };
    axis.ticks((height / room) as usize)
}

fn widest(ticks: &[Tick]) -> f64 {
    ticks
        .iter()
        .filter_map(|t| t.text.as_deref())
        .map(|t| font::width(t, f64::from(TICK_SIZE)))
        .fold(0.0, f64::max)
}

/// The title of a panel in lines that fit a width, px.
pub(super) fn wrapped_title(title: &str, width: f64) -> String {
    labels::wrapped(title, LABEL_SIZE, width).join("\n")
}

fn heading_width(panel: &Panel) -> f64 {
    let width = |text: &str| font::width(text, f64::from(LABEL_SIZE));
    panel.title.lines().map(width).fold(width(&panel.y.title()), f64::max) + 12.0
}

fn margins(panel: &Panel) -> Margins {
    let bar = panel.color_bar.as_ref().map_or(0.0, |bar| {
        let ticks = widest(&y_ticks(&bar.axis, panel.size[1]));
        let title = font::width(&bar.axis.title(), f64::from(LABEL_SIZE));
        14.0 + (BAR_WIDTH + 7.0 + ticks).max(title)
    });
    Margins {
        left: if panel.y.is_hidden { 0.0 } else { widest(&y_ticks(&panel.y, panel.size[1])) + 10.0 },
        right: 20.0 + bar,
        top: if panel.title.is_empty() { 4.0 } else { 3.0 + TITLE_LINE * panel.title.lines().count() as f64 }
            + if panel.y.is_hidden && panel.color_bar.is_none() { 0.0 } else { 25.0 },
        bottom: if panel.x.is_hidden { 10.0 } else { 48.0 },
    }
}

/// Draws the legend in as many lines as it needs; returns where the rest may begin.
fn legend(figure: &Figure, width: f64, top: f64, marks: &mut Vec<Mark>) -> f64 {
    let mut entries: Vec<&Series> = Vec::new();
    for series in figure.panels.iter().flat_map(|panel| &panel.series) {
        if series.name.is_some() && !entries.iter().any(|entry| entry.name == series.name) {
            entries.push(series);
        }
    }
    if entries.is_empty() {
        return top;
    }
    let (mut x, mut y) = (0.0, top + 12.0);
    for entry in entries {
        let name = entry.name.as_deref().unwrap_or_default();
        let needed = 36.0 + font::width(name, f64::from(TICK_SIZE)) + 20.0;
        if x > 0.0 && x + needed - 20.0 > width {
            x = 0.0;
            y += 20.0;
        }
        legend_sample(entry, [EDGE + x, y - 4.0], marks);
        marks.push(text_mark([EDGE + x + 36.0, y], name, TICK_SIZE, Anchor::Start, Ink::Text));
        x += needed;
    }
    y + 12.0
}

fn legend_sample(series: &Series, [x, y]: [f64; 2], marks: &mut Vec<Mark>) {
    let ink = series.ink;
    match &series.shape {
        SeriesShape::Line { width, dash, .. } => {
            let lines = dashed(&[[x, y], [x + 28.0, y]], dash.lengths());
            marks.push(Mark::Strokes { lines, width: *width, ink });
        }
        SeriesShape::Dots { .. } => {
            let points = [[6.0, 2.0], [11.0, -3.0], [14.0, 3.0], [18.0, -1.0], [22.0, 3.0]];
            let points = points.map(|[dx, dy]| [x + dx, y + dy]).to_vec();
            marks.push(Mark::Dots { points, radius: 1.5, opacity: 0.9, ink });
        }
        SeriesShape::Markers { radius, hollow, .. } => marker([x + 14.0, y], *radius, *hollow, ink, marks),
        SeriesShape::Area { opacity, .. } | SeriesShape::Span { opacity, .. } => {
            let frame = Frame { left: x + 2.0, top: y - 6.0, width: 24.0, height: 12.0 };
            marks.push(Mark::Rect { frame, opacity: *opacity, ink });
        }
        SeriesShape::Picture { .. } | SeriesShape::Labels(_) => {}
    }
}

fn marker(at: [f64; 2], radius: f64, hollow: bool, ink: Ink, marks: &mut Vec<Mark>) {
    if hollow {
        // What lies within stays seen
        marks.push(Mark::Ring { at, radius, width: 2.5, ink });
    } else {
        marks.push(Mark::Dots { points: vec![at], radius: radius + 1.5, opacity: 1.0, ink: Ink::Paper });
        marks.push(Mark::Dots { points: vec![at], radius, opacity: 1.0, ink });
    }
}

fn draw_panel(panel: &Panel, frame: Frame, left_margin: f64, marks: &mut Vec<Mark>) {
    let to_px = |[x, y]: [f64; 2]| {
        [frame.left + panel.x.position(x) * frame.width, frame.bottom() - panel.y.position(y) * frame.height]
    };
    let heading_left = frame.left - left_margin;
    let mut heading = frame.top - 13.0;
    if !panel.y.is_hidden {
        marks.push(text_mark(
            [heading_left, heading],
            &panel.y.title(),
            LABEL_SIZE,
            Anchor::Start,
            Ink::Muted,
        ));
    }
    if !panel.y.is_hidden || panel.color_bar.is_some() {
        heading -= TITLE_LINE;
    }
    for line in panel.title.lines().rev() {
        marks.push(text_mark([heading_left, heading], line, LABEL_SIZE, Anchor::Start, Ink::Text));
        heading -= TITLE_LINE;
    }

    let covered = panel.series.iter().any(|series| matches!(series.shape, SeriesShape::Picture { .. }));
    draw_axes(panel, frame, covered, marks);
    marks.push(Mark::Clip(frame));
    for series in &panel.series {
        draw_series(series, panel, frame, &to_px, marks);
    }
    marks.push(Mark::Unclip);
    if !panel.x.is_hidden || !panel.y.is_hidden {
        marks.push(Mark::Strokes { lines: vec![outline(frame)], width: 1.0, ink: Ink::Muted });
    }
    draw_labels(panel, frame, &to_px, marks);
    if let Some(bar) = &panel.color_bar {
        draw_color_bar(bar, frame, marks);
    }
}

fn outline(frame: Frame) -> Vec<[f64; 2]> {
    let (left, top, right, bottom) = (frame.left, frame.top, frame.right(), frame.bottom());
    vec![[left, top], [right, top], [right, bottom], [left, bottom], [left, top]]
}

/// Grid lines, ticks and their texts. Under an image the grid would not show, so ticks point outwards there.
fn draw_axes(panel: &Panel, frame: Frame, covered: bool, marks: &mut Vec<Mark>) {
    let (mut major, mut minor, mut outward) = (Vec::new(), Vec::new(), Vec::new());
    for tick in x_ticks(panel) {
        let x = (frame.left + panel.x.position(tick.value) * frame.width).round();
        outward.push(vec![
            [x, frame.bottom()],
            [x, frame.bottom() + if tick.text.is_some() { 5.0 } else { 3.0 }],
        ]);
        let line = vec![[x, frame.top], [x, frame.bottom()]];
        if let Some(text) = &tick.text {
            marks.push(text_mark([x, frame.bottom() + 19.0], text, TICK_SIZE, Anchor::Middle, Ink::Muted));
            major.push(line);
        } else {
            minor.push(line);
        }
    }
    for tick in y_ticks(&panel.y, panel.size[1]) {
        let y = (frame.bottom() - panel.y.position(tick.value) * frame.height).round();
        outward.push(vec![[frame.left - if tick.text.is_some() { 5.0 } else { 3.0 }, y], [frame.left, y]]);
        if let Some(text) = &tick.text {
            marks.push(text_mark([frame.left - 8.0, y + 4.0], text, TICK_SIZE, Anchor::End, Ink::Muted));
            major.push(vec![[frame.left, y], [frame.right(), y]]);
        }
    }
    if !panel.x.is_hidden {
        let at = [frame.left + 0.5 * frame.width, frame.bottom() + 38.0];
        marks.push(text_mark(at, &panel.x.title(), LABEL_SIZE, Anchor::Middle, Ink::Muted));
    }
    if !covered {
        marks.push(Mark::Strokes { lines: minor, width: 0.5, ink: Ink::Grid });
        marks.push(Mark::Strokes { lines: major, width: 1.0, ink: Ink::Grid });
    }
    marks.push(Mark::Strokes { lines: outward, width: 1.0, ink: Ink::Muted });
}

fn is_finite(point: &[f64; 2]) -> bool {
    point[0].is_finite() && point[1].is_finite()
}

fn draw_series(
    series: &Series,
    panel: &Panel,
    frame: Frame,
    to_px: &dyn Fn([f64; 2]) -> [f64; 2],
    marks: &mut Vec<Mark>,
) {
    let ink = series.ink;
    match &series.shape {
        SeriesShape::Line { points, width, dash } => {
            let lines = points
                .split(|point| !is_finite(point))
                .filter(|run| run.len() > 1)
                .flat_map(|run| {
                    let px: Vec<[f64; 2]> = run.iter().map(|&point| to_px(point)).collect();
                    dashed(&px, dash.lengths())
                })
                .collect();
            marks.push(Mark::Strokes { lines, width: *width, ink });
        }
        SeriesShape::Dots { points, radius, opacity } => {
            let points = shown(points).into_iter().filter(is_finite).map(to_px).collect();
            marks.push(Mark::Dots { points, radius: *radius, opacity: *opacity, ink });
        }
        SeriesShape::Markers { points, radius, hollow } => {
            for point in points.iter().filter(|point| is_finite(point)) {
                marker(to_px(*point), *radius, *hollow, ink, marks);
            }
        }
        SeriesShape::Area { outline, opacity } => {
            let corners = outline.iter().copied().filter(is_finite).map(to_px).collect();
            marks.push(Mark::Polygon { corners, opacity: *opacity, ink });
        }
        SeriesShape::Span { x, opacity } => {
            let px = x.map(|x| frame.left + panel.x.position(x).clamp(0.0, 1.0) * frame.width);
            let (left, right) = (px[0].min(px[1]), px[0].max(px[1]));
            let frame = Frame { left, width: right - left, ..frame };
            marks.push(Mark::Rect { frame, opacity: *opacity, ink });
        }
        SeriesShape::Picture { x, y, raster } => {
            let ([left, bottom], [right, top]) = (to_px([x[0], y[0]]), to_px([x[1], y[1]]));
            let frame = Frame { left, top, width: right - left, height: bottom - top };
            marks.push(Mark::Picture { frame, raster: raster.clone() });
        }
        SeriesShape::Labels(_) => {}
    }
}

fn draw_labels(panel: &Panel, frame: Frame, to_px: &dyn Fn([f64; 2]) -> [f64; 2], marks: &mut Vec<Mark>) {
    let mut found: Vec<(&Label, [f64; 2])> = Vec::new();
    let (mut crowd, mut lines) = (Vec::new(), Vec::new());
    for series in &panel.series {
        match &series.shape {
            SeriesShape::Labels(labels) => found.extend(labels.iter().map(|label| (label, to_px(label.at)))),
            SeriesShape::Dots { points, .. } => {
                let step = (points.len() / 2000).max(1);
                crowd.extend(points.iter().step_by(step).map(|&point| to_px(point)));
            }
            SeriesShape::Line { points, .. } => {
                // Where a line is interrupted there is none to keep away from
                for part in points.split(|point| !is_finite(point)) {
                    let px: Vec<[f64; 2]> = part.iter().copied().map(to_px).collect();
                    // Strokes of 4 px: their ends are points every 4 px along the line.
                    lines.extend(
                        dashed(&px, &[4.0, 0.1]).into_iter().filter_map(|stroke| stroke.first().copied()),
                    );
                }
            }
            _ => {}
        }
    }
    found.retain(|(_, at)| frame.contains(*at));
    labels::place(&found, &crowd, &lines, frame, marks);
}

fn draw_color_bar(bar: &ColorBar, frame: Frame, marks: &mut Vec<Mark>) {
    let bar_frame = Frame { left: frame.right() + 16.0, width: BAR_WIDTH, ..frame };
    let steps = 256;
    let raster = Raster::from_fn(1, steps, |row, _| bar.map.color(1.0 - (row as f64 + 0.5) / steps as f64));
    marks.push(Mark::Picture { frame: bar_frame, raster });
    let mut outward = Vec::new();
    for tick in y_ticks(&bar.axis, frame.height) {
        let y = (frame.bottom() - bar.axis.position(tick.value) * frame.height).round();
        outward.push(vec![[bar_frame.right(), y], [bar_frame.right() + 4.0, y]]);
        if let Some(text) = &tick.text {
            let at = [bar_frame.right() + 7.0, y + 4.0];
            marks.push(text_mark(at, text, TICK_SIZE, Anchor::Start, Ink::Muted));
        }
    }
    marks.push(Mark::Strokes { lines: outward, width: 1.0, ink: Ink::Muted });
    let at = [bar_frame.left, frame.top - 13.0];
    marks.push(text_mark(at, &bar.axis.title(), LABEL_SIZE, Anchor::Start, Ink::Muted));
}

/// At most about [`SeriesShape::MOST_DOTS`] of the points, chosen by a hash of their place in the list: no image row or column is
/// favored, and the choice is the same every time.
fn shown(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    if points.len() <= SeriesShape::MOST_DOTS {
        return points.to_vec();
    }
    let share = SeriesShape::MOST_DOTS as f64 / points.len() as f64;
    let keep = |index: usize| {
        let mut hash = (index as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
        hash = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        hash = (hash ^ (hash >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((hash ^ (hash >> 31)) >> 11) as f64 / (1u64 << 53) as f64 <= share
    };
    points.iter().enumerate().filter(|(index, _)| keep(*index)).map(|(_, &point)| point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_clouds_are_thinned_evenly() {
        let points: Vec<[f64; 2]> = (0..200_000).map(|i| [f64::from(i), 0.0]).collect();
        let kept = shown(&points);
        // Binomial: 20 000 of 200 000, standard deviation 134. Five of them.
        assert!(kept.len().abs_diff(20_000) < 671, "{}", kept.len());
        let first_half = kept.iter().filter(|point| point[0] < 100_000.0).count();
        assert!((first_half as f64 - 10_000.0).abs() < 5.0 * 95.0, "{first_half}");
        assert_eq!(shown(&points[..9]).len(), 9);
    }

    /// A ring around a point leaves it seen.
    #[test]
    fn rings_hide_nothing() {
        let mut marks = Vec::new();
        marker([5.0, 5.0], 8.0, true, Ink::Text, &mut marks);
        assert!(matches!(marks[..], [Mark::Ring { .. }]));
    }

    /// Where a line is interrupted a name may stand.
    #[test]
    fn names_keep_away_from_lines_and_not_from_their_gaps() {
        let place = |lines: Vec<Vec<[f64; 2]>>| {
            let mut panel = Panel::new(Axis::linear("share", "", [0.0, 10.0]), Axis::hidden([0.0, 4.0]));
            for points in lines {
                panel = panel.with(Series::line("", Ink::Text, points));
            }
            let name = Label { at: [0.5, 2.0], text: "a name as long as half of the panel".into() };
            panel = panel.with(Series::unnamed(Ink::Text, SeriesShape::Labels(vec![name])));
            let drawing = lay_out(&Figure::new("Title", panel));
            let found = drawing.marks.iter().find_map(|mark| match mark {
                Mark::Text { at, text, .. } if text.starts_with("a name") => Some(*at),
                _ => None,
            });
            found.unwrap()
        };
        let (above, below) = (vec![[0.0, 2.4], [9.0, 2.4]], vec![[0.0, 1.6], [9.0, 1.6]]);
        let apart = place(vec![above.clone(), below.clone()]);
        let gap = vec![[f64::NAN, f64::NAN]];
        assert_eq!(place(vec![[above.clone(), gap, below.clone()].concat()]), apart);
        // The line from one end to the other is in the way
        assert_ne!(place(vec![[above, below].concat()]), apart);
    }

    #[test]
    fn everything_lies_inside_the_drawing() {
        let x = Axis::wavelength([380.0, 780.0]);
        let panel = Panel::new(x, Axis::from_zero("relative power", "W/nm", [0.8])).with(Series::line(
            "a rather long name of a light source",
            Ink::Text,
            vec![[400.0, 0.1], [700.0, 0.7]],
        ));
        let figure = Figure::grid("Title", vec![panel.clone(), panel.clone(), panel], 2);
        let drawing = lay_out(&figure);
        for mark in &drawing.marks {
            if let Mark::Text { at, text, size, anchor, .. } = mark {
                let width = font::width(text, f64::from(*size));
                let left = match anchor {
                    Anchor::Start => at[0],
                    Anchor::Middle => at[0] - 0.5 * width,
                    Anchor::End => at[0] - width,
                };
                assert!(left >= 0.0 && left + width <= drawing.width, "{text}: {left} + {width}");
                assert!(at[1] - f64::from(*size) >= 0.0 && at[1] + 4.0 <= drawing.height, "{text}");
            }
        }
    }
}
