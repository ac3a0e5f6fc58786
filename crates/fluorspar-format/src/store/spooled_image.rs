//! Images that do not fit into memory: rows wait in a file until the image is written.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use crate::FormatError;
use crate::image::exr::{ExrOptions, write_spooled_component_exr, write_spooled_spectral_exr};
use fluorspar::image::ComponentImage;
use fluorspar::spectral::{Quantity, WavelengthGrid};

/// Spectral images of one size, row by row in a file without a name, which goes with the process, however that ends.
///
/// The rows of a band of the image are added as they get finished, in any order. What is written in the end has the
/// bytes that the same image in memory gives. Values are kept as `[row][image][band][col]`, so that the lines of an
/// OpenEXR file, one band of one row each, lie in one piece.
#[derive(Debug)]
pub struct SpooledImage {
    file: File,
    /// For messages.
    folder: PathBuf,
    grid: WavelengthGrid,
    width: usize,
    height: usize,
    /// First band of each image, and the end of the last.
    starts: Vec<usize>,
    /// Largest magnitude of each image that is finite.
    brightest: Vec<f32>,
    /// Error of reading lines for a writer that can't fail.
    failure: Mutex<Option<io::Error>>,
}

impl SpooledImage {
    /// A place for images of `height` rows, `width` columns and so many `stored` bands each, in a file in `folder`. It takes
    /// 4 bytes for each pixel and band; rows that are never added are zeros.
    ///
    /// # Errors
    /// When the file can't be made.
    pub fn create(
        folder: &Path,
        (width, height): (usize, usize),
        grid: WavelengthGrid,
        stored: &[usize],
    ) -> Result<Self, FormatError> {
        let failed = |source| FormatError::io(folder, "make a temporary file in", source);
        let file = tempfile::tempfile_in(folder).map_err(failed)?;
        let ends = stored.iter().scan(0, |end, bands| {
            *end += bands;
            Some(*end)
        });
        let starts: Vec<usize> = std::iter::once(0).chain(ends).collect();
        file.set_len(4 * (width * height * starts[stored.len()]) as u64).map_err(failed)?;
        let failure = Mutex::new(None);
        Ok(Self {
            file,
            folder: folder.into(),
            grid,
            width,
            height,
            brightest: vec![0.0; stored.len()],
            starts,
            failure,
        })
    }

    /// Adds rows of one of the images, `[row][col][coefficient]`.
    ///
    /// # Errors
    /// Rows that do not fill the width or lie outside of the image, a full disk.
    pub fn add_rows(&mut self, image: usize, first_row: usize, values: &[f32]) -> Result<(), FormatError> {
        let width = self.width;
        let is_there = image < self.images();
        let bands = if is_there { self.starts[image + 1] - self.starts[image] } else { 0 };
        if is_there && bands == 0 && values.is_empty() {
            return Ok(());
        }
        let rows = values.len() / (bands * width).max(1);
        if rows * bands * width != values.len() || first_row + rows > self.height || !is_there {
            return Err(FormatError::unwritable(
                &self.folder,
                format!("{} values at row {first_row} do not fill rows of image {image}", values.len()),
                "Give whole rows of the image",
            ));
        }
        let mut line = vec![0_u8; 4 * bands * width];
        for (row, values) in values.chunks_exact(bands * width).enumerate() {
            for (band, line) in line.chunks_exact_mut(4 * width).enumerate() {
                for (col, bytes) in line.chunks_exact_mut(4).enumerate() {
                    bytes.copy_from_slice(&values[col * bands + band].to_le_bytes());
                }
            }
            let offset = self.offset(image, first_row + row, 0);
            write_at(&self.file, &line, offset)
                .map_err(|source| FormatError::io(&self.folder, "write to a temporary file in", source))?;
        }
        let finite = values.iter().map(|v| v.abs()).filter(|v| v.is_finite());
        self.brightest[image] = finite.fold(self.brightest[image], f32::max);
        Ok(())
    }

    /// Writes the first image as [`crate::write_spectral_exr`] does.
    ///
    /// # Errors
    /// As there, and when the rows can't be read back.
    pub fn write_spectral_exr<Q: Quantity>(
        &self,
        path: &Path,
        options: &ExrOptions<'_>,
    ) -> Result<(), FormatError> {
        write_spooled_spectral_exr::<Q>(path, self, options)
    }

    /// Writes all images as the components of `labels`, then the half-buffers and the variance of its statistics, as
    /// [`crate::write_component_exr`] does: image `c` is component `c`, and after the components follow the first
    /// half-buffers of all statistics, the second ones, and the variances. `labels` holds everything else of the image;
    /// its own data and those of its statistics are ignored.
    ///
    /// # Errors
    /// As there, when the number of images is another, and when the rows can't be read back.
    pub fn write_component_exr(
        &self,
        path: &Path,
        labels: &ComponentImage,
        options: &ExrOptions<'_>,
    ) -> Result<(), FormatError> {
        write_spooled_component_exr(path, self, labels, options)
    }

    pub(crate) fn grid(&self) -> &WavelengthGrid {
        &self.grid
    }

    pub(crate) fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    pub(crate) fn images(&self) -> usize {
        self.starts.len() - 1
    }

    pub(crate) fn brightest(&self, image: usize) -> f32 {
        self.brightest[image]
    }

