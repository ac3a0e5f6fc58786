//! Layers of mucosa, skin and teeth from the parameters of a site.

use std::sync::Arc;

use super::chromophore::{Blood, Chromophore};
use super::layered_tissue::{Below, LayeredTissue, TissueFluorophore, TissueLayer};
use super::scattering::{LayerScattering, ScatteringCoefficient};
use super::site_parameter::{MucosaParameters, ToothParameters};
use super::tissue_error::TissueError;
use crate::spectral::Fluorophore;

/// Thickness of the basal layer, which holds the melanin, um.
pub(super) const BASAL_UM: f64 = 20.0;
/// Wavelength at which strengths are given, nm.
const STRENGTH_NM: f64 = 405.0;

/// Gives a fluorophore by its name.
type Find<'a> = dyn Fn(&str) -> Result<Arc<Fluorophore>, TissueError> + 'a;

/// Fluorophores of a layer by name and strength, 1/mm. Those of strength 0 are left out.
fn fluorescence(find: &Find<'_>, contents: &[(&str, f64)]) -> Result<Vec<TissueFluorophore>, TissueError> {
    let held = contents.iter().filter(|(_, strength_per_mm)| *strength_per_mm > 0.0);
    held.map(|&(name, strength_per_mm)| {
        Ok(TissueFluorophore {
            fluorophore: find(name)?,
            strength_per_mm,
            at_nm: STRENGTH_NM,
            // Its absorption is part of the background, which was fitted to reflectance.
            quantum_yield: None,
        })
    })
    .collect()
}

fn background(absorption_per_mm: f64, slope_per_nm: f64) -> Chromophore {
    Chromophore::Background { absorption_per_mm, at_nm: 420.0, slope_per_nm }
}

fn power_law(scattering_per_mm: f64, at_nm: f64, power: f64, anisotropy: f64) -> LayerScattering {
    let coefficient = ScatteringCoefficient::PowerLaw { scattering_per_mm, at_nm, power };
    LayerScattering { coefficient, anisotropy }
}

fn layer(
    name: &str,
    thickness_um: f64,
    scattering: &LayerScattering,
    absorption: Vec<Chromophore>,
    fluorophores: Vec<TissueFluorophore>,
) -> TissueLayer {
    let (name, scattering) = (name.to_string(), scattering.clone());
    TissueLayer { name, thickness_um, scattering, absorption, fluorophores, refractive_index: None }
}

