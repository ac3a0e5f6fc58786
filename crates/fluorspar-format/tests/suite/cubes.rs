//! Spectral cubes in forms of other programs. Independent readers: `fluorspar-py/tests/test_cubes.py`.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::io::Read;
use std::path::Path;

use fluorspar::image::{Component, ComponentImage, FeatureMaps, LightPath, SpectralImage, View};
use fluorspar::spectral::{Quantity, Radiance, WavelengthGrid};
use fluorspar_format::{
    Cube, CubeFacts, CubeForm, CubeLight, OmeChannel, OmeFacts, read_cube, write_component_zarr,
    write_ome_tiff, write_ome_zarr,
};

const SIZE: [usize; 2] = [7, 3];

fn image<Q: Quantity>() -> SpectralImage<Q> {
    let grid = WavelengthGrid::from_edges(&[400.0, 410.0, 425.0, 430.0, 450.0]).unwrap();
    let data = (0..SIZE[0] * SIZE[1] * 4).map(|i| 1e-3 * (1.0 + (i as f32 * 0.37).sin())).collect();
    SpectralImage::from_data(grid, SIZE[0], SIZE[1], data).unwrap()
}

fn maps() -> FeatureMaps {
    let view = View {
        position_m: [0.0, 0.0, 0.1],
        forward: [0.0, 0.0, -1.0],
        right: [1.0, 0.0, 0.0],
        tan_half_width: 0.5,
    };
    FeatureMaps {
        depth_m: (0..21).map(|i| if i == 3 { f32::INFINITY } else { 0.1 + 1e-3 * i as f32 }).collect(),
        part: (0..21).map(|i| i % 3).collect(),
        part_names: vec!["tongue".into(), "lip, lower".into()],
        material_names: vec!["mucosa".into(); 2],
        view: Some(view),
        ..FeatureMaps::default()
    }
}

fn cube(light: CubeLight) -> Cube {
    let facts = CubeFacts::of_maps(maps(), SIZE);
    Cube { light, facts: CubeFacts { title: "a mouth".into(), capture: Some("blue".into()), ..facts } }
}

/// Writes a cube and reads it.
fn back(folder: &Path, name: &str, light: CubeLight) -> Cube {
    let path = folder.join(name);
    CubeForm::of(&path).unwrap().write(&path, &cube(light)).unwrap();
    read_cube(&path).unwrap()
}

fn largest_relative_difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs() / a.abs().max(1e-12)).fold(0.0, f32::max)
}

#[test]
fn cubes_come_back_from_envi_and_isetcam() {
    let folder = tempfile::tempdir().unwrap();
    for light in [CubeLight::Radiance(image()), CubeLight::Irradiance(image())] {
        let envi = back(folder.path(), "a.hdr", light.clone());
        assert_eq!((&envi.light, envi.facts.capture.as_deref()), (&light, Some("blue")));
        let iset = back(folder.path(), "a.mat", light.clone());
        assert_eq!(std::mem::discriminant(&iset.light), std::mem::discriminant(&light));
        let difference = largest_relative_difference(light.values(), iset.light.values());
        assert!(difference < 1e-6, "{difference}");
        assert_eq!(iset.light.size(), SIZE);
        // ISETCam knows middles of bands alone
        assert!((iset.light.grid().center_nm(1) - 415.625).abs() < 3.0);
        assert!((iset.facts.camera_matrix_px.unwrap()[0][0] - 7.0).abs() < 1e-5);
        assert_eq!(iset.facts.title, "a mouth");
    }
    // What the maps tell: half of the pixels with something see it within 11 cm
    let facts = CubeFacts::of_maps(maps(), SIZE);
    let distance = facts.distance_m.unwrap();
    assert!((0.100..0.115).contains(&distance), "{distance}");
    assert!((facts.mm_per_pixel.unwrap() - 1e3 * distance / 7.0).abs() < 1e-9);
}

