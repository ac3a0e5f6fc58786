//! From the file of a design problem to the problem.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::OnceLock;

use fluorspar::design::{
    Assumptions, Budget, ContrastDefinition, Criterion, Design, DesignCamera, DesignProblem, ExcitationBasis,
    ExposedEye, FilterChoice, FineBands, LensChoice, LibraryError, LightChoice, Limits, LongPass,
    LongPassEdge, RegionModel, Split, WeightPrior, WhiteFrame,
};
use fluorspar::digest::sha256_hex;
use fluorspar::optics::IdealLens;
use fluorspar::sensor::{EXPOSURE_MS, Sensor, SensorModel, SpectralQe};
use fluorspar::spectral::{Curve, MAX_WAVELENGTH_NM, MIN_WAVELENGTH_NM, WavelengthGrid};

use super::regions::{Axes, BULK, cohort, region};
use super::renders::{DesignRenders, check_grid, observer, renders};
use super::schema::{
    ComparedDesignSection, ContrastSection, CriterionChoice, DesignFile, ExposureTotal, IdealBandsSection,
    LedSeriesSection, SearchSection, SensorChoiceSection, SensorSource, SplitChoice, SplitRule,
    TolerancesSection,
};
use crate::document::shape::Schema;
use crate::error::{ExperimentError, Message, Place, steps};
use crate::part_file::sensor::parse_sensor;
use crate::read::{read_document, typed};
use crate::resolve::context::{Context, Resolved, STRENGTH};
use crate::resolve::spectrum::Role;
use crate::resolve::{FileRecord, device, fluorophore};
use crate::schema::SpectrumReference;
use fluorspar_format::read_text_bounded;

/// Largest sensor file, bytes.
const MOST_SENSOR_BYTES: u64 = 1 << 20;
const WAVELENGTH_NM: [f64; 2] = [MIN_WAVELENGTH_NM, MAX_WAVELENGTH_NM];
const PRICE: [f64; 2] = [0.0, 1e12];
const MARGIN: [f64; 2] = [1e-3, 1e9];

/// A design of the file to compare the best with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ComparedDesign {
    /// Name.
    pub name: String,
    /// The design.
    pub design: Design,
}

/// A design problem read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct ResolvedDesign {
    /// What may be chosen, assumed and must be kept to.
    pub problem: DesignProblem,
    /// How it is searched.
    pub search: SearchSection,
    /// Tolerances of manufacture.
    pub tolerance: TolerancesSection,
    /// What of the problem must be rendered first; its regions are missing in `problem`.
    pub rendered: DesignRenders,
    /// Designs to compare the best with, at least one.
    pub compared: Vec<ComparedDesign>,
    /// Whether the file names these. If not, there is one: the first light, filter, sensor and so on.
    pub names_compared: bool,
    /// The file.
    pub record: FileRecord,
}

/// The shapes of a design file.
fn design_schema() -> &'static Schema {
    static SCHEMA: OnceLock<Schema> = OnceLock::new();
    SCHEMA.get_or_init(Schema::of::<DesignFile>)
}

/// Reads a design problem and solves the tissues of its regions. Overrides and paths are as for an experiment.
///
/// # Errors
/// The first defect found.
pub fn parse_design(
    text: &str,
    source_name: &str,
    base_dir: &Path,
    overrides: &[String],
) -> Result<ResolvedDesign, ExperimentError> {
    let schema = design_schema();
    let mut document = read_document(schema, text, source_name, base_dir, overrides)?;
    let file: DesignFile = typed(&mut document, schema)?;
    let mut context = Context::new(&document);
    let context = &mut context;
    let grid = device::grid(context, &file.spectral)?;
    check_search(context, &file)?;
    fluorophore::check_sections(context, &file.fluorophore)?;
    let mut lights = lights(context, &file, &grid)?;
    let mut rendered = renders(context, &file, &lights)?;
    check_grid(context, &grid, &rendered)?;
    give_power(&mut lights, &rendered);
    if !rendered.renders.is_empty() && lights.iter().any(|light| light.power_w <= 0.0) {
        let message = "surfaces that shine have no power that a light of the design could take over; put a light source in their place";
        return context.fail(&steps!["scene", "light_group"], message);
    }
    let filters = filters(context, &file, &grid)?;
    let (lens, lenses) = lenses(context, &file, &grid)?;
    rendered.lens_sr = lenses_at(context, &file, &lens, &rendered)?;
    let cameras = cameras(context, &file, &lens, &grid)?;
    let axes = Axes { grid: &grid, nodes_nm: nodes(context, &file)? };
    check_span(context, &lights, &axes);
    let regions = flat_regions(context, &file, &axes)?;
    let cohort = match &file.cohort {
        Some(section) => Some(cohort(context, &file, section, &axes)?),
        None => None,
    };
    let contrasts = contrasts(context, &file, &regions, &rendered)?;
    let problem = DesignProblem {
        criterion: criterion(context, &file, &contrasts)?,
        contrasts,
        cohort,
        lights,
        exposures: counts(context, &file)?,
        filters,
        cameras,
        lenses,
        drives: drives(context, &file)?,
        splits: splits(context, &file)?,
        budget: budget(context, &file)?,
        white: white(context, &file, &grid, &rendered)?,
        library: library(context, &file)?,
        assumptions: assumptions(context, &file)?,
        weights: weights(context, &file, &regions, &rendered)?,
        limits: limits(context, &file)?,
        eye: eye(context, &file, &rendered)?,
        tissue_safety_factor: file.limit.tissue_safety_factor,
        regions,
        geometries: Vec::new(),
    };
    let compared = compared(context, &file, &problem, &rendered.geometries)?;
    let failed =
        |error: toml::ser::Error| context.error(&[], format!("the file can't be written out: {error}"));
    let resolved_toml = crate::file_text(&file).map_err(failed)?;
    let mut nameless = file.clone();
    nameless.title.clear();
    nameless.description.clear();
    let own = context.digest(&nameless).map_err(failed)?;
    let of_renders = rendered.renders.iter().map(|render| render.record.sha256.clone());
    let sha256 = match rendered.renders.as_slice() {
        [] => own,
        _ => sha256_hex(std::iter::once(own).chain(of_renders)),
    };
    let record = FileRecord {
        title: file.title.clone(),
        description: file.description.clone(),
        output_folder: None,
        warnings: context.take_warnings(&grid),
        inputs: std::mem::take(&mut context.inputs),
        base_files: document.base_files.clone(),
        resolved_toml,
        experiment: None,
        sha256,
    };
    let names_compared = !file.compare.is_empty();
    Ok(ResolvedDesign {
        problem,
        search: file.search,
        tolerance: file.tolerance,
        rendered,
        compared,
        names_compared,
        record,
    })
}

