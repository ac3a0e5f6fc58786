//! A lens: its section with rays, spots, MTF, and what happens along the radius of the field.

use fluorspar::optics::{FieldMtf, LensReport};
use fluorspar::units::digits_text;

use crate::{Axis, Dash, Figure, Ink, Label, Panel, Series, SeriesShape};

/// Width of the drawing inside its axes, px.
const DRAWING_PX: f64 = 760.0;
/// Largest height of the drawing, px.
const TALLEST_PX: f64 = 620.0;

/// Name of a field in legends.
fn field_name(height_mm: f64) -> String {
    if height_mm == 0.0 {
        "on the axis".into()
    } else {
        format!("{} mm off the axis", digits_text(height_mm, 3))
    }
}

/// The lens cut along its axis, with the rays of three film points. One scale along both axes.
pub fn lens_drawing(report: &LensReport) -> Figure {
    let drawing = &report.drawing;
    let elements = || drawing.elements.iter().flatten().copied();
    let rays = || drawing.fans.iter().flat_map(|fan| fan.rays.iter().flatten().copied());
    let [film_mm, film_height_mm] = drawing.film;
    let reach =
        elements().map(|[_, y]| y.abs()).chain([film_height_mm, drawing.stop_rim_mm]).fold(0.0_f64, f64::max);
    let first = elements().map(|[z, _]| z).chain([drawing.stop[0]]).fold(0.0_f64, f64::min);
    // Room for the rays in front, and for the film behind.
    let length = film_mm - first;
    let x = [first - 0.3 * length, film_mm + 0.04 * length];
    let inside = |z: f64| z >= x[0] - length;
    let tallest =
        rays().filter(|[z, _]| inside(*z) && *z >= x[0]).map(|[_, y]| y.abs()).fold(reach, f64::max);
    let half = 1.08 * tallest.min(1.6 * reach);
    let scale = (DRAWING_PX / (x[1] - x[0])).min(TALLEST_PX / (2.0 * half));
    let mut panel =
        Panel::new(Axis::linear("along the axis", "mm", x), Axis::linear("height", "mm", [-half, half]))
            .sized(scale * (x[1] - x[0]), scale * 2.0 * half);
    for outline in &drawing.elements {
        let ink = Ink::PALETTE[0];
        panel =
            panel.with(Series::unnamed(ink, SeriesShape::Area { outline: outline.clone(), opacity: 0.12 }));
        let mut points = outline.clone();
        points.extend(outline.first().copied());
        panel = panel
            .with(Series::unnamed(Ink::Text, SeriesShape::Line { points, width: 1.2, dash: Dash::Solid }));
    }
    let axis =
        SeriesShape::Line { points: vec![[x[0], 0.0], [x[1], 0.0]], width: 0.8, dash: Dash::DashDotted };
    panel = panel.with(Series::unnamed(Ink::Muted, axis));
    for (index, fan) in drawing.fans.iter().enumerate() {
        for (number, ray) in fan.rays.iter().enumerate() {
            let shape = SeriesShape::Line { points: clipped(ray, x[0], half), width: 1.0, dash: Dash::Solid };
            let name = (number == 0).then(|| field_name(fan.height_mm));
            panel = panel.with(Series { name, ink: Ink::cycle(index + 1), shape });
        }
    }
    let [stop_mm, stop_height] = drawing.stop;
    let rim = drawing.stop_rim_mm.max(1.15 * stop_height);
    for side in [1.0, -1.0] {
        let points = vec![[stop_mm, side * stop_height], [stop_mm, side * rim]];
        panel = panel
            .with(Series::unnamed(Ink::Text, SeriesShape::Line { points, width: 3.0, dash: Dash::Solid }));
    }
    let film = vec![[film_mm, -film_height_mm], [film_mm, film_height_mm]];
    panel = panel
        .with(Series::unnamed(Ink::Text, SeriesShape::Line { points: film, width: 2.5, dash: Dash::Solid }))
        .with(Series::unnamed(
            Ink::Text,
            SeriesShape::Labels(vec![
                Label { at: [stop_mm, rim], text: "stop".into() },
                Label { at: [film_mm, film_height_mm], text: "film".into() },
            ]),
        ));
    Figure::new(format!("{}: {} mm f/{}", report.name, digits_text(report.paraxial.focal_length_mm, 3), digits_text(report.f_number, 3)), panel)
        .explained(format!(
            "The lens cut along its axis, drawn to scale: glass shaded, the stop as thick bars, the film on the right. Rays \
             at {} nm come from the object on the left and meet the film at three heights; the image is upside down. \
             Rays that the rims or the stop block are left out.",
            digits_text(report.wavelength_nm, 3)
        ))
}

