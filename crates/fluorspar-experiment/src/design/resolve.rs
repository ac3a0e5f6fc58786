//! From the file of a design problem to the problem.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::OnceLock;

use fluorspar::design::{
    Budget, ContrastDefinition, Criterion, Design, DesignCamera, DesignProblem, ExcitationBasis, ExposedEye,
    FilterChoice, FineBands, LensChoice, LightChoice, Limits, RegionModel, Tolerances, WeightPrior,
    WhiteFrame,
};
use fluorspar::digest::sha256_hex;
use fluorspar::geometry::OrientedPoint;
use fluorspar::light::Light;
use fluorspar::sensor::EXPOSURE_MS;
use fluorspar::spectral::{Curve, WavelengthGrid};
use fluorspar::study::{Lens, TissuePrior};
use fluorspar_format::FileFormat;
use glam::DVec3;

use super::regions::{Axes, BULK, cohort, region};
use super::renders::{DesignRenders, check_grid, observer, renders};
use super::schema::{
    ComparedDesignSection, CriterionChoice, DesignFile, DesignQuestion, ExcitationSection, ExposureTotal,
    SearchSection,
};
use super::vary::{Axis, Base, Choice, OF_SCENE, PRICE, UNUSED, Variables, WAVELENGTH_NM, anchor};
use crate::change::scene_change::SceneChange;
use crate::document::shape::Schema;
use crate::document::tree::{Content, Node};
use crate::error::{ExperimentError, Place, steps};
use crate::part_file::sample::SampleMaterial;
use crate::preset;
use crate::read::{change_document, read_merged_as, refuse_ignored, typed};
use crate::resolve::capture::prior_of;
use crate::resolve::context::{Context, Resolved};
use crate::resolve::spectrum::Role;
use crate::resolve::tissue::named_tissue;
use crate::resolve::{FileRecord, Setup, complete, device, fluorophore};
use crate::schema::{LightSection, SpectrumReference};

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
    /// What is known beforehand of the tissue of each region of a geometry; `None` where it is not tissue of one site of the mouth.
    pub priors: Vec<Option<TissuePrior>>,
    /// How it is searched.
    pub search: SearchSection,
    /// Tolerances of manufacture.
    pub tolerance: Tolerances,
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

/// The shapes of its question.
fn question_schema() -> &'static Schema {
    static SCHEMA: OnceLock<Schema> = OnceLock::new();
    SCHEMA.get_or_init(Schema::of::<DesignQuestion>)
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
    let mut document = read_merged_as(schema, &FileFormat::DESIGN, text, source_name, base_dir)?;
    let changes = overrides.iter().map(|text| SceneChange::read(text)).collect::<Resolved<Vec<_>>>()?;
    change_document(&mut document, schema, &changes, Path::new("."))?;
    // The sections of the question, and those of the experiment
    let of_question = |key: &str| {
        let table = question_schema().table(question_schema().root());
        table.is_some_and(|table| table.field(None, key).is_some())
    };
    let mut own = document.clone();
    own.root.retain(of_question);
    let mut question: DesignQuestion = typed(&mut own, question_schema())?;
    question.vary.iter_mut().flat_map(|vary| &mut vary.values).for_each(|value| anchor(value, base_dir));
    let is_rendered = question.region.iter().any(|region| region.rendered.is_some());
    refuse_ignored(&document, overrides, |key| {
        let is_unused = UNUSED.contains(&key) || (!is_rendered && OF_SCENE.contains(&key));
        is_unused.then(|| format!("`{key}` changes nothing of this design, whose regions do not look at it"))
    })?;
    let mut base =
        Base { document: document.clone(), folder: base_dir.into(), first: Vec::new(), lights: Vec::new() };
    base.document.root.retain(|key| !of_question(key));
    let file = DesignFile { experiment: base.experiment(&[])?.file, question };
    let context = &mut Context::new(&document);
    let variables = Variables::read(context, &file.question.vary)?;
    base.first = variables.first();
    let has_sensor = base.first.iter().any(|(axis, _)| *axis == Axis::Sensor);
    if file.experiment.sensor.is_none() && !has_sensor {
        let message = "there is no sensor; add [sensor], if only with preset = \"NAME\", or a [[vary]] of it";
        return context.fail(&steps!["sensor"], message);
    }
    if file.experiment.lens.is_none() {
        return context.fail(&steps!["lens"], "there is no lens; add [lens]");
    }
    let group = designed_group(context, &file, &variables)?;
    let white = file.question.exposure.white.as_ref().map(|white| white.light.as_str());
    let is_used = |light: &&LightSection| [Some(group.as_str()), white].contains(&Some(group_of(light)));
    base.lights = file.experiment.light.iter().filter(is_used).map(|light| light.name.clone()).collect();
    Reader { context, base: &base, file: &file, variables: &variables }.resolve(&group)
}

