//! Frames that other programs wrote (`fixtures/camera/make.py`): compressed DNG of any order of colors, linear RGB, masks.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::{Path, PathBuf};

use fluorspar::image::Mosaic;
use fluorspar_format::{
    FactSource, FrameDescription, FrameFacts, describe_frame, read_described_frame, read_mask,
    read_sensor_image,
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

/// A frame of baseline JPEG is whole: to copy it again mends nothing.
#[test]
fn a_lossy_dng_is_of_another_kind() {
    let (_folder, path) = copied("bggr_jpeg.dng");
    let mut bytes = fs::read(&path).unwrap();
    let starts: Vec<usize> =
        (0..bytes.len() - 4).filter(|at| bytes[*at..].starts_with(&[0xff, 0xc3, 0])).collect();
    starts.iter().for_each(|at| bytes[at + 1] = 0xc0);
    fs::write(&path, bytes).unwrap();
    let said = read_sensor_image(&path).unwrap_err().to_string();
    assert!(said.contains("the pixels are compressed with loss. Convert the raw file"), "{said}");
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

/// A tag: number, kind, count and the bytes of its values.
type TagBytes = (u16, u16, u32, Vec<u8>);

/// Where the pixels of such files lie.
const PIXELS_AT: usize = 1024;

/// A little-endian TIFF, or BigTIFF, of one directory.
fn tiff_bytes(mut tags: Vec<TagBytes>, pixels: &[u8], is_big: bool) -> Vec<u8> {
    let offset = |at: usize| {
        let bytes = (at as u64).to_le_bytes();
        bytes[..if is_big { 8 } else { 4 }].to_vec()
    };
    let wide = offset(0).len();
    tags.sort_by_key(|tag| tag.0);
    let (mut bytes, count) = match is_big {
        true => (b"II+\0\x08\0\0\0\x10\0\0\0\0\0\0\0".to_vec(), 8),
        false => (b"II*\0\x08\0\0\0".to_vec(), 2),
    };
    let beyond_at = bytes.len() + count + (4 + 2 * wide) * tags.len() + wide;
    bytes.extend(&(tags.len() as u64).to_le_bytes()[..count]);
    let mut beyond = Vec::new();
    for (tag, kind, count, data) in &tags {
        bytes.extend(tag.to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(offset(*count as usize));
        if data.len() > wide {
            bytes.extend(offset(beyond_at + beyond.len()));
            beyond.extend_from_slice(data);
        } else {
            let mut cell = data.clone();
            cell.resize(wide, 0);
            bytes.extend(cell);
        }
    }
    bytes.extend(offset(0));
    bytes.extend(beyond);
    assert!(bytes.len() <= PIXELS_AT);
    bytes.resize(PIXELS_AT, 0);
    bytes.extend(pixels);
    bytes
}

fn long(tag: u16, value: u32) -> TagBytes {
    (tag, 4, 1, value.to_le_bytes().to_vec())
}

/// A DNG of 8 x 4 pixels in 16 bits, RGGB, `values` given, with further tags.
fn dng_bytes(values: &[u16], tags: &[TagBytes], is_big: bool) -> Vec<u8> {
    let mut all = vec![
        long(256, 8),
        long(257, 4),
        long(258, 16),
        long(259, 1),
        long(262, 32_803),
        long(273, PIXELS_AT as u32),
        long(277, 1),
        long(279, 64),
        (33_421, 3, 2, [2u16, 2].map(u16::to_le_bytes).concat()),
        (33_422, 1, 4, vec![0, 1, 1, 2]),
        (50_706, 1, 4, vec![1, 4, 0, 0]),
    ];
    all.extend_from_slice(tags);
    let pixels: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    tiff_bytes(all, &pixels, is_big)
}

fn plain_dng(path: &Path, values: &[u16], tags: &[TagBytes]) {
    fs::write(path, dng_bytes(values, tags, false)).unwrap();
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
fn shorts(tag: u16, values: &[u16]) -> TagBytes {
    (tag, 3, values.len() as u32, values.iter().flat_map(|value| value.to_le_bytes()).collect())
}

/// Channel of a pixel of `plain_dng`.
fn channel(pixel: usize) -> usize {
    pixel / 8 % 2 + pixel % 2
}

/// Green ends at 3000 where the file promises 4095: in nine of its sixteen pixels.
#[test]
fn a_plateau_below_the_white_level_is_saturation() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.dng");
    let value = |pixel: usize| match (channel(pixel) == 1, pixel / 2) {
        (true, 0..9) => 3000,
        (true, at) => 2500 - 20 * at as u16,
        (false, at) => 500 + 31 * at as u16,
    };
    let values: Vec<u16> = (0..32).map(value).collect();
    let tags = [shorts(50_714, &[64]), shorts(50_717, &[4095])];
    plain_dng(&path, &values, &tags);
    let told = read_described_frame(&path).unwrap();
    let developed = fluorspar::sensor::Development::default().linearize(&told.image).unwrap();
    for (pixel, dn) in values.iter().enumerate() {
        assert_eq!(developed.saturated[pixel], *dn == 3000, "{pixel}");
        assert_eq!(told.image.data[pixel], *dn);
    }
    let fact = told.facts.iter().find(|fact| fact.key == "plateau").unwrap();
    assert_eq!(fact.value, "56.2 % of G at 3000 DN");
    assert!(fact.is_doubtful && fact.source == FactSource::Pixels);
    // A frame without noise, of one level or of two, and the brightest of many values, are none
    let levels = |pixel: usize| if pixel < 16 { 3000 } else { 600 };
    for values in
        [vec![3000; 32], (0..32).map(levels).collect(), (0..32).map(|i| 2000 + 37 * i).collect::<Vec<u16>>()]
    {
        plain_dng(&path, &values, &tags);
        let image = read_sensor_image(&path).unwrap().image;
        assert!((0..32).all(|pixel| !image.is_saturated(pixel)));
    }
    // All of a channel just below the end of the range is
    plain_dng(&path, &(0..32).map(|p| if channel(p) == 1 { 4000 } else { 600 }).collect::<Vec<_>>(), &tags);
    let image = read_sensor_image(&path).unwrap().image;
    assert!((0..32).all(|pixel| image.is_saturated(pixel) == (channel(pixel) == 1)));
}

/// Green ends at 1000 where the file promises 16383: in nine pixels of sixteen, or in all of them, while red and blue have noise. Without
/// noise anywhere, of dim light, and of two neighboring values, it tells nothing.
#[test]
fn a_plateau_low_in_the_range_is_saturation_where_there_is_noise() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.dng");
    let noisy = |at: usize| 500 + 31 * at as u16;
    let saturated = |green: &dyn Fn(usize) -> u16, other: &dyn Fn(usize) -> u16| {
        let value = |pixel: usize| if channel(pixel) == 1 { green(pixel / 2) } else { other(pixel / 2) };
        let values: Vec<u16> = (0..32).map(value).collect();
        plain_dng(&path, &values, &[shorts(50_714, &[64]), shorts(50_717, &[16_383])]);
        let image = read_sensor_image(&path).unwrap().image;
        (0..32).filter(|pixel| image.is_saturated(*pixel)).count()
    };
    assert_eq!(saturated(&|at| if at < 9 { 1000 } else { 940 - 3 * at as u16 }, &noisy), 9);
    assert_eq!(saturated(&|_| 1000, &noisy), 16);
    assert_eq!(saturated(&|_| 1000, &|_| 500), 0);
    assert_eq!(saturated(&|_| 80, &noisy), 0);
    assert_eq!(saturated(&|at| if at < 9 { 1000 } else { 999 }, &noisy), 0);
}

/// Green is full at 3000, red and blue at 4095.
#[test]
fn the_white_level_of_each_plane_counts_for_its_channel() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.dng");
    let values: Vec<u16> = (0..32).map(|pixel| 2990 + 5 * (pixel % 7)).collect();
    plain_dng(&path, &values, &[shorts(50_714, &[64]), shorts(50_717, &[4095, 3000, 4095])]);
    let image = read_sensor_image(&path).unwrap().image;
    for (pixel, dn) in values.iter().enumerate() {
        assert_eq!(image.is_saturated(pixel), channel(pixel) == 1 && *dn >= 3000, "{pixel}");
    }
    let found = describe_frame(&path, &FrameFacts::default()).unwrap();
    assert_eq!(fact(&found, "white level by plane").0, "R 4095, G 3000, B 4095 DN");
    for (given, option) in [
        (FrameFacts { is_left_aligned: true, ..FrameFacts::default() }, "--left-aligned"),
        (FrameFacts { is_measured: true, ..FrameFacts::default() }, "--measured"),
    ] {
        let said = describe_frame(&path, &given).unwrap_err().to_string();
        assert!(said.ends_with(&format!("Leave {option} out")), "{said}");
    }
    // A level that the user gives is for all
    let given = FrameFacts { white_level: Some(3010), exposure_s: Some(0.01), ..FrameFacts::default() };
    describe_frame(&path, &given).unwrap().write().unwrap();
    let image = read_sensor_image(&path).unwrap().image;
    assert!((0..32).all(|pixel| image.is_saturated(pixel) == (values[pixel] >= 3010)));
}

/// Four numbers are those of the places of a cell: R, G, G and B, of which the lower G counts.
#[test]
fn white_levels_of_places_count_for_their_channels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.dng");
    let values: Vec<u16> = (0..32).map(|pixel| 2990 + 5 * (pixel % 7)).collect();
    plain_dng(&path, &values, &[shorts(50_714, &[64]), shorts(50_717, &[3010, 4095, 3000, 3015])]);
    let image = read_sensor_image(&path).unwrap().image;
    for (pixel, dn) in values.iter().enumerate() {
        assert_eq!(image.is_saturated(pixel), *dn >= [3010, 3000, 3015][channel(pixel)], "{pixel}");
    }
    plain_dng(&path, &values, &[shorts(50_717, &[4095, 3000])]);
    let said = read_sensor_image(&path).unwrap_err().to_string();
    assert!(said.contains("WhiteLevel has 2 numbers where 1 or 3 belong"), "{said}");
}

