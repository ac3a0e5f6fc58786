//! ENVI: a header of text, and values in a file beside it.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::{Cube, CubeFacts, CubeLight, image_of};
use crate::FormatError;
use crate::error::shortened_list;
use crate::store::file::{MAX_IMAGE_BYTES, MAX_TEXT_BYTES, as_text, check_image_size, read_file};
use crate::store::input::{open_plain, read_bounded};
use crate::store::output::{WRITTEN_BY, write_atomically};
use crate::table::axis::check_axis;
use fluorspar::quote::excerpt;
use fluorspar::spectral::WavelengthGrid;
use fluorspar::units::number_text;

/// Bands that viewers show as red, green and blue, nm.
const SHOWN_NM: [f64; 3] = [640.0, 550.0, 460.0];

/// Header and values of the cube, then those of the maps that it has.
pub(super) fn files(path: &Path, facts: &CubeFacts) -> Vec<PathBuf> {
    let maps = [("depth", facts.maps.depth_m.is_empty()), ("part", facts.maps.part.is_empty())];
    let maps = maps.into_iter().filter(|(_, is_empty)| !is_empty).map(|(name, _)| map_path(path, name));
    std::iter::once(path.to_path_buf())
        .chain(maps)
        .flat_map(|path| [path.with_extension("dat"), path])
        .collect()
}

fn map_path(path: &Path, name: &str) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}_{name}.hdr"))
}

/// Writes the cube by pixels (`bip`), and `NAME_depth`, `NAME_part` where it has these maps.
pub(super) fn write_envi(path: &Path, cube: &Cube) -> Result<(), FormatError> {
    let (facts, maps, size, bands) =
        (&cube.facts, &cube.facts.maps, cube.light.size(), cube.light.grid().len());
    let values = cube.light.values().iter().flat_map(|value| value.to_le_bytes());
    write_pair(path, facts, (size, bands), ("ENVI Standard", 4), &fields_of(cube), values)?;
    if !maps.depth_m.is_empty() {
        let values = maps.depth_m.iter().flat_map(|value| value.to_le_bytes());
        let fields = [("data units", "m".to_owned())];
        write_pair(&map_path(path, "depth"), facts, (size, 1), ("ENVI Standard", 4), &fields, values)?;
    }
    if !maps.part.is_empty() {
        let names = maps.part_names.iter().map(|name| one_line(name));
        let names = list(std::iter::once("nothing".to_owned()).chain(names));
        let fields = [("classes", (maps.part_names.len() + 1).to_string()), ("class names", names)];
        let values = maps.part.iter().flat_map(|value| value.to_le_bytes());
        write_pair(&map_path(path, "part"), facts, (size, 1), ("ENVI Classification", 12), &fields, values)?;
    }
    Ok(())
}

/// What the header of a cube says of its bands and of the camera.
fn fields_of(cube: &Cube) -> Vec<(&'static str, String)> {
    let (facts, grid) = (&cube.facts, cube.light.grid());
    let centers = grid.centers_nm();
    let nearest = |wanted: &f64| {
        let distances = centers.iter().map(|nm| (nm - wanted).abs()).enumerate();
        distances.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(1, |(band, _)| band + 1).to_string()
    };
    let numbers = |values: &[f64]| list(values.iter().map(|value| number_text(*value)));
    let mut fields = vec![
        ("data units", cube.light.unit().to_owned()),
        ("wavelength units", "Nanometers".into()),
        ("wavelength", numbers(&centers)),
        ("fwhm", numbers(&grid.widths_nm())),
        ("wavelength edges", numbers(grid.edges_nm())),
        ("default bands", list(SHOWN_NM.iter().map(nearest))),
    ];
    fields.extend(facts.capture.iter().map(|capture| ("capture", one_line(capture))));
    fields.extend(facts.camera_matrix_px.map(|matrix| ("camera matrix px", numbers(matrix.as_flattened()))));
    fields.extend(facts.distance_m.map(|distance| ("distance m", number_text(distance))));
    fields
}

