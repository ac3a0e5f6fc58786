//! Every file of `bad_experiments/` is wrong in one way. It begins with the message that it must produce,
//! `# error: ...`, and may give overrides, `# set: path=value`. `{folder}` stands for the folder of the files.

use std::fs;
use std::path::Path;

use fluorspar_experiment::{parse, parse_sample, resolve};

/// The first error of a file, reported under its bare name.
fn first_error(text: &str, name: &str, folder: &Path) -> Option<String> {
    let overrides: Vec<String> =
        text.lines().filter_map(|line| line.strip_prefix("# set: ")).map(String::from).collect();
    if name.starts_with("sample_") {
        return parse_sample(text, name, folder, &overrides).err().map(|error| error.to_string());
    }
    match parse(text, name, folder, &overrides) {
        Err(error) => Some(error.to_string()),
        Ok(experiment) => resolve(&experiment).err().map(|error| error.to_string()),
    }
}

#[test]
fn every_bad_file_is_explained() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bad_experiments");
    let mut names: Vec<String> = fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.ends_with(".toml"))
        .collect();
    names.sort();
    assert!(names.len() >= 40, "only {} files", names.len());
    let mut wrong = String::new();
    for name in names {
        let text = fs::read_to_string(folder.join(&name)).unwrap();
        let expected =
            text.lines().next().and_then(|line| line.strip_prefix("# error: ")).unwrap_or_default();
        let found = first_error(&text, &name, &folder).unwrap_or_else(|| "no error".into());
        let found = found.replace(&*folder.to_string_lossy(), "{folder}");
        if found != expected {
            wrong.push_str(&format!("{name}\n  expected: {expected}\n  found:    {found}\n"));
        }
    }
    assert!(wrong.is_empty(), "\n{wrong}");
}
