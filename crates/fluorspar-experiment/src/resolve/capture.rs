//! Exposures and analysis.

use std::collections::BTreeSet;
use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::analyzed_region::{FieldPlaces, as_analysis};
use super::context::{Context, Resolved};
use super::fluorophore::Fluorophores;
use super::region;
use super::seen::{Seen, check_parts};
use super::spectrum::Role;
use super::tissue;
use crate::cache::cached_solutions;
use crate::error::{Message, Place, Step, steps};
use crate::preset::{self, PresetError};
use crate::schema::{
    AnalysisSection, BulkReference, CaptureSection, ConcentrationFactor, DEFAULT_PORPHYRIN, ExperimentFile,
    ExposureTime, FluorophoreSection, SensorRegionSection, TextureReference,
};
use fluorspar::analysis::{Analyte, Polygon};
use fluorspar::light::LightGroup;
use fluorspar::material::{FluorophoreAmount, ScalarTexture};
use fluorspar::names::did_you_mean;
use fluorspar::optics::PerspectiveCamera;
use fluorspar::quote::excerpt;
use fluorspar::scene::{Object, Shape, surface_mean};
use fluorspar::sensor::{AutoExposure, CaptureFrame, EXPOSURE_MS};
use fluorspar::spectral::{Curve, Fluorophore, PhotonEem, WavelengthGrid};
use fluorspar::study::{AnalysisPlan, Capture, LineEnds, RegionPlan, TissuePrior};
use fluorspar::tissue::Site;

fn hint<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    did_you_mean(name, known)
}

/// Longest name of a capture.
const LONGEST_LABEL: usize = 80;

/// Names of captures become names of files: `raw_NAME.tiff`.
fn check_label(context: &Context<'_>, at: &[Step], name: &str, earlier: &[&str]) -> Resolved<()> {
    let safe = |c: char| c.is_alphanumeric() || "_-+. ".contains(c);
    if !name.chars().all(safe) || name.trim() != name || name.ends_with('.') {
        let message = "file names contain this name: give letters, digits, `_`, `-`, `+`, `.` or spaces \
                       between them";
        return context.fail(at, message);
    }
    if name.chars().count() > LONGEST_LABEL {
        return context
            .fail(at, format!("file names contain this name: give at most {LONGEST_LABEL} letters"));
    }
    if let Some(other) = earlier.iter().find(|other| other.to_lowercase() == name.to_lowercase()) {
        let message = format!(
            "differs from the capture \"{other}\" only in upper and lower case, which many file systems ignore; choose \
             another"
        );
        return context.fail(at, message);
    }
    Ok(())
}

/// The captures of an experiment, in their order.
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
    let captures = (0..file.capture.len())
        .map(|index| capture(context, file, index, groups, grid))
        .collect::<Resolved<Vec<Capture>>>()?;
    for group in groups {
        let is_on = |capture: &Capture| capture.frame.drive(&group.name) > 0.0;
        if !captures.is_empty() && !captures.iter().any(is_on) {
            context.push_warning(format!(
                "light group \"{}\" is rendered, but no capture switches it on; remove its lights to save time",
                group.name
            ));
        }
    }
    Ok(captures)
}