/// Values in braces.
fn list(values: impl Iterator<Item = String>) -> String {
    format!("{{ {} }}", values.collect::<Vec<_>>().join(", "))
}

/// A text without what ends a value.
fn one_line(text: &str) -> String {
    text.replace(['\n', '\r', '{', '}', ','], " ")
}

/// A header with the fields of its kind, and the values beside it.
fn write_pair(
    path: &Path,
    facts: &CubeFacts,
    ([width, height], bands): ([usize; 2], usize),
    (kind, data_type): (&str, u8),
    fields: &[(&str, String)],
    values: impl Iterator<Item = u8>,
) -> Result<(), FormatError> {
    let mut text = format!(
        "ENVI\ndescription = {{{}, {WRITTEN_BY}}}\nsamples = {width}\nlines = {height}\nbands = {bands}\nheader offset = 0\n\
         file type = {kind}\ndata type = {data_type}\ninterleave = bip\nbyte order = 0\n",
        one_line(&facts.title)
    );
    if let Some(pixel_mm) = facts.mm_per_pixel {
        let side = number_text(1e-3 * pixel_mm);
        text += &format!("pixel size = {{ {side}, {side}, units=Meters }}\n");
    }
    fields.iter().for_each(|(name, value)| text += &format!("{name} = {value}\n"));
    write_atomically(path, |file| file.write_all(text.as_bytes()))?;
    write_atomically(&path.with_extension("dat"), |file| {
        let mut bytes = Vec::with_capacity(1 << 16);
        for byte in values {
            bytes.push(byte);
            if bytes.len() == 1 << 16 {
                file.write_all(&bytes)?;
                bytes.clear();
            }
        }
        file.write_all(&bytes)
    })
}

/// Fields of a header by their names in lower case, and the file.
struct Header<'a> {
    path: &'a Path,
    fields: Vec<(String, String)>,
}

impl<'a> Header<'a> {
    fn parse(path: &'a Path, text: &str) -> Result<Self, FormatError> {
        if !text.trim_start().starts_with("ENVI") {
            let hint = "Its first line must be ENVI; open the header (.hdr), not the values";
            return Err(FormatError::malformed(path, "this is no header of ENVI", hint));
        }
        let mut fields = Vec::new();
        let mut lines = text.lines().skip(1).peekable();
        while let Some(line) = lines.next() {
            let Some((name, value)) = line.split_once('=') else { continue };
            let mut value = value.trim().to_owned();
            let mut is_open = value.starts_with('{') && !value.contains('}');
            while let Some(more) = lines.next_if(|_| is_open) {
                is_open = !more.contains('}');
                value.push(' ');
                value.push_str(more.trim());
            }
            fields.push((name.trim().to_ascii_lowercase(), value));
        }
        Ok(Self { path, fields })
    }

    fn get(&self, name: &str) -> Option<&str> {
        let found = self.fields.iter().find(|(field, _)| field == name)?;
        Some(found.1.trim_start_matches('{').trim_end_matches('}').trim())
    }

    fn malformed<T>(&self, what: String, hint: &str) -> Result<T, FormatError> {
        Err(FormatError::malformed(self.path, what, hint))
    }

    fn needed(&self, name: &str) -> Result<&str, FormatError> {
        let missing = || FormatError::malformed(self.path, format!("there is no line \"{name}\""), "Add it");
        self.get(name).ok_or_else(missing)
    }

    /// A whole number.
    fn whole(&self, name: &str) -> Result<u64, FormatError> {
        let text = self.needed(name)?;
        text.parse().or_else(|_| {
            self.malformed(format!("{name} = {} is no whole number", excerpt(text)), "Correct it")
        })
    }

