//! Which files of a folder are frames of one photograph: by their names, their folders and their tags.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Component, Path, PathBuf};

use fluorspar_format::{description_path, read_described_frame};

use super::table::{PhotographRow, WRONG};
use crate::{Error, Result};

/// Endings of files that may be raw frames.
const FRAMES: [&str; 5] = ["dng", "tif", "tiff", "png", "raw"];
/// Endings of files that a camera writes beside a raw frame, or that must be converted.
const OTHERS: [&str; 12] =
    ["jpg", "jpeg", "heic", "nef", "cr2", "cr3", "arw", "raf", "rw2", "orf", "pef", "srw"];
/// Folders below a folder of photographs.
const DEEPEST: usize = 6;
/// Exposure times of a frame and of its capture differ by no more, relative.
const SAME_EXPOSURE: f64 = 0.02;

/// A capture of the experiment, as frames are told by it.
pub(super) struct KnownCapture {
    pub(super) name: String,
    /// Exposure time, s, where it is a number.
    pub(super) exposure_s: Option<f64>,
}

/// A file that is no frame of a photograph, and why.
pub(super) type LeftOut = (PathBuf, String);

/// All frames of one photograph.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Photograph {
    /// Pseudonym of the person.
    pub patient: String,
    /// Visit of the person.
    pub visit: String,
    /// Capture and file, the analyzed one first.
    pub frames: Vec<(String, PathBuf)>,
    /// Dark frames of the camera.
    pub dark: Vec<PathBuf>,
    /// Frames of even light of the camera.
    pub flat: Vec<PathBuf>,
    /// Name, place and verdict of its regions.
    pub regions: Vec<[String; 3]>,
}

/// Whether a folder holds frames, itself or below.
pub(super) fn holds_photographs(folder: &Path) -> bool {
    !files_below(folder).is_empty()
}

/// Whether a folder holds frames by the names that `run` and `capture` give.
pub(super) fn holds_captures(folder: &Path) -> bool {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).any(|path| {
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        stem(&path).starts_with("raw_") && FRAMES.contains(&ending.as_str())
    })
}

/// Files that may be photographs, in the order of their paths. Pictures and raw files beside a frame of the same name are left to it.
pub(crate) fn files_below(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut open = vec![(folder.to_path_buf(), 0)];
    // Links are followed, into each folder once
    let mut entered = BTreeSet::new();
    while let Some((folder, depth)) = open.pop() {
        if !entered.insert(folder.canonicalize().unwrap_or_else(|_| folder.clone())) {
            continue;
        }
        for entry in fs::read_dir(&folder).into_iter().flatten().flatten() {
            let hidden = entry.file_name().to_string_lossy().starts_with('.');
            match fs::metadata(entry.path()) {
                Ok(kind) if kind.is_dir() && !hidden && depth < DEEPEST => {
                    open.push((entry.path(), depth + 1))
                }
                Ok(kind) if !kind.is_dir() && !hidden => found.push(entry.path()),
                _ => {}
            }
        }
    }
    found.sort();
    frames_among(&found)
}

/// Those of some files that are frames, or may be taken for frames.
fn frames_among(found: &[PathBuf]) -> Vec<PathBuf> {
    let ending =
        |path: &Path| path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let is_frame = |path: &Path| {
        let ending = ending(path);
        FRAMES.contains(&ending.as_str()) && (ending != "raw" || description_path(path).exists())
    };
    let has_frame = |path: &PathBuf| {
        let same = |other: &&PathBuf| is_frame(other) && other.with_extension("") == path.with_extension("");
        found.iter().any(|other| same(&other))
    };
    let is_other = |path: &PathBuf| OTHERS.contains(&ending(path).as_str()) && !has_frame(path);
    found.iter().filter(|path| is_frame(path) || is_other(path)).cloned().collect()
}

/// The place of a word in a text, between characters that are no letters and digits.
fn word_in(text: &str, word: &str) -> Option<usize> {
    let (text, word) = (text.to_lowercase(), word.to_lowercase());
    let is_part = |character: Option<char>| character.is_some_and(char::is_alphanumeric);
    text.match_indices(&word).map(|(at, _)| at).find(|at| {
        !is_part(text[..*at].chars().next_back()) && !is_part(text[at + word.len()..].chars().next())
    })
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// The capture that a file name tells.
fn capture_by_name<'a>(path: &Path, captures: &'a [KnownCapture]) -> Option<&'a str> {
    let stem = stem(path);
    let named = captures.iter().filter(|capture| word_in(&stem, &capture.name).is_some());
    named.map(|capture| capture.name.as_str()).max_by_key(|name| name.len())
}