/// One capture.
fn capture(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    index: usize,
    groups: &[LightGroup],
    grid: &WavelengthGrid,
) -> Resolved<Capture> {
    let section = &file.capture[index];
    let place = steps!["capture", index];
    let earlier: Vec<&str> = file.capture[..index].iter().map(|other| other.name.as_str()).collect();
    context.unique_name(&place, &section.name, earlier.iter().copied())?;
    check_label(context, &place.field("name"), &section.name, &earlier)?;
    check_drives(context, &place, section, groups)?;
    let (exposure_ms, auto_exposure) = exposure(context, &place, section)?;
    context.within(&place.field("gain"), section.gain, [0.01, 1000.0], "")?;
    check_bracket(context, &place, section, exposure_ms)?;
    if let Some(on_ms) = section.light_on_ms {
        context.within(&place.field("light_on_ms"), on_ms, EXPOSURE_MS, "milliseconds")?;
    }
    check_order(context, &place, section, &earlier)?;
    if let (ExposureTime::Auto, Some(sensor)) = (section.exposure_ms, &file.sensor)
        && sensor.model.strobe.is_some()
    {
        let message = "cannot meter pulsed light; give milliseconds, or remove sensor.strobe";
        return context.fail(&place.field("exposure_ms"), message);
    }
    Ok(Capture {
        filter: filter(context, &place, section, grid)?,
        frame: CaptureFrame {
            label: section.name.clone(),
            lights: section.light_groups.clone(),
            exposure_ms,
            auto_exposure,
            gain: section.gain,
        },
        subtract: section.subtract.clone(),
        bracket_ev: section.bracket_ev.clone(),
        light_on_ms: section.light_on_ms,
    })
}

/// The light groups that a capture switches on must exist.
fn check_drives(
    context: &Context<'_>,
    place: &Place,
    section: &CaptureSection,
    groups: &[LightGroup],
) -> Resolved<()> {
    for (name, drive) in &section.light_groups {
        let at = place.field("light_groups").field(name);
        if !groups.iter().any(|group| group.name == *name) {
            let known = groups.iter().map(|group| group.name.as_str());
            let what = format!("there is no light group \"{}\"", excerpt(name));
            let message = Message::unknown(what, name, known);
            return context.fail(&at, message);
        }
        context.within(&at, *drive, [0.0, 1e6], "times the stated power")?;
    }
    Ok(())
}

/// Exposure time of a capture, ms, or the rule that finds it.
fn exposure(
    context: &Context<'_>,
    place: &Place,
    section: &CaptureSection,
) -> Resolved<(Option<f64>, Option<AutoExposure>)> {
    let rule = section.auto_exposure.unwrap_or_default();
    let at_rule = place.field("auto_exposure");
    if section.auto_exposure.is_some() && section.exposure_ms != ExposureTime::Auto {
        return context.fail(&at_rule, "exposure_ms is fixed; set it to \"auto\" or remove the rule");
    }
    rule.validate().map_err(|problem| {
        let field = problem.field.rsplit('.').next().unwrap_or_default();
        context.error(&at_rule.field(field), problem.message)
    })?;
    context.exposure(&place.field("exposure_ms"), section.exposure_ms, rule)
}

/// All exposures of a bracket must be possible.
fn check_bracket(
    context: &Context<'_>,
    place: &Place,
    section: &CaptureSection,
    exposure_ms: Option<f64>,
) -> Resolved<()> {
    let at = place.field("bracket_ev");
    if section.bracket_ev.len() > 31 {
        return context.fail(&at, "has more than 31 exposures; give fewer");
    }
    for (number, stops) in section.bracket_ev.iter().enumerate() {
        let at = at.index(number);
        context.within(&at, *stops, [-16.0, 16.0], "stops")?;
        // An exposure that a rule finds is known only when light is.
        if let Some(main_ms) = exposure_ms {
            let [shortest, longest] = EXPOSURE_MS.map(|ms| (ms / main_ms).log2());
            let message = "stops: an exposure lasts from 1e-6 to 3600000 milliseconds";
            context.within(&at, *stops, [shortest.max(-16.0), longest.min(16.0)], message)?;
        }
    }
    Ok(())
}

/// What a capture subtracts must have been taken before it.
fn check_order(
    context: &Context<'_>,
    place: &Place,
    section: &CaptureSection,
    earlier: &[&str],
) -> Resolved<()> {
    match &section.subtract {
        Some(other) if !earlier.contains(&other.as_str()) => {
            let message = format!(
                "no earlier capture has this name{} A capture can subtract only what was taken before it",
                hint(other, earlier.iter().copied())
            );
            context.fail(&place.field("subtract"), message)
        }
        _ => Ok(()),
    }
}

