"""Renders: bits, views, threads, Ctrl-C, processes."""

from __future__ import annotations

import _thread
import importlib.util
import multiprocessing
import os
import pickle
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import fluorspar as fs


def test_the_same_bits_for_any_number_of_threads(mouth, components) -> None:
    other = fs.render(mouth, threads=1, progress=None)
    assert np.array_equal(other.radiance, components.radiance)


def test_arrays_are_views_that_live_on_and_can_not_be_written(mouth) -> None:
    rendered = fs.render(mouth, progress=None)
    array, again = rendered.radiance, rendered.radiance
    assert np.shares_memory(array, again) and not array.flags.writeable
    total = float(array.sum())
    del rendered, again
    assert float(array.sum()) == total
    with pytest.raises(ValueError):
        array[0, 0, 0, 0] = 1


def test_datasets_are_netcdf_files_of_any_engine(mouth, components, tmp_path) -> None:
    xarray, _ = pytest.importorskip("xarray"), pytest.importorskip("scipy")
    components.to_xarray().to_netcdf(tmp_path / "components.nc", engine="scipy")
    part = xarray.load_dataset(tmp_path / "components.nc", engine="scipy").part
    number = part.attrs["flag_meanings"].split().index("tongue_dorsum")
    assert np.array_equal(part == part.attrs["flag_values"][number], components.part_mask("tongue_dorsum"))
    frame = fs.capture(mouth, components)["blue"].to_xarray()
    frame.to_netcdf(tmp_path / "frame.nc", engine="scipy")
    assert frame.attrs["mosaic"].count(" / ") == 1


def test_light_that_is_no_number_is_refused(components, tmp_path) -> None:
    components.write(tmp_path / "nan.npy")
    values = np.load(tmp_path / "nan.npy").astype(float)
    values[-1, -1, -1, -1] = 1e300
    np.save(tmp_path / "nan.npy", values)
    with pytest.raises(fs.FluorsparError, match="a value is inf"):
        fs.read(tmp_path / "nan.npy")


def test_a_dataset_has_units_and_shares_the_values(components) -> None:
    pytest.importorskip("xarray")
    dataset = components.to_xarray()
    assert dataset.radiance.dims == ("component", "y", "x", "wavelength")
    assert dataset.radiance.attrs["units"] == "W m-2 sr-1 nm-1"
    assert np.shares_memory(dataset.radiance.values, components.radiance)
    assert dataset.wavelength.attrs["units"] == "nm" and len(dataset.wavelength) == components.radiance.shape[3]


def test_sums_of_components_are_those_of_their_light_groups(components) -> None:
    blue = components.weighted({"blue": 1.0})
    parts = sum(components.component(label) for label in components.labels if label.startswith("blue."))
    np.testing.assert_allclose(blue, parts, rtol=1e-5, atol=1e-9)
    with pytest.raises(KeyError, match="blue"):
        components.weighted({"bleu": 1.0})


def test_masks_of_parts_lie_where_the_part_is_seen(components) -> None:
    mask = components.part_mask("tongue_dorsum")
    assert mask.any() and not mask.all() and np.isfinite(components.depth_m[mask]).all()


def test_files_and_pickles_give_the_same_image(components, tmp_path) -> None:
    for name in ["c.exr", "c.npy"]:
        components.write(tmp_path / name)
        again = fs.read(tmp_path / name)
        assert np.array_equal(again.radiance, components.radiance)
        assert again.experiment == components.experiment
    again = pickle.loads(pickle.dumps(components))
    assert np.array_equal(again.radiance, components.radiance)


def test_progress_is_told_and_its_errors_end_the_render(mouth) -> None:
    told: list[tuple[int, int]] = []
    longer = mouth.set("render.samples_per_pixel", 64)
    fs.render(longer, progress=lambda done, total: told.append((done, total)))
    assert told and told == sorted(told) and all(0 <= done <= total for done, total in told)

    def fails(done: int, total: int) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fs.render(longer, progress=fails)
    with pytest.raises(ValueError, match="tqdm"):
        fs.render(mouth, progress="bar")


