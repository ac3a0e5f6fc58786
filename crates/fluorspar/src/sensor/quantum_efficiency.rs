//! Electrons per photon, channel by channel.

use super::SensorProblem;
use crate::spectral::{Curve, QuantumEfficiency, Spectrum, WavelengthGrid};
use crate::units::{ISETCAM_PLANCK_J_S, LIGHT_SPEED_M_PER_S, photons_per_joule};

/// Quantum efficiency of one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelQe {
    /// Name of the channel, as in the mosaic.
    pub name: String,
    /// Electrons per photon that falls on the collecting area, color filter and cover glass included.
    pub curve: Curve,
}

/// Quantum efficiency of every channel of a sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct SpectralQe {
    channels: Vec<ChannelQe>,
}

impl SpectralQe {
    /// Curves by channel.
    ///
    /// # Errors
    /// No channel, two channels of one name, or a value outside 0 to 1.
    pub fn new(channels: Vec<ChannelQe>) -> Result<Self, SensorProblem> {
        if channels.is_empty() {
            return Err(SensorProblem::new("quantum_efficiency", "no channel; give at least one curve"));
        }
        for (index, ChannelQe { name, curve }) in channels.iter().enumerate() {
            if channels[..index].iter().any(|other| other.name == *name) {
                let message = "two curves have this name; rename one of them";
                return Err(SensorProblem::new(format!("quantum_efficiency.{name}"), message));
            }
            if let Some(sample) = curve.values().iter().position(|value| !(0.0..=1.0).contains(value)) {
                let message = format!(
                    "{} at {} nm is outside 0 to 1; give electrons per photon, not percent and not A/W",
                    curve.values()[sample],
                    curve.wavelengths_nm()[sample]
                );
                return Err(SensorProblem::new(format!("quantum_efficiency.{name}"), message));
            }
        }
        Ok(Self { channels })
    }

    /// Curves by channel from pairs of name and curve.
    ///
    /// # Errors
    /// As [`SpectralQe::new`].
    pub fn from_curves<N: Into<String>>(
        curves: impl IntoIterator<Item = (N, Curve)>,
    ) -> Result<Self, SensorProblem> {
        Self::new(curves.into_iter().map(|(name, curve)| ChannelQe { name: name.into(), curve }).collect())
    }

    /// The same sensor behind one more filter (an infrared cut, a cover glass), multiplied at fine sampling.
    #[must_use]
    pub fn behind(&self, filter: &Curve) -> Self {
        let filtered = |channel: &ChannelQe| ChannelQe {
            name: channel.name.clone(),
            curve: channel.curve.times(filter),
        };
        Self { channels: self.channels.iter().map(filtered).collect() }
    }

    /// The same channels with other curves, in order.
    pub(super) fn with_curves(&self, curves: impl IntoIterator<Item = Curve>) -> Self {
        let channels = self.channels.iter().zip(curves);
        Self { channels: channels.map(|(c, curve)| ChannelQe { name: c.name.clone(), curve }).collect() }
    }

    /// All channels.
    pub fn channels(&self) -> &[ChannelQe] {
        &self.channels
    }

