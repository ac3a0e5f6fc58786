//! Writing spectral and component images.

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

use exr::block::lines::LineRefMut;
use exr::image::write::layers::WritableLayers;
use exr::image::write::samples::{SamplesWriter, WritableSamples};
use exr::math::{RoundingMode, Vec2};
use exr::meta::attribute::{AttributeValue, LevelMode, SampleType, Text};
use exr::meta::header::{ImageAttributes, LayerAttributes};
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, Image, IntegerBounds, Layer, LineOrder, SmallVec,
    f16,
};

use super::packing::write_blocks;
use super::{
    BASIS, COMPONENT, DENOISED, EDGES, EXCITATION, ExcitationLabel, FEATURES, FORMAT, LAYOUT_VERSION,
    MATERIALS, PARTS, PREVIEW, PROVENANCE, QUANTITY, SAMPLES, SCALE, STATISTIC, STORAGE_ERROR,
    StatisticLabel, StatisticPlane, UNITS, VIEW, layout_unit,
};
use crate::image::basis_text::{BasisText, floats_to_text};
use crate::store::file::{MAX_IMAGE_BYTES, check_image_size};
use crate::store::output::{WrittenShare, write_atomically};
use crate::{FileFormat, FormatError, Provenance, SpooledImage};
use fluorspar::image::{
    Component, ComponentImage, ExcitationImage, FeatureMaps, GroupBasis, SpectralBasis, SpectralImage,
};
use fluorspar::spectral::{Quantity, Radiance, WavelengthGrid};

/// How pixels are packed; lossless unless the variant states otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ExrCompression {
    /// Not at all: fastest, largest.
    Uncompressed,
    /// Deflate over blocks of 16 rows.
    #[default]
    Zip,
    /// Spectral values as 16-bit floats times a power of two for each part, then deflate: about a sixth of the size.
    /// The relative error is at most 2^-11 down to 2^-29 of the part's brightest value, and the absolute error
    /// below that at most 2^-39 of it. The attributes `fluorsparScale` and `fluorsparStorageError` say so.
    Half,
    /// Values rounded to 24 bits (15 of the mantissa: relative error up to 2^-16), then deflate: a third of the size of noisy data.
    Rounded24,
}

impl ExrCompression {
    /// Largest relative error of a stored value: half a unit in the last place of its mantissa.
    ///
    /// For [`ExrCompression::Half`] down to 2^-29 of the brightest value of a part.
    pub fn relative_error(self) -> f64 {
        match self {
            Self::Uncompressed | Self::Zip => 0.0,
            Self::Rounded24 => 2f64.powi(-16),
            Self::Half => 2f64.powi(-11),
        }
    }
}

/// Further contents of an OpenEXR file.
#[derive(Clone, Copy, Debug, Default)]
pub struct ExrOptions<'a> {
    /// How pixels are packed.
    pub compression: ExrCompression,
    /// Linear R, G, B of every pixel, `[row, col]`, shown by viewers that know no wavelengths.
    pub preview: Option<&'a [[f32; 3]]>,
    /// Where the image comes from.
    pub provenance: Option<&'a Provenance>,
    /// What light groups excite at every wavelength, to keep beside the components; of component images only.
    pub excitation: Option<&'a ExcitationImage>,
}

/// Writes a spectral image in the layout of Fichet, Pacanowski and Wilkie[^fichet2021].
///
/// One channel per band: `S0.385,000000nm` for radiometric quantities, `T.385,000000nm` for ratios. Text attributes
/// keep what the layout has no place for, so that an image comes back as it was:
///
/// | attribute | content |
/// |---|---|
/// | `spectralLayoutVersion` | `1.0` |
/// | `emissiveUnits` | for instance `W.m^-2.sr^-1.nm^-1` |
/// | `wavelengthEdges_nm` | edges of the bins, separated by commas |
/// | `fluorsparQuantity` | `radiance`, `irradiance`, ... |
/// | `fluorspar` | provenance, JSON |
///
/// [^fichet2021]: J. Computer Graphics Techniques 10(3), 1-18 (2021), <http://jcgt.org/published/0010/03/01/>.
///
/// # Errors
/// When the preview does not fit, two bands share a wavelength to 1e-6 nm, or the file can't be written.
pub fn write_spectral_exr<Q: Quantity>(
    path: &Path,
    image: &SpectralImage<Q>,
    options: &ExrOptions<'_>,
) -> Result<(), FormatError> {
    let size = (image.width(), image.height());
    check(path, size, image.grid(), image.data().len(), image.bands(), options)?;
    spectral::<Q>(path, size, image.grid(), PixelSource::Memory(image.data()), options)
}

