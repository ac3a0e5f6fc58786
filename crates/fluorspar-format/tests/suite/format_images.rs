//! Spectral, component and raw images: what is written comes back, and what can't be is explained.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "these are tests")]

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use fluorspar::image::{
    Component, ComponentImage, ComponentRows, FeatureMaps, LightPath, Mosaic, SensorImage, SpectralBasis,
    SpectralImage, View,
};
use fluorspar::spectral::{Irradiance, Quantity, Radiance, Reflectance, WavelengthGrid};
use fluorspar_format::{
    ComponentFile, ExrCompression, ExrOptions, FormatError, Provenance, Transfer, is_component_npy,
    read_component_exr, read_component_image, read_component_npy, read_sensor_image, read_spectral_exr,
    read_spectral_npy, read_texture_png, write_atomically, write_component_exr, write_component_npy,
    write_rgb_png, write_sensor_png, write_sensor_tiff, write_spectral_exr, write_spectral_npy,
    written_share,
};

fn grid() -> WavelengthGrid {
    WavelengthGrid::from_edges(&[380.0, 382.5, 390.0, 401.1, 1100.0]).unwrap()
}

fn provenance() -> Provenance {
    Provenance::new("camera.name = 1", "[camera]\nname = \"µ-camera\"\n", 7, 16)
}

fn spectral<Q: Quantity>() -> SpectralImage<Q> {
    let (width, height) = (5, 37);
    let data = (0..width * height * 4).map(|i| (i as f32 * 0.37).sin().exp() * 1e-3).collect();
    SpectralImage::from_data(grid(), width, height, data).unwrap()
}

fn components() -> ComponentImage {
    let labels =
        [LightPath::Reflected, LightPath::Fluorescence("FAD µ".into()), LightPath::MultipleFluorescence];
    let components = labels.map(|light| Component::of_group("blue", light)).to_vec();
    let mut image = ComponentImage::zeros(grid(), 5, 3, components);
    for (i, value) in image.data.iter_mut().enumerate() {
        *value = i as f32 * 0.125 - 3.0;
    }
    image.samples_per_pixel = 64;
    image.features = FeatureMaps {
        depth_m: (0..15).map(|i| if i == 3 { f32::INFINITY } else { i as f32 * 0.01 }).collect(),
        normal: (0..15).map(|i| [0.0, i as f32, -1.0]).collect(),
        part: (0..15).map(|i| i as u16 * 4000).collect(),
        uv: (0..15).map(|i| [i as f32, 0.5]).collect(),
        part_names: vec!["tongue".into(), "lip".into()],
        material_names: vec!["mucosa".into(), "µ-skin".into()],
        view: Some(View {
            position_m: [0.0, 0.01, 0.1],
            forward: [0.0, 0.0, -1.0],
            right: [1.0, 0.0, 0.0],
            tan_half_width: 0.37,
        }),
    };
    image
}

fn frame() -> SensorImage {
    SensorImage {
        width: 6,
        height: 4,
        data: (0..24).map(|i| i * 2731).collect(),
        mosaic: Mosaic::bayer("grbg").unwrap(),
        black_level: 64.25,
        black_offsets: Vec::new(),
        white_levels: Vec::new(),
        factors: Vec::new(),
        orientation: fluorspar::image::Orientation::default(),
        white_level: 1023,
        bit_depth: 10,
        exposure_s: 0.03,
        gain: 2.0,
        dn_per_electron: 0.1,
        read_noise_dn: 1.5,
        gain_is_assumed: false,
        seed: u64::MAX,
        label: "blue".into(),
    }
}

/// What an action says about a file, its folder left out.
fn said<T: std::fmt::Debug>(folder: &Path, result: Result<T, FormatError>) -> String {
    result.expect_err("this should fail").to_string().replace(&format!("{}/", folder.display()), "")
}

