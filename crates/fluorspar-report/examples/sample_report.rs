//! Draws every figure and one report from made-up data, to look at: `cargo run -p fluorspar-report --example sample_report -- DIR`.
//!
//! Nothing here is a measurement. The shapes are only like those of the paper's camera.

use std::error::Error;
use std::fs;
use std::path::PathBuf;

use fluorspar::analysis::{
    Analysis, AnalysisSettings, Analyte, ChannelNoise, ChromaticityMap, FluorophoreResponse, LineNoise,
    MixtureLine, MixtureModel, PorphyrinMap, Rectangle, RegionOfInterest, analyze_region,
};
use fluorspar::image::ChannelImage;
use fluorspar_report::figures::{
    ChannelValues, ChromaticityPlot, EemMap, PlotCurve, PorphyrinQuantity, chromaticity, eem_maps, emission,
    filters, histograms, lights, picture, porphyrin_map, radiance_by_component, sensor_response,
};
use fluorspar_report::{
    Figure, FrameOrigin, Number, NumberTable, Origin, Raster, ReportData, ReportItem, ReportPicture, Scale,
    Section, analysis_section,
};

const WIDTH: usize = 320;
const HEIGHT: usize = 240;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "sample-report".into()));
    fs::create_dir_all(&folder)?;
    let capture = capture();
    let region = RegionOfInterest::of_rectangle(Rectangle { col: 100, row: 70, width: 120, height: 130 });
    let settings = AnalysisSettings::new(region, noise());
    let (analysis, map, porphyrin) = analyze_region(&capture, None, Some(&model()), None, &settings)?;
    let report = report(&capture, &analysis, &map, porphyrin.as_ref());
    for (number, figure) in figures_of(&report).enumerate() {
        let name = format!("{number:02}-{}", figure.title.to_lowercase().replace([' ', '"', ',', '/'], "-"));
        fs::write(folder.join(format!("{name}.svg")), figure.to_svg())?;
        fs::write(folder.join(format!("{name}.png")), figure.to_png()?)?;
    }
    fs::write(folder.join("report.html"), report.to_html())?;
    Ok(())
}

fn figures_of(report: &ReportData) -> impl Iterator<Item = &Figure> {
    let items = report.sections.iter().flat_map(|section| &section.items);
    items.filter_map(|item| if let ReportItem::Figure { figure, .. } = item { Some(figure) } else { None })
}

fn noise() -> ChannelNoise {
    ChannelNoise { floor_dn: 6.3, dn_per_electron: 0.45, gain_spread: 0.0229, lines: LineNoise::default() }
}

fn curve(name: &str, f: impl Fn(f64) -> f64) -> PlotCurve {
    let wavelength_nm: Vec<f64> = (0..=200).map(|i| 350.0 + 2.0 * f64::from(i)).collect();
    let value = wavelength_nm.iter().map(|&nm| f(nm)).collect();
    PlotCurve::new(name, wavelength_nm, value)
}

fn bell(nm: f64, peak: f64, width: f64) -> f64 {
    (-0.5 * ((nm - peak) / width).powi(2)).exp()
}

fn edge(nm: f64, at: f64, width: f64) -> f64 {
    1.0 / (1.0 + (-(nm - at) / width).exp())
}

fn light(nm: f64) -> f64 {
    bell(nm, 385.0, 5.5) + 2e-3 * bell(nm, 420.0, 22.0) + 3e-5 * bell(nm, 560.0, 90.0)
}

fn short_pass(nm: f64) -> f64 {
    0.92 * (1.0 - edge(nm, 425.0, 2.2)) + 2e-5
}

fn long_pass(nm: f64) -> f64 {
    0.9 * edge(nm, 452.0, 2.6) * (1.0 - edge(nm, 700.0, 3.0)) + 1e-5
}

/// Name, excitation peak and width, emission peaks (height, peak, width).
type Model = (&'static str, f64, f64, &'static [(f64, f64, f64)]);

