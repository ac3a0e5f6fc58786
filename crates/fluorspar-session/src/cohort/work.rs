//! What is made of every view of a cohort once, and kept in journals.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::ValueHint;
use fluorspar::digest::sha256_hex;
use fluorspar_experiment::schema::SensorRegionSection;
use fluorspar_experiment::{
    CohortStudy, EXAMINATION_VIEWS, ExaminationView, Person, Warning, parse_cohort, resolve,
};
use fluorspar_format::Journal;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::examine::{Examination, ExaminedView, each_view};
use crate::shard::{WorkShard, journal_beside, shards_beside};
use crate::values::{as_typed, sets};
use crate::{Changes, Error, ExperimentSource, Job, Result, warnings_before_run};

/// Which cohort, and which part of it.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct CohortArgs {
    /// Cohort file (.toml): an experiment with a mouth and a section `[people]`. An experiment of the catalogue has 100 people in nine
    /// views [default: oraleye-2021].
    #[arg(value_name = "COHORT", value_hint = ValueHint::FilePath)]
    pub cohort: Option<String>,
    /// Part that is done, for one of several processes: I/N, or auto in a Slurm array. The same command without it, with the journals of
    /// all beside its folder, makes one result.
    #[arg(long, value_name = "I/N|auto")]
    pub shard: Option<WorkShard>,
    /// Changes by path.
    #[command(flatten)]
    #[serde(flatten)]
    pub changes: Changes,
}

/// A finished part of the people, in its journal.
#[derive(Clone, Debug, Serialize)]
pub struct FinishedShard {
    /// Which part.
    pub shard: String,
    /// Views that are finished.
    pub views: usize,
    /// Its journal.
    pub journal: PathBuf,
}

/// A view of a person.
pub(crate) type Place = (u32, String);

/// A cohort and the place of what is made of it.
pub(crate) struct CohortWork {
    /// The cohort.
    pub(crate) cohort: CohortStudy,
    /// Where it was read from.
    pub(crate) source: ExperimentSource,
    /// Digest of everything that decides a view.
    pub(crate) sha256: String,
    /// Folder of the results; the journals lie beside it.
    pub(crate) folder: PathBuf,
    /// Files that it names.
    pub(crate) inputs: Vec<String>,
    head: Value,
}

/// Warns of what an experiment measures at places that the views of a cohort do not have, and of the pose that they replace.
fn left_out(cohort: &CohortStudy) -> Vec<Warning> {
    let file = &cohort.experiment.file;
    let analysis = file.analysis.as_ref();
    let regions = analysis.is_some_and(|analysis| !analysis.region.is_empty());
    let is_of_a_view = |place: &SensorRegionSection| {
        let alone = SensorRegionSection { parts: place.parts.clone(), ..SensorRegionSection::default() };
        let is_seen =
            |part: &String| EXAMINATION_VIEWS.iter().any(|view| view.parts.contains(&part.as_str()));
        *place == alone && place.parts.iter().any(is_seen)
    };
    let is_elsewhere = analysis.is_some_and(|analysis| !is_of_a_view(&analysis.place));
    let sections = [
        (!file.target.is_empty(), "[[target]]"),
        (!file.spectroradiometer.is_empty(), "[[spectroradiometer]]"),
        (is_elsewhere, "The place of [analysis]"),
        (regions, "[[analysis.region]]"),
    ];
    let warn = |section: &str, why: &str| {
        Warning::explained(
            format!("{section} is left out of cohorts"),
            format!("{why}; people.views names the views"),
        )
    };
    let places = sections.into_iter().filter(|(is_given, _)| *is_given);
    let places = places.map(|(_, section)| warn(section, "Each view measures its own parts"));
    let pose = cohort.given_pose().into_iter();
    places.chain(pose.map(|field| warn(&format!("mouth.{field}"), "Each view has its own pose"))).collect()
}

