//! The image of a traced lens without rendering through it: a pinhole's radiance, moved by the distortion, blurred by
//! the point spread of each field point, darkened by the relative illumination.

use std::f64::consts::PI;
use std::ops::Range;

use glam::DVec2;
use rayon::prelude::*;

use super::airy::Airy;
use super::by_height::ByHeight;
use super::camera_lens::CameraLens;
use super::sequential_trace::LensRay;
use super::traced_lens::TracedLens;
use crate::image::SpectralImage;
use crate::sampling::SampleStream;
use crate::spectral::Radiance;

/// Field heights at which point spreads are traced.
const FIELD_NODES: usize = 17;
/// Rays per point spread.
const RAYS: u32 = 512;
/// Largest reach of a point spread, pixels; what lands farther away is put there.
const LARGEST_REACH: i32 = 48;

/// Where rays of one object point land, relative to its chief ray: mm along and across the radius, and shares.
#[derive(Clone, Debug, PartialEq)]
pub struct PointSpread {
    /// Height of the chief ray on the film, mm.
    pub height_mm: f64,
    /// `[radial, tangential, share]`, shares adding up to 1. Empty where no light arrives.
    pub rays: Vec<[f64; 3]>,
}

/// A ray of an object point on the film.
#[derive(Clone, Copy, Debug)]
pub(super) struct LandedRay {
    /// Place relative to the chief ray: away from the axis and across, mm.
    pub(super) at_mm: [f64; 2],
    /// Change of the place per mm along the axis.
    pub(super) slope: [f64; 2],
    /// Share of the light; all shares add up to 1.
    pub(super) share: f64,
}

/// Rays of the object point whose chief ray arrives at a height, evenly over the pupil as its film point sees it. Empty where
/// no light arrives.
pub(super) fn landed_rays(lens: &TracedLens, object_mm: f64, height_mm: f64, rays: u32) -> Vec<LandedRay> {
    let mut landed = Vec::new();
    let Some(chief) = lens.chief_ray(height_mm) else { return landed };
    let toward_lens = -chief.object_side.direction;
    let object = object_mm.is_finite().then(|| chief.object_side.at_z(object_mm));
    for sample in lens.pupil_rays(height_mm, rays) {
        // Through the same point in front of the lens as the ray that left the film point.
        let through = sample.ray.origin;
        let ray = match object {
            Some(object) => LensRay::between(object, through),
            None => Some(LensRay { origin: through - toward_lens, direction: toward_lens }),
        };
        if let Some(Ok(out)) = ray.map(|ray| lens.surfaces().forward(ray)) {
            let at = out.at_z(lens.film_mm());
            let slope = [out.direction.x / out.direction.z, out.direction.y / out.direction.z];
            landed.push(LandedRay { at_mm: [at.x - height_mm, at.y], slope, share: sample.weight_sr });
        }
    }
    let total: f64 = landed.iter().map(|ray| ray.share).sum();
    landed.iter_mut().for_each(|ray| ray.share /= total);
    landed
}

impl PointSpread {
    /// Traces the object point whose chief ray arrives at a height, without diffraction. `object_mm` is the position of the
    /// object plane, minus infinity for a distant one.
    pub fn new(lens: &TracedLens, object_mm: f64, height_mm: f64, rays: u32) -> Self {
        let rays = landed_rays(lens, object_mm, height_mm, rays);
        Self { height_mm, rays: rays.iter().map(|ray| [ray.at_mm[0], ray.at_mm[1], ray.share]).collect() }
    }

    /// Moves every ray by a random vector from the diffraction pattern of a round pupil (Airy): the convolution of both.
    #[must_use]
    fn with_airy(mut self, airy: &Airy, scale_mm: f64) -> Self {
        for (index, ray) in self.rays.iter_mut().enumerate() {
            let [u, v, _, _] = SampleStream::new(7, 3, index as u32).next_4d();
            let [x, y] = airy.sample([u, v]);
            ray[0] += scale_mm * x;
            ray[1] += scale_mm * y;
        }
        self
    }
}

