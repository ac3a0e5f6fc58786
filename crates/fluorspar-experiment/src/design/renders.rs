//! Scenes of a design problem that must be rendered: which, under what names, and where the regions lie in them.

use std::path::Path;

use fluorspar::analysis::{Rectangle, RegionOfInterest};
use fluorspar::design::{
    ChangeGrowth, DesignProblem, GeometryChoice, LightChoice, RegionModel, ResponseChange,
};
use fluorspar::safety::RetinalObserver;
use fluorspar::spectral::WavelengthGrid;
use fluorspar::study::Study;
use fluorspar_format::read_text_bounded;

use super::regions::{Axes, TissueFactors, below_blood, tissue_factors, with_bulk};
use super::schema::{
    DesignFile, GeometrySection, GeometryValue, RegionSection, RenderedRegionSection, SceneSource,
};
use crate::error::{Place, steps};
use crate::preset;
use crate::read::parse;
use crate::resolve::context::{Context, Resolved};
use crate::resolve::{FileRecord, ResolvedExperiment, resolve};
use crate::schema::SpectralSection;

/// Largest experiment file, bytes.
const MOST_EXPERIMENT_BYTES: u64 = 64 << 20;
/// Most renders of one problem.
const MOST_RENDERS: usize = 1000;
/// Share of a light that may lie where the render keeps no excitation apart.
const MOST_OUTSIDE: f64 = 0.01;

/// A scene that must be rendered, with an excitation basis.
#[derive(Clone, Debug, PartialEq)]
pub struct DesignRender {
    /// What it shows: the geometry, and what the regions change.
    pub name: String,
    /// The study.
    pub study: Study,
    /// The experiment; its digest names the render.
    pub record: FileRecord,
    /// The light group whose place the lights of a design take.
    pub light_group: String,
    /// Where an eye looks into the lights: distance from the camera's pupil along its axis, mm, and whose it is. `None` where neither the
    /// design nor the scene tells.
    pub eye: Option<(f64, RetinalObserver)>,
}

/// A region that is seen in renders.
#[derive(Clone, Debug, PartialEq)]
pub struct DesignRegion {
    /// Name.
    pub name: String,
    /// Where it lies in the image.
    pub region: RegionOfInterest,
    /// Number of the render for each geometry.
    pub renders: Vec<usize>,
    /// Fluorophores that have weights of their own, where not all have: the others are one, `bulk`.
    pub apart: Vec<String>,
    /// What is not known of its tissue.
    pub(super) tissue: Vec<TissueFactors>,
}

/// Renders of a problem, and what is taken from them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DesignRenders {
    /// Scenes that must be rendered, each once.
    pub renders: Vec<DesignRender>,
    /// Rendered regions.
    pub regions: Vec<DesignRegion>,
    /// Names of the geometries.
    pub geometries: Vec<String>,
    /// Working distance of the lens in each geometry, mm, where it has one of its own.
    pub(super) distances_mm: Vec<Option<f64>>,
    /// Solid angle of each aperture at that distance, sr, `[geometry][aperture]`; empty without one.
    pub(super) lens_sr: Vec<Vec<f64>>,
    /// Thickness of whole blood that is not known, um.
    pub(super) blood_um: f64,
}

impl DesignRenders {
    /// A problem with its rendered regions, `[region][geometry]`, in the order of [`Self::regions`] and [`Self::geometries`].
    #[must_use]
    pub fn complete(&self, mut problem: DesignProblem, regions: Vec<Vec<RegionModel>>) -> DesignProblem {
        let choice = |(number, name): (usize, &String)| GeometryChoice {
            name: name.clone(),
            regions: Vec::new(),
            lens_sr: self.lens_sr.get(number).cloned().unwrap_or_default(),
            eye: None,
        };
        problem.geometries = self.geometries.iter().enumerate().map(choice).collect();
        for (models, region) in regions.into_iter().zip(&self.regions) {
            for (geometry, mut model) in problem.geometries.iter_mut().zip(models) {
                if !region.apart.is_empty() {
                    with_bulk(&mut model.response, &region.apart);
                }
                if self.blood_um > 0.0 {
                    let moved = below_blood(&model.response, self.blood_um);
                    model.changes.extend(ResponseChange::between(
                        "blood",
                        &model.response,
                        &moved,
                        ChangeGrowth::Attenuation,
                    ));
                }
                model.changes.extend(region.tissue.iter().map(|factors| factors.change_of(&model.response)));
                geometry.regions.push(model);
            }
        }
        problem
    }

