//! Progress on standard error.

use std::io::IsTerminal;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use fluorspar::units::memory_text;
use fluorspar_format::{unfinished_files, written_share};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::message::Messages;
use crate::values::duration;

/// Foretells the time that is left from the speed of late.
///
/// What was there before, as the samples of a film that is resumed, and what came before the first sample, as building the
/// scene, tell nothing about the speed and do not count. What comes after the render is not foretold.
#[derive(Debug, Default)]
struct Pace {
    last: Option<(f64, f64)>,
    /// Seconds and shares of the work, those of long ago with less weight.
    seconds: f64,
    done: f64,
    /// Share of the work that was done since the first report.
    since: f64,
}

impl Pace {
    /// Share of the work from which on a speed is known, and seconds.
    const LEAST: (f64, f64) = (0.02, 0.5);

    /// Seconds that are left when, after some seconds, a share of the work is done; nothing where it is too early to tell,
    /// and at the end.
    fn left(&mut self, elapsed: f64, share: f64) -> Option<f64> {
        let (before, held) = *self.last.get_or_insert((elapsed, share));
        // Threads may report out of order.
        let (step, more) = ((elapsed - before).max(0.0), (share - held).max(0.0));
        let keep = (-step / (elapsed / 4.0).max(30.0)).exp();
        (self.seconds, self.done) = (keep * self.seconds + step, keep * self.done + more);
        self.since += more;
        self.last = Some((elapsed.max(before), share.max(held)));
        let known = self.since >= Self::LEAST.0 && self.seconds >= Self::LEAST.1;
        (known && share < 1.0).then(|| (1.0 - share) * self.seconds / self.done)
    }
}

/// Time between two words about a file that is being written.
const WRITING: Duration = Duration::from_secs(10);

/// Tells of the files that are written while it lives how large the largest of them is already, and of an image which share of it is
/// written: a line every ten seconds.
pub(crate) struct WritingReport {
    ends: Option<Sender<()>>,
    teller: Option<JoinHandle<()>>,
}

impl WritingReport {
    /// Of a file of this name.
    pub(crate) fn begin(path: &Path, messages: Messages) -> Self {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let (ends, end) = mpsc::channel();
        let tell = move || {
            while end.recv_timeout(WRITING) == Err(RecvTimeoutError::Timeout) {
                let lengths =
                    unfinished_files().into_iter().filter_map(|file| Some(file.metadata().ok()?.len()));
                let bytes = lengths.max().unwrap_or(0);
                messages.status(writing_line(&name, bytes, written_share(name.as_ref())));
            }
        };
        Self { ends: Some(ends), teller: Some(thread::spawn(tell)) }
    }
}

/// How much of a file there is: its share where that is known, and its bytes.
fn writing_line(name: &str, bytes: u64, share: Option<f64>) -> String {
    let share = share.map_or_else(String::new, |share| format!("{:.0} %, ", (100.0 * share).floor()));
    format!("Writing {name}: {share}{} so far", memory_text(bytes))
}

impl Drop for WritingReport {
    fn drop(&mut self) {
        drop(self.ends.take());
        if let Some(teller) = self.teller.take() {
            // It has nothing to say but its words.
            let _ = teller.join();
        }
    }
}

/// A progress bar, or lines where standard error is not a terminal, of work that takes a while.
pub(crate) struct WorkReport {
    /// What is being done, at the beginning of a line.
    title: &'static str,
    /// The same within a sentence.
    work: &'static str,
    messages: Messages,
    started: Instant,
    /// Whether lines are written instead of a bar.
    lines: bool,
    bar: ProgressBar,
    /// Thousandths and tenths that were reported.
    thousandths: AtomicU64,
    tenths: AtomicU64,
    pace: Mutex<Pace>,
}

