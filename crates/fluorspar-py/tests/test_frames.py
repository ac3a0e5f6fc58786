"""Frames and analyses: equal to those of the program to the last bit."""

from __future__ import annotations

import json
import os
import pickle
import time
import warnings

import numpy as np
import pytest

import fluorspar as fs


def test_frames_and_numbers_are_those_of_the_program(mouth, components, program, tmp_path) -> None:
    mouth.save(tmp_path / "mouth.toml")
    components.write(tmp_path / "components.exr")
    program("capture", "components.exr", "--set", "capture.blue.exposure_ms=60", "--out", "shots", "-q", folder=tmp_path)
    shots = fs.capture(mouth, components, **{"blue.exposure_ms": 60})
    assert list(shots) == ["ambient", "white", "blue"]
    for name, frame in shots.items():
        stored = fs.Frame.read(tmp_path / f"shots/raw_{name}.tiff")
        assert np.array_equal(stored.raw, frame.raw), name
        assert stored.scale == frame.scale
    said = program("analyze", "shots", "--component-image", "components.exr", "--json", folder=tmp_path)
    longer = mouth.set("capture.blue.exposure_ms", 60)
    analysis = fs.analyze(longer, shots, components=components)
    assert analysis == json.loads(said)
    assert analysis.mixture.region.estimate.position == json.loads(said)["mixture"]["region"]["estimate"]["position"]
    porphyrin = analysis.porphyrin
    assert porphyrin.truth == analysis.truth.share and porphyrin.budget == analysis.budget
    assert porphyrin.interval[0] <= porphyrin.fraction <= porphyrin.interval[1]
    maps = analysis.porphyrin_maps
    assert maps["low"].shape == maps["share"].shape == shots["blue"].developed.shape[:2]

    # From the raw frames alone
    again = fs.analyze(longer, [fs.Frame.read(tmp_path / f"shots/raw_{name}.tiff") for name in shots], components=components)
    assert again == analysis


def test_a_render_with_other_samples_shows_the_same_scene(mouth, components, tmp_path) -> None:
    """The samples, the error and the limits of a render are no matter of its captures."""
    finer = fs.render(mouth, samples_per_pixel=2, error=0.4, time_limit_s=600, progress=None)
    assert finer.samples_per_pixel == 2 and finer.experiment.get("render.samples_per_pixel") == 2
    of_render, shots = fs.capture(finer.experiment, finer), fs.capture(mouth, finer)
    assert np.array_equal(shots["blue"].raw, of_render["blue"].raw)
    assert fs.analyze(mouth, shots, components=finer) == fs.analyze(finer.experiment, shots, components=finer)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        fs.capture(mouth.set("render.samples_per_pixel", 16), finer)
    assert not [one for one in told if "stopped early" in str(one.message)]
    with pytest.raises(fs.FluorsparError, match="or components="):
        fs.analyze(mouth, shots)
    with pytest.raises(fs.FluorsparError, match="max_depth"):
        fs.capture(mouth.set("render.max_depth", 2), finer)


def test_changes_of_captures_bear_their_section_or_not(mouth, components) -> None:
    long, short = (fs.capture(mouth, components, **{path: 60}) for path in ("capture.blue.exposure_ms", "blue.exposure_ms"))
    assert np.array_equal(long["blue"].raw, short["blue"].raw) and long["blue"].scale["exposure_s"] == 0.06


def test_frames_pickle(mouth, components) -> None:
    shots = fs.capture(mouth, components)
    again = pickle.loads(pickle.dumps(shots))
    assert list(again) == list(shots)
    for name, frame in shots.items():
        other = again[name]
        assert (other.name, other.channels, other.mosaic, other.scale) == (frame.name, frame.channels, frame.mosaic, frame.scale)
        for field in ("raw", "developed", "preview"):
            assert np.array_equal(getattr(other, field), getattr(frame, field)), field
    assert fs.analyze(mouth, again, components=components) == fs.analyze(mouth, shots, components=components)


def test_frames_without_light_are_told_of(mouth, components) -> None:
    with pytest.warns(fs.FluorsparWarning, match="hardly any light") as told:
        fs.capture(mouth, components, **{"blue.exposure_ms": 1e-5})
    assert told[0].filename == __file__


def test_concentrations_and_drives_change_without_a_render(mouth, components) -> None:
    none = mouth.set("concentration.protoporphyrin_ix", 0.0)
    assert not np.array_equal(
        fs.capture(none, components)["blue"].raw, fs.capture(mouth, components)["blue"].raw
    )
    with pytest.raises(fs.FluorsparError, match="render"):
        fs.capture(mouth.set("mouth.jaw_opening_mm", 30), components)


