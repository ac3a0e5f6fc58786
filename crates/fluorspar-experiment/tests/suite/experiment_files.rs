//! Bases, overrides, schema, digests and the absolute scale of lights.

use std::fs;
use std::path::Path;

use fluorspar::light::{DiscEmitter, Emitter, Light};
use fluorspar::scene::Shape;
use fluorspar::sensor::SensorMode;
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::schema::{EfficiencyReference, FilePath, NameOrTable};
use fluorspar_experiment::{
    LayersFile, ResolvedExperiment, SampleFile, SensorFile, Warning, json_schema, json_schema_of, parse,
    parse_sample, resolve,
};
use serde_json::Value;

fn resolved(text: &str, overrides: &[&str]) -> ResolvedExperiment {
    let overrides: Vec<String> = overrides.iter().map(|text| text.to_string()).collect();
    let experiment =
        parse(text, "test.toml", Path::new("."), &overrides).unwrap_or_else(|error| panic!("{error}"));
    resolve(&experiment).unwrap_or_else(|error| panic!("{error}"))
}

const FLAT: &str = "format = 1\nbase = \"flat-patch\"\n";

/// A quick scene: one gray sphere without fluorophores.
const SPHERE: &str = r#"
format = 1
[render]
width_px = 8
height_px = 6
[camera]
horizontal_field_deg = 30.0
[[light]]
name = "lamp"
type = "disc"
spectrum = { type = "led", peak_nm = 500.0, fwhm_short_nm = 20.0, fwhm_long_nm = 20.0 }
radius_mm = 2.0
position_mm = [0.0, 0.0, 100.0]
aim.direction = [0.0, 0.0, -1.0]
strength.power_mw = 100.0
[[material]]
name = "gray"
reflectance = 0.18
[[object]]
name = "ball"
material = "gray"
type = "sphere"
radius_mm = 10.0
"#;

#[test]
fn a_base_is_merged_by_key_and_by_name() {
    let text = r#"
format = 1
base = "flat-patch"
title = "mine"
[lens]
f_number = 2.0
[[light]]
name = "blue"
spectrum = "led_405"
[[light]]
name = "extra"
type = "environment"
spectrum = 1.0
strength.radiance_w_per_sr_m2 = 0.1
[[capture]]
name = "ambient"
remove = true
[[capture]]
name = "blue"
subtract = "none"
"#;
    let text = text.replace("subtract = \"none\"\n", "");
    let error = parse(&text, "t", Path::new("."), &[]).map(|e| resolve(&e)).unwrap().unwrap_err();
    assert!(error.to_string().contains("no earlier capture"), "{error}");
    let text = text.replace("name = \"ambient\"\nremove = true", "name = \"unused\"");
    let experiment = resolved(&text, &[]);
    assert_eq!(experiment.record.title, "mine");
    let lens = experiment.study.camera.lens.unwrap().equation;
    assert_eq!((lens.focal_length_mm, lens.f_number), (3.0, 2.0));
    let groups: Vec<&str> =
        experiment.study.scene.light_groups.iter().map(|group| group.name.as_str()).collect();
    assert_eq!(groups, ["blue", "extra"]);
    assert!((experiment.study.scene.lights[0].spectrum.peak_nm() - 405.0).abs() < 8.0);
    let labels: Vec<&str> =
        experiment.study.captures.iter().map(|capture| capture.frame.label.as_str()).collect();
    assert_eq!(labels, ["ambient", "blue", "unused"]);
}

#[test]
fn an_alternative_replaces_what_the_base_says() {
    let text = format!(
        "{FLAT}[[object]]\nname = \"patch\"\ntype = \"disc\"\nradius_mm = 50.0\n[sensor]\nread_noise_e = 2.0\n[spectral]\nedges_nm = [380, 400, 480, 700]"
    );
    let experiment = resolved(&text, &[]);
    assert!(
        matches!(experiment.study.scene.objects[0].shape, Shape::Disc { radius_m, .. } if radius_m == 0.05)
    );
    assert_eq!(experiment.study.camera.sensor.unwrap().model().read_noise_electrons(), 2.0);
    assert_eq!(experiment.study.scene.grid.len(), 3);
}

/// A monochrome camera, and a scene without its second light, on the default experiment: nothing of it is copied.
#[test]
fn what_a_base_says_can_be_unset() {
    let text = "format = 1\nbase = \"oraleye-2021\"\nunset = [\"light.white\", \"capture.white\", \"sensor.columns\", \
                \"sensor.rows\", \"analysis\", \"capture.*.subtract\"]\n[sensor]\npreset = \"monochrome_3_45um\"\n\
                [analysis]\nrectangle_px = [0, 0, 9, 9]\nframe = \"blue\"\n";
    let file = parse(text, "mine.toml", Path::new("."), &[]).unwrap().file;
    let names = |list: Vec<&str>| list.join(" ");
    assert_eq!(names(file.light.iter().map(|light| light.name.as_str()).collect()), "blue");
    assert_eq!(names(file.capture.iter().map(|capture| capture.name.as_str()).collect()), "ambient blue");
    assert!(file.capture.iter().all(|capture| capture.subtract.is_none()) && file.unset.is_empty());
    // What the file says itself stays, and nothing of the base is left below it.
    let analysis = file.analysis.unwrap();
    assert_eq!((analysis.place.parts.len(), analysis.place.rectangle_px), (0, Some([0, 0, 9, 9])));
    // The same by an override, which goes on top of everything.
    let over = ["unset light.white", "unset capture.white", "unset analysis"].map(String::from);
    let other = parse("format = 1\nbase = \"oraleye-2021\"\n", "mine.toml", Path::new("."), &over).unwrap();
    assert_eq!((other.file.light.len(), other.file.analysis), (1, None));
    assert_eq!(other.file.title, "OralEye 2021: an open mouth, changed");
}