impl MucosaParameters {
    /// Fluorophores that the layers may hold.
    pub(super) const FLUOROPHORES: &'static [&'static str] = &[
        "biofilm_porphyrin",
        "biofilm_chlorophyll",
        "keratin",
        "nadh",
        "fad",
        "collagen",
        "elastin",
        "lipopigment",
        "flavin_aggregate",
    ];

    /// Layers that there may be.
    pub(super) const LAYERS: &'static [&'static str] =
        &["biofilm", "keratin", "epithelium", "basal layer", "superficial stroma", "deep stroma"];

    /// All layers; `is_added` says of which something is added to, so that they are layers of their own.
    pub(super) fn tissue(
        &self,
        find: &Find<'_>,
        is_added: &dyn Fn(&str) -> bool,
    ) -> Result<LayeredTissue, TissueError> {
        let mut layers = Vec::with_capacity(6);
        self.add_keratin(find, is_added("biofilm"), &mut layers)?;
        self.add_epithelium(find, is_added("basal layer"), &mut layers)?;
        self.add_stroma(find, &mut layers)?;
        Ok(LayeredTissue { layers, refractive_index: self.refractive_index, below: Below::Black })
    }

    pub(super) fn largest_biofilm_um(&self) -> f64 {
        0.5 * self.keratin_thickness_um
    }

    fn background(&self) -> Chromophore {
        background(self.background_per_mm, self.background_slope_per_nm)
    }

    fn cell_scattering(&self, scattering_per_mm: f64) -> LayerScattering {
        power_law(scattering_per_mm, 420.0, self.epithelium_scattering_power, 0.97)
    }

    fn add_keratin(
        &self,
        find: &Find<'_>,
        has_film: bool,
        layers: &mut Vec<TissueLayer>,
    ) -> Result<(), TissueError> {
        let scattering = self.cell_scattering(self.keratin_scattering_per_mm);
        let keratin = fluorescence(find, &[("keratin", self.keratin_per_mm)])?;
        let mut film = fluorescence(
            find,
            &[
                ("biofilm_porphyrin", self.biofilm_porphyrin_per_mm),
                ("biofilm_chlorophyll", self.biofilm_chlorophyll_per_mm),
            ],
        )?;
        let mut keratin_um = self.keratin_thickness_um;
        let film_um = self.biofilm_thickness_um.min(self.largest_biofilm_um());
        // A biofilm without emitters of its own is keratin.
        if film_um >= 0.1 && (has_film || !film.is_empty()) {
            film.extend(keratin.clone());
            layers.push(layer("biofilm", film_um, &scattering, vec![self.background()], film));
            keratin_um -= film_um;
        }
        layers.push(layer("keratin", keratin_um, &scattering, vec![self.background()], keratin));
        Ok(())
    }

    fn add_epithelium(
        &self,
        find: &Find<'_>,
        has_basal: bool,
        layers: &mut Vec<TissueLayer>,
    ) -> Result<(), TissueError> {
        let scattering = self.cell_scattering(self.epithelium_scattering_per_mm);
        let cells = fluorescence(
            find,
            &[
                ("nadh", self.nadh_per_mm),
                ("fad", self.fad_per_mm),
                ("flavin_aggregate", self.flavin_aggregate_per_mm),
            ],
        )?;
        let volume_fraction = self.melanin_fraction;
        let whole_um = self.epithelium_thickness_um;
        let has_basal = has_basal || volume_fraction > 0.0;
        let basal_um = if has_basal { BASAL_UM.min(0.5 * whole_um) } else { 0.0 };
        let absorption = vec![self.background()];
        layers.push(layer("epithelium", whole_um - basal_um, &scattering, absorption, cells.clone()));
        if has_basal {
            let absorption = vec![self.background(), Chromophore::Melanin { volume_fraction }];
            layers.push(layer("basal layer", basal_um, &scattering, absorption, cells));
        }
        Ok(())
    }

    fn stroma_scattering(&self) -> LayerScattering {
        let coefficient = ScatteringCoefficient::ReducedPowerLaw {
            reduced_per_mm: self.stroma_reduced_scattering_per_mm,
            at_nm: 500.0,
            power: self.stroma_scattering_power,
        };
        LayerScattering { coefficient, anisotropy: 0.88 }
    }

    fn blood(&self, volume_fraction: f64, vessel_radius_um: f64) -> Chromophore {
        let (saturation, hemoglobin_g_per_l) = (self.oxygen_saturation, self.hemoglobin_g_per_l);
        Chromophore::Blood(Blood { volume_fraction, saturation, hemoglobin_g_per_l, vessel_radius_um })
    }

    fn add_stroma(&self, find: &Find<'_>, layers: &mut Vec<TissueLayer>) -> Result<(), TissueError> {
        let scattering = self.stroma_scattering();
        let thickness_um = self.superficial_stroma_thickness_um;
        let blood = self.blood(self.superficial_blood_fraction, self.superficial_vessel_radius_um);
        let fibers = [
            ("collagen", self.superficial_collagen_per_mm),
            ("elastin", self.superficial_elastin_per_mm),
            ("lipopigment", self.superficial_lipopigment_per_mm),
        ];
        let (absorption, fibers) = (vec![self.background(), blood], fluorescence(find, &fibers)?);
        layers.push(layer("superficial stroma", thickness_um, &scattering, absorption, fibers));

        let thickness_um = self.deep_stroma_thickness_um;
        let blood = self.blood(self.deep_blood_fraction, self.deep_vessel_radius_um);
        let fibers = [
            ("collagen", self.deep_collagen_per_mm),
            ("elastin", self.deep_elastin_per_mm),
            ("lipopigment", self.deep_lipopigment_per_mm),
        ];
        let (absorption, fibers) = (vec![self.background(), blood], fluorescence(find, &fibers)?);
        layers.push(layer("deep stroma", thickness_um, &scattering, absorption, fibers));
        Ok(())
    }
}

impl ToothParameters {
    /// Fluorophores that the layers may hold.
    pub(super) const FLUOROPHORES: &'static [&'static str] = &["biofilm_porphyrin", "enamel", "dentin"];
    /// The layers.
    pub(super) const LAYERS: &'static [&'static str] = &["enamel", "dentin"];

    /// Enamel on dentin.
    pub(super) fn tissue(&self, find: &Find<'_>) -> Result<LayeredTissue, TissueError> {
        let enamel = layer(
            "enamel",
            self.enamel_thickness_um,
            &power_law(self.enamel_scattering_per_mm, 633.0, self.enamel_scattering_power, 0.68),
            vec![background(self.enamel_background_per_mm, self.background_slope_per_nm)],
            fluorescence(
                find,
                &[("enamel", self.enamel_per_mm), ("biofilm_porphyrin", self.biofilm_porphyrin_per_mm)],
            )?,
        );
        let dentin = layer(
            "dentin",
            self.dentin_thickness_um,
            &power_law(self.dentin_scattering_per_mm, 543.0, self.dentin_scattering_power, 0.93),
            vec![background(self.dentin_background_per_mm, self.background_slope_per_nm)],
            fluorescence(find, &[("dentin", self.dentin_per_mm)])?,
        );
        let layers = vec![
            TissueLayer { refractive_index: Some(self.enamel_refractive_index), ..enamel },
            TissueLayer { refractive_index: Some(self.dentin_refractive_index), ..dentin },
        ];
        Ok(LayeredTissue { layers, refractive_index: self.enamel_refractive_index, below: Below::Black })
    }
}