/// Some of the values of each pixel of an image, `[row, col, value]`.
struct Interleaved<'a> {
    data: &'a [f32],
    size: [usize; 2],
    /// Values of a pixel.
    values: usize,
    /// Those that count.
    range: Range<usize>,
}

impl Interleaved<'_> {
    fn pixel(&self, row: usize, col: usize) -> &[f32] {
        &self.data[(row * self.size[0] + col) * self.values..][..self.values][self.range.clone()]
    }
}

impl CameraLens {
    /// Lens radiance (see [`CameraLens`]) from the radiance that a pinhole in the entrance pupil sees, whose half width has
    /// the tangent `tan_half_width`. Rows and columns stay. Everything is taken to lie in the plane in focus: a render through
    /// the lens knows depth of field, this way does not. Where the
    /// pinhole did not look it is dark.
    pub fn lens_radiance(
        &self,
        pinhole: &SpectralImage<Radiance>,
        tan_half_width: f64,
    ) -> SpectralImage<Radiance> {
        let (width, height, bands) = (pinhole.width(), pinhole.height(), pinhole.bands());
        let mut picture = SpectralImage::zeros(pinhole.grid().clone(), width, height);
        if width == 0 || height == 0 || bands == 0 {
            return picture;
        }
        let size = [width, height];
        for (group, (range, _)) in self.groups().iter().enumerate() {
            let seen = Interleaved { data: pinhole.data(), size, values: bands, range: range.clone() };
            self.image_values(group, &seen, tan_half_width, picture.data_mut());
        }
        picture
    }

    /// [`CameraLens::lens_radiance`] of other values than bands, `[row, col, value]`, such as channels of a sensor, as the rays
    /// of one of the [groups](CameraLens::groups) image them.
    pub fn lens_values(
        &self,
        group: usize,
        pinhole: &[f32],
        [width, height]: [usize; 2],
        tan_half_width: f64,
    ) -> Vec<f32> {
        let mut picture = vec![0.0; pinhole.len()];
        if !pinhole.is_empty() {
            let values = pinhole.len() / (width * height);
            let seen = Interleaved { data: pinhole, size: [width, height], values, range: 0..values };
            self.image_values(group, &seen, tan_half_width, &mut picture);
        }
        picture
    }

    /// Images some of the values of a pinhole's image by the rays of a group of bands.
    fn image_values(
        &self,
        group: usize,
        pinhole: &Interleaved<'_>,
        tan_half_width: f64,
        picture: &mut [f32],
    ) {
        let lens = &self.groups()[group].1;
        let radius_mm = 0.5 * self.film_width_mm().hypot(self.film_height_mm());
        let illumination = ByHeight::new(radius_mm, 33, |height_mm| self.relative_illumination(height_mm));
        // Look pixels up where their chief rays go
        let tangent = lens.object_tangents(radius_mm);
        let ideal = self.undistorted(pinhole, tan_half_width, &tangent);
        // Convolve traced point spreads with the Airy pattern
        let airy = Airy::new();
        let scale_mm = lens.wavelength_nm() * 1e-6 * self.working_f_number();
        let spreads: Vec<PointSpread> = (0..FIELD_NODES)
            .into_par_iter()
            .map(|node| {
                let height_mm = radius_mm * node as f64 / (FIELD_NODES - 1) as f64;
                PointSpread::new(lens, self.state().object_mm(), height_mm, RAYS).with_airy(&airy, scale_mm)
            })
            .collect();
        // Blur and darken
        self.blur(&ideal, &spreads, &illumination, pinhole, picture);
    }

