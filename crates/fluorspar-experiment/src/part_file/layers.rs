//! Files that describe plane layers by their optical properties at one wavelength, or at two with fluorescence between them.

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::{ExperimentError, Place, steps};
use crate::read::read_sections;
use crate::resolve::context::{Context, Resolved};
use crate::schema::FormatVersion;
use fluorspar::tissue::{
    ANISOTROPY, COEFFICIENT_PER_MM, OpticalLayer, OpticalStack, REFRACTIVE_INDEX, THICKNESS_MM,
};

/// Plane layers upon each other, the uppermost first, with the media above and below.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayersFile {
    /// Version of the form of this file: 1.
    pub format: FormatVersion,
    /// Name for people. Default: empty.
    #[serde(default)]
    pub title: String,
    /// Description and caveats. Default: empty.
    #[serde(default)]
    pub description: String,
    /// Where the numbers come from. Default: empty.
    #[serde(default)]
    pub source: String,
    /// Refractive index of the medium above, where the light comes from, 1 to 3. Default 1.
    #[serde(default = "air")]
    pub index_above: f64,
    /// Refractive index of the medium below, from which nothing returns, 1 to 3. Default 1.
    #[serde(default = "air")]
    pub index_below: f64,
    /// The layers, at least one.
    #[serde(default)]
    pub layer: Vec<LayerSection>,
}

fn air() -> f64 {
    1.0
}

/// One homogeneous layer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayerSection {
    /// Name, unique in the file.
    pub name: String,
    /// Thickness, mm, 1e-6 to 10000, which stands for a half-space.
    pub thickness_mm: f64,
    /// Refractive index, 1 to 3.
    pub refractive_index: f64,
    /// Absorption coefficient (natural logarithm), 1/mm, 0 to 10000. It holds that of the fluorophores.
    pub absorption_per_mm: f64,
    /// Scattering coefficient, 1/mm, 0 to 10000; not reduced by the anisotropy.
    pub scattering_per_mm: f64,
    /// Anisotropy factor of Henyey and Greenstein, the mean cosine of the scattering angle, -0.99 to 0.995.
    pub anisotropy: f64,
    /// Fluorescence, and the optical properties at its wavelength. All layers have it, or none.
    pub emission: Option<LayerEmissionSection>,
}

/// Fluorescence of a layer, and its optical properties at the wavelength of the emission.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayerEmissionSection {
    /// Absorption coefficient of the fluorophores at the excitation times their quantum yield, 1/mm, 0 to the absorption
    /// of the layer. Default 0.
    #[serde(default)]
    pub strength_per_mm: f64,
    /// Absorption coefficient, 1/mm, 0 to 10000.
    pub absorption_per_mm: f64,
    /// Scattering coefficient, 1/mm, 0 to 10000.
    pub scattering_per_mm: f64,
    /// Anisotropy factor, -0.99 to 0.995. Default: that of the excitation.
    pub anisotropy: Option<f64>,
    /// Refractive index, 1 to 3. Default: that of the excitation.
    pub refractive_index: Option<f64>,
}

/// Layers read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct ResolvedLayers {
    /// Name for people; may be empty.
    pub title: String,
    /// Names of the layers.
    pub names: Vec<String>,
    /// Optical properties, of the excitation where there is fluorescence.
    pub stack: OpticalStack,
    /// Fluorescence, where the layers state it.
    pub emission: Option<ResolvedEmission>,
}

/// Fluorescence of layers.
#[derive(Clone, Debug, PartialEq)]
pub struct ResolvedEmission {
    /// Optical properties at the wavelength of the emission.
    pub stack: OpticalStack,
    /// Absorption times quantum yield of the fluorophores of each layer, 1/mm.
    pub strengths_per_mm: Vec<f64>,
}

