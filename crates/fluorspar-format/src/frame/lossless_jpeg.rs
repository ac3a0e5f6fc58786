//! Lossless JPEG (ITU-T T.81, process 14: SOF3, Huffman codes, seven predictors), as DNG files hold their pixels.

/// Most components of a scan.
const MOST_COMPONENTS: usize = 4;
/// What is said of JPEG of another kind.
pub(crate) const LOSSY: &str = "the pixels are compressed with loss";
/// Longest code, bits.
const CODE_BITS: u32 = 16;

/// A code of a Huffman table by the next sixteen bits: its length, 0 where there is none, and the number of bits of the difference.
type Codes = Vec<[u8; 2]>;

/// What the headers of a stream say.
#[derive(Default)]
struct Header {
    precision: u32,
    columns: usize,
    rows: usize,
    /// Identifiers of the components of the frame.
    components: Vec<u8>,
    tables: [Option<Codes>; 4],
    restart_interval: usize,
}

/// What the header of the scan says.
struct Scan {
    /// Table of each component.
    tables: Vec<usize>,
    predictor: u8,
    /// Bits by which the samples were shifted down.
    shift: u32,
}

/// Decodes a stream of exactly `samples` samples, row by row, the components of a pixel together. In words what is wrong otherwise.
pub(crate) fn decode_lossless_jpeg(bytes: &[u8], samples: usize) -> Result<Vec<u16>, String> {
    let mut header = Header::default();
    let mut rest = bytes.strip_prefix(b"\xff\xd8").ok_or("a tile does not begin as a JPEG does")?;
    loop {
        let (marker, segment, after) = next_segment(rest).ok_or("a header of a JPEG tile is damaged")?;
        rest = after;
        match marker {
            0xc3 => header.read_frame(segment).ok_or("a header of a JPEG tile is damaged")?,
            0xc4 => header.read_tables(segment).ok_or("a Huffman table of a JPEG tile is damaged")?,
            0xdd => header.restart_interval = usize::from(word(segment).ok_or("a JPEG tile is damaged")?),
            0xda => break,
            0xc0..=0xc2 | 0xc5..=0xcf => return Err(LOSSY.into()),
            _ => {}
        }
    }
    let segment_start = bytes.len() - rest.len();
    let scan = header.scan(bytes, segment_start).ok_or("the scan of a JPEG tile is damaged")?;
    let found = header.columns * header.rows * header.components.len();
    if found != samples {
        return Err(format!("a JPEG tile has {found} samples where {samples} are needed"));
    }
    header.decode(&scan, rest)
}

fn word(bytes: &[u8]) -> Option<u16> {
    Some(u16::from_be_bytes([*bytes.first()?, *bytes.get(1)?]))
}

/// Marker, content and what follows.
fn next_segment(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let fill = bytes.iter().take_while(|&&byte| byte == 0xff).count();
    let marker = *bytes.get(fill).filter(|_| fill > 0)?;
    let body = &bytes[fill + 1..];
    let length = usize::from(word(body)?);
    Some((marker, body.get(2..length)?, body.get(length..)?))
}

impl Header {
    fn read_frame(&mut self, segment: &[u8]) -> Option<()> {
        let [precision, r1, r0, c1, c0, count, components @ ..] = segment else { return None };
        let count = usize::from(*count);
        self.precision = u32::from(*precision);
        self.rows = usize::from(u16::from_be_bytes([*r1, *r0]));
        self.columns = usize::from(u16::from_be_bytes([*c1, *c0]));
        // Components of different resolution belong to no raw image.
        let is_plain = components.len() == 3 * count && components.chunks_exact(3).all(|c| c[1] == 0x11);
        let is_possible = (2..=16).contains(&self.precision) && (1..=MOST_COMPONENTS).contains(&count);
        self.components = components.chunks_exact(3).map(|component| component[0]).collect();
        (is_plain && is_possible && self.rows > 0 && self.columns > 0).then_some(())
    }

    fn read_tables(&mut self, mut segment: &[u8]) -> Option<()> {
        while let [place, rest @ ..] = segment {
            let (counts, rest) = rest.split_at_checked(16)?;
            let count = counts.iter().map(|&n| usize::from(n)).sum();
            let (values, rest) = rest.split_at_checked(count)?;
            *self.tables.get_mut(usize::from(*place & 15))? = Some(codes(counts, values)?);
            segment = rest;
        }
        Some(())
    }

