//! Surfaces: meshes, analytic shapes, the parts of a mouth.

use std::sync::Arc;

use glam::{Affine3, Affine3A, EulerRot, Mat3, Quat, Vec2, Vec3};

use super::context::{Context, LENGTH_MM, Resolved, SCALE, STRENGTH};
use super::fluorophore::Fluorophores;
use super::lesion::{self, Lesions};
use super::light::group_index;
use super::material::Materials;
use super::mouth;
use super::spectrum::Role;
use crate::cache::cached_mouth;
use crate::error::{Place, steps};
use crate::schema::{
    BoxShape, DiscShape, DisplacementSection, EmissionSection, EmissionSides, ExperimentFile, FilePath,
    InstanceSection, MouthSection, ObjectSection, PlacesSection, QuadShape, ShapeSection, SphereShape,
    TransformSection,
};
use fluorspar::geometry::{MeshInstance, MeshInstances, TriangleMesh};
use fluorspar::light::LightGroup;
use fluorspar::material::Material;
use fluorspar::names::did_you_mean;
use fluorspar::quote::excerpt;
use fluorspar::scene::{Object, Shape, SurfaceEmission};
use fluorspar::spectral::{MAX_WAVELENGTH_NM, MIN_WAVELENGTH_NM, WavelengthGrid};
use fluorspar_anatomy::{RestoredSurfaces, TOOTH_KINDS, Tissue, restored, tooth_kind};
use fluorspar_format::{read_gltf, read_gltf_instances, read_obj, read_placements, read_ply, read_stl};

/// All surfaces: parts of the mouth first, then the objects. With them what the lesions left behind.
pub(super) fn objects(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    materials: &mut Materials,
    fluorophores: &mut Fluorophores,
    grid: &WavelengthGrid,
    groups: &mut Vec<LightGroup>,
) -> Resolved<(Vec<Object>, Lesions)> {
    let mut objects: Vec<Object> = Vec::new();
    let mut left = Lesions::default();
    for (index, section) in file.object.iter().enumerate() {
        let at = steps!["object", index];
        let earlier = file.object[..index].iter().map(|other| other.name.as_str());
        context.unique_name(&at, &section.name, earlier)?;
        for object in object(context, &at, section, &materials.list, grid, groups)? {
            if objects.iter().any(|other| other.name == object.name) {
                let message = format!("another object or part is named \"{}\" already", object.name);
                return context.fail(&at, message);
            }
            objects.push(object);
        }
    }
    if let Some(section) = &file.mouth {
        let mut parts = mouth(context, section, &materials.list)?;
        scans(context, section, &materials.list, &mut parts)?;
        restorations(context, section, &materials.list, &mut parts)?;
        left = lesion::lesions(context, file, section, grid, materials, fluorophores, &mut parts)?;
        for object in &objects {
            if parts.iter().any(|part| part.name == object.name) {
                // An object that is only named by its instances has no line of its own.
                let index = file.object.iter().position(|section| section.name == object.name);
                let at = index.map_or_else(|| steps!["object"], |index| steps!["object", index, "name"]);
                return context.fail(&at, "a part of the mouth has this name; choose another");
            }
        }
        parts.append(&mut objects);
        objects = parts;
    }
    Ok((objects, left))
}

