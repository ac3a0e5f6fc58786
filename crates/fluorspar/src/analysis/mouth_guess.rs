//! First guesses of tongue, lips and teeth in a frame, from color and place, and regions that look like two tissues.

use std::ops::Range;

use super::statistics::median;
use super::{PixelSelection, auc_of_scores};
use crate::image::ChannelImage;

/// Columns of blocks that a frame is looked at in.
const COLUMNS: usize = 160;
/// Guesses that stand out less are none.
const LEAST_SURENESS: f64 = 0.6;
/// Bins of a histogram that is split in two.
const BINS: usize = 64;

/// A region that was guessed.
#[derive(Clone, Debug, PartialEq)]
pub struct GuessedRegion {
    /// `teeth`, `tongue` or `lips`.
    pub name: &'static str,
    /// Its pixels.
    pub selection: PixelSelection,
    /// The chance that a pixel of it is told from one around it by brightness or color: 0.5 is not at all, 1 always.
    pub sureness: f64,
}

/// Means of blocks of a frame with channels R, G and B: logarithm of their sum in digital numbers, and r and g.
struct Blocks {
    width: usize,
    height: usize,
    side: usize,
    light: Vec<f64>,
    r: Vec<f64>,
    g: Vec<f64>,
}

impl Blocks {
    fn of(image: &ChannelImage) -> Option<Self> {
        let [r, g, b] = ["R", "G", "B"].map(|name| image.channels.iter().position(|channel| channel == name));
        let planes = [r?, g?, b?];
        let side = (image.width / COLUMNS).max(1);
        let (width, height) = (image.width / side, image.height / side);
        let count = image.channels.len();
        let (mut light, mut of_r, mut of_g) = (Vec::new(), Vec::new(), Vec::new());
        for (row, col) in (0..height).flat_map(|row| (0..width).map(move |col| (row, col))) {
            let mut sums = [0.0; 3];
            for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y, x))) {
                let pixel = (row * side + y) * image.width + col * side + x;
                for (sum, plane) in sums.iter_mut().zip(planes) {
                    *sum += f64::from(image.data[pixel * count + plane]);
                }
            }
            let floor = image.noise_floor_dn.max(1e-3);
            let means = sums.map(|sum| (sum / (side * side) as f64).max(0.01 * floor));
            let all: f64 = means.iter().sum();
            light.push(all.max(floor).ln());
            of_r.push(means[0] / all);
            of_g.push(means[1] / all);
        }
        Some(Self { width, height, side, light, r: of_r, g: of_g })
    }

    fn at(&self, block: usize) -> [f64; 2] {
        [(block % self.width) as f64 / self.width as f64, (block / self.width) as f64 / self.height as f64]
    }

    fn neighbors(&self, block: usize) -> impl Iterator<Item = usize> {
        let (x, y, width, height) = (block % self.width, block / self.width, self.width, self.height);
        let sides =
            [(x > 0, -1), (x + 1 < width, 1), (y > 0, -(width as isize)), (y + 1 < height, width as isize)];
        sides
            .into_iter()
            .filter(|(is_there, _)| *is_there)
            .map(move |(_, step)| block.wrapping_add_signed(step))
    }

    /// Blocks of a set whose neighbors are all of it.
    fn eroded(&self, set: &[bool]) -> Vec<bool> {
        (0..set.len()).map(|block| set[block] && self.neighbors(block).all(|other| set[other])).collect()
    }

    /// A set with its neighbors.
    fn dilated(&self, set: &[bool]) -> Vec<bool> {
        (0..set.len()).map(|block| set[block] || self.neighbors(block).any(|other| set[other])).collect()
    }

    /// A set without its holes.
    fn filled(&self, mut set: Vec<bool>) -> Vec<bool> {
        let outside: Vec<bool> = set.iter().map(|is_in| !is_in).collect();
        let is_at_border = |block: &usize| self.neighbors(*block).count() < 4;
        let parts = self.parts(&outside).into_iter();
        parts.filter(|part| !part.iter().any(is_at_border)).flatten().for_each(|block| set[block] = true);
        set
    }

    /// Connected parts of a set, the largest first.
    fn parts(&self, set: &[bool]) -> Vec<Vec<usize>> {
        let mut open = set.to_vec();
        let mut parts = Vec::new();
        for start in 0..set.len() {
            if !std::mem::take(&mut open[start]) {
                continue;
            }
            let mut part = vec![start];
            let mut next = 0;
            while let Some(&block) = part.get(next) {
                part.extend(self.neighbors(block).filter(|other| std::mem::take(&mut open[*other])));
                next += 1;
            }
            parts.push(part);
        }
        parts.sort_by_key(|part| std::cmp::Reverse(part.len()));
        parts
    }

    fn pixels(&self, image: &ChannelImage, set: &[bool]) -> PixelSelection {
        let is_in = |pixel: &usize| {
            let (x, y) = (pixel % image.width / self.side, pixel / image.width / self.side);
            x < self.width && y < self.height && set[y * self.width + x]
        };
        let pixels = (0..image.width * image.height).filter(is_in).collect();
        PixelSelection { width: image.width, height: image.height, pixels }
    }

    /// How well a set is told from the blocks around it, by the best of brightness, r and g.
    fn contrast(&self, set: &[bool]) -> f64 {
        let mut around = set.to_vec();
        for _ in 0..COLUMNS / 20 {
            around = self.dilated(&around);
        }
        let of = |values: &[f64], is_wanted: &dyn Fn(usize) -> bool| -> Vec<f64> {
            (0..set.len()).filter(|block| is_wanted(*block)).map(|block| values[block]).collect()
        };
        let areas = [&self.light, &self.r, &self.g].into_iter().filter_map(|values| {
            let area = auc_of_scores(&of(values, &|k| set[k]), &of(values, &|k| around[k] && !set[k]))?;
            Some(area.max(1.0 - area))
        });
        areas.fold(0.5, f64::max)
    }

    /// A guess that stands out from what lies around it.
    fn guess(&self, image: &ChannelImage, name: &'static str, set: &[bool]) -> Option<GuessedRegion> {
        let sureness = self.contrast(set);
        let is_told = sureness > LEAST_SURENESS;
        is_told.then(|| GuessedRegion { name, selection: self.pixels(image, set), sureness })
    }
}

