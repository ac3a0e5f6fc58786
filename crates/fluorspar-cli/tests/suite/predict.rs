//! `fluorspar predict` against the equations and against the authors' toolbox.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "these are tests")]

use std::f64::consts::PI;
use std::fs;
use std::path::Path;

use crate::support::{fluorspar, reference};
use serde_json::Value;

fn predicted(folder: &Path, args: &[&str]) -> Value {
    let mut all = vec!["predict", "--json"];
    all.extend(args);
    fluorspar(folder, all).json()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

/// Columns of a table by name.
fn columns(path: &Path) -> Vec<(String, Vec<f64>)> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let mut columns: Vec<(String, Vec<f64>)> =
        lines.next().unwrap().split(',').map(|name| (name.into(), Vec::new())).collect();
    for line in lines {
        for (column, cell) in columns.iter_mut().zip(line.split(',')) {
            column.1.push(cell.parse().unwrap());
        }
    }
    columns
}

#[test]
fn emission_under_the_led_is_that_of_the_authors_toolbox() {
    let Some(reference) = reference() else {
        println!("skipped: no reference data (set FLUORSPAR_REFERENCE to their folder)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let expected = columns(&reference.join("derived/emission_under_led385_energy.csv"));
    let sources = [
        ("fad", "fad_webfluor"),
        ("nadh", "nadh_webfluor"),
        ("collagen1", "collagen1"),
        ("elastin", "elastin_webfluor"),
        ("porphyrins_monici", "porphyrinsmonici"),
        ("protoporphyrin", "protoporphyrin"),
    ];
    let mut text = format!(
        "format = 1\ncompatibility = \"toolbox_eem\"\n[light]\nspectrum = \"{}\"\nstrength.measured = \"white_radiance\"\n[sample]\n\
         reflectance = 0.0\n[sample.concentrations]\n",
        reference.join("lights/oraleye_led385.csv").display()
    );
    for (name, _) in sources {
        text += &format!("{name} = 1.0\n");
    }
    for (name, file) in sources {
        let path = reference.join(format!("fluorophores/toolbox/{file}.csv"));
        text += &format!(
            "[[fluorophore]]\nname = \"{name}\"\nsource = {{ csv = \"{}\" }}\nphoton_yield = 1e-3\n",
            path.display()
        );
    }
    fs::write(folder.path().join("toolbox.toml"), text).unwrap();
    let found = predicted(folder.path(), &["toolbox.toml"]);
    assert_eq!(numbers(&found["wavelength_nm"]), expected[0].1);
    for (name, _) in sources {
        let column = &expected.iter().find(|(column, _)| column == name).unwrap().1;
        let peak = column.iter().copied().fold(0.0, f64::max);
        let ours = numbers(&found["radiance"]["fluorescence"][name]);
        let worst = ours.iter().zip(column).map(|(a, b)| (a - b).abs() / peak).fold(0.0, f64::max);
        println!("{name}: {worst:.1e} of the peak");
        assert!(peak > 0.0 && worst < 1e-6, "{name}: {worst}");
    }
    assert_eq!(found["photon_yield_500_700"], Value::Null);
    assert_eq!(found["channels"], serde_json::json!({}));
}

/// Sensor efficiencies with structure, on the nodes of a grid by 5 nm.
fn efficiency(channel: usize, nm: f64) -> f64 {
    let center = [600.0, 530.0, 460.0][channel];
    0.05 + 0.5 * (-((nm - center) / 40.0).powi(2)).exp()
}

/// ISETCam's negative flags clip nothing: ratios above the voltage swing are those of the electrons.
#[test]
fn a_sensor_that_clips_nothing_keeps_its_chromaticity() {
    let folder = tempfile::tempdir().unwrap();
    let of = |flag: &str, ms: &str| {
        let mode = format!("sensor.mode={{ type = \"isetcam\", noise_flag = {flag} }}");
        predicted(folder.path(), &["--set", &mode, "--exposure-ms", ms])
    };
    let [short, long, clipped] = [of("-1", "0.001"), of("-1", "100000"), of("0", "100000")];
    assert_eq!(clipped["chromaticity"], Value::Null);
    assert_eq!(clipped["channels"]["G"]["saturated"], true);
    assert!(long["channels"]["G"]["volts"].as_f64().unwrap() > 0.911, "{long}");
    for key in ["r", "g"] {
        let [a, b] = [&short, &long].map(|found| found["chromaticity"][key].as_f64().unwrap());
        assert!((a - b).abs() < 1e-9, "{key}: {a} and {b}");
    }
}

#[test]
fn mean_values_follow_isetcams_equations() {
    let folder = tempfile::tempdir().unwrap();
    let mut table = "wavelength_nm,R,G,B\n".to_string();
    for nm in (300..=800).step_by(5).map(f64::from) {
        table += &format!("{nm},{},{},{}\n", efficiency(0, nm), efficiency(1, nm), efficiency(2, nm));
    }
    fs::write(folder.path().join("qe.csv"), table).unwrap();
    let args = [
        "--compatibility",
        "isetcam",
        "--set",
        "sensor.quantum_efficiency=qe.csv",
        "--set",
        "view_filter.filters=[]",
        "--set",
        "lens.transmittance=0.85",
        "--set",
        "lens.focal_length_mm=3.863",
        "--set",
        "lens.focus_distance_mm=50",
        "--irradiance",
        "40",
        "--exposure-ms",
        "20",
    ];
    let found = predicted(folder.path(), &args);
    assert_eq!(found["provenance"]["compatibility"], "isetcam");
    let nm = numbers(&found["wavelength_nm"]);
    let radiance = numbers(&found["radiance"]["total"]);
    let on_sensor = numbers(&found["sensor_irradiance"]);

    // domain: E = pi L T / (1 + 4 N^2 (1 + |m|)^2) with m = f / (f - d).
    let m: f64 = 3.863 / (3.863 - 50.0);
    let solid_angle = PI / (1.0 + 4.0 * 16.0 * (1.0 + m.abs()).powi(2));
    for (e, l) in on_sensor.iter().zip(&radiance) {
        assert!((e - solid_angle * 0.85 * l).abs() <= 1e-6 * e, "{e} {l}");
    }

    // ISETCam's constants; Table 1: 2.5 um, fill factor 0.99, 9000 e- for 0.911 V, 12 bits.
    let (planck, light) = (6.626_176e-34, 2.997_924_58e8);
    let area_m2 = 2.5e-6_f64.powi(2) * 0.99;
    for (channel, name) in ["R", "G", "B"].into_iter().enumerate() {
        for irradiance in [on_sensor.clone(), radiance.iter().map(|l| solid_angle * 0.85 * l).collect()] {
            let sum: f64 = nm
                .iter()
                .zip(&irradiance)
                .map(|(nm, e)| e * nm * 1e-9 / (planck * light) * efficiency(channel, *nm) * 5.0)
                .sum();
            let electrons = 0.02 * area_m2 * sum;
            let volts = electrons * 0.911 / 9000.0;
            let dn = volts / (0.911 / 4096.0);
            assert!(volts < 0.911, "{name} is saturated");
            for (what, expected) in [("electrons", electrons), ("volts", volts), ("dn", dn)] {
                let value = found["channels"][name][what].as_f64().unwrap();
                assert!((value / expected - 1.0).abs() < 1e-6, "{name} {what}: {value} and {expected}");
            }
        }
    }
    let e = |name: &str| found["channels"][name]["electrons"].as_f64().unwrap();
    let sum = e("R") + e("G") + e("B");
    assert!((found["chromaticity"]["r"].as_f64().unwrap() - e("R") / sum).abs() < 1e-12);
    assert!((found["chromaticity"]["g"].as_f64().unwrap() - e("G") / sum).abs() < 1e-12);
}

#[test]
fn the_default_tongue_gives_off_as_many_photons_as_measured_ones() {
    let folder = tempfile::tempdir().unwrap();
    let line = "light.spectrum={type=\"table\",wavelength_nm=[403,405,407],value=[0,1,0]}";
    let found = predicted(folder.path(), &["--set", line, "--light-filter", "none"]);
    let photon_yield = found["photon_yield_500_700"].as_f64().unwrap();
    assert!((2.5e-4..1e-3).contains(&photon_yield), "{photon_yield}");

    // The same from the radiances: photons = energy * wavelength, exitance = pi * radiance; half of the outermost bands.
    let nm = numbers(&found["wavelength_nm"]);
    let sum = |values: Vec<f64>, from: f64, to: f64| -> f64 {
        let inside = |nm: f64| if nm == from || nm == to { 0.5 } else { f64::from(nm > from && nm < to) };
        nm.iter().zip(values).map(|(nm, v)| inside(*nm) * nm * v).sum()
    };
    let radiance = found["radiance"]["fluorescence"].as_object().unwrap();
    let emitted: f64 = radiance.values().map(|values| PI * sum(numbers(values), 500.0, 700.0)).sum();
    let direct = emitted / sum(numbers(&found["irradiance"]), 0.0, 1e4);
    assert!((direct / photon_yield - 1.0).abs() < 0.005, "{direct} and {photon_yield}");
}

#[test]
fn emitted_photons_do_not_depend_on_the_width_of_the_bands() {
    let folder = tempfile::tempdir().unwrap();
    let mut first: Option<[f64; 3]> = None;
    for step in ["1", "2", "5", "10"] {
        let found = predicted(
            folder.path(),
            &["--step-nm", step, "--set", "spectral.first_nm=300", "--set", "spectral.last_nm=850"],
        );
        let nm = numbers(&found["wavelength_nm"]);
        let width: f64 = step.parse().unwrap();
        let photons = |values: Vec<f64>| nm.iter().zip(values).map(|(nm, l)| width * nm * l).sum::<f64>();
        let radiance = found["radiance"]["fluorescence"].as_object().unwrap();
        let emitted: f64 = radiance.values().map(|values| photons(numbers(values))).sum();
        let electrons = found["channels"]["G"]["electrons"].as_f64().unwrap();
        let now = [emitted, found["photon_yield_500_700"].as_f64().unwrap(), electrons];
        let first = *first.get_or_insert(now);
        println!("{step} nm: {:?}", [now[0] / first[0], now[1] / first[1], now[2] / first[2]]);
        for (now, first) in now.iter().zip(first) {
            // Emission and the edges of filters change together within a band; bands of 10 nm see 1.2e-3 of that.
            assert!((now / first - 1.0).abs() < 1.5e-3, "{step} nm: {now} and {first}");
        }
    }
}

#[test]
fn the_filters_in_front_of_the_lens_count_once() {
    let folder = tempfile::tempdir().unwrap();
    let half = |filters: &str| {
        let filters = format!("view_filter.filters={filters}");
        let found =
            predicted(folder.path(), &["--light", "white_led", "--irradiance", "1", "--set", &filters]);
        numbers(&found["sensor_irradiance"]).iter().sum::<f64>()
    };
    let clear = half("[]");
    assert!((half("[0.5]") / clear - 0.5).abs() < 1e-12);
    assert!((half("[0.5, 0.5]") / clear - 0.25).abs() < 1e-12);
}

#[test]
fn options_are_overrides_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("samples")).unwrap();
    let sample = "format = 1\n[light]\nspectrum = \"led_450\"\nstrength.irradiance_w_per_m2 = 5\n[sample]\nreflectance = 0.5\n";
    fs::write(folder.path().join("samples/bare.toml"), sample).unwrap();
    fs::write(folder.path().join("gray.csv"), "wavelength_nm,r\n300,0.25\n800,0.25\n").unwrap();
    let bare = predicted(folder.path(), &["samples/bare.toml"]);
    for key in ["sensor_irradiance", "exposure_s", "chromaticity", "leak_ratio"] {
        assert_eq!(bare[key], Value::Null, "{key} without lens and sensor");
    }
    let changed = predicted(
        folder.path(),
        &[
            "samples/bare.toml",
            "--light=led_385",
            "--light-filter=short_pass_425",
            "--light-filter=0.5",
            "--irradiance=100",
            "--reflectance=gray.csv",
            "--concentration=fad=2",
            "--concentration",
            "my dye=1",
            "--set",
            "fluorophore=[{name=\"my dye\", source=\"elastin\"}]",
            "--step-nm=10",
        ],
    );
    let sum = |value: &Value| 10.0 * numbers(value).iter().sum::<f64>();
    assert!((sum(&changed["irradiance"]) / 100.0 - 1.0).abs() < 2e-3);
    assert!((sum(&changed["radiance"]["reflected"]) / (25.0 / PI) - 1.0).abs() < 2e-3);
    let names: Vec<&String> = changed["radiance"]["fluorescence"].as_object().unwrap().keys().collect();
    assert_eq!(names, ["fad", "my dye"]);
    assert_eq!(changed["provenance"]["sha256"].as_str().map(str::len), Some(64));
    assert_eq!(
        changed["provenance"]["units"]["radiance"],
        "W/(sr m2 nm), from the sample, before any filter"
    );
    // What the result says of itself makes it again.
    let again = folder.path().join("again.toml");
    fs::write(&again, changed["provenance"]["sample_toml"].as_str().unwrap()).unwrap();
    assert_eq!(predicted(folder.path(), &["again.toml"])["radiance"], changed["radiance"]);
}

