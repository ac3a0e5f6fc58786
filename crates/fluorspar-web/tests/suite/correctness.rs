//! What the workbench shows is what the commands write.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::{Duration, Instant};

use fluorspar::findings::region_findings;
use fluorspar::pipeline::{frame_radiance, radiance_preview};
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{parse, resolve};
use fluorspar_format::read_component_image;
use fluorspar_report::finding_lines;
use fluorspar_session::{
    AnalyzeOptions, Analyzed, CaptureOptions, ExperimentArgs, RunOptions, TaskOptions, analyze, capture, run,
};
use fluorspar_web::{Workbench, WorkbenchOptions};
use serde_json::{Value, json};

use crate::support::{Answer, Served, any_led_folder, job, run_folder};

/// Width, height and pixels of a PNG.
fn decoded(bytes: &[u8]) -> (u32, u32, Vec<u8>) {
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    (info.width, info.height, pixels)
}

/// What is told beside a picture, and the picture.
fn picture(served: &Served, body: &Value) -> (Value, (u32, u32, Vec<u8>)) {
    let Answer { status, body: bytes, .. } = served.post("/api/picture", body);
    assert_eq!(status, 200, "{}", String::from_utf8_lossy(&bytes));
    let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
    (serde_json::from_slice(&bytes[4..4 + length]).unwrap(), decoded(&bytes[4 + length..]))
}

/// The frames that `capture` writes of a run and the saved experiment of some changes.
fn captured(served: &Served, run: &Path, set: &[&str], folder: &Path) -> PathBuf {
    let toml = served.post("/api/toml", &json!({ "set": set })).json();
    let file = folder.join("saved.toml");
    std::fs::write(&file, toml["toml"].as_str().unwrap()).unwrap();
    let out = folder.join("frames");
    let mut options = options::<CaptureOptions>(json!({ "image": run.join("components.exr") }));
    (options.experiment, options.out) = (Some(file.display().to_string()), out.clone());
    capture(&options, &job()).unwrap();
    out
}

fn options<O: TaskOptions>(given: Value) -> O {
    serde_json::from_value(given).unwrap()
}

/// Captures and fluorophores of the run.
fn names(served: &Served) -> (Vec<String>, Vec<String>) {
    let subject = served.get("/api/subject").json();
    let texts = |list: &Value| -> Vec<String> {
        list.as_array().unwrap().iter().map(|text| text.as_str().unwrap().to_owned()).collect()
    };
    let paths =
        subject["groups"].as_array().unwrap().iter().flat_map(|group| group["controls"].as_array().unwrap());
    let paths = paths.filter_map(|control| control["path"].as_str()?.strip_prefix("concentration."));
    (texts(&subject["captures"]), paths.map(String::from).collect())
}

#[test]
fn pictures_are_those_of_capture() {
    let served = Served::on_run();
    let (captures, fluorophores) = names(&served);
    assert!(captures.len() > 1 && !fluorophores.is_empty(), "{captures:?} {fluorophores:?}");
    let dye = format!("concentration.{}=2.5", fluorophores[0]);
    let changes: Vec<Vec<&str>> = vec![
        vec![],
        vec!["capture.blue.exposure_ms=11", "capture.blue.gain=2"],
        vec![&dye],
        vec!["view_filter.filters=[\"long_pass_500\"]"],
        vec!["capture.blue.light_groups.blue=0.4", &dye, "capture.ambient.exposure_ms=3"],
        vec!["sensor.bit_depth=10", "view_filter.filters=[]"],
    ];
    for set in changes {
        let folder = tempfile::tempdir().unwrap();
        let frames = captured(&served, &run_folder(), &set, folder.path());
        for name in &captures {
            let body = json!({ "set": set, "capture": name, "view": "developed" });
            let (facts, shown) = picture(&served, &body);
            let written = decoded(&std::fs::read(frames.join(format!("preview_{name}.png"))).unwrap());
            assert!(shown == written, "{set:?} {name}");
            // A white that is held is the one that was told
            let held = json!({ "set": set, "capture": name, "view": "developed", "white": facts["white"] });
            assert!(picture(&served, &held).1 == shown, "{set:?} {name}");
            let coarse = json!({ "set": set, "capture": name, "view": "developed", "is_coarse": true });
            let (_, (width, height, _)) = picture(&served, &coarse);
            assert_eq!([width, height], [shown.0 / 2, shown.1 / 2], "{set:?} {name}");
        }
    }
    // A line has no half
    let line = json!({ "set": ["sensor.columns=1700", "sensor.rows=2"], "capture": "blue", "view": "developed", "is_coarse": true });
    assert_eq!(picture(&served, &line).1.1, 1);
}

