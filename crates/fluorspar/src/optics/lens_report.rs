//! Report on a lens: first-order data, illumination, distortion, field curvature, spots, MTF.

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use super::field_aberrations::{LandedRay, landed_rays};
use super::paraxial::Paraxial;
use super::prescription::Medium;
use super::sequential_trace::{LensRay, SequentialTrace};
use super::traced_lens::{LensState, TracedLens};

/// Heights on the film, as parts of the largest one, in tables of the field.
const FIELD_STEPS: usize = 11;
/// Heights with spots, MTF and drawn rays.
const SPOT_FIELDS: [f64; 3] = [0.0, 0.7, 1.0];
/// Rays per spot.
const SPOT_RAYS: u32 = 4096;
/// Rays per spot that are kept to be drawn.
const DRAWN_SPOT_RAYS: usize = 1024;
/// Frequencies of an MTF curve.
const FREQUENCIES: usize = 41;
/// Positions of the film in a through-focus curve.
const FOCUS_STEPS: usize = 41;
/// Drawn rays per field.
const FAN_RAYS: usize = 7;
/// Points of a drawn surface.
const OUTLINE_POINTS: usize = 41;

/// A report on a lens at one wavelength. Positions along the axis are mm from the vertex of the first surface, positive
/// toward the film; heights on the film are mm from the axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LensReport {
    /// Name of the lens.
    pub name: String,
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// Focal length, focal points, principal planes, pupils.
    pub paraxial: Paraxial,
    /// Focal length over diameter of the axial beam of a distant object.
    pub f_number: f64,
    /// `1 / (2 sin u')` on the axis.
    pub working_f_number: f64,
    /// Irradiance per radiance on the axis, sr.
    pub axial_solid_angle_sr: f64,
    /// Diameter of the aperture stop, mm.
    pub stop_diameter_mm: f64,
    /// Diameter of the entrance pupil, paraxial, mm.
    pub entrance_pupil_diameter_mm: f64,
    /// Diameter of the exit pupil, paraxial, mm.
    pub exit_pupil_diameter_mm: f64,
    /// Distance in focus from the entrance pupil at infinity, mm; none is infinity.
    pub object_distance_mm: Option<f64>,
    /// Size of the image over that of the object, negative: upside down; 0 at infinity.
    pub magnification: f64,
    /// Position of the film.
    pub film_mm: f64,
    /// Along the radius of the field, from the axis to the largest height.
    pub field: Vec<FieldPoint>,
    /// Spots on the axis, at 0.7 and at the whole of the largest height.
    pub spots: Vec<Spot>,
    /// The MTF of the spots, and through focus.
    pub mtf: MtfReport,
    /// Surfaces and rays to draw.
    pub drawing: LensDrawing,
}

/// A height on the film. What no light reaches is null.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FieldPoint {
    /// Height, mm.
    pub height_mm: f64,
    /// Angle of the chief ray to the axis in front of the lens, degrees.
    pub object_angle_deg: Option<f64>,
    /// Angle of the chief ray to the axis at the film, degrees.
    pub image_angle_deg: Option<f64>,
    /// Irradiance under a uniform field over that on the axis.
    pub relative_illumination: f64,
    /// Height over that of the paraxial image of the same object point, minus 1, percent. 0 on the axis.
    pub distortion_percent: Option<f64>,
    /// Where narrow beams around the chief ray focus in the plane of axis and film point, mm from the film.
    pub tangential_focus_mm: Option<f64>,
    /// The same across that plane, mm from the film.
    pub sagittal_focus_mm: Option<f64>,
}

/// Where the rays of one object point land.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Spot {
    /// Height of the chief ray, mm.
    pub height_mm: f64,
    /// Root mean square distance from the centroid, mm; null where no light arrives.
    pub rms_radius_mm: Option<f64>,
    /// Centroid relative to the chief ray: away from the axis and across, mm.
    pub centroid_mm: [f64; 2],
    /// Some of the rays relative to the chief ray: away from the axis and across, mm.
    pub points_mm: Vec<[f64; 2]>,
}

