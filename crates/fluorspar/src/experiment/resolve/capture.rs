//! Exposures and analysis.

use super::context::{Context, Resolved};
use super::material::unknown;
use super::spectrum::Role;
use super::{Capture, ResolvedAnalysis};
use crate::experiment::error::steps;
use crate::experiment::schema::{AnalysisSection, ExperimentFile, ExposureTime, TextureReference};
use crate::light::LightGroup;
use crate::preset::{self, nearest_name};
use crate::scene::Object;
use crate::sensor::{CaptureFrame, SensorModel};
use crate::spectral::{Curve, WavelengthGrid};

fn hint<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    nearest_name(name, known).map_or_else(|| ".".into(), |name| format!(", did you mean \"{name}\"?"))
}

pub(super) fn captures(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    groups: &[LightGroup],
    grid: &WavelengthGrid,
) -> Resolved<Vec<Capture>> {
    if !file.capture.is_empty() && (file.sensor.is_none() || file.lens.is_none()) {
        let missing = if file.sensor.is_none() { "sensor" } else { "lens" };
        return context.fail(&steps!["capture", 0], format!("a capture needs a [{missing}] section"));
    }
    let mut captures: Vec<Capture> = Vec::with_capacity(file.capture.len());
    for (index, section) in file.capture.iter().enumerate() {
        let at = |key: &str| steps!["capture", index, key];
        let earlier: Vec<&str> = file.capture[..index].iter().map(|other| other.name.as_str()).collect();
        context.unique_name(&steps!["capture", index], &section.name, earlier.iter().copied())?;
        for (name, drive) in &section.light_groups {
            let at = steps!["capture", index, "light_groups", name];
            if !groups.iter().any(|group| group.name == *name) {
                let known: Vec<&str> = groups.iter().map(|group| group.name.as_str()).collect();
                let message = format!(
                    "there is no light group \"{name}\"{} Known: {}",
                    hint(name, known.iter().copied()),
                    known.join(", ")
                );
                return context.fail(&at, message);
            }
            context.within(&at, *drive, [0.0, 1e6], "times the stated power")?;
        }
        let rule = section.auto_exposure.unwrap_or_default();
        if section.auto_exposure.is_some() && section.exposure_ms != ExposureTime::Auto {
            return context
                .fail(&at("auto_exposure"), "exposure_ms is fixed; set it to \"auto\" or remove the rule");
        }
        rule.validate().map_err(|problem| {
            let field = problem.field.rsplit('.').next().unwrap_or_default().to_string();
            context.error(&steps!["capture", index, "auto_exposure", &field], problem.message)
        })?;
        let (exposure_ms, auto_exposure) = context.exposure(&at("exposure_ms"), section.exposure_ms, rule)?;
        context.within(&at("gain"), section.gain, [0.01, 1000.0], "")?;
        if let Some(other) = &section.subtract
            && !earlier.contains(&other.as_str())
        {
            let message = format!(
                "no earlier capture has this name{} A capture can subtract only what was taken before it",
                hint(other, earlier.iter().copied())
            );
            return context.fail(&at("subtract"), message);
        }
        if let (ExposureTime::Auto, Some(sensor)) = (section.exposure_ms, &file.sensor)
            && sensor.model.strobe.is_some()
        {
            let message = "finds no exposure for pulsed light; give milliseconds, or remove sensor.strobe";
            return context.fail(&at("exposure_ms"), message);
        }
        let mut filter: Option<Curve> = None;
        for (number, reference) in section.filters.iter().enumerate() {
            let at = steps!["capture", index, "filters", number];
            let curve = context.spectrum(&at, reference, Role::Filter, 0.0, grid)?;
            filter = Some(filter.map_or_else(|| curve.clone(), |product| product.times(&curve)));
        }
        captures.push(Capture {
            filter,
            frame: CaptureFrame {
                label: section.name.clone(),
                lights: section.light_groups.clone(),
                exposure_ms,
                auto_exposure,
                gain: section.gain,
            },
            subtract: section.subtract.clone(),
        });
    }
    if !captures.is_empty() {
        for group in groups {
            if !captures.iter().any(|capture| capture.frame.drive(&group.name) > 0.0) {
                context.push_warning(format!(
                    "light group \"{}\" is rendered, but no capture switches it on; remove its lights to save time",
                    group.name
                ));
            }
        }
    }
    Ok(captures)
}