    /// Power of the designed group as the scenes have it, W.
    pub(super) fn own_power_w(&self) -> Option<f64> {
        let render = self.renders.first()?;
        let scene = &render.study.scene;
        let group = scene.light_groups.iter().position(|group| group.name == render.light_group)?;
        let mut lights = scene.lights.iter().filter(|light| light.group == group);
        lights.next().map(|light| light.whole_spectrum().total())
    }
}

/// Finds the scenes of all rendered regions in all geometries.
pub(super) fn renders(
    context: &mut Context<'_>,
    file: &DesignFile,
    lights: &[LightChoice],
) -> Resolved<DesignRenders> {
    let mut found = DesignRenders { blood_um: file.unknown.blood_um, ..DesignRenders::default() };
    let rendered: Vec<(usize, &RegionSection, &RenderedRegionSection)> = file
        .region
        .iter()
        .enumerate()
        .filter_map(|(index, section)| Some((index, section, section.rendered.as_ref()?)))
        .collect();
    if rendered.is_empty() {
        if !file.geometry.is_empty() {
            let message = "there is no region that a geometry could change; give a [[region]] with rendered = { parts = [...] }";
            return context.fail(&steps!["geometry"], message);
        }
        return Ok(found);
    }
    let geometries = geometries(context, &file.geometry)?;
    if geometries.len() * rendered.len() > MOST_RENDERS {
        let message = format!(
            "there are more than {MOST_RENDERS} combinations of values and regions; give fewer values"
        );
        return context.fail(&steps!["geometry"], message);
    }
    let (text, source, folder) = scene_text(context, file)?;
    found.geometries = geometries.iter().map(|geometry| geometry.name.clone()).collect();
    found.distances_mm = geometries.iter().map(|geometry| geometry.distance_mm).collect();
    let mut known: Vec<Vec<String>> = Vec::new();
    for (index, section, of_region) in rendered {
        let at = steps!["region", index].field("rendered");
        let rectangle = of_region.rectangle_px.map(|[col, row, width, height]| {
            let [col, row, width, height] = [col, row, width, height].map(|value| value as usize);
            Rectangle { col, row, width, height }
        });
        let region =
            RegionOfInterest { parts: of_region.parts.clone(), rectangle, ..RegionOfInterest::default() };
        let mut numbers = Vec::new();
        for NamedGeometry { name, changes, .. } in &geometries {
            let mut overrides = file.scene.iter().flat_map(|scene| scene.set.clone()).collect::<Vec<_>>();
            overrides.extend(of_region.set.iter().chain(changes).cloned());
            let number = match known.iter().position(|other| *other == overrides) {
                Some(number) => number,
                None => {
                    let own = of_region.set.iter().map(String::as_str);
                    let words: Vec<&str> =
                        own.chain((geometries.len() > 1).then_some(name.as_str())).collect();
                    let title = if words.is_empty() { "the scene".into() } else { words.join(", ") };
                    let study = scene(context, &at, file, lights, [&text, &source], &folder, &overrides)?;
                    found.renders.push(design_render(context, file, title, study)?);
                    known.push(overrides);
                    known.len() - 1
                }
            };
            numbers.push(number);
        }
        let study = &found.renders[numbers[0]].study;
        check_parts(context, &at, &region, study)?;
        check_apart(context, &at, &of_region.apart, study)?;
        let tissue = unknown_tissue(context, &at, file, of_region, study)?;
        let apart = of_region.apart.clone();
        found.regions.push(DesignRegion {
            name: section.name.clone(),
            region,
            renders: numbers,
            apart,
            tissue,
        });
    }
    check_lights(context, lights, &found);
    let known: Vec<&str> = found
        .regions
        .iter()
        .filter(|region| region.tissue.is_empty())
        .map(|region| region.name.as_str())
        .collect();
    if file.unknown.tissue > 0.0 && !known.is_empty() {
        let message = format!(
            "the tissue of these rendered regions is taken as known: {}; say of what tissue they are, such as rendered.tissue = \
             [\"dorsal_tongue\"], or of which they may be",
            known.join(", ")
        );
        context.warn(&steps!["unknown", "tissue"], message);
    }
    Ok(found)
}

