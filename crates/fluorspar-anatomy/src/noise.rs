//! Hash-based noise: the same numbers for the same seed on every platform.

use super::math::smoothstep;

/// Mixes four integers into one (the finaliser of MurmurHash3 after each).
fn hash(seed: u32, x: i32, y: i32, channel: u32) -> u32 {
    let mut state = seed ^ 0x9e37_79b9;
    for word in [x as u32, y as u32, channel] {
        state = state.wrapping_add(word.wrapping_mul(0x85eb_ca6b)).rotate_left(13);
        state ^= state >> 16;
        state = state.wrapping_mul(0x85eb_ca6b);
        state ^= state >> 13;
        state = state.wrapping_mul(0xc2b2_ae35);
        state ^= state >> 16;
    }
    state
}

/// A number in `[0, 1)` that belongs to a lattice point.
pub(super) fn lattice(seed: u32, x: i32, y: i32, channel: u32) -> f64 {
    f64::from(hash(seed, x, y, channel)) / 4_294_967_296.0
}

/// Smooth noise in `[-1, 1]` with features of about one unit.
pub(super) fn value_noise(seed: u32, x: f64, y: f64) -> f64 {
    let (column, row) = (x.floor(), y.floor());
    let (fx, fy) = (smoothstep(0.0, 1.0, x - column), smoothstep(0.0, 1.0, y - row));
    let (column, row) = (column as i32, row as i32);
    let at = |dx: i32, dy: i32| lattice(seed, column + dx, row + dy, 0);
    let low = at(0, 0) + (at(1, 0) - at(0, 0)) * fx;
    let high = at(0, 1) + (at(1, 1) - at(0, 1)) * fx;
    2.0 * (low + (high - low) * fy) - 1.0
}

/// Sum of octaves of [`value_noise`], each twice as fine and half as high.
pub(super) fn fractal_noise(seed: u32, x: f64, y: f64, octaves: u32) -> f64 {
    let (mut sum, mut scale, mut height) = (0.0, 1.0, 0.5);
    for octave in 0..octaves {
        sum += height * value_noise(seed.wrapping_add(octave), x * scale, y * scale);
        scale *= 2.0;
        height *= 0.5;
    }
    sum
}

/// Bumps scattered one per unit cell at jittered places, each kept with the probability `density`: the largest
/// `height(r / radius)` over the bumps near the point, with the height falling from 1 at the center to 0 at the rim.
pub(super) fn bumps(seed: u32, x: f64, y: f64, radius: f64, density: f64) -> f64 {
    let (column, row) = (x.floor() as i32, y.floor() as i32);
    let mut highest = 0.0_f64;
    // Bumps keep off the borders of their cells: those of many neighbors can't reach here.
    let near = |d: i32, inside: f64| match d {
        -1 => inside + 0.15 < radius,
        1 => 1.15 - inside < radius,
        _ => true,
    };
    let (inside_x, inside_y) = (x - f64::from(column), y - f64::from(row));
    for dy in (-1..=1).filter(|&d| near(d, inside_y)) {
        for dx in (-1..=1).filter(|&d| near(d, inside_x)) {
            let (cx, cy) = (column + dx, row + dy);
            if lattice(seed, cx, cy, 3) >= density {
                continue;
            }
            let px = f64::from(cx) + 0.15 + 0.7 * lattice(seed, cx, cy, 1);
            let py = f64::from(cy) + 0.15 + 0.7 * lattice(seed, cx, cy, 2);
            let r2 = ((x - px) * (x - px) + (y - py) * (y - py)) / (radius * radius);
            if r2 < 1.0 {
                highest = highest.max((1.0 - r2) * (1.0 - r2) * (0.6 + 0.4 * lattice(seed, cx, cy, 4)));
            }
        }
    }
    highest
}
