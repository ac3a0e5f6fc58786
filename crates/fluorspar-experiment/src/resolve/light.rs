//! Lights with absolute spectra.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::Vec3;

use super::context::{Context, LENGTH_MM, Resolved, STRENGTH};
use super::spectrum::{Role, gray};
use crate::error::{Place, steps};
use crate::schema::{
    Aim, AnnulusLight, DistantStrength, EmitterSection, EnvironmentMapReference, EnvironmentStrength,
    FilePath, LightFrame, LightSection, NameOrTable, RectangleLight, RingLight, SourceStrength,
    SpectrumReference, SpotLight,
};
use fluorspar::geometry::OrientedPoint;
use fluorspar::light::{
    AnnulusEmitter, DiscEmitter, DistantEmitter, Emitter, EnvironmentLayer, EnvironmentMap, Light,
    LightGroup, LightName, PointEmitter, PointPattern, RectangleEmitter, SphereEmitter, SpotCone,
};
use fluorspar::optics::PerspectiveCamera;
use fluorspar::spectral::{Curve, MAX_WAVELENGTH_NM, MIN_WAVELENGTH_NM, Radiance, WavelengthGrid};
use fluorspar_format::{Transfer, read_spectral_image, read_texture_png};

/// Half angle of the narrowest pattern that a light may have.
const NARROWEST_DEG: f64 = 2.2;
/// Least angle of a cone, degrees.
const LEAST_CONE_DEG: f64 = 0.01;

/// Emitters of one section, the power of each still to be found.
struct Emitters {
    center: Vec3,
    axis: Vec3,
    list: Vec<Emitter>,
}

impl Emitters {
    /// Light from all directions.
    fn everywhere(emitter: Emitter) -> Self {
        Self { center: Vec3::ZERO, axis: Vec3::NEG_Z, list: vec![emitter] }
    }
}

/// How strong a light is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Strength {
    Source(SourceStrength),
    Distant(DistantStrength),
    Environment(EnvironmentStrength),
    /// As its map says.
    OfMap,
}

/// Number of a light group, which is created when it is new.
pub(super) fn group_index(groups: &mut Vec<LightGroup>, name: &str) -> usize {
    groups.iter().position(|group| group.name == name).unwrap_or_else(|| {
        groups.push(LightGroup { name: name.into() });
        groups.len() - 1
    })
}

/// All lights of the sections.
pub(super) fn lights(
    context: &mut Context<'_>,
    sections: &[LightSection],
    camera: &PerspectiveCamera,
    grid: &WavelengthGrid,
    groups: &mut Vec<LightGroup>,
) -> Resolved<Vec<Light>> {
    let mut lights = Vec::new();
    for (index, section) in sections.iter().enumerate() {
        let at = steps!["light", index];
        context.unique_name(&at, &section.name, sections[..index].iter().map(|other| other.name.as_str()))?;
        let group_name = section.group.as_deref().unwrap_or(&section.name);
        if group_name.is_empty() {
            return context.fail(&at.field("group"), "a light group needs a name");
        }
        let (emitters, strength) = emitters(context, &at, &section.emitter, camera)?;
        let spectrum = absolute_spectrum(context, &at, section, &emitters, strength, grid)?;
        let group = group_index(groups, group_name);
        let crossed_polarizers = section.crossed_polarizers;
        if crossed_polarizers && emitters.list.iter().any(is_everywhere) {
            let message = "light from all directions has no polarizer; give it to a light with a place, or leave it out";
            return context.fail(&at.field("crossed_polarizers"), message);
        }
        let single = emitters.list.len() == 1;
        for (number, emitter) in emitters.list.into_iter().enumerate() {
            let name = match single {
                true => section.name.as_str().into(),
                false => LightName::of_emitter(&section.name, number),
            };
            lights.push(Light { name, group, spectrum: spectrum.clone(), crossed_polarizers, emitter });
        }
    }
    Ok(lights)
}

/// Whether a light has no place.
fn is_everywhere(emitter: &Emitter) -> bool {
    matches!(emitter, Emitter::Environment | Emitter::EnvironmentMap(_))
}