/// A line cut off where it enters the image: at `left`, and where it comes nearer to the axis than `half`.
fn clipped(points: &[[f64; 2]], left: f64, half: f64) -> Vec<[f64; 2]> {
    let mut points = points.to_vec();
    if let [a, b, ..] = points.as_slice() {
        let (a, b) = (*a, *b);
        let slope = (b[1] - a[1]) / (b[0] - a[0]);
        let mut start = a[0].max(left);
        let at = |z: f64| b[1] + slope * (z - b[0]);
        if at(start).abs() > half && slope != 0.0 {
            let edge = half.copysign(at(start));
            start = b[0] + (edge - b[1]) / slope;
        }
        points[0] = [start, at(start)];
    }
    points
}

/// Spots of three heights, side by side at one scale, with the Airy disc of the axis.
pub fn lens_spots(report: &LensReport) -> Figure {
    let airy_um = 1e-3 * 1.21967 * report.wavelength_nm * report.working_f_number;
    let offset = |spot: &fluorspar::optics::Spot, point: &[f64; 2]| {
        [1e3 * (point[1] - spot.centroid_mm[1]), 1e3 * (point[0] - spot.centroid_mm[0])]
    };
    let largest = report
        .spots
        .iter()
        .flat_map(|spot| spot.points_mm.iter().map(move |point| offset(spot, point)))
        .map(|[x, y]| x.abs().max(y.abs()))
        .fold(1.2 * airy_um, f64::max);
    let limit = 1.1 * largest;
    let airy: Vec<[f64; 2]> = (0..=72)
        .map(|i| f64::from(i) * 5_f64.to_radians())
        .map(|angle| [airy_um * angle.cos(), airy_um * angle.sin()])
        .collect();
    let panels = report
        .spots
        .iter()
        .enumerate()
        .map(|(index, spot)| {
            let points = spot.points_mm.iter().map(|point| offset(spot, point)).collect();
            let dots = SeriesShape::Dots { points, radius: 1.1, opacity: 0.6 };
            let rms = spot
                .rms_radius_mm
                .map_or_else(|| "no light".into(), |rms| format!("rms {} um", digits_text(1e3 * rms, 3)));
            let disc = SeriesShape::Line { points: airy.clone(), width: 1.5, dash: Dash::Solid };
            let name = (index == 0).then(|| "first dark ring of diffraction on the axis".into());
            Panel::new(
                Axis::linear("across", "um", [-limit, limit]),
                Axis::linear("away from the axis", "um", [-limit, limit]),
            )
            .sized(220.0, 220.0)
            .titled(format!("{}: {rms}", field_name(spot.height_mm)))
            .with(Series::unnamed(Ink::cycle(index + 1), dots))
            .with(Series { name, ink: Ink::Text, shape: disc })
        })
        .collect();
    Figure::grid(format!("{}: spots", report.name), panels, 3).explained(format!(
        "Where the rays of one object point land on the film, about their centroid, at {} nm and without diffraction; the \
         circle is the first dark ring of the diffraction of a perfect lens.",
        digits_text(report.wavelength_nm, 3)
    ))
}

