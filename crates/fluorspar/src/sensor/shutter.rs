//! When each row collects light: global and rolling shutters, strobed light.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::SensorProblem;

/// How rows begin and end their exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ShutterKind {
    /// All rows at once; each waits in a storage node until it is read.
    #[default]
    Global,
    /// Each row a row time after the one above.
    Rolling,
}

/// Shutter and readout timing (physical and noise-free mode only). Time 0 is the start of the first row's exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Shutter {
    /// Global or rolling. Default "global".
    #[serde(rename = "type")]
    pub kind: ShutterKind,
    /// Time from reading one row to reading the next, us, 0 to 1e6. Default 0.
    pub row_time_us: f64,
    /// Parasitic light sensitivity of a global shutter: response of the storage node, in which a row waits to be read,
    /// over that of the photodiode; 0 to 1. Default 0.
    pub parasitic_light_sensitivity: f64,
}

/// Pulsed light, driven by the sensor: all light of a frame is on only then (physical and noise-free mode only).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Strobe {
    /// Time from the start of the first row's exposure to the pulse, ms; may be negative. Default 0.
    #[serde(default)]
    pub delay_ms: f64,
    /// Length of the pulse, ms. Default: until the end.
    pub duration_ms: Option<f64>,
    /// Pulse width modulation within the pulse, Hz; it begins switched on. Default: none.
    pub frequency_hz: Option<f64>,
    /// Share of each period that the light is on, above 0 and at most 1. Default 1.
    #[serde(default = "always")]
    pub duty: f64,
}

fn always() -> f64 {
    1.0
}

impl Shutter {
    /// Whether it is a global shutter without peculiarities.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    pub(super) fn validate(&self) -> Result<(), SensorProblem> {
        let within = SensorProblem::unless_within;
        within("shutter.row_time_us", self.row_time_us, [0.0, 1e6], "give microseconds per row")?;
        let sensitivity = self.parasitic_light_sensitivity;
        let hint = "give a fraction, not percent or a ratio such as 1:10000";
        within("shutter.parasitic_light_sensitivity", sensitivity, [0.0, 1.0], hint)?;
        if self.kind == ShutterKind::Rolling && sensitivity > 0.0 {
            let message = "a rolling shutter has no storage node; remove it or set type = \"global\"";
            return Err(SensorProblem::new("shutter.parasitic_light_sensitivity", message));
        }
        Ok(())
    }
}

impl Strobe {
    pub(super) fn validate(&self) -> Result<(), SensorProblem> {
        let within = SensorProblem::unless_within;
        within("strobe.delay_ms", self.delay_ms, [-1e9, 1e9], "give milliseconds")?;
        for (field, value, range, hint) in [
            ("strobe.duration_ms", self.duration_ms, [1e-12, 1e9], "give milliseconds"),
            ("strobe.frequency_hz", self.frequency_hz, [1e-6, 1e9], "give Hz"),
        ] {
            within(field, value.unwrap_or(1.0), range, hint)?;
        }
        within("strobe.duty", self.duty, [1e-12, 1.0], "give a fraction, not percent")?;
        if self.duty < 1.0 && self.frequency_hz.is_none() {
            let message = "a duty needs a frequency; give strobe.frequency_hz";
            return Err(SensorProblem::new("strobe.duty", message));
        }
        Ok(())
    }

    /// Time that the light is on in a frame that takes so long, s: a pulse of its own length, or one until the end of the frame.
    pub(super) fn pulse_s(&self, frame_s: f64) -> f64 {
        let start_s = self.delay_ms * 1e-3;
        self.on_time_s(start_s, self.duration_ms.map_or(frame_s, |ms| start_s + ms * 1e-3))
    }

    /// Time that the light is on between two times, s.
    fn on_time_s(&self, from_s: f64, to_s: f64) -> f64 {
        let start = self.delay_ms * 1e-3;
        let end = self.duration_ms.map_or(f64::INFINITY, |ms| start + ms * 1e-3);
        let (from, to) = (from_s.max(start) - start, to_s.min(end) - start);
        if to <= from {
            return 0.0;
        }
        let Some(frequency) = self.frequency_hz else { return to - from };
        let on_until = |t: f64| {
            let periods = t * frequency;
            (periods.floor() * self.duty + (periods - periods.floor()).min(self.duty)) / frequency
        };
        on_until(to) - on_until(from)
    }
}

/// Shutter and strobe together.
#[derive(Clone, Copy, Debug)]
pub(super) struct Timing {
    pub(super) shutter: Shutter,
    pub(super) strobe: Option<Strobe>,
}

