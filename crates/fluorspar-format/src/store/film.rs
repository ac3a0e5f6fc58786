//! Films: the exact sums of a render, to resume, extend and merge it.
//!
//! Little-endian. `FLSPFILM`, format (u32), length of the header (u64), header (JSON), feature maps as raw numbers, then
//! one record per tile that holds samples: for every plane the bytes per integer (u8; 128 more where they have a sign) and the integers,
//! `[pixel][band]`,
//! then a checksum (u64).

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::file::check_image_size;
use super::input::open_plain;
use super::output::write_atomically;
use crate::image::basis_text::BasisText;
use crate::{FileFormat, FormatError, Loaded, Provenance};
use fluorspar::image::film::film_bytes;
use fluorspar::image::{Component, ComponentBases, FeatureMaps, Film, FilmLayout, StatisticsKind, View};
use fluorspar::spectral::WavelengthGrid;

pub(crate) const MAGIC: &[u8; 8] = b"FLSPFILM";
/// Largest film that is read, bytes in memory.
const MAX_FILM_BYTES: u64 = 1 << 40;
/// Flag of planes with negative integers, beside the bytes per integer: two's complement.
const SIGNED: u8 = 0x80;
const MAX_HEADER_BYTES: u64 = 1 << 28;

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    width: usize,
    height: usize,
    wavelength_edges_nm: Vec<f64>,
    components: Vec<Component>,
    statistics: StatisticsKind,
    /// Of each component its basis; none where all bands of all are summed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    bases: Vec<Option<BasisText>>,
    quantum_exponents: Vec<i16>,
    pilot_levels: Vec<f32>,
    scene_sha256: String,
    part_names: Vec<String>,
    material_names: Vec<String>,
    /// The camera, where it is known.
    #[serde(default)]
    view: Option<View>,
    /// Which feature maps follow: depth, normal, part, uv.
    features: [bool; 4],
    /// Samples of each tile, row by row.
    samples: Vec<Vec<Range<u32>>>,
    provenance: Option<Provenance>,
}

/// Writes a film completely or not at all, and on the disk before it takes the place of an earlier one.
///
/// # Errors
/// When the file can't be written.
pub fn write_film(path: &Path, film: &Film, provenance: Option<&Provenance>) -> Result<(), FormatError> {
    let (layout, features) = (film.layout(), film.features());
    let header = Header {
        width: layout.width,
        height: layout.height,
        wavelength_edges_nm: layout.grid.edges_nm().to_vec(),
        components: layout.components.clone(),
        statistics: layout.statistics,
        bases: layout.bases.iter().map(|basis| basis.as_deref().map(BasisText::of)).collect(),
        quantum_exponents: layout.exponents.clone(),
        pilot_levels: layout.levels.clone(),
        scene_sha256: layout.scene_digest.clone(),
        part_names: features.part_names.clone(),
        material_names: features.material_names.clone(),
        view: features.view,
        features: [
            !features.depth_m.is_empty(),
            !features.normal.is_empty(),
            !features.part.is_empty(),
            !features.uv.is_empty(),
        ],
        samples: film.tiles().map(|(tile, _)| tile.samples.clone()).collect(),
        provenance: provenance.cloned(),
    };
    write_atomically(path, |writer| {
        let json = serde_json::to_vec(&header)?;
        writer.write_all(MAGIC)?;
        writer.write_all(&FileFormat::FILM.version().to_le_bytes())?;
        writer.write_all(&(json.len() as u64).to_le_bytes())?;
        writer.write_all(&json)?;
        write_f32(writer, &features.depth_m)?;
        write_f32(writer, features.normal.as_flattened())?;
        for part in &features.part {
            writer.write_all(&part.to_le_bytes())?;
        }
        write_f32(writer, features.uv.as_flattened())?;
        let mut record = Vec::new();
        for (tile, sums) in film.tiles().filter(|(tile, _)| !tile.samples.is_empty()) {
            let pixel_len = film.pixel_len();
            let used = &sums[..tile.pixels() * pixel_len];
            for plane in planes_of(layout) {
                let values = || used.chunks(pixel_len).flat_map(|pixel| pixel[plane.clone()].iter().copied());
                // Bits of the value, and of its sign where any is negative
                let magnitude = |value: u64| value ^ ((value as i64) >> 63) as u64;
                let most = values().map(magnitude).max().unwrap_or(0);
                let is_signed = values().any(|value| (value as i64) < 0);
                let width = (64 - most.leading_zeros() as usize + usize::from(is_signed)).div_ceil(8);
                record.clear();
                record.push(width as u8 | if is_signed { SIGNED } else { 0 });
                values().for_each(|value| record.extend_from_slice(&value.to_le_bytes()[..width]));
                writer.write_all(&record)?;
            }
            writer.write_all(&checksum(used).to_le_bytes())?;
        }
        Ok(())
    })
}

