//! Context of all steps of resolving: sources of values, warnings, files that were read.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::record::InputFile;
use crate::document::tree::Document;
use crate::error::{ExperimentError, Message, PathsFrom, Place, Step};
use crate::preset::{self, PresetError, PresetKind};
use crate::schema::{ExposureTime, FilePath, NameOrFile};
use fluorspar::digest::sha256_hex;
use fluorspar::quote::excerpt_to;
use fluorspar::sensor::{AutoExposure, EXPOSURE_MS};
use fluorspar::spectral::{Curve, Fluorophore, WavelengthGrid};
use fluorspar::tissue::{Site, TissueState};
use fluorspar::units::{counted, number_text};
use fluorspar::warning::Warning;
use fluorspar_anatomy::{MouthParameters, Tissue};
use fluorspar_format::digest_bounded;

/// Lengths and distances, mm: from a nanometer to the largest coordinate.
pub(crate) const LENGTH_MM: [f64; 2] = [1e-6, LARGEST_MM];
/// Factors on lengths, and millimeters per unit of a file.
pub(crate) const SCALE: [f64; 2] = [1e-6, 1e6];
/// Radiances, W/(sr m²), irradiances, W/m², powers, mW, and factors on them: far beyond any light on both sides, and so that
/// the squares of what a pixel sees are numbers in single precision.
pub(crate) const STRENGTH: [f64; 2] = [1e-12, 1e12];
/// Largest file that an experiment names, bytes; its reader sets lower limits.
const MAX_INPUT_BYTES: u64 = 16 << 30;
/// Largest coordinate, mm.
const LARGEST_MM: f64 = 1e7;

/// A fluorophore that tissue may hold, and the digest of its spectra.
#[derive(Clone, Debug)]
pub(crate) struct KnownFluorophore {
    pub(super) fluorophore: Arc<Fluorophore>,
    pub(super) sha256: String,
}

/// Sections whose files decide frames, not the image that is rendered: a finished render takes others.
const OF_FRAMES: [&str; 10] = [
    "analysis",
    "capture",
    "concentration",
    "develop",
    "lens",
    "safety",
    "sensor",
    "spectroradiometer",
    "target",
    "view_filter",
];

/// Share of a light's power that may lie beyond the data of a viewing filter: fluorescence is about as much.
const UNKNOWN_SHARE: f64 = 1e-3;

/// Whether a grid sees more of a range of wavelengths, nm, than half a usual bin.
pub(super) fn is_seen([from, to]: [f64; 2], grid: &WavelengthGrid) -> bool {
    const TOLERANCE_NM: f64 = 5.0;
    to.min(grid.end_nm()) - from.max(grid.start_nm()) > TOLERANCE_NM
}

pub(crate) struct Context<'a> {
    pub(crate) document: &'a Document,
    pub(crate) warnings: Vec<Warning>,
    /// Spectra that the wavelengths of the experiment exceed: what each is called, and the range that it holds over.
    exceeded: Vec<(String, [f64; 2])>,
    /// Viewing filters of files, and the range that their data cover, nm.
    filter_data: Vec<(Place, [f64; 2])>,
    pub(crate) inputs: Vec<InputFile>,
    /// Digests that the experiment holds of files.
    pub(super) known_files: BTreeMap<String, String>,
    /// Those of the inputs that decide a render, by what `[files]` calls them: a path, or an entry of the user's catalogue, which may lie
    /// anywhere.
    pub(super) render_files: BTreeMap<String, PathBuf>,
    /// Entries of the catalogue in use, with the digest of their files.
    pub(crate) presets: BTreeMap<String, String>,
    /// The mouth, for maps of its anatomy.
    pub(crate) mouth: Option<MouthParameters>,
    /// The only tissue that uses the material that is being resolved.
    pub(crate) tissue: Option<Tissue>,
    /// Fluorophores that layered tissue may hold, as far as they were looked for.
    pub(super) emitters: Vec<KnownFluorophore>,
}

pub(crate) type Resolved<T> = Result<T, ExperimentError>;

impl<'a> Context<'a> {
    pub(crate) fn new(document: &'a Document) -> Self {
        Self {
            document,
            warnings: Vec::new(),
            mouth: None,
            tissue: None,
            emitters: Vec::new(),
            exceeded: Vec::new(),
            filter_data: Vec::new(),
            inputs: Vec::new(),
            known_files: BTreeMap::new(),
            render_files: BTreeMap::new(),
            presets: BTreeMap::new(),
        }
    }

    pub(crate) fn error(&self, at: &[Step], message: impl Into<Message>) -> ExperimentError {
        self.document.error(at, message)
    }

    pub(crate) fn fail<T>(&self, at: &[Step], message: impl Into<Message>) -> Resolved<T> {
        Err(self.error(at, message))
    }

