//! Plain buffers made from a scene once, before any ray is traced.

use std::sync::Arc;

use fluorspar_accel::bands::{BLOCK, BandBlock, to_blocks};
use fluorspar_accel::{BuildError, Hit, Ray, Simd, TriangleBvh, prefetch};
use glam::{Vec2, Vec3};

use super::adjoint::{AdjointModel, BINS, Coarse};
use super::fluorescence_operator::{FluorescenceOperator, direct_exitance};
use super::instances::{CompiledInstances, InstanceList};
use crate::light::{Emitter, EnvironmentMap};
use crate::material::conductor::white_microfacets;
use crate::material::{
    CoatAlbedo, ConductorReflectance, DielectricAlbedo, NormalMap, ScalarTexture, Scattering,
};
use crate::sampling::{Rectangle, SampleStream, hash_u64, warp};
use crate::scene::irradiance::{SurfacePoint, direct_light, group_spectrum};
use crate::scene::{Scene, Shape};
use crate::spectral::{Curve, Reflectance};

/// Where a ray ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Target {
    /// A triangle, with barycentric coordinates.
    Triangle { triangle: u32, u: f32, v: f32 },
    /// A triangle of an instance of a mesh, with barycentric coordinates.
    Instance { instance: u32, triangle: u32, u: f32, v: f32 },
    /// An analytic shape of an object.
    Shape(u32),
    /// The surface of a light.
    Light(u32),
}

/// A point on a surface that a ray found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Intersection {
    pub(super) t: f32,
    pub(super) target: Target,
}

/// One distinct lamp spectrum of one light group.
#[derive(Debug)]
pub(super) struct Source {
    pub(super) group: usize,
    /// Bin averages, one per band.
    pub(super) bands: Vec<BandBlock>,
    /// Fluorescent exitance per unit irradiance and concentration, `[fluorophore][band]`.
    pub(super) exitance: Vec<Vec<BandBlock>>,
}

/// A light ready for sampling.
#[derive(Debug)]
pub(super) struct CompiledLight {
    pub(super) source: usize,
    pub(super) group: usize,
    pub(super) emitter: CompiledEmitter,
    /// Relative power, for choosing among lights.
    pub(super) power: f32,
}

#[derive(Debug)]
pub(super) enum CompiledEmitter {
    Disc {
        center: Vec3,
        normal: Vec3,
        tangents: (Vec3, Vec3),
        radius: f32,
        exponent: f32,
    },
    Rectangle {
        shape: Rectangle,
        exponent: f32,
    },
    Sphere {
        center: Vec3,
        radius: f32,
    },
    Point {
        position: Vec3,
        pattern: Option<(Vec3, f32)>,
    },
    Distant {
        direction: Vec3,
    },
    /// Emissive triangles of an object: first triangle in the scene's list, running areas, bounding sphere.
    Mesh {
        first_triangle: usize,
        cumulative_area: Vec<f32>,
        center: Vec3,
        radius: f32,
    },
    /// Emissive analytic object.
    ShapeObject {
        shape: usize,
    },
    /// Radiance by direction, with the source of each layer of the map.
    Environment {
        map: Arc<EnvironmentMap>,
        sources: Vec<usize>,
    },
}

/// How a material sends light on, with tables by index.
#[derive(Debug)]
pub(super) enum CompiledScattering {
    Diffuse,
    Dielectric { table: usize, roughness: ScalarTexture },
    Conductor { metal: usize, roughness: ScalarTexture },
    Mix { first: usize, second: usize, amount: ScalarTexture },
    TwoSided { front: usize, back: usize },
}

/// Spectra, coat and fluorophores of a material.
#[derive(Debug)]
pub(super) struct CompiledMaterial {
    pub(super) scattering: CompiledScattering,
    /// Terms of the spectrum that colours the chromatic lobe: the diffuse reflectance, the transmittance of a clear
    /// body, the basis of the reflectances of a metal.
    pub(super) reflectance: Vec<(Vec<BandBlock>, ScalarTexture)>,
    /// The same terms on coarse bins.
    pub(super) coarse_reflectance: Vec<Coarse>,
    pub(super) normal_map: Option<NormalMap>,
    pub(super) coat: Option<(usize, ScalarTexture)>,
    pub(super) fluorophores: Vec<(usize, ScalarTexture)>,
    /// Largest reflectance of any band, or a stand-in for surfaces that fluoresce, for choosing lobes. It does not depend
    /// on concentrations, so that changing them leaves all paths as they are.
    pub(super) albedo_bound: f32,
}

/// An analytic shape of an object.
#[derive(Debug)]
pub(super) struct CompiledShape {
    pub(super) object: usize,
    pub(super) shape: AnalyticShape,
}

#[derive(Debug)]
pub(super) enum AnalyticShape {
    Sphere { center: Vec3, radius: f32 },
    Disc { center: Vec3, normal: Vec3, tangents: (Vec3, Vec3), radius: f32 },
}

/// All that a hit needs of a vertex, half a cache line: a path waits for memory once instead of three times.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
struct MeshVertex {
    position: Vec3,
    /// Shading normal; zero for faceted meshes.
    normal: Vec3,
    uv: Vec2,
}

