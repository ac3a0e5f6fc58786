"""Commands of the program as calls."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from . import _fluorspar, _given
from ._experiment import Experiment
from ._picture import picture_of_command
from ._record import Record, with_arrays

if TYPE_CHECKING:
    from . import sections


def _words(options: Mapping[str, Any]) -> list[str]:
    """Options as the command line has them: ``from_nm=400`` is ``--from-nm 400``, lists repeat, dictionaries are NAME=VALUE."""
    words: list[str] = []
    for name, value in options.items():
        option = "--" + name.rstrip("_").replace("_", "-")
        # Arrays and numbers of NumPy
        value = value.tolist() if hasattr(value, "tolist") else value
        if value is None or value is False:
            continue
        if value is True:
            words.append(option)
        elif isinstance(value, Mapping):
            words.extend(f"{option}={key}={_fluorspar.word_of(inner, str(key))}" for key, inner in value.items())
        elif isinstance(value, Sequence) and not isinstance(value, str):
            words.extend(f"{option}={_fluorspar.word_of(inner, name)}" for inner in value)
        else:
            words.append(f"{option}={_fluorspar.word_of(value, name)}")
    return words


@contextmanager
def _file_of(source: Experiment | str | os.PathLike[str] | None) -> Iterator[list[str]]:
    """An experiment as an argument: its name, or a file of its text for as long as the command runs."""
    if isinstance(source, Experiment):
        with source.as_file() as path:
            yield [path]
    elif source is None:
        yield []
    else:
        yield [_given.source(source, "source", "an Experiment, the name of one, or the path of a file")]


def command(*words: Any, threads: int | None = None, **options: Any) -> Any:
    """Runs a command that has no call of its own: ``command("scene", "get", "oraleye-2021-surface", "light.*.spectrum")``.

    Returns what ``--json`` prints, objects as :class:`Record`. Underscores of options are hyphens:
    ``command("lens", "report", "wide_3_5mm", wavelength_nm=550)``. Raises :class:`FluorsparError` with its exit ``code``.
    """
    return Record.of_json(text_of(*words, threads=threads, json=True, **options))


def text_of(*words: Any, threads: int | None = None, **options: Any) -> str:
    """What a command prints, for those that have no call of their own and for their help: ``text_of("lens", "--help")``.

    A defect of an experiment raises :class:`ExperimentError`, anything else :class:`FluorsparError`, both with the exit ``code``.
    """
    expected = "a word of the command line: a text, a number or a path"
    plain: list[str] = []
    for index, word in enumerate(words):
        if not isinstance(word, (str, int, float, os.PathLike)):
            raise _given.wrong_type(f"words[{index}]", expected, word)
        plain.append(_fluorspar.word_of(word, f"words[{index}]"))
    return _fluorspar.answer([*plain, *_words(options)], threads=_given.threads(threads))[0]


def _done(task: Callable[..., Any], *, threads: int | None = None, **options: Any) -> Record:
    """What a task answers."""
    found: Record = task(threads=_given.threads(threads), **options)
    return found


def _done_in_arrays(task: Callable[..., Any], **options: Any) -> Any:
    """What a task answers, lists of numbers as arrays."""
    return with_arrays(_done(task, **options))


def _record(*words: Any, **options: Any) -> Record:
    """What a command answers whose answer is an object."""
    found = command(*words, **options)
    assert isinstance(found, Record)
    return found


def _arrays(*words: Any, **options: Any) -> Any:
    """What a command answers, lists of numbers as arrays."""
    return with_arrays(command(*words, **options))


def _array_record(*words: Any, **options: Any) -> Record:
    """The same of an answer that is an object."""
    found = _arrays(*words, **options)
    assert isinstance(found, Record)
    return found


def predict(sample: str | os.PathLike[str] | None = None, *, threads: int | None = None, **options: Any) -> Record:
    """Spectra and mean sensor values of a flat sample, without geometry, in milliseconds.

    ``predict("tongue-385nm", concentration={"protoporphyrin_ix": 0.5}, light="led_405")``; arguments are the options of
    ``fluorspar predict``. Spectra are arrays.
    """
    found: Record = _done_in_arrays(_fluorspar.predict, sample=sample, threads=threads, **options)
    return found


class _Named:
    """Something of the catalogue, by name."""

    _command: str

    def __init__(self, name: str | os.PathLike[str]) -> None:
        self.name: str = _given.path(name, "name", "a name of the catalogue or the path of a file")

    def show(self, **options: Any) -> Any:
        """What is known of it; spectra are arrays."""
        return _arrays("catalog", "show", self._command, self.name, **options)

    def __repr__(self) -> str:
        return f"<{self._command} {self.name}>"


class Tissue(_Named):
    """A layered tissue: a site of the catalogue or a file with one ``[[tissue]]``."""

    _command = "tissue"

    def solve(self, **options: Any) -> Record:
        """Reflectance and fluorescence as arrays: ``solve(excitation_nm=[405, 450], state=["hyperemia"]).reflectance``."""
        found: Record = _done_in_arrays(_fluorspar.tissue_solve, site=self.name, **options)
        return found

    def sweep(self, parameter: str, first: float, last: float, **options: Any) -> Record:
        """Solved at several values of a parameter: ``sweep("superficial_blood_fraction", 0.002, 0.05).points[0].exitance``."""
        range_ = f"{parameter}={first}..{last}"
        found: Record = _done_in_arrays(_fluorspar.tissue_sweep, site=self.name, range=range_, **options)
        return found

    def depth(self, **options: Any) -> list[Record]:
        """From how deep its light comes: a record for each channel, ``depth()[0].mean_depth_um``."""
        found: list[Record] = _done_in_arrays(_fluorspar.tissue_depth, site=self.name, **options)
        return found

    def monte_carlo(self, **options: Any) -> Record:
        """Photons traced through it: ``monte_carlo(excitation_nm=405, photons=100000)``."""
        found: Record = _done_in_arrays(_fluorspar.tissue_monte_carlo, site=self.name, **options)
        return found

    def fit(self, **options: Any) -> Record:
        """Its parameters fitted to measured spectra."""
        found: Record = _done_in_arrays(_fluorspar.tissue_fit, site=self.name, **options)
        return found


class Lens(_Named):
    """A lens of the catalogue or a file."""

    _command = "lens"

    def trace(self, **options: Any) -> Record:
        """Focal length, pupils, spots, MTF and field."""
        return _array_record("lens", "report", self.name, **options)


class Sensor(_Named):
    """A sensor of the catalogue or a file."""

    _command = "sensor"

    def characterize(self, **options: Any) -> Record:
        """What EMVA 1288 measures of it."""
        return _record("sensor", "characterize", self.name, **options)


class _Drawn(_Named):
    """Something of the catalogue that has a figure, which notebooks show."""

    def plot(self, path: str | os.PathLike[str], **options: Any) -> None:
        """Writes its figure, ``.svg`` or ``.png``: ``plot("led.svg", from_nm=350, to_nm=500)``."""
        text_of("catalog", "plot", self._command, self.name, out=path, **options)

    def _repr_svg_(self) -> str:
        return picture_of_command("catalog", "plot", self._command, self.name, ending=".svg").decode()


class Light(_Drawn):
    """A light spectrum of the catalogue or a CSV file."""

    _command = "light"


class Filter(_Drawn):
    """A filter of the catalogue or a CSV file."""

    _command = "filter"

    def leak(self, **options: Any) -> Record:
        """How much reflected light leaks through it."""
        return _record("filter", "leak", view_filter=self.name, **options)


class Reflectance(_Drawn):
    """A diffuse reflectance of the catalogue or a CSV file."""

    _command = "reflectance"


class QuantumEfficiency(_Drawn):
    """Quantum efficiencies of the channels of a sensor, of the catalogue or a CSV file."""

    _command = "qe"


class Fluorophore(_Drawn):
    """A fluorophore of the catalogue or a file."""

    _command = "fluorophore"


def tissue(name: sections.TissueName | str | os.PathLike[str]) -> Tissue:
    """A layered tissue: ``tissue("lip").solve()``."""
    return Tissue(name)


def lens(name: sections.LensName | str | os.PathLike[str]) -> Lens:
    """A lens: ``lens("wide_3_5mm").trace()``."""
    return Lens(name)


def sensor(name: sections.SensorName | str | os.PathLike[str]) -> Sensor:
    """A sensor: ``sensor("pi_camera_3").show()``."""
    return Sensor(name)


def light(name: sections.LightSpectrumName | str | os.PathLike[str]) -> Light:
    """A light spectrum: ``light("led_385").show()``."""
    return Light(name)


def filters(name: sections.FilterName | str | os.PathLike[str]) -> Filter:
    """A filter: ``filters("view_475_700").show()``."""
    return Filter(name)


def reflectance(name: sections.ReflectanceName | str | os.PathLike[str]) -> Reflectance:
    """A diffuse reflectance: ``reflectance("enamel").show()``."""
    return Reflectance(name)


def quantum_efficiency(name: sections.QuantumEfficiencyName | str | os.PathLike[str]) -> QuantumEfficiency:
    """Quantum efficiencies of a sensor's channels: ``quantum_efficiency("consumer_rgb_cmos").show()``."""
    return QuantumEfficiency(name)