    /// The header of the scan, which ends at a place of the stream.
    fn scan(&self, bytes: &[u8], end: usize) -> Option<Scan> {
        let count = self.components.len();
        let segment = bytes.get(end.checked_sub(2 * count + 4)?..end)?;
        let (number, rest) = segment.split_first()?;
        if usize::from(*number) != count || count == 0 {
            return None;
        }
        let table_of = |component: &u8| {
            let entry = rest[..2 * count].chunks_exact(2).find(|entry| entry[0] == *component)?;
            let table = usize::from(entry[1] >> 4);
            self.tables.get(table)?.as_ref().map(|_| table)
        };
        let tables = self.components.iter().map(table_of).collect::<Option<Vec<_>>>()?;
        let (predictor, shift) = (rest[2 * count], u32::from(rest[2 * count + 2] & 15));
        ((1..=7).contains(&predictor) && shift < self.precision).then_some(Scan { tables, predictor, shift })
    }

    /// The samples of the scan.
    fn decode(&self, scan: &Scan, bytes: &[u8]) -> Result<Vec<u16>, String> {
        let parts = self.components.len();
        let width = self.columns * parts;
        let middle = 1i32 << (self.precision - scan.shift - 1);
        let tables: Vec<&Codes> =
            scan.tables.iter().filter_map(|&table| self.tables[table].as_ref()).collect();
        let mut bits = Bits { bytes, held: 0, count: 0, beyond: 0 };
        let mut data: Vec<u16> = vec![0; width * self.rows];
        let mut until_restart = self.restart_interval;
        // A row in which prediction begins anew knows nothing of the one above.
        let mut first_row = 0;
        for row in 0..self.rows {
            for column in 0..self.columns {
                if self.restart_interval > 0 && until_restart == 0 {
                    bits.restart().ok_or("a restart marker is missing in a JPEG tile")?;
                    until_restart = self.restart_interval;
                    first_row = row;
                }
                until_restart = until_restart.saturating_sub(1);
                for (part, table) in tables.iter().enumerate() {
                    let at = row * width + column * parts + part;
                    let difference = bits.difference(table).ok_or("a code of a JPEG tile is damaged")?;
                    let value = |back: usize| i32::from(data[at - back]);
                    let predicted = match (row > first_row, column > 0) {
                        (false, false) => middle,
                        (false, true) => value(parts),
                        (true, false) => value(width),
                        (true, true) => {
                            predict(scan.predictor, value(parts), value(width), value(width + parts))
                        }
                    };
                    data[at] = (predicted + difference) as u16;
                }
            }
        }
        data.iter_mut().for_each(|value| *value <<= scan.shift);
        Ok(data)
    }
}

/// Prediction from the neighbors to the left, above, and above to the left (T.81, table H.1).
fn predict(predictor: u8, left: i32, above: i32, corner: i32) -> i32 {
    match predictor {
        1 => left,
        2 => above,
        3 => corner,
        4 => left + above - corner,
        5 => left + ((above - corner) >> 1),
        6 => above + ((left - corner) >> 1),
        _ => (left + above) >> 1,
    }
}

/// Codes by their first sixteen bits, from the number of codes of each length and their values (T.81, annex C).
fn codes(counts: &[u8], values: &[u8]) -> Option<Codes> {
    let mut codes = vec![[0; 2]; 1 << CODE_BITS];
    let (mut next, mut values) = (0usize, values.iter());
    for (length, &count) in (1..=CODE_BITS).zip(counts) {
        let span = 1usize << (CODE_BITS - length);
        for value in values.by_ref().take(usize::from(count)) {
            codes.get_mut(next..next + span)?.fill([length as u8, (*value <= 16).then_some(*value)?]);
            next += span;
        }
    }
    Some(codes)
}

/// Bits of the entropy-coded data, the most significant first. A zero byte behind 0xff is stuffing.
struct Bits<'a> {
    bytes: &'a [u8],
    held: u64,
    count: u32,
    /// Bits of `count` that are filled in behind the end of the data.
    beyond: u32,
}

