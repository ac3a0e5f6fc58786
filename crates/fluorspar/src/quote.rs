//! Quotes from files and of what was typed, fit for a message.

use std::fmt::Write;

/// Characters of a quote, marks of the cut included.
const LONGEST: usize = 60;

/// The beginning of a text, at most 60 characters: ends of lines and other control characters are written as escapes, so that
/// a message stays on its line and does not steer the terminal that shows it; what is cut is marked with `...`.
///
/// Every cell, name and value of a file that a message repeats passes through here: a file may hold megabytes without a
/// separator.
pub fn excerpt(text: &str) -> String {
    excerpt_to(text, LONGEST)
}

/// The same with at most `longest` characters, for paths: they are recognized by their ends.
pub fn excerpt_to(text: &str, longest: usize) -> String {
    let mut quote = String::new();
    // Bytes of the quote where it is cut, if it must be.
    let (mut count, mut cut) = (0, 0);
    for character in text.chars() {
        let before = quote.len();
        let escapes = character.is_control();
        if escapes {
            // Writing to a string can't fail.
            let _ = write!(quote, "{}", character.escape_debug());
        } else {
            quote.push(character);
        }
        count += if escapes { quote.len() - before } else { 1 };
        if count + 3 <= longest {
            cut = quote.len();
        }
        if count > longest {
            quote.truncate(cut);
            quote.push_str("...");
            break;
        }
    }
    quote
}

/// A word as a shell takes it.
#[must_use]
pub fn shell_word(text: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "._/=+-:,@".contains(c);
    match !text.is_empty() && text.chars().all(is_plain) {
        true => text.into(),
        false => format!("'{}'", text.replace('\'', "'\\''")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_texts_stay_and_long_ones_are_cut_and_marked() {
        assert_eq!(excerpt("Größe 3 µm"), "Größe 3 µm");
        let sixty = "x".repeat(60);
        assert_eq!(excerpt(&sixty), sixty);
        assert_eq!(excerpt(&"ü".repeat(61)), "ü".repeat(57) + "...");
        assert_eq!(excerpt_to("abcdef", 5), "ab...");
    }

    #[test]
    fn control_characters_are_escaped_and_counted() {
        assert_eq!(excerpt("a\n\u{1b}[31mb\t\u{9b}\0"), "a\\n\\u{1b}[31mb\\t\\u{9b}\\0");
        let long = excerpt(&"\u{1b}".repeat(1000));
        assert!(long.len() <= 60 && long.ends_with("}..."), "{long}");
    }
}
