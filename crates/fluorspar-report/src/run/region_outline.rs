//! The outline of a region of pixels.

use std::collections::BTreeMap;

use fluorspar::analysis::PixelSelection;

/// Closed lines around the pixels of a region, in pixels divided by `block`; corners only.
pub(super) fn region_outline(region: &PixelSelection, block: usize) -> Vec<Vec<[f64; 2]>> {
    let (width, height) = (region.width, region.height);
    let mut inside = vec![false; width * height];
    region.pixels.iter().for_each(|&pixel| inside[pixel] = true);
    let is_inside = |x: isize, y: isize| {
        x >= 0
            && y >= 0
            && (x as usize) < width
            && (y as usize) < height
            && inside[y as usize * width + x as usize]
    };
    // Edges between inside and outside, the region to the right of each
    let mut edges: BTreeMap<[usize; 2], Vec<[usize; 2]>> = BTreeMap::new();
    for &pixel in &region.pixels {
        let (x, y) = (pixel % width, pixel / width);
        let (col, row) = (x as isize, y as isize);
        let sides = [
            (is_inside(col, row - 1), [x, y], [x + 1, y]),
            (is_inside(col + 1, row), [x + 1, y], [x + 1, y + 1]),
            (is_inside(col, row + 1), [x + 1, y + 1], [x, y + 1]),
            (is_inside(col - 1, row), [x, y + 1], [x, y]),
        ];
        for (_, from, to) in sides.into_iter().filter(|(joined, ..)| !joined) {
            edges.entry(from).or_default().push(to);
        }
    }
    let scaled = |[x, y]: [usize; 2]| [x, y].map(|v| (10.0 * v as f64 / block as f64).round() / 10.0);
    let mut lines = Vec::new();
    while let Some((&start, _)) = edges.iter().next() {
        let mut corners: Vec<[usize; 2]> = vec![start];
        let mut here = start;
        while let Some(next) = take(&mut edges, here) {
            // A straight line needs its ends only
            if let [.., a, b] = corners.as_slice()
                && (a[0] == b[0] && b[0] == next[0] || a[1] == b[1] && b[1] == next[1])
            {
                corners.pop();
            }
            corners.push(next);
            here = next;
            if here == start {
                break;
            }
        }
        corners.pop();
        lines.push(corners.into_iter().map(scaled).collect());
    }
    lines
}

fn take(edges: &mut BTreeMap<[usize; 2], Vec<[usize; 2]>>, from: [usize; 2]) -> Option<[usize; 2]> {
    let list = edges.get_mut(&from)?;
    let next = list.pop();
    if list.is_empty() {
        edges.remove(&from);
    }
    next
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outline(width: usize, height: usize, pixels: &[usize]) -> Vec<Vec<[f64; 2]>> {
        region_outline(&PixelSelection { width, height, pixels: pixels.to_vec() }, 1)
    }

    #[test]
    fn an_l_has_six_corners_and_a_ring_two_lines() {
        // Two pixels above, one below to the left.
        let corners = &outline(3, 3, &[0, 1, 3])[0];
        assert_eq!(corners.len(), 6, "{corners:?}");
        let ring: Vec<usize> = (0..9).filter(|&pixel| pixel != 4).collect();
        let lines = outline(3, 3, &ring);
        assert_eq!((lines.len(), lines[0].len(), lines[1].len()), (2, 4, 4));
        assert_eq!(lines[0], [[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [0.0, 3.0]]);
    }

    #[test]
    fn pixels_that_touch_at_a_corner_keep_closed_lines() {
        let lines = outline(2, 2, &[0, 3]);
        assert_eq!(lines.iter().map(Vec::len).sum::<usize>(), 8);
        assert!(outline(2, 2, &[]).is_empty());
    }
}
