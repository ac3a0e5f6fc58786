//! The tissue that a task is about: a site of the catalogue, or a file of layers.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::ValueHint;
use fluorspar::spectral::Fluorophore;
use fluorspar::tissue::{LayeredTissue, Site};
use fluorspar_experiment::preset::{self, fluorophore, site_of_text};
use fluorspar_experiment::{NamedTissue, ResolvedEmission, ResolvedLayers, parse_layers, parse_tissue};
use serde::Deserialize;

use super::depth::wavelengths;
use crate::source::read_text;
use crate::values::{self, check_range};
use crate::{Error, Result};

/// Wavelengths at which tissue is known, nm.
const WAVELENGTH_NM: [f64; 2] = [350.0, 1000.0];

/// A fluorophore of the catalogue.
pub fn find(name: &str) -> Option<Arc<Fluorophore>> {
    Some(Arc::new(fluorophore(name).ok()?.fluorophore()))
}

/// Refuses layers that emit more photons than they absorb.
pub(super) fn balanced(tissue: LayeredTissue) -> Result<LayeredTissue> {
    tissue.check_photon_balance(&wavelengths())?;
    Ok(tissue)
}

/// A site in states, then with parameters changed by `NAME=VALUE`.
fn changed(mut site: Site, states: &[String], changes: &[String]) -> Result<Site> {
    for state in states {
        site.apply(&preset::state(state)?)?;
    }
    for change in changes {
        let (name, value) = change.split_once('=').ok_or_else(|| {
            Error::Input(format!("⟨set={change}⟩: write NAME=VALUE, such as oxygen_saturation=0.9"))
        })?;
        let value = values::number(value).map_err(|why| Error::Input(format!("⟨set={change}⟩: {why}")))?;
        site.set(name.trim(), value)?;
    }
    Ok(site)
}

/// A site of the catalogue, or a tissue of a file, with changes.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct SiteOptions {
    /// Site of the catalogue, for instance dorsal_tongue, lip or tooth, or a file (.toml): a site in the form of the catalogue, or one
    /// [[tissue]] section, a site with changes, as `tissue fit` writes it, or layers; for `tissue mc` also plane layers at one
    /// wavelength ([[layer]] sections).
    #[arg(value_name = "SITE|FILE", value_hint = ValueHint::FilePath)]
    pub site: String,
    /// State of the site, for instance inflammation or carcinoma (`catalog list state`). May be repeated.
    #[arg(long, value_name = "STATE")]
    pub state: Vec<String>,
    /// Change one value, a parameter of the site, for instance `--set superficial_blood_fraction=0.01`; of plane layers
    /// `--set layer.epithelium.thickness_mm=0.2`. May be repeated.
    #[arg(long = "set", value_name = "PATH=VALUE")]
    pub set: Vec<String>,
}

impl SiteOptions {
    /// The file that it is read from.
    pub(crate) fn file(&self) -> Option<PathBuf> {
        file_of(&self.site)
    }

    /// Name for people, and the tissue with its changes.
    ///
    /// # Errors
    /// A site, a state or a value that does not exist; a file that can't be read or holds none.
    pub fn resolve(&self) -> Result<(String, NamedTissue)> {
        let (name, tissue) = match self.file() {
            None => {
                let site = preset::site(&self.site)?;
                (site.title().to_string(), NamedTissue::Site(site))
            }
            Some(path) => tissue_of_file(&read_text(&path)?, &path)?,
        };
        let NamedTissue::Site(site) = tissue else {
            let option = if self.set.is_empty() { "⟨state⟩" } else { "⟨set⟩" };
            if self.set.is_empty() && self.state.is_empty() {
                return Ok((name, tissue));
            }
            let message = format!("{option}: {} describes its layers itself; change them there", self.site);
            return Err(Error::Input(message));
        };
        let title = if self.state.is_empty() { name } else { format!("{name}, {}", self.state.join(", ")) };
        Ok((title, NamedTissue::Site(changed(site, &self.state, &self.set)?)))
    }

    /// The same for what needs the parameters of a site.
    pub(crate) fn resolve_site(&self) -> Result<(String, Site)> {
        match self.resolve()? {
            (title, NamedTissue::Site(site)) => Ok((title, site)),
            (title, NamedTissue::Layers { .. }) => {
                let message = format!(
                    "{}: \"{title}\" is described by its layers, but this changes the parameters of a site; give site = \
                     \"dorsal_tongue\" or another instead",
                    self.site
                );
                Err(Error::Input(message))
            }
        }
    }
}

