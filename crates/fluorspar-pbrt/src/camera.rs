//! Camera, film, sampler and integrator.

use std::sync::Arc;

use fluorspar::optics::{Aperture, CameraLens, LensSetting, LensState, PerspectiveCamera};
use fluorspar::quote::excerpt;
use fluorspar::render::RenderSettings;
use fluorspar_format::{PbrtEntity, PbrtError, PbrtPlaced, read_lens};
use glam::{DVec2, DVec3};

use crate::convert::{Convert, usual_settings};
use crate::given::Given;

/// Cameras that see through a pinhole. ISET calls it by its own name.
const PINHOLES: &[&str] = &["perspective", "pinhole"];

/// Cameras with a lens of a file.
const LENSES: &[&str] = &["realistic", "omni"];

/// Integrators that render all light, each in its way; others leave some of it out, or show something else.
const FULL_TRANSPORT: &[&str] = &[
    "path",
    "volpath",
    "spectralpath",
    "simplepath",
    "simplevolpath",
    "lightpath",
    "randomwalk",
    "bdpt",
    "mlt",
    "sppm",
];

/// Largest image, pixels a side.
const MOST_PIXELS: f64 = 100_000.0;

/// A rectangle of the plane of the image.
struct Window {
    /// Half of the width.
    half: f64,
    /// The middle off the axis, to the right and up, in halves of the width.
    center: DVec2,
    /// Columns and rows.
    size: [usize; 2],
}

impl Window {
    /// The part of the window whose pixels a crop takes.
    fn cropped(self, crop: &Crop) -> Self {
        let pitch = 2.0 * self.half / self.size[0] as f64;
        let [[left, right], [top, bottom]] = [crop.columns, crop.rows].map(|ends| ends.map(|end| end as f64));
        let half = 0.5 * pitch * (right - left);
        let [width, height] = self.size.map(|side| side as f64);
        let moved = 0.5 * pitch * DVec2::new(left + right - width, height - top - bottom);
        Self {
            half,
            center: (self.center * self.half + moved) / half,
            size: [crop.columns, crop.rows].map(|[from, to]| to - from),
        }
    }
}

/// The pixels of a film that are wanted: first, and past the last.
struct Crop {
    columns: [usize; 2],
    rows: [usize; 2],
}

impl Crop {
    /// `pixelbounds`, or `cropwindow` in shares of the sides, rounded up as in pbrt; all pixels without them. `None` where no pixel is left.
    fn of_film(given: &Given<'_>, [width, height]: [usize; 2]) -> Option<Self> {
        let pixel = |place: f64, side: usize| place.ceil().clamp(0.0, side as f64) as usize;
        let shares = given.numbers("cropwindow");
        let [x0, x1, y0, y1] = match (given.numbers("pixelbounds"), shares) {
            (Some(&[x0, x1, y0, y1]), _) => [x0, x1, y0, y1],
            (_, Some(&[x0, x1, y0, y1])) => {
                // With the precision of pbrt: seven hundredths of 100 pixels are 7, not 8.
                let part = |share: f64, side: usize| f64::from(share as f32 * side as f32);
                [
                    part(x0.min(x1), width),
                    part(x0.max(x1), width),
                    part(y0.min(y1), height),
                    part(y0.max(y1), height),
                ]
            }
            _ => [0.0, width as f64, 0.0, height as f64],
        };
        let crop = Self {
            columns: [pixel(x0, width), pixel(x1, width)],
            rows: [pixel(y0, height), pixel(y1, height)],
        };
        [crop.columns, crop.rows].iter().all(|[from, to]| from < to).then_some(crop)
    }

    fn is_cropped(&self, [width, height]: [usize; 2]) -> bool {
        self.columns != [0, width] || self.rows != [0, height]
    }
}

