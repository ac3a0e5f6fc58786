//! Figure 5: LED, its filter, the viewing filter, the responsivity of the sensor.

use fluorspar::pipeline::{filter_leak, predict};
use fluorspar::spectral::Curve;
use fluorspar::study::FlatSample;
use fluorspar_experiment::preset;

use super::check::{Check, Outcome, Verdict, number};
use super::setup::{Setup, ValidationError, plotted, sensor};
use fluorspar_report::Figure;
use fluorspar_report::figures::{PlotCurve, filters, lights, sensor_response};

/// Where spectra are looked at, nm.
const RANGE_NM: [f64; 2] = [350.0, 750.0];
/// From here on light of the LED reaches the sensor, nm.
const VIEW_NM: f64 = 475.0;

/// Reflected light that still leaves a frame almost entirely fluorescence.
const SMALL_LEAK: f64 = 0.05;
const WHY_SMALL: &str = "almost entirely: nineteen parts in twenty or more";
const SAID_SMALL: &str = "the captured light is almost entirely fluorescence (4.2)";

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
    let text =
        Check::near("orders below the peak at 440 nm", 2.5, 0.25, at(440.0), "", "rounded to half an order");
    let caption =
        Check::near("orders below the peak at 450 nm", 3.0, 0.5, at(450.0), "", "rounded to whole orders");
    let found = Outcome::new(Verdict::Corrected, reason)
        .check(text.said("2.5 orders (text, 3.3.2)"))
        .check(caption.said("3 orders (caption)"))
        .show(
            "figure_5a_led",
            lights(&[plotted("385 nm LED, bare", &bare, RANGE_NM)], &[]).titled("The 385 nm LED"),
        );
    let measured = setup.measured("lights/oraleye_led385.csv")?.and_then(|mut columns| columns.pop());
    Ok(match measured {
        Some(measured) => found.check(second_order(&measured.curve, &bare)),
        None => {
            found.lacks("the measured LED (lights/oraleye_led385.csv), whose lobe at 765 nm is looked at")
        }
    })
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
    let orders = [&bare, &used].map(|sample| orders_below_peak(&sample.irradiance, 450.0));
    Ok(Outcome::new(Verdict::Corrected, reason)
        .checks(filtered_checks(orders, with, tail_y44 / tail_bare))
        .show("figure_5b_led", filtered_figure(&bare.irradiance, &used.irradiance, &y44)))
}

fn filtered_checks([bare, used]: [f64; 2], leak: f64, y44_over_bare: f64) -> [Check; 3] {
    let what = "orders below the peak at 450 nm behind the short-pass";
    let why = "a filter that blocks takes at least one order off the bare LED";
    let blocks = Check::at_least(what, bare + 1.0, used, "", why);
    let what = "reflected over fluorescent photons behind the viewing filter";
    let dark = Check::at_most(what, SMALL_LEAK, leak, "", WHY_SMALL);
    let what = "share beyond 475 nm behind Y44 over that of the bare LED";
    let why = "a filter that is to lower it must not raise it: the text is wrong about the part";
    let y44 = Check::at_least(what, 1.0, y44_over_bare, "", why);
    [
        blocks.said("blocks wavelengths above 425 nm"),
        dark.said(SAID_SMALL),
        y44.said("Hoya Y44 reduces energy above 475 nm"),
    ]
}

fn filtered_figure(bare: &Curve, used: &Curve, y44: &Curve) -> Figure {
    let scaled = |name: &str, light: &Curve| plotted(name, &light.scaled(1.0 / light.max()), RANGE_NM);
    let curves = [scaled("bare", bare), scaled("behind the short-pass", used)];
    lights(&curves, &[plotted("Y44", y44, RANGE_NM)]).titled("The 385 nm LED and its filter")
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
    Ok(Outcome::new(Verdict::Corrected, reason)
        .checks(reading_checks(gap, [leak_text, leak_caption]))
        .show("figure_5c_filters", filters(&curves).titled("Two readings of the viewing filter")))
}

