//! Reports of four different runs: what they say is true of their run, and a browser shows all of it at three widths.

#![allow(clippy::unwrap_used, reason = "a helper that fails is a failed test")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::support::{fluorspar, tiny};

/// Width and height of a telephone, a laptop and a large screen, px.
const SCREENS: [[u32; 2]; 3] = [[390, 844], [1280, 800], [2560, 1440]];
/// Smallest type, px.
const SMALLEST_TYPE: f64 = 12.0;
/// Largest page, bytes.
const LARGEST_PAGE: usize = 3_000_000;

/// A leaf, which has chlorophyll and wax and nothing of a mouth.
const LEAF: &str = r#"
format = 1
title = "A leaf under ultraviolet light"
[spectral]
first_nm = 350.0
last_nm = 750.0
step_nm = 10.0
[render]
width_px = 32
height_px = 24
samples_per_pixel = 2
max_depth = 2
[camera]
position_mm = [0.0, 0.0, 150.0]
[lens]
focal_length_mm = 3.0
f_number = 2.0
[view_filter]
filters = ["long_pass_450"]
[sensor]
preset = "lyu_2021_table_1"
columns = 64
rows = 48
pixel_size_um = 37.0
fill_factor = 0.01
[[light]]
name = "violet"
spectrum = "led_365"
filters = ["short_pass_425"]
type = "disc"
position_mm = [40.0, 0.0, 150.0]
aim.look_at_mm = [0.0, 0.0, 0.0]
radius_mm = 5.0
strength.power_mw = 500.0
[[fluorophore]]
name = "chlorophyll_a"
title = "chlorophyll a"
photon_yield = 0.02
source = { csv = "chlorophyll.csv" }
[[fluorophore]]
name = "wax"
title = "leaf wax"
photon_yield = 0.01
source = { csv = "wax.csv" }
[[material]]
name = "blade"
reflectance = 0.08
concentrations = { chlorophyll_a = 1.0, wax = 0.5 }
[[material]]
name = "table"
reflectance = 0.05
[[object]]
name = "leaf"
material = "blade"
type = "quad"
corner_mm = [-30.0, -20.0, 0.0]
edge_u_mm = [60.0, 0.0, 0.0]
edge_v_mm = [0.0, 40.0, 0.0]
[[object]]
name = "table"
material = "table"
type = "quad"
corner_mm = [-300.0, -300.0, -5.0]
edge_u_mm = [600.0, 0.0, 0.0]
edge_v_mm = [0.0, 600.0, 0.0]
[[capture]]
name = "uv"
light_groups = { violet = 1.0 }
exposure_ms = 20.0
[analysis]
frame = "uv"
parts = ["leaf"]
porphyrin = "chlorophyll_a"
bulk = { wax = 0.5 }
"#;

/// Spectra of the leaf: invented, red and blue.
const CHLOROPHYLL: &str = "wavelength_nm,excitation,emission\n340,0.6,0\n430,1,0\n480,0.3,0\n600,0,0\n650,0,0\n685,0,1\n735,0,0.5\n760,0,0\n";
const WAX: &str = "wavelength_nm,excitation,emission\n340,1,0\n400,0.4,0\n430,0.1,0\n440,0,0.1\n480,0,1\n600,0,0\n760,0,0\n";

/// A mouth under another LED than that of its base.
const VIOLET: &str = r#"
format = 1
base = "oraleye-2021"
[[light]]
name = "blue"
spectrum = "led_405"
filters = ["short_pass_450"]
"#;

/// A dyed target before a monochrome camera, without an analysis.
const TARGET: &str = r#"
format = 1
title = "A dyed target before a monochrome camera"
[render]
width_px = 32
height_px = 24
samples_per_pixel = 2
max_depth = 2
[camera]
position_mm = [0.0, 0.0, 100.0]
[lens]
focal_length_mm = 3.0
f_number = 4.0
[sensor]
preset = "monochrome_3_45um"
columns = 64
rows = 48
[view_filter]
filters = ["long_pass_470"]
[[light]]
name = "lamp"
type = "distant"
aim.direction = [0.0, 0.0, -1.0]
spectrum = "led_450"
strength.irradiance_w_per_m2 = 100.0
[[material]]
name = "dyed"
reflectance = 0.5
concentrations = { fad = 0.2 }
[[object]]
name = "target"
material = "dyed"
type = "quad"
corner_mm = [-100.0, -100.0, 0.0]
edge_u_mm = [200.0, 0.0, 0.0]
edge_v_mm = [0.0, 200.0, 0.0]
[[capture]]
name = "glow"
light_groups = { lamp = 1.0 }
exposure_ms = 5.0
"#;

