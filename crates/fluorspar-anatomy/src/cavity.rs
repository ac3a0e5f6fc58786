//! The bag of the mouth: one closed sheet from the facial skin over the lips and the cheeks to the back of the
//! throat, cut into named parts along its rows, so that no gap can open between them.

use glam::{DVec2, DVec3};

use super::appearance::crease;
use super::clearance::{Field, Obstacles};
use super::math::{PI, bell, curve, lerp, mean, pow, signed_pow, sin_cos, smoothstep, spline, window};
use super::noise::fractal_noise;
use super::parameters::MouthParameters;
use super::surface::{count, linspace, surface_mesh};
use super::{Part, Tissue};

/// A closed loop around the opening, given by its extents.
struct Ring {
    half_width: f64,
    top: f64,
    bottom: f64,
    /// Exponent of the superellipse.
    squareness: f64,
    /// Distance in front of the opening plane at the top, the bottom and the sides.
    z: [f64; 3],
}

/// Grid on which contacts are found.
const CONTACT_ROWS_PER_RING: usize = 4;
const CONTACT_COLUMNS: usize = 144;
/// Distance kept from teeth and gums, mm.
const CLEARANCE_MM: f64 = 0.6;

/// Columns over which a lip keeps its shape when it gives way.
const LIP_REACH: usize = 14;

/// Rings at which the sheet changes its part.
const VERMILION_BORDER: usize = 7;
const INNER_LIP: usize = 12;
const THROAT: usize = 17;
/// The same border as a place, from which places are counted.
const BORDER: f64 = VERMILION_BORDER as f64;

/// Half the power of the distance from the midline by which the rings fall back toward the corners.
const BOW: &[(f64, f64)] = &[(BORDER + 3.0, 1.1), (BORDER + 6.0, 1.6)];

/// From the edges of the upper incisors up to the base of the nose, mm: the upper lip is 20 to 22 mm high (Farkas), and the edges
/// stand 2 mm below it.
const NOSE_BASE_MM: f64 = 23.0;
/// Half the width of the nose at its wings, mm (31 to 35 mm in all, Farkas).
const HALF_NOSE_MM: f64 = 16.5;
/// How far the middle of the nose stands out over the height above its base, mm (18 to 19.5 mm at the tip, Farkas).
const NOSE: &[(f64, f64)] =
    &[(-1.5, 0.0), (2.0, 3.5), (6.0, 13.0), (10.0, 17.5), (15.0, 17.0), (40.0, 8.0), (70.0, 6.0)];
/// From the edges of the lower incisors down to the fold above the chin and to its foremost place, mm (assumed).
const CHIN_FOLD_MM: f64 = 22.0;
const CHIN_MM: f64 = 38.0;

/// The whole sheet, pressed outward where teeth and gums stand.
pub(super) struct Sheet<'a> {
    parameters: &'a MouthParameters,
    rings: Vec<Ring>,
    pressed: Field,
}

impl<'a> Sheet<'a> {
    pub(super) fn new(parameters: &'a MouthParameters, obstacles: &Obstacles) -> Self {
        const ENOUGH_MM: f64 = 0.15;
        let wanted = 0.5 * parameters.lip_opening_width_mm;
        let mut corner = wanted;
        let mut sheet = Self::with_corner(corner, parameters, obstacles);
        // Corners that give way widen the opening: they start from so much nearer to the middle.
        for _ in 0..3 {
            let excess = sheet.corner() - wanted;
            if excess < ENOUGH_MM {
                break;
            }
            corner -= excess;
            sheet = Self::with_corner(corner, parameters, obstacles);
        }
        sheet
    }

    /// Mean distance of the innermost places of the lips' corners from the midline, mm.
    fn corner(&self) -> f64 {
        let innermost = |turn: f64| {
            let knots: Vec<DVec3> = (0..self.rings.len()).map(|ring| self.ring_point(ring, turn)).collect();
            linspace(VERMILION_BORDER as f64, INNER_LIP as f64, 25)
                .into_iter()
                .map(|place| self.point(&knots, place, turn).x.abs())
                .fold(f64::INFINITY, f64::min)
        };
        0.5 * (innermost(0.0) + innermost(0.5))
    }