/// The regions whose signals follow from their materials; those that are rendered come with the renders.
fn flat_regions(context: &mut Context<'_>, file: &DesignFile, axes: &Axes<'_>) -> Resolved<Vec<RegionModel>> {
    let mut regions = Vec::new();
    if file.region.is_empty() {
        return context.fail(
            &steps!["region"],
            "there is no region; add a [[region]] section with a name and a material",
        );
    }
    for (index, section) in file.region.iter().enumerate() {
        let at = steps!["region", index];
        let earlier = file.region[..index].iter().map(|other| other.name.as_str());
        context.unique_name(&at, &section.name, earlier)?;
        if section.rendered.is_none() {
            regions.push(region(context, &at, file, section, axes)?);
        } else if section.material.is_some() {
            return context
                .fail(&at.field("material"), "the region is rendered already; remove one of the two");
        } else if !section.apart.is_empty() {
            let message = "the region is rendered; give rendered = { apart = [...] } instead";
            return context.fail(&at.field("apart"), message);
        }
    }
    Ok(regions)
}

/// Checks the numbers of search and tolerances.
fn check_search(context: &Context<'_>, file: &DesignFile) -> Resolved<()> {
    let search = &file.search;
    let at = steps!["search"];
    context.whole_within(&at.field("most_exhaustive"), search.most_exhaustive, [1, 100_000_000])?;
    context.whole_within(&at.field("evaluations"), search.evaluations, [1, 10_000_000])?;
    context.whole_within(&at.field("keep"), u64::from(search.keep), [1, 10_000])?;
    let tolerance = &file.tolerance;
    for (field, value, range, unit) in [
        ("light_nm", tolerance.light_nm, [0.0, 50.0], "nm"),
        ("filter_nm", tolerance.filter_nm, [0.0, 50.0], "nm"),
        ("angle_deg", tolerance.angle_deg, [0.0, 60.0], "degrees"),
        ("effective_index", tolerance.effective_index, [1.0, 4.0], ""),
    ] {
        context.within(&steps!["tolerance", field], value, range, unit)?;
    }
    Ok(())
}

/// Nodes of the excitation.
fn nodes(context: &Context<'_>, file: &DesignFile) -> Resolved<Vec<f64>> {
    let section = &file.excitation;
    let at = steps!["excitation"];
    let first = context.within(&at.field("first_nm"), section.first_nm, WAVELENGTH_NM, "nm")?;
    let last = context.within(&at.field("last_nm"), section.last_nm, WAVELENGTH_NM, "nm")?;
    let step = context.within(&at.field("step_nm"), section.step_nm, [0.5, 20.0], "nm")?;
    if last <= first {
        return context.fail(&at.field("last_nm"), "must be above first_nm");
    }
    Ok(ExcitationBasis::every(first, last, step).centers_nm())
}

/// Warns of lights that reach beyond the nodes of the excitation: what they excite there is left out.
fn check_span(context: &mut Context<'_>, lights: &[LightChoice], axes: &Axes<'_>) {
    const MOST_OUTSIDE: f64 = 0.01;
    let basis = ExcitationBasis::Nodes(axes.nodes_nm.clone());
    let outside = |light: &&LightChoice| basis.share_outside(&light.spectrum) > MOST_OUTSIDE;
    let names: Vec<&str> = lights.iter().filter(outside).map(|light| light.name.as_str()).collect();
    if !names.is_empty() {
        let [first, last] = basis.span_nm();
        let message = format!(
            "more than 1 % of these lights lies outside {first} to {last} nm, and what it excites is left out: {}; widen \
             first_nm and last_nm",
            names.join(", ")
        );
        context.warn(&steps!["excitation"], message);
    }
}

/// A spectrum behind its filters, of unit power.
fn filtered_light(
    context: &mut Context<'_>,
    at: &Place,
    spectrum: &SpectrumReference,
    filters: &[SpectrumReference],
    grid: &WavelengthGrid,
) -> Resolved<Curve> {
    let mut curve = context.spectrum(&at.field("spectrum"), spectrum, Role::Light, 0.0, grid)?;
    for (index, filter) in filters.iter().enumerate() {
        let at = at.field("filters").index(index);
        curve = curve.times(&context.spectrum(&at, filter, Role::Filter, 0.0, grid)?);
    }
    let power = curve.total();
    if power <= 0.0 {
        return context.fail(at, "no light passes the filters of this light; check spectrum and filters");
    }
    Ok(trimmed(&curve.scaled(1.0 / power)))
}

