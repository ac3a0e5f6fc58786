//! The first screen of a report as HTML: tabs without a script, the answer, and the numbers that decide.

use std::fmt::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::escape;
use super::report_data::{Answer, Contribution, Contributions, FrameView, MapOverlay, Number, Overview};
use crate::ColorMap;

/// Most tabs that the style sheet knows.
const MOST_TABS: usize = 8;
/// Stops of the color scale.
const STOPS: usize = 9;

impl Overview {
    pub(super) fn write(&self, html: &mut String) {
        html.push_str("<section class=\"overview\" aria-label=\"Overview\">\n");
        if !self.views.is_empty() {
            self.write_views(html);
        }
        html.push_str("<div class=\"verdict\">\n");
        if let Some(answer) = &self.answer {
            write_answer(html, answer);
        }
        write_numbers(html, "cards", &self.cards);
        html.push_str("</div>\n");
        // Below both columns: in one of them alone it would reach beyond the screen
        if !self.assumed.is_empty() {
            let _ = writeln!(
                html,
                "<p class=\"assumed\"><b>What this rests on.</b> {}</p>",
                escape(&self.assumed.join(" "))
            );
        }
        html.push_str("</section>\n");
    }

    fn write_views(&self, html: &mut String) {
        let _ = writeln!(html, "<div class=\"views\" role=\"group\" aria-label=\"Images\">");
        // Tabs: a map has one beside that of its image
        let mut tabs = Vec::new();
        for (number, view) in self.views.iter().enumerate() {
            tabs.push((view.name.as_str(), number, false));
            if let Some(map) = &view.map {
                let place = if map.is_second { tabs.len() } else { tabs.len() - 1 };
                tabs.insert(place, (map.name.as_str(), number, true));
            }
        }
        tabs.truncate(MOST_TABS);
        for (tab, (name, ..)) in tabs.iter().enumerate() {
            let checked = if tab == 0 { " checked" } else { "" };
            let _ = writeln!(
                html,
                "<input type=\"radio\" name=\"view\" id=\"view-{tab}\"{checked}><label for=\"view-{tab}\">{}</label>",
                escape(name)
            );
        }
        for (number, view) in self.views.iter().enumerate() {
            let of_view = |with_map: Option<bool>| -> Vec<usize> {
                let wanted = |(_, view, map): &(&str, usize, bool)| {
                    *view == number && with_map.is_none_or(|m| m == *map)
                };
                tabs.iter().enumerate().filter(|(_, tab)| wanted(tab)).map(|(tab, _)| tab).collect()
            };
            write_view(html, view, &classes("v", &of_view(None)), &classes("on", &of_view(Some(true))));
        }
        html.push_str("</div>\n");
    }
}

fn classes(prefix: &str, tabs: &[usize]) -> String {
    tabs.iter().map(|tab| format!("{prefix}{tab}")).collect::<Vec<_>>().join(" ")
}

fn write_view(html: &mut String, view: &FrameView, tabs: &str, map_tabs: &str) {
    let [width, height] = view.size;
    let _ = writeln!(
        html,
        "<figure class=\"view {tabs}\">\n<div class=\"stack\" style=\"aspect-ratio:{width}/{height};--ratio:{:.4}\">\n\
         <img width=\"{width}\" height=\"{height}\" alt=\"{}\" src=\"data:image/png;base64,{}\">",
        width as f64 / height.max(1) as f64,
        escape(&view.alt),
        STANDARD.encode(&view.png)
    );
    if let Some(map) = &view.map {
        let [left, top, w, h] = map.frame;
        let percent = |value: f64, of: usize| 100.0 * value / of.max(1) as f64;
        let _ = writeln!(
            html,
            "<img class=\"map {map_tabs}\" style=\"left:{:.3}%;top:{:.3}%;width:{:.3}%;height:{:.3}%\" alt=\"{}\" \
             src=\"data:image/png;base64,{}\">",
            percent(left, width),
            percent(top, height),
            percent(w, width),
            percent(h, height),
            escape(&map.caption),
            STANDARD.encode(&map.png)
        );
    }
    write_outline(html, view);
    // On a narrow screen numbers stand in the regions, and the names below the frame
    for (number, (name, [x, y])) in (1..).zip(&view.names) {
        let [left, top] = [x / width.max(1) as f64, y / height.max(1) as f64].map(|share| 100.0 * share);
        let name = escape(name);
        let _ = writeln!(
            html,
            "<span class=\"name\" style=\"--x:{left:.2}%;--y:{top:.2}%\"><b>{number}</b><span class=\"full\">{name}</span></span>"
        );
    }
    html.push_str("</div>\n");
    if !view.names.is_empty() {
        let list = (1..).zip(&view.names).map(|(number, (name, _))| format!("{number} {}", escape(name)));
        let _ = writeln!(html, "<p class=\"names\">{}</p>", list.collect::<Vec<_>>().join(", "));
    }
    if let Some(map) = &view.map {
        write_scale(html, map, map_tabs);
    }
    html.push_str("<figcaption>");
    if let Some(map) = &view.map {
        let _ = write!(html, "<span class=\"map {map_tabs}\">{} </span>", escape(&map.caption));
    }
    html.push_str(&escape(&view.caption));
    if !view.links.is_empty() {
        html.push_str(" As recorded:");
    }
    for (name, path) in &view.links {
        let _ = write!(html, " <a href=\"{}\">{}</a>", escape(path), escape(name));
    }
    html.push_str("</figcaption>\n</figure>\n");
}

