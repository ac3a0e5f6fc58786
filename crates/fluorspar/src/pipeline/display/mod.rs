//! From frames and components to pictures for the screen.

mod camera_color;
mod denoise;
mod display_image;
mod live_view;
mod preview;
mod surface_view;

pub use camera_color::CameraColor;
pub use denoise::{DenoiseError, DenoiseSettings, denoise};
pub use display_image::{DisplayImage, for_display};
pub use live_view::{LiveCapture, LivePlane, LiveView};
pub use preview::{
    ColorRendering, Preview, bright_level_dn, light_group_preview, preview, preview_white,
    preview_with_white, radiance_preview, reduce_to_preview,
};
pub use surface_view::{SurfaceView, depth_range_m, part_color, surface_view};
