//! Wavelengths, render settings, camera, lens and sensor.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::context::{Context, LENGTH_MM, Resolved};
use super::spectrum::Role;
use crate::error::{Place, steps};
use crate::preset::{self, PresetKind};
use crate::schema::{
    CameraSection, EdgeBins, EfficiencyColumns, EfficiencyReference, ExperimentFile, FilePath, FilterAngles,
    FilterPosition, ImageFormation, LensOrNumber, LensSection, NameOrFile, NameOrTable, RenderSection,
    SensorSection, SpectralSection, SpectrumReference, SpectrumTable, TableUnit, TracedLensSection,
    UniformBins, ViewFilterSection, is_file_name,
};
use fluorspar::image::StatisticsKind;
use fluorspar::optics::{
    Aperture, CameraLens, FilterAutofluorescence, FilterStack, IdealLens, LensSetting, LensState, Paraxial,
    PerspectiveCamera, Vignetting,
};
use fluorspar::render::{BasisSettings, Estimator, RenderSettings, choose_basis};
use fluorspar::scene::Scene;
use fluorspar::sensor::{Sensor, SensorModel, SpectralQe};
use fluorspar::spectral::{Curve, GridError, WavelengthGrid};
use fluorspar::study::{Lens, ViewFilter};
use fluorspar::units::{memory_gib, memory_texts};
use fluorspar_format::{Negative, SpectrumColumns, SpectrumOptions, SpectrumQuantity};

const LONGEST_SIDE_PX: u64 = 16_384;
const MOST_SAMPLES: u64 = 1_000_000;
const GIB: f64 = (1u64 << 30) as f64;

pub(crate) fn grid(context: &Context<'_>, section: &SpectralSection) -> Resolved<WavelengthGrid> {
    let UniformBins { first_nm: first, last_nm: last, step_nm: step } = match section {
        SpectralSection::Uniform(bins) => *bins,
        SpectralSection::Edges(EdgeBins { edges_nm }) => {
            let at = steps!["spectral", "edges_nm"];
            return WavelengthGrid::from_edges(edges_nm)
                .map_err(|error| context.error(&at, error.to_string()));
        }
    };
    WavelengthGrid::uniform(first, last, step).map_err(|error| {
        if matches!(error, GridError::NotIncreasing { .. }) && last < first {
            let message = format!("must not be below first_nm, which is {first}");
            return context.error(&steps!["spectral", "last_nm"], message);
        }
        let field = match &error {
            GridError::BadStep(_) | GridError::TooMany(_) => "step_nm",
            GridError::OutOfRange(nm) if *nm == first => "first_nm",
            _ => "last_nm",
        };
        context.error(&steps!["spectral", field], error.to_string())
    })
}

pub(super) fn render_settings(context: &Context<'_>, section: &RenderSection) -> Resolved<RenderSettings> {
    let at = |key: &str| steps!["render", key];
    for (key, value) in [("width_px", section.width_px), ("height_px", section.height_px)] {
        context.whole_within(&at(key), value.into(), [1, LONGEST_SIDE_PX])?;
    }
    context.whole_within(&at("samples_per_pixel"), section.samples_per_pixel.into(), [1, MOST_SAMPLES])?;
    context.whole_within(&at("max_depth"), section.max_depth.into(), [1, 1000])?;
    if let Some(limit) = section.time_limit_s {
        context.within(&at("time_limit_s"), limit, [1e-6, 1e9], "seconds")?;
    }
    let gib = context.within(&at("memory_limit_gib"), section.memory_limit_gib, [0.001, 1024.0], "GiB")?;
    Ok(RenderSettings {
        samples_per_pixel: section.samples_per_pixel,
        max_depth: section.max_depth,
        seed: section.seed,
        estimator: Estimator::default(),
        memory_limit_bytes: (gib * GIB) as u64,
        statistics: section.statistics,
        error_target: None,
        excitation_basis: None,
        component_bands: section.component_bands,
        regularize: section.regularize,
    })
}

