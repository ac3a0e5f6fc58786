//! Wavelength bins with explicit edges.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::units::number_text;

/// Most bins a grid may have: 1 nm over the whole supported range and then some.
pub const MAX_BINS: usize = 2048;
/// Shortest wavelength supported, nm.
pub const MIN_WAVELENGTH_NM: f64 = 200.0;
/// Smallest and largest step between bins, nm.
const STEP_NM: [f64; 2] = [1e-6, MAX_WAVELENGTH_NM - MIN_WAVELENGTH_NM];
/// Longest wavelength supported, nm.
pub const MAX_WAVELENGTH_NM: f64 = 1200.0;

/// Contiguous wavelength bins, in nm, of any widths.
///
/// A spectral value on a grid is a density (per nm) averaged over its bin; integrals are `sum f * width`.
/// Cloning is cheap: the edges are shared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "Vec<f64>", into = "Vec<f64>")]
#[schemars(with = "Vec<f64>")]
pub struct WavelengthGrid {
    edges_nm: Arc<[f64]>,
}

/// Why a wavelength grid can't be made.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum GridError {
    /// Fewer than two edges.
    #[error("a wavelength grid needs at least one bin, that is two edges; got {0} edge(s)")]
    TooFew(usize),
    /// More bins than supported.
    #[error("a wavelength grid may have at most {MAX_BINS} bins; this one has {text}. Use a larger step", text = number_text(*.0 as f64))]
    TooMany(usize),
    /// Edges are not strictly increasing or not finite.
    #[error("wavelength edges must increase: edge {index} is {} nm after {} nm", number_text(*value), number_text(*previous))]
    NotIncreasing {
        /// Number of the edge, from 0.
        index: usize,
        /// Its value, nm.
        value: f64,
        /// The edge before it, nm.
        previous: f64,
    },
    /// Outside the supported range.
    #[error(
        "wavelength {text} nm is outside the supported {MIN_WAVELENGTH_NM} to {MAX_WAVELENGTH_NM} nm. \
         Is it in micrometers or meters? Wavelengths are given in nanometers",
        text = number_text(*.0)
    )]
    OutOfRange(f64),
    /// A step outside 1e-6 to 1000 nm.
    #[error(
        "the wavelength step must be between {} and {} nm; got {text}",
        number_text(STEP_NM[0]),
        number_text(STEP_NM[1]),
        text = number_text(*.0)
    )]
    BadStep(f64),
    /// Wavelengths that no bins side by side have as centers.
    #[error(
        "no adjacent bands have these centers: band {index} at {} nm would be at {} nm",
        number_text(*center), number_text(*nearest)
    )]
    Apart {
        /// Number of a band, from 1.
        index: usize,
        /// Its center, nm.
        center: f64,
        /// The center that half-way edges would give it, nm.
        nearest: f64,
    },
}

impl WavelengthGrid {
    /// Bins between consecutive edges, nm.
    ///
    /// # Errors
    /// Fewer than two edges, edges that do not increase, or edges outside 200 to 1200 nm.
    pub fn from_edges(edges_nm: &[f64]) -> Result<Self, GridError> {
        if edges_nm.len() < 2 {
            return Err(GridError::TooFew(edges_nm.len()));
        }
        if edges_nm.len() - 1 > MAX_BINS {
            return Err(GridError::TooMany(edges_nm.len() - 1));
        }
        for &edge in edges_nm {
            if !(MIN_WAVELENGTH_NM..=MAX_WAVELENGTH_NM).contains(&edge) {
                return Err(GridError::OutOfRange(edge));
            }
        }
        for (index, pair) in edges_nm.windows(2).enumerate() {
            if pair[1] <= pair[0] {
                return Err(GridError::NotIncreasing { index: index + 1, value: pair[1], previous: pair[0] });
            }
        }
        Ok(Self { edges_nm: edges_nm.into() })
    }

    /// Bins of one width centered on `first_nm`, `first_nm + step_nm`, ... up to `last_nm` (inclusive).
    ///
    /// # Errors
    /// A step outside 1e-6 to 1000 nm, more than [`MAX_BINS`] bins, or a range outside 200 to 1200 nm.
    pub fn uniform(first_nm: f64, last_nm: f64, step_nm: f64) -> Result<Self, GridError> {
        if !(STEP_NM[0]..=STEP_NM[1]).contains(&step_nm) {
            return Err(GridError::BadStep(step_nm));
        }
        for value in [first_nm, last_nm] {
            if !(MIN_WAVELENGTH_NM..=MAX_WAVELENGTH_NM).contains(&value) {
                return Err(GridError::OutOfRange(value));
            }
        }
        if last_nm < first_nm {
            return Err(GridError::NotIncreasing { index: 1, value: last_nm, previous: first_nm });
        }
        let bins = ((last_nm - first_nm) / step_nm + 1e-9).floor() + 1.0;
        if bins > MAX_BINS as f64 {
            return Err(GridError::TooMany(bins as usize));
        }
        let edges: Vec<f64> = (0..=bins as usize).map(|i| first_nm + (i as f64 - 0.5) * step_nm).collect();
        Self::from_edges(&edges)
    }

