//! First-order optics: focal length, principal planes, pupils.

use serde::Serialize;

use super::prescription::LensPrescription;

/// First-order properties of a lens in air at one wavelength. Positions are measured along the axis from the vertex
/// of the first surface, positive toward the image, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Paraxial {
    /// Effective focal length, mm; infinite for an afocal system.
    pub focal_length_mm: f64,
    /// Distance from the last vertex to the rear focal point, mm.
    pub back_focal_length_mm: f64,
    /// Position of the front focal point.
    pub front_focus_mm: f64,
    /// Position of the rear focal point.
    pub rear_focus_mm: f64,
    /// Position of the front principal plane.
    pub front_principal_mm: f64,
    /// Position of the rear principal plane.
    pub rear_principal_mm: f64,
    /// Position of the last vertex.
    pub last_vertex_mm: f64,
    /// Position of the entrance pupil; infinite if the lens is telecentric in the object space.
    pub entrance_pupil_mm: f64,
    /// Radius of the entrance pupil per radius of the stop.
    pub entrance_pupil_scale: f64,
    /// Position of the exit pupil; infinite if the lens is telecentric in the image space.
    pub exit_pupil_mm: f64,
    /// Radius of the exit pupil per radius of the stop.
    pub exit_pupil_scale: f64,
}

/// A ray transfer matrix `[[a, b], [c, d]]` on (height, optical direction cosine `n u`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Matrix {
    pub(super) a: f64,
    pub(super) b: f64,
    pub(super) c: f64,
    pub(super) d: f64,
}

impl Matrix {
    pub(super) const IDENTITY: Self = Self { a: 1.0, b: 0.0, c: 0.0, d: 1.0 };

    /// This, then `next`.
    pub(super) fn then(self, next: Self) -> Self {
        Self {
            a: next.a * self.a + next.b * self.c,
            b: next.a * self.b + next.b * self.d,
            c: next.c * self.a + next.d * self.c,
            d: next.c * self.b + next.d * self.d,
        }
    }

    fn refraction(power: f64) -> Self {
        Self { c: -power, ..Self::IDENTITY }
    }

    fn transfer(reduced: f64) -> Self {
        Self { b: reduced, ..Self::IDENTITY }
    }
}

/// Matrix from just before surface `from` to just behind the last of `from..to`, distances between them included.
fn matrix(lens: &LensPrescription, from: usize, to: usize, wavelength_nm: f64) -> Matrix {
    let mut before = if from == 0 { 1.0 } else { lens.index_behind(from - 1, wavelength_nm) };
    let mut total = Matrix::IDENTITY;
    for index in from..to {
        let behind = lens.index_behind(index, wavelength_nm);
        let power = (behind - before) * lens.surfaces[index].curvature_per_mm;
        total = total.then(Matrix::refraction(power));
        if index + 1 < to {
            total = total.then(Matrix::transfer(lens.surfaces[index].thickness_mm / behind));
        }
        before = behind;
    }
    total
}

impl Paraxial {
    /// First-order properties at a wavelength.
    pub fn new(lens: &LensPrescription, wavelength_nm: f64) -> Self {
        let count = lens.surfaces.len();
        let last_vertex_mm: f64 = lens.surfaces[..count - 1].iter().map(|s| s.thickness_mm).sum();
        let all = matrix(lens, 0, count, wavelength_nm);
        let focal_length_mm = -1.0 / all.c;
        let back_focal_length_mm = -all.a / all.c;
        let front_focus_mm = all.d / all.c;
        let rear_focus_mm = last_vertex_mm + back_focal_length_mm;

        let stop = lens.stop();
        let in_front = if stop == 0 { 1.0 } else { lens.index_behind(stop - 1, wavelength_nm) };
        // From the first surface to the plane of the stop.
        let mut front = matrix(lens, 0, stop, wavelength_nm);
        if stop > 0 {
            front = front.then(Matrix::transfer(lens.surfaces[stop - 1].thickness_mm / in_front));
        }
        // Rays through the middle of the stop: a y + b nu = 0, so they cross the axis at y / -u = b / a in front of ...
        let entrance_pupil_mm = front.b / front.a;
        // Height at the pupil of a ray of unit height at the stop that is parallel to one through its middle: the stop
        // is the image of the pupil with the magnification a - (what b adds), which for conjugates is 1 / a.
        let entrance_pupil_scale = 1.0 / front.a;
        // From just before the stop surface to behind the last one.
        let rear = matrix(lens, stop, count, wavelength_nm);
        // A ray from the middle of the stop leaves with y = b, n u = d and crosses the axis at -y / u.
        let exit_pupil_mm = last_vertex_mm - rear.b / rear.d;
        // Conjugate planes: height magnification is 1 / d when the object is at the stop (n u in units of the stop side).
        let exit_pupil_scale = 1.0 / rear.d;
        Self {
            focal_length_mm,
            back_focal_length_mm,
            front_focus_mm,
            rear_focus_mm,
            front_principal_mm: front_focus_mm + focal_length_mm,
            rear_principal_mm: rear_focus_mm - focal_length_mm,
            last_vertex_mm,
            entrance_pupil_mm,
            entrance_pupil_scale,
            exit_pupil_mm,
            exit_pupil_scale,
        }
    }

