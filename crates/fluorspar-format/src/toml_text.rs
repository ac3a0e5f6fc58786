//! TOML texts: every one is parsed here, once it is known that its brackets do not end the stack of a parser.

use serde::de::DeserializeOwned;
use thiserror::Error;
use toml::Spanned;
use toml::de::DeTable;
use toml_edit::DocumentMut;
use toml_parser::Source;
use toml_parser::lexer::TokenKind;

/// Most brackets within each other. Parsers refuse 80 in a text without mistakes; after a mistake they follow any number of them, until
/// the stack ends.
const MOST_BRACKETS: usize = 200;

/// Why a text is no TOML, or not that of a wanted type.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{display}")]
pub struct TomlError {
    display: String,
    message: String,
    line: Option<usize>,
}

impl TomlError {
    fn new(text: &str, error: &impl std::fmt::Display, message: &str, start: Option<usize>) -> Self {
        let line = |start: usize| {
            1 + text.as_bytes()[..start.min(text.len())].iter().filter(|b| **b == b'\n').count()
        };
        Self { display: error.to_string(), message: message.into(), line: start.map(line) }
    }

    /// What is wrong, without the place.
    #[must_use]
    pub fn message(&self) -> &str {
        &self.message
    }

    /// The line, from 1, where one is to blame.
    #[must_use]
    pub fn line(&self) -> Option<usize> {
        self.line
    }
}

/// Reads a TOML text as a value of a type, or as a [`toml::Table`].
///
/// # Errors
/// No TOML, or another type.
pub fn read_toml<T: DeserializeOwned>(text: &str) -> Result<T, TomlError> {
    check_brackets(text)?;
    toml::from_str(text).map_err(|e| TomlError::new(text, &e, e.message(), e.span().map(|span| span.start)))
}

/// Reads a TOML text as a table whose values know their places.
///
/// # Errors
/// No TOML.
pub fn read_toml_places(text: &str) -> Result<Spanned<DeTable<'_>>, TomlError> {
    check_brackets(text)?;
    DeTable::parse(text).map_err(|e| TomlError::new(text, &e, e.message(), e.span().map(|span| span.start)))
}

/// Reads a TOML text as a document that keeps its comments and its layout when it is changed.
///
/// # Errors
/// No TOML.
pub fn read_toml_document(text: &str) -> Result<DocumentMut, TomlError> {
    check_brackets(text)?;
    text.parse::<DocumentMut>()
        .map_err(|e| TomlError::new(text, &e, e.message(), e.span().map(|span| span.start)))
}

/// Brackets of a TOML text that no parser may follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("more than {MOST_BRACKETS} brackets are open here; close the brackets above this line")]
struct DeepBrackets {
    /// Line of the first bracket beyond, from 1.
    line: usize,
}

impl From<DeepBrackets> for TomlError {
    fn from(deep: DeepBrackets) -> Self {
        let message = deep.to_string();
        Self { display: format!("line {}: {message}", deep.line), message, line: Some(deep.line) }
    }
}

/// Checks a TOML text before it is parsed. A closing bracket that does not fit the last one opened closes none, as for a parser.
fn check_brackets(text: &str) -> Result<(), DeepBrackets> {
    let mut open = Vec::new();
    for token in Source::new(text).lex() {
        let opened_by = match token.kind() {
            TokenKind::RightSquareBracket => TokenKind::LeftSquareBracket,
            TokenKind::RightCurlyBracket => TokenKind::LeftCurlyBracket,
            kind @ (TokenKind::LeftSquareBracket | TokenKind::LeftCurlyBracket) => {
                open.push(kind);
                if open.len() > MOST_BRACKETS {
                    let before = &text.as_bytes()[..token.span().start().min(text.len())];
                    let line = 1 + before.iter().filter(|byte| **byte == b'\n').count();
                    return Err(DeepBrackets { line });
                }
                continue;
            }
            _ => continue,
        };
        if open.last() == Some(&opened_by) {
            open.pop();
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brackets_that_are_closed_or_in_texts_do_not_count() {
        let closed = "a = [[1, 2], { b = [3] }]\n[[t]]\n[t.u]\n".repeat(1000);
        let quoted = format!("a = \"{0}\"\nb = '{0}' # {0}\n", "[{".repeat(1000));
        assert_eq!((check_brackets(&closed), check_brackets(&quoted)), (Ok(()), Ok(())));
        assert_eq!(check_brackets(&"[".repeat(MOST_BRACKETS)), Ok(()));
    }

    #[test]
    fn every_reader_refuses_deep_brackets_and_tells_the_line_of_mistakes() {
        let deep = format!("a = 1\nb = {}\n", "[".repeat(100_000));
        let wrong = "a = 1\nb = [\n";
        let lines = |text: &str| {
            [
                read_toml::<toml::Table>(text).unwrap_err().line(),
                read_toml_places(text).unwrap_err().line(),
                read_toml_document(text).unwrap_err().line(),
            ]
        };
        assert_eq!(lines(&deep), [Some(2); 3]);
        assert!(lines(wrong).iter().all(|line| matches!(line, Some(2 | 3))), "{:?}", lines(wrong));
        let said = read_toml::<toml::Table>(&deep).unwrap_err().to_string();
        assert!(said.starts_with("line 2: more than 200 brackets"), "{said}");
    }

    #[test]
    fn open_brackets_are_counted_over_lines_and_through_mistakes() {
        for damaged in ["a = [[8, 4], { , [4]]\n", "[ { ] }\n", "a = {\n", "[[a\n"] {
            let error = check_brackets(&damaged.repeat(20_000)).unwrap_err();
            assert!(error.line > 60 && error.line <= 201, "{damaged} {}", error.line);
        }
    }
}
