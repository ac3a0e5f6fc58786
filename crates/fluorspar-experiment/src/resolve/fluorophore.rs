//! Fluorophores.

use super::context::{Context, Resolved, is_seen};
use crate::error::{Message, Place, steps};
use crate::preset::{self, PresetKind};
use crate::schema::{
    FilePath, FluorophoreSection, FluorophoreSource, MatSource, MatrixSource, SpectraSource, TableSource,
};
use fluorspar::quote::excerpt;
use fluorspar::spectral::{
    Curve, EemTable, EnergyEem, Fluorophore, PhotonEem, SeparableTerm, Stokes, WavelengthGrid, YieldDensity,
    YieldUnit,
};
use fluorspar_format::{
    ANTI_STOKES_TOLERANCE, AntiStokes, CsvEemOptions, Defect, FormatError, Negative, SpectrumColumns,
    SpectrumOptions, read_eem_csv, read_fluorophore_csv, read_iset_fluorophore, refuse_anti_stokes,
    refuse_scattered_light,
};

/// Largest concentration that is accepted.
pub(super) const MAX_CONCENTRATION: f64 = 1e6;

/// Fluorophores in use, in the order of their first use.
#[derive(Default)]
pub(crate) struct Fluorophores {
    pub(crate) list: Vec<Fluorophore>,
}

impl Fluorophores {
    /// Number of a fluorophore by name: from the sections of the file, otherwise from the catalogue.
    pub(crate) fn index(
        &mut self,
        context: &mut Context<'_>,
        at: &Place,
        sections: &[FluorophoreSection],
        name: &str,
    ) -> Resolved<usize> {
        if let Some(index) = self.list.iter().position(|fluorophore| fluorophore.name == name) {
            return Ok(index);
        }
        let fluorophore = match sections.iter().position(|section| section.name == name) {
            Some(index) => from_section(context, &steps!["fluorophore", index], &sections[index])?,
            None => {
                let Ok(preset) = preset::fluorophore(name) else {
                    return Err(unknown(context, at, sections, name));
                };
                context.note_preset("fluorophore", name, &preset);
                preset.fluorophore()
            }
        };
        self.list.push(fluorophore);
        Ok(self.list.len() - 1)
    }
}

pub(crate) fn unknown(
    context: &Context<'_>,
    at: &Place,
    sections: &[FluorophoreSection],
    name: &str,
) -> crate::ExperimentError {
    let mut known: Vec<&str> = sections.iter().map(|section| section.name.as_str()).collect();
    known.extend(preset::names(PresetKind::Fluorophore));
    known.dedup();
    context.error(at, Message::unknown(format!("there is no fluorophore \"{}\"", excerpt(name)), name, known))
}

/// Checks names and sources of the fluorophore sections, used or not.
pub(crate) fn check_sections(context: &Context<'_>, sections: &[FluorophoreSection]) -> Resolved<()> {
    for (index, section) in sections.iter().enumerate() {
        let at = steps!["fluorophore", index];
        context.unique_name(&at, &section.name, sections[..index].iter().map(|other| other.name.as_str()))?;
        if !matches!(section.source, FluorophoreSource::Catalogue(_)) && section.photon_yield.is_none() {
            let message = "a fluorophore from a file needs `photon_yield`: photons out per photon in at its best \
                           excitation, at concentration 1";
            return context.fail(&at, message);
        }
        if let Some(value) = section.photon_yield
            && !(1e-12..=1.0).contains(&value)
        {
            let at = at.field("photon_yield");
            return context.fail(&at, "must be between 1e-12 and 1 (photons out per photon in)");
        }
        if let FluorophoreSource::Catalogue(name) = &section.source
            && let Err(error) = preset::fluorophore(name)
        {
            return context.fail(&at.field("source"), error);
        }
    }
    Ok(())
}

