//! Pictures with a meaning: the developed image with its region, and the map of porphyrin.

use fluorspar::analysis::{Analyte, PorphyrinLayers, PorphyrinMap};

use crate::{Axis, ColorBar, ColorMap, Dash, Figure, Ink, Panel, Raster, Series, SeriesShape};

/// Longest side of a picture inside a figure, px.
const LONGEST_SIDE: f64 = 560.0;

fn frame(raster: Raster) -> Panel {
    let (width, height) = (raster.width as f64, raster.height as f64);
    let scale = LONGEST_SIDE / width.max(height).max(1.0);
    Panel::new(Axis::hidden([0.0, width]), Axis::hidden([height, 0.0]))
        .sized((width * scale).round(), (height * scale).round())
        .with(Series::unnamed(Ink::Text, SeriesShape::Picture { x: [0.0, width], y: [height, 0.0], raster }))
}

/// A developed image. `region` is a rectangle `[col, row, width, height]` in its pixels, drawn in white.
pub fn picture(title: &str, raster: Raster, region: Option<[f64; 4]>) -> Figure {
    let mut panel = frame(raster);
    if let Some([col, row, width, height]) = region {
        let (right, bottom) = (col + width, row + height);
        let points = vec![[col, row], [right, row], [right, bottom], [col, bottom], [col, row]];
        for (ink, width) in [(Ink::Rgb(0, 0, 0), 4.0), (Ink::Rgb(255, 255, 255), 2.0)] {
            let shape = SeriesShape::Line { points: points.clone(), width, dash: Dash::Solid };
            panel = panel.with(Series::unnamed(ink, shape));
        }
    }
    Figure::new(title, panel)
}

/// Pictures with their names, `columns` in a row.
pub fn pictures(title: &str, pictures: Vec<(String, Raster)>, columns: usize) -> Figure {
    let width = (900.0 / columns.max(1) as f64).min(LONGEST_SIDE);
    let panel = |(name, raster): (String, Raster)| {
        let height = width * raster.height as f64 / raster.width.max(1) as f64;
        frame(raster).sized(width.round(), height.round()).titled(name)
    };
    Figure::grid(title, pictures.into_iter().map(panel).collect(), columns)
}

/// What a map of porphyrin shows of each pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PorphyrinQuantity {
    /// The share of the light on the mixture line.
    Share,
    /// Half the length of its 95 % interval by the sensor's noise.
    Uncertainty,
    /// The detection limit.
    DetectionLimit,
}

impl PorphyrinQuantity {
    /// Title, label of the color scale, and what it means.
    fn words(self, analyte: &Analyte) -> [String; 3] {
        match self {
            Self::Share => [
                format!("{} share of the light, on the mixture line", analyte.capitalized()),
                format!("{analyte} share"),
                format!(
                    "Colored pixels lie in the region: electrons of {analyte} light over those of {analyte} and bulk, as if the bulk were \
                     known. Gray pixels are outside the region, saturated, too dark, or hold other light."
                ),
            ],
            Self::Uncertainty => [
                format!("Uncertainty of the {analyte} share"),
                "half of the 95 % interval".into(),
                "How far the sensor's noise leaves the share of each pixel open to either side: half the length of its 95 % interval. \
                 Errors of the model are not in it."
                    .into(),
            ],
            Self::DetectionLimit => [
                format!("Detection limit of the {analyte} share"),
                "detection limit".into(),
                "The share that the noise of a single pixel mistakes for none, and none for it, in 5 % of cases: less than that is not \
                 seen there."
                    .into(),
            ],
        }
    }
}

/// A number about the porphyrin of each pixel, `[row, col]`, over a darkened gray picture (`underlay`, 0 to 255 per pixel) where
/// there is none. `None` when the lists do not fill the picture.
///
/// The color scale ends at `top`, for instance the 99th percentile; larger numbers take its last color.
pub fn porphyrin_map(
    (quantity, analyte): (PorphyrinQuantity, &Analyte),
    [width, height]: [usize; 2],
    values: &[Option<f32>],
    underlay: Option<&[u8]>,
    top: f64,
) -> Option<Figure> {
    let pixels = width * height;
    if values.len() != pixels || underlay.is_some_and(|gray| gray.len() != pixels) || pixels == 0 {
        return None;
    }
    let [title, label, explained] = quantity.words(analyte);
    let axis = Axis::from_zero(label, "", [top.clamp(1e-3, 1.0)]);
    let full = axis.limits[1];
    let raster = Raster::from_fn(width, height, |row, col| {
        let pixel = row * width + col;
        match (values[pixel], underlay) {
            (Some(value), _) => ColorMap::Viridis.color(f64::from(value) / full),
            (None, Some(gray)) => [(f64::from(gray[pixel]) * 0.6) as u8; 3],
            (None, None) => [90; 3],
        }
    });
    let mut panel = frame(raster);
    panel.color_bar = Some(ColorBar { axis, map: ColorMap::Viridis });
    Some(Figure::new(title, panel).explained(explained))
}

/// Maps of the porphyrin of an analyzed region, with stems of file names: share, its uncertainty, detection limit. `underlay` as of
/// [`porphyrin_map`].
pub fn porphyrin_maps(
    porphyrin: &PorphyrinMap,
    analyte: &Analyte,
    underlay: Option<&[u8]>,
) -> Vec<(&'static str, Figure)> {
    let PorphyrinLayers { share, low, high, detection_limit } = porphyrin.layers();
    let uncertainty: Vec<f32> = low.iter().zip(&high).map(|(low, high)| 0.5 * (high - low)).collect();
    [
        ("porphyrin_map", PorphyrinQuantity::Share, share),
        ("porphyrin_uncertainty_map", PorphyrinQuantity::Uncertainty, uncertainty),
        ("porphyrin_limit_map", PorphyrinQuantity::DetectionLimit, detection_limit),
    ]
    .into_iter()
    .filter_map(|(stem, quantity, values)| {
        let values: Vec<Option<f32>> = values.into_iter().map(|v| (!v.is_nan()).then_some(v)).collect();
        let mut sorted: Vec<f32> = values.iter().flatten().copied().collect();
        sorted.sort_by(f32::total_cmp);
        let top = sorted.get(sorted.len() * 99 / 100).copied().map_or(1.0, f64::from);
        let size = [porphyrin.width, porphyrin.height];
        Some((stem, porphyrin_map((quantity, analyte), size, &values, underlay, top)?))
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_must_fill_its_picture() {
        let share = PorphyrinQuantity::Share;
        assert!(porphyrin_map((share, &Analyte::default()), [2, 2], &[None; 3], None, 1.0).is_none());
        assert!(porphyrin_map((share, &Analyte::default()), [2, 1], &[None; 2], Some(&[1]), 1.0).is_none());
        let map =
            porphyrin_map((share, &Analyte::default()), [2, 1], &[Some(0.5), None], Some(&[0, 100]), 0.5)
                .unwrap();
        let SeriesShape::Picture { raster, .. } = &map.panels[0].series[0].shape else {
            panic!("no picture")
        };
        assert_eq!(raster.pixels, [[253, 231, 37], [60; 3]]);
    }
}
