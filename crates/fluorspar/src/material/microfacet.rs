//! GGX microfacets: distribution of normals, shadowing, sampling of visible normals, and tables of directional albedos.
//!
//! Directions are local: the normal is +z. Trowbridge and Reitz 1975; Walter et al., Microfacet models for refraction
//! through rough surfaces, EGSR 2007; Heitz, Understanding the masking-shadowing function, JCGT 3(2), 2014.

use std::f32::consts::PI;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use glam::{Vec2, Vec3};

use crate::sampling::warp;

/// Smallest roughness of a rough surface; coats are clamped to it, dielectrics and conductors below it are smooth.
pub const MIN_ROUGHNESS: f32 = 0.01;

/// The roughness of a surface that may be smooth: `None` below [`MIN_ROUGHNESS`].
#[inline]
pub(super) fn rough(alpha: f32) -> Option<f32> {
    (alpha >= MIN_ROUGHNESS).then_some(alpha.min(1.0))
}

/// Density of microfacet normals times their cosine, per projected area, 1/sr.
pub fn distribution(half: Vec3, alpha: f32) -> f32 {
    let a2 = alpha * alpha;
    let cos2 = half.z * half.z;
    // 1 - cos2 (1 - a2), without the cancellation that smooth surfaces suffer at the peak.
    let t = (half.x * half.x + half.y * half.y) + cos2 * a2;
    a2 / (PI * t * t)
}

/// Smith's Lambda of a direction on either side.
pub fn lambda(direction: Vec3, alpha: f32) -> f32 {
    let cos2 = direction.z * direction.z;
    let tan2 = (1.0 - cos2).max(0.0) / cos2;
    0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
}

/// Height-correlated masking and shadowing of two directions on the same side.
pub fn shadowing(outgoing: Vec3, incident: Vec3, alpha: f32) -> f32 {
    1.0 / (1.0 + lambda(outgoing, alpha) + lambda(incident, alpha))
}

/// Draws a microfacet normal among those that `outgoing` (z > 0) sees (Heitz, JCGT 7(4), 2018).
/// Density [`visible_normal_pdf`].
pub fn sample_visible_normal(outgoing: Vec3, alpha: f32, u: [f32; 2]) -> Vec3 {
    visible_normal(outgoing, alpha, warp::concentric_disc(u))
}

/// The visible normal of a point of the unit disc.
#[inline]
fn visible_normal(outgoing: Vec3, alpha: f32, disc: Vec2) -> Vec3 {
    let stretched = Vec3::new(alpha * outgoing.x, alpha * outgoing.y, outgoing.z).normalize();
    let lensq = stretched.x * stretched.x + stretched.y * stretched.y;
    let t1 = if lensq > 0.0 { Vec3::new(-stretched.y, stretched.x, 0.0) / lensq.sqrt() } else { Vec3::X };
    let t2 = stretched.cross(t1);
    let s = 0.5 * (1.0 + stretched.z);
    let y = (1.0 - s) * (1.0 - disc.x * disc.x).max(0.0).sqrt() + s * disc.y;
    let z = (1.0 - disc.x * disc.x - y * y).max(0.0).sqrt();
    let normal = t1 * disc.x + t2 * y + stretched * z;
    Vec3::new(alpha * normal.x, alpha * normal.y, normal.z.max(0.0)).normalize_or_zero()
}

/// Mirrors `outgoing` at a visible microfacet. `None` when the mirrored direction points into the surface. Density of
/// [`mirror_lobe`].
pub fn sample_mirrored(outgoing: Vec3, alpha: f32, u: [f32; 2]) -> Option<Vec3> {
    let half = sample_visible_normal(outgoing, alpha, u);
    let incident = 2.0 * outgoing.dot(half) * half - outgoing;
    (incident.z > 0.0).then_some(incident)
}

/// `G1(o) D(h) (o.h) / cos o`, 1/sr.
pub fn visible_normal_pdf(outgoing: Vec3, half: Vec3, alpha: f32) -> f32 {
    distribution(half, alpha) * outgoing.dot(half).max(0.0) / ((1.0 + lambda(outgoing, alpha)) * outgoing.z)
}

