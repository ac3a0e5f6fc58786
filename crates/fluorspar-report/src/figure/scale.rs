//! Axes: limits, linear or logarithmic, and their ticks.

/// How values are spread along an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scale {
    /// Evenly.
    #[default]
    Linear,
    /// By powers of ten. Values that are not positive lie below the axis.
    Log10,
}

/// An axis. Its limits are explicit: no figure chooses them behind the reader's back.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Quantity of the axis.
    pub label: String,
    /// Its unit; empty for a pure number.
    pub unit: String,
    /// First and last value; the first may be the larger one.
    pub limits: [f64; 2],
    /// Linear or logarithmic.
    pub scale: Scale,
    /// Without ticks.
    pub(super) is_hidden: bool,
    /// Of whole numbers, without ticks between them.
    pub(super) is_count: bool,
    /// Names at 1, 2, 3 and so on, instead of numbers; empty for an axis of numbers.
    pub(super) names: Vec<String>,
}

/// A tick: value and text; minor ticks have no text.
pub(super) struct Tick {
    pub(super) value: f64,
    pub(super) text: Option<String>,
}

impl Axis {
    /// A linear axis.
    pub fn linear(label: impl Into<String>, unit: impl Into<String>, limits: [f64; 2]) -> Self {
        let (label, unit) = (label.into(), unit.into());
        Self {
            label,
            unit,
            limits,
            scale: Scale::Linear,
            is_hidden: false,
            is_count: false,
            names: Vec::new(),
        }
    }

    /// A logarithmic axis; both limits must be positive.
    pub fn log10(label: impl Into<String>, unit: impl Into<String>, limits: [f64; 2]) -> Self {
        Self { scale: Scale::Log10, ..Self::linear(label, unit, limits) }
    }

    /// A wavelength axis, nm.
    pub fn wavelength(limits: [f64; 2]) -> Self {
        Self::linear("wavelength", "nm", limits)
    }

    /// An axis without label and ticks, for display.
    pub fn hidden(limits: [f64; 2]) -> Self {
        Self { is_hidden: true, ..Self::linear("", "", limits) }
    }

    /// An axis of names at 1, 2, 3 and so on, half a step of room at both ends.
    pub fn named(label: impl Into<String>, names: impl IntoIterator<Item = String>) -> Self {
        let names: Vec<String> = names.into_iter().collect();
        let limits = [0.5, names.len().max(1) as f64 + 0.5];
        Self { names, ..Self::linear(label, "", limits) }
    }

    /// The axis with its limits exchanged, such as one of rows that are read from the top down.
    #[must_use]
    pub fn downward(mut self) -> Self {
        self.limits.reverse();
        self
    }

    /// The axis with ticks at whole numbers only.
    #[must_use]
    pub fn of_counts(self) -> Self {
        Self { is_count: true, ..self }
    }

    /// A linear axis from zero to a round number at or above the largest of some values.
    pub fn from_zero(
        label: impl Into<String>,
        unit: impl Into<String>,
        values: impl IntoIterator<Item = f64>,
    ) -> Self {
        let largest = values.into_iter().filter(|v| v.is_finite()).fold(0.0, f64::max);
        Self::linear(label, unit, [0.0, round_up(largest)])
    }

    /// A logarithmic axis of whole decades that ends at or above the largest of some values.
    pub fn decades(
        label: impl Into<String>,
        unit: impl Into<String>,
        values: impl IntoIterator<Item = f64>,
        decades: i32,
    ) -> Self {
        let largest = values.into_iter().filter(|v| v.is_finite()).fold(0.0, f64::max);
        // A peak of 1 must not open a new decade through a rounding error.
        let top = if largest > 0.0 { (largest.log10() - 1e-9).ceil() as i32 } else { 0 };
        Self::log10(label, unit, [10f64.powi(top - decades), 10f64.powi(top)])
    }

    pub(super) fn title(&self) -> String {
        if self.unit.is_empty() { self.label.clone() } else { format!("{} ({})", self.label, self.unit) }
    }

    /// Position of a value: 0 at the first limit, 1 at the last. Finite for every finite value.
    pub(super) fn position(&self, value: f64) -> f64 {
        let [first, last] = self.limits;
        let at = match self.scale {
            Scale::Linear => (value - first) / (last - first),
            Scale::Log10 => {
                let floor = first.min(last) * 1e-2;
                (value.max(floor) / first).log10() / (last / first).log10()
            }
        };
        if at.is_finite() { at.clamp(-20.0, 20.0) } else { at }
    }

