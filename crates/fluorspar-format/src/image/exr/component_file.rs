//! Component images opened by part: labels and feature maps at once, spectra when they are asked for.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use exr::block::UncompressedBlock;
use exr::meta::attribute::SampleType;
use exr::meta::header::Header;
use exr::prelude::f16;

use super::read::{
    BandChannels, attribute, bands, component_parts, damaged, decode, for_each_block, headers, parse_json,
    provenance, read_component_exr, read_features, scale_of,
};
use super::rounded_rows::rows_of_24_bits;
use super::{COMPONENT, DENOISED, EXCITATION, ExcitationLabel};
use crate::image::basis_text::floats_of_text;
use crate::image::npy::{check_finite, is_npy, read_component_npy};
use crate::store::file::{check_image_size, guarded, most_image_bytes};
use crate::{FormatError, Loaded, Provenance};
use fluorspar::image::{
    BasisComponent, ComponentImage, ComponentRows, ExcitationImage, GroupBasis, LightPath, SpectralBasis,
};
use fluorspar::spectral::{ExcitationNodes, Radiance};

/// A component image whose spectra stay in the file until rows of them are read ([`ComponentRows`]). Opening reads the labels
/// of the components and the feature maps.
///
/// Of OpenEXR files the wanted parts are read, block by block; images in NumPy form, which have no parts, are read as a whole.
#[derive(Debug)]
pub struct ComponentFile {
    path: PathBuf,
    state: FileState,
    labels: ComponentImage,
    provenance: Option<Provenance>,
    spectra: Spectra,
}

/// What tells a file from another one that took its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct FileState {
    bytes: u64,
    modified: Option<SystemTime>,
}

impl FileState {
    fn of(path: &Path) -> Result<Self, FormatError> {
        let metadata = std::fs::metadata(path).map_err(|source| FormatError::io(path, "read", source))?;
        Ok(Self { bytes: metadata.len(), modified: metadata.modified().ok() })
    }
}

#[derive(Debug)]
enum Spectra {
    /// In the labels themselves.
    Memory,
    /// In the parts of an OpenEXR file.
    Parts {
        /// Headers of all parts.
        headers: Vec<Header>,
        /// For each component its part, the band of each channel, and the scale of stored values.
        components: Vec<BandPart>,
        /// Parts with an excitation basis.
        excitation: Vec<(usize, ExcitationLabel)>,
    },
}

#[derive(Debug)]
struct BandPart {
    part: usize,
    bands: Vec<Option<usize>>,
    scale: Option<f64>,
}

