//! Opcodes of DNG files (Adobe DNG 1.7, chapter 7): gain maps are applied, others told.

use super::dng_pixels::DngPixels;
use super::frame_judgement::{FrameRemark, bounds};
use super::tiff_directory::Directory;

/// Names of opcodes.
const OPCODES: [(u32, &str); 14] = [
    (1, "WarpRectilinear"),
    (2, "WarpFisheye"),
    (3, "FixVignetteRadial"),
    (4, "FixBadPixelsConstant"),
    (5, "FixBadPixelsList"),
    (6, "TrimBounds"),
    (7, "MapTable"),
    (8, "MapPolynomial"),
    (GAIN_MAP, "GainMap"),
    (10, "DeltaPerRow"),
    (11, "DeltaPerColumn"),
    (12, "ScalePerRow"),
    (13, "ScalePerColumn"),
    (14, "WarpRectilinear2"),
];
const GAIN_MAP: u32 = 9;
/// Most opcodes of a list, and most points of a map, that are read.
const MOST_OPCODES: u32 = 1000;
const MOST_POINTS: usize = 1 << 20;

/// What the lists of a DNG do to its values.
#[derive(Default)]
pub(crate) struct Opcodes {
    /// A factor of each value, in the order of the pixels; empty where there is no gain map.
    pub(crate) factors: Vec<f32>,
    pub(crate) remarks: Vec<FrameRemark>,
}

/// Numbers of an opcode, all of them with the most significant byte first.
struct Numbers<'a>(&'a [u8]);

impl Numbers<'_> {
    fn bytes<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (now, rest) = self.0.split_at_checked(N)?;
        self.0 = rest;
        now.try_into().ok()
    }

    fn whole(&mut self) -> Option<usize> {
        self.bytes().map(|bytes| u32::from_be_bytes(bytes) as usize)
    }

    fn double(&mut self) -> Option<f64> {
        self.bytes().map(f64::from_be_bytes).filter(|number| number.is_finite())
    }
}

/// One gain map: an area of the image, and factors on a grid over it.
struct GainMap {
    /// Top, left, bottom, right.
    area: [usize; 4],
    first_plane: usize,
    planes: usize,
    /// Every so manieth row and column of the area.
    pitch: [usize; 2],
    /// Down and across.
    points: [usize; 2],
    /// Distance and first place of the points, in heights and widths of the image.
    spacing: [f64; 2],
    origin: [f64; 2],
    map_planes: usize,
    /// `[down, across, plane]`.
    gains: Vec<f32>,
}

impl GainMap {
    /// Of the parameters of an opcode; `None` of damaged ones.
    fn read(parameters: &[u8]) -> Option<Self> {
        let mut numbers = Numbers(parameters);
        let mut wholes = |count: usize| (0..count).map(|_| numbers.whole()).collect::<Option<Vec<_>>>();
        let head = wholes(10)?;
        let mut doubles = [0.0; 4];
        for number in &mut doubles {
            *number = numbers.double()?;
        }
        let map_planes = numbers.whole()?;
        let [down, across] = [head[8], head[9]];
        let count = down.checked_mul(across)?.checked_mul(map_planes)?;
        let is_sound = (1..=MOST_POINTS).contains(&count)
            && head[6].min(head[7]) > 0
            && (down == 1 || doubles[0] > 0.0)
            && (across == 1 || doubles[1] > 0.0);
        if !is_sound {
            return None;
        }
        let gains =
            (0..count).map(|_| numbers.bytes().map(f32::from_be_bytes)).collect::<Option<Vec<f32>>>()?;
        gains.iter().all(|gain| gain.is_finite() && *gain > 0.0).then_some(Self {
            area: [head[0], head[1], head[2], head[3]],
            first_plane: head[4],
            planes: head[5],
            pitch: [head[6], head[7]],
            points: [down, across],
            spacing: [doubles[0], doubles[1]],
            origin: [doubles[2], doubles[3]],
            map_planes,
            gains,
        })
    }

    /// The points around a place of a direction, and the part of the second.
    fn between(&self, direction: usize, at: usize, of: usize) -> (usize, usize, f64) {
        let last = self.points[direction] - 1;
        if last == 0 {
            return (0, 0, 0.0);
        }
        let place = ((at as f64 + 0.5) / of as f64 - self.origin[direction]) / self.spacing[direction];
        let place = place.clamp(0.0, last as f64);
        let low = (place as usize).min(last - 1);
        (low, low + 1, place - low as f64)
    }

