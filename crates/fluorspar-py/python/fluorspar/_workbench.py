"""The workbench: a page in the browser on which frames and numbers follow light, camera and tissue."""

from __future__ import annotations

import html
import os
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from types import TracebackType

from . import _given
from ._commands import _file_of
from ._experiment import Experiment
from ._fluorspar import FluorsparError


class Workbench:
    """A workbench that answers until :meth:`close`, the end of a ``with``, or that of Python. In a notebook it shows its link."""

    def __init__(self, source: Experiment | str | os.PathLike[str] | None, spp: int, port: int | None) -> None:
        with ExitStack() as kept:
            file = kept.enter_context(_file_of(source))
            words = [sys.executable, "-m", "fluorspar", "workbench", "-q", "--spp", str(spp), *file]
            words += [] if port is None else ["--port", str(port)]
            errors = kept.enter_context(tempfile.TemporaryFile("w+", encoding="utf-8"))
            process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=errors, text=True)
            assert process.stdout
            self.address: str = process.stdout.readline().strip()
            if not self.address:
                process.stdout.close()
                code = process.wait()
                errors.seek(0)
                error = FluorsparError(errors.read().strip().removeprefix("error: "))
                error.code = code
                raise error
            self._process: subprocess.Popen[str] = process
            self._kept: ExitStack = kept.pop_all()

    def close(self) -> None:
        """Ends it."""
        self._process.terminate()
        self._process.wait()
        if self._process.stdout:
            self._process.stdout.close()
        self._kept.close()

    def __enter__(self) -> Workbench:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def __del__(self) -> None:
        if hasattr(self, "_kept"):
            self.close()

    def __repr__(self) -> str:
        return f"<Workbench at {self.address}>"

    def _repr_html_(self) -> str:
        address = html.escape(self.address)
        return f'The workbench is at <a href="{address}" target="_blank" rel="noopener">{address}</a> of this machine.'


def workbench(
    source: Experiment | str | os.PathLike[str] | None = None, *, spp: int = 4, port: int | None = None
) -> Workbench:
    """Opens the workbench on an experiment, the folder of a run or a component image: ``workbench(e).address`` is its address.

    ``spp`` are the samples per pixel of what is rendered for the page; ``port`` is one of this machine, free by default.
    """
    return Workbench(source, _given.whole(spp, "spp"), None if port is None else _given.whole(port, "port"))
