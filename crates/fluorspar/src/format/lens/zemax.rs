//! The sequential, centred, refracting subset of Zemax files: standard and even aspheric surfaces.

use super::{Fault, number};
use crate::optics::{Dispersion, LensPrescription, LensSurface, Medium};

struct ZemaxSurface {
    line: usize,
    surface: LensSurface,
    /// Terms `a2, a4, ...`.
    terms: Vec<f64>,
}

pub(super) fn parse(text: &str, name: &str) -> Result<LensPrescription, Fault> {
    let mut title = String::new();
    let mut unit_mm = 1.0;
    let mut wavelengths_um: Vec<(usize, f64)> = Vec::new();
    let mut primary = 1;
    let mut surfaces: Vec<ZemaxSurface> = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let at = index + 1;
        let mut words = line.split_whitespace();
        let Some(key) = words.next() else { continue };
        let rest: Vec<&str> = words.collect();
        let value = |number_of: usize, what: &str| -> Result<f64, Fault> {
            let word = rest.get(number_of).copied();
            number(word.ok_or_else(|| Fault::at(at, format!("{key} has no {what}")))?, what, at)
        };
        match (key, surfaces.last_mut()) {
            ("MODE", _) if rest.first() != Some(&"SEQ") => {
                return Err(Fault::at(
                    at,
                    "the file is non-sequential; only sequential lenses are read (MODE SEQ)",
                ));
            }
            ("NAME", _) => title = rest.join(" "),
            ("UNIT", _) => {
                unit_mm = match rest.first().copied() {
                    Some("MM") => 1.0,
                    Some("CM") => 10.0,
                    Some("M" | "METER") => 1000.0,
                    Some("IN" | "INCH") => 25.4,
                    other => {
                        let unit = other.unwrap_or_default();
                        return Err(Fault::at(
                            at,
                            format!("the unit \"{unit}\" is not known; use MM, CM, M or IN"),
                        ));
                    }
                }
            }
            ("WAVM", _) => wavelengths_um.push((value(0, "number")? as usize, value(1, "wavelength")?)),
            ("PWAV", _) => primary = value(0, "number")? as usize,
            ("SURF", _) => surfaces.push(ZemaxSurface {
                line: at,
                surface: LensSurface::spherical(0.0, 0.0, 0.0),
                terms: Vec::new(),
            }),
            ("STOP", Some(current)) => current.surface.is_stop = true,
            ("TYPE", Some(_)) => {
                let kind = rest.first().copied().unwrap_or_default();
                if !["STANDARD", "EVENASPH"].contains(&kind) {
                    let message = format!(
                        "surfaces of type {kind} are not supported; only STANDARD and EVENASPH, centred on one axis"
                    );
                    return Err(Fault::at(at, message));
                }
            }
            ("CURV", Some(current)) => current.surface.curvature_per_mm = value(0, "curvature")?,
            ("CONI", Some(current)) => current.surface.conic = value(0, "conic constant")?,
            ("PARM", Some(current)) => {
                let term = value(0, "number")? as usize;
                let coefficient = value(1, "coefficient")?;
                if (1..=12).contains(&term) && coefficient != 0.0 {
                    current.terms.resize(current.terms.len().max(term), 0.0);
                    current.terms[term - 1] = coefficient;
                }
            }
            ("DISZ", Some(current)) => {
                current.surface.thickness_mm =
                    if rest.first() == Some(&"INFINITY") { f64::INFINITY } else { value(0, "thickness")? };
            }
            ("DIAM", Some(current)) => current.surface.semi_diameter_mm = value(0, "semi-diameter")?,
            ("GLAS", Some(current)) => {
                let glass = rest.first().copied().unwrap_or_default();
                if glass == "MIRROR" {
                    return Err(Fault::at(at, "a mirror; only refracting lenses are read"));
                }
                // "1" in the second column: the index and the Abbe number beside it are the glass.
                current.surface.medium = if rest.get(1) == Some(&"1") || glass.starts_with("___") {
                    let (nd, vd) = (value(3, "index")?, value(4, "Abbe number")?);
                    Medium::Known(if vd == 0.0 {
                        Dispersion::Constant { index: nd }
                    } else {
                        Dispersion::Abbe { nd, vd }
                    })
                } else {
                    Medium::Named(glass.into())
                };
            }
            _ => {}
        }
    }
    if surfaces.len() < 3 {
        let message =
            format!("{} surfaces; there is no SURF block of a lens. Is this a .zmx file?", surfaces.len());
        let message =
            if surfaces.is_empty() { "no SURF block; is this a .zmx file?".into() } else { message };
        return Err(Fault::anywhere(message));
    }
    // The first is the object, the last the image.
    surfaces.pop();
    surfaces.remove(0);
    if !surfaces.iter().any(|s| s.surface.is_stop) {
        return Err(Fault::anywhere("no STOP between object and image; mark the aperture stop"));
    }
    for ZemaxSurface { line, surface, terms } in &mut surfaces {
        if surface.semi_diameter_mm <= 0.0 {
            return Err(Fault::at(*line, "the surface has no DIAM; write its semi-diameter into the file"));
        }
        if let Some((a2, rest)) = terms.split_first() {
            if *a2 != 0.0 && surface.conic != 0.0 {
                let message =
                    "an r² term (PARM 1) together with a conic constant is not supported; put it in CURV";
                return Err(Fault::at(*line, message));
            }
            surface.curvature_per_mm += 2.0 * a2;
            surface.aspheric = rest.to_vec();
        }
        if surface.thickness_mm.is_infinite() {
            return Err(Fault::at(*line, "an infinite distance inside the lens; give mm"));
        }
    }
    let title = if title.is_empty() { name.into() } else { title };
    let mut lens = LensPrescription::new(title, surfaces.into_iter().map(|s| s.surface).collect());
    if let Some((_, um)) = wavelengths_um.iter().find(|(number, _)| *number == primary) {
        lens.design_wavelength_nm = (um * 1e7).round() / 1e4;
    }
    Ok(if unit_mm == 1.0 { lens } else { lens.scaled(unit_mm) })
}
