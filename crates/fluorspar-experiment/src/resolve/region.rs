//! Regions of the sensor and targets.

use std::path::Path;

use super::context::{Context, Resolved};
use super::seen::{Seen, check_parts};
use crate::error::{Place, steps};
use crate::schema::{ExperimentFile, FilePath, RegionReference, SensorRegionSection, TargetSection};
use fluorspar::analysis::{PixelMask, Polygon, Rectangle, RegionOfInterest};
use fluorspar::sensor::Sensor;
use fluorspar::study::{Target, TargetPlace};
use fluorspar_format::read_mask;

/// Columns and rows of the raw images.
fn raw_size(file: &ExperimentFile) -> Option<[usize; 2]> {
    let model = &file.sensor.as_ref()?.model;
    Some(model.image_size().unwrap_or([model.columns, model.rows]))
}

/// Whether the rectangle and the polygon of a section lie on the sensor.
pub(super) fn lies_on_sensor(file: &ExperimentFile, place: &SensorRegionSection) -> bool {
    let [columns, rows] = raw_size(file).unwrap_or([usize::MAX; 2]);
    let is_within = |[column, row, width, height]: [u32; 4]| {
        let ends = [u64::from(column) + u64::from(width), u64::from(row) + u64::from(height)];
        ends[0] <= columns as u64 && ends[1] <= rows as u64 && width > 0 && height > 0
    };
    let polygon = place.polygon_px.clone().map(Polygon);
    place.rectangle_px.is_none_or(is_within)
        && polygon.is_none_or(|polygon| polygon.check(columns, rows).is_ok())
}

/// Checks that a rectangle lies on the sensor.
pub(super) fn rectangle(
    context: &Context<'_>,
    file: &ExperimentFile,
    at: &Place,
    [column, row, width, height]: [u32; 4],
) -> Resolved<Rectangle> {
    if let Some([columns, rows]) = raw_size(file) {
        let ends = [u64::from(column) + u64::from(width), u64::from(row) + u64::from(height)];
        if ends[0] > columns as u64 || ends[1] > rows as u64 || width == 0 || height == 0 {
            let message = format!(
                "is not inside the {columns} x {rows} pixels of the raw images; give column, row, width, height"
            );
            return context.fail(at, message);
        }
    }
    let [col, row, width, height] = [column, row, width, height].map(|n| n as usize);
    Ok(Rectangle { col, row, width, height })
}

/// A polygon that lies on the sensor.
pub(super) fn polygon(
    context: &Context<'_>,
    file: &ExperimentFile,
    at: &Place,
    corners: &[[f64; 2]],
) -> Resolved<Polygon> {
    let polygon = Polygon(corners.to_vec());
    let [columns, rows] = raw_size(file).unwrap_or([usize::MAX; 2]);
    polygon.check(columns, rows).map_err(|error| context.error(at, error.to_string()))?;
    Ok(polygon)
}

/// A mask of the size of the raw images.
pub(super) fn mask(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    at: &Place,
    path: &FilePath,
) -> Resolved<PixelMask> {
    context.note_input(at, path)?;
    let image = read_mask(path.as_ref()).map_err(|error| context.file_error(at, &error))?;
    let name =
        Path::new(path.as_str()).file_name().map_or_else(|| path.as_str().into(), |n| n.to_string_lossy());
    let mask = PixelMask {
        name: name.into_owned(),
        width: image.width,
        height: image.height,
        inside: image.inside.into(),
    };
    if let Some([columns, rows]) = raw_size(file) {
        mask.check(columns, rows).map_err(|error| context.error(at, error.to_string()))?;
    }
    Ok(mask)
}

/// A region that is a rectangle, or a table.
pub(super) fn region(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    seen: &Seen<'_>,
    at: &Place,
    reference: &RegionReference,
) -> Resolved<RegionOfInterest> {
    match reference {
        RegionReference::Rectangle(sides) => {
            Ok(RegionOfInterest::of_rectangle(rectangle(context, file, at, *sides)?))
        }
        RegionReference::Shapes(section) => shapes(context, file, seen, at, section),
    }
}

