//! Design problems of the catalogue: the pilot table of two LEDs, its honest sister, searches, and one design against `predict`.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::path::Path;

use fluorspar::design::{Design, DesignSpace, Merits, exchange, score_all};
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{ResolvedDesign, parse_design};

use crate::tissue_sites::reference_folder;

/// A problem of the catalogue without the designs to compare with, whose lights the changes may take away.
fn text_of(name: &str) -> &'static str {
    preset::text(PresetKind::Design, name).unwrap().split("[[compare]]").next().unwrap()
}

fn resolved(name: &str, changes: &[String]) -> ResolvedDesign {
    parse_design(text_of(name), name, Path::new("."), changes).unwrap()
}

fn space(name: &str, changes: &[String]) -> DesignSpace {
    DesignSpace::new(resolved(name, changes).problem).unwrap()
}

/// A question on top of the light, the lens and the sensor of a flat patch.
fn flat(question: &str, irradiance_w_per_m2: f64) -> String {
    format!(
        "format = 2\nlens = {{ focal_length_mm = 3.0, f_number = 4.0, focus_distance_mm = 1e9 }}\n{question}\n[[light]]\nname = \"led\"\n\
         type = \"distant\"\nframe = \"camera\"\nspectrum = \"led_405\"\nstrength.irradiance_w_per_m2 = {irradiance_w_per_m2:.1}\n{}",
        if question.contains("sensor") { "" } else { "[sensor]\npreset = \"lyu_2021_table_1\"\n" }
    )
}

/// The best design with its merits.
fn best(space: &DesignSpace) -> (Design, Merits) {
    let scores = score_all(space, 0..space.len());
    let first = (0..scores.len()).fold(0, |a, b| if scores[b].loss < scores[a].loss { b } else { a });
    let design = space.design(first as u64);
    let merits = space.evaluate(&design);
    (design, merits)
}

/// Relative standard deviations in the order of the table: NADH, FAD, collagen, elastin, porphyrin.
fn in_order(space: &DesignSpace, merits: &Merits) -> [f64; 5] {
    let names: Vec<&str> =
        space.problem().regions[0].response.fluorescence.iter().map(|f| f.name.as_str()).collect();
    ["nadh", "fad", "collagen", "elastin", "protoporphyrin_ix"]
        .map(|name| merits.regions[0].weights[names.iter().position(|other| *other == name).unwrap()])
}

/// LEDs of the pilot study that are no shorter than a wavelength.
fn leds(shortest: f64) -> String {
    let all = [340.0, 365.0, 385.0, 405.0, 420.0, 435.0, 450.0, 470.0];
    let kept: Vec<String> = all.iter().filter(|nm| **nm >= shortest).map(|nm| format!("{nm:.1}")).collect();
    format!("vary.light.led.peaks_nm=[{}]", kept.join(", "))
}

/// The conclusion of the paper: three channels under one light can't tell five fluorophores apart, two lights can.
#[test]
fn one_light_with_rgb_leaves_the_fisher_matrix_singular() {
    let space = space("two-lights", &[]);
    let text = preset::text(PresetKind::Design, "two-lights").unwrap();
    let one = parse_design(text, "two-lights", Path::new("."), &[]).unwrap().compared.swap_remove(0);
    assert_eq!(one.name, "385 nm alone");
    let merits = space.evaluate(&one.design);
    assert_eq!((merits.regions[0].rank, merits.loss), (3, f64::INFINITY));
    assert!(merits.regions[0].weights.iter().all(|sd| sd.is_infinite()), "{:?}", merits.regions[0].weights);
    let blind = merits.regions[0].bound.weakest_directions(2);
    assert!(blind.iter().all(|direction| direction.standard_deviation.is_none()));
    let (pair, merits) = best(&space);
    assert_eq!((pair.lights.len(), merits.regions[0].rank), (2, 5));
    println!("{} {:?}", space.describe(&pair), in_order(&space, &merits));
}

/// Best worst-case relative standard deviations of the pilot study: shortest LED allowed, the pair, NADH, FAD, collagen, elastin,
/// porphyrin.
const PILOT_RGB: [(f64, [f64; 2], [f64; 5]); 4] = [
    (340.0, [340.0, 420.0], [0.027, 0.023, 0.037, 0.025, 0.028]),
    (365.0, [365.0, 420.0], [0.044, 0.024, 0.046, 0.026, 0.029]),
    (385.0, [385.0, 420.0], [0.113, 0.022, 0.109, 0.024, 0.021]),
    (405.0, [405.0, 435.0], [1.01, 0.020, 1.32, 0.041, 0.017]),
];
/// The same with eight bands.
const PILOT_EIGHT: [(f64, [f64; 2], [f64; 5]); 4] = [
    (340.0, [340.0, 420.0], [0.022, 0.016, 0.032, 0.019, 0.014]),
    (365.0, [365.0, 420.0], [0.033, 0.016, 0.034, 0.020, 0.013]),
    (385.0, [385.0, 420.0], [0.078, 0.014, 0.068, 0.018, 0.010]),
    (405.0, [405.0, 435.0], [0.74, 0.014, 0.82, 0.028, 0.010]),
];

