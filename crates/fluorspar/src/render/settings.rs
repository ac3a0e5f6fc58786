//! Settings of a render.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::adaptive::ErrorTarget;
use super::error::{MOST_DEPTH, MOST_SAMPLES_PER_PIXEL, RenderError};
use crate::image::StatisticsKind;
use crate::spectral::ExcitationNodes;

/// How light transport is estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Estimator {
    /// Next-event estimation toward one light of every group, weighted against scattered directions.
    #[default]
    MultipleImportance,
    /// Only scattered directions: slow, blind to point and distant lights and to how direct light spreads in tissue; a reference for
    /// tests.
    ScatteringOnly,
}

/// How a render keeps the spectra of each component.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ComponentBands {
    /// All bands.
    #[default]
    All,
    /// Coefficients on a [`SpectralBasis`](crate::image::SpectralBasis), from which all bands follow to a tenth of a percent: an eighth of the values in
    /// a mouth.
    /// All bands where the render keeps statistics of the samples or an excitation basis.
    Basis,
}

/// Settings of a render.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderSettings {
    /// Paths per pixel, 1 or more; powers of two use the samples best.
    pub samples_per_pixel: u32,
    /// Maximum path depth (surface interactions): 1 is direct light only.
    pub max_depth: u32,
    /// Seed of all random numbers.
    pub seed: u64,
    /// How light transport is estimated.
    pub estimator: Estimator,
    /// Memory limit for the images, bytes.
    pub memory_limit_bytes: u64,
    /// Sample statistics that the film keeps.
    pub statistics: StatisticsKind,
    /// Error at which a tile is done before it has all its samples; `None` gives all pixels the same number.
    pub error_target: Option<ErrorTarget>,
    /// Light groups whose light the render keeps apart by excitation node, besides what they give under their own spectrum.
    pub excitation_basis: Option<BasisSettings>,
    /// How the film keeps the spectra of each component.
    pub component_bands: ComponentBands,
    /// Whether coats mirror diffusely scattered light no sharper than a roughness of 0.2: few specks, at the cost of blurred caustics
    /// (pbrt's integrator has the same switch).
    pub regularize: bool,
}

/// Light groups that are rendered once more under the hat functions of excitation nodes, 1 W/nm (or W/(m² nm), or
/// W/(sr m² nm)) at its node for the first light of the group, the others in proportion: see [`ExcitationNodes`].
#[derive(Clone, Debug, PartialEq)]
pub struct BasisSettings {
    /// Numbers of the light groups. All lights of a group have one spectrum up to a factor.
    pub groups: Vec<usize>,
    /// The nodes.
    pub nodes: ExcitationNodes,
}

impl Default for RenderSettings {
    /// 64 paths per pixel, depth 8, seed 1, at most 8 GiB.
    fn default() -> Self {
        Self {
            samples_per_pixel: 64,
            max_depth: 8,
            seed: 1,
            estimator: Estimator::default(),
            memory_limit_bytes: 8 << 30,
            statistics: StatisticsKind::None,
            error_target: None,
            excitation_basis: None,
            component_bands: ComponentBands::default(),
            regularize: false,
        }
    }
}

impl RenderSettings {
    /// Sample statistics that the film keeps: an error target needs at least those of the light groups.
    pub fn film_statistics(&self) -> StatisticsKind {
        match self.statistics {
            StatisticsKind::None if self.error_target.is_some() => StatisticsKind::LightGroups,
            statistics => statistics,
        }
    }

    /// How the film keeps spectra: in all bands where statistics or excitation nodes are kept beside them.
    pub fn film_bands(&self) -> ComponentBands {
        match self.film_statistics() {
            StatisticsKind::None if self.excitation_basis.is_none() => self.component_bands,
            _ => ComponentBands::All,
        }
    }

    /// Number of the spectrum of a light group among the spectra that the render keeps apart of all groups: of each its own, followed by
    /// the hats of its excitation nodes.
    pub(super) fn spectrum_number(&self, group: usize) -> usize {
        group + (0..group).filter_map(|before| self.nodes_of(before)).map(ExcitationNodes::len).sum::<usize>()
    }

    /// The excitation nodes of a light group that has some.
    pub(super) fn nodes_of(&self, group: usize) -> Option<&ExcitationNodes> {
        self.excitation_basis.as_ref().filter(|basis| basis.groups.contains(&group)).map(|basis| &basis.nodes)
    }

    /// Refuses settings that are out of range.
    pub(super) fn check(&self) -> Result<(), RenderError> {
        let &Self { samples_per_pixel, max_depth, .. } = self;
        if !(1..=MOST_SAMPLES_PER_PIXEL).contains(&samples_per_pixel) {
            return Err(RenderError::SamplesPerPixel { samples_per_pixel });
        }
        if !(1..=MOST_DEPTH).contains(&max_depth) {
            return Err(RenderError::MaxDepth { max_depth });
        }
        Ok(())
    }
}