fn round_trip_exr<Q: Quantity + std::fmt::Debug + PartialEq>() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("i.exr");
    let (image, provenance) = (spectral::<Q>(), provenance());
    let preview = vec![[0.1, 0.2, 0.3]; 5 * 37];
    for compression in [ExrCompression::Uncompressed, ExrCompression::Zip] {
        let options = ExrOptions {
            compression,
            preview: Some(&preview),
            provenance: Some(&provenance),
            ..Default::default()
        };
        write_spectral_exr(&path, &image, &options).unwrap();
        let back = read_spectral_exr::<Q>(&path).unwrap();
        assert_eq!(back.image, image);
        assert_eq!(back.provenance.as_ref(), Some(&provenance));
        let first = fs::read(&path).unwrap();
        write_spectral_exr(&path, &image, &options).unwrap();
        assert!(fs::read(&path).unwrap() == first, "equal images give equal bytes");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing else is left behind");
}

/// Labels and feature maps, and rows of some components, each by itself, are those of the whole image.
#[test]
fn component_images_are_read_part_by_part() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.exr");
    let image = components();
    let provenance = provenance();
    let rounded = {
        let mut rounded = image.clone();
        rounded.round_as_stored();
        rounded
    };
    for (compression, stored) in
        [(ExrCompression::Zip, &image), (ExrCompression::Rounded24, &rounded), (ExrCompression::Half, &image)]
    {
        let options = ExrOptions { compression, provenance: Some(&provenance), ..Default::default() };
        write_component_exr(&path, &image, &options).unwrap();
        let whole = read_component_exr(&path).unwrap().image;
        let file = ComponentFile::open(&path).unwrap();
        assert_eq!(file.provenance(), Some(&provenance));
        let labels = file.labels();
        assert!(labels.data.is_empty());
        assert_eq!((&labels.components, &labels.features), (&whole.components, &whole.features));
        assert_eq!((&labels.grid, labels.samples_per_pixel), (&image.grid, 64));
        // Two of three components
        let mut rows = file.map_rows(|component| component != 1, |_, _, lines| lines.to_vec()).unwrap();
        rows.sort_by_key(|(component, row, _)| (*component, *row));
        let places: Vec<(usize, usize)> = rows.iter().map(|(component, row, _)| (*component, *row)).collect();
        assert_eq!(places, [(0, 0), (0, 1), (0, 2), (2, 0), (2, 1), (2, 2)]);
        for (component, row, lines) in rows {
            for (index, value) in lines.iter().enumerate() {
                let (band, col) = (index / 5, index % 5);
                assert_eq!(*value, whole.component(component)[(row * 5 + col) * 4 + band], "{compression:?}");
            }
        }
        if compression != ExrCompression::Half {
            assert_eq!(&whole, stored);
        }
    }
    // The other form has no parts: it is read whole.
    let path = folder.path().join("c.npy");
    write_component_npy(&path, &image, Some(&provenance)).unwrap();
    let file = ComponentFile::open(&path).unwrap();
    assert_eq!(file.labels().data, image.data);
    let rows = file.map_rows(|component| component == 1, |_, row, _| row).unwrap();
    assert_eq!(rows.len(), 3);
}

/// A component with all bands, one on a basis of two spectra, and one without light.
fn with_bases(weights: [f32; 4]) -> ComponentImage {
    let mut image = components();
    let basis =
        |spectra: Vec<f32>| Some(Arc::new(SpectralBasis::new(spectra, weights.to_vec(), 1e-3).unwrap()));
    let spectra = vec![1.0, 0.5, 0.0, 0.25, 0.0, 0.75, 1.0, -0.125];
    image.bases = vec![None, basis(spectra), basis(Vec::new())];
    let values = image.stored_values();
    image.data.truncate(values);
    image
}