fn object(
    context: &mut Context<'_>,
    at: &Place,
    section: &ObjectSection,
    materials: &[Material],
    grid: &WavelengthGrid,
    groups: &mut Vec<LightGroup>,
) -> Resolved<Vec<Object>> {
    let material = material_index(context, &at.field("material"), &section.material, materials)?;
    let (transform, scale) = match &section.transform {
        Some(transform) => affine(context, &at.field("transform"), transform)?,
        None => (Affine3A::IDENTITY, 1.0),
    };
    let emission = match &section.emission {
        None => None,
        Some(emission) => Some(surface_emission(context, &at.field("emission"), emission, grid, groups)?),
    };
    let (mut mesh, displacement, places) = match &section.shape {
        ShapeSection::Sphere(sphere) => {
            let shape = sphere_shape(context, at, sphere, &transform, scale)?;
            return Ok(vec![Object { name: section.name.clone(), shape, material, emission }]);
        }
        ShapeSection::Disc(disc) => {
            let shape = disc_shape(context, at, disc, &transform, scale)?;
            return Ok(vec![Object { name: section.name.clone(), shape, material, emission }]);
        }
        ShapeSection::Quad(quad) => (quad_mesh(context, at, quad)?, quad.displacement.as_ref(), &quad.places),
        ShapeSection::Box(cuboid) => (box_mesh(context, at, cuboid)?, None, &cuboid.places),
        ShapeSection::Mesh(mesh) => {
            let file_at = at.field("file");
            let unit_mm = context.within(
                &at.field("unit_mm"),
                mesh.unit_mm,
                SCALE,
                "millimeters per unit of the file",
            )?;
            if mesh.displacement.is_none()
                && let Some(shared) = read_shared_meshes(context, &file_at, &mesh.file, unit_mm)?
            {
                let source = PlacedObject { section, places: &mesh.places, at, materials };
                return placed_objects(context, &source, material, shared, &transform, emission.as_ref());
            }
            let read = read_mesh(context, &file_at, &mesh.file, unit_mm)?;
            (read, mesh.displacement.as_ref(), &mesh.places)
        }
    };
    let displacement_at = at.field("displacement");
    if !places.instance.is_empty() || places.instance_file.is_some() {
        // The relief of a mesh at several places is in its own frame.
        if let Some(displacement) = displacement {
            displace(context, &displacement_at, displacement, &mut mesh)?;
        }
        let instances = vec![MeshInstance { mesh: 0, to_world: Affine3::IDENTITY }];
        let once = MeshInstances { meshes: vec![Arc::new(mesh)], instances };
        let source = PlacedObject { section, places, at, materials };
        return placed_objects(context, &source, material, once, &transform, emission.as_ref());
    }
    mesh.transform(&transform);
    if let Some(displacement) = displacement {
        displace(context, &displacement_at, displacement, &mut mesh)?;
    }
    check_textures(context, &at.field("file"), &mesh, material, materials)?;
    let shape = Shape::Mesh(Arc::new(mesh));
    Ok(vec![Object { name: section.name.clone(), shape, material, emission }])
}

/// Refuses a material with textures on a mesh without texture coordinates.
fn check_textures(
    context: &Context<'_>,
    at: &Place,
    mesh: &TriangleMesh,
    material: usize,
    materials: &[Material],
) -> Resolved<()> {
    let material = &materials[material];
    if !(mesh.uvs.is_empty() && material.is_textured(materials)) {
        return Ok(());
    }
    let message = format!(
        "material \"{}\" has a texture, but the mesh has no texture coordinates; export them with the mesh, or \
         use a material of constant values",
        material.name
    );
    context.fail(at, message)
}

/// A section of an object with the materials that it may name.
struct PlacedObject<'a> {
    section: &'a ObjectSection,
    places: &'a PlacesSection,
    at: &'a Place,
    materials: &'a [Material],
}

/// Instances that are one part of the image.
struct Part {
    name: String,
    material: usize,
    places: Vec<Affine3>,
}

/// Most instances of one object.
const MOST_INSTANCES: usize = 100_000_000;

