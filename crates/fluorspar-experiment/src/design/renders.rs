//! Scenes of a design problem that must be rendered: which, under what names, and where the regions lie in them.

use fluorspar::analysis::{Rectangle, RegionOfInterest};
use fluorspar::design::{DesignProblem, GeometryChoice, LensChoice, LightChoice, RegionModel};
use fluorspar::safety::RetinalObserver;
use fluorspar::spectral::WavelengthGrid;
use fluorspar::study::Study;

use super::regions::{Axes, TissueFactors, change_by_blood, tissue_factors, with_bulk};
use super::schema::{DesignFile, RegionSection, RenderedRegionSection};
use super::vary::{Base, Choice};
use crate::change::scene_change::SceneChange;
use crate::error::{Place, steps};
use crate::resolve::context::{Context, Resolved};
use crate::resolve::{FileRecord, ResolvedExperiment, resolve};

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
    /// Where an eye looks into the lights: distance from the camera's pupil along its axis, mm, and whose it is. `None` where the scene
    /// does not say.
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
    /// Solid angle of each aperture where the lens is focused in each geometry, sr, `[geometry][aperture]`.
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
                model.changes.extend(change_by_blood(&model.response, self.blood_um));
                model.changes.extend(region.tissue.iter().map(|factors| factors.change_of(&model.response)));
                geometry.regions.push(model);
            }
        }
        problem
    }

    /// Focuses the lens in each geometry as its scene does.
    pub(super) fn focus(&mut self, lenses: &[LensChoice]) {
        let Some(region) = self.regions.first() else { return };
        let lens_of = |render: &usize| self.renders[*render].study.camera.lens.as_ref();
        let focused = |render| match lens_of(render) {
            Some(lens) if lens.traced.is_none() => lenses
                .iter()
                .map(|choice| LensChoice::new(&lens.equation, choice.f_number).solid_angle_sr)
                .collect(),
            _ => Vec::new(),
        };
        self.lens_sr = region.renders.iter().map(focused).collect();
    }
}

