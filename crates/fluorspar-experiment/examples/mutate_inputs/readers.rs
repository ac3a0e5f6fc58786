//! Readers, and valid files for them.

use std::error::Error;
use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use fluorspar::geometry::TriangleMesh;
use fluorspar::image::{
    BasisComponent, Component, ComponentImage, ComponentRows, ExcitationImage, FeatureMaps, GroupBasis,
    LightPath, Mosaic, SensorImage, SpectralImage,
};
use fluorspar::render::{Checkpoint, FilmRenderer, RenderControl, RenderSettings, Share};
use fluorspar::spectral::{ExcitationNodes, Radiance, WavelengthGrid};
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{
    edit_experiment, parse, parse_cohort, parse_design, parse_layers, parse_sample, parse_script,
    parse_sensor, parse_tissue, resolve,
};
use fluorspar_format as format;
use fluorspar_format::{
    CsvEemOptions, ExrCompression, ExrOptions, RawPacking, SpectrumOptions, SpectrumQuantity, Transfer,
};
use glam::{Vec2, Vec3};

pub(crate) type Outcome<T> = Result<T, Box<dyn Error>>;

pub(crate) type Read = Box<dyn Fn(&Path) -> bool>;

/// A reader and valid files for it.
pub(crate) struct Subject {
    pub(crate) name: &'static str,
    /// Name of the file that is damaged.
    pub(crate) file: &'static str,
    /// File that is read, where the damaged one only belongs to it.
    pub(crate) opened: &'static str,
    pub(crate) seeds: Vec<Vec<u8>>,
    /// Files that belong to it, as they are.
    pub(crate) companions: Vec<(&'static str, Vec<u8>)>,
    /// How many inputs against the others.
    pub(crate) weight: f64,
    pub(crate) read: Read,
}

/// Files of all readers.
pub(crate) struct Subjects {
    folder: PathBuf,
    pub(crate) list: Vec<Subject>,
}

impl Subjects {
    /// All readers. The valid files are made in a folder.
    pub(crate) fn all(folder: &Path) -> Outcome<Self> {
        let mut subjects = Self { folder: folder.to_path_buf(), list: Vec::new() };
        images(&mut subjects)?;
        cubes(&mut subjects)?;
        component_files(&mut subjects)?;
        textures_and_masks(&mut subjects)?;
        frames(&mut subjects)?;
        film(&mut subjects)?;
        journals(&mut subjects)?;
        tables(&mut subjects);
        matlab(&mut subjects)?;
        meshes(&mut subjects)?;
        lenses(&mut subjects);
        experiments(&mut subjects)?;
        catalogues(&mut subjects)?;
        Ok(subjects)
    }

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

/// The folder of fluorspar-experiment, also in the crate that fuzzes these readers.
fn crate_folder() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let beside = here.join("../crates/fluorspar-experiment");
    if beside.is_dir() { beside } else { here.into() }
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

/// Cubes of other programs. The scene of ISETCam is also damaged below its compression.
fn cubes(subjects: &mut Subjects) -> Outcome<()> {
    let data = (0..160).map(|i| i as f32).collect();
    let image = SpectralImage::<Radiance>::from_data(grid()?, 4, 20, data)?;
    let cube =
        format::Cube { light: format::CubeLight::Radiance(image), facts: format::CubeFacts::default() };
    let is_cube = |path: &Path| format::read_cube(path).is_ok();
    let names = ["cube, ENVI header", "cube, ENVI values"];
    subjects.described(
        names,
        ["c.hdr", "c.dat"],
        |path| format::CubeForm::Envi.write(path, &cube),
        is_cube,
    )?;
    let both = subjects.list.len();
    subjects.list[both - 1].opened = "c.hdr";
    let path = subjects.folder.join("c.mat");
    format::CubeForm::Iset.write(&path, &cube)?;
    let packed = fs::read(&path)?;
    let mut plain = packed[..128].to_vec();
    flate2::read::ZlibDecoder::new(&packed[136..]).read_to_end(&mut plain)?;
    subjects.add("cube, ISETCam", "c.mat", vec![plain, packed], is_cube);
    Ok(())
}

/// Component images as captures read them: part by part, in the form of a run and in that of `--storage half`, with an
/// excitation basis.
fn component_files(subjects: &mut Subjects) -> Outcome<()> {
    let (width, height) = (3, 18);
    let components = vec![Component::of_group("blue", LightPath::Reflected)];
    let mut image = ComponentImage::zeros(grid()?, width, height, components);
    image.data.iter_mut().enumerate().for_each(|(i, value)| *value = (i as f32 * 0.37).sin().exp());
    let component = BasisComponent {
        light: LightPath::Reflected,
        spectra: vec![0.1, 0.2],
        factors: (0..width * height).map(|i| i as f32).collect(),
        rank: 1,
        error: 1e-3,
    };
    let excitation = ExcitationImage {
        width,
        height,
        groups: vec![GroupBasis {
            light_group: "blue".into(),
            nodes: ExcitationNodes::new(vec![380.0, 390.0, 400.0])?,
            components: vec![component],
        }],
    };
    for (name, compression) in [
        ("component EXR by part, 24 bits", ExrCompression::Rounded24),
        ("component EXR by part, 16 bits", ExrCompression::Half),
    ] {
        let options = ExrOptions { compression, excitation: Some(&excitation), ..Default::default() };
        let by_part = |file: format::ComponentFile| {
            file.map_rows(|_| true, |_, _, lines| lines.len()).is_ok() && file.excitation_basis().is_ok()
        };
        let write = |path: &Path| format::write_component_exr(path, &image, &options);
        subjects.written(name, "i.exr", write, move |path| {
            format::ComponentFile::open(path).is_ok_and(by_part)
        })?;
    }
    Ok(())
}

/// Textures that are no PNG, and masks.
fn textures_and_masks(subjects: &mut Subjects) -> Outcome<()> {
    let image = SpectralImage::<Radiance>::zeros(grid()?, 3, 2);
    let options = ExrOptions { preview: Some(&[[0.1, 0.2, 0.3]; 6]), ..Default::default() };
    let is_texture = |path: &Path| format::read_texture(path, Transfer::Linear).is_ok();
    let write = |path: &Path| format::write_spectral_exr(path, &image, &options);
    subjects.written("EXR texture", "t.exr", write, is_texture)?;
    let floats = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let color = [b"PF\n2 2\n-1.0\n".to_vec(), floats(&[0.1; 12])].concat();
    let gray = [b"Pf\n2 2\n-1.0\n".to_vec(), floats(&[0.1; 4])].concat();
    subjects.add("PFM texture", "t.pfm", vec![color, gray], is_texture);
    let jpeg = vec![camera_fixture("tiny.jpg")?, camera_fixture("tiny_progressive.jpg")?];
    subjects.add("JPEG texture", "t.jpg", jpeg, is_texture);
    // A run of two, and two as they are; then a difference, a repeat and a place of QOI
    let tga = [
        &[0, 0, 10, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 2, 0, 24, 0x20][..],
        &[0x81, 9, 8, 7, 1, 1, 2, 3, 4, 5, 6],
    ]
    .concat();
    let flat = [&[0, 0, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 2, 0, 8, 0][..], &[1, 2, 3, 4]].concat();
    subjects.add("TGA texture", "t.tga", vec![tga, flat], is_texture);
    let qoi = [
        &b"qoif\0\0\0\x04\0\0\0\x02\x04\0"[..],
        &[254, 10, 20, 30, 0x79, 0xac, 0xc0, 0xc2, 9, 255, 1, 2, 3, 0],
    ]
    .concat();
    subjects.add("QOI texture", "t.qoi", vec![qoi], is_texture);
    let head = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n-Y 1 +X 8\n";
    let packed = [&[2, 2, 0, 8][..], &[0x88, 7, 0x88, 6, 0x88, 5, 4, 1, 2, 3, 4, 0x84, 129]].concat();
    subjects.add("Radiance texture", "t.hdr", vec![[head.as_bytes(), &packed].concat()], is_texture);
    let is_mask = |path: &Path| format::read_mask(path).is_ok();
    for (name, file) in [("mask, PNG", "disc.png"), ("mask, TIFF", "disc.tiff"), ("mask, NPY", "disc.npy")] {
        let seed = camera_fixture(file)?;
        subjects.add(name, file, vec![seed], is_mask);
    }
    Ok(())
}

/// A file that another program wrote for the tests of frames and masks.
fn camera_fixture(name: &str) -> Outcome<Vec<u8>> {
    let folder = crate_folder().join("../fluorspar-format/tests/fixtures/camera");
    Ok(fs::read(folder.join(name)).map_err(|error| format!("{name}: {error}"))?)
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
    subjects.written("DNG", "f.dng", write, read)?;
    let jpeg = vec![camera_fixture("bggr_jpeg.dng")?, camera_fixture("gbrg_predictors.dng")?];
    subjects.add("DNG, lossless JPEG", "f.dng", jpeg, read);
    subjects.add("DNG, deflate", "f.dng", vec![camera_fixture("grbg_deflate.dng")?], read);
    let facts = format::FrameFacts { exposure_s: Some(0.03), ..format::FrameFacts::default() };
    let is_described = move |path: &Path| {
        let tags = format::left_tags(path).is_ok();
        format::describe_frame(path, &facts).is_ok() && tags
    };
    let plain =
        vec![camera_fixture("gray8.tiff")?, camera_fixture("linear_rgb.tiff")?, camera_fixture("disc.png")?];
    subjects.add("frame to describe", "f.tiff", plain, is_described.clone());
    subjects.add("DNG to describe", "f.dng", vec![camera_fixture("bggr_jpeg.dng")?], is_described);
    Ok(())
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

/// The journal of a sweep, as a sweep that goes on opens it and as one that merges reads it.
fn journals(subjects: &mut Subjects) -> Outcome<()> {
    let work = serde_json::json!({ "design_sha256": "ab", "designs": 300, "block": 256 });
    let path = subjects.folder.join("j.journal");
    let (mut journal, _) = format::Journal::open(&path, &work)?;
    for block in 0..3 {
        journal.append(
            &serde_json::json!({ "block": block, "scores": [[0.1, 0.03, 1.0, 1], [null, 1e-3, 0, 2]] }),
        )?;
    }
    drop(journal);
    let seeds = vec![fs::read(&path)?];
    subjects.add("journal", "j.journal", seeds, move |path| {
        let read = format::Journal::read(path, &work).is_ok();
        format::Journal::open(path, &work).is_ok() == read && read
    });
    Ok(())
}

/// Texts of instruments, by form, and what they are read for.
const INSTRUMENTS: [(&str, &str, SpectrumQuantity, &[&str]); 5] = [
    (
        "spectra JCAMP-DX",
        "s.jdx",
        SpectrumQuantity::Fraction,
        &[
            "##TITLE= a\n##XUNITS= NANOMETERS\n##YUNITS= TRANSMITTANCE\n##XFACTOR= 1.0\n##YFACTOR= 0.5\n##XYPOINTS= (XY..XY)\n\
             400.0, 1.0\n410.0, 0.5\n##END=\n",
            "##TITLE= a\n##XUNITS= MICROMETERS\n##YUNITS= REFLECTANCE\n##FIRSTX= 0.4\n##LASTX= 0.43\n##NPOINTS= 4\n##XFACTOR= 1\n\
             ##YFACTOR= 1\n##XYDATA= (X++(Y..Y))\n0.4 0.1 0.2\n0.42 0.3 0.4\n##END=\n",
        ],
    ),
    (
        "spectra TM-27",
        "s.spdx",
        SpectrumQuantity::SpectralPower,
        &[
            "<?xml version=\"1.0\"?>\n<IESTM2714 xmlns=\"iestm2714\" version=\"1.0\"><SpectralDistribution><SpectralQuantity>irradiance\
           </SpectralQuantity><SpectralData wavelength=\"400\">0.25</SpectralData><SpectralData wavelength=\"500\">0.5</SpectralData>\
           </SpectralDistribution></IESTM2714>\n",
        ],
    ),
    (
        "spectra CGATS",
        "s.ti3",
        SpectrumQuantity::Fraction,
        &[
            "CTI3   \n\nORIGINATOR \"a\"\nNUMBER_OF_FIELDS 4\nBEGIN_DATA_FORMAT\nSAMPLE_ID SAMPLE_NAME SPEC_400 SPEC_410\nEND_DATA_FORMAT\n\n\
           NUMBER_OF_SETS 2\nBEGIN_DATA\n1 \"light blue\" 50.0\n25.0\n2 red 1.0 2.5\nEND_DATA\n",
        ],
    ),
    (
        "spectra of instruments",
        "s.txt",
        SpectrumQuantity::Fraction,
        &[
            "No.,Wavelength (nm),Bandwidth (nm),T\n200,400,5,0.5\n201,410,5,0.25\n",
            "Wavelength (nm),T (dB)\n400,-20\n500,-10\n600,0\n",
            "Wellenl\u{e4}nge (nm);Transmission\n400;0,5\n410;0,25\n",
        ],
    ),
    (
        "spectra of bands",
        "s.csv",
        SpectrumQuantity::SpectralPower,
        &["start_nm,end_nm,irradiance\n400,410,2\n410,430,4\n430,440,2\n"],
    ),
];

fn tables(subjects: &mut Subjects) {
    let table = |text: &str| vec![text.as_bytes().to_vec()];
    subjects.add(
        "spectra CSV",
        "s.csv",
        table("# c\nwavelength_nm,a,\"b\"\n400,1,2\n410,1.5e-3,2\n420,3,4\n"),
        |path| format::read_spectra(path, &SpectrumOptions::default()).is_ok(),
    );
    for (name, file, quantity, texts) in INSTRUMENTS {
        let seeds = texts.iter().map(|text| text.as_bytes().to_vec()).collect();
        let options = SpectrumOptions { quantity, ..SpectrumOptions::default() };
        subjects.add(name, file, seeds, move |path| format::read_spectra(path, &options).is_ok());
    }
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
        |path| format::read_fluorophore_csv(path, format::Negative::Refuse, None).is_ok(),
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
    let data = crate_folder().join("../fluorspar-format/tests/data");
    let file = |name: &str| fs::read(data.join(name)).map_err(|error| format!("{name}: {error}"));
    let v5 = vec![file("iset_v5.mat")?, file("iset_v7_struct.mat")?, file("iset_emission_only.mat")?];
    let is_fluorophore = |path: &Path| format::read_iset_fluorophore(path).is_ok();
    let is_spectra = |path: &Path| format::read_spectra(path, &SpectrumOptions::default()).is_ok();
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
    if let Some(scene) = subjects.list.last_mut() {
        scene.companions.push(("none.pbrt", b"# nothing\n".to_vec()));
    }
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
    set = \"p*/transform\"\nvalue = { translate_mm = [1.0, 2.0, 3.0] }\n[[change]]\ndelete = \"object.ball\"\n";

/// Regions, polygons and targets.
const TARGETS: &str = "format = 1\nbase = \"flat-patch\"\n[analysis]\npolygon_px = [[4, 4], [40, 4], [40, 30], [4.5, 30]]\n\
    compared_px = [[8, 8, 4, 4], { polygon_px = [[20, 8], [30, 8], [30, 20]] }]\n[[target]]\nname = \"t\"\nrectangle_px = [8, 8, 4, 4]\n\
    background = [16, 8, 4, 4]\n[[target]]\nname = \"u\"\npolygon_px = [[20, 20], [30, 20], [30, 30]]\n";
const TISSUE: &str = "format = 1\n[[tissue]]\nname = \"fitted\"\nsite = \"dorsal_tongue\"\n[tissue.parameters]\n\
    superficial_blood_fraction = 0.0053\n";
const LAYERS: &str = "format = 1\ntitle = \"two\"\nindex_below = 1.4\n[[layer]]\nname = \"epithelium\"\nthickness_mm = 0.1\n\
    refractive_index = 1.4\nabsorption_per_mm = 0.175\nscattering_per_mm = 5.9\nanisotropy = 0.97\n[layer.emission]\n\
    strength_per_mm = 0.002\nabsorption_per_mm = 0.067\nscattering_per_mm = 3.6\n[[layer]]\nname = \"stroma\"\nthickness_mm = 10000\nrefractive_index = 1.4\n\
    absorption_per_mm = 0.2\nscattering_per_mm = 20\nanisotropy = 0.9\n[layer.emission]\nstrength_per_mm = 0\nabsorption_per_mm = 0.1\nscattering_per_mm = 15\n";

fn text(path: &Path) -> Option<String> {
    format::read_text_bounded(path, 256 << 20).ok()
}

/// Sites of tissue, and folders of entries that stand beside the catalogue: of each kind with a form of its own one entry, in a folder of
/// its own.
fn catalogues(subjects: &mut Subjects) -> Outcome<()> {
    let entries = |kind, names: &[&str]| -> Outcome<Vec<Vec<u8>>> {
        let own = |name: &&str| {
            let text = preset::text(kind, name)?;
            Ok(text.replacen(&format!("name = \"{name}\""), "name = \"mine\"", 1).into())
        };
        names.iter().map(own).collect()
    };
    let sites = entries(PresetKind::Site, &["lip", "tooth"])?;
    subjects.add("site TOML", "site.toml", sites, |path| {
        text(path).is_some_and(|text| preset::site_of_text(&text).is_ok())
    });
    let table = vec![b"wavelength_nm,a\n400,1\n410,1.5e-3\n420,3\n".to_vec()];
    for (name, file, seeds) in [
        ("catalogue, light", "1/lights/mine.toml", entries(PresetKind::Light, &["led_405", "halogen"])?),
        ("catalogue, table", "2/lights/mine.csv", table),
        ("catalogue, filter", "3/filters/mine.toml", entries(PresetKind::Filter, &["notch_405"])?),
        (
            "catalogue, state",
            "4/states/mine.toml",
            entries(PresetKind::State, &["amalgam_tattoo", "inflammation"])?,
        ),
        ("catalogue, sensor", "5/qe/mine.toml", entries(PresetKind::QuantumEfficiency, &["rgb_nir_cmos"])?),
    ] {
        let folder = subjects.folder.join(&file[..1]);
        fs::create_dir_all(subjects.folder.join(file).with_file_name(""))?;
        subjects.add(name, file, seeds, move |_| preset::check_catalogue(&folder).is_ok());
    }
    Ok(())
}

/// Texts as the command line reads them: bounded, then parsed and resolved.
fn experiments(subjects: &mut Subjects) -> Outcome<()> {
    let base = Path::new(".");
    let names = ["flat-patch", "fluorescent-sphere"];
    let seeds = names.map(|name| preset::text(PresetKind::Experiment, name).map(|text| text.into()));
    let seeds = seeds.into_iter().collect::<Result<_, _>>()?;
    subjects.add("experiment TOML", "e.toml", seeds, move |path| {
        text(path).is_some_and(|text| parse(&text, "e", base, &[]).and_then(|e| resolve(&e)).is_ok())
    });
    let seeds = vec![preset::text(PresetKind::Sample, "tongue-385nm")?.into()];
    subjects.add("sample TOML", "s.toml", seeds, move |path| {
        text(path).is_some_and(|text| parse_sample(&text, "s", base, &[]).is_ok())
    });
    let sensors = crate_folder().join("data/sensors");
    let sensor = |name: &str| fs::read(sensors.join(name)).map_err(|error| format!("{name}: {error}"));
    let seeds = vec![sensor("lyu_2021_table_1.toml")?, sensor("rgb_nir_3um.toml")?];
    subjects.add("sensor TOML", "d.toml", seeds, move |path| {
        text(path).is_some_and(|text| parse_sensor(&text, "d", base, &[]).is_ok())
    });
    subjects.add("targets and polygons", "e.toml", vec![TARGETS.into()], move |path| {
        text(path).is_some_and(|text| parse(&text, "e", base, &[]).and_then(|e| resolve(&e)).is_ok())
    });
    let seeds = vec![preset::text(PresetKind::Design, "two-lights")?.into()];
    subjects.add("design TOML", "d.toml", seeds, move |path| {
        text(path).is_some_and(|text| parse_design(&text, "d", base, &[]).is_ok())
    });
    let cohort = crate_folder().join("../../examples/17-cohort.toml");
    let seeds = vec![fs::read(&cohort).map_err(|error| format!("{}: {error}", cohort.display()))?];
    subjects.add("cohort TOML", "p.toml", seeds, move |path| {
        text(path).is_some_and(|text| parse_cohort(&text, "p", base, &[]).is_ok())
    });
    // These resolve spectra, and are read a hundred times slower than the others.
    let count = subjects.list.len();
    subjects.list[count - 6..].iter_mut().for_each(|subject| subject.weight = 0.1);
    subjects.add("tissue TOML", "t.toml", vec![TISSUE.into()], move |path| {
        text(path).is_some_and(|text| parse_tissue(&text, "t", base).is_ok())
    });
    subjects.add("layers TOML", "l.toml", vec![LAYERS.into()], move |path| {
        text(path).is_some_and(|text| parse_layers(&text, "l", base, &[]).is_ok())
    });
    // A damaged script that can be read is replayed on a scene.
    let scene = preset::text(PresetKind::Experiment, "flat-patch")?;
    subjects.add("script of changes", "c.toml", vec![SCRIPT.into()], move |path| {
        let changes = text(path).and_then(|text| parse_script(&text, "c").ok());
        changes.is_some_and(|changes| edit_experiment(scene, "e", base, &changes).is_ok())
    });
    Ok(())
}