/// The problem of the pilot study with the measured matrices that it must have used. Its values say so: collagen is the sample
/// whose emission lies at 430 nm, and porphyrin weighs 2 and not 0.5. Centers and widths of the bands are not stated in full; these
/// fit its values.
fn measured_space(folder: &Path, shortest: f64, sensor: &str) -> DesignSpace {
    let mut text = text_of("two-lights").replace(
        "spectral = { first_nm = 350.0, last_nm = 750.0, step_nm = 5.0 }",
        "spectral = { first_nm = 350.0, last_nm = 745.0, step_nm = 5.0 }",
    );
    for (name, file) in [
        ("nadh", "nadh"),
        ("fad", "fad"),
        ("collagen", "collagen7"),
        ("elastin", "elastin"),
        ("protoporphyrin_ix", "protoporphyrin"),
    ] {
        let path = folder.join(format!("eem/webfluor_{file}.csv"));
        text += &format!(
            "\n[[fluorophore]]\nname = \"{name}\"\nsource = {{ eem_csv = \"{}\", unit = \"photons\" }}\nphoton_yield = 1e-3\n",
            path.display()
        );
    }
    let changes = [leds(shortest), sensor.into(), "exposure.counts=[2]".into()];
    let mut problem = parse_design(&text, "pilot", Path::new("."), &changes).unwrap().problem;
    let response = &mut problem.regions[0].response;
    let (bands, nodes) = (response.grid.centers_nm(), response.excitation.centers_nm());
    for part in &mut response.fluorescence {
        // One peak of photons out per photon in
        let photons = |k: usize| {
            let (emission, excitation) = (bands[k / nodes.len()], nodes[k % nodes.len()]);
            if emission >= excitation + 15.0 { part.radiance[k] * emission / excitation } else { 0.0 }
        };
        let peak = (0..part.radiance.len()).map(photons).fold(0.0, f64::max);
        // Its peaks were those of single cells: bands of 5 nm lower the narrow one of porphyrin by 8 %
        let weight = if part.name == "protoporphyrin_ix" { 2.0 * 0.92 } else { 1.0 };
        part.radiance.iter_mut().for_each(|value| *value *= weight * 1e-6 / peak);
    }
    DesignSpace::new(problem).unwrap()
}

const PILOT_BANDS: &str = "vary.sensor.bands=[{ centers_nm = [595.0, 567.0, 433.0], sigma_nm = [38.0, 28.0, 28.0], read_noise_e = 2.0, full_well_e = 60000.0 }]";
const EIGHT_BANDS: &str = "vary.sensor.bands=[{ centers_nm = [410.0, 453.0, 496.0, 539.0, 581.0, 624.0, 667.0, 710.0], sigma_nm = [14.0], read_noise_e = 2.0, full_well_e = 60000.0 }]";

/// The pilot table with measured matrices: its pairs are the best or as good; with R, G and B every value comes back within a factor of
/// 1.5, with eight bands all but one (collagen beyond 405 nm), which the pilot's unstated bands may explain.
#[test]
fn the_pilot_table_comes_back_from_measured_matrices() {
    let Some(folder) = reference_folder() else {
        println!("skipped: no reference data (set FLUORSPAR_REFERENCE to their folder)");
        return;
    };
    let (mut ratios, mut losses) = (Vec::new(), Vec::new());
    let tables = [(PILOT_BANDS, &PILOT_RGB[..]), (EIGHT_BANDS, &PILOT_EIGHT[..])];
    for (sensor, table) in tables {
        for (shortest, pair, expected) in table {
            let space = measured_space(&folder, *shortest, sensor);
            let (winner, least) = best(&space);
            let number =
                |nm: &f64| space.problem().lights.iter().position(|light| light.peak_nm == *nm).unwrap();
            let theirs = Design { lights: pair.iter().map(number).collect(), ..winner.clone() };
            let merits = space.evaluate(&theirs);
            let found = in_order(&space, &merits);
            println!(
                "{pair:?} {found:.3?}, pilot {expected:?}; least {:.4} of {}",
                least.loss,
                space.describe(&winner)
            );
            losses.push(merits.loss / least.loss);
            ratios.extend(found.iter().zip(expected).map(|(a, b)| (a / b).max(b / a)));
        }
    }
    let close = ratios.iter().filter(|ratio| **ratio <= 1.5).count();
    println!("{close} of {} within 1.5, {ratios:.2?}; losses over the least {losses:.3?}", ratios.len());
    // 340 + 405 nm and 340 + 420 nm are as good as each other
    assert!(losses.iter().all(|loss| *loss < 1.02), "{losses:?}");
    let rgb = 5 * PILOT_RGB.len();
    assert!(ratios[..rgb].iter().all(|ratio| *ratio <= 1.5), "{ratios:?}");
    assert!(close >= ratios.len() - 1 && ratios.iter().all(|ratio| *ratio < 1.75), "{ratios:?}");
}