/// One cube in all orders of bands and bytes that ENVI knows.
#[test]
fn envi_is_read_in_every_order() {
    let folder = tempfile::tempdir().unwrap();
    let (path, [width, height]) = (folder.path().join("b.hdr"), [3, 2]);
    let value = |row: usize, col: usize, band: usize| (100 * row + 10 * col + band) as i16;
    let place = |order: &str, n: usize| match order {
        "bip" => (n / 6, n / 2 % 3, n % 2),
        "bil" => (n / 6, n % 3, n / 3 % 2),
        _ => (n / 3 % 2, n % 3, n / 6),
    };
    for (order, byte_order) in [("bip", 0), ("bil", 1), ("bsq", 0)] {
        let header = format!(
            "ENVI\nsamples = {width}\nlines={height}\nbands = 2\nheader offset = 5\ndata type = 2\ninterleave = {order}\n\
             byte order = {byte_order}\nwavelength units = Micrometers\nwavelength = {{0.5,\n 0.51}}\ndata units = uW/(cm^2 sr nm)\n"
        );
        fs::write(&path, header).unwrap();
        let values = (0..12).map(|n| {
            let (row, col, band) = place(order, n);
            let value = value(row, col, band);
            if byte_order == 1 { value.to_be_bytes() } else { value.to_le_bytes() }
        });
        fs::write(path.with_extension("img"), [vec![0; 5], values.flatten().collect()].concat()).unwrap();
        let CubeLight::Radiance(image) = read_cube(&path).unwrap().light else { panic!("irradiance") };
        assert_eq!(image.grid().centers_nm(), [500.0, 510.0]);
        for (row, col, band) in [(0, 0, 0), (1, 2, 1), (1, 0, 0), (0, 1, 1)] {
            let wanted = 0.01 * f32::from(value(row, col, band));
            assert!((image.pixel(row, col)[band] - wanted).abs() < 1e-5, "{order} {row} {col} {band}");
        }
    }
}

/// Integers with the gains and offsets that most instruments write.
#[test]
fn gains_and_offsets_of_bands_are_applied_and_ignored_values_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("g.hdr");
    let header = "ENVI\nsamples = 2\nlines = 1\nbands = 2\ndata type = 2\ninterleave = bip\nwavelength = {500, 510}\n\
                  data units = mW/(m^2 sr nm)\ndata gain values = {0.01, 0.02}\ndata offset values = {0, 0.5}\n";
    let write = |header: &str, values: [i16; 4]| {
        fs::write(&path, header).unwrap();
        fs::write(path.with_extension("dat"), values.map(i16::to_le_bytes).concat()).unwrap();
        read_cube(&path)
    };
    let CubeLight::Radiance(image) = write(header, [100, 200, -10, 0]).unwrap().light else { panic!() };
    for (value, wanted) in image.data().iter().zip([1e-3, 4.5e-3, -1e-4, 0.5e-3]) {
        assert!((value - wanted).abs() < 1e-9, "{value} {wanted}");
    }
    // More than noise
    let said = write(header, [100, 200, -300, 0]).unwrap_err().to_string();
    assert!(said.contains("1 of 4 values are below 0, as far as -3.00e-3. Check"), "{said}");
    let ignoring = format!("{header}data ignore value = -9999\n");
    assert!(write(&ignoring, [1, 2, 3, 4]).is_ok());
    let said = write(&ignoring, [1, 2, -9999, 4]).unwrap_err().to_string();
    assert!(said.contains("value number 3 is -9999, the data ignore value. Put 0"), "{said}");
    assert!(write(&format!("{header}bbl = {{1, 1}}\n"), [1, 2, 3, 4]).is_ok());
    let said = write(&format!("{header}bbl = {{1,\n0}}\n"), [1, 2, 3, 4]).unwrap_err().to_string();
    assert!(said.contains("bands 2 are bad by its list of bad bands (bbl). Leave them out"), "{said}");
    let said = write(&header.replace("{0.01, 0.02}", "{0.01}"), [0; 4]).unwrap_err().to_string();
    assert!(said.contains("data gain values holds 1 numbers for 2 bands"), "{said}");
}

