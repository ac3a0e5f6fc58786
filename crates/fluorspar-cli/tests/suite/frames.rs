//! Frames that other programs wrote, from the file to the report.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;

use crate::support::fluorspar;
use fluorspar::image::{Mosaic, SensorImage};

/// A fixture of `fluorspar-format`, copied into a folder.
pub(crate) fn copy(name: &str, folder: &Path) {
    let from =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../fluorspar-format/tests/fixtures/camera").join(name);
    fs::copy(from, folder.join(name)).unwrap();
}

/// One frame under the light of the flat patch, none subtracted.
pub(crate) const VIOLET: &str = r#"
format = 1
base = "flat-patch"
title = "A frame of a camera"

[[capture]]
name = "violet"
light_groups = { blue = 1.0 }
exposure_ms = 40.0

[analysis]
frame = "violet"
"#;

/// Compressed, of another order of colors, with covered pixels, and a mask: an estimate and a page with the outline.
#[test]
fn a_compressed_dng_with_a_mask_is_analyzed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("violet.toml"), VIOLET).unwrap();
    for name in ["bggr_jpeg.dng", "disc.png", "disc.npy", "disc.tiff"] {
        copy(name, folder);
    }
    let given = ["analyze", "--experiment", "violet.toml", "--frame", "violet=bggr_jpeg.dng"];
    let mask = [&given[..], &["--set", "analysis.mask=disc.png"]].concat();
    let told = fluorspar(folder, [&mask[..], &["--out", "report"]].concat()).well();
    assert!(told.stdout.starts_with("Frame \"violet\", the mask disc.png\nPorphyrin: "), "{}", told.stdout);
    for part in ["Porphyrin share on the mixture line", "In the region: 193 pixels"] {
        assert!(told.stdout.contains(part), "{part}: {}", told.stdout);
    }
    let page = fs::read_to_string(folder.join("report/report.html")).unwrap();
    assert!(page.contains("the mask disc.png") && page.contains("<path"), "no outline");
    // The experiment of the page has the mosaic and the black level of the frame, not of its own sensor.
    let embedded = page.replace("&quot;", "\"");
    for line in ["mosaic = [[\"B\", \"G\"], [\"G\", \"R\"]]", "black_level_dn = 63.0"] {
        assert!(embedded.contains(line), "{line}");
    }
    // The other forms of the mask say the same.
    for other in ["disc.npy", "disc.tiff"] {
        let set = format!("analysis.mask={other}");
        let same = fluorspar(folder, [&given[..], &["--set", &set]].concat()).well().stdout;
        assert_eq!(same.replace(other, "disc.png"), told.stdout);
    }
    // A path is looked for where it is typed, wherever the experiment stands
    fs::create_dir(folder.join("cameras")).unwrap();
    fs::copy(folder.join("violet.toml"), folder.join("cameras/violet.toml")).unwrap();
    let elsewhere = ["analyze", "--experiment", "cameras/violet.toml", "--frame", "violet=bggr_jpeg.dng"];
    let same =
        fluorspar(folder, [&elsewhere[..], &["--set", "analysis.mask=disc.png"]].concat()).well().stdout;
    assert_eq!(same, told.stdout);
    // A polygon around the disc's square, compared with the rest of the frame.
    let polygon = "analysis.polygon_px=[[22, 12], [39, 12], [39, 29], [22, 29]]";
    let compared = "analysis.compared_px=[{ mask = \"disc.png\" }, { polygon_px = [[0, 0], [16, 0], [16, 40], [0, 40]] }]";
    let told = fluorspar(folder, [&given[..], &["--set", polygon, "--set", compared]].concat()).well().stdout;
    assert!(told.contains("In the region: 289 pixels") && told.contains("d' of the spots, "), "{told}");
    // A frame without its name is told before what else would not fit
    let unnamed = [
        "analyze",
        "--experiment",
        "oraleye-2021",
        "--frame",
        "bggr_jpeg.dng",
        "--set",
        "analysis.mask=disc.png",
    ];
    let told = fluorspar(folder, unnamed);
    assert!(
        told.code == Some(2) && told.stderr.contains("write the name of a capture and a file"),
        "{}",
        told.stderr
    );
    // What does not fit is told, and nothing is written.
    for (set, expected) in [
        ("analysis.mask=none.png", "there is no such file; paths are relative to where the program runs"),
        ("analysis.mask=bggr_jpeg.dng", "analysis.mask"),
        ("analysis.polygon_px=[[0, 0], [60, 0], [0, 9]]", "outside of the image of 48 columns and 40 rows"),
        ("analysis.rectangle_px=[0, 0, 49, 9]", "48 x 40 pixels"),
    ] {
        let told = fluorspar(folder, [&given[..], &["--set", set, "--out", "wrong"]].concat());
        assert_eq!(told.code, Some(2), "{set}");
        assert!(told.stderr.contains(expected), "{set}: {}", told.stderr);
        assert!(!folder.join("wrong").exists());
    }
}

