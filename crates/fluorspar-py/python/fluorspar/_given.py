"""What callers give, checked where it comes in: a wrong type is told with the argument, what belongs there, and what came."""

from __future__ import annotations

import numbers
import os
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from ._fluorspar import FluorsparError

T = TypeVar("T")


class UnknownName(FluorsparError, KeyError):
    """A name that is none of those that there are, which the message lists: of a component, light group, part, frame or capture.

    It is a :class:`KeyError`, too.
    """

    def __str__(self) -> str:
        # A KeyError would show its message in quotes
        return Exception.__str__(self)


class MissingFile(FluorsparError, FileNotFoundError):
    """A file that is not there. It is a :class:`FileNotFoundError`, too."""


def unknown(what: str, name: object, known: Iterable[str]) -> UnknownName:
    """The error about a name that is none of those that are known, each of which it tells once."""
    return UnknownName(f"there is no {what} {name!r}; there are {', '.join(dict.fromkeys(known)) or 'none'}")


def wrong_type(name: str, expected: str, value: object) -> TypeError:
    """The error about an argument of the wrong type."""
    shown = repr(value)
    shown = shown if len(shown) <= 60 else f"{shown[:57]}..."
    came = "None" if value is None else f"the {type(value).__name__} {shown}"
    return TypeError(f"{name}: give {expected}, not {came}")


def instance(value: object, kind: type[T], name: str, expected: str) -> T:
    """An argument of a class."""
    if not isinstance(value, kind):
        raise wrong_type(name, expected, value)
    return value


def mapping(value: object, name: str, expected: str) -> Mapping[Any, Any]:
    """An argument that is a dictionary or its like."""
    if not isinstance(value, Mapping):
        raise wrong_type(name, expected, value)
    return value


def text(value: object, name: str, expected: str = "a text") -> str:
    """An argument that is a text."""
    return instance(value, str, name, expected)


def path(value: object, name: str, expected: str = "a path") -> str:
    """An argument that is a path."""
    if isinstance(value, (str, os.PathLike)):
        plain = os.fspath(value)
        if isinstance(plain, str):
            return plain
    raise wrong_type(name, expected, value)


def file(value: object, name: str) -> str:
    """An argument that is the path of a file, which must be there."""
    place = path(value, name, "the path of a file")
    if not os.path.exists(place):
        raise MissingFile(f"{place}: there is no such file")
    return place


def source(value: object, name: str, expected: str) -> str:
    """An argument that is a name or a file, which must be there: what looks like a path is one."""
    place = path(value, name, expected)
    is_file = isinstance(value, os.PathLike) or place.endswith((".toml", ".html"))
    return file(place, name) if is_file else place


def number(value: object, name: str) -> float:
    """An argument that is a number, of NumPy, too."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise wrong_type(name, "a number", value)
    return float(value)


def limit(value: object, name: str) -> float:
    """An argument that is a time, s."""
    limit_s = number(value, name)
    if not limit_s > 0:
        raise ValueError(f"{name} = {limit_s:g}: must be more than 0 seconds")
    return limit_s


def whole(value: object, name: str) -> int:
    """An argument that is a whole number."""
    if isinstance(value, bool) or not isinstance(value, numbers.Integral):
        raise wrong_type(name, "a whole number", value)
    return int(value)


def threads(value: Any) -> int | None:
    """A number of threads; ``None`` means one for each core."""
    if value is None:
        return None
    count = whole(value, "threads")
    if not 1 <= count <= _MOST_THREADS:
        raise ValueError(f"threads = {count}: must be between 1 and {_MOST_THREADS}")
    return count


#: More threads only cost memory.
_MOST_THREADS = 4096
