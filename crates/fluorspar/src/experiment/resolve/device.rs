//! Wavelengths, render settings, camera, lens and sensor.

use super::context::{Context, Resolved};
use super::error_target;
use super::spectrum::Role;
use crate::experiment::document::is_path;
use crate::experiment::error::{Step, steps};
use crate::experiment::schema::{
    CameraSection, ExperimentFile, FieldOfView, LensSection, RenderSection, SensorSection, SpectralSection,
    ViewFilterSection,
};
use crate::format::{CsvColumns, CsvSpectrumOptions, Negative};
use crate::optics::{IdealLens, PerspectiveCamera};
use crate::preset;
use crate::render::{Estimator, RenderSettings};
use crate::sensor::{Sensor, SensorModel, SpectralQe};
use crate::spectral::{Curve, GridError, WavelengthGrid};

const LONGEST_SIDE_PX: u64 = 16_384;
const MOST_SAMPLES: u64 = 1_000_000;
const GIB: f64 = (1u64 << 30) as f64;

impl SpectralSection {
    /// Writes the defaults out.
    pub(in crate::experiment) fn fill(&mut self) {
        if self.edges_nm.is_none() {
            self.first_nm.get_or_insert(350.0);
            self.last_nm.get_or_insert(750.0);
            self.step_nm.get_or_insert(5.0);
        }
    }
}

pub(in crate::experiment) fn grid(
    context: &Context<'_>,
    section: &SpectralSection,
) -> Resolved<WavelengthGrid> {
    let uniform = section.first_nm.is_some() || section.last_nm.is_some() || section.step_nm.is_some();
    if let Some(edges) = &section.edges_nm {
        let at = steps!["spectral", "edges_nm"];
        if uniform {
            return context
                .fail(&at, "given together with first_nm, last_nm or step_nm; keep one of the two ways");
        }
        return WavelengthGrid::from_edges(edges).map_err(|error| context.error(&at, error.to_string()));
    }
    let mut filled = section.clone();
    filled.fill();
    let (Some(first), Some(last), Some(step)) = (filled.first_nm, filled.last_nm, filled.step_nm) else {
        return Ok(WavelengthGrid::default());
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
        context.positive(&at("time_limit_s"), limit, "seconds")?;
    }
    let gib = context.within(&at("memory_limit_gib"), section.memory_limit_gib, [0.1, 1024.0], "GiB")?;
    let edges = section.excitation_edges_nm.clone().unwrap_or_default();
    if section.excitation_edges_nm.is_some()
        && (!(2..=65).contains(&edges.len())
            || edges.iter().any(|edge| !(200.0..=1200.0).contains(edge))
            || edges.windows(2).any(|pair| pair[0] >= pair[1]))
    {
        let message = "must hold 2 to 65 increasing wavelengths between 200 and 1200 nm";
        return context.fail(&at("excitation_edges_nm"), message);
    }
    Ok(RenderSettings {
        samples_per_pixel: section.samples_per_pixel,
        max_depth: section.max_depth,
        seed: section.seed,
        estimator: Estimator::default(),
        memory_limit_bytes: (gib * GIB) as u64,
        statistics: error_target::statistics(section),
        error_target: None,
        excitation_edges_nm: edges,
    })
}

