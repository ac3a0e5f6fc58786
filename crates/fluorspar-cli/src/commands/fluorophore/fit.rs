//! `fluorspar fluorophore fit`.

use fluorspar::analysis::{ComponentSets, FittedWeight, MixtureFit};
use fluorspar_session::fluorophore::{FittedMixture, FittedSpectra};

use crate::commands::table::{align, short};

/// Supported sets that the text lists.
const SETS_SHOWN: usize = 5;

pub(super) fn describe(report: &FittedSpectra) -> String {
    let mut text = match &report.light {
        Some(light) => format!("{} under {light}\n", report.file),
        None => format!("{}\n", report.file),
    };
    text += &format!("spectra: {}; a weight of 1 is {}\n", report.unit, report.weight_unit);
    if let (Some(blood), Some(amount)) = (&report.blood, report.common_blood) {
        text += &format!("{blood}, common to all: {}\n", short(amount));
    }
    for fitted in &report.fitted {
        text += &format!("\n{}", describe_one(report, fitted));
    }
    text
}

fn describe_one(report: &FittedSpectra, fitted: &FittedMixture) -> String {
    let fit = &fitted.fit;
    let (first, last) = (fitted.wavelengths_nm.first(), fitted.wavelengths_nm.last());
    let (first, last) = (first.copied().unwrap_or_default(), last.copied().unwrap_or_default());
    let mut text =
        format!("{}: {} bands from {first} to {last} nm\n", fitted.name, fitted.wavelengths_nm.len());
    if let (Some(what), Some(blood)) = (&report.blood, &fit.blood) {
        let [low, high] = blood.interval.map(short);
        text += &format!("{what}: {} ({low} to {high} with 95 %)\n", short(blood.amount));
    }
    text += &residuals(fit);
    text += &weights(fit, fitted.sets.as_ref());
    if let Some(sets) = &fitted.sets {
        text += &format!("\n{}", sets_in_words(sets));
    }
    text
}

/// What is left, and how many independent bands that makes.
fn residuals(fit: &MixtureFit) -> String {
    let scatter = &fit.scatter;
    let together = match scatter.correlation.share > 0.0 {
        true => format!(
            "{:.0} % of their variance go together over {} nm; the bands count as {:.1} independent ones",
            100.0 * scatter.correlation.share,
            short(scatter.correlation.length_nm),
            scatter.effective_bands
        ),
        false => "independent of each other".into(),
    };
    let mut text = format!(
        "residuals {} rms, {:.2} % of the largest value; {together}\n",
        short(fit.rms),
        100.0 * fit.relative_rms
    );
    if let Some(found) = &fit.chi_square {
        text += &format!(
            "chi-square {} where {} are expected of the standard errors (probability {})\n",
            short(found.chi_square),
            short(found.expected),
            short(found.probability)
        );
    }
    text
}

fn weights(fit: &MixtureFit, sets: Option<&ComponentSets>) -> String {
    let mut head = vec!["component", "weight", "95 % from", "to", "of the light"];
    if sets.is_some() {
        head.extend(["in supported sets", "Akaike weight"]);
    }
    head.push("");
    let mut rows: Vec<Vec<String>> = vec![head.iter().map(|cell| (*cell).into()).collect()];
    let row = |weight: &FittedWeight| {
        let [low, high] = weight.interval.map(short);
        let share = format!("{:.1} %", 100.0 * weight.share);
        let mut row = vec![weight.name.clone(), short(weight.weight), low, high, share];
        if let Some(sets) = sets {
            let member = sets.components.iter().find(|member| member.name == weight.name);
            row.push(member.map_or_else(String::new, |member| {
                format!("{} of {}", member.supported_sets, sets.supported.len())
            }));
            row.push(member.map_or_else(String::new, |member| format!("{:.3}", member.akaike_weight)));
        }
        let state = match (weight.is_free, weight.standard_error.is_none()) {
            (_, true) => "others make it up",
            (false, false) => "at zero",
            (true, false) => "",
        };
        row.push(state.into());
        row
    };
    rows.extend(fit.weights.iter().map(row));
    align(&rows, &[head.len() - 1])
}

/// Which components the data want, and which they can't tell apart.
fn sets_in_words(sets: &ComponentSets) -> String {
    let count = sets.supported.len();
    if count == 0 {
        return "the bands are too few to compare sets of components\n".into();
    }
    let too_large = match sets.too_large {
        0 => String::new(),
        number => format!("; {number} more have too many components for so few bands"),
    };
    let mut text = format!(
        "{count} of {} sets are supported: within {} of the best, by AICc of {:.1} bands{too_large}\n",
        sets.compared, sets.within, sets.effective_bands
    );
    let mut rows = vec![["difference", "Akaike weight", "set"].map(String::from).to_vec()];
    rows.extend(sets.supported.iter().take(SETS_SHOWN).map(|set| {
        let names = if set.components.is_empty() { "nothing".into() } else { set.components.join(", ") };
        vec![format!("{:.2}", set.difference), format!("{:.3}", set.akaike_weight), names]
    }));
    text += &align(&rows, &[2]);
    let named = |wanted: usize| {
        let members = sets.components.iter().filter(|member| member.supported_sets == wanted);
        members.map(|member| member.name.as_str()).collect::<Vec<_>>().join(", ")
    };
    for (what, names) in [("in every supported set", named(count)), ("in none", named(0))] {
        if !names.is_empty() {
            text += &format!("{what}: {names}\n");
        }
    }
    let pairs: Vec<String> =
        sets.interchangeable.iter().map(|[one, other]| format!("{one} and {other}")).collect();
    if !pairs.is_empty() {
        text += &format!("can't be told apart: {}\n", pairs.join("; "));
    }
    text
}
