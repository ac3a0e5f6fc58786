"""Studies: the numbers of the program, as tables, and what leaves the clinic as other programs read it."""

from __future__ import annotations

import json

import numpy as np
import pytest

import fluorspar as fs


@pytest.fixture(scope="module")
def study(photographs, tmp_path_factory) -> fs.Study:
    study = fs.Study.init(tmp_path_factory.mktemp("study") / "st", photographs / "camera.toml", site="north")
    assert study.import_(photographs / "photos", subjects=photographs / "people.csv").photographs == 12
    assert study.analyze().regions == 12
    return study


def test_a_table_has_the_rows_of_the_program(study, program) -> None:
    said = json.loads(program("study", "query", study.folder, "--json"))
    table = study.query()
    assert table.rows == len(said) > 12
    assert {*said[0]} - {*table} == {"interval"} and {*table} - {*said[0]} == {"low", "high"}
    for name in ("subject", "quantity", "channel", "withdrawn", "verdict"):
        assert table[name].tolist() == [row[name] for row in said]
    values = np.array([np.nan if row["value"] is None else row["value"] for row in said])
    assert np.array_equal(table["value"], values, equal_nan=True) and not table["value"].flags.writeable
    assert np.array_equal(table["low"], [row["interval"][0] if row["interval"] else np.nan for row in said], equal_nan=True)
    none = study.query(region="nowhere")
    assert none.rows == 0 and list(none) == list(table)
    with pytest.raises(fs.FluorsparError, match="no person P99"):
        study.query(subject="P99")
    with pytest.raises(fs.UnknownName, match="there is no column 'mean'; there are subject, "):
        table["mean"]


def test_tables_become_those_of_pandas_and_arrow(study) -> None:
    table = study.query(quantity="chromaticity_r")
    pandas = pytest.importorskip("pandas")
    frame = table.to_pandas()
    assert isinstance(frame, pandas.DataFrame) and frame["value"].tolist() == table["value"].tolist()
    pytest.importorskip("pyarrow")
    arrow = table.to_arrow()
    assert arrow["value"].to_pylist() == table["value"].tolist() and arrow["subject"].to_pylist() == table["subject"].tolist()
    assert study.query(region="nowhere").to_arrow().schema == arrow.schema


def test_people_stand_in_a_norm(study, program, tmp_path) -> None:
    said = study.norm(quantity="chromaticity_r", out=tmp_path / "norm.json")
    assert said.ranges[0].people == 12 and said.norm == json.loads((tmp_path / "norm.json").read_text())
    found = study.compare(tmp_path / "norm.json")
    again = json.loads(program("study", "compare", study.folder, "--norm", tmp_path / "norm.json", "--json"))
    assert found.people["percentile_low"].tolist() == [row["percentile"][0] for row in again["people"]]
    assert set(found.people["standing"]) <= {"inside", "outside", "cannot_tell"} and found.people.rows == 12
    with pytest.raises(fs.FluorsparError, match="one norm is not pooled"):
        fs.norm(pool=tmp_path / "norm.json")
    assert study.verify() == []


def test_what_fails_is_told_and_the_rest_goes_on(photographs, tmp_path) -> None:
    study = fs.Study.init(tmp_path / "st", fs.load(photographs / "camera.toml"))
    rows = (photographs / "photos/photographs.csv").read_text().splitlines()[:5]
    (photographs / "photos/two.csv").write_text("\n".join(rows).replace("8,6,16,12", "8,6,99,99", 1))
    study.import_(photographs / "photos/two.csv")
    with pytest.warns(fs.FluorsparWarning, match="P01"):
        done = study.analyze()
    assert (done.regions, len(done.failures)) == (1, 1)
    with pytest.raises(fs.MissingFile):
        fs.Study(tmp_path / "none")
    with pytest.raises(fs.FluorsparError, match="this is no study"):
        fs.Study(tmp_path).query()


def test_exported_numbers_are_a_dataset_of_parquet(study, tmp_path) -> None:
    """By site and camera, as pyarrow, polars and DuckDB read it."""
    done = study.export(tmp_path / "share", parquet=True, no_frames=True)
    study.export(tmp_path / "plain", no_frames=True)
    lines = (tmp_path / "plain/estimates.csv").read_text().splitlines()
    values = [float(cell) if (cell := line.split(",")[6]) else None for line in lines[1:]]
    assert done.estimates == len(values) and not (tmp_path / "share/estimates.csv").exists()
    dataset = pytest.importorskip("pyarrow.dataset")
    table = dataset.dataset(tmp_path / "share/estimates", partitioning="hive").to_table()
    assert table["value"].to_pylist() == values and set(table["visit"].to_pylist()) == {1}
    assert set(table["device"].to_pylist()) == {f"camera-{study.query()['analysis'][0][:12]}"}
    assert f"\t{table['site'][0]}\t" in (tmp_path / "share/participants.tsv").read_text()
    assert table["participant_id"].to_pylist() == [line.split(",")[0] for line in lines[1:]]
    files = f"{tmp_path}/share/estimates/**/*.parquet"
    polars = pytest.importorskip("polars")
    assert polars.scan_parquet(files, hive_partitioning=True).collect()["value"].to_list() == values
    duckdb = pytest.importorskip("duckdb")
    assert [row[0] for row in duckdb.sql(f"SELECT value FROM read_parquet('{files}', hive_partitioning = true)").fetchall()] == values


def test_exported_pictures_are_read_as_dicom(study, photographs, tmp_path) -> None:
    pydicom = pytest.importorskip("pydicom")
    study.export(tmp_path / "share", dicom=True, no_frames=True)
    files = sorted((tmp_path / "share").rglob("*.dcm"))
    assert len(files) == 24
    people = (tmp_path / "share/participants.tsv").read_text()
    pictures = []
    for file in files:
        image = pydicom.dcmread(file)
        assert image.SOPClassUID.name == "VL Photographic Image Storage" and image.PatientIdentityRemoved == "YES"
        assert f"sub-{image.PatientID}\t" in people and not image.StudyDate
        pictures.append(image.pixel_array)
    # As the frame looked that was captured of what camera.toml describes
    assert np.load(photographs / "shown.npy").tobytes() in [picture.tobytes() for picture in pictures]
