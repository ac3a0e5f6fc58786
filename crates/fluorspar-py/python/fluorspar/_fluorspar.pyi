"""The part of the package that is written in Rust. Use the package: its classes have names, units and defaults."""

import os
from collections.abc import Callable, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "__version__",
    "FluorsparError",
    "ExperimentError",
    "RenderStopped",
    "Experiment",
    "Components",
    "Planes",
    "UnfinishedRender",
    "Frame",
    "FrameAnalysis",
    "render",
    "read_components",
    "capture",
    "read_frame",
    "analyze",
    "channel_planes",
    "read_mesh",
    "write_png",
    "answer",
    "run_program",
]

__version__: str

class FluorsparError(Exception):
    code: int

class ExperimentError(FluorsparError):
    path: str
    line: int | None
    entry: str | None
    field: str | None
    value: str | None
    message: str
    known: list[str]

class RenderStopped(KeyboardInterrupt):
    unfinished: UnfinishedRender | None

@final
class Experiment:
    @staticmethod
    def of_text(
        text: str,
        name: str = "experiment",
        base_dir: str | os.PathLike[str] | None = None,
        changes: Sequence[str] | None = None,
    ) -> Experiment: ...
    @staticmethod
    def find(name: str) -> Experiment: ...
    @staticmethod
    def of_dict(sections: dict[str, Any]) -> Experiment: ...
    @staticmethod
    def schema() -> str: ...
    def set(self, path: str, value: Any) -> Experiment: ...
    def unset(self, path: str) -> Experiment: ...
    def values(self, path: str) -> list[tuple[str, Any]]: ...
    def tree(self) -> list[tuple[str, str, str]]: ...
    def check(self) -> list[str]: ...
    @property
    def toml(self) -> str: ...
    @property
    def sha256(self) -> str: ...
    @property
    def title(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def changes(self) -> list[str]: ...

@final
class Components:
    @property
    def radiance(self) -> NDArray[np.float32]: ...
    @property
    def depth_m(self) -> NDArray[np.float32]: ...
    @property
    def part(self) -> NDArray[np.uint16]: ...
    @property
    def normal(self) -> NDArray[np.float32]: ...
    @property
    def part_names(self) -> list[str]: ...
    @property
    def wavelengths_nm(self) -> NDArray[np.float64]: ...
    @property
    def edges_nm(self) -> NDArray[np.float64]: ...
    @property
    def labels(self) -> list[str]: ...
    @property
    def light_groups(self) -> list[str]: ...
    @property
    def paths(self) -> list[str]: ...
    @property
    def samples_per_pixel(self) -> int: ...
    @property
    def experiment(self) -> Experiment | None: ...
    @property
    def sha256(self) -> str | None: ...
    def write(self, path: str | os.PathLike[str]) -> None: ...

@final
class Planes:
    @property
    def electrons_per_s(self) -> NDArray[np.float32]: ...

@final
class UnfinishedRender:
    def take(self) -> Components | None: ...

@final
class Frame:
    @property
    def name(self) -> str: ...
    @property
    def raw(self) -> NDArray[np.uint16]: ...
    @property
    def developed(self) -> NDArray[np.float32] | None: ...
    @property
    def channels(self) -> list[str]: ...
    @property
    def mosaic(self) -> list[list[str]]: ...
    @property
    def scale(self) -> dict[str, float]: ...
    @property
    def preview(self) -> NDArray[np.uint8] | None: ...
    def write(self, path: str | os.PathLike[str]) -> None: ...

@final
class FrameAnalysis:
    @property
    def json(self) -> str: ...
    @property
    def warnings(self) -> list[str]: ...
    @property
    def regions(self) -> list[tuple[str, FrameAnalysis]]: ...
    @property
    def porphyrin_maps(self) -> list[tuple[str, NDArray[np.float32]]]: ...

def render(
    experiment: Experiment,
    *,
    threads: int | None = None,
    time_limit_s: float | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Components: ...
def read_components(path: str | os.PathLike[str]) -> Components: ...
def capture(experiment: Experiment, components: Components, *, threads: int | None = None) -> list[Frame]: ...
def read_frame(path: str | os.PathLike[str], name: str | None = None) -> Frame: ...
def analyze(
    experiment: Experiment,
    frames: Sequence[Frame],
    components: Components | None = None,
    *,
    threads: int | None = None,
) -> FrameAnalysis | None: ...
def channel_planes(
    experiment: Experiment, components: Components, capture: str, *, threads: int | None = None
) -> Planes: ...
def read_mesh(
    path: str | os.PathLike[str], unit_m: float = 1.0
) -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32]]: ...
def write_png(path: str | os.PathLike[str], picture: NDArray[np.uint8]) -> None: ...
def answer(arguments: Sequence[str], *, threads: int | None = None) -> tuple[str, bool]: ...
def run_program(arguments: Sequence[str]) -> int: ...
