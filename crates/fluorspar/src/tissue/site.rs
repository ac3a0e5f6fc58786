//! Tissues of the mouth and of the face, as named parameters.
//!
//! The dorsal tongue and the lip were fitted: absorption and scattering to measured reflectance (mean of twelve tongues, of three
//! inner lips; optics and fluorescence together for the lip), strengths of the fluorophores to spectra of four people under lights
//! of 405, 415 and 450 nm (500 to 700 nm, one vote per person; the strength of NADH, which these lights hardly excite, was held at
//! what cells have). The example `tissue_against_people` of `fluorspar-validation` prints how well they do. Diffuse reflectance fixes
//! the ratio of absorption to scattering only, so the tongue comes in two variants
//! that fit equally well. Scattering and thickness of the epithelium follow Pavlova et al., J. Biomed. Opt. 13, 064012 (2008)
//! and Prestin et al. (2012, optical coherence tomography of 143 people); blood in vessels is that of
//! [`Blood`]. The other sites start from these with the published thicknesses and what is known of their keratin, and are marked
//! assumed.

use std::sync::Arc;

use super::chromophore::{Blood, Chromophore};
use super::layered_tissue::{Below, LayeredTissue, TissueFluorophore, TissueLayer};
use super::scattering::{LayerScattering, ScatteringCoefficient};
use super::site_parameter::{Basis, SOFT, SiteParameter, TOOTH};
use super::surroundings::{self, Surroundings};
use super::tissue_error::{TissueError, check};
use super::tissue_state::TissueState;
use crate::spectral::Fluorophore;

/// Thickness of the basal layer, which holds the melanin, um.
const BASAL_UM: f64 = 20.0;
/// Wavelength at which strengths are given, nm.
const STRENGTH_NM: f64 = 405.0;

/// A tissue of the catalogue, with parameters that may be changed.
#[derive(Clone, Debug, PartialEq)]
pub struct Site {
    known: &'static KnownSite,
    values: Vec<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Structure {
    Soft,
    Tooth,
}

#[derive(Debug, PartialEq)]
struct KnownSite {
    name: &'static str,
    title: &'static str,
    source: &'static str,
    assumed: bool,
    structure: Structure,
    surroundings: &'static Surroundings,
    /// What differs from the first site of its structure, which states everything.
    values: &'static [(&'static str, f64)],
}

const FITTED: &str = "fitted to measured reflectance and in-vivo fluorescence (docs/tissue.md)";
const THICKNESS: &str = "[assumed] epithelium after Prestin et al. 2012, the rest from the fitted sites";

const DORSAL_TONGUE: &[(&str, f64)] = &[
    ("biofilm_thickness_um", 20.0),
    ("keratin_thickness_um", 40.0),
    ("epithelium_thickness_um", 160.0),
    ("superficial_stroma_thickness_um", 300.0),
    ("deep_stroma_thickness_um", 5000.0),
    ("background_per_mm", 0.1544),
    ("background_slope_per_nm", 0.008_35),
    ("keratin_scattering_per_mm", 17.0),
    ("epithelium_scattering_per_mm", 5.5),
    ("epithelium_scattering_power", 2.0),
    ("stroma_reduced_scattering_per_mm", 2.246),
    ("stroma_scattering_power", 1.205),
    ("superficial_blood_fraction", 0.003),
    ("superficial_vessel_radius_um", 4.0),
    ("deep_blood_fraction", 0.1118),
    ("deep_vessel_radius_um", 23.5),
    ("oxygen_saturation", 0.933),
    ("hemoglobin_g_per_l", 150.0),
    ("melanin_fraction", 0.0),
    ("refractive_index", 1.4),
    ("biofilm_porphyrin_per_mm", 1.525e-3),
    ("biofilm_chlorophyll_per_mm", 1.835e-3),
    ("keratin_per_mm", 5.16e-3),
    ("nadh_per_mm", 1.0e-4),
    ("fad_per_mm", 3.0e-5),
    ("superficial_collagen_per_mm", 3.218e-3),
    ("deep_collagen_per_mm", 3.218e-3),
    ("superficial_elastin_per_mm", 0.0),
    ("deep_elastin_per_mm", 0.0),
    ("superficial_lipopigment_per_mm", 4.45e-4),
    ("deep_lipopigment_per_mm", 4.45e-4),
    ("flavin_aggregate_per_mm", 0.0),
];

