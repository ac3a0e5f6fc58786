//! Lights with absolute spectra.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::Vec3;

use super::context::{Context, LENGTH_MM, Resolved, STRENGTH};
use super::spectrum::{Role, grey};
use crate::experiment::error::{Place, steps};
use crate::experiment::schema::{LightFrame, LightSection, LightType};
use crate::format::{Transfer, read_spectral_exr, read_texture_png};
use crate::geometry::OrientedPoint;
use crate::light::{
    AnnulusEmitter, DiscEmitter, DistantEmitter, Emitter, EnvironmentLayer, EnvironmentMap, Light,
    LightGroup, PointEmitter, RectangleEmitter, SphereEmitter,
};
use crate::optics::PerspectiveCamera;
use crate::spectral::{Curve, MAX_WAVELENGTH_NM, MIN_WAVELENGTH_NM, Radiance, WavelengthGrid};

const DEFAULT_COUNT: u32 = 8;
/// Half angle of the narrowest pattern that a light may have.
const NARROWEST_DEG: f64 = 2.2;

/// Emitters of one section, the power of each still to be found.
struct Emitters {
    center: Vec3,
    axis: Vec3,
    list: Vec<Emitter>,
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
        check_fields(context, &at, section)?;
        let mut emitters = emitters(context, &at, section, camera)?;
        if let Some(map) = environment_map(context, &at, section)? {
            emitters.list = vec![Emitter::EnvironmentMap(Arc::new(map))];
        }
        let spectrum = absolute_spectrum(context, &at, section, &emitters, grid)?;
        let group = group_index(groups, group_name);
        let single = emitters.list.len() == 1;
        for (number, emitter) in emitters.list.into_iter().enumerate() {
            let name = if single { section.name.clone() } else { format!("{}[{number}]", section.name) };
            lights.push(Light { name, group, spectrum: spectrum.clone(), emitter });
        }
    }
    Ok(lights)
}

/// Refuses fields that the type of a light does not have, and asks for those that it needs.
fn check_fields(context: &Context<'_>, at: &Place, section: &LightSection) -> Resolved<()> {
    use LightType::{Annulus, Disc, Distant, Environment, Point, Rectangle, Ring, Sphere};
    let given = [
        (
            "power_mw",
            section.power_mw.is_some(),
            &[Ring, Disc, Annulus, Rectangle, Sphere, Point][..],
            &[][..],
        ),
        (
            "irradiance_w_per_m2",
            section.irradiance_w_per_m2.is_some(),
            &[Ring, Disc, Annulus, Rectangle, Sphere, Point, Distant][..],
            &[Distant][..],
        ),
        (
            "at_distance_mm",
            section.at_distance_mm.is_some(),
            &[Ring, Disc, Annulus, Rectangle, Sphere, Point][..],
            &[][..],
        ),
        (
            "radiance_w_per_sr_m2",
            section.radiance_w_per_sr_m2.is_some(),
            &[Environment][..],
            if is_spectral_map(section) { &[][..] } else { &[Environment][..] },
        ),
        ("map", section.map.is_some(), &[Environment][..], &[][..]),
        ("map_rotation_deg", section.map_rotation_deg.is_some(), &[Environment][..], &[][..]),
        ("count", section.count.is_some(), &[Ring][..], &[][..]),
        ("ring_radius_mm", section.ring_radius_mm.is_some(), &[Ring][..], &[Ring][..]),
        ("start_angle_deg", section.start_angle_deg.is_some(), &[Ring][..], &[][..]),
        ("aim_distance_mm", section.aim_distance_mm.is_some(), &[Ring][..], &[][..]),
        (
            "radius_mm",
            section.radius_mm.is_some(),
            &[Ring, Disc, Annulus, Sphere][..],
            &[Ring, Disc, Annulus, Sphere][..],
        ),
        ("inner_radius_mm", section.inner_radius_mm.is_some(), &[Annulus][..], &[Annulus][..]),
        ("size_mm", section.size_mm.is_some(), &[Rectangle][..], &[Rectangle][..]),
        (
            "position_mm",
            section.position_mm.is_some(),
            &[Ring, Disc, Annulus, Rectangle, Sphere, Point][..],
            &[][..],
        ),
        (
            "half_angle_deg",
            section.half_angle_deg.is_some(),
            &[Ring, Disc, Annulus, Rectangle, Point][..],
            &[][..],
        ),
    ];
    let aims: &[LightType] = &[Ring, Disc, Annulus, Rectangle, Point, Distant];
    let given = given.into_iter().chain([
        ("direction", section.direction.is_some(), aims, &[][..]),
        ("look_at_mm", section.look_at_mm.is_some(), aims, &[][..]),
    ]);
    let name = kind_name(section.kind);
    for (field, is_given, allowed, needed) in given {
        if is_given && !allowed.contains(&section.kind) {
            let message =
                format!("a light of type \"{name}\" has no such field; remove it or change the type");
            return context.fail(&at.field(field), message);
        }
        if !is_given && needed.contains(&section.kind) {
            return context.fail(at, format!("a light of type \"{name}\" needs `{field}`"));
        }
    }
    let strengths = section.power_mw.is_some() as u8 + section.irradiance_w_per_m2.is_some() as u8;
    if section.kind != Environment && strengths != 1 {
        return context
            .fail(at, "give the strength of the light: either `power_mw` or `irradiance_w_per_m2`");
    }
    if is_spectral_map(section) && section.radiance_w_per_sr_m2.is_some() {
        let at = at.field("radiance_w_per_sr_m2");
        return context.fail(&at, "the values of a spectral map are absolute; remove this field");
    }
    if section.map_rotation_deg.is_some() && section.map.is_none() {
        return context.fail(&at.field("map_rotation_deg"), "there is no `map` to turn; give one");
    }
    if section.kind == Environment && section.frame == LightFrame::Camera {
        let at = at.field("frame");
        return context.fail(&at, "an environment is the same from everywhere; remove the frame");
    }
    if section.power_mw.is_some() && section.at_distance_mm.is_some() {
        let at = at.field("at_distance_mm");
        let message = "goes with irradiance_w_per_m2, not with power_mw; remove one of the two";
        return context.fail(&at, message);
    }
    if section.kind == Point
        && section.half_angle_deg.is_none()
        && let Some(field) = [("direction", section.direction), ("look_at_mm", section.look_at_mm)]
            .into_iter()
            .find_map(|(field, value)| value.map(|_| field))
    {
        let at = at.field(field);
        let message =
            "a point without half_angle_deg shines evenly all around; remove this, or add half_angle_deg";
        return context.fail(&at, message);
    }
    if section.direction.is_some() && section.look_at_mm.is_some() {
        let at = at.field("look_at_mm");
        return context.fail(&at, "given together with direction; keep one of the two");
    }
    Ok(())
}