/// Tables made for a refractive index, kept for the next scene of the process: they take longer to make than a small
/// image to render.
pub(super) struct TableCache<T>(Mutex<Vec<(u32, Arc<T>)>>);

/// Most tables that are kept.
const KEPT: usize = 32;

impl<T> TableCache<T> {
    pub(super) const fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// The table of an index, made when it is not there.
    pub(super) fn get(&self, refractive_index: f32, make: impl FnOnce(f32) -> T) -> Arc<T> {
        // A thread that panicked while it held the lock left the list whole: entries are only ever added or removed.
        let mut tables = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let key = refractive_index.to_bits();
        if let Some((_, table)) = tables.iter().find(|(other, _)| *other == key) {
            return Arc::clone(table);
        }
        if tables.len() == KEPT {
            tables.remove(0);
        }
        let table = Arc::new(make(refractive_index));
        tables.push((key, Arc::clone(&table)));
        table
    }
}

const COSINES: usize = 48;
const ROUGHNESSES: usize = 24;

/// A directional albedo tabulated over cosine and roughness, with its cosine-weighted mean.
#[derive(Clone, Debug, PartialEq)]
pub struct AlbedoTable {
    /// `[roughness][cosine]`.
    table: Vec<f32>,
    /// For each roughness.
    mean: Vec<f32>,
}

impl AlbedoTable {
    /// Tabulates `weight(outgoing, half, alpha)` averaged over visible normals, on a regular grid; deterministic.
    /// The weight is the share of light that a microfacet with this normal sends on and that leaves the surface; without jumps
    /// it is computed for many normals at once.
    pub fn new(weight: impl Fn(Vec3, Vec3, f32) -> f32) -> Self {
        let nodes = disc_nodes();
        let mut table = Vec::with_capacity(COSINES * ROUGHNESSES);
        let mut mean = Vec::with_capacity(ROUGHNESSES);
        for row in 0..ROUGHNESSES {
            let alpha = roughness_node(row);
            let albedos: Vec<f64> = (0..COSINES)
                .map(|col| directional_albedo(&nodes, cosine_node(col), alpha, &weight))
                .collect();
            // Mean with weight 2 cos dcos, trapezoidal over the nodes.
            let weighted = |col: usize| 2.0 * f64::from(cosine_node(col)) * albedos[col];
            let integral: f64 = (1..COSINES)
                .map(|col| {
                    0.5 * (weighted(col) + weighted(col - 1))
                        * f64::from(cosine_node(col) - cosine_node(col - 1))
                })
                .sum();
            mean.push(integral as f32);
            table.extend(albedos.iter().map(|&e| e as f32));
        }
        Self { table, mean }
    }

    /// Directional albedo and its mean for a roughness.
    #[inline]
    pub fn at(&self, cos: f32, alpha: f32) -> (f32, f32) {
        let y = roughness_coordinate(alpha);
        let x = cosine_coordinate(cos);
        let (row, fy) = split(y, ROUGHNESSES);
        let (col, fx) = split(x, COSINES);
        let value =
            |r: usize| self.table[r * COSINES + col] * (1.0 - fx) + self.table[r * COSINES + col + 1] * fx;
        let albedo = value(row) * (1.0 - fy) + value(row + 1) * fy;
        (albedo, self.mean[row] * (1.0 - fy) + self.mean[row + 1] * fy)
    }
}

fn split(x: f32, n: usize) -> (usize, f32) {
    let cell = (x as usize).min(n - 2);
    (cell, x - cell as f32)
}

/// Nodes crowd toward grazing angles, where the albedo changes fastest.
fn cosine_node(col: usize) -> f32 {
    let x = col as f32 / (COSINES - 1) as f32;
    (x * x).max(1e-4)
}

fn cosine_coordinate(cos: f32) -> f32 {
    cos.clamp(0.0, 1.0).sqrt() * (COSINES - 1) as f32
}

