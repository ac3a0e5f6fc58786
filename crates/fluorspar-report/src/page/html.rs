//! The report as one HTML file: no scripts, nothing fetched from elsewhere.

use std::fmt::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::escape;
use super::experiment::embed_experiment;
use super::report_data::{Number, NumberTable, ReportData, ReportItem, ReportPicture, Section};
use crate::Figure;
use crate::figure::png_size;

const STYLE: &str = include_str!("style.css");

/// Pictures narrower than this, px, are enlarged without smoothing, so that single pixels can be seen.
const SMALL_PICTURE: u32 = 360;

impl ReportData {
    /// The report as a self-contained HTML page.
    pub fn to_html(&self) -> String {
        let mut html = String::with_capacity(1 << 20);
        open_page(&mut html, &self.title);
        html.push_str(&embed_experiment(&self.experiment_toml));
        let _ = writeln!(html, "\n<header>\n<h1>{}</h1>", escape(&self.title));
        for paragraph in &self.lead {
            let _ = writeln!(html, "<p class=\"lead\">{}</p>", escape(paragraph));
        }
        html.push_str("</header>\n<main>\n");
        self.write_warnings(&mut html);
        self.write_headline(&mut html);
        self.write_contents(&mut html);
        for (index, section) in self.sections.iter().enumerate() {
            write_section(&mut html, index, section);
        }
        self.write_experiment(&mut html);
        close_page(&mut html);
        html
    }

    fn write_warnings(&self, html: &mut String) {
        if self.warnings.is_empty() {
            return;
        }
        html.push_str("<section class=\"warnings\" aria-label=\"Warnings\">\n<h2>Before you trust these numbers</h2>\n<ul>\n");
        for warning in &self.warnings {
            let _ = writeln!(html, "<li>{}</li>", escape(warning));
        }
        html.push_str("</ul>\n</section>\n");
    }

    fn write_headline(&self, html: &mut String) {
        if self.headline.is_empty() {
            return;
        }
        html.push_str("<dl class=\"headline\">\n");
        for number in &self.headline {
            let _ = writeln!(
                html,
                "<div><dt>{}</dt><dd><span class=\"value\">{}</span> {}</dd><dd class=\"meaning\">{}</dd></div>",
                escape(&number.name),
                escape(&number.value),
                escape(&number.unit),
                escape(&number.meaning)
            );
        }
        html.push_str("</dl>\n");
    }

    fn write_contents(&self, html: &mut String) {
        if self.sections.len() < 3 {
            return;
        }
        html.push_str("<nav aria-label=\"Contents\">\n<ul>\n");
        for (index, section) in self.sections.iter().enumerate() {
            let _ = writeln!(html, "<li><a href=\"#section-{index}\">{}</a></li>", escape(&section.title));
        }
        html.push_str("<li><a href=\"#experiment\">Run it again</a></li>\n</ul>\n</nav>\n");
    }

    fn write_experiment(&self, html: &mut String) {
        html.push_str("<section id=\"experiment\">\n<h2>Run it again</h2>\n");
        if !self.rerun_command.is_empty() {
            let _ = writeln!(
                html,
                "<p>This page contains the whole experiment. Saved as a file, it can be run again:</p>\n\
                 <pre class=\"command\">{}</pre>",
                escape(&self.rerun_command)
            );
        }
        if !self.provenance.is_empty() {
            html.push_str("<table class=\"provenance\">\n<tbody>\n");
            for (name, value) in &self.provenance {
                let (name, value) = (escape(name), escape(value));
                let _ = writeln!(html, "<tr><th scope=\"row\">{name}</th><td>{value}</td></tr>");
            }
            html.push_str("</tbody>\n</table>\n");
        }
        let _ = writeln!(
            html,
            "<details>\n<summary>The experiment, with every setting resolved (TOML)</summary>\n<pre>{}</pre>\n</details>\n\
             </section>",
            escape(&self.experiment_toml)
        );
    }
}

/// Begins a page: everything up to its body.
pub(crate) fn open_page(html: &mut String, title: &str) {
    let _ = write!(
        html,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"generator\" content=\"Fluorspar {}\">\n<title>{}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n",
        env!("CARGO_PKG_VERSION"),
        escape(title)
    );
}

/// Ends the main part and the page.
pub(crate) fn close_page(html: &mut String) {
    html.push_str("</main>\n</body>\n</html>\n");
}

fn write_section(html: &mut String, index: usize, section: &Section) {
    let _ = writeln!(html, "<section id=\"section-{index}\">\n<h2>{}</h2>", escape(&section.title));
    for item in &section.items {
        match item {
            ReportItem::Paragraph(text) => {
                let _ = writeln!(html, "<p>{}</p>", escape(text));
            }
            ReportItem::Pictures(pictures) => {
                html.push_str("<div class=\"pictures\">\n");
                for picture in pictures {
                    write_picture(html, picture);
                }
                html.push_str("</div>\n");
            }
            ReportItem::Figure { figure, caption } => write_figure(html, figure, caption),
            ReportItem::Table(table) => write_table(html, table),
            ReportItem::Terms(terms) => {
                html.push_str("<dl class=\"terms\">\n");
                for (term, meaning) in terms {
                    let _ = writeln!(html, "<dt>{}</dt><dd>{}</dd>", escape(term), escape(meaning));
                }
                html.push_str("</dl>\n");
            }
        }
    }
    html.push_str("</section>\n");
}

