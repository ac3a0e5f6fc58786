//! Fall-off of light toward the corners that belongs to the sensor: microlenses, angles of the chief rays.

use super::{SensorModel, SensorProblem};
use crate::image::Mosaic;
use crate::units::number_text;

/// Key of coefficients that hold for every channel.
const ALL: &str = "all";

/// Coefficients for each channel of a mosaic.
pub(super) struct RelativeIllumination {
    /// By channel; empty for channels without fall-off.
    coefficients: Vec<Vec<f64>>,
    columns: usize,
    rows: usize,
}

/// `1 + a1 x + a2 x² + ...`
fn polynomial(coefficients: &[f64], x: f64) -> f64 {
    1.0 + x * coefficients.iter().rev().fold(0.0, |sum, a| sum * x + a)
}

impl RelativeIllumination {
    pub(super) fn validate(model: &SensorModel) -> Result<(), SensorProblem> {
        for (name, coefficients) in &model.relative_illumination {
            let problem = |message| Err(SensorProblem::new(format!("relative_illumination.{name}"), message));
            if name != ALL && !model.mosaic.iter().flatten().any(|channel| channel == name) {
                return problem(
                    "the mosaic has no such channel; name one of its channels, or \"all\"".into(),
                );
            }
            if coefficients.len() > 8 {
                return problem(format!("{} coefficients; give at most 8", coefficients.len()));
            }
            if let Some(a) = coefficients.iter().find(|a| !(-100.0..=100.0).contains(*a)) {
                return problem(format!("the coefficient {} is outside -100 to 100", number_text(*a)));
            }
            for step in 0..=100 {
                let value = polynomial(coefficients, f64::from(step) / 100.0);
                if !(0.0..=2.0).contains(&value) {
                    let radius = (f64::from(step) / 100.0).sqrt();
                    return problem(format!(
                        "the illumination is {value:.3} at {radius:.2} of the way to the corner; it must stay within 0 to 2"
                    ));
                }
            }
        }
        Ok(())
    }

    /// `None` where there is no fall-off.
    pub(super) fn of(model: &SensorModel, mosaic: &Mosaic) -> Option<Self> {
        let given = &model.relative_illumination;
        let of = |name: &String| given.get(name).or_else(|| given.get(ALL)).cloned().unwrap_or_default();
        let coefficients: Vec<Vec<f64>> = mosaic.channels.iter().map(of).collect();
        let any = coefficients.iter().flatten().any(|a| *a != 0.0);
        any.then_some(Self { coefficients, columns: model.columns, rows: model.rows })
    }

    /// Multiplies the rates of one row.
    pub(super) fn apply(&self, mosaic: &Mosaic, row: usize, rates: &mut [f32]) {
        let from_center = |index: usize, count: usize| index as f64 + 0.5 - 0.5 * count as f64;
        let corner2 = 0.25 * ((self.columns * self.columns + self.rows * self.rows) as f64);
        let down2 = from_center(row, self.rows).powi(2);
        for (col, rate) in rates.iter_mut().enumerate() {
            let x = (down2 + from_center(col, self.columns).powi(2)) / corner2;
            *rate *= polynomial(&self.coefficients[mosaic.channel(row, col)], x) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model(name: &str, coefficients: &[f64]) -> SensorModel {
        let relative_illumination = [(name.to_string(), coefficients.to_vec())].into();
        SensorModel { columns: 400, rows: 300, relative_illumination, ..SensorModel::default() }
    }

    #[test]
    fn light_falls_off_by_channel() {
        let mosaic = Mosaic::bayer("grbg").unwrap();
        let falloff = RelativeIllumination::of(&model("R", &[-0.4, 0.1]), &mosaic).unwrap();
        let mut rates = vec![100.0; 400];
        falloff.apply(&mosaic, 0, &mut rates);
        // Column 399 of row 0 is red, half a pixel from the corner; its neighbor is green.
        let x = (149.5f64.powi(2) + 199.5f64.powi(2)) / 62_500.0;
        assert!((f64::from(rates[399]) - 100.0 * (1.0 - 0.4 * x + 0.1 * x * x)).abs() < 1e-4);
        assert_eq!(rates[398], 100.0);
        assert!(RelativeIllumination::of(&model("R", &[0.0]), &mosaic).is_none());
    }

    #[test]
    fn problems_name_the_channel() {
        let field = |model: SensorModel| RelativeIllumination::validate(&model).unwrap_err().field;
        assert!(RelativeIllumination::validate(&model("all", &[-0.5])).is_ok());
        assert_eq!(field(model("NIR", &[-0.5])), "relative_illumination.NIR");
        assert_eq!(field(model("all", &[-1.5])), "relative_illumination.all");
        assert_eq!(field(model("all", &[f64::NAN])), "relative_illumination.all");
    }
}
