#!/usr/bin/env python3
"""How fast the workbench answers, seen from a Chromium: pictures per second while a control is dragged, and the first picture.

    benchmarks/measure_workbench.py [--runs 3] [--seconds 4] [--experiment oraleye-2021] [--binary target/release/fluorspar]

Printed are medians of the runs, as rows of a table of docs/performance.md. Pictures are counted by the serial number that the page
gives each one it has drawn.

Needs Python 3.9 or newer with `playwright`, a Chromium, and a Unix system.
"""
import argparse
import contextlib
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

from playwright.sync_api import sync_playwright

ROOT = pathlib.Path(__file__).resolve().parent.parent
SHOWN = "() => Number(document.querySelector('#picture').dataset.serial ?? 0) > 0"
RESTING = "() => document.querySelector('#viewport').matches('[aria-busy=false]:not(.stale)')"
#: Moves a slider to and fro for some seconds, and counts the pictures that were shown.
DRAG = """async (slider, seconds) => {
    const serial = () => Number(document.querySelector('#picture').dataset.serial);
    const [low, high] = [Number(slider.min), Number(slider.max)];
    slider.dispatchEvent(new PointerEvent('pointerdown'));
    const [begun, before] = [performance.now(), serial()];
    for (let at = 0; performance.now() - begun < 1000 * seconds; at++) {
        slider.value = String(low + (high - low) * (0.4 + 0.2 * Math.sin(at / 7)));
        slider.dispatchEvent(new Event('input'));
        await new Promise(requestAnimationFrame);
    }
    const [rate, canvas] = [1000 * (serial() - before) / (performance.now() - begun), document.querySelector('#picture')];
    const found = [rate, canvas.width, canvas.height];
    slider.dispatchEvent(new Event('change'));
    return found;
}"""
#: Chooses each entry of a list in turn as soon as the last one is shown.
CHOOSE = """async (list, seconds) => {
    const serial = () => Number(document.querySelector('#picture').dataset.serial);
    const values = [...list.options].map((option) => option.value).filter((value) => value !== '').slice(0, 6);
    const [begun, first] = [performance.now(), serial()];
    for (let at = 0; performance.now() - begun < 1000 * seconds; at++) {
        const before = serial();
        list.value = values[at % values.length];
        list.dispatchEvent(new Event('change'));
        while (serial() === before && performance.now() - begun < 1000 * seconds) await new Promise(requestAnimationFrame);
    }
    const canvas = document.querySelector('#picture');
    return [1000 * (serial() - first) / (performance.now() - begun), canvas.width, canvas.height];
}"""
#: Turns the shapes.
TURN = """async (canvas, seconds) => {
    const serial = () => Number(canvas.dataset.serial ?? 0);
    const press = () => canvas.dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowRight', bubbles: true }));
    const [begun, before] = [performance.now(), serial()];
    while (performance.now() - begun < 1000 * seconds) {
        press();
        await new Promise(requestAnimationFrame);
    }
    return [1000 * (serial() - before) / (performance.now() - begun), canvas.width, canvas.height];
}"""


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=3, help="measurements of each kind, 1 or more (default 3)")
    parser.add_argument("--seconds", type=float, default=4.0, help="length of a drag (default 4)")
    parser.add_argument("--experiment", default="oraleye-2021", help="an experiment with the controls of oraleye-2021")
    parser.add_argument("--binary", help="fluorspar, if it is built already")
    return parser.parse_args()


def our_program(options):
    if options.binary:
        return os.path.abspath(options.binary)
    subprocess.run(["cargo", "build", "--release", "-p", "fluorspar-cli"], cwd=ROOT, check=True)
    return str(pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release" / "fluorspar")


def chromium():
    found = [shutil.which(name) for name in ("chromium", "chromium-browser", "google-chrome")]
    return next((path for path in found if path), None) or sys.exit("no Chromium: .ci/install_chromium installs one")


class Bench:
    """A workbench and a page on it."""

    def __init__(self, program, browser, subject):
        begun = time.monotonic()
        self.process = subprocess.Popen([program, "workbench", "-q", *subject], stdout=subprocess.PIPE, text=True)
        address = self.process.stdout.readline().strip()
        self.context = browser.new_context(viewport={"width": 1280, "height": 900})
        self.context.add_cookies([{"name": "fluorspar_tour", "value": "seen", "domain": "127.0.0.1", "path": "/"}])
        self.page = self.context.new_page()
        self.page.goto(address)
        self.page.wait_for_function(SHOWN, timeout=120_000)
        self.first_s = time.monotonic() - begun
        self.rest()

    def rest(self):
        self.page.wait_for_function(RESTING, timeout=300_000)

    def control(self, name):
        return self.page.locator(".control:visible", has_text=name)

    def close(self):
        self.context.close()
        self.process.terminate()
        self.process.wait()


def rates(bench, seconds):
    """Pictures per second by what is changed, and columns and rows of the last one."""
    page = bench.page
    sliders = {"drive": "light_groups.blue", "exposure": "exposure_ms", "concentration": "concentration."}
    lists = {"viewing filter": "view_filter.filters", "sensor": "sensor.preset"}
    page.get_by_role("radio", name="blue", exact=True).check(force=True)
    bench.rest()
    found = {}
    for name, control in sliders.items():
        found[name] = bench.control(control).locator("input[type=range]").first.evaluate(DRAG, seconds)
        bench.rest()
        page.locator("#reset").click()
        bench.rest()
    for name, control in lists.items():
        found[name] = bench.control(control).locator("select").evaluate(CHOOSE, seconds)
        bench.rest()
        page.locator("#reset").click()
        bench.rest()
    page.get_by_role("radio", name="Turn in 3-D").check(force=True)
    page.wait_for_timeout(1500)
    found["3-D"] = page.locator("#orbit").evaluate(TURN, seconds)
    return found


def main():
    options = arguments()
    program = our_program(options)
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = pathlib.Path(name)
        subprocess.run([program, "run", "-q", options.experiment, "--out", folder / "run"], check=True, stdout=subprocess.DEVNULL)
        browser = playwright.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        firsts, of_experiment, found = [], [], []
        for _ in range(options.runs):
            with contextlib.closing(Bench(program, browser, [folder / "run"])) as bench:
                firsts.append(bench.first_s)
                found.append(rates(bench, options.seconds))
            with contextlib.closing(Bench(program, browser, [options.experiment])) as bench:
                of_experiment.append(bench.first_s)
        browser.close()
    print("| what | measured |\n|---|---|")
    print(f"| first picture of a finished run; of an experiment | {statistics.median(firsts):.2f} s; {statistics.median(of_experiment):.2f} s |")
    for name in found[0]:
        rate, width, height = (statistics.median(values) for values in zip(*(run[name] for run in found)))
        print(f"| {name} | {rate:.1f} per second, {width:.0f} x {height:.0f} px |")


if __name__ == "__main__":
    main()
