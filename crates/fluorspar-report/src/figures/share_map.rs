//! The share of a fluorophore over the region, and how little of it a pixel shows.

use fluorspar::analysis::{Analyte, BlockShares, PorphyrinMap, Statistics};

use crate::{Axis, ColorBar, ColorMap, Dash, Figure, Ink, Panel, Raster, Series, SeriesShape};

/// Color where no pixel counts.
const NONE: [u8; 3] = [128; 3];

/// A map is averaged over blocks of pixels until noise moves it by this share of the light.
const QUIET_MAP: f64 = 0.007;
/// Blocks that a map is averaged over, px.
const MAP_BLOCKS: [usize; 8] = [1, 2, 3, 4, 6, 8, 12, 16];
/// Least share at the upper end of the color scale.
const LEAST_TOP: f64 = 0.02;

/// Means of the share over blocks of pixels within the bounds of a region.
pub(crate) struct ShareMap {
    /// Left and top edge, in pixels of the sensor.
    pub(crate) left: usize,
    pub(crate) above: usize,
    /// Blocks.
    pub(crate) columns: usize,
    /// Blocks.
    pub(crate) rows: usize,
    /// Side of a block, px.
    pub(crate) block: usize,
    /// Means; none where no pixel counts.
    pub(crate) values: Vec<Option<f32>>,
    /// Blocks that hold it for certain enough; empty where that is not known.
    marked: Vec<bool>,
}

impl ShareMap {
    pub(crate) fn of(porphyrin: &PorphyrinMap, region: &[usize]) -> Option<Self> {
        let width = porphyrin.width;
        let errors = region.iter().filter_map(|&pixel| porphyrin.at(pixel));
        let error = Statistics::of(errors.map(|e| e.position_standard_error))?.median;
        let block =
            *MAP_BLOCKS.iter().find(|&&block| error / block as f64 <= QUIET_MAP).or(MAP_BLOCKS.last())?;
        let bounds = |of: &dyn Fn(usize) -> usize| {
            region.iter().map(|&pixel| of(pixel)).fold((usize::MAX, 0), |(a, b), v| (a.min(v), b.max(v)))
        };
        let (left, right) = bounds(&|pixel| pixel % width);
        let (above, below) = bounds(&|pixel| pixel / width);
        let (columns, rows) = ((right + 1 - left).div_ceil(block), (below + 1 - above).div_ceil(block));
        let mut sums = vec![(0.0f64, 0usize); columns * rows];
        for &pixel in region {
            if let Some(estimate) = porphyrin.at(pixel).filter(|e| e.position.is_finite()) {
                let (col, row) = ((pixel % width - left) / block, (pixel / width - above) / block);
                let (sum, count) = &mut sums[row * columns + col];
                *sum += estimate.position;
                *count += 1;
            }
        }
        let mean = |&(sum, count): &(f64, usize)| (count > 0).then(|| (sum / count as f64) as f32);
        let values = sums.iter().map(mean).collect();
        Some(Self { left, above, columns, rows, block, values, marked: Vec::new() })
    }

    /// The blocks by which the share of a region was estimated.
    pub(crate) fn of_blocks(shares: &BlockShares) -> Option<Self> {
        let block = shares.side_px.max(1);
        let bounds = |axis: usize| {
            let places = shares.blocks.iter().map(|share| share.corner_px[axis] / block);
            places.fold((usize::MAX, 0), |(a, b), v| (a.min(v), b.max(v)))
        };
        let ((left, right), (above, below)) = (bounds(0), bounds(1));
        if left > right {
            return None;
        }
        let (columns, rows) = (right + 1 - left, below + 1 - above);
        let (mut values, mut marked) = (vec![None; columns * rows], vec![false; columns * rows]);
        for share in &shares.blocks {
            let place = (share.corner_px[1] / block - above) * columns + share.corner_px[0] / block - left;
            values[place] = Some(share.share as f32);
            marked[place] = share.is_marked;
        }
        Some(Self { left: left * block, above: above * block, columns, rows, block, values, marked })
    }

    /// Whether a block is marked; beyond the map none is.
    pub(crate) fn is_marked(&self, col: isize, row: isize) -> bool {
        let within = (0..self.columns as isize).contains(&col) && (0..self.rows as isize).contains(&row);
        within && self.marked.get(row as usize * self.columns + col as usize) == Some(&true)
    }

