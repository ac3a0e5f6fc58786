//! Spots on the parts of a mouth: their masks are baked into the textures of the part's own material.

use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::context::{Context, Resolved};
use super::material::Fluorophores;
use super::spectrum::Role;
use crate::experiment::error::{Step, steps};
use crate::experiment::schema::{ExperimentFile, LesionSection, MouthSection};
use crate::format::{Transfer, read_texture_png};
use crate::geometry::TriangleMesh;
use crate::material::{FluorophoreAmount, ImageTexture, Material, ReflectanceTerm, ScalarTexture};
use crate::preset::nearest_name;
use crate::scene::{Object, Shape};
use crate::spectral::{Curve, WavelengthGrid, blood_transmittance};

/// Pixels of the baked textures along each side.
const SIDE: usize = 512;

/// Adds all lesions: the part gets a material of its own.
pub(super) fn lesions(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    section: &MouthSection,
    grid: &WavelengthGrid,
    materials: &mut Vec<Material>,
    fluorophores: &mut Fluorophores,
    parts: &mut [Object],
) -> Resolved<()> {
    for (index, lesion) in section.lesion.iter().enumerate() {
        let at = steps!["mouth", "lesion", index];
        let field = |key: &str| [&at[..], &steps![key]].concat();
        context.unique_name(&at, &lesion.name, section.lesion[..index].iter().map(|l| l.name.as_str()))?;
        let Some(object) = parts.iter_mut().find(|part| part.name == lesion.part) else {
            let hint = nearest_name(&lesion.part, parts.iter().map(|part| part.name.as_str()))
                .map_or_else(|| ".".into(), |name| format!(", did you mean \"{name}\"?"));
            return context.fail(&field("part"), format!("the mouth has no part of this name{hint}"));
        };
        let Shape::Mesh(mesh) = &object.shape else {
            return context.fail(&field("part"), "this part has no mesh");
        };
        context.within(&field("blood_um"), lesion.blood_um, [0.0, 200.0], "µm")?;
        let mask = mask(context, &at, lesion, mesh)?;
        let around = &materials[object.material];
        let mut material = around.clone();
        material.name = format!("{} with {}", around.name, lesion.name);
        let blood = |curve: &Curve| -> Curve {
            if lesion.blood_um == 0.0 {
                return curve.clone();
            }
            curve.times(&Curve::from_fn(300.0, 1100.0, |nm| blood_transmittance(nm, 2.0 * lesion.blood_um)))
        };
        let mut terms = Vec::new();
        for term in &around.reflectance {
            let weight = bake(&term.weight, &mask, |w, m| w * (1.0 - m));
            terms.push(ReflectanceTerm { spectrum: term.spectrum.clone(), weight });
            if lesion.reflectance.is_none() {
                let weight = bake(&term.weight, &mask, |w, m| w * m);
                terms.push(ReflectanceTerm { spectrum: blood(&term.spectrum), weight });
            }
        }
        if let Some(reference) = &lesion.reflectance {
            let spectrum =
                context.spectrum(&field("reflectance"), reference, Role::Reflectance, 0.0, grid)?;
            let weight = bake(&ScalarTexture::Constant(1.0), &mask, |_, m| m);
            terms.push(ReflectanceTerm { spectrum: blood(&spectrum), weight });
        }
        material.reflectance = terms;
        for (name, &inside) in &lesion.concentrations {
            let at = [&field("concentrations")[..], &steps![name]].concat();
            context.within(&at, inside, [0.0, 1e6], "")?;
            let fluorophore = fluorophores.index(context, &at, &file.fluorophore, name)?;
            let inside = inside as f32;
            match material.fluorophores.iter_mut().find(|amount| amount.fluorophore == fluorophore) {
                Some(amount) => {
                    amount.concentration =
                        bake(&amount.concentration, &mask, |c, m| c * (1.0 - m) + inside * m);
                }
                None => material.fluorophores.push(FluorophoreAmount {
                    fluorophore,
                    concentration: bake(&ScalarTexture::Constant(0.0), &mask, |_, m| inside * m),
                }),
            }
        }
        materials.push(material);
        object.material = materials.len() - 1;
    }
    Ok(())
}

/// A texture as an image in which every pixel was combined with the mask.
fn bake(texture: &ScalarTexture, mask: &[f32], combine: impl Fn(f32, f32) -> f32) -> ScalarTexture {
    let values: Vec<f32> =
        (0..SIDE * SIDE).map(|i| combine(texture.at(pixel_center(i)), mask[i]).max(0.0)).collect();
    match ImageTexture::new(SIDE, SIDE, values) {
        Ok(image) => ScalarTexture::Image { image: Arc::new(image), low: 0.0, high: 1.0 },
        // Products of finite numbers from 0 up are such numbers.
        Err(_) => texture.clone(),
    }
}

