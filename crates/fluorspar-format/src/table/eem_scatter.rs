//! Excitation light that is scattered into the instrument: its lines in a matrix, found and cut out.

use std::path::Path;

use fluorspar::units::counted;
use serde::Deserialize;

use super::csv_eem::{AntiStokes, MeasuredEem, check_stokes, on_the_line};
use crate::{Defect, FormatError};

/// A line of a matrix along which excitation light is scattered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScatterLine {
    /// Rayleigh and Tyndall scattering.
    First,
    /// Its second order at the grating of the emission.
    Second,
    /// Its third order.
    Third,
    /// Raman scattering of water.
    WaterRaman,
}

/// Raman shift of the O-H stretching of water, 3400 cm^-1, in 1/nm.
const WATER_RAMAN_PER_NM: f64 = 3400e-7;

impl ScatterLine {
    /// All lines.
    pub const ALL: [Self; 4] = [Self::First, Self::Second, Self::Third, Self::WaterRaman];
    /// Those of every instrument; water is not in every sample.
    const ORDERS: [Self; 3] = [Self::First, Self::Second, Self::Third];

    /// Where the line lies under an excitation, nm.
    #[must_use]
    pub fn emission_nm(self, excitation_nm: f64) -> f64 {
        match self {
            Self::First => excitation_nm,
            Self::Second => 2.0 * excitation_nm,
            Self::Third => 3.0 * excitation_nm,
            Self::WaterRaman => {
                let per_nm = 1.0 / excitation_nm - WATER_RAMAN_PER_NM;
                if per_nm > 0.0 { 1.0 / per_nm } else { f64::INFINITY }
            }
        }
    }

    /// Share of the peak below which the line is let be: a little Raman scatter is in most measured matrices.
    fn least_share(self) -> f64 {
        if self == Self::WaterRaman { LEAST_WATER } else { LEAST_SCATTER }
    }

    /// What the light was scattered by.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::First => "first-order scatter (Rayleigh and Tyndall)",
            Self::Second => "second-order scatter",
            Self::Third => "third-order scatter",
            Self::WaterRaman => "Raman scatter of water",
        }
    }

    /// The line as an equation.
    #[must_use]
    pub fn equation(self) -> &'static str {
        match self {
            Self::First => "emission = excitation",
            Self::Second => "emission = 2 x excitation",
            Self::Third => "emission = 3 x excitation",
            Self::WaterRaman => "1/emission = 1/excitation - 3400 cm^-1",
        }
    }
}

/// Bands of scattered excitation light that are cut out: the cells so near the lines of the orders 1 to 3, and so near that of water where it
/// is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScatterCut {
    /// Largest distance from a line to either side, nm.
    pub within_nm: f64,
    /// What the cells become.
    pub to: CutTo,
}

impl ScatterCut {
    /// The band in which a cell lies, among those of some lines.
    fn line(self, lines: &[ScatterLine], emission_nm: f64, excitation_nm: f64) -> Option<ScatterLine> {
        let is_near =
            |line: &ScatterLine| (emission_nm - line.emission_nm(excitation_nm)).abs() <= self.within_nm;
        lines.iter().copied().find(is_near)
    }

    /// Whether a cell is cut out of every matrix.
    pub(crate) fn has(self, emission_nm: f64, excitation_nm: f64) -> bool {
        self.line(&ScatterLine::ORDERS, emission_nm, excitation_nm).is_some()
    }
}

/// What cells of a band that is cut out become.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CutTo {
    /// On a straight line along the emission between the nearest cells beside the band, under the same excitation; where it reaches the end of
    /// the column, the value of the nearest cell. Cells below their excitation become zero.
    Neighbors,
    /// Zero.
    Zero,
}

/// Largest share of the peak that a value below its excitation may have: what stray light of good instruments leaves.
pub const ANTI_STOKES_TOLERANCE: f64 = 1e-3;

/// The widest band that [`MeasuredEem::least_cuts`] tries, nm.
pub const MOST_CUT_NM: u32 = 100;

