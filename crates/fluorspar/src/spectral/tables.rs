//! Curves and matrices as bytes and back, bit for bit, so that they can be kept.
//!
//! Little-endian. All sets of wavelengths come first, each once; curves refer to them by number.

use std::sync::Arc;

use super::{Curve, Fluorophore, PhotonEem, SeparableTerm, Stokes, YieldDensity};

/// Counted up when the layout changes.
const LAYOUT: u32 = 1;

impl Fluorophore {
    /// Some fluorophores as bytes, to the last bit. `None` where one is not a sum of products, as a measured table.
    pub fn list_to_bytes(list: &[Self]) -> Option<Vec<u8>> {
        let mut writer = TableWriter::default();
        writer.count(list.len());
        for fluorophore in list {
            let Self { name, title, source, excitation_range_nm, emission_range_nm, eem } = fluorophore;
            [name, title, source].into_iter().for_each(|text| writer.text(text));
            for (first, last) in [excitation_range_nm, emission_range_nm] {
                writer.double(*first);
                writer.double(*last);
            }
            writer.matrix(eem)?;
        }
        Some(writer.finish())
    }

    /// What [`Self::list_to_bytes`] wrote; `None` of other bytes.
    pub fn list_from_bytes(bytes: &[u8]) -> Option<Vec<Self>> {
        let mut reader = TableReader::new(bytes)?;
        let mut list = Vec::new();
        for _ in 0..reader.count()? {
            let (name, title, source) = (reader.text()?, reader.text()?, reader.text()?);
            let excitation_range_nm = (reader.double()?, reader.double()?);
            let emission_range_nm = (reader.double()?, reader.double()?);
            let eem = reader.matrix()?;
            list.push(Self { name, title, source, excitation_range_nm, emission_range_nm, eem });
        }
        reader.is_at_end().then_some(list)
    }
}

/// Writes numbers, texts, curves and matrices.
#[derive(Default)]
pub(crate) struct TableWriter<'a> {
    body: Vec<u8>,
    wavelengths: Vec<&'a [f64]>,
}

impl<'a> TableWriter<'a> {
    pub(crate) fn count(&mut self, count: usize) {
        self.body.extend((count as u32).to_le_bytes());
    }

    pub(crate) fn double(&mut self, value: f64) {
        self.body.extend(value.to_le_bytes());
    }

    pub(crate) fn singles(&mut self, values: &[f32]) {
        self.count(values.len());
        self.body.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    }

    pub(crate) fn text(&mut self, text: &str) {
        self.count(text.len());
        self.body.extend(text.as_bytes());
    }

    pub(crate) fn curve(&mut self, curve: &'a Curve) {
        let nm = curve.wavelengths_nm();
        let known = self.wavelengths.iter().position(|other| *other == nm);
        let number = known.unwrap_or_else(|| {
            self.wavelengths.push(nm);
            self.wavelengths.len() - 1
        });
        self.count(number);
        self.body.extend(curve.values().iter().flat_map(|value| value.to_le_bytes()));
    }

    pub(crate) fn matrix(&mut self, eem: &'a PhotonEem) -> Option<()> {
        let YieldDensity::Separable(terms) = eem.density() else { return None };
        self.body.push(u8::from(eem.stokes() == Stokes::Mask));
        self.double(eem.scale());
        self.count(terms.len());
        for term in terms {
            self.curve(&term.excitation);
            self.curve(&term.emission);
        }
        Some(())
    }

    pub(crate) fn finish(self) -> Vec<u8> {
        let mut head = Self::default();
        head.count(LAYOUT as usize);
        head.count(self.wavelengths.len());
        for nm in self.wavelengths {
            head.count(nm.len());
            head.body.extend(nm.iter().flat_map(|value| value.to_le_bytes()));
        }
        head.body.extend(self.body);
        head.body
    }
}