/// Refuses images that would not fit into the stated memory.
pub(super) fn check_memory(context: &Context<'_>, file: &ExperimentFile, needed_bytes: u64) -> Resolved<()> {
    let needed = needed_bytes as f64 / GIB;
    if needed <= file.render.memory_limit_gib {
        return Ok(());
    }
    let message = format!(
        "the images of the render need {needed:.1} GiB, more than the limit of {} GiB; render fewer pixels, bands, light \
         groups or fluorophores, or raise render.memory_limit_gib",
        file.render.memory_limit_gib
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
        let message = "the camera stands at the point that it looks at; move one of the two";
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
    lens: Option<&IdealLens>,
    sensor: Option<&Sensor>,
) -> Resolved<PerspectiveCamera> {
    let at = |key: &str| steps!["camera", key];
    let section = &file.camera;
    let position = context.meters(&at("position_mm"), section.position_mm)?;
    let target = context.meters(&at("look_at_mm"), section.look_at_mm)?;
    let up = context.direction(&at("up"), section.up)?;
    let field_deg = match (section.horizontal_field_deg, lens, sensor) {
        (FieldOfView::Degrees(value), _, _) => {
            if !(value > 0.0 && value < 179.0) {
                return context.fail(&at("horizontal_field_deg"), "must be above 0 and below 179 degrees");
            }
            value
        }
        (FieldOfView::FromLens, Some(lens), Some(sensor)) => {
            let half = 0.5 * sensor.model().width_mm() / lens.image_distance_mm();
            2.0 * half.atan().to_degrees()
        }
        (FieldOfView::FromLens, _, _) => {
            let message = "nothing gives the field of view: there is no [lens] with a [sensor]; give degrees";
            return context.fail(&at("horizontal_field_deg"), message);
        }
    };
    let (width, height) = (file.render.width_px as usize, file.render.height_px as usize);
    if let Some(sensor) = sensor {
        let (image, chip) =
            (width as f64 / height as f64, sensor.model().width_mm() / sensor.model().height_mm());
        if (image / chip - 1.0).abs() > 0.01 {
            let message = format!(
                "the image has {width} x {height} pixels, but the sensor is {:.3} times as wide as high; parts of one of \
                 the two see nothing of the other",
                chip
            );
            context.warn(&steps!["render"], message);
        }
    }
    match PerspectiveCamera::look_at(position, target, up, field_deg as f32, width, height) {
        Some(camera) => Ok(camera),
        None => context.fail(&steps!["camera"], "position, direction and field of view make no camera"),
    }
}

/// Product of the filters in front of the lens.
pub(in crate::experiment) fn view_filter(
    context: &mut Context<'_>,
    section: &ViewFilterSection,
    grid: &WavelengthGrid,
) -> Resolved<Curve> {
    context.within(&steps!["view_filter", "angle_deg"], section.angle_deg, [0.0, 60.0], "degrees")?;
    let mut product = Curve::constant(1.0);
    for (index, filter) in section.filters.iter().enumerate() {
        let at = steps!["view_filter", "filters", index];
        product = product.times(&context.spectrum(&at, filter, Role::Filter, section.angle_deg, grid)?);
    }
    Ok(product)
}

/// The lens, viewing filters included, focused where the section says or else at a distance; `None` is infinity.
pub(in crate::experiment) fn lens(
    context: &mut Context<'_>,
    section: &LensSection,
    distance_mm: Option<f64>,
    view_filter: &Curve,
    grid: &WavelengthGrid,
) -> Resolved<IdealLens> {
    let at = steps!["lens", "transmittance"];
    let glass = context.spectrum(&at, &section.transmittance, Role::Filter, 0.0, grid)?;
    let lens = IdealLens {
        focal_length_mm: section.focal_length_mm,
        f_number: section.f_number,
        transmittance: glass.times(view_filter),
        object_distance_mm: section.focus_distance_mm.or(distance_mm),
        vignetting: section.vignetting,
    };
    lens.validate().map_err(|problem| {
        let field = if problem.field == "object_distance_mm" { "focus_distance_mm" } else { problem.field };
        context.error(&steps!["lens", field], problem.message)
    })?;
    Ok(lens)
}

impl CameraSection {
    /// Distance from the camera to the point that it looks at, mm.
    pub(super) fn distance_mm(&self) -> f64 {
        let [x, y, z] = [0, 1, 2].map(|i| self.position_mm[i] - self.look_at_mm[i]);
        (x * x + y * y + z * z).sqrt()
    }
}

pub(in crate::experiment) fn sensor(
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
    let channels = quantum_efficiency(context, &at, &section.quantum_efficiency, model)?;
    let mut qe = SpectralQe::from_curves(channels).map_err(|problem| context.error(&at, problem.message))?;
    for (index, filter) in section.filters.iter().enumerate() {
        let at = steps!["sensor", "filters", index];
        qe = qe.behind(&context.spectrum(&at, filter, Role::Filter, 0.0, grid)?);
    }
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
        context.warn(&at, message);
    }
    Sensor::new(model.clone(), qe).map_err(|problem| sensor_problem(context, &problem.field, problem.message))
}

/// The model with its defaults written out; what was given stays to the last bit.
pub(in crate::experiment) fn filled(model: &SensorModel) -> SensorModel {
    let (mut filled, resolved) = (model.clone(), model.resolved());
    let fill = |millivolts: &mut Option<f64>, electrons: Option<f64>, default: Option<f64>| {
        if millivolts.is_none() && electrons.is_none() {
            *millivolts = default;
        }
    };
    fill(&mut filled.conversion_gain_mv_per_e, None, resolved.conversion_gain_mv_per_e);
    fill(&mut filled.read_noise_mv, filled.read_noise_e, resolved.read_noise_mv);
    fill(&mut filled.dsnu_mv, filled.dsnu_e, resolved.dsnu_mv);
    fill(&mut filled.dark_voltage_mv_per_s, filled.dark_current_e_per_s, resolved.dark_voltage_mv_per_s);
    filled
}

fn sensor_problem(context: &Context<'_>, field: &str, message: String) -> crate::experiment::ExperimentError {
    let mut at = steps!["sensor"];
    at.extend(field.split('.').map(Step::from));
    context.error(&at, message)
}

fn quantum_efficiency(
    context: &mut Context<'_>,
    at: &[Step],
    reference: &str,
    model: &SensorModel,
) -> Resolved<Vec<(String, Curve)>> {
    let mut wanted: Vec<String> = Vec::new();
    for name in model.mosaic.iter().flatten() {
        if !wanted.contains(name) {
            wanted.push(name.clone());
        }
    }
    if is_path(reference) {
        let columns = CsvColumns::Named(wanted);
        let options = CsvSpectrumOptions { columns, negative: Negative::ClipToZero, skip_empty_cells: true };
        let curves = context.csv(at, reference, &options)?;
        return Ok(curves.into_iter().map(|column| (column.name, column.curve)).collect());
    }
    let preset =
        preset::quantum_efficiency(reference).map_err(|error| context.error(at, error.to_string()))?;
    context.note_preset("quantum efficiency", reference, &preset);
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
