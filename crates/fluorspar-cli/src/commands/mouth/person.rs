//! Whose mouth it is.

use fluorspar::units::number_text;
use fluorspar_anatomy::{EXAMINATION_VIEWS, ExaminationView, MouthParameters, POSES, sample_person};

use crate::error::CliError;
use crate::values;

/// Shape and pose of one mouth.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct PersonArgs {
    /// A person drawn from the population, instead of the average adult: 7 is the seventh of `mouth sample`.
    #[arg(long, value_name = "NUMBER", value_parser = parse_person, allow_negative_numbers = true)]
    pub(crate) person: Option<u32>,
    /// Change one value, a parameter of the mouth, for instance `--set tooth_scale=1.05`; see docs/mouth.md. May be repeated.
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Factor on the rows and columns of the meshes: 0.4 gives a preview of 50 000 triangles, 4 shows every papilla.
    #[arg(long, value_name = "D", value_parser = values::number, allow_negative_numbers = true)]
    pub(crate) detail: Option<f64>,
}

impl PersonArgs {
    /// The parameters, in a named pose where one is given.
    pub(crate) fn parameters(&self, pose: Option<&str>) -> Result<MouthParameters, CliError> {
        let mut parameters = self.person.map_or_else(MouthParameters::default, sample_person);
        if let Some(name) = pose {
            parameters = find_view("--pose", name)?.pose(&parameters);
        }
        if let Some(detail) = self.detail {
            parameters.detail = detail;
        }
        let mut tree = serde_json::to_value(&parameters)?;
        for change in &self.set {
            let Some((field, value)) = change.split_once('=') else {
                return Err(CliError::Input(format!(
                    "--set {change}: write it as FIELD=VALUE, for instance jaw_opening_mm=40"
                )));
            };
            let (field, value) = (field.trim(), value.trim());
            if tree.get(field).is_none() {
                let known: Vec<&str> = tree
                    .as_object()
                    .map(|fields| fields.keys().map(String::as_str).collect())
                    .unwrap_or_default();
                return Err(CliError::Input(format!(
                    "--set {change}: a mouth has no parameter \"{field}\". Known: {}",
                    known.join(", ")
                )));
            }
            tree[field] = serde_json::from_str(value).map_err(|_| {
                CliError::Input(format!("--set {change}: \"{value}\" is not a number, a list, true or false"))
            })?;
        }
        let parameters: MouthParameters =
            serde_json::from_value(tree).map_err(|error| CliError::Input(format!("--set: {error}")))?;
        parameters.validate().map_err(|error| {
            let is_own = |change: &&String| {
                change.split_once('=').is_some_and(|(field, _)| field.trim() == error.field)
            };
            // The last change of a field is the one that counts.
            let typed = match (self.set.iter().rfind(is_own), self.detail) {
                (Some(change), _) => format!("--set {change}"),
                (None, Some(detail)) if error.field == "detail" => {
                    format!("--detail {}", number_text(detail))
                }
                _ => format!("mouth: {}", error.field),
            };
            CliError::Input(format!("{typed}: {}", error.message))
        })?;
        Ok(parameters)
    }
}

/// Number of a person, counted from 1.
pub(super) fn parse_person(text: &str) -> Result<u32, String> {
    text.parse()
        .ok()
        .filter(|number| *number > 0)
        .ok_or_else(|| format!("give a whole number from 1 to {}, for instance 7", u32::MAX))
}

/// A view or pose by name, which stands behind `option`.
pub(crate) fn find_view(option: &str, name: &str) -> Result<&'static ExaminationView, CliError> {
    ExaminationView::find(name).ok_or_else(|| {
        let known: Vec<&str> = EXAMINATION_VIEWS.iter().chain(&POSES).map(|view| view.name).collect();
        CliError::Input(format!(
            "{option} {name}: there is no view of this name. Known: {}",
            known.join(", ")
        ))
    })
}
