//! From rendered components to raw frames: what arrives at the sensor for each frame, relit or moved if wanted, and its exposure.

mod calibration;
mod capture_planes;
mod captured_frame;
mod channel_light;
mod concentration;
pub(super) mod direct_light;
mod excitation_basis;
pub(super) mod film_irradiance;
mod film_response;
pub(super) mod light_by_shape;
mod motion;
mod row_bands;
mod scene_change;
mod spectroradiometer;

pub use calibration::Calibration;
pub use capture_planes::{CapturePlanes, CaptureResponses, SeenComponents};
pub use captured_frame::{
    BitFit, CapturedFrame, IncompleteRaw, RawExposures, RecentExposures, bracket_label, capture,
    capture_from_planes, capture_one, check_captures, complete_raw, develop_frames, frame_radiance,
    subtract_what_is_given, turned_alike,
};
pub use channel_light::{ChannelLight, channel_light};
pub use concentration::{MultipleUncertainty, concentration_factors, scale_multiple};
pub use excitation_basis::{RelitImage, image_and_basis, relight_with_basis, render_with_basis};
pub use film_irradiance::{
    capture_irradiance, columns_per_column_to_render, columns_per_render_column, on_sensor,
};
pub use film_response::FilmResponse;
pub use row_bands::{
    BandPlanes, BandStore, BandedRender, FinishedBands, RowBandError, render_row_bands, row_bands,
    tile_rows_at_once,
};
pub use scene_change::check_same_scene;
pub use spectroradiometer::{SpectroradiometerReading, read_spectroradiometers};