    /// The outline of the marked blocks, edge by edge, in blocks.
    fn outline(&self) -> Vec<Series> {
        let mut edges = Vec::new();
        for row in 0..=self.rows as isize {
            for col in 0..=self.columns as isize {
                let here = self.is_marked(col, row);
                let [x, y] = [col as f64, row as f64];
                if here != self.is_marked(col, row - 1) {
                    edges.push([[x, y], [x + 1.0, y]]);
                }
                if here != self.is_marked(col - 1, row) {
                    edges.push([[x, y], [x, y + 1.0]]);
                }
            }
        }
        let line =
            |edge: [[f64; 2]; 2]| SeriesShape::Line { points: edge.to_vec(), width: 2.0, dash: Dash::Solid };
        edges.into_iter().map(|edge| Series::unnamed(Ink::Text, line(edge))).collect()
    }

    /// The upper end of a color scale: 98 % of the values lie below.
    pub(crate) fn top(&self) -> f64 {
        let mut sorted: Vec<f32> = self.values.iter().flatten().copied().collect();
        sorted.sort_by(f32::total_cmp);
        let at = sorted.len() * 98 / 100;
        sorted.get(at).map_or(LEAST_TOP, |&v| f64::from(v).clamp(LEAST_TOP, 1.0))
    }
}

/// Share of the light in each block by which the share of a region of tissue was estimated, with the outline of those that hold some.
pub fn share_map_of_blocks(shares: &BlockShares, target: &Analyte) -> Option<Figure> {
    let map = ShareMap::of_blocks(shares)?;
    let mut panel = map_panel(&map, format!("{target} share of the fluorescence"));
    panel.series.extend(map.outline());
    let (side, least) = (map.block, 100.0 * BlockShares::SHARE_OF_MARK);
    Some(Figure::new(format!("Where the {target} is"), panel).explained(format!(
        "The region, enlarged: share of {target} in the fluorescence of squares of {side} x {side} pixels of the sensor, by the same \
         estimate as the share of the region. Outlined: more than {least:.0} %, but for at most 5 % of them. Gray: outside the region."
    )))
}

/// Share of the light on the mixture line, averaged over blocks of pixels within the bounds of the region; `None` without a pixel that
/// counts. `target` is the fluorophore in a word.
pub fn share_map(porphyrin: &PorphyrinMap, target: &Analyte) -> Option<Figure> {
    let region: Vec<usize> = porphyrin.estimates.iter().map(|(pixel, _)| *pixel).collect();
    let map = ShareMap::of(porphyrin, &region)?;
    let panel = map_panel(&map, format!("{target} share of the light"));
    let error =
        Statistics::of(region.iter().filter_map(|&p| porphyrin.at(p)).map(|e| e.position_standard_error));
    let error = error.map_or(0.0, |s| s.median);
    let block = map.block;
    Some(Figure::new(format!("Where the {target} is"), panel).explained(format!(
        "The region, enlarged: share of {target} in the light on the mixture line, mean over {block} x {block} pixels of the sensor. \
         Noise alone leaves a standard error of {error:.3} to a typical single pixel and of {:.3} to such a mean. Gray: no pixel counts.",
        error / block as f64
    )))
}

/// The picture of a map with its color bar.
fn map_panel(map: &ShareMap, label: String) -> Panel {
    let top = map.top();
    let raster =
        Raster::from_fn(map.columns, map.rows, |row, col| match map.values[row * map.columns + col] {
            Some(value) => ColorMap::Viridis.color(f64::from(value) / top),
            None => NONE,
        });
    let (width, height) = (map.columns as f64, map.rows as f64);
    let scale = (560.0 / width).min(400.0 / height);
    let mut panel = Panel::new(Axis::hidden([0.0, width]), Axis::hidden([height, 0.0]))
        .sized((width * scale).round(), (height * scale).round())
        .with(Series::unnamed(Ink::Text, SeriesShape::Picture { x: [0.0, width], y: [height, 0.0], raster }));
    panel.color_bar = Some(ColorBar { axis: Axis::linear(label, "", [0.0, top]), map: ColorMap::Viridis });
    panel
}
