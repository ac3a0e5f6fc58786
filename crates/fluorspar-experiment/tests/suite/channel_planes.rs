//! Frames as weighted sums of channel planes against the chain in all bands: lens, film irradiance, sensor.
#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use crate::support::run;
use fluorspar::image::{Component, ComponentFactors, ComponentImage, LightPath};
use fluorspar::pipeline::{
    CapturePlanes, CaptureResponses, FilmResponse, LivePlane, LiveView, SeenComponents, capture_from_planes,
    capture_irradiance, concentration_factors, scale_multiple,
};
use fluorspar::sensor::Sensor;
use fluorspar::study::{Motion, PaintedFactor, Study};
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{parse, resolve};

const IDEAL: &str = "focal_length_mm = 3.0\nf_number = 4.0\n";
const TRACED: &str = "type = \"traced\"\nprescription = \"wide_3_5mm\"\n";
const SPREAD: &str =
    "type = \"traced\"\nprescription = \"wide_3_5mm\"\nimage_formation = \"point_spread\"\nband_groups = 2\n";

/// The spheres of the catalogue behind a lens, with two captures of which one has a filter of its own.
fn study(lens: &str, changes: &[&str]) -> Study {
    let text = preset::text(PresetKind::Experiment, "fluorescent-sphere").unwrap();
    let text = text.replace("horizontal_field_deg = 40.0\n", "horizontal_field_deg = \"from_lens\"\n");
    let text = format!(
        "{text}\n[lens]\n{lens}\n[view_filter]\nfilters = [\"long_pass_475\"]\n\n[sensor]\npreset = \"lyu_2021_table_1\"\n\
         columns = 48\nrows = 36\n\n[[capture]]\nname = \"violet\"\nlight_groups = {{ violet = 0.7 }}\nexposure_ms = 10.0\n\n\
         [[capture]]\nname = \"both\"\nlight_groups = {{ violet = 1.0, room = 2.5 }}\nfilters = [\"band_pass_635_50\"]\n\
         exposure_ms = 10.0\n"
    );
    let mut all: Vec<String> =
        ["render.width_px=24", "render.height_px=18", "render.samples_per_pixel=2"].map(String::from).into();
    all.extend(changes.iter().map(|change| (*change).to_owned()));
    resolve(&parse(&text, "planes", Path::new("."), &all).unwrap()).unwrap().study
}

/// Largest difference of the electron rates of all captures, relative to each pixel's own rate, and with what noise-free
/// rates of which sensor.
fn largest_difference(study: &Study, image: &ComponentImage, sensor: &Sensor) -> f64 {
    let planes = CapturePlanes::new(study, image).unwrap();
    let factors = ComponentFactors::ones(image.components.len());
    let seen = SeenComponents { image, planes: &planes, captures: &study.captures, factors: &factors };
    let mut most: f64 = 0.0;
    for capture in &study.captures {
        let (irradiance, film) = capture_irradiance(study, capture, image).unwrap();
        let expected = sensor.electron_rate_on_film(&irradiance, film).unwrap();
        let rates = seen.film_rates(capture, |component| capture.frame.drive(&component.light_group));
        let actual = sensor.electron_rate_of(&rates, planes.film).unwrap();
        assert!(expected.data.iter().any(|rate| *rate > 1.0), "a capture without light shows nothing");
        for (actual, expected) in actual.data.iter().zip(&expected.data) {
            let difference = f64::from(actual - expected).abs();
            most = most.max(if *expected > 0.0 { difference / f64::from(*expected) } else { difference });
        }
    }
    most
}

/// What single precision allows: the chain rounds each band three times and adds 81 of them in eight lanes, the
/// planes add them in blocks of eight; each error is below half a unit of 2^-24 and their signs are random. Spectra of a basis have both
/// signs, so that what is summed, and its rounding, is up to some three times the sum.
const TOLERANCE: f64 = 3e-6;