/// Chooses the excitation basis of a render, where one is asked for.
pub(super) fn excitation_basis(
    context: &Context<'_>,
    section: &RenderSection,
    scene: &Scene,
) -> Resolved<Option<BasisSettings>> {
    let Some(peaks_nm) = section.excitation_basis_nm else { return Ok(None) };
    let path = steps!["render", "excitation_basis_nm"];
    let [first, last] = peaks_nm;
    if !(250.0..=700.0).contains(&first) || !(250.0..=700.0).contains(&last) || last < first {
        return context.fail(&path, "must be two wavelengths between 250 and 700 nm, the smaller one first");
    }
    let excluded = [
        ("statistics", section.statistics != StatisticsKind::None),
        ("relative_error", section.relative_error.is_some()),
    ];
    if let Some((field, _)) = excluded.into_iter().find(|(_, is_set)| *is_set) {
        return context.fail(&path, format!("can't be used together with {field}; remove one of them"));
    }
    match choose_basis(scene, peaks_nm) {
        Ok(basis) => Ok(Some(basis)),
        Err(error) => context.fail(&path, error.to_string()),
    }
}

/// Refuses images that do not fit into the stated memory in one go, nor in bands of rows, of which one row of tiles must
/// fit beside the maps of all pixels.
pub(super) fn check_memory(
    context: &Context<'_>,
    file: &ExperimentFile,
    in_one_go: u64,
    in_bands: u64,
) -> Resolved<()> {
    let limit = (file.render.memory_limit_gib * GIB) as u64;
    if in_one_go.min(in_bands) <= limit {
        return Ok(());
    }
    let [needed, limit_text] = memory_texts(in_one_go, limit);
    let bands = if in_bands < in_one_go {
        let [needed, _] = memory_texts(in_bands, limit);
        format!(", and still {needed} in bands of 16 rows, as `fluorspar render` would take them")
    } else {
        String::new()
    };
    let message = format!(
        "the images of the render need {needed}, more than the limit of {limit_text}{bands}; render fewer pixels, bands, \
         light groups or fluorophores, or raise render.memory_limit_gib to {} or more",
        memory_gib(in_one_go.min(in_bands))
    );
    context.fail(&steps!["render"], message)
}

/// Refuses cameras without a place or a direction, before anything is derived from them.
pub(super) fn check_camera(context: &Context<'_>, section: &CameraSection) -> Resolved<()> {
    let at = |key: &str| steps!["camera", key];
    let position = context.meters(&at("position_mm"), section.position_mm)?;
    let target = context.meters(&at("look_at_mm"), section.look_at_mm)?;
    let up = context.direction(&at("up"), section.up)?;
    let Some(forward) = (target - position).try_normalize() else {
        let message = "is the position of the camera itself; move one of the two";
        return context.fail(&at("look_at_mm"), message);
    };
    if forward.cross(up).length() < 1e-6 {
        return context.fail(&at("up"), "is parallel to the direction of view; choose another");
    }
    Ok(())
}

