//! Photographs: taken in, asked about, and saved where the user says.

use std::fs;
use std::path::Path;

use fluorspar::findings::region_findings;
use fluorspar_report::finding_lines;
use fluorspar_session::{AnalyzeOptions, Analyzed, analyze};
use fluorspar_web::{Workbench, WorkbenchOptions};
use serde_json::{Value, json};

use crate::support::{Answer, Served, job, run_folder};

/// Sends a file as the page does when it is dropped.
fn dropped(served: &Served, name: &str, bytes: &[u8]) -> Answer {
    let target = served.head(&format!("POST /api/photographs/file/{name}"));
    served.send(&format!("{target}Content-Type: application/octet-stream\r\n"), bytes)
}

/// Drops the frames of the run with their descriptions.
fn with_frames() -> Served {
    let served = Served::on_run();
    for (id, capture) in ["blue", "ambient"].iter().enumerate() {
        for ending in ["tiff.json", "tiff"] {
            let name = format!("raw_{capture}.{ending}");
            let told = dropped(&served, &name, &fs::read(run_folder().join(&name)).unwrap()).json();
            assert!(ending == "tiff.json" || told["id"] == json!(id), "{told}");
        }
    }
    served
}

/// A region of the first photograph with its answer.
fn estimate(served: &Served, place: &Value) -> Answer {
    let body = json!({ "experiment": "flat-patch", "id": 0, "frames": [["blue", 0], ["ambient", 1]],
        "size": [64, 48], "name": "x", "place": place });
    served.post("/api/photographs/estimate", &body)
}

#[test]
fn estimates_of_photographs_are_those_of_analyze() {
    let served = with_frames();
    let told = served.post("/api/photographs", &json!({ "experiment": "flat-patch" })).json();
    assert_eq!(
        told["frames"][1],
        json!({ "id": 1, "name": "raw_ambient.tiff", "capture": "ambient", "patient": "raw", "visit": "1" }),
        "{told}"
    );
    // Rows 10 and 11, columns 5 to 40
    let mask = json!([10 * 64 + 5, 36, 28, 36]);
    let painted = run_folder().join("painted.png");
    let mut inside = vec![0; 64 * 48];
    for row in [10, 11] {
        inside[row * 64 + 5..row * 64 + 41].fill(255);
    }
    fluorspar_format::write_label_png(&painted, 64, 48, &inside).unwrap();
    for (place, shape, value) in [
        (json!({ "rectangle_px": [8, 8, 40, 30] }), "rectangle_px", "[8, 8, 40, 30]".to_owned()),
        (
            json!({ "polygon_px": [[10.0, 10.0], [50.5, 12.0], [40.0, 40.0]] }),
            "polygon_px",
            "[[10.0, 10.0], [50.5, 12.0], [40.0, 40.0]]".into(),
        ),
        (json!({ "mask_runs": mask }), "mask", format!("{:?}", painted.display().to_string())),
        (
            json!({ "rectangle_px": [8, 8, 40, 30], "part": "patch" }),
            "rectangle_px",
            "[8, 8, 40, 30], parts = [\"patch\"]".into(),
        ),
    ] {
        let told = estimate(&served, &place).json();
        let file = |name: &str| format!("{name}={}", run_folder().join(format!("raw_{name}.tiff")).display());
        let mut options = AnalyzeOptions {
            frame: vec![file("blue"), file("ambient")],
            experiment: Some("flat-patch".into()),
            named_region: vec![format!("x={{ {shape} = {value} }}")],
            ..Default::default()
        };
        options.changes.set = vec!["analysis.rectangle_px=[8, 8, 40, 30]".into()];
        let Analyzed::Frames(analyzed) = analyze(&options, &job()).unwrap() else {
            panic!("frames of one photograph")
        };
        let analysis = &analyzed.regions[0].in_view().unwrap().analysis;
        let lines = finding_lines(&region_findings(analysis), &analysis.analyte, false);
        assert!(lines.len() > 2 && told["lines"] == json!(lines), "{shape}: {told}");
    }
    // What is mapped is the last region
    let of_part = json!({ "rectangle_px": [8, 8, 40, 30], "part": told["parts"][0] });
    let answer = estimate(&served, &of_part).json();
    assert_eq!(answer["has_map"], json!(true), "{of_part} {answer}");
    for view in ["developed", "raw", "clip", "porphyrin"] {
        let asked = json!({ "experiment": "flat-patch", "id": 0, "capture": "blue", "view": view });
        let picture = served.post("/api/photographs/picture", &asked);
        assert_eq!(picture.status, 200, "{view}: {}", picture.text());
    }
}

