//! Design problems: files that say what may be chosen of lights, filters and sensors, and what a design is judged by.

mod regions;
mod resolve;
mod schema;

pub use resolve::{ComparedDesign, ResolvedDesign, parse_design};
pub use schema::{
    CohortSection, ComparedDesignSection, ContrastSection, CriterionChoice, DesignFile, ExcitationSection,
    ExposuresSection, FilterChoiceSection, IdealBandsSection, LedSeriesSection, LensChoiceSection,
    LightChoiceSection, LimitsSection, RegionSection, SearchSection, SensorChoiceSection, SplitChoice,
    SplitRule, TolerancesSection, UnknownsSection, WhiteFrameSection,
};