    fn numbers(&self, name: &str) -> Result<Option<Vec<f64>>, FormatError> {
        let Some(text) = self.get(name) else { return Ok(None) };
        let number = |word: &str| {
            let word = word.trim();
            word.parse().or_else(|_| {
                self.malformed(format!("{name} holds {}, no number", excerpt(word)), "Correct it")
            })
        };
        text.split(',').map(number).collect::<Result<_, _>>().map(Some)
    }

    /// The bands, in nm.
    fn grid(&self, bands: usize) -> Result<WavelengthGrid, FormatError> {
        let hint = "Add `wavelength = { 400, 405, ... }` and `wavelength units = Nanometers`";
        let Some(mut centers) = self.numbers("wavelength")? else {
            return self.malformed("the bands have no wavelengths".into(), hint);
        };
        let unit = self.get("wavelength units").unwrap_or("nanometers").to_ascii_lowercase();
        match unit.as_str() {
            "nanometers" | "nm" => {}
            "micrometers" | "um" | "microns" => centers.iter_mut().for_each(|value| *value *= 1e3),
            other => return self.malformed(format!("wavelength units = {}", excerpt(other)), hint),
        }
        if centers.len() != bands {
            let what = format!("there are {bands} bands and {} wavelengths", centers.len());
            return self.malformed(what, hint);
        }
        check_axis(self.path, "the", &centers, |_| None)?;
        let grid = match self.edges(&centers)? {
            Some(edges) => WavelengthGrid::from_edges(&edges),
            None => WavelengthGrid::from_centers(&centers),
        };
        let hint = "Leave the bands that are not taken out of both header and values, or say where each begins and ends by `wavelength edges = { ... }`, nm";
        grid.or_else(|error| self.malformed(error.to_string(), hint))
    }

    /// Where bands begin and end, nm, if it is told: around the centers.
    fn edges(&self, centers: &[f64]) -> Result<Option<Vec<f64>>, FormatError> {
        let edges = self.numbers("wavelength edges")?;
        let is_around = |edges: &Vec<f64>| {
            let mut bands = edges.windows(2).zip(centers);
            edges.len() == centers.len() + 1 && bands.all(|(band, nm)| (band[0]..=band[1]).contains(nm))
        };
        if edges.as_ref().is_none_or(is_around) {
            return Ok(edges);
        }
        let what = "not every wavelength lies between the wavelength edges of its band".into();
        self.malformed(what, "Give the edges in nm, one more than bands, or leave `wavelength edges` out")
    }

    /// Whether the values are radiance, and what they are multiplied with.
    fn unit(&self) -> Result<(bool, f64), FormatError> {
        const UNITS: [(&str, bool, f64); 9] = [
            ("w/(srm2nm)", true, 1.0),
            ("w/(m2srnm)", true, 1.0),
            ("w/(m2nmsr)", true, 1.0),
            ("wm-2sr-1nm-1", true, 1.0),
            ("w/m2/sr/nm", true, 1.0),
            ("mw/(m2srnm)", true, 1e-3),
            ("uw/(cm2srnm)", true, 1e-2),
            ("w/(m2srum)", true, 1e-3),
            ("w/(m2nm)", false, 1.0),
        ];
        let hint = "Add what they are: `data units = W/(m^2 sr nm)`, mW/(m^2 sr nm), uW/(cm^2 sr nm) or W/(m^2 sr um)";
        let Some(text) = self.get("data units") else {
            return self.malformed("the values have no unit".into(), hint);
        };
        let plain: String =
            text.to_lowercase().replace('µ', "u").chars().filter(|c| !" ^*·".contains(*c)).collect();
        match UNITS.iter().find(|(name, ..)| *name == plain) {
            Some((_, is_radiance, factor)) => Ok((*is_radiance, *factor)),
            None => self.malformed(format!("data units = {} is not read", excerpt(text)), hint),
        }
    }

