//! Where a lesion is: its share on the map of a part.

mod unrolled;

use glam::{Vec2, Vec3};

pub(super) use self::unrolled::{SIDE, pixel_center};
use self::unrolled::{Start, Unrolled, triangle_at};
use super::context::{Context, Resolved};
use crate::error::Place;
use crate::schema::LesionSection;
use fluorspar::geometry::TriangleMesh;
use fluorspar::material::ImageTexture;
use fluorspar::sampling::random::Key;
use fluorspar_format::{Transfer, read_texture_png};

/// Shortest and longest axis of an ellipse, mm: from less than a pixel of the textures to more than any part is long.
const SIZE_MM: [f64; 2] = [0.1, 200.0];
/// Waves around an irregular border, from the longest to the shortest: the first ones would move or stretch the ellipse.
const WAVES: std::ops::RangeInclusive<i32> = 3..=10;
/// Angles at which the border is sampled to keep its area.
const ANGLES: usize = 720;
/// Radii of satellites over the mean half axis of the lesion.
const SATELLITE_RADII: [f32; 2] = [0.08, 0.22];
/// Distances of their middles from the border, over those of the border from the middle of the lesion.
const SATELLITE_DISTANCES: [f32; 2] = [1.25, 1.8];

/// How the map of one part continues that of another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unfold {
    /// They share it.
    Same,
    /// Both end at the border of the tongue, u = 0 and u = 1, with the same coordinates: one is the other, turned over.
    AcrossBorder,
}

/// How lengths on a part are measured from the middle of a lesion.
pub(super) enum Lengths {
    /// By the map of tongue or cheek, which spreads evenly over them.
    OfMap {
        center: Vec2,
        /// Lengths on the surface per texture coordinate near the middle, m, and the cosine between the two directions:
        /// u and v need not be at right angles there.
        lengths: [f32; 2],
        lean: f32,
    },
    /// Along the surface itself: maps of other parts close around them, have poles, or are stretched.
    OfSurface(Unrolled),
}

/// Weight of a lesion on a part.
pub(super) enum Spot {
    Painted(ImageTexture),
    Ellipse {
        lengths: Lengths,
        /// Half axes and edge, m; cosine and sine of the turn.
        axes: [f32; 2],
        edge: f32,
        turn: [f32; 2],
        border: Border,
        /// Middle along the turned axes and radius of each spot around it, m.
        satellites: Vec<(Vec2, f32)>,
    },
}

/// An irregular border: its distance from the middle over that of the ellipse is `exp(sum a_k cos(k phi) + b_k sin(k phi) - c)`,
/// where `c` keeps the area.
#[derive(Clone, Debug, Default)]
pub(super) struct Border {
    waves: Vec<[f32; 2]>,
    area: f32,
    /// Least and greatest of that ratio; 1 without waves.
    limits: [f32; 2],
}

impl Border {
    /// A border whose logarithm has the standard deviation `irregularity`; shorter waves are lower.
    fn new(irregularity: f64, key: Key) -> Self {
        if irregularity <= 0.0 {
            return Self { waves: Vec::new(), area: 0.0, limits: [1.0; 2] };
        }
        let of_wave = |k: i32| key.with(k.unsigned_abs().into());
        let power: f64 = WAVES.map(|k| f64::from(k).powi(-2)).sum();
        let wave = |k: i32| {
            let height = irregularity / (power.sqrt() * f64::from(k));
            [0, 1].map(|part| (height * of_wave(k).with(part).normal()) as f32)
        };
        let mut border = Self { waves: WAVES.map(wave).collect(), area: 0.0, limits: [1.0; 2] };
        let ratio = |border: &Self, i: usize| {
            let angle = std::f32::consts::TAU * i as f32 / ANGLES as f32;
            border.ratio(Vec2::from_angle(angle))
        };
        let squares: f32 = (0..ANGLES).map(|i| ratio(&border, i).powi(2)).sum();
        border.area = 0.5 * (squares / ANGLES as f32).ln();
        border.limits = (0..ANGLES)
            .map(|i| ratio(&border, i))
            .fold([1.0, 1.0], |[low, high], ratio| [ratio.min(low), ratio.max(high)]);
        border
    }

