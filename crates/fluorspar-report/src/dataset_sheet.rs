//! The data sheet of a set of rendered images, after Gebru et al. 2021, "Datasheets for datasets", Commun. ACM 64(12).

use fluorspar_experiment::ResolvedExperiment;
use serde::Serialize;

use crate::run::scene_rests_on;

/// What a data set holds.
#[derive(Clone, Debug, Serialize)]
pub struct DatasetFacts {
    /// Title.
    pub title: String,
    /// Digest of everything that decides an image.
    pub sha256: String,
    /// Version of the program.
    pub version: String,
    /// Columns and rows of the images.
    pub size_px: [usize; 2],
    /// Names of the views.
    pub views: Vec<String>,
    /// Names of the captures with light: each is an image of each view.
    pub captures: Vec<String>,
    /// Name of the capture whose electrons are told apart.
    pub analyzed: String,
    /// Name of the fluorophore whose share is told; `None` where the analysis looks for none.
    pub porphyrin: Option<String>,
    /// Parts of the data set.
    pub splits: Vec<SplitCounts>,
    /// Lesions of the file.
    pub lesions: Vec<LesionCounts>,
    /// Paths averaged per pixel of the render.
    pub samples_per_pixel: u32,
    /// Whether spectra lie beside the images.
    pub has_spectra: bool,
}

/// How much a part of a data set holds.
#[derive(Clone, Debug, Serialize)]
pub struct SplitCounts {
    /// Its name.
    pub name: String,
    /// People in it.
    pub people: usize,
    /// Images.
    pub images: usize,
    /// Images that show a lesion.
    pub with_lesion: usize,
}

/// How often a lesion is there.
#[derive(Clone, Debug, Serialize)]
pub struct LesionCounts {
    /// Its name.
    pub name: String,
    /// People that have it.
    pub people: usize,
    /// Images that show it.
    pub images: usize,
}

/// What a data set holds, in a line.
#[must_use]
pub fn dataset_in_short(facts: &DatasetFacts) -> String {
    let sum = |of: fn(&SplitCounts) -> usize| facts.splits.iter().map(of).sum::<usize>();
    let (images, people) = (sum(|split| split.images), sum(|split| split.people));
    let with = sum(|split| split.with_lesion);
    let of_splits: Vec<String> =
        facts.splits.iter().map(|split| format!("{} for {}", split.images, split.name)).collect();
    format!("{images} images of {people} people, a lesion in {with} of the images: {}.", of_splits.join(", "))
}

/// The data sheet, as Markdown. The experiment is that of any of its images.
#[must_use]
pub fn dataset_sheet(facts: &DatasetFacts, experiment: &ResolvedExperiment) -> String {
    let DatasetFacts { title, sha256, version, size_px: [width, height], .. } = facts;
    let (views, captures) = (facts.views.join(", "), facts.captures.join(", "));
    let rows = |rows: Vec<String>| rows.concat();
    let splits = rows(
        facts
            .splits
            .iter()
            .map(|s| format!("| {} | {} | {} | {} |\n", s.name, s.people, s.images, s.with_lesion))
            .collect(),
    );
    let lesions = rows(
        facts
            .lesions
            .iter()
            .map(|lesion| {
                let (name, people, images) = (&lesion.name, lesion.people, lesion.images);
                format!("- \"{name}\": {people} people have it, {images} images show it.\n")
            })
            .collect(),
    );
    let rests = rows(scene_rests_on(experiment).into_iter().map(|line| format!("- {line}\n")).collect());
    let share = facts.porphyrin.as_ref().map_or_else(String::new, |name| {
        format!("- `truth/*_share.npy`, `[row, col]`: share of {name} in the light that fluoresced once; nan where none did\n")
    });
    let spectra = match facts.has_spectra {
        true => {
            "- `spectra/*.exr`: radiance of each capture before the lens, W/(sr m² nm), pixels of the render\n"
        }
        false => "",
    };
    format!(
        "# {title}\n\n{short}\n\n\
         Made by Fluorspar {version} from `dataset.toml` alone; digest {sha256}. `fluorspar dataset dataset.toml` makes the same bytes.\n\n\
         ## What it is for\n\n\
         Training and testing of methods that find parts and lesions of a mouth, or its fluorescence, where the truth must be known. \
         Nobody was photographed: no image is of a patient.\n\n\
         ## What it holds\n\n\
         Images of {width} x {height} pixels. Views: {views}. Captures: {captures}.\n\n\
         | part | people | images | with lesion |\n|---|---|---|---|\n{splits}\n{lesions}\n\
         A person is in one part, by a hash of seed and number: more people move nobody.\n\n\
         - `images/*.tiff` with `.json`: raw mosaics, digital numbers; captures without light, too\n\
         - `images/*.png`: developed, sRGB, each scaled to its own white: levels are in the raw frames alone\n\
         - `annotations_*.json`: COCO; each image names its other files\n\
         - `masks/*.png`: 8 bits with palette; numbers are ids of categories, 0 is nothing\n\
         - `truth/*_depth_m.npy`, `[row, col]`: distance from the entrance pupil along the ray, m; 0 where nothing is\n\
         - `truth/*_normal.npy`, `[row, col, 3]`: unit normals toward right, down and forward of the camera\n\
         - `truth/*_electrons.npy`, `[light, row, col]`: electrons of capture \"{analyzed}\" without noise of the sensor, all channels together, by where \
         the light comes from; `electrons` of an image names them\n\
         {share}{spectra}\
         - `images.csv`: a line for each image; its share is that in the first part of the view. `people.csv`: shape, restorations and tissues of each person\n\n\
         Masks and truth are those of the middle of each pixel: the nearest pixel of the render, without the blur of the lens. A pixel is of \
         a lesion where at least half of its change is there. Read arrays with `numpy.load`.\n\n\
         ## What is assumed\n\n\
         - Shape and tissues of people are drawn from published spreads, lesions from the file: both are models. People have as many fillings \
         and crowns as adults; on which teeth and of what is assumed.\n\
         - What its tissues hold is in `people.csv`; how a lesion looks is what `dataset.toml` says, the same in all who have it.\n\
         {rests}\n\
         ## Limits\n\n\
         - The render has noise: {samples} paths for each pixel.\n\
         - Surfaces without volumes, no saliva that flows, no motion but that of the file, no instruments, no blood that runs.\n\
         - What is found here says nothing of patients before it is found in them.\n\n\
         ## License\n\n\
         What you made is yours to license; the program claims nothing. Name version and digest where you publish it.\n",
        short = dataset_in_short(facts),
        analyzed = facts.analyzed,
        samples = facts.samples_per_pixel,
    )
}