    /// Bins whose centers are the given wavelengths, the first as near as can be to half-way to the second.
    ///
    /// # Errors
    /// As [`WavelengthGrid::from_edges`]; one wavelength alone has no width; no bins side by side have these centers.
    pub fn from_centers(centers_nm: &[f64]) -> Result<Self, GridError> {
        let n = centers_nm.len();
        let edges = half_way_edges(centers_nm).ok_or(GridError::TooFew(n))?;
        let half_way = Self::from_edges(&edges)?;
        let off = |band: usize| (centers_nm[band] - half_way.center_nm(band)).abs();
        if (0..n).all(|band| off(band) <= 1e-6 * centers_nm[band]) {
            return Ok(half_way);
        }
        if let Some(edges) = edges_about(centers_nm, &edges) {
            return Self::from_edges(&edges);
        }
        // Wavelengths may be rounded
        let widths = half_way.widths_nm();
        match (0..n).find(|band| off(*band) > f64::max(ROUNDED_NM, ROUNDED_WIDTH * widths[*band])) {
            None => Ok(half_way),
            Some(band) => Err(GridError::Apart {
                index: band + 1,
                center: centers_nm[band],
                nearest: half_way.center_nm(band),
            }),
        }
    }

    /// Number of bins.
    pub fn len(&self) -> usize {
        self.edges_nm.len() - 1
    }

    /// Never true: a grid has at least one bin.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// All edges, nm; one more than there are bins.
    pub fn edges_nm(&self) -> &[f64] {
        &self.edges_nm
    }

    /// Center of a bin, nm.
    pub fn center_nm(&self, bin: usize) -> f64 {
        0.5 * (self.edges_nm[bin] + self.edges_nm[bin + 1])
    }

    /// Centers of all bins, nm.
    pub fn centers_nm(&self) -> Vec<f64> {
        (0..self.len()).map(|bin| self.center_nm(bin)).collect()
    }

    /// Width of a bin, nm.
    pub fn width_nm(&self, bin: usize) -> f64 {
        self.edges_nm[bin + 1] - self.edges_nm[bin]
    }

    /// Widths of all bins, nm.
    pub fn widths_nm(&self) -> Vec<f64> {
        (0..self.len()).map(|bin| self.width_nm(bin)).collect()
    }

    /// First edge, nm.
    pub fn start_nm(&self) -> f64 {
        self.edges_nm[0]
    }

    /// Last edge, nm.
    pub fn end_nm(&self) -> f64 {
        self.edges_nm[self.edges_nm.len() - 1]
    }

    /// The bin that a wavelength falls into.
    pub fn bin_of(&self, wavelength_nm: f64) -> Option<usize> {
        if !(self.start_nm()..self.end_nm()).contains(&wavelength_nm) {
            return None;
        }
        Some(self.edges_nm.partition_point(|&edge| edge <= wavelength_nm) - 1)
    }
}

impl Default for WavelengthGrid {
    /// 350 to 750 nm by 5 nm: 81 bins centered on the round numbers.
    fn default() -> Self {
        let edges: Vec<f64> = (0..=81).map(|i| 347.5 + 5.0 * f64::from(i)).collect();
        Self { edges_nm: edges.into() }
    }
}

impl TryFrom<Vec<f64>> for WavelengthGrid {
    type Error = GridError;
    fn try_from(edges_nm: Vec<f64>) -> Result<Self, GridError> {
        Self::from_edges(&edges_nm)
    }
}

impl From<WavelengthGrid> for Vec<f64> {
    fn from(grid: WavelengthGrid) -> Self {
        grid.edges_nm.to_vec()
    }
}

/// Edges half-way between wavelengths, the outermost as far out as the next are in; `None` of fewer than two.
fn half_way_edges(centers_nm: &[f64]) -> Option<Vec<f64>> {
    let ([first, second, ..], [.., last_but_one, last]) = (centers_nm, centers_nm) else { return None };
    let inner = centers_nm.windows(2).map(|pair| 0.5 * (pair[0] + pair[1]));
    let outer = [1.5 * first - 0.5 * second, 1.5 * last - 0.5 * last_but_one];
    Some(std::iter::once(outer[0]).chain(inner).chain([outer[1]]).collect())
}

/// By how much centers may lie off their bins, nm, and over the width of a bin.
const ROUNDED_NM: f64 = 0.5;
const ROUNDED_WIDTH: f64 = 0.1;
/// Most by which bins about uneven centers differ in width from those that end half-way to their neighbors.
const MOST_WIDTH_RATIO: f64 = 2.0;

