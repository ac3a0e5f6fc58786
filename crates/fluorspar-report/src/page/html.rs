//! The report as one HTML file: no script but that of its live figure, nothing fetched from elsewhere.

use std::fmt::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::escape;
use super::experiment::embed_experiment;
use super::live_figure::{page_policy, write_live_figure};
use super::overview_html::write_numbers;
use super::report_data::{
    Number, NumberMatrix, NumberTable, Origin, ReportData, ReportItem, ReportPicture, Section,
};
use crate::Figure;
use crate::figure::png_size;

const STYLE: &str = include_str!("style.css");

/// Pictures narrower than this, px, are enlarged without smoothing, so that single pixels can be seen.
const SMALL_PICTURE: u32 = 360;
/// Longer warnings, in bytes, fold below their summary, where they have one.
const LONGEST_WARNING: usize = 220;
/// Width of a figure on a telephone, px: a screen of 390 less the margins of page and figure.
const NARROW_FIGURE: f64 = 304.0;

impl ReportData {
    /// The report as a self-contained HTML page. Links lead to the files beside it; nothing is loaded from them.
    pub fn to_html(&self) -> String {
        let mut html = String::with_capacity(1 << 20);
        open_page(&mut html, &self.title);
        if !self.experiment_toml.is_empty() {
            html.push_str(&embed_experiment(&self.experiment_toml));
        }
        let _ = writeln!(html, "\n<header>\n<h1>{}</h1>", escape(&self.title));
        for paragraph in &self.lead {
            let _ = writeln!(html, "<p class=\"lead\">{}</p>", escape(paragraph));
        }
        html.push_str("</header>\n<main>\n");
        if let Some(overview) = &self.overview {
            overview.write(&mut html);
        }
        if let Some(live) = &self.live {
            let analyzed = self.overview.as_ref().and_then(|overview| overview.views.first());
            write_live_figure(&mut html, live, analyzed.map(|view| view.name.as_str()));
        }
        write_numbers(&mut html, "headline", &self.headline);
        self.write_warnings(&mut html);
        self.write_contents(&mut html);
        let mut figures = 0;
        for section in &self.sections {
            write_section(&mut html, section, &mut figures);
        }
        if !self.experiment_toml.is_empty() {
            self.write_experiment(&mut html);
        }
        close_page(&mut html);
        html
    }

    fn write_warnings(&self, html: &mut String) {
        if self.warnings.is_empty() {
            return;
        }
        html.push_str("<section class=\"warnings\" aria-label=\"Warnings\">\n<h2>Before you trust these numbers</h2>\n<ul>\n");
        for warning in &self.warnings {
            let text = escape(warning.text());
            let _ = if warning.has_details() && warning.text().len() > LONGEST_WARNING {
                let summary = escape(warning.summary());
                writeln!(html, "<li><details><summary>{summary}</summary>{text}</details></li>")
            } else {
                writeln!(html, "<li>{text}</li>")
            };
        }
        html.push_str("</ul>\n</section>\n");
    }

    fn write_contents(&self, html: &mut String) {
        // Folded sections are their own contents.
        if self.sections.len() < 3 || self.sections.iter().any(|section| !section.note.is_empty()) {
            return;
        }
        html.push_str("<nav aria-label=\"Contents\">\n<ul>\n");
        for section in &self.sections {
            let (anchor, title) = (anchor(&section.title), escape(&section.title));
            let _ = writeln!(html, "<li><a href=\"#{anchor}\">{title}</a></li>");
        }
        if !self.experiment_toml.is_empty() {
            let _ = writeln!(html, "<li><a href=\"#experiment\">{}</a></li>", self.experiment_heading());
        }
        html.push_str("</ul>\n</nav>\n");
    }

