//! Damaged files of every format: cut short anywhere, bytes changed anywhere. Readers may refuse or read them, but
//! never panic.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "these are tests")]

use std::fs;
use std::panic::catch_unwind;
use std::path::{Path, PathBuf};

use fluorspar::geometry::TriangleMesh;
use fluorspar::image::{
    Component, ComponentImage, ComponentRows, FeatureMaps, LightPath, Mosaic, SensorImage, SpectralImage,
};
use fluorspar::spectral::{Radiance, WavelengthGrid};
use fluorspar_format::{
    ComponentFile, CsvEemOptions, DngColor, ExrCompression, ExrOptions, Provenance, RawPacking,
    SpectrumOptions, Transfer, read_component_exr, read_component_npy, read_eem_csv, read_iset_fluorophore,
    read_obj, read_ply, read_sensor_image, read_spectra, read_spectral_exr, read_spectral_npy,
    read_texture_png, write_component_exr, write_component_npy, write_packed_raw, write_ply, write_rgb_png,
    write_sensor_dng, write_sensor_png, write_sensor_tiff, write_spectral_exr, write_spectral_npy,
};
use glam::{Vec2, Vec3};

/// Reads a file in every state of damage. Returns how many of them were refused.
fn damage(path: &Path, read: impl Fn(&Path) -> bool + std::panic::RefUnwindSafe) -> usize {
    let intact = fs::read(path).unwrap();
    assert!(read(path), "{} is intact", path.display());
    let mut refused = 0;
    let mut attempt = |bytes: &[u8], what: String| {
        fs::write(path, bytes).unwrap();
        match catch_unwind(|| read(path)) {
            Ok(fine) => refused += usize::from(!fine),
            Err(payload) => {
                let message = payload.downcast_ref::<String>().cloned();
                println!("{}: {what}: {message:?}", path.display());
                panic!("a reader panicked");
            }
        }
    };
    let step = (intact.len() / 150).clamp(1, 37);
    for length in (0..intact.len()).step_by(step) {
        attempt(&intact[..length], format!("cut to {length} bytes"));
    }
    // Every byte of the first kilobyte, where headers are, then some of the others, in one of three ways each.
    for at in (0..intact.len().min(1024)).chain((1024..intact.len()).step_by(37)) {
        let change = [0xff, 0x01, 0x80][at % 3];
        let mut bytes = intact.clone();
        bytes[at] ^= change;
        attempt(&bytes, format!("byte {at} xor {change:#x}"));
    }
    // Sizes that no file holds: four bytes at once.
    for at in (0..intact.len().saturating_sub(4).min(2048)).step_by(2) {
        let filler = [[0xff; 4], [0xff, 0xff, 0xff, 0x7f], [0; 4]][at % 3];
        let mut bytes = intact.clone();
        bytes[at..at + 4].copy_from_slice(&filler);
        attempt(&bytes, format!("bytes {at}.. are {filler:x?}"));
    }
    let garbage: Vec<u8> = (0_u32..5000).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    attempt(&garbage, "garbage".into());
    attempt(
        &[intact[..8.min(intact.len())].to_vec(), garbage].concat(),
        "garbage after the first bytes".into(),
    );
    assert!(refused > 0, "{}: no damage was noticed", path.display());
    fs::write(path, intact).unwrap();
    refused
}

fn folder() -> (tempfile::TempDir, PathBuf) {
    // The decoders' own panics, which the readers turn into errors, would fill the screen.
    std::panic::set_hook(Box::new(|info| {
        if info.location().is_some_and(|place| place.file().contains("format_damage")) {
            println!("{info}");
        }
    }));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_path_buf();
    (folder, path)
}

fn grid() -> WavelengthGrid {
    WavelengthGrid::from_edges(&[380.0, 400.0, 420.0]).unwrap()
}

fn components() -> ComponentImage {
    let components = vec![Component::of_group("blue", LightPath::Reflected)];
    let mut image = ComponentImage::zeros(grid(), 3, 2, components);
    image.features = FeatureMaps { depth_m: vec![0.1; 6], part: vec![1; 6], ..Default::default() };
    image
}

fn frame() -> SensorImage {
    SensorImage {
        width: 6,
        height: 4,
        data: (0..24).map(|i| i * 2731).collect(),
        mosaic: Mosaic::monochrome(),
        black_level: 64.0,
        black_offsets: Vec::new(),
        white_levels: Vec::new(),
        factors: Vec::new(),
        orientation: fluorspar::image::Orientation::default(),
        white_level: 1023,
        bit_depth: 10,
        exposure_s: 0.03,
        gain: 1.0,
        dn_per_electron: 0.1,
        read_noise_dn: 1.0,
        gain_is_assumed: false,
        seed: 1,
        label: String::new(),
    }
}