const FLUOROPHORES: [Model; 5] = [
    ("collagen", 350.0, 28.0, &[(0.8, 425.0, 30.0)]),
    ("elastin", 372.0, 34.0, &[(1.0, 458.0, 42.0)]),
    ("FAD", 448.0, 32.0, &[(0.7, 535.0, 28.0)]),
    ("NADH", 352.0, 22.0, &[(0.6, 462.0, 30.0)]),
    ("porphyrins", 402.0, 16.0, &[(0.9, 635.0, 9.0), (0.3, 702.0, 14.0)]),
];

fn glow((_, excitation, width, bands): &Model, light_nm: f64, nm: f64) -> f64 {
    let emitted: f64 = bands.iter().map(|(height, peak, width)| height * bell(nm, *peak, *width)).sum();
    if nm > light_nm { emitted * bell(light_nm, *excitation, *width) } else { 0.0 }
}

fn channel(index: usize, nm: f64) -> f64 {
    let (peak, width, height) = [(610.0, 34.0, 0.42), (530.0, 36.0, 0.52), (460.0, 28.0, 0.46)][index];
    height * bell(nm, peak, width) + 0.02
}

fn model() -> MixtureModel {
    let response = |fluorophore: &Model| {
        let sum = |c| {
            (0..200)
                .map(|i| 350.0 + 2.0 * f64::from(i))
                .map(|nm| glow(fluorophore, 385.0, nm) * long_pass(nm) * channel(c, nm))
                .sum()
        };
        FluorophoreResponse { name: fluorophore.0.into(), rgb_per_amount: [sum(0), sum(1), sum(2)] }
    };
    MixtureModel {
        responses: FLUOROPHORES.iter().map(response).collect(),
        bulk_weights: vec![("collagen".into(), 0.1), ("elastin".into(), 0.8), ("FAD".into(), 0.1)],
        porphyrin: "porphyrins".into(),
        analyte: Analyte::default(),
        ends: None,
    }
}

/// Numbers between 0 and 1 that look random.
struct Draws(u64);