#[test]
fn planes_equal_the_chain_behind_every_lens() {
    let angles = ["view_filter.angles=\"lens\"", "view_filter.position=\"rear\""];
    let own = ["view_filter.autofluorescence={ photon_yield = 0.001, spectrum = \"led_450\" }"];
    let cases: [(&str, &str, &[&str]); 8] = [
        ("ideal", IDEAL, &[]),
        ("ideal, angles", IDEAL, &angles),
        ("ideal, own light of the filter", IDEAL, &own),
        ("rendered through", TRACED, &[]),
        ("rendered through, angles", TRACED, &angles),
        ("point spread", SPREAD, &[]),
        ("point spread, angles", SPREAD, &angles),
        ("point spread, own light of the filter", SPREAD, &own),
    ];
    let mut failures = Vec::new();
    for (name, lens, changes) in cases {
        let study = study(lens, changes);
        let image = run(&study.scene, &study.render);
        let sensor = study.camera.sensor.clone().unwrap();
        let difference = largest_difference(&study, &image, &sensor);
        // What rings at edges is cut plane by plane, or band by band, which is no linear step: found 1.7e-4 here, where parts of the light
        // have edges of their own
        let tolerance = if lens == SPREAD { 1e-3 } else { TOLERANCE };
        failures.extend((difference >= tolerance).then(|| format!("{name}: {difference:e}")));
    }
    assert!(failures.is_empty(), "{failures:?}");
}

#[test]
fn planes_equal_the_chain_on_every_sensor() {
    let crosstalk = "sensor.crosstalk={ optical_side_percent = 1.0, optical_edge_factor = 2.0, \
                     electrical_side_percent = [[450, 0.5], [650, 3.0]], electrical_corner_ratio = 0.3 }";
    let cases: [&[&str]; 12] = [
        &["sensor.preset=\"pi_camera_3\"", "sensor.columns=48", "sensor.rows=36"],
        &["sensor.preset=\"monochrome_3_45um\"", "sensor.columns=48", "sensor.rows=36"],
        &["sensor.preset=\"multispectral_3x3\"", "sensor.columns=48", "sensor.rows=36"],
        &["sensor.preset=\"rgb_nir_3um\"", "sensor.columns=48", "sensor.rows=36"],
        &["sensor.mode={ type = \"isetcam\", noise_flag = 0 }"],
        &["sensor.mode.type=\"noise_free\"", "sensor.aperture_um=1.5"],
        &["sensor.relative_illumination={ R = [-0.3], all = [-0.2, 0.05] }"],
        &[crosstalk],
        // Samples are pixels, a film that the sensor does not cover, and one that does not cover the sensor.
        &["sensor.columns=24", "sensor.rows=18"],
        &["sensor.columns=17", "sensor.rows=40"],
        &["sensor.region_px=[8, 4, 16, 12]"],
        &["sensor.binning={ columns = 2, rows = 2, type = \"charge\" }"],
    ];
    let mut failures = Vec::new();
    for changes in cases {
        let study = study(IDEAL, changes);
        let image = run(&study.scene, &study.render);
        let sensor = study.camera.sensor.clone().unwrap();
        let difference = largest_difference(&study, &image, &sensor);
        failures.extend((difference >= TOLERANCE).then(|| format!("{changes:?}: {difference:e}")));
    }
    assert!(failures.is_empty(), "{failures:?}");
    // Of another sensor than the one that the image was rendered for, which sees more of it.
    let study = study(IDEAL, &[]);
    let image = run(&study.scene, &study.render);
    let mut other = study.clone();
    other.camera.sensor = self::study(IDEAL, &["sensor.columns=60", "sensor.rows=30"]).camera.sensor;
    assert!(largest_difference(&other, &image, &other.camera.sensor.clone().unwrap()) < TOLERANCE);
}

