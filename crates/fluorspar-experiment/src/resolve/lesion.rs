//! Spots on the parts of a mouth: their masks are baked into the textures of the part's own material.

use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::context::{Context, Resolved};
use super::fluorophore::Fluorophores;
use super::material::Materials;
use super::spectrum::Role;
use crate::error::{Place, steps};
use crate::schema::{ExperimentFile, LesionSection, MouthSection};
use fluorspar::geometry::TriangleMesh;
use fluorspar::material::{FluorophoreAmount, ImageTexture, Material, ReflectanceTerm, ScalarTexture};
use fluorspar::names::did_you_mean;
use fluorspar::scene::{Object, Shape};
use fluorspar::spectral::{Curve, WavelengthGrid, blood_transmittance};
use fluorspar_format::{Transfer, read_texture_png};

/// Pixels of the baked textures along each side.
const SIDE: usize = 512;

/// Shortest and longest axis of an ellipse, mm: from less than a pixel of the textures to more than any part is long.
const SIZE_MM: [f64; 2] = [0.1, 200.0];

/// Parts that a lesion reaches, and its share on the map of each.
pub(super) type SpotMaps = Vec<(String, Arc<ImageTexture>)>;

/// What the lesions of a mouth left behind.
#[derive(Default)]
pub(super) struct Lesions {
    /// Number of the material that each material behind those of the file was copied from.
    pub(super) copied_materials: Vec<usize>,
    /// Name of each lesion, and its share on the maps of the parts that it reaches.
    pub(super) spots: Vec<(String, SpotMaps)>,
}

/// Adds all lesions: the part gets a material of its own, behind the others.
pub(super) fn lesions(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    section: &MouthSection,
    grid: &WavelengthGrid,
    materials: &mut Materials,
    fluorophores: &mut Fluorophores,
    parts: &mut [Object],
) -> Resolved<Lesions> {
    let mut copied = Vec::new();
    let mut spots = Vec::new();
    for (index, lesion) in section.lesion.iter().enumerate() {
        let at = steps!["mouth", "lesion", index];
        context.unique_name(&at, &lesion.name, section.lesion[..index].iter().map(|l| l.name.as_str()))?;
        let Some(object) = parts.iter().find(|part| part.name == lesion.part) else {
            let hint = did_you_mean(&lesion.part, parts.iter().map(|part| part.name.as_str()));
            return context.fail(&at.field("part"), format!("the mouth has no part of this name{hint}"));
        };
        let Shape::Mesh(mesh) = &object.shape else {
            return context.fail(&at.field("part"), "this part has no mesh");
        };
        context.within(&at.field("blood_um"), lesion.blood_um, [0.0, 200.0], "µm")?;
        let spot = Spot::new(context, &at, lesion, mesh)?;
        let reflectance = match &lesion.reflectance {
            Some(reference) => {
                Some(context.spectrum(&at.field("reflectance"), reference, Role::Reflectance, 0.0, grid)?)
            }
            None => None,
        };
        let mut amounts = Vec::new();
        for (name, &inside) in &lesion.concentrations {
            let at = at.field("concentrations").field(name);
            context.within(&at, inside, [0.0, 1e6], "")?;
            amounts.push((fluorophores.index(context, &at, &file.fluorophore, name)?, inside as f32));
        }
        let mut reached = Vec::new();
        for object in parts.iter_mut() {
            let Some(unfold) = continuation(&lesion.part, &object.name) else { continue };
            let Some(mask) = spot.bake(unfold) else { continue };
            // The shares are numbers between 0 and 1.
            reached.extend(
                ImageTexture::new(SIDE, SIDE, mask.clone()).map(|map| (object.name.clone(), Arc::new(map))),
            );
            let blood_um = lesion.blood_um;
            if let Some(recipe) = materials.recipes.get(&object.material).cloned() {
                if object.name == lesion.part {
                    recipe.check_lesion(context, &at, lesion)?;
                }
                let inside = |texture: &ScalarTexture, value: f32| {
                    bake(texture, &mask, |around, m| around * (1.0 - m) + value * m)
                };
                let within = bake(&ScalarTexture::Constant(0.0), &mask, |_, m| m);
                let recipe = recipe.with_lesion(context, &at, lesion, within, inside)?;
                let (scattering, amounts) = recipe.resolve(context, file, grid, fluorophores)?;
                let around = &materials.list[object.material];
                let name = format!("{} with {}", around.name, lesion.name);
                materials.list.push(Material { name, scattering, fluorophores: amounts, ..around.clone() });
                copied.push(object.material);
                object.material = materials.list.len() - 1;
                materials.recipes.insert(object.material, recipe);
                continue;
            }
            if !(lesion.tissue.is_empty() && lesion.states.is_empty()) {
                let message = format!(
                    "material \"{}\" of part \"{}\" is not of layered tissue; give it type = \"tissue\", or the lesion a blood_um, a \
                     reflectance or concentrations",
                    materials.list[object.material].name, object.name
                );
                let field = if lesion.tissue.is_empty() { "states" } else { "tissue" };
                return context.fail(&at.field(field), message);
            }
            if reflectance.is_some() && materials.list[object.material].diffuse().is_none() {
                let message = format!(
                    "material \"{}\" of part \"{}\" has no diffuse reflectance that a lesion could change; remove it",
                    materials.list[object.material].name, object.name
                );
                return context.fail(&at.field("reflectance"), message);
            }
            let material = with_spot(
                &materials.list[object.material],
                &lesion.name,
                &mask,
                blood_um,
                &reflectance,
                &amounts,
            );
            materials.list.push(material);
            copied.push(object.material);
            object.material = materials.list.len() - 1;
        }
        spots.push((lesion.name.clone(), reached));
    }
    Ok(Lesions { copied_materials: copied, spots })
}

