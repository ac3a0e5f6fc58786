//! Figure 4: spectra of the two light sources.

use fluorspar::spectral::Curve;
use fluorspar_experiment::preset;

use super::check::{Check, Outcome, Verdict, number};
use super::setup::{Setup, ValidationError, plotted};
use fluorspar_report::figures::lights;

/// Peak of the blue LED by the paper, nm, and the step of the file that the authors' scripts read.
const PEAK_NM: f64 = 385.0;
const FILE_STEP_NM: f64 = 5.0;
/// Where spectra are looked at, nm.
const RANGE_NM: [f64; 2] = [350.0, 750.0];

/// Width of a rectangle with the area and the height of a spectrum, nm.
fn equivalent_width_nm(curve: &Curve) -> f64 {
    curve.integral(RANGE_NM[0], RANGE_NM[1]) / curve.max()
}

pub(super) fn run(setup: &Setup<'_>) -> Result<Outcome, ValidationError> {
    let blue = setup.sample(&["light.filters=[]"])?.irradiance;
    let white = preset::light_spectrum("white_led")?.curve();
    let widths = [&white, &blue].map(equivalent_width_nm);
    let reason = format!(
        "The LED called 385 nm peaks at {:.1} nm: the authors' file ends at 380 nm, the limit of their instrument, and has its \
         largest value there; its second diffraction order shows the missing side. The white LED is {} nm wide, the blue one \
         {} nm. Its spectrum, as the paper draws it, is not public.",
        blue.peak_nm(),
        number(widths[0]),
        number(widths[1])
    );
    Ok(Outcome::new(Verdict::Corrected, reason)
        .check(Check::near(
            "peak of the 385 nm LED",
            PEAK_NM,
            FILE_STEP_NM,
            blue.peak_nm(),
            "nm",
            "one step of the authors' file, whose first sample, at the end of the instrument, is its largest",
        ))
        .check(
            Check::at_least(
                "equivalent width of the white light",
                2.0 * widths[1],
                widths[0],
                "nm",
                "broadband beside the 385 nm LED: two bands as wide as that would be seen as two; numbers are not public",
            )
            .said("the white is broadband"),
        )
        .show(
            "figure_4_lights",
            lights(&[plotted("white LED", &white, RANGE_NM), plotted("385 nm LED, bare", &blue, RANGE_NM)], &[]),
        ))
}
