//! Shaded previews of the generated mouth, without any physics: a depth buffer and one light beside the camera.
//!
//! Usage: `mouth_preview OUT.png [VIEW] [FIELD=VALUE ...]`, where VIEW is `front`, `oblique`, `below`, `above`, ... or a
//! view of the examination, which brings its pose, and the fields are those of the mouth's parameters.

#![allow(clippy::print_stderr, reason = "what an example has to say")]

use std::fs::File;
use std::io::BufWriter;

use fluorspar_anatomy::{
    ExaminationView, MouthParameters, Part, SurfaceMap, Tissue, generate_mouth, surface_map,
};
use glam::{Vec2, Vec3};

const SIZE: usize = 1000;
/// Samples per pixel and side.
const FINE: usize = 2;

struct View {
    eye: Vec3,
    target: Vec3,
    /// Width of the picture at the target, m.
    field: f32,
}

fn color(tissue: Tissue) -> Vec3 {
    match tissue {
        Tissue::TongueDorsum => Vec3::new(0.78, 0.42, 0.42),
        Tissue::TongueVentral => Vec3::new(0.72, 0.32, 0.34),
        Tissue::Gingiva => Vec3::new(0.84, 0.48, 0.48),
        Tissue::Tooth => Vec3::new(0.93, 0.89, 0.78),
        Tissue::HardPalate => Vec3::new(0.85, 0.55, 0.52),
        Tissue::SoftPalate => Vec3::new(0.78, 0.40, 0.38),
        Tissue::Throat => Vec3::new(0.55, 0.18, 0.18),
        Tissue::FloorOfMouth => Vec3::new(0.70, 0.30, 0.32),
        Tissue::Cheek => Vec3::new(0.72, 0.34, 0.34),
        Tissue::Lip => Vec3::new(0.76, 0.38, 0.38),
        Tissue::Skin => Vec3::new(0.86, 0.66, 0.56),
        _ => Vec3::splat(0.5),
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let output = arguments.first().ok_or("name the PNG file to write")?;
    let fields = || arguments[1..].iter().filter_map(|argument| argument.split_once('='));
    let view = arguments[1..].iter().find(|argument| !argument.contains('=')).map_or("front", |view| view);
    let mut person = MouthParameters::default();
    if let Some(view) = ExaminationView::find(view) {
        person = view.pose(&person);
    }
    let mut parameters = serde_json::to_value(person)?;
    for (field, value) in fields() {
        parameters[field] = serde_json::from_str(value)?;
    }
    let parameters: MouthParameters = serde_json::from_value(parameters)?;
    let start = std::time::Instant::now();
    let mouth = generate_mouth(&parameters)?;
    eprintln!("{} triangles in {:.3} s", mouth.triangle_count(), start.elapsed().as_secs_f64());
    eprintln!("{:#?}", mouth.dimensions());
    let mut picture = Picture::new(view_named(view)?, parameters);
    for (number, part) in mouth.parts.iter().enumerate() {
        for triangle in &part.mesh.triangles {
            picture.draw(number, part, *triangle);
        }
    }
    for (number, part) in mouth.parts.iter().enumerate() {
        let samples = picture.hidden_side.iter().filter(|&&n| n == number).count();
        if samples > 0 {
            eprintln!("hidden side seen: {} in {samples} samples", part.name);
        }
    }
    picture.write_png(output)
}

fn view_named(name: &str) -> Result<View, Box<dyn std::error::Error>> {
    let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z) * 1e-3;
    if let Some(view) = ExaminationView::find(name) {
        let [eye, target] =
            [view.camera_mm, view.look_at_mm].map(|p| Vec3::from_array(p.map(|c| c as f32)) * 1e-3);
        return Ok(View { eye, target, field: view.width_mm as f32 * 1e-3 });
    }
    Ok(match name {
        "front" => View { eye: at(0.0, 0.0, 100.0), target: Vec3::ZERO, field: 0.078 },
        "wide" => View { eye: at(0.0, 0.0, 250.0), target: Vec3::ZERO, field: 0.14 },
        "oblique" => View { eye: at(70.0, 25.0, 90.0), target: at(0.0, 0.0, -5.0), field: 0.08 },
        "below" => View { eye: at(0.0, -55.0, 75.0), target: at(0.0, 15.0, -20.0), field: 0.065 },
        "above" => View { eye: at(0.0, 50.0, 85.0), target: at(0.0, -15.0, -15.0), field: 0.065 },
        "lower" => View { eye: at(10.0, 10.0, 80.0), target: at(0.0, -25.0, -8.0), field: 0.05 },
        "tongue" => View { eye: at(15.0, 45.0, 80.0), target: at(0.0, -18.0, 2.0), field: 0.03 },
        "molars" => View { eye: at(-18.0, 25.0, 70.0), target: at(22.0, -16.0, -25.0), field: 0.035 },
        "smile" => View { eye: at(-15.0, 8.0, 150.0), target: at(0.0, 1.0, 0.0), field: 0.036 },
        "root" => View { eye: at(0.0, 40.0, 20.0), target: at(0.0, -8.0, -42.0), field: 0.045 },
        "chewing" => View { eye: at(10.0, -62.0, 62.0), target: at(21.0, 20.0, -25.0), field: 0.032 },
        "incisors" => View { eye: at(15.0, 20.0, 60.0), target: at(0.0, 24.0, 0.0), field: 0.045 },
        other => return Err(format!("no view {other}").into()),
    })
}

/// A picture while it is being drawn.
struct Picture {
    view: View,
    parameters: MouthParameters,
    forward: Vec3,
    right: Vec3,
    up: Vec3,
    /// Focal length in samples.
    focal: f32,
    depth: Vec<f32>,
    /// Number of the part whose hidden side is seen, if any.
    hidden_side: Vec<usize>,
    picture: Vec<Vec3>,
}

