//! Reading spectral and component images.

use std::io::{BufReader, Read};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use exr::block::chunk::{Chunk, TileCoordinates};
use exr::block::reader::{ChunksReader, FilteredChunksReader};
use exr::block::{BlockIndex, UncompressedBlock};
use exr::math::Vec2;
use exr::meta::MetaData;
use exr::meta::attribute::{AttributeValue, ChannelDescription, SampleType, Text};
use exr::meta::header::Header;
use rayon::prelude::*;

use super::write::coefficient_channel;
use super::{
    BASIS, COMPONENT, DENOISED, EDGES, FEATURES, FORMAT, PARTS, PROVENANCE, QUANTITY, SAMPLES, SCALE,
    STATISTIC, StatisticLabel, StatisticPlane, UNITS, VIEW, layout_unit,
};
use crate::image::basis_text::BasisText;
use crate::image::npy::check_finite;
use crate::store::file::{check_image_size, check_packing, guarded, most_image_bytes};
use crate::store::input::open_plain;
use crate::{FileFormat, FormatError, Loaded, Provenance, TextureImage};
use fluorspar::image::{
    Component, ComponentBases, ComponentImage, FeatureMaps, SampleStatistics, SpectralBasis, SpectralImage,
};
use fluorspar::spectral::{Quantity, Radiance, WavelengthGrid};

/// Reads a spectral image, written by this program or any other that follows the layout.
///
/// The bins are those of the `wavelengthEdges_nm` attribute, else they lie around the wavelengths of the channels.
/// Radiance in `W.m^-2.sr^-1` is taken per nm: that is how renderers write it.
///
/// # Errors
/// No spectral channels, another quantity or unit, damaged files.
pub fn read_spectral_exr<Q: Quantity>(path: &Path) -> Result<Loaded<SpectralImage<Q>>, FormatError> {
    guarded(path, "OpenEXR", || {
        let headers = headers(path)?;
        let header = &headers[0];
        if headers.len() > 1 {
            return Err(FormatError::unsupported(
                path,
                format!("the file has {} parts", headers.len()),
                "Read it as a component image, or save one part alone",
            ));
        }
        check_quantity::<Q>(path, header)?;
        let BandChannels { grid, bands, .. } = bands::<Q>(path, header)?;
        let Vec2(width, height) = header.layer_size;
        let mut buffers = [vec![0.0; width * height * grid.len()]];
        let targets = [band_targets(header, &bands, 0, 0)];
        decode(path, &headers, &targets, &mut buffers)?;
        let [mut data] = buffers;
        rescale(path, header, &mut data)?;
        check_finite(path, &data)?;
        let image = SpectralImage::from_data(grid, width, height, data)
            .map_err(|error| FormatError::malformed(path, error.to_string(), "Write the file again"))?;
        Ok(Loaded { image, provenance: provenance(path, &headers)? })
    })
}

/// Whether a file is an OpenEXR image with components of a render.
pub fn is_component_exr(path: &Path) -> bool {
    let has_component = |header: &Header| attribute(header, COMPONENT).is_some();
    guarded(path, "OpenEXR", || headers(path)).is_ok_and(|headers| headers.iter().any(has_component))
}

/// Reads a component image written by [`write_component_exr`](super::write_component_exr).
///
/// # Errors
/// No components, parts that do not fit together, damaged files.
pub fn read_component_exr(path: &Path) -> Result<Loaded<ComponentImage>, FormatError> {
    guarded(path, "OpenEXR", || read_component_parts(path))
}

/// Reads the color of an OpenEXR image: its first part with channels R, G and B, or Y, as it is stored.
///
/// # Errors
/// No such part, damaged files.
pub(crate) fn read_texture_exr(path: &Path) -> Result<TextureImage, FormatError> {
    guarded(path, "OpenEXR", || {
        let headers = headers(path)?;
        let layouts: [&[&str]; 2] = [&["R", "G", "B"], &["Y"]];
        let found = headers.iter().enumerate().find_map(|(part, header)| {
            let names =
                layouts.into_iter().find(|names| names.iter().all(|name| has_channel(header, name)))?;
            Some((part, header, names))
        });
        let Some((part, header, names)) = found else {
            let what = "the image has neither channels R, G, B nor a channel Y";
            return Err(FormatError::unsupported(path, what, "Save it with such channels"));
        };
        let Vec2(width, height) = header.layer_size;
        let channels = names.len();
        let target = |name: &Text| {
            let offset = names.iter().position(|wanted| name.eq(wanted))?;
            Some(Target { buffer: 0, offset, stride: channels })
        };
        let mut targets: Vec<PartTargets> =
            headers.iter().map(|header| vec![None; header.channels.list.len()]).collect();
        targets[part] = header.channels.list.iter().map(|channel| target(&channel.name)).collect();
        let mut buffers = [vec![0.0; width * height * channels]];
        decode(path, &headers, &targets, &mut buffers)?;
        let [data] = buffers;
        Ok(TextureImage { width, height, channels, data })
    })
}

