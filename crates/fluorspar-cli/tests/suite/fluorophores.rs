//! `fluorspar fluorophore`: the catalogue, images, and the way of measured files into experiments.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "these are tests")]

use std::fs;
use std::path::Path;

use crate::support::{fluorspar, library_test_data, listing, reference};
use serde_json::Value;

#[test]
fn the_catalogue_is_listed_and_shown() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let list = fluorspar(folder, ["catalog", "list", "fluorophore", "--json"]).json();
    let names: Vec<&str> = list.as_array().unwrap().iter().filter_map(|e| e["name"].as_str()).collect();
    assert!(names.contains(&"fad") && names.contains(&"protoporphyrin_ix"), "{names:?}");
    let text = fluorspar(folder, ["catalog", "list", "fluorophore"]).well().stdout;
    assert_eq!(text.lines().count(), 1 + names.len());
    for name in names {
        let shown = fluorspar(folder, ["catalog", "show", "fluorophore", name, "--json"]).json();
        assert!(!shown["source"].as_str().unwrap().is_empty());
        assert_eq!(shown["yields"].as_array().map(Vec::len), Some(4), "{name}");
        let shares = shown["term_summary"].as_array().unwrap();
        let sum: f64 = shares.iter().filter_map(|t| t["share_of_yield_at_385_nm"].as_f64()).sum();
        assert!((sum - 1.0).abs() < 1e-9, "{name}: {sum}");
        let text = fluorspar(folder, ["catalog", "show", "fluorophore", name]).well().stdout;
        assert!(
            text.contains("photons out per photon in") && text.contains("sum of separable terms"),
            "{text}"
        );
    }
    // README of the catalogue: photons between 500 and 700 nm per photon at 405 nm, concentration 1.
    for (name, expected) in [("fad", 4.82e-4), ("elastin", 3.51e-4), ("protoporphyrin_ix", 8.86e-4)] {
        let shown = fluorspar(folder, ["catalog", "show", "fluorophore", name, "--json"]).json();
        let at_405 = &shown["yields"][2];
        assert_eq!(at_405["excitation_nm"], 405.0);
        let value = at_405["photon_yield_500_700"].as_f64().unwrap();
        assert!((value / expected - 1.0).abs() < 0.01, "{name}: {value}");
    }
}

#[test]
fn matrices_and_emission_are_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fluorspar(folder, ["catalog", "plot", "fluorophore", "fad", "collagen"]).well();
    let svg = fs::read_to_string(folder.join("fluorophores.svg")).unwrap();
    assert!(svg.contains("FAD") && svg.contains("Collagen I"));
    let data = library_test_data("iset_v73.mat");
    let args = [
        "catalog",
        "plot",
        "fluorophore",
        "fad",
        data.to_str().unwrap(),
        "--out",
        "a.png",
        "--light",
        "led_405",
    ];
    let said = fluorspar(folder, args).well();
    assert_eq!(said.stderr, "Wrote a.png\nWrote a_emission.png\n");
    for name in ["a.png", "a_emission.png"] {
        assert!(fs::read(folder.join(name)).unwrap().starts_with(b"\x89PNG"), "{name}");
    }
    assert_eq!(listing(folder).len(), 3);
}

/// Adds the dye of a section to a flat sample and predicts it.
fn predicted(folder: &Path, section: &str, name: &str) -> Value {
    let text = format!(
        "format = 1\n[light]\nspectrum = {{ type = \"table\", wavelength_nm = [384, 385, 386], value = [0, 1, 0] }}\n\
         strength.irradiance_w_per_m2 = 1\n[sample]\nreflectance = 0.1\nconcentrations = {{ {name} = 1.0 }}\n{section}"
    );
    fs::write(folder.join("sample.toml"), text).unwrap();
    fluorspar(folder, ["predict", "sample.toml", "--json", "--step-nm", "1"]).json()
}

