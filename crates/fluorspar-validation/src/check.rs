//! What a case found: checks with their tolerances, and a verdict.

use serde_json::{Value, json};

use fluorspar_report::NamedFigure;

/// How a figure or table of the paper stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Verdict {
    /// What the paper says comes out.
    Reproduced,
    /// What the paper says does not hold as printed; the reason is known, and the corrected statement comes out.
    Corrected,
    /// The numbers of the paper rest on data that are not public; what can be said without them comes out.
    NotPublic,
    /// Data that the case needs are not there.
    Skipped,
    /// A check failed.
    Failed,
}

impl Verdict {
    /// All verdicts, from the best to the worst.
    pub const ALL: [Self; 5] =
        [Self::Reproduced, Self::Corrected, Self::NotPublic, Self::Skipped, Self::Failed];

    /// The verdict in JSON.
    pub fn key(self) -> &'static str {
        match self {
            Self::NotPublic => "not_public",
            other => other.name(),
        }
    }

    /// The verdict in words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Reproduced => "reproduced",
            Self::Corrected => "corrected",
            Self::NotPublic => "not public",
            Self::Skipped => "skipped",
            Self::Failed => "failed",
        }
    }
}

/// One number of a case with the range in which it must lie.
#[derive(Clone, Debug, PartialEq)]
pub struct Check {
    /// What is compared.
    pub what: String,
    /// What the paper or another source says of it; empty where it says nothing.
    pub paper: String,
    /// The number that came out.
    pub computed: f64,
    /// Its unit; empty for a pure number.
    pub unit: &'static str,
    /// Smallest and largest number that pass; infinite where there is no limit.
    pub accepted: [f64; 2],
    /// Where the range comes from.
    pub why: String,
}

impl Check {
    /// A number within a tolerance of the printed one.
    pub(super) fn near(
        what: impl Into<String>,
        printed: f64,
        tolerance: f64,
        computed: f64,
        unit: &'static str,
        why: impl Into<String>,
    ) -> Self {
        let paper = format!("{} {unit}", number(printed)).trim_end().to_owned();
        let accepted = [printed - tolerance, printed + tolerance];
        Self { what: what.into(), paper, computed, unit, accepted, why: why.into() }
    }

    /// A number within a range.
    pub(super) fn within(
        what: impl Into<String>,
        accepted: [f64; 2],
        computed: f64,
        unit: &'static str,
        why: impl Into<String>,
    ) -> Self {
        Self { what: what.into(), paper: String::new(), computed, unit, accepted, why: why.into() }
    }

    /// A number of at most so much.
    pub(super) fn at_most(
        what: impl Into<String>,
        most: f64,
        computed: f64,
        unit: &'static str,
        why: impl Into<String>,
    ) -> Self {
        Self::within(what, [f64::NEG_INFINITY, most], computed, unit, why)
    }

    /// A number of at least so much.
    pub(super) fn at_least(
        what: impl Into<String>,
        least: f64,
        computed: f64,
        unit: &'static str,
        why: impl Into<String>,
    ) -> Self {
        Self::within(what, [least, f64::INFINITY], computed, unit, why)
    }

    /// The check with what the paper says in its words.
    pub(super) fn said(mut self, paper: impl Into<String>) -> Self {
        self.paper = paper.into();
        self
    }

    /// Whether the number lies in its range. What is no number does not.
    pub fn passed(&self) -> bool {
        self.computed >= self.accepted[0] && self.computed <= self.accepted[1]
    }

    /// The number with its unit.
    pub fn computed_text(&self) -> String {
        format!("{} {}", number(self.computed), self.unit).trim_end().to_owned()
    }

    /// The range in words.
    pub fn accepted_text(&self) -> String {
        let text = match self.accepted {
            [low, high] if low.is_finite() && high.is_finite() => {
                format!("{} to {}", number(low), number(high))
            }
            [low, _] if low.is_finite() => format!("at least {}", number(low)),
            [_, high] => format!("at most {}", number(high)),
        };
        format!("{text} {}", self.unit).trim_end().to_owned()
    }

    fn to_json(&self) -> Value {
        json!({
            "what": self.what,
            "paper": self.paper,
            "computed": self.computed,
            "unit": self.unit,
            // JSON knows no infinity: a missing limit is null.
            "accepted": self.accepted,
            "why": self.why,
            "passed": self.passed(),
        })
    }
}

