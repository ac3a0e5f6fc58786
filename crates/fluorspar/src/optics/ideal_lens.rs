//! A lens without aberrations: the camera equation and the cosine fourth law.

use std::f64::consts::PI;

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::filter::AngleDistribution;
use crate::image::SpectralImage;
use crate::sampling::{SampleStream, warp};
use crate::spectral::{Curve, Irradiance, Radiance, Spectrum, Transmittance, WavelengthGrid};
use crate::units::{check_range, number_text};

/// How irradiance falls off away from the optical axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Vignetting {
    /// No falloff.
    None,
    /// The fourth power of the cosine of the field angle.
    #[default]
    Cos4,
}

/// A lens that images every point of its object plane to a point.
///
/// Irradiance on the film is `E = pi L T / (1 + 4 N^2 (1 + |m|)^2)` on the axis, with the magnification
/// `m = f / (f - d)` of a thin lens focused at the distance `d`. It is exact for a uniform Lambertian field, also
/// at low f-numbers: the shorter `pi L / (4 N^2)` is 13 % too high at f/1.4. Off the axis it is multiplied by
/// `cos^4` of the field angle, seen from the image distance `s = f (1 + |m|)`.
#[derive(Clone, Debug, PartialEq)]
pub struct IdealLens {
    /// Focal length, mm.
    pub focal_length_mm: f64,
    /// Focal length over the diameter of the entrance pupil.
    pub f_number: f64,
    /// Transmittance of the lens and of the filters in front of it.
    pub transmittance: Curve,
    /// Distance from the lens to the plane in focus, mm; `None` is infinity.
    pub object_distance_mm: Option<f64>,
    /// Falloff away from the axis.
    pub vignetting: Vignetting,
    /// Irradiance on the axis per radiance of a uniform field, sr, where rays were traced; `None` is the camera equation.
    pub traced_solid_angle_sr: Option<f64>,
    /// Transmittance of lens and filters at heights on the film, mm, rising from 0, where filters are averaged over the
    /// angles of the rays; empty: `transmittance` holds everywhere. Linear between heights.
    pub field_transmittance: Vec<(f64, Curve)>,
}

/// A lens parameter that can't be used.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("lens {field}: {message}")]
pub struct LensProblem {
    /// The field.
    pub field: &'static str,
    /// What is wrong and how to fix it.
    pub message: String,
}

impl IdealLens {
    /// A clear lens focused at infinity, with cosine fourth falloff.
    pub fn new(focal_length_mm: f64, f_number: f64) -> Self {
        Self {
            focal_length_mm,
            f_number,
            transmittance: Curve::constant(1.0),
            object_distance_mm: None,
            vignetting: Vignetting::Cos4,
            traced_solid_angle_sr: None,
            field_transmittance: Vec::new(),
        }
    }

    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that can't be used, with the way to fix it.
    pub fn validate(&self) -> Result<(), LensProblem> {
        let problem = |field, message: String| Err(LensProblem { field, message });
        check_range(self.focal_length_mm, [1e-3, 1e6], "give mm")
            .or_else(|message| problem("focal_length_mm", message))?;
        let hint = "no lens in air is faster than f/0.5. Give focal length over pupil diameter";
        check_range(self.f_number, [0.5, 1e3], hint).or_else(|message| problem("f_number", message))?;
        if let Some(distance) = self.object_distance_mm {
            if distance <= self.focal_length_mm {
                return problem(
                    "object_distance_mm",
                    format!(
                        "{} is not beyond the focal length of {} mm, so there is no real image; move the object \
                         away, or leave the distance out for infinity",
                        number_text(distance),
                        self.focal_length_mm
                    ),
                );
            }
            let hint = "give mm, or leave the distance out for infinity";
            check_range(distance, [0.0, 1e9], hint)
                .or_else(|message| problem("object_distance_mm", message))?;
        }
        self.validate_transmittance()
    }

