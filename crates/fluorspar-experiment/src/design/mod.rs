//! Design problems: files that say what may be chosen of lights, filters and sensors, and what a design is judged by.

mod regions;
mod renders;
mod resolve;
mod schema;

pub use renders::{DesignRegion, DesignRender, DesignRenders};
pub use resolve::{ComparedDesign, ResolvedDesign, parse_design};
pub use schema::{
    CohortSection, ComparedDesignSection, ContrastSection, CriterionChoice, DesignFile, ExcitationSection,
    ExposuresSection, FilterChoiceSection, GeometrySection, GeometryValue, IdealBandsSection,
    LedSeriesSection, LensChoiceSection, LightChoiceSection, LimitsSection, RegionSection,
    RenderedRegionSection, RenderedSceneSection, SceneSource, SearchSection, SensorChoiceSection,
    SensorSource, SplitChoice, SplitRule, TolerancesSection, UnknownsSection, WheelFilterSection,
    WhiteFrameSection,
};
