"""What several tests need: a small render of a mouth, and the program."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import fluorspar as fs

TINY = {"render.width_px": 32, "render.height_px": 24, "render.samples_per_pixel": 1}


@pytest.fixture(scope="session")
def mouth() -> fs.Experiment:
    experiment = fs.experiment("oraleye-2021-surface")
    for path, value in TINY.items():
        experiment = experiment.set(path, value)
    return experiment


@pytest.fixture(scope="session")
def components(mouth: fs.Experiment) -> fs.Components:
    return fs.render(mouth, progress=None)


@pytest.fixture(scope="session")
def camera_frames(tmp_path_factory) -> Path:
    """A folder with calibration.toml and the frames that it names."""
    folder = tmp_path_factory.mktemp("camera")
    sheet = (
        'format = 1\nbase = "flat-patch"\nunset = ["capture", "analysis", "material.patch.concentrations"]\n[view_filter]\nfilters = []\n'
        "[render]\nwidth_px = 16\nheight_px = 12\nsamples_per_pixel = 2\n[sensor]\ncolumns = 48\nrows = 36\n"
    )
    (folder / "sheet.toml").write_text(sheet + '[[capture]]\nname = "blue"\nlight_groups = { blue = 1.0 }\n')
    shots = [("dark", "", ms, n) for ms in (0.01, 2000.0) for n in range(4)]
    shots += [("flat", "blue = 1.0", ms, n) for ms in (0.02, 0.05, 0.1, 0.15) for n in range(4)]
    captures = [
        f'[[capture]]\nname = "{kind}_{ms}_{n}"\nexposure_ms = {ms}\nlight_groups = {{ {light} }}\n' for kind, light, ms, n in shots
    ]
    (folder / "shoot.toml").write_text(sheet + "".join(captures))
    fs.text_of("render", folder / "shoot.toml", components=True, out=folder / "shoot.exr")
    fs.text_of("capture", folder / "shoot.exr", out=folder / "shot")
    for kind in ("dark", "flat"):
        (folder / kind).mkdir()
        for file in (folder / "shot").glob(f"raw_{kind}_*"):
            shutil.copy(file, folder / kind)
    (folder / "calibration.toml").write_text(
        'format = 1\nexperiment = "sheet.toml"\ndark = "dark"\nflat = "flat"\n[[target]]\nname = "tile"\n'
        'frames = ["flat/raw_flat_0.1_0.tiff", "flat/raw_flat_0.1_1.tiff"]\ncapture = "blue"\nreflectance = "tongue_dorsum"\nuncertainty_percent = 2\n'
    )
    return folder


@pytest.fixture(scope="session")
def photographs(tmp_path_factory) -> Path:
    """A folder with camera.toml, photographs of twelve people in photos with their table, people.csv,
    and how the one of P09 looks in shown.npy."""
    folder = tmp_path_factory.mktemp("people")
    camera = fs.experiment("flat-patch").with_(
        render={"width_px": 16, "height_px": 12, "samples_per_pixel": 1}, sensor={"columns": 32, "rows": 24}
    )
    camera.save(folder / "camera.toml")
    (folder / "photos").mkdir()
    components = fs.render(camera, progress=None)
    rows, people = ["patient,capture,frame,region,where,verdict"], ["subject,age,consent"]
    for person in range(1, 13):
        held = camera.set("concentration.protoporphyrin_ix", (4 + 5 * person % 13) / 10)
        shots = fs.capture(held, components)
        for name in ("ambient", "blue"):
            shots[name].write(folder / f"photos/P{person:02}_{name}.tiff")
        if held.get("concentration.protoporphyrin_ix") == 1.0:
            np.save(folder / "shown.npy", shots["blue"].preview)
        rows.append(f'P{person:02},blue,P{person:02}_blue.tiff,tongue,"8,6,16,12",right')
        rows.append(f"P{person:02},ambient,P{person:02}_ambient.tiff,,,")
        people.append(f"P{person:02},{30 + 7 * person % 12},yes")
    (folder / "photos/photographs.csv").write_text("\n".join(rows) + "\n")
    (folder / "people.csv").write_text("\n".join(people) + "\n")
    return folder


@pytest.fixture(scope="session")
def program():
    """Runs the program that came with the package, and returns what it printed."""

    def run(*words: object, folder: Path | None = None) -> str:
        path = shutil.which("fluorspar", path=str(Path(sys.executable).parent))
        start = [path] if path else [sys.executable, "-m", "fluorspar"]
        done = subprocess.run([*start, *map(str, words)], capture_output=True, text=True, cwd=folder)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run
