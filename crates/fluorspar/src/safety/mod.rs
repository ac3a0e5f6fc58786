//! Photobiological safety of lamps: weighted quantities, exposure limits, margins.
//!
//! | step | call | file |
//! |---|---|---|
//! | what weighs a wavelength | [`ActionSpectrum`] | `action_spectrum.rs` |
//! | light at an eye or a surface | [`Illumination`], [`ApparentSource`] | `illumination.rs` |
//! | quantity, limit, margin of every hazard | [`assess`] | `hazard.rs` |
//! | risk group of a lamp | [`RiskGroup`] | `risk_group.rs` |
//!
//! Limits: IEC 62471:2006, which are those of ICNIRP for incoherent light (Health Physics 87, 171 (2004), ultraviolet;
//! Health Physics 105, 74 (2013), visible and infrared). There is no limit for oral mucosa; that for skin is divided by a
//! factor that the user states.
//!
//! Out of scope: lasers (IEC 60825-1), photosensitized tissue, trains of pulses shorter than 10 µs. The numbers are no
//! certificate: a certificate needs a measured lamp.

mod action_spectrum;
mod hazard;
mod illumination;
mod risk_group;

pub use action_spectrum::ActionSpectrum;
pub use hazard::{Assessment, DAY_S, ExposedTissue, Hazard, RetinalObserver, assess, repeats_per_day};
pub use illumination::{ApparentSource, Illumination};
pub use risk_group::{RiskGroup, RiskQuantity, risk_group};