/// Reads a file of layers. Overrides are as for an experiment: `layer.epithelium.thickness_mm=0.2`.
///
/// # Errors
/// The first defect found.
pub fn parse_layers(
    text: &str,
    source_name: &str,
    base_dir: &Path,
    overrides: &[String],
) -> Result<ResolvedLayers, ExperimentError> {
    let (document, file) = read_sections::<LayersFile>(text, source_name, base_dir, overrides)?;
    let context = Context::new(&document);
    if file.layer.is_empty() {
        return context
            .fail(&steps!["layer"], "there is no layer; add a [[layer]] section, the uppermost first");
    }
    let index_above = context.within(&steps!["index_above"], file.index_above, REFRACTIVE_INDEX, "")?;
    let index_below = context.within(&steps!["index_below"], file.index_below, REFRACTIVE_INDEX, "")?;
    let stack_of = |layers| OpticalStack { layers, index_above, index_below };
    let (mut layers, mut emissions) = (Vec::new(), Vec::new());
    for (number, section) in file.layer.iter().enumerate() {
        let at = steps!["layer", number];
        context.unique_name(
            &at,
            &section.name,
            file.layer[..number].iter().map(|other| other.name.as_str()),
        )?;
        layers.push(layer(&context, &at, section)?);
        emissions.extend(section.emission.as_ref().map(|_| number));
    }
    let emission = match emissions.len() {
        0 => None,
        all if all == layers.len() => Some(emission(&context, &file.layer, stack_of)?),
        _ => {
            let lacks = file.layer.iter().position(|section| section.emission.is_none()).unwrap_or(0);
            let message = "other layers have a [layer.emission] table, this one has none; emission passes all layers, so give \
                           each its properties there (strength_per_mm = 0 where nothing fluoresces)";
            return context.fail(&steps!["layer", lacks], message);
        }
    };
    let names = file.layer.into_iter().map(|section| section.name).collect();
    Ok(ResolvedLayers { title: file.title, names, stack: stack_of(layers), emission })
}

fn layer(context: &Context<'_>, at: &Place, section: &LayerSection) -> Resolved<OpticalLayer> {
    let field = |name: &'static str, value, range, unit| context.within(&at.field(name), value, range, unit);
    Ok(OpticalLayer {
        thickness_mm: field("thickness_mm", section.thickness_mm, THICKNESS_MM, "mm (1 mm = 1000 µm)")?,
        absorption_per_mm: coefficient(context, at, "absorption_per_mm", section.absorption_per_mm)?,
        scattering_per_mm: coefficient(context, at, "scattering_per_mm", section.scattering_per_mm)?,
        anisotropy: field("anisotropy", section.anisotropy, ANISOTROPY, "")?,
        refractive_index: field("refractive_index", section.refractive_index, REFRACTIVE_INDEX, "")?,
    })
}

fn coefficient(context: &Context<'_>, at: &Place, name: &'static str, value: f64) -> Resolved<f64> {
    context.within(&at.field(name), value, COEFFICIENT_PER_MM, "per mm (1/cm = 0.1/mm)")
}

