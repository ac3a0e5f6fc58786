//! Spectral radiance of a region, split by where the light came from.

use super::{PlotCurve, wavelength_limits};
use crate::{Axis, Dash, Figure, Ink, Panel, Scale, Series, SeriesShape};

/// Decades shown on a logarithmic radiance axis.
const RADIANCE_DECADES: i32 = 6;

/// Mean spectral radiance of a region: the sum (black), reflected light (pink, dashed) and each fluorophore.
pub fn radiance_by_component(
    total: Option<&PlotCurve>,
    reflected: Option<&PlotCurve>,
    fluorophores: &[PlotCurve],
    region: &str,
    scale: Scale,
) -> Figure {
    let all = || total.into_iter().chain(reflected).chain(fluorophores);
    let (label, unit) = ("spectral radiance", "W/(sr m² nm)");
    let peaks = all().map(PlotCurve::peak);
    let y = match scale {
        Scale::Linear => Axis::from_zero(label, unit, peaks),
        Scale::Log10 => Axis::decades(label, unit, peaks, RADIANCE_DECADES),
    };
    let mut panel = Panel::new(Axis::wavelength(wavelength_limits(all())), y);
    if let Some(total) = total {
        let shape = SeriesShape::Line { points: total.points(), width: 3.0, dash: Dash::Solid };
        panel = panel.with(Series { name: Some(total.name.clone()), ink: Ink::Text, shape });
    }
    if let Some(reflected) = reflected {
        panel = panel.with(Series::dashed(
            reflected.name.clone(),
            Ink::PALETTE[3],
            reflected.points(),
            Dash::Dashed,
        ));
    }
    let inks = Ink::of_fluorophores(fluorophores.iter().map(|curve| curve.name.as_str()));
    for (curve, ink) in fluorophores.iter().zip(inks) {
        panel = panel.with(Series::dashed(curve.name.clone(), ink, curve.points(), ink.fluorophore_dash()));
    }
    let logarithmic = match scale {
        Scale::Linear => "",
        Scale::Log10 => " The vertical axis is logarithmic: each step up is ten times as much light.",
    };
    let title = match scale {
        Scale::Linear => format!("Fluorescence of {region}, by fluorophore"),
        Scale::Log10 => format!("Light of {region}, by origin"),
    };
    Figure::new(title, panel).explained(format!(
        "The light that leaves {region} toward the camera, before any filter, split by what happened to it: light that was merely \
         reflected, and light that each fluorophore gave off.{logarithmic}"
    ))
}

/// Spectral radiance that a spectroradiometer reads, one line per reading.
pub fn spectral_readings(title: impl Into<String>, curves: &[PlotCurve]) -> Figure {
    let y = Axis::from_zero("spectral radiance", "W/(sr m² nm)", curves.iter().map(PlotCurve::peak));
    let mut panel = Panel::new(Axis::wavelength(wavelength_limits(curves)), y);
    for (index, curve) in curves.iter().enumerate() {
        let ink = Ink::PALETTE[index % Ink::PALETTE.len()];
        panel = panel.with(Series::dashed(curve.name.clone(), ink, curve.points(), Dash::cycle(index)));
    }
    Figure::new(title, panel).explained(
        "Light that leaves the place which the instrument aims at, through the instrument's own filter and slit. Noise may \
         take a reading below zero, which the axis does not show.",
    )
}
