//! `fluorspar mouth sample`: a cohort.

use clap::ValueHint;
use fluorspar_anatomy::{MouthParameters, sample_person};
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
    fluorspar_session::ExperimentSource::find(Some(&options.base))?;
    let people: Vec<MouthParameters> = (options.seed..=last).map(sample_person).collect();
    let folder = OutputFolder::prepare(&options.out, &[], PERSON_BYTES * u64::from(options.count))?;
    write_people(options, &people, folder.path()).map_err(|error| error.at_its_place(&folder))?;
    folder.finish()?;
    Messages::default().status(format!("Wrote {} people to {}", people.len(), options.out.display()));
    Ok(())
}

/// Room that a person takes, bytes: a file of a block or two, and a line of the table.
const PERSON_BYTES: u64 = 8 << 10;

/// Writes one experiment file for each person, and the table.
fn write_people(options: &Options, people: &[MouthParameters], folder: &Path) -> Result<(), CliError> {
    for person in people {
        let toml = toml::Value::try_from(person)
            .map_err(|error| CliError::Failed(format!("can't write the parameters: {error}")))?;
        write_atomically(&folder.join(format!("person_{:06}.toml", person.seed)), |writer| {
            writeln!(
                writer,
                "format = 1\nbase = {}\ntitle = \"Person {}\"\n\n[mouth]\n{}",
                crate::commands::quoted(&options.base),
                person.seed,
                toml::to_string(&toml).unwrap_or_default().trim_end()
            )
        })?;
    }
    write_table(people, &folder.join("people.csv"))
}

/// All parameters of all people, one person a line.
fn write_table(people: &[MouthParameters], path: &Path) -> Result<(), CliError> {
    write_atomically(path, |writer| {
        let fields = serde_json::to_value(MouthParameters::default())?;
        let names: Vec<&String> = fields.as_object().map(|f| f.keys().collect()).unwrap_or_default();
        let header: Vec<&str> = names.iter().map(|name| name.as_str()).collect();
        writeln!(writer, "person,{},bolton_ratio", header.join(","))?;
        for person in people {
            let values = serde_json::to_value(person)?;
            let cell = |name: &&String| match &values[name.as_str()] {
                serde_json::Value::Array(list) => {
                    list.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
                }
                other => other.to_string(),
            };
            let row: Vec<String> = names.iter().map(cell).collect();
            // A person's number is the seed from which it is drawn.
            writeln!(writer, "{},{},{:.4}", person.seed, row.join(","), person.bolton_ratio())?;
        }
        Ok(())
    })?;
    Ok(())
}