#[test]
fn each_file_of_a_chain_of_bases_unsets_what_lies_below_it() {
    let folder = tempfile::tempdir().unwrap();
    let middle = "format = 1\nbase = \"flat-patch\"\nunset = [\"capture.ambient\", \"capture.blue.subtract\"]\n\
                  [[capture]]\nname = \"long\"\nexposure_ms = 90.0\n";
    fs::write(folder.path().join("middle.toml"), middle).unwrap();
    let read = |text: &str| {
        parse(&format!("format = 1\nbase = \"middle.toml\"\n{text}"), "top.toml", folder.path(), &[])
    };
    let names = |text: &str| {
        let file = read(text).unwrap().file;
        file.capture.into_iter().map(|capture| capture.name).collect::<Vec<_>>().join(" ")
    };
    assert_eq!(names(""), "blue long");
    // Of the file in the middle, and of the lowest one.
    assert_eq!(names("unset = [\"capture.long\"]"), "blue");
    assert_eq!(names("unset = [\"capture.blue\", \"analysis\"]"), "long");
    // What the file in the middle took away is not there any more; what it named itself is found with its line.
    let said = read("unset = [\"capture.ambient\"]").unwrap_err().to_string();
    assert!(
        said.starts_with("top.toml:3: unset = \"capture.ambient\": there is no capture \"ambient\""),
        "{said}"
    );
}

#[test]
fn overrides_reach_every_value() {
    let experiment = resolved(
        FLAT,
        &[
            "render.width_px=32",
            "light.blue.strength.irradiance_w_per_m2=20",
            "light[0].spectrum=led_405",
            "material.patch.concentrations.fad = { checker = [2, 3], high = 0.5 }",
            "sensor.quantum_efficiency=consumer_rgb_cmos",
            "sensor.mosaic=rggb",
            "view_filter.filters=[\"view_425_700\"]",
            "camera.position_mm=[0, 0, 50]",
            "capture.\"blue\".exposure_ms=auto",
            "title=any text, without quotes",
        ],
    );
    assert_eq!(experiment.study.scene.camera.width, 32);
    assert!((experiment.study.scene.lights[0].spectrum.total() - 20.0).abs() < 1e-9);
    assert_eq!(experiment.study.camera.sensor.unwrap().model().mosaic, [["R", "G"], ["G", "B"]]);
    assert!(experiment.study.camera.view_filter.transmittance.at(450.0) > 0.8);
    assert_eq!(experiment.study.scene.camera.position.z, 0.05);
    assert_eq!(experiment.study.captures[1].frame.exposure_ms, None);
    assert_eq!(experiment.record.title, "any text, without quotes");
}

#[test]
fn the_digest_follows_what_decides_the_result() {
    let base = resolved(SPHERE, &[]);
    assert_eq!(base.record.sha256.len(), 64);
    assert_eq!(
        base.record.sha256,
        resolved(SPHERE, &["title=other", "output.folder=elsewhere"]).record.sha256
    );
    assert_ne!(base.record.sha256, resolved(SPHERE, &["render.seed=2"]).record.sha256);
    assert_ne!(base.record.sha256, resolved(SPHERE, &["light.lamp.strength.power_mw=100.1"]).record.sha256);

    // The content of a file counts, not its place.
    let spectrum = "wavelength_nm,power\n400,1\n500,2\n600,1\n";
    let digest = |content: &str| {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("lamp.csv"), content).unwrap();
        let text = SPHERE.replace(
            "{ type = \"led\", peak_nm = 500.0, fwhm_short_nm = 20.0, fwhm_long_nm = 20.0 }",
            "\"lamp.csv\"",
        );
        let experiment = parse(&text, "t", folder.path(), &[]).unwrap();
        let first = resolve(&experiment).unwrap();
        assert_eq!(first.record.inputs.len(), 1);
        let again = resolve(&parse(&first.record.resolved_toml, "t", Path::new("/"), &[]).unwrap()).unwrap();
        assert_eq!(again.record.sha256, first.record.sha256);
        first.record.sha256
    };
    assert_eq!(digest(spectrum), digest(spectrum));
    assert_ne!(digest(spectrum), digest("wavelength_nm,power\n400,1\n500,3\n600,1\n"));
}

#[test]
fn a_spectrum_of_a_matlab_file_is_that_of_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let matlab = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fluorspar-format/tests/data/spectra_v5.mat");
    let curves = fluorspar_format::read_spectra(&matlab, &fluorspar_format::SpectrumOptions::default())
        .unwrap()
        .curves;
    fs::copy(&matlab, folder.path().join("lights.mat")).unwrap();
    for (index, curve) in curves.iter().enumerate() {
        let rows: String = curve
            .curve
            .wavelengths_nm()
            .iter()
            .zip(curve.curve.values())
            .map(|(nm, v)| format!("{nm},{v}\n"))
            .collect();
        fs::write(folder.path().join(format!("{index}.csv")), format!("wavelength_nm,power\n{rows}"))
            .unwrap();
    }
    let led = "{ type = \"led\", peak_nm = 500.0, fwhm_short_nm = 20.0, fwhm_long_nm = 20.0 }";
    let with = |spectrum: &str| {
        assert!(SPHERE.contains(led));
        resolve(&parse(&SPHERE.replace(led, spectrum), "t", folder.path(), &[]).unwrap())
    };
    let light = |spectrum: &str| with(spectrum).unwrap().study.scene.lights[0].spectrum.clone();
    assert_eq!(light("\"lights.mat\""), light("\"0.csv\""));
    assert_eq!(light("{ mat = \"lights.mat\", column = 2 }"), light("\"1.csv\""));
    assert_ne!(light("\"1.csv\""), light("\"0.csv\""));
    let error = with("{ mat = \"lights.mat\", column = 3 }").unwrap_err().to_string();
    assert!(
        error.contains("column") && error.contains("\"data\" has 2 columns; they count from 1"),
        "{error}"
    );
}

/// Irradiance of small discs at a point, on a surface that faces against `direction`.
fn irradiance_w_per_m2(lights: &[Light], point: glam::DVec3, direction: glam::DVec3) -> f64 {
    let one = |light: &Light| {
        let Emitter::Disc(DiscEmitter { center, normal, exponent, .. }) = &light.emitter else {
            panic!("no disc")
        };
        let way = point - center.as_dvec3();
        let cosine = way.normalize().dot(normal.as_dvec3());
        let g = f64::from(*exponent);
        let intensity = light.spectrum.total() * (g + 1.0) / (2.0 * std::f64::consts::PI) * cosine.powf(g);
        intensity * way.normalize().dot(direction) / way.length_squared()
    };
    lights.iter().map(one).sum()
}

