"""Studies: photographs of people over time, what is estimated of them, what is normal, and what leaves the clinic."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from . import _fluorspar, _given
from ._commands import _done, _file_of
from ._experiment import Experiment
from ._record import Record
from ._warning import warn_of

if TYPE_CHECKING:
    import numpy as np
    import pandas
    import pyarrow
    from numpy.typing import NDArray

#: Columns of numbers of people, and those of people against norms: what an entry is, and how the ends of an interval are called.
_NUMBERS: dict[str, type | tuple[str, str]] = {
    "subject": str,
    "session": str,
    "region": str,
    "quantity": str,
    "channel": str,
    "value": float,
    "interval": ("low", "high"),
    "interval_kind": str,
    "withdrawn": bool,
    "site": str,
    "age": float,
    "consent": str,
    "analysis": str,
    "version": str,
    "photograph": str,
    "verdict": str,
}
_AGAINST_NORM: dict[str, type | tuple[str, str]] = {
    "subject": str,
    "session": str,
    "region": str,
    "quantity": str,
    "value": float,
    "interval": ("low", "high"),
    "has_error": bool,
    "norm": str,
    "range": ("range_low", "range_high"),
    "percentile": ("percentile_low", "percentile_high"),
    "standing": str,
}


class Table(Mapping[str, "NDArray[Any]"]):
    """Columns by name, read-only arrays of one length: numbers are float64, NaN where there is none, others texts or booleans.

    ``table["value"].mean()``; :meth:`to_pandas` and :meth:`to_arrow` give what these packages call a table.
    """

    def __init__(self, columns: Mapping[str, NDArray[Any]]) -> None:
        self._columns = dict(columns)

    @classmethod
    def _of(cls, rows: Iterable[Record], kinds: Mapping[str, type | tuple[str, str]]) -> Table:
        """Records of one kind as columns."""
        import numpy as np

        rows = list(rows)
        columns: dict[str, NDArray[Any]] = {}
        for name, kind in kinds.items():
            if isinstance(kind, tuple):
                for end, column in enumerate(kind):
                    ends = [None if row[name] is None else row[name][end] for row in rows]
                    columns[column] = np.array(ends, dtype=np.float64)
            else:
                columns[name] = np.array([row[name] for row in rows], dtype=kind)
        for values in columns.values():
            values.flags.writeable = False
        return cls(columns)

    def __getitem__(self, name: str) -> NDArray[Any]:
        try:
            return self._columns[name]
        except KeyError:
            raise _given.unknown("column", name, self._columns) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    @property
    def rows(self) -> int:
        """How many rows it has."""
        return len(next(iter(self._columns.values()), ()))

    def to_pandas(self) -> pandas.DataFrame:
        """A data frame of pandas, which must be installed."""
        import pandas

        return pandas.DataFrame(self._columns)

    def to_arrow(self) -> pyarrow.Table:
        """A table of Arrow, which pyarrow must be installed for: no number is null."""
        import pyarrow

        kinds = {"U": pyarrow.string(), "f": pyarrow.float64(), "b": pyarrow.bool_()}
        columns = {name: pyarrow.array(of.tolist(), kinds[of.dtype.kind], from_pandas=True) for name, of in self._columns.items()}
        return pyarrow.table(columns)

    def __repr__(self) -> str:
        return f"<Table of {self.rows} rows: {', '.join(self)}>"

    def _repr_html_(self) -> str:
        rows = [Record(zip(self._columns, values)) for values in zip(*(of.tolist() for of in self._columns.values()))]
        return Record({f"{self.rows} rows": rows})._repr_html_()


def _telling(found: Record) -> Record:
    """An answer whose failures are warned of: what fails is told, and the rest goes on."""
    warn_of(of if isinstance(of, str) else f"{of.frame}: {of.why}" for of in found.failures)
    return found


class Study:
    """A study in a folder: ``Study("gums").query(quantity="chromaticity_r")``. Every call opens it and leaves it complete on the disk.

    The arguments of calls are the options of ``fluorspar study``. What fails of many photographs is an :class:`FluorsparWarning`
    each and stands in ``failures``; the rest goes on.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder: str = _given.file(folder, "folder")

    @classmethod
    def init(
        cls, folder: str | os.PathLike[str], experiment: Experiment | str | os.PathLike[str], **options: Any
    ) -> Study:
        """Begins a study in a new folder, with a copy of the experiment of its camera: ``init("teeth", "flat-patch", site="north")``."""
        with _file_of(experiment) as words:
            _done(_fluorspar.study_init, study=_given.path(folder, "folder"), experiment=words[0], **options)
        return cls(folder)

    def import_(self, photographs: str | os.PathLike[str] | None = None, **options: Any) -> Record:
        """Takes photographs, people and outcomes in, each file once: ``import_("photos", subjects="people.csv").photographs``."""
        return _telling(self._do(_fluorspar.study_import, photographs=photographs, **options))

    def analyze(self, **options: Any) -> Record:
        """Estimates the regions that have no estimate; with ``missing=True`` also those that another version of the program, or
        another camera.toml, estimated: ``analyze().regions`` are so many."""
        return _telling(self._do(_fluorspar.study_analyze, **options))

    def query(self, **options: Any) -> Table:
        """The last numbers of people, a row each: ``query(subject="P01")["value"]``; the ends of intervals are ``low`` and ``high``."""
        return Table._of(self._do(_fluorspar.study_query, **options), _NUMBERS)

    def norm(self, **options: Any) -> Record:
        """What is normal among the people of the study: ``norm(quantity="chromaticity_r", region="tongue").ranges[0].range``."""
        return norm(study=self.folder, **options)

    def compare(self, norm: str | os.PathLike[str] | Iterable[str | os.PathLike[str]], **options: Any) -> Record:
        """Holds people against norms; ``people`` is a :class:`Table`: ``compare("norm.json").people["standing"]`` is "inside",
        "outside" or "cannot_tell"."""
        found = self._do(_fluorspar.study_compare, norm=norm, **options)
        return Record(found, people=Table._of(found.people, _AGAINST_NORM))

    def export(self, out: str | os.PathLike[str], **options: Any) -> Record:
        """Writes what may leave the clinic: people by codes, frames anew from their pixels: ``export("share", no_frames=True).subjects``."""
        return _telling(self._do(_fluorspar.study_export, out=_given.path(out, "out"), **options))

    def verify(self, **options: Any) -> list[str]:
        """What is wrong with files, log or index: ``verify()`` is empty where every byte is the one that was taken in."""
        defects: list[str] = self._do(_fluorspar.study_verify, **options).defects
        return defects

    def drift(self, **options: Any) -> Record:
        """How much a new version of the program or of camera.toml changed, and who crosses a limit of a ``norm``."""
        found: Record = self._do(_fluorspar.study_drift, **options)
        return found

    def withdraw(self, subject: str, **options: Any) -> None:
        """Takes a person out of all later norms and exports."""
        self._do(_fluorspar.study_withdraw, subject=_given.text(subject, "subject"), **options)

    def _do(self, task: Any, **options: Any) -> Any:
        return _done(task, study=self.folder, **options)

    def __repr__(self) -> str:
        return f"<Study {self.folder}>"


def norm(**options: Any) -> Record:
    """What is normal: of a study, of simulated people, or of several sites from their norms alone.

    ``norm(pool=["norm.json", "south.json"], out="both.json").ranges``, or ``norm(cohort="cohort.csv", region="tongue_dorsum",
    quantity="chromaticity_r")``; options are those of ``fluorspar study norm``. ``norm`` of what is returned is the content of the file.
    """
    return _done(_fluorspar.study_norm, **options)