/// Whether the map of an environment has spectra of its own.
fn is_spectral_map(section: &LightSection) -> bool {
    section.map.as_ref().is_some_and(|map| map.to_lowercase().ends_with(".exr"))
}

/// The map of an environment.
fn environment_map(
    context: &mut Context<'_>,
    at: &Place,
    section: &LightSection,
) -> Resolved<Option<EnvironmentMap>> {
    let Some(file) = &section.map else { return Ok(None) };
    let rotation_deg = section.map_rotation_deg.unwrap_or(0.0);
    let rotation_at = at.field("map_rotation_deg");
    let at = at.field("map");
    context.within(&rotation_at, rotation_deg, [-3600.0, 3600.0], "degrees")?;
    let lower = file.to_lowercase();
    if !lower.ends_with(".png") && !lower.ends_with(".exr") {
        return context.fail(&at, "this is neither a .png nor an .exr file; save the map as one of the two");
    }
    context.note_input(&at, file)?;
    let (width, height, layers) = if lower.ends_with(".png") {
        let image =
            read_texture_png(file.as_ref(), Transfer::Linear).map_err(|e| context.file_error(&at, &e))?;
        let factors = image.data.chunks_exact(image.channels).map(grey).collect();
        let layer = EnvironmentLayer { spectrum: Curve::constant(1.0), factors };
        (image.width, image.height, vec![layer])
    } else {
        let image =
            read_spectral_exr::<Radiance>(file.as_ref()).map_err(|e| context.file_error(&at, &e))?.image;
        if image.bands() > MOST_MAP_BANDS {
            let message = format!(
                "the map has {} bands, more than {MOST_MAP_BANDS}; average some of them",
                image.bands()
            );
            return context.fail(&at, message);
        }
        let layers = (0..image.bands())
            .map(|band| {
                let edges = &image.grid().edges_nm()[band..band + 2];
                let factors: Vec<f32> =
                    image.data().iter().skip(band).step_by(image.bands()).copied().collect();
                EnvironmentLayer { spectrum: bin_curve(edges[0], edges[1]), factors }
            })
            .filter(|layer| layer.factors.iter().any(|v| *v != 0.0))
            .collect();
        (image.width(), image.height(), layers)
    };
    match EnvironmentMap::new(width, height, layers, rotation_deg) {
        Ok(map) => Ok(Some(map)),
        Err(error) => context.fail(&at, error.to_string()),
    }
}

/// Bands of an environment map; each is a source of its own.
const MOST_MAP_BANDS: usize = 64;

