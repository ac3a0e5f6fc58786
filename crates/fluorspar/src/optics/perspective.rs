//! The camera of a scene: a pinhole or a round aperture that samples the radiance field, parallel rays, or film behind a traced lens.

use std::sync::Arc;

use glam::{Quat, Vec2, Vec3};

use super::airy::Airy;
use super::camera_lens::CameraLens;
use crate::image::View;
use crate::sampling::warp;

/// A camera: a pinhole, or film behind a traced lens whose entrance pupil is where the pinhole would be.
///
/// The pinhole records radiance. The film records lens radiance, see [`CameraLens`]; its field of view is that of the lens,
/// and the pinhole, whose rays go where its chief rays do, serves for the feature maps only.
#[derive(Clone, Debug, PartialEq)]
pub struct PerspectiveCamera {
    /// Position of the entrance pupil, m.
    pub position: Vec3,
    /// Unit viewing direction.
    pub forward: Vec3,
    /// Unit vector to the right of the image.
    pub right: Vec3,
    /// Unit vector to the top of the image.
    pub up: Vec3,
    /// Tangent of half the horizontal field of view.
    pub tan_half_width: f32,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Lens through which the image is rendered; none is a pinhole.
    pub lens: Option<Arc<CameraLens>>,
    /// Aperture that rays start on; none is a pinhole. Without meaning for a lens and for parallel rays.
    pub aperture: Option<Arc<Aperture>>,
    /// Half of the width of the image in the scene, m, where all rays are parallel: an orthographic camera, whose rays start in
    /// the plane of its position. None is a pinhole or a lens.
    pub parallel_half_width_m: Option<f32>,
    /// Where the middle of the image lies off the optical axis, to the right and up, in halves of the width: not 0 where the image
    /// is a window of a larger one. Without meaning for a lens.
    pub center: Vec2,
}

/// The round aperture of a thin lens without aberrations: what lies off its plane in focus blurs, and so does everything by the
/// Airy pattern of its diameter. Recorded is the mean radiance over the aperture.
#[derive(Clone, Debug, PartialEq)]
pub struct Aperture {
    radius: f32,
    focus: f32,
    airy: Airy,
}

/// Wavelength of the Airy pattern of an [`Aperture`], m: the middle of the visible ones.
const DIFFRACTION_WAVELENGTH: f32 = 550e-9;

impl Aperture {
    /// An aperture of the given radius, with the plane in focus at a distance; both in m and above 0.
    pub fn new(radius: f32, focus: f32) -> Self {
        Self { radius, focus, airy: Airy::new() }
    }

    /// Radius, m.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Distance of the plane in focus, m.
    pub fn focus(&self) -> f32 {
        self.focus
    }

    /// A random change of the tangents of a ray by diffraction.
    fn diffraction(&self, u: [f32; 2]) -> Vec2 {
        let per_f_number = DIFFRACTION_WAVELENGTH / (2.0 * self.radius);
        Vec2::from(self.airy.sample(u).map(|at| at as f32)) * per_f_number
    }
}

/// A ray of the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraRay {
    /// Origin, m.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
    /// Factor on the radiance along the ray; 1 for a pinhole, 0 where the lens blocks the ray.
    pub weight: f32,
}

impl PerspectiveCamera {
    /// A camera at `position` that looks at `target`. `None` when the two coincide, `up` is parallel to the view,
    /// or the field of view is not between 0 and 180 degrees.
    pub fn look_at(
        position: Vec3,
        target: Vec3,
        up: Vec3,
        horizontal_field_deg: f32,
        width: usize,
        height: usize,
    ) -> Option<Self> {
        let forward = (target - position).try_normalize()?;
        let right = forward.cross(up).try_normalize()?;
        let valid = horizontal_field_deg > 0.0 && horizontal_field_deg < 179.0 && width > 0 && height > 0;
        valid.then(|| Self {
            position,
            forward,
            right,
            up: right.cross(forward),
            tan_half_width: (0.5 * horizontal_field_deg.to_radians()).tan(),
            width,
            height,
            lens: None,
            aperture: None,
            parallel_half_width_m: None,
            center: Vec2::ZERO,
        })
    }