#[test]
fn a_plain_frame_is_described_and_analyzed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("violet.toml"), VIOLET).unwrap();
    copy("linear_rgb.tiff", folder);
    copy("disc.png", folder);
    let analyze = [
        "analyze",
        "--experiment",
        "violet.toml",
        "--frame",
        "violet=linear_rgb.tiff",
        "--set",
        "analysis.mask=disc.png",
    ];
    let told = fluorspar(folder, analyze);
    assert_eq!(told.code, Some(2));
    assert!(told.stderr.contains("fluorspar describe FRAME"), "{}", told.stderr);
    // Without an exposure nothing is written.
    let told = fluorspar(folder, ["describe", "linear_rgb.tiff", "--capture", "violet"]);
    assert_eq!(told.code, Some(2));
    assert!(told.stderr.contains("give --exposure-ms"), "{}", told.stderr);
    assert!(!folder.join("linear_rgb.tiff.json").exists());
    let describe = ["describe", "linear_rgb.tiff", "--capture", "violet", "--exposure-ms", "40"];
    let told = fluorspar(folder, describe).well();
    assert!(told.stdout.contains("exposure_s") && told.stdout.contains("given"), "{}", told.stdout);
    assert!(told.stdout.contains("assumed: linear numbers that were interpolated"), "{}", told.stdout);
    assert!(folder.join("linear_rgb.tiff.json").is_file());
    let next = "Next (EXPERIMENT being yours; MASK.png is white in the region): fluorspar analyze --experiment EXPERIMENT --frame \
                violet=linear_rgb.tiff --set analysis.mask=MASK.png --out fluorspar-out/linear_rgb\n";
    assert!(told.stderr.contains(next), "{}", told.stderr);
    // A capture of the default experiment is analyzed with what is subtracted from it
    let described = |name: &str| {
        let told = ["describe", "linear_rgb.tiff", "--capture", name, "--exposure-ms", "40", "--replace"];
        fluorspar(folder, told).well().stderr
    };
    let [blue, ambient] = ["blue", "ambient"].map(described);
    let all = "analyze --experiment oraleye-2021 --frame blue=linear_rgb.tiff --frame ambient=AMBIENT_FRAME --set analysis.mask=MASK.png";
    assert!(blue.contains(all), "{blue}");
    assert!(ambient.contains("--frame blue=BLUE_FRAME --frame ambient=linear_rgb.tiff --set"), "{ambient}");
    described("violet");
    let told = fluorspar(folder, analyze).well();
    assert!(told.stdout.contains("In the region: 193 pixels\n  Used: 193 pixels"), "{}", told.stdout);
    // Electrons by a gain that is the sensor's of the experiment are told as such, by one of the frame's own not
    let with_gain = "with the conversion gain of the experiment's sensor";
    assert!(told.stdout.contains(with_gain), "{}", told.stdout);
    fluorspar(folder, [&analyze[..], &["--out", "assumed"]].concat()).well();
    let page = || fs::read_to_string(folder.join("assumed/report.html")).unwrap();
    assert!(page().contains("with the conversion gain of the experiment"));
    let own = [&describe[..], &["--dn-per-electron", "0.4", "--replace"]].concat();
    fluorspar(folder, own).well();
    assert!(!fluorspar(folder, analyze).well().stdout.contains(with_gain));
    fluorspar(folder, [&analyze[..], &["--out", "assumed"]].concat()).well();
    assert!(!page().contains("with the conversion gain of the experiment"));
    // What was described stays.
    let again = fluorspar(folder, describe);
    assert_eq!(again.code, Some(2));
    assert!(again.stderr.contains("described already; --replace"), "{}", again.stderr);
    let deeper = ["--exposure-ms", "20", "--bit-depth", "14", "--replace"];
    let again =
        fluorspar(folder, [&["describe", "linear_rgb.tiff", "--capture", "violet"][..], &deeper].concat());
    assert!(again.well().stdout.contains("0.02 s"));
    // Another depth than the sensor's.
    let told = fluorspar(folder, analyze);
    assert_eq!(told.code, Some(2));
    let cure = "describe linear_rgb.tiff --bit-depth 12 --white-level 4095 --exposure-ms 20 --replace";
    assert!(told.stderr.contains(&format!("`fluorspar {cure}`")), "{}", told.stderr);
    fluorspar(folder, [&analyze[..], &["--set", "sensor.bit_depth=14"]].concat()).well();
    fluorspar(folder, cure.split(' ')).well();
    fluorspar(folder, analyze).well();
    let wrong = fluorspar(folder, ["describe", "violet.toml"]);
    assert_eq!(wrong.code, Some(2));
    assert!(!folder.join("violet.toml.json").exists());
}

