//! Statistics of a region.

use serde::{Deserialize, Serialize};

use super::{ChromaticityMap, ExclusionCounts, PixelSelection, PixelValidity};
use crate::image::ChannelImage;

/// Five percentiles, mean and spread of a list of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    /// Number of values.
    pub n: usize,
    /// Mean.
    pub mean: f64,
    /// Standard deviation of the sample (`n - 1`); none for a single number.
    pub sd: Option<f64>,
    /// Smallest.
    pub min: f64,
    /// 5th percentile.
    pub p05: f64,
    /// 25th percentile.
    pub p25: f64,
    /// Median.
    pub median: f64,
    /// 75th percentile.
    pub p75: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Largest.
    pub max: f64,
}

/// Median of the finite numbers of a list, as [`Statistics`] has it, without a sort; `None` when there are none.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().filter(|value| value.is_finite()).collect();
    let n = values.len();
    if n == 0 {
        return None;
    }
    let (below, &mut upper, _) = values.select_nth_unstable_by(n / 2, f64::total_cmp);
    match n.is_multiple_of(2) {
        true => Some(0.5 * (below.iter().copied().max_by(f64::total_cmp)? + upper)),
        false => Some(upper),
    }
}

impl Statistics {
    /// Statistics of the finite numbers of a list; `None` when there are none.
    ///
    /// Percentiles are interpolated between order statistics, the lowest being 0 % and the highest 100 %
    /// (definition 7 of Hyndman and Fan 1996, the default of R and NumPy).
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = values.into_iter().filter(|value| value.is_finite()).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let (&min, &max) = (sorted.first()?, sorted.last()?);
        let n = sorted.len();
        let mean = sorted.iter().sum::<f64>() / n as f64;
        let squares: f64 = sorted.iter().map(|value| (value - mean).powi(2)).sum();
        let percentile = |percent: f64| {
            let at = percent / 100.0 * (n - 1) as f64;
            let below = at.floor() as usize;
            let above = (below + 1).min(n - 1);
            sorted[below] + (at - below as f64) * (sorted[above] - sorted[below])
        };
        Some(Self {
            n,
            mean,
            sd: (n > 1).then(|| (squares / (n - 1) as f64).sqrt()),
            min,
            p05: percentile(5.0),
            p25: percentile(25.0),
            median: percentile(50.0),
            p75: percentile(75.0),
            p95: percentile(95.0),
            max,
        })
    }
}

/// The ellipse whose half-axes are one standard deviation of a cloud of points along its principal directions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CovarianceEllipse {
    /// Mean `(r, g)`.
    pub center: [f64; 2],
    /// Sample covariance matrix.
    pub covariance: [[f64; 2]; 2],
    /// Standard deviations along the long and the short axis.
    pub half_axes: [f64; 2],
    /// Direction of the long axis, degrees from the r axis toward the g axis, above -90 and up to 90.
    pub angle_deg: f64,
}

impl CovarianceEllipse {
    /// The ellipse of a cloud; `None` for fewer than three points.
    pub fn of(points: &[[f64; 2]]) -> Option<Self> {
        if points.len() < 3 {
            return None;
        }
        let n = points.len() as f64;
        let center = [0, 1].map(|axis| points.iter().map(|point| point[axis]).sum::<f64>() / n);
        let moment = |a: usize, b: usize| {
            points.iter().map(|point| (point[a] - center[a]) * (point[b] - center[b])).sum::<f64>()
                / (n - 1.0)
        };
        Some(Self::from_covariance(center, [[moment(0, 0), moment(0, 1)], [moment(0, 1), moment(1, 1)]]))
    }

    /// The ellipse of a covariance matrix.
    pub fn from_covariance(center: [f64; 2], covariance: [[f64; 2]; 2]) -> Self {
        let [[rr, rg], [_, gg]] = covariance;
        let (half_trace, half_difference) = (0.5 * (rr + gg), 0.5 * (rr - gg));
        let root = half_difference.hypot(rg);
        let half_axes = [half_trace + root, half_trace - root].map(|variance| variance.max(0.0).sqrt());
        let angle_deg = (0.5 * rg.atan2(half_difference)).to_degrees();
        Self { center, covariance, half_axes, angle_deg }
    }

    /// Points on the ellipse `scale` times as large; 2.4477 holds 95 % of a two-dimensional normal cloud.
    pub fn outline(&self, scale: f64, points: usize) -> Vec<[f64; 2]> {
        let (sin, cos) = self.angle_deg.to_radians().sin_cos();
        (0..points)
            .map(|index| {
                let (y, x) = (std::f64::consts::TAU * index as f64 / points as f64).sin_cos();
                let (along, across) = (scale * self.half_axes[0] * x, scale * self.half_axes[1] * y);
                [self.center[0] + along * cos - across * sin, self.center[1] + along * sin + across * cos]
            })
            .collect()
    }
}

/// Statistics of one channel over the region.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelStatistics {
    /// Channel name.
    pub name: String,
    /// Statistics of the unsaturated pixels, DN.
    pub statistics: Option<Statistics>,
    /// Median of all pixels, DN, saturated ones at the level at which they clip: that of the light itself while fewer than half of them
    /// are saturated, else a lower limit of it. `None` in results of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub median_of_all: Option<f64>,
}

/// Statistics of a region.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RegionStatistics {
    /// Pixels of the region with and without a chromaticity, by reason.
    pub counts: ExclusionCounts,
    /// Each channel over the pixels of the region, dark ones included.
    pub channels: Vec<ChannelStatistics>,
    /// Statistics of `r` over the valid pixels.
    pub r: Option<Statistics>,
    /// Statistics of `g` over the valid pixels.
    pub g: Option<Statistics>,
    /// Covariance of `(r, g)` over the valid pixels.
    pub ellipse: Option<CovarianceEllipse>,
}

