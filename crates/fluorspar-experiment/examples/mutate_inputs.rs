//! Feeds damaged files to every reader: `cargo run --release -p fluorspar-experiment --example mutate_inputs`.
//!
//! | option | meaning | default |
//! |---|---|---|
//! | `--executions N` | inputs over all readers | 100 000 |
//! | `--seed N` | where the random numbers start; equal seeds give equal inputs | 1 |
//! | `--reader TEXT` | only readers whose names contain this text | all |
//! | `--seconds N` | when to stop, done or not | never |
//! | `--keep FOLDER` | where inputs that break a bound are written | nowhere |
//!
//! Each reader starts from valid files. An input is one of them after one to four changes: flipped bits, other bytes, sizes at
//! their extremes, numbers at theirs, ranges removed, repeated, moved or taken from another file, the end cut off. The program
//! counts panics (also those that readers turn into errors), the time on the processor and the memory of each input, prints a
//! table and ends with code 1 where an input panicked, took 3 seconds or 1 GiB.

#![allow(unsafe_code, reason = "an allocator that counts is an unsafe trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::error::Error;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use fluorspar::geometry::TriangleMesh;
use fluorspar::image::{
    Component, ComponentImage, FeatureMaps, LightPath, Mosaic, SensorImage, SpectralImage,
};
use fluorspar::render::{Checkpoint, FilmRenderer, RenderControl, RenderSettings, Share};
use fluorspar::spectral::{Radiance, WavelengthGrid};
use fluorspar_experiment::{
    edit_experiment, parse, parse_sample, parse_script, parse_sensor, preset, resolve,
};
use fluorspar_format as format;
use fluorspar_format::{CsvEemOptions, CsvSpectrumOptions, ExrCompression, ExrOptions, RawPacking, Transfer};
use glam::{Vec2, Vec3};

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Largest input, bytes.
const MAX_INPUT: usize = 16 << 20;
/// Most time of an input on the processor, seconds.
const MAX_SECONDS: f64 = 3.0;
/// Most memory of an input, bytes.
const MAX_BYTES: usize = 1 << 30;

/// Counts the bytes that are in use, and the most that ever were.
struct Counting;

static IN_USE: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

fn add(bytes: usize) {
    let now = IN_USE.fetch_add(bytes, Relaxed) + bytes;
    MOST.fetch_max(now, Relaxed);
}

// SAFETY: all requests go to the allocator of the system as they are, and its answers come back as they are.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        add(layout.size());
        // SAFETY: the caller keeps to the contract of this method.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        add(layout.size());
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        IN_USE.fetch_sub(layout.size(), Relaxed);
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Panics so far, and where the last one was.
static PANICS: AtomicU64 = AtomicU64::new(0);
static LAST_PANIC: Mutex<String> = Mutex::new(String::new());

/// Numbers that look random: SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Below `end`; 0 where that is 0.
    fn below(&mut self, end: usize) -> usize {
        if end == 0 { 0 } else { (self.next() % end as u64) as usize }
    }

    fn one_of<'a, T>(&mut self, list: &'a [T]) -> &'a T {
        &list[self.below(list.len())]
    }

    /// A range of at most `longest` entries.
    fn range(&mut self, length: usize, longest: usize) -> std::ops::Range<usize> {
        let start = self.below(length);
        start..start + self.below(longest.min(length - start) + 1)
    }
}

const SIZES: &[u64] = &[
    0,
    1,
    2,
    7,
    8,
    127,
    128,
    255,
    256,
    0x7fff,
    0x8000,
    0xffff,
    0x1_0000,
    0xff_ffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_fff8,
    0xffff_ffff,
    1 << 32,
    1 << 40,
    i64::MAX as u64,
    1 << 63,
    u64::MAX,
];
const NUMBERS: &[&str] = &[
    "0",
    "-0",
    "-1",
    "1e-400",
    "1e308",
    "-1e308",
    "1e999",
    "nan",
    "inf",
    "-inf",
    "9223372036854775807",
    "18446744073709551616",
    "1e5",
    "100000",
    "65536",
    "0.1",
    "\"a\"",
    "[]",
    "{}",
    "true",
    "",
];