/// A triangle of a mesh.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
struct MeshTriangle {
    vertices: [u32; 3],
    object: u32,
}

/// Working memory for many rays at a time.
#[derive(Debug, Default)]
pub(super) struct TraceBuffers {
    hits: Vec<Option<Hit>>,
    blocked: Vec<bool>,
}

#[derive(Debug)]
pub(super) struct CompiledScene<'a> {
    pub(super) scene: &'a Scene,
    pub(super) bands: usize,
    /// Vector instructions for the spectra.
    pub(super) simd: Simd,
    /// How far rays start off the surface they leave, m: a millionth of the largest coordinate.
    pub(super) clearance: f32,
    bvh: TriangleBvh,
    /// Whether a path ever chooses between lobes or lamps.
    pub(super) chooses: bool,
    vertices: Vec<MeshVertex>,
    triangles: Vec<MeshTriangle>,
    /// Meshes at many places; `None` where there are none.
    pub(super) instances: Option<CompiledInstances>,
    pub(super) shapes: Vec<CompiledShape>,
    /// Sources in runs of `slices`: the excitation bins of one lamp spectrum.
    pub(super) sources: Vec<Source>,
    /// Excitation bins of every lamp spectrum; 1 unless they are kept apart.
    pub(super) slices: usize,
    pub(super) lights: Vec<CompiledLight>,
    /// Lights of each group that can be sampled.
    pub(super) group_lights: Vec<Vec<usize>>,
    /// Emissive objects: their light.
    pub(super) object_light: Vec<Option<usize>>,
    /// Sources that shine from every direction beyond the scene.
    pub(super) environment: Vec<usize>,
    pub(super) materials: Vec<CompiledMaterial>,
    pub(super) coats: Vec<Arc<CoatAlbedo>>,
    pub(super) dielectrics: Vec<Arc<DielectricAlbedo>>,
    pub(super) metals: Vec<ConductorReflectance>,
    /// What paths can still carry.
    pub(super) adjoint: AdjointModel,
    /// Opacity of each object whose material has holes; empty when there is none in the scene.
    cutouts: Vec<Option<ScalarTexture>>,
    /// Lights that are environment maps.
    pub(super) environment_maps: Vec<usize>,
    /// `[group and excitation bin][fluorophore]`, excitation weighted by the group's lamps.
    pub(super) lamp_operators: Vec<Vec<FluorescenceOperator>>,
    /// `[fluorophore]`, evenly weighted, for light that already fluoresced.
    pub(super) plain_operators: Vec<FluorescenceOperator>,
}

/// What a fluorescent surface is taken to send on at least: its light matters even where it reflects little.
const FLUORESCENT_ALBEDO: f32 = 0.25;

