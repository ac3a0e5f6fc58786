//! `fluorspar lens report`.

use std::io::Write;
use std::path::PathBuf;

use clap::ValueHint;
use fluorspar::optics::{LensReport, LensReportSettings, LensSetting, LensState};
use fluorspar::units::number_text;
use fluorspar_experiment::preset::{LensError, LoadedLens, lens_or_file};
use fluorspar_format::{LensFile, Output, Outputs, write_atomically};
use fluorspar_report::figures::{lens_drawing, lens_field, lens_mtf, lens_spots};

use crate::commands::table::{align, short};
use crate::commands::{FigureFormat, beside, print_json, print_text};
use crate::error::CliError;
use crate::message::Messages;
use crate::values::{self, check_range};

/// Options of `lens report`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Lens of the catalogue, or a file: .toml, .dat (pbrt), .json (ISET), .zmx (Zemax).
    #[arg(value_name = "LENS", value_hint = ValueHint::FilePath)]
    lens: String,
    /// Stop down to this f-number [default: wide open].
    #[arg(long, value_name = "N", value_parser = values::number, allow_negative_numbers = true)]
    f_number: Option<f64>,
    /// Distance in focus from the entrance pupil, mm [default: infinity].
    #[arg(long, value_name = "MM", value_parser = values::number, allow_negative_numbers = true)]
    focus_distance_mm: Option<f64>,
    /// Move the film away from the lens by this much, mm.
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = values::number, allow_negative_numbers = true)]
    film_shift_mm: f64,
    /// Largest height on the film, half the diagonal of the sensor, mm [default: that of 20 degrees, or less where a fifth of
    /// the light of the axis is left].
    #[arg(long, value_name = "MM", value_parser = values::number, allow_negative_numbers = true)]
    image_height_mm: Option<f64>,
    /// Wavelength of the rays, nm [default: the design wavelength of the lens].
    #[arg(long, value_name = "NM", value_parser = values::number, allow_negative_numbers = true)]
    wavelength_nm: Option<f64>,
    /// Frequency of the MTF through focus, cycles per mm on the film; other curves go to twice this.
    #[arg(long, value_name = "CYCLES", default_value_t = 50.0, value_parser = values::number, allow_negative_numbers = true)]
    frequency: f64,
    /// File of the figure of the lens with rays, .svg or .png; FILE_spots, FILE_mtf and FILE_field lie beside it.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    out: Option<PathBuf>,
    /// Print the answer as JSON.
    #[arg(long)]
    json: bool,
    /// Print the lens itself as a lens file (.toml), whatever program it comes from, and trace nothing.
    #[arg(long, conflicts_with_all = ["json", "out", "f_number", "focus_distance_mm", "film_shift_mm", "image_height_mm", "wavelength_nm", "frequency"])]
    toml: bool,
}

/// What the names of the figures end in, after that of the drawing.
const FIGURES: [&str; 4] = ["", "_spots", "_mtf", "_field"];

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    if let Some(nm) = options.wavelength_nm {
        check_range("wavelength_nm", nm, [200.0, 1200.0], "nm")?;
    }
    if let Some(height) = options.image_height_mm {
        check_range("image_height_mm", height, [1e-3, 1e3], "mm")?;
    }
    check_range("frequency", options.frequency, [0.1, 1e4], "cycles per mm")?;
    let figures = match &options.out {
        Some(out) => {
            let format = FigureFormat::of(out)?;
            let names = FIGURES.map(|suffix| beside(out, suffix));
            let outputs = names.iter().fold(Outputs::new(), |all, name| all.and(Output::file("--out", name)));
            let set = outputs.reading(&[PathBuf::from(&options.lens)]).declare()?;
            Some((names, format, set))
        }
        None => None,
    };
    let loaded = lens_or_file(&options.lens)?;
    if options.toml {
        let text = LensFile::from_prescription(&loaded.lens).to_toml();
        return print_text(&text.map_err(|problem| CliError::Input(format!("{}: {problem}", options.lens)))?);
    }
    let setting = LensSetting {
        f_number: options.f_number,
        object_distance_mm: options.focus_distance_mm,
        film_shift_mm: options.film_shift_mm,
    };
    let state = LensState::new(&loaded.lens, setting).map_err(|problem| {
        let typed = match problem.place.as_str() {
            "f_number" => Some(("--f-number", options.f_number)),
            "focus_distance_mm" => Some(("--focus-distance-mm", options.focus_distance_mm)),
            "film_shift_mm" => Some(("--film-shift-mm", Some(options.film_shift_mm))),
            _ => None,
        };
        match typed {
            Some((option, value)) => {
                let value = value.map(number_text).unwrap_or_default();
                CliError::Input(format!("{option} {value}: {}: {}", options.lens, problem.message))
            }
            None => LensError::Prescription { name: options.lens.clone(), problem }.into(),
        }
    })?;
    let settings = LensReportSettings {
        image_height_mm: options.image_height_mm,
        wavelength_nm: options.wavelength_nm,
        frequency_per_mm: options.frequency,
    };
    let report = LensReport::new(&state, &settings);
    if let Some((names, format, set)) = figures {
        let drawn = [lens_drawing(&report), lens_spots(&report), lens_mtf(&report), lens_field(&report)];
        for (path, figure) in names.iter().zip(&drawn) {
            let bytes = format.bytes(figure)?;
            write_atomically(path, |file| file.write_all(&bytes))?;
        }
        set.finish()?;
        names.iter().for_each(|path| Messages::default().status(format!("Wrote {}", path.display())));
    }
    if options.json { print_json(&report) } else { print_text(&describe(&loaded, &report)) }
}