/// Changes an input once.
fn change(bytes: &mut Vec<u8>, random: &mut Random, other: &[u8]) {
    let length = bytes.len();
    let at = random.below(length);
    match random.below(12) {
        0 if length > 0 => bytes[at] ^= 1 << random.below(8),
        1 if length > 0 => {
            bytes[at] = *random.one_of(&[0, 1, 0x7f, 0x80, 0xff, b'0', b'9', b',', b'"', b'\n', b'['])
        }
        2 if length > 0 => bytes[at] = random.next() as u8,
        // A size, in either byte order.
        3 | 4 if length > 8 => {
            let value = *random.one_of(SIZES);
            let width = *random.one_of(&[1, 2, 4, 8]);
            let at = random.below(length - 8);
            if random.below(2) == 0 {
                bytes[at..at + width].copy_from_slice(&value.to_le_bytes()[..width]);
            } else {
                bytes[at..at + width].copy_from_slice(&value.to_be_bytes()[8 - width..]);
            }
        }
        // A number of a text.
        5 | 6 => {
            let is_digit = |byte: &u8| byte.is_ascii_digit() || b"+-.eE".contains(byte);
            let Some(start) = (at..length).find(|i| bytes[*i].is_ascii_digit()) else { return };
            let end = (start..length).find(|i| !is_digit(&bytes[*i])).unwrap_or(length);
            bytes.splice(start..end, random.one_of(NUMBERS).bytes());
        }
        7 => bytes.truncate(at),
        8 => drop(bytes.drain(random.range(length, 64))),
        // A range repeated, now and then many times.
        9 => {
            let range = random.range(length, 256);
            let times = *random.one_of(&[1, 1, 2, 10, 1000, 20_000]);
            let part = bytes[range.clone()].repeat(times.min(MAX_INPUT / 2 / (range.len() + 1)));
            bytes.splice(range.end..range.end, part);
        }
        10 if !other.is_empty() => {
            let range = random.range(other.len(), 256);
            let end = (at + range.len()).min(length);
            bytes.splice(at..end, other[range].iter().copied());
        }
        _ => {
            let (one, two) = (random.range(length, 64), random.below(length));
            let part: Vec<u8> = bytes[one].to_vec();
            bytes.splice(two..two, part);
        }
    }
    bytes.truncate(MAX_INPUT);
}

/// Makes the check sums of a PNG right, so that what it says is looked at.
fn repair_png(bytes: &mut [u8]) {
    let mut at = 8;
    while let Some(length) = bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_be_bytes) {
        let end = at + 8 + length as usize;
        let Some(content) = bytes.get(at + 4..end) else { return };
        let bit = |crc: u32, _| (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 };
        let crc = !content.iter().fold(u32::MAX, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), bit));
        let Some(place) = bytes.get_mut(end..end + 4) else { return };
        place.copy_from_slice(&crc.to_be_bytes());
        at = end + 4;
    }
}

type Read = Box<dyn Fn(&Path) -> bool>;

/// A reader and valid files for it.
struct Subject {
    name: &'static str,
    /// Name of the file that is damaged.
    file: &'static str,
    /// File that is read, where the damaged one only belongs to it.
    opened: &'static str,
    seeds: Vec<Vec<u8>>,
    /// Files that belong to it, as they are.
    companions: Vec<(&'static str, Vec<u8>)>,
    /// How many inputs against the others.
    weight: f64,
    read: Read,
}

/// Files of all readers.
struct Subjects {
    folder: PathBuf,
    list: Vec<Subject>,
}

impl Subjects {
    fn add(
        &mut self,
        name: &'static str,
        file: &'static str,
        seeds: Vec<Vec<u8>>,
        read: impl Fn(&Path) -> bool + 'static,
    ) {
        let read = Box::new(read);
        self.list.push(Subject {
            name,
            file,
            opened: file,
            seeds,
            companions: Vec::new(),
            weight: 1.0,
            read,
        });
    }