/// The same table from the catalogue's matrices, whose collagen emits at 390 nm, and beside it the honest one.
#[test]
fn the_table_of_the_catalogue_and_what_is_left_of_it() {
    let mut ideal_losses = Vec::new();
    for (shortest, pair) in
        [(340.0, [340.0, 420.0]), (365.0, [365.0, 420.0]), (385.0, [385.0, 435.0]), (405.0, [405.0, 435.0])]
    {
        let ideal = space("two-lights", &[leds(shortest)]);
        let (design, merits) = best(&ideal);
        println!("ideal {} {:.3?}", ideal.describe(&design), in_order(&ideal, &merits));
        assert!(design.lights.iter().map(|&k| ideal.problem().lights[k].peak_nm).eq(pair));
        let honest = space("two-lights-tissue", &[leds(shortest)]);
        let (other, left) = best(&honest);
        println!("honest {} {:.3?}", honest.describe(&other), in_order(&honest, &left));
        assert!(left.loss > merits.loss);
        ideal_losses.push(merits.loss);
    }
    // The shorter the shortest light may be, the better
    assert!(ideal_losses.windows(2).all(|pair| pair[1] > pair[0]), "{ideal_losses:?}");
}

/// Three problems of about 1e4 designs: exchange with at most 1000 evaluations finds the best of all in 18 of 20 seeds.
#[test]
fn exchange_finds_what_all_designs_hold() {
    let edges = "vary.long-pass.long_pass.after_peak_nm=[20.0, 30.0, 40.0, 50.0, 60.0]";
    let splits = "exposure.splits=[\"equal_electrons\", \"equal_time\", 0.3, 0.7]";
    let timed = "exposure={ counts = [1, 2], total.ms = 100.0, splits = [\"equal_time\", 0.3, 0.5, 0.8], drives = [0.5, 1.0] }";
    let contrast = "criterion=\"contrast\"";
    // The third without errors of the library, whose many unknowns take time
    let library =
        ["emission_shift_nm", "excitation_shift_nm", "spectrum"].map(|name| format!("unknown.{name}=0.0"));
    for (name, changes) in [
        ("two-lights", [edges, splits, "vary.aperture.values=[2.0, 4.0]"]),
        ("two-lights", [edges, timed, "criterion=\"d\""]),
        ("two-lights-tissue", [edges, splits, contrast]),
    ] {
        let mut changes: Vec<String> = changes.iter().map(|text| (*text).to_owned()).collect();
        changes.extend(library.clone());
        let space = space(name, &changes);
        assert!((7_000..20_000).contains(&space.len()), "{}", space.len());
        let started = std::time::Instant::now();
        let scores = score_all(&space, 0..space.len());
        let rate = space.len() as f64 / started.elapsed().as_secs_f64();
        let best = scores.iter().map(|s| s.loss).fold(f64::INFINITY, f64::min);
        let results: Vec<_> = (0..20).map(|seed| exchange(&space, seed, 1000)).collect();
        assert!(results.iter().all(|result| result.evaluated.len() <= 1000));
        let found = results.iter().filter(|result| result.score.loss <= best * (1.0 + 1e-9)).count();
        println!("{name}: {} designs, {rate:.0} per second, the best in {found} of 20", space.len());
        assert!(found >= 18, "{name}: {found} of 20");
    }
}

