//! Polygons of mesh files as triangles.

use glam::{DVec2, DVec3, Vec3};

/// Most corners of a polygon that is not convex: its time grows with their square.
pub(crate) const MOST_CONCAVE_CORNERS: usize = 2000;
/// Sine of a turn to the wrong side that counts as straight.
const STRAIGHT: f64 = 1e-5;
/// How often all corners are looked at again when none can be cut, as of outlines that touch themselves.
const MOST_ROUNDS: usize = 16;

/// Splits a face into triangles that cover it once: a fan where it is convex, ears cut off one by one elsewhere (Meisters 1975).
/// What is left of an outline that crosses itself is a fan. `false` for a concave one of more than [`MOST_CONCAVE_CORNERS`].
pub(crate) fn push_triangles(positions: &[Vec3], corners: &[u32], triangles: &mut Vec<[u32; 3]>) -> bool {
    let outline = if corners.len() > 3 { flat_outline(positions, corners) } else { None };
    match outline.filter(|outline| !is_convex(outline)) {
        None => push_fan(corners, triangles),
        Some(outline) if outline.len() > MOST_CONCAVE_CORNERS => return false,
        Some(outline) => Ears::new(&outline).cut(corners, triangles),
    }
    true
}

fn push_fan(corners: &[u32], triangles: &mut Vec<[u32; 3]>) {
    if let Some((&first, rest)) = corners.split_first() {
        triangles.extend(rest.windows(2).map(|pair| [first, pair[0], pair[1]]));
    }
}

/// The outline on the plane of axes that it faces most, counterclockwise; `None` where a vertex is missing or it has no area.
fn flat_outline(positions: &[Vec3], corners: &[u32]) -> Option<Vec<DVec2>> {
    let points: Vec<DVec3> = corners
        .iter()
        .map(|corner| positions.get(*corner as usize).map(|p| p.as_dvec3()))
        .collect::<Option<_>>()?;
    let first = points[0];
    let normal: DVec3 = points.windows(2).map(|pair| (pair[0] - first).cross(pair[1] - first)).sum();
    let size = normal.abs();
    let largest = size.max_element();
    if !(largest > 0.0 && largest.is_finite()) {
        return None;
    }
    let axis = if largest == size.x {
        0
    } else if largest == size.y {
        1
    } else {
        2
    };
    let [u, v] =
        if normal[axis] > 0.0 { [(axis + 1) % 3, (axis + 2) % 3] } else { [(axis + 2) % 3, (axis + 1) % 3] };
    Some(points.iter().map(|p| DVec2::new(p[u] - first[u], p[v] - first[v])).collect())
}

/// Twice the area of a triangle, positive counterclockwise.
fn turn(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - b)
}

fn is_convex(outline: &[DVec2]) -> bool {
    let count = outline.len();
    (0..count).all(|i| {
        let [a, b, c] = [0, 1, 2].map(|k| outline[(i + k) % count]);
        turn(a, b, c) >= -STRAIGHT * a.distance(b) * b.distance(c)
    })
}

/// An outline from which ears are cut.
struct Ears<'a> {
    outline: &'a [DVec2],
    /// Neighbors of each corner that is left.
    before: Vec<usize>,
    after: Vec<usize>,
    is_left: Vec<bool>,
    count: usize,
}

impl<'a> Ears<'a> {
    fn new(outline: &'a [DVec2]) -> Self {
        let count = outline.len();
        Self {
            outline,
            before: (0..count).map(|i| (i + count - 1) % count).collect(),
            after: (0..count).map(|i| (i + 1) % count).collect(),
            is_left: vec![true; count],
            count,
        }
    }

    fn turn_at(&self, i: usize) -> f64 {
        turn(self.outline[self.before[i]], self.outline[i], self.outline[self.after[i]])
    }

    /// Whether the triangle of a corner and its neighbors lies within the outline: no corner that turns inward lies in it.
    fn is_ear(&self, i: usize) -> bool {
        let triangle = [self.before[i], i, self.after[i]].map(|k| self.outline[k]);
        let [a, b, c] = triangle;
        let blocks = |j: usize| {
            let p = self.outline[j];
            self.is_left[j]
                && !triangle.contains(&p)
                && turn(a, b, p) >= 0.0
                && turn(b, c, p) >= 0.0
                && turn(c, a, p) >= 0.0
                && self.turn_at(j) <= 0.0
        };
        !(0..self.outline.len()).any(blocks)
    }