    /// One band of a row, from a column on; zeros where the file can't be read, which [`Self::check`] tells.
    pub(crate) fn line(&self, image: usize, band: usize, row: usize, col: usize) -> Vec<f32> {
        let mut bytes = vec![0; 4 * (self.width - col)];
        if let Err(error) = read_at(&self.file, &mut bytes, self.offset(image, row, band) + 4 * col as u64) {
            self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
            bytes.fill(0);
        }
        bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
    }

    /// Whether all lines so far could be read.
    pub(crate) fn check(&self) -> io::Result<()> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
    }

    fn offset(&self, image: usize, row: usize, band: usize) -> u64 {
        4 * ((row * self.starts[self.images()] + self.starts[image] + band) * self.width) as u64
    }
}

#[cfg(unix)]
fn write_at(file: &File, bytes: &[u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, offset)
}

#[cfg(unix)]
fn read_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

/// Where there are no positions without a cursor, one at a time moves it.
#[cfg(not(unix))]
static CURSOR: Mutex<()> = Mutex::new(());

#[cfg(not(unix))]
fn write_at(mut file: &File, bytes: &[u8], offset: u64) -> io::Result<()> {
    use std::io::{Seek, SeekFrom, Write};
    let _one = CURSOR.lock().unwrap_or_else(PoisonError::into_inner);
    file.seek(SeekFrom::Start(offset))?;
    file.write_all(bytes)
}

#[cfg(not(unix))]
fn read_at(mut file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    use std::io::{Read, Seek, SeekFrom};
    let _one = CURSOR.lock().unwrap_or_else(PoisonError::into_inner);
    file.seek(SeekFrom::Start(offset))?;
    file.read_exact(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ExrCompression, write_component_exr, write_spectral_exr};
    use fluorspar::image::{Component, LightPath, SampleStatistics, StatisticsKind};
    use fluorspar::spectral::Radiance;

    fn image() -> ComponentImage {
        let grid = WavelengthGrid::uniform(400.0, 420.0, 5.0).unwrap();
        let label = |light| Component::of_group("blue", light);
        let components = vec![label(LightPath::Reflected), label(LightPath::MultipleFluorescence)];
        let mut image = ComponentImage::zeros(grid, 21, 37, components);
        let value = |i: usize| ((i * 2_654_435_761) % 1009) as f32 * 0.37 / (1 + i % 7) as f32;
        image.data.iter_mut().enumerate().for_each(|(i, v)| *v = value(i));
        let plane = image.data.len() / 2;
        let list = |seed: usize| (0..plane).map(|i| value(i + seed)).collect();
        image.statistics = Some(SampleStatistics {
            of: StatisticsKind::LightGroups,
            names: vec!["blue".into()],
            half_a: list(5),
            half_b: list(6),
            variance: list(7),
        });
        image.features.depth_m = (0..21 * 37).map(|i| i as f32).collect();
        image
    }

    #[test]
    fn files_have_the_bytes_of_the_image_in_memory() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let image = image();
        let statistics = image.statistics.as_ref().unwrap();
        let plane = image.data.len() / 2;
        let planes = [
            &image.data[..plane],
            &image.data[plane..],
            &statistics.half_a,
            &statistics.half_b,
            &statistics.variance,
        ];
        let mut spool =
            SpooledImage::create(folder.path(), (21, 37), image.grid.clone(), &[image.grid.len(); 5])
                .unwrap();
        let row = 21 * image.grid.len();
        // In bands, out of order.
        for rows in [32..37, 0..16, 16..32] {
            for (number, plane) in planes.iter().enumerate() {
                spool.add_rows(number, rows.start, &plane[rows.start * row..rows.end * row]).unwrap();
            }
        }
        let mut labels = image.clone();
        labels.data = Vec::new();
        if let Some(statistics) = &mut labels.statistics {
            (statistics.half_a, statistics.half_b, statistics.variance) =
                (Vec::new(), Vec::new(), Vec::new());
        }
        let sum = image.recombine(|_| 1.0);
        let mut of_sum =
            SpooledImage::create(folder.path(), (21, 37), image.grid.clone(), &[image.grid.len()]).unwrap();
        of_sum.add_rows(0, 0, sum.data()).unwrap();
        for compression in [
            ExrCompression::Uncompressed,
            ExrCompression::Zip,
            ExrCompression::Half,
            ExrCompression::Rounded24,
        ] {
            let options = ExrOptions { compression, ..ExrOptions::default() };
            write_component_exr(&path("memory.exr"), &image, &options).unwrap();
            spool.write_component_exr(&path("spool.exr"), &labels, &options).unwrap();
            let same = |a: &str, b: &str| std::fs::read(path(a)).unwrap() == std::fs::read(path(b)).unwrap();
            assert!(same("memory.exr", "spool.exr"), "{compression:?}");
            write_spectral_exr(&path("memory.exr"), &sum, &options).unwrap();
            of_sum.write_spectral_exr::<Radiance>(&path("spool.exr"), &options).unwrap();
            assert!(same("memory.exr", "spool.exr"), "{compression:?}");
        }
        // What does not fit is refused, and nothing is left behind.
        assert!(spool.add_rows(0, 37, &planes[0][..row]).is_err());
        assert!(spool.add_rows(0, 0, &planes[0][..row - 1]).is_err());
        assert!(of_sum.write_component_exr(&path("bad.exr"), &labels, &ExrOptions::default()).is_err());
        assert!(!path("bad.exr").exists());
        let names = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(names, 2, "the temporary files have no names");
    }
}