    /// Number of the channel of a name.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.channels.iter().position(|channel| channel.name == name)
    }

    /// Bin averages of one channel.
    pub fn on_grid(&self, channel: usize, grid: &WavelengthGrid) -> Spectrum<QuantumEfficiency> {
        self.channels[channel].curve.on_grid(grid)
    }

    /// Channels whose data end inside a grid while still above 1 % of their peak: their name and measured range, nm.
    /// The efficiency is taken as zero outside its data, so a user should be warned. A curve that ends at the center of the first or last
    /// bin, or beyond it, covers the grid.
    pub fn truncated_on(&self, grid: &WavelengthGrid) -> Vec<(String, [f64; 2])> {
        let is_cut = |curve: &Curve| {
            let (first, last) = curve.range_nm();
            let threshold = 0.01 * curve.max();
            (first > grid.center_nm(0) && curve.at(first) > threshold)
                || (last < grid.center_nm(grid.len() - 1) && curve.at(last) > threshold)
        };
        let cut = self.channels.iter().filter(|channel| is_cut(&channel.curve));
        cut.map(|channel| (channel.name.clone(), channel.curve.range_nm().into())).collect()
    }

    /// Electrons per second on `area_m2` per unit of spectral irradiance in each bin, e-/s per W/(m² nm):
    /// `A * integral of QE(lambda) lambda / (h c)` over the bin. The irradiance is constant within its bin; the
    /// efficiency and the photon energy are not.
    pub fn electron_weights(&self, channel: usize, grid: &WavelengthGrid, area_m2: f64) -> Vec<f64> {
        let curve = &self.channels[channel].curve;
        let (first, last) = curve.range_nm();
        let photons = Curve::from_fn(first, last, photons_per_joule);
        let electrons_per_joule = curve.times(&photons);
        let integral = |edges: &[f64]| area_m2 * electrons_per_joule.integral(edges[0], edges[1]);
        grid.edges_nm().windows(2).map(integral).collect()
    }

    /// The same weights as ISETCam forms them: efficiency and photon energy at the center of the bin, its value of
    /// the Planck constant, and the first step of the grid for all bins.
    pub fn isetcam_electron_weights(&self, channel: usize, grid: &WavelengthGrid, area_m2: f64) -> Vec<f64> {
        let step_nm = if grid.len() > 1 { grid.center_nm(1) - grid.center_nm(0) } else { grid.width_nm(0) };
        let curve = &self.channels[channel].curve;
        let weight = |center_nm: f64| {
            let photons_per_joule = center_nm * 1e-9 / (ISETCAM_PLANCK_J_S * LIGHT_SPEED_M_PER_S);
            area_m2 * curve.at(center_nm) * photons_per_joule * step_nm
        };
        grid.centers_nm().into_iter().map(weight).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::PLANCK_J_S;

    #[test]
    fn weights_of_a_flat_efficiency_count_photons_exactly() {
        let qe = SpectralQe::from_curves([("mono", Curve::constant(0.5))]).unwrap();
        let grid = WavelengthGrid::from_edges(&[350.0, 352.5, 360.0, 390.0]).unwrap();
        let weights = qe.electron_weights(0, &grid, 2e-12);
        for (bin, weight) in weights.iter().enumerate() {
            // lambda is linear, so its mean over a bin is that of the center.
            let photons = photons_per_joule(grid.center_nm(bin)) * grid.width_nm(bin);
            assert!((weight / (0.5 * 2e-12 * photons) - 1.0).abs() < 1e-12);
        }
        let iset = qe.isetcam_electron_weights(0, &WavelengthGrid::default(), 2e-12);
        let ours = qe.electron_weights(0, &WavelengthGrid::default(), 2e-12);
        for (iset, ours) in iset.iter().zip(&ours) {
            assert!((iset / ours - PLANCK_J_S / ISETCAM_PLANCK_J_S).abs() < 1e-12);
        }
    }

    #[test]
    fn impossible_efficiencies_and_cut_data_are_reported() {
        let percent = SpectralQe::from_curves([("R", Curve::constant(60.0))]).unwrap_err();
        assert!(percent.to_string().contains("percent"), "{percent}");
        let twice = [("R", Curve::constant(0.1)), ("R", Curve::constant(0.2))];
        assert_eq!(SpectralQe::from_curves(twice).unwrap_err().field, "quantum_efficiency.R");
        let short = Curve::new(vec![400.0, 700.0], vec![0.3, 0.0]).unwrap();
        let qe = SpectralQe::from_curves([("G", short)]).unwrap();
        assert_eq!(qe.truncated_on(&WavelengthGrid::default()), [("G".to_owned(), [400.0, 700.0])]);
        assert!(qe.truncated_on(&WavelengthGrid::uniform(450.0, 750.0, 5.0).unwrap()).is_empty());
    }
}