/// The spectral map of an environment.
fn spectral_map(
    context: &mut Context<'_>,
    at: &Place,
    reference: &EnvironmentMapReference,
) -> Resolved<EnvironmentMap> {
    let file = map_file(
        context,
        at,
        reference,
        &["exr", "npy"],
        "a spectral map is an .exr or .npy file; save it as one",
    )?;
    let image = read_spectral_image::<Radiance>(file.as_ref()).map_err(|e| context.file_error(at, &e))?.image;
    if image.bands() > MOST_MAP_BANDS {
        let message =
            format!("the map has {} bands, more than {MOST_MAP_BANDS}; average some of them", image.bands());
        return context.fail(at, message);
    }
    let layers = (0..image.bands())
        .map(|band| {
            let edges = &image.grid().edges_nm()[band..band + 2];
            let factors: Vec<f32> = image.data().iter().skip(band).step_by(image.bands()).copied().collect();
            EnvironmentLayer { spectrum: bin_curve(edges[0], edges[1]), factors }
        })
        .filter(|layer| layer.factors.iter().any(|v| *v != 0.0))
        .collect();
    EnvironmentMap::new(image.width(), image.height(), layers, reference.rotation_deg())
        .map_err(|error| context.error(at, error.to_string()))
}

/// Share of its irradiance as a point that a light gives where it is near.
const NEAREST_SHARE: f64 = 0.98;

/// The gray map of an environment.
fn gray_map(
    context: &mut Context<'_>,
    at: &Place,
    reference: &EnvironmentMapReference,
) -> Resolved<EnvironmentMap> {
    let message = "a gray map is a .png file; a spectral .exr file is the map of a light of type \"spectral_environment\"";
    let file = map_file(context, at, reference, &["png"], message)?;
    let image = read_texture_png(file.as_ref(), Transfer::Linear).map_err(|e| context.file_error(at, &e))?;
    let factors = image.data.chunks_exact(image.channels).map(gray).collect();
    let layer = EnvironmentLayer { spectrum: Curve::constant(1.0), factors };
    EnvironmentMap::new(image.width, image.height, vec![layer], reference.rotation_deg())
        .map_err(|error| context.error(at, error.to_string()))
}

/// The file of a map, with its ending and its turn checked.
fn map_file<'r>(
    context: &mut Context<'_>,
    at: &Place,
    reference: &'r EnvironmentMapReference,
    endings: &[&str],
    other_ending: &str,
) -> Resolved<&'r FilePath> {
    context.within(&at.field("rotation_deg"), reference.rotation_deg(), [-3600.0, 3600.0], "degrees")?;
    let file = reference.file();
    if !file.extension().is_some_and(|ending| endings.contains(&&*ending)) {
        return context.fail(at, other_ending);
    }
    context.note_input(at, file)?;
    Ok(file)
}

/// Bands of an environment map; each is a source of its own.
const MOST_MAP_BANDS: usize = 64;

/// One within a bin, zero outside, with edges of a hundred-thousandth of its width.
fn bin_curve(from_nm: f64, to_nm: f64) -> Curve {
    let edge = 1e-5 * (to_nm - from_nm);
    let wavelengths = vec![from_nm, from_nm + edge, to_nm - edge, to_nm];
    Curve::new(wavelengths, vec![0.0, 1.0, 1.0, 0.0]).unwrap_or_else(|_| Curve::constant(0.0))
}

/// Where positions and directions of a light refer to, and how they become those of the scene.
struct Frame<'a> {
    camera: &'a PerspectiveCamera,
    in_camera: bool,
}

impl<'a> Frame<'a> {
    fn new(frame: LightFrame, camera: &'a PerspectiveCamera) -> Self {
        Self { camera, in_camera: frame == LightFrame::Camera }
    }

    fn turn(&self, v: Vec3) -> Vec3 {
        let camera = self.camera;
        if self.in_camera { camera.right * v.x + camera.up * v.y - camera.forward * v.z } else { v }
    }

    fn place(&self, v: Vec3) -> Vec3 {
        if self.in_camera { self.camera.position + self.turn(v) } else { v }
    }