    /// Recorded frames can't be run again: their experiment says what was assumed of them.
    fn experiment_heading(&self) -> &'static str {
        if self.rerun_command.is_empty() { "The experiment" } else { "Run it again" }
    }

    fn write_experiment(&self, html: &mut String) {
        let folded = self.sections.iter().any(|section| !section.note.is_empty());
        let heading = self.experiment_heading();
        if folded {
            let _ = writeln!(
                html,
                "<section id=\"experiment\">\n<details class=\"fold\">\n<summary><h2>{heading}</h2> <span class=\"note\">the {}experiment, \
                 its seed and its digest</span></summary>",
                if self.input_files.is_empty() { "whole " } else { "" }
            );
        } else {
            let _ = writeln!(html, "<section id=\"experiment\">\n<h2>{heading}</h2>");
        }
        if self.rerun_command.is_empty() {
            html.push_str(
                "<p>This experiment says what was assumed of lights, filters, camera and tissue. What the frames state themselves counts \
                 before it: size, order of colors, black level, gain, exposure. It renders a scene of its own, not what was recorded.</p>\n",
            );
        } else {
            let _ = writeln!(
                html,
                "<p>{} Saved as a file, it can be run again:</p>\n<pre class=\"command\">{}</pre>",
                match self.input_files.is_empty() {
                    true => "This page contains the whole experiment.",
                    false =>
                        "This page contains the experiment, but not the files that it reads, which are listed below.",
                },
                escape(&self.rerun_command)
            );
        }
        if !self.input_files.is_empty() {
            html.push_str("<p>Files that it needs besides, at these places:</p>\n<ul class=\"files\">\n");
            for file in &self.input_files {
                let _ = writeln!(html, "<li><code>{}</code></li>", escape(file));
            }
            html.push_str("</ul>\n");
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
             {}</section>",
            escape(&self.experiment_toml),
            if folded { "</details>\n" } else { "" }
        );
    }
}

/// Begins a page: everything up to its body.
pub fn open_page(html: &mut String, title: &str) {
    let _ = write!(
        html,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{}\">\n<meta name=\"generator\" content=\"Fluorspar {}\">\n<title>{}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n",
        page_policy(),
        env!("CARGO_PKG_VERSION"),
        escape(title)
    );
}

/// Ends the main part and the page.
pub fn close_page(html: &mut String) {
    html.push_str("</main>\n</body>\n</html>\n");
}

/// The name of a place on the page: the title in small letters with hyphens.
fn anchor(title: &str) -> String {
    let letters =
        title.chars().map(|letter| if letter.is_alphanumeric() { letter.to_ascii_lowercase() } else { '-' });
    let words: String = letters.collect();
    words.split('-').filter(|word| !word.is_empty()).collect::<Vec<_>>().join("-")
}

fn write_section(html: &mut String, section: &Section, figures: &mut usize) {
    let (anchor, title) = (anchor(&section.title), escape(&section.title));
    let _ = writeln!(html, "<section id=\"{anchor}\">");
    let folded = !section.note.is_empty();
    let _ = if folded {
        writeln!(
            html,
            "<details class=\"fold\">\n<summary><h2>{title}</h2> <span class=\"note\">{}</span></summary>",
            escape(&section.note)
        )
    } else {
        writeln!(html, "<h2>{title}</h2>")
    };
    html.push_str(&section.to_html(figures));
    html.push_str(if folded { "</details>\n</section>\n" } else { "</section>\n" });
}

impl Section {
    /// What is below its heading, as part of a page of one's own. Figures are numbered from `figures` on, which counts them.
    pub fn to_html(&self, figures: &mut usize) -> String {
        let mut html = String::new();
        for item in &self.items {
            write_item(&mut html, item, figures);
        }
        html
    }
}

impl ReportData {
    /// The report without links to the files of its figures.
    #[must_use]
    pub fn alone(mut self) -> Self {
        for item in self.sections.iter_mut().flat_map(|section| &mut section.items) {
            if let ReportItem::Figure { stem, .. } = item {
                stem.clear();
            }
        }
        for view in self.overview.iter_mut().flat_map(|overview| &mut overview.views) {
            view.links.clear();
        }
        self
    }
}