/// The winner of a search, through `predict`: the same electrons in every channel. Lines of excitation every 2 nm, averaged over an
/// LED of 12 nm, are off by less than 2e-3; the filter edge is resolved on 1 nm by the one and on 5 nm bands by the other, so it is
/// left away here.
#[test]
fn the_winner_is_what_predict_says() {
    let changes = ["view_filter.filters=[]", "unset vary.long-pass"].map(String::from);
    let space = space("two-lights", &changes);
    let (design, merits) = best(&space);
    for (k, &light) in design.lights.iter().enumerate() {
        let light = &space.problem().lights[light];
        let (nm, value) = (light.spectrum.wavelengths_nm(), light.spectrum.values());
        let table = |values: &[f64]| {
            format!("[{}]", values.iter().map(|v| format!("{v:.9e}")).collect::<Vec<_>>().join(", "))
        };
        let text = format!(
            "format = 1\n[light]\nspectrum = {{ type = \"table\", wavelength_nm = {}, value = {} }}\nstrength.irradiance_w_per_m2 = {}\n\
             [spectral]\nfirst_nm = 310.0\nlast_nm = 750.0\nstep_nm = 5.0\n[sample]\nreflectance = 0.0\n\
             concentrations = {{ nadh = 1.4895, fad = 1.0480, collagen = 1.0267, elastin = 2.0925, protoporphyrin_ix = 0.2100 }}\n\
             [lens]\nfocal_length_mm = 3.0\nf_number = 4.0\n[sensor]\ncolumns = 3\nrows = 1\nmosaic = [[\"600\", \"540\", \"460\"]]\n\
             pixel_size_um = 3.0\nfill_factor = 1.0\nread_noise_e = 2.0\nwell_capacity_e = 60000.0\n\
             [sensor.quantum_efficiency]\n600 = {}\n540 = {}\n460 = {}\n[exposure]\nexposure_ms = {}\n",
            table(nm),
            table(value),
            light.light,
            bell(600.0, 38.0),
            bell(540.0, 33.0),
            bell(460.0, 28.0),
            merits.times_s[k] * 1e3,
        );
        let sample = fluorspar_experiment::parse_sample(&text, "winner", Path::new("."), &[]).unwrap();
        let prediction = fluorspar::pipeline::predict(&sample.sample).unwrap();
        for (channel, electrons) in ["600", "540", "460"].iter().zip(&merits.regions[0].electrons[k]) {
            let expected = prediction.channels[*channel].electrons;
            assert!((electrons / expected - 1.0).abs() < 2e-3, "{channel}: {electrons} {expected}");
        }
    }
}

fn bell(center_nm: f64, sigma_nm: f64) -> String {
    let fwhm = 2.0 * sigma_nm * (2.0 * std::f64::consts::LN_2).sqrt();
    format!(
        "{{ type = \"bands\", base = 0.0, bands = [{{ peak_nm = {center_nm:.1}, fwhm_short_nm = {fwhm:.9}, fwhm_long_nm = {fwhm:.9}, weight = 0.5 }}] }}"
    )
}

/// Layered tissue with what varies among people; every design keeps to the limits or says which it breaks.
#[test]
fn a_camera_for_the_tongue_keeps_to_its_limits() {
    let changes = ["spectral.step_nm=10", "spectral.first_nm=400", "spectral.last_nm=720"].map(String::from);
    let space = space("tongue-camera", &changes);
    let unknown: Vec<&str> =
        space.problem().regions[0].changes.iter().map(|change| change.name.as_str()).collect();
    for name in
        ["superficial_blood_fraction", "deep_blood_fraction", "oxygen_saturation", "epithelium_thickness_um"]
    {
        assert!(unknown.contains(&name), "{unknown:?}");
    }
    let (design, merits) = best(&space);
    println!("{} {:?}", space.describe(&design), merits.regions[0].contrasts);
    assert!(merits.broken.is_empty() && merits.loss.is_finite(), "{merits:?}");
    assert!(merits.tissue_margin.unwrap() >= 2.0 && merits.leak <= 0.5 && merits.saturation <= 1.0);
}