/// The capture of a frame: by its name, or by what it tells of itself.
pub(super) fn capture_of(path: &Path, captures: &[KnownCapture]) -> Result<String> {
    let by_name = capture_by_name(path, captures).map(str::to_owned);
    by_name.map_or_else(|| capture_by_tags(path, captures), Ok)
}

/// The capture that a frame tells: by its description, its exposure time, or because there is one only.
fn capture_by_tags(path: &Path, captures: &[KnownCapture]) -> Result<String> {
    let frame = read_described_frame(path)?.image;
    let of_label = captures.iter().find(|capture| capture.name == frame.label);
    let is_as_long = |capture: &&KnownCapture| {
        capture.exposure_s.is_some_and(|s| (frame.exposure_s / s - 1.0).abs() < SAME_EXPOSURE)
    };
    let mut of_exposure = captures.iter().filter(is_as_long);
    let by_exposure = of_exposure.next().filter(|_| of_exposure.next().is_none());
    let only = captures.first().filter(|_| captures.len() == 1);
    of_label.or(by_exposure).or(only).map(|capture| capture.name.clone()).ok_or_else(|| {
        let names: Vec<&str> = captures.iter().map(|capture| capture.name.as_str()).collect();
        Error::Input(format!(
            "{}: neither its name nor its exposure time tells which capture it is of; put {} into its name, or write a table \
             photographs.csv with the columns frame and capture",
            path.display(),
            names.join(" or ")
        ))
    })
}

/// Words that people call lights by: where a name has none of its capture, such a word is no part of the person's.
const LIGHTS: [&str; 8] = ["white", "violet", "blue", "uv", "green", "red", "ambient", "fluorescence"];

/// The name of a file without the word of its capture, or that of a light; `None` where it has no such word.
fn rest_of_name(path: &Path, capture: &str) -> Option<String> {
    let stem = stem(path);
    let words = std::iter::once(capture).chain(LIGHTS);
    let (at, word) = words.filter_map(|word| Some((word_in(&stem, word)?, word))).next()?;
    let (before, after) = (&stem[..at], stem.get(at + word.len()..).unwrap_or_default());
    let is_between = |c: char| !c.is_alphanumeric();
    let rest = [before.trim_end_matches(is_between), after.trim_start_matches(is_between)].join("_");
    Some(rest.trim_matches('_').to_owned())
}

/// Person and visit of a file: `sub-` and `ses-` of BIDS anywhere in its path, otherwise the folders around it, otherwise its name.
fn person_of(path: &Path, below: &Path, capture: &str) -> [String; 2] {
    person_told(path, below, capture).unwrap_or_else(|| [stem(path), "1".into()])
}

/// The same where more than a name that says nothing of its capture tells the person.
pub(super) fn person_told(path: &Path, below: &Path, capture: &str) -> Option<[String; 2]> {
    let inner = path.strip_prefix(below).unwrap_or(path);
    let parts: Vec<String> = inner.iter().map(|part| part.to_string_lossy().into_owned()).collect();
    let labelled = |label: &str| {
        let words = parts.iter().flat_map(|part| part.split(['_', '.']));
        words.into_iter().find_map(|word| word.strip_prefix(label)).map(str::to_owned)
    };
    let folders = &parts[..parts.len().saturating_sub(1)];
    let patient = labelled("sub-").or_else(|| folders.first().cloned());
    let visit = labelled("ses-").or_else(|| folders.get(1).cloned());
    let (patient, visit) = match patient {
        Some(patient) => (patient, visit),
        None => {
            let (rest, of_name) = without_visit(&rest_of_name(path, capture)?);
            (rest, visit.or(of_name))
        }
    };
    Some([patient, visit.unwrap_or_else(|| "1".into())])
}

/// A name without the word that says which visit it is of, as `visit2`, `session-2` or `v2` after another word, and what that says.
fn without_visit(name: &str) -> (String, Option<String>) {
    let is_between = |c: char| !c.is_alphanumeric();
    let words = || name.split(is_between).filter(|word| !word.is_empty());
    // Where a word begins, in bytes
    let place = |word: &str| word.as_ptr() as usize - name.as_ptr() as usize;
    for (word, next) in words().zip(words().skip(1).map(Some).chain([None])).skip(1) {
        let lower = word.to_lowercase();
        let number = ["visit", "session", "ses", "v"].iter().find_map(|label| lower.strip_prefix(label));
        let last = match number {
            Some("") => next,
            Some(_) => Some(word),
            None => None,
        };
        let number = number.filter(|number| !number.is_empty()).or(next).unwrap_or_default();
        if let Some(last) = last.filter(|_| number.starts_with(|c: char| c.is_ascii_digit())) {
            let before = name[..place(word)].trim_end_matches(is_between);
            let after = name[place(last) + last.len()..].trim_start_matches(is_between);
            let rest = [before, after].into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>();
            return (rest.join("_"), Some(number.to_owned()));
        }
    }
    (name.into(), None)
}

