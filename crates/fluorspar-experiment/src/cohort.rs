//! Cohorts: an experiment with a mouth, for many people and views of an examination.

use std::collections::BTreeSet;
use std::path::Path;

use fluorspar::sampling::random::Key;
use fluorspar_anatomy::{EXAMINATION_VIEWS, ExaminationView, MouthParameters, POSE_FIELDS, sample_person};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::change::scene_change::SceneChange;
use crate::document::tree::{Content, Document};
use crate::error::{ExperimentError, steps};
use crate::file_text::file_text;
use crate::people::{give_restorations_of, give_tissues_of};
use crate::read::{
    Experiment, change_document, experiment_schema, finish_document, read_merged, schema_of, typed,
};
use crate::resolve::context::{Context, Resolved};
use crate::schema::{
    AnalysisRegionSection, ExperimentFile, LesionSection, MouthSection, SensorRegionSection,
};

/// The file of a cohort: an experiment with a mouth, and the people whose mouths take its place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CohortFile {
    /// Camera, lights, materials, captures and analysis.
    #[serde(flatten)]
    pub experiment: ExperimentFile,
    /// Who is examined.
    #[serde(flatten)]
    pub question: CohortQuestion,
}

/// What the file of a cohort has beside an experiment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CohortQuestion {
    /// Who is examined, and which views.
    pub people: PeopleSection,
}

/// The people of a cohort and the views of their examination.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PeopleSection {
    /// Number of people, 1 to 100 000. More later go on from those that are finished. Default 100.
    pub count: u32,
    /// Number of the first person, 1 to 4 000 000 000; the others follow, as in `mouth sample --seed`. Default 1.
    pub first: u32,
    /// Views: names among the nine of an examination in `mouth view --list`. Default: all nine.
    pub views: Vec<String>,
    /// Share of the people that have each `[[mouth.lesion]]`, 0 to 1. Default 0.5.
    pub prevalence: f64,
}

impl Default for PeopleSection {
    fn default() -> Self {
        let views = EXAMINATION_VIEWS.iter().map(|view| view.name.to_owned()).collect();
        Self { count: 100, first: 1, views, prevalence: 0.5 }
    }
}

/// Largest numbers of people, and of the first one.
const MOST_PEOPLE: u64 = 100_000;
const LAST_FIRST: u64 = 4_000_000_000;

/// A cohort as its file says it.
#[derive(Clone, Debug, PartialEq)]
pub struct CohortStudy {
    /// Who is examined.
    pub people: PeopleSection,
    /// The views.
    pub views: Vec<&'static ExaminationView>,
    /// The experiment that all share.
    pub experiment: Experiment,
    /// Keys of `[mouth]` that the file or its bases give.
    given: BTreeSet<String>,
}

