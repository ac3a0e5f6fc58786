//! `fluorspar mouth sample`: people, shape and tissue.

use clap::ValueHint;
use fluorspar_anatomy::{MouthParameters, sample_person};
use fluorspar_experiment::person_tissues;
use fluorspar_experiment::schema::TissueSection;
use fluorspar_format::{OutputFolder, write_atomically};
use serde::Serialize;
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

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let Some(last) = options.seed.checked_add(options.count - 1) else {
        return Err(CliError::Input(format!(
            "--seed {}: must be between 1 and {} for {} people",
            options.seed,
            u32::MAX - (options.count - 1),
            options.count
        )));
    };
    // A base that can't be used is found before anything is written.
    let base = fluorspar_session::ExperimentSource::find(Some(&options.base))?.parse(&[])?;
    let person = |number: u32| {
        let tissues =
            person_tissues(&base.file, number).map_err(|error| CliError::Input(error.to_string()))?;
        Ok(Person { mouth: sample_person(number), tissues })
    };
    let people: Vec<Person> = (options.seed..=last).map(person).collect::<Result<_, CliError>>()?;
    let folder = OutputFolder::prepare(&options.out, &[], PERSON_BYTES * u64::from(options.count))?;
    write_people(options, &people, folder.path()).map_err(|error| error.at_its_place(&folder))?;
    folder.finish()?;
    Messages::default().status(format!("Wrote {} people to {}", people.len(), options.out.display()));
    Ok(())
}

/// Room that a person takes, bytes: a file of a few blocks, and a line of the table.
const PERSON_BYTES: u64 = 16 << 10;

/// What is drawn of a person.
#[derive(Serialize)]
struct Person {
    mouth: MouthParameters,
    #[serde(rename = "tissue")]
    tissues: Vec<TissueSection>,
}

/// Writes one experiment file for each person, and the table.
fn write_people(options: &Options, people: &[Person], folder: &Path) -> Result<(), CliError> {
    for person in people {
        let (number, text) = (person.mouth.seed, toml::to_string(person).unwrap_or_default());
        write_atomically(&folder.join(format!("person_{number:06}.toml")), |writer| {
            let base = crate::commands::quoted(&options.base);
            writeln!(writer, "format = 1\nbase = {base}\ntitle = \"Person {number}\"\n\n{}", text.trim_end())
        })?;
    }
    write_table(people, &folder.join("people.csv"))
}

/// All parameters of all people, one person a line.
fn write_table(people: &[Person], path: &Path) -> Result<(), CliError> {
    write_atomically(path, |writer| {
        let fields = serde_json::to_value(MouthParameters::default())?;
        let names: Vec<&String> = fields.as_object().map(|f| f.keys().collect()).unwrap_or_default();
        let header: Vec<&str> = names.iter().map(|name| name.as_str()).collect();
        let of_tissues = |person: &Person| -> Vec<(String, f64)> {
            let of = |tissue: &TissueSection| {
                let name = tissue.name.clone();
                let parameters = tissue.parameters.clone().into_iter();
                parameters.map(move |(parameter, value)| (format!("{name}.{parameter}"), value))
            };
            person.tissues.iter().flat_map(of).collect()
        };
        let tissues: String = people
            .first()
            .map(of_tissues)
            .into_iter()
            .flatten()
            .map(|(name, _)| format!(",{name}"))
            .collect();
        writeln!(writer, "person,{},bolton_ratio{tissues}", header.join(","))?;
        for person in people {
            let values = serde_json::to_value(&person.mouth)?;
            let cell = |name: &&String| match &values[name.as_str()] {
                serde_json::Value::Array(list) => {
                    list.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
                }
                other => other.to_string(),
            };
            let row: Vec<String> = names.iter().map(cell).collect();
            // A person's number is the seed from which it is drawn.
            let tissues: String =
                of_tissues(person).iter().map(|(_, value)| format!(",{value:.6e}")).collect();
            let (number, ratio) = (person.mouth.seed, person.mouth.bolton_ratio());
            writeln!(writer, "{number},{},{ratio:.4}{tissues}", row.join(","))?;
        }
        Ok(())
    })?;
    Ok(())
}
