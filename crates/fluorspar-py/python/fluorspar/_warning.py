"""Warnings."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterable

_HERE = os.path.dirname(__file__)


class FluorsparWarning(UserWarning):
    """What makes a result mean something else than one may think."""


def warn_of(texts: Iterable[str]) -> None:
    """Warns at the line outside of the package that led here."""
    level, frame = 1, sys._getframe()
    while frame is not None and os.path.dirname(frame.f_code.co_filename) == _HERE and frame.f_back is not None:
        level, frame = level + 1, frame.f_back
    for text in texts:
        warnings.warn(text, FluorsparWarning, stacklevel=level)