const DORSAL_TONGUE_B: &[(&str, f64)] = &[
    ("background_per_mm", 0.0294),
    ("background_slope_per_nm", 0.005_88),
    ("stroma_reduced_scattering_per_mm", 1.2),
    ("stroma_scattering_power", 0.6),
    ("superficial_blood_fraction", 0.002_42),
    ("deep_blood_fraction", 0.0543),
    ("deep_vessel_radius_um", 52.4),
    ("oxygen_saturation", 0.835),
    ("biofilm_porphyrin_per_mm", 1.288e-3),
    ("biofilm_chlorophyll_per_mm", 1.736e-3),
    ("keratin_per_mm", 5.73e-3),
    ("nadh_per_mm", 1.5e-4),
    ("fad_per_mm", 6.0e-5),
    ("superficial_collagen_per_mm", 1.417e-3),
    ("deep_collagen_per_mm", 1.417e-3),
    ("superficial_lipopigment_per_mm", 2.07e-4),
    ("deep_lipopigment_per_mm", 2.07e-4),
];

const LIP: &[(&str, f64)] = &[
    ("keratin_thickness_um", 15.0),
    ("epithelium_thickness_um", 600.0),
    ("superficial_stroma_thickness_um", 200.0),
    ("background_per_mm", 0.0827),
    ("superficial_blood_fraction", 0.006_13),
    ("deep_blood_fraction", 0.0968),
    ("deep_vessel_radius_um", 8.76),
    ("oxygen_saturation", 0.868),
    ("biofilm_porphyrin_per_mm", 0.0),
    ("biofilm_chlorophyll_per_mm", 0.0),
    ("keratin_per_mm", 0.0301),
    ("nadh_per_mm", 1.8e-4),
    ("fad_per_mm", 0.0),
    ("superficial_collagen_per_mm", 0.0),
    ("deep_collagen_per_mm", 9.39e-3),
    ("deep_elastin_per_mm", 7.37e-3),
    ("superficial_lipopigment_per_mm", 0.0),
    ("deep_lipopigment_per_mm", 4.5e-4),
];

/// Lining mucosa: no keratin layer of its own, but a superficial fifth of the epithelium.
macro_rules! lining {
    ($($name:literal: $value:expr),* $(,)?) => {
        &[
            ("keratin_scattering_per_mm", 5.5),
            ("background_per_mm", 0.12),
            ("biofilm_porphyrin_per_mm", 0.0),
            ("biofilm_chlorophyll_per_mm", 0.0),
            ("keratin_per_mm", 1.0e-3),
            ("nadh_per_mm", 1.2e-4),
            ("fad_per_mm", 6.0e-5),
            ("superficial_collagen_per_mm", 2.5e-3),
            ("deep_collagen_per_mm", 2.5e-3),
            ("deep_elastin_per_mm", 1.5e-3),
            ("superficial_lipopigment_per_mm", 2.0e-4),
            ("deep_lipopigment_per_mm", 2.0e-4),
            $(($name, $value)),*
        ]
    };
}