    /// The camera turned about a point on its axis that is `distance_m` away: `yaw` to its right and `pitch` above, radians, and `zoom` times
    /// as near. A lens becomes the pinhole in its pupil.
    #[must_use]
    pub fn orbited(&self, distance_m: f32, yaw: f32, pitch: f32, zoom: f32) -> Self {
        let turn = Quat::from_axis_angle(self.up, yaw) * Quat::from_axis_angle(self.right, -pitch);
        let middle = self.position + self.forward * distance_m;
        let [forward, right, up] = [self.forward, self.right, self.up].map(|axis| turn * axis);
        let position = middle - forward * (distance_m / zoom);
        let parallel_half_width_m = self.parallel_half_width_m.map(|half| half / zoom);
        Self { position, forward, right, up, lens: None, parallel_half_width_m, ..self.clone() }
    }

    /// The view that image files store; none of parallel rays, which have no field of view, or of a window off the axis.
    pub fn view(&self) -> Option<View> {
        (self.parallel_half_width_m.is_none() && self.center == Vec2::ZERO).then(|| View {
            position_m: self.position.to_array(),
            forward: self.forward.to_array(),
            right: self.right.to_array(),
            tan_half_width: self.tan_half_width,
        })
    }

    /// Origin and unit direction through image coordinates in pixels: x from the left, y from the top. Of a lens, along its chief ray
    /// from the middle of its entrance pupil.
    pub fn ray(&self, x: f32, y: f32) -> (Vec3, Vec3) {
        if let Some(lens) = &self.lens {
            let [right_mm, up_mm] = self.film_place_mm(lens, x, y);
            let [right, up] = lens.chief_tangents(right_mm, up_mm).map(|tangent| tangent as f32);
            if right.is_finite() && up.is_finite() {
                return (self.position, (self.forward + self.right * right + self.up * up).normalize());
            }
        }
        let half = self.parallel_half_width_m.unwrap_or(self.tan_half_width);
        let scale = 2.0 * half / self.width as f32;
        let dx = (x - 0.5 * self.width as f32) * scale + self.center.x * half;
        let dy = (0.5 * self.height as f32 - y) * scale + self.center.y * half;
        if self.parallel_half_width_m.is_some() {
            return (self.position + self.right * dx + self.up * dy, self.forward);
        }
        (self.position, (self.forward + self.right * dx + self.up * dy).normalize())
    }

    /// Origins and unit directions through the middles of `side` by `side` equal cells of the image, row by row.
    pub fn ray_grid(&self, side: usize) -> impl Iterator<Item = (Vec3, Vec3)> {
        let middle = move |cell: usize, pixels: usize| (cell as f32 + 0.5) / side as f32 * pixels as f32;
        (0..side * side).map(move |i| self.ray(middle(i % side, self.width), middle(i / side, self.height)))
    }
}

impl PerspectiveCamera {
    /// Groups of bands that need rays of their own: one, unless a lens with dispersion splits them.
    pub fn band_groups(&self) -> usize {
        self.lens.as_ref().map_or(1, |lens| lens.groups().len())
    }

