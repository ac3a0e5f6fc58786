//! Maps over the texture coordinates of the parts: where mucosa is red or pale, where porphyrins and plaque sit, how
//! wet a surface is. Anatomy only: a map gives amounts, never colors.
//!
//! The maps of the tongue use the same papillae as its mesh: the fungiform ones have a map of their own, coating and
//! porphyrin keep to the filiform ones.

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::math::{PI, bell, exp, lerp, sin_cos, smoothstep};
use super::noise::{bumps, fractal_noise, value_noise};
use super::parameters::MouthParameters;
use super::{Tissue, teeth, tongue};
use fluorspar::interruption::end_if_interrupted;

/// A map of the anatomy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum SurfaceMap {
    /// Blood near the surface: vessels, the border of the tongue, the margin of the gums; 0 to 1.
    Redness,
    /// Fungiform papillae on the back of the tongue: dense at the tip, rare behind; 0 between them to 1 on them.
    Fungiform,
    /// Keratin and coating: filiform papillae, crests of the palatal folds, the line where teeth meet the cheek; 0 to 1.
    Pallor,
    /// Porphyrins of the tongue's coating: most in the middle and hind part, on filiform papillae, none on the sides,
    /// the tip and elsewhere; 0 to 1. Ramp and width after the published distribution of the tongue's coating.
    Porphyrin,
    /// Plaque and calculus on teeth, along the gums and between the teeth; 0 to 1.
    Plaque,
    /// Dentin that shows through the enamel: most at the neck of a tooth and in its fissures; 0 to 1.
    Dentin,
    /// Thickness of a front tooth behind its enamel: 0 at the biting edge, which is all enamel, 1 where dentin is as thick as light needs.
    Crown,
    /// Roughness of the film of saliva: 0 is a smooth pool, 1 a dry surface.
    Dryness,
}

/// Samples a map at the centers of `columns` by `rows` pixels: rows from the top (v = 1), values 0 to 1.
pub fn bake_surface_map(
    map: SurfaceMap,
    tissue: Tissue,
    parameters: &MouthParameters,
    columns: usize,
    rows: usize,
) -> Vec<f32> {
    (0..rows)
        .into_par_iter()
        .flat_map_iter(|row| {
            end_if_interrupted();
            let v = 1.0 - (row as f64 + 0.5) / rows as f64;
            (0..columns).map(move |column| {
                let u = (column as f64 + 0.5) / columns as f64;
                surface_map(map, tissue, parameters, u, v) as f32
            })
        })
        .collect()
}

/// A map at texture coordinates, 0 to 1.
pub fn surface_map(map: SurfaceMap, tissue: Tissue, p: &MouthParameters, u: f64, v: f64) -> f64 {
    let place = Place::new(tissue, p, u, v);
    match map {
        SurfaceMap::Redness => place.redness(),
        SurfaceMap::Fungiform => place.fungiform(),
        SurfaceMap::Pallor => place.pallor(),
        SurfaceMap::Porphyrin => place.porphyrin(),
        SurfaceMap::Plaque => place.plaque(),
        SurfaceMap::Dentin => place.dentin(),
        SurfaceMap::Crown => place.crown(),
        SurfaceMap::Dryness => place.dryness(),
    }
    .clamp(0.0, 1.0)
}

/// A place on a tissue, with its texture coordinates turned into lengths.
struct Place<'a> {
    tissue: Tissue,
    p: &'a MouthParameters,
    u: f64,
    v: f64,
    /// Lengths across and along, mm; along the gums and lips for these.
    x: f64,
    y: f64,
}

