//! Raw frames in other programs' forms: DNG and packed rows, what another reader finds in them, and damage.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "these are tests")]

use std::fs;

use fluorspar::image::{Mosaic, SensorImage};
use fluorspar::sensor::{Exposure, Sensor, SensorMode, SensorModel, SpectralQe};
use fluorspar::spectral::Curve;
use fluorspar_format::{
    Defect, DngColor, Provenance, RawPacking, read_sensor_image, write_packed_raw, write_sensor_dng,
    write_sensor_tiff,
};
use tiff::decoder::{Decoder, ifd::Value};
use tiff::tags::Tag;

fn frame(width: usize, height: usize, bits: u8, mosaic: Mosaic) -> SensorImage {
    let most = (1u32 << bits) - 1;
    let data = (0..(width * height) as u32).map(|i| (i.wrapping_mul(2_654_435_761) % (most + 1)) as u16);
    SensorImage {
        width,
        height,
        data: data.collect(),
        mosaic,
        black_level: 64.0,
        black_offsets: Vec::new(),
        white_levels: Vec::new(),
        factors: Vec::new(),
        orientation: fluorspar::image::Orientation::default(),
        white_level: (most - 5) as u16,
        bit_depth: bits,
        exposure_s: 0.030_123_456,
        gain: 2.0,
        dn_per_electron: 0.4551,
        read_noise_dn: 6.25,
        gain_is_assumed: false,
        seed: 7,
        label: "blue".into(),
    }
}

fn provenance() -> Provenance {
    Provenance::new("a = 1", "a = 1\nb = \"x\"", 7, 64)
}

/// ISETCam's converter has one code more than its bits count.
#[test]
fn a_frame_of_isetcam_comes_back_whole() {
    let folder = tempfile::tempdir().unwrap();
    let mode = SensorMode::Isetcam { noise_flag: 2 };
    let mosaic = vec![vec!["mono".into()]];
    let model = SensorModel { columns: 6, rows: 4, mosaic, mode, ..SensorModel::default() };
    let qe = SpectralQe::from_curves([("mono", Curve::constant(0.5))]).unwrap();
    let image = Sensor::new(model, qe).unwrap().expose_even(1e9, &Exposure::default()).unwrap();
    assert_eq!((image.bit_depth, image.white_level, image.data[0]), (13, 4096, 4096));
    let [tiff, dng] = ["raw.tiff", "raw.dng"].map(|name| folder.path().join(name));
    write_sensor_tiff(&tiff, &image, None).unwrap();
    write_sensor_dng(&dng, &image, &DngColor::default(), None).unwrap();
    for path in [tiff, dng] {
        assert_eq!(read_sensor_image(&path).unwrap().image, image, "{}", path.display());
    }
}

#[test]
fn dng_comes_back_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("raw_blue.dng");
    for (width, height) in [(12, 8), (37, 11), (2, 2)] {
        for mosaic in [
            Mosaic::bayer("grbg").unwrap(),
            Mosaic::bayer("bggr").unwrap(),
            Mosaic::monochrome(),
            // Channels in another order than red, green, blue.
            Mosaic {
                rows: 1,
                cols: 3,
                pattern: vec![0, 1, 2],
                channels: ["B", "R", "G"].map(String::from).to_vec(),
            },
        ] {
            let mut image = frame(width, height, 12, mosaic);
            image.black_level = 63.25;
            write_sensor_dng(&path, &image, &DngColor::default(), Some(&provenance())).unwrap();
            let loaded = read_sensor_image(&path).unwrap();
            assert_eq!(loaded.image, image);
            assert_eq!(loaded.provenance, Some(provenance()));
        }
    }
    // The same bytes each time.
    let image = frame(12, 8, 12, Mosaic::bayer("rggb").unwrap());
    let write = || {
        write_sensor_dng(&path, &image, &DngColor::default(), None).unwrap();
        fs::read(&path).unwrap()
    };
    assert_eq!(write(), write());
    assert!(!folder.path().join("raw_blue.dng.json").exists(), "a DNG is one file");
}

