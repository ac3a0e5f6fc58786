//! Frames of cameras: raw formats, TIFF and PNG with their descriptions, and what of them is doubtful.

pub(crate) mod camera_raw;
pub(crate) mod described_frame;
pub(crate) mod dng;
pub(crate) mod dng_pixels;
pub(crate) mod frame_description;
pub(crate) mod frame_judgement;
pub(crate) mod left_tags;
pub(crate) mod lossless_jpeg;
pub(crate) mod opcodes;
pub(crate) mod packed_raw;
pub(crate) mod raw;
pub(crate) mod row_packing;
pub(crate) mod tiff_directory;
pub(crate) mod tiff_image;
pub(crate) mod tone_curve;
