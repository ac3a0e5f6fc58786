//! Renders that keep excitation apart by wavelength.

use fluorspar::image::{ComponentImage, ExcitationImage};
use fluorspar::pipeline::render_with_basis;
use fluorspar::render::{BasisSettings, FilmRenderer, Share};
use fluorspar::study::Study;

use crate::error::CliError;
use crate::interrupt::interrupted;
use crate::message::Messages;
use crate::progress::{Keep, fill_with_progress};
use crate::resource_needs::{say_time, seconds_of};

/// Renders with the excitation basis of the settings, in bands of rows where its film does not fit into memory at once.
pub(super) fn render(
    study: &Study,
    basis: &BasisSettings,
    messages: Messages,
) -> Result<(ComponentImage, ExcitationImage), CliError> {
    let (scene, settings) = (&study.scene, &study.render);
    let names: Vec<&str> =
        basis.groups.iter().map(|group| scene.light_groups[*group].name.as_str()).collect();
    let [first, last] = basis.nodes.span_nm();
    messages.status(format!(
        "Excitation basis: {} nodes from {first} to {last} nm for the light of {}",
        basis.nodes.len(),
        names.join(", ")
    ));
    let renderer = FilmRenderer::for_rows(scene, settings)?;
    if !messages.is_quiet() {
        say_time(seconds_of(&renderer, &Share::Whole, None), settings.samples_per_pixel, None, messages)?;
    }
    let rendered = render_with_basis(&renderer, settings, scene, |share, film| {
        fill_with_progress(&renderer, share, film, study.time_limit_s, messages, &Keep::default())
    })?;
    let Some((image, basis)) = rendered else {
        let what = if interrupted() { "interrupted" } else { "ended by the time limit" };
        return Err(CliError::Stopped(format!(
            "{what} before every row had its samples: an excitation basis needs all of them, and nothing was written"
        )));
    };
    for group in &basis.groups {
        let spectra = group.components.iter().map(|component| component.rank);
        messages.status(format!(
            "Light of {}: {} spectra hold every wavelength of excitation, with an error of {:.2} % at most",
            group.light_group,
            spectra.sum::<usize>(),
            100.0 * group.error()
        ));
    }
    Ok((image, basis))
}