    /// The ratio in a direction of length 1.
    fn ratio(&self, direction: Vec2) -> f32 {
        let longest = *WAVES.start();
        let mut turned = (1..longest).fold(direction, |turned, _| turned.rotate(direction));
        let mut sum = -self.area;
        for [a, b] in &self.waves {
            sum += a * turned.x + b * turned.y;
            turned = turned.rotate(direction);
        }
        sum.exp()
    }

    /// The ratio in the direction of a point at a distance `r` over that of the ellipse, where it matters.
    fn toward(&self, point: Vec2, r: f32) -> f32 {
        let [low, high] = self.limits;
        if self.waves.is_empty() || r < 0.5 * low || r > 2.0 * high {
            return 1.0;
        }
        self.ratio(point / r)
    }
}

/// How much of a spot is at a distance beyond its rim, which fades over a width.
fn faded(beyond: f32, edge: f32) -> f32 {
    if edge <= 0.0 {
        return if beyond <= 0.0 { 1.0 } else { 0.0 };
    }
    let t = (0.5 - beyond / edge).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Middles and radii of the spots around a lesion, m, along its axes.
fn satellites(count: u32, axes: [f32; 2], border: &Border, key: Key) -> Vec<(Vec2, f32)> {
    let between = |[low, high]: [f32; 2], share: f32| low + share * (high - low);
    let one = |number: u32| {
        // The upper 24 bits of a hash are a number between 0 and 1
        let share = |id: u64| (key.with(number.into()).with(id).value() >> 40) as f32 / (1_u32 << 24) as f32;
        let [angle, distance, size] = [0, 1, 2].map(share);
        let direction = Vec2::from_angle(std::f32::consts::TAU * angle);
        let distance = border.ratio(direction) * between(SATELLITE_DISTANCES, distance);
        let radius = (axes[0] * axes[1]).sqrt() * between(SATELLITE_RADII, size);
        (direction * distance * Vec2::from(axes), radius)
    };
    (0..count).map(one).collect()
}

impl Spot {
    pub(super) fn new(
        context: &mut Context<'_>,
        at: &Place,
        lesion: &LesionSection,
        mesh: &TriangleMesh,
    ) -> Resolved<Self> {
        if let Some(file) = &lesion.mask {
            let of_ellipses = [
                ("border_irregularity", lesion.border_irregularity.is_some()),
                ("satellites", lesion.satellites.is_some()),
                ("seed", lesion.seed.is_some()),
            ];
            if let Some((field, _)) = of_ellipses.iter().find(|(_, given)| *given) {
                return context
                    .fail(&at.field(*field), "a painted mask has its own border; remove this, or the mask");
            }
            let at = at.field("mask");
            context.note_input(&at, file)?;
            let image =
                read_texture_png(file.as_ref(), Transfer::Linear).map_err(|e| context.file_error(&at, &e))?;
            let colored = |pixel: &[f32]| pixel.len() > 2 && (pixel[0] != pixel[1] || pixel[1] != pixel[2]);
            if image.data.chunks_exact(image.channels).any(colored) {
                let message = "the image has colors; the mean of red, green and blue is taken: white is inside, black \
                               outside. Save it as a gray PNG";
                context.warn(&at, message);
            }
            let gray = image.data.chunks_exact(image.channels).map(super::spectrum::gray).collect();
            let image = ImageTexture::new(image.width, image.height, gray)
                .map_err(|e| context.error(&at, e.to_string()))?;
            return Ok(Self::Painted(image));
        }
        for value in lesion.center {
            context.within(&at.field("center"), value, [0.0, 1.0], "of the part")?;
        }
        for size in lesion.size_mm {
            context.within(&at.field("size_mm"), size, SIZE_MM, "mm")?;
        }
        context.within(&at.field("edge_mm"), lesion.edge_mm, [0.0, 100.0], "mm")?;
        context.within(&at.field("angle_deg"), lesion.angle_deg, [-360.0, 360.0], "degrees")?;
        let irregularity = lesion.border_irregularity.unwrap_or(0.0);
        context.within(&at.field("border_irregularity"), irregularity, [0.0, 0.5], "")?;
        let count = lesion.satellites.unwrap_or(0);
        context.whole_within(&at.field("satellites"), count.into(), [0, 50])?;
        let center = Vec2::new(lesion.center[0] as f32, lesion.center[1] as f32);
        let surface = triangle_at(mesh, center);
        let windows = [0.04, 0.08, 0.16, 0.32, 1.0].into_iter();
        let stretched =
            surface.and_then(|_| windows.clone().find_map(|window| stretch(mesh, center, window)));
        let (Some(surface), Some((along_u, along_v))) = (surface, stretched) else {
            let [low, high] = uv_bounds(mesh);
            let message = format!(
                "the part has no surface at these texture coordinates; its surface lies between [{:.2}, {:.2}] and [{:.2}, {:.2}]. \
                 Choose another center",
                low.x, low.y, high.x, high.y
            );
            return context.fail(&at.field("center"), message);
        };
        let (sine, cosine) = (lesion.angle_deg.to_radians() as f32).sin_cos();
        let (length_u, length_v) = (along_u.length(), along_v.length());
        let key = Key::new(lesion.seed.unwrap_or(0)).with_text(&lesion.name);
        let axes = lesion.size_mm.map(|size| 0.5e-3 * size as f32);
        let edge = 1e-3 * lesion.edge_mm as f32;
        let border = Border::new(irregularity, key.with_text("border"));
        let lengths = if ["tongue_", "cheek_"].iter().any(|start| lesion.part.starts_with(start)) {
            let lean = along_u.dot(along_v) / (length_u * length_v).max(1e-20);
            Lengths::OfMap { center, lengths: [length_u, length_v], lean }
        } else {
            let farthest = if count > 0 { SATELLITE_DISTANCES[1] + SATELLITE_RADII[1] } else { 1.0 };
            let reach = farthest * border.limits[1] * axes[0].max(axes[1]) + edge;
            let radii = [(axes[0] * axes[1]).sqrt(), reach];
            let start = Start { corners: surface, along: [along_u, along_v], radii };
            Lengths::OfSurface(Unrolled::new(mesh, &start))
        };
        Ok(Self::Ellipse {
            lengths,
            axes,
            edge,
            turn: [cosine, sine],
            satellites: satellites(count, axes, &border, key.with_text("satellites")),
            border,
        })
    }

    /// The share of an ellipse, 0 to 1, at a place on the surface, m from its middle.
    fn of_ellipse(&self, Vec2 { x, y }: Vec2) -> f32 {
        let Self::Ellipse { axes, edge, turn: [cosine, sine], border, satellites, .. } = self else {
            return 0.0;
        };
        if !(x.is_finite() && y.is_finite()) {
            return 0.0;
        }
        let (p, q) = (x * cosine + y * sine, y * cosine - x * sine);
        let point = Vec2::new(p / axes[0], q / axes[1]);
        let r = point.length();
        // Distance beyond the rim, to first order.
        let beyond = (r - border.toward(point, r)) * axes[0].min(axes[1]);
        let around = satellites.iter().map(|(middle, radius)| {
            let beyond = Vec2::new(p, q).distance(*middle) - radius;
            faded(beyond, edge.min(*radius))
        });
        around.fold(faded(beyond, *edge), f32::max)
    }

    /// The share at every pixel of a part of this mesh; `None` where the lesion does not reach it. What is painted stays on its map.
    pub(super) fn bake(&self, mesh: &TriangleMesh, unfold: Unfold) -> Option<Vec<f32>> {
        let pixels = (0..SIDE * SIDE).map(pixel_center);
        let mask: Vec<f32> = match (self, unfold) {
            (Self::Painted(image), Unfold::Same) => pixels.map(|uv| image.at(uv).min(1.0)).collect(),
            (Self::Painted(_), Unfold::AcrossBorder) => return None,
            (Self::Ellipse { lengths: Lengths::OfSurface(surface), .. }, _) => {
                surface.bake(mesh, |place| self.of_ellipse(place))
            }
            (Self::Ellipse { lengths: Lengths::OfMap { center, lengths, lean }, .. }, _) => {
                let twice_border = if center.x > 0.5 { 2.0 } else { 0.0 };
                let upright = (1.0 - lean * lean).max(0.0).sqrt();
                let place = |uv: Vec2| {
                    let d = match unfold {
                        Unfold::Same => uv,
                        Unfold::AcrossBorder => Vec2::new(twice_border - uv.x, uv.y),
                    } - *center;
                    Vec2::new(d.x * lengths[0] + d.y * lengths[1] * lean, d.y * lengths[1] * upright)
                };
                pixels.map(|uv| self.of_ellipse(place(uv))).collect()
            }
        };
        mask.iter().any(|&m| m > 0.0).then_some(mask)
    }
}

/// Least and greatest texture coordinates of a part.
fn uv_bounds(mesh: &TriangleMesh) -> [Vec2; 2] {
    let first = mesh.uvs.first().copied().unwrap_or_default();
    mesh.uvs.iter().fold([first, first], |[low, high], uv| [low.min(*uv), high.max(*uv)])
}

/// Change of position per texture coordinate around a point, m: the mean over triangles whose middles are in a window.
fn stretch(mesh: &TriangleMesh, at: Vec2, window: f32) -> Option<(Vec3, Vec3)> {
    let mut sums = (Vec3::ZERO, Vec3::ZERO, 0.0_f32);
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| mesh.uvs[v as usize]);
        let middle = (a + b + c) / 3.0;
        if (middle - at).abs().max_element() > window {
            continue;
        }
        let [p, q, r] = triangle.map(|v| mesh.positions[v as usize]);
        let (e, f) = (b - a, c - a);
        let area = e.perp_dot(f);
        if area.abs() < 1e-12 {
            continue;
        }
        let (pe, pf) = (q - p, r - p);
        let weight = area.abs();
        sums.0 += (pe * f.y - pf * e.y) / area * weight;
        sums.1 += (pf * e.x - pe * f.x) / area * weight;
        sums.2 += weight;
    }
    (sums.2 > 0.0).then(|| (sums.0 / sums.2, sums.1 / sums.2))
}

