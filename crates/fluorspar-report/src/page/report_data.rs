//! Contents of a report, before layout.

use fluorspar::pipeline::LiveView;
use fluorspar_experiment::Warning;

use crate::Figure;

/// A whole report.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReportData {
    /// Title.
    pub title: String,
    /// The first screen: images and the answer; `None` for a page that begins with its headline.
    pub overview: Option<Overview>,
    /// Frames that follow sliders.
    pub live: Option<LiveView>,
    /// Opening paragraphs: what was simulated and what came out, in plain words.
    pub lead: Vec<String>,
    /// The few numbers that matter most.
    pub headline: Vec<Number>,
    /// Warnings about the reliability of the numbers.
    pub warnings: Vec<Warning>,
    /// The body.
    pub sections: Vec<Section>,
    /// Version, seed, scene hash and the like: name and value.
    pub provenance: Vec<(String, String)>,
    /// The resolved experiment, TOML; empty for a page that no experiment was made for, which then has no part on how to run it again.
    pub experiment_toml: String,
    /// Files that the experiment reads, by path: they are not in the page.
    pub input_files: Vec<String>,
    /// The command that makes this run again, for instance `fluorspar run report.html`; empty where the experiment only describes what
    /// is assumed of frames that were recorded.
    pub rerun_command: String,
}

/// The first screen of a report.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Overview {
    /// Images, one at a time; the first one is shown first.
    pub views: Vec<FrameView>,
    /// The estimate that the run was made for.
    pub answer: Option<Answer>,
    /// The numbers that decide whether the design works.
    pub cards: Vec<Number>,
    /// What the numbers rest on, a sentence each.
    pub assumed: Vec<String>,
}

/// An image of the first screen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameView {
    /// Name on its tab.
    pub name: String,
    /// The image, PNG.
    pub png: Vec<u8>,
    /// Its columns and rows.
    pub size: [usize; 2],
    /// Caption: exposure, and how the image was made.
    pub caption: String,
    /// What is seen, for those who do not see it.
    pub alt: String,
    /// Outlines of the region, closed, in pixels of the image.
    pub outline: Vec<Vec<[f64; 2]>>,
    /// Names in the image, each around its place, in pixels of the image.
    pub names: Vec<(String, [f64; 2])>,
    /// A map over the image, on a tab of its own.
    pub map: Option<MapOverlay>,
    /// Files beside the page: name and relative path.
    pub links: Vec<(String, String)>,
}

/// A map that lies over an image.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapOverlay {
    /// Name on its tab.
    pub name: String,
    /// Whether its tab comes after that of the image.
    pub is_second: bool,
    /// The map with opacity, PNG.
    pub png: Vec<u8>,
    /// Left and top edge, width and height, in pixels of the image.
    pub frame: [f64; 4],
    /// Quantity of the color scale.
    pub label: String,
    /// Values at the ends of the color scale.
    pub limits: [f64; 2],
    /// What it shows and how it was smoothed.
    pub caption: String,
}

/// An estimate with its interval and what makes it uncertain.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Answer {
    /// What is estimated.
    pub quantity: String,
    /// The estimate.
    pub value: String,
    /// Its interval and what that contains.
    pub interval: String,
    /// The truth beside it, in a simulation.
    pub truth: String,
    /// Another estimate of the same quantity, and what that assumes; may be empty.
    pub other: String,
    /// What makes it uncertain, each kind under a heading.
    pub budgets: Vec<Contributions>,
}

/// Contributions to an error under a heading.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contributions {
    /// The heading.
    pub title: String,
    /// Each contribution; none hides the heading.
    pub rows: Vec<Contribution>,
}

/// A contribution to an error.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contribution {
    /// Its name.
    pub name: String,
    /// Its size as text.
    pub text: String,
    /// Its size relative to the largest one, 0 to 1.
    pub size: f64,
}

/// A part of a report under its own heading.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Section {
    /// Heading.
    pub title: String,
    /// What the section says, in a line: shown while it is folded. Empty: the section is not folded.
    pub note: String,
    /// Contents in order.
    pub items: Vec<ReportItem>,
}

