//! Spectral cubes for other programs, and from them.

use std::path::{Path, PathBuf};

use clap::ValueHint;
use fluorspar::image::ComponentImage;
use fluorspar::pipeline::{capture_irradiance, frame_radiance};
use fluorspar::spectral::{Irradiance, Quantity, Radiance};
use fluorspar::study::{Capture, Study};
use fluorspar_experiment::ResolvedExperiment;
use fluorspar_format::{
    Cube, CubeFacts, CubeForm, CubeLight, Output, OutputFolder, Outputs, Provenance, is_component_exr,
    is_component_npy, read_component_image, read_cube, write_component_zarr,
};
use serde::{Deserialize, Serialize};

use crate::options::defaults;
use crate::values::Override;
use crate::{
    Changes, Error, FinishedRender, Job, Result, ShownExperiment, as_typed_in_session, experiment_of,
    warn_of_denoised,
};

/// What becomes a cube, and where it goes.
#[derive(Clone, Debug, Deserialize, clap::Args)]
#[serde(default = "defaults")]
pub struct CubeOptions {
    /// Component image (of `render --components`, or the folder of a run), or a cube: .exr, .npy, ENVI (.hdr), scene or optical image
    /// of ISETCam (.mat).
    #[arg(value_name = "COMPONENTS|FOLDER|CUBE", value_hint = ValueHint::AnyPath)]
    pub image: PathBuf,
    /// Capture whose light it is, at its drives [default: the first with light; without captures all lights].
    #[arg(long, value_name = "NAME")]
    pub capture: Option<String>,
    /// Irradiance on the film, behind the lens and the filters of the capture, instead of radiance.
    #[arg(long)]
    pub on_film: bool,
    /// Write every component apart, in a .zarr.
    #[arg(long)]
    pub components: bool,
    /// Changes by path.
    #[command(flatten)]
    #[serde(flatten)]
    pub changes: Changes,
    /// File, whose name tells the form: .zarr (a folder), .hdr (ENVI), .mat (ISETCam), .ome.tiff, .exr or .npy.
    #[arg(long, value_name = "FILE", default_value = "cube.zarr", value_hint = ValueHint::AnyPath)]
    pub out: PathBuf,
}

/// A cube that was written.
#[derive(Clone, Debug, Serialize)]
pub struct WrittenCube {
    /// Its files.
    pub files: Vec<PathBuf>,
    /// What the values are.
    pub quantity: &'static str,
    /// Their unit.
    pub unit: &'static str,
    /// Columns and rows.
    pub size_px: [usize; 2],
    /// Middles of the bands, nm.
    pub wavelength_nm: Vec<f64>,
    /// The capture whose light it is.
    pub capture: Option<String>,
    /// Side of a pixel on what is seen, or on the film, mm.
    pub mm_per_pixel: Option<f64>,
}

/// Writes the light of one capture of a finished render, or a cube of another program, in the form that the name of the output tells.
///
/// # Errors
/// A name that tells no form; a source that can't be read; options that it does not have; a file that can't be written.
pub fn cube(options: &CubeOptions, job: &Job) -> Result<WrittenCube> {
    let form = CubeForm::of(&options.out).ok_or_else(|| {
        let hint = "end the name in .zarr, .hdr (ENVI), .mat (ISETCam), .ome.tiff, .exr or .npy";
        Error::Input(format!("⟨out={}⟩: the name tells no form; {hint}", options.out.display()))
    })?;
    let overrides = options.changes.overrides();
    let image = match options.image.is_dir() && CubeForm::of(&options.image) != Some(CubeForm::Zarr) {
        true => options.image.join("components.exr"),
        false => options.image.clone(),
    };
    let options = CubeOptions { image, ..options.clone() };
    if options.components {
        let _writing = job.listener.begin_writing(&options.out);
        return write_components(&options, form, &overrides);
    }
    let cube = match FinishedRender::open(&options.image) {
        Ok(render) => cube_of(&render, &options, &overrides, job)?,
        Err(error) => {
            let cube =
                read_cube(&options.image).map_err(|of_cube| match may_hold_components(&options.image) {
                    true => error,
                    false => of_cube.into(),
                })?;
            check_plain(&options, &overrides)?;
            warn_of_values_below_zero(&options.image, &cube, job);
            cube
        }
    };
    let _writing = job.listener.begin_writing(&options.out);
    write(&options, form, &cube)
}

/// Whether the source may be a component image, by its form, or what an OpenEXR file has.
fn may_hold_components(image: &Path) -> bool {
    match CubeForm::of(image) {
        Some(CubeForm::Envi | CubeForm::Iset | CubeForm::Zarr | CubeForm::OmeTiff) => false,
        Some(CubeForm::Exr) => is_component_exr(image),
        Some(CubeForm::Npy) => is_component_npy(image),
        _ => true,
    }
}

