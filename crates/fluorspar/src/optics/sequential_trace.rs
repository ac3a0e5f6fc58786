//! Exact rays through the surfaces of a lens, one after the other.

use glam::DVec3;

use super::prescription::{LensPrescription, sag};

/// A ray in the frame of a lens, mm: the axis is z, light goes from the object at negative z to the image; the vertex of
/// the first surface is the origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensRay {
    /// A point of the ray.
    pub origin: DVec3,
    /// Unit direction.
    pub direction: DVec3,
}

impl LensRay {
    /// The ray from one point to another; `None` when they coincide.
    pub fn between(from: DVec3, to: DVec3) -> Option<Self> {
        (to - from).try_normalize().map(|direction| Self { origin: from, direction })
    }

    /// Point at a position along the axis; meaningless for rays across the axis.
    pub fn at_z(&self, z_mm: f64) -> DVec3 {
        self.origin + self.direction * ((z_mm - self.origin.z) / self.direction.z)
    }
}

#[derive(Clone, Debug, PartialEq)]
struct TracedSurface {
    z: f64,
    curvature: f64,
    conic: f64,
    aspheric: Vec<f64>,
    semi_diameter2: f64,
    index_in_front: f64,
    index_behind: f64,
}

/// Surfaces with the indices of one wavelength, ready for rays.
#[derive(Clone, Debug, PartialEq)]
pub struct SequentialTrace {
    surfaces: Vec<TracedSurface>,
    stop: usize,
}

/// Why a ray does not pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blocked {
    /// It misses the surface with this index.
    Misses(usize),
    /// It meets the surface with this index outside of its clear aperture.
    Vignetted(usize),
    /// It is totally reflected at the surface with this index.
    TotalReflection(usize),
}

/// Steps of Newton's method on an aspheric surface; five suffice on those of real lenses.
const NEWTON_STEPS: usize = 20;
/// Distance from an aspheric surface that counts as on it, mm.
const ON_SURFACE_MM: f64 = 1e-11;

impl SequentialTrace {
    /// Prepares a lens at one wavelength. The stop's semi-diameter is `stop_semi_diameter_mm`.
    pub fn new(lens: &LensPrescription, wavelength_nm: f64, stop_semi_diameter_mm: f64) -> Self {
        let stop = lens.stop();
        let (mut z, mut index_in_front) = (0.0, 1.0);
        let mut surfaces = Vec::with_capacity(lens.surfaces.len());
        for (index, surface) in lens.surfaces.iter().enumerate() {
            let index_behind = lens.index_behind(index, wavelength_nm);
            let semi_diameter = if index == stop { stop_semi_diameter_mm } else { surface.semi_diameter_mm };
            let keep = surface.aspheric.iter().rposition(|a| *a != 0.0).map_or(0, |last| last + 1);
            surfaces.push(TracedSurface {
                z,
                curvature: surface.curvature_per_mm,
                conic: surface.conic,
                aspheric: surface.aspheric[..keep].to_vec(),
                semi_diameter2: semi_diameter * semi_diameter,
                index_in_front,
                index_behind,
            });
            z += surface.thickness_mm;
            index_in_front = index_behind;
        }
        Self { surfaces, stop }
    }

    /// Number of surfaces.
    pub fn len(&self) -> usize {
        self.surfaces.len()
    }

    /// Whether there are no surfaces.
    pub fn is_empty(&self) -> bool {
        self.surfaces.is_empty()
    }

    /// Position of the stop.
    pub fn stop_mm(&self) -> f64 {
        self.surfaces[self.stop].z
    }

    /// Position of the last surface.
    pub(super) fn last_vertex_mm(&self) -> f64 {
        self.surfaces.last().map_or(0.0, |surface| surface.z)
    }

    /// Largest of all clear apertures, as a radius; none without surfaces.
    pub(super) fn largest_semi_diameter_mm(&self) -> Option<f64> {
        self.surfaces.iter().map(|surface| surface.semi_diameter2.sqrt()).reduce(f64::max)
    }

