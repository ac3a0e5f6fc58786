//! Figure 5: LED, its filter, the viewing filter, the responsivity of the sensor.

use std::collections::BTreeMap;

use fluorspar::pipeline::{filter_leak, predict};
use fluorspar::spectral::Curve;
use fluorspar::study::FlatSample;
use fluorspar_experiment::preset;

use super::check::{Check, Outcome, Verdict, number};
use super::setup::{Setup, ValidationError, plotted, sensor};
use crate::figures::{PlotCurve, filters, lights, sensor_response};

/// Where spectra are looked at, nm.
const RANGE_NM: [f64; 2] = [350.0, 750.0];
/// From here on light of the LED reaches the sensor, nm.
const VIEW_NM: f64 = 475.0;

fn orders_below_peak(light: &Curve, nm: f64) -> f64 {
    (light.max() / light.at(nm)).log10()
}

/// Light beyond 475 nm per light of all wavelengths.
fn tail(light: &Curve) -> f64 {
    light.integral(VIEW_NM, RANGE_NM[1]) / light.integral(RANGE_NM[0], RANGE_NM[1])
}

/// (a) The bare LED.
pub(super) fn bare_led(setup: &Setup<'_>) -> Result<Outcome, ValidationError> {
    let bare = setup.sample(&["light.filters=[]"])?.irradiance;
    let at = |nm| orders_below_peak(&bare, nm);
    let reason = format!(
        "{} orders below the peak at 440 nm and {} at 450 nm: text and caption agree within their rounding. The emission in the \
         near infrared, for which the paper adds a filter, is the LED's own second diffraction order in the instrument; \
         the model has none.",
        number(at(440.0)),
        number(at(450.0))
    );
    let mut found = Outcome::new(Verdict::Corrected, reason)
        .check(
            Check::near(
                "orders below the peak at 440 nm",
                2.5,
                0.25,
                at(440.0),
                "",
                "rounded to half an order",
            )
            .said("2.5 orders (text, 3.3.2)"),
        )
        .check(
            Check::near(
                "orders below the peak at 450 nm",
                3.0,
                0.5,
                at(450.0),
                "",
                "rounded to whole orders",
            )
            .said("3 orders (caption)"),
        )
        .show(
            "figure_5a_led",
            lights(&[plotted("blue LED, bare", &bare, RANGE_NM)], &[]).titled("The blue LED"),
        );
    match setup.measured("lights/oraleye_led385.csv")?.and_then(|mut columns| columns.pop()) {
        Some(measured) => found = found.check(second_order(&measured.curve, &bare)),
        None => {
            found =
                found.lacks("the measured LED (lights/oraleye_led385.csv), whose lobe at 765 nm is looked at")
        }
    }
    Ok(found)
}

/// Where the lobe of the measured LED lies beside twice the peak.
fn second_order(measured: &Curve, model: &Curve) -> Check {
    let lobe = measured.clipped(700.0, 780.0).peak_nm();
    Check::near(
        "wavelength of the lobe in the near infrared over that of the peak",
        2.0,
        // Half a step of 5 nm of either.
        2.0 * (2.5 / lobe + 2.5 / model.peak_nm()),
        lobe / model.peak_nm(),
        "",
        "the second order of a grating lies at twice the wavelength; the file has steps of 5 nm",
    )
    .said("LEDs also emit in the NIR")
}

/// (b) The LED behind its short-pass filter.
pub(super) fn filtered_led(setup: &Setup<'_>) -> Result<Outcome, ValidationError> {
    let (bare, used) = (setup.sample(&["light.filters=[]"])?, setup.sample(&[])?);
    let y44 = preset::filter("long_pass_441_y44")?.curve();
    let behind_y44 = bare.irradiance.times(&y44);
    let leak = |sample: &FlatSample| {
        filter_leak(sample, &[]).map(|leak| leak.as_stated.leak_ratio.unwrap_or(f64::NAN))
    };
    let [without, with] = [leak(&bare)?, leak(&used)?];
    let [tail_bare, tail_used, tail_y44] = [&bare.irradiance, &used.irradiance, &behind_y44].map(tail);
    let passed = behind_y44.integral(RANGE_NM[0], 420.0) / bare.irradiance.integral(RANGE_NM[0], 420.0);
    let reason = format!(
        "A short-pass lowers the part of the LED's light beyond 475 nm from {} to {}, and reflected light behind the viewing \
         filter from {} to {} of the fluorescence. The text names Hoya Y44 for this place: that is a long-pass which would stop \
         the excitation (it passes {} of the light below 420 nm) and keep the tail. It stood in front of the \
         spectroradiometer.",
        number(tail_bare),
        number(tail_used),
        number(without),
        number(with),
        number(passed)
    );
    let curves = [
        plotted("bare", &bare.irradiance.scaled(1.0 / bare.irradiance.max()), RANGE_NM),
        plotted("behind the short-pass", &used.irradiance.scaled(1.0 / used.irradiance.max()), RANGE_NM),
    ];
    Ok(Outcome::new(Verdict::Corrected, reason)
        .check(
            Check::at_least(
                "orders below the peak at 450 nm behind the short-pass",
                orders_below_peak(&bare.irradiance, 450.0) + 1.0,
                orders_below_peak(&used.irradiance, 450.0),
                "",
                "a filter that blocks takes at least one order off the bare LED",
            )
            .said("blocks wavelengths above 425 nm"),
        )
        .check(
            Check::at_most(
                "reflected over fluorescent photons behind the viewing filter",
                0.05,
                with,
                "",
                "almost entirely: nineteen parts in twenty or more",
            )
            .said("the captured light is almost entirely fluorescence (4.2)"),
        )
        .check(
            Check::at_least(
                "share beyond 475 nm behind Y44 over that of the bare LED",
                1.0,
                tail_y44 / tail_bare,
                "",
                "a filter that is to lower it must not raise it: the text is wrong about the part",
            )
            .said("Hoya Y44 reduces energy above 475 nm"),
        )
        .show(
            "figure_5b_led",
            lights(&curves, &[plotted("Y44", &y44, RANGE_NM)]).titled("The blue LED and its filter"),
        ))
}

