"""Experiments from names, texts and dictionaries; their errors; pickles."""

from __future__ import annotations

import pickle
import tomllib
from pathlib import Path

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


def test_errors_know_what_could_stand_there(mouth: fs.Experiment) -> None:
    for path, value, name in [
        ("light.blue.spectrum", "led_386", "led_385"),
        ("analysis.frame", "bleu", "blue"),
        ("sensor.no_such_field", 1, "read_noise_e"),
        ("base", "oraleye-2012", "oraleye-2021"),
    ]:
        with pytest.raises(fs.ExperimentError) as raised:
            (mouth.set(path, value) if path != "base" else fs.experiment({"format": 1, "base": value})).check()
        assert name in raised.value.known and raised.value.message.endswith(", ".join(raised.value.known))
    with pytest.raises(fs.ExperimentError) as raised:
        mouth.set("light.blue.strength.power_mw", -1).check()
    assert raised.value.known == []


@pytest.mark.parametrize(
    ("path", "value", "field"),
    [
        ("light.blue.strength.power_mw", -1, "light.blue.strength.power_mw"),
        ("light.blue.spectrum", "led_386", "light.blue.spectrum"),
        ("light.blue.spectrum", {"csv": "nothing.csv"}, "light.blue.spectrum"),
        ("render.samples", 4, "render.samples"),
        ("render.width_px", 0, "render.width_px"),
        ("capture.blue.filters", ["long_pass_476"], "capture.blue.filters[0]"),
        ("capture.bleu.gain", 2, "capture.bleu.gain"),
        ("mouth.jaw_opening_mm", 500, "mouth.jaw_opening_mm"),
        ("lens.f_number", 0, "lens.f_number"),
        ("analysis.frame", "bleu", "analysis.frame"),
    ],
)
def test_what_is_wrong_is_told_when_an_experiment_is_made(mouth, path, value, field) -> None:
    """In the words of the check, with the whole path of the field; a file with the same value is refused alike."""
    with pytest.raises(fs.ExperimentError) as raised:
        mouth.set(path, value)
    assert (raised.value.field, raised.value.code) == (field, 2)
    assert raised.value.path.startswith(f"--set {path}=")
    section, *rest = path.split(".")
    for key in reversed(rest):
        value = {key: value}
    if "capture.bleu" not in path:
        with pytest.raises(fs.ExperimentError) as of_dict:
            fs.experiment({"format": 1, "base": "oraleye-2021-surface", section: value})
        told = of_dict.value
        assert (told.field, told.message, told.known) == (field, raised.value.message, raised.value.known)
        assert told.path == "dict" and told.line is not None and "nothing.csv" in str(told) or field != "light.blue.spectrum" or told.known


def test_values_that_belong_together_change_together(mouth: fs.Experiment) -> None:
    blackbody = {"type": "blackbody", "temperature_k": 3000.0}
    by_irradiance = {"irradiance_w_per_m2": 3.0, "at_distance_mm": 50.0}
    changed = mouth.with_(light={"blue": {"strength": by_irradiance, "spectrum": blackbody}})
    assert changed.get("light.blue.strength") == by_irradiance
    assert changed.get("light.blue.spectrum").items() >= blackbody.items()
    with pytest.raises(fs.ExperimentError) as raised:
        mouth.with_(light={"blue": {"spectrum": {"csv": "nothing.csv"}}})
    assert "nothing.csv" in raised.value.message


def test_the_nearest_size_in_whole_pixels_is_no_other_shape(mouth: fs.Experiment) -> None:
    def odd(height: int) -> list[str]:
        return [text for text in mouth.with_(render={"width_px": 31, "height_px": height}).check() if "as wide as high" in text]

    assert odd(24)[0].endswith("Give render.height_px = 23") and not odd(23)


def test_a_value_that_no_experiment_has_is_named(mouth: fs.Experiment) -> None:
    with pytest.raises(TypeError, match="light.blue.strength.power_mw: a complex"):
        mouth.set("light.blue.strength.power_mw", 1j)


def test_unknown_names_come_with_the_nearest(tmp_path) -> None:
    with pytest.raises(fs.FluorsparError, match="oraleye-2021"):
        fs.experiment("oraleye-2012")
    reads = [fs.load, fs.experiment, fs.read, fs.Frame.read, fs.Mesh.read, fs.safety]
    for read in reads:
        with pytest.raises(FileNotFoundError, match="nothing.toml: there is no such file") as raised:
            read(tmp_path / "nothing.toml")
        assert isinstance(raised.value, fs.FluorsparError) and raised.value.code == 2


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


def test_what_a_base_says_is_taken_away(mouth: fs.Experiment) -> None:
    without = mouth.unset("analysis").unset("capture.white")
    assert "capture.white" not in {path for path, _, _ in without.tree()}
    with pytest.raises(fs.ExperimentError):
        mouth.unset("capture.whit").check()


def test_lists_of_what_has_names_may_be_dictionaries() -> None:
    by_name = {"format": 1, "base": "oraleye-2021-surface", "light": {"blue": {"spectrum": "led_405"}}}
    listed = {**by_name, "light": [{"name": "blue", "spectrum": "led_405"}]}
    assert fs.experiment(by_name) == fs.experiment(listed)
    assert fs.experiment(by_name).get("light.blue.spectrum") == "led_405"
    with pytest.raises(ValueError, match="light.blue: its name is 'white'"):
        fs.experiment({**by_name, "light": {"blue": {"name": "white"}}})
    with pytest.raises(TypeError, match="light.blue: give a dictionary"):
        fs.experiment({**by_name, "light": {"blue": "led_405"}})


BAD = Path(__file__).parents[2] / "fluorspar-experiment/tests/bad_experiments"


def _stated(text: str) -> tuple[str, list[str]]:
    """The message that a bad experiment states, and the changes that it asks for."""
    lines = text.splitlines()
    changes = [line.removeprefix("# set: ") for line in lines if line.startswith("# set: ")]
    return lines[0].removeprefix("# error: ").replace("{folder}", str(BAD)), changes


@pytest.mark.parametrize("path", sorted(path for path in BAD.glob("*.toml") if not path.name.startswith("sample_")), ids=lambda path: path.stem)
def test_bad_experiments_raise_their_message(path: Path, monkeypatch) -> None:
    text = path.read_text()
    message, changes = _stated(text)
    with pytest.raises(fs.ExperimentError) as raised:
        fs._fluorspar.Experiment.of_text(text, path.name, BAD, changes).check()
    assert str(raised.value) == message

    # As a dictionary: the same words about the same field, without a file and a line
    try:
        sections = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return
    if path.stem in {"render_number_too_large", "set_without_equals", "format_missing"}:
        # Python has no such number in an experiment and no such change; the message names lines
        return
    monkeypatch.chdir(BAD)
    with pytest.raises(fs.ExperimentError) as of_dict:
        experiment = fs.experiment(sections)
        for change in changes:
            if change.startswith("unset "):
                experiment = experiment.unset(change.removeprefix("unset "))
            else:
                name, value = change.split("=", 1)
                experiment = experiment.set(name, _plain(value))
        experiment.check()
    told, expected = of_dict.value, raised.value
    assert (told.entry, told.field, told.message) == (expected.entry, expected.field, expected.message)


def test_numbers_that_no_experiment_holds_are_named(mouth: fs.Experiment) -> None:
    with pytest.raises(ValueError, match="render.seed = 99999999999999999999: must be between"):
        mouth.set("render.seed", 99999999999999999999)


def _plain(value: str) -> object:
    """The value of a change as Python writes it."""
    try:
        return tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return value
