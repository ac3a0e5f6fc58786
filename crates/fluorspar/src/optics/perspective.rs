//! The pinhole camera that samples the radiance field.

use glam::Vec3;

use crate::image::View;

/// A perspective (pinhole) camera: records radiance, not irradiance.
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
        })
    }

    /// What a file of its images keeps of the camera.
    pub fn view(&self) -> View {
        View {
            position_m: self.position.to_array(),
            forward: self.forward.to_array(),
            right: self.right.to_array(),
            tan_half_width: self.tan_half_width,
        }
    }

    /// Origin and unit direction through image coordinates in pixels: x from the left, y from the top.
    pub fn ray(&self, x: f32, y: f32) -> (Vec3, Vec3) {
        let scale = 2.0 * self.tan_half_width / self.width as f32;
        let dx = (x - 0.5 * self.width as f32) * scale;
        let dy = (0.5 * self.height as f32 - y) * scale;
        (self.position, (self.forward + self.right * dx + self.up * dy).normalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn impossible_cameras_are_refused() {
        assert!(PerspectiveCamera::look_at(Vec3::ZERO, Vec3::ZERO, Vec3::Y, 60.0, 8, 8).is_none());
        assert!(PerspectiveCamera::look_at(Vec3::Y, Vec3::ZERO, Vec3::Y, 60.0, 8, 8).is_none());
        assert!(PerspectiveCamera::look_at(Vec3::Z, Vec3::ZERO, Vec3::Y, 180.0, 8, 8).is_none());
    }
}
