//! Scenes and optical images of ISETCam: MATLAB structs with photons, `[row, col, wave]`.

use std::path::Path;

use super::{Cube, CubeFacts, CubeLight, image_of};
use crate::FormatError;
use crate::store::file::check_image_size;
use crate::table::mat::write::{MatField, write_mat};
use crate::table::mat::{Fields, MatLimits, MatValue, find, holder, read_variables, size, text, wavelengths};
use fluorspar::image::{FeatureMaps, View};
use fluorspar::spectral::WavelengthGrid;
use fluorspar::units::{photon_energy_j, photons_per_joule};

/// Writes radiance as the variable `scene`, irradiance as `oi`.
pub(super) fn write_iset(path: &Path, cube: &Cube) -> Result<(), FormatError> {
    let (facts, [width, height], is_scene) = (&cube.facts, cube.light.size(), cube.light.is_radiance());
    let centers = cube.light.grid().centers_nm();
    let photons = photons(&cube.light, &centers);
    let most = photons.iter().copied().fold(0.0, f32::max);
    let dims = vec![height, width, centers.len()];
    let spectrum = || MatField::Struct(vec![("wave", MatField::column(centers.clone()))]);
    let mut fields = vec![
        ("type", MatField::Text(if is_scene { "scene" } else { "opticalimage" }.into())),
        ("name", MatField::Text(facts.title.clone())),
        ("spectrum", spectrum()),
        ("data", MatField::Struct(vec![("photons", MatField::Singles(dims, photons))])),
    ];
    if let Some(view) = facts.maps.view {
        let field_deg = 2.0 * f64::from(view.tan_half_width).atan().to_degrees();
        fields.push(("wAngular", MatField::number(field_deg)));
        if let (false, Some(pixel_mm)) = (is_scene, facts.mm_per_pixel) {
            fields.push(("optics", optics(&view, 1e-3 * pixel_mm * width as f64)));
        }
    }
    if is_scene {
        fields.extend(facts.distance_m.map(|distance| ("distance", MatField::number(distance))));
        // Asked for by the toolbox; fluorescence has no reflectance. Even, so that no reflectance exceeds 1.
        let even = vec![f64::from(most); centers.len()];
        let light = MatField::Struct(vec![("photons", MatField::column(even))]);
        let name = MatField::Text("equal photons, as the brightest value".into());
        let kind = MatField::Text("illuminant".into());
        let fields_of_light = vec![("type", kind), ("name", name), ("spectrum", spectrum()), ("data", light)];
        fields.push(("illuminant", MatField::Struct(fields_of_light)));
    }
    let depth = &facts.maps.depth_m;
    if depth.len() == width * height && !depth.is_empty() {
        let by_column = (0..width).flat_map(|col| (0..height).map(move |row| depth[row * width + col]));
        fields.push(("depthMap", MatField::Singles(vec![height, width], by_column.collect())));
    }
    write_mat(path, if is_scene { "scene" } else { "oi" }, &MatField::Struct(fields))
}

/// The lens whose film the image fills.
fn optics(view: &View, film_width_m: f64) -> MatField {
    let focal_length_m = 0.5 * film_width_m / f64::from(view.tan_half_width);
    MatField::Struct(vec![
        ("type", MatField::Text("optics".into())),
        ("focalLength", MatField::number(focal_length_m)),
    ])
}

/// Photons per second instead of watts, by columns.
fn photons(light: &CubeLight, centers_nm: &[f64]) -> Vec<f32> {
    let ([width, height], bands, values) = (light.size(), centers_nm.len(), light.values());
    let of_band = |(band, nm): (usize, &f64)| {
        let factor = photons_per_joule(*nm);
        let pixels = (0..width).flat_map(move |col| (0..height).map(move |row| row * width + col));
        pixels.map(move |pixel| (f64::from(values[pixel * bands + band]) * factor) as f32)
    };
    centers_nm.iter().enumerate().flat_map(of_band).collect()
}

