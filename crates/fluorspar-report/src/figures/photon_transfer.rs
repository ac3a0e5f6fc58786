//! Photon transfer and signal-to-noise ratio of a sensor that was measured.

use fluorspar::sensor::{Characterization, FrameCalibration};

use crate::{Axis, Dash, Figure, Ink, Panel, Series, SeriesShape};

/// A photon-transfer measurement and the line that was fitted to it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhotonTransferPlot {
    /// Signal less dark mean, DN, and temporal variance, DN².
    pub points: Vec<[f64; 2]>,
    /// Variance of dark frames, DN².
    pub dark_variance_dn2: f64,
    /// Slope, DN per electron.
    pub gain_dn_per_e: f64,
    /// Signal at the largest variance, DN; `None` where no frame reached it.
    pub saturation_dn: Option<f64>,
}

impl PhotonTransferPlot {
    /// The plot of a measured sensor.
    pub fn of(measured: &Characterization) -> Self {
        Self {
            points: measured.photon_transfer.iter().map(|p| [p.signal_dn, p.variance_dn2]).collect(),
            dark_variance_dn2: measured.dark_noise_dn.powi(2),
            gain_dn_per_e: measured.gain_dn_per_e,
            saturation_dn: Some(measured.saturation_capacity_e * measured.gain_dn_per_e),
        }
    }

    /// The plot of a camera whose frames were measured.
    pub fn of_frames(measured: &FrameCalibration) -> Self {
        let points: Vec<[f64; 2]> =
            measured.transfer.iter().filter_map(|p| Some([p.signal_dn, p.variance_dn2?])).collect();
        let gain_dn_per_e = measured.gain_dn_per_e.value;
        let dark = measured.transfer.iter().filter(|p| !p.is_lit).filter_map(|p| p.variance_dn2);
        Self {
            dark_variance_dn2: dark.fold(f64::INFINITY, f64::min),
            gain_dn_per_e,
            saturation_dn: measured.full_scale_e.map(|full| full.value * gain_dn_per_e),
            points,
        }
    }
}

/// Temporal variance against signal, with the fitted line and the saturation point.
pub fn photon_transfer(plot: &PhotonTransferPlot) -> Figure {
    let [signals, variances] = [0, 1].map(|i| plot.points.iter().map(move |p| p[i]));
    let (x, y) = (
        Axis::from_zero("signal less dark", "DN", signals),
        Axis::from_zero("temporal variance", "DN²", variances),
    );
    let line = |signal: f64| [signal, plot.dark_variance_dn2 + plot.gain_dn_per_e * signal];
    let largest = plot.points.iter().map(|p| p[0]).fold(0.0, f64::max);
    let fitted = plot.saturation_dn.map_or(largest, |full| 0.7 * full);
    let bottom_to_top = |full: f64| vec![[full, y.limits[0]], [full, y.limits[1]]];
    let saturation = plot
        .saturation_dn
        .map(|full| Series::dashed("saturation", Ink::Muted, bottom_to_top(full), Dash::Dashed));
    let mut panel = Panel::new(x, y.clone())
        .with(Series {
            name: Some("frames of one exposure".into()),
            ink: Ink::cycle(0),
            shape: SeriesShape::Markers { points: plot.points.clone(), radius: 3.0, hollow: true },
        })
        .with(Series::line(
            format!("slope K = {:.4} DN per electron", plot.gain_dn_per_e),
            Ink::cycle(1),
            vec![line(0.0), line(fitted)],
        ));
    if let Some(saturation) = saturation {
        panel = panel.with(saturation);
    }
    Figure::new("Photon transfer", panel).explained(
        "How much a pixel's value varies from frame to frame, against its mean. Light comes in single electrons, so the \
         variance rises in proportion to the signal, and the slope tells how many digital numbers one electron makes. \
         Where pixels begin to fill, the variance falls.",
    )
}

/// Signal-to-noise ratios against signal.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SnrPlot {
    /// Signal, e-, and ratio of one pixel from frame to frame.
    pub temporal: Vec<[f64; 2]>,
    /// Signal, e-, and ratio over an image, fixed patterns included.
    pub with_patterns: Vec<[f64; 2]>,
    /// Signal, e-, and ratio of a sensor without any noise of its own.
    pub ideal: Vec<[f64; 2]>,
    /// Signal at which signal and noise are equal, e-.
    pub threshold_e: f64,
    /// Largest signal, e-.
    pub saturation_e: f64,
}

/// Signal-to-noise ratio from the sensitivity threshold to saturation, both axes logarithmic.
pub fn signal_to_noise(plot: &SnrPlot) -> Figure {
    let all = || plot.temporal.iter().chain(&plot.with_patterns).chain(&plot.ideal);
    let largest = all().map(|p| p[0]).filter(|v| v.is_finite()).fold(1.0, f64::max);
    let span = largest.log10().ceil().max(1.0) as i32;
    let x = Axis::decades("signal", "electrons", all().map(|p| p[0]), span + 1);
    let y = Axis::decades("signal over noise", "", all().map(|p| p[1]), span / 2 + 2);
    let vertical = |signal: f64| vec![[signal, y.limits[0]], [signal, y.limits[1]]];
    let panel = Panel::new(x.clone(), y.clone())
        .with(Series::dashed("ideal: shot noise only", Ink::Muted, plot.ideal.clone(), Dash::Dotted))
        .with(Series::line("one pixel, frame to frame", Ink::cycle(0), plot.temporal.clone()))
        .with(Series::dashed(
            "over the image, fixed patterns included",
            Ink::cycle(1),
            plot.with_patterns.clone(),
            Dash::Dashed,
        ))
        .with(Series::dashed(
            "sensitivity threshold",
            Ink::cycle(2),
            vertical(plot.threshold_e),
            Dash::DashDotted,
        ))
        .with(Series::dashed("saturation", Ink::cycle(3), vertical(plot.saturation_e), Dash::DashDotted));
    Figure::new("Signal-to-noise ratio", panel).explained(
        "How many times larger a signal is than its noise. Dim light is limited by the electronics, bright light by the \
         graininess of light itself (dotted) and, over the image, by differences between pixels (dashed). The dynamic \
         range lies between threshold and saturation.",
    )
}