impl<'a> Place<'a> {
    fn new(tissue: Tissue, p: &'a MouthParameters, u: f64, v: f64) -> Self {
        let across = 2.0 * u - 1.0;
        let (x, y) = match tissue {
            Tissue::TongueDorsum => tongue::lengths_at(p, u, v),
            Tissue::TongueVentral => {
                let (_, cosine) = sin_cos(PI * (1.0 - u));
                (0.5 * p.tongue_width_mm * cosine, p.tongue_length_mm * v)
            }
            Tissue::Gingiva => (64.0 * across, 36.0 * v),
            Tissue::HardPalate => (17.0 * across, 48.0 * v),
            Tissue::SoftPalate => (24.0 * across, 52.0 * v),
            Tissue::FloorOfMouth => (20.0 * across, 48.0 * v),
            Tissue::Cheek => (45.0 * across, 60.0 * v),
            Tissue::Lip => (45.0 * across, 20.0 * v),
            Tissue::Tooth => (26.0 * u, 9.0 * v),
            Tissue::Throat => (100.0 * u, 40.0 * v),
            // Around the mouth, without a seam.
            Tissue::Skin => {
                let (sine, cosine) = sin_cos(2.0 * PI * u);
                let away = lerp(130.0, 38.0, v);
                (away * cosine, away * sine)
            }
        };
        Self { tissue, p, u, v, x, y }
    }

    fn noise(&self, salt: u32, scale_mm: f64, octaves: u32) -> f64 {
        fractal_noise(self.p.seed ^ salt, self.x / scale_mm, self.y / scale_mm, octaves)
    }

    /// Branching lines: ridges of warped noise, which end before they close, and finer ones that leave them.
    fn vessels(&self, salt: u32, scale_mm: f64, thickness: f64) -> f64 {
        let seed = self.p.seed ^ salt;
        let (x, y) = (self.x / scale_mm, self.y / scale_mm);
        let warp_x = 0.9 * fractal_noise(seed ^ 0x51, 0.8 * x, 0.8 * y, 2);
        let warp_y = 0.9 * fractal_noise(seed ^ 0x52, 0.8 * x, 0.8 * y, 2);
        let ridge = |salt: u32, fine: f64| {
            value_noise(seed ^ salt, fine * (x + warp_x), fine * 0.55 * (y + warp_y)).abs()
        };
        let presence = smoothstep(-0.1, 0.35, fractal_noise(seed ^ 0x53, 0.6 * x, 0.35 * y, 2));
        if presence <= 0.0 {
            return 0.0;
        }
        let stem = ridge(0, 1.0);
        let branches = 0.6 * bell(stem / 0.45) * bell(ridge(0x54, 2.3) / (1.8 * thickness));
        presence * bell(stem / (thickness * lerp(0.4, 1.2, presence))).max(branches)
    }

    fn redness(&self) -> f64 {
        let mottled = 0.5 + 0.9 * self.noise(0x31, 6.0, 3);
        match self.tissue {
            Tissue::TongueDorsum => {
                let rim = smoothstep(0.35, 0.5, (self.u - 0.5).abs()) + 0.7 * smoothstep(0.12, 0.0, self.v);
                0.25 * mottled + 0.35 * rim
            }
            Tissue::TongueVentral => {
                let veins = tongue::veins(self.p.seed, self.x, self.y) * smoothstep(0.04, 0.12, self.v);
                0.4 * mottled + 0.8 * veins + 0.4 * self.vessels(0x32, 5.0, 0.06)
            }
            Tissue::Gingiva => {
                // The free margin and the mucosa below the attached gum are redder.
                let lining = smoothstep(0.17, 0.1, self.v);
                let margin = bell((self.v - 0.4) / 0.07);
                0.25 * mottled + 0.15 * margin + 0.6 * lining + lining * 0.8 * self.vessels(0x33, 5.0, 0.07)
            }
            Tissue::HardPalate => 0.3 * mottled + 0.3 * smoothstep(0.55, 0.95, self.v),
            Tissue::SoftPalate => {
                // On the folds to the cheeks, where the map is stretched, there are none.
                let middle = smoothstep(0.44, 0.32, (self.u - 0.5).abs());
                0.5 * mottled
                    + 0.75 * middle * self.vessels(0x34, 6.0, 0.05)
                    + 0.35 * middle * self.vessels(0x35, 2.5, 0.06)
                    + 0.4 * smoothstep(0.5, 0.66, self.v)
            }
            Tissue::Throat => {
                let follicle = bumps(self.p.seed ^ 0x36, self.x / 4.0, self.y / 4.0, 0.5, 0.55);
                0.45 * mottled + 0.5 * follicle + 0.7 * self.vessels(0x37, 6.0, 0.05)
            }
            Tissue::FloorOfMouth => {
                0.5 * mottled + 0.9 * self.vessels(0x38, 5.0, 0.08) + 0.4 * self.vessels(0x39, 2.0, 0.08)
            }
            Tissue::Cheek => 0.5 * mottled + 0.7 * self.vessels(0x3a, 7.0, 0.05),
            Tissue::Lip => {
                // The wet inner side is redder than the dry vermilion; its creases are dark.
                let wet = smoothstep(0.45, 0.75, self.v);
                0.3 * mottled
                    + 0.35 * self.crease() * (1.0 - wet)
                    + 0.4 * wet
                    + 0.6 * wet * self.vessels(0x3b, 4.0, 0.06)
            }
            Tissue::Skin => 0.35 * mottled + 0.3 * smoothstep(0.8, 1.0, self.v),
            Tissue::Tooth => 0.0,
        }
    }