fn write_f32(writer: &mut BufWriter<File>, values: &[f32]) -> io::Result<()> {
    values.iter().try_for_each(|value| writer.write_all(&value.to_le_bytes()))
}

/// Integers of each plane of a pixel.
fn planes_of(layout: &FilmLayout) -> Vec<Range<usize>> {
    let mut end = 0;
    let lens = layout.plane_lens().into_iter();
    lens.map(|len| {
        end += len;
        end - len..end
    })
    .collect()
}

/// Notices changed and swapped integers; no protection against anyone who means harm.
fn checksum(values: &[u64]) -> u64 {
    values.iter().fold(0x9e37_79b9_7f4a_7c15, |sum: u64, value| {
        (sum.rotate_left(5) ^ value).wrapping_mul(0xd134_2543_de82_ef95)
    })
}

/// Reads a film written by [`write_film`].
///
/// # Errors
/// Other files, other versions, damaged or incomplete files.
pub fn read_film(path: &Path) -> Result<Loaded<Film>, FormatError> {
    read(path, None)
}

/// Reads a film that holds samples in some rows of tiles only, with memory for no others.
///
/// # Errors
/// As [`read_film`]; and samples in other rows.
pub fn read_film_rows(path: &Path, tile_rows: Range<usize>) -> Result<Loaded<Film>, FormatError> {
    read(path, Some(tile_rows))
}

/// Layout of a film, and whether it holds samples, without reading them.
///
/// # Errors
/// As [`read_film`], for as much of the file as is read.
pub fn read_film_layout(path: &Path) -> Result<(FilmLayout, bool), FormatError> {
    let Opened { header, layout, .. } = open(path)?;
    Ok((layout, header.samples.iter().any(|samples| !samples.is_empty())))
}

fn read_failed(path: &Path, source: io::Error) -> FormatError {
    match source.kind() {
        io::ErrorKind::UnexpectedEof => {
            FormatError::malformed(path, "the file ends too early", "Copy the file again")
        }
        _ => FormatError::io(path, "read", source),
    }
}

fn damaged_film(path: &Path, what: String) -> FormatError {
    FormatError::malformed(path, what, "Use an earlier copy, or render again")
}

/// A film file, read as far as the header.
struct Opened {
    reader: BufReader<File>,
    /// Bytes of the file.
    length: u64,
    /// Without what went into the layout.
    header: Header,
    layout: FilmLayout,
}

fn open(path: &Path) -> Result<Opened, FormatError> {
    let failed = |source| read_failed(path, source);
    let damaged = |what| damaged_film(path, what);
    let (file, length) = open_plain(path)?;
    let mut reader = BufReader::with_capacity(1 << 18, file);
    let mut magic = [0; 8];
    let known = reader.read_exact(&mut magic).is_ok() && magic == *MAGIC;
    if !known {
        return Err(FormatError::malformed(
            path,
            "this is not a film",
            "Name a file that `render --film` wrote",
        ));
    }
    let mut word = [0; 4];
    reader.read_exact(&mut word).map_err(failed)?;
    let stated = i64::from(u32::from_le_bytes(word));
    FileFormat::FILM.check(Some(stated)).map_err(|other| FormatError::other_format(path, other))?;
    let mut word = [0; 8];
    reader.read_exact(&mut word).map_err(failed)?;
    let header_len = u64::from_le_bytes(word);
    if header_len > MAX_HEADER_BYTES.min(length) {
        return Err(damaged(format!("the header claims {header_len} bytes in a file of {length}")));
    }
    let mut json = vec![0; header_len as usize];
    reader.read_exact(&mut json).map_err(failed)?;
    let mut header: Header =
        serde_json::from_slice(&json).map_err(|error| damaged(format!("the header is damaged: {error}")))?;
    let grid = WavelengthGrid::from_edges(&header.wavelength_edges_nm).map_err(|e| damaged(e.to_string()))?;
    check_image_size(path, header.width as u64, header.height as u64, 1, MAX_FILM_BYTES)?;
    let bases = std::mem::take(&mut header.bases).into_iter();
    let bases: Option<ComponentBases> = bases
        .map(|text| match text {
            None => Some(None),
            Some(text) => text.basis(grid.len()).map(|basis| Some(Arc::new(basis))),
        })
        .collect();
    let count = header.components.len();
    let fits = |bases: &ComponentBases| {
        bases.is_empty() || (bases.len() == count && header.statistics == StatisticsKind::None)
    };
    let bases =
        bases.filter(fits).ok_or_else(|| damaged("the bases of the components are damaged".into()))?;
    let values = 3 * count * grid.len();
    if film_bytes(header.width, header.height, values) > MAX_FILM_BYTES {
        return Err(FormatError::too_large(path, "the film is too large", format!("{MAX_FILM_BYTES} bytes")));
    }
    let layout = FilmLayout {
        grid,
        width: header.width,
        height: header.height,
        components: std::mem::take(&mut header.components),
        bases,
        statistics: header.statistics,
        exponents: std::mem::take(&mut header.quantum_exponents),
        levels: std::mem::take(&mut header.pilot_levels),
        scene_digest: std::mem::take(&mut header.scene_sha256),
    };
    let stored: usize = layout.plane_lens()[..count].iter().sum();
    if layout.exponents.len() != stored || layout.levels.len() != count * layout.grid.len() {
        return Err(damaged("the quanta do not fit the components".into()));
    }
    Ok(Opened { reader, length, header, layout })
}

