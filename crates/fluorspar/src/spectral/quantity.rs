//! Quantities of spectra, as marker types.

/// A physical quantity that varies with wavelength.
pub trait Quantity: Copy + Send + Sync + 'static {
    /// Name for labels and files, for instance "radiance".
    const NAME: &'static str;
    /// Unit of one value, for instance `W/(sr m^2 nm)`.
    const UNIT: &'static str;
}

macro_rules! quantities {
    ($($(#[$doc:meta])* $name:ident = $label:literal, $unit:literal;)*) => {
        $(
            $(#[$doc])*
            #[derive(Clone, Copy, Debug, PartialEq, Eq)]
            pub enum $name {}
            impl Quantity for $name {
                const NAME: &'static str = $label;
                const UNIT: &'static str = $unit;
            }
        )*
    };
}

quantities! {
    /// Spectral radiance, W/(sr m² nm).
    Radiance = "radiance", "W/(sr m^2 nm)";
    /// Spectral irradiance, W/(m² nm).
    Irradiance = "irradiance", "W/(m^2 nm)";
    /// Spectral radiant power (flux), W/nm.
    RadiantPower = "radiant power", "W/nm";
    /// Fraction of light reflected diffusely, without unit.
    Reflectance = "reflectance", "1";
    /// Fraction of light passed by a filter or lens, without unit.
    Transmittance = "transmittance", "1";
    /// Electrons per photon that arrives at the pixel, e-/photon.
    QuantumEfficiency = "quantum efficiency", "e-/photon";
    /// Any other ratio.
    Dimensionless = "ratio", "1";
}
