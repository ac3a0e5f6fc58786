//! Stored files of every version of this program's own formats: what an earlier version wrote is read as it was meant.
//!
//! A fixture is called `NAME-VERSION.ENDING`. Where that of the present version is missing, [`fixture`] writes it and the
//! test fails once: look at it, then add it to the repository. Those of former versions are never written again.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::{Path, PathBuf};

use fluorspar::image::{
    BasisComponent, Component, ComponentImage, ExcitationImage, FeatureMaps, Film, FilmLayout, GroupBasis,
    LightPath, Mosaic, SensorImage, SpectralImage, StatisticsKind,
};
use fluorspar::spectral::{ExcitationNodes, Radiance, WavelengthGrid};
use fluorspar_format::{
    ComponentFile, DngColor, ExrOptions, FileFormat, FormatError, Journal, Provenance, RawPacking,
    read_component_exr, read_component_npy, read_film, read_sensor_image, read_spectral_npy,
    write_component_exr, write_component_npy, write_film, write_packed_raw, write_sensor_dng,
    write_sensor_tiff, write_spectral_npy,
};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures")
}

/// The fixture of a version, written first where it is missing and of the present version.
fn fixture(
    name: &str,
    version: u32,
    ending: &str,
    format: &FileFormat,
    write: impl FnOnce(&Path) -> Result<(), FormatError>,
) -> PathBuf {
    let path = folder().join(format!("{name}-{version}.{ending}"));
    if !path.exists() && version == format.version() {
        fs::create_dir_all(folder()).unwrap();
        write(&path).unwrap();
        panic!("{} was missing and is written: look at it, then add it", path.display());
    }
    path
}

fn provenance() -> Provenance {
    Provenance::new("title = \"stored\"", "format = 1\ntitle = \"stored\"\n", 7, 16)
}

fn grid() -> WavelengthGrid {
    WavelengthGrid::from_edges(&[380.0, 390.0, 420.5]).unwrap()
}

fn labels() -> Vec<Component> {
    let light = |light| Component::of_group("blue", light);
    vec![light(LightPath::Reflected), light(LightPath::Fluorescence("elastin".into()))]
}

fn components() -> ComponentImage {
    let mut image = ComponentImage::zeros(grid(), 3, 2, labels());
    for (i, value) in image.data.iter_mut().enumerate() {
        *value = i as f32 * 0.125;
    }
    image.samples_per_pixel = 16;
    image
}

fn features() -> FeatureMaps {
    FeatureMaps {
        depth_m: vec![0.25; 6],
        part: vec![1; 6],
        part_names: vec!["tongue".into()],
        material_names: vec!["mucosa".into()],
        ..FeatureMaps::default()
    }
}

fn radiance() -> SpectralImage<Radiance> {
    SpectralImage::from_data(grid(), 3, 2, (0..12).map(|i| i as f32 * 0.5).collect()).unwrap()
}

fn frame() -> SensorImage {
    SensorImage {
        width: 4,
        height: 2,
        data: (0..8).map(|i| i * 100).collect(),
        mosaic: Mosaic::bayer("grbg").unwrap(),
        black_level: 64.0,
        black_offsets: Vec::new(),
        white_levels: Vec::new(),
        factors: Vec::new(),
        orientation: fluorspar::image::Orientation::default(),
        white_level: 1023,
        bit_depth: 10,
        exposure_s: 0.03,
        gain: 2.0,
        dn_per_electron: 0.125,
        read_noise_dn: 1.5,
        gain_is_assumed: false,
        seed: 7,
        label: "blue".into(),
    }
}

fn film() -> Film {
    let layout = FilmLayout {
        grid: grid(),
        width: 3,
        height: 2,
        components: labels(),
        statistics: StatisticsKind::None,
        bases: Vec::new(),
        exponents: vec![-40; 4],
        levels: vec![0.5; 4],
        scene_digest: "0".repeat(64),
    };
    let mut film = Film::new(layout, features());
    for tile in film.tiles_mut() {
        tile.tile.add_samples(0..2);
        let values = tile.tile.pixels() * 4;
        for (i, sum) in tile.sums[..values].iter_mut().enumerate() {
            *sum = i as u64 * 1000;
        }
    }
    film
}

