//! Three sites for tests of the physics, and tests of sites.

use std::sync::Arc;

use super::site_layers::BASAL_UM;
use super::*;
use crate::spectral::{BandTerm, Fluorophore, LogNormalBand, Stokes, YieldUnit};

const TONGUE: MucosaParameters = MucosaParameters {
    biofilm_thickness_um: 20.0,
    keratin_thickness_um: 40.0,
    epithelium_thickness_um: 160.0,
    superficial_stroma_thickness_um: 300.0,
    deep_stroma_thickness_um: 5000.0,
    background_per_mm: 0.1544,
    background_slope_per_nm: 0.00835,
    keratin_scattering_per_mm: 17.0,
    epithelium_scattering_per_mm: 5.5,
    epithelium_scattering_power: 2.0,
    stroma_reduced_scattering_per_mm: 2.246,
    stroma_scattering_power: 1.205,
    superficial_blood_fraction: 0.003,
    superficial_vessel_radius_um: 4.0,
    deep_blood_fraction: 0.1118,
    deep_vessel_radius_um: 23.5,
    oxygen_saturation: 0.933,
    hemoglobin_g_per_l: 150.0,
    melanin_fraction: 0.0,
    refractive_index: 1.4,
    biofilm_porphyrin_per_mm: 1.525e-3,
    biofilm_chlorophyll_per_mm: 1.835e-3,
    keratin_per_mm: 5.16e-3,
    nadh_per_mm: 1.0e-4,
    fad_per_mm: 3.0e-5,
    superficial_collagen_per_mm: 3.218e-3,
    deep_collagen_per_mm: 3.218e-3,
    superficial_elastin_per_mm: 0.0,
    deep_elastin_per_mm: 0.0,
    superficial_lipopigment_per_mm: 4.45e-4,
    deep_lipopigment_per_mm: 4.45e-4,
    flavin_aggregate_per_mm: 0.0,
};

fn values(parameters: &[SiteParameter], values: Vec<f64>) -> Vec<SiteValue> {
    let named = parameters.iter().zip(values);
    named
        .map(|(parameter, value)| SiteValue {
            parameter: parameter.name.into(),
            value,
            basis: Basis::Assumed,
            source: String::new(),
        })
        .collect()
}

fn described(name: &str) -> SiteDescription {
    SiteDescription {
        name: name.into(),
        title: name.into(),
        description: String::new(),
        source: String::new(),
        surroundings: Surroundings {
            indirect: [0.17, 0.4],
            teeth: [0.055, 0.5],
            source: String::new(),
            assumed: true,
        },
    }
}

fn mucosa(name: &str, parameters: MucosaParameters) -> Site {
    let values = values(MucosaParameters::PARAMETERS, parameters.values());
    Site::new(described(name), SiteStructure::Mucosa, values).unwrap()
}

/// A tongue, as that of the catalogue.
pub(crate) fn tongue() -> Site {
    mucosa("tongue", TONGUE)
}

/// A lip, as that of the catalogue.
pub(crate) fn lip() -> Site {
    mucosa(
        "lip",
        MucosaParameters {
            keratin_thickness_um: 15.0,
            epithelium_thickness_um: 600.0,
            superficial_stroma_thickness_um: 200.0,
            background_per_mm: 0.0827,
            superficial_blood_fraction: 0.00613,
            deep_blood_fraction: 0.0968,
            deep_vessel_radius_um: 8.76,
            oxygen_saturation: 0.868,
            biofilm_porphyrin_per_mm: 0.0,
            biofilm_chlorophyll_per_mm: 0.0,
            keratin_per_mm: 0.0301,
            nadh_per_mm: 1.8e-4,
            fad_per_mm: 0.0,
            superficial_collagen_per_mm: 0.0,
            deep_collagen_per_mm: 9.39e-3,
            deep_elastin_per_mm: 7.37e-3,
            superficial_lipopigment_per_mm: 0.0,
            deep_lipopigment_per_mm: 4.5e-4,
            ..TONGUE
        },
    )
}

/// A tooth, as that of the catalogue.
pub(crate) fn tooth() -> Site {
    let parameters = ToothParameters {
        enamel_thickness_um: 1000.0,
        dentin_thickness_um: 3000.0,
        enamel_scattering_per_mm: 6.6,
        enamel_scattering_power: 1.0,
        dentin_scattering_per_mm: 35.0,
        dentin_scattering_power: 0.0,
        enamel_background_per_mm: 0.077,
        dentin_background_per_mm: 0.257,
        background_slope_per_nm: 0.0186,
        enamel_refractive_index: 1.63,
        dentin_refractive_index: 1.54,
        biofilm_porphyrin_per_mm: 0.0,
        enamel_per_mm: 6.4e-3,
        dentin_per_mm: 1.92e-2,
    };
    let values = values(ToothParameters::PARAMETERS, parameters.values());
    Site::new(described("tooth"), SiteStructure::Tooth, values).unwrap()
}

