//! Descriptions of the frames of cameras: what a file's tags tell, what its pixels show, and what must be assumed.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::camera_raw::{no_frame, refuse_camera_raw};
use super::described_frame::{Description, JudgedFrame, Samples, image_of_parts};
use super::dng::{
    DngFrame, EXPOSURE_TIME, ISO, Told, bits_of, camera_number, gain_of_iso, is_dng, read_dng_description,
};
use super::frame_judgement::{FrameRemark, StoredFrame, alignment_words, left_aligned_bits, unused_bits};
use super::raw::{read_frame_png, read_judged_frame, tiff_tags};
use super::tiff_directory::{Directory, TiffBytes};
use super::tiff_image::{TiffPixels, read_tiff_pixels};
use crate::store::file::{MAX_IMAGE_BYTES, check_not_empty, read_file, sidecar_path, write_sidecar};
use crate::store::input::open_plain;
use crate::{FileFormat, FormatError};
use fluorspar::image::{Mosaic, SensorImage};

/// What the user knows of a frame; the rest is taken from its file or assumed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameFacts {
    /// Name of the capture that it is a frame of.
    pub label: Option<String>,
    /// Color filter array.
    pub mosaic: Option<Mosaic>,
    /// Whether three numbers a pixel were measured there, and not interpolated.
    pub is_measured: bool,
    /// Digital number without light.
    pub black_level: Option<f64>,
    /// Digital number from which a pixel counts as saturated.
    pub white_level: Option<u16>,
    /// Bits of the converter.
    pub bit_depth: Option<u8>,
    /// Whether its values stand in the upper ones of 16 bits, where their size does not show it.
    pub is_left_aligned: bool,
    /// Exposure time, s.
    pub exposure_s: Option<f64>,
    /// Analog gain.
    pub gain: Option<f64>,
    /// Digital numbers per electron.
    pub dn_per_electron: Option<f64>,
    /// Temporal noise of a dark pixel, digital numbers rms.
    pub read_noise_dn: Option<f64>,
}

/// Where a value of a description comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FactSource {
    /// From the user.
    Given,
    /// From the tags of the file.
    Tag,
    /// From the description beside the file.
    Described,
    /// From the pixels.
    Pixels,
    /// From nowhere: a guess.
    Assumed,
    /// Nobody knows.
    Unknown,
}

impl FactSource {
    /// One word.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Given => "given",
            Self::Tag => "from its tags",
            Self::Described => "from its description",
            Self::Pixels => "from its pixels",
            Self::Assumed => "assumed",
            Self::Unknown => "not known",
        }
    }
}

/// One value of a description.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameFact {
    /// Its key in the description.
    pub key: &'static str,
    /// The value in words.
    pub value: String,
    /// Where it comes from.
    pub source: FactSource,
    /// Why it is assumed, and what to give instead; what follows from it.
    pub remark: String,
    /// Whether it makes results doubtful.
    pub is_doubtful: bool,
}

impl FrameFact {
    /// All of it but its source.
    #[must_use]
    pub fn sentence(&self) -> String {
        format!("{}: {}; {}", self.key, self.value, self.remark)
    }
}

/// The description of a frame, not written yet.
#[derive(Debug)]
pub struct FrameDescription {
    frame: PathBuf,
    description: Description,
    /// Its values.
    pub facts: Vec<FrameFact>,
    /// What of it is doubtful.
    pub warnings: Vec<String>,
}

impl FrameDescription {
    /// Where it belongs: `FRAME.json`.
    #[must_use]
    pub fn path(&self) -> PathBuf {
        sidecar_path(&self.frame)
    }

    /// The description as JSON.
    ///
    /// # Errors
    /// A number that JSON does not know.
    pub fn to_json(&self) -> Result<serde_json::Value, FormatError> {
        serde_json::to_value(&self.description).map_err(|source| FormatError::json(&self.path(), source))
    }

    /// Writes the description beside its frame. It does not claim that this program wrote the frame: that stays the user's.
    ///
    /// # Errors
    /// A file that can't be written.
    pub fn write(&self) -> Result<(), FormatError> {
        write_sidecar(&self.frame, &self.description)
    }
}

/// Where the description of a frame belongs: `FRAME.json` beside it.
#[must_use]
pub fn description_path(frame: &Path) -> PathBuf {
    sidecar_path(frame)
}