#[test]
fn components_on_a_basis_come_back() {
    let image = &with_bases([1.0, 2.0, 0.5, 0.0]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.exr");
    assert_eq!(image.data.len(), 15 * (4 + 2));
    for compression in [ExrCompression::Uncompressed, ExrCompression::Zip, ExrCompression::Rounded24] {
        let options = ExrOptions { compression, ..Default::default() };
        write_component_exr(&path, image, &options).unwrap();
        let whole = read_component_exr(&path).unwrap().image;
        let file = ComponentFile::open(&path).unwrap();
        assert_eq!((&whole.bases, &file.labels().bases), (&image.bases, &image.bases));
        let close = |a: &f32, b: &f32| (a - b).abs() <= compression.relative_error() as f32 * b.abs();
        assert!(
            whole.data.len() == image.data.len()
                && whole.data.iter().zip(&image.data).all(|(a, b)| close(a, b))
        );
        let rows = file.map_rows(|_| true, |_, _, lines| lines.to_vec()).unwrap();
        assert_eq!(rows.len(), 9);
        for (component, row, lines) in rows {
            let bands = whole.values_per_pixel(component);
            assert_eq!(lines.len(), 5 * bands);
            for (index, value) in lines.iter().enumerate() {
                assert_eq!(*value, whole.stored(component)[(row * 5 + index % 5) * bands + index / 5]);
            }
        }
    }
    // As an array, which has all bands of all
    let array = folder.path().join("c.npy");
    write_component_npy(&array, image, None).unwrap();
    let read = read_component_image(&array).unwrap().image;
    assert_eq!((read.bases.len(), read.data.as_slice()), (0, &*image.all_values()));
    assert_eq!(read.component(1)[..4], *image.spectrum(1, 0));
}

#[test]
fn damaged_bases_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.exr");
    let refusal = |from: &[u8], to: &[u8]| {
        let mut image = with_bases([1.0; 4]);
        image.components.pop();
        image.bases.pop();
        write_component_exr(&path, &image, &ExrOptions::default()).unwrap();
        let mut bytes = fs::read(&path).unwrap();
        let at = bytes.windows(from.len()).position(|part| part == from).unwrap();
        bytes[at..at + to.len()].copy_from_slice(to);
        fs::write(&path, bytes).unwrap();
        said(folder.path(), read_component_exr(&path))
    };
    assert!(refusal(b"c0001", b"d0001").contains("not all of the 2 coefficients"));
    assert!(refusal(b"\"weights\":\"AA", b"\"weights\":\"A*").contains("is damaged"));
}

/// Rows of 24-bit values have a decoder of their own: over several blocks, the last of which is not full, with what deflate makes
/// smaller and what it does not, they are those that the decoder for everything gives, bit for bit.
#[test]
fn rows_of_24_bits_are_those_of_the_whole_image() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.exr");
    let labels = [LightPath::Reflected, LightPath::MultipleFluorescence];
    let (width, height) = (7, 37);
    let mut image = ComponentImage::zeros(
        grid(),
        width,
        height,
        labels.map(|light| Component::of_group("blue", light)).to_vec(),
    );
    for (i, value) in image.data.iter_mut().enumerate() {
        // The second component: numbers of any exponent and sign, and in some rows none
        let bits = (i as u32).wrapping_mul(0x9e37_79b9);
        let any = f32::from_bits((bits & 0x81ff_ffff) | 0x3000_0000);
        *value = match i / (width * height * 4) {
            0 => (i as f32 * 0.37).sin().exp() * 1e-3,
            _ if i % 11 == 0 => 0.0,
            _ => any,
        };
    }
    let options = ExrOptions { compression: ExrCompression::Rounded24, ..Default::default() };
    write_component_exr(&path, &image, &options).unwrap();
    let whole = read_component_exr(&path).unwrap().image;
    let file = ComponentFile::open_without_maps(&path).unwrap();
    let rows = file.map_rows(|_| true, |_, _, lines| lines.to_vec()).unwrap();
    assert_eq!(rows.len(), 2 * height);
    for (component, row, lines) in rows {
        for (index, value) in lines.iter().enumerate() {
            let (band, col) = (index / width, index % width);
            let expected = whole.component(component)[(row * width + col) * 4 + band];
            assert_eq!(value.to_bits(), expected.to_bits(), "component {component}, row {row}, column {col}");
        }
    }
    // A byte of the last block
    let mut bytes = fs::read(&path).unwrap();
    let last = bytes.len() - 9;
    bytes[last] ^= 0x40;
    fs::write(&path, bytes).unwrap();
    let file = ComponentFile::open_without_maps(&path).unwrap();
    let said = said(folder.path(), file.map_rows(|_| true, |_, _, _| ()));
    assert!(said.starts_with("c.exr: not a valid OpenEXR file: compressed PXR24 data"), "{said}");
}

