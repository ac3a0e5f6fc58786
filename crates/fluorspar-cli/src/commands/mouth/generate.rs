//! `fluorspar mouth generate`: meshes of one mouth.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::ValueHint;
use fluorspar::anatomy::{Mouth, MouthParameters, generate_mouth};
use fluorspar::format::{NamedMesh, write_gltf, write_obj, write_pbrt, write_ply};
use fluorspar::spectral::{Reflectance, StandardObserver, linear_srgb};
use serde_json::json;

use super::person::PersonArgs;
use crate::commands::table::{align, short};
use crate::error::CliError;
use crate::experiment_source::ExperimentSource;

/// Options of `mouth generate`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(flatten)]
    person: PersonArgs,
    /// Pose of this view, for instance `ventral-tongue`; see `mouth view --list`.
    #[arg(long, value_name = "VIEW")]
    pose: Option<String>,
    /// File or folder to write: .glb (all parts, metres), .obj (millimetres), .pbrt (metres), or a folder name for one
    /// .ply file for each part (metres). May be repeated. Without it, only the dimensions are printed.
    #[arg(long, value_name = "PATH", value_hint = ValueHint::AnyPath)]
    out: Vec<PathBuf>,
    /// Print the parameters, dimensions and parts as JSON.
    #[arg(long)]
    json: bool,
}

enum Target {
    Glb,
    Obj,
    Pbrt,
    PlyFolder,
}

fn target(path: &Path) -> Result<Target, CliError> {
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("glb") => Ok(Target::Glb),
        Some("obj") => Ok(Target::Obj),
        Some("pbrt") => Ok(Target::Pbrt),
        None => Ok(Target::PlyFolder),
        Some(_) => Err(CliError::Input(format!(
            "--out {}: the name must end in .glb, .obj or .pbrt, or be a folder's for .ply files",
            path.display()
        ))),
    }
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    let targets: Vec<Target> = options.out.iter().map(|path| target(path)).collect::<Result<_, _>>()?;
    for path in &options.out {
        crate::commands::check_parent(path)?;
    }
    let parameters = options.person.parameters(options.pose.as_deref())?;
    let mouth = generate_mouth(&parameters).map_err(|error| CliError::Input(format!("mouth: {error}")))?;
    let names: Vec<String> = mouth.parts.iter().map(|part| part.tissue.name().to_owned()).collect();
    let colors = if options.out.is_empty() { BTreeMap::new() } else { tissue_colors()? };
    let meshes: Vec<NamedMesh<'_>> = mouth
        .parts
        .iter()
        .zip(&names)
        .map(|(part, material)| NamedMesh {
            name: &part.name,
            material,
            color: colors.get(material).copied().unwrap_or(GREY),
            mesh: &part.mesh,
        })
        .collect();
    for (path, target) in options.out.iter().zip(&targets) {
        match target {
            Target::Glb => write_gltf(path, &meshes)?,
            Target::Obj => write_obj(path, &meshes)?,
            Target::Pbrt => write_pbrt(path, &meshes)?,
            Target::PlyFolder => {
                std::fs::create_dir_all(path)
                    .map_err(|error| CliError::Failed(format!("can't make {}: {error}", path.display())))?;
                for part in &meshes {
                    write_ply(&path.join(format!("{}.ply", part.name)), part.mesh)?;
                }
            }
        }
    }
    if options.json {
        return print_json(&parameters, &mouth);
    }
    crate::commands::print_text(&dimension_table(&parameters, &mouth))?;
    Ok(ExitCode::SUCCESS)
}

/// Colour of a tissue that the default experiment does not have.
const GREY: [f64; 3] = [0.5; 3];

/// Mean colour of every tissue of the default experiment under even light, linear sRGB.
fn tissue_colors() -> Result<BTreeMap<String, [f64; 3]>, CliError> {
    let source = ExperimentSource::find(None)?;
    let scene = source.resolve(&[], true)?.scene;
    let observer = StandardObserver::new(&scene.grid);
    let srgb = |spectrum: &[f32]| linear_srgb(observer.xyz(spectrum));
    let white = srgb(&vec![1.0; scene.grid.len()]);
    const SIDE: u16 = 16;
    let lattice: Vec<[f32; 2]> = (0..SIDE * SIDE)
        .map(|i| [i % SIDE, i / SIDE].map(|k| (f32::from(k) + 0.5) / f32::from(SIDE)))
        .collect();
    let mut colors = BTreeMap::new();
    for material in &scene.materials {
        let mut reflectance = vec![0.0_f32; scene.grid.len()];
        for term in &material.reflectance {
            let weight =
                lattice.iter().map(|uv| term.weight.at((*uv).into())).sum::<f32>() / lattice.len() as f32;
            let values = term.spectrum.on_grid::<Reflectance>(&scene.grid);
            reflectance
                .iter_mut()
                .zip(values.values())
                .for_each(|(sum, value)| *sum += weight * *value as f32);
        }
        let color = srgb(&reflectance);
        colors.insert(material.name.clone(), std::array::from_fn(|c| (color[c] / white[c]).clamp(0.0, 1.0)));
    }
    Ok(colors)
}

