//! Files of figures.

use std::path::Path;

use fluorspar_report::Figure;

use crate::{Error, Result};

/// A figure as files, scalable and in pixels.
pub(crate) fn figure_files(name: &str, figure: &Figure) -> Result<[(String, Vec<u8>); 2]> {
    Ok([(format!("{name}.svg"), figure.to_svg().into_bytes()), (format!("{name}.png"), figure.to_png()?)])
}

/// How a figure is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FigureFormat {
    /// Scalable.
    Svg,
    /// Pixels.
    Png,
}

impl FigureFormat {
    /// By the ending of the file's name.
    ///
    /// # Errors
    /// Another ending.
    pub fn of(path: &Path) -> Result<Self> {
        let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        match ending.as_deref() {
            Some("svg") => Ok(Self::Svg),
            Some("png") => Ok(Self::Png),
            _ => Err(Error::Input(format!("⟨out={}⟩: the name must end in .svg or .png", path.display()))),
        }
    }

    /// The file of a figure.
    ///
    /// # Errors
    /// A figure that can't be drawn in pixels.
    pub fn bytes(self, figure: &Figure) -> Result<Vec<u8>> {
        Ok(match self {
            Self::Svg => figure.to_svg().into_bytes(),
            Self::Png => figure.to_png()?,
        })
    }
}