/// What is not known of the tissue of a rendered region.
fn unknown_tissue(
    context: &mut Context<'_>,
    at: &Place,
    file: &DesignFile,
    section: &RenderedRegionSection,
    study: &Study,
) -> Resolved<Vec<TissueFactors>> {
    let at = at.field("tissue");
    if section.tissue.is_empty() {
        return Ok(Vec::new());
    }
    if file.unknown.tissue <= 0.0 {
        let message = "the tissue counts where its spread is not known; give unknown.tissue, for instance 1";
        return context.fail(&at, message);
    }
    let basis = study.render.excitation_basis.as_ref();
    let nodes_nm = basis.map_or_else(Vec::new, |basis| basis.nodes.nodes_nm().to_vec());
    tissue_factors(context, &at, file, &section.tissue, &Axes { grid: &study.scene.grid, nodes_nm })
}

/// One combination of the values of the variables.
#[derive(Clone)]
struct NamedGeometry {
    name: String,
    /// The changes that make it.
    changes: Vec<String>,
    distance_mm: Option<f64>,
}

/// Refuses fluorophores that the scene does not have.
fn check_apart(context: &Context<'_>, at: &Place, apart: &[String], study: &Study) -> Resolved<()> {
    let names: Vec<&str> = study.scene.fluorophores.iter().map(|known| known.name.as_str()).collect();
    for (index, name) in apart.iter().enumerate() {
        if !names.contains(&name.as_str()) {
            let hint = fluorspar::names::did_you_mean(name, names.iter().copied());
            let message =
                format!("the scene has no such fluorophore{hint} Its fluorophores: {}", names.join(", "));
            return context.fail(&at.field("apart").index(index), message);
        }
    }
    Ok(())
}

/// All combinations of the values of the variables, by name, with the changes that make them.
fn geometries(context: &Context<'_>, sections: &[GeometrySection]) -> Resolved<Vec<NamedGeometry>> {
    let mut found = vec![NamedGeometry { name: String::new(), changes: Vec::new(), distance_mm: None }];
    for (index, section) in sections.iter().enumerate() {
        let at = steps!["geometry", index];
        if section.values.is_empty() {
            return context.fail(&at.field("values"), "give at least one value");
        }
        let distances = &section.working_distance_mm;
        let at_distances = at.field("working_distance_mm");
        if !distances.is_empty() && distances.len() != section.values.len() {
            let message = format!("give one distance for each of the {} values", section.values.len());
            return context.fail(&at_distances, message);
        }
        if !distances.is_empty() && found[0].distance_mm.is_some() {
            return context
                .fail(&at_distances, "another geometry gives the distances already; remove one of the two");
        }
        let last = section.field.rsplit('.').next().unwrap_or_default();
        let label = section.name.as_deref().unwrap_or(last);
        let with = |held: &NamedGeometry, number: usize, value: &GeometryValue| {
            let own = format!("{label} {}", value.text());
            let change = format!("{}={}", section.field, value.text());
            NamedGeometry {
                name: if held.name.is_empty() { own } else { format!("{}, {own}", held.name) },
                changes: held.changes.iter().cloned().chain([change]).collect(),
                distance_mm: distances.get(number).copied().or(held.distance_mm),
            }
        };
        let mut combined = Vec::with_capacity(found.len() * section.values.len());
        for held in &found {
            combined
                .extend(section.values.iter().enumerate().map(|(number, value)| with(held, number, value)));
        }
        found = combined;
    }
    if sections.is_empty() {
        found[0].name = "as in the scene".into();
    }
    Ok(found)
}

/// Text, name and folder of the experiment that is rendered.
fn scene_text(
    context: &mut Context<'_>,
    file: &DesignFile,
) -> Resolved<(String, String, std::path::PathBuf)> {
    let at = steps!["scene"];
    let Some(section) = &file.scene else {
        let message =
            "rendered regions need a scene; add [scene] with preset (an experiment of the catalogue) or file";
        return context.fail(&at, message);
    };
    match &section.source {
        SceneSource::Preset { preset: name } => match preset::experiment(name) {
            Ok(found) => Ok((found.text.into(), format!("experiment \"{name}\""), ".".into())),
            Err(error) => context.fail(&at.field("preset"), error.to_string()),
        },
        SceneSource::File { file: path } => {
            let at = at.field("file");
            context.note_input(&at, path)?;
            let path: &Path = path.as_ref();
            let text = read_text_bounded(path, MOST_EXPERIMENT_BYTES)
                .map_err(|error| context.file_error(&at, &error))?;
            Ok((text, path.display().to_string(), path.parent().unwrap_or(Path::new(".")).into()))
        }
    }
}