/// Modulation transfer: of the rays alone (geometric), and of diffraction alone.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MtfReport {
    /// Spatial frequencies on the film, cycles per mm.
    pub frequency_per_mm: Vec<f64>,
    /// MTF of a perfect lens of the same working f-number on the axis.
    pub diffraction_limit: Vec<f64>,
    /// One per spot.
    pub fields: Vec<FieldMtf>,
    /// Frequency of the through-focus curves, cycles per mm.
    pub through_focus_frequency_per_mm: f64,
    /// Positions of the film relative to where it is, mm; positive is away from the lens.
    pub focus_shift_mm: Vec<f64>,
    /// Where the sum of the through-focus curves on the axis is largest, mm from the film.
    pub best_axial_focus_mm: f64,
}

/// MTF of one height: tangential for lines across the radius of the field, sagittal for lines along it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FieldMtf {
    /// Height, mm.
    pub height_mm: f64,
    /// Geometric MTF over frequency, tangential. Empty where no light arrives, as are the others.
    pub tangential: Vec<f64>,
    /// Geometric MTF over frequency, sagittal.
    pub sagittal: Vec<f64>,
    /// Geometric MTF over the film's position, tangential.
    pub through_focus_tangential: Vec<f64>,
    /// Geometric MTF over the film's position, sagittal.
    pub through_focus_sagittal: Vec<f64>,
}

/// The lens in the plane of the axis: `[position, height]` in mm.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LensDrawing {
    /// Closed outlines of the glasses.
    pub elements: Vec<Vec<[f64; 2]>>,
    /// The upper edge of the stop's opening; the lower one is its mirror image.
    pub stop: [f64; 2],
    /// Half the clear diameter of the surface with the stop, or of the largest one beside it.
    pub stop_rim_mm: f64,
    /// Rays from the object to the film, by field; some are missing where they are blocked.
    pub fans: Vec<RayFan>,
    /// Position of the film and largest height on it.
    pub film: [f64; 2],
}

/// Rays of one film point.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RayFan {
    /// Height of the film point, mm. Drawn below the axis: the image is upside down.
    pub height_mm: f64,
    /// Points of each ray.
    pub rays: Vec<Vec<[f64; 2]>>,
}

/// Settings of a report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensReportSettings {
    /// Largest height on the film, mm; none is that of a chief ray at 20 degrees, `f tan 20° (1 + |m|)`, or less where the
    /// lens leaves less than a fifth of the light of the axis.
    pub image_height_mm: Option<f64>,
    /// Wavelength, nm; none is the design wavelength.
    pub wavelength_nm: Option<f64>,
    /// Frequency of the MTF through focus, cycles per mm; the MTF is computed up to twice this.
    pub frequency_per_mm: f64,
}

impl Default for LensReportSettings {
    fn default() -> Self {
        Self { image_height_mm: None, wavelength_nm: None, frequency_per_mm: 50.0 }
    }
}

/// Half field of a report whose image height is not given, degrees.
const DEFAULT_HALF_FIELD_DEG: f64 = 20.0;

impl LensReport {
    /// Traces everything.
    pub fn new(state: &LensState, settings: &LensReportSettings) -> Self {
        let nm = settings.wavelength_nm.unwrap_or(state.lens.design_wavelength_nm);
        let paraxial = Paraxial::new(&state.lens, nm);
        let height_mm = settings.image_height_mm.unwrap_or_else(|| default_height_mm(state, nm));
        let traced = TracedLens::new(state, nm, height_mm);
        let axial_solid_angle_sr = state.axial_solid_angle_sr(nm);
        let working_f_number = 0.5 / (axial_solid_angle_sr / PI).sqrt();
        // Trace spots
        let rays: Vec<(f64, Vec<LandedRay>)> = SPOT_FIELDS
            .into_par_iter()
            .map(|part| {
                (part * height_mm, landed_rays(&traced, state.object_mm(), part * height_mm, SPOT_RAYS))
            })
            .collect();
        // Trace illumination, distortion and foci along the field
        let field = (0..FIELD_STEPS)
            .into_par_iter()
            .map(|step| {
                let at = height_mm * step as f64 / (FIELD_STEPS - 1) as f64;
                field_point(state, &traced, axial_solid_angle_sr, at)
            })
            .collect();
        let stop = state.stop_semi_diameter_mm;
        Self {
            name: state.lens.name.clone(),
            wavelength_nm: nm,
            f_number: state.f_number_at(nm),
            working_f_number,
            axial_solid_angle_sr,
            stop_diameter_mm: 2.0 * stop,
            entrance_pupil_diameter_mm: 2.0 * (stop * paraxial.entrance_pupil_scale).abs(),
            exit_pupil_diameter_mm: 2.0 * (stop * paraxial.exit_pupil_scale).abs(),
            object_distance_mm: state.setting.object_distance_mm,
            magnification: state.magnification(),
            film_mm: state.film_mm,
            field,
            spots: rays.iter().map(|(height, rays)| spot(*height, rays)).collect(),
            mtf: mtf(&rays, nm, working_f_number, settings.frequency_per_mm),
            drawing: drawing(state, &traced, height_mm),
            paraxial,
        }
    }
}