#[cfg(test)]
mod tests {
    use fluorspar_anatomy::{Mouth, MouthParameters, generate_mouth};

    use super::*;
    use crate::error::steps;

    /// An ellipse of 12 by 6 mm on a map that is 60 mm wide and 80 mm long, its middle 1.8 mm from the left border.
    fn spot() -> Spot {
        Spot::Ellipse {
            lengths: Lengths::OfMap { center: Vec2::new(0.97, 0.3), lengths: [0.06, 0.08], lean: 0.0 },
            axes: [3e-3, 6e-3],
            edge: 1e-3,
            turn: [1.0, 0.0],
            border: Border::new(0.0, Key::new(0)),
            satellites: Vec::new(),
        }
    }

    #[test]
    fn a_spot_on_the_border_of_the_tongue_goes_on_underneath() {
        let [back, under] = [Unfold::Same, Unfold::AcrossBorder]
            .map(|unfold| spot().bake(&TriangleMesh::default(), unfold).unwrap());
        let row = (0.7 * SIDE as f64) as usize;
        let at = |mask: &[f32], column: usize| mask[row * SIDE + column];
        // The same on both sides of the border, less and less away from the middle of the spot, nothing far from it.
        assert!((at(&back, SIDE - 1) - at(&under, SIDE - 1)).abs() < 0.25);
        assert!(at(&under, SIDE - 1) > 0.5, "{}", at(&under, SIDE - 1));
        for column in SIDE - 40..SIDE - 1 {
            assert!(at(&under, column) <= at(&under, column + 1));
        }
        assert_eq!((at(&under, SIDE / 2), at(&back, SIDE / 2)), (0.0, 0.0));
        // Its area is that of an ellipse cut by the border, both sides together the whole of it.
        let pixel_mm2 = 60.0 * 80.0 / (SIDE * SIDE) as f32;
        let area = (back.iter().sum::<f32>() + under.iter().sum::<f32>()) * pixel_mm2;
        let whole = std::f32::consts::PI * 3.0 * 6.0;
        // The edge is half a millimeter wide on each side, to first order in the distance from the rim.
        assert!((area / whole - 1.0).abs() < 0.03, "{area} mm2 of {whole}");
    }