def fluorophore(name: sections.FluorophoreName | str | os.PathLike[str]) -> Fluorophore:
    """A fluorophore: ``fluorophore("collagen").show()``."""
    return Fluorophore(name)


def plot(path: str | os.PathLike[str], **options: Any) -> Record:
    """Draws lights, filters, fluorophores and the sensor over one axis of wavelengths, as ``.svg`` or ``.png``.

    ``plot("chain.svg", light="led_385", fluorophore=["collagen", "protoporphyrin_ix"], view_filter="view_475_700")``.
    """
    return _record("plot", out=path, **options)


def run(source: Experiment | str | os.PathLike[str], out: str | os.PathLike[str], **options: Any) -> Record:
    """From scene to report in a folder, as ``fluorspar run``; returns the numbers that the folder keeps in results.json."""
    if source is None:
        raise _given.wrong_type("source", "an Experiment, the name of one, or the path of a file", source)
    if options.get("time_limit") is not None:
        _given.limit(options["time_limit"], "time_limit")
    with _file_of(source) as words:
        return _done(_fluorspar.run, experiment=words[0], out=_given.path(out, "out"), **options)


def design(source: str | os.PathLike[str] | None = None, *, search: str = "compare", **options: Any) -> Record:
    """Compares lights, filters and sensors by what they could prove: a DESIGN.toml or a built-in problem.

    ``search`` is ``"sweep"``, ``"optimize"``, ``"compare"``, ``"scenes"`` or ``"merge"``; options are those of ``fluorspar design``.
    """
    searches = {
        "compare": _fluorspar.design_compare,
        "sweep": _fluorspar.design_sweep,
        "optimize": _fluorspar.design_optimize,
        "merge": _fluorspar.design_merge,
        "scenes": _fluorspar.design_scenes,
    }
    if search not in searches:
        raise _given.unknown("search", search, searches)
    return _done(searches[search], design=source, **options)


