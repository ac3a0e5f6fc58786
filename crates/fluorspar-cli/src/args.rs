//! Command-line arguments.

use std::ffi::OsString;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use clap_complete::Shell;
use fluorspar_session::{
    AnalyzeOptions, CalibrateOptions, CaptureOptions, CheckOptions, CiteOptions, CohortOptions,
    CompareOptions, CubeOptions, DatasetOptions, PredictOptions, RunOptions,
};
use fluorspar_web::WorkbenchOptions;

use crate::commands::Answering;
use crate::commands::{
    catalog, denoise, describe, design, filter, fluorophore, lens, merge, mouth, new, plot, render, safety,
    scene, schema, sensor, sheet, spectroradiometer, study, tissue, validate,
};
use crate::values;

/// How the program can end.
const EXIT_CODES: &str = "\
Exit codes:
   0  done, also when a time limit ended the render
   1  the machine failed: no memory, no room on the disk, a defect of the program; of `validate`: a case failed
   2  something in the input must be fixed
  75  a signal stopped the work (Ctrl-C, SIGTERM, SIGHUP): the same command later, with --resume where a film is kept, goes on";

/// Heading of the options that every command has, below its own.
const OF_ALL_COMMANDS: &str = "Options of all commands";

/// Predicts what a fluorescence camera records, before the camera is built.
///
/// Without a command, runs the built-in experiment "oraleye-2021": a mouth under white and 385 nm light.
#[derive(Debug, Parser)]
#[command(name = "fluorspar", version, max_term_width = 110, after_help = EXIT_CODES)]
pub(crate) struct Args {
    /// Threads to use; all cores by default. The results do not depend on it.
    #[arg(long, global = true, value_name = "N", value_parser = values::threads, allow_negative_numbers = true,
        help_heading = OF_ALL_COMMANDS)]
    pub(crate) threads: Option<usize>,
    /// Print warnings in full instead of one line for each.
    #[arg(long, short, global = true, help_heading = OF_ALL_COMMANDS)]
    pub(crate) verbose: bool,
    /// Print no progress, no warnings and no list of what was written; answers and errors stay.
    #[arg(long, short, global = true, help_heading = OF_ALL_COMMANDS)]
    pub(crate) quiet: bool,
    /// Neither use nor fill the cache of meshes, tissues and channel planes.
    #[arg(long, global = true, help_heading = OF_ALL_COMMANDS)]
    pub(crate) no_cache: bool,
    #[command(subcommand)]
    pub(crate) command: Option<Command>,
}

/// Command lines that `--help` shows, each at its command.
const EXAMPLES: &str = include_str!("examples.txt");

/// The commands as `--help` groups them.
const GROUPS: [(&str, &[&str]); 6] = [
    (
        "Run and look",
        &[
            "run",
            "workbench",
            "new",
            "render",
            "capture",
            "cube",
            "analyze",
            "sheet",
            "compare",
            "cite",
            "cohort",
            "dataset",
            "merge",
            "denoise",
        ],
    ),
    ("Frames of a camera", &["describe", "calibrate", "study"]),
    ("Design", &["design", "predict", "filter", "plot", "safety"]),
    ("Parts", &["catalog", "fluorophore", "sensor", "lens", "tissue", "spectroradiometer"]),
    ("Scenes", &["scene", "mouth"]),
    ("Checks", &["check", "validate", "schema", "completions"]),
];

impl Args {
    /// The command with its help in groups.
    pub(crate) fn grouped() -> clap::Command {
        let command = Self::command();
        let mut list = String::new();
        for (title, names) in GROUPS {
            list += &format!("\n{title}:\n");
            for name in names {
                let about = command.find_subcommand(name).and_then(clap::Command::get_about);
                let about = about.map_or_else(String::new, ToString::to_string);
                // The rest is in the help of the command
                let about = about.split(". ").next().unwrap_or_default().to_owned();
                list += &format!("  {name:<18} {about}\n");
            }
        }
        with_examples(command, "").help_template(format!(
            "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n{list}\nOptions:\n{{options}}{{after-help}}\n"
        ))
    }

    /// Reads a command line, whose first word is the name of the program.
    pub(crate) fn read(line: impl IntoIterator<Item = OsString>) -> Result<Self, clap::Error> {
        let matches = Self::grouped().try_get_matches_from(line)?;
        Self::from_arg_matches(&matches)
    }
}