    /// Fungiform papillae, 0 to 1.
    fn fungiform(&self) -> f64 {
        if self.tissue != Tissue::TongueDorsum {
            return 0.0;
        }
        let papillae = smoothstep(0.05, 0.5, tongue::fungiform(self.p.seed, self.x, self.y, self.v));
        papillae * tongue::in_front_of_sulcus(self.x, self.v)
    }

    /// Creases of the dry lip, 0 to 1: across the lip, a millimeter or two apart.
    fn crease(&self) -> f64 {
        crease(self.p.seed, self.x, self.v)
    }

    fn pallor(&self) -> f64 {
        match self.tissue {
            Tissue::TongueDorsum => {
                let hairs = tongue::filiform(self.p.seed, self.x, self.y);
                let front = tongue::in_front_of_sulcus(self.x, self.v);
                let coated = 0.75 * hairs * (0.35 + 0.65 * self.coating()) + 0.35 * self.coating();
                front * coated * (1.0 - self.fungiform())
            }
            Tissue::TongueVentral => 0.25 * smoothstep(0.0, 0.4, self.noise(0x41, 4.0, 2)),
            Tissue::Gingiva => {
                // Stippling of the attached gum.
                let attached = smoothstep(0.15, 0.2, self.v) * smoothstep(0.38, 0.33, self.v);
                0.3 * attached
                    + 0.4 * attached * bumps(self.p.seed ^ 0x42, self.x / 1.1, self.y / 1.1, 0.5, 0.8)
            }
            Tissue::HardPalate => {
                let raphe = bell(self.x / 0.8) * smoothstep(0.15, 0.3, self.v);
                0.45 + 0.4 * self.noise(0x43, 5.0, 3) + 0.4 * raphe - 0.3 * smoothstep(0.6, 1.0, self.v)
            }
            Tissue::Cheek => {
                // Linea alba at the height of the biting edges.
                let line = bell((self.x - 0.8 * self.noise(0x44, 9.0, 2)) / 0.9)
                    * smoothstep(0.25, 0.4, self.v)
                    * smoothstep(0.95, 0.8, self.v);
                0.6 * line + 0.15 * smoothstep(0.1, 0.5, self.noise(0x45, 3.0, 2))
            }
            Tissue::SoftPalate => {
                0.35 * bumps(self.p.seed ^ 0x46, self.x / 1.8, self.y / 1.8, 0.35, 0.5)
                    * smoothstep(0.5, 0.1, self.v)
            }
            Tissue::Lip => {
                // The bright roll along the border of the red.
                0.55 * smoothstep(0.05, 0.0, self.v)
                    + 0.25 * smoothstep(0.0, 0.5, self.noise(0x47, 2.0, 2)) * smoothstep(0.6, 0.3, self.v)
            }
            Tissue::Throat | Tissue::FloorOfMouth => 0.12 * smoothstep(0.1, 0.5, self.noise(0x48, 4.0, 2)),
            Tissue::Skin => 0.3 * smoothstep(0.0, 0.5, self.noise(0x49, 3.0, 3)),
            Tissue::Tooth => 0.0,
        }
    }