/// People of a file in two states are told apart, and people who are the same in both are not.
#[test]
fn a_cohort_of_a_file_is_told_apart() {
    let text = "spectral = { first_nm = 430.0, last_nm = 690.0, step_nm = 20.0 }\n\
                excitation = { first_nm = 385.0, last_nm = 425.0, step_nm = 10.0 }\ncriterion = \"detection\"\n\
                [[region]]\nname = \"tongue\"\nmaterial = { tissue = \"dorsal_tongue\" }\n\
                [cohort]\ntissue = \"dorsal_tongue\"\nstate = \"dysplasia_moderate\"\npeople = 10\n\
                [[vary]]\nfield = \"light.led\"\nled = { peaks_nm = [405.0], fwhm_nm = 10.0 }\n\
                [exposure]\ntotal.ms = 1000.0\n";
    let text = &flat(text, 1000.0);
    let problem = parse_design(text, "cohort", Path::new("."), &[]).unwrap().problem;
    let cohort = problem.cohort.as_ref().unwrap();
    assert_eq!((cohort.healthy.len(), cohort.altered.len()), (10, 10));
    let space = DesignSpace::new(problem.clone()).unwrap();
    let merits = space.evaluate(&space.design(0));
    let apart = merits.detectability.unwrap();
    assert!(apart > 0.0 && (merits.loss * apart - 1.0).abs() < 1e-12, "{merits:?}");
    let mut same = problem;
    let cohort = same.cohort.as_mut().unwrap();
    cohort.altered.clone_from(&cohort.healthy);
    let same = DesignSpace::new(same).unwrap();
    assert_eq!(same.evaluate(&same.design(0)).detectability, Some(0.0));
    let wrong = text.replace("dysplasia", "dysplasya");
    let error = parse_design(&wrong, "cohort", Path::new("."), &[]).unwrap_err().to_string();
    assert!(error.contains("cohort.state"), "{error}");
}

/// A monochrome sensor behind a wheel: as many channels as filters, all pixels for each, a third of the time each.
#[test]
fn a_wheel_makes_channels_of_a_monochrome_sensor() {
    let mono = "vary.sensor.bands=[{ centers_nm = [560.0], sigma_nm = [200.0], read_noise_e = 2.0, full_well_e = 60000.0 }]";
    let wheel = "exposure.wheel=[{ name = \"red\", filters = [\"band_pass_635_50\"] }, \
                 { name = \"green\", filters = [\"band_pass_525_45\"] }, { name = \"blue\", filters = [\"band_pass_470_40\"] }]";
    let timed = "exposure={ counts = [1], total.ms = 100.0 }";
    let leds = "vary.light.led.peaks_nm=[365.0, 405.0]".to_owned();
    let changes: Vec<String> = [mono, timed].iter().map(|text| (*text).to_owned()).chain([leds]).collect();
    let alone = space("two-lights", &changes);
    let behind = space("two-lights", &[changes.clone(), vec![wheel.into()]].concat());
    let camera = &behind.problem().cameras[0];
    assert_eq!(camera.channels, ["red", "green", "blue"]);
    assert_eq!(camera.shares, [1.0; 3]);
    let of = |space: &DesignSpace| space.evaluate(&space.design(0)).regions.swap_remove(0);
    let (one, three) = (of(&alone), of(&behind));
    assert_eq!((one.rank, three.rank), (1, 3));
    // Filters of 40 to 50 nm, a third of the time each, pass less than a third of all light
    let sum = |electrons: &[Vec<f64>]| electrons[0].iter().sum::<f64>();
    assert!(sum(&three.electrons) < sum(&one.electrons) / 3.0 && sum(&three.electrons) > 0.0);
    let color = [
        "vary.sensor.bands=[{ centers_nm = [600.0, 540.0], sigma_nm = [30.0] }]".to_owned(),
        wheel.to_owned(),
    ];
    let error =
        parse_design(text_of("two-lights"), "two-lights", Path::new("."), &color).unwrap_err().to_string();
    assert!(error.contains("sensor of one channel"), "{error}");
}

/// A sensor of the catalogue, of a file and of the experiment itself is the same one.
#[test]
fn a_sensor_is_chosen_from_catalogue_and_files() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mine.toml");
    let text = "format = 1\n[sensor]\npreset = \"pi_camera_3\"\n";
    std::fs::write(&file, text).unwrap();
    let of_file = format!("vary.sensor.sensor_files=[\"{}\"]", file.display());
    let cameras = |changes: &[&str]| {
        let changes: Vec<String> = changes.iter().map(|change| (*change).into()).collect();
        resolved("two-lights", &changes).problem.cameras
    };
    let named = ["unset vary.sensor.bands", "vary.sensor.names=[\"RGB\"]"];
    let own = cameras(&["unset vary.sensor", "sensor.preset=pi_camera_3"]);
    let of_catalogue =
        cameras(&[&named[..], &["vary.sensor.values=[{ preset = \"pi_camera_3\" }]"]].concat());
    assert_eq!((own[0].name.as_str(), of_catalogue[0].name.as_str()), ("sensor", "RGB"));
    assert_eq!(own[0].relative_sensitivity(), of_catalogue[0].relative_sensitivity());
    assert_eq!(cameras(&[&named[..], &[&of_file]].concat()), of_catalogue);
}