    /// From the object to the image: the ray behind the last surface.
    ///
    /// # Errors
    /// Where and why the ray is blocked.
    pub fn forward(&self, ray: LensRay) -> Result<LensRay, Blocked> {
        self.forward_visiting(ray, true, |_, _| ())
    }

    /// From the object to the image, telling each point on a surface to `visit`. Without `clip` the clear apertures are
    /// ignored.
    ///
    /// # Errors
    /// Where and why the ray is blocked.
    pub fn forward_visiting(
        &self,
        mut ray: LensRay,
        clip: bool,
        mut visit: impl FnMut(usize, DVec3),
    ) -> Result<LensRay, Blocked> {
        for (index, surface) in self.surfaces.iter().enumerate() {
            let ratio = surface.index_in_front / surface.index_behind;
            ray = surface.refract(ray, ratio, index, clip)?;
            visit(index, ray.origin);
        }
        Ok(ray)
    }

    /// From the image to the object: the ray in front of the first surface. Paths of light can be reversed.
    ///
    /// # Errors
    /// Where and why the ray is blocked.
    pub fn backward(&self, ray: LensRay) -> Result<LensRay, Blocked> {
        self.reversed(ray, true)
    }

    /// As [`SequentialTrace::backward`], clear apertures ignored.
    ///
    /// # Errors
    /// Where and why the ray is blocked.
    pub fn backward_unclipped(&self, ray: LensRay) -> Result<LensRay, Blocked> {
        self.reversed(ray, false)
    }

    fn reversed(&self, mut ray: LensRay, clip: bool) -> Result<LensRay, Blocked> {
        for (index, surface) in self.surfaces.iter().enumerate().rev() {
            let ratio = surface.index_behind / surface.index_in_front;
            ray = surface.refract(ray, ratio, index, clip)?;
        }
        Ok(ray)
    }

    /// Point of the stop's plane that a ray from the object reaches, clear apertures ignored.
    ///
    /// # Errors
    /// Where and why the ray is blocked.
    pub fn to_stop(&self, mut ray: LensRay) -> Result<DVec3, Blocked> {
        for (index, surface) in self.surfaces[..self.stop].iter().enumerate() {
            let ratio = surface.index_in_front / surface.index_behind;
            ray = surface.refract(ray, ratio, index, false)?;
        }
        Ok(ray.at_z(self.stop_mm()))
    }

    /// Point of the stop's plane that a ray from the image reaches, clear apertures ignored.
    ///
    /// # Errors
    /// Where and why the ray is blocked.
    pub fn to_stop_backward(&self, mut ray: LensRay) -> Result<DVec3, Blocked> {
        for index in (self.stop + 1..self.surfaces.len()).rev() {
            let surface = &self.surfaces[index];
            let ratio = surface.index_behind / surface.index_in_front;
            ray = surface.refract(ray, ratio, index, false)?;
        }
        Ok(ray.at_z(self.stop_mm()))
    }
}

impl TracedSurface {
    /// Carries a ray onto the surface and refracts it. `ratio` is the index on the side it comes from over the other.
    fn refract(&self, ray: LensRay, ratio: f64, index: usize, clip: bool) -> Result<LensRay, Blocked> {
        let (point, slope) = self.intersect(&ray).ok_or(Blocked::Misses(index))?;
        let r2 = point.x * point.x + point.y * point.y;
        if clip && r2 > self.semi_diameter2 {
            return Err(Blocked::Vignetted(index));
        }
        let origin = DVec3::new(point.x, point.y, point.z + self.z);
        if ratio == 1.0 {
            return Ok(LensRay { origin, direction: ray.direction });
        }
        // The gradient of z - sag; it points along the axis.
        let normal = DVec3::new(-2.0 * slope * point.x, -2.0 * slope * point.y, 1.0).normalize();
        let cosine = ray.direction.dot(normal);
        let normal = if cosine < 0.0 { -normal } else { normal };
        let cosine = cosine.abs();
        let root2 = 1.0 - ratio * ratio * (1.0 - cosine * cosine);
        if root2 < 0.0 {
            return Err(Blocked::TotalReflection(index));
        }
        // Snell's law in vectors: t = r d + (sqrt(1 - r² (1 - cos²)) - r cos) n.
        let direction = ray.direction * ratio + normal * (root2.sqrt() - ratio * cosine);
        Ok(LensRay { origin, direction: direction.normalize() })
    }

