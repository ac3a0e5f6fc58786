"""Reads a built site as a person does, in Chromium: target/site/venv/bin/python docs/site/check.py OUT

Every page is opened. Nothing may be asked of another machine, each link and anchor must lead somewhere, each image must say what it shows,
pages must be light; five are read by axe, and twenty phrases are searched for. Ends with 1 and a list of what is wrong.
"""

from __future__ import annotations

import functools
import http.server
import shutil
import sys
import threading
from pathlib import Path
from urllib.parse import quote, unquote, urldefrag, urlsplit

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, sync_playwright

#: What is searched for, and a page that must be found.
PHRASES = {
    "long-pass leak": "docs/commands",
    "porphyrin interval": "docs/theory",
    "read noise": "docs/experiment-file",
    "excitation emission matrix": "docs/file-formats",
    "layered tissue": "docs/tissue",
    "Monte Carlo photons": "docs/validation",
    "Fisher information": "docs/design",
    "Dask": "docs/notebooks/6_sweep_on_dask",
    "resume film": "docs/commands",
    "ISETCam": "docs/validation",
    "OME-TIFF": "docs/file-formats",
    "xarray": "docs/file-formats",
    "pbrt fluorescence": "docs/pbrt",
    "lesion": "docs/mouth",
    "chromaticity": "docs/theory",
    "photobiological safety": "docs/theory",
    "pseudonym": "docs/study",
    "Stokes mask": "docs/theory",
    "Mitsuba": "docs/performance",
    "ExperimentError": "docs/site/api",
}
READ_BY_AXE = ["index", "docs/theory", "docs/commands", "docs/notebooks/1_first_light", "docs/site/api"]
#: Of a page without its pictures, and with them.
MOST_BYTES = (1_500_000, 4_000_000)


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


def _anchors_and_links(page: Page) -> tuple[set[str], list[str], list[str]]:
    """Ids of a page, where its links lead, and images that don't say what they show."""
    return page.evaluate(
        """() => [
            [...document.querySelectorAll('[id]')].map(e => e.id),
            [...document.querySelectorAll('a[href]')].map(e => e.href),
            [...document.querySelectorAll('img')].filter(e => !(e.alt || '').includes(' ')).map(e => e.src.slice(0, 90)),
        ]"""
    )


def _pages(browser: Page, root: Path, address: str, wrong: list[str]) -> None:
    """Every page: requests, weight, images, links."""
    asked: list[str] = []
    weight = [0, 0]

    def answered(response) -> None:  # noqa: ANN001
        if response.status >= 400:
            wrong.append(f"{browser.url}: {response.url} can't be had")
        elif response.url.startswith(address):
            size = (root / urlsplit(unquote(response.url[len(address) :])).path).stat().st_size
            weight[0] += 0 if response.request.resource_type == "image" else size
            weight[1] += size

    # Nothing comes from the cache of the browser
    browser.route("**", lambda route: route.continue_())
    browser.on("request", lambda request: asked.append(request.url))
    browser.on("response", answered)
    anchors: dict[str, set[str]] = {}
    links: list[tuple[str, str]] = []
    heaviest = [(0, ""), (0, "")]
    for path in sorted(path for path in root.rglob("*.html") if "_static" not in path.parts):
        name = path.relative_to(root).as_posix()
        weight[:] = [0, 0]
        browser.goto(address + quote(name), wait_until="networkidle")
        ids, targets, mute = _anchors_and_links(browser)
        anchors[name] = set(ids)
        links += [(name, target) for target in targets]
        wrong += [f"{name}: an image has no words: {source}" for source in mute]
        heaviest = [max(most, (now, name)) for most, now in zip(heaviest, weight)]
        if any(now > most for now, most in zip(weight, MOST_BYTES)):
            wrong.append(f"{name}: {weight} bytes without and with pictures")
    wrong += [f"asked of another machine: {url}" for url in set(asked) if not url.startswith((address, "data:"))]
    for name, target in links:
        if not target.startswith(address):
            continue
        file, anchor = urldefrag(unquote(target[len(address) :]))
        file = file.split("?")[0] or "index.html"
        if not (root / file).exists() or (anchor and file in anchors and anchor not in anchors[file]):
            wrong.append(f"{name}: leads nowhere: {target}")
    outside = {target for _, target in links if target.startswith("http") and not target.startswith(address)}
    print(f"{len(anchors)} pages, {len(links)} links, {len(outside)} of them to other sites; the heaviest without and with pictures: {heaviest}")
    browser.remove_listener("response", answered)
    browser.unroute("**")


def _search(browser: Page, address: str, wrong: list[str]) -> None:
    for phrase, page in PHRASES.items():
        browser.goto(f"{address}search.html?q={quote(phrase)}")
        browser.wait_for_function("() => /found|did not match/.test(document.querySelector('#search-results, main').innerText)")
        found = browser.eval_on_selector_all("#search-results li a", "links => links.map(link => link.href)")
        if not any(f"/{page}.html" in link for link in found):
            wrong.append(f"search: {phrase!r} finds not {page} but {[link.removeprefix(address) for link in found]}")
    print(f"{len(PHRASES)} phrases searched for")


def _axe(browser: Page, address: str, wrong: list[str]) -> None:
    for name in READ_BY_AXE:
        for width in (1280, 390):
            browser.set_viewport_size({"width": width, "height": 900})
            browser.goto(f"{address}{name}.html", wait_until="networkidle")
            found = [v for v in Axe().run(browser).response["violations"] if v["impact"] in ("serious", "critical")]
            wrong += [f"{name} at {width}: {v['id']}: {v['help']}: {v['nodes'][0]['html'][:120]}" for v in found]
    print(f"{len(READ_BY_AXE)} pages read by axe")


def main() -> int:
    root = Path(sys.argv[1]).resolve()
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=root))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    address = f"http://127.0.0.1:{server.server_port}/"
    wrong: list[str] = []
    with sync_playwright() as playwright:
        chromium = next(filter(None, map(shutil.which, ["chromium", "chromium-browser", "google-chrome"])))
        with playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"]) as browser:
            page = browser.new_page(viewport={"width": 1280, "height": 900})
            for check in (lambda: _pages(page, root, address, wrong), lambda: _search(page, address, wrong), lambda: _axe(page, address, wrong)):
                check()
    print("\n".join(wrong) or "nothing is wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
