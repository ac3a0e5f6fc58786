//! Directories of TIFF files, read from bytes: every offset and count is checked against the file.

/// Most entries of a directory, and most directories of a file, that are read.
const MOST_ENTRIES: usize = 4096;
const MOST_DIRECTORIES: usize = 64;

/// A TIFF file in memory.
pub(crate) struct TiffBytes<'a> {
    bytes: &'a [u8],
    big_endian: bool,
    /// Whether offsets and counts have 64 bits (BigTIFF).
    is_big: bool,
}

/// One entry: kind of its values, how many, and their bytes.
struct Entry<'a> {
    tag: u16,
    kind: u16,
    data: &'a [u8],
}

/// One directory.
pub(crate) struct Directory<'a> {
    entries: Vec<Entry<'a>>,
    big_endian: bool,
}

/// Bytes of one value of each TIFF type; 0 for unknown types.
fn size_of(kind: u16) -> usize {
    match kind {
        1 | 2 | 6 | 7 => 1,
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        5 | 10 | 12 | 16..=18 => 8,
        _ => 0,
    }
}

fn bytes_of<const N: usize>(data: &[u8]) -> Option<[u8; N]> {
    data.get(..N)?.try_into().ok()
}

fn u16_at(data: &[u8], big_endian: bool) -> Option<u16> {
    let bytes = bytes_of::<2>(data)?;
    Some(if big_endian { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
}

fn u32_at(data: &[u8], big_endian: bool) -> Option<u32> {
    let bytes = bytes_of::<4>(data)?;
    Some(if big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
}

fn u64_at(data: &[u8], big_endian: bool) -> Option<u64> {
    let bytes = bytes_of::<8>(data)?;
    Some(if big_endian { u64::from_be_bytes(bytes) } else { u64::from_le_bytes(bytes) })
}

fn f64_at(data: &[u8], big_endian: bool) -> Option<f64> {
    let bytes = bytes_of::<8>(data)?;
    Some(if big_endian { f64::from_be_bytes(bytes) } else { f64::from_le_bytes(bytes) })
}

impl<'a> TiffBytes<'a> {
    /// The file, if it begins as a TIFF or a BigTIFF does.
    pub(crate) fn new(bytes: &'a [u8]) -> Option<Self> {
        let (big_endian, is_big) = match bytes.get(..4)? {
            b"II*\0" => (false, false),
            b"MM\0*" => (true, false),
            b"II+\0" => (false, true),
            b"MM\0+" => (true, true),
            _ => return None,
        };
        Some(Self { bytes, big_endian, is_big })
    }

    /// An offset or count, of the length that the file has them in.
    fn offset_at(&self, data: &[u8]) -> Option<u64> {
        match self.is_big {
            true => u64_at(data, self.big_endian),
            false => u32_at(data, self.big_endian).map(u64::from),
        }
    }

    /// Bytes of an offset, and of the number of entries of a directory.
    fn widths(&self) -> [usize; 2] {
        if self.is_big { [8, 8] } else { [4, 2] }
    }

    /// Where the entries of a directory begin and end.
    fn table_of(&self, offset: u64) -> Option<[usize; 2]> {
        let start = usize::try_from(offset).ok()?;
        let [offset_bytes, count_bytes] = self.widths();
        let head = self.bytes.get(start..)?;
        let count = match self.is_big {
            true => usize::try_from(u64_at(head, self.big_endian)?).ok()?,
            false => usize::from(u16_at(head, self.big_endian)?),
        };
        let begin = start.checked_add(count_bytes)?;
        (count <= MOST_ENTRIES).then_some([begin, begin.checked_add(count * (4 + 2 * offset_bytes))?])
    }

    pub(crate) fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    pub(crate) fn is_big_endian(&self) -> bool {
        self.big_endian
    }

    /// The directory at an offset, if all of it lies in the file. Entries of unknown type, or whose values do not lie in the
    /// file, are left out.
    pub(crate) fn directory(&self, offset: u64) -> Option<Directory<'a>> {
        let [begin, end] = self.table_of(offset)?;
        let [wide, _] = self.widths();
        let mut entries = Vec::new();
        for row in self.bytes.get(begin..end)?.chunks_exact(4 + 2 * wide) {
            let tag = u16_at(row, self.big_endian)?;
            let kind = u16_at(&row[2..], self.big_endian)?;
            let values = usize::try_from(self.offset_at(&row[4..])?).ok();
            let length = values.and_then(|values| size_of(kind).checked_mul(values)).filter(|l| *l > 0);
            let Some(length) = length else { continue };
            let cell = &row[4 + wide..];
            let data = if length <= wide {
                cell.get(..length)
            } else {
                let at = usize::try_from(self.offset_at(cell)?).ok();
                at.and_then(|at| self.bytes.get(at..at.checked_add(length)?))
            };
            if let Some(data) = data {
                entries.push(Entry { tag, kind, data });
            }
        }
        Some(Directory { entries, big_endian: self.big_endian })
    }

    /// The directories of the file's chain and their sub-directories (tag 330), the first one first.
    pub(crate) fn directories(&self) -> Vec<Directory<'a>> {
        let mut found = Vec::new();
        let mut seen = Vec::new();
        let first = self.bytes.get(if self.is_big { 8 } else { 4 }..);
        let mut open: Vec<u64> = first.and_then(|data| self.offset_at(data)).into_iter().collect();
        while let Some(offset) = open.pop() {
            if offset == 0 || seen.contains(&offset) || found.len() >= MOST_DIRECTORIES {
                continue;
            }
            seen.push(offset);
            let Some(directory) = self.directory(offset) else { continue };
            let next = self.table_of(offset).and_then(|[_, end]| self.offset_at(self.bytes.get(end..)?));
            open.extend(next);
            open.extend(directory.unsigned(330).into_iter().rev());
            found.push(directory);
        }
        found
    }
}

impl<'a> Directory<'a> {
    /// The tags of all entries.
    pub(crate) fn tags(&self) -> impl Iterator<Item = u16> {
        self.entries.iter().map(|entry| entry.tag)
    }

    fn entry(&self, tag: u16) -> Option<&Entry<'a>> {
        self.entries.iter().find(|entry| entry.tag == tag)
    }

    /// Whole numbers of a tag (BYTE, SHORT, LONG, IFD and their forms of 64 bits); empty where there are none.
    pub(crate) fn unsigned(&self, tag: u16) -> Vec<u64> {
        let Some(entry) = self.entry(tag) else { return Vec::new() };
        let values = entry.data.chunks_exact(size_of(entry.kind).max(1));
        values
            .map_while(|value| match entry.kind {
                1 | 7 => value.first().map(|v| u64::from(*v)),
                3 => u16_at(value, self.big_endian).map(u64::from),
                4 | 13 => u32_at(value, self.big_endian).map(u64::from),
                16 | 18 => u64_at(value, self.big_endian),
                _ => None,
            })
            .collect()
    }

    /// Numbers in a pixel.
    pub(crate) fn samples(&self) -> u64 {
        self.first(277).unwrap_or(1)
    }

    /// The only or first whole number of a tag.
    pub(crate) fn first(&self, tag: u16) -> Option<u64> {
        self.unsigned(tag).first().copied()
    }

    /// Numbers of a tag of any numeric type; not finite ones are left as they are.
    pub(crate) fn numbers(&self, tag: u16) -> Vec<f64> {
        let Some(entry) = self.entry(tag) else { return Vec::new() };
        let long = |value: &[u8]| u32_at(value, self.big_endian);
        let values = entry.data.chunks_exact(size_of(entry.kind).max(1));
        values
            .map_while(|value| match entry.kind {
                5 => Some(f64::from(long(value)?) / f64::from(long(&value[4..])?)),
                10 => Some(f64::from(long(value)? as i32) / f64::from(long(&value[4..])? as i32)),
                8 => u16_at(value, self.big_endian).map(|bits| f64::from(bits as i16)),
                9 => long(value).map(|bits| f64::from(bits as i32)),
                11 => long(value).map(|bits| f64::from(f32::from_bits(bits))),
                12 => f64_at(value, self.big_endian),
                _ => None,
            })
            .chain(self.unsigned(tag).into_iter().map(|value| value as f64))
            .collect()
    }

    /// Bytes of a tag.
    pub(crate) fn data(&self, tag: u16) -> Option<&'a [u8]> {
        self.entry(tag).map(|entry| entry.data)
    }
}