/// The TIFF decoder knows nothing of our reader.
#[test]
fn another_reader_finds_the_tags_and_the_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f.dng");
    let image = frame(36, 10, 12, Mosaic::bayer("gbrg").unwrap());
    let color = DngColor { neutral: [0.5, 1.0, 0.25], ..DngColor::default() };
    write_sensor_dng(&path, &image, &color, None).unwrap();
    // The decoder opens no color filter arrays, so it gets the file as a gray image.
    let mut bytes = fs::read(&path).unwrap();
    let photometric = photometric_at(&bytes);
    assert_eq!(u16::from_ne_bytes([bytes[photometric], bytes[photometric + 1]]), 32_803);
    bytes[photometric..photometric + 2].copy_from_slice(&1u16.to_ne_bytes());
    let mut decoder = Decoder::new(std::io::Cursor::new(&bytes)).unwrap();
    let mut unsigned = |tag: u16| decoder.get_tag(Tag::Unknown(tag)).unwrap().into_u64_vec().unwrap();
    assert_eq!(unsigned(50_706), [1, 4, 0, 0]);
    assert_eq!(unsigned(33_421), [2, 2]);
    assert_eq!(unsigned(33_422), [1, 2, 0, 1]);
    assert_eq!(unsigned(50_717), [4090]);
    assert_eq!(unsigned(50_829), [0, 0, 10, 36]);
    let black = decoder.get_tag(Tag::Unknown(50_714)).unwrap();
    assert!(matches!(first(&black), Value::Rational(64, 1)), "{black:?}");
    let Value::List(neutral) = decoder.get_tag(Tag::Unknown(50_728)).unwrap() else { panic!("one neutral") };
    assert!(matches!(neutral[0], Value::Rational(500_000, 1_000_000)), "{neutral:?}");
    let Value::List(matrix) = decoder.get_tag(Tag::Unknown(50_721)).unwrap() else { panic!("no matrix") };
    assert_eq!(matrix.len(), 9);
    assert!(matches!(matrix[1], Value::SRational(-1_537_383, 1_000_000)), "{matrix:?}");
    // Pixels by strip offset and length.
    let offset = decoder.get_tag(Tag::StripOffsets).unwrap().into_u64().unwrap() as usize;
    let length = decoder.get_tag(Tag::StripByteCounts).unwrap().into_u64().unwrap() as usize;
    let pixels: Vec<u16> =
        bytes[offset..offset + length].chunks_exact(2).map(|p| u16::from_ne_bytes([p[0], p[1]])).collect();
    assert_eq!(pixels, image.data);
}

fn first(value: &Value) -> &Value {
    match value {
        Value::List(list) => &list[0],
        other => other,
    }
}

/// Straight from the bytes of the first directory.
/// Offset of the value of PhotometricInterpretation.
fn photometric_at(bytes: &[u8]) -> usize {
    let u16_at = |at: usize| u16::from_ne_bytes([bytes[at], bytes[at + 1]]);
    let start = u32::from_ne_bytes(bytes[4..8].try_into().unwrap()) as usize;
    let rows = usize::from(u16_at(start));
    (0..rows).map(|row| start + 2 + 12 * row).find(|at| u16_at(*at) == 262).unwrap() + 8
}

#[test]
fn dng_refuses_other_colors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f.dng");
    let mosaic =
        Mosaic { rows: 1, cols: 2, pattern: vec![0, 1], channels: ["R", "NIR"].map(String::from).to_vec() };
    let error = write_sensor_dng(&path, &frame(4, 4, 12, mosaic), &DngColor::default(), None).unwrap_err();
    assert!(error.to_string().contains("R, NIR"), "{error}");
    assert!(!path.exists());
}

#[test]
fn packed_frames_come_back_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("raw_blue.raw");
    for (packing, bits) in [(RawPacking::Raw10, 10), (RawPacking::Raw12, 12), (RawPacking::Raw16, 16)] {
        for (width, height) in [(16, 3), (13, 5), (1, 1)] {
            let image = frame(width, height, bits, Mosaic::bayer("rggb").unwrap());
            write_packed_raw(&path, &image, packing, Some(&provenance())).unwrap();
            assert_eq!(fs::metadata(&path).unwrap().len() as usize, packing.row_bytes(width) * height);
            let loaded = read_sensor_image(&path).unwrap();
            assert_eq!(loaded.image, image);
            assert_eq!(loaded.provenance, Some(provenance()));
        }
    }
    let twelve = frame(16, 3, 12, Mosaic::monochrome());
    let error = write_packed_raw(&path, &twelve, RawPacking::Raw10, None).unwrap_err();
    assert!(error.to_string().contains("10 bits"), "{error}");
}

