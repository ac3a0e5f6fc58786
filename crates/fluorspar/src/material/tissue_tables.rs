//! Solved states of a tissue as bytes and back, bit for bit, so that they can be kept.
//!
//! Little-endian. All sets of wavelengths come first, each once; curves refer to them by number.

use std::sync::Arc;

use super::StateGrid;
use super::state_grid::MappedParameter;
use super::texture::ScalarTexture;
use super::tissue_surface::{SurfaceFluorescence, TissueSurface};
use crate::spectral::{Curve, Fluorophore, PhotonEem, SeparableTerm, Stokes, YieldDensity};

/// Counted up when the layout changes.
const LAYOUT: u32 = 1;

impl TissueSurface {
    /// Everything but the maps of the parameters and the fluorophores as the catalogue has them. `None` where the fluorescence
    /// is not a sum of products, which [`TissueSurface::new`] never makes.
    pub fn to_bytes(&self) -> Option<Vec<u8>> {
        let mut writer = Writer::default();
        writer.count(self.grid.parameters.len());
        for parameter in &self.grid.parameters {
            writer.singles(&parameter.nodes);
            writer.singles(&parameter.bends);
        }
        writer.double(self.error);
        writer.count(self.reflectances.len());
        self.reflectances.iter().for_each(|curve| writer.curve(curve));
        writer.count(self.emissions.len());
        for emission in &self.emissions {
            writer.text(&emission.fluorophore.name);
            writer.count(emission.states.len());
            for eem in &emission.states {
                writer.matrix(eem)?;
            }
        }
        Some(writer.finish())
    }

    /// What [`Self::to_bytes`] wrote, for `parameters` with these names and maps. `find` gives a fluorophore by its name.
    /// `None` where the bytes hold something else.
    pub fn from_bytes(
        bytes: &[u8],
        parameters: Vec<(String, ScalarTexture)>,
        find: &dyn Fn(&str) -> Option<Arc<Fluorophore>>,
    ) -> Option<Self> {
        let mut reader = Reader { rest: bytes, wavelengths: Vec::new() };
        reader.read_wavelengths()?;
        if reader.count()? != parameters.len() {
            return None;
        }
        let parameters = parameters
            .into_iter()
            .map(|(name, map)| {
                Some(MappedParameter { name, nodes: reader.singles()?, bends: reader.singles()?, map })
            })
            .collect::<Option<_>>()?;
        let grid = StateGrid { parameters };
        let error = reader.double()?;
        let reflectances = (0..reader.count()?).map(|_| reader.curve()).collect::<Option<Vec<_>>>()?;
        let emissions = (0..reader.count()?)
            .map(|_| {
                let fluorophore = find(&reader.text()?)?;
                let states = (0..reader.count()?)
                    .map(|_| Some(Arc::new(reader.matrix()?)))
                    .collect::<Option<Vec<_>>>()?;
                (states.len() == reflectances.len()).then_some(SurfaceFluorescence { fluorophore, states })
            })
            .collect::<Option<Vec<_>>>()?;
        let whole = reader.rest.is_empty() && grid.check(reflectances.len()).is_ok();
        whole.then_some(Self { grid, reflectances, emissions, error })
    }
}

#[derive(Default)]
struct Writer<'a> {
    body: Vec<u8>,
    wavelengths: Vec<&'a [f64]>,
}

impl<'a> Writer<'a> {
    fn count(&mut self, count: usize) {
        self.body.extend((count as u32).to_le_bytes());
    }

    fn double(&mut self, value: f64) {
        self.body.extend(value.to_le_bytes());
    }

    fn singles(&mut self, values: &[f32]) {
        self.count(values.len());
        self.body.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    }

    fn text(&mut self, text: &str) {
        self.count(text.len());
        self.body.extend(text.as_bytes());
    }

    fn curve(&mut self, curve: &'a Curve) {
        let nm = curve.wavelengths_nm();
        let known = self.wavelengths.iter().position(|other| *other == nm);
        let number = known.unwrap_or_else(|| {
            self.wavelengths.push(nm);
            self.wavelengths.len() - 1
        });
        self.count(number);
        self.body.extend(curve.values().iter().flat_map(|value| value.to_le_bytes()));
    }

    fn matrix(&mut self, eem: &'a PhotonEem) -> Option<()> {
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

    fn finish(self) -> Vec<u8> {
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

struct Reader<'a> {
    rest: &'a [u8],
    wavelengths: Vec<Arc<[f64]>>,
}

impl<'a> Reader<'a> {
    fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.rest.split_at_checked(count)?;
        self.rest = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.bytes(N)?.try_into().ok()
    }

    fn count(&mut self) -> Option<usize> {
        Some(u32::from_le_bytes(self.array()?) as usize)
    }

    fn double(&mut self) -> Option<f64> {
        Some(f64::from_le_bytes(self.array()?))
    }

    fn doubles(&mut self, count: usize) -> Option<Vec<f64>> {
        let bytes = self.bytes(count.checked_mul(8)?)?;
        let (values, _) = bytes.as_chunks::<8>();
        Some(values.iter().map(|value| f64::from_le_bytes(*value)).collect())
    }

    fn singles(&mut self) -> Option<Vec<f32>> {
        let count = self.count()?;
        let (values, _) = self.bytes(count.checked_mul(4)?)?.as_chunks::<4>();
        Some(values.iter().map(|value| f32::from_le_bytes(*value)).collect())
    }

    fn text(&mut self) -> Option<String> {
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

    fn curve(&mut self) -> Option<Curve> {
        let number = self.count()?;
        let nm = Arc::clone(self.wavelengths.get(number)?);
        let values = self.doubles(nm.len())?;
        Curve::on_shared(nm, values).ok()
    }

    fn matrix(&mut self) -> Option<PhotonEem> {
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
    use crate::material::tissue_surface_tests::{dye, surface_with_a_map};

    #[test]
    fn tables_come_back_bit_for_bit_and_damage_is_noticed() {
        let surface = surface_with_a_map();
        assert!(surface.error > 0.0 && surface.error < 0.02 && surface.grid.len() > 2, "{}", surface.error);
        let bytes = surface.to_bytes().unwrap();
        let parameter = || vec![("absorption".to_owned(), surface.grid.parameters[0].map.clone())];
        let find = |name: &str| (name == "dye").then(dye);
        assert!(TissueSurface::from_bytes(&bytes, parameter(), &find).unwrap() == surface);
        for cut in [0, 3, 8, bytes.len() / 2, bytes.len() - 1] {
            assert!(TissueSurface::from_bytes(&bytes[..cut], parameter(), &find).is_none(), "{cut}");
        }
        assert!(TissueSurface::from_bytes(&[&bytes[..], &[0]].concat(), parameter(), &find).is_none());
        assert!(TissueSurface::from_bytes(&bytes, Vec::new(), &find).is_none());
        assert!(TissueSurface::from_bytes(&bytes, parameter(), &|_| None).is_none());
    }
}
