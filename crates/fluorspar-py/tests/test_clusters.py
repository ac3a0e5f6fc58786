"""Sweeps by other processes: Dask, joblib, a worker that is killed."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import fluorspar as fs

EXPOSURES = [10.0, 20.0, 40.0, 80.0]


def _green(analysis: fs.Analysis) -> dict[str, float]:
    return {"green": analysis.channels[1].statistics.mean}


def _green_of(experiment: fs.Experiment, components: fs.Components) -> float:
    return _green(fs.analyze(experiment, fs.capture(experiment, components), components=components))["green"]


@pytest.fixture
def here(mouth, components):
    pytest.importorskip("xarray")
    return fs.sweep(mouth, {"capture.blue.exposure_ms": EXPOSURES}, components=components, result=_green)


def _killed_once(analysis: fs.Analysis) -> dict[str, float]:
    """Kills the first process that comes here in the midst of a sweep."""
    try:
        Path(os.environ["FLUORSPAR_TEST_KILL"]).touch(exist_ok=False)
    except FileExistsError:
        return _green(analysis)
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def test_a_dask_cluster_gives_the_same_and_a_killed_worker_loses_nothing(mouth, components, here, tmp_path, monkeypatch) -> None:
    distributed = pytest.importorskip("distributed")
    # Workers don't find this module.
    pytest.importorskip("cloudpickle").register_pickle_by_value(sys.modules[__name__])
    monkeypatch.setenv("FLUORSPAR_TEST_KILL", str(tmp_path / "killed"))
    cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None)
    with cluster, distributed.Client(cluster) as client:
        values = {"capture.blue.exposure_ms": EXPOSURES}
        there = fs.sweep(mouth, values, components=components, result=_green, client=client, threads=1)
        assert here.identical(there)
        with pytest.raises(ZeroDivisionError) as raised:
            fs.sweep(mouth, values, components=components, result=lambda _: {"x": 1 / 0}, client=client, threads=1)
        assert raised.value.__notes__[0].startswith("in the sweep at capture.blue.exposure_ms = ")
        survived = fs.sweep(mouth, values, components=components, result=_killed_once, client=client, threads=1)
    assert (tmp_path / "killed").exists()
    np.testing.assert_array_equal(survived.green, here.green)


def test_joblib_gives_the_same(mouth, components, here) -> None:
    joblib = pytest.importorskip("joblib")
    work = joblib.delayed(_green_of)
    longer = [mouth.set("capture.blue.exposure_ms", exposure) for exposure in EXPOSURES]
    found = joblib.Parallel(n_jobs=2)(work(experiment, components) for experiment in longer)
    np.testing.assert_array_equal(found, here.green)


def test_the_cohort_of_the_examples_survives_the_kill_of_a_dask_worker() -> None:
    pytest.importorskip("distributed")
    if not shutil.which("pgrep"):
        pytest.skip("pgrep is not there")
    prove = Path(__file__).parents[3] / "examples/cluster/prove"
    here = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    said = subprocess.run([prove, "dask"], env={**os.environ, "PATH": here}, capture_output=True, text=True)
    assert said.returncode == 0, said.stdout + said.stderr
    assert "killed the worker of part 2" in said.stdout, said.stdout
    assert "files equal those of one process" in said.stdout, said.stdout
