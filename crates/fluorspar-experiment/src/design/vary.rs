//! What a design may choose: fields of its experiment, and their values.

use std::path::{Path, PathBuf};

use fluorspar::design::{LongPass, LongPassEdge};
use fluorspar::spectral::{MAX_WAVELENGTH_NM, MIN_WAVELENGTH_NM};
use fluorspar_format::{read_text_bounded, read_toml};
use toml::Value;

use super::schema::{IdealBandsSection, LedSeriesSection, LongPassSection, VarySection};
use crate::change::scene_change::SceneChange;
use crate::change::scene_path::ScenePath;
use crate::document::tree::{Content, Document};
use crate::error::{Place, steps};
use crate::part_file::sensor::parse_sensor;
use crate::read::{Experiment, change_document, experiment_schema, finish_document, typed};
use crate::resolve::context::{Context, Resolved};
use crate::resolve::{Setup, setup};
use crate::schema::NameOrTable;

pub(super) const WAVELENGTH_NM: [f64; 2] = [MIN_WAVELENGTH_NM, MAX_WAVELENGTH_NM];
pub(super) const PRICE: [f64; 2] = [0.0, 1e12];
/// Largest sensor file, bytes.
const MOST_SENSOR_BYTES: u64 = 1 << 20;

/// Sections of an experiment that no design looks at.
pub(super) const UNUSED: [&str; 7] =
    ["capture", "motion", "develop", "spectroradiometer", "analysis", "target", "output"];
/// Sections that only rendered regions look at.
pub(super) const OF_SCENE: [&str; 4] = ["render", "mouth", "object", "material"];
/// Fields of a light that decide what it sends; the others decide where it is.
const OF_SPECTRUM: [&str; 4] = ["spectrum", "filters", "filter_angle_deg", "strength"];
/// Fields of the viewing filter that a design looks at.
const OF_FILTER: [&str; 3] = ["filters", "angle_deg", "effective_index"];

/// What a variable chooses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Axis {
    Light,
    Filter,
    Sensor,
    Aperture,
    /// What rendered regions show.
    Geometry,
}

/// A value of a variable, or one of each of several variables.
#[derive(Clone, Debug, Default)]
pub(super) struct Choice {
    pub(super) name: String,
    pub(super) cost: f64,
    /// A long-pass edge behind the viewing filters of the experiment.
    pub(super) long_pass: Option<LongPass>,
    pub(super) changes: Vec<SceneChange>,
    /// Number of the variable.
    pub(super) variable: usize,
}

/// The experiment of a design, which choices change.
pub(super) struct Base {
    /// Its tree, without the question.
    pub(super) document: Document,
    /// Where relative paths of changes start.
    pub(super) folder: PathBuf,
    /// The first choice along each axis.
    pub(super) first: Vec<(Axis, Choice)>,
    /// Names of the lights that a design uses.
    pub(super) lights: Vec<String>,
}

impl Base {
    /// The experiment with some changes.
    pub(super) fn experiment(&self, changes: &[SceneChange]) -> Resolved<Experiment> {
        typed_experiment(self.changed(changes)?)
    }

    /// Its tree with some changes, before what has a short form is spelled out.
    fn changed(&self, changes: &[SceneChange]) -> Resolved<Document> {
        let mut document = self.document.clone();
        change_document(&mut document, experiment_schema(), changes, &self.folder)?;
        Ok(document)
    }

    /// The experiment of a scene: without a sensor of its own it has the first that may be chosen.
    pub(super) fn scene(&self, changes: &[SceneChange]) -> Resolved<Experiment> {
        let has_sensor = self.document.root.get("sensor").is_some();
        let sensor = self.first.iter().filter(|(axis, _)| *axis == Axis::Sensor && !has_sensor);
        let sensor = sensor.flat_map(|(_, choice)| choice.changes.clone());
        self.experiment(&sensor.chain(changes.iter().cloned()).collect::<Vec<_>>())
    }

