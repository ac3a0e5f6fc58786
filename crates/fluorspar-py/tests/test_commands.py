"""Every command as a call: the same numbers as the program prints."""

from __future__ import annotations

import _thread
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluorspar as fs

CASES = [
    (lambda: fs.predict("tongue-385nm", concentration={"protoporphyrin_ix": 0.5}),
     ["predict", "tongue-385nm", "--concentration", "protoporphyrin_ix=0.5"]),
    (lambda: fs.tissue("lip").show(), ["catalog", "show", "tissue", "lip"]),
    (lambda: fs.tissue("lip").solve(from_nm=400, to_nm=500, step_nm=20),
     ["tissue", "solve", "lip", "--from-nm", "400", "--to-nm", "500", "--step-nm", "20"]),
    (lambda: fs.tissue("lip").depth(), ["tissue", "depth", "lip"]),
    (lambda: fs.sensor("pi_camera_3").show(), ["catalog", "show", "sensor", "pi_camera_3"]),
    (lambda: fs.light("led_385").show(), ["catalog", "show", "light", "led_385"]),
    (lambda: fs.filters("view_475_700").show(), ["catalog", "show", "filter", "view_475_700"]),
    (lambda: fs.safety("oraleye-2021-surface"), ["safety", "oraleye-2021-surface"]),
    (lambda: fs.catalog(), ["catalog", "list"]),
    (lambda: fs.lens("wide_3_5mm").trace(wavelength_nm=np.float64(550.0)), ["lens", "report", "wide_3_5mm", "--wavelength-nm", "550"]),
]