    /// Checks the transmittance.
    ///
    /// # Errors
    /// A value that is not a fraction.
    pub fn validate_transmittance(&self) -> Result<(), LensProblem> {
        let problem = |field, message: String| Err(LensProblem { field, message });
        let values = self.transmittance.values();
        if let Some(index) = values.iter().position(|t| !(0.0..=1.0).contains(t)) {
            return problem(
                "transmittance",
                format!(
                    "{} at {} nm is outside 0 to 1; give fractions, not percent",
                    values[index],
                    self.transmittance.wavelengths_nm()[index]
                ),
            );
        }
        Ok(())
    }

    /// Size of the image over the size of the object, as a positive number; 0 at infinity.
    pub fn magnification(&self) -> f64 {
        self.object_distance_mm.map_or(0.0, |d| (self.focal_length_mm / (self.focal_length_mm - d)).abs())
    }

    /// Distance from the lens to the film, mm: `f (1 + |m|)`.
    pub fn image_distance_mm(&self) -> f64 {
        self.focal_length_mm * (1.0 + self.magnification())
    }

    /// Width of the film that sees a horizontal field of view, mm: `2 s tan(fov / 2)`.
    pub fn film_width_mm(&self, horizontal_fov_deg: f64) -> f64 {
        2.0 * self.image_distance_mm() * (0.5 * horizontal_fov_deg.to_radians()).tan()
    }

    /// Irradiance on the axis per radiance behind a clear lens, sr: `pi / (1 + 4 N^2 (1 + |m|)^2)`, or as traced.
    pub fn axial_solid_angle_sr(&self) -> f64 {
        if let Some(traced) = self.traced_solid_angle_sr {
            return traced;
        }
        let working_f_number = self.f_number * (1.0 + self.magnification());
        PI / (1.0 + 4.0 * working_f_number * working_f_number)
    }

    /// Irradiance at a height above the axis relative to that on the axis.
    pub fn relative_illumination(&self, image_height_mm: f64) -> f64 {
        match self.vignetting {
            Vignetting::None => 1.0,
            Vignetting::Cos4 => {
                let s2 = self.image_distance_mm().powi(2);
                (s2 / (s2 + image_height_mm * image_height_mm)).powi(2)
            }
        }
    }

    /// Angles to the axis at which light that arrives at a height on the film passes a filter in front of the lens, or
    /// one between lens and film: the pupil is a disc of the diameter `f / N` in the plane of the lens.
    pub fn filter_angles(&self, image_height_mm: f64, behind_lens: bool) -> AngleDistribution {
        let radius_mm = 0.5 * self.focal_length_mm / self.f_number;
        let image_mm = self.image_distance_mm();
        let samples = (0..512_u32).map(|sample| {
            let [u, v, _, _] = SampleStream::new(0, 0, sample).next_4d();
            let pupil = warp::concentric_disc([u, v]).as_dvec2() * radius_mm;
            let behind = (pupil.x - image_height_mm).hypot(pupil.y) / image_mm;
            let behind2 = behind * behind;
            let weight = 1.0 / (1.0 + behind2).powi(2);
            let tangent2 = match self.object_distance_mm {
                _ if behind_lens => behind2,
                None => (image_height_mm / image_mm).powi(2),
                Some(distance) => {
                    let object_mm = -image_height_mm * distance / image_mm;
                    ((pupil.x - object_mm).hypot(pupil.y) / distance).powi(2)
                }
            };
            (tangent2 / (1.0 + tangent2), weight)
        });
        AngleDistribution::of_rays(samples).unwrap_or_else(|| AngleDistribution::single(0.0))
    }

    /// Transmittance averaged over the bins of a grid.
    pub fn transmittance_on(&self, grid: &WavelengthGrid) -> Spectrum<Transmittance> {
        self.transmittance.on_grid(grid)
    }