#[test]
fn another_led_is_that_of_capture() {
    let served = Served::on(&any_led_folder());
    let subject = served.get("/api/subject").json();
    let controls =
        subject["groups"].as_array().unwrap().iter().flat_map(|group| group["controls"].as_array().unwrap());
    let led = controls.into_iter().find(|control| control["template"].is_string()).unwrap();
    assert_eq!(led["range"], json!([360.0, 480.0]));
    let of_peak = |nm: &str| {
        let value = led["template"].as_str().unwrap().replace('$', nm);
        format!("{}={value}", led["path"].as_str().unwrap())
    };
    for (peak, more) in
        [("405.0", "capture.blue.gain=2"), ("430.0", "view_filter.filters=[\"long_pass_500\"]")]
    {
        let (folder, peak) = (tempfile::tempdir().unwrap(), of_peak(peak));
        let set = [peak.as_str(), more];
        let frames = captured(&served, &any_led_folder(), &set, folder.path());
        let (facts, shown) = picture(&served, &json!({ "set": set, "capture": "blue", "view": "developed" }));
        assert!(shown == decoded(&std::fs::read(frames.join("preview_blue.png")).unwrap()), "{set:?}");
        assert!(facts["remarks"][0].as_str().unwrap().starts_with("Light of \"blue\" changed"), "{facts}");
    }
}

#[test]
fn raw_and_clipped_pixels_are_shown() {
    let served = Served::on_run();
    let bright = json!({ "set": ["capture.blue.exposure_ms=900.0"], "capture": "blue", "view": "clip" });
    let (facts, (_, _, pixels)) = picture(&served, &bright);
    let striped =
        pixels.chunks(3).filter(|rgb| [[255, 70, 200], [20, 0, 20]].contains(&[rgb[0], rgb[1], rgb[2]]));
    let share = 100.0 * striped.count() as f64 / (pixels.len() / 3) as f64;
    let told = facts["clipped_percent"].as_f64().unwrap();
    assert!(told > 1.0 && (share - told).abs() < 1e-9, "{share} {told}");
    let (_, (width, height, raw)) = picture(&served, &json!({ "capture": "blue", "view": "raw" }));
    assert_eq!([width, height], [64, 48]);
    let (facts, (_, _, noise)) = picture(&served, &json!({ "capture": "blue", "view": "noise" }));
    assert!(facts["legend"]["ends"][1].as_str().unwrap().parse::<f64>().unwrap() > 3.0, "{facts}");
    assert!(noise.chunks(3).any(|rgb| rgb != &noise[..3]));
    assert!(raw.chunks(3).all(|rgb| rgb[0] == rgb[1] && rgb[1] == rgb[2]));
}