/// Layouts of a DNG that would be misread are refused by the name of their tag.
#[test]
fn layouts_that_are_not_read_are_called_by_their_tags() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.dng");
    for (tag, what) in [
        (shorts(266, &[2]), "FillOrder is 2"),
        (shorts(50_711, &[2]), "CFALayout is 2"),
        (long(50_975, 2), "RowInterleaveFactor is 2"),
        (shorts(50_829, &[0, 0, 5, 8]), "ActiveArea, [0, 0, 5, 8], is no part of its 4 rows and 8 columns"),
        (shorts(339, &[3]), "floating-point"),
    ] {
        plain_dng(&path, &[500; 32], &[tag]);
        let said = read_sensor_image(&path).unwrap_err().to_string();
        assert!(said.contains(what), "{said}");
    }
}

/// A DNG of raw images of 8 rows, each with its width, its NewSubfileType and its value.
fn several_raw(path: &Path, images: &[(u32, u32, u16)]) {
    use tiff::encoder::{TiffEncoder, colortype::Gray16};
    use tiff::tags::Tag;
    let mut encoder = TiffEncoder::new(fs::File::create(path).unwrap()).unwrap();
    for &(width, kind, value) in images {
        let mut image = encoder.new_image::<Gray16>(width, 8).unwrap();
        let tags = image.encoder();
        tags.write_tag(Tag::NewSubfileType, kind).unwrap();
        tags.write_tag(Tag::PhotometricInterpretation, 32_803u16).unwrap();
        tags.write_tag(Tag::Unknown(33_421), &[2u16, 2][..]).unwrap();
        tags.write_tag(Tag::Unknown(33_422), &[0u8, 1, 1, 2][..]).unwrap();
        tags.write_tag(Tag::Unknown(50_706), &[1u8, 4, 0, 0][..]).unwrap();
        image.write_data(&vec![value; 8 * width as usize]).unwrap();
    }
}