impl<'a> CompiledScene<'a> {
    /// `excitation_edges_nm` are the edges of the excitation bins to keep apart, increasing; none for one component per
    /// light group.
    pub(super) fn new(scene: &'a Scene, excitation_edges_nm: &[f64]) -> Result<Self, BuildError> {
        let grid = &scene.grid;
        let mut vertices: Vec<MeshVertex> = Vec::new();
        let mut corners: Vec<[u32; 3]> = Vec::new();
        let mut triangle_object = Vec::new();
        let mut instances = InstanceList::default();
        let mut shapes = Vec::new();
        let mut sources: Vec<Source> = Vec::new();
        let mut lights = Vec::new();
        let mut environment = Vec::new();
        let mut environment_maps = Vec::new();
        let mut object_light = vec![None; scene.objects.len()];

        let slices = excitation_edges_nm.len().max(1);
        let mut lamps: Vec<(usize, Curve)> = Vec::new();
        let mut source_of = |group: usize, curve: &Curve| {
            if let Some(found) = lamps.iter().position(|(g, known)| *g == group && known == curve) {
                return found * slices;
            }
            lamps.push((group, curve.clone()));
            for (slice, curve) in excitation_slices(curve, excitation_edges_nm).into_iter().enumerate() {
                let bands = to_blocks(&single(curve.on_grid::<Reflectance>(grid).values()));
                let exitance = scene
                    .fluorophores
                    .iter()
                    .map(|f| to_blocks(&single(&direct_exitance(&f.eem, grid, &curve))))
                    .collect();
                sources.push(Source { group: group * slices + slice, bands, exitance });
            }
            (lamps.len() - 1) * slices
        };

        for (object, item) in scene.objects.iter().enumerate() {
            let flattened;
            let mesh = match &item.shape {
                Shape::Mesh(mesh) => Some(&**mesh),
                // Lamps are sampled triangle by triangle, by the areas that these have at their places.
                Shape::Instances(many) if item.emission.is_some() => {
                    flattened = many.flattened();
                    Some(&flattened)
                }
                Shape::Instances(many) => {
                    instances.add(object, many);
                    continue;
                }
                Shape::Sphere { .. } | Shape::Disc { .. } => None,
            };
            let emissive = match (&item.shape, mesh) {
                (Shape::Mesh(_) | Shape::Instances(_), None) => continue,
                (_, Some(mesh)) => {
                    let offset = vertices.len() as u32;
                    let first_triangle = corners.len();
                    vertices.extend(mesh.positions.iter().enumerate().map(|(index, &position)| MeshVertex {
                        position,
                        normal: mesh.normals.get(index).copied().unwrap_or(Vec3::ZERO),
                        uv: mesh.uvs.get(index).copied().unwrap_or(Vec2::ZERO),
                    }));
                    corners.extend(mesh.triangles.iter().map(|t| t.map(|v| v + offset)));
                    triangle_object.extend(std::iter::repeat_n(object as u32, mesh.triangles.len()));
                    let mut sum = 0.0_f64;
                    let cumulative_area = mesh
                        .triangles
                        .iter()
                        .map(|t| {
                            sum += f64::from(mesh.triangle_cross(t).length()) * 0.5;
                            sum as f32
                        })
                        .collect();
                    let (low, high) = mesh.bounds();
                    let (center, radius) = (0.5 * (low + high), 0.5 * (high - low).length());
                    CompiledEmitter::Mesh { first_triangle, cumulative_area, center, radius }
                }
                (Shape::Sphere { center, radius_m }, _) => {
                    let shape = AnalyticShape::Sphere { center: *center, radius: *radius_m };
                    shapes.push(CompiledShape { object, shape });
                    CompiledEmitter::ShapeObject { shape: shapes.len() - 1 }
                }
                (Shape::Disc { center, normal, radius_m }, _) => {
                    let tangents = warp::tangents(*normal);
                    let shape =
                        AnalyticShape::Disc { center: *center, normal: *normal, tangents, radius: *radius_m };
                    shapes.push(CompiledShape { object, shape });
                    CompiledEmitter::ShapeObject { shape: shapes.len() - 1 }
                }
            };
            if let Some(emission) = &item.emission {
                let source = source_of(emission.group, &emission.radiance);
                object_light[object] = Some(lights.len());
                let area = match &item.shape {
                    Shape::Mesh(_) | Shape::Instances(_) => mesh.map_or(0.0, |mesh| mesh.area_m2() as f32),
                    Shape::Sphere { radius_m, .. } => 4.0 * std::f32::consts::PI * radius_m * radius_m,
                    Shape::Disc { radius_m, .. } => std::f32::consts::PI * radius_m * radius_m,
                };
                let power =
                    (emission.radiance.total() as f32 * area * std::f32::consts::PI).max(f32::MIN_POSITIVE);
                lights.push(CompiledLight { source, group: emission.group, emitter: emissive, power });
            }
        }

        for light in &scene.lights {
            let power = (light.spectrum.total() as f32).max(f32::MIN_POSITIVE);
            let emitter = match &light.emitter {
                Emitter::Disc { center, normal, radius_m, exponent } => CompiledEmitter::Disc {
                    center: *center,
                    normal: *normal,
                    tangents: warp::tangents(*normal),
                    radius: *radius_m,
                    exponent: *exponent,
                },
                Emitter::Rectangle { corner, edge_u, edge_v, exponent } => {
                    let shape = Rectangle::new(*corner, *edge_u, *edge_v);
                    CompiledEmitter::Rectangle { shape, exponent: *exponent }
                }
                Emitter::Sphere { center, radius_m } => {
                    CompiledEmitter::Sphere { center: *center, radius: *radius_m }
                }
                Emitter::Point { position, pattern } => {
                    CompiledEmitter::Point { position: *position, pattern: *pattern }
                }
                Emitter::Distant { direction } => CompiledEmitter::Distant { direction: *direction },
                Emitter::Environment => {
                    let source = source_of(light.group, &light.spectrum);
                    environment.extend(source..source + slices);
                    continue;
                }
                Emitter::EnvironmentMap(map) => {
                    let layer_source = |layer: &crate::light::EnvironmentLayer| {
                        source_of(light.group, &light.spectrum.times(&layer.spectrum))
                    };
                    let sources: Vec<usize> = map.layers().iter().map(layer_source).collect();
                    let source = sources[0];
                    environment_maps.push(lights.len());
                    let emitter = CompiledEmitter::Environment { map: Arc::clone(map), sources };
                    let power = (light.whole_spectrum().total() as f32).max(f32::MIN_POSITIVE);
                    lights.push(CompiledLight { source, group: light.group, emitter, power });
                    continue;
                }
            };
            let source = source_of(light.group, &light.spectrum);
            lights.push(CompiledLight { source, group: light.group, emitter, power });
        }

        let group_lights: Vec<Vec<usize>> = (0..scene.light_groups.len())
            .map(|group| (0..lights.len()).filter(|&l| lights[l].group == group).collect())
            .collect();

        let positions: Vec<Vec3> = vertices.iter().map(|vertex| vertex.position).collect();
        let bvh = TriangleBvh::build(&positions, &corners)?;
        let instances = instances.build()?;
        let group_spectra = {
            let corners = |triangle: u32| corners[triangle as usize].map(|v| positions[v as usize]);
            // Lamps of all kinds, weighed by the irradiance that they throw on what is seen: the shape of the sum weights
            // excitation within a bin.
            let points = points_in_view(scene, &bvh, corners, &triangle_object, instances.as_ref(), &shapes);
            let parts = direct_light(scene, &points);
            (0..scene.light_groups.len()).map(|group| group_spectrum(&parts, group)).collect::<Vec<_>>()
        };
        let reach = positions.iter().map(|p| p.abs().max_element()).fold(0.0, f32::max);
        drop(positions);
        let triangles = corners
            .into_iter()
            .zip(triangle_object)
            .map(|(vertices, object)| MeshTriangle { vertices, object })
            .collect();
        let adjoint = AdjointModel::new(grid);
        let mut coats: Vec<Arc<CoatAlbedo>> = Vec::new();
        let mut dielectrics: Vec<Arc<DielectricAlbedo>> = Vec::new();
        let mut metals: Vec<ConductorReflectance> = Vec::new();
        let materials: Vec<CompiledMaterial> = scene
            .materials
            .iter()
            .map(|material| {
                let on_bands =
                    |curve: &Curve| to_blocks(&single(curve.on_grid::<Reflectance>(grid).values()));
                let uniform = ScalarTexture::Constant(1.0);
                let (scattering, reflectance, coarse_reflectance) = match &material.scattering {
                    Scattering::Diffuse => (
                        CompiledScattering::Diffuse,
                        material
                            .reflectance
                            .iter()
                            .map(|t| (on_bands(&t.spectrum), t.weight.clone()))
                            .collect(),
                        material.reflectance.iter().map(|term| adjoint.coarse(&term.spectrum)).collect(),
                    ),
                    Scattering::Dielectric(glass) => {
                        let index = glass.refractive_index;
                        let table = dielectrics
                            .iter()
                            .position(|d| d.refractive_index() == index)
                            .unwrap_or_else(|| {
                                dielectrics.push(DielectricAlbedo::shared(index));
                                dielectrics.len() - 1
                            });
                        let roughness = glass.roughness.clone();
                        (
                            CompiledScattering::Dielectric { table, roughness },
                            vec![(on_bands(&glass.transmittance), uniform)],
                            vec![adjoint.coarse(&glass.transmittance)],
                        )
                    }
                    Scattering::Conductor(conductor) => {
                        let metal = ConductorReflectance::new(conductor, grid, white_microfacets());
                        let centres = grid.centers_nm();
                        let coarse = |term: &Vec<f32>| {
                            let values = term.iter().map(|&f| f64::from(f)).collect();
                            Curve::new(centres.clone(), values)
                                .map_or([0.0; BINS], |curve| adjoint.coarse(&curve))
                        };
                        let terms =
                            metal.basis().iter().map(|term| (to_blocks(term), uniform.clone())).collect();
                        let coarse = metal.basis().iter().map(coarse).collect();
                        metals.push(metal);
                        let roughness = conductor.roughness.clone();
                        (CompiledScattering::Conductor { metal: metals.len() - 1, roughness }, terms, coarse)
                    }
                    Scattering::Mix { first, second, amount } => (
                        CompiledScattering::Mix { first: *first, second: *second, amount: amount.clone() },
                        Vec::new(),
                        Vec::new(),
                    ),
                    Scattering::TwoSided { front, back } => {
                        (CompiledScattering::TwoSided { front: *front, back: *back }, Vec::new(), Vec::new())
                    }
                };
                let coat = material.coat.as_ref().map(|coat| {
                    let index = coats
                        .iter()
                        .position(|c| c.refractive_index() == coat.refractive_index)
                        .unwrap_or_else(|| {
                            coats.push(CoatAlbedo::shared(coat.refractive_index));
                            coats.len() - 1
                        });
                    (index, coat.roughness.clone())
                });
                let fluorophores: Vec<(usize, ScalarTexture)> =
                    material.fluorophores.iter().map(|a| (a.fluorophore, a.concentration.clone())).collect();
                let terms: &Vec<(Vec<BandBlock>, ScalarTexture)> = &reflectance;
                let elastic = (0..grid.len())
                    .map(|band| {
                        let at = |r: &[BandBlock]| r[band / BLOCK].0[band % BLOCK];
                        terms.iter().map(|(r, weight)| at(r) * weight.max()).sum()
                    })
                    .fold(0.0, f32::max);
                let albedo_bound =
                    if fluorophores.is_empty() { elastic } else { elastic.max(FLUORESCENT_ALBEDO) };
                CompiledMaterial {
                    scattering,
                    reflectance,
                    coarse_reflectance,
                    normal_map: material.normal_map.clone(),
                    coat,
                    fluorophores,
                    albedo_bound,
                }
            })
            .collect();
        let mut cutouts: Vec<Option<ScalarTexture>> =
            scene.objects.iter().map(|object| scene.materials[object.material].opacity.clone()).collect();
        if cutouts.iter().all(Option::is_none) {
            cutouts.clear();
        }

        let lamp_operators = group_spectra
            .iter()
            .flat_map(|spectrum| match spectrum {
                Some(spectrum) => {
                    excitation_slices(spectrum, excitation_edges_nm).into_iter().map(Some).collect()
                }
                None => vec![None; slices],
            })
            .map(|lamp| {
                scene
                    .fluorophores
                    .iter()
                    .map(|f| FluorescenceOperator::new(&f.eem, grid, lamp.as_ref()))
                    .collect()
            })
            .collect();
        let plain_operators =
            scene.fluorophores.iter().map(|f| FluorescenceOperator::new(&f.eem, grid, None)).collect();

        let shape_reach = shapes
            .iter()
            .map(|s| match &s.shape {
                AnalyticShape::Sphere { center, radius } | AnalyticShape::Disc { center, radius, .. } => {
                    center.abs().max_element() + radius
                }
            })
            .fold(0.0, f32::max);

        let instance_reach = instances.as_ref().map_or(0.0, CompiledInstances::reach);

        let plain = |material: &CompiledMaterial| {
            matches!(material.scattering, CompiledScattering::Diffuse) && material.coat.is_none()
        };
        let chooses = !materials.iter().all(plain) || group_lights.iter().any(|lights| lights.len() > 1);

        let mut compiled = Self {
            scene,
            chooses,
            bands: grid.len(),
            simd: Simd::detect(),
            clearance: (1e-6 * reach.max(shape_reach).max(instance_reach)).max(1e-9),
            bvh,
            vertices,
            triangles,
            instances,
            shapes,
            sources,
            slices,
            lights,
            group_lights,
            object_light,
            environment,
            materials,
            coats,
            dielectrics,
            metals,
            adjoint,
            cutouts,
            environment_maps,
            lamp_operators,
            plain_operators,
        };
        let reverberation = compiled.reverberation();
        compiled.adjoint.fill_in(scene, &group_spectra, &reverberation);
        Ok(compiled)
    }