    /// A point of the frame, mm, in the scene.
    fn point(&self, context: &Context<'_>, at: &Place, value_mm: [f64; 3]) -> Resolved<Vec3> {
        Ok(self.place(context.meters(at, value_mm)?))
    }

    /// Direction in which a light shines.
    fn axis(&self, context: &Context<'_>, at: &Place, center: Vec3, aim: Option<Aim>) -> Resolved<Vec3> {
        let aim_at = at.field("aim");
        match aim {
            Some(Aim::Direction { direction }) => {
                Ok(self.turn(context.direction(&aim_at.field("direction"), direction)?))
            }
            Some(Aim::Point { look_at_mm }) => {
                let aim_at = aim_at.field("look_at_mm");
                let target = self.point(context, &aim_at, look_at_mm)?;
                match (target - center).try_normalize() {
                    Some(axis) => Ok(axis),
                    None => context
                        .fail(&aim_at, "the light is at the point at which it aims; move one of the two"),
                }
            }
            None if self.in_camera => Ok(self.camera.forward),
            None => {
                let message =
                    "the direction of the light is missing; give `aim.direction` or `aim.look_at_mm`";
                context.fail(at, message)
            }
        }
    }

    /// The axis of a light that shines evenly: of those alone on which an irradiance is stated.
    fn even_axis(&self) -> Vec3 {
        if self.in_camera { self.camera.forward } else { Vec3::NEG_Z }
    }

    /// Two unit vectors across an axis.
    fn across(&self, axis: Vec3) -> (Vec3, Vec3) {
        ring_axes(axis, self.in_camera.then_some(self.camera.right))
    }
}

fn length(context: &Context<'_>, at: &Place, key: &str, value_mm: f64) -> Resolved<f32> {
    Ok((context.within(&at.field(key), value_mm, LENGTH_MM, "millimeters")? * 1e-3) as f32)
}

/// The emitters of a light, and how strong they are.
fn emitters(
    context: &mut Context<'_>,
    at: &Place,
    section: &EmitterSection,
    camera: &PerspectiveCamera,
) -> Resolved<(Emitters, Strength)> {
    let map_at = at.field("map");
    match section {
        EmitterSection::Ring(ring) => {
            Ok((ring_emitters(context, at, ring, camera)?, Strength::Source(ring.strength)))
        }
        EmitterSection::Disc(disc) => {
            let frame = Frame::new(disc.frame, camera);
            let center = frame.point(context, &at.field("position_mm"), disc.position_mm)?;
            let axis = frame.axis(context, at, center, disc.aim)?;
            let exponent = flat_exponent(context, at, disc.half_angle_deg)?;
            let radius_m = length(context, at, "radius_mm", disc.radius_mm)?;
            let emitter = Emitter::Disc(DiscEmitter { center, normal: axis, radius_m, exponent });
            Ok((Emitters { center, axis, list: vec![emitter] }, Strength::Source(disc.strength)))
        }
        EmitterSection::Annulus(annulus) => {
            Ok((annulus_emitter(context, at, annulus, camera)?, Strength::Source(annulus.strength)))
        }
        EmitterSection::Rectangle(rectangle) => {
            Ok((rectangle_emitter(context, at, rectangle, camera)?, Strength::Source(rectangle.strength)))
        }
        EmitterSection::Sphere(sphere) => {
            let frame = Frame::new(sphere.frame, camera);
            let center = frame.point(context, &at.field("position_mm"), sphere.position_mm)?;
            let radius_m = length(context, at, "radius_mm", sphere.radius_mm)?;
            let list = vec![Emitter::Sphere(SphereEmitter { center, radius_m })];
            Ok((Emitters { center, axis: frame.even_axis(), list }, Strength::Source(sphere.strength)))
        }
        EmitterSection::Point(point) => {
            let frame = Frame::new(point.frame, camera);
            let center = frame.point(context, &at.field("position_mm"), point.position_mm)?;
            let list = vec![Emitter::Point(PointEmitter { position: center, pattern: PointPattern::Even })];
            Ok((Emitters { center, axis: frame.even_axis(), list }, Strength::Source(point.strength)))
        }
        EmitterSection::Spot(spot) => {
            let frame = Frame::new(spot.frame, camera);
            let center = frame.point(context, &at.field("position_mm"), spot.position_mm)?;
            let axis = frame.axis(context, at, center, spot.aim)?;
            let pattern = spot_pattern(context, at, spot, axis)?;
            let list = vec![Emitter::Point(PointEmitter { position: center, pattern })];
            Ok((Emitters { center, axis, list }, Strength::Source(spot.strength)))
        }
        EmitterSection::Distant(distant) => {
            let frame = Frame::new(distant.frame, camera);
            let center = frame.place(Vec3::ZERO);
            let axis = frame.axis(context, at, center, distant.aim)?;
            let list = vec![Emitter::Distant(DistantEmitter { direction: axis })];
            Ok((Emitters { center, axis, list }, Strength::Distant(distant.strength)))
        }
        EmitterSection::Environment(environment) => {
            let emitter = match &environment.map {
                Some(map) => Emitter::EnvironmentMap(Arc::new(gray_map(context, &map_at, map)?)),
                None => Emitter::Environment,
            };
            Ok((Emitters::everywhere(emitter), Strength::Environment(environment.strength)))
        }
        EmitterSection::SpectralEnvironment(environment) => {
            let map = spectral_map(context, &map_at, &environment.map)?;
            Ok((Emitters::everywhere(Emitter::EnvironmentMap(Arc::new(map))), Strength::OfMap))
        }
    }
}

