//! Files of format 5, made byte by byte: every storage type in both byte orders, and hostile ones.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

use flate2::Compression;
use flate2::write::ZlibEncoder;

use super::{MatValue, v5};

/// Writes elements in one byte order.
#[derive(Clone, Copy)]
struct Maker {
    big: bool,
}

impl Maker {
    fn word(self, value: u32) -> [u8; 4] {
        if self.big { value.to_be_bytes() } else { value.to_le_bytes() }
    }

    fn words(self, values: &[u32]) -> Vec<u8> {
        values.iter().flat_map(|value| self.word(*value)).collect()
    }

    fn element(self, kind: u32, content: &[u8]) -> Vec<u8> {
        let mut bytes = self.words(&[kind, content.len() as u32]);
        bytes.extend(content);
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes
    }

    /// An element of up to four bytes in its tag.
    fn small(self, kind: u32, content: &[u8]) -> Vec<u8> {
        let mut bytes = self.word((content.len() as u32) << 16 | kind).to_vec();
        bytes.extend(content);
        bytes.resize(8, 0);
        bytes
    }

    fn array(self, flags: u32, dims: &[u32], name: &str, content: &[u8]) -> Vec<u8> {
        let name =
            if name.len() <= 4 { self.small(1, name.as_bytes()) } else { self.element(1, name.as_bytes()) };
        let parts = [
            self.element(6, &self.words(&[flags, 0])),
            self.element(5, &self.words(dims)),
            name,
            content.to_vec(),
        ];
        self.element(14, &parts.concat())
    }

    /// A struct of one field.
    fn holder(self, name: &str, field: &str, value: &[u8]) -> Vec<u8> {
        let mut field = field.as_bytes().to_vec();
        field.resize(8, 0);
        let content = [self.small(5, &self.word(8)), self.element(1, &field), value.to_vec()];
        self.array(2, &[1, 1], name, &content.concat())
    }

    fn compressed(self, variable: &[u8]) -> Vec<u8> {
        let mut packer = ZlibEncoder::new(Vec::new(), Compression::best());
        packer.write_all(variable).unwrap();
        let packed = packer.finish().unwrap();
        [self.words(&[15, packed.len() as u32]), packed].concat()
    }

    fn file(self, variables: &[Vec<u8>]) -> Vec<u8> {
        let mut bytes = b"MATLAB 5.0 MAT-file".to_vec();
        bytes.resize(124, b' ');
        bytes.extend(if self.big { *b"\x01\x00MI" } else { *b"\x00\x01IM" });
        bytes.extend(variables.concat());
        bytes
    }
}

const LITTLE: Maker = Maker { big: false };
const BOTH: [Maker; 2] = [LITTLE, Maker { big: true }];
const DOUBLE: u32 = 6;

fn read(bytes: &[u8]) -> Result<Vec<(String, MatValue)>, String> {
    v5::read(Path::new("f.mat"), bytes, super::MatLimits::SPECTRA).map_err(|error| error.to_string())
}

fn numbers(value: &MatValue) -> (&[usize], &[f64]) {
    match value {
        MatValue::Numbers { dims, values } => (dims, values),
        other => panic!("no numbers: {other:?}"),
    }
}

#[test]
fn numbers_of_every_storage_type_are_read_in_both_byte_orders() {
    for maker in BOTH {
        let bytes = |little: &[u8], width: usize| -> Vec<u8> {
            let chunks = little.chunks(width);
            if maker.big { chunks.flat_map(|c| c.iter().rev().copied()).collect() } else { little.to_vec() }
        };
        let signed = [-3_i8, 0, 100];
        let stored: [(u32, Vec<u8>); 10] = [
            (1, signed.map(i8::cast_unsigned).to_vec()),
            (2, vec![253, 0, 100]),
            (3, bytes(&signed.map(i16::from).map(i16::to_le_bytes).concat(), 2)),
            (4, bytes(&[65533_u16, 0, 100].map(u16::to_le_bytes).concat(), 2)),
            (5, bytes(&signed.map(i32::from).map(i32::to_le_bytes).concat(), 4)),
            (6, bytes(&[4_294_967_293_u32, 0, 100].map(u32::to_le_bytes).concat(), 4)),
            (7, bytes(&signed.map(f32::from).map(f32::to_le_bytes).concat(), 4)),
            (9, bytes(&signed.map(f64::from).map(f64::to_le_bytes).concat(), 8)),
            (12, bytes(&signed.map(i64::from).map(i64::to_le_bytes).concat(), 8)),
            (13, bytes(&[1_u64 << 40, 0, 100].map(u64::to_le_bytes).concat(), 8)),
        ];
        let first =
            [-3.0, 253.0, -3.0, 65533.0, -3.0, 4_294_967_293.0, -3.0, -3.0, -3.0, 1_099_511_627_776.0];
        for ((kind, content), first) in stored.iter().zip(first) {
            let packed =
                if content.len() <= 4 { maker.small(*kind, content) } else { maker.element(*kind, content) };
            let plain = maker.array(DOUBLE, &[1, 3], "a", &packed);
            for variable in [plain.clone(), maker.compressed(&plain)] {
                let fields = read(&maker.file(&[variable])).unwrap();
                assert_eq!(fields[0].0, "a");
                assert_eq!(
                    numbers(&fields[0].1),
                    (&[1, 3][..], &[first, 0.0, 100.0][..]),
                    "{kind}, {}",
                    maker.big
                );
            }
        }
    }
}