    /// All light that arrives at what is seen over the light that arrives directly, on coarse bins: `1 / (1 - r)` of a
    /// closed room, with the mean reflectance `r` of what rays find that leave the visible surfaces diffusely; nothing
    /// reflects nothing.
    fn reverberation(&self) -> Coarse {
        let camera = &self.scene.camera;
        let place = |i: usize, side: usize| (i as f32 + 0.5) / VIEW_RAYS as f32 * side as f32;
        let (mut sum, mut rays) = ([0.0_f32; BINS], 0.0_f32);
        for number in 0..VIEW_RAYS * VIEW_RAYS {
            let (origin, direction) =
                camera.ray(place(number % VIEW_RAYS, camera.width), place(number / VIEW_RAYS, camera.height));
            let surface = |origin: Vec3, direction: Vec3| {
                self.closest(origin, direction).and_then(|hit| self.surface(origin, direction, &hit))
            };
            let Some(seen) = surface(origin, direction) else { continue };
            let mut stream = SampleStream::new(0, number as u64, 0);
            let [u, v, mut choice, _] = stream.next_4d();
            let away = seen.to_world(warp::cosine_hemisphere([u, v]));
            rays += 1.0;
            let Some(met) = surface(seen.leave(away, self.clearance), away) else { continue };
            let outermost = self.scene.objects[met.object].material;
            let material = &self.materials[self.material_at(outermost, met.uv, met.front, &mut choice)];
            let bsdf = self.bsdf(material, met.uv, met.front, met.to_local(-away));
            let terms = material.reflectance.iter().zip(&material.coarse_reflectance).enumerate();
            for (term, ((_, weight), coarse)) in terms {
                let weight = bsdf.term_weight(term, weight.at(met.uv));
                sum.iter_mut().zip(coarse).for_each(|(sum, value)| *sum += weight * value);
            }
        }
        sum.map(|sum| 1.0 / (1.0 - (sum / rays.max(1.0)).clamp(0.0, MOST_REVERBERANT)))
    }