/// A command with the examples of those within it that do something.
fn with_examples(command: clap::Command, name: &str) -> clap::Command {
    if command.has_subcommands() {
        return command.mut_subcommands(|sub| {
            let name = format!("{name} {}", sub.get_name());
            with_examples(sub, &name)
        });
    }
    let is_own = |line: &&str| {
        line.strip_prefix(&format!("fluorspar{name}")).is_some_and(|rest| rest.starts_with(' '))
    };
    let lines: Vec<&str> = EXAMPLES.lines().filter(is_own).collect();
    if lines.is_empty() {
        command
    } else {
        command.after_help(format!("Examples:\n  {}", lines.join("\n  ")))
    }
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Run an experiment from scene to report.
    Run(Answering<RunOptions>),
    /// Turn lights, filters, sensors and concentrations in a browser, and see frames and numbers answer.
    Workbench(WorkbenchOptions),
    /// Write a commented file to start from: a mouth, a leaf, a cuvette, a painting, your camera.
    New(new::Options),
    /// List, get, set, convert and view what a scene holds, by name.
    Scene(scene::Options),
    /// Render the spectral radiance of a scene.
    Render(render::Options),
    /// Merge the films of several `render --shard` processes.
    Merge(merge::Options),
    /// Denoise a component image, for display only.
    Denoise(denoise::Options),
    /// Capture raw frames from a component image made by `run` or `render`.
    Capture(Answering<CaptureOptions>),
    /// Write the light of one capture as a spectral cube: Zarr, ENVI, ISETCam, OME-TIFF; or read ENVI or ISETCam.
    Cube(Answering<CubeOptions>),
    /// Draw frames of one render side by side: each fluorophore alone, or with changes.
    Sheet(sheet::Options),
    /// Analyze raw frames, simulated or of a camera: colors, porphyrin share, report.
    Analyze(Answering<AnalyzeOptions>),
    /// Compare two finished runs: settings, numbers with their intervals, frames. Designs that were not run: `design compare`.
    Compare(Answering<CompareOptions>),
    /// List what a run rests on, to be cited: program, methods, sources of its data, files.
    Cite(Answering<CiteOptions>),
    /// Examine many drawn people: normal ranges, truth against estimate, how well a lesion is told.
    Cohort(Answering<CohortOptions>),
    /// Write images of drawn people with their truth, to train and test with: masks, depths, COCO annotations.
    Dataset(Answering<DatasetOptions>),
    /// Write the description that a camera's frame needs beside it: from its tags, and from what you know.
    Describe(describe::Options),
    /// Calibrate a camera from its own dark, flat and target frames: an experiment with its numbers, an acceptance page.
    Calibrate(Answering<CalibrateOptions>),
    /// Keep photographs of people over time: estimates, norms, who is outside, what may leave the clinic.
    Study(study::Options),
    /// List, show and plot parts of the catalogue: lights, filters, dyes, sensors, lenses, tissues.
    Catalog(catalog::Options),
    /// Import measured fluorophores, or fit spectra with them.
    Fluorophore(fluorophore::Options),
    /// Characterize a sensor as in EMVA 1288.
    Sensor(sensor::Options),
    /// Trace a lens.
    Lens(lens::Options),
    /// Assess viewing filters.
    Filter(filter::Options),
    /// Draw light, filters, fluorophores and sensor over one axis of wavelengths.
    Plot(plot::Options),
    /// Generate mouths: meshes, contact sheets of views, cohorts of people.
    Mouth(mouth::Options),
    /// Solve and fit layered tissues; trace photons through them.
    Tissue(tissue::Options),
    /// Predict spectra and mean sensor values of a flat sample, without geometry.
    Predict(Answering<PredictOptions>),
    /// Compare lights, filters and sensors by what they could prove; find the best.
    Design(design::Options),
    /// Assess the photobiological safety of captures: hazards, limits, margins.
    Safety(safety::Options),
    /// Read spectra of a component image or a flat sample as a spectroradiometer would.
    Spectroradiometer(spectroradiometer::Options),
    /// Compute the figures and tables of the paper (Lyu 2021) and compare them with it.
    Validate(validate::Options),
    /// Check an experiment or sample file without running it.
    Check(Answering<CheckOptions>),
    /// Print the JSON schema of a kind of file, for editors.
    Schema(schema::Options),
    /// Print completions for a shell.
    Completions {
        /// The shell.
        shell: Shell,
    },
}

