//! Frames of two runs as pictures of one scale.

use fluorspar::image::ChannelImage;
use fluorspar::pipeline::{
    ColorRendering, DisplayImage, Preview, for_display, preview_white, preview_with_white,
};

use crate::Raster;
use crate::findings::number as short;

/// Steps of a picture's values: noise of the last bits would be most of the page.
const STEP: u8 = 3;

/// A frame that is compared.
#[derive(Clone, Copy, Debug)]
pub struct FrameToCompare<'a> {
    /// The developed frame.
    pub developed: &'a ChannelImage,
    /// Digital numbers per electron.
    pub dn_per_electron: f64,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Its own rendering.
    pub rendering: ColorRendering,
}

/// Pictures of two frames that show as many electrons as bright.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ComparedPictures {
    /// The pictures, PNG.
    pub png: [Vec<u8>; 2],
    /// How they were made, in words.
    pub caption: String,
}

/// Pictures of two frames at one scale: as many electrons are as bright in both, and the brighter frame just fits.
/// Where both have the same channels both have the colors of the first one's rendering, else each its own channels. `None` of a frame
/// without pixels.
#[must_use]
pub fn compared_pictures(a: &FrameToCompare<'_>, b: &FrameToCompare<'_>) -> Option<ComparedPictures> {
    let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let rendering = match a.developed.channels == b.developed.channels {
        true => a.rendering,
        false => ColorRendering { matrix: identity, ..a.rendering },
    };
    let shown =
        [a, b].map(|frame| (for_display(frame.developed, frame.dn_per_electron), frame.dn_per_electron));
    let white_e = |(shown, dn_per_electron): &(DisplayImage, f64)| {
        preview_white(&shown.image, &rendering) / dn_per_electron.max(f64::MIN_POSITIVE)
    };
    let whites = [white_e(&shown[0]), white_e(&shown[1])];
    let white = whites[0].max(whites[1]);
    let picture = |(shown, dn_per_electron): &(DisplayImage, f64)| {
        png(preview_with_white(&shown.image, &rendering, white * dn_per_electron))
    };
    let (brighter, darker) = if whites[0] >= whites[1] { ("A", "B") } else { ("B", "A") };
    let caption = format!(
        "Both pictures have one scale: as many electrons are as bright in both, and the brightest half percent of {brighter} is white. The \
         frame of A was exposed {} ms, that of B {} ms. Alone the picture of {darker} would be {} times as bright.",
        short(1e3 * a.exposure_s),
        short(1e3 * b.exposure_s),
        short(white / whites[0].min(whites[1]))
    );
    Some(ComparedPictures { png: [picture(&shown[0])?, picture(&shown[1])?], caption })
}

fn png(mut picture: Preview) -> Option<Vec<u8>> {
    picture.rgb.iter_mut().for_each(|value| *value = (*value / STEP * STEP).saturating_add(STEP / 2));
    Raster::from_rgb8(picture.width, picture.height, &picture.rgb)?.to_png()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame whose pixels rise from dark to so many electrons.
    fn ramp(top_e: f32, dn_per_electron: f64) -> ChannelImage {
        let (width, height) = (64, 48);
        let level =
            |pixel: usize| (pixel % width) as f32 / (width - 1) as f32 * top_e * dn_per_electron as f32;
        ChannelImage {
            width,
            height,
            channels: ["R", "G", "B"].map(String::from).to_vec(),
            data: (0..width * height).flat_map(|pixel| [level(pixel); 3]).collect(),
            saturated: vec![false; width * height],
            label: "blue".into(),
            noise_floor_dn: 0.01,
            full_scale_dn: 1e6,
            shares: vec![0.25, 0.5, 0.25],
            subtracted: None,
            calibration: None,
            interpolation: None,
        }
    }

    #[test]
    fn as_many_electrons_are_as_bright_whatever_the_gain() {
        let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let rendering = ColorRendering { matrix: identity, lift: 2.5 };
        // Levels that shot noise does not make visible
        let (a, b, half) = (ramp(1e6, 0.5), ramp(1e6, 0.1), ramp(5e5, 0.5));
        let of = |developed, dn_per_electron| FrameToCompare {
            developed,
            dn_per_electron,
            exposure_s: 0.03,
            rendering,
        };
        let same = compared_pictures(&of(&a, 0.5), &of(&b, 0.1)).unwrap();
        assert!(same.png[0] == same.png[1] && same.caption.contains("would be 1"), "{}", same.caption);
        let darker = compared_pictures(&of(&a, 0.5), &of(&half, 0.5)).unwrap();
        assert!(darker.png[0] == same.png[0] && darker.png[1] != darker.png[0]);
        assert!(darker.caption.contains("the picture of B would be 2"), "{}", darker.caption);
        assert!(darker.caption.contains("exposed 30 ms, that of B 30 ms"), "{}", darker.caption);
    }
}
