//! Frames that other programs wrote (`fixtures/camera/make.py`): compressed DNG of any order of colors, linear RGB, masks.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::{Path, PathBuf};

use fluorspar::image::Mosaic;
use fluorspar_format::{
    FactSource, FrameDescription, FrameFacts, describe_frame, frame_remarks, read_mask, read_sensor_image,
};

fn camera(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/camera").join(name)
}

/// A copy in a folder of its own.
fn copied(name: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::copy(camera(name), &path).unwrap();
    (folder, path)
}

/// The formula of `make.py`.
fn scene(rows: usize, columns: usize, most: usize) -> Vec<u16> {
    let value = |row: usize, col: usize| ((row * 97 + col * 61 + (row * col * 7919) % 53) % most) as u16;
    (0..rows).flat_map(|row| (0..columns).map(move |col| value(row, col))).collect()
}

/// Tiles of two components by libjpeg-turbo, covered pixels at the rim, black levels by place.
#[test]
fn a_compressed_dng_is_read_to_the_pixel() {
    let image = read_sensor_image(&camera("bggr_jpeg.dng")).unwrap().image;
    assert_eq!((image.width, image.height, image.bit_depth), (48, 40, 12));
    assert_eq!(image.mosaic, Mosaic::bayer("bggr").unwrap());
    assert_eq!((image.black_level, image.white_level, image.exposure_s, image.gain), (63.0, 4000, 0.04, 2.0));
    let above: Vec<f64> =
        image.data.iter().enumerate().map(|(value, &dn)| f64::from(dn) - image.black_of(value)).collect();
    assert_eq!(above, scene(40, 48, 3500).into_iter().map(f64::from).collect::<Vec<_>>());
    // NoiseProfile: the variance grows by 2e-4 of the range per unit of signal on 0 to 1.
    assert!((image.dn_per_electron - 2e-4 * 3937.0).abs() < 1e-9);
    assert_eq!(image.label, "bggr_jpeg");
}

#[test]
fn all_predictors_and_another_encoder_are_read_to_the_pixel() {
    let image = read_sensor_image(&camera("gbrg_predictors.dng")).unwrap().image;
    assert_eq!(image.mosaic, Mosaic::bayer("gbrg").unwrap());
    assert_eq!(image.data, scene(32, 40, 16_000));
}

#[test]
fn a_deflated_dng_on_a_curve_is_read_to_the_pixel() {
    let image = read_sensor_image(&camera("grbg_deflate.dng")).unwrap().image;
    assert_eq!(image.mosaic, Mosaic::bayer("grbg").unwrap());
    assert_eq!(image.data, scene(40, 48, 1000).iter().map(|v| 3 * v + 10).collect::<Vec<_>>());
    assert_eq!((image.black_level, image.white_level), (10.0, 3007));
}

/// Every byte in turn changed, and the file cut anywhere: an error or another image, never a panic.
#[test]
fn damaged_compressed_frames_are_survived() {
    for name in ["bggr_jpeg.dng", "grbg_deflate.dng", "gbrg_predictors.dng"] {
        let (_folder, path) = copied(name);
        let good = fs::read(&path).unwrap();
        let whole = read_sensor_image(&path).unwrap().image.data;
        for at in (0..good.len()).step_by(37) {
            let mut bytes = good.clone();
            bytes[at] ^= 0x55;
            fs::write(&path, &bytes).unwrap();
            let _ = read_sensor_image(&path);
            fs::write(&path, &good[..at]).unwrap();
            // A mark of the end may be missing, but no pixel.
            if let Ok(read) = read_sensor_image(&path) {
                assert!(at + 4 > good.len() && read.image.data == whole, "{name} cut at {at}");
            }
        }
    }
}

