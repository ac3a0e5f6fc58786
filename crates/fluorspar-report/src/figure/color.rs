//! Colours that readers with any colour vision can tell apart, on light and on dark paper.

/// A colour by role or by value. Roles change with the background, values do not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ink {
    /// Text, axes and data drawn in black.
    Text,
    /// Secondary text and shading.
    Muted,
    /// Grid lines.
    Grid,
    /// The background.
    Paper,
    /// Red, green, blue.
    Rgb(u8, u8, u8),
}

impl Ink {
    /// Okabe and Ito's palette without its yellow and black, which vanish on white and on black; darker first.
    pub const PALETTE: [Self; 6] = [
        Self::Rgb(0, 114, 178),
        Self::Rgb(213, 94, 0),
        Self::Rgb(0, 158, 115),
        Self::Rgb(204, 121, 167),
        Self::Rgb(230, 159, 0),
        Self::Rgb(86, 180, 233),
    ];

    /// The `index`th colour of the palette, starting over when it is used up.
    pub fn cycle(index: usize) -> Self {
        Self::PALETTE[index % Self::PALETTE.len()]
    }

    /// The colour that a fluorophore has in every figure: by its known name, else by its place in the list.
    pub fn of_fluorophore(name: &str, index: usize) -> Self {
        let name = name.to_lowercase();
        let known = FLUOROPHORES.iter().find(|(known, _)| name.contains(known));
        known.map_or_else(|| Self::cycle(index), |(_, place)| Self::PALETTE[*place])
    }

    /// The colour of a sensor channel: its own for R, G and B, else from the palette.
    pub fn of_channel(name: &str, index: usize) -> Self {
        match name.to_lowercase().chars().next() {
            Some('r') => Self::Rgb(213, 64, 20),
            Some('g') => Self::Rgb(0, 158, 90),
            Some('b') => Self::Rgb(0, 100, 200),
            _ => Self::cycle(index),
        }
    }

    /// Red, green, blue on white paper.
    pub fn rgb(self) -> [u8; 3] {
        match self {
            Self::Text => [31, 35, 40],
            Self::Muted => [92, 99, 108],
            Self::Grid => [226, 229, 233],
            Self::Paper => [255, 255, 255],
            Self::Rgb(r, g, b) => [r, g, b],
        }
    }

    /// CSS class that lets a page restyle the role.
    pub(crate) fn class(self) -> Option<&'static str> {
        match self {
            Self::Text => Some("ink"),
            Self::Muted => Some("muted"),
            Self::Grid => Some("grid"),
            Self::Paper => Some("paper"),
            Self::Rgb(..) => None,
        }
    }
}

/// The five fluorophores of the paper, by what their names contain, and the palette colour of each.
const FLUOROPHORES: [(&str, usize); 5] =
    [("collagen", 0), ("elastin", 5), ("fad", 2), ("nad", 4), ("porphyrin", 1)];

/// A sequence of colours for the values of a heat map, from low to high.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorMap {
    /// Dark violet over teal to yellow: even steps in lightness, readable with any colour vision.
    Viridis,
    /// Black to white.
    Gray,
}

/// Viridis (Smith and van der Walt 2015, CC0) at 20 even steps.
const VIRIDIS: [[u8; 3]; 20] = [
    [68, 1, 84],
    [72, 21, 103],
    [72, 38, 119],
    [69, 55, 129],
    [64, 71, 136],
    [57, 86, 140],
    [51, 99, 141],
    [45, 112, 142],
    [40, 125, 142],
    [35, 138, 141],
    [31, 150, 139],
    [32, 163, 135],
    [41, 175, 127],
    [60, 187, 117],
    [85, 198, 103],
    [115, 208, 85],
    [149, 216, 64],
    [184, 222, 41],
    [220, 227, 25],
    [253, 231, 37],
];

impl ColorMap {
    /// Colour of a value between 0 and 1; values outside take the colour of the nearer end.
    pub fn color(self, value: f64) -> [u8; 3] {
        let value = if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) };
        match self {
            Self::Gray => [(255.0 * value).round() as u8; 3],
            Self::Viridis => {
                let at = value * (VIRIDIS.len() - 1) as f64;
                let below = (at.floor() as usize).min(VIRIDIS.len() - 2);
                let part = at - below as f64;
                std::array::from_fn(|c| {
                    let (low, high) = (f64::from(VIRIDIS[below][c]), f64::from(VIRIDIS[below + 1][c]));
                    (low + part * (high - low)).round() as u8
                })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn viridis_gets_steadily_lighter() {
        let luma = |v: f64| {
            let [r, g, b] = ColorMap::Viridis.color(v).map(f64::from);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        assert!((0..100).all(|i| luma(f64::from(i + 1) / 100.0) > luma(f64::from(i) / 100.0) - 1.0));
        assert_eq!(ColorMap::Viridis.color(7.0), [253, 231, 37]);
        assert_eq!(ColorMap::Viridis.color(f64::NAN), [68, 1, 84]);
    }

    #[test]
    fn a_fluorophore_keeps_its_colour_whatever_its_place() {
        assert_eq!(Ink::of_fluorophore("Porphyrins", 0), Ink::of_fluorophore("porphyrin_monici", 3));
        assert_ne!(Ink::of_fluorophore("FAD", 0), Ink::of_fluorophore("NADH", 0));
    }
}
