//! Regions beside that of `[analysis]`: each is what an analysis of it alone is, and entries of a list like others.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::sync::atomic::AtomicBool;

use fluorspar::image::ComponentImage;
use fluorspar::pipeline::{AnalyzedFrame, Evaluation, evaluate};
use fluorspar::render::{RenderControl, render};
use fluorspar::sampling::Z_95;
use fluorspar::sensor::{Sensor, SensorModel};
use fluorspar::study::{RegionPlan, Study};
use fluorspar_experiment::{Experiment, ExperimentError, parse, resolve, show_the_same_scene};

/// A patch with a spot of more porphyrin before its right half.
const SPOT: &str = r#"format = 1
base = "flat-patch"
[render]
width_px = 16
height_px = 12
samples_per_pixel = 2
[sensor]
columns = 64
rows = 48
[[material]]
name = "spot"
reflectance = 0.3
concentrations = { elastin = 0.5, protoporphyrin_ix = 4.0 }
[[object]]
name = "spot"
material = "spot"
type = "quad"
corner_mm = [0.0, -100.0, 1.0]
edge_u_mm = [100.0, 0.0, 0.0]
edge_v_mm = [0.0, 200.0, 0.0]
"#;

/// Regions of each kind: of other parts, of a part within a shape, of a shape alone.
const REGIONS: &str = r#"[[analysis.region]]
name = "spot"
parts = ["spot"]
inset_px = 2
[[analysis.region]]
name = "the left, above"
parts = ["patch"]
polygon_px = [[0, 0], [20, 0], [0, 20]]
[[analysis.region]]
name = "middle"
rectangle_px = [20, 16, 24, 16]
porphyrin = "none"
"#;

fn experiment(more: &str, changes: &[&str]) -> Result<Experiment, ExperimentError> {
    let changes: Vec<String> = changes.iter().map(|change| (*change).to_owned()).collect();
    parse(&format!("{SPOT}{more}"), "regions", Path::new("."), &changes)
}

fn study(more: &str, changes: &[&str]) -> Study {
    resolve(&experiment(more, changes).unwrap()).unwrap().study
}

fn rendered(study: &Study) -> ComponentImage {
    let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
    render(&study.scene, &study.render, &control).unwrap()
}

#[test]
fn a_region_is_its_own_analysis_to_the_last_bit() {
    let with_regions = study(REGIONS, &[]);
    let image = rendered(&with_regions);
    let Evaluation { analysis, regions, .. } = evaluate(&with_regions, &image).unwrap();
    let alone = |changes: &[&str]| -> AnalyzedFrame {
        evaluate(&study("", changes), &image).unwrap().analysis.unwrap()
    };
    assert_eq!(analysis, Some(alone(&[])));
    let changes: [&[&str]; 3] = [
        &["analysis.parts=[\"spot\"]", "analysis.inset_px=2"],
        &["analysis.polygon_px=[[0, 0], [20, 0], [0, 20]]"],
        &["analysis.parts=[]", "analysis.rectangle_px=[20, 16, 24, 16]", "analysis.porphyrin=none"],
    ];
    for (region, changes) in regions.iter().zip(changes) {
        assert_eq!(region.analyzed, Ok(alone(changes)), "{}", region.name);
    }
    let names: Vec<&str> = regions.iter().map(|region| region.name.as_str()).collect();
    let seen = |k: usize| regions[k].in_view().unwrap();
    assert_eq!(names, ["spot", "the left, above", "middle"]);
    // They tell what the patch does not: its bulk has less porphyrin, and of a shape alone none is asked for
    let share = |analyzed: &AnalyzedFrame| analyzed.analysis.truth.as_ref().map(|truth| truth.share);
    let of_patch = share(&analysis.unwrap()).unwrap();
    assert!(share(seen(0)).unwrap() > 1.2 * of_patch, "{of_patch}");
    assert!(share(seen(1)).is_some() && share(seen(2)).is_none());
}