/// Finds the scenes of all rendered regions in all geometries.
pub(super) fn renders(
    context: &mut Context<'_>,
    file: &DesignFile,
    base: &Base,
    lights: &[LightChoice],
    light_group: &str,
    geometries: &[Choice],
) -> Resolved<DesignRenders> {
    let unknown = &file.question.unknown;
    let mut found = DesignRenders { blood_um: unknown.blood_um, ..DesignRenders::default() };
    let regions = file.question.region.iter().enumerate();
    let rendered: Vec<(usize, &RegionSection, &RenderedRegionSection)> =
        regions.filter_map(|(index, section)| Some((index, section, section.rendered.as_ref()?))).collect();
    if rendered.is_empty() {
        if !geometries[0].changes.is_empty() {
            let message = "there is no region that a geometry could change; give a [[region]] with rendered = { parts = [...] }";
            return context.fail(&steps!["vary"], message);
        }
        return Ok(found);
    }
    if geometries.len() * rendered.len() > MOST_RENDERS {
        let message = format!(
            "there are more than {MOST_RENDERS} combinations of values and regions; give fewer values"
        );
        return context.fail(&steps!["vary"], message);
    }
    found.geometries = geometries.iter().map(|geometry| geometry.name.clone()).collect();
    let mut known: Vec<(&[String], usize)> = Vec::new();
    for (index, section, of_region) in rendered {
        let at = steps!["region", index, "rendered"];
        let rectangle = of_region.rectangle_px.map(|corners| {
            let [col, row, width, height] = corners.map(|value| value as usize);
            Rectangle { col, row, width, height }
        });
        let region =
            RegionOfInterest { parts: of_region.parts.clone(), rectangle, ..RegionOfInterest::default() };
        let mut renders = Vec::new();
        for (number, geometry) in geometries.iter().enumerate() {
            let scene = (of_region.set.as_slice(), number);
            if !known.contains(&scene) {
                let own = of_region.set.iter().map(String::as_str);
                let words: Vec<&str> =
                    own.chain((geometries.len() > 1).then_some(geometry.name.as_str())).collect();
                let name = if words.is_empty() { "the scene".into() } else { words.join(", ") };
                let study = scene_of(context, &at, base, lights, &of_region.set, geometry)?;
                found.renders.push(design_render(context, light_group, name, study)?);
                known.push(scene);
            }
            renders.extend(known.iter().position(|other| *other == scene));
        }
        let study = &found.renders[renders[0]].study;
        check_region(context, &at, &region, study)?;
        let names = study.scene.fluorophores.iter().map(|known| known.name.as_str());
        context.check_names(
            &at.field("apart"),
            &of_region.apart,
            names,
            "the scene has no such fluorophore",
        )?;
        let tissue = unknown_tissue(context, &at, file, of_region, study)?;
        let (name, apart) = (section.name.clone(), of_region.apart.clone());
        found.regions.push(DesignRegion { name, region, renders, apart, tissue });
    }
    check_lights(context, lights, &found);
    let known: Vec<&str> = found
        .regions
        .iter()
        .filter(|region| region.tissue.is_empty())
        .map(|region| region.name.as_str())
        .collect();
    if unknown.tissue > 0.0 && !known.is_empty() {
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
    if file.question.unknown.tissue <= 0.0 {
        let message = "the tissue counts where its spread is not known; give unknown.tissue, for instance 1";
        return context.fail(&at, message);
    }
    let basis = study.render.excitation_basis.as_ref();
    let nodes_nm = basis.map_or_else(Vec::new, |basis| basis.nodes.nodes_nm().to_vec());
    tissue_factors(context, &at, file, &section.tissue, &Axes { grid: &study.scene.grid, nodes_nm })
}

/// The scene with the changes of a region, a geometry, and an excitation basis for the lights.
fn scene_of(
    context: &Context<'_>,
    at: &Place,
    base: &Base,
    lights: &[LightChoice],
    set: &[String],
    geometry: &Choice,
) -> Resolved<ResolvedExperiment> {
    let read = || {
        let set = set.iter().map(|text| SceneChange::read(text)).collect::<Resolved<Vec<_>>>()?;
        let mut experiment = base.scene(&[set, geometry.changes.clone()].concat())?;
        experiment.file.render.excitation_basis_nm.get_or_insert_with(|| peaks_nm(lights));
        resolve(&experiment)
    };
    let resolved = match read() {
        Ok(resolved) => resolved,
        Err(error) => return context.fail(at, format!("the scene can't be rendered: {error}")),
    };
    if resolved.study.scene.camera.lens.is_some()
        || resolved.study.scene.camera.parallel_half_width_m.is_some()
    {
        let message = "the scene is rendered through a traced lens or with parallel rays; a design has an ideal lens: give \
                       lens.focal_length_mm or camera.horizontal_field_deg";
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

fn design_render(
    context: &Context<'_>,
    light_group: &str,
    name: String,
    resolved: ResolvedExperiment,
) -> Resolved<DesignRender> {
    let ResolvedExperiment { study, record } = resolved;
    let basis = study.render.excitation_basis.as_ref();
    let groups = basis.iter().flat_map(|basis| &basis.groups);
    let names: Vec<&str> = groups.map(|&group| study.scene.light_groups[group].name.as_str()).collect();
    if !names.contains(&light_group) {
        let message = format!(
            "the light group \"{light_group}\" has no narrow spectrum within render.excitation_basis_nm; those that have one: {}",
            names.join(", ")
        );
        return context.fail(&steps!["light"], message);
    }
    let plan = study.safety.as_ref();
    let eye = plan.and_then(|plan| Some((plan.patient_eye_distance_mm?, observer(plan.aphakic))));
    Ok(DesignRender { name, study, record, light_group: light_group.into(), eye })
}

/// An eye with its lens, or without.
pub(super) fn observer(aphakic: bool) -> RetinalObserver {
    if aphakic { RetinalObserver::Aphakic } else { RetinalObserver::Normal }
}

/// Refuses parts and pixels that the scene does not have, before it is rendered.
fn check_region(context: &Context<'_>, at: &Place, region: &RegionOfInterest, study: &Study) -> Resolved<()> {
    let names = study.scene.objects.iter().map(|object| object.name.as_str());
    context.check_names(&at.field("parts"), &region.parts, names, "the scene has no such part")?;
    let (width, height) = (study.scene.camera.width, study.scene.camera.height);
    let is_inside = |area: &Rectangle| {
        area.width > 0
            && area.height > 0
            && area.col + area.width <= width
            && area.row + area.height <= height
    };
    match &region.rectangle {
        Some(area) if !is_inside(area) => {
            let message = format!(
                "{area} do not lie in the render of {width} x {height} pixels; give column, row, width and height"
            );
            context.fail(&at.field("rectangle_px"), message)
        }
        _ => Ok(()),
    }
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
             left out: {}; widen render.excitation_basis_nm",
            names.join(", ")
        );
        context.warn(&steps!["render", "excitation_basis_nm"], message);
    }
}

/// Refuses a grid on which the regions of a problem would differ.
pub(super) fn check_grid(
    context: &Context<'_>,
    grid: &WavelengthGrid,
    found: &DesignRenders,
) -> Resolved<()> {
    if found.renders.iter().any(|render| render.study.scene.grid != *grid) {
        let message = "a region changes the wavelengths, which all regions share; give [spectral] once, outside of regions";
        return context.fail(&steps!["region"], message);
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