/// Product of the filters of a capture.
fn filter(
    context: &mut Context<'_>,
    place: &Place,
    section: &CaptureSection,
    grid: &WavelengthGrid,
) -> Resolved<Option<Curve>> {
    let mut filter: Option<Curve> = None;
    for (number, reference) in section.filters.iter().enumerate() {
        let at = place.field("filters").index(number);
        let curve = context.spectrum(&at, reference, Role::Filter, 0.0, grid)?;
        filter = Some(filter.map_or_else(|| curve.clone(), |product| product.times(&curve)));
    }
    Ok(filter)
}

/// Everything that is analyzed.
#[derive(Default)]
pub(super) struct Analyses {
    pub(super) analysis: Option<AnalysisPlan>,
    pub(super) regions: Vec<RegionPlan>,
    /// What of the analysis and of each region depends on surfaces, which hold no factors on concentrations yet; none where a mask,
    /// spots or targets ask for more.
    pub(super) of_surfaces: Vec<OfSurfaces>,
}

/// The analysis with its regions.
pub(super) fn analyses(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    captures: &[Capture],
    seen: &Seen<'_>,
) -> Resolved<Analyses> {
    let Some(given) = &file.analysis else {
        if !file.target.is_empty() {
            let message =
                "the analysis tells how well a target is seen; add an [analysis] section with the frame";
            return context.fail(&steps!["target", 0], message);
        }
        return Ok(Analyses::default());
    };
    let labels: Vec<&str> = captures.iter().map(|capture| capture.frame.label.as_str()).collect();
    let (plain, of_surfaces) = analyzed(context, file, given, &labels, seen, FieldPlaces::OF_ANALYSIS)?;
    let compared = match &given.compared_px {
        Some([first, second]) => {
            let at = steps!["analysis", "compared_px"];
            let first = region::region(context, file, seen, &at.index(0), first)?;
            Some([first, region::region(context, file, seen, &at.index(1), second)?])
        }
        None => None,
    };
    let targets = region::targets(context, file, seen)?;
    context.within(&steps!["analysis", "wanted_d_prime"], given.wanted_d_prime, [0.1, 100.0], "")?;
    let (regions, of_regions) = regions(context, file, &labels, seen)?;
    let mut plans = std::iter::once(&plain).chain(regions.iter().map(|region| &region.analysis));
    let is_plain = plans.all(|plan| plan.mask.is_none()) && compared.is_none() && targets.is_empty();
    let of_surfaces = std::iter::once(of_surfaces).chain(of_regions).filter(|_| is_plain).collect();
    let analysis = Some(AnalysisPlan { compared, targets, ..plain });
    Ok(Analyses { analysis, regions, of_surfaces })
}

/// The plans of all regions, and what of them depends on surfaces.
fn regions(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    labels: &[&str],
    seen: &Seen<'_>,
) -> Resolved<(Vec<RegionPlan>, Vec<OfSurfaces>)> {
    let Some(shared) = &file.analysis else { return Ok(Default::default()) };
    let (mut plans, mut of_regions) = (Vec::with_capacity(shared.region.len()), Vec::new());
    for (index, section) in shared.region.iter().enumerate() {
        let at = steps!["analysis", "region", index];
        let earlier = shared.region[..index].iter().map(|other| other.name.as_str());
        context.unique_name(&at, &section.name, earlier)?;
        if section.place == SensorRegionSection::default() {
            return context.fail(&at, "selects no pixels; give parts, rectangle_px, polygon_px or mask");
        }
        let places = FieldPlaces::of_region(index);
        let (analysis, of_surfaces) =
            analyzed(context, file, &as_analysis(section, shared), labels, seen, places)?;
        plans.push(RegionPlan { name: section.name.clone(), analysis });
        of_regions.push(of_surfaces);
    }
    Ok((plans, of_regions))
}