fn write_picture(html: &mut String, picture: &ReportPicture) {
    let size = png_size(&picture.png);
    let attributes = size.map(|[w, h]| format!(" width=\"{w}\" height=\"{h}\"")).unwrap_or_default();
    let class = if size.is_some_and(|[w, _]| w < SMALL_PICTURE) { " class=\"small\"" } else { "" };
    let _ = writeln!(
        html,
        "<figure><img{class}{attributes} alt=\"{}\" src=\"data:image/png;base64,{}\">\n\
         <figcaption><b>{}</b> {}</figcaption></figure>",
        escape(&picture.title),
        STANDARD.encode(&picture.png),
        escape(&picture.title),
        escape(&picture.caption)
    );
}

/// Writes a figure with its explanation and more text.
pub(crate) fn write_figure(html: &mut String, figure: &Figure, caption: &str) {
    let _ = writeln!(
        html,
        "<figure class=\"plot\">\n{}<figcaption>{}",
        figure.to_svg(),
        escape(&figure.explanation)
    );
    if !caption.is_empty() {
        let _ = write!(html, " <span class=\"here\">{}</span>", escape(caption));
    }
    html.push_str("</figcaption>\n</figure>\n");
}

fn write_table(html: &mut String, table: &NumberTable) {
    let _ = writeln!(
        html,
        "<div class=\"scroll\"><table>\n<caption>{}</caption>\n<thead><tr><th scope=\"col\">Number</th>\
         <th scope=\"col\">Value</th><th scope=\"col\">Unit</th><th scope=\"col\">What it means</th>\
         <th scope=\"col\">Where from</th></tr></thead>\n<tbody>",
        escape(&table.caption)
    );
    for row in &table.rows {
        write_number(html, row);
    }
    html.push_str("</tbody>\n</table></div>\n");
}

fn write_number(html: &mut String, number: &Number) {
    let word = number.origin.word();
    let _ = writeln!(
        html,
        "<tr><th scope=\"row\">{}</th><td class=\"value\">{}</td><td>{}</td><td>{}</td>\
         <td><span class=\"badge {word}\">{word}</span> {}</td></tr>",
        escape(&number.name),
        escape(&number.value),
        // An empty cell would look forgotten.
        if number.unit.is_empty() { "pure number".into() } else { escape(&number.unit) },
        escape(&number.meaning),
        escape(number.origin.detail())
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Axis, Ink, Origin, Panel, Series, extract_experiment};

    fn hostile() -> ReportData {
        let evil = "<img src=x onerror=alert(1)> \"quoted\" & 'single' </script>";
        let panel = Panel::new(Axis::linear(evil, evil, [0.0, 1.0]), Axis::linear(evil, "", [0.0, 1.0]))
            .titled(evil)
            .with(Series::line(evil, Ink::Text, vec![[0.0, 0.0], [1.0, 1.0]]));
        let number = Number::computed(evil, evil, evil, evil).from(Origin::Assumed(evil.into()));
        let picture = ReportPicture { png: vec![1, 2, 3], title: evil.into(), caption: evil.into() };
        ReportData {
            title: evil.into(),
            lead: vec![evil.into()],
            headline: vec![number.clone()],
            warnings: vec![evil.into()],
            sections: vec![
                Section::new(evil)
                    .say(evil)
                    .show(Figure::new(evil, panel).explained(evil), evil)
                    .with(ReportItem::Pictures(vec![picture]))
                    .with(ReportItem::Table(NumberTable { caption: evil.into(), rows: vec![number] }))
                    .with(ReportItem::Terms(vec![(evil.into(), evil.into())])),
            ],
            provenance: vec![(evil.into(), evil.into())],
            experiment_toml: evil.into(),
            rerun_command: evil.into(),
        }
    }

    #[test]
    fn no_text_becomes_markup() {
        let report = hostile();
        let html = report.to_html();
        assert!(!html.contains("<img src=x") && !html.contains("onerror=alert(1)>"));
        assert_eq!(html.matches("<script").count(), 1);
        assert_eq!(html.matches("</script").count(), 1);
        assert_eq!(extract_experiment(&html).as_deref(), Some(report.experiment_toml.as_str()));
    }

    #[test]
    fn nothing_is_fetched_from_elsewhere() {
        let html = hostile().to_html();
        for attribute in ["src=\"", "href=\""] {
            for (at, _) in html.match_indices(attribute) {
                let target = &html[at + attribute.len()..];
                assert!(target.starts_with("data:") || target.starts_with('#'), "{}", &target[..40]);
            }
        }
        assert!(!html.contains("url(") && !html.contains("@import"));
    }

    #[test]
    fn every_element_is_closed() {
        let html = hostile().to_html();
        for tag in
            ["section", "figure", "figcaption", "table", "tbody", "dl", "div", "ul", "svg", "details", "main"]
        {
            let opened =
                html.matches(&format!("<{tag}>")).count() + html.matches(&format!("<{tag} ")).count();
            assert_eq!(opened, html.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }
}
