//! Text that is safe inside HTML and SVG.

use std::borrow::Cow;

/// Replaces the characters that mean something in HTML text and attributes.
pub fn escape(text: &str) -> Cow<'_, str> {
    if !text.contains(['&', '<', '>', '"', '\'']) {
        return Cow::Borrowed(text);
    }
    let mut escaped = String::with_capacity(text.len() + 16);
    for letter in text.chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            other => escaped.push(other),
        }
    }
    Cow::Owned(escaped)
}

/// The reverse of [`escape`].
pub(crate) fn unescape(text: &str) -> String {
    // Ampersands last: an escaped "&lt;" must come back as "&lt;".
    text.replace("&lt;", "<")
        .replace("&gt;", ">")
        .replace("&quot;", "\"")
        .replace("&#39;", "'")
        .replace("&amp;", "&")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escaping_is_undone_exactly() {
        for text in ["", "plain", "a < b && c > 'd' \"e\"", "&lt;", "&amp;lt;", "</script>", "&#39;"] {
            assert_eq!(unescape(&escape(text)), text);
            assert!(!escape(text).contains('<'));
        }
    }
}