fn from_section(
    context: &mut Context<'_>,
    at: &Place,
    section: &FluorophoreSection,
) -> Resolved<Fluorophore> {
    let at_source = at.field("source");
    let stokes = section.stokes.unwrap_or_default();
    let (eem, source) = match &section.source {
        FluorophoreSource::Catalogue(name) => return of_catalogue(context, &at_source, section, name),
        FluorophoreSource::Matrix(matrix) => (
            matrix_from_csv(context, &at_source.field("eem_csv"), matrix, (section, stokes))?,
            &matrix.eem_csv,
        ),
        FluorophoreSource::Mat(MatSource { mat, unit }) => {
            (from_mat(context, &at_source.field("mat"), mat, *unit, (section, stokes))?, mat)
        }
        FluorophoreSource::Table(TableSource { csv, unit, sample }) => {
            let at = at_source.field("csv");
            context.note_input(&at, csv)?;
            let read = read_fluorophore_csv(csv.as_ref(), negative(section), sample.as_deref())
                .map_err(|e| reader_error(context, &at, &e))?;
            if read.emission_only {
                let message = "the excitation column is constant: it was never measured. Give a measured one";
                return context.fail(&at, message);
            }
            (separable(context, &at, *unit, read.excitation, read.emission, stokes)?, csv)
        }
        FluorophoreSource::Spectra(SpectraSource { excitation_csv, emission_csv, unit }) => {
            let options = SpectrumOptions {
                columns: SpectrumColumns::One,
                negative: negative(section),
                ..SpectrumOptions::default()
            };
            let mut first = |key: &str, file: &FilePath| -> Resolved<Curve> {
                Ok(context.spectra(&at_source.field(key), file, &options)?.swap_remove(0).curve)
            };
            let excitation = first("excitation_csv", excitation_csv)?;
            let emission = first("emission_csv", emission_csv)?;
            (separable(context, at, *unit, excitation, emission, stokes)?, emission_csv)
        }
    };
    let photon_yield = section.photon_yield.unwrap_or(1e-3);
    let (excitation_range_nm, emission_range_nm) = ranges(&eem);
    let unmasked = eem.clone().with_stokes(Stokes::Off);
    let steps = ((excitation_range_nm.1 - excitation_range_nm.0).ceil() as usize).max(1);
    let best = (0..=steps)
        .map(|i| excitation_range_nm.0 + i as f64)
        .map(|nm| {
            unmasked.photon_yield(nm.min(excitation_range_nm.1), emission_range_nm.0, emission_range_nm.1)
        })
        .fold(0.0, f64::max);
    if best <= 0.0 {
        return context.fail(at, "all values of the matrix are zero. Check the file or export it again");
    }
    Ok(Fluorophore {
        name: section.name.clone(),
        title: section.title.clone().unwrap_or_else(|| section.name.clone()),
        eem: eem.scaled(photon_yield / best),
        excitation_range_nm,
        emission_range_nm,
        source: source.to_string(),
    })
}

/// A variant of a fluorophore of the catalogue.
fn of_catalogue(
    context: &mut Context<'_>,
    at: &Place,
    section: &FluorophoreSection,
    name: &str,
) -> Resolved<Fluorophore> {
    let preset = preset::fluorophore(name).map_err(|e| context.error(at, e.to_string()))?;
    context.note_preset("fluorophore", name, &preset);
    let photon_yield = section.photon_yield.unwrap_or(preset.photon_yield);
    let mut fluorophore = preset.fluorophore_with(photon_yield, section.stokes.unwrap_or(preset.stokes));
    fluorophore.name.clone_from(&section.name);
    if let Some(title) = &section.title {
        fluorophore.title.clone_from(title);
    }
    Ok(fluorophore)
}

/// Part of its peak that a measured spectrum may have at an end of its data: more is a spectrum that goes on.
const CUT_PART: f64 = 0.05;

/// Notes measured fluorophores that go on where their data end, within the wavelengths of an experiment.
pub(crate) fn note_cut_data<'a>(
    context: &mut Context<'_>,
    sections: &[FluorophoreSection],
    used: impl Iterator<Item = &'a Fluorophore>,
    grid: &WavelengthGrid,
) {
    for fluorophore in used {
        let of_file = |section: &&FluorophoreSection| {
            section.name == fluorophore.name && !matches!(section.source, FluorophoreSource::Catalogue(_))
        };
        if !sections.iter().any(|section| of_file(&section)) {
            continue;
        }
        for (which, nm, values) in profiles(&fluorophore.eem) {
            let peak = values.iter().copied().fold(0.0, f64::max);
            let ([first, .., last], [at_first, .., at_last]) = (nm.as_slice(), values.as_slice()) else {
                continue;
            };
            let cut = [(*at_first, [f64::NEG_INFINITY, *first]), (*at_last, [*last, f64::INFINITY])];
            for (value, beyond) in cut {
                let end = if beyond[0].is_finite() { *last } else { *first };
                if value > CUT_PART * peak && is_seen(beyond, grid) {
                    let percent = 100.0 * value / peak;
                    let what = format!(
                        "{which} of {}, {percent:.0} % of its peak at {end} nm",
                        excerpt(&fluorophore.name)
                    );
                    context.note_exceeded(what, [*first, *last], grid);
                }
            }
        }
    }
}