pub(super) fn camera(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    lens: Option<&Lens>,
    sensor: Option<&Sensor>,
) -> Resolved<PerspectiveCamera> {
    let at = |key: &str| steps!["camera", key];
    let section = &file.camera;
    let position = context.meters(&at("position_mm"), section.position_mm)?;
    let target = context.meters(&at("look_at_mm"), section.look_at_mm)?;
    let up = context.direction(&at("up"), section.up)?;
    let traced = lens.and_then(|lens| lens.traced.as_ref());
    let formation = file.lens.as_ref().and_then(LensSection::image_formation).unwrap_or_default();
    let parallel_width_mm = parallel_width_mm(context, file)?;
    let field_deg = match (section.horizontal_field_deg, lens, sensor) {
        _ if parallel_width_mm.is_some() => 90.0,
        (given, _, _) if traced.is_some() => {
            let field_deg =
                traced.and_then(|lens| lens.covering_tangent()).map(|t| 2.0 * t.atan().to_degrees());
            let Some(field_deg) = field_deg.filter(|field_deg| *field_deg < 179.0) else {
                let message = "no ray through the middle of its stop reaches the corners of the sensor; take a smaller sensor \
                               or a lens with a larger image";
                return context.fail(&steps!["lens", "prescription"], message);
            };
            match given {
                LensOrNumber::FromLens => field_deg,
                LensOrNumber::Number(wider)
                    if formation == ImageFormation::PointSpread && wider >= field_deg && wider < 179.0 =>
                {
                    wider
                }
                LensOrNumber::Number(_) => {
                    let message = if formation == ImageFormation::PointSpread {
                        // Rounded up: what the message says is enough
                        format!(
                            "the sensor covers {:.2} degrees, distortion included; give at least that, or \"from_lens\"",
                            (field_deg * 100.0).ceil() / 100.0
                        )
                    } else {
                        "a traced lens sets the field of view; set this to \"from_lens\"".into()
                    };
                    return context.fail(&at("horizontal_field_deg"), message);
                }
            }
        }
        (LensOrNumber::Number(value), _, _) => {
            if !(1e-6..179.0).contains(&value) {
                return context
                    .fail(&at("horizontal_field_deg"), "must be at least 1e-6 and below 179 degrees");
            }
            value
        }
        (LensOrNumber::FromLens, Some(lens), Some(sensor)) => {
            let half = 0.5 * sensor.model().width_mm() / lens.equation.image_distance_mm();
            2.0 * half.atan().to_degrees()
        }
        (LensOrNumber::FromLens, _, _) => {
            let message = "the field of view is unknown without a [lens] and a [sensor]; give degrees";
            return context.fail(&at("horizontal_field_deg"), message);
        }
    };
    let (width, height) = (file.render.width_px as usize, file.render.height_px as usize);
    match PerspectiveCamera::look_at(position, target, up, field_deg as f32, width, height) {
        Some(mut camera) => {
            camera.lens = traced.filter(|_| formation == ImageFormation::Rendered).cloned();
            camera.parallel_half_width_m = parallel_width_mm.map(|width| (0.5e-3 * width) as f32);
            camera.aperture = aperture(context, section, lens, parallel_width_mm)?.map(Arc::new);
            Ok(camera)
        }
        None => context.fail(&steps!["camera"], "position, direction and field of view make no camera"),
    }
}

/// The aperture of a camera without a traced lens.
fn aperture(
    context: &Context<'_>,
    section: &CameraSection,
    lens: Option<&Lens>,
    parallel_width_mm: Option<f64>,
) -> Resolved<Option<Aperture>> {
    let at = steps!["camera", "aperture_mm"];
    let is_traced = lens.is_some_and(|lens| lens.traced.is_some());
    let (diameter_mm, focus_mm) = match (section.aperture_mm, lens) {
        (LensOrNumber::Number(0.0), _) => return Ok(None),
        _ if is_traced => return context.fail(&at, "a traced lens has its own aperture; remove this line"),
        _ if parallel_width_mm.is_some() => {
            return context.fail(&at, "parallel rays have no aperture; remove this line");
        }
        (LensOrNumber::FromLens, Some(Lens { equation, .. })) => {
            (equation.focal_length_mm / equation.f_number, equation.object_distance_mm)
        }
        (LensOrNumber::FromLens, None) => {
            return context.fail(&at, "there is no [lens]; give a diameter in mm, or 0 for a pinhole");
        }
        (LensOrNumber::Number(_), Some(_)) => {
            return context.fail(&at, "a [lens] has its own diameter; set this to \"from_lens\"");
        }
        (LensOrNumber::Number(diameter_mm), None) => {
            context.within(&at, diameter_mm, [1e-3, 1e4], "millimeters")?;
            (diameter_mm, Some(section.distance_mm()))
        }
    };
    // Infinity is far beyond every scene
    let focus_mm = focus_mm.unwrap_or(1e9);
    Ok(Some(Aperture::new((0.5e-3 * diameter_mm) as f32, (1e-3 * focus_mm) as f32)))
}

