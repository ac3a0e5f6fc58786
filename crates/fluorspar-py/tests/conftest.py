"""What several tests need: a small render of a mouth, and the program."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

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
def program():
    """Runs the program that came with the package, and returns what it printed."""

    def run(*words: object, folder: Path | None = None) -> str:
        path = shutil.which("fluorspar", path=str(Path(sys.executable).parent))
        start = [path] if path else [sys.executable, "-m", "fluorspar"]
        done = subprocess.run([*start, *map(str, words)], capture_output=True, text=True, cwd=folder)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run