    /// The sheet with corners so far from the midline before they give way, mm.
    fn with_corner(corner: f64, parameters: &'a MouthParameters, obstacles: &Obstacles) -> Self {
        let h = 0.5 * parameters.jaw_opening_mm;
        // Margins of the lips.
        let m = h + parameters.lip_retraction_mm;
        let widest = (0.5 * parameters.upper_arch_width_mm + 10.0).max(corner + 5.0);
        let fornix = h + 20.5;
        let ring = |half_width, top, bottom, squareness, z| Ring { half_width, top, bottom, squareness, z };
        let rings = vec![
            // The sides of the head, from which the face comes forward.
            ring(corner + 34.0, m + 84.0, m + 66.0, 2.2, [-30.0, -70.0, -100.0]),
            ring(corner + 38.0, m + 66.0, m + 58.0, 2.3, [-4.0, -22.0, -66.0]),
            ring(corner + 35.0, m + 45.0, m + 45.0, 2.3, [2.0, 5.0, -34.0]),
            ring(corner + 21.0, m + 28.0, m + 30.0, 2.2, [7.0, 8.5, -18.0]),
            ring(corner + 11.0, m + 17.5, m + 19.0, 2.1, [9.0, 7.0, -11.5]),
            ring(corner + 6.5, m + 11.0, m + 13.0, 1.95, [9.8, 8.0, -10.6]),
            // The white roll, the border of the red and its fullest place, which run together toward the corners.
            ring(corner + 3.7, m + 7.3, m + 10.2, 1.86, [10.8, 10.0, -10.1]),
            ring(corner + 2.9, m + 6.0, m + 9.0, 1.84, [10.6, 10.7, -10.0]),
            ring(corner + 1.5, m + 3.0, m + 5.4, 1.86, [12.3, 13.8, -9.6]),
            ring(corner + 0.3, m + 0.8, m + 1.4, 1.88, [10.9, 12.0, -10.9]),
            ring(corner, m, m, 1.9, [8.2, 8.9, -13.0]),
            ring(corner + 0.9, m + 1.6, m + 1.6, 2.1, [5.2, 5.6, -16.0]),
            ring(corner + 3.2, m + 0.55 * (fornix - m), m + 0.55 * (fornix - m), 2.4, [4.6, 4.4, -19.5]),
            ring(widest - 0.5, fornix, fornix - 1.0, 3.2, [1.5, 1.5, -25.0]),
            ring(widest + 1.0, fornix - 0.5, fornix - 0.5, 3.6, [-14.0, -14.0, -32.0]),
            ring(widest, fornix - 3.0, fornix - 2.0, 3.4, [-36.0, -36.0, -44.0]),
            ring(widest - 9.0, h + 10.0, h + 14.0, 3.0, [-54.0, -54.0, -55.0]),
            ring(widest - 14.0, h + 4.0, h + 13.0, 2.6, [-68.0, -68.0, -67.0]),
            // Folds of the hind pillars beside the throat, then its back wall.
            ring(widest - 20.0, h - 1.0, h + 12.0, 2.4, [-74.0, -74.0, -72.5]),
            ring(widest - 16.5, h - 1.0, h + 12.0, 2.4, [-79.0, -79.0, -77.0]),
            ring(widest - 18.5, h - 3.0, h + 10.0, 2.3, [-84.0, -85.0, -82.5]),
            ring(0.0, 0.0, 0.0, 2.0, [-90.0, -90.0, -90.0]),
        ];
        let rows = (rings.len() - 1) * CONTACT_ROWS_PER_RING + 1;
        let values = vec![0.0; rows * CONTACT_COLUMNS];
        let pressed = Field { rows, columns: CONTACT_COLUMNS, cyclic: true, values };
        let mut sheet = Self { parameters, rings, pressed };
        sheet.press(obstacles);
        sheet
    }