#[test]
fn linear_rgb_is_described_and_read_as_it_is() {
    let (_folder, path) = copied("linear_rgb.tiff");
    let missing = read_sensor_image(&path).unwrap_err().to_string();
    assert!(missing.contains("fluorspar describe"), "{missing}");
    let given = FrameFacts { label: Some("blue".into()), exposure_s: Some(0.03), ..FrameFacts::default() };
    let found = describe_frame(&path, &given).unwrap();
    let source = |key: &str| found.facts.iter().find(|fact| fact.key == key).unwrap().source;
    assert_eq!(source("label"), FactSource::Given);
    assert_eq!(source("mosaic"), FactSource::Assumed);
    assert_eq!(source("dn_per_electron"), FactSource::Unknown);
    found.write().unwrap();
    let image = read_sensor_image(&path).unwrap().image;
    assert!(image.has_all_channels());
    let scene = scene(40, 48, 3500);
    assert_eq!(image.data.chunks_exact(3).map(|p| p[0]).collect::<Vec<_>>(), scene);
    assert_eq!(
        image.data.chunks_exact(3).map(|p| p[2]).collect::<Vec<_>>(),
        scene.iter().map(|v| v + 300).collect::<Vec<_>>()
    );
    assert_eq!(image.mosaic.shares(), [0.25, 0.5, 0.25]);
    // The largest value is below 4096.
    assert_eq!((image.bit_depth, image.white_level, image.exposure_s), (12, 4095, 0.03));
    // Three sensors measure everything everywhere.
    fs::remove_file(found.path()).unwrap();
    describe_frame(&path, &FrameFacts { is_measured: true, ..given }).unwrap().write().unwrap();
    assert_eq!(read_sensor_image(&path).unwrap().image.mosaic.shares(), [1.0; 3]);
    // A description of another kind of frame is refused.
    let text = fs::read_to_string(found.path()).unwrap().replace("\"measured\"", "\"mosaic\"");
    fs::write(found.path(), text).unwrap();
    let said = read_sensor_image(&path).unwrap_err().to_string();
    assert!(said.contains("3 numbers a pixel"), "{said}");
}

#[test]
fn a_gray_frame_says_what_was_assumed_and_that_it_looks_like_a_mosaic() {
    let (folder, path) = copied("gray8.tiff");
    let found = describe_frame(&path, &FrameFacts::default()).unwrap();
    let json = found.to_json().unwrap();
    assert_eq!((json["bit_depth"].as_u64(), json["exposure_s"].as_f64()), (Some(8), Some(0.0)));
    assert!(json.get("program").is_none(), "the frame is the user's");
    // A mosaic of 16-bit values whose cells are uneven.
    let mosaic = folder.path().join("mosaic.png");
    let values: Vec<f32> = (0..32 * 16).map(|i| [0.1, 0.2, 0.25, 0.12][i / 32 % 2 * 2 + i % 2]).collect();
    fluorspar_format::write_gray_png(&mosaic, 32, 16, &values).unwrap();
    let found = describe_frame(&mosaic, &FrameFacts::default()).unwrap();
    assert!(found.facts.iter().any(|fact| fact.remark.contains("looks like a mosaic")));
    let given = FrameFacts { mosaic: Mosaic::bayer("gbrg"), ..FrameFacts::default() };
    let found = describe_frame(&mosaic, &given).unwrap();
    assert!(!found.facts.iter().any(|fact| fact.remark.contains("looks like a mosaic")));
    assert_eq!(found.to_json().unwrap()["mosaic"]["pattern"], serde_json::json!([1, 2, 0, 1]));
    // What contradicts itself is refused before anything is written.
    let wrong = FrameFacts { black_level: Some(70_000.0), ..FrameFacts::default() };
    assert!(describe_frame(&mosaic, &wrong).unwrap_err().to_string().contains("black level"));
}

/// What a description says of a DNG wins over its tags.
#[test]
fn a_dng_can_be_described_anew() {
    let (_folder, path) = copied("bggr_jpeg.dng");
    let given = FrameFacts { exposure_s: Some(0.5), label: Some("blue".into()), ..FrameFacts::default() };
    let found = describe_frame(&path, &given).unwrap();
    assert!(found.facts.iter().all(|fact| fact.source != FactSource::Assumed), "{:?}", found.facts);
    found.write().unwrap();
    let image = read_sensor_image(&path).unwrap().image;
    assert_eq!((image.exposure_s, image.gain, image.label.as_str()), (0.5, 2.0, "blue"));
    assert_eq!(f64::from(image.data[0]) - image.black_of(0), 0.0);
}

