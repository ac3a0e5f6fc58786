//! Time that a program takes of the processor, which its neighbors do not lengthen as they do that of the clock.

use std::fs;
use std::time::Instant;

/// CPU seconds of this process so far, all threads; wall-clock time since `start` where the system does not tell. In steps of
/// 10 ms.
pub fn cpu_seconds(start: Instant) -> f64 {
    // Fields 14 and 15 of stat, in clock ticks, of which Linux has 100 a second on every architecture.
    let ticks = fs::read_to_string("/proc/self/stat").ok().and_then(|stat| {
        let rest = stat.rsplit_once(')')?.1.to_owned();
        let fields: Vec<&str> = rest.split_whitespace().collect();
        Some(fields.get(11)?.parse::<f64>().ok()? + fields.get(12)?.parse::<f64>().ok()?)
    });
    ticks.map_or_else(|| start.elapsed().as_secs_f64(), |ticks| ticks / 100.0)
}