/// Where the values of a part go, channel by channel.
type PartTargets = Vec<Option<Target>>;

/// Attributes shared by the parts with components.
pub(super) struct ComponentParts {
    pub(super) grid: WavelengthGrid,
    pub(super) size: Vec2<usize>,
    pub(super) components: Vec<Component>,
    /// Of each component its basis; empty where all bands of all are stored.
    pub(super) bases: ComponentBases,
    pub(super) samples_per_pixel: u32,
    /// Of all parts of the file.
    targets: Vec<PartTargets>,
}

impl ComponentParts {
    /// Values of one statistic.
    fn plane(&self) -> usize {
        self.size.area() * self.grid.len()
    }

    /// Values that each component is stored with.
    pub(super) fn stored(&self) -> impl Iterator<Item = usize> {
        let stored = |component: usize| match self.bases.get(component) {
            Some(Some(basis)) => basis.len(),
            _ => self.grid.len(),
        };
        (0..self.components.len()).map(move |component| self.size.area() * stored(component))
    }
}

fn read_component_parts(path: &Path) -> Result<Loaded<ComponentImage>, FormatError> {
    // Read what each part of the file holds
    let headers = headers(path)?;
    let mut parts = component_parts(path, &headers)?;
    let plane = parts.plane();
    let Vec2(width, height) = parts.size;
    // Part, buffer and values of everything that may be stored at a scale.
    let mut values = 0;
    let mut scaled: Vec<(usize, usize, Range<usize>)> = (0..headers.len())
        .filter(|part| attribute(&headers[*part], COMPONENT).is_some())
        .zip(parts.stored())
        .map(|(part, len)| {
            values += len;
            (part, 0, values - len..values)
        })
        .collect();
    let mut statistics = statistic_parts(path, &headers, &mut parts, &mut scaled)?;

    if statistics.is_some() && !parts.bases.is_empty() {
        let what = "the file has statistics, but not all bands of its components";
        return Err(FormatError::malformed(path, what, "Write the file again"));
    }

    // Refuse images that the file is too short for, then allocate
    let pixels = width * height;
    let statistic_values = statistics.as_ref().map_or(0, |statistics| statistics.names.len() * plane);
    let per_pixel = values / pixels.max(1) + FEATURE_CHANNELS.len() + 3 * statistic_values / pixels.max(1);
    let bytes_per_pixel = 4 * per_pixel as u64;
    let length = std::fs::metadata(path).map_err(|source| FormatError::io(path, "read", source))?.len();
    check_image_size(path, width as u64, height as u64, bytes_per_pixel, most_image_bytes(length))?;
    let mut buffers =
        [values, 0, statistic_values, statistic_values, statistic_values].map(|len| vec![0.0; len]);
    let features_part = headers.iter().position(|header| part_name(header).as_deref() == Some(FEATURES));
    if let Some(part) = features_part {
        if headers[part].layer_size != parts.size {
            return Err(FormatError::malformed(
                path,
                "the feature maps differ in size",
                "Write the file again",
            ));
        }
        parts.targets[part] = feature_targets(&headers[part], 1);
        buffers[1] = vec![0.0; FEATURE_CHANNELS.len() * pixels];
    }

    // Decode all values
    decode(path, &headers, &parts.targets, &mut buffers)?;
    for (part, buffer, values) in scaled {
        rescale(path, &headers[part], &mut buffers[buffer][values])?;
    }

    // Assemble the image
    check_finite(path, &buffers[0])?;
    let [data, maps, half_a, half_b, variance] = buffers;
    if let Some(statistics) = &mut statistics {
        (statistics.half_a, statistics.half_b, statistics.variance) = (half_a, half_b, variance);
    }
    let mut features = FeatureMaps::default();
    let mut samples = Vec::new();
    if let Some(part) = features_part {
        features = feature_maps(path, &headers[part], &maps)?;
        samples = samples_of(&headers[part], &maps);
    }
    let image = ComponentImage {
        grid: parts.grid,
        width,
        height,
        components: parts.components,
        bases: parts.bases,
        data,
        samples_per_pixel: parts.samples_per_pixel,
        samples,
        features,
        statistics,
        denoised: headers.iter().find_map(|header| attribute(header, DENOISED)),
    };
    Ok(Loaded { image, provenance: provenance(path, &headers)? })
}

