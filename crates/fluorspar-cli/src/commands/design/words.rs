//! Designs in words.

use fluorspar::design::{Criterion, DesignSpace, WorstCase};
use fluorspar_report::{JudgedDesign, best_case, cures, ideal_edges, recommendation};
use fluorspar_session::design::{ComparedDesigns, DesignOutcome, DesignScene, DesignScenes, criterion_text};

use crate::commands::table::{align, short};

/// Designs that are told in words.
const SHOWN: usize = 20;

/// The best of a search.
pub(super) fn describe(outcome: &DesignOutcome) -> String {
    let (problem, space) = (&outcome.problem, &outcome.problem.space);
    let mut text = format!(
        "{}\n\n{} designs, {} evaluated ({}), {} feasible\n",
        problem.title(),
        space.len(),
        outcome.scores.len(),
        outcome.search,
        outcome.feasible
    );
    if !outcome.left_out.is_empty() && !outcome.best.is_empty() {
        text += &format!("{}\n", outcome.left_out);
    }
    if !outcome.best.is_empty() {
        text += &format!("ranked by {}\n", criterion_text(space));
    }
    for sentence in outcome.with_findings(recommendation) {
        text += &format!("{sentence}\n");
    }
    text += &remarks(space);
    if !outcome.best.is_empty() {
        text.push('\n');
        text += &table(space, outcome.best.iter().take(SHOWN), &outcome.worst_cases);
        text += &format!("{}\n", legend(space, outcome.best.first()));
        if outcome.best.len().min(SHOWN) > outcome.worst_cases.len() {
            text += &format!(
                "Tolerances are tried for the {} best; - of the others\n",
                outcome.worst_cases.len()
            );
        }
        if outcome.best.len() > SHOWN {
            text += &format!("{} more in designs.csv\n", outcome.best.len() - SHOWN);
        }
    }
    text += match problem.resolved.names_compared {
        true => "\ncompared\n",
        false => "\ncompared with what the file names first\n",
    };
    text += &table(space, outcome.compared.iter(), &[]);
    if let (Some(best), Some(worst)) = (outcome.best.first(), outcome.worst_cases.first()) {
        let broken = match &worst.broken[..] {
            [] => String::new(),
            broken => format!(", and breaks the limit of {}", broken.join(", ")),
        };
        text += &format!(
            "\nwithin tolerances {}, the best as meant, has a loss of {} (as meant {}), a leak of {} %{broken}\n",
            best.name,
            short(worst.loss),
            short(best.merits.loss),
            short(100.0 * worst.leak)
        );
    }
    for sensitivity in outcome.sensitivities.iter().take(5) {
        text += &format!(
            "a quarter more of {}: loss {:+.1} %, a quarter less {:+.1} %{}\n",
            sensitivity.assumption,
            100.0 * sensitivity.loss_change,
            100.0 * sensitivity.loss_change_of_less,
            if sensitivity.other_best {
                "; another design is then the best, one way or the other"
            } else {
                ""
            }
        );
    }
    text
}

/// The designs that a file names, side by side.
pub(super) fn describe_compared(ComparedDesigns { problem, designs }: &ComparedDesigns) -> String {
    let space = &problem.space;
    let mut text = format!(
        "by {}\n{}\n{}{}\n",
        criterion_text(space),
        remarks(space),
        table(space, designs.iter(), &[]),
        legend(space, designs.first())
    );
    if designs.iter().all(|judged| !judged.merits.loss.is_finite()) {
        for cure in cures(space, designs.iter().map(|judged| judged.design.clone())) {
            text += &format!("{cure}\n");
        }
    }
    text
}

/// Scenes and how they are rendered.
pub(super) fn describe_scenes(DesignScenes { scenes }: &DesignScenes) -> String {
    let line = |scene: &DesignScene| {
        let state = if scene.is_rendered { "rendered" } else { "missing" };
        format!("{state}  {}  {}\n", scene.experiment.display(), scene.name)
    };
    let mut text: String = scenes.iter().map(line).collect();
    if let Some(scene) = scenes.iter().find(|scene| !scene.is_rendered) {
        let (experiment, image) = (scene.experiment.display(), scene.image.display());
        text += &format!(
            "\na part of the first that is missing: fluorspar render {experiment} --film 1.film --shard 1/2\n\
             all parts together: fluorspar merge 1.film 2.film --components --out {image}\n"
        );
    }
    text
}