/// A little-endian DNG of 8 x 4 pixels in 16 bits, `values` given, with further tags, each with the bytes of its values.
fn plain_dng(path: &Path, values: &[u16], tags: &[(u16, u16, u32, Vec<u8>)]) {
    let long = |tag: u16, value: u32| (tag, 4, 1, value.to_le_bytes().to_vec());
    let pixels_at = 1024u32;
    let mut all = vec![
        long(256, 8),
        long(257, 4),
        long(258, 16),
        long(259, 1),
        long(262, 32_803),
        long(273, pixels_at),
        long(277, 1),
        long(279, 64),
        (33_421, 3, 2, [2u16, 2].map(u16::to_le_bytes).concat()),
        (33_422, 1, 4, vec![0, 1, 1, 2]),
        (50_706, 1, 4, vec![1, 4, 0, 0]),
    ];
    all.extend_from_slice(tags);
    all.sort_by_key(|tag| tag.0);
    let mut bytes = b"II*\0\x08\0\0\0".to_vec();
    bytes.extend((all.len() as u16).to_le_bytes());
    let mut beyond = Vec::new();
    let beyond_at = 8 + 2 + 12 * all.len() + 4;
    for (tag, kind, count, data) in &all {
        bytes.extend(tag.to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(count.to_le_bytes());
        if data.len() > 4 {
            bytes.extend(((beyond_at + beyond.len()) as u32).to_le_bytes());
            beyond.extend_from_slice(data);
        } else {
            let mut cell = data.clone();
            cell.resize(4, 0);
            bytes.extend(cell);
        }
    }
    bytes.extend([0; 4]);
    bytes.extend(beyond);
    assert!(bytes.len() <= pixels_at as usize);
    bytes.resize(pixels_at as usize, 0);
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    fs::write(path, bytes).unwrap();
}

/// Light of 6 (R), 14 (G) and 3 (B) over levels of 60, 64, 70 and 68 in a cell, and what columns (in quarters) and rows add to them:
/// every pixel has its light left, to the fraction.
#[test]
fn black_levels_of_places_columns_and_rows_are_subtracted_from_each_pixel() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.dng");
    let (cell, light) = ([60, 64, 70, 68], [6, 14, 14, 3]);
    let columns = [0, 40, 0, 40, 1, -3, 0, 2];
    let quarters = [0, 0, 1, 2];
    let place = |pixel: usize| pixel / 8 % 2 * 2 + pixel % 2;
    let values: Vec<u16> =
        (0..32).map(|p| (cell[place(p)] + light[place(p)] + columns[p % 8]) as u16).collect();
    let fractions = |numbers: &[i32], of: i32| {
        numbers.iter().flat_map(|n| [n.to_le_bytes(), of.to_le_bytes()].concat()).collect::<Vec<u8>>()
    };
    let pattern = (50_713, 3, 2, [2u16, 2].map(u16::to_le_bytes).concat());
    let levels = (50_714, 3, 4, cell.map(|v: i32| (v as u16).to_le_bytes()).concat());
    let of_columns = (50_715, 10, 8, fractions(&columns, 1));
    let of_rows = (50_716, 10, 4, fractions(&quarters, 4));
    plain_dng(&path, &values, &[pattern.clone(), levels.clone(), of_columns, of_rows]);
    let image = read_sensor_image(&path).unwrap().image;
    let developed = fluorspar::sensor::Development::default().linearize(&image).unwrap();
    for (pixel, value) in developed.values.iter().enumerate() {
        assert_eq!(*value, (light[place(pixel)] as f32) - quarters[pixel / 8] as f32 / 4.0, "{pixel}");
    }
    // A dark frame has the same levels: nothing is left of it, whatever they are
    let dark =
        fluorspar::sensor::MasterFrame::average([Ok::<_, fluorspar::sensor::DevelopError>(image.clone())]);
    let development = fluorspar::sensor::Development {
        dark: Some(&dark.unwrap()),
        ..fluorspar::sensor::Development::default()
    };
    assert!(development.linearize(&image).unwrap().values.iter().all(|&v| v == 0.0));
    let found = describe_frame(&path, &FrameFacts::default()).unwrap();
    assert_eq!(fact(&found, "black level by place").1, FactSource::Tag);
    // As many numbers as there are columns belong there
    plain_dng(&path, &values, &[pattern, levels, (50_715, 10, 7, fractions(&columns[..7], 1))]);
    let said = read_sensor_image(&path).unwrap_err().to_string();
    assert!(said.contains("BlackLevelDeltaH has 7 numbers where 8 belong"), "{said}");
}

/// A value of a description in words, and where it comes from.
fn fact(found: &FrameDescription, key: &str) -> (String, FactSource) {
    let fact = found.facts.iter().find(|fact| fact.key == key).unwrap();
    (fact.value.clone(), fact.source)
}