def test_views_of_frames_are_read_only(mouth, components) -> None:
    frame = fs.capture(mouth, components)["white"]
    assert frame.raw.dtype == np.uint16 and not frame.raw.flags.writeable
    assert frame.preview.shape == (*frame.raw.shape, 3) and frame.preview.max() > 0
    with pytest.raises(KeyError, match="white"):
        fs.capture(mouth, components)["whit"]


def _green(analysis: fs.Analysis) -> dict[str, float]:
    return {"green": analysis.channels[1].statistics.mean}


def _fails(_: fs.Analysis) -> dict[str, float]:
    return {"x": 1 / 0}


class _Client:
    """Does at once what a Dask client does in other processes: what it gets and gives goes through pickle."""

    def scatter(self, value, broadcast):
        return value

    def submit(self, work, *arguments, pure):
        work, arguments = pickle.loads(pickle.dumps((work, arguments)))
        try:
            return pickle.dumps(work(*arguments))
        except ZeroDivisionError as error:
            return pickle.dumps(error)

    def gather(self, futures):
        found = [pickle.loads(future) for future in futures]
        for error in found:
            if isinstance(error, Exception):
                raise error
        return found


def test_a_client_gives_the_same_sweep_and_analyses_pickle(mouth, components) -> None:
    pytest.importorskip("xarray")
    values = {"capture.blue.exposure_ms": [10.0, 20.0]}
    here = fs.sweep(mouth, values, components=components, result=_green)
    there = fs.sweep(mouth, values, components=components, result=_green, client=_Client())
    with pytest.raises(ZeroDivisionError) as raised:
        fs.sweep(mouth, values, components=components, result=_fails, client=_Client())
    assert raised.value.__notes__ == ["in the sweep at capture.blue.exposure_ms = 10.0"]
    assert here.identical(there)
    analysis = fs.analyze(mouth, fs.capture(mouth, components), components=components)
    again = pickle.loads(pickle.dumps(analysis))
    assert again == analysis and isinstance(again.mixture, fs.Record)
    np.testing.assert_array_equal(again.porphyrin_maps["share"], analysis.porphyrin_maps["share"])


def test_regions_are_analyses_by_name(mouth, components) -> None:
    # What other parts are made of is no matter of the lip: it has a bulk of its own
    own = {"parts": ["lower_lip"], "tissue": "none", "bulk": {"collagen": 1.0}}
    with_region = mouth.with_(analysis={"region": [{"name": "lip", **own}]})
    shots = fs.capture(with_region, components)
    analysis = fs.analyze(with_region, shots, components=components)
    alone = mouth
    for field, value in own.items():
        alone = alone.set(f"analysis.{field}", value)
    alone = fs.analyze(alone, shots, components=components)
    lip = analysis.regions["lip"]
    assert list(analysis.regions) == ["lip"] and lip == alone and lip.porphyrin == alone.porphyrin
    alone_in_results = {key: value for key, value in alone.items() if key != "findings"}
    assert analysis["regions"] == [{"name": "lip", "analysis": alone_in_results}] and alone.regions == {}
    assert pickle.loads(pickle.dumps(analysis)).regions["lip"] == lip


def test_a_sweep_is_a_dataset(mouth, components) -> None:
    pytest.importorskip("xarray")
    exposures = [10.0, 20.0, 40.0]
    found = fs.sweep(mouth, {"capture.blue.exposure_ms": exposures}, components=components, result=_green)
    green = found.green.values
    assert found.green.dims == ("capture.blue.exposure_ms",)
    np.testing.assert_allclose(green[1:] / green[:-1], 2.0, rtol=0.02)


def test_lists_are_values_and_results_of_a_sweep(mouth, components) -> None:
    pytest.importorskip("xarray")
    path = "capture.blue.filters"
    filters = [["long_pass_475"], ["long_pass_475", "ir_cut_700"], []]
    found = fs.sweep(mouth, {path: filters}, components=components, result=lambda a: {"x": a.porphyrin.interval, "none": None})
    assert found[path].values.tolist() == ["long_pass_475", "long_pass_475, ir_cut_700", "none"]
    expected = mouth.set(path, filters[1])
    interval = fs.analyze(expected, fs.capture(expected, components), components=components).porphyrin.interval
    both = found.sel({path: "long_pass_475, ir_cut_700"})
    assert [float(both["x[0]"]), float(both["x[1]"])] == list(interval) and "none" not in found
    everything = fs.sweep(mouth, {"capture.blue.exposure_ms": np.array([10, 20])}, components=components)
    level = everything["channels[1].statistics.mean"]
    assert level[1] > 1.5 * level[0] and everything["capture.blue.exposure_ms"].values.tolist() == [10, 20]


