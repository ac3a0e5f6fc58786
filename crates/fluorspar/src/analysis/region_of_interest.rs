//! Which pixels an analysis looks at.

use std::fmt;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{PixelMask, Polygon};
use crate::image::ComponentImage;
use crate::names::{nearest_name, suggestion};
use crate::optics::CameraLens;

/// A rectangle in sensor pixels, counted from 0 at the top left corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rectangle {
    /// First column.
    pub col: usize,
    /// First row.
    pub row: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl fmt::Display for Rectangle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} x {} pixels from column {}, row {}", self.width, self.height, self.col, self.row)
    }
}

/// A region of the sensor image: named parts of the scene, a rectangle, a polygon, a mask, or where all that are given hold. Empty means
/// the whole image.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegionOfInterest {
    /// Names of parts of the scene; a pixel belongs to the region when it shows any of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<String>,
    /// Only pixels in this rectangle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rectangle: Option<Rectangle>,
    /// Only pixels in this polygon.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub polygon: Option<Polygon>,
    /// Only pixels of this mask.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<PixelMask>,
    /// Pixels of the sensor by which the region keeps away from the rim of its parts: pixels there hold light of what lies beside.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub inset_px: usize,
}

fn is_zero(value: &usize) -> bool {
    *value == 0
}

/// Pixels of a sensor image, as numbers `row * width + col` in increasing order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PixelSelection {
    /// Columns of the image.
    pub width: usize,
    /// Rows of the image.
    pub height: usize,
    /// The selected pixels.
    pub pixels: Vec<usize>,
}

/// Why a region selects nothing.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum RegionError {
    /// A part that the scene does not have.
    #[error("the rendered scene has no part \"{name}\"{} Name one of its parts, or use the experiment of this image. Its parts: {}", suggestion(.nearest.as_deref()), .available.join(", "))]
    UnknownPart {
        /// The requested name.
        name: String,
        /// The name that may have been meant.
        nearest: Option<String>,
        /// All names.
        available: Vec<String>,
    },
    /// A rectangle without pixels, or one that leaves the image.
    #[error(
        "the region's rectangle ({rectangle}) does not fit the image of {width} columns and {height} rows; \
         give col, row, width and height in sensor pixels, counted from 0 at the top left"
    )]
    OutsideImage {
        /// The rectangle.
        rectangle: Rectangle,
        /// Columns of the image.
        width: usize,
        /// Rows of the image.
        height: usize,
    },
    /// A polygon of too few corners.
    #[error("a polygon of {0} corners encloses nothing; give three corners [x, y] or more")]
    FewCorners(usize),
    /// A corner of a polygon that lies outside of the image.
    #[error(
        "the corner {corner:?} of the polygon lies outside of the image of {width} columns and {height} rows; give [x, y] in pixels \
         of the raw image from its upper left corner"
    )]
    CornerOutside {
        /// The corner.
        corner: [f64; 2],
        /// Columns of the image.
        width: usize,
        /// Rows of the image.
        height: usize,
    },
    /// A mask of another size than the image.
    #[error(
        "the mask {name} has {} x {} pixels and the raw image {} x {}; draw it on an image of that size, for instance a preview", .mask[0], .mask[1],
        .image[0], .image[1]
    )]
    MaskSize {
        /// The mask.
        name: String,
        /// Columns and rows of the mask.
        mask: [usize; 2],
        /// Columns and rows of the image.
        image: [usize; 2],
    },
    /// Shapes without a common pixel.
    #[error("no pixel lies in {0}; enlarge the region, or leave one of its conditions out")]
    NothingInShapes(String),
    /// Parts were named but the image comes without a map of parts.
    #[error(
        "the region names the part \"{0}\", but this image has no map of parts (it was not rendered here, or its features \
         were not kept); give a rectangle, a polygon or a mask instead"
    )]
    NoPartMap(String),
    /// The parts exist, but no pixel of the region shows them.
    #[error("no pixel of the region shows {}; {}", .parts.join(" or "), in_view(.visible))]
    NothingInView {
        /// The requested parts.
        parts: Vec<String>,
        /// Parts that some pixel of the image shows.
        visible: Vec<String>,
    },
    /// Pixels of the region show the parts, but all of them lie near their rim.
    #[error("no pixel of {} lies {inset_px} pixels of the sensor within its rim: choose a smaller inset", .parts.join(" or "))]
    NothingInside {
        /// The requested parts.
        parts: Vec<String>,
        /// Distance from the rim.
        inset_px: usize,
    },
}

