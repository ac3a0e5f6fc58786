//! Words that a report uses.

use super::report_data::{ReportItem, Section};

/// Glossary of the page, for readers from another field.
pub fn glossary_section() -> Section {
    let terms = [
        (
            "Fluorophore",
            "A substance that takes in light of one color and gives off light of a longer wavelength. Collagen, elastin, NADH, FAD \
             and porphyrins are the ones that glow in the mouth.",
        ),
        (
            "Bulk fluorescence",
            "The glow of collagen, elastin, FAD and NADH together. Under a single excitation light their colors are too alike \
             to tell apart.",
        ),
        (
            "Porphyrins",
            "Substances, in the mouth made mostly by bacteria, whose deep red glow stands apart from the bulk.",
        ),
        (
            "Spectral radiance",
            "How much light of one wavelength a spot sends in one direction, in watts per square meter of surface, per \
             steradian of direction and per nanometer of wavelength.",
        ),
        (
            "Digital number (DN)",
            "The whole number that the sensor writes down for one pixel. After the dark level is subtracted it grows in \
             proportion to the light, up to saturation.",
        ),
        (
            "Sensor chromaticity (r, g)",
            "The share of a pixel's signal that is red and the share that is green. How bright the pixel is cancels out, so uneven \
             lighting does not disturb it.",
        ),
        (
            "Porphyrin fraction",
            "The amount of porphyrin divided by the amount of porphyrin and bulk together. Amounts are in the relative \
             units of the fluorophore models, not in moles.",
        ),
        (
            "Standard error and 95 % interval",
            "How far the camera's noise alone would move a number from one exposure to the next. Of a hundred such intervals, \
             about ninety-five contain the true value, if the model is right.",
        ),
        (
            "Noise floor",
            "The flicker that the sensor shows in the dark. Pixels that hardly rise above it are left out, because a ratio \
             of two such numbers means nothing.",
        ),
        (
            "Saturated",
            "A pixel that received more light than it can count. Its value is too low by an unknown amount; it is left out.",
        ),
        (
            "Computed, measured, published, assumed",
            "Computed: this run worked it out. Measured: taken from an instrument's data. Published: printed in a paper. Assumed: \
             nobody measured it for this system, and results may change with it.",
        ),
    ];
    let terms = terms.map(|(term, meaning)| (term.to_owned(), meaning.to_owned())).to_vec();
    Section::new("Words used on this page").with(ReportItem::Terms(terms))
}
