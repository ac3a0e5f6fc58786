//! Lens files: our own TOML, the tables of pbrt, the JSON of ISET's lens tools, sequential Zemax files.
//!
//! Readers give a [`LensPrescription`] whose glasses may still be names; a catalogue looks them up.

mod iset_json;
mod pbrt_table;
mod toml_lens;
mod zemax;

use fluorspar::quote::{excerpt, excerpt_to};
use std::path::Path;

use thiserror::Error;

use crate::store::input::read_bounded;
use fluorspar::optics::{LensPrescription, LensSurface, MOST_ASPHERIC_TERMS};

pub use toml_lens::{AbbeGlass, LensFile, LensFileSurface, PublishedLens};

/// Largest lens file that is read, bytes.
const LARGEST_BYTES: u64 = 4 << 20;

/// A lens file that can't be read.
#[derive(Debug, Error)]
#[error("{file}{}: {message}", line.map_or_else(String::new, |line| format!(":{line}")))]
pub struct LensFileError {
    /// The file.
    pub file: String,
    /// Line, from 1, where one is to blame.
    pub line: Option<usize>,
    /// What is wrong and how to fix it.
    pub message: String,
}

/// The part of an error that a reader knows: line and message.
#[derive(Debug)]
pub(super) struct Fault {
    pub(super) line: Option<usize>,
    pub(super) message: String,
}

impl Fault {
    pub(super) fn at(line: usize, message: impl Into<String>) -> Self {
        Self { line: Some(line), message: message.into() }
    }

    pub(super) fn anywhere(message: impl Into<String>) -> Self {
        Self { line: None, message: message.into() }
    }
}

/// Reads a lens file by its ending: `.toml`, `.dat` (pbrt), `.json` (ISET, omni), `.zmx` (Zemax).
///
/// # Errors
/// An error: what, in which line, and how to fix it.
pub fn read_lens(path: &Path) -> Result<LensPrescription, LensFileError> {
    let file = path.display().to_string();
    let error = |fault: Fault| LensFileError {
        file: file.clone(),
        line: fault.line,
        message: excerpt_to(&fault.message, 400),
    };
    let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).unwrap_or_default();
    if !["toml", "dat", "json", "zmx"].contains(&ending.as_str()) {
        let message =
            "not a lens file; the name must end in .toml, .dat (pbrt), .json (ISET) or .zmx (Zemax)";
        return Err(error(Fault::anywhere(message)));
    }
    let bytes =
        read_bounded(path, LARGEST_BYTES).map_err(|e| error(Fault::anywhere(e.problem().to_string())))?;
    let text = decode(&bytes).map_err(error)?;
    let name = path.file_stem().map_or_else(|| "lens".into(), |stem| stem.to_string_lossy().into_owned());
    let mut lens = parse_lens(&text, &ending, &name).map_err(error)?;
    if lens.source.is_empty() {
        lens.source.clone_from(&file);
    }
    Ok(lens)
}

fn parse_lens(text: &str, ending: &str, name: &str) -> Result<LensPrescription, Fault> {
    match ending {
        "toml" => LensFile::parse(text).map_err(|(line, message)| Fault { line, message })?.prescription(),
        "dat" => pbrt_table::parse(text, name),
        "json" => iset_json::parse(text, name),
        _ => zemax::parse(text, name),
    }
}

/// UTF-8, or UTF-16 with a byte order mark as Zemax writes it, or else Latin-1 (comments in old tables).
fn decode(bytes: &[u8]) -> Result<String, Fault> {
    let utf16 = |big: bool| {
        let units = bytes[2..].chunks_exact(2).map(|pair| {
            let pair = [pair[0], pair[1]];
            if big { u16::from_be_bytes(pair) } else { u16::from_le_bytes(pair) }
        });
        char::decode_utf16(units)
            .collect::<Result<String, _>>()
            .map_err(|_| Fault::anywhere("this is not UTF-16 text, though it begins so; save it again"))
    };
    match bytes {
        [0xff, 0xfe, ..] => utf16(false),
        [0xfe, 0xff, ..] => utf16(true),
        [0xef, 0xbb, 0xbf, rest @ ..] => Ok(String::from_utf8_lossy(rest).into_owned()),
        _ if bytes.contains(&0) => {
            Err(Fault::anywhere("this is a binary file, no text; is it the right one?"))
        }
        _ => Ok(String::from_utf8(bytes.to_vec())
            .unwrap_or_else(|_| bytes.iter().map(|byte| char::from(*byte)).collect())),
    }
}