/// Name, wanted value, measured value, source.
fn dimensions(p: &MouthParameters, mouth: &Mouth) -> Vec<(&'static str, f64, Option<f64>, &'static str)> {
    let d = mouth.dimensions();
    vec![
        ("jaw opening", p.jaw_opening_mm, d.jaw_opening_mm, "adults 45 to 57 mm at most"),
        (
            "upper arch width",
            p.upper_arch_width_mm,
            d.upper_arch_width_mm,
            "contact points; Braun 1998, Mina 2017",
        ),
        (
            "upper arch depth",
            p.upper_arch_depth_mm,
            d.upper_arch_depth_mm,
            "contact points; Braun 1998, Mina 2017",
        ),
        (
            "lower arch width",
            p.lower_arch_width_mm,
            d.lower_arch_width_mm,
            "contact points; Braun 1998, Mina 2017",
        ),
        (
            "lower arch depth",
            p.lower_arch_depth_mm,
            d.lower_arch_depth_mm,
            "contact points; Braun 1998, Mina 2017",
        ),
        (
            "palate height",
            p.palate_height_mm,
            d.palate_height_mm,
            "42 % of the width at the molars; Korkhaus",
        ),
        ("tongue width", p.tongue_width_mm, Some(d.tongue_width_mm), "45 to 55 mm, assumed"),
        (
            "tongue length",
            p.tongue_length_in_pose_mm(),
            Some(d.tongue_length_mm),
            "79 to 85 mm at rest; Edinburgh",
        ),
        (
            "tongue in front",
            p.tongue_protrusion_mm,
            // A raised tip has left the place that the parameter tells.
            d.tongue_protrusion_mm.filter(|_| p.tongue_curl == 0.0),
            "pose",
        ),
        (
            "width of the lips",
            p.lip_opening_width_mm,
            Some(d.lip_opening_width_mm),
            "50 to 55 mm at rest; Farkas",
        ),
    ]
}

fn dimension_table(p: &MouthParameters, mouth: &Mouth) -> String {
    let cells = |cells: [&str; 4]| cells.map(String::from).to_vec();
    let mut rows = vec![cells(["dimension", "wanted mm", "measured mm", "source"])];
    for (name, wanted, measured, source) in dimensions(p, mouth) {
        let measured = measured.map_or_else(|| "-".into(), short);
        rows.push(vec![name.into(), short(wanted), measured, source.into()]);
    }
    let mut text = align(&rows, &[3]);
    text += &format!(
        "Bolton ratio {:.1} % (populations 92.3 to 93.4 %, Smith 2000)\n{} parts, {} triangles\n",
        100.0 * p.bolton_ratio(),
        mouth.parts.len(),
        mouth.triangle_count()
    );
    for p in mouth.penetrations(0.2, 2) {
        text += &format!("warning: {} stands {:.1} mm deep in {}\n", p.part, p.depth_mm, p.other);
    }
    text
}

fn print_json(parameters: &MouthParameters, mouth: &Mouth) -> Result<ExitCode, CliError> {
    let list: Vec<_> = dimensions(parameters, mouth)
        .into_iter()
        .map(|(name, wanted, measured, source)| {
            json!({ "name": name, "wanted_mm": wanted, "measured_mm": measured, "source": source })
        })
        .collect();
    let parts: Vec<_> = mouth
        .parts
        .iter()
        .map(|part| {
            json!({
                "name": part.name,
                "tissue": part.tissue.name(),
                "triangles": part.mesh.triangles.len(),
                "area_mm2": part.mesh.area_m2() * 1e6,
            })
        })
        .collect();
    crate::commands::print_json(&json!({
        "parameters": parameters,
        "bolton_ratio": parameters.bolton_ratio(),
        "dimensions": list,
        "parts": parts,
    }))?;
    Ok(ExitCode::SUCCESS)
}