#[test]
fn a_ring_gives_the_irradiance_of_eight_small_lights() {
    // Eight Lambertian watts on a circle of 35 mm: N P d^2 / (pi (d^2 + rho^2)^2) = 202 W/m2 at 100 mm.
    let text = SPHERE
        .replace("type = \"disc\"", "type = \"ring\"\nring_radius_mm = 35.0")
        .replace("strength.power_mw = 100.0", "strength.power_mw = 1000.0");
    let lights = resolved(&text, &[]).study.scene.lights;
    assert_eq!(lights.len(), 8);
    let irradiance = irradiance_w_per_m2(&lights, glam::DVec3::ZERO, glam::DVec3::NEG_Z);
    assert!((irradiance - 202.1).abs() < 0.1, "{irradiance}");

    // The same ring by its irradiance has the same power.
    let measured = text.replace(
        "strength.power_mw = 1000.0",
        "strength.irradiance_w_per_m2 = 202.1\nstrength.at_distance_mm = 100.0",
    );
    let power = resolved(&measured, &[]).study.scene.lights[0].spectrum.total();
    assert!((power - 1.0).abs() < 1e-3, "{power}");
}

#[test]
fn power_counts_before_the_filters_and_irradiance_behind_them() {
    let filtered = resolved(SPHERE, &["light.lamp.filters=[0.25]"]);
    assert!((filtered.study.scene.lights[0].spectrum.total() - 0.025).abs() < 1e-9);
    let distant = SPHERE
        .replace("type = \"disc\"", "type = \"distant\"\nfilters = [0.25]")
        .replace("radius_mm = 2.0\nposition_mm = [0.0, 0.0, 100.0]\n", "")
        .replace("strength.power_mw = 100.0", "strength.irradiance_w_per_m2 = 30.0");
    assert!((resolved(&distant, &[]).study.scene.lights[0].spectrum.total() - 30.0).abs() < 1e-9);
}

#[test]
fn lights_of_the_camera_move_with_it() {
    let text = format!("{SPHERE}\n[output]\nfolder = \"out\"")
        .replace("name = \"lamp\"", "name = \"lamp\"\nframe = \"camera\"");
    let text = text.replace("position_mm = [0.0, 0.0, 100.0]", "position_mm = [10.0, 20.0, 0.0]");
    let experiment =
        resolved(&text, &["camera.position_mm=[100, 0, 0]", "light.lamp.aim.direction=[0, 0, -1]"]);
    let Emitter::Disc(DiscEmitter { center, normal, .. }) = experiment.study.scene.lights[0].emitter else {
        panic!()
    };
    // Looking along -x with y up, right is -z.
    assert!((center - glam::Vec3::new(0.1, 0.02, -0.01)).length() < 1e-6, "{center}");
    assert!((normal + glam::Vec3::X).length() < 1e-6, "{normal}");
}

#[test]
fn the_field_of_view_is_that_of_the_sensor() {
    let experiment = resolved(FLAT, &[]);
    // 320 pixels of 2.5 um, s = f (1 + m) with m = 3/97.
    let expected = 0.5 * 0.8 / (3.0 * (1.0 + 3.0 / 97.0));
    assert!((f64::from(experiment.study.scene.camera.tan_half_width) - expected).abs() < 1e-6);
}

#[test]
fn a_box_is_closed_and_faces_outward() {
    let text = SPHERE.replace(
        "type = \"sphere\"\nradius_mm = 10.0",
        "type = \"box\"\ncenter_mm = [1, 2, 3]\nsize_mm = [10, 20, 30]",
    );
    let scene = resolved(&text, &[]).study.scene;
    let Shape::Mesh(mesh) = &scene.objects[0].shape else { panic!() };
    assert!((mesh.area_m2() - 2.0 * (0.01 * 0.02 + 0.02 * 0.03 + 0.01 * 0.03)).abs() < 1e-9);
    let center = glam::Vec3::new(0.001, 0.002, 0.003);
    let volume: f32 = mesh
        .triangles
        .iter()
        .map(|triangle| {
            (mesh.positions[triangle[0] as usize] - center).dot(mesh.triangle_cross(triangle)) / 6.0
        })
        .sum();
    assert!((volume - 6e-6).abs() < 1e-9, "{volume}");
}

#[test]
fn warnings_name_what_is_left_over() {
    let text = format!(
        "{SPHERE}[[material]]\nname = \"spare\"\nreflectance = 0.5\n[[fluorophore]]\nname = \"dye\"\nsource = \"fad\"\n"
    );
    let warnings = resolved(&text, &["spectral.last_nm=900"]).record.warnings;
    assert!(
        warnings
            .iter()
            .any(|w| w.text() == "test.toml:24: material[1] \"spare\": no object uses material \"spare\""),
        "{warnings:?}"
    );
    assert!(
        warnings.iter().any(|w| w.contains("fluorophore[0] \"dye\": no material contains it")),
        "{warnings:?}"
    );
}

#[test]
fn a_fluorophore_from_files_has_the_stated_yield() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(
        folder.path().join("dye.csv"),
        "wavelength_nm,excitation,emission\n350,0,0\n400,5,0\n450,1,0\n500,0,1\n550,0,3\n600,0,0\n",
    )
    .unwrap();
    fs::write(
        folder.path().join("eem.csv"),
        "# unit: energy\nem_nm\\ex_nm,380,400,420\n480,0,0,0\n500,1,2,1\n520,0,0,0\n",
    )
    .unwrap();
    let text = format!(
        "{SPHERE}[[fluorophore]]\nname = \"dye\"\nsource = {{ csv = \"dye.csv\" }}\nphoton_yield = 0.1\n[[fluorophore]]\nname = \"matrix\"\nsource = {{ eem_csv = \"eem.csv\" }}\nphoton_yield = 0.02\n"
    );
    let overrides = ["material.gray.concentrations={ dye = 1.0, matrix = 2.0 }".to_string()];
    let experiment = parse(&text, "t", folder.path(), &overrides).unwrap();
    let scene = resolve(&experiment).unwrap().study.scene;
    let best = |index: usize| {
        (350..460)
            .map(|nm| scene.fluorophores[index].photon_yield(f64::from(nm), 200.0, 1000.0))
            .fold(0.0, f64::max)
    };
    assert!((best(0) - 0.1).abs() < 1e-6, "{}", best(0));
    assert!((best(1) - 0.02).abs() < 1e-4, "{}", best(1));
}