const MOUTH_WORDS: [&str; 8] =
    ["mouth", "teeth", "tooth", "tongue", "mucosa", "patient's", "dentin", "saliva"];

/// The leaf without a question for the share of a fluorophore.
fn plain_leaf() -> String {
    LEAF.replace("porphyrin = \"chlorophyll_a\"\nbulk = { wax = 0.5 }", "porphyrin = \"none\"")
}

/// Runs an experiment and returns the folder.
fn run(folder: &Path, name: &str, text: Option<&str>) -> PathBuf {
    fs::write(folder.join("chlorophyll.csv"), CHLOROPHYLL).unwrap();
    fs::write(folder.join("wax.csv"), WAX).unwrap();
    match text {
        Some(text) => {
            fs::write(folder.join(format!("{name}.toml")), text).unwrap();
            let file = format!("{name}.toml");
            let args = match text.contains("base =") {
                true => tiny(&["run", &file, "--out", name, "-q"]),
                false => vec!["run", &file, "--out", name, "-q"],
            };
            fluorspar(folder, args).well();
        }
        None => drop(fluorspar(folder, tiny(&["run", "--out", name, "-q"])).well()),
    }
    folder.join(name)
}

/// The words of a page, its experiment, styles and data left out.
fn words(page: &str) -> String {
    let mut text = String::new();
    let mut rest = page;
    while let Some(at) = rest.find('<') {
        text.push_str(&rest[..at]);
        rest = &rest[at..];
        let skipped = ["script", "style", "pre"].iter().find(|tag| rest[1..].starts_with(*tag));
        match skipped {
            Some(tag) => {
                let end = format!("</{tag}>");
                rest = rest.split_once(end.as_str()).map_or("", |(_, after)| after);
            }
            None => {
                let (tag, after) = rest.split_once('>').unwrap();
                if let Some((_, alt)) = tag.split_once("alt=\"") {
                    text.push_str(alt.split('"').next().unwrap());
                }
                text.push(' ');
                rest = after;
            }
        }
    }
    (text + rest).replace("&#39;", "'").replace("&quot;", "\"").replace("&amp;", "&")
}

fn holds_no(name: &str, text: &str, forbidden: &[&str]) {
    let lower = text.to_lowercase();
    for word in forbidden {
        if let Some(at) = lower.find(word) {
            let near: String =
                lower.chars().skip(lower[..at].chars().count().saturating_sub(60)).take(140).collect();
            panic!("the report of {name} says \"{word}\": ...{near}...");
        }
    }
}

#[test]
fn reports_say_what_ran_and_fit_every_screen() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    let runs = [
        ("mouth", run(folder, "mouth", None)),
        ("violet", run(folder, "violet", Some(VIOLET))),
        ("leaf", run(folder, "leaf", Some(LEAF))),
        ("target", run(folder, "target", Some(TARGET))),
        ("plain", run(folder, "plain", Some(&plain_leaf()))),
    ];
    let text = |name: &str| {
        let page = fs::read_to_string(folder.join(name).join("report.html")).unwrap();
        assert!(page.len() < LARGEST_PAGE, "{name}: {} bytes", page.len());
        words(&page)
    };
    // What is true of each run is there
    for (name, wanted) in [
        (
            "mouth",
            &[
                "a mouth of",
                "led_385",
                "Porphyrin share",
                "Smallest share seen",
                "Leak",
                "Eye-safe sequences",
                // Light and frame have the same name
                "frame \"blue\", reflected (the leak)",
                "Frame \"blue\": R",
                "of frame \"blue\" clipped",
            ][..],
        ),
        ("violet", &["led_405", "changed", "Porphyrin share"]),
        (
            "leaf",
            &[
                "leaf",
                "led_365",
                "Chlorophyll a",
                "leaf wax",
                "Detection limit",
                "of the chlorophyll a",
                "Clipped pixels",
            ],
        ),
        ("target", &["led_450", "Signal", "mono", "Clipped pixels"]),
    ] {
        let text = text(name);
        for word in wanted {
            assert!(text.contains(word), "the report of {name} does not say \"{word}\"");
        }
    }
    // What is not true of it is not
    holds_no("mouth", &text("mouth"), &["leaf", "led_405", "monochrome"]);
    holds_no("violet", &text("violet"), &["led_385", "385 nm", "382 nm"]);
    holds_no(
        "leaf",
        &text("leaf"),
        &[&MOUTH_WORDS[..], &["porphyrin", "385 nm", "nadh", "collagen"]].concat(),
    );
    // Where no share is asked for there is no word of one
    let shares = ["porphyrin", "mixture line", "blank", "detection limit"];
    holds_no("plain", &text("plain"), &[&MOUTH_WORDS[..], &shares].concat());
    let absent = ["porphyrin", "chromaticity", "mixture line", "385 nm", "nadh", "r / (r"];
    holds_no("target", &text("target"), &[&MOUTH_WORDS[..], &absent].concat());

    let Some(browser) = browser() else {
        eprintln!("skipped the layout: no Chromium; .ci/install_chromium installs it");
        return;
    };
    for (name, folder) in &runs {
        for screen in SCREENS {
            fits(&browser, name, folder, screen);
        }
    }
}