def compare(a: str | os.PathLike[str], b: str | os.PathLike[str], **options: Any) -> Record:
    """Two finished runs side by side: the settings that differ, and the numbers with their intervals and whether these tell them apart.

    ``compare("fluorspar-out/a", "fluorspar-out/b", out="two")``: folders of ``run``, ``capture`` or ``analyze``; ``out`` is a folder for a page
    with the frames. Designs that nobody has run are compared by :func:`design`.
    """
    return _done(_fluorspar.compare, a=_given.file(a, "a"), b=_given.file(b, "b"), **options)


def calibrate(file: str | os.PathLike[str], **options: Any) -> Record:
    """A camera from its own dark, flat and target frames, with intervals.

    ``calibrate("calibration.toml", out="camera-7").camera.gain_dn_per_e``; writes ``camera.toml``, an experiment, and a page.
    ``fluorspar new calibration`` writes a file to start from; options are those of ``fluorspar calibrate``.
    """
    return _done(_fluorspar.calibrate, file=_given.file(file, "file"), **options)


def cohort(source: str | os.PathLike[str] | None = None, **options: Any) -> Record:
    """Many drawn people in the views of an examination: normal ranges, truth against estimate, how well a lesion is told.

    ``cohort("cohort.toml", out="people").ranges``; options are those of ``fluorspar cohort``.
    """
    return _done(_fluorspar.cohort, cohort=source, **options)


def dataset(source: str | os.PathLike[str] | None = None, **options: Any) -> Record:
    """Images of drawn people with their truth in a folder, to train and test with.

    ``dataset("cohort.toml", out="images").holds.splits``; options are those of ``fluorspar dataset``.
    """
    return _done(_fluorspar.dataset, cohort=source, **options)


def cube(image: str | os.PathLike[str], **options: Any) -> Record:
    """The light of one capture of a finished render as a spectral cube for other programs, or a cube of theirs as ``.exr`` or ``.npy``.

    ``cube("fluorspar-out/a", out="a.zarr")`` writes what ``xarray.open_zarr`` opens; options are those of ``fluorspar cube``.
    """
    return _done(_fluorspar.cube, image=_given.file(image, "image"), **options)


def fit_spectra(spectra: str | os.PathLike[str], **options: Any) -> Record:
    """Measured spectra (CSV) as sums of fluorophores: weights with intervals, and which sets describe them as well.

    ``fit_spectra("measured.csv", fluorophore=["fad", "protoporphyrin_ix"], light="led_405", relative=True).spectra[0].fit``; arguments are the options
    of ``fluorspar fluorophore fit``.
    """
    found: Record = _done_in_arrays(_fluorspar.fit_spectra, spectra=_given.file(spectra, "spectra"), **options)
    return found


def spectroradiometer(source: str | os.PathLike[str], **options: Any) -> Record:
    """Spectra of a component image or a flat sample as a spectroradiometer reads them, as arrays."""
    return _array_record("spectroradiometer", source, **options)


def describe(frame: str | os.PathLike[str], **options: Any) -> Record:
    """Writes the description of a camera's frame beside it, from its tags and options: ``describe("photo.tiff", mosaic="bggr",
    exposure_ms=30)``. Returns each value with where it comes from."""
    return _record("describe", frame, **options)


def catalog(**options: Any) -> Any:
    """The catalogue: lights, filters, reflectances, sensors, fluorophores, experiments, flat samples."""
    return command("catalog", "list", **options)


def safety(source: Experiment | str | os.PathLike[str] | None = None, **options: Any) -> Record:
    """Eyes and tissue: hazards, limits, margins and exposures per day of every capture."""
    with _file_of(source) as words:
        return _record("safety", *words, **options)


def validate(**options: Any) -> Record:
    """The figures and tables of the paper, computed and compared."""
    return _record("validate", **options)
