//! What tags of a camera's DNG say beyond its levels, and what its pixels show of them.

use fluorspar::image::Mosaic;

use super::raw::Description;
use super::tiff_directory::Directory;

/// One thing that a frame has otherwise than most, in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct FrameRemark {
    pub(super) key: &'static str,
    pub(super) value: String,
    /// What follows from it.
    pub(super) remark: String,
}

/// Share of a channel's pixels from which those that share its largest value are a plateau. Noise lets no sensor give all the same.
const PLATEAU_SHARE: f64 = 1e-3;
/// Values below the largest that tell how many pixels a value has there without a plateau, and how many times as many a plateau has.
const BELOW_PLATEAU: (usize, u64) = (16, 5);
/// Names of opcodes that change values (Adobe DNG 1.7, chapter 7).
const OPCODES: [(u32, &str); 14] = [
    (1, "WarpRectilinear"),
    (2, "WarpFisheye"),
    (3, "FixVignetteRadial"),
    (4, "FixBadPixelsConstant"),
    (5, "FixBadPixelsList"),
    (6, "TrimBounds"),
    (7, "MapTable"),
    (8, "MapPolynomial"),
    (9, "GainMap"),
    (10, "DeltaPerRow"),
    (11, "DeltaPerColumn"),
    (12, "ScalePerRow"),
    (13, "ScalePerColumn"),
    (14, "WarpRectilinear2"),
];