/// Where a sample falls in two: the threshold of the largest variance between classes (Otsu, IEEE Trans. SMC 9, 62, 1979).
struct Split {
    threshold: f64,
    /// Means below and above.
    means: [f64; 2],
    /// Share above.
    above: f64,
    /// Variance between the classes over the whole: 0.64 of a normal, 0.75 of a uniform distribution.
    explained: f64,
}

impl Split {
    fn of(values: &[f64]) -> Option<Self> {
        let n = values.len() as f64;
        let (low, high) =
            values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
        if !(high > low && variance > 0.0) {
            return None;
        }
        let thresholds = (1..BINS).map(|bin| low + (high - low) * bin as f64 / BINS as f64);
        let split = |threshold: f64| {
            let (count, sum) = values
                .iter()
                .filter(|v| **v > threshold)
                .fold((0.0, 0.0), |(count, sum), v| (count + 1.0, sum + v));
            let (above, rest) = (count / n, n - count);
            let means = [(mean * n - sum) / rest, sum / count];
            let explained = above * (1.0 - above) * (means[1] - means[0]).powi(2) / variance;
            Self { threshold, means, above, explained }
        };
        let splits = thresholds.map(split).filter(|split| split.explained.is_finite());
        splits.max_by(|a, b| a.explained.total_cmp(&b.explained))
    }
}

fn share(set: &[bool]) -> f64 {
    set.iter().filter(|is_in| **is_in).count() as f64 / set.len().max(1) as f64
}