/// The light group whose lights are designed: that of the varied lights, or the only one.
fn designed_group(context: &Context<'_>, file: &DesignFile, variables: &Variables) -> Resolved<String> {
    let (at, lights) = (steps!["vary"], &file.experiment.light);
    let names = || lights.iter().map(|light| light.name.as_str());
    let numbers =
        variables.lights.iter().map(|name| context.known(&at, name, names(), "there is no such light"));
    let varied = numbers.collect::<Resolved<Vec<usize>>>()?;
    let white = file.question.exposure.white.as_ref().map(|white| white.light.as_str());
    let groups: BTreeSet<&str> = match varied.as_slice() {
        [] => lights.iter().map(group_of).filter(|group| Some(*group) != white).collect(),
        varied => varied.iter().map(|number| group_of(&lights[*number])).collect(),
    };
    match groups.iter().copied().collect::<Vec<_>>().as_slice() {
        [only] => Ok((*only).to_owned()),
        [] => context.fail(&at, "there is no light to design; add a [[light]], or a base that has one"),
        many => {
            let message = format!(
                "lights of several groups would be designed: {}; vary those of one, such as light.NAME.spectrum",
                many.join(", ")
            );
            context.fail(&at, message)
        }
    }
}

fn group_of(light: &LightSection) -> &str {
    light.group.as_deref().unwrap_or(&light.name)
}

/// A file that is being resolved.
struct Reader<'a, 'd> {
    context: &'a mut Context<'d>,
    base: &'a Base,
    file: &'a DesignFile,
    variables: &'a Variables,
}

impl Reader<'_, '_> {
    fn resolve(mut self, group: &str) -> Resolved<ResolvedDesign> {
        let DesignFile { experiment, question } = self.file;
        let grid = device::grid(self.context, &experiment.spectral)?;
        check_numbers(self.context)?;
        fluorophore::check_sections(self.context, &experiment.fluorophore)?;
        let lights = self.lights(group)?;
        let geometries = self.variables.along(Axis::Geometry, "as in the scene");
        let mut rendered = renders(self.context, self.file, self.base, &lights, group, &geometries)?;
        check_grid(self.context, &grid, &rendered)?;
        if let Some(region) = rendered.regions.first() {
            let digests = region.renders.iter().map(|&number| &rendered.renders[number].record.sha256);
            self.variables.check_effect(self.context, Axis::Geometry, digests)?;
        }
        let filters = self.filters()?;
        let lenses = self.lenses()?;
        rendered.focus(&lenses);
        let cameras = self.cameras(&grid)?;
        let axes = Axes { grid: &grid, nodes_nm: nodes(self.context, &question.excitation)? };
        check_span(self.context, &lights, &axes);
        let regions = self.flat_regions(&axes)?;
        let cohort = match &question.cohort {
            Some(section) => Some(cohort(self.context, self.file, section, &axes)?),
            None => None,
        };
        let known = known_weights(&regions, &rendered);
        let contrasts = contrasts(self.context, question, &known)?;
        let weights = weights(self.context, question, &known)?;
        let (exposure, limit) = (&question.exposure, &question.limit);
        let problem = DesignProblem {
            criterion: criterion(self.context, question, &contrasts)?,
            contrasts,
            cohort,
            lights,
            exposures: exposure.counts.iter().map(|&count| count as usize).collect(),
            filters,
            cameras,
            lenses,
            drives: exposure.drives.clone(),
            splits: exposure.splits.clone(),
            budget: match exposure.total {
                ExposureTotal::Time { ms } => Budget::Time(ms * 1e-3),
                ExposureTotal::Electrons { electrons } => Budget::Electrons(electrons),
            },
            white: self.white(&grid)?,
            library: question.unknown.library,
            assumptions: question.unknown.assumptions,
            weights,
            limits: Limits {
                tissue_margin: limit.tissue_margin,
                eye_margin: limit.eye_margin,
                leak: limit.leak,
                saturation: Some(limit.saturation),
                time_s: limit.total_ms.map(|ms| ms * 1e-3),
                cost: limit.cost,
            },
            eye: self.eye(&rendered)?,
            tissue_safety_factor: limit.tissue_safety_factor,
            regions,
            geometries: Vec::new(),
        };
        let compared = compared(self.context, question, &problem, &rendered.geometries)?;
        let priors = self.priors(&grid)?;
        let record = self.record(&rendered, &grid)?;
        Ok(ResolvedDesign {
            problem,
            priors,
            search: question.search,
            tolerance: question.tolerance,
            rendered,
            compared,
            names_compared: !question.compare.is_empty(),
            record,
        })
    }

