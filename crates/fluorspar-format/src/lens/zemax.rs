//! The sequential, centered, refracting subset of Zemax files: standard and even aspheric surfaces.

use super::{Fault, number, put_into_curvature};
use fluorspar::optics::{Dispersion, LensPrescription, LensSurface, Medium, SystemAperture};
use fluorspar::quote::excerpt;

struct ZemaxSurface {
    line: usize,
    surface: LensSurface,
    /// Terms `a2, a4, ...`.
    terms: Vec<f64>,
    /// Radius of its own aperture, in which light passes.
    clear_mm: f64,
}

/// The entries of a file.
struct ZemaxFile {
    title: String,
    unit_mm: f64,
    /// Numbers and values of the wavelengths.
    wavelengths_um: Vec<(usize, f64)>,
    /// Number of the design wavelength.
    primary: usize,
    surfaces: Vec<ZemaxSurface>,
    aperture: Option<SystemAperture>,
}

impl Default for ZemaxFile {
    fn default() -> Self {
        Self {
            title: String::new(),
            unit_mm: 1.0,
            wavelengths_um: Vec::new(),
            primary: 1,
            surfaces: Vec::new(),
            aperture: None,
        }
    }
}

impl ZemaxFile {
    /// Reads one line: a key and its values. Keys that do not matter to a lens are skipped.
    fn read_line(&mut self, line: &str, at: usize) -> Result<(), Fault> {
        let mut words = line.split_whitespace();
        let Some(key) = words.next() else { return Ok(()) };
        let rest: Vec<&str> = words.collect();
        let positive = |number: f64| match number > 0.0 {
            true => Ok(number),
            false => Err(Fault::at(at, format!("{key} {number} is not above 0"))),
        };
        let value = |number_of: usize, what: &str| -> Result<f64, Fault> {
            let word = rest.get(number_of).copied();
            number(word.ok_or_else(|| Fault::at(at, format!("{key} has no {what}")))?, what, at)
        };
        match (key, self.surfaces.last_mut()) {
            ("MODE", _) if rest.first() != Some(&"SEQ") => {
                return Err(Fault::at(
                    at,
                    "the file is non-sequential; only sequential lenses are read (MODE SEQ)",
                ));
            }
            ("NAME", _) => self.title = rest.join(" "),
            ("UNIT", _) => self.unit_mm = unit_mm(rest.first().copied().unwrap_or_default(), at)?,
            ("WAVM", _) => {
                self.wavelengths_um.push((value(0, "number")? as usize, value(1, "wavelength")?));
            }
            ("ENPD", _) => {
                self.aperture = Some(SystemAperture::EntrancePupilMm(positive(value(
                    0,
                    "diameter of the entrance pupil",
                )?)?));
            }
            ("FNUM", _) => self.aperture = Some(SystemAperture::FNumber(positive(value(0, "f-number")?)?)),
            ("OBNA", _) => {
                let message = "its aperture is a numerical aperture of the object; set it as an entrance pupil or an f-number";
                return Err(Fault::at(at, message));
            }
            ("PWAV", _) => self.primary = value(0, "number")? as usize,
            ("SURF", _) => self.surfaces.push(ZemaxSurface {
                line: at,
                surface: LensSurface::spherical(0.0, 0.0, 0.0),
                terms: Vec::new(),
                clear_mm: f64::INFINITY,
            }),
            ("STOP", Some(current)) => current.surface.is_stop = true,
            ("TYPE", Some(_)) => {
                let kind = rest.first().copied().unwrap_or_default();
                if !["STANDARD", "EVENASPH"].contains(&kind) {
                    let message = format!(
                        "surfaces of type {kind} are not supported; only STANDARD and EVENASPH, centered on one axis"
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
            ("CLAP", Some(current)) if value(0, "smallest radius of its aperture")? <= 0.0 => {
                current.clear_mm = value(1, "largest radius of its aperture")?;
            }
            ("CLAP" | "SQAP" | "ELAP" | "OBSC" | "OBSR" | "OBEL" | "UDAD" | "UDOB", Some(_)) => {
                return Err(Fault::at(
                    at,
                    "an aperture that is not round and open; only round ones are read (CLAP)",
                ));
            }
            ("GLAS", Some(current)) => current.surface.medium = glass(&rest, value, at)?,
            _ => {}
        }
        Ok(())
    }
}

/// Millimeters per unit of length.
fn unit_mm(unit: &str, at: usize) -> Result<f64, Fault> {
    match unit {
        "MM" => Ok(1.0),
        "CM" => Ok(10.0),
        "M" | "METER" => Ok(1000.0),
        "IN" | "INCH" => Ok(25.4),
        other => {
            let message = format!("the unit \"{}\" is not known; use MM, CM, M or IN", excerpt(other));
            Err(Fault::at(at, message))
        }
    }
}

/// The medium of a line `GLAS`, whose words and numbers these are.
fn glass(
    words: &[&str],
    value: impl Fn(usize, &str) -> Result<f64, Fault>,
    at: usize,
) -> Result<Medium, Fault> {
    let glass = words.first().copied().unwrap_or_default();
    if glass == "MIRROR" {
        return Err(Fault::at(at, "a mirror; only refracting lenses are read"));
    }
    // "1" in the second column: the index and the Abbe number beside it are the glass.
    if words.get(1) != Some(&"1") && !glass.starts_with("___") {
        return Ok(Medium::Named(glass.into()));
    }
    let (nd, vd) = (value(3, "index")?, value(4, "Abbe number")?);
    Ok(Medium::Known(if vd == 0.0 {
        Dispersion::Constant { index: nd }
    } else {
        Dispersion::Abbe { nd, vd }
    }))
}

impl ZemaxSurface {
    /// Checks a surface whose entries are all read, and puts the `r²` term into its curvature.
    fn finish(&mut self) -> Result<(), Fault> {
        let Self { line, surface, terms, clear_mm } = self;
        surface.semi_diameter_mm = surface.semi_diameter_mm.min(*clear_mm);
        if surface.semi_diameter_mm <= 0.0 {
            return Err(Fault::at(*line, "the surface has no DIAM; write its semi-diameter into the file"));
        }
        if let Some((a2, rest)) = terms.split_first() {
            put_into_curvature(surface, *a2, rest);
        }
        if surface.thickness_mm.is_infinite() {
            return Err(Fault::at(*line, "an infinite distance inside the lens; give mm"));
        }
        Ok(())
    }
}

pub(super) fn parse(text: &str, name: &str) -> Result<LensPrescription, Fault> {
    // Read the entries, line by line
    let mut file = ZemaxFile::default();
    for (index, line) in text.lines().enumerate() {
        file.read_line(line, index + 1)?;
    }

    let ZemaxFile { title, unit_mm, wavelengths_um, primary, surfaces, aperture } = file;
    let surfaces = between_object_and_image(surfaces)?;

    // Set title, design wavelength and unit
    let title = if title.is_empty() { name.into() } else { title };
    let mut lens = LensPrescription::new(title, surfaces.into_iter().map(|s| s.surface).collect());
    if let Some((_, um)) = wavelengths_um.iter().find(|(number, _)| *number == primary) {
        lens.design_wavelength_nm = (um * 1e7).round() / 1e4;
    }
    lens.aperture = aperture;
    Ok(if unit_mm == 1.0 { lens } else { lens.scaled(unit_mm) })
}

/// The surfaces of the lens: the first of a file is the object, the last the image.
fn between_object_and_image(mut surfaces: Vec<ZemaxSurface>) -> Result<Vec<ZemaxSurface>, Fault> {
    if surfaces.len() < 3 {
        let message =
            format!("{} surfaces; there is no SURF block of a lens. Is this a .zmx file?", surfaces.len());
        let message =
            if surfaces.is_empty() { "no SURF block; is this a .zmx file?".into() } else { message };
        return Err(Fault::anywhere(message));
    }
    surfaces.pop();
    surfaces.remove(0);
    if !surfaces.iter().any(|s| s.surface.is_stop) {
        return Err(Fault::anywhere("no STOP between object and image; mark the aperture stop"));
    }
    for surface in &mut surfaces {
        surface.finish()?;
    }
    Ok(surfaces)
}
