//! Keeps soft parts out of hard ones: rays against the parts that are placed already.

use fluorspar_accel::{Ray, TriangleBvh};
use glam::{DVec3, Vec3};

use fluorspar::geometry::TriangleMesh;

/// Surfaces that may not be entered, in the frame of the mouth.
pub(super) struct Obstacles {
    bvh: Option<TriangleBvh>,
}

impl Obstacles {
    pub(super) fn new<'m>(meshes: impl IntoIterator<Item = &'m TriangleMesh>) -> Self {
        let mut positions: Vec<Vec3> = Vec::new();
        let mut triangles: Vec<[u32; 3]> = Vec::new();
        for mesh in meshes {
            let first = positions.len() as u32;
            positions.extend_from_slice(&mesh.positions);
            triangles.extend(mesh.triangles.iter().map(|t| t.map(|v| v + first)));
        }
        // Generated meshes are finite: the build can't fail, and without it nothing is in the way.
        Self { bvh: TriangleBvh::build(&positions, &triangles).ok() }
    }

    /// Distance in millimeters from `origin` along the unit vector `direction` to the first surface nearer than
    /// `reach`, all in millimeters.
    pub(super) fn distance(&self, origin: DVec3, direction: DVec3, reach: f64) -> Option<f64> {
        let ray = Ray {
            origin: (origin * 1e-3).as_vec3(),
            direction: direction.as_vec3().normalize_or_zero(),
            t_min: 0.0,
            t_max: (reach * 1e-3) as f32,
        };
        self.bvh.as_ref()?.closest(&ray).map(|hit| f64::from(hit.t) * 1e3)
    }
}

/// A field of displacements or radii on a grid of rows and columns, closed around the columns or not.
pub(super) struct Field {
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) cyclic: bool,
    pub(super) values: Vec<f64>,
}

impl Field {
    /// Raises every value so that it falls from its neighbors by at most `slope` times their distance, given for one
    /// step along the rows and one along the columns; then blurs without sinking below what is needed.
    pub(super) fn spread(&mut self, slope: f64, row_step: f64, column_step: f64) {
        let needed = self.values.clone();
        let (rows, columns) = (self.rows as isize, self.columns as isize);
        let diagonal = (row_step * row_step + column_step * column_step).sqrt();
        // Two passes forward and two back carry every value across the grid.
        for pass in 0..4 {
            let back = pass % 2 == 1;
            for i in 0..rows * columns {
                let i = if back { rows * columns - 1 - i } else { i };
                let (row, column) = (i / columns, i % columns);
                let mut value = self.values[i as usize];
                for (dr, dc, step) in [
                    (0, 1, column_step),
                    (0, -1, column_step),
                    (1, 0, row_step),
                    (-1, 0, row_step),
                    (1, 1, diagonal),
                    (1, -1, diagonal),
                    (-1, 1, diagonal),
                    (-1, -1, diagonal),
                ] {
                    if let Some(other) = self.neighbor(row + dr, column + dc) {
                        value = value.max(self.values[other] - slope * step);
                    }
                }
                self.values[i as usize] = value;
            }
        }
        // Smooth, but never below the needed clearance
        for _ in 0..3 {
            let before = self.values.clone();
            for row in 0..rows {
                for column in 0..columns {
                    let (mut sum, mut weight) = (0.0, 0.0);
                    for dr in -1..=1 {
                        for dc in -1..=1 {
                            if let Some(other) = self.neighbor(row + dr, column + dc) {
                                sum += before[other];
                                weight += 1.0;
                            }
                        }
                    }
                    let i = (row * columns + column) as usize;
                    self.values[i] = needed[i].max(sum / weight);
                }
            }
        }
    }

    /// Raises the values to a smooth field over their largest neighbors within so many rows and columns: the mean, over
    /// the same window, of the largest values in it is nowhere below the value itself.
    pub(super) fn bridge(&mut self, rows: usize, columns: usize) {
        let pass = |values: &[f64], dr: isize, dc: isize, reach: usize, largest: bool| -> Vec<f64> {
            let reach = reach as isize;
            (0..self.rows as isize * self.columns as isize)
                .map(|i| {
                    let (row, column) = (i / self.columns as isize, i % self.columns as isize);
                    let (mut most, mut sum, mut count) = (0.0_f64, 0.0, 0.0);
                    for k in -reach..=reach {
                        if let Some(other) = self.neighbor(row + k * dr, column + k * dc) {
                            most = most.max(values[other]);
                            sum += values[other];
                            count += 1.0;
                        }
                    }
                    if largest { most } else { sum / count }
                })
                .collect()
        };
        let largest = pass(&pass(&self.values, 0, 1, columns, true), 1, 0, rows, true);
        self.values = pass(&pass(&largest, 0, 1, columns, false), 1, 0, rows, false);
    }

    fn neighbor(&self, row: isize, column: isize) -> Option<usize> {
        if row < 0 || row >= self.rows as isize {
            return None;
        }
        let columns = self.columns as isize;
        let column = if self.cyclic { column.rem_euclid(columns) } else { column };
        (0..columns).contains(&column).then(|| (row * columns + column) as usize)
    }

    /// Bilinear value at a place given in rows and columns.
    pub(super) fn at(&self, row: f64, column: f64) -> f64 {
        let row = row.clamp(0.0, (self.rows - 1) as f64);
        let r0 = (row.floor() as usize).min(self.rows.saturating_sub(2));
        let fr = row - r0 as f64;
        let (c0, c1, fc) = if self.cyclic {
            let c = column.rem_euclid(self.columns as f64);
            let c0 = (c.floor() as usize) % self.columns;
            (c0, (c0 + 1) % self.columns, c - c.floor())
        } else {
            let c = column.clamp(0.0, (self.columns - 1) as f64);
            let c0 = (c.floor() as usize).min(self.columns - 2);
            (c0, c0 + 1, c - c0 as f64)
        };
        let value = |r: usize, c: usize| self.values[r * self.columns + c];
        let low = value(r0, c0) * (1.0 - fc) + value(r0, c1) * fc;
        let high = value(r0 + 1, c0) * (1.0 - fc) + value(r0 + 1, c1) * fc;
        low * (1.0 - fr) + high * fr
    }
}
