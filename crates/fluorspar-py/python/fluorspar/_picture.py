"""Pictures of objects in notebooks."""

from __future__ import annotations

import base64
import html
import os
import tempfile
from typing import TYPE_CHECKING

from . import _fluorspar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def png_of(image: NDArray[np.uint8]) -> bytes:
    """An sRGB image, ``[row, col, rgb]``, as a PNG file."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "image.png")
        _fluorspar.write_png(path, image)
        with open(path, "rb") as file:
            return file.read()


def picture_of_command(*words: str, ending: str) -> bytes:
    """The file that a command draws for its ``--out``."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "picture" + ending)
        _fluorspar.answer([*words, "--out", path, "--quiet"])
        with open(path, "rb") as file:
            return file.read()


def inline_picture(png: bytes, says: str) -> str:
    """An image that a page holds; ``says`` is for people who don't see it."""
    return f'<img alt="{html.escape(says, quote=True)}" src="data:image/png;base64,{base64.b64encode(png).decode()}">'
