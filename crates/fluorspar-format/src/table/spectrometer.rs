//! Transmittances and reflectances as spectrometers compute them: from sample, dark and reference, with noise where there is no light.

use std::ops::Range;

use super::value_unit::ValueUnit;

/// Share of the brightest reference light below which a ratio is noise.
const LEAST_LIGHT: f64 = 0.02;
/// Rows with light in sequence that are light, not a noisy pixel.
const LIT_ROWS: usize = 3;
/// Fractions that are 0 to 1 with noise.
pub(crate) const PLAUSIBLE: std::ops::RangeInclusive<f64> = -0.05..=1.1;
/// Turns from rising to falling, and back, beyond these, from which an end of a spectrum is noise. A band has one.
const LEAST_TURNS: usize = 4;

/// Columns of what a spectrometer measured.
pub(crate) struct RawColumns {
    pub(crate) sample: usize,
    pub(crate) dark: usize,
    pub(crate) reference: usize,
}

/// What it measured at one wavelength, and what it computed there.
#[derive(Clone, Copy)]
pub(crate) struct RawRow {
    pub(crate) sample: f64,
    pub(crate) dark: f64,
    pub(crate) reference: f64,
    pub(crate) computed: Option<f64>,
}

impl RawColumns {
    /// The columns with these headers, if there are all three.
    pub(crate) fn find(headers: &[String]) -> Option<Self> {
        let column =
            |names: &[&str]| headers.iter().position(|header| names.contains(&first_word(header).as_str()));
        Some(Self {
            sample: column(&["s", "sample", "scope", "raw"])?,
            dark: column(&["d", "dark"])?,
            reference: column(&["r", "ref", "reference", "white"])?,
        })
    }

    /// Whether a header is that of a column of what was measured.
    pub(crate) fn is_raw(header: &str) -> bool {
        matches!(
            first_word(header).as_str(),
            "dark" | "reference" | "ref" | "white" | "sample" | "scope" | "raw" | "d" | "r" | "s"
        )
    }
}

fn first_word(header: &str) -> String {
    header
        .to_lowercase()
        .split(|c: char| !c.is_alphanumeric())
        .find(|word| !word.is_empty())
        .unwrap_or("")
        .into()
}

/// Unit of what was computed, and the rows where the reference had light; `None` where it is no ratio of the other columns.
pub(crate) fn ratio(rows: &[RawRow]) -> Option<(ValueUnit, Range<usize>)> {
    // Some programs store the reference without its dark
    let less_dark: Vec<f64> = rows.iter().map(|row| row.reference - row.dark).collect();
    let as_stored: Vec<f64> = rows.iter().map(|row| row.reference).collect();
    [less_dark, as_stored].into_iter().find_map(|light| {
        let lit = lit_rows(&light)?;
        let is = |of_ratio: fn(f64) -> f64, absolute: f64| {
            let mut count = (0, 0);
            for (row, light) in rows[lit.clone()].iter().zip(&light[lit.clone()]) {
                let expected = of_ratio((row.sample - row.dark) / light);
                let Some(computed) = row.computed.filter(|_| expected.is_finite()) else { continue };
                count.0 += usize::from((computed - expected).abs() <= 0.01 * expected.abs() + absolute);
                count.1 += 1;
            }
            10 * count.0 >= 9 * count.1.max(2)
        };
        let unit = if is(|ratio| ratio, 1e-3) {
            ValueUnit::Fraction
        } else if is(|ratio| 100.0 * ratio, 0.1) {
            ValueUnit::Percent
        } else if is(|ratio| -ratio.log10(), 5e-3) || is(|ratio| ratio.log10().abs(), 5e-3) {
            ValueUnit::OpticalDensity
        } else {
            return None;
        };
        Some((unit, lit))
    })
}

/// Rows from the first to the last with light.
fn lit_rows(light: &[f64]) -> Option<Range<usize>> {
    let mut sorted = light.to_vec();
    sorted.sort_by(f64::total_cmp);
    // A hot pixel is no light
    let brightest = sorted[(sorted.len() - 1) - sorted.len() / 100];
    let is_lit = |values: &[f64]| values.iter().all(|value| *value > LEAST_LIGHT * brightest);
    let width = LIT_ROWS.min(light.len());
    let mut windows = light.windows(width);
    let first = windows.position(is_lit)?;
    let last = light.windows(width).rposition(is_lit)? + width;
    (brightest > 0.0).then_some(first..last)
}

/// The rows of a spectrum of fractions without the noise at its ends, which goes far beyond 0 to 1 where there is no light.
/// `None` where what lies beyond is no noise at the ends.
pub(crate) fn without_noisy_ends(values: &[f64]) -> Option<Range<usize>> {
    let mut best = 0..0;
    let mut start = 0;
    for (place, value) in values.iter().enumerate() {
        if !PLAUSIBLE.contains(value) {
            start = place + 1;
        } else if place + 1 - start > best.len() {
            best = start..place + 1;
        }
    }
    let is_turn = |of: &&[f64]| !PLAUSIBLE.contains(&of[1]) && (of[1] - of[0]) * (of[2] - of[1]) < 0.0;
    let turns = |end: &[f64]| end.windows(3).filter(is_turn).count();
    let is_noise = |end: &[f64]| end.is_empty() || turns(end) >= LEAST_TURNS;
    let holds =
        2 * best.len() >= values.len() && is_noise(&values[..best.start]) && is_noise(&values[best.end..]);
    holds.then_some(best)
}