/// The parts of the tongue's back, which share one map.
const TONGUE_BACK: [&str; 4] = ["tongue_dorsum", "tongue_tip", "tongue_lateral_right", "tongue_lateral_left"];
const TONGUE_UNDERSIDE: &str = "tongue_ventral";

/// How the map of one part continues that of another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Unfold {
    /// They share it.
    Same,
    /// Both end at the border of the tongue, u = 0 and u = 1, with the same coordinates: one is the other, turned over.
    AcrossBorder,
}

/// How a lesion on a part continues on another one; `None` where it ends.
fn continuation(of: &str, over: &str) -> Option<Unfold> {
    if of == over {
        return Some(Unfold::Same);
    }
    let is_back = |name: &str| TONGUE_BACK.contains(&name);
    match (is_back(of), is_back(over)) {
        (true, true) => Some(Unfold::Same),
        (true, false) if over == TONGUE_UNDERSIDE => Some(Unfold::AcrossBorder),
        (false, true) if of == TONGUE_UNDERSIDE => Some(Unfold::AcrossBorder),
        _ => None,
    }
}

/// A material as it is inside the mask.
fn with_spot(
    around: &Material,
    name: &str,
    mask: &[f32],
    blood_um: f64,
    reflectance: &Option<Curve>,
    amounts: &[(usize, f32)],
) -> Material {
    let mut material = around.clone();
    material.name = format!("{} with {name}", around.name);
    let blood = |curve: &Curve| -> Curve {
        if blood_um == 0.0 {
            return curve.clone();
        }
        curve.times(&Curve::from_fn(300.0, 1100.0, |nm| blood_transmittance(nm, 2.0 * blood_um)))
    };
    let mut terms = Vec::new();
    for term in around.diffuse().map_or(&[][..], |base| &base.reflectance) {
        let weight = bake(&term.weight, mask, |w, m| w * (1.0 - m));
        terms.push(ReflectanceTerm { spectrum: term.spectrum.clone(), weight });
        if reflectance.is_none() {
            let weight = bake(&term.weight, mask, |w, m| w * m);
            terms.push(ReflectanceTerm { spectrum: blood(&term.spectrum), weight });
        }
    }
    if let Some(spectrum) = reflectance {
        let weight = bake(&ScalarTexture::Constant(1.0), mask, |_, m| m);
        terms.push(ReflectanceTerm { spectrum: blood(spectrum), weight });
    }
    if let Some(base) = material.diffuse_mut() {
        base.reflectance = terms;
    }
    for &(fluorophore, inside) in amounts {
        match material.fluorophores.iter_mut().find(|amount| amount.fluorophore == fluorophore) {
            Some(amount) => {
                amount.concentration = bake(&amount.concentration, mask, |c, m| c * (1.0 - m) + inside * m);
            }
            None => material.fluorophores.push(FluorophoreAmount::new(
                fluorophore,
                bake(&ScalarTexture::Constant(0.0), mask, |_, m| inside * m),
            )),
        }
    }
    material
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

/// Weight of a lesion at texture coordinates.
enum Spot {
    Painted(ImageTexture),
    Ellipse {
        center: Vec2,
        /// Lengths on the surface per texture coordinate near the middle, m, and the cosine between the two directions:
        /// u and v need not be at right angles there.
        lengths: [f32; 2],
        lean: f32,
        /// Half axes and edge, m; cosine and sine of the turn.
        axes: [f32; 2],
        edge: f32,
        turn: [f32; 2],
    },
}

impl Spot {
    fn new(
        context: &mut Context<'_>,
        at: &Place,
        lesion: &LesionSection,
        mesh: &TriangleMesh,
    ) -> Resolved<Self> {
        if let Some(file) = &lesion.mask {
            let at = at.field("mask");
            context.note_input(&at, file)?;
            let image =
                read_texture_png(file.as_ref(), Transfer::Linear).map_err(|e| context.file_error(&at, &e))?;
            let colored = |pixel: &[f32]| pixel.len() > 2 && (pixel[0] != pixel[1] || pixel[1] != pixel[2]);
            if image.data.chunks_exact(image.channels).any(colored) {
                let message = "the image has colors; the mean of red, green and blue is taken: white is inside, black \
                               outside. Save it as a gray PNG";
                context.warn(&at, message);
            }
            let gray = image.data.chunks_exact(image.channels).map(super::spectrum::gray).collect();
            let image = ImageTexture::new(image.width, image.height, gray)
                .map_err(|e| context.error(&at, e.to_string()))?;
            return Ok(Self::Painted(image));
        }
        for value in lesion.center {
            context.within(&at.field("center"), value, [0.0, 1.0], "of the part")?;
        }
        for size in lesion.size_mm {
            context.within(&at.field("size_mm"), size, SIZE_MM, "mm")?;
        }
        context.within(&at.field("edge_mm"), lesion.edge_mm, [0.0, 100.0], "mm")?;
        context.within(&at.field("angle_deg"), lesion.angle_deg, [-360.0, 360.0], "degrees")?;
        let center = Vec2::new(lesion.center[0] as f32, lesion.center[1] as f32);
        let Some((along_u, along_v)) = stretch(mesh, center) else {
            let [low, high] = uv_bounds(mesh);
            let message = format!(
                "the part has no surface at these texture coordinates; its surface lies between [{:.2}, {:.2}] and [{:.2}, {:.2}]. \
                 Choose another center",
                low.x, low.y, high.x, high.y
            );
            return context.fail(&at.field("center"), message);
        };
        let (sine, cosine) = (lesion.angle_deg.to_radians() as f32).sin_cos();
        let (length_u, length_v) = (along_u.length(), along_v.length());
        Ok(Self::Ellipse {
            center,
            lengths: [length_u, length_v],
            lean: along_u.dot(along_v) / (length_u * length_v).max(1e-20),
            axes: lesion.size_mm.map(|size| 0.5e-3 * size as f32),
            edge: 1e-3 * lesion.edge_mm as f32,
            turn: [cosine, sine],
        })
    }

    /// The share of the lesion, 0 to 1.
    fn at(&self, uv: Vec2) -> f32 {
        let (center, lengths, lean, axes, edge, turn) = match self {
            Self::Painted(image) => return image.at(uv).min(1.0),
            Self::Ellipse { center, lengths, lean, axes, edge, turn } => {
                (*center, *lengths, *lean, *axes, *edge, *turn)
            }
        };
        let [cosine, sine] = turn;
        let d = uv - center;
        let upright = (1.0 - lean * lean).max(0.0).sqrt();
        let (x, y) = (d.x * lengths[0] + d.y * lengths[1] * lean, d.y * lengths[1] * upright);
        let (p, q) = (x * cosine + y * sine, y * cosine - x * sine);
        let r = Vec2::new(p / axes[0], q / axes[1]).length();
        // Distance beyond the rim, to first order.
        let beyond = (r - 1.0) * axes[0].min(axes[1]);
        if edge <= 0.0 {
            return if beyond <= 0.0 { 1.0 } else { 0.0 };
        }
        let t = (0.5 - beyond / edge).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }

    /// The share at every pixel of a part; `None` where the lesion does not reach it. What is painted stays on its map.
    fn bake(&self, unfold: Unfold) -> Option<Vec<f32>> {
        let nearer = match (self, unfold) {
            (_, Unfold::Same) => None,
            (Self::Painted(_), Unfold::AcrossBorder) => return None,
            (Self::Ellipse { center, .. }, Unfold::AcrossBorder) => {
                Some(if center.x > 0.5 { 2.0 } else { 0.0 })
            }
        };
        let mask: Vec<f32> = (0..SIDE * SIDE)
            .map(|i| {
                let uv = pixel_center(i);
                self.at(nearer.map_or(uv, |twice_border| Vec2::new(twice_border - uv.x, uv.y)))
            })
            .collect();
        mask.iter().any(|&m| m > 0.0).then_some(mask)
    }
}

/// Least and greatest texture coordinates of a part.
fn uv_bounds(mesh: &TriangleMesh) -> [Vec2; 2] {
    let first = mesh.uvs.first().copied().unwrap_or_default();
    mesh.uvs.iter().fold([first, first], |[low, high], uv| [low.min(*uv), high.max(*uv)])
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

#[cfg(test)]
mod tests {
    use super::*;

    /// An ellipse of 12 by 6 mm on a map that is 60 mm wide and 80 mm long, its middle 1.8 mm from the left border.
    fn spot() -> Spot {
        Spot::Ellipse {
            center: Vec2::new(0.97, 0.3),
            lengths: [0.06, 0.08],
            lean: 0.0,
            axes: [3e-3, 6e-3],
            edge: 1e-3,
            turn: [1.0, 0.0],
        }
    }

    #[test]
    fn a_spot_on_the_border_of_the_tongue_goes_on_underneath() {
        let (back, under) = (spot().bake(Unfold::Same).unwrap(), spot().bake(Unfold::AcrossBorder).unwrap());
        let row = (0.7 * SIDE as f64) as usize;
        let at = |mask: &[f32], column: usize| mask[row * SIDE + column];
        // The same on both sides of the border, less and less away from the middle of the spot, nothing far from it.
        assert!((at(&back, SIDE - 1) - at(&under, SIDE - 1)).abs() < 0.25);
        assert!(at(&under, SIDE - 1) > 0.5, "{}", at(&under, SIDE - 1));
        for column in SIDE - 40..SIDE - 1 {
            assert!(at(&under, column) <= at(&under, column + 1));
        }
        assert_eq!((at(&under, SIDE / 2), at(&back, SIDE / 2)), (0.0, 0.0));
        // Its area is that of an ellipse cut by the border, both sides together the whole of it.
        let pixel_mm2 = 60.0 * 80.0 / (SIDE * SIDE) as f32;
        let area = (back.iter().sum::<f32>() + under.iter().sum::<f32>()) * pixel_mm2;
        let whole = std::f32::consts::PI * 3.0 * 6.0;
        // The edge is half a millimeter wide on each side, to first order in the distance from the rim.
        assert!((area / whole - 1.0).abs() < 0.03, "{area} mm2 of {whole}");
    }

    #[test]
    fn spots_end_with_their_part_but_for_those_of_the_tongue() {
        assert_eq!(continuation("tongue_lateral_left", "tongue_dorsum"), Some(Unfold::Same));
        assert_eq!(continuation("tongue_lateral_left", "tongue_ventral"), Some(Unfold::AcrossBorder));
        assert_eq!(continuation("tongue_ventral", "tongue_tip"), Some(Unfold::AcrossBorder));
        assert_eq!(continuation("cheek_left", "cheek_left"), Some(Unfold::Same));
        assert_eq!(continuation("cheek_left", "lower_lip"), None);
        assert_eq!(continuation("tongue_dorsum", "frenulum"), None);
    }
}