    /// The border of an irregular spot has its area and its standard deviation; satellites lie outside and are small.
    #[test]
    fn an_irregular_border_keeps_its_area() {
        let deviations: Vec<f32> = (0..40)
            .map(|seed| {
                let border = Border::new(0.2, Key::new(seed));
                let ratios: Vec<f32> = (0..ANGLES)
                    .map(|i| border.ratio(Vec2::from_angle(std::f32::consts::TAU * i as f32 / ANGLES as f32)))
                    .collect();
                let area = ratios.iter().map(|ratio| ratio * ratio).sum::<f32>() / ANGLES as f32;
                assert!((area - 1.0).abs() < 1e-4, "{area}");
                let spots = satellites(6, [4e-3, 2e-3], &border, Key::new(seed));
                for (middle, radius) in spots {
                    let ellipse = Vec2::new(middle.x / 4e-3, middle.y / 2e-3);
                    let r = ellipse.length();
                    assert!(r > 1.2 * border.toward(ellipse, r) && radius < 0.7e-3, "{middle} {radius}");
                }
                ratios.iter().map(|ratio| (ratio.ln() + border.area).powi(2)).sum::<f32>() / ANGLES as f32
            })
            .collect();
        // Of forty borders with sixteen normal numbers each
        let deviation = (deviations.iter().sum::<f32>() / 40.0).sqrt();
        assert!((deviation / 0.2 - 1.0).abs() < 0.15, "{deviation}");
    }

