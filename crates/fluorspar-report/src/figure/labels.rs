//! Puts names beside points where they cover least.

use super::drawing::{Anchor, Frame, Mark};
use super::font;
use super::{Ink, Label};

const SIZE: u32 = 12;
/// Distance of the lines of a label of several, px.
const LINE: f64 = 15.0;

/// The lines of a text of a size, none wider than `width` px but a word that is.
pub(super) fn wrapped(text: &str, size: u32, width: f64) -> Vec<String> {
    let mut rows = vec![String::new()];
    for word in text.split(' ') {
        let row = rows.last().cloned().unwrap_or_default();
        let longer = if row.is_empty() { word.to_owned() } else { format!("{row} {word}") };
        match font::width(&longer, f64::from(size)) > width && !row.is_empty() {
            true => rows.push(word.to_owned()),
            false => *rows.last_mut().unwrap_or(&mut String::new()) = longer,
        }
    }
    rows
}

/// Draws each label near its point. `crowd` are dots and `lines` are points along lines that labels should rather not cover.
pub(super) fn place(
    labels: &[(&Label, [f64; 2])],
    crowd: &[[f64; 2]],
    lines: &[[f64; 2]],
    panel: Frame,
    marks: &mut Vec<Mark>,
) {
    let mut taken: Vec<Frame> = labels
        .iter()
        .map(|(_, at)| Frame { left: at[0] - 7.0, top: at[1] - 7.0, width: 14.0, height: 14.0 })
        .collect();
    for (label, at) in labels {
        let rows = wrapped(&label.text, SIZE, panel.width - 6.0);
        let widest = rows.iter().map(|row| font::width(row, f64::from(SIZE))).fold(0.0, f64::max);
        let width = widest + 6.0;
        let height = LINE * (rows.len() - 1) as f64 + f64::from(SIZE) + 5.0;
        let mut best: Option<(f64, Frame, bool)> = None;
        for (ring, reach) in [10.0, 24.0, 42.0, 64.0, 90.0].into_iter().enumerate() {
            for (turn, [dx, dy]) in DIRECTIONS.into_iter().enumerate() {
                let left = at[0]
                    + dx * reach
                    + if dx < -0.1 {
                        -width
                    } else if dx > 0.1 {
                        0.0
                    } else {
                        -0.5 * width
                    };
                let top = at[1]
                    + dy * reach
                    + if dy < -0.8 {
                        -height
                    } else if dy > 0.8 {
                        0.0
                    } else {
                        -0.5 * height
                    };
                let frame = Frame { left, top, width, height };
                let outside = width * height - frame.overlap(&panel);
                let hidden: f64 = taken.iter().map(|other| frame.overlap(other)).sum();
                let within = |points: &[[f64; 2]]| {
                    points.iter().filter(|point| frame.contains(**point)).count() as f64
                };
                let covered = 12_000.0 * within(crowd) / crowd.len().max(1) as f64 + 40.0 * within(lines);
                let cost = 30.0 * outside + 20.0 * hidden + covered + 60.0 * ring as f64 + 5.0 * turn as f64;
                if best.is_none_or(|(least, ..)| cost < least) {
                    best = Some((cost, frame, covered > 0.0));
                }
            }
        }
        let Some((_, mut frame, covers)) = best else { continue };
        // What reaches over a side of the panel is cut off there
        frame.left = frame.left.min(panel.right() - width).max(panel.left);
        let nearest = [at[0].clamp(frame.left, frame.right()), at[1].clamp(frame.top, frame.bottom())];
        let gap = (nearest[0] - at[0]).hypot(nearest[1] - at[1]);
        if gap > 14.0 {
            let edge = [0, 1].map(|i| at[i] + (nearest[i] - at[i]) * 8.0 / gap);
            marks.push(Mark::Strokes { lines: vec![vec![edge, nearest]], width: 1.0, ink: Ink::Muted });
        }
        if covers {
            marks.push(Mark::Rect { frame, opacity: 0.8, ink: Ink::Paper });
        }
        for (above, text) in rows.into_iter().rev().enumerate() {
            marks.push(Mark::Text {
                at: [frame.left + 3.0, frame.bottom() - 5.0 - LINE * above as f64],
                text,
                size: SIZE,
                anchor: Anchor::Start,
                ink: Ink::Text,
            });
        }
        taken.push(frame);
    }
}