    /// Camera and lights of a design: those of a choice along an axis, and the first along all others.
    pub(super) fn setup(&self, context: &mut Context<'_>, axis: Axis, choice: &Choice) -> Resolved<Setup> {
        let others = self.first.iter().filter(|(other, _)| *other != axis).map(|(_, choice)| choice);
        let changes: Vec<SceneChange> =
            others.chain([choice]).flat_map(|choice| choice.changes.iter().cloned()).collect();
        let found = self.changed(&changes).and_then(|mut document| {
            if let Some(Content::Array(lights)) = document.root.get_mut("light").map(|node| &mut node.content)
            {
                lights.retain(|light| self.lights.iter().any(|used| light.name() == Some(used)));
            }
            let experiment = typed_experiment(document)?;
            let mut own = Context::new(&experiment.document);
            let found = setup(&mut own, &experiment.file)?;
            context.absorb(own);
            Ok(found)
        });
        found.or_else(|error| {
            if changes.is_empty() {
                return Err(error);
            }
            let details = error.details();
            let parts = [Some(&choice.name).filter(|name| !name.is_empty()), details.path.as_ref()];
            let parts = parts.into_iter().flatten().chain([&details.message]).cloned();
            context.fail(&steps!["vary", choice.variable, "values"], parts.collect::<Vec<_>>().join(": "))
        })
    }

    /// What the experiment says at a path, in words.
    pub(super) fn words(&self, path: &str) -> Option<String> {
        let mut keys = path.split('.');
        name_of(&keys.try_fold(&self.document.root, |node, key| node.get(key))?.to_value())
    }
}

/// A tree as an experiment.
fn typed_experiment(mut document: Document) -> Resolved<Experiment> {
    finish_document(&mut document, experiment_schema())?;
    let file = typed(&mut document, experiment_schema())?;
    Ok(Experiment { file, document })
}

/// What may be chosen along each axis, in the order of the file.
#[derive(Default)]
pub(super) struct Variables {
    axes: Vec<(Axis, Vec<Choice>)>,
    /// Names of the lights that are designed.
    pub(super) lights: Vec<String>,
}

impl Variables {
    /// The first choice along each axis that has one.
    pub(super) fn first(&self) -> Vec<(Axis, Choice)> {
        self.axes.iter().map(|(axis, choices)| (*axis, choices[0].clone())).collect()
    }

    /// The choices along an axis; one without a change, of this name, where nothing may be chosen.
    pub(super) fn along(&self, axis: Axis, name: &str) -> Vec<Choice> {
        let found = self.axes.iter().find(|(own, _)| *own == axis).map(|(_, choices)| choices.clone());
        found.unwrap_or_else(|| vec![Choice { name: name.into(), ..Choice::default() }])
    }

    /// Refuses choices along an axis that all come to the same, but for their names and prices.
    pub(super) fn check_effect<T: PartialEq>(
        &self,
        context: &Context<'_>,
        axis: Axis,
        found: impl IntoIterator<Item = T>,
    ) -> Resolved<()> {
        let (mut found, own) = (found.into_iter(), self.along(axis, ""));
        let first = found.next();
        if own.len() < 2 || found.any(|other| Some(&other) != first.as_ref()) {
            return Ok(());
        }
        let message = "none of the values changes anything that a design looks at; choose another field";
        context.fail(&steps!["vary", own[0].variable, "field"], message)
    }

    /// Reads the variables of a file.
    pub(super) fn read(context: &Context<'_>, sections: &[VarySection]) -> Resolved<Self> {
        let mut found = Self::default();
        for (index, section) in sections.iter().enumerate() {
            let at = steps!["vary", index];
            let (axis, path, values) = Variable { context, section, at: &at, index }.read()?;
            if axis == Axis::Light {
                found.lights.push(path[1].clone());
            }
            let Some((_, choices)) = found.axes.iter_mut().find(|(own, _)| *own == axis) else {
                found.axes.push((axis, values));
                continue;
            };
            let both = |a: &Choice, b: &Choice| Choice {
                name: format!("{}, {}", a.name, b.name),
                cost: a.cost + b.cost,
                long_pass: b.long_pass.or(a.long_pass),
                changes: a.changes.iter().chain(&b.changes).cloned().collect(),
                variable: a.variable,
            };
            *choices = choices.iter().flat_map(|a| values.iter().map(move |b| both(a, b))).collect();
        }
        Ok(found)
    }
}