/// Relative illumination at which the field of a lens counts as ended.
const LEAST_ILLUMINATION: f64 = 0.2;

fn default_height_mm(state: &LensState, nm: f64) -> f64 {
    let tangent = DEFAULT_HALF_FIELD_DEG.to_radians().tan();
    let widest = state.paraxial.focal_length_mm * tangent * (1.0 + state.magnification().abs());
    let lens = TracedLens::new(state, nm, widest);
    let least = LEAST_ILLUMINATION * state.axial_solid_angle_sr(nm);
    let reached =
        |height_mm: &f64| lens.solid_angle_sr(*height_mm) >= least && lens.chief_ray(*height_mm).is_some();
    (1..=20).rev().map(|step| widest * f64::from(step) / 20.0).find(reached).unwrap_or(widest)
}

fn field_point(state: &LensState, lens: &TracedLens, axial_sr: f64, height_mm: f64) -> FieldPoint {
    let chief = lens.chief_ray(height_mm);
    let foci = chief.and_then(|chief| narrow_foci(state, lens, &chief.object_side));
    let distortion = chief.and_then(|chief| {
        // The paraxial image of the object point: |m| times its height, or f times the tangent of its direction.
        let ideal = if state.object_mm().is_finite() {
            let x = chief.object_side.at_z(state.object_mm()).x;
            (state.magnification() * x).abs()
        } else {
            (state.paraxial.focal_length_mm * chief.object_tangent).abs()
        };
        // On a film that is moved the image is larger as seen from the exit pupil, and no other shape
        let to_film = state.film_mm - state.paraxial.exit_pupil_mm;
        let moved = to_film / (to_film - state.setting.film_shift_mm);
        let ideal = if to_film.is_finite() { ideal * moved } else { ideal };
        if height_mm == 0.0 { Some(0.0) } else { (ideal > 0.0).then(|| 100.0 * (height_mm / ideal - 1.0)) }
    });
    FieldPoint {
        height_mm,
        object_angle_deg: chief.map(|chief| chief.object_tangent.atan().to_degrees().abs()),
        image_angle_deg: chief.map(|chief| chief.image_tangent.atan().to_degrees()),
        relative_illumination: lens.solid_angle_sr(height_mm) / axial_sr,
        distortion_percent: distortion,
        tangential_focus_mm: foci.map(|foci| foci[0]),
        sagittal_focus_mm: foci.map(|foci| foci[1]),
    }
}

/// Foci of a narrow beam around a chief ray (given toward the object) in the plane of axis and field point and across it,
/// as positions along the axis, mm from the film.
fn narrow_foci(state: &LensState, lens: &TracedLens, toward_object: &LensRay) -> Option<[f64; 2]> {
    let trace = lens.surfaces();
    let forward = -toward_object.direction;
    // Small compared with every aperture, large compared with rounding.
    let step = 1e-4 * state.stop_semi_diameter_mm;
    let object = state.object_mm().is_finite().then(|| toward_object.at_z(state.object_mm()));
    let through = |offset: DVec3| {
        let point = toward_object.origin + offset;
        let ray = match object {
            Some(object) => LensRay::between(object, point)?,
            None => LensRay { origin: point - forward, direction: forward },
        };
        trace.forward_visiting(ray, false, |_, _| ()).ok()
    };
    let film = lens.film_mm();
    let at_film = |ray: &LensRay| (ray.at_z(film), ray.direction / ray.direction.z);
    let (above, below) = (through(DVec3::X * step)?, through(DVec3::X * -step)?);
    let ((p, u), (q, v)) = (at_film(&above), at_film(&below));
    let tangential = -(p.x - q.x) / (u.x - v.x);
    let (p, u) = at_film(&through(DVec3::Y * step)?);
    let sagittal = -p.y / u.y;
    (tangential.is_finite() && sagittal.is_finite()).then_some([tangential, sagittal])
}

