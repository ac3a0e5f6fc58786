//! Draws truth against estimate of the tongues that `porphyrin_in_drawn_mouths` prints, by the mean of the region and by its squares.
//!
//! `cargo run --release -p fluorspar-validation --example drawn_mouths_figure -- MOUTHS.csv FIGURE.svg`

use std::error::Error;
use std::fs;

use fluorspar_report::{Axis, Dash, Figure, Ink, Panel, Series, SeriesShape};

/// A tongue before R, G and B: its light, truth, the interval of the mean of the region, and the answer with its interval.
struct Tongue {
    led: String,
    truth: f64,
    by_mean: [f64; 2],
    median: f64,
    interval: [f64; 2],
}

fn tongue(line: &str) -> Option<Tongue> {
    let cells: Vec<&str> = line.split(',').collect();
    if *cells.get(6)? != "tongue_dorsum" || *cells.get(1)? != "lyu_2021_table_1" {
        return None;
    }
    let number = |place: usize| cells.get(place)?.parse().ok();
    let interval = [number(11)?, number(12)?];
    let by_mean = cells.get(14)?.split_once('-').and_then(|(a, b)| Some([a.parse().ok()?, b.parse().ok()?]));
    Some(Tongue {
        led: cells.get(2)?.replace("led_", "") + " nm",
        truth: number(9)?,
        by_mean: by_mean.unwrap_or(interval),
        median: number(10)?,
        interval,
    })
}

fn panel(title: &str, tongues: &[Tongue], of: impl Fn(&Tongue) -> ([f64; 2], Option<f64>)) -> Panel {
    let axis = |label: &str| Axis::linear(label, "%", [0.0, 40.0]);
    let diagonal = vec![[0.0, 0.0], [40.0, 40.0]];
    let mut panel = Panel::new(axis("true share of porphyrin"), axis("estimate, 95 %"))
        .sized(400.0, 400.0)
        .titled(title)
        .with(Series::dashed("truth", Ink::Muted, diagonal, Dash::Dashed));
    let mut leds: Vec<&String> = tongues.iter().map(|tongue| &tongue.led).collect();
    leds.sort();
    leds.dedup();
    for (place, led) in leds.into_iter().enumerate() {
        let ink = Ink::cycle(place);
        let mut medians = Vec::new();
        for tongue in tongues.iter().filter(|tongue| tongue.led == *led) {
            let (interval, median) = of(tongue);
            let x = 100.0 * tongue.truth;
            let points = interval.map(|end| [x, 100.0 * end]).to_vec();
            panel =
                panel.with(Series::unnamed(ink, SeriesShape::Line { points, width: 1.2, dash: Dash::Solid }));
            medians.push([x, 100.0 * median.unwrap_or(interval[1])]);
        }
        panel = panel.with(Series {
            name: Some(led.clone()),
            ink,
            shape: SeriesShape::Markers { points: medians, radius: 3.0, hollow: false },
        });
    }
    panel
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [table, figure] = arguments.as_slice() else { return Err("give the table and the figure".into()) };
    let text = fs::read_to_string(table)?;
    let tongues: Vec<Tongue> = text.lines().filter_map(tongue).collect();
    let panels = vec![
        panel("Mean of the region, upper end", &tongues, |tongue| (tongue.by_mean, None)),
        panel("Squares of the region, median", &tongues, |tongue| (tongue.interval, Some(tongue.median))),
    ];
    fs::write(figure, Figure::grid("Porphyrin of drawn tongues before R, G and B", panels, 2).to_svg())?;
    Ok(())
}
