//! Scenes of a design problem: rendered once, kept by their digests, shared by processes.

use std::path::{Path, PathBuf};
use std::time::Duration;

use fluorspar::design::{DesignProblem, RegionModel};
use fluorspar::digest::sha256_hex;
use fluorspar::image::ExcitationImage;
use fluorspar::pipeline::{BasisRender, eye_before_group, rendered_regions};
use fluorspar_experiment::{DesignRender, ResolvedDesign};
use fluorspar_format::{Claim, ComponentFile, ExrOptions, Provenance, check_room, write_component_exr};

use crate::{Error, Job, Result, image_room_bytes, render_with_excitation_basis};

/// Time between looks at what other processes render.
const LOOK_AGAIN: Duration = Duration::from_millis(500);

/// The problem of a file with its rendered regions; renders what is missing in the folder.
pub(super) fn complete(resolved: &ResolvedDesign, folder: &Path, job: &Job) -> Result<DesignProblem> {
    let rendered = &resolved.rendered;
    let problem = resolved.problem.clone();
    if rendered.renders.is_empty() {
        return Ok(problem);
    }
    let paths: Vec<PathBuf> = rendered.renders.iter().map(|render| path_of(folder, render)).collect();
    render_missing(&rendered.renders, &paths, job)?;
    let kept: Vec<(ComponentFile, ExcitationImage)> =
        paths.iter().map(|path| open(path)).collect::<Result<_>>()?;
    let mut regions: Vec<Vec<RegionModel>> = Vec::new();
    for region in &rendered.regions {
        let of_render = |&number: &usize| {
            let (file, basis) = &kept[number];
            let render = &rendered.renders[number];
            let group = basis.groups.iter().find(|group| group.light_group == render.light_group);
            let group = group.ok_or_else(|| damaged(&paths[number]))?;
            Ok(BasisRender { study: &render.study, image: file.labels(), group })
        };
        let renders: Vec<BasisRender<'_>> = region.renders.iter().map(of_render).collect::<Result<_>>()?;
        let models = rendered_regions(&region.name, &region.region, &renders)
            .map_err(|error| Error::Input(format!("region \"{}\": {error}", region.name)))?;
        regions.push(models);
    }
    let mut problem = rendered.complete(problem, regions);
    for (number, geometry) in problem.geometries.iter_mut().enumerate() {
        // The lights are those of the geometry, whoever lies in it: the first region's render has them
        let render = rendered.regions.first().map(|region| &rendered.renders[region.renders[number]]);
        geometry.eye = render.and_then(|render| {
            let (distance_mm, observer) = render.eye?;
            Some(eye_before_group(&render.study, &render.light_group, distance_mm, observer))
        });
    }
    Ok(problem)
}

/// Where a render lies: by what it was made of, and by the program that made it.
pub(super) fn path_of(folder: &Path, render: &DesignRender) -> PathBuf {
    let digest = sha256_hex([render.record.sha256.as_str(), env!("CARGO_PKG_VERSION")]);
    folder.join(format!("{}.exr", &digest[..24]))
}

fn damaged(path: &Path) -> Error {
    Error::Input(format!(
        "{}: this render of the design is damaged; remove it, and it is rendered again",
        path.display()
    ))
}

fn open(path: &Path) -> Result<(ComponentFile, ExcitationImage)> {
    let file = ComponentFile::open(path).map_err(|_| damaged(path))?;
    let basis = file.excitation_basis().map_err(|_| damaged(path))?.ok_or_else(|| damaged(path))?;
    Ok((file, basis))
}

/// Renders what is missing, one scene after the other with all threads. A scene that another process renders is left to it; one whose
/// process was killed is rendered again.
fn render_missing(renders: &[DesignRender], paths: &[PathBuf], job: &Job) -> Result<()> {
    let missing = || paths.iter().filter(|path| !path.exists()).count();
    if missing() > 0 {
        let folder = paths.first().and_then(|path| path.parent()).unwrap_or(Path::new("."));
        job.status(format!(
            "{} of {} scenes must be rendered; they are kept in {}",
            missing(),
            paths.len(),
            folder.display()
        ));
    }
    let mut is_waiting = false;
    loop {
        for (render, path) in renders.iter().zip(paths).filter(|(_, path)| !path.exists()) {
            let Some(claim) = Claim::take(&path.with_extension("lock"))? else { continue };
            if !path.exists() {
                render_scene(render, path, missing(), job)?;
            }
            drop(claim);
        }
        let left = missing();
        if left == 0 {
            // A process that was killed after its scene was complete has left its claim
            let claims = paths.iter().map(|path| path.with_extension("lock"));
            claims.filter(|claim| claim.exists()).try_for_each(|claim| Claim::take(&claim).map(drop))?;
            return Ok(());
        }
        if job.is_stopped() {
            return Err(Error::Stopped(format!(
                "stopped while {left} scenes were missing; the same command goes on with them"
            )));
        }
        if !is_waiting {
            job.status(format!("Waiting for {left} scenes that other processes render"));
            is_waiting = true;
        }
        std::thread::sleep(LOOK_AGAIN);
    }
}

/// Renders a scene; `left` are to be rendered, with this one.
fn render_scene(render: &DesignRender, path: &Path, left: usize, job: &Job) -> Result<()> {
    let study = &render.study;
    check_room(path, image_room_bytes(study, true))?;
    let Some(basis) = &study.render.excitation_basis else { return Err(damaged(path)) };
    let share = if left > 1 { format!(" ({left} such renders are missing)") } else { String::new() };
    job.status(format!("Rendering {}{share}", render.name));
    let (image, kept) = render_with_excitation_basis(study, basis, job)?;
    let toml = render.record.resolved_toml.clone();
    let provenance = Provenance::new(&toml.clone(), toml, study.render.seed, image.samples_per_pixel);
    let options = ExrOptions { provenance: Some(&provenance), excitation: Some(&kept), ..Default::default() };
    write_component_exr(path, &image, &options)?;
    Ok(())
}