impl RegionError {
    /// Whether the parts are there and no pixel shows them, or none far enough within their rim.
    #[must_use]
    pub fn is_out_of_view(&self) -> bool {
        matches!(self, Self::NothingInView { .. } | Self::NothingInside { .. })
    }
}

fn in_view(visible: &[String]) -> String {
    if visible.is_empty() {
        "no part is in view".into()
    } else {
        format!("the parts in view are: {}", visible.join(", "))
    }
}

/// Names of parts in a list, a first word that all of them have once, and both sides as one: "tongue dorsum, tip and lateral".
fn parts_in_words(parts: &[String]) -> String {
    let both = |part: &str, [own, other]: [&str; 2]| {
        let middle = part.strip_suffix(own)?;
        parts.contains(&format!("{middle}{other}")).then(|| middle.to_owned())
    };
    let sides = ["_right", "_left"];
    let is_second = |part: &&String| both(part, [sides[1], sides[0]]).is_some();
    let name = |part: &String| both(part, sides).unwrap_or_else(|| part.clone()).replace('_', " ");
    let names: Vec<String> = parts.iter().filter(|part| !is_second(part)).map(name).collect();
    let Some((first, others)) = names.split_first() else { return String::new() };
    let word = first.find(' ').map_or("", |end| &first[..=end]);
    let has_word = others.iter().all(|name| name.starts_with(word));
    let short = |name: &String| if has_word { name[word.len()..].to_owned() } else { name.clone() };
    let mut list: Vec<String> = std::iter::once(first.clone()).chain(others.iter().map(short)).collect();
    match (list.pop(), list.is_empty()) {
        (Some(last), false) => format!("{} and {last}", list.join(", ")),
        (last, _) => last.unwrap_or_default(),
    }
}

impl RegionOfInterest {
    /// All pixels that show any of these parts.
    pub fn of_parts<S: Into<String>>(parts: impl IntoIterator<Item = S>) -> Self {
        Self { parts: parts.into_iter().map(Into::into).collect(), ..Self::default() }
    }

    /// All pixels of a rectangle.
    pub fn of_rectangle(rectangle: Rectangle) -> Self {
        Self { rectangle: Some(rectangle), ..Self::default() }
    }

    /// Only the pixels of this region that lie in a rectangle.
    #[must_use]
    pub fn within(mut self, rectangle: Rectangle) -> Self {
        self.rectangle = Some(rectangle);
        self
    }

    /// Only the pixels of this region that lie in a polygon.
    #[must_use]
    pub fn within_polygon(mut self, polygon: Polygon) -> Self {
        self.polygon = Some(polygon);
        self
    }

    /// Only the pixels of this region that a mask marks.
    #[must_use]
    pub fn within_mask(mut self, mask: PixelMask) -> Self {
        self.mask = Some(mask);
        self
    }

    /// Only pixels that lie this far within the rim of the parts.
    #[must_use]
    pub fn inset(mut self, inset_px: usize) -> Self {
        self.inset_px = inset_px;
        self
    }

    /// One line for tables and captions.
    pub fn describe(&self) -> String {
        let inset = match self.inset_px {
            0 => String::new(),
            inset => format!(" ({inset} pixels within the rim)"),
        };
        let parts = parts_in_words(&self.parts) + &inset;
        match (self.parts.is_empty(), self.shapes()) {
            (true, None) => "the whole image".into(),
            (true, Some(shapes)) => shapes,
            (false, None) => parts,
            (false, Some(shapes)) => format!("{parts} within {shapes}"),
        }
    }

    /// Rectangle, polygon and mask in words.
    fn shapes(&self) -> Option<String> {
        let shapes = [
            self.rectangle.map(|rectangle| rectangle.to_string()),
            self.polygon.as_ref().map(ToString::to_string),
            self.mask.as_ref().map(ToString::to_string),
        ];
        let shapes: Vec<String> = shapes.into_iter().flatten().collect();
        (!shapes.is_empty()).then(|| shapes.join(" and "))
    }