/// The part of a curve that holds all but 1e-9 of its largest value: products over it cost less.
fn trimmed(curve: &Curve) -> Curve {
    let floor = 1e-9 * curve.max();
    let bright: Vec<f64> = curve
        .wavelengths_nm()
        .iter()
        .zip(curve.values())
        .filter(|(_, v)| **v > floor)
        .map(|(nm, _)| *nm)
        .collect();
    match (bright.first(), bright.last()) {
        (Some(&first), Some(&last)) if last > first => curve.clipped(first - 1.0, last + 1.0),
        _ => curve.clone(),
    }
}

/// Power of a light in a scene, W; 0 where none is given.
fn power_w(context: &Context<'_>, at: &Place, power_mw: Option<f64>) -> Resolved<f64> {
    let checked = power_mw.map(|mw| context.within(&at.field("power_mw"), mw, STRENGTH, "mW"));
    Ok(checked.transpose()?.unwrap_or(0.0) * 1e-3)
}

/// Gives lights without a power that of the light whose place they take.
fn give_power(lights: &mut [LightChoice], rendered: &DesignRenders) {
    let own = rendered.own_power_w().unwrap_or(0.0);
    lights.iter_mut().filter(|light| light.power_w == 0.0).for_each(|light| light.power_w = own);
}

fn lights(context: &mut Context<'_>, file: &DesignFile, grid: &WavelengthGrid) -> Resolved<Vec<LightChoice>> {
    let mut lights = Vec::new();
    for (index, section) in file.light.iter().enumerate() {
        let at = steps!["light", index];
        context.unique_name(
            &at,
            &section.name,
            file.light[..index].iter().map(|other| other.name.as_str()),
        )?;
        let irradiance = section.irradiance_w_per_m2;
        context.within(&at.field("irradiance_w_per_m2"), irradiance, STRENGTH, "W/m²")?;
        let spectrum = filtered_light(context, &at, &section.spectrum, &section.filters, grid)?;
        lights.push(LightChoice {
            name: section.name.clone(),
            peak_nm: spectrum.peak_nm(),
            spectrum,
            light: irradiance,
            power_w: power_w(context, &at, section.power_mw)?,
            cost: context.within(&at.field("cost"), section.cost, PRICE, "")?,
        });
    }
    if let Some(series) = &file.led {
        lights.extend(led_series(context, series)?);
    }
    lights.sort_by(|a, b| a.peak_nm.total_cmp(&b.peak_nm));
    for (index, light) in lights.iter().enumerate() {
        if lights[..index].iter().any(|other| other.name == light.name) {
            let message = format!("two lights are called \"{}\"; rename one of them", light.name);
            return context.fail(&steps!["light"], message);
        }
    }
    if lights.is_empty() {
        return context.fail(
            &steps!["light"],
            "there is no light to choose from; add [[light]] sections, or a series: [led] with peaks_nm = [365, 385, 405]",
        );
    }
    Ok(lights)
}

/// Gaussian LEDs, each behind a short-pass filter if one is wanted.
fn led_series(context: &Context<'_>, series: &LedSeriesSection) -> Resolved<Vec<LightChoice>> {
    let at = steps!["led"];
    let width = context.within(&at.field("fwhm_nm"), series.fwhm_nm, [1.0, 100.0], "nm")?;
    let light =
        context.within(&at.field("irradiance_w_per_m2"), series.irradiance_w_per_m2, STRENGTH, "W/m²")?;
    let cost = context.within(&at.field("cost"), series.cost, PRICE, "")?;
    let power_w = power_w(context, &at, series.power_mw)?;
    if let Some(edge) = series.short_pass_after_peak_nm {
        context.within(&at.field("short_pass_after_peak_nm"), edge, [1.0, 200.0], "nm")?;
    }
    let short_pass = |nm: f64, peak_nm: f64| match series.short_pass_after_peak_nm {
        Some(edge) => 1e-5 + 1.0 / (1.0 + ((nm - peak_nm - edge) * 2.0 * 9f64.ln() / 5.0).exp()),
        None => 1.0,
    };
    let mut lights = Vec::new();
    for (index, &peak_nm) in series.peaks_nm.iter().enumerate() {
        let at = at.field("peaks_nm").index(index);
        context.within(&at, peak_nm, [250.0, 1100.0], "nm")?;
        let gaussian = |nm: f64| (-4.0 * std::f64::consts::LN_2 * ((nm - peak_nm) / width).powi(2)).exp();
        let reach = 3.0 * width;
        let curve =
            Curve::from_fn(peak_nm - reach, peak_nm + reach, |nm| gaussian(nm) * short_pass(nm, peak_nm));
        let spectrum = curve.scaled(1.0 / curve.total());
        lights.push(LightChoice { name: format!("{peak_nm} nm"), spectrum, light, power_w, peak_nm, cost });
    }
    Ok(lights)
}