/// Frames as a live figure adds them up, against those of a camera without noise whose dark current counts. A porphyrin whose share is
/// estimated can be changed, however weak it is.
#[test]
fn live_planes_add_up_to_frames() {
    let changes = [
        "sensor.mode.type=\"noise_free\"",
        "sensor.dark_current_e_per_s=20000",
        "concentration.protoporphyrin_ix=1e-7",
        "analysis.frame=\"violet\"",
    ];
    let wanted = study(IDEAL, &changes);
    let image = run(&wanted.scene, &wanted.render);
    let planes = CapturePlanes::new(&wanted, &image).unwrap();
    let factors = ComponentFactors::ones(image.components.len());
    let seen =
        SeenComponents { image: &image, planes: &planes, captures: &wanted.captures, factors: &factors };
    let frames = capture_from_planes(&wanted, &seen).unwrap();
    let view = LiveView::new(&wanted, &seen, &frames).unwrap().unwrap();
    assert_eq!((view.size, view.captures.len()), ([24, 18], 2));
    for (raw, live) in frames.iter().map(|frame| &frame.raw).zip(&view.captures) {
        for place in 0..3 * 24 * 18 {
            let (channel, pixel) = (["R", "G", "B"][place / (24 * 18)], place % (24 * 18));
            let lit = view.planes.iter().filter(|plane| plane.response == live.response);
            let rate = lit.map(|plane| live.drives[plane.group] * f64::from(plane.rates[place])).sum::<f64>();
            let electrons = ((rate + live.dark_e_per_s) * live.exposure_s).min(live.well_e);
            let shown = (electrons * live.dn_per_electron * live.gain).min(live.white_dn);
            let cell = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(row, col)| {
                let (row, col) = (2 * (pixel / 24) + row, 2 * (pixel % 24) + col);
                (raw.mosaic.channels[raw.mosaic.channel(row, col)].as_str(), raw.data[row * raw.width + col])
            });
            let own: Vec<f64> =
                cell.iter().filter(|(name, _)| *name == channel).map(|(_, dn)| f64::from(*dn)).collect();
            let captured = own.iter().sum::<f64>() / own.len() as f64 - raw.black_level;
            assert!((captured - shown).abs() <= 1.0, "{} {channel} {pixel}: {captured} {shown}", raw.label);
        }
    }
    let weak = |study: &Study| {
        let view = LiveView::new(study, &seen, &frames).unwrap().unwrap();
        let own = |plane: &&LivePlane| plane.fluorophore.as_deref() == Some("protoporphyrin_ix");
        view.planes.iter().filter(own).count()
    };
    let unsought = Study { analysis: None, ..wanted.clone() };
    assert!(weak(&wanted) > weak(&unsought), "{} {}", weak(&wanted), weak(&unsought));
    for other in [
        "sensor.mode={ type = \"isetcam\", noise_flag = 0 }",
        "sensor.shutter={ row_time_us = 10.0, parasitic_light_sensitivity = 0.01 }",
    ] {
        assert_eq!(LiveView::new(&study(IDEAL, &[other]), &seen, &frames).unwrap(), None, "{other}");
    }
}

#[test]
fn factors_are_those_of_drives_and_masks() {
    let study = study(IDEAL, &[]);
    let image = run(&study.scene, &study.render);
    let planes = CapturePlanes::new(&study, &image).unwrap();
    // Elastin three times as much in the left half, all porphyrin gone.
    let mut changed = image.clone();
    let mask: Arc<[f32]> = (0..image.width * image.height)
        .map(|pixel| if pixel % image.width < image.width / 2 { 3.0 } else { 1.0 })
        .collect();
    let mut factors = ComponentFactors::ones(image.components.len());
    for (number, component) in image.components.iter().enumerate() {
        let LightPath::Fluorescence(name) = &component.light else { continue };
        let stored = image.values_per_pixel(number).max(1);
        let values = changed.stored_mut(number);
        match name.as_str() {
            "elastin" => {
                factors.maps[number] = Some(mask.clone());
                let spectra = values.chunks_exact_mut(stored).zip(mask.iter());
                spectra.for_each(|(spectrum, factor)| spectrum.iter_mut().for_each(|value| *value *= factor));
            }
            "protoporphyrin_ix" => {
                factors.even[number] = 0.0;
                values.fill(0.0);
            }
            _ => {}
        }
    }
    let sensor = study.camera.sensor.as_ref().unwrap();
    let capture = &study.captures[0];
    let (irradiance, film) = capture_irradiance(&study, capture, &changed).unwrap();
    let expected = sensor.electron_rate_on_film(&irradiance, film).unwrap();
    let seen =
        SeenComponents { image: &image, planes: &planes, captures: &study.captures, factors: &factors };
    let rates = seen.film_rates(capture, |component| capture.frame.drive(&component.light_group));
    let actual = sensor.electron_rate_of(&rates, film).unwrap();
    for (actual, expected) in actual.data.iter().zip(&expected.data) {
        assert!((actual - expected).abs() <= TOLERANCE as f32 * expected, "{actual} {expected}");
    }
}