impl Draws {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// A tongue-like blob, brighter in the middle, with porphyrin toward its back.
fn capture() -> ChannelImage {
    let model = model();
    let line = MixtureLine::from_fluorophores(&model.responses, &model.bulk_weights, &model.porphyrin);
    let mut draws = Draws(7);
    let mut image = ChannelImage {
        width: WIDTH,
        height: HEIGHT,
        channels: ["R", "G", "B"].map(String::from).to_vec(),
        data: Vec::new(),
        saturated: Vec::new(),
        noise_floor_dn: noise().floor_dn,
        full_scale_dn: 4031.0,
        shares: vec![0.25, 0.5, 0.25],
        interpolation: None,
        subtracted: None,
        calibration: None,
        label: "blue".into(),
    };
    for row in 0..HEIGHT {
        for col in 0..WIDTH {
            let (x, y) = ((col as f64 - 160.0) / 95.0, (row as f64 - 140.0) / 90.0);
            let inside = (1.0 - edge(x.hypot(y), 1.0, 0.03)) * (1.0 - 0.35 * x.hypot(y).min(1.0));
            let patch = 0.5 + 0.5 * (7.0 * x + 2.0 * (5.0 * y).sin()).sin() * (6.0 * y).cos();
            let porphyrin = 0.6 * (1.0 - edge(y, -0.1, 0.2)) * patch * bell(x, 0.0, 0.5) + 0.004;
            let rgb = line.as_ref().map_or([0.0; 3], |line| line.rgb(1.0 - porphyrin, porphyrin));
            let highlight = 9e3 * bell(x, 0.3, 0.02) * bell(y, 0.45, 0.02);
            let scale = 260.0 * inside;
            let mut saturated = false;
            for value in rgb {
                let mean = value * scale + 12.0 + highlight;
                let value = mean + draws.normal() * noise().variance(mean).sqrt();
                saturated |= value > image.full_scale_dn;
                image.data.push(value.min(image.full_scale_dn) as f32);
            }
            image.saturated.push(saturated);
        }
    }
    image
}

fn preview(image: &ChannelImage) -> Raster {
    let tone = |value: f32| (255.0 * (f64::from(value).max(0.0) / 1500.0).min(1.0).powf(1.0 / 2.2)) as u8;
    Raster::from_fn(image.width, image.height, |row, col| {
        let pixel = image.pixel(row, col);
        [tone(pixel[0]), tone(pixel[1]), tone(pixel[2])]
    })
}

fn report(
    image: &ChannelImage,
    analysis: &Analysis,
    map: &ChromaticityMap,
    porphyrin: Option<&PorphyrinMap>,
) -> ReportData {
    let mut tongue = Section::new("What the camera sees")
        .with(ReportItem::Pictures(vec![
            ReportPicture {
                png: preview(image).to_png().unwrap_or_default(),
                title: "Blue light".into(),
                caption: "The developed capture under the 385 nm light. Red tones are porphyrins, green and blue tones the bulk."
                    .into(),
            },
            ReportPicture {
                png: Raster::from_fn(160, 120, |row, col| [(col + 60) as u8, (row + 60) as u8, 120]).to_png().unwrap_or_default(),
                title: "White light".into(),
                caption: "A small stand-in picture.".into(),
            },
        ]))
        .show(picture("Region of interest", preview(image), Some([100.0, 70.0, 120.0, 130.0])), "The white box is the region.");
    if let Some(porphyrin) = porphyrin {
        let gray: Vec<u8> = preview(image).pixels.iter().map(|pixel| pixel[1]).collect();
        let figure = porphyrin_map(
            (PorphyrinQuantity::Share, &Analyte::default()),
            [WIDTH, HEIGHT],
            &porphyrin.fractions_on_line(),
            Some(&gray),
            0.5,
        );
        if let Some(figure) = figure {
            tongue = tongue.show(figure, "Porphyrin sits in patches toward the back.");
        }
    }
    let region = analysis.mixture.as_ref().and_then(|mixture| mixture.region);
    let fraction = region.map_or_else(String::new, |region| format!("{:.3}", region.estimate.fraction));
    ReportData {
        title: "Sample report: a tongue under 385 nm".into(),
        live: None,
        overview: None,
        lead: vec![
            "This page shows what a fluorescence camera would record of a tongue lit by a 385 nm LED, and what the recorded colors \
             say about porphyrins. Everything on it is made up, to show what a report looks like."
                .into(),
        ],
        headline: vec![
            Number::computed("Porphyrin fraction", fraction, "", "of the region, from its mean color"),
            Number::computed("Pixels used", analysis.counts.valid.to_string(), "", "bright enough and not saturated"),
            Number::computed("Exposure", "30", "ms", "under the blue light"),
        ],
        warnings: vec!["All data on this page are invented.".to_owned().into()],
        sections: vec![
            tongue,
            analysis_section(
                analysis,
                vec![ReportItem::Figure {
                    figure: chromaticity_figure(analysis, map),
                    caption: String::new(),
                    stem: String::new(),
                }],
                FrameOrigin::Simulated,
            )
                .show(histograms("blue", &channel_values(image), image.full_scale_dn, None), ""),
            radiance_section(),
            parts_section(),
        ],
        provenance: vec![("Fluorspar".into(), "0.1.0".into()), ("Seed".into(), "7".into())],
        experiment_toml: "# every setting\ntitle = \"a < b & c\"\n[camera]\nexposure_s = 0.03\n".into(),
        input_files: Vec::new(),
        rerun_command: "fluorspar run report.html".into(),
    }
}

fn channel_values(image: &ChannelImage) -> Vec<ChannelValues> {
    let values = |channel: usize| image.data.iter().copied().skip(channel).step_by(3).collect();
    let named = image.channels.iter().enumerate();
    named.map(|(index, name)| ChannelValues { name: name.clone(), values: values(index) }).collect()
}

fn chromaticity_figure(analysis: &Analysis, map: &ChromaticityMap) -> Figure {
    let points =
        analysis.fluorophores.iter().filter_map(|f| f.chromaticity.map(|point| (f.name.clone(), point)));
    let inside =
        |pixel: &usize| (100..220).contains(&(pixel % WIDTH)) && (70..200).contains(&(pixel / WIDTH));
    chromaticity(&ChromaticityPlot {
        region: "the tongue".into(),
        pixels: (0..WIDTH * HEIGHT).filter(inside).filter_map(|pixel| map.at(pixel)).collect(),
        fluorophores: points.collect(),
        target: Analyte::default(),
        mixture_line: analysis.mixture.as_ref().map(|mixture| [mixture.bulk, mixture.porphyrin]),
        ellipse: analysis.ellipse.map(|ellipse| ellipse.outline(2.4477, 90)).unwrap_or_default(),
        ..ChromaticityPlot::default()
    })
}

fn glow_curves() -> Vec<PlotCurve> {
    let amounts = [1.0, 8.0, 4.0, 0.8, 2.5];
    let curves = FLUOROPHORES.iter().zip(amounts);
    curves.map(|(f, amount)| curve(f.0, |nm| 1e-5 * amount * glow(f, 385.0, nm))).collect()
}

fn radiance_section() -> Section {
    let glow = glow_curves();
    let reflected = curve("reflected", |nm| 0.4 * 0.08 * light(nm) * short_pass(nm));
    let total = curve("sum", |nm| {
        let index = ((nm - 350.0) / 2.0).round() as usize;
        reflected.value[index] + glow.iter().map(|curve| curve.value[index]).sum::<f64>()
    });
    Section::new("The light that leaves the tongue")
        .show(radiance_by_component(Some(&total), Some(&reflected), &glow, "the tongue", Scale::Log10), "")
        .show(radiance_by_component(None, None, &glow, "the tongue", Scale::Linear), "")
}

fn parts_section() -> Section {
    let eem = |fluorophore: &Model| {
        let (columns, rows) = (40, 68);
        let values = (0..rows).flat_map(|row| (0..columns).map(move |col| (row, col)));
        EemMap {
            name: fluorophore.0.into(),
            excitation_nm: [340.0, 540.0],
            emission_nm: [380.0, 720.0],
            columns,
            values: values
                .map(|(row, col)| glow(fluorophore, 342.5 + 5.0 * col as f64, 382.5 + 5.0 * row as f64))
                .collect(),
        }
    };
    let channels = |f: &dyn Fn(f64) -> f64| -> Vec<PlotCurve> {
        ["R", "G", "B"].iter().enumerate().map(|(i, name)| curve(name, |nm| channel(i, nm) * f(nm))).collect()
    };
    let table = NumberTable {
        caption: "Camera".into(),
        rows: vec![
            Number::computed("Pixel pitch", "2.5", "µm", "Side of one pixel.")
                .from(Origin::Published("Table 1 of the paper".into())),
            Number::computed("f-number", "2.8", "", "Focal length over aperture.")
                .from(Origin::Assumed("not published".into())),
            Number::computed("Filter", "Y44", "", "Long-pass before the lens.")
                .from(Origin::Measured("spectrometer".into())),
        ],
    };
    Section::new("Lights, filters, tissue and sensor")
        .show(
            lights(
                &[
                    curve("blue LED, 385 nm", light),
                    curve("white LED", |nm| bell(nm, 450.0, 9.0) + 0.6 * bell(nm, 560.0, 50.0)),
                ],
                &[
                    curve("short-pass before the LED", short_pass),
                    curve("long-pass before the lens", long_pass),
                ],
            ),
            "",
        )
        .show(
            filters(&[
                curve("short-pass before the LED", short_pass),
                curve("long-pass before the lens", long_pass),
            ]),
            "",
        )
        .show(eem_maps(&FLUOROPHORES.each_ref().map(eem), Some(385.0)), "")
        .show(
            emission(
                &glow_curves(),
                "the blue LED",
                "each at its own assumed amount",
                ["spectral radiance", "W/(sr m² nm)"],
                Some([450.0, 700.0]),
            ),
            "",
        )
        .show(sensor_response(&channels(&|_| 1.0), &[("filtered".into(), channels(&long_pass))]), "")
        .with(ReportItem::Table(table))
}