fn filters(
    context: &mut Context<'_>,
    file: &DesignFile,
    grid: &WavelengthGrid,
) -> Resolved<Vec<FilterChoice>> {
    let mut choices = Vec::new();
    for (index, section) in file.view_filter.iter().enumerate() {
        let at = steps!["view_filter", index];
        let earlier = file.view_filter[..index].iter().map(|other| other.name.as_str());
        context.unique_name(&at, &section.name, earlier)?;
        let fixed = stack(context, &at, &section.filters, grid)?;
        let width_nm =
            context.within(&at.field("edge_width_nm"), section.edge_width_nm, [0.1, 100.0], "nm")?;
        let density =
            context.within(&at.field("optical_density"), section.optical_density, [0.0, 12.0], "")?;
        let cost = context.within(&at.field("cost"), section.cost, PRICE, "")?;
        let mut add = |name: String, edge: Option<LongPassEdge>| {
            let long_pass = edge.map(|edge| LongPass { edge, width_nm, optical_density: density });
            choices.push(FilterChoice { name, fixed: fixed.clone(), long_pass, cost });
        };
        for (number, &nm) in section.long_pass_nm.iter().enumerate() {
            context.within(&at.field("long_pass_nm").index(number), nm, WAVELENGTH_NM, "nm")?;
            add(format!("{} {nm} nm", section.name), Some(LongPassEdge::At(nm)));
        }
        for (number, &nm) in section.long_pass_after_peak_nm.iter().enumerate() {
            context.within(&at.field("long_pass_after_peak_nm").index(number), nm, [0.0, 400.0], "nm")?;
            add(format!("{} peak + {nm} nm", section.name), Some(LongPassEdge::AfterPeak(nm)));
        }
        if section.long_pass_nm.is_empty() && section.long_pass_after_peak_nm.is_empty() {
            add(section.name.clone(), None);
        }
    }
    if choices.is_empty() {
        let fixed = Curve::constant(1.0);
        choices.push(FilterChoice { name: "no filter".into(), fixed, long_pass: None, cost: 0.0 });
    }
    Ok(choices)
}

fn lenses(
    context: &mut Context<'_>,
    file: &DesignFile,
    grid: &WavelengthGrid,
) -> Resolved<(IdealLens, Vec<LensChoice>)> {
    let (section, at) = (&file.lens, steps!["lens"]);
    let transmittance =
        context.spectrum(&at.field("transmittance"), &section.transmittance, Role::Filter, 0.0, grid)?;
    let mut lens = IdealLens::new(section.focal_length_mm, 4.0);
    lens.object_distance_mm = section.distance_mm;
    lens.transmittance = transmittance;
    let field = |name: &'static str| if name == "object_distance_mm" { "distance_mm" } else { name };
    let mut choices = Vec::new();
    for (index, &f_number) in section.f_numbers.iter().enumerate() {
        let stopped = IdealLens { f_number, ..lens.clone() };
        if let Err(problem) = stopped.validate() {
            let at = match problem.field {
                "f_number" => at.field("f_numbers").index(index),
                name => at.field(field(name)),
            };
            return context.fail(&at, problem.message);
        }
        choices.push(LensChoice::new(&lens, f_number));
    }
    if choices.is_empty() {
        return context.fail(&at.field("f_numbers"), "give at least one f-number");
    }
    Ok((lens, choices))
}

/// Solid angles of all apertures at the working distance of each geometry, sr.
fn lenses_at(
    context: &Context<'_>,
    file: &DesignFile,
    lens: &IdealLens,
    rendered: &DesignRenders,
) -> Resolved<Vec<Vec<f64>>> {
    let section = file.geometry.iter().position(|section| !section.working_distance_mm.is_empty());
    let mut found = Vec::with_capacity(rendered.distances_mm.len());
    for distance in &rendered.distances_mm {
        let Some(distance_mm) = *distance else {
            found.push(Vec::new());
            continue;
        };
        let focused = IdealLens { object_distance_mm: Some(distance_mm), ..lens.clone() };
        if let Err(problem) = focused.validate() {
            let at = steps!["geometry", section.unwrap_or(0)].field("working_distance_mm");
            return context.fail(&at, format!("{distance_mm} mm: {}", problem.message));
        }
        let solid_angle = |f_number: &f64| LensChoice::new(&focused, *f_number).solid_angle_sr;
        found.push(file.lens.f_numbers.iter().map(solid_angle).collect());
    }
    Ok(found)
}

fn cameras(
    context: &mut Context<'_>,
    file: &DesignFile,
    lens: &IdealLens,
    grid: &WavelengthGrid,
) -> Resolved<Vec<DesignCamera>> {
    let bands = FineBands::of(grid);
    let mut cameras = Vec::new();
    for (index, section) in file.sensor.iter().enumerate() {
        let at = steps!["sensor", index];
        context.unique_name(
            &at,
            &section.name,
            file.sensor[..index].iter().map(|other| other.name.as_str()),
        )?;
        let gain = context.within(&at.field("gain"), section.gain, [0.01, 1000.0], "")?;
        let cost = context.within(&at.field("cost"), section.cost, PRICE, "")?;
        let mut sensor = sensor(context, &at, section)?;
        for (number, filter) in section.filters.iter().enumerate() {
            let at = at.field("filters").index(number);
            sensor = sensor.behind(&context.spectrum(&at, filter, Role::Filter, 0.0, grid)?);
        }
        let mut camera = DesignCamera::new(&section.name, &sensor, gain, &lens.transmittance, &bands);
        if !section.wheel.is_empty() {
            camera = with_wheel(context, &at, section, &camera, &bands, grid)?;
        }
        camera.cost = cost;
        cameras.push(camera);
    }
    if cameras.is_empty() {
        let message = "there is no sensor to choose from; add a [[sensor]] section with a name and preset, file or bands";
        return context.fail(&steps!["sensor"], message);
    }
    Ok(cameras)
}

