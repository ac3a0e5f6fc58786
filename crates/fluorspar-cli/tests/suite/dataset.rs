//! Data sets: annotations that fit the masks, splits by person, the same files in one go, in shards and after a kill; refusals.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use fluorspar::pipeline::part_color;
use fluorspar_format::{Transfer, read_texture_png};
use serde_json::Value;

use crate::cohort::{contents, kill_after_two_views, workshop};
use crate::support::{fluorspar, listing};

/// Numbers of the colors of an indexed picture.
fn labels(path: &Path) -> Vec<u8> {
    assert_eq!(fs::read(path).unwrap()[25], 3, "{} has no palette", path.display());
    let picture = read_texture_png(path, Transfer::Linear).unwrap();
    let palette: Vec<[u8; 3]> = std::iter::once([0; 3]).chain((1..=120).map(part_color)).collect();
    assert_eq!(palette.iter().collect::<BTreeSet<_>>().len(), palette.len());
    let number = |color: &[f32]| {
        let color: Vec<u8> = color.iter().map(|value| (255.0 * value).round() as u8).collect();
        palette.iter().position(|known| known[..] == color[..3]).unwrap() as u8
    };
    picture.data.chunks(picture.channels).map(number).collect()
}

/// Shape of a NumPy array of 32-bit numbers, and the numbers.
fn array(path: &Path) -> (String, Vec<f32>) {
    let bytes = fs::read(path).unwrap();
    let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let head = String::from_utf8(bytes[10..10 + length].to_vec()).unwrap();
    let shape = head.split_once("'shape': (").unwrap().1.split_once(')').unwrap().0.to_owned();
    let (values, rest) = bytes[10 + length..].as_chunks::<4>();
    assert!(rest.is_empty() && head.contains("'<f4'"), "{head}");
    (shape, values.iter().map(|value| f32::from_le_bytes(*value)).collect())
}

/// Pixels of runs of COCO, `[row, col]`.
fn decoded(runs: &Value) -> Vec<bool> {
    let [height, width] = [0, 1].map(|axis| runs["size"][axis].as_u64().unwrap() as usize);
    let counts = runs["counts"].as_array().unwrap().iter().map(|count| count.as_u64().unwrap());
    let along: Vec<bool> =
        counts.enumerate().flat_map(|(n, count)| (0..count).map(move |_| n % 2 == 1)).collect();
    assert_eq!(along.len(), width * height);
    (0..width * height).map(|pixel| along[pixel % width * height + pixel / width]).collect()
}

/// Checks the annotations of all parts of a data set against its files, and gives the part of each person.
fn judged(folder: &Path) -> BTreeMap<u64, String> {
    let (mut splits, mut ids, mut lesions) = (BTreeMap::new(), BTreeSet::new(), 0);
    for split in ["train", "validation", "test"] {
        let text = fs::read_to_string(folder.join(format!("annotations_{split}.json"))).unwrap();
        let coco: Value = serde_json::from_str(&text).unwrap();
        let name = |id: &Value| {
            coco["categories"].as_array().unwrap().iter().find(|of| of["id"] == *id).unwrap().clone()
        };
        for image in coco["images"].as_array().unwrap() {
            let person = image["person"].as_u64().unwrap();
            assert_eq!(*splits.entry(person).or_insert_with(|| split.to_owned()), split);
            let file =
                |key: &str| folder.join(image[key].as_str().unwrap_or_else(|| panic!("{key}: {image}")));
            assert!(file("file_name").is_file() && file("raw").is_file(), "{image}");
            let masks = [("lesion", "lesions_mask"), ("part", "parts_mask")]
                .map(|(k, file_of)| (k, labels(&file(file_of))));
            let masks = BTreeMap::from(masks);
            let own = coco["annotations"].as_array().unwrap().iter().filter(|a| a["image_id"] == image["id"]);
            let mut told = 0;
            for annotation in own {
                assert!(ids.insert(annotation["id"].as_u64().unwrap()));
                let category = name(&annotation["category_id"]);
                let kind = category["supercategory"].as_str().unwrap();
                lesions += usize::from(kind == "lesion");
                let number = category["id"].as_u64().unwrap() as u8;
                let inside: Vec<bool> = masks[kind].iter().map(|label| *label == number).collect();
                assert_eq!(decoded(&annotation["segmentation"]), inside, "{category}");
                let area = inside.iter().filter(|is| **is).count();
                assert_eq!(annotation["area"], area);
                told += area;
                let of = |axis: fn(usize) -> usize| {
                    let places: Vec<usize> = (0..inside.len()).filter(|p| inside[*p]).map(axis).collect();
                    [*places.iter().min().unwrap(), places.iter().max().unwrap() + 1]
                };
                let ([left, right], [top, bottom]) = (of(|pixel| pixel % 64), of(|pixel| pixel / 64));
                assert_eq!(annotation["bbox"], serde_json::json!([left, top, right - left, bottom - top]));
            }
            let seen = |labels: &Vec<u8>| labels.iter().filter(|label| **label > 0).count();
            assert_eq!(told, masks.values().map(seen).sum::<usize>(), "pixels without annotation");

            let maps = ["depth_m", "normal", "electrons"].map(|name| array(&file(&format!("{name}_file"))));
            let [(flat, depth), (directions, normal), (lights, electrons)] = maps;
            let number = image["electrons"].as_array().unwrap().len();
            assert_eq!(
                [flat, directions, lights],
                ["48, 64".into(), "48, 64, 3".into(), format!("{number}, 48, 64")]
            );
            for (pixel, part) in masks["part"].iter().enumerate() {
                let normal = &normal[3 * pixel..][..3];
                let length: f32 = normal.iter().map(|value| value * value).sum();
                let wanted = if *part > 0 { [1.0, 0.05] } else { [0.0, 0.0] };
                assert!((length - wanted[0]).abs() < 1e-3, "{normal:?} on {part}");
                assert!(depth[pixel] >= wanted[1] && depth[pixel] < 0.3, "{}", depth[pixel]);
            }
            assert!(electrons.iter().all(|value| *value >= 0.0) && electrons.iter().sum::<f32>() > 0.0);
        }
    }
    assert!(lesions > 0);
    splits
}