fn write_item(html: &mut String, item: &ReportItem, figures: &mut usize) {
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
        ReportItem::Figure { figure, caption, stem } => {
            *figures += 1;
            write_numbered_figure(html, *figures, figure, caption, stem);
        }
        ReportItem::Table(table) => write_table(html, table),
        ReportItem::Matrix(matrix) => write_matrix(html, matrix),
        ReportItem::Terms(terms) => {
            html.push_str("<dl class=\"terms\">\n");
            for (term, meaning) in terms {
                let _ = writeln!(html, "<dt>{}</dt><dd>{}</dd>", escape(term), escape(meaning));
            }
            html.push_str("</dl>\n");
        }
    }
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
pub fn write_figure(html: &mut String, figure: &Figure, caption: &str) {
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

/// Writes a figure with its number, its title, its explanation and links to its files; once for wide and once for narrow screens.
fn write_numbered_figure(html: &mut String, number: usize, figure: &Figure, caption: &str, stem: &str) {
    let _ = writeln!(
        html,
        "<figure class=\"plot\" id=\"figure-{number}\">\n<div class=\"wide\">\n{}</div>\n<div class=\"narrow\">\n{}</div>\n\
         <figcaption><b>Figure {number}. {}.</b> {}",
        figure.to_page_svg(),
        figure.narrow(NARROW_FIGURE).to_page_svg(),
        escape(&figure.title),
        escape(&figure.explanation)
    );
    if !caption.is_empty() {
        let _ = write!(html, " <span class=\"here\">{}</span>", escape(caption));
    }
    if !stem.is_empty() {
        html.push_str(" <span class=\"files\">Files:");
        let csv = figure.to_csv().map(|_| "csv");
        for ending in ["svg", "png"].into_iter().chain(csv) {
            let name = ending.to_uppercase();
            let _ = write!(html, " <a href=\"figures/{}.{ending}\">{name}</a>", escape(stem));
        }
        html.push_str("</span>");
    }
    html.push_str("</figcaption>\n</figure>\n");
}

fn write_table(html: &mut String, table: &NumberTable) {
    let _ = writeln!(
        html,
        "<div class=\"scroll\"><table class=\"numbers\">\n<caption>{}</caption>\n<thead><tr><th scope=\"col\">Number</th>\
         <th scope=\"col\">Value</th><th scope=\"col\">What it means</th></tr></thead>\n<tbody>",
        escape(&table.caption)
    );
    for row in &table.rows {
        write_number(html, row);
    }
    html.push_str("</tbody>\n</table></div>\n");
}

/// What is not marked was computed by this run.
fn write_number(html: &mut String, number: &Number) {
    let badge = match &number.origin {
        Origin::Computed => String::new(),
        other => {
            let (word, detail) = (other.word(), escape(other.detail()));
            format!(" <span class=\"badge {word}\">{word}</span> {detail}")
        }
    };
    let _ = writeln!(
        html,
        "<tr><th scope=\"row\">{}</th><td class=\"value\">{} {}</td><td>{}{badge}</td></tr>",
        escape(&number.name),
        escape(&number.value),
        escape(&number.unit),
        escape(&number.meaning),
    );
}

fn write_matrix(html: &mut String, matrix: &NumberMatrix) {
    let _ = write!(
        html,
        "<div class=\"scroll\"><table class=\"matrix\">\n<caption>{}</caption>\n<thead><tr>",
        escape(&matrix.caption)
    );
    for column in &matrix.columns {
        let _ = write!(html, "<th scope=\"col\">{}</th>", escape(column));
    }
    html.push_str("</tr></thead>\n<tbody>\n");
    for row in &matrix.rows {
        html.push_str("<tr>");
        for (number, cell) in row.iter().enumerate() {
            let _ = match number {
                0 => write!(html, "<th scope=\"row\">{}</th>", escape(cell)),
                _ => write!(html, "<td class=\"value\">{}</td>", escape(cell)),
            };
        }
        html.push_str("</tr>\n");
    }
    html.push_str("</tbody>\n</table></div>\n");
    if !matrix.note.is_empty() {
        let _ = writeln!(html, "<p class=\"small-note\">{}</p>", escape(&matrix.note));
    }
}

#[cfg(test)]
mod tests {
    use fluorspar_experiment::Warning;

    use fluorspar::pipeline::{ColorRendering, LiveCapture, LivePlane, LiveView};

    use super::*;
    use crate::{
        Answer, Axis, Contribution, Contributions, FrameView, Ink, MapOverlay, NumberMatrix, Origin,
        Overview, Panel, Series, extract_experiment,
    };

    fn hostile() -> ReportData {
        let evil = "<img src=x onerror=alert(1)> \"quoted\" & 'single' </script>";
        let panel = Panel::new(Axis::linear(evil, evil, [0.0, 1.0]), Axis::linear(evil, "", [0.0, 1.0]))
            .titled(evil)
            .with(Series::line(evil, Ink::Text, vec![[0.0, 0.0], [1.0, 1.0]]));
        let number = Number::computed(evil, evil, evil, evil).from(Origin::Assumed(evil.into()));
        let picture = ReportPicture { png: vec![1, 2, 3], title: evil.into(), caption: evil.into() };
        let view = FrameView {
            name: evil.into(),
            png: vec![1],
            size: [4, 3],
            caption: evil.into(),
            alt: evil.into(),
            outline: vec![vec![[0.0, 0.0], [1.0, 1.0]]],
            names: vec![(evil.into(), [1.0, 1.0])],
            map: Some(MapOverlay {
                name: evil.into(),
                label: evil.into(),
                caption: evil.into(),
                ..MapOverlay::default()
            }),
            links: vec![(evil.into(), evil.into())],
        };
        let answer = Answer {
            quantity: evil.into(),
            value: evil.into(),
            interval: evil.into(),
            truth: evil.into(),
            other: evil.into(),
            budgets: vec![Contributions {
                title: evil.into(),
                rows: vec![Contribution { name: evil.into(), text: evil.into(), size: 1.0 }],
            }],
        };
        let overview = Overview {
            views: vec![view],
            answer: Some(answer),
            cards: vec![number.clone()],
            assumed: vec![evil.into()],
        };
        let matrix = NumberMatrix {
            caption: evil.into(),
            columns: vec![evil.into()],
            rows: vec![vec![evil.into()]],
            note: evil.into(),
        };
        let figure = Figure::new(evil, panel).explained(evil);
        let figure = ReportItem::Figure { figure, caption: evil.into(), stem: evil.into() };
        ReportData {
            title: evil.into(),
            overview: Some(overview),
            live: Some(live_of(evil)),
            lead: vec![evil.into()],
            headline: vec![number.clone()],
            warnings: vec![Warning::summarized(format!("{evil} {}", "x".repeat(LONGEST_WARNING)), evil)],
            sections: vec![
                Section::new(evil)
                    .folded(evil)
                    .say(evil)
                    .with(figure)
                    .with(ReportItem::Matrix(matrix))
                    .with(ReportItem::Pictures(vec![picture]))
                    .with(ReportItem::Table(NumberTable { caption: evil.into(), rows: vec![number] }))
                    .with(ReportItem::Terms(vec![(evil.into(), evil.into())])),
            ],
            provenance: vec![(evil.into(), evil.into())],
            experiment_toml: evil.into(),
            input_files: vec![evil.into()],
            rerun_command: evil.into(),
        }
    }

    /// Frames that follow sliders, with a name everywhere.
    fn live_of(name: &str) -> LiveView {
        let rendering = ColorRendering { matrix: [[1.0; 3]; 3], lift: 1.0 };
        let capture = LiveCapture {
            name: name.into(),
            response: 0,
            drives: vec![1.0],
            subtracted: None,
            exposure_s: 0.01,
            gain: 1.0,
            dn_per_electron: 1.0,
            white_dn: 4095.0,
            well_e: 9000.0,
            dark_e_per_s: 1.0,
            rendering,
            white: 1000.0,
        };
        let plane = LivePlane {
            is_multiple: false,
            response: 0,
            group: 0,
            fluorophore: Some(name.into()),
            rates: vec![-1.0, 2.0, 3.0, 65504.0],
        };
        LiveView { size: [2, 2], groups: vec![name.into()], planes: vec![plane], captures: vec![capture] }
    }

    #[test]
    fn no_text_becomes_markup() {
        let report = hostile();
        let html = report.to_html();
        assert!(!html.contains("<img src=x") && !html.contains("onerror=alert(1)>"));
        // The experiment, the values of the live figure, and its script
        assert_eq!(html.matches("<script").count(), 3);
        assert_eq!(html.matches("</script").count(), 3);
        assert_eq!(extract_experiment(&html).as_deref(), Some(report.experiment_toml.as_str()));
    }

    #[test]
    fn a_page_names_the_files_that_it_does_not_hold() {
        let with = hostile().to_html();
        assert!(with.contains("not the files that it reads") && with.contains("Files that it needs besides"));
        let without = ReportData { input_files: Vec::new(), ..hostile() }.to_html();
        assert!(without.contains("This page contains the whole experiment.") && !without.contains("besides"));
    }

    #[test]
    fn nothing_is_fetched_from_elsewhere() {
        let html = hostile().to_html();
        for attribute in ["src=\"", "href=\""] {
            for (at, _) in html.match_indices(attribute) {
                let target = &html[at + attribute.len()..];
                // A link to a file beside the page fetches nothing.
                let is_beside = attribute == "href=\"" && !target.split('"').next().unwrap().contains(':');
                assert!(
                    target.starts_with("data:") || target.starts_with('#') || is_beside,
                    "{}",
                    &target[..40]
                );
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