impl ComponentFile {
    /// Opens a component image in either form, known by how the file begins.
    ///
    /// # Errors
    /// As [`crate::read_component_image`], but that damage within the spectra shows when they are read.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        Self::open_with(path, true)
    }

    /// [`Self::open`] without the feature maps, of which only names and view are read: captures need no more.
    ///
    /// # Errors
    /// Those of [`Self::open`].
    pub fn open_without_maps(path: &Path) -> Result<Self, FormatError> {
        Self::open_with(path, false)
    }

    fn open_with(path: &Path, with_maps: bool) -> Result<Self, FormatError> {
        let state = FileState::of(path)?;
        if is_npy(path)? {
            let Loaded { image, provenance } = read_component_npy(path)?;
            return Ok(Self {
                path: path.into(),
                state,
                labels: image,
                provenance,
                spectra: Spectra::Memory,
            });
        }
        guarded(path, "OpenEXR", || Self::open_parts(path, state, with_maps))
    }

    /// When the file was written and how long it is, as it was opened: what is read later must be of the same.
    ///
    /// # Errors
    /// A file that was written anew, or is gone.
    pub fn check_unchanged(&self) -> Result<(), FormatError> {
        if FileState::of(&self.path)? == self.state {
            return Ok(());
        }
        let what = "the file was written anew since it was opened";
        Err(FormatError::unsupported(&self.path, what, "Open it again, to see what is in it now"))
    }

    fn open_parts(path: &Path, state: FileState, with_maps: bool) -> Result<Self, FormatError> {
        let headers = headers(path)?;
        let parts = component_parts(path, &headers)?;
        let (width, height) = (parts.size.width(), parts.size.height());
        let length = std::fs::metadata(path).map_err(|source| FormatError::io(path, "read", source))?.len();
        let per_pixel = 4 * (parts.stored().sum::<usize>() / (width * height).max(1)) as u64;
        check_image_size(path, width as u64, height as u64, per_pixel, most_image_bytes(length))?;
        let mut components = Vec::with_capacity(parts.components.len());
        let mut excitation = Vec::new();
        for (part, header) in headers.iter().enumerate() {
            if attribute(header, COMPONENT).is_some() {
                let BandChannels { bands, .. } = bands::<Radiance>(path, header)?;
                components.push(BandPart { part, bands, scale: scale_of(path, header)? });
            } else if let Some(text) = attribute(header, EXCITATION) {
                let label: ExcitationLabel = parse_json(path, EXCITATION, &text)?;
                let size = (header.layer_size.width(), header.layer_size.height());
                if size != (width, height) || label.rank != header.channels.list.len() {
                    let what = "the excitation basis does not fit the image";
                    return Err(FormatError::malformed(path, what, "Write the file again"));
                }
                excitation.push((part, label));
            }
        }
        let (features, samples) = read_features(path, &headers, parts.size, with_maps)?;
        let labels = ComponentImage {
            data: Vec::new(),
            samples_per_pixel: parts.samples_per_pixel,
            samples,
            features,
            denoised: headers.iter().find_map(|header| attribute(header, DENOISED)),
            ..ComponentImage::zeros(parts.grid, width, height, Vec::new())
        };
        Ok(Self {
            path: path.into(),
            state,
            labels: ComponentImage { components: parts.components, bases: parts.bases, ..labels },
            provenance: provenance(path, &headers)?,
            spectra: Spectra::Parts { headers, components, excitation },
        })
    }

    /// The image without its values: grid, size, labels, samples, feature maps. Statistics are left in the file. (An image in
    /// NumPy form is whole.)
    pub fn labels(&self) -> &ComponentImage {
        &self.labels
    }

    /// Where the image comes from, if the file states it.
    pub fn provenance(&self) -> Option<&Provenance> {
        self.provenance.as_ref()
    }

    /// The excitation basis of the image, if the file holds one.
    ///
    /// # Errors
    /// A damaged file.
    pub fn excitation_basis(&self) -> Result<Option<ExcitationImage>, FormatError> {
        let Spectra::Parts { headers, excitation, .. } = &self.spectra else { return Ok(None) };
        let (width, height) = (self.labels.width, self.labels.height);
        let mut basis = ExcitationImage { width, height, groups: Vec::new() };
        if excitation.is_empty() {
            return Ok(None);
        }
        for ((_, label), factors) in excitation.iter().zip(self.factors(headers, excitation)?) {
            let component = self.basis_component(label, factors)?;
            match basis.groups.iter_mut().find(|group| group.light_group == label.light_group) {
                Some(group) => group.components.push(component),
                None => basis.groups.push(GroupBasis {
                    light_group: label.light_group.clone(),
                    nodes: ExcitationNodes::new(label.nodes_nm.clone())
                        .map_err(|error| FormatError::malformed(&self.path, error.to_string(), DAMAGED))?,
                    components: vec![component],
                }),
            }
        }
        Ok(Some(basis))
    }

    /// Factors of the components of an excitation basis, `[spectrum][row][col]` each.
    fn factors(
        &self,
        headers: &[Header],
        parts: &[(usize, ExcitationLabel)],
    ) -> Result<Vec<Vec<f32>>, FormatError> {
        let pixels = self.labels.width * self.labels.height;
        guarded(&self.path, "OpenEXR", || {
            let mut targets: Vec<_> =
                headers.iter().map(|header| vec![None; header.channels.list.len()]).collect();
            let mut buffers = Vec::with_capacity(parts.len());
            for (buffer, (part, label)) in parts.iter().enumerate() {
                for (number, target) in targets[*part].iter_mut().enumerate() {
                    *target = Some(super::read::Target { buffer, offset: number * pixels, stride: 1 });
                }
                buffers.push(vec![0.0; label.rank * pixels]);
            }
            decode(&self.path, headers, &targets, &mut buffers)?;
            self.check_unchanged()?;
            Ok(buffers)
        })
    }

    fn basis_component(
        &self,
        label: &ExcitationLabel,
        factors: Vec<f32>,
    ) -> Result<BasisComponent, FormatError> {
        let damage = || FormatError::malformed(&self.path, "the excitation basis is damaged", DAMAGED);
        let spectra = floats_of_text(&label.spectra).ok_or_else(damage)?;
        let nodes = if label.light == LightPath::Reflected { 1 } else { label.nodes_nm.len() };
        if spectra.len() != label.rank * nodes * self.labels.grid.len() {
            return Err(damage());
        }
        let light = label.light.clone();
        Ok(BasisComponent { light, spectra, factors, rank: label.rank, error: label.error })
    }

    /// The whole image, with its statistics.
    ///
    /// # Errors
    /// A damaged file.
    pub fn read(self) -> Result<Loaded<ComponentImage>, FormatError> {
        match self.spectra {
            Spectra::Memory => Ok(Loaded { image: self.labels, provenance: self.provenance }),
            Spectra::Parts { .. } => {
                let read = read_component_exr(&self.path)?;
                self.check_unchanged()?;
                Ok(read)
            }
        }
    }
}

