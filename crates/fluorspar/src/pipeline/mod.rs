//! Whole chains: a flat sample in numbers, an experiment from scene to analysis.

mod predict;

pub use predict::{
    ChannelPrediction, Chromaticity, FlatSample, FluorescenceModel, PredictError, Prediction, RadianceSplit,
    predict,
};