/// The least widths of [`ScatterCut`] that are enough, whole nm, up to 100 nm; `None` where none is. Each leaves a dye: emission that keeps its
/// place while the excitation moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LeastCuts {
    /// So that nothing is refused.
    pub for_all: Option<u32>,
    /// So that no line of scattered light is seen and its tails below the excitation are no more than the tolerance, on average over the matrix: single
    /// cells may still hold more, as noise does anywhere.
    pub for_tails: Option<u32>,
    /// So that no line of scattered light is seen.
    pub for_lines: Option<u32>,
}

/// The least width of a band that is enough, or one up to a bandpass wider that the largest value isn't beside. What is left of a line is beside
/// its band; a dye that a band cuts into is, too, however wide the band is.
#[derive(Clone, Copy, Default)]
struct LeastWidth {
    enough: Option<u32>,
    clear: Option<u32>,
}

impl LeastWidth {
    fn add(&mut self, nm: u32, is_clear: bool) {
        let enough = *self.enough.get_or_insert(nm);
        if is_clear && self.clear.is_none() && f64::from(nm - enough) <= BANDPASS_NM {
            self.clear = Some(nm);
        }
    }

    fn is_settled(self, nm: u32) -> bool {
        self.clear.is_some() || self.enough.is_some_and(|enough| f64::from(nm - enough) >= BANDPASS_NM)
    }

    fn nm(self) -> Option<u32> {
        self.clear.or(self.enough)
    }
}

/// Cells that share the largest value, side by side along the emission, as those of a detector do that reached its end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overflow {
    /// The value.
    pub value: f64,
    /// How many cells hold it.
    pub cells: usize,
    /// First and last excitation wavelength at which they lie, nm.
    pub excitation_nm: [f64; 2],
    /// First and last emission wavelength, nm.
    pub emission_nm: [f64; 2],
}

impl std::fmt::Display for Overflow {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { value, cells, excitation_nm: ex, emission_nm: em } = self;
        let value = if *value < 1e9 { value.to_string() } else { format!("{value:e}") };
        write!(
            f,
            "{} the largest value {value}, at excitations from {} to {} nm and emissions from {} to {} nm: the detector was at its \
             end, and what lies above is lost. Measure again with a narrower slit, a lower gain or a thinner sample",
            counted(*cells, "cell has", "cells share"),
            ex[0],
            ex[1],
            em[0],
            em[1]
        )
    }
}

impl MeasuredEem {
    /// The least widths of band that cut enough of the scattered light out of a matrix, which is read with [`AntiStokes::Keep`] and without a
    /// cut, for values below their excitation up to a share of the peak.
    #[must_use]
    pub fn least_cuts(&self, to: CutTo, tolerance: f64) -> LeastCuts {
        let background = self.background();
        let has_no_tail = |within_nm: f64, eem: &Self| {
            let peak = eem.values.iter().copied().fold(0.0, f64::max);
            let window = within_nm..within_nm + BANDPASS_NM;
            let (mut sum, mut count) = (0.0, 0.0_f64);
            for (nm_below, value) in self.below_excitation().filter(|(nm, _)| window.contains(nm)) {
                if nm_below > window.start {
                    sum += value;
                    count += 1.0;
                }
            }
            sum / count.max(1.0) - background <= tolerance * peak
        };
        let [mut for_all, mut for_tails, mut for_lines] = [LeastWidth::default(); 3];
        for nm in 1..=MOST_CUT_NM {
            let within_nm = f64::from(nm);
            let cut = ScatterCut { within_nm, to };
            let mut eem = self.clone();
            eem.cut_scattered_light(cut);
            if !eem.is_of_a_dye(within_nm) {
                continue;
            }
            let passes = |rule| check_stokes(Path::new(""), &|_| 0, &mut eem.clone(), rule).is_ok();
            let is_clear = eem.peak_beside(cut).is_none();
            if passes(AntiStokes::SetToZero) {
                for_lines.add(nm, is_clear);
                if has_no_tail(within_nm, &eem) {
                    for_tails.add(nm, is_clear);
                }
            }
            if passes(AntiStokes::Refuse(tolerance)) {
                for_all.add(nm, is_clear);
            }
            if for_all.is_settled(nm) && for_tails.is_settled(nm) {
                break;
            }
        }
        LeastCuts { for_all: for_all.nm(), for_tails: for_tails.nm(), for_lines: for_lines.nm() }
    }