fn rectangle_emitter(
    context: &mut Context<'_>,
    at: &Place,
    rectangle: &RectangleLight,
    camera: &PerspectiveCamera,
) -> Resolved<Emitters> {
    let frame = Frame::new(rectangle.frame, camera);
    let center = frame.point(context, &at.field("position_mm"), rectangle.position_mm)?;
    let axis = frame.axis(context, at, center, rectangle.aim)?;
    let exponent = flat_exponent(context, at, rectangle.half_angle_deg)?;
    let [width, height] = rectangle.size_mm;
    let (width, height) = (length(context, at, "size_mm", width)?, length(context, at, "size_mm", height)?);
    let (right, up) = frame.across(axis);
    // The emitting side is that of edge_u x edge_v.
    let (edge_u, edge_v) = (right * width, up * height);
    let (edge_u, edge_v) =
        if edge_u.cross(edge_v).dot(axis) > 0.0 { (edge_u, edge_v) } else { (edge_v, edge_u) };
    let emitter = Emitter::Rectangle(RectangleEmitter {
        corner: center - 0.5 * (edge_u + edge_v),
        edge_u,
        edge_v,
        exponent,
    });
    Ok(Emitters { center, axis, list: vec![emitter] })
}

fn annulus_emitter(
    context: &Context<'_>,
    at: &Place,
    annulus: &AnnulusLight,
    camera: &PerspectiveCamera,
) -> Resolved<Emitters> {
    let frame = Frame::new(annulus.frame, camera);
    let center = frame.point(context, &at.field("position_mm"), annulus.position_mm)?;
    let axis = frame.axis(context, at, center, annulus.aim)?;
    let exponent = flat_exponent(context, at, annulus.half_angle_deg)?;
    let radius_m = length(context, at, "radius_mm", annulus.radius_mm)?;
    let inner_radius_m = length(context, at, "inner_radius_mm", annulus.inner_radius_mm)?;
    if inner_radius_m >= radius_m {
        let message = "must be smaller than radius_mm, the outer radius of the annulus";
        return context.fail(&at.field("inner_radius_mm"), message);
    }
    let emitter = AnnulusEmitter { center, normal: axis, inner_radius_m, radius_m, exponent };
    Ok(Emitters { center, axis, list: vec![emitter.into()] })
}