#[test]
fn annotations_fit_the_masks_and_shards_kills_and_threads_give_the_same_files() {
    let workshop = workshop();
    let here = workshop.path();
    let said = fluorspar(here, ["dataset", "c.toml", "--out", "whole"]).well();
    assert!(said.stdout.starts_with("8 images of 4 people, "), "{}", said.stdout);
    let splits = judged(&here.join("whole"));
    assert_eq!(splits.keys().copied().collect::<Vec<u64>>(), [1, 2, 3, 4]);
    let whole = contents(&here.join("whole"));
    let sheet = String::from_utf8(whole[Path::new("DATASHEET.md")].clone()).unwrap();
    assert!(sheet.contains("\"spot\": ") && sheet.contains("64 x 48 pixels"), "{sheet}");

    // In two shards, one of them with one thread
    for part in [&["1/2", "--threads", "1"][..], &["2/2"]] {
        let words = ["dataset", "c.toml", "-q", "--out", "parts", "--shard"];
        fluorspar(here, words.iter().chain(part)).well();
    }
    assert!(!here.join("parts/DATASHEET.md").exists());
    let said = fluorspar(here, ["dataset", "c.toml", "--out", "parts"]).well();
    assert!(said.stderr.contains("4 of 4 views are finished"), "{}", said.stderr);
    assert!(contents(&here.join("parts")) == whole, "two shards differ from one run");

    // Killed after some views: these are not made again, but those whose files are gone
    let killed = here.join("killed");
    let before = kill_after_two_views(here, &killed, ["dataset", "c.toml", "-q", "--out", "killed/d"]);
    fs::remove_file(killed.join("d/images/000001_lips_white.png")).unwrap();
    let said = fluorspar(here, ["dataset", "c.toml", "--out", "killed/d"]).well();
    let told = format!("{} of 4 views are finished", before - 1);
    assert!(said.stderr.contains(&told), "{}", said.stderr);
    assert!(contents(&killed.join("d")) == whole, "a killed run differs from one that was not");

    // More people move nobody; spectra come to those that are there
    let words = ["dataset", "c.toml", "--set=people.count=1", "--spectra", "--out", "few"];
    fluorspar(here, words).well();
    let few = contents(&here.join("few"));
    assert!(few.contains_key(Path::new("spectra/000001_lips_blue.exr")), "{:?}", few.keys());
    let lines = |files: &BTreeMap<_, Vec<u8>>| {
        let table = String::from_utf8(files[Path::new("images.csv")].clone()).unwrap();
        table.lines().take(3).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(lines(&few), lines(&whole));
    // The file in the folder makes the data set again
    let said = fluorspar(here, ["dataset", "killed/d/dataset.toml", "--json", "--out", "killed/d"]).json();
    assert_eq!(said["holds"]["splits"].as_array().unwrap().len(), 3);
    assert!(contents(&killed.join("d")) == whole, "the file of the data set is another");
}

#[test]
fn folders_of_something_else_are_refused_before_the_work() {
    let workshop = workshop();
    let here = workshop.path();
    let refused = |words: &[&str], told: &str| {
        let said = fluorspar(here, ["dataset", "c.toml"].iter().chain(words));
        assert_eq!(said.code, Some(2), "{words:?}: {}", said.stderr);
        assert!(said.stderr.contains(told), "{words:?}: {}", said.stderr);
    };
    fs::create_dir(here.join("mine")).unwrap();
    fs::write(here.join("mine/notes.txt"), "mine").unwrap();
    fs::create_dir(here.join("other")).unwrap();
    fs::write(here.join("other/dataset.toml"), "# Data set 0123 of Fluorspar 0.0.1\n").unwrap();
    let before = listing(here);
    refused(&["--out", "mine"], "holds something else than a data set; choose another with --out");
    refused(&["--out", "other"], "holds the data set of another file or version");
    refused(&["--out", "c.toml"], "no folder");
    refused(&["--shard", "3/2"], "give I/N");
    refused(&["--set", "people.count=0"], "must be a whole number between 1 and 100000");
    assert_eq!(listing(here), before);
}