/// Reads what [`TableWriter`] wrote; `None` where the bytes hold something else.
pub(crate) struct TableReader<'a> {
    rest: &'a [u8],
    wavelengths: Vec<Arc<[f64]>>,
}

impl<'a> TableReader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Option<Self> {
        let mut reader = Self { rest: bytes, wavelengths: Vec::new() };
        reader.read_wavelengths()?;
        Some(reader)
    }

    pub(crate) fn is_at_end(&self) -> bool {
        self.rest.is_empty()
    }

    fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.rest.split_at_checked(count)?;
        self.rest = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.bytes(N)?.try_into().ok()
    }

    pub(crate) fn count(&mut self) -> Option<usize> {
        Some(u32::from_le_bytes(self.array()?) as usize)
    }

    pub(crate) fn double(&mut self) -> Option<f64> {
        Some(f64::from_le_bytes(self.array()?))
    }

    fn doubles(&mut self, count: usize) -> Option<Vec<f64>> {
        let bytes = self.bytes(count.checked_mul(8)?)?;
        let (values, _) = bytes.as_chunks::<8>();
        Some(values.iter().map(|value| f64::from_le_bytes(*value)).collect())
    }

    pub(crate) fn singles(&mut self) -> Option<Vec<f32>> {
        let count = self.count()?;
        let (values, _) = self.bytes(count.checked_mul(4)?)?.as_chunks::<4>();
        Some(values.iter().map(|value| f32::from_le_bytes(*value)).collect())
    }

    pub(crate) fn text(&mut self) -> Option<String> {
        let count = self.count()?;
        String::from_utf8(self.bytes(count)?.to_vec()).ok()
    }

    fn read_wavelengths(&mut self) -> Option<()> {
        if self.count()? != LAYOUT as usize {
            return None;
        }
        for _ in 0..self.count()? {
            let count = self.count()?;
            let nm = self.doubles(count)?;
            self.wavelengths.push(nm.into());
        }
        Some(())
    }

    pub(crate) fn curve(&mut self) -> Option<Curve> {
        let number = self.count()?;
        let nm = Arc::clone(self.wavelengths.get(number)?);
        let values = self.doubles(nm.len())?;
        Curve::on_shared(nm, values).ok()
    }

    pub(crate) fn matrix(&mut self) -> Option<PhotonEem> {
        let [masked] = self.array()?;
        let scale = self.double()?;
        let terms = (0..self.count()?)
            .map(|_| Some(SeparableTerm { excitation: self.curve()?, emission: self.curve()? }))
            .collect::<Option<Vec<_>>>()?;
        let stokes = if masked == 1 { Stokes::Mask } else { Stokes::Off };
        // One times a number is that number, to the last bit.
        Some(PhotonEem::separable(terms, stokes).scaled(scale))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fluorophores_come_back_bit_for_bit_and_other_bytes_do_not() {
        let bell =
            |center: f64| Curve::from_fn(300.0, 700.0, move |nm| (-((nm - center) / 37.0).powi(2)).exp());
        let dye = |name: &str, scale: f64| Fluorophore {
            name: name.into(),
            title: format!("{name} of a test"),
            eem: PhotonEem::separable(
                vec![SeparableTerm { excitation: bell(400.1).scaled(1e-3), emission: bell(520.0) }],
                Stokes::Mask,
            )
            .scaled(scale),
            excitation_range_nm: (350.0, 450.0),
            emission_range_nm: (450.0, 700.0),
            source: String::new(),
        };
        let list = [dye("a", 1.0), dye("b", 1.0 / 3.0)];
        let bytes = Fluorophore::list_to_bytes(&list).unwrap();
        assert_eq!(Fluorophore::list_from_bytes(&bytes).unwrap(), list);
        for length in [0, 3, 8, bytes.len() / 2, bytes.len() - 1] {
            assert!(Fluorophore::list_from_bytes(&bytes[..length]).is_none(), "{length}");
        }
        assert!(Fluorophore::list_from_bytes(&[bytes, vec![0]].concat()).is_none());
    }
}