/// A tag of 16-bit numbers.
fn shorts(tag: u16, values: &[u16]) -> (u16, u16, u32, Vec<u8>) {
    (tag, 3, values.len() as u32, values.iter().flat_map(|value| value.to_le_bytes()).collect())
}

/// Green ends at 3000 where the file promises 4095: in nine of its sixteen pixels.
#[test]
fn a_plateau_below_the_white_level_is_saturation() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.dng");
    let is_green = |pixel: usize| (pixel / 8 + pixel) % 2 == 1;
    let value = |pixel: usize| match (is_green(pixel), pixel / 2) {
        (true, 0..9) => 3000,
        (true, at) => 2500 - 20 * at as u16,
        (false, at) => 500 + 31 * at as u16,
    };
    let values: Vec<u16> = (0..32).map(value).collect();
    let tags = [shorts(50_714, &[64]), shorts(50_717, &[4095])];
    plain_dng(&path, &values, &tags);
    let image = read_sensor_image(&path).unwrap().image;
    for (pixel, found) in image.data.iter().enumerate() {
        let is_saturated = values[pixel] == 3000;
        assert_eq!(*found, if is_saturated { 4095 } else { values[pixel] }, "{pixel}");
    }
    let found = describe_frame(&path, &FrameFacts::default()).unwrap();
    assert_eq!(fact(&found, "plateau").0, "G 3000 DN in 56.2 % of its pixels");
    // The brightest of many values is none
    let values: Vec<u16> = (0..32).map(|i| 2000 + 37 * i).collect();
    plain_dng(&path, &values, &tags);
    assert_eq!(read_sensor_image(&path).unwrap().image.data, values);
}

/// What a viewer turns, what a converter shades and a black level above the pixels are told, each by name.
#[test]
fn tags_without_effect_and_a_high_black_level_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.dng");
    let values: Vec<u16> = (0..32).map(|i| if (i / 8 + i) % 2 == 1 { 60 - i / 8 } else { 500 + i }).collect();
    // A list of two opcodes: a gain map, and one that nobody knows
    let opcode = |code: u32| [code, 0, 0, 4, 0].map(u32::to_be_bytes).concat();
    let list = [2u32.to_be_bytes().to_vec(), opcode(9), opcode(77)].concat();
    plain_dng(
        &path,
        &values,
        &[
            shorts(274, &[3]),
            shorts(50_714, &[64]),
            shorts(50_717, &[4095]),
            (51_009, 7, list.len() as u32, list),
        ],
    );
    let found = describe_frame(&path, &FrameFacts::default()).unwrap();
    assert_eq!(fact(&found, "orientation").0, "viewers show it turned by 180 degrees");
    assert_eq!(fact(&found, "opcodes").0, "OpcodeList2: GainMap, opcode 77");
    assert_eq!(fact(&found, "black level").0, "most pixels of G lie below it");
    assert_eq!(frame_remarks(&path).unwrap().len(), 3);
    // Upright, black level right: nothing to say
    plain_dng(&path, &values, &[shorts(274, &[1]), shorts(50_714, &[40]), shorts(50_717, &[4095])]);
    assert!(frame_remarks(&path).unwrap().is_empty());
}

/// Twelve bits in the upper ones of sixteen, as many cameras of machines write them: numbers of twelve bits.
#[test]
fn left_aligned_samples_are_shifted_down() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.tif");
    let values: Vec<u16> = (0..32).map(|i| 16 * (100 + 111 * i)).collect();
    let mut encoder = tiff::encoder::TiffEncoder::new(fs::File::create(&path).unwrap()).unwrap();
    encoder.write_image::<tiff::encoder::colortype::Gray16>(8, 4, &values).unwrap();
    let given = FrameFacts { exposure_s: Some(0.01), ..FrameFacts::default() };
    let found = describe_frame(&path, &given).unwrap();
    assert_eq!(fact(&found, "alignment").0, "12 bits in the upper ones of 16");
    assert_eq!(fact(&found, "white_level").0, "4095 DN");
    found.write().unwrap();
    let image = read_sensor_image(&path).unwrap().image;
    assert!(image.data.iter().enumerate().all(|(i, value)| usize::from(*value) == 100 + 111 * i));
    // Twelve bits have no white level of 65 520
    let wrong = FrameFacts { bit_depth: Some(12), white_level: Some(65_520), ..given };
    let said = describe_frame(&path, &wrong).unwrap_err().to_string();
    assert!(said.contains("a converter of 12 bits has no white level of 65520"), "{said}");
}

