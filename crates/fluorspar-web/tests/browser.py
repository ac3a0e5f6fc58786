"""The workbench in a real Chromium: what a person does on the page, and what the page then says. `.ci/browser` runs it.

Usage: browser.py PROGRAM [TESTS]. Each test is a function of this file whose name begins with `test_`; it gets a page on a small run.
"""

import base64
import contextlib
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.parse
from pathlib import Path

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, sync_playwright

#: Longest wait for what takes the server some work, ms: a first estimate solves tissues.
WAIT = 90_000
#: A small mouth: few pixels, few samples, all of its parts.
SMALL = ["--set", "render.width_px=96", "--set", "render.height_px=72", "--spp", "2"]
#: A camera without noise and colors, with a pixel for each of the render.
QUIET = ["sensor.mode={ type = \"noise_free\" }", "sensor.bit_depth=16", "sensor.columns=96", "sensor.rows=72", "sensor.pixel_size_um=25.0",
         'sensor.mosaic=[["G"]]', "sensor.dark_current_e_per_s=1e5", "capture.blue.exposure_ms=0.2"]
#: Kinds of findings of axe that stand in nobody's way.
BEARABLE = {"minor", "moderate"}


class Bench:
    """A workbench of its own and a page on it, which notes what goes wrong."""

    def __init__(self, program: str, page: Page, subject: list[str], has_tour: bool = False) -> None:
        self.page = page
        self.subject = Path(subject[0])
        self.requests: list[str] = []
        self.errors: list[str] = []
        self.process = subprocess.Popen([program, "workbench", "-q", *subject], stdout=subprocess.PIPE, text=True)
        assert self.process.stdout
        self.address = self.process.stdout.readline().strip()
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)
        if not has_tour:
            page.context.add_cookies([{"name": "fluorspar_tour", "value": "seen", "domain": "127.0.0.1", "path": "/"}])
        page.goto(self.address)

    def close(self) -> None:
        self.process.terminate()
        assert self.process.wait(10) == 0, "the workbench did not end well"
        foreign = [url for url in self.requests if urllib.parse.urlsplit(url).hostname not in ("127.0.0.1", None)]
        assert not foreign, f"requests left the machine: {foreign}"
        assert not self.errors, f"errors on the page: {self.errors}"

    def serial(self) -> int:
        """How many pictures were shown."""
        return int(self.page.locator("#picture").get_attribute("data-serial") or 0)

    def picture(self, act=lambda: None, after: int | None = None) -> None:
        """Acts, and waits until a picture came after that and no further one is in the making."""
        if after is None:
            self.rest(-1)
            after = self.serial()
        act()
        self.rest(after)

    def rest(self, after: int) -> None:
        self.page.wait_for_function(
            "after => Number(document.querySelector('#picture').dataset.serial ?? 0) > after"
            " && document.querySelector('#viewport').matches('[aria-busy=false]:not(.stale)')", arg=after, timeout=WAIT)

    def estimate(self) -> str:
        """The verdict, once it is of the state that is shown."""
        self.page.wait_for_function(
            "() => !document.querySelector('#region').classList.contains('stale')"
            " && document.querySelector('#verdict').textContent !== 'Estimating …'", timeout=WAIT)
        return self.page.locator("#verdict").inner_text()

    def pixels(self) -> str:
        return self.page.evaluate("() => document.querySelector('#picture').toDataURL()")

    def control(self, path: str):
        """The element of a control, by its path."""
        return self.page.locator(".control", has=self.page.get_by_text(path, exact=True))

    def changes(self) -> list[str]:
        return self.page.locator("#changed code").all_inner_texts()

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Draws from one place of the frame to another, as shares of its width and height."""
        box = self.page.locator("#drawing").bounding_box()
        assert box
        at = [(box["x"] + x * box["width"], box["y"] + y * box["height"]) for x, y in (start, end)]
        self.page.mouse.move(*at[0])
        self.page.mouse.down()
        self.page.mouse.move(*at[1], steps=4)
        self.page.mouse.up()


def test_a_run_is_shown(bench: Bench) -> None:
    page = bench.page
    bench.picture(after=0)
    assert "token" not in page.url and "OralEye" in page.locator("#subject").inner_text()
    assert page.locator("#picture").get_attribute("aria-label").startswith("Frame ")
    assert bench.estimate()
    shown = bench.pixels()
    seen = [shown]
    for view in ("Raw mosaic", "Clipping", "Signal to noise", "Eye", "Clay", "Parts", "Depth", "Porphyrin map"):
        bench.picture(lambda: page.get_by_role("radio", name=view).check(force=True))
        seen.append(bench.pixels())
    assert len(set(seen)) == len(seen), "two views are the same"
    bench.picture(lambda: page.get_by_role("radio", name="Developed").check(force=True))
    assert bench.pixels() == shown


def test_each_kind_of_control_changes_the_frame(bench: Bench) -> None:
    page = bench.page
    bench.picture(after=0)
    seen = [bench.pixels()]

    def act(what: str, action) -> None:
        bench.picture(action)
        shown = bench.pixels()
        assert shown not in seen, f"{what} changed nothing"
        seen.append(shown)

    def typed(control, value: str) -> None:
        control.locator("input[type=number]").fill(value)
        control.locator("input[type=number]").press("Enter")

    assert page.locator("#captures input").count() > 1
    exposure = page.locator(".control:visible", has_text="exposure_ms")
    act("exposure", lambda: typed(exposure, "3"))
    assert any(text.endswith("exposure_ms=3.0") for text in bench.changes()), bench.changes()
    act("automatic exposure", lambda: exposure.locator("input[type=checkbox]").check())
    act("drive", lambda: page.locator(".control:visible", has_text="light_groups.blue").locator("input[type=range]").press("PageUp"))
    # A drag shows pictures while it lasts, however slow the machine is
    drive = page.locator(".control:visible", has_text="light_groups.blue").locator("input[type=range]")
    before = bench.serial()
    drive.evaluate("""async slider => {
        const shown = () => Number(document.querySelector('#picture').dataset.serial);
        const before = shown();
        slider.dispatchEvent(new PointerEvent('pointerdown'));
        for (let at = 0; shown() < before + 2 && at < 2000; at++) {
            slider.value = String(300 + at % 400);
            slider.dispatchEvent(new Event('input'));
            await new Promise(requestAnimationFrame);
        }
    }""")
    assert bench.serial() >= before + 2, "a drag showed no pictures"
    act("the end of a drag", lambda: drive.evaluate("slider => { slider.value = '345'; slider.dispatchEvent(new Event('input')); slider.dispatchEvent(new Event('change')); }"))
    act("filter", lambda: bench.control("view_filter.filters").locator("select").select_option("[]"))
    act("concentration", lambda: page.locator(".control", has_text="concentration.").locator("input[type=range]").first.press("End"))
    act("sensor", lambda: bench.control("sensor.preset").locator("select").select_option("\"rgb_nir_3um\""))
    changes = bench.changes()
    bench.picture(lambda: page.locator("#undo").click())
    assert bench.pixels() == seen[-2] and len(bench.changes()) == len(changes) - 1
    bench.picture(lambda: page.locator("#redo").click())
    assert bench.pixels() == seen[-1] and bench.changes() == changes
    bench.picture(lambda: page.locator("#reset").click())
    assert bench.pixels() == seen[0]


def test_a_region_is_drawn_and_stays_in_the_address(bench: Bench) -> None:
    page = bench.page
    bench.picture(after=0)
    before = bench.estimate()
    page.get_by_role("radio", name="Rectangle").check(force=True)
    bench.drag((0.35, 0.45), (0.6, 0.7))
    page.wait_for_function("() => document.querySelector('#place').textContent.startsWith('A rectangle')")
    drawn = bench.estimate()
    assert page.locator("#spectra svg.chart").count() == 1
    page.locator("#tools input[value=part]").check(force=True)
    box = page.locator("#drawing").bounding_box()
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.66 * box["height"])
    page.wait_for_function("() => document.querySelector('#place').textContent.startsWith('The part tongue')", timeout=WAIT)
    page.wait_for_function("() => location.hash.includes('part=tongue')")
    page.locator("#undo").click()
    page.wait_for_function("() => document.querySelector('#place').textContent.startsWith('A rectangle')", timeout=WAIT)
    bench.picture(lambda: bench.control("view_filter.filters").locator("select").select_option("[]"))
    page.wait_for_function("() => location.hash.includes('view_filter')")
    shown, address = bench.pixels(), page.url
    page.goto("about:blank")
    page.goto(address)
    bench.picture(after=0)
    assert bench.pixels() == shown and len(bench.changes()) == 1
    page.wait_for_function("() => document.querySelector('#place').textContent.startsWith('A rectangle')", timeout=WAIT)
    # The way to the controls for keyboards leaves changes and address alone
    page.locator(".skip").focus()
    page.keyboard.press("Enter")
    assert page.evaluate("() => document.activeElement.id") == "controls" and page.url == address and len(bench.changes()) == 1
    assert before and drawn


def test_two_states_are_compared_and_saved(bench: Bench) -> None:
    page = bench.page
    bench.picture(after=0)
    first = bench.pixels()
    page.locator("#keep").click()
    bench.picture(lambda: bench.control("view_filter.filters").locator("select").select_option("[]"))
    kept = "() => document.querySelector('#kept').toDataURL()"
    page.wait_for_function(f"first => !document.querySelector('#kept').hidden && ({kept})() !== 'data:,'", arg=first, timeout=WAIT)
    page.locator("#wipe").press("Home")
    assert "inset(0px 100%" in page.locator("#kept").evaluate("element => element.style.clipPath")
    bench.picture(lambda: page.locator("#swap").click())
    assert bench.pixels() == first and "view_filter" in page.locator("#kept-list").inner_text()
    assert "kept=" in page.url
    bench.picture(lambda: page.locator("#swap").click())
    page.locator("#forget").click()
    assert not page.locator("#compare").is_visible()
    with page.expect_download() as saved:
        page.locator("#save").click()
    text = Path(saved.value.path()).read_text()
    assert saved.value.suggested_filename == "experiment.toml" and "filters = []" in text
    page.locator("#report").click()
    page.locator("#made-open").wait_for(timeout=WAIT)
    with page.context.expect_page() as opened:
        page.locator("#made-open").click()
    opened.value.wait_for_load_state()
    assert opened.value.url.endswith("/report.html") and opened.value.locator("figure svg").count() > 5
    assert opened.value.evaluate("() => getComputedStyle(document.querySelector('.overview')).display") == "grid"


def test_a_report_is_told_in_tabs(bench: Bench) -> None:
    page = bench.page
    bench.picture(after=0)
    page.locator("#findings-fold summary").click()
    tab = page.get_by_role("tab", name="Safety of eyes and skin")
    tab.wait_for(timeout=WAIT)
    page.get_by_role("tab", name="How much excitation light").wait_for(timeout=WAIT)
    page.get_by_role("tab", name="In short").click()
    assert page.locator("#findings-panel table").count() > 0
    page.keyboard.press("ArrowRight")
    assert page.get_by_role("tab", name="Frames").get_attribute("aria-selected") == "true"
    assert page.locator("#findings-panel svg").count() > 0
    found = [one for one in Axe().run(page).response["violations"] if one["impact"] not in BEARABLE]
    assert not found, found


def test_a_photograph_is_dropped_drawn_upon_and_saved(bench: Bench) -> None:
    page = bench.page
    run = bench.subject
    bench.picture(after=0)
    files = [{"name": name, "base64": base64.b64encode((run / name).read_bytes()).decode()}
             for capture in ("blue", "ambient") for name in (f"raw_{capture}.tiff", f"raw_{capture}.tiff.json")]
    files.append({"name": "photo.jpg", "base64": base64.b64encode(b"\xff\xd8\xff\xe0 no raw frame").decode()})
    page.evaluate("""files => {
        const data = new DataTransfer();
        for (const { name, base64 } of files) data.items.add(new File([Uint8Array.from(atob(base64), c => c.charCodeAt(0))], name));
        document.body.dispatchEvent(new DragEvent('drop', { dataTransfer: data, bubbles: true, cancelable: true }));
    }""", files)
    page.wait_for_function("() => document.querySelectorAll('#photo-list tr').length === 2", timeout=WAIT)
    page.wait_for_function("() => document.querySelector('#photo-viewport').ariaBusy === 'false'", timeout=WAIT)
    assert "tone curve" in page.locator("#photo-message").inner_text()
    bench.errors.clear()
    page.get_by_role("button", name="Add tongue").click()
    box = page.locator("#photo-drawing").bounding_box()
    for x, y in ((0.4, 0.6), (0.6, 0.6), (0.5, 0.75)):
        page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
    page.keyboard.press("Enter")
    verdict = page.locator("#photo-regions .verdict")
    page.wait_for_function("() => document.querySelector('#photo-regions .verdict').textContent.includes('%')", timeout=WAIT)
    assert verdict.count() == 1
    page.get_by_role("button", name="Add lesion").click()
    page.locator("#photo-tool").select_option("brush")
    page.mouse.move(box["x"] + 0.45 * box["width"], box["y"] + 0.65 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.66 * box["height"], steps=4)
    # A quick stroke has no gaps
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.66 * box["height"])
    page.mouse.up()
    page.get_by_label("verdict on lesion").select_option("wrong")
    found = [one for one in Axe().run(page).response["violations"] if one["impact"] not in BEARABLE]
    assert not found, found
    with tempfile.TemporaryDirectory() as folder:
        page.locator("#photo-folder").fill(folder)
        page.get_by_role("button", name="Save table and masks").click()
        page.wait_for_function("() => document.querySelector('#photo-message').textContent.startsWith('Saved')", timeout=WAIT)
        table = (Path(folder) / "photographs.csv").read_text().splitlines()
        assert table[0] == "patient,visit,capture,frame,dark,flat,region,where,verdict" and len(table) == 4, table
        assert (Path(folder) / "mask_raw_blue_lesion.png").exists() and table[2].endswith(",wrong"), table


def test_person_view_and_lesion_are_rendered(bench: Bench) -> None:
    page = bench.page
    bench.picture(after=0)
    seen = [bench.pixels()]

    def act(action) -> None:
        """Acts, and waits for the finished picture."""
        before = bench.serial()
        action()
        page.locator("#veil").wait_for(state="visible", timeout=WAIT)
        bench.rest(before)
        page.locator("#veil").wait_for(state="hidden", timeout=WAIT)
        assert "96 × 72 px, 4 samples" in page.locator("#size").inner_text()
        assert bench.pixels() not in seen
        seen.append(bench.pixels())

    def typed(path: str, value: str) -> None:
        field = bench.control(path).locator("input[type=number]")
        field.fill(value)
        field.press("Enter")

    act(lambda: typed("mouth.person", "7"))
    assert bench.changes() == ["mouth.person=7"]
    act(lambda: bench.control("mouth.view").locator("select").select_option('"lips"'))
    # A lesion is one value, of which each field is a control
    lesion = page.locator(".control", has=page.get_by_text("insert mouth.lesion.drawn", exact=True)).first
    act(lambda: lesion.get_by_label("A lesion").check())
    # What is taken back ends, and the scene before is still there
    before = bench.serial()
    lesion.get_by_label("On", exact=True).select_option('"lower_lip"')
    assert 'insert mouth.lesion.drawn={ part = "lower_lip"' in bench.changes()[-1], bench.changes()
    page.locator("#veil").wait_for(state="visible", timeout=WAIT)
    page.locator("#undo").click()
    page.locator("#veil").wait_for(state="hidden", timeout=WAIT)
    bench.rest(before)
    assert bench.pixels() == seen[-1], "the scene before is not there any more"
    # What is stopped can begin again
    typed("mouth.jaw_opening_mm", "28")
    page.locator("#veil-stop").click()
    page.locator("#render").wait_for(timeout=WAIT)
    assert "stopped" in page.locator("#message-text").inner_text()
    page.locator("#back").click()
    page.wait_for_function("() => document.querySelector('#message').hidden", timeout=WAIT)
    bench.estimate()
    found = [one for one in Axe().run(page).response["violations"] if one["impact"] not in BEARABLE]
    assert not found, found
    # The console tells of what was refused until it was rendered
    bench.errors.clear()


def test_a_render_is_stopped_and_then_seen_in_another_view(bench: Bench) -> None:
    page = bench.page
    bench.picture(after=0)
    for path, value in (("render.samples_per_pixel", "20000"), ("mouth.jaw_opening_mm", "27")):
        page.locator("#any input[name=path]").fill(path)
        page.locator("#any input[name=value]").fill(value)
        page.locator("#any button").click()
    # The coarse picture is there, the fine one would take long
    page.wait_for_function("() => document.querySelector('#size').textContent.includes('48 × 36')", timeout=WAIT)
    page.locator("#veil-stop").click()
    waited = page.evaluate("""async set => {
        const begun = performance.now();
        const asked = { method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify({ set, seen: 9 }) };
        while (!(await (await fetch('/api/render', asked)).json()).is_over);
        return performance.now() - begun;
    }""", bench.changes())
    print(f"stopped after {waited:.0f} ms")
    assert waited < 3000, waited
    developed = bench.pixels()
    before = bench.serial()
    page.get_by_role("radio", name="Raw mosaic").check(force=True)
    page.wait_for_function("before => Number(document.querySelector('#picture').dataset.serial) > before", arg=before, timeout=WAIT)
    assert bench.pixels() != developed and page.locator("#render").is_visible() and not page.locator("#veil").is_visible()
    page.locator("#render").click()
    page.locator("#veil").wait_for(state="visible", timeout=WAIT)
    page.locator("#veil-stop").click()
    bench.picture(lambda: page.locator("#reset").click())
    page.wait_for_function("() => document.querySelector('#message').hidden", timeout=WAIT)
    bench.errors[:] = [error for error in bench.errors if "422" not in error]


def test_shapes_are_turned_and_named(bench: Bench) -> None:
    page = bench.page
    bench.picture(after=0)
    page.get_by_role("radio", name="Turn in 3-D").check(force=True)
    canvas = page.locator("#orbit")
    serial = "() => Number(document.querySelector('#orbit').dataset.serial ?? 0)"

    def shown(act) -> str:
        before = page.evaluate(serial)
        act()
        page.wait_for_function(f"before => ({serial})() > before && document.querySelector('#orbited').ariaBusy === 'false'", arg=before, timeout=WAIT)
        return page.evaluate("() => document.querySelector('#orbit').toDataURL()")

    front = shown(lambda: canvas.focus() or page.keyboard.press("Home"))
    assert page.get_by_role("radio", name="Clay").is_checked()
    seen = [front]
    for key in ("ArrowRight", "ArrowUp", "+"):
        seen.append(shown(lambda: page.keyboard.press(key)))
    box = canvas.bounding_box()
    middle = (box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])

    def drag() -> None:
        page.mouse.move(*middle)
        page.mouse.down()
        page.mouse.move(middle[0] + 60, middle[1], steps=5)
        page.mouse.up()

    seen.append(shown(drag))
    seen.append(shown(lambda: page.mouse.wheel(0, -300)))
    assert len(set(seen)) == len(seen), "something turned nothing"
    shown(lambda: page.keyboard.press("Home"))
    page.keyboard.press("Enter")
    page.wait_for_function("() => / mm away$/.test(document.querySelector('#picked').textContent)", timeout=WAIT)
    canvas.click(position={"x": 0.5 * box["width"], "y": 0.66 * box["height"]})
    page.wait_for_function("() => document.querySelector('#picked').textContent.startsWith('tongue dorsum')", timeout=WAIT)
    assert "layered tissue dorsal_tongue" in page.locator("#picked").inner_text()
    found = [one for one in Axe().run(page).response["violations"] if one["impact"] not in BEARABLE]
    assert not found, found
    page.get_by_role("radio", name="Developed").check(force=True)
    assert page.locator("#picture").is_visible() and not canvas.is_visible()


def test_a_tour_leads_through_the_page_once(bench: Bench) -> None:
    page = bench.page
    bench.picture(after=0)
    page.locator("#tour[open]").wait_for(timeout=WAIT)
    titles = []
    for step in range(5):
        titles.append(page.locator("#tour-title").inner_text())
        assert page.locator("#tour-count").inner_text() == f"{step + 1} of 5" and page.locator(".toured").count() == 1
        page.keyboard.press("Enter")
    assert len(set(titles)) == 5 and not page.locator("#tour").is_visible()
    page.reload()
    bench.picture(after=0)
    assert not page.locator("#tour").is_visible()
    page.locator("#tour-begin").click()
    page.keyboard.press("Escape")
    assert not page.locator("#tour").is_visible()


def test_a_report_follows_its_sliders_as_captures_do(bench: Bench) -> None:
    """The live figure of a report against `/api/picture`, of a camera without noise whose pixels are those of the figure."""
    page = bench.page
    bench.picture(after=0)
    page.goto("about:blank")
    page.goto(bench.address.split("?")[0] + "#" + urllib.parse.urlencode([("set", one) for one in QUIET] + [("capture", "blue")]))
    bench.picture(after=0)
    page.locator("#report").click()
    page.locator("#made-open").wait_for(timeout=WAIT)
    with page.context.expect_page() as opened:
        page.locator("#made-open").click()
    report = opened.value
    report.wait_for_load_state()
    report.locator("#live canvas").wait_for(timeout=WAIT)
    data = report.evaluate("""() => {
        const { captures, size } = JSON.parse(document.querySelector('#live-data').textContent);
        return { captures, size };
    }""")
    assert data["size"] == [96, 72], data["size"]
    assert len(report.locator("#live-data").text_content()) < 3_000_000
    report.locator("#live-capture").select_option(label="blue")
    white = next(one["white"] for one in data["captures"] if one["name"] == "blue")

    # Steps of a thousand: a drive up to 2, exposures of 0.1 to 1000 ms, gains of 1 to 32
    for label, step in (("Drive of blue", 700), ("Exposure", 100), ("Gain", 100), ("collagen", 500)):
        slider = report.get_by_label(label).first
        slider.evaluate("(slider, step) => { slider.value = step; slider.dispatchEvent(new Event('input')); }", step)
    changes = [*QUIET, "capture.blue.light_groups.blue=1.4", f"capture.blue.exposure_ms={0.1 * 1e4 ** 0.1}",
               f"capture.blue.gain={32 ** 0.1}", "concentration.collagen=2.0"]
    differences = page.evaluate("""async ([set, white, live]) => {
        const answer = await fetch('/api/picture', { method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify({ set, capture: 'blue', view: 'developed', white }) });
        const bytes = await answer.arrayBuffer();
        const length = new DataView(bytes).getUint32(0, true);
        const image = await createImageBitmap(new Blob([new Uint8Array(bytes, 4 + length)], { type: 'image/png' }));
        const canvas = new OffscreenCanvas(image.width, image.height);
        const pen = canvas.getContext('2d');
        pen.drawImage(image, 0, 0);
        const pixels = pen.getImageData(0, 0, image.width, image.height).data;
        return [Math.max(...pixels.map((value, i) => Math.abs(value - live[i]))), new Set(pixels).size];
    }""", [changes, white, report.evaluate("() => { const c = document.querySelector('#live-picture'); return [...c.getContext('2d').getImageData(0, 0, c.width, c.height).data]; }")])
    assert differences[0] <= 1 and differences[1] > 50, differences
    assert report.evaluate("() => document.querySelectorAll('#live-controls label').length") > 6
    found = [one for one in Axe().run(report).response["violations"] if one["impact"] not in BEARABLE]
    assert not found, found


def test_a_design_is_picked_and_told(bench: Bench) -> None:
    page = bench.page
    panel = page.locator("#design-panel")
    panel.locator("table").first.wait_for(timeout=WAIT)
    assert page.locator("#designs").is_visible() and not page.locator("#bench").is_visible()
    first = page.locator("#design-name").inner_text()

    def told(act) -> str:
        before = panel.inner_html()
        act()
        page.wait_for_function("before => document.querySelector('#design-panel').innerHTML !== before"
                               " && !document.querySelector('#design-body').classList.contains('stale')", arg=before, timeout=WAIT)
        return page.locator("#design-name").inner_text()

    plot = page.locator("#design-plot")
    second = told(lambda: plot.focus() or page.keyboard.press("ArrowRight"))
    assert second != first and page.locator("#design-list [aria-pressed=true]").inner_text() == second
    place = page.evaluate("""() => {
        const ring = document.querySelector('#design-plot .ring').getBoundingClientRect();
        const front = document.querySelector('#design-plot .front').getAttribute('d').match(/M([0-9.]+) ([0-9.]+)/);
        const [plot, view] = [document.querySelector('#design-plot').getBoundingClientRect(), document.querySelector('#design-plot').viewBox.baseVal];
        return [plot.x + front[1] * plot.width / view.width, plot.y + front[2] * plot.height / view.height, ring.x];
    }""")
    assert told(lambda: page.mouse.click(place[0], place[1])) not in ("", second)
    page.get_by_role("tab", name="Bounds and spectra").click()
    assert panel.locator("svg").count() >= 1
    picked = page.locator("#design-name").inner_text()
    told(lambda: page.locator("#design-beside").select_option(label="385 nm alone"))
    page.get_by_role("tab", name="What is least told apart").click()
    assert "385 nm alone" in panel.inner_text() and "nothing bounds it" in panel.inner_text()
    page.locator("#design-words").fill("405 nm")
    assert not page.locator("#design-count").inner_text().startswith("351")
    address = page.url
    page.goto("about:blank")
    page.goto(address)
    panel.locator("table").first.wait_for(timeout=WAIT)
    assert page.locator("#design-name").inner_text() == picked and page.locator("#design-beside").input_value() == "c0"
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        for width in (390, 1280, 2560):
            page.set_viewport_size({"width": width, "height": 900})
            assert page.evaluate("() => document.documentElement.scrollWidth - window.innerWidth") <= 0, width
            found = [one for one in Axe().run(page).response["violations"] if one["impact"] not in BEARABLE]
            assert not found, found


def test_random_use_keeps_the_memory(bench: Bench) -> None:
    """What a person may do, in an order that FLUORSPAR_RANDOM_SEED gives, for FLUORSPAR_RANDOM_SECONDS."""
    page = bench.page
    seconds, seed = (float(os.environ.get(f"FLUORSPAR_RANDOM_{name}", default)) for name, default in (("SECONDS", 20), ("SEED", 1)))
    dice = random.Random(seed)
    bench.picture(after=0)

    def press(name: str) -> None:
        """As a person would: only what is there at that moment."""
        page.locator(f"#{name}").evaluate("button => button.offsetParent && button.click()")

    def one_of(selector: str):
        return page.locator(f"{selector}:visible").nth(dice.randrange(page.locator(f"{selector}:visible").count()))

    def checked(group: str):
        return lambda: one_of(f"#{group} label").click()

    def slide() -> None:
        slider = one_of(".control input[type=range]")
        for _ in range(dice.randrange(1, 6)):
            slider.evaluate("(slider, value) => { slider.value = value; slider.dispatchEvent(new Event('input')); }", str(dice.randrange(1001)))
        slider.evaluate("slider => slider.dispatchEvent(new Event('change'))")

    def choose() -> None:
        choice = one_of(".control select")
        choice.select_option(index=dice.randrange(choice.locator("option").count()))

    def drawn() -> None:
        page.locator("#tools input[value=rectangle]").check(force=True)
        bench.drag(*sorted((dice.uniform(0.1, 0.9), dice.uniform(0.1, 0.9)) for _ in range(2)))

    def turned() -> None:
        page.locator("#tools input[value=orbit]").check(force=True)
        for _ in range(dice.randrange(1, 8)):
            page.locator("#orbit").press(dice.choice(["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "+", "-", "Home", "Enter"]))
        page.locator("#views label").first.click()

    def typed(path: str, value: str) -> None:
        page.locator("#any input[name=path]").fill(path)
        page.locator("#any input[name=value]").fill(value)
        page.locator("#any button").click()

    def rendered() -> None:
        typed("mouth.person", str(dice.randrange(3)))
        page.wait_for_timeout(dice.randrange(1500))
        press("veil-stop")

    def compared() -> None:
        for name in ("keep", "swap", "forget"):
            press(name)

    def told() -> None:
        page.locator("#findings-fold summary").first.click()
        page.wait_for_timeout(dice.randrange(2500))

    def looked_at_photographs() -> None:
        page.locator("#go-photographs").click()
        page.locator("#go-simulation").click()

    acts = [checked("captures"), checked("views"), slide, slide, slide, choose, drawn, turned, compared, told, looked_at_photographs, rendered,
            lambda: press("undo"), lambda: press("redo"), lambda: press("reset"), lambda: typed("lens.f_number", dice.choice(["2.0", "no number", "-1", "8"]))]

    def rest() -> int:
        """Goes back to the beginning, and tells the memory of the server, bytes."""
        page.locator("#findings-fold").evaluate("fold => (fold.open = false)")
        page.locator("#tools input[value=off]").check(force=True)
        # What is kept of scenes is that of the same ones each time
        for person in ("1", "2"):
            press("reset")
            before = bench.serial()
            typed("mouth.person", person)
            bench.rest(before)
            page.locator("#veil").wait_for(state="hidden", timeout=WAIT)
        press("reset")
        bench.rest(-1)
        bench.estimate()
        page.wait_for_timeout(2000)
        status = Path(f"/proc/{bench.process.pid}/status").read_text()
        return 1024 * int(next(line for line in status.splitlines() if line.startswith("VmRSS")).split()[1])

    # What is kept is kept after each kind of act, and some time
    for act in acts * 2:
        act()
    seen = [rest()]
    for _ in range(4):
        until = time.monotonic() + seconds / 4
        while time.monotonic() < until:
            dice.choice(acts)()
            page.wait_for_timeout(dice.randrange(300))
        seen.append(rest())
    print("memory, MB:", *(round(bytes / 1e6) for bytes in seen))
    # Of few acts each may be the first of its kind
    assert seen[-1] < max(seen[1:3]) * (1.05 if seconds > 500 else 1.3), seen
    # The console tells of what was refused
    bench.errors[:] = [error for error in bench.errors if "422" not in error]


def test_nothing_stands_in_anybodys_way(bench: Bench) -> None:
    page = bench.page
    bench.picture(after=0)
    bench.estimate()
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        for width in (390, 1280, 2560):
            page.set_viewport_size({"width": width, "height": 900})
            wide = page.evaluate("() => document.documentElement.scrollWidth - window.innerWidth")
            assert wide <= 0, f"{wide} px too wide at {width}"
            # The content policy forbids axe to be loaded as a script: it is evaluated
            found = Axe().run(page).response["violations"]
            serious = [f"{one['id']}: {one['help']} {[node['target'] for node in one['nodes']][:3]}"
                       for one in found if one["impact"] not in BEARABLE]
            assert not serious, f"{scheme} {width}: {serious}"


def run_of(program: str, folder: Path) -> Path:
    """A small run, made once."""
    out = folder / "run"
    subprocess.run([program, "run", "-q", "oraleye-2021", *SMALL, "--out", str(out)], check=True, stdout=subprocess.DEVNULL)
    return out


def designs_of(program: str, folder: Path) -> Path:
    """A search of designs."""
    out = folder / "designs"
    subprocess.run([program, "design", "optimize", "two-lights", "-q", "--out", str(out)], check=True, stdout=subprocess.DEVNULL)
    return out


def chromium() -> str:
    found = [shutil.which(name) for name in ("chromium", "chromium-browser", "google-chrome")]
    return next(path for path in found if path)


def main() -> None:
    program, *wanted = sys.argv[1:]
    tests = {name: test for name, test in globals().items() if name.startswith("test_")}
    unknown = [name for name in wanted if name not in tests]
    assert not unknown, f"no such test: {unknown}; there are {', '.join(tests)}"
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        run, designs = run_of(program, folder), designs_of(program, folder)
        browser = playwright.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        for test_name in wanted or tests:
            begun = time.monotonic()
            with contextlib.closing(browser.new_context(viewport={"width": 1280, "height": 900})) as context:
                bench = Bench(program, context.new_page(), [str(designs if "design" in test_name else run)], has_tour="tour" in test_name)
                try:
                    tests[test_name](bench)
                except BaseException:
                    bench.page.screenshot(path="/tmp/fluorspar-browser.png", full_page=True)
                    print(f"{test_name} failed; /tmp/fluorspar-browser.png shows the page; errors there: {set(bench.errors)}")
                    bench.process.terminate()
                    raise
                bench.close()
            print(f"{test_name} ok, {time.monotonic() - begun:.1f} s")
        browser.close()


if __name__ == "__main__":
    main()
