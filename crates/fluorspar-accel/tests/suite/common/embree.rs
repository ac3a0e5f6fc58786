//! Embree 4 through its C interface, opened at run time: the peer of the traversal benchmark.
#![allow(unsafe_code, dead_code, unreachable_pub)]

use std::ffi::{c_char, c_int, c_uint, c_void};
use std::ptr;

use fluorspar_accel::Ray;
use glam::Vec3;
use libloading::Library;

type Handle = *mut c_void;

/// `RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED`.
const NATIVE_RAY16_SUPPORTED: c_int = 34;

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

/// Rays in a packet.
const PACKET: usize = 16;

/// Sixteen values of one field of a packet.
type Lanes<T> = [T; PACKET];

/// `RTCRayHit16` of Embree 4: rays and hits, one array per field, with room to spare.
#[repr(C, align(64))]
struct RayHit16 {
    origin: [Lanes<f32>; 3],
    near: Lanes<f32>,
    direction: [Lanes<f32>; 3],
    time: Lanes<f32>,
    far: Lanes<f32>,
    mask: Lanes<c_uint>,
    id: Lanes<c_uint>,
    flags: Lanes<c_uint>,
    normal: [Lanes<f32>; 3],
    u: Lanes<f32>,
    v: Lanes<f32>,
    primitive: Lanes<c_uint>,
    geometry: Lanes<c_uint>,
    instance: [Lanes<c_uint>; 2],
}

/// Which rays of a packet are traced: -1 for active, 0 for inactive.
#[repr(C, align(64))]
struct Valid(Lanes<c_int>);

impl RayHit16 {
    /// The packet of up to sixteen rays, and which of its lanes they fill.
    fn new(rays: &[Ray]) -> (Self, Valid) {
        const NONE: Lanes<f32> = [0.0; PACKET];
        const ANY: Lanes<c_uint> = [c_uint::MAX; PACKET];
        let mut packet = Self {
            origin: [NONE; 3],
            near: NONE,
            direction: [NONE; 3],
            time: NONE,
            far: NONE,
            mask: ANY,
            id: [0; PACKET],
            flags: [0; PACKET],
            normal: [NONE; 3],
            u: NONE,
            v: NONE,
            primitive: ANY,
            geometry: ANY,
            instance: [ANY; 2],
        };
        let mut valid = Valid([0; PACKET]);
        for (lane, ray) in rays.iter().enumerate() {
            for axis in 0..3 {
                packet.origin[axis][lane] = ray.origin[axis];
                packet.direction[axis][lane] = ray.direction[axis];
            }
            packet.near[lane] = ray.t_min;
            packet.far[lane] = ray.t_max;
            valid.0[lane] = -1;
        }
        (packet, valid)
    }
}

/// The query flag of a packet: how alike its rays are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coherence {
    /// Neighboring rays run alike: they descend the tree together.
    Coherent,
    /// Rays run apart: each descends the tree by itself.
    Incoherent,
}

/// `RTCIntersectArguments` and `RTCOccludedArguments` of Embree 4, with room to spare.
#[repr(C)]
struct Arguments {
    flags: c_int,
    features: c_uint,
    context: *mut c_void,
    filter: *mut c_void,
    intersect: *mut c_void,
    spare: [usize; 2],
}

impl Arguments {
    fn new(coherence: Coherence) -> Self {
        let flags = if coherence == Coherence::Coherent { 1 << 16 } else { 0 };
        let none = ptr::null_mut();
        Self { flags, features: c_uint::MAX, context: none, filter: none, intersect: none, spare: [0; 2] }
    }
}

type TracePacket = unsafe extern "C" fn(*const Valid, Handle, *mut RayHit16, *mut Arguments);

/// A mesh in Embree.
pub struct EmbreeScene {
    scene: Handle,
    intersect16: TracePacket,
    occluded16: TracePacket,
    native_packets: bool,
    intersect: unsafe extern "C" fn(Handle, *mut RayHit, *mut c_void),
    occluded: unsafe extern "C" fn(Handle, *mut RayHit, *mut c_void),
    // Embree reads the buffers while it traces.
    _positions: Vec<Vec3>,
    _triangles: Vec<[u32; 3]>,
}

impl EmbreeScene {
    /// Builds the mesh; `robust` selects the watertight kernels.
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

            let property: unsafe extern "C" fn(Handle, c_int) -> isize =
                *library.get(b"rtcGetDeviceProperty")?;

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
                intersect16: *library.get(b"rtcIntersect16")?,
                occluded16: *library.get(b"rtcOccluded16")?,
                native_packets: property(device, NATIVE_RAY16_SUPPORTED) != 0,
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
    /// Whether Embree traces sixteen rays in one vector here; it splits packets otherwise.
    pub fn has_native_packets(&self) -> bool {
        self.native_packets
    }

    /// Number of rays that hit anything, their nearest hits found in packets of sixteen.
    pub fn closest_in_packets(&self, rays: &[Ray], coherence: Coherence) -> usize {
        let mut arguments = Arguments::new(coherence);
        let trace = |rays: &[Ray]| {
            let (mut packet, valid) = RayHit16::new(rays);
            // SAFETY: all four are valid and aligned as Embree demands.
            unsafe { (self.intersect16)(&raw const valid, self.scene, &raw mut packet, &raw mut arguments) };
            packet.geometry.iter().filter(|&&geometry| geometry != c_uint::MAX).count()
        };
        rays.chunks(PACKET).map(trace).sum()
    }

    /// Number of rays that hit anything, in packets of sixteen.
    pub fn occluded_in_packets(&self, rays: &[Ray], coherence: Coherence) -> usize {
        let mut arguments = Arguments::new(coherence);
        let trace = |rays: &[Ray]| {
            let (mut packet, valid) = RayHit16::new(rays);
            // SAFETY: as above; only the rays of the packet are used.
            unsafe { (self.occluded16)(&raw const valid, self.scene, &raw mut packet, &raw mut arguments) };
            packet.far.iter().filter(|&&far| far < 0.0).count()
        };
        rays.chunks(PACKET).map(trace).sum()
    }
}