impl Timing {
    fn on_time_s(&self, from_s: f64, to_s: f64) -> f64 {
        self.strobe.map_or((to_s - from_s).max(0.0), |strobe| strobe.on_time_s(from_s, to_s))
    }

    /// Start of a row's exposure, s; rows are counted from the first that is read.
    fn start_s(&self, row: usize) -> f64 {
        match self.shutter.kind {
            ShutterKind::Global => 0.0,
            ShutterKind::Rolling => row as f64 * self.shutter.row_time_us * 1e-6,
        }
    }

    /// Time that a row collects light between two times, s: its exposure, and the wait in the storage node weighted by
    /// the parasitic sensitivity.
    pub(super) fn light_s_between(&self, row: usize, time_s: f64, [from_s, to_s]: [f64; 2]) -> f64 {
        let start = self.start_s(row);
        let end = start + time_s;
        let mut light_s = self.on_time_s(start.max(from_s), end.min(to_s));
        if self.shutter.parasitic_light_sensitivity > 0.0 {
            let read = end + row as f64 * self.shutter.row_time_us * 1e-6;
            light_s +=
                self.shutter.parasitic_light_sensitivity * self.on_time_s(end.max(from_s), read.min(to_s));
        }
        light_s
    }

    /// Time that a row collects light, s.
    pub(super) fn light_s(&self, row: usize, time_s: f64) -> f64 {
        self.light_s_between(row, time_s, [f64::NEG_INFINITY, f64::INFINITY])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rolling(row_time_us: f64, strobe: Option<Strobe>) -> Timing {
        let shutter = Shutter { kind: ShutterKind::Rolling, row_time_us, ..Shutter::default() };
        Timing { shutter, strobe }
    }

    const PULSE: Strobe = Strobe { delay_ms: 2.0, duration_ms: Some(1.0), frequency_hz: None, duty: 1.0 };

    #[test]
    fn steady_light_is_collected_for_the_exposure_in_every_row() {
        for timing in [rolling(30.0, None), Timing { shutter: Shutter::default(), strobe: None }] {
            for row in [0, 1, 700] {
                assert!((timing.light_s(row, 0.01) - 0.01).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn a_rolling_shutter_cuts_a_short_pulse() {
        // 1 ms rows: exposures of 3 ms begin at 0, 1, 2, 3 ms; the light is on from 2 to 3 ms.
        let timing = rolling(1000.0, Some(PULSE));
        let seen: Vec<f64> = (0..5).map(|row| (timing.light_s(row, 0.003) * 1e6).round()).collect();
        assert_eq!(seen, [1000.0, 1000.0, 1000.0, 0.0, 0.0]);
        let global = Timing { shutter: Shutter::default(), ..timing };
        assert!((0..5).all(|row| (global.light_s(row, 0.003) - 1e-3).abs() < 1e-12));
    }

    #[test]
    fn modulated_light_makes_bands_of_its_period() {
        let strobe = Strobe { delay_ms: 0.0, duration_ms: None, frequency_hz: Some(1000.0), duty: 0.25 };
        let timing = rolling(100.0, Some(strobe));
        // An exposure of whole periods sees no bands.
        assert!((0..50).all(|row| (timing.light_s(row, 0.002) - 0.5e-3).abs() < 1e-12));
        // Half a period: from 0.25 ms (row 0) down to nothing (row 3, 0.3 to 0.8 ms), with a period of ten rows.
        let seen: Vec<f64> = (0..20).map(|row| timing.light_s(row, 0.0005) * 1e3).collect();
        assert!((seen[0] - 0.25).abs() < 1e-9 && seen[3] < 1e-9, "{seen:?}");
        assert!((0..10).all(|row| (seen[row] - seen[row + 10]).abs() < 1e-9));
        assert!((seen[..10].iter().sum::<f64>() / 10.0 - 0.125).abs() < 1e-9);
    }

    #[test]
    fn waiting_rows_of_a_leaky_global_shutter_brighten_downwards() {
        let shutter = Shutter { row_time_us: 10.0, parasitic_light_sensitivity: 1e-3, ..Shutter::default() };
        let timing = Timing { shutter, strobe: None };
        // Row 1000 waits 10 ms at a thousandth: 10 us more.
        assert!((timing.light_s(1000, 0.005) - 0.005_01).abs() < 1e-12);
        assert_eq!(timing.light_s(0, 0.005), 0.005);
        // Light that ends with the exposure leaves nothing for the wait.
        let pulse = Strobe { delay_ms: 0.0, duration_ms: Some(5.0), frequency_hz: None, duty: 1.0 };
        let strobed = Timing { shutter, strobe: Some(pulse) };
        assert!((strobed.light_s(1000, 0.005) - 0.005).abs() < 1e-12);
    }
}