/// One within a bin, zero outside, with edges of a hundred-thousandth of its width.
fn bin_curve(from_nm: f64, to_nm: f64) -> Curve {
    let edge = 1e-5 * (to_nm - from_nm);
    let wavelengths = vec![from_nm, from_nm + edge, to_nm - edge, to_nm];
    Curve::new(wavelengths, vec![0.0, 1.0, 1.0, 0.0]).unwrap_or_else(|_| Curve::constant(0.0))
}

fn kind_name(kind: LightType) -> &'static str {
    match kind {
        LightType::Ring => "ring",
        LightType::Disc => "disc",
        LightType::Annulus => "annulus",
        LightType::Rectangle => "rectangle",
        LightType::Sphere => "sphere",
        LightType::Point => "point",
        LightType::Distant => "distant",
        LightType::Environment => "environment",
    }
}

fn emitters(
    context: &Context<'_>,
    at: &Place,
    section: &LightSection,
    camera: &PerspectiveCamera,
) -> Resolved<Emitters> {
    let in_camera = section.frame == LightFrame::Camera;
    let turn = |v: Vec3| {
        if in_camera { camera.right * v.x + camera.up * v.y - camera.forward * v.z } else { v }
    };
    let place = |v: Vec3| if in_camera { camera.position + turn(v) } else { v };
    let length = |key: &str, value: Option<f64>| -> Resolved<f32> {
        let value_mm = context.within(&at.field(key), value.unwrap_or(f64::NAN), LENGTH_MM, "millimetres")?;
        Ok((value_mm * 1e-3) as f32)
    };

    let center = place(context.meters(&at.field("position_mm"), section.position_mm.unwrap_or([0.0; 3]))?);
    let axis = if let Some(direction) = section.direction {
        turn(context.direction(&at.field("direction"), direction)?)
    } else if let Some(target) = section.look_at_mm {
        let target = place(context.meters(&at.field("look_at_mm"), target)?);
        let Some(axis) = (target - center).try_normalize() else {
            return context.fail(&at.field("look_at_mm"), "the light stands at the point at which it shines");
        };
        axis
    } else if in_camera {
        camera.forward
    } else {
        let even = matches!(section.kind, LightType::Sphere | LightType::Environment)
            || (section.kind == LightType::Point && section.half_angle_deg.is_none());
        if !even {
            return context.fail(at, "nothing says where the light shines; give `direction` or `look_at_mm`");
        }
        Vec3::NEG_Z
    };
    let exponent = exponent(context, &at.field("half_angle_deg"), section)?;

    let list = match section.kind {
        LightType::Ring => {
            let count = context.whole_within(
                &at.field("count"),
                section.count.unwrap_or(DEFAULT_COUNT).into(),
                [1, 10_000],
            )?;
            let ring_radius_m = length("ring_radius_mm", section.ring_radius_mm)?;
            let radius_m = length("radius_mm", section.radius_mm)?;
            let start = section.start_angle_deg.unwrap_or(0.0);
            context.within(&at.field("start_angle_deg"), start, [-360.0, 360.0], "degrees")?;
            let aim_m = match section.aim_distance_mm {
                None => None,
                distance => Some(length("aim_distance_mm", distance)?),
            };
            let (right, up) = ring_axes(axis, in_camera.then_some(camera.right));
            (0..count)
                .map(|i| {
                    let angle = (start.to_radians() + 2.0 * PI * i as f64 / count as f64) as f32;
                    let position = center + ring_radius_m * (right * angle.cos() + up * angle.sin());
                    let normal = aim_m.map_or(axis, |aim| (center + axis * aim - position).normalize());
                    Emitter::Disc(DiscEmitter { center: position, normal, radius_m, exponent })
                })
                .collect()
        }
        LightType::Disc => {
            let radius_m = length("radius_mm", section.radius_mm)?;
            vec![Emitter::Disc(DiscEmitter { center, normal: axis, radius_m, exponent })]
        }
        LightType::Annulus => {
            let radius_m = length("radius_mm", section.radius_mm)?;
            let inner_radius_m = length("inner_radius_mm", section.inner_radius_mm)?;
            if inner_radius_m >= radius_m {
                return context.fail(
                    &at.field("inner_radius_mm"),
                    "must be smaller than radius_mm, the outer radius of the annulus",
                );
            }
            vec![AnnulusEmitter { center, normal: axis, inner_radius_m, radius_m, exponent }.into()]
        }
        LightType::Rectangle => {
            let [width, height] = section.size_mm.unwrap_or([f64::NAN; 2]);
            let (width, height) = (length("size_mm", Some(width))?, length("size_mm", Some(height))?);
            let (right, up) = ring_axes(axis, in_camera.then_some(camera.right));
            // The emitting side is that of edge_u x edge_v.
            let (edge_u, edge_v) = (right * width, up * height);
            let (edge_u, edge_v) =
                if edge_u.cross(edge_v).dot(axis) > 0.0 { (edge_u, edge_v) } else { (edge_v, edge_u) };
            vec![Emitter::Rectangle(RectangleEmitter {
                corner: center - 0.5 * (edge_u + edge_v),
                edge_u,
                edge_v,
                exponent,
            })]
        }
        LightType::Sphere => {
            vec![Emitter::Sphere(SphereEmitter { center, radius_m: length("radius_mm", section.radius_mm)? })]
        }
        LightType::Point => {
            let pattern = section.half_angle_deg.map(|_| (axis, exponent));
            vec![Emitter::Point(PointEmitter { position: center, pattern })]
        }
        LightType::Distant => vec![Emitter::Distant(DistantEmitter { direction: axis })],
        LightType::Environment => vec![Emitter::Environment],
    };
    Ok(Emitters { center, axis, list })
}

