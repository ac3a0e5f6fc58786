//! Messages and answers: the only place that writes to standard error and to standard output.
//!
//! Status, progress, warnings, hints and errors go to standard error. They are about the work and never stop it: a message
//! that can't be written, since nobody reads any more (`2>&1 | head -1`, a terminal that was closed, a dead `tee`) or the
//! disk is full, is dropped. Answers are data (`--json`, lists, texts): where their reader has gone the rest is dropped,
//! too, but a disk without room for them is an error.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::fmt::Display;
use std::io::{self, ErrorKind, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use fluorspar_experiment::Warning;
use fluorspar_session::{Job, Left, Listener};

use crate::error::as_typed;
use crate::interrupt::{save_when_interrupted, stop_flag};
use crate::progress::{WorkReport, WritingReport};

/// Whether warnings are said in full.
static VERBOSE: AtomicBool = AtomicBool::new(false);
thread_local! {
    /// Whether the command of this thread says nothing but its answer and errors.
    static QUIET: Cell<bool> = const { Cell::new(false) };
}

/// Whether the way to the whole warnings was told.
static HINTED: AtomicBool = AtomicBool::new(false);

/// How much is said on standard error. Errors are always said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Messages {
    /// Neither status nor warnings.
    Quiet,
    /// Status, and one line for each warning.
    Short,
    /// Status, and warnings with all that they name.
    Full,
}

/// What `--quiet` and `--verbose` select.
impl Default for Messages {
    fn default() -> Self {
        match QUIET.get() {
            true => Self::Quiet,
            false if VERBOSE.load(Ordering::Relaxed) => Self::Full,
            false => Self::Short,
        }
    }
}

/// From here on the command of this thread is quiet, as `--quiet` asks for, or not.
pub(crate) fn be_quiet(is_quiet: bool) {
    QUIET.set(is_quiet);
}

/// From here on warnings are said in full, as `--verbose` asks for.
pub(crate) fn be_verbose() {
    VERBOSE.store(true, Ordering::Relaxed);
}

impl Messages {
    /// What `--quiet` and `--verbose` select, of a command whose answer may be for a program: nothing then.
    pub(crate) fn unless(is_for_program: bool) -> Self {
        if is_for_program { Self::Quiet } else { Self::default() }
    }

    /// All of the warnings, unless `--quiet`: of a command that is asked for them.
    pub(crate) fn in_full() -> Self {
        if Self::default().is_quiet() { Self::Quiet } else { Self::Full }
    }

    /// Whether only errors are said.
    pub(crate) fn is_quiet(self) -> bool {
        self == Self::Quiet
    }

    /// Says what is being done or was done: one or more lines, or none.
    pub(crate) fn status(self, text: impl Display) {
        let text = text.to_string();
        if !self.is_quiet() && !text.is_empty() {
            say(&text);
        }
    }

    /// Warns of what the user should know. Equal lines are said once, with their number; where lines are shortened, a hint
    /// tells, once, how to see all of them.
    pub(crate) fn warnings(self, warnings: &[Warning]) {
        let shown = |warning: &Warning| match self {
            Self::Full => warning.text().to_string(),
            _ => warning.summary().to_string(),
        };
        for (line, count) in with_counts(warnings.iter().map(shown)) {
            match count {
                1 => self.status(format!("warning: {line}")),
                _ => self.status(format!("warning: {line} ({count} times)")),
            }
        }
        let shortened = self == Self::Short && warnings.iter().any(Warning::has_details);
        if shortened && !HINTED.swap(true, Ordering::Relaxed) {
            self.status("hint: --verbose and the report say more of these warnings");
        }
    }
}

impl Messages {
    /// What a task of the command runs with.
    pub(crate) fn job(self) -> Job {
        Job::new(stop_flag(), Arc::new(self))
    }
}

impl Listener for Messages {
    fn status(&self, text: &str) {
        Self::status(*self, as_typed(text));
    }

    fn hears_status(&self) -> bool {
        !self.is_quiet()
    }

    fn begin_writing(&self, file: &Path) -> Box<dyn Any> {
        Box::new(WritingReport::begin(file, *self))
    }

