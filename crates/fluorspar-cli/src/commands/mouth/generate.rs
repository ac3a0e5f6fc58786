//! `fluorspar mouth generate`: meshes of one mouth.

use clap::ValueHint;
use fluorspar_anatomy::{Mouth, MouthParameters};
use fluorspar_experiment::cached_mouth;
use fluorspar_format::{
    NamedMesh, Output, OutputFolder, OutputSet, Outputs, write_gltf, write_obj, write_pbrt, write_ply,
};
use serde_json::json;
use std::path::{Path, PathBuf};

use super::person::PersonArgs;
use crate::commands::table::{align, short};
use crate::error::CliError;
use crate::message::Messages;

/// Options of `mouth generate`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(flatten)]
    person: PersonArgs,
    /// Pose of this view, for instance `ventral-tongue`; see `mouth view --list`.
    #[arg(long, value_name = "VIEW")]
    pose: Option<String>,
    /// File or folder for the meshes: .glb, .obj, .pbrt, or a folder for one .ply file for each part. May be repeated.
    ///
    /// Lengths are meters. Without it, only the dimensions are printed.
    #[arg(long, value_name = "PATH", value_hint = ValueHint::AnyPath)]
    out: Vec<PathBuf>,
    /// Print the answer as JSON.
    ///
    /// Parameters, dimensions and parts.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy)]
enum OutputKind {
    Glb,
    Obj,
    Pbrt,
    PlyFolder,
}

impl OutputKind {
    /// What was written for a path, with so many meshes.
    fn written(self, path: &Path, meshes: usize) -> String {
        match self {
            Self::PlyFolder => format!("Wrote {meshes} .ply files to {}", path.display()),
            Self::Obj => format!("Wrote {} and {}", path.display(), path.with_extension("mtl").display()),
            Self::Glb | Self::Pbrt => format!("Wrote {}", path.display()),
        }
    }
}

fn target(path: &Path) -> Result<OutputKind, CliError> {
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("glb") => Ok(OutputKind::Glb),
        Some("obj") => Ok(OutputKind::Obj),
        Some("pbrt") => Ok(OutputKind::Pbrt),
        None => Ok(OutputKind::PlyFolder),
        Some(_) => Err(CliError::Input(format!(
            "--out {}: the name must end in .glb, .obj or .pbrt; for .ply files give a folder",
            path.display()
        ))),
    }
}

/// Files and folders that appear when all are complete.
struct Files<'a> {
    files: Vec<(&'a Path, OutputKind)>,
    folders: Vec<OutputFolder>,
    set: OutputSet,
}

impl<'a> Files<'a> {
    fn declare(paths: &'a [PathBuf], kinds: &[OutputKind]) -> Result<Self, CliError> {
        let mut outputs = Outputs::new();
        for (path, kind) in paths.iter().zip(kinds) {
            outputs = outputs.and(match kind {
                OutputKind::PlyFolder => Output::folder("--out", path),
                _ => Output::file("--out", path),
            });
        }
        let set = outputs.declare()?;
        let (mut files, mut folders) = (Vec::new(), Vec::new());
        for (path, kind) in paths.iter().zip(kinds) {
            match kind {
                OutputKind::PlyFolder => folders.push(OutputFolder::prepare(path, &[], 0)?),
                kind => files.push((path.as_path(), *kind)),
            }
        }
        Ok(Self { files, folders, set })
    }