/// Meshes at all the places that a section gives, one object for each part. The meshes are shared.
fn placed_objects(
    context: &mut Context<'_>,
    source: &PlacedObject<'_>,
    material: usize,
    shared: MeshInstances,
    transform: &Affine3A,
    emission: Option<&SurfaceEmission>,
) -> Resolved<Vec<Object>> {
    let at = source.at;
    let parts = parts(context, source, material, transform)?;
    let places: usize = parts.iter().map(|part| part.places.len()).sum();
    let instances = places.saturating_mul(shared.instances.len());
    if instances > MOST_INSTANCES {
        let message = format!("{instances} instances are more than {MOST_INSTANCES}; give fewer places");
        return context.fail(at, message);
    }
    let mut objects = Vec::with_capacity(parts.len());
    for part in parts {
        for mesh in &shared.meshes {
            check_textures(context, &at.field("file"), mesh, part.material, source.materials)?;
        }
        let mut instances = Vec::with_capacity(part.places.len() * shared.instances.len());
        for place in &part.places {
            instances.extend(
                shared.instances.iter().map(|instance| MeshInstance {
                    mesh: instance.mesh,
                    to_world: *place * instance.to_world,
                }),
            );
        }
        let many = MeshInstances { meshes: shared.meshes.clone(), instances };
        many.validate().map_err(|error| context.error(at, error.to_string()))?;
        objects.push(Object {
            name: part.name,
            shape: Shape::Instances(Arc::new(many)),
            material: part.material,
            emission: emission.cloned(),
        });
    }
    Ok(objects)
}

/// The places of a section, by part.
fn parts(
    context: &mut Context<'_>,
    source: &PlacedObject<'_>,
    material: usize,
    transform: &Affine3A,
) -> Resolved<Vec<Part>> {
    let PlacedObject { section, places, at, materials } = *source;
    let whole = Affine3 { matrix3: transform.matrix3.into(), translation: transform.translation.into() };
    let mut parts: Vec<Part> = Vec::new();
    for (index, instance) in places.instance.iter().enumerate() {
        let at = at.field("instance").index(index);
        let name = instance.part.as_ref().unwrap_or(&section.name);
        let material = match &instance.material {
            Some(name) => material_index(context, &at.field("material"), name, materials)?,
            None => material,
        };
        let place = whole * instance_map(context, &at, instance)?;
        match parts.iter_mut().find(|part| part.name == *name) {
            Some(part) if part.material == material => part.places.push(place),
            Some(part) => {
                let message = format!(
                    "an earlier instance of part \"{name}\" has material \"{}\"; give this one a `part` of its own",
                    materials[part.material].name
                );
                return context.fail(&at, message);
            }
            None => parts.push(Part { name: name.clone(), material, places: vec![place] }),
        }
    }
    if let Some(list) = &places.instance_file {
        let at = at.field("instance_file");
        context.note_input(&at, list)?;
        let places = read_placements(list.as_ref(), 1e-3).map_err(|error| context.file_error(&at, &error))?;
        let flat = |place: &Affine3| !MeshInstance { mesh: 0, to_world: *place }.is_invertible();
        if let Some(number) = places.iter().position(flat) {
            let message =
                format!("place {number} (counted from 0) flattens the mesh; its axes must span a volume");
            return context.fail(&at, message);
        }
        let places = places.into_iter().map(|place| whole * place);
        match parts.iter_mut().find(|part| part.name == section.name) {
            Some(part) if part.material == material => part.places.extend(places),
            Some(_) => {
                let message = "an instance of the object's own name has another material; give it a `part`";
                return context.fail(&at, message);
            }
            None => parts.push(Part { name: section.name.clone(), material, places: places.collect() }),
        }
    }
    if parts.is_empty() {
        parts.push(Part { name: section.name.clone(), material, places: vec![whole] });
    }
    Ok(parts)
}

