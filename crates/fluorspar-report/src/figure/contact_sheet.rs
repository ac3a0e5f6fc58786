//! Pictures side by side, each with its name above it.

use super::canvas::{Canvas, FigureError};
use super::drawing::{Anchor, Mark};
use super::{Ink, Raster, font};

/// Height of the strip with a name and size of its letters, px.
const STRIP: usize = 20;
const LETTERS: f64 = 13.0;
const LEAST_LETTERS: f64 = 9.0;
/// Between neighbors, px.
const GAP: usize = 4;
const GROUND: [u8; 3] = [16; 3];
const LETTER_INK: Ink = Ink::Rgb(225, 225, 225);

/// Layout of the images of a contact sheet: in rows that fill the width of the sheet.
///
/// Rows hold equally many pictures, the first ones one more where the number does not divide. A row with fewer of them has
/// larger ones, so that no cell stays empty.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ContactSheet {
    width: usize,
    height: usize,
    /// Left, top, width and height of every picture.
    cells: Vec<[usize; 4]>,
}

impl ContactSheet {
    /// A layout for so many pictures, a third wider than high, of this width in the fullest row, px.
    ///
    /// ```
    /// let sheet = fluorspar_report::ContactSheet::new(13, 240);
    /// // Five pictures above two rows of four larger ones.
    /// assert_eq!(sheet.picture_sizes()[..6], [[240, 180], [240, 180], [240, 180], [240, 180], [240, 180], [301, 225]]);
    /// ```
    pub fn new(count: usize, picture_width: usize) -> Self {
        let count = count.max(1);
        // A sheet about as wide as high, but for the shape of its pictures.
        let columns = (1..=count).find(|n| 3 * n * n >= 4 * count).unwrap_or(count);
        let rows = count.div_ceil(columns);
        let in_row = |row: usize| count / rows + usize::from(row < count % rows);
        let width = in_row(0) * (picture_width + GAP) - GAP;
        let mut cells = Vec::with_capacity(count);
        let mut top = 0;
        for row in 0..rows {
            let n = in_row(row);
            let room = width - (n - 1) * GAP;
            let height = room / n * 3 / 4;
            for i in 0..n {
                // What is left of the division goes to the first ones.
                let size = room / n + usize::from(i < room % n);
                let left = i * (room / n) + i.min(room % n) + i * GAP;
                cells.push([left, top + STRIP, size, height]);
            }
            top += STRIP + height + GAP;
        }
        Self { width, height: top - GAP, cells }
    }

    /// Width and height of every picture, px.
    pub fn picture_sizes(&self) -> Vec<[usize; 2]> {
        self.cells.iter().map(|cell| [cell[2], cell[3]]).collect()
    }

    /// The sheet with its pictures and their names.
    ///
    /// # Errors
    /// Pictures that are not as many or not of the sizes that [`Self::picture_sizes`] says; a sheet that is too large.
    pub fn compose(&self, pictures: &[(&str, Raster)]) -> Result<Raster, FigureError> {
        let sizes: Vec<[usize; 2]> =
            pictures.iter().map(|(_, picture)| [picture.width, picture.height]).collect();
        if sizes != self.picture_sizes() {
            let wanted = self.picture_sizes();
            return Err(FigureError::new(format!(
                "pictures of {sizes:?} px for a contact sheet of {wanted:?} px"
            )));
        }
        let [r, g, b] = GROUND;
        let mut canvas = Canvas::new(self.width as f64, self.height as f64, 1.0, Ink::Rgb(r, g, b))?;
        for ((name, _), [left, top, width, _]) in pictures.iter().zip(&self.cells) {
            canvas.draw(&title(name, [*left as f64, *top as f64, *width as f64]));
        }
        let mut sheet = canvas.into_raster();
        for ((_, picture), [left, top, width, height]) in pictures.iter().zip(&self.cells) {
            for row in 0..*height {
                let to = (top + row) * sheet.width + left;
                sheet.pixels[to..to + width].copy_from_slice(&picture.pixels[row * width..(row + 1) * width]);
            }
        }
        Ok(sheet)
    }
}

/// The name above a picture, in letters as large as the picture is wide enough for.
fn title(name: &str, [left, top, width]: [f64; 3]) -> Mark {
    let room = width - 8.0;
    let size = |text: &str| LETTERS * room / font::width(text, LETTERS).max(1.0);
    // Of a name that is too long for readable letters the end of its first part goes, not the number behind it
    let (word, number) = match name.rfind(" (") {
        Some(at) => name.split_at(at),
        None => (name, ""),
    };
    let mut text = name.to_owned();
    for kept in (0..word.chars().count()).rev() {
        if size(&text) >= LEAST_LETTERS {
            break;
        }
        text = word.chars().take(kept).chain("..".chars()).chain(number.chars()).collect();
    }
    Mark::Text {
        at: [left + 0.5 * width, top - 6.0],
        size: size(&text).clamp(5.0, LETTERS) as u32,
        text,
        anchor: Anchor::Middle,
        ink: LETTER_INK,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_fill_the_sheet_without_gaps_or_overlaps() {
        for count in 1..40 {
            for width in [64, 101, 240] {
                let sheet = ContactSheet::new(count, width);
                assert_eq!(sheet.cells.len(), count);
                let mut rows: Vec<&[[usize; 4]]> = sheet.cells.chunk_by(|a, b| a[1] == b[1]).collect();
                for row in &rows {
                    assert_eq!(row[0][0], 0);
                    assert!(row.windows(2).all(|pair| pair[0][0] + pair[0][2] + GAP == pair[1][0]));
                    let last = row[row.len() - 1];
                    assert_eq!(last[0] + last[2], sheet.width, "{count} pictures of {width} px");
                    assert!(row.iter().all(|cell| cell[2] >= width));
                }
                rows.dedup_by_key(|row| row.len());
                assert!(rows.len() <= 2, "rows of more than two lengths: {count}");
            }
        }
    }

    #[test]
    fn long_names_are_shortened_and_keep_their_numbers() {
        let text = |name: &str, width: f64| match title(name, [0.0, 20.0, width]) {
            Mark::Text { text, size, .. } => {
                assert!(font::width(&text, f64::from(size)) <= width, "{text}");
                text
            }
            _ => String::new(),
        };
        assert_eq!(text("elastin (64 %)", 320.0), "elastin (64 %)");
        let short = text("protoporphyrin_ix_in_tissue (100 %)", 100.0);
        assert!(short.starts_with("proto") && short.ends_with(".. (100 %)"), "{short}");
    }

    #[test]
    fn names_stand_above_their_pictures() {
        let sheet = ContactSheet::new(2, 120);
        let picture = |gray: u8| Raster::from_fn(120, 90, |_, _| [gray; 3]);
        let made = sheet.compose(&[("left-cheek", picture(100)), ("", picture(200))]).unwrap();
        assert_eq!([made.width, made.height], [244, 110]);
        assert_eq!((made.at(20, 0), made.at(109, 243)), ([100; 3], [200; 3]));
        assert_eq!(made.at(60, 122), GROUND);
        let lit = |from: usize, to: usize| {
            (0..STRIP)
                .flat_map(|row| (from..to).map(move |col| (row, col)))
                .filter(|&(r, c)| made.at(r, c)[1] > 120)
                .count()
        };
        assert!(lit(0, 120) > 80, "{} pixels of letters", lit(0, 120));
        assert_eq!(lit(124, 244), 0);
        assert!(sheet.compose(&[("one", picture(1))]).is_err());
    }
}