    /// Ticks for an axis of so many labels at most.
    pub(super) fn ticks(&self, most: usize) -> Vec<Tick> {
        if self.is_hidden {
            return Vec::new();
        }
        if !self.names.is_empty() {
            let tick = |(k, name): (usize, &String)| Tick { value: (k + 1) as f64, text: Some(name.clone()) };
            let step = self.names.len().div_ceil(most.max(1));
            return self.names.iter().enumerate().step_by(step).map(tick).collect();
        }
        match self.scale {
            Scale::Linear => self.linear_ticks(most.max(2)),
            Scale::Log10 => self.log_ticks(most.max(2)),
        }
    }

    fn linear_ticks(&self, most: usize) -> Vec<Tick> {
        let (low, high) = (self.limits[0].min(self.limits[1]), self.limits[0].max(self.limits[1]));
        let range = high - low;
        if !(range > 0.0 && range.is_finite()) {
            return Vec::new();
        }
        let step = nice_step(range / most as f64).max(if self.is_count { 1.0 } else { 0.0 });
        let first = (low / step - 1e-6).ceil() as i64;
        let last = (high / step + 1e-6).floor() as i64;
        let largest = low.abs().max(high.abs());
        (first..=last)
            .map(|number| {
                let value = number as f64 * step;
                Tick { value, text: Some(format_number(value, step, largest)) }
            })
            .collect()
    }

    fn log_ticks(&self, most: usize) -> Vec<Tick> {
        let low = self.limits[0].min(self.limits[1]).log10();
        let high = self.limits[0].max(self.limits[1]).log10();
        if !(low.is_finite() && high.is_finite()) {
            return Vec::new();
        }
        let (first, last) = ((low - 1e-9).ceil() as i32, (high + 1e-9).floor() as i32);
        let every = ((last - first + 1).max(1) as usize).div_ceil(most).max(1) as i32;
        // Less than two powers of ten say nothing of the scale: round numbers, within a decade in even steps
        let is_short = (last - first) / every < 1;
        if is_short && high - low < 1.0 {
            return self.linear_ticks(most);
        }
        let mut ticks = Vec::new();
        for exponent in first - 1..=last {
            let decade = 10f64.powi(exponent);
            for digit in 1..10 {
                let value = f64::from(digit) * decade;
                if value.log10() < low - 1e-9 || value.log10() > high + 1e-9 {
                    continue;
                }
                if is_short {
                    let text = [1, 2, 5].contains(&digit).then(|| format_number(value, decade, value));
                    ticks.push(Tick { value, text });
                    continue;
                }
                let labeled = digit == 1 && (exponent - first).rem_euclid(every) == 0;
                if labeled || every == 1 {
                    ticks.push(Tick { value, text: labeled.then(|| format_power(exponent)) });
                }
            }
        }
        ticks
    }
}

/// 1, 2 or 5 times a power of ten, at or above `least`.
fn nice_step(least: f64) -> f64 {
    let power = 10f64.powf(least.log10().floor());
    let digit = [1.0, 2.0, 5.0, 10.0].into_iter().find(|digit| digit * power >= least * (1.0 - 1e-9));
    digit.unwrap_or(10.0) * power
}

/// A round number at or above a value; 1 for zero.
fn round_up(value: f64) -> f64 {
    if value <= 0.0 {
        return 1.0;
    }
    let power = 10f64.powf(value.log10().floor());
    let digits = [1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0];
    digits.into_iter().find(|digit| digit * power >= value * (1.0 - 1e-9)).unwrap_or(10.0) * power
}

const SUPERSCRIPT: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];

fn superscript(number: i32) -> String {
    let sign = if number < 0 { "⁻" } else { "" };
    let digits = number.unsigned_abs().to_string();
    let raised = digits.chars().filter_map(|d| d.to_digit(10)).map(|d| SUPERSCRIPT[d as usize]);
    sign.chars().chain(raised).collect()
}

fn format_power(exponent: i32) -> String {
    match exponent {
        0 => "1".into(),
        1 => "10".into(),
        2 => "100".into(),
        _ => format!("10{}", superscript(exponent)),
    }
}

