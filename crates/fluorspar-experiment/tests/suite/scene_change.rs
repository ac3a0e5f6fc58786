//! Which changes of a study a component image can follow, and which need a new render.
#![allow(clippy::unwrap_used, reason = "these are tests")]

use fluorspar::pipeline::check_same_scene;
use fluorspar::study::Study;
use fluorspar_experiment::{Experiment, parse, resolve, resolve_captures, show_the_same_scene};

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
        "sensor.columns=160",
        "sensor.preset=\"monochrome_3_45um\"",
        "lens.f_number=2",
        "lens.focal_length_mm=4",
        &concentration,
    ] {
        let now = experiment(&[change]);
        let found = resolve_captures(&rendered, &now, &held).unwrap().unwrap_or_else(|| panic!("{change}"));
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
        // Both sensors are not as wide to their height as the image
        let is_warned_of = change.starts_with("sensor.");
        assert_eq!(found.warnings.len(), usize::from(is_warned_of), "{change}");
        assert!(found.warnings.iter().all(|warning| whole.record.warnings.contains(warning)), "{change}");
    }
    for change in [
        "material.patch.concentrations.fad=0.3",
        "light.blue.spectrum=\"led_405\"",
        "sensor.region_px=[0, 0, 80, 60]",
        "camera.horizontal_field_deg=50",
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

/// An image carries its experiment with all defaults written out: what was typed shows the same scene.
#[test]
fn an_experiment_as_typed_shows_what_its_file_says() {
    for base in ["oraleye-2021", "oraleye-2021-surface", "flat-patch"] {
        let typed = |changes: &[&str]| {
            let changes: Vec<String> = changes.iter().map(ToString::to_string).collect();
            let text = format!("format = 1\nbase = \"{base}\"");
            parse(&text, "typed", std::path::Path::new("."), &changes).unwrap()
        };
        // Of the image only its text is needed, which asks for no surfaces
        let text = resolve_captures(&typed(&[]), &typed(&[]), &[]).unwrap().unwrap().resolved_toml;
        let rendered = parse(&text, "image", std::path::Path::new("."), &[]).unwrap();
        assert!(
            show_the_same_scene(&rendered, &typed(&["view_filter.filters=[\"long_pass_500\"]"])),
            "{base}"
        );
        for change in ["lens.f_number=3", "camera.position_mm=[1, 2, 3]", "render.height_px=10"] {
            assert!(!show_the_same_scene(&rendered, &typed(&[change])), "{base}: {change}");
        }
    }
}