/// A variable that is being read.
struct Variable<'a> {
    context: &'a Context<'a>,
    section: &'a VarySection,
    at: &'a Place,
    index: usize,
}

impl Variable<'_> {
    fn fail<T>(&self, field: &str, message: impl Into<String>) -> Resolved<T> {
        self.context.fail(&self.at.field(field), message.into())
    }

    /// The axis, the steps of the field, and the values.
    fn read(&self) -> Resolved<(Axis, Vec<String>, Vec<Choice>)> {
        let section = self.section;
        let path = match ScenePath::read(&section.field, &self.context.document.sources[0]) {
            Ok((ScenePath { part: None, steps }, None)) => steps,
            _ => return self.fail("field", "give the path of a field, such as light.blue.spectrum"),
        };
        let path: Vec<String> = path.into_iter().map(|step| step.text).collect();
        let axis = axis(&path, &section.values).or_else(|message| self.fail("field", message))?;
        let label = section.name.as_ref().or(path.last()).cloned().unwrap_or_default();
        let mut list: Vec<Choice> = Vec::new();
        // A section or an entry keeps the fields that a value does not give
        let is_section =
            path.len() == if ["light", "object", "material"].contains(&&*path[0]) { 2 } else { 1 };
        for value in &section.values {
            let changes = match value {
                Value::Table(fields) if is_section => fields
                    .iter()
                    .map(|(key, value)| self.set(&format!(".{key}"), value.to_string()))
                    .collect(),
                value => vec![self.set("", value.to_string())],
            };
            let name = name_of(value).unwrap_or_else(|| format!("{label} {value}"));
            list.push(Choice { name, changes, ..Choice::default() });
        }
        let generated = [
            (
                section.led.is_some(),
                axis == Axis::Light && path.len() == 2,
                "LEDs are values of a light, such as light.blue",
            ),
            (section.long_pass.is_some(), axis == Axis::Filter, "long-pass edges are values of view_filter"),
            (
                !section.bands.is_empty() || !section.sensor_files.is_empty(),
                axis == Axis::Sensor && path.len() == 1,
                "bands and files are values of sensor",
            ),
        ];
        if let Some((.., message)) = generated.iter().find(|(is_given, fits, _)| *is_given && !fits) {
            return self.fail("field", *message);
        }
        if let Some(series) = &section.led {
            list.extend(self.leds(series)?);
        }
        if let Some(series) = &section.long_pass {
            list.extend(self.long_passes(&label, series)?);
        }
        for (number, bands) in section.bands.iter().enumerate() {
            list.push(self.ideal_bands(bands, &self.at.field("bands").index(number))?);
        }
        for (number, file) in section.sensor_files.iter().enumerate() {
            list.push(self.sensor_of(file.as_ref(), &self.at.field("sensor_files").index(number))?);
        }
        if list.is_empty() {
            return self.fail("values", "give at least one value");
        }
        Ok((axis, path, self.named(list)?))
    }

    /// The change that sets the field, or one below it.
    fn set(&self, below: &str, value: String) -> SceneChange {
        SceneChange::Set { path: format!("{}{below}", self.section.field), value }
    }

    /// Values with their names and prices.
    fn named(&self, mut list: Vec<Choice>) -> Resolved<Vec<Choice>> {
        let (names, costs, count) = (&self.section.names, &self.section.costs, list.len());
        if !names.is_empty() && names.len() != count {
            return self.fail("names", format!("give one name for each of the {count} values"));
        }
        if costs.len() > 1 && costs.len() != count {
            return self
                .fail("costs", format!("give one price for all, or one for each of the {count} values"));
        }
        for (number, choice) in list.iter_mut().enumerate() {
            choice.variable = self.index;
            choice.name = names.get(number).unwrap_or(&choice.name).clone();
            let cost = costs.get(number).or(costs.first()).copied().unwrap_or_default();
            choice.cost = self.context.within(&self.at.field("costs"), cost, PRICE, "")?;
        }
        let name = |number: usize| &list[number].name;
        if let Some(twin) = (0..count).find(|&k| (0..k).any(|other| name(other) == name(k))) {
            let message = format!("two values are called \"{}\"; give each a name of its own", name(twin));
            return self.fail("names", message);
        }
        Ok(list)
    }

    fn leds(&self, series: &LedSeriesSection) -> Resolved<Vec<Choice>> {
        let at = self.at.field("led");
        let width = self.context.within(&at.field("fwhm_nm"), series.fwhm_nm, [1.0, 100.0], "nm")?;
        let led = |(index, &peak_nm): (usize, &f64)| {
            self.context.within(&at.field("peaks_nm").index(index), peak_nm, [250.0, 1100.0], "nm")?;
            let spectrum = format!(
                "{{ type = \"led\", peak_nm = {peak_nm:?}, fwhm_short_nm = {width:?}, fwhm_long_nm = {width:?} }}"
            );
            let mut changes = vec![self.set(".spectrum", spectrum)];
            if let Some(after_nm) = series.short_pass_after_peak_nm {
                let at = at.field("short_pass_after_peak_nm");
                let cut_nm = peak_nm + self.context.within(&at, after_nm, [1.0, 200.0], "nm")?;
                let filters = format!(
                    "[{{ type = \"edges\", peak = 1.0, optical_density = 5.0, edges = [{{ pass = \"short\", cut_nm = {cut_nm:?}, \
                     width_nm = 5.0 }}] }}]"
                );
                changes.push(self.set(".filters", filters));
            }
            Ok(Choice { name: format!("{peak_nm} nm"), changes, ..Choice::default() })
        };
        series.peaks_nm.iter().enumerate().map(led).collect()
    }

    fn long_passes(&self, label: &str, series: &LongPassSection) -> Resolved<Vec<Choice>> {
        let within = |field: &str, value: f64, range: [f64; 2], unit: &str| {
            self.context.within(&self.at.field("long_pass").field(field), value, range, unit)
        };
        let width_nm = within("width_nm", series.width_nm, [0.1, 100.0], "nm")?;
        let optical_density = within("optical_density", series.optical_density, [0.0, 12.0], "")?;
        let choice = |name: String, edge: LongPassEdge| {
            let long_pass = Some(LongPass { edge, width_nm, optical_density });
            Choice { name, long_pass, ..Choice::default() }
        };
        let fixed = series.edges_nm.iter().map(|&nm| {
            within("edges_nm", nm, WAVELENGTH_NM, "nm")?;
            Ok(choice(format!("{label} {nm} nm"), LongPassEdge::At(nm)))
        });
        let following = series.after_peak_nm.iter().map(|&nm| {
            within("after_peak_nm", nm, [0.0, 400.0], "nm")?;
            Ok(choice(format!("{label} peak + {nm} nm"), LongPassEdge::AfterPeak(nm)))
        });
        fixed.chain(following).collect()
    }

    /// A sensor of Gaussian bands with read noise and nothing else.
    fn ideal_bands(&self, section: &IdealBandsSection, at: &Place) -> Resolved<Choice> {
        let (centers, sigmas) = (&section.centers_nm, &section.sigma_nm);
        if centers.is_empty() || ![1, centers.len()].contains(&sigmas.len()) {
            let message = "give centers, and one width for all bands or one for each";
            return self.context.fail(&at.field("sigma_nm"), message);
        }
        let names: Vec<String> = centers.iter().map(f64::to_string).collect();
        let curve = |(number, name): (usize, &String)| {
            let sigma_nm = sigmas.get(number).unwrap_or(&sigmas[0]);
            let fwhm_nm = 2.0 * sigma_nm * (2.0 * std::f64::consts::LN_2).sqrt();
            format!(
                "\"{name}\" = {{ type = \"bands\", bands = [{{ peak_nm = {:?}, fwhm_short_nm = {fwhm_nm:?}, fwhm_long_nm = {fwhm_nm:?}, \
                 weight = {:?} }}] }}",
                centers[number], section.peak
            )
        };
        let curves: Vec<String> = names.iter().enumerate().map(curve).collect();
        let text = format!(
            "{{ columns = {}, rows = 1, mosaic = [{names:?}], pixel_size_um = {:?}, fill_factor = 1.0, well_capacity_e = {:?}, \
             read_noise_e = {:?}, dsnu_e = 0.0, dark_current_e_per_s = 0.0, prnu_percent = 0.0, bit_depth = 16, black_level_dn = 0.0, \
             quantum_efficiency = {{ {} }} }}",
            names.len(),
            section.pixel_size_um,
            section.full_well_e,
            section.read_noise_e,
            curves.join(", ")
        );
        let changes = vec![self.set("", text)];
        Ok(Choice { name: format!("{} bands", names.len()), changes, ..Choice::default() })
    }

    fn sensor_of(&self, path: &Path, at: &Place) -> Resolved<Choice> {
        let text = read_text_bounded(path, MOST_SENSOR_BYTES)
            .map_err(|error| self.context.file_error(at, &error))?;
        let name = path.display().to_string();
        let read = parse_sensor(&text, &name, path.parent().unwrap_or(Path::new(".")), &[]);
        let sensor = read.map_err(|error| self.context.error(at, error.to_string()).without_value())?;
        let section = read_toml::<toml::Table>(&sensor.resolved_toml).unwrap_or_default();
        let section = section.get("sensor").map(Value::to_string).unwrap_or_default();
        Ok(Choice { name, changes: vec![self.set("", section)], ..Choice::default() })
    }
}