/// MTF over frequency, and through focus.
pub fn lens_mtf(report: &LensReport) -> Figure {
    let mtf = &report.mtf;
    let zip = |x: &[f64], y: &[f64]| -> Vec<[f64; 2]> { x.iter().zip(y).map(|(x, y)| [*x, *y]).collect() };
    let contrast = || Axis::linear("MTF", "", [0.0, 1.0]);
    let top = mtf.frequency_per_mm.last().copied().unwrap_or(1.0);
    let mut frequency =
        Panel::new(Axis::linear("frequency", "cycles per mm", [0.0, top]), contrast()).sized(420.0, 320.0);
    let ends = [mtf.focus_shift_mm.first(), mtf.focus_shift_mm.last()].map(|x| x.copied().unwrap_or(0.0));
    let nu = mtf.through_focus_frequency_per_mm;
    let mut focus = Panel::new(Axis::linear("film moved away from the lens", "mm", ends), contrast())
        .sized(420.0, 320.0)
        .titled(format!("through focus, {} cycles per mm", digits_text(nu, 3)));
    let limit = zip(&mtf.frequency_per_mm, &mtf.diffraction_limit);
    frequency = frequency.titled("at the film").with(Series::dashed(
        "diffraction limit",
        Ink::Text,
        limit,
        Dash::DashDotted,
    ));
    for (index, field) in mtf.fields.iter().enumerate() {
        let FieldMtf { tangential, sagittal, through_focus_tangential, through_focus_sagittal, .. } = field;
        let name = field_name(field.height_mm);
        let ink = Ink::cycle(index + 1);
        frequency = frequency
            .with(Series::line(format!("{name}, tangential"), ink, zip(&mtf.frequency_per_mm, tangential)))
            .with(Series::dashed(
                format!("{name}, sagittal"),
                ink,
                zip(&mtf.frequency_per_mm, sagittal),
                Dash::Dashed,
            ));
        let unnamed = |values: &[f64], dash: Dash| {
            let points = zip(&mtf.focus_shift_mm, values);
            Series::unnamed(ink, SeriesShape::Line { points, width: 2.0, dash })
        };
        focus = focus
            .with(unnamed(through_focus_tangential, Dash::Solid))
            .with(unnamed(through_focus_sagittal, Dash::Dashed));
    }
    Figure::grid(format!("{}: MTF", report.name), vec![frequency, focus], 2).explained(
        "Contrast of fine lines from the rays alone, without diffraction; lines across the radius of the field (tangential) \
         and along it (sagittal). What a camera sees is at most this times the diffraction limit.",
    )
}

/// Relative illumination, distortion and field curvature along the radius of the field.
pub fn lens_field(report: &LensReport) -> Figure {
    let field = &report.field;
    let top = field.last().map_or(1.0, |point| point.height_mm);
    let height = || Axis::linear("height on the film", "mm", [0.0, top]);
    let curve = |f: &dyn Fn(&fluorspar::optics::FieldPoint) -> Option<f64>| -> Vec<[f64; 2]> {
        field.iter().map(|point| [point.height_mm, f(point).unwrap_or(f64::NAN)]).collect()
    };
    let symmetric = |curves: &[&[[f64; 2]]], least: f64| {
        let values = curves.iter().flat_map(|curve| curve.iter()).map(|point| point[1].abs());
        let largest = values.filter(|v| v.is_finite()).fold(least, f64::max);
        [-1.1 * largest, 1.1 * largest]
    };
    let illumination = curve(&|point| Some(point.relative_illumination));
    let cos4 = curve(&|point| Some(point.image_angle_deg?.to_radians().cos().powi(4)));
    let distortion = curve(&|point| point.distortion_percent);
    let (tangential, sagittal) = (curve(&|p| p.tangential_focus_mm), curve(&|p| p.sagittal_focus_mm));
    let panels = vec![
        Panel::new(height(), Axis::linear("relative illumination", "", [0.0, 1.1]))
            .with(Series::line("traced", Ink::cycle(0), illumination))
            .with(Series::dashed("cos⁴ of the chief ray at the film", Ink::Muted, cos4, Dash::Dashed)),
        Panel::new(height(), Axis::linear("distortion", "%", symmetric(&[&distortion], 0.1))).with(
            Series::unnamed(
                Ink::cycle(0),
                SeriesShape::Line { points: distortion, width: 2.0, dash: Dash::Solid },
            ),
        ),
        Panel::new(
            height(),
            Axis::linear(
                "focus beyond the film",
                "mm",
                symmetric(&[&tangential, &sagittal], 1e-3 * report.paraxial.focal_length_mm),
            ),
        )
        .with(Series::line("tangential focus", Ink::cycle(1), tangential))
        .with(Series::dashed("sagittal focus", Ink::cycle(2), sagittal, Dash::Dashed)),
    ];
    let panels = panels.into_iter().map(|panel| panel.sized(280.0, 260.0)).collect();
    Figure::grid(format!("{}: field", report.name), panels, 3).explained(
        "Along the radius of the field: irradiance under an even scene over that on the axis; height over that of an image \
         without distortion; where narrow beams come to a focus.",
    )
}