/// [`write_spectral_exr`] of the first image of a spool.
pub(crate) fn write_spooled_spectral_exr<Q: Quantity>(
    path: &Path,
    spool: &SpooledImage,
    options: &ExrOptions<'_>,
) -> Result<(), FormatError> {
    let (size, grid) = (spool.size(), spool.grid());
    check(path, size, grid, size.0 * size.1, 1, options)?;
    spectral::<Q>(path, size, grid, PixelSource::Spool(spool, 0), options)
}

fn spectral<Q: Quantity>(
    path: &Path,
    size: (usize, usize),
    grid: &WavelengthGrid,
    source: PixelSource<'_>,
    options: &ExrOptions<'_>,
) -> Result<(), FormatError> {
    let (mut planes, storage) = band_planes::<Q>(grid, None, source, size.0, options.compression);
    if let Some(preview) = options.preview {
        planes.extend(preview_planes(preview, size.0));
    }
    let mut part = Part { name: None, planes, attributes: spectral_attributes::<Q>(grid), is_packed: true };
    part.attributes.extend(storage);
    part.add_provenance(options.provenance);
    write_parts(path, size, vec![part], options.compression, source.spool())
}

/// Writes a component image with its feature maps as a file of several parts: one per component, named by its label
/// and laid out as by [`write_spectral_exr`]; for each statistic `half_a.NAME`, `half_b.NAME` (radiance) and
/// `variance.NAME` (its square); then `features` with `Z` (depth, m), `N.X`, `N.Y`, `N.Z`, `id`, `material`, `U`, `V`, and
/// `samples` where pixels differ in them.
///
/// | attribute | content |
/// |---|---|
/// | `fluorsparFormat` | version of this form, an integer: 1; in every part but the preview |
/// | `fluorsparComponent` | label of the component, JSON |
/// | `fluorsparBasis` | how all bands follow from coefficients, JSON; missing where all bands are stored |
/// | `fluorsparSamplesPerPixel` | paths per pixel |
/// | `fluorsparDenoised` | settings of the noise reduction, JSON; missing in raw images |
/// | `fluorsparExcitation` | light group, component, nodes and spectra of an excitation basis, JSON; such parts hold its factors |
/// | `fluorsparStatistic` | which half-buffer or variance a part holds, JSON |
/// | `fluorsparParts` | names of the objects and of their materials, JSON, in `features` |
/// | `fluorsparMaterials` | names of the materials, JSON, in `features`: `material` counts them from 1 |
///
/// A preview is the first part. Provenance rides on the first part.
///
/// # Errors
/// When the data do not fill the image, two components share a label, or the file can't be written.
pub fn write_component_exr(
    path: &Path,
    image: &ComponentImage,
    options: &ExrOptions<'_>,
) -> Result<(), FormatError> {
    let size = (image.width, image.height);
    let per_pixel = image.stored_values() / (size.0 * size.1).max(1);
    check(path, size, &image.grid, image.data.len(), per_pixel, options)?;
    components(path, image, None, options)
}

/// [`write_component_exr`] of the images of a spool, with everything else from `labels`.
pub(crate) fn write_spooled_component_exr(
    path: &Path,
    spool: &SpooledImage,
    labels: &ComponentImage,
    options: &ExrOptions<'_>,
) -> Result<(), FormatError> {
    let (size, grid) = (spool.size(), spool.grid());
    let statistics = labels.statistics.as_ref().map_or(0, |statistics| statistics.names.len());
    if (labels.width, labels.height) != size
        || labels.grid != *grid
        || labels.components.len() + 3 * statistics != spool.images()
    {
        return Err(FormatError::unwritable(
            path,
            format!("{} images do not make up the components and statistics", spool.images()),
            "Give one image for each component, then three for each statistic",
        ));
    }
    check(path, size, grid, size.0 * size.1, 1, options)?;
    components(path, labels, Some(spool), options)
}

