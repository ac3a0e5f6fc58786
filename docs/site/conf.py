"""The site: pages and notebooks of the repository as they lie, which is the source folder. `docs/site/build` calls it."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import fluorspar
from sphinx.ext.napoleon import Config, GoogleDocstring

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted(path.stem for path in (ROOT / "docs/notebooks").glob("*.ipynb"))

project = "Fluorspar"
author = "The Fluorspar developers"
release = fluorspar.__version__
commit = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True).stdout.strip()

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinxcontrib.katex"]
root_doc = "README"
include_patterns = ["*.md", "docs/**", "examples/README.md", "crates/fluorspar-experiment/data/README.md", "crates/fluorspar-experiment/data/*/README.md", "crates/fluorspar-report/fonts/README.md"]
exclude_patterns = ["target", "**/.*", "docs/images/source/**"]

# Notebooks run when the site is built, each in a folder of its own; one that fails ends the build.
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True

# Anchors as a forge makes them; formulas are ```math blocks, which forges typeset, too.
myst_heading_anchors = 4
myst_enable_extensions = ["html_image"]
myst_fence_as_directive = ["math"]
katex_prerender = True
katex_css_path = "katex/katex.min.css"

nitpicky = True
nitpick_ignore_regex = [("py:class", r"str|int|list\[str\]|None")]
autodoc_typehints = "none"
autodoc_member_order = "alphabetical"
suppress_warnings = ["misc.highlighting_failure"]

html_theme = "pydata_sphinx_theme"
html_title = f"Fluorspar {release}"
html_css_files = ["site.css"]
templates_path = ["templates"]
html_sidebars = {"**": ["contents.html"]}
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "logo": {"text": f"Fluorspar {release}"},
    "navbar_center": [],
    "navbar_end": ["theme-switcher"],
    "footer_start": ["copyright"],
    "footer_end": ["sphinx-version"],
    "show_prev_next": False,
}
copyright = f"{author}; version {release}, commit {commit}"

# What the front page holds besides its text. Titles of the pages are their own.
CONTENTS = {
    "For whom": ["docs/for-camera-makers", "docs/for-dentists", "docs/for-vision-scientists", "docs/for-tissue-optics"],
    "Begin": ["docs/gallery", "examples/README", "docs/python", *(f"docs/notebooks/{name}" for name in NOTEBOOKS)],
    "Use": [
        *(f"docs/{name}" for name in ["workbench", "commands", "experiment-file", "file-formats", "mouth", "tissue", "design", "study", "pbrt"]),
        "docs/site/api",
        "crates/fluorspar-experiment/data/README",
        "crates/fluorspar-experiment/data/experiments/README",
        "crates/fluorspar-experiment/data/fluorophores/README",
        "crates/fluorspar-experiment/data/metals/README",
    ],
    "Understand": [f"docs/{name}" for name in ["theory", "validation", "performance", "reliability", "glossary", "bibliography"]],
    "Change and cite": ["docs/site/cite", "ARCHITECTURE", "CONTRIBUTING", "CHANGELOG", "crates/fluorspar-report/fonts/README"],
}


def _without_links_to_folders(text: str, folder: Path) -> str:
    """A forge shows a folder, a site has none: its name stays."""

    def shown(link: re.Match[str]) -> str:
        is_folder = not link[2].startswith(("http", "#")) and (folder / link[2]).is_dir()
        return link[1] if is_folder else link[0]

    return re.sub(r"(?<!!)\[([^][]*)\]\(([^)#\s]+)\)", shown, text)


def _read(_app: object, name: str, source: list[str]) -> None:
    page = ROOT / f"{name}.md"
    if not page.exists():
        return
    source[0] = _without_links_to_folders(source[0], page.parent)
    if name == root_doc:
        for caption, pages in CONTENTS.items():
            source[0] += "\n```{{toctree}}\n:hidden:\n:caption: {}\n\n{}\n```\n".format(caption, "\n".join(pages))


def _attributes(app, what, name, obj, _options, lines) -> None:  # noqa: ANN001
    if what == "exception":
        lines[:] = GoogleDocstring(lines, Config(napoleon_use_ivar=True), app, what, name, obj).lines()


def setup(app) -> None:  # noqa: ANN001
    app.connect("source-read", _read)
    app.connect("autodoc-process-docstring", _attributes)
