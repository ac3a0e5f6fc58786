//! Cohorts: an experiment with a mouth, for many people and views of an examination.

use std::path::Path;

use fluorspar::sampling::random::Key;
use fluorspar_anatomy::{EXAMINATION_VIEWS, ExaminationView, MouthParameters, sample_person};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::change::scene_change::SceneChange;
use crate::error::{ExperimentError, steps};
use crate::people::give_tissues_of;
use crate::read::{
    Experiment, change_document, experiment_schema, finish_document, read_merged, schema_of, typed,
};
use crate::resolve::context::{Context, Resolved};
use crate::schema::{AnalysisRegionSection, ExperimentFile, LesionSection, SensorRegionSection};

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
    /// Views, by the names of `mouth view --list`. Default: the nine of an examination.
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
    finish_document(&mut document, experiment_schema())?;
    let file: ExperimentFile = typed(&mut document, experiment_schema())?;
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
    Ok(CohortStudy { people, views, experiment: Experiment { file, document } })
}

impl CohortStudy {
    /// The numbers of all people.
    pub fn numbers(&self) -> impl Iterator<Item = u32> + use<> {
        self.people.first..=self.people.first.saturating_add(self.people.count - 1)
    }

    /// Whether a person has a lesion of the file. It depends on the number of the person and the name of the lesion alone.
    #[must_use]
    pub fn has_lesion(&self, person: u32, lesion: &LesionSection) -> bool {
        let key = Key::new(u64::from(person)).with_text("lesion").with_text(&lesion.name);
        unit(key) < self.people.prevalence
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

    /// The shape of a person: as it is drawn, but for what the file gives otherwise than the typical mouth has it.
    #[must_use]
    pub fn shape_of(&self, person: u32) -> MouthParameters {
        let drawn = sample_person(person);
        self.experiment
            .file
            .mouth
            .as_ref()
            .map_or(drawn.clone(), |mouth| drawn.with_shape_of(&mouth.parameters))
    }

    /// The experiment of a person and a view: the mouth and the tissues of the person in the pose of the view, and the camera at its
    /// distance, on the axis of the view. The analysis is of the first part of the view, each other part is a region beside it. A
    /// lesion that the person does not have stays as a place without a change, where the same is measured. It depends on nothing but
    /// the file, the number of the person and the name of the view.
    ///
    /// # Errors
    /// A site or a state of a tissue that does not exist.
    pub fn experiment_of(&self, person: u32, view: &ExaminationView) -> Result<Experiment, ExperimentError> {
        self.experiment_with(person, view, |lesion| self.has_lesion(person, lesion))
    }

    /// The same of a person who has every lesion of the file.
    ///
    /// # Errors
    /// As [`Self::experiment_of`].
    pub fn experiment_with_all_lesions(
        &self,
        person: u32,
        view: &ExaminationView,
    ) -> Result<Experiment, ExperimentError> {
        self.experiment_with(person, view, |_| true)
    }

    fn experiment_with(
        &self,
        person: u32,
        view: &ExaminationView,
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
            mouth.parameters = MouthParameters { detail, ..view.pose(&self.shape_of(person)) };
            for lesion in &mut mouth.lesion {
                if !has_lesion(lesion) {
                    *lesion = without_change(lesion);
                }
            }
        }
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
        let given = cohort("[mouth]\nmissing_teeth = [11, 21]\nplaque = 0.0\ndetail = 0.5\n").unwrap();
        for person in [1, 2] {
            let (drawn, shape) = (sample_person(person), given.shape_of(person));
            assert_eq!(plain.shape_of(person), drawn);
            let MouthParameters { missing_teeth, plaque, .. } =
                given.experiment.file.mouth.clone().unwrap().parameters;
            assert_eq!(shape, MouthParameters { missing_teeth, plaque, ..drawn });
        }
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
        ] {
            let error = cohort(text).unwrap_err().to_string();
            assert!(error.contains(told) && error.starts_with("cohort.toml"), "{text}: {error}");
        }
        let flat = parse_cohort("format = 1\nbase = \"flat-patch\"\n", "x.toml", Path::new("."), &[]);
        assert!(flat.unwrap_err().to_string().contains("base it on an experiment with [mouth]"));
    }
}