    /// What is known of the tissue of each region, flat ones first.
    fn priors(&mut self, grid: &WavelengthGrid) -> Resolved<Vec<Option<TissuePrior>>> {
        let DesignFile { experiment, question } = self.file;
        let context = &mut *self.context;
        let mut of_kinds = [Vec::new(), Vec::new()];
        for (index, section) in question.region.iter().enumerate() {
            let at = steps!["region", index];
            let name = match (&section.material, &section.rendered) {
                (Some(SampleMaterial::Tissue(tissue)), _) => Some(&tissue.tissue),
                (_, Some(rendered)) if rendered.tissue.len() == 1 => rendered.tissue.first(),
                _ => None,
            };
            let mut prior = None;
            if let Some(name) = name {
                let tissues = &experiment.tissue;
                let named = named_tissue(context, &at, tissues, &experiment.fluorophore, grid, name)?;
                let site = named.site(context, &at).ok().filter(|site| site.is_mucosa());
                if let Some(site) = site.cloned() {
                    let tooth = preset::site("tooth").map_err(|error| context.error(&at, error))?;
                    prior = Some(prior_of(context, &at, &experiment.fluorophore, (site, Some(tooth)))?);
                }
            }
            of_kinds[usize::from(section.rendered.is_some())].push(prior);
        }
        Ok(of_kinds.into_iter().flatten().collect())
    }

    /// The file with every default written out, and its digest, in which renders count by theirs.
    fn record(&mut self, rendered: &DesignRenders, grid: &WavelengthGrid) -> Resolved<FileRecord> {
        let context = &mut *self.context;
        let mut file =
            DesignFile { experiment: complete(&self.file.experiment), question: self.file.question.clone() };
        let failed =
            |error: toml::ser::Error| context.error(&[], format!("the file can't be written out: {error}"));
        let mut sections = toml::Table::try_from(&file).map_err(failed)?;
        sections.insert("format".into(), i64::from(FileFormat::DESIGN.version()).into());
        let resolved_toml = crate::file_text(&sections).map_err(failed)?;
        let title = std::mem::take(&mut file.experiment.title);
        let description = std::mem::take(&mut file.experiment.description);
        let own = context.digest(&file).map_err(failed)?;
        let of_renders = rendered.renders.iter().map(|render| render.record.sha256.clone());
        let sha256 = match rendered.renders.as_slice() {
            [] => own,
            _ => sha256_hex(std::iter::once(own).chain(of_renders)),
        };
        Ok(FileRecord {
            title,
            description,
            output_folder: None,
            warnings: context.take_warnings(grid),
            inputs: std::mem::take(&mut context.inputs),
            base_files: context.document.base_files.clone(),
            resolved_toml,
            experiment: None,
            sha256,
        })
    }

