"""Experiments: scene, lights, filters, lens, sensor, captures and analysis, with units in every name."""

from __future__ import annotations

import functools
import html
import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from . import _fluorspar, _given
from ._picture import inline_picture, picture_of_command

if TYPE_CHECKING:
    from . import sections


class Experiment:
    """An experiment, which never changes: :meth:`set` and :meth:`with_` return other ones.

    Make one with :func:`experiment` or :func:`load`. When it is made, names and types of all fields are checked, and whatever resolves
    within milliseconds: wavelengths, settings of the render, camera, lens, sensor, filters, lights, the parameters of the mouth,
    captures, development, motion, safety. Materials, objects, the region of the analysis and the files that these name are checked by
    :meth:`check` or by the first use, which also makes the mouth. Both raise the same :class:`ExperimentError`.
    """

    __slots__ = ("_native",)

    def __init__(self, native: _fluorspar.Experiment) -> None:
        self._native = _given.instance(native, _fluorspar.Experiment, "Experiment", "what fs.experiment(NAME) makes; call that")

    def set(self, path: str, value: Any) -> Experiment:
        """The same experiment with another value at a path, which may hold wildcards.

        ``e.set("light.blue.strength.power_mw", 1000)`` is ``--set light.blue.strength.power_mw=1000`` of the program.
        """
        return Experiment(self._native.set(_given.text(path, "path", "a path such as light.blue.spectrum"), value))

    def unset(self, path: str) -> Experiment:
        """The same experiment without what its text or its base has at a path: ``e.unset("analysis")`` is ``--unset analysis``."""
        return Experiment(self._native.unset(_given.text(path, "path", "a path such as analysis")))

    def with_(self, **sections: Any) -> Experiment:
        """The same experiment with other values, nested as in the file: ``e.with_(render={"samples_per_pixel": 64})``.

        Entries of lists are found by their names: ``e.with_(light={"blue": {"spectrum": "led_405"}})``. A dictionary changes what it
        names of a table, and takes the place of anything else: ``e.with_(light={"blue": {"spectrum": {"csv": "my_led.csv"}}})``. All
        values count as one change: only what they come to is checked.
        """
        return Experiment(self._native.with_sections(_plain(sections)))

    def get(self, path: str) -> Any:
        """The value at a path, defaults filled in; with wildcards a dictionary of all that they match."""
        found = self._native.values(_given.text(path, "path", "a path such as light.blue.spectrum"))
        if len(found) == 1 and not any(sign in path for sign in "*?"):
            return found[0][1]
        return dict(found)

    def tree(self) -> list[tuple[str, str, str]]:
        """Everything that has a name, as (path, kind, summary): ``("light.blue", "light", "ring, led_385, 1000 mW")``."""
        return self._native.tree()

    def check(self) -> list[str]:
        """Checks all that can be checked before rendering; returns what ``fluorspar check`` warns of, in its words."""
        return self._native.check()

    @property
    def title(self) -> str:
        """Name for people."""
        return self._native.title

    @property
    def toml(self) -> str:
        """The whole experiment as a file: base, changes and defaults written out, paths absolute."""
        return self._native.toml

    @property
    def sha256(self) -> str:
        """Digest of everything that decides the result."""
        return self._native.sha256

    @property
    def changes(self) -> list[str]:
        """Changes on top of the text, ``PATH=VALUE``."""
        return self._native.changes

    @contextmanager
    def as_file(self) -> Iterator[str]:
        """A file of the experiment for as long as a ``with`` lasts, for programs that take one."""
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "experiment.toml")
            self.save(path)
            yield path

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the experiment as a file, complete; ``fluorspar run`` and :func:`load` take it. Replaces nothing."""
        with open(_given.path(path, "path"), "x", encoding="utf-8") as file:
            file.write(self.toml)

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td><code>{html.escape(path)}</code></td><td>{html.escape(kind)}</td><td>{html.escape(summary)}</td></tr>"
            for path, kind, summary in self.tree()
        )
        with self.as_file() as path:
            picture = picture_of_command("scene", "view", path, ending=".png")
        return (
            f"<b>{html.escape(self.title)}</b><br>{inline_picture(picture, 'The scene as clay')}"
            f"<details><summary>What it holds</summary><table>{rows}</table></details>"
        )

    def __repr__(self) -> str:
        changes = "".join(f" {change}" for change in self.changes)
        return f"<Experiment {self._native.name}: {self.title}{changes}>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Experiment) and self.sha256 == other.sha256

    def __hash__(self) -> int:
        return hash(self.sha256)

    def __reduce__(self) -> tuple[Any, ...]:
        return (Experiment, (self._native,))


def _plain(value: Mapping[str, Any]) -> dict[str, Any]:
    """Nested mappings as dictionaries."""
    return {key: _plain(inner) if isinstance(inner, Mapping) else inner for key, inner in value.items()}


def native_of(value: Any, name: str = "experiment") -> _fluorspar.Experiment:
    """What an argument that must be an experiment is made of."""
    return _given.instance(value, Experiment, name, "an Experiment, as fs.experiment(NAME) makes it")._native


@functools.cache
def _lists_of_named() -> frozenset[str]:
    """Sections that are lists of what has names."""
    properties = json.loads(schema())["properties"]
    return frozenset(name for name, section in properties.items() if section.get("type") == "array")


def _with_lists(given: Mapping[str, Any]) -> dict[str, Any]:
    """Sections as the file has them: dictionaries by name become lists whose entries carry the names."""
    found = dict(given)
    for name in _lists_of_named() & found.keys():
        entries = found[name]
        if isinstance(entries, Mapping):
            for key, entry in entries.items():
                if not isinstance(entry, Mapping):
                    raise _given.wrong_type(f"{name}.{key}", "a dictionary", entry)
                if entry.get("name", key) != key:
                    raise ValueError(f"{name}.{key}: its name is {entry['name']!r}; leave `name` out")
            found[name] = [{"name": key, **entry} for key, entry in entries.items()]
    return found


def schema() -> str:
    """The JSON schema of experiment files; ``sections`` holds it as types."""
    return _fluorspar.Experiment.schema()


def experiment(source: str | os.PathLike[str] | sections.Experiment | Mapping[str, Any] = "oraleye-2021") -> Experiment:
    """An experiment: a built-in one by name, a file (.toml, or the report.html of a run), or nested dictionaries as the file has them.

    Lists of what has names may be dictionaries by name: ``{"format": 1, "base": "oraleye-2021", "light": {"blue": {"spectrum":
    "led_405"}}}``. A defect raises :class:`ExperimentError`; :class:`Experiment` says what is checked when. A file that is not there
    raises :class:`MissingFile`.
    """
    if isinstance(source, Mapping):
        return Experiment(_fluorspar.Experiment.of_dict(_plain(_with_lists(source))))
    name = _given.source(source, "source", "the name of an experiment, the path of a file, or nested dictionaries")
    return Experiment(_fluorspar.Experiment.find(name))


def load(path: str | os.PathLike[str]) -> Experiment:
    """An experiment from a file: .toml, or the report.html of a run."""
    return experiment(_given.file(path, "path"))