    /// Position of the image of an axial point at `object_mm` (negative: in front of the first vertex; infinite
    /// allowed), by Newton's equation `x x' = -f²`. `None` where the image is virtual or at infinity.
    pub fn image_position_mm(&self, object_mm: f64) -> Option<f64> {
        if object_mm.is_infinite() {
            return (self.focal_length_mm > 0.0).then_some(self.rear_focus_mm);
        }
        let x = object_mm - self.front_focus_mm;
        let image = self.rear_focus_mm - self.focal_length_mm * self.focal_length_mm / x;
        (x < 0.0 && image.is_finite()).then_some(image)
    }

    /// Transverse magnification of an object at `object_mm`: `f / x`, negative for a real image.
    pub fn magnification(&self, object_mm: f64) -> f64 {
        if object_mm.is_infinite() { 0.0 } else { self.focal_length_mm / (object_mm - self.front_focus_mm) }
    }
}

#[cfg(test)]
mod tests {
    use super::super::glass::Dispersion;
    use super::super::prescription::LensSurface;
    use super::*;

    /// A thick biconvex singlet behind a stop.
    fn thick() -> (LensPrescription, f64, f64, f64, f64) {
        let (r1, r2, t, n) = (40.0, -60.0, 7.0, 1.6);
        let lens = LensPrescription::new(
            "thick",
            vec![
                LensSurface::stop(5.0, 2.0),
                LensSurface::spherical(r1, t, 10.0).with_medium(Dispersion::Constant { index: n }),
                LensSurface::spherical(r2, 0.0, 10.0),
            ],
        );
        (lens, r1, r2, t, n)
    }

    #[test]
    fn a_thick_lens_follows_the_lensmakers_equation() {
        let (lens, r1, r2, t, n) = thick();
        let p = Paraxial::new(&lens, 550.0);
        let power = (n - 1.0) * (1.0 / r1 - 1.0 / r2 + (n - 1.0) * t / (n * r1 * r2));
        let f = 1.0 / power;
        let bfl = f * (1.0 - (n - 1.0) * t / (n * r1));
        assert!((p.focal_length_mm / f - 1.0).abs() < 1e-9);
        assert!((p.back_focal_length_mm / bfl - 1.0).abs() < 1e-9);
        // Principal planes of a thick lens, from its vertices.
        let h1 = -f * (n - 1.0) * t / (n * r2);
        let h2 = -f * (n - 1.0) * t / (n * r1);
        assert!((p.front_principal_mm - (5.0 + h1)).abs() < 1e-9);
        assert!((p.rear_principal_mm - (12.0 + h2)).abs() < 1e-9);
        // The stop is in front: it is the entrance pupil. Its image follows the lens equation.
        assert!(p.entrance_pupil_mm.abs() < 1e-12 && (p.entrance_pupil_scale - 1.0).abs() < 1e-12);
        let object = -p.front_principal_mm; // distance of the stop from the front principal plane
        let image = 1.0 / (1.0 / f + 1.0 / object);
        assert!((p.exit_pupil_mm - (p.rear_principal_mm + image)).abs() < 1e-9);
        assert!((p.exit_pupil_scale - image / object).abs() < 1e-9);
    }

    #[test]
    fn a_stop_behind_is_seen_through_the_lens() {
        let (mut lens, ..) = thick();
        lens.surfaces.rotate_left(1);
        lens.surfaces[1].thickness_mm = 5.0;
        let p = Paraxial::new(&lens, 550.0);
        assert!((p.exit_pupil_mm - 12.0).abs() < 1e-12 && (p.exit_pupil_scale - 1.0).abs() < 1e-12);
        let object = 12.0 - p.rear_principal_mm;
        let image = 1.0 / (1.0 / object - 1.0 / p.focal_length_mm);
        assert!((p.entrance_pupil_mm - (p.front_principal_mm + image)).abs() < 1e-9);
        assert!((p.entrance_pupil_scale - image / object).abs() < 1e-9);
    }

    #[test]
    fn newtons_equation_agrees_with_the_lens_equation() {
        let (lens, ..) = thick();
        let p = Paraxial::new(&lens, 550.0);
        let object = -300.0;
        let (s, f) = (p.front_principal_mm - object, p.focal_length_mm);
        let image = p.image_position_mm(object).unwrap();
        assert!((1.0 / s + 1.0 / (image - p.rear_principal_mm) - 1.0 / f).abs() < 1e-12);
        assert!((p.magnification(object) + (image - p.rear_principal_mm) / s).abs() < 1e-12);
        assert!(p.image_position_mm(p.front_focus_mm + 1.0).is_none());
        assert_eq!(p.image_position_mm(f64::NEG_INFINITY), Some(p.rear_focus_mm));
    }
}