/// Whether a name begins with known words and has no others but numbers: `dark_blue_2`.
fn tells_nobody(name: &str, known: [&str; 2]) -> bool {
    let words = |text: &str| -> Vec<String> {
        let words = text.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty());
        words.map(str::to_lowercase).collect()
    };
    let known: Vec<String> = known.into_iter().flat_map(words).collect();
    let is_known = |word: &String| known.contains(word);
    let words = words(name);
    let is_number = |word: &String| word.starts_with(|c: char| c.is_ascii_digit());
    words.first().is_some_and(is_known) && words.iter().all(|word| is_known(word) || is_number(word))
}

/// The lines that the files of a folder are by themselves, and the files that are none.
pub(super) fn rows_of_folder(
    folder: &Path,
    captures: &[KnownCapture],
) -> (Vec<PhotographRow>, Vec<PathBuf>, Vec<PathBuf>, Vec<LeftOut>) {
    let (mut rows, mut dark, mut flat, mut left_out) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for path in files_below(folder) {
        let name = stem(&path);
        let by_name = capture_by_name(&path, captures).map(str::to_owned);
        // Unless captures are called so
        let is_of_camera = |word: &str| {
            word_in(&name, word).is_some() && captures.iter().all(|of| word_in(&of.name, word).is_none())
        };
        let of_camera = [("dark", &mut dark), ("flat", &mut flat)];
        if let Some((word, list)) = of_camera.into_iter().find(|(word, _)| is_of_camera(word)) {
            match by_name.filter(|capture| !tells_nobody(&name, [word, capture])) {
                None => list.push(path),
                Some(capture) => {
                    let why = format!(
                        "its name tells a person and a {word} frame of the camera; call it {word}_{capture}, which serves all photographs, or \
                         name it in the column {word} of a table photographs.csv"
                    );
                    left_out.push((path, why));
                }
            }
            continue;
        }
        match by_name.map_or_else(|| capture_by_tags(&path, captures), Ok) {
            Ok(capture) => {
                let [patient, visit] = person_of(&path, folder, &capture);
                rows.push(PhotographRow { patient, visit, capture, frame: path, ..Default::default() });
            }
            Err(error) => left_out.push((path, error.to_string())),
        }
    }
    (rows, dark, flat, left_out)
}

/// Completes the lines of a table by what names and tags tell; files are then as the working folder has them.
pub(super) fn completed(
    rows: Vec<PhotographRow>,
    table: &Path,
    captures: &[KnownCapture],
) -> (Vec<PhotographRow>, Vec<LeftOut>) {
    let folder = table.parent().unwrap_or(Path::new(""));
    let (mut complete, mut left_out) = (Vec::new(), Vec::<LeftOut>::new());
    let mut by_file: BTreeMap<PathBuf, Result<String, String>> = BTreeMap::new();
    for mut row in rows {
        for path in [&mut row.frame, &mut row.dark, &mut row.flat] {
            if !path.as_os_str().is_empty() {
                *path = below(folder, path);
            }
        }
        if row.capture.is_empty() {
            let of_file = by_file.entry(row.frame.clone());
            let of_file = of_file
                .or_insert_with(|| capture_of(&row.frame, captures).map_err(|error| error.to_string()));
            match of_file {
                Ok(capture) => row.capture.clone_from(capture),
                Err(_) if row.verdict == WRONG => continue,
                Err(why) => {
                    left_out.push((row.frame, why.clone()));
                    continue;
                }
            }
        } else if !captures.iter().any(|capture| capture.name == row.capture) {
            let names: Vec<&str> = captures.iter().map(|capture| capture.name.as_str()).collect();
            let why = format!(
                "the experiment has no capture \"{}\"; its captures are {}",
                row.capture,
                names.join(", ")
            );
            left_out.push((row.frame, why));
            continue;
        }
        let [patient, visit] = person_of(&row.frame, folder, &row.capture);
        for (given, found) in [(&mut row.patient, patient), (&mut row.visit, visit)] {
            if given.is_empty() {
                *given = found;
            }
        }
        complete.push(row);
    }
    left_out.dedup();
    (complete, left_out)
}

