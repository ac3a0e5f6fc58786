"""Frames of a camera, and what they tell."""

from __future__ import annotations

import html
import os
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from . import _fluorspar, _given
from ._experiment import Experiment, native_of
from ._picture import inline_picture, png_of
from ._record import Record
from ._render import Components, native_components
from ._warning import warn_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    import xarray


class Frame:
    """A recorded frame: raw digital numbers on the mosaic of the sensor, and linear channels.

    :func:`capture` and :meth:`Frame.read` make them. Arrays are read-only views of the values where they lie, with the pixels of the
    sensor (binned as it is), rows from the top. A frame pickles, for the same version of the package; files keep it (:meth:`write`).
    """

    __slots__ = ("_native",)

    def __init__(self, native: _fluorspar.Frame) -> None:
        self._native = _given.instance(native, _fluorspar.Frame, "Frame", "what fs.Frame.read(FILE) makes; call that")

    @classmethod
    def read(cls, path: str | os.PathLike[str], name: str | None = None) -> Frame:
        """A raw frame from a file (TIFF or PNG with its description, DNG, packed), as that of the capture ``name``. What of its description is
        doubtful is a :class:`FluorsparWarning`."""
        label = None if name is None else _given.text(name, "name")
        native, doubts = _fluorspar.read_frame(_given.file(path, "path"), label)
        warn_of(doubts)
        return cls(native)

    @property
    def name(self) -> str:
        """Name of the capture."""
        return self._native.name

    @property
    def raw(self) -> NDArray[np.uint16]:
        """Digital numbers, ``[row, col]``, uint16, DN: a read-only view."""
        return self._native.raw

    @property
    def developed(self) -> NDArray[np.float32] | None:
        """Linear channels, black and other frames subtracted, ``[row, col, channel]``, float32, DN; ``None`` of a frame from a file."""
        return self._native.developed

    @property
    def channels(self) -> list[str]:
        """Names of the channels, in the order of the last axis of :attr:`developed`."""
        return self._native.channels

    @property
    def mosaic(self) -> list[list[str]]:
        """Repeating cell of the color filter array: names of channels by row."""
        return self._native.mosaic

    @property
    def scale(self) -> dict[str, float]:
        """Numbers of the scale by name: ``black_level_dn``, ``white_level_dn``, ``bit_depth``, ``exposure_s``, ``gain`` (1 = base),
        ``dn_per_electron``, ``read_noise_dn``."""
        return self._native.scale

    @property
    def preview(self) -> NDArray[np.uint8] | None:
        """An image for people, sRGB, ``[row, col, rgb]``, uint8; ``None`` of a frame from a file."""
        return self._native.preview

    def to_xarray(self) -> xarray.DataArray:
        """The raw frame with its scale as attributes, the mosaic as text (``"G R / B G"``); not copied."""
        import xarray

        # No file of netCDF keeps lists of lists
        attrs = {"units": "DN", "mosaic": " / ".join(map(" ".join, self.mosaic)), **self.scale}
        return xarray.DataArray(self.raw, dims=("y", "x"), name=self.name, attrs=attrs)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes the raw frame as TIFF with its description beside it."""
        self._native.write(_given.path(path, "path"))

    def __reduce__(self) -> tuple[Any, ...]:
        return (Frame, (self._native,))

    def _repr_png_(self) -> bytes | None:
        preview = self.preview
        return None if preview is None else png_of(preview)

    def __repr__(self) -> str:
        rows, cols = self.raw.shape
        return f"<Frame {self.name}: {rows} x {cols} pixels, {1e3 * self.scale['exposure_s']:g} ms>"


class Frames(Mapping[str, Frame]):
    """The frames of a capture program, by name and in their order: a mapping of names to :class:`Frame`."""

    __slots__ = ("_frames",)

    def __init__(self, frames: Iterable[Frame]) -> None:
        self._frames = {frame.name: frame for frame in _all_frames(frames)}

    def __getitem__(self, name: str) -> Frame:
        if name not in self._frames:
            raise _given.unknown("frame", name, self._frames)
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


def _all_frames(frames: Any) -> list[Frame]:
    """Frames of a capture, or of any iterable."""
    if isinstance(frames, Mapping):
        frames = frames.values()
    expected = "the Frames of fs.capture, or a list of Frame"
    if isinstance(frames, str) or not isinstance(frames, Iterable):
        raise _given.wrong_type("frames", expected, frames)
    return [_given.instance(frame, Frame, f"frames[{index}]", "a Frame") for index, frame in enumerate(frames)]


class Analysis(Record):
    """The numbers of the analyzed region, as ``analyze --json`` prints them, and maps over the frame.

    Entries are attributes, too: ``a.mixture.region.estimate.position`` is ``a["mixture"]["region"]["estimate"]["position"]``;
    ``list(a)`` names them. ``channels`` has an entry for each channel with its level (DN, electrons), ``chromaticity`` that of the region,
    ``mixture`` the place on the line from bulk to porphyrin, ``posterior`` the estimate over a family of tissues, ``truth`` what the
    components hold, ``budget`` where the uncertainty comes from; ``findings`` lists every number that decides with its interval, what it is
    judged by and its caveats. What an experiment does not ask for is ``None``.
    """

    _maps: dict[str, NDArray[np.float32]]
    _regions: dict[str, Analysis]

    @property
    def regions(self) -> dict[str, Analysis]:
        """The further regions of the frame (``[[analysis.region]]``) by name, each analyzed by itself; without those that are not in
        view."""
        return self._regions

    @property
    def porphyrin_maps(self) -> dict[str, NDArray[np.float32]]:
        """Maps over the frame, ``[row, col]``, float32: the porphyrin ``share`` of each pixel on the mixture line, the ends ``low`` and ``high``
        of its interval (95 %), and its ``detection_limit``, all shares of the light; NaN where there is none. Empty without porphyrin."""
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

    ``changes`` are values below ``capture``, with that word or without: ``capture(e, c, **{"blue.exposure_ms": 60})``; more than one
    count as one change. Lens, filters, sensor, drives, exposures, concentrations may differ from those of the render, and so may the
    samples and limits that it was rendered with; what only a new render can show raises :class:`FluorsparError`. What frames may be
    mistaken for (hardly any light, a sensor finer than the render was made for) is a :class:`FluorsparWarning`.
    """
    native, rendered = native_of(experiment), native_components(components)
    if changes:
        native = native.set_all([(f"capture.{path.removeprefix('capture.')}", value) for path, value in changes.items()])
    frames, told = _fluorspar.capture(native, rendered, threads=_given.threads(threads))
    warn_of(told)
    return Frames(Frame(frame) for frame in frames)


