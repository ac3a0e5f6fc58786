//! Parquet (Apache Parquet format 2.10): plain pages without compression, one row group.

/// A column of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum ParquetColumn {
    /// UTF-8.
    Text(Vec<String>),
    /// Whole numbers, or nothing.
    Whole(Vec<Option<i64>>),
    /// Numbers, or nothing.
    Number(Vec<Option<f64>>),
}

/// A value of Thrift's compact protocol, in which Parquet describes itself.
enum Thrift {
    I32(i64),
    I64(i64),
    Text(String),
    List(Vec<Thrift>),
    Struct(Vec<(u8, Thrift)>),
}

impl Thrift {
    /// Number of its type in heads of fields and lists.
    fn kind(&self) -> u8 {
        match self {
            Self::I32(_) => 5,
            Self::I64(_) => 6,
            Self::Text(_) => 8,
            Self::List(_) => 9,
            Self::Struct(_) => 12,
        }
    }

    fn write(&self, to: &mut Vec<u8>) {
        match self {
            Self::I32(value) | Self::I64(value) => write_count(((value << 1) ^ (value >> 63)) as u64, to),
            Self::Text(text) => {
                write_count(text.len() as u64, to);
                to.extend(text.as_bytes());
            }
            Self::List(items) => {
                let kind = items.first().map_or(12, Self::kind);
                if items.len() < 15 {
                    to.push(((items.len() as u8) << 4) | kind);
                } else {
                    to.push(0xf0 | kind);
                    write_count(items.len() as u64, to);
                }
                items.iter().for_each(|item| item.write(to));
            }
            Self::Struct(fields) => {
                let mut before = 0;
                for (id, value) in fields {
                    to.push(((id - before) << 4) | value.kind());
                    value.write(to);
                    before = *id;
                }
                to.push(0);
            }
        }
    }
}

/// A number in groups of seven bits, the lowest first.
fn write_count(mut value: u64, to: &mut Vec<u8>) {
    while value >= 0x80 {
        to.push(value as u8 | 0x80);
        value >>= 7;
    }
    to.push(value as u8);
}

impl ParquetColumn {
    /// How many rows it has.
    fn rows(&self) -> usize {
        match self {
            Self::Text(values) => values.len(),
            Self::Whole(values) => values.len(),
            Self::Number(values) => values.len(),
        }
    }

    /// Number of its type (BYTE_ARRAY, INT64, DOUBLE).
    fn kind(&self) -> i64 {
        match self {
            Self::Text(_) => 6,
            Self::Whole(_) => 2,
            Self::Number(_) => 5,
        }
    }

    fn schema(&self, name: &str) -> Thrift {
        let is_text = matches!(self, Self::Text(_));
        let mut fields = vec![
            (1, Thrift::I32(self.kind())),
            (3, Thrift::I32(i64::from(!is_text))),
            (4, Thrift::Text(name.into())),
        ];
        fields.extend(is_text.then_some((6, Thrift::I32(0))));
        Thrift::Struct(fields)
    }

    /// Definition levels where values may be missing, then the values that are there.
    fn page(&self) -> Vec<u8> {
        let mut page = Vec::new();
        match self {
            Self::Text(values) => {
                for value in values {
                    page.extend((value.len() as u32).to_le_bytes());
                    page.extend(value.as_bytes());
                }
            }
            Self::Whole(values) => {
                write_levels(values, &mut page);
                page.extend(values.iter().flatten().flat_map(|value| value.to_le_bytes()));
            }
            Self::Number(values) => {
                write_levels(values, &mut page);
                page.extend(values.iter().flatten().flat_map(|value| value.to_le_bytes()));
            }
        }
        page
    }

    /// Appends the page with its head, and describes the column.
    fn write(&self, name: &str, to: &mut Vec<u8>) -> Thrift {
        let (begin, page) = (to.len() as i64, self.page());
        let (rows, size) = (self.rows() as i64, page.len() as i64);
        // Encodings: 0 plain, 3 runs of levels
        let [plain, runs] = [0, 3].map(Thrift::I32);
        let of_page =
            Thrift::Struct(vec![(1, Thrift::I32(rows)), (2, plain), (3, runs), (4, Thrift::I32(3))]);
        let [kind, whole, stored] = [0, size, size].map(Thrift::I32);
        Thrift::Struct(vec![(1, kind), (2, whole), (3, stored), (5, of_page)]).write(to);
        to.extend(page);
        let size = to.len() as i64 - begin;
        let about = Thrift::Struct(vec![
            (1, Thrift::I32(self.kind())),
            (2, Thrift::List(vec![Thrift::I32(0), Thrift::I32(3)])),
            (3, Thrift::List(vec![Thrift::Text(name.into())])),
            (4, Thrift::I32(0)),
            (5, Thrift::I64(rows)),
            (6, Thrift::I64(size)),
            (7, Thrift::I64(size)),
            (9, Thrift::I64(begin)),
        ]);
        Thrift::Struct(vec![(2, Thrift::I64(begin)), (3, about)])
    }
}