/// A path below a folder, without `..` where that leads to the same file.
fn below(folder: &Path, path: &Path) -> PathBuf {
    let joined = folder.join(path);
    let mut short = PathBuf::new();
    for part in joined.components() {
        match part {
            Component::ParentDir if short.file_name().is_some() => drop(short.pop()),
            part => short.push(part),
        }
    }
    let is_same =
        short.canonicalize().is_ok_and(|short| joined.canonicalize().is_ok_and(|joined| joined == short));
    if is_same { short } else { joined }
}

/// Joins frames of one person, visit and name to photographs: one for each frame of the analyzed capture.
pub(super) fn photographs_of(rows: &[PhotographRow], analyzed: &str) -> (Vec<Photograph>, Vec<LeftOut>) {
    let (mut found, mut left_out) = (Vec::<Photograph>::new(), Vec::new());
    let mut of_visit: BTreeMap<[&str; 2], Vec<&PhotographRow>> = BTreeMap::new();
    for row in rows {
        of_visit.entry([&row.patient, &row.visit]).or_default().push(row);
    }
    for ([patient, visit], rows) in of_visit {
        let mut mains: Vec<&Path> = Vec::new();
        for row in rows.iter().filter(|row| row.capture == analyzed) {
            if !mains.contains(&row.frame.as_path()) {
                mains.push(&row.frame);
            }
        }
        for main in &mains {
            match frames_of(main, &rows, analyzed) {
                Ok(frames) => found.push(photograph_of([patient, visit], frames, &rows)),
                Err(why) => {
                    left_out.push((main.to_path_buf(), format!("of patient {patient}, visit {visit}, {why}")))
                }
            }
        }
        if mains.is_empty() {
            let why = format!(
                "patient {patient}, visit {visit}: there is no frame of the analyzed capture \"{analyzed}\" beside it"
            );
            left_out.extend(rows.iter().map(|row| (row.frame.clone(), why.clone())));
        }
    }
    (found, left_out)
}

/// The frames of a photograph: its analyzed one, and of each other capture that with the rest of its name, or the only one of the visit.
fn frames_of(main: &Path, rows: &[&PhotographRow], analyzed: &str) -> Result<Vec<(String, PathBuf)>, String> {
    let rest = rest_of_name(main, analyzed);
    let mut frames = vec![(analyzed.to_owned(), main.to_path_buf())];
    for capture in captures_beside(rows, analyzed) {
        let of_capture = rows.iter().filter(|row| row.capture == capture);
        let mut files: Vec<&Path> = of_capture.map(|row| row.frame.as_path()).collect();
        files.dedup();
        let of_name = files.iter().find(|file| rest_of_name(file, capture) == rest);
        let only = files.first().filter(|_| files.len() == 1);
        let file = of_name.or(only).ok_or_else(|| {
            format!(
                "there are {} frames of \"{capture}\", and none has the rest of this name; name them alike, or give each photograph a visit of its \
                 own in photographs.csv",
                files.len()
            )
        })?;
        frames.push((capture.to_owned(), file.to_path_buf()));
    }
    Ok(frames)
}

/// A photograph with what the lines of its analyzed frame say.
fn photograph_of(
    [patient, visit]: [&str; 2],
    frames: Vec<(String, PathBuf)>,
    rows: &[&PhotographRow],
) -> Photograph {
    let own: Vec<&&PhotographRow> = rows.iter().filter(|row| row.frame == frames[0].1).collect();
    let files = |file: fn(&PhotographRow) -> &PathBuf| {
        let named = own.iter().map(|row| file(row)).filter(|path| !path.as_os_str().is_empty());
        let mut all: Vec<PathBuf> = Vec::new();
        for path in named {
            if !all.contains(path) {
                all.push(path.clone());
            }
        }
        all
    };
    let regions = own.iter().filter(|row| !row.region.is_empty());
    Photograph {
        patient: patient.to_owned(),
        visit: visit.to_owned(),
        dark: files(|row| &row.dark),
        flat: files(|row| &row.flat),
        regions: regions.map(|row| [row.region.clone(), row.place.clone(), row.verdict.clone()]).collect(),
        frames,
    }
}