    /// Turns stored values `[pixel][band]` into light by the gains and offsets of the bands and the factor of the unit. Values that are
    /// to be ignored are refused.
    fn scale(&self, values: &mut [f32], bands: usize, factor: f64) -> Result<(), FormatError> {
        if self.get("reflectance scale factor").is_some() {
            let what = "it has a reflectance scale factor, and holds reflectances by that".to_owned();
            return self.malformed(what, "Give radiance, and leave that line out");
        }
        if let Some(ignored) = self.numbers("data ignore value")?.and_then(|numbers| numbers.first().copied())
            && let Some(place) = values.iter().position(|value| *value == ignored as f32)
        {
            let what = format!("value number {} is {ignored}, the data ignore value", place + 1);
            return self.malformed(what, "Put 0 in the place of all of them, and leave that line out");
        }
        let marks = self.numbers("bbl")?.unwrap_or_default();
        let bad = marks.iter().zip(1..).filter(|(mark, _)| **mark == 0.0);
        let bad: Vec<String> = bad.map(|(_, band)| band.to_string()).collect();
        if !bad.is_empty() {
            let what = format!("bands {} are bad by its list of bad bands (bbl)", shortened_list(&bad));
            let hint =
                "Leave them out of both header and values, or put 0 in their place, and leave that line out";
            return self.malformed(what, hint);
        }
        let of_bands = |name: &str, without: f64| match self.numbers(name)? {
            None => Ok(vec![without; bands]),
            Some(numbers) if numbers.len() == bands => Ok(numbers),
            Some(numbers) => {
                let what = format!("{name} holds {} numbers for {bands} bands", numbers.len());
                self.malformed(what, "Give one for each band")
            }
        };
        let (gains, offsets) = (of_bands("data gain values", 1.0)?, of_bands("data offset values", 0.0)?);
        for (value, (gain, offset)) in values.iter_mut().zip(gains.iter().zip(&offsets).cycle()) {
            *value = (factor * (gain * f64::from(*value) + offset)) as f32;
        }
        Ok(())
    }

    /// The file with the values.
    fn values(&self) -> Result<PathBuf, FormatError> {
        let bare = self.path.with_extension("");
        let ends = ["dat", "img", "raw", "bip", "bil", "bsq"];
        let named = ends.iter().flat_map(|end| [(*end).to_owned(), end.to_uppercase()]);
        let named = named.map(|end| self.path.with_extension(end));
        let found = named.chain([bare]).find(|path| path.is_file());
        let hint = "Keep it beside the header, named .dat, .img, .raw, .bip, .bil, .bsq or without an end";
        found.ok_or_else(|| FormatError::malformed(self.path, "the file with the values is missing", hint))
    }
}

/// A number from its bytes.
type Decode = fn(&[u8]) -> f32;

/// A number as it is stored: of so many bytes, and how they are read in little-endian order.
fn stored(data_type: u64) -> Option<(usize, Decode)> {
    fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
        bytes.first_chunk().copied().unwrap_or([0; N])
    }
    Some(match data_type {
        1 => (1, |b| f32::from(b[0])),
        2 => (2, |b| f32::from(i16::from_le_bytes(first(b)))),
        3 => (4, |b| i32::from_le_bytes(first(b)) as f32),
        4 => (4, |b| f32::from_le_bytes(first(b))),
        5 => (8, |b| f64::from_le_bytes(first(b)) as f32),
        12 => (2, |b| f32::from(u16::from_le_bytes(first(b)))),
        13 => (4, |b| u32::from_le_bytes(first(b)) as f32),
        _ => return None,
    })
}