/// Tells of values below 0 of a cube of another program.
fn warn_of_values_below_zero(path: &Path, cube: &Cube, job: &Job) {
    let values = cube.light.values();
    let below = values.iter().filter(|value| **value < 0.0).count();
    if below > 0 {
        let (path, all) = (path.display(), values.len());
        job.warn(&[format!("{path}: {below} of {all} values are below 0; they are kept as noise").into()]);
    }
}

/// Refuses what only a component image has.
fn check_plain(options: &CubeOptions, overrides: &[Override]) -> Result<()> {
    let given = [
        (options.capture.as_ref().map(|name| format!("⟨capture={name}⟩"))),
        options.on_film.then(|| "⟨on_film⟩".to_owned()),
        overrides.first().map(Override::typed),
    ];
    match given.into_iter().flatten().next() {
        None => Ok(()),
        Some(given) => Err(Error::Input(format!(
            "{given}: {} holds one light; give the component image of a render, or leave the option out",
            options.image.display()
        ))),
    }
}

/// The light of a capture of a render.
fn cube_of(
    render: &FinishedRender,
    options: &CubeOptions,
    overrides: &[Override],
    job: &Job,
) -> Result<Cube> {
    warn_of_denoised(render, job);
    let labels = render.labels();
    let facts = CubeFacts {
        samples_per_pixel: Some(labels.samples_per_pixel),
        ..CubeFacts::of_maps(labels.features.clone(), [labels.width, labels.height])
    };
    let is_asked = options.capture.is_some() || options.on_film || !overrides.is_empty();
    // Renders of scenes of pbrt carry no experiment
    if !is_asked && !matches!(render.experiment(), Ok(Some(_))) {
        return Ok(Cube { light: all_light(options)?, facts });
    }
    let (text, parsed) = experiment_of(render, overrides)?;
    let shown = render.shown(&parsed).map_err(|error| as_typed_in_session(error, overrides))?;
    let ShownExperiment { experiment: ResolvedExperiment { mut study, record }, changes } = shown;
    keep_capture(&mut study, options)?;
    let (light, film_mm) = match study.captures.first() {
        None if overrides.is_empty() => (all_light(options)?, None),
        None => {
            return Err(Error::Input(format!(
                "{}: no capture has light, so the cube is all light as it was rendered and changes have no effect; leave them out, or add a \
                 [[capture]]",
                options.image.display()
            )));
        }
        Some(capture) => light_of(capture, &study, options, render.spectra(&study, &changes)?)?,
    };
    let seed = study.render.seed;
    let facts = CubeFacts {
        title: record.title,
        capture: study.captures.first().map(|capture| capture.frame.label.clone()),
        mm_per_pixel: film_mm.or(facts.mm_per_pixel),
        provenance: Some(Provenance::new(&text, record.resolved_toml, seed, labels.samples_per_pixel)),
        ..facts
    };
    Ok(Cube { light, facts })
}

/// The sum of all components as they were rendered.
fn all_light(options: &CubeOptions) -> Result<CubeLight> {
    let image = read_component_image(&options.image)?.image;
    Ok(CubeLight::Radiance(image.recombine(|_| 1.0)))
}

/// Light in a capture, and on the film the side of a pixel, mm.
fn light_of(
    capture: &Capture,
    study: &Study,
    options: &CubeOptions,
    spectra: Option<ComponentImage>,
) -> Result<(CubeLight, Option<f64>)> {
    let spectra = spectra.ok_or_else(|| {
        Error::Input(format!(
            "{}: the spectra of the image do not fit into render.memory_limit_gib; raise it with ⟨set=render.memory_limit_gib=8⟩",
            options.image.display()
        ))
    })?;
    if !options.on_film {
        return Ok((CubeLight::Radiance(frame_radiance(&capture.frame, &spectra)), None));
    }
    let (irradiance, film) = capture_irradiance(study, capture, &spectra)?;
    Ok((CubeLight::Irradiance(irradiance), Some(film.width_mm / spectra.width as f64)))
}

