//! Embree 4 through its C interface, opened at run time: the peer of the traversal benchmark.
#![allow(unsafe_code, dead_code, unreachable_pub)]

use std::ffi::{c_char, c_int, c_uint, c_void};
use std::ptr;

use fluorspar_accel::Ray;
use glam::Vec3;
use libloading::Library;

type Handle = *mut c_void;

/// `RTCRayHit` of Embree 4: a ray of 48 bytes and a hit, with room to spare.
#[repr(C, align(16))]
struct RayHit {
    origin: [f32; 3],
    near: f32,
    direction: [f32; 3],
    time: f32,
    far: f32,
    mask: c_uint,
    id: c_uint,
    flags: c_uint,
    normal: [f32; 3],
    u: f32,
    v: f32,
    primitive: c_uint,
    geometry: c_uint,
    instance: [c_uint; 9],
}

impl RayHit {
    fn new(ray: &Ray) -> Self {
        Self {
            origin: ray.origin.to_array(),
            near: ray.t_min,
            direction: ray.direction.to_array(),
            time: 0.0,
            far: ray.t_max,
            mask: c_uint::MAX,
            id: 0,
            flags: 0,
            normal: [0.0; 3],
            u: 0.0,
            v: 0.0,
            primitive: c_uint::MAX,
            geometry: c_uint::MAX,
            instance: [c_uint::MAX; 9],
        }
    }
}

/// A mesh in Embree.
pub struct EmbreeScene {
    scene: Handle,
    intersect: unsafe extern "C" fn(Handle, *mut RayHit, *mut c_void),
    occluded: unsafe extern "C" fn(Handle, *mut RayHit, *mut c_void),
    // Embree reads the buffers while it traces.
    _positions: Vec<Vec3>,
    _triangles: Vec<[u32; 3]>,
}

impl EmbreeScene {
    /// Builds the mesh; `robust` asks for the watertight kernels.
    pub fn build(
        library: &str,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        robust: bool,
    ) -> Result<Self, libloading::Error> {
        // Never unloaded: its threads may still run when the program ends.
        // SAFETY: the library is Embree 4, whose initializers may run anywhere.
        let library: &'static Library = Box::leak(Box::new(unsafe { Library::new(library)? }));
        // Embree reads 16 bytes at the last vertex.
        let mut positions = positions.to_vec();
        positions.reserve(2);
        let triangles = triangles.to_vec();
        // SAFETY: signatures as in rtcore_*.h of Embree 4; buffers outlive the scene, which is never released.
        unsafe {
            let new_device: unsafe extern "C" fn(*const c_char) -> Handle = *library.get(b"rtcNewDevice")?;
            let new_scene: unsafe extern "C" fn(Handle) -> Handle = *library.get(b"rtcNewScene")?;
            let set_flags: unsafe extern "C" fn(Handle, c_int) = *library.get(b"rtcSetSceneFlags")?;
            let new_geometry: unsafe extern "C" fn(Handle, c_int) -> Handle =
                *library.get(b"rtcNewGeometry")?;
            type SetBuffer =
                unsafe extern "C" fn(Handle, c_int, c_uint, c_int, *const c_void, usize, usize, usize);
            let set_buffer: SetBuffer = *library.get(b"rtcSetSharedGeometryBuffer")?;
            let commit_geometry: unsafe extern "C" fn(Handle) = *library.get(b"rtcCommitGeometry")?;
            let attach: unsafe extern "C" fn(Handle, Handle) -> c_uint =
                *library.get(b"rtcAttachGeometry")?;
            let commit_scene: unsafe extern "C" fn(Handle) = *library.get(b"rtcCommitScene")?;

            let device = new_device(ptr::null());
            let scene = new_scene(device);
            set_flags(scene, if robust { 4 } else { 0 });
            let geometry = new_geometry(device, 0);
            let (index, vertex, uint3, float3) = (0, 1, 0x5003, 0x9003);
            set_buffer(geometry, index, 0, uint3, triangles.as_ptr().cast(), 0, 12, triangles.len());
            set_buffer(geometry, vertex, 0, float3, positions.as_ptr().cast(), 0, 12, positions.len());
            commit_geometry(geometry);
            attach(scene, geometry);
            commit_scene(scene);
            Ok(Self {
                scene,
                intersect: *library.get(b"rtcIntersect1")?,
                occluded: *library.get(b"rtcOccluded1")?,
                _positions: positions,
                _triangles: triangles,
            })
        }
    }

    /// Distance and triangle of the nearest hit.
    pub fn closest(&self, ray: &Ray) -> Option<(f32, u32)> {
        let mut query = RayHit::new(ray);
        // SAFETY: scene and query are valid; no arguments are allowed.
        unsafe { (self.intersect)(self.scene, &raw mut query, ptr::null_mut()) };
        (query.geometry != c_uint::MAX).then_some((query.far, query.primitive))
    }

    /// Is anything hit?
    pub fn occluded(&self, ray: &Ray) -> bool {
        let mut query = RayHit::new(ray);
        // SAFETY: as above; only the first 48 bytes are used.
        unsafe { (self.occluded)(self.scene, &raw mut query, ptr::null_mut()) };
        query.far < 0.0
    }
}
