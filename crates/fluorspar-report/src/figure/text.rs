//! How wide a text is, so that a layout can leave room for it.

/// Advance widths of DejaVu Sans, thousandths of the font size, U+0020 to U+007E.
#[rustfmt::skip]
const ADVANCE: [u16; 95] = [
    318, 401, 460, 838, 636, 950, 780, 275, 390, 390, 500, 838, 318, 361, 318, 337, 636, 636, 636, 636, 636, 636, 636,
    636, 636, 636, 337, 337, 838, 838, 838, 531, 1000, 684, 686, 698, 770, 632, 575, 775, 752, 295, 295, 656, 557, 863,
    748, 787, 603, 787, 695, 635, 611, 732, 684, 989, 685, 611, 685, 390, 337, 390, 838, 500, 500, 613, 635, 550, 635,
    615, 352, 635, 634, 278, 278, 579, 278, 974, 634, 612, 635, 635, 411, 521, 392, 634, 592, 818, 592, 592, 525, 636,
    337, 636, 838,
];

/// Width of a text in DejaVu Sans, px. It is among the widest of the usual fonts: what fits it fits the others.
pub(super) fn width(text: &str, size: f64) -> f64 {
    let advance = |letter: char| match letter {
        ' '..='~' => f64::from(ADVANCE[letter as usize - 32]),
        '\u{2070}'..='\u{2079}' | '\u{b2}' | '\u{b3}' | '\u{b9}' => 401.0,
        '\u{2212}' | '\u{d7}' => 838.0,
        _ => 640.0,
    };
    text.chars().map(advance).sum::<f64>() * size / 1000.0
}

#[cfg(test)]
mod tests {
    #[test]
    fn widths_add_up() {
        assert!((super::width("10", 10.0) - 12.72).abs() < 1e-9);
        assert_eq!(super::width("", 10.0), 0.0);
    }
}