/// Keeps the capture of the options alone: the first one with light where they name none.
fn keep_capture(study: &mut Study, options: &CubeOptions) -> Result<()> {
    let captures = std::mem::take(&mut study.captures);
    let names: Vec<&str> = captures.iter().map(|capture| capture.frame.label.as_str()).collect();
    let is_lit = |capture: &Capture| capture.frame.lights.values().any(|drive| *drive > 0.0);
    let chosen = match &options.capture {
        Some(name) => {
            let found = names.iter().position(|known| known == name);
            Some(found.ok_or_else(|| {
                let known = if names.is_empty() { "none".into() } else { names.join(", ") };
                Error::Input(format!("⟨capture={name}⟩: there is no such capture; the captures are {known}"))
            })?)
        }
        None => captures.iter().position(is_lit),
    };
    if let (true, None) = (options.on_film, chosen) {
        return Err(Error::Input("⟨on_film⟩: the experiment has no capture with light".into()));
    }
    study.captures = chosen.map(|index| captures[index].clone()).into_iter().collect();
    Ok(())
}

/// Writes a component image with every component apart.
fn write_components(options: &CubeOptions, form: CubeForm, overrides: &[Override]) -> Result<WrittenCube> {
    if form != CubeForm::Zarr {
        let out = options.out.display();
        return Err(Error::Input(format!(
            "⟨out={out}⟩: components are kept apart in a .zarr only; name one"
        )));
    }
    check_plain(options, overrides)?;
    let loaded = read_component_image(&options.image)?;
    let ComponentImage { width, height, grid, features, samples_per_pixel, .. } = &loaded.image;
    let render = FinishedRender::open(&options.image)?;
    let title = render.experiment()?.map(|experiment| experiment.file.title.clone()).unwrap_or_default();
    let facts = CubeFacts {
        title,
        samples_per_pixel: Some(*samples_per_pixel),
        provenance: loaded.provenance,
        ..CubeFacts::of_maps(features.clone(), [*width, *height])
    };
    let bytes = 4 * (loaded.image.components.len() * grid.len() + 6) * width * height;
    let folder = OutputFolder::prepare(&options.out, std::slice::from_ref(&options.image), bytes as u64)?;
    write_component_zarr(folder.path(), &loaded.image, &facts).map_err(|error| folder.at_its_place(error))?;
    Ok(WrittenCube {
        files: vec![folder.finish()?],
        quantity: Radiance::NAME,
        unit: Radiance::UNIT,
        size_px: [*width, *height],
        wavelength_nm: grid.centers_nm(),
        capture: None,
        mm_per_pixel: facts.mm_per_pixel,
    })
}

fn write(options: &CubeOptions, form: CubeForm, cube: &Cube) -> Result<WrittenCube> {
    let (inputs, [width, height]) = (std::slice::from_ref(&options.image), cube.light.size());
    let bytes = 4 * (cube.light.values().len() + 6 * width * height) as u64;
    let files = form.files(&options.out, &cube.facts);
    if form == CubeForm::Zarr {
        let folder = OutputFolder::prepare(&options.out, inputs, bytes)?;
        form.write(folder.path(), cube).map_err(|error| folder.at_its_place(error))?;
        folder.finish()?;
    } else {
        let outputs = files.iter().fold(Outputs::new(), |all, file| all.and(Output::file("--out", file)));
        let set = outputs.reading(inputs).declare()?;
        form.write(&options.out, cube)?;
        set.finish()?;
    }
    let (quantity, unit) = match &cube.light {
        CubeLight::Radiance(_) => (Radiance::NAME, Radiance::UNIT),
        CubeLight::Irradiance(_) => (Irradiance::NAME, Irradiance::UNIT),
    };
    Ok(WrittenCube {
        files,
        quantity,
        unit,
        size_px: [width, height],
        wavelength_nm: cube.light.grid().centers_nm(),
        capture: cube.facts.capture.clone(),
        mm_per_pixel: cube.facts.mm_per_pixel,
    })
}

#[cfg(test)]
mod tests {
    use fluorspar::image::{Component, LightPath, SpectralImage};
    use fluorspar::spectral::{Reflectance, WavelengthGrid};
    use fluorspar_format::{ExrOptions, write_component_exr, write_spectral_exr};

    use super::*;

    /// Of other images the reader of cubes tells what is wrong.
    #[test]
    fn only_images_with_components_are_refused_as_such() {
        let folder = tempfile::tempdir().unwrap();
        let image = folder.path().join("i.exr");
        let grid = WavelengthGrid::uniform(400.0, 410.0, 5.0).unwrap();
        let reflectance = SpectralImage::<Reflectance>::zeros(grid.clone(), 2, 2);
        write_spectral_exr(&image, &reflectance, &ExrOptions::default()).unwrap();
        assert!(!may_hold_components(&image));
        let labels = vec![Component::of_group("blue", LightPath::Reflected)];
        let components = ComponentImage::zeros(grid, 2, 2, labels);
        write_component_exr(&image, &components, &ExrOptions::default()).unwrap();
        assert!(may_hold_components(&image));
    }
}