/// A camera of one channel behind the wheel of a section.
fn with_wheel(
    context: &mut Context<'_>,
    at: &Place,
    section: &SensorChoiceSection,
    camera: &DesignCamera,
    bands: &FineBands,
    grid: &WavelengthGrid,
) -> Resolved<DesignCamera> {
    let mut wheel: Vec<(String, Curve)> = Vec::new();
    for (index, position) in section.wheel.iter().enumerate() {
        let at = at.field("wheel").index(index);
        context.unique_name(&at, &position.name, wheel.iter().map(|(name, _)| name.as_str()))?;
        let transmittance = stack(context, &at, &position.filters, grid)?;
        wheel.push((position.name.clone(), transmittance));
    }
    match camera.behind_wheel(&wheel, bands) {
        Some(camera) => Ok(camera),
        None => {
            let message = format!(
                "a wheel stands before a sensor of one channel; this one has {}: {}. Give a monochrome sensor",
                camera.channels.len(),
                camera.channels.join(", ")
            );
            context.fail(&at.field("wheel"), message)
        }
    }
}

/// Transmittance of all `filters` of a section together.
fn stack(
    context: &mut Context<'_>,
    at: &Place,
    filters: &[SpectrumReference],
    grid: &WavelengthGrid,
) -> Resolved<Curve> {
    let mut transmittance = Curve::constant(1.0);
    for (number, filter) in filters.iter().enumerate() {
        let at = at.field("filters").index(number);
        transmittance = transmittance.times(&context.spectrum(&at, filter, Role::Filter, 0.0, grid)?);
    }
    Ok(transmittance)
}

/// The sensor of a section.
fn sensor(context: &mut Context<'_>, at: &Place, section: &SensorChoiceSection) -> Resolved<Sensor> {
    let (text, name, folder, field) = match &section.source {
        SensorSource::Preset { preset } => {
            let text = format!("format = 1\n[sensor]\npreset = {}\n", toml::Value::String(preset.clone()));
            (text, format!("sensor \"{preset}\""), Path::new(".").to_path_buf(), "preset")
        }
        SensorSource::File { file } => {
            let at = at.field("file");
            context.note_input(&at, file)?;
            let path: &Path = file.as_ref();
            let text = read_text_bounded(path, MOST_SENSOR_BYTES)
                .map_err(|error| context.file_error(&at, &error))?;
            let folder = path.parent().unwrap_or(Path::new(".")).to_path_buf();
            (text, path.display().to_string(), folder, "file")
        }
        SensorSource::Bands { bands } => return ideal_bands(context, &at.field("bands"), bands),
    };
    match parse_sensor(&text, &name, &folder, &[]) {
        Ok(resolved) => Ok(resolved.sensor),
        Err(error) => context.fail(&at.field(field), error.to_string()),
    }
}

/// A sensor of Gaussian bands with read noise and nothing else.
fn ideal_bands(context: &Context<'_>, at: &Place, section: &IdealBandsSection) -> Resolved<Sensor> {
    let (centers, sigmas) = (&section.centers_nm, &section.sigma_nm);
    if centers.is_empty() {
        return context.fail(&at.field("centers_nm"), "give at least one center");
    }
    if sigmas.len() != 1 && sigmas.len() != centers.len() {
        let message = format!("give one width for all bands, or one for each of the {}", centers.len());
        return context.fail(&at.field("sigma_nm"), message);
    }
    let peak = context.within(&at.field("peak"), section.peak, [1e-6, 1.0], "")?;
    let mut curves = Vec::new();
    for (index, &center_nm) in centers.iter().enumerate() {
        context.within(&at.field("centers_nm").index(index), center_nm, WAVELENGTH_NM, "nm")?;
        let number = index.min(sigmas.len() - 1);
        let sigma =
            context.within(&at.field("sigma_nm").index(number), sigmas[number], [0.5, 200.0], "nm")?;
        let bell = |nm: f64| peak * (-0.5 * ((nm - center_nm) / sigma).powi(2)).exp();
        curves.push((format!("{center_nm}"), Curve::from_fn(MIN_WAVELENGTH_NM, MAX_WAVELENGTH_NM, bell)));
    }
    let names: Vec<String> = curves.iter().map(|(name, _)| name.clone()).collect();
    let full_e = context.within(&at.field("full_well_e"), section.full_well_e, [1.0, 1e9], "e-")?;
    let read_e = context.within(&at.field("read_noise_e"), section.read_noise_e, [0.0, 1e6], "e-")?;
    let model = SensorModel {
        columns: names.len(),
        rows: 1,
        mosaic: vec![names],
        pixel_size_um: context.within(&at.field("pixel_size_um"), section.pixel_size_um, [0.1, 1e3], "um")?,
        fill_factor: 1.0,
        well_capacity_e: full_e,
        read_noise_mv: None,
        read_noise_e: Some(read_e),
        dsnu_mv: None,
        dsnu_e: Some(0.0),
        dark_voltage_mv_per_s: None,
        dark_current_e_per_s: Some(0.0),
        prnu_percent: 0.0,
        bit_depth: 16,
        black_level_dn: 0.0,
        ..SensorModel::default()
    };
    let problem = |message: String| context.error(at, message);
    let qe = SpectralQe::from_curves(curves).map_err(|error| problem(error.message))?;
    Sensor::new(model, qe).map_err(|error| problem(error.message))
}