#[test]
fn spectral_images_survive_openexr() {
    round_trip_exr::<Radiance>();
    round_trip_exr::<Irradiance>();
    round_trip_exr::<Reflectance>();
}

#[test]
fn component_images_survive_openexr_with_their_features() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.exr");
    let mut image = components();
    let provenance = provenance();
    let preview = vec![[0.5; 3]; 15];
    let options = ExrOptions { preview: Some(&preview), provenance: Some(&provenance), ..Default::default() };
    write_component_exr(&path, &image, &options).unwrap();
    let back = read_component_exr(&path).unwrap();
    assert_eq!((&back.image, back.provenance.as_ref()), (&image, Some(&provenance)));
    let bytes = fs::read(&path).unwrap();
    write_component_exr(&path, &image, &options).unwrap();
    assert!(fs::read(&path).unwrap() == bytes, "equal images give equal bytes");
    image.features = FeatureMaps::default();
    image.components.truncate(1);
    image.data.truncate(5 * 3 * 4);
    write_component_exr(&path, &image, &ExrOptions::default()).unwrap();
    let back = read_component_exr(&path).unwrap();
    assert_eq!((back.image, back.provenance), (image, None));
}

#[test]
fn openexr_mistakes_are_explained() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("i.exr");
    write_spectral_exr(&path, &spectral::<Irradiance>(), &ExrOptions::default()).unwrap();
    assert_eq!(
        said(folder.path(), read_spectral_exr::<Radiance>(&path)),
        "i.exr: the image holds irradiance, not radiance in W/(sr m^2 nm). Read it as what it is"
    );
    assert_eq!(
        said(folder.path(), read_component_exr(&path)),
        "i.exr: this image holds radiance, not the component images that are needed. Give components.exr of a run, or render one with `fluorspar render --components`"
    );
    write_component_exr(&path, &components(), &ExrOptions::default()).unwrap();
    assert_eq!(
        said(folder.path(), read_spectral_exr::<Radiance>(&path)),
        "i.exr: the file has 4 parts. Read it as a component image, or save one part alone"
    );
    fs::write(&path, b"not an image at all").unwrap();
    assert_eq!(
        said(folder.path(), read_spectral_exr::<Radiance>(&path)),
        "i.exr: this is not an OpenEXR file. Give an .exr image"
    );
    let options = ExrOptions { preview: Some(&[[0.0; 3]]), ..Default::default() };
    let target = folder.path().join("new.exr");
    assert_eq!(
        said(folder.path(), write_spectral_exr(&target, &spectral::<Radiance>(), &options)),
        "new.exr: nothing was written: the preview has 1 pixels for 37 rows and 5 columns. Give one R, G, B per pixel"
    );
    let mut twice = components();
    twice.components[1] = twice.components[0].clone();
    assert_eq!(
        said(folder.path(), write_component_exr(&target, &twice, &ExrOptions::default())),
        "new.exr: nothing was written: two components are called \"blue.reflected\". \
         Give light groups and fluorophores names of their own"
    );
    let mut ragged = components();
    ragged.data.pop();
    assert!(
        said(folder.path(), write_component_exr(&target, &ragged, &ExrOptions::default()))
            .contains("do not fill")
    );
    assert!(!target.exists());
}