    /// The pixels of the region in a sensor image of `width` columns and `height` rows.
    ///
    /// Parts are looked up in the part map of the rendered scene: a sensor pixel takes the part at its own center.
    ///
    /// # Errors
    /// An unknown part, a rectangle or polygon that leaves the image, a mask of another size, or a region that no pixel belongs to.
    pub fn select(
        &self,
        width: usize,
        height: usize,
        scene: Option<SceneOnSensor<'_>>,
    ) -> Result<PixelSelection, RegionError> {
        // Check the shapes
        let area = self.rectangle.unwrap_or(Rectangle { col: 0, row: 0, width, height });
        let fits = |start: usize, len: usize, end: usize| {
            len > 0 && start.checked_add(len).is_some_and(|stop| stop <= end)
        };
        if !fits(area.col, area.width, width) || !fits(area.row, area.height, height) {
            return Err(RegionError::OutsideImage { rectangle: area, width, height });
        }
        let drawn = self.drawn(width, height)?;
        let is_drawn = |row: usize, col: usize| drawn.as_ref().is_none_or(|drawn| drawn[row * width + col]);
        // Collect the pixels that show the parts
        let wanted = self.part_numbers(scene.map(|s| s.components))?;
        // By the number that the map of parts gives a pixel, of which 0 is no part
        let mut is_wanted = vec![false; 1 << u16::BITS];
        for part in wanted.iter().flatten() {
            if let Some(is_wanted) = is_wanted.get_mut(part + 1) {
                *is_wanted = true;
            }
        }
        let shown: Option<Vec<bool>> = wanted.as_ref().and(scene).map(|scene| {
            let parts = &scene.components.features.part;
            let shows = |pixel: usize| scene.scene_pixel(pixel / width, pixel % width, width, height);
            let is_part = |pixel| shows(pixel).is_some_and(|behind| is_wanted[usize::from(parts[behind])]);
            (0..width * height).map(is_part).collect()
        });
        let shows = |row: usize, col: usize| shown.as_ref().is_none_or(|shown| shown[row * width + col]);
        let pixels = |inset: usize| -> Vec<usize> {
            let inside = |row: usize, col: usize| {
                let rows = row.saturating_sub(inset)..=(row + inset).min(height - 1);
                let mut cols = col.saturating_sub(inset)..=(col + inset).min(width - 1);
                let is_shown = is_drawn(row, col) && shows(row, col);
                is_shown && (inset == 0 || cols.all(|col| rows.clone().all(|row| shows(row, col))))
            };
            let mut pixels = Vec::new();
            for row in area.row..area.row + area.height {
                let cols = (area.col..area.col + area.width).filter(|&col| inside(row, col));
                pixels.extend(cols.map(|col| row * width + col));
            }
            pixels
        };
        let inset_px = if wanted.is_some() { self.inset_px } else { 0 };
        let pixels_inside = pixels(inset_px);
        if pixels_inside.is_empty() && inset_px > 0 && !pixels(0).is_empty() {
            return Err(RegionError::NothingInside { parts: self.parts.clone(), inset_px });
        }
        let pixels = pixels_inside;
        match (self.shapes(), scene) {
            (Some(shapes), _) if pixels.is_empty() && wanted.is_none() => {
                Err(RegionError::NothingInShapes(shapes))
            }
            (_, Some(scene)) if pixels.is_empty() => Err(RegionError::NothingInView {
                parts: self.parts.clone(),
                visible: visible_parts(scene.components),
            }),
            _ => Ok(PixelSelection { width, height, pixels }),
        }
    }

    /// Pixels in the polygon and in the mask; `None` without either.
    fn drawn(&self, width: usize, height: usize) -> Result<Option<Vec<bool>>, RegionError> {
        let mut drawn: Option<Vec<bool>> = None;
        if let Some(polygon) = &self.polygon {
            polygon.check(width, height)?;
            drawn = Some(polygon.fill(width, height));
        }
        if let Some(mask) = &self.mask {
            mask.check(width, height)?;
            let both = |mut drawn: Vec<bool>| {
                drawn.iter_mut().zip(mask.inside.iter()).for_each(|(drawn, inside)| *drawn &= inside);
                drawn
            };
            drawn = Some(drawn.map_or_else(|| mask.inside.to_vec(), both));
        }
        Ok(drawn)
    }