/// The frame of an analysis must be a capture.
pub(super) fn check_frame(
    context: &Context<'_>,
    section: &AnalysisSection,
    labels: &[&str],
    places: FieldPlaces,
) -> Resolved<()> {
    if labels.contains(&section.frame.as_str()) {
        return Ok(());
    }
    let known = labels.iter().copied();
    let message = Message::unknown("there is no capture of this name", &section.frame, known);
    context.fail(&places.at(context, "frame"), message)
}

/// One analysis, without targets and compared spots, and what of it depends on surfaces.
pub(super) fn analyzed(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    given: &AnalysisSection,
    labels: &[&str],
    seen: &Seen<'_>,
    places: FieldPlaces,
) -> Resolved<(AnalysisPlan, OfSurfaces)> {
    let at = |context: &Context<'_>, field: &str| places.at(context, field);
    let porphyrin = match &given.porphyrin {
        Some(name) => name.clone(),
        None => porphyrin_of_scene(context, given, seen, places)?,
    };
    let section = &AnalysisSection { porphyrin: Some(porphyrin), ..given.clone() };
    check_frame(context, section, labels, places)?;
    let at_parts = at(context, "parts");
    check_region(context, section, seen, &at_parts)?;
    region::check_whole_sensor(context, &at_parts, &section.place.parts, seen.sensor)?;
    context.within(&at(context, "inset_px"), f64::from(section.inset_px), [0.0, 64.0], "pixels")?;
    if let Some(rectangle) = section.place.rectangle_px {
        region::rectangle(context, file, &at(context, "rectangle_px"), rectangle)?;
    }
    if let Some(corners) = &section.place.polygon_px {
        region::polygon(context, file, &at(context, "polygon_px"), corners)?;
    }
    let mask = match &section.place.mask {
        Some(path) => Some(region::mask(context, file, &at(context, "mask"), path)?),
        None => None,
    };
    let noise_threshold = at(context, "noise_threshold");
    context.within(&noise_threshold, section.noise_threshold, [0.0, 1000.0], "standard deviations")?;
    // What the analysis names but no material holds is predicted as well: a control without porphyrin has a line, too.
    let mut absent = Fluorophores::default();
    let mut note = |context: &mut Context<'_>, at: &Place, name: &str| {
        if seen.fluorophores.list.iter().any(|fluorophore| fluorophore.name == name) {
            return Ok(());
        }
        absent.index(context, at, &file.fluorophore, name).map(|_| ())
    };
    if let Some(name) = wanted_share(section) {
        let place = at(context, "porphyrin");
        note(context, &place, name)?;
    }
    let at_bulk = at(context, "bulk");
    let held = bulk(context, file, section, seen, &at_bulk)?;
    let bulk = with_factors(&held, file, section);
    for (name, amount) in &bulk {
        let at = at_bulk.field(name);
        note(context, &at, name)?;
        context.within(&at, *amount, [0.0, 1e6], "")?;
    }
    let mut fluorophores = as_the_region_shows_them(file, section, seen);
    fluorophores.extend(absent.list);
    further_frames(context, section, labels, &at(context, "further_frames"))?;
    let tissue = tissue_prior(context, file, section, seen, places)?;
    let of_surfaces = OfSurfaces {
        bulk: held,
        fluorophores,
        tissue,
        line_ends: line_ends(file, section, seen),
        porphyrin: wanted_share(section).cloned(),
    };
    let plain = plan(file, section, of_surfaces.clone());
    Ok((AnalysisPlan { mask, ..plain }, of_surfaces))
}

/// What of an analysis depends on the surfaces of the scene.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct OfSurfaces {
    /// Amounts of the bulk before the factors of `[concentration]`.
    pub(crate) bulk: Vec<(String, f64)>,
    pub(crate) fluorophores: Vec<Fluorophore>,
    pub(crate) tissue: Option<TissuePrior>,
    pub(crate) line_ends: LineEnds,
    /// The fluorophore whose share is asked for.
    pub(crate) porphyrin: Option<String>,
}