    /// The regions whose signals follow from their materials; those that are rendered come with the renders.
    fn flat_regions(&mut self, axes: &Axes<'_>) -> Resolved<Vec<RegionModel>> {
        let (context, sections) = (&mut *self.context, &self.file.question.region);
        let mut regions = Vec::new();
        if sections.is_empty() {
            let message = "there is no region; add a [[region]] section with a name and a material";
            return context.fail(&steps!["region"], message);
        }
        for (index, section) in sections.iter().enumerate() {
            let at = steps!["region", index];
            let earlier = sections[..index].iter().map(|other| other.name.as_str());
            context.unique_name(&at, &section.name, earlier)?;
            if section.rendered.is_none() {
                regions.push(region(context, &at, self.file, section, axes)?);
            } else if section.material.is_some() {
                let message = "the region is rendered already; remove one of the two";
                return context.fail(&at.field("material"), message);
            } else if !section.apart.is_empty() {
                let message = "the region is rendered; give rendered = { apart = [...] } instead";
                return context.fail(&at.field("apart"), message);
            }
        }
        Ok(regions)
    }

    /// A light as a design takes it: the spectrum of its group, the power of the first in a scene, and its irradiance of flat regions, which
    /// lie where the camera looks.
    fn light_choice(&self, setup: &Setup, group: &str, choice: &Choice) -> Option<LightChoice> {
        let group = setup.light_groups.iter().position(|known| known.name == group)?;
        let of_group = || setup.lights.iter().filter(|light| light.group == group);
        let first = of_group().next()?.whole_spectrum();
        let position = 1e-3 * DVec3::from_array(self.file.experiment.camera.look_at_mm);
        let point = OrientedPoint { position, normal: -setup.view.forward.as_dvec3() };
        // No render takes the place of a light with a map either
        let irradiance = |light: &Light| match light.emitter.irradiance_factors(point).as_slice() {
            [factor] => factor * light.spectrum.total(),
            _ => 0.0,
        };
        let power_w = first.total();
        let light: f64 = of_group().map(irradiance).sum();
        let share = |light: &Light, nm: f64| light.whole_spectrum().at(nm) / light.whole_spectrum().total();
        let is_alike = |light: &Light| {
            let most = first.max() / power_w;
            first
                .wavelengths_nm()
                .iter()
                .all(|nm| (share(light, *nm) - first.at(*nm) / power_w).abs() < 1e-9 * most)
        };
        // Lights of several colors count by what they give of the light there
        let mixed = (light > 0.0 && !of_group().all(is_alike)).then(|| {
            let weight = |one: &Light| irradiance(one) / light / one.whole_spectrum().total();
            Curve::weighted_sum(of_group().map(|one| (one.whole_spectrum(), weight(one))))
        });
        let spectrum = trimmed(&mixed.flatten().unwrap_or_else(|| first.scaled(1.0 / power_w)));
        let peak_nm = spectrum.peak_nm();
        Some(LightChoice { name: choice.name.clone(), peak_nm, spectrum, light, power_w, cost: choice.cost })
    }

    fn lights(&mut self, group: &str) -> Resolved<Vec<LightChoice>> {
        let has_flat = self.file.question.region.iter().any(|region| region.rendered.is_none());
        let mut lights = Vec::new();
        for choice in self.variables.along(Axis::Light, group) {
            let setup = self.base.setup(self.context, Axis::Light, &choice)?;
            let Some(light) = self.light_choice(&setup, group, &choice) else { continue };
            if light.light <= 0.0 && has_flat {
                let message = format!(
                    "{}: no light reaches the point that the camera looks at, where flat regions lie; move or turn the light",
                    light.name
                );
                return self.context.fail(&steps!["light"], message);
            }
            lights.push(light);
        }
        let decisive = lights.iter().map(|light| (light.spectrum.clone(), light.light, light.power_w));
        self.variables.check_effect(self.context, Axis::Light, decisive)?;
        lights.sort_by(|a, b| a.peak_nm.total_cmp(&b.peak_nm));
        Ok(lights)
    }

