//! Glasses and lenses of the catalogue, and lenses from files with glasses of the catalogue.

use std::path::Path;

use thiserror::Error;

use super::catalogue::{damaged, names, parse, text};
use super::curve_preset::check_name;
use super::kind::{PresetError, PresetKind};
use crate::schema::is_file_name;
use fluorspar::names::nearest_name;
use fluorspar::optics::{Dispersion, Glass, LensPrescription, PrescriptionError};
use fluorspar_format::{LensFile, LensFileError, PublishedLens, read_lens};

/// A glass by its name in the catalogue, or by one that other programs use; capitals, hyphens and blanks do not matter.
///
/// # Errors
/// When there is no such glass.
pub fn glass(name: &str) -> Result<Glass, PresetError> {
    let kind = PresetKind::Glass;
    let plain = |text: &str| text.to_lowercase().replace(['-', ' '], "_");
    let wanted = plain(name);
    if names(kind).contains(&wanted.as_str()) {
        return load_glass(&wanted);
    }
    for file in names(kind) {
        let glass = load_glass(file)?;
        if plain(&glass.title) == wanted || glass.also.iter().any(|other| plain(other) == wanted) {
            return Ok(glass);
        }
    }
    let available: Vec<String> = names(kind).into_iter().map(String::from).collect();
    let nearest = nearest_name(name, available.iter().map(String::as_str)).map(String::from);
    Err(PresetError::Unknown { kind, name: name.into(), nearest, available })
}

fn load_glass(name: &str) -> Result<Glass, PresetError> {
    let kind = PresetKind::Glass;
    let glass: Glass = parse(kind, name)?;
    check_name(kind, name, &glass.name)?;
    glass.dispersion.validate().map_err(|message| damaged(kind, name, message))?;
    Ok(glass)
}

fn find_glass(name: &str) -> Result<Dispersion, String> {
    let found = glass(name).map(|glass| glass.dispersion);
    found.map_err(|error| {
        format!("{error}. Another glass: give its index and Abbe number, abbe = {{ nd = .., vd = .. }}")
    })
}

/// A lens ready to be set, with what is known about it.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedLens {
    /// The lens, glasses looked up.
    pub lens: LensPrescription,
    /// Name for people.
    pub title: String,
    /// Description; empty for a file.
    pub description: String,
    /// Published values of the whole lens.
    pub published: PublishedLens,
    /// Fields that are assumed.
    pub assumed: Vec<String>,
}