/// Frames that change nothing are told, and calibration frames that would spoil all are refused.
#[test]
fn frames_that_do_not_fit_are_told_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("violet.toml"), VIOLET).unwrap();
    fs::write(folder.join("less.toml"), VIOLET.replace("exposure_ms", "subtract = \"blue\"\nexposure_ms"))
        .unwrap();
    copy("bggr_jpeg.dng", folder);
    let raw = fluorspar_format::read_sensor_image(&folder.join("bggr_jpeg.dng")).unwrap().image;
    let raw = SensorImage { black_offsets: Vec::new(), ..raw };
    let write = |name: &str, mosaic: &str, dn: &dyn Fn(usize) -> u16| {
        let data = (0..raw.data.len()).map(dn).collect();
        let frame = SensorImage { data, mosaic: Mosaic::bayer(mosaic).unwrap(), ..raw.clone() };
        fluorspar_format::write_sensor_tiff(&folder.join(name), &frame, None).unwrap();
    };
    write("dark.tiff", "bggr", &|_| 63);
    write("cut.tiff", "bggr", &|value| 3 * (value / 7 % 4) as u16);
    write("lit.tiff", "bggr", &|value| 100 + 500 * raw.channel_of(value) as u16);
    write("full.tiff", "bggr", &|_| 4000);
    write("flat.tiff", "rggb", &|_| 2000);
    let rectangle = ["--set", "analysis.rectangle_px=[8, 8, 30, 20]"];
    for (experiment, given, code, words) in [
        ("violet.toml", ["--dark", "dark.tiff"], 0, ""),
        (
            "violet.toml",
            ["--dark", "cut.tiff"],
            0,
            "cut.tiff: 25 % of its values are 0, which cuts its noise",
        ),
        ("violet.toml", ["--dark", "lit.tiff"], 2, "differ by far more than noise, R "),
        ("violet.toml", ["--dark", "full.tiff"], 2, "pixels of the dark frame \"bggr_jpeg\" are saturated"),
        ("violet.toml", ["--flat", "flat.tiff"], 2, "or another color filter array than frame \"violet\""),
        ("violet.toml", ["--frame", "blue=dark.tiff"], 0, "The frame \"blue\" has no part in the analysis"),
        ("less.toml", ["--frame", "blue=full.tiff"], 2, "which is subtracted, is itself saturated in 100 %"),
    ] {
        let frame = ["analyze", "--experiment", experiment, "--frame", "violet=bggr_jpeg.dng"];
        let said = fluorspar(folder, [&frame[..], &given, &rectangle].concat());
        assert!(said.code == Some(code) && said.stderr.contains(words), "{given:?}: {said:?}");
    }
    fluorspar(folder, ["describe", "bggr_jpeg.dng", "--black-level", "-20"]).well();
    let below = ["analyze", "--experiment", "violet.toml", "--frame", "violet=bggr_jpeg.dng"];
    let said = fluorspar(folder, [&below[..], &rectangle].concat());
    assert!(said.code == Some(2) && said.stderr.contains("-20 DN, is below zero"), "{said:?}");
}