/// A frame of a camera module with a 4608 x 2592 sensor, rows padded to 32 bytes, described by hand.
#[test]
fn a_capture_of_a_camera_module_is_read_by_a_short_description() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("capture.raw");
    let (columns, rows, stride) = (4608usize, 2592usize, 5792usize);
    let mut bytes = vec![0u8; stride * rows];
    for (row, line) in bytes.chunks_exact_mut(stride).enumerate() {
        for (group, five) in line[..columns / 4 * 5].chunks_exact_mut(5).enumerate() {
            five[..4].fill((row % 256) as u8);
            five[4] = (group % 256) as u8;
        }
    }
    fs::write(&path, &bytes).unwrap();
    let description = |stride: usize| {
        format!(
            r#"{{"format": 1, "label": "blue", "width": {columns}, "height": {rows},
            "mosaic": {{"rows": 2, "cols": 2, "pattern": [0, 1, 1, 2], "channels": ["R", "G", "B"]}},
            "black_level": 64, "white_level": 1023, "bit_depth": 10, "exposure_s": 0.03,
            "packing": {{"format": "raw10", "stride_bytes": {stride}}}}}"#
        )
    };
    let sidecar = folder.path().join("capture.raw.json");
    fs::write(&sidecar, description(stride)).unwrap();
    let image = read_sensor_image(&path).unwrap().image;
    assert_eq!((image.width, image.height, image.gain, image.dn_per_electron), (4608, 2592, 1.0, 0.0));
    // Row 3, pixels 6 and 7: high bits 3, group 1, low bits of the third and fourth pixel of 0b00000001.
    assert_eq!(image.data[3 * columns + 4..][..4], [3 << 2 | 1, 3 << 2, 3 << 2, 3 << 2]);
    for (wrong, word) in [(5759, "5760"), (6000, "need"), (0, "stride_bytes")] {
        fs::write(&sidecar, description(wrong)).unwrap();
        let error = read_sensor_image(&path).unwrap_err().to_string();
        assert!(error.contains(word), "{wrong}: {error}");
    }
    fs::remove_file(&sidecar).unwrap();
    let error = read_sensor_image(&path).unwrap_err().to_string();
    assert!(error.contains("packing"), "{error}");
}

