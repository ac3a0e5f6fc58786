//! Messages and answers: the only place that writes to standard error and to standard output.
//!
//! Status, progress, warnings, hints and errors go to standard error. They are about the work and never stop it: a message
//! that can't be written, since nobody reads any more (`2>&1 | head -1`, a terminal that was closed, a dead `tee`) or the
//! disk is full, is dropped. Answers are data (`--json`, lists, texts): where their reader has gone the rest is dropped,
//! too, but a disk without room for them is an error.

use std::fmt::Display;
use std::io::{self, ErrorKind, Write};

/// How much is said on standard error. Errors are always said.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Messages {
    /// Neither status nor warnings.
    Quiet,
    /// Status, and one line for each warning.
    #[default]
    Short,
}

impl Messages {
    /// What `--quiet` selects.
    pub(crate) fn unless(quiet: bool) -> Self {
        if quiet { Self::Quiet } else { Self::Short }
    }

    /// Whether only errors are said.
    pub(crate) fn is_quiet(self) -> bool {
        self == Self::Quiet
    }

    /// Says what is being done or was done: one or more lines.
    pub(crate) fn status(self, text: impl Display) {
        if !self.is_quiet() {
            say(&text.to_string());
        }
    }

    /// Warns of something that the user should know. Equal warnings are said once, with their number.
    pub(crate) fn warnings<W: Display>(self, warnings: impl IntoIterator<Item = W>) {
        if self.is_quiet() {
            return;
        }
        for (warning, count) in counted(warnings) {
            match count {
                1 => say(&format!("warning: {warning}")),
                _ => say(&format!("warning: {warning} ({count} times)")),
            }
        }
    }
}

/// Texts in their order, each once with the number of times it came.
fn counted<W: Display>(texts: impl IntoIterator<Item = W>) -> Vec<(String, usize)> {
    let mut counted: Vec<(String, usize)> = Vec::new();
    for text in texts {
        let text = text.to_string();
        match counted.iter_mut().find(|(known, _)| *known == text) {
            Some((_, count)) => *count += 1,
            None => counted.push((text, 1)),
        }
    }
    counted
}

/// Says why the work ended otherwise than was wanted, `--quiet` or not.
pub(crate) fn error(error: impl Display) {
    say(&format!("error: {error}"));
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

/// Prints an answer on standard output, with one end of line behind it.
///
/// # Errors
/// If standard output can't take it, other than for want of a reader: one who has seen enough (`fluorspar presets | head`)
/// ends neither the work nor changes the exit code.
pub(crate) fn answer(text: &str) -> io::Result<()> {
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
        let counted = counted(["a", "b", "a", "c", "a"]);
        assert_eq!(counted, [("a".into(), 3), ("b".into(), 1), ("c".into(), 1)]);
    }

    #[test]
    fn control_characters_are_escaped_and_lines_stay() {
        assert_eq!(printable("a\u{1b}[31mred\u{7}\nb\r\u{9b}"), "a\\u{1b}[31mred\\u{7}\nb\\r\\u{9b}");
        assert_eq!(printable("Größe 3 µm, \"x\""), "Größe 3 µm, \"x\"");
    }
}