    /// A file that a writer of this program makes.
    fn written<E: Error + 'static>(
        &mut self,
        name: &'static str,
        file: &'static str,
        write: impl Fn(&Path) -> Result<(), E>,
        read: impl Fn(&Path) -> bool + 'static,
    ) -> Outcome<()> {
        let path = self.folder.join(file);
        write(&path)?;
        self.add(name, file, vec![fs::read(&path)?], read);
        Ok(())
    }

    /// A file with a description next to it: the file is damaged first, then the description.
    fn described<E: Error + 'static>(
        &mut self,
        names: [&'static str; 2],
        [file, sidecar]: [&'static str; 2],
        write: impl Fn(&Path) -> Result<(), E>,
        read: impl Fn(&Path) -> bool + Copy + 'static,
    ) -> Outcome<()> {
        let path = self.folder.join(file);
        write(&path)?;
        let (content, description) = (fs::read(&path)?, fs::read(self.folder.join(sidecar))?);
        self.add(names[0], file, vec![content.clone()], read);
        self.add(names[1], sidecar, vec![description.clone()], read);
        let both = self.list.len();
        self.list[both - 2].companions.push((sidecar, description));
        self.list[both - 1].companions.push((file, content));
        self.list[both - 1].opened = file;
        Ok(())
    }
}

fn grid() -> Outcome<WavelengthGrid> {
    Ok(WavelengthGrid::from_edges(&[380.0, 400.0, 420.0])?)
}

fn frame() -> SensorImage {
    SensorImage {
        width: 6,
        height: 4,
        data: (0..24).map(|i| i * 40).collect(),
        mosaic: Mosaic::monochrome(),
        black_level: 64.0,
        white_level: 1023,
        bit_depth: 10,
        exposure_s: 0.03,
        gain: 1.0,
        dn_per_electron: 0.1,
        read_noise_dn: 1.0,
        seed: 1,
        label: String::new(),
    }
}

fn images(subjects: &mut Subjects) -> Outcome<()> {
    let data = (0..160).map(|i| i as f32).collect();
    let spectral = SpectralImage::<Radiance>::from_data(grid()?, 4, 20, data)?;
    let components = vec![Component::of_group("blue", LightPath::Reflected)];
    let mut component = ComponentImage::zeros(grid()?, 3, 2, components);
    component.features = FeatureMaps { depth_m: vec![0.1; 6], part: vec![1; 6], ..Default::default() };
    let read_spectral = |path: &Path| format::read_spectral_exr::<Radiance>(path).is_ok();
    for (names, compression) in [
        (["spectral EXR", "component EXR"], ExrCompression::Uncompressed),
        (["spectral EXR, ZIP", "component EXR, ZIP"], ExrCompression::Zip),
    ] {
        let options = ExrOptions { compression, ..Default::default() };
        let write = |path: &Path| format::write_spectral_exr(path, &spectral, &options);
        subjects.written(names[0], "i.exr", write, read_spectral)?;
        let write = |path: &Path| format::write_component_exr(path, &component, &options);
        subjects.written(names[1], "i.exr", write, |path| format::read_component_exr(path).is_ok())?;
    }
    subjects.described(
        ["spectral NPY", "spectral NPY, JSON"],
        ["a.npy", "a.npy.json"],
        |path| format::write_spectral_npy(path, &spectral, None),
        |path| format::read_spectral_npy::<Radiance>(path).is_ok(),
    )?;
    subjects.described(
        ["component NPY", "component NPY, JSON"],
        ["a.npy", "a.npy.json"],
        |path| format::write_component_npy(path, &component, None),
        |path| format::read_component_npy(path).is_ok(),
    )?;
    subjects.written(
        "PNG texture",
        "t.png",
        |path| format::write_rgb_png(path, 4, 3, &[77; 36]),
        |path| format::read_texture_png(path, Transfer::Srgb).is_ok(),
    )
}

fn frames(subjects: &mut Subjects) -> Outcome<()> {
    let read = |path: &Path| format::read_sensor_image(path).is_ok();
    subjects.described(
        ["raw TIFF", "raw TIFF, JSON"],
        ["f.tiff", "f.tiff.json"],
        |path| format::write_sensor_tiff(path, &frame(), None),
        read,
    )?;
    subjects.described(
        ["raw PNG", "raw PNG, JSON"],
        ["f.png", "f.png.json"],
        |path| format::write_sensor_png(path, &frame(), None),
        read,
    )?;
    subjects.described(
        ["packed raw", "packed raw, JSON"],
        ["f.raw", "f.raw.json"],
        |path| format::write_packed_raw(path, &frame(), RawPacking::Raw10, None),
        read,
    )?;
    let color = format::DngColor::default();
    let write = |path: &Path| format::write_sensor_dng(path, &frame(), &color, None);
    subjects.written("DNG", "f.dng", write, read)
}

/// A film of two spheres.
fn film(subjects: &mut Subjects) -> Outcome<()> {
    let changes = ["render.width_px=20", "render.height_px=18", "spectral.step_nm=40"].map(String::from);
    let text = "format = 1\nbase = \"fluorescent-sphere\"";
    let study = resolve(&parse(text, "film", Path::new("."), &changes)?)?.study;
    let settings = RenderSettings { samples_per_pixel: 2, ..study.render.clone() };
    let renderer = FilmRenderer::new(&study.scene, &settings)?;
    let mut film = renderer.new_film();
    let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
    let pause = Checkpoint { is_due: &|| false, on_pause: &mut |_| true };
    renderer.fill(&Share::Tiles { index: 0, count: 1 }, &mut film, &control, pause)?;
    let write = |path: &Path| format::write_film(path, &film, None);
    subjects.written("film", "f.film", write, |path| format::read_film(path).is_ok())
}

fn tables(subjects: &mut Subjects) {
    let table = |text: &str| vec![text.as_bytes().to_vec()];
    subjects.add(
        "spectra CSV",
        "s.csv",
        table("# c\nwavelength_nm,a,\"b\"\n400,1,2\n410,1.5e-3,2\n420,3,4\n"),
        |path| format::read_spectrum_csv(path, &CsvSpectrumOptions::default()).is_ok(),
    );
    subjects.add(
        "matrix CSV",
        "m.csv",
        table("# unit: photons\nem_nm\\ex_nm,350,400\n380,1,0\n450,2,3\n"),
        |path| format::read_eem_csv(path, &CsvEemOptions::default()).is_ok(),
    );
    subjects.add(
        "fluorophore CSV",
        "f.csv",
        table("wavelength_nm,excitation,emission\n400,1,0\n450,0.5,0.2\n500,0,1\n"),
        |path| format::read_fluorophore_csv(path, format::Negative::Refuse).is_ok(),
    );
    subjects.add(
        "placements CSV",
        "p.csv",
        table(
            "# places\nxx xy xz x yx yy yz y zx zy zz z\n1,0,0,5,0,1,0,6,0,0,1,7\n1;0;0;0;0;1;0;0;0;0;1;0\n",
        ),
        |path| format::read_placements(path, 0.001).is_ok(),
    );
    let mut array =
        b"\x93NUMPY\x01\x00\x46\x00{'descr': '<f4', 'fortran_order': False, 'shape': (2, 12), }".to_vec();
    array.resize(79, b' ');
    array.push(b'\n');
    array.extend((0..24).flat_map(|i| (i as f32).to_le_bytes()));
    subjects.add("placements NPY", "p.npy", vec![array], |path| format::read_placements(path, 0.001).is_ok());
}

/// The files that SciPy, hdf5storage and h5py wrote for the tests.
fn matlab(subjects: &mut Subjects) -> Outcome<()> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fluorspar-format/tests/data");
    let file = |name: &str| fs::read(data.join(name)).map_err(|error| format!("{name}: {error}"));
    let v5 = vec![file("iset_v5.mat")?, file("iset_v7_struct.mat")?, file("iset_emission_only.mat")?];
    let is_fluorophore = |path: &Path| format::read_iset_fluorophore(path).is_ok();
    let is_spectra = |path: &Path| format::read_mat_spectra(path).is_ok();
    subjects.add("fluorophore MAT 5", "f.mat", v5, is_fluorophore);
    subjects.add("fluorophore MAT 7.3", "f.mat", vec![file("iset_v73.mat")?], is_fluorophore);
    let v5 = vec![file("spectra_v5.mat")?, file("spectra_v4.mat")?];
    subjects.add("spectra MAT 5 and 4", "s.mat", v5, is_spectra);
    subjects.add("spectra MAT 7.3", "s.mat", vec![file("spectra_v73.mat")?], is_spectra);
    Ok(())
}