    /// Adds a warning that names its place.
    pub(crate) fn warn(&mut self, at: &[Step], message: impl Into<Message>) {
        let place = self.document.error(at, message).without_value();
        self.push_warning(place.to_string());
    }

    pub(crate) fn push_warning(&mut self, warning: impl Into<Warning>) {
        let warning = warning.into();
        if !self.warnings.contains(&warning) {
            self.warnings.push(warning);
        }
    }

    /// Notes the range that the data of a viewing filter cover, nm.
    pub(crate) fn note_filter_data(&mut self, at: &Place, (first, last): (f64, f64)) {
        self.filter_data.push((at.clone(), [first, last]));
    }

    /// Refuses viewing filters that say nothing of wavelengths at which a light shines: a gap in the data is no blocking.
    pub(crate) fn check_filter_data<'c>(
        &self,
        lights: impl IntoIterator<Item = &'c Curve>,
        grid: &WavelengthGrid,
    ) -> Resolved<()> {
        let (start, end) = (grid.start_nm(), grid.end_nm());
        for light in lights {
            let total = light.integral(start, end);
            for (at, [first, last]) in &self.filter_data {
                let sides = [
                    ("below", *first, light.integral(start, *first)),
                    ("above", *last, light.integral(*last, end)),
                ];
                for (side, nm, power) in sides {
                    if power > UNKNOWN_SHARE * total {
                        let message = format!(
                            "the file has no data {side} {nm} nm, where {:.2} % of a light's power is: what passes there is not known. \
                             Give a table that reaches there, or what passes beyond it: {{ csv = \"FILE\", outside = 0.0 }}",
                            100.0 * power / total
                        );
                        return self.fail(at, message);
                    }
                }
            }
        }
        Ok(())
    }

    /// Notes a spectrum where the grid reaches beyond its data by more than half a usual bin.
    pub(crate) fn note_range(&mut self, at: &[Step], [first, last]: [f64; 2], grid: &WavelengthGrid) {
        if !is_seen([f64::NEG_INFINITY, first], grid) && !is_seen([last, f64::INFINITY], grid) {
            return;
        }
        let place = self.document.error(at, "").0;
        let parts = [place.entry, place.field, place.value];
        let what = parts.into_iter().flatten().collect::<Vec<_>>().join(" ");
        self.note_exceeded(what, [first, last], grid);
    }

    /// Notes a spectrum, in words, whose data end within the grid.
    pub(crate) fn note_exceeded(&mut self, what: String, [first, last]: [f64; 2], grid: &WavelengthGrid) {
        let range = [first.max(grid.start_nm()), last.min(grid.end_nm())];
        if !self.exceeded.contains(&(what.clone(), range)) {
            self.exceeded.push((what, range));
        }
    }

    /// All warnings, those of one cause together.
    pub(crate) fn take_warnings(&mut self, grid: &WavelengthGrid) -> Vec<Warning> {
        let exceeded = std::mem::take(&mut self.exceeded);
        if !exceeded.is_empty() {
            let list: Vec<String> =
                exceeded.iter().map(|(what, [from, to])| format!("{what} ({from} to {to} nm)")).collect();
            let (start, end) = (grid.start_nm(), grid.end_nm());
            let text = format!(
                "the wavelengths of the experiment run from {start} to {end} nm; beyond their own range these spectra are \
                 extrapolated or taken as zero: {}",
                list.join("; ")
            );
            let spectra = counted(list.len(), "spectrum", "spectra");
            let verb = if list.len() == 1 { "is" } else { "are" };
            let summary = format!(
                "{spectra} {verb} extrapolated or taken as zero beyond the data, within {start} to {end} nm"
            );
            self.push_warning(Warning::summarized(text, summary));
        }
        std::mem::take(&mut self.warnings)
    }

    /// Takes over what another context has noted.
    pub(crate) fn absorb(&mut self, other: Context<'_>) {
        let is_new = |input: &InputFile| !self.inputs.iter().any(|known| known.path == input.path);
        self.inputs.extend(other.inputs.into_iter().filter(is_new).collect::<Vec<_>>());
        self.render_files.extend(other.render_files);
        self.presets.extend(other.presets);
        for exceeded in other.exceeded {
            if !self.exceeded.contains(&exceeded) {
                self.exceeded.push(exceeded);
            }
        }
        other.warnings.into_iter().for_each(|warning| self.push_warning(warning));
    }

    /// The number of a name among those that there are; `what` is wrong with any other.
    pub(crate) fn known<'n>(
        &self,
        at: &[Step],
        name: &str,
        known: impl IntoIterator<Item = &'n str>,
        what: &str,
    ) -> Resolved<usize> {
        let known: Vec<&str> = known.into_iter().collect();
        match known.iter().position(|other| *other == name) {
            Some(number) => Ok(number),
            None => self.fail(at, Message::unknown(what, name, known)),
        }
    }

    /// Checks that all names of a list are among those that there are.
    pub(crate) fn check_names<'n>(
        &self,
        at: &Place,
        names: &[String],
        known: impl Iterator<Item = &'n str> + Clone,
        what: &str,
    ) -> Resolved<()> {
        let mut places = names.iter().enumerate();
        places.try_for_each(|(index, name)| self.known(&at.index(index), name, known.clone(), what).map(drop))
    }

    /// Checks a range, ends included; NaN is outside.
    pub(crate) fn within(&self, at: &[Step], value: f64, [low, high]: [f64; 2], unit: &str) -> Resolved<f64> {
        if (low..=high).contains(&value) {
            return Ok(value);
        }
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        self.fail(at, format!("must be between {} and {}{unit}", number_text(low), number_text(high)))
    }

    pub(crate) fn whole_within(&self, at: &[Step], value: u64, [low, high]: [u64; 2]) -> Resolved<u64> {
        if (low..=high).contains(&value) {
            return Ok(value);
        }
        self.fail(at, format!("must be a whole number between {low} and {high}"))
    }

    /// A point or displacement of the file, mm, in meters.
    pub(crate) fn meters(&self, at: &[Step], value_mm: [f64; 3]) -> Resolved<Vec3> {
        if value_mm.iter().all(|v| v.abs() <= LARGEST_MM) {
            return Ok((DVec3::from_array(value_mm) * 1e-3).as_vec3());
        }
        self.fail(at, "every coordinate must be a number between -1e7 and 1e7 millimeters")
    }

    /// A direction of any length.
    pub(crate) fn direction(&self, at: &[Step], value: [f64; 3]) -> Resolved<Vec3> {
        match DVec3::from_array(value).try_normalize() {
            Some(unit) => Ok(unit.as_vec3()),
            None => self.fail(at, "invalid direction; give three finite numbers that are not all zero"),
        }
    }

    /// Digest of a file, noted as an input of the experiment.
    pub(crate) fn note_input(&mut self, at: &[Step], file: &FilePath) -> Resolved<()> {
        let file: &Path = file.as_ref();
        if let Some(known) = self.inputs.iter().find(|input| input.path == file).cloned() {
            // What a frame uses may decide the render, too
            return self.note_digest(at, name_of(file), known);
        }
        let sha256 = match digest_bounded(file, MAX_INPUT_BYTES) {
            Ok(sha256) => sha256,
            Err(error) if error.is_not_found() => {
                let mut error = self.error(at, "there is no such file");
                if error.details().value.is_none() {
                    // A table that names it
                    error = self.error(
                        at,
                        format!("there is no file \"{}\"", excerpt_to(&file.to_string_lossy(), 400)),
                    );
                }
                let from = match error.details().blamed_override {
                    Some(_) => PathsFrom::WorkingFolder,
                    None => PathsFrom::ExperimentFile,
                };
                return Err(error.with_paths_from(from));
            }
            Err(error) => return self.fail(at, error.problem().to_string()),
        };
        self.note_digest(at, name_of(file), InputFile { path: file.into(), sha256 })
    }

    /// Notes a file, and whether it decides a render; refuses one that does and has changed since results were made from it.
    fn note_digest(&mut self, at: &[Step], name: String, input: InputFile) -> Resolved<()> {
        let InputFile { path: file, sha256 } = &input;
        if !self.inputs.contains(&input) {
            self.inputs.push(input.clone());
        }
        if matches!(at.first(), Some(Step::Key(section)) if OF_FRAMES.contains(&section.as_str())) {
            return Ok(());
        }
        let folders: Vec<&Path> =
            self.document.sources.iter().filter_map(|of| of.folder.as_deref()).collect();
        let is_it = |path: &Path| {
            path == Path::new(&name)
                || path.is_relative() && folders.iter().any(|folder| folder.join(path) == *file)
        };
        if self.known_files.iter().any(|(path, known)| is_it(Path::new(path)) && known != sha256) {
            let name = excerpt_to(&file.to_string_lossy(), 400);
            let message = format!(
                "{name} has changed since: this was made from another one. Bring that back, or take the new one with --unset files \
                 and render anew"
            );
            return self.fail(at, message);
        }
        self.render_files.insert(name, input.path);
        Ok(())
    }

    /// Notes an entry of the catalogue as an input.
    pub(crate) fn note_preset(&mut self, what: &str, name: &str, content: &impl serde::Serialize) {
        let text = serde_json::to_string(content).unwrap_or_default();
        self.presets.insert(format!("{what} {name}"), sha256_hex([text]));
    }

    /// Notes the file of an entry, where it is of the user's catalogue.
    pub(super) fn note_entry(&mut self, at: &[Step], kind: PresetKind, name: &str) -> Resolved<()> {
        preset::user_entry(kind, name).map_or(Ok(()), |entry| {
            let input = InputFile { path: entry.file.clone(), sha256: entry.sha256.clone() };
            self.note_digest(at, format!("catalogue/{}/{name}", kind.folder()), input)
        })
    }

    /// A tissue site of the catalogue or of a file, noted as an input.
    pub(crate) fn site(&mut self, at: &[Step], reference: &NameOrFile) -> Resolved<Site> {
        if let NameOrFile::File(path) = reference {
            self.note_input(at, path)?;
        }
        let name = reference.as_str();
        let site = preset::site_or_file(name).map_err(|error| match &error {
            PresetError::User { message, .. } => self.error(at, message.as_str()),
            _ => self.error(at, error),
        })?;
        if let NameOrFile::Name(name) = reference {
            self.note_site(at, name, &site)?;
        }
        Ok(site)
    }

    /// Notes a tissue site of the catalogue as an input.
    pub(super) fn note_site(&mut self, at: &[Step], name: &str, site: &Site) -> Resolved<()> {
        // Debug text of finite numbers is exact: it reads back to the same bits.
        self.note_preset("site", name, &format!("{site:?}"));
        self.note_entry(at, PresetKind::Site, name)
    }

    /// A state of tissue of the catalogue, noted as an input.
    pub(crate) fn state(&mut self, at: &[Step], name: &str) -> Resolved<TissueState> {
        let state = preset::state(name).map_err(|error| self.error(at, error))?;
        self.note_preset("state", name, &format!("{state:?}"));
        self.note_entry(at, PresetKind::State, name)?;
        Ok(state)
    }

    /// SHA-256 of a file and of the entries of the catalogue that it uses, as hexadecimal text. Paths count by the content of
    /// their files: the same experiment elsewhere is the same experiment.
    pub(crate) fn digest(&self, file: &impl serde::Serialize) -> Result<String, toml::ser::Error> {
        let mut value = toml::Value::try_from(file)?;
        replace_paths(&mut value, &self.inputs);
        let text = toml::to_string(&value)?;
        let presets = self.presets.iter().map(|(name, preset)| format!("\n{name} {preset}"));
        Ok(sha256_hex(std::iter::once(text).chain(presets)))
    }

    /// Complete sections as the text of a file, and the digest of the same without what decides no result, which `strip` takes away.
    pub(crate) fn write_out<T: serde::Serialize>(
        &self,
        mut file: T,
        strip: impl FnOnce(&mut T),
    ) -> Resolved<(String, String)> {
        let failed =
            |error: toml::ser::Error| self.error(&[], format!("what was read can't be written out: {error}"));
        let text = crate::file_text(&file).map_err(failed)?;
        strip(&mut file);
        Ok((text, self.digest(&file).map_err(failed)?))
    }

    /// Exposure time, ms, or the rule that finds it.
    pub(crate) fn exposure(
        &self,
        at: &[Step],
        time: ExposureTime,
        rule: AutoExposure,
    ) -> Resolved<(Option<f64>, Option<AutoExposure>)> {
        match time {
            ExposureTime::Auto => Ok((None, Some(rule))),
            ExposureTime::Milliseconds(value) => {
                Ok((Some(self.within(at, value, EXPOSURE_MS, "milliseconds")?), None))
            }
        }
    }
}