impl CohortWork {
    /// Reads a cohort for a kind of results, and prepares its first view, which stands for all: what is wrong with the file or odd about
    /// it is known before the work. Without a folder the results go to one of that kind.
    ///
    /// # Errors
    /// A defect of the file.
    pub(crate) fn prepare(
        args: &CohortArgs,
        out: Option<&Path>,
        kind: &str,
        job: &Job,
    ) -> Result<(Self, Examination)> {
        let source = ExperimentSource::find(args.cohort.as_deref())?;
        let overrides = args.changes.overrides();
        let cohort = parse_cohort(&source.text, &source.name, &source.base_dir, &sets(&overrides))
            .map_err(|error| as_typed(error, &overrides))?;
        for person in cohort.numbers() {
            // What the file gives may not fit what is drawn
            cohort.shape_of(person).validate().map_err(|error| {
                Error::Input(format!(
                    "{}: with what [mouth] gives person {person} can't be: {error}; give less of the shape",
                    source.name
                ))
            })?;
        }
        let first = Examination::prepare(&cohort, cohort.people.first, cohort.views[0])
            .map_err(|error| Error::from(as_typed(error, &overrides)))?;
        job.warn(&warnings_before_run(&first.experiment));
        job.warn(&left_out(&cohort));
        // The first person may lack lesions and teeth, and its view may leave out what the analysis says: both belong to all
        let file = &cohort.experiment.file;
        let mouth = file.mouth.as_ref();
        let all_lesions = if mouth.is_none_or(|mouth| mouth.lesion.is_empty() && mouth.restoration.is_empty())
        {
            String::new()
        } else {
            cohort
                .experiment_with_all_lesions(cohort.people.first, cohort.views[0])
                .and_then(|experiment| resolve(&experiment))
                .map_err(|error| Error::from(as_typed(error, &overrides)))?
                .record
                .sha256
        };
        let analysis = json!(file.analysis).to_string();
        let names: Vec<&str> = cohort.views.iter().map(|view| view.name).collect();
        let people = json!([cohort.people.prevalence, cohort.people.first, names]).to_string();
        let of_first = first.experiment.record.sha256.clone();
        let sha256 = sha256_hex([of_first, all_lesions, analysis, people, cohort.of_all_people()?]);
        let folder = out.map(Path::to_path_buf).unwrap_or_else(|| {
            let usual = format!("fluorspar-out/{kind}-{}", source.stem);
            PathBuf::from(if overrides.is_empty() { usual } else { format!("{usual}-{}", &sha256[..8]) })
        });
        let head = json!({ format!("{kind}_sha256"): sha256, "version": env!("CARGO_PKG_VERSION") });
        let inputs =
            first.experiment.record.inputs.iter().map(|input| input.path.display().to_string()).collect();
        Ok((Self { cohort, source, sha256, folder, inputs, head }, first))
    }

    /// The journal of a part, or of the whole.
    pub(crate) fn journal(&self, shard: Option<WorkShard>) -> PathBuf {
        match shard {
            Some(shard) => shard.journal(&self.folder, &self.sha256),
            None => journal_beside(&self.folder, &self.sha256, ""),
        }
    }