#[test]
fn what_is_no_raw_frame_is_refused_with_the_reason() {
    let served = with_frames();
    // Cards of two cameras have files of one name
    let other = fs::read(run_folder().join("raw_ambient.tiff")).unwrap();
    let refused = dropped(&served, "raw_blue.tiff", &other);
    assert!(refused.status == 422 && refused.text().contains("another raw_blue.tiff"), "{}", refused.text());
    let described = fs::read(run_folder().join("raw_ambient.tiff.json")).unwrap();
    let refused = dropped(&served, "raw_blue.tiff.json", &described);
    assert!(
        refused.status == 422 && refused.text().contains("another raw_blue.tiff.json"),
        "{}",
        refused.text()
    );
    let jpeg = dropped(&served, "photo.jpg", b"\xff\xd8\xff\xe0\0\x10JFIF\0 and more");
    let text = jpeg.text();
    assert!(
        jpeg.status == 422 && text.contains("photo.jpg: this is a JPEG, whose numbers lie on a tone curve"),
        "{text}"
    );
    for name in ["..%2Fup.tiff", ".hidden", "a%3Db.tiff", "%2Fetc%2Fpasswd"] {
        let refused = dropped(&served, name, b"II*\0");
        assert!(
            refused.status == 422 && refused.text().contains("no name of a file"),
            "{name}: {}",
            refused.text()
        );
    }
    for (place, word) in [
        (json!({ "mask_runs": [0, 999_999] }), "larger than its photograph"),
        (json!({ "rectangle_px": [60, 40, 40, 40] }), "64 x 48"),
        (json!({}), "polygon"),
    ] {
        let refused = estimate(&served, &place);
        assert!(refused.status == 422 && refused.text().contains(word), "{place}: {}", refused.text());
    }
    let other = served.post("/api/photographs", &json!({ "experiment": "/etc/passwd" }));
    assert!(
        other.status == 422 && other.text().contains("no experiment of the catalogue"),
        "{}",
        other.text()
    );
    let options = WorkbenchOptions { subject: Some("missing.dng".into()), ..Default::default() };
    assert!(Workbench::open(&options).err().unwrap().to_string().contains("missing.dng"));
}

/// What is saved of the two photographs.
fn saved(served: &Served, folder: &Path) -> Answer {
    saved_by("one page", served, folder)
}

fn saved_by(page: &str, served: &Served, folder: &Path) -> Answer {
    let regions = json!([
        { "name": "tongue", "place": { "rectangle_px": [1, 2, 30, 40], "part": "patch" }, "verdict": "right" },
        { "name": "le, sion", "place": { "mask_runs": [100, 20] }, "verdict": "wrong" },
    ]);
    let frame = |id: u32, capture: &str, regions: &Value| json!({ "id": id, "patient": "P1", "visit": "2", "capture": capture, "size": [64, 48], "regions": regions });
    let frames = [frame(0, "blue", &regions), frame(1, "ambient", &json!([]))];
    served.post(
        "/api/photographs/save",
        &json!({ "folder": folder.display().to_string(), "page": page, "frames": frames }),
    )
}

#[test]
fn what_was_drawn_is_saved_and_nothing_is_overwritten() {
    let served = with_frames();
    let folder = tempfile::tempdir().unwrap();
    let answer = saved(&served, folder.path());
    let names: Vec<String> = serde_json::from_value(answer.json()["files"].clone()).unwrap();
    let table = fs::read_to_string(folder.path().join("photographs.csv")).unwrap();
    let lines: Vec<&str> = table.lines().collect();
    assert_eq!(
        lines,
        [
            "patient,visit,capture,frame,dark,flat,region,where,verdict",
            "P1,2,blue,raw_blue.tiff,,,tongue,\"{ parts = [\"\"patch\"\"], rectangle_px = [1, 2, 30, 40] }\",right",
            "P1,2,blue,raw_blue.tiff,,,\"le, sion\",\"{ mask = \"\"mask_raw_blue_le__sion.png\"\" }\",wrong",
            "P1,2,ambient,raw_ambient.tiff,,,,,",
        ]
    );
    let mask = fluorspar_format::read_mask(&folder.path().join("mask_raw_blue_le__sion.png")).unwrap();
    assert_eq!((mask.width, mask.height), (64, 48));
    assert!(mask.inside.iter().enumerate().all(|(pixel, inside)| *inside == (100..120).contains(&pixel)));
    let same = |name: &str| {
        fs::read(folder.path().join(name)).unwrap() == fs::read(run_folder().join(name)).unwrap()
    };
    assert!(same("raw_blue.tiff") && same("raw_blue.tiff.json") && names.len() == 6, "{names:?}");
    // Its own files are written anew, those of others stay
    assert_eq!(saved(&served, folder.path()).status, 200);
    // But for another page, which knows nothing of what was drawn on this one
    assert_eq!(saved_by("another page", &served, folder.path()).status, 422);
    assert_eq!(fs::read_to_string(folder.path().join("photographs.csv")).unwrap(), table);
    // And for what somebody has edited since
    fs::write(folder.path().join("photographs.csv"), format!("{table}P2,,,,,,,,\n")).unwrap();
    assert_eq!(saved(&served, folder.path()).status, 422);
    let other = tempfile::tempdir().unwrap();
    fs::write(other.path().join("photographs.csv"), "mine").unwrap();
    let refused = saved(&served, other.path());
    assert!(
        refused.status == 422 && refused.text().contains("nothing of yours is overwritten"),
        "{}",
        refused.text()
    );
    assert_eq!(fs::read_dir(other.path()).unwrap().count(), 1);
    for folder in ["", "relative", "/no/such/folder"] {
        let refused = saved(&served, Path::new(folder));
        assert!(
            refused.status == 422 && refused.text().contains("no folder"),
            "{folder}: {}",
            refused.text()
        );
    }
}
