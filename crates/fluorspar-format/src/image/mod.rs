//! Images: spectral ones, masks, textures.

pub(crate) mod basis_text;
pub(crate) mod coco_mask;
pub(crate) mod dicom;
pub(crate) mod exr;
pub(crate) mod jpeg;
pub(crate) mod mask;
pub(crate) mod npy;
pub(crate) mod png;
pub(crate) mod qoi;
pub(crate) mod radiance_hdr;
pub(crate) mod texture;
pub(crate) mod tga;