def test_a_sweep_is_checked_before_anything_is_computed(mouth, components) -> None:
    pytest.importorskip("xarray")
    seen: list[fs.Analysis] = []
    exposure = "capture.blue.exposure_ms"
    for given, error, text in [
        ({exposure: [10, -1]}, fs.ExperimentError, "exposure_ms = -1"),
        ({"concentration.fad": [1], "concentration.fed": [1]}, fs.ExperimentError, "fed"),
        ({exposure: [10], "mouth.jaw_opening_mm": [30]}, fs.FluorsparError, "render"),
        ({exposure: 10}, TypeError, "exposure_ms'.: give a list of values, not the int 10"),
        ({exposure: []}, ValueError, "give at least one value"),
        ([exposure], TypeError, "values: give a dictionary"),
    ]:
        with pytest.raises(error, match=text):
            fs.sweep(mouth, given, components=components, result=lambda a: seen.append(a) or {})
    with pytest.raises(fs.ExperimentError, match="tongue_dorsun") as raised:
        fs.sweep(mouth, {"analysis.parts": [["tongue_dorsum"], ["tongue_dorsun"]]}, result=seen.append)
    assert not seen and raised.value.__notes__ == ["in the sweep at analysis.parts = tongue_dorsun"]
    for wrong in (lambda a: 3, lambda a: {"x": "y"}, lambda a: {"x": [1, "y"]}):
        with pytest.raises(TypeError, match="result"):
            fs.sweep(mouth, {exposure: [10]}, components=components, result=wrong)


def test_planes_make_frames_by_sums(mouth, components) -> None:
    planes = components.planes(mouth, "blue")
    rows, cols = components.radiance.shape[1:3]
    assert planes.shape == (len(components.labels), 3, rows, cols) and not planes.flags.writeable
    lit = [group == "blue" for group in components.light_groups]
    frame = fs.capture(mouth.set("capture.blue.exposure_ms", 5), components)["blue"]
    expected = planes[lit].sum(axis=0).mean(axis=(1, 2)) * 5e-3 * frame.scale["dn_per_electron"]
    np.testing.assert_allclose(frame.developed.mean(axis=(0, 1)), expected, rtol=0.03)
    with pytest.raises(fs.FluorsparError, match="there are ambient, white, blue"):
        components.planes(mouth, "bleu")


def test_planes_of_lit_components_are_those_of_all(mouth, components) -> None:
    """Planes of what a capture leaves dark are zero where only lit ones are asked for, whatever was asked for before."""
    other = mouth.set("view_filter.filters", ["long_pass_520"])
    lit = np.array([group == "blue" for group in components.light_groups])
    first = components.planes(other, "blue", lit=True)
    whole = components.planes(other, "blue")
    again = components.planes(other, "blue", lit=True)
    assert whole[~lit].any() and not first[~lit].any()
    np.testing.assert_array_equal(first[lit], whole[lit])
    np.testing.assert_array_equal(again, first)


def test_what_was_kept_of_an_analysis_gives_the_same(program, tmp_path) -> None:
    """The second analysis of a mouth of tissue looks at no surface; it is that of the program to the last bit."""
    experiment = fs.experiment("oraleye-2021").with_(
        render={"width_px": 32, "height_px": 24, "samples_per_pixel": 1}, mouth={"detail": 0.4}
    )
    components = fs.render(experiment, progress=None)
    first = fs.analyze(experiment, fs.capture(experiment, components), components=components)
    again = fs.experiment("oraleye-2021").with_(
        render={"width_px": 32, "height_px": 24, "samples_per_pixel": 1}, mouth={"detail": 0.4}
    )
    assert fs.analyze(again, fs.capture(again, components), components=components) == first
    half = again.set("concentration.biofilm_porphyrin", 0.5)
    assert fs.analyze(half, fs.capture(half, components), components=components).truth.share < first.truth.share


def test_a_camera_that_changes_needs_no_surfaces(mouth, components, tmp_path) -> None:
    """Planes of another filter, sensor or aperture are the same whether the experiment is the one that was rendered or the same as typed."""
    components.write(tmp_path / "components.exr")
    read = fs.read(tmp_path / "components.exr")
    for path, value in (
        ("view_filter.filters", ["long_pass_500"]),
        ("sensor.preset", "monochrome_3_45um"),
        ("lens.f_number", 4.0),
    ):
        expected = components.planes(mouth.set(path, value), "blue")
        for experiment in (mouth, read.experiment):
            np.testing.assert_array_equal(read.planes(experiment.set(path, value), "blue"), expected, err_msg=path)


