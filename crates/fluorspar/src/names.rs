//! Names that nothing has: one measure of likeness, and one way to suggest what was meant.

use crate::quote::excerpt;

/// Longest name for which a similar one is looked for, bytes.
const LONGEST: usize = 200;

/// Shortest name, bytes, that counts as meant where another one contains it: shorter ones are in any word.
const SHORTEST: usize = 3;

/// The candidate most similar to a name that was not found; `None` where nothing is similar.
///
/// Similar means a Damerau-Levenshtein distance of at most two, or of a third of the letters, or that one name contains
/// the other, if that has at least three letters. Capitals do not count, and `-`, ` ` and `_` are the same.
pub fn nearest_name<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let plain = |text: &str| text.to_lowercase().replace(['-', ' '], "_");
    // No name is that long; the distance takes time in proportion to both lengths.
    if name.len() > LONGEST {
        return None;
    }
    let wanted = plain(name);
    let allowed = (wanted.chars().count() / 3).max(2);
    candidates
        .into_iter()
        .filter_map(|candidate| {
            let other = plain(candidate);
            let distance = strsim::damerau_levenshtein(&wanted, &other);
            let contained = wanted.len().min(other.len()) >= SHORTEST
                && (other.contains(&wanted) || wanted.contains(&other));
            let close = distance <= allowed && distance < other.chars().count();
            (close || contained).then_some((distance, candidate))
        })
        // Of names that are as similar, the one whose number is next: led_386 means led_385, not led_380.
        .min_by_key(|(distance, candidate)| (*distance, number(candidate).abs_diff(number(&wanted))))
        .map(|(_, candidate)| candidate)
}

/// The last digits of a name as a number; 0 where it has none.
fn number(name: &str) -> u64 {
    let digits = |part: &&str| !part.is_empty();
    let last = name.split(|c: char| !c.is_ascii_digit()).rfind(digits);
    last.and_then(|digits| digits.parse().ok()).unwrap_or(0)
}

/// The end of a sentence about a name that was not found: `; did you mean "led_385"?`, or a full stop where no candidate
/// is similar.
pub fn did_you_mean<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> String {
    suggestion(nearest_name(name, candidates))
}

/// The same for a suggestion that is known already.
pub fn suggestion(nearest: Option<&str>) -> String {
    nearest.map_or_else(|| ".".into(), |name| format!("; did you mean \"{}\"?", excerpt(name)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_similar_is_not_guessed() {
        assert_eq!(nearest_name("xenon", ["led_385", "halogen"]), None);
        assert_eq!(nearest_name("powr_mw", ["power_mw", "count"]), Some("power_mw"));
        assert_eq!(did_you_mean("Tounge", ["tongue", "palate"]), "; did you mean \"tongue\"?");
        assert_eq!(did_you_mean("xenon", ["led_385"]), ".");
        // A name of one letter is in any word
        assert_eq!(nearest_name("kept", ["minimax", "d", "a", "e", "contrast", "leak"]), None);
        assert_eq!(nearest_name("leakage", ["d", "a", "e", "leak"]), Some("leak"));
    }

    #[test]
    fn of_names_with_numbers_the_next_is_meant() {
        assert_eq!(nearest_name("led_386", ["led_380", "led_385", "led_396"]), Some("led_385"));
        assert_eq!(nearest_name("long_pass_476", ["long_pass_470", "long_pass_475"]), Some("long_pass_475"));
    }
}
