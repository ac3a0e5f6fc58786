//! Views of the mouth by name.
#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::path::Path;

use fluorspar_anatomy::{ExaminationView, MouthParameters};
use fluorspar_experiment::{Experiment, parse};

/// The default mouth with a section `[mouth]` on top.
fn experiment(mouth: &str, overrides: &[&str]) -> Experiment {
    let overrides: Vec<String> = overrides.iter().map(ToString::to_string).collect();
    let text = format!("format = 1\nbase = \"oraleye-2021\"\n[mouth]\n{mouth}");
    parse(&text, "test", Path::new("."), &overrides).unwrap()
}

fn parameters(experiment: &Experiment) -> MouthParameters {
    experiment.file.mouth.clone().unwrap().parameters
}

#[test]
fn a_view_of_the_mouth_gives_pose_and_camera() {
    let view = ExaminationView::find("right-cheek").unwrap();
    let of_view = experiment("view = \"right-cheek\"", &[]);
    let base = parameters(&experiment("", &[]));
    assert_eq!(parameters(&of_view), view.pose(&base));
    assert!(base.lip_opening_width_mm < parameters(&of_view).lip_opening_width_mm, "drawn apart");
    assert_eq!(of_view.file.camera.position_mm, view.camera_mm);
    assert_eq!(of_view.file.camera.look_at_mm, view.look_at_mm);
}

#[test]
fn what_a_file_says_comes_before_its_view_of_the_mouth() {
    let own = experiment(
        "view = \"throat\"\ntongue_protrusion_mm = 3.0\n[camera]\nposition_mm = [0.0, 0.0, 70.0]",
        &["mouth.jaw_opening_mm=40"],
    );
    let view = ExaminationView::find("throat").unwrap();
    let pose = parameters(&own);
    assert_eq!((pose.tongue_protrusion_mm, pose.jaw_opening_mm), (3.0, 40.0));
    assert_eq!(pose.lip_retraction_mm, view.lip_retraction_mm);
    assert_eq!(own.file.camera.position_mm, [0.0, 0.0, 70.0]);
    assert_eq!(own.file.camera.look_at_mm, view.look_at_mm);
}

#[test]
fn an_override_changes_the_view_of_the_mouth() {
    let changed = experiment("view = \"right-cheek\"", &["mouth.view=\"tongue-out\""]);
    let direct = experiment("view = \"tongue-out\"", &[]);
    assert_eq!(parameters(&changed), parameters(&direct));
    assert_eq!(changed.file.camera, direct.file.camera);
}