fn counts(context: &Context<'_>, file: &DesignFile) -> Resolved<Vec<usize>> {
    let at = steps!["exposure", "counts"];
    for (index, &count) in file.exposure.counts.iter().enumerate() {
        context.whole_within(&at.index(index), u64::from(count), [1, 6])?;
    }
    if file.exposure.counts.is_empty() {
        return context.fail(&at, "give at least one number of exposures");
    }
    Ok(file.exposure.counts.iter().map(|&count| count as usize).collect())
}

fn drives(context: &Context<'_>, file: &DesignFile) -> Resolved<Vec<f64>> {
    let at = steps!["exposure", "drives"];
    if file.exposure.drives.is_empty() {
        return context.fail(&at, "give at least one factor");
    }
    let checked = |(index, &drive): (usize, &f64)| context.within(&at.index(index), drive, [1e-6, 1e6], "");
    file.exposure.drives.iter().enumerate().map(checked).collect()
}

fn splits(context: &Context<'_>, file: &DesignFile) -> Resolved<Vec<Split>> {
    let at = steps!["exposure", "splits"];
    if file.exposure.splits.is_empty() {
        return context.fail(&at, "give at least one, for instance \"equal_time\"");
    }
    let split = |(index, choice): (usize, &SplitChoice)| match *choice {
        SplitChoice::Rule(SplitRule::EqualTime) => Ok(Split::EqualTime),
        SplitChoice::Rule(SplitRule::EqualElectrons) => Ok(Split::EqualElectrons),
        SplitChoice::First(share) => {
            let hint = "the share of the time for the first exposure";
            context.within(&at.index(index), share, [0.001, 0.999], hint).map(Split::First)
        }
    };
    file.exposure.splits.iter().enumerate().map(split).collect()
}

fn budget(context: &Context<'_>, file: &DesignFile) -> Resolved<Budget> {
    let at = |field: &str| steps!["exposure", "total", field];
    match file.exposure.total {
        ExposureTotal::Time { ms } => {
            let range = [1e-3, EXPOSURE_MS[1]];
            context.within(&at("ms"), ms, range, "milliseconds").map(|ms| Budget::Time(ms * 1e-3))
        }
        ExposureTotal::Electrons { electrons } => {
            context.within(&at("electrons"), electrons, [1.0, 1e12], "electrons").map(Budget::Electrons)
        }
    }
}

fn white(
    context: &mut Context<'_>,
    file: &DesignFile,
    grid: &WavelengthGrid,
    rendered: &DesignRenders,
) -> Resolved<Option<WhiteFrame>> {
    let Some(section) = &file.exposure.white else { return Ok(None) };
    let at = steps!["exposure", "white"];
    let light =
        context.within(&at.field("irradiance_w_per_m2"), section.irradiance_w_per_m2, STRENGTH, "W/m²")?;
    let level = context.within(&at.field("level"), section.level, [0.001, 1.0], "of what a pixel holds")?;
    let cost = context.within(&at.field("cost"), section.cost, PRICE, "")?;
    let spectrum = filtered_light(context, &at, &section.spectrum, &[], grid)?;
    let filter = stack(context, &at, &section.filters, grid)?;
    let peak_nm = spectrum.peak_nm();
    let power_w = power_w(context, &at, section.power_mw)?;
    let mut light = [LightChoice { name: "white".into(), spectrum, light, power_w, peak_nm, cost }];
    give_power(&mut light, rendered);
    let [light] = light;
    Ok(Some(WhiteFrame { light, filter, level }))
}

fn library(context: &Context<'_>, file: &DesignFile) -> Resolved<LibraryError> {
    let unknown = &file.unknown;
    let within = |field: &'static str, value, range, unit| {
        context.within(&steps!["unknown", field], value, range, unit)
    };
    Ok(LibraryError {
        emission_shift_nm: within("emission_shift_nm", unknown.emission_shift_nm, [0.0, 100.0], "nm")?,
        excitation_shift_nm: within("excitation_shift_nm", unknown.excitation_shift_nm, [0.0, 100.0], "nm")?,
        shape: within("spectrum", unknown.spectrum, [0.0, 1.0], "")?,
        correlation_nm: within("correlation_nm", unknown.correlation_nm, [5.0, 500.0], "nm")?,
    })
}

fn assumptions(context: &Context<'_>, file: &DesignFile) -> Resolved<Assumptions> {
    let unknown = &file.unknown;
    let within =
        |field: &'static str, value, range| context.within(&steps!["unknown", field], value, range, "");
    within("tissue", unknown.tissue, [0.0, 10.0])?;
    within("blood_um", unknown.blood_um, [0.0, 1000.0])?;
    Ok(Assumptions {
        gain: within("gain", unknown.gain, [0.0, 10.0])?,
        drive: within("drive", unknown.drive, [0.0, 10.0])?,
        leak: within("leak", unknown.leak, [0.0, 10.0])?,
        pixels: within("pixels", unknown.pixels, [1.0, 1e9])?,
        brightest_fluorescence: within("brightest_fluorescence", unknown.brightest_fluorescence, [1.0, 1e6])?,
        brightest_reflection: within("brightest_reflection", unknown.brightest_reflection, [1.0, 1e6])?,
    })
}