#[test]
fn absurd_sizes_are_refused_before_memory_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("i.exr");
    write_spectral_exr(&path, &spectral::<Radiance>(), &ExrOptions::default()).unwrap();
    let mut bytes = fs::read(&path).unwrap();
    let name = b"dataWindow\0box2i\0";
    let at = bytes.windows(name.len()).position(|window| window == name).unwrap() + name.len() + 12;
    for (last, expected) in [
        (
            99_999_i32,
            "i.exr: the image claims 100000 rows and 100000 columns of 16 bytes; the limit is 8589934592 bytes. Check that this is the right file and that it is complete",
        ),
        (
            199_999,
            "i.exr: the image claims 200000 rows and 200000 columns; the limit is 100000 a side. Check that this is the right file and that it is complete",
        ),
    ] {
        bytes[at..at + 4].copy_from_slice(&last.to_le_bytes());
        bytes[at + 4..at + 8].copy_from_slice(&last.to_le_bytes());
        fs::write(&path, &bytes).unwrap();
        assert_eq!(said(folder.path(), read_spectral_exr::<Radiance>(&path)), expected);
    }

    let path = folder.path().join("f.tiff");
    write_sensor_tiff(&path, &frame(), None).unwrap();
    let mut bytes = fs::read(&path).unwrap();
    // Entries of 12 bytes follow their number; tag 256 is the width, its value the last four bytes.
    let directory = u32::from_le_bytes([bytes[4], bytes[5], bytes[6], bytes[7]]) as usize;
    let value_of = |bytes: &[u8], tag: [u8; 2]| {
        (directory + 2..).step_by(12).find(|&at| bytes[at..at + 2] == tag).unwrap() + 8
    };
    let (at, height) = (value_of(&bytes, [0, 1]), value_of(&bytes, [1, 1]));
    bytes[at..at + 4].copy_from_slice(&3_000_000_u32.to_le_bytes());
    fs::write(&path, &bytes).unwrap();
    assert_eq!(
        said(folder.path(), read_sensor_image(&path)),
        "f.tiff: the image claims 4 rows and 3000000 columns; the limit is 100000 a side. \
         Check that this is the right file and that it is complete"
    );

    bytes[at..at + 4].copy_from_slice(&90_000_u32.to_le_bytes());
    bytes[height..height + 4].copy_from_slice(&400_u32.to_le_bytes());
    fs::write(&path, &bytes).unwrap();
    let expected = format!(
        "f.tiff: the header claims 72000000 bytes of pixels in a file of {} bytes. Copy the file again",
        bytes.len()
    );
    assert_eq!(said(folder.path(), read_sensor_image(&path)), expected);

    let path = folder.path().join("t.png");
    let mut encoder = png::Encoder::new(fs::File::create(&path).unwrap(), 100_001, 1);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().unwrap().write_image_data(&[0; 100_001]).unwrap();
    assert_eq!(
        said(folder.path(), read_texture_png(&path, Transfer::Linear)),
        "t.png: the image claims 1 rows and 100001 columns; the limit is 100000 a side. \
         Check that this is the right file and that it is complete"
    );
}

#[test]
fn arrays_survive_numpy_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    let (image, provenance) = (spectral::<Radiance>(), provenance());
    write_spectral_npy(&path, &image, Some(&provenance)).unwrap();
    let back = read_spectral_npy::<Radiance>(&path).unwrap();
    assert_eq!((back.image, back.provenance), (image, Some(provenance)));
    let mut image = components();
    write_component_npy(&path, &image, None).unwrap();
    image.features = FeatureMaps::default();
    assert_eq!(read_component_npy(&path).unwrap().image, image);
}

