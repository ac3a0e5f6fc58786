//! What the analysis says about regions of known porphyrin: warnings, and intervals that hold the truth.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::sync::atomic::AtomicBool;

use fluorspar::analysis::Analysis;
use fluorspar::image::ComponentImage;
use fluorspar::pipeline::{CameraResponse, RegionRadiance, evaluate};
use fluorspar::render::{RenderControl, render};
use fluorspar::study::Study;
use fluorspar_experiment::{parse, resolve};

fn rendered(text: &str) -> (Study, ComponentImage) {
    let study = resolve(&parse(text, "region.toml", Path::new("."), &[]).unwrap()).unwrap().study;
    let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
    let image = render(&study.scene, &study.render, &control).unwrap();
    (study, image)
}

fn analysis(text: &str) -> Analysis {
    let (study, image) = rendered(text);
    evaluate(&study, &image).unwrap().analysis.unwrap().analysis
}

/// A flat patch with a bulk.
fn patch(bulk: &str) -> Analysis {
    analysis(&format!(
        "format = 1\nbase = \"flat-patch\"\n[render]\nwidth_px = 16\nheight_px = 12\nsamples_per_pixel = 4\n[sensor]\ncolumns = 32\n\
         rows = 24\n[[fluorophore]]\nname = \"my_dye\"\nsource = \"fad\"\n[analysis]\nbulk = {{ {bulk} }}\n"
    ))
}

/// The line of a bulk without blood is told where the bulk is of tissue, and not where it is a plant or a dye.
#[test]
fn a_bulk_without_blood_is_told_where_tissue_could_be_meant() {
    let warned = |bulk: &str| patch(bulk).warnings.iter().any(|warning| warning.contains("without blood"));
    assert!(warned("elastin = 1.0"));
    assert!(warned("fad = 0.2, chlorophyll_a = 1.0"));
    assert!(!warned("chlorophyll_a = 1.0"));
    assert!(!warned("my_dye = 1.0"));
}

/// Without a porphyrin in the scene a share is asked for of tissue, which could hold some, and not of a leaf or of a dye.
#[test]
fn a_scene_of_what_no_tissue_holds_is_asked_for_no_porphyrin() {
    let analyte = |concentrations: &str| {
        let change = format!("material.patch.concentrations={{ {concentrations} }}");
        let text =
            "format = 1\nbase = \"flat-patch\"\n[[fluorophore]]\nname = \"my_dye\"\nsource = \"fad\"\n";
        let experiment = parse(text, "leaf.toml", Path::new("."), &[change]).unwrap();
        resolve(&experiment).unwrap().study.analysis.unwrap().porphyrin
    };
    assert_eq!(analyte("fad = 0.2, elastin = 1.0").as_deref(), Some("protoporphyrin_ix"));
    assert_eq!(analyte("fad = 0.2, biofilm_porphyrin = 0.1").as_deref(), Some("biofilm_porphyrin"));
    assert_eq!(analyte("chlorophyll_a = 1.0, nadh = 0.3"), None);
    assert_eq!(analyte("my_dye = 1.0"), None);
    assert_eq!(analyte("my_dye = 1.0, protoporphyrin_ix = 0.1").as_deref(), Some("protoporphyrin_ix"));
}

/// The mouth of colored surfaces, small: what the budget adds up holds the truth that is printed beside the estimate.
#[test]
fn the_mouth_of_surfaces_reads_its_truth_within_its_interval() {
    let found = analysis(
        "format = 1\nbase = \"oraleye-2021-surface\"\n[spectral]\nfirst_nm = 370.0\nlast_nm = 700.0\nstep_nm = 10.0\n[render]\n\
         width_px = 64\nheight_px = 48\nsamples_per_pixel = 8\n[sensor]\ncolumns = 128\nrows = 96\npixel_size_um = 18.75\n\
         fill_factor = 0.02\n[mouth]\ndetail = 0.4\n",
    );
    let truth = found.truth.unwrap().share;
    let budget = found.budget.unwrap();
    let [low, high] = budget.total_interval;
    assert!(truth > 0.05 && low <= truth && truth <= high, "{truth}, {budget:?}");
    // An interval that holds everything says nothing
    assert!(high - low < truth, "{budget:?}");
}

