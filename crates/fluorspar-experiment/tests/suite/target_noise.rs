//! What the noise of a render leaves of the numbers that tell how well a target is seen.

#![allow(clippy::unwrap_used, reason = "a helper that fails is a failed test")]

use std::path::Path;
use std::sync::atomic::AtomicBool;

use fluorspar::analysis::TargetDetection;
use fluorspar::{pipeline, render};
use fluorspar_experiment::{parse, resolve};

/// A dot on a patch beside a large bright sphere, of which every sample of the render meets one place.
const DOT: &str = r#"
format = 1
base = "flat-patch"

[[light]]
name = "blue"
remove = true

[[light]]
name = "lamp"
group = "blue"
type = "sphere"
position_mm = [110.0, 0.0, 70.0]
radius_mm = 40.0
spectrum = "led_385"
filters = ["short_pass_425"]
strength.power_mw = 100000.0

[[material]]
name = "dot"
reflectance = "tongue_dorsum"
concentrations = { fad = 0.21, collagen = 0.21, elastin = 1.05, keratin = 0.21, protoporphyrin_ix = 0.105 }

[[object]]
name = "dot"
material = "dot"
type = "disc"
center_mm = [2.0, 1.0, 0.01]
normal = [0.0, 0.0, 1.0]
radius_mm = 4.0

[[target]]
name = "spot"
parts = ["dot"]
"#;

fn detection(samples: u32, changes: &[&str]) -> TargetDetection {
    let mut changes: Vec<String> = changes.iter().map(|change| (*change).to_owned()).collect();
    changes.push(format!("render.samples_per_pixel={samples}"));
    let study = resolve(&parse(DOT, "dot", Path::new("."), &changes).unwrap()).unwrap().study;
    let control = render::RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
    let components = render::render(&study.scene, &study.render, &control).unwrap();
    let analysis = pipeline::evaluate(&study, &components).unwrap().analysis.unwrap().analysis;
    analysis.targets.into_iter().find(|target| target.frame == "blue").unwrap()
}

/// The smallest diameter is a property of camera and tissue, not of the number of samples: whatever that is, each value lies within the
/// 95 % interval of the others. Few samples say that they limit the interval and how many would not.
#[test]
fn few_samples_tell_the_diameter_of_many() {
    let found = [4, 16, 256].map(|samples| detection(samples, &[]));
    for a in &found {
        println!(
            "{:.2} px ({:.2} to {:?}), render noise {:?}, {:?} samples",
            a.smallest_diameter_px,
            a.smallest_diameter_least_px,
            a.smallest_diameter_most_px,
            a.render_noise,
            a.samples_needed
        );
        for b in &found {
            let most = a.smallest_diameter_most_px.unwrap();
            let px = b.smallest_diameter_px;
            assert!((a.smallest_diameter_least_px..=most).contains(&px), "{px}: {a:?}");
            let [low, high] = a.d_prime_interval.unwrap();
            assert!((low..=high).contains(&b.d_prime), "{}: {low} to {high}", b.d_prime);
        }
    }
    let [few, _, many] = &found;
    assert!(few.render_noise.unwrap() > 10.0 * many.render_noise.unwrap(), "{few:?} {many:?}");
    assert!(
        few.samples_needed.is_some_and(|samples| samples > 16) && many.samples_needed.is_none(),
        "{few:?}"
    );
    // Left in, the noise of four samples would make the disc `sqrt(1 + 8.7)` times as wide.
    assert!(few.render_noise.unwrap() > 5.0, "{few:?}");
}

/// A disc that the camera sees askew covers fewer pixels: of the surface it is as large as that of one that faces it, times the root of
/// what the tilt hides. Turned by 60 degrees an area covers half as many pixels, and a pixel twice the area.
#[test]
fn diameters_are_those_of_the_surface() {
    let mm_per_px =
        |found: &TargetDetection| found.smallest_diameter_mm.unwrap() / found.smallest_diameter_px;
    let facing = detection(16, &[]);
    // From 100 mm away at 60 degrees, on the side without the lamp
    let askew = detection(16, &["camera.position_mm=[-86.6, 0.0, 50.0]"]);
    let ratio = mm_per_px(&askew) / mm_per_px(&facing);
    // The dot lies 2 mm off the axis, and the field about it is 8 mm wide: distances differ by 2 %, cosines by 4 %.
    assert!((ratio / 2f64.sqrt() - 1.0).abs() < 0.05, "{ratio}");
}