/// Warns of an image that is wider or higher than the sensor.
pub(super) fn warn_of_shape(context: &mut Context<'_>, file: &ExperimentFile, sensor: Option<&Sensor>) {
    let Some(model) = sensor.map(Sensor::model) else { return };
    let (width, height) = (f64::from(file.render.width_px), f64::from(file.render.height_px));
    let chip = model.width_mm() / model.height_mm();
    // Pixels are whole: the nearest height is as good as it gets
    let fitting = (width / chip).round().max(1.0);
    if (width / height / chip - 1.0).abs() > 0.01 && height != fitting {
        let message = format!(
            "the image has {width} x {height} pixels, but the sensor is {chip:.3} times as wide as high; parts of one of \
             the two see nothing of the other. Give render.height_px = {fitting:.0}"
        );
        context.warn(&steps!["render"], message);
    }
}

/// The width that parallel rays span, mm, where the camera has such.
fn parallel_width_mm(context: &Context<'_>, file: &ExperimentFile) -> Resolved<Option<f64>> {
    let Some(width_mm) = file.camera.parallel_width_mm else { return Ok(None) };
    let at = steps!["camera", "parallel_width_mm"];
    if file.lens.is_some() || file.sensor.is_some() {
        let message = "parallel rays make no image behind a lens; remove [lens] and [sensor], or this line";
        return context.fail(&at, message);
    }
    if file.camera.horizontal_field_deg != LensOrNumber::FromLens {
        return context
            .fail(&at, "parallel rays have no field of view; remove horizontal_field_deg, or this line");
    }
    context.within(&at, width_mm, LENGTH_MM, "millimeters").map(Some)
}

/// The viewing filters at the fixed angle.
pub(crate) fn view_filter(
    context: &mut Context<'_>,
    section: &ViewFilterSection,
    grid: &WavelengthGrid,
) -> Resolved<ViewFilter> {
    let field = |key: &str| steps!["view_filter", key];
    context.within(&field("angle_deg"), section.angle_deg, [0.0, 60.0], "degrees")?;
    if let Some(index) = section.effective_index {
        context.within(&field("effective_index"), index, [1.0, 4.0], "")?;
    }
    let lens_angles = section.angles == FilterAngles::Lens;
    if lens_angles && section.angle_deg != 0.0 {
        let message = "given together with angles = \"lens\", which takes the angles of the rays; remove one of the two";
        return context.fail(&field("angle_deg"), message);
    }
    if !lens_angles && section.position == FilterPosition::Rear {
        let message = "has an effect only at the angles of the lens; add angles = \"lens\"";
        return context.fail(&field("position"), message);
    }
    let mut filters = Vec::with_capacity(section.filters.len());
    let mut fixed = Curve::constant(1.0);
    for (index, reference) in section.filters.iter().enumerate() {
        let at = steps!["view_filter", "filters", index];
        let filter = context.filter(&at, reference, section.effective_index, grid)?;
        if reference.names_file() {
            context.note_filter_data(&at, filter.curve.range_nm());
        }
        let curve = if reference.catalogue_name().is_some() {
            context.spectrum(&at, reference, Role::Filter, section.angle_deg, grid)?
        } else {
            filter.at_angle(section.angle_deg)
        };
        fixed = fixed.times(&curve);
        filters.push(filter);
    }
    let autofluorescence = match &section.autofluorescence {
        None => None,
        Some(own) => {
            let at = |key: &str| steps!["view_filter", "autofluorescence", key];
            context.within(&at("photon_yield"), own.photon_yield, [0.0, 1.0], "photons per photon")?;
            let emission = context.spectrum(&at("spectrum"), &own.spectrum, Role::Light, 0.0, grid)?;
            Some(FilterAutofluorescence { photon_yield: own.photon_yield, emission })
        }
    };
    let stack = FilterStack {
        filters,
        angle_deg: section.angle_deg,
        lens_angles,
        behind_lens: section.position == FilterPosition::Rear,
        autofluorescence,
    };
    Ok(ViewFilter { stack, transmittance: fixed, off_axis: Vec::new() })
}