/// Bands of a part.
pub(super) struct BandChannels {
    pub(super) grid: WavelengthGrid,
    /// Number of the band or coefficient that each channel holds.
    pub(super) bands: Vec<Option<usize>>,
    /// How all bands follow from coefficients; `None` where all are stored.
    pub(super) basis: Option<SpectralBasis>,
}

/// Finds the parts that hold components, which must agree in size and wavelengths.
pub(super) fn component_parts(path: &Path, headers: &[Header]) -> Result<ComponentParts, FormatError> {
    let mut shared: Option<(WavelengthGrid, Vec2<usize>)> = None;
    let mut components = Vec::new();
    let mut samples_per_pixel = 0;
    let (mut bases, mut values) = (ComponentBases::new(), 0);
    let mut targets: Vec<PartTargets> = Vec::new();
    for header in headers {
        let Some(label) = attribute(header, COMPONENT) else {
            targets.push(vec![None; header.channels.list.len()]);
            continue;
        };
        let stated = integer_attribute(header, FORMAT);
        FileFormat::COMPONENT_IMAGE.check(stated).map_err(|other| FormatError::other_format(path, other))?;
        let component: Component = parse_json(path, COMPONENT, &label)?;
        check_quantity::<Radiance>(path, header)?;
        let BandChannels { grid, bands, basis } = bands::<Radiance>(path, header)?;
        if let Some((first_grid, size)) = &shared
            && (grid != *first_grid || header.layer_size != *size)
        {
            return Err(FormatError::malformed(
                path,
                format!("component \"{}\" differs in size or wavelengths from the first", component.label()),
                "Write the file again",
            ));
        }
        let pixels = header.layer_size.area();
        targets.push(band_targets(header, &bands, 0, values));
        values += pixels * bands.iter().flatten().count();
        bases.push(basis.map(Arc::new));
        samples_per_pixel = attribute(header, SAMPLES).and_then(|text| text.parse().ok()).unwrap_or(0);
        components.push(component);
        shared.get_or_insert((grid, header.layer_size));
    }
    let Some((grid, size)) = shared else {
        return Err(FormatError::unsupported(
            path,
            "this image holds radiance, not the component images that are needed",
            "Give components.exr of a run, or render one with `fluorspar render --components`",
        ));
    };
    if bases.iter().all(Option::is_none) {
        bases.clear();
    }
    Ok(ComponentParts { grid, size, components, bases, samples_per_pixel, targets })
}

/// Finds the parts that hold sample statistics, and adds them to the targets and to what may be stored at a scale. The
/// values of the statistics are left empty.
fn statistic_parts(
    path: &Path,
    headers: &[Header],
    parts: &mut ComponentParts,
    scaled: &mut Vec<(usize, usize, Range<usize>)>,
) -> Result<Option<SampleStatistics>, FormatError> {
    let plane = parts.plane();
    let mut statistics: Option<SampleStatistics> = None;
    for (part, header) in headers.iter().enumerate() {
        let Some(label) = attribute(header, STATISTIC) else { continue };
        let label: StatisticLabel = parse_json(path, STATISTIC, &label)?;
        let BandChannels { grid: statistic_grid, bands, .. } = bands::<Radiance>(path, header)?;
        if statistic_grid != parts.grid || header.layer_size != parts.size {
            return Err(FormatError::malformed(
                path,
                format!("the statistics of \"{}\" differ in size or wavelengths", label.name),
                "Write the file again",
            ));
        }
        let empty = || SampleStatistics {
            of: label.of,
            names: Vec::new(),
            half_a: Vec::new(),
            half_b: Vec::new(),
            variance: Vec::new(),
        };
        let statistics = statistics.get_or_insert_with(empty);
        let known = statistics.names.iter().position(|name| *name == label.name);
        let index = known.unwrap_or_else(|| {
            statistics.names.push(label.name.clone());
            statistics.names.len() - 1
        });
        let buffer = match label.holds {
            StatisticPlane::HalfA => 2,
            StatisticPlane::HalfB => 3,
            StatisticPlane::Variance => 4,
        };
        parts.targets[part] = band_targets(header, &bands, buffer, index * plane);
        scaled.push((part, buffer, index * plane..(index + 1) * plane));
    }
    Ok(statistics)
}