    fn filters(&mut self) -> Resolved<Vec<FilterChoice>> {
        let given = self.base.words("view_filter.filters").unwrap_or_else(|| "no filter".into());
        let mut choices = Vec::new();
        for choice in self.variables.along(Axis::Filter, &given) {
            let fixed =
                self.base.setup(self.context, Axis::Filter, &choice)?.camera.view_filter.transmittance;
            let Choice { name, cost, long_pass, .. } = choice;
            choices.push(FilterChoice { name, fixed, long_pass, cost });
        }
        let decisive = choices.iter().map(|filter| (&filter.fixed, &filter.long_pass));
        self.variables.check_effect(self.context, Axis::Filter, decisive)?;
        Ok(choices)
    }

    fn lenses(&mut self) -> Resolved<Vec<LensChoice>> {
        let mut choices = Vec::new();
        let mut filter = None;
        for choice in self.variables.along(Axis::Aperture, "") {
            let setup = self.base.setup(self.context, Axis::Aperture, &choice)?;
            if *filter.get_or_insert_with(|| setup.camera.view_filter.clone()) != setup.camera.view_filter {
                let message = "\"lens\" gives each f-number filters of its own, and all share those of a search; give angle_deg, or search each \
                               f-number by itself";
                return self.context.fail(&steps!["view_filter", "angles"], message);
            }
            choices.extend(setup.camera.lens.map(|Lens { equation, .. }| LensChoice {
                f_number: equation.f_number,
                solid_angle_sr: equation.axial_solid_angle_sr(),
            }));
        }
        Ok(choices)
    }

    fn cameras(&mut self, grid: &WavelengthGrid) -> Resolved<Vec<DesignCamera>> {
        let bands = FineBands::of(grid);
        let mut wheel: Vec<(String, Curve)> = Vec::new();
        for (index, position) in self.file.question.exposure.wheel.iter().enumerate() {
            let at = steps!["exposure", "wheel", index];
            self.context.unique_name(&at, &position.name, wheel.iter().map(|(name, _)| name.as_str()))?;
            wheel.push((position.name.clone(), self.stack(&at, &position.filters, grid)?));
        }
        let mut is_turned = wheel.is_empty();
        let mut cameras = Vec::new();
        for choice in self.variables.along(Axis::Sensor, "sensor") {
            let setup = self.base.setup(self.context, Axis::Sensor, &choice)?;
            let (Some(sensor), Some(lens)) = (&setup.camera.sensor, &setup.camera.lens) else { continue };
            if sensor.model().strobe.is_some() {
                let message = "a search chooses exposure times, of which a strobe lights a part; remove it";
                return self.context.fail(&steps!["sensor", "strobe"], message);
            }
            if setup.camera.view_filter.stack.autofluorescence.is_some() {
                let message = "a search knows no fluorescence of filters; remove it";
                return self.context.fail(&steps!["view_filter", "autofluorescence"], message);
            }
            let glass = &lens.equation.transmittance;
            let mut camera = DesignCamera::new(&choice.name, sensor, 1.0, glass, &bands);
            if let Some(behind) = camera.behind_wheel(&wheel, &bands) {
                (camera, is_turned) = (behind, true);
            }
            camera.cost = choice.cost;
            cameras.push(camera);
        }
        if !is_turned {
            let message = "a wheel stands before a sensor of one channel, and none of the sensors is one; give a monochrome sensor";
            return self.context.fail(&steps!["exposure", "wheel"], message);
        }
        let decisive = cameras.iter().map(|camera| {
            let mut camera = camera.clone();
            camera.name.clear();
            camera.cost = 0.0;
            camera
        });
        self.variables.check_effect(self.context, Axis::Sensor, decisive)?;
        Ok(cameras)
    }

