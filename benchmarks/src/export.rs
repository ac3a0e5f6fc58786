//! Scenes as plain files for other renderers: `scene.json` and one raw little-endian array per mesh attribute.

use std::fs;
use std::io;
use std::path::Path;

use fluorspar::geometry::TriangleMesh;
use fluorspar::light::{DiscEmitter, Emitter, RectangleEmitter};
use fluorspar::material::ScalarTexture;
use fluorspar::scene::{Scene, Shape};
use fluorspar::spectral::Curve;
use serde_json::{Value, json};

/// Spectra are exported at these steps, nm.
const STEP_NM: f64 = 1.0;

/// Writes what an elastic renderer needs: meshes, reflectances, coats, disc and rectangle lights, camera, bins.
///
/// # Errors
/// A file that cannot be written, or a feature that has no counterpart ([`io::ErrorKind::Unsupported`]).
pub fn export(scene: &Scene, folder: &Path) -> io::Result<()> {
    if scene.camera.lens.is_some() {
        return Err(unsupported("traced lenses"));
    }
    fs::create_dir_all(folder)?;
    let mut objects = Vec::new();
    for object in &scene.objects {
        let Shape::Mesh(mesh) = &object.shape else { return Err(unsupported("analytic shapes")) };
        if object.emission.is_some() {
            return Err(unsupported("emissive objects"));
        }
        write_mesh(mesh, folder, &object.name)?;
        objects.push(json!({ "name": object.name, "material": object.material }));
    }
    let mut materials = Vec::new();
    for material in &scene.materials {
        let Some(base) = material.diffuse() else {
            return Err(unsupported("materials without a diffuse base"));
        };
        let spectra: Vec<Vec<f64>> =
            base.reflectance.iter().map(|term| samples(&term.spectrum, scene)).collect();
        let checker = match base.reflectance.as_slice() {
            [one] if one.weight.constant() == Some(1.0) => Value::Null,
            [_, second] => match second.weight {
                ScalarTexture::Checker { columns, rows, low: 0.0, high: 1.0 } => json!([columns, rows]),
                _ => return Err(unsupported("weights other than checkerboards")),
            },
            _ => return Err(unsupported("sums of reflectances")),
        };
        let coat = match material.coat() {
            None => Value::Null,
            Some(coat) => {
                let roughness = coat.roughness.constant().ok_or_else(|| unsupported("textured roughness"))?;
                json!({ "refractive_index": coat.refractive_index, "roughness": roughness })
            }
        };
        materials.push(json!({
            // One spectrum, or that of the even fields and what the odd fields add.
            "reflectance": spectra, "checker": checker, "coat": coat,
        }));
    }
    let mut lights = Vec::new();
    for light in &scene.lights {
        // One-sided and Lambertian: radiance = power / (pi area).
        let shape = match &light.emitter {
            Emitter::Disc(DiscEmitter { center, normal, radius_m, exponent: 1.0 }) => json!({
                "shape": "disc", "center": center.to_array(), "normal": normal.to_array(), "radius": radius_m,
                "area": std::f32::consts::PI * radius_m * radius_m,
            }),
            Emitter::Rectangle(RectangleEmitter { corner, edge_u, edge_v, exponent: 1.0 }) => json!({
                "shape": "rectangle", "corner": corner.to_array(),
                "edge_u": edge_u.to_array(), "edge_v": edge_v.to_array(),
                "area": edge_u.cross(*edge_v).length(),
            }),
            _ => return Err(unsupported("lights other than Lambertian discs and rectangles")),
        };
        lights.push(json!({ "emitter": shape, "power_w_per_nm": samples(&light.spectrum, scene) }));
    }
    let camera = &scene.camera;
    let document = json!({
        "edges_nm": scene.grid.edges_nm(),
        "start_nm": scene.grid.start_nm(), "step_nm": STEP_NM,
        "objects": objects, "materials": materials, "lights": lights,
        "camera": {
            "position": camera.position.to_array(), "forward": camera.forward.to_array(),
            "up": camera.up.to_array(), "field_deg": 2.0 * camera.tan_half_width.atan().to_degrees(),
            "width": camera.width, "height": camera.height,
        },
    });
    fs::write(folder.join("scene.json"), serde_json::to_vec(&document)?)
}

fn unsupported(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::Unsupported, format!("{what} are not exported"))
}

fn samples(curve: &Curve, scene: &Scene) -> Vec<f64> {
    let count = ((scene.grid.end_nm() - scene.grid.start_nm()) / STEP_NM).round() as usize;
    (0..=count).map(|i| curve.at(scene.grid.start_nm() + i as f64 * STEP_NM)).collect()
}

fn write_mesh(mesh: &TriangleMesh, folder: &Path, name: &str) -> io::Result<()> {
    let write =
        |attribute: &str, bytes: Vec<u8>| fs::write(folder.join(format!("{name}.{attribute}")), bytes);
    write(
        "positions",
        mesh.positions.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes).collect(),
    )?;
    write("uvs", mesh.uvs.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes).collect())?;
    write("triangles", mesh.triangles.iter().flatten().copied().flat_map(u32::to_le_bytes).collect())
}