/// The analysis of a section that was checked, without mask and targets.
pub(crate) fn plan(file: &ExperimentFile, section: &AnalysisSection, of: OfSurfaces) -> AnalysisPlan {
    AnalysisPlan {
        frame: section.frame.clone(),
        parts: section.place.parts.clone(),
        inset_px: section.inset_px,
        rectangle_px: section.place.rectangle_px,
        polygon: section.place.polygon_px.clone().map(Polygon),
        mask: None,
        compared: None,
        targets: Vec::new(),
        wanted_d_prime: section.wanted_d_prime,
        porphyrin: of.porphyrin,
        further_frames: section.further_frames.clone(),
        tissue: of.tissue,
        line_ends: of.line_ends,
        bulk: with_factors(&of.bulk, file, section),
        fluorophores: of.fluorophores,
        noise_threshold: section.noise_threshold,
    }
}

/// Name in place of a fluorophore where no share is asked for.
const NO_SHARE: &str = "none";

/// The fluorophore whose share is asked for.
fn wanted_share(section: &AnalysisSection) -> Option<&String> {
    section.porphyrin.as_ref().filter(|name| *name != NO_SHARE)
}

/// Whether tissue of the mouth holds a fluorophore of this name.
fn is_of_tissue(name: &str) -> bool {
    Site::quantum_yield(name).is_some()
}

/// The porphyrin that an analysis means that names none: the one that the region holds, else the one of the scene. Where there is none,
/// that of the catalogue, as a control has a line, too; but no share is asked for where the scene glows with what is in no tissue, as a
/// leaf or a phantom of dyes does.
fn porphyrin_of_scene(
    context: &Context<'_>,
    section: &AnalysisSection,
    seen: &Seen<'_>,
    places: FieldPlaces,
) -> Resolved<String> {
    let held_by = |object: &Object| -> Vec<&str> {
        let is_there = |held: &&FluorophoreAmount| held.concentration != ScalarTexture::Constant(0.0);
        let held = seen.materials[object.material].fluorophores.iter().filter(is_there);
        held.map(|held| seen.fluorophores.list[held.fluorophore].name.as_str()).collect()
    };
    let porphyrins = |of_region: bool| -> BTreeSet<&str> {
        let is_looked_at = |object: &&Object| {
            !of_region || section.place.parts.is_empty() || section.place.parts.contains(&object.name)
        };
        let names = seen.objects.iter().filter(is_looked_at).flat_map(held_by);
        names.filter(|name| Analyte::names_porphyrin(name)).collect()
    };
    let (mut found, mut place) = (porphyrins(true), "region");
    if found.is_empty() {
        (found, place) = (porphyrins(false), "scene");
    }
    let mut names = found.into_iter();
    match (names.next(), names.next()) {
        (None, _) => {
            let is_foreign = seen.objects.iter().flat_map(held_by).any(|name| !is_of_tissue(name));
            Ok(if is_foreign { NO_SHARE } else { DEFAULT_PORPHYRIN }.into())
        }
        (Some(only), None) => Ok(only.into()),
        (Some(first), Some(second)) => {
            let all: Vec<&str> = [first, second].into_iter().chain(names).collect();
            let message = format!(
                "the {place} holds {}; name the one whose share is asked for: porphyrin = \"{first}\", or \"none\"",
                all.join(" and ")
            );
            context.fail(&places.at(context, "porphyrin"), message)
        }
    }
}

/// Amounts of the bulk with the factors on concentrations; those that are given by hand stay as they are.
fn with_factors(
    bulk: &[(String, f64)],
    file: &ExperimentFile,
    section: &AnalysisSection,
) -> Vec<(String, f64)> {
    let is_by_hand = matches!(section.bulk, Some(BulkReference::Concentrations(_)));
    let factor = |name: &str| if is_by_hand { 1.0 } else { even_factor(file, name) };
    let scaled = bulk.iter().map(|(name, amount)| (name.clone(), amount * factor(name)));
    scaled.filter(|(_, amount)| is_by_hand || *amount > 0.0).collect()
}