fn instance_map(context: &Context<'_>, at: &Place, section: &InstanceSection) -> Resolved<Affine3> {
    let map = match section.matrix {
        Some(rows) => {
            let others = InstanceSection {
                matrix: section.matrix,
                part: section.part.clone(),
                material: section.material.clone(),
                ..InstanceSection::default()
            };
            if *section != others {
                return context
                    .fail(&at.field("matrix"), "a matrix is all of a place; remove the other fields");
            }
            if rows.iter().any(|row| row[..3].iter().any(|a| a.is_nan() || a.abs() > SCALE[1])) {
                let message = "every number of the three axes must be between -1000000 and 1000000";
                return context.fail(&at.field("matrix"), message);
            }
            let axis = |column: usize| Vec3::from([0, 1, 2].map(|row| rows[row][column] as f32));
            Affine3 {
                matrix3: Mat3::from_cols(axis(0), axis(1), axis(2)),
                translation: context.meters(&at.field("matrix"), [0, 1, 2].map(|row| rows[row][3]))?,
            }
        }
        None => {
            let turned = TransformSection {
                translate_mm: section.translate_mm,
                rotate_deg: section.rotate_deg,
                axis: section.axis,
                angle_deg: section.angle_deg,
                scale: section.scale,
            };
            let (map, _) = affine(context, at, &turned)?;
            for factor in section.stretch {
                if !(SCALE[0]..=SCALE[1]).contains(&factor.abs()) {
                    let message =
                        "every factor must be between 1e-6 and 1000000, or the negative of such a number";
                    return context.fail(&at.field("stretch"), message);
                }
            }
            let [x, y, z] = section.stretch.map(|factor| factor as f32);
            Affine3 { matrix3: map.matrix3.into(), translation: map.translation.into() }
                * Affine3::from_scale(Vec3::new(x, y, z))
        }
    };
    if !(MeshInstance { mesh: 0, to_world: map }).is_invertible() {
        return context.fail(at, "this place flattens the mesh; its axes must span a volume");
    }
    Ok(map)
}

/// Meshes of a file in which several nodes share some; `None` for all other files.
fn read_shared_meshes(
    context: &mut Context<'_>,
    at: &Place,
    file: &FilePath,
    unit_mm: f64,
) -> Resolved<Option<MeshInstances>> {
    if !matches!(file.extension().as_deref(), Some("gltf" | "glb")) {
        return Ok(None);
    }
    context.note_input(at, file)?;
    let many =
        read_gltf_instances(file.as_ref(), unit_mm * 1e-3).map_err(|error| context.file_error(at, &error))?;
    Ok((many.instances.len() > 1).then_some(many))
}

/// Most triangles of a displaced mesh.
const MOST_TRIANGLES: usize = 20_000_000;

fn displace(
    context: &mut Context<'_>,
    at: &Place,
    section: &DisplacementSection,
    mesh: &mut TriangleMesh,
) -> Resolved<()> {
    context.within(&at.field("amount_mm"), section.amount_mm, [-100.0, 100.0], "millimeters")?;
    context.whole_within(&at.field("subdivisions"), section.subdivisions.into(), [0, 8])?;
    let map = context.texture(&at.field("map"), &section.map, 1.0)?;
    if mesh.uvs.is_empty() && map.constant().is_none() {
        return context
            .fail(&at.field("map"), "the mesh has no texture coordinates; export them with the mesh");
    }
    let triangles = mesh.triangles.len() << (2 * section.subdivisions);
    if triangles > MOST_TRIANGLES {
        let message =
            format!("{triangles} triangles are more than {MOST_TRIANGLES}; give fewer subdivisions");
        return context.fail(&at.field("subdivisions"), message);
    }
    mesh.subdivide(section.subdivisions);
    let amount_m = (section.amount_mm * 1e-3) as f32;
    mesh.displace(|uv| amount_m * map.at(uv));
    Ok(())
}

fn material_index(context: &Context<'_>, at: &Place, name: &str, materials: &[Material]) -> Resolved<usize> {
    let known = materials.iter().map(|material| material.name.as_str());
    context.known(at, name, known, "there is no [[material]] of this name")
}