/// Flat regions before the lights of an experiment lie where its camera looks: by a ring 103 mm away they get what its strength says.
/// Emitters count as points in that, which is good to 1 %.
#[test]
fn flat_regions_lie_where_the_camera_looks() {
    let text = "format = 2\nbase = \"oraleye-2021\"\n[[light]]\nname = \"blue\"\n\
        strength = { irradiance_w_per_m2 = 100.0, at_distance_mm = 102.96 }\n\
        [[region]]\nname = \"patch\"\nmaterial = { reflectance = 0.2, concentrations = { elastin = 1.0 } }\n\
        [[vary]]\nfield = \"light.blue.spectrum\"\nvalues = [\"led_385\", \"led_405\"]\n";
    let problem = parse_design(text, "ring", Path::new("."), &[]).unwrap().problem;
    assert_eq!(problem.lights.len(), 2);
    for light in &problem.lights {
        assert!(
            (light.light / 100.0 - 1.0).abs() < 0.01 && light.name.starts_with("led_"),
            "{}",
            light.light
        );
    }
}

/// A flat region under two lights of one group, with further lines and lights.
fn under_two_lights(lights: [&str; 2], more: &str) -> String {
    let light = |name: &str, spectrum: &str| {
        format!(
            "[[light]]\nname = \"{name}\"\ngroup = \"blue\"\ntype = \"distant\"\naim.direction = [0.0, 0.0, -1.0]\nspectrum = \"{spectrum}\"\n\
             filters = []\nstrength.irradiance_w_per_m2 = 10.0\n"
        )
    };
    format!(
        "format = 2\nbase = \"flat-patch\"\nunset = [\"light\"]\nsensor.preset = \"multispectral_3x3\"\n{more}{}{}\
         [[region]]\nname = \"tongue\"\nmaterial = {{ reflectance = \"gray_18\", concentrations = {{ fad = 1.0 }} }}\n\
         [[vary]]\nfield = \"lens.f_number\"\nvalues = [4.0, 1.4]\n[exposure]\ncounts = [1]\ntotal.ms = 60.0\n",
        light("first", lights[0]),
        light("second", lights[1])
    )
}

/// Lights of a group count by what each gives of the irradiance, whichever stands first.
#[test]
fn lights_of_a_group_count_together() {
    let electrons = |lights| {
        let problem =
            parse_design(&under_two_lights(lights, ""), "group", Path::new("."), &[]).unwrap().problem;
        let space = DesignSpace::new(problem).unwrap();
        space.evaluate(&space.design(0)).regions[0].electrons[0].clone()
    };
    let [short, long] = ["led_385", "led_450"];
    let [both, turned] = [electrons([short, long]), electrons([long, short])];
    // Each alone gives twice its part of both
    let [one, other] = [electrons([short, short]), electrons([long, long])];
    for k in 0..both.len() {
        assert!((both[k] / turned[k] - 1.0).abs() < 1e-9, "{both:?} {turned:?}");
        let expected = 0.5 * (one[k] + other[k]);
        assert!((both[k] / expected - 1.0).abs() < 0.01, "{k}: {} {expected}", both[k]);
    }
}

/// What a search can't take into account is refused.
#[test]
fn what_a_search_does_not_know_is_refused() {
    let cone = "view_filter = { filters = [\"long_pass_475\"], angles = \"lens\", effective_index = 1.5 }\n";
    let glow =
        "view_filter = { filters = [], autofluorescence = { photon_yield = 0.5, spectrum = \"led_450\" } }\n";
    let strobe = "sensor.strobe = { duration_ms = 1.0 }\n";
    for (more, words) in
        [(cone, "search each f-number"), (glow, "no fluorescence of filters"), (strobe, "strobe")]
    {
        let text = under_two_lights(["led_385", "led_450"], more);
        let error = parse_design(&text, "unknown", Path::new("."), &[]).unwrap_err().to_string();
        assert!(error.contains(words), "{more}: {error}");
    }
}

