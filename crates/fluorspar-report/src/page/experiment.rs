//! A report carries the experiment that it was made from.

use super::escape::{escape, unescape};

const ID: &str = "id=\"fluorspar-experiment\"";

/// The experiment as an element that browsers neither show nor run. Its text is escaped like any other text, so that
/// nothing in it, `</script>` included, ends the element early.
pub(super) fn embed_experiment(toml: &str) -> String {
    format!("<script type=\"text/plain\" {ID}>{}</script>", escape(toml))
}

/// The experiment TOML that a report was made from, exactly as it was embedded; `None` where there is none.
///
/// Text outside the element cannot pass for it: there, `<` is always escaped.
pub fn extract_experiment(html: &str) -> Option<String> {
    let mut rest = html;
    while let Some(at) = rest.find("<script") {
        let (tag, body) = rest[at..].split_once('>')?;
        if tag.contains(ID) {
            return body.split_once("</script").map(|(text, _)| unescape(text));
        }
        rest = body;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_is_embedded_comes_out_again() {
        for toml in [
            "",
            "title = \"plain\"\n",
            "title = \"a < b & c > d\"\n# </script><script>alert('x')</script>\n",
            "# <!-- <script> --> &lt; &amp;lt; &#39;\r\n",
            "note = \"<script type=\\\"text/plain\\\" id=\\\"fluorspar-experiment\\\">\"",
            "unit = \"µm\" # λ \u{1f980}\n\n",
        ] {
            let page = format!("<html><script>let a = 1;</script>{}</html>", embed_experiment(toml));
            assert_eq!(extract_experiment(&page).as_deref(), Some(toml));
        }
    }

    #[test]
    fn the_element_holds_no_markup() {
        let element = embed_experiment("# </script><b>&");
        let inside = element.split_once('>').unwrap().1.strip_suffix("</script>").unwrap();
        assert_eq!(inside, "# &lt;/script&gt;&lt;b&gt;&amp;");
    }

    #[test]
    fn pages_without_an_experiment_have_none() {
        for page in ["", "<html></html>", "<script", "<script>", "<script id=\"other\">a = 1</script>"] {
            assert_eq!(extract_experiment(page), None, "{page}");
        }
        let cut_off = "<script type=\"text/plain\" id=\"fluorspar-experiment\">a = 1";
        assert_eq!(extract_experiment(cut_off), None);
        // The name in visible text is not the element.
        assert_eq!(extract_experiment("<p>id=\"fluorspar-experiment\"></p><script>x</script>"), None);
    }
}
