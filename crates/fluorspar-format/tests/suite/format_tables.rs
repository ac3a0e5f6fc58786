//! Spectra, fluorophores and excitation-emission matrices as tables.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "these are tests")]

use std::fs;
use std::path::{Path, PathBuf};

use fluorspar::spectral::YieldUnit;
use fluorspar_format::{
    AntiStokes, CsvEemOptions, CutTo, EmptyCells, Negative, ScatterCut, SpectrumColumns, SpectrumOptions,
    read_eem_csv, read_fluorophore_csv, read_spectra,
};

/// What a reader says about a file with this content, its folder left out.
fn complaint<T: std::fmt::Debug>(
    content: &[u8],
    read: impl Fn(&Path) -> Result<T, fluorspar_format::FormatError>,
) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.csv");
    fs::write(&path, content).unwrap();
    let error = read(&path).expect_err("a bad file was read");
    assert_eq!(error.path(), path);
    error.to_string().replace(&format!("{}/", folder.path().display()), "")
}

fn loaded<T>(content: &str, read: impl Fn(&Path) -> Result<T, fluorspar_format::FormatError>) -> T {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.csv");
    fs::write(&path, content).unwrap();
    read(&path).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn spectra_are_read_by_name_or_the_first_is_told() {
    let text = "\u{feff}# a comment\nWavelength [nm], red ,green\n400,0.1,1\n\n# another\n410,0.2,2\n";
    let all = loaded(text, |path| read_spectra(path, &SpectrumOptions::default())).curves;
    assert_eq!(all.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["red", "green"]);
    assert_eq!(all[0].curve.wavelengths_nm(), [400.0, 410.0]);
    assert_eq!(all[1].curve.values(), [1.0, 2.0]);
    let one = |columns: SpectrumColumns| {
        let options = SpectrumOptions { columns, ..Default::default() };
        loaded(text, |path| read_spectra(path, &options))
    };
    assert_eq!(one(SpectrumColumns::Named(vec!["green".into()])).curves, all[1..]);
    let first = one(SpectrumColumns::One);
    assert_eq!(first.curves, all[..1]);
    assert_eq!(first.read_as, ["column \"red\" of red, green"]);
}

#[test]
fn every_way_to_say_nanometers_is_understood() {
    for header in
        ["wavelength_nm", "wavelength [nm]", "wavelength (nm)", "wave_nm", "nm", "Lambda/nm", "Nanometers"]
    {
        let text = format!("{header}\tvalue\n400\t1\n500\t2e-3\n");
        let curves = loaded(&text, |path| read_spectra(path, &SpectrumOptions::default())).curves;
        assert_eq!(curves[0].curve.values(), [1.0, 0.002], "{header}");
    }
}

#[test]
fn empty_cells_and_negative_values_follow_the_options() {
    let text = "nm,a,b\n400,,-1\n410,2,2\n420,3,4\n";
    let options =
        SpectrumOptions { skip_empty_cells: true, negative: Negative::ClipToZero, ..Default::default() };
    let curves = loaded(text, |path| read_spectra(path, &options)).curves;
    assert_eq!(curves[0].curve.wavelengths_nm(), [410.0, 420.0]);
    assert_eq!(curves[1].curve.values(), [0.0, 2.0, 4.0]);
    let options = SpectrumOptions { negative: Negative::Keep, ..options };
    assert_eq!(loaded(text, |path| read_spectra(path, &options)).curves[1].curve.values(), [-1.0, 2.0, 4.0]);
}

#[test]
fn bad_spectra_are_explained() {
    let cases: &[(&[u8], &str)] = &[
        (b"", "t.csv: the file is empty. Copy the file again"),
        (b"# only this\n", "t.csv: the file holds no table. Give a header line and lines of numbers"),
        (b"nm,a\n", "t.csv:1: the file ends after the header line. Give at least two lines of numbers"),
        (
            b"nm,a\n400,1\n",
            "t.csv: column \"a\" is not a valid spectrum: a spectrum needs at least two samples; got 1. Check the column",
        ),
        (
            b"nm,a\n0.4,1\n0.5,2\n",
            "t.csv:2: the wavelengths run from 0.4 to 0.5, not between 100 and 20000 nm. They look like micrometers: multiply by 1000",
        ),
        (
            b"nm,a\n4e-7,1\n5e-7,2\n",
            "t.csv:2: the wavelengths run from 0.0000004 to 0.0000005, not between 100 and 20000 nm. They look like meters: multiply by 1e9",
        ),
        (
            b"sample,a\n400,1\n500,2\n",
            "t.csv:1: the first column is \"sample\", not a wavelength. Put the wavelength first and call it \"wavelength_nm\"",
        ),
        (
            b"em_nm\\ex_nm,400\n500,2\n",
            "t.csv:1: the first cell is \"em_nm\\ex_nm\": this is an excitation-emission matrix. Read it as a matrix, or give a first column \"wavelength_nm\"",
        ),
        (
            b"nm,a\n400,1\n# c\n400,2\n",
            "t.csv:4: the wavelength 400 nm appears twice. Keep one value per wavelength",
        ),
        (
            b"nm,a\n400,1\n410,-2\n",
            "t.csv:3: column \"a\" holds -2, below zero. Subtract the background correctly, or set the value to 0",
        ),
        (
            b"nm,a\n400,1\n410,NaN\n",
            "t.csv:3: column \"a\" holds NaN. Give a finite number, or remove the line",
        ),
        (
            b"nm,a\n400,1\n410,\n",
            "t.csv:3: column \"a\" has no value at 410 nm. Fill the cell, or remove the lines without a value: a straight line bridges the gap",
        ),
        (b"nm,a\n400,1\n,2\n", "t.csv:3: the wavelength is empty. Give every line a wavelength in nm"),
        (
            b"nm,a\n400,1\n410,high\n",
            "t.csv:3: column \"a\" holds \"high\", which is not a number. Write numbers like 385 or 1.5e-3",
        ),
        (
            b"nm,a\n400,1\n410,2,3\n",
            "t.csv:3: this line has 3 cells but the header has 2. Give every line one cell per column",
        ),
        (
            b"nm\n400\n410\n",
            "t.csv:1: there is only a wavelength column. Give at least one column of values; cells are separated by commas",
        ),
        (
            b"PK\x03\x04...",
            "t.csv: this is a ZIP archive or a spreadsheet, not text. Export the spectra as text (CSV) from the program that wrote it",
        ),
    ];
    for (content, expected) in cases {
        let said = complaint(content, |path| read_spectra(path, &SpectrumOptions::default()));
        assert_eq!(said, *expected, "for {:?}", String::from_utf8_lossy(content));
    }
    let named = |name: &str| SpectrumOptions {
        columns: SpectrumColumns::Named(vec![name.into()]),
        ..Default::default()
    };
    let text = b"nm,a,b,b\n400,1,2,3\n410,1,2,3\n";
    assert_eq!(
        complaint(text, |path| read_spectra(path, &named("c"))),
        "t.csv:1: there is no column \"c\". Columns are: a, b, b"
    );
    assert_eq!(
        complaint(text, |path| read_spectra(path, &named("b"))),
        "t.csv:1: two columns are called \"b\". Give each column its own name"
    );
}

#[test]
fn a_missing_file_is_named() {
    let error = read_spectra(Path::new("/nowhere/x.csv"), &SpectrumOptions::default()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "/nowhere/x.csv: can't read it: No such file or directory (os error 2). Check the path and its folder"
    );
}

#[test]
fn fluorophores_know_when_they_have_no_excitation() {
    let read = |path: &Path| read_fluorophore_csv(path, Negative::Refuse, None);
    let full = loaded("wavelength_nm,excitation,emission\n400,1,\n410,0.5,0\n420,,1\n", read);
    assert_eq!((full.excitation.values(), full.emission.values()), (&[1.0, 0.5][..], &[0.0, 1.0][..]));
    assert!(!full.emission_only);
    assert!(loaded("wavelength_nm,emission,excitation\n400,0,1\n410,1,1\n", read).emission_only);
    // Each with wavelengths of its own, which are no spectra
    let two = "Excitation Wavelength (nm),Excitation,Emission Wavelength (nm),Emission\n450,1,500,0.2\n480,5,520,1\n";
    let two = loaded(two, read);
    assert_eq!((two.excitation.peak_nm(), two.emission.peak_nm()), (480.0, 520.0));
}

#[test]
fn matrices_keep_rows_as_emission() {
    let text = "# unit: photons\nem_nm\\ex_nm,350,400\n380,1,0\n450,2,3\n";
    let eem = loaded(text, |path| read_eem_csv(path, &CsvEemOptions::default()));
    assert_eq!((eem.emission_nm, eem.excitation_nm), (vec![380.0, 450.0], vec![350.0, 400.0]));
    assert_eq!((eem.values, eem.unit), (vec![1.0, 0.0, 2.0, 3.0], Some(YieldUnit::Photons)));
}

#[test]
fn anti_stokes_cells_follow_the_options() {
    let text = "em_nm\\ex_nm,350,400\n380,1,0.5\n450,-2,3\n470,,3\n";
    let read = |anti_stokes, negative| {
        let options = CsvEemOptions {
            unit: Some(YieldUnit::Energy),
            anti_stokes,
            negative,
            empty_cells: EmptyCells::Zero,
            cut: None,
            sample: None,
        };
        loaded(text, |path| read_eem_csv(path, &options)).values
    };
    assert_eq!(read(AntiStokes::Keep, Negative::Keep), [1.0, 0.5, -2.0, 3.0, 0.0, 3.0]);
    assert_eq!(read(AntiStokes::SetToZero, Negative::ClipToZero), [1.0, 0.0, 0.0, 3.0, 0.0, 3.0]);
    assert_eq!(read(AntiStokes::Refuse(0.2), Negative::ClipToZero), [1.0, 0.5, 0.0, 3.0, 0.0, 3.0]);
}

/// Empty cells between values under one excitation lie on the line between them; what lies below its excitation or beyond the values is zero.
#[test]
fn empty_cells_are_interpolated_between_values_alone() {
    let text =
        "# unit: photons\nem_nm\\ex_nm,350,450\n400,,\n420,8,\n440,,\n460,,6\n500,4,\n560,1,3\n600,,\n";
    let options = |empty_cells| CsvEemOptions { empty_cells, ..CsvEemOptions::default() };
    let read = |choice| loaded(text, |path| read_eem_csv(path, &options(choice)));
    let found = read(EmptyCells::Interpolate);
    assert_eq!(found.empty_cells.len(), 9);
    let expected = [0.0, 0.0, 8.0, 0.0, 7.0, 0.0, 6.0, 6.0, 4.0, 4.8, 1.0, 3.0, 0.0, 0.0];
    for (value, expected) in found.values.iter().zip(expected) {
        assert!((value - expected).abs() < 1e-12, "{:?}", found.values);
    }
    let zeros = read(EmptyCells::Zero).values;
    assert_eq!(zeros.iter().filter(|value| **value == 0.0).count(), 9);
}

/// A negative value within a band that is cut out is no value: it is neither refused nor counted.
#[test]
fn negative_values_that_are_cut_out_do_not_count() {
    let text = "# unit: photons\nem_nm\\ex_nm,350,450\n350,-4,0\n420,8,0\n450,7,-9\n560,1,3\n700,-2,1\n";
    let read = |within_nm: Option<f64>, negative| {
        let cut = within_nm.map(|within_nm| ScatterCut { within_nm, to: CutTo::Zero });
        let options = CsvEemOptions { cut, negative, ..CsvEemOptions::default() };
        loaded(text, |path| read_eem_csv(path, &options).map(|eem| eem.clipped))
    };
    assert_eq!(read(Some(5.0), Negative::Refuse), (0, 0.0));
    assert_eq!(read(Some(5.0), Negative::ClipToZero), (0, 0.0));
    assert_eq!(read(None, Negative::ClipToZero), (3, -9.0));
}

/// A dye whose emission keeps its place, with light of the lamp on a line that follows the excitation.
#[test]
fn scattered_light_of_the_lamp_is_refused_and_small_stokes_shifts_are_not() {
    let bell = |nm: f64, peak: f64, sigma: f64| (-0.5 * ((nm - peak) / sigma).powi(2)).exp();
    let table = |step: usize, [excited, emitted]: [f64; 2], scatter: &dyn Fn(f64, f64) -> f64| {
        let excitation: Vec<f64> = (340..=480).step_by(step).map(|nm| nm as f64).collect();
        let mut text = String::from("# unit: photons\nem_nm\\ex_nm");
        excitation.iter().for_each(|x| text += &format!(",{x}"));
        for m in (360..=800).step_by(step).map(|nm| nm as f64) {
            text += &format!("\n{m}");
            for &x in &excitation {
                let dye = if m > x { bell(x, excited, 30.0) * bell(m, emitted, 30.0) } else { 0.0 };
                text += &format!(",{:.6}", dye + if m < x { 0.0 } else { scatter(m, x) });
            }
        }
        text
    };
    let strict = |path: &Path| read_eem_csv(path, &CsvEemOptions::default());
    let kept = CsvEemOptions { anti_stokes: AntiStokes::Keep, ..CsvEemOptions::default() };
    for step in [5, 10, 20] {
        let first = |m: f64, x: f64| 0.4 * bell(m, x, 4.0);
        let text = complaint(table(step, [400.0, 520.0], &first).as_bytes(), strict);
        assert!(text.contains("lies along emission = excitation for excitations from 3"), "{step}: {text}");
        loaded(&table(step, [400.0, 520.0], &first), |path| read_eem_csv(path, &kept));
        let second = |m: f64, x: f64| 0.3 * bell(m, 2.0 * x, 4.0);
        let text = complaint(table(step, [400.0, 520.0], &second).as_bytes(), strict);
        assert!(
            text.contains("second-order scatter lies along emission = 2 x excitation for excitations from 3"),
            "{step}: {text}"
        );
        // The dye alone, with shifts of 120, 40, 15 and 0 nm
        for peaks in [[400.0, 520.0], [400.0, 440.0], [430.0, 445.0], [430.0, 430.0]] {
            loaded(&table(step, peaks, &|_, _| 0.0), strict);
        }
    }
}

/// Of a matrix that is linear along the emission, what was scattered over the bands of both orders comes back exactly from their neighbors, also
/// where the bands end at an end of a column, and as the file that is written.
#[test]
fn scattered_light_is_cut_out_along_the_emission() {
    let [emission, excitation] = [[400, 420, 440, 460, 780, 800, 820, 840], [400, 410, 420, 0, 0, 0, 0, 0]];
    let linear = |em: i32, ex: i32| f64::from(em - 380 + ex);
    let near = |em: i32, ex: i32| (em - ex).abs() <= 15 || (em - 2 * ex).abs() <= 15;
    let mut text = String::from("# unit: energy\nem_nm\\ex_nm,400,410,420");
    for em in emission {
        text += &format!("\n{em}");
        for ex in &excitation[..3] {
            text += &format!(",{}", if near(em, *ex) { 1e4 } else { linear(em, *ex) });
        }
    }
    let cut = |to| CsvEemOptions {
        anti_stokes: AntiStokes::Keep,
        cut: Some(ScatterCut { within_nm: 15.0, to }),
        ..CsvEemOptions::default()
    };
    let found = loaded(&text, |path| read_eem_csv(path, &cut(CutTo::Neighbors)));
    let cells = |near: &dyn Fn(i32, i32) -> bool| {
        let of = |em: &i32| excitation[..3].iter().filter(|ex| near(*em, **ex)).count();
        emission.iter().map(of).sum::<usize>()
    };
    let [first, second] =
        [cells(&|em, ex| (em - ex).abs() <= 15), cells(&|em, ex| (em - 2 * ex).abs() <= 15)];
    assert_eq!(found.cut_cells, [first, second, 0, 0]);
    for (row, em) in emission.into_iter().enumerate() {
        for (column, ex) in excitation[..3].iter().enumerate() {
            // At the ends of a column there is one neighbor alone
            let begins = emission[..=row].iter().all(|em| near(*em, *ex));
            let ends = emission[row..].iter().all(|em| near(*em, *ex));
            let kept = |em: &i32| !near(*em, *ex);
            let expected = match (begins, ends) {
                _ if kept(&em) => linear(em, *ex),
                // Below the excitation there is no fluorescence
                _ if em < *ex => 0.0,
                (true, _) => linear(emission.into_iter().find(kept).unwrap(), *ex),
                (_, true) => linear(emission.into_iter().rfind(kept).unwrap(), *ex),
                _ => linear(em, *ex),
            };
            let value = found.values[3 * row + column];
            assert!((value - expected).abs() <= 1e-9 * expected, "{em} {ex}: {value} {expected}");
        }
    }
    let zero = loaded(&text, |path| read_eem_csv(path, &cut(CutTo::Zero)));
    assert_eq!(zero.values.iter().filter(|value| **value == 0.0).count(), first + second);
    let again = loaded(&found.to_csv(&["cut".into()]), |path| {
        read_eem_csv(path, &CsvEemOptions { anti_stokes: AntiStokes::Keep, ..CsvEemOptions::default() })
    });
    assert_eq!((again.values, again.unit), (found.values, Some(YieldUnit::Energy)));
}

/// The same matrix as programs of fluorometers export it: every form is read to the same numbers, and says what it has otherwise.
#[test]
fn matrices_are_read_as_instruments_export_them() {
    let excitation = [350.0, 360.0, 370.0];
    let emission = [345.0, 365.0, 400.0, 450.0];
    let value = |row: usize, column: usize| match emission[row] < excitation[column] {
        true => 0.0,
        false => 1.5 + 2.0 * row as f64 + column as f64,
    };
    // Rows of cells, each with what precedes it
    let rows =
        |mark: &str, first: &dyn Fn(f64) -> String, columns: &[usize], cell: &dyn Fn(f64) -> String| {
            let row = |row: usize| {
                let cells = columns.iter().map(|column| format!("{mark}{}", cell(value(row, *column))));
                format!("{}{}\n", first(emission[row]), cells.collect::<String>())
            };
            (0..emission.len()).map(row).collect::<String>()
        };
    let plain = |value: f64| format!("{value}");
    let comma = |value: f64| format!("{value:.1}").replace('.', ",");
    let all = [0, 1, 2];
    let aqualog = format!(
        "Sample - Blank\t370\t360\t350\nnm\t\t\t\nNormalized by 75.3\t\t\t\n{}",
        rows("\t", &plain, &[2, 1, 0], &plain)
    );
    let fluoromax = format!("F1\t350\t360\t370\n{}", rows("\t", &plain, &all, &plain));
    let hitachi = format!(
        "Sample:\t'1'\r\nModel:\tF-7000 FL Spectrophotometer\r\nEX  Start WL:\t350.0 nm\r\n\r\nData Points\r\n\t350.000\t360.000\t370.000\r\n{}",
        rows("\t", &|nm| format!("{nm:.1}"), &all, &|value| format!("{value:5.1}"))
    );
    let pair = |row: usize| {
        (0..3).map(|c| format!("{},{},", emission[row], value(row, c))).collect::<String>() + "\n"
    };
    let cary = format!(
        "dye_EX_350.00,,dye_EX_360.00,,dye_EX_370.00,,\n{}\n{}\r\ndye_EX_350.00,\r\nInstrument   Cary Eclipse\r\n",
        "Wavelength (nm),Intensity (a.u.),".repeat(3),
        (0..4).map(pair).collect::<String>()
    );
    let edinburgh = format!(
        "Labels,dye 1,dye 2,dye 3,\nType,Emission Scan,Emission Scan,Emission Scan,\nStart,345.00,345.00,345.00,\nFixed/Offset,350.00,360.00,370.00,\n\
         XAxis,Wavelength(nm),Wavelength(nm),Wavelength(nm),\n\n{}",
        rows(",", &|nm| format!("{nm:.2}"), &all, &|value| format!("{value:.5E}")).replace('\n', ",\n")
    );
    let semicolons = format!(
        "Probe;Farbstoff\n\"Em (nm)\";\"ex 350,0 nm\";\"ex 360,0 nm\";\"ex 370,0 nm\"\n{}",
        rows(";", &comma, &all, &comma)
    );
    let no_corner = format!("350\t360\t370\n{}", rows("\t", &plain, &all, &plain));
    let axes = "rows taken as emission";
    for (name, text, words) in [
        ("Aqualog", aqualog, &["2 lines beside", "from long to short", axes][..]),
        ("FluoroMax", fluoromax, &[axes]),
        ("F-7000", hitachi, &["4 lines beside", axes]),
        ("Cary Eclipse", cary, &["3 lines beside", "a pair of columns"]),
        ("Fluoracle", edinburgh, &["4 lines beside", axes]),
        ("semicolons", semicolons, &["a line beside", "decimal commas"]),
        ("no corner", no_corner, &[axes]),
    ] {
        let read = loaded(&format!("# unit: energy\n{text}"), |path| {
            read_eem_csv(path, &CsvEemOptions { empty_cells: EmptyCells::Zero, ..CsvEemOptions::default() })
        });
        assert_eq!(
            (&read.excitation_nm[..], &read.emission_nm[..]),
            (&excitation[..], &emission[..]),
            "{name}"
        );
        let expected: Vec<f64> = (0..12).map(|place| value(place / 3, place % 3)).collect();
        assert_eq!((read.values, read.unit), (expected, Some(YieldUnit::Energy)), "{name}");
        let said = read.read_as.join("; ");
        assert!(words.iter().all(|words| said.contains(words)), "{name}: {said}");
        assert_eq!(read.read_as.len(), words.len(), "{name}: {said}");
    }
}

/// Names of samples may hold commas, or be missing.
#[test]
fn samples_of_a_matrix_are_told_apart_by_their_names() {
    let text = |names: [&str; 2]| {
        let header: String =
            names.iter().flat_map(|name| [350, 360].map(|nm| format!("{name}_EX_{nm}.00,,"))).collect();
        format!("{header}\n{}\n400,1,400,2,400,3,400,4,\n410,1,410,2,410,3,410,4,\n", "nm,a.u.,".repeat(4))
    };
    let options = |sample: Option<&str>| CsvEemOptions {
        unit: Some(YieldUnit::Photons),
        sample: sample.map(String::from),
        ..CsvEemOptions::default()
    };
    let said = complaint(text(["dye, 1", "dye, 2"]).as_bytes(), |path| read_eem_csv(path, &options(None)));
    assert!(said.starts_with("t.csv:1: the columns are of 2 samples: dye, 1, dye, 2"), "{said}");
    for (names, sample) in [(["dye, 1", "dye, 2"], "dye, 2"), (["dye", ""], "unnamed")] {
        let read = loaded(&text(names), |path| read_eem_csv(path, &options(Some(sample))));
        assert_eq!(
            (read.excitation_nm, read.values),
            (vec![350.0, 360.0], vec![3.0, 4.0, 3.0, 4.0]),
            "{names:?}"
        );
    }
}

/// What an instrument writes where its detector was at its end is no value against which others are small.
#[test]
fn marks_of_overflow_and_blanks_are_no_dye() {
    let bell = |nm: f64, width: f64| (-(nm / width).powi(2)).exp();
    let matrix = |value: &dyn Fn(f64, f64) -> f64| {
        let excitation: Vec<f64> = (300..=400).step_by(10).map(f64::from).collect();
        let header: String = excitation.iter().map(|ex| format!(",{ex}")).collect();
        let row = |em: f64| {
            let cells: String = excitation.iter().map(|ex| format!(",{:.4}", value(*ex, em))).collect();
            format!("{em}{cells}\n")
        };
        let rows: String = (280..=560).step_by(5).map(|em| row(f64::from(em))).collect();
        format!("# unit: photons\nem_nm\\ex_nm{header}\n{rows}")
    };
    let dye = matrix(&|ex, em| {
        let value = if em > ex { 1000.0 * bell(ex - 350.0, 40.0) * bell(em - 480.0, 40.0) } else { 0.0 };
        if value > 990.0 { 9.9e37 } else { value }
    });
    let read = |path: &std::path::Path| read_eem_csv(path, &CsvEemOptions::default());
    let said = complaint(dye.as_bytes(), read);
    assert!(
        said.starts_with("t.csv: 1 cell has the largest value 9.9e37, at excitations from 350"),
        "{said}"
    );
    let keep = CsvEemOptions { anti_stokes: AntiStokes::Keep, ..CsvEemOptions::default() };
    assert_eq!(loaded(&dye, |path| read_eem_csv(path, &keep)).overflow().unwrap().cells, 1);
    // Of water, upon a dark that is the same everywhere, no band leaves a dye
    let water = matrix(&|ex, em| {
        900.0 * bell(em - ex, 5.0) + 300.0 * bell(em - 1.0 / (1.0 / ex - 3400e-7), 6.0) + 0.5
    });
    let least = loaded(&water, |path| read_eem_csv(path, &keep)).least_cuts(CutTo::Neighbors, 1e-3);
    assert!(least.for_all.is_none() && least.for_lines.is_none(), "{least:?}");
}

/// What would have to be guessed is refused, with what else is wrong.
#[test]
fn forms_of_instruments_that_leave_a_guess_are_refused() {
    let told = |text: &str| complaint(text.as_bytes(), |path| read_eem_csv(path, &CsvEemOptions::default()));
    let unit = "t.csv: the file does not say whether its values count photons or energy";
    for (text, words) in [
        (
            "\t350\t360\n400\t1,234\t2,345\n410\t1,111\t1,222\n",
            "line 2: \"1,234\" may have a decimal comma or one between thousands",
        ),
        ("\t350\t360\n400\t1,5\t2.5\n410\t1\t1\n", "line 2: \"1,5\" may have a decimal comma"),
        (
            "a_EX_350,,a_EX_360,,\n400,1,400,2,\n410,1,411,2,\n",
            "line 3: the scan at excitation 360 nm has the emission wavelength \"411\"",
        ),
        (
            "Sample\nA,B,C\n400,1,2\n410,1,2\n",
            "line 3: no line above these rows names the excitation wavelengths of their 2 columns",
        ),
        (";350;360\n400;1;2\n410;1;2\nhere\n420;1;2\n", "line 4: \"here\" stands between rows of the table"),
        (
            "PE FL  SUBTECH SPECTRUM\n#DATA\n400.0\t1\n401.0\t2\n402.0\t3\n403.0\t4\n404.0\t4\n",
            "line 3: from here on there are two columns of numbers: one spectrum, not a matrix",
        ),
        ("ex\\em,400,410\n350,1,2\n360,1,2\n", "line 1: the columns are emission and the rows excitation"),
        (
            "\tem 400\tem 410\n350\t1\t2\n360\t1\t2\n",
            "line 1: the columns are emission and the rows excitation",
        ),
    ] {
        let said = told(text);
        assert!(said.starts_with(unit) && said.contains(words), "{words}: {said}");
    }
    // A cell that holds no number is told where it stands
    let said = told("# unit: photons\nMade by: x\nnm;350;360\n400;1;2\n410;x;2\n");
    assert!(said.starts_with("t.csv:5: column \"350\" holds \"x\""), "{said}");
}

/// The narrowest band that leaves nothing to refuse: one nanometer less leaves a cell, and noise far below the excitation leaves none that does.
#[test]
fn the_narrowest_band_that_is_enough_is_found() {
    let bell = |nm: i32, width: f64| (-(f64::from(nm) / width).powi(2)).exp();
    let matrix = |noise: f64| {
        let mut text = String::from("# unit: energy\nem_nm\\ex_nm");
        let excitation: Vec<i32> = (300..=400).step_by(10).collect();
        text.extend(excitation.iter().map(|ex| format!(",{ex}")));
        for em in (260..=560).step_by(5) {
            text += &format!("\n{em}");
            for ex in &excitation {
                let noise = if em == 260 && *ex == 400 { noise } else { 0.0 };
                let dye = 1000.0 * bell(ex - 350, 60.0) * bell(em - 480, 40.0);
                text += &format!(
                    ",{:.4}",
                    dye + 6000.0 * bell(em - ex, 6.0) + 30.0 * bell(em - ex, 12.0) + noise
                );
            }
        }
        text
    };
    let keep = CsvEemOptions { anti_stokes: AntiStokes::Keep, ..CsvEemOptions::default() };
    let cut = |nm: u32| CsvEemOptions {
        cut: Some(ScatterCut { within_nm: f64::from(nm), to: CutTo::Neighbors }),
        ..CsvEemOptions::default()
    };
    let text = matrix(0.0);
    let found = loaded(&text, |path| read_eem_csv(path, &keep)).least_cuts(CutTo::Neighbors, 1e-3);
    let least = found.for_all.unwrap();
    // Of the wide bell 30 exp(-(d/12)²) is below a thousandth of the dye's peak of 1000 from 22.1 nm on: the cells at 20 nm must go
    assert_eq!(least, 20);
    loaded(&text, |path| read_eem_csv(path, &cut(least)));
    complaint(text.as_bytes(), |path| read_eem_csv(path, &cut(least - 1)));
    // A cell 140 nm below its excitation is in no band, and the line itself is gone with a narrower one
    let noisy = loaded(&matrix(50.0), |path| read_eem_csv(path, &keep)).least_cuts(CutTo::Neighbors, 1e-3);
    assert!(noisy.for_all.is_none() && noisy.for_tails.is_some_and(|nm| nm <= least), "{noisy:?}");
}

#[test]
fn bad_matrices_are_explained() {
    let photons = "# unit: photons\n";
    let cases: &[(&str, &str)] = &[
        (
            "em_nm\\ex_nm,350,400\n380,1,0\n450,2,3\n",
            "t.csv: the file does not say whether its values count photons or energy (the two differ by the ratio of emission to excitation wavelength). Add a line \"# unit: photons\" or \"# unit: energy\", or give the unit when reading",
        ),
        (
            "# unit: counts\nem_nm\\ex_nm,350\n380,1\n450,2\n",
            "t.csv:1: the unit \"counts\" is not known. Write \"# unit: photons\" or \"# unit: energy\"",
        ),
        (
            "@,350,400\n380,1,4\n450,2,3\n",
            "t.csv:2: the corner cell is missing. Write \"em_nm\\ex_nm\" there: rows are emission, columns excitation, both in nm",
        ),
        // All that is wrong with the form at once
        (
            "ex_nm,400,350,375\n380,1,0,3\n",
            "t.csv: the file does not say whether its values count photons or energy (the two differ by the ratio of emission to excitation wavelength). Add a line \"# unit: photons\" or \"# unit: energy\", or give the unit when reading. Also line 1: the corner cell is \"ex_nm\". Write \"em_nm\\ex_nm\" if rows are emission and columns excitation, both in nm; line 1: the excitation wavelength 350 nm follows 400 nm. Sort by wavelength, shortest first",
        ),
        (
            "@ex_nm\\em_nm,380,450\n350,1,2\n400,0,3\n",
            "t.csv:2: the columns are emission and the rows excitation. Transpose the table, or export it, so that rows are emission and columns excitation",
        ),
        (
            "@nm,350,400\n380,1,0\n",
            "t.csv:2: the corner cell is \"nm\". Write \"em_nm\\ex_nm\" if rows are emission and columns excitation, both in nm",
        ),
        (
            "@em_nm\\ex_nm,380,450\n350,1,2\n400,0,3\n",
            "t.csv: 100 % of the signal lies at emission wavelengths shorter than the excitation. Transpose the table: rows must be emission and columns excitation",
        ),
        (
            "@em_nm\\ex_nm,350,400\n380,1,0.03\n450,2,3\n",
            "t.csv:3: emission at 380 nm is below its excitation at 400 nm but holds 0.03 (1.00 % of the peak). Remove scattered light, also that at and just above the excitation, set such cells to 0 or allow anti-Stokes values",
        ),
        (
            "@em_nm\\ex_nm,350,400,380\n450,1,0,2\n460,2,3,1\n",
            "t.csv:2: the excitation wavelength 380 nm follows 400 nm. Sort by wavelength, shortest first",
        ),
        (
            "@em_nm\\ex_nm,350,400\n450,1,0\n380,2,3\n",
            "t.csv:4: the emission wavelength 380 nm follows 450 nm. Sort by wavelength, shortest first",
        ),
        (
            "@em_nm\\ex_nm,350,400\n380,1,0\n380,2,3\n",
            "t.csv:4: the emission wavelength 380 nm appears twice. Keep one value per wavelength",
        ),
        (
            "@em_nm\\ex_nm,0.35,0.4\n0.38,1,0\n0.45,2,3\n",
            "t.csv:2: the excitation wavelengths run from 0.35 to 0.4, not between 100 and 20000 nm. They look like micrometers: multiply by 1000. Also line 3: the emission wavelengths run from 0.38 to 0.45, not between 100 and 20000 nm. They look like micrometers: multiply by 1000",
        ),
        (
            "@em_nm\\ex_nm,350,400\n380,1,0\n450,-2,3\n",
            "t.csv:4: column \"350\" holds -2, below zero. Subtract the background correctly, or set the value to 0",
        ),
        (
            "@em_nm\\ex_nm,350,400\n380,1,0\n450,nan,3\n",
            "t.csv:4: the cell at excitation 350 nm is empty. Fill it from its neighbors or with 0",
        ),
        (
            "@em_nm\\ex_nm,350,400\n380,1,0\n450,,3\n",
            "t.csv:4: the cell at excitation 350 nm is empty. Fill it from its neighbors or with 0",
        ),
        (
            "@em_nm\\ex_nm,350,400\n380,1,0\n450,2\n",
            "t.csv:4: this line has 2 cells but the header has 3. Give every line one cell per column",
        ),
        (
            "@em_nm\\ex_nm,350,\n380,1,0\n",
            "t.csv:2: excitation wavelength 2 is empty. Give every column its excitation wavelength in nm",
        ),
        (
            "@em_nm\\ex_nm\n380\n450\n",
            "t.csv:2: there is no excitation wavelength. Put them on the first line after \"em_nm\\ex_nm\", separated by commas",
        ),
    ];
    for (content, expected) in cases {
        let content = content.replace('@', photons);
        let said = complaint(content.as_bytes(), |path| read_eem_csv(path, &CsvEemOptions::default()));
        assert_eq!(said, *expected, "for {content:?}");
    }
    let energy = CsvEemOptions { unit: Some(YieldUnit::Energy), ..Default::default() };
    assert_eq!(
        complaint(b"# unit: photons\nem_nm\\ex_nm,350\n380,1\n390,1\n", |path| read_eem_csv(path, &energy)),
        "t.csv: the file states that its values count photons, but energy was requested. \
         Leave the choice to the file, or correct its comment"
    );
}

/// All wrong cells of a matrix are told with line and wavelengths, up to twenty of them.
#[test]
fn the_wrong_cells_of_a_matrix_are_told_together() {
    let told = |text: &str| complaint(text.as_bytes(), |path| read_eem_csv(path, &CsvEemOptions::default()));
    let said = told("# unit: photons\nem_nm\\ex_nm,350,360\n400,-1,2\n410,3,x\n420,,4\n");
    assert!(said.starts_with("t.csv:3: column \"350\" holds -1, below zero"), "{said}");
    for part in [
        "line 4 (emission 410 nm, excitation 360 nm) holds x",
        "line 5 (emission 420 nm, excitation 350 nm) holds nothing",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    let rows: String = (0..30).map(|row| format!("{},-1\n", 400 + row)).collect();
    let said = told(&format!("# unit: photons\nem_nm\\ex_nm,350\n{rows}"));
    assert!(said.contains("line 22 (emission 419 nm") && !said.contains("line 23 "), "{said}");
    assert!(said.ends_with("and 10 more cells"), "{said}");
    // Light below its excitation
    let said = told("# unit: photons\nem_nm\\ex_nm,350,400\n340,3,0\n390,1,2\n450,100,100\n");
    assert!(said.contains("line 4 (emission 390 nm, excitation 400 nm) holds 2"), "{said}");
}

#[test]
fn a_unit_that_the_file_does_not_know_is_decided_by_the_reader() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.csv");
    fs::write(&path, "# unit: unknown\nem_nm\\ex_nm,380,390\n500,1,2\n510,3,4\n").unwrap();
    let unit = |unit| read_eem_csv(&path, &CsvEemOptions { unit, ..Default::default() }).unwrap().unit;
    assert_eq!([unit(None), unit(Some(YieldUnit::Energy))], [None, Some(YieldUnit::Energy)]);
}

fn reference() -> Option<PathBuf> {
    let found = Path::new(env!("CARGO_MANIFEST_DIR"))
        .ancestors()
        .map(|folder| folder.join("shared/reference"))
        .find(|folder| folder.is_dir());
    if found.is_none() {
        println!("skipped: there is no shared/reference beside the repository");
    }
    found
}

fn csv_files(folder: &Path) -> Vec<PathBuf> {
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    files.filter(|path| path.extension().is_some_and(|extension| extension == "csv")).collect()
}

#[test]
fn measured_spectra_and_matrices_load() {
    let Some(reference) = reference() else { return };
    let options = CsvEemOptions { unit: Some(YieldUnit::Photons), ..Default::default() };
    let mut matrices = 0;
    for path in csv_files(&reference.join("eem")) {
        if path.file_name().unwrap().to_string_lossy().starts_with("webfluor_") {
            let eem = read_eem_csv(&path, &options).unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(eem.values.len(), eem.emission_nm.len() * eem.excitation_nm.len());
            matrices += 1;
        }
    }
    assert!(matrices > 10, "{matrices} matrices");
    let options = SpectrumOptions { negative: Negative::Keep, skip_empty_cells: true, ..Default::default() };
    for folder in ["lights", "filters", "sensors", "blood"] {
        for path in csv_files(&reference.join(folder)) {
            if !path.file_name().unwrap().to_string_lossy().ends_with("_index.csv") {
                let curves = read_spectra(&path, &options).unwrap_or_else(|error| panic!("{error}"));
                assert!(!curves.curves.is_empty());
            }
        }
    }
    let read = |path: &Path| {
        read_fluorophore_csv(path, Negative::Keep, None).unwrap_or_else(|error| panic!("{error}"))
    };
    assert!(csv_files(&reference.join("dyes")).iter().all(|path| !read(path).emission_only));
    let alfano = csv_files(&reference.join("fluorophores/toolbox"))
        .into_iter()
        .filter(|path| read(path).emission_only)
        .count();
    assert!(alfano > 0, "some sources have no excitation data");
}

/// Third-order light and Raman scatter of water are refused, and cut out of a dye at 370/470 nm. Water's line lies at 1/(1/350 - 3400e-7) = 397.3 nm.
#[test]
fn third_order_and_raman_scatter_are_found() {
    let bell = |nm: f64, peak: f64, sigma: f64| (-0.5 * ((nm - peak) / sigma).powi(2)).exp();
    let matrix = |scatter: &dyn Fn(f64, f64) -> f64| {
        let excitation: Vec<f64> = (20..=46).map(|nm| 10.0 * f64::from(nm)).collect();
        let mut text = String::from("# unit: photons\nem_nm\\ex_nm");
        excitation.iter().for_each(|ex| text += &format!(",{ex}"));
        for em in (320..=650).step_by(5).map(f64::from) {
            text += &format!("\n{em}");
            for &ex in &excitation {
                let dye = if em > ex { bell(ex, 370.0, 30.0) * bell(em, 470.0, 30.0) } else { 0.0 };
                text += &format!(",{}", dye + scatter(em, ex));
            }
        }
        text
    };
    let third = |em: f64, ex: f64| 4.0 * bell(em, 3.0 * ex, 4.0);
    let water = |em: f64, ex: f64| 3.0 * bell(em, 1.0 / (1.0 / ex - 3.4e-4), 4.0);
    for (text, words) in [(matrix(&third), "3 x excitation"), (matrix(&water), "3400 cm^-1")] {
        let strict = |path: &Path| read_eem_csv(path, &CsvEemOptions::default());
        let said = complaint(text.as_bytes(), strict);
        assert!(said.contains(words), "{said}");
        // The band that is named leaves the dye, not a flank of the line
        let keep = CsvEemOptions { anti_stokes: AntiStokes::Keep, ..CsvEemOptions::default() };
        let least = loaded(&text, |path| read_eem_csv(path, &keep)).least_cuts(CutTo::Neighbors, 1e-3);
        let within_nm = f64::from(least.for_all.unwrap());
        let cut = Some(ScatterCut { within_nm, to: CutTo::Neighbors });
        let found =
            loaded(&text, |path| read_eem_csv(path, &CsvEemOptions { cut, ..CsvEemOptions::default() }));
        let larger = |a: usize, b: usize| if found.values[b] > found.values[a] { b } else { a };
        let best = (0..found.values.len()).reduce(larger).unwrap();
        let columns = found.excitation_nm.len();
        let peak = [found.excitation_nm[best % columns], found.emission_nm[best / columns]];
        assert_eq!(peak, [370.0, 470.0], "{words}");
    }
}

/// A table of a dye at 340/440 nm with Rayleigh light along emission = excitation, as an Aqualog writes it: lines about the instrument, excitation from long
/// to short, an array of detectors. It may have the corner cell of the own form.
#[test]
fn lines_of_an_instrument_are_read_past_under_any_corner() {
    let bell = |nm: f64, width: f64| (-(nm / width).powi(2)).exp();
    let excitation: Vec<f64> = (0..12).map(|i| 250.0 + 10.0 * f64::from(i)).collect();
    let emission: Vec<f64> = (0..50).map(|i| 245.3 + 4.65 * f64::from(i)).collect();
    let value = |em: f64, ex: f64| {
        let dye = if em > ex { bell(ex - 340.0, 40.0) * bell(em - 440.0, 50.0) } else { 0.0 };
        (1e4 * (dye + 20.0 * bell(em - ex, 4.0))).round() / 1e4
    };
    let table = |corner: &str| {
        let header: String = excitation.iter().rev().map(|ex| format!("\t{ex}")).collect();
        let mut text = format!("# unit: photons\n{corner}{header}\nnm\t\t\nNormalized by 1.000\n");
        for &em in &emission {
            let row: String = excitation.iter().rev().map(|&ex| format!("\t{}", value(em, ex))).collect();
            text += &format!("{em:.2}{row}\n");
        }
        text
    };
    let keep = CsvEemOptions { anti_stokes: AntiStokes::Keep, ..CsvEemOptions::default() };
    for corner in ["Sample - Blank", "em_nm\\ex_nm", "Wavelength (nm)", ""] {
        let found = loaded(&table(corner), |path| read_eem_csv(path, &keep));
        assert_eq!(found.excitation_nm, excitation, "{corner}");
        for (row, em) in emission.iter().enumerate() {
            assert!((found.emission_nm[row] - em).abs() < 0.006);
            for (column, ex) in excitation.iter().enumerate() {
                assert_eq!(found.values[row * 12 + column], value(*em, *ex), "{corner} {em} {ex}");
            }
        }
    }
    // The other way round, the wavelengths of the detectors stand above the columns
    let mut turned = String::from("# unit: photons\n,");
    turned += &emission.iter().map(|em| format!("{em:.2}")).collect::<Vec<_>>().join(",");
    for &ex in &excitation {
        turned += &format!("\n{ex}");
        turned.extend(emission.iter().map(|&em| format!(",{}", value(em, ex))));
    }
    let said = complaint(turned.as_bytes(), |path| read_eem_csv(path, &keep));
    assert!(said.contains("columns would be emission") && said.contains("Transpose the table"), "{said}");
}

/// Scans of two samples side by side, as pairs of columns or as columns: which there are is told, and one can be chosen.
#[test]
fn one_of_several_samples_is_read() {
    let pairs = "# unit: photons\na_EX_350.00,,b 2_EX_350.00,,a_EX_360.00,,b 2_EX_360.00,\n\
                 Wavelength (nm),Intensity,Wavelength (nm),Intensity,Wavelength (nm),Intensity,Wavelength (nm),Intensity\n\
                 400,1,402,10,400,2,402,20\n410,3,412,30,410,4,412,40\n\nInstrument,X\n";
    let columns = "# unit: photons\nEmission\ta EX 350\ta EX 360\tb 2 EX 350\tb 2 EX 360\n402\t1\t2\t10\t20\n412\t3\t4\t30\t40\n";
    let of =
        |sample: Option<&str>| CsvEemOptions { sample: sample.map(String::from), ..CsvEemOptions::default() };
    for text in [pairs, columns] {
        let said = complaint(text.as_bytes(), |path| read_eem_csv(path, &of(None)));
        assert_eq!(said, "t.csv:2: the columns are of 2 samples: a, b 2. Choose one of them");
        let said = complaint(text.as_bytes(), |path| read_eem_csv(path, &of(Some("c"))));
        assert_eq!(said, "t.csv:2: there is no sample \"c\". Samples are: a, b 2");
        let found = loaded(text, |path| read_eem_csv(path, &of(Some("b 2"))));
        assert_eq!((found.emission_nm, found.excitation_nm), (vec![402.0, 412.0], vec![350.0, 360.0]));
        assert_eq!(found.values, [10.0, 20.0, 30.0, 40.0]);
        let found = loaded(text, |path| read_eem_csv(path, &of(Some("a"))));
        assert_eq!(found.values, [1.0, 2.0, 3.0, 4.0]);
    }
    let plain = "# unit: photons\nem_nm\\ex_nm,350,360\n400,1,2\n410,3,4\n";
    let said = complaint(plain.as_bytes(), |path| read_eem_csv(path, &of(Some("a"))));
    assert!(said.contains("the columns name no samples"), "{said}");
}

/// Headers as databases of dyes write them, of one dye or several.
#[test]
fn excitation_and_emission_are_found_by_the_name_of_the_dye() {
    let read = |sample: Option<&'static str>| {
        move |path: &Path| read_fluorophore_csv(path, Negative::Refuse, sample)
    };
    let one = "wavelength,EGFP ex,EGFP em\n400,1,\n410,0.5,0\n420,,1\n";
    for sample in [None, Some("EGFP")] {
        let found = loaded(one, read(sample));
        assert_eq!((found.excitation.values(), found.emission.values()), (&[1.0, 0.5][..], &[0.0, 1.0][..]));
    }
    let two = "wavelength,EGFP ex,EGFP em,EGFP 2p,m Cherry ex,m Cherry em\n400,1,,-1,0.2,0\n410,0.5,0,-1,0.1,0.3\n420,,1,-1,0,0.4\n";
    assert_eq!(
        complaint(two.as_bytes(), read(None)),
        "t.csv:1: the columns are of 2 samples: EGFP, m Cherry. Choose one of them"
    );
    let found = loaded(two, read(Some("m Cherry")));
    assert_eq!(
        (found.excitation.values(), found.emission.values()),
        (&[0.2, 0.1, 0.0][..], &[0.0, 0.3, 0.4][..])
    );
    let said = complaint(two.as_bytes(), read(Some("GFP")));
    assert!(said.contains("there is no sample \"GFP\""), "{said}");
    let list = "Excitation Wavelength,Emission Wavelength,Intensity\n350,400,1\n350,410,2\n360,400,1\n";
    assert!(complaint(list.as_bytes(), read(None)).contains("single values in a list, no spectra"));
    let plain = "wavelength_nm,excitation,emission\n400,1,0\n410,0.5,1\n";
    assert!(complaint(plain.as_bytes(), read(Some("GFP"))).contains("the columns name no samples"));
}