/// Priors of weights, of fluorophores that some region holds.
fn weights(
    context: &Context<'_>,
    file: &DesignFile,
    regions: &[fluorspar::design::RegionModel],
    rendered: &DesignRenders,
) -> Resolved<Vec<WeightPrior>> {
    let known = known_weights(regions, rendered);
    let at = steps!["unknown", "weights"];
    let mut found = Vec::with_capacity(file.unknown.weights.len());
    for (name, &relative) in &file.unknown.weights {
        let at = at.field(name);
        if !known.contains(&name.as_str()) {
            let message = Message::unknown("no region holds this fluorophore", name, known.iter().copied());
            return context.fail(&at, message);
        }
        context.within(&at, relative, [1e-6, 1e6], "of the amount that the region holds")?;
        found.push(WeightPrior { fluorophore: name.clone(), relative });
    }
    Ok(found)
}

/// Names of all weights that regions may have.
fn known_weights<'a>(
    regions: &'a [fluorspar::design::RegionModel],
    rendered: &'a DesignRenders,
) -> Vec<&'a str> {
    let mut known: BTreeSet<&str> = BTreeSet::new();
    for region in regions {
        known.extend(region.response.fluorescence.iter().map(|f| f.name.as_str()));
    }
    for render in &rendered.renders {
        known.extend(render.study.scene.fluorophores.iter().map(|f| f.name.as_str()));
    }
    if rendered.regions.iter().any(|region| !region.apart.is_empty()) {
        known.insert(BULK);
    }
    known.into_iter().collect()
}

/// An eye before flat regions. Those of rendered scenes are in their renders.
fn eye(context: &Context<'_>, file: &DesignFile, rendered: &DesignRenders) -> Resolved<Option<ExposedEye>> {
    let at = steps!["eye"];
    if !rendered.renders.is_empty() {
        if rendered.renders.iter().any(|render| render.eye.is_none()) && file.limit.eye_margin.is_some() {
            let message = "the place of the eye is not known; give eye.distance_mm, or safety.patient_eye_distance_mm in the scene";
            return context.fail(&steps!["limit", "eye_margin"], message);
        }
        return Ok(None);
    }
    let Some(section) = &file.eye else {
        if file.limit.eye_margin.is_some() {
            let message = "no eye is described; add [eye] with source_mrad, the angle that the light source subtends for it";
            return context.fail(&steps!["limit", "eye_margin"], message);
        }
        return Ok(None);
    };
    if section.distance_mm.is_some() {
        let message = "flat regions have no place; give source_mrad and irradiance_share instead";
        return context.fail(&at.field("distance_mm"), message);
    }
    let Some(source_mrad) = section.source_mrad else {
        let message =
            "give the angle that the light source subtends for the eye, mrad: its diameter over its distance";
        return context.fail(&at.field("source_mrad"), message);
    };
    let source_mrad = context.within(&at.field("source_mrad"), source_mrad, [0.1, 3000.0], "mrad")?;
    let share = section.irradiance_share.unwrap_or(1.0);
    let share = context.within(&at.field("irradiance_share"), share, [1e-6, 1e6], "")?;
    Ok(Some(ExposedEye::before_source(share, 1e-3 * source_mrad, observer(section.aphakic))))
}

fn limits(context: &mut Context<'_>, file: &DesignFile) -> Resolved<Limits> {
    let limit = &file.limit;
    let within = |field: &'static str, value: Option<f64>, range| {
        value.map(|value| context.within(&steps!["limit", field], value, range, "")).transpose()
    };
    within("tissue_safety_factor", Some(limit.tissue_safety_factor), [1.0, 1000.0])?;
    let former = within("safety_margin", limit.safety_margin, MARGIN)?;
    if former.is_some() && limit.tissue_margin.is_some() {
        let message = "it is the former name of tissue_margin, which is given, too; remove it";
        return context.fail(&steps!["limit", "safety_margin"], message);
    }
    let found = Limits {
        tissue_margin: within("tissue_margin", limit.tissue_margin, MARGIN)?.or(former),
        eye_margin: within("eye_margin", limit.eye_margin, MARGIN)?,
        leak: within("leak", limit.leak, [0.0, 1e6])?,
        saturation: within("saturation", Some(limit.saturation), [1e-6, 1e6])?,
        time_s: within("total_ms", limit.total_ms, [1e-6, 1e9])?.map(|ms| ms * 1e-3),
        cost: within("cost", limit.cost, PRICE)?,
    };
    if former.is_some() {
        let message = "it is called tissue_margin now, beside eye_margin, and means what it meant";
        context.warn(&steps!["limit", "safety_margin"], message);
    }
    Ok(found)
}

/// Contrasts whose names are of fluorophores that some region holds.
fn contrasts(
    context: &Context<'_>,
    file: &DesignFile,
    regions: &[fluorspar::design::RegionModel],
    rendered: &DesignRenders,
) -> Resolved<Vec<ContrastDefinition>> {
    let known = known_weights(regions, rendered);
    let mut found = Vec::new();
    for (index, section) in file.contrast.iter().enumerate() {
        let at = steps!["contrast", index];
        context.unique_name(
            &at,
            &section.name,
            file.contrast[..index].iter().map(|other| other.name.as_str()),
        )?;
        for (field, names) in [("part", &section.part), ("whole", &section.whole)] {
            check_held(context, &at.field(field), names, &known)?;
        }
        if section.part.is_empty() {
            return context.fail(&at.field("part"), "give at least one fluorophore");
        }
        found.push(definition(section, &known));
    }
    Ok(found)
}