#[test]
fn captures_and_analyses_have_reports_too() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    run(folder, "leaf", Some(LEAF));
    let said = fluorspar(folder, ["capture", "leaf/components.exr", "--report", "--out", "frames"]).well();
    assert!(said.stderr.contains("Open frames/report.html"), "{}", said.stderr);
    let page = fs::read_to_string(folder.join("frames/report.html")).unwrap();
    let told = words(&page);
    assert!(told.contains("Simulated") && told.contains("Chlorophyll a"), "{told}");
    let limits = |told: &str| told.matches("Detection limit of the chlorophyll a share").count();
    assert_eq!(limits(&told), 1, "{told}");
    // What the render knows of the frames stands on the page of a capture as on that of the run
    for part in ["How much excitation light leaks", "The light of the region, by origin"] {
        assert!(told.contains(part), "{part}");
    }
    let results = |name: &str| -> serde_json::Value {
        serde_json::from_str(&fs::read_to_string(folder.join(name).join("results.json")).unwrap()).unwrap()
    };
    let (of_run, of_capture) = (results("leaf"), results("frames"));
    for key in
        ["analysis", "leaks", "leak_ratio", "region_radiance_w_per_sr_m2_nm", "depths_of_light", "safety"]
    {
        assert_eq!(of_run[key], of_capture[key], "{key}");
    }
    assert!(of_run["leak_ratio"].is_f64() && of_run["analysis"].is_object());
    // A drive that the capture doubles is told beside the stated power.
    let doubled = ["capture", "leaf/components.exr", "--report", "--out", "doubled"];
    let drive = ["--set", "capture.uv.light_groups.violet=2"];
    fluorspar(folder, doubled.into_iter().chain(drive)).well();
    let page = words(&fs::read_to_string(folder.join("doubled/report.html")).unwrap());
    for part in [
        "Powers of lights before filters, as stated (\"violet\" 500 mW, driven at 2 times that in frame \"uv\"",
        "nm wide (led_365) at 2 times its stated power",
    ] {
        assert!(page.contains(part), "{part}: {page}");
    }
    // A capture knows its component image: regions by part need no further word.
    let said = fluorspar(folder, ["analyze", "frames", "--out", "analyzed"]).well();
    assert!(said.stdout.contains("leaf") && said.stderr.contains("Open analyzed/report.html"), "{said:?}");
    assert!(folder.join("analyzed/figures/chromaticity.csv").is_file());
    // Further regions: each is what an analysis of it alone is
    let regions =
        ["--named-region", "middle=20,16,20,16", "--named-region", "bench={parts=[\"table\"], inset_px=1}"];
    let said = fluorspar(folder, [&["analyze", "frames", "--out", "regions"][..], &regions].concat()).well();
    assert!(said.stdout.contains("Region \"bench\". Frame \"uv\", table"), "{said:?}");
    let found = &results("regions")["regions"];
    let alone = ["--set=analysis.parts=[]", "--set=analysis.rectangle_px=[20,16,20,16]"];
    let alone = fluorspar(folder, [&["analyze", "frames", "--json"][..], &alone].concat()).json();
    assert_eq!(found[0]["name"], "middle");
    for key in ["counts", "channels", "mixture", "budget", "truth"] {
        assert_eq!(found[0]["analysis"][key], alone[key], "{key}");
    }
    let page = fs::read_to_string(folder.join("regions/report.html")).unwrap();
    let told = words(&page);
    assert!(told.contains("Regions of frame \"uv\"") && page.matches("<span class=\"name\"").count() == 3);
    assert!(told.contains("middle  320 "), "{told}");
    if let Some(browser) = browser() {
        fits(&browser, "regions", &folder.join("regions"), SCREENS[0]);
    }
    for (wrong, why) in [("bench", "there is no ="), ("bench=bank", "bank"), ("a=900,0,9,9", "is not inside")]
    {
        let refused = fluorspar(folder, ["analyze", "frames", "--named-region", wrong]);
        assert!(
            refused.code == Some(2) && refused.stderr.contains(&format!("--named-region {wrong}")),
            "{refused:?}"
        );
        assert!(refused.stderr.contains(why), "{refused:?}");
    }
    // Quiet keeps the answer.
    let quiet = fluorspar(folder, ["analyze", "frames", "-q"]).well();
    assert!(quiet.stdout.contains("pixels") && quiet.stderr.is_empty(), "{quiet:?}");
    // Given frames are not called simulated.
    let given =
        ["analyze", "--frame", "uv=frames/raw_uv.tiff", "--experiment", "leaf.toml", "--out", "given"];
    fluorspar(
        folder,
        [&given[..], &["--set", "analysis.parts=[]", "--set", "analysis.rectangle_px=[20,16,20,16]"]]
            .concat(),
    )
    .well();
    assert_eq!(results("given")["recorded_frames"], serde_json::json!({ "uv": "frames/raw_uv.tiff" }));
    assert!(results("analyzed").get("recorded_frames").is_none());
    let told = words(&fs::read_to_string(folder.join("given/report.html")).unwrap());
    assert!(told.contains("Recorded frames") && !told.contains("imulat"), "{told}");
    assert_eq!(limits(&told), 1, "{told}");
}