const FEATURE_CHANNELS: [&str; 8] = ["Z", "N.X", "N.Y", "N.Z", "id", "U", "V", "samples"];

fn has_channel(header: &Header, name: &str) -> bool {
    header.channels.list.iter().any(|channel| channel.name.as_slice() == name.as_bytes())
}

fn feature_targets(header: &Header, buffer: usize) -> Vec<Option<Target>> {
    let target = |name: &Text| {
        let offset = FEATURE_CHANNELS.iter().position(|known| name.as_slice() == known.as_bytes())?;
        Some(Target { buffer, offset, stride: FEATURE_CHANNELS.len() })
    };
    header.channels.list.iter().map(|channel| target(&channel.name)).collect()
}

fn feature_maps(path: &Path, header: &Header, maps: &[f32]) -> Result<FeatureMaps, FormatError> {
    let has = |name: &str| has_channel(header, name);
    let pixels = || maps.chunks_exact(FEATURE_CHANNELS.len());
    let mut features = feature_names(path, header)?;
    if has("Z") {
        features.depth_m = pixels().map(|pixel| pixel[0]).collect();
    }
    if has("N.X") {
        features.normal = pixels().map(|pixel| [pixel[1], pixel[2], pixel[3]]).collect();
    }
    if has("id") {
        features.part = pixels().map(|pixel| pixel[4] as u16).collect();
    }
    if has("U") {
        features.uv = pixels().map(|pixel| [pixel[5], pixel[6]]).collect();
    }
    Ok(features)
}

/// Names of parts and materials, and the view: what a header says of feature maps.
fn feature_names(path: &Path, header: &Header) -> Result<FeatureMaps, FormatError> {
    let mut features = FeatureMaps::default();
    if let Some(names) = attribute(header, PARTS) {
        (features.part_names, features.material_names) = parse_json(path, PARTS, &names)?;
    }
    features.view = attribute(header, VIEW).map(|view| parse_json(path, VIEW, &view)).transpose()?;
    Ok(features)
}

/// Undoes the scale at which 16-bit values are stored.
fn rescale(path: &Path, header: &Header, values: &mut [f32]) -> Result<(), FormatError> {
    if let Some(scale) = scale_of(path, header)? {
        values.iter_mut().for_each(|value| *value = (f64::from(*value) * scale) as f32);
    }
    Ok(())
}

/// Scale at which 16-bit values are stored, if there is one.
pub(super) fn scale_of(path: &Path, header: &Header) -> Result<Option<f64>, FormatError> {
    let Some(text) = attribute(header, SCALE) else { return Ok(None) };
    let scale = text.parse::<f64>().ok().filter(|scale| scale.is_finite() && *scale > 0.0);
    if scale.is_none() {
        let what = format!("the attribute \"{SCALE}\" is damaged");
        return Err(FormatError::malformed(path, what, "Write the file again"));
    }
    Ok(scale)
}

/// Feature maps and samples per pixel of a component image, read alone; without `with_maps` only what the header says of them.
pub(super) fn read_features(
    path: &Path,
    headers: &[Header],
    size: Vec2<usize>,
    with_maps: bool,
) -> Result<(FeatureMaps, Vec<u32>), FormatError> {
    let part = headers.iter().position(|header| part_name(header).as_deref() == Some(FEATURES));
    let Some(part) = part else { return Ok(Default::default()) };
    if headers[part].layer_size != size {
        return Err(FormatError::malformed(path, "the feature maps differ in size", "Write the file again"));
    }
    if !with_maps {
        return Ok((feature_names(path, &headers[part])?, Vec::new()));
    }
    let mut targets: Vec<PartTargets> =
        headers.iter().map(|header| vec![None; header.channels.list.len()]).collect();
    targets[part] = feature_targets(&headers[part], 0);
    let mut buffers = [vec![0.0; FEATURE_CHANNELS.len() * size.area()]];
    decode(path, headers, &targets, &mut buffers)?;
    let [maps] = buffers;
    Ok((feature_maps(path, &headers[part], &maps)?, samples_of(&headers[part], &maps)))
}