/// The frame itself is read, not a larger form of it that a program made; of two frames none.
#[test]
fn the_frame_of_several_raw_images_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.dng");
    several_raw(&path, &[(4, 1, 100), (8, 0, 200), (16, 16, 300)]);
    assert_eq!(read_sensor_image(&path).unwrap().image.data, [200; 64]);
    several_raw(&path, &[(8, 0, 200), (8, 0, 300)]);
    let said = read_sensor_image(&path).unwrap_err().to_string();
    assert!(said.contains("it holds 2 raw images"), "{said}");
}

/// A black level above the pixels of blue is told by name; one among them is not.
#[test]
fn a_black_level_above_the_pixels_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.dng");
    let value = |pixel: usize| if channel(pixel) == 2 { 58 + pixel % 3 } else { 500 + pixel };
    let values: Vec<u16> = (0..32).map(|pixel| value(pixel) as u16).collect();
    plain_dng(&path, &values, &[shorts(50_714, &[64]), shorts(50_717, &[4095])]);
    let found = describe_frame(&path, &FrameFacts::default()).unwrap();
    assert_eq!(fact(&found, "black level").0, "64 DN: most pixels of B lie below it");
    assert!(found.warnings.iter().any(|said| said.contains("--black-level")), "{:?}", found.warnings);
    plain_dng(&path, &values, &[shorts(50_714, &[59]), shorts(50_717, &[4095])]);
    assert!(describe_frame(&path, &FrameFacts::default()).unwrap().warnings.is_empty());
    // Signed numbers are read as such
    for level in
        [(50_714, 8, 1, (-20i16).to_le_bytes().to_vec()), (50_714, 9, 1, (-20i32).to_le_bytes().to_vec())]
    {
        plain_dng(&path, &values, &[level, shorts(50_717, &[4095])]);
        assert_eq!(read_sensor_image(&path).unwrap().image.black_level, -20.0);
    }
}

/// An opcode of a list: number, version, flags, length and parameters.
fn opcode(code: u32, parameters: &[u8]) -> Vec<u8> {
    let head = [code, 0x0103_0000, 0, parameters.len() as u32].map(u32::to_be_bytes).concat();
    [head, parameters.to_vec()].concat()
}

/// A map of the red pixels of a mosaic, 1 at the left border and 3 at the right one: a pixel whose middle lies at x of the width has
/// 1 + 2 x. What lies above the black level is multiplied; other opcodes are named.
#[test]
fn gain_maps_are_applied_and_other_opcodes_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.dng");
    let wholes = [0u32, 0, 4, 8, 0, 1, 2, 2, 1, 2].map(u32::to_be_bytes).concat();
    let doubles = [1.0f64, 1.0, 0.0, 0.0].map(f64::to_be_bytes).concat();
    let gains = [1.0f32, 3.0].map(f32::to_be_bytes).concat();
    let map = opcode(9, &[wholes, doubles, 1u32.to_be_bytes().to_vec(), gains].concat());
    let list = [3u32.to_be_bytes().to_vec(), map, opcode(77, &[]), opcode(3, &[0; 56])].concat();
    let tags =
        [shorts(50_714, &[100]), shorts(50_717, &[4095]), (51_009, 7, list.len() as u32, list.clone())];
    plain_dng(&path, &[400; 32], &tags);
    let image = read_sensor_image(&path).unwrap().image;
    let developed = fluorspar::sensor::Development::default().linearize(&image).unwrap();
    for (pixel, value) in developed.values.iter().enumerate() {
        let gain = if channel(pixel) == 0 { 1.0 + 2.0 * ((pixel % 8) as f32 + 0.5) / 8.0 } else { 1.0 };
        assert!((value - 300.0 * gain).abs() < 1e-3, "{pixel}: {value}");
    }
    let found = describe_frame(&path, &FrameFacts::default()).unwrap();
    assert_eq!(fact(&found, "gain map").0, "OpcodeList2 GainMap: times 1.000 to 2.625");
    assert_eq!(fact(&found, "opcodes").0, "OpcodeList2 number 77, OpcodeList2 FixVignetteRadial");
    assert!(found.warnings[0].contains("--flat"), "{:?}", found.warnings);
    // Cut anywhere it is no reason to panic
    for end in 0..list.len() {
        plain_dng(&path, &[400; 32], &[(51_009, 7, end as u32, list[..end].to_vec())]);
        read_sensor_image(&path).unwrap();
    }
}

