"""The same computation for many values."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ._experiment import Experiment
from ._frames import Analysis, analyze, capture
from ._render import Components, render

if TYPE_CHECKING:
    import xarray


def _numbers_of(
    experiment: Experiment,
    components: Components | None,
    result: Callable[[Analysis], Mapping[str, float]] | None,
    threads: int | None,
) -> dict[str, float]:
    """Numbers of the analysis of one experiment, of a finished render or of a new one."""
    rendered = components or render(experiment, threads=threads, progress=None)
    shots = capture(experiment, rendered, threads=threads)
    analysis = analyze(experiment, shots, components=rendered, threads=threads)
    return dict(result(analysis)) if result else _numbers(analysis)


def _numbers(value: Any, path: str = "") -> dict[str, float]:
    """The numbers of nested results, by path."""
    if isinstance(value, bool):
        return {}
    if isinstance(value, (int, float)):
        return {path: float(value)}
    found: dict[str, float] = {}
    if isinstance(value, Mapping):
        for key, inner in value.items():
            found.update(_numbers(inner, f"{path}.{key}" if path else str(key)))
    return found


def sweep(
    experiment: Experiment,
    values: Mapping[str, Sequence[Any]],
    *,
    components: Components | None = None,
    result: Callable[[Analysis], Mapping[str, float]] | None = None,
    client: Any = None,
    threads: int | None = None,
) -> xarray.Dataset:
    """Analyzes an experiment for all combinations of values at paths, and returns a dataset over them.

    ``sweep(e, {"capture.blue.exposure_ms": [10, 20, 40]}, components=c)``. With ``components`` nothing is rendered again; without,
    every combination is rendered. ``result`` picks numbers of an analysis; by default all of them are kept. ``client`` is a Dask
    client: what a worker that dies has not finished is done by another.
    """
    import numpy as np
    import xarray

    points = list(itertools.product(*values.values()))
    experiments = []
    for point in points:
        changed = experiment
        for path, value in zip(values, point):
            changed = changed.set(path, value)
        experiments.append(changed)
    if client is None:
        found = [_numbers_of(changed, components, result, threads) for changed in experiments]
    else:
        shared = client.scatter(components, broadcast=True) if components is not None else None
        futures = [client.submit(_numbers_of, changed, shared, result, threads, pure=False) for changed in experiments]
        found = client.gather(futures)
    names = [name for name in found[0] if all(name in numbers for numbers in found)] if found else []
    shape = tuple(len(choices) for choices in values.values())
    dims = tuple(values)
    return xarray.Dataset(
        {name: (dims, np.array([numbers[name] for numbers in found]).reshape(shape)) for name in names},
        coords={path: list(choices) for path, choices in values.items() if _is_plain(choices)},
        attrs={"experiment": experiment.title, "sha256": experiment.sha256},
    )


def _is_plain(choices: Sequence[Any]) -> bool:
    """Whether values can be coordinates: numbers or texts."""
    return all(isinstance(choice, (int, float, str)) for choice in choices)