    /// Vertices of a triangle.
    #[inline]
    fn vertices_of(&self, triangle: usize) -> [&MeshVertex; 3] {
        self.triangles[triangle].vertices.map(|v| &self.vertices[v as usize])
    }

    /// Memory of the surfaces with their trees, bytes.
    pub(super) fn surface_bytes(&self) -> u64 {
        let arrays = self.vertices.capacity() * size_of::<MeshVertex>()
            + self.triangles.capacity() * size_of::<MeshTriangle>();
        let instances = self.instances.as_ref().map_or(0, CompiledInstances::memory_bytes);
        (arrays + self.bvh.memory_bytes() + instances) as u64
    }

    /// Corners of a triangle.
    #[inline]
    pub(super) fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.vertices_of(triangle).map(|vertex| vertex.position)
    }

    /// Interpolated normal (zero for faceted meshes) and texture coordinates.
    #[inline]
    pub(super) fn attributes(&self, triangle: usize, u: f32, v: f32) -> (Vec3, Vec2) {
        let [a, b, c] = self.vertices_of(triangle);
        let w = 1.0 - u - v;
        (a.normal * w + b.normal * u + c.normal * v, a.uv * w + b.uv * u + c.uv * v)
    }

    /// Texture coordinates of the corners of a triangle.
    pub(super) fn texture_corners(&self, triangle: usize) -> [Vec2; 3] {
        self.vertices_of(triangle).map(|vertex| vertex.uv)
    }

    /// Object that a triangle belongs to.
    #[inline]
    pub(super) fn object_of(&self, triangle: usize) -> usize {
        self.triangles[triangle].object as usize
    }

    /// [`Self::closest`] of every ray, in their order.
    pub(super) fn closest_each(
        &self,
        rays: &[Ray],
        buffers: &mut TraceBuffers,
        found: &mut Vec<Option<Intersection>>,
    ) {
        found.clear();
        if self.cutouts.is_empty() {
            self.bvh.closest_each(rays, &mut buffers.hits);
            found.extend(rays.iter().zip(&buffers.hits).map(|(ray, hit)| self.nearest_given(ray, *hit)));
        } else {
            found.extend(rays.iter().map(|ray| self.closest(ray.origin, ray.direction)));
        }
        // What the hits need next is on its way while the first of them are worked on.
        let triangles = || {
            found.iter().filter_map(|hit| match hit {
                Some(Intersection { target: Target::Triangle { triangle, .. }, .. }) => {
                    Some(*triangle as usize)
                }
                _ => None,
            })
        };
        triangles().for_each(|triangle| prefetch(&self.triangles, triangle));
        for triangle in triangles() {
            for vertex in self.triangles[triangle].vertices {
                prefetch(&self.vertices, vertex as usize);
            }
        }
    }

    /// [`Self::visibility`] of every ray, in their order; `aimed_at` are the lights.
    pub(super) fn visibility_each(
        &self,
        rays: &[Ray],
        aimed_at: impl Iterator<Item = usize>,
        buffers: &mut TraceBuffers,
        visible: &mut Vec<f32>,
    ) {
        visible.clear();
        let rays_to_lights = rays.iter().zip(aimed_at);
        if self.cutouts.is_empty() {
            self.bvh.occluded_each(rays, &mut buffers.blocked);
            visible.extend(rays_to_lights.zip(&buffers.blocked).map(|((ray, light), blocked)| {
                if *blocked || self.occluded_elsewhere(ray, light) { 0.0 } else { 1.0 }
            }));
        } else {
            visible.extend(
                rays_to_lights
                    .map(|(ray, light)| self.visibility(ray.origin, ray.direction, ray.t_max, light)),
            );
        }
    }

    /// Nearest surface or light along a ray. Surfaces with holes are there with the probability of their opacity, by
    /// a hash of the ray and the place.
    pub(super) fn closest(&self, origin: Vec3, direction: Vec3) -> Option<Intersection> {
        let mut hit = self.nearest(origin, direction, f32::INFINITY)?;
        if self.cutouts.is_empty() {
            return Some(hit);
        }
        let mut start = origin;
        let mut walked = 0.0;
        loop {
            let opacity = self.opacity(start, direction, &hit);
            if opacity >= 1.0 || chance(start, direction, hit.t) < opacity {
                return Some(Intersection { t: walked + hit.t, target: hit.target });
            }
            let step = hit.t + self.clearance.max(1e-6 * hit.t);
            walked += step;
            start += direction * step;
            hit = self.nearest(start, direction, f32::INFINITY)?;
        }
    }

    /// Opacity of a surface at an intersection; lights are opaque.
    fn opacity(&self, origin: Vec3, direction: Vec3, hit: &Intersection) -> f32 {
        let object = match hit.target {
            Target::Light(_) => return 1.0,
            Target::Triangle { triangle, .. } => self.object_of(triangle as usize),
            Target::Instance { instance, .. } => match &self.instances {
                Some(instances) => instances.object_of(instance),
                None => return 1.0,
            },
            Target::Shape(index) => self.shapes[index as usize].object,
        };
        match self.cutouts.get(object) {
            Some(Some(texture)) => match self.surface(origin, direction, hit) {
                Some(point) => texture.at(point.uv).clamp(0.0, 1.0),
                None => 1.0,
            },
            _ => 1.0,
        }
    }

    /// Share of light that passes between a point and `t_max` along a direction: 0 behind opaque surfaces, between 0
    /// and 1 behind those with holes. The light aimed at does not count.
    pub(super) fn visibility(&self, origin: Vec3, direction: Vec3, t_max: f32, aimed_at: usize) -> f32 {
        if self.cutouts.is_empty() {
            return if self.occluded(origin, direction, t_max, aimed_at) { 0.0 } else { 1.0 };
        }
        let (mut start, mut left, mut share) = (origin, t_max, 1.0);
        while let Some(hit) = self.nearest(start, direction, left) {
            let aimed = matches!(hit.target, Target::Light(light) if light as usize == aimed_at);
            if !aimed {
                share *= 1.0 - self.opacity(start, direction, &hit);
            }
            if share <= 0.0 {
                return 0.0;
            }
            let step = hit.t + self.clearance.max(1e-6 * hit.t);
            start += direction * step;
            left -= step;
            if left <= 0.0 {
                break;
            }
        }
        share
    }

    /// Nearest surface or light along a ray within `t_max`, holes ignored.
    fn nearest(&self, origin: Vec3, direction: Vec3, t_max: f32) -> Option<Intersection> {
        let ray = Ray { origin, direction, t_min: 0.0, t_max };
        self.nearest_given(&ray, self.bvh.closest(&ray))
    }

    /// Nearest surface or light along a ray whose nearest triangle is known.
    #[inline]
    fn nearest_given(&self, ray: &Ray, hit: Option<Hit>) -> Option<Intersection> {
        let Ray { origin, direction, t_max, .. } = *ray;
        let mut best = hit.map(|hit| Intersection {
            t: hit.t,
            target: Target::Triangle { triangle: hit.triangle, u: hit.u, v: hit.v },
        });
        let mut limit = best.map_or(t_max, |hit| hit.t);
        if let Some(instances) = &self.instances
            && let Some((t, instance, triangle, u, v)) = instances.closest(&Ray { t_max: limit, ..*ray })
        {
            limit = t;
            best = Some(Intersection { t, target: Target::Instance { instance, triangle, u, v } });
        }
        for (index, shape) in self.shapes.iter().enumerate() {
            if let Some(t) = shape.shape.intersect(origin, direction, limit) {
                limit = t;
                best = Some(Intersection { t, target: Target::Shape(index as u32) });
            }
        }
        for (index, light) in self.lights.iter().enumerate() {
            if let Some(t) = light.emitter.intersect(origin, direction, limit) {
                limit = t;
                best = Some(Intersection { t, target: Target::Light(index as u32) });
            }
        }
        best
    }

    /// Whether anything lies between a point and `t_max` along a direction; the light aimed at does not count.
    fn occluded(&self, origin: Vec3, direction: Vec3, t_max: f32, aimed_at: usize) -> bool {
        let ray = Ray { origin, direction, t_min: 0.0, t_max };
        self.bvh.occluded(&ray) || self.occluded_elsewhere(&ray, aimed_at)
    }

    /// Whether an instance, an analytic shape or a light other than the one aimed at is in the way.
    #[inline]
    fn occluded_elsewhere(&self, ray: &Ray, aimed_at: usize) -> bool {
        let Ray { origin, direction, t_max, .. } = *ray;
        self.instances.as_ref().is_some_and(|instances| instances.bvh.occluded(ray))
            || self.shapes.iter().any(|s| s.shape.intersect(origin, direction, t_max).is_some())
            || self.lights.iter().enumerate().any(|(l, light)| {
                l != aimed_at && light.emitter.intersect(origin, direction, t_max).is_some()
            })
    }
}