/// Where row 0 and column 0 of the stored image are on the shown one, in the words of TIFF 6.0 (Orientation). Values tell place and
/// channel.
#[test]
fn frames_are_turned_as_viewers_show_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.dng");
    let values: Vec<u16> = (0..32).map(|p| (100 * (p / 8) + 10 * (p % 8) + channel(p)) as u16).collect();
    let sides = [
        ("top", "left"),
        ("top", "right"),
        ("bottom", "right"),
        ("bottom", "left"),
        ("left", "top"),
        ("right", "top"),
        ("right", "bottom"),
        ("left", "bottom"),
    ];
    for (tag, (row_0, column_0)) in (1u16..).zip(sides) {
        plain_dng(&path, &values, &[shorts(274, &[tag]), shorts(50_717, &[4095])]);
        let image = read_sensor_image(&path).unwrap().image;
        let [width, height] = if tag < 5 { [8, 4] } else { [4, 8] };
        assert_eq!([image.width, image.height], [width, height], "{tag}");
        for (row, col) in (0..4).flat_map(|row| (0..8).map(move |col| (row, col))) {
            let (mut x, mut y) = (0, 0);
            for (side, at) in [(row_0, row), (column_0, col)] {
                match side {
                    "left" => x = at,
                    "right" => x = width - 1 - at,
                    "top" => y = at,
                    _ => y = height - 1 - at,
                }
            }
            let pixel = row * 8 + col;
            assert_eq!(image.data[y * width + x], values[pixel], "{tag}: row {row}, column {col}");
            assert_eq!(image.mosaic.channel(y, x), channel(pixel), "{tag}: row {row}, column {col}");
        }
        let found = describe_frame(&path, &FrameFacts::default()).unwrap();
        assert_eq!(fact(&found, "width, height").0, format!("{width} x {height}"));
        let said = found.facts.iter().find(|fact| fact.key == "orientation");
        assert_eq!(said.is_some(), tag > 1);
        assert!(said.is_none_or(|fact| fact.remark.contains("masks")));
    }
}

/// A gray TIFF of 16 bits.
fn gray_tiff(path: &Path, values: &[u16]) {
    let mut encoder = tiff::encoder::TiffEncoder::new(fs::File::create(path).unwrap()).unwrap();
    encoder.write_image::<tiff::encoder::colortype::Gray16>(8, 4, values).unwrap();
}

