//! Digests of every stage, stored: changes of the code that are meant to change no result change none, to the last bit.
//!
//! Radiance, electron rates and digital numbers are held. Where the mathematical functions of the machine round otherwise
//! than those of the machine that stored the digests, the comparison says so and is left out.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "these are tests")]

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use crate::support::{LIGHTS, MATERIALS, lit_box, run, settings};
use fluorspar::image::ComponentImage;
use fluorspar::pipeline::{capture, frame_radiance};
use fluorspar::study::Study;
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{parse, resolve};
use sha2::{Digest, Sha256};

/// Collects the bits of values.
#[derive(Default)]
struct Bits(Sha256);

impl Bits {
    fn add(&mut self, values: impl IntoIterator<Item = f32>) {
        values.into_iter().for_each(|value| self.0.update(value.to_bits().to_le_bytes()));
    }

    fn text(self) -> String {
        self.0.finalize().iter().take(10).fold(String::new(), |mut text, byte| {
            write!(text, "{byte:02x}").unwrap();
            text
        })
    }
}

fn digest(values: impl IntoIterator<Item = f32>) -> String {
    let mut bits = Bits::default();
    bits.add(values);
    bits.text()
}

/// How sine, cosine, exponential, logarithm and powers round on this machine.
fn mathematics() -> String {
    let arguments = (1..4000).map(|i| f64::from(i) * 0.001_7);
    digest(arguments.flat_map(|x| {
        let y = x as f32;
        let double = [x.sin(), x.cos(), x.exp(), x.ln(), x.powf(1.7), x.atan(), x.tanh(), x.ln_1p()];
        let halves = double
            .into_iter()
            .flat_map(|v| [f32::from_bits(v.to_bits() as u32), f32::from_bits((v.to_bits() >> 32) as u32)]);
        let single = [y.sin(), y.cos(), y.exp(), y.ln(), y.powf(1.7), (y * 0.14).acos(), y.atan2(1.3)];
        halves.chain(single).collect::<Vec<_>>()
    }))
}

fn with_changes(text: &str, changes: &[&str]) -> Study {
    // Digests are those of all bands
    let all = std::iter::once(&"render.component_bands=\"all\"").chain(changes);
    let changes: Vec<String> = all.map(|change| (*change).to_owned()).collect();
    resolve(&parse(text, "digests", Path::new("."), &changes).unwrap()).unwrap().study
}

/// Radiance, electron rates of the first capture behind the ideal lens, raw and developed values of an experiment.
fn add_experiment(digests: &mut BTreeMap<String, String>, name: &str, study: &Study) {
    let image: ComponentImage = run(&study.scene, &study.render);
    digests.insert(format!("radiance {name}"), digest(image.data.iter().copied()));
    let (Some(lens), Some(sensor)) = (study.camera.lens_behind_filters(), &study.camera.sensor) else {
        return;
    };
    let mut rates = Bits::default();
    for capture in &study.captures {
        let radiance = frame_radiance(&capture.frame, &image);
        let width_mm = sensor.model().width_mm();
        let rate = sensor.electron_rate(&lens.form_image(&radiance, width_mm));
        rates.add(rate.data);
    }
    digests.insert(format!("electrons {name}"), rates.text());
    let (mut raw, mut developed) = (Bits::default(), Bits::default());
    for frame in capture(study, &image).unwrap() {
        raw.add(frame.raw.data.iter().map(|dn| f32::from(*dn)));
        frame.bracket.iter().for_each(|other| raw.add(other.data.iter().map(|dn| f32::from(*dn))));
        developed.add(frame.developed.data);
    }
    digests.insert(format!("digital numbers {name}"), raw.text());
    digests.insert(format!("developed {name}"), developed.text());
}

fn measured() -> BTreeMap<String, String> {
    let mut digests = BTreeMap::new();
    digests.insert("mathematics".into(), mathematics());

    let mut by_light: Vec<Bits> = LIGHTS.iter().map(|_| Bits::default()).collect();
    for material in MATERIALS {
        let mut by_material = Bits::default();
        for (light, bits) in LIGHTS.iter().zip(&mut by_light) {
            let image = run(&lit_box(light, material, 1.0), &settings(4, 6));
            by_material.add(image.data.iter().copied());
            bits.add(image.data);
        }
        digests.insert(format!("radiance of {material} under all lamps"), by_material.text());
    }
    for (light, bits) in LIGHTS.iter().zip(by_light) {
        digests.insert(format!("radiance of all materials under {light}"), bits.text());
    }

    let small = ["render.width_px=24", "render.height_px=18", "render.samples_per_pixel=3"];
    let few_pixels = ["sensor.columns=48", "sensor.rows=36"];
    let catalogue = |name: &str| preset::text(PresetKind::Experiment, name).unwrap().to_owned();
    let experiment = |name: &str, more: &[&str]| {
        let changes: Vec<&str> = small.iter().chain(more).copied().collect();
        with_changes(&catalogue(name), &changes)
    };
    for name in ["oraleye-2021", "oraleye-2021-surface"] {
        add_experiment(&mut digests, name, &experiment(name, &["mouth.detail=0.25"]));
    }
    add_experiment(&mut digests, "flat-patch", &experiment("flat-patch", &few_pixels));
    add_experiment(&mut digests, "fluorescent-sphere", &experiment("fluorescent-sphere", &[]));
    let traced = catalogue("flat-patch").replace(
        "focal_length_mm = 3.0\nf_number = 4.0\nvignetting = \"none\"\n",
        "type = \"traced\"\nprescription = \"wide_3_5mm\"\n",
    );
    let changes: Vec<&str> = small.iter().chain(&few_pixels).copied().collect();
    add_experiment(&mut digests, "traced lens", &with_changes(&traced, &changes));
    let changes: Vec<&str> =
        small.iter().chain(&few_pixels).chain(&["lens.image_formation=\"point_spread\""]).copied().collect();
    add_experiment(&mut digests, "point spread", &with_changes(&traced, &changes));
    digests
}

#[test]
fn every_stage_gives_the_stored_bits() {
    let stored: BTreeMap<String, String> = include_str!("../data/stage_digests.txt")
        .lines()
        .filter_map(|line| line.split_once(": "))
        .map(|(name, digest)| (name.to_owned(), digest.to_owned()))
        .collect();
    let measured = measured();
    let listed = measured.iter().map(|(name, digest)| format!("{name}: {digest}\n")).collect::<String>();
    if measured["mathematics"] != stored["mathematics"] {
        println!(
            "skipped: the mathematical functions of this machine round otherwise than the stored digests'\n{listed}"
        );
        return;
    }
    let differing: Vec<&String> = measured
        .keys()
        .chain(stored.keys())
        .filter(|name| measured.get(*name) != stored.get(*name))
        .collect();
    assert!(differing.is_empty(), "other bits than stored: {differing:?}\nAll digests of now:\n{listed}");
}