/// Samples of each pixel, where they are stored.
fn samples_of(header: &Header, maps: &[f32]) -> Vec<u32> {
    if !has_channel(header, "samples") {
        return Vec::new();
    }
    maps.chunks_exact(FEATURE_CHANNELS.len()).map(|pixel| pixel[7] as u32).collect()
}

/// Headers, after everything that decides about memory has been checked.
pub(super) fn headers(path: &Path) -> Result<Vec<Header>, FormatError> {
    let failed = |source| FormatError::io(path, "read", source);
    let (mut file, length) = open_plain(path)?;
    let mut magic = Vec::new();
    Read::by_ref(&mut file).take(4).read_to_end(&mut magic).map_err(failed)?;
    if magic != [0x76, 0x2f, 0x31, 0x01] {
        return Err(FormatError::malformed(path, "this is not an OpenEXR file", "Give an .exr image"));
    }
    let (file, _) = open_plain(path)?;
    let meta =
        MetaData::read_from_buffered(BufReader::new(file), false).map_err(|error| damaged(path, &error))?;
    let most_bytes = most_image_bytes(length);
    let mut total_bytes = 0_u64;
    for header in &meta.headers {
        if header.deep {
            return Err(FormatError::unsupported(path, "the file holds deep data", "Flatten it first"));
        }
        if header.channels.list.iter().any(|channel| channel.sampling != Vec2(1, 1)) {
            return Err(FormatError::unsupported(
                path,
                "a channel is subsampled",
                "Save all channels in full",
            ));
        }
        let bytes = header.channels.bytes_per_pixel.max(4 * header.channels.list.len()) as u64;
        let Vec2(width, height) = header.layer_size;
        check_image_size(path, width as u64, height as u64, bytes, most_bytes)?;
        total_bytes = total_bytes.saturating_add((width as u64 * height as u64).saturating_mul(bytes));
        if header.chunk_count as u64 > length / 8 {
            return Err(FormatError::malformed(
                path,
                format!("the header claims {} blocks in a file of {length} bytes", header.chunk_count),
                "Copy the file again",
            ));
        }
    }
    if total_bytes > most_bytes {
        return Err(FormatError::too_large(
            path,
            format!("the parts claim {total_bytes} bytes together"),
            format!("{most_bytes} bytes"),
        ));
    }
    check_packing(path, total_bytes, length)?;
    if meta.headers.is_empty() {
        return Err(FormatError::malformed(path, "the file holds no image", "Write the file again"));
    }
    Ok(meta.headers.to_vec())
}

pub(super) fn damaged(path: &Path, error: &exr::error::Error) -> FormatError {
    FormatError::malformed(path, format!("not a valid OpenEXR file: {error}"), "Copy the file again")
}

/// Where the samples of a channel go: `buffers[buffer][offset + stride * pixel]`.
#[derive(Clone, Copy)]
pub(super) struct Target {
    pub(super) buffer: usize,
    pub(super) offset: usize,
    pub(super) stride: usize,
}

fn band_targets(
    header: &Header,
    bands: &[Option<usize>],
    buffer: usize,
    start: usize,
) -> Vec<Option<Target>> {
    let stride = bands.iter().flatten().count();
    debug_assert_eq!(header.channels.list.len(), bands.len());
    bands.iter().map(|band| band.map(|band| Target { buffer, offset: start + band, stride })).collect()
}

/// Decodes the full-resolution pixels of the parts with targets, straight into their places.
pub(super) fn decode(
    path: &Path,
    headers: &[Header],
    targets: &[Vec<Option<Target>>],
    buffers: &mut [Vec<f32>],
) -> Result<(), FormatError> {
    let wanted = |part: usize| targets[part].iter().any(Option::is_some);
    let mut blocks = BlockReader::open(path, wanted)?;
    while let Some(batch) = blocks.next_batch()? {
        for block in batch {
            place_block(path, &headers[block.index.layer], &targets[block.index.layer], &block, buffers)?;
        }
    }
    Ok(())
}

