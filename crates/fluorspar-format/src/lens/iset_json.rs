//! JSON lens files of ISET: `surfaces` (the omni camera) and the older `surfaceArray`. Lengths in mm.

use fluorspar::quote::excerpt;
use serde_json::Value;

use super::{Fault, put_into_curvature};
use fluorspar::optics::{Dispersion, LensPrescription, LensSurface, Medium};

pub(super) fn parse(text: &str, name: &str) -> Result<LensPrescription, Fault> {
    let root: Value = serde_json::from_str(text)
        .map_err(|error| Fault::at(error.line(), format!("invalid JSON: {error}")))?;
    let (list, older) = match (root.get("surfaces"), root.get("surfaceArray")) {
        (Some(list), _) => (list, false),
        (None, Some(list)) => (list, true),
        _ => {
            let message = "there is neither a list \"surfaces\" nor a \"surfaceArray\"; is this a lens file?";
            return Err(Fault::anywhere(message));
        }
    };
    let list = list.as_array().ok_or_else(|| Fault::anywhere("the surfaces must be a list"))?;
    let mut surfaces = Vec::with_capacity(list.len());
    let mut vertices = Vec::with_capacity(list.len());
    for (index, value) in list.iter().enumerate() {
        let surface = Fields { value, number: index + 1 };
        if older {
            let (parsed, vertex) = surface.older()?;
            surfaces.push(parsed);
            vertices.push(vertex);
        } else {
            surfaces.push(surface.omni()?);
        }
    }
    if older {
        for (index, pair) in vertices.windows(2).enumerate() {
            surfaces[index].thickness_mm = pair[1] - pair[0];
        }
        if let (Some(middle), Some(stop)) = (
            root.get("apertureMiddleD").and_then(Value::as_f64).filter(|d| *d > 0.0),
            surfaces.iter_mut().find(|surface| surface.is_stop),
        ) {
            stop.semi_diameter_mm = 0.5 * middle;
        }
        // The diaphragm lies in the medium before it.
        for index in 1..surfaces.len() {
            if surfaces[index].is_stop {
                surfaces[index].medium = surfaces[index - 1].medium.clone();
            }
        }
    }
    // A plate has flat sides in air, too: the first counts
    surfaces.iter_mut().filter(|surface| surface.is_stop).skip(1).for_each(|flat| flat.is_stop = false);
    if !surfaces.iter().any(|surface| surface.is_stop) {
        let message = "no surface is the stop; it is the one with the radius 0 and an index of 0 or 1";
        return Err(Fault::anywhere(message));
    }
    let title = root.get("name").and_then(Value::as_str).filter(|name| !name.is_empty()).unwrap_or(name);
    let mut lens = LensPrescription::new(title, surfaces);
    lens.source = root.get("description").and_then(Value::as_str).unwrap_or_default().into();
    Ok(lens)
}

struct Fields<'a> {
    value: &'a Value,
    number: usize,
}

impl Fields<'_> {
    fn fault(&self, message: impl std::fmt::Display) -> Fault {
        Fault::anywhere(format!("surface {}: {message}", self.number))
    }

    fn optional(&self, key: &str) -> Result<Option<f64>, Fault> {
        match self.value.get(key) {
            None | Some(Value::Null) => Ok(None),
            Some(value) => match value.as_f64() {
                Some(number) => Ok(Some(number)),
                None => {
                    Err(self.fault(format!("\"{key}\" is {}, not a number", excerpt(&value.to_string()))))
                }
            },
        }
    }

    fn required(&self, key: &str) -> Result<f64, Fault> {
        self.optional(key)?.ok_or_else(|| self.fault(format!("no \"{key}\"; give it in mm")))
    }

    fn numbers(&self, key: &str) -> Result<Vec<f64>, Fault> {
        match self.value.get(key) {
            None | Some(Value::Null) => Ok(Vec::new()),
            Some(Value::Number(one)) => Ok(one.as_f64().into_iter().collect()),
            Some(Value::Array(items)) => items
                .iter()
                .map(|item| {
                    item.as_f64().ok_or_else(|| {
                        self.fault(format!("\"{key}\" holds {}, not a number", excerpt(&item.to_string())))
                    })
                })
                .collect(),
            Some(other) => {
                Err(self
                    .fault(format!("\"{key}\" is {}, not a list of numbers", excerpt(&other.to_string()))))
            }
        }
    }

    /// An index that may be one number or one per wavelength. 0 (the stop) and 1 are air.
    fn medium(&self, key: &str, wave_keys: &[&str]) -> Result<Medium, Fault> {
        let index = self.numbers(key)?;
        if index.is_empty() {
            return Err(self.fault(format!("no \"{key}\"; give the refractive index behind the surface")));
        }
        let first = index[0];
        if index.iter().all(|n| *n == first) {
            return Ok(if first == 0.0 || first == 1.0 {
                Medium::Air
            } else {
                Medium::Known(Dispersion::Constant { index: first })
            });
        }
        for wave_key in wave_keys {
            let wavelength_nm = self.numbers(wave_key)?;
            if wavelength_nm.len() == index.len() {
                return Ok(Medium::Known(Dispersion::Table { wavelength_nm, index }));
            }
        }
        Err(self.fault(format!(
            "\"{key}\" has {} values, but there is no list of as many wavelengths in nm (\"{}\")",
            index.len(),
            wave_keys.join("\" or \"")
        )))
    }

    fn omni(&self) -> Result<LensSurface, Fault> {
        let radius = self.required("radius")?;
        let thickness = self.required("thickness")?;
        let semi_diameter_mm = self.required("semi_aperture")?;
        let medium = self.medium("ior", &["wavelength", "wave", "wavelengths"])?;
        let is_stop = radius == 0.0 && medium == Medium::Air;
        let mut surface =
            LensSurface { medium, is_stop, ..LensSurface::spherical(radius, thickness, semi_diameter_mm) };
        surface.conic = self.optional("conic_constant")?.unwrap_or(0.0);
        let terms = self.numbers("aspheric_coefficients")?;
        if let Some((a2, rest)) = terms.split_first() {
            put_into_curvature(&mut surface, *a2, rest);
            while surface.aspheric.last() == Some(&0.0) {
                surface.aspheric.pop();
            }
        }
        Ok(surface)
    }

    fn older(&self) -> Result<(LensSurface, f64), Fault> {
        let radius = self.required("sRadius")?;
        let center = self.numbers("sCenter")?;
        let [_, _, z] = center[..] else {
            return Err(self.fault("\"sCenter\" must hold three numbers: x, y, z in mm"));
        };
        let diameter = self.required("apertureD")?;
        let kind = self.value.get("subtype").and_then(Value::as_str).unwrap_or_default();
        let is_stop = kind == "diaphragm" || (kind.is_empty() && radius == 0.0);
        let medium = if is_stop { Medium::Air } else { self.medium("n", &["wave"])? };
        let mut surface =
            LensSurface { medium, is_stop, ..LensSurface::spherical(radius, 0.0, 0.5 * diameter) };
        surface.conic = self.optional("conicConstant")?.unwrap_or(0.0);
        Ok((surface, z - radius))
    }
}