const GLTF: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,2]}],
"nodes":[{"children":[1]},{"mesh":0,"translation":[0,0,1]},{"mesh":0,"rotation":[0,0,0,1],"scale":[1,2,3]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],
"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":36,"byteStride":12}],
"buffers":[{"byteLength":36,"uri":"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]}"#;

fn meshes(subjects: &mut Subjects) -> Outcome<()> {
    let mesh = TriangleMesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z],
        normals: vec![Vec3::Z; 4],
        uvs: vec![Vec2::ZERO; 4],
        triangles: vec![[0, 1, 2], [1, 3, 2]],
    };
    let ply = |order: &str| {
        format!(
            "ply\nformat {order} 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
             element face 1\nproperty list uchar int vertex_index\nend_header\n"
        )
    };
    let text = ply("ascii") + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let mut big = ply("binary_big_endian").into_bytes();
    big.extend([0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].map(f32::to_be_bytes).concat());
    big.extend([3, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2]);
    let read = |path: &Path| format::read_ply(path, 0.001).is_ok();
    subjects.add("PLY, text and big-endian", "m.ply", vec![text.into_bytes(), big], read);
    subjects.written("PLY, little-endian", "m.ply", |path| format::write_ply(path, &mesh), read)?;
    let text = "o a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf -3//1 -2//1 -1//1\n";
    subjects.add("OBJ", "m.obj", vec![text.into()], |path| format::read_obj(path, 0.001).is_ok());
    let text = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    let mut binary = vec![0; 80];
    binary.extend(1_u32.to_le_bytes());
    binary.extend(
        [0.0_f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].map(f32::to_le_bytes).concat(),
    );
    binary.extend([0; 2]);
    subjects.add("STL", "m.stl", vec![text.into(), binary], |path| format::read_stl(path, 0.001).is_ok());
    let read_gltf = |path: &Path| {
        let flat = format::read_gltf(path, 1.0).is_ok();
        format::read_gltf_instances(path, 1.0).is_ok() && flat
    };
    subjects.add("glTF", "m.gltf", vec![GLTF.into()], read_gltf);
    let part = format::NamedMesh { name: "a", material: "b", color: [0.5; 3], mesh: &mesh };
    subjects.written("GLB", "m.glb", |path| format::write_gltf(path, std::slice::from_ref(&part)), read_gltf)
}