def test_ctrl_c_ends_a_render_and_keeps_what_it_has(mouth) -> None:
    endless = mouth.set("render.samples_per_pixel", 100_000)
    begun = threading.Event()

    def interrupt() -> None:
        begun.wait()
        time.sleep(0.5)
        _thread.interrupt_main()

    threading.Thread(target=interrupt).start()
    with pytest.raises(fs.RenderStopped) as stopped:
        fs.render(endless, progress=lambda done, total: begun.set())
    partial = stopped.value.partial
    assert isinstance(stopped.value, KeyboardInterrupt)
    assert partial is None or (0 < partial.samples_per_pixel < 100_000 and np.isfinite(partial.radiance).all())
    # To another process goes what there is; clusters send the context of an error along
    assert stopped.value.__context__ is None and stopped.value.__cause__ is None
    again = pickle.loads(pickle.dumps(stopped.value))
    assert isinstance(again, fs.RenderStopped) and str(again) == str(stopped.value)
    assert (again.partial is None) == (partial is None)
    if partial is not None:
        np.testing.assert_array_equal(again.partial.radiance, partial.radiance)


_INTERRUPTED = """
import _thread, threading, time
import fluorspar as fs

at = []

def interrupt():
    time.sleep(0.5)
    at.append(time.monotonic())
    _thread.interrupt_main()

experiment = fs.experiment("oraleye-2021")
threading.Thread(target=interrupt).start()
try:
    fs.render(experiment, progress=None)
except fs.RenderStopped as stopped:
    print(time.monotonic() - at[0], stopped.partial)
"""


def test_ctrl_c_ends_a_preparation_without_an_image(tmp_path) -> None:
    """Meshes, maps and tissues take half a minute in the build of the tests, where no cache has them; after the end others go on."""
    places = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    done = subprocess.run([sys.executable, "-c", _INTERRUPTED], capture_output=True, text=True, env={**os.environ, **places})
    took_s, partial = done.stdout.split()
    assert partial == "None" and float(took_s) < 3, done.stderr


def test_other_threads_run_on(mouth) -> None:
    longer = mouth.set("render.samples_per_pixel", 32)
    ticks, done = 0, threading.Event()

    def tick() -> None:
        nonlocal ticks
        while not done.is_set():
            ticks += 1
            time.sleep(0.001)

    ticking = threading.Thread(target=tick)
    ticking.start()
    fs.render(longer, threads=1, progress=None)
    done.set()
    ticking.join()
    # A render that held the interpreter would leave a handful.
    assert ticks > 20


def _peak_growth(work) -> int:
    """Bytes by which the process grew at its largest while something ran."""

    def peak() -> int:
        lines = Path("/proc/self/status").read_text().splitlines()
        return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))

    # Sets the peak to what the process holds now
    Path("/proc/self/clear_refs").write_text("5")
    before = peak()
    work()
    return peak() - before


@pytest.mark.skipif(not os.access("/proc/self/clear_refs", os.W_OK), reason="the peak of memory can't be set back")
def test_views_take_no_memory(mouth) -> None:
    larger = mouth.set("render.width_px", 160).set("render.height_px", 120)
    components = fs.render(larger, progress=None)
    size = components.radiance.nbytes
    assert size > 40e6
    held: list[object] = []
    shown = [lambda: components.radiance, lambda: components.component(components.labels[0])]
    if importlib.util.find_spec("xarray"):
        shown.append(components.to_xarray)
        components.to_xarray()
    for show in shown:
        assert _peak_growth(lambda: held.append(show())) < size / 20
    # A copy is seen by the same measure
    assert _peak_growth(lambda: held.append(components.radiance.copy())) > 0.9 * size

    # Arrays of one object, asked for twice, are the same memory; planes are formed once
    planes = [components.planes(larger, "blue") for _ in range(2)]
    frame = fs.capture(larger, components)["blue"]
    for first, second in [planes, (frame.raw, frame.raw), (frame.developed, frame.developed), (frame.preview, frame.preview)]:
        assert np.shares_memory(first, second) and not first.flags.writeable


def _render_in_child(experiment, queue) -> None:
    try:
        queue.put(fs.render(experiment, progress=None).radiance.sum())
    except fs.FluorsparError as error:
        queue.put(str(error))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_forked_child_says_why_it_can_not_render(mouth, components) -> None:
    found = {}
    for method in ["fork", "spawn"]:
        context = multiprocessing.get_context(method)
        queue = context.Queue()
        child = context.Process(target=_render_in_child, args=(mouth, queue))
        child.start()
        found[method] = queue.get(timeout=120)
        child.join(timeout=30)
    assert "spawn" in found["fork"]
    assert found["spawn"] == components.radiance.sum()


@pytest.mark.parametrize("threads", [0, -1, 100_000])
def test_threads_beyond_reason_are_refused(mouth, threads) -> None:
    with pytest.raises((ValueError, OverflowError)):
        fs.render(mouth, threads=threads, progress=None)