#[test]
fn openexr() {
    let (_guard, folder) = folder();
    let path = folder.join("i.exr");
    let image =
        SpectralImage::<Radiance>::from_data(grid(), 4, 20, (0..160).map(|i| i as f32).collect()).unwrap();
    let provenance = Provenance::new("a = 1", "a = 1", 1, 1);
    for compression in [ExrCompression::Uncompressed, ExrCompression::Zip, ExrCompression::Rounded24] {
        let options = ExrOptions { compression, provenance: Some(&provenance), ..Default::default() };
        // Only rows of components have a decoder of their own for 24 bits
        if compression != ExrCompression::Rounded24 {
            write_spectral_exr(&path, &image, &options).unwrap();
            damage(&path, |path| read_spectral_exr::<Radiance>(path).is_ok());
            write_component_exr(&path, &components(), &options).unwrap();
            damage(&path, |path| read_component_exr(path).is_ok());
        }
        write_component_exr(&path, &components(), &options).unwrap();
        damage(&path, |path| {
            ComponentFile::open(path).is_ok_and(|file| file.map_rows(|_| true, |_, _, _| ()).is_ok())
        });
    }
}

#[test]
fn numpy() {
    let (_guard, folder) = folder();
    let path = folder.join("a.npy");
    let image = SpectralImage::<Radiance>::zeros(grid(), 3, 2);
    write_spectral_npy(&path, &image, None).unwrap();
    damage(&path, |path| read_spectral_npy::<Radiance>(path).is_ok());
    damage(&folder.join("a.npy.json"), |_| read_spectral_npy::<Radiance>(&path).is_ok());
    write_component_npy(&path, &components(), None).unwrap();
    damage(&path, |path| read_component_npy(path).is_ok());
    damage(&folder.join("a.npy.json"), |_| read_component_npy(&path).is_ok());
}

#[test]
fn raw_frames_and_images() {
    let (_guard, folder) = folder();
    let path = folder.join("f.tiff");
    write_sensor_tiff(&path, &frame(), None).unwrap();
    damage(&path, |path| read_sensor_image(path).is_ok());
    damage(&folder.join("f.tiff.json"), |_| read_sensor_image(&path).is_ok());
    let path = folder.join("f.png");
    write_sensor_png(&path, &frame(), None).unwrap();
    damage(&path, |path| read_sensor_image(path).is_ok());
    let small = SensorImage { data: (0..24).map(|i| i * 40).collect(), ..frame() };
    let path = folder.join("f.dng");
    write_sensor_dng(&path, &small, &DngColor::default(), None).unwrap();
    damage(&path, |path| read_sensor_image(path).is_ok());
    let bayer = SensorImage { mosaic: Mosaic::bayer("rggb").unwrap(), ..small.clone() };
    write_sensor_dng(&path, &bayer, &DngColor::default(), None).unwrap();
    damage(&path, |path| read_sensor_image(path).is_ok());
    let path = folder.join("f.raw");
    write_packed_raw(&path, &small, RawPacking::Raw10, None).unwrap();
    damage(&path, |path| read_sensor_image(path).is_ok());
    damage(&folder.join("f.raw.json"), |_| read_sensor_image(&path).is_ok());
    let path = folder.join("f.png");
    write_rgb_png(&path, 4, 3, &[77; 36]).unwrap();
    damage(&path, |path| read_texture_png(path, Transfer::Srgb).is_ok());
}

#[test]
fn tables() {
    let (_guard, folder) = folder();
    let path = folder.join("t.csv");
    fs::write(&path, "# c\nwavelength_nm,a,\"b\"\n400,1,2\n410,1.5e-3,2\n420,3,4\n").unwrap();
    damage(&path, |path| read_spectra(path, &SpectrumOptions::default()).is_ok());
    fs::write(&path, "# unit: photons\nem_nm\\ex_nm,350,400\n380,1,0\n450,2,3\n").unwrap();
    damage(&path, |path| read_eem_csv(path, &CsvEemOptions::default()).is_ok());
}

#[test]
fn matlab() {
    let (_guard, folder) = folder();
    let path = folder.join("f.mat");
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    for name in ["iset_v5.mat", "iset_v7_struct.mat", "iset_v73.mat", "iset_emission_only.mat"] {
        fs::copy(data.join(name), &path).unwrap();
        damage(&path, |path| read_iset_fluorophore(path).is_ok());
    }
    for name in ["spectra_v5.mat", "spectra_v73.mat"] {
        fs::copy(data.join(name), &path).unwrap();
        damage(&path, |path| read_spectra(path, &SpectrumOptions::default()).is_ok());
    }
}

#[test]
fn meshes() {
    let (_guard, folder) = folder();
    let path = folder.join("m.ply");
    let mesh = TriangleMesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        normals: vec![Vec3::Z; 3],
        uvs: vec![Vec2::ZERO; 3],
        triangles: vec![[0, 1, 2]],
    };
    write_ply(&path, &mesh).unwrap();
    damage(&path, |path| read_ply(path, 1.0).is_ok());
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_index\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    fs::write(&path, text).unwrap();
    damage(&path, |path| read_ply(path, 1.0).is_ok());
    let path = folder.join("m.obj");
    fs::write(
        &path,
        "o a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf -3//1 -2//1 -1//1\n",
    )
    .unwrap();
    damage(&path, |path| read_obj(path, 1.0).is_ok());
}