#[test]
fn texts_structs_and_what_is_only_named_are_told_apart() {
    for maker in BOTH {
        let wide: Vec<u8> = "µm"
            .encode_utf16()
            .flat_map(|unit| if maker.big { unit.to_be_bytes() } else { unit.to_le_bytes() })
            .collect();
        let one = maker.array(DOUBLE, &[1, 1], "", &maker.small(2, &[7]));
        let file = maker.file(&[
            maker.array(4, &[1, 2], "wide", &maker.small(4, &wide)),
            maker.array(4, &[2, 3], "lines", &maker.element(16, b"adbecf")),
            maker.holder("holder", "inner", &maker.holder("", "value", &one)),
            maker.array(9 | 0x200, &[1, 2], "logical", &maker.small(2, &[1, 0])),
            maker.array(DOUBLE, &[0, 0], "empty", &maker.element(9, &[])),
            maker.element(14, &[]),
            maker.array(1, &[1, 1], "cells", &one),
            maker.array(5, &[1, 1], "sparse", &[]),
            maker.array(DOUBLE | 0x800, &[1, 1], "complex", &maker.small(2, &[1])),
            maker.array(3, &[1, 1], "object", &[]),
            // An object of newer versions has no size.
            maker.element(14, &[maker.element(6, &maker.words(&[17, 0])), maker.small(1, b"s")].concat()),
        ]);
        let fields = read(&file).unwrap();
        let value = |name: &str| &fields.iter().find(|(field, _)| field == name).unwrap().1;
        assert!(matches!(value("wide"), MatValue::Text(text) if text == "µm"));
        assert!(matches!(value("lines"), MatValue::Text(text) if text == "abc\ndef"));
        let MatValue::Struct(outer) = value("holder") else { panic!("no struct") };
        let MatValue::Struct(inner) = &outer[0].1 else { panic!("no struct") };
        assert_eq!((outer[0].0.as_str(), inner[0].0.as_str()), ("inner", "value"));
        assert_eq!(numbers(&inner[0].1), (&[1, 1][..], &[7.0][..]));
        assert_eq!(numbers(value("logical")).1, [1.0, 0.0]);
        assert_eq!(numbers(value("empty")).0, [0, 0]);
        for (name, words) in [
            ("cells", "a list of cells"),
            ("sparse", "a sparse matrix"),
            ("complex", "an array of complex numbers"),
            ("object", "an object"),
            ("s", "an object"),
        ] {
            assert_eq!(value(name).in_words(), words);
        }
    }
}

#[test]
fn damage_is_named_with_its_variable() {
    let maker = LITTLE;
    let cases = [
        (
            maker.array(DOUBLE, &[1, 3], "a", &maker.small(2, &[1, 2])),
            "the variable at byte 128 is damaged: \"a\": 2 bytes hold 3 numbers of 1 bytes",
        ),
        (
            maker.array(DOUBLE, &[u32::MAX, 3], "a", &[]),
            "the variable at byte 128 is damaged: \"a\" has an impossible size",
        ),
        (
            maker.array(DOUBLE, &[0x7fff_ffff, 0x7fff_ffff, 0x7fff_ffff], "a", &[]),
            "the variable at byte 128 is damaged: \"a\" has an impossible size",
        ),
        (
            maker.array(DOUBLE, &[0x7fff_ffff, 1], "a", &maker.words(&[9, 0xffff_fff8])),
            "the variable at byte 128 is damaged: \"a\": the numbers are: 4294967288 bytes are claimed but 0 follow",
        ),
        (maker.element(14, &[0; 4]), "the variable at byte 128 is damaged: the flags are missing"),
        (maker.words(&[15, 0]), "the variable at byte 128 is damaged: "),
        (
            maker.compressed(&maker.words(&[15, 0])),
            "the variable at byte 128 is damaged: the array is: elements of type 15",
        ),
    ];
    for (variable, expected) in cases {
        let said = read(&maker.file(&[variable])).unwrap_err();
        assert!(said.starts_with(&format!("f.mat: {expected}")), "{said}");
        assert!(said.ends_with(". Copy the file again"), "{said}");
    }
}