/// In single precision.
fn single(values: &[f64]) -> Vec<f32> {
    values.iter().map(|&value| value as f32).collect()
}

/// A lamp spectrum cut at the edges, then what lies outside of them; their sum is the spectrum.
fn excitation_slices(curve: &Curve, edges_nm: &[f64]) -> Vec<Curve> {
    let [first, .., last] = edges_nm else { return vec![curve.clone()] };
    let mut slices: Vec<Curve> = edges_nm.windows(2).map(|edges| curve.clipped(edges[0], edges[1])).collect();
    let (low, high) = curve.range_nm();
    let mut nodes: Vec<(f64, f64)> = Vec::new();
    // Zero between two steep flanks: a curve can't jump.
    const FLANK_NM: f64 = 1e-6;
    for (start, end) in [(low, last.min(*first)), (first.max(*last), high)] {
        if start < end {
            let part = curve.clipped(start, end);
            nodes.push((start - FLANK_NM, 0.0));
            nodes.extend(part.wavelengths_nm().iter().copied().zip(part.values().iter().copied()));
            nodes.push((end + FLANK_NM, 0.0));
        }
    }
    let (wavelengths, values) = nodes.into_iter().unzip();
    slices.push(Curve::new(wavelengths, values).unwrap_or_else(|_| curve.scaled(0.0)));
    slices
}