def plain(value: Any) -> Any:
    """A result as JSON has it."""
    if isinstance(value, dict):
        return {key: plain(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [plain(inner) for inner in value]
    return value.tolist() if isinstance(value, np.ndarray) else value


def test_spectra_are_arrays() -> None:
    solved = fs.tissue("lip").solve(from_nm=400, to_nm=500, step_nm=20)
    assert solved.reflectance.shape == solved.wavelength_nm.shape == (6,)
    assert 0.05 < solved.reflectance.mean() < 0.3 and solved.fluorescence[0].exitance_per_nm.max() > 0
    assert not solved.reflectance.flags.writeable
    assert fs.tissue("lip").depth()[0].mean_depth_um > 0
    traced = fs.tissue("lip").monte_carlo(excitation_nm=405, photons=2000)
    assert isinstance(traced, dict) and traced


@pytest.mark.parametrize(("call", "words"), CASES, ids=lambda case: " ".join(case) if isinstance(case, list) else "")
def test_calls_give_what_the_program_prints(call, words, program) -> None:
    assert plain(call()) == json.loads(program(*words, "--json"))


def test_an_experiment_is_an_argument(mouth, program, tmp_path) -> None:
    mouth.save(tmp_path / "mouth.toml")
    assert fs.safety(mouth) == json.loads(program("safety", "mouth.toml", "--json", folder=tmp_path))


def test_a_check_warns_of_what_the_program_warns_of(mouth, program, tmp_path) -> None:
    mouth.save(tmp_path / "mouth.toml")
    said = json.loads(program("check", "mouth.toml", "--json", folder=tmp_path))["warnings"]
    assert mouth.check() == said and any("pixels of the sensor" in text for text in said)


def test_a_defect_of_an_experiment_is_the_same_error_of_a_command() -> None:
    with pytest.raises(fs.ExperimentError) as raised:
        fs.command("check", "oraleye-2021-surface", set="light.blue.spectrum=led_386")
    assert (raised.value.field, raised.value.code) == ("light.blue.spectrum", 2) and "led_385" in raised.value.known


def test_errors_have_the_exit_code_of_the_program() -> None:
    with pytest.raises(fs.FluorsparError) as raised:
        fs.tissue("lips").show()
    assert raised.value.code == 2 and "lip" in str(raised.value)
    with pytest.raises(fs.FluorsparError) as raised:
        fs.command("tissue", "slove", "lip")
    assert raised.value.code == 2
    with pytest.raises(fs.FluorsparError, match="--no-cache"):
        fs.command("catalog", "list", "tissue", no_cache=True)


def test_designs_become_parquet(tmp_path) -> None:
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    fs.design("two-lights", search="sweep", out=tmp_path / "two")
    designs = pandas.read_csv(tmp_path / "two" / "designs.csv")
    designs.to_parquet(tmp_path / "designs.parquet")
    again = pandas.read_parquet(tmp_path / "designs.parquet")
    assert len(again) > 0 and again["lights"].tolist() == designs["lights"].tolist()


def test_a_cohort_says_what_is_normal(tmp_path) -> None:
    (tmp_path / "c.toml").write_text(
        'format = 1\nbase = "oraleye-2021-surface"\n[people]\ncount = 2\nviews = ["lips"]\n[render]\nwidth_px = 32\n'
        "height_px = 24\nsamples_per_pixel = 1\n[sensor]\ncolumns = 64\nrows = 48\npixel_size_um = 37.5\n"
        "fill_factor = 0.0044\n[mouth]\ndetail = 0.25\n"
    )
    found = fs.cohort(tmp_path / "c.toml", out=tmp_path / "people")
    red = [of for of in found.ranges if of.quantity.id == "chromaticity_r" and of.quantity.part == "lower_lip"]
    assert found.people.count == 2 and all(of.statistics.n == 2 for of in red) and red
    assert (tmp_path / "people" / "report.html").is_file()
    written = fs.dataset(tmp_path / "c.toml", out=tmp_path / "images")
    assert sum(split.people for split in written.holds.splits) == 2
    depth = np.load(tmp_path / "images" / "truth" / "000002_lips_depth_m.npy")
    assert depth.shape == (48, 64) and 0.05 < depth.max() < 0.3


def test_a_camera_is_calibrated_from_its_frames(tmp_path, camera_frames) -> None:
    found = fs.calibrate(camera_frames / "calibration.toml", out=tmp_path / "camera")
    gain = found.camera.gain_dn_per_e
    # The sensor of the base: 0.911 V over 9000 e- and 4096 codes; 3.5 standard errors
    assert abs(gain.value - 4096 / 9000) < 3.5 * (gain.high - gain.low) / 3.92
    assert abs(found.scales.lights[0].factor.value - 1) < 0.1
    assert fs.experiment(tmp_path / "camera" / "camera.toml").get("sensor.emva1288.bit_depth") == 12
    with pytest.raises(fs.FluorsparError, match="no file or folder"):
        (tmp_path / "other.toml").write_text('format = 1\nexperiment = "flat-patch"\ndark = "x"\nflat = "y"\n')
        fs.calibrate(tmp_path / "other.toml")


def test_two_runs_are_compared(tmp_path) -> None:
    small = {"render.width_px": 16, "render.height_px": 12, "sensor.columns": 32, "sensor.rows": 24}
    for name, spectrum in (("a", "led_385"), ("b", "led_405")):
        experiment = fs.experiment("flat-patch").set("light.blue.spectrum", spectrum)
        for path, value in small.items():
            experiment = experiment.set(path, value)
        fs.run(experiment, tmp_path / name, spp=2)
    found = fs.compare(tmp_path / "a", tmp_path / "b", out=tmp_path / "two")
    assert [setting.path for setting in found.settings] == ["light.blue.spectrum"]
    share = next(row for row in found.numbers if row.quantity == "Porphyrin share on the mixture line")
    assert share.told_apart == "apart" and share.difference > 0
    assert (tmp_path / "two" / "report.html").is_file()


def test_another_build_finds_nothing_of_this_one_in_the_cache(tmp_path) -> None:
    """What runs is the interpreter, which stays the same: the file of the module tells builds apart."""
    package = tmp_path / "other" / "fluorspar"
    shutil.copytree(Path(fs.__file__).parent, package)
    made = "import fluorspar; fluorspar.mouth(person=7, detail=0.3).meshes()"

    def kept(path: Path | None) -> int:
        places = {"XDG_CACHE_HOME": str(tmp_path / "cache"), **({} if path is None else {"PYTHONPATH": str(path)})}
        subprocess.run([sys.executable, "-c", made], check=True, env={**os.environ, **places})
        return len(list((tmp_path / "cache").rglob("*.cache")))

    first = kept(None)
    assert first > 0 and kept(None) == first
    # Copied with its time, it would be the same build
    os.utime(next(package.glob("_fluorspar*.so")))
    assert kept(package.parent) == 2 * first


def test_a_workbench_opens_on_an_experiment_and_ends() -> None:
    e = fs.experiment("flat-patch").with_(render={"width_px": 16, "height_px": 12})
    with fs.workbench(e, spp=1) as bench:
        with urllib.request.build_opener(urllib.request.HTTPCookieProcessor()).open(bench.address) as page:
            assert "Workbench" in page.read().decode()
        assert bench.address in bench._repr_html_()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(bench.address)
    with pytest.raises(fs.FluorsparError, match="no-such-experiment") as refused:
        fs.workbench("no-such-experiment")
    assert refused.value.code == 2


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Shells let what they start in the background ignore the signal."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_a_task_that_is_interrupted_stops_no_other() -> None:
    lip = fs.tissue("lip")
    alone = lip.monte_carlo(excitation_nm=405, photons=20_000, threads=1)
    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(lip.monte_carlo, excitation_nm=405, photons=20_000, threads=1)
        threading.Timer(0.2, _thread.interrupt_main).start()
        with pytest.raises(KeyboardInterrupt):
            lip.monte_carlo(excitation_nm=405, photons=10**11, threads=1)
        assert plain(other.result()) == plain(alone)


def test_arguments_are_named_as_they_are_given() -> None:
    lip = fs.tissue("lip")
    with pytest.raises(fs.FluorsparError, match=r"^excitation_nm=200: must be between"):
        lip.solve(excitation_nm=200)
    with pytest.raises(fs.FluorsparError, match=r"give the wavelength of the light, excitation_nm=405$"):
        lip.monte_carlo()
    with pytest.raises(TypeError, match=r"^from_nm: give a number, not the string \"blue\""):
        lip.solve(from_nm="blue")
    with pytest.raises(TypeError, match=r"no argument \"excitation\"; it has .*excitation_nm"):
        lip.solve(excitation=405)
    with pytest.raises(fs.ExperimentError, match=r"^exposure_ms=-3") as raised:
        fs.predict(exposure_ms=-3)
    assert (raised.value.path, raised.value.code) == ("exposure_ms=-3", 2)
    one, several = lip.solve(excitation_nm=405, state="hyperemia"), lip.solve(excitation_nm=[405], state=["hyperemia"])
    assert plain(one) == plain(several)
    changed = lip.solve(set={"superficial_blood_fraction": 0.01})
    assert plain(changed) == plain(lip.solve(set=["superficial_blood_fraction=0.01"]))


@pytest.mark.parametrize("call", [
    lambda: fs.cube("no.exr", out="a.zarr"), lambda: fs.calibrate("no.toml"), lambda: fs.design("no.toml"), lambda: fs.cohort("no.toml"),
    lambda: fs.dataset("no.toml", out="images"), lambda: fs.compare("no-a", "no-b"), lambda: fs.fit_spectra("no.csv"),
    lambda: fs.light(Path("no.csv")).show(),
])
def test_files_that_are_not_there_are_missing(call, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileNotFoundError, match="no"):
        call()


def test_a_run_wants_an_experiment() -> None:
    with pytest.raises(TypeError, match="source: give an Experiment"):
        fs.run(None, "out")