def analyze(
    experiment: Experiment,
    frames: Frames | Iterable[Frame],
    *,
    components: Components | None = None,
    threads: int | None = None,
) -> Analysis:
    """Analyzes the frame that the experiment names: chromaticity and porphyrin of its region.

    ``frames`` are those of :func:`capture`, or any with the names of captures. ``components`` tell which part a pixel shows, and the
    truth. Returns an :class:`Analysis`: numbers by name, as ``fluorspar analyze --json`` prints them (chromaticities and shares from 0 to
    1, levels in DN and electrons, intervals as ``[low, high]`` of 95 %), ``.porphyrin``, ``.regions`` and ``.porphyrin_maps``
    (``[row, col]`` of the sensor, float32). A frame from a file whose experiment subtracts another, which is not given, is analyzed
    without it, with a :class:`FluorsparWarning`; so are frames that hardly any light reaches. :class:`FluorsparError` of an experiment
    without ``[analysis]``, and of frames that are not those of its captures.
    """
    native = _fluorspar.analyze(
        native_of(experiment),
        [frame._native for frame in _all_frames(frames)],
        None if components is None else native_components(components),
        threads=_given.threads(threads),
    )
    if native is None:
        raise _fluorspar.FluorsparError("the experiment has no [analysis] section; add one")
    warn_of(native.warnings)
    return _analysis(native)


def _analysis(native: _fluorspar.FrameAnalysis) -> Analysis:
    """What was found, with its maps and regions."""
    analysis = Analysis(native.numbers)
    analysis._maps = dict(native.porphyrin_maps)
    analysis._regions = {name: _analysis(region) for name, region in native.regions}
    return analysis