/// The lens, focused where the section says or else at a distance; `None` is infinity. `film_mm` is the size of the film;
/// without one (a flat sample) only the axis matters.
pub(crate) fn lens(
    context: &mut Context<'_>,
    section: &LensSection,
    distance_mm: Option<f64>,
    film_mm: Option<[f64; 2]>,
    grid: &WavelengthGrid,
) -> Resolved<Lens> {
    let transmittance = match section {
        LensSection::Ideal(lens) => &lens.transmittance,
        LensSection::Traced(lens) => &lens.transmittance,
    };
    let glass = context.spectrum(&steps!["lens", "transmittance"], transmittance, Role::Filter, 0.0, grid)?;
    let (mut equation, traced) = match section {
        LensSection::Ideal(section) => {
            let lens = IdealLens {
                object_distance_mm: section.focus_distance_mm.or(distance_mm),
                vignetting: section.vignetting,
                ..IdealLens::new(section.focal_length_mm, section.f_number)
            };
            lens.validate().map_err(|problem| {
                let field =
                    if problem.field == "object_distance_mm" { "focus_distance_mm" } else { problem.field };
                context.error(&steps!["lens", field], problem.message)
            })?;
            (lens, None)
        }
        LensSection::Traced(section) => {
            let distance_mm = section.focus_distance_mm.or(distance_mm);
            let film_mm = film_mm.unwrap_or([AXIS_FILM_MM; 2]);
            let traced = traced_lens(context, section, distance_mm, film_mm, grid)?;
            let state = traced.state();
            let (f, m) = (state.paraxial.focal_length_mm, state.magnification().abs());
            let equation = IdealLens {
                object_distance_mm: (m > 0.0).then(|| f * (1.0 + 1.0 / m)),
                vignetting: Vignetting::None,
                traced_solid_angle_sr: Some(traced.axial_solid_angle_sr()),
                ..IdealLens::new(f, state.f_number)
            };
            (equation, Some(Arc::new(traced)))
        }
    };
    equation.transmittance = glass;
    equation
        .validate_transmittance()
        .map_err(|problem| context.error(&steps!["lens", problem.field], problem.message))?;
    Ok(Lens { equation, traced })
}

/// Side of the film of a lens of which only the axis matters, mm.
const AXIS_FILM_MM: f64 = 1e-3;

fn traced_lens(
    context: &mut Context<'_>,
    section: &TracedLensSection,
    distance_mm: Option<f64>,
    [width_mm, height_mm]: [f64; 2],
    grid: &WavelengthGrid,
) -> Resolved<CameraLens> {
    let at = |key: &str| steps!["lens", key];
    let name = section.prescription.as_str();
    if let NameOrFile::File(path) = &section.prescription {
        context.note_input(&at("prescription"), path)?;
    }
    let loaded = preset::lens_or_file(name).map_err(|error| {
        let error = context.error(&at("prescription"), error.to_string());
        if is_file_name(name) { error.without_value() } else { error }
    })?;
    let mut lens = loaded.lens;
    if !is_file_name(name) {
        let text = format!("{lens:?}");
        context.note_preset("lens", name, &text);
    }
    if let Some(wanted_mm) = section.focal_length_mm {
        context.within(&at("focal_length_mm"), wanted_mm, LENGTH_MM, "millimeters")?;
        let own_mm = Paraxial::new(&lens, lens.design_wavelength_nm).focal_length_mm;
        if own_mm > 0.0 && own_mm.is_finite() {
            lens = lens.scaled(wanted_mm / own_mm);
        }
    }
    let groups = section.band_groups;
    context.whole_within(&at("band_groups"), groups.into(), [1, 64])?;
    if groups > 1 && !lens.is_dispersive() {
        let message = "no glass of this lens disperses, so groups only cost time; remove this field";
        return context.fail(&at("band_groups"), message);
    }
    let setting = LensSetting {
        f_number: section.f_number,
        object_distance_mm: distance_mm,
        film_shift_mm: section.film_shift_mm,
    };
    let state = LensState::new(&lens, setting).map_err(|problem| match problem.place.as_str() {
        place @ ("f_number" | "focus_distance_mm" | "film_shift_mm") => {
            context.error(&at(place), problem.message)
        }
        _ => context.error(&at("prescription"), problem.to_string()),
    })?;
    let traced = CameraLens::new(state, width_mm, height_mm, grid, groups as usize);
    let corner_mm = 0.5 * width_mm.hypot(height_mm);
    if traced.relative_illumination(0.98 * corner_mm) <= 0.0 {
        let message = format!(
            "the corners of the sensor, {corner_mm:.2} mm from the axis, stay dark: this lens does not cover it"
        );
        context.warn(&at("prescription"), message);
    }
    Ok(traced)
}

