//! Crosstalk: electrons that light of one pixel frees, or that drift, into its neighbors.
//!
//! A pixel that would collect `e` electrons hands `e s` to each of its four side neighbors and `e c` to each of the
//! four at its corners. Both shares act behind the color filter, so colors mix; nothing is lost. Optical shares are
//! equal for all wavelengths and grow with the square of the distance from the center (with the chief ray angle);
//! electrical shares depend on the wavelength, because red light is absorbed deeper. At the border nothing leaves.

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{ElectronRate, SensorProblem, SpectralQe};
use crate::image::Mosaic;
use crate::spectral::Curve;
use crate::units::number_text;

/// Shares of a pixel's electrons that end in its neighbors (physical and noise-free mode only).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Crosstalk {
    /// Optical crosstalk into each of the four side neighbors at the center of the sensor, percent. Default 0.
    pub optical_side_percent: f64,
    /// Optical crosstalk into each of the four corner neighbors at the center of the sensor, percent. Default 0.
    pub optical_corner_percent: f64,
    /// Optical crosstalk in the corners of the sensor over that at its center, 0 to 100. Default 1.
    pub optical_edge_factor: f64,
    /// Electrical crosstalk into each of the four side neighbors: pairs of wavelength in nm and percent, wavelengths
    /// rising; linear between them, constant outside. Default: none.
    pub electrical_side_percent: Vec<[f64; 2]>,
    /// Electrical crosstalk into each of the four corner neighbors over that into a side neighbor, 0 to 1. Default 0.
    pub electrical_corner_ratio: f64,
}

impl Default for Crosstalk {
    fn default() -> Self {
        Self {
            optical_side_percent: 0.0,
            optical_corner_percent: 0.0,
            optical_edge_factor: 1.0,
            electrical_side_percent: Vec::new(),
            electrical_corner_ratio: 0.0,
        }
    }
}

/// Most that all eight neighbors may get, percent.
const MOST_PERCENT: f64 = 80.0;

impl Crosstalk {
    pub(super) fn validate(&self) -> Result<(), SensorProblem> {
        let problem =
            |field: &str, message: String| Err(SensorProblem::new(format!("crosstalk.{field}"), message));
        for (field, value, most) in [
            ("optical_side_percent", self.optical_side_percent, 100.0),
            ("optical_corner_percent", self.optical_corner_percent, 100.0),
            ("optical_edge_factor", self.optical_edge_factor, 100.0),
            ("electrical_corner_ratio", self.electrical_corner_ratio, 1.0),
        ] {
            if !(0.0..=most).contains(&value) {
                return problem(field, format!("{} is outside 0 to {most}", number_text(value)));
            }
        }
        let pairs = &self.electrical_side_percent;
        if let Some([nm, percent]) =
            pairs.iter().find(|[nm, p]| !((0.0..=1e5).contains(nm) && (0.0..=100.0).contains(p)))
        {
            let message = format!(
                "[{}, {}] is not a pair of a wavelength, 0 to 100000 nm, and a share, 0 to 100 percent",
                number_text(*nm),
                number_text(*percent)
            );
            return problem("electrical_side_percent", message);
        }
        if let Some(pair) = pairs.windows(2).find(|pair| pair[1][0] <= pair[0][0]) {
            let message =
                format!("{} nm follows {} nm; sort the pairs by wavelength", pair[1][0], pair[0][0]);
            return problem("electrical_side_percent", message);
        }
        let optical = 4.0
            * (self.optical_side_percent + self.optical_corner_percent)
            * self.optical_edge_factor.max(1.0);
        let electrical = pairs.iter().map(|pair| pair[1]).fold(0.0, f64::max);
        let total = optical + 4.0 * electrical * (1.0 + self.electrical_corner_ratio);
        if total > MOST_PERCENT {
            let message = format!(
                "the eight neighbors get {total} percent of a pixel's electrons, more than {MOST_PERCENT}; lower the shares"
            );
            return Err(SensorProblem::new("crosstalk", message));
        }
        Ok(())
    }

    /// The same with the optical crosstalk everywhere of a place whose squared distance from the center is `radius2` of that of a corner.
    pub(super) fn at(&self, radius2: f64) -> Self {
        let factor = 1.0 + (self.optical_edge_factor - 1.0) * radius2;
        Self {
            optical_side_percent: factor * self.optical_side_percent,
            optical_corner_percent: factor * self.optical_corner_percent,
            optical_edge_factor: 1.0,
            ..self.clone()
        }
    }

