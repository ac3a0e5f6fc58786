//! What lens, filters and sensor of one capture make of the spectra of a render: electrons at the samples of the film.

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use fluorspar_accel::bands::{self, WeightedSums};
use fluorspar_accel::{Lanes, Simd, Work};
use rayon::prelude::*;

use super::direct_light::group_spectrum;
use super::film_irradiance::{behind_filter, film_extent, projected_solid_angle, tan_half_width};
use crate::digest::sha256_hex;
use crate::image::{
    ChannelPlanes, ComponentImage, ComponentRows, LightPath, RelitComponent, SpectralBasis, are_finite,
};
use crate::optics::{CameraLens, FilterAutofluorescence, IdealLens};
use crate::pipeline::PipelineError;
use crate::sensor::FilmExtent;
use crate::spectral::{Curve, Transmittance, WavelengthGrid};
use crate::study::{Capture, Study};

/// Lens, filters and quantum efficiency of a capture as weights on the spectra of a render.
///
/// Every stage from the radiance to the electrons is linear, and only the image of a traced lens and the light of a
/// fluorescing filter mix pixels. So the transmittance behind a lens, `T` (for each shape of light within
/// a band, and at heights on the film where filters see other angles), and the weights of the sensor, `w`, join to one weight
/// per band and channel, `Omega T w`, and spectra are read once.
pub struct FilmResponse {
    size: [usize; 2],
    film: FilmExtent,
    grid: WavelengthGrid,
    simd: Simd,
    /// Weights of the sensor, by channel.
    sensor: Vec<Vec<f64>>,
    /// Number of the shape of each component.
    shape_of: Vec<usize>,
    shapes: Vec<ShapeWeights>,
    /// Heights on the film, mm, of the tables of each shape.
    heights_mm: Vec<f64>,
    lens: IdealLens,
    spread: Option<Spread>,
    veil: Option<Veil>,
    /// `[row][col]`, when first asked for.
    places: OnceLock<Vec<HeightPlace>>,
    digest: String,
}

/// Weights for light of one shape within the bands.
struct ShapeWeights {
    /// By height on the film: `[channel * bands + band]`, e-/s per W/(sr m² nm).
    tables: Vec<Vec<f64>>,
    /// The same in single precision, as spectra are.
    single: Vec<Vec<f32>>,
    /// Transmittance of the viewing filters, for their own light.
    passed: Vec<f64>,
}

/// Weights on coefficients by height on the film, `[channel][coefficient]` each.
type HeightTables = Vec<Vec<f32>>;

/// The image of a traced lens through which the render did not go.
struct Spread {
    lens: Arc<CameraLens>,
    tan_half_width: f64,
}

/// Light of a fluorescing filter.
struct Veil {
    own: FilterAutofluorescence,
    /// Projected solid angle of the field, sr.
    field_sr: f64,
    /// Transmittance of the lens for it, by band.
    glass: Vec<f64>,
}

/// What one row of a component gives.
struct RowResponse {
    /// `[slice][col]`: channels or, in front of a traced lens, channels for each height and group of bands.
    slices: Vec<f32>,
    /// Sums of the bands over the row, for a fluorescing filter.
    band_sums: Vec<f64>,
}

/// Values that one batch of components may take while a traced lens images them.
const BATCH_VALUES: usize = 1 << 26;

