"""Mouths."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from . import _fluorspar, _given
from ._commands import command, text_of
from ._picture import picture_of_command
from ._record import Record

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh, as four arrays. Meshes are equal where all their arrays are.

    ``vertices_m``: positions, ``[vertex, axis]``, float32, m. ``triangles``: three vertex numbers each, from 0, counterclockwise seen
    from outside, ``[triangle, corner]``, uint32. ``normals``: unit shading normals, ``[vertex, axis]``, float32; no rows where the mesh is
    faceted. ``uv``: texture coordinates, ``[vertex, uv]``, float32, from 0 to 1 on a mouth; no rows where it has none.
    """

    #: Positions, ``[vertex, axis]``, m.
    vertices_m: NDArray[np.float32]
    #: Three vertex numbers each, ``[triangle, corner]``.
    triangles: NDArray[np.uint32]
    #: Unit shading normals, ``[vertex, axis]``; no rows where the mesh is faceted.
    normals: NDArray[np.float32]
    #: Texture coordinates, ``[vertex, uv]``; no rows where it has none.
    uv: NDArray[np.float32]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mesh):
            return NotImplemented
        import numpy as np

        return all(np.array_equal(getattr(self, field.name), getattr(other, field.name)) for field in fields(self))

    @classmethod
    def read(cls, path: str | os.PathLike[str], unit_m: float = 1.0) -> Mesh:
        """A mesh from a file: ``.ply``, ``.obj`` or ``.stl``, whose unit is ``unit_m`` meters."""
        return cls(*_fluorspar.read_mesh(_given.file(path, "path"), _given.number(unit_m, "unit_m")))

    def __repr__(self) -> str:
        return f"<Mesh: {len(self.vertices_m)} vertices, {len(self.triangles)} triangles>"


class Mouth:
    """A parametric mouth: an average adult, or a person drawn from the population."""

    def __init__(self, words: list[str]) -> None:
        self._words = words
        self._numbers: Record | None = None

    @property
    def _known(self) -> Record:
        if self._numbers is None:
            found = command("mouth", "generate", *self._words)
            assert isinstance(found, Record)
            self._numbers = found
        return self._numbers

    @property
    def parameters(self) -> Record:
        """What it is made from: widths, arches, teeth, pose; with units in the names."""
        return Record(self._known.parameters)

    @property
    def dimensions(self) -> list[Record]:
        """Measured dimensions next to those that are wanted, with sources; units are in the names."""
        return list(self._known.dimensions)

    def meshes(self) -> dict[str, Mesh]:
        """The mesh of each part by name: ``meshes()["tongue_dorsum"].vertices_m``."""
        with tempfile.TemporaryDirectory() as around:
            folder = os.path.join(around, "meshes")
            self.write(folder)
            files = sorted(name for name in os.listdir(folder) if name.endswith(".ply"))
            return {name.removesuffix(".ply"): Mesh.read(os.path.join(folder, name)) for name in files}

    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes the parts: .glb, .obj, .pbrt, or a folder of .ply files."""
        text_of("mouth", "generate", *self._words, "-q", out=_given.path(path, "path"))

    def _repr_png_(self) -> bytes:
        return picture_of_command("mouth", "view", *self._words, "--spp", "4", ending=".png")

    def __repr__(self) -> str:
        return f"<Mouth {' '.join(self._words)}>"


def mouth(*, person: int | None = None, pose: str | None = None, detail: float | None = None, **parameters: Any) -> Mouth:
    """A mouth: ``mouth(person=7).meshes()``, ``mouth(jaw_opening_mm=40, tooth_scale=1.05)``.

    ``pose`` is a view as ``fluorspar mouth view --list`` prints them, ``detail`` a factor on the rows and columns of the meshes.
    """
    options = {
        "person": None if person is None else _given.whole(person, "person"),
        "pose": None if pose is None else _given.text(pose, "pose"),
        "detail": None if detail is None else _given.number(detail, "detail"),
    }
    if person is not None and person < 0:
        raise ValueError(f"person = {person}: must be 0 or more")
    words = [f"--{name}={value}" for name, value in options.items() if value is not None]
    return Mouth([*words, *(f"--set={name}={_fluorspar.word_of(value, name)}" for name, value in parameters.items())])