fn roughness_node(row: usize) -> f32 {
    let x = row as f32 / (ROUGHNESSES - 1) as f32;
    MIN_ROUGHNESS + (1.0 - MIN_ROUGHNESS) * x * x
}

fn roughness_coordinate(alpha: f32) -> f32 {
    let x = ((alpha - MIN_ROUGHNESS) / (1.0 - MIN_ROUGHNESS)).clamp(0.0, 1.0);
    x.sqrt() * (ROUGHNESSES - 1) as f32
}

/// Points of the unit disc with their weights, as many as vector instructions take.
struct DiscNodes {
    x: [f32; LANES],
    y: [f32; LANES],
    weight: [f64; LANES],
}

const LANES: usize = 16;

/// The nodes at which directional albedos are integrated.
fn disc_nodes() -> Vec<DiscNodes> {
    const SIDE: usize = 3 * LANES;
    // Nodes crowd toward the edges of the square, which map to the steep facets of the distribution's long tail: at
    // roughness 0.1 one in a hundred facets tilts by more than 45 degrees.
    let node = |k: usize| {
        let v = (k as f64 + 0.5) / SIDE as f64;
        let weight = 30.0 * (v * (1.0 - v)).powi(2) / SIDE as f64;
        ((v * v * v * (10.0 - 15.0 * v + 6.0 * v * v)) as f32, weight)
    };
    let several = |first: usize| {
        let nodes: [_; LANES] = std::array::from_fn(|k| {
            let ((u, weight_u), (v, weight_v)) = (node((first + k) / SIDE), node((first + k) % SIDE));
            (warp::concentric_disc([u, v]), weight_u * weight_v)
        });
        DiscNodes { x: nodes.map(|n| n.0.x), y: nodes.map(|n| n.0.y), weight: nodes.map(|n| n.1) }
    };
    (0..SIDE * SIDE).step_by(LANES).map(several).collect()
}

fn directional_albedo(
    nodes: &[DiscNodes],
    cos: f32,
    alpha: f32,
    weight: &impl Fn(Vec3, Vec3, f32) -> f32,
) -> f64 {
    let outgoing = Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
    let mut sum = 0.0;
    for node in nodes {
        let mut weights = [0.0; LANES];
        for ((value, x), y) in weights.iter_mut().zip(node.x).zip(node.y) {
            *value = weight(outgoing, visible_normal(outgoing, alpha, Vec2::new(x, y)), alpha);
        }
        for (value, weight) in weights.into_iter().zip(node.weight) {
            sum += weight * f64::from(value);
        }
    }
    sum
}

/// Share of the light that meets a microfacet from `outgoing` and leaves toward `incident`: `G2 / G1(o)`; directions
/// may lie on different sides, where shadowing is taken as height-correlated as well.
pub fn passing(outgoing: Vec3, incident: Vec3, alpha: f32) -> f32 {
    (1.0 + lambda(outgoing, alpha)) * shadowing(outgoing, incident, alpha)
}

/// Density with which microfacets mirror `outgoing` into `incident`, and the same with shadowing: BRDF times cosine of
/// `incident` for a reflectance of one. 1/sr.
pub fn mirror_lobe(outgoing: Vec3, incident: Vec3, half: Vec3, alpha: f32) -> (f32, f32) {
    let pdf = visible_normal_pdf(outgoing, half, alpha) / (4.0 * outgoing.dot(half));
    (pdf, pdf * passing(outgoing, incident, alpha))
}

/// Albedo of rough microfacets that reflect everything; made on first use.
pub fn white_microfacets() -> &'static AlbedoTable {
    static TABLE: LazyLock<AlbedoTable> = LazyLock::new(|| {
        AlbedoTable::new(|outgoing, half, alpha| {
            let incident = 2.0 * outgoing.dot(half) * half - outgoing;
            let passed = passing(outgoing, incident, alpha);
            if incident.z > 0.0 { passed } else { 0.0 }
        })
    });
    &TABLE
}
