//! Which pixels are read, and which of them together.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{SensorModel, SensorProblem};
use crate::image::Mosaic;

/// How pixels are joined.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BinningKind {
    /// Electrons are added before they are read: one read noise.
    Charge,
    /// Digital numbers are added: a read noise for each pixel.
    DigitalSum,
    /// Digital numbers are averaged and rounded.
    DigitalAverage,
}

/// Joining of neighboring pixels of one color (physical and noise-free mode only).
///
/// Pixels of the same place in the repeating cells of the color filter array are joined, so that the result has the
/// same array. Numbers of rows and columns must be multiples of the cell times the binning.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Binning {
    /// Charge, digital_sum or digital_average.
    #[serde(rename = "type")]
    pub kind: BinningKind,
    /// Columns that are joined, 1 to 16.
    pub columns: usize,
    /// Rows that are joined, 1 to 16.
    pub rows: usize,
    /// Electrons that the node holds on which charges are added (charge binning). Default: as many as the pixels do.
    pub well_capacity_e: Option<f64>,
}

impl Binning {
    /// Pixels that are joined.
    pub fn pixels(&self) -> usize {
        self.columns * self.rows
    }
}

/// The part of the sensor that is read, in pixels of the sensor, and what comes out.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Readout {
    pub(super) first_column: usize,
    pub(super) first_row: usize,
    /// Columns of the raw image.
    pub(super) columns: usize,
    /// Rows of the raw image.
    pub(super) rows: usize,
    pub(super) binning: Option<Binning>,
    /// Repeating cell of the sensor: rows and columns.
    cell: [usize; 2],
}

impl Readout {
    pub(super) fn of(model: &SensorModel) -> Result<Self, SensorProblem> {
        let cell = [model.mosaic.len(), model.mosaic.first().map_or(0, Vec::len)];
        let whole = [0, 0, model.columns, model.rows];
        let [first_column, first_row, width, height] = model.region_px.unwrap_or(whole);
        let fits = |first: usize, count: usize, all: usize| {
            count > 0 && first.checked_add(count).is_some_and(|end| end <= all)
        };
        // Check the region
        if !fits(first_column, width, model.columns) || !fits(first_row, height, model.rows) {
            let message = format!(
                "column {first_column}, row {first_row}, width {width} and height {height} are not inside the {} x {} \
                 pixels of the sensor",
                model.columns, model.rows
            );
            return Err(SensorProblem::new("region_px", message));
        }
        let (mut columns, mut rows) = (width, height);
        if let Some(binning) = &model.binning {
            // Check the binning against region, mosaic and number range
            for (field, joined) in [("columns", binning.columns), ("rows", binning.rows)] {
                if !(1..=16).contains(&joined) {
                    let message =
                        format!("{joined} is outside 1 to 16; give the number of pixels that are joined");
                    return Err(SensorProblem::new(format!("binning.{field}"), message));
                }
            }
            if let Some(well) = binning.well_capacity_e {
                if binning.kind != BinningKind::Charge {
                    let message = "only charge binning adds electrons; remove it or set type = \"charge\"";
                    return Err(SensorProblem::new("binning.well_capacity_e", message));
                }
                let (field, range) = ("binning.well_capacity_e", [1.0, 1e9]);
                SensorProblem::unless_within(field, well, range, "give electrons")?;
            }
            for (field, first, count, step) in [
                ("columns", first_column, width, binning.columns * cell[1]),
                ("rows", first_row, height, binning.rows * cell[0]),
            ] {
                if first % step != 0 || count % step != 0 {
                    let message = format!(
                        "{count} {field} from {} {first} do not divide into blocks of {step} (mosaic cell times binning); make \
                         the start and the size of region_px multiples of {step}",
                        field.trim_end_matches('s')
                    );
                    return Err(SensorProblem::new(format!("binning.{field}"), message));
                }
            }
            let largest = usize::from(model.max_code()) * binning.pixels();
            if binning.kind == BinningKind::DigitalSum && largest > usize::from(u16::MAX) {
                let message = format!(
                    "the sum of {} pixels of {} bits does not fit into 16 bits; use \"digital_average\" or fewer pixels",
                    binning.pixels(),
                    model.bit_depth
                );
                return Err(SensorProblem::new("binning.type", message));
            }
            (columns, rows) = (width / binning.columns, height / binning.rows);
        }
        Ok(Self { first_column, first_row, columns, rows, binning: model.binning, cell })
    }