/// A line of a mosaic may hold no pixel of a channel: its truth is that of the interpolated frame around it. So is the crosstalk of a
/// region that of its place.
#[test]
fn the_truth_of_a_region_is_of_all_channels_and_its_place() {
    let study = |changes: &[&str]| study("", &[&["analysis.parts=[\"patch\"]"][..], changes].concat());
    let image = rendered(&study(&[]));
    let share = |rectangle: &str| {
        let rectangle = format!("analysis.rectangle_px={rectangle}");
        let analyzed = evaluate(&study(&[&rectangle]), &image).unwrap().analysis.unwrap();
        analyzed.analysis.truth.unwrap().share
    };
    let wanted = share("[8, 8, 16, 32]");
    for few in ["[8, 8, 1, 32]", "[9, 8, 1, 32]", "[8, 8, 16, 1]", "[8, 8, 1, 1]"] {
        assert!((share(few) / wanted - 1.0).abs() < 0.05, "{few}: {} for {wanted}", share(few));
    }
    // The corner of a sensor has three times the optical crosstalk of its center
    let off = |factor: f64| {
        let edge = format!("sensor.crosstalk.optical_edge_factor={factor}");
        let size = ["sensor.preset=\"rgb_nir_3um\"", "sensor.columns=64", "sensor.rows=48"];
        let place = ["sensor.mode={ type = \"noise_free\" }", "analysis.rectangle_px=[2, 2, 8, 8]"];
        let study = study(&[&size[..], &place, &[&edge]].concat());
        let analysis = evaluate(&study, &image).unwrap().analysis.unwrap().analysis;
        let terms = analysis.signals.unwrap().unmixing.unwrap().terms;
        let porphyrin = terms.iter().find(|term| term.fluorophores == ["protoporphyrin_ix"]).unwrap();
        porphyrin.share / porphyrin.true_share.unwrap()
    };
    assert!((off(3.0) / off(1.0) - 1.0).abs() < 0.01, "{} {}", off(3.0), off(1.0));
}

/// What lines share scatters the share as much as it says, in regions of many lines and of one, in merged exposures and without noise of
/// the master of dark frames: the deviation of 300 frames is known to 1 / sqrt(600) = 0.04, held to four of that.
#[test]
fn noise_of_lines_is_in_the_error_of_a_region() {
    let small = ["sensor.columns=32", "sensor.rows=24"];
    let of = |rectangle: &str, changes: &[&str]| {
        let rectangle = format!("analysis.rectangle_px={rectangle}");
        let study = study("", &[&["analysis.parts=[\"patch\"]", &rectangle][..], &small, changes].concat());
        scatter_over_stated(study)
    };
    let dark = ["develop.dark_frames=2", "unset capture.blue.subtract", "sensor.row_noise_mv=6.0"];
    let merged = ["capture.blue.bracket_ev=[2.0]", "unset capture.blue.subtract", "sensor.row_noise_mv=6.0"];
    let ratios = [
        of("[2, 4, 12, 12]", &["sensor.row_noise_mv=4.0", "sensor.row_offset_mv=4.0"]),
        of("[2, 4, 12, 1]", &["sensor.column_noise_mv=4.0"]),
        of("[5, 5, 1, 1]", &["sensor.row_noise_mv=4.0"]),
        of("[2, 4, 12, 12]", &["sensor.column_gain_percent=5.0"]),
        of("[2, 4, 12, 12]", &dark),
        of("[2, 4, 12, 12]", &merged),
    ];
    assert!(ratios.iter().all(|ratio| (ratio - 1.0).abs() < 0.17), "{ratios:?}");
    // Frames without noise have none of lines
    let quiet = ["sensor.mode={ type = \"noise_free\" }", "sensor.row_noise_mv=50.0"];
    let study = study("", &[&small[..], &quiet].concat());
    let lines = evaluate(&study, &rendered(&study)).unwrap().analysis.unwrap().analysis.settings.noise.lines;
    assert!(lines.is_none(), "{lines:?}");
}

/// Scatter of the share over frames of as many sensors over what it is told to be.
fn scatter_over_stated(mut study: Study) -> f64 {
    const FRAMES: u64 = 300;
    let image = rendered(&study);
    let (mut sums, mut variance) = ([0.0; 2], 0.0);
    for seed in 1..=FRAMES {
        study.render.seed = seed;
        study.camera.sensor = Some(other_device(&study, seed));
        let budget = evaluate(&study, &image).unwrap().analysis.unwrap().analysis.budget.unwrap();
        sums = [sums[0] + budget.share, sums[1] + budget.share.powi(2)];
        variance += (budget.sensor_noise / Z_95).powi(2) / FRAMES as f64;
    }
    let n = FRAMES as f64;
    let found = ((sums[1] - sums[0] * sums[0] / n) / (n - 1.0)).sqrt();
    found / variance.sqrt()
}