/// Edges of bins with these centers: each lies as far above a center as that before it lies below, so that the first decides. `None` where one
/// would not lie between its neighbors, or bins become much wider or narrower than `half_way` ones.
fn edges_about(centers_nm: &[f64], half_way: &[f64]) -> Option<Vec<f64>> {
    // Edge k is t_k + first for even k, t_k - first for odd ones, and lies between the centers beside it
    let (mut offset, mut least, mut most) = (0.0, f64::NEG_INFINITY, centers_nm[0]);
    for (k, pair) in centers_nm.windows(2).enumerate() {
        offset = 2.0 * pair[0] - offset;
        let ends = match k % 2 {
            0 => [offset - pair[1], offset - pair[0]],
            _ => [pair[0] - offset, pair[1] - offset],
        };
        (least, most) = (f64::max(least, ends[0]), f64::min(most, ends[1]));
    }
    let wanted = half_way[0];
    let first = if wanted > least && wanted < most { wanted } else { 0.5 * (least + most) };
    let mut edges = vec![first];
    for center in centers_nm {
        edges.push(2.0 * center - edges[edges.len() - 1]);
    }
    let widths = |edges: &[f64]| edges.windows(2).map(|pair| pair[1] - pair[0]).collect::<Vec<_>>();
    let is_alike =
        |(width, other): (f64, f64)| width < MOST_WIDTH_RATIO * other && other < MOST_WIDTH_RATIO * width;
    let are_taken = edges.iter().all(|edge| (MIN_WAVELENGTH_NM..=MAX_WAVELENGTH_NM).contains(edge));
    (are_taken && widths(&edges).into_iter().zip(widths(half_way)).all(is_alike)).then_some(edges)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bands of a camera at uneven steps keep their wavelengths, where bins have them; 400, 410, 500, 510 have none.
    #[test]
    fn bins_about_uneven_wavelengths_have_these_as_centers() {
        for centers in [&[450.0, 500.0, 550.0, 650.0, 850.0][..], &[400.0, 410.0, 425.0, 440.0]] {
            let grid = WavelengthGrid::from_centers(centers).unwrap();
            let found = grid.centers_nm();
            assert!(found.iter().zip(centers).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?} {centers:?}");
        }
        // Bands of a camera, whose 717 nm would become 0.05 nm wide, and bands with a gap
        let camera = WavelengthGrid::from_centers(&[475.0, 560.0, 668.0, 717.0, 840.0]);
        assert_eq!(camera, Err(GridError::Apart { index: 3, center: 668.0, nearest: 653.25 }));
        let gap = WavelengthGrid::from_centers(&[400.0, 410.0, 500.0, 510.0]);
        assert_eq!(gap, Err(GridError::Apart { index: 2, center: 410.0, nearest: 430.0 }));
        // Even steps of 3.3 nm, rounded
        let rounded: Vec<f64> = (0..60).map(|k| (400.0 + 3.3 * f64::from(k)).round()).collect();
        let grid = WavelengthGrid::from_centers(&rounded).unwrap();
        assert!(grid.centers_nm().iter().zip(&rounded).all(|(a, b)| (a - b).abs() <= 0.5));
    }

    #[test]
    fn the_default_has_81_bins_on_round_numbers() {
        let grid = WavelengthGrid::default();
        assert_eq!(grid.len(), 81);
        assert_eq!((grid.center_nm(0), grid.center_nm(80)), (350.0, 750.0));
        assert_eq!(grid, WavelengthGrid::uniform(350.0, 750.0, 5.0).unwrap());
        assert_eq!(grid.bin_of(385.0), Some(7));
        assert_eq!(grid.bin_of(752.5), None);
    }

    #[test]
    fn bins_may_differ_in_width() {
        let grid = WavelengthGrid::from_edges(&[350.0, 352.5, 355.0, 360.0]).unwrap();
        assert_eq!(grid.widths_nm(), [2.5, 2.5, 5.0]);
        assert_eq!(grid.bin_of(352.5), Some(1));
    }

    #[test]
    fn mistakes_are_explained() {
        assert_eq!(WavelengthGrid::uniform(0.35, 0.75, 0.005), Err(GridError::OutOfRange(0.35)));
        assert_eq!(WavelengthGrid::uniform(350.0, 750.0, 0.0), Err(GridError::BadStep(0.0)));
        assert!(matches!(WavelengthGrid::uniform(350.0, 750.0, 0.01), Err(GridError::TooMany(_))));
        assert!(matches!(
            WavelengthGrid::from_edges(&[400.0, 390.0]),
            Err(GridError::NotIncreasing { index: 1, .. })
        ));
        assert!(WavelengthGrid::from_edges(&[400.0, f64::NAN]).is_err());
    }
}