/// Gives every plane its own white level and takes plateaus for saturation: their values become the white level of the frame. Tells what it
/// did, and which tags remain without effect. Left-aligned samples are shifted down.
pub(super) fn remark_on(
    [first, raw]: [&Directory<'_>; 2],
    samples: usize,
    description: &mut Description,
    data: &mut [u16],
    black_offsets: &[f32],
) -> Vec<FrameRemark> {
    let mut remarks = Vec::new();
    let whites: Vec<u16> =
        raw.unsigned(50_717).iter().map(|white| (*white).clamp(1, 65_535) as u16).collect();
    let width = description.width as usize;
    let mosaic = description.mosaic.clone();
    let channel = |index: usize| channel_of(&mosaic, samples, width, index);
    if whites.len() > 1 && whites.iter().any(|white| *white != whites[0]) {
        let most = whites.iter().copied().max().unwrap_or(description.white_level);
        description.white_level = most;
        for (index, value) in data.iter_mut().enumerate() {
            if whites.get(channel(index)).is_some_and(|white| *value >= *white) {
                *value = (*value).max(most);
            }
        }
        let levels: Vec<String> = whites.iter().map(u16::to_string).collect();
        remarks.push(FrameRemark {
            key: "white level by plane",
            value: format!("{} DN", levels.join(", ")),
            remark: "each counts for its own channel".into(),
        });
    }
    remarks.extend(mark_plateaus(description, samples, data));
    remarks.extend(high_black_level(description, samples, data, black_offsets));
    remarks.extend(orientation(first, raw));
    remarks.extend(
        [(51_008, "OpcodeList1"), (51_009, "OpcodeList2"), (51_022, "OpcodeList3")]
            .iter()
            .filter_map(|list| opcodes(raw, *list)),
    );
    remarks
}

/// Channel of a value.
fn channel_of(mosaic: &Mosaic, samples: usize, width: usize, index: usize) -> usize {
    match samples {
        1 if mosaic.pattern.is_empty() => 0,
        1 => mosaic.channel(index / width, index % width),
        _ => index % samples,
    }
}

/// Makes values that many pixels of a channel share, and none exceeds, the white level: a converter or a program ended there.
fn mark_plateaus(description: &Description, samples: usize, data: &mut [u16]) -> Vec<FrameRemark> {
    let mosaic = &description.mosaic;
    let width = description.width as usize;
    let count_of = mosaic.channels.len().max(samples);
    let mut counts = vec![vec![0u64; 65_536]; count_of];
    for (index, value) in data.iter().enumerate() {
        if let Some(of) = counts.get_mut(channel_of(mosaic, samples, width, index)) {
            of[usize::from(*value)] += 1;
        }
    }
    let white = description.white_level;
    let least = description.black_level + 0.5 * (f64::from(white) - description.black_level);
    let plateau = |of: &Vec<u64>| -> Option<(u16, f64)> {
        let value = of.iter().rposition(|count| *count > 0)?;
        let share = of[value] as f64 / of.iter().sum::<u64>() as f64;
        let (below, times) = BELOW_PLATEAU;
        let near: u64 = of[value.saturating_sub(below)..value].iter().sum();
        let holds = value < usize::from(white)
            && value as f64 > least
            && of[value] >= 8
            && share >= PLATEAU_SHARE
            && of[value] * below as u64 > times * near;
        holds.then_some((value as u16, share))
    };
    let plateaus: Vec<Option<(u16, f64)>> = counts.iter().map(plateau).collect();
    if plateaus.iter().all(Option::is_none) {
        return Vec::new();
    }
    for (index, of) in data.iter_mut().enumerate() {
        if let Some(Some((value, _))) = plateaus.get(channel_of(mosaic, samples, width, index))
            && *of == *value
        {
            *of = white;
        }
    }
    let words = plateaus.iter().enumerate().filter_map(|(channel, found)| {
        let (value, share) = (*found)?;
        let name = mosaic.channels.get(channel).map_or("", String::as_str);
        Some(format!("{name} {value} DN in {:.1} % of its pixels", 100.0 * share).trim().to_string())
    });
    vec![FrameRemark {
        key: "plateau",
        value: words.collect::<Vec<_>>().join(", "),
        remark: format!("no pixel has more: taken as saturated, though the white level is {white} DN"),
    }]
}

/// Channels of which more pixels lie a digital number or more below their black level than noise puts there: half, give or take three
/// standard deviations.
fn high_black_level(
    description: &Description,
    samples: usize,
    data: &[u16],
    offsets: &[f32],
) -> Option<FrameRemark> {
    let mosaic = &description.mosaic;
    let mut counts = vec![(0u64, 0u64); mosaic.channels.len().max(samples)];
    for (index, value) in data.iter().enumerate() {
        let black = description.black_level + f64::from(offsets.get(index).copied().unwrap_or(0.0));
        let channel = channel_of(mosaic, samples, description.width as usize, index);
        if let Some((below, all)) = counts.get_mut(channel) {
            *below += u64::from(f64::from(*value) <= black - 1.0);
            *all += 1;
        }
    }
    let is_high = |(below, all): &(u64, u64)| *below as f64 > 0.5 * *all as f64 + 1.5 * (*all as f64).sqrt();
    let names: Vec<&str> = (0..counts.len())
        .filter(|channel| is_high(&counts[*channel]))
        .filter_map(|channel| mosaic.channels.get(channel).map(String::as_str))
        .collect();
    (!names.is_empty()).then(|| FrameRemark {
        key: "black level",
        value: format!("most pixels of {} lie below it", names.join(", ")),
        remark: "it is too high, so that their light counts as less than none: measure it with the cap on the lens, and describe the \
                 frame with --black-level"
            .into(),
    })
}

/// How viewers turn the frame, which stays as stored here.
fn orientation(first: &Directory<'_>, raw: &Directory<'_>) -> Option<FrameRemark> {
    let turned = match first.first(274).or_else(|| raw.first(274))? {
        2 => "mirrored left to right",
        3 => "turned by 180 degrees",
        4 => "mirrored top to bottom",
        5 => "mirrored along the diagonal",
        6 => "turned by 90 degrees clockwise",
        7 => "mirrored along the other diagonal",
        8 => "turned by 90 degrees counterclockwise",
        _ => return None,
    };
    Some(FrameRemark {
        key: "orientation",
        value: format!("viewers show it {turned}"),
        remark: "rows and columns of masks, rectangles and previews are those of the file: draw a mask on preview_NAME.png, not on what a \
                 viewer shows"
            .into(),
    })
}

/// The opcodes of a list, which are not applied.
fn opcodes(raw: &Directory<'_>, (tag, list): (u16, &str)) -> Option<FrameRemark> {
    let data = raw.data(tag)?;
    let number = |at: usize| Some(u32::from_be_bytes(data.get(at..at + 4)?.try_into().ok()?));
    let mut names: Vec<String> = Vec::new();
    let mut at = 4;
    for _ in 0..number(0)?.min(1000) {
        let (Some(code), Some(size)) = (number(at), number(at + 12)) else { break };
        let name = OPCODES.iter().find(|(known, _)| *known == code).map(|(_, name)| *name);
        let name = name.map_or_else(|| format!("opcode {code}"), String::from);
        if !names.contains(&name) {
            names.push(name);
        }
        at += 16 + size as usize;
    }
    let is_shading = names.iter().any(|name| name == "GainMap" || name == "FixVignetteRadial");
    let remark = if is_shading {
        "not applied: the frame keeps the shading of its lens, which may differ by color; flats given to `analyze --flat` correct it"
    } else {
        "not applied"
    };
    (!names.is_empty()).then(|| FrameRemark {
        key: "opcodes",
        value: format!("{list}: {}", names.join(", ")),
        remark: remark.into(),
    })
}

/// Bits by which all values of a frame are shifted up: a converter of fewer bits wrote into the upper ones. 0 where they are not.
pub(super) fn left_shift(data: &[u16]) -> u32 {
    let all = data.iter().fold(0, |all, value| all | value);
    if all == 0 || data.iter().all(|value| *value == data[0]) { 0 } else { all.trailing_zeros() }
}