/// Which values are there, a bit each, as one run of groups of eight, with the length of it before.
fn write_levels<T>(values: &[Option<T>], to: &mut Vec<u8>) {
    let mut run = Vec::new();
    write_count(((values.len().div_ceil(8) as u64) << 1) | 1, &mut run);
    let byte = |of: &[Option<T>]| {
        of.iter().enumerate().fold(0, |byte, (bit, value)| byte | (u8::from(value.is_some()) << bit))
    };
    run.extend(values.chunks(8).map(byte));
    to.extend((run.len() as u32).to_le_bytes());
    to.extend(run);
}

/// The bytes of a file of columns of one length.
///
/// # Panics
/// When the columns differ in length.
#[must_use]
pub fn parquet_table(columns: &[(&str, ParquetColumn)]) -> Vec<u8> {
    let rows = columns.first().map_or(0, |(_, column)| column.rows());
    assert!(columns.iter().all(|(_, column)| column.rows() == rows), "columns differ in length");
    let rows_field = || Thrift::I64(rows as i64);
    let mut bytes = b"PAR1".to_vec();
    let chunks: Vec<Thrift> = columns.iter().map(|(name, column)| column.write(name, &mut bytes)).collect();
    let size = bytes.len() as i64 - 4;
    let group = Thrift::Struct(vec![(1, Thrift::List(chunks)), (2, Thrift::I64(size)), (3, rows_field())]);
    let root =
        Thrift::Struct(vec![(4, Thrift::Text("table".into())), (5, Thrift::I32(columns.len() as i64))]);
    let schema = columns.iter().map(|(name, column)| column.schema(name));
    let schema = Thrift::List(std::iter::once(root).chain(schema).collect());
    let (version, by) = (Thrift::I32(1), Thrift::Text("fluorspar".into()));
    let groups = Thrift::List(vec![group]);
    let begin = bytes.len();
    Thrift::Struct(vec![(1, version), (2, schema), (3, rows_field()), (4, groups), (6, by)])
        .write(&mut bytes);
    bytes.extend(((bytes.len() - begin) as u32).to_le_bytes());
    bytes.extend(b"PAR1");
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand after the specifications of Thrift's compact protocol and of Parquet's levels.
    #[test]
    fn numbers_fields_and_levels_are_packed_as_specified() {
        let packed = |value: Thrift| {
            let mut bytes = Vec::new();
            value.write(&mut bytes);
            bytes
        };
        assert_eq!(packed(Thrift::I64(-1)), [1]);
        assert_eq!(packed(Thrift::I32(150)), [0xac, 0x02]);
        let fields = vec![(1, Thrift::I32(1)), (4, Thrift::Text("ab".into()))];
        assert_eq!(packed(Thrift::Struct(fields)), [0x15, 2, 0x38, 2, b'a', b'b', 0]);
        let many = (0..20).map(|_| Thrift::I32(0)).collect();
        assert_eq!(packed(Thrift::List(many))[..3], [0xf5, 20, 0]);
        let column = ParquetColumn::Number(vec![Some(1.0), None, Some(2.0)]);
        let page = [&[2, 0, 0, 0, 3, 0b101][..], &1f64.to_le_bytes(), &2f64.to_le_bytes()].concat();
        assert_eq!(column.page(), page);
        assert_eq!(ParquetColumn::Text(vec!["µ".into()]).page(), [2, 0, 0, 0, 0xc2, 0xb5]);
    }

    #[test]
    fn a_table_begins_and_ends_as_parquet() {
        let bytes = parquet_table(&[("a", ParquetColumn::Whole(vec![Some(7), None]))]);
        assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"));
        let length = u32::from_le_bytes(bytes[bytes.len() - 8..][..4].try_into().unwrap()) as usize;
        // The description begins with the version: field 1, 32 bits, 1
        assert_eq!(bytes[bytes.len() - 8 - length..][..2], [0x15, 2]);
    }
}