fn write_outline(html: &mut String, view: &FrameView) {
    if view.outline.is_empty() {
        return;
    }
    let mut path = String::new();
    for line in &view.outline {
        for (index, [x, y]) in line.iter().enumerate() {
            let _ = write!(path, "{}{x} {y}", if index == 0 { 'M' } else { 'L' });
        }
        path.push('Z');
    }
    let [width, height] = view.size;
    let _ = writeln!(
        html,
        "<svg class=\"outline\" viewBox=\"0 0 {width} {height}\" aria-hidden=\"true\"><path class=\"halo\" d=\"{path}\"/>\
         <path d=\"{path}\"/></svg>"
    );
}

fn write_scale(html: &mut String, map: &MapOverlay, tabs: &str) {
    let color = |stop: usize| {
        let [r, g, b] = ColorMap::Viridis.color(stop as f64 / (STOPS - 1) as f64);
        format!("rgb({r} {g} {b})")
    };
    let colors: Vec<String> = (0..STOPS).map(color).collect();
    let [low, high] = map.limits;
    let _ = writeln!(
        html,
        "<div class=\"scale map {tabs}\"><span>{low:.2}</span><span class=\"ramp\" style=\"background:linear-gradient(to right,{})\">\
         </span><span>{high:.2}</span> <span class=\"label\">{}</span></div>",
        colors.join(","),
        escape(&map.label)
    );
}

fn write_answer(html: &mut String, answer: &Answer) {
    let _ = writeln!(
        html,
        "<div class=\"answer\">\n<p class=\"quantity\">{}</p>\n<p class=\"estimate\"><b>{}</b> <span>{}</span></p>",
        escape(&answer.quantity),
        escape(&answer.value),
        escape(&answer.interval)
    );
    if !answer.truth.is_empty() {
        let _ = writeln!(html, "<p class=\"truth\">{}</p>", escape(&answer.truth));
    }
    if !answer.other.is_empty() {
        let _ = writeln!(html, "<p class=\"truth\">{}</p>", escape(&answer.other));
    }
    for budget in answer.budgets.iter().filter(|budget| !budget.rows.is_empty()) {
        write_budget(html, budget);
    }
    html.push_str("</div>\n");
}

fn write_budget(html: &mut String, Contributions { title, rows }: &Contributions) {
    let title = escape(title);
    let _ = writeln!(html, "<table class=\"budget\">\n<caption>{title}</caption>\n<tbody>");
    for Contribution { name, text, size } in rows {
        let _ = writeln!(
            html,
            "<tr><th scope=\"row\">{}</th><td class=\"value\">{}</td><td class=\"size\"><span style=\"width:{:.0}%\">\
             </span></td></tr>",
            escape(name),
            escape(text),
            100.0 * size.clamp(0.0, 1.0)
        );
    }
    html.push_str("</tbody>\n</table>\n");
}

/// Numbers with their units and what they mean, in the style of a class.
pub(super) fn write_numbers(html: &mut String, class: &str, numbers: &[Number]) {
    if numbers.is_empty() {
        return;
    }
    let _ = writeln!(html, "<dl class=\"{class}\">");
    for number in numbers {
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