fn affine(context: &Context<'_>, at: &Place, section: &TransformSection) -> Resolved<(Affine3A, f32)> {
    let scale =
        context.within(&at.field("scale"), section.scale, SCALE, "as a factor on all lengths")? as f32;
    let translation = context.meters(&at.field("translate_mm"), section.translate_mm)?;
    for angle in section.rotate_deg {
        context.within(&at.field("rotate_deg"), angle, [-3600.0, 3600.0], "degrees")?;
    }
    let [x, y, z] = section.rotate_deg.map(|angle| angle.to_radians() as f32);
    let mut rotation = Quat::from_euler(EulerRot::ZYX, z, y, x);
    match (section.axis, section.angle_deg) {
        (Some(axis), Some(angle)) => {
            let axis = context.direction(&at.field("axis"), axis)?;
            context.within(&at.field("angle_deg"), angle, [-3600.0, 3600.0], "degrees")?;
            rotation = Quat::from_axis_angle(axis, angle.to_radians() as f32) * rotation;
        }
        (None, None) => {}
        _ => return context.fail(at, "axis and angle_deg go together; give both or none"),
    }
    Ok((Affine3A::from_scale_rotation_translation(Vec3::splat(scale), rotation, translation), scale))
}

fn radius(context: &Context<'_>, at: &Place, radius_mm: f64, scale: f32) -> Resolved<f32> {
    let at = at.field("radius_mm");
    Ok((context.within(&at, radius_mm, LENGTH_MM, "millimeters")? * 1e-3) as f32 * scale)
}

fn sphere_shape(
    context: &Context<'_>,
    at: &Place,
    sphere: &SphereShape,
    transform: &Affine3A,
    scale: f32,
) -> Resolved<Shape> {
    let center = context.meters(&at.field("center_mm"), sphere.center_mm)?;
    let radius_m = radius(context, at, sphere.radius_mm, scale)?;
    Ok(Shape::Sphere { center: transform.transform_point3(center), radius_m })
}

fn disc_shape(
    context: &Context<'_>,
    at: &Place,
    disc: &DiscShape,
    transform: &Affine3A,
    scale: f32,
) -> Resolved<Shape> {
    let center = context.meters(&at.field("center_mm"), disc.center_mm)?;
    let normal = context.direction(&at.field("normal"), disc.normal)?;
    let radius_m = radius(context, at, disc.radius_mm, scale)?;
    let normal = transform.transform_vector3(normal).normalize();
    Ok(Shape::Disc { center: transform.transform_point3(center), normal, radius_m })
}

/// Two triangles with texture coordinates along the edges.
fn quad_mesh(context: &Context<'_>, at: &Place, quad: &QuadShape) -> Resolved<TriangleMesh> {
    let corner = context.meters(&at.field("corner_mm"), quad.corner_mm)?;
    let edge_u = context.meters(&at.field("edge_u_mm"), quad.edge_u_mm)?;
    let edge_v = context.meters(&at.field("edge_v_mm"), quad.edge_v_mm)?;
    if edge_u.cross(edge_v).length() <= 1e-6 * edge_u.length() * edge_v.length() || edge_u == Vec3::ZERO {
        return context
            .fail(at, "edge_u_mm and edge_v_mm span no area; give two edges that are not parallel");
    }
    Ok(TriangleMesh::quad(corner, edge_u, edge_v))
}

fn box_mesh(context: &Context<'_>, at: &Place, cuboid: &BoxShape) -> Resolved<TriangleMesh> {
    let center = context.meters(&at.field("center_mm"), cuboid.center_mm)?;
    let size_at = at.field("size_mm");
    for size in cuboid.size_mm {
        context.within(&size_at, size, LENGTH_MM, "millimeters")?;
    }
    let size = context.meters(&size_at, cuboid.size_mm)?;
    let mut mesh = TriangleMesh::default();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut normal = Vec3::ZERO;
            normal[axis] = sign;
            let mut edge_u = Vec3::ZERO;
            edge_u[(axis + 1) % 3] = size[(axis + 1) % 3] * sign;
            let mut edge_v = Vec3::ZERO;
            edge_v[(axis + 2) % 3] = size[(axis + 2) % 3];
            let corner = center + 0.5 * (normal * size[axis] - edge_u - edge_v);
            mesh.add_quad(corner, edge_u, edge_v);
        }
    }
    Ok(mesh)
}