impl Convert<'_> {
    /// The camera and the settings of the render.
    pub(crate) fn camera(&mut self) -> Result<(PerspectiveCamera, RenderSettings), PbrtError> {
        let tree = self.tree;
        let (size, crop) = self.film()?;
        let [width, height] = size;
        let none = PbrtPlaced {
            entity: PbrtEntity { class: "perspective".into(), ..PbrtEntity::default() },
            to_world: glam::DMat4::IDENTITY,
        };
        let camera = tree.settings.camera.as_ref().unwrap_or(&none);
        let given = Given::new(&camera.entity);
        given.used(&["shutteropen", "shutterclose"]);
        let class = camera.entity.class.as_str();
        let at = camera.entity.at;
        let is_parallel = class == "orthographic";
        if !PINHOLES.contains(&class) && !LENSES.contains(&class) && !is_parallel {
            let message = format!(
                "Camera \"{}\" has no counterpart; \"perspective\", \"orthographic\", and \"realistic\" with a lens file, have one",
                excerpt(class)
            );
            return Err(self.error(at, message));
        }
        let is_lens = LENSES.contains(&class);
        let window = if is_lens {
            if crop.is_cropped(size) {
                self.remark(at, "the crop of the film: the whole image is rendered");
            }
            Window { half: 0.5, center: DVec2::ZERO, size }
        } else {
            self.window(&given, width, height)?.cropped(&crop)
        };
        // Of parallel rays the window is in units of the camera's frame, else on the plane at distance 1.
        let tan_half_width =
            if is_lens || is_parallel { 0.5 } else { self.tan_half_field(&given)? * window.half };
        let half_window = is_parallel.then_some(window.half);

        // Place the axes of the camera in the scene
        let map = self.scene_from_world() * camera.to_world;
        let axis = |direction: DVec3| map.transform_vector3(direction).try_normalize();
        let (Some(right), Some(up), Some(forward)) = (axis(DVec3::X), axis(DVec3::Y), axis(DVec3::Z)) else {
            return Err(self.error(at, "the transform of the camera flattens space; change it"));
        };
        if right.dot(up).abs().max(right.dot(forward).abs()).max(up.dot(forward).abs()) > 1e-4 {
            self.remark(at, "the axes of the camera are not at right angles; they are set straight");
        }
        let right = (right - forward * right.dot(forward)).normalize();
        let mut view = PerspectiveCamera {
            position: map.transform_point3(DVec3::ZERO).as_vec3(),
            forward: forward.as_vec3(),
            right: right.as_vec3(),
            up: right.cross(forward).as_vec3(),
            tan_half_width: tan_half_width as f32,
            width: window.size[0],
            height: window.size[1],
            center: window.center.as_vec2(),
            lens: None,
            aperture: self.aperture(&given, map.transform_vector3(DVec3::Z).length()),
            parallel_half_width_m: half_window
                .map(|half| (half * map.transform_vector3(DVec3::X).length()) as f32),
        };
        if is_lens {
            self.lens(&given, &mut view)?;
        }
        given.finish("Camera", &mut self.remarks);
        if view.position.is_finite() {
            Ok((view, self.settings()))
        } else {
            Err(self.error(at, "the camera is too far away; change its transform"))
        }
    }

    /// Tangent of half the field of view across the narrower side of the image.
    fn tan_half_field(&mut self, given: &Given<'_>) -> Result<f64, PbrtError> {
        let at = given.entity.at;
        let degrees = given.number("fov").or(given.number("halffov").map(|half| 2.0 * half)).unwrap_or(90.0);
        if !(degrees > 0.0 && degrees < 179.0) {
            return Err(
                self.error(at, format!("a field of view of {degrees} degrees; give one between 0 and 179"))
            );
        }
        Ok((0.5 * degrees.to_radians()).tan())
    }

    /// The aperture of a perspective camera, with meters per unit of the camera.
    fn aperture(&mut self, given: &Given<'_>, scale: f64) -> Option<Arc<Aperture>> {
        let radius = given.number("lensradius").unwrap_or(0.0);
        let focus = given.number("focaldistance").unwrap_or(1e6);
        if given.entity.class == "orthographic" && radius > 0.0 {
            self.remark(
                given.entity.at,
                "\"lensradius\": parallel rays have no lens, everything is in focus",
            );
            return None;
        }
        let [radius, focus] = [radius, focus].map(|length| (scale * length) as f32);
        (radius > 0.0 && focus > 0.0).then(|| Arc::new(Aperture::new(radius, focus)))
    }

    /// The window of the whole image.
    fn window(&mut self, given: &Given<'_>, width: usize, height: usize) -> Result<Window, PbrtError> {
        let at = given.entity.at;
        let pixels = width as f64 / height as f64;
        let aspect = given.number("frameaspectratio").unwrap_or(pixels);
        let mut window = Window { half: aspect.max(1.0), center: DVec2::ZERO, size: [width, height] };
        if let Some(&[x0, x1, y0, y1]) = given.numbers("screenwindow") {
            if x1 <= x0 || y1 <= y0 {
                let message = "an empty screenwindow; give \"screenwindow\" [left right bottom top]";
                return Err(self.error(at, message));
            }
            window.half = 0.5 * (x1 - x0);
            window.center = DVec2::new(x0 + x1, y0 + y1) / (x1 - x0);
            if ((x1 - x0) / (y1 - y0) / pixels - 1.0).abs() > 1e-3 {
                self.remark(at, "\"screenwindow\": pixels are square here; its width is kept");
            }
        } else if (aspect / pixels - 1.0).abs() > 1e-3 {
            self.remark(at, "\"frameaspectratio\": pixels are square here; the width of the field is kept");
        }
        Ok(window)
    }

    /// Puts the lens of a file before the film.
    fn lens(&mut self, given: &Given<'_>, view: &mut PerspectiveCamera) -> Result<(), PbrtError> {
        let at = given.entity.at;
        let Some(name) = given.text("lensfile") else {
            return Err(self.error(at, "this camera needs a lens; add \"string lensfile\" \"FILE.dat\""));
        };
        let path = self.tree.path_of(at, name);
        let lens = read_lens(&path).map_err(|error| self.error(at, error.to_string()))?;
        self.read.push(path);
        let distance = given.number("focusdistance").or(given.number("focaldistance")).unwrap_or(10.0);
        let diameter = given.number("aperturediameter").or(given.number("aperture"));
        given.used(&["simpleweighting", "aperturediameter", "aperture"]);
        let diagonal_mm =
            self.tree.settings.film.as_ref().and_then(|film| film.number("diagonal")).unwrap_or(35.0);
        let (width, height) = (view.width as f64, view.height as f64);
        let pitch_mm = diagonal_mm / width.hypot(height);
        let distance_mm = distance * self.options.unit_m * 1e3;
        if diameter.is_some() {
            self.remark(at, "\"aperturediameter\": the stop of the lens file is kept");
        }
        let setting =
            LensSetting { f_number: None, object_distance_mm: Some(distance_mm), film_shift_mm: 0.0 };
        let state = LensState::new(&lens, setting).map_err(|error| self.error(at, error.to_string()))?;
        // The film of pbrt stands at the origin of the camera, here the entrance pupil does.
        let pupil_mm = state.film_mm - state.reference_mm;
        let traced = CameraLens::new(state, width * pitch_mm, height * pitch_mm, &self.options.grid, 1);
        self.note(
            at,
            "the image is lens radiance: irradiance on the film over the solid angle that the pupil fills on the axis",
        );
        view.position += view.forward * (pupil_mm * 1e-3) as f32;
        view.lens = Some(Arc::new(traced));
        Ok(())
    }

    /// Columns and rows of the whole image, and the part of it that is wanted.
    fn film(&mut self) -> Result<([usize; 2], Crop), PbrtError> {
        let Some(film) = &self.tree.settings.film else {
            return Ok(([1280, 720], Crop { columns: [0, 1280], rows: [0, 720] }));
        };
        let given = Given::new(film);
        let size = [("xresolution", 1280.0), ("yresolution", 720.0)]
            .map(|(name, default)| given.number(name).unwrap_or(default));
        if size.iter().any(|side| !(1.0..=MOST_PIXELS).contains(side)) {
            let message =
                format!("an image of {} x {} pixels; give 1 to {MOST_PIXELS} a side", size[0], size[1]);
            return Err(self.error(film.at, message));
        }
        let size = size.map(|side| side as usize);
        let crop = Crop::of_film(&given, size).ok_or_else(|| {
            self.error(film.at, "the crop of the film holds no pixel; give [left right top bottom]")
        })?;
        // What is done with the light afterwards, and what a lens asks for.
        given.used(&[
            "diagonal",
            "filename",
            "iso",
            "exposuretime",
            "maxcomponentvalue",
            "maxsampleluminance",
            "savefp16",
            "scale",
            "sensor",
            "whitebalance",
            "nbuckets",
            "lambdamin",
            "lambdamax",
            "coordinatesystem",
            "fnumber",
            "spectralFlag",
        ]);
        given.finish("Film", &mut self.remarks);
        Ok((size, crop))
    }

    fn settings(&mut self) -> RenderSettings {
        let mut settings = usual_settings();
        let tree = self.tree;
        if let Some(seed) = tree.settings.seed {
            settings.seed = seed;
        }
        if let Some(sampler) = &tree.settings.sampler {
            let given = Given::new(sampler);
            let strata = [given.number("xsamples"), given.number("ysamples")].map(|n| n.unwrap_or(4.0));
            let usual = match sampler.class.as_str() {
                "stratified" => strata[0] * strata[1],
                "random" | "independent" => 4.0,
                _ => 16.0,
            };
            let wanted = given.number("pixelsamples").unwrap_or(usual).clamp(1.0, 1e6);
            settings.samples_per_pixel = wanted as u32;
            if let Some(seed) = given.number("seed") {
                settings.seed = seed.max(0.0) as u64;
            }
            self.note(
                sampler.at,
                format!("Sampler \"{}\": samples are Owen-scrambled Sobol points", excerpt(&sampler.class)),
            );
        }
        if let Some(integrator) = &tree.settings.integrator {
            let given = Given::new(integrator);
            let depth = given.number("maxdepth").unwrap_or(5.0);
            if depth < 1.0 {
                self.remark(integrator.at, "\"maxdepth\" 0: direct light is rendered as well");
            }
            settings.max_depth = depth.clamp(1.0, 1000.0) as u32;
            if given.find("pixelbounds").is_some() {
                self.remark(integrator.at, "\"pixelbounds\": the whole image is rendered");
            }
            let class = excerpt(&integrator.class);
            if !FULL_TRANSPORT.contains(&integrator.class.as_str()) {
                let text = format!(
                    "Integrator \"{class}\": all light is rendered by path tracing, also what this integrator leaves out"
                );
                self.remark(integrator.at, text);
            } else if !["path", "volpath"].contains(&integrator.class.as_str()) {
                self.note(
                    integrator.at,
                    format!("Integrator \"{class}\": light transport is by path tracing"),
                );
            }
        }
        settings
    }
}