    /// Electrical share of one side neighbor as a curve, if there is any.
    pub(super) fn electrical_share(&self) -> Option<Curve> {
        let pairs = &self.electrical_side_percent;
        let first = pairs.first()?;
        if pairs.iter().all(|pair| pair[1] == 0.0) {
            return None;
        }
        let at = |nm: f64| {
            let after = pairs.iter().position(|pair| pair[0] >= nm);
            match after {
                Some(0) => first[1],
                Some(index) => {
                    let ([x0, y0], [x1, y1]) = (pairs[index - 1], pairs[index]);
                    y0 + (y1 - y0) * (nm - x0) / (x1 - x0)
                }
                None => pairs[pairs.len() - 1][1],
            }
        };
        Some(Curve::from_fn(crate::spectral::MIN_WAVELENGTH_NM, crate::spectral::MAX_WAVELENGTH_NM, |nm| {
            at(nm) * 1e-2
        }))
    }

    /// Moves electrons between the pixels of a frame. `electrical` holds the electrons that each pixel hands to one
    /// side neighbor for electrical crosstalk, e-/s; empty if there is none.
    pub(super) fn spread(&self, rate: &ElectronRate, electrical: &[f32]) -> ElectronRate {
        let (columns, rows) = (rate.columns, rate.rows);
        let (side, corner) = (self.optical_side_percent * 1e-2, self.optical_corner_percent * 1e-2);
        let growth = self.optical_edge_factor - 1.0;
        let half_diagonal2 = 0.25 * ((columns * columns + rows * rows) as f64);
        let center = |index: usize, count: usize| index as f64 + 0.5 - 0.5 * count as f64;
        // Electrons that a pixel hands to one side and to one corner neighbor.
        let handed = |row: usize, col: usize| {
            let pixel = row * columns + col;
            let value = f64::from(rate.data[pixel]);
            let radius2 = (center(row, rows).powi(2) + center(col, columns).powi(2)) / half_diagonal2;
            let optical = value * (1.0 + growth * radius2);
            let drift = electrical.get(pixel).map_or(0.0, |&v| f64::from(v));
            [side * optical + drift, corner * optical + self.electrical_corner_ratio * drift]
        };
        let mut data = vec![0.0f32; columns * rows];
        // Add what each pixel receives from its neighbors and subtract what it hands to them
        data.par_chunks_exact_mut(columns).enumerate().for_each(|(row, out)| {
            for (col, out) in out.iter_mut().enumerate() {
                let own = handed(row, col);
                let mut sum = f64::from(rate.data[row * columns + col]);
                for down in -1..=1isize {
                    for right in -1..=1isize {
                        let (Some(r), Some(c)) =
                            (row.checked_add_signed(down), col.checked_add_signed(right))
                        else {
                            continue;
                        };
                        let kind = match down.abs() + right.abs() {
                            0 => continue,
                            1 => 0,
                            _ => 1,
                        };
                        if r < rows && c < columns {
                            sum += handed(r, c)[kind] - own[kind];
                        }
                    }
                }
                *out = sum as f32;
            }
        });
        ElectronRate { columns, rows, data }
    }

    /// Quantum efficiencies that a channel shows to a uniform field at the center of the sensor, averaged over its
    /// places in the mosaic: its own, less what leaves, plus what its neighbors hand over.
    pub(super) fn mixed(&self, qe: &SpectralQe, mosaic: &Mosaic) -> SpectralQe {
        let channels = qe.channels();
        let drift = self.electrical_share();
        let (side, corner) = (self.optical_side_percent * 1e-2, self.optical_corner_percent * 1e-2);
        let curves = (0..channels.len()).map(|channel| {
            let neighbors = NeighborCount::of(mosaic, channel);
            let (first, last) = channels.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), other| {
                (a.min(other.curve.range_nm().0), b.max(other.curve.range_nm().1))
            });
            let curve = Curve::from_fn(first, last, |nm| {
                let drift = drift.as_ref().map_or(0.0, |curve| curve.at(nm));
                let (side, corner) = (side + drift, corner + self.electrical_corner_ratio * drift);
                let arriving: f64 = channels
                    .iter()
                    .enumerate()
                    .map(|(k, other)| {
                        other.curve.at(nm) * (side * neighbors.side[k] + corner * neighbors.corner[k])
                    })
                    .sum();
                channels[channel].curve.at(nm) * (1.0 - 4.0 * (side + corner)) + arriving
            });
            (channels[channel].name.clone(), curve)
        });
        let mixed: Vec<(String, Curve)> = curves.collect();
        qe.with_curves(mixed.into_iter().map(|(_, curve)| curve))
    }
}