/// Puts an `r²` term into the curvature of a surface, and what a conic of that curvature has beyond the old one and the term into its
/// further terms: the paraxial power is that of both, the sag that of the file.
pub(super) fn put_into_curvature(surface: &mut LensSurface, a2: f64, rest: &[f64]) {
    let (old, new) = (surface.curvature_per_mm, surface.curvature_per_mm + 2.0 * a2);
    surface.curvature_per_mm = new;
    surface.aspheric = rest.to_vec();
    if a2 == 0.0 {
        return;
    }
    surface.aspheric.resize(rest.len().max(MOST_ASPHERIC_TERMS), 0.0);
    // The series of a conic, with u = 1 + k: u c^3 r^4 / 8 + u² c^5 r^6 / 16 + ...
    let (u, mut factor) = (1.0 + surface.conic, 0.125);
    for (term, number) in surface.aspheric.iter_mut().zip(0..) {
        *term += factor * u.powi(number + 1) * (old.powi(2 * number + 3) - new.powi(2 * number + 3));
        factor *= f64::from(2 * number + 3) / f64::from(2 * number + 6);
    }
}

/// A finite number from a word.
pub(super) fn number(word: &str, what: &str, line: usize) -> Result<f64, Fault> {
    let value = word.parse::<f64>().ok().filter(|value| value.is_finite());
    value.ok_or_else(|| Fault::at(line, format!("{what}: \"{}\" is not a finite number", excerpt(word))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use fluorspar::optics::{D_LINE_NM, Dispersion, FocusMechanism, LensSurface, Medium, Paraxial};

    fn fault(text: &str, ending: &str) -> String {
        let fault = parse_lens(text, ending, "test").map(|lens| format!("{lens:?}")).unwrap_err();
        format!("{}: {}", fault.line.unwrap_or(0), fault.message)
    }

    #[test]
    fn an_r2_term_has_the_sag_of_the_file() {
        for (c, conic, a2) in [(0.0, 0.0, 0.025), (0.02, 0.0, -0.01), (-0.03, -0.7, 0.004), (0.03, 0.5, 1e-3)]
        {
            let mut surface =
                LensSurface { curvature_per_mm: c, conic, ..LensSurface::spherical(0.0, 5.0, 10.0) };
            put_into_curvature(&mut surface, a2, &[1e-6]);
            assert!((surface.curvature_per_mm - c - 2.0 * a2).abs() < 1e-15);
            for r in [1.0, 5.0, 9.0_f64] {
                let wanted = c * r * r / (1.0 + (1.0 - (1.0 + conic) * c * c * r * r).sqrt());
                let wanted = wanted + a2 * r * r + 1e-6 * r.powi(4);
                let found = surface.sag(r * r).unwrap().0;
                assert!((found - wanted).abs() < 1e-6, "{c} {a2} {r}: {found} {wanted}");
            }
        }
    }

    const PBRT: &str = "# a singlet behind its stop\n50\n0 2 0 4\n40 6 1.6 20\n-70 0 1 20\n";

    #[test]
    fn a_pbrt_table_is_read_with_and_without_its_focal_length() {
        let lens = parse_lens(PBRT, "dat", "singlet").unwrap();
        assert_eq!(lens.surfaces.len(), 3);
        assert!(lens.surfaces[0].is_stop && lens.surfaces[0].semi_diameter_mm == 2.0);
        assert!((lens.surfaces[1].radius_mm() - 40.0).abs() < 1e-12);
        let without = parse_lens(&PBRT.replace("50\n", ""), "dat", "singlet").unwrap();
        assert_eq!(lens.surfaces, without.surfaces);
        // pbrt-v2 tables write the stop's index as 0, v3 tables as 1 with radius 0: both are stops in air.
        assert_eq!(
            parse_lens(&PBRT.replace("0 2 0 4", "0 2 1 4"), "dat", "x").unwrap().surfaces,
            lens.surfaces
        );
    }

    /// Without refraction at the stop the focal length is that of the glass alone: for 4 mm between 70 and -70 mm,
    /// 1/f = 0.6 (2/70 - 0.6 * 4 / (1.6 * 70²)), f = 58.96 mm.
    #[test]
    fn a_stop_within_glass_is_read() {
        let lens = parse_lens("70 2 1.6 20\n0 2 1.6 12\n-70 0 1 20\n", "dat", "x").unwrap();
        assert_eq!(lens.surfaces.iter().map(|s| s.is_stop).collect::<Vec<_>>(), [false, true, false]);
        let f = Paraxial::new(&lens, 550.0).focal_length_mm;
        let expected = 1.0 / (0.6 * (2.0 / 70.0 - 0.6 * 4.0 / (1.6 * 4900.0)));
        assert!((f / expected - 1.0).abs() < 1e-9, "{f} {expected}");
        // A stop in air comes first: the flat face is glass.
        let both =
            parse_lens("0 2 1.6 20\n-70 1 1 20\n0 2 0 4\n40 6 1.6 20\n-70 0 1 20\n", "dat", "x").unwrap();
        assert!(!both.surfaces[0].is_stop && both.surfaces[2].is_stop);
    }

    #[test]
    fn bad_pbrt_tables_are_explained() {
        assert!(
            fault("40 6 1.6\n", "dat").starts_with("1: this line has 3 numbers"),
            "{}",
            fault("40 6 1.6\n", "dat")
        );
        assert!(fault("40 6 x 20\n", "dat").contains("\"x\" is not a finite number"));
        assert!(fault("40 6 1.6 20\n-70 0 1 20\n", "dat").contains("no stop"));
        assert!(fault("# nothing\n", "dat").contains("no surface"));
        assert!(fault("40 6 1.6 -20\n", "dat").contains("aperture"));
        assert!(fault("40 6 NaN 20\n", "dat").contains("is not a finite number"));
    }

    #[test]
    fn an_omni_lens_file_is_read() {
        let json = r#"{"name": "omni", "description": "two faces", "type": "omni", "surfaces": [
            {"conic_constant": 0, "ior": 1.6, "radius": 40, "semi_aperture": 10, "thickness": 6},
            {"conic_constant": -2.0, "ior": 1.0, "radius": -70, "semi_aperture": 10, "thickness": 2,
             "aspheric_coefficients": [1e-6, 0, 2e-9]},
            {"ior": 0, "radius": 0, "semi_aperture": 4, "thickness": 0}]}"#;
        let lens = parse_lens(json, "json", "x").unwrap();
        assert_eq!(lens.name, "omni");
        assert!(lens.surfaces[2].is_stop && lens.surfaces[1].conic == -2.0);
        // The r² term joins the curvature
        let [fourth, sixth, ..] = lens.surfaces[1].aspheric[..] else { panic!() };
        assert!(fourth.abs() < 1e-9 && (sixth - 2e-9).abs() < 1e-13);
        assert!((lens.surfaces[1].curvature_per_mm - (-1.0 / 70.0 + 2e-6)).abs() < 1e-15);
        let spectral =
            json.replace("\"ior\": 1.6", r#""ior": [1.62, 1.61, 1.60], "wavelength": [400, 500, 600]"#);
        let lens = parse_lens(&spectral, "json", "x").unwrap();
        assert!(lens.is_dispersive());
    }

    #[test]
    fn an_older_iset_lens_file_is_read() {
        let json = r#"{"name": "old", "surfaceArray": [
            {"subtype": "refractive", "sRadius": 67, "sCenter": [0,0,64], "wave": [400,700], "apertureD": 25,
             "n": [1.65,1.65]},
            {"subtype": "diaphragm", "sRadius": 0, "sCenter": [0,0,-1.5], "wave": [400,700], "apertureD": 25,
             "n": [1.65,1.65]},
            {"subtype": "refractive", "sRadius": -67, "sCenter": [0,0,-67], "wave": [400,700], "apertureD": 25,
             "n": [1,1]}], "apertureMiddleD": 8}"#;
        let lens = parse_lens(json, "json", "x").unwrap();
        // Vertices: 64 - 67 = -3, -1.5, -67 + 67 = 0.
        assert!((lens.surfaces[0].thickness_mm - 1.5).abs() < 1e-12);
        assert!((lens.surfaces[1].thickness_mm - 1.5).abs() < 1e-12);
        assert_eq!(lens.surfaces[1].semi_diameter_mm, 4.0);
        // Published with the file: 51.997 mm.
        let f = Paraxial::new(&lens, 550.0).focal_length_mm;
        assert!((f - 51.997_051_545).abs() < 1e-6, "{f}");
    }

    #[test]
    fn bad_json_lenses_are_explained() {
        assert!(fault("{", "json").starts_with("1: "));
        assert!(fault("{}", "json").contains("\"surfaces\""));
        assert!(fault(r#"{"surfaces": [{"radius": 1}]}"#, "json").contains("surface 1: no \"thickness\""));
        let bad = r#"{"surfaces": [{"radius": "1", "thickness": 1, "ior": 1, "semi_aperture": 1}]}"#;
        assert!(fault(bad, "json").contains("\"radius\""));
        let short = r#"{"surfaces": [{"radius": 1, "thickness": 1, "ior": [1.5, 1.4], "semi_aperture": 1}]}"#;
        assert!(fault(short, "json").contains("wavelength"));
    }

    const ZMX: &str = "VERS 140730\nMODE SEQ\nNAME Asphere\nUNIT MM X W X CM MR CPMM\nWAVM 1 0.5875618 1\nPWAV 1\nSURF 0\n  TYPE STANDARD\n  CURV 0.0 0 0 0 0 \"\"\n  DISZ INFINITY\n  DIAM 0 0 0 0 1 \"\"\nSURF 1\n  STOP\n  TYPE EVENASPH\n  CURV 0.025 0 0 0 0 \"\"\n  PARM 1 0\n  PARM 2 1e-6\n  PARM 3 0\n  DISZ 6\n  GLAS N-BK7 0 0 1.5 40 0 0 0 0 0 0\n  CONI -0.5\n  DIAM 10 1 0 0 1 \"\"\nSURF 2\n  TYPE STANDARD\n  CURV -0.01 0 0 0 0 \"\"\n  DISZ 60\n  DIAM 10 1 0 0 1 \"\"\nSURF 3\n  TYPE STANDARD\n  CURV 0 0 0 0 0 \"\"\n  DISZ 0\n  DIAM 5 0 0 0 1 \"\"\n";

    #[test]
    fn a_sequential_zemax_file_is_read() {
        let lens = parse_lens(ZMX, "zmx", "x").unwrap();
        assert_eq!(
            (lens.name.as_str(), lens.surfaces.len()),
            ("Asphere", 2),
            "object and image are not surfaces"
        );
        let first = &lens.surfaces[0];
        assert!(first.is_stop && first.conic == -0.5 && first.aspheric == [1e-6]);
        assert_eq!(first.medium, Medium::Named("N-BK7".into()));
        assert_eq!(lens.design_wavelength_nm, 587.5618);
        let model = ZMX.replace("GLAS N-BK7 0 0 1.5 40", "GLAS ___BLANK 1 0 1.6 50");
        let lens = parse_lens(&model, "zmx", "x").unwrap();
        let Medium::Known(glass) = &lens.surfaces[0].medium else { panic!() };
        assert!((glass.index(D_LINE_NM) - 1.6).abs() < 1e-12);
        let inches = parse_lens(&ZMX.replace("UNIT MM", "UNIT IN"), "zmx", "x").unwrap();
        assert!((inches.surfaces[0].thickness_mm - 6.0 * 25.4).abs() < 1e-9);
        assert!((inches.surfaces[0].aspheric[0] - 1e-6 / 25.4_f64.powi(3)).abs() < 1e-15);
    }

    #[test]
    fn the_aperture_of_a_zemax_file_is_that_of_its_system_and_surfaces() {
        let read = |from: &str, to: &str| {
            let lens = parse_lens(&ZMX.replace(from, to), "zmx", "x").unwrap();
            lens.with_glasses(|_| Ok(Dispersion::Constant { index: 1.5 })).ok().unwrap()
        };
        let opening = |from: &str, to: &str| read(from, to).surfaces[0].semi_diameter_mm;
        // The stop is the first surface: its pupil is as large as it is
        assert_eq!(opening("PWAV 1", "PWAV 1\nENPD 12"), 6.0);
        assert_eq!(opening("UNIT MM X W X CM MR CPMM\n", "UNIT IN\nENPD 0.5\n"), 6.35);
        assert_eq!(opening("PWAV 1", "PWAV 1\nENPD 50"), 10.0, "the rim of the stop stays");
        let f = Paraxial::new(&read("", ""), D_LINE_NM).focal_length_mm;
        assert!((opening("PWAV 1", "PWAV 1\nFNUM 5 0") - f / 10.0).abs() < 1e-9);
        assert_eq!(opening("  CONI -0.5", "  CONI -0.5\n  CLAP 0 3.0 0"), 3.0);
        assert!(fault(&ZMX.replace("  CONI -0.5", "  OBSC 0 3.0 0"), "zmx").contains("not round"));
        assert!(fault(&ZMX.replace("PWAV 1", "OBNA 0.1 0"), "zmx").contains("f-number"));
        assert!(fault(&ZMX.replace("PWAV 1", "FNUM -5 0"), "zmx").contains("not above 0"));
        assert!(fault(&ZMX.replace("  CONI -0.5", "  CLAP 3 6 0"), "zmx").contains("not round"));
    }

    #[test]
    fn what_a_zemax_file_may_not_hold_is_named() {
        assert!(fault(&ZMX.replace("MODE SEQ", "MODE NSC"), "zmx").contains("non-sequential"));
        let mirror = ZMX.replace("GLAS N-BK7", "GLAS MIRROR");
        assert!(fault(&mirror, "zmx").contains("mirror"));
        assert!(fault(&ZMX.replace("EVENASPH", "COORDBRK"), "zmx").contains("COORDBRK"));
        assert!(fault(&ZMX.replace("  STOP\n", ""), "zmx").contains("no STOP"));
        assert!(fault(&ZMX.replace("UNIT MM", "UNIT FURLONG"), "zmx").contains("FURLONG"));
        assert!(fault("hello\n", "zmx").contains("no SURF"));
    }

    #[test]
    fn our_own_file_comes_back() {
        let mut lens = parse_lens(ZMX, "zmx", "x").unwrap();
        lens.source = "a test".into();
        lens.focus =
            FocusMechanism::Gaps(vec![fluorspar::optics::FocusGap { behind_surface: 1, change_mm: 2.0 }]);
        let text = LensFile::from_prescription(&lens).to_toml().unwrap();
        assert_eq!(parse_lens(&text, "toml", "x").ok().unwrap(), lens);
    }

    #[test]
    fn scale_applies_to_everything_and_faults_are_placed() {
        let text = "name = \"a\"\nscale = 0.5\n[[surface]]\nradius_mm = 40\nthickness_mm = 6\nindex = 1.6\nsemi_diameter_mm = 10\nstop = true\n[[surface]]\nradius_mm = -70\nsemi_diameter_mm = 10\n";
        let lens = parse_lens(text, "toml", "x").unwrap();
        assert_eq!(lens.surfaces[0].radius_mm(), 20.0);
        assert_eq!(
            lens.surfaces[1],
            LensSurface { curvature_per_mm: -1.0 / 35.0, ..LensSurface::spherical(-35.0, 0.0, 5.0) }
        );
        assert!(fault(&text.replace("index = 1.6", "idnex = 1.6"), "toml").starts_with("6: "));
        assert!(
            fault(&text.replace("index = 1.6", "index = 1.6\nglass = \"F2\""), "toml").contains("one of")
        );
        assert!(fault(&text.replace("scale = 0.5", "scale = -1"), "toml").contains("scale"));
    }
}