#[test]
fn an_eye_sees_the_radiance_before_the_filter() {
    let served = Served::on_run();
    let image = read_component_image(&run_folder().join("components.exr")).unwrap().image;
    let text = std::fs::read_to_string(run_folder().join("experiment.toml")).unwrap();
    let study = resolve(&parse(&text, "run", &run_folder(), &[]).unwrap()).unwrap().study;
    let seen = radiance_preview(&frame_radiance(&study.capture("blue").unwrap().frame, &image));
    let (_, (width, _, pixels)) = picture(&served, &json!({ "capture": "blue", "view": "eye" }));
    for (place, rgb) in pixels.chunks(3).enumerate() {
        let (row, column) = (place / width as usize / 2, place % width as usize / 2);
        let pixel = row * seen.width + column;
        assert_eq!(rgb, &seen.rgb[3 * pixel..3 * pixel + 3], "{row} {column}");
    }
}

#[test]
fn the_parts_of_a_spectrum_sum_to_the_radiance() {
    let served = Served::on_run();
    let image = read_component_image(&run_folder().join("components.exr")).unwrap().image;
    let text = std::fs::read_to_string(run_folder().join("experiment.toml")).unwrap();
    let study = resolve(&parse(&text, "run", &run_folder(), &[]).unwrap()).unwrap().study;
    let radiance = frame_radiance(&study.capture("blue").unwrap().frame, &image);
    // A pixel of the sensor of 64 x 48 lies on half a pixel of the render of 32 x 24
    for [column, row] in [[31, 23], [10, 40], [63, 0]] {
        let body = json!({ "capture": "blue", "frame_px": [64, 48], "place": { "rectangle_px": [column, row, 1, 1] } });
        let spectra = served.post("/api/region", &body).json()["spectra"].clone();
        let numbers = |list: &Value| -> Vec<f64> {
            list.as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
        };
        let total = numbers(&spectra["total"]);
        let parts: Vec<Vec<f64>> =
            spectra["parts"].as_array().unwrap().iter().map(|part| numbers(&part[1])).collect();
        assert!(parts.len() > 1, "{spectra}");
        let expected = radiance.pixel(row / 2, column / 2);
        let brightest = total.iter().copied().fold(0.0, f64::max);
        for (band, sum) in total.iter().enumerate() {
            let of_parts: f64 = parts.iter().map(|part| part[band]).sum();
            assert!((of_parts - sum).abs() <= 1e-6 * brightest, "{band}: {of_parts} {sum}");
            assert!(
                (f64::from(expected[band]) - sum).abs() <= 1e-6 * brightest,
                "{band}: {} {sum}",
                expected[band]
            );
        }
    }
}

#[test]
fn estimates_are_those_of_analyze() {
    let served = Served::on_run();
    let set = ["capture.blue.exposure_ms=21"];
    let folder = tempfile::tempdir().unwrap();
    let frames = captured(&served, &run_folder(), &set, folder.path());
    let polygon = json!([[10.0, 10.0], [50.5, 12.0], [40.0, 40.0]]);
    for (place, named) in [
        (Value::Null, None),
        (json!({ "rectangle_px": [8, 8, 40, 30], "part": "" }), Some("drawn=8,8,40,30".to_owned())),
        (json!({ "polygon_px": polygon, "part": "" }), Some(format!("drawn={polygon}"))),
    ] {
        let asked = json!({ "set": set, "capture": "blue", "frame_px": [64, 48], "place": place });
        let told = served.post("/api/region", &asked).json();
        let mut options = AnalyzeOptions { folder: Some(frames.clone()), ..Default::default() };
        options.named_region = named.into_iter().collect();
        let Analyzed::Frames(analyzed) = analyze(&options, &job()).unwrap() else {
            panic!("many photographs")
        };
        let analysis = match analyzed.regions.first() {
            Some(region) => &region.analyzed.as_ref().unwrap().analysis,
            None => &analyzed.analysis,
        };
        let lines = finding_lines(&region_findings(analysis), &analysis.analyte, false);
        assert_eq!(told["lines"], json!(lines), "{place}: {told}");
        assert!(lines.len() > 2, "{lines:?}");
    }
}