/// Twelve bits in the upper ones of sixteen, as many cameras of machines write them: numbers of twelve bits.
#[test]
fn left_aligned_samples_are_shifted_down() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.tif");
    let values: Vec<u16> = (0..32).map(|i| 16 * (100 + 111 * i)).collect();
    gray_tiff(&path, &values);
    let given = FrameFacts { exposure_s: Some(0.01), ..FrameFacts::default() };
    for given in [given.clone(), FrameFacts { bit_depth: Some(12), ..given.clone() }] {
        let found = describe_frame(&path, &given).unwrap();
        assert_eq!(fact(&found, "alignment").0, "12 bits left-aligned in 16; divided by 16");
        assert_eq!(fact(&found, "white_level").0, "4095 DN");
        found.write().unwrap();
        let image = read_sensor_image(&path).unwrap().image;
        assert_eq!((image.bit_depth, image.white_level), (12, 4095));
        assert!(image.data.iter().enumerate().all(|(i, value)| usize::from(*value) == 100 + 111 * i));
    }
    // Twelve bits have no white level of 65 520, and ten none of these values
    let wrong = FrameFacts { bit_depth: Some(12), white_level: Some(65_520), ..given.clone() };
    let said = describe_frame(&path, &wrong).unwrap_err().to_string();
    assert!(said.contains("12 bits has no white level of 65520; its largest number is 4095"), "{said}");
    let said = describe_frame(&path, &FrameFacts { bit_depth: Some(10), ..given.clone() }).unwrap_err();
    assert!(said.to_string().contains("Give --bit-depth 12"), "{said}");
    // The size of a dark frame does not show it
    gray_tiff(&path, &(0..32).map(|i| 16 * (60 + i % 9)).collect::<Vec<u16>>());
    let found = describe_frame(&path, &given).unwrap();
    assert!(found.facts.iter().any(|fact| fact.remark.contains("--left-aligned")));
    let told = FrameFacts { is_left_aligned: true, bit_depth: Some(12), ..given.clone() };
    describe_frame(&path, &told).unwrap().write().unwrap();
    assert_eq!(read_sensor_image(&path).unwrap().image.data[1], 61);
    // Few values, all multiples of 64 by chance
    gray_tiff(&path, &(0..32).map(|i| 5824 * (1 + i % 3)).collect::<Vec<u16>>());
    let found = describe_frame(&path, &FrameFacts::default()).unwrap();
    assert_eq!(fact(&found, "bit_depth").0, "12");
    // Many values below 2^12 may stand in the upper bits, too, which is said of the described frame as well
    gray_tiff(&path, &(0..32).map(|i| 16 * (60 + i)).collect::<Vec<u16>>());
    let found = describe_frame(&path, &given).unwrap();
    assert!(found.warnings.iter().any(|said| said.contains("--left-aligned")), "{:?}", found.warnings);
    fs::remove_file(found.path()).unwrap();
    found.write().unwrap();
    let told = read_described_frame(&path).unwrap();
    assert!(told.facts.iter().any(|fact| fact.is_doubtful && fact.value == "all values are multiples of 16"));
    // Levels of a DNG are divided with its values, of a dark one, too
    let path = folder.path().join("frame.dng");
    let dark: Vec<u16> = (0..32).map(|i| 16 * (60 + i % 9)).collect();
    plain_dng(&path, &dark, &[shorts(50_714, &[1024]), shorts(50_717, &[65_520])]);
    let image = read_sensor_image(&path).unwrap().image;
    assert_eq!((image.bit_depth, image.black_level, image.data[1]), (12, 64.0, 61));
    plain_dng(&path, &values, &[shorts(50_714, &[1024]), shorts(50_717, &[65_520])]);
    let image = read_sensor_image(&path).unwrap().image;
    assert_eq!((image.bit_depth, image.white_level, image.black_level), (12, 4095, 64.0));
    assert_eq!(image.data[1], 211);
}

/// Valid TIFFs of kinds that are not read are refused by name, as frames and as masks; a BigTIFF DNG is read.
#[test]
fn tiffs_of_other_kinds_are_called_by_their_names() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.tif");
    let file = |compression: u32, photometric: u32, samples: u32, planar: u32| {
        let tags = vec![
            long(256, 8),
            long(257, 4),
            shorts(258, &vec![8; samples as usize]),
            long(259, compression),
            long(262, photometric),
            long(273, PIXELS_AT as u32),
            long(277, samples),
            long(279, 96),
            long(284, planar),
            shorts(320, &[0; 6]),
        ];
        tiff_bytes(tags, &[[0, 1], [7, 7]].concat().repeat(24), false)
    };
    let with = |photometric: u32, tag: TagBytes| {
        let tags = vec![long(256, 8), long(257, 4), long(273, PIXELS_AT as u32), long(279, 96)];
        let tags = [tags, vec![long(258, 8), long(277, 1), long(262, photometric), tag]].concat();
        tiff_bytes(tags, &[7; 96], false)
    };
    for (bytes, name) in [
        (file(50_000, 1, 1, 1), "ZSTD"),
        (file(34_925, 1, 1, 1), "LZMA"),
        (file(5, 1, 1, 1), "old-style LZW"),
        (file(1, 3, 1, 1), "indices of a palette"),
        (file(1, 2, 3, 2), "planar configuration 2"),
        (with(1, shorts(266, &[2])), "tiffcp -f msb2lsb -c none "),
    ] {
        fs::write(&path, bytes).unwrap();
        for said in [
            describe_frame(&path, &FrameFacts::default()).unwrap_err().to_string(),
            read_mask(&path).unwrap_err().to_string(),
        ] {
            assert!(said.contains(name), "{said}");
            assert!(!said.contains("Copy the file again") && !said.contains("disk"), "{said}");
        }
    }
    // Numbers that are none of light are no frame
    for (bytes, name) in [
        (with(0, shorts(339, &[1])), "its zero is white"),
        (with(1, shorts(339, &[2])), "its numbers are signed ones of 8 bits"),
        (with(1, shorts(339, &[3])), "its numbers are floating-point ones"),
        (with(1, shorts(259, &[7])), "compressed with JPEG"),
        (with(1, shorts(259, &[6])), "does not keep the numbers of a camera"),
        (file(1, 1, 2, 1), "its pixels have 2 numbers of 8 bits"),
        (with(32_803, shorts(339, &[1])), "a mosaic as TIFF/EP does"),
        (with(8, shorts(339, &[1])), "CIE L*a*b*"),
    ] {
        fs::write(&path, bytes).unwrap();
        let said = describe_frame(&path, &FrameFacts::default()).unwrap_err().to_string();
        assert!(said.contains(name) && !said.contains("Copy the file again"), "{said}");
    }
    fs::write(&path, []).unwrap();
    assert!(describe_frame(&path, &FrameFacts::default()).unwrap_err().to_string().contains("is empty"));
    let path = folder.path().join("frame.dng");
    let values: Vec<u16> = (0..32).map(|i| 70 + 3 * i).collect();
    fs::write(&path, dng_bytes(&values, &[shorts(50_714, &[64]), shorts(50_717, &[1023])], true)).unwrap();
    let image = read_sensor_image(&path).unwrap().image;
    assert_eq!((image.data, image.black_level, image.white_level), (values, 64.0, 1023));
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
    // The largest number stands for a sensitivity that other tags tell
    plain_dng(&path, &values, &[shorts(34_855, &[65_535])]);
    let found = describe_frame(&path, &FrameFacts::default()).unwrap();
    assert_eq!(fact(&found, "gain"), ("1".into(), FactSource::Assumed));
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