/// Why a lens can't be had.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LensError {
    /// There is no such lens in the catalogue.
    #[error(transparent)]
    Preset(#[from] PresetError),
    /// The file can't be read.
    #[error(transparent)]
    File(#[from] LensFileError),
    /// The lens can't be used.
    #[error("{name}: {problem}")]
    Prescription {
        /// The lens or its file.
        name: String,
        /// Where and what.
        problem: PrescriptionError,
    },
}

/// A lens of the catalogue.
///
/// # Errors
/// When there is no such lens.
pub fn lens(name: &str) -> Result<LoadedLens, PresetError> {
    let kind = PresetKind::Lens;
    let file = LensFile::parse(text(kind, name)?).map_err(|(_, message)| damaged(kind, name, message))?;
    check_name(kind, name, &file.name)?;
    let lens = file.to_prescription().map_err(|message| damaged(kind, name, message))?;
    let lens = lens.with_glasses(find_glass).map_err(|error| damaged(kind, name, error.to_string()))?;
    lens.validate().map_err(|error| damaged(kind, name, error.to_string()))?;
    Ok(LoadedLens {
        lens,
        title: file.title,
        description: file.description,
        published: file.published.unwrap_or_default(),
        assumed: file.assumed,
    })
}

/// A lens of the catalogue by its name, or one from a file: `.toml`, `.dat`, `.json`, `.zmx`.
///
/// # Errors
/// An error of a name or file: what, where, and how to fix it.
pub fn lens_or_file(name: &str) -> Result<LoadedLens, LensError> {
    if !is_file_name(name) {
        return Ok(lens(name)?);
    }
    let read = read_lens(Path::new(name))?;
    let problem = |problem| LensError::Prescription { name: name.into(), problem };
    let lens = read.with_glasses(find_glass).map_err(problem)?;
    lens.validate().map_err(problem)?;
    Ok(LoadedLens {
        title: lens.name.clone(),
        lens,
        description: String::new(),
        published: PublishedLens::default(),
        assumed: Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use fluorspar::optics::{C_LINE_NM, D_LINE_NM, F_LINE_NM, LensSetting, LensState, Paraxial};

    #[test]
    fn every_glass_has_its_published_index_and_abbe_number() {
        assert!(names(PresetKind::Glass).len() >= 15);
        for name in names(PresetKind::Glass) {
            let glass = glass(name).unwrap();
            let index = |nm| glass.dispersion.index(nm);
            let nd = index(D_LINE_NM);
            let vd = (nd - 1.0) / (index(F_LINE_NM) - index(C_LINE_NM));
            // Half a unit of the last published digit, and one for the formulas' own rounding.
            assert!((nd - glass.nd).abs() < 1e-5, "{name}: {nd}");
            assert!((vd - glass.vd).abs() < 0.015, "{name}: {vd}");
        }
    }

    #[test]
    fn glasses_have_the_names_of_other_programs() {
        for (other, ours) in
            [("BK7", "n_bk7"), ("N-BK7", "n_bk7"), ("n-sf11", "n_sf11"), ("SILICA", "fused_silica")]
        {
            assert_eq!(glass(other).unwrap().name, ours);
        }
        let error = find_glass("N-BK8").unwrap_err();
        assert!(error.contains("did you mean \"n_bk7\"") && error.contains("abbe ="), "{error}");
    }

    #[test]
    fn published_focal_lengths_and_f_numbers_come_back() {
        assert!(names(PresetKind::Lens).len() >= 5);
        for name in names(PresetKind::Lens) {
            let loaded = lens(name).unwrap();
            let p = Paraxial::new(&loaded.lens, D_LINE_NM);
            let state = LensState::new(&loaded.lens, LensSetting::default()).unwrap();
            let close = |what: &str, ours: f64, published: Option<f64>, tolerance: f64| {
                let Some(published) = published else { return };
                let error = ours / published - 1.0;
                println!("{name:<20} {what:<3} {ours:.4} {published} {:+.3} %", 100.0 * error);
                assert!(error.abs() < tolerance, "{name}: {what} is {ours}, published {published}");
            };
            close("f", p.focal_length_mm, loaded.published.focal_length_mm, 1e-3);
            // Sources place the film at a best focus or round the glasses to three digits.
            close("bfl", p.back_focal_length_mm, loaded.published.back_focal_length_mm, 2e-3);
            close("N", state.f_number, loaded.published.f_number, 1e-3);
            let again = state.f_number_at(loaded.lens.design_wavelength_nm);
            assert!((again / state.f_number - 1.0).abs() < 1e-9, "{name}: {again}");
        }
        // The stop is in front: the beam is as wide at every wavelength
        let doublet = lens("doublet_100mm").unwrap().lens;
        let state = LensState::new(&doublet, LensSetting::default()).unwrap();
        let ratio = Paraxial::new(&doublet, 420.0).focal_length_mm / state.paraxial.focal_length_mm;
        assert!((state.f_number_at(420.0) / state.f_number / ratio - 1.0).abs() < 1e-9 && ratio > 1.0 + 1e-5);
    }

    #[test]
    fn the_wide_lens_is_3_5_mm_f_4_and_the_macro_lens_reaches_life_size() {
        let open = |name: &str, object_distance_mm: Option<f64>| {
            let setting = LensSetting { object_distance_mm, ..LensSetting::default() };
            LensState::new(&lens(name).unwrap().lens, setting).unwrap()
        };
        assert!((open("wide_3_5mm", None).f_number / 4.0 - 1.0).abs() < 1e-3);
        let infinity = open("macro_105mm", None);
        // The lens that is made from this patent focuses to life size at 314 mm from object to film; the example itself need
        // not be the lens to the millimeter.
        let lens_105 = lens("macro_105mm").unwrap().lens;
        let focused = |distance: f64| {
            LensState::new(
                &lens_105,
                LensSetting { object_distance_mm: Some(distance), ..LensSetting::default() },
            )
        };
        let mut distance = 400.0;
        while focused(distance - 0.1).is_ok() {
            distance -= 0.1;
        }
        let near = focused(distance).unwrap();
        assert!((near.magnification() + 1.0).abs() < 0.01, "{}", near.magnification());
        assert!((near.film_mm - near.object_mm() - 314.0).abs() < 5.0, "{}", near.film_mm - near.object_mm());
        assert!((near.film_mm - infinity.film_mm).abs() < 1e-9, "the film stays");
        let again = near.f_number_at(lens_105.design_wavelength_nm);
        assert!((again / near.f_number - 1.0).abs() < 1e-9, "{again}");
        assert!(near.focus_travel > 0.95 && near.focus_travel <= 1.0, "{}", near.focus_travel);
        let too_near = LensSetting { object_distance_mm: Some(60.0), ..LensSetting::default() };
        let error = LensState::new(&lens("macro_105mm").unwrap().lens, too_near).unwrap_err();
        assert!(error.to_string().contains("closest focus"), "{error}");
    }
}