/// Puts the lines of a block into their places.
fn place_block(
    path: &Path,
    header: &Header,
    targets: &[Option<Target>],
    block: &UncompressedBlock,
    buffers: &mut [Vec<f32>],
) -> Result<(), FormatError> {
    let broken = |error: exr::error::Error| damaged(path, &error);
    let width = header.layer_size.width();
    for line in block.lines(&header.channels) {
        let Some(target) = targets[line.location.channel] else { continue };
        let Vec2(col, row) = line.location.position;
        let first = row * width + col;
        let buffer = &mut buffers[target.buffer];
        let sample_type = header.channels.list[line.location.channel].sample_type;
        // Planes as this program writes them are copied as they lie
        if let (SampleType::F32, 1) = (sample_type, target.stride) {
            let (values, _) = line.value.as_chunks::<4>();
            if let Some(slots) = buffer.get_mut(target.offset + first..).filter(|s| s.len() >= values.len()) {
                slots.iter_mut().zip(values).for_each(|(slot, bytes)| *slot = f32::from_ne_bytes(*bytes));
                continue;
            }
        }
        let mut place = |i: usize, value: f32| {
            if let Some(slot) = buffer.get_mut(target.offset + (first + i) * target.stride) {
                *slot = value;
            }
        };
        match sample_type {
            SampleType::F32 => {
                for (i, value) in line.read_samples::<f32>().enumerate() {
                    place(i, value.map_err(broken)?);
                }
            }
            SampleType::F16 => {
                for (i, value) in line.read_samples::<exr::prelude::f16>().enumerate() {
                    place(i, value.map_err(broken)?.to_f32());
                }
            }
            SampleType::U32 => {
                for (i, value) in line.read_samples::<u32>().enumerate() {
                    place(i, value.map_err(broken)? as f32);
                }
            }
        }
    }
    Ok(())
}

/// Reads the full-resolution blocks of the wanted ones of so many parts, and returns what `visit` made of each, in no order. Several
/// threads read: one would keep the others waiting.
pub(super) fn for_each_block<T: Send>(
    path: &Path,
    parts: usize,
    wanted: impl Fn(usize) -> bool,
    visit: impl Fn(PackedBlock<'_>) -> Result<T, FormatError> + Sync,
) -> Result<Vec<T>, FormatError> {
    let wanted: Vec<usize> = (0..parts).filter(|part| wanted(*part)).collect();
    // Each group opens the file again, and has a batch of blocks in memory.
    let at_once = wanted.len().div_ceil(4 * rayon::current_num_threads()).max(1);
    let groups = wanted.par_chunks(at_once).map(|group| blocks_of(path, group, &visit));
    let found = groups.collect::<Result<Vec<Vec<T>>, FormatError>>()?;
    Ok(found.into_iter().flatten().collect())
}

/// What `visit` makes of the blocks of some parts.
fn blocks_of<T: Send>(
    path: &Path,
    parts: &[usize],
    visit: &(impl Fn(PackedBlock<'_>) -> Result<T, FormatError> + Sync),
) -> Result<Vec<T>, FormatError> {
    let mut blocks = BlockReader::open(path, |part| parts.contains(&part))?;
    let mut found = Vec::new();
    loop {
        let chunks = blocks.read_chunks()?;
        if chunks.is_empty() {
            return Ok(found);
        }
        let visited = chunks.into_par_iter().map(|chunk| visit(PackedBlock { chunk, reader: &blocks }));
        found.extend(visited.collect::<Result<Vec<T>, FormatError>>()?);
    }
}

/// A block as it lies in the file.
pub(super) struct PackedBlock<'a> {
    pub(super) chunk: Chunk,
    reader: &'a BlockReader<'a>,
}

impl PackedBlock<'_> {
    /// Number of its part.
    pub(super) fn part(&self) -> usize {
        self.chunk.layer_index
    }

    /// The block, unpacked by the decoder for everything.
    pub(super) fn unpack(self) -> Result<UncompressedBlock, FormatError> {
        self.reader.unpack(self.chunk)
    }
}

/// Packed blocks of some parts of a file, one after the other.
struct BlockReader<'a> {
    path: &'a Path,
    chunks: FilteredChunksReader<BufReader<std::fs::File>>,
}

impl<'a> BlockReader<'a> {
    fn open(path: &'a Path, wanted: impl Fn(usize) -> bool) -> Result<Self, FormatError> {
        let (file, _) = open_plain(path)?;
        let broken = |error: exr::error::Error| damaged(path, &error);
        let chunks = guarded(path, "OpenEXR", || {
            let reader = exr::block::read(BufReader::new(file), false).map_err(broken)?;
            let filter = |_: &MetaData, _: TileCoordinates, block: BlockIndex| {
                block.level == Vec2(0, 0) && wanted(block.layer)
            };
            reader.filter_chunks(false, filter).map_err(broken)
        })?;
        Ok(Self { path, chunks })
    }