/// Files of other kinds are called by their names, and cures name files as a shell takes them.
#[test]
fn files_of_other_kinds_are_called_by_their_names() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a frame.x");
    let copies = format!("{0}/a frame.x' '{0}/a frame", folder.path().display());
    let whole = dng_bytes(&[500; 32], &[], false);
    for (bytes, what) in [
        (
            b"P5\n2 1\n255\n\0\0".as_slice(),
            format!("netpbmfile as n; t.imwrite(sys.argv[2], n.imread(sys.argv[1]))\" '{copies}_plain.tif'"),
        ),
        (b"\x93NUMPY\x01\0", "numpy.load(sys.argv[1])".into()),
        (b"IIRO\x08\0\0\0", format!("dnglab convert '{copies}.dng'")),
        (b"\0\0\0\x18ftypcrx \0\0\0\x01", "a raw file of a camera, but no DNG".into()),
        (b"\xff\xd8\xff\xe0", "this is a JPEG".into()),
        (b"GIF89a", "this is not a DNG, TIFF or PNG".into()),
        (&tagged_tiff(long(266, 1))[..PIXELS_AT + 9], "the TIFF file is cut short".into()),
        (&whole[..PIXELS_AT + 9], "rows from 0 on".into()),
    ] {
        fs::write(&path, bytes).unwrap();
        for said in [
            describe_frame(&path, &FrameFacts::default()).unwrap_err().to_string(),
            read_sensor_image(&path).unwrap_err().to_string(),
        ] {
            assert!(said.contains(&what), "{said}");
        }
    }
}

/// A small form before its image is no frame, either; without the name of a camera there is no raw file to convert.
#[test]
fn a_small_form_before_its_image_is_no_camera_raw() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.tif");
    for (kind, what) in [(1, "Save the large one as a file of its own"), (0, "it holds 2 images (pages)")] {
        pages(&path, None, &[(4, kind), (8, 0)], 1);
        let said = describe_frame(&path, &FrameFacts::default()).unwrap_err().to_string();
        assert!(said.contains(what) && !said.contains("dnglab"), "{said}");
    }
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
    assert!(read_mask(&path).unwrap_err().to_string().contains("selects the whole image"));
    // A stack of ImageJ may have one directory for all of its images
    let stack = b"ImageJ=1.53t\nimages=5\nslices=5\n\0".to_vec();
    fs::write(&path, tagged_tiff((270, 2, stack.len() as u32, stack))).unwrap();
    for said in [read_mask(&path).unwrap_err(), describe_frame(&path, &FrameFacts::default()).unwrap_err()] {
        assert!(said.to_string().contains("it holds 5 images (pages)"), "{said}");
    }
}

/// A preview for the screen is no frame.
#[test]
fn a_png_on_a_tone_curve_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("preview.png");
    let write = |bytes: usize, change: fn(&mut png::Encoder<'_, fs::File>)| {
        let mut encoder = png::Encoder::new(fs::File::create(&path).unwrap(), 2, 1);
        encoder.set_color(png::ColorType::Rgb);
        change(&mut encoder);
        encoder.write_header().unwrap().write_image_data(&[9; 6][..bytes]).unwrap();
        describe_frame(&path, &FrameFacts::default())
    };
    write(6, |_| ()).unwrap();
    write(6, |encoder| encoder.set_source_gamma(png::ScaledFloat::new(1.0))).unwrap();
    let palette = write(2, |encoder| {
        encoder.set_color(png::ColorType::Indexed);
        encoder.set_palette(vec![9; 30]);
    });
    assert!(palette.unwrap_err().to_string().contains("a palette of colors"));
    let curves: [fn(&mut png::Encoder<'_, fs::File>); 2] = [
        |encoder| encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual),
        |encoder| encoder.set_source_gamma(png::ScaledFloat::new(0.45)),
    ];
    for curve in curves {
        let said = write(6, curve).unwrap_err().to_string();
        assert!(said.contains("tone curve"), "{said}");
    }
}

/// A color profile whose red curve is `curve`.
fn profile(curve: &[u8]) -> Vec<u8> {
    let entry =
        [b"rTRC".to_vec(), 144u32.to_be_bytes().to_vec(), (curve.len() as u32).to_be_bytes().to_vec()];
    [vec![0; 128], 1u32.to_be_bytes().to_vec(), entry.concat(), curve.to_vec()].concat()
}

/// A curve of a color profile: `curv` with its numbers of 16 bits.
fn curve(numbers: &[u16]) -> Vec<u8> {
    let count = (numbers.len() as u32).to_be_bytes();
    let numbers: Vec<u8> = numbers.iter().flat_map(|number| number.to_be_bytes()).collect();
    [b"curv\0\0\0\0".to_vec(), count.to_vec(), numbers].concat()
}

