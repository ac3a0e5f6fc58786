//! The sections of an experiment file.

/// Functions that give fields their defaults.
macro_rules! defaults {
    ($($name:ident: $type:ty = $value:expr;)*) => {
        $(fn $name() -> $type {
            $value
        })*
    };
}

mod capture;
mod concentration;
mod develop;
mod device;
mod instrument;
mod light;
mod material;
mod number_or_word;
mod object;
mod path;
mod reference;
mod region;
mod settings;
mod tissue;

use std::borrow::Cow;
use std::collections::BTreeMap;

use fluorspar_format::FileFormat;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

pub use capture::{
    AnalysisRegionSection, AnalysisSection, BulkReference, CaptureSection, DEFAULT_PORPHYRIN, ExposureTime,
    OutputSection,
};
pub use concentration::{ConcentrationFactor, PaintedMask};
pub use develop::{DevelopSection, FlatFieldSection, MotionSection};
pub use device::{
    AutofluorescenceSection, CameraSection, FilterAngles, FilterPosition, IdealLensSection, ImageFormation,
    LensOrNumber, LensSection, SensorSection, TracedLensSection, ViewFilterSection,
};
pub use instrument::{SafetySection, SpectroradiometerSection};
pub use light::{
    Aim, AnnulusLight, DiscLight, DistantLight, DistantStrength, EmitterSection, EnvironmentLight,
    EnvironmentMapReference, EnvironmentStrength, LightFrame, LightSection, PointLight, RectangleLight,
    RingLight, SourceStrength, SpectralEnvironmentLight, SphereLight, SpotLight, TurnedMap,
};
pub use material::{
    ASSUMED_PHOTON_YIELD, ConductorSection, DielectricSection, DiffuseSection, FluorophoreSection,
    FluorophoreSource, GlossSection, MatSource, MaterialSection, MatrixSource, MetalIndex, MetalReference,
    MixSection, NormalMapSection, ScatteringSection, SpectraSource, TableSource, TissueMaterialSection,
    TwoSidedSection,
};
pub use object::{
    BoxShape, DiscShape, DisplacementSection, EmissionSection, EmissionSides, InstanceSection, LesionSection,
    MeshShape, MouthSection, ObjectSection, PlacesSection, QuadShape, RestorationSection, ScanSection,
    ShapeSection, SphereShape, TransformSection,
};
pub(crate) use path::is_file_name;
pub use path::{FilePath, NameOrFile, NameOrTable};
pub use reference::{
    AnatomyMap, CheckerMap, DorsalTongueMap, EfficiencyColumns, EfficiencyReference, ImageMap,
    MatlabSpectrum, NoiseMap, ReflectanceReference, ReflectanceTermSection, SpectrumReference, SpectrumTable,
    TableUnit, TextureReference, TextureTable, TongueMap,
};
pub use region::{RegionReference, SensorRegionSection, TargetSection};
pub use settings::{EdgeBins, RenderSection, SpectralSection, UniformBins};
pub use tissue::{
    BackgroundSection, BloodSection, CaroteneSection, LayerAbsorptionSection, LayerFluorophoreSection,
    LayerScatteringSection, TissueLayerSection, TissueSection, VolumeSection,
};

/// An experiment: scene, lights, camera, captures and analysis. Lengths are in millimeters, wavelengths in
/// nanometers; every other unit is in the name of its field.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExperimentFile {
    /// Version of the form of this file: 1.
    pub format: FormatVersion,
    /// Name of the experiment for people. Default: empty.
    #[serde(default)]
    pub title: String,
    /// Description of the experiment. Default: empty.
    #[serde(default)]
    pub description: String,
    /// Experiment that this file overrides: a name of the catalogue or a path relative to this file. Tables are
    /// merged key by key, lists entry by entry by `name`; `remove = true` in an entry removes it.
    pub base: Option<String>,
    /// Paths of what the base says and this file does not want: sections, entries, fields, as in `["light.white", "analysis"]`. They are
    /// taken away before this file is put on top. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unset: Vec<String>,
    /// Wavelengths.
    #[serde(default)]
    pub spectral: SpectralSection,
    /// Image size, samples and limits of the render.
    #[serde(default)]
    pub render: RenderSection,
    /// Pinhole from which the radiance image is rendered.
    #[serde(default)]
    pub camera: CameraSection,
    /// Lens between scene and sensor. Without `lens` and `sensor` the file describes a scene only.
    pub lens: Option<LensSection>,
    /// Filters in front of the lens.
    #[serde(default)]
    pub view_filter: ViewFilterSection,
    /// Sensor behind the lens.
    pub sensor: Option<SensorSection>,
    /// Light sources.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub light: Vec<LightSection>,
    /// Fluorophores besides those of the catalogue, or variants of those.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fluorophore: Vec<FluorophoreSection>,
    /// Layered tissues besides the sites of the catalogue, or variants of those.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tissue: Vec<TissueSection>,
    /// Materials.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub material: Vec<MaterialSection>,
    /// A parametric mouth; its parts become objects.
    pub mouth: Option<MouthSection>,
    /// Surfaces.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub object: Vec<ObjectSection>,
    /// Factors on the concentrations of fluorophores, by name. A finished render follows them without a new one. Default: none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub concentration: BTreeMap<String, ConcentrationFactor>,
    /// Exposures of the sensor, in this order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub capture: Vec<CaptureSection>,
    /// Motion of the image between exposures. Default: none.
    pub motion: Option<MotionSection>,
    /// How raw frames become linear channels. Default: black level and bilinear interpolation.
    pub develop: Option<DevelopSection>,
    /// Spectroradiometers in the place of the camera.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub spectroradiometer: Vec<SpectroradiometerSection>,
    /// Distances for the assessment of photobiological safety.
    pub safety: Option<SafetySection>,
    /// Analysis of the captures.
    pub analysis: Option<AnalysisSection>,
    /// What shall be seen: how well the frames tell it from what lies around it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub target: Vec<TargetSection>,
    /// Where results go.
    #[serde(default)]
    pub output: OutputSection,
    /// SHA-256 of files that decide a render, by their paths: a file with other content is refused. Results hold those that they were
    /// made from. Default: none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub files: BTreeMap<String, String>,
}

/// Version of the form of a file; there is one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FormatVersion;

impl FormatVersion {
    /// The version that is read and written.
    pub const CURRENT: i64 = FileFormat::EXPERIMENT.version() as i64;
}

impl Serialize for FormatVersion {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_i64(Self::CURRENT)
    }
}

impl<'de> Deserialize<'de> for FormatVersion {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let stated = i64::deserialize(deserializer)?;
        FileFormat::EXPERIMENT.check(Some(stated)).map(|()| Self).map_err(D::Error::custom)
    }
}

impl JsonSchema for FormatVersion {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        "FormatVersion".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "integer", "minimum": Self::CURRENT, "maximum": Self::CURRENT })
    }
}