    /// Transmittance averaged over the bins of a grid for light of the given spectrum within each bin; `None` is even light.
    pub fn transmittance_under(
        &self,
        grid: &WavelengthGrid,
        light: Option<&Curve>,
    ) -> Spectrum<Transmittance> {
        on_grid_under(&self.transmittance, grid, light)
    }

    /// Transmittances averaged over the bins of a grid at the heights on the film, mm, between which they are linear, for light of
    /// the given spectrum within each bin; one at height 0 where it is the same everywhere.
    pub fn transmittances_under(
        &self,
        grid: &WavelengthGrid,
        light: Option<&Curve>,
    ) -> Vec<(f64, Spectrum<Transmittance>)> {
        if self.field_transmittance.is_empty() {
            return vec![(0.0, self.transmittance_under(grid, light))];
        }
        let at = |(height_mm, curve): &(f64, Curve)| (*height_mm, on_grid_under(curve, grid, light));
        self.field_transmittance.iter().map(at).collect()
    }

    /// Irradiance on the axis of a film under a uniform field.
    pub fn axial_irradiance(&self, radiance: &Spectrum<Radiance>) -> Spectrum<Irradiance> {
        let solid_angle = self.axial_solid_angle_sr();
        let transmittance = self.transmittance_on(radiance.grid());
        let values = radiance.values().iter().zip(transmittance.values()).map(|(l, t)| solid_angle * t * l);
        Spectrum::from_parts(radiance.grid().clone(), values.collect())
    }

    /// Irradiance on a film of the given width, centered on the axis, from the radiance that arrives along the chief
    /// ray of each of its (square) pixels. The image is upright: row 0 of the film is row 0 of the radiance.
    pub fn form_image(
        &self,
        radiance: &SpectralImage<Radiance>,
        film_width_mm: f64,
    ) -> SpectralImage<Irradiance> {
        self.form_image_under(radiance, film_width_mm, None)
    }

    /// [`IdealLens::form_image`] for light whose spectrum within each bin is known.
    pub fn form_image_under(
        &self,
        radiance: &SpectralImage<Radiance>,
        film_width_mm: f64,
        light: Option<&Curve>,
    ) -> SpectralImage<Irradiance> {
        let (width, height, bands) = (radiance.width(), radiance.height(), radiance.bands());
        let solid_angle = self.axial_solid_angle_sr();
        let factors = |transmittance: &Spectrum<Transmittance>| -> Vec<f32> {
            transmittance.values().iter().map(|t| (solid_angle * t) as f32).collect()
        };
        // Average the transmittance over the bands, per field height
        let on_axis = factors(&self.transmittance_under(radiance.grid(), light));
        let by_height: Vec<(f64, Vec<f32>)> = self
            .field_transmittance
            .iter()
            .map(|(height_mm, curve)| (*height_mm, factors(&on_grid_under(curve, radiance.grid(), light))))
            .collect();
        let pitch_mm = film_width_mm / width as f64;
        let mut image = SpectralImage::zeros(radiance.grid().clone(), width, height);
        if radiance.data().is_empty() {
            return image;
        }
        // Scale every pixel by solid angle, transmittance and falloff
        let rows = image.data_mut().par_chunks_exact_mut(width * bands);
        rows.zip(radiance.data().par_chunks_exact(width * bands)).enumerate().for_each(
            |(row, (out, light))| {
                let y_mm = (row as f64 + 0.5 - 0.5 * height as f64) * pitch_mm;
                for (col, (out, light)) in
                    out.chunks_exact_mut(bands).zip(light.chunks_exact(bands)).enumerate()
                {
                    let x_mm = (col as f64 + 0.5 - 0.5 * width as f64) * pitch_mm;
                    let height_mm = x_mm.hypot(y_mm);
                    let falloff = self.relative_illumination(height_mm) as f32;
                    let (low, high, t) = around(&by_height, &on_axis, height_mm);
                    for ((out, light), (low, high)) in out.iter_mut().zip(light).zip(low.iter().zip(high)) {
                        *out = light * ((low + t * (high - low)) * falloff);
                    }
                }
            },
        );
        image
    }
}

