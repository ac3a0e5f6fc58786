//! Colors that readers with any color vision can tell apart, on light and on dark paper.

use super::Dash;

/// A color by role or by value. Roles change with the background, values do not.
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

    /// The `index`th color of the palette, starting over when it is used up.
    pub fn cycle(index: usize) -> Self {
        Self::PALETTE[index % Self::PALETTE.len()]
    }

    /// The colors of the fluorophores of a figure. Those of the catalogue have their own in every figure; others get what
    /// is left, so that no two are alike while there are colors.
    pub fn of_fluorophores<'a>(names: impl IntoIterator<Item = &'a str>) -> Vec<Self> {
        let known = |name: &str| {
            let name = name.to_lowercase();
            FLUOROPHORES.iter().find(|(part, _)| name.contains(part)).map(|(_, ink)| *ink)
        };
        let mut inks: Vec<Option<Self>> = names.into_iter().map(known).collect();
        // A second one of a kind looks for another color, too.
        for index in 1..inks.len() {
            if inks[..index].contains(&inks[index]) {
                inks[index] = None;
            }
        }
        for index in 0..inks.len() {
            if inks[index].is_none() {
                let free = |ink: &&(&str, Self)| !inks.contains(&Some(ink.1));
                inks[index] =
                    Some(FLUOROPHORES.iter().find(free).map_or_else(|| Self::cycle(index), |(_, ink)| *ink));
            }
        }
        inks.into_iter().flatten().collect()
    }

    /// Colors for so many curves beside others whose colors are taken. None is alike another or a taken one while there are colors.
    pub fn besides(taken: &[Self], count: usize) -> Vec<Self> {
        let pink = Self::PALETTE[3];
        let all = [pink, Self::Text].into_iter().chain(Self::PALETTE);
        let mut free: Vec<Self> = Vec::new();
        for ink in all.chain(FLUOROPHORES.map(|(_, ink)| ink)) {
            if !taken.contains(&ink) && !free.contains(&ink) {
                free.push(ink);
            }
        }
        free.into_iter().cycle().take(count).collect()
    }

    /// The stroke pattern that goes with the color of a fluorophore, so that it is the same in every figure, too.
    pub fn fluorophore_dash(self) -> Dash {
        Dash::cycle(FLUOROPHORES.iter().position(|(_, ink)| *ink == self).unwrap_or(0))
    }

    /// The color of a sensor channel: its own for R, G and B, else from the palette.
    pub fn of_channel(name: &str, index: usize) -> Self {
        match name.to_lowercase().as_str() {
            "r" | "red" => Self::Rgb(213, 64, 20),
            "g" | "gr" | "gb" | "green" => Self::Rgb(0, 158, 90),
            "b" | "blue" => Self::Rgb(0, 100, 200),
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

/// The fluorophores of the catalogue, by what their names contain, and the color of each: the palette, and three more that
/// stand apart from it in hue or lightness. Its pink is left for what is not a fluorophore.
const FLUOROPHORES: [(&str, Ink); 11] = [
    ("collagen", Ink::PALETTE[0]),
    ("elastin", Ink::PALETTE[5]),
    ("fad", Ink::PALETTE[2]),
    ("nad", Ink::PALETTE[4]),
    ("porphyrin", Ink::PALETTE[1]),
    ("keratin", Ink::Rgb(120, 94, 200)),
    ("dentin", Ink::Rgb(150, 95, 60)),
    ("enamel", Ink::Rgb(128, 134, 142)),
    ("chlorophyll", Ink::Rgb(110, 140, 20)),
    ("lipopigment", Ink::Rgb(205, 120, 20)),
    ("flavin", Ink::Rgb(170, 130, 0)),
];

/// A sequence of colors for the values of a heat map, from low to high.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorMap {
    /// Dark violet over teal to yellow: even steps in lightness, readable with any color vision.
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
    /// Color of a value between 0 and 1; values outside take the color of the nearer end.
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
    fn a_fluorophore_keeps_its_color_whatever_its_place() {
        let alone = |name| Ink::of_fluorophores([name])[0];
        assert_eq!(alone("Porphyrins"), Ink::of_fluorophores(["FAD", "NADH", "porphyrin_monici"])[2]);
        assert_ne!(alone("FAD"), alone("NADH"));
    }

    #[test]
    fn curves_beside_fluorophores_have_other_colors() {
        let taken = Ink::of_fluorophores(["Collagen I", "Elastin", "FAD", "NADH", "Porphyrin"]);
        let lights = Ink::besides(&taken, 4);
        for (index, ink) in lights.iter().enumerate() {
            assert!(!taken.contains(ink) && !lights[..index].contains(ink), "{index}");
        }
        assert_eq!(Ink::besides(&taken, 40).len(), 40);
    }

    #[test]
    fn no_two_fluorophores_of_a_figure_have_one_color() {
        let titles = [
            "Collagen I",
            "Elastin",
            "FAD",
            "Keratin (visible band)",
            "Protoporphyrin IX",
            "Dentin",
            "Enamel",
        ];
        // Of the catalogue, unknown ones among them, and two of one kind.
        for extra in [vec![], vec!["dye"], vec!["dye", "other dye"], vec!["collagen 4", "dye"]] {
            let inks = Ink::of_fluorophores(titles.into_iter().chain(extra.iter().copied()));
            assert_eq!(inks.len(), titles.len() + extra.len());
            for (index, ink) in inks.iter().enumerate() {
                assert!(!inks[..index].contains(ink), "{extra:?} {index}");
                // That of reflected light and of ellipses.
                assert_ne!(*ink, Ink::PALETTE[3]);
            }
        }
        let many: Vec<String> = (0..30).map(|i| format!("dye {i}")).collect();
        assert_eq!(Ink::of_fluorophores(many.iter().map(String::as_str)).len(), 30);
    }
}
