"""Renders and component images."""

from __future__ import annotations

import html
import os
import tempfile
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _fluorspar, _given
from ._experiment import Experiment, native_of
from ._progress import Tell, progress_of
from ._warning import warn_of

if TYPE_CHECKING:
    from numpy.typing import NDArray
    import xarray


class Components:
    """The result of a render: radiance of every light group, reflected, by fluorophore, and fluoresced more than once.

    ``radiance`` is an array ``[component, row, col, band]`` in W/(sr m2 nm), a read-only view of the values where they lie. Light
    with other drives and concentrations is a weighted sum of the components: :meth:`weighted`.
    """

    __slots__ = ("_native",)

    def __init__(self, native: _fluorspar.Components) -> None:
        self._native = _given.instance(native, _fluorspar.Components, "Components", "what fs.render(EXPERIMENT) makes; call that")

    @property
    def radiance(self) -> NDArray[np.float32]:
        """Radiance, ``[component, row, col, band]``, float32, W/(sr m2 nm): a read-only view."""
        return self._native.radiance

    @property
    def labels(self) -> list[str]:
        """Label of each component: ``blue.reflected``, ``blue.fluorescence.collagen``, ``blue.multiple``."""
        return self._native.labels

    @property
    def light_groups(self) -> list[str]:
        """Light group of each component, in the order of :attr:`labels`: several components have the same."""
        return self._native.light_groups

    @property
    def wavelengths_nm(self) -> NDArray[np.float64]:
        """Centers of the bands, ``[band]``, float64, nm."""
        return self._native.wavelengths_nm

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Distance of what a pixel sees, ``[row, col]``, float32, m; infinite where it sees nothing."""
        return self._native.depth_m

    @property
    def part(self) -> NDArray[np.uint16]:
        """Number of the part that a pixel sees, ``[row, col]``, uint16: an index into :attr:`part_names` plus one; 0 for nothing."""
        return self._native.part

    @property
    def normal(self) -> NDArray[np.float32]:
        """Unit shading normal, ``[row, col, axis]``, float32, in the coordinates of the scene; zero where a pixel sees nothing."""
        return self._native.normal

    @property
    def part_names(self) -> list[str]:
        """Names of the parts of the scene."""
        return self._native.part_names

    @property
    def samples_per_pixel(self) -> int:
        """Paths averaged per pixel."""
        return self._native.samples_per_pixel

    @property
    def experiment(self) -> Experiment | None:
        """The experiment that was rendered; ``None`` of a file that carries none."""
        native = self._native.experiment
        return None if native is None else Experiment(native)

    def component(self, label: str) -> NDArray[np.float32]:
        """Radiance of one component by its label, ``[row, col, band]``, float32, W/(sr m2 nm): a read-only view."""
        labels = self.labels
        if _given.text(label, "label") not in labels:
            raise _given.unknown("component", label, labels)
        one: NDArray[np.float32] = self.radiance[labels.index(label)]
        return one

    def weighted(self, weights: Mapping[str, float]) -> NDArray[np.float32]:
        """Sum of components times weights by label or light group, ``[row, col, band]``, float32, W/(sr m2 nm).

        ``weighted({"blue": 0.5})`` is the light of that group at half its drive; a label goes before its group, and what is not named has
        weight 0. Weights below 0 make differences.
        """
        given = _given.mapping(weights, "weights", 'a dictionary by light group or label, such as {"blue": 0.5}')
        labels, groups = self.labels, self.light_groups
        for name in given:
            if name not in labels and name not in groups:
                raise _given.unknown("light group or component", name, [*groups, *labels])
        by_name = {name: _given.number(value, f"weights[{name!r}]") for name, value in given.items()}
        for name, weight in by_name.items():
            if not abs(weight) <= float(np.finfo(np.float32).max):
                raise ValueError(f"weights[{name!r}] = {weight:g}: must be a finite 32-bit number")
        factors = [by_name.get(label, by_name.get(group, 0.0)) for label, group in zip(labels, groups)]
        sums: NDArray[np.float32] = np.tensordot(np.asarray(factors, dtype=np.float32), self.radiance, axes=1)
        return sums

    def planes(
        self, experiment: Experiment, capture: str, *, lit: bool = False, threads: int | None = None
    ) -> NDArray[np.float32]:
        """Electrons per second that each component frees in each channel of the camera of a capture, ``[component, channel, row,
        col]``, float32, at the rendered powers and concentrations: a read-only view.

        Lens, filters and quantum efficiency are in them, so that drives, concentrations and exposures are factors: for one's own
        optimizers. Rows and columns are those of the render, electrons those of one pixel of the sensor, before any are binned. With ``lit`` the planes of
        components under light groups that the capture leaves dark are zero and take no time: half of it where a render has two groups.
        """
        native = native_of(experiment)
        names = native.captures
        if _given.text(capture, "capture") not in names:
            raise _given.unknown("capture", capture, names)
        asked = _given.threads(threads)
        return _fluorspar.channel_planes(native, self._native, capture, lit=lit, threads=asked).electrons_per_s

    def part_mask(self, name: str) -> NDArray[np.bool_]:
        """Whether a pixel sees a part, ``[row, col]``, bool."""
        if _given.text(name, "name") not in self.part_names:
            raise _given.unknown("part", name, self.part_names)
        mask: NDArray[np.bool_] = self.part == self.part_names.index(name) + 1
        return mask

    def to_xarray(self) -> xarray.Dataset:
        """A dataset with units as attributes; radiance is not copied.

        ``radiance`` has the dimensions ``component``, ``y``, ``x`` and ``wavelength`` (W m-2 sr-1 nm-1), ``depth`` (m) and ``part`` those
        of the pixels; coordinates are the labels, light groups and paths of the components, and the wavelengths in nm.
        """
        import xarray

        pixels = ("y", "x")
        attrs = {"units": "W m-2 sr-1 nm-1", "long_name": "spectral radiance"}
        experiment, names = self.experiment, self.part_names
        # As the CF conventions have them: what is no text and no number is kept by few forms of files
        meanings = " ".join(name.replace(" ", "_") for name in names)
        parts = {"flag_values": np.arange(1, 1 + len(names), dtype=np.uint16), "flag_meanings": meanings, "long_name": "part, 0 for none"}
        return xarray.Dataset(
            {
                "radiance": (("component", *pixels, "wavelength"), self.radiance, attrs),
                "depth": (pixels, self.depth_m, {"units": "m", "long_name": "distance along the camera ray"}),
                "part": (pixels, self.part, parts),
            },
            coords={
                "component": self.labels,
                "light_group": ("component", self.light_groups),
                "path": ("component", self._native.paths),
                "wavelength": ("wavelength", self.wavelengths_nm, {"units": "nm"}),
            },
            attrs={
                "samples_per_pixel": self.samples_per_pixel,
                "sha256": self._native.sha256 or "",
                "toml": experiment.toml if experiment else "",
                "fluorspar": _fluorspar.__version__,
            },
        )

    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes the image: ``.exr``, or ``.npy`` with its description beside it. :func:`read` and the program read both."""
        self._native.write(_given.path(path, "path"))

    def _repr_html_(self) -> str:
        import numpy as np

        means = self.radiance.mean(axis=(1, 2)) @ np.diff(self._native.edges_nm).astype(np.float32)
        rows = "".join(
            f"<tr><td style='text-align:left'><code>{html.escape(label)}</code></td><td>{mean:.4g}</td></tr>"
            for label, mean in zip(self.labels, means)
        )
        head = "<tr><th>Component</th><th>Mean radiance, W/(sr m<sup>2</sup>)</th></tr>"
        return f"{html.escape(repr(self))}<table>{head}{rows}</table>"

    def __repr__(self) -> str:
        components, rows, cols, bands = self.radiance.shape
        size = f"{components} components, {rows} x {cols} pixels, {bands} bands"
        return f"<Components: {size}, {self.samples_per_pixel} samples per pixel>"

    def __reduce__(self) -> tuple[Any, ...]:
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "components.exr")
            self.write(path)
            with open(path, "rb") as file:
                return (_components_of_bytes, (file.read(),))


