//! Everything in `bad_input.txt` is wrong in one way, and is answered with the words that stand below it, exit code 2,
//! nothing on standard output and nothing left behind. `TINY` stands for the settings of the tiny experiment, `{folder}`
//! for the folder of the test.
//!
//! With `FLUORSPAR_WRITE_TRANSCRIPT=1` the answers in that file are written anew instead: read them before you keep them.

#![cfg(unix)] // The words of the operating system are part of the answers.
#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;

use crate::support::{fluorspar, library_test_data, listing, tiny};

const SAMPLE: &str = "format = 1\n[light]\nspectrum = \"led_385\"\nstrength.irradiance_w_per_m2 = 100\n[sample]\nreflectance = 0.1\n";

/// Small files that are wrong, and some that are right.
const FILES: [(&str, &str); 43] = [
    ("syntax.toml", "title = \"unfinished\n"),
    ("unknown_field.toml", "format = 1\nbase = \"flat-patch\"\n[render]\nwidht_px = 8\n"),
    (
        "unknown_light.toml",
        "format = 1\nbase = \"flat-patch\"\n[[light]]\nname = \"blue\"\nspectrum = \"led_358\"\n",
    ),
    (
        "negative_power.toml",
        "format = 1\nbase = \"oraleye-2021\"\n[[light]]\nname = \"blue\"\nstrength.power_mw = -1\n",
    ),
    ("no_analysis.toml", "format = 1\nbase = \"fluorescent-sphere\"\n"),
    ("other_parts.toml", "format = 1\nbase = \"flat-patch\"\n"),
    ("page.html", "<!doctype html><title>Weather</title>\n"),
    ("sample.toml", SAMPLE),
    (
        "sample_creates.toml",
        "format = 1\n[light]\nspectrum = \"led_385\"\nstrength.irradiance_w_per_m2 = 1\n[sample]\nreflectance = 1.0\nconcentrations = { enamel = 1 }\n",
    ),
    (
        "sample_dark.toml",
        "format = 1\n[light]\nspectrum = \"led_385\"\nfilters = [0.0]\nstrength.irradiance_w_per_m2 = 1\n[sample]\nreflectance = 0.1\n",
    ),
    (
        "sample_sensor.toml",
        "format = 1\n[light]\nspectrum = \"led_385\"\nstrength.irradiance_w_per_m2 = 1\n[sample]\nreflectance = 0.1\n[sensor]\n",
    ),
    ("percent.csv", "wavelength_nm,value\n400,10\n700,500\n"),
    ("micrometers.csv", "wavelength_nm,power\n0.38,1\n0.39,2\n"),
    ("words.csv", "wavelength_nm,power\n380,much\n390,little\n"),
    ("occupied/letter.txt", "Dear Sir"),
    ("other_grid.toml", "format = 1\nbase = \"flat-patch\"\n[spectral]\nstep_nm = 10\n"),
    (
        "other_lights.toml",
        "format = 1\nbase = \"oraleye-2021\"\n[[light]]\nname = \"blue\"\ngroup = \"violet\"\n[[capture]]\nname = \"blue\"\nlight_groups = { violet = 1.0 }\n",
    ),
    ("text.exr", "this is not an image\n"),
    ("no_raw/experiment.toml", "format = 1\nbase = \"flat-patch\"\n[analysis]\nframe = \"blue\"\n"),
    ("eem/transposed_header.csv", "# unit: photons\nex_nm\\em_nm,500,510\n380,1,2\n390,3,4\n"),
    ("eem/transposed.csv", "# unit: photons\nem_nm\\ex_nm,500,510\n380,1,2\n390,3,4\n"),
    ("eem/unsorted.csv", "# unit: photons\nem_nm\\ex_nm,380,390\n510,1,2\n500,3,4\n"),
    ("eem/twice.csv", "# unit: photons\nem_nm\\ex_nm,380,380\n500,1,2\n510,3,4\n"),
    ("eem/negative.csv", "# unit: photons\nem_nm\\ex_nm,380,390\n500,1,2\n510,-3,4\n"),
    ("eem/nan.csv", "# unit: photons\nem_nm\\ex_nm,380,390\n500,1,NaN\n510,3,4\n"),
    ("eem/anti_stokes.csv", "# unit: photons\nem_nm\\ex_nm,380,505\n500,1,2\n510,3,4\n"),
    ("eem/no_unit.csv", "em_nm\\ex_nm,380,390\n500,1,2\n510,3,4\n"),
    ("eem/unknown_unit.csv", "# unit: unknown\nem_nm\\ex_nm,380,390\n500,1,2\n510,3,4\n"),
    ("eem/odd_unit.csv", "# unit: watts\nem_nm\\ex_nm,380,390\n500,1,2\n510,3,4\n"),
    ("eem/photons.csv", "# unit: photons\nem_nm\\ex_nm,380,390\n500,1,2\n510,3,4\n"),
    ("eem/empty_cell.csv", "# unit: photons\nem_nm\\ex_nm,380,390\n500,1,\n510,3,4\n"),
    ("eem/ragged.csv", "# unit: photons\nem_nm\\ex_nm,380,390\n500,1\n510,3,4\n"),
    ("eem/no_corner.csv", "# unit: photons\n,380,390\n380,1,2\n390,3,4\n"),
    ("eem/one_column.csv", "# unit: photons\nem_nm\\ex_nm,380\n500,1\n510,3\n"),
    ("eem/zero.csv", "# unit: photons\nem_nm\\ex_nm,380,390\n500,0,0\n510,0,0\n"),
    ("lenses/three_numbers.dat", "# a lens\n50\n40 6 1.6\n"),
    ("lenses/no_stop.dat", "40 6 1.6 20\n-70 0 1 20\n"),
    (
        "lenses/unknown_glass.toml",
        "name = \"a\"\n[[surface]]\nradius_mm = 40\nthickness_mm = 6\nglass = \"N-BK8\"\nsemi_diameter_mm = 10\nstop = true\n[[surface]]\nsemi_diameter_mm = 10\n",
    ),
    ("lenses/diverging.dat", "0 2 0 4\n-40 6 1.6 20\n70 0 1 20\n"),
    ("spectra/flat.csv", "wavelength_nm,excitation,emission\n380,1,0\n500,1,1\n600,1,0\n"),
    ("spectra/no_emission.csv", "wavelength_nm,excitation\n380,1\n500,0\n"),
    ("spectra/negative.csv", "wavelength_nm,excitation,emission\n380,1,0\n500,0,-1\n600,0,1\n"),
    ("spectra/dark.csv", "wavelength_nm,excitation,emission\n380,1,0\n500,0,0\n600,0,0\n"),
];