fn components(
    path: &Path,
    image: &ComponentImage,
    spool: Option<&SpooledImage>,
    options: &ExrOptions<'_>,
) -> Result<(), FormatError> {
    let size = (image.width, image.height);
    if image.components.is_empty() {
        return Err(FormatError::unwritable(path, "the image has no component", "Render at least one"));
    }
    let mut parts = Vec::new();
    if let Some(preview) = options.preview {
        let planes = preview_planes(preview, size.0).to_vec();
        parts.push(Part { name: Some(PREVIEW.into()), planes, attributes: Vec::new(), is_packed: true });
    }
    for (index, component) in image.components.iter().enumerate() {
        let name = component.label();
        if parts.iter().any(|part| part.name.as_ref() == Some(&name)) {
            return Err(FormatError::unwritable(
                path,
                format!("two components are called \"{name}\""),
                "Give light groups and fluorophores names of their own",
            ));
        }
        let source = spool.map_or_else(
            || PixelSource::Memory(image.stored(index)),
            |spool| PixelSource::Spool(spool, index),
        );
        let basis = image.basis(index);
        let (planes, storage) =
            band_planes::<Radiance>(&image.grid, basis, source, size.0, options.compression);
        let mut attributes = spectral_attributes::<Radiance>(&image.grid);
        attributes.extend(storage);
        attributes.extend(basis.map(|basis| (BASIS, text(&json(&BasisText::of(basis))))));
        attributes.push((COMPONENT, text(&json(component))));
        attributes.push((SAMPLES, text(&image.samples_per_pixel.to_string())));
        attributes.extend(image.denoised.as_ref().map(|settings| (DENOISED, text(settings))));
        parts.push(Part { name: Some(name), planes, attributes, is_packed: true });
    }
    if let Some(statistics) = &image.statistics {
        let plane = image.width * image.height * image.grid.len();
        let planes = [
            ("half_a", StatisticPlane::HalfA, &statistics.half_a),
            ("half_b", StatisticPlane::HalfB, &statistics.half_b),
            ("variance", StatisticPlane::Variance, &statistics.variance),
        ];
        let count = statistics.names.len();
        if spool.is_none() && planes.iter().any(|(.., data)| data.len() != plane * count) {
            return Err(FormatError::unwritable(
                path,
                "the statistics do not fill the image",
                "Give all or none",
            ));
        }
        for (index, name) in statistics.names.iter().enumerate() {
            for (kind, (prefix, holds, data)) in planes.into_iter().enumerate() {
                let source = spool.map_or_else(
                    || PixelSource::Memory(&data[index * plane..(index + 1) * plane]),
                    |spool| PixelSource::Spool(spool, image.components.len() + kind * count + index),
                );
                let label = StatisticLabel { of: statistics.of, name: name.clone(), holds };
                let mut attributes = spectral_attributes::<Radiance>(&image.grid);
                if holds == StatisticPlane::Variance {
                    attributes.retain(|(name, _)| ![QUANTITY, UNITS].contains(name));
                    attributes.push((QUANTITY, text("radiance variance")));
                    attributes.push((UNITS, text("W^2.m^-4.sr^-2.nm^-2")));
                }
                attributes.push((STATISTIC, text(&json(&label))));
                let (planes, storage) =
                    band_planes::<Radiance>(&image.grid, None, source, size.0, options.compression);
                attributes.extend(storage);
                let name = Some(format!("{prefix}.{name}"));
                parts.push(Part { name, planes, attributes, is_packed: true });
            }
        }
    }
    for group in options.excitation.iter().flat_map(|basis| &basis.groups) {
        parts.extend(excitation_parts(path, image, group)?);
    }
    let (materials, material_names) = materials(&image.features);
    parts.extend(features_part(path, image, &materials, &material_names)?);
    for part in parts.iter_mut().filter(|part| part.name.as_deref() != Some(PREVIEW)) {
        part.attributes.push((FORMAT, AttributeValue::I32(FileFormat::COMPONENT_IMAGE.version() as i32)));
    }
    parts[0].add_provenance(options.provenance);
    write_parts(path, size, parts, options.compression, spool)
}

