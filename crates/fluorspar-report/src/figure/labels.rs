//! Puts names beside points where they cover least.

use super::drawing::{Anchor, Frame, Mark};
use super::font;
use super::{Ink, Label};

const SIZE: u32 = 12;

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
        let width = font::width(&label.text, f64::from(SIZE)) + 6.0;
        let height = f64::from(SIZE) + 5.0;
        let mut best: Option<(f64, Frame, bool)> = None;
        for (ring, reach) in [10.0, 24.0, 42.0, 64.0].into_iter().enumerate() {
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
                let covered = 6000.0 * within(crowd) / crowd.len().max(1) as f64 + 25.0 * within(lines);
                let cost = 30.0 * outside + 20.0 * hidden + covered + 120.0 * ring as f64 + 5.0 * turn as f64;
                if best.is_none_or(|(least, ..)| cost < least) {
                    best = Some((cost, frame, covered > 0.0));
                }
            }
        }
        let Some((_, frame, covers)) = best else { continue };
        let nearest = [at[0].clamp(frame.left, frame.right()), at[1].clamp(frame.top, frame.bottom())];
        let gap = (nearest[0] - at[0]).hypot(nearest[1] - at[1]);
        if gap > 14.0 {
            let edge = [0, 1].map(|i| at[i] + (nearest[i] - at[i]) * 8.0 / gap);
            marks.push(Mark::Strokes { lines: vec![vec![edge, nearest]], width: 1.0, ink: Ink::Muted });
        }
        if covers {
            marks.push(Mark::Rect { frame, opacity: 0.8, ink: Ink::Paper });
        }
        marks.push(Mark::Text {
            at: [frame.left + 3.0, frame.bottom() - 5.0],
            text: label.text.clone(),
            size: SIZE,
            anchor: Anchor::Start,
            ink: Ink::Text,
        });
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
