//! Cameras that make rays and lenses that turn scene radiance into irradiance on the sensor.
//!
//! | file | what |
//! |---|---|
//! | `perspective` | the camera of a scene: a pinhole, a round aperture, or film behind a traced lens |
//! | `airy` | the diffraction pattern of a round aperture |
//! | `ideal_lens` | the camera equation: irradiance from radiance without aberrations |
//! | `field_aberrations` | the image of a traced lens from a pinhole's radiance and point spreads |
//! | `filter` | transmittance averaged over the angles of the rays, autofluorescence |
//! | `glass`, `prescription` | a lens as its maker describes it |
//! | `paraxial` | first-order properties |
//! | `sequential_trace` | exact rays through the surfaces |
//! | `lens_report` | illumination, distortion, field curvature, spots, MTF, a drawing |
//! | `camera_lens` | film behind a traced lens, in the frame of a camera |
//! | `exit_pupil`, `traced_lens` | aperture, focus, rays from the film into the scene with weights |

mod airy;
mod by_height;
mod camera_lens;
mod exit_pupil;
mod field_aberrations;
mod filter;
mod glass;
mod ideal_lens;
mod lens_report;
mod paraxial;
mod perspective;
mod prescription;
mod sequential_trace;
mod traced_lens;
#[cfg(test)]
mod traced_lens_tests;

pub use camera_lens::{CameraLens, CameraLensRay};
pub use field_aberrations::PointSpread;
pub use filter::{AngleDistribution, Filter, FilterAutofluorescence, FilterStack, averaged_transmittance};
pub use glass::{C_LINE_NM, D_LINE_NM, Dispersion, F_LINE_NM, Glass};
pub use ideal_lens::{IdealLens, LensProblem, Vignetting};
pub use lens_report::{
    FieldMtf, FieldPoint, LensDrawing, LensReport, LensReportSettings, MtfReport, RayFan, Spot,
    diffraction_mtf,
};
pub use paraxial::Paraxial;
pub use perspective::{Aperture, CameraRay, PerspectiveCamera};
pub use prescription::{
    FocusGap, FocusMechanism, LensPrescription, LensSurface, MOST_ASPHERIC_TERMS, MOST_SURFACES, Medium,
    PrescriptionError, SystemAperture,
};
pub use sequential_trace::{Blocked, LensRay, SequentialTrace};
pub use traced_lens::{ChiefRay, FilmSample, LensSetting, LensState, TracedLens};