/// Samples along each side.
const SIDE: usize = SIZE * FINE;

impl Picture {
    fn new(view: View, parameters: MouthParameters) -> Self {
        let forward = (view.target - view.eye).normalize();
        let right = forward.cross(Vec3::Y).normalize();
        Self {
            forward,
            right,
            up: right.cross(forward),
            focal: (view.target - view.eye).length() / view.field * SIDE as f32,
            depth: vec![f32::INFINITY; SIDE * SIDE],
            hidden_side: vec![usize::MAX; SIDE * SIDE],
            picture: vec![Vec3::new(0.0, 0.0, 0.15); SIDE * SIDE],
            view,
            parameters,
        }
    }

    /// Color of a tissue at texture coordinates: redder where there is blood, paler under keratin.
    fn tint(&self, tissue: Tissue, uv: Vec2) -> Vec3 {
        let map = |map| surface_map(map, tissue, &self.parameters, uv.x.into(), uv.y.into()) as f32;
        let blood = map(SurfaceMap::Redness).max(map(SurfaceMap::Fungiform));
        let plain = color(tissue) * Vec3::new(1.0, 1.0 - 0.45 * blood, 1.0 - 0.42 * blood);
        plain.lerp(Vec3::splat(0.85), 0.35 * map(SurfaceMap::Pallor))
    }

    /// Draws a triangle of a part into the depth buffer.
    fn draw(&mut self, number: usize, part: &Part, triangle: [u32; 3]) {
        let mesh = &part.mesh;
        let corners = triangle.map(|v| mesh.positions[v as usize]);
        let screen = corners.map(|p| {
            let q = p - self.view.eye;
            let z = q.dot(self.forward);
            let half = SIDE as f32 * 0.5;
            Vec3::new(half + self.focal * q.dot(self.right) / z, half - self.focal * q.dot(self.up) / z, z)
        });
        if screen.iter().any(|s| s.z < 1e-3) {
            return;
        }
        let facing = mesh.triangle_cross(&triangle).dot(self.view.eye - corners[0]) > 0.0;
        let low = screen[0].min(screen[1]).min(screen[2]);
        let high = screen[0].max(screen[1]).max(screen[2]);
        let clamp = |x: f32| x.clamp(0.0, SIDE as f32 - 1.0) as usize;
        let edge = |a: Vec3, b: Vec3, p: Vec2| (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x);
        let area = edge(screen[0], screen[1], Vec2::new(screen[2].x, screen[2].y));
        if area.abs() < 1e-9 || high.x < 0.0 || high.y < 0.0 || low.x > SIDE as f32 || low.y > SIDE as f32 {
            return;
        }
        for y in clamp(low.y)..=clamp(high.y) {
            for x in clamp(low.x)..=clamp(high.x) {
                let p = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let w = [
                    edge(screen[1], screen[2], p) / area,
                    edge(screen[2], screen[0], p) / area,
                    edge(screen[0], screen[1], p) / area,
                ];
                if w.iter().any(|&w| w < 0.0) {
                    continue;
                }
                let z = 1.0 / (w[0] / screen[0].z + w[1] / screen[1].z + w[2] / screen[2].z);
                let pixel = y * SIDE + x;
                if z >= self.depth[pixel] {
                    continue;
                }
                self.depth[pixel] = z;
                self.hidden_side[pixel] = if facing { usize::MAX } else { number };
                if !facing {
                    // The hidden side of a surface: should never be seen.
                    self.picture[pixel] = Vec3::new(0.0, 0.4, 0.0);
                    continue;
                }
                self.picture[pixel] = self.shade(part, triangle, w);
            }
        }
    }

    /// Color of a point of a triangle with barycentric weights `w`.
    fn shade(&self, part: &Part, triangle: [u32; 3], w: [f32; 3]) -> Vec3 {
        let mesh = &part.mesh;
        let mut normal = Vec3::ZERO;
        let mut position = Vec3::ZERO;
        let mut uv = Vec2::ZERO;
        for k in 0..3 {
            uv += mesh.uvs[triangle[k] as usize] * w[k];
            normal += mesh.normals[triangle[k] as usize] * w[k];
            position += mesh.positions[triangle[k] as usize] * w[k];
        }
        let normal = normal.normalize();
        let light = self.view.eye + self.right * 0.035 + self.up * 0.03;
        let to_light = light - position;
        let direction = to_light.normalize();
        let fall = 0.95 * (self.view.eye - self.view.target).length_squared() / to_light.length_squared();
        let diffuse = normal.dot(direction).max(0.0);
        let half_way = (direction + (self.view.eye - position).normalize()).normalize();
        let shine = 0.25 * normal.dot(half_way).max(0.0).powi(60);
        self.tint(part.tissue, uv) * (0.12 + 0.88 * diffuse) * fall + Vec3::splat(shine * fall)
    }

    fn write_png(&self, output: &str) -> Result<(), Box<dyn std::error::Error>> {
        let mut bytes = Vec::with_capacity(SIZE * SIZE * 3);
        for y in 0..SIZE {
            for x in 0..SIZE {
                let mut sum = Vec3::ZERO;
                for dy in 0..FINE {
                    for dx in 0..FINE {
                        sum += self.picture[(y * FINE + dy) * SIDE + x * FINE + dx];
                    }
                }
                let mean = sum / (FINE * FINE) as f32;
                bytes.extend(
                    mean.to_array().map(|c| (c.clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0).round() as u8),
                );
            }
        }
        let mut encoder = png::Encoder::new(BufWriter::new(File::create(output)?), SIZE as u32, SIZE as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.write_header()?.write_image_data(&bytes)?;
        Ok(())
    }
}