    /// The next packed blocks; none at the end.
    fn read_chunks(&mut self) -> Result<Vec<Chunk>, FormatError> {
        let path = self.path;
        guarded(path, "OpenEXR", || {
            // A few for every thread: blocks of large images are large.
            let chunks = self.chunks.by_ref().take(4 * rayon::current_num_threads());
            chunks.collect::<Result<Vec<Chunk>, _>>().map_err(|error| damaged(path, &error))
        })
    }

    /// Unpacks a block. Guarded on its own thread: damaged data make the decoder panic.
    fn unpack(&self, chunk: Chunk) -> Result<UncompressedBlock, FormatError> {
        guarded(self.path, "OpenEXR", || {
            UncompressedBlock::decompress_chunk(chunk, self.chunks.meta_data(), false)
                .map_err(|error| damaged(self.path, &error))
        })
    }

    /// The next blocks, unpacked by several threads; `None` at the end.
    fn next_batch(&mut self) -> Result<Option<Vec<UncompressedBlock>>, FormatError> {
        let chunks = self.read_chunks()?;
        if chunks.is_empty() {
            return Ok(None);
        }
        let blocks = chunks.into_par_iter().map(|chunk| self.unpack(chunk));
        blocks.collect::<Result<Vec<_>, _>>().map(Some)
    }
}

pub(super) fn attribute(header: &Header, name: &str) -> Option<String> {
    let other = header.own_attributes.other.iter().chain(&header.shared_attributes.other);
    other.filter(|(key, _)| key.as_slice() == name.as_bytes()).find_map(|(_, value)| match value {
        AttributeValue::Text(text) => Some(String::from_utf8_lossy(text.as_slice()).into_owned()),
        _ => None,
    })
}

fn integer_attribute(header: &Header, name: &str) -> Option<i64> {
    header.own_attributes.other.iter().find_map(|(key, value)| match value {
        AttributeValue::I32(value) if key.as_slice() == name.as_bytes() => Some(i64::from(*value)),
        _ => None,
    })
}

fn part_name(header: &Header) -> Option<String> {
    let name = header.own_attributes.layer_name.as_ref()?;
    Some(String::from_utf8_lossy(name.as_slice()).into_owned())
}

pub(super) fn parse_json<T: serde::de::DeserializeOwned>(
    path: &Path,
    name: &str,
    text: &str,
) -> Result<T, FormatError> {
    serde_json::from_str(text).map_err(|error| {
        FormatError::malformed(
            path,
            format!("the attribute \"{name}\" is damaged: {error}"),
            "Write the file again",
        )
    })
}

pub(super) fn provenance(path: &Path, headers: &[Header]) -> Result<Option<Provenance>, FormatError> {
    let text = headers.iter().find_map(|header| attribute(header, PROVENANCE));
    text.map(|text| parse_json(path, PROVENANCE, &text)).transpose()
}

fn check_quantity<Q: Quantity>(path: &Path, header: &Header) -> Result<(), FormatError> {
    let wanted = || format!("{} in {}", Q::NAME, Q::UNIT);
    if let Some(quantity) = attribute(header, QUANTITY)
        && quantity != Q::NAME
    {
        let what = format!("the image holds {quantity}, not {}", wanted());
        return Err(FormatError::unit(path, what, "Read it as what it is"));
    }
    let Some(expected) = layout_unit(Q::UNIT) else { return Ok(()) };
    let Some(found) = attribute(header, UNITS) else {
        return Err(FormatError::unit(
            path,
            format!("no \"{UNITS}\" attribute states what the values are"),
            format!("Add it: \"{expected}\" for {}", wanted()),
        ));
    };
    if unit_factors(&found) != unit_factors(&expected) {
        return Err(FormatError::unit(
            path,
            format!("the values are in \"{found}\", not \"{expected}\""),
            "Read it as what it is",
        ));
    }
    Ok(())
}

/// Factors of a unit in order, without `nm^-1`, which some programs leave out.
fn unit_factors(unit: &str) -> Vec<&str> {
    let mut factors: Vec<&str> = unit.split('.').filter(|factor| *factor != "nm^-1").map(str::trim).collect();
    factors.sort_unstable();
    factors
}