    fn write(self, meshes: &[NamedMesh<'_>]) -> Result<(), CliError> {
        for (path, kind) in &self.files {
            match kind {
                OutputKind::Glb => write_gltf(path, meshes)?,
                OutputKind::Obj => write_obj(path, meshes)?,
                OutputKind::Pbrt => write_pbrt(path, meshes)?,
                OutputKind::PlyFolder => {}
            }
        }
        for folder in &self.folders {
            for part in meshes {
                write_ply(&folder.path().join(format!("{}.ply", part.name)), part.mesh)
                    .map_err(|error| folder.at_its_place(error))?;
            }
        }
        for folder in self.folders {
            folder.finish()?;
        }
        Ok(self.set.finish()?)
    }
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let targets: Vec<OutputKind> = options.out.iter().map(|path| target(path)).collect::<Result<_, _>>()?;
    let parameters = options.person.parameters(options.pose.as_deref())?;
    let files = Files::declare(&options.out, &targets)?;
    let mouth = cached_mouth(&parameters).map_err(|error| CliError::Input(format!("mouth: {error}")))?;
    let names: Vec<String> = mouth.parts.iter().map(|part| part.tissue.name().to_owned()).collect();
    let meshes: Vec<NamedMesh<'_>> = mouth
        .parts
        .iter()
        .zip(&names)
        .map(|(part, material)| NamedMesh {
            name: &part.name,
            material,
            color: COLORS.iter().find(|(tissue, _)| tissue == material).map_or(GRAY, |(_, color)| *color),
            mesh: &part.mesh,
        })
        .collect();
    files.write(&meshes)?;
    for (path, target) in options.out.iter().zip(&targets) {
        Messages::default().status(target.written(path, meshes.len()));
    }
    if options.json {
        return print_json(&parameters, &mouth);
    }
    crate::commands::print_text(&dimension_table(&parameters, &mouth))
}

/// Color of a tissue that the default experiment does not have.
const GRAY: [f64; 3] = [0.5; 3];

/// Mean color of every tissue of the default experiment under even light, without gloss: linear sRGB. Numbers, because solving the
/// tissues takes longer than making the meshes.
#[allow(clippy::approx_constant, reason = "colors, not logarithms")]
const COLORS: [(&str, [f64; 3]); 11] = [
    ("cheek", [0.3606, 0.1605, 0.1454]),
    ("floor_of_mouth", [0.3370, 0.1438, 0.1344]),
    ("gingiva", [0.3732, 0.1369, 0.1132]),
    ("hard_palate", [0.4343, 0.2307, 0.2106]),
    ("lip", [0.3112, 0.1044, 0.1025]),
    ("skin", [0.4711, 0.2910, 0.2112]),
    ("soft_palate", [0.3493, 0.1460, 0.1317]),
    ("throat", [0.3200, 0.1272, 0.1162]),
    ("tongue_dorsum", [0.3246, 0.1415, 0.1454]),
    ("tongue_ventral", [0.3128, 0.1175, 0.1165]),
    ("tooth", [0.5821, 0.5198, 0.3695]),
];

/// A length of a mouth.
struct Dimension {
    name: &'static str,
    wanted_mm: f64,
    /// Measured on the meshes, or why it can't be.
    measured_mm: Result<f64, String>,
    source: &'static str,
}

fn dimensions(p: &MouthParameters, mouth: &Mouth) -> Vec<Dimension> {
    const CONTACTS: &str = "contact points; Braun 1998, Mina 2017";
    // Incisors in the middle and second molars
    let [middle, upper, lower] = [[11, 21, 31, 41], [11, 21, 17, 27], [31, 41, 37, 47]];
    let d = mouth.dimensions();
    // Most lengths are measured between teeth.
    let between = |value: Option<f64>, teeth: &[u8]| {
        value.ok_or_else(|| {
            let missing: Vec<String> =
                teeth.iter().filter(|tooth| p.missing_teeth.contains(tooth)).map(u8::to_string).collect();
            format!("no tooth {}", missing.join(", "))
        })
    };
    let tip = if p.tongue_curl == 0.0 {
        between(d.tongue_protrusion_mm, &[31, 41])
    } else {
        Err("the tip is raised".to_owned())
    };
    [
        ("jaw opening", p.jaw_opening_mm, between(d.jaw_opening_mm, &middle), "adults 45 to 57 mm at most"),
        ("upper arch width", p.upper_arch_width_mm, between(d.upper_arch_width_mm, &upper), CONTACTS),
        ("upper arch depth", p.upper_arch_depth_mm, between(d.upper_arch_depth_mm, &upper), CONTACTS),
        ("lower arch width", p.lower_arch_width_mm, between(d.lower_arch_width_mm, &lower), CONTACTS),
        ("lower arch depth", p.lower_arch_depth_mm, between(d.lower_arch_depth_mm, &lower), CONTACTS),
        (
            "palate height",
            p.palate_height_mm,
            between(d.palate_height_mm, &[11, 21, 16, 26]),
            "42 % of the width at the molars; Korkhaus",
        ),
        ("tongue width", p.tongue_width_mm, Ok(d.tongue_width_mm), "45 to 55 mm, assumed"),
        (
            "tongue length",
            p.tongue_length_in_pose_mm(),
            Ok(d.tongue_length_mm),
            "79 to 85 mm at rest; Edinburgh",
        ),
        ("tongue in front", p.tongue_protrusion_mm, tip, "pose"),
        (
            "width of the lips",
            p.lip_opening_width_mm,
            Ok(d.lip_opening_width_mm),
            "50 to 55 mm at rest; Farkas",
        ),
    ]
    .into_iter()
    .map(|(name, wanted_mm, measured_mm, source)| Dimension { name, wanted_mm, measured_mm, source })
    .collect()
}

fn dimension_table(p: &MouthParameters, mouth: &Mouth) -> String {
    let cells = |cells: [&str; 4]| cells.map(String::from).to_vec();
    let mut rows = vec![cells(["dimension", "wanted mm", "measured mm", "source"])];
    let dimensions = dimensions(p, mouth);
    for dimension in &dimensions {
        let measured = dimension.measured_mm.as_ref().map_or_else(|_| "-".into(), |value| short(*value));
        rows.push(vec![dimension.name.into(), short(dimension.wanted_mm), measured, dimension.source.into()]);
    }
    let mut text = align(&rows, &[3]);
    for dimension in &dimensions {
        if let Err(why) = &dimension.measured_mm {
            text += &format!("not measured: {}, {why}\n", dimension.name);
        }
    }
    text += &format!(
        "Bolton ratio {:.1} % (populations 92.3 to 93.4 %, Smith 2000)\n{} parts, {} triangles\n",
        100.0 * p.bolton_ratio(),
        mouth.parts.len(),
        mouth.triangle_count()
    );
    for p in mouth.penetrations(0.2, 2) {
        text += &format!("warning: {} penetrates {:.1} mm into {}\n", p.part, p.depth_mm, p.other);
    }
    text
}

fn print_json(parameters: &MouthParameters, mouth: &Mouth) -> Result<(), CliError> {
    let list: Vec<_> = dimensions(parameters, mouth)
        .into_iter()
        .map(|dimension| {
            let (measured, why) = match dimension.measured_mm {
                Ok(value) => (Some(value), None),
                Err(why) => (None, Some(why)),
            };
            json!({
                "name": dimension.name,
                "wanted_mm": dimension.wanted_mm,
                "measured_mm": measured,
                "not_measured": why,
                "source": dimension.source,
            })
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
    Ok(())
}

#[cfg(test)]
mod tests {
    use fluorspar::spectral::{Reflectance, StandardObserver, linear_srgb};
    use fluorspar::tissue::diffuse_reflectance;
    use fluorspar_session::ExperimentSource;

    use super::*;
    use crate::values::Override;

    #[test]
    fn colors_are_those_of_the_default_experiment() {
        let changes = [Override::set("mouth.detail=0.25"), Override::unset("analysis")];
        let scene = ExperimentSource::find(None).unwrap().resolve(&changes).unwrap().study.scene;
        let observer = StandardObserver::new(&scene.grid);
        let srgb = |spectrum: &[f32]| linear_srgb(observer.xyz(spectrum));
        let white = srgb(&vec![1.0; scene.grid.len()]);
        const SIDE: u16 = 16;
        let grid: Vec<[f32; 2]> = (0..SIDE * SIDE)
            .map(|i| [i % SIDE, i / SIDE].map(|k| (f32::from(k) + 0.5) / f32::from(SIDE)))
            .collect();
        let mut others = Vec::new();
        for material in &scene.materials {
            let diffuse = material.diffuse().unwrap();
            // A coat lets in what it does not reflect; the reflectance below it is that of the light let in.
            let passed = material
                .coat()
                .map_or(1.0, |coat| 1.0 - diffuse_reflectance(1.0, coat.refractive_index.into()));
            let mut weights = vec![0.0_f64; diffuse.reflectance.len()];
            for uv in &grid {
                let at_point = diffuse.weights_at((*uv).into());
                weights.iter_mut().zip(at_point).for_each(|(sum, weight)| *sum += f64::from(weight));
            }
            let mut reflectance = vec![0.0_f32; scene.grid.len()];
            for (term, weight) in diffuse.reflectance.iter().zip(&weights) {
                let share = passed * weight / grid.len() as f64;
                let values = term.spectrum.on_grid::<Reflectance>(&scene.grid);
                reflectance
                    .iter_mut()
                    .zip(values.values())
                    .for_each(|(sum, value)| *sum += (share * *value) as f32);
            }
            let color = srgb(&reflectance);
            // Saturated colors may lie a little outside of sRGB.
            let color: [f64; 3] = std::array::from_fn(|c| (color[c] / white[c]).clamp(0.0, 1.0));
            let Some((_, kept)) = COLORS.iter().find(|(tissue, _)| *tissue == material.name) else {
                continue;
            };
            if color.iter().zip(kept).any(|(a, b)| (a - b).abs() > 5e-4) {
                others.push(format!("({:?}, {color:.4?}),", material.name));
            }
        }
        assert!(others.is_empty(), "other colors:\n{}", others.join("\n"));
    }
}