    /// Where a place of the sheet gives way to: forward at the lips, outward at the cheeks.
    fn way_out(place: f64, turn: f64) -> DVec3 {
        let (sine, cosine) = sin_cos(2.0 * PI * turn);
        let front = lerp(
            smoothstep(BORDER + 5.3, BORDER + 4.0, place),
            smoothstep(BORDER + 7.2, BORDER + 6.2, place),
            smoothstep(0.5, 0.9, sine.abs()),
        );
        let outward = DVec3::new(cosine, sine, 0.0).lerp(DVec3::new(0.5 * cosine, 0.12 * sine, 1.0), front);
        outward.normalize()
    }

    /// Finds how far the sheet must give way to teeth and gums.
    fn press(&mut self, obstacles: &Obstacles) {
        const REACH: f64 = 25.0;
        for column in 0..CONTACT_COLUMNS {
            let turn = column as f64 / CONTACT_COLUMNS as f64;
            let knots: Vec<DVec3> = (0..self.rings.len()).map(|ring| self.ring_point(ring, turn)).collect();
            for row in 0..self.pressed.rows {
                let place = row as f64 / CONTACT_ROWS_PER_RING as f64;
                // Behind the fornix of the vestibule the gums are attached to the sheet.
                if !(BORDER - 3.0..BORDER + 8.5).contains(&place) {
                    continue;
                }
                let way = Self::way_out(place, turn);
                let from = spline(&knots, place) + way * REACH;
                if let Some(hit) = obstacles.distance(from, -way, REACH + CLEARANCE_MM) {
                    self.pressed.values[row * CONTACT_COLUMNS + column] = REACH + CLEARANCE_MM - hit;
                }
            }
        }
        // The skin of the face goes with the lining behind it, and either lip as a whole, less toward its corners.
        let at = |place: usize, column: usize| place * CONTACT_COLUMNS + column;
        let half = CONTACT_COLUMNS / 2;
        let border = VERMILION_BORDER * CONTACT_ROWS_PER_RING;
        for lip in [0..half, half..CONTACT_COLUMNS] {
            let lining: Vec<f64> = lip
                .clone()
                .map(|column| {
                    (border + 2..=border + 30)
                        .map(|row| self.pressed.values[at(row, column)])
                        .fold(0.0, f64::max)
                })
                .collect();
            let whole = window(&lining, LIP_REACH, &|near| near.iter().copied().fold(0.0, f64::max));
            let whole = window(&whole, LIP_REACH, &mean);
            for ((column, lining), whole) in lip.zip(lining).zip(whole) {
                let (sine, _) = sin_cos(2.0 * PI * column as f64 / CONTACT_COLUMNS as f64);
                let pushed = lining.max(whole * smoothstep(0.1, 0.7, sine.abs()));
                for row in border - 13..=border + 8 {
                    let value = &mut self.pressed.values[at(row, column)];
                    *value = value.max(pushed);
                }
                let inside = &mut self.pressed.values;
                for row in border + 9..=border + 24 {
                    let share = smoothstep(24.0, 8.0, (row - border) as f64);
                    inside[at(row, column)] = inside[at(row, column)].max(pushed * share);
                }
            }
        }
        if self.pressed.values.iter().any(|v| *v > 0.0) {
            // Lips and cheeks bridge from tooth to tooth.
            self.pressed.bridge(1, 5);
            self.pressed.spread(0.7, 0.9, 1.4);
        }
    }

