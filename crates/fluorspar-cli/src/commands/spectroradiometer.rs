//! `fluorspar spectroradiometer`: what a spot instrument reads of a render or of a flat sample.

use clap::ValueHint;
use fluorspar::pipeline::{SpectroradiometerReading, check_same_scene, predict, read_spectroradiometers};
use fluorspar::sensor::Spectroradiometer;
use fluorspar::spectral::{Curve, Radiance, Spectrum};
use fluorspar::units::number_text;
use fluorspar_experiment::{ResolvedSample, parse, resolve};
use fluorspar_format::{
    Output, Outputs, WRITTEN_BY, quoted_csv_cell, read_component_image, write_atomically,
};
use fluorspar_report::figures::{PlotCurve, spectral_readings};
use fluorspar_session::{Changes, ExperimentSource};
use std::io::Write;
use std::path::{Path, PathBuf};

use super::quoted;
use super::table::{align, short};
use crate::args::Answer;
use crate::error::CliError;
use crate::message::Messages;
use crate::values::{self, Override, sets};

/// Options of `spectroradiometer`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Component image (components.exr of a run), or a flat sample: a .toml file or the name of a built-in one [default:
    /// tongue-385nm].
    #[arg(value_name = "COMPONENTS.exr|SAMPLE", value_hint = ValueHint::FilePath)]
    input: Option<String>,
    #[command(flatten)]
    changes: Changes,
    /// Capture whose lights are on, for an instrument besides those of the experiment. Not for samples.
    #[arg(long, value_name = "NAME")]
    capture: Option<String>,
    /// Center of its spot, as fractions of the image from the left and the top [default: 0.5,0.5].
    #[arg(long, value_name = "X,Y", value_delimiter = ',', num_args = 1, requires = "capture", value_parser = values::number,
        allow_negative_numbers = true)]
    aim: Vec<f64>,
    /// Parts of the scene that it averages over instead of a spot.
    #[arg(long, value_name = "PART", value_delimiter = ',', requires = "capture")]
    parts: Vec<String>,
    /// Full angle of its spot, degrees [default: 1].
    #[arg(long, value_name = "DEG", requires = "capture", value_parser = values::number, allow_negative_numbers = true)]
    acceptance_deg: Option<f64>,
    /// Filter in front of the instrument: a name of the catalogue or a CSV file. May be repeated.
    #[arg(long = "view-filter", alias = "filter", value_name = "NAME|CSV")]
    filter: Vec<String>,
    /// Full width at half maximum of the slit, nm [default: 8].
    #[arg(long, value_name = "NM", value_parser = values::number, allow_negative_numbers = true)]
    bandwidth_nm: Option<f64>,
    /// Step between readings, nm [default: 2].
    #[arg(long, value_name = "NM", value_parser = values::number, allow_negative_numbers = true)]
    step_nm: Option<f64>,
    /// Noise of a reading without light, W/(sr m² nm) [default: 5e-7].
    #[arg(long, value_name = "L", value_parser = values::number, allow_negative_numbers = true)]
    noise_floor: Option<f64>,
    /// Largest ratio of signal to noise floor [default: 1e4].
    #[arg(long, value_name = "RATIO", value_parser = values::number, allow_negative_numbers = true)]
    dynamic_range: Option<f64>,
    /// Readings that are averaged [default: 1].
    #[arg(long, value_name = "N", value_parser = values::whole::<u32, 1, 1_000_000>, allow_negative_numbers = true)]
    readings: Option<u32>,
    /// Seed of the noise of a sample's reading; an image has that of its experiment.
    #[arg(long, value_name = "S", default_value_t = 1, value_parser = values::whole::<u64, 0, { u64::MAX }>, allow_negative_numbers = true)]
    seed: u64,
    /// File for the spectra, .csv, or for their figure, .svg or .png.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    out: Option<PathBuf>,
    #[command(flatten)]
    answer: Answer,
}

impl Options {
    /// The instrument that the options describe, as lines of a TOML section.
    fn section(&self) -> String {
        let mut lines = String::new();
        let mut add = |key: &str, value: Option<String>| {
            lines += &value.map_or_else(String::new, |value| format!("{key} = {value}\n"));
        };
        let number = |value: Option<f64>| value.map(|v| toml::Value::Float(v).to_string());
        let list = |items: &[String]| {
            let items: Vec<String> = items.iter().map(|item| quoted(item)).collect();
            (!items.is_empty()).then(|| format!("[{}]", items.join(", ")))
        };
        let aim: Vec<String> = self.aim.iter().map(|v| toml::Value::Float(*v).to_string()).collect();
        add("aim", (!aim.is_empty()).then(|| format!("[{}]", aim.join(", "))));
        add("parts", list(&self.parts));
        add("acceptance_deg", number(self.acceptance_deg));
        add("filters", list(&self.filter));
        add("bandwidth_nm", number(self.bandwidth_nm));
        add("step_nm", number(self.step_nm));
        add("noise_floor_w_per_sr_m2_nm", number(self.noise_floor));
        add("dynamic_range", number(self.dynamic_range));
        add("readings", self.readings.map(|n| n.to_string()));
        lines
    }

