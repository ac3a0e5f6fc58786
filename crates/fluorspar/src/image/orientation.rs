//! How a frame is turned from the order in which its sensor was read out to the order in which viewers show it.

use serde::{Deserialize, Serialize};

/// One of the eight ways to turn and mirror an image, as the TIFF tag Orientation counts them (TIFF 6.0, section 8).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Orientation {
    /// Whether rows as stored are columns as shown.
    is_transposed: bool,
    /// Whether stored rows begin at the far side.
    rows_reversed: bool,
    /// Whether stored columns begin at the far side.
    columns_reversed: bool,
}

impl Orientation {
    /// That of a value of the tag, 1 to 8; `None` of others.
    #[must_use]
    pub fn of_tag(tag: u64) -> Option<Self> {
        let [is_transposed, rows_reversed, columns_reversed] = match tag {
            1 => [false, false, false],
            2 => [false, false, true],
            3 => [false, true, true],
            4 => [false, true, false],
            5 => [true, false, false],
            6 => [true, true, false],
            7 => [true, true, true],
            8 => [true, false, true],
            _ => return None,
        };
        Some(Self { is_transposed, rows_reversed, columns_reversed })
    }

    /// Whether an image is shown as it is stored.
    #[must_use]
    pub fn is_upright(self) -> bool {
        self == Self::default()
    }

    /// Whether left and right are exchanged: no turn alone makes it upright.
    #[must_use]
    pub fn is_mirrored(self) -> bool {
        self.is_transposed ^ self.rows_reversed ^ self.columns_reversed
    }

    /// What is done to the stored image, in words; empty where nothing is.
    #[must_use]
    pub fn words(self) -> &'static str {
        match (self.is_transposed, self.rows_reversed, self.columns_reversed) {
            (false, false, false) => "",
            (false, false, true) => "mirrored left to right",
            (false, true, true) => "turned by 180 degrees",
            (false, true, false) => "mirrored top to bottom",
            (true, false, false) => "mirrored along the diagonal from the upper left",
            (true, true, false) => "turned by 90 degrees clockwise",
            (true, true, true) => "mirrored along the diagonal from the upper right",
            (true, false, true) => "turned by 90 degrees counterclockwise",
        }
    }

    /// Columns and rows as shown of those stored; the same way back.
    #[must_use]
    pub fn size([width, height]: [usize; 2], turned: Self) -> [usize; 2] {
        if turned.is_transposed { [height, width] } else { [width, height] }
    }

    /// Row and column where a pixel of the shown image is stored, in an image of `size` columns and rows as stored.
    #[must_use]
    pub fn stored(self, [width, height]: [usize; 2], [row, col]: [usize; 2]) -> [usize; 2] {
        let [row, col] = if self.is_transposed { [col, row] } else { [row, col] };
        [
            if self.rows_reversed { height - 1 - row } else { row },
            if self.columns_reversed { width - 1 - col } else { col },
        ]
    }

    /// Row and column where a stored pixel is shown.
    #[must_use]
    pub fn shown(self, [width, height]: [usize; 2], [row, col]: [usize; 2]) -> [usize; 2] {
        let row = if self.rows_reversed { height - 1 - row } else { row };
        let col = if self.columns_reversed { width - 1 - col } else { col };
        if self.is_transposed { [col, row] } else { [row, col] }
    }

    /// Values as shown of values as stored, `[row, col, sample]`; `size` is that as stored.
    #[must_use]
    pub fn turn<T: Copy>(self, size: [usize; 2], values: &[T]) -> Vec<T> {
        let [width, height] = Self::size(size, self);
        gathered([width, height], size[0], values, |place| self.stored(size, place))
    }

    /// Values as stored of values as shown; `size` is that as stored.
    #[must_use]
    pub fn turn_back<T: Copy>(self, size: [usize; 2], values: &[T]) -> Vec<T> {
        gathered(size, Self::size(size, self)[0], values, |place| self.shown(size, place))
    }
}

/// The values of an image of `size`, each from its place in another one of `width` columns.
fn gathered<T: Copy>(
    size: [usize; 2],
    width: usize,
    values: &[T],
    place: impl Fn([usize; 2]) -> [usize; 2],
) -> Vec<T> {
    let samples = values.len() / (size[0] * size[1]).max(1);
    let mut out = Vec::with_capacity(values.len());
    for row in 0..size[1] {
        for col in 0..size[0] {
            let [row, col] = place([row, col]);
            let at = (row * width + col) * samples;
            out.extend_from_slice(&values[at..at + samples]);
        }
    }
    out
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "these are tests")]
mod tests {
    use super::*;

    /// Where TIFF 6.0 puts the first stored row and the first stored column, of an image of 3 columns and 2 rows.
    #[test]
    fn eight_orientations_are_those_of_tiff() {
        let stored = ['a', 'b', 'c', 'd', 'e', 'f'];
        let shown = ["abcdef", "cbafed", "fedcba", "defabc", "adbecf", "daebfc", "fcebda", "cfbead"];
        for (tag, wanted) in (1u64..).zip(shown) {
            let orientation = Orientation::of_tag(tag).unwrap();
            let turned = orientation.turn([3, 2], &stored);
            assert_eq!(turned.iter().collect::<String>(), wanted, "{tag}");
            assert_eq!(orientation.turn_back([3, 2], &turned), stored, "{tag}");
            assert_eq!(Orientation::size([3, 2], orientation), if tag > 4 { [2, 3] } else { [3, 2] });
            assert_eq!(orientation.words().is_empty(), tag == 1);
        }
        assert!(Orientation::of_tag(0).is_none() && Orientation::of_tag(9).is_none());
    }
}