/// Excitation that ends at 460 nm with 15 % of its peak, emission that ends in zeros: only the former is told.
#[test]
fn measured_fluorophores_that_go_on_beyond_their_data_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let matrix = "# unit: photons\nem_nm\\ex_nm,380,400,460\n480,0,0,0\n500,0,2,0.3\n520,0,0,0\n";
    fs::write(folder.path().join("eem.csv"), matrix).unwrap();
    let text = format!(
        "{SPHERE}[[fluorophore]]\nname = \"dye\"\nsource = {{ eem_csv = \"eem.csv\" }}\nphoton_yield = 0.02\n"
    );
    let warned = |last_nm: u32| {
        let overrides = [
            "material.gray.concentrations={ dye = 1.0 }".to_string(),
            "spectral.first_nm=380".to_string(),
            format!("spectral.last_nm={last_nm}"),
        ];
        let experiment = parse(&text, "t", folder.path(), &overrides).unwrap();
        let warnings = resolve(&experiment).unwrap().record.warnings;
        assert!(warnings_with(&warnings, "emission of dye").is_empty(), "{warnings:?}");
        warnings_with(&warnings, "excitation of dye, 15 % of its peak at 460 nm (380 to 460 nm)").len()
    };
    assert_eq!([warned(600), warned(460)], [1, 0]);
}

#[test]
fn a_dye_is_the_same_as_a_matrix_and_as_two_spectra_in_either_unit() {
    let folder = tempfile::tempdir().unwrap();
    let (ex_nm, ex) = ([340.0, 380.0, 420.0, 460.0], [0.2, 1.0, 0.7, 0.0]);
    let (em_nm, em) = ([480.0, 520.0, 580.0, 660.0], [0.0, 1.0, 0.6, 0.0]);
    let table = |head: &str, nm: &[f64], value: &[f64]| {
        let rows: String = nm.iter().zip(value).map(|(nm, value)| format!("{nm},{value}\n")).collect();
        format!("wavelength_nm,{head}\n{rows}")
    };
    fs::write(folder.path().join("ex.csv"), table("excitation", &ex_nm, &ex)).unwrap();
    fs::write(folder.path().join("em.csv"), table("emission", &em_nm, &em)).unwrap();
    let header: String = ex_nm.iter().map(|nm| format!(",{nm}")).collect();
    let rows: String = em_nm
        .iter()
        .zip(&em)
        .map(|(nm, em)| format!("{nm}{}\n", ex.iter().map(|ex| format!(",{}", ex * em)).collect::<String>()))
        .collect();
    for unit in ["photons", "energy"] {
        let matrix = format!("# unit: {unit}\nem_nm\\ex_nm{header}\n{rows}");
        fs::write(folder.path().join("matrix.csv"), matrix).unwrap();
        let text = format!(
            "{SPHERE}[[fluorophore]]\nname = \"matrix\"\nsource = {{ eem_csv = \"matrix.csv\" }}\nphoton_yield = 0.1\n\
             [[fluorophore]]\nname = \"spectra\"\nsource = {{ excitation_csv = \"ex.csv\", emission_csv = \"em.csv\", unit = \"{unit}\" }}\n\
             photon_yield = 0.1\n"
        );
        let overrides = ["material.gray.concentrations={ matrix = 1.0, spectra = 1.0 }".to_string()];
        let scene = resolve(&parse(&text, "t", folder.path(), &overrides).unwrap()).unwrap().study.scene;
        let at = |dye: usize, em_nm: f64, ex_nm: f64| scene.fluorophores[dye].eem.at(em_nm, ex_nm);
        let scale = at(0, 520.0, 380.0);
        for ex_nm in [345.0, 360.0, 380.0, 400.0, 431.0] {
            for em_nm in [490.0, 520.0, 555.0, 600.0] {
                let (matrix, spectra) = (at(0, em_nm, ex_nm), at(1, em_nm, ex_nm));
                // Both interpolate linearly between the same points; the yield of each is found on whole nanometers.
                assert!(
                    (matrix - spectra).abs() < 1e-3 * scale,
                    "{unit} {ex_nm} {em_nm}: {matrix} {spectra}"
                );
            }
        }
        // In energy, light of longer wavelength holds more photons, so the yield per photon falls with it.
        let ratio = at(1, 520.0, 420.0) / at(1, 520.0, 380.0);
        let expected = if unit == "energy" { 0.7 * 380.0 / 420.0 } else { 0.7 };
        assert!((ratio - expected).abs() < 1e-9, "{unit}: {ratio}");
    }
}

#[test]
fn another_sensor_takes_the_place_of_the_whole_section() {
    let size = |resolved: &ResolvedExperiment| {
        let model = resolved.study.camera.sensor.as_ref().unwrap().model();
        (model.columns, model.rows)
    };
    let plain = resolved(FLAT, &[]);
    assert_eq!(size(&plain), (320, 240));
    let own = resolved(
        "format = 1\n[render]\nwidth_px = 64\nheight_px = 48\n[camera]\nhorizontal_field_deg = 40.0\n[lens]\n[sensor]\n\
         preset = \"monochrome_4_8um\"\n[[light]]\nname = \"sun\"\ntype = \"distant\"\nspectrum = 1.0\n\
         aim.direction = [0.0, 0.0, -1.0]\nstrength.irradiance_w_per_m2 = 1.0\n[[material]]\nname = \"gray\"\nreflectance = 0.2\n\
         [[object]]\nname = \"ball\"\nmaterial = \"gray\"\ntype = \"sphere\"\nradius_mm = 10.0\n",
        &[],
    );
    let of_catalogue = |name: &str| EfficiencyReference::Text(NameOrTable::Name(name.into()));
    // An image of another shape than the sensor's is told with the number to set.
    let wide = resolved(FLAT, &["render.width_px=320", "render.height_px=100"]).record.warnings;
    assert_eq!(warnings_with(&wide, "Give render.height_px = 240").len(), 1, "{wide:?}");
    let no_analysis = FLAT.replace("flat-patch", "velscope-like");
    for text in [FLAT, &no_analysis] {
        let experiment =
            parse(text, "t", Path::new("."), &["sensor.preset=monochrome_4_8um".into()]).unwrap();
        let section = experiment.file.sensor.unwrap();
        assert_eq!(section.quantum_efficiency, of_catalogue("monochrome_cmos"), "{text}");
        assert_eq!((section.model.columns, section.model.rows), size(&own), "{text}");
    }
    let over = format!("{FLAT}[sensor]\npreset = \"monochrome_4_8um\"\nrows = 100\n");
    let section = parse(&over, "t", Path::new("."), &[]).unwrap().file.sensor.unwrap();
    assert_eq!((section.model.columns, section.model.rows), (size(&own).0, 100));
    // Values given by the user are kept, in any order; the same preset changes nothing; a resolved file behaves the same.
    let change = ["sensor.rows=24".to_string(), "sensor.preset=monochrome_4_8um".to_string()];
    let section = parse(FLAT, "t", Path::new("."), &change).unwrap().file.sensor.unwrap();
    assert_eq!((section.model.columns, section.model.rows), (size(&own).0, 24));
    assert_eq!(size(&resolved(FLAT, &["sensor.preset=lyu_2021_table_1"])), (320, 240));
    let section =
        parse(&plain.record.resolved_toml, "t", Path::new("."), &change[1..]).unwrap().file.sensor.unwrap();
    assert_eq!(section.quantum_efficiency, of_catalogue("monochrome_cmos"));
}