/// Replaces each path of a file that was read by the digest of that file.
fn replace_paths(value: &mut toml::Value, inputs: &[InputFile]) {
    match value {
        toml::Value::String(text) => {
            if let Some(input) = inputs.iter().find(|input| input.path.as_os_str() == text.as_str()) {
                *text = format!("sha256:{}", input.sha256);
            }
        }
        toml::Value::Array(items) => items.iter_mut().for_each(|item| replace_paths(item, inputs)),
        toml::Value::Table(table) => table.iter_mut().for_each(|(_, item)| replace_paths(item, inputs)),
        _ => {}
    }
}

impl Context<'_> {
    /// Checks that an entry of a list has a name, and one of its own.
    pub(crate) fn unique_name<'n>(
        &self,
        at: &Place,
        name: &str,
        earlier: impl IntoIterator<Item = &'n str>,
    ) -> Resolved<()> {
        let at = at.field("name");
        if name.trim().is_empty() {
            return self.fail(&at, "must not be empty");
        }
        if earlier.into_iter().any(|other| other == name) {
            return self.fail(&at, "an earlier entry has this name; every entry needs its own");
        }
        Ok(())
    }
}

/// What `[files]` calls a file.
fn name_of(file: &Path) -> String {
    file.to_string_lossy().into_owned()
}