/// A monochrome sensor behind a filter wheel.
const WHEEL: &str = r#"
format = 1
base = "flat-patch"
title = "A monochrome camera with a filter wheel"

[sensor]
preset = "monochrome_4_8um"

[[capture]]
name = "wheel_505"
light_groups = { blue = 1.0 }
filters = ["band_pass_505_20"]

[[capture]]
name = "wheel_550"
light_groups = { blue = 1.0 }
filters = ["band_pass_550_20"]

[[capture]]
name = "wheel_632"
light_groups = { blue = 1.0 }
filters = ["band_pass_632_22"]

[[capture]]
name = "blue"
remove = true

[analysis]
frame = "wheel_632"
"#;

/// Levels, ratios, and the share of the porphyrin beside the truth, on the terminal and in the page, which has no words of colors.
#[test]
fn a_filter_wheel_is_run_analyzed_and_reported() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("wheel.toml"), WHEEL).unwrap();
    let small = ["--set", "sensor.columns=160", "--set", "sensor.rows=120"];
    fluorspar(folder, [&["run", "wheel.toml", "--out", "wheel"][..], &small].concat()).well();
    let told = fluorspar(folder, ["analyze", "wheel"]).well().stdout;
    assert!(told.contains("frame \"wheel_550\": ") && told.contains(" over wheel_"), "{told}");
    let json = fluorspar(folder, ["analyze", "wheel", "--json"]).well().json();
    let terms = json["signals"]["unmixing"]["terms"].as_array().unwrap();
    let porphyrin = terms.last().unwrap();
    assert_eq!(porphyrin["fluorophores"][0], "protoporphyrin_ix");
    let number = |key: &str| porphyrin[key].as_f64().unwrap();
    // A flat patch under direct light is what the responses are predicted for; the render has 16 samples a pixel.
    assert!((number("share") - number("true_share")).abs() < 0.01, "{porphyrin}");
    assert!(number("true_share") > 0.05, "{porphyrin}");
    // The same light with but one fluorophore as the bulk: the truth counts the others as bulk, as the fit does
    let one = ["analyze", "wheel", "--set", "analysis.bulk={ elastin = 1.0 }"];
    let told = fluorspar(folder, one).well().stdout;
    assert!(told.contains("Light of other parts: 28.0 %"), "{told}");
    let json = fluorspar(folder, [&one[..], &["--json"]].concat()).well().json();
    let unmixing = &json["signals"]["unmixing"];
    let known = unmixing["terms"][1]["true_share"].as_f64().unwrap();
    // Sums of electrons in single precision
    assert!((known - number("true_share")).abs() < 1e-6, "{unmixing} {porphyrin}");
    let all: f64 = (0..2).map(|term| unmixing["terms"][term]["true_share"].as_f64().unwrap()).sum();
    assert!((all - 1.0).abs() < 1e-9 && unmixing["true_share_of_others"]["share"].as_f64().unwrap() > 0.1);
    let page = fs::read_to_string(folder.join("wheel/report.html")).unwrap();
    let (head, words) = page.split_once("<body").unwrap();
    assert!(head.len() > 100 && words.contains("Fluorophores in the signals"));
    for word in ["R + G + B", "R, G and B", "hromaticity", "mixture line"] {
        assert!(!words.contains(word), "{word} in the page of a monochrome camera");
    }
}

/// A disc that glows a third more than the patch that it lies on.
const DOT: &str = r#"
format = 1
base = "flat-patch"
title = "A dot on a patch"

[[material]]
name = "dot"
reflectance = "tongue_dorsum"
concentrations = { fad = 0.26, collagen = 0.26, elastin = 1.3, keratin = 0.26, protoporphyrin_ix = 0.13 }