fn other_device(study: &Study, device_seed: u64) -> Sensor {
    let sensor = study.camera.sensor.as_ref().unwrap();
    Sensor::new(SensorModel { device_seed, ..sensor.model().clone() }, sensor.qe().clone()).unwrap()
}

/// A spot behind the patch is hidden, and one of no more than its rim is not within it: the others are as without them.
#[test]
fn a_region_out_of_view_leaves_the_others_as_they_are() {
    let hidden = "[[object]]\nname = \"hidden\"\nmaterial = \"spot\"\ntype = \"quad\"\ncorner_mm = [0.0, -100.0, -1.0]\n\
                  edge_u_mm = [100.0, 0.0, 0.0]\nedge_v_mm = [0.0, 200.0, 0.0]\n";
    let of = |name: &str, fields: &str| format!("[[analysis.region]]\nname = \"{name}\"\n{fields}\n");
    let (spot, absent) = (of("spot", "parts = [\"spot\"]"), of("absent", "parts = [\"hidden\"]"));
    let rim = of("rim", "parts = [\"spot\"]\nrectangle_px = [33, 0, 3, 48]\ninset_px = 20");
    let all = study(&format!("{hidden}{absent}{spot}{rim}"), &[]);
    let image = rendered(&all);
    let Evaluation { analysis, regions, .. } = evaluate(&all, &image).unwrap();
    let alone = evaluate(&study(&format!("{hidden}{spot}"), &[]), &image).unwrap();
    assert_eq!((&analysis, &regions[1]), (&alone.analysis, &alone.regions[0]));
    let why = |k: usize| regions[k].analyzed.as_ref().unwrap_err().to_string();
    assert_eq!(why(0), "no pixel of the region shows hidden; the parts in view are: patch, spot");
    assert_eq!(
        why(2),
        "no pixel of spot lies 20 pixels of the sensor within its rim: choose a smaller inset"
    );
    // A part that the scene has not is a mistake
    let mistake = study(&format!("{hidden}{spot}"), &[]);
    let mut mistake = mistake;
    mistake.regions[0].analysis.parts = vec!["spt".into()];
    let said = evaluate(&mistake, &image).unwrap_err().to_string();
    assert!(said.starts_with("the region \"spot\": the rendered scene has no part \"spt\""), "{said}");
}

/// Names of regions and of other fluorophores stay as they are, whatever is looked for.
#[test]
fn each_region_is_told_in_the_words_of_its_own_fluorophore() {
    let text = "[analysis]\nporphyrin = \"fluorescein\"\nbulk = { elastin = 1.0 }\n\
                [[analysis.region]]\nname = \"porphyrin spot\"\nparts = [\"spot\"]\n\
                porphyrin = \"protoporphyrin_ix\"\n";
    let study = study(text, &[]);
    let Evaluation { analysis, regions, .. } = evaluate(&study, &rendered(&study)).unwrap();
    let said = |analyzed: &AnalyzedFrame| {
        let definition = analyzed.analysis.truth.iter().map(|truth| truth.definition.clone());
        let told = std::iter::once(analyzed.analysis.analyte.capitalized());
        let warnings = analyzed.analysis.warnings.iter().map(ToString::to_string);
        definition.chain(told).chain(warnings).collect::<Vec<_>>().join("\n")
    };
    let (main, spot) = (said(&analysis.unwrap()), said(regions[0].in_view().unwrap()));
    assert!(main.contains("Fluorescein"), "{main}");
    assert!(!main.to_lowercase().contains("porphyrin"), "{main}");
    assert!(spot.contains("Porphyrin"), "{spot}");
    assert!(!spot.to_lowercase().contains("fluorescein"), "{spot}");
}

