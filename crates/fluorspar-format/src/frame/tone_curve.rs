//! Tone curves that image files declare: transfer functions of TIFF, and profiles of the International Color Consortium (ICC.1:2022).

use std::path::Path;

use crate::FormatError;

/// Largest part of the range by which a straight curve may miss the line from 0 to 1.
const STRAIGHT: f64 = 0.01;

/// Refuses numbers that are not proportional to light, by what says so.
pub(crate) fn tone_curve_error(path: &Path, told_by: &str) -> FormatError {
    let what =
        format!("its numbers lie on a tone curve ({told_by}), so that they are not proportional to light");
    let hint = "Give the raw frame, or export it linear (gamma 1); of Fluorspar's own files, give raw_NAME";
    FormatError::unsupported(path, what, hint)
}

/// Whether a table of 16-bit numbers, evenly spaced from 0 to 1, is no straight line.
pub(crate) fn is_bent(table: &[u64]) -> bool {
    let last = (table.len().max(2) - 1) as f64;
    let missed = |(at, value): (usize, &u64)| (*value as f64 / 65_535.0 - at as f64 / last).abs();
    table.iter().enumerate().map(missed).any(|missed| missed > STRAIGHT)
}

fn whole(bytes: &[u8], at: usize, length: usize) -> Option<u64> {
    let bytes = bytes.get(at..at.checked_add(length)?)?;
    Some(bytes.iter().fold(0, |value, byte| value << 8 | u64::from(*byte)))
}

/// Whether a color profile has a curve other than a straight one, or tables in which one may hide. What is no profile tells nothing.
pub(crate) fn profile_is_curved(profile: &[u8]) -> bool {
    let entries = whole(profile, 128, 4).unwrap_or(0).min(100) as usize;
    let entry = |index: usize| {
        let entry = profile.get(132 + 12 * index..144 + 12 * index)?;
        Some((&entry[..4], usize::try_from(whole(entry, 4, 4)?).ok()?))
    };
    let tags: Vec<(&[u8], usize)> = (0..entries).filter_map(entry).collect();
    let mut curves = tags.iter().filter(|(name, _)| name.ends_with(b"TRC")).peekable();
    if curves.peek().is_none() {
        return tags.iter().any(|(name, _)| name.starts_with(b"A2B"));
    }
    curves.any(|(_, at)| is_straight_curve(profile, *at) != Some(true))
}

/// Whether the curve at a place of a profile is straight: `curv` of no number, of the gamma 1 or of a line, `para` of the gamma 1.
fn is_straight_curve(profile: &[u8], at: usize) -> Option<bool> {
    let curve = profile.get(at..)?;
    let one = |gamma: u64, one: f64| (gamma as f64 / one - 1.0).abs() <= STRAIGHT;
    match curve.get(..4)? {
        b"para" => Some(one(whole(curve, 12, 4)?, 65_536.0)),
        b"curv" => match whole(curve, 8, 4)? as usize {
            0 => Some(true),
            1 => Some(one(whole(curve, 12, 2)?, 256.0)),
            count => {
                let table = curve.get(12..12 + count.checked_mul(2)?)?.as_chunks::<2>().0;
                let table: Vec<u64> = table.iter().map(|pair| u64::from(u16::from_be_bytes(*pair))).collect();
                Some(!is_bent(&table))
            }
        },
        _ => None,
    }
}
