//! Words that a report uses.

use fluorspar::analysis::Analyte;

use super::report_data::{Overview, ReportData, ReportItem, Section};

/// A term, what a page must contain for it to be explained, and the explanation.
type Term = (&'static str, &'static [&'static str], &'static str);

const TERMS: [Term; 14] = [
    (
        "Share, red fluorescence",
        &["ed fluorescence", "share of the fluorescence"],
        "Of the fluorescence that the sensor counts, the part that one substance gives off; a small amount of a bright one may have a large \
         share. Red fluorescence is the part of all substances that glow deep red.",
    ),
    (
        "Smallest share seen",
        &["Smallest share seen"],
        "The smallest share that this camera would tell from none in a typical region: in patches there are places without it to compare with; \
         spread evenly it looks like another tissue.",
    ),
    (
        "Leak",
        &["Leak"],
        "Light of the lamp that was only reflected and came through the filter. It counts as fluorescence that is not there.",
    ),
    (
        "d'",
        &["d' "],
        "How far two places lie apart, in standard deviations: below 1 hardly anybody tells them apart, from 3 on nearly everybody does.",
    ),
    (
        "Electrons (e-)",
        &[" e-"],
        "What light frees in a pixel and the sensor counts, before gain and rounding.",
    ),
    (
        "Risk group",
        &["isk group"],
        "How dangerous a lamp is to eyes and skin, after IEC 62471: 0 none, 1 low, 2 moderate, 3 high.",
    ),
    (
        "Fluorophore",
        &["fluorophore"],
        "A substance that takes in light of one color and gives off light of a longer wavelength.",
    ),
    (
        "Spectral radiance",
        &["spectral radiance"],
        "How much light of one wavelength a spot sends in one direction, in watts per square meter of surface, per \
         steradian of direction and per nanometer of wavelength.",
    ),
    (
        "Digital number (DN)",
        &[" DN"],
        "The whole number that the sensor writes down for one pixel. After the dark level is subtracted it grows in \
         proportion to the light, up to saturation.",
    ),
    (
        "Sensor chromaticity (r, g)",
        &["chromaticity"],
        "The share of a pixel's signal that is red and the share that is green. How bright the pixel is cancels out, so uneven \
         lighting does not disturb it.",
    ),
    (
        "Mixture line, blank, detection limit",
        &["mixture line", "Mixture line"],
        "All mixtures of two lights lie on a line in the plane of chromaticities; the place on it is the share of the second one in the \
         light, not in the amounts. The blank is what comes out without the second one, the detection limit how far beyond it something is told from nothing.",
    ),
    (
        "95 % interval",
        &["95 %", "standard error"],
        "Of a hundred such intervals about ninety-five contain the true value, if the model is right. Each says what it contains: \
         sensor noise alone, or also what is not known of the tissue. The latter holds on average over all tissue that was assumed \
         beforehand, with and without what is looked for: for one tissue it may hold less often.",
    ),
    (
        "Clipped, saturated",
        &["lipped", "aturated"],
        "A pixel that received more light than it can count. Its value is too low by an unknown amount; it is left out.",
    ),
    (
        "Published, stated, assumed",
        &["Table 1", "ssumed"],
        "Published: printed in a paper. Stated: as the experiment or its preset has it. Assumed: nobody measured it for this system, and \
         results may change with it. All numbers that are not marked were computed by this run.",
    ),
];

/// The glossary of a page for readers from another field: terms that its text contains. `target` is the fluorophore that is looked
/// for, if any, `bulk` the names of the others that it is told from.
pub(crate) fn glossary_section(text: &str, target: Option<&Analyte>, bulk: &[String]) -> Option<Section> {
    let mut terms: Vec<(String, String)> = Vec::new();
    for (term, signs, meaning) in TERMS {
        if signs.iter().any(|sign| text.contains(sign)) {
            terms.push((term.into(), meaning.into()));
        }
    }
    if let Some(target) = target
        && !bulk.is_empty()
        && text.contains("bulk")
    {
        let meaning =
            format!("The fluorescence of {} together, from which {target} is told.", bulk.join(", "));
        terms.push(("Bulk".into(), meaning));
    }
    if target.is_some_and(Analyte::is_porphyrin) && text.to_lowercase().contains("porphyrin") {
        let meaning = "Substances, in the mouth made mostly by bacteria, whose fluorescence is deep red.";
        terms.push(("Porphyrins".into(), meaning.into()));
    }
    let names: Vec<String> = terms.iter().map(|(term, _)| term.clone()).collect();
    (!terms.is_empty()).then(|| {
        Section::new("Words used on this page").folded(names.join(", ")).with(ReportItem::Terms(terms))
    })
}

/// All words of a page but its experiment.
pub(crate) fn plain_text(page: &ReportData) -> String {
    let mut text: Vec<String> = page.lead.clone();
    text.extend(page.warnings.iter().map(|warning| warning.text().to_owned()));
    if let Some(overview) = &page.overview {
        text.extend(overview_text(overview));
    }
    for section in &page.sections {
        text.push(section.title.clone());
        text.push(section.note.clone());
        text.extend(section.items.iter().map(item_text));
    }
    text.join("\n")
}

fn overview_text(overview: &Overview) -> Vec<String> {
    let mut text: Vec<String> = overview.assumed.clone();
    text.extend(overview.cards.iter().map(|card| format!("{} {} {}", card.name, card.unit, card.meaning)));
    text.extend(overview.views.iter().map(|view| format!("{} {}", view.caption, view.alt)));
    text.extend(overview.answer.iter().map(|answer| format!("{} {}", answer.quantity, answer.interval)));
    text
}

fn item_text(item: &ReportItem) -> String {
    match item {
        ReportItem::Paragraph(text) => text.clone(),
        ReportItem::Pictures(pictures) => pictures.iter().map(|p| p.caption.as_str()).collect(),
        ReportItem::Figure { figure, caption, .. } => {
            format!("{} {} {caption}", figure.title, figure.explanation)
        }
        ReportItem::Table(table) => {
            let rows = table
                .rows
                .iter()
                .map(|r| format!("{} {} {} {}", r.name, r.unit, r.meaning, r.origin.detail()));
            format!("{} {}", table.caption, rows.collect::<Vec<_>>().join(" "))
        }
        ReportItem::Matrix(matrix) => {
            format!("{} {} {}", matrix.caption, matrix.columns.join(" "), matrix.note)
        }
        ReportItem::Terms(terms) => {
            terms.iter().map(|(term, meaning)| format!("{term} {meaning} ")).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_words_that_occur_are_explained() {
        let section = glossary_section(
            "a sensor chromaticity of the bulk",
            Some(&Analyte::new("chlorophyll_a", "chlorophyll")),
            &["waxes".into()],
        )
        .unwrap();
        let [ReportItem::Terms(terms)] = section.items.as_slice() else { panic!("{section:?}") };
        let names: Vec<&str> = terms.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["Sensor chromaticity (r, g)", "Bulk"]);
        assert!(terms[1].1.contains("waxes") && terms[1].1.contains("chlorophyll"));
        assert_eq!(glossary_section("nothing", Some(&Analyte::default()), &[]), None);
        // Nothing is looked for: no word of it, whatever the page says.
        assert_eq!(glossary_section("a bulk without porphyrin", None, &["waxes".into()]), None);
    }
}
