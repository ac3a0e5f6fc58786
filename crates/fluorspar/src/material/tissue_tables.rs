//! Solved states of a tissue as bytes and back, bit for bit, so that they can be kept.

use std::sync::Arc;

use super::StateGrid;
use super::state_grid::MappedParameter;
use super::texture::ScalarTexture;
use super::tissue_surface::{SurfaceFluorescence, TissueSurface};
use crate::spectral::{Fluorophore, TableReader, TableWriter};
use crate::tissue::RadialProfile;

impl TissueSurface {
    /// Everything but the maps of the parameters and the fluorophores as the catalogue has them. `None` where the fluorescence
    /// is not a sum of products, which [`TissueSurface::new`] never makes.
    pub fn to_bytes(&self) -> Option<Vec<u8>> {
        let mut writer = TableWriter::default();
        writer.count(self.grid.parameters.len());
        for parameter in &self.grid.parameters {
            writer.singles(&parameter.nodes);
            writer.singles(&parameter.bends);
        }
        writer.double(self.error);
        writer.count(self.reflectances.len());
        self.reflectances.iter().for_each(|curve| writer.curve(curve));
        writer.count(self.grid.profiles.len());
        self.grid.profiles.iter().for_each(|profile| writer.singles(profile.values()));
        writer.count(self.emissions.len());
        for emission in &self.emissions {
            writer.text(&emission.fluorophore.name);
            writer.count(emission.states.len());
            for eem in &emission.states {
                writer.matrix(eem)?;
            }
            writer.count(emission.profiles.len());
            for profile in emission.profiles.iter().flat_map(|by_excitation| by_excitation.iter()) {
                writer.singles(profile.values());
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
        let mut reader = TableReader::new(bytes)?;
        if reader.count()? != parameters.len() {
            return None;
        }
        let parameters = parameters
            .into_iter()
            .map(|(name, map)| {
                Some(MappedParameter { name, nodes: reader.singles()?, bends: reader.singles()?, map })
            })
            .collect::<Option<_>>()?;
        let mut grid = StateGrid { parameters, profiles: Vec::new() };
        let error = reader.double()?;
        let reflectances = (0..reader.count()?).map(|_| reader.curve()).collect::<Option<Vec<_>>>()?;
        grid.profiles = (0..reader.count()?)
            .map(|_| RadialProfile::of_reflected(&reader.singles()?))
            .collect::<Option<_>>()?;
        let emissions = (0..reader.count()?)
            .map(|_| {
                let fluorophore = find(&reader.text()?)?;
                let states = (0..reader.count()?)
                    .map(|_| Some(Arc::new(reader.matrix()?)))
                    .collect::<Option<Vec<_>>>()?;
                let profiles = (0..reader.count()?)
                    .map(|_| {
                        let mut profile = || RadialProfile::of_emitted(&reader.singles()?);
                        Some(Arc::new([profile()?, profile()?, profile()?]))
                    })
                    .collect::<Option<Vec<_>>>()?;
                let fits = states.len() == reflectances.len() && [0, states.len()].contains(&profiles.len());
                fits.then_some(SurfaceFluorescence { fluorophore, states, profiles })
            })
            .collect::<Option<Vec<_>>>()?;
        let whole = reader.is_at_end() && grid.check(reflectances.len()).is_ok();
        whole.then_some(Self { grid, reflectances, emissions, error })
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
