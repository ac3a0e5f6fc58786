"""The same computation for many values."""

from __future__ import annotations

import itertools
import json
import math
import numbers
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from . import _fluorspar, _given
from ._experiment import Experiment, native_of
from ._frames import Analysis, analyze, capture
from ._render import Components, native_components, render

if TYPE_CHECKING:
    import xarray

#: What an analysis is asked for.
Result = Callable[[Analysis], Mapping[str, Any]]


def _numbers_of(
    experiment: Experiment, components: Components | None, result: Result | None, threads: int | None
) -> dict[str, float]:
    """Numbers of the analysis of one experiment, of a finished render or of a new one."""
    rendered = components or render(experiment, threads=threads, progress=None)
    shots = capture(experiment, rendered, threads=threads)
    analysis = analyze(experiment, shots, components=rendered, threads=threads)
    if result is None:
        return dict(_numbers(analysis, ""))
    found = result(analysis)
    if not isinstance(found, Mapping):
        raise _given.wrong_type("what `result` returns", 'a dictionary of numbers by name, such as {"share": 0.1}', found)
    for name, value in found.items():
        _check_result(_given.text(name, "a name that `result` returns"), value)
    return dict(_numbers(found, "", has_flags=True))


def _numbers_at(at: str, *arguments: Any) -> dict[str, float]:
    """The same at a point, which the notes of an error name: they travel with it."""
    try:
        return _numbers_of(*arguments)
    except Exception as error:
        error.add_note(at)
        raise


def _check_result(path: str, value: Any) -> None:
    """Refuses what becomes no number of a dataset."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, Mapping):
        for key, inner in value.items():
            _check_result(f"{path}.{key}", inner)
    elif isinstance(value, (list, tuple)):
        for index, inner in enumerate(value):
            _check_result(f"{path}[{index}]", inner)
    elif value is not None and not isinstance(value, numbers.Real):
        raise _given.wrong_type(f"`result`, {path}", "a number, None, or a list or dictionary of them", value)


def _numbers(value: Any, path: str, *, has_flags: bool = False) -> Iterable[tuple[str, float]]:
    """The numbers of nested results by path, as one writes it to reach them: ``channels[1].statistics.mean``; with ``has_flags`` truth
    values, too."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _numbers(inner, f"{path}.{key}" if path else str(key), has_flags=has_flags)
    elif isinstance(value, (list, tuple)):
        for index, inner in enumerate(value):
            yield from _numbers(inner, f"{path}[{index}]", has_flags=has_flags)
    elif isinstance(value, numbers.Real) and (has_flags or not isinstance(value, bool)):
        yield path, float(value)


def _choices_of(values: Any) -> dict[str, list[Any]]:
    """The values of each path as a list of plain ones."""
    expected = 'a dictionary of lists by path, such as {"capture.blue.exposure_ms": [10, 20]}'
    found: dict[str, list[Any]] = {}
    for path, choices in _given.mapping(values, "values", expected).items():
        name = f"values[{path!r}]"
        _given.text(path, "a path of values", "a path such as capture.blue.exposure_ms")
        if isinstance(choices, (str, Mapping)) or not isinstance(choices, Iterable):
            raise _given.wrong_type(name, "a list of values", choices)
        found[path] = [choice.tolist() if hasattr(choice, "tolist") else choice for choice in choices]
        if not found[path]:
            raise ValueError(f"{name}: give at least one value")
    return found


def _coordinate(choices: Sequence[Any]) -> list[Any]:
    """What names the places of a dimension: numbers as they are, anything else as text."""
    if all(isinstance(choice, numbers.Real) for choice in choices):
        return [choice if isinstance(choice, int) else float(choice) for choice in choices]
    return [_label(choice) for choice in choices]


def _label(choice: Any) -> str:
    """A value as text: a list of filters by their names."""
    if isinstance(choice, str):
        return choice
    if isinstance(choice, (list, tuple)) and all(isinstance(item, (str, int, float)) for item in choice):
        return ", ".join(map(str, choice)) or "none"
    return json.dumps(choice, default=str)


def _at(point: Iterable[tuple[str, Any]]) -> str:
    return "in the sweep at " + ", ".join(f"{path} = {_label(value)}" for path, value in point)


def _experiments(experiment: Experiment, choices: Mapping[str, list[Any]], components: Components | None) -> list[Experiment]:
    """The experiment at each point, all of them checked."""
    native = native_of(experiment)
    rendered = None if components is None else native_components(components)
    found = []
    for values in itertools.product(*choices.values()):
        point = list(zip(choices, values))
        try:
            changed = native.set_all(point)
            if rendered is None:
                # On another one, which goes: what is resolved for all points at once might fill the memory
                native.set_all(point).check()
            else:
                _fluorspar.check_capture(changed, rendered)
        except Exception as error:
            error.add_note(_at(point))
            raise
        found.append(Experiment(changed))
    return found


def sweep(
    experiment: Experiment,
    values: Mapping[str, Sequence[Any]],
    *,
    components: Components | None = None,
    result: Result | None = None,
    client: Any = None,
    threads: int | None = None,
) -> xarray.Dataset:
    """Analyzes an experiment for all combinations of values at paths, and returns a dataset over them.

    ``sweep(e, {"capture.blue.exposure_ms": [10, 20, 40]}, components=c)``. With ``components`` nothing is rendered again; without,
    every combination is rendered. All combinations are checked before the first is computed, with ``components`` also whether
    these can show them; what is wrong raises what ``e.set(path, value).check()`` would.

    The dataset has one dimension for each path, with its values as coordinate; where these are no numbers, texts: a list of filters is
    ``"long_pass_475, ir_cut_700"``, an empty one ``"none"``. Its variables are float64, with the units of the analysis (DN, electrons,
    shares from 0 to 1): all numbers of it, named as one writes them to reach them (``mixture.region.estimate.position``,
    ``channels[1].statistics.mean``, ``posterior.interval[0]``), or those that ``result`` returns by name, a list of numbers as ``name[0]``,
    ``name[1]``, ``True`` as 1. What is ``None`` or missing at some point is NaN there. ``client`` is a Dask client: what a worker that dies has not
    finished is done by another. An error at a point has a note that names it.
    """
    import numpy as np
    import xarray

    if result is not None and not callable(result):
        raise _given.wrong_type("result", "a function of an Analysis that returns numbers by name", result)
    threads = _given.threads(threads)
    choices = _choices_of(values)
    experiments = _experiments(experiment, choices, components)
    places = [_at(zip(choices, point)) for point in itertools.product(*choices.values())]
    points = list(zip(places, experiments))
    if client is None:
        found = [_numbers_at(at, changed, components, result, threads) for at, changed in points]
    else:
        shared = client.scatter(components, broadcast=True) if components is not None else None
        futures = [client.submit(_numbers_at, *point, shared, result, threads, pure=False) for point in points]
        found = client.gather(futures)
    shape = tuple(map(len, choices.values()))
    names = dict.fromkeys(name for one in found for name in one)
    return xarray.Dataset(
        {name: (tuple(choices), np.array([one.get(name, math.nan) for one in found]).reshape(shape)) for name in names},
        coords={path: _coordinate(of_path) for path, of_path in choices.items()},
        attrs={"experiment": experiment.title, "sha256": experiment.sha256},
    )