/// (c) The viewing filter, in both readings.
pub(super) fn viewing_filter(setup: &Setup<'_>) -> Result<Outcome, ValidationError> {
    let text = setup.sample(&["view_filter.filters=[\"view_475_700\"]"])?;
    let caption = setup.sample(&["view_filter.filters=[\"view_425_700\"]"])?;
    let leak = |sample: &FlatSample| predict(sample).map(|p| p.leak_ratio.unwrap_or(f64::NAN));
    let [leak_text, leak_caption] = [leak(&text)?, leak(&caption)?];
    let readings = [&text, &caption].map(|sample| &sample.camera.view_filter.transmittance);
    let gap = readings.map(|filter| filter.integral(450.0, 475.0) / 25.0 / filter.max());
    let reason = format!(
        "The text blocks below 475 nm, the caption below 425 nm and is nearly transparent from 450 nm: both cannot hold, since \
         from 450 to 475 nm the readings pass {} and {} of their maximum. Reflected light is {} of the fluorescence \
         electrons with the text's, {} with the caption's; either keeps it small. The text's is the default.",
        number(gap[0]),
        number(gap[1]),
        number(leak_text),
        number(leak_caption)
    );
    let curves = [("475 to 700 nm (text)", readings[0]), ("425 to 700 nm (caption)", readings[1])]
        .map(|(name, curve)| plotted(name, curve, RANGE_NM));
    let small = "almost entirely: nineteen parts in twenty or more";
    let said = "the captured light is almost entirely fluorescence (4.2)";
    Ok(Outcome::new(Verdict::Corrected, reason)
        .check(
            Check::at_least(
                "mean transmittance of the caption's reading, 450 to 475 nm, over its maximum",
                0.9,
                gap[1],
                "",
                "nearly transparent: nine parts in ten or more",
            )
            .said("nearly transparent between 450 and 700 nm (caption)"),
        )
        .check(
            Check::at_most(
                "the same of the text's reading",
                0.1,
                gap[0],
                "",
                "blocked: one part in ten or less, edge included",
            )
            .said("blocks wavelengths less than 475 nm (text)"),
        )
        .check(
            Check::at_most("reflected over fluorescent electrons, 475 to 700 nm", 0.05, leak_text, "", small)
                .said(said),
        )
        .check(
            Check::at_most(
                "reflected over fluorescent electrons, 425 to 700 nm",
                0.05,
                leak_caption,
                "",
                small,
            )
            .said(said),
        )
        .show("figure_5c_filters", filters(&curves).titled("Two readings of the viewing filter")))
}

/// (d) The effective responsivity.
pub(super) fn responsivity(setup: &Setup<'_>) -> Result<Outcome, ValidationError> {
    let sample = setup.sample(&[])?;
    let grid = &sample.grid;
    let lens = sample.camera.lens_behind_filters().ok_or(ValidationError::Lacks("lens"))?;
    let transmittance = lens.transmittance.bin_averages(grid);
    let qe = sensor(&sample)?.effective_qe();
    let mut bare = Vec::new();
    let mut seen: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    let mut curves = Vec::new();
    for name in ["R", "G", "B"] {
        let channel = qe.find(name).ok_or(ValidationError::Lacks("channel R, G or B"))?;
        let values = qe.on_grid(channel, grid).values().to_vec();
        let filtered: Vec<f64> = values.iter().zip(&transmittance).map(|(q, t)| q * t).collect();
        bare.push(PlotCurve::new(name, grid.centers_nm(), values));
        curves.push(PlotCurve::new(name, grid.centers_nm(), filtered.clone()));
        seen.insert(name, filtered);
    }
    let centers = grid.centers_nm();
    let peak_nm = |name: &str| {
        let values = &seen[name];
        let best = (0..values.len()).max_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(0);
        centers[best]
    };
    let outside = |name: &str| {
        let beyond = |nm: f64| !(465.0..=710.0).contains(&nm);
        let sum = |keep: &dyn Fn(f64) -> bool| -> f64 {
            seen[name].iter().zip(&centers).filter(|(_, nm)| keep(**nm)).map(|(v, _)| v).sum()
        };
        sum(&beyond) / sum(&|_| true)
    };
    let largest = ["R", "G", "B"].map(outside).into_iter().fold(0.0, f64::max);
    let reason = format!(
        "The curves are not public. A typical color sensor behind the filters peaks at {} (R), {} (G) and {} nm (B); {} of the \
         response at most lies outside the pass band.",
        number(peak_nm("R")),
        number(peak_nm("G")),
        number(peak_nm("B")),
        number(largest)
    );
    let order = "three color channels are in the order of their names";
    Ok(Outcome::new(Verdict::NotPublic, reason)
        .check(Check::at_least("peak of R less peak of G", 0.0, peak_nm("R") - peak_nm("G"), "nm", order))
        .check(Check::at_least("peak of G less peak of B", 0.0, peak_nm("G") - peak_nm("B"), "nm", order))
        .check(
            Check::at_most(
                "largest share of a response outside 465 to 710 nm",
                0.01,
                largest,
                "",
                "a pass band with edges of 10 nm leaves what its optical density leaves",
            )
            .said("the sensor responds only to 475-700 nm"),
        )
        .show("figure_5d_responsivity", sensor_response(&bare, &curves)))
}
