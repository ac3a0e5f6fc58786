//! What a measured spectrum may be made of.

use fluorspar::analysis::{BloodBefore, FitError, MixtureComponent, SpectralMixture};
use fluorspar::names::did_you_mean;
use fluorspar::pipeline::{TISSUE_BLOOD, TissueView, tissue_mixture};
use fluorspar::spectral::{Curve, Fluorophore, oxyhemoglobin_extinction};
use fluorspar::tissue::fit::Viewing;
use fluorspar::tissue::{CachedSolutions, Site};
use fluorspar_format::{NamedCurve, Negative, SpectrumOptions, read_spectra};

use super::file_options::FileOptions;
use super::fit::FitOptions;
use super::loading::{is_measured_file, load};
use crate::{Error, Job, Result, named_spectra, tissue};

/// Largest optical density of blood that is looked for.
const LARGEST_DENSITY: f64 = 40.0;

/// Where the fluorophores lie.
enum Place {
    /// In the open, each with its matrix.
    Open(Vec<Fluorophore>),
    /// In the layers of a tissue; named ones only, if there are names.
    Tissue { site: Box<Site>, names: Vec<String> },
}

/// All components, before they are asked for at some wavelengths.
pub(super) struct Components<'a> {
    options: &'a FitOptions,
    place: Place,
    /// Irradiance behind the light's filters, W/(m² nm), and its sum, W/m²; of relative spectra of any scale.
    light: Option<(Curve, f64)>,
    filter: Curve,
    besides: Vec<NamedCurve>,
}

impl<'a> Components<'a> {
    pub(super) fn read(options: &'a FitOptions, job: &Job) -> Result<Self> {
        let place = match &options.tissue {
            Some(name) => {
                if let Some(option) = options.file.first_given() {
                    let why = "applies to files of fluorophores, and ⟨tissue⟩ holds those of the catalogue; leave it out";
                    return Err(Error::Input(format!("{option}: {why}")));
                }
                let names = options.fluorophore.clone();
                Place::Tissue { site: Box::new(tissue::site_named(name)?), names }
            }
            None => {
                // Options of files are for those among them
                let (no_options, has_files) =
                    (FileOptions::default(), options.fluorophore.iter().any(|name| is_measured_file(name)));
                let mut all = Vec::new();
                for name in &options.fluorophore {
                    let of_it =
                        if has_files && !is_measured_file(name) { &no_options } else { &options.file };
                    all.extend(load(name, of_it)?.into_iter().map(|loaded| loaded.fluorophore));
                }
                Place::Open(all)
            }
        };
        let light = options.light.as_deref().map(|name| irradiance(options, name, job)).transpose()?;
        let strict = SpectrumOptions {
            quantity: options.quantity(),
            negative: Negative::Keep,
            skip_empty_cells: true,
            ..Default::default()
        };
        let mut besides = Vec::new();
        for path in &options.component {
            besides.extend(read_spectra(path, &strict)?.curves);
        }
        Ok(Self {
            options,
            place,
            light,
            filter: named_spectra::filters(&options.view_filter, job)?,
            besides,
        })
    }

    /// Light and filters, for people.
    pub(super) fn light(&self) -> Option<String> {
        let label = |name: &String| named_spectra::label(name);
        let light = self.options.light.as_ref().map(label)?;
        let behind = |names: &[String]| names.iter().map(label).collect::<Vec<_>>().join(", ");
        let on_light = match self.options.light_filter.is_empty() {
            true => String::new(),
            false => format!(" through {}", behind(&self.options.light_filter)),
        };
        let before = match self.options.view_filter.is_empty() {
            true => String::new(),
            false => format!(", seen behind {}", behind(&self.options.view_filter)),
        };
        Some(format!("{light}{on_light}{before}"))
    }