#[test]
fn what_is_wrong_with_a_cube_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.hdr");
    let said = |text: &str| {
        fs::write(&path, text).unwrap();
        let said = read_cube(&path).unwrap_err().to_string();
        said.strip_prefix(&format!("{}: ", path.display())).unwrap_or(&said).to_owned()
    };
    let good = "ENVI\nsamples = 1\nlines = 1\nbands = 2\ndata type = 4\ninterleave = bip\nwavelength = {500, 510}\ndata units = \
                W/(m^2 sr nm)\n";
    for (from, to, wanted) in [
        (
            "ENVI",
            "ENVY",
            "this is no header of ENVI. Its first line must be ENVI; open the header (.hdr), not the values",
        ),
        ("samples = 1\n", "", "there is no line \"samples\". Add it"),
        ("lines = 1", "lines = two", "lines = two is no whole number. Correct it"),
        ("data type = 4", "data type = 6", "data type = 6. Read are bytes"),
        ("bip", "bop", "interleave = bop. It is bip, bil or bsq"),
        ("{500, 510}", "{500, 510, 520}", "there are 2 bands and 3 wavelengths. Add `wavelength"),
        (
            "{500, 510}",
            "{500, 510}\nwavelength edges = {395, 405, 415}",
            "not every wavelength lies between the wavelength edges of its band. Give the edges in nm",
        ),
        ("{500, 510}", "{500, 510}\nwavelength edges = {495, 515}", "not every wavelength lies"),
        ("{500, 510}", "{510, 500}", "the wavelength 500 nm follows 510 nm. Sort by wavelength"),
        (
            "W/(m^2 sr nm)",
            "counts",
            "data units = counts is not read. Add what they are: `data units = W/(m^2 sr nm)`",
        ),
        ("samples = 1", "samples = 99999999999", "the image claims 1 rows and 99999999999 columns"),
        ("", "", "the file with the values is missing. Keep it beside the header"),
    ] {
        let said = said(&good.replacen(from, to, 1));
        assert!(said.starts_with(wanted), "{said}\n{wanted}");
    }
    fs::write(path.with_extension("dat"), [0; 7]).unwrap();
    assert!(said(good).contains("it has 7 bytes, and its header tells of 8. Copy both files again"));
    fs::write(path.with_extension("dat"), [0; 12]).unwrap();
    assert!(said(good).contains("it has 12 bytes, and its header tells of 8. Give samples"));
    let said = read_cube(&folder.path().join("c.zarr")).unwrap_err().to_string();
    assert!(said.contains("Zarr and OME-TIFF are written, not read. Read are ENVI (.hdr), scenes"), "{said}");
    // Light that is taken from another
    let dark = SpectralImage::from_data(image::<Radiance>().grid().clone(), 1, 1, vec![-1e-3; 4]).unwrap();
    let path = folder.path().join("c.mat");
    CubeForm::Iset.write(&path, &cube(CubeLight::Radiance(dark))).unwrap();
    assert!(read_cube(&path).unwrap_err().to_string().contains("4 of 4 values are below 0"));
}

/// The values of a chunk.
fn chunk(folder: &Path, name: &str) -> Vec<f32> {
    let mut bytes = Vec::new();
    flate2::read::GzDecoder::new(fs::File::open(folder.join(name)).unwrap()).read_to_end(&mut bytes).unwrap();
    bytes.as_chunks::<4>().0.iter().map(|four| f32::from_le_bytes(*four)).collect()
}

#[test]
fn chunks_of_zarr_hold_their_part_and_zeros_beyond() {
    let folder = tempfile::tempdir().unwrap();
    let (width, height, bands) = (130, 5, 20);
    let grid = WavelengthGrid::uniform(400.0, 495.0, 5.0).unwrap();
    let labels = vec![Component::of_group("blue", LightPath::Reflected)];
    let mut image = ComponentImage::zeros(grid, width, height, labels);
    image.data.iter_mut().enumerate().for_each(|(i, value)| *value = i as f32);
    write_component_zarr(folder.path(), &image, &CubeFacts::default()).unwrap();
    // Chunks of 1 x 5 x 128 x 16: the last has 2 columns and 4 bands
    let last = chunk(folder.path(), "radiance/c/0/0/1/1");
    assert_eq!(last.len(), 5 * 128 * 16);
    let at = |row: usize, col: usize, band: usize| last[(row * 128 + col) * 16 + band];
    let number = |row: usize, col: usize, band: usize| ((row * width + col) * bands + band) as f32;
    assert_eq!([at(0, 0, 0), at(4, 1, 3)], [number(0, 128, 16), number(4, 129, 19)]);
    assert_eq!([at(0, 0, 4), at(4, 2, 0)], [0.0; 2]);
    let group: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.path().join("zarr.json")).unwrap()).unwrap();
    let arrays = &group["consolidated_metadata"]["metadata"];
    assert_eq!(
        arrays["radiance"]["dimension_names"],
        serde_json::json!(["component", "y", "x", "wavelength"])
    );
    assert_eq!(arrays["wavelength"]["attributes"]["edges"].as_array().unwrap().len(), bands + 1);
}