    /// Values below their excitation, and how far, nm.
    fn below_excitation(&self) -> impl Iterator<Item = (f64, f64)> {
        let columns = self.excitation_nm.len();
        let places = self.values.iter().enumerate();
        places
            .map(move |(place, value)| {
                (self.excitation_nm[place % columns] - self.emission_nm[place / columns], *value)
            })
            .filter(|(nm_below, _)| *nm_below > 0.0)
    }

    /// Median of the values so far below their excitation that neither fluorescence nor a tail of scattered light is there: dark counts, stray
    /// light. 0 without such values.
    fn background(&self) -> f64 {
        let far = self.below_excitation().filter(|(nm_below, _)| *nm_below > 5.0 * BANDPASS_NM);
        let mut far: Vec<f64> = far.map(|(_, value)| value).collect();
        far.sort_by(f64::total_cmp);
        far.get(far.len() / 2).copied().unwrap_or(0.0)
    }

    /// Row and column of the largest value above its excitation.
    fn peak(&self) -> (usize, usize) {
        let columns = self.excitation_nm.len();
        let above = |place: &usize| self.emission_nm[place / columns] >= self.excitation_nm[place % columns];
        let larger =
            |best: usize, place: usize| if self.values[place] > self.values[best] { place } else { best };
        let best = (0..self.values.len()).filter(above).reduce(larger).unwrap_or(0);
        (best / columns, best % columns)
    }

    /// Whether the largest value is one of a dye. A dye emits there under excitations, too, whose lines of scattered light lie elsewhere.
    fn is_of_a_dye(&self, within_nm: f64) -> bool {
        let columns = self.excitation_nm.len();
        let (row, column) = self.peak();
        let background = self.background();
        let peak = self.values[row * columns + column] - background;
        let far_nm = (2.0 * within_nm).max(within_nm + BANDPASS_NM);
        let nm = self.emission_nm[row];
        let is_elsewhere = |column: &usize| {
            let excitation_nm = self.excitation_nm[*column];
            let is_far = |line: &ScatterLine| (nm - line.emission_nm(excitation_nm)).abs() > far_nm;
            excitation_nm < nm && ScatterLine::ALL.iter().all(is_far)
        };
        let beside = (0..columns).filter(is_elsewhere).map(|column| self.values[row * columns + column]);
        beside.fold(0.0, f64::max) - background > LEAST_OF_A_DYE * peak
    }

    /// Cuts the bands of scattered light out, and counts their cells. The neighbors of one band may not be cells of another. The line of water is
    /// looked for where those of the orders are gone.
    pub(crate) fn cut_scattered_light(&mut self, cut: ScatterCut) {
        let measured = self.values.clone();
        self.cut_lines(cut, &ScatterLine::ORDERS, &measured);
        let water = ScatterLine::WaterRaman;
        if scattered(water, &self.emission_nm, &self.excitation_nm, &self.values).is_some() {
            self.cut_lines(cut, &ScatterLine::ALL, &measured);
        }
    }

