//! Every experiment of the catalogue parses, resolves and can be made again from its resolved file.

use std::path::Path;
use std::time::Instant;

use fluorspar::experiment::{parse, resolve};
use fluorspar::preset::{self, PresetKind};

#[test]
fn every_experiment_of_the_catalogue_resolves_and_comes_back_from_its_resolved_file() {
    for name in preset::names(PresetKind::Experiment) {
        let preset = preset::experiment(name).unwrap();
        let start = Instant::now();
        let experiment = parse(preset.text, name, Path::new("."), &[]).unwrap_or_else(|e| panic!("{e}"));
        let resolved = resolve(&experiment).unwrap_or_else(|e| panic!("{e}"));
        println!("{name}: {} objects, {:?}", resolved.scene.objects.len(), start.elapsed());
        for warning in &resolved.warnings {
            println!("  warning: {warning}");
        }
        let again = parse(&resolved.resolved_toml, "resolved.toml", Path::new("/nowhere"), &[])
            .unwrap_or_else(|e| panic!("{e}\n{}", resolved.resolved_toml));
        let again = resolve(&again).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(again.resolved_toml, resolved.resolved_toml, "{name}");
        assert_eq!(again.sha256, resolved.sha256, "{name}");
        assert!(again.scene == resolved.scene, "{name}");
        assert!(again.lens == resolved.lens, "{name}");
        assert!(again.sensor == resolved.sensor, "{name}");
        assert!(again.captures == resolved.captures, "{name}");
        assert!(again.analysis == resolved.analysis, "{name}");
    }
}