/// What a field chooses, or why a design does not see it.
fn axis(path: &[String], values: &[Value]) -> Result<Axis, String> {
    let path: Vec<&str> = path.iter().map(String::as_str).collect();
    match path.as_slice() {
        ["light", _, rest @ ..] => {
            let tables = || values.iter().filter_map(Value::as_table).flat_map(|table| table.keys());
            let fields: Vec<&str> = match rest {
                [field, ..] => vec![field],
                [] => tables().map(String::as_str).collect(),
            };
            match fields.iter().filter(|field| OF_SPECTRUM.contains(*field)).count() {
                0 if !fields.is_empty() => Ok(Axis::Geometry),
                all if all == fields.len() => Ok(Axis::Light),
                _ => Err(format!(
                    "the values give what the light sends ({}) and where it is; give two [[vary]]",
                    OF_SPECTRUM.join(", ")
                )),
            }
        }
        ["view_filter"] => Ok(Axis::Filter),
        ["view_filter", field, ..] if OF_FILTER.contains(field) => Ok(Axis::Filter),
        ["sensor", ..] => Ok(Axis::Sensor),
        ["lens", "f_number"] => Ok(Axis::Aperture),
        ["camera" | "mouth" | "object" | "material", ..] => Ok(Axis::Geometry),
        _ => Err(format!(
            "changes nothing that a design chooses. It chooses light.NAME (its {}), view_filter ({}), sensor, lens.f_number and, of what \
             rendered regions show, camera, mouth, object, material and the place of a light",
            OF_SPECTRUM.join(", "),
            OF_FILTER.join(", ")
        )),
    }
}

/// Relative paths in a value start at a folder.
pub(super) fn anchor(value: &mut Value, folder: &Path) {
    match value {
        Value::String(text) if NameOrTable::is_path(text) => {
            let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.into());
            *text = folder.join(&*text).to_string_lossy().into_owned();
        }
        Value::Array(items) => items.iter_mut().for_each(|item| anchor(item, folder)),
        Value::Table(fields) => fields.iter_mut().for_each(|(_, field)| anchor(field, folder)),
        _ => {}
    }
}

/// What a value says in words: its texts.
fn name_of(value: &Value) -> Option<String> {
    let parts: Vec<String> = match value {
        Value::String(text) => vec![text.clone()],
        Value::Table(fields) => fields.values().filter_map(name_of).collect(),
        Value::Array(items) => items.iter().filter_map(name_of).collect(),
        _ => Vec::new(),
    };
    (!parts.is_empty()).then(|| parts.join(" + "))
}