/// Exposure and sensitivity beside the pixels, as TIFF/EP has them, and twelve bits in sixteen.
#[test]
fn tags_beside_the_pixels_of_a_dng_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dng");
    let values: Vec<u16> = (0..32).map(|i| 256 + 100 * i).collect();
    let exposure = (33_434, 5, 1, [1u32, 25].map(u32::to_le_bytes).concat());
    let iso = (34_855, 3, 1, 400u16.to_le_bytes().to_vec());
    let black = (50_714, 3, 1, 256u16.to_le_bytes().to_vec());
    let white = (50_717, 3, 1, 4095u16.to_le_bytes().to_vec());
    plain_dng(&path, &values, &[exposure, iso, black, white]);
    let image = read_sensor_image(&path).unwrap().image;
    assert_eq!((image.exposure_s, image.gain, image.bit_depth), (0.04, 4.0, 12));
    assert_eq!((image.black_level, image.white_level), (256.0, 4095));
    assert_eq!(image.data, values);
    let found = describe_frame(&path, &FrameFacts::default()).unwrap();
    for (key, value) in [("exposure_s", "0.04 s"), ("gain", "4"), ("bit_depth", "12")] {
        assert_eq!(fact(&found, key), (value.into(), FactSource::Tag), "{key}");
    }
    assert!(found.warnings.is_empty(), "{:?}", found.warnings);
}

/// What no tag tells is assumed, and said to be; pixels that all lie far above a black level of 0 are told.
#[test]
fn a_dng_without_tags_says_what_is_assumed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dng");
    plain_dng(&path, &[700; 32], &[]);
    let found = describe_frame(&path, &FrameFacts::default()).unwrap();
    for (key, value) in [("black_level", "0 DN"), ("white_level", "65535 DN"), ("gain", "1")] {
        assert_eq!(fact(&found, key), (value.into(), FactSource::Assumed), "{key}");
    }
    assert_eq!(fact(&found, "exposure_s").1, FactSource::Unknown);
    // 700 of 65535 are more than a hundredth, of twelve bits all the more.
    assert!(found.warnings[0].contains("even the darkest pixels have 700 DN"), "{:?}", found.warnings);
    let twelve = FrameFacts { bit_depth: Some(12), ..FrameFacts::default() };
    let found = describe_frame(&path, &twelve).unwrap();
    assert_eq!(fact(&found, "white_level"), ("4095 DN".into(), FactSource::Assumed));
    assert_eq!(found.warnings.len(), 1);
    let black = FrameFacts { black_level: Some(256.0), ..FrameFacts::default() };
    assert!(describe_frame(&path, &black).unwrap().warnings.is_empty());
    plain_dng(&path, &[600; 32], &[]);
    assert!(describe_frame(&path, &FrameFacts::default()).unwrap().warnings.is_empty());
}

/// A TIFF of gray pages in 16 bits, each with its width and its NewSubfileType, after a first RGB image in 8 bits of 16 x 12 where there
/// is one.
fn pages(path: &Path, first: Option<u32>, pages: &[(u32, u32)], photometric: u16) {
    use tiff::encoder::{TiffEncoder, colortype};
    use tiff::tags::Tag;
    let mut encoder = TiffEncoder::new(fs::File::create(path).unwrap()).unwrap();
    if let Some(kind) = first {
        let mut image = encoder.new_image::<colortype::RGB8>(16, 12).unwrap();
        image.encoder().write_tag(Tag::NewSubfileType, kind).unwrap();
        image.encoder().write_tag(Tag::Make, "NIKON CORPORATION").unwrap();
        image.encoder().write_tag(Tag::Model, "NIKON D750").unwrap();
        image.write_data(&[7; 3 * 16 * 12]).unwrap();
    }
    for &(width, kind) in pages {
        let mut image = encoder.new_image::<colortype::Gray16>(width, 8).unwrap();
        image.encoder().write_tag(Tag::NewSubfileType, kind).unwrap();
        image.encoder().write_tag(Tag::PhotometricInterpretation, photometric).unwrap();
        image.write_data(&vec![500; 8 * width as usize]).unwrap();
    }
}