    /// A ray for a group of bands through image coordinates in pixels and a point `u` of the pupil; `more` gives numbers for
    /// diffraction where there is some.
    pub fn sample(
        &self,
        group: usize,
        x: f32,
        y: f32,
        u: [f32; 2],
        more: impl FnOnce() -> [f32; 4],
    ) -> CameraRay {
        let Some(lens) = &self.lens else {
            let (origin, direction) = match &self.aperture {
                Some(aperture) if self.parallel_half_width_m.is_none() => {
                    let [v, w, ..] = more();
                    self.aperture_ray(aperture, Vec2::new(x, y), u, [v, w])
                }
                _ => self.ray(x, y),
            };
            return CameraRay { origin, direction, weight: 1.0 };
        };
        let [right_mm, up_mm] = self.film_place_mm(lens, x, y);
        let world = |[right, up, forward]: [f64; 3]| {
            self.right * right as f32 + self.up * up as f32 + self.forward * forward as f32
        };
        match lens.sample(group, right_mm, up_mm, u) {
            Some(ray) => CameraRay {
                origin: self.position + world(ray.origin_mm.map(|mm| mm * 1e-3)),
                direction: world(ray.direction).normalize(),
                weight: ray.weight as f32,
            },
            None => CameraRay { origin: self.position, direction: self.forward, weight: 0.0 },
        }
    }

    /// A point of the film of a lens, mm to the right of and above its middle.
    fn film_place_mm(&self, lens: &CameraLens, x: f32, y: f32) -> [f64; 2] {
        let pitch_mm = lens.film_width_mm() / self.width as f64;
        [f64::from(x) - 0.5 * self.width as f64, 0.5 * self.height as f64 - f64::from(y)]
            .map(|px| px * pitch_mm)
    }