/// Sums of either sign, as those of coefficients, in as few bytes as hold them.
#[test]
fn films_keep_sums_of_either_sign() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("signed.film");
    let mut lengths = Vec::new();
    for sums in
        [[0, 1, 2, 127], [0, 1, 2, 128], [-1, 1, 0, -128], [-1, 0, 0, -129], [i64::MIN, i64::MAX, -1, 0]]
    {
        let mut signed = film();
        for tile in signed.tiles_mut() {
            let values = tile.tile.pixels() * 4;
            tile.sums[..values].iter_mut().enumerate().for_each(|(at, sum)| *sum = sums[at % 4] as u64);
        }
        write_film(&path, &signed, None).unwrap();
        lengths.push(fs::metadata(&path).unwrap().len());
        assert!(read_film(&path).unwrap().image == signed, "{sums:?}");
    }
    assert!(lengths[0] == lengths[1] && lengths[2] < lengths[3] && lengths[3] < lengths[4], "{lengths:?}");
}

#[test]
fn component_images_of_every_format_are_read() {
    let image = ComponentImage { features: features(), ..components() };
    for version in 1..=FileFormat::COMPONENT_IMAGE.version() {
        let path = fixture("components", version, "exr", &FileFormat::COMPONENT_IMAGE, |path| {
            let provenance = provenance();
            write_component_exr(
                path,
                &image,
                &ExrOptions { provenance: Some(&provenance), ..Default::default() },
            )
        });
        let stored = read_component_exr(&path).unwrap();
        assert_eq!(stored.image, image, "format {version}");
        assert_eq!(stored.provenance.unwrap().seed, 7);
    }
}

/// The excitation basis, which stands beside the components of a run. Earlier programs put channel planes there too, which are
/// passed over.
#[test]
fn excitation_bases_of_every_format_are_read() {
    let image = components();
    let reflected = BasisComponent {
        light: LightPath::Reflected,
        spectra: vec![0.5, 0.25],
        factors: (0..6).map(|i| i as f32).collect(),
        rank: 1,
        error: 0.125,
    };
    let basis = ExcitationImage {
        width: 3,
        height: 2,
        groups: vec![GroupBasis {
            light_group: "blue".into(),
            nodes: ExcitationNodes::new(vec![380.0, 390.0, 400.0]).unwrap(),
            components: vec![reflected],
        }],
    };
    for version in 1..=FileFormat::COMPONENT_IMAGE.version() {
        let path = fixture("planes", version, "exr", &FileFormat::COMPONENT_IMAGE, |path| {
            let options = ExrOptions { excitation: Some(&basis), ..Default::default() };
            write_component_exr(path, &image, &options)
        });
        let stored = ComponentFile::open(&path).unwrap();
        assert_eq!(stored.excitation_basis().unwrap(), Some(basis.clone()), "format {version}");
        assert_eq!(stored.read().unwrap().image, image, "format {version}");
    }
}

#[test]
fn journals_of_every_format_are_read() {
    let work = serde_json::json!({ "search": "stored" });
    let entry = serde_json::json!({ "block": 0, "loss": [0.125, 1e-300] });
    for version in 1..=FileFormat::JOURNAL.version() {
        let path = fixture("search", version, "journal", &FileFormat::JOURNAL, |path| {
            Journal::open(path, &work)?.0.append(&entry)
        });
        assert_eq!(Journal::read(&path, &work).unwrap(), Some(vec![entry.clone()]), "format {version}");
    }
}

#[test]
fn films_of_every_format_are_read() {
    for version in 1..=FileFormat::FILM.version() {
        let path = fixture("film", version, "film", &FileFormat::FILM, |path| {
            write_film(path, &film(), Some(&provenance()))
        });
        let stored = read_film(&path).unwrap();
        assert!(stored.image == film(), "format {version}");
        assert_eq!(stored.provenance.unwrap().seed, 7);
    }
}

#[test]
fn arrays_of_every_format_are_read() {
    for version in 1..=FileFormat::ARRAY.version() {
        let path = fixture("radiance", version, "npy", &FileFormat::ARRAY, |path| {
            write_spectral_npy(path, &radiance(), Some(&provenance()))
        });
        let stored = read_spectral_npy::<Radiance>(&path).unwrap();
        assert_eq!(stored.image, radiance(), "format {version}");
        assert_eq!(stored.provenance.unwrap().seed, 7);
        let path = fixture("components", version, "npy", &FileFormat::ARRAY, |path| {
            write_component_npy(path, &components(), None)
        });
        assert_eq!(read_component_npy(&path).unwrap().image, components(), "format {version}");
    }
}