/// Checks the captures that enter the estimate of a tissue family beside the analyzed one.
fn further_frames(
    context: &Context<'_>,
    section: &AnalysisSection,
    labels: &[&str],
    at: &Place,
) -> Resolved<()> {
    for (index, name) in section.further_frames.iter().enumerate() {
        let at = at.index(index);
        if !labels.contains(&name.as_str()) {
            let message = Message::unknown("there is no capture of this name", name, labels.iter().copied());
            return context.fail(&at, message);
        }
        if *name == section.frame || section.further_frames[..index].contains(name) {
            return context.fail(&at, "this capture is analyzed already; name each once");
        }
    }
    Ok(())
}

/// What is known of the tissue of the region: the site that is named, or the typical one of the material of its first part.
fn tissue_prior(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    section: &AnalysisSection,
    seen: &Seen<'_>,
    places: FieldPlaces,
) -> Resolved<Option<TissuePrior>> {
    let at = places.at(context, "tissue");
    let within = |field: &str, value: f64, range: [f64; 2], unit: &str| {
        context.within(&places.at(context, field), value, range, unit)
    };
    let width = within("prior_width", section.prior_width, [0.01, 10.0], "times the variety of people")?;
    let library_error = within("library_error", section.library_error, [0.0, 1.0], "")?;
    let site_probability = within("tissue_probability", section.tissue_probability, [0.01, 1.0], "")?;
    let site = match &section.tissue {
        _ if wanted_share(section).is_none() => return Ok(None),
        Some(name) if name == "none" => return Ok(None),
        Some(name) => {
            let (tissues, fluorophores) = (&file.tissue, &file.fluorophore);
            let named = tissue::named_tissue(context, &at, tissues, fluorophores, seen.grid, name)?;
            let site = named.site(context, &at)?.clone();
            if !site.is_mucosa() {
                let message = "has no blood; give a site of mucosa, or \"none\"";
                return context.fail(&at, message);
            }
            site
        }
        None => match material_site(file, section, seen) {
            Some(site) if site.is_mucosa() => site,
            _ => return Ok(None),
        },
    };
    let teeth = teeth_around(file).map_err(|error| context.error(&at, error))?;
    let prior = prior_of(context, &at, &file.fluorophore, (site, teeth))?;
    Ok(Some(TissuePrior { width, library_error, site_probability, ..prior }))
}

/// What is known beforehand of the tissue of a site, with the teeth around it.
pub(crate) fn prior_of(
    context: &mut Context<'_>,
    at: &Place,
    fluorophores: &[FluorophoreSection],
    (site, teeth): (Site, Option<Site>),
) -> Resolved<TissuePrior> {
    let others = preset::compared_sites().map_err(|error| context.error(at, error))?;
    let mut known = Fluorophores::default();
    let of_teeth = teeth.as_ref().map(Site::fluorophores).unwrap_or_default();
    for name in site.fluorophores().iter().chain(of_teeth) {
        known.index(context, at, fluorophores, name)?;
    }
    Ok(TissuePrior {
        site,
        fluorophores: known.list.into_iter().map(Arc::new).collect(),
        width: TissuePrior::WIDTH,
        library_error: TissuePrior::LIBRARY_ERROR,
        teeth,
        site_probability: TissuePrior::SITE_PROBABILITY,
        others,
        kept: cached_solutions(),
    })
}

/// The teeth that light a site in a mouth.
pub(super) fn teeth_around(file: &ExperimentFile) -> Result<Option<Site>, PresetError> {
    file.mouth.is_some().then(|| preset::site("tooth")).transpose()
}

/// The typical tissue of the site that the material of the region's first part is made of; what the experiment changes about it
/// is for the estimate to find.
fn material_site(file: &ExperimentFile, section: &AnalysisSection, seen: &Seen<'_>) -> Option<Site> {
    let part = section.place.parts.first()?;
    let object = seen.objects.iter().find(|object| object.name == *part)?;
    let name = file.material[seen.original(object.material)].tissue()?;
    match file.tissue.iter().find(|section| section.name == name) {
        None => preset::site(name).ok(),
        Some(section) => preset::site_or_file(section.site.as_ref()?.as_str()).ok(),
    }
}

