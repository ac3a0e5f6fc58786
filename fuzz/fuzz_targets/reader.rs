//! One reader, by its name in `FLUORSPAR_READER`, under libFuzzer. Readers and their valid files are those of
//! `crates/fluorspar-experiment/examples/mutate_inputs`, which damages files without coverage and counts time and memory, and of `fronts.rs`.
//!
//! With `FLUORSPAR_CORPUS` the valid files of all readers are written there, in a folder each, and nothing is fuzzed.

#![no_main]

mod fronts;
#[path = "../../crates/fluorspar-experiment/examples/mutate_inputs/readers.rs"]
mod readers;

use std::cell::OnceCell;
use std::fs;
use std::path::{Path, PathBuf};

use fronts::FRONTS;
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

/// The reader of this name, made in a folder.
fn subject(name: &str, folder: &Path) -> Subject {
    if let Some((_, make)) = FRONTS.iter().find(|(front, _)| *front == name) {
        return make(folder).expect("the valid files can be made");
    }
    let subjects = Subjects::all(folder).expect("the valid files can be made").list;
    let known = subjects.iter().map(|subject| folder_name(subject.name));
    let known: Vec<String> = known.chain(FRONTS.iter().map(|(front, _)| (*front).to_owned())).collect();
    let named = subjects.into_iter().find(|subject| folder_name(subject.name) == name);
    named.unwrap_or_else(|| panic!("FLUORSPAR_READER is \"{name}\"; known: {}", known.join(", ")))
}

fn write_seeds(name: &str, subject: &Subject, corpus: &Path) {
    let folder = corpus.join(name);
    fs::create_dir_all(&folder).expect("the corpus can be written");
    for (number, seed) in subject.seeds.iter().enumerate() {
        fs::write(folder.join(format!("valid-{number}")), seed).expect("the corpus can be written");
    }
}

/// The valid files of all readers.
fn write_corpus(corpus: &Path) {
    let folder = || tempfile::tempdir().expect("a folder for the files");
    for subject in Subjects::all(folder().path()).expect("the valid files can be made").list {
        write_seeds(&folder_name(subject.name), &subject, corpus);
    }
    for (name, make) in FRONTS {
        let folder = folder();
        write_seeds(name, &make(folder.path()).expect("the valid files can be made"), corpus);
    }
}

fn prepare() -> Fuzzed {
    let folder = tempfile::tempdir().expect("a folder for the files").keep();
    let name = match std::env::var("FLUORSPAR_CORPUS") {
        // A fuzzer that exits by itself counts as broken: it reads one input of any reader
        Ok(corpus) => {
            write_corpus(Path::new(&corpus));
            "cohort_table".into()
        }
        Err(_) => std::env::var("FLUORSPAR_READER").unwrap_or_default(),
    };
    let subject = subject(&name, &folder);
    for (name, content) in &subject.companions {
        fs::write(folder.join(name), content).expect("the companions can be written");
    }
    Fuzzed { subject, folder }
}

fn read(bytes: &[u8]) {
    FUZZED.with(|fuzzed| {
        let Fuzzed { subject, folder } = fuzzed.get_or_init(prepare);
        fs::write(folder.join(subject.file), bytes).expect("the input can be written");
        (subject.read)(&folder.join(subject.opened));
    });
}

// Valid files are made before: they may take longer than an input is granted
fuzz_target!(init: FUZZED.with(|fuzzed| { fuzzed.get_or_init(prepare); }), |bytes: &[u8]| read(bytes));