    /// The option that sets a field of an instrument, as it was typed.
    fn typed(&self, field: &str) -> String {
        let number = |value: Option<f64>| value.map(number_text);
        let field = field.split('[').next().unwrap_or(field);
        let (option, value) = match field {
            "capture" => ("capture", self.capture.clone()),
            "aim" => ("aim", Some(self.aim.iter().map(|&v| number_text(v)).collect::<Vec<_>>().join(","))),
            "parts" => ("parts", Some(self.parts.join(","))),
            "acceptance_deg" => ("acceptance-deg", number(self.acceptance_deg)),
            "filters" => ("view-filter", Some(self.filter.join(" --view-filter "))),
            "bandwidth_nm" => ("bandwidth-nm", number(self.bandwidth_nm)),
            "step_nm" => ("step-nm", number(self.step_nm)),
            "noise_floor" | "noise_floor_w_per_sr_m2_nm" => ("noise-floor", number(self.noise_floor)),
            "dynamic_range" => ("dynamic-range", number(self.dynamic_range)),
            "readings" => ("readings", self.readings.map(|n| n.to_string())),
            other => (other, None),
        };
        format!("--{option} {}", value.unwrap_or_default()).trim_end().to_string()
    }

    fn describes_an_instrument(&self) -> bool {
        !self.section().is_empty()
    }
}

enum Form {
    Csv,
    Svg,
    Png,
}

fn form(path: &Path) -> Result<Form, CliError> {
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("csv") => Ok(Form::Csv),
        Some("svg") => Ok(Form::Svg),
        Some("png") => Ok(Form::Png),
        _ => {
            Err(CliError::Input(format!("--out {}: the name must end in .csv, .svg or .png", path.display())))
        }
    }
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let target = match &options.out {
        Some(path) => {
            let kind = form(path)?;
            let inputs: Vec<PathBuf> =
                options.input.iter().chain(&options.filter).map(PathBuf::from).collect();
            let set = Outputs::new().and(Output::file("--out", path)).reading(&inputs).declare()?;
            Some((path, kind, set))
        }
        None => None,
    };
    let is_image = options
        .input
        .as_deref()
        .is_some_and(|name| Path::new(name).extension().is_some_and(|e| e.eq_ignore_ascii_case("exr")));
    let readings = match &options.input {
        Some(image) if is_image => of_image(options, Path::new(image))?,
        sample => of_sample(options, sample.as_deref())?,
    };
    if let Some((path, kind, set)) = target {
        let bytes = match kind {
            Form::Csv => csv(&readings).into_bytes(),
            Form::Svg => plot(&readings).to_svg().into_bytes(),
            Form::Png => plot(&readings).to_png()?,
        };
        write_atomically(path, |file| file.write_all(&bytes))?;
        set.finish()?;
        Messages::default().status(format!("Wrote {}", path.display()));
    }
    if options.answer.json {
        super::print_json(&readings)?;
    } else if options.out.is_none() {
        super::print_text(&describe(&readings))?;
    }
    Ok(())
}

/// Instruments of the experiment that an image carries, or the one that the options point.
fn of_image(options: &Options, path: &Path) -> Result<Vec<SpectroradiometerReading>, CliError> {
    let shown = path.display();
    let loaded = read_component_image(path)?;
    let Some(provenance) = loaded.provenance else {
        return Err(CliError::Input(format!(
            "{shown}: this image carries no experiment, so its lights and field of view are not known; make it with `run` or \
             `render --components`"
        )));
    };
    let name = format!("experiment in {shown}");
    let text = &provenance.resolved_experiment_toml;
    let rendered = resolve(&parse(text, &name, Path::new("."), &[])?)?.study;
    // A section of its own for the instrument of the options.
    const OWN: &str = "command line";
    let text = match &options.capture {
        Some(capture) => format!(
            "{text}\n[[spectroradiometer]]\nname = \"{OWN}\"\ncapture = {}\n{}",
            quoted(capture),
            options.section()
        ),
        None if options.describes_an_instrument() => {
            return Err(CliError::Input(
                "these options describe an instrument; add --capture NAME to say whose lights it reads, or change one of \
                 the experiment with --set spectroradiometer.NAME.FIELD=VALUE"
                    .into(),
            ));
        }
        None => text.clone(),
    };
    let mut study = parse(&text, &name, Path::new("."), &sets(&options.changes.overrides()))
        .and_then(|parsed| resolve(&parsed))
        .map_err(|error| {
            let details = error.details();
            let own = details.entry.as_ref().is_some_and(|entry| entry.ends_with(&format!("\"{OWN}\"")));
            match &details.field {
                Some(field) if own => {
                    CliError::Input(format!("{}: {}", options.typed(field), details.message))
                }
                _ => error.into(),
            }
        })?
        .study;
    check_same_scene(&rendered, &study)?;
    if options.capture.is_some() {
        study.spectroradiometers.retain(|device| device.name == OWN);
    }
    if study.spectroradiometers.is_empty() {
        let captures: Vec<&str> = study.captures.iter().map(|c| c.frame.label.as_str()).collect();
        return Err(CliError::Input(format!(
            "{shown}: the experiment has no [[spectroradiometer]]; point one with --capture ({})",
            captures.join(", ")
        )));
    }
    Ok(read_spectroradiometers(&study, &loaded.image)?)
}