#[test]
fn what_only_the_analysis_names_is_still_known_to_it() {
    let control = |change: &str| {
        let resolved = resolved(FLAT, &[change]);
        let analysis = resolved.study.analysis.unwrap();
        let held = resolved.study.scene.fluorophores;
        let absent = analysis.fluorophores.iter().filter(|f| !held.contains(f));
        (absent.map(|f| f.name.clone()).collect::<Vec<_>>(), held.len())
    };
    assert_eq!(control("render.seed=1"), (vec![], 5));
    let none = "material.patch.concentrations.protoporphyrin_ix=0";
    assert_eq!(control(none), (vec!["protoporphyrin_ix".into()], 4));
    let none = "material.patch.concentrations.protoporphyrin_ix={ dorsal_tongue = { peak = 0.0 } }";
    assert_eq!(control(none), (vec!["protoporphyrin_ix".into()], 4));
    assert_eq!(control("analysis.bulk={ nadh = 1.0 }"), (vec!["nadh".into()], 5));
}

/// An analysis that names no porphyrin means the one of the scene, and its bulk is without it.
#[test]
fn the_porphyrin_of_the_scene_is_meant_where_none_is_named() {
    let other = "material.patch.concentrations={ elastin = 1.0, biofilm_porphyrin = 0.1 }";
    let analysis = resolved(FLAT, &[other]).study.analysis.unwrap();
    assert_eq!(analysis.porphyrin.as_deref(), Some("biofilm_porphyrin"));
    assert_eq!(analysis.bulk, [("elastin".to_owned(), 1.0)]);
    let none = "material.patch.concentrations={ elastin = 1.0 }";
    let analysis = resolved(FLAT, &[none]).study.analysis.unwrap();
    assert_eq!(analysis.porphyrin.as_deref(), Some("protoporphyrin_ix"));
    let named = resolved(FLAT, &[other, "analysis.porphyrin=none"]).study.analysis.unwrap();
    assert_eq!(named.porphyrin, None);
}

#[test]
fn the_bulk_counts_maps_by_their_mean() {
    let bulk = |change: &str| resolved(FLAT, &[change]).study.analysis.unwrap().bulk;
    let amount = |bulk: &[(String, f64)], name: &str| bulk.iter().find(|(n, _)| n == name).map(|(_, a)| *a);
    let plain = bulk("render.seed=1");
    assert_eq!(amount(&plain, "elastin"), Some(1.0));
    assert_eq!(amount(&plain, "protoporphyrin_ix"), None);
    // Half of the fields of a checkerboard are low and half high.
    let checker = bulk("material.patch.concentrations.elastin={ checker = [4, 6], low = 0.4, high = 1.0 }");
    let elastin = amount(&checker, "elastin").unwrap();
    assert!((elastin - 0.7).abs() < 0.01, "{elastin}");
    assert_eq!(checker.len(), plain.len());
    let noise = bulk("material.patch.concentrations.elastin={ noise = [40, 40], low = 0.5, high = 1.5 }");
    let elastin = amount(&noise, "elastin").unwrap();
    // Value noise is symmetric about its middle; 1600 cells of its coarsest octave leave about 0.01 of it to chance.
    assert!((elastin - 1.0).abs() < 0.03, "{elastin}");
}

/// The warnings that hold a word.
fn warnings_with<'w>(warnings: &'w [Warning], word: &str) -> Vec<&'w Warning> {
    warnings.iter().filter(|warning| warning.contains(word)).collect()
}

#[test]
fn one_warning_names_all_spectra_that_the_grid_exceeds() {
    let warnings =
        resolved("format = 1\nbase = \"oraleye-2021-surface\"\n", &["spectral.last_nm=900"]).record.warnings;
    let exceeded = warnings_with(&warnings, "beyond their own range");
    assert_eq!(exceeded.len(), 1, "{warnings:#?}");
    assert!(
        exceeded[0].contains("347.5 to 902.5 nm") && exceeded[0].contains("tongue_dorsum"),
        "{exceeded:?}"
    );
    assert_eq!(warnings_with(&warnings, "some fluorescence is extrapolated").len(), 1);
    let emission = warnings_with(&warnings, "some fluorescence is extrapolated")[0];
    assert!(emission.contains("of collagen (measured from 290 to 750 nm)"), "{emission}");
}

#[test]
fn light_beyond_either_end_of_the_excitation_data_is_warned_about() {
    let text = |led: &str| {
        format!(
            "format = 1\n[light]\nspectrum = \"{led}\"\nstrength.irradiance_w_per_m2 = 100.0\n[sample]\nreflectance = 0.1\n\
             concentrations = {{ nadh = 1.0, fad = 1.0 }}\n"
        )
    };
    let warnings = |led: &str| parse_sample(&text(led), "s", Path::new("."), &[]).unwrap().record.warnings;
    let above = warnings("led_450");
    let above = warnings_with(&above, "excites is extrapolated");
    assert!(above.len() == 1 && above[0].contains("% beyond 250 to 430 nm (nadh)"), "{above:?}");
    assert!(!above[0].contains("fad"), "{above:?}");
    assert_eq!(warnings_with(&warnings("led_385"), "excites is").len(), 0);
    let below = text("led_385").replace("nadh = 1.0, fad", "protoporphyrin_ix");
    let below = below.replace(
        "\"led_385\"",
        "{ type = \"led\", peak_nm = 310.0, fwhm_short_nm = 10.0, fwhm_long_nm = 10.0 }",
    );
    let overrides = ["spectral.first_nm=250".to_string()];
    let below = parse_sample(&below, "s", Path::new("."), &overrides).unwrap().record.warnings;
    assert!(warnings_with(&below, "% beyond 330 to 640 nm (protoporphyrin_ix)").len() == 1, "{below:?}");
}