#[test]
fn exposure_can_be_left_to_the_camera() {
    let folder = tempfile::tempdir().unwrap();
    let found = predicted(folder.path(), &["--exposure-ms", "auto"]);
    let brightest = ["R", "G", "B"].map(|c| found["channels"][c]["electrons"].as_f64().unwrap());
    let full = 9000.0 * (4095.0 - 64.0) / 4096.0;
    let most = brightest.into_iter().fold(0.0, f64::max);
    assert!((most / (0.8 * full) - 1.0).abs() < 1e-3, "{brightest:?}");
    let twice = predicted(folder.path(), &["--exposure-ms", "auto", "--irradiance", "2000"]);
    let ratio = found["exposure_s"].as_f64().unwrap() / twice["exposure_s"].as_f64().unwrap();
    assert!((ratio - 2.0).abs() < 1e-3, "{ratio}");
}

#[test]
fn people_read_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let said = fluorspar(folder.path(), ["predict"]).well();
    assert_eq!(said.stderr, "");
    for text in ["Back of the tongue", "photons out", "protoporphyrin_ix", "noise DN"] {
        assert!(said.stdout.contains(text), "{text}: {}", said.stdout);
    }
    let named = fluorspar(folder.path(), ["predict", "tongue-385nm"]).well();
    assert_eq!(named.stdout, said.stdout);
    let quiet = fluorspar(folder.path(), ["predict", "-q"]).well();
    assert_eq!((quiet.stdout.as_str(), quiet.stderr.as_str()), (said.stdout.as_str(), ""));
    assert!(crate::support::listing(folder.path()).is_empty());
}

#[test]
fn channels_stand_in_their_usual_order_and_light_that_is_left_out_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let text = fluorspar(folder.path(), ["predict"]).well().stdout;
    let place = |what: &str| text.find(what).unwrap_or_else(|| panic!("{what}: {text}"));
    assert!(place("R e-") < place("G e-") && place("G e-") < place("B e-"));
    assert!(place("\nR ") < place("\nG ") && place("\nG ") < place("\nB "));
    assert!(
        text.contains("1000.0 W/m2 (999.6 of it between 347.5 and 752.5 nm, the rest is left out)"),
        "{text}"
    );
}