#[test]
fn imported_files_work_in_experiments() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::create_dir(folder.join("data")).unwrap();
    fs::create_dir(folder.join("work")).unwrap();
    // Flat from 500 to 600 nm; excitation falls from 380 to 400 nm.
    let table = "em_nm\\ex_nm,380,400\n500,2,1\n600,2,1\n";
    fs::write(folder.join("data/flat.csv"), table).unwrap();
    let args = [
        "fluorophore",
        "import",
        "data/flat.csv",
        "--yield-unit",
        "photons",
        "--name",
        "flat",
        "--photon-yield",
        "0.2",
        "--out",
        "work/flat.toml",
    ];
    let said = fluorspar(folder, args).well();
    assert_eq!(said.stdout, "");
    for text in [
        "content          excitation-emission matrix of photons",
        "excitation       380 to 400 nm, 2 samples",
        "emission         500 to 600 nm, 2 samples",
        "peak             excitation 380 nm, emission 500 nm",
        "anti-Stokes      0.000 % of the sum of all values",
        "2.000e-1 photons out per photon in at 380 nm",
    ] {
        assert!(said.stderr.contains(text), "{text}: {}", said.stderr);
    }
    let section = fs::read_to_string(folder.join("work/flat.toml")).unwrap();
    assert!(section.contains("eem_csv = \"../data/flat.csv\""), "{section}");
    // What was imported is shown and drawn from anywhere.
    let shown = fluorspar(folder, ["catalog", "show", "fluorophore", "work/flat.toml", "--json"]).json();
    assert_eq!(shown["excitation_peak_nm"], 380.0);
    let args = ["catalog", "plot", "fluorophore", "work/flat.toml", "fad", "--out", "both.svg"];
    fluorspar(folder, args).well();
    assert!(fs::read_to_string(folder.join("both.svg")).unwrap().contains("flat"));
    fs::write(folder.join("work/two.toml"), section.replace("\"flat\"", "\"other\"") + &section).unwrap();
    for (args, word) in [
        (&["catalog", "show", "fluorophore", "work/two.toml"][..], "several [[fluorophore]] sections"),
        (
            &["catalog", "show", "fluorophore", "work/flat.toml", "--photon-yield", "0.1"],
            "--photon-yield applies to",
        ),
    ] {
        let said = fluorspar(folder, args);
        assert!(said.code == Some(2) && said.stderr.contains(word), "{said:?}");
    }
    let found = predicted(&folder.join("work"), &section, "flat");
    // At 385 nm the yield is 0.2 * 1.75 / 2 photons; each carries 385/lambda of the energy.
    let radiance = found["radiance"]["fluorescence"]["flat"].as_array().unwrap();
    let at_550 = radiance[200].as_f64().unwrap();
    let expected = 0.175 / 100.0 * 385.0 / 550.0 / std::f64::consts::PI;
    assert!((at_550 / expected - 1.0).abs() < 2e-3, "{at_550} and {expected}");

    // As energy, the matrix favors long wavelengths: photons = energy * em / ex.
    let args =
        ["fluorophore", "import", "data/flat.csv", "--yield-unit", "energy", "--name", "flat", "--out", "-"];
    let section = fluorspar(folder, args).well().stdout;
    let found = predicted(folder, &section, "flat");
    let radiance = found["radiance"]["fluorescence"]["flat"].as_array().unwrap();
    let ratio = radiance[240].as_f64().unwrap() / radiance[160].as_f64().unwrap();
    assert!((ratio - 1.0).abs() < 1e-3, "equal energy per nm: {ratio}");
}