#[test]
fn words_about_another_experiment_do_not_stay() {
    let record = |text: &str, overrides: &[&str]| resolved(text, overrides).record;
    let base = record("format = 1\nbase = \"flat-patch\"\n", &[]);
    assert_eq!((base.title.as_str(), base.description.as_str()), ("Flat patch, changed", ""));
    let own = record("format = 1\nbase = \"flat-patch\"\ntitle = \"Mine\"\ndescription = \"Own.\"\n", &[]);
    assert_eq!((own.title.as_str(), own.description.as_str()), ("Mine", "Own."));
    // More samples are no other experiment, another light is.
    let more = ["render.samples_per_pixel=2"];
    assert_eq!(record("format = 1\nbase = \"flat-patch\"\ntitle = \"Mine\"\n", &more).title, "Mine");
    let other = ["light.blue.spectrum=led_405"];
    assert_eq!(
        record("format = 1\nbase = \"flat-patch\"\ntitle = \"Mine\"\n", &other).title,
        "Mine, changed"
    );
}

#[test]
fn a_warning_of_many_lights_and_fluorophores_can_be_read() {
    let text = "format = 1\nbase = \"oraleye-2021-surface\"\n";
    // The frame of white light is one of reflected light: there it changes no result.
    let unharmed = resolved(text, &[]).record.warnings;
    assert_eq!(warnings_with(&unharmed, "excites is extrapolated").len(), 0, "{unharmed:#?}");
    let without = format!("{text}[[capture]]\nname = \"white\"\nremove = true\n");
    let warnings = resolved(&without, &[]).record.warnings;
    let excitation = warnings_with(&warnings, "excites is extrapolated");
    // One sentence per light, without the numbers of its emitters; fluorophores of one measurement together.
    assert_eq!(excitation.len(), 1, "{warnings:#?}");
    let text = excitation[0];
    assert!(
        text.contains("of the light \"white\" 65 % beyond 250 to 520 nm (collagen, elastin), "),
        "{text}"
    );
    assert!(text.matches("of the light").count() == 1 && !text.contains("[0]"), "{text}");
    // Names become numbers where one line must do.
    let summary = excitation[0].summary();
    assert!(summary.starts_with("the excitation of ") && summary.contains("by 1 light is"), "{summary}");
    assert!(summary.len() < 100 && excitation[0].has_details(), "{summary}");
}

#[test]
fn equations_that_stand_on_data_say_where_those_end() {
    let blood = "{ type = \"blood_diffuse\", scattering_per_cm = 20.0, scattering_power = 1.0, background_per_cm = 0.3, \
                 background_decay_nm = 100.0, blood_fraction = 0.03, saturation = 0.7, vessel_radius_um = 10.0, \
                 superficial_blood_um = 1.0 }";
    let change = format!("material.gray.reflectance={blood}");
    let warnings = |last: &str| resolved(SPHERE, &[&change, last]).record.warnings;
    assert_eq!(warnings_with(&warnings("spectral.last_nm=750"), "their own range").len(), 0);
    let exceeded = warnings("spectral.last_nm=900");
    let exceeded = warnings_with(&exceeded, "their own range");
    assert!(exceeded.len() == 1 && exceeded[0].contains("reflectance (350 to 750 nm)"), "{exceeded:?}");
}

#[test]
fn a_sample_becomes_curves() {
    let text = r#"
format = 1
[light]
spectrum = "led_385"
filters = ["short_pass_425"]
strength.irradiance_w_per_m2 = 100.0
[sample]
reflectance = "tongue_dorsum"
concentrations = { elastin = 1.0, protoporphyrin_ix = 0.1 }
[view_filter]
filters = ["view_475_700"]
[lens]
f_number = 4.0
[sensor]
preset = "lyu_2021_table_1"
[exposure]
exposure_ms = 30.0
"#;
    let sample = parse_sample(text, "sample.toml", Path::new("."), &["exposure.gain=2".into()])
        .unwrap_or_else(|e| panic!("{e}"));
    assert!((sample.sample.irradiance.total() - 100.0).abs() < 1e-9);
    assert_eq!(sample.sample.fluorophores.len(), 2);
    assert_eq!(sample.sample.fluorophores[1].1, 0.1);
    assert_eq!(sample.sample.exposure.gain, 2.0);
    assert_eq!(sample.sample.camera.lens.as_ref().unwrap().equation.object_distance_mm, None);
    let again = parse_sample(&sample.record.resolved_toml, "again", Path::new("/"), &[])
        .unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(
        (&again.record.sha256, &again.record.resolved_toml),
        (&sample.record.sha256, &sample.record.resolved_toml)
    );

    let toolbox =
        parse_sample(text, "sample.toml", Path::new("."), &["compatibility=toolbox_eem".into()]).unwrap();
    assert_eq!((toolbox.sample.grid.len(), toolbox.sample.grid.center_nm(0)), (69, 365.0));
    let isetcam =
        parse_sample(text, "sample.toml", Path::new("."), &["compatibility=isetcam".into()]).unwrap();
    assert_eq!(isetcam.sample.camera.sensor.unwrap().model().mode, SensorMode::Isetcam { noise_flag: 0 });

    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("white.csv"), "wavelength_nm,radiance\n380,0\n385,2\n390,0\n").unwrap();
    let text = "format = 1\n[light]\nspectrum = \"white.csv\"\nstrength.measured = \"white_radiance\"\n[sample]\nreflectance = 0.1\n";
    let sample = parse_sample(text, "sample.toml", folder.path(), &[]).unwrap_or_else(|e| panic!("{e}"));
    assert!((sample.sample.irradiance.total() - 10.0 * std::f64::consts::PI).abs() < 1e-9);
}

#[test]
fn every_field_of_the_schema_is_described() {
    for schema in [
        json_schema(),
        json_schema_of::<SampleFile>(),
        json_schema_of::<SensorFile>(),
        json_schema_of::<LayersFile>(),
    ] {
        let mut missing = Vec::new();
        let definitions = schema["$defs"].as_object().unwrap().iter();
        for (name, definition) in definitions.chain([(&"root".to_string(), &schema)]) {
            for (field, property) in definition["properties"].as_object().into_iter().flatten() {
                if property.get("description").is_none() {
                    missing.push(format!("{name}.{field}"));
                }
            }
        }
        assert!(missing.is_empty(), "{missing:?}");
    }
}