/// The excitation basis of a light group as parts, one for each component with light: a channel for each of its spectra, `K0000`.
fn excitation_parts<'a>(
    path: &Path,
    image: &ComponentImage,
    group: &'a GroupBasis,
) -> Result<Vec<Part<'a>>, FormatError> {
    let pixels = image.width * image.height;
    let mut parts = Vec::new();
    for component in group.components.iter().filter(|component| component.rank > 0) {
        if component.factors.len() != component.rank * pixels {
            let what = "the excitation basis does not fit the components";
            return Err(FormatError::unwritable(path, what, "Give that of the same render"));
        }
        let plane = |index: usize| Plane {
            name: format!("K{index:04}"),
            values: Values::F32(&component.factors[index * pixels..][..pixels]),
            offset: 0,
            stride: 1,
            width: image.width,
        };
        let label = ExcitationLabel {
            light_group: group.light_group.clone(),
            light: component.light.clone(),
            nodes_nm: group.nodes.nodes_nm().to_vec(),
            rank: component.rank,
            error: component.error,
            spectra: floats_to_text(&component.spectra),
        };
        let of = Component::of_group(&group.light_group, component.light.clone());
        parts.push(Part {
            name: Some(format!("excitation.{}", of.label())),
            planes: (0..component.rank).map(plane).collect(),
            attributes: vec![(EXCITATION, text(&json(&label)))],
            is_packed: true,
        });
    }
    Ok(parts)
}

/// Number of the material behind each pixel, from 1, and the names in order of first use.
fn materials(features: &FeatureMaps) -> (Vec<u16>, Vec<&str>) {
    let mut names: Vec<&str> = Vec::new();
    let of_part: Vec<u16> = features
        .material_names
        .iter()
        .map(|name| {
            let known = names.iter().position(|known| known == name).unwrap_or_else(|| {
                names.push(name);
                names.len() - 1
            });
            known as u16 + 1
        })
        .collect();
    let of_pixel = |part: &u16| match part {
        0 => 0,
        part => of_part.get(usize::from(*part) - 1).copied().unwrap_or(0),
    };
    (features.part.iter().map(of_pixel).collect(), names)
}

fn features_part<'a>(
    path: &Path,
    image: &'a ComponentImage,
    materials: &'a [u16],
    material_names: &[&str],
) -> Result<Option<Part<'a>>, FormatError> {
    let (features, width) = (&image.features, image.width);
    let pixels = width * image.height;
    let lengths = [
        features.depth_m.len(),
        features.normal.len(),
        features.part.len(),
        features.uv.len(),
        image.samples.len(),
    ];
    if let Some(length) = lengths.iter().find(|&&length| length != 0 && length != pixels) {
        return Err(FormatError::unwritable(
            path,
            format!("a feature map holds {length} values for {pixels} pixels"),
            "Give one per pixel or none",
        ));
    }
    let mut planes = Vec::new();
    let plane =
        |name: &str, values, offset, stride| Plane { name: name.into(), values, offset, stride, width };
    if !features.depth_m.is_empty() {
        planes.push(plane("Z", Values::F32(&features.depth_m), 0, 1));
    }
    if !features.normal.is_empty() {
        let values = features.normal.as_flattened();
        planes.extend((0..3).map(|i| plane(["N.X", "N.Y", "N.Z"][i], Values::F32(values), i, 3)));
    }
    if !features.part.is_empty() {
        planes.push(plane("id", Values::U16(&features.part), 0, 1));
        if !material_names.is_empty() {
            planes.push(plane("material", Values::U16(materials), 0, 1));
        }
    }
    if !image.samples.is_empty() {
        planes.push(plane("samples", Values::U32(&image.samples), 0, 1));
    }
    if !features.uv.is_empty() {
        let values = features.uv.as_flattened();
        planes.extend((0..2).map(|i| plane(["U", "V"][i], Values::F32(values), i, 2)));
    }
    if planes.is_empty() {
        return Ok(None);
    }
    let mut attributes = Vec::new();
    if !material_names.is_empty() {
        attributes.push((MATERIALS, text(&json(&material_names))));
    }
    let names = json(&(&features.part_names, &features.material_names));
    attributes.push((PARTS, text(&names)));
    attributes.extend(features.view.map(|view| (VIEW, text(&json(&view)))));
    Ok(Some(Part { name: Some(FEATURES.into()), planes, attributes, is_packed: true }))
}