/// Properties at the wavelength of the emission, which all layers have.
fn emission(
    context: &Context<'_>,
    sections: &[LayerSection],
    stack_of: impl Fn(Vec<OpticalLayer>) -> OpticalStack,
) -> Resolved<ResolvedEmission> {
    let (mut layers, mut strengths_per_mm) = (Vec::new(), Vec::new());
    for (number, section) in sections.iter().enumerate() {
        let Some(emission) = &section.emission else { continue };
        let at = steps!["layer", number, "emission"];
        let (anisotropy, index) = (emission.anisotropy, emission.refractive_index);
        layers.push(OpticalLayer {
            thickness_mm: section.thickness_mm,
            absorption_per_mm: coefficient(context, &at, "absorption_per_mm", emission.absorption_per_mm)?,
            scattering_per_mm: coefficient(context, &at, "scattering_per_mm", emission.scattering_per_mm)?,
            anisotropy: context.within(
                &at.field("anisotropy"),
                anisotropy.unwrap_or(section.anisotropy),
                ANISOTROPY,
                "",
            )?,
            refractive_index: context.within(
                &at.field("refractive_index"),
                index.unwrap_or(section.refractive_index),
                REFRACTIVE_INDEX,
                "",
            )?,
        });
        let most =
            "per mm: it is a part of the absorption_per_mm of the layer, times a quantum yield of at most 1";
        let range = [0.0, section.absorption_per_mm];
        strengths_per_mm.push(context.within(
            &at.field("strength_per_mm"),
            emission.strength_per_mm,
            range,
            most,
        )?);
    }
    Ok(ResolvedEmission { stack: stack_of(layers), strengths_per_mm })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: &str = "format = 1\ntitle = \"skin\"\nindex_below = 1.4\n\
        [[layer]]\nname = \"epidermis\"\nthickness_mm = 0.1\nrefractive_index = 1.4\nabsorption_per_mm = 0.3\n\
        scattering_per_mm = 30\nanisotropy = 0.9\n\
        [[layer]]\nname = \"dermis\"\nthickness_mm = 2\nrefractive_index = 1.38\nabsorption_per_mm = 0.2\n\
        scattering_per_mm = 20\nanisotropy = 0.8\n";

    fn parsed(text: &str, overrides: &[&str]) -> Result<ResolvedLayers, String> {
        let overrides: Vec<String> = overrides.iter().map(|o| o.to_string()).collect();
        parse_layers(text, "skin.toml", Path::new("."), &overrides).map_err(|error| error.to_string())
    }

    #[test]
    fn layers_are_read_with_their_defaults() {
        let layers = parsed(TWO, &["layer.dermis.thickness_mm=3"]).unwrap();
        assert_eq!((layers.title.as_str(), layers.names.join(" ")), ("skin", "epidermis dermis".into()));
        assert_eq!((layers.stack.index_above, layers.stack.index_below), (1.0, 1.4));
        assert_eq!(
            (layers.stack.layers[1].thickness_mm, layers.stack.layers[1].refractive_index),
            (3.0, 1.38)
        );
        assert_eq!(layers.emission, None);

        let tables =
            "[layer.emission]\nabsorption_per_mm = 0.1\nscattering_per_mm = 15\nstrength_per_mm = 0.05\n";
        let (first, second) = TWO.split_at(TWO.rfind("[[layer]]").unwrap());
        let emission = parsed(&format!("{first}{tables}{second}{tables}"), &[]).unwrap().emission.unwrap();
        assert_eq!(emission.strengths_per_mm, [0.05, 0.05]);
        assert_eq!(
            (emission.stack.layers[0].anisotropy, emission.stack.layers[1].refractive_index),
            (0.9, 1.38)
        );
        let said = parsed(&format!("{TWO}{tables}"), &[]).unwrap_err();
        assert!(said.contains("layer[0]") && said.contains("this one has none"), "{said}");
    }

    #[test]
    fn wrong_layers_are_refused_with_place_and_range() {
        let strong =
            "[layer.emission]\nabsorption_per_mm = 0.1\nscattering_per_mm = 15\nstrength_per_mm = 0.4\n";
        for (text, overrides, message) in [
            ("format = 1\n", &[] as &[&str], "there is no layer; add a [[layer]] section"),
            (TWO, &["layer.dermis.thickness_mm=0"], "must be between 1e-6 and 10000 mm (1 mm = 1000 µm)"),
            (
                TWO,
                &["layer.dermis.absorption_per_mm=-1"],
                "must be between 0 and 10000 per mm (1/cm = 0.1/mm)",
            ),
            (TWO, &["layer.dermis.anisotropy=1"], "must be between -0.99 and 0.995"),
            (TWO, &["index_below=0"], "must be between 1 and 3"),
            (TWO, &["layer.dermis.name=\"epidermis\""], "an earlier entry has this name"),
            (TWO, &["layer.dermis.thicknes_mm=1"], "thickness_mm"),
            (
                &TWO.replace(
                    "[[layer]]\nname = \"dermis\"",
                    &format!("{strong}[[layer]]\nname = \"dermis\""),
                ),
                &[],
                "this one has none",
            ),
            (
                &format!("{}{strong}", TWO.split_at(TWO.rfind("[[layer]]").unwrap()).0),
                &[],
                "must be between 0 and 0.3 per mm",
            ),
        ] {
            let said = parsed(text, overrides).unwrap_err();
            assert!(said.contains(message) && said.contains("skin.toml") | said.contains("--set"), "{said}");
        }
    }
}