/// Curves of color profiles, and whether they are straight: none, gamma 1 and 2.2 in 256ths, a line, a square; `para` of the gamma 1 and
/// 2.2 in 65536ths.
fn curves() -> Vec<(Vec<u8>, bool)> {
    let para = |gamma: u32| [b"para\0\0\0\0\0\0\0\0".to_vec(), gamma.to_be_bytes().to_vec()].concat();
    vec![
        (curve(&[]), true),
        (curve(&[256]), true),
        (curve(&[563]), false),
        (curve(&[0, 32_768, 65_535]), true),
        (curve(&[0, 16_384, 65_535]), false),
        (para(65_536), true),
        (para(144_179), false),
    ]
}

/// A gray TIFF of 8 bits and 8 x 4 pixels with a further tag.
fn tagged_tiff(tag: TagBytes) -> Vec<u8> {
    let tags = vec![long(256, 8), long(257, 4), long(258, 8), long(259, 1), long(262, 1), long(277, 1)];
    let tags = [tags, vec![long(273, PIXELS_AT as u32), long(279, 32), tag]].concat();
    tiff_bytes(tags, &(0..32).collect::<Vec<u8>>(), false)
}

#[test]
fn a_tiff_on_a_tone_curve_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.tif");
    let refused = |tag: TagBytes, what: &str, is_straight: bool| {
        fs::write(&path, tagged_tiff(tag)).unwrap();
        let said = describe_frame(&path, &FrameFacts::default()).err().map(|error| error.to_string());
        assert_eq!(said.is_none(), is_straight, "{what}: {said:?}");
        assert!(said.is_none_or(|said| said.contains("tone curve") && said.contains(what)));
    };
    for (curve, is_straight) in curves() {
        let profile = profile(&curve);
        refused((34_675, 7, profile.len() as u32, profile), "its ICC profile", is_straight);
    }
    let table = |of: fn(f64) -> f64| (0..256).map(|i| (65_535.0 * of(f64::from(i) / 255.0)) as u16).collect();
    for (table, is_straight) in
        [(table(|x| x), true), (table(|x| x.powf(2.2)), false)] as [(Vec<u16>, bool); 2]
    {
        refused(shorts(301, &table), "its TransferFunction", is_straight);
    }
}

/// A PNG of 8 x 4 gray pixels of 16 bits with a chunk before its pixels, or behind them.
fn png_with(values: &[u16], name: &[u8; 4], data: &[u8], is_behind: bool) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 8, 4);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let pixels: Vec<u8> = values.iter().flat_map(|value| value.to_be_bytes()).collect();
    encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
    let body = [name.as_slice(), data].concat();
    let mut sum = flate2::Crc::new();
    sum.update(&body);
    let length = (data.len() as u32).to_be_bytes();
    let chunk = [length.as_slice(), &body, &sum.sum().to_be_bytes()].concat();
    // Behind the mark, and the header of 25 bytes; before the end of 12
    let at = if is_behind { bytes.len() - 12 } else { 33 };
    bytes.splice(at..at, chunk);
    bytes
}

/// Color profiles and code points (ITU-T H.273: 8 linear, 13 sRGB) of PNG.
#[test]
fn a_png_of_a_curved_profile_is_refused() {
    use std::io::Write;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.png");
    let values: Vec<u16> = (0..32).map(|i| 70 + 3 * i).collect();
    let is_read = |name: &[u8; 4], data: &[u8]| {
        fs::write(&path, png_with(&values, name, data, false)).unwrap();
        describe_frame(&path, &FrameFacts::default()).map_err(|error| error.to_string())
    };
    for (curve, is_straight) in curves() {
        let mut packed =
            flate2::write::ZlibEncoder::new(b"name\0\0".to_vec(), flate2::Compression::default());
        packed.write_all(&profile(&curve)).unwrap();
        let read = is_read(b"iCCP", &packed.finish().unwrap());
        assert_eq!(read.is_ok(), is_straight, "{curve:?}");
        assert!(read.err().is_none_or(|said| said.contains("its ICC profile")));
    }
    is_read(b"cICP", &[1, 8, 0, 1]).unwrap();
    assert!(is_read(b"cICP", &[1, 13, 0, 1]).unwrap_err().contains("cICP"));
}

/// An Exif directory that tells an orientation.
fn exif(orientation: u8) -> Vec<u8> {
    [b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec(), vec![orientation, 0, 0, 0, 0, 0, 0, 0]]
        .concat()
}

