//! Spectra and textures as they are written in a file: a number, a name, a path or a table.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use crate::anatomy::{SurfaceMap, Tissue};
use crate::spectral::CurveModel;

/// A spectrum: a constant, a name of the catalogue, a CSV file or an equation.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum SpectrumReference {
    /// The same value at every wavelength.
    Constant(f64),
    /// A name of the catalogue, or the path of a CSV file (with a slash or the ending `.csv`) whose first column of
    /// values is used.
    Name(String),
    /// One column of a CSV file.
    Table(SpectrumTable),
    /// An equation, as in the files of the catalogue: `{ kind = "led", peak_nm = 385.0, ... }`.
    Model(CurveModel),
}

/// One column of a CSV file with wavelengths in nm in its first column.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpectrumTable {
    /// Path of the file, relative to the experiment file.
    pub csv: String,
    /// Header of the column. Default: the only or first one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub column: Option<String>,
    /// Factor on the values, for instance 0.01 for percent. Default 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
}

/// Diffuse reflectance: one spectrum, or a list of spectra with weights that may vary over the surface.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum ReflectanceReference {
    /// One spectrum.
    Spectrum(SpectrumReference),
    /// A weighted sum.
    Sum(Vec<ReflectanceTermSection>),
}

/// One term of a reflectance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReflectanceTermSection {
    /// Reflectance spectrum, 0 to 1.
    pub spectrum: SpectrumReference,
    /// Factor over the surface. Default 1.
    #[serde(default = "one")]
    pub weight: TextureReference,
}

fn one() -> TextureReference {
    TextureReference::Constant(1.0)
}

/// A value over a surface: a number or a map.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum TextureReference {
    /// The same everywhere.
    Constant(f64),
    /// A map over texture coordinates.
    Map(Box<TextureTable>),
}

/// A map over texture coordinates: exactly one of `image`, `checker`, `noise`, `dorsal_tongue`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TextureTable {
    /// Path of a grey PNG image, relative to the experiment file: black is `low`, white is `high`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<String>,
    /// Whether the image is stored with the sRGB curve; otherwise its numbers are linear. Default false.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub srgb: Option<bool>,
    /// A checkerboard: fields along u and v, 1 to 10 000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub checker: Option<[u32; 2]>,
    /// Smooth noise: cells along u and v, 0.1 to 10 000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<[f64; 2]>,
    /// Porphyrin on the back of the tongue: most along the midline and far back, none at the tip and the sides.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dorsal_tongue: Option<DorsalTongueMap>,
    /// A map of the mouth's anatomy, on the texture coordinates of its parts: `redness` (vessels, margins),
    /// `fungiform` (papillae of the dorsal tongue), `pallor` (keratin, coating), `porphyrin` (dorsal tongue), `plaque` and
    /// `dentine` (teeth), `dryness` (film of saliva). Needs a `[mouth]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub anatomy: Option<SurfaceMap>,
    /// Tissue whose map it is. Default: the tissue that uses the material.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tissue: Option<Tissue>,
    /// Lowest value of the map. Default 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub low: Option<f64>,
    /// Highest value of the map. Default 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub high: Option<f64>,
    /// Seed of the noise. Default 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u32>,
    /// Another map by which this one is multiplied.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub times: Option<TextureReference>,
}

/// Where porphyrin lies on the back of a tongue.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DorsalTongueMap {
    /// Largest concentration, in the unit of the catalogue; 0.5 to 0.7 is a strong patch.
    pub peak: f64,
    /// Standard deviation across the tongue, as a fraction of its width, 0.01 to 10. Default 0.3 (assumed).
    #[serde(default = "sigma")]
    pub sigma: f64,
    /// Fraction of the length from the tip at which the map reaches its full height, 0.01 to 1. Default 0.6.
    #[serde(default = "full_at")]
    pub full_at: f64,
    /// 0 = smooth, 1 = broken into patches. Default 0.6 (assumed).
    #[serde(default = "patchiness")]
    pub patchiness: f64,
    /// Which patches. Default 1.
    #[serde(default = "seed")]
    pub seed: u32,
}

fn sigma() -> f64 {
    0.3
}

fn full_at() -> f64 {
    0.6
}

fn patchiness() -> f64 {
    0.6
}

fn seed() -> u32 {
    1
}

/// Quantum efficiency of a sensor: a name of the catalogue, a CSV file, or one spectrum for each channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum EfficiencyReference {
    /// A name of the catalogue, or the path of a CSV file with one column per channel.
    Name(String),
    /// A number, an equation or a column of a CSV file by channel, in electrons per photon.
    Channels(BTreeMap<String, SpectrumReference>),
}

impl Default for EfficiencyReference {
    fn default() -> Self {
        Self::Name("consumer_rgb_cmos".into())
    }
}

struct EfficiencyVisitor;

impl<'de> Visitor<'de> for EfficiencyVisitor {
    type Value = EfficiencyReference;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(
            "a name of the catalogue, the path of a CSV file, or a table with one spectrum per channel",
        )
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<Self::Value, E> {
        Ok(EfficiencyReference::Name(name.into()))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
        BTreeMap::deserialize(MapAccessDeserializer::new(map)).map(EfficiencyReference::Channels)
    }
}