/// Right, left, above, below and the corners, y downwards.
const DIRECTIONS: [[f64; 2]; 8] =
    [[1.0, 0.0], [-1.0, 0.0], [0.0, -1.0], [0.0, 1.0], [0.7, -0.7], [-0.7, -0.7], [0.7, 0.7], [-0.7, 0.7]];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_wider_than_its_panel_has_several_lines_inside() {
        let text = "Share of the bulk of 6 fluorophores, unmixed from all signals";
        let label = Label { at: [0.0; 2], text: text.into() };
        let panel = Frame { left: 20.0, top: 0.0, width: 220.0, height: 90.0 };
        let mut marks = Vec::new();
        place(&[(&label, [25.0, 14.0])], &[], &[], panel, &mut marks);
        let rows: Vec<(f64, String)> = marks
            .into_iter()
            .filter_map(
                |mark| if let Mark::Text { at, text, .. } = mark { Some((at[0], text)) } else { None },
            )
            .collect();
        assert!(rows.len() == 2, "{rows:?}");
        let ends = rows.iter().map(|(left, text)| left + font::width(text, f64::from(SIZE)));
        assert!(
            ends.into_iter().all(|end| end <= panel.right()) && rows.iter().all(|(left, _)| *left >= 20.0)
        );
        let words: Vec<&str> = rows.iter().rev().map(|(_, text)| text.as_str()).collect();
        assert_eq!(words.join(" "), text);
    }

    /// A name in a ring that is too narrow for it stands outside rather than across the ring.
    #[test]
    fn a_label_does_not_lie_across_a_line() {
        let label = Label { at: [0.0; 2], text: "Collagen I".into() };
        let panel = Frame { left: 0.0, top: 0.0, width: 300.0, height: 300.0 };
        let ring: Vec<[f64; 2]> = (0..60)
            .map(|step| f64::from(step) * std::f64::consts::TAU / 60.0)
            .map(|angle| [150.0 + 38.0 * angle.cos(), 150.0 + 38.0 * angle.sin()])
            .collect();
        let mut marks = Vec::new();
        place(&[(&label, [150.0, 150.0])], &[], &ring, panel, &mut marks);
        assert!(!marks.iter().any(|mark| matches!(mark, Mark::Rect { .. })), "it covers a part of the ring");
    }

    #[test]
    fn labels_of_close_points_do_not_cover_each_other() {
        let names = ["collagen", "elastin", "FAD", "NADH"];
        let labels: Vec<Label> = names.iter().map(|n| Label { at: [0.0; 2], text: (*n).into() }).collect();
        let points = [[100.0, 100.0], [108.0, 104.0], [96.0, 110.0], [104.0, 94.0]];
        let pairs: Vec<(&Label, [f64; 2])> = labels.iter().zip(points).collect();
        let panel = Frame { left: 0.0, top: 0.0, width: 300.0, height: 300.0 };
        let mut marks = Vec::new();
        // A crowd under all of them, so that every label gets a backing whose place can be read.
        let crowd: Vec<[f64; 2]> =
            (0..10_000).map(|i| [f64::from(i % 100) * 3.0, f64::from(i / 100) * 3.0]).collect();
        place(&pairs, &crowd, &[], panel, &mut marks);
        let frames: Vec<Frame> = marks
            .iter()
            .filter_map(|mark| if let Mark::Rect { frame, .. } = mark { Some(*frame) } else { None })
            .collect();
        assert_eq!(frames.len(), 4);
        for (i, a) in frames.iter().enumerate() {
            assert!(frames[..i].iter().all(|b| a.overlap(b) == 0.0));
            assert!(points.iter().all(|point| !a.contains(*point)));
        }
    }
}
