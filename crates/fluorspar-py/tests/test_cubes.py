"""Cubes and scenes for other programs, as these read them."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

import fluorspar as fs

# Sums of components in another order
ROUNDING = 3e-6


@pytest.fixture(scope="session")
def rendered(components, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("cubes") / "components.exr"
    components.write(path)
    return path


@pytest.fixture(scope="session")
def blue(components) -> np.ndarray:
    """Radiance under the light of one capture, as the package itself sums it."""
    return components.weighted({"blue": 1.0})


def written(rendered: Path, name: str, **options) -> Path:
    path = rendered.parent / name
    fs.cube(rendered, out=path, **{"capture": "blue", **options})
    return path


def test_xarray_opens_a_zarr_by_wavelength(rendered, components, blue) -> None:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("zarr")
    data = xarray.open_zarr(written(rendered, "blue.zarr"))
    assert data.radiance.dims == ("y", "x", "wavelength")
    assert data.radiance.attrs["units"] == "W m-2 sr-1 nm-1" and data.wavelength.attrs["units"] == "nm"
    np.testing.assert_allclose(data.radiance.values, blue, rtol=ROUNDING)
    band = int(np.flatnonzero(components.wavelengths_nm == 525.0)[0])
    np.testing.assert_allclose(data.radiance.sel(wavelength=525).values, blue[:, :, band], rtol=ROUNDING)
    np.testing.assert_array_equal(data.depth.values, components.depth_m)
    np.testing.assert_array_equal(data.part.values, components.part)
    assert data.part.attrs["names"] == components.part_names and data.attrs["capture"] == "blue"
    # A pixel of the middle is as large as the camera matrix says at the median distance
    focal = data.attrs["camera_matrix_px"][0][0]
    assert data.attrs["mm_per_pixel"] == pytest.approx(1e3 * data.attrs["distance_m"] / focal)
    assert tomllib.loads(data.attrs["toml"])["render"]["width_px"] == blue.shape[1]
    # White light alone is another cube
    white = xarray.open_zarr(written(rendered, "white.zarr", capture="white"))
    assert not np.allclose(white.radiance.values, blue)


def test_xarray_opens_components_as_the_package_has_them(rendered, components) -> None:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("zarr")
    data = xarray.open_zarr(written(rendered, "parts.zarr", capture=None, components=True))
    own = components.to_xarray()
    assert data.radiance.dims == own.radiance.dims
    np.testing.assert_array_equal(data.radiance.values, own.radiance.values)
    for name in ("component", "light_group", "path", "wavelength"):
        assert data[name].values.tolist() == own[name].values.tolist() and name in data.coords
    assert data.attrs["toml"] == own.attrs["toml"] and data.attrs["sha256"] == own.attrs["sha256"]


def test_spy_opens_envi_with_wavelengths(rendered, components, blue) -> None:
    spectral = pytest.importorskip("spectral")
    path = written(rendered, "blue.hdr")
    image = spectral.open_image(str(path))
    np.testing.assert_allclose(np.asarray(image.load(dtype=np.float32)), blue, rtol=ROUNDING)
    np.testing.assert_allclose(image.bands.centers, components.wavelengths_nm)
    assert image.bands.band_unit == "Nanometers" and set(image.bands.bandwidths) == {5.0}
    assert image.metadata["data units"] == "W/(sr m^2 nm)"
    parts = spectral.open_image(str(path.with_name("blue_part.hdr")))
    np.testing.assert_array_equal(parts.read_band(0), components.part)
    assert parts.metadata["class names"][1:] == components.part_names
    # What SPy writes is read
    scaled = path.with_name("spy.hdr")
    metadata = {"wavelength": list(components.wavelengths_nm), "data units": "uW/(cm^2 sr nm)"}
    spectral.envi.save_image(str(scaled), 100 * blue, interleave="bsq", metadata=metadata, ext=".img")
    fs.cube(scaled, out=path.with_name("back.npy"))
    np.testing.assert_allclose(np.load(path.with_name("back.npy")), blue, rtol=ROUNDING)


def test_scipy_opens_a_scene_of_isetcam(rendered, components, blue) -> None:
    io = pytest.importorskip("scipy.io")
    path = written(rendered, "blue.mat")
    scene = io.loadmat(path, simplify_cells=True)["scene"]
    nm = components.wavelengths_nm
    photons = blue * (nm * 1e-9 / (6.62607015e-34 * 299792458.0))
    np.testing.assert_allclose(scene["data"]["photons"], photons, rtol=1e-5)
    np.testing.assert_array_equal(scene["spectrum"]["wave"], nm)
    assert scene["type"] == "scene" and 10 < scene["wAngular"] < 120
    np.testing.assert_array_equal(scene["depthMap"], components.depth_m)
    assert (scene["data"]["photons"] <= scene["illuminant"]["data"]["photons"]).all()
    # What SciPy writes is read
    other = path.with_name("other.mat")
    io.savemat(other, {"scene": scene}, do_compression=True)
    fs.cube(other, out=path.with_name("back.npy"))
    np.testing.assert_allclose(np.load(path.with_name("back.npy")), blue, rtol=1e-5)


def test_irradiance_on_the_film_is_less_than_radiance(rendered, blue) -> None:
    written(rendered, "film.npy", on_film=True)
    film = np.load(rendered.parent / "film.npy")
    # pi over 1 + 4 N^2, times what lens and filter pass
    assert film.shape == blue.shape and 0 < film.sum() < blue.sum()


def test_tifffile_opens_frames_with_names_and_wavelengths(rendered, mouth, components) -> None:
    tifffile = pytest.importorskip("tifffile")
    folder = rendered.parent / "frames"
    fs.command("capture", rendered, "--format", "ome-tiff", "--out", folder)
    with tifffile.TiffFile(folder / "frame_blue.ome.tiff") as file:
        assert file.is_ome and file.series[0].axes == "CYX"
        pixels = file.asarray()
        description = tifffile.xml2dict(file.ome_metadata)["OME"]["Image"]["Pixels"]
    names = [channel["Name"] for channel in description["Channel"]]
    assert names == ["blue R", "blue G", "blue B"]
    emission = [channel["EmissionWavelength"] for channel in description["Channel"]]
    assert emission == sorted(emission, reverse=True) and all(450 < nm < 700 for nm in emission)
    assert 380 < description["Channel"][0]["ExcitationWavelength"] < 390
    assert 0.05 < description["PhysicalSizeX"] < 1 and description["PhysicalSizeXUnit"] == "mm"
    assert pixels.shape[1:] == fs.capture(mouth, components)["blue"].raw.shape[:2]
    types = pytest.importorskip("ome_types")
    assert types.from_tiff(folder / "frame_blue.ome.tiff").images[0].pixels.size_c == 3


def test_ome_zarr_has_the_pages_of_ome_tiff(rendered) -> None:
    zarr = pytest.importorskip("zarr")
    tifffile = pytest.importorskip("tifffile")
    for form in ("ome-zarr", "ome-tiff"):
        fs.command("capture", rendered, "--format", form, "--out", rendered.parent / form)
    path = rendered.parent / "ome-zarr" / "frame_blue.ome.zarr"
    group = zarr.open_group(path, mode="r")
    ome, own = group.attrs["ome"], group.attrs["fluorspar"]
    scale = ome["multiscales"][0]
    assert ome["version"] == "0.5" and [axis["name"] for axis in scale["axes"]] == ["c", "y", "x"]
    pixels = group[scale["datasets"][0]["path"]]
    assert pixels.metadata.dimension_names == ("c", "y", "x")
    with tifffile.TiffFile(rendered.parent / "ome-tiff" / "frame_blue.ome.tiff") as file:
        np.testing.assert_array_equal(pixels[:], file.asarray())
        description = tifffile.xml2dict(file.ome_metadata)["OME"]["Image"]["Pixels"]
    assert [shown["label"] for shown in ome["omero"]["channels"]] == [channel["Name"] for channel in description["Channel"]]
    assert own["emission_nm"] == [channel["EmissionWavelength"] for channel in description["Channel"]]
    side = description["PhysicalSizeX"]
    assert scale["datasets"][0]["coordinateTransformations"][0]["scale"] == [1.0, side, side]
    # What says that a picture is one reads it
    reader = pytest.importorskip("ome_zarr.reader")
    found = next(iter(reader.Reader(pytest.importorskip("ome_zarr.io").parse_url(path))()))
    np.testing.assert_array_equal(np.asarray(found.data[0]), pixels[:])


def test_what_a_cube_can_t_be_is_told(rendered) -> None:
    with pytest.raises(fs.FluorsparError, match="the name tells no form"):
        fs.cube(rendered, out=rendered.parent / "a.jpg")
    with pytest.raises(fs.FluorsparError, match="the captures are"):
        fs.cube(rendered, capture="green", out=rendered.parent / "a.zarr")
    with pytest.raises(fs.FluorsparError, match="holds one light"):
        fs.cube(written(rendered, "one.hdr"), capture="blue", out=rendered.parent / "a.zarr")


def test_trimesh_opens_a_mouth_with_its_camera(tmp_path) -> None:
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / "mouth.glb"
    fs.text_of("scene", "convert", "oraleye-2021-surface", "--capture", "blue", "--out", path)
    scene = trimesh.load(path)
    assert "tongue_dorsum" in scene.geometry and len(scene.geometry) > 40
    low, high = scene.bounds
    # Meters: a head is some 20 cm high
    assert 0.1 < high[1] - low[1] < 0.4
    field = fs.experiment("oraleye-2021-surface").get("camera.horizontal_field_deg")
    assert field == "from_lens" and scene.camera.fov[0] == pytest.approx(42.4, abs=2)
    length = int.from_bytes(path.read_bytes()[12:16], "little")
    document = json.loads(path.read_bytes()[20 : 20 + length])
    lights = document["extensions"]["KHR_lights_punctual"]["lights"]
    assert lights and all(light["intensity"] == pytest.approx(683 * light["extras"]["radiant_intensity_w_per_sr"]) for light in lights)
