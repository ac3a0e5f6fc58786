"""Progress of long work: a bar of rich or tqdm where they are installed, else a line."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from . import _given

Tell = Callable[[int, int], None]


class _Line:
    """A line on standard error that is written anew, at most five times a second."""

    def __init__(self, title: str) -> None:
        self.title, self.told = title, 0.0

    def __enter__(self) -> Tell:
        return self.tell

    def tell(self, done: int, total: int) -> None:
        """Says what share is done."""
        now = time.monotonic()
        if now - self.told > 0.2 and sys.stderr.isatty():
            self.told = now
            print(f"\r{self.title} {100 * done // max(total, 1):3d} %", end="", file=sys.stderr, flush=True)

    def __exit__(self, *_: object) -> None:
        if self.told:
            print("\r" + " " * (len(self.title) + 6) + "\r", end="", file=sys.stderr, flush=True)


class _Tqdm:
    """A bar of tqdm, which draws in notebooks and terminals."""

    def __init__(self, title: str) -> None:
        from tqdm.auto import tqdm

        self.bar = tqdm(total=1.0, desc=title, bar_format="{l_bar}{bar}| {elapsed}<{remaining}", leave=False)

    def __enter__(self) -> Tell:
        return self.tell

    def tell(self, done: int, total: int) -> None:
        """Says what share is done."""
        self.bar.n = done / max(total, 1)
        self.bar.refresh()

    def __exit__(self, *_: object) -> None:
        self.bar.close()


class _Rich:
    """A bar of rich."""

    def __init__(self, title: str) -> None:
        from rich.progress import Progress

        self.bar: Any = Progress(transient=True)
        self.task = self.bar.add_task(title, total=None)

    def __enter__(self) -> Tell:
        self.bar.start()
        return self.tell

    def tell(self, done: int, total: int) -> None:
        """Says what share is done."""
        self.bar.update(self.task, completed=done, total=total)

    def __exit__(self, *_: object) -> None:
        self.bar.stop()


def progress_of(progress: str | Tell | None, title: str) -> AbstractContextManager[Tell | None]:
    """What tells of progress: ``"auto"``, ``"rich"``, ``"tqdm"``, ``"line"``, a function of paths done and all paths, or nothing."""
    if progress is None or callable(progress):
        return nullcontext(progress)
    kinds: dict[str, list[Callable[[str], AbstractContextManager[Tell]]]] = {"rich": [_Rich], "tqdm": [_Tqdm], "line": [_Line], "auto": [_Rich, _Tqdm, _Line]}
    if not isinstance(progress, str):
        raise _given.wrong_type("progress", f"a function, None, or one of {', '.join(map(repr, kinds))}", progress)
    if progress not in kinds:
        raise ValueError(f"progress={progress!r}: give a function, None, or one of {', '.join(map(repr, kinds))}")
    for kind in kinds[progress]:
        try:
            return kind(title)
        except ImportError:
            if progress != "auto":
                raise
    return nullcontext(None)