fn read_mesh(context: &mut Context<'_>, at: &Place, file: &FilePath, unit_mm: f64) -> Resolved<TriangleMesh> {
    let read = match file.extension().as_deref() {
        Some("ply") => read_ply,
        Some("obj") => read_obj,
        Some("stl") => read_stl,
        Some("gltf" | "glb") => read_gltf,
        _ => {
            return context
                .fail(at, "not a .ply, .obj, .stl, .gltf or .glb file; export the mesh as one of these");
        }
    };
    context.note_input(at, file)?;
    let mesh = read(file.as_ref(), unit_mm * 1e-3).map_err(|error| context.file_error(at, &error))?;
    mesh.validate().map_err(|error| context.error(at, error.to_string()))?;
    Ok(mesh)
}

fn surface_emission(
    context: &mut Context<'_>,
    at: &Place,
    section: &EmissionSection,
    grid: &WavelengthGrid,
    groups: &mut Vec<LightGroup>,
) -> Resolved<SurfaceEmission> {
    let radiance = section.radiance_w_per_sr_m2;
    let radiance = context.within(&at.field("radiance_w_per_sr_m2"), radiance, STRENGTH, "W/(sr m²)")?;
    let curve = context.spectrum(&at.field("spectrum"), &section.spectrum, Role::Light, 0.0, grid)?;
    if section.group.is_empty() {
        return context.fail(&at.field("group"), "a light group needs a name");
    }
    let total = curve.integral(MIN_WAVELENGTH_NM, MAX_WAVELENGTH_NM);
    if total <= 0.0 {
        return context.fail(&at.field("spectrum"), "the spectrum has no power between 200 and 1200 nm");
    }
    Ok(SurfaceEmission {
        group: group_index(groups, &section.group),
        radiance: curve.scaled(radiance / total),
        is_one_sided: section.sides == EmissionSides::Front,
    })
}

fn mouth(context: &mut Context<'_>, section: &MouthSection, materials: &[Material]) -> Resolved<Vec<Object>> {
    mouth::check_view(context, section.view.as_deref())?;
    mouth::check_person(context, section)?;
    let transform = match &section.transform {
        Some(transform) => affine(context, &steps!["mouth", "transform"], transform)?.0,
        None => Affine3A::IDENTITY,
    };
    for (key, material) in &section.materials {
        material_index(context, &steps!["mouth", "materials", key], material, materials)?;
    }
    let needed = |tissue: &str| {
        let name = section.materials.get(tissue).map_or(tissue, String::as_str);
        materials.iter().position(|material| material.name == name)
    };
    // Before the meshes are made, which takes a while: every tissue of a mouth is there at least once.
    for tissue in Tissue::ALL.map(Tissue::name) {
        if needed(tissue).is_none() {
            let message = format!(
                "no material for {tissue}; add a [[material]] of that name, or a line {tissue} = \"...\" to [mouth.materials]"
            );
            return context.fail(&steps!["mouth"], message);
        }
    }
    let mouth =
        cached_mouth(&section.parameters).map_err(|e| context.error(&steps!["mouth", e.field], e.message))?;
    for key in section.materials.keys() {
        let is_tissue =
            Tissue::ALL.iter().any(|tissue| tissue.name() == key) || TOOTH_KINDS.contains(&key.as_str());
        let is_missing =
            section.parameters.missing_teeth.iter().any(|tooth| *key == format!("tooth_{tooth}"));
        if !is_tissue && !is_missing && mouth.part(key).is_none() {
            let names = || {
                Tissue::ALL
                    .into_iter()
                    .map(|t| -> &str { t.name() })
                    .chain(TOOTH_KINDS)
                    .chain(mouth.parts.iter().map(|p| p.name.as_str()))
            };
            let hint = did_you_mean(key, names());
            let tissues: Vec<&str> = Tissue::ALL.into_iter().map(Tissue::name).collect();
            let message = format!(
                "the mouth has neither a tissue nor a part \"{key}\"{hint} Tissues: {}",
                tissues.join(", ")
            );
            return context.fail(&steps!["mouth", "materials", key], message);
        }
    }
    let mut objects = Vec::with_capacity(mouth.parts.len());
    for part in &mouth.parts {
        let tissue = part.tissue.name();
        let of_part = section.materials.get(&part.name);
        let material = match of_part.or_else(|| section.materials.get(tooth_kind(&part.name)?)) {
            Some(name) => materials.iter().position(|material| material.name == *name),
            None => needed(tissue),
        };
        let Some(material) = material else {
            return context.fail(&steps!["mouth"], format!("no material for part {}", part.name));
        };
        let mut mesh = part.mesh.clone();
        if section.transform.is_some() {
            mesh.transform(&transform);
        }
        objects.push(Object {
            name: part.name.clone(),
            shape: Shape::Mesh(Arc::new(mesh)),
            material,
            emission: None,
        });
    }
    Ok(objects)
}

