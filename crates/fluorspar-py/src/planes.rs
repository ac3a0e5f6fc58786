//! Channel planes.

use fluorspar::image::ChannelPlanes;
use fluorspar_session::Wanted;
use numpy::PyArray4;
use pyo3::prelude::*;

use crate::components::Components;
use crate::error::failed;
use crate::experiment::Experiment;
use crate::frame::View;
use crate::view::view;

/// Electrons per second that each component of a render frees in each channel of the camera of a capture.
#[pyclass(frozen, module = "fluorspar._fluorspar")]
pub(crate) struct Planes {
    planes: ChannelPlanes,
}

#[pymethods]
impl Planes {
    /// `[component, channel, row, col]`, electrons per second in one pixel, at the rendered powers and concentrations: a view,
    /// read-only.
    #[getter]
    fn electrons_per_s<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray4<f32>>> {
        let planes = &slf.get().planes;
        let shape = (planes.components, planes.channels, planes.height, planes.width);
        view(slf, |this| &this.planes.data, shape)
    }
}

/// The planes of a component image in the camera of one of an experiment's captures; with `lit` those of components under lights that the
/// capture leaves dark are zero, and not formed.
#[pyfunction]
#[pyo3(signature = (experiment, components, capture, *, lit = false, threads = None))]
pub(crate) fn channel_planes(
    experiment: &Bound<'_, Experiment>,
    components: &Bound<'_, Components>,
    capture: &str,
    lit: bool,
    threads: Option<usize>,
) -> PyResult<Planes> {
    let py = experiment.py();
    let wanted = if lit { Wanted::LitBy(capture) } else { Wanted::AllOf(capture) };
    let view = View::of_captures(py, experiment.get(), components.get(), wanted, threads)?;
    let names: Vec<&str> =
        view.study().captures.iter().map(|settings| settings.frame.label.as_str()).collect();
    match view.planes_of(capture) {
        Some(planes) => {
            let mut planes = planes.clone();
            if lit {
                darken_unlit(&view, capture, &mut planes);
            }
            Ok(Planes { planes })
        }
        None => Err(failed(format!("there is no capture \"{capture}\"; there are {}", names.join(", ")))),
    }
}

/// Sets the planes of components under lights that a capture leaves dark to zero, where an earlier question formed them.
fn darken_unlit(view: &View, capture: &str, planes: &mut ChannelPlanes) {
    let Some(settings) = view.study().capture(capture) else { return };
    for (component, of) in view.seen().image.components.iter().enumerate() {
        if settings.frame.drive(&of.light_group) != 0.0 {
            continue;
        }
        for channel in 0..planes.channels {
            if planes.plane(component, channel).iter().any(|value| *value != 0.0) {
                planes.plane_mut(component, channel).fill(0.0);
            }
        }
    }
}
