"""Fluorspar predicts what a fluorescence camera records, before the camera is built.

An experiment holds scene, lights, filters, lens, sensor and captures. A render of it keeps light apart by light group and
fluorophore, so that drives, exposures, concentrations, filters and sensors are changed afterwards without rendering again::

    import fluorspar as fs

    e = fs.experiment("oraleye-2021").set("render.samples_per_pixel", 4)
    c = fs.render(e)
    shots = fs.capture(e, c, **{"blue.exposure_ms": 60})
    a = fs.analyze(e, shots, components=c)
    print(a.mixture.region.estimate.position)

Lengths are in mm or nm, times in ms or s, powers in mW, as the names say. Every function takes ``threads``; results do not depend
on it.
"""

from __future__ import annotations

from ._commands import command, filters, lens, light, predict, presets, safety, sensor, text_of, tissue, validate
from ._experiment import Experiment, experiment, load
from ._fluorspar import ExperimentError, FluorsparError, RenderStopped, __version__
from ._frames import Analysis, Frame, Frames, analyze, capture
from ._record import Record
from ._render import Components, read, render
from ._sweep import sweep

__all__ = [
    "Analysis",
    "Components",
    "Experiment",
    "ExperimentError",
    "FluorsparError",
    "Frame",
    "Frames",
    "Record",
    "RenderStopped",
    "__version__",
    "analyze",
    "capture",
    "command",
    "experiment",
    "filters",
    "lens",
    "light",
    "load",
    "predict",
    "presets",
    "read",
    "render",
    "safety",
    "sensor",
    "sweep",
    "text_of",
    "tissue",
    "validate",
]