const ZEMAX: &str = "VERS 140730\nMODE SEQ\nNAME a\nUNIT MM X W X CM MR CPMM\nWAVM 1 0.5875618 1\nPWAV 1\nSURF 0\n  \
    TYPE STANDARD\n  CURV 0.0 0 0 0 0 \"\"\n  DISZ INFINITY\nSURF 1\n  STOP\n  TYPE EVENASPH\n  CURV 0.025 0 0 0 0 \"\"\n  \
    PARM 1 0\n  PARM 2 1e-6\n  DISZ 6\n  GLAS N-BK7 0 0 1.5 40 0 0 0 0 0 0\n  CONI -0.5\n  DIAM 10 1 0 0 1 \"\"\nSURF 2\n  \
    TYPE STANDARD\n  CURV -0.01 0 0 0 0 \"\"\n  DISZ 60\n  DIAM 10 1 0 0 1 \"\"\nSURF 3\n  TYPE STANDARD\n  DISZ 0\n";
const OMNI: &str = r#"{"name": "omni", "description": "two faces", "type": "omni", "surfaces": [
    {"conic_constant": 0, "ior": [1.62, 1.61, 1.60], "wavelength": [400, 500, 600], "radius": 40, "semi_aperture": 10,
    "thickness": 6}, {"ior": 0, "radius": 0, "semi_aperture": 4, "thickness": 0}]}"#;