fn check(
    path: &Path,
    (width, height): (usize, usize),
    grid: &WavelengthGrid,
    values: usize,
    per_pixel: usize,
    options: &ExrOptions<'_>,
) -> Result<(), FormatError> {
    let refuse = |what: String, hint: &str| Err(FormatError::unwritable(path, what, hint));
    if check_image_size(path, width as u64, height as u64, 1, MAX_IMAGE_BYTES).is_err() {
        return refuse(format!("an image can't have {height} rows and {width} columns"), "Give 1 to 100000");
    }
    if values != width * height * per_pixel {
        return refuse(
            format!(
                "{values} values do not fill {height} rows and {width} columns of {per_pixel} values each"
            ),
            "Give one value per component, row, column and coefficient",
        );
    }
    if let Some(preview) = options.preview
        && preview.len() != width * height
    {
        return refuse(
            format!("the preview has {} pixels for {height} rows and {width} columns", preview.len()),
            "Give one R, G, B per pixel",
        );
    }
    if grid.centers_nm().windows(2).any(|pair| channel_name("S0", pair[0]) == channel_name("S0", pair[1])) {
        return refuse("two bands share one wavelength to 1e-6 nm".into(), "Use wider bins");
    }
    Ok(())
}

/// The channel of a coefficient of a basis; names sort as coefficients do.
pub(super) fn coefficient_channel(number: usize) -> String {
    format!("c{number:04}")
}

fn channel_name(prefix: &str, nm: f64) -> String {
    format!("{prefix}.{}nm", format!("{nm:.6}").replace('.', ","))
}

/// Where the samples of one channel lie in memory: nothing is copied before the rows are compressed.
#[derive(Clone)]
struct Plane<'a> {
    name: String,
    values: Values<'a>,
    offset: usize,
    stride: usize,
    width: usize,
}

/// Where the values of an image are.
#[derive(Clone, Copy)]
enum PixelSource<'a> {
    /// `[row][col][band]`.
    Memory(&'a [f32]),
    /// One of the images of a spool.
    Spool(&'a SpooledImage, usize),
}

impl<'a> PixelSource<'a> {
    /// The largest finite value, without its sign.
    fn brightest(self) -> f32 {
        match self {
            Self::Memory(data) => data.iter().map(|v| v.abs()).filter(|v| v.is_finite()).fold(0.0, f32::max),
            Self::Spool(spool, image) => spool.brightest(image),
        }
    }

    fn spool(self) -> Option<&'a SpooledImage> {
        match self {
            Self::Memory(_) => None,
            Self::Spool(spool, _) => Some(spool),
        }
    }
}

#[derive(Clone, Copy)]
enum Values<'a> {
    F32(&'a [f32]),
    /// One band of an image of a spool.
    Spool {
        spool: &'a SpooledImage,
        image: usize,
        band: usize,
    },
    /// The same, multiplied by a factor and rounded to 16 bits.
    SpoolF16 {
        spool: &'a SpooledImage,
        image: usize,
        band: usize,
        factor: f32,
    },
    /// Multiplied by a factor and rounded to 16 bits.
    F16(&'a [f32], f32),
    /// Zeros.
    Dark,
    U16(&'a [u16]),
    U32(&'a [u32]),
}

impl<'a> WritableSamples<'_> for Plane<'a> {
    type Writer = Plane<'a>;

    fn sample_type(&self) -> SampleType {
        match self.values {
            Values::F32(_) | Values::Spool { .. } | Values::Dark => SampleType::F32,
            Values::F16(..) | Values::SpoolF16 { .. } => SampleType::F16,
            Values::U16(_) | Values::U32(_) => SampleType::U32,
        }
    }

    fn infer_level_modes(&self) -> (LevelMode, RoundingMode) {
        (LevelMode::Singular, RoundingMode::Down)
    }

    fn create_samples_writer(&self, _: &exr::meta::header::Header) -> Plane<'a> {
        self.clone()
    }
}

impl SamplesWriter for Plane<'_> {
    fn extract_line(&self, line: LineRefMut<'_>) {
        let Vec2(col, row) = line.location.position;
        let at = |i: usize| self.offset + (row * self.width + col + i) * self.stride;
        // Writing into memory of the right size can't fail.
        let _ = match self.values {
            Values::Dark => line.write_samples(|_| 0.0_f32),
            Values::F32(values) => line.write_samples(|i| values[at(i)]),
            Values::F16(values, factor) => line.write_samples(|i| f16::from_f32(values[at(i)] * factor)),
            Values::Spool { spool, image, band } => {
                let values = spool.line(image, band, row, col);
                line.write_samples(|i| values[i])
            }
            Values::SpoolF16 { spool, image, band, factor } => {
                let values = spool.line(image, band, row, col);
                line.write_samples(|i| f16::from_f32(values[i] * factor))
            }
            Values::U16(values) => line.write_samples(|i| u32::from(values[at(i)])),
            Values::U32(values) => line.write_samples(|i| values[at(i)]),
        };
    }
}