impl Command {
    /// Whether the command renders images or holds whole films: such memory is large, and its parts follow each other. The workbench asks for
    /// what it gave back with each picture.
    pub(crate) fn renders(&self) -> bool {
        matches!(
            self,
            Self::Run(_)
                | Self::Render(_)
                | Self::Merge(_)
                | Self::Denoise(_)
                | Self::Mouth(_)
                | Self::Validate(_)
                | Self::Design(_)
                | Self::Cohort(_)
                | Self::Dataset(_)
        )
    }
}

impl Default for Command {
    fn default() -> Self {
        Self::Run(Answering::default())
    }
}

/// The form of an answer.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct Answer {
    /// Print the answer as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A command and all below it, with their names.
    fn walk(command: &mut clap::Command, name: &str, see: &mut dyn FnMut(&str, &mut clap::Command)) {
        let name = format!("{name} {}", command.get_name());
        if command.get_name() == "help" {
            return;
        }
        see(&name, command);
        command.get_subcommands_mut().for_each(|sub| walk(sub, &name, see));
    }

    #[test]
    fn every_command_is_in_a_group_of_the_help() {
        let command = Args::command();
        let shown = command.get_subcommands().filter(|sub| !sub.is_hide_set());
        let mut named: Vec<&str> = shown.map(clap::Command::get_name).collect();
        let mut grouped: Vec<&str> = GROUPS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
        named.sort_unstable();
        grouped.sort_unstable();
        assert_eq!(named, grouped);
    }

    #[test]
    fn every_command_helps_with_an_example_that_fits_in_a_line() {
        let mut root = Args::grouped();
        walk(&mut root, "", &mut |name, command| {
            let has_example =
                command.get_after_help().is_some_and(|text| text.to_string().contains("fluorspar "));
            assert!(has_example || command.has_subcommands(), "{name}");
        });
        for line in EXAMPLES.lines() {
            // Quotes keep blanks
            let words = line.split('\'').enumerate().flat_map(|(i, part)| match i % 2 {
                0 => part.split_whitespace().map(OsString::from).collect::<Vec<_>>(),
                _ => vec![part.into()],
            });
            assert!(line.len() < 99 && Args::read(words).is_ok(), "{line}");
        }
    }

    #[test]
    fn a_command_helps_with_its_own_options_first() {
        let mut root = Args::command();
        root.build();
        let global: Vec<String> = root
            .get_arguments()
            .filter(|arg| arg.is_global_set())
            .map(|arg| arg.get_id().to_string())
            .collect();
        assert_eq!(global, ["threads", "verbose", "quiet", "no_cache"]);
        let mut seen = 0;
        walk(&mut root, "", &mut |name, command| {
            seen += 1;
            let is_global = |arg: &&clap::Arg| global.iter().any(|id| arg.get_id() == id.as_str());
            for arg in command.get_arguments() {
                let heading = arg.get_help_heading();
                match arg.get_id().as_str() {
                    _ if is_global(&arg) => assert_eq!(heading, Some(OF_ALL_COMMANDS), "{name}: {arg}"),
                    "unit" | "strict" | "light_spectra" | "bands" | "single_scattering" => {}
                    _ => assert_eq!(heading, None, "{name}: {arg}"),
                }
            }
            // As it is printed: own options, then those of all commands, each once
            let own: Vec<String> = command
                .get_opts()
                .filter(|arg| !is_global(arg) && !arg.is_hide_set())
                .filter_map(|arg| Some(format!("--{}", arg.get_long()?)))
                .collect();
            let help = command.render_help().to_string();
            let parts: Vec<&str> = help.split(&format!("\n{OF_ALL_COMMANDS}:\n")).collect();
            assert_eq!(parts.len(), 2, "{name}\n{help}");
            let stands =
                |part: &str, option: &str| part.split([' ', '\n', ',']).any(|word| word.trim() == option);
            let below: Vec<&String> = own.iter().filter(|option| !stands(parts[0], option)).collect();
            assert!(below.is_empty(), "{name}: {below:?}\n{help}");
            let below = parts[1].lines().filter(|line| line.trim_start().starts_with('-')).count();
            assert_eq!(below, global.len(), "{name}\n{help}");
        });
        assert!(seen > 70, "{seen}");
    }
}