    fn cut_lines(&mut self, cut: ScatterCut, lines: &[ScatterLine], measured: &[f64]) {
        let (rows, columns) = (self.emission_nm.len(), self.excitation_nm.len());
        self.cut_cells = [0; 4];
        for column in 0..columns {
            let line = |row: usize| cut.line(lines, self.emission_nm[row], self.excitation_nm[column]);
            let kept = |row: &usize| line(*row).is_none();
            for row in 0..rows {
                let Some(line) = line(row) else { continue };
                self.cut_cells[line as usize] += 1;
                let at = |row: usize| (self.emission_nm[row], measured[row * columns + column]);
                let (below, above) = ((0..row).rev().find(kept).map(at), (row..rows).find(kept).map(at));
                // Below its excitation nothing fluoresces, whatever stands beside the band
                let is_below = self.emission_nm[row] < self.excitation_nm[column];
                self.values[row * columns + column] = match (cut.to, below, above) {
                    _ if is_below => 0.0,
                    (CutTo::Zero, ..) | (_, None, None) => 0.0,
                    (_, Some((_, value)), None) | (_, None, Some((_, value))) => value,
                    (_, Some(below), Some(above)) => on_the_line(below, above, self.emission_nm[row]),
                };
            }
        }
    }

    /// Excitation and emission of the largest value, where it lies in a band that was cut out, or ends one, nm: the dye may emit most within the
    /// band.
    #[must_use]
    pub fn peak_beside(&self, cut: ScatterCut) -> Option<[f64; 2]> {
        let lines = if self.cut_cells[3] > 0 { &ScatterLine::ALL[..] } else { &ScatterLine::ORDERS[..] };
        let (row, column) = self.peak();
        let excitation_nm = self.excitation_nm[column];
        let in_band = |row: usize| {
            self.emission_nm.get(row).and_then(|nm| cut.line(lines, *nm, excitation_nm)).is_some()
        };
        let places = [Some(row), row.checked_sub(1), Some(row + 1)];
        let is_beside = places.into_iter().flatten().any(in_band);
        is_beside.then(|| [excitation_nm, self.emission_nm[row]])
    }

    /// Cells of a detector that reached its end: three or more side by side that share the largest value, where the values beside them are lower by
    /// more than the steps to which values are rounded.
    #[must_use]
    pub fn overflow(&self) -> Option<Overflow> {
        let columns = self.excitation_nm.len();
        let value = self.values.iter().copied().fold(0.0, f64::max);
        let mut upper: Vec<f64> = self.values.iter().copied().filter(|v| *v > 0.5 * value).collect();
        upper.sort_by(f64::total_cmp);
        let steps = upper.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 0.0);
        let step = steps.fold(f64::INFINITY, f64::min);
        // All beside is lower than half where there is no step
        let least_drop = if step.is_finite() { STEPS_OF_ROUNDING * step } else { 0.0 };
        let at = |row: usize, column: usize| self.values[row * columns + column];
        let rows = self.emission_nm.len();
        let is_flat = |column: usize| -> bool {
            let mut row = 0;
            while row < rows {
                let end = (row..rows).find(|row| at(*row, column) < value).unwrap_or(rows);
                let beside = [row.checked_sub(1), Some(end).filter(|end| *end < rows)];
                let mut drops = beside.into_iter().flatten().map(|row| value - at(row, column));
                if end - row >= LEAST_FLAT && drops.any(|drop| drop > least_drop) {
                    return true;
                }
                row = end + 1;
            }
            false
        };
        if value <= 0.0 || !(self.has_overflow_mark() || (0..columns).any(is_flat)) {
            return None;
        }
        let mut found = Overflow {
            value,
            cells: 0,
            excitation_nm: [f64::INFINITY, 0.0],
            emission_nm: [f64::INFINITY, 0.0],
        };
        let widened = |[first, last]: [f64; 2], nm: f64| [first.min(nm), last.max(nm)];
        for place in (0..self.values.len()).filter(|place| self.values[*place] >= value) {
            found.cells += 1;
            found.excitation_nm = widened(found.excitation_nm, self.excitation_nm[place % columns]);
            found.emission_nm = widened(found.emission_nm, self.emission_nm[place / columns]);
        }
        Some(found)
    }

    /// Whether the largest value is so far above all others that it is no value, but what an instrument writes where its detector was at its end.
    pub(crate) fn has_overflow_mark(&self) -> bool {
        let value = self.values.iter().copied().fold(0.0, f64::max);
        let next = self.values.iter().copied().filter(|v| *v < value).fold(0.0, f64::max);
        next > 0.0 && value > MARK_OF_OVERFLOW * next
    }
}