#[test]
fn every_kind_of_file_is_imported() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for name in ["iset_v5.mat", "iset_v7_struct.mat", "iset_v73.mat"] {
        fs::copy(library_test_data(name), folder.join(name)).unwrap();
        let args = ["fluorophore", "import", name, "--out", "-"];
        let said = fluorspar(folder, args).well();
        assert!(
            said.stdout.contains("name = \"testphore\"")
                && said.stdout.contains(&format!("mat = \"{name}\""))
        );
        let shown = fluorspar(folder, ["catalog", "show", "fluorophore", name, "--json"]).json();
        assert_eq!(shown["emission_peak_nm"], 460.0, "{name}");
    }
    let spectra = "wavelength_nm,excitation,emission\n380,1,0\n400,0.5,0\n500,-0.01,1\n600,0,0\n";
    fs::write(folder.join("spectra.csv"), spectra).unwrap();
    let said =
        fluorspar(folder, ["fluorophore", "import", "spectra.csv", "--allow-negative", "--out", "s.toml"])
            .well();
    assert!(said.stderr.contains("photons (assumed; --yield-unit energy changes it)"), "{}", said.stderr);
    assert!(fs::read_to_string(folder.join("s.toml")).unwrap().contains("csv = \"spectra.csv\"\n"));

    let eem = "# unit: unknown\nem_nm\\ex_nm,380,505\n500,1,0.5\n510,,4\n";
    fs::write(folder.join("anti.csv"), eem).unwrap();
    let args = [
        "fluorophore",
        "import",
        "anti.csv",
        "--yield-unit=photons",
        "--allow-anti-stokes",
        "--empty-cells=zero",
        "--stokes=off",
        "--out=a.toml",
    ];
    let said = fluorspar(folder, args).well();
    assert!(said.stderr.contains("anti-Stokes      9.091 % of the sum of all values"), "{}", said.stderr);
    assert!(
        said.stderr.contains("empty cells      1, taken as zero: no fluorescence there"),
        "{}",
        said.stderr
    );
    assert!(fs::read_to_string(folder.join("a.toml")).unwrap().contains("stokes = \"off\""));
}

/// A band model of a dye, with scattered light on the lines emission = excitation and emission = 2 x excitation.
fn raw_matrix(is_clean: bool) -> String {
    let bell = |nm: i32, peak: i32, width: f64| (-(f64::from(nm - peak) / width).powi(2)).exp();
    let mut text = "em_nm\\ex_nm".to_owned();
    let excitation: Vec<i32> = (260..=420).step_by(10).collect();
    text.extend(excitation.iter().map(|nm| format!(",{nm}")));
    for em in (250..=700).step_by(10) {
        text += &format!("\n{em}");
        for &ex in &excitation {
            let dye = 1000.0 * bell(ex, 340, 40.0) * bell(em, 520, 45.0);
            let scattered = 8000.0 * bell(em, ex, 6.0) + 900.0 * bell(em, 2 * ex, 6.0);
            text += &format!(",{:.3}", if is_clean { dye } else { dye + scattered });
        }
    }
    text + "\n"
}

