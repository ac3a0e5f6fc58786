"""Results as dictionaries whose entries are attributes, too."""

from __future__ import annotations

import html
import json
from typing import Any


class Record(dict[str, Any]):
    """A dictionary whose entries are attributes, too: ``record.mixture.region`` is ``record["mixture"]["region"]``."""

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            known = ", ".join(str(key) for key in self) or "none"
            raise AttributeError(f"there is no {name!r}; there are {known}") from None

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *(key for key in self if isinstance(key, str) and key.isidentifier())]

    @classmethod
    def of_json(cls, text: str) -> Any:
        """The value of a JSON text, every object a record."""
        return json.loads(text, object_hook=cls)

    def __repr__(self) -> str:
        whole = super().__repr__()
        if len(whole) <= _LONGEST:
            return whole
        return "{" + ", ".join(f"{key!r}: {_short(value)}" for key, value in self.items()) + "}"

    def _repr_html_(self) -> str:
        return _table(self)


def with_arrays(value: Any) -> Any:
    """A result whose lists of numbers are arrays, float64 and read-only."""
    import numpy as np

    if isinstance(value, dict):
        return Record((key, with_arrays(inner)) for key, inner in value.items())
    if not isinstance(value, list):
        return value
    if value and all(isinstance(inner, (int, float)) and not isinstance(inner, bool) for inner in value):
        array = np.asarray(value, dtype=np.float64)
        array.flags.writeable = False
        return array
    return [with_arrays(inner) for inner in value]


#: Longest result that is printed whole, characters.
_LONGEST = 400


def _short(value: Any) -> str:
    """A result in a line: what is large by its size."""
    if isinstance(value, (dict, list)) and len(repr(value)) > _LONGEST // 4:
        of = "entries" if isinstance(value, dict) else "items"
        return f"<{len(value)} {of}>"
    return repr(value)


#: Entries of a list that a table shows.
_SHOWN = 50


def _table(value: Any) -> str:
    """Results as a table whose inner tables fold."""
    if isinstance(value, dict):
        rows = "".join(f"<tr><th style='text-align:left'>{html.escape(str(key))}</th><td>{_cell(inner)}</td></tr>" for key, inner in value.items())
        return f"<table>{rows}</table>"
    rows = "".join(f"<tr><td>{_cell(inner)}</td></tr>" for inner in value[:_SHOWN])
    more = f"<tr><td>and {len(value) - _SHOWN} more</td></tr>" if len(value) > _SHOWN else ""
    return f"<table>{rows}{more}</table>"


def _cell(value: Any) -> str:
    """One result in a table."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if hasattr(value, "tolist"):
        value = value.tolist()
    if not isinstance(value, (dict, list)):
        return html.escape(str(value))
    if all(isinstance(inner, (int, float)) for inner in value) and len(value) <= 6 and isinstance(value, list):
        return ", ".join(f"{inner:.6g}" for inner in value)
    return f"<details><summary>{len(value)} {'entries' if len(value) != 1 else 'entry'}</summary>{_table(value)}</details>"