    /// Pixels along one axis that make up one pixel of the raw image, as first and step.
    fn members(&self, axis: usize, index: usize) -> (usize, usize) {
        let (cell, first) = (self.cell[axis], [self.first_row, self.first_column][axis]);
        let joined = self.binning.map_or(1, |b| [b.rows, b.columns][axis]);
        (first + index / cell * cell * joined + index % cell, cell)
    }

    /// Rows of the sensor that make up a row of the raw image.
    pub(super) fn rows_of(&self, row: usize) -> impl Iterator<Item = usize> + use<> {
        let (first, step) = self.members(0, row);
        (0..self.binning.map_or(1, |b| b.rows)).map(move |k| first + k * step)
    }

    /// Columns of the sensor that make up a column of the raw image.
    pub(super) fn columns_of(&self, column: usize) -> impl Iterator<Item = usize> + use<> {
        let (first, step) = self.members(1, column);
        (0..self.binning.map_or(1, |b| b.columns)).map(move |k| first + k * step)
    }

    /// The color filter array as the raw image begins with it.
    pub(super) fn mosaic(&self, of_sensor: &Mosaic) -> Mosaic {
        // A binned region begins with a whole cell, so only the offset of the region turns the array.
        let (rows, cols) = (of_sensor.rows, of_sensor.cols);
        let at = |i: usize| of_sensor.channel(self.first_row + i / cols, self.first_column + i % cols) as u8;
        Mosaic { pattern: (0..rows * cols).map(at).collect(), ..of_sensor.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_stay_apart_when_pixels_are_joined() {
        let binning = Binning { kind: BinningKind::Charge, columns: 2, rows: 2, well_capacity_e: None };
        let model = SensorModel { columns: 8, rows: 8, binning: Some(binning), ..SensorModel::default() };
        let readout = Readout::of(&model).unwrap();
        assert_eq!((readout.columns, readout.rows), (4, 4));
        let columns = |c| readout.columns_of(c).collect::<Vec<_>>();
        assert_eq!([columns(0), columns(1), columns(2), columns(3)], [[0, 2], [1, 3], [4, 6], [5, 7]]);
        let mono = SensorModel { mosaic: vec![vec!["mono".into()]], ..model };
        let readout = Readout::of(&mono).unwrap();
        assert_eq!(readout.rows_of(3).collect::<Vec<_>>(), [6, 7]);
    }

    #[test]
    fn a_region_begins_with_the_color_that_lies_there() {
        let model = SensorModel { region_px: Some([3, 1, 5, 4]), ..SensorModel::default() };
        let readout = Readout::of(&model).unwrap();
        let grbg = Mosaic::bayer("grbg").unwrap();
        assert_eq!(readout.mosaic(&grbg), Mosaic::bayer("gbrg").unwrap());
        assert_eq!(readout.rows_of(2).collect::<Vec<_>>(), [3]);
        assert_eq!((readout.columns, readout.rows), (5, 4));
    }

    #[test]
    fn problems_name_the_field() {
        let field = |model: SensorModel| Readout::of(&model).unwrap_err().field;
        let base = SensorModel::default;
        let joined = |columns, rows, kind| Some(Binning { kind, columns, rows, well_capacity_e: None });
        assert_eq!(field(SensorModel { region_px: Some([1000, 0, 281, 2]), ..base() }), "region_px");
        assert_eq!(field(SensorModel { region_px: Some([0, 0, 0, 2]), ..base() }), "region_px");
        assert_eq!(field(SensorModel { region_px: Some([usize::MAX, 0, 2, 2]), ..base() }), "region_px");
        assert_eq!(
            field(SensorModel { binning: joined(3, 1, BinningKind::Charge), ..base() }),
            "binning.columns"
        );
        assert_eq!(
            field(SensorModel { binning: joined(1, 0, BinningKind::Charge), ..base() }),
            "binning.rows"
        );
        assert_eq!(
            field(SensorModel { binning: joined(8, 5, BinningKind::DigitalSum), ..base() }),
            "binning.type"
        );
    }
}