/// Reads the file of a cohort: an experiment with a mouth and an analysis, and a section `[people]`. Overrides and paths are as for an
/// experiment.
///
/// # Errors
/// The first defect found. Of scenes those are found that [`crate::resolve`] finds in [`CohortStudy::experiment_of`].
pub fn parse_cohort(
    text: &str,
    source_name: &str,
    base_dir: &Path,
    overrides: &[String],
) -> Result<CohortStudy, ExperimentError> {
    let schema = schema_of::<CohortFile>();
    let mut document = read_merged(schema, text, source_name, base_dir)?;
    let changes = overrides.iter().map(|text| SceneChange::read(text)).collect::<Resolved<Vec<_>>>()?;
    change_document(&mut document, schema, &changes, Path::new("."))?;
    let mut own = document.clone();
    own.root.retain(|key| key == "people");
    let CohortQuestion { people } = typed(&mut own, schema_of::<CohortQuestion>())?;
    let context = Context::new(&own);
    let at = |field| steps!["people", field];
    context.whole_within(&at("count"), u64::from(people.count), [1, MOST_PEOPLE])?;
    context.whole_within(&at("first"), u64::from(people.first), [1, LAST_FIRST])?;
    context.within(&at("prevalence"), people.prevalence, [0.0, 1.0], "")?;
    let mut views = Vec::new();
    for (index, name) in people.views.iter().enumerate() {
        let at = steps!["people", "views", index];
        let known = EXAMINATION_VIEWS.iter().map(|view| view.name);
        let view = &EXAMINATION_VIEWS[context.known(&at, name, known, "there is no view of this name")?];
        if views.contains(&view) {
            return context.fail(&at, "this view is named twice; keep one");
        }
        views.push(view);
    }
    if views.is_empty() {
        return context.fail(&at("views"), "names no view; name one, such as \"dorsal-tongue\"");
    }

    document.root.retain(|key| key != "people");
    let own = keys_of_mouth(&document, |source| is_own(&document, source));
    let mut given = keys_of_mouth(&document, |_| true);
    finish_document(&mut document, experiment_schema())?;
    let file: ExperimentFile = typed(&mut document, experiment_schema())?;
    // Results write out all of a mouth: what a base has of the typical one is not given
    given.retain(|key| own.contains(key) || file.mouth.as_ref().is_some_and(|mouth| is_other(mouth, key)));
    let context = Context::new(&document);
    match &file.mouth {
        None => {
            return context
                .fail(&steps!["mouth"], "a cohort has mouths; base it on an experiment with [mouth]");
        }
        Some(mouth) if mouth.transform.is_some() => {
            let message = "views are placed in the frame of the mouth itself; remove the transform";
            return context.fail(&steps!["mouth", "transform"], message);
        }
        Some(mouth) if mouth.person.is_some() => {
            let message = "the people of a cohort are drawn, people.first is the first of them; remove it";
            return context.fail(&steps!["mouth", "person"], message);
        }
        Some(mouth) if mouth.view.is_some() => {
            let message = "people.views names the views of a cohort, which give pose and camera; remove it";
            return context.fail(&steps!["mouth", "view"], message);
        }
        Some(_) => {}
    }
    if file.render.time_limit_s.is_some() {
        let message = "what a time limit leaves of a view depends on the machine; remove it";
        return context.fail(&steps!["render", "time_limit_s"], message);
    }
    if file.analysis.is_none() {
        let message =
            "a cohort is what an analysis finds in many people; add [analysis], or a base that has one";
        return context.fail(&steps!["analysis"], message);
    }
    Ok(CohortStudy { people, views, experiment: Experiment { file, document }, given })
}

/// Whether a source is the file itself or a change of it, and no base.
fn is_own(document: &Document, source: usize) -> bool {
    source == 0 || document.sources[source].overriding.is_some()
}

/// Whether a mouth has another value of a field than the typical one.
fn is_other(mouth: &MouthSection, key: &str) -> bool {
    let value =
        |parameters: &MouthParameters| Some(toml::Value::try_from(parameters).ok()?.get(key)?.clone());
    let (own, typical) = (value(&mouth.parameters), value(&MouthParameters::default()));
    own.is_none() || own != typical
}

/// Keys of `[mouth]` in a document, of the sources with numbers that a function keeps.
fn keys_of_mouth(document: &Document, is_of: impl Fn(usize) -> bool) -> BTreeSet<String> {
    let Some(Content::Table(fields)) = document.root.get("mouth").map(|mouth| &mouth.content) else {
        return BTreeSet::new();
    };
    fields.iter().filter(|(_, node)| is_of(node.origin.source)).map(|(key, _)| key.clone()).collect()
}

impl CohortStudy {
    /// The numbers of all people.
    pub fn numbers(&self) -> impl Iterator<Item = u32> + use<> {
        self.people.first..=self.people.first.saturating_add(self.people.count - 1)
    }

    /// Whether a person has a lesion of the file, and the tooth that it is on. It depends on the number of the person and the name of the
    /// lesion alone.
    #[must_use]
    pub fn has_lesion(&self, person: u32, lesion: &LesionSection) -> bool {
        self.draws_lesion(person, lesion)
            && self
                .tooth_under(&lesion.part)
                .is_none_or(|tooth| !self.shape_of(person).missing_teeth.contains(&tooth))
    }