/// Scattered light is refused with its cure, accepted with a warning, and cut out: what is left is the dye, and both files say what was cut.
#[test]
fn scattered_light_is_cut_out_of_a_matrix() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("raw.csv"), raw_matrix(false)).unwrap();
    fs::write(folder.join("clean.csv"), raw_matrix(true)).unwrap();
    let import = |more: &[&str]| {
        let args = [&["fluorophore", "import", "raw.csv", "--yield-unit=photons"][..], more].concat();
        fluorspar(folder, args)
    };
    let refused = import(&[]);
    assert!(
        refused.code == Some(2) && refused.stderr.contains("` is the narrowest band that removes it"),
        "{refused:?}"
    );
    // The command that the refusal ends with takes the file
    let command = refused.stderr.split("To import the file, run: `fluorspar ").nth(1).unwrap();
    let command: Vec<&str> = command.split('`').next().unwrap().split_whitespace().collect();
    assert!(command.contains(&"--cut-scatter") && command.contains(&"raw.toml"), "{command:?}");
    fluorspar(folder, &command).well();
    let accepted = import(&["--allow-anti-stokes"]).well();
    let warned = "--allow-anti-stokes accepts what is no fluorescence: first-order scatter (Rayleigh and Tyndall) lies along";
    assert!(accepted.stderr.contains(warned), "{}", accepted.stderr);
    let said = import(&["--cut-scatter=20", "--out=dye.toml"]).well();
    assert!(
        said.stderr.contains("cut out: ") && said.stderr.contains("interpolated along the emission"),
        "{}",
        said.stderr
    );
    let section = fs::read_to_string(folder.join("dye.toml")).unwrap();
    assert!(
        section.contains("eem_csv = \"dye-without-scatter.csv\"")
            && section.contains("# Scattered excitation light is cut out: "),
        "{section}"
    );
    let matrix = fs::read_to_string(folder.join("dye-without-scatter.csv")).unwrap();
    assert!(matrix.starts_with("# raw.csv without scattered excitation light: "), "{matrix}");
    // The dye is what it would be without scattered light: straight lines over 50 nm miss a bell of 45 nm by f''h²/8, a seventh of its peak at most
    let clean = ["fluorophore", "import", "clean.csv", "--yield-unit=photons", "--out=clean.toml"];
    fluorspar(folder, clean).well();
    let [cut, clean] = ["dye.toml", "clean.toml"]
        .map(|file| fluorspar(folder, ["catalog", "show", "fluorophore", file, "--json"]).json());
    for key in ["excitation_peak_nm", "emission_peak_nm"] {
        let [of_cut, of_clean] = [&cut, &clean].map(|shown| shown[key].as_f64().unwrap());
        assert!((of_cut - of_clean).abs() <= 10.0, "{key}: {of_cut} {of_clean}");
    }
    // Again: kept, unless it is to be replaced, and what is no section of import never
    let again = import(&["--cut-scatter=20", "--out=dye.toml"]);
    assert!(again.code == Some(2) && again.stderr.contains("--replace"), "{again:?}");
    let zero = import(&["--cut-scatter=20", "--cut-to=zero", "--out=dye.toml", "--replace"]).well();
    assert!(zero.stderr.contains("set to 0"), "{}", zero.stderr);
    fs::write(folder.join("mine.toml"), "mine = true\n").unwrap();
    let mine = import(&["--cut-scatter=20", "--out=mine.toml", "--replace"]);
    assert!(mine.code == Some(2) && mine.stderr.contains("something else would be lost"), "{mine:?}");
    for (more, words) in [
        (&["--cut-scatter=20"][..], "--out FILE.toml"),
        (&["--cut-scatter=0", "--out=a.toml"], "between 0.5 and 100 nm"),
        (&["--cut-to=zero", "--out=a.toml"], "--cut-scatter"),
    ] {
        let refused = import(more);
        assert!(refused.code == Some(2) && refused.stderr.contains(words), "{more:?}: {refused:?}");
    }
    let spectra = "wavelength_nm,excitation,emission\n380,1,0\n400,0.5,0\n500,0,1\n600,0,0\n";
    fs::write(folder.join("spectra.csv"), spectra).unwrap();
    let refused =
        fluorspar(folder, ["fluorophore", "import", "spectra.csv", "--cut-scatter=20", "--out=a.toml"]);
    assert!(refused.code == Some(2) && refused.stderr.contains("is no matrix as CSV"), "{refused:?}");
    assert!(!folder.join("a.toml").exists());
}

