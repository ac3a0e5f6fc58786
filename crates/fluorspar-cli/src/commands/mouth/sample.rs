//! `fluorspar mouth sample`: people, shape and tissue.

use clap::ValueHint;
use fluorspar_anatomy::{ExaminationView, POSE_FIELDS};
use fluorspar_experiment::{Person, people_csv};
use fluorspar_format::{OutputFolder, write_atomically};
use std::io::Write;
use std::path::{Path, PathBuf};

use super::person::parse_person;
use crate::error::CliError;
use crate::message::Messages;
use crate::values;

/// Most people at a time.
const MOST: u64 = 100_000;

/// Options of `mouth sample`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Number of people.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = values::whole::<u32, 1, MOST>, allow_negative_numbers = true)]
    count: u32,
    /// Seed of the first person, which is its number; the others follow.
    #[arg(long, value_name = "S", default_value_t = 1, value_parser = parse_person, allow_negative_numbers = true)]
    seed: u32,
    /// Experiment on which each person's file is based.
    #[arg(long, value_name = "NAME", default_value = "oraleye-2021")]
    base: String,
    /// Folder for `person_000001.toml`, ... and `people.csv`.
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    out: PathBuf,
}

/// Number of the last person.
fn last_person(options: &Options) -> Result<u32, CliError> {
    options.seed.checked_add(options.count - 1).ok_or_else(|| {
        CliError::Input(format!(
            "--seed {}: must be between 1 and {} for {} people",
            options.seed,
            u32::MAX - (options.count - 1),
            options.count
        ))
    })
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let last = last_person(options)?;
    // A base that can't be used is found before anything is written.
    let source = fluorspar_session::ExperimentSource::find(Some(&options.base))?;
    let base = source.parse(&[])?;
    let Some(mouth) = &base.file.mouth else {
        let name = &options.base;
        return Err(CliError::Input(format!("--base {name}: has no [mouth]; choose an experiment with one")));
    };
    if mouth.person.is_some() {
        let name = &options.base;
        return Err(CliError::Input(format!("--base {name}: mouth.person is one person already; remove it")));
    }
    let view = mouth.view.as_deref().and_then(ExaminationView::find);
    let draw = |number| -> Result<Person, CliError> {
        let drawn = Person::draw(&base.file, number).map_err(|error| CliError::Input(error.to_string()))?;
        let mouth = view.map_or(drawn.mouth.clone(), |view| view.pose(&drawn.mouth));
        Ok(Person { mouth, ..drawn })
    };
    let people: Vec<Person> = (options.seed..=last).map(draw).collect::<Result<_, CliError>>()?;
    // The files of the people lie elsewhere
    let base = match &source.file {
        Some(file) => std::path::absolute(file).unwrap_or_else(|_| file.clone()).display().to_string(),
        None => options.base.clone(),
    };
    let folder = OutputFolder::prepare(&options.out, &[], PERSON_BYTES * u64::from(options.count))?;
    write_people(&base, &people, folder.path()).map_err(|error| error.at_its_place(&folder))?;
    folder.finish()?;
    Messages::default().status(format!("Wrote {} people to {}", people.len(), options.out.display()));
    Ok(())
}

/// Room that a person takes, bytes: a file of a few blocks, and a line of the table.
const PERSON_BYTES: u64 = 16 << 10;

/// Writes one experiment file for each person, in the pose of the base, and the table.
fn write_people(base: &str, people: &[Person], folder: &Path) -> Result<(), CliError> {
    for person in people {
        let mut sections = toml::Table::try_from(person).unwrap_or_default();
        if let Some(toml::Value::Table(mouth)) = sections.get_mut("mouth") {
            mouth.retain(|field, _| !POSE_FIELDS.contains(&field));
            let restorations = toml::Value::try_from(&person.restorations);
            mouth.extend(restorations.ok().map(|list| ("restoration".to_owned(), list)));
        }
        let (number, text) = (person.mouth.seed, toml::to_string(&sections).unwrap_or_default());
        write_atomically(&folder.join(format!("person_{number:06}.toml")), |writer| {
            let base = crate::commands::quoted(base);
            writeln!(writer, "format = 1\nbase = {base}\ntitle = \"Person {number}\"\n\n{}", text.trim_end())
        })?;
    }
    let table = people_csv(people, true)?;
    write_atomically(&folder.join("people.csv"), |writer| writer.write_all(table.as_bytes()))?;
    Ok(())
}