/// Whether something is told of a result beyond what every bulk without blood is told.
fn is_warned(found: &Analysis) -> bool {
    found.warnings.iter().any(|warning| !warning.contains("without blood"))
}

/// A flat patch, small, with more of an experiment.
fn small_patch(more: &str) -> String {
    format!(
        "format = 1\nbase = \"flat-patch\"\n[spectral]\nfirst_nm = 370.0\nlast_nm = 700.0\nstep_nm = 5.0\n[render]\nwidth_px = 32\n\
         height_px = 24\nsamples_per_pixel = 16\nmax_depth = 6\n{more}"
    )
}

/// A groove of one tissue, two walls at a right angle that fill the image: light that they reflect to each other is redder than that of
/// a flat sample. Half of it without porphyrin.
#[test]
fn the_groove_of_one_tissue_reads_its_truth_or_warns() {
    let walls = "[[object]]\nname = \"patch\"\ncorner_mm = [0.0, -100.0, -20.0]\nedge_u_mm = [60.0, 0.0, 60.0]\nedge_v_mm = [0.0, 200.0, \
                 0.0]\n[[object]]\nname = \"left\"\nmaterial = \"patch\"\ntype = \"quad\"\ncorner_mm = [0.0, -100.0, -20.0]\nedge_u_mm = \
                 [0.0, 200.0, 0.0]\nedge_v_mm = [-60.0, 0.0, 60.0]\n";
    for amount in [0.0, 0.1] {
        let porphyrin =
            format!("[[material]]\nname = \"patch\"\nconcentrations.protoporphyrin_ix = {amount:?}\n");
        let found =
            analysis(&small_patch(&format!("[analysis]\nparts = [\"patch\", \"left\"]\n{walls}{porphyrin}")));
        let truth = found.truth.as_ref().unwrap().share;
        let budget = found.budget.as_ref().unwrap();
        let [low, high] = budget.total_interval;
        assert_eq!(truth > 0.05, amount > 0.0, "{truth}");
        let indirect = budget.terms.iter().find(|item| item.source == "indirect light").unwrap();
        assert!(indirect.change.abs() > 0.002, "a groove without indirect light: {budget:?}");
        let is_held = low <= truth && truth <= high;
        assert!(is_held || is_warned(&found), "{truth}, {budget:?}, {:?}", found.warnings);
        assert!(high - low < 0.1, "{budget:?}");
    }
}

/// A dim patch beside a wall that shines as a tooth does sends back more of its light than the estimate of tissue allows for; not beside a
/// dark one.
#[test]
fn light_of_bright_surroundings_is_warned_of() {
    let walls = "[[object]]\nname = \"patch\"\ncorner_mm = [0.0, -100.0, -20.0]\nedge_u_mm = [60.0, 0.0, 60.0]\nedge_v_mm = [0.0, 200.0, \
                 0.0]\n[[object]]\nname = \"wall\"\nmaterial = \"wall\"\ntype = \"quad\"\ncorner_mm = [0.0, -100.0, -20.0]\nedge_u_mm = \
                 [0.0, 200.0, 0.0]\nedge_v_mm = [-60.0, 0.0, 60.0]\n[[material]]\nname = \"patch\"\nconcentrations = { fad = 0.02, \
                 collagen = 0.02, elastin = 0.1, keratin = 0.02, protoporphyrin_ix = 0.0 }\n[[material]]\nname = \"wall\"\nreflectance = \
                 \"enamel\"\n";
    for (dentin, is_warned) in [(0.4, true), (0.0, false)] {
        let found = analysis(&small_patch(&format!(
            "[analysis]\nparts = [\"patch\"]\ntissue = \"lip\"\n{walls}concentrations = {{ dentin = {dentin:?} }}\n"
        )));
        let said = format!("{:?}", found.warnings).contains("is light of other parts, as of teeth");
        assert_eq!(said, is_warned, "{:?}", found.warnings);
    }
}