const SITES: &[KnownSite] = &[
    KnownSite {
        name: "dorsal_tongue",
        title: "Dorsum of the tongue",
        source: FITTED,
        assumed: false,
        structure: Structure::Soft,
        surroundings: &surroundings::TONGUE,
        values: DORSAL_TONGUE,
    },
    KnownSite {
        name: "dorsal_tongue_b",
        title: "Dorsum of the tongue, less scattering",
        source: FITTED,
        assumed: false,
        structure: Structure::Soft,
        surroundings: &surroundings::TONGUE,
        values: DORSAL_TONGUE_B,
    },
    KnownSite {
        name: "ventral_tongue",
        title: "Underside of the tongue",
        source: THICKNESS,
        assumed: true,
        structure: Structure::Soft,
        surroundings: &surroundings::ELSEWHERE,
        values: lining! {
            "keratin_thickness_um": 20.0,
            "epithelium_thickness_um": 79.0,
            "superficial_stroma_thickness_um": 200.0,
            "superficial_blood_fraction": 0.006,
            "deep_blood_fraction": 0.09,
            "deep_vessel_radius_um": 30.0,
            "oxygen_saturation": 0.85,
        },
    },
    KnownSite {
        name: "buccal_mucosa",
        title: "Cheek (buccal mucosa)",
        source: THICKNESS,
        assumed: true,
        structure: Structure::Soft,
        surroundings: &surroundings::CHEEK,
        values: lining! {
            "keratin_thickness_um": 59.0,
            "epithelium_thickness_um": 235.0,
            "deep_blood_fraction": 0.06,
            "superficial_blood_fraction": 0.004,
            "oxygen_saturation": 0.88,
        },
    },
    KnownSite {
        name: "floor_of_mouth",
        title: "Floor of the mouth",
        source: THICKNESS,
        assumed: true,
        structure: Structure::Soft,
        surroundings: &surroundings::ELSEWHERE,
        values: lining! {
            "keratin_thickness_um": 20.0,
            "epithelium_thickness_um": 79.0,
            "deep_blood_fraction": 0.08,
            "superficial_blood_fraction": 0.005,
            "oxygen_saturation": 0.86,
        },
    },
    KnownSite {
        name: "hard_palate",
        title: "Hard palate",
        source: THICKNESS,
        assumed: true,
        structure: Structure::Soft,
        surroundings: &surroundings::ELSEWHERE,
        values: &[
            ("keratin_thickness_um", 48.0),
            ("epithelium_thickness_um", 191.0),
            ("stroma_reduced_scattering_per_mm", 2.71),
            ("stroma_scattering_power", 1.627),
            ("deep_blood_fraction", 0.03),
            ("background_per_mm", 0.12),
            ("biofilm_porphyrin_per_mm", 0.0),
            ("biofilm_chlorophyll_per_mm", 0.0),
            ("superficial_collagen_per_mm", 2.2e-3),
            ("deep_collagen_per_mm", 2.2e-3),
            ("superficial_lipopigment_per_mm", 2.0e-4),
            ("deep_lipopigment_per_mm", 2.0e-4),
        ],
    },
    KnownSite {
        name: "soft_palate",
        title: "Soft palate",
        source: THICKNESS,
        assumed: true,
        structure: Structure::Soft,
        surroundings: &surroundings::ELSEWHERE,
        values: lining! {
            "keratin_thickness_um": 38.0,
            "epithelium_thickness_um": 152.0,
            "deep_blood_fraction": 0.07,
            "superficial_blood_fraction": 0.005,
            "oxygen_saturation": 0.88,
        },
    },
    KnownSite {
        name: "gingiva",
        title: "Attached gingiva",
        source: "[assumed] epithelium after Klein-Szanto and Schroeder 1977, the rest from the fitted sites",
        assumed: true,
        structure: Structure::Soft,
        surroundings: &surroundings::ELSEWHERE,
        values: &[
            ("keratin_thickness_um", 30.0),
            ("epithelium_thickness_um", 220.0),
            ("stroma_reduced_scattering_per_mm", 2.71),
            ("stroma_scattering_power", 1.627),
            ("deep_blood_fraction", 0.04),
            ("background_per_mm", 0.12),
            ("biofilm_porphyrin_per_mm", 0.0),
            ("biofilm_chlorophyll_per_mm", 0.0),
            ("superficial_collagen_per_mm", 2.5e-3),
            ("deep_collagen_per_mm", 2.5e-3),
            ("superficial_lipopigment_per_mm", 2.0e-4),
            ("deep_lipopigment_per_mm", 2.0e-4),
        ],
    },
    KnownSite {
        name: "lip",
        title: "Lip",
        source: FITTED,
        assumed: false,
        structure: Structure::Soft,
        surroundings: &surroundings::LIP,
        values: LIP,
    },
    KnownSite {
        name: "facial_skin",
        title: "Skin of the face, fair",
        source: "[assumed] scattering and melanin after Jacques, Phys. Med. Biol. 58, R37, 2013",
        assumed: true,
        structure: Structure::Soft,
        surroundings: &surroundings::ELSEWHERE,
        values: &[
            ("biofilm_thickness_um", 5.0),
            ("keratin_thickness_um", 15.0),
            ("epithelium_thickness_um", 60.0),
            ("superficial_stroma_thickness_um", 200.0),
            ("background_per_mm", 0.1),
            ("background_slope_per_nm", 0.006),
            ("stroma_reduced_scattering_per_mm", 4.6),
            ("stroma_scattering_power", 1.421),
            ("superficial_blood_fraction", 0.004),
            ("superficial_vessel_radius_um", 5.0),
            ("deep_blood_fraction", 0.006),
            ("deep_vessel_radius_um", 15.0),
            ("oxygen_saturation", 0.75),
            ("melanin_fraction", 0.04),
            ("biofilm_porphyrin_per_mm", 0.0),
            ("biofilm_chlorophyll_per_mm", 0.0),
            ("superficial_collagen_per_mm", 1.5e-3),
            ("deep_collagen_per_mm", 1.5e-3),
            ("superficial_elastin_per_mm", 3.0e-4),
            ("deep_elastin_per_mm", 3.0e-4),
            ("superficial_lipopigment_per_mm", 1.0e-4),
            ("deep_lipopigment_per_mm", 1.0e-4),
        ],
    },
    KnownSite {
        name: "tooth",
        title: "Tooth crown: enamel on dentin",
        source: "[assumed] scattering after Fried et al., Appl. Opt. 34, 1278, 1995 [values from memory]; absorption for the \
                 reflectance, fluorescence for the yield of front teeth",
        assumed: true,
        structure: Structure::Tooth,
        surroundings: &surroundings::ELSEWHERE,
        values: &[
            ("enamel_thickness_um", 1200.0),
            ("dentin_thickness_um", 3000.0),
            ("enamel_scattering_per_mm", 10.5),
            ("enamel_scattering_power", 3.0),
            ("dentin_scattering_per_mm", 28.0),
            ("dentin_scattering_power", 0.0),
            ("enamel_background_per_mm", 0.01),
            ("dentin_background_per_mm", 0.08),
            ("background_slope_per_nm", 0.006),
            ("enamel_refractive_index", 1.63),
            ("dentin_refractive_index", 1.54),
            ("enamel_per_mm", 2.0e-3),
            ("dentin_per_mm", 6.0e-3),
        ],
    },
];