fn read(path: &Path, tile_rows: Option<Range<usize>>) -> Result<Loaded<Film>, FormatError> {
    let failed = |source| read_failed(path, source);
    let damaged = |what| damaged_film(path, what);
    let Opened { mut reader, length, header, layout } = open(path)?;
    let pixels = header.width * header.height;
    // Nothing is allocated for pixels that the file does not hold.
    let has = header.features;
    let feature_bytes =
        pixels as u64 * [4, 12, 2, 8].iter().zip(has).map(|(n, has)| n * u64::from(has)).sum::<u64>();
    if feature_bytes > length {
        return Err(damaged(format!("the feature maps claim {feature_bytes} bytes in a file of {length}")));
    }
    let count = |index: usize, values: usize| if has[index] { values } else { 0 };
    let depth_m = read_f32(&mut reader, count(0, pixels)).map_err(failed)?;
    let normal = read_f32(&mut reader, count(1, 3 * pixels)).map_err(failed)?;
    let mut part = vec![0; 2 * count(2, pixels)];
    reader.read_exact(&mut part).map_err(failed)?;
    let uv = read_f32(&mut reader, count(3, 2 * pixels)).map_err(failed)?;
    let features = FeatureMaps {
        depth_m,
        normal: normal.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect(),
        part: part.chunks_exact(2).map(|v| u16::from_le_bytes([v[0], v[1]])).collect(),
        uv: uv.chunks_exact(2).map(|v| [v[0], v[1]]).collect(),
        part_names: header.part_names,
        material_names: header.material_names,
        view: header.view,
    };
    let planes = planes_of(&layout);
    let all = 0..layout.tile_rows();
    let mut film = Film::of_tile_rows(layout, features, tile_rows.unwrap_or(all));
    let pixel_len = film.pixel_len();
    let mut tiles = film.tiles_mut();
    if tiles.len() != header.samples.len() {
        return Err(damaged(format!("{} tiles are listed, not {}", header.samples.len(), tiles.len())));
    }
    let mut bytes = Vec::new();
    for (task, samples) in tiles.iter_mut().zip(header.samples) {
        if samples.iter().any(|range| range.start >= range.end)
            || samples.windows(2).any(|pair| pair[0].end >= pair[1].start)
        {
            return Err(damaged("the samples of a tile are out of order".into()));
        }
        if samples.is_empty() {
            continue;
        }
        let Some(used) = task.sums.get_mut(..task.tile.pixels() * pixel_len) else {
            let (row, col) = (task.tile.row, task.tile.col);
            return Err(damaged(format!("it holds samples at row {row}, column {col}, where it should not")));
        };
        for plane in &planes {
            let mut width = [0];
            reader.read_exact(&mut width).map_err(failed)?;
            let (width, is_signed) = (usize::from(width[0] & !SIGNED), width[0] & SIGNED != 0);
            if width > 8 || (is_signed && width == 0) {
                return Err(damaged(format!("a plane of {width} bytes per integer")));
            }
            bytes.resize(task.tile.rows * task.tile.cols * plane.len() * width, 0);
            reader.read_exact(&mut bytes).map_err(failed)?;
            if width == 0 {
                continue;
            }
            let mut packed = bytes.chunks_exact(width);
            for pixel in used.chunks_mut(pixel_len) {
                for (value, packed) in pixel[plane.clone()].iter_mut().zip(&mut packed) {
                    let mut word = [0; 8];
                    word[..width].copy_from_slice(packed);
                    *value = u64::from_le_bytes(word);
                    if is_signed {
                        let above = 64 - 8 * width as u32;
                        *value = ((*value << above) as i64 >> above) as u64;
                    }
                }
            }
        }
        let mut word = [0; 8];
        reader.read_exact(&mut word).map_err(failed)?;
        if u64::from_le_bytes(word) != checksum(used) {
            let (row, col) = (task.tile.row, task.tile.col);
            return Err(damaged(format!("the tile at row {row}, column {col} is damaged")));
        }
        task.tile.samples = samples;
    }
    if reader.read(&mut [0]).map_err(failed)? != 0 {
        return Err(damaged("the file has data behind its end".into()));
    }
    drop(tiles);
    Ok(Loaded { image: film, provenance: header.provenance })
}

fn read_f32(reader: &mut impl Read, values: usize) -> io::Result<Vec<f32>> {
    let mut bytes = vec![0; 4 * values];
    reader.read_exact(&mut bytes)?;
    Ok(bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
}
