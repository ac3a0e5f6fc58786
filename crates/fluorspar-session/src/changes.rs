//! Changes on top of an experiment, as options of tasks.

use clap::ValueHint;
use fluorspar::image::StatisticsKind;
use serde::Deserialize;

use crate::values::{self, Override};

/// The experiment and its changes.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct ExperimentArgs {
    /// Experiment file (.toml), a report.html made by an earlier run, or the name of a built-in experiment; of `render` also
    /// a scene of pbrt (.pbrt).
    #[arg(value_name = "EXPERIMENT", value_hint = ValueHint::FilePath)]
    pub experiment: Option<String>,
    /// Changes by path.
    #[command(flatten)]
    #[serde(flatten)]
    pub changes: Changes,
    /// Changes of the render.
    #[command(flatten)]
    #[serde(flatten)]
    pub render: RenderOptions,
}

/// What most renders change.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct RenderOptions {
    /// Seed of the render.
    #[command(flatten)]
    #[serde(flatten)]
    pub seed: Seed,
    /// Samples (paths) per pixel: more samples take longer and give less noise.
    #[arg(long, value_name = "N", value_parser = values::whole::<u32, 1, 1_000_000>, allow_negative_numbers = true)]
    pub spp: Option<u32>,
    /// Maximum path depth (surface interactions); 1 is direct light only.
    #[arg(long, value_name = "D", value_parser = values::whole::<u32, 1, 1000>, allow_negative_numbers = true)]
    pub depth: Option<u32>,
    /// Stop once the relative error of a tile is below E; --spp is the maximum.
    #[arg(long, value_name = "E", value_parser = values::number, allow_negative_numbers = true)]
    pub error: Option<f64>,
    /// Keep half-buffers and variance in component images.
    #[arg(long, value_parser = values::choice::<StatisticsKind>(&["none", "light_groups", "components"]), value_name = "WHAT")]
    pub statistics: Option<StatisticsKind>,
}

impl ExperimentArgs {
    /// All changes; what has an option of its own wins over `--set`.
    pub fn overrides(&self) -> Vec<Override> {
        self.changes.overrides().into_iter().chain(self.render.overrides()).collect()
    }
}

impl RenderOptions {
    /// The options as changes.
    pub fn overrides(&self) -> Vec<Override> {
        let whole = |path, value: Option<u32>, option: &str| {
            value.map(|n| Override::of_option(path, n, format!("⟨{option}={n}⟩")))
        };
        let mut list = Vec::new();
        list.extend(whole("render.samples_per_pixel", self.spp, "spp"));
        list.extend(self.seed.overrides());
        list.extend(whole("render.max_depth", self.depth, "depth"));
        list.extend(self.error.map(|value| Override::number("render.relative_error", value, "error")));
        list.extend(self.statistics.map(|kind| {
            let name = values::name_of(&kind);
            Override::of_option("render.statistics", name.clone(), format!("⟨statistics={name}⟩"))
        }));
        list
    }
}

/// Changes on top of an experiment file.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct Changes {
    /// Change one value, for instance `--set capture.blue.exposure_ms=15`. May be repeated.
    #[arg(long = "set", value_name = "PATH=VALUE")]
    pub set: Vec<String>,
    /// Take away one value, entry or section, for instance `--unset analysis`, before --set. May be repeated.
    #[arg(long, value_name = "PATH")]
    pub unset: Vec<String>,
}

impl Changes {
    /// What is taken away, then what is set.
    pub fn overrides(&self) -> Vec<Override> {
        let unset = self.unset.iter().map(|path| Override::unset(path));
        unset.chain(self.set.iter().map(|text| Override::set(text))).collect()
    }
}

/// Seed of the random numbers.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct Seed {
    /// Seed of all random numbers.
    #[arg(long, value_name = "S", value_parser = values::seed, allow_negative_numbers = true)]
    pub seed: Option<u64>,
}

impl Seed {
    /// The seed as a change.
    pub fn overrides(&self) -> Option<Override> {
        self.seed.map(|n| Override::of_option("render.seed", n, format!("⟨seed={n}⟩")))
    }
}