    fn draws_lesion(&self, person: u32, lesion: &LesionSection) -> bool {
        let key = Key::new(u64::from(person)).with_text("lesion").with_text(&lesion.name);
        unit(key) < self.people.prevalence
    }

    /// The tooth that a part is, or a filling of it; `None` of other parts, and of teeth that are scans, which everybody has.
    fn tooth_under(&self, part: &str) -> Option<u8> {
        let mouth = self.experiment.file.mouth.as_ref()?;
        let filling = mouth.restoration.iter().find(|restoration| restoration.name == part);
        let of_name = || part.strip_prefix("tooth_")?.parse::<u8>().ok();
        let tooth = filling.map(|filling| filling.tooth).or_else(of_name)?;
        mouth.scan.iter().all(|scan| scan.name != format!("tooth_{tooth}")).then_some(tooth)
    }

    /// A number below 1 by which a data set is split. It depends on the seed of the file and the number of the person alone: more people
    /// move nobody.
    #[must_use]
    pub fn split_draw(&self, person: u32) -> f64 {
        unit(Key::new(self.experiment.file.render.seed).with(u64::from(person)).with_text("split"))
    }

    /// The lesions of the file.
    #[must_use]
    pub fn lesions(&self) -> &[LesionSection] {
        self.experiment.file.mouth.as_ref().map_or(&[], |mouth| &mouth.lesion)
    }

    /// The shape of a person: as it is drawn, but for what the file gives.
    #[must_use]
    pub fn shape_of(&self, person: u32) -> MouthParameters {
        self.with_given_shape(&sample_person(person))
    }

    fn with_given_shape(&self, mouth: &MouthParameters) -> MouthParameters {
        let given = self.experiment.file.mouth.as_ref().map(|section| &section.parameters);
        given.map_or_else(
            || mouth.clone(),
            |given| mouth.with_shape_of(given, |field| self.given.contains(field)),
        )
    }

    /// What the file says of all people beside what [`Self::experiment_of`] shows of each, which may happen to be the same in one of them:
    /// the keys of the mouth and the shape that they give, and the typical tissues.
    ///
    /// # Errors
    /// None that is known: sections that have no JSON.
    pub fn of_all_people(&self) -> Result<String, serde_json::Error> {
        let is_shape = |key: &&String| !POSE_FIELDS.contains(&key.as_str());
        let given: Vec<&String> = self.given.iter().filter(is_shape).collect();
        let shape = self.with_given_shape(&MouthParameters::default());
        serde_json::to_string(&(given, shape, &self.experiment.file.tissue))
    }

