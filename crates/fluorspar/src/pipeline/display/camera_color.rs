//! Color of a camera: from CIE 1931 tristimulus values to its channels, fitted from its quantum efficiency.

use super::preview::inverse;
use crate::pipeline::estimate::frame_light::frame_light;
use crate::spectral::{Curve, QuantumEfficiency, Spectrum, StandardObserver, WavelengthGrid, daylight_d65};
use crate::study::{Capture, Study};
use crate::units::photons_per_joule;

/// The color of the camera of a study, for raw converters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraColor {
    /// R, G, B of the camera, relative to the largest of a white surface under D65, from XYZ with Y = 1 for that surface; rows
    /// first.
    pub xyz_to_camera: [[f64; 3]; 3],
    /// R, G, B of a neutral surface under the light of the frame, largest 1.
    pub neutral: [f64; 3],
}

/// Widths, nm, of the smooth bands that stand for colored surfaces beside the tissues.
const BANDS_NM: [f64; 2] = [30.0, 70.0];

impl CameraColor {
    /// Fits the matrix by least squares over reflectances under D65: the training reflectances of the camera, bell-shaped bands and their
    /// complements at every 20 nm, and a white surface that counts as much as all of them. The lens with its filters stands
    /// before the sensor. The neutral is that of the frame's lights where they cover the visible range, else of D65.
    ///
    /// `None` without lens or sensor, without channels R, G and B, or where one of them sees nothing.
    pub fn of_frame(study: &Study, capture: &Capture) -> Option<Self> {
        let (sensor, lens) = (study.camera.sensor.as_ref()?, study.camera.lens_behind_filters()?);
        let grid = WavelengthGrid::uniform(380.0, 780.0, 5.0).ok()?;
        let qe: Vec<Spectrum<QuantumEfficiency>> = ["R", "G", "B"]
            .iter()
            .map(|name| Some(sensor.qe().on_grid(sensor.qe().find(name)?, &grid)))
            .collect::<Option<_>>()?;
        // Define the responses of the camera and of the standard observer
        let respond = |light: &Curve| -> [f64; 3] {
            let photons: Vec<f64> = (light.times(&lens.transmittance).bin_averages(&grid).iter().enumerate())
                .map(|(b, v)| v * photons_per_joule(grid.center_nm(b)))
                .collect();
            std::array::from_fn(|c| (0..grid.len()).map(|b| photons[b] * qe[c][b] * grid.width_nm(b)).sum())
        };
        let observer = StandardObserver::new(&grid);
        let tristimulus = |light: &Curve| -> [f64; 3] {
            let values: Vec<f32> = light.bin_averages(&grid).iter().map(|v| *v as f32).collect();
            observer.xyz(&values)
        };
        // Normalize both to D65
        let daylight = daylight_d65();
        let (white, white_xyz) = (respond(&daylight), tristimulus(&daylight));
        let largest = white.iter().copied().fold(0.0, f64::max);
        if white.iter().any(|&w| w <= 1e-9 * largest) {
            return None;
        }
        // Collect training surfaces: reflectances, and smooth bands with their complements
        let mut surfaces = study.camera.training_reflectances.clone();
        for center in (400..=700).step_by(20) {
            for width in BANDS_NM {
                let bell = move |nm: f64| (-0.5 * ((nm - f64::from(center)) / width).powi(2)).exp();
                surfaces.push(Curve::from_fn(380.0, 780.0, bell));
                surfaces.push(Curve::from_fn(380.0, 780.0, move |nm| 1.0 - bell(nm)));
            }
        }
        // Accumulate and solve the normal equations of XYZ to camera
        let (mut normal, mut right) = ([[0.0; 3]; 3], [[0.0; 3]; 3]);
        let mut add = |surface: &Curve, weight: f64| {
            let light = daylight.times(surface);
            let xyz = tristimulus(&light).map(|v| v / white_xyz[1]);
            let rgb = respond(&light).map(|v| v / largest);
            for i in 0..3 {
                for j in 0..3 {
                    normal[i][j] += weight * xyz[i] * xyz[j];
                    right[i][j] += weight * xyz[i] * rgb[j];
                }
            }
        };
        surfaces.iter().for_each(|surface| add(surface, 1.0));
        add(&Curve::constant(1.0), surfaces.len() as f64);
        let inverse = inverse(normal)?;
        let xyz_to_camera = std::array::from_fn(|channel| {
            std::array::from_fn(|axis| (0..3).map(|k| inverse[axis][k] * right[k][channel]).sum())
        });
        // Respond to the light of the frame for the neutral point
        let light = frame_light(study, capture, None)
            .filter(|light| light.integral(500.0, 650.0) >= 0.2 * light.total())
            .map_or(white, |light| respond(&light));
        let most = light.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        Some(Self { xyz_to_camera, neutral: light.map(|v| (v / most).max(1e-4)) })
    }
}