/// Excitation over all emission, and emission over all excitation, with their wavelengths.
fn profiles(eem: &PhotonEem) -> Vec<(&'static str, Vec<f64>, Vec<f64>)> {
    match eem.density() {
        YieldDensity::Table(table) => {
            let columns = table.excitation_nm.len().max(1);
            let row_sums = table.values.chunks_exact(columns).map(|row| row.iter().sum()).collect();
            let column_sum = |column| table.values.iter().skip(column).step_by(columns).sum();
            vec![
                ("excitation", table.excitation_nm.clone(), (0..columns).map(column_sum).collect()),
                ("emission", table.emission_nm.clone(), row_sums),
            ]
        }
        YieldDensity::Separable(terms) => {
            let of_term = |term: &SeparableTerm| {
                [("excitation", &term.excitation), ("emission", &term.emission)]
                    .map(|(which, curve)| (which, curve.wavelengths_nm().to_vec(), curve.values().to_vec()))
            };
            terms.iter().flat_map(of_term).collect()
        }
    }
}

fn ranges(eem: &PhotonEem) -> ((f64, f64), (f64, f64)) {
    match eem.density() {
        YieldDensity::Table(table) => {
            let ends = |axis: &[f64]| (axis[0], axis[axis.len() - 1]);
            (ends(&table.excitation_nm), ends(&table.emission_nm))
        }
        YieldDensity::Separable(terms) => terms
            .first()
            .map_or(((0.0, 0.0), (0.0, 0.0)), |term| (term.excitation.range_nm(), term.emission.range_nm())),
    }
}

fn separable(
    context: &Context<'_>,
    at: &Place,
    unit: Option<YieldUnit>,
    excitation: Curve,
    emission: Curve,
    stokes: Stokes,
) -> Resolved<PhotonEem> {
    // Y_q(lo|li) = Y_e(lo|li) lo / li, for the product of two spectra as for a matrix.
    let weighted = |curve: Curve, weight: fn(f64) -> f64| match unit {
        Some(YieldUnit::Energy) => {
            let wavelengths = curve.wavelengths_nm().to_vec();
            let values =
                curve.values().iter().zip(&wavelengths).map(|(value, nm)| value * weight(*nm)).collect();
            Curve::new(wavelengths, values).map_err(|error| context.error(at, error.to_string()))
        }
        _ => Ok(curve),
    };
    let (excitation, emission) = (weighted(excitation, |nm| 1.0 / nm)?, weighted(emission, |nm| nm)?);
    let area = emission.total();
    for (what, is_dark) in [("excitation", excitation.max() <= 0.0), ("emission", area <= 0.0)] {
        if is_dark {
            let message =
                format!("the {what} is zero at every wavelength. Check the column or export it again");
            return context.fail(at, message);
        }
    }
    let excitation = excitation.scaled(1.0 / excitation.max());
    Ok(PhotonEem::separable(
        vec![SeparableTerm { excitation, emission: emission.scaled(1.0 / area) }],
        stokes,
    ))
}

fn matrix(
    context: &Context<'_>,
    at: &Place,
    table: EemTable,
    unit: YieldUnit,
    stokes: Stokes,
) -> Resolved<PhotonEem> {
    match unit {
        YieldUnit::Photons => PhotonEem::table(table, stokes),
        YieldUnit::Energy => EnergyEem::table(table, stokes).map(|eem| eem.to_photon()),
    }
    .map_err(|error| context.error(at, error.to_string()))
}

/// What lets files pass that are refused.
const ALLOW_NEGATIVE: &str = "Subtract the background correctly, or take negative values as zero with allow_negative = true in this [[fluorophore]]";
const ALLOW_ANTI_STOKES: &str = "; allow_anti_stokes = true in this [[fluorophore]] accepts such values, and `fluorspar fluorophore import --cut-scatter NM` cuts \
     scattered light out";
const EMPTY_CELLS: &str = "; empty_cells = \"interpolate\" in this [[fluorophore]] fills them along the emission, empty_cells = \"zero\" takes them as zero";

fn negative(section: &FluorophoreSection) -> Negative {
    if section.allow_negative { Negative::ClipToZero } else { Negative::Refuse }
}

