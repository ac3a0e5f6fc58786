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
    let floor = y.limits[0];
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
    let split = match reflected {
        None => "by the fluorophore that gave it off",
        Some(_) => {
            "by what happened to it: light that was merely reflected, and light that each fluorophore gave off"
        }
    };
    let below: Vec<&str> = all().filter(|c| c.peak() < floor).map(|c| c.name.as_str()).collect();
    let below = if below.is_empty() { "" } else { &format!(" Below it: {}.", below.join(", ")) };
    let (title, logarithmic) = match scale {
        Scale::Linear => (format!("Fluorescence of {region}, by fluorophore"), ""),
        Scale::Log10 => (
            format!("Light of {region}, by origin"),
            " The vertical axis is logarithmic: each step up is ten times as much light.",
        ),
    };
    Figure::new(title, panel).explained(format!(
        "The light that leaves {region} toward the camera, before any filter, split {split}.{logarithmic}{below}"
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn captions_tell_what_is_drawn() {
        let curve = |name: &str, peak| PlotCurve::new(name, vec![400.0, 500.0], vec![0.0, peak]);
        let (reflected, glow) = (curve("reflected", 1.0), [curve("NADH", 1e-3), curve("FAD", 1e-8)]);
        let linear = radiance_by_component(None, None, &glow, "tongue", Scale::Linear).explanation;
        assert!(!linear.contains("reflected") && !linear.contains("FAD"), "{linear}");
        let origins =
            radiance_by_component(None, Some(&reflected), &glow, "tongue", Scale::Log10).explanation;
        assert!(origins.contains("reflected") && origins.ends_with("Below it: FAD."), "{origins}");
    }
}