/// A flat sample fills any spot.
fn of_sample(options: &Options, name: Option<&str>) -> Result<Vec<SpectroradiometerReading>, CliError> {
    if let Some(capture) = &options.capture {
        return Err(CliError::Input(format!(
            "--capture {capture}: a flat sample has one light and no captures; leave it out, or give a component image"
        )));
    }
    let source = ExperimentSource::find_sample(name)?;
    let mut overrides = Vec::new();
    if !options.filter.is_empty() {
        let items: Vec<String> = options.filter.iter().map(|name| quoted(name)).collect();
        let typed: Vec<String> = options.filter.iter().map(|name| format!("--view-filter {name}")).collect();
        let list = format!("[{}]", items.join(", "));
        overrides.push(Override::of_option("view_filter.filters", list, typed.join(" ")));
    }
    overrides.extend(options.changes.overrides());
    let ResolvedSample { sample, record, .. } = source.resolve_sample(&overrides)?;
    Messages::default().warnings(&record.warnings);
    let filter = if options.filter.is_empty() {
        Curve::constant(1.0)
    } else {
        sample.camera.view_filter.transmittance.clone()
    };
    let instrument = Spectroradiometer {
        first_nm: 380.0,
        last_nm: 780.0,
        step_nm: options.step_nm.unwrap_or(2.0),
        bandwidth_nm: options.bandwidth_nm.unwrap_or(8.0),
        noise_floor: options.noise_floor.unwrap_or(5e-7),
        dynamic_range: options.dynamic_range.unwrap_or(1e4),
        stray_light: 1e-5,
        readings: options.readings.unwrap_or(1),
        filter,
    };
    instrument.validate().map_err(|problem| {
        CliError::Input(format!("{}: {}", options.typed(&problem.field), problem.message))
    })?;
    let prediction = predict(&sample)?;
    let radiance = Spectrum::<Radiance>::new(sample.grid.clone(), prediction.radiance.total)
        .map_err(|error| CliError::Failed(error.to_string()))?;
    Ok(vec![SpectroradiometerReading {
        name: "spectroradiometer".into(),
        capture: "sample".into(),
        target: "the flat sample".into(),
        pixels: 0.0,
        reading: instrument.read(&radiance, options.seed, "spectroradiometer"),
    }])
}

fn csv(readings: &[SpectroradiometerReading]) -> String {
    let mut text = format!(
        "# {WRITTEN_BY}; radiance in W/(sr m2 nm); expected: behind filter and slit; reading: with stray light and noise\n\
         instrument,capture,wavelength_nm,expected,reading,standard_deviation\n"
    );
    for r in readings {
        let [name, capture] = [&r.name, &r.capture].map(|text| quoted_csv_cell(text));
        let rows = r.reading.wavelength_nm.iter().zip(&r.reading.expected).zip(&r.reading.reading);
        for ((nm, expected), reading) in rows {
            let deviation = r.reading.standard_deviation;
            text += &format!("{name},{capture},{nm},{expected:e},{reading:e},{deviation:e}\n");
        }
    }
    text
}

fn plot(readings: &[SpectroradiometerReading]) -> fluorspar_report::Figure {
    let curves: Vec<PlotCurve> = readings
        .iter()
        .map(|r| {
            let name = format!("{}, {}", r.name, r.capture);
            PlotCurve::new(name, r.reading.wavelength_nm.clone(), r.reading.reading.clone())
        })
        .collect();
    spectral_readings("Spectroradiometer readings", &curves)
}

fn describe(readings: &[SpectroradiometerReading]) -> String {
    let mut text = String::new();
    for r in readings {
        text += &format!("{}: {}, lights of \"{}\"\n", r.name, r.target, r.capture);
        let sd = r.reading.standard_deviation;
        let mut rows = vec![["nm", "W/(sr m2 nm)", "sd", "signal/noise"].map(String::from).to_vec()];
        // A row every 20 nm: the rest is in --json and --out.
        let mut next = f64::NEG_INFINITY;
        for (nm, value) in r.reading.wavelength_nm.iter().zip(&r.reading.reading) {
            if *nm >= next {
                next = nm + 20.0 - 1e-9;
                let ratio = if sd > 0.0 { short(value / sd) } else { "-".into() };
                rows.push(vec![short(*nm), format!("{value:.3e}"), format!("{sd:.1e}"), ratio]);
            }
        }
        text += &format!("{}\n", align(&rows, &[]));
    }
    text
}