/// The error of a file with the field that lets it pass.
fn reader_error(context: &Context<'_>, at: &Place, error: &FormatError) -> crate::ExperimentError {
    let field = match error.defect() {
        Defect::Negative { .. } => {
            "; allow_negative = true in this [[fluorophore]] takes negative values as zero"
        }
        Defect::AntiStokes { .. } | Defect::ScatteredLight { .. } => ALLOW_ANTI_STOKES,
        Defect::EmptyCell { .. } => EMPTY_CELLS,
        Defect::Samples(_) => " with sample = \"NAME\" beside the file",
        _ => return context.file_error(at, error),
    };
    context.error(at, error.message_with(field)).without_value()
}

/// What to do about a matrix whose values may count photons or energy.
const UNKNOWN_UNIT: &str =
    "the file does not know what its values count; add unit = \"photons\" or \"energy\"";

fn matrix_from_csv(
    context: &mut Context<'_>,
    at: &Place,
    MatrixSource { eem_csv: file, unit, sample }: &MatrixSource,
    (section, stokes): (&FluorophoreSection, Stokes),
) -> Resolved<PhotonEem> {
    let unit = *unit;
    context.note_input(at, file)?;
    let options = CsvEemOptions {
        unit,
        anti_stokes: match section.allow_anti_stokes || stokes == Stokes::Off {
            true => AntiStokes::Keep,
            false => AntiStokes::Refuse(ANTI_STOKES_TOLERANCE),
        },
        negative: negative(section),
        empty_cells: section.empty_cells,
        cut: None,
        sample: sample.clone(),
    };
    let read = read_eem_csv(file.as_ref(), &options).map_err(|error| match (error.defect(), unit) {
        (Defect::Unit { .. }, None) => context
            .error(at, format!("{error} (unit = \"photons\" or \"energy\" beside eem_csv)"))
            .without_value(),
        _ => reader_error(context, at, &error),
    })?;
    let Some(unit) = read.unit else { return context.fail(at, UNKNOWN_UNIT) };
    if section.allow_anti_stokes
        && let Err(error) =
            refuse_scattered_light(file.as_ref(), &read.emission_nm, &read.excitation_nm, &read.values)
    {
        let message = format!(
            "accepted by allow_anti_stokes, but no fluorescence: {}; `fluorspar fluorophore import --cut-scatter NM` does so",
            error.problem()
        );
        context.warn(at, message);
    }
    if let Some(overflow) = read.overflow() {
        context.warn(at, overflow.to_string());
    }
    let table =
        EemTable { emission_nm: read.emission_nm, excitation_nm: read.excitation_nm, values: read.values };
    matrix(context, at, table, unit, stokes)
}

/// Files of isetfluorescence hold photons.
fn from_mat(
    context: &mut Context<'_>,
    at: &Place,
    file: &FilePath,
    unit: Option<YieldUnit>,
    (section, stokes): (&FluorophoreSection, Stokes),
) -> Resolved<PhotonEem> {
    context.note_input(at, file)?;
    let read = read_iset_fluorophore(file.as_ref()).map_err(|error| context.file_error(at, &error))?;
    let all = [&read.eem, &read.excitation, &read.emission];
    let lowest = all.into_iter().flatten().flatten().copied().fold(0.0, f64::min);
    if lowest < 0.0 && !section.allow_negative {
        let value = fluorspar::units::number_text(lowest);
        return context.fail(at, format!("a value is {value}, below zero. {ALLOW_NEGATIVE}"));
    }
    if let Some(values) = read.eem {
        if !section.allow_anti_stokes && stokes != Stokes::Off {
            let (path, nm) = (file.as_ref(), &read.wave_nm);
            refuse_scattered_light(path, nm, nm, &values)
                .and_then(|()| refuse_anti_stokes(path, nm, nm, &values))
                .map_err(|error| reader_error(context, at, &error))?;
        }
        let values = values.into_iter().map(|value| value.max(0.0)).collect();
        let table = EemTable { emission_nm: read.wave_nm.clone(), excitation_nm: read.wave_nm, values };
        return matrix(context, at, table, unit.unwrap_or(YieldUnit::Photons), stokes);
    }
    if read.emission_only {
        return context
            .fail(at, "the excitation is missing or constant: it was never measured. Give a measured one");
    }
    let (Some(excitation), Some(emission)) = (read.excitation, read.emission) else {
        return context.fail(at, "the file has neither a matrix nor both excitation and emission");
    };
    let curve = |values: Vec<f64>| {
        let values = values.into_iter().map(|value| value.max(0.0)).collect();
        Curve::new(read.wave_nm.clone(), values).map_err(|error| context.error(at, error.to_string()))
    };
    separable(context, at, unit, curve(excitation)?, curve(emission)?, stokes)
}