#[test]
fn a_page_of_an_ome_tiff_is_a_channel() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f.ome.tiff");
    let values: Vec<f32> = (0..2 * 3 * 2).map(|i| i as f32).collect();
    let channel =
        |name: &str, nm| OmeChannel { name: name.into(), emission_nm: Some(nm), excitation_nm: Some(385.0) };
    let channels = [channel("blue \"R\" µ", 610.5), channel("G", 540.0)];
    let facts = OmeFacts { mm_per_pixel: Some(0.25), exposure_s: Some(0.03), ..OmeFacts::default() };
    write_ome_tiff(&path, [3, 2], &values, &channels, &facts).unwrap();
    let mut file = tiff::decoder::Decoder::new(fs::File::open(&path).unwrap()).unwrap();
    let text = file.get_tag_ascii_string(tiff::tags::Tag::ImageDescription).unwrap();
    for part in [
        "SizeC=\"2\"",
        "Name=\"blue &#34;R&#34; &#181;\"",
        "EmissionWavelength=\"610.5\"",
        "ExcitationWavelength=\"385\"",
        "PhysicalSizeX=\"0.25\" PhysicalSizeXUnit=\"mm\"",
        "ExposureTime=\"0.03\"",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    file.next_image().unwrap();
    let tiff::decoder::DecodingResult::F32(second) = file.read_image().unwrap() else { panic!("no floats") };
    assert_eq!(second, [1.0, 3.0, 5.0, 7.0, 9.0, 11.0]);
    assert!(write_ome_tiff(&path, [3, 3], &values, &channels, &facts).is_err());
}

#[test]
fn channels_of_an_ome_zarr_are_its_first_axis() {
    let folder = tempfile::tempdir().unwrap();
    let values: Vec<f32> = (0..2 * 3 * 2).map(|i| i as f32).collect();
    let channel =
        |name: &str, nm| OmeChannel { name: name.into(), emission_nm: nm, excitation_nm: Some(385.0) };
    let channels = [channel("blue R", Some(610.5)), channel("blue G", None)];
    let facts = OmeFacts { mm_per_pixel: Some(0.25), exposure_s: Some(0.03), ..OmeFacts::default() };
    let path = folder.path().join("f.ome.zarr");
    write_ome_zarr(&path, [3, 2], &values, &channels, &facts).unwrap();
    assert_eq!(chunk(&path, "0/c/1/0/0"), [1.0, 3.0, 5.0, 7.0, 9.0, 11.0]);
    let group: serde_json::Value =
        serde_json::from_slice(&fs::read(path.join("zarr.json")).unwrap()).unwrap();
    let ome = &group["attributes"]["ome"];
    let scale = &ome["multiscales"][0];
    assert_eq!(
        scale["datasets"][0]["coordinateTransformations"][0]["scale"],
        serde_json::json!([1.0, 0.25, 0.25])
    );
    assert_eq!(scale["axes"][1], serde_json::json!({ "name": "y", "type": "space", "unit": "millimeter" }));
    let shown = &ome["omero"]["channels"];
    assert_eq!((&shown[0]["label"], &shown[0]["color"]), (&"blue R".into(), &"FF0000".into()));
    assert_eq!((&shown[1]["window"]["end"], &shown[1]["color"]), (&11.0.into(), &"FFFFFF".into()));
    assert_eq!(group["attributes"]["fluorspar"]["emission_nm"], serde_json::json!([610.5, null]));
    assert!(write_ome_zarr(&path, [3, 3], &values, &channels, &facts).is_err());
}