/// What the numbers rest on, a line each: that nothing is unknown, and, where the leak counts, what is assumed of ideal edges.
fn remarks(space: &DesignSpace) -> String {
    let p = space.problem();
    let is_mixed = p.filters.iter().any(|filter| filter.long_pass.is_none());
    let counts = p.criterion == Criterion::Leak || p.limits.leak.is_some() || is_mixed;
    let edges = ideal_edges(p).filter(|_| counts);
    best_case(p).into_iter().chain(edges).map(|remark| remark + "\n").collect()
}

/// What the columns of [`table`] mean.
fn legend(space: &DesignSpace, first: Option<&JudgedDesign>) -> String {
    let values =
        |k: usize| first.and_then(|judged| *judged.merits.regions.first()?.contrast_values.get(k)?);
    let of_contrast = |(k, name): (usize, &str)| {
        let value = values(k).map_or_else(String::new, |value| format!(" of a value of {}", short(value)));
        format!("; {name}: its standard deviation{value}")
    };
    let names = space.problem().contrasts.iter().map(|contrast| contrast.name.as_str());
    let of_contrasts: String = names.enumerate().map(of_contrast).collect();
    let ratios = match space.problem().contrasts.is_empty() {
        true => "",
        // `predict` tells another one
        false => {
            "\nSuch a ratio is one of the light that fluorophores send from 500 to 700 nm under 405 nm, of plain surfaces one of their \
             concentrations; the ratio of amounts of `predict` is another"
        }
    };
    format!(
        "A fluorophore's column is the relative standard deviation of its weight{of_contrasts}; fluorescence e-: the sum over the channels, one pixel each, \
         reflected light left out; kept: what the viewing filter lets pass of them; leak: reflected over fluorescent electrons; tissue margin: limit \
         over exposure of the tissue{ratios}"
    )
}

/// A table for people: loss, each weight of the first region, electrons of fluorescence, time, leak, and the worst loss within tolerances of
/// those for which it is known.
fn table<'a>(
    space: &DesignSpace,
    designs: impl Iterator<Item = &'a JudgedDesign>,
    worst: &[WorstCase],
) -> String {
    let p = space.problem();
    let first = p.regions_of(0).next().map_or(&[][..], |region| &region.response.fluorescence);
    let names = first.iter().map(|f| f.name.clone());
    let head = ["design".to_owned(), "loss".into()].into_iter().chain(names);
    let contrasts = p.contrasts.iter().map(|c| c.name.clone());
    let tail = ["fluorescence e-", "kept", "ms", "leak", "tissue margin"].into_iter();
    let tail = tail.chain((!worst.is_empty()).then_some("loss within tolerances")).chain([""]);
    let mut rows: Vec<Vec<String>> = vec![head.chain(contrasts).chain(tail.map(String::from)).collect()];
    for (place, judged) in designs.enumerate() {
        let merits = &judged.merits;
        let number = |value: f64| if value.is_finite() { short(value) } else { "not seen".into() };
        let region = &merits.regions[0];
        let mut row = vec![judged.name.clone(), number(merits.loss)];
        row.extend(region.weights.iter().chain(&region.contrasts).map(|sd| number(*sd)));
        let kept = judged.fluorescence.as_ref();
        let kept = kept.map_or_else(|| "-".into(), |of| format!("{:.1} %", 100.0 * of.kept));
        let leak = format!("{} %", short(100.0 * merits.leak));
        row.extend([short(merits.fluorescence_e), kept, short(merits.time_s * 1e3), leak]);
        row.push(merits.tissue_margin.map_or_else(|| "-".into(), short));
        if !worst.is_empty() {
            row.push(worst.get(place).map_or_else(|| "-".into(), |worst| number(worst.loss)));
        }
        let singular = region.rank < region.weights.len();
        let made = worst.get(place).map_or(&[][..], |worst| &worst.broken);
        let note = match (&merits.broken[..], singular) {
            ([], false) if !made.is_empty() => format!("breaks {} within tolerances", made.join(", ")),
            ([], false) => String::new(),
            ([], true) => format!("singular: {} of {} seen", region.rank, region.weights.len()),
            (broken, _) => format!("breaks {}", broken.join(", ")),
        };
        row.push(note);
        rows.push(row);
    }
    let last = rows[0].len() - 1;
    align(&rows, &[last])
}