/// Reads the variable `scene`, `oi` or `opticalimage`, or `photons` and `wave` alone, which are a scene.
pub(super) fn read_iset(path: &Path) -> Result<Cube, FormatError> {
    let mut variables = read_variables(path, MatLimits::IMAGES)?;
    let is_image = |name: &str| ["scene", "oi", "opticalimage"].contains(&name);
    let fields = match variables.iter().position(|(name, _)| is_image(name)) {
        Some(index) => match variables.swap_remove(index) {
            (_, MatValue::Struct(fields)) => fields,
            (name, other) => {
                let what = format!("\"{name}\" is {}", other.in_words());
                return Err(FormatError::unsupported(
                    path,
                    what,
                    "Save the struct itself, with save(..., '-v7')",
                ));
            }
        },
        None => holder(path, variables, &["photons"])?,
    };
    let wave_nm = wavelengths(path, &fields)?;
    let grid = WavelengthGrid::from_centers(&wave_nm).map_err(|error| {
        FormatError::malformed(path, error.to_string(), "Resample the image to wavelengths that are taken")
    })?;
    let light = read_photons(path, &fields, &grid, &wave_nm)?;
    let facts = read_facts(&fields, &light);
    Ok(Cube { light, facts })
}

fn read_photons(
    path: &Path,
    fields: &Fields,
    grid: &WavelengthGrid,
    wave_nm: &[f64],
) -> Result<CubeLight, FormatError> {
    let data = match find(fields, "data") {
        Some(MatValue::Struct(data)) => data,
        _ => fields,
    };
    let Some(MatValue::Numbers { dims, values }) = find(data, "photons") else {
        let hint = "Save the image with its photons: compressed and cell arrays are not read";
        return Err(FormatError::malformed(path, "there is no array \"photons\"", hint));
    };
    let [height, width, bands] = dims[..] else {
        let what = format!("\"photons\" has the size {}, not rows x columns x wavelengths", size(dims));
        return Err(FormatError::malformed(path, what, "Save the whole image"));
    };
    if bands != wave_nm.len() {
        let what = format!("\"photons\" has {bands} bands, and there are {} wavelengths", wave_nm.len());
        return Err(FormatError::malformed(path, what, "Save image and wavelengths of one scene"));
    }
    check_image_size(path, width as u64, height as u64, 4 * bands as u64, u64::MAX)?;
    if let Some(value) = values.iter().find(|value| !value.is_finite()) {
        return Err(FormatError::malformed(path, format!("\"photons\" holds {value}"), "Put 0 in its place"));
    }
    let pixels = width * height;
    let mut by_pixel = vec![0.0; values.len()];
    for (band, (plane, nm)) in values.chunks_exact(pixels).zip(wave_nm).enumerate() {
        let joules = photon_energy_j(*nm);
        for (place, value) in plane.iter().enumerate() {
            by_pixel[(place % height * width + place / height) * bands + band] = (joules * value) as f32;
        }
    }
    if text(fields, "type") == "opticalimage" {
        return image_of(path, grid, [width, height], by_pixel).map(CubeLight::Irradiance);
    }
    image_of(path, grid, [width, height], by_pixel).map(CubeLight::Radiance)
}

fn read_facts(fields: &Fields, light: &CubeLight) -> CubeFacts {
    let number = |name: &str| match find(fields, name) {
        Some(MatValue::Numbers { values, .. }) => values.first().copied().filter(|value| value.is_finite()),
        _ => None,
    };
    let field_deg = number("wAngular").filter(|deg| (0.0..179.0).contains(deg));
    let view = field_deg.map(|deg| View {
        position_m: [0.0; 3],
        forward: [0.0, 0.0, 1.0],
        right: [1.0, 0.0, 0.0],
        tan_half_width: (0.5 * deg).to_radians().tan() as f32,
    });
    let maps = FeatureMaps { view, ..FeatureMaps::default() };
    let distance_m = number("distance").filter(|distance| *distance > 0.0);
    CubeFacts { title: text(fields, "name"), distance_m, ..CubeFacts::of_maps(maps, light.size()) }
}