    fn lesion(part: &str, center: [f64; 2], size_mm: [f64; 2]) -> LesionSection {
        let text = format!("name = \"spot\"\npart = \"{part}\"\ncenter = {center:?}\nsize_mm = {size_mm:?}");
        toml::from_str(&text).unwrap()
    }

    /// Area of a lesion on a part over that of its ellipse.
    fn relative_area(mouth: &Mouth, part: &str, center: [f64; 2], size_mm: [f64; 2]) -> f32 {
        let mesh = &mouth.part(part).unwrap().mesh;
        let text = "format = 1\nbase = \"oraleye-2021\"\n";
        let experiment = crate::parse(text, "x", std::path::Path::new("."), &[]).unwrap();
        let mut context = Context::new(&experiment.document);
        let lesion = lesion(part, center, size_mm);
        let spot = Spot::new(&mut context, &steps!["lesion"], &lesion, mesh).unwrap();
        let map = ImageTexture::new(SIDE, SIDE, spot.bake(mesh, Unfold::Same).unwrap()).unwrap();
        let on_triangle = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|vertex| mesh.uvs[vertex as usize]);
            let places = (0..36).map(|i| [(i % 6) as f32 + 0.5, (i / 6) as f32 + 0.5].map(|x| x / 6.0));
            // The upper half of the square is turned over onto the lower one
            let places = places.map(|[s, t]| if s + t > 1.0 { [1.0 - s, 1.0 - t] } else { [s, t] });
            let mean = places.map(|[s, t]| map.at(a + s * (b - a) + t * (c - a))).sum::<f32>() / 36.0;
            0.5 * mesh.triangle_cross(triangle).length() * mean
        };
        let area: f32 = mesh.triangles.iter().map(on_triangle).sum();
        1e6 * area / (std::f32::consts::FRAC_PI_4 * (size_mm[0] * size_mm[1]) as f32)
    }

    /// Across the seams of closed parts, at the pole of a biting surface, on meshes of few triangles; cusps have more surface than lies under
    /// them.
    #[test]
    fn a_lesion_has_its_area_on_every_part() {
        let mouth = generate_mouth(&MouthParameters { detail: 0.4, ..MouthParameters::default() }).unwrap();
        for (part, center, size_mm) in [
            ("cheek_right", [0.5, 0.56], [10.0, 7.0]),
            ("lower_lip", [0.1, 0.5], [8.0, 6.0]),
            ("tooth_11", [0.0, 0.5], [3.0, 3.0]),
            ("tooth_46", [0.5, 0.5], [3.0, 2.0]),
            ("uvula", [0.0, 0.5], [4.0, 4.0]),
            ("tonsil_left", [0.5, 0.5], [8.0, 6.0]),
            ("frenulum", [0.5, 0.5], [3.0, 3.0]),
        ] {
            let ratio = relative_area(&mouth, part, center, size_mm);
            assert!((0.85..1.15).contains(&ratio), "{part}: {ratio}");
        }
        let bite = relative_area(&mouth, "tooth_46", [0.25, 1.0], [3.0, 3.0]);
        assert!((0.9..1.4).contains(&bite), "{bite}");
    }
}