/// Puts meshes of the user in the place of parts.
fn scans(
    context: &mut Context<'_>,
    section: &MouthSection,
    materials: &[Material],
    parts: &mut Vec<Object>,
) -> Resolved<()> {
    for (index, scan) in section.scan.iter().enumerate() {
        let at = steps!["mouth", "scan", index];
        context.unique_name(
            &at,
            &scan.name,
            section.scan[..index].iter().map(|other| other.name.as_str()),
        )?;
        let material = material_index(context, &at.field("material"), &scan.material, materials)?;
        for name in &scan.replaces {
            let before = parts.len();
            match name.strip_suffix('*') {
                Some(start) => parts.retain(|part| !part.name.starts_with(start)),
                None => parts.retain(|part| part.name != *name),
            }
            if parts.len() == before {
                let hint = did_you_mean(name, parts.iter().map(|part| part.name.as_str()));
                return context.fail(
                    &at.field("replaces"),
                    format!("the mouth has no part \"{}\"{hint}", excerpt(name)),
                );
            }
        }
        let unit_mm = context.within(
            &at.field("unit_mm"),
            scan.unit_mm.unwrap_or(1.0),
            SCALE,
            "millimeters per unit of the file",
        )?;
        let mut mesh = read_mesh(context, &at.field("mesh"), &scan.mesh, unit_mm)?;
        if let Some(message) = unlikely_size(&mesh, unit_mm) {
            context.warn(&at.field("mesh"), message);
        }
        if mesh.normals.is_empty() {
            mesh.compute_smooth_normals();
        }
        if mesh.uvs.is_empty() && materials[material].is_textured(materials) {
            // Scans seldom have texture coordinates: maps are spread over the plane of their widest extents.
            mesh.uvs = planar_coordinates(&mesh);
            let message =
                "the file has no texture coordinates; textures are projected along its thinnest side";
            context.warn(&at.field("mesh"), message);
        }
        let place = match &scan.transform {
            Some(transform) => affine(context, &at.field("transform"), transform)?.0,
            None => Affine3A::IDENTITY,
        };
        let whole = match &section.transform {
            Some(transform) => affine(context, &steps!["mouth", "transform"], transform)?.0,
            None => Affine3A::IDENTITY,
        };
        mesh.transform(&(whole * place));
        if parts.iter().any(|part| part.name == scan.name) {
            return context.fail(
                &at.field("name"),
                "the mouth has a part of this name; name it in `replaces`, or rename the scan",
            );
        }
        parts.push(Object {
            name: scan.name.clone(),
            shape: Shape::Mesh(Arc::new(mesh)),
            material,
            emission: None,
        });
    }
    Ok(())
}