    /// Makes what all journals lack of a part, and gives all of the part. `make` gives the line of a view for the journal, without its
    /// place; `read` what such a line says, nothing of one that is damaged or whose work must be done again.
    pub(crate) fn finish<T>(
        &self,
        shard: Option<WorkShard>,
        first: Examination,
        job: &Job,
        read: impl Fn(&Value) -> Option<T> + Sync,
        mut make: impl FnMut(&ExaminedView<'_>) -> Result<Value> + Send,
    ) -> Result<BTreeMap<Place, T>>
    where
        T: Send,
    {
        let parse = |entry: &Value| -> Option<(Place, T)> {
            let person = u32::try_from(entry.get("person")?.as_u64()?).ok()?;
            Some(((person, entry.get("view")?.as_str()?.to_owned()), read(entry)?))
        };
        let path = self.journal(shard);
        let (mut journal, entries) = Journal::open(&path, &self.head)?;
        let mut done: BTreeMap<Place, T> = entries.iter().filter_map(parse).collect();
        if shard.is_none() {
            for other in shards_beside(&self.folder, &self.sha256) {
                let entries = Journal::read(&self.journal(Some(other)), &self.head)?;
                done.extend(entries.unwrap_or_default().iter().filter_map(parse));
            }
        }
        let people =
            self.cohort.numbers().zip(0..).filter(|(_, place)| shard.is_none_or(|s| s.holds(*place)));
        let places = |(person, _): (u32, u64)| self.cohort.views.iter().map(move |view| (person, *view));
        let mine: Vec<(u32, &'static ExaminationView)> = people.flat_map(places).collect();
        let key = |(person, view): &(u32, &ExaminationView)| (*person, view.name.to_owned());
        let missing: Vec<(u32, &ExaminationView)> =
            mine.iter().filter(|place| !done.contains_key(&key(place))).copied().collect();
        if missing.len() < mine.len() {
            let (finished, all) = (mine.len() - missing.len(), mine.len());
            job.status(format!("{}: {finished} of {all} views are finished", path.display()));
        }
        each_view(&self.cohort, &missing, first, job, |examined: &ExaminedView<'_>| {
            let mut entry = make(examined)?;
            entry["person"] = json!(examined.person);
            entry["view"] = json!(examined.view.name);
            journal.append(&entry)?;
            // What is kept and what is read again are the same to the last bit
            done.extend(parse(&serde_json::from_str(&entry.to_string())?));
            Ok(())
        })?;
        let wanted: Vec<Place> = mine.iter().map(key).collect();
        done.retain(|place, _| wanted.contains(place));
        Ok(done)
    }

    /// Says that a part is finished, and where.
    pub(crate) fn finished_shard(&self, shard: WorkShard, views: usize, job: &Job) -> FinishedShard {
        let journal = self.journal(Some(shard));
        job.status(format!(
            "Shard {shard} is finished: {views} views in {}. When all are: the same command without ⟨shard⟩",
            journal.display()
        ));
        FinishedShard { shard: shard.to_string(), views, journal }
    }

    /// All people, as drawn.
    ///
    /// # Errors
    /// A site or a state of a tissue that does not exist.
    pub(crate) fn people(&self) -> Result<Vec<Person>> {
        let file = &self.cohort.experiment.file;
        let draw = |number| Ok(Person::with_shape(file, number, self.cohort.shape_of(number))?);
        self.cohort.numbers().map(draw).collect()
    }

    /// The file with everything that it rests on.
    ///
    /// # Errors
    /// Sections that have no TOML: none is known.
    pub(crate) fn toml(&self) -> Result<String> {
        self.cohort.text().map_err(|error| {
            Error::Failed(format!("{}: the file can't be written out: {error}", self.source.name))
        })
    }

    /// The title of the file, or its name.
    pub(crate) fn title(&self) -> &str {
        let title = &self.cohort.experiment.file.title;
        if title.is_empty() { &self.source.stem } else { title }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_views_do_not_measure_is_said() {
        let of = |more: &str| {
            let text = format!("format = 1\nbase = \"oraleye-2021\"\n{more}");
            left_out(&parse_cohort(&text, "cohort.toml", Path::new("."), &[]).unwrap())
        };
        assert!(of("").is_empty());
        let region = "[[analysis.region]]\nname = \"lip\"\nparts = [\"lower_lip\"]\n";
        let said = of(region);
        assert_eq!(said.len(), 1);
        assert!(said[0].to_string().starts_with("[[analysis.region]] is left out of cohorts. Each view"));
        for (text, what) in [
            ("[analysis]\nparts = [\"tooth_11\"]\n", "The place of [analysis] is left out"),
            (
                "[mouth]\ntongue_curl = 0.5\n",
                "mouth.tongue_curl is left out of cohorts. Each view has its own pose",
            ),
        ] {
            let said: Vec<String> = of(text).iter().map(ToString::to_string).collect();
            assert!(said.len() == 1 && said[0].starts_with(what), "{said:?}");
        }
    }
}