    /// Numbers of the wanted parts; `None` when every part will do.
    fn part_numbers(&self, scene: Option<&ComponentImage>) -> Result<Option<Vec<usize>>, RegionError> {
        let Some(first) = self.parts.first() else { return Ok(None) };
        let scene = scene
            .filter(|scene| scene.features.part.len() == scene.width * scene.height)
            .ok_or_else(|| RegionError::NoPartMap(first.clone()))?;
        let names = &scene.features.part_names;
        let find = |name: &String| {
            let wanted: Vec<usize> = (0..names.len()).filter(|&part| names[part] == *name).collect();
            if wanted.is_empty() {
                return Err(RegionError::UnknownPart {
                    name: name.clone(),
                    nearest: nearest_name(name, names.iter().map(String::as_str)).map(String::from),
                    available: names.clone(),
                });
            }
            Ok(wanted)
        };
        let found = self.parts.iter().map(find).collect::<Result<Vec<_>, _>>()?;
        Ok(Some(found.concat()))
    }
}

/// A rendered image and how large it lies on the sensor.
#[derive(Clone, Copy, Debug)]
pub struct SceneOnSensor<'a> {
    /// The rendered image with its part map.
    pub components: &'a ComponentImage,
    /// Width and height of the rendered image on the film over those of the sensor. Both are centered on the axis.
    pub film_over_sensor: [f64; 2],
    /// The lens that images what a pinhole rendered, and the tangent of half the width of the pinhole's image; none where the render
    /// went through its lens.
    pub lens: Option<(&'a CameraLens, f64)>,
}

impl<'a> SceneOnSensor<'a> {
    /// An image that fills the sensor.
    pub fn filling(components: &'a ComponentImage) -> Self {
        Self { components, film_over_sensor: [1.0; 2], lens: None }
    }

    /// Pixel of the rendered image behind the center of a pixel of a sensor of `width` columns and `height` rows; none
    /// beyond its border.
    pub fn scene_pixel(&self, row: usize, col: usize, width: usize, height: usize) -> Option<usize> {
        let scene = self.components;
        let [film_width, film_height] = self.film_over_sensor;
        // From the middle of the film to the right and down, in its widths and heights
        let x = ((col as f64 + 0.5) / width as f64 - 0.5) / film_width;
        let y = ((row as f64 + 0.5) / height as f64 - 0.5) / film_height;
        let [x, y] = self.lens.map_or([x, y], |(lens, tan_half_width)| {
            let seen = lens.chief_tangents(x * lens.film_width_mm(), -y * lens.film_height_mm());
            let [right, up] = seen.map(|tangent| 0.5 * tangent / tan_half_width);
            [right, -up * scene.width as f64 / scene.height as f64]
        });
        let place = |at: f64, count: usize| {
            let place = ((at + 0.5) * count as f64).floor();
            (place >= 0.0 && place < count as f64).then_some(place as usize)
        };
        Some(place(y, scene.height)? * scene.width + place(x, scene.width)?)
    }

    /// Pixels of the rendered image behind a region of the sensor, each once, in order.
    pub fn scene_pixels(&self, region: &PixelSelection) -> Vec<usize> {
        let behind = |&pixel: &usize| {
            self.scene_pixel(pixel / region.width, pixel % region.width, region.width, region.height)
        };
        let mut pixels: Vec<usize> = region.pixels.iter().filter_map(behind).collect();
        pixels.sort_unstable();
        pixels.dedup();
        pixels
    }
}