    /// The pose that the text or an override gives, which that of each view replaces.
    #[must_use]
    pub fn given_pose(&self) -> Vec<&'static str> {
        let document = &self.experiment.document;
        let own = keys_of_mouth(document, |source| is_own(document, source));
        POSE_FIELDS.into_iter().filter(|field| *field != "detail" && own.contains(*field)).collect()
    }

    /// The file with everything that it rests on. Of the mouth it has what is given, and no pose: the rest is that of each person and view.
    ///
    /// # Errors
    /// Sections that have no TOML: none is known.
    pub fn text(&self) -> Result<String, toml::ser::Error> {
        let (experiment, people) = (self.experiment.file.clone(), self.people.clone());
        let question = CohortQuestion { people };
        let mut file = toml::Table::try_from(&CohortFile { experiment, question })?;
        if let Some(toml::Value::Table(mouth)) = file.get_mut("mouth") {
            let is_pose = |key: &str| key != "detail" && POSE_FIELDS.contains(&key);
            mouth.retain(|key, _| self.given.contains(key) && !is_pose(key));
        }
        file_text(&file)
    }

    /// The experiment of a person and a view: the mouth and the tissues of the person in the pose of the view, and the camera at its
    /// distance, on the axis of the view. The analysis is of the first part of the view, each other part is a region beside it. A
    /// lesion that the person does not have stays as a place without a change, where the same is measured. It depends on nothing but
    /// the file, the number of the person and the name of the view.
    ///
    /// # Errors
    /// A site or a state of a tissue that does not exist.
    pub fn experiment_of(&self, person: u32, view: &ExaminationView) -> Result<Experiment, ExperimentError> {
        let shape = self.shape_of(person);
        self.experiment_with(person, view, &shape, |lesion| self.draws_lesion(person, lesion))
    }

    /// The same of a person who has every lesion of the file, and the teeth that lesions and restorations are on.
    ///
    /// # Errors
    /// As [`Self::experiment_of`].
    pub fn experiment_with_all_lesions(
        &self,
        person: u32,
        view: &ExaminationView,
    ) -> Result<Experiment, ExperimentError> {
        let mut shape = self.shape_of(person);
        if let Some(mouth) = &self.experiment.file.mouth {
            let of_lesions = mouth.lesion.iter().filter_map(|lesion| self.tooth_under(&lesion.part));
            let of_restorations = mouth.restoration.iter().map(|restoration| restoration.tooth);
            let wanted: Vec<u8> = of_lesions.chain(of_restorations).collect();
            shape.missing_teeth.retain(|tooth| !wanted.contains(tooth));
        }
        self.experiment_with(person, view, &shape, |_| true)
    }

    /// Takes what lies on teeth that a person lacks out of a mouth.
    fn without_missing(&self, mouth: &mut MouthSection, missing: &[u8]) {
        let is_there = |part: &str| self.tooth_under(part).is_none_or(|tooth| !missing.contains(&tooth));
        mouth.lesion.retain(|lesion| is_there(&lesion.part));
        mouth.restoration.retain(|restoration| is_there(&restoration.name));
        for scan in &mut mouth.scan {
            scan.replaces.retain(|part| missing.iter().all(|tooth| *part != format!("tooth_{tooth}")));
        }
    }

    fn experiment_with(
        &self,
        person: u32,
        view: &ExaminationView,
        shape: &MouthParameters,
        has_lesion: impl Fn(&LesionSection) -> bool,
    ) -> Result<Experiment, ExperimentError> {
        let mut experiment = self.experiment.clone();
        let Experiment { file, document } = &mut experiment;
        give_tissues_of(person, file).map_err(|error| document.error(&steps!["tissue"], error))?;
        let key = Key::new(file.render.seed).with(u64::from(person)).with_text(view.name);
        // Seeds of files have 63 bits
        file.render.seed = key.value() >> 1;
        file.title = format!("Person {person}, {}", view.title.to_lowercase());
        file.description = String::new();

        // Take the place of the camera along the line of sight of the view
        let camera = &mut file.camera;
        let length =
            |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
        let nearer = length(camera.position_mm, camera.look_at_mm) / length(view.camera_mm, view.look_at_mm);
        let along = |k: usize| view.look_at_mm[k] + nearer * (view.camera_mm[k] - view.look_at_mm[k]);
        (camera.position_mm, camera.look_at_mm) = ([0, 1, 2].map(along), view.look_at_mm);

        if let Some(mouth) = &mut file.mouth {
            // Their tissues are drawn above
            mouth.person = None;
            let detail = mouth.parameters.detail;
            mouth.parameters = MouthParameters { detail, ..view.pose(shape) };
            self.without_missing(mouth, &shape.missing_teeth);
            for lesion in &mut mouth.lesion {
                if !has_lesion(lesion) {
                    *lesion = without_change(lesion);
                }
            }
        }
        give_restorations_of(person, file);
        // What lies at places on the sensor or in the scene is something else in this view
        file.target.clear();
        file.spectroradiometer.clear();
        if let Some(analysis) = &mut file.analysis {
            let [first, others @ ..] = view.parts else { return Ok(experiment) };
            if analysis.place.parts.first().map(String::as_str) != Some(*first) {
                (analysis.bulk, analysis.tissue) = (None, None);
            }
            analysis.place = of_part(first);
            analysis.compared_px = None;
            analysis.region = others.iter().map(|part| region_of(part)).collect();
        }
        Ok(experiment)
    }
}