/// A number in `[0, 1)` from the bits of a ray and a place along it.
fn chance(origin: Vec3, direction: Vec3, t: f32) -> f32 {
    let mut hash = u64::from(t.to_bits());
    for value in origin.to_array().into_iter().chain(direction.to_array()) {
        hash = hash_u64(hash ^ u64::from(value.to_bits()));
    }
    (hash >> 40) as f32 / 16_777_216.0
}

/// Mean reflectance beyond which a room is not taken to be brighter.
const MOST_REVERBERANT: f32 = 0.95;

/// Rays along each side of the image whose hits stand for the scene when lamps are weighed against each other.
const VIEW_RAYS: usize = 12;

/// Places that the camera sees, on its side: those that fluoresce, or all if none does. Holes and lamps are looked
/// through.
fn points_in_view(
    scene: &Scene,
    bvh: &TriangleBvh,
    corners: impl Fn(u32) -> [Vec3; 3],
    triangle_object: &[u32],
    instances: Option<&CompiledInstances>,
    shapes: &[CompiledShape],
) -> Vec<SurfacePoint> {
    let camera = &scene.camera;
    let step = |i: usize, side: usize| (i as f32 + 0.5) / VIEW_RAYS as f32 * side as f32;
    let hits: Vec<(usize, SurfacePoint)> = (0..VIEW_RAYS * VIEW_RAYS)
        .filter_map(|i| {
            let (origin, direction) =
                camera.ray(step(i % VIEW_RAYS, camera.width), step(i / VIEW_RAYS, camera.height));
            let ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
            let mut nearest = bvh.closest(&ray).map(|hit| {
                let [a, b, c] = corners(hit.triangle);
                (hit.t, triangle_object[hit.triangle as usize] as usize, (b - a).cross(c - a))
            });
            let within = Ray { t_max: nearest.map_or(f32::INFINITY, |(t, ..)| t), ..ray };
            if let Some(instances) = instances
                && let Some((t, instance, triangle, ..)) = instances.closest(&within)
            {
                let [a, b, c] = instances.corners(instance, triangle);
                nearest = Some((t, instances.object_of(instance), (b - a).cross(c - a)));
            }
            for shape in shapes {
                let limit = nearest.map_or(f32::INFINITY, |(t, ..)| t);
                if let Some(t) = shape.shape.intersect(origin, direction, limit) {
                    let normal = match &shape.shape {
                        AnalyticShape::Sphere { center, .. } => origin + direction * t - *center,
                        AnalyticShape::Disc { normal, .. } => *normal,
                    };
                    nearest = Some((t, shape.object, normal));
                }
            }
            let (t, object, normal) = nearest?;
            let normal = normal.as_dvec3().try_normalize()?;
            let normal = if normal.dot(direction.as_dvec3()) > 0.0 { -normal } else { normal };
            Some((object, SurfacePoint { position: (origin + direction * t).as_dvec3(), normal }))
        })
        .collect();
    let fluoresces = |object: usize| {
        let mut parts = vec![scene.objects[object].material];
        while let Some(part) = parts.pop() {
            let material = &scene.materials[part];
            match &material.scattering {
                Scattering::Mix { first, second, .. } => parts.extend([*first, *second]),
                Scattering::TwoSided { front, back } => parts.extend([*front, *back]),
                _ if !material.fluorophores.is_empty() => return true,
                _ => {}
            }
        }
        false
    };
    let any = hits.iter().any(|(object, _)| fluoresces(*object));
    hits.into_iter().filter(|(object, _)| !any || fluoresces(*object)).map(|(_, point)| point).collect()
}

