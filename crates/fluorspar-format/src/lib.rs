//! Files: spectra and matrices in, images and meshes in and out.
//!
//! | content | read | write |
//! |---|---|---|
//! | spectra: text of instruments and spreadsheets, JCAMP-DX, IES TM-27, MATLAB (ISET) | [`read_spectra`] | |
//! | fluorophore (excitation and emission), CSV | [`read_fluorophore_csv`] | |
//! | excitation-emission matrix, CSV | [`read_eem_csv`] | |
//! | fluorophore, MATLAB (ISET) | [`read_iset_fluorophore`] | |
//! | spectral image, OpenEXR or NumPy | [`read_spectral_exr`], [`read_spectral_npy`] | [`write_spectral_exr`], [`write_spectral_npy`] |
//! | component image, OpenEXR or NumPy | [`read_component_exr`], [`read_component_npy`] | [`write_component_exr`], [`write_component_npy`] |
//! | component image, part by part | [`ComponentFile`] | |
//! | spectral cube: ENVI, ISETCam; written alone Zarr, OME-TIFF | [`read_cube`] | [`CubeForm::write`], [`write_component_zarr`] |
//! | channels of a frame, OME-TIFF, OME-Zarr | | [`write_ome_tiff`], [`write_ome_zarr`] |
//! | film (exact sums of a render) | [`read_film`] | [`write_film`] |
//! | raw sensor frame, TIFF, PNG, DNG or packed | [`read_sensor_image`] | [`write_sensor_tiff`], [`write_sensor_png`], [`write_sensor_dng`], [`write_packed_raw`] |
//! | table of columns, Parquet; picture, DICOM | | [`parquet_table`], [`write_dicom`] |
//! | names of tags and chunks of a picture | [`left_tags`] | |
//! | mask, PNG, TIFF or NumPy | [`read_mask`] | [`write_indexed_png`], [`CocoMask`] |
//! | description of a camera's frame | [`describe_frame`] | [`FrameDescription::write`] |
//! | texture, image: PNG, JPEG, TGA, QOI, OpenEXR, Radiance or PFM | [`read_texture`], [`read_texture_png`] | [`write_gray_png, write_rgb_png`] |
//! | scene of pbrt, versions 3 and 4 | [`read_pbrt`] | |
//! | lens, TOML, pbrt, ISET JSON or Zemax | [`read_lens`] | [`LensFile`] |
//! | mesh, PLY, OBJ, STL, glTF | [`read_ply`], [`read_obj`], [`read_stl`], [`read_gltf`] | [`write_ply`] |
//! | meshes at many places, glTF | [`read_gltf_instances`] | |
//! | places, CSV or NumPy | [`read_placements`] | |
//! | named meshes, OBJ, glTF, PBRT | | [`write_obj`], [`write_gltf`], [`write_pbrt`] |
//! | a scene with camera and lights, glTF | | [`write_gltf_scene`] |
//!
//! Readers open files by [`read_bounded`] and its like: no more than a limit is read, whatever the system says of a file.
//! Every reader says what is wrong with a file, where, and how to fix it ([`FormatError`]), and survives any bytes.
//! Every writer leaves a complete file or none ([`write_atomically`]). Equal results give equal bytes. A command declares all that
//! it will write before it begins ([`Outputs`], [`OutputFolder`]). What takes long to make is kept in a [`Cache`].
//!
//! Rooms: `table`, `cube`, `frame`, `image`, `mesh`, `lens`, `pbrt`, and `store`, where files are opened and written.
//!
//! Out of scope: what the numbers mean. Readers do not normalize, and convert nothing but units that a file names.

mod cube;
mod error;
mod frame;
mod image;
mod lens;
mod mesh;
mod npy_array;
mod pbrt;
mod store;
mod table;
mod toml_text;

