//! `fluorspar cite`: what a run rests on, in words.

use fluorspar_session::Citations;

pub(crate) fn describe(cited: &Citations) -> String {
    let mut text =
        format!("{}: Fluorspar {}, experiment {}\n", cited.report, cited.version, cited.experiment_sha256);
    if cited.has_changed {
        text += "The catalogue or a file has changed since this run: the sources below are those of today.\n";
    }
    text += &heading("Program", &cited.program);
    text += &heading("Methods", &cited.methods);
    let data: Vec<String> = cited
        .data
        .iter()
        .map(|cited| format!("{}\n      {}", cited.source, cited.entries.join(", ")))
        .collect();
    text += &heading("Data", &data);
    let files: Vec<String> = cited.files.iter().map(|(path, sha256)| format!("{sha256}  {path}")).collect();
    text + &heading("Files", &files)
}

/// A heading with its lines; nothing where there are none.
fn heading(title: &str, lines: &[impl AsRef<str>]) -> String {
    if lines.is_empty() {
        return String::new();
    }
    let list: String = lines.iter().map(|line| format!("  - {}\n", line.as_ref())).collect();
    format!("\n{title}\n{list}")
}
