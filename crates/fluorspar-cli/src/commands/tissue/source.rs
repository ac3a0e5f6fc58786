//! The tissue that a command is about: a site of the catalogue, or a file of layers.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::ValueHint;
use fluorspar::spectral::Fluorophore;
use fluorspar::tissue::{Site, TissueState};
use fluorspar_experiment::preset::fluorophore;
use fluorspar_experiment::{ResolvedEmission, ResolvedLayers, parse_layers, parse_tissue};

use crate::error::CliError;
use crate::experiment_source::read_text;
use crate::values::{self, check_range};

/// Wavelengths at which tissue is known, nm.
const WAVELENGTH_NM: [f64; 2] = [350.0, 1000.0];

/// A fluorophore of the catalogue.
pub(super) fn find(name: &str) -> Option<Arc<Fluorophore>> {
    Some(Arc::new(fluorophore(name).ok()?.fluorophore()))
}

/// A site in states, then with parameters changed by `NAME=VALUE`.
fn changed(mut site: Site, states: &[String], changes: &[String]) -> Result<Site, CliError> {
    for state in states {
        site.apply(TissueState::named(state)?)?;
    }
    for change in changes {
        let (name, value) = change.split_once('=').ok_or_else(|| {
            CliError::Input(format!("--set {change}: write NAME=VALUE, such as oxygen_saturation=0.9"))
        })?;
        let value = values::number(value).map_err(|why| CliError::Input(format!("--set {change}: {why}")))?;
        site.set(name.trim(), value)?;
    }
    Ok(site)
}

/// A site of the catalogue or of a file, with changes.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct SiteArgs {
    /// Site of the catalogue, for instance dorsal_tongue, lip or tooth, or a file with one [[tissue]] section (.toml), as `tissue
    /// fit` writes it.
    #[arg(value_name = "SITE|FILE", value_hint = ValueHint::FilePath)]
    site: String,
    /// State of the site: inflammation, hyperaemia or dysplasia. May be repeated.
    #[arg(long, value_name = "STATE")]
    state: Vec<String>,
    /// Change one parameter, for instance `--set superficial_blood_fraction=0.01`. May be repeated.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
}

impl SiteArgs {
    /// The file that it is read from.
    pub(super) fn file(&self) -> Option<PathBuf> {
        file_of(&self.site)
    }

    /// Name for people, and the site with its changes.
    pub(super) fn resolve(&self) -> Result<(String, Site), CliError> {
        let (name, site) = match self.file() {
            None => {
                let site = Site::named(&self.site)?;
                (site.title().to_string(), site)
            }
            Some(path) => {
                let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
                parse_tissue(&read_text(&path)?, &self.site, folder)?
            }
        };
        let title = if self.state.is_empty() { name } else { format!("{name}, {}", self.state.join(", ")) };
        Ok((title, changed(site, &self.state, &self.set)?))
    }
}

/// A file, if the text names one.
fn file_of(text: &str) -> Option<PathBuf> {
    let path = Path::new(text);
    let is_file = path.extension().is_some() || text.contains(['/', '\\']) || path.exists();
    is_file.then(|| path.to_path_buf())
}

/// Which tissue, at which wavelengths.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct TissueArgs {
    /// Site of the catalogue, for instance dorsal_tongue, lip or tooth, or a file of plane layers (.toml with [[layer]]
    /// sections).
    #[arg(value_name = "TISSUE", value_hint = ValueHint::FilePath)]
    tissue: String,
    /// Wavelength of the light on a site, nm.
    #[arg(long, value_name = "NM", value_parser = values::number, allow_negative_numbers = true)]
    wavelength_nm: Option<f64>,
    /// Wavelength of the fluorescence of a site, nm, which is given per nm [default: no fluorescence].
    #[arg(long, value_name = "NM", requires = "wavelength_nm", value_parser = values::number,
        allow_negative_numbers = true)]
    emission_nm: Option<f64>,
    /// State of a site: inflammation, hyperaemia or dysplasia. May be repeated.
    #[arg(long, value_name = "STATE")]
    state: Vec<String>,
    /// Change one value: of a site `--set superficial_blood_fraction=0.01`, of a file
    /// `--set layer.epithelium.thickness_mm=0.2`. May be repeated.
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
}

impl TissueArgs {
    /// The file that it is read from.
    pub(super) fn file(&self) -> Option<PathBuf> {
        file_of(&self.tissue)
    }

    /// Wavelength of the emission where the fluorescence is per nm.
    pub(super) fn emission_nm(&self) -> Option<f64> {
        self.emission_nm
    }

    pub(super) fn resolve(&self) -> Result<ResolvedLayers, CliError> {
        let Some(path) = self.file() else { return self.of_site() };
        if let Some(option) =
            [self.wavelength_nm.map(|_| "--wavelength-nm"), (!self.state.is_empty()).then_some("--state")]
                .into_iter()
                .flatten()
                .next()
        {
            let message =
                format!("{option}: a file of layers states its optical properties itself; leave it out");
            return Err(CliError::Input(message));
        }
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Ok(parse_layers(&read_text(&path)?, &self.tissue, folder, &self.set)?)
    }

    fn of_site(&self) -> Result<ResolvedLayers, CliError> {
        let site = changed(Site::named(&self.tissue)?, &self.state, &self.set)?;
        let tissue = site.tissue(&find)?;
        let nm = self.wavelength_nm.ok_or_else(|| {
            let message = format!("{}: give the wavelength of the light, --wavelength-nm 405", self.tissue);
            CliError::Input(message)
        })?;
        check_range("--wavelength-nm", nm, WAVELENGTH_NM, "nm")?;
        let emission = self.emission_nm.map(|emission_nm| {
            check_range("--emission-nm", emission_nm, WAVELENGTH_NM, "nm")?;
            let strengths_per_mm = tissue.strengths_per_mm_nm(nm, emission_nm);
            if strengths_per_mm.iter().all(|strength| *strength == 0.0) {
                let message = format!("--emission-nm {emission_nm}: nothing fluoresces there under {nm} nm");
                return Err(CliError::Input(message));
            }
            Ok(ResolvedEmission { stack: tissue.optics(emission_nm), strengths_per_mm })
        });
        Ok(ResolvedLayers {
            title: format!("{} at {nm} nm", site.title()),
            names: tissue.layers.iter().map(|layer| layer.name.clone()).collect(),
            stack: tissue.optics(nm),
            emission: emission.transpose()?,
        })
    }
}
