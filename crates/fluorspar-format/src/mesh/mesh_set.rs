//! Several named meshes in one file, with the names of their materials.

use std::io::{self, Write};
use std::path::Path;

use crate::FormatError;
use crate::store::output::write_atomically;
use fluorspar::geometry::TriangleMesh;

/// A mesh with its name and that of its material.
#[derive(Clone, Copy, Debug)]
pub struct NamedMesh<'a> {
    /// Name: letters, digits, `_` and `-`.
    pub name: &'a str,
    /// Name of its material.
    pub material: &'a str,
    /// Diffuse color of its material under even light: linear sRGB, 0 to 1. Meshes of one material share the first one's.
    pub color: [f64; 3],
    /// The mesh, in meters.
    pub mesh: &'a TriangleMesh,
}

/// Materials by name, each with the color of the first mesh that has it.
pub(crate) fn materials<'a>(meshes: &[NamedMesh<'a>]) -> Vec<(&'a str, [f64; 3])> {
    let mut list: Vec<(&str, [f64; 3])> = meshes.iter().map(|part| (part.material, part.color)).collect();
    list.sort_by_key(|(name, _)| *name);
    list.dedup_by_key(|(name, _)| *name);
    list
}

pub(crate) fn check(path: &Path, meshes: &[NamedMesh<'_>]) -> Result<(), FormatError> {
    let refuse = |what: String| Err(FormatError::unwritable(path, what, "Fix the mesh first"));
    if meshes.is_empty() {
        return refuse("there is no mesh to write".into());
    }
    for part in meshes {
        if let Err(error) = part.mesh.validate() {
            return refuse(format!("{}: {error}", part.name));
        }
        if !part.color.iter().all(|c| (0.0..=1.0).contains(c)) {
            return refuse(format!("{}: the color {:?} is not between 0 and 1", part.name, part.color));
        }
        for name in [part.name, part.material] {
            let fine = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-');
            if name.is_empty() || !name.chars().all(fine) {
                return refuse(format!("\"{name}\" can't be a name in this file"));
            }
        }
    }
    Ok(())
}

/// Writes an OBJ file in meters: one object with its own `usemtl` for every mesh, with normals and texture
/// coordinates where there are some. The materials are in a file next to it, `NAME.mtl`.
///
/// # Errors
/// When a mesh is not valid or a file can't be written.
pub fn write_obj(path: &Path, meshes: &[NamedMesh<'_>]) -> Result<(), FormatError> {
    check(path, meshes)?;
    let library = path.with_extension("mtl");
    write_atomically(&library, |writer| {
        writeln!(writer, "# written by fluorspar, linear sRGB")?;
        for (name, [r, g, b]) in materials(meshes) {
            writeln!(writer, "newmtl {name}\nKd {r:.4} {g:.4} {b:.4}\nillum 1")?;
        }
        Ok(())
    })?;
    write_atomically(path, |writer| {
        writeln!(writer, "# written by fluorspar, meters")?;
        if let Some(name) = library.file_name() {
            writeln!(writer, "mtllib {}", name.to_string_lossy())?;
        }
        let (mut vertex, mut texture, mut normal) = (1_u64, 1_u64, 1_u64);
        for NamedMesh { name, material, mesh, .. } in meshes {
            writeln!(writer, "o {name}\nusemtl {material}")?;
            for p in &mesh.positions {
                writeln!(writer, "v {} {} {}", p.x, p.y, p.z)?;
            }
            for uv in &mesh.uvs {
                writeln!(writer, "vt {} {}", uv.x, uv.y)?;
            }
            for n in &mesh.normals {
                writeln!(writer, "vn {} {} {}", n.x, n.y, n.z)?;
            }
            for triangle in &mesh.triangles {
                write!(writer, "f")?;
                for &corner in triangle {
                    let corner = u64::from(corner);
                    match (mesh.uvs.is_empty(), mesh.normals.is_empty()) {
                        (false, false) => {
                            write!(writer, " {}/{}/{}", vertex + corner, texture + corner, normal + corner)?
                        }
                        (false, true) => write!(writer, " {}/{}", vertex + corner, texture + corner)?,
                        (true, false) => write!(writer, " {}//{}", vertex + corner, normal + corner)?,
                        (true, true) => write!(writer, " {}", vertex + corner)?,
                    }
                }
                writeln!(writer)?;
            }
            vertex += mesh.positions.len() as u64;
            texture += mesh.uvs.len() as u64;
            normal += mesh.normals.len() as u64;
        }
        Ok(())
    })
}

/// Writes the meshes as a PBRT (version 4) file to be included in a scene: a named diffuse material in its color for every
/// material, and an attribute block with a `trianglemesh` for every mesh. Meters.
///
/// # Errors
/// When a mesh is not valid or the file can't be written.
pub fn write_pbrt(path: &Path, meshes: &[NamedMesh<'_>]) -> Result<(), FormatError> {
    check(path, meshes)?;
    write_atomically(path, |writer| {
        writeln!(writer, "# written by fluorspar, meters")?;
        for (material, [r, g, b]) in materials(meshes) {
            writeln!(
                writer,
                "MakeNamedMaterial \"{material}\" \"string type\" [ \"diffuse\" ] \"rgb reflectance\" [ {r:.4} {g:.4} {b:.4} ]"
            )?;
        }
        meshes.iter().try_for_each(|mesh| write_pbrt_mesh(writer, mesh))
    })
}

/// One mesh as a shape with its material.
fn write_pbrt_mesh(writer: &mut impl Write, part: &NamedMesh<'_>) -> io::Result<()> {
    let NamedMesh { name, material, mesh, .. } = part;
    writeln!(writer, "AttributeBegin # {name}\nNamedMaterial \"{material}\"\nShape \"trianglemesh\"")?;
    list(writer, "integer indices", mesh.triangles.iter().map(|t| format!("{} {} {}", t[0], t[1], t[2])))?;
    list(writer, "point3 P", mesh.positions.iter().map(|p| format!("{} {} {}", p.x, p.y, p.z)))?;
    if !mesh.normals.is_empty() {
        list(writer, "normal N", mesh.normals.iter().map(|n| format!("{} {} {}", n.x, n.y, n.z)))?;
    }
    if !mesh.uvs.is_empty() {
        list(writer, "point2 uv", mesh.uvs.iter().map(|uv| format!("{} {}", uv.x, uv.y)))?;
    }
    writeln!(writer, "AttributeEnd")
}

fn list(writer: &mut impl Write, name: &str, items: impl Iterator<Item = String>) -> io::Result<()> {
    write!(writer, "  \"{name}\" [")?;
    for (number, item) in items.enumerate() {
        write!(writer, "{}{item}", if number % 8 == 0 { "\n    " } else { "  " })?;
    }
    writeln!(writer, " ]")
}