/// Area of a restoration below which others before it have left slivers alone: the smallest filling has several mm².
const LEAST_RESTORATION_M2: f32 = 1e-6;

fn area_m2(mesh: &TriangleMesh) -> f32 {
    0.5 * mesh.triangles.iter().map(|triangle| mesh.triangle_cross(triangle).length()).sum::<f32>()
}

/// Cuts fillings and crowns out of the teeth.
fn restorations(
    context: &Context<'_>,
    section: &MouthSection,
    materials: &[Material],
    parts: &mut Vec<Object>,
) -> Resolved<()> {
    for (index, restoration) in section.restoration.iter().enumerate() {
        let at = steps!["mouth", "restoration", index];
        let (name, number) = (&restoration.name, restoration.tooth);
        context.unique_name(&at, name, parts.iter().map(|part| part.name.as_str()))?;
        let of_tooth = format!("tooth_{number}");
        if section.scan.iter().any(|scan| scan.name == of_tooth) {
            return context.fail(&at.field("tooth"), "this tooth is a scan, whose surfaces nothing names");
        }
        let tooth = parts.iter_mut().find(|part| part.name == of_tooth);
        let Some(Object { shape: Shape::Mesh(mesh), .. }) = tooth else {
            let message =
                format!("the mouth has no tooth {number}; give the FDI number of one that is there");
            return context.fail(&at.field("tooth"), message);
        };
        let Some(surfaces) = RestoredSurfaces::parse(&restoration.surfaces) else {
            let message = "give letters of surfaces, each once: m, o or i, d, b or f, l or p";
            return context.fail(&at.field("surfaces"), message);
        };
        let material = material_index(context, &at.field("material"), &restoration.material, materials)?;
        let [rest, covered] = restored(mesh, number, surfaces);
        if area_m2(&covered) < LEAST_RESTORATION_M2 {
            let message = "restorations before it cover these surfaces of the tooth already; remove one";
            return context.fail(&at.field("surfaces"), message);
        }
        *mesh = Arc::new(rest);
        let shape = Shape::Mesh(Arc::new(covered));
        parts.push(Object { name: name.clone(), shape, material, emission: None });
    }
    Ok(())
}

/// Longest side of the box around a scan of one tooth or of a whole head, mm.
const SCAN_MM: std::ops::RangeInclusive<f64> = 5.0..=500.0;

/// A warning for a scan that is too small or too large for any part of a mouth, with the unit that would fix it.
fn unlikely_size(mesh: &TriangleMesh, unit_mm: f64) -> Option<String> {
    let (low, high) = mesh.bounds();
    let longest_mm = 1e3 * f64::from((high - low).max_element());
    if SCAN_MM.contains(&longest_mm) {
        return None;
    }
    let unit = [(1.0, "millimeters"), (1000.0, "meters"), (0.001, "micrometers"), (10.0, "centimeters")]
        .into_iter()
        .find(|(unit, _)| SCAN_MM.contains(&(longest_mm / unit_mm * unit)));
    let hint = unit.map_or_else(
        || "check the unit of the file and unit_mm".to_owned(),
        |(unit, name)| format!("if the file is in {name}, set unit_mm = {unit:?}"),
    );
    Some(format!("the scan is {longest_mm:.3e} mm long, a dental arch about 60 mm; {hint}"))
}

/// Texture coordinates along the two longest sides of the bounding box.
fn planar_coordinates(mesh: &TriangleMesh) -> Vec<Vec2> {
    let (low, high) = mesh.bounds();
    let size = high - low;
    let thinnest = (0..3).fold(0, |best, axis| if size[axis] < size[best] { axis } else { best });
    let (a, b) = ((thinnest + 1) % 3, (thinnest + 2) % 3);
    let share = |p: Vec3, axis: usize| (p[axis] - low[axis]) / size[axis].max(1e-9);
    mesh.positions.iter().map(|p| Vec2::new(share(*p, a), share(*p, b))).collect()
}
