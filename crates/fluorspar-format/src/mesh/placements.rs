//! Lists of places: affine maps, twelve numbers each.

use fluorspar::quote::excerpt;
use std::path::Path;

use glam::{Affine3, Mat3, Vec3};

use crate::FormatError;
use crate::npy_array::read_npy;
use crate::store::file::{MAX_TEXT_BYTES, as_text, read_file};

/// Numbers of a place: three rows of four.
const NUMBERS: usize = 12;

/// Reads affine maps, one per line of a text file or row of a NumPy array.
///
/// A place is a matrix of three rows and four columns, row by row: the columns are what becomes of the x, y and z axes,
/// and the displacement in units of `unit_m`, m. A text file (`.csv`, `.txt`) has twelve numbers a line, separated by
/// commas, semicolons, tabs or spaces; lines that begin with `#` are comments, and one line of names may come first. An array
/// (`.npy`) holds f32 or f64 of shape `[n, 12]`, `[n, 3, 4]` or `[n, 4, 4]` with last rows 0, 0, 0, 1.
///
/// # Errors
/// Other files, lines of other lengths, numbers that are not finite; each with its place.
pub fn read_placements(path: &Path, unit_m: f64) -> Result<Vec<Affine3>, FormatError> {
    let lower = path.to_string_lossy().to_lowercase();
    let (places, line_of) = if lower.ends_with(".npy") {
        (from_array(path)?, None)
    } else if [".csv", ".txt", ".tsv"].iter().any(|ending| lower.ends_with(ending)) {
        let bytes = read_file(path, MAX_TEXT_BYTES)?;
        let (places, lines) = from_text(path, as_text(path, &bytes)?)?;
        (places, Some(lines))
    } else {
        return Err(FormatError::unsupported(
            path,
            "not a list of placements",
            "Name a .csv, .txt or .npy file with twelve numbers a place",
        ));
    };
    let mut maps = Vec::with_capacity(places.len());
    for (number, m) in places.iter().enumerate() {
        if !m.iter().all(|x| x.is_finite()) {
            let what = format!("place {number} (counted from 0) holds a number that is not finite");
            let hint = "Give twelve finite numbers";
            return Err(match line_of.as_ref().and_then(|lines| lines.get(number)) {
                Some(&line) => FormatError::at_line(path, line, what, hint),
                None => FormatError::malformed(path, what, hint),
            });
        }
        maps.push(affine_map(m, unit_m));
    }
    Ok(maps)
}

/// The map of twelve numbers, its displacement in a unit.
fn affine_map(m: &[f32; NUMBERS], unit_m: f64) -> Affine3 {
    let row = |r: usize| Vec3::new(m[4 * r], m[4 * r + 1], m[4 * r + 2]);
    let displacement = [m[3], m[7], m[11]].map(|x| (f64::from(x) * unit_m) as f32);
    let matrix3 = Mat3::from_cols(row(0), row(1), row(2)).transpose();
    Affine3 { matrix3, translation: displacement.into() }
}

/// Placements and their lines, from 1.
type Lines = (Vec<[f32; NUMBERS]>, Vec<u64>);

fn from_text(path: &Path, text: &str) -> Result<Lines, FormatError> {
    const HINT: &str = "Give every line the three rows of a matrix: xx, xy, xz, displacement x, yx, ...";
    let (mut places, mut lines) = (Vec::new(), Vec::new());
    let mut names_seen = false;
    for (index, text) in text.lines().enumerate() {
        let line = index as u64 + 1;
        let text = text.trim();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let cells = || text.split([',', ';', '\t', ' ']).map(str::trim).filter(|cell| !cell.is_empty());
        let mut place = [0.0; NUMBERS];
        let mut count = 0;
        for cell in cells() {
            let Ok(value) = cell.parse::<f32>() else {
                if places.is_empty() && !names_seen && cells().all(|cell| cell.parse::<f32>().is_err()) {
                    names_seen = true;
                    count = 0;
                    break;
                }
                return Err(FormatError::at_line(
                    path,
                    line,
                    format!("\"{}\" is not a number", excerpt(cell)),
                    HINT,
                ));
            };
            if let Some(slot) = place.get_mut(count) {
                *slot = value;
            }
            count += 1;
        }
        match count {
            0 => {}
            NUMBERS => {
                places.push(place);
                lines.push(line);
            }
            _ => {
                let what = format!("a place has {NUMBERS} numbers; this line has {count}");
                return Err(FormatError::at_line(path, line, what, HINT));
            }
        }
    }
    if places.is_empty() {
        return Err(FormatError::malformed(path, "the file holds no placements", HINT));
    }
    Ok((places, lines))
}

fn from_array(path: &Path) -> Result<Vec<[f32; NUMBERS]>, FormatError> {
    let (shape, values) = read_npy(path)?;
    let per_place = match shape[..] {
        [_, 12] | [_, 3, 4] => NUMBERS,
        [_, 4, 4] => 16,
        _ => {
            return Err(FormatError::unsupported(
                path,
                format!("an array of shape {shape:?} is not a list of placements"),
                "Save an array of shape (n, 12), (n, 3, 4) or (n, 4, 4)",
            ));
        }
    };
    let mut places = Vec::with_capacity(values.len() / per_place);
    for (number, place) in values.chunks_exact(per_place).enumerate() {
        if per_place == 16 && place[12..] != [0.0, 0.0, 0.0, 1.0] {
            let row = &place[12..];
            let what = format!("the last row of place {number} (counted from 0) is {row:?}, not 0, 0, 0, 1");
            return Err(FormatError::malformed(path, what, "Give affine maps"));
        }
        let mut numbers = [0.0; NUMBERS];
        numbers.copy_from_slice(&place[..NUMBERS]);
        places.push(numbers);
    }
    if places.is_empty() {
        return Err(FormatError::malformed(path, "the file holds no placements", "Give at least one"));
    }
    Ok(places)
}
