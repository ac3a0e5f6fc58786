//! Tables, figures and the page of a sweep.

use std::path::PathBuf;

use fluorspar::units::number_text;
use fluorspar_format::{OutputFolder, csv_cell};
use fluorspar_report::figures::{PlotCurve, SweptQuantity, swept_quantities, swept_spectra};
use fluorspar_report::{Figure, NumberMatrix, ReportData, ReportItem, RunFolderError, Section};

use super::sweep::{SweptPoint, SweptTissue};
use crate::Result;
use crate::figure_file::figure_files;
use crate::values::{csv, short};

/// Wavelengths whose reflectance is told, nm: where blood absorbs much, some and little.
const TOLD_NM: [f64; 3] = [450.0, 540.0, 630.0];

/// Writes all files of a sweep.
pub(super) fn write(out: OutputFolder, found: &SweptTissue) -> Result<PathBuf> {
    let rows = sweep_table(found, |value| value.to_string());
    let table = csv(&rows[0].join(","), rows[1..].iter().map(|row| row.join(",")));
    let mut files = vec![
        ("report.html".to_string(), page(found).to_html().into_bytes()),
        ("results.json".into(), serde_json::to_string_pretty(found)?.into_bytes()),
        ("sweep.csv".into(), table.into_bytes()),
        ("reflectance.csv".into(), spectra(found, |point| &point.reflectance).into_bytes()),
        ("fluorescence.csv".into(), spectra(found, |point| &point.exitance_per_nm).into_bytes()),
    ];
    let path = out.path().join("figures");
    std::fs::create_dir_all(&path).map_err(|source| RunFolderError::Folder { path, source })?;
    for (stem, figure) in figures(found) {
        files.extend(figure_files(&format!("figures/{stem}"), &figure)?);
        files.extend(figure.to_csv().map(|csv| (format!("figures/{stem}.csv"), csv.into_bytes())));
    }
    Ok(out.finish_with(files)?)
}

impl SweptTissue {
    /// The parameter with its unit.
    fn quantity(&self) -> String {
        let unit = if self.unit.is_empty() { String::new() } else { format!(", {}", self.unit) };
        let ends = ["_um", "_per_mm", "_per_nm", "_g_per_l"];
        let bare = ends.iter().find_map(|end| self.parameter.strip_suffix(end));
        format!("{}{unit}", bare.filter(|_| !unit.is_empty()).unwrap_or(&self.parameter).replace('_', " "))
    }

    /// Names of what is told of each value.
    fn heads(&self) -> [String; 12] {
        let [blue, green, red] = TOLD_NM.map(|nm| format!("reflectance_{nm}_nm"));
        let others = [
            "luminance_factor",
            "reflected_x",
            "reflected_y",
            "fluorescence",
            "fluorescence_x",
            "fluorescence_y",
            "median_depth_um",
            "depth_of_1_over_e_um",
        ];
        let [y, rx, ry, f, fx, fy, median, depth] = others.map(String::from);
        [self.parameter.clone(), blue, green, red, y, rx, ry, f, fx, fy, median, depth]
    }

    /// What is told of a value, in the order of the heads; none of what there is none of.
    fn numbers(&self, point: &SweptPoint) -> [Option<f64>; 12] {
        let [blue, green, red] = TOLD_NM.map(|nm| self.reflectance_at(point, nm));
        let [[rx, ry], [fx, fy]] = [point.reflected_xy, point.fluorescence_xy]
            .map(|xy| xy.map_or([None; 2], |[x, y]| [Some(x), Some(y)]));
        let [value, y, f] = [point.value, point.luminance_factor, point.exitance].map(Some);
        let [median, depth] = [point.median_depth_um, Some(point.depth_of_1_over_e_um)];
        [value, blue, green, red, y, rx, ry, f, fx, fy, median, depth]
    }

    fn reflectance_at(&self, point: &SweptPoint, nm: f64) -> Option<f64> {
        let at = self.wavelength_nm.iter().position(|known| *known == nm)?;
        point.reflectance.get(at).copied()
    }
}

/// What is told of each value, below heads; what there is none of stays empty.
#[must_use]
pub fn sweep_table(found: &SweptTissue, text: impl Fn(f64) -> String) -> Vec<Vec<String>> {
    let cell = |number: Option<f64>| number.map(&text).unwrap_or_default();
    let rows = found.points.iter().map(|point| found.numbers(point).map(cell).to_vec());
    std::iter::once(found.heads().to_vec()).chain(rows).collect()
}

/// Three digits.
fn rounded(value: f64) -> String {
    number_text(format!("{value:.2e}").parse().unwrap_or(value))
}

