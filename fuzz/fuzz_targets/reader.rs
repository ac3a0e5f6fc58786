//! One reader, by its name in `FLUORSPAR_READER`, under libFuzzer. Readers and their valid files are those of
//! `crates/fluorspar-experiment/examples/mutate_inputs`, which damages files without coverage and counts time and memory.
//!
//! With `FLUORSPAR_CORPUS` the valid files of all readers are written there, in a folder each, and nothing is fuzzed.

#![no_main]

#[path = "../../crates/fluorspar-experiment/examples/mutate_inputs/readers.rs"]
mod readers;

use std::cell::OnceCell;
use std::fs;
use std::path::PathBuf;

use libfuzzer_sys::fuzz_target;
use readers::{Subject, Subjects};

/// The reader, and the folder in which it reads.
struct Fuzzed {
    subject: Subject,
    folder: PathBuf,
}

thread_local! {
    static FUZZED: OnceCell<Fuzzed> = const { OnceCell::new() };
}

/// Name of a folder for a reader.
fn folder_name(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}

fn write_corpus(subjects: &[Subject], corpus: &str) {
    for subject in subjects {
        let folder = PathBuf::from(corpus).join(folder_name(subject.name));
        fs::create_dir_all(&folder).expect("the corpus can be written");
        for (number, seed) in subject.seeds.iter().enumerate() {
            fs::write(folder.join(format!("valid-{number}")), seed).expect("the corpus can be written");
        }
    }
}

fn prepare() -> Fuzzed {
    let folder = tempfile::tempdir().expect("a folder for the files").keep();
    let mut subjects = Subjects::all(&folder).expect("the valid files can be made").list;
    let name = std::env::var("FLUORSPAR_READER").unwrap_or_default();
    let known: Vec<String> = subjects.iter().map(|subject| folder_name(subject.name)).collect();
    let place = match std::env::var("FLUORSPAR_CORPUS") {
        Ok(corpus) => {
            write_corpus(&subjects, &corpus);
            0
        }
        Err(_) => known.iter().position(|one| *one == name).unwrap_or_else(|| {
            panic!("FLUORSPAR_READER is \"{name}\"; known: {}", known.join(", "));
        }),
    };
    let subject = subjects.swap_remove(place);
    for (name, content) in &subject.companions {
        fs::write(folder.join(name), content).expect("the companions can be written");
    }
    Fuzzed { subject, folder }
}

fuzz_target!(|bytes: &[u8]| {
    FUZZED.with(|fuzzed| {
        let Fuzzed { subject, folder } = fuzzed.get_or_init(prepare);
        fs::write(folder.join(subject.file), bytes).expect("the input can be written");
        (subject.read)(&folder.join(subject.opened));
    });
});