impl CameraSection {
    /// Distance from the camera to the point that it looks at, mm.
    pub(super) fn distance_mm(&self) -> f64 {
        let [x, y, z] = [0, 1, 2].map(|i| self.position_mm[i] - self.look_at_mm[i]);
        (x * x + y * y + z * z).sqrt()
    }
}

pub(crate) fn sensor(
    context: &mut Context<'_>,
    section: &SensorSection,
    grid: &WavelengthGrid,
) -> Resolved<Sensor> {
    section.model.validate().map_err(|problem| sensor_problem(context, &problem.field, problem.message))?;
    let model = &filled(&section.model);
    for (key, value) in [("columns", model.columns), ("rows", model.rows)] {
        context.whole_within(&steps!["sensor", key], value as u64, [1, LONGEST_SIDE_PX])?;
    }
    let at = steps!["sensor", "quantum_efficiency"];
    let channels = match &section.quantum_efficiency {
        EfficiencyReference::Text(NameOrTable::Name(name)) => quantum_efficiency(context, &at, name, model)?,
        EfficiencyReference::Text(NameOrTable::File(csv)) => columns(context, &at, csv, None, model)?,
        EfficiencyReference::Columns(EfficiencyColumns { csv, unit, scale: None }) => {
            columns(context, &at, csv, *unit, model)?
        }
        EfficiencyReference::Columns(EfficiencyColumns { csv, unit, scale }) => {
            let column = |channel: String| {
                let (csv, column) = (csv.clone(), Some(channel.clone()));
                let table = SpectrumTable { csv, column, unit: *unit, scale: *scale, outside: None };
                (channel, SpectrumReference::Table(table))
            };
            let table = channels_of(model).into_iter().map(column).collect();
            efficiencies(context, &at, &table, model, grid)?
        }
        EfficiencyReference::Channels(table) => efficiencies(context, &at, table, model, grid)?,
    };
    let mut qe = SpectralQe::from_curves(channels).map_err(|problem| context.error(&at, problem.message))?;
    for (index, filter) in section.filters.iter().enumerate() {
        let at = steps!["sensor", "filters", index];
        qe = qe.behind(&context.spectrum(&at, filter, Role::Filter, 0.0, grid)?);
    }
    warn_truncated(context, &at, &qe, grid);
    // A data sheet may state a quantum efficiency, which is compared with the curves.
    let model = if section.model.emva1288.is_some() { &section.model } else { model };
    Sensor::new(model.clone(), qe).map_err(|problem| sensor_problem(context, &problem.field, problem.message))
}

/// Warns of efficiencies that end where they are not small.
fn warn_truncated(context: &mut Context<'_>, at: &Place, qe: &SpectralQe, grid: &WavelengthGrid) {
    let cut: Vec<String> = qe
        .truncated_on(grid)
        .into_iter()
        .map(|(channel, [from, to])| format!("{channel} ({from} to {to} nm)"))
        .collect();
    if !cut.is_empty() {
        let message = format!(
            "these channels were measured over a smaller range and are taken as zero outside, though not small there: {}",
            cut.join(", ")
        );
        context.warn(at, message);
    }
}