/// Least ratio of a mark of overflow to the values beside it.
const MARK_OF_OVERFLOW: f64 = 100.0;
/// Fewest cells side by side of a flat top.
const LEAST_FLAT: usize = 3;
/// Steps of rounding by which values beside a flat top are lower at least, where it is none of rounding.
const STEPS_OF_ROUNDING: f64 = 4.0;
/// Share of the largest value that a dye emits at its place under another excitation.
const LEAST_OF_A_DYE: f64 = 0.1;
/// Bandpass of an instrument, nm, at least: scattered light is as wide.
const BANDPASS_NM: f64 = 10.0;
/// Excitation wavelengths over which values must follow the excitation to be scattered light, nm. Emission keeps its place: in its own
/// maximum, or in the tail beyond, it looks so over less.
const SCATTER_SPAN_NM: f64 = 40.0;
/// Share of the peak below which scattered light changes little.
const LEAST_SCATTER: f64 = 0.02;
/// The same of Raman scatter of water.
const LEAST_WATER: f64 = 0.5;

/// Refuses a matrix, `[emission][excitation]`, whose values follow a line of scattered light: in three columns or more, over
/// 40 nm of excitation, the values within a bandpass of that line are more than twice all those one bandpass to three beside it. Where the
/// emission was measured along less of the line, in all columns that hold it, and not at the same emission under the excitations beside.
///
/// # Errors
/// [`Defect::ScatteredLight`].
pub fn refuse_scattered_light(
    path: &Path,
    emission_nm: &[f64],
    excitation_nm: &[f64],
    values: &[f64],
) -> Result<(), FormatError> {
    let seen = |line| {
        scattered(line, emission_nm, excitation_nm, values).map(|(span, percent)| (line, span, percent))
    };
    match ScatterLine::ALL.into_iter().find_map(seen) {
        None => Ok(()),
        Some((along, excitation_nm, percent_of_peak)) => {
            Err(Defect::ScatteredLight { along, excitation_nm, percent_of_peak }.of(path))
        }
    }
}

/// Refuses a matrix, `[emission][excitation]`, with a value below its excitation of more than [`ANTI_STOKES_TOLERANCE`] of the largest.
///
/// # Errors
/// [`Defect::AntiStokes`].
pub fn refuse_anti_stokes(
    path: &Path,
    emission_nm: &[f64],
    excitation_nm: &[f64],
    values: &[f64],
) -> Result<(), FormatError> {
    let columns = excitation_nm.len().max(1);
    let peak = values.iter().copied().fold(0.0, f64::max);
    for (index, &value) in values.iter().enumerate() {
        let (emission_nm, excitation_nm) = (emission_nm[index / columns], excitation_nm[index % columns]);
        if emission_nm < excitation_nm && value > ANTI_STOKES_TOLERANCE * peak {
            let percent_of_peak = 100.0 * value / peak;
            return Err(Defect::AntiStokes { emission_nm, excitation_nm, value, percent_of_peak }.of(path));
        }
    }
    Ok(())
}

/// Values about a line of scattered light.
struct AboutLine<'a> {
    line: ScatterLine,
    emission_nm: &'a [f64],
    excitation_nm: &'a [f64],
    values: &'a [f64],
    /// Half width of what counts as the line, nm.
    wide_nm: f64,
}