impl Bits<'_> {
    fn fill(&mut self) {
        while self.count <= 48 {
            let byte = match self.bytes {
                [0xff, 0, rest @ ..] => {
                    self.bytes = rest;
                    0xff
                }
                // A marker: what comes behind belongs to nobody.
                [0xff, ..] | [] => {
                    self.beyond += 8;
                    0
                }
                [byte, rest @ ..] => {
                    self.bytes = rest;
                    *byte
                }
            };
            self.held = (self.held << 8) | u64::from(byte);
            self.count += 8;
        }
    }

    fn take(&mut self, bits: u32) -> i32 {
        self.count -= bits;
        ((self.held >> self.count) & ((1 << bits) - 1)) as i32
    }

    /// The next difference: the number of its bits as a code, then these bits (T.81, H.1.2.2).
    fn difference(&mut self, codes: &Codes) -> Option<i32> {
        if self.count < 32 {
            self.fill();
        }
        let [length, bits] = codes[((self.held >> (self.count - CODE_BITS)) & 0xffff) as usize];
        if length == 0 {
            return None;
        }
        self.count -= u32::from(length);
        let difference = match u32::from(bits) {
            0 => 0,
            16 => 32_768,
            bits => {
                let value = self.take(bits);
                if value < 1 << (bits - 1) { value - (1 << bits) + 1 } else { value }
            }
        };
        (self.beyond <= self.count).then_some(difference)
    }

    /// Goes on behind the next restart marker.
    fn restart(&mut self) -> Option<()> {
        (self.held, self.count, self.beyond) = (0, 0, 0);
        let at =
            self.bytes.windows(2).position(|pair| pair[0] == 0xff && (0xd0..=0xd7).contains(&pair[1]))?;
        self.bytes = &self.bytes[at + 2..];
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stream of 3 columns, 2 rows, precision 8, written by hand: codes 00, 01, 10, 110 for differences of 0, 1, 2, 3 bits.
    fn stream(predictor: u8, bits: &str) -> Vec<u8> {
        let mut bytes = b"\xff\xd8".to_vec();
        bytes.extend([0xff, 0xc4, 0, 23, 0]);
        bytes.extend([0, 3, 1]);
        bytes.extend([0; 13]);
        bytes.extend([0, 1, 2, 3]);
        bytes.extend([0xff, 0xc3, 0, 11, 8, 0, 2, 0, 3, 1, 1, 0x11, 0]);
        bytes.extend([0xff, 0xda, 0, 8, 1, 1, 0, predictor, 0, 0]);
        let padded = format!("{bits:1<width$}", width = bits.len().next_multiple_of(8));
        for byte in padded.as_bytes().chunks(8) {
            let text = std::str::from_utf8(byte).unwrap();
            let value = u8::from_str_radix(text, 2).unwrap();
            bytes.push(value);
            if value == 0xff {
                bytes.push(0);
            }
        }
        bytes.extend([0xff, 0xd9]);
        bytes
    }

    #[test]
    fn a_stream_written_by_hand_has_the_samples_worked_out_by_hand() {
        // Differences +1, -1, 0 in the first row; +3, -2, +5 in the second: codes with their bits.
        let bits = "011 010 00 1011 1001 110101".replace(' ', "");
        // First row from the left: 129, 128, 128. The second begins from above.
        let expected: [(u8, [u16; 3]); 4] =
            [(1, [132, 130, 135]), (2, [132, 126, 133]), (4, [132, 129, 134]), (7, [132, 128, 133])];
        for (predictor, second) in expected {
            let found = decode_lossless_jpeg(&stream(predictor, &bits), 6).unwrap();
            assert_eq!(found[..3], [129, 128, 128]);
            assert_eq!(found[3..], second, "predictor {predictor}");
        }
    }

    #[test]
    fn damaged_streams_are_told() {
        let good = stream(1, "0110100010111001110101");
        assert!(decode_lossless_jpeg(&good, 7).unwrap_err().contains("6 samples where 7"));
        assert!(decode_lossless_jpeg(&good[1..], 6).is_err());
        // The code 111 is none.
        assert!(decode_lossless_jpeg(&stream(1, "11111111"), 6).unwrap_err().contains("code"));
        for end in 0..good.len() - 2 {
            assert!(decode_lossless_jpeg(&good[..end], 6).is_err(), "cut at {end}");
        }
    }
}