fn spot(height_mm: f64, rays: &[LandedRay]) -> Spot {
    let mean = |f: &dyn Fn(&LandedRay) -> f64| rays.iter().map(|ray| ray.share * f(ray)).sum::<f64>();
    let centroid_mm = [mean(&|ray| ray.at_mm[0]), mean(&|ray| ray.at_mm[1])];
    let square =
        mean(&|ray| (ray.at_mm[0] - centroid_mm[0]).powi(2) + (ray.at_mm[1] - centroid_mm[1]).powi(2));
    let every = rays.len().div_ceil(DRAWN_SPOT_RAYS).max(1);
    Spot {
        height_mm,
        rms_radius_mm: (!rays.is_empty()).then(|| square.max(0.0).sqrt()),
        centroid_mm,
        points_mm: rays.iter().step_by(every).map(|ray| ray.at_mm).collect(),
    }
}

/// Modulus of the Fourier transform of the rays along one axis (0 tangential, 1 sagittal), the film moved by `shift_mm`.
fn geometric_mtf(rays: &[LandedRay], axis: usize, frequency_per_mm: f64, shift_mm: f64) -> f64 {
    let (mut re, mut im) = (0.0, 0.0);
    for ray in rays {
        let phase = 2.0 * PI * frequency_per_mm * (ray.at_mm[axis] + shift_mm * ray.slope[axis]);
        re += ray.share * phase.cos();
        im += ray.share * phase.sin();
    }
    re.hypot(im)
}

/// MTF of a perfect lens with a round pupil: `2/pi (acos s - s sqrt(1 - s²))`, `s = nu lambda N`.
pub fn diffraction_mtf(frequency_per_mm: f64, wavelength_nm: f64, working_f_number: f64) -> f64 {
    let s = frequency_per_mm * wavelength_nm * 1e-6 * working_f_number;
    if s >= 1.0 { 0.0 } else { 2.0 / PI * (s.acos() - s * (1.0 - s * s).sqrt()) }
}

fn mtf(fields: &[(f64, Vec<LandedRay>)], nm: f64, working_f_number: f64, frequency_per_mm: f64) -> MtfReport {
    let top = 2.0 * frequency_per_mm;
    let frequencies: Vec<f64> = (0..FREQUENCIES).map(|i| top * i as f64 / (FREQUENCIES - 1) as f64).collect();
    // A perfect beam of f-number N, moved by N / nu, spreads over one period.
    let reach = 2.0 * working_f_number / frequency_per_mm;
    let middle = (FOCUS_STEPS / 2) as f64;
    let shifts: Vec<f64> = (0..FOCUS_STEPS).map(|i| reach * (i as f64 - middle) / middle).collect();
    // Compute MTF over frequency and through focus for every field
    let curves: Vec<FieldMtf> = fields
        .par_iter()
        .map(|(height_mm, rays)| {
            let over_frequency = |axis: usize| -> Vec<f64> {
                frequencies.iter().map(|nu| geometric_mtf(rays, axis, *nu, 0.0)).collect()
            };
            let over_focus = |axis: usize| -> Vec<f64> {
                shifts.iter().map(|shift| geometric_mtf(rays, axis, frequency_per_mm, *shift)).collect()
            };
            let (t, s, tf, sf) = if rays.is_empty() {
                Default::default()
            } else {
                (over_frequency(0), over_frequency(1), over_focus(0), over_focus(1))
            };
            FieldMtf {
                height_mm: *height_mm,
                tangential: t,
                sagittal: s,
                through_focus_tangential: tf,
                through_focus_sagittal: sf,
            }
        })
        .collect();
    let on_axis = curves.first().map(|c| (&c.through_focus_tangential, &c.through_focus_sagittal));
    // Find the best focus on the axis
    let best = on_axis.map_or(0.0, |(t, s)| {
        let sums = t.iter().zip(s).map(|(t, s)| t + s);
        let best = sums.enumerate().fold((0, f64::MIN), |a, b| if b.1 > a.1 { b } else { a });
        shifts[best.0]
    });
    MtfReport {
        diffraction_limit: frequencies.iter().map(|nu| diffraction_mtf(*nu, nm, working_f_number)).collect(),
        frequency_per_mm: frequencies,
        fields: curves,
        through_focus_frequency_per_mm: frequency_per_mm,
        focus_shift_mm: shifts,
        best_axial_focus_mm: best,
    }
}