/// Values that change nothing a design looks at, fields that it does not have, and sections that it leaves alone are told.
#[test]
fn what_has_no_effect_is_refused() {
    for (changes, words) in [
        (
            vec!["insert vary.x={ field = \"capture.blue.exposure_ms\", values = [1.0] }"],
            "changes nothing that a design chooses",
        ),
        (vec!["insert vary.x={ field = \"lens.focal_length_mm\", values = [1.0] }"], "It chooses light.NAME"),
        (vec!["insert vary.x={ field = \"sensor.strobe\", values = [1.0] }"], "sensor.strobe"),
        (
            vec!["insert vary.x={ field = \"light.leds.spectrum\", values = [\"led_405\"] }"],
            "did you mean \"led\"?",
        ),
        (
            vec!["insert vary.x={ field = \"light.led.spectrum\", values = [\"led_4055\"] }"],
            "there is no light spectrum \"led_4055\"",
        ),
        (
            vec![
                "unset vary.sensor.bands",
                "vary.sensor.values=[{ preset = \"pi_camera_3\" }, { preset = \"pi_camera_3\" }]",
                "vary.sensor.names=[\"a\", \"b\"]",
            ],
            "none of the values changes anything",
        ),
        (vec!["capture.blue.exposure_ms=1"], "capture"),
        (vec!["mouth.seed=2"], "`mouth` changes nothing of this design"),
        (vec!["vary.light.led.peaks=[405.0]"], "peaks_nm"),
        (vec!["vary.light.costs=[1.0, 2.0]"], "one for each of the 27 values"),
    ] {
        let changes: Vec<String> = changes.into_iter().map(String::from).collect();
        let error = parse_design(text_of("two-lights"), "two-lights", Path::new("."), &changes);
        let error = error.unwrap_err().to_string();
        assert!(error.contains(words), "{changes:?}: {error}");
    }
}

/// What the report says of a quarter more of an assumed number is what the file with that number gives. The two ways differ in rounding,
/// and in a layer of blood by the interpolation of its curve: 1e-4 of the loss.
#[test]
fn sensitivities_are_what_a_changed_file_gives() {
    let text = "criterion = \"contrast\"\nview_filter = {}\nsensor.preset = \"pi_camera_3\"\n\
                [[region]]\nname = \"tongue\"\n\
                material = { reflectance = \"tongue_dorsum\", concentrations = { elastin = 1.0, fad = 0.3, biofilm_porphyrin = 0.1 } }\n\
                [[vary]]\nfield = \"light.led\"\nled = { peaks_nm = [385.0, 405.0] }\n\
                [[vary]]\nfield = \"view_filter\"\nlong_pass.edges_nm = [475.0]\n\
                [exposure]\ncounts = [2]\ntotal.ms = 60.0\n\
                [unknown]\ngain = 0.2\nblood_um = 50.0\nemission_shift_nm = 3.0\nleak = 0.3\n\
                [[contrast]]\nname = \"porphyrin fraction\"\npart = [\"biofilm_porphyrin\"]\n";
    let text = &flat(text, 20.0);
    let of = |change: Option<&str>| {
        let changes: Vec<String> = change.into_iter().map(String::from).collect();
        let problem = parse_design(text, "blood", Path::new("."), &changes).unwrap().problem;
        let space = DesignSpace::new(problem).unwrap();
        let design = space.design(0);
        (space.evaluate(&design).loss, space, design)
    };
    let (before, space, design) = of(None);
    let told = fluorspar::design::sensitivities(space.problem(), &[design]).unwrap();
    let held = "region.tongue.material.concentrations";
    for (assumption, change) in [
        ("biofilm_porphyrin", format!("{held}.biofilm_porphyrin=0.125")),
        ("elastin", format!("{held}.elastin=1.25")),
        ("fad", format!("{held}.fad=0.375")),
        ("spread of blood", "unknown.blood_um=62.5".into()),
        ("unknown gain", "unknown.gain=0.25".into()),
        ("unknown leak", "unknown.leak=0.375".into()),
        ("shift of emission", "unknown.emission_shift_nm=3.75".into()),
        ("pixels of a region", "unknown.pixels=1250".into()),
        ("time or electrons in all", "exposure.total.ms=75".into()),
    ] {
        let expected = of(Some(&change)).0 / before - 1.0;
        let found = told.iter().find(|s| s.assumption == assumption).unwrap().loss_change;
        assert!((found - expected).abs() < 1e-4, "{assumption}: {found} told, {expected} of a changed file");
    }
}

/// What is wrong with eyes, margins and fluorophores that have weights of their own is told with its cure.
#[test]
fn margins_and_weights_of_their_own_are_told_with_their_cures() {
    let text = text_of("two-lights");
    let of = |changes: &[&str]| {
        let changes: Vec<String> = changes.iter().map(|change| (*change).into()).collect();
        parse_design(text, "two-lights", Path::new("."), &changes)
    };
    let name = resolved("two-lights", &[]).problem.regions[0].response.name.clone();
    let apart = |list: &str| format!("region.\"{name}\".apart={list}");
    for (changes, words) in [
        (vec!["limit.eye_margin=1.0"], "add [eye] with source_mrad"),
        (vec!["eye.irradiance_share=1.0"], "its diameter over its distance"),
        (vec!["eye.source_mrad=0.0"], "between 0.1 and 3000"),
        (vec!["limit.saturation=0.0"], "between 1e-6 and 1000000"),
        (vec![apart("[\"elastine\"]").as_str()], "did you mean \"elastin\""),
    ] {
        let error = of(&changes).unwrap_err().to_string();
        assert!(error.contains(words), "{changes:?}: {error}");
    }
    // What saturates is no measurement, unless the file says so
    assert_eq!(of(&[]).unwrap().problem.limits.saturation, Some(1.0));
    assert_eq!(of(&["limit.saturation=1e6"]).unwrap().problem.limits.saturation, Some(1e6));
    let seen = of(&["eye.source_mrad=5.0", "limit.eye_margin=2.0"]).unwrap().problem;
    assert_eq!(seen.limits.eye_margin, Some(2.0));
    let space = DesignSpace::new(seen).unwrap();
    assert!(space.evaluate(&space.design(0)).eye_margin.unwrap() > 0.0);
}