impl Site {
    /// Names of all sites.
    #[must_use]
    pub fn names() -> Vec<&'static str> {
        SITES.iter().map(|site| site.name).collect()
    }

    /// A site by its name.
    ///
    /// # Errors
    /// A name that no site has, with all names.
    pub fn named(name: &str) -> Result<Self, TissueError> {
        let known = SITES
            .iter()
            .find(|site| site.name == name)
            .ok_or_else(|| TissueError::NoSuchSite { name: name.to_string(), known: Self::names() })?;
        let complete = SITES.iter().find(|site| site.structure == known.structure).unwrap_or(known);
        let mut site = Self { known, values: vec![0.0; known.structure.parameters().len()] };
        for (name, value) in complete.values.iter().chain(known.values) {
            site.set(name, *value)?;
        }
        Ok(site)
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.known.name
    }

    /// Its name for people.
    #[must_use]
    pub fn title(&self) -> &'static str {
        self.known.title
    }

    /// Where its parameters come from.
    #[must_use]
    pub fn source(&self) -> &'static str {
        self.known.source
    }

    /// What reaches it by way of other surfaces of a mouth.
    #[must_use]
    pub fn surroundings(&self) -> &'static Surroundings {
        self.known.surroundings
    }

    /// Whether its parameters are assumed rather than fitted to measurements of the site.
    #[must_use]
    pub fn is_assumed(&self) -> bool {
        self.known.assumed
    }

    /// All parameters with their values.
    pub fn parameters(&self) -> impl Iterator<Item = (&'static SiteParameter, f64)> + '_ {
        self.known.structure.parameters().iter().zip(self.values.iter().copied())
    }

    /// Where the value of a parameter comes from, and from what; assumed where the name is unknown.
    #[must_use]
    pub fn basis(&self, name: &str) -> (Basis, &'static str) {
        let found = self.parameters().find(|(parameter, _)| parameter.name == name);
        let (basis, source) =
            found.map_or((Basis::Assumed, ""), |(parameter, _)| match self.known.structure {
                Structure::Soft => parameter.source(),
                Structure::Tooth => (Basis::Assumed, ""),
            });
        match basis {
            Basis::Fitted if self.known.assumed => (Basis::Assumed, "as the fitted sites, or for their look"),
            basis => (basis, source),
        }
    }

    fn index_of(&self, name: &str) -> Result<usize, TissueError> {
        let parameters = self.known.structure.parameters();
        parameters.iter().position(|p| p.name == name).ok_or_else(|| TissueError::NoSuchParameter {
            site: self.known.name,
            name: name.to_string(),
            known: parameters.iter().map(|p| p.name).collect(),
        })
    }

    /// Value of a parameter, in the unit at the end of its name.
    ///
    /// # Errors
    /// A name that the site does not have, with the names that it has.
    pub fn get(&self, name: &str) -> Result<f64, TissueError> {
        self.index_of(name).map(|index| self.values[index])
    }

    /// Changes a parameter.
    ///
    /// # Errors
    /// A name that the site does not have, and a value outside the range of the parameter.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), TissueError> {
        let index = self.index_of(name)?;
        let parameter = &self.known.structure.parameters()[index];
        let place = format!("tissue '{}'", self.known.name);
        check(&place, parameter.name, value, parameter.range, parameter.meaning)?;
        self.values[index] = value;
        Ok(())
    }

    /// Sets a parameter that the site has to the nearest value of its range.
    pub(super) fn set_within_range(&mut self, name: &str, value: f64) {
        if let Ok(index) = self.index_of(name) {
            let [least, most] = self.known.structure.parameters()[index].range;
            self.values[index] = value.clamp(least, most);
        }
    }

    /// Name of the parameter that holds the strength of a fluorophore in a layer of [`Self::tissue`]; none where the site has
    /// no such fluorophore there.
    #[must_use]
    pub fn strength_parameter(&self, layer: &str, fluorophore: &str) -> Option<&'static str> {
        let place = match layer {
            "superficial stroma" => "superficial_",
            "deep stroma" => "deep_",
            _ => "",
        };
        let wanted = format!("{place}{fluorophore}_per_mm");
        self.parameters().map(|(parameter, _)| parameter.name).find(|name| *name == wanted)
    }

    /// Changes the parameters to those of a state; several may follow each other.
    ///
    /// # Errors
    /// A state that the site can't have, as a tooth has no blood, or that takes a parameter out of its range.
    pub fn apply(&mut self, state: TissueState) -> Result<(), TissueError> {
        for (name, factor) in state.factors() {
            let value = self.get(name)?;
            self.set(name, value * factor)?;
        }
        Ok(())
    }

    /// Names of the fluorophores that it may hold; [`Self::tissue`] looks for those of a strength above 0.
    #[must_use]
    pub fn fluorophores(&self) -> &'static [&'static str] {
        match self.known.structure {
            Structure::Soft => &[
                "biofilm_porphyrin",
                "biofilm_chlorophyll",
                "keratin",
                "nadh",
                "fad",
                "collagen",
                "elastin",
                "lipopigment",
                "flavin_aggregate",
            ],
            Structure::Tooth => &["enamel", "dentin"],
        }
    }

    /// Photons emitted per photon that a fluorophore absorbs, as far as one number can be given: to size what its own absorption
    /// does. \[assumed; from memory: NADH, FAD and porphyrin of Lakowicz, the others of that order\]
    #[must_use]
    pub fn quantum_yield(fluorophore: &str) -> Option<f64> {
        let known = [
            ("nadh", 0.02),
            ("fad", 0.03),
            ("flavin_aggregate", 0.02),
            ("collagen", 0.2),
            ("elastin", 0.2),
            ("keratin", 0.2),
            ("lipopigment", 0.05),
            ("biofilm_porphyrin", 0.1),
            ("biofilm_chlorophyll", 0.05),
            ("enamel", 0.1),
            ("dentin", 0.1),
        ];
        known.into_iter().find_map(|(name, value)| (name == fluorophore).then_some(value))
    }

    /// The tissue. `find` gives a fluorophore by its name.
    ///
    /// # Errors
    /// A fluorophore that `find` does not have, and parameters that together are no tissue.
    pub fn tissue(
        &self,
        find: &dyn Fn(&str) -> Option<Arc<Fluorophore>>,
    ) -> Result<LayeredTissue, TissueError> {
        let tissue = match self.known.structure {
            Structure::Soft => self.soft_tissue(find)?,
            Structure::Tooth => self.tooth(find)?,
        };
        tissue.validate()?;
        Ok(tissue)
    }

    /// Fluorophores of a layer: names, and the parameters that hold their strengths. Those of strength 0 are left out.
    fn fluorescence(
        &self,
        find: &dyn Fn(&str) -> Option<Arc<Fluorophore>>,
        contents: &[(&str, &str)],
    ) -> Result<Vec<TissueFluorophore>, TissueError> {
        let mut fluorophores = Vec::new();
        for (name, parameter) in contents {
            let strength_per_mm = self.get(parameter)?;
            if strength_per_mm > 0.0 {
                let fluorophore = find(name).ok_or_else(|| TissueError::NoSuchFluorophore {
                    site: self.known.name,
                    name: (*name).to_string(),
                })?;
                // Its absorption is part of the background, which was fitted to reflectance.
                let quantum_yield = None;
                fluorophores.push(TissueFluorophore {
                    fluorophore,
                    strength_per_mm,
                    at_nm: STRENGTH_NM,
                    quantum_yield,
                });
            }
        }
        Ok(fluorophores)
    }

    fn background(&self, parameter: &str) -> Result<Chromophore, TissueError> {
        Ok(Chromophore::Background {
            absorption_per_mm: self.get(parameter)?,
            at_nm: 420.0,
            slope_per_nm: self.get("background_slope_per_nm")?,
        })
    }

    fn blood(&self, fraction: &str, radius: &str) -> Result<Chromophore, TissueError> {
        Ok(Chromophore::Blood(Blood {
            volume_fraction: self.get(fraction)?,
            saturation: self.get("oxygen_saturation")?,
            hemoglobin_g_per_l: self.get("hemoglobin_g_per_l")?,
            vessel_radius_um: self.get(radius)?,
        }))
    }

    fn power_law(
        &self,
        coefficient: &str,
        at_nm: f64,
        power: &str,
        anisotropy: f64,
    ) -> Result<LayerScattering, TissueError> {
        let (scattering_per_mm, power) = (self.get(coefficient)?, self.get(power)?);
        let coefficient = ScatteringCoefficient::PowerLaw { scattering_per_mm, at_nm, power };
        Ok(LayerScattering { coefficient, anisotropy })
    }

    fn soft_tissue(
        &self,
        find: &dyn Fn(&str) -> Option<Arc<Fluorophore>>,
    ) -> Result<LayeredTissue, TissueError> {
        let background = self.background("background_per_mm")?;
        let power = "epithelium_scattering_power";
        let keratin_scattering = self.power_law("keratin_scattering_per_mm", 420.0, power, 0.97)?;
        let epithelium_scattering = self.power_law("epithelium_scattering_per_mm", 420.0, power, 0.97)?;
        let stroma_scattering = LayerScattering {
            coefficient: ScatteringCoefficient::ReducedPowerLaw {
                reduced_per_mm: self.get("stroma_reduced_scattering_per_mm")?,
                at_nm: 500.0,
                power: self.get("stroma_scattering_power")?,
            },
            anisotropy: 0.88,
        };
        let layer =
            |name: &str, thickness_um, scattering: &LayerScattering, absorption, fluorophores| TissueLayer {
                name: name.to_string(),
                thickness_um,
                scattering: scattering.clone(),
                absorption,
                fluorophores,
                refractive_index: None,
            };
        let mut layers = Vec::with_capacity(6);

        // A biofilm without emitters of its own is keratin.
        let film = [
            ("biofilm_porphyrin", "biofilm_porphyrin_per_mm"),
            ("biofilm_chlorophyll", "biofilm_chlorophyll_per_mm"),
            ("keratin", "keratin_per_mm"),
        ];
        let keratin_um = self.get("keratin_thickness_um")?;
        let film_um = self.get("biofilm_thickness_um")?.min(0.5 * keratin_um);
        let coated = film_um >= 0.1
            && (self.get("biofilm_porphyrin_per_mm")? > 0.0 || self.get("biofilm_chlorophyll_per_mm")? > 0.0);
        let mut rest_um = keratin_um;
        if coated {
            let absorption = vec![background.clone()];
            layers.push(layer(
                "biofilm",
                film_um,
                &keratin_scattering,
                absorption,
                self.fluorescence(find, &film)?,
            ));
            rest_um -= film_um;
        }
        let absorption = vec![background.clone()];
        layers.push(layer(
            "keratin",
            rest_um,
            &keratin_scattering,
            absorption,
            self.fluorescence(find, &film[2..])?,
        ));

        let cells = self.fluorescence(
            find,
            &[
                ("nadh", "nadh_per_mm"),
                ("fad", "fad_per_mm"),
                ("flavin_aggregate", "flavin_aggregate_per_mm"),
            ],
        )?;
        let mut epithelium_um = self.get("epithelium_thickness_um")?;
        let volume_fraction = self.get("melanin_fraction")?;
        let basal_um = if volume_fraction > 0.0 { BASAL_UM.min(0.5 * epithelium_um) } else { 0.0 };
        epithelium_um -= basal_um;
        let absorption = vec![background.clone()];
        layers.push(layer("epithelium", epithelium_um, &epithelium_scattering, absorption, cells.clone()));
        if volume_fraction > 0.0 {
            let absorption = vec![background.clone(), Chromophore::Melanin { volume_fraction }];
            layers.push(layer("basal layer", basal_um, &epithelium_scattering, absorption, cells));
        }

        let vessels = self.blood("superficial_blood_fraction", "superficial_vessel_radius_um")?;
        let fibers = self.fluorescence(
            find,
            &[
                ("collagen", "superficial_collagen_per_mm"),
                ("elastin", "superficial_elastin_per_mm"),
                ("lipopigment", "superficial_lipopigment_per_mm"),
            ],
        )?;
        let thickness_um = self.get("superficial_stroma_thickness_um")?;
        let absorption = vec![background.clone(), vessels];
        layers.push(layer("superficial stroma", thickness_um, &stroma_scattering, absorption, fibers));

        let vessels = self.blood("deep_blood_fraction", "deep_vessel_radius_um")?;
        let fibers = self.fluorescence(
            find,
            &[
                ("collagen", "deep_collagen_per_mm"),
                ("elastin", "deep_elastin_per_mm"),
                ("lipopigment", "deep_lipopigment_per_mm"),
            ],
        )?;
        let thickness_um = self.get("deep_stroma_thickness_um")?;
        layers.push(layer(
            "deep stroma",
            thickness_um,
            &stroma_scattering,
            vec![background, vessels],
            fibers,
        ));
        Ok(LayeredTissue { layers, refractive_index: self.get("refractive_index")?, below: Below::Black })
    }

    fn tooth(&self, find: &dyn Fn(&str) -> Option<Arc<Fluorophore>>) -> Result<LayeredTissue, TissueError> {
        let layer = |name: &str, fluorophore: &str, anisotropy| {
            let of = |parameter: &str| format!("{name}_{parameter}");
            Ok(TissueLayer {
                name: name.to_string(),
                thickness_um: self.get(&of("thickness_um"))?,
                scattering: self.power_law(
                    &of("scattering_per_mm"),
                    543.0,
                    &of("scattering_power"),
                    anisotropy,
                )?,
                absorption: vec![self.background(&of("background_per_mm"))?],
                fluorophores: self.fluorescence(find, &[(fluorophore, &format!("{fluorophore}_per_mm"))])?,
                refractive_index: Some(self.get(&of("refractive_index"))?),
            })
        };
        let layers = vec![layer("enamel", "enamel", 0.96)?, layer("dentin", "dentin", 0.93)?];
        Ok(LayeredTissue {
            layers,
            refractive_index: self.get("enamel_refractive_index")?,
            below: Below::Black,
        })
    }
}