fn shapes(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    seen: &Seen<'_>,
    at: &Place,
    section: &SensorRegionSection,
) -> Resolved<RegionOfInterest> {
    if *section == SensorRegionSection::default() {
        return context.fail(at, "selects no pixels; give parts, rectangle_px, polygon_px or mask");
    }
    check_parts(context, &at.field("parts"), &section.parts, seen)?;
    let mut region = RegionOfInterest::of_parts(section.parts.iter().cloned());
    if let Some(sides) = section.rectangle_px {
        region.rectangle = Some(rectangle(context, file, &at.field("rectangle_px"), sides)?);
    }
    if let Some(corners) = &section.polygon_px {
        region = region.within_polygon(polygon(context, file, &at.field("polygon_px"), corners)?);
    }
    if let Some(path) = &section.mask {
        region = region.within_mask(mask(context, file, &at.field("mask"), path)?);
    }
    Ok(region)
}

/// The targets of an experiment: those that it names, then the lesions that none of them is.
pub(super) fn targets(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    seen: &Seen<'_>,
) -> Resolved<Vec<Target>> {
    let mut targets = Vec::with_capacity(file.target.len());
    for (index, section) in file.target.iter().enumerate() {
        let at = steps!["target", index];
        context.unique_name(
            &at,
            &section.name,
            file.target[..index].iter().map(|other| other.name.as_str()),
        )?;
        let place = place(context, file, seen, &at, section)?;
        let background = match &section.background {
            Some(reference) => Some(region(context, file, seen, &at.field("background"), reference)?),
            None => None,
        };
        targets.push(Target { name: section.name.clone(), place, background });
    }
    for (name, spot) in &seen.lesions.spots {
        let is_named =
            |section: &TargetSection| section.name == *name || section.lesion.as_ref() == Some(name);
        if !file.target.iter().any(is_named) {
            targets.push(Target {
                name: name.clone(),
                place: TargetPlace::Spot(spot.clone()),
                background: None,
            });
        }
    }
    if targets.len() > Target::MOST {
        let message = format!(
            "these are {} targets, lesions included, and the image of labels has numbers for {}; measure the others in another analysis",
            targets.len(),
            Target::MOST
        );
        return context.fail(&steps!["target"], message);
    }
    Ok(targets)
}

/// Where a target is.
fn place(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    seen: &Seen<'_>,
    at: &Place,
    section: &TargetSection,
) -> Resolved<TargetPlace> {
    let shape = &section.place;
    let Some(lesion) = &section.lesion else {
        if *shape == SensorRegionSection::default() {
            return context
                .fail(at, "selects no pixels; give lesion, parts, rectangle_px, polygon_px or mask");
        }
        return Ok(TargetPlace::Region(shapes(context, file, seen, at, shape)?));
    };
    if *shape != SensorRegionSection::default() {
        return context.fail(
            &at.field("lesion"),
            "a lesion tells where the target is; give nothing else about its place",
        );
    }
    let (at, known) = (at.field("lesion"), seen.lesions.spots.iter().map(|(name, _)| name.as_str()));
    let number = context.known(&at, lesion, known, "there is no [[mouth.lesion]] of this name")?;
    Ok(TargetPlace::Spot(seen.lesions.spots[number].1.clone()))
}

/// Refuses parts in frames of a part of the sensor, where they can't be found.
pub(super) fn check_whole_sensor(
    context: &Context<'_>,
    at: &Place,
    parts: &[String],
    sensor: Option<&Sensor>,
) -> Resolved<()> {
    let reads_a_part = |sensor: &Sensor| {
        let model = sensor.model();
        model.region_px.is_some_and(|region| region != [0, 0, model.columns, model.rows])
    };
    if !parts.is_empty() && sensor.is_some_and(reads_a_part) {
        let message = "parts are found in frames of the whole sensor only; give rectangle_px, or remove sensor.region_px";
        return context.fail(at, message);
    }
    Ok(())
}
