//! A scene as plain buffers: what rays and spectra need, made once by `compile`.

use std::ops::Range;

use fluorspar_accel::bands::{self, BandBlock, to_blocks};
use fluorspar_accel::{Lanes, Simd, TriangleBvh};
use glam::{Vec2, Vec3};

use super::excitation::Excitation;
use super::fluorescence_operator::FluorescenceOperator;
use super::instances::CompiledInstances;
use super::light_targets::LightTargets;
use super::material_spread::MaterialSpread;
use super::survival_probability::{Coarse, RouletteModel};
use crate::geometry::{intersect_disc, intersect_sphere};
use crate::light::{LightBounds, PreparedEmitter};
use crate::material::PreparedMaterials;
use crate::optics::PerspectiveCamera;
use crate::spectral::WavelengthGrid;
use crate::tissue::EMITTED_NM;

/// One distinct spectrum of the lights of one group.
#[derive(Debug)]
pub(super) struct Source {
    /// Number among the spectra that are kept apart of all groups.
    pub(super) group: usize,
    /// Bin averages, one per band.
    pub(super) bands: Vec<BandBlock>,
    /// Fluorescent exitance per unit irradiance and concentration, `[matrix][band]`.
    pub(super) exitance: Vec<Vec<BandBlock>>,
}

/// The excitation nodes of one light group.
#[derive(Debug)]
pub(super) struct BasisGroup {
    /// Number of the first node among the spectra that are kept apart of all groups.
    pub(super) first: usize,
    /// The nodes.
    pub(super) nodes: Vec<BasisNode>,
    /// Sources of the group that shine by themselves, each with the factor of its hats.
    pub(super) sources: Vec<(usize, f32)>,
}

/// The hat of a node.
#[derive(Debug)]
pub(super) struct BasisNode {
    /// Bands in which it is not dark.
    pub(super) bands: Range<usize>,
    /// Bands of which it keeps reflected light, those outside the nodes as well, and what it keeps in each.
    pub(super) reflected_bands: Range<usize>,
    pub(super) reflected: Vec<f32>,
    /// Fluorescent exitance per unit concentration under what each of its bands holds of the hat, `[matrix][band of the hat][block]`.
    pub(super) columns: Vec<Vec<BandBlock>>,
}

/// A light ready for sampling.
#[derive(Debug)]
pub(super) struct CompiledLight {
    /// Source of its spectrum; of an environment map that of the first layer.
    pub(super) source: usize,
    /// Sources of all its spectra.
    pub(super) sources: Vec<usize>,
    pub(super) group: usize,
    /// Whether what the first surface mirrors of it does not reach the camera ([`Light::crossed_polarizers`](crate::light::Light)).
    pub(super) crossed_polarizers: bool,
    pub(super) emitter: PreparedEmitter,
    /// Place and direction, for choosing among lights.
    pub(super) bounds: LightBounds,
    /// Relative power, likewise.
    pub(super) power: f32,
}

/// The spectra of a material.
#[derive(Debug)]
pub(super) struct MaterialSpectra {
    /// Terms of the spectrum of a point, see `PreparedMaterial::terms`.
    pub(super) terms: Vec<Vec<BandBlock>>,
    /// The same terms on coarse bins.
    pub(super) coarse_terms: Vec<Coarse>,
    /// Fluorophores, in the order of their concentrations.
    pub(super) emitters: Vec<Emitter>,
    /// Numbers of its fluorophores, each once.
    pub(super) fluorophores: Vec<usize>,
    /// How far from where it enters light leaves; `None` where it leaves where it enters.
    pub(super) spread: Option<MaterialSpread>,
}

/// A fluorophore in a material.
#[derive(Clone, Copy, Debug)]
pub(super) struct Emitter {
    /// Number of the fluorophore, and so of its component.
    pub(super) fluorophore: usize,
    /// Number of its matrix among the operators and exitances: that of the fluorophore, or one of a tissue.
    pub(super) matrix: usize,
    /// Its place among the fluorophores of its material.
    pub(super) number: usize,
}

/// Interpolation from [`EMITTED_NM`] to the bands: what each wavelength counts for in them, from the first block on that it reaches.
#[derive(Debug)]
pub(super) struct EmissionBands(Vec<(usize, Vec<BandBlock>)>);

impl EmissionBands {
    pub(super) fn new(grid: &WavelengthGrid) -> Self {
        let last = EMITTED_NM.len() - 1;
        let place = |band: usize| {
            let nm = grid.center_nm(band).clamp(EMITTED_NM[0], EMITTED_NM[last]);
            let low = EMITTED_NM.partition_point(|known| *known <= nm).clamp(1, last) - 1;
            (low, ((nm - EMITTED_NM[low]) / (EMITTED_NM[low + 1] - EMITTED_NM[low])) as f32)
        };
        let mut counts = vec![vec![0.0; grid.len()]; EMITTED_NM.len()];
        for (band, (low, share)) in (0..grid.len()).map(place).enumerate() {
            counts[low][band] = 1.0 - share;
            counts[low + 1][band] = share;
        }
        let of_one = |counts: &Vec<f32>| {
            let blocks = to_blocks(counts);
            let counts_in = |block: &BandBlock| *block != BandBlock::ZERO;
            let first = blocks.iter().position(counts_in).unwrap_or(0);
            let end = blocks.iter().rposition(counts_in).map_or(first, |last| last + 1);
            (first, blocks[first..end].to_vec())
        };
        Self(counts.iter().map(of_one).collect())
    }

