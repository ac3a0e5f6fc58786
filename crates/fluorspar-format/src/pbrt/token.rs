//! The words of a scene file, one after the other.

use std::borrow::Cow;

use super::error::Fault;
use fluorspar::quote::excerpt;

/// A word of a scene file.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Token<'a> {
    /// A directive, a number, `true` or `false`.
    Word(&'a [u8]),
    /// A text in quotes, without them.
    Text(Cow<'a, str>),
    /// `[`.
    Open,
    /// `]`.
    Close,
}

/// The words of a text, with their lines and columns.
pub(super) struct Tokens<'a> {
    bytes: &'a [u8],
    at: usize,
    line: u32,
    line_start: usize,
    peeked: Option<(Token<'a>, [u32; 2])>,
    /// The first number with a comma behind it.
    comma: Option<[u32; 2]>,
}

impl<'a> Tokens<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
        Self { bytes, at: 0, line: 1, line_start: 0, peeked: None, comma: None }
    }

    /// Line and column of the next byte.
    pub(super) fn here(&self) -> [u32; 2] {
        let column = self.at.saturating_sub(self.line_start) + 1;
        [self.line, u32::try_from(column).unwrap_or(u32::MAX)]
    }

    /// The place of the first number with a comma behind it, which was passed over.
    pub(super) fn comma(&self) -> Option<[u32; 2]> {
        self.comma
    }

    /// The next word without taking it.
    pub(super) fn peek(&mut self) -> Result<Option<&(Token<'a>, [u32; 2])>, Fault> {
        if self.peeked.is_none() {
            self.peeked = self.read()?;
        }
        Ok(self.peeked.as_ref())
    }

    /// Takes the next word; `None` at the end.
    pub(super) fn next(&mut self) -> Result<Option<(Token<'a>, [u32; 2])>, Fault> {
        match self.peeked.take() {
            Some(token) => Ok(Some(token)),
            None => self.read(),
        }
    }

    fn read(&mut self) -> Result<Option<(Token<'a>, [u32; 2])>, Fault> {
        self.skip_blanks();
        let place = self.here();
        let Some(&first) = self.bytes.get(self.at) else { return Ok(None) };
        let token = match first {
            b'[' => {
                self.at += 1;
                Token::Open
            }
            b']' => {
                self.at += 1;
                Token::Close
            }
            b'"' => Token::Text(self.quoted(place)?),
            _ => {
                let rest = &self.bytes[self.at..];
                let ends =
                    |byte: &u8| byte.is_ascii_whitespace() || matches!(byte, b'[' | b']' | b'"' | b'#');
                let length = rest.iter().position(ends).unwrap_or(rest.len());
                self.at += length;
                match &rest[..length] {
                    // As version 3 reads numbers, up to what is none.
                    [number @ .., b','] if matches!(first, b'0'..=b'9' | b'+' | b'-' | b'.') => {
                        self.comma.get_or_insert(place);
                        Token::Word(number)
                    }
                    word => Token::Word(word),
                }
            }
        };
        Ok(Some((token, place)))
    }

    /// Passes over blanks and comments.
    fn skip_blanks(&mut self) {
        while let Some(&byte) = self.bytes.get(self.at) {
            match byte {
                b'\n' => {
                    self.at += 1;
                    self.line = self.line.saturating_add(1);
                    self.line_start = self.at;
                }
                b'#' => {
                    let rest = &self.bytes[self.at..];
                    self.at += rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
                }
                _ if byte.is_ascii_whitespace() => self.at += 1,
                _ => return,
            }
        }
    }

    /// A text in quotes, on one line; `\"`, `\\`, `\n` and `\t` are escapes.
    fn quoted(&mut self, place: [u32; 2]) -> Result<Cow<'a, str>, Fault> {
        self.at += 1;
        let rest = &self.bytes[self.at..];
        let mut escaped = false;
        let mut length = 0;
        loop {
            match rest.get(length) {
                None | Some(b'\n') => {
                    return Err(Fault::new(place, "this text has no closing quote on its line; add \""));
                }
                Some(b'"') => break,
                Some(b'\\') => {
                    escaped = true;
                    length += 2;
                }
                Some(_) => length += 1,
            }
        }
        self.at += length + 1;
        let text = String::from_utf8_lossy(&rest[..length]);
        Ok(if escaped { Cow::Owned(unescaped(&text)) } else { text })
    }
}

fn unescaped(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    let mut chars = text.chars();
    while let Some(c) = chars.next() {
        match c {
            '\\' => match chars.next() {
                Some('n') => plain.push('\n'),
                Some('t') => plain.push('\t'),
                Some(other) => plain.push(other),
                None => {}
            },
            _ => plain.push(c),
        }
    }
    plain
}

/// A number as scene files write it.
pub(super) fn number(word: &[u8], place: [u32; 2]) -> Result<f64, Fault> {
    let value = std::str::from_utf8(word).ok().and_then(|text| text.parse::<f64>().ok());
    match value {
        Some(value) if value.is_finite() => Ok(value),
        _ => {
            let text = excerpt(&String::from_utf8_lossy(word));
            Err(Fault::new(place, format!("\"{text}\" is not a number; give one such as 0.5 or 1e-3")))
        }
    }
}