fn visible_parts(scene: &ComponentImage) -> Vec<String> {
    let names = &scene.features.part_names;
    (0..names.len())
        .filter(|part| scene.features.part.iter().any(|&seen| usize::from(seen) == part + 1))
        .map(|part| names[part].clone())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::FeatureMaps;
    use crate::spectral::WavelengthGrid;

    /// 4 columns by 2 rows: nothing, tongue, tongue, teeth above; tongue everywhere below. "palate" is out of view.
    fn scene() -> ComponentImage {
        let grid = WavelengthGrid::uniform(400.0, 410.0, 10.0).unwrap();
        let mut scene = ComponentImage::zeros(grid, 4, 2, Vec::new());
        scene.features = FeatureMaps {
            part: vec![0, 1, 1, 2, 1, 1, 1, 1],
            part_names: ["tongue", "upper_teeth", "palate"].map(String::from).to_vec(),
            ..FeatureMaps::default()
        };
        scene
    }

    #[test]
    fn parts_rectangles_and_their_intersection() {
        let scene = scene();
        let select = |region: RegionOfInterest| {
            region.select(4, 2, Some(SceneOnSensor::filling(&scene))).unwrap().pixels
        };
        assert_eq!(select(RegionOfInterest::default()), [0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(select(RegionOfInterest::of_parts(["tongue"])), [1, 2, 4, 5, 6, 7]);
        assert_eq!(select(RegionOfInterest::of_parts(["tongue", "upper_teeth"])), [1, 2, 3, 4, 5, 6, 7]);
        let right = Rectangle { col: 2, row: 0, width: 2, height: 2 };
        assert_eq!(select(RegionOfInterest::of_rectangle(right)), [2, 3, 6, 7]);
        assert_eq!(select(RegionOfInterest::of_parts(["tongue"]).within(right)), [2, 6, 7]);
    }

    #[test]
    fn a_polygon_and_a_mask_select_by_pixels() {
        let scene = scene();
        let select = |region: RegionOfInterest| region.select(4, 2, Some(SceneOnSensor::filling(&scene)));
        // Columns 1 to 3 of the upper row, columns 0 to 1 of the lower.
        let mask = PixelMask {
            name: "spot.png".into(),
            width: 4,
            height: 2,
            inside: [false, true, true, true, true, true, false, false].into(),
        };
        let masked = || RegionOfInterest::default().within_mask(mask.clone());
        assert_eq!(select(masked()).unwrap().pixels, [1, 2, 3, 4, 5]);
        let left = || Polygon(vec![[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]);
        assert_eq!(select(masked().within_polygon(left())).unwrap().pixels, [1, 4, 5]);
        assert_eq!(
            select(RegionOfInterest::of_parts(["upper_teeth"]).within_mask(mask.clone())).unwrap().pixels,
            [3]
        );
        let right = Rectangle { col: 2, row: 1, width: 2, height: 1 };
        let said = select(masked().within(right)).unwrap_err().to_string();
        assert_eq!(
            said,
            "no pixel lies in 2 x 1 pixels from column 2, row 1 and the mask spot.png; enlarge the region, or leave one of its \
             conditions out"
        );
        assert_eq!(
            masked().within_polygon(left()).describe(),
            "a polygon of 4 corners in columns 0 to 2, rows 0 to 2 and the mask spot.png"
        );
        // Results name a mask and do not repeat it.
        let text = serde_json::to_string(&masked()).unwrap();
        assert_eq!(text, r#"{"mask":{"name":"spot.png","width":4,"height":2}}"#);
    }

    /// Nothing lies around the tongue but in the upper left corner and the teeth; the frame of the image is no rim.
    #[test]
    fn an_inset_keeps_away_from_other_parts() {
        let scene = scene();
        let select = |region: RegionOfInterest| region.select(16, 8, Some(SceneOnSensor::filling(&scene)));
        let tongue = || RegionOfInterest::of_parts(["tongue"]);
        let inside = select(tongue().inset(2)).unwrap().pixels;
        // Rows 0 to 3: nothing in columns 0 to 3, tongue to 11, teeth from 12; rows 4 to 7: tongue everywhere
        let expected = (0..8)
            .flat_map(|row| (0..16).map(move |col| (row, col)))
            .filter(|&(row, col)| if row < 6 { (6..10).contains(&col) } else { true });
        assert_eq!(inside, expected.map(|(row, col)| row * 16 + col).collect::<Vec<_>>());
        assert_eq!(select(tongue().inset(0)).unwrap(), select(tongue()).unwrap());
        let error = select(RegionOfInterest::of_parts(["upper_teeth"]).inset(5)).unwrap_err();
        assert_eq!(
            error.to_string(),
            "no pixel of upper_teeth lies 5 pixels of the sensor within its rim: choose a smaller inset"
        );
        assert_eq!(tongue().inset(2).describe(), "tongue (2 pixels within the rim)");
        let sides = ["tongue_lateral_right", "tongue_tip", "tongue_lateral_left"];
        assert_eq!(RegionOfInterest::of_parts(sides).describe(), "tongue lateral and tip");
        let parts = ["tongue_dorsum", "tongue_tip", "tongue_lateral_left"];
        assert_eq!(RegionOfInterest::of_parts(parts).describe(), "tongue dorsum, tip and lateral left");
        assert_eq!(
            RegionOfInterest::of_parts(["upper_lip", "lower_lip"]).describe(),
            "upper lip and lower lip"
        );
    }

    #[test]
    fn a_sensor_of_another_resolution_takes_the_part_at_its_pixel_centers() {
        let scene = scene();
        let teeth = RegionOfInterest::of_parts(["upper_teeth"]);
        // Twice as fine: the one render pixel in column 3, row 0 covers four sensor pixels.
        assert_eq!(teeth.select(8, 4, Some(SceneOnSensor::filling(&scene))).unwrap().pixels, [6, 7, 14, 15]);
        // Half as fine: centers fall on render columns 1 and 3, render row 1.
        let tongue = RegionOfInterest::of_parts(["tongue"]);
        assert_eq!(tongue.select(2, 1, Some(SceneOnSensor::filling(&scene))).unwrap().pixels, [0, 1]);
    }

    #[test]
    fn a_film_larger_or_smaller_than_the_sensor_moves_the_parts() {
        let scene = scene();
        let tongue = RegionOfInterest::of_parts(["tongue"]);
        // Twice the film: the sensor sees the middle two columns, and the middle of both rows.
        let larger = SceneOnSensor { components: &scene, film_over_sensor: [2.0; 2], lens: None };
        assert_eq!(tongue.select(2, 2, Some(larger)).unwrap().pixels, [0, 1, 2, 3]);
        let teeth = RegionOfInterest::of_parts(["upper_teeth"]);
        assert!(teeth.select(2, 2, Some(larger)).is_err());
        // Half of the film: it lies in the middle of the sensor, and around it nothing is seen.
        let smaller = SceneOnSensor { components: &scene, film_over_sensor: [0.5; 2], lens: None };
        let selection = teeth.select(8, 4, Some(smaller)).unwrap();
        assert_eq!(selection.pixels, [8 + 5]);
        assert_eq!(smaller.scene_pixels(&selection), [3]);
    }

    #[test]
    fn a_misspelled_part_is_answered_with_the_nearest_name_and_all_names() {
        let error = RegionOfInterest::of_parts(["Tounge"])
            .select(4, 2, Some(SceneOnSensor::filling(&scene())))
            .unwrap_err();
        assert_eq!(
            error.to_string(),
            "the rendered scene has no part \"Tounge\"; did you mean \"tongue\"? Name one of its parts, or use the experiment of this image. Its parts: tongue, upper_teeth, palate"
        );
        let error = RegionOfInterest::of_parts(["xyz"])
            .select(4, 2, Some(SceneOnSensor::filling(&scene())))
            .unwrap_err();
        assert_eq!(
            error.to_string(),
            "the rendered scene has no part \"xyz\". Name one of its parts, or use the experiment of this image. Its parts: tongue, upper_teeth, palate"
        );
    }

    #[test]
    fn regions_without_pixels_say_why() {
        let scene = scene();
        let error = |region: RegionOfInterest, scene| region.select(4, 2, scene).unwrap_err().to_string();
        assert_eq!(
            error(
                RegionOfInterest::of_rectangle(Rectangle { col: 3, row: 0, width: 2, height: 1 }),
                Some(SceneOnSensor::filling(&scene))
            ),
            "the region's rectangle (2 x 1 pixels from column 3, row 0) does not fit the image of 4 columns and 2 rows; \
             give col, row, width and height in sensor pixels, counted from 0 at the top left"
        );
        assert_eq!(
            error(RegionOfInterest::of_parts(["palate"]), Some(SceneOnSensor::filling(&scene))),
            "no pixel of the region shows palate; the parts in view are: tongue, upper_teeth"
        );
        assert_eq!(
            error(RegionOfInterest::of_parts(["tongue"]), None),
            "the region names the part \"tongue\", but this image has no map of parts (it was not rendered here, \
             or its features were not kept); give a rectangle, a polygon or a mask instead"
        );
        let empty = Rectangle { col: 0, row: 0, width: 0, height: 1 };
        assert!(RegionOfInterest::of_rectangle(empty).select(4, 2, None).is_err());
        let huge = Rectangle { col: usize::MAX, row: 0, width: 2, height: 1 };
        assert!(matches!(
            RegionOfInterest::of_rectangle(huge).select(4, 2, None),
            Err(RegionError::OutsideImage { .. })
        ));
    }

    #[test]
    fn a_region_describes_itself() {
        let corner = Rectangle { col: 1, row: 2, width: 10, height: 20 };
        assert_eq!(RegionOfInterest::default().describe(), "the whole image");
        assert_eq!(
            RegionOfInterest::of_parts(["tongue"]).within(corner).describe(),
            "tongue within 10 x 20 pixels from column 1, row 2"
        );
    }
}