#[test]
fn planes_of_some_components_leave_the_others_dark_and_digests_tell_cameras_apart() {
    let first = study(IDEAL, &[]);
    let image = run(&first.scene, &first.render);
    let digests = |study: &Study| -> Vec<String> {
        let responses = CaptureResponses::new(study, &study.captures, &image).unwrap().responses;
        responses.iter().map(|response| response.camera().to_owned()).collect()
    };
    let own = digests(&first);
    assert_eq!(own.len(), 2, "two captures with different filters");
    assert_ne!(own[0], own[1]);
    // Exposure, drive and motion are factors; filter, lens and sensor are not.
    let mut same = study(IDEAL, &["capture.violet.exposure_ms=3", "capture.both.light_groups.room=0.1"]);
    same.motion = Some(Motion { drift_px_per_s: [1.0, 0.0], jitter_px: 0.1, interval_ms: 1.0 });
    assert_eq!(digests(&same), own);
    for change in
        ["view_filter.filters=[\"long_pass_500\"]", "lens.f_number=2.0", "sensor.preset=\"pi_camera_3\""]
    {
        assert!(digests(&study(IDEAL, &[change])).iter().all(|digest| !own.contains(digest)), "{change}");
    }
    let CaptureResponses { responses, .. } = CaptureResponses::new(&first, &first.captures, &image).unwrap();
    let Ok(planes) = FilmResponse::planes(&[&responses[0]], |component| component == 1, &image);
    let is_dark = |component: usize| {
        (0..3).all(|channel| planes[0].plane(component, channel).iter().all(|v| *v == 0.0))
    };
    assert_eq!((0..image.components.len()).filter(|c| !is_dark(*c)).collect::<Vec<_>>(), [1]);
}

/// Concentrations of a finished render against a new one of the same seed, whose paths are the same: exact but for the light that
/// fluoresced twice, whose error is told.
#[test]
fn concentrations_of_a_finished_render_are_those_of_a_new_one() {
    let rendered = study(IDEAL, &[]);
    let image = run(&rendered.scene, &rendered.render);
    let changes = ["concentration.elastin=0.25", "concentration.protoporphyrin_ix=0.5"];
    let wanted = study(IDEAL, &changes);
    let again = run(&wanted.scene, &wanted.render);
    let mut factors = concentration_factors(&BTreeMap::new(), &wanted, &image).unwrap();
    let planes = CapturePlanes::new(&wanted, &image).unwrap();
    let uncertainty = scale_multiple(&mut factors, &image, &planes, &wanted.captures).unwrap();
    let new_planes = CapturePlanes::new(&wanted, &again).unwrap();
    let ones = ComponentFactors::ones(image.components.len());
    let mut most: f64 = 0.0;
    for capture in &wanted.captures {
        let rates = |planes: &CapturePlanes, factors: &ComponentFactors, is: &dyn Fn(&LightPath) -> bool| {
            let captures = &wanted.captures;
            let seen = SeenComponents { image: &image, planes, captures, factors };
            let weight = |c: &Component| if is(&c.light) { capture.frame.drive(&c.light_group) } else { 0.0 };
            seen.film_rates(capture, weight).data
        };
        // Light that fluoresced once, fluorophore by fluorophore
        let once = |light: &LightPath| matches!(light, LightPath::Fluorescence(_));
        let (edited, new) = (rates(&planes, &factors, &once), rates(&new_planes, &ones, &once));
        let peak = new.iter().copied().fold(0.0, f32::max);
        for (edited, new) in edited.iter().zip(&new) {
            // The film rounds values to 2^-30 of the brightest sample, and sums of blocks to single precision.
            assert!((edited - new).abs() <= 2e-6 * peak, "{edited} {new}, peak {peak}");
        }
        // All light
        let all = |_: &LightPath| true;
        let sum = |values: Vec<f32>| values.into_iter().map(f64::from).sum::<f64>();
        let (edited, new) = (sum(rates(&planes, &factors, &all)), sum(rates(&new_planes, &ones, &all)));
        most = most.max((edited / new - 1.0).abs());
    }
    assert!(uncertainty.share > 1e-7, "some light fluoresced twice: {uncertainty:?}");
    assert!(most <= uncertainty.largest_error + 2e-6, "off by {most:e}, said {uncertainty:?}");
}

/// What the room's light leaves uncertain is not told of a frame without it, however much of it fluoresced twice.
#[test]
fn uncertainty_counts_only_light_that_a_capture_switches_on() {
    let wanted = study(IDEAL, &["concentration.elastin=0.25"]);
    let image = run(&wanted.scene, &wanted.render);
    let before = concentration_factors(&BTreeMap::new(), &wanted, &image).unwrap();
    let mut planes = CapturePlanes::new(&wanted, &image).unwrap();
    let told = |planes: &CapturePlanes, captures: usize| {
        let mut factors = before.clone();
        let found = scale_multiple(&mut factors, &image, planes, &wanted.captures[..captures]).unwrap();
        (found, factors)
    };
    let (violet, factors) = told(&planes, 1);
    let room = image.components.iter().position(|component| {
        component.light_group == "room" && component.light == LightPath::MultipleFluorescence
    });
    let room = room.unwrap();
    assert_eq!(factors.even[room], 1.0, "nobody sees it");
    for channel in 0..planes.planes[0].channels {
        planes.planes.iter_mut().for_each(|planes| planes.plane_mut(room, channel).fill(1e9));
    }
    assert_eq!(told(&planes, 1).0, violet);
    let (both, factors) = told(&planes, 2);
    assert!(both.share > 0.5 && both.largest_error > violet.largest_error, "{both:?} {violet:?}");
    assert!(factors.even[room] < 1.0);
}