impl WorkReport {
    pub(crate) fn begin(title: &'static str, work: &'static str, messages: Messages) -> Self {
        let lines = !std::io::stderr().is_terminal();
        let bar = ProgressBar::new(1000);
        if messages.is_quiet() || lines {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        let template = format!("{title} [{{bar:32}}] {{percent:>3}} %  {{elapsed}} gone{{msg}}");
        if let Ok(style) = ProgressStyle::with_template(&template) {
            bar.set_style(style.progress_chars("=> "));
        }
        if !bar.is_hidden() {
            bar.enable_steady_tick(Duration::from_millis(200));
        }
        let [thousandths, tenths] = [const { AtomicU64::new(0) }; 2];
        let pace = Mutex::new(Pace::default());
        Self { title, work, messages, started: Instant::now(), lines, bar, thousandths, tenths, pace }
    }

    fn elapsed(&self) -> Duration {
        self.started.elapsed()
    }

    /// Says which share is done, from any thread. Calls between two thousandths cost next to nothing.
    pub(crate) fn share_done(&self, share: f64) {
        let thousandth = (1000.0 * share) as u64;
        if self.thousandths.fetch_max(thousandth + 1, Ordering::Relaxed) > thousandth {
            return;
        }
        self.bar.set_position(thousandth);
        let elapsed = self.elapsed().as_secs_f64();
        // Held to the end: lines of several threads come in order
        let Ok(mut pace) = self.pace.lock() else { return };
        let left = pace.left(elapsed, share);
        let left =
            left.map_or_else(String::new, |left| format!(", about {} of {} left", duration(left), self.work));
        if !self.lines {
            self.bar.set_message(left);
        } else if !self.messages.is_quiet() {
            let tenth = (10.0 * share) as u64;
            if self.tenths.fetch_max(tenth, Ordering::Relaxed) < tenth {
                let gone = duration(elapsed);
                self.messages.status(format!("{} {:>3} %, {gone} gone{left}", self.title, tenth * 10));
            }
        }
    }

    /// Takes the bar away.
    pub(crate) fn end(&self) {
        self.bar.finish_and_clear();
    }
}

impl Drop for WorkReport {
    fn drop(&mut self) {
        self.end();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_steady_render_ends_when_it_was_said_to_whatever_came_before() {
        // Half of a film is there already, and the first sample takes seven seconds.
        let mut pace = Pace::default();
        assert_eq!(pace.left(7.0, 0.5), None);
        for step in 1..100 {
            let (elapsed, share) = (7.0 + f64::from(step), 0.5 + 0.005 * f64::from(step));
            match pace.left(elapsed, share) {
                Some(left) => assert!((left - (107.0 - elapsed)).abs() < 1e-6, "{elapsed} {left}"),
                None => assert!(step < 4),
            }
        }
        assert_eq!(pace.left(107.0, 1.0), None);
    }

    #[test]
    fn the_time_left_follows_the_speed_without_jumps() {
        let mut pace = Pace::default();
        let (mut share, mut last) = (0.0, None);
        for second in 0..400 {
            // Half as fast from the hundredth second on.
            share += if second < 100 { 0.002 } else { 0.001 };
            let left = pace.left(f64::from(second), share);
            if let (Some(left), Some(last)) = (left, last) {
                let expected: f64 = last - 1.0;
                assert!((left - expected).abs() < 0.05 * expected.max(100.0), "{second}: {last} to {left}");
            }
            last = left.or(last);
        }
        // After five minutes of it the new speed is known to 5 %.
        let left = last.unwrap();
        assert!((left / ((1.0 - share) / 0.001) - 1.0).abs() < 0.05, "{left}");
    }

    #[test]
    fn files_that_know_their_share_tell_it() {
        assert_eq!(writing_line("a.exr", 1 << 30, Some(0.429)), "Writing a.exr: 42 %, 1.00 GiB so far");
        assert_eq!(writing_line("a.npy", 1 << 30, None), "Writing a.npy: 1.00 GiB so far");
    }

    #[test]
    fn durations_are_said_in_one_unit_or_two() {
        let said = [0.4, 59.6, 119.0, 150.0, 7199.0, 7260.0].map(duration);
        assert_eq!(said, ["0 s", "60 s", "119 s", "3 min", "120 min", "2 h 1 min"]);
    }
}