/// Texture coordinates of a pixel, rows from the top.
fn pixel_center(i: usize) -> Vec2 {
    let (column, row) = (i % SIDE, i / SIDE);
    Vec2::new((column as f32 + 0.5) / SIDE as f32, 1.0 - (row as f32 + 0.5) / SIDE as f32)
}

/// How much of the lesion every pixel has, 0 to 1.
fn mask(
    context: &mut Context<'_>,
    at: &[Step],
    lesion: &LesionSection,
    mesh: &TriangleMesh,
) -> Resolved<Vec<f32>> {
    let field = |key: &str| [at, &steps![key]].concat();
    if let Some(file) = &lesion.mask {
        let at = field("mask");
        context.note_input(&at, file)?;
        let image =
            read_texture_png(file.as_ref(), Transfer::Linear).map_err(|e| context.file_error(&at, &e))?;
        let grey = image.data.chunks_exact(image.channels).map(super::spectrum::grey).collect();
        let image = ImageTexture::new(image.width, image.height, grey)
            .map_err(|e| context.error(&at, e.to_string()))?;
        return Ok((0..SIDE * SIDE).map(|i| image.at(pixel_center(i)).min(1.0)).collect());
    }
    for value in lesion.center {
        context.within(&field("center"), value, [0.0, 1.0], "of the part")?;
    }
    for size in lesion.size_mm {
        context.positive(&field("size_mm"), size, "millimetres")?;
    }
    context.within(&field("edge_mm"), lesion.edge_mm, [0.0, 100.0], "mm")?;
    context.within(&field("angle_deg"), lesion.angle_deg, [-360.0, 360.0], "degrees")?;
    let center = Vec2::new(lesion.center[0] as f32, lesion.center[1] as f32);
    let Some((along_u, along_v)) = stretch(mesh, center) else {
        let message = "the part has no surface at these texture coordinates; choose another center";
        return context.fail(&field("center"), message);
    };
    let (sine, cosine) = (lesion.angle_deg.to_radians() as f32).sin_cos();
    let axes = lesion.size_mm.map(|size| 0.5e-3 * size as f32);
    let edge = 1e-3 * lesion.edge_mm as f32;
    // Lengths on the surface near the middle; u and v need not be at right angles there.
    let (length_u, length_v) = (along_u.length(), along_v.length());
    let lean = along_u.dot(along_v) / (length_u * length_v).max(1e-20);
    let upright = (1.0 - lean * lean).max(0.0).sqrt();
    Ok((0..SIDE * SIDE)
        .map(|i| {
            let d = pixel_center(i) - center;
            let (x, y) = (d.x * length_u + d.y * length_v * lean, d.y * length_v * upright);
            let (p, q) = (x * cosine + y * sine, y * cosine - x * sine);
            let r = Vec2::new(p / axes[0], q / axes[1]).length();
            // Distance beyond the rim, to first order.
            let beyond = (r - 1.0) * axes[0].min(axes[1]);
            if edge <= 0.0 {
                return if beyond <= 0.0 { 1.0 } else { 0.0 };
            }
            let t = (0.5 - beyond / edge).clamp(0.0, 1.0);
            t * t * (3.0 - 2.0 * t)
        })
        .collect())
}

/// Change of position per texture coordinate around a point, m.
fn stretch(mesh: &TriangleMesh, at: Vec2) -> Option<(Vec3, Vec3)> {
    let mut sums = (Vec3::ZERO, Vec3::ZERO, 0.0_f32);
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| mesh.uvs[v as usize]);
        let middle = (a + b + c) / 3.0;
        if (middle - at).abs().max_element() > 0.04 {
            continue;
        }
        let [p, q, r] = triangle.map(|v| mesh.positions[v as usize]);
        let (e, f) = (b - a, c - a);
        let area = e.perp_dot(f);
        if area.abs() < 1e-12 {
            continue;
        }
        let (pe, pf) = (q - p, r - p);
        let weight = area.abs();
        sums.0 += (pe * f.y - pf * e.y) / area * weight;
        sums.1 += (pf * e.x - pe * f.x) / area * weight;
        sums.2 += weight;
    }
    (sums.2 > 0.0).then(|| (sums.0 / sums.2, sums.1 / sums.2))
}