#[test]
fn a_report_is_that_of_capture() {
    let served = Served::on_run();
    assert_eq!(served.get("/report.html").status, 404);
    let place = json!({ "rectangle_px": [8, 8, 40, 30], "part": "" });
    let set = ["capture.blue.exposure_ms=21"];
    let folder = tempfile::tempdir().unwrap();
    let toml = served.post("/api/toml", &json!({ "set": set, "place": place })).json();
    let file = folder.path().join("saved.toml");
    std::fs::write(&file, toml["toml"].as_str().unwrap()).unwrap();
    let mut options =
        options::<CaptureOptions>(json!({ "image": run_folder().join("components.exr"), "report": true }));
    (options.experiment, options.out) = (Some(file.display().to_string()), folder.path().join("out"));
    capture(&options, &job()).unwrap();
    let written = std::fs::read_to_string(options.out.join("report.html")).unwrap();
    let made = served.post("/api/report", &json!({ "set": set, "place": place }));
    assert_eq!(made.status, 204, "{}", made.text());
    let page = served.get("/report.html");
    let policy = page.header("content-security-policy").unwrap();
    assert!(policy.contains("default-src 'none'") && policy.contains("script-src 'sha256-"), "{policy}");
    // But for links to files beside it, and the name of the experiment
    let without_links = |page: &str| -> Vec<String> {
        let mut rest = page.replace(" As recorded:", "");
        for [begin, end] in [[" <span class=\"files\">Files:", "</span>"], [" <a href=\"", "</a>"]] {
            while let Some(start) = rest.find(begin) {
                let length = rest[start..].find(end).unwrap() + end.len();
                rest.replace_range(start..start + length, "");
            }
        }
        rest.lines().filter(|line| !line.contains("saved.toml")).map(String::from).collect()
    };
    let (shown, written) = (without_links(&page.text()), without_links(&written));
    for (shown, written) in shown.iter().zip(&written) {
        assert_eq!(shown, written);
    }
    assert!(shown.len() == written.len() && shown.len() > 100, "{} {}", shown.len(), written.len());
}

#[test]
fn findings_are_told_by_section() {
    let served = Served::on_run();
    let titles = |with_spectra: bool| -> Vec<String> {
        let told = served.post("/api/findings", &json!({ "with_spectra": with_spectra })).json();
        let sections = told["sections"].as_array().unwrap();
        assert!(sections.iter().all(|section| !section["html"].as_str().unwrap().is_empty()));
        sections.iter().map(|section| section["title"].as_str().unwrap().to_owned()).collect()
    };
    let (quick, whole) = (titles(false), titles(true));
    let has = |titles: &[String], word: &str| titles.iter().any(|title| title.contains(word));
    assert!(has(&quick, "In short") && has(&quick, "Safety") && has(&quick, "says"), "{quick:?}");
    assert!(!has(&quick, "by origin") && has(&whole, "by origin"), "{whole:?}");
}

#[test]
fn a_picked_part_is_a_region() {
    let served = Served::on_run();
    let asked = json!({ "frame_px": [64, 48], "at_px": [32, 24] });
    let part = served.post("/api/part", &asked).json()["part"].as_str().unwrap().to_owned();
    let body = json!({ "capture": "blue", "frame_px": [64, 48], "place": { "part": part } });
    let told = served.post("/api/region", &body).json();
    assert_eq!(told["part"], json!(part), "{told}");
    assert!(told["lines"].as_array().unwrap().len() > 2, "{told}");
    let outside = served.post("/api/part", &json!({ "frame_px": [64, 48], "at_px": [64, 0] }));
    assert_eq!(outside.status, 422, "{}", outside.text());
}