    /// Multiplies an image of the given width on the film, centered on the axis, by the relative illumination.
    pub fn darken(&self, picture: &mut SpectralImage<Radiance>, film_width_mm: f64) {
        let (width, height, bands) = (picture.width(), picture.height(), picture.bands());
        let radius_mm = 0.5 * self.film_width_mm().hypot(self.film_height_mm());
        let illumination = ByHeight::new(radius_mm, 33, |height_mm| self.relative_illumination(height_mm));
        let pitch_mm = film_width_mm / width as f64;
        for (index, pixel) in picture.data_mut().chunks_exact_mut(bands).enumerate() {
            let x = (index % width) as f64 + 0.5 - 0.5 * width as f64;
            let y = (index / width) as f64 + 0.5 - 0.5 * height as f64;
            let factor = illumination.at(pitch_mm * x.hypot(y)) as f32;
            pixel.iter_mut().for_each(|value| *value *= factor);
        }
    }

    /// Working f-number `1 / (2 sin u')` on the axis.
    pub fn working_f_number(&self) -> f64 {
        0.5 / (self.axial_solid_angle_sr() / PI).sqrt()
    }

    /// Middle of a (square) pixel on the upright image, mm to the right and up.
    fn place_mm(&self, row: usize, col: usize, width: usize, height: usize) -> DVec2 {
        let pitch_mm = self.film_width_mm() / width as f64;
        DVec2::new(col as f64 + 0.5 - 0.5 * width as f64, 0.5 * height as f64 - row as f64 - 0.5) * pitch_mm
    }

    /// The pinhole's image where chief rays put it, `[row, col, band of the range]`: between pixels by Lanczos' kernel, as a line between
    /// two of them would lose half of the contrast of fine bars wherever distortion moves them by half a pixel. Its ringing is cut and moved,
    /// see [`settle`].
    fn undistorted(&self, pinhole: &Interleaved<'_>, tan_half_width: f64, tangent: &ByHeight) -> Vec<f32> {
        let ([width, height], range) = (pinhole.size, &pinhole.range);
        let bands = range.len();
        let mut ideal = vec![0.0_f32; width * height * bands];
        let mut beyond = vec![0.0_f32; ideal.len()];
        let rows = ideal.par_chunks_exact_mut(width * bands).zip(beyond.par_chunks_exact_mut(width * bands));
        rows.enumerate().for_each(|(row, (out, beyond))| {
            let mut ends = vec![[0.0_f32; 2]; bands];
            for (col, (out, beyond)) in
                out.chunks_exact_mut(bands).zip(beyond.chunks_exact_mut(bands)).enumerate()
            {
                let seen = tangent.along(self.place_mm(row, col, width, height)) / tan_half_width;
                // Pixel coordinates of the pinhole, whose pixels are square in tangent
                let x = 0.5 * width as f64 * (1.0 + seen.x) - 0.5;
                let y = 0.5 * height as f64 - 0.5 * width as f64 * seen.y - 0.5;
                // Beyond what the pinhole saw it is dark; half a pixel is the way from the last middle to the border
                let inside = |at: f64, size: usize| (-0.75..=size as f64 - 0.25).contains(&at);
                if !(inside(x, width) && inside(y, height)) {
                    continue;
                }
                let (x, y) = (x.clamp(0.0, (width - 1) as f64), y.clamp(0.0, (height - 1) as f64));
                let [(left, across), (top, down)] = [x, y].map(|at| (at.floor(), lanczos(at - at.floor())));
                ends.fill([f32::INFINITY, f32::NEG_INFINITY]);
                for (j, weight_down) in down.iter().enumerate() {
                    let row = within(top as i32 + j as i32 - 2, height);
                    for (i, weight_across) in across.iter().enumerate() {
                        let (col, weight) =
                            (within(left as i32 + i as i32 - 2, width), weight_across * weight_down);
                        let values = pinhole.pixel(row, col);
                        for (sum, value) in out.iter_mut().zip(values) {
                            *sum += weight * value;
                        }
                        if (1..5).contains(&i) && (1..5).contains(&j) {
                            for ([low, high], value) in ends.iter_mut().zip(values) {
                                (*low, *high) = (low.min(*value), high.max(*value));
                            }
                        }
                    }
                }
                for ((value, beyond), [low, high]) in out.iter_mut().zip(beyond).zip(&ends) {
                    let held = value.clamp(*low, *high);
                    (*value, *beyond) = (held, *value - held);
                }
            }
        });
        settle(&mut ideal, &beyond, [width, height]);
        ideal
    }

