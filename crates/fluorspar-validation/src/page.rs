//! The page of a validation.

use std::fmt::Write;

use super::{CaseResult, Verdict};
use fluorspar_report::{close_page, escape, open_page, write_figure};

/// The page: how many cases have which verdict, a table of them, and every case with its numbers and figures. One file, nothing
/// fetched from elsewhere.
pub fn validation_page(results: &[CaseResult]) -> String {
    let mut html = String::with_capacity(1 << 20);
    open_page(&mut html, "Validation against Lyu et al. 2021");
    html.push_str("\n<header>\n<h1>Validation against Lyu et al. 2021</h1>\n");
    let _ = writeln!(html, "<p class=\"lead\">{}</p>", escape(&summary(results)));
    html.push_str(
        "<p>The paper is Z. Lyu and others, Simulations of fluorescence imaging in the oral cavity, Biomed. Opt. Express 12(7), \
         4276-4292 (2021). It is what all cases are compared with. A case is \
         <em>reproduced</em> where what the paper says comes out, <em>corrected</em> where it does not hold as printed and the \
         reason is known, <em>not public</em> where its numbers rest on data that nobody outside has, <em>skipped</em> \
         where data are missing here, and <em>failed</em> where a number lies outside its range.</p>\n</header>\n<main>\n",
    );
    write_overview(&mut html, results);
    for result in results {
        write_case(&mut html, result);
    }
    close_page(&mut html);
    html
}

/// The verdicts as a table of Markdown: name, title, verdict and reason of each case.
pub fn markdown_table(results: &[CaseResult]) -> String {
    let row = |result: &CaseResult| {
        format!("| {} | {} | {} | {} |\n", result.name, result.title, result.verdict.name(), result.reason)
    };
    let rows: String = results.iter().map(row).collect();
    format!("| case | what | verdict | why |\n|---|---|---|---|\n{rows}")
}

/// How many cases have which verdict, and how many parts were left out, in words.
pub fn summary(results: &[CaseResult]) -> String {
    let of = |verdict: Verdict| results.iter().filter(|result| result.verdict == verdict).count();
    let list: Vec<String> = Verdict::ALL
        .iter()
        .map(|&verdict| (of(verdict), verdict))
        .filter(|(count, _)| *count > 0)
        .map(|(count, verdict)| format!("{count} {}", verdict.name()))
        .collect();
    let parts = results.iter().map(|result| result.missing.len()).sum::<usize>();
    let left_out = match parts {
        0 => String::new(),
        1 => " One part was left out for want of data.".into(),
        _ => format!(" {parts} parts were left out for want of data."),
    };
    format!("{} cases: {}.{left_out}", results.len(), list.join(", "))
}

fn badge(verdict: Verdict) -> String {
    format!("<span class=\"badge {}\">{}</span>", verdict.name().replace(' ', "-"), verdict.name())
}

fn write_overview(html: &mut String, results: &[CaseResult]) {
    html.push_str(
        "<div class=\"scroll\"><table>\n<thead><tr><th scope=\"col\">Case</th><th scope=\"col\">The paper</th>\
         <th scope=\"col\">Verdict</th><th scope=\"col\">Why</th></tr></thead>\n<tbody>",
    );
    for result in results {
        let _ = writeln!(
            html,
            "<tr><th scope=\"row\"><a href=\"#{}\">{}</a></th><td>{}</td><td>{}</td><td>{}</td></tr>",
            escape(result.name),
            escape(result.name),
            escape(result.paper),
            badge(result.verdict),
            escape(&result.reason)
        );
    }
    html.push_str("</tbody>\n</table></div>\n");
}

fn write_case(html: &mut String, result: &CaseResult) {
    let _ = writeln!(
        html,
        "<section id=\"{}\">\n<h2>{}: {} {}</h2>\n<p>The paper: {}</p>\n<p>{}</p>",
        escape(result.name),
        escape(result.name),
        escape(result.title),
        badge(result.verdict),
        escape(result.paper),
        escape(&result.reason)
    );
    for missing in &result.missing {
        let _ = writeln!(html, "<p>Left out: {}.</p>", escape(missing));
    }
    for figure in &result.figures {
        write_figure(html, &figure.figure, "");
    }
    write_checks(html, result);
    html.push_str("</section>\n");
}

fn write_checks(html: &mut String, result: &CaseResult) {
    if result.checks.is_empty() {
        return;
    }
    html.push_str(
        "<div class=\"scroll\"><table>\n<thead><tr><th scope=\"col\">What</th><th scope=\"col\">The paper</th>\
         <th scope=\"col\">Computed</th><th scope=\"col\">Accepted</th><th scope=\"col\">Why this range</th><th scope=\"col\"></th>\
         </tr></thead>\n<tbody>",
    );
    for check in &result.checks {
        let _ = writeln!(
            html,
            "<tr><th scope=\"row\">{}</th><td>{}</td><td class=\"value\">{}</td><td class=\"value\">{}</td><td>{}</td><td>{}</td></tr>",
            escape(&check.what),
            escape(&check.paper),
            escape(&check.computed_text()),
            escape(&check.accepted_text()),
            escape(&check.why),
            if check.passed() { "passed" } else { "<b>failed</b>" }
        );
    }
    html.push_str("</tbody>\n</table></div>\n");
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Check;

    const EVIL: &str = "<img src=x onerror=alert(1)> \"quoted\" & 'single' </script>";

    fn result() -> CaseResult {
        let check = Check {
            what: EVIL.into(),
            paper: EVIL.into(),
            computed: 1.0,
            unit: "",
            accepted: [f64::NEG_INFINITY, 0.5],
            why: EVIL.into(),
        };
        CaseResult {
            name: "a-case",
            title: EVIL,
            paper: EVIL,
            verdict: Verdict::Failed,
            reason: EVIL.into(),
            checks: vec![check],
            missing: vec![EVIL.into()],
            figures: Vec::new(),
        }
    }

    #[test]
    fn no_text_becomes_markup_and_every_element_is_closed() {
        let html = validation_page(&[result()]);
        assert!(!html.contains("<img") && !html.contains("</script"));
        for tag in [
            "section", "table", "tbody", "thead", "tr", "td", "th", "div", "p", "h2", "header", "main",
            "span",
        ] {
            let opened =
                html.matches(&format!("<{tag}>")).count() + html.matches(&format!("<{tag} ")).count();
            assert_eq!(opened, html.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }

    #[test]
    fn verdicts_and_parts_left_out_are_counted() {
        let skipped = CaseResult { verdict: Verdict::Skipped, ..result() };
        let text = summary(&[result(), skipped]);
        assert_eq!(text, "2 cases: 1 skipped, 1 failed. 2 parts were left out for want of data.");
    }
}