    /// Transmittance of all `filters` of a section together.
    fn stack(&mut self, at: &Place, filters: &[SpectrumReference], grid: &WavelengthGrid) -> Resolved<Curve> {
        let mut transmittance = Curve::constant(1.0);
        for (number, filter) in filters.iter().enumerate() {
            let at = at.field("filters").index(number);
            transmittance =
                transmittance.times(&self.context.spectrum(&at, filter, Role::Filter, 0.0, grid)?);
        }
        Ok(transmittance)
    }

    /// The frame under white light.
    fn white(&mut self, grid: &WavelengthGrid) -> Resolved<Option<WhiteFrame>> {
        let Some(section) = &self.file.question.exposure.white else { return Ok(None) };
        let at = steps!["exposure", "white"];
        let filter = self.stack(&at, &section.filters, grid)?;
        let groups = self.file.experiment.light.iter().map(group_of);
        self.context.known(
            &at.field("light"),
            &section.light,
            groups,
            "there is no light group of this name",
        )?;
        let choice = Choice { name: "white".into(), cost: section.cost, ..Choice::default() };
        let setup = self.base.setup(self.context, Axis::Light, &choice)?;
        let light = self.light_choice(&setup, &section.light, &choice);
        Ok(light.map(|light| WhiteFrame { light, filter, level: section.level }))
    }

    /// An eye before flat regions. Those of rendered scenes are in their renders.
    fn eye(&self, rendered: &DesignRenders) -> Resolved<Option<ExposedEye>> {
        let (question, is_flat) = (&self.file.question, rendered.renders.is_empty());
        let is_known = if is_flat {
            question.eye.is_some()
        } else {
            rendered.renders.iter().all(|render| render.eye.is_some())
        };
        let message = match (&question.eye, is_flat) {
            (Some(_), false) => {
                "the scene says where the eye is; give safety.patient_eye_distance_mm instead of [eye]"
            }
            _ if is_known || question.limit.eye_margin.is_none() => {
                let aphakic = self.file.experiment.safety.as_ref().is_some_and(|safety| safety.aphakic);
                return Ok(question.eye.as_ref().map(|eye| {
                    ExposedEye::before_source(eye.irradiance_share, 1e-3 * eye.source_mrad, observer(aphakic))
                }));
            }
            (_, false) => "limit.eye_margin needs the place of the eye; give safety.patient_eye_distance_mm",
            (_, true) => {
                "limit.eye_margin needs an eye; add [eye] with source_mrad, the angle that the light source subtends for it"
            }
        };
        self.context.fail(&steps!["eye"], message)
    }
}

/// Ranges of numbers and lists of numbers, ends included.
const RANGES: [(&str, [f64; 2]); 38] = [
    ("excitation.first_nm", WAVELENGTH_NM),
    ("excitation.last_nm", WAVELENGTH_NM),
    ("excitation.step_nm", [0.5, 20.0]),
    ("exposure.counts", [1.0, 6.0]),
    ("exposure.total.ms", [1e-3, EXPOSURE_MS[1]]),
    ("exposure.total.electrons", [1.0, 1e12]),
    ("exposure.splits", [0.001, 0.999]),
    ("exposure.drives", [1e-6, 1e6]),
    ("exposure.white.level", [0.001, 1.0]),
    ("exposure.white.cost", PRICE),
    ("unknown.gain", [0.0, 10.0]),
    ("unknown.drive", [0.0, 10.0]),
    ("unknown.leak", [0.0, 10.0]),
    ("unknown.tissue", [0.0, 10.0]),
    ("unknown.blood_um", [0.0, 1000.0]),
    ("unknown.emission_shift_nm", [0.0, 100.0]),
    ("unknown.excitation_shift_nm", [0.0, 100.0]),
    ("unknown.spectrum", [0.0, 1.0]),
    ("unknown.correlation_nm", [5.0, 500.0]),
    ("unknown.pixels", [1.0, 1e9]),
    ("unknown.brightest_fluorescence", [1.0, 1e6]),
    ("unknown.brightest_reflection", [1.0, 1e6]),
    ("limit.tissue_margin", [1e-3, 1e9]),
    ("limit.eye_margin", [1e-3, 1e9]),
    ("limit.tissue_safety_factor", [1.0, 1000.0]),
    ("limit.leak", [0.0, 1e6]),
    ("limit.saturation", [1e-6, 1e6]),
    ("limit.total_ms", [1e-6, 1e9]),
    ("limit.cost", PRICE),
    ("eye.source_mrad", [0.1, 3000.0]),
    ("eye.irradiance_share", [1e-6, 1e6]),
    ("search.most_exhaustive", [1.0, 1e8]),
    ("search.evaluations", [1.0, 1e7]),
    ("search.keep", [1.0, 1e4]),
    ("tolerance.light_nm", [0.0, 50.0]),
    ("tolerance.filter_nm", [0.0, 50.0]),
    ("tolerance.angle_deg", [0.0, 60.0]),
    ("tolerance.effective_index", [1.0, 4.0]),
];