/// A raw frame with what is known of it.
#[derive(Clone, Debug)]
pub struct DescribedFrame {
    /// The frame, turned as viewers show it.
    pub image: SensorImage,
    /// What it is. Doubtful are plateaus, a black level above the pixels and tags without effect.
    pub facts: Vec<FrameFact>,
}

/// Reads a raw frame as [`crate::read_sensor_image`] does, and tells what it is.
///
/// # Errors
/// Those of [`crate::read_sensor_image`].
pub fn read_described_frame(path: &Path) -> Result<DescribedFrame, FormatError> {
    let frame = read_judged_frame(path)?;
    let source = if sidecar_path(path).exists() { FactSource::Described } else { FactSource::Tag };
    let facts = frame_table(&frame, |_| (source, String::new()));
    Ok(DescribedFrame { image: frame.image, facts })
}

/// What a frame is: the only place that words it. `said` tells where the value of a key comes from, and what is said about that.
fn frame_table(frame: &JudgedFrame, said: impl Fn(&str) -> (FactSource, String)) -> Vec<FrameFact> {
    let JudgedFrame { image, remarks, .. } = frame;
    let mut list = Vec::new();
    let tell = |list: &mut Vec<FrameFact>, key: &'static str, value: String| {
        let (source, remark) = said(key);
        list.push(FrameFact { key, value, source, remark, is_doubtful: false });
    };
    // Remarks that belong to a value follow it
    let found = |list: &mut Vec<FrameFact>, keys: &[&str]| {
        for FrameRemark { key, value, remark, is_doubtful } in
            remarks.iter().filter(|r| keys.contains(&r.key))
        {
            let source = if FROM_PIXELS.contains(key) { FactSource::Pixels } else { FactSource::Tag };
            let (value, remark) = (value.clone(), remark.clone());
            list.push(FrameFact { key, value, source, remark, is_doubtful: *is_doubtful });
        }
    };
    let known = |list: &mut Vec<FrameFact>, key: &'static str, unit: &str, value: f64| {
        tell(list, key, if value > 0.0 { format!("{value}{unit}") } else { String::new() });
        if let (Some(fact), true) = (list.last_mut(), value <= 0.0) {
            fact.source = FactSource::Unknown;
        }
    };
    tell(&mut list, "label", image.label.clone());
    tell(&mut list, "width, height", format!("{} x {}", image.width, image.height));
    found(&mut list, &["orientation"]);
    tell(&mut list, "mosaic", letters(image));
    tell(&mut list, "bit_depth", image.bit_depth.to_string());
    found(&mut list, &["alignment"]);
    tell(&mut list, "black_level", format!("{} DN", image.black_level));
    found(&mut list, &["black level by place", "black level"]);
    tell(&mut list, "white_level", format!("{} DN", image.white_level));
    found(&mut list, &["white level by plane", "plateau"]);
    tell(&mut list, "gain", image.gain.to_string());
    known(&mut list, "exposure_s", " s", image.exposure_s);
    known(&mut list, "dn_per_electron", "", image.dn_per_electron);
    known(&mut list, "read_noise_dn", " DN", image.read_noise_dn);
    found(&mut list, &["gain map", "opcodes"]);
    list
}

/// Remarks that no tag makes.
const FROM_PIXELS: [&str; 3] = ["alignment", "plateau", "black level"];