fn ring_emitters(
    context: &Context<'_>,
    at: &Place,
    ring: &RingLight,
    camera: &PerspectiveCamera,
) -> Resolved<Emitters> {
    let frame = Frame::new(ring.frame, camera);
    let center = frame.point(context, &at.field("position_mm"), ring.position_mm)?;
    let axis = frame.axis(context, at, center, ring.aim)?;
    let exponent = flat_exponent(context, at, ring.half_angle_deg)?;
    let count = context.whole_within(&at.field("count"), ring.count.into(), [1, 10_000])?;
    let ring_radius_m = length(context, at, "ring_radius_mm", ring.ring_radius_mm)?;
    let radius_m = length(context, at, "radius_mm", ring.radius_mm)?;
    let start = ring.start_angle_deg;
    context.within(&at.field("start_angle_deg"), start, [-360.0, 360.0], "degrees")?;
    let aim_m = match ring.aim_distance_mm {
        None => None,
        Some(distance) => Some(length(context, at, "aim_distance_mm", distance)?),
    };
    let (right, up) = frame.across(axis);
    let list = (0..count)
        .map(|i| {
            let angle = (start.to_radians() + 2.0 * PI * i as f64 / count as f64) as f32;
            let position = center + ring_radius_m * (right * angle.cos() + up * angle.sin());
            let normal = aim_m.map_or(axis, |aim| (center + axis * aim - position).normalize());
            Emitter::Disc(DiscEmitter { center: position, normal, radius_m, exponent })
        })
        .collect();
    Ok(Emitters { center, axis, list })
}

/// Exponent of the emission pattern of a point.
fn point_exponent(context: &Context<'_>, at: &Place, half_angle_deg: f64) -> Resolved<f32> {
    context.within(&at.field("half_angle_deg"), half_angle_deg, [NARROWEST_DEG, 90.0], "degrees")?;
    if half_angle_deg == 90.0 {
        return Ok(0.0);
    }
    Ok(Emitter::exponent_from_half_angle(half_angle_deg) as f32)
}

/// How the intensity of a spot depends on the direction.
fn spot_pattern(context: &Context<'_>, at: &Place, spot: &SpotLight, axis: Vec3) -> Resolved<PointPattern> {
    match (spot.half_angle_deg, spot.cone_deg) {
        (Some(half_angle_deg), None) => match spot.edge {
            None => Ok(PointPattern::Lobe { axis, exponent: point_exponent(context, at, half_angle_deg)? }),
            Some(_) => context.fail(&at.field("edge"), "is that of a cone; remove it, or give `cone_deg`"),
        },
        (None, Some([inner, outer])) => {
            let field = at.field("cone_deg");
            context.within(&field.index(1), outer, [LEAST_CONE_DEG, 180.0], "degrees")?;
            context.within(&field.index(0), inner, [0.0, outer], "degrees")?;
            Ok(PointPattern::Cone(SpotCone::new(axis, [inner, outer], spot.edge.unwrap_or_default())))
        }
        (Some(_), Some(_)) => context
            .fail(&at.field("cone_deg"), "and `half_angle_deg` exclude each other; remove one of the two"),
        (None, None) => context.fail(at, "a spot needs `half_angle_deg`, or the two angles of `cone_deg`"),
    }
}

/// Exponent of the emission pattern of a flat emitter.
fn flat_exponent(context: &Context<'_>, at: &Place, half_angle_deg: f64) -> Resolved<f32> {
    let at = at.field("half_angle_deg");
    if half_angle_deg > 60.0 {
        return context.fail(&at, "must be between 2.2 and 60 degrees; a flat source at 60 is Lambertian");
    }
    context.within(&at, half_angle_deg, [NARROWEST_DEG, 60.0], "degrees")?;
    Ok((Emitter::exponent_from_half_angle(half_angle_deg) as f32).max(1.0))
}

/// Two unit vectors across an axis; the first one as near to the preferred right as can be.
fn ring_axes(axis: Vec3, right: Option<Vec3>) -> (Vec3, Vec3) {
    let wanted = right.unwrap_or(Vec3::X);
    let wanted = if wanted.cross(axis).length() < 1e-3 { Vec3::Y } else { wanted };
    let right = (wanted - axis * wanted.dot(axis)).normalize();
    // Seen along the axis, angles run counter-clockwise as in the image of a camera that looks the same way.
    (right, right.cross(axis))
}