/// What to do about a damaged file.
const DAMAGED: &str = "Copy the file again";

impl ComponentRows for ComponentFile {
    type Error = FormatError;

    fn basis(&self, component: usize) -> Option<&SpectralBasis> {
        self.labels.basis(component)
    }

    fn map_rows<T: Send>(
        &self,
        wanted: impl Fn(usize) -> bool + Sync,
        visit: impl Fn(usize, usize, &[f32]) -> T + Sync,
    ) -> Result<Vec<(usize, usize, T)>, FormatError> {
        let Spectra::Parts { headers, components, .. } = &self.spectra else {
            let Ok(found) = self.labels.map_rows(wanted, visit);
            return Ok(found);
        };
        let of_part = |part: usize| {
            components.iter().position(|found| found.part == part).filter(|found| wanted(*found))
        };
        let is_wanted = |part: usize| of_part(part).is_some();
        self.check_unchanged()?;
        let found = for_each_block(&self.path, headers.len(), is_wanted, |block| {
            let part = block.part();
            let Some(component) = of_part(part) else { return Ok(Vec::new()) };
            let (header, bands) = (&headers[part], &components[component]);
            let mut rows = Vec::with_capacity(header.compression.scan_lines_per_block());
            let mut checked = Ok(());
            let mut keep = |row: usize, lines: &[f32]| {
                if checked.is_ok() {
                    checked = check_finite(&self.path, lines);
                }
                rows.push((component, row, visit(component, row, lines)));
            };
            let is_visited = bands.scale.is_none()
                && rows_of_24_bits(&self.path, header, &bands.bands, &block, &mut keep)?;
            if !is_visited {
                rows_of_block(&self.path, header, bands, &block.unpack()?, keep)?;
            }
            checked.map(|()| rows)
        })?;
        self.check_unchanged()?;
        let found: Vec<(usize, usize, T)> = found.into_iter().flatten().collect();
        self.check_rows(&found, wanted)?;
        Ok(found)
    }
}

impl ComponentFile {
    /// Every row of the wanted components must be there once: a damaged table of blocks leads to some twice.
    fn check_rows<T>(
        &self,
        found: &[(usize, usize, T)],
        wanted: impl Fn(usize) -> bool,
    ) -> Result<(), FormatError> {
        let height = self.labels.height;
        let mut seen = vec![false; self.labels.components.len() * height];
        for (component, row, _) in found {
            if let Some(seen) = seen.get_mut(component * height + row) {
                *seen = true;
            }
        }
        let is_missing = |(index, seen): (usize, &bool)| wanted(index / height) && !seen;
        if !seen.iter().enumerate().any(is_missing) {
            return Ok(());
        }
        Err(FormatError::malformed(&self.path, "rows of the image are missing", "Copy the file again"))
    }
}

/// Calls `visit` for each row of a block with `[band][col]`. Only blocks as wide as the image have whole rows.
fn rows_of_block(
    path: &Path,
    header: &Header,
    part: &BandPart,
    block: &UncompressedBlock,
    mut visit: impl FnMut(usize, &[f32]),
) -> Result<(), FormatError> {
    let width = header.layer_size.width();
    if block.index.pixel_size.width() != width {
        let hint = "Save it in scan lines, or write it with Fluorspar";
        return Err(FormatError::unsupported(path, "the image is stored in tiles", hint));
    }
    let broken = |error: exr::error::Error| damaged(path, &error);
    let bands = part.bands.iter().flatten().count();
    let mut lines = vec![0.0_f32; bands * width];
    let mut halves = vec![f16::ZERO; width];
    let mut seen = 0;
    for line in block.lines(&header.channels) {
        let channel = line.location.channel;
        let row = line.location.position.y();
        if let Some(Some(band)) = part.bands.get(channel) {
            let out = &mut lines[band * width..][..width];
            match header.channels.list[channel].sample_type {
                SampleType::F32 => line.read_samples_into_slice::<f32>(out).map_err(broken)?,
                SampleType::F16 => {
                    line.read_samples_into_slice::<f16>(&mut halves).map_err(broken)?;
                    out.iter_mut().zip(&halves).for_each(|(out, half)| *out = half.to_f32());
                }
                SampleType::U32 => {
                    for (out, value) in out.iter_mut().zip(line.read_samples::<u32>()) {
                        *out = value.map_err(broken)? as f32;
                    }
                }
            }
        }
        seen += 1;
        // Lines of a row follow each other, channel by channel.
        if seen == header.channels.list.len() {
            seen = 0;
            if let Some(scale) = part.scale {
                lines.iter_mut().for_each(|value| *value = (f64::from(*value) * scale) as f32);
            }
            visit(row, &lines);
        }
    }
    Ok(())
}