struct Part<'a> {
    name: Option<String>,
    planes: Vec<Plane<'a>>,
    attributes: Vec<(&'static str, AttributeValue)>,
    /// Whether its pixels are packed as the options say, or not at all.
    is_packed: bool,
}

impl Part<'_> {
    fn add_provenance(&mut self, provenance: Option<&Provenance>) {
        self.attributes.extend(provenance.map(|p| (PROVENANCE, text(&json(p)))));
    }
}

/// Planes of all bands, and what a reader must know about the way they are stored.
fn band_planes<'a, Q: Quantity>(
    grid: &WavelengthGrid,
    basis: Option<&SpectralBasis>,
    source: PixelSource<'a>,
    width: usize,
    compression: ExrCompression,
) -> (Vec<Plane<'a>>, Vec<(&'static str, AttributeValue)>) {
    let (half, attributes) = match compression {
        ExrCompression::Half => {
            let (factor, attributes) = half_scale(source.brightest());
            (Some(factor), attributes)
        }
        _ => (None, Vec::new()),
    };
    let values = |band| match (source, half) {
        (PixelSource::Memory(data), None) => Values::F32(data),
        (PixelSource::Memory(data), Some(factor)) => Values::F16(data, factor),
        (PixelSource::Spool(spool, image), None) => Values::Spool { spool, image, band },
        (PixelSource::Spool(spool, image), Some(factor)) => Values::SpoolF16 { spool, image, band, factor },
    };
    let prefix = if layout_unit(Q::UNIT).is_some() { "S0" } else { "T" };
    let names: Vec<String> = match basis {
        None => grid.centers_nm().iter().map(|nm| channel_name(prefix, *nm)).collect(),
        Some(basis) => (0..basis.len()).map(coefficient_channel).collect(),
    };
    let stride = names.len();
    let plane = |(offset, name)| Plane { name, values: values(offset), offset, stride, width };
    let mut planes: Vec<Plane<'a>> = names.into_iter().enumerate().map(plane).collect();
    if planes.is_empty() {
        // No part is without a channel
        let name = channel_name(prefix, grid.center_nm(0));
        planes.push(Plane { name, values: Values::Dark, offset: 0, stride: 0, width });
    }
    (planes, attributes)
}