/// A flat top of a detector at its end: a bell of width 30 nm and height 1.5 cut at 1 is flat within 30 sqrt(2 ln 1.5) = 27.01 nm of its middle.
#[test]
fn detectors_at_their_end_are_found() {
    let bell = |nm: f64| (-0.5 * (nm / 30.0).powi(2)).exp();
    let matrix = |end: f64, step: f64| {
        let mut text = String::from("# unit: photons\nem_nm\\ex_nm,360,370,380");
        for em in (400..=560).step_by(5) {
            text += &format!("\n{em}");
            for ex in [360, 370, 380] {
                let value = 1.5 * bell(f64::from(ex - 370)) * bell(f64::from(em - 470));
                text += &format!(",{}", (value.min(end) / step).round() * step);
            }
        }
        loaded(&text, |path| read_eem_csv(path, &CsvEemOptions::default()))
    };
    let found = matrix(1.0, 1e-9).overflow().unwrap();
    // At 360 and 380 nm the bell is 1.4190 high, flat within 25.1 nm
    assert_eq!((found.value, found.cells), (1.0, 33));
    assert_eq!((found.excitation_nm, found.emission_nm), ([360.0, 380.0], [445.0, 495.0]));
    assert!(found.to_string().contains("narrower slit"), "{found}");
    // A whole peak, and one whose top is flat by rounding to 0.05
    assert_eq!(matrix(f64::INFINITY, 1e-9).overflow(), None);
    assert_eq!(matrix(f64::INFINITY, 0.05).overflow(), None);
}