#[test]
fn raw_frames_of_every_format_are_read() {
    type Write = fn(&Path) -> Result<(), FormatError>;
    let forms: [(&str, Write); 3] = [
        ("tiff", |path| write_sensor_tiff(path, &frame(), Some(&provenance()))),
        ("dng", |path| write_sensor_dng(path, &frame(), &DngColor::default(), Some(&provenance()))),
        ("raw", |path| write_packed_raw(path, &frame(), RawPacking::Raw10, Some(&provenance()))),
    ];
    for version in 1..=FileFormat::RAW_FRAME.version() {
        for (ending, write) in forms {
            let path = fixture("frame", version, ending, &FileFormat::RAW_FRAME, write);
            let stored = read_sensor_image(&path).unwrap();
            assert_eq!(stored.image, frame(), "{ending}, format {version}");
            assert_eq!(stored.provenance.unwrap().seed, 7);
        }
    }
}

/// Every reader refuses the version after its own, and a file that states none, with what to do.
#[test]
fn other_formats_are_refused_with_what_to_do() {
    let temporary = tempfile::tempdir().unwrap();
    let said = |name: &str, edit: &dyn Fn(Vec<u8>) -> Vec<u8>| {
        let data = name.trim_end_matches(".json");
        fs::copy(folder().join(data), temporary.path().join(data)).unwrap();
        let path = temporary.path().join(name);
        fs::write(&path, edit(fs::read(folder().join(name)).unwrap())).unwrap();
        let data = temporary.path().join(data);
        let error = match data.extension().unwrap().to_str().unwrap() {
            "exr" => read_component_exr(&data).unwrap_err(),
            "film" => read_film(&data).unwrap_err(),
            "npy" => read_spectral_npy::<Radiance>(&data).unwrap_err(),
            _ => read_sensor_image(&data).unwrap_err(),
        };
        error.to_string().replace(&format!("{}/", temporary.path().display()), "")
    };
    let replace = |bytes: Vec<u8>, from: &[u8], to: &[u8]| {
        let at = bytes.windows(from.len()).position(|window| window == from).unwrap();
        [&bytes[..at], to, &bytes[at + from.len()..]].concat()
    };
    let again = "Make it again, or use the version of the program that wrote it";
    let stored = b"fluorsparFormat\0int\0\x04\0\0\0\x01";
    let later = b"fluorsparFormat\0int\0\x04\0\0\0\x02";
    assert_eq!(
        said("components-1.exr", &|bytes| replace(bytes, stored, later)),
        format!("components-1.exr: the component image has format 2; this program reads format 1. {again}")
    );
    let unknown = b"fluorsparFermat\0int\0\x04\0\0\0\x01";
    assert_eq!(
        said("components-1.exr", &|bytes| replace(bytes, stored, unknown)),
        "components-1.exr: the component image has no `format`; this program reads format 1. Make it again"
    );
    assert_eq!(
        said("film-1.film", &|bytes| replace(bytes, b"FLSPFILM\x01", b"FLSPFILM\x07")),
        format!("film-1.film: the film has format 7; this program reads format 1. {again}")
    );
    assert_eq!(
        said("radiance-1.npy.json", &|bytes| replace(bytes, b"\"format\": 1", b"\"format\": 2")),
        format!("radiance-1.npy.json: the description has format 2; this program reads format 1. {again}")
    );
    let told = "Use a version of Fluorspar that reads this format";
    assert_eq!(
        said("frame-1.tiff.json", &|bytes| replace(bytes, b"\"format\": 1", b"\"format\": 2")),
        format!("frame-1.tiff.json: the description has format 2; this program reads format 1. {told}")
    );
    assert_eq!(
        said("frame-1.tiff.json", &|bytes| replace(
            bytes,
            b"\"format\": 1",
            b"\"schema\": \"fluorspar.sensor_image.1\""
        )),
        "frame-1.tiff.json: the description has no `format`; this program reads format 1. Write \"format\": 1 into it"
    );
    assert_eq!(
        said("frame-1.dng", &|bytes| replace(bytes, b"\"format\":1", b"\"format\":2")),
        format!("frame-1.dng: the description has format 2; this program reads format 1. {told}")
    );
}