fn damaged_basis(path: &Path) -> FormatError {
    FormatError::malformed(path, format!("the attribute \"{BASIS}\" is damaged"), "Write the file again")
}

/// The grid of the edges that a header states, if it does.
fn grid_of_edges(path: &Path, header: &Header) -> Result<Option<WavelengthGrid>, FormatError> {
    let Some(text) = attribute(header, EDGES) else { return Ok(None) };
    let edges: Result<Vec<f64>, _> = text.split(',').map(|edge| edge.trim().parse::<f64>()).collect();
    let damaged = || {
        let what = format!("the attribute \"{EDGES}\" is damaged");
        FormatError::malformed(path, what, "Write the file again")
    };
    let grid = WavelengthGrid::from_edges(&edges.map_err(|_| damaged())?);
    let grid =
        grid.map_err(|error| FormatError::malformed(path, error.to_string(), "Check the channel names"))?;
    Ok(Some(grid))
}

/// The wavelength grid of a component on a basis, and the coefficient that each channel holds.
fn coefficients(path: &Path, header: &Header, basis: BasisText) -> Result<BandChannels, FormatError> {
    let Some(grid) = grid_of_edges(path, header)? else {
        let what = format!("there is no attribute \"{EDGES}\"");
        return Err(FormatError::malformed(path, what, "Write the file again"));
    };
    let basis = basis.basis(grid.len()).ok_or_else(|| damaged_basis(path))?;
    let names: Vec<String> = (0..basis.len()).map(coefficient_channel).collect();
    let number = |channel: &ChannelDescription| names.iter().position(|name| channel.name.eq(name.as_str()));
    let bands: Vec<Option<usize>> = header.channels.list.iter().map(number).collect();
    if !(0..basis.len()).all(|number| bands.contains(&Some(number))) {
        let what = format!("not all of the {} coefficients of the basis are there", basis.len());
        return Err(FormatError::malformed(path, what, "Write the file again"));
    }
    Ok(BandChannels { grid, bands, basis: Some(basis) })
}

/// The wavelength grid, and the band that each channel holds.
pub(super) fn bands<Q: Quantity>(path: &Path, header: &Header) -> Result<BandChannels, FormatError> {
    if let Some(text) = attribute(header, BASIS) {
        return coefficients(path, header, parse_json(path, BASIS, &text)?);
    }
    let prefix = if layout_unit(Q::UNIT).is_some() { "S0." } else { "T." };
    let mut wavelengths: Vec<(f64, usize)> = Vec::new();
    for (index, channel) in header.channels.list.iter().enumerate() {
        let name = String::from_utf8_lossy(channel.name.as_slice()).into_owned();
        let Some(rest) = name.strip_prefix(prefix) else { continue };
        let number = rest.strip_suffix("nm").and_then(|text| text.replace(',', ".").parse::<f64>().ok());
        let Some(nm) = number.filter(|nm| nm.is_finite()) else {
            return Err(FormatError::unsupported(
                path,
                format!("channel \"{name}\" gives no wavelength in nm"),
                format!("Name channels like \"{prefix}385,000000nm\""),
            ));
        };
        wavelengths.push((nm, index));
    }
    if wavelengths.is_empty() {
        return Err(FormatError::unsupported(
            path,
            format!("there is no channel like \"{prefix}385,000000nm\" for {}", Q::NAME),
            "Only spectral images in the layout of Fichet et al. (2021) are read",
        ));
    }
    wavelengths.sort_by(|a, b| a.0.total_cmp(&b.0));
    let centers: Vec<f64> = wavelengths.iter().map(|pair| pair.0).collect();
    let grid = match grid_of_edges(path, header)? {
        Some(grid) => grid,
        None => WavelengthGrid::from_centers(&centers)
            .map_err(|error| FormatError::malformed(path, error.to_string(), "Check the channel names"))?,
    };
    let agree = grid.len() == centers.len()
        && centers.iter().enumerate().all(|(band, nm)| grid.bin_of(*nm) == Some(band));
    if !agree {
        return Err(FormatError::malformed(
            path,
            format!("the attribute \"{EDGES}\" does not fit the {} channels", centers.len()),
            "Write the file again",
        ));
    }
    let mut bands = vec![None; header.channels.list.len()];
    for (band, &(_, channel)) in wavelengths.iter().enumerate() {
        bands[channel] = Some(band);
    }
    Ok(BandChannels { grid, bands, basis: None })
}