#[test]
fn a_monochrome_sensor_needs_no_other_experiment() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    run(folder, "leaf", Some(LEAF));
    let mono = ["--set", "sensor.quantum_efficiency=monochrome_cmos", "--set", "sensor.mosaic=mono"];
    let said = fluorspar(
        folder,
        [&["capture", "leaf/components.exr", "--report", "--out", "mono"][..], &mono].concat(),
    )
    .well();
    assert!(said.stderr.contains("Open mono/report.html"), "{}", said.stderr);
    let told = words(&fs::read_to_string(folder.join("mono/report.html")).unwrap());
    assert!(told.contains("Signals of the region") && told.contains("signal to noise"), "{told}");
    for word in ["R + G + B", "R, G", "chromaticity", "mixture line"] {
        assert!(!told.contains(word), "{word} in the page of a monochrome camera: {told}");
    }
    let said = fluorspar(folder, ["analyze", "mono"]).well();
    assert!(
        said.stdout.contains("Mean signal, frame \"uv\": ")
            && said.stdout.contains("Signal to noise of a pixel"),
        "{said:?}"
    );
}

#[test]
fn spectra_with_mistakes_are_refused_and_leniency_is_written() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    run(folder, "leaf", Some(LEAF));
    let matrix = |cells: [&str; 4]| {
        let [a, b, c, d] = cells;
        format!("# unit: photons\nem_nm\\ex_nm,360,400\n380,{a},{b}\n450,{c},1\n500,0.5,{d}\n")
    };
    let text = |more: &str| {
        LEAF.replace("source = { csv = \"wax.csv\" }", &format!("source = {{ eem_csv = \"m.csv\" }}\n{more}"))
    };
    let check = |cells: [&str; 4], more: &str| {
        fs::write(folder.join("m.csv"), matrix(cells)).unwrap();
        fs::write(folder.join("matrix.toml"), text(more)).unwrap();
        fluorspar(folder, ["check", "matrix.toml"])
    };
    let good = check(["0.1", "0", "0.4", "0.6"], "");
    assert_eq!(good.code, Some(0), "{good:?}");
    for (cells, said, field) in [
        (["0.1", "0", "-40", "0.6"], "below zero", "allow_negative"),
        (["0.1", "0.3", "0.4", "0.6"], "380", "allow_anti_stokes"),
        (["0.1", "0", "", "0.6"], "empty", "empty_cells"),
    ] {
        let refused = check(cells, "");
        assert!(refused.code == Some(2) && refused.stderr.contains(said), "{refused:?}");
        assert!(refused.stderr.contains(field), "{refused:?}");
        let value = if field == "empty_cells" { "\"interpolate\"" } else { "true" };
        let lenient = check(cells, &format!("{field} = {value}"));
        assert_eq!(lenient.code, Some(0), "{lenient:?}");
    }
}