impl AnalyticShape {
    /// Smallest positive distance below `limit`.
    pub(super) fn intersect(&self, origin: Vec3, direction: Vec3, limit: f32) -> Option<f32> {
        match self {
            Self::Sphere { center, radius } => intersect_sphere(origin, direction, *center, *radius, limit),
            Self::Disc { center, normal, radius, .. } => {
                intersect_disc(origin, direction, *center, *normal, *radius, limit)
            }
        }
    }
}

impl CompiledEmitter {
    /// Distance to the surface of a light that is no object; both sides block.
    #[inline]
    fn intersect(&self, origin: Vec3, direction: Vec3, limit: f32) -> Option<f32> {
        match self {
            Self::Disc { center, normal, radius, .. } => {
                intersect_disc(origin, direction, *center, *normal, *radius, limit)
            }
            Self::Rectangle { shape, .. } => {
                let t = intersect_plane(origin, direction, shape.corner(), shape.normal(), limit)?;
                shape.contains(origin + direction * t).then_some(t)
            }
            Self::Sphere { center, radius } => intersect_sphere(origin, direction, *center, *radius, limit),
            Self::Point { .. }
            | Self::Distant { .. }
            | Self::Mesh { .. }
            | Self::ShapeObject { .. }
            | Self::Environment { .. } => None,
        }
    }
}

fn intersect_plane(origin: Vec3, direction: Vec3, point: Vec3, normal: Vec3, limit: f32) -> Option<f32> {
    let cos = direction.dot(normal);
    if cos == 0.0 {
        return None;
    }
    let t = (point - origin).dot(normal) / cos;
    (t > 0.0 && t < limit).then_some(t)
}

fn intersect_disc(
    origin: Vec3,
    direction: Vec3,
    center: Vec3,
    normal: Vec3,
    radius: f32,
    limit: f32,
) -> Option<f32> {
    let t = intersect_plane(origin, direction, center, normal, limit)?;
    ((origin + direction * t - center).length_squared() <= radius * radius).then_some(t)
}

/// Robust quadratic (Haines et al., Ray Tracing Gems, chapter 7): the discriminant from the point of closest approach.
fn intersect_sphere(origin: Vec3, direction: Vec3, center: Vec3, radius: f32, limit: f32) -> Option<f32> {
    let f = origin - center;
    let b = -f.dot(direction);
    let closest = f + direction * b;
    let discriminant = radius * radius - closest.length_squared();
    if discriminant < 0.0 {
        return None;
    }
    let c = f.length_squared() - radius * radius;
    let q = b + discriminant.sqrt().copysign(b);
    let (t0, t1) = if q == 0.0 { (0.0, 0.0) } else { (c / q, q) };
    let (near, far) = if t0 < t1 { (t0, t1) } else { (t1, t0) };
    [near, far].into_iter().find(|&t| t > 0.0 && t < limit)
}
