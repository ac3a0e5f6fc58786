//! Cameras of known parameters are simulated, and calibrated from their frames alone.

use statrs::distribution::{Binomial, DiscreteCDF};

use super::*;
use crate::image::{Mosaic, SensorImage};
use crate::spectral::Curve;

const SIDE: [usize; 2] = [50, 42];

/// A simulated camera.
struct Camera {
    sensor: Sensor,
    /// Shading of its lens.
    shading: [f64; 2],
    /// Tilt of the light.
    tilt: f64,
    /// Electrons per second on the axis, by channel.
    light: Vec<f64>,
    /// Exposure times of the flats, s.
    times_s: Vec<f64>,
    frames: u64,
}

/// A number from 0 to 1 that a camera and a parameter have.
fn drawn(camera: u64, parameter: u64) -> f64 {
    let mixed = (camera * 64 + parameter + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let mixed = (mixed ^ (mixed >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    ((mixed ^ (mixed >> 32)) >> 11) as f64 / (1u64 << 53) as f64
}

impl Camera {
    fn drawn(number: u64) -> Self {
        let of = |parameter, low: f64, high: f64| low * (high / low).powf(drawn(number, parameter));
        let is_color = number.is_multiple_of(2);
        let channels = if is_color { vec!["R", "G", "B"] } else { vec!["mono"] };
        let cell = if is_color { vec![vec!["R", "G"], vec!["G", "B"]] } else { vec![vec!["mono"]] };
        // Every third camera ends with its well, the others with the converter
        let full_e = if number.is_multiple_of(3) { of(1, 3000.0, 9000.0) } else { 1e6 };
        let gain = of(0, 0.15, 0.35);
        let model = SensorModel {
            columns: SIDE[0],
            rows: SIDE[1],
            mosaic: cell.into_iter().map(|row| row.into_iter().map(String::from).collect()).collect(),
            conversion_gain_mv_per_e: Some(0.1),
            voltage_swing_v: 1e-4 * 4096.0 / gain,
            well_capacity_e: full_e,
            read_noise_e: Some(of(2, 5.0, 12.0)),
            dsnu_e: Some(of(3, 3.0, 9.0)),
            prnu_percent: of(4, 0.6, 2.0),
            dark_current_e_per_s: Some(of(5, 20.0, 200.0)),
            black_level_dn: of(6, 40.0, 90.0),
            device_seed: number + 7,
            ..SensorModel::default()
        };
        let reach_e = full_e.min((4095.0 - model.black_level_dn) / gain);
        let qe = SpectralQe::from_curves(channels.iter().map(|name| (*name, Curve::constant(0.5)))).unwrap();
        let light = (0..channels.len()).map(|c| (1.0 - 0.2 * c as f64) * reach_e / 0.1).collect();
        Self {
            sensor: Sensor::new(model, qe).unwrap(),
            shading: [-of(7, 0.1, 0.4), of(8, 0.01, 0.1)],
            tilt: 0.03,
            light,
            times_s: vec![0.008, 0.015, 0.03, 0.045, 0.06, 0.075, 0.4],
            frames: 4,
        }
    }

    fn frame(&self, series: &str, time_s: f64, frame: u64, is_lit: bool) -> SensorImage {
        let [u0, v0] = SIDE.map(|side| 0.5 * side as f64);
        let mosaic: Mosaic = self.sensor.mosaic().clone();
        let rate = |pixel: usize| {
            let (row, col) = (pixel / SIDE[0], pixel % SIDE[0]);
            let (u, v) = ((col as f64 + 0.5 - u0) / u0.hypot(v0), (row as f64 + 0.5 - v0) / u0.hypot(v0));
            let x = u * u + v * v;
            let shape = 1.0 + self.shading[0] * x + self.shading[1] * x * x + self.tilt * u;
            f64::from(u8::from(is_lit)) * self.light[mosaic.channel(row, col)] * shape
        };
        let data = (0..SIDE[0] * SIDE[1]).map(|pixel| rate(pixel) as f32).collect();
        let rate = ElectronRate { columns: SIDE[0], rows: SIDE[1], data };
        let (label, seed) = (format!("{series} {time_s}"), self.sensor.model().device_seed);
        self.sensor
            .expose_rate(&rate, &Exposure { time_s, frame, label, seed, ..Exposure::default() })
            .unwrap()
    }

    fn stack(&self, series: &str, time_s: f64, frames: u64, is_lit: bool) -> FrameStack {
        let frames =
            (0..frames).map(|frame| Ok::<_, DevelopError>(self.frame(series, time_s, frame, is_lit)));
        FrameStack::of(frames, !is_lit).unwrap()
    }

    fn flats(&self) -> Vec<FrameStack> {
        self.times_s.iter().map(|&time_s| self.stack("flat", time_s, self.frames, true)).collect()
    }

    fn darks(&self) -> Vec<FrameStack> {
        [0.008, 4.0].map(|time_s| self.stack("dark", time_s, 8, false)).to_vec()
    }

    /// What was found beside what was put in.
    fn compared(&self, found: &FrameCalibration) -> Vec<(&'static str, f64, MeasuredNumber)> {
        let model = self.sensor.model();
        let gain = model.base_dn_per_electron();
        let converter_e = (4095.0 - model.black_level_dn) / gain;
        let channel = &found.channels[0];
        let corner = 1.0 + self.shading[0] + self.shading[1];
        vec![
            ("gain", gain, found.gain_dn_per_e),
            ("dark noise", model.read_noise_electrons(), found.dark_noise_e),
            ("black level", model.black_level_dn, found.black_level_dn),
            ("dark current", model.dark_electrons_per_s(), found.dark_current_e_per_s.unwrap()),
            ("DSNU", model.dsnu_electrons(), found.dsnu_e.unwrap()),
            ("PRNU", model.prnu_percent, found.prnu_percent),
            ("full scale", converter_e.min(model.well_capacity_e), found.full_scale_e.unwrap()),
            ("linearity error", 0.0, found.linearity_error_percent.unwrap()),
            ("light", self.light[0], channel.flat_e_per_s),
            ("shading a1", self.shading[0], channel.shading[0]),
            ("shading a2", self.shading[1], channel.shading[1]),
            ("corner", corner, channel.corner),
        ]
    }
}

#[test]
fn the_parameters_of_a_hundred_cameras_lie_within_their_intervals() {
    let mut held: std::collections::BTreeMap<&str, (u64, f64)> = std::collections::BTreeMap::new();
    const CAMERAS: u64 = 100;
    for number in 0..CAMERAS {
        let camera = Camera::drawn(number);
        let found = calibrate_frames(&camera.darks(), &camera.flats()).unwrap();
        for (quantity, set, measured) in camera.compared(&found) {
            let entry = held.entry(quantity).or_default();
            entry.0 += u64::from(measured.holds(set));
            entry.1 += (measured.high - measured.low) / (2.0 * set.abs().max(1e-9)) / CAMERAS as f64;
        }
    }
    println!("{held:#?}");
    // Of 95 in the mean so few or fewer come by chance in 1 of 10 000 cases
    let least = Binomial::new(0.95, CAMERAS).unwrap().inverse_cdf(1e-4);
    for (quantity, (count, _)) in &held {
        assert!(*count >= least, "{quantity}: {count} of {CAMERAS}, at least {least}");
    }
    // Intervals that hold everything tell nothing: mean half widths over values
    for (quantity, most) in [
        ("gain", 0.02),
        ("dark noise", 0.03),
        ("dark current", 0.05),
        ("DSNU", 0.06),
        ("PRNU", 0.08),
        ("light", 0.02),
        ("full scale", 0.02),
        ("corner", 0.01),
    ] {
        assert!(held[quantity].1 < most, "{quantity}: {:?}", held[quantity]);
    }
}

#[test]
fn the_sheet_of_a_calibrated_camera_is_one_that_a_sensor_takes() {
    for number in [1, 3] {
        let camera = Camera::drawn(number);
        let found = calibrate_frames(&camera.darks(), &camera.flats()).unwrap();
        let (own, sheet) = (camera.sensor.model(), found.data_sheet(1.0));
        let model =
            sheet.applied_to(&SensorModel { mosaic: own.mosaic.clone(), ..SensorModel::default() }).unwrap();
        assert!(model.validate().is_ok());
        let pairs = [
            (own.base_dn_per_electron(), model.base_dn_per_electron()),
            (own.read_noise_electrons(), model.read_noise_electrons()),
            (own.saturation_capacity_e(1.0), model.saturation_capacity_e(1.0)),
        ];
        // Twice the widest of the intervals
        assert!(pairs.iter().all(|(set, found)| (found / set - 1.0).abs() < 0.06), "{pairs:?}");
    }
}

#[test]
fn a_target_has_its_light_wherever_it_lies() {
    let camera = Camera::drawn(10);
    let found = calibrate_frames(&camera.darks(), &camera.flats()).unwrap();
    let target = camera.stack("target", 0.03, 4, true);
    // The tilt of the light averages out over the rows of the middle, and lies within 2 % of the corner
    let gain = camera.sensor.model().base_dn_per_electron();
    for (rectangle, off) in [([15, 12, 20, 18], 0.0), ([0, 0, 10, 8], 0.02)] {
        for (channel, rate) in found.rates(&target, rectangle).into_iter().enumerate() {
            let (rate, set) = (rate.unwrap(), gain * camera.light[channel]);
            assert!(
                (rate.value / set - 1.0 + off).abs() < 0.01 + 3.0 * rate.error() / set,
                "{channel}: {rate:?} {set}"
            );
        }
    }
    let full = camera.stack("target", 0.4, 1, true);
    assert_eq!(found.rates(&full, [15, 12, 20, 18]), [None; 3]);
}

#[test]
fn single_flats_mixed_gains_and_missing_frames_are_refused() {
    let camera = Camera::drawn(4);
    let (darks, flats) = (camera.darks(), camera.flats());
    let single: Vec<FrameStack> = [0.008, 0.03].map(|s| camera.stack("flat", s, 1, true)).to_vec();
    assert_eq!(calibrate_frames(&darks, &single).unwrap_err(), CalibrationProblem::NoPair);
    assert_eq!(calibrate_frames(&darks, &flats[6..]).unwrap_err(), CalibrationProblem::NoPair);
    assert_eq!(calibrate_frames(&[], &flats).unwrap_err(), CalibrationProblem::Nothing("dark"));
    let long = CalibrationProblem::LongDarks { dark_s: 4.0, flat_s: 0.4 };
    assert_eq!(calibrate_frames(&darks[1..], &flats).unwrap_err(), long);
    let other = FrameStack { gain: 4.0, ..flats[0].clone() };
    let error = calibrate_frames(&darks, &[flats[1].clone(), other]).unwrap_err();
    assert!(error.to_string().contains("(ISO)"), "{error}");
    // Without light there is no slope
    let dark_flats = [camera.stack("capped", 0.03, 4, false)];
    assert_eq!(calibrate_frames(&darks, &dark_flats).unwrap_err(), CalibrationProblem::NoLight("G".into()));
}

#[test]
fn what_frames_leave_open_is_told() {
    let camera = Camera { tilt: 0.2, times_s: vec![0.03, 0.06], ..Camera::drawn(8) };
    let found = calibrate_frames(&camera.darks()[..1], &camera.flats()).unwrap();
    assert_eq!(
        (found.dark_current_e_per_s, found.full_scale_e, found.linearity_error_percent),
        (None, None, None)
    );
    let told = |word: &str| found.warnings.iter().any(|warning| warning.text().contains(word));
    assert!(told("dark current is not measured") && told("flat is uneven"), "{:?}", found.warnings);
    assert!(
        found.channels[0].corner.holds(1.0 + camera.shading[0] + camera.shading[1]),
        "{:?}",
        found.channels
    );
}

/// Frames from which the black level was taken, all below it cut.
fn without_black(camera: &Camera, time_s: f64, frames: u64, is_lit: bool) -> FrameStack {
    let black = camera.sensor.model().black_level_dn.floor() as u16;
    let cut = |frame| {
        let mut image = camera.frame("cut", time_s, frame, is_lit);
        image.data.iter_mut().for_each(|dn| *dn = dn.saturating_sub(black));
        image.black_level = 0.0;
        Ok::<_, DevelopError>(image)
    };
    FrameStack::of((0..frames).map(cut), !is_lit).unwrap()
}

#[test]
fn dark_frames_that_are_cut_or_single_leave_the_noise_to_the_flats() {
    let camera = Camera::drawn(4);
    let lit: Vec<FrameStack> = camera.times_s.iter().map(|&s| without_black(&camera, s, 8, true)).collect();
    let found = calibrate_frames(&[without_black(&camera, 0.008, 8, false)], &lit).unwrap();
    assert_eq!(found.dsnu_e, None);
    assert!(
        found.warnings.iter().any(|warning| warning.text().contains("are 0 and cut")),
        "{:?}",
        found.warnings
    );
    let single: Vec<FrameStack> = [0.008, 4.0].map(|s| camera.stack("dark", s, 1, false)).to_vec();
    let alone = calibrate_frames(&single, &camera.flats()).unwrap();
    let model = camera.sensor.model();
    for noise in [found.dark_noise_e, alone.dark_noise_e] {
        let off = noise.value - model.read_noise_electrons();
        assert!(off.abs() < 3.0 * noise.error() && noise.error() < 3.0, "{noise:?}");
    }
    let dsnu = alone.dsnu_e.unwrap();
    assert!((dsnu.value - model.dsnu_electrons()).abs() < 3.0 * dsnu.error().max(0.5), "{dsnu:?}");
}

#[test]
fn light_that_flickers_and_frames_that_are_developed_are_told() {
    let mut camera = Camera { times_s: vec![0.008, 0.03, 0.06], ..Camera::drawn(5) };
    let steady = calibrate_frames(&camera.darks(), &camera.flats()).unwrap();
    // A lamp that warms up
    let levels = [1.15, 1.0, 0.95, 0.95];
    let flats = camera.times_s.clone().into_iter().map(|time_s| {
        let frames = levels.iter().enumerate().map(|(frame, level)| {
            camera.light[0] *= level;
            let image = camera.frame("flicker", time_s, frame as u64, true);
            camera.light[0] /= level;
            Ok::<_, DevelopError>(image)
        });
        FrameStack::of(frames, false).unwrap()
    });
    let flats: Vec<FrameStack> = flats.collect();
    let found = calibrate_frames(&camera.darks(), &flats).unwrap();
    assert!((found.gain_dn_per_e.value / steady.gain_dn_per_e.value - 1.0).abs() < 0.03, "{found:?}");
    assert!(found.warnings[0].text().contains("flickers"), "{:?}", found.warnings);
    // A gamma of 2.2
    let times_s = [0.004, 0.008, 0.015, 0.03, 0.06];
    let developed = times_s.map(|time_s| {
        let frames = (0..4).map(|frame| {
            let mut image = camera.frame("flat", time_s, frame, true);
            image
                .data
                .iter_mut()
                .for_each(|dn| *dn = (4095.0 * (f64::from(*dn) / 4095.0).powf(1.0 / 2.2)) as u16);
            Ok::<_, DevelopError>(image)
        });
        FrameStack::of(frames, false).unwrap()
    });
    let problem = calibrate_frames(&camera.darks(), &developed);
    let is_told = match &problem {
        Ok(found) => found.warnings.iter().any(|warning| warning.text().contains("in proportion")),
        Err(error) => *error == CalibrationProblem::NoRise,
    };
    assert!(is_told, "{problem:?}");
}

/// Dark frames whose noise the steps of the converter hide tell nothing of the gain, and no lower limit of a pattern.
#[test]
fn noise_below_the_steps_of_the_converter_bends_nothing() {
    for (number, dsnu_e) in [(5, 2.0), (11, 10.0)] {
        let drawn = Camera::drawn(number);
        let model = SensorModel {
            voltage_swing_v: 1e-4 * 256.0 / 0.02,
            bit_depth: 8,
            well_capacity_e: 1e6,
            read_noise_e: Some(3.0),
            dsnu_e: Some(dsnu_e),
            dark_current_e_per_s: Some(1.0),
            black_level_dn: 8.3,
            ..drawn.sensor.model().clone()
        };
        let sensor = Sensor::new(model, drawn.sensor.qe().clone()).unwrap();
        let camera = Camera { sensor, light: vec![1e5], frames: 8, ..drawn };
        let found = calibrate_frames(&camera.darks(), &camera.flats()).unwrap();
        let (gain, dsnu) = (found.gain_dn_per_e, found.dsnu_e.unwrap());
        assert!((gain.value - 0.02).abs() < 3.0 * gain.error() && gain.error() < 6e-4, "{gain:?}");
        assert!((dsnu.low..=dsnu.high).contains(&dsnu_e), "{dsnu:?}");
        let texts: Vec<&str> = found.warnings.iter().map(|warning| warning.text()).collect();
        assert!(!texts.iter().any(|text| text.contains("in proportion")), "{texts:?}");
    }
}

/// A camera whose channels have black levels of their own is the same camera otherwise.
#[test]
fn black_levels_of_channels_are_no_light_and_no_pattern() {
    let camera = Camera::drawn(2);
    let above = [0u16, 3, 6];
    let stack = |series: &str, time_s: f64, frames: u64, is_lit: bool, above: [u16; 3]| {
        let lifted = |frame| {
            let mut image = camera.frame(series, time_s, frame, is_lit);
            for pixel in 0..image.data.len() {
                let channel = image.mosaic.channel(pixel / SIDE[0], pixel % SIDE[0]);
                image.data[pixel] = (image.data[pixel] + above[channel]).min(4095);
            }
            Ok::<_, DevelopError>(image)
        };
        FrameStack::of((0..frames).map(lifted), !is_lit).unwrap()
    };
    let calibrated = |above: [u16; 3]| {
        let darks = [0.008, 4.0].map(|time_s| stack("dark", time_s, 8, false, above));
        let flats: Vec<FrameStack> =
            [0.008, 0.015, 0.03, 0.06].map(|time_s| stack("flat", time_s, 4, true, above)).into();
        let found = calibrate_frames(&darks, &flats).unwrap();
        let dim = stack("flat", 0.0005, 4, true, above);
        (found.rates(&dim, [10, 10, 30, 30]), found)
    };
    let ((rates, plain), (lifted_rates, lifted)) = (calibrated([0; 3]), calibrated(above));
    let near = |a: MeasuredNumber, b: MeasuredNumber| (a.value - b.value).abs() < 0.3 * a.error();
    assert!(near(plain.gain_dn_per_e, lifted.gain_dn_per_e), "{:?}", lifted.gain_dn_per_e);
    assert!(near(plain.dsnu_e.unwrap(), lifted.dsnu_e.unwrap()), "{:?} {:?}", plain.dsnu_e, lifted.dsnu_e);
    let is_of_light = |warning: &crate::warning::Warning| warning.text().contains("in proportion");
    assert!(!lifted.warnings.iter().any(is_of_light), "{:?}", lifted.warnings);
    for channel in 0..3 {
        let [of_plain, of_lifted] = [&rates, &lifted_rates].map(|rates| rates[channel].unwrap());
        assert!(near(of_plain, of_lifted), "{channel}: {of_plain:?} {of_lifted:?}");
        let black = lifted.channels[channel].black_level_dn - plain.channels[channel].black_level_dn;
        assert!((black - f64::from(above[channel])).abs() < 0.01, "{channel}: {black}");
    }
}