/// Checks a value against the part of JSON schema that is in use here.
fn check(schema: &Value, root: &Value, value: &Value, at: &str) -> Result<(), String> {
    if let Some(reference) = schema.get("$ref").and_then(Value::as_str) {
        check(root.pointer(&reference[1..]).ok_or(reference)?, root, value, at)?;
    }
    for (key, enough) in [("anyOf", true), ("oneOf", true), ("allOf", false)] {
        let Some(options) = schema.get(key).and_then(Value::as_array) else { continue };
        let results: Vec<_> = options.iter().map(|option| check(option, root, value, at)).collect();
        if enough && results.iter().all(Result::is_err) {
            return Err(format!("{at}: fits none of {key}: {results:?}"));
        }
        if !enough {
            results.into_iter().collect::<Result<Vec<()>, String>>()?;
        }
    }
    if let Some(constant) = schema.get("const")
        && constant != value
    {
        return Err(format!("{at}: {value} is not {constant}"));
    }
    if let Some(allowed) = schema.get("enum").and_then(Value::as_array)
        && !allowed.contains(value)
    {
        return Err(format!("{at}: {value} is not one of {allowed:?}"));
    }
    let kinds: Vec<&str> = match schema.get("type") {
        Some(Value::String(kind)) => vec![kind],
        Some(Value::Array(kinds)) => kinds.iter().filter_map(Value::as_str).collect(),
        _ => Vec::new(),
    };
    let fits = |kind: &&str| match *kind {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "number" => value.is_number(),
        "integer" => value.is_u64() || value.is_i64(),
        "boolean" => value.is_boolean(),
        "null" => value.is_null(),
        _ => false,
    };
    if !kinds.is_empty() && !kinds.iter().any(fits) {
        return Err(format!("{at}: {value} is not {kinds:?}"));
    }
    if let (Some(items), Some(list)) = (schema.get("items"), value.as_array()) {
        for (index, item) in list.iter().enumerate() {
            check(items, root, item, &format!("{at}[{index}]"))?;
        }
    }
    if let (Some(properties), Some(table)) =
        (schema.get("properties").and_then(Value::as_object), value.as_object())
    {
        for (key, item) in table {
            match (properties.get(key), schema.get("additionalProperties")) {
                (Some(property), _) => check(property, root, item, &format!("{at}.{key}"))?,
                (None, Some(Value::Bool(false))) => return Err(format!("{at}: unknown {key}")),
                (None, Some(other)) => check(other, root, item, &format!("{at}.{key}"))?,
                (None, None) => {}
            }
        }
        for required in schema.get("required").and_then(Value::as_array).into_iter().flatten() {
            if !required.as_str().is_some_and(|key| table.contains_key(key)) {
                return Err(format!("{at}: {required} is missing"));
            }
        }
    }
    Ok(())
}

#[test]
fn experiments_fit_the_schema() {
    let schema = json_schema();
    for name in preset::names(preset::PresetKind::Experiment) {
        let text = preset::text(PresetKind::Experiment, name).unwrap();
        let experiment = parse(text, name, Path::new("."), &[]).unwrap();
        for value in [serde_json::to_value(&experiment.file).unwrap(), toml::from_str(text).unwrap()] {
            // A file on a base need not be complete by itself.
            if value.get("base").is_none() {
                check(&schema, &schema, &value, name).unwrap_or_else(|error| panic!("{error}"));
            }
        }
    }
    let wrong = serde_json::json!({ "light": [{ "name": "x", "type": "rign", "spectrum": 1 }] });
    assert!(check(&schema, &schema, &wrong, "wrong").is_err());
    let wrong = serde_json::json!({ "sensor": { "pixelsize_um": 1 } });
    assert!(check(&schema, &schema, &wrong, "wrong").is_err());
}

#[test]
fn odd_values_anywhere_are_errors_and_never_panics() {
    let odd = [
        "nan",
        "inf",
        "-inf",
        "-1",
        "0",
        "1e308",
        "1e-308",
        "\"\"",
        "\"x\"",
        "[]",
        "{}",
        "true",
        "1979-05-27",
        "99999999999999999999",
        "[[[]]]",
    ];
    let scene = SPHERE.to_string()
        + "[[fluorophore]]\nname = \"dye\"\nsource = \"nadh\"\n[output]\nfolder = \"x\"\n[view_filter]\nangle_deg = 3.0\n";
    let lines: Vec<&str> = scene.lines().collect();
    for (index, line) in lines.iter().enumerate() {
        for value in odd {
            let mut changed: Vec<String> = lines.iter().map(|line| line.to_string()).collect();
            changed[index] = match line.split_once(" = ") {
                Some((key, _)) => format!("{key} = {value}"),
                None => value.to_string(),
            };
            if let Ok(experiment) = parse(&changed.join("\n"), "odd.toml", Path::new("."), &[]) {
                let _ = resolve(&experiment);
            }
        }
        let cut: usize = lines[..index].iter().map(|line| line.len() + 1).sum::<usize>() + line.len() / 2;
        let _ = parse(&scene[..cut], "cut.toml", Path::new("."), &[]).map(|experiment| resolve(&experiment));
    }
    for text in [
        "=",
        "a=",
        "..=1",
        "[=1",
        "light.[0].x=2",
        "light[=3",
        "\u{0}=1",
        "render=\n[x]",
        "light=3",
        "a.b.c.d=1",
    ] {
        let _ = parse(SPHERE, "set.toml", Path::new("."), &[text.to_string()])
            .map(|experiment| resolve(&experiment));
    }
}

#[test]
fn oraleye_light_and_sensor_are_as_documented() {
    let text = "format = 1\nbase = \"oraleye-2021\"";
    let experiment = parse(text, "t", Path::new("."), &[]).unwrap();
    let scene = resolve(&experiment).unwrap().study.scene;
    let blue: Vec<_> = scene.lights.iter().filter(|light| light.name.light() == "blue").cloned().collect();
    assert_eq!(blue.len(), 8);
    let passed = blue[0].spectrum.total() / 2.0;
    assert!((passed - 0.94).abs() < 0.01, "the filter passes {passed}");
    let camera = &scene.camera;
    let on_axis = |distance_m: f64| {
        let point = camera.position.as_dvec3() + camera.forward.as_dvec3() * distance_m;
        irradiance_w_per_m2(&blue, point, camera.forward.as_dvec3())
    };
    assert!((on_axis(0.10) - 1.61e3).abs() < 30.0, "{}", on_axis(0.10));
    assert!((on_axis(0.13) - 1.03e3).abs() < 20.0, "{}", on_axis(0.13));
    let field_mm = 2.0 * 100.0 * f64::from(scene.camera.tan_half_width);
    assert!((75.0..80.0).contains(&field_mm), "{field_mm}");
    assert!(scene.objects.iter().any(|object| object.name == "tongue_dorsum"));
}

