//! Tables of pbrt's realistic camera: radius, thickness, index, aperture diameter, in mm, object side first.

use super::{Fault, number};
use fluorspar::optics::{Dispersion, LensPrescription, LensSurface};

pub(super) fn parse(text: &str, name: &str) -> Result<LensPrescription, Fault> {
    let mut surfaces = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let at = index + 1;
        let content = line.split('#').next().unwrap_or_default();
        let words: Vec<&str> = content.split([' ', '\t', ',', ';']).filter(|word| !word.is_empty()).collect();
        // Tables of ISET give the focal length alone in a line before the surfaces.
        if words.is_empty() || (words.len() == 1 && surfaces.is_empty()) {
            if let [focal_length] = words[..] {
                number(focal_length, "focal length", at)?;
            }
            continue;
        }
        let [radius, thickness, index_of_refraction, diameter] = words[..] else {
            let message = format!(
                "this line has {} number{}; a surface needs four: radius, thickness, index, aperture diameter",
                words.len(),
                if words.len() == 1 { "" } else { "s" }
            );
            return Err(Fault::at(at, message));
        };
        let radius = number(radius, "radius", at)?;
        let thickness = number(thickness, "thickness", at)?;
        let n = number(index_of_refraction, "index", at)?;
        let diameter = number(diameter, "aperture diameter", at)?;
        if diameter <= 0.0 {
            return Err(Fault::at(
                at,
                format!("an aperture of {diameter} mm lets nothing pass; give its diameter"),
            ));
        }
        if n != 0.0 && !(1.0..=4.0).contains(&n) {
            return Err(Fault::at(at, format!("the index {n} is not between 1 and 4 (0 marks the stop)")));
        }
        let is_stop =
            radius == 0.0 && (n == 0.0 || n == 1.0) && !surfaces.iter().any(|s: &LensSurface| s.is_stop);
        let mut surface =
            LensSurface { is_stop, ..LensSurface::spherical(radius, thickness, 0.5 * diameter) };
        if n != 0.0 && n != 1.0 {
            surface = surface.with_medium(Dispersion::Constant { index: n });
        }
        surfaces.push(surface);
    }
    if surfaces.is_empty() {
        return Err(Fault::anywhere("no surface; give lines of radius, thickness, index, aperture diameter"));
    }
    // pbrt takes radius 0 as the stop whatever the index; here where there is no other.
    if !surfaces.iter().any(|surface| surface.is_stop)
        && let Some(flat) = surfaces.iter_mut().find(|surface| surface.curvature_per_mm == 0.0)
    {
        flat.is_stop = true;
    }
    if !surfaces.iter().any(|surface| surface.is_stop) {
        return Err(Fault::anywhere(
            "the lens has no stop; add one line with radius 0: index 0 in air, that of the glass within one",
        ));
    }
    Ok(LensPrescription::new(name, surfaces))
}