impl Structure {
    fn parameters(self) -> &'static [SiteParameter] {
        match self {
            Self::Soft => SOFT,
            Self::Tooth => TOOTH,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectral::{BandTerm, LogNormalBand, Stokes, YieldUnit};
    use crate::tissue::{DiscreteOrdinates, Incidence};

    fn any(name: &str) -> Option<Arc<Fluorophore>> {
        let band = |peak_nm| LogNormalBand { peak_nm, fwhm_per_cm: 4000.0, skew: 1.0, weight: 1.0 };
        let terms = [BandTerm { excitation: vec![band(400.0)], emission: vec![band(520.0)] }];
        let range = (350.0, 450.0);
        Some(Arc::new(Fluorophore::from_bands(
            name,
            name,
            &terms,
            YieldUnit::Photons,
            Stokes::Mask,
            1e-3,
            range,
            (450.0, 700.0),
            "",
        )))
    }

    #[test]
    fn every_site_is_a_tissue_and_states_all_its_parameters() {
        for name in Site::names() {
            let site = Site::named(name).unwrap();
            let tissue = site.tissue(&any).unwrap();
            assert!(tissue.layers.len() >= 2, "{name}");
            assert!(site.fluorophores().iter().all(|name| Site::quantum_yield(name).is_some()), "{name}");
            let assumed = |(p, _): (&SiteParameter, f64)| site.basis(p.name).0 != Basis::Fitted;
            assert_eq!(site.parameters().all(assumed), site.is_assumed(), "{name}");
            let complete = SITES.iter().find(|s| s.structure == site.known.structure).unwrap();
            assert_eq!(complete.values.len(), site.known.structure.parameters().len(), "{name}");
            for layer in &tissue.layers {
                for held in &layer.fluorophores {
                    let fluorophore = held.fluorophore.name.as_str();
                    assert!(site.fluorophores().contains(&fluorophore));
                    let parameter = site.strength_parameter(&layer.name, fluorophore).unwrap();
                    assert_eq!(site.get(parameter).unwrap(), held.strength_per_mm, "{name}: {parameter}");
                }
            }
        }
    }

    /// Diffuse reflectance of the fitted tongue above its surface, 5 mm deep, with nothing and with air under it, by
    /// another program with 64 directions; the solver with 16 of them is within 1e-4, the rest is rounding.
    #[test]
    fn the_tongue_has_its_published_reflectance() {
        let black =
            [0.1290, 0.1235, 0.1501, 0.1760, 0.1479, 0.2638, 0.3979, 0.4628].map(|r| (Below::Black, r));
        let air = [(Below::Index(1.0), 0.3983), (Below::Index(1.0), 0.4655)];
        let nm = [405.0, 420.0, 450.0, 500.0, 560.0, 600.0, 635.0, 700.0, 635.0, 700.0];
        let mut tissue = Site::named("dorsal_tongue").unwrap().tissue(&any).unwrap();
        for (nm, (below, want)) in nm.into_iter().zip(black.into_iter().chain(air)) {
            tissue.below = below;
            let field = DiscreteOrdinates::DIFFUSE.solve(&tissue.optics(nm), Incidence::Lambertian).unwrap();
            assert!((field.reflectance - want).abs() < 1.5e-4, "{nm} nm: {}", field.reflectance);
        }
    }

    #[test]
    fn states_change_what_they_say() {
        let mut site = Site::named("dorsal_tongue").unwrap();
        site.apply(TissueState::Hyperemia).unwrap();
        assert!((site.get("superficial_blood_fraction").unwrap() - 0.03).abs() < 1e-12);
        let mut site = Site::named("dorsal_tongue").unwrap();
        site.apply(TissueState::Dysplasia).unwrap();
        assert!((site.get("epithelium_thickness_um").unwrap() - 272.0).abs() < 1e-9);
        let said = Site::named("tooth").unwrap().apply(TissueState::Inflammation).unwrap_err().to_string();
        assert!(said.starts_with("tissue 'tooth' has no parameter"), "{said}");
    }

    #[test]
    fn mistakes_are_explained() {
        let said = Site::named("tounge").unwrap_err().to_string();
        assert!(said.contains("no tissue 'tounge'") && said.contains("dorsal_tongue, "), "{said}");
        let mut site = Site::named("lip").unwrap();
        let said = site.set("oxygen_saturation", 86.4).unwrap_err().to_string();
        assert!(said.contains("tissue 'lip': oxygen_saturation is 86.4, outside 0 to 1"), "{said}");
        let said = site.set("saturation", 0.8).unwrap_err().to_string();
        assert!(said.contains("no parameter 'saturation'") && said.contains("oxygen_saturation"), "{said}");
        let said = site.tissue(&|_| None).unwrap_err().to_string();
        assert!(said.contains("tissue 'lip' holds the fluorophore 'keratin'"), "{said}");
    }

    #[test]
    fn melanin_lies_in_the_basal_layer() {
        let mut site = Site::named("lip").unwrap();
        assert!(site.tissue(&any).unwrap().layer("basal layer").is_none());
        site.set("melanin_fraction", 0.1).unwrap();
        let tissue = site.tissue(&any).unwrap();
        let basal = tissue.layer("basal layer").unwrap();
        assert_eq!(basal.thickness_um, BASAL_UM);
        let epithelium = tissue.layer("epithelium").unwrap();
        let more = basal.absorption_per_mm(500.0) - epithelium.absorption_per_mm(500.0);
        assert!((more - 5.19).abs() < 1e-9, "{more}");
        assert!((epithelium.thickness_um - 580.0).abs() < 1e-9);
    }
}