[[object]]
name = "dot"
material = "dot"
type = "disc"
center_mm = [2.0, 1.0, 0.1]
normal = [0.0, 0.0, 1.0]
radius_mm = 4.0

[[target]]
name = "spot"
parts = ["dot"]
"#;

#[test]
fn a_target_is_measured_with_its_labels() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("dot.toml"), DOT).unwrap();
    fluorspar(folder, ["run", "dot.toml", "--out", "dot"]).well();
    let results: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(folder.join("dot/results.json")).unwrap()).unwrap();
    let target = &results["analysis"]["targets"][0];
    let number = |key: &str| target[key].as_f64().unwrap();
    assert_eq!((target["target"].as_str(), target["number"].as_u64()), (Some("spot"), Some(1)));
    // Every fluorophore glows 1.3 times as much; a pixel of the render is 0.4 mm wide, so the rim is half background.
    let green = target["channels"][1]["contrast"].as_f64().unwrap();
    assert!((green - 0.3).abs() < 0.03, "{target}");
    // 4 mm of radius where 320 pixels of 2.5 um see 0.8 mm (1/3 - 1/100) * 100 = 25.9 mm: 48.6 pixels, known to one of the render.
    let mm_per_px = number("smallest_diameter_mm") / number("smallest_diameter_px");
    assert!((mm_per_px / (0.8 * 97.0 / 3.0 / 320.0) - 1.0).abs() < 0.01, "{mm_per_px}");
    let pixels = std::f64::consts::PI * (4.0 / mm_per_px).powi(2);
    assert!((number("pixels") / pixels - 1.0).abs() < 0.12, "{} of {pixels}", number("pixels"));
    assert!(number("d_prime") > 10.0 * number("d_prime_pixel"), "{target}");
    assert_eq!(target["frames_needed"].as_u64(), Some(1));
    // The labels are those pixels.
    let mask = fluorspar_format::read_mask(&folder.join("dot/targets.png")).unwrap();
    let labeled = mask.inside.iter().filter(|&&inside| inside).count();
    assert!(labeled as f64 >= number("pixels") && mask.width == 320, "{labeled}");
    let page = fs::read_to_string(folder.join("dot/report.html")).unwrap();
    assert!(
        page.contains("Smallest visible diameter") && page.contains("d&#39; of") || page.contains("d' of")
    );
    let told = fluorspar(folder, ["analyze", "dot", "--set", "analysis.wanted_d_prime=90"]).well().stdout;
    assert!(
        told.contains("d' of target \"spot\", frame \"blue\": ") && told.contains(" for d' 90"),
        "{told}"
    );
    // A mask of a real frame is a target, too; a part can't be found there.
    let given = [
        "analyze",
        "--experiment",
        "dot.toml",
        "--frame",
        "blue=dot/raw_blue.tiff",
        "--frame",
        "ambient=dot/raw_ambient.tiff",
    ];
    let told = fluorspar(folder, [&given[..], &["--set", "analysis.rectangle_px=[0, 0, 320, 240]"]].concat())
        .well()
        .stdout;
    assert!(told.contains("only a component image tells where it lies"), "{told}");
    let there = [
        "--set",
        "analysis.rectangle_px=[0, 0, 320, 240]",
        "--set",
        "target.spot.parts=[]",
        "--set",
        "target.spot.mask=dot/targets.png",
    ];
    let named = ["--named-region", "left=0,0,100,200", "--out", "given"];
    let told = fluorspar(folder, [&given[..], &there, &named].concat()).well().stdout;
    assert!(told.contains("d' of target \"spot\", frame \"blue\": "), "{told}");
    // Of recorded frames the interval holds the noise alone, and their dark frame may have had the lamp of the room
    let page = fs::read_to_string(folder.join("given/report.html")).unwrap();
    assert!(
        page.contains("share, % (95 % by sensor noise alone)") && !page.contains("share, % (95 % in all")
    );
    assert!(
        page.contains("none of the experiment&#39;s lights")
            || page.contains("none of the experiment's lights")
    );
    assert!(!page.contains("&quot;ambient&quot;: no light"));
}
