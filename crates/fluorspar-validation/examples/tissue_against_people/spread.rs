//! Chromaticities of drawn people against measured ones.

use fluorspar::sampling::random::Key;
use fluorspar::spectral::Curve;
use fluorspar::tissue::Population;
use fluorspar_experiment::preset;

use crate::reference::{Fallible, LAMPS, Lamp, Reference, wavelengths};
use crate::solved_coarsely;

/// People drawn, one place each.
const PEOPLE: u64 = 400;

/// r of R, G and B behind the long-pass, from energy at [`wavelengths`]: the band of 500 to 700 nm.
fn red_chromaticity(spectrum: &[f64], channels: &[Curve]) -> f64 {
    let signal = |channel: &Curve| -> f64 {
        wavelengths().iter().zip(spectrum).map(|(nm, energy)| channel.at(*nm) * nm * energy).sum()
    };
    let signals: Vec<f64> = channels.iter().map(signal).collect();
    signals[0] / signals.iter().sum::<f64>()
}

/// Percentiles of 5, 50 and 95.
fn percentiles(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    [0.05, 0.5, 0.95].map(|share| {
        let place = share * (values.len() - 1) as f64;
        let below = place as usize;
        let above = (below + 1).min(values.len() - 1);
        values[below] + (place - below as f64) * (values[above] - values[below])
    })
}

/// Prints the ranges of both and how much of the measured one is held, lamp by lamp; returns how many are held by 80 %.
pub(crate) fn spread(reference: &Reference, site: &str, place: &str, widening: f64) -> Fallible<usize> {
    let population = Population::of(&preset::site(site)?).widened(widening);
    let channels: Vec<Curve> = preset::quantum_efficiency("consumer_rgb_cmos")?
        .channels()?
        .into_iter()
        .map(|(_, curve)| curve)
        .collect();
    let mut drawn: Vec<Vec<f64>> = vec![Vec::new(); LAMPS.len()];
    for person in 0..PEOPLE {
        let tissue = solved_coarsely(&population.draw(&mut Key::new(1).with(person).rng()))?;
        for (lamp, found) in reference.lamps.iter().zip(&mut drawn) {
            found.push(red_chromaticity(&lamp.viewing.spectrum(&tissue, &wavelengths()), &channels));
        }
    }
    let measured = |lamp: &Lamp| {
        let all = reference.measured(place, lamp).all;
        percentiles(all.iter().map(|spectrum| red_chromaticity(spectrum, &channels)).collect())
    };
    let mut held = 0;
    for (lamp, drawn) in reference.lamps.iter().zip(drawn) {
        let (a, b) = (measured(lamp), percentiles(drawn));
        let overlap = (a[2].min(b[2]) - a[0].max(b[0])).max(0.0) / (a[2] - a[0]);
        held += usize::from(overlap >= 0.8);
        println!(
            "  {site}, {} nm: measured {:.3} {:.3} {:.3}, drawn {:.3} {:.3} {:.3}, overlap {:.0} %",
            lamp.name,
            a[0],
            a[1],
            a[2],
            b[0],
            b[1],
            b[2],
            100.0 * overlap
        );
    }
    Ok(held)
}
