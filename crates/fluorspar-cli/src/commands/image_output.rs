//! Image files that `render`, `merge` and `denoise` write.

use std::path::{Path, PathBuf};

use clap::{ValueEnum, ValueHint};
use fluorspar::image::{ComponentImage, ExcitationImage};
use fluorspar::pipeline::radiance_preview;
use fluorspar::spectral::Radiance;
use fluorspar_format::{
    CubeForm, ExrCompression, ExrOptions, Output, Outputs, Provenance, SpooledImage, write_component_exr,
    write_component_npy, write_rgb_png, write_spectral_exr, write_spectral_npy,
};
use serde_json::{Value, json};

use super::light_of_capture::CaptureLight;
use crate::error::CliError;

/// Path and format of an image.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct ImageOutput {
    /// File of the image: .exr (spectral OpenEXR) or .npy (NumPy, with a .json next to it).
    #[arg(long, value_name = "FILE", default_value = "radiance.exr", value_hint = ValueHint::FilePath)]
    pub(crate) out: PathBuf,
    /// Write one layer per light group and fluorophore instead of their sum under the light of one capture.
    #[arg(long)]
    pub(crate) components: bool,
    /// Storage of the values in OpenEXR.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) storage: Storage,
    /// Also write an sRGB preview (PNG).
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub(crate) preview: Option<PathBuf>,
}

/// Precision of the values in an OpenEXR file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum Storage {
    /// 32 bits: nothing is lost.
    #[default]
    Full,
    /// 24 bits.
    #[value(help = lossy_help("24 bits", ExrCompression::Rounded24, "a third"))]
    Rounded24,
    /// 16 bits at a scale per layer.
    #[value(help = lossy_help("16 bits at a scale per layer", ExrCompression::Half, "a sixth"))]
    Half,
}

/// Help of a form that rounds values.
fn lossy_help(form: &str, compression: ExrCompression, share: &str) -> String {
    format!("{form}: relative error up to {:.1e}, {share} of the size", compression.relative_error())
}

fn has_extension(path: &Path, wanted: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(wanted))
}

impl ImageOutput {
    /// Refuses names that don't tell a format, before any work is done.
    pub(crate) fn check(&self) -> Result<(), CliError> {
        if !has_extension(&self.out, "exr") && !has_extension(&self.out, "npy") {
            let out = self.out.display();
            let hint = match CubeForm::of(&self.out) {
                Some(form) => {
                    let apart = if self.components && form == CubeForm::Zarr { " --components" } else { "" };
                    format!(
                        "write components to an .exr, then this from it: `fluorspar cube FILE.exr{apart} --out {out}`"
                    )
                }
                None => "for an sRGB image add --preview FILE.png".into(),
            };
            return Err(CliError::Input(format!(
                "--out {out}: the name must end in .exr or .npy, which keep every band; {hint}"
            )));
        }
        if self.storage != Storage::Full && has_extension(&self.out, "npy") {
            return Err(CliError::Input("--storage is for .exr files; .npy keeps 32 bits".into()));
        }
        match &self.preview {
            Some(path) if !has_extension(path, "png") => {
                Err(CliError::Input(format!("--preview {}: the name must end in .png", path.display())))
            }
            _ => Ok(()),
        }
    }

    /// The image, of at most so many bytes, and the preview.
    pub(crate) fn outputs(&self, bytes: u64) -> Outputs {
        let outputs = Outputs::new().and(Output::file("--out", &self.out).of_bytes(bytes));
        match &self.preview {
            Some(path) => outputs.and(Output::early("--preview", path)),
            None => outputs,
        }
    }

    fn compression(&self) -> ExrCompression {
        match self.storage {
            Storage::Full => ExrCompression::Zip,
            Storage::Rounded24 => ExrCompression::Rounded24,
            Storage::Half => ExrCompression::Half,
        }
    }

