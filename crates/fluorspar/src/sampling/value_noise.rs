//! Smooth noise over the plane, the same for the same seed on every platform.

use glam::Vec2;

use super::sobol::hash_u64;

/// Cubic step from 0 to 1 between 0 and 1.
#[inline]
pub fn smoothstep(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// Four octaves of value noise over the plane, 0 to 1: features of about one unit and finer.
#[inline]
pub fn fractal_noise(p: Vec2, seed: u32) -> f32 {
    let mut sum = 0.0;
    let mut weight = 0.5;
    let mut total = 0.0;
    let mut q = p;
    for octave in 0..4 {
        sum += weight * value_noise(q, seed.wrapping_add(octave));
        total += weight;
        weight *= 0.5;
        q = q * 2.0 + Vec2::new(17.0, 31.0);
    }
    sum / total
}

/// Lattice values from a hash, blended by a smooth step.
fn value_noise(p: Vec2, seed: u32) -> f32 {
    let cell = p.floor();
    let f = p - cell;
    let corner = |dx: f32, dy: f32| {
        let (x, y) = ((cell.x + dx) as i64 as u64, (cell.y + dy) as i64 as u64);
        let mixed = hash_u64(
            x.wrapping_mul(0x8DA6_B343)
                ^ y.wrapping_mul(0xD816_3841).rotate_left(32)
                ^ (u64::from(seed) << 48),
        );
        (mixed >> 40) as f32 / (1_u64 << 24) as f32
    };
    let (sx, sy) = (smoothstep(f.x), smoothstep(f.y));
    let low = corner(0.0, 0.0) * (1.0 - sx) + corner(1.0, 0.0) * sx;
    let high = corner(0.0, 1.0) * (1.0 - sx) + corner(1.0, 1.0) * sx;
    low * (1.0 - sy) + high * sy
}
