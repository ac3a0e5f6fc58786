//! `fluorspar check`: what a check found, in words.

use fluorspar::study::{RegionPlan, Study};
use fluorspar::units::counted;
use fluorspar_session::{CameraView, CheckOptions, CheckedExperiment, CheckedFile, check};

use super::Answering;
use crate::error::CliError;
use crate::message::Messages;
use crate::values::duration;

pub(crate) fn run(options: &Answering<CheckOptions>) -> Result<(), CliError> {
    // Warnings are what is asked for: all of them, as part of the answer or in full.
    let messages = if options.form.json { Messages::Quiet } else { Messages::in_full() };
    let checked = check(&options.task, &messages.job())?;
    options.print(&checked, describe)?;
    if let (CheckedFile::Experiment(_), Some(file), false) = (&checked, &options.task.file, options.form.json)
    {
        messages.status(format!("Next: fluorspar run {file}"));
    }
    Ok(())
}

fn describe(checked: &CheckedFile) -> String {
    match checked {
        CheckedFile::Sample(sample) => format!(
            "{}: valid. A flat sample with {} fluorophores, {} bands",
            sample.file,
            sample.fluorophores.len(),
            sample.bands
        ),
        CheckedFile::Experiment(checked) => describe_experiment(checked),
    }
}

fn describe_experiment(checked: &CheckedExperiment) -> String {
    format!(
        "{}: valid. {}{}, {} in {}, {}, {}\n{}\nA run needs {}, about {} for rendering{}",
        checked.file,
        counted(checked.objects, "object", "objects"),
        match checked.instances {
            0 => String::new(),
            count => format!(" with {count} instances"),
        },
        counted(checked.lights, "light", "lights"),
        counted(checked.light_groups.len(), "group", "groups"),
        counted(checked.fluorophores.len(), "fluorophore", "fluorophores"),
        counted(checked.captures.len(), "capture", "captures"),
        view_text(&checked.camera_view) + &regions_text(&checked.study),
        checked.budget.text(),
        duration(checked.render_seconds),
        if checked.memory_bytes > checked.study.render.memory_limit_bytes {
            "; the film is larger than the limit of render.memory_limit_gib: only `fluorspar render` takes the image, in bands \
             of rows"
        } else {
            ""
        }
    )
}

/// Objects that are named.
const MOST_NAMED: usize = 6;

/// What the camera sees.
fn view_text(view: &CameraView) -> String {
    let field = match (view.width_mm, view.height_mm, view.distance_mm) {
        (Some(width), Some(height), Some(mm)) if mm > 0.0 => {
            format!("{width:.0} x {height:.0} mm at {mm:.0} mm")
        }
        (Some(width), Some(height), _) => format!("{width:.0} x {height:.0} mm"),
        _ => "this".into(),
    };
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let named = view.parts.iter().take(MOST_NAMED).map(|(name, share)| format!("{name} {}", percent(*share)));
    let mut list: Vec<String> = named.collect();
    if view.parts.len() > MOST_NAMED {
        list.push(format!("{} more", view.parts.len() - MOST_NAMED));
    }
    if view.nothing > 0.0 {
        list.push(format!("nothing {}", percent(view.nothing)));
    }
    format!("The camera sees {field}: {}", list.join(", "))
}

/// The regions beside that of the analysis, by name and place; empty without them.
fn regions_text(study: &Study) -> String {
    let one = |region: &RegionPlan| format!("\"{}\" ({})", region.name, region.analysis.region().describe());
    match study.regions.as_slice() {
        [] => String::new(),
        regions => format!(
            "\nFurther regions of frame \"{}\": {}",
            study.analysis.as_ref().map_or("", |plan| plan.frame.as_str()),
            regions.iter().map(one).collect::<Vec<_>>().join(", ")
        ),
    }
}