/// Reads a scene with its changes, the bands of the design, and an excitation basis for its lights.
fn scene(
    context: &Context<'_>,
    at: &Place,
    file: &DesignFile,
    lights: &[LightChoice],
    [text, source]: [&str; 2],
    folder: &Path,
    overrides: &[String],
) -> Resolved<ResolvedExperiment> {
    let own = file.scene.as_ref().and_then(|scene| scene.peaks_nm);
    let [first, last] = own.unwrap_or_else(|| peaks_nm(lights));
    let mut all = bands(&file.spectral);
    all.push(format!("render.excitation_basis_nm=[{first:.1}, {last:.1}]"));
    all.extend(overrides.iter().cloned());
    let read = parse(text, source, folder, &all).and_then(|experiment| resolve(&experiment));
    let resolved = match read {
        Ok(resolved) => resolved,
        Err(error) => return context.fail(at, format!("the scene can't be rendered: {error}")),
    };
    if resolved.study.scene.camera.lens.is_some()
        || resolved.study.scene.camera.parallel_half_width_m.is_some()
    {
        let message = "the scene is rendered through a traced lens or with parallel rays; a design has an ideal lens: remove lens.prescription \
                       or give camera.horizontal_field_deg, in the scene or in scene.set";
        return context.fail(at, message);
    }
    Ok(resolved)
}

/// Least and largest peak of some lights, rounded outward to 5 nm.
fn peaks_nm(lights: &[LightChoice]) -> [f64; 2] {
    let rounded = |nm: f64| (nm / 5.0).round() * 5.0;
    let peaks = lights.iter().map(|light| light.peak_nm);
    let least = peaks.clone().fold(f64::INFINITY, f64::min);
    [rounded(least - 2.5), rounded(peaks.fold(0.0, f64::max) + 2.5)]
}

/// Bands of the design as changes of an experiment.
fn bands(section: &SpectralSection) -> Vec<String> {
    match section {
        SpectralSection::Edges(edges) => vec![format!("spectral={{ edges_nm = {:?} }}", edges.edges_nm)],
        SpectralSection::Uniform(bins) => {
            [("first_nm", bins.first_nm), ("last_nm", bins.last_nm), ("step_nm", bins.step_nm)]
                .map(|(name, value)| format!("spectral.{name}={value:?}"))
                .into()
        }
    }
}

fn design_render(
    context: &Context<'_>,
    file: &DesignFile,
    name: String,
    resolved: ResolvedExperiment,
) -> Resolved<DesignRender> {
    let ResolvedExperiment { study, record } = resolved;
    let at = steps!["scene", "light_group"];
    let basis = study.render.excitation_basis.as_ref();
    let groups = basis.map_or(&[][..], |basis| &basis.groups);
    let names: Vec<&str> =
        groups.iter().map(|&group| study.scene.light_groups[group].name.as_str()).collect();
    let wanted = file.scene.as_ref().and_then(|scene| scene.light_group.as_deref());
    let light_group = match (wanted, names.as_slice()) {
        (None, [only]) => (*only).to_owned(),
        (Some(wanted), _) if names.contains(&wanted) => wanted.to_owned(),
        _ => {
            let message = format!(
                "name the light group whose place the lights of the design take; with a narrow light are: {}",
                names.join(", ")
            );
            return context.fail(&at, message);
        }
    };
    let eye = eye_place(context, file, &study)?;
    Ok(DesignRender { name, study, record, light_group, eye })
}