#[test]
fn shapes_are_seen_from_any_side_and_named() {
    let served = Served::on_run();
    let asked = |view: &str, yaw_deg: f64| json!({ "view": view, "yaw_deg": yaw_deg, "pitch_deg": 0.0, "zoom": 1.0, "width_px": 64, "at": [0.5, 0.5] });
    let seen = |view: &str, yaw_deg: f64| {
        let bytes = served.post("/api/orbit", &asked(view, yaw_deg)).body;
        let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
        let facts: Value = serde_json::from_slice(&bytes[4..4 + length]).unwrap();
        (facts, decoded(&bytes[4 + length..]))
    };
    let (facts, front) = seen("clay", 0.0);
    assert_eq!((front.0, front.1), (64, 48));
    let part = served.post("/api/part", &json!({ "frame_px": [64, 48], "at_px": [32, 24] })).json();
    assert_eq!(facts["picked"]["part"], part["part"]);
    assert!(facts["picked"]["distance_mm"].as_f64().unwrap() > 1.0, "{facts}");
    assert!(seen("clay", 40.0).1 != front && seen("part", 0.0).1 != front && seen("depth", 0.0).1 != front);
    assert!(seen("depth", 0.0).0["legend"]["ends"][0].as_str().unwrap().ends_with(" mm"));
    for (field, value) in
        [("view", json!("raw")), ("pitch_deg", json!(91)), ("zoom", json!(0)), ("width_px", json!(9999))]
    {
        let mut bad = asked("clay", 0.0);
        bad[field] = value;
        assert_eq!(served.post("/api/orbit", &bad).status, 422, "{field}");
    }
}

#[test]
fn what_needs_a_render_is_refused_in_words() {
    let served = Served::on_run();
    for (set, word) in [
        ("render.width_px=64", "render"),
        ("light.blue.spectrum=led_405", "render.excitation_basis_nm"),
        ("capture.blue.exposure=3", "exposure_ms"),
        ("capture.blue.gain=-1", "gain"),
    ] {
        let refused =
            served.post("/api/picture", &json!({ "set": [set], "capture": "blue", "view": "developed" }));
        let text = refused.text();
        assert!(refused.status == 422 && text.contains(word) && !text.contains('⟨'), "{set}: {text}");
        let needs_render = ["render", "render.excitation_basis_nm"].contains(&word);
        assert!(text.contains(&format!("\"needs_render\":{needs_render}")), "{set}: {text}");
    }
    let refused = served.post("/api/picture", &json!({ "capture": "green", "view": "developed" }));
    assert!(refused.status == 422 && refused.text().contains("ambient, blue"), "{}", refused.text());
}

#[test]
fn every_control_changes_what_it_says() {
    let served = Served::on_run();
    let subject = served.get("/api/subject").json();
    let mut kinds: BTreeMap<String, usize> = BTreeMap::new();
    for control in
        subject["groups"].as_array().unwrap().iter().flat_map(|group| group["controls"].as_array().unwrap())
    {
        let path = control["path"].as_str().unwrap();
        let value = match control["kind"].as_str().unwrap() {
            "number" => format!("{:?}", control["range"][0].as_f64().unwrap()),
            _ => control["options"].as_array().unwrap().last().unwrap()["value"].as_str().unwrap().to_owned(),
        };
        let change = format!("{path}={value}");
        let answer = served.post("/api/toml", &json!({ "set": [change] }));
        assert_eq!(answer.status, 200, "{change}: {}", answer.text());
        *kinds.entry(control["kind"].as_str().unwrap().into()).or_default() += 1;
    }
    assert!(kinds["number"] > 6 && kinds["choice"] == 2, "{kinds:?}");
}