/// A folder in which every command of the transcript finds what it names.
fn workshop(folder: &Path) {
    for (name, content) in FILES {
        let path = folder.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }
    fs::write(folder.join("latin1.toml"), b"title = \"Z\xfcrich\"\n").unwrap();
    fs::create_dir(folder.join("empty")).unwrap();
    fs::create_dir(folder.join("folder.png")).unwrap();
    for name in ["iset_emission_only.mat", "spectra_v4.mat", "iset_v5.mat"] {
        fs::copy(library_test_data(name), folder.join(name)).unwrap();
    }
    let mat = fs::read(folder.join("iset_v5.mat")).unwrap();
    fs::write(folder.join("cut.mat"), &mat[..200]).unwrap();

    fluorspar(folder, tiny(&["run", "oraleye-2021", "--out", "done", "--quiet"])).well();
    let image = fs::read(folder.join("done/components.exr")).unwrap();
    fs::write(folder.join("cut.exr"), &image[..image.len() / 2]).unwrap();
    let raw = ["experiment.toml", "raw_ambient.tiff", "raw_white.tiff", "raw_blue.tiff"];
    for name in ["raw_only", "raw_bare", "raw_cut"] {
        fs::create_dir(folder.join(name)).unwrap();
        for file in raw {
            fs::copy(folder.join("done").join(file), folder.join(name).join(file)).unwrap();
            let description = folder.join("done").join(format!("{file}.json"));
            if description.exists() && name != "raw_bare" {
                fs::copy(description, folder.join(name).join(format!("{file}.json"))).unwrap();
            }
        }
    }
    let frame = fs::read(folder.join("raw_cut/raw_blue.tiff")).unwrap();
    fs::write(folder.join("raw_cut/raw_blue.tiff"), &frame[..frame.len() / 2]).unwrap();
}

/// Words of a command line; quotes keep spaces.
fn words(line: &str) -> Vec<String> {
    let mut words = Vec::new();
    for (index, part) in line.split('\'').enumerate() {
        if index % 2 == 1 {
            words.push(part.to_string());
        } else {
            for word in part.split_whitespace() {
                if word == "TINY" {
                    words.extend(crate::support::TINY.map(String::from));
                } else {
                    words.push(word.into());
                }
            }
        }
    }
    words
}

#[test]
fn bad_input_is_explained_and_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    workshop(folder.path());
    let before = listing(folder.path());

    let transcript = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bad_input.txt");
    let text = fs::read_to_string(&transcript).unwrap();
    let (mut now, mut wrong, mut cases) = (String::new(), String::new(), 0);
    for case in text.split("$ fluorspar ").skip(1) {
        let (line, expected) = case.split_once('\n').unwrap();
        cases += 1;
        let said = fluorspar(folder.path(), words(line));
        let answer = said.stderr.replace(&*folder.path().to_string_lossy(), "{folder}");
        let answer = answer.trim_end();
        now += &format!("$ fluorspar {line}\n{answer}\n\n");
        let mut complain = |what: &str| wrong += &format!("$ fluorspar {line}\n{what}\n");
        if answer != expected.trim_end() {
            complain(&format!("  expected: {}\n  found:    {answer}", expected.trim_end()));
        }
        if said.code != Some(2) || !said.stdout.is_empty() || answer.contains("panicked") {
            complain(&format!("  {said:?}"));
        }
        let after = listing(folder.path());
        if after != before {
            let new: Vec<_> = after.keys().filter(|path| !before.contains_key(*path)).collect();
            complain(&format!("  left behind or changed: {new:?}"));
        }
    }
    if std::env::var_os("FLUORSPAR_WRITE_TRANSCRIPT").is_some() {
        fs::write(&transcript, now).unwrap();
    }
    assert!(cases >= 300, "only {cases} cases");
    assert!(wrong.is_empty(), "\n{wrong}");
}