#[test]
fn concentrations_that_no_light_shows_and_masks_of_other_shapes_are_refused() {
    let wanted = study(IDEAL, &["concentration.elastin=2"]);
    let image = run(&wanted.scene, &wanted.render);
    let without: BTreeMap<String, f64> = [("elastin".to_owned(), 0.0)].into();
    let error = concentration_factors(&without, &wanted, &image).unwrap_err().to_string();
    assert!(error.contains("concentration.elastin") && error.contains("render the"), "{error}");
    let mut painted = wanted;
    painted.concentrations[0].painted =
        Some(PaintedFactor { inside: 3.0, width: 20, height: 20, mask: vec![1.0; 400].into() });
    let error = concentration_factors(&BTreeMap::new(), &painted, &image).unwrap_err().to_string();
    assert!(error.contains("the mask has 20 x 20 pixels, the render 24 x 18"), "{error}");
    // Half of each column of the mask: every pixel mixes both factors.
    let half: Vec<f32> = (0..48 * 36).map(|i| (i % 2) as f32).collect();
    painted.concentrations[0].painted =
        Some(PaintedFactor { inside: 3.0, width: 48, height: 36, mask: half.into() });
    let factors = concentration_factors(&BTreeMap::new(), &painted, &image).unwrap();
    let elastin = image.components.iter().position(|c| c.light == LightPath::Fluorescence("elastin".into()));
    assert_eq!(factors.at(elastin.unwrap(), 100), 2.5);
}

/// A mask painted on the image of a plane, which no light reaches twice, against a new render of a plane that holds as much: the same
/// light in every pixel, but for that which fluoresced twice.
#[test]
fn a_painted_mask_shows_what_a_new_render_of_a_plane_does() {
    let study = |changes: &[&str]| {
        let text = preset::text(PresetKind::Experiment, "flat-patch").unwrap();
        let mut all: Vec<String> = [
            "render.width_px=16",
            "render.height_px=12",
            "render.samples_per_pixel=4",
            "sensor.columns=32",
            "sensor.rows=24",
        ]
        .map(String::from)
        .into();
        all.extend(changes.iter().map(|change| (*change).to_owned()));
        resolve(&parse(text, "mask", Path::new("."), &all).unwrap()).unwrap().study
    };
    let rendered = study(&["material.patch.concentrations.elastin=0.5"]);
    // Three times as much in one half of the plane, whose middle is that of the image.
    let map = "material.patch.concentrations.elastin={ checker = [2, 1], low = 0.5, high = 1.5 }";
    let (image, again) = (run(&rendered.scene, &rendered.render), {
        let study = study(&[map]);
        run(&study.scene, &study.render)
    });
    let number = image.components.iter().position(|c| c.light == LightPath::Fluorescence("elastin".into()));
    let number = number.unwrap();
    let spectrum = |image: &ComponentImage, pixel: usize| -> f64 {
        image.spectrum(number, pixel).iter().map(|value| f64::from(*value)).sum()
    };
    let ratio = |pixel: usize| spectrum(&again, pixel) / spectrum(&image, pixel);
    let right = ratio(image.width - 1) > 2.0;
    let mask = (0..image.width * image.height)
        .map(|pixel| f32::from((pixel % image.width >= image.width / 2) == right));
    let mut wanted = self::study(IDEAL, &["concentration.elastin=2"]);
    wanted.concentrations[0].factor = 1.0;
    wanted.concentrations[0].painted = Some(PaintedFactor {
        inside: 3.0,
        width: image.width,
        height: image.height,
        mask: mask.collect::<Vec<f32>>().into(),
    });
    let factors = concentration_factors(&BTreeMap::new(), &wanted, &image).unwrap();
    for pixel in 0..image.width * image.height {
        let (edited, new) = (factors.at(number, pixel) * spectrum(&image, pixel), spectrum(&again, pixel));
        // The film rounds values to 2^-30 of the brightest sample, and sums of blocks to single precision.
        assert!((edited - new).abs() <= 1e-5 * new, "{pixel}: {edited} {new}");
    }
}