/// Factor by which the brightest value comes close to the end of the range of 16-bit floats, and the attributes that
/// undo it.
fn half_scale(brightest: f32) -> (f32, Vec<(&'static str, AttributeValue)>) {
    // The factor and its inverse are both normal numbers.
    let exponent = if brightest > 0.0 { (brightest.log2().ceil() as i32 - 15).clamp(-126, 126) } else { 0 };
    let scale = 2_f64.powi(exponent);
    let error = format!(
        "relative {:.1e}; absolute {:e} below {:e}, in the unit of the values",
        ExrCompression::Half.relative_error(),
        scale * 2_f64.powi(-25),
        scale * 2_f64.powi(-14)
    );
    let attributes = vec![(SCALE, text(&scale.to_string())), (STORAGE_ERROR, text(&error))];
    (2_f32.powi(-exponent), attributes)
}

fn preview_planes(preview: &[[f32; 3]], width: usize) -> [Plane<'_>; 3] {
    let values = Values::F32(preview.as_flattened());
    ["R", "G", "B"].map(|name| {
        let offset = usize::from(name == "G") + 2 * usize::from(name == "B");
        Plane { name: name.into(), values, offset, stride: 3, width }
    })
}

fn spectral_attributes<Q: Quantity>(grid: &WavelengthGrid) -> Vec<(&'static str, AttributeValue)> {
    let edges: Vec<String> = grid.edges_nm().iter().map(f64::to_string).collect();
    let mut attributes =
        vec![(LAYOUT_VERSION, text("1.0")), (QUANTITY, text(Q::NAME)), (EDGES, text(&edges.join(",")))];
    attributes.extend(layout_unit(Q::UNIT).map(|unit| (UNITS, text(&unit))));
    attributes
}

fn text(value: &str) -> AttributeValue {
    AttributeValue::Text(Text::from_slice_unchecked(value.as_bytes()))
}

/// JSON of plain data, which can't fail.
fn json(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

fn write_parts(
    path: &Path,
    size: (usize, usize),
    parts: Vec<Part<'_>>,
    compression: ExrCompression,
    spool: Option<&SpooledImage>,
) -> Result<(), FormatError> {
    let packed = Encoding {
        compression: match compression {
            ExrCompression::Uncompressed => Compression::Uncompressed,
            ExrCompression::Zip | ExrCompression::Half => Compression::ZIP16,
            ExrCompression::Rounded24 => Compression::PXR24,
        },
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let plain = Encoding { compression: Compression::Uncompressed, ..packed };
    let layers: SmallVec<[_; 2]> = parts
        .into_iter()
        .map(|part| {
            let encoding = if part.is_packed { packed } else { plain };
            let channels: SmallVec<[_; 4]> = part
                .planes
                .into_iter()
                .map(|plane| AnyChannel {
                    name: Text::from_slice_unchecked(plane.name.as_bytes()),
                    sample_data: plane,
                    quantize_linearly: false,
                    sampling: Vec2(1, 1),
                })
                .collect();
            let mut attributes = LayerAttributes::default();
            attributes.layer_name = part.name.map(|name| Text::from_slice_unchecked(name.as_bytes()));
            attributes.other =
                part.attributes.into_iter().map(|(name, value)| (Text::from(name), value)).collect();
            Layer::new(size, attributes, encoding, AnyChannels::sort(channels))
        })
        .collect();
    let bounds = IntegerBounds::from_dimensions(size);
    let image = Image::from_layers(ImageAttributes::new(bounds), layers);
    let written = WrittenShare::begin(path);
    write_atomically(path, |writer| {
        let headers = image.layer_data.infer_headers(&image.attributes);
        let layers = image.layer_data.create_writer(&headers);
        write_blocks(&mut *writer, headers, &layers, |share| written.set(share)).map_err(
            |error| match error {
                exr::error::Error::Io(source) => source,
                other => io::Error::other(other),
            },
        )?;
        spool.map_or(Ok(()), SpooledImage::check)?;
        sort_attributes(writer)
    })
}

/// Sorts the attributes of every header by name, as the reference library does: the encoder keeps them in a hash
/// map, and equal runs must give equal bytes.
fn sort_attributes(writer: &mut BufWriter<File>) -> io::Result<()> {
    writer.flush()?;
    let file = writer.get_mut();
    file.seek(SeekFrom::Start(0))?;
    let mut reader = io::BufReader::new(&mut *file);
    let mut start = [0; 8];
    reader.read_exact(&mut start)?;
    let multi_part = start[5] & 0x10 != 0;
    let mut sorted = Vec::new();
    loop {
        let mut attributes = read_attributes(&mut reader)?;
        let last_part = attributes.is_empty();
        attributes.sort();
        sorted.extend(attributes.into_iter().flatten());
        sorted.push(0);
        if last_part || !multi_part {
            break;
        }
    }
    file.seek(SeekFrom::Start(start.len() as u64))?;
    file.write_all(&sorted)?;
    file.seek(SeekFrom::End(0)).map(|_| ())
}

/// The attributes of one header, each with name, type, size and value; none behind the last header.
fn read_attributes(reader: &mut impl io::BufRead) -> io::Result<Vec<Vec<u8>>> {
    let mut attributes = Vec::new();
    loop {
        let mut attribute = Vec::new();
        read_until_zero(reader, &mut attribute)?;
        if attribute.len() == 1 {
            return Ok(attributes);
        }
        read_until_zero(reader, &mut attribute)?;
        let mut size = [0; 4];
        reader.read_exact(&mut size)?;
        attribute.extend(size);
        reader.by_ref().take(u64::from(u32::from_le_bytes(size))).read_to_end(&mut attribute)?;
        attributes.push(attribute);
    }
}

/// Appends bytes up to and including the next zero.
fn read_until_zero(reader: &mut impl io::BufRead, bytes: &mut Vec<u8>) -> io::Result<()> {
    match reader.read_until(0, bytes)? {
        0 => Err(io::ErrorKind::UnexpectedEof.into()),
        _ => Ok(()),
    }
}