    /// Gathers at every pixel what the point spread of its field brings there.
    fn blur(
        &self,
        ideal: &[f32],
        spreads: &[PointSpread],
        illumination: &ByHeight,
        place: &Interleaved<'_>,
        picture: &mut [f32],
    ) {
        let ([width, height], bands, range) = (place.size, place.values, &place.range);
        let pitch_mm = self.film_width_mm() / width as f64;
        let radius_mm = 0.5 * self.film_width_mm().hypot(self.film_height_mm());
        picture.par_chunks_exact_mut(width * bands).enumerate().for_each(|(row, out)| {
            let mut kernel = Kernel::default();
            for (col, out) in out.chunks_exact_mut(bands).enumerate() {
                // Find the field height of the pixel between two nodes
                let place = self.place_mm(row, col, width, height);
                let at = place.length();
                let position = (at / radius_mm * (FIELD_NODES - 1) as f64).min((FIELD_NODES - 1) as f64);
                let left = (position as usize).min(FIELD_NODES - 2);
                let t = position - left as f64;
                let radial = if at > 0.0 { place / at } else { DVec2::X };
                // Rotate both point spreads to the pixel's radius and bin them to pixels
                kernel.clear();
                for (spread, share) in [(&spreads[left], 1.0 - t), (&spreads[left + 1], t)] {
                    for ray in &spread.rays {
                        // Light of the object at q lands at q + offset, so this pixel sees q = p - offset; rows run down.
                        let offset = radial * ray[0] + radial.perp() * ray[1];
                        kernel.add(-offset.x / pitch_mm, offset.y / pitch_mm, share * ray[2]);
                    }
                }
                // Gather the ideal image, darkened by the relative illumination
                let total: f32 = kernel.entries().map(|(_, _, weight)| weight).sum();
                let brightness = illumination.at(at) as f32 / total.max(f32::MIN_POSITIVE);
                for (dx, dy, weight) in kernel.entries() {
                    let (r, c) = (within(row as i32 + dy, height), within(col as i32 + dx, width));
                    let start = (r * width + c) * range.len();
                    let factor = weight * brightness;
                    for (sum, value) in out[range.clone()].iter_mut().zip(&ideal[start..start + range.len()])
                    {
                        *sum += factor * value;
                    }
                }
            }
        });
    }
}

/// Moves the light that interpolation found beyond the samples around a pixel to pixels near it: an edge keeps its width and its light, and
/// does not ring.
fn settle(values: &mut [f32], beyond: &[f32], [width, height]: [usize; 2]) {
    const REACH: i32 = 2;
    let bands = values.len() / (width * height);
    let found = beyond.iter().enumerate().filter(|(_, amount)| **amount != 0.0);
    for (index, amount) in found {
        let (pixel, own) = (index / bands, values[index]);
        let (row, col) = ((pixel / width) as i32, (pixel % width) as i32);
        let near = (row - REACH..=row + REACH).flat_map(|r| (col - REACH..=col + REACH).map(move |c| (r, c)));
        let near: Vec<usize> = near
            .filter(|(r, c)| (0..height as i32).contains(r) && (0..width as i32).contains(c))
            .map(|(r, c)| (r as usize * width + c as usize) * bands + index % bands)
            .collect();
        // Those that have room on the side of the amount
        let room = |value: f32| (amount.signum() * (own - value)).max(0.0);
        let total: f32 = near.iter().map(|at| room(values[*at])).sum();
        if total > 0.0 {
            let part = amount.signum() * (amount.abs() / total).min(1.0);
            near.iter().for_each(|at| values[*at] += part * room(values[*at]));
        }
    }
}

/// The nearest of so many places.
fn within(at: i32, count: usize) -> usize {
    at.clamp(0, count as i32 - 1) as usize
}