/// Guesses teeth, tongue and lips in a frame of an open mouth, upright and about in its middle: those of likely size that stand out. Nothing
/// of a camera without R, G and B.
#[must_use]
pub fn guess_mouth(image: &ChannelImage) -> Vec<GuessedRegion> {
    let Some(blocks) = Blocks::of(image) else { return Vec::new() };
    let of_size = |set: &Vec<bool>, sizes: Range<f64>| sizes.contains(&share(set));
    // Without teeth it may be anything
    let Some(teeth) = teeth(&blocks).filter(|set| of_size(set, 0.005..0.25)) else { return Vec::new() };
    let tongue = tongue(&blocks, &teeth).filter(|set| of_size(set, 0.03..0.4));
    let lips = lips(&blocks, &teeth).filter(|set| of_size(set, 0.02..0.3));
    let all = [("teeth", Some(teeth)), ("tongue", tongue), ("lips", lips)];
    all.into_iter().filter_map(|(name, set)| blocks.guess(image, name, &set?)).collect()
}

/// The share of a frame that the largest lit part of some colors takes that reaches the border, as skin around a mouth does: what is nearer
/// to one of `colors` than to any of the `others`, in (r, g). `None` of a camera without R, G and B.
#[must_use]
pub fn surrounding_share(image: &ChannelImage, colors: &[[f64; 2]], others: &[[f64; 2]]) -> Option<f64> {
    let blocks = Blocks::of(image)?;
    let lit = (20.0 * image.noise_floor_dn.max(1e-3)).ln();
    let is_of_color = |block: usize| {
        let distance = |[r, g]: &[f64; 2]| (blocks.r[block] - r).hypot(blocks.g[block] - g);
        let nearest = |colors: &[[f64; 2]]| colors.iter().map(distance).fold(f64::INFINITY, f64::min);
        nearest(colors) < nearest(others)
    };
    let of_color: Vec<bool> =
        (0..blocks.r.len()).map(|block| blocks.light[block] > lit && is_of_color(block)).collect();
    let is_at_border = |block: &usize| blocks.neighbors(*block).count() < 4;
    let part = blocks.parts(&of_color).into_iter().find(|part| part.iter().any(is_at_border));
    Some(part.map_or(0.0, |part| part.len() as f64 / blocks.r.len() as f64))
}

/// Bright, brighter than lips and skin where these are bright, too, and less red.
fn teeth(blocks: &Blocks) -> Option<Vec<bool>> {
    let split = Split::of(&blocks.light)?;
    let all = 0..blocks.light.len();
    let lights: Vec<f64> = blocks.light.iter().copied().filter(|light| *light > split.threshold).collect();
    let again =
        Split::of(&lights).filter(|again| again.explained > 0.75 && again.means[1] - again.means[0] > 0.6);
    let threshold = again.map_or(split.threshold, |again| again.threshold);
    let bright = |block: &usize| blocks.light[*block] > threshold;
    let mut reds: Vec<f64> = all.clone().filter(bright).map(|block| blocks.r[block]).collect();
    let mut most_red = f64::INFINITY;
    // Lips and tongue are redder than skin, and skin than teeth
    while let Some(red) =
        Split::of(&reds).filter(|red| red.explained > 0.7 && red.means[1] - red.means[0] > 0.04)
    {
        most_red = red.threshold;
        reds.retain(|r| *r <= most_red);
    }
    let is_tooth = |block: usize| bright(&block) && blocks.r[block] <= most_red;
    let found: Vec<bool> = all.map(is_tooth).collect();
    let mut teeth = vec![false; found.len()];
    for part in blocks.parts(&found).into_iter().filter(|part| part.len() * 1000 > found.len()) {
        part.into_iter().for_each(|block| teeth[block] = true);
    }
    teeth.contains(&true).then_some(teeth)
}

/// Color (r, g) of the red light of porphyrin to most cameras.
const RED: [f64; 2] = [0.9, 0.06];

/// Whether a color (r, g) is near to another one, or between that and red light.
fn is_like(color: [f64; 2], other: [f64; 2]) -> bool {
    let ([more_r, more_g], [to_r, to_g]) =
        ([0, 1].map(|k| color[k] - other[k]), [0, 1].map(|k| RED[k] - other[k]));
    let square = to_r * to_r + to_g * to_g;
    let toward = (more_r * to_r + more_g * to_g) / square;
    let aside = (more_r * to_g - more_g * to_r).abs() / square.sqrt();
    more_r.abs() + more_g.abs() < 0.12 || (0.0..0.9).contains(&toward) && aside < 0.06
}