/// Checks that some region holds each of some fluorophores.
fn check_held(context: &Context<'_>, at: &Place, names: &[String], known: &[&str]) -> Resolved<()> {
    let unknown = names.iter().enumerate().find(|(_, name)| !known.contains(&name.as_str()));
    let Some((number, name)) = unknown else { return Ok(()) };
    let message = Message::unknown("no region holds this fluorophore", name, known.iter().copied());
    context.fail(&at.index(number), message)
}

fn definition(section: &ContrastSection, known: &[&str]) -> ContrastDefinition {
    let all = || known.iter().map(|name| (*name).to_owned()).collect();
    let whole = if section.whole.is_empty() { all() } else { section.whole.clone() };
    ContrastDefinition { name: section.name.clone(), part: section.part.clone(), whole }
}

fn criterion(
    context: &Context<'_>,
    file: &DesignFile,
    contrasts: &[ContrastDefinition],
) -> Resolved<Criterion> {
    let at = steps!["criterion"];
    Ok(match file.criterion {
        CriterionChoice::Minimax => Criterion::Minimax,
        CriterionChoice::D => Criterion::D,
        CriterionChoice::A => Criterion::A,
        CriterionChoice::E => Criterion::E,
        CriterionChoice::Detection if file.cohort.is_none() => {
            let message = "there is no cohort to tell apart; add [cohort] with a tissue and a state";
            return context.fail(&at, message);
        }
        CriterionChoice::Detection => Criterion::Detection,
        CriterionChoice::Leak => Criterion::Leak,
        CriterionChoice::Contrast => {
            let wanted = file.criterion_contrast.as_deref();
            let number =
                contrasts.iter().position(|contrast| wanted.is_none_or(|name| contrast.name == name));
            let Some(number) = number else {
                let names: Vec<&str> = contrasts.iter().map(|contrast| contrast.name.as_str()).collect();
                let message = match wanted {
                    Some(_) if !names.is_empty() => {
                        return context.fail(
                            &steps!["criterion_contrast"],
                            format!("there is no such contrast; known: {}", names.join(", ")),
                        );
                    }
                    _ => "there is no contrast; add a [[contrast]] section with a name and its part",
                };
                return context.fail(&at, message);
            };
            Criterion::Contrast(number)
        }
    })
}

/// Designs of the file by number; without any the first choice of everything.
fn compared(
    context: &Context<'_>,
    file: &DesignFile,
    problem: &DesignProblem,
    geometries: &[String],
) -> Resolved<Vec<ComparedDesign>> {
    let mut found = Vec::new();
    for (index, section) in file.compare.iter().enumerate() {
        let at = steps!["compare", index];
        context.unique_name(
            &at,
            &section.name,
            file.compare[..index].iter().map(|other| other.name.as_str()),
        )?;
        found.push(ComparedDesign {
            name: section.name.clone(),
            design: by_names(context, &at, section, problem, geometries)?,
        });
    }
    if found.is_empty() {
        let lights = (0..problem.exposures.iter().copied().min().unwrap_or(1)).collect();
        let design = Design { lights, filter: 0, camera: 0, lens: 0, drive: 0, split: 0, geometry: 0 };
        found.push(ComparedDesign { name: "first choices".into(), design });
    }
    Ok(found)
}

fn by_names(
    context: &Context<'_>,
    at: &Place,
    section: &ComparedDesignSection,
    problem: &DesignProblem,
    geometries: &[String],
) -> Resolved<Design> {
    let find = |at: &Place, wanted: &str, known: Vec<&str>| -> Resolved<usize> {
        if let Some(number) = known.iter().position(|name| *name == wanted) {
            return Ok(number);
        }
        context.fail(at, Message::unknown("there is no such choice", wanted, known))
    };
    let mut lights = Vec::new();
    for (index, name) in section.lights.iter().enumerate() {
        let known = problem.lights.iter().map(|light| light.name.as_str()).collect();
        lights.push(find(&at.field("lights").index(index), name, known)?);
    }
    lights.sort_unstable();
    lights.dedup();
    if lights.len() != section.lights.len() || !problem.exposures.contains(&lights.len()) {
        let counts: Vec<String> = problem.exposures.iter().map(ToString::to_string).collect();
        let message =
            format!("name different lights, as many as exposure.counts allows: {}", counts.join(" or "));
        return context.fail(&at.field("lights"), message);
    }
    let filter = section.view_filter.as_ref().map_or(Ok(0), |name| {
        find(
            &at.field("view_filter"),
            name,
            problem.filters.iter().map(|filter| filter.name.as_str()).collect(),
        )
    })?;
    let camera = section.sensor.as_ref().map_or(Ok(0), |name| {
        find(&at.field("sensor"), name, problem.cameras.iter().map(|camera| camera.name.as_str()).collect())
    })?;
    let lens = match section.f_number {
        None => 0,
        Some(f_number) => match problem.lenses.iter().position(|lens| lens.f_number == f_number) {
            Some(number) => number,
            None => return context.fail(&at.field("f_number"), "is not among lens.f_numbers; add it there"),
        },
    };
    let geometry = section.geometry.as_ref().map_or(Ok(0), |name| {
        find(&at.field("geometry"), name, geometries.iter().map(String::as_str).collect())
    })?;
    Ok(Design { lights, filter, camera, lens, drive: 0, split: 0, geometry })
}