def native_components(value: Any) -> _fluorspar.Components:
    """What an argument that must be a component image is made of."""
    return _given.instance(value, Components, "components", "Components, as fs.render or fs.read makes them")._native


def _components_of_bytes(content: bytes) -> Components:
    """A component image from the bytes of its file."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "components.exr")
        with open(path, "wb") as file:
            file.write(content)
        return read(path)


class RenderStopped(_fluorspar.RenderStopped):
    """A render that Ctrl-C ended; a :class:`KeyboardInterrupt`. It pickles with its image so far."""

    def __init__(self, message: str, unfinished: _fluorspar.UnfinishedRender | None = None) -> None:
        super().__init__(message)
        self.unfinished = unfinished

    @cached_property
    def partial(self) -> Components | None:
        """The image so far, made when it is first asked for; ``None`` where some pixel has no sample yet, as while a render is prepared."""
        native = None if self.unfinished is None else self.unfinished.take()
        return None if native is None else Components(native)

    def __reduce__(self) -> tuple[Any, ...]:
        # Sums of a film can't travel; the image that they make can
        return (RenderStopped, (str(self),), {"partial": self.partial})


def render(
    experiment: Experiment,
    *,
    threads: int | None = None,
    error: float | None = None,
    samples_per_pixel: int | None = None,
    time_limit_s: float | None = None,
    progress: str | Tell | None = "auto",
) -> Components:
    """Renders an experiment. The result has the same bits for any number of threads.

    ``samples_per_pixel`` paths are averaged in each pixel [default: those of the experiment]. ``error`` is a relative
    error, 1e-4 to 0.5: a tile of 16 x 16 pixels gets no more samples once the sensor channels of all captures that have light reach it,
    ``samples_per_pixel`` at most (``render.relative_error`` of the file; ``render.error_captures`` and ``render.error_range_nm`` choose
    other captures or wavelengths). ``time_limit_s`` ends it after that many seconds, as soon as each pixel has a sample. ``progress`` is ``"auto"``, ``"rich"``,
    ``"tqdm"``, ``"line"``, ``None``, or a function of the paths done and of all paths.

    These options are settings of the experiment that :attr:`Components.experiment` has; :func:`capture` and :func:`analyze` take the one
    that was given as well. Ctrl-C raises :class:`RenderStopped` within a moment, whose ``partial`` holds the samples so far, or ``None``
    where the scene was still being prepared. What is odd about the experiment is a :class:`FluorsparWarning`.
    """
    native, settings = native_of(experiment), []
    if error is not None:
        settings.append(("render.relative_error", _given.number(error, "error")))
    if samples_per_pixel is not None:
        settings.append(("render.samples_per_pixel", _given.whole(samples_per_pixel, "samples_per_pixel")))
    if settings:
        native = native.set_all(settings)
    limit_s = None if time_limit_s is None else _given.limit(time_limit_s, "time_limit_s")
    threads = _given.threads(threads)
    with progress_of(progress, "Rendering") as tell:
        try:
            rendered = Components(_fluorspar.render(native, threads=threads, time_limit_s=limit_s, progress=tell))
            warn_of(native.warnings)
            return rendered
        except _fluorspar.RenderStopped as error:
            stopped = error
        # Outside of the handler, without the error of before as its context: clusters send that along, and it can't travel
        raise RenderStopped(str(stopped), getattr(stopped, "unfinished", None))


def read(path: str | os.PathLike[str]) -> Components:
    """A component image from a file that ``run``, ``render --components`` or :meth:`Components.write` wrote."""
    return Components(_fluorspar.read_components(_given.file(path, "path")))