/// Spectra by wavelength, one column for each value.
fn spectra(found: &SweptTissue, of: impl Fn(&SweptPoint) -> &[f64]) -> String {
    let names =
        found.points.iter().map(|p| csv_cell(&format!("{}={}", found.parameter, p.value)).into_owned());
    let heads = std::iter::once("wavelength_nm".to_string()).chain(names).collect::<Vec<_>>().join(",");
    let row = |(i, nm): (usize, &f64)| {
        let values: String = found.points.iter().map(|point| format!(",{}", of(point)[i])).collect();
        format!("{nm}{values}")
    };
    csv(&heads, found.wavelength_nm.iter().enumerate().map(row))
}

/// Numbers over the parameter, and spectra by its value.
fn figures(found: &SweptTissue) -> [(&'static str, Figure); 3] {
    let curves = |of: &dyn Fn(&SweptPoint) -> Vec<f64>| -> Vec<PlotCurve> {
        let curve = |p: &SweptPoint| PlotCurve::new(rounded(p.value), found.wavelength_nm.clone(), of(p));
        found.points.iter().map(curve).collect()
    };
    let name = found.quantity();
    let of_light = format!("Fluorescence under {} nm by {name}", found.excitation_nm);
    let exitance = ["radiant exitance per irradiance", "1/nm"];
    let reflectance = swept_spectra(
        &format!("Reflectance by {name}"),
        ["reflectance", ""],
        &curves(&|p| p.reflectance.clone()),
    );
    let fluorescence = swept_spectra(&of_light, exitance, &curves(&|p| p.exitance_per_nm.clone()));
    [
        ("numbers", swept_quantities(&found.title, &name, found.typical, &quantities(found))),
        ("reflectance", reflectance),
        ("fluorescence", fluorescence),
    ]
}

/// What is drawn over the parameter: numbers of the table by their names there.
fn quantities(found: &SweptTissue) -> [SweptQuantity; 4] {
    let numbers: Vec<[Option<f64>; 12]> = found.points.iter().map(|point| found.numbers(point)).collect();
    let quantity = |label: &str, unit: &str, curves: &[(usize, &str)]| SweptQuantity {
        label: label.into(),
        unit: unit.into(),
        curves: curves
            .iter()
            .map(|(column, name)| {
                let points = numbers.iter().filter_map(|row| Some([row[0]?, row[*column]?]));
                ((*name).to_string(), points.collect())
            })
            .collect(),
    };
    let reflectances = TOLD_NM.map(|nm| format!("reflectance at {nm} nm"));
    let [blue, green, red] = reflectances.each_ref().map(String::as_str);
    let colors = [
        (5, "x of white light reflected"),
        (6, "y of white light reflected"),
        (8, "x of the fluorescence"),
        (9, "y of the fluorescence"),
    ];
    let depths = [(10, "above it half of the fluorescence arises"), (11, "1/e of the light is left")];
    let light = format!("fluorescence under {} nm", found.excitation_nm);
    [
        quantity("reflectance", "", &[(1, blue), (2, green), (3, red)]),
        quantity(&light, "", &[(7, "share of the energy")]),
        quantity("chromaticity", "", &colors),
        quantity("depth", "µm", &depths),
    ]
}

/// The page.
fn page(found: &SweptTissue) -> ReportData {
    let ends = [found.points.first(), found.points.last()].map(|p| p.map_or(f64::NAN, |p| p.value));
    let lead = format!(
        "The {} goes from {} to {}; the site has {}. {} Light of {} nm excites the fluorescence.",
        found.quantity(),
        rounded(ends[0]),
        rounded(ends[1]),
        rounded(found.typical),
        found.meaning,
        found.excitation_nm
    );
    let mut section = Section::new("Over the parameter");
    for (stem, figure) in figures(found) {
        section = section.with(ReportItem::Figure { figure, caption: String::new(), stem: stem.into() });
    }
    ReportData {
        title: format!("{} by {}", found.title, found.quantity()),
        lead: vec![lead],
        sections: vec![section, Section::new("Numbers").with(ReportItem::Matrix(numbers(found)))],
        ..ReportData::default()
    }
}

/// All points as a table.
fn numbers(found: &SweptTissue) -> NumberMatrix {
    let mut rows = sweep_table(found, short);
    let heads = rows.remove(0);
    NumberMatrix {
        caption: "The same in numbers; sweep.csv has all digits.".into(),
        columns: heads.iter().map(|name| name.replace('_', " ")).collect(),
        rows,
        note: "Reflectance of diffuse light, without what the surface reflects at once. Fluorescence: energy that returns per energy of \
               the light. Chromaticities: x and y of CIE 1931, white light is D65. Depths in µm: above the first half of the fluorescence \
               arises; at the second the fluence of a beam has fallen to 1/e."
            .into(),
    }
}
