//! OME-TIFF: a page for each channel, and an XML description that Fiji, napari, `QuPath` and OMERO read.

use std::fmt::Write as _;
use std::io;
use std::path::Path;

use tiff::encoder::{TiffEncoder, colortype::Gray32Float};
use tiff::tags::Tag;

use super::Cube;
use crate::FormatError;
use crate::store::output::{WRITTEN_BY, write_atomically};
use fluorspar::units::number_text;

/// A channel of an image.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OmeChannel {
    /// Its name.
    pub name: String,
    /// Middle of the light that it sees, nm.
    pub emission_nm: Option<f64>,
    /// Middle of the light that excites, nm.
    pub excitation_nm: Option<f64>,
}

/// What the description says of an image beside its channels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OmeFacts {
    /// Title.
    pub title: String,
    /// Side of a pixel on what is seen, mm.
    pub mm_per_pixel: Option<f64>,
    /// Exposure time, s.
    pub exposure_s: Option<f64>,
    /// Unit of the values, in words.
    pub unit: String,
}

/// Writes the bands of a cube as channels.
pub(super) fn write_cube(path: &Path, cube: &Cube) -> Result<(), FormatError> {
    let (grid, [width, height], values) = (cube.light.grid(), cube.light.size(), cube.light.values());
    let channel = |nm: f64| OmeChannel {
        name: format!("{} nm", number_text(nm)),
        emission_nm: Some(nm),
        excitation_nm: None,
    };
    let channels: Vec<OmeChannel> = grid.centers_nm().into_iter().map(channel).collect();
    let facts = OmeFacts {
        title: cube.facts.title.clone(),
        mm_per_pixel: cube.facts.mm_per_pixel,
        exposure_s: None,
        unit: cube.light.unit().into(),
    };
    write_ome_tiff(path, [width, height], values, &channels, &facts)
}

/// Writes `[row, col, channel]`, f32, one page for each channel.
///
/// # Errors
/// When the values do not fill the image, or the file can't be written.
pub fn write_ome_tiff(
    path: &Path,
    [width, height]: [usize; 2],
    values: &[f32],
    channels: &[OmeChannel],
    facts: &OmeFacts,
) -> Result<(), FormatError> {
    check_values(path, [width, height], values, channels)?;
    let description = description([width, height], channels, facts);
    write_atomically(path, |writer| {
        let pages = || {
            // Beyond 4 GiB only the other kind has room
            let mut encoder = TiffEncoder::new_big(writer)?;
            for channel in 0..channels.len() {
                let mut page = encoder.new_image::<Gray32Float>(width as u32, height as u32)?;
                if channel == 0 {
                    page.encoder().write_tag(Tag::ImageDescription, description.as_str())?;
                }
                let plane: Vec<f32> = values.iter().skip(channel).step_by(channels.len()).copied().collect();
                page.write_data(&plane)?;
            }
            Ok(())
        };
        pages().map_err(|error| match error {
            tiff::TiffError::IoError(source) => source,
            other => io::Error::other(other),
        })
    })
}

/// Refuses values that do not fill an image.
pub(super) fn check_values(
    path: &Path,
    [width, height]: [usize; 2],
    values: &[f32],
    channels: &[OmeChannel],
) -> Result<(), FormatError> {
    if values.len() == width * height * channels.len() && !values.is_empty() {
        return Ok(());
    }
    let what =
        format!("{} values do not fill {} channels of {height} x {width}", values.len(), channels.len());
    Err(FormatError::unwritable(path, what, "Give one value per pixel and channel"))
}

/// The XML, in ASCII.
fn description([width, height]: [usize; 2], channels: &[OmeChannel], facts: &OmeFacts) -> String {
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><!-- {WRITTEN_BY} --><OME \
         xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\" \
         xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" \
         xsi:schemaLocation=\"http://www.openmicroscopy.org/Schemas/OME/2016-06 \
         http://www.openmicroscopy.org/Schemas/OME/2016-06/ome.xsd\" Creator=\"fluorspar {}\"><Image ID=\"Image:0\" \
         Name=\"{}\"><Description>{}</Description><Pixels ID=\"Pixels:0\" DimensionOrder=\"XYCZT\" Type=\"float\" \
         BigEndian=\"false\" SizeX=\"{width}\" SizeY=\"{height}\" SizeC=\"{}\" SizeZ=\"1\" SizeT=\"1\"",
        env!("CARGO_PKG_VERSION"),
        escaped(&facts.title),
        escaped(&facts.unit),
        channels.len()
    );
    if let Some(side) = facts.mm_per_pixel {
        for axis in ["X", "Y"] {
            let _ = write!(text, " PhysicalSize{axis}=\"{side}\" PhysicalSize{axis}Unit=\"mm\"");
        }
    }
    text.push('>');
    add_channels(&mut text, channels, facts.exposure_s);
    text.push_str("</Pixels></Image></OME>");
    text
}

/// Channels, their pages, and how long these were exposed.
fn add_channels(text: &mut String, channels: &[OmeChannel], exposure_s: Option<f64>) {
    for (number, channel) in channels.iter().enumerate() {
        let name = escaped(&channel.name);
        let _ = write!(text, "<Channel ID=\"Channel:0:{number}\" Name=\"{name}\" SamplesPerPixel=\"1\"");
        for (what, nm) in [("Emission", channel.emission_nm), ("Excitation", channel.excitation_nm)] {
            if let Some(nm) = nm.filter(|nm| *nm > 0.0) {
                let _ = write!(text, " {what}Wavelength=\"{nm}\" {what}WavelengthUnit=\"nm\"");
            }
        }
        text.push_str("/>");
    }
    for number in 0..channels.len() {
        let _ = write!(text, "<TiffData FirstC=\"{number}\" IFD=\"{number}\" PlaneCount=\"1\"/>");
    }
    if let Some(seconds) = exposure_s {
        for number in 0..channels.len() {
            let _ = write!(
                text,
                "<Plane TheC=\"{number}\" TheZ=\"0\" TheT=\"0\" ExposureTime=\"{seconds}\" ExposureTimeUnit=\"s\"/>"
            );
        }
    }
}

/// Text within XML, in ASCII.
fn escaped(text: &str) -> String {
    let one = |letter: char| match letter {
        '<' | '>' | '&' | '"' | '\'' => format!("&#{};", u32::from(letter)),
        letter if letter.is_ascii_graphic() || letter == ' ' => letter.to_string(),
        letter if letter.is_control() => " ".to_owned(),
        letter => format!("&#{};", u32::from(letter)),
    };
    text.chars().map(one).collect()
}