/// A frame and a mask that are to be shown turned by 90 degrees clockwise: row 0 of the stored image is the last column, as
/// `frames_are_turned_as_viewers_show_them` has it of DNGs.
#[test]
fn png_frames_and_masks_are_turned_too() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.png");
    let values: Vec<u16> = (0..32).map(|i| 70 + 3 * i).collect();
    let turned = |row: usize, col: usize| (3 - col) * 8 + row;
    for is_behind in [false, true] {
        fs::write(&path, png_with(&values, b"eXIf", &exif(6), is_behind)).unwrap();
        let given = FrameFacts { exposure_s: Some(0.01), ..FrameFacts::default() };
        let found = describe_frame(&path, &given).unwrap();
        assert_eq!(fact(&found, "width, height").0, "4 x 8");
        fs::remove_file(found.path()).ok();
        found.write().unwrap();
        let image = read_sensor_image(&path).unwrap().image;
        assert_eq!((image.width, image.height), (4, 8));
        for (row, col) in (0..8).flat_map(|row| (0..4).map(move |col| (row, col))) {
            assert_eq!(image.data[row * 4 + col], values[turned(row, col)]);
        }
    }
    // Pixel 11 alone
    let only: Vec<u16> = (0..32).map(|i| u16::from(i == 11)).collect();
    let tiff = folder.path().join("mask.tif");
    let mut bytes = tagged_tiff(shorts(274, &[6]));
    bytes.truncate(PIXELS_AT);
    bytes.extend(only.iter().map(|value| *value as u8));
    fs::write(&tiff, bytes).unwrap();
    fs::write(&path, png_with(&only, b"eXIf", &exif(6), false)).unwrap();
    for path in [path, tiff] {
        let mask = read_mask(&path).unwrap();
        assert_eq!((mask.width, mask.height), (4, 8));
        let inside: Vec<bool> =
            (0..8).flat_map(|row| (0..4).map(move |col| turned(row, col) == 11)).collect();
        assert_eq!(mask.inside, inside);
    }
}

#[test]
fn a_png_tells_the_bits_of_its_converter() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.png");
    let described = |values: &[u16], bits: u8| {
        fs::write(&path, png_with(values, b"sBIT", &[bits], false)).unwrap();
        let found = describe_frame(&path, &FrameFacts::default()).unwrap();
        (fact(&found, "bit_depth"), fact(&found, "white_level").0)
    };
    let values: Vec<u16> = (0..32).map(|i| 70 + 3 * i).collect();
    assert_eq!(described(&values, 14), (("14".into(), FactSource::Tag), "16383 DN".into()));
    assert_eq!(described(&values, 16).0.1, FactSource::Assumed);
    // Scaled to all bits of the file, as the format has it, dim values, too
    for (bits, scale) in [(10, 64.0), (10, 65_535.0 / 1023.0), (14, 4.0), (14, 65_535.0 / 16_383.0)] {
        let scaled: Vec<u16> =
            values.iter().map(|value| (f64::from(*value) * scale).round() as u16).collect();
        assert_eq!(described(&scaled, bits).0, (bits.to_string(), FactSource::Tag), "{scale}");
        let given = FrameFacts { exposure_s: Some(0.01), ..FrameFacts::default() };
        describe_frame(&path, &given).unwrap().write().unwrap();
        assert_eq!(read_sensor_image(&path).unwrap().image.data, values, "{scale}");
        fs::remove_file(folder.path().join("frame.png.json")).unwrap();
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
    // ImageJ stores 255 for what is selected, and may show it black
    let inverted = folder.path().join("inverted.tif");
    let mut encoder = tiff::encoder::TiffEncoder::new(fs::File::create(&inverted).unwrap()).unwrap();
    let mut image = encoder.new_image::<tiff::encoder::colortype::Gray8>(48, 40).unwrap();
    image.encoder().write_tag(tiff::tags::Tag::PhotometricInterpretation, 0_u16).unwrap();
    image.encoder().write_tag(tiff::tags::Tag::ImageDescription, "ImageJ=1.53t\n").unwrap();
    image.write_data(&inside.iter().map(|is_in| if *is_in { 255 } else { 0 }).collect::<Vec<u8>>()).unwrap();
    assert_eq!(read_mask(&inverted).unwrap().inside, inside);
    let labels: Vec<u8> = inside.iter().map(|is_in| u8::from(*is_in)).collect();
    let inverted = folder.path().join("inverted.png");
    let palette: Vec<[u8; 3]> = (0..=255).rev().map(|code| [code; 3]).collect();
    fluorspar_format::write_indexed_png(&inverted, 48, 40, &labels, &palette).unwrap();
    assert_eq!(read_mask(&inverted).unwrap().inside, inside);
    // A double may be smaller than any single
    let double = folder.path().join("double.npy");
    let header = format!("{:<117}\n", "{'descr': '<f8', 'fortran_order': False, 'shape': (40, 48), }");
    let mut bytes = [b"\x93NUMPY\x01\0\x76\0", header.as_bytes()].concat();
    bytes.extend(inside.iter().flat_map(|is_in| if *is_in { 1e-300_f64 } else { -0.0 }.to_le_bytes()));
    fs::write(&double, bytes).unwrap();
    assert_eq!(read_mask(&double).unwrap().inside, inside);
    let empty = folder.path().join("empty.png");
    fluorspar_format::write_gray_png(&empty, 4, 4, &[0.0; 16]).unwrap();
    assert!(read_mask(&empty).unwrap_err().to_string().contains("selects nothing"));
    fluorspar_format::write_gray_png(&empty, 4, 4, &[0.5; 16]).unwrap();
    assert!(read_mask(&empty).unwrap_err().to_string().contains("selects the whole image"));
    fs::write(&empty, "no image at all").unwrap();
    assert!(read_mask(&empty).unwrap_err().to_string().contains("none of them"));
    assert!(read_mask(&folder.path().join("none.png")).is_err());
}