/// Something in a section.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum ReportItem {
    /// A paragraph of plain text.
    Paragraph(String),
    /// Pictures side by side.
    Pictures(Vec<ReportPicture>),
    /// A figure with its explanation, and more text under it.
    Figure {
        /// The figure.
        figure: Figure,
        /// Explanation of this one; may be empty.
        caption: String,
        /// Name of its files in the folder `figures` beside the page; empty where there are none.
        stem: String,
    },
    /// Numbers.
    Table(NumberTable),
    /// Numbers of several things side by side.
    Matrix(NumberMatrix),
    /// Terms and their meanings.
    Terms(Vec<(String, String)>),
}

/// A PNG picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReportPicture {
    /// The PNG file.
    pub png: Vec<u8>,
    /// Title.
    pub title: String,
    /// Caption: contents, and how to read it.
    pub caption: String,
}

/// A table of numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NumberTable {
    /// Title of the numbers.
    pub caption: String,
    /// The numbers.
    pub rows: Vec<Number>,
}

/// Numbers of several things, one row each.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NumberMatrix {
    /// Title of the numbers.
    pub caption: String,
    /// Headings of all columns, that of the names first, with units.
    pub columns: Vec<String>,
    /// Name and values of each row.
    pub rows: Vec<Vec<String>>,
    /// What the numbers mean.
    pub note: String,
}

/// A number with everything a reader needs to judge it.
#[derive(Clone, Debug, PartialEq)]
pub struct Number {
    /// Its name.
    pub name: String,
    /// Its value, formatted, with an interval where there is one.
    pub value: String,
    /// Its unit; empty for a pure number.
    pub unit: String,
    /// Explanation, in plain words.
    pub meaning: String,
    /// Where it comes from.
    pub origin: Origin,
}

/// Where a number comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Origin {
    /// This run computed it.
    Computed,
    /// Somebody measured it; the source.
    Measured(String),
    /// It is printed in a publication; the source.
    Published(String),
    /// The experiment or a preset that it names has it; which.
    Stated(String),
    /// Nobody measured it for this system; why this value.
    Assumed(String),
}

impl Origin {
    /// The badge: one word.
    pub(super) fn word(&self) -> &'static str {
        match self {
            Self::Computed => "computed",
            Self::Measured(_) => "measured",
            Self::Published(_) => "published",
            Self::Stated(_) => "stated",
            Self::Assumed(_) => "assumed",
        }
    }

    /// Source or reason.
    pub(super) fn detail(&self) -> &str {
        match self {
            Self::Computed => "",
            Self::Measured(text) | Self::Published(text) | Self::Stated(text) | Self::Assumed(text) => text,
        }
    }
}

impl Number {
    /// A number that this run computed.
    pub fn computed(
        name: impl Into<String>,
        value: impl Into<String>,
        unit: impl Into<String>,
        meaning: impl Into<String>,
    ) -> Self {
        Self {
            name: name.into(),
            value: value.into(),
            unit: unit.into(),
            meaning: meaning.into(),
            origin: Origin::Computed,
        }
    }

    /// The same number with another origin.
    #[must_use]
    pub fn from(self, origin: Origin) -> Self {
        Self { origin, ..self }
    }
}

impl Section {
    /// An empty section.
    pub fn new(title: impl Into<String>) -> Self {
        Self { title: title.into(), note: String::new(), items: Vec::new() }
    }

    /// The section folded under its title and a line that says what is in it.
    #[must_use]
    pub fn folded(self, note: impl Into<String>) -> Self {
        Self { note: note.into(), ..self }
    }

    /// The section with one more item.
    #[must_use]
    pub fn with(mut self, item: ReportItem) -> Self {
        self.items.push(item);
        self
    }

    /// The section with one more paragraph.
    #[must_use]
    pub fn say(self, text: impl Into<String>) -> Self {
        self.with(ReportItem::Paragraph(text.into()))
    }

    /// The section with one more figure.
    #[must_use]
    pub fn show(self, figure: Figure, caption: impl Into<String>) -> Self {
        self.with(ReportItem::Figure { figure, caption: caption.into(), stem: String::new() })
    }
}