#[test]
fn a_dark_frame_is_told() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    // The light looks away from the leaf.
    let dark = LEAF.replace("aim.look_at_mm = [0.0, 0.0, 0.0]", "aim.look_at_mm = [40.0, 0.0, 300.0]");
    run(folder, "leaf", Some(LEAF));
    fs::write(folder.join("dark.toml"), dark).unwrap();
    let said = fluorspar(folder, ["run", "dark.toml", "--set", "analysis.parts=[]", "--out", "dark"]);
    assert!(said.stderr.contains("hardly any light reaches the camera"), "{said:?}");
    let lit = fluorspar(folder, ["check", "dark.toml"]).well();
    assert!(lit.stdout.contains("The camera sees") && lit.stdout.contains("mm at"), "{}", lit.stdout);
    assert!(lit.stdout.contains("table") && lit.stdout.contains("leaf"), "{}", lit.stdout);
}

/// The browser, if there is one.
pub(super) fn browser() -> Option<PathBuf> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let folders: Vec<PathBuf> = std::env::split_paths(&std::env::var_os("PATH")?).collect();
    names
        .iter()
        .flat_map(|name| folders.iter().map(move |folder| folder.join(name)))
        .find(|path| path.is_file())
}

/// Measures a page, folded and open, and sends what it found to the page around it.
const MEASURE: &str = include_str!("measure_page.html");

/// Checks that a browser shows all of the page of a folder at a width.
pub(super) fn fits(browser: &Path, name: &str, folder: &Path, [width, height]: [u32; 2]) {
    let page = fs::read_to_string(folder.join("report.html")).unwrap();
    // The page's policy forbids a script of the test
    let page = page.replacen("http-equiv=\"Content-Security-Policy\"", "name=\"policy\"", 1);
    let measured = folder.join("measured.html");
    fs::write(&measured, page + MEASURE).unwrap();
    // Browsers make no window as narrow as a telephone; a frame in it may be.
    let host = folder.join("host.html");
    let listen = "addEventListener('message', found => { const pre = document.createElement('pre'); pre.id = 'measured'; \
                  pre.textContent = found.data; document.body.append(pre); });";
    let frame = format!(
        "<body style=\"margin:0\"><script>{listen}</script><iframe src=\"measured.html\" style=\"border:0;width:{width}px;\
         height:{height}px\"></iframe></body>"
    );
    fs::write(&host, frame).unwrap();
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new(browser)
        .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--dump-dom"])
        .arg("--virtual-time-budget=5000")
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--window-size={width},{height}"))
        .arg(format!("file://{}", host.display()))
        .output()
        .unwrap();
    let dom = String::from_utf8(output.stdout).unwrap();
    let found = dom.split_once("id=\"measured\">").and_then(|(_, rest)| rest.split_once("</pre>"));
    let found = found
        .unwrap_or_else(|| panic!("{name}: nothing measured: {}", String::from_utf8_lossy(&output.stderr)))
        .0;
    let json: serde_json::Value =
        serde_json::from_str(&found.replace("&gt;", ">").replace("&amp;", "&").replace("&lt;", "<")).unwrap();
    let place = format!("{name} at {width} px: {found}");
    assert_eq!(json["width"], width, "{place}");
    assert_eq!(json["sideways"], 0, "{place}");
    for list in ["wide", "clipped"] {
        assert_eq!(json[list].as_array().map(Vec::len), Some(0), "{place}");
    }
    let smallest = json["smallest"].as_f64().unwrap();
    assert!(smallest >= SMALLEST_TYPE - 0.05, "{place}");
    if width == 1280 {
        let screens = json["folded"].as_f64().unwrap() / f64::from(height);
        assert!(screens <= 6.0, "{screens} screens: {place}");
        assert!(
            json["overview"].as_f64().unwrap() <= f64::from(height),
            "the overview leaves the screen: {place}"
        );
    }
}