    /// Point of a ring in a direction: 0 at the left corner, a quarter at the top.
    fn ring_point(&self, number: usize, turn: f64) -> DVec3 {
        let ring = &self.rings[number];
        let (sine, cosine) = sin_cos(2.0 * PI * turn);
        let power = 2.0 / ring.squareness;
        let x = ring.half_width * signed_pow(cosine, power);
        let mut y = (if sine > 0.0 { ring.top } else { ring.bottom }) * rounded_pow(sine, power);
        let middle = if sine > 0.0 { ring.z[0] } else { ring.z[1] };
        // Front rings follow the round of the dental arch, hind rings are flat; both run round the corner. Seen from above
        // lips and face are nearly parabolas, the fold of the vestibule is a U around the gums.
        let bow = curve(BOW, number as f64);
        let mut z = lerp(ring.z[2], middle, 1.0 - pow((1.0 - sine * sine).max(0.0), bow));
        let below_border = number as isize - VERMILION_BORDER as isize;
        if sine > 0.0 {
            match below_border {
                // Cupid's bow and the tubercle of the upper lip.
                -1 | 0 => y += 1.3 * bell((x.abs() - 5.8) / 4.6) - 1.1 * bell(x / 3.2),
                1 => {
                    y -= 0.5 * bell(x / 4.5);
                    z += 0.5 * bell(x / 4.0);
                }
                2 => y -= 0.7 * bell(x / 4.8),
                3 => y -= 0.9 * bell(x / 5.5),
                // Groove of the philtrum between its two columns.
                -2 => {
                    y += 1.0 * bell((x.abs() - 5.5) / 3.6) - 0.8 * bell(x / 2.6);
                    z += 0.8 * bell((x.abs() - 5.2) / 2.0) - 1.1 * bell(x / 2.8);
                }
                -3 => z += 0.7 * bell((x.abs() - 5.0) / 2.2) - 1.3 * bell(x / 3.0),
                _ => {}
            }
        } else if (1..=2).contains(&below_border) {
            // The two pillows of the lower lip.
            z += 0.6 * bell((x.abs() - 8.0) / 7.0) - 0.3 * bell(x / 4.0);
        }
        DVec3::new(x, y, z)
    }

    /// Nose, folds beside it and chin: how far they stand out in front of the even face, mm.
    fn face_relief(&self, x: f64, y: f64) -> f64 {
        let half_opening = 0.5 * self.parameters.jaw_opening_mm;
        let (above, below) = (y - half_opening - NOSE_BASE_MM, -half_opening - y);
        let a = x.abs();
        let wing = 9.0 * bell((a - 0.75 * HALF_NOSE_MM) / 4.2) * bell((above - 8.0) / 6.5);
        let nostril = 7.0 * bell((a - 6.2) / 2.6) * bell((above - 3.6) / 2.6);
        let nose = (curve(NOSE, above) * bell(x / (0.55 * HALF_NOSE_MM))).max(wing) - nostril;
        // The fold from the wing of the nose past the corner of the mouth, and the cheek outside of it.
        let share = (y / (half_opening + NOSE_BASE_MM + 5.0)).max(-0.3);
        let from_fold =
            a - lerp(0.5 * self.parameters.lip_opening_width_mm + 11.0, HALF_NOSE_MM + 1.0, share);
        let ends = smoothstep(-0.3, 0.1, share) * smoothstep(1.25, 0.9, share);
        let fold = ends * (1.8 * bell((from_fold - 7.0) / 6.5) - 0.9 * bell(from_fold / 2.2));
        let chin = 5.0 * bell((below - CHIN_MM) / 10.0) * bell(x / 20.0)
            - 2.0 * bell((below - CHIN_FOLD_MM) / 4.5) * bell(x / 22.0);
        nose + fold + chin
    }

    /// How far the papilla of the parotid duct, beside the upper second molar, and the ridge along the line of the bite stand
    /// out of a cheek, mm (papilla 3 to 4 mm wide, assumed).
    fn cheek_relief(&self, point: DVec3) -> f64 {
        let molar = 0.5 * self.parameters.jaw_opening_mm;
        let papilla = bell((point.y - 0.3 * molar) / 1.8)
            * bell((point.z + 0.8 * self.parameters.upper_arch_depth_mm) / 2.0);
        2.2 * papilla
            + 0.5
                * bell(point.y / 1.2)
                * smoothstep(-16.0, -22.0, point.z)
                * smoothstep(-42.0, -36.0, point.z)
    }