impl FilmResponse {
    /// The response of a capture of a study. Of the component image only the labels count; it may be without values.
    ///
    /// # Errors
    /// A study without lens or sensor.
    pub fn new(study: &Study, capture: &Capture, components: &ComponentImage) -> Result<Self, PipelineError> {
        let lens = study.camera.lens_behind_filters().ok_or(PipelineError::Missing("lens"))?;
        let sensor = study.camera.sensor.as_ref().ok_or(PipelineError::Missing("sensor"))?;
        let film = film_extent(study, components, &lens);
        let lens = behind_filter(&lens, capture).into_owned();
        let grid = components.grid.clone();
        let weights = sensor.film_weights(&grid);
        // Find the different shapes of light within a band: even fluorescence, and reflected light by its source
        let mut curves: Vec<Option<Curve>> = vec![None];
        let mut shape_of = Vec::with_capacity(components.components.len());
        for component in &components.components {
            let is_reflected = component.light == LightPath::Reflected;
            let shape = if is_reflected { group_spectrum(study, &component.light_group) } else { None };
            let known = curves.iter().position(|curve| *curve == shape);
            shape_of.push(known.unwrap_or_else(|| {
                curves.push(shape);
                curves.len() - 1
            }));
        }
        let heights_mm = lens.transmittances_under(&grid, None).into_iter().map(|(mm, _)| mm).collect();
        let shape = |curve: &Option<Curve>| ShapeWeights::new(study, &lens, curve.as_ref(), &grid, &weights);
        let shapes = curves.iter().map(shape).collect();
        let half_width = tan_half_width(study, components);
        let traced = study.camera.traced_lens().filter(|_| study.scene.camera.lens.is_none());
        let own = study.camera.view_filter.stack.autofluorescence.clone();
        let glass = study.camera.lens_before_filters().bin_averages(&grid);
        let half_height = half_width * components.height as f64 / components.width as f64;
        let mut response = Self {
            size: [components.width, components.height],
            film,
            sensor: weights,
            shape_of,
            shapes,
            heights_mm,
            spread: traced.map(|lens| Spread { lens: lens.clone(), tan_half_width: half_width }),
            veil: own.map(|own| Veil {
                own,
                field_sr: projected_solid_angle(half_width, half_height),
                glass,
            }),
            grid,
            simd: Simd::detect(),
            lens,
            places: OnceLock::new(),
            digest: String::new(),
        };
        response.digest = response.digest();
        Ok(response)
    }

    /// Digest of everything that the planes depend on, besides the radiance.
    pub fn camera(&self) -> &str {
        &self.digest
    }

    /// Whether the planes at a pixel depend on the radiance of that pixel alone: not behind a traced lens through which the
    /// render did not go, and not behind a fluorescing filter.
    pub fn is_local(&self) -> bool {
        self.spread.is_none() && self.veil.is_none()
    }

    /// Extent of the image on the film.
    pub fn film(&self) -> FilmExtent {
        self.film
    }

    /// The planes of several captures from one pass over the spectra of the components that are `wanted`; those of others stay
    /// dark.
    ///
    /// # Errors
    /// Rows that can't be read.
    pub fn planes<R: ComponentRows>(
        responses: &[&Self],
        wanted: impl Fn(usize) -> bool + Sync,
        rows: &R,
    ) -> Result<Vec<ChannelPlanes>, R::Error> {
        let mut planes: Vec<ChannelPlanes> = responses.iter().map(|response| response.dark()).collect();
        let components = planes.first().map_or(0, |planes| planes.components);
        let most = responses.iter().map(|response| response.values_per_component()).max().unwrap_or(0);
        let batch = (BATCH_VALUES / most.max(1)).clamp(1, components.max(1));
        // Weights of the coefficients of components with a basis, `[response][component]`
        let short: Vec<Vec<Option<HeightTables>>> = responses
            .iter()
            .map(|response| {
                (0..components).map(|component| response.on_basis(component, rows.basis(component))).collect()
            })
            .collect();
        for first in (0..components).step_by(batch) {
            let batch = first..(first + batch).min(components);
            let found = rows.map_rows(
                |component| batch.contains(&component) && wanted(component),
                |component, row, lines| {
                    let is_finite = are_finite(lines);
                    let of = |(response, short): (&&Self, &Vec<Option<HeightTables>>)| match &short[component]
                    {
                        Some(tables) if is_finite => RowResponse {
                            slices: response.row_behind_lens(row, tables, lines),
                            band_sums: Vec::new(),
                        },
                        _ => match rows.basis(component) {
                            Some(basis) => {
                                response.row(component, row, &basis.lines(lines, response.size[0]))
                            }
                            None => response.row(component, row, lines),
                        },
                    };
                    responses.iter().zip(&short).map(of).collect::<Vec<_>>()
                },
            )?;
            for (number, (response, planes)) in responses.iter().zip(&mut planes).enumerate() {
                let rows = || found.iter().map(|(component, row, of)| (*component, *row, &of[number]));
                match &response.spread {
                    None => response.place_rows(rows(), planes),
                    Some(spread) => response.image_rows(spread, batch.clone(), rows(), planes),
                }
                response.add_veils(batch.clone(), rows(), planes);
            }
        }
        Ok(planes)
    }