    fn cut(mut self, corners: &[u32], triangles: &mut Vec<[u32; 3]>) {
        for _ in 0..MOST_ROUNDS {
            let before = self.count;
            let mut open: Vec<usize> = (0..corners.len()).filter(|&i| self.is_left[i]).rev().collect();
            // A cut makes ears of its neighbors only: what is left lies within what there was.
            while let Some(i) = open.pop().filter(|_| self.count > 3) {
                let turn = if self.is_left[i] { self.turn_at(i) } else { -1.0 };
                // A corner on a straight side has no area to lose.
                if turn == 0.0 || (turn > 0.0 && self.is_ear(i)) {
                    let (before, after) = (self.before[i], self.after[i]);
                    if turn > 0.0 {
                        triangles.push([before, i, after].map(|k| corners[k]));
                    }
                    self.is_left[i] = false;
                    self.count -= 1;
                    (self.after[before], self.before[after]) = (after, before);
                    open.extend([before, after]);
                }
            }
            if self.count == 3 || self.count == before {
                break;
            }
        }
        let rest: Vec<u32> = (0..corners.len()).filter(|&i| self.is_left[i]).map(|i| corners[i]).collect();
        push_fan(&rest, triangles);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles of an outline, and the sum of their areas, each positive.
    fn split(points: &[Vec3]) -> (Vec<[u32; 3]>, f64) {
        let corners: Vec<u32> = (0..points.len() as u32).collect();
        let mut triangles = Vec::new();
        assert!(push_triangles(points, &corners, &mut triangles));
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|k| points[k as usize].as_dvec3());
            0.5 * (b - a).cross(c - a).length()
        };
        let sum = triangles.iter().map(area).sum();
        (triangles, sum)
    }

    /// Areas by Gauss's formula, by hand. A fan of the first covers 3, and the second twice of what lies outside.
    #[test]
    fn concave_outlines_are_covered_once() {
        let flat = |points: &[[f32; 2]]| -> Vec<Vec3> {
            points.iter().map(|p| Vec3::new(p[0], p[1], 0.0)).collect()
        };
        let notch = flat(&[[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [0.9, -0.9], [-1.0, 1.0]]);
        let comb = flat(&[
            [0.0, 0.0],
            [5.0, 0.0],
            [5.0, 2.0],
            [4.0, 2.0],
            [4.0, 1.0],
            [3.0, 1.0],
            [3.0, 2.0],
            [2.0, 2.0],
            [2.0, 1.0],
            [1.0, 1.0],
            [1.0, 2.0],
            [0.0, 2.0],
        ]);
        let arrow = flat(&[[0.0, 0.0], [2.0, 1.0], [0.0, 2.0], [1.0, 1.0]]);
        // A square of side 3 with a hole of side 1, joined by a seam.
        let ring = flat(&[
            [0.0, 0.0],
            [3.0, 0.0],
            [3.0, 3.0],
            [0.0, 3.0],
            [0.0, 0.0],
            [1.0, 1.0],
            [1.0, 2.0],
            [2.0, 2.0],
            [2.0, 1.0],
            [1.0, 1.0],
        ]);
        for (points, expected) in [(notch, 2.1), (comb, 8.0), (arrow, 1.0), (ring, 8.0)] {
            for turned in [false, true] {
                // On a plane askew, from either side, whatever corner is first.
                let mut points: Vec<Vec3> = points.iter().map(|p| Vec3::new(p.y, 0.0, p.x)).collect();
                if turned {
                    points.reverse();
                }
                for _ in 0..points.len() {
                    points.rotate_left(1);
                    let (triangles, area) = split(&points);
                    assert!((area - expected).abs() < 1e-6, "{area} {expected} {triangles:?}");
                    let side = if turned { -1.0 } else { 1.0 };
                    for t in &triangles {
                        let [a, b, c] = t.map(|k| points[k as usize]);
                        assert!((b - a).cross(c - a).y * side >= 0.0, "{t:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn convex_outlines_are_fans_and_what_has_no_area_is_harmless() {
        let circle: Vec<Vec3> = (0..5000)
            .map(|i| Vec3::new((i as f32 * 1.256_637e-3).cos(), (i as f32 * 1.256_637e-3).sin(), 0.0))
            .collect();
        let (triangles, _) = split(&circle);
        assert_eq!((triangles.len(), triangles[7]), (4998, [0, 8, 9]));
        assert_eq!(split(&[Vec3::ZERO; 6]).0.len(), 4);
        let crossed = [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0], [0.4, 2.0]];
        split(&crossed.map(|[x, y]| Vec3::new(x, y, 0.0)));
        split(&[Vec3::NAN, Vec3::X, Vec3::Y, Vec3::ONE]);
        let mut triangles = Vec::new();
        assert!(push_triangles(&[Vec3::ZERO], &[0, 1, 2, 9], &mut triangles) && triangles.len() == 2);
        let comb: Vec<Vec3> = (0..4000)
            .map(|i| Vec3::new(i as f32, (i % 2) as f32, 0.0))
            .chain([Vec3::new(2e3, 9.0, 0.0)])
            .collect();
        let corners: Vec<u32> = (0..comb.len() as u32).collect();
        assert!(!push_triangles(&comb, &corners, &mut triangles));
    }
}