pub use cube::ome_tiff::{OmeChannel, OmeFacts, write_ome_tiff};
pub use cube::ome_zarr::write_ome_zarr;
pub use cube::{Cube, CubeFacts, CubeForm, CubeLight, read_cube, write_component_zarr};
pub use error::{Defect, FormatError};
pub use frame::dng::{DngColor, write_sensor_dng};
pub use frame::frame_description::{
    DescribedFrame, FactSource, FrameDescription, FrameFact, FrameFacts, black_level_doubt, describe_frame,
    description_path, read_described_frame,
};
pub use frame::left_tags::{LeftTags, left_tags};
pub use frame::packed_raw::write_packed_raw;
pub use frame::raw::{read_sensor_image, write_sensor_png, write_sensor_tiff};
pub use frame::row_packing::RawPacking;
pub use image::coco_mask::{CocoMask, CocoRuns};
pub use image::dicom::{DicomElement, DicomValue, write_dicom};
pub use image::exr::{
    ComponentFile, ExrCompression, ExrOptions, is_component_exr, read_component_exr, read_spectral_exr,
    write_component_exr, write_spectral_exr,
};
pub use image::mask::{MaskImage, read_mask};
pub use image::npy::{
    is_component_npy, read_component_image, read_component_npy, read_spectral_image, read_spectral_npy,
    write_component_npy, write_map_npy, write_spectral_npy,
};
pub use image::png::{
    TextureImage, Transfer, opaque_rgb, read_texture_png, write_gray_png, write_indexed_png, write_label_png,
    write_rgb_png,
};
pub use image::texture::read_texture;
pub use lens::{AbbeGlass, LensFile, LensFileError, LensFileSurface, PublishedLens, read_lens};
pub use mesh::gltf::{
    GltfCamera, GltfLight, GltfLightKind, read_gltf, read_gltf_instances, write_gltf, write_gltf_scene,
};
pub use mesh::mesh_set::{NamedMesh, write_obj, write_pbrt};
pub use mesh::obj::read_obj;
pub use mesh::placements::read_placements;
pub use mesh::ply::{LeftOutFaces, PlyMesh, read_ply, read_ply_leniently, write_ply};
pub use mesh::stl::read_stl;
pub use pbrt::{
    PbrtEntity, PbrtError, PbrtInstance, PbrtKind, PbrtMaterial, PbrtParameter, PbrtPlace, PbrtPlaced,
    PbrtRemark, PbrtScene, PbrtSettings, PbrtShape, PbrtTexture, PbrtValues, PbrtVersion, read_pbrt,
};
pub use store::cache::{Cache, count_as_program};
pub use store::file_format::{FileFormat, OtherFormat};
pub use store::film::{read_film, read_film_layout, read_film_rows, write_film};
pub use store::input::{digest_bounded, read_bounded, read_start, read_text_bounded};
pub use store::output::{
    AppendedLines, Claim, Journal, Output, OutputFolder, OutputSet, Outputs, WRITTEN_BY, check_room,
    free_bytes, remove_unfinished_files, sync_together, unfinished_files, write_atomically, write_unsynced,
    written_share,
};
pub use store::provenance::{Loaded, Provenance};
pub use store::spooled_image::SpooledImage;
pub use table::csv_cell::{csv_cell, quoted_csv_cell};
pub use table::csv_eem::{AntiStokes, CsvEemOptions, EmptyCells, MeasuredEem, eem_csv, read_eem_csv};
pub use table::csv_fluorophore::{CsvFluorophore, names_excitation_and_emission, read_fluorophore_csv};
pub use table::csv_table::Negative;
pub use table::eem_scatter::{
    ANTI_STOKES_TOLERANCE, CutTo, LeastCuts, MOST_CUT_NM, Overflow, ScatterCut, ScatterLine,
    refuse_anti_stokes, refuse_scattered_light,
};
pub use table::mat::{IsetFluorophore, read_iset_fluorophore};
pub use table::parquet::{ParquetColumn, parquet_table};
pub use table::spectra::{MeasuredSpectra, NamedCurve, SpectrumColumns, SpectrumOptions, read_spectra};
pub use table::value_unit::{SpectrumQuantity, ValueUnit};
pub use toml_text::{TomlError, read_toml, read_toml_document, read_toml_places};
