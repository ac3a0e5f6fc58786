//! Every experiment of the catalogue parses, resolves and can be made again from its resolved file.

use std::path::Path;
use std::time::Instant;

use fluorspar::pipeline::predict;
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{DEFAULT_SAMPLE, is_sample, parse, parse_sample, resolve};

#[test]
fn every_experiment_of_the_catalogue_resolves_and_comes_back_from_its_resolved_file() {
    for name in preset::names(PresetKind::Experiment) {
        let preset = preset::text(PresetKind::Experiment, name).unwrap();
        let start = Instant::now();
        let experiment = parse(preset, name, Path::new("."), &[]).unwrap_or_else(|e| panic!("{e}"));
        let resolved = resolve(&experiment).unwrap_or_else(|e| panic!("{e}"));
        println!("{name}: {} objects, {:?}", resolved.study.scene.objects.len(), start.elapsed());
        for warning in &resolved.record.warnings {
            println!("  warning: {warning}");
        }
        let again = parse(&resolved.record.resolved_toml, "resolved.toml", Path::new("/nowhere"), &[])
            .unwrap_or_else(|e| panic!("{e}\n{}", resolved.record.resolved_toml));
        let again = resolve(&again).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(again.record.resolved_toml, resolved.record.resolved_toml, "{name}");
        assert_eq!(again.record.sha256, resolved.record.sha256, "{name}");
        assert!(again.study == resolved.study, "{name}");
    }
}

#[test]
fn every_flat_sample_of_the_catalogue_can_be_predicted_and_comes_back_from_its_resolved_file() {
    let names = preset::names(PresetKind::Sample);
    assert!(names.contains(&DEFAULT_SAMPLE));
    for name in names {
        let preset = preset::text(PresetKind::Sample, name).unwrap();
        assert!(is_sample(preset), "{name}");
        let sample = parse_sample(preset, name, Path::new("."), &[]).unwrap_or_else(|e| panic!("{e}"));
        assert!(sample.record.warnings.is_empty(), "{name}: {:?}", sample.record.warnings);
        let prediction = predict(&sample.sample).unwrap();
        assert!(prediction.channels.values().all(|c| !c.saturated && c.electrons > 100.0), "{prediction:?}");
        let again =
            parse_sample(&sample.record.resolved_toml, "resolved.toml", Path::new("/nowhere"), &[]).unwrap();
        assert_eq!(
            (&again.record.sha256, &again.record.resolved_toml),
            (&sample.record.sha256, &sample.record.resolved_toml),
            "{name}"
        );
    }
    assert!(!is_sample(preset::text(PresetKind::Experiment, "oraleye-2021").unwrap()));
    assert!(!is_sample("sample = 1") && !is_sample("[sample"));
}