/// Largest memory of this process so far, bytes; `None` where the system does not tell.
fn peak_bytes() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().trim_end_matches("kB").trim().parse::<u64>().ok()? << 10)
}

/// Reads a hostile file within bounds of time and memory.
fn bounded(bytes: &[u8]) -> Result<Vec<(String, MatValue)>, String> {
    let begun = Instant::now();
    let result = read(bytes);
    assert!(begun.elapsed() < Duration::from_secs(60), "{:?}", begun.elapsed());
    assert!(peak_bytes().is_none_or(|peak| peak < 1 << 30), "{:?}", peak_bytes());
    result
}

#[test]
fn nesting_ends_at_a_fixed_depth() {
    for maker in BOTH {
        let mut cells = maker.array(DOUBLE, &[1, 1], "", &maker.small(2, &[7]));
        let mut structs = cells.clone();
        for _ in 0..8000 {
            cells = maker.array(1, &[1, 1], "", &cells);
            structs = maker.holder("", "s", &structs);
        }
        let fields = bounded(&maker.file(&[cells.clone(), maker.compressed(&cells)])).unwrap();
        assert!(fields.iter().all(|(_, value)| value.in_words() == "a list of cells"));
        for variable in [structs.clone(), maker.compressed(&structs)] {
            let said = bounded(&maker.file(&[variable])).unwrap_err();
            assert!(said.contains("structs lie in structs more than 32 deep"), "{said}");
        }
        let mut allowed = maker.array(DOUBLE, &[1, 1], "", &maker.small(2, &[7]));
        for _ in 0..32 {
            allowed = maker.holder("", "s", &allowed);
        }
        assert!(read(&maker.file(&[allowed])).is_ok());
    }
}

/// Millions of lines of no letters were as many texts.
#[test]
fn lines_without_letters_are_no_text() {
    for maker in BOTH {
        let file = maker.file(&[maker.array(4, &[14_024_960, 0], "empty", &maker.element(16, b""))]);
        let read = read(&file).unwrap();
        assert!(matches!(&read[0].1, MatValue::Text(text) if text.is_empty()));
    }
}

#[test]
fn compressed_variables_end_at_a_fixed_size() {
    // 256 MiB of zeros in 256 kB; the size within says more still.
    let zeros = [LITTLE.words(&[14, 0xffff_fff0]), vec![0; 256 << 20]].concat();
    let bomb = LITTLE.compressed(&zeros);
    drop(zeros);
    assert!(bomb.len() < 1 << 20);
    let said = bounded(&LITTLE.file(&[bomb])).unwrap_err();
    assert!(
        said.starts_with("f.mat: the variables are too large when decompressed; the limit is 67108864 bytes"),
        "{said}"
    );
    // Each small enough, all together not.
    let array = LITTLE.array(DOUBLE, &[1 << 23, 1], "a", &LITTLE.element(2, &vec![0; 1 << 23]));
    let part = LITTLE.compressed(&array);
    let said = bounded(&LITTLE.file(&vec![part; 20])).unwrap_err();
    assert!(said.contains("the variables hold too many numbers; the limit is 16777216 values"), "{said}");
    let empty = LITTLE.compressed(&LITTLE.element(14, &[]));
    let said = bounded(&LITTLE.file(&vec![empty; 100_001])).unwrap_err();
    assert!(said.contains("the file holds too many variables and fields"), "{said}");
}

#[test]
fn no_changed_byte_ends_in_a_panic() {
    let maker = LITTLE;
    let array = maker.array(
        DOUBLE,
        &[2, 2],
        "matrix",
        &maker.element(9, &[1.0_f64; 4].map(f64::to_le_bytes).concat()),
    );
    let file = maker.file(&[
        maker.holder("holder", "inner", &array),
        maker.array(4, &[1, 4], "text", &maker.element(16, b"text")),
        maker.compressed(&array),
    ]);
    assert!(read(&file).is_ok());
    for at in 124..file.len() {
        for value in [0, 1, 2, 4, 5, 14, 15, 0x7f, 0x80, 0xff] {
            let mut changed = file.clone();
            changed[at] = value;
            let _ = read(&changed);
        }
        let _ = read(&file[..at]);
    }
}
