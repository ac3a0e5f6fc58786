"""Every public name is documented, and the library loads late in a process, too."""

from __future__ import annotations

import inspect
import os
import platform
import subprocess
import sys

import numpy as np
import pytest

import fluorspar as fs


def test_every_public_name_is_documented() -> None:
    lacking = []
    for name in fs.__all__:
        value = getattr(fs, name)
        if name == "__version__":
            continue
        if not inspect.getdoc(value):
            lacking.append(name)
        if inspect.isclass(value):
            own = [item for item in vars(value) if not item.startswith("_")]
            lacking += [f"{name}.{item}" for item in own if not inspect.getdoc(getattr(value, item))]
    assert not lacking


def test_arrays_are_documented_with_their_axes() -> None:
    for thing in [fs.Components, fs.Frame, fs.Analysis]:
        for name, item in vars(thing).items():
            if isinstance(item, property) and "NDArray" in str(item.fget.__annotations__["return"]):
                text = inspect.getdoc(item)
                assert "``[" in text and any(kind in text for kind in ("float", "uint")), f"{thing.__name__}.{name}"
    for thing in [fs.Mesh, fs.ExperimentError, fs.analyze, fs.sweep, fs.render]:
        assert len(inspect.getdoc(thing)) > 300, thing


def test_arguments_of_the_wrong_type_are_told_with_what_belongs_there(mouth, components, tmp_path) -> None:
    shots = fs.capture(mouth, components)
    calls = {
        "experiment": [
            lambda: fs.render("oraleye-2021"),
            lambda: fs.capture(None, components),
            lambda: fs.analyze(3, shots),
            lambda: fs.sweep("e", {"capture.blue.gain": [1]}),
            lambda: components.planes(mouth.toml, "blue"),
        ],
        "components": [
            lambda: fs.capture(mouth, "c.exr"),
            lambda: fs.analyze(mouth, shots, components=components.radiance),
            lambda: fs.sweep(mouth, {"capture.blue.gain": [1]}, components=3),
        ],
        "frames": [lambda: fs.analyze(mouth, 3), lambda: fs.analyze(mouth, "blue"), lambda: fs.analyze(mouth, [1])],
        "source": [lambda: fs.experiment(3), lambda: fs.experiment(None), lambda: fs.safety(3), lambda: fs.run({}, tmp_path)],
        "path": [
            lambda: fs.load(3),
            lambda: fs.read(3),
            lambda: fs.Frame.read(None),
            lambda: fs.Mesh.read(b"m.ply"),
            lambda: mouth.set(3, 3),
            lambda: mouth.get(None),
            lambda: mouth.unset(3),
            lambda: mouth.save(3),
            lambda: components.write(3),
            lambda: shots["blue"].write(3),
        ],
        "name": [lambda: fs.tissue(3), lambda: components.part_mask(3)],
        "label": [lambda: components.component(3)],
        "capture": [lambda: components.planes(mouth, 3)],
        "weights": [lambda: components.weighted(3), lambda: components.weighted({"blue": "x"})],
        "threads": [lambda: fs.render(mouth, threads="2"), lambda: fs.capture(mouth, components, threads=1.5)],
        "error": [lambda: fs.render(mouth, error="0.1")],
        "samples_per_pixel": [lambda: fs.render(mouth, samples_per_pixel=1.5)],
        "time_limit_s": [lambda: fs.render(mouth, time_limit_s="3")],
        "progress": [lambda: fs.render(mouth, progress=3)],
        "result": [lambda: fs.sweep(mouth, {"capture.blue.gain": [1]}, components=components, result=3)],
        "person": [lambda: fs.mouth(person="7")],
        "words": [lambda: fs.command(None)],
    }
    for name, all_of_it in calls.items():
        for number, call in enumerate(all_of_it):
            with pytest.raises(TypeError, match=rf"^{name}\b.*: give .*, not (the \w+|None)"):
                call()
                raise AssertionError(f"{name}, call {number}")


def test_numbers_of_numpy_are_numbers(mouth, components) -> None:
    weighted = components.weighted({"blue": np.float32(0.5)})
    assert np.array_equal(weighted, components.weighted({"blue": 0.5}))
    assert np.array_equal(weighted, components.weighted({"blue": np.array(0.5)}))
    for wrong in (np.nan, np.inf, 1e39):
        with pytest.raises(ValueError, match=r"weights\['blue'\]"):
            components.weighted({"blue": wrong})
    with pytest.raises(ValueError, match="person"):
        fs.mouth(person=-1)
    with pytest.raises(ValueError, match="time_limit"):
        fs.run("oraleye-2021-surface", "out", time_limit=np.longdouble(-1))
    exposure = "capture.blue.exposure_ms"
    assert mouth.set(exposure, np.longdouble(12)).get(exposure) == 12
    assert fs.mouth(missing_teeth=np.array([18, 28])).parameters == fs.mouth(missing_teeth=(18, 28)).parameters
    endless: list[object] = []
    endless.append(endless)
    for wrong, told in [(endless, "itself"), (np.clongdouble(1), "clongdouble"), ({3: 4}, "text as key")]:
        with pytest.raises(TypeError, match=told):
            mouth.set(exposure, wrong)
    assert fs.render(mouth, samples_per_pixel=np.int64(1), threads=np.int32(1), progress=None).samples_per_pixel == 1


def test_unknown_names_are_one_error_that_lists_each_known_one_once(mouth, components) -> None:
    shots = fs.capture(mouth, components)
    for call, known in [
        (lambda: components.weighted({"bleu": 1.0}), "blue, white, blue.reflected"),
        (lambda: components.component("bleu"), "blue.reflected"),
        (lambda: components.planes(mouth, "bleu"), "ambient, white, blue"),
        (lambda: components.part_mask("tongue"), "tongue_dorsum"),
        (lambda: shots["bleu"], "ambient, white, blue"),
    ]:
        with pytest.raises(fs.UnknownName) as raised:
            call()
        told = str(raised.value)
        assert isinstance(raised.value, (KeyError, fs.FluorsparError)) and told.startswith("there is no ") and known in told
        names = told.split("there are ")[1].split(", ")
        assert len(names) == len(set(names))


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="a setting of glibc")
def test_the_library_needs_no_static_thread_storage() -> None:
    """Libraries that a process loaded before may have used it up; then one that needs it can't be imported."""
    none_left = os.environ | {"GLIBC_TUNABLES": "glibc.rtld.optional_static_tls=0"}
    subprocess.run([sys.executable, "-c", "import fluorspar"], env=none_left, check=True)