/// A tick's text, with the digits that its step needs; powers of ten for very large and very small axes.
fn format_number(value: f64, step: f64, largest: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let text = if (1e-3..1e5).contains(&largest) {
        let decimals = (-(step.log10() + 1e-9).floor()).max(0.0) as usize;
        format!("{value:.decimals$}")
    } else {
        let exponent = value.abs().log10().floor() as i32;
        let decimals = (f64::from(exponent) - (step.log10() + 1e-9).floor()).max(0.0) as usize;
        let digits = value / 10f64.powi(exponent);
        format!("{digits:.decimals$}×10{}", superscript(exponent))
    };
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(axis: &Axis, most: usize) -> Vec<String> {
        axis.ticks(most).into_iter().filter_map(|tick| tick.text).collect()
    }

    #[test]
    fn ticks_are_round_and_inside() {
        let axis = Axis::wavelength([380.0, 780.0]);
        assert_eq!(texts(&axis, 5), ["400", "500", "600", "700"]);
        assert_eq!(texts(&Axis::linear("r", "", [0.0, 1.0]), 5), ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(texts(&Axis::linear("exposures", "", [0.0, 2.5]).of_counts(), 8), ["0", "1", "2"]);
        assert_eq!(texts(&Axis::linear("x", "", [-0.1, 0.1]), 3), ["−0.1", "0", "0.1"]);
        assert_eq!(texts(&Axis::linear("x", "", [0.0, 2e-5]), 2), ["0", "1×10⁻⁵", "2×10⁻⁵"]);
        assert_eq!(texts(&Axis::linear("x", "", [1.0, 0.0]), 2), ["0", "0.5", "1.0"]);
        assert!(texts(&Axis::linear("x", "", [1.0, 1.0]), 2).is_empty());
    }

    #[test]
    fn logarithmic_axes_label_decades() {
        let axis = Axis::decades("T", "", [0.97, 1.0], 4);
        assert_eq!(axis.limits, [1e-4, 1.0]);
        assert_eq!(texts(&axis, 8), ["10⁻⁴", "10⁻³", "10⁻²", "10⁻¹", "1"]);
        assert_eq!(axis.ticks(8).len(), 4 * 9 + 1);
        assert!((axis.position(1e-2) - 0.5).abs() < 1e-12);
        // Zero lies below the axis, at a finite place, so that a line can leave through the bottom.
        assert!(axis.position(0.0) < 0.0 && axis.position(0.0).is_finite());
    }

    #[test]
    fn logarithmic_axes_of_few_decades_label_round_numbers() {
        let of = |limits: [f64; 2]| texts(&Axis::log10("loss", "", limits), 5);
        // Within a decade even steps, whether it holds a power of ten or not
        assert_eq!(of([0.0012, 0.0031]), ["0.0015", "0.0020", "0.0025", "0.0030"]);
        assert_eq!(of([0.06, 0.21]), ["0.10", "0.15", "0.20"]);
        assert_eq!(of([0.03, 0.9]), ["0.05", "0.1", "0.2", "0.5"]);
        // Ticks stand where their values are on the logarithmic axis
        let axis = Axis::log10("loss", "", [1.0, 9.0]);
        let three = axis.ticks(9).into_iter().find(|tick| tick.text.as_deref() == Some("3")).unwrap();
        assert!((axis.position(three.value) - 3f64.log10() / 9f64.log10()).abs() < 1e-12);
        for limits in [[1e-4, 1.0], [0.05, 40.0], [0.2, 30.0]] {
            assert!(of(limits).len() >= 2, "{limits:?}");
        }
    }

    #[test]
    fn names_stand_at_whole_numbers() {
        let axis = Axis::named("design", ["a", "b", "c"].map(String::from)).downward();
        let ticks = |most| -> Vec<(f64, String)> {
            axis.ticks(most).into_iter().map(|tick| (axis.position(tick.value), tick.text.unwrap())).collect()
        };
        let texts: Vec<String> = ticks(3).into_iter().map(|(_, text)| text).collect();
        assert_eq!(texts, ["a", "b", "c"]);
        // The first is the uppermost
        assert!((ticks(3)[0].0 - 5.0 / 6.0).abs() < 1e-12 && (ticks(3)[2].0 - 1.0 / 6.0).abs() < 1e-12);
        assert_eq!(ticks(2).len(), 2);
    }

    #[test]
    fn from_zero_ends_on_a_round_number() {
        assert_eq!(Axis::from_zero("y", "", [0.3, f64::NAN, 0.47]).limits, [0.0, 0.5]);
        assert_eq!(Axis::from_zero("y", "", []).limits, [0.0, 1.0]);
        assert_eq!(Axis::from_zero("y", "", [1.0]).limits, [0.0, 1.0]);
    }
}
