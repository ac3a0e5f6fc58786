//! Finds what a ray hits in a triangle mesh.
//!
//! | task | call | gives |
//! |---|---|---|
//! | prepare a mesh | [`TriangleBvh::build`] | an eight-wide bounding volume hierarchy |
//! | what does this ray see? | [`TriangleBvh::closest`] | the nearest [`Hit`] |
//! | is this light hidden? | [`TriangleBvh::occluded`] | `true` at the first triangle found |
//! | one mesh at many places | [`InstanceBvh::build`] | a tree over placed meshes, with the same queries |
//! | the same of many rays | [`TriangleBvh::closest_each`], [`TriangleBvh::occluded_each`] | the same, faster |
//!
//! Guarantees:
//!
//! - **Watertight.** A ray that meets the interior of a closed surface meets a triangle, also through shared edges and
//!   vertices: the triangle test is that of Woop, Benthin and Wald [^woop2013], the box test that of Ize [^ize2013].
//! - **The same everywhere.** The tree does not depend on the number of threads, and a [`Hit`] has the same bits
//!   whichever [`Kernel`] runs: no kernel fuses a multiplication with an addition or reorders a sum.
//! - **Ties have an order.** Of triangles hit at the same `t`, the one with the lowest number wins.
//! - Triangles without area are never hit.
//!
//! Lengths are in the unit of the mesh (meters throughout Fluorspar), `t` too because directions have unit length.
//!
//! Programs that trace large meshes declare `Allocator` (feature `allocator`, which needs a C compiler) as their global allocator:
//! trees and meshes then lie on large pages.
//!
//! Out of scope: motion, curves, and updating a tree after its mesh has moved.
//!
//! This is the only crate of the workspace that contains `unsafe` code, in its modules `kernel`,
//! `allocator` and `memory`.
//!
//! ```
//! use fluorspar_accel::{Ray, TriangleBvh};
//! use glam::Vec3;
//!
//! let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
//! let bvh = TriangleBvh::build(&positions, &[[0, 1, 2]])?;
//! let ray = Ray { origin: Vec3::new(0.25, 0.5, 2.0), direction: Vec3::NEG_Z, t_min: 0.0, t_max: f32::INFINITY };
//! let hit = bvh.closest(&ray).expect("the ray points at the triangle");
//! assert_eq!((hit.t, hit.u, hit.v, hit.triangle), (2.0, 0.25, 0.5, 0));
//! assert!(bvh.occluded(&ray));
//! # Ok::<(), fluorspar_accel::BuildError>(())
//! ```
//!
//! [^woop2013]: S. Woop, C. Benthin, I. Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 65-82 (2013).
//! [^ize2013]: T. Ize, "Robust BVH Ray Traversal", JCGT 2(2), 12-27 (2013).

#[cfg(feature = "allocator")]
mod allocator;
pub mod bands;
mod binary_tree;
mod instance_bvh;
mod kernel;
mod memory;
mod ray;
mod triangle_bvh;
mod wide_tree;

#[cfg(feature = "allocator")]
pub use allocator::{Allocator, return_freed_memory_at_once};
pub use instance_bvh::{Instance, InstanceBvh, InstanceHit, is_invertible};
pub use kernel::{Kernel, Lanes, Simd, Work, prefetch};
pub use memory::{claim_exit_message, memory_is_available};
pub use ray::{Hit, Ray};
pub use triangle_bvh::{BuildError, BuildOptions, LARGEST_COORDINATE, TriangleBvh};