/// A number from 0 on and below 1 with the 53 bits that it can hold.
fn unit(key: Key) -> f64 {
    (key.value() >> 11) as f64 / (1u64 << 53) as f64
}

/// The place of a lesion with the tissue that is around it.
fn without_change(lesion: &LesionSection) -> LesionSection {
    LesionSection {
        reflectance: None,
        blood_um: 0.0,
        states: Vec::new(),
        tissue: Default::default(),
        concentrations: Default::default(),
        ..lesion.clone()
    }
}

fn of_part(part: &str) -> SensorRegionSection {
    SensorRegionSection { parts: vec![part.to_owned()], ..SensorRegionSection::default() }
}

/// A part as a region of its own name, otherwise as the analysis has it.
fn region_of(part: &str) -> AnalysisRegionSection {
    AnalysisRegionSection {
        name: part.into(),
        place: of_part(part),
        inset_px: None,
        porphyrin: None,
        bulk: None,
        tissue: None,
        tissue_probability: None,
        further_frames: None,
        prior_width: None,
        library_error: None,
        noise_threshold: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cohort(text: &str) -> Result<CohortStudy, ExperimentError> {
        let text = format!("format = 1\nbase = \"oraleye-2021\"\n{text}");
        parse_cohort(&text, "cohort.toml", Path::new("."), &[])
    }

    #[test]
    fn a_person_depends_on_its_number_alone() {
        let lesion = "[[mouth.lesion]]\nname = \"spot\"\npart = \"tongue_dorsum\"\nstates = [\"dysplasia_moderate\"]\n";
        let few = cohort(&format!("[people]\ncount = 2\nviews = [\"dorsal-tongue\"]\n{lesion}")).unwrap();
        let many = cohort(&format!("[people]\ncount = 200\n{lesion}")).unwrap();
        assert_eq!((few.numbers().count(), many.views.len()), (2, 9));
        let view = few.views[0];
        let of = |cohort: &CohortStudy, person| cohort.experiment_of(person, view).unwrap().file;
        assert_eq!(of(&few, 2), of(&many, 2));
        let (one, two) = (of(&many, 1), of(&many, 2));
        assert!(one.render.seed != two.render.seed && one.tissue != two.tissue);
        // As far away as the camera of the file
        let [away, there] =
            [(one.camera.position_mm, one.camera.look_at_mm), ([0.0, 20.0, 98.0], [0.0, 0.0, -3.0])]
                .map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt());
        assert!((away - there).abs() < 1e-9);
        // Half of the people, to four standard errors
        let lesion = &many.lesions()[0];
        let ill: Vec<u32> = many.numbers().filter(|person| many.has_lesion(*person, lesion)).collect();
        assert!((ill.len() as f64 - 100.0).abs() < 4.0 * 50f64.sqrt(), "{}", ill.len());
        let of_lesion = |person| of(&many, person).mouth.unwrap().lesion[0].states.len();
        assert!(many.numbers().take(6).all(|person| of_lesion(person) == usize::from(ill.contains(&person))));
    }

    /// What a file gives of teeth holds for all people; the rest is theirs.
    #[test]
    fn what_the_file_gives_of_a_shape_is_that_of_all_people() {
        let plain = cohort("").unwrap();
        let given = cohort(
            "[mouth]\nmissing_teeth = [11, 21]\ntooth_scale = 1.0\ndetail = 0.5\njaw_opening_mm = 20.0\n",
        );
        let given = given.unwrap();
        // What is written of a cohort is the same cohort
        let again = parse_cohort(&given.text().unwrap(), "again", Path::new("."), &[]).unwrap();
        for person in [1, 2] {
            let (drawn, shape) = (sample_person(person), given.shape_of(person));
            assert_eq!(plain.shape_of(person), drawn);
            // Also where it is as in the typical mouth
            let wanted = MouthParameters { missing_teeth: vec![11, 21], tooth_scale: 1.0, ..drawn };
            assert_eq!((&shape, again.shape_of(person)), (&wanted, wanted.clone()));
        }
        assert_eq!((plain.given_pose(), given.given_pose()), (vec![], vec!["jaw_opening_mm"]));
        // A base that writes out all of a mouth, as results do, gives what it has otherwise than the typical one
        let folder = tempfile::tempdir().unwrap();
        let base = "format = 1\nbase = \"oraleye-2021\"\n[mouth]\noverjet_mm = 2.5\ntooth_scale = 1.2\n";
        std::fs::write(folder.path().join("base.toml"), base).unwrap();
        let text = "format = 1\nbase = \"base.toml\"\n[people]\ncount = 2\n";
        let shape = parse_cohort(text, "c", folder.path(), &[]).unwrap().shape_of(1);
        assert_eq!((shape.tooth_scale, shape.overjet_mm), (1.2, sample_person(1).overjet_mm));
        let of_all = |cohort: &CohortStudy| cohort.of_all_people().unwrap();
        assert!(of_all(&given) == of_all(&again) && of_all(&given) != of_all(&plain));
    }

    /// Somebody without a tooth has neither its filling nor its lesion; who lacks it is measured nowhere.
    #[test]
    fn what_lies_on_a_tooth_is_in_those_who_have_it() {
        let text = "[people]\nprevalence = 1.0\n[[mouth.restoration]]\nname = \"filling\"\ntooth = 46\nsurfaces = \"o\"\n\
                    material = \"tooth\"\n[[mouth.lesion]]\nname = \"spot\"\npart = \"tooth_46\"\n\
                    [[mouth.lesion]]\nname = \"rim\"\npart = \"filling\"\n\
                    [[mouth.scan]]\nname = \"arch\"\nmesh = \"arch.ply\"\nmaterial = \"tooth\"\nreplaces = [\"tooth_46\", \"tooth_2*\"]\n";
        let study = cohort(text).unwrap();
        let lacks = |person: &u32| sample_person(*person).missing_teeth.contains(&46);
        let (without, with) =
            ((1..200).find(lacks).unwrap(), (1..200).find(|person| !lacks(person)).unwrap());
        let on_tooth = |person: u32| {
            let mouth = study.experiment_of(person, study.views[0]).unwrap().file.mouth.unwrap();
            let held = study.lesions().iter().filter(|lesion| study.has_lesion(person, lesion)).count();
            (mouth.lesion.len(), mouth.restoration.len(), mouth.scan[0].replaces.len(), held)
        };
        assert_eq!((on_tooth(without), on_tooth(with)), ((0, 0, 1, 0), (2, 1, 2, 2)));
        let all = study.experiment_with_all_lesions(without, study.views[0]).unwrap().file.mouth.unwrap();
        assert!(all.lesion.len() == 2 && !all.parameters.missing_teeth.contains(&46));
    }

    #[test]
    fn what_is_wrong_with_a_cohort_is_told_with_its_place() {
        for (text, told) in [
            ("[people]\ncount = 0\n", "people.count = 0: must be a whole number between 1 and 100000"),
            ("[people]\nviews = [\"tongue\"]\n", "there is no view of this name"),
            ("[people]\nviews = []\n", "names no view"),
            ("[people]\nviews = [\"lips\", \"lips\"]\n", "named twice"),
            ("[people]\nprevalence = 2.0\n", "must be between 0 and 1"),
            ("[people]\nseed = 2\n", "seed"),
            ("unset = [\"analysis\"]\n", "add [analysis]"),
            ("[mouth.transform]\ntranslate_mm = [1.0, 0.0, 0.0]\n", "remove the transform"),
            ("[mouth]\nperson = 7\n", "the people of a cohort are drawn"),
            ("[mouth]\nview = \"throat\"\n", "people.views names the views"),
        ] {
            let error = cohort(text).unwrap_err().to_string();
            assert!(error.contains(told) && error.starts_with("cohort.toml"), "{text}: {error}");
        }
        let flat = parse_cohort("format = 1\nbase = \"flat-patch\"\n", "x.toml", Path::new("."), &[]);
        assert!(flat.unwrap_err().to_string().contains("base it on an experiment with [mouth]"));
    }
}
