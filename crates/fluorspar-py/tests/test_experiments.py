"""Experiments from names, texts and dictionaries; their errors; pickles."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import fluorspar as fs


def test_changes_make_other_experiments_and_are_read_back(mouth: fs.Experiment) -> None:
    changed = mouth.set("light.blue.strength.power_mw", np.float64(123.5)).set("capture.*.exposure_ms", 7)
    assert changed.get("light.blue.strength.power_mw") == 123.5
    assert mouth.get("light.blue.strength.power_mw") != 123.5
    exposures = changed.get("capture.*.exposure_ms")
    assert set(exposures.values()) == {7.0} and len(exposures) == 3
    assert changed.sha256 != mouth.sha256
    again = mouth.with_(light={"blue": {"strength": {"power_mw": 123.5}}}).set("capture.*.exposure_ms", 7)
    assert again == changed


@pytest.mark.parametrize(
    ("path", "value", "field", "text"),
    [
        ("light.blue.strength.power_mw", -1, "power_mw", "must be"),
        ("light.blue.spectrum", "led_386", "spectrum", "led_385"),
        ("render.samples_per_pixel", "many", "samples_per_pixel", ""),
        ("sensor.no_such_field", 1, "no_such_field", ""),
    ],
)
def test_errors_say_what_where_and_how_to_fix_it(mouth, path, value, field, text) -> None:
    with pytest.raises(fs.ExperimentError) as raised:
        mouth.set(path, value).check()
    error = raised.value
    assert text in error.message and field in str(error)
    assert isinstance(error, fs.FluorsparError)


def test_a_value_that_no_experiment_has_is_named(mouth: fs.Experiment) -> None:
    with pytest.raises(TypeError, match="light.blue.strength.power_mw: a complex"):
        mouth.set("light.blue.strength.power_mw", 1j)


def test_unknown_names_come_with_the_nearest(tmp_path) -> None:
    with pytest.raises(fs.FluorsparError, match="oraleye-2021"):
        fs.experiment("oraleye-2012")
    with pytest.raises(FileNotFoundError, match="nothing.toml"):
        fs.load(tmp_path / "nothing.toml")


def test_a_dictionary_is_an_experiment() -> None:
    experiment = fs.experiment({"format": 1, "base": "flat-patch", "render": {"samples_per_pixel": 3}})
    assert experiment.get("render.samples_per_pixel") == 3
    with pytest.raises(fs.ExperimentError) as raised:
        fs.experiment({"format": 1, "base": "flat-patch", "render": {"sample_per_pixel": 3}})
    assert "samples_per_pixel" in raised.value.message


def test_pickles_are_the_same_experiment(mouth: fs.Experiment) -> None:
    changed = mouth.set("render.seed", 5)
    again = pickle.loads(pickle.dumps(changed))
    assert again == changed and again.changes == changed.changes


def test_a_saved_experiment_is_the_same(mouth: fs.Experiment, tmp_path) -> None:
    mouth.save(tmp_path / "mouth.toml")
    assert fs.load(tmp_path / "mouth.toml") == mouth
    with pytest.raises(FileExistsError):
        mouth.save(tmp_path / "mouth.toml")


def test_the_tree_names_lights_and_parts(mouth: fs.Experiment) -> None:
    kinds = {path: kind for path, kind, _ in mouth.tree()}
    assert kinds["light.blue"] == "light" and kinds["tongue_dorsum/"] == "part"