    /// Unit of the spectra.
    pub(super) fn unit(&self) -> &'static str {
        if self.options.irradiance.is_some() { "W/(sr m² nm)" } else { "relative" }
    }

    /// What a weight of 1 is.
    pub(super) fn weight_unit(&self) -> &'static str {
        match (&self.place, self.options.irradiance.is_some()) {
            (Place::Tissue { .. }, true) => "what the tissue holds",
            (Place::Tissue { .. }, false) => "relative to each other as amounts of the tissue",
            (Place::Open(all), _) if all.is_empty() => "as the components are given",
            (Place::Open(_), true) => "the unit of the catalogue",
            (Place::Open(_), false) => "relative to each other as concentrations",
        }
    }

    /// What the amount of blood is.
    pub(super) fn blood(&self) -> Option<String> {
        match &self.place {
            Place::Tissue { .. } => Some(format!("{TISSUE_BLOOD} of {}", self.options.tissue.as_deref()?)),
            Place::Open(_) if self.options.below_blood.is_empty() => None,
            Place::Open(_) => Some(format!(
                "optical density at 414 nm (at most {LARGEST_DENSITY}) of blood before {}",
                self.options.below_blood.join(", ")
            )),
        }
    }

    /// The components at some wavelengths of a column.
    pub(super) fn mixture(&self, nm: &[f64], column: &str) -> Result<SpectralMixture> {
        let (mut components, mut blood) = match (&self.place, &self.light) {
            (Place::Open(all), Some((light, _))) => (self.in_the_open(all, light, nm), BloodBefore::None),
            (Place::Tissue { site, names }, Some(light)) => self.in_tissue(site, names, light, nm)?,
            (_, None) => (Vec::new(), BloodBefore::None),
        };
        if self.options.relative {
            to_peak(&mut components, &mut blood);
        }
        for besides in &self.besides {
            let values: Vec<f64> = nm.iter().map(|nm| besides.curve.at(*nm)).collect();
            if let BloodBefore::Tissue { values: known, .. } = &mut blood {
                known.iter_mut().for_each(|known| known.push(values.clone()));
            }
            components.push(MixtureComponent { name: besides.name.clone(), values });
        }
        self.check_names(&components)?;
        if !self.options.below_blood.is_empty() {
            let below = self.below_blood(&components)?;
            let extinction = nm.iter().map(|nm| oxyhemoglobin_extinction(*nm)).collect();
            blood = BloodBefore::Layer { extinction, below, largest: LARGEST_DENSITY };
        }
        let (first, last) = (nm.first().copied().unwrap_or(0.0), nm.last().copied().unwrap_or(0.0));
        SpectralMixture::new(nm.to_vec(), components, blood).map_err(|error| {
            let place = match &error {
                FitError::Dark { .. } => format!(" ({first} to {last} nm, behind the filters)"),
                FitError::FewSamples { .. } => ": take components away, or use more wavelengths".into(),
                _ => String::new(),
            };
            Error::Input(format!("{}, column \"{column}\": {error}{place}", self.options.spectra.display()))
        })
    }

    fn in_the_open(&self, all: &[Fluorophore], light: &Curve, nm: &[f64]) -> Vec<MixtureComponent> {
        let component = |fluorophore: &Fluorophore| MixtureComponent {
            name: fluorophore.name.clone(),
            values: fluorophore
                .radiance_under(light, nm)
                .iter()
                .zip(nm)
                .map(|(radiance, nm)| radiance * self.filter.at(*nm))
                .collect(),
        };
        all.iter().map(component).collect()
    }

    fn in_tissue(
        &self,
        site: &Site,
        names: &[String],
        (light, irradiance_w_per_m2): &(Curve, f64),
        nm: &[f64],
    ) -> Result<(Vec<MixtureComponent>, BloodBefore)> {
        let viewing = Viewing::new(light, self.filter.clone())?;
        let view =
            TissueView { viewing: &viewing, irradiance_w_per_m2: *irradiance_w_per_m2, wavelengths_nm: nm };
        let (components, blood) = tissue_mixture(site, &tissue::find, view, &CachedSolutions::default())?;
        let known: Vec<&str> = components.iter().map(|component| component.name.as_str()).collect();
        if let Some(unknown) = names.iter().find(|name| !known.contains(&name.as_str())) {
            let hint = did_you_mean(unknown, known.iter().copied());
            return Err(Error::Input(format!(
                "⟨fluorophore={unknown}⟩: {} does not hold it{hint} It holds {}",
                site.name(),
                known.join(", ")
            )));
        }
        let is_wanted = |name: &str| names.is_empty() || names.iter().any(|wanted| wanted == name);
        let wanted: Vec<bool> = known.iter().map(|name| is_wanted(name)).collect();
        let BloodBefore::Tissue { amounts, values } = blood else { return Ok((components, blood)) };
        Ok((
            chosen(components, &wanted),
            BloodBefore::Tissue { amounts, values: values.into_iter().map(|v| chosen(v, &wanted)).collect() },
        ))
    }

    fn check_names(&self, components: &[MixtureComponent]) -> Result<()> {
        for (place, component) in components.iter().enumerate() {
            if components[..place].iter().any(|other| other.name == component.name) {
                return Err(Error::Input(format!(
                    "two components are named \"{}\"; leave one out, or rename the column",
                    component.name
                )));
            }
        }
        Ok(())
    }

    /// Numbers of the components below blood.
    fn below_blood(&self, components: &[MixtureComponent]) -> Result<Vec<usize>> {
        let number = |wanted: &String| {
            components.iter().position(|component| component.name == *wanted).ok_or_else(|| {
                let known: Vec<&str> = components.iter().map(|component| component.name.as_str()).collect();
                let hint = did_you_mean(wanted, known.iter().copied());
                Error::Input(format!(
                    "⟨below_blood={wanted}⟩: no component has this name{hint} There are {}",
                    known.join(", ")
                ))
            })
        };
        self.options.below_blood.iter().map(number).collect()
    }
}

/// Those that are wanted.
fn chosen<T>(all: Vec<T>, wanted: &[bool]) -> Vec<T> {
    all.into_iter().zip(wanted).filter_map(|(one, wanted)| wanted.then_some(one)).collect()
}

/// Brings all components by one factor to a largest value of 1: their ratios stay those of concentrations.
fn to_peak(components: &mut [MixtureComponent], blood: &mut BloodBefore) {
    let largest = components.iter().flat_map(|component| &component.values).copied().fold(0.0, f64::max);
    let scale = |values: &mut Vec<f64>| values.iter_mut().for_each(|value| *value /= largest);
    if largest > 0.0 {
        components.iter_mut().for_each(|component| scale(&mut component.values));
        if let BloodBefore::Tissue { values, .. } = blood {
            values.iter_mut().flatten().for_each(scale);
        }
    }
}

/// Irradiance behind the light's filters, and its sum, W/m².
fn irradiance(options: &FitOptions, name: &str, job: &Job) -> Result<(Curve, f64)> {
    let light = named_spectra::light(name, job)?.times(&named_spectra::filters(&options.light_filter, job)?);
    let (total, wanted) = (light.total(), options.irradiance.unwrap_or(1.0));
    if total > 0.0 {
        return Ok((light.scaled(wanted / total), wanted));
    }
    Err(Error::Input(format!(
        "⟨light={name}⟩: nothing of the light passes its filters; check ⟨light_filter⟩"
    )))
}