def test_a_frame_without_the_one_to_subtract_is_analyzed_with_a_warning(mouth, components, tmp_path) -> None:
    shots = fs.capture(mouth, components)
    shots["blue"].write(tmp_path / "raw_blue.tiff")
    alone = [fs.Frame.read(tmp_path / "raw_blue.tiff", "blue")]
    with pytest.warns(fs.FluorsparWarning, match='"ambient", which is not given') as told:
        analysis = fs.analyze(mouth, alone, components=components)
    assert len(told) == 1 and told[0].filename == __file__
    # Frames of a simulation are developed already, with what is subtracted
    assert fs.analyze(mouth, [shots["blue"]], components=components) != analysis


@pytest.mark.parametrize("base", ["oraleye-2021", "oraleye-2021-surface"])
def test_the_porphyrin_fraction_is_the_number_of_results_json(base, program, tmp_path) -> None:
    """The median of the posterior for tissue, the position on the mixture line for surfaces."""
    small = {"width_px": 32, "height_px": 24, "samples_per_pixel": 1}
    fs.experiment(base).with_(render=small, mouth={"detail": 0.4}).save(tmp_path / "small.toml")
    program("run", "small.toml", "--out", "results", "-q", folder=tmp_path)
    analysis = json.loads((tmp_path / "results/results.json").read_text())["analysis"]
    components = fs.read(tmp_path / "results/components.exr")
    experiment = components.experiment
    found = fs.analyze(experiment, fs.capture(experiment, components), components=components).porphyrin
    if base == "oraleye-2021":
        posterior = analysis["posterior"]
        assert (found.fraction, list(found.interval)) == (posterior["median"], posterior["interval"])
        assert (found.upper_limit, found.foreign) == (posterior["upper_limit"], posterior["foreign"])
    else:
        assert analysis["posterior"] is None and found.upper_limit is None and found.foreign is None
        assert found.fraction == analysis["mixture"]["region"]["estimate"]["position"]
        assert list(found.interval) == analysis["budget"]["total_interval"]
    assert found.truth == analysis["truth"]["share"]


def test_previews_start_no_threads(mouth, components) -> None:
    """Threads are those of the call before; a preview that was made takes none."""

    def threads() -> set[str]:
        return set(os.listdir("/proc/self/task"))

    frame = fs.capture(mouth, components)["white"]
    first = frame.preview
    before = threads()
    for _ in range(20):
        assert np.shares_memory(frame.preview, first)
        assert fs.capture(mouth, components)["white"].preview is not None
    # A thread that has ended may still be listed for a moment
    end = time.monotonic() + 10
    while not threads() <= before and time.monotonic() < end:
        time.sleep(0.01)
    assert threads() <= before


def test_files_of_others_stay_and_endings_tell_the_form(mouth, components, tmp_path) -> None:
    frame = fs.capture(mouth, components)["blue"]
    photo, notes, image = tmp_path / "photo.tiff", tmp_path / "notes.tiff.json", tmp_path / "my.exr"
    for path in (photo, notes, image):
        path.write_text("mine")
    for write in (lambda: frame.write(photo), lambda: frame.write(tmp_path / "notes.tiff"), lambda: components.write(image)):
        with pytest.raises(fs.FluorsparError, match="was not written by fluorspar"):
            write()
    assert all(path.read_text() == "mine" for path in (photo, notes, image))
    for write in (lambda: frame.write(tmp_path / "a.png"), lambda: components.write(tmp_path / "a.tiff")):
        with pytest.raises(fs.FluorsparError, match="end the name in"):
            write()
    for _ in range(2):
        frame.write(tmp_path / "own.tiff")
        components.write(tmp_path / "own.npy")
    assert fs.Frame.read(tmp_path / "own.tiff").raw.shape == frame.raw.shape


def test_a_sweep_holds_the_truth_values_that_are_asked_for(mouth, components) -> None:
    result = lambda found: {"flags": [True, np.bool_(False)]}
    found = fs.sweep(mouth, {"capture.blue.exposure_ms": [5]}, components=components, result=result)
    assert [float(found[name][0]) for name in ("flags[0]", "flags[1]")] == [1.0, 0.0]


def test_long_results_are_printed_short(mouth, components) -> None:
    analysis = fs.analyze(mouth, fs.capture(mouth, components), components=components)
    assert len(repr(analysis)) < 4000 and "entries>" in repr(analysis)
    assert analysis.budget.terms[0].source