fn reading_checks([text, caption]: [f64; 2], [leak_text, leak_caption]: [f64; 2]) -> [Check; 4] {
    let what = "mean transmittance of the caption's reading, 450 to 475 nm, over its maximum";
    let open = Check::at_least(what, 0.9, caption, "", "nearly transparent: nine parts in ten or more");
    let why = "blocked: one part in ten or less, edge included";
    let closed = Check::at_most("the same of the text's reading", 0.1, text, "", why);
    let leak = |range: &str, value| {
        let what = format!("reflected over fluorescent electrons, {range}");
        Check::at_most(what, SMALL_LEAK, value, "", WHY_SMALL).said(SAID_SMALL)
    };
    [
        open.said("nearly transparent between 450 and 700 nm (caption)"),
        closed.said("blocks wavelengths less than 475 nm (text)"),
        leak("475 to 700 nm", leak_text),
        leak("425 to 700 nm", leak_caption),
    ]
}

/// A channel behind lens and filters.
struct Channel {
    bare: PlotCurve,
    seen: PlotCurve,
}

impl Channel {
    fn peak_nm(&self) -> f64 {
        let values = &self.seen.value;
        let best = (0..values.len()).max_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(0);
        self.seen.wavelength_nm[best]
    }

    /// Share of the response outside the pass band and its edges.
    fn outside(&self) -> f64 {
        let all = || self.seen.wavelength_nm.iter().zip(&self.seen.value);
        let beyond = all().filter(|(nm, _)| !(465.0..=710.0).contains(*nm));
        beyond.map(|(_, value)| value).sum::<f64>() / all().map(|(_, value)| value).sum::<f64>()
    }
}

/// R, G and B of a sample's camera.
fn channels(sample: &FlatSample) -> Result<Vec<Channel>, ValidationError> {
    let grid = &sample.grid;
    let lens = sample.camera.lens_behind_filters().ok_or(ValidationError::Lacks("lens"))?;
    let transmittance = lens.transmittance.bin_averages(grid);
    let qe = sensor(sample)?.effective_qe();
    let channel = |name: &str| {
        let number = qe.find(name).ok_or(ValidationError::Lacks("channel R, G or B"))?;
        let bare = qe.on_grid(number, grid).values().to_vec();
        let seen = bare.iter().zip(&transmittance).map(|(q, t)| q * t).collect();
        let curve = |values| PlotCurve::new(name, grid.centers_nm(), values);
        Ok(Channel { bare: curve(bare), seen: curve(seen) })
    };
    ["R", "G", "B"].into_iter().map(channel).collect()
}

/// (d) The effective responsivity.
pub(super) fn responsivity(setup: &Setup<'_>) -> Result<Outcome, ValidationError> {
    let channels = channels(&setup.sample(&[])?)?;
    let [red, green, blue] = [0, 1, 2].map(|channel: usize| channels[channel].peak_nm());
    let largest = channels.iter().map(Channel::outside).fold(0.0, f64::max);
    let reason = format!(
        "The curves are not public. A typical color sensor behind the filters peaks at {} (R), {} (G) and {} nm (B); {} of the \
         response at most lies outside the pass band.",
        number(red),
        number(green),
        number(blue),
        number(largest)
    );
    let order = "three color channels are in the order of their names";
    let what = "largest share of a response outside 465 to 710 nm";
    let why = "a pass band with edges of 10 nm leaves what its optical density leaves";
    let curves = |of: fn(&Channel) -> &PlotCurve| channels.iter().map(of).cloned().collect::<Vec<_>>();
    Ok(Outcome::new(Verdict::NotPublic, reason)
        .check(Check::at_least("peak of R less peak of G", 0.0, red - green, "nm", order))
        .check(Check::at_least("peak of G less peak of B", 0.0, green - blue, "nm", order))
        .check(Check::at_most(what, 0.01, largest, "", why).said("the sensor responds only to 475-700 nm"))
        .show(
            "figure_5d_responsivity",
            sensor_response(&curves(|c| &c.bare), &[("filtered".into(), curves(|c| &c.seen))]),
        ))
}
