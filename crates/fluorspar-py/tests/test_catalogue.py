"""The catalogue, mouths, and what notebooks show."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import fluorspar as fs

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.mark.parametrize(
    "thing",
    [fs.light("led_385"), fs.filters("view_475_700"), fs.reflectance("enamel"), fs.fluorophore("collagen")],
    ids=repr,
)
def test_the_catalogue_is_shown_as_figures(thing, tmp_path) -> None:
    svg = thing._repr_svg_()
    assert svg.startswith("<svg") and "nm" in svg
    thing.plot(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").read_bytes().startswith(PNG)


def test_one_figure_holds_light_fluorophore_filter_and_sensor(tmp_path) -> None:
    fs.plot(tmp_path / "chain.svg", light="led_385", fluorophore=["collagen"], view_filter="view_475_700")
    assert "collagen" in (tmp_path / "chain.svg").read_text().lower()


def test_frames_and_results_are_shown(mouth, components) -> None:
    shots = fs.capture(mouth, components)
    assert shots["white"]._repr_png_().startswith(PNG)
    assert shots._repr_html_().count("<img") == len(shots)
    analysis = fs.analyze(mouth, shots, components=components)
    assert "<img" in analysis._repr_html_() and "chromaticity" in analysis._repr_html_()
    assert all(label in components._repr_html_() for label in components.labels)
    assert "<img" in mouth._repr_html_() and "light.blue" in mouth._repr_html_()


def test_a_mouth_has_meshes_and_dimensions(program, tmp_path) -> None:
    person = fs.mouth(person=7, detail=0.4)
    meshes = person.meshes()
    dorsum = meshes["tongue_dorsum"]
    assert dorsum.triangles.max() == len(dorsum.vertices_m) - 1 and dorsum.triangles.shape[1] == 3
    np.testing.assert_allclose(np.linalg.norm(dorsum.normals, axis=1), 1, atol=1e-3)
    size_mm = 1e3 * np.ptp(dorsum.vertices_m, axis=0)
    assert 30 < size_mm.max() < 120
    said = json.loads(program("mouth", "generate", "--person", 7, "--detail", 0.4, "--json"))
    assert person.parameters == said["parameters"] and person.dimensions == said["dimensions"]
    wide = fs.mouth(jaw_opening_mm=50)
    assert wide.parameters.jaw_opening_mm == 50
    with pytest.raises(fs.FluorsparError, match="jaw_opening_mm"):
        fs.mouth(jaw_opening=50).parameters


def test_a_mesh_comes_from_a_file(tmp_path) -> None:
    place = tmp_path / "one.obj"
    place.write_text("v 0 0 0\nv 10 0 0\nv 0 20 0\nf 1 2 3\n")
    mesh = fs.Mesh.read(place, unit_m=1e-3)
    np.testing.assert_allclose(mesh.vertices_m[1:], [[0.01, 0, 0], [0, 0.02, 0]], atol=1e-9)
    assert mesh.triangles.tolist() == [[0, 1, 2]]
    again = fs.Mesh.read(place, unit_m=1e-3)
    assert mesh == again and mesh != fs.Mesh.read(place) and mesh != 3
    assert pickle.loads(pickle.dumps(mesh)) == mesh


def test_types_and_names_are_those_of_the_schema() -> None:
    here = Path(__file__).parents[1]
    done = subprocess.run([sys.executable, here / "generate_sections.py", "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