/// A table as an instrument writes it: everything that is wrong with its form in one refusal. Several bad cells keep the option of one.
#[test]
fn all_that_is_wrong_with_a_table_is_told_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let import = |text: &str| {
        fs::write(folder.join("dye.csv"), text).unwrap();
        fluorspar(folder, ["fluorophore", "import", "dye.csv"])
    };
    let refused = import("# 10 uM in PBS\nex_nm,500,490,480\n510,1,2,5\n520,3,4,5\n505,3,4,5\n");
    assert_eq!(refused.code, Some(2));
    for words in [
        "the file does not say whether its values count photons or energy",
        "--yield-unit photons or --yield-unit energy",
        "the emission wavelength 505 nm follows 520 nm",
    ] {
        assert!(refused.stderr.contains(words), "{words}: {}", refused.stderr);
    }
    // What several options cure is told at once, with the command that has them
    let refused = import("Sample: 10 uM in PBS\nem;ex 350,0 nm;ex 360,0 nm\n400,0;-1,5;\n410,0;2,5;4,5\n");
    assert_eq!(refused.code, Some(2));
    for words in [
        "(--yield-unit photons or --yield-unit energy). Then, on line 3, column",
        "(--allow-negative). Also line 3",
        "Then, on line 3, the cell at excitation 360 nm is empty",
        "To import the file, run: `fluorspar fluorophore import dye.csv --yield-unit photons --allow-negative --empty-cells interpolate`",
    ] {
        assert!(refused.stderr.contains(words), "{words}: {}", refused.stderr);
    }
    let options = ["--yield-unit=photons", "--allow-negative", "--empty-cells=zero"];
    let args = [&["fluorophore", "import", "dye.csv", "--out=dye.toml"][..], &options].concat();
    let read = fluorspar(folder, args).well();
    assert!(read.stderr.contains("a line beside the table is left out; decimal commas"), "{}", read.stderr);
    // What was made of cells is told, and stays in the section
    let cells = [
        "1, taken as zero: no fluorescence there",
        "1, taken as zero, the lowest -1.5 (33.33 % of the peak)",
    ];
    let section = fs::read_to_string(folder.join("dye.toml")).unwrap();
    for words in cells {
        assert!(read.stderr.contains(words) && section.contains(words), "{words}: {} {section}", read.stderr);
    }
    // And an experiment reads the same file
    let shown = fluorspar(folder, ["catalog", "show", "fluorophore", "dye.toml", "--json"]).json();
    assert_eq!(shown["emission_peak_nm"], 410.0, "{shown}");
    let head = "# unit: photons\nem_nm\\ex_nm,380,400\n";
    for (cells, option) in
        [("500,-1,2\n520,-3,4\n", "--allow-negative"), ("500,,2\n520,,4\n", "--empty-cells interpolate")]
    {
        let refused = import(&format!("{head}{cells}"));
        assert!(refused.code == Some(2) && refused.stderr.contains(". Also line 4"), "{refused:?}");
        assert!(refused.stderr.contains(&format!("({option}")), "{option}: {}", refused.stderr);
    }
}