/// Describes the frame of a camera: a DNG, or a TIFF or PNG of gray or RGB with 8 or 16 bits.
///
/// # Errors
/// A file that is no such frame; facts that contradict each other.
pub fn describe_frame(path: &Path, given: &FrameFacts) -> Result<FrameDescription, FormatError> {
    let (mut file, length) = open_plain(path)?;
    check_not_empty(path, length)?;
    let mut magic = Vec::new();
    Read::by_ref(&mut file).take(16).read_to_end(&mut magic).map_err(|e| FormatError::io(path, "read", e))?;
    let mut facts = Facts { given, said: Vec::new() };
    let (mut description, stored) = if magic.starts_with(b"\x89PNG") {
        let StoredFrame { width, height, data, tags, .. } = read_frame_png(path)?;
        let is_narrow = tags.bits.is_none_or(|bits| bits <= 8) && data.iter().all(|&value| value < 256);
        let bits = if is_narrow { 8 } else { 16 };
        let samples = data.len() / (width * height).max(1);
        let pixels = TiffPixels { width, height, samples, bits, data };
        let description = facts.of_pixels(path, &pixels, None, tags.bits)?;
        (description, StoredFrame { width, height, data: pixels.data, tags, ..StoredFrame::default() })
    } else if magic.starts_with(b"II") || magic.starts_with(b"MM") {
        let bytes = read_file(path, MAX_IMAGE_BYTES)?;
        if is_dng(&bytes) {
            let DngFrame { description, stored, told } = read_dng_description(path, &bytes)?;
            if given.is_left_aligned {
                let what = "the levels of a DNG tell where its values stand";
                return Err(FormatError::unsupported(path, what, "Leave --left-aligned out"));
            }
            (facts.of_dng(description, &told), stored)
        } else {
            refuse_camera_raw(path, &bytes)?;
            let (file, _) = open_plain(path)?;
            let pixels = read_tiff_pixels(path, file, &bytes)?;
            let description = facts.of_pixels(path, &pixels, TiffBytes::new(&bytes).as_ref(), None)?;
            let TiffPixels { width, height, data, .. } = pixels;
            let tags = tiff_tags(&bytes);
            (description, StoredFrame { width, height, data, tags, ..StoredFrame::default() })
        }
    } else {
        return Err(no_frame(path, &magic));
    };
    if given.is_measured && description.samples != Samples::Measured {
        let what = "it has one number a pixel, where not all colors were measured";
        return Err(FormatError::unsupported(path, what, "Leave --measured out"));
    }
    facts.of_levels(&mut description);
    // What the reader would refuse is refused here.
    let frame = image_of_parts(path, stored, &description)?;
    let mut list = frame_table(&frame, |key| facts.of_key(key));
    list.extend(facts.doubtful_mosaic(&frame.image));
    let is_assumed = |fact: &FrameFact| fact.key == "black_level" && fact.source == FactSource::Assumed;
    let doubt = list.iter().any(is_assumed).then(|| {
        let image = &frame.image;
        let doubt = black_level_doubt(&image.data, image.black_level, image.white_level)?;
        Some(format!("{doubt}. Give --black-level, the mean of a frame with the cap on the lens"))
    });
    let doubtful = list.iter().filter(|fact| fact.is_doubtful).map(FrameFact::sentence);
    let warnings = doubt.flatten().into_iter().chain(doubtful).collect();
    Ok(FrameDescription { frame: path.into(), description, facts: list, warnings })
}

/// The largest number of some bits.
fn largest_of(bits: u8) -> f64 {
    f64::from(((1u32 << bits.clamp(1, 16)) - 1) as u16)
}

/// What to do about a black level that is assumed.
const OTHER_BLACK_LEVEL: &str =
    "--black-level gives another; dark frames given to `analyze --dark` replace it";

/// Share of the darkest pixels, which may be defect, that tell nothing of a black level.
const DEFECT_SHARE: f64 = 1e-3;
/// Part of the range that the darkest pixels lie above a black level of 0 where there is one: sensors have 1.5 % (64 of 4095) and more.
const DOUBTFUL_PART: f64 = 0.01;

/// Why a black level of 0 can hardly be that of a frame, if so: even its darkest pixels lie far above.
#[must_use]
pub fn black_level_doubt(data: &[u16], black_level: f64, white_level: u16) -> Option<String> {
    if black_level != 0.0 || data.is_empty() {
        return None;
    }
    let mut values = data.to_vec();
    let (_, darkest, _) = values.select_nth_unstable((DEFECT_SHARE * data.len() as f64) as usize);
    (f64::from(*darkest) > DOUBTFUL_PART * f64::from(white_level)).then(|| {
        format!(
            "The black level is 0, but even the darkest pixels have {darkest} DN. Unless all of the frame is lit, the camera has a black \
             level: all light would count as larger than it is"
        )
    })
}

/// Where the values of a description come from, while they are collected.
struct Facts<'a> {
    given: &'a FrameFacts,
    said: Vec<(&'static str, FactSource, String)>,
}

/// The color filter array in letters.
fn letters(image: &SensorImage) -> String {
    let mosaic = &image.mosaic;
    if mosaic.channels.len() == 1 {
        return "one channel".into();
    }
    if mosaic.pattern.is_empty() {
        return format!("{} in every pixel", mosaic.channels.join(", "));
    }
    let rows = mosaic.pattern.chunks(mosaic.cols.max(1));
    let name = |channel: &u8| mosaic.channels.get(usize::from(*channel)).map_or("?", String::as_str);
    rows.map(|row| row.iter().map(name).collect::<String>()).collect::<Vec<_>>().join(" / ")
}