/// The model with its defaults and its data sheet written out; what was given stays to the last bit. The voltage per electron by default is
/// left out: it follows the well and the swing, whoever changes them.
pub(crate) fn filled(model: &SensorModel) -> SensorModel {
    // A sheet that can't be used has been refused before.
    let model = model.with_data_sheet().unwrap_or_else(|_| model.clone());
    let (mut filled, resolved) = (model.clone(), model.resolved());
    let fill = |millivolts: &mut Option<f64>, electrons: Option<f64>, default: Option<f64>| {
        if millivolts.is_none() && electrons.is_none() {
            *millivolts = default;
        }
    };
    fill(&mut filled.read_noise_mv, filled.read_noise_e, resolved.read_noise_mv);
    fill(&mut filled.dsnu_mv, filled.dsnu_e, resolved.dsnu_mv);
    fill(&mut filled.dark_voltage_mv_per_s, filled.dark_current_e_per_s, resolved.dark_voltage_mv_per_s);
    filled
}

fn sensor_problem(context: &Context<'_>, field: &str, message: String) -> crate::ExperimentError {
    context.error(&steps!["sensor"].fields(field), message)
}

/// Channels of a mosaic, each once.
fn channels_of(model: &SensorModel) -> Vec<String> {
    let mut wanted: Vec<String> = Vec::new();
    for name in model.mosaic.iter().flatten() {
        if !wanted.contains(name) {
            wanted.push(name.clone());
        }
    }
    wanted
}

/// Quantum efficiencies given channel by channel.
fn efficiencies(
    context: &mut Context<'_>,
    at: &Place,
    table: &BTreeMap<String, SpectrumReference>,
    model: &SensorModel,
    grid: &WavelengthGrid,
) -> Resolved<Vec<(String, Curve)>> {
    let wanted = channels_of(model);
    if let Some(unused) = table.keys().find(|name| !wanted.contains(name)) {
        let message =
            format!("no pixel of the mosaic has this channel; its channels are {}", wanted.join(", "));
        return context.fail(&at.field(unused), message);
    }
    let mut channels = Vec::new();
    for name in wanted {
        let Some(reference) = table.get(&name) else {
            let message = format!("has no channel \"{name}\", which the mosaic of the sensor names; add it");
            return context.fail(at, message);
        };
        if matches!(reference, SpectrumReference::Text(_)) {
            let message =
                "give a number, an equation such as { type = \"bands\", ... }, or { csv = \"FILE\" }";
            return context.fail(&at.field(&name), message);
        }
        let curve = context.spectrum(&at.field(&name), reference, Role::QuantumEfficiency, 0.0, grid)?;
        channels.push((name, curve));
    }
    Ok(channels)
}

/// Quantum efficiencies of a file, a column each.
fn columns(
    context: &mut Context<'_>,
    at: &Place,
    csv: &FilePath,
    unit: Option<TableUnit>,
    model: &SensorModel,
) -> Resolved<Vec<(String, Curve)>> {
    let wanted = channels_of(model);
    let options = SpectrumOptions {
        columns: SpectrumColumns::Named(wanted.clone()),
        quantity: SpectrumQuantity::QuantumEfficiency,
        negative: Negative::ClipToZero,
        skip_empty_cells: true,
        unit: unit.map(Into::into),
    };
    let curves = context.spectra(at, csv, &options)?;
    // A column may be called by more than the name of its channel, as "R (A/W)"
    Ok(wanted.into_iter().zip(curves.into_iter().map(|column| column.curve)).collect())
}

fn quantum_efficiency(
    context: &mut Context<'_>,
    at: &Place,
    reference: &str,
    model: &SensorModel,
) -> Resolved<Vec<(String, Curve)>> {
    let wanted = channels_of(model);
    let preset = preset::quantum_efficiency(reference).map_err(|error| context.error(at, error))?;
    context.note_preset("quantum efficiency", reference, &preset);
    context.note_entry(at, PresetKind::QuantumEfficiency, reference)?;
    let all = preset.channels().map_err(|error| context.error(at, error.to_string()))?;
    if let Some(missing) = wanted.iter().find(|name| !all.iter().any(|(channel, _)| channel == *name)) {
        let message = format!(
            "has no channel \"{missing}\", which the mosaic of the sensor names; its channels are {}",
            preset.channel_names().join(", ")
        );
        return context.fail(at, message);
    }
    Ok(all.into_iter().filter(|(channel, _)| wanted.contains(channel)).collect())
}