/// A number with at most four digits that mean something.
pub(super) fn number(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 {
        return "0".into();
    }
    if !(1e-3..1e5).contains(&size) {
        return format!("{value:.2e}");
    }
    let digits = (3.0 - size.log10().floor()).clamp(0.0, 6.0) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// What one case found before it is judged.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Outcome {
    /// The verdict if every check passes.
    pub(super) verdict: Verdict,
    /// Why this verdict, with the numbers that it rests on.
    pub(super) reason: String,
    pub(super) checks: Vec<Check>,
    /// Parts that were left out, each with what is missing.
    pub(super) missing: Vec<String>,
    pub(super) figures: Vec<NamedFigure>,
}

impl Outcome {
    pub(super) fn new(verdict: Verdict, reason: impl Into<String>) -> Self {
        let (checks, missing, figures) = (Vec::new(), Vec::new(), Vec::new());
        Self { verdict, reason: reason.into(), checks, missing, figures }
    }

    pub(super) fn check(mut self, check: Check) -> Self {
        self.checks.push(check);
        self
    }

    pub(super) fn checks(mut self, checks: impl IntoIterator<Item = Check>) -> Self {
        self.checks.extend(checks);
        self
    }

    pub(super) fn show(mut self, stem: &str, figure: fluorspar_report::Figure) -> Self {
        self.figures.push(NamedFigure { stem: stem.into(), figure });
        self
    }

    pub(super) fn lacks(mut self, what: impl Into<String>) -> Self {
        self.missing.push(what.into());
        self
    }
}

/// A case with everything that it found.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseResult {
    /// Name, as `--case` takes it.
    pub name: &'static str,
    /// Title.
    pub title: &'static str,
    /// What the paper says.
    pub paper: &'static str,
    /// The verdict.
    pub verdict: Verdict,
    /// Why.
    pub reason: String,
    /// The numbers.
    pub checks: Vec<Check>,
    /// Parts that were left out, each with what is missing.
    pub missing: Vec<String>,
    /// Figures, in order.
    pub figures: Vec<NamedFigure>,
}

impl CaseResult {
    /// Judges what a case found: one check out of its range fails it.
    pub(super) fn judge(case: &super::Case, found: Outcome) -> Self {
        let failed: Vec<&Check> = found.checks.iter().filter(|check| !check.passed()).collect();
        let (verdict, reason) = match failed.first() {
            None => (found.verdict, found.reason),
            Some(first) => (
                Verdict::Failed,
                format!(
                    "{} of {} checks failed; {}: {} instead of {}",
                    failed.len(),
                    found.checks.len(),
                    first.what,
                    first.computed_text(),
                    first.accepted_text()
                ),
            ),
        };
        Self {
            name: case.name,
            title: case.title,
            paper: case.paper,
            verdict,
            reason,
            checks: found.checks,
            missing: found.missing,
            figures: found.figures,
        }
    }

    /// Everything but the figures, of which only the names are listed.
    pub fn to_json(&self) -> Value {
        json!({
            "name": self.name,
            "title": self.title,
            "paper": self.paper,
            "verdict": self.verdict.key(),
            "reason": self.reason,
            "checks": self.checks.iter().map(Check::to_json).collect::<Vec<_>>(),
            "missing": self.missing,
            "figures": self.figures.iter().map(|figure| &figure.stem).collect::<Vec<_>>(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cases;

    #[test]
    fn one_number_out_of_range_fails_a_case() {
        let good = Check::near("a", 2.0, 0.1, 2.05, "mm", "rounding");
        let bad = Check::at_most("b", 1.0, f64::NAN, "", "none");
        assert!(good.passed() && !bad.passed());
        let found = Outcome::new(Verdict::Reproduced, "fine").check(good.clone());
        assert_eq!(CaseResult::judge(&cases()[0], found.clone()).verdict, Verdict::Reproduced);
        let judged = CaseResult::judge(&cases()[0], found.check(bad));
        assert_eq!(judged.verdict, Verdict::Failed);
        assert_eq!(judged.reason, "1 of 2 checks failed; b: NaN instead of at most 1");
        assert_eq!(good.accepted_text(), "1.9 to 2.1 mm");
    }

    #[test]
    fn numbers_keep_four_digits() {
        let shown = [0.0, 0.10122, 9000.0, 13.734, 1.5e-6, -0.5, 123456.0].map(number);
        assert_eq!(shown, ["0", "0.1012", "9000", "13.73", "1.50e-6", "-0.5", "1.23e5"]);
    }
}