/// A frame would show what is no number as black.
#[test]
fn light_that_is_no_number_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |error: FormatError, value: f32| {
        let said = error.to_string();
        assert!(said.contains(&format!("a value is {value}")) && said.contains("Put 0"), "{said}");
    };
    for value in [f32::NAN, f32::INFINITY] {
        let mut image = components();
        *image.data.last_mut().unwrap() = value;
        let array = folder.path().join("a.npy");
        write_component_npy(&array, &image, None).unwrap();
        refused(read_component_image(&array).unwrap_err(), value);
        assert!(is_component_npy(&array) && !is_component_npy(&folder.path().join("none.npy")));
        for compression in [ExrCompression::Zip, ExrCompression::Rounded24] {
            let path = folder.path().join("a.exr");
            write_component_exr(&path, &image, &ExrOptions { compression, ..ExrOptions::default() }).unwrap();
            refused(read_component_image(&path).unwrap_err(), value);
            let file = ComponentFile::open(&path).unwrap();
            refused(file.map_rows(|_| true, |_, _, _| ()).unwrap_err(), value);
            assert!(file.map_rows(|component| component == 0, |_, _, _| ()).is_ok());
        }
    }
}

#[test]
fn numpy_mistakes_are_explained() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    let read = || said(folder.path(), read_spectral_npy::<Radiance>(&path));
    write_spectral_npy(&path, &spectral::<Irradiance>(), None).unwrap();
    assert_eq!(
        read(),
        "a.npy.json: the file holds irradiance in W/(m^2 nm), not radiance in W/(sr m^2 nm). Read it as what it is"
    );
    write_spectral_npy(&path, &spectral::<Radiance>(), None).unwrap();
    let sidecar = folder.path().join("a.npy.json");
    let text = fs::read_to_string(&sidecar).unwrap();
    fs::write(&sidecar, text.replacen("37", "38", 1)).unwrap();
    assert_eq!(
        read(),
        "a.npy.json: the description has shape [38, 5, 4] but the array has [37, 5, 4]. Keep the two files of one run together"
    );
    fs::write(&sidecar, "{\n\"format\": 1,\n\"quantity\": 3\n}").unwrap();
    assert_eq!(
        read(),
        "a.npy.json: invalid type: integer `3`, expected a string at line 3 column 13. Restore the file as it was written"
    );
    fs::remove_file(&sidecar).unwrap();
    assert!(read().starts_with("a.npy: its description"), "{}", read());
    let array = |descr: &str, order: &str, shape: &str| {
        let header = format!("{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.bytes());
        bytes
    };
    let cases = [
        (
            array("'<f4'", "False", "(2, 2)"),
            "a.npy: the shape [2, 2] needs 16 bytes but 0 follow. Copy the file again",
        ),
        (
            array("'<c8'", "False", "(2, 2)"),
            "a.npy: the elements are '<c8', not '<f4' or '<f8'. Save a.astype('<f4')",
        ),
        (array("'<f4'", "False", "2, 2"), "a.npy: invalid header of a .npy file. Write it with numpy.save"),
        (
            array("'<f4'", "True", "(2, 2)"),
            "a.npy: the array is in Fortran order. Save numpy.ascontiguousarray(a)",
        ),
        (
            array("'<f4'", "False", "(9000000000, 9000000000)"),
            "a.npy: the array claims the shape [9000000000, 9000000000]; the limit is 8589934592 bytes. \
             Check that this is the right file and that it is complete",
        ),
        (
            b"\x93NUMPY\x02\x00\xff\xff\xff\xff".to_vec(),
            "a.npy: the header claims 4294967295 bytes in a file of 12. Copy the file again",
        ),
        (
            b"PK\x03\x04 and so on, no array".to_vec(),
            "a.npy: this is not a NumPy .npy file. Write it with numpy.save",
        ),
        (b"\x93NUM".to_vec(), "a.npy: this is not a NumPy .npy file. Write it with numpy.save"),
    ];
    for (bytes, expected) in cases {
        fs::write(&path, bytes).unwrap();
        assert_eq!(read(), expected);
    }
}