impl RegionStatistics {
    /// Statistics of the selected pixels of an image and of its chromaticity map.
    pub fn new(image: &ChannelImage, map: &ChromaticityMap, region: &PixelSelection) -> Self {
        let validity = |pixel: &&usize| map.validity[**pixel];
        let n = image.channels.len();
        let channels = image.channels.iter().enumerate().map(|(channel, name)| {
            let value = |pixel: &usize| f64::from(image.data[pixel * n + channel]);
            let unsaturated = region.pixels.iter().filter(|p| validity(p) != PixelValidity::Saturated);
            ChannelStatistics {
                name: name.clone(),
                statistics: Statistics::of(unsaturated.map(value)),
                median_of_all: median(region.pixels.iter().map(value)),
            }
        });
        let points: Vec<[f64; 2]> = region.pixels.iter().filter_map(|&pixel| map.at(pixel)).collect();
        Self {
            counts: ExclusionCounts::count(region.pixels.iter().map(|&pixel| map.validity[pixel])),
            channels: channels.collect(),
            r: Statistics::of(points.iter().map(|point| point[0])),
            g: Statistics::of(points.iter().map(|point| point[1])),
            ellipse: CovarianceEllipse::of(&points),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::RegionOfInterest;

    #[test]
    fn percentiles_are_those_of_numpy() {
        let statistics = Statistics::of([4.0, 1.0, f64::NAN, 3.0, 2.0]).unwrap();
        assert_eq!((statistics.n, statistics.mean, statistics.median), (4, 2.5, 2.5));
        assert_eq!((statistics.min, statistics.p25, statistics.p75, statistics.max), (1.0, 1.75, 3.25, 4.0));
        assert!((statistics.p05 - 1.15).abs() < 1e-12 && (statistics.p95 - 3.85).abs() < 1e-12);
        assert!((statistics.sd.unwrap() - (5.0f64 / 3.0).sqrt()).abs() < 1e-15);
        assert_eq!(Statistics::of([7.0]).unwrap().sd, None);
        assert_eq!(Statistics::of([f64::NAN]), None);
        for values in [&[4.0, 1.0, f64::NAN, 3.0, 2.0][..], &[3.0, 1.0, 2.0], &[7.0], &[f64::NAN]] {
            let whole = Statistics::of(values.iter().copied()).map(|s| s.median);
            assert_eq!(median(values.iter().copied()), whole);
        }
    }

    #[test]
    fn an_ellipse_lies_along_its_cloud() {
        let along_30_degrees: Vec<[f64; 2]> =
            (-50..=50).map(|i| f64::from(i) * 0.001).map(|t| [0.4 + t * 3f64.sqrt(), 0.3 + t]).collect();
        let ellipse = CovarianceEllipse::of(&along_30_degrees).unwrap();
        assert!((ellipse.angle_deg - 30.0).abs() < 1e-9, "{}", ellipse.angle_deg);
        assert!((ellipse.center[0] - 0.4).abs() < 1e-12 && ellipse.half_axes[1] < 1e-8);
        // Positions t = 0.002 i, i = -50..50: variance 0.002² (101² - 1) / 12 * 101 / 100.
        let expected = 0.002 * ((101.0 * 101.0 - 1.0) / 12.0 * 1.01f64).sqrt();
        assert!((ellipse.half_axes[0] - expected).abs() < 1e-12);
        assert_eq!(CovarianceEllipse::of(&[[0.0; 2]; 2]), None);
    }

    #[test]
    fn an_outline_has_the_ellipse_s_half_axes() {
        let ellipse = CovarianceEllipse::from_covariance([0.0, 0.0], [[4.0, 0.0], [0.0, 9.0]]);
        assert_eq!(ellipse.half_axes, [3.0, 2.0]);
        for [r, g] in ellipse.outline(2.0, 16) {
            assert!(((r / 4.0).powi(2) + (g / 6.0).powi(2) - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn excluded_pixels_are_counted_and_stay_out() {
        let mut image = ChannelImage {
            width: 4,
            height: 1,
            channels: ["R", "G", "B"].map(String::from).to_vec(),
            data: vec![10., 20., 10., 9e3, 9e3, 9e3, 0., 0., 0., 30., 20., 50.],
            saturated: vec![false; 4],
            noise_floor_dn: 1.0,
            full_scale_dn: 4000.0,
            shares: vec![0.25, 0.5, 0.25],
            interpolation: None,
            subtracted: None,
            calibration: None,
            label: "blue".into(),
        };
        image.saturated[1] = true;
        let map = ChromaticityMap::new(&image, 5.0).unwrap();
        let region = RegionOfInterest::default().select(4, 1, None).unwrap();
        let statistics = RegionStatistics::new(&image, &map, &region);
        assert_eq!(
            statistics.counts,
            ExclusionCounts { valid: 2, saturated: 1, undefined: 1, below_noise_floor: 0 }
        );
        let red = &statistics.channels[0];
        let unsaturated = red.statistics.unwrap();
        assert_eq!((red.name.as_str(), unsaturated.n, unsaturated.max), ("R", 3, 30.0));
        // Of 0, 10, 30 and one that clips at 9000: where it clips does not matter
        assert_eq!((unsaturated.median, red.median_of_all), (10.0, Some(20.0)));
        assert!((statistics.r.unwrap().mean - 0.275).abs() < 1e-7);
        assert_eq!(statistics.ellipse, None);
    }
}