#[test]
fn an_experiment_is_rendered_first() {
    let mut options = WorkbenchOptions { subject: Some("flat-patch".into()), spp: 1, ..Default::default() };
    options.changes.set =
        ["render.width_px=16", "render.height_px=12", "sensor.columns=32", "sensor.rows=24"]
            .map(String::from)
            .to_vec();
    let served = Served::of(&options);
    assert_eq!(ready(&served)["render_px"], json!([16, 12]));
    // Fewer samples are the page's, not the experiment's
    let toml = served.post("/api/toml", &json!({ "set": ["capture.blue.gain=2"] })).json();
    let read = |text: &str| fluorspar_format::read_toml::<Value>(text).unwrap();
    let saved = read(toml["toml"].as_str().unwrap());
    let plain = read(preset::text(PresetKind::Experiment, "flat-patch").unwrap());
    assert_eq!(saved["render"]["samples_per_pixel"], plain["render"]["samples_per_pixel"]);
    assert_eq!(saved["render"]["width_px"], json!(16));
    let (facts, _) = picture(&served, &json!({ "capture": "blue", "view": "developed" }));
    assert_eq!(facts["frame_px"], json!([32, 24]));
}

#[test]
fn an_experiment_is_shown_coarse_before_it_is_rendered_as_a_whole() {
    let mut options = WorkbenchOptions { subject: Some("flat-patch".into()), spp: 1, ..Default::default() };
    options.changes.set = ["render.width_px=200", "render.height_px=150"].map(String::from).to_vec();
    let served = Served::of(&options);
    ready(&served);
    let asked = json!({ "capture": "blue", "view": "developed", "set": [] });
    let coarse = picture(&served, &asked).0;
    assert_eq!((&coarse["is_coarse"], &coarse["render_px"]), (&json!(true), &json!([50, 37])));
    let rendered = |set: &[&str]| {
        let mut told = rendering(&served, set, None);
        while told["is_over"] != true {
            told = rendering(&served, set, told["level"].as_u64());
        }
        assert_eq!(told["error"], Value::Null, "{told}");
        told["level"].clone()
    };
    assert_eq!(rendered(&[]), 2, "the coarsest one was there");
    let whole = picture(&served, &asked);
    assert_eq!((&whole.0["is_coarse"], &whole.0["render_px"]), (&json!(false), &json!([200, 150])));
    for seed in ["render.seed=8", "render.seed=9", "render.seed=10"] {
        rendered(&[seed]);
    }
    assert!(picture(&served, &asked).1 == whole.1, "what was rendered first is not there any more");
}

/// What a workbench tells of its subject once that is rendered.
pub(crate) fn ready(served: &Served) -> Value {
    for _ in 0..600 {
        let subject = served.get("/api/subject").json();
        if subject["stage"] == "ready" || subject["stage"] == "designs" {
            return subject;
        }
        assert_eq!(subject["stage"], "rendering", "{subject}");
        sleep(Duration::from_millis(50));
    }
    panic!("the render did not end");
}

/// How far a render of changes is, once there are more pictures than `seen` or a moment later.
fn rendering(served: &Served, set: &[&str], seen: Option<u64>) -> Value {
    served.post("/api/render", &json!({ "set": set, "seen": seen })).json()
}