/// Checks the numbers that a file gives; defaults are within their ranges.
fn check_numbers(context: &Context<'_>) -> Resolved<()> {
    let check = |at: &Place, node: &Node, range| match &node.content {
        Content::Leaf(toml::Value::Integer(value)) => context.within(at, *value as f64, range, "").map(drop),
        Content::Leaf(toml::Value::Float(value)) => context.within(at, *value, range, "").map(drop),
        _ => Ok(()),
    };
    for (path, range) in RANGES {
        let at = path.split('.').fold(Place::default(), |at, key| at.field(key));
        let node = at.iter().try_fold(&context.document.root, |node, step| node.step(step));
        match node.map(|node| (node, &node.content)) {
            Some((_, Content::Array(items))) if items.is_empty() => {
                return context.fail(&at, "give at least one");
            }
            Some((_, Content::Array(items))) => {
                let mut items = items.iter().enumerate();
                items.try_for_each(|(index, item)| check(&at.index(index), item, range))?;
            }
            Some((node, _)) => check(&at, node, range)?,
            None => {}
        }
    }
    Ok(())
}

/// Nodes of the excitation.
fn nodes(context: &Context<'_>, section: &ExcitationSection) -> Resolved<Vec<f64>> {
    if section.last_nm <= section.first_nm {
        return context.fail(&steps!["excitation", "last_nm"], "must be above first_nm");
    }
    Ok(ExcitationBasis::every(section.first_nm, section.last_nm, section.step_nm).centers_nm())
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

/// Priors of weights, of fluorophores that some region holds.
fn weights(context: &Context<'_>, question: &DesignQuestion, known: &[String]) -> Resolved<Vec<WeightPrior>> {
    let prior = |(name, &relative): (&String, &f64)| {
        let at = steps!["unknown", "weights", name];
        context.known(&at, name, known.iter().map(String::as_str), NOT_HELD)?;
        context.within(&at, relative, [1e-6, 1e6], "of the amount that the region holds")?;
        Ok(WeightPrior { fluorophore: name.clone(), relative })
    };
    question.unknown.weights.iter().map(prior).collect()
}

/// What is wrong with the name of a fluorophore.
const NOT_HELD: &str = "no region holds this fluorophore";

/// Names of all weights that regions may have.
fn known_weights(regions: &[RegionModel], rendered: &DesignRenders) -> Vec<String> {
    let parts = regions.iter().flat_map(|region| &region.response.fluorescence).map(|part| &part.name);
    let scenes = rendered.renders.iter().flat_map(|render| &render.study.scene.fluorophores);
    let mut known: BTreeSet<String> = parts.chain(scenes.map(|part| &part.name)).cloned().collect();
    if rendered.regions.iter().any(|region| !region.apart.is_empty()) {
        known.insert(BULK.into());
    }
    known.into_iter().collect()
}

/// Contrasts whose names are of fluorophores that some region holds.
fn contrasts(
    context: &Context<'_>,
    question: &DesignQuestion,
    known: &[String],
) -> Resolved<Vec<ContrastDefinition>> {
    let mut found = question.contrast.clone();
    for (index, contrast) in found.iter_mut().enumerate() {
        let at = steps!["contrast", index];
        let earlier = question.contrast[..index].iter().map(|other| other.name.as_str());
        context.unique_name(&at, &contrast.name, earlier)?;
        for (field, names) in [("part", &contrast.part), ("whole", &contrast.whole)] {
            context.check_names(&at.field(field), names, known.iter().map(String::as_str), NOT_HELD)?;
        }
        if contrast.part.is_empty() {
            return context.fail(&at.field("part"), "give at least one fluorophore");
        }
        if contrast.whole.is_empty() {
            contrast.whole = known.to_vec();
        }
    }
    Ok(found)
}

fn criterion(
    context: &Context<'_>,
    question: &DesignQuestion,
    contrasts: &[ContrastDefinition],
) -> Resolved<Criterion> {
    let at = steps!["criterion"];
    Ok(match question.criterion {
        CriterionChoice::Minimax => Criterion::Minimax,
        CriterionChoice::D => Criterion::D,
        CriterionChoice::A => Criterion::A,
        CriterionChoice::E => Criterion::E,
        CriterionChoice::Detection if question.cohort.is_none() => {
            let message = "there is no cohort to tell apart; add [cohort] with a tissue and a state";
            return context.fail(&at, message);
        }
        CriterionChoice::Detection => Criterion::Detection,
        CriterionChoice::Leak => Criterion::Leak,
        CriterionChoice::Contrast if contrasts.is_empty() => {
            let message = "there is no contrast; add a [[contrast]] section with a name and its part";
            return context.fail(&at, message);
        }
        CriterionChoice::Contrast => Criterion::Contrast(match &question.criterion_contrast {
            None => 0,
            Some(wanted) => {
                let names = contrasts.iter().map(|contrast| contrast.name.as_str());
                context.known(&steps!["criterion_contrast"], wanted, names, "there is no such contrast")?
            }
        }),
    })
}

/// Designs of the file by number; without any the first choice of everything.
fn compared(
    context: &Context<'_>,
    question: &DesignQuestion,
    problem: &DesignProblem,
    geometries: &[String],
) -> Resolved<Vec<ComparedDesign>> {
    let mut found = Vec::new();
    for (index, section) in question.compare.iter().enumerate() {
        let at = steps!["compare", index];
        context.unique_name(
            &at,
            &section.name,
            question.compare[..index].iter().map(|other| other.name.as_str()),
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
    let number = |field: &str, wanted: &Option<String>, known: Vec<&str>| match wanted {
        None => Ok(0),
        Some(wanted) => context.known(&at.field(field), wanted, known, "there is no such choice"),
    };
    let known = || problem.lights.iter().map(|light| light.name.as_str()).collect();
    let lights = section.lights.iter().map(|name| number("lights", &Some(name.clone()), known()));
    let mut lights = lights.collect::<Resolved<Vec<usize>>>()?;
    lights.sort_unstable();
    lights.dedup();
    if lights.len() != section.lights.len() || !problem.exposures.contains(&lights.len()) {
        let counts: Vec<String> = problem.exposures.iter().map(ToString::to_string).collect();
        let message =
            format!("name different lights, as many as exposure.counts allows: {}", counts.join(" or "));
        return context.fail(&at.field("lights"), message);
    }
    let apertures: Vec<String> = problem.lenses.iter().map(|lens| lens.f_number.to_string()).collect();
    let f_number = section.f_number.map(|f_number| f_number.to_string());
    let filters = problem.filters.iter().map(|filter| filter.name.as_str()).collect();
    let cameras = problem.cameras.iter().map(|camera| camera.name.as_str()).collect();
    Ok(Design {
        lights,
        filter: number("view_filter", &section.view_filter, filters)?,
        camera: number("sensor", &section.sensor, cameras)?,
        lens: number("f_number", &f_number, apertures.iter().map(String::as_str).collect())?,
        geometry: number("geometry", &section.geometry, geometries.iter().map(String::as_str).collect())?,
        drive: 0,
        split: 0,
    })
}