fn describe(loaded: &LoadedLens, report: &LensReport) -> String {
    let focus = report.object_distance_mm.map_or_else(|| "infinity".into(), mm);
    let mut text = format!(
        "{} ({})\nSource: {}\nAt {} nm, focused at {focus}. Positions are from the first vertex, positive toward the film.\n\n",
        loaded.title,
        report.name,
        if loaded.lens.source.is_empty() { "not stated" } else { &loaded.lens.source },
        short(report.wavelength_nm)
    );
    text += &align(&axial_rows(loaded, report), &[1]);
    text += &format!("\n{}", align(&field_rows(report), &[]));
    text + &sharpness(report)
}

/// A length, mm.
fn mm(value: f64) -> String {
    if value.is_finite() { format!("{} mm", short(value)) } else { "infinite".into() }
}

/// A value that need not exist.
fn cell(value: Option<f64>) -> String {
    value.map_or_else(|| "-".into(), short)
}

/// Focal lengths, pupils and positions.
fn axial_rows(loaded: &LoadedLens, report: &LensReport) -> Vec<Vec<String>> {
    let p = &report.paraxial;
    let line = |name: &str, value: String| vec![name.to_owned(), value];
    let mut rows = vec![
        line("focal length", mm(p.focal_length_mm)),
        line("f-number, distant object", short(report.f_number)),
        line("working f-number", short(report.working_f_number)),
        line("irradiance per radiance on the axis", format!("{} sr", short(report.axial_solid_angle_sr))),
        line("magnification", short(report.magnification)),
        line("back focal length", mm(p.back_focal_length_mm)),
        line(
            "front and rear principal planes",
            format!("{}, {}", mm(p.front_principal_mm), mm(p.rear_principal_mm)),
        ),
        line(
            "entrance pupil",
            format!("at {}, diameter {}", mm(p.entrance_pupil_mm), mm(report.entrance_pupil_diameter_mm)),
        ),
        line(
            "exit pupil",
            format!("at {}, diameter {}", mm(p.exit_pupil_mm), mm(report.exit_pupil_diameter_mm)),
        ),
        line("stop", format!("diameter {}", mm(report.stop_diameter_mm))),
        line("film", format!("at {}", mm(report.film_mm))),
        line(
            &format!(
                "sharpest film on the axis, {} cycles per mm",
                short(report.mtf.through_focus_frequency_per_mm)
            ),
            format!("{} from there", mm(report.mtf.best_axial_focus_mm)),
        ),
    ];
    let published = &loaded.published;
    rows.extend(published.focal_length_mm.map(|f| line("published focal length", mm(f))));
    rows.extend(published.f_number.map(|n| line("published f-number", short(n))));
    rows
}

/// Table of the field: illumination, distortion, foci.
fn field_rows(report: &LensReport) -> Vec<Vec<String>> {
    let head = [
        "height mm",
        "field deg",
        "illumination",
        "distortion %",
        "tangential focus mm",
        "sagittal focus mm",
    ];
    let mut rows = vec![head.map(String::from).to_vec()];
    for point in &report.field {
        rows.push(vec![
            short(point.height_mm),
            cell(point.object_angle_deg),
            short(point.relative_illumination),
            cell(point.distortion_percent),
            cell(point.tangential_focus_mm),
            cell(point.sagittal_focus_mm),
        ]);
    }
    rows
}

/// Spots and MTF over the field.
fn sharpness(report: &LensReport) -> String {
    let nu = &report.mtf.frequency_per_mm;
    let at =
        nu.iter().position(|f| *f >= report.mtf.through_focus_frequency_per_mm * (1.0 - 1e-9)).unwrap_or(0);
    let frequency = short(nu[at]);
    let head = ["height mm", "spot rms um", "tangential MTF", "sagittal MTF"].map(String::from);
    let mut rows = vec![head.to_vec()];
    for (spot, mtf) in report.spots.iter().zip(&report.mtf.fields) {
        rows.push(vec![
            short(spot.height_mm),
            cell(spot.rms_radius_mm.map(|rms| 1e3 * rms)),
            cell(mtf.tangential.get(at).copied()),
            cell(mtf.sagittal.get(at).copied()),
        ]);
    }
    format!(
        "\nRays alone at {frequency} cycles per mm; a perfect lens has {} there by diffraction.\n{}",
        short(report.mtf.diffraction_limit[at]),
        align(&rows, &[])
    )
}