/// The other captures of some lines, each once.
fn captures_beside<'a>(rows: &[&'a PhotographRow], analyzed: &str) -> Vec<&'a str> {
    let mut names: Vec<&str> =
        rows.iter().map(|row| row.capture.as_str()).filter(|name| *name != analyzed).collect();
    names.sort_unstable();
    names.dedup();
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(path: &str, below: &str, captures: &[KnownCapture]) -> PhotographRow {
        let path = Path::new(path);
        let capture = capture_by_name(path, captures).unwrap().to_owned();
        let [patient, visit] = person_of(path, Path::new(below), &capture);
        PhotographRow { patient, visit, capture, frame: path.into(), ..Default::default() }
    }

    #[test]
    fn names_and_folders_tell_persons_visits_and_captures() {
        let captures = ["blue", "ambient"].map(|name| KnownCapture { name: name.into(), exposure_s: None });
        let told = |path: &str| {
            let row = row(path, "photos", &captures);
            (row.patient, row.visit, row.capture)
        };
        let are = |a: &str, b: &str, c: &str| (a.to_owned(), b.to_owned(), c.to_owned());
        assert_eq!(told("photos/P01_blue.dng"), are("P01", "1", "blue"));
        assert_eq!(told("photos/BLUE-P01.dng"), are("P01", "1", "blue"));
        assert_eq!(told("photos/anna/march/IMG_1 ambient.dng"), are("anna", "march", "ambient"));
        assert_eq!(told("photos/sub-7/ses-2/photo/sub-7_ses-2_blue.tif"), are("7", "2", "blue"));
        assert_eq!(told("photos/P03_visit2_blue.dng"), are("P03", "2", "blue"));
        assert_eq!(told("photos/P03-left-session-4-blue.dng"), are("P03-left", "4", "blue"));
        assert_eq!(told("photos/V12_blue.dng"), are("V12", "1", "blue"));
        assert_eq!(told("photos/P3 v2b blue.dng"), are("P3", "2b", "blue"));
        assert_eq!(told("photos/P3_vera_blue.dng"), are("P3_vera", "1", "blue"));
        assert_eq!(capture_by_name(Path::new("bluebell.dng"), &captures), None);
        let person = |path: &str| person_told(Path::new(path), Path::new("photos"), "blue");
        assert_eq!(person("photos/IMG_1.dng"), None);
        assert_eq!(person("photos/P03_visit1_violet.dng"), Some(["P03".to_owned(), "1".to_owned()]));
        assert_eq!(person("photos/P2/IMG_1.dng"), Some(["P2".to_owned(), "1".to_owned()]));
    }

    #[test]
    fn frames_of_the_camera_may_name_their_capture() {
        let folder = tempfile::tempdir().unwrap();
        let names = ["P1_blue", "dark_blue", "blue-dark-2", "flat_blue", "P2_flat_blue", "IMG_7_dark"];
        for name in names {
            fs::write(folder.path().join(format!("{name}.dng")), b"").unwrap();
        }
        let found = |captures: &[&str]| {
            let known = captures.iter().map(|name| KnownCapture { name: (*name).into(), exposure_s: None });
            let (rows, dark, flat, left) = rows_of_folder(folder.path(), &known.collect::<Vec<_>>());
            let patients = rows.into_iter().map(|row| row.patient).collect::<Vec<_>>();
            (patients, dark.len(), flat.len(), left)
        };
        let (patients, dark, flat, left) = found(&["blue"]);
        assert_eq!((patients, dark, flat), (vec!["P1".to_owned()], 3, 1));
        assert!(left.len() == 1 && left[0].1.contains("call it flat_blue, which serves all"), "{left:?}");
        let (patients, dark, ..) = found(&["blue", "flat_blue"]);
        assert_eq!((patients, dark), (["P1", "P2", ""].map(str::to_owned).to_vec(), 3));
    }

    /// Two views of a visit have frames of their own names; an ambient frame that stands alone serves both.
    #[test]
    fn frames_are_joined_by_name_and_a_single_one_serves_all() {
        let captures = ["blue", "ambient"].map(|name| KnownCapture { name: name.into(), exposure_s: None });
        let rows = |paths: &[&str]| -> Vec<PhotographRow> {
            paths.iter().map(|path| row(path, "", &captures)).collect()
        };
        let (found, left) =
            photographs_of(&rows(&["P/1/a_blue.dng", "P/1/b_blue.dng", "P/1/ambient.dng"]), "blue");
        assert_eq!((found.len(), left.len()), (2, 0));
        assert!(found.iter().all(|photograph| photograph.frames[1].1 == Path::new("P/1/ambient.dng")));
        let two = ["P/1/a_blue.dng", "P/1/b_blue.dng", "P/1/a_ambient.dng", "P/1/c_ambient.dng"];
        let (found, left) = photographs_of(&rows(&two), "blue");
        assert_eq!((found.len(), left.len()), (1, 1));
        assert_eq!(found[0].frames[1].1, Path::new("P/1/a_ambient.dng"));
        assert!(left[0].1.contains("2 frames of \"ambient\""), "{left:?}");
        let (found, left) = photographs_of(&rows(&["P/1/ambient.dng"]), "blue");
        assert!(found.is_empty() && left[0].1.contains("no frame of the analyzed capture"));
    }
}