    /// Point of the surface, relative to its vertex, and the derivative of the sag with respect to r² there.
    fn intersect(&self, ray: &LensRay) -> Option<(DVec3, f64)> {
        let d = ray.direction;
        if d.z == 0.0 {
            return None;
        }
        // Start in the vertex plane: the numbers stay small however far the object is.
        let p = ray.at_z(self.z) - DVec3::new(0.0, 0.0, self.z);
        let k = 1.0 + self.conic;
        let c = self.curvature;
        // c (x² + y² + k z²) = 2 z; of both roots the one nearer to the vertex.
        let qa = c * (d.x * d.x + d.y * d.y + k * d.z * d.z);
        let qb = c * (p.x * d.x + p.y * d.y) - d.z;
        let qc = c * (p.x * p.x + p.y * p.y);
        let root2 = qb * qb - qa * qc;
        if root2 < 0.0 {
            return None;
        }
        let t = qc / (-qb + root2.sqrt().copysign(d.z));
        let mut point = p + d * t;
        if self.aspheric.is_empty() {
            let inner = 1.0 - k * c * point.z;
            // Beyond the equator of the conic the other half begins.
            return (inner > 0.0).then_some((point, 0.5 * c / inner));
        }
        for _ in 0..NEWTON_STEPS {
            let r2 = point.x * point.x + point.y * point.y;
            let (z, slope) = sag(c, self.conic, &self.aspheric, r2)?;
            let miss = point.z - z;
            if miss.abs() < ON_SURFACE_MM {
                return Some((point, slope));
            }
            let rate = d.z - 2.0 * slope * (point.x * d.x + point.y * d.y);
            if rate.abs() < 1e-9 {
                return None;
            }
            point -= d * (miss / rate);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::super::glass::Dispersion;
    use super::super::paraxial::Paraxial;
    use super::super::prescription::LensSurface;
    use super::*;

    fn parallel(height: f64) -> LensRay {
        LensRay { origin: DVec3::new(0.0, height, -10.0), direction: DVec3::Z }
    }

    /// Where a ray crosses the axis.
    fn crossing(ray: LensRay) -> f64 {
        ray.origin.z - ray.origin.y * ray.direction.z / ray.direction.y
    }

    fn singlet() -> LensPrescription {
        LensPrescription::new(
            "singlet",
            vec![
                LensSurface::spherical(40.0, 6.0, 12.0).with_medium(Dispersion::Constant { index: 1.6 }),
                LensSurface { is_stop: true, ..LensSurface::spherical(-70.0, 0.0, 12.0) },
            ],
        )
    }

    #[test]
    fn rays_near_the_axis_are_paraxial() {
        let lens = singlet();
        let trace = SequentialTrace::new(&lens, 550.0, 12.0);
        let focus = Paraxial::new(&lens, 550.0).rear_focus_mm;
        // The departure grows with the square of the height: at 1 um it is far below 1e-9.
        let at = crossing(trace.forward(parallel(1e-3)).unwrap());
        assert!((at / focus - 1.0).abs() < 1e-8, "{at} {focus}");
        let defect = |h: f64| crossing(trace.forward(parallel(h)).unwrap()) - focus;
        assert!((defect(2.0) / defect(1.0) - 4.0).abs() < 0.02, "spherical aberration is quadratic");
    }

    #[test]
    fn light_can_be_reversed() {
        let trace = SequentialTrace::new(&singlet(), 550.0, 12.0);
        let ray = LensRay::between(DVec3::new(3.0, -5.0, -200.0), DVec3::new(2.0, 6.0, 0.0)).unwrap();
        let out = trace.forward(ray).unwrap();
        let back = trace.backward(LensRay { origin: out.at_z(60.0), direction: -out.direction }).unwrap();
        assert!((back.direction + ray.direction).length() < 1e-12);
        assert!((back.at_z(-200.0) - ray.origin).length() < 1e-9);
    }

    #[test]
    fn a_hyperboloid_behind_a_plane_is_free_of_spherical_aberration() {
        // Descartes: k = -n² on the rear face of a plano-convex lens.
        let n = 1.5;
        let rear = LensSurface { conic: -n * n, is_stop: true, ..LensSurface::spherical(-25.0, 0.0, 20.0) };
        let lens = LensPrescription::new(
            "hyperboloid",
            vec![LensSurface::spherical(0.0, 8.0, 20.0).with_medium(Dispersion::Constant { index: n }), rear],
        );
        let trace = SequentialTrace::new(&lens, 550.0, 20.0);
        for height in [0.01, 1.0, 5.0, 12.0, 19.0] {
            let at = crossing(trace.forward(parallel(height)).unwrap());
            assert!((at - (8.0 + 25.0 / (n - 1.0))).abs() < 1e-9, "{height}: {at}");
        }
    }

    #[test]
    fn a_polynomial_surface_equals_the_sphere_that_it_expands() {
        // r²/2R + r^4/8R³ + r^6/16R^5 + 5 r^8/128R^7 + 7 r^10/256 R^9 around a paraboloid (k = -1, no further terms).
        let r: f64 = 30.0;
        let terms = [(1.0, 8.0, 3), (1.0, 16.0, 5), (5.0, 128.0, 7), (7.0, 256.0, 9), (21.0, 1024.0, 11)];
        let aspheric: Vec<f64> = terms.iter().map(|&(a, b, p)| a / b / r.powi(p)).collect();
        let of = |surface: LensSurface| {
            let surface =
                LensSurface { is_stop: true, ..surface }.with_medium(Dispersion::Constant { index: 1.6 });
            let lens = LensPrescription::new("one", vec![surface, LensSurface::spherical(0.0, 0.0, 20.0)]);
            SequentialTrace::new(&lens, 550.0, 20.0)
        };
        let sphere = of(LensSurface::spherical(r, 5.0, 20.0));
        let series = of(LensSurface { conic: -1.0, aspheric, ..LensSurface::spherical(r, 5.0, 20.0) });
        let ray = LensRay::between(DVec3::new(1.0, 2.0, -90.0), DVec3::new(2.0, 3.0, 0.0)).unwrap();
        let (a, b) = (sphere.forward(ray).unwrap(), series.forward(ray).unwrap());
        // The next term of the series is 33/2048 r^14 / R^13: 1e-10 mm at this height.
        assert!((a.origin - b.origin).length() < 1e-8 && (a.direction - b.direction).length() < 1e-8);
    }

    #[test]
    fn blocked_rays_say_where() {
        let trace = SequentialTrace::new(&singlet(), 550.0, 3.0);
        assert_eq!(trace.forward(parallel(13.0)), Err(Blocked::Vignetted(0)));
        assert_eq!(trace.forward(parallel(5.0)), Err(Blocked::Vignetted(1)));
        assert_eq!(trace.forward(parallel(50.0)), Err(Blocked::Misses(0)));
        let steep = LensPrescription::new(
            "steep",
            vec![
                LensSurface::spherical(0.0, 5.0, 20.0).with_medium(Dispersion::Constant { index: 1.8 }),
                LensSurface { is_stop: true, ..LensSurface::spherical(-10.0, 0.0, 9.9) },
            ],
        );
        let trace = SequentialTrace::new(&steep, 550.0, 9.9);
        assert_eq!(trace.forward(parallel(8.0)), Err(Blocked::TotalReflection(1)));
    }
}
