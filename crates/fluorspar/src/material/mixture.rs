//! Materials that are made of two others.

use glam::Vec2;

use super::material_error::{MaterialError, at_most_one};
use super::texture::ScalarTexture;

/// Two materials side by side, finer than a pixel: at every hit one of them is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Mixture {
    /// Index of the first material of the scene.
    pub first: usize,
    /// Index of the second one.
    pub second: usize,
    /// Share of the second one, 0 to 1.
    pub amount: ScalarTexture,
}

/// One material on either side of a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TwoSided {
    /// Index of the material on the side of the geometric normal.
    pub front: usize,
    /// Index of the one on the other side.
    pub back: usize,
}

impl Mixture {
    /// Checks the share of the second material.
    pub(super) fn check(&self) -> Result<(), MaterialError> {
        at_most_one("amount of the mixture", &self.amount)
    }

    /// Share of the second material at a point, 0 to 1.
    #[inline]
    pub(super) fn amount(&self, uv: Vec2) -> f32 {
        self.amount.at(uv).clamp(0.0, 1.0)
    }

    /// Draws the second material where `choice`, even in [0, 1), is below `amount`, else the first; reuses what is left
    /// of the number.
    #[inline]
    pub(super) fn choose(&self, amount: f32, choice: &mut f32) -> usize {
        if *choice < amount {
            *choice /= amount;
            self.second
        } else {
            *choice = ((*choice - amount) / (1.0 - amount)).clamp(0.0, 0.999_999_9);
            self.first
        }
    }
}

impl TwoSided {
    /// The material of the side of the geometric normal, or of the other.
    #[inline]
    pub(super) fn side(&self, front: bool) -> usize {
        if front { self.front } else { self.back }
    }
}

#[cfg(test)]
mod tests {
    use super::super::bsdf_tests::{grid, numbers};
    use super::super::prepared::PreparedMaterials;
    use super::super::{Material, NormalMap, Scattering};
    use super::*;
    use crate::spectral::Curve;

    fn gray() -> Material {
        Material::lambertian("gray", Curve::constant(0.5))
    }

    fn with_opacity(material: Material, opacity: f32) -> Material {
        Material { opacity: Some(ScalarTexture::Constant(opacity)), ..material }
    }

    fn mix(first: usize, second: usize, amount: f32) -> Material {
        let amount = ScalarTexture::Constant(amount);
        Material::new("mix", Scattering::Mixture(Mixture { first, second, amount }))
    }

    fn sides(front: usize, back: usize) -> Material {
        Material::new("sides", Scattering::TwoSided(TwoSided { front, back }))
    }

    /// How often the last of `materials` shows `part`, seen from the front.
    fn share_of(part: usize, materials: &[Material]) -> f64 {
        const DRAWS: usize = 100_000;
        let prepared = PreparedMaterials::new(materials, &grid());
        let draw = |index: usize| {
            let (mut choice, _) = numbers(index);
            prepared.choose(materials.len() - 1, Vec2::ZERO, true, &mut choice).index == part
        };
        (0..DRAWS).filter(|&index| draw(index)).count() as f64 / DRAWS as f64
    }

    /// Four standard errors of a share of 100 000 draws: at most 4 * 0.5 / sqrt(1e5).
    const TOLERANCE: f64 = 6.4e-3;

    #[test]
    fn parts_are_drawn_by_their_shares() {
        assert!((share_of(1, &[gray(), gray(), mix(0, 1, 0.3)]) - 0.3).abs() < TOLERANCE);
        // What is left of the number is even again: a mixture in a mixture.
        let nested = [gray(), gray(), mix(0, 1, 0.3), mix(0, 2, 0.5)];
        assert!((share_of(1, &nested) - 0.15).abs() < TOLERANCE);
        assert_eq!(share_of(1, &[gray(), gray(), sides(1, 0)]), 1.0);
    }

    /// Where the second part has holes, less of it is seen: `0.5 * 0.2 / (0.5 + 0.5 * 0.2)`.
    #[test]
    fn parts_with_holes_are_seen_less() {
        let materials = [gray(), with_opacity(gray(), 0.2), mix(0, 1, 0.5)];
        assert!((share_of(1, &materials) - 1.0 / 6.0).abs() < TOLERANCE);
        let opacity = |materials: &[Material], front: bool| {
            PreparedMaterials::new(materials, &grid()).opacity(materials.len() - 1, Vec2::ZERO, front)
        };
        assert!((opacity(&materials, true) - 0.6).abs() < 1e-6);
        // The outer opacity multiplies.
        let outer = [gray(), with_opacity(gray(), 0.2), with_opacity(mix(0, 1, 0.5), 0.5)];
        assert!((opacity(&outer, true) - 0.3).abs() < 1e-6);
        assert!((share_of(1, &outer) - 1.0 / 6.0).abs() < TOLERANCE);
        // The side that is seen counts.
        let outer = [gray(), with_opacity(gray(), 0.2), with_opacity(sides(0, 1), 0.5)];
        assert!((opacity(&outer, true) - 0.5).abs() < 1e-6 && (opacity(&outer, false) - 0.1).abs() < 1e-6);
        assert_eq!(opacity(&[gray(), mix(0, 0, 0.3)], true), 1.0);
    }

    #[test]
    fn the_innermost_normal_map_counts() {
        let map = |red: f32| NormalMap::from_rgb(1, 1, &[red, 0.5, 1.0], 1.0).unwrap();
        let with_map = |material: Material, red: f32| Material { normal_map: Some(map(red)), ..material };
        let chosen = |materials: &[Material]| {
            let prepared = PreparedMaterials::new(materials, &grid());
            prepared.choose(materials.len() - 1, Vec2::ZERO, true, &mut 0.9).normal_map.cloned()
        };
        assert_eq!(chosen(&[gray(), sides(0, 0)]), None);
        assert_eq!(chosen(&[gray(), with_map(sides(0, 0), 0.6)]), Some(map(0.6)));
        assert_eq!(chosen(&[with_map(gray(), 0.7), with_map(sides(0, 0), 0.6)]), Some(map(0.7)));
        let nested = [gray(), with_map(mix(0, 0, 0.5), 0.8), with_map(sides(1, 1), 0.6)];
        assert_eq!(chosen(&nested), Some(map(0.8)));
    }
}