/// The small picture at the beginning of a raw file is no frame, whatever the file is called.
#[test]
fn a_raw_file_that_is_no_dng_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |name: &str, what: &str| {
        let path = folder.path().join(name);
        let said = describe_frame(&path, &FrameFacts::default()).unwrap_err().to_string();
        assert!(said.contains(what) && said.contains("dnglab convert"), "{name}: {said}");
        let said = read_sensor_image(&path).unwrap_err().to_string();
        assert!(said.contains(what) && said.contains("dnglab convert"), "{name}: {said}");
    };
    // A mosaic behind the picture
    pages(&folder.path().join("mosaic.tif"), Some(0), &[(8, 0)], 32_803);
    refused("mosaic.tif", "a raw file of NIKON D750, but no DNG");
    // A small form of another image, and one without that mark
    for (name, kind) in [("small.tif", 1), ("larger.tif", 0)] {
        pages(&folder.path().join(name), Some(kind), &[(64, 0)], 1);
        refused(name, "its first image, 16 x 12, is a small picture of another one in the file, 64 x 8");
    }
    // One image with the ending of raw files, and the mark of CR2
    pages(&folder.path().join("frame.NEF"), None, &[(8, 0)], 1);
    refused("frame.NEF", "a raw file of a camera, but no DNG");
    let (from, to) = (folder.path().join("frame.NEF"), folder.path().join("marked.tif"));
    let mut bytes = fs::read(from).unwrap();
    bytes[8..10].copy_from_slice(b"CR");
    fs::write(to, bytes).unwrap();
    refused("marked.tif", "a raw file of a camera, but no DNG");
}

/// The first of several pages is no frame of its own; a smaller form behind it is no page.
#[test]
fn a_tiff_of_several_pages_is_refused_with_their_number() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.tif");
    pages(&path, None, &[(8, 0), (8, 2), (8, 2)], 1);
    let said = describe_frame(&path, &FrameFacts::default()).unwrap_err().to_string();
    assert!(said.contains("it holds 3 images (pages)"), "{said}");
    let said = read_mask(&path).unwrap_err().to_string();
    assert!(said.contains("it holds 3 images (pages)"), "{said}");
    pages(&path, None, &[(8, 0), (4, 1)], 1);
    describe_frame(&path, &FrameFacts::default()).unwrap().write().unwrap();
    assert_eq!(read_sensor_image(&path).unwrap().image.data, [500; 64]);
    read_mask(&path).unwrap();
}

/// A preview for the screen is no frame.
#[test]
fn a_png_on_a_tone_curve_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("preview.png");
    let write = |change: fn(&mut png::Encoder<'_, fs::File>)| {
        let mut encoder = png::Encoder::new(fs::File::create(&path).unwrap(), 2, 1);
        encoder.set_color(png::ColorType::Rgb);
        change(&mut encoder);
        encoder.write_header().unwrap().write_image_data(&[9; 6]).unwrap();
        describe_frame(&path, &FrameFacts::default())
    };
    write(|_| ()).unwrap();
    write(|encoder| encoder.set_source_gamma(png::ScaledFloat::new(1.0))).unwrap();
    let curves: [fn(&mut png::Encoder<'_, fs::File>); 2] = [
        |encoder| encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual),
        |encoder| encoder.set_source_gamma(png::ScaledFloat::new(0.45)),
    ];
    for curve in curves {
        let said = write(curve).unwrap_err().to_string();
        assert!(said.contains("tone curve"), "{said}");
    }
}

#[test]
fn a_mask_is_the_same_in_every_form() {
    let inside: Vec<bool> =
        (0..40 * 48).map(|pixel: i32| (pixel / 48 - 20).pow(2) + (pixel % 48 - 30).pow(2) < 64).collect();
    for name in ["disc.png", "disc.tiff", "disc.npy"] {
        let mask = read_mask(&camera(name)).unwrap();
        assert_eq!((mask.width, mask.height), (48, 40), "{name}");
        assert_eq!(mask.inside, inside, "{name}");
    }
    let folder = tempfile::tempdir().unwrap();
    let empty = folder.path().join("empty.png");
    fluorspar_format::write_gray_png(&empty, 4, 4, &[0.0; 16]).unwrap();
    assert!(read_mask(&empty).unwrap_err().to_string().contains("selects nothing"));
    fs::write(&empty, "no image at all").unwrap();
    assert!(read_mask(&empty).unwrap_err().to_string().contains("none of them"));
    assert!(read_mask(&folder.path().join("none.png")).is_err());
}