/// Parts with a spot have copies of their materials: those in the file are used by them.
#[test]
fn materials_under_a_lesion_are_not_left_over() {
    let text = "format = 1\nbase = \"oraleye-2021\"\n[[mouth.lesion]]\nname = \"spot\"\npart = \"tongue_lateral_left\"\n\
                center = [0.9, 0.5]\nsize_mm = [12, 7]\n[[material]]\nname = \"putty\"\nreflectance = 0.5\n";
    let warnings = resolved(text, &["mouth.detail=0.25"]).record.warnings;
    let unused = warnings_with(&warnings, "no object uses material");
    assert!(unused.len() == 1 && unused[0].contains("putty"), "{warnings:?}");
}

/// A painted lesion lies beside its experiment, wherever the program is started.
#[test]
fn the_mask_of_a_lesion_is_relative_to_the_experiment_file() {
    let text = "format = 1\nbase = \"oraleye-2021\"\n[[mouth.lesion]]\nname = \"spot\"\npart = \"tongue_dorsum\"\nmask = \"spot.png\"\n";
    let experiment = parse(text, "test.toml", Path::new("/patients/seven"), &[]).unwrap();
    let mouth = experiment.file.mouth.as_ref().unwrap();
    assert_eq!(mouth.lesion[0].mask.as_ref().map(FilePath::as_str), Some("/patients/seven/spot.png"));
}

#[test]
fn a_scan_in_a_wrong_unit_and_a_mask_in_colors_are_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    // A prism of 60 mm, in a file in meters.
    let scan = folder.path().join("arch.obj");
    std::fs::write(
        &scan,
        "v 0 0 0\nv 0.06 0 0\nv 0 0.04 0\nv 0 0 0.01\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n",
    )
    .unwrap();
    let of = |unit: &str| {
        let text = format!(
            "format = 1\nbase = \"oraleye-2021\"\n[mouth]\ndetail = 0.25\n[[mouth.scan]]\nname = \"arch\"\nmesh = {scan:?}\n\
             replaces = [\"tooth_1*\"]\nmaterial = \"tooth\"\n{unit}"
        );
        resolved(&text, &[]).record.warnings
    };
    let small = of("");
    assert_eq!(warnings_with(&small, "unit_mm").len(), 1, "{small:?}");
    assert!(warnings_with(&small, "unit_mm")[0].contains("set unit_mm = 1000.0"), "{small:?}");
    let large = of("unit_mm = 1e6\n");
    assert!(warnings_with(&large, "unit_mm")[0].contains("set unit_mm = 1000.0"), "{large:?}");
    let right = of("unit_mm = 1000.0\n");
    assert_eq!(warnings_with(&right, "unit_mm").len(), 0, "{right:?}");

    let mask = folder.path().join("mask.png");
    let of = |pixels: &[u8]| {
        fluorspar_format::write_rgb_png(&mask, 2, 1, pixels).unwrap();
        let text = format!(
            "format = 1\nbase = \"oraleye-2021\"\n[mouth]\ndetail = 0.25\n[[mouth.lesion]]\nname = \"spot\"\npart = \"cheek_left\"\n\
             mask = {mask:?}\nstates = [\"hyperemia\"]\n"
        );
        resolved(&text, &[]).record.warnings
    };
    let colored = of(&[255, 0, 0, 0, 0, 0]);
    assert_eq!(warnings_with(&colored, "mean of red, green and blue").len(), 1, "{colored:?}");
    let gray = of(&[255, 255, 255, 0, 0, 0]);
    assert_eq!(warnings_with(&gray, "mean of red").len(), 0, "{gray:?}");
}

/// Results carry the digests of what they were made from: they are not taken for those of another file of the same name.
#[test]
fn files_that_have_changed_since_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let write = |file: &str, content: &str| fs::write(folder.path().join(file), content).unwrap();
    let lamp = |peak: f64| format!("wavelength_nm,power\n490,0\n500,{peak}\n510,0\n");
    write("lamp.csv", &lamp(1.0));
    write("filter.csv", "wavelength_nm,transmittance\n300,0.5\n900,0.5\n");
    let text = SPHERE.replace(
        "{ type = \"led\", peak_nm = 500.0, fwhm_short_nm = 20.0, fwhm_long_nm = 20.0 }",
        "\"lamp.csv\"",
    ) + "[view_filter]\nfilters = [\"filter.csv\"]\n";
    let open = |text: &str, sets: &[String]| parse(text, "test.toml", folder.path(), sets);
    let first = resolve(&open(&text, &[]).unwrap()).unwrap().record;
    let again = resolve(&open(&first.resolved_toml, &[]).unwrap()).unwrap().record;
    assert_eq!((&again.sha256, &again.resolved_toml), (&first.sha256, &first.resolved_toml));
    // A viewing filter decides frames alone
    write("filter.csv", "wavelength_nm,transmittance\n300,0.4\n900,0.5\n");
    resolve(&open(&first.resolved_toml, &[]).unwrap()).unwrap();
    // One before a light as well decides the render
    let both = text.replace("\"lamp.csv\"", "\"lamp.csv\"\nfilters = [\"filter.csv\"]");
    let both = resolve(&open(&both, &[]).unwrap()).unwrap().record.resolved_toml;
    write("filter.csv", "wavelength_nm,transmittance\n300,0.3\n900,0.5\n");
    let error = resolve(&open(&both, &[]).unwrap()).unwrap_err().to_string();
    assert!(error.contains("filter.csv has changed since"), "{error}");
    write("lamp.csv", &lamp(2.0));
    let error = resolve(&open(&first.resolved_toml, &[]).unwrap()).unwrap_err().to_string();
    assert!(error.contains("lamp.csv has changed since") && error.contains("--unset files"), "{error}");
    assert!(resolve(&open(&text, &[]).unwrap()).unwrap().record.sha256 != first.sha256);
}
