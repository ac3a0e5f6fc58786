//! Experiments of absurd length: refused with their number, in time that grows no faster than they do.

#![allow(clippy::unwrap_used)]

use std::fmt::Write;
use std::path::Path;
use std::time::{Duration, Instant};

use fluorspar_experiment::{parse, parse_sample, parse_sensor, resolve};

/// What is wrong with a text; the time is bounded generously, as others may work on the machine.
fn complaint(text: &str) -> String {
    let begun = Instant::now();
    let folder = Path::new(".");
    let said = parse(text, "e", folder, &[]).and_then(|e| resolve(&e)).map(|_| ()).unwrap_err().to_string();
    // The same text as other files: whatever they say, they say it in time.
    let _ = (parse_sample(text, "e", folder, &[]), parse_sensor(text, "e", folder, &[]));
    assert!(begun.elapsed() < Duration::from_secs(60), "{:?}", begun.elapsed());
    said
}

#[test]
fn more_keys_than_any_table_has_are_refused() {
    let mut keys = String::from("format = 1\n");
    for number in 0..100_000 {
        writeln!(keys, "a{number} = 1").unwrap();
    }
    assert_eq!(
        complaint(&keys),
        "e:1: 100001 keys in one table; at most 10000 are read. Is this the right file?"
    );
}

#[test]
fn more_entries_than_any_list_has_are_refused() {
    let list = "format = 1\n".to_string() + &"[[a]]\n".repeat(100_000);
    let said = complaint(&list);
    assert!(
        said.ends_with(": 100000 tables in one list; at most 10000 are read. Is this the right file?"),
        "{said}"
    );
}

#[test]
fn more_bytes_than_any_experiment_has_are_refused() {
    let long = format!("format = 1\ntitle = \"{}\"\n", "x".repeat(5 << 20));
    let said = complaint(&long);
    assert!(said.ends_with("at most 4194304 are read. Put long tables into files of their own"), "{said}");
}

#[test]
fn long_chains_of_mixtures_are_followed_or_refused() {
    let chain = |length: usize| {
        let mut text = String::from("format = 1\nbase = \"flat-patch\"\n");
        for number in 0..length {
            let next = (number + 1) % length;
            writeln!(
                text,
                "[[material]]\nname = \"m{number}\"\ntype = \"mix\"\nfirst = \"m{next}\"\nsecond = \"m{next}\"\namount = 0.5"
            )
            .unwrap();
        }
        text
    };
    // A chain that ends in itself.
    let said = complaint(&chain(3000));
    assert!(said.contains("itself"), "{said}");
    let said = complaint(&chain(4100));
    assert!(said.contains("an experiment has at most 4000"), "{said}");
}

#[test]
fn names_beyond_all_length_are_not_compared() {
    let said = complaint(&format!("format = 1\n{} = 1\n", "a".repeat(1 << 20)));
    assert!(said.len() < 3000, "{} bytes", said.len());
}

#[test]
fn more_targets_than_labels_are_refused() {
    let mut text = String::from("format = 1\nbase = \"flat-patch\"\n");
    for number in 0..256 {
        write!(text, "[[target]]\nname = \"t{number}\"\nrectangle_px = [8, 8, 4, 4]\n").unwrap();
    }
    let said = complaint(&text);
    assert!(
        said.contains("256 targets, lesions included, and the image of labels has numbers for 255"),
        "{said}"
    );
}