/// Spectrum behind the filters, in the unit that the emitter wants.
fn absolute_spectrum(
    context: &mut Context<'_>,
    at: &Place,
    section: &LightSection,
    emitters: &Emitters,
    strength: Strength,
    grid: &WavelengthGrid,
) -> Resolved<Curve> {
    // A map of spectral radiances is multiplied as it is; all others are scaled to what the section states.
    let role = if strength == Strength::OfMap { Role::AbsolutePower } else { Role::Light };
    let bare = context.spectrum(&at.field("spectrum"), &section.spectrum, role, 0.0, grid)?;
    context.within(&at.field("filter_angle_deg"), section.filter_angle_deg, [0.0, 60.0], "degrees")?;
    let mut filtered = bare.clone();
    for (index, filter) in section.filters.iter().enumerate() {
        let at = at.field("filters").index(index);
        let is_of_catalogue = matches!(filter, SpectrumReference::Text(NameOrTable::Name(_)));
        if section.filter_angle_deg != 0.0 && !is_of_catalogue {
            let message = "filter_angle_deg shifts filters of the catalogue alone; leave it out and give this one as it is at that angle";
            return context.fail(&at, message);
        }
        let filter = context.spectrum(&at, filter, Role::Filter, section.filter_angle_deg, grid)?;
        filtered = filtered.times(&filter);
    }
    let total = |curve: &Curve| curve.integral(MIN_WAVELENGTH_NM, MAX_WAVELENGTH_NM);
    if total(&filtered) <= 0.0 {
        return context.fail(at, "nothing passes the filters of this light; check spectrum and filters");
    }
    let at = at.field("strength");
    let strong = |key: &str, value: f64, unit: &str| context.within(&at.field(key), value, STRENGTH, unit);
    let unit = || filtered.scaled(1.0 / total(&filtered));
    match strength {
        Strength::OfMap => Ok(filtered),
        Strength::Source(SourceStrength::Power { power_mw }) => {
            let power_w = strong("power_mw", power_mw, "milliwatts per emitter")? * 1e-3;
            Ok(filtered.scaled(power_w / total(&bare)))
        }
        Strength::Environment(EnvironmentStrength { radiance_w_per_sr_m2 }) => {
            Ok(unit().scaled(strong("radiance_w_per_sr_m2", radiance_w_per_sr_m2, "W/(sr m²)")?))
        }
        Strength::Distant(DistantStrength { irradiance_w_per_m2 }) => {
            Ok(unit().scaled(strong("irradiance_w_per_m2", irradiance_w_per_m2, "W/m²")?))
        }
        Strength::Source(SourceStrength::Irradiance { irradiance_w_per_m2, at_distance_mm }) => {
            let irradiance = strong("irradiance_w_per_m2", irradiance_w_per_m2, "W/m²")?;
            let distance_at = at.field("at_distance_mm");
            let distance_m = context.within(&distance_at, at_distance_mm, LENGTH_MM, "millimeters")? * 1e-3;
            // On the axis, on a surface that faces the light, when every emitter sends one watt.
            let axis = emitters.axis.as_dvec3();
            let position = emitters.center.as_dvec3() + axis * distance_m;
            let place = OrientedPoint { position, normal: -axis };
            let per_watt: f64 = emitters.list.iter().map(|emitter| emitter.irradiance_per_watt(place)).sum();
            if per_watt <= 0.0 {
                return context.fail(&distance_at, "no light reaches the axis at this distance");
            }
            // Lights of any size are taken for points there
            let of_area: f64 =
                emitters.list.iter().flat_map(|emitter| emitter.irradiance_factors(place)).sum();
            if of_area < NEAREST_SHARE * per_watt {
                let percent = 100.0 * of_area / per_watt;
                context.warn(&distance_at, format!("so near the light is no point: it gives {percent:.0} % of the stated irradiance; state that at five diameters or more"));
            }
            Ok(unit().scaled(irradiance / per_watt))
        }
    }
}