/// A bulk given by hand, or that of another material than the region's, is an assumption that the scene must not correct.
fn line_ends(file: &ExperimentFile, section: &AnalysisSection, seen: &Seen<'_>) -> LineEnds {
    let in_region =
        |object: &&Object| section.place.parts.is_empty() || section.place.parts.contains(&object.name);
    let is_its_own = |index: usize| {
        let mut materials = seen.objects.iter().filter(in_region).map(|object| object.material);
        materials.any(|material| material == index || seen.original(material) == index)
    };
    match bulk_material(file, section, seen) {
        Some(index) if !is_its_own(index) => LineEnds::FlatSample,
        None if section.bulk.is_some() => LineEnds::FlatSample,
        _ => LineEnds::Scene,
    }
}

/// Refuses parts that do not exist, and regions of which no part can be in the image.
fn check_region(
    context: &Context<'_>,
    section: &AnalysisSection,
    seen: &Seen<'_>,
    at: &Place,
) -> Resolved<()> {
    check_parts(context, at, &section.place.parts, seen)?;
    let is_in_view = |part: &String| {
        let mut found = seen.objects.iter().filter(|object| object.name == *part);
        found.any(|object| may_be_in_view(&object.shape, seen.camera))
    };
    if section.place.parts.is_empty() || section.place.parts.iter().any(is_in_view) {
        return Ok(());
    }
    let message = "no part of the region is in the field of view of the camera. Turn the \
                   camera, widen the field of view or choose another part";
    context.fail(at, message)
}

/// Whether a shape is not wholly beyond one edge of the image or behind the camera. Occlusion is not checked.
fn may_be_in_view(shape: &Shape, camera: &PerspectiveCamera) -> bool {
    let tan_half_height = camera.tan_half_width * camera.height as f32 / camera.width as f32;
    let side = |across: Vec3, tan: f32| (camera.forward * tan + across).normalize();
    // Inward normals of the pyramid of view.
    let planes = [
        camera.forward,
        side(camera.right, camera.tan_half_width),
        side(-camera.right, camera.tan_half_width),
        side(camera.up, tan_half_height),
        side(-camera.up, tan_half_height),
    ];
    planes.iter().all(|normal| {
        let inside = |point: Vec3, radius: f32| (point - camera.position).dot(*normal) > -radius;
        match shape {
            Shape::Instances(many) => many.bounding_spheres().any(|(center, radius)| inside(center, radius)),
            Shape::Mesh(mesh) => mesh.positions.iter().any(|position| inside(*position, 0.0)),
            Shape::Sphere { center, radius_m } | Shape::Disc { center, radius_m, .. } => {
                inside(*center, *radius_m)
            }
        }
    })
}

/// Concentrations that form the bulk, before the factors of `[concentration]`: as given, or those of a material without the porphyrin, where they vary their
/// mean over the surfaces of the region that are made of it.
fn bulk(
    context: &Context<'_>,
    file: &ExperimentFile,
    section: &AnalysisSection,
    seen: &Seen<'_>,
    at: &Place,
) -> Resolved<Vec<(String, f64)>> {
    if let Some(BulkReference::Concentrations(bulk)) = &section.bulk {
        return Ok(bulk.iter().map(|(name, amount)| (name.clone(), *amount)).collect());
    }
    if let Some(BulkReference::Material(name)) = &section.bulk
        && !file.material.iter().any(|material| material.name == *name)
    {
        let names = file.material.iter().map(|material| material.name.as_str());
        let message = format!("there is no [[material]] of this name{}", hint(name, names));
        return context.fail(at, message);
    }
    let Some(index) = bulk_material(file, section, seen) else { return Ok(Vec::new()) };
    let shapes = || shapes_of(index, section, seen);
    let mut bulk = Vec::new();
    if seen.states(index).is_some() {
        // Of tissue the amounts are factors on what it holds, the same in all states
        for (number, fluorophore) in seen.fluorophores.list.iter().enumerate() {
            let held = seen.materials[index].fluorophores.iter().find(|held| held.fluorophore == number);
            let factor = held.map_or(0.0, |held| surface_mean(&held.concentration, shapes()));
            if factor > 0.0 && Some(&fluorophore.name) != section.porphyrin.as_ref() {
                bulk.push((fluorophore.name.clone(), factor));
            }
        }
        return Ok(bulk);
    }
    for (name, reference) in file.material[seen.original(index)].concentrations().into_iter().flatten() {
        if Some(name) == section.porphyrin.as_ref() {
            continue;
        }
        let amount = match reference {
            TextureReference::Constant(amount) => *amount,
            TextureReference::Map(_) => {
                let held = seen.materials[index].fluorophores.iter();
                let held = held.filter(|held| seen.fluorophores.list[held.fluorophore].name == *name);
                held.map(|held| surface_mean(&held.concentration, shapes())).sum()
            }
        };
        if amount > 0.0 {
            bulk.push((name.clone(), amount));
        }
    }
    Ok(bulk)
}