pub(crate) fn any(name: &str) -> Option<Arc<Fluorophore>> {
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
fn strengths_of_layers_have_their_parameters() {
    for site in [tongue(), lip(), tooth()] {
        let name = site.name();
        let tissue = site.tissue(&any).unwrap();
        assert!(tissue.layers.len() >= 2, "{name}");
        assert!(site.fluorophores().iter().all(|name| Site::quantum_yield(name).is_some()), "{name}");
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
    let black = [0.1290, 0.1235, 0.1501, 0.1760, 0.1479, 0.2638, 0.3979, 0.4628].map(|r| (Below::Black, r));
    let air = [(Below::Index(1.0), 0.3983), (Below::Index(1.0), 0.4655)];
    let nm = [405.0, 420.0, 450.0, 500.0, 560.0, 600.0, 635.0, 700.0, 635.0, 700.0];
    let mut tissue = tongue().tissue(&any).unwrap();
    for (nm, (below, want)) in nm.into_iter().zip(black.into_iter().chain(air)) {
        tissue.below = below;
        let field = DiscreteOrdinates::DIFFUSE.solve(&tissue.optics(nm), Incidence::Lambertian).unwrap();
        assert!((field.reflectance - want).abs() < 1.5e-4, "{nm} nm: {}", field.reflectance);
    }
}

#[test]
fn states_change_what_they_say() {
    let pairs = |pairs: &[(&str, f64)]| pairs.iter().map(|(name, value)| ((*name).into(), *value)).collect();
    let state = TissueState {
        factors: pairs(&[("superficial_blood_fraction", 10.0)]),
        values: pairs(&[("keratin_thickness_um", 240.0)]),
        gray_per_mm: pairs(&[("superficial stroma", 2.0)]),
        ..TissueState::default()
    };
    let absorption = |site: &Site| {
        site.tissue(&any).unwrap().layer("superficial stroma").unwrap().absorption_per_mm(700.0)
    };
    for (share, blood, keratin) in [(0.0, 0.003, 40.0), (0.5, 0.0165, 140.0), (1.0, 0.03, 240.0)] {
        let [mut site, mut red] = [tongue(), tongue()];
        site.apply_share(&state, share).unwrap();
        assert!((site.get("superficial_blood_fraction").unwrap() - blood).abs() < 1e-12);
        assert!((site.get("keratin_thickness_um").unwrap() - keratin).abs() < 1e-9);
        red.set("superficial_blood_fraction", blood).unwrap();
        assert!((absorption(&site) - absorption(&red) - 2.0 * share).abs() < 1e-9);
    }
    let gray = TissueState { gray_per_mm: state.gray_per_mm.clone(), ..TissueState::default() };
    for state in [&state, &gray] {
        let said = tooth().apply(state).unwrap_err().to_string();
        assert!(
            said.starts_with("tissue 'tooth' has no 'superficial") && said.ends_with("of mucosa"),
            "{said}"
        );
    }
}

#[test]
fn mistakes_are_explained() {
    let mut site = lip();
    let said = site.set("oxygen_saturation", 86.4).unwrap_err().to_string();
    assert!(said.contains("tissue 'lip': oxygen_saturation is 86.4, outside 0 to 1"), "{said}");
    let said = site.set("saturation", 0.8).unwrap_err().to_string();
    assert!(
        said.contains("no parameter 'saturation'; did you mean \"oxygen_saturation\"? It has "),
        "{said}"
    );
    let said = site.tissue(&|_| None).unwrap_err().to_string();
    assert!(said.contains("tissue 'lip' holds the fluorophore 'keratin'"), "{said}");
}

#[test]
fn melanin_lies_in_the_basal_layer() {
    let mut site = lip();
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

#[test]
fn every_parameter_needs_one_value() {
    let all = values(MucosaParameters::PARAMETERS, TONGUE.values());
    let made = |values: &[SiteValue]| {
        let site = Site::new(described("mine"), SiteStructure::Mucosa, values.to_vec());
        site.map(|_| ()).map_err(|error| error.to_string())
    };
    assert_eq!(made(&all), Ok(()));
    let said = made(&all[2..]).unwrap_err();
    assert!(
        said.contains("'mine' lacks values of biofilm_thickness_um, keratin_thickness_um; give"),
        "{said}"
    );
    let said = made(&[all.as_slice(), &all[..1]].concat()).unwrap_err();
    assert!(said.contains("gives biofilm_thickness_um twice"), "{said}");
}