/// Weights of the six samples around a point that lies `t` behind the third: Lanczos' kernel, `sinc x sinc(x / 3)`, adding up to 1.
fn lanczos(t: f64) -> [f32; 6] {
    let sinc = |x: f64| if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) };
    let weights = [2.0, 1.0, 0.0, -1.0, -2.0, -3.0].map(|k| sinc(k + t) * sinc((k + t) / 3.0));
    let total: f64 = weights.iter().sum();
    weights.map(|weight| (weight / total) as f32)
}

/// Weights of the four samples around a point that lies `t` behind the second, whose mean and variance are those of the point: Keys' cubic
/// kernel (IEEE Trans. Acoust. 29, 1153, 1981).
fn cubic(t: f64) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    let weights = [2.0 * t2 - t - t3, 2.0 - 5.0 * t2 + 3.0 * t3, t + 4.0 * t2 - 3.0 * t3, t3 - t2];
    weights.map(|weight| (0.5 * weight) as f32)
}

/// Weights on whole pixels around one pixel.
struct Kernel {
    weights: Vec<f32>,
    reach: i32,
}

impl Default for Kernel {
    fn default() -> Self {
        let side = (2 * LARGEST_REACH + 1) as usize;
        Self { weights: vec![0.0; side * side], reach: 0 }
    }
}

impl Kernel {
    fn index(dx: i32, dy: i32) -> usize {
        ((dy + LARGEST_REACH) * (2 * LARGEST_REACH + 1) + dx + LARGEST_REACH) as usize
    }

    fn clear(&mut self) {
        for dy in -self.reach..=self.reach {
            let start = Self::index(-self.reach, dy);
            self.weights[start..=start + 2 * self.reach as usize].fill(0.0);
        }
        self.reach = 0;
    }

    /// Spreads a weight over the pixels around a point, as [`cubic`] does: a spread keeps its place and width.
    fn add(&mut self, x: f64, y: f64, weight: f64) {
        let limit = f64::from(LARGEST_REACH - 2);
        let (x, y) = (x.clamp(-limit, limit), y.clamp(-limit, limit));
        let [(left, across), (top, down)] = [x, y].map(|at| (at.floor() as i32, cubic(at - at.floor())));
        for (k, weight_down) in down.iter().enumerate() {
            let start = Self::index(left - 1, top + k as i32 - 1);
            for (sum, weight_across) in self.weights[start..start + 4].iter_mut().zip(across) {
                *sum += weight as f32 * weight_down * weight_across;
            }
        }
        self.reach = self.reach.max(left.abs().max(top.abs()) + 2);
    }

    /// What lies above 0: light of a spread narrower than a pixel is nowhere taken away.
    fn entries(&self) -> impl Iterator<Item = (i32, i32, f32)> + '_ {
        (-self.reach..=self.reach)
            .flat_map(move |dy| {
                (-self.reach..=self.reach).map(move |dx| (dx, dy, self.weights[Self::index(dx, dy)]))
            })
            .filter(|entry| entry.2 > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kernel_keeps_its_weight_and_place() {
        let mut kernel = Kernel::default();
        // A spread of one pixel
        for ray in 0..64 {
            let (sine, cosine) = (0.1 * PI * f64::from(ray)).sin_cos();
            let radius = 0.5 * f64::from(ray % 8) / 7.0;
            kernel.add(0.25 + radius * cosine, -1.5 + radius * sine, 1.0);
        }
        let sums = kernel
            .entries()
            .fold([0.0; 3], |s, (dx, dy, w)| [s[0] + w, s[1] + w * dx as f32, s[2] + w * dy as f32]);
        let off = [sums[1] / sums[0] - 0.25, sums[2] / sums[0] + 1.5];
        println!("{off:?} {sums:?}");
        assert!(off.iter().all(|off| off.abs() < 0.05), "{off:?}");
        kernel.clear();
        assert_eq!(kernel.entries().count(), 0);
        kernel.add(1e9, 0.0, 1.0);
        assert_eq!(kernel.entries().count(), 1);
    }
}