    fn warnings(&self, warnings: &[Warning]) {
        let typed = |warning: &Warning| match warning.text().contains('⟨') {
            true => Warning::from(as_typed(warning.text())),
            false => warning.clone(),
        };
        Self::warnings(*self, &warnings.iter().map(typed).collect::<Vec<_>>());
    }

    fn begin(&self, title: &'static str, name: &'static str, left: Left) -> Box<dyn Fn(f64) + Sync> {
        save_when_interrupted(left);
        let report = WorkReport::begin(title, name, *self);
        Box::new(move |share| report.share_done(share))
    }
}

/// Lines in their order, each once with the number of times it came.
fn with_counts(lines: impl IntoIterator<Item = String>) -> Vec<(String, usize)> {
    let mut counted: Vec<(String, usize)> = Vec::new();
    for text in lines {
        match counted.iter_mut().find(|(known, _)| *known == text) {
            Some((_, count)) => *count += 1,
            None => counted.push((text, 1)),
        }
    }
    counted
}

/// Characters of the longest error: lists of known names take a thousand.
const LONGEST_ERROR: usize = 4000;

/// Says why the work ended otherwise than was wanted, `--quiet` or not.
pub(crate) fn error(error: impl Display) {
    say(&format!("error: {}", without_middle(&printable(&error.to_string()), LONGEST_ERROR)));
}

/// A text of at most about `longest` characters: its beginning, which says what is wrong, and its end, which says what to do.
fn without_middle(text: &str, longest: usize) -> String {
    let length = text.chars().count();
    if length <= longest {
        return text.to_string();
    }
    let start: String = text.chars().take(longest / 2).collect();
    let end: String = text.chars().skip(length - longest / 2).collect();
    format!("{start} ... {end}")
}

/// Says something that the user must know, `--quiet` or not.
pub(crate) fn notice(text: impl Display) {
    say(&text.to_string());
}

/// Writes a message as whole lines in one go, so that those of several threads do not mix. Control characters, which could
/// come from a name or a file, are written as escapes: they would steer the terminal.
fn say(text: &str) {
    let line = format!("{}\n", printable(text));
    // Nothing can be said about what can't be said, and the work goes on.
    let _ = io::stderr().lock().write_all(line.as_bytes());
}

/// A text without control characters other than ends of lines.
fn printable(text: &str) -> String {
    let mut printable = String::with_capacity(text.len());
    for character in text.chars() {
        if character.is_control() && character != '\n' {
            printable.extend(character.escape_debug());
        } else {
            printable.push(character);
        }
    }
    printable
}

thread_local! {
    /// Answers of this thread, where they are kept instead of printed.
    static KEPT: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Keeps the answers that some work prints in this thread, and returns what it returned together with them.
pub(crate) fn with_answers_kept<T>(work: impl FnOnce() -> T) -> (T, String) {
    let before = KEPT.replace(Some(String::new()));
    let returned = work();
    (returned, KEPT.replace(before).unwrap_or_default())
}

/// Prints an answer on standard output, with one end of line behind it.
///
/// # Errors
/// If standard output can't take it, other than for want of a reader: one who has seen enough (`fluorspar catalog list | head`)
/// ends neither the work nor changes the exit code.
pub(crate) fn answer(text: &str) -> io::Result<()> {
    let is_kept = KEPT.with_borrow_mut(|kept| {
        kept.as_mut().map(|kept| *kept += &format!("{}\n", text.trim_end())).is_some()
    });
    if is_kept {
        return Ok(());
    }
    let mut out = io::stdout().lock();
    let written = out.write_all(format!("{}\n", text.trim_end()).as_bytes()).and_then(|()| out.flush());
    match written {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        written => written,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_texts_are_counted_where_they_came_first() {
        let counted = with_counts(["a", "b", "a", "c", "a"].map(String::from));
        assert_eq!(counted, [("a".into(), 3), ("b".into(), 1), ("c".into(), 1)]);
    }

    #[test]
    fn control_characters_are_escaped_and_lines_stay() {
        assert_eq!(printable("a\u{1b}[31mred\u{7}\nb\r\u{9b}"), "a\\u{1b}[31mred\\u{7}\nb\\r\\u{9b}");
        assert_eq!(printable("Größe 3 µm, \"x\""), "Größe 3 µm, \"x\"");
    }
}
