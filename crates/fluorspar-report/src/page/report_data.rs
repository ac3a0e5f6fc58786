//! Contents of a report, before layout.

use crate::Figure;

/// A whole report.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReportData {
    /// Title.
    pub title: String,
    /// Opening paragraphs: what was simulated and what came out, in plain words.
    pub lead: Vec<String>,
    /// The few numbers that matter most.
    pub headline: Vec<Number>,
    /// Warnings about the reliability of the numbers.
    pub warnings: Vec<String>,
    /// The body.
    pub sections: Vec<Section>,
    /// Version, seed, scene hash and the like: name and value.
    pub provenance: Vec<(String, String)>,
    /// The resolved experiment, TOML.
    pub experiment_toml: String,
    /// The command that makes this run again, for instance `fluorspar run report.html`.
    pub rerun_command: String,
}

/// A part of a report under its own heading.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Section {
    /// Heading.
    pub title: String,
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
    },
    /// Numbers.
    Table(NumberTable),
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
            Self::Assumed(_) => "assumed",
        }
    }

    /// Source or reason.
    pub(super) fn detail(&self) -> &str {
        match self {
            Self::Computed => "",
            Self::Measured(source) | Self::Published(source) | Self::Assumed(source) => source,
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
        Self { title: title.into(), items: Vec::new() }
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
        self.with(ReportItem::Figure { figure, caption: caption.into() })
    }
}
