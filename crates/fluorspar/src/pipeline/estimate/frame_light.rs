//! The light under which a frame shows its region.

use crate::analysis::{PixelSelection, SceneOnSensor};
use crate::geometry::OrientedPoint;
use crate::pipeline::capture::direct_light::{axis_point, irradiance_on, region_points};
use crate::spectral::Curve;
use crate::study::{Capture, Study};

/// Irradiance spectrum under the lights that a developed frame holds, W/(m² nm): the mean over the points of a region, or
/// where the camera's axis meets the plane in focus. `None` when the frame is dark.
///
/// Direct light, unoccluded. Where no light meets the lit side of any point (a region in its own shadow), the surface
/// is taken to face the camera: the proportions of the lights matter here, not the level.
pub(crate) fn frame_light(
    study: &Study,
    capture: &Capture,
    region: Option<(SceneOnSensor<'_>, &PixelSelection)>,
) -> Option<Curve> {
    let mut points = region.map(|(scene, region)| region_points(study, scene, region)).unwrap_or_default();
    if points.is_empty() {
        points.push(axis_point(study));
    }
    irradiance_on(study, capture, &points).or_else(|| {
        let camera = study.scene.camera.position.as_dvec3();
        let toward = |point: &OrientedPoint| OrientedPoint {
            normal: (camera - point.position).try_normalize().unwrap_or(point.normal),
            ..*point
        };
        let facing: Vec<OrientedPoint> = points.iter().map(toward).collect();
        irradiance_on(study, capture, &facing)
    })
}
