//! Which changes of a study a component image can follow, and which need a new render.
#![allow(clippy::unwrap_used, reason = "these are tests")]

use fluorspar::pipeline::check_same_scene;
use fluorspar::study::Study;
use fluorspar_experiment::{Experiment, parse, resolve, resolve_captures};

/// What differs, in the words of the error.
fn difference(rendered: &Study, wanted: &Study) -> Option<String> {
    let error = check_same_scene(rendered, wanted).err()?.to_string();
    error.split(" has changed since").next().map(String::from)
}

fn study(overrides: &[&str]) -> Study {
    let overrides: Vec<String> = overrides.iter().map(ToString::to_string).collect();
    let text = "format = 1\nbase = \"flat-patch\"";
    resolve(&parse(text, "test", std::path::Path::new("."), &overrides).unwrap()).unwrap().study
}

#[test]
fn changes_of_the_scene_are_named_and_changes_of_the_camera_behind_it_are_not() {
    let rendered = study(&[]);
    let said = |change: &str| difference(&rendered, &study(&[change])).unwrap_or_default();
    for (change, what) in [
        (
            "light.blue.strength.irradiance_w_per_m2=500",
            "the strength of light \"blue\" (which --set capture.blue.light_groups.blue=0.5 changes without a render)",
        ),
        (
            "light.blue.strength.irradiance_w_per_m2=1e-4",
            "the strength of light \"blue\" (which --set capture.blue.light_groups.blue=1e-7 changes without a render)",
        ),
        ("light.blue.spectrum=\"led_405\"", "light \"blue\""),
        ("material.patch.concentrations.fad=0.3", "material \"patch\""),
        ("object.patch.transform={ translate_mm = [0.0, 0.0, 1.0] }", "object \"patch\""),
        ("spectral.step_nm=10", "the wavelength grid ([spectral])"),
        ("camera.position_mm=[0, 0, 90]", "place or direction of the camera"),
        ("camera.horizontal_field_deg=30", "the field of view (camera.horizontal_field_deg)"),
        ("render.width_px=32", "the size of the image (render.width_px, render.height_px)"),
        ("render.samples_per_pixel=4", "render.samples_per_pixel"),
        ("render.max_depth=3", "render.max_depth"),
    ] {
        let found = said(change);
        // A camera elsewhere moves what hangs on it first; here nothing does.
        assert_eq!(found, what, "{change}");
    }
    for change in [
        "capture.blue.light_groups.blue=0.5",
        "capture.blue.exposure_ms=10",
        "view_filter.filters=[\"view_425_700\"]",
        "lens.f_number=2",
        "lens.focal_length_mm=4",
        "sensor.columns=160",
        "render.seed=9",
        "analysis.noise_threshold=3",
    ] {
        assert_eq!(said(change), "", "{change}");
        assert!(check_same_scene(&rendered, &study(&[change])).is_ok(), "{change}");
    }
}

fn experiment(overrides: &[&str]) -> Experiment {
    let overrides: Vec<String> = overrides.iter().map(ToString::to_string).collect();
    parse("format = 1\nbase = \"flat-patch\"", "test", std::path::Path::new("."), &overrides).unwrap()
}

/// Without surfaces the captures of a finished render are those of the whole experiment; where more has changed, all of it is asked.
#[test]
fn captures_of_a_render_need_no_surfaces() {
    let rendered = experiment(&[]);
    let held: Vec<String> =
        resolve(&rendered).unwrap().study.scene.fluorophores.iter().map(|f| f.name.clone()).collect();
    let held: Vec<&str> = held.iter().map(String::as_str).collect();
    let first = held.first().copied().unwrap_or_default();
    let concentration = format!("concentration.{first}=0.5");
    for change in [
        "capture.blue.exposure_ms=10",
        "capture.blue.light_groups.blue=0.5",
        "view_filter.filters=[\"view_425_700\"]",
        "render.seed=9",
        &concentration,
    ] {
        let now = experiment(&[change]);
        let found = resolve_captures(&rendered, &now, &held).unwrap().unwrap();
        let whole = resolve(&now).unwrap();
        let (a, b) = (&found.study, &whole.study);
        assert!(a.scene.objects.is_empty() && a.scene.materials.is_empty(), "{change}");
        assert_eq!((&a.captures, &a.camera), (&b.captures, &b.camera), "{change}");
        assert_eq!((&a.scene.lights, &a.scene.camera), (&b.scene.lights, &b.scene.camera), "{change}");
        assert_eq!(
            (&a.develop, &a.concentrations, a.render.seed),
            (&b.develop, &b.concentrations, b.render.seed),
            "{change}"
        );
        assert_eq!(found.resolved_toml, whole.record.resolved_toml, "{change}");
    }
    for change in [
        "material.patch.concentrations.fad=0.3",
        "light.blue.spectrum=\"led_405\"",
        "sensor.columns=160",
        "lens.f_number=2",
        "render.samples_per_pixel=4",
        "analysis.noise_threshold=7",
        "capture=[{ name = \"other\" }]",
    ] {
        assert!(resolve_captures(&rendered, &experiment(&[change]), &held).unwrap().is_none(), "{change}");
    }
    // What is wrong with a capture is found here, too.
    assert!(resolve_captures(&rendered, &experiment(&["capture.blue.gain=-1"]), &held).is_err());
    let unknown = experiment(&["concentration.unobtainium=2"]);
    let said = resolve_captures(&rendered, &unknown, &held).unwrap_err().to_string();
    assert_eq!(said, resolve(&unknown).unwrap_err().to_string());
}