#[test]
fn what_a_region_does_not_say_is_as_in_the_analysis() {
    let shared = "[analysis]\ninset_px = 3\ntissue = \"lip\"\nnoise_threshold = 7.0\nporphyrin = \"protoporphyrin_ix\"\n\
                  bulk = { fad = 1.0 }\n";
    let own = "[[analysis.region]]\nname = \"own\"\nparts = [\"spot\"]\ntissue = \"buccal_mucosa\"\nprior_width = 2.0\n";
    let plain = "[[analysis.region]]\nname = \"parts\"\nparts = [\"spot\"]\n[[analysis.region]]\nname = \"shape\"\n\
                 rectangle_px = [0, 0, 9, 9]\n";
    let found = study(&format!("{shared}{own}{plain}"), &[]);
    let [own, parts, shape] = found.regions.as_slice() else { panic!("{:?}", found.regions.len()) };
    let site =
        |region: &RegionPlan| region.analysis.tissue.as_ref().map(|prior| prior.site.name().to_owned());
    assert_eq!(site(own).as_deref(), Some("buccal_mucosa"));
    // What a region's own parts are made of is no matter of other parts; a shape has what is named
    assert_eq!((site(parts), site(shape).as_deref()), (None, Some("lip")));
    assert_eq!(parts.analysis.bulk, [("elastin".to_owned(), 0.5)]);
    assert_eq!(shape.analysis.bulk, [("fad".to_owned(), 1.0)]);
    assert_eq!(own.analysis.tissue.as_ref().unwrap().width, 2.0);
    for RegionPlan { analysis, .. } in &found.regions {
        assert_eq!((analysis.inset_px, analysis.noise_threshold), (3, 7.0));
        assert_eq!(analysis.porphyrin.as_deref(), Some("protoporphyrin_ix"));
        assert!(analysis.targets.is_empty() && analysis.compared.is_none());
    }
    let none = study(&format!("{shared}{plain}"), &["analysis.tissue=none"]);
    assert!(none.regions.iter().all(|region| site(region).is_none()));
}

#[test]
fn regions_are_entries_of_a_list_like_others() {
    let names = |study: &Study| study.regions.iter().map(|region| region.name.clone()).collect::<Vec<_>>();
    let changed = study(
        REGIONS,
        &[
            "analysis.region.spot.inset_px=1",
            "unset analysis.region.\"the left, above\"",
            "insert analysis.region.\"a corner\"={ rectangle_px = [0, 0, 4, 4] }",
        ],
    );
    assert_eq!(names(&changed), ["spot", "middle", "a corner"]);
    assert_eq!(changed.regions[0].analysis.inset_px, 1);
    // On top of a base entries of the same name are merged, others follow
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("base.toml"), format!("{SPOT}{REGIONS}")).unwrap();
    let text = "format = 1\nbase = \"base.toml\"\nunset = [\"analysis.region.middle\"]\n[[analysis.region]]\nname = \"spot\"\n\
                rectangle_px = [32, 0, 9, 9]\n[[analysis.region]]\nname = \"all\"\nparts = [\"spot\", \"patch\"]\n";
    let over = resolve(&parse(text, "over.toml", folder.path(), &[]).unwrap()).unwrap();
    assert_eq!(names(&over.study), ["spot", "the left, above", "all"]);
    let spot = &over.study.regions[0].analysis;
    assert_eq!((spot.parts.as_slice(), spot.rectangle_px), (&["spot".to_owned()][..], Some([32, 0, 9, 9])));
    // The written-out experiment says the same
    let again = parse(&over.record.resolved_toml, "resolved", folder.path(), &[]).unwrap();
    assert_eq!(resolve(&again).unwrap().study.regions, over.study.regions);
    // A region makes no other scene, but another experiment
    let (with, without) = (experiment(REGIONS, &[]).unwrap(), experiment("", &[]).unwrap());
    assert!(show_the_same_scene(&with, &without));
    assert_ne!(resolve(&with).unwrap().record.sha256, resolve(&without).unwrap().record.sha256);
}

/// A mistake in what a region has of `[analysis]` is told there.
#[test]
fn shared_fields_are_blamed_where_they_are_written() {
    let wrong = format!("[analysis]\nprior_width = 0.0\n{REGIONS}");
    let told = resolve(&experiment(&wrong, &[]).unwrap()).unwrap_err().to_string();
    assert!(told.contains("analysis.prior_width = 0.0: must be between"), "{told}");
    let own = REGIONS.replace("inset_px = 2", "inset_px = 65");
    let told = resolve(&experiment(&own, &[]).unwrap()).unwrap_err().to_string();
    assert!(told.contains("analysis.region[0].inset_px = 65: must be between 0 and 64 pixels"), "{told}");
}