    /// Sets the bands to values known at [`EMITTED_NM`], linear between them and level beyond.
    #[inline(always)]
    pub(super) fn interpolate<L: Lanes>(
        &self,
        lanes: L,
        known: &[f32; EMITTED_NM.len()],
        out: &mut [BandBlock],
    ) {
        bands::clear(lanes, out);
        for (value, (first, counts)) in known.iter().zip(&self.0) {
            bands::add_scaled(lanes, *value, counts, &mut out[*first..first + counts.len()]);
        }
    }
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

impl AnalyticShape {
    /// Smallest positive distance below `limit`.
    #[inline]
    pub(super) fn intersect(&self, origin: Vec3, direction: Vec3, limit: f32) -> Option<f32> {
        match self {
            Self::Sphere { center, radius } => intersect_sphere(origin, direction, *center, *radius, limit),
            Self::Disc { center, normal, radius, .. } => {
                intersect_disc(origin, direction, *center, *normal, *radius, limit)
            }
        }
    }
}

/// All that a hit needs of a vertex, half a cache line: a path waits for memory once instead of three times.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct MeshVertex {
    pub(super) position: Vec3,
    /// Shading normal; zero for faceted meshes.
    pub(super) normal: Vec3,
    pub(super) uv: Vec2,
}

/// A triangle of a mesh.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
pub(super) struct MeshTriangle {
    pub(super) vertices: [u32; 3],
    pub(super) object: u32,
}

#[derive(Debug)]
pub(super) struct CompiledScene {
    pub(super) camera: PerspectiveCamera,
    pub(super) grid: WavelengthGrid,
    /// Bands of the grid.
    pub(super) bands: usize,
    /// Material of each object.
    pub(super) object_material: Vec<usize>,
    /// Vector instructions for the spectra.
    pub(super) simd: Simd,
    /// How far rays start off the surface they leave, m: a millionth of the largest coordinate.
    pub(super) clearance: f32,
    pub(super) bvh: TriangleBvh,
    /// Whether any path chooses among lobes or lights.
    pub(super) has_discrete_choices: bool,
    pub(super) vertices: Vec<MeshVertex>,
    /// Normals of films that even out what is below them, one for each vertex, zero where there is none; empty without any.
    pub(super) film_normals: Vec<Vec3>,
    pub(super) triangles: Vec<MeshTriangle>,
    /// Meshes at many places; `None` where there are none.
    pub(super) instances: Option<CompiledInstances>,
    pub(super) shapes: Vec<CompiledShape>,
    /// Sources in runs: what one light spectrum is taken apart into.
    pub(super) sources: Vec<Source>,
    /// Emissive objects, then light sources.
    pub(super) lights: Vec<CompiledLight>,
    /// The light sources as rays meet them; emissive objects are hit as surfaces.
    pub(super) light_targets: LightTargets,
    /// Lights of each group that can be sampled.
    pub(super) group_lights: Vec<Vec<usize>>,
    /// Emissive objects: their light.
    pub(super) object_light: Vec<Option<usize>>,
    /// Sources that shine from every direction beyond the scene.
    pub(super) environment: Vec<usize>,
    pub(super) materials: PreparedMaterials,
    /// `[material]`.
    pub(super) material_spectra: Vec<MaterialSpectra>,
    /// Expected remaining contribution of paths.
    pub(super) roulette: RouletteModel,
    /// Whether any surface has an opacity.
    pub(super) has_holes: bool,
    /// Whether light leaves any surface elsewhere than it entered.
    pub(super) has_translucency: bool,
    /// Whether coats are rougher once light was scattered ([`RenderSettings::regularize`](super::RenderSettings)).
    pub(super) regularizes: bool,
    pub(super) emission_bands: EmissionBands,
    /// Lights that are environment maps.
    pub(super) environment_maps: Vec<usize>,
    /// Number of fluorophores, and so of components that hold light which fluoresced once.
    pub(super) fluorophores: usize,
    /// Spectra that are kept apart of all groups: their own, and those of excitation nodes.
    pub(super) spectra: usize,
    /// `[spectrum kept apart]`: what its light excites.
    pub(super) excitation: Vec<Excitation>,
    /// Excitation nodes of the light groups that have some.
    pub(super) bases: Vec<BasisGroup>,
    /// `[matrix]`, evenly weighted, for light that already fluoresced.
    pub(super) plain_operators: Vec<FluorescenceOperator>,
    /// Probability with which light that fluoresced excites again, less than 1 where little comes back.
    pub(super) repeat_probability: f32,
}

impl CompiledScene {
    /// Vertices of a triangle.
    #[inline]
    fn vertices_of(&self, triangle: usize) -> [&MeshVertex; 3] {
        self.triangles[triangle].vertices.map(|v| &self.vertices[v as usize])
    }

    /// Memory of the surfaces with their trees, bytes.
    pub(super) fn surface_bytes(&self) -> u64 {
        let arrays = self.vertices.capacity() * size_of::<MeshVertex>()
            + self.film_normals.capacity() * size_of::<Vec3>()
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

    /// Normal of the film on a triangle; zero without one.
    #[inline]
    pub(super) fn film_normal(&self, triangle: usize, u: f32, v: f32) -> Vec3 {
        if self.film_normals.is_empty() {
            return Vec3::ZERO;
        }
        let [a, b, c] = self.triangles[triangle].vertices.map(|vertex| self.film_normals[vertex as usize]);
        (a * (1.0 - u - v) + b * u + c * v).normalize_or_zero()
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
}