const OLDER: &str = r#"{"name": "old", "surfaceArray": [{"subtype": "refractive", "sRadius": 67, "sCenter": [0,0,64],
    "wave": [400,700], "apertureD": 25, "n": [1.65,1.65]}, {"subtype": "diaphragm", "sRadius": 0, "sCenter": [0,0,-1.5],
    "wave": [400,700], "apertureD": 25, "n": [1.65,1.65]}], "apertureMiddleD": 8}"#;

fn lenses(subjects: &mut Subjects) {
    let read = |path: &Path| format::read_lens(path).is_ok();
    let table = "# a singlet behind its stop\n50\n0 2 0 4\n40 6 1.6 20\n-70 0 1 20\n";
    let toml = "name = \"a\"\nscale = 0.5\n[[surface]]\nradius_mm = 40\nthickness_mm = 6\nindex = 1.6\n\
        semi_diameter_mm = 10\nstop = true\n[[surface]]\nradius_mm = -70\nsemi_diameter_mm = 10\n";
    subjects.add("lens, pbrt", "l.dat", vec![table.into()], read);
    subjects.add("lens, Zemax", "l.zmx", vec![ZEMAX.into()], read);
    subjects.add("lens, ISET", "l.json", vec![OMNI.into(), OLDER.into()], read);
    subjects.add("lens, TOML", "l.toml", vec![toml.into()], read);
    let whole = PBRT.replace("Include \"none.pbrt\"", "");
    subjects.add("scene of pbrt", "s.pbrt", vec![PBRT.into(), whole.into()], |path| {
        format::read_pbrt(path).is_ok()
    });
}

const PBRT: &str = "LookAt 0 0 5 0 0 0 0 1 0\nCamera \"perspective\" \"float fov\" 40\nFilm \"rgb\" \"integer xresolution\" [ 4 ]\n\
    WorldBegin\nTexture \"t\" \"spectrum\" \"constant\" \"rgb value\" [ 0.1 0.2 0.3 ]\nMakeNamedMaterial \"m\" \"string type\" \"matte\"\n  \
    \"texture Kd\" \"t\" \"photolumi f\" [ 400 5 405 0 0 0.5 0 ]\nAttributeBegin # one\nTranslate 0 1 0 Rotate 30 0 0 1 Scale -1 1 1\n\
    ConcatTransform [ 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 ]\nNamedMaterial \"m\" ReverseOrientation\n\
    AreaLightSource \"diffuse\" \"spectrum L\" [ 400 1 700 2 ] \"bool twosided\" true\nShape \"trianglemesh\" \"integer indices\" [ 0 1 2 ]\n  \
    \"point P\" [ 0 0 0 1 0 0 0 1 0 ]\nAttributeEnd\nObjectBegin \"o\" Shape \"sphere\" ObjectEnd ObjectInstance \"o\"\nInclude \"none.pbrt\"\n";

const SCRIPT: &str = "format = 1\n[[change]]\nset = \"light.*.strength.irradiance_w_per_m2\"\nvalue = 20.5\n[[change]]\n\
    set = \"patch/material.concentrations.\\\"elastin\\\"\"\nvalue = 0.5\n[[change]]\ninsert = \"object.ball\"\n\
    value = { type = \"sphere\", radius_mm = 2.0, material = \"patch\", center_mm = [1.0, 2.0, 3.0] }\n[[change]]\n\
    set = \"p*/transform.translate_mm[1]\"\nvalue = 3\n[[change]]\ndelete = \"object.ball\"\n";

