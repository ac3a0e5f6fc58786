//! The camera behind the scene's point of view: lens, viewing filters, sensor.

use std::sync::Arc;

use crate::optics::{CameraLens, FilterStack, IdealLens};
use crate::sensor::Sensor;
use crate::spectral::Curve;

/// Lens, viewing filters and sensor. Position and direction are part of the scene
/// ([`crate::scene::Scene::camera`]).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Camera {
    /// The lens; `None` in a study of a scene only.
    pub lens: Option<Lens>,
    /// Filters in front of the lens or behind it.
    pub view_filter: ViewFilter,
    /// The sensor; `None` in a study of a scene only.
    pub sensor: Option<Sensor>,
    /// Whether the field of view of the scene's camera follows from the lens and the sensor, so that it may change with
    /// them.
    pub field_from_lens: bool,
    /// Reflectances whose colors the color matrices of previews and raw files are fitted to, as in the characterization
    /// of a camera with a chart. Previews keep the sensor's own channels where there are none.
    pub training_reflectances: Vec<Curve>,
}

impl Camera {
    /// The lens with the viewing filters as part of its transmittance, on the axis and at heights on the film. The
    /// products are formed at fine sampling. `None` without a lens.
    pub fn lens_behind_filters(&self) -> Option<IdealLens> {
        let lens = &self.lens.as_ref()?.equation;
        let filter = &self.view_filter;
        let at_height = |(height_mm, curve): &(f64, Curve)| (*height_mm, lens.transmittance.times(curve));
        Some(IdealLens {
            transmittance: lens.transmittance.times(&filter.transmittance),
            field_transmittance: filter.off_axis.iter().map(at_height).collect(),
            ..lens.clone()
        })
    }

    /// Transmittance of the lens for the light of the viewing filters themselves: 1 where they stand behind it.
    pub fn lens_before_filters(&self) -> Curve {
        match &self.lens {
            Some(lens) if !self.view_filter.stack.behind_lens => lens.equation.transmittance.clone(),
            _ => Curve::constant(1.0),
        }
    }

    /// The rays of a traced lens.
    pub fn traced_lens(&self) -> Option<&Arc<CameraLens>> {
        self.lens.as_ref()?.traced.as_ref()
    }
}

/// A lens without the viewing filters.
#[derive(Clone, Debug, PartialEq)]
pub struct Lens {
    /// The camera equation; of a traced lens that of its focal length, f-number, magnification and traced solid angle.
    pub equation: IdealLens,
    /// The rays of a traced lens. A render goes through it where the scene's camera holds it, too.
    pub traced: Option<Arc<CameraLens>>,
}

impl From<IdealLens> for Lens {
    fn from(equation: IdealLens) -> Self {
        Self { equation, traced: None }
    }
}

/// The viewing filters of a camera and what they transmit behind its lens.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewFilter {
    /// The filters, one by one, and the angles at which light passes them.
    pub stack: FilterStack,
    /// Transmittance of all of them on the optical axis, at those angles.
    pub transmittance: Curve,
    /// Transmittance at heights on the film, mm, rising from 0, where the filters are averaged over the angles of the
    /// rays; empty: `transmittance` holds everywhere.
    pub off_axis: Vec<(f64, Curve)>,
}

impl Default for ViewFilter {
    /// No filter.
    fn default() -> Self {
        Self { stack: FilterStack::default(), transmittance: Curve::constant(1.0), off_axis: Vec::new() }
    }
}

/// Heights on the film at which filters are averaged over the angles of the rays.
const FILM_HEIGHTS: usize = 13;

impl ViewFilter {
    /// Filters that all light passes at the angle of the stack.
    pub fn at_fixed_angle(stack: FilterStack) -> Self {
        let transmittance = stack.at_angle(stack.angle_deg);
        Self { stack, transmittance, off_axis: Vec::new() }
    }

    /// The same filters behind a lens: where the stack takes the angles of the rays of the lens and a filter moves with
    /// the angle, its transmittance is averaged over them, on the axis and, for a film of this width and height, mm, at
    /// heights on it.
    #[must_use]
    pub fn with_lens(mut self, lens: &Lens, film_mm: Option<[f64; 2]>) -> Self {
        let stack = &self.stack;
        let moves = stack.filters.iter().any(|filter| filter.effective_index.is_some());
        if !(stack.lens_angles && moves) {
            return self;
        }
        let angles = |height_mm: f64| match &lens.traced {
            Some(traced) => traced.filter_angles(height_mm, stack.behind_lens),
            None => Some(lens.equation.filter_angles(height_mm, stack.behind_lens)),
        };
        if let Some(axis) = angles(0.0) {
            self.transmittance = stack.transmittance(&axis);
        }
        if let Some([width_mm, height_mm]) = film_mm {
            let step_mm = 0.5 * width_mm.hypot(height_mm) / (FILM_HEIGHTS - 1) as f64;
            let heights = (0..FILM_HEIGHTS).map(|node| node as f64 * step_mm);
            // Where no light arrives the filter does not matter.
            let at = |height_mm| {
                angles(height_mm).map_or_else(|| self.transmittance.clone(), |a| stack.transmittance(&a))
            };
            self.off_axis = heights.map(|height_mm| (height_mm, at(height_mm))).collect();
        }
        self
    }
}