    /// Weights on the coefficients of a component with a basis, by height on the film; `None` where all bands are needed one by one.
    fn on_basis(&self, component: usize, basis: Option<&SpectralBasis>) -> Option<HeightTables> {
        let basis = basis.filter(|_| self.is_local())?;
        let tables = &self.shapes[self.shape_of[component]].tables;
        Some(tables.iter().map(|table| single(&basis.through(table))).collect())
    }

    /// Puts a component under another light into planes: its few spectra pass lens, filters and sensor once, and pixels are sums of what
    /// comes of them. Only for responses that are local ([`Self::is_local`]).
    pub fn place_relit(&self, component: usize, relit: &RelitComponent<'_>, planes: &mut ChannelPlanes) {
        if relit.is_dark() {
            return;
        }
        let width = self.size[0];
        let tables = &self.shapes[self.shape_of[component]].tables;
        let seen = |table: &Vec<f64>| single(&relit.through(table, self.grid.len()));
        let seen: Vec<Vec<f32>> = tables.iter().map(seen).collect();
        let rows: Vec<Vec<f32>> = (0..self.size[1])
            .into_par_iter()
            .map(|row| self.row_behind_lens(row, &seen, &relit.factor_lines(row, width)))
            .collect();
        for (row, slices) in rows.iter().enumerate() {
            for (channel, values) in slices.chunks_exact(width).enumerate() {
                planes.plane_mut(component, channel)[row * width..][..width].copy_from_slice(values);
            }
        }
    }

    /// Planes of this camera without light.
    pub fn dark(&self) -> ChannelPlanes {
        ChannelPlanes::dark(self.size, self.shape_of.len(), self.sensor.len(), self.digest.clone())
    }

    /// Values that a component takes while it is imaged.
    fn values_per_component(&self) -> usize {
        self.spread.as_ref().map_or(0, |_| self.size[0] * self.size[1] * self.slices())
    }

    /// Values of a row for each column.
    fn slices(&self) -> usize {
        match &self.spread {
            None => self.sensor.len(),
            Some(spread) => spread.lens.groups().len() * self.heights_mm.len() * self.sensor.len(),
        }
    }

    /// One row of a component, `[band][col]`.
    fn row(&self, component: usize, row: usize, lines: &[f32]) -> RowResponse {
        let width = self.size[0];
        let tables = &self.shapes[self.shape_of[component]].single;
        let slices = match &self.spread {
            None => self.row_behind_lens(row, tables, lines),
            Some(spread) => {
                let mut sums = vec![0.0; self.slices() * width];
                let mut parts = sums.chunks_exact_mut(self.sensor.len() * width);
                for (bands, _) in spread.lens.groups() {
                    for (weights, sums) in tables.iter().zip(&mut parts) {
                        let mut tables = [WeightedSums { weights, sums }];
                        self.add_bands((lines, bands, &(0..width)), &mut tables);
                    }
                }
                sums.into_iter().map(|sum| sum as f32).collect()
            }
        };
        let band_sum = |line: &[f32]| line.iter().map(|value| f64::from(*value)).sum();
        let band_sums = match self.veil {
            Some(_) => lines.chunks_exact(width).map(band_sum).collect(),
            None => Vec::new(),
        };
        RowResponse { slices, band_sums }
    }