    /// Point of the sheet: `place` counts rings from the face to the throat.
    fn point(&self, knots: &[DVec3], place: f64, turn: f64) -> DVec3 {
        let mut point = spline(knots, place);
        // Nothing presses on the throat: its back wall closes in one point.
        let pressed = self.pressed.at(place * CONTACT_ROWS_PER_RING as f64, turn * CONTACT_COLUMNS as f64)
            * smoothstep(BORDER + 11.0, BORDER + 8.5, place);
        if pressed > 0.0 {
            point += Self::way_out(place, turn) * pressed;
        }
        let seed = self.parameters.seed;
        let (sine, cosine) = sin_cos(2.0 * PI * turn);
        // Fine vertical folds of the lips' red, and pores and unevenness elsewhere.
        let red = smoothstep(BORDER, BORDER + 0.6, place) * smoothstep(BORDER + 4.6, BORDER + 3.6, place);
        let across = (place - BORDER) / (INNER_LIP - VERMILION_BORDER) as f64;
        // The same lengths as the maps use: half the ring is one lip.
        let along = 45.0 * (2.0 * (2.0 * turn).rem_euclid(1.0) - 1.0);
        let folds =
            crease(seed, along, across) + 0.45 * fractal_noise(seed ^ 0x21, along * 0.8, 0.8 * across, 2);
        point -= Self::way_out(BORDER + 4.0, turn) * (0.32 * red * folds);
        let skin = smoothstep(BORDER, BORDER - 1.0, place);
        if skin > 0.0 {
            let uneven = 0.12 * fractal_noise(seed ^ 0x22, point.x * 0.5, point.y * 0.5, 3);
            point.z += skin * (uneven + self.face_relief(point.x, point.y));
        }
        let inside =
            smoothstep(BORDER + 6.0, BORDER + 7.0, place) * smoothstep(BORDER + 12.0, BORDER + 11.0, place);
        let swell = 0.9 * fractal_noise(seed ^ 0x23, 9.0 * cosine, 9.0 * sine + place * 1.3, 3);
        point - DVec3::new(cosine, sine, 0.0) * (inside * (swell + self.cheek_relief(point)))
    }
}

/// Like [`signed_pow`], but leaves zero with a finite slope: the corners of the mouth are round, however pointed the
/// loop is.
fn rounded_pow(base: f64, exponent: f64) -> f64 {
    const ROUND: f64 = 0.18;
    let (square, round) = (base * base, ROUND * ROUND);
    base * pow((square + round) / (1.0 + round), 0.5 * (exponent - 1.0))
}

impl Sheet<'_> {
    /// Face, lips, cheeks and the wall of the pharynx.
    pub(super) fn parts(&self, detail: f64) -> Vec<Part> {
        let sheet = self;
        // As fine as the folds of the lips; a whole number per quarter, so that the corners are columns.
        let quarter = count(64, detail);
        let columns = 4 * quarter;
        let knots: Vec<Vec<DVec3>> = (0..columns)
            .map(|column| {
                let turn = column as f64 / columns as f64;
                (0..sheet.rings.len()).map(|ring| sheet.ring_point(ring, turn)).collect()
            })
            .collect();
        let last = sheet.rings.len() - 1;
        // Rings from and to, rows per ring, columns from and to, name, tissue.
        let parts: [(usize, usize, usize, usize, usize, &str, Tissue); 6] = [
            (0, VERMILION_BORDER, 7, 0, columns, "face", Tissue::Skin),
            (VERMILION_BORDER, INNER_LIP, 5, 0, 2 * quarter, "upper_lip", Tissue::Lip),
            (VERMILION_BORDER, INNER_LIP, 5, 2 * quarter, 4 * quarter, "lower_lip", Tissue::Lip),
            (INNER_LIP, THROAT, 11, quarter, 3 * quarter, "cheek_right", Tissue::Cheek),
            (INNER_LIP, THROAT, 11, 3 * quarter, 5 * quarter, "cheek_left", Tissue::Cheek),
            (THROAT, last, 7, 0, columns, "pharyngeal_wall", Tissue::Throat),
        ];
        parts
            .into_iter()
            .map(|(from, to, rows, first, end, name, tissue)| {
                let v_values = linspace(
                    from as f64,
                    to as f64,
                    (to - from) * ((rows as f64 * detail).round() as usize).max(2),
                );
                let u_values: Vec<f64> = (first..=end).map(|column| column as f64).collect();
                let mesh = surface_mesh(&v_values, &u_values, true, |place, column| {
                    let column_number = column as usize % columns;
                    let turn = column_number as f64 / columns as f64;
                    let point = sheet.point(&knots[column_number], place, turn);
                    let u = (column - first as f64) / (end - first) as f64;
                    (point, DVec2::new(u, (place - from as f64) / (to - from) as f64))
                });
                Part { name: name.to_owned(), tissue, mesh }
            })
            .collect()
    }
}
