"""Frames of a camera, and what they tell."""

from __future__ import annotations

import html
import os
import warnings
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from . import _fluorspar
from ._experiment import Experiment
from ._picture import inline_picture, png_of
from ._record import Record
from ._render import Components

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    import xarray


class FluorsparWarning(UserWarning):
    """What makes a result mean something else than one may think."""


class Frame:
    """A recorded frame: raw digital numbers on the mosaic of the sensor, and linear channels."""

    __slots__ = ("_native",)

    def __init__(self, native: _fluorspar.Frame) -> None:
        self._native = native

    @classmethod
    def read(cls, path: str | os.PathLike[str], name: str | None = None) -> Frame:
        """A raw frame from a file (TIFF or PNG with its description, DNG, packed), as that of a capture."""
        return cls(_fluorspar.read_frame(os.fspath(path), name))

    @property
    def name(self) -> str:
        """Name of the capture."""
        return self._native.name

    @property
    def raw(self) -> NDArray[np.uint16]:
        """Digital numbers, ``[row, col]``: a read-only view."""
        return self._native.raw

    @property
    def developed(self) -> NDArray[np.float32] | None:
        """Linear channels, black subtracted, ``[row, col, channel]``, DN; ``None`` of a frame from a file."""
        return self._native.developed

    @property
    def channels(self) -> list[str]:
        """Names of the channels."""
        return self._native.channels

    @property
    def mosaic(self) -> list[list[str]]:
        """Repeating cell of the color filter array: names of channels by row."""
        return self._native.mosaic

    @property
    def scale(self) -> dict[str, float]:
        """Black and white level (DN), bits, exposure (s), gain, DN per electron, read noise (DN)."""
        return self._native.scale

    @property
    def preview(self) -> NDArray[np.uint8] | None:
        """An image for people, sRGB, ``[row, col, rgb]``; ``None`` of a frame from a file."""
        return self._native.preview

    def to_xarray(self) -> xarray.DataArray:
        """The raw frame with its scale as attributes; not copied."""
        import xarray

        attrs = {"units": "DN", "mosaic": self.mosaic, **self.scale}
        return xarray.DataArray(self.raw, dims=("y", "x"), name=self.name, attrs=attrs)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes the raw frame as TIFF with its description beside it."""
        self._native.write(os.fspath(path))

    def _repr_png_(self) -> bytes | None:
        preview = self.preview
        return None if preview is None else png_of(preview)

    def __repr__(self) -> str:
        rows, cols = self.raw.shape
        return f"<Frame {self.name}: {rows} x {cols} pixels, {1e3 * self.scale['exposure_s']:g} ms>"


class Frames(Mapping[str, Frame]):
    """The frames of a capture program, by name and in their order."""

    __slots__ = ("_frames",)

    def __init__(self, frames: Iterable[Frame]) -> None:
        self._frames = {frame.name: frame for frame in frames}

    def __getitem__(self, name: str) -> Frame:
        if name not in self._frames:
            raise KeyError(f"there is no frame {name!r}; there are {', '.join(self._frames)}")
        return self._frames[name]

    def __iter__(self) -> Any:
        return iter(self._frames)

    def __len__(self) -> int:
        return len(self._frames)

    def _repr_html_(self) -> str:
        pictures = [(name, png) for name, frame in self.items() if (png := frame._repr_png_()) is not None]
        figures = "".join(
            f"<figure style='display:inline-block;margin:4px'>{inline_picture(png, f'frame {name}')}"
            f"<figcaption>{html.escape(name)}</figcaption></figure>"
            for name, png in pictures
        )
        return figures or html.escape(repr(self))

    def __repr__(self) -> str:
        return f"<Frames {', '.join(self._frames)}>"


class Analysis(Record):
    """The numbers of the analyzed region, as ``analyze --json`` prints them, and maps over the frame."""

    _maps: dict[str, NDArray[np.float32]]
    _regions: dict[str, Analysis]

    @property
    def regions(self) -> dict[str, Analysis]:
        """The further regions of the frame (``[[analysis.region]]``) by name, each analyzed by itself; empty without them."""
        return self._regions

    @property
    def porphyrin_maps(self) -> dict[str, NDArray[np.float32]]:
        """Porphyrin ``share`` of each pixel on the mixture line, ends of its interval, detection limit, ``[row, col]``; else NaN."""
        return self._maps

    @property
    def porphyrin(self) -> Record | None:
        """What the region's frame says of porphyrin: ``fraction`` of the light, ``interval`` (95 %), ``upper_limit`` (95 %), whether the
        light is ``foreign`` to what was assumed, ``budget``, and ``truth`` where components tell it.

        Where the region is a tissue of the catalogue, ``fraction`` is the median of the posterior over the family of tissues:
        ``analysis.posterior.median`` of results.json. The headline of a report shows it where the interval begins above 0, otherwise
        ``upper_limit`` alone (half of the prior lies on none, which pulls the median toward 0), and no number where the light is
        ``foreign`` and no other tissue explains it. Elsewhere ``fraction`` is the share on the mixture line,
        ``analysis.mixture.region.estimate.position``, which noise can put outside of 0 to 1, with its total interval and without an
        upper limit. ``None`` without a porphyrin in the analysis.
        """
        posterior, mixture, budget = self.get("posterior"), self.get("mixture"), self.get("budget")
        if posterior is None and (mixture is None or mixture.get("region") is None):
            return None
        truth = self.get("truth")
        found = Record(budget=budget, truth=None if truth is None else truth.share)
        if posterior is not None:
            limit, foreign = posterior.upper_limit, posterior.foreign
            return Record(fraction=posterior.median, interval=posterior.interval, upper_limit=limit, foreign=foreign, **found)
        assert mixture is not None
        interval = None if budget is None else budget.total_interval
        return Record(fraction=mixture.region.estimate.position, interval=interval, upper_limit=None, foreign=None, **found)

    def _repr_html_(self) -> str:
        share = self._maps.get("share")
        picture = "" if share is None else inline_picture(_picture_of_map(share), "map of the porphyrin share, black 0, white 1")
        return f"{picture}{super()._repr_html_()}"


def _picture_of_map(share: NDArray[np.float32]) -> bytes:
    """A map between 0 and 1 in gray; what has no value is blue."""
    import numpy as np

    known = np.isfinite(share)
    gray = (255 * np.clip(np.where(known, share, 0), 0, 1)).astype(np.uint8)
    blue = np.where(known, gray, 96).astype(np.uint8)
    return png_of(np.stack([gray, gray, blue], axis=-1))


def capture(experiment: Experiment, components: Components, *, threads: int | None = None, **changes: Any) -> Frames:
    """Takes the frames of the experiment's captures of a component image.

    ``changes`` are values below ``capture``: ``capture(e, c, **{"blue.exposure_ms": 60})``. Lens, filters, sensor, drives, exposures,
    concentrations may differ from those of the render; what only a new render can show raises :class:`FluorsparError`.
    """
    for path, value in changes.items():
        experiment = experiment.set(f"capture.{path}", value)
    native = _fluorspar.capture(experiment._native, components._native, threads=threads)
    return Frames(Frame(frame) for frame in native)


def analyze(
    experiment: Experiment,
    frames: Frames | Iterable[Frame],
    *,
    components: Components | None = None,
    threads: int | None = None,
) -> Analysis:
    """Analyzes the frame that the experiment names: chromaticity and porphyrin of its region.

    ``components`` tell which part a pixel shows, and the truth. A frame from a file whose experiment subtracts another, which is not
    given, is analyzed without it, with a :class:`FluorsparWarning`.
    """
    chosen = frames.values() if isinstance(frames, Frames) else frames
    native = _fluorspar.analyze(
        experiment._native,
        [frame._native for frame in chosen],
        None if components is None else components._native,
        threads=threads,
    )
    if native is None:
        raise _fluorspar.FluorsparError("the experiment has no [analysis] section; add one")
    for text in native.warnings:
        warnings.warn(text, FluorsparWarning, stacklevel=2)
    return _analysis(native)


def _analysis(native: _fluorspar.FrameAnalysis) -> Analysis:
    """What was found, with its maps and regions."""
    analysis = Analysis(Record.of_json(native.json))
    analysis._maps = dict(native.porphyrin_maps)
    analysis._regions = {name: _analysis(region) for name, region in native.regions}
    return analysis