    /// A ray from a point `u` of an aperture to the point in focus, after diffraction by numbers `v`.
    fn aperture_ray(&self, aperture: &Aperture, at: Vec2, u: [f32; 2], v: [f32; 2]) -> (Vec3, Vec3) {
        let at = at + aperture.diffraction(v) * (0.5 * self.width as f32 / self.tan_half_width);
        let (_, chief) = self.ray(at.x, at.y);
        let focus = chief * (aperture.focus / chief.dot(self.forward));
        let at = aperture.radius * warp::concentric_disc(u);
        let start = self.right * at.x + self.up * at.y;
        (self.position + start, (focus - start).normalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::SampleStream;

    /// Where rays through the middle of the image meet planes at a distance, m, across the axis.
    fn meet(aperture: Aperture, distance: f32) -> Vec<Vec2> {
        let mut camera = PerspectiveCamera::look_at(Vec3::Z, Vec3::ZERO, Vec3::Y, 10.0, 2, 2).unwrap();
        camera.aperture = Some(Arc::new(aperture));
        let at_distance = |index: u32| {
            let mut stream = SampleStream::new(1, 0, index);
            let [u, v, ..] = stream.next_4d();
            let ray = camera.sample(0, 1.0, 1.0, [u, v], || stream.next_4d());
            let at = ray.origin + ray.direction * (distance / ray.direction.dot(camera.forward));
            Vec2::new(at.x, at.y)
        };
        (0..4096).map(at_distance).collect()
    }

    #[test]
    fn what_is_out_of_focus_blurs_to_a_disc() {
        // So wide that diffraction is nothing beside it: at twice the focus the disc is as wide as the aperture
        let places = meet(Aperture::new(0.01, 0.5), 1.0);
        let mean_square = places.iter().map(|at| at.length_squared()).sum::<f32>() / 4096.0;
        assert!((mean_square / (0.5 * 0.01 * 0.01) - 1.0).abs() < 0.02, "{mean_square}");
        assert!(meet(Aperture::new(0.01, 0.5), 0.5).iter().all(|at| at.length() < 2e-3));
    }

    #[test]
    fn what_is_in_focus_blurs_to_the_airy_pattern() {
        // Its first dark ring at 1.22 wavelengths over the diameter holds 83.8 % of all, of which the table has 97.9 %
        let places = meet(Aperture::new(0.5e-3, 0.2), 0.2);
        let ring = 1.22 * 550e-9 / 1e-3 * 0.2;
        let inside = places.iter().filter(|at| at.length() < ring).count() as f32 / 4096.0;
        assert!((inside - 0.838 / 0.979).abs() < 0.01, "{inside}");
    }

    #[test]
    fn the_edges_of_the_image_span_the_field() {
        let camera = PerspectiveCamera::look_at(Vec3::Z, Vec3::ZERO, Vec3::Y, 60.0, 200, 100).unwrap();
        let (_, left) = camera.ray(0.0, 50.0);
        let (_, right) = camera.ray(200.0, 50.0);
        assert!((left.dot(right) - 60_f32.to_radians().cos()).abs() < 1e-6);
        assert!(right.x > 0.0, "looking along -z, the right of the image is +x");
        assert!(camera.ray(100.0, 0.0).1.y > 0.0);
    }

    #[test]
    fn parallel_rays_span_the_width() {
        let camera = PerspectiveCamera::look_at(Vec3::Z, Vec3::ZERO, Vec3::Y, 60.0, 200, 100).unwrap();
        let camera = PerspectiveCamera { parallel_half_width_m: Some(0.5), ..camera };
        let (corner, direction) = camera.ray(0.0, 0.0);
        assert_eq!((corner, direction), (Vec3::new(-0.5, 0.25, 1.0), Vec3::NEG_Z));
        assert_eq!(camera.view(), None);
    }

    /// The upper right quarter of an image has the rays of its pixels.
    #[test]
    fn windows_have_the_rays_of_their_pixels() {
        let whole = PerspectiveCamera::look_at(Vec3::Z, Vec3::ZERO, Vec3::Y, 60.0, 200, 100).unwrap();
        for whole in [PerspectiveCamera { parallel_half_width_m: Some(0.5), ..whole.clone() }, whole] {
            let window = PerspectiveCamera {
                tan_half_width: 0.5 * whole.tan_half_width,
                parallel_half_width_m: whole.parallel_half_width_m.map(|half| 0.5 * half),
                center: Vec2::new(1.0, 0.5),
                width: 100,
                height: 50,
                ..whole.clone()
            };
            for (x, y) in [(0.0, 0.0), (31.5, 7.5), (100.0, 50.0)] {
                let ((a, along), (b, wanted)) = (window.ray(x, y), whole.ray(100.0 + x, y));
                assert!(a.abs_diff_eq(b, 1e-6) && along.abs_diff_eq(wanted, 1e-6));
            }
            assert_eq!(window.view(), None);
        }
    }

    #[test]
    fn a_camera_that_goes_around_keeps_its_middle() {
        let eye = Vec3::new(0.0, 0.02, 0.1);
        let camera = PerspectiveCamera::look_at(eye, Vec3::ZERO, Vec3::Y, 40.0, 64, 48).unwrap();
        let middle = camera.position + 0.1 * camera.forward;
        for (yaw, pitch, zoom) in [(0.0, 0.0, 1.0), (0.7, 0.0, 1.0), (0.0, 1.2, 1.0), (-2.0, -0.4, 4.0)] {
            let turned = camera.orbited(0.1, yaw, pitch, zoom);
            assert!((turned.position + 0.1 / zoom * turned.forward - middle).length() < 1e-6);
            assert!(turned.right.dot(turned.up).abs() + turned.right.dot(turned.forward).abs() < 1e-6);
            let away = turned.position - camera.position;
            let right_and_up = (away.dot(camera.right), away.dot(camera.up));
            assert!(yaw <= 0.0 || right_and_up.0 > 0.01, "{right_and_up:?}");
            assert!(pitch <= 0.0 || right_and_up.1 > 0.01, "{right_and_up:?}");
        }
    }

    #[test]
    fn impossible_cameras_are_refused() {
        assert!(PerspectiveCamera::look_at(Vec3::ZERO, Vec3::ZERO, Vec3::Y, 60.0, 8, 8).is_none());
        assert!(PerspectiveCamera::look_at(Vec3::Y, Vec3::ZERO, Vec3::Y, 60.0, 8, 8).is_none());
        assert!(PerspectiveCamera::look_at(Vec3::Z, Vec3::ZERO, Vec3::Y, 180.0, 8, 8).is_none());
    }
}