#[test]
fn raw_frames_survive_tiff_and_png() {
    let folder = tempfile::tempdir().unwrap();
    let (image, provenance) = (frame(), provenance());
    for (name, write) in [("f.tiff", write_sensor_tiff as fn(&_, &_, _) -> _), ("f.png", write_sensor_png)] {
        let path = folder.path().join(name);
        write(&path, &image, Some(&provenance)).unwrap();
        let back = read_sensor_image(&path).unwrap();
        assert_eq!((back.image, back.provenance.as_ref()), (image.clone(), Some(&provenance)));
    }
}

#[test]
fn raw_mistakes_are_explained() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f.tiff");
    let sidecar = folder.path().join("f.tiff.json");
    let read = || said(folder.path(), read_sensor_image(&path));
    write_sensor_tiff(&path, &frame(), None).unwrap();
    let text = fs::read_to_string(&sidecar).unwrap();
    let pixels = fs::read(&path).unwrap();

    let mut other = frame();
    other.data[5] ^= 1;
    write_sensor_tiff(&path, &other, None).unwrap();
    fs::write(&sidecar, &text).unwrap();
    assert_eq!(
        read(),
        "f.tiff.json: the pixels are not those that were described (their SHA-256 differs). \
         Keep the two files of one frame together"
    );
    fs::write(&path, pixels).unwrap();
    let edits = [
        (
            "\"width\": 6",
            "\"width\": 7",
            "f.tiff.json: 4 rows and 7 columns are described but the image has 4 and 6. Keep the two files of one frame together",
        ),
        (
            "\"format\": 1",
            "\"format\": 9",
            "f.tiff.json: the description has format 9; this program reads format 1. Use a version of Fluorspar that reads this format",
        ),
        (
            "\"gain\": 2.0",
            "\"gian\": 2.0",
            "f.tiff.json: unknown field `gian`, expected one of `format`, `program`, `label`, `width`, `height`, `mosaic`, `samples`, `black_level`, `white_level`, `bit_depth`, `left_shift`, `exposure_s`, `gain`, `dn_per_electron`, `read_noise_dn`, `seed`, `packing`, `pixels_sha256`, `provenance` at line 26 column 8. Restore the file as it was written",
        ),
        (
            "\"rows\": 2",
            "\"rows\": 3",
            "f.tiff.json: the color filter array of 3 by 2 pixels names 4 channels. Correct the description, or describe the frame anew with fluorspar describe FRAME --replace",
        ),
    ];
    for (from, to, expected) in edits {
        assert!(text.contains(from), "{text}");
        fs::write(&sidecar, text.replacen(from, to, 1)).unwrap();
        assert_eq!(read(), expected);
    }
    fs::remove_file(&sidecar).unwrap();
    assert_eq!(
        read().replace(&sidecar.display().to_string(), "f.tiff.json"),
        "f.tiff: its description f.tiff.json is missing. \
         Keep the two files together. For a frame from a camera, `fluorspar describe FRAME` writes the description"
    );

    let target = folder.path().join("new.tiff");
    let mut bad = frame();
    bad.gain = f64::NAN;
    assert_eq!(
        said(folder.path(), write_sensor_tiff(&target, &bad, None)),
        "new.tiff: nothing was written: the gain is NaN. Correct the frame before writing it"
    );
    bad = frame();
    bad.data.pop();
    assert_eq!(
        said(folder.path(), write_sensor_png(&target, &bad, None)),
        "new.tiff: nothing was written: 23 numbers do not fill 4 rows and 6 columns. Correct the frame before writing it"
    );
    assert!(!target.exists());
}

#[test]
fn textures_are_decoded_to_light() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.png");
    write_rgb_png(&path, 2, 1, &[0, 128, 255, 10, 20, 30]).unwrap();
    let linear = read_texture_png(&path, Transfer::Linear).unwrap();
    assert_eq!((linear.width, linear.height, linear.channels), (2, 1, 3));
    assert_eq!(linear.data[..3], [0.0, 128.0 / 255.0, 1.0]);
    let light = read_texture_png(&path, Transfer::Srgb).unwrap();
    // sRGB 128 is 0.2158605 of white; 10 lies on the straight part.
    assert!((light.data[1] - 0.215_860_5).abs() < 1e-6 && (light.data[2] - 1.0).abs() < 1e-6);
    assert!((light.data[3] - 10.0 / 255.0 / 12.92).abs() < 1e-7);
    assert_eq!(
        said(folder.path(), write_rgb_png(&folder.path().join("n.png"), 2, 2, &[0; 3])),
        "n.png: nothing was written: 3 numbers do not fill 2 rows and 2 columns of R, G, B. Give three numbers per pixel"
    );
}