fn drawing(state: &LensState, traced: &TracedLens, height_mm: f64) -> LensDrawing {
    let surfaces = &state.lens.surfaces;
    let positions: Vec<f64> = surfaces
        .iter()
        .scan(0.0, |z, surface| {
            let vertex = *z;
            *z += surface.thickness_mm;
            Some(vertex)
        })
        .collect();
    let mut elements = Vec::new();
    for (index, pair) in surfaces.windows(2).enumerate() {
        if pair[0].medium == Medium::Air {
            continue;
        }
        // Prescriptions with assumed diameters may have faces that cross near the rim: there the glass ends.
        let apart = |y: f64| -> Option<bool> {
            let (front, rear) = (pair[0].sag(y * y)?.0, pair[1].sag(y * y)?.0);
            Some(positions[index] + front <= positions[index + 1] + rear)
        };
        let wider = pair[0].semi_diameter_mm.max(pair[1].semi_diameter_mm);
        let heights = (1..=200).map(|i| wider * f64::from(i) / 200.0);
        let edge = heights.take_while(|y| apart(*y) != Some(false)).last().unwrap_or(wider);
        let face = |number: usize, upwards: bool| {
            let surface = &surfaces[number];
            let last = OUTLINE_POINTS - 1;
            let mut points: Vec<[f64; 2]> = (0..=last)
                .map(|i| (2.0 * i as f64 / last as f64 - 1.0) * surface.semi_diameter_mm.min(edge))
                .filter_map(|y| Some([positions[number] + surface.sag(y * y)?.0, y]))
                .collect();
            // Flat rims where the other face of the element is larger.
            if let (Some(first), Some(end)) = (points.first().copied(), points.last().copied())
                && surface.semi_diameter_mm < edge
            {
                points.insert(0, [first[0], -edge]);
                points.push([end[0], edge]);
            }
            if !upwards {
                points.reverse();
            }
            points
        };
        let mut outline = face(index, true);
        outline.extend(face(index + 1, false));
        elements.push(outline);
    }
    let stop = state.lens.stop();
    let beside = surfaces[stop.saturating_sub(1)..(stop + 2).min(surfaces.len())].iter();
    let rim = beside.map(|surface| surface.semi_diameter_mm).fold(0.0_f64, f64::max);
    let sag = surfaces[stop].sag(state.stop_semi_diameter_mm.powi(2)).map_or(0.0, |sag| sag.0);
    let length = state.film_mm;
    let start = -0.35 * length;
    let fans = SPOT_FIELDS
        .iter()
        .map(|part| RayFan {
            height_mm: part * height_mm,
            rays: fan(traced.surfaces(), traced, part * height_mm, start),
        })
        .collect();
    LensDrawing {
        elements,
        stop: [positions[stop] + sag, state.stop_semi_diameter_mm],
        stop_rim_mm: rim,
        fans,
        film: [state.film_mm, height_mm],
    }
}

/// Rays in the plane of the axis from a film point below it, evenly over what passes, as points from `start_mm` to the film.
fn fan(trace: &SequentialTrace, lens: &TracedLens, height_mm: f64, start_mm: f64) -> Vec<Vec<[f64; 2]>> {
    let film = DVec3::new(-height_mm, 0.0, lens.film_mm());
    let rear = trace.last_vertex_mm();
    let Some(reach) = trace.largest_semi_diameter_mm() else { return Vec::new() };
    let ray_to = |x: f64| LensRay::between(film, DVec3::new(x, 0.0, rear));
    let passes = |x: f64| ray_to(x).is_some_and(|ray| trace.backward(ray).is_ok());
    let all: Vec<f64> =
        (0..=1000).map(|i| reach * (f64::from(i) / 500.0 - 1.0)).filter(|x| passes(*x)).collect();
    let (Some(low), Some(high)) = (all.first(), all.last()) else { return Vec::new() };
    let mut rays = Vec::new();
    for i in 0..FAN_RAYS {
        let x = low + (high - low) * i as f64 / (FAN_RAYS - 1) as f64;
        let Some(out) = ray_to(x).and_then(|ray| trace.backward(ray).ok()) else { continue };
        let begin = out.at_z(start_mm.min(out.origin.z));
        let forward = LensRay { origin: begin, direction: -out.direction };
        let mut points = vec![[begin.z, begin.x]];
        let visited = trace.forward_visiting(forward, false, |_, at| points.push([at.z, at.x]));
        if visited.is_ok() {
            points.push([film.z, film.x]);
            rays.push(points);
        }
    }
    rays
}