    /// Coating of the tongue, 0 to 1: most in the middle and hind thirds of its front part.
    fn coating(&self) -> f64 {
        let across = (self.u - 0.5) / 0.24;
        let ramp = smoothstep(0.06, 0.55, self.v) * smoothstep(0.8, 0.68, self.v);
        let middle = exp(-0.5 * across * across) * smoothstep(0.5, 0.33, (self.u - 0.5).abs());
        let patches = smoothstep(-0.42, 0.3, self.noise(0x4a, 11.0, 4));
        (ramp * middle * (0.25 + 0.9 * patches)).clamp(0.0, 1.0)
    }

    fn porphyrin(&self) -> f64 {
        if self.tissue != Tissue::TongueDorsum {
            return 0.0;
        }
        // Colonies: patches of some millimeters within the coating, on the papillae that hold it.
        let across = (self.u - 0.5) / 0.2;
        let middle = exp(-0.5 * across * across) * smoothstep(0.4, 0.28, (self.u - 0.5).abs());
        // From none at the tip evenly to the most at six tenths of the length.
        let ramp = ((self.v - 0.05) / 0.55).clamp(0.0, 1.0) * smoothstep(0.78, 0.68, self.v);
        let colonies = smoothstep(-0.14, 0.2, self.noise(0x4b, 8.0, 4));
        let hairs = tongue::filiform(self.p.seed, self.x, self.y);
        let hung = lerp(0.45, 1.0, smoothstep(0.0, 0.6, hairs)) * (1.0 - self.fungiform());
        middle * ramp * (0.12 + 0.88 * colonies) * hung
    }

    fn plaque(&self) -> f64 {
        if self.tissue != Tissue::Tooth {
            return 0.0;
        }
        // u: quarter and three quarters are the contacts.
        let (_, twice) = sin_cos(4.0 * PI * self.u);
        let between = smoothstep(0.2, -0.8, twice);
        let height = 0.12 + 0.1 * between + 0.08 * self.noise(0x4c, 2.5, 2);
        let patchy = smoothstep(-0.25, 0.25, self.noise(0x4d, 3.0, 3));
        (self.p.plaque * smoothstep(height + 0.05, height - 0.03, self.v) * (0.3 + 0.7 * patchy)).min(1.0)
    }

    fn dentin(&self) -> f64 {
        if self.tissue != Tissue::Tooth {
            return 0.0;
        }
        let neck = smoothstep(0.55, 0.02, self.v);
        (0.75 * neck * neck + 0.12 + 0.12 * self.noise(0x4e, 3.0, 2) + self.p.tooth_shade).clamp(0.0, 1.0)
    }

    fn crown(&self) -> f64 {
        const ENAMEL_MM: f64 = 1.0;
        const THICK_MM: f64 = 2.0;
        if self.tissue != Tissue::Tooth {
            return 0.0;
        }
        let dentin_mm = teeth::incisor_thickness_mm(self.v) * self.p.tooth_scale - ENAMEL_MM;
        // The lobes of dentin end unevenly below the edge.
        dentin_mm / THICK_MM + 0.08 * self.noise(0x50, 1.5, 2)
    }

    fn dryness(&self) -> f64 {
        let pools = 0.5 + 0.9 * self.noise(0x4f, 5.0, 3);
        match self.tissue {
            Tissue::TongueDorsum => 0.45 + 0.4 * pools,
            Tissue::Lip => 0.25 + 0.65 * smoothstep(0.6, 0.35, self.v) * (0.5 + 0.5 * pools),
            Tissue::Skin => 1.0,
            Tissue::Tooth => 0.3 * pools + 0.3 * self.plaque(),
            _ => 0.15 + 0.6 * pools * pools,
        }
    }
}

/// Creases of the dry lip at a length along it, mm, and a place across it (0 at its border, 1 inside).
pub(super) fn crease(seed: u32, along: f64, v: f64) -> f64 {
    let bend = along + 0.7 * fractal_noise(seed ^ 0x55, along * 0.3, 4.0 * v, 2);
    let coarse = bell(value_noise(seed ^ 0x56, bend * 0.75, 0.6 * v) / 0.16);
    let fine = bell(value_noise(seed ^ 0x57, bend * 1.7, 0.8 * v) / 0.14);
    (0.8 * coarse + 0.45 * fine).min(1.0) * smoothstep(0.0, 0.06, v) * smoothstep(0.62, 0.4, v)
}