    /// Adds a range of the bands of lines, `[band][col]`, times their weights in some columns.
    fn add_bands(
        &self,
        (lines, bands, columns): (&[f32], &Range<usize>, &Range<usize>),
        tables: &mut [WeightedSums<'_>],
    ) {
        self.simd.run(Contraction { lines, width: self.size[0], bands, columns, tables });
    }

    /// Channels of a row, `[channel][col]`, with transmittance by height and the falloff of the lens.
    fn row_behind_lens(&self, row: usize, tables: &[Vec<f32>], lines: &[f32]) -> Vec<f32> {
        let width = self.size[0];
        let (channels, bands) = (self.sensor.len(), 0..lines.len() / width.max(1));
        let places = &self.places()[row * width..][..width];
        let mut sums = vec![0.0; channels * width];
        let mut right = sums.clone();
        // Columns between the same two heights share their tables
        for run in places.chunk_by(|a, b| a.left == b.left) {
            let first = run[0].col;
            let columns = first..first + run.len();
            let of = (lines, &bands, &columns);
            let left = &tables[run[0].left];
            if run.iter().all(|place| place.part == 0.0) {
                self.add_bands(of, &mut [WeightedSums { weights: left, sums: &mut sums }]);
            } else {
                let between = [(left, &mut sums), (&tables[run[0].left + 1], &mut right)];
                self.add_bands(of, &mut between.map(|(weights, sums)| WeightedSums { weights, sums }));
                for place in run {
                    for channel in 0..channels {
                        let at = channel * width + place.col;
                        sums[at] += place.part * (right[at] - sums[at]);
                    }
                }
            }
        }
        let falloffs = places.iter().map(|place| place.falloff).cycle();
        sums.into_iter().zip(falloffs).map(|(sum, falloff)| (sum * falloff) as f32).collect()
    }

    /// Where the samples of the film lie between the heights of the tables, `[row][col]`.
    fn places(&self) -> &[HeightPlace] {
        let [width, height] = self.size;
        let all = || (0..width * height).map(|pixel| self.place(pixel / width, pixel % width)).collect();
        self.places.get_or_init(all)
    }

    /// Where a sample of the film lies between the heights of the tables.
    fn place(&self, row: usize, col: usize) -> HeightPlace {
        let [width, height] = self.size;
        let pitch_mm = self.film.width_mm / width as f64;
        let x_mm = (col as f64 + 0.5 - 0.5 * width as f64) * pitch_mm;
        let y_mm = (row as f64 + 0.5 - 0.5 * height as f64) * pitch_mm;
        let height_mm = x_mm.hypot(y_mm);
        let heights = &self.heights_mm;
        let left = heights.partition_point(|mm| *mm <= height_mm).saturating_sub(1);
        let part = match heights.get(left + 1) {
            Some(next) => ((height_mm - heights[left]) / (next - heights[left])).max(0.0),
            None => 0.0,
        };
        HeightPlace { col, left, part, falloff: self.lens.relative_illumination(height_mm) }
    }

    /// Puts rows into planes.
    fn place_rows<'a>(
        &self,
        rows: impl Iterator<Item = (usize, usize, &'a RowResponse)>,
        planes: &mut ChannelPlanes,
    ) {
        let width = self.size[0];
        for (component, row, response) in rows {
            for (channel, values) in response.slices.chunks_exact(width).enumerate() {
                planes.plane_mut(component, channel)[row * width..][..width].copy_from_slice(values);
            }
        }
    }

    /// Lets a traced lens image the rows of a batch of components, and puts them into planes.
    fn image_rows<'a>(
        &self,
        spread: &Spread,
        batch: Range<usize>,
        rows: impl Iterator<Item = (usize, usize, &'a RowResponse)> + Clone,
        planes: &mut ChannelPlanes,
    ) {
        let ([width, height], channels) = (self.size, self.sensor.len());
        // Values of a component in one group of bands: channels for each height.
        let own = self.heights_mm.len() * channels;
        let values = batch.len() * own;
        for group in 0..spread.lens.groups().len() {
            let mut seen = vec![0.0; width * height * values];
            for (component, row, response) in rows.clone() {
                let slices = &response.slices[group * own * width..][..own * width];
                for (slice, line) in slices.chunks_exact(width).enumerate() {
                    let value = (component - batch.start) * own + slice;
                    for (col, sample) in line.iter().enumerate() {
                        seen[(row * width + col) * values + value] = *sample;
                    }
                }
            }
            let imaged = spread.lens.lens_values(group, &seen, self.size, spread.tan_half_width);
            let places = self.places();
            for component in batch.clone() {
                for channel in 0..channels {
                    let plane = planes.plane_mut(component, channel);
                    for (pixel, (rate, place)) in plane.iter_mut().zip(places).enumerate() {
                        let of = &imaged[pixel * values + (component - batch.start) * own..][..own];
                        let (left, right) = place.tables(of, channels);
                        let between = left[channel] + place.part as f32 * (right[channel] - left[channel]);
                        *rate += between * place.falloff as f32;
                    }
                }
            }
        }
    }

    /// Adds the light of a fluorescing filter, which is even over the film.
    fn add_veils<'a>(
        &self,
        batch: Range<usize>,
        rows: impl Iterator<Item = (usize, usize, &'a RowResponse)> + Clone,
        planes: &mut ChannelPlanes,
    ) {
        let Some(veil) = &self.veil else { return };
        let pixels = (self.size[0] * self.size[1]) as f64;
        for component in batch {
            let mut arriving = vec![0.0; self.grid.len()];
            for (_, _, response) in rows.clone().filter(|(of, ..)| *of == component) {
                arriving.iter_mut().zip(&response.band_sums).for_each(|(sum, value)| *sum += value);
            }
            arriving.iter_mut().for_each(|sum| *sum *= veil.field_sr / pixels);
            let passed = &self.shapes[self.shape_of[component]].passed;
            let radiance = veil.own.veil_radiance(&arriving, passed, &self.grid);
            for (channel, weights) in self.sensor.iter().enumerate() {
                let light = radiance.values().iter().zip(&veil.glass).map(|(l, t)| l * t);
                let rate: f64 = weights.iter().zip(light).map(|(w, l)| w * l).sum();
                let rate = (self.lens.axial_solid_angle_sr() * rate) as f32;
                planes.plane_mut(component, channel).iter_mut().for_each(|value| *value += rate);
            }
        }
    }

    fn digest(&self) -> String {
        let bits =
            |values: &[f64]| values.iter().flat_map(|v| v.to_bits().to_le_bytes()).collect::<Vec<u8>>();
        let [width, height] = self.size;
        let lens = &self.lens;
        let mut blocks = vec![
            format!(
                "{width} {height} {:?} {:?} {:?} {:?}",
                self.film,
                self.shape_of,
                lens.vignetting,
                (lens.image_distance_mm(), lens.axial_solid_angle_sr())
            )
            .into_bytes(),
            bits(self.grid.edges_nm()),
            bits(&self.heights_mm),
        ];
        blocks.extend(self.sensor.iter().map(|weights| bits(weights)));
        for shape in &self.shapes {
            blocks.extend(shape.tables.iter().map(|table| bits(table)));
            blocks.push(bits(&shape.passed));
        }
        if let Some(Spread { lens, tan_half_width }) = &self.spread {
            let film = (lens.film_width_mm(), lens.film_height_mm(), lens.groups().len());
            blocks.push(format!("{:?} {film:?} {tan_half_width:?}", lens.state()).into_bytes());
        }
        if let Some(Veil { own, field_sr, glass }) = &self.veil {
            blocks.push(format!("{own:?} {field_sr:?} {glass:?}").into_bytes());
        }
        sha256_hex(blocks)
    }
}

impl ShapeWeights {
    fn new(
        study: &Study,
        lens: &IdealLens,
        shape: Option<&Curve>,
        grid: &WavelengthGrid,
        sensor: &[Vec<f64>],
    ) -> Self {
        let solid_angle = lens.axial_solid_angle_sr();
        let table = |passed: &[f64]| -> Vec<f64> {
            sensor.iter().flat_map(|w| w.iter().zip(passed).map(|(w, t)| solid_angle * w * t)).collect()
        };
        let tables = lens.transmittances_under(grid, shape);
        let filter = &study.camera.view_filter.transmittance;
        let passed = match shape {
            Some(shape) => filter.on_grid_under::<Transmittance>(grid, shape),
            None => filter.on_grid(grid),
        };
        let tables: Vec<Vec<f64>> = tables.iter().map(|(_, passed)| table(passed.values())).collect();
        let single = tables.iter().map(|table| single(table)).collect();
        Self { tables, single, passed: passed.values().to_vec() }
    }
}

/// Weights in single precision.
fn single(weights: &[f64]) -> Vec<f32> {
    weights.iter().map(|weight| *weight as f32).collect()
}

/// The sum of lines of equal wavelength times weights.
struct Contraction<'a, 'b> {
    /// `[band][col]`.
    lines: &'a [f32],
    width: usize,
    bands: &'a Range<usize>,
    columns: &'a Range<usize>,
    tables: &'a mut [WeightedSums<'b>],
}

impl Work for Contraction<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        bands::add_weighted(lanes, (self.lines, self.width), self.bands, self.columns, self.tables);
    }
}

/// A film sample between two heights.
#[derive(Clone, Copy)]
struct HeightPlace {
    col: usize,
    /// Number of the height below.
    left: usize,
    /// Share of the way to the next height.
    part: f64,
    falloff: f64,
}

impl HeightPlace {
    /// Channels at the heights on both sides.
    fn tables<'a>(&self, values: &'a [f32], channels: usize) -> (&'a [f32], &'a [f32]) {
        let left = &values[self.left * channels..][..channels];
        (
            left,
            values
                .get((self.left + 1) * channels..)
                .map_or(left, |rest| rest.get(..channels).unwrap_or(left)),
        )
    }
}