    /// Refuses what needs the whole image in memory. `why` is why it is not there, `instead` how it would be.
    pub(crate) fn check_for_bands(&self, why: &str, instead: &str) -> Result<(), CliError> {
        let refuse = |what: String, hint: &str| {
            Err(CliError::Input(format!(
                "{what}: {why}, so that the image is rendered in bands of rows; {hint}, or {instead}"
            )))
        };
        if has_extension(&self.out, "npy") {
            return refuse(format!("--out {}", self.out.display()), "write an .exr file");
        }
        if let Some(path) = &self.preview {
            return refuse(format!("--preview {}", path.display()), "leave the preview out");
        }
        Ok(())
    }

    /// Writes an image whose rows wait in a file; `labels` is all of it but its values.
    pub(crate) fn write_spooled(
        &self,
        spool: &SpooledImage,
        labels: &ComponentImage,
        provenance: &Provenance,
    ) -> Result<(), CliError> {
        let exr = ExrOptions {
            compression: self.compression(),
            provenance: Some(provenance),
            ..Default::default()
        };
        if self.components {
            spool.write_component_exr(&self.out, labels, &exr)?;
        } else {
            spool.write_spectral_exr::<Radiance>(&self.out, &exr)?;
        }
        Ok(())
    }

    /// Refuses forms that can't hold an excitation basis.
    pub(crate) fn check_for_basis(&self) -> Result<(), CliError> {
        if self.components && has_extension(&self.out, "exr") {
            return Ok(());
        }
        Err(CliError::Input(format!(
            "--out {}: an excitation basis (render.excitation_basis_nm) is kept beside the components of an .exr file; add \
             --components and write an .exr file, or remove the field",
            self.out.display()
        )))
    }

    /// Whether a sum of components is written.
    pub(crate) fn sums(&self) -> bool {
        !self.components || self.preview.is_some()
    }

    /// Writes the image and the preview.
    pub(crate) fn write(&self, image: &ComponentImage, provenance: &Provenance) -> Result<(), CliError> {
        self.write_with(image, None, provenance, &CaptureLight::default())
    }

    /// Writes the image with its excitation basis, if it has one, and the preview. Sums are under this light.
    pub(crate) fn write_with(
        &self,
        image: &ComponentImage,
        excitation: Option<&ExcitationImage>,
        provenance: &Provenance,
        light: &CaptureLight,
    ) -> Result<(), CliError> {
        let exr = ExrOptions {
            compression: self.compression(),
            provenance: Some(provenance),
            excitation,
            ..Default::default()
        };
        let npy = has_extension(&self.out, "npy");
        if self.components && npy {
            write_component_npy(&self.out, image, Some(provenance))?;
        } else if self.components {
            write_component_exr(&self.out, image, &exr)?;
        }
        if self.components && self.preview.is_none() {
            return Ok(());
        }
        let sum = image.recombine(|component| light.weight(component));
        if !self.components && npy {
            write_spectral_npy(&self.out, &sum, Some(provenance))?;
        } else if !self.components {
            write_spectral_exr(&self.out, &sum, &exr)?;
        }
        if let Some(path) = &self.preview {
            let picture = radiance_preview(&sum);
            write_rgb_png(path, picture.width, picture.height, &picture.rgb)?;
        }
        Ok(())
    }

    /// JSON description of an image.
    pub(crate) fn describe(&self, image: &ComponentImage, light: &CaptureLight) -> Value {
        let mean = image.recombine(|component| light.weight(component)).mean_spectrum();
        self.describe_with(image, mean.values(), light)
    }

    /// The same with the mean spectrum given, for images without values.
    pub(crate) fn describe_with(
        &self,
        image: &ComponentImage,
        mean_radiance: &[f64],
        light: &CaptureLight,
    ) -> Value {
        json!({
            "file": self.out,
            "width_px": image.width,
            "height_px": image.height,
            "samples_per_pixel": image.samples_per_pixel,
            "most_samples_per_pixel": image.samples.iter().max().unwrap_or(&image.samples_per_pixel),
            "wavelength_nm": image.grid.centers_nm(),
            "components": image.components.iter().map(|c| c.label()).collect::<Vec<_>>(),
            "capture": light.json(),
            "mean_radiance": mean_radiance,
            "unit": "W/(sr m^2 nm)",
        })
    }
}
