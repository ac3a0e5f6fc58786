"""Every example in a docstring runs."""

from __future__ import annotations

import ast
import inspect
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluorspar as fs


def examples(thing: Any) -> list[str]:
    """Calls that a docstring shows in double backticks."""
    found = []
    for span in re.findall(r"``(.+?)``", inspect.getdoc(thing) or "", flags=re.DOTALL):
        code = " ".join(span.split())
        try:
            tree = ast.parse(code, mode="eval")
        except SyntaxError:
            continue
        if any(isinstance(node, ast.Call) for node in ast.walk(tree)):
            found.append(code)
    return found


def documented() -> Iterator[tuple[str, str]]:
    """Names of what is public, methods as CLASS.NAME, with each of their examples."""
    for name in fs.__all__:
        thing = getattr(fs, name)
        if not callable(thing):
            continue
        yield from ((name, code) for code in examples(thing))
        if inspect.isclass(thing):
            methods = [key for key in dir(thing) if not key.startswith("_")]
            yield from ((f"{name}.{key}", code) for key in methods for code in examples(getattr(thing, key)))


@pytest.fixture(scope="session")
def folder(mouth, components, camera_frames, photographs, tmp_path_factory) -> Path:
    """A folder with the files that examples name."""
    folder = tmp_path_factory.mktemp("examples")
    shutil.copytree(camera_frames, folder, dirs_exist_ok=True)
    shutil.copytree(photographs, folder, dirs_exist_ok=True)
    study = fs.Study.init(folder / "gums", folder / "camera.toml", site="north")
    study.import_(folder / "photos", subjects=folder / "people.csv")
    study.analyze()
    norm = study.norm(quantity="chromaticity_r", out=folder / "norm.json").norm
    norm["logs"], norm["studies"] = ["another"], ["another"]
    norm["sums"]["sites"][0]["site"] = "south"
    (folder / "south.json").write_text(json.dumps(norm))
    simulated = [f"{person},tongue_dorsum,,,chromaticity_r,0,0.{person:02}1" for person in range(1, 13)]
    (folder / "cohort.csv").write_text("\n".join(["person,part,channel,name,quantity,has_lesion_here,value", *simulated]) + "\n")
    light = fs.predict("tongue-385nm")
    rows = zip(light.wavelength_nm, light.radiance.total, strict=True)
    table = "wavelength_nm,total\n" + "".join(f"{nm},{value}\n" for nm, value in rows)
    (folder / "measured.csv").write_text(table)
    (folder / "my_led.csv").write_text("wavelength_nm,power\n380,0\n385,1\n390,0\n")
    (folder / "cohort.toml").write_text(
        'format = 1\nbase = "oraleye-2021-surface"\n[people]\ncount = 1\nviews = ["lips"]\n'
        "[render]\nwidth_px = 16\nheight_px = 12\nsamples_per_pixel = 1\n[mouth]\ndetail = 0.25\n"
    )
    fs.capture(mouth, components)["blue"].write(folder / "photo.tiff")
    # As a camera gives it, without a description
    next(folder.glob("photo*.json")).unlink()
    small = fs.experiment("flat-patch")
    for path, value in {"render.width_px": 16, "render.height_px": 12, "sensor.columns": 32, "sensor.rows": 24}.items():
        small = small.set(path, value)
    fs.run(small, folder / "fluorspar-out" / "a", spp=1)
    fs.run(small.set("light.blue.spectrum", "led_405"), folder / "fluorspar-out" / "b", spp=1)
    return folder


@pytest.mark.parametrize(("name", "code"), list(documented()), ids=lambda text: text)
def test_an_example_runs(name, code, mouth, components, folder, monkeypatch) -> None:
    monkeypatch.chdir(folder)
    e, c = mouth, components
    names: dict[str, Any] = {**vars(fs), "e": e, "c": c, "path": "capture.blue.gain", "value": 2}
    names["table"] = fs.Study("gums").query()
    owners = {"Study": fs.Study("gums"), "Table": names["table"], "Tissue": fs.tissue("lip"), "Mouth": fs.mouth(person=7, detail=0.3), "Components": c, "Experiment": e}
    owner, _, method = name.partition(".")
    if method:
        instance = owners.get(owner) or (fs.light("led_385") if hasattr(getattr(fs, owner), "plot") else None)
        names |= {key: getattr(instance, key) for key in dir(instance) if not key.startswith("_")}
    if "(a)" in code:
        names["a"] = fs.analyze(e, fs.capture(e, c), components=c)
    if "out=" in code or ".svg" in code:
        code = re.sub(r'"(two|chain\.svg|led\.svg)"', lambda match: f'"{owner}-{match[1]}"', code)
    with np.errstate(all="ignore"):
        eval(code, names)  # noqa: S307