/// Reads a cube of radiance or irradiance by its header.
pub(super) fn read_envi(path: &Path) -> Result<Cube, FormatError> {
    let bytes = read_file(path, MAX_TEXT_BYTES)?;
    let header = Header::parse(path, as_text(path, &bytes)?)?;
    let [width, height, bands] = [header.whole("samples")?, header.whole("lines")?, header.whole("bands")?];
    let grid = header.grid(bands.try_into().unwrap_or(usize::MAX))?;
    let (is_radiance, factor) = header.unit()?;
    let Some((size, decode)) = stored(header.whole("data type")?) else {
        let hint = "Read are bytes, integers of 16 and 32 bits and floating-point numbers (1 to 5, 12, 13)";
        return header.malformed(format!("data type = {}", header.needed("data type")?), hint);
    };
    check_image_size(path, width, height, size as u64 * bands, MAX_IMAGE_BYTES)?;
    let [width, height, bands] = [width, height, bands].map(|n| n as usize);
    let offset = header.get("header offset").map_or(Ok(0), |_| header.whole("header offset"))?;
    let is_big = header.get("byte order") == Some("1");
    let place = interleaved(&header, [width, height, bands])?;

    let stored =
        read_stored(&header.values()?, offset, width * height * bands * size, width.max(height).max(bands))?;
    let mut values = decoded(&stored, (size, is_big), decode, place)
        .map_err(|what| FormatError::malformed(path, what, "Put 0 in its place"))?;
    header.scale(&mut values, bands, factor)?;
    let size = [width, height];
    let light = match is_radiance {
        true => CubeLight::Radiance(image_of(path, &grid, size, values)?),
        false => CubeLight::Irradiance(image_of(path, &grid, size, values)?),
    };
    let facts = CubeFacts {
        title: header.get("description").unwrap_or_default().to_owned(),
        capture: header.get("capture").map(str::to_owned),
        ..CubeFacts::default()
    };
    Ok(Cube { light, facts })
}

/// So many bytes of the file with the values, behind others. `longest` are the columns, lines or bands, which are most.
fn read_stored(file: &Path, offset: u64, needed: usize, longest: usize) -> Result<Vec<u8>, FormatError> {
    let told = offset.saturating_add(needed as u64);
    let (_, length) = open_plain(file)?;
    // Less than a column, a line or a band more is padding
    if length < told || (length - told) as usize >= (needed / longest.max(1)).max(1) {
        let what = format!("it has {length} bytes, and its header tells of {told}");
        let hint = match length < told {
            true => "Copy both files again",
            // Its spectra would be torn apart
            false => "Give samples, lines, bands, data type and header offset as the values have them",
        };
        return Err(FormatError::malformed(file, what, hint));
    }
    let mut content = read_bounded(file, told)?;
    content.drain(..content.len().saturating_sub(needed));
    Ok(content)
}

/// Numbers of a size and order of bytes, each at its place.
fn decoded(
    stored: &[u8],
    (size, is_big): (usize, bool),
    decode: impl Fn(&[u8]) -> f32,
    place: impl Fn(usize) -> usize,
) -> Result<Vec<f32>, String> {
    let mut values = vec![0.0; stored.len() / size];
    let mut turned = vec![0; size];
    for (number, bytes) in stored.chunks_exact(size).enumerate() {
        turned.copy_from_slice(bytes);
        if is_big {
            turned.reverse();
        }
        let value = decode(&turned);
        if !value.is_finite() {
            return Err(format!("value number {} is {value}", number + 1));
        }
        values[place(number)] = value;
    }
    Ok(values)
}

/// Where a stored number belongs in `[row, col, band]`.
fn interleaved(
    header: &Header<'_>,
    [width, height, bands]: [usize; 3],
) -> Result<Box<dyn Fn(usize) -> usize>, FormatError> {
    match header.needed("interleave")?.to_ascii_lowercase().as_str() {
        "bip" => Ok(Box::new(|number| number)),
        "bil" => Ok(Box::new(move |number| {
            let (row, rest) = (number / (bands * width), number % (bands * width));
            (row * width + rest % width) * bands + rest / width
        })),
        "bsq" => Ok(Box::new(move |number| number % (height * width) * bands + number / (height * width))),
        other => header.malformed(format!("interleave = {}", excerpt(other)), "It is bip, bil or bsq"),
    }
}