/// Exponent of the emission pattern.
fn exponent(context: &Context<'_>, at: &Place, section: &LightSection) -> Resolved<f32> {
    let Some(half_angle_deg) = section.half_angle_deg else { return Ok(1.0) };
    if section.kind == LightType::Point {
        context.within(at, half_angle_deg, [NARROWEST_DEG, 90.0], "degrees")?;
        if half_angle_deg == 90.0 {
            return Ok(0.0);
        }
        return Ok(Emitter::exponent_from_half_angle(half_angle_deg) as f32);
    }
    if half_angle_deg > 60.0 {
        return context.fail(at, "must be between 2.2 and 60 degrees; a flat source at 60 is Lambertian");
    }
    context.within(at, half_angle_deg, [NARROWEST_DEG, 60.0], "degrees")?;
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
    grid: &WavelengthGrid,
) -> Resolved<Curve> {
    // A map of spectral radiances is multiplied as it is; all others are scaled to what the section states.
    let role = if is_spectral_map(section) { Role::Absolute } else { Role::Light };
    let bare = context.spectrum(&at.field("spectrum"), &section.spectrum, role, 0.0, grid)?;
    context.within(&at.field("filter_angle_deg"), section.filter_angle_deg, [0.0, 60.0], "degrees")?;
    let mut filtered = bare.clone();
    for (index, filter) in section.filters.iter().enumerate() {
        let at = at.field("filters").index(index);
        let filter = context.spectrum(&at, filter, Role::Filter, section.filter_angle_deg, grid)?;
        filtered = filtered.times(&filter);
    }
    let total = |curve: &Curve| curve.integral(MIN_WAVELENGTH_NM, MAX_WAVELENGTH_NM);
    if total(&filtered) <= 0.0 {
        return context.fail(at, "nothing passes the filters of this light; check spectrum and filters");
    }
    if let Some(power_mw) = section.power_mw {
        let power_w =
            context.within(&at.field("power_mw"), power_mw, STRENGTH, "milliwatts per emitter")? * 1e-3;
        return Ok(filtered.scaled(power_w / total(&bare)));
    }
    if is_spectral_map(section) {
        return Ok(filtered);
    }
    let unit = filtered.scaled(1.0 / total(&filtered));
    if let Some(radiance) = section.radiance_w_per_sr_m2 {
        let radiance = context.within(&at.field("radiance_w_per_sr_m2"), radiance, STRENGTH, "W/(sr m²)")?;
        return Ok(unit.scaled(radiance));
    }
    let irradiance = section.irradiance_w_per_m2.unwrap_or(f64::NAN);
    let irradiance = context.within(&at.field("irradiance_w_per_m2"), irradiance, STRENGTH, "W/m²")?;
    if section.kind == LightType::Distant {
        return Ok(unit.scaled(irradiance));
    }
    let Some(distance_mm) = section.at_distance_mm else {
        return context.fail(at, "`irradiance_w_per_m2` needs `at_distance_mm`, where it was measured");
    };
    let distance_m =
        context.within(&at.field("at_distance_mm"), distance_mm, LENGTH_MM, "millimetres")? * 1e-3;
    // On the axis, on a surface that faces the light, when every emitter sends one watt.
    let axis = emitters.axis.as_dvec3();
    let position = emitters.center.as_dvec3() + axis * distance_m;
    let place = OrientedPoint { position, normal: -axis };
    let per_watt: f64 = emitters.list.iter().map(|emitter| emitter.irradiance_per_watt(place)).sum();
    if per_watt <= 0.0 {
        return context.fail(&at.field("at_distance_mm"), "no light reaches the axis at this distance");
    }
    Ok(unit.scaled(irradiance / per_watt))
}
