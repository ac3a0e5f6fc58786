//! What the numbers of a design search rest on, and what would help where no design does what is asked for.

use std::collections::{BTreeMap, BTreeSet};

use fluorspar::design::{Criterion, Design, DesignProblem, DesignSpace, FilterChoice, LongPass};
use fluorspar::spectral::Curve;

/// Name of the fluorophores of a region that are taken as one.
const BULK: &str = "bulk";

/// Says that standard deviations are best cases where nothing but the weights is unknown; `None` where something is.
pub fn best_case(problem: &DesignProblem) -> Option<String> {
    let (assumed, library) = (&problem.assumptions, &problem.library);
    let spreads = [assumed.gain, assumed.drive, assumed.leak];
    let of_spectra = [library.emission_shift_nm, library.excitation_shift_nm, library.shape];
    let varies = (0..problem.geometry_count())
        .any(|geometry| problem.regions_of(geometry).any(|region| !region.changes.is_empty()));
    let is_known = !varies && spreads.iter().chain(&of_spectra).all(|spread| *spread == 0.0);
    is_known.then(|| {
        "Nothing but the weights is unknown (all of [unknown] is 0): standard deviations are best cases, and grow with what [unknown] \
         lets vary of gain, drives, leak, tissue and spectra."
            .into()
    })
}

/// Says what is assumed of long-pass edges that are given by their wavelength; `None` where there are none.
pub fn ideal_edges(problem: &DesignProblem) -> Option<String> {
    let density = |long_pass: &LongPass| long_pass.optical_density;
    let mut densities: Vec<f64> =
        problem.filters.iter().filter_map(|filter| filter.long_pass.as_ref().map(density)).collect();
    densities.sort_by(f64::total_cmp);
    densities.dedup();
    if densities.is_empty() {
        return None;
    }
    let floors: Vec<String> =
        densities.iter().map(|density| format!("{:.0e}", 10f64.powf(-density))).collect();
    let densities: Vec<String> = densities.iter().map(f64::to_string).collect();
    // Without a filter nothing is lost
    let loses = |filter: &&FilterChoice| filter.long_pass.is_none() && highest(&filter.fixed) < 1.0;
    let mixed = match problem.filters.iter().find(loses) {
        Some(filter) => format!(
            " Filters with a curve of their own lose some of it ({} passes {:.0} % at most), which counts against them.",
            filter.name,
            100.0 * highest(&filter.fixed)
        ),
        None => String::new(),
    };
    Some(format!(
        "Long-pass edges given in nm are ideal: beyond the edge they pass everything, below it {} (assumed, optical_density = {}). Where the \
         light ends before the edge, the leak and ranks by it follow from that number.{mixed}",
        floors.join(" or "),
        densities.join(" or ")
    ))
}

fn highest(curve: &Curve) -> f64 {
    curve.values().iter().copied().fold(0.0, f64::max)
}

/// What would help where none of some designs does what is asked for, a sentence each: limits to relax, fluorophores to take together.
pub fn cures(space: &DesignSpace, designs: impl IntoIterator<Item = Design>) -> Vec<String> {
    let mut limits: BTreeSet<String> = BTreeSet::new();
    // Most combinations of the weights of each region that any design sees
    let mut ranks: BTreeMap<usize, usize> = BTreeMap::new();
    for design in designs {
        let merits = space.evaluate(&design);
        let field = |limit: &str| format!("limit.{}", if limit == "time" { "total_ms" } else { limit });
        limits.extend(merits.broken.iter().map(|limit| field(limit)));
        if merits.broken.is_empty() && !merits.loss.is_finite() {
            for (number, region) in merits.regions.iter().enumerate() {
                let most = ranks.entry(number).or_default();
                *most = (*most).max(region.rank);
            }
        }
    }
    let mut found = Vec::new();
    if !limits.is_empty() {
        found.push(format!("Relax {}.", limits.into_iter().collect::<Vec<_>>().join(", ")));
    }
    if !ranks.is_empty() {
        let singular =
            ranks.into_iter().find_map(|(region, rank)| take_together(space.problem(), region, rank));
        found.push(singular.unwrap_or_else(|| "Offer more lights or channels.".into()));
    }
    found
}

/// Proposes to take fluorophores of a region together, of which designs see fewer combinations than it has; `None` where that would not help.
fn take_together(problem: &DesignProblem, number: usize, rank: usize) -> Option<String> {
    let region = &problem.regions_of(0).nth(number)?.response;
    let names: Vec<&str> = region.fluorescence.iter().map(|part| part.name.as_str()).collect();
    if rank >= names.len() || names.contains(&BULK) {
        return None;
    }
    let asked: Vec<&str> = asked_for(problem, &names);
    let told = format!(
        "No design tells more than {rank} of the {} fluorophores of {} apart",
        names.len(),
        region.name
    );
    if asked.is_empty() || asked.len() >= rank {
        return Some(format!(
            "{told}: offer more lights or channels, or say what is known of their weights before (unknown.weights)."
        ));
    }
    let list = asked.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
    let field = match number < problem.regions.len() {
        true => format!("apart = [{list}]"),
        false => format!("rendered = {{ apart = [{list}] }}"),
    };
    Some(format!(
        "{told}: give {field} in its [[region]], which takes all others as one, or offer more lights or channels."
    ))
}

/// The fluorophores of a region that contrasts ask for: those of the one that ranks, or of all of them.
fn asked_for<'a>(problem: &DesignProblem, names: &[&'a str]) -> Vec<&'a str> {
    let ranking = match problem.criterion {
        Criterion::Contrast(number) => Some(number),
        _ => None,
    };
    let counted =
        problem.contrasts.iter().enumerate().filter(|(k, _)| ranking.is_none_or(|number| number == *k));
    let is_asked = |name: &str| {
        counted.clone().any(|(_, contrast)| {
            let holds = |list: &[String]| list.iter().any(|other| other == name);
            // A denominator of all fluorophores is the same with the others taken together
            let is_of_all = names.iter().all(|name| contrast.whole.iter().any(|other| other == name));
            holds(&contrast.part) || (!is_of_all && holds(&contrast.whole))
        })
    };
    names.iter().copied().filter(|name| is_asked(name)).collect()
}