pub(super) fn analysis(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    captures: &[Capture],
    objects: &[Object],
) -> Resolved<Option<ResolvedAnalysis>> {
    let Some(section) = &file.analysis else { return Ok(None) };
    let at = |key: &str| steps!["analysis", key];
    let labels: Vec<&str> = captures.iter().map(|capture| capture.frame.label.as_str()).collect();
    if !labels.contains(&section.frame.as_str()) {
        let known = if labels.is_empty() { "none".into() } else { labels.join(", ") };
        let message = format!(
            "there is no capture of this name{} Known: {known}",
            hint(&section.frame, labels.iter().copied())
        );
        return context.fail(&at("frame"), message);
    }
    for (index, part) in section.parts.iter().enumerate() {
        if !objects.iter().any(|object| object.name == *part) {
            let names: Vec<&str> = objects.iter().map(|object| object.name.as_str()).collect();
            let message = format!(
                "the scene has no part of this name{} Known: {}",
                hint(part, names.iter().copied()),
                names.join(", ")
            );
            return context.fail(&steps!["analysis", "parts", index], message);
        }
    }
    let reads_a_part = |model: &SensorModel| {
        model.region_px.is_some_and(|region| region != [0, 0, model.columns, model.rows])
    };
    if !section.parts.is_empty() && file.sensor.as_ref().is_some_and(|sensor| reads_a_part(&sensor.model)) {
        let message = "parts are found in frames of the whole sensor only; give rectangle_px, or remove sensor.region_px";
        return context.fail(&at("parts"), message);
    }
    if let (Some([column, row, width, height]), Some(sensor)) = (section.rectangle_px, &file.sensor) {
        let size = sensor.model.image_size();
        let [columns, rows] = size.unwrap_or([sensor.model.columns, sensor.model.rows]).map(|n| n as u64);
        let outside =
            u64::from(column) + u64::from(width) > columns || u64::from(row) + u64::from(height) > rows;
        if outside || width == 0 || height == 0 {
            let message = format!(
                "is not inside the {columns} x {rows} pixels of the raw images; give column, row, width, height"
            );
            return context.fail(&at("rectangle_px"), message);
        }
    }
    let known = |name: &str| {
        preset::fluorophore(name).is_ok() || file.fluorophore.iter().any(|section| section.name == name)
    };
    if !known(&section.porphyrin) {
        return Err(unknown(context, &at("porphyrin"), &file.fluorophore, &section.porphyrin));
    }
    context.within(&at("noise_threshold"), section.noise_threshold, [0.0, 1000.0], "standard deviations")?;
    let bulk = bulk(context, file, section, objects)?;
    for (name, amount) in &bulk {
        let at = steps!["analysis", "bulk", name];
        if !known(name) {
            return Err(unknown(context, &at, &file.fluorophore, name));
        }
        context.within(&at, *amount, [0.0, 1e6], "")?;
    }
    Ok(Some(ResolvedAnalysis {
        frame: section.frame.clone(),
        parts: section.parts.clone(),
        rectangle_px: section.rectangle_px,
        porphyrin: section.porphyrin.clone(),
        bulk,
        noise_threshold: section.noise_threshold,
    }))
}

/// Concentrations that form the bulk: as given, or the constant ones of a material without the porphyrin.
fn bulk(
    context: &Context<'_>,
    file: &ExperimentFile,
    section: &AnalysisSection,
    objects: &[Object],
) -> Resolved<Vec<(String, f64)>> {
    if let Some(bulk) = &section.bulk {
        if section.bulk_material.is_some() {
            let at = steps!["analysis", "bulk_material"];
            return context.fail(&at, "given together with bulk; keep one of the two");
        }
        return Ok(bulk.iter().map(|(name, amount)| (name.clone(), *amount)).collect());
    }
    let material = match &section.bulk_material {
        Some(name) => {
            let found = file.material.iter().find(|material| material.name == *name);
            let Some(found) = found else {
                let names = file.material.iter().map(|material| material.name.as_str());
                let message = format!("there is no [[material]] of this name{}", hint(name, names));
                return context.fail(&steps!["analysis", "bulk_material"], message);
            };
            Some(found)
        }
        None => section
            .parts
            .first()
            .and_then(|part| objects.iter().find(|object| object.name == *part))
            .and_then(|object| file.material.get(object.material)),
    };
    let Some(material) = material else { return Ok(Vec::new()) };
    let amounts = material.concentrations.iter().filter(|(name, _)| **name != section.porphyrin);
    let constant = |(name, reference): (&String, &TextureReference)| match reference {
        TextureReference::Constant(amount) if *amount > 0.0 => Some((name.clone(), *amount)),
        _ => None,
    };
    Ok(amounts.filter_map(constant).collect())
}