#[test]
fn measured_matrices_come_through() {
    let Some(reference) = reference() else {
        println!("skipped: no reference data (set FLUORSPAR_REFERENCE to their folder)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    for (name, peak) in [("fad", 525.0), ("protoporphyrin", 630.0)] {
        let file = reference.join(format!("eem/webfluor_{name}.csv"));
        let args =
            ["catalog", "show", "fluorophore", file.to_str().unwrap(), "--yield-unit", "photons", "--json"];
        let shown = fluorspar(folder.path(), args).json();
        let found = shown["emission_peak_nm"].as_f64().unwrap();
        assert!((found - peak).abs() <= 5.0, "{name}: {found}");
    }
}

/// A list behind an option of `plot` is refused with what to type instead.
#[test]
fn a_list_of_names_is_refused_with_its_cure() {
    let folder = tempfile::tempdir().unwrap();
    let refused = fluorspar(folder.path(), ["plot", "--light", "led_385,led_405"]);
    assert!(
        refused.code == Some(2) && refused.stderr.contains("--light led_385 --light led_405"),
        "{refused:?}"
    );
}

/// What `plot` says that a filter keeps of the fluorescence and lets pass of the light, against the sums by hand, and against `design`.
#[test]
fn what_a_viewing_filter_keeps_is_the_ratio_of_the_integrals() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let kept = |more: &[&str]| -> Value {
        let args = ["plot", "--fluorophore=fluorescein", "--json", "--out=chain.svg"];
        fluorspar(folder, [&args[..], more].concat()).json()["kept"][0].clone()
    };
    let percent = |found: &Value, key: &str| found[key].as_f64().unwrap();
    // A filter that passes (nm - 300)/600, and light of two lines of one power, triangles of 5 nm to either side
    let transmittance = |nm: f64| (nm - 300.0) / 600.0;
    fs::write(folder.join("rising.csv"), "wavelength_nm,transmittance\n300,0\n900,1\n").unwrap();
    let lines = "wavelength_nm,power\n300,0\n435,0\n440,1\n445,0\n455,0\n460,1\n465,0\n900,0\n";
    fs::write(folder.join("lines.csv"), lines).unwrap();
    let own = ["--light=lines.csv", "--view-filter=rising.csv"];
    // Photons go with power times wavelength: a triangle at m of variance v = 5²/6 passes m T(m) + v T' of m
    let (variance, slope) = (25.0 / 6.0, 1.0 / 600.0);
    let passed = [440.0, 460.0].map(|nm: f64| nm * transmittance(nm) + variance * slope);
    let light = 100.0 * passed.iter().sum::<f64>() / 900.0;
    // The shape of fluorescein's emission is the same under any excitation below it
    let fluorescein = fluorspar_experiment::preset::fluorophore("fluorescein").unwrap().fluorophore();
    let channels =
        fluorspar_experiment::preset::quantum_efficiency("consumer_rgb_cmos").unwrap().channels().unwrap();
    let by_hand = |weight: &dyn Fn(f64) -> f64| -> f64 {
        let nm = || (0..2400).map(|step| 300.125 + 0.25 * f64::from(step));
        let sum = |of: &dyn Fn(f64) -> f64| -> f64 {
            nm().map(|nm| fluorescein.eem.at(nm, 450.0) * weight(nm) * of(nm)).sum()
        };
        100.0 * sum(&transmittance) / sum(&|_| 1.0)
    };
    let seen = |nm: f64| channels.iter().map(|(_, curve)| curve.at(nm)).sum::<f64>();
    // Sums over smooth bells of tens of nanometers at steps of 1 nm are good to far below a thousandth
    let bare = kept(&own);
    for (found, expected) in [
        (percent(&bare, "light_passed_percent"), light),
        (percent(&bare, "fluorescence_kept_percent"), by_hand(&|_| 1.0)),
        (
            percent(&kept(&[&own[..], &["--qe=consumer_rgb_cmos"]].concat()), "fluorescence_kept_percent"),
            by_hand(&seen),
        ),
    ] {
        assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
    }
    // The same share as `design` has, whose bands of some nanometers cut the filter's edge otherwise
    let design = "format = 2\ntitle = \"A long-pass\"\nbase = \"flat-patch\"\nview_filter.filters = [\"long_pass_520\"]\n\
                  sensor.preset = \"pi_camera_3\"\ncriterion = \"leak\"\n[[light]]\nname = \"blue\"\nspectrum = \"led_405\"\nfilters = []\n\
                  strength.irradiance_w_per_m2 = 100.0\n[[region]]\nname = \"dye\"\n\
                  material = { reflectance = 0.5, concentrations = { fluorescein = 0.01 } }\n[exposure]\ncounts = [1]\ntotal.ms = 60.0\n\
                  [unknown]\ngain = 0.2\nleak = 0.3\npixels = 1000\n[[contrast]]\nname = \"dye\"\npart = [\"fluorescein\"]\n";
    fs::write(folder.join("design.toml"), design).unwrap();
    let swept = fluorspar(folder, ["design", "sweep", "design.toml", "--json", "-q"]).json();
    let of_design = 100.0 * swept["best"][0]["fluorescence_kept"].as_f64().unwrap();
    let same = ["--light=led_405", "--view-filter=long_pass_520", "--qe=consumer_rgb_cmos"];
    let of_plot = percent(&kept(&same), "fluorescence_kept_percent");
    assert!((of_plot - of_design).abs() < 0.5, "{of_plot} {of_design}");
    // All channels of a file whose unit the option says
    fs::write(folder.join("qe.csv"), "wavelength_nm,R,G,B\n400,2,3,30\n700,50,6,2\n").unwrap();
    let of_file = "--qe={ csv = \"qe.csv\", unit = \"percent\" }";
    let drawn = fluorspar(folder, ["plot", of_file, "--json"]).json();
    assert_eq!(drawn["quantum_efficiency"].as_array().unwrap().len(), 3);
    // How a file was read is said once
    fs::write(folder.join("percent.csv"), "nm,T (%)\n400,1\n500,90\n").unwrap();
    let drawn = fluorspar(folder, ["plot", "--light-filter=percent.csv", "--fluorophore=fad"]);
    assert_eq!(drawn.stderr.matches("read as percent").count(), 1, "{drawn:?}");
    let drawn = fluorspar(folder, ["plot", "--view-filter=percent.csv", "--fluorophore=fad"]);
    assert_eq!(drawn.stderr.matches("read as percent").count(), 1, "{drawn:?}");
}