/// A site of the catalogue, or that of a file.
///
/// # Errors
/// A site that does not exist; a file that can't be read or holds none.
pub fn site_named(text: &str) -> Result<Site> {
    let args = SiteOptions { site: text.into(), state: Vec::new(), set: Vec::new() };
    Ok(args.resolve_site()?.1)
}

/// Whether a text is a file of a site rather than one with a `[[tissue]]` section or plane layers.
fn is_site(text: &str) -> bool {
    text.lines().any(|line| line.starts_with("structure"))
}

/// Whether a text is a file of a site or with a `[[tissue]]` section rather than one of plane layers.
fn is_tissue(text: &str) -> bool {
    is_site(text) || text.lines().any(|line| line.trim_start().starts_with("[[tissue]]"))
}

/// The tissue of the text of a file of a site or with a `[[tissue]]` section.
fn tissue_of_file(text: &str, path: &Path) -> Result<(String, NamedTissue)> {
    if is_site(text) {
        let site =
            site_of_text(text).map_err(|message| Error::Input(format!("{}: {message}", path.display())))?;
        return Ok((site.title().to_string(), NamedTissue::Site(site)));
    }
    Ok(parse_tissue(text, &path.display().to_string(), folder_of(path))?)
}

/// The folder in which the paths of a file start.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A file, if the text names one.
fn file_of(text: &str) -> Option<PathBuf> {
    let path = Path::new(text);
    let is_file = path.extension().is_some() || text.contains(['/', '\\']) || path.is_file();
    is_file.then(|| path.to_path_buf())
}

/// Which tissue, at which wavelengths.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct TissueOptions {
    /// Which tissue.
    #[command(flatten)]
    #[serde(flatten)]
    pub site: SiteOptions,
    /// Light of one wavelength on a tissue, nm.
    #[arg(long, alias = "wavelength-nm", value_name = "NM", value_parser = values::number, allow_negative_numbers = true)]
    pub excitation_nm: Option<f64>,
    /// Wavelength of the fluorescence of a tissue, nm, which is given per nm [default: no fluorescence].
    #[arg(long, value_name = "NM", requires = "excitation_nm", value_parser = values::number,
        allow_negative_numbers = true)]
    pub emission_nm: Option<f64>,
}

impl TissueOptions {
    /// The file that it is read from.
    pub(crate) fn file(&self) -> Option<PathBuf> {
        self.site.file()
    }

    pub(crate) fn resolve(&self) -> Result<ResolvedLayers> {
        let text = self.file().map(|path| read_text(&path)).transpose()?;
        let Some(text) = text.filter(|text| !is_tissue(text)) else {
            let (title, tissue) = self.site.resolve()?;
            return self.at_wavelength(&title, &balanced(tissue.tissue(&find)?)?);
        };
        if let Some(option) = [
            self.excitation_nm.map(|_| "⟨excitation_nm⟩"),
            (!self.site.state.is_empty()).then_some("⟨state⟩"),
        ]
        .into_iter()
        .flatten()
        .next()
        {
            let message =
                format!("{option}: a file of layers states its optical properties itself; leave it out");
            return Err(Error::Input(message));
        }
        let SiteOptions { site, set, .. } = &self.site;
        Ok(parse_layers(&text, site, folder_of(Path::new(site)), set)?)
    }

    /// Layers at the wavelengths of the options.
    fn at_wavelength(&self, title: &str, tissue: &LayeredTissue) -> Result<ResolvedLayers> {
        let nm = self.excitation_nm.ok_or_else(|| {
            let message =
                format!("{}: give the wavelength of the light, ⟨excitation_nm=405⟩", self.site.site);
            Error::Input(message)
        })?;
        check_range("excitation_nm", nm, WAVELENGTH_NM, "nm")?;
        let emission = self.emission_nm.map(|emission_nm| {
            check_range("emission_nm", emission_nm, WAVELENGTH_NM, "nm")?;
            let strengths_per_mm = tissue.strengths_per_mm_nm(nm, emission_nm);
            if strengths_per_mm.iter().all(|strength| *strength == 0.0) {
                let message = format!("⟨emission_nm={emission_nm}⟩: nothing fluoresces there under {nm} nm");
                return Err(Error::Input(message));
            }
            Ok(ResolvedEmission { stack: tissue.optics(emission_nm), strengths_per_mm })
        });
        Ok(ResolvedLayers {
            title: format!("{title} at {nm} nm"),
            names: tissue.layers.iter().map(|layer| layer.name.clone()).collect(),
            stack: tissue.optics(nm),
            emission: emission.transpose()?,
        })
    }
}