/// What is as bright as the brighter half of the place below the middle, of its color or between that and red light, which is what is
/// looked for, and no tooth.
fn tongue(blocks: &Blocks, teeth: &[bool]) -> Option<Vec<bool>> {
    let mut beside = teeth.to_vec();
    for _ in 0..2 {
        beside = blocks.dilated(&beside);
    }
    let is_place = |block: &usize| {
        let [x, y] = blocks.at(*block);
        (0.35..0.65).contains(&x) && (0.5..0.8).contains(&y) && !beside[*block]
    };
    let place: Vec<usize> = (0..teeth.len()).filter(is_place).collect();
    let middle = median(place.iter().map(|block| blocks.light[*block]))?;
    let seeds: Vec<usize> = place.into_iter().filter(|block| blocks.light[*block] >= middle).collect();
    let of_seeds = |values: &[f64]| median(seeds.iter().map(|block| values[*block]));
    let (light, r, g) = (of_seeds(&blocks.light)?, of_seeds(&blocks.r)?, of_seeds(&blocks.g)?);
    let is_bright = |block: usize| (-0.9..0.7).contains(&(blocks.light[block] - light));
    let is_of_color = |block: usize| is_like([blocks.r[block], blocks.g[block]], [r, g]);
    let is_alike = |block: usize| !beside[block] && is_bright(block) && is_of_color(block);
    let alike: Vec<bool> = (0..teeth.len()).map(is_alike).collect();
    let core = blocks.eroded(&blocks.eroded(&alike));
    let held = |part: &Vec<usize>| part.iter().filter(|block| seeds.contains(block)).count();
    let part = blocks.parts(&core).into_iter().max_by_key(held)?;
    let mut tongue = vec![false; teeth.len()];
    part.into_iter().for_each(|block| tongue[block] = true);
    // Highlights and specks lie on it
    Some(blocks.filled(blocks.dilated(&tongue)))
}

/// Around the teeth, by the color that borders on them.
fn lips(blocks: &Blocks, teeth: &[bool]) -> Option<Vec<bool>> {
    let places: Vec<[f64; 2]> =
        (0..teeth.len()).filter(|block| teeth[*block]).map(|block| blocks.at(block)).collect();
    let ends = [0, 1].map(|axis| {
        let values = places.iter().map(|at| at[axis]);
        [values.clone().fold(1.0, f64::min), values.fold(0.0, f64::max)]
    });
    let distance = |block: usize| {
        let at = blocks.at(block);
        let along = |axis: usize| {
            let [low, high] = ends[axis];
            (at[axis] - 0.5 * (low + high)) / (0.5 * (high - low)).max(1e-3)
        };
        along(0).hypot(along(1))
    };
    let ring: Vec<usize> =
        (0..teeth.len()).filter(|block| (1.1..1.7).contains(&distance(*block)) && !teeth[*block]).collect();
    // The cavity is darker than lips and skin
    let middle = median(ring.iter().map(|block| blocks.light[*block]))?;
    let ring: Vec<usize> = ring.into_iter().filter(|block| blocks.light[*block] > middle - 0.7).collect();
    let of_ring = |values: &[f64]| ring.iter().map(|block| values[*block]).collect::<Vec<f64>>();
    let best =
        [&blocks.r, &blocks.g].into_iter().filter_map(|values| Some((values, Split::of(&of_ring(values))?)));
    let (values, split) = best.max_by(|a, b| a.1.explained.total_cmp(&b.1.explained))?;
    let is_above = |block: &usize| values[*block] > split.threshold;
    let inner = ring.iter().filter(|block| distance(**block) < 1.3);
    let inner_above = inner.clone().filter(|block| is_above(block)).count() * 2 > inner.count();
    let mut lips = vec![false; teeth.len()];
    // Teeth at the back may be of their color, but are brighter
    let of_color: Vec<usize> = ring.iter().copied().filter(|block| is_above(block) == inner_above).collect();
    let brightest = median(of_color.iter().map(|block| blocks.light[*block]))? + 0.5;
    for block in of_color.into_iter().filter(|block| blocks.light[*block] < brightest) {
        lips[block] = true;
    }
    let core = blocks.eroded(&lips);
    let mut found = vec![false; teeth.len()];
    for part in blocks.parts(&core).into_iter().take(2) {
        part.into_iter().for_each(|block| found[block] = true);
    }
    // Skin reaches farther
    let held: Vec<usize> = (0..found.len()).filter(|block| found[*block]).collect();
    let near = held.iter().filter(|block| distance(**block) < 1.45).count();
    (4 * near > 3 * held.len()).then_some(found)
}