impl<'de> Deserialize<'de> for EfficiencyReference {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(EfficiencyVisitor)
    }
}

impl JsonSchema for EfficiencyReference {
    fn schema_name() -> Cow<'static, str> {
        "EfficiencyReference".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let spectrum = generator.subschema_for::<SpectrumReference>();
        json_schema!({
            "description": "A name of the catalogue, the path of a CSV file, or one spectrum for each channel.",
            "anyOf": [{ "type": "string" }, { "type": "object", "additionalProperties": spectrum }]
        })
    }
}

impl Default for SpectrumReference {
    fn default() -> Self {
        Self::Constant(1.0)
    }
}

struct SpectrumVisitor;

impl<'de> Visitor<'de> for SpectrumVisitor {
    type Value = SpectrumReference;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a spectrum: a number, a name of the catalogue, the path of a CSV file, or a table with `kind` or `csv`")
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Self::Value, E> {
        Ok(SpectrumReference::Constant(value))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Self::Value, E> {
        Ok(SpectrumReference::Constant(value as f64))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Self::Value, E> {
        Ok(SpectrumReference::Constant(value as f64))
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<Self::Value, E> {
        Ok(SpectrumReference::Name(name.into()))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
        let table = toml::Table::deserialize(MapAccessDeserializer::new(map))?;
        if table.contains_key("kind") {
            CurveModel::deserialize(table).map(SpectrumReference::Model).map_err(A::Error::custom)
        } else if table.contains_key("csv") {
            SpectrumTable::deserialize(table).map(SpectrumReference::Table).map_err(A::Error::custom)
        } else {
            Err(A::Error::custom(
                "a table that describes a spectrum needs `kind` (an equation, as in { kind = \"led\", ... }) or `csv` (a file)",
            ))
        }
    }
}

impl<'de> Deserialize<'de> for SpectrumReference {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(SpectrumVisitor)
    }
}

impl JsonSchema for SpectrumReference {
    fn schema_name() -> Cow<'static, str> {
        "SpectrumReference".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let table = generator.subschema_for::<SpectrumTable>();
        let model = generator.subschema_for::<CurveModel>();
        json_schema!({
            "description": "A spectrum: a constant, a name of the catalogue or the path of a CSV file, one column of a CSV file, or an equation.",
            "anyOf": [{ "type": "number" }, { "type": "string" }, table, model]
        })
    }
}

struct ReflectanceVisitor;

impl<'de> Visitor<'de> for ReflectanceVisitor {
    type Value = ReflectanceReference;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a reflectance: a number from 0 to 1, a name, the path of a CSV file, a table, or a list of { spectrum, weight }")
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Self::Value, E> {
        SpectrumVisitor.visit_f64(value).map(ReflectanceReference::Spectrum)
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Self::Value, E> {
        SpectrumVisitor.visit_i64(value).map(ReflectanceReference::Spectrum)
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<Self::Value, E> {
        SpectrumVisitor.visit_str(name).map(ReflectanceReference::Spectrum)
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
        SpectrumVisitor.visit_map(map).map(ReflectanceReference::Spectrum)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Self::Value, A::Error> {
        let mut terms = Vec::new();
        while let Some(term) = seq.next_element()? {
            terms.push(term);
        }
        Ok(ReflectanceReference::Sum(terms))
    }
}

impl<'de> Deserialize<'de> for ReflectanceReference {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ReflectanceVisitor)
    }
}

impl JsonSchema for ReflectanceReference {
    fn schema_name() -> Cow<'static, str> {
        "ReflectanceReference".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let spectrum = generator.subschema_for::<SpectrumReference>();
        let terms = generator.subschema_for::<Vec<ReflectanceTermSection>>();
        json_schema!({
            "description": "Diffuse reflectance: one spectrum, or a list of spectra with weights that may vary over the surface.",
            "anyOf": [spectrum, terms]
        })
    }
}

struct TextureVisitor;

impl<'de> Visitor<'de> for TextureVisitor {
    type Value = TextureReference;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(
            "a number, or a map such as { image = \"x.png\" }, { checker = [8, 8] } or { noise = [5, 5] }",
        )
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Self::Value, E> {
        Ok(TextureReference::Constant(value))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Self::Value, E> {
        Ok(TextureReference::Constant(value as f64))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
        TextureTable::deserialize(MapAccessDeserializer::new(map))
            .map(|table| TextureReference::Map(Box::new(table)))
    }
}

impl<'de> Deserialize<'de> for TextureReference {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(TextureVisitor)
    }
}

impl JsonSchema for TextureReference {
    fn schema_name() -> Cow<'static, str> {
        "TextureReference".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let table = generator.subschema_for::<TextureTable>();
        json_schema!({
            "description": "A value over a surface: a number, or a map over texture coordinates.",
            "anyOf": [{ "type": "number" }, table]
        })
    }
}