/// Texts as the command line reads them: bounded, then parsed and resolved.
fn experiments(subjects: &mut Subjects) -> Outcome<()> {
    fn text(path: &Path) -> Option<String> {
        format::read_text_bounded(path, 256 << 20).ok()
    }
    let base = Path::new(".");
    let names = ["flat-patch", "fluorescent-sphere"];
    let seeds = names.map(|name| preset::experiment(name).map(|preset| preset.text.into()));
    let seeds = seeds.into_iter().collect::<Result<_, _>>()?;
    subjects.add("experiment TOML", "e.toml", seeds, move |path| {
        text(path).is_some_and(|text| parse(&text, "e", base, &[]).and_then(|e| resolve(&e)).is_ok())
    });
    let seeds = vec![preset::sample("tongue-385nm")?.text.into()];
    subjects.add("sample TOML", "s.toml", seeds, move |path| {
        text(path).is_some_and(|text| parse_sample(&text, "s", base, &[]).is_ok())
    });
    let sensors = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/sensors");
    let sensor = |name: &str| fs::read(sensors.join(name)).map_err(|error| format!("{name}: {error}"));
    let seeds = vec![sensor("lyu_2021_table_1.toml")?, sensor("rgb_nir_3um.toml")?];
    subjects.add("sensor TOML", "d.toml", seeds, move |path| {
        text(path).is_some_and(|text| parse_sensor(&text, "d", base, &[]).is_ok())
    });
    // These resolve spectra, and are read a hundred times slower than the others.
    let count = subjects.list.len();
    subjects.list[count - 3..].iter_mut().for_each(|subject| subject.weight = 0.1);
    // A damaged script that can be read is replayed on a scene.
    let scene = preset::experiment("flat-patch")?.text;
    subjects.add("script of changes", "c.toml", vec![SCRIPT.into()], move |path| {
        let changes = text(path).and_then(|text| parse_script(&text, "c").ok());
        changes.is_some_and(|changes| edit_experiment(scene, "e", base, &changes).is_ok())
    });
    Ok(())
}

/// What the inputs of a reader did.
#[derive(Default)]
struct Report {
    executions: u64,
    read: u64,
    panics_escaped: u64,
    panics_caught: u64,
    slowest_s: f64,
    most_bytes: usize,
    broken: Vec<String>,
}

/// Time of this thread on the processor, seconds; Linux only.
fn processor_s() -> f64 {
    let text = fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}

/// Feeds a reader until it has had `executions` inputs in all.
fn run(
    subject: &Subject,
    folder: &Path,
    executions: u64,
    (random, report): &mut (Random, Report),
    keep: Option<&Path>,
) -> Outcome<()> {
    let path = folder.join(subject.file);
    let opened = folder.join(subject.opened);
    for (name, content) in &subject.companions {
        fs::write(folder.join(name), content)?;
    }
    for number in report.executions..executions {
        let mut bytes = random.one_of(&subject.seeds).clone();
        let other = random.one_of(&subject.seeds);
        // The first inputs are the valid files.
        if number as usize >= subject.seeds.len() {
            for _ in 0..=random.below(4) {
                change(&mut bytes, random, other);
            }
        } else {
            bytes.clone_from(&subject.seeds[number as usize]);
        }
        if subject.file.ends_with(".png") {
            repair_png(&mut bytes);
        }
        fs::write(&path, &bytes)?;
        let before = IN_USE.load(Relaxed);
        MOST.store(before, Relaxed);
        let panics = PANICS.load(Relaxed);
        let begun = processor_s();
        let outcome = catch_unwind(AssertUnwindSafe(|| (subject.read)(&opened)));
        let seconds = processor_s() - begun;
        let most = MOST.load(Relaxed).saturating_sub(before);
        let panicked = PANICS.load(Relaxed) - panics;
        report.executions += 1;
        report.slowest_s = report.slowest_s.max(seconds);
        report.most_bytes = report.most_bytes.max(most);
        match outcome {
            Ok(read) => {
                report.read += u64::from(read);
                report.panics_caught += panicked;
                if !read && (number as usize) < subject.seeds.len() && !subject.name.contains(" and 4") {
                    return Err(format!("{}: seed {number} is refused", subject.name).into());
                }
            }
            Err(_) => report.panics_escaped += 1,
        }
        if panicked > 0 || seconds > MAX_SECONDS || most > MAX_BYTES {
            let place = LAST_PANIC.lock().unwrap_or_else(PoisonError::into_inner).clone();
            let place = if panicked > 0 { place } else { String::new() };
            if report.broken.len() < 20 {
                report.broken.push(format!("input {number}: {seconds:.2} s, {} MiB, {place}", most >> 20));
                if let Some(keep) = keep {
                    fs::write(keep.join(format!("{number}-{}", subject.file)), &bytes)?;
                }
            }
        }
    }
    Ok(())
}

