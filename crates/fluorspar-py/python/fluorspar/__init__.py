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

from . import sections
from ._commands import (
    Filter,
    Fluorophore,
    Lens,
    Light,
    QuantumEfficiency,
    Reflectance,
    Sensor,
    Tissue,
    calibrate,
    catalog,
    command,
    cohort,
    compare,
    cube,
    dataset,
    describe,
    design,
    filters,
    fit_spectra,
    fluorophore,
    lens,
    light,
    plot,
    predict,
    quantum_efficiency,
    reflectance,
    run,
    safety,
    sensor,
    spectroradiometer,
    text_of,
    tissue,
    validate,
)
from ._experiment import Experiment, experiment, load, schema
from ._fluorspar import ExperimentError, FluorsparError, __version__
from ._frames import Analysis, Frame, Frames, analyze, capture
from ._given import MissingFile, UnknownName
from ._mouth import Mesh, Mouth, mouth
from ._record import Record
from ._render import Components, RenderStopped, read, render
from ._study import Study, Table, norm
from ._sweep import sweep
from ._warning import FluorsparWarning
from ._workbench import Workbench, workbench

__all__ = [
    "Analysis",
    "Components",
    "Experiment",
    "ExperimentError",
    "Filter",
    "FluorsparError",
    "FluorsparWarning",
    "Fluorophore",
    "Frame",
    "Frames",
    "Lens",
    "Light",
    "Mesh",
    "MissingFile",
    "Mouth",
    "QuantumEfficiency",
    "Record",
    "Reflectance",
    "RenderStopped",
    "Sensor",
    "Study",
    "Table",
    "Tissue",
    "UnknownName",
    "Workbench",
    "__version__",
    "analyze",
    "capture",
    "catalog",
    "command",
    "calibrate",
    "cohort",
    "compare",
    "cube",
    "dataset",
    "describe",
    "design",
    "experiment",
    "filters",
    "fit_spectra",
    "fluorophore",
    "lens",
    "light",
    "load",
    "mouth",
    "norm",
    "plot",
    "predict",
    "quantum_efficiency",
    "read",
    "reflectance",
    "render",
    "run",
    "safety",
    "schema",
    "sections",
    "sensor",
    "spectroradiometer",
    "sweep",
    "text_of",
    "tissue",
    "validate",
    "workbench",
]