/// The share of a region that differs from the rest as another tissue does: in two kinds of blocks it is twice as dark or of another color.
/// `None` of a region of one kind, of one of a hundred pixels or fewer, and of a camera without R, G and B.
#[must_use]
pub fn other_tissue_share(image: &ChannelImage, region: &PixelSelection) -> Option<f64> {
    let blocks = Blocks::of(image)?;
    if region.pixels.len() <= 100 {
        return None;
    }
    let mut held = vec![0usize; blocks.light.len()];
    for pixel in &region.pixels {
        let (x, y) = (pixel % image.width / blocks.side, pixel / image.width / blocks.side);
        if x < blocks.width && y < blocks.height {
            held[y * blocks.width + x] += 1;
        }
    }
    let whole = |block: &usize| 2 * held[*block] > blocks.side * blocks.side;
    let of = |values: &[f64]| (0..held.len()).filter(whole).map(|block| values[block]).collect::<Vec<f64>>();
    // Shading over one tissue is even: it explains three quarters of the variance
    let least_explained = 0.78;
    let least_share = 0.08;
    [(&blocks.light, 0.7), (&blocks.r, 0.06), (&blocks.g, 0.06)]
        .into_iter()
        .filter_map(|(values, step)| Some((Split::of(&of(values))?, step)))
        .filter(|(split, step)| split.explained > least_explained && split.means[1] - split.means[0] > *step)
        .map(|(split, _)| split.above.min(1.0 - split.above))
        .filter(|share| *share > least_share)
        .max_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mouth() -> (ChannelImage, Vec<&'static str>) {
        mouth_from(1.0)
    }

    /// A mouth of colored shapes with noise, from a relative distance: skin, lips, a dark cavity, two rows of teeth, a tongue.
    fn mouth_from(distance: f64) -> (ChannelImage, Vec<&'static str>) {
        let (width, height) = (320, 240);
        let key = crate::sampling::random::Key::new(3);
        let (mut data, mut names) = (Vec::new(), Vec::new());
        for pixel in 0..width * height {
            let at = [(pixel % width) as f64 / width as f64, (pixel / width) as f64 / height as f64];
            let [x, y] = at.map(|at| distance * (at - 0.5));
            let (name, color) = if x.hypot(y / 1.2) > 0.47 {
                ("skin", [160.0, 120.0, 90.0])
            } else if x.hypot(y / 1.2) > 0.38 {
                ("lips", [150.0, 70.0, 50.0])
            } else if x.hypot(y / 1.2) > 0.3 && y.abs() > 0.1 {
                ("teeth", [300.0, 290.0, 260.0])
            } else if (x / 0.22).hypot((y - 0.1) / 0.14) < 1.0 {
                ("tongue", [90.0, 52.0, 40.0])
            } else {
                ("cavity", [15.0, 8.0, 6.0])
            };
            names.push(name);
            data.extend(
                (0..3).map(|c| {
                    (color[c] * (1.0 + 0.05 * key.with(pixel as u64).with(c as u64).normal())) as f32
                }),
            );
        }
        let channels = ["R", "G", "B"].map(String::from).to_vec();
        let image = ChannelImage {
            width,
            height,
            channels,
            data,
            saturated: vec![false; width * height],
            noise_floor_dn: 1.0,
            full_scale_dn: 1023.0,
            shares: vec![1.0; 3],
            interpolation: None,
            subtracted: None,
            calibration: None,
            label: "white".into(),
        };
        (image, names)
    }

    /// Of each guess at least nine tenths are what it is called, and half of that is found.
    #[test]
    fn regions_of_a_drawn_mouth_are_found() {
        let (image, names) = mouth();
        let found = guess_mouth(&image);
        assert_eq!(found.iter().map(|guess| guess.name).collect::<Vec<_>>(), ["teeth", "tongue", "lips"]);
        for guess in found {
            let right = guess.selection.pixels.iter().filter(|pixel| names[**pixel] == guess.name).count();
            let all = names.iter().filter(|name| **name == guess.name).count();
            assert!(
                10 * right >= 9 * guess.selection.pixels.len(),
                "{} {right} of {}",
                guess.name,
                guess.selection.pixels.len()
            );
            assert!(
                2 * right > all && guess.sureness > 0.7,
                "{} {right} of {all}: {}",
                guess.name,
                guess.sureness
            );
        }
    }

    /// Porphyrin is what is looked for: where it glows the tongue is tongue.
    #[test]
    fn red_places_of_a_tongue_belong_to_it() {
        let (mut image, names) = mouth();
        let is_red = |pixel: &usize| names[*pixel] == "tongue" && pixel / 320 < 132;
        let red: Vec<usize> = (0..names.len()).filter(is_red).collect();
        for pixel in &red {
            image.data[3 * pixel] += 80.0;
        }
        let found = guess_mouth(&image);
        let tongue = found.iter().find(|guess| guess.name == "tongue").unwrap();
        let held = red.iter().filter(|pixel| tongue.selection.pixels.contains(pixel)).count();
        assert!(red.len() > 1000 && 4 * held > 3 * red.len(), "{held} of {}", red.len());
    }

    #[test]
    fn skin_is_told_by_its_color_at_the_border() {
        // 160 of 370 are red in the skin, 150 of 270 in the lips; close by the skin is one of two equal parts
        let [skin, lips] = [[0.43, 0.32], [0.55, 0.26]];
        let share = |distance: f64, color: [f64; 2], other: [f64; 2]| {
            surrounding_share(&mouth_from(distance).0, &[color], &[other, [0.35, 0.34]]).unwrap()
        };
        assert!((share(1.0, skin, lips) - 0.5 * 0.205).abs() < 0.01, "{}", share(1.0, skin, lips));
        assert!((share(2.0, skin, lips) - 0.792).abs() < 0.01, "{}", share(2.0, skin, lips));
        assert_eq!(share(2.0, lips, skin), 0.0, "lips are of another color, and do not reach the border");
        let (mut image, _) = mouth_from(2.0);
        image.data.iter_mut().for_each(|value| *value *= 0.02);
        assert_eq!(surrounding_share(&image, &[skin], &[lips]), Some(0.0), "nothing is lit");
    }

    #[test]
    fn a_region_over_two_tissues_is_told_and_one_of_shaded_tissue_is_not() {
        let (mut image, names) = mouth();
        let pixels = |wanted: &[&str]| -> PixelSelection {
            let pixels = (0..names.len()).filter(|pixel| wanted.contains(&names[*pixel])).collect();
            PixelSelection { width: image.width, height: image.height, pixels }
        };
        let [tongue, both] = [pixels(&["tongue"]), pixels(&["tongue", "cavity"])];
        assert_eq!(other_tissue_share(&image, &tongue), None);
        assert!(other_tissue_share(&image, &both).unwrap() > 0.2);
        // A factor of three from left to right
        for pixel in 0..names.len() {
            let factor = 3f32.powf((pixel % 320) as f32 / 320.0);
            image.data[3 * pixel..3 * pixel + 3].iter_mut().for_each(|value| *value *= factor);
        }
        assert_eq!(other_tissue_share(&image, &tongue), None);
    }

    #[test]
    fn frames_without_colors_or_contrast_have_no_guess() {
        let (image, _) = mouth();
        let gray = ChannelImage { channels: vec!["N".into(); 3], ..image.clone() };
        assert!(guess_mouth(&gray).is_empty());
        let even = ChannelImage { data: vec![100.0; image.data.len()], ..image };
        assert!(guess_mouth(&even).is_empty());
    }
}