struct Options {
    executions: u64,
    seed: u64,
    reader: String,
    seconds: u64,
    keep: Option<PathBuf>,
}

fn options() -> Outcome<Options> {
    let mut options =
        Options { executions: 100_000, seed: 1, reader: String::new(), seconds: u64::MAX, keep: None };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next().ok_or_else(|| format!("{word} needs a value"))?;
        match word.as_str() {
            "--executions" => options.executions = value.parse()?,
            "--seed" => options.seed = value.parse()?,
            "--reader" => options.reader = value,
            "--seconds" => options.seconds = value.parse()?,
            "--keep" => options.keep = Some(value.into()),
            _ => return Err(format!("unknown option {word}").into()),
        }
    }
    Ok(options)
}

#[expect(clippy::print_stdout, reason = "what the example is for")]
fn main() -> Outcome<ExitCode> {
    let options = options()?;
    let folder = tempfile::tempdir()?;
    let mut subjects = Subjects { folder: folder.path().to_path_buf(), list: Vec::new() };
    images(&mut subjects)?;
    frames(&mut subjects)?;
    film(&mut subjects)?;
    tables(&mut subjects);
    matlab(&mut subjects)?;
    meshes(&mut subjects)?;
    lenses(&mut subjects);
    experiments(&mut subjects)?;
    subjects.list.retain(|subject| subject.name.contains(&options.reader));
    // Readers silence panics that they catch with a hook of their own, which they set once: it must be there before this one.
    subjects.written(
        "",
        "t.png",
        |path| format::write_rgb_png(path, 1, 1, &[7; 3]),
        |path| format::read_texture_png(path, Transfer::Srgb).is_ok(),
    )?;
    if let Some(first) = subjects.list.pop() {
        (first.read)(&folder.path().join("t.png"));
    }
    set_hook(Box::new(|info| {
        PANICS.fetch_add(1, Relaxed);
        *LAST_PANIC.lock().unwrap_or_else(PoisonError::into_inner) = info.to_string().replace('\n', " ");
    }));

    // A part of the inputs of each reader at a time, so that all have had some whenever the time is over.
    const ROUNDS: u64 = 200;
    let begun = Instant::now();
    let weights: f64 = subjects.list.iter().map(|subject| subject.weight).sum();
    let random = |number| Random(options.seed.wrapping_mul(1_000_003).wrapping_add(number));
    let mut states: Vec<(Random, Report)> =
        (0..subjects.list.len() as u64).map(|number| (random(number), Report::default())).collect();
    'rounds: for round in 1..=ROUNDS {
        for (subject, state) in subjects.list.iter().zip(&mut states) {
            let all = options.executions as f64 * subject.weight / weights;
            let executions = (all * round as f64 / ROUNDS as f64).ceil() as u64;
            run(subject, folder.path(), executions, state, options.keep.as_deref())?;
            if begun.elapsed().as_secs() >= options.seconds {
                break 'rounds;
            }
        }
    }

    println!("| reader | executions | read | panics | panics caught | slowest, s | most memory, MiB |");
    println!("|---|---|---|---|---|---|---|");
    let mut total = 0;
    for (subject, (_, report)) in subjects.list.iter().zip(&states) {
        total += report.executions;
        println!(
            "| {} | {} | {} | {} | {} | {:.2} | {} |",
            subject.name,
            report.executions,
            report.read,
            report.panics_escaped,
            report.panics_caught,
            report.slowest_s,
            report.most_bytes >> 20
        );
    }
    println!("{total} inputs");
    for (subject, (_, report)) in subjects.list.iter().zip(&states) {
        report.broken.iter().for_each(|line| println!("{}: {line}", subject.name));
    }
    let good = states.iter().all(|(_, report)| report.broken.is_empty());
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