/// Factor on all concentrations of a fluorophore.
fn even_factor(file: &ExperimentFile, fluorophore: &str) -> f64 {
    match file.concentration.get(fluorophore) {
        Some(ConcentrationFactor::Even(factor)) => *factor,
        _ => 1.0,
    }
}

/// The material whose fluorophores form the bulk: the one that is named, otherwise that of the first part of the region.
fn bulk_material(file: &ExperimentFile, section: &AnalysisSection, seen: &Seen<'_>) -> Option<usize> {
    match &section.bulk {
        Some(BulkReference::Concentrations(_)) => None,
        Some(BulkReference::Material(name)) => {
            file.material.iter().position(|material| material.name == *name)
        }
        None => {
            let part = section.place.parts.first()?;
            Some(seen.objects.iter().find(|object| object.name == *part)?.material)
        }
    }
}

/// Shapes of a material: those of the region, if any of these are made of it.
fn shapes_of<'s>(
    material: usize,
    section: &AnalysisSection,
    seen: &'s Seen<'_>,
) -> impl Iterator<Item = &'s Shape> {
    let of_material = move || seen.objects.iter().filter(move |object| object.material == material);
    let in_region = |object: &&Object| section.place.parts.contains(&object.name);
    let region_has_it = of_material().any(|object| in_region(&object));
    let parts = section.place.parts.clone();
    of_material()
        .filter(move |object| !region_has_it || parts.contains(&object.name))
        .map(|object| &object.shape)
}

/// The fluorophores of the scene. Where the first part of the region is layered tissue, they emit as its surface does, in the
/// mean state of the region.
fn as_the_region_shows_them(
    file: &ExperimentFile,
    section: &AnalysisSection,
    seen: &Seen<'_>,
) -> Vec<Fluorophore> {
    let mut list = seen.fluorophores.list.clone();
    let region =
        section.place.parts.first().and_then(|part| seen.objects.iter().find(|object| object.name == *part));
    let index = region.map(|object| object.material).or_else(|| bulk_material(file, section, seen));
    let Some(index) = index else { return list };
    let material = &seen.materials[index];
    let Some(states) = seen.states(index) else { return list };
    let mean = |map: &ScalarTexture| {
        ScalarTexture::Constant(surface_mean(map, shapes_of(index, section, seen)) as f32)
    };
    let weights = states.with_maps(mean).weights_at(Vec2::ZERO);
    for (number, fluorophore) in list.iter_mut().enumerate() {
        let of_state = material.fluorophores.iter().filter(|amount| amount.fluorophore == number);
        let parts = of_state.filter_map(|amount| {
            let state = amount.in_tissue.as_ref()?;
            Some((f64::from(weights[state.term]), &*state.eem))
        });
        if let Some(eem) = PhotonEem::weighted_sum(parts) {
            fluorophore.eem = eem;
        }
    }
    list
}
