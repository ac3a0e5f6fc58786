//! The paper, figure by figure: what it says, what comes out, and whether they agree.
//!
//! | step | call | gives |
//! |---|---|---|
//! | list | [`cases`] | a [`Case`] for each figure and table of Lyu et al. 2021 |
//! | run | [`Case::run`] on a [`Setup`] | a [`CaseResult`]: [`Check`]s, a [`Verdict`] with its reason, figures |
//! | write | [`validation_page`], [`CaseResult::to_json`], [`markdown_table`] | page, JSON, table |
//!
//! A tolerance is derived where it stands: rounding of the printed digits, standard errors, a bound of the physics. Where data of
//! the authors are not public, a case checks what can be said without them and says so.

mod check;
mod figure_2;
mod figure_3;
mod figure_4;
mod figure_5;
mod figure_6;
mod figure_6g;
mod figure_7;
mod figure_8;
mod page;
mod people;
mod setup;
mod table_1;

pub use check::{CaseResult, Check, Verdict};
pub use page::{markdown_table, summary, validation_page};
pub use setup::{Setup, ValidationError};

use check::Outcome;

/// A figure or table of the paper.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// Name, as `--case` takes it.
    pub name: &'static str,
    /// Title.
    pub title: &'static str,
    /// What the paper says.
    pub paper: &'static str,
    /// Whether it renders a mouth, which takes seconds to minutes.
    pub is_rendered: bool,
    /// What it compares.
    compare: fn(&Setup<'_>) -> Result<Outcome, ValidationError>,
}

impl Case {
    /// Computes what the paper shows and compares.
    ///
    /// # Errors
    /// A setup that can't be computed with, such as a sample without a sensor or a damaged file of measured data. A comparison
    /// that fails is no error: its verdict says so.
    pub fn run(&self, setup: &Setup<'_>) -> Result<CaseResult, ValidationError> {
        Ok(CaseResult::judge(self, (self.compare)(setup)?))
    }
}

/// All cases, in the order of the paper.
pub fn cases() -> &'static [Case] {
    &CASES
}

const CASES: [Case; 16] = [
    Case {
        name: "table-1",
        title: "Sensor: geometry, electronics, noise",
        paper: "2.5 um pixels, fill factor 0.99, 9000 e-, 0.911 V, 0.10 mV/e-, 12 bit, DSNU 0.2536 mV, PRNU 2.29 %, dark voltage \
                0.15 mV/s, read noise 1.39 mV.",
        is_rendered: false,
        compare: table_1::run,
    },
    Case {
        name: "figure-2",
        title: "Poses of jaw and tongue",
        paper: "The mouth in various poses of tongue and jaw, viewed at different orientations.",
        is_rendered: true,
        compare: figure_2::run,
    },
    Case {
        name: "figure-3",
        title: "Excitation-emission matrices, and emission under the LED",
        paper: "The matrices are triangular, their peaks are 1. Collagen, elastin, FAD and NADH overlap much, porphyrin does not \
                overlap with them.",
        is_rendered: false,
        compare: figure_3::run,
    },
    Case {
        name: "figure-4",
        title: "Spectra of the two lights",
        paper: "The white light is broadband, the blue LED peaks at 385 nm.",
        is_rendered: false,
        compare: figure_4::run,
    },
    Case {
        name: "figure-5a",
        title: "The 385 nm LED on a logarithmic axis",
        paper: "2.5 orders below the peak at 440 nm (text), 3 orders at 450 nm (caption). The LED also emits in the near infrared.",
        is_rendered: false,
        compare: figure_5::bare_led,
    },
    Case {
        name: "figure-5b",
        title: "The 385 nm LED behind its filter",
        paper: "A short-pass blocks wavelengths above 425 nm (caption); Hoya Y44 in front of the LEDs reduces energy above 475 nm \
                (text).",
        is_rendered: false,
        compare: figure_5::filtered_led,
    },
    Case {
        name: "figure-5c",
        title: "The filter in front of the sensor",
        paper: "Blocks below 425 nm and above 700 nm, nearly transparent from 450 to 700 nm (caption); blocks below 475 nm (text).",
        is_rendered: false,
        compare: figure_5::viewing_filter,
    },
    Case {
        name: "figure-5d",
        title: "Effective responsivity of the sensor",
        paper: "Three curves, which are not public; the sensor responds only from 475 to 700 nm.",
        is_rendered: false,
        compare: figure_5::responsivity,
    },
    Case {
        name: "figure-6a-f",
        title: "Images with masks of porphyrin",
        paper: "The image is the sum of the porphyrin image multiplied by a mask and of the bulk image.",
        is_rendered: true,
        compare: figure_6::run,
    },
    Case {
        name: "figure-6g",
        title: "Measured radiance as sums of fluorophores",
        paper: "Measured radiance of two tongues is predicted with zero NADH, low FAD and collagen, high elastin, and little or much \
                porphyrin.",
        is_rendered: false,
        compare: figure_6g::run,
    },
    Case {
        name: "figure-7a",
        title: "Sensor values of bulk, porphyrin and their mixture",
        paper: "The signal of a mixture is the vector sum of the signals of bulk and porphyrin, noise included.",
        is_rendered: false,
        compare: figure_7::plane,
    },
    Case {
        name: "figure-7b",
        title: "Chromaticities of mixtures",
        paper: "Chromaticities of mixtures lie on the line between those of bulk and porphyrin.",
        is_rendered: false,
        compare: figure_7::line,
    },
    Case {
        name: "figure-7c",
        title: "Chromaticities of five fluorophores",
        paper: "NADH, FAD, collagen and elastin fall in a small region, porphyrin lies far from it.",
        is_rendered: false,
        compare: figure_7::cluster,
    },
    Case {
        name: "figure-8",
        title: "Chromaticities of three people",
        paper: "Pixels of the tongues of three people lie along a line from the bulk fluorophores in the direction of porphyrin; \
                its length differs between people.",
        is_rendered: true,
        compare: figure_8::run,
    },
    Case {
        name: "figure-8-measured",
        title: "Measured tongues and lips through this camera",
        paper: "Porphyrin is on the dorsal side of tongues; data of tongues extend from the bulk toward porphyrin.",
        is_rendered: false,
        compare: people::run,
    },
    Case {
        name: "detectors",
        title: "Sensitivity, specificity, d' and ROC",
        paper: "Devices for oral lesions have high sensitivity and low specificity (5.2).",
        is_rendered: false,
        compare: figure_7::detectors,
    },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_every_case_says_what_the_paper_says() {
        let mut names: Vec<&str> = cases().iter().map(|case| case.name).collect();
        assert!(cases().iter().all(|case| case.paper.ends_with('.') && !case.title.is_empty()));
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count);
    }
}