#[test]
fn textures_of_every_kind_are_read() {
    use png::{BitDepth, ColorType};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.png");
    let kinds = [
        (ColorType::Grayscale, 1),
        (ColorType::GrayscaleAlpha, 2),
        (ColorType::Rgb, 3),
        (ColorType::Rgba, 4),
    ];
    for (color, channels) in kinds {
        for (depth, bytes) in [(BitDepth::Eight, 1), (BitDepth::Sixteen, 2)] {
            let mut encoder = png::Encoder::new(fs::File::create(&path).unwrap(), 1, 1);
            encoder.set_color(color);
            encoder.set_depth(depth);
            encoder.write_header().unwrap().write_image_data(&vec![0x80; channels * bytes]).unwrap();
            let texture = read_texture_png(&path, Transfer::Srgb).unwrap();
            assert_eq!(texture.channels, channels);
            let (stored, alpha) = (texture.data[0], texture.data[channels - 1]);
            assert!((stored - 0.216).abs() < 0.001, "{stored}");
            // Alpha is a fraction, not a color.
            assert_eq!(channels % 2 == 0, (alpha - 0.502).abs() < 0.001, "{alpha}");
        }
    }
}

#[test]
fn a_failed_write_leaves_what_was_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.txt");
    let write = |text: &'static str, fail: bool| {
        write_atomically(&path, |writer| {
            std::io::Write::write_all(writer, text.as_bytes())?;
            if fail { Err(std::io::Error::other("out of ideas")) } else { Ok(()) }
        })
    };
    write("first", false).unwrap();
    assert_eq!(
        said(folder.path(), write("second", true)),
        "r.txt: can't write it: out of ideas. Check the disk and the path"
    );
    let panicked = std::panic::catch_unwind(|| write_atomically(&path, |_| panic!("on purpose")));
    assert!(panicked.is_err());
    assert_eq!(fs::read_to_string(&path).unwrap(), "first");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    let lost = folder.path().join("missing/r.txt");
    assert_eq!(
        said(folder.path(), write_atomically(&lost, |_| Ok(()))),
        "missing/r.txt: can't create it: No such file or directory (os error 2). Check the path and its folder"
    );
}

#[test]
fn the_share_of_an_image_that_is_written_is_told_meanwhile() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("told-meanwhile.exr");
    let name = path.file_name().unwrap();
    let edges: Vec<f64> = (0..=32).map(|step| 400.0 + 10.0 * f64::from(step)).collect();
    let grid = WavelengthGrid::from_edges(&edges).unwrap();
    let image = SpectralImage::<Radiance>::zeros(grid, 512, 512);
    let done = AtomicBool::new(false);
    let seen = thread::scope(|scope| {
        let poll = scope.spawn(|| {
            let mut seen = Vec::new();
            while !done.load(Ordering::Relaxed) {
                seen.extend(written_share(name));
                thread::sleep(Duration::from_micros(100));
            }
            seen
        });
        write_spectral_exr(&path, &image, &ExrOptions::default()).unwrap();
        done.store(true, Ordering::Relaxed);
        poll.join().unwrap()
    });
    assert!(seen.iter().any(|share| *share > 0.0) && seen.iter().all(|share| *share <= 1.0), "{seen:?}");
    assert!(seen.windows(2).all(|pair| pair[0] <= pair[1]), "{seen:?}");
    assert_eq!(written_share(name), None);
}