impl Facts<'_> {
    fn say(&mut self, key: &'static str, source: FactSource, remark: &str) {
        self.said.push((key, source, remark.into()));
    }

    /// What was said of a key.
    fn of_key(&self, key: &str) -> (FactSource, String) {
        let said = self.said.iter().find(|(of, ..)| *of == key);
        said.map_or((FactSource::Tag, String::new()), |(_, source, remark)| (*source, remark.clone()))
    }

    /// A value that the user gives, else that of a tag, else an assumed one.
    fn number(&mut self, key: &'static str, [given, tag]: [Option<f64>; 2], assumed: (f64, &str)) -> f64 {
        let (value, source, remark) = match (given, tag) {
            (Some(value), _) => (value, FactSource::Given, ""),
            (None, Some(value)) => (value, FactSource::Tag, ""),
            _ => (assumed.0, FactSource::Assumed, assumed.1),
        };
        self.say(key, source, remark);
        value
    }

    /// The description of a DNG, whose tags tell most.
    fn of_dng(&mut self, mut description: Description, told: &Told) -> Description {
        let given = self.given;
        self.say_label(&mut description.label);
        self.say("width, height", FactSource::Tag, "the active area");
        if description.samples != Samples::Mosaic && given.is_measured {
            description.samples = Samples::Measured;
        }
        let source = self.mosaic_source(&mut description.mosaic, FactSource::Tag);
        self.say("mosaic", source, "");
        let known = |value: f64| (value > 0.0).then_some(value);
        let tags = [
            known(description.exposure_s),
            known(description.dn_per_electron),
            known(description.read_noise_dn),
        ];
        let told_by = |is_told: bool, value: f64| is_told.then_some(value);
        let black = told_by(told.black_level, description.black_level);
        description.black_level =
            self.number("black_level", [given.black_level, black], (0.0, OTHER_BLACK_LEVEL));
        let bits = given.bit_depth.unwrap_or(description.bit_depth);
        let remark = format!("the largest number of {bits} bits; --white-level gives another");
        let white = self.number(
            "white_level",
            [given.white_level.map(f64::from), told_by(told.white_level, f64::from(description.white_level))],
            (largest_of(bits), &remark),
        );
        description.white_level = white.clamp(1.0, 65_535.0) as u16;
        let source = if given.bit_depth.is_some() { FactSource::Given } else { FactSource::Tag };
        self.say("bit_depth", source, "");
        description.bit_depth = bits;
        let gain = told_by(told.gain, description.gain);
        description.gain = self.number("gain", [given.gain, gain], (1.0, "--gain gives another"));
        [description.exposure_s, description.dn_per_electron, description.read_noise_dn] =
            tags.map(|tag| tag.unwrap_or(0.0));
        description
    }

    /// The description of an image whose tags tell little.
    fn of_pixels(
        &mut self,
        path: &Path,
        pixels: &TiffPixels,
        tags: Option<&TiffBytes<'_>>,
        significant_bits: Option<u8>,
    ) -> Result<Description, FormatError> {
        let given = self.given;
        let directories = tags.map(TiffBytes::directories).unwrap_or_default();
        let first = directories.first();
        let of_camera = |tag: u16| camera_number(tags?, &[first?], tag);
        let in_first = |tag: u16| first.and_then(|d| d.numbers(tag).first().copied());
        let mut label = path.file_stem().map_or_else(|| "raw".into(), |s| s.to_string_lossy().into_owned());
        self.say_label(&mut label);
        let (mosaic, samples) = self.mosaic_of(path, pixels, first);
        let of_white = in_first(50_717).map(|white| bits_of(white.clamp(1.0, 65_535.0) as u16));
        // A PNG scales samples to all its bits; some hold them as they are
        let is_scaled = |bits: &u8| pixels.bits == 16 && unused_bits(&pixels.data) >= u32::from(16 - bits);
        let holds = |bits: u8| pixels.data.iter().all(|&value| bits_of(value) <= bits);
        let told = significant_bits.map(|bits| if holds(bits) { bits } else { pixels.bits });
        let scaled = significant_bits.filter(is_scaled);
        let (bits, left_shift) = self.bits_of_pixels(path, pixels, of_white.or(told), scaled)?;
        let blacks = first.map_or(Vec::new(), |d| d.numbers(50_714));
        if given.black_level.is_none() && blacks.iter().any(|black| *black != blacks[0]) {
            let what = format!("its black levels differ from place to place: {blacks:?}");
            let hint = "Give the frame as DNG, which is read with them, or their mean as --black-level";
            return Err(FormatError::unsupported(path, what, hint));
        }
        let black_level =
            self.number("black_level", [given.black_level, in_first(50_714)], (0.0, OTHER_BLACK_LEVEL));
        let remark = format!("the largest number of {bits} bits; --white-level gives another");
        let white = self.number(
            "white_level",
            [given.white_level.map(f64::from), in_first(50_717)],
            (largest_of(bits), &remark),
        );
        let gain = of_camera(ISO).and_then(gain_of_iso);
        let gain = self.number("gain", [given.gain, gain], (1.0, "--gain gives another"));
        Ok(Description {
            format: FileFormat::RAW_FRAME.version(),
            label,
            width: pixels.width as u64,
            height: pixels.height as u64,
            mosaic,
            samples,
            black_level,
            white_level: white.clamp(1.0, 65_535.0) as u16,
            bit_depth: bits,
            left_shift,
            exposure_s: of_camera(EXPOSURE_TIME).unwrap_or(0.0),
            gain,
            ..Description::default()
        })
    }

    /// Bits of the converter, and those below them that all values leave empty.
    fn bits_of_pixels(
        &mut self,
        path: &Path,
        pixels: &TiffPixels,
        of_white: Option<u8>,
        scaled: Option<u8>,
    ) -> Result<(u8, u8), FormatError> {
        let given = self.given;
        let most = pixels.data.iter().copied().max().unwrap_or(0);
        let is_wide = pixels.bits == 16;
        let unused = if is_wide { unused_bits(&pixels.data) as u8 } else { 0 };
        let found = if is_wide { left_aligned_bits(&pixels.data, 0) } else { None };
        let bits = match (given.bit_depth, given.is_left_aligned || scaled.is_some(), scaled.or(found)) {
            (Some(bits), false, _) if u32::from(most) >> bits.min(16) == 0 => None,
            (Some(bits), ..) => {
                if u32::from(unused) + u32::from(bits) < 16 {
                    let needed = bits_of(most);
                    let what = format!(
                        "its largest value, {most}, needs {needed} bits, and --bit-depth says {bits}; not all values are multiples of {} \
                         either, as left-aligned ones would be",
                        1u32 << (16 - bits)
                    );
                    return Err(FormatError::unsupported(
                        path,
                        what,
                        format!("Give --bit-depth {}", if unused > 0 { 16 - unused } else { needed }),
                    ));
                }
                Some((bits, FactSource::Given))
            }
            (None, true, _) if unused == 0 => {
                let what = "not all values are multiples of a power of 2, as left-aligned ones are";
                return Err(FormatError::unsupported(path, what, "Leave --left-aligned out"));
            }
            (None, true, found) => {
                let bits = found.unwrap_or(16 - unused.min(15));
                Some((bits, if scaled.is_some() { FactSource::Tag } else { FactSource::Assumed }))
            }
            (None, false, Some(bits)) => Some((bits, FactSource::Assumed)),
            (None, false, None) => None,
        };
        if let Some((bits, source)) = bits {
            let remark = format!(
                "{}, as all values are multiples of {}; --bit-depth gives others",
                alignment_words(bits, 16 - bits),
                1u32 << (16 - bits)
            );
            self.say("bit_depth", source, if source == FactSource::Assumed { &remark } else { "" });
            return Ok((bits, 16 - bits));
        }
        let guess = [8, 10, 12, 14, 16]
            .into_iter()
            .filter(|bits| *bits <= pixels.bits)
            .find(|bits| u32::from(most) >> bits == 0)
            .unwrap_or(pixels.bits);
        let mut remark = format!(
            "the least of 8, 10, 12, 14 and 16 bits that hold the largest value, {most}; --bit-depth gives others"
        );
        if unused > 0 {
            remark += &format!(
                "; all values are multiples of {}: where brighter frames of the camera are left-aligned in 16 bits, give --left-aligned",
                1u32 << unused
            );
        }
        let (bits, source, remark) = match (given.bit_depth, of_white) {
            (Some(bits), _) => (bits, FactSource::Given, ""),
            (None, Some(bits)) => (bits.min(pixels.bits), FactSource::Tag, ""),
            (None, None) => (guess, FactSource::Assumed, remark.as_str()),
        };
        self.say("bit_depth", source, remark);
        Ok((bits, 0))
    }

    /// Exposure and noise.
    fn of_levels(&mut self, description: &mut Description) {
        let given = self.given;
        let mut say = |key, given: Option<f64>, value: &mut f64, remark: &str| {
            let (source, remark) = match given {
                Some(given) => {
                    *value = given;
                    (FactSource::Given, "")
                }
                None if *value > 0.0 => (FactSource::Tag, ""),
                None => (FactSource::Unknown, remark),
            };
            self.said.push((key, source, remark.into()));
        };
        let exposure = "without it no frame is analyzed: give --exposure-ms";
        say("exposure_s", given.exposure_s, &mut description.exposure_s, exposure);
        let sensor = "the sensor of the experiment tells it";
        say("dn_per_electron", given.dn_per_electron, &mut description.dn_per_electron, sensor);
        say("read_noise_dn", given.read_noise_dn, &mut description.read_noise_dn, sensor);
    }

    fn say_label(&mut self, label: &mut String) {
        match &self.given.label {
            Some(given) => {
                label.clone_from(given);
                self.say("label", FactSource::Given, "");
            }
            None => {
                let remark = "the name of the file; --capture names the capture of the experiment";
                self.say("label", FactSource::Assumed, remark);
            }
        }
    }

    fn mosaic_source(&self, mosaic: &mut Mosaic, otherwise: FactSource) -> FactSource {
        match &self.given.mosaic {
            Some(given) => {
                mosaic.clone_from(given);
                FactSource::Given
            }
            None => otherwise,
        }
    }

    /// The color filter array of an image, and what its numbers are.
    fn mosaic_of(
        &mut self,
        path: &Path,
        pixels: &TiffPixels,
        first: Option<&Directory<'_>>,
    ) -> (Mosaic, Samples) {
        let tag = first.filter(|_| pixels.samples == 1).and_then(|d| super::dng::mosaic_of(path, d).ok());
        let bayer = Mosaic::bayer("rggb").unwrap_or_default();
        let (mut mosaic, samples, otherwise, remark) = match (pixels.samples, tag) {
            (1, Some(mosaic)) => (mosaic, Samples::Mosaic, FactSource::Tag, ""),
            (1, None) => {
                let remark = "one number a pixel and no tag of colors; --mosaic rggb, bggr, grbg or gbrg gives a mosaic";
                (Mosaic::monochrome(), Samples::Mosaic, FactSource::Assumed, remark)
            }
            _ if self.given.is_measured => (bayer, Samples::Measured, FactSource::Given, ""),
            _ => {
                let remark = "linear numbers that were interpolated from a Bayer array; --measured where every pixel measured all \
                              three, and a photograph with a tone curve is no measurement at all";
                (bayer, Samples::Developed, FactSource::Assumed, remark)
            }
        };
        let source = self.mosaic_source(&mut mosaic, otherwise);
        let remark = if source == FactSource::Given { "" } else { remark };
        self.say("mosaic", source, remark);
        (mosaic, samples)
    }

    /// A mosaic that was taken for one channel shows in the means of the pixels of a 2 x 2 cell.
    fn doubtful_mosaic(&self, image: &SensorImage) -> Option<FrameFact> {
        if image.mosaic.channels.len() != 1 || self.given.mosaic.is_some() {
            return None;
        }
        let width = image.width.max(1);
        let (mut sums, mut counts) = ([0.0; 4], [0.0f64; 4]);
        for (pixel, &value) in image.data.iter().enumerate() {
            let place = pixel / width % 2 * 2 + pixel % width % 2;
            sums[place] += f64::from(value) - image.black_level;
            counts[place] += 1.0;
        }
        let means: Vec<f64> = sums.iter().zip(counts).map(|(sum, count)| sum / count.max(1.0)).collect();
        let (low, high) = means.iter().fold((f64::INFINITY, 0.0f64), |(l, h), &m| (l.min(m), h.max(m)));
        (high > 1.05 * low.max(0.0) && high > 1.0).then(|| {
            let means: Vec<String> = means.iter().map(|mean| format!("{mean:.0}")).collect();
            FrameFact {
                key: "mosaic",
                value: "one channel".into(),
                source: FactSource::Assumed,
                is_doubtful: false,
                remark: format!(
                    "the pixels of its 2 x 2 cells have the means {} DN: it looks like a mosaic; give --mosaic",
                    means.join(", ")
                ),
            }
        })
    }
}