/// Light that leaks through the filters of a region without any fluorescence, as if it were the light of some bulk, and as if it were
/// that of a lip.
#[test]
fn a_leak_without_fluorescence_reads_no_porphyrin_or_warns() {
    let dark = "[[light]]\nname = \"blue\"\nspectrum = \"led_450\"\nfilters = []\n[[material]]\nname = \"patch\"\nconcentrations = { fad \
                = 0.0, collagen = 0.0, elastin = 0.0, keratin = 0.0, protoporphyrin_ix = 0.0 }\n[analysis]\nbulk = { elastin = 1.0 }\n";
    for tissue in ["", "tissue = \"lip\"\n"] {
        let found = analysis(&small_patch(&format!("{dark}{tissue}")));
        let mean = found.channels.iter().map(|channel| channel.statistics.unwrap().mean).fold(0.0, f64::max);
        assert!(mean > 100.0, "no light leaks: {mean}");
        let low = match &found.posterior {
            Some(posterior) => posterior.interval[0],
            None => found.mixture.as_ref().unwrap().region.unwrap().estimate.fraction_interval[0],
        };
        assert_eq!(found.posterior.is_some(), !tissue.is_empty());
        assert!(low == 0.0 || is_warned(&found), "{low}, {:?}", found.warnings);
    }
}

/// A bulk on the line that is not that of the sample: its light lies beside the line, or below zero.
#[test]
fn a_wrong_bulk_on_the_line_is_held_or_warned() {
    for bulk in ["keratin = 1.0", "fad = 1.0", "collagen = 1.0", "elastin = 1.0"] {
        let found = analysis(&small_patch(&format!("[analysis]\nbulk = {{ {bulk} }}\n")));
        let truth = found.truth.as_ref().unwrap().share;
        let [low, high] = found.budget.as_ref().unwrap().total_interval;
        assert!(
            (low <= truth && truth <= high) || is_warned(&found),
            "{bulk}: {truth}, {low} to {high}, {:?}",
            found.warnings
        );
    }
}

/// Cameras of one channel and of eight know the truth as well: electrons of all their channels, as the lens and the sensor weigh the
/// radiance of the region.
#[test]
fn cameras_of_other_channels_than_red_green_and_blue_know_the_truth() {
    for (sensor, channels) in [("monochrome_3_45um", 1), ("multispectral_8_band", 8)] {
        let (study, image) = rendered(&small_patch(&format!(
            "[sensor]\npreset = \"{sensor}\"\ncolumns = 64\nrows = 48\n[analysis]\ntissue = \"lip\"\n"
        )));
        let found = evaluate(&study, &image).unwrap().analysis.unwrap().analysis;
        let truth = found.truth.unwrap();
        let lens = study.camera.lens_behind_filters().unwrap();
        let camera =
            CameraResponse::new(&lens, study.camera.sensor.as_ref().unwrap(), &study.scene.grid, None);
        let seeing = camera.seeing_channels();
        let names: Vec<&String> = seeing.iter().map(|&channel| &camera.channels()[channel]).collect();
        assert!(seeing.len() <= channels && truth.electrons.channels.iter().eq(names), "{truth:?}");
        let all: Vec<usize> = (0..image.width * image.height).collect();
        let radiance = RegionRadiance::new(&image, &study.analyzed_capture().unwrap().frame, &all);
        let electrons = |name: &str| -> f64 {
            seeing.iter().map(|&c| camera.channel_electrons(c, &radiance.fluorescence[name], 0.03)).sum()
        };
        let of_all: f64 = radiance.fluorescence.keys().map(|name| electrons(name)).sum();
        let expected = electrons("protoporphyrin_ix") / of_all;
        // Planes hold 24 bits, sums of channels some thousand pixels.
        assert!(expected > 0.05 && (truth.share / expected - 1.0).abs() < 1e-4, "{expected}, {truth:?}");
        assert!(found.posterior.is_some(), "the estimate that the truth stands beside");
    }
}
