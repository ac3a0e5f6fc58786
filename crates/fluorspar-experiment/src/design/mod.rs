//! Design problems: an experiment, what of it may be chosen, and what a design is judged by.

mod regions;
mod renders;
mod resolve;
mod schema;
mod vary;

pub use renders::{DesignRegion, DesignRender, DesignRenders};
pub use resolve::{ComparedDesign, ResolvedDesign, parse_design};
pub use schema::{
    CohortSection, ComparedDesignSection, CriterionChoice, DesignFile, DesignQuestion, ExcitationSection,
    ExposuresSection, IdealBandsSection, LedSeriesSection, LimitsSection, LongPassSection, RegionSection,
    RenderedRegionSection, SearchSection, UnknownsSection, VarySection, WheelFilterSection,
    WhiteFrameSection,
};