/// Where an eye looks into the lights: distance from the camera, mm, and whose it is. Of the file, or else of the scene.
fn eye_place(
    context: &Context<'_>,
    file: &DesignFile,
    study: &Study,
) -> Resolved<Option<(f64, RetinalObserver)>> {
    let plan = study.safety.as_ref();
    let of_scene = plan.and_then(|plan| plan.patient_eye_distance_mm);
    let Some(section) = &file.eye else {
        let aphakic = plan.is_some_and(|plan| plan.aphakic);
        return Ok(of_scene.map(|mm| (mm, observer(aphakic))));
    };
    let at = steps!["eye"];
    for (field, is_given) in [
        ("source_mrad", section.source_mrad.is_some()),
        ("irradiance_share", section.irradiance_share.is_some()),
    ] {
        if is_given {
            let message =
                "the scene is rendered and tells it by the place of the eye; give distance_mm instead";
            return context.fail(&at.field(field), message);
        }
    }
    let own = section.distance_mm.map(|mm| context.within(&at.field("distance_mm"), mm, [1.0, 1e5], "mm"));
    Ok(own.transpose()?.or(of_scene).map(|mm| (mm, observer(section.aphakic))))
}

/// An eye with its lens, or without.
pub(super) fn observer(aphakic: bool) -> RetinalObserver {
    if aphakic { RetinalObserver::Aphakic } else { RetinalObserver::Normal }
}

/// Refuses parts that the scene does not have, before it is rendered.
fn check_parts(context: &Context<'_>, at: &Place, region: &RegionOfInterest, study: &Study) -> Resolved<()> {
    let names: Vec<&str> = study.scene.objects.iter().map(|object| object.name.as_str()).collect();
    for (index, part) in region.parts.iter().enumerate() {
        if !names.contains(&part.as_str()) {
            let hint = fluorspar::names::did_you_mean(part, names.iter().copied());
            let message = format!("the scene has no such part{hint} Its parts: {}", names.join(", "));
            return context.fail(&at.field("parts").index(index), message);
        }
    }
    if let Some(area) = region.rectangle {
        let (width, height) = (study.scene.camera.width, study.scene.camera.height);
        if area.width == 0
            || area.height == 0
            || area.col + area.width > width
            || area.row + area.height > height
        {
            let message = format!(
                "{area} do not lie in the render of {width} x {height} pixels; give column, row, width and height"
            );
            return context.fail(&at.field("rectangle_px"), message);
        }
    }
    Ok(())
}

/// Warns of lights that reach beyond what the renders keep apart.
fn check_lights(context: &mut Context<'_>, lights: &[LightChoice], found: &DesignRenders) {
    let Some(basis) = found.renders.first().and_then(|render| render.study.render.excitation_basis.as_ref())
    else {
        return;
    };
    let outside = |light: &&LightChoice| basis.nodes.share_outside(&light.spectrum) > MOST_OUTSIDE;
    let names: Vec<&str> = lights.iter().filter(outside).map(|light| light.name.as_str()).collect();
    if !names.is_empty() {
        let [first, last] = basis.nodes.span_nm();
        let message = format!(
            "more than 1 % of these lights lies outside the {first} to {last} nm that the renders keep apart, and what it excites there is \
             left out: {}; widen peaks_nm",
            names.join(", ")
        );
        context.warn(&steps!["scene", "peaks_nm"], message);
    }
}

/// Refuses a grid on which the regions of a problem would differ.
pub(super) fn check_grid(
    context: &Context<'_>,
    grid: &WavelengthGrid,
    found: &DesignRenders,
) -> Resolved<()> {
    if found.renders.iter().any(|render| render.study.scene.grid != *grid) {
        let message = "the scene has bands of its own; remove spectral from scene.set, and give the bands in [spectral] of the design";
        return context.fail(&steps!["scene", "set"], message);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use fluorspar::design::ExcitationBasis;
    use fluorspar::spectral::{Curve, WavelengthGrid};

    use fluorspar::design::{FluorescenceResponse, RegionResponse};

    use super::super::regions::BULK;
    use super::*;

    #[test]
    fn bulk_is_all_that_has_no_weight_of_its_own() {
        let part = |name: &str, value: f64| FluorescenceResponse {
            name: name.into(),
            amount: value,
            radiance: vec![value; 4],
        };
        let mut region = RegionResponse {
            name: "x".into(),
            grid: WavelengthGrid::uniform(500.0, 510.0, 10.0).unwrap(),
            excitation: ExcitationBasis::Nodes(vec![380.0, 400.0]),
            fluorescence: vec![part("a", 1.0), part("porphyrin", 2.0), part("c", 4.0)],
            reflected: Curve::constant(0.0),
        };
        with_bulk(&mut region, &["porphyrin".to_owned()]);
        assert_eq!(region.fluorescence, [part(BULK, 5.0), part("porphyrin", 2.0)]);
    }
}