/// Mean number of neighbors of each channel around the pixels of one channel.
struct NeighborCount {
    side: Vec<f64>,
    corner: Vec<f64>,
}

impl NeighborCount {
    fn of(mosaic: &Mosaic, channel: usize) -> Self {
        let mut count =
            Self { side: vec![0.0; mosaic.channels.len()], corner: vec![0.0; mosaic.channels.len()] };
        let mut places = 0.0;
        // One cell further on, so that every neighbor has a place.
        for row in mosaic.rows..2 * mosaic.rows {
            for col in mosaic.cols..2 * mosaic.cols {
                if mosaic.channel(row, col) != channel {
                    continue;
                }
                places += 1.0;
                for (down, right) in
                    [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (-1, 1), (1, -1), (1, 1isize)]
                {
                    let at = mosaic.channel(row.wrapping_add_signed(down), col.wrapping_add_signed(right));
                    let list = if down == 0 || right == 0 { &mut count.side } else { &mut count.corner };
                    list[at] += 1.0;
                }
            }
        }
        for value in count.side.iter_mut().chain(&mut count.corner) {
            *value /= f64::max(places, 1.0);
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn strong() -> Crosstalk {
        Crosstalk {
            optical_side_percent: 2.0,
            optical_corner_percent: 0.5,
            optical_edge_factor: 3.0,
            electrical_side_percent: vec![[450.0, 1.0], [650.0, 4.0]],
            electrical_corner_ratio: 0.25,
        }
    }

    #[test]
    fn a_point_spreads_over_its_neighbors_and_nothing_is_lost() {
        let mut rate = ElectronRate { columns: 7, rows: 5, data: vec![0.0; 35] };
        rate.data[2 * 7 + 3] = 1000.0;
        let mut drift = vec![0.0; 35];
        drift[2 * 7 + 3] = 30.0;
        let spread = strong().spread(&rate, &drift);
        let at = |row: usize, col: usize| spread.data[row * 7 + col];
        // The center pixel: 20 + 30 to each side, 5 + 7.5 to each corner.
        assert_eq!([at(1, 3), at(3, 3), at(2, 2), at(2, 4)], [50.0; 4]);
        assert_eq!([at(1, 2), at(1, 4), at(3, 2), at(3, 4)], [12.5; 4]);
        assert_eq!(at(2, 3), 1000.0 - 4.0 * 62.5);
        let uneven =
            ElectronRate { columns: 7, rows: 5, data: (0..35).map(|i| (i * i % 17) as f32).collect() };
        let total = |rate: &ElectronRate| rate.data.iter().map(|&v| f64::from(v)).sum::<f64>();
        let after = strong().spread(&uneven, &[]);
        assert!((total(&after) / total(&uneven) - 1.0).abs() < 1e-6, "electrons at the border must stay");
    }

    #[test]
    fn shares_are_interpolated_between_their_wavelengths() {
        let share = strong().electrical_share().unwrap();
        for (nm, percent) in [(400.0, 1.0), (450.0, 1.0), (550.0, 2.5), (650.0, 4.0), (900.0, 4.0)] {
            assert!((share.at(nm) - 1e-2 * percent).abs() < 1e-9, "{nm} nm");
        }
        assert!(Crosstalk::default().electrical_share().is_none());
    }

    #[test]
    fn problems_name_the_field() {
        let field = |crosstalk: Crosstalk| crosstalk.validate().unwrap_err().field;
        assert!(strong().validate().is_ok());
        assert_eq!(
            field(Crosstalk { optical_side_percent: -1.0, ..strong() }),
            "crosstalk.optical_side_percent"
        );
        assert_eq!(field(Crosstalk { optical_side_percent: 30.0, ..strong() }), "crosstalk");
        let unsorted = vec![[650.0, 1.0], [450.0, 1.0]];
        assert_eq!(
            field(Crosstalk { electrical_side_percent: unsorted, ..strong() }),
            "crosstalk.electrical_side_percent"
        );
    }
}