impl AboutLine<'_> {
    fn distance(&self, row: usize, column: usize) -> f64 {
        self.emission_nm[row] - self.line.emission_nm(self.excitation_nm[column])
    }

    /// Row and value of the largest one of a column at some distances from the line.
    fn largest(&self, column: usize, wanted: &dyn Fn(f64) -> bool) -> Option<(usize, f64)> {
        let columns = self.excitation_nm.len();
        let rows = (0..self.emission_nm.len()).filter(|row| wanted(self.distance(*row, column)));
        rows.map(|row| (row, self.values[row * columns + column]))
            .reduce(|a, b| if b.1 > a.1 { b } else { a })
    }

    fn on_line(&self, column: usize) -> Option<(usize, f64)> {
        self.largest(column, &|nm| nm.abs() <= self.wide_nm)
    }

    /// Largest values below and above the line.
    fn beside(&self, column: usize) -> [Option<f64>; 2] {
        let wide_nm = self.wide_nm;
        let near = |nm: f64| nm > wide_nm && nm <= 3.0 * wide_nm;
        [self.largest(column, &|nm| near(-nm)), self.largest(column, &|nm| near(nm))]
            .map(|found| Some(found?.1))
    }

    fn is_narrow(&self, column: usize, peak: f64) -> bool {
        let beside = self.beside(column).into_iter().flatten().reduce(f64::max);
        let (Some((_, value)), Some(beside)) = (self.on_line(column), beside) else { return false };
        value > self.line.least_share() * peak && value > 2.0 * beside
    }

    /// Whether what is on the line is gone from the same emission under the nearest excitations whose line lies elsewhere.
    fn moves(&self, column: usize) -> bool {
        let Some((row, value)) = self.on_line(column) else { return false };
        let columns = self.excitation_nm.len();
        let is_elsewhere = |other: &usize| self.distance(row, *other).abs() > 2.0 * self.wide_nm;
        let sides = [(0..column).rev().find(is_elsewhere), (column..columns).find(is_elsewhere)];
        let mut beside =
            sides.into_iter().flatten().map(|column| self.values[row * columns + column]).peekable();
        beside.peek().is_some() && beside.all(|other| 2.0 * other < value)
    }
}

/// First and last excitation at which a line of scattered light is seen, nm, and its largest value over the largest one off the line, %.
fn scattered(
    line: ScatterLine,
    emission_nm: &[f64],
    excitation_nm: &[f64],
    values: &[f64],
) -> Option<([f64; 2], f64)> {
    let steps = emission_nm.windows(2).map(|pair| pair[1] - pair[0]);
    let step_nm = steps.fold(0.0, f64::max);
    let wide_nm = BANDPASS_NM.max(0.75 * step_nm);
    let about = AboutLine { line, emission_nm, excitation_nm, values, wide_nm };
    let columns = excitation_nm.len();
    // What is left of the matrix without the line
    let off_line =
        |column: usize| about.largest(column, &|nm| nm.abs() > wide_nm).map_or(0.0, |found| found.1);
    let peak = (0..columns).map(off_line).fold(0.0, f64::max);
    let span = |columns: &[usize]| match columns {
        [first, .., last] => excitation_nm[*last] - excitation_nm[*first],
        _ => 0.0,
    };
    let is_long = |columns: &[usize]| columns.len() >= 3 && span(columns) >= SCATTER_SPAN_NM;
    // Cells above the line tell it from a slope
    let whole: Vec<usize> = (0..columns).filter(|column| about.beside(*column)[1].is_some()).collect();
    let whole: Vec<usize> = whole.into_iter().filter(|column| about.is_narrow(*column, peak)).collect();
    let held: Vec<usize> = (0..columns).filter(|column| about.on_line(*column).is_some()).collect();
    let is_short = is_long(&(0..columns).collect::<Vec<_>>()) && !is_long(&held);
    let found = if is_long(&whole) {
        whole
    } else if is_short && held.iter().all(|column| about.is_narrow(*column, peak) && about.moves(*column)) {
        held
    } else {
        return None;
    };
    let ends = [excitation_nm[*found.first()?], excitation_nm[*found.last()?]];
    let on_line = found.iter().filter_map(|column| about.on_line(*column)).map(|found| found.1);
    let largest = on_line.fold(0.0, f64::max);
    Some((ends, 100.0 * largest / if peak > 0.0 { peak } else { largest }))
}