    /// Multiplies the factors of the values that it is of. A mosaic has one plane; `channel` tells that of a value where planes are those
    /// of colors.
    fn multiply(
        &self,
        size: [usize; 2],
        factors: &mut [f32],
        samples: usize,
        channel: impl Fn(usize) -> usize,
    ) {
        let [width, height] = size;
        let [top, left, bottom, right] = self.area;
        for row in (top..bottom.min(height)).step_by(self.pitch[0]) {
            let (above, below, down) = self.between(0, row, height);
            for col in (left..right.min(width)).step_by(self.pitch[1]) {
                let (before, after, across) = self.between(1, col, width);
                let first = (row * width + col) * samples;
                for (sample, factor) in factors[first..first + samples].iter_mut().enumerate() {
                    let plane = channel(first + sample);
                    if !(self.first_plane..self.first_plane.saturating_add(self.planes)).contains(&plane) {
                        continue;
                    }
                    let plane = plane.min(self.map_planes - 1);
                    let gain = |row: usize, col: usize| {
                        f64::from(self.gains[(row * self.points[1] + col) * self.map_planes + plane])
                    };
                    let upper = gain(above, before) * (1.0 - across) + gain(above, after) * across;
                    let lower = gain(below, before) * (1.0 - across) + gain(below, after) * across;
                    *factor *= (upper * (1.0 - down) + lower * down) as f32;
                }
            }
        }
    }
}

/// The opcodes of a list: numbers and parameters.
fn list_of(data: &[u8]) -> Vec<(u32, &[u8])> {
    let mut numbers = Numbers(data);
    let count = numbers.whole().unwrap_or(0).min(MOST_OPCODES as usize);
    let mut found = Vec::new();
    for _ in 0..count {
        let (Some(code), Some(_), Some(_), Some(size)) =
            (numbers.whole(), numbers.whole(), numbers.whole(), numbers.whole())
        else {
            break;
        };
        let (parameters, rest) = numbers.0.split_at_checked(size).unwrap_or((numbers.0, &[]));
        numbers.0 = rest;
        found.push((code as u32, parameters));
    }
    found
}

/// Reads the lists of a raw image. Gain maps of linear values become factors; `channel` is that of a value once colors are told apart.
pub(crate) fn opcodes_of(
    raw: &Directory<'_>,
    pixels: &DngPixels,
    channel: impl Fn(usize) -> usize,
) -> Opcodes {
    let mut found = Opcodes::default();
    let (mut applied, mut left): (Vec<String>, Vec<String>) = (Vec::new(), Vec::new());
    for (tag, list) in [(51_008, "OpcodeList1"), (51_009, "OpcodeList2"), (51_022, "OpcodeList3")] {
        for (code, parameters) in raw.data(tag).map(list_of).unwrap_or_default() {
            // Those of the first list are of values that are not linear yet
            let map = if code == GAIN_MAP && tag != 51_008 { GainMap::read(parameters) } else { None };
            let name = OPCODES.iter().find(|(known, _)| *known == code).map(|(_, name)| *name);
            let name = name.map_or_else(|| format!("{list} number {code}"), |name| format!("{list} {name}"));
            let names = if map.is_some() { &mut applied } else { &mut left };
            if !names.contains(&name) {
                names.push(name);
            }
            let Some(map) = map else { continue };
            if found.factors.is_empty() {
                found.factors = vec![1.0; pixels.data.len()];
            }
            let size = [pixels.width, pixels.height];
            let samples = pixels.samples;
            match (tag, samples) {
                (51_009, 1) => map.multiply(size, &mut found.factors, samples, |_| 0),
                _ => map.multiply(size, &mut found.factors, samples, &channel),
            }
        }
    }
    if let (false, Some((low, high))) = (applied.is_empty(), bounds(&found.factors)) {
        found.remarks.push(FrameRemark {
            key: "gain map",
            value: format!("{}: times {low:.3} to {high:.3}", applied.join(", ")),
            remark:
                "applied to what lies above the black level; frames given to `analyze --flat` take its place"
                    .into(),
            is_doubtful: false,
        });
    }
    if !left.is_empty() {
        let shades = left
            .iter()
            .any(|name| ["FixVignetteRadial", "GainMap", "Scale"].iter().any(|s| name.contains(s)));
        let remark = if shades {
            "not applied: the frame keeps the shading of its lens, which may differ by color; frames of even light given to `analyze --flat` \
             take it out"
        } else {
            "not applied"
        };
        found.remarks.push(FrameRemark {
            key: "opcodes",
            value: left.join(", "),
            remark: remark.into(),
            is_doubtful: true,
        });
    }
    found
}
