//! How deep the brackets of a TOML text lie within each other.

use thiserror::Error;
use toml_parser::Source;
use toml_parser::lexer::TokenKind;

/// Most brackets within each other. Parsers refuse 80 in a text without mistakes; after a mistake they follow any number of them, until
/// the stack ends.
const MOST_BRACKETS: usize = 200;

/// Brackets of a TOML text that no parser may follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("more than {MOST_BRACKETS} brackets are open here; is one before not closed?")]
pub struct DeepBrackets {
    /// Line of the first bracket beyond, from 1.
    pub line: usize,
}

/// Checks a TOML text before it is parsed. A closing bracket that does not fit the last one opened closes none, as for a parser.
///
/// # Errors
/// More brackets within each other than any file has.
pub fn check_brackets(text: &str) -> Result<(), DeepBrackets> {
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
    fn open_brackets_are_counted_over_lines_and_through_mistakes() {
        for damaged in ["a = [[8, 4], { , [4]]\n", "[ { ] }\n", "a = {\n", "[[a\n"] {
            let error = check_brackets(&damaged.repeat(20_000)).unwrap_err();
            assert!(error.line > 60 && error.line <= 201, "{damaged} {}", error.line);
        }
    }
}
