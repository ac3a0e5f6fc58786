//! The share of a fluorophore over the region, and how little of it a pixel shows.

use fluorspar::analysis::{PorphyrinMap, Statistics};

use crate::run::ShareMap;
use crate::{Axis, ColorBar, ColorMap, Figure, Ink, Panel, Raster, Series, SeriesShape};

/// Color where no pixel counts.
const NONE: [u8; 3] = [128; 3];

/// Share of the light on the mixture line, averaged over blocks of pixels within the bounds of the region; `None` without a pixel that
/// counts. `target` is the fluorophore in a word.
pub fn share_map(porphyrin: &PorphyrinMap, target: &str) -> Option<Figure> {
    let region: Vec<usize> = porphyrin.estimates.iter().map(|(pixel, _)| *pixel).collect();
    let map = ShareMap::of(porphyrin, &region)?;
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
    let label = format!("{target} share of the light");
    panel.color_bar = Some(ColorBar { axis: Axis::linear(label, "", [0.0, top]), map: ColorMap::Viridis });
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