/// A transmittance averaged over bins for light of a spectrum within each bin; `None` is even light.
fn on_grid_under(
    transmittance: &Curve,
    grid: &WavelengthGrid,
    light: Option<&Curve>,
) -> Spectrum<Transmittance> {
    match light {
        Some(light) => transmittance.on_grid_under(grid, light),
        None => transmittance.on_grid(grid),
    }
}

/// The two tables around a height and the place between them; the given one where there are none.
fn around<'a>(tables: &'a [(f64, Vec<f32>)], only: &'a [f32], height_mm: f64) -> (&'a [f32], &'a [f32], f32) {
    let (Some(first), Some(last)) = (tables.first(), tables.last()) else { return (only, only, 0.0) };
    if height_mm >= last.0 {
        return (&last.1, &last.1, 0.0);
    }
    let right = tables.partition_point(|table| table.0 <= height_mm);
    let Some(left) = right.checked_sub(1).map(|left| &tables[left]) else { return (&first.1, &first.1, 0.0) };
    let next = &tables[right];
    (&left.1, &next.1, ((height_mm - left.0) / (next.0 - left.0)) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close_up(object_distance_mm: f64) -> IdealLens {
        IdealLens { object_distance_mm: Some(object_distance_mm), ..IdealLens::new(3.862_755, 4.0) }
    }

    #[test]
    fn the_camera_equation_matches_isetcam() {
        // Printed by ISETCam, to six digits, for its default focal length.
        assert!((close_up(1200.0).axial_solid_angle_sr() - 0.048_026_3).abs() < 5e-8);
        assert!((close_up(50.0).axial_solid_angle_sr() - 0.041_247_1).abs() < 5e-8);
    }

    #[test]
    fn an_infinitely_fast_pupil_would_see_the_hemisphere() {
        // As N -> 0 a uniform field gives E = pi L.
        assert!((IdealLens::new(5.0, 1e-6).axial_solid_angle_sr() - PI).abs() < 1e-9);
    }

    #[test]
    fn a_uniform_field_falls_off_by_the_fourth_power_of_the_cosine() {
        let grid = WavelengthGrid::uniform(400.0, 700.0, 10.0).unwrap();
        let mut radiance = SpectralImage::<Radiance>::zeros(grid, 101, 51);
        radiance.data_mut().fill(2.0);
        let lens = IdealLens { transmittance: Curve::constant(0.5), ..IdealLens::new(4.0, 2.0) };
        let film_width_mm = lens.film_width_mm(60.0);
        let image = lens.form_image(&radiance, film_width_mm);
        let axis = f64::from(image.pixel(25, 50)[7]);
        assert!((axis - PI / 17.0).abs() < 1e-6 * axis);
        assert!((axis - lens.axial_irradiance(&radiance.mean_spectrum())[7]).abs() < 1e-6 * axis);
        // The center of the last column lies half a pixel inside the field of 30 degrees to each side.
        let x_mm: f64 = film_width_mm * (0.5 - 0.5 / 101.0);
        let cosine = 4.0 / (4.0f64).hypot(x_mm);
        let edge = f64::from(image.pixel(25, 100)[7]);
        assert!((edge / axis - cosine.powi(4)).abs() < 1e-6);
        let flat = IdealLens { vignetting: Vignetting::None, ..lens };
        let image = flat.form_image(&radiance, film_width_mm);
        assert!(image.data().iter().all(|&e| e == image.data()[0]));
    }

    #[test]
    fn falloff_follows_isetcam_over_a_wide_field() {
        // Illuminance of its uniform scene over 80 degrees at f/4 and f = 3.86276 mm, height in um against lux. It uses
        // the exact integral over the aperture, loses light to a dark border by diffraction and samples every 12.7 um:
        // together below 1e-3 inside of the border.
        let lens = IdealLens::new(3.862_76, 4.0);
        for (height_um, lux) in [
            (1022.5096, 4.194_469_9),
            (-2025.9663, 2.954_421),
            (2851.5952, 2.012_512_4),
            (-3042.1249, 1.829_919_3),
        ] {
            let ratio = lux / 4.802_577;
            let ours = lens.relative_illumination(height_um * 1e-3);
            assert!((ours - ratio).abs() < 1e-3, "{height_um} um: {ours}, ISETCam has {ratio}");
        }
    }

    #[test]
    fn filters_are_multiplied_before_they_are_averaged() {
        // Pass bands that share a 10 nm bin but no wavelength: nothing passes.
        let short = Curve::new(vec![400.0, 544.9, 545.0, 700.0], vec![1.0, 1.0, 0.0, 0.0]).unwrap();
        let long = Curve::new(vec![400.0, 545.0, 545.1, 700.0], vec![0.0, 0.0, 1.0, 1.0]).unwrap();
        let lens = IdealLens { transmittance: short.times(&long), ..IdealLens::new(4.0, 2.0) };
        let grid = WavelengthGrid::uniform(400.0, 700.0, 10.0).unwrap();
        assert!(lens.transmittance_on(&grid).values().iter().all(|t| t.abs() < 1e-12));
    }

    #[test]
    fn transmittance_may_depend_on_the_height() {
        let grid = WavelengthGrid::uniform(400.0, 700.0, 10.0).unwrap();
        let mut radiance = SpectralImage::<Radiance>::zeros(grid, 11, 1);
        radiance.data_mut().fill(1.0);
        let lens = IdealLens {
            vignetting: Vignetting::None,
            traced_solid_angle_sr: Some(0.5),
            field_transmittance: vec![(0.0, Curve::constant(1.0)), (1.0, Curve::constant(0.5))],
            ..IdealLens::new(4.0, 2.0)
        };
        // Pixels of 0.4 mm: heights 0, 0.4, 0.8, 1.2, ...
        let image = lens.form_image(&radiance, 4.4);
        let at = |col: usize| f64::from(image.pixel(0, col)[5]);
        for (col, expected) in [(5, 0.5), (6, 0.4), (4, 0.4), (7, 0.3), (8, 0.25), (0, 0.25)] {
            assert!((at(col) - expected).abs() < 1e-6, "{col}: {}", at(col));
        }
    }

    #[test]
    fn a_cone_behind_the_lens_has_the_angle_of_its_f_number() {
        // On the axis tan u' = 1 / (2 N (1 + |m|)); a Lambertian field fills sin² evenly.
        let lens = IdealLens::new(4.0, 2.0);
        let axial = lens.filter_angles(0.0, true);
        assert!((axial.largest_angle_deg() - 0.25_f64.atan().to_degrees()).abs() < 0.3);
        let rms = (0.5 * 0.0625_f64 / 1.0625).sqrt().asin().to_degrees();
        assert!((axial.rms_angle_deg() - rms).abs() < 0.3, "{} {rms}", axial.rms_angle_deg());
        let front = lens.filter_angles(2.0, false);
        assert!((front.rms_angle_deg() - 0.5_f64.atan().to_degrees()).abs() < 1e-9);
    }

    #[test]
    fn problems_name_the_field_and_the_cure() {
        let field = |lens: IdealLens| lens.validate().unwrap_err().field;
        assert_eq!(field(IdealLens::new(0.0, 4.0)), "focal_length_mm");
        assert_eq!(field(IdealLens::new(4.0, 0.1)), "f_number");
        assert_eq!(field(close_up(3.0)), "object_distance_mm");
        let percent = IdealLens { transmittance: Curve::constant(95.0), ..IdealLens::new(4.0, 4.0) };
        assert!(percent.validate().unwrap_err().to_string().contains("percent"));
        assert!(close_up(50.0).validate().is_ok());
    }
}
