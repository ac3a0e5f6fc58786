"""The notebooks of the documentation run from the first cell to the last, from a picture to a decision."""

from __future__ import annotations

from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).parents[3] / "docs/notebooks").glob("*.ipynb"))


def test_there_are_seven() -> None:
    assert len(NOTEBOOKS) == 7


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path) -> None:
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("matplotlib")
    if "tifffile" in path.read_text():
        pytest.importorskip("tifffile")
    if "dask" in path.read_text():
        pytest.importorskip("distributed")
    book = nbformat.read(path, as_version=4)
    assert not any(cell.get("outputs") for cell in book.cells), "clear the outputs before you keep a notebook"
    nbclient.NotebookClient(book, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    first, *_, last = (cell.outputs for cell in book.cells if cell.cell_type == "code")
    assert any(kind.startswith("image/") for output in first for kind in output.get("data", {})), "begin with a picture"
    assert any(output.output_type == "stream" for output in last), "end with a decision"