#[test]
fn what_needs_a_render_is_rendered_coarse_first_and_ends_as_that_of_run() {
    let served = Served::on_run();
    let bad = served.post("/api/render", &json!({ "set": ["object.none.material=x"] }));
    assert_eq!(bad.status, 422, "{}", bad.text());
    let set = ["render.width_px=200", "render.height_px=150", "capture.blue.exposure_ms=7"];
    let asked = |set: &[&str]| json!({ "set": set, "capture": "blue", "view": "developed" });
    let refused = served.post("/api/picture", &asked(&set));
    assert!(refused.status == 422 && refused.text().contains("\"needs_render\":true"), "{}", refused.text());
    let (first, mut sizes, mut seen) = (picture(&served, &asked(&[])), Vec::new(), 0);
    loop {
        let told = rendering(&served, &set, Some(seen));
        assert_eq!(told["error"], Value::Null, "{told}");
        if told["level"].as_u64().unwrap() > seen {
            seen = told["level"].as_u64().unwrap();
            sizes.push(picture(&served, &asked(&set)).0);
        }
        if told["is_over"] == true {
            break;
        }
    }
    assert!(sizes[0]["is_coarse"] == true && sizes[0]["render_px"][0].as_u64().unwrap() < 200, "{sizes:?}");
    // A page whose render gave way to that of another page does not take it away again
    let other = rendering(&served, &["render.seed=99"], Some(1));
    assert!(other["is_over"] == true && other["error"].as_str().unwrap().contains("Another page"), "{other}");
    let last = sizes.last().unwrap();
    assert_eq!((&last["is_coarse"], &last["render_px"]), (&json!(false), &json!([200, 150])));

    // With another drive on top it is what `run` and `capture` make of the saved experiment
    let set = [set[0], set[1], "capture.blue.exposure_ms=5"];
    let folder = tempfile::tempdir().unwrap();
    let toml = served.post("/api/toml", &json!({ "set": set })).json();
    let file = folder.path().join("saved.toml");
    std::fs::write(&file, toml["toml"].as_str().unwrap()).unwrap();
    let experiment = ExperimentArgs { experiment: Some(file.display().to_string()), ..Default::default() };
    let mut options = RunOptions { experiment, out: Some(folder.path().join("run")), ..Default::default() };
    options.experiment.render.spp = Some(1);
    run(&options, &job()).unwrap();
    let written = std::fs::read(folder.path().join("run/preview_blue.png")).unwrap();
    assert!(picture(&served, &asked(&set)).1 == decoded(&written));
    assert!(picture(&served, &asked(&[])).1 == first.1, "the first render is not there any more");
}

#[test]
fn a_render_ends_when_another_scene_is_wanted_and_when_it_is_stopped() {
    let served = Served::on_run();
    let long = |samples: &'static str| ["render.width_px=96", samples];
    let [one, other] = ["render.samples_per_pixel=90000", "render.samples_per_pixel=80000"].map(long);
    let coarse = |set: &[&str]| while rendering(&served, set, None)["level"] == 0 {};
    coarse(&one);
    let begun = Instant::now();
    coarse(&other);
    assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
    assert_eq!(served.post("/api/stop", &json!({})).status, 202);
    let told = rendering(&served, &other, Some(9));
    assert!(told["error"].as_str().is_some_and(|why| why.contains("stopped")), "{told}");
}

#[test]
fn subjects_that_are_none_are_told() {
    let empty = tempfile::tempdir().unwrap();
    for (subject, word) in [
        (empty.path().display().to_string(), "has no components.exr"),
        ("no-such-experiment".into(), "no-such-experiment"),
        ("missing.exr".into(), "missing.exr"),
        ("fluorescent-sphere".into(), "the experiment has no lens; add a [lens] section"),
    ] {
        let options = WorkbenchOptions { subject: Some(subject), spp: 1, ..Default::default() };
        let error = Workbench::open(&options).err().unwrap().to_string();
        assert!(error.contains(word), "{error}");
    }
    let mut options = WorkbenchOptions { subject: Some("flat-patch".into()), spp: 1, ..Default::default() };
    options.changes.set = vec!["capture.blue.gain=-3".into()];
    let error = Workbench::open(&options).err().unwrap().to_string();
    assert!(error.contains("gain") && error.contains("-3"), "{error}");
}

#[test]
fn a_run_that_is_written_anew_is_not_mixed_with_the_one_that_was_opened() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["components.exr", "experiment.toml"] {
        std::fs::copy(run_folder().join(name), folder.path().join(name)).unwrap();
    }
    let served = Served::on(folder.path());
    let other = any_led_folder().join("components.exr");
    let (new, image) = (folder.path().join("new.exr"), folder.path().join("components.exr"));
    std::fs::copy(other, &new).unwrap();
    std::fs::rename(&new, &image).unwrap();
    let asked = json!({ "set": ["view_filter.filters=[]"], "capture": "blue", "view": "developed" });
    let refused = served.post("/api/picture", &asked);
    assert!(
        refused.status == 422 && refused.text().contains("written anew since it was opened"),
        "{}",
        refused.text()
    );
}