/// A flat region with some fluorophores apart sends the same light, and three channels under one light tell porphyrin from the rest where
/// five weights are too many.
#[test]
fn flat_tissue_has_the_weights_that_are_asked_for() {
    let text = "[[region]]\nname = \"tongue\"\nmaterial = { tissue = \"dorsal_tongue\" }\n\
        [[vary]]\nfield = \"light.led\"\nled.peaks_nm = [405.0]\n\
        [[vary]]\nfield = \"view_filter\"\nlong_pass.edges_nm = [475.0]\n[unknown]\ntissue = 1.0\n";
    let text = &flat(text, 10.0);
    let of = |changes: &[&str]| {
        let changes: Vec<String> = changes.iter().map(|change| (*change).into()).collect();
        parse_design(text, "tongue", Path::new("."), &changes).unwrap().problem
    };
    let (all, some) = (of(&[]), of(&["region.tongue.apart=[\"biofilm_porphyrin\"]"]));
    let names = |p: &fluorspar::design::DesignProblem| -> Vec<String> {
        p.regions[0].response.fluorescence.iter().map(|part| part.name.clone()).collect()
    };
    assert_eq!(names(&some), ["bulk", "biofilm_porphyrin"]);
    let total = |p: &fluorspar::design::DesignProblem| -> Vec<f64> {
        let parts = &p.regions[0].response.fluorescence;
        (0..parts[0].radiance.len()).map(|k| parts.iter().map(|part| part.radiance[k]).sum()).collect()
    };
    for (a, b) in total(&all).iter().zip(total(&some)) {
        // Sums of seven values in another order
        assert!((a - b).abs() <= 8.0 * f64::EPSILON * a.abs(), "{a} {b}");
    }
    for (a, b) in all.regions[0].changes.iter().zip(&some.regions[0].changes) {
        assert_eq!((&a.name, a.fluorescence.len(), b.fluorescence.len()), (&b.name, 7, 2));
        let sum = |parts: &[Vec<f64>], k: usize| parts.iter().map(|part| part[k]).sum::<f64>();
        let size = |k: usize| a.fluorescence.iter().map(|part| part[k].abs()).sum::<f64>();
        let rounding = |k: usize| 8.0 * f64::EPSILON * size(k);
        for k in 0..b.fluorescence[0].len() {
            assert!((sum(&a.fluorescence, k) - sum(&b.fluorescence, k)).abs() <= rounding(k), "{}", a.name);
        }
    }
    let evaluated = |p| {
        let space = DesignSpace::new(p).unwrap();
        space.evaluate(&space.design(0)).regions.swap_remove(0)
    };
    let (blind, seen) = (evaluated(all), evaluated(some));
    assert_eq!((blind.rank, seen.rank), (3, 2));
    assert!(blind.weights.iter().any(|w| w.is_infinite()) && seen.weights.iter().all(|w| w.is_finite()));
}

/// A series of LEDs without peaks offers generic LEDs from 340 to 500 nm by 5 nm, all of whose light the nodes of excitation describe.
#[test]
fn generic_leds_are_offered_by_five_nanometers() {
    let text = "[[region]]\nname = \"patch\"\nmaterial = { reflectance = 0.2, concentrations = { elastin = 1.0, fad = 1.0 } }\n\
        [[vary]]\nfield = \"light.led\"\nled = {}\n";
    let resolved = parse_design(&flat(text, 10.0), "leds", Path::new("."), &[]).unwrap();
    let peaks: Vec<f64> = resolved.problem.lights.iter().map(|light| light.peak_nm).collect();
    assert_eq!((peaks.len(), peaks[0], peaks[1], peaks[32]), (33, 340.0, 345.0, 500.0));
    assert!(resolved.record.warnings.is_empty(), "{:?}", resolved.record.warnings);
}