/// A DNG of another camera: raw image in a sub-directory, packed to 12 bits, big-endian, exposure and noise in tags.
#[test]
fn a_foreign_dng_is_read_by_its_tags() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("IMG_0001.dng");
    let entry = |tag: u16, kind: u16, count: u32, value: u32| {
        let mut row = [tag.to_be_bytes(), kind.to_be_bytes()].concat();
        row.extend(count.to_be_bytes());
        // Shorts are left-justified in their four bytes.
        row.extend(if kind == 3 && count == 1 { value << 16 } else { value }.to_be_bytes());
        row
    };
    let directory =
        |rows: &[Vec<u8>]| [(rows.len() as u16).to_be_bytes().to_vec(), rows.concat(), vec![0; 4]].concat();
    // 8: first directory (3 rows), 50: Exif (2), 80: raw (12), 230: values.
    let first = directory(&[
        entry(330, 4, 1, 80),
        entry(34_665, 4, 1, 50),
        entry(50_706, 1, 4, u32::from_be_bytes([1, 4, 0, 0])),
    ]);
    let exif = directory(&[entry(33_434, 5, 1, 240), entry(34_855, 3, 1, 400)]);
    let raw = directory(&[
        entry(256, 3, 1, 4),
        entry(257, 3, 1, 2),
        entry(258, 3, 1, 12),
        entry(259, 3, 1, 1),
        entry(262, 3, 1, 32_803),
        entry(273, 4, 1, 280),
        entry(279, 4, 1, 12),
        entry(33_421, 3, 2, 2 << 16 | 2),
        entry(33_422, 1, 4, u32::from_be_bytes([2, 1, 1, 0])),
        entry(50_714, 3, 1, 100),
        entry(50_717, 3, 1, 4000),
        entry(51_041, 12, 2, 260),
    ]);
    let mut bytes = b"MM\0*\0\0\0\x08".to_vec();
    bytes.extend(first);
    assert_eq!(bytes.len(), 50);
    bytes.extend(exif);
    bytes.resize(80, 0);
    bytes.extend(raw);
    bytes.resize(240, 0);
    bytes.extend([1u32, 50].map(u32::to_be_bytes).concat());
    bytes.resize(260, 0);
    bytes.extend([2e-4f64, 1e-6].map(f64::to_be_bytes).concat());
    bytes.resize(280, 0);
    bytes.extend([0x12, 0x3a, 0xbc, 0x00, 0x10, 0x02, 0xff, 0xf0, 0x00, 0x80, 0x07, 0xff]);
    fs::write(&path, &bytes).unwrap();
    let image = read_sensor_image(&path).unwrap().image;
    assert_eq!((image.width, image.height, image.bit_depth, image.label.as_str()), (4, 2, 12, "IMG_0001"));
    assert_eq!(image.data, [0x123, 0xabc, 0x001, 0x002, 0xfff, 0x000, 0x800, 0x7ff]);
    assert_eq!(image.mosaic, Mosaic::bayer("bggr").unwrap());
    assert_eq!((image.black_level, image.white_level, image.exposure_s), (100.0, 4000, 0.02));
    assert_eq!(image.gain, 4.0);
    assert!((image.dn_per_electron - 2e-4 * 3900.0).abs() < 1e-12);
    assert!((image.read_noise_dn - 1e-3 * 3900.0).abs() < 1e-9);

    // What is not read is said.
    let changed = |at: usize, value: &[u8]| {
        let mut other = bytes.clone();
        other[at..at + value.len()].copy_from_slice(value);
        fs::write(&path, other).unwrap();
        read_sensor_image(&path).unwrap_err()
    };
    let row = |index: usize| 82 + 12 * index + 8;
    let compressed = changed(row(3), &[0, 7, 0, 0]);
    assert!(compressed.to_string().contains("does not begin as a JPEG"), "{compressed}");
    let compressed = changed(row(3), &[0, 5, 0, 0]);
    assert!(matches!(compressed.defect(), Defect::Unsupported { .. }), "{compressed}");
    assert!(compressed.to_string().contains("compression 5"), "{compressed}");
    assert!(changed(row(5), &[0, 0, 8, 0]).to_string().contains("not in the file"));
    assert!(changed(row(0), &[0xff, 0xff, 0, 0]).to_string().contains("not in the file"));
    assert!(changed(row(4), &[0, 2, 0, 0]).to_string().contains("mosaic"));
    assert!(changed(row(8), &[2, 1, 1, 5]).to_string().contains("color filter array"));
}

#[test]
fn impossible_descriptions_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f.raw");
    let image = frame(8, 4, 10, Mosaic::bayer("rggb").unwrap());
    write_packed_raw(&path, &image, RawPacking::Raw10, None).unwrap();
    let sidecar = folder.path().join("f.raw.json");
    let text = fs::read_to_string(&sidecar).unwrap();
    let changed = |from: &str, to: &str| {
        assert!(text.contains(from), "{from} in {text}");
        fs::write(&sidecar, text.replace(from, to)).unwrap();
        read_sensor_image(&path).unwrap_err().to_string()
    };
    assert!(changed("\"white_level\": 1018", "\"white_level\": 64").contains("white level"));
    assert!(changed("\"exposure_s\": 0.0", "\"exposure_s\": -0.0").contains("below zero"));
    assert!(changed("\"width\": 8", "\"width\": 0").contains("columns"));
    assert!(changed("\"width\": 8", "\"width\": 4000000000").contains("columns"));
    assert!(changed("\"height\": 4", "\"height\": 90000").contains("need"));
    assert!(changed("\"raw10\"", "\"raw11\"").contains("raw11"));
}
