//! What a data set says of its images: COCO, tables, counts.

use std::collections::BTreeMap;

use fluorspar::study::{Capture, Study};
use fluorspar_experiment::people_csv;
use fluorspar_format::csv_cell;
use fluorspar_report::{DatasetFacts, LesionCounts, SplitCounts};
use serde_json::{Value, json};

use super::SOURCE;
use super::categories::Categories;
use super::view_files::{WrittenView, is_lit};
use crate::Result;
use crate::cohort::{CohortWork, Place};
use crate::values::csv;

/// Parts of a data set, with the share of the people below which each ends.
const SPLITS: [(&str, f64); 3] = [("train", 0.6), ("validation", 0.8), ("test", 1.0)];

/// The views of a data set.
pub(super) struct Tables<'a> {
    pub(super) work: &'a CohortWork,
    pub(super) categories: &'a Categories,
    /// That of any view: all have the same captures.
    pub(super) study: &'a Study,
    pub(super) views: &'a BTreeMap<Place, WrittenView>,
}

/// A capture of a view.
struct Image<'a> {
    id: u64,
    split: &'static str,
    person: u32,
    view_name: &'a str,
    view: &'a WrittenView,
    capture: &'a str,
    is_analyzed: bool,
}

impl Image<'_> {
    /// A file of the view.
    fn file(&self, folder: &str, name: &str) -> String {
        format!("{folder}/{}_{name}", self.view.stem)
    }

    fn picture(&self) -> String {
        self.file("images", &format!("{}.png", self.capture))
    }

    fn raw(&self) -> String {
        self.file("images", &format!("{}.tiff", self.capture))
    }

    /// The image of COCO, with the names of the other files.
    fn coco(&self) -> Value {
        let mut image = json!({
            "id": self.id,
            "file_name": self.picture(),
            "width": self.view.size_px[0],
            "height": self.view.size_px[1],
            "raw": self.raw(),
            "person": self.person,
            "view": self.view_name,
            "capture": self.capture,
            "camera": self.view.camera,
            "electrons": self.view.electrons,
        });
        let (masks, truth) = (["lesions", "parts"], ["depth_m", "normal", "electrons", "share"]);
        let masks = masks.map(|name| (format!("{name}_mask"), self.file("masks", &format!("{name}.png"))));
        let truth = truth.map(|name| (format!("{name}_file"), self.file("truth", &format!("{name}.npy"))));
        for (key, file) in masks.into_iter().chain(truth).filter(|(_, file)| self.view.has(file)) {
            image[key] = json!(file);
        }
        image
    }

    /// The annotations of COCO.
    fn annotations(&self) -> impl Iterator<Item = Value> {
        self.view.masks.iter().map(|(category, mask)| {
            json!({
                "id": self.id * 256 + u64::from(*category),
                "image_id": self.id,
                "category_id": category,
                "segmentation": mask.segmentation,
                "area": mask.area,
                "bbox": mask.bbox,
                "iscrowd": 0,
            })
        })
    }

    /// Pixels of a lesion, or of all.
    fn lesion_pixels(&self, categories: &Categories, lesion: Option<u8>) -> usize {
        let is_wanted = |number: u8| {
            lesion.map_or(usize::from(number) <= categories.lesions.len(), |lesion| lesion == number)
        };
        let masks = self.view.masks.iter().filter(|(number, _)| is_wanted(*number));
        masks.map(|(_, mask)| mask.area).sum()
    }
}

impl Tables<'_> {
    /// The part that a person is in.
    fn split(&self, person: u32) -> &'static str {
        let draw = self.work.cohort.split_draw(person);
        SPLITS.iter().find(|(_, end)| draw < *end).map_or(SPLITS[0].0, |(name, _)| name)
    }

    fn lit(&self) -> impl Iterator<Item = (u64, &Capture)> {
        (0..).zip(&self.study.captures).filter(|(_, capture)| is_lit(capture))
    }

    fn images(&self) -> impl Iterator<Item = Image<'_>> {
        let names = &self.work.cohort.views;
        let analyzed = self.study.analyzed_capture().map(|capture| &capture.frame.label);
        self.views.iter().flat_map(move |((person, view_name), view)| {
            let number = names.iter().position(|view| view.name == view_name).unwrap_or(0);
            let before = u64::from(*person) * names.len() as u64 + number as u64;
            let split = self.split(*person);
            self.lit().map(move |(index, capture)| Image {
                id: before * self.study.captures.len() as u64 + index,
                split,
                person: *person,
                view_name,
                view,
                capture: &capture.frame.label,
                is_analyzed: Some(&capture.frame.label) == analyzed,
            })
        })
    }

    /// Annotations and tables by their names.
    pub(super) fn files(&self) -> Result<Vec<(String, String)>> {
        let mut files = Vec::new();
        for (split, _) in SPLITS {
            let images: Vec<Image<'_>> = self.images().filter(|image| image.split == split).collect();
            let annotations: Vec<Value> = images.iter().flat_map(Image::annotations).collect();
            let coco = json!({
                "info": {
                    "description": format!("{}: {split}", self.work.title()),
                    "version": env!("CARGO_PKG_VERSION"),
                    "program": "fluorspar",
                    "sha256": self.work.sha256,
                    "source": SOURCE,
                },
                "licenses": [],
                "categories": self.categories.coco(),
                "images": images.iter().map(Image::coco).collect::<Vec<_>>(),
                "annotations": annotations,
            });
            files.push((format!("annotations_{split}.json"), serde_json::to_string(&coco)? + "\n"));
        }
        files.push(("images.csv".into(), self.table()));
        files.push(("people.csv".into(), people_csv(&self.work.people()?, false)?));
        Ok(files)
    }

    fn table(&self) -> String {
        let row = |image: Image<'_>| {
            let lesions = csv_cell(&image.view.lesions.join(" ")).into_owned();
            let pixels = image.lesion_pixels(self.categories, None);
            let share = image.view.share.filter(|_| image.is_analyzed);
            let share = share.map_or_else(String::new, |share| share.to_string());
            let Image { id, split, person, view_name, .. } = image;
            let (picture, raw, capture) = (image.picture(), image.raw(), csv_cell(image.capture));
            format!("{id},{picture},{raw},{person},{view_name},{capture},{split},{lesions},{pixels},{share}")
        };
        let heads = "id,image,raw,person,view,capture,split,lesions,lesion_pixels,porphyrin_share";
        csv(heads, self.images().map(row))
    }

    /// What the data set holds.
    pub(super) fn facts(&self, has_spectra: bool) -> DatasetFacts {
        let cohort = &self.work.cohort;
        let split = |name: &str| {
            let images: Vec<Image<'_>> = self.images().filter(|image| image.split == name).collect();
            let shows = |image: &&Image<'_>| image.lesion_pixels(self.categories, None) > 0;
            SplitCounts {
                name: name.to_owned(),
                people: cohort.numbers().filter(|person| self.split(*person) == name).count(),
                images: images.len(),
                with_lesion: images.iter().filter(shows).count(),
            }
        };
        let lesion = |lesion: &fluorspar_experiment::schema::LesionSection| {
            let number = self.categories.lesion(&lesion.name);
            let shows = |image: &Image<'_>| image.lesion_pixels(self.categories, Some(number)) > 0;
            LesionCounts {
                name: lesion.name.clone(),
                people: cohort.numbers().filter(|person| cohort.has_lesion(*person, lesion)).count(),
                images: self.images().filter(shows).count(),
            }
        };
        let analysis = self.study.analysis.as_ref();
        let first = self.views.values().next();
        DatasetFacts {
            title: self.work.title().to_owned(),
            sha256: self.work.sha256.clone(),
            version: env!("CARGO_PKG_VERSION").into(),
            size_px: first.map_or([0; 2], |view| view.size_px),
            views: cohort.views.iter().map(|view| view.name.to_owned()).collect(),
            captures: self.lit().map(|(_, capture)| capture.frame.label.clone()).collect(),
            analyzed: analysis.map_or_else(String::new, |plan| plan.frame.clone()),
            porphyrin: analysis.and_then(|plan| plan.porphyrin.clone()),
            splits: SPLITS.iter().map(|(name, _)| split(name)).collect(),
            lesions: cohort.lesions().iter().map(lesion).collect(),
            samples_per_pixel: first.map_or(0, |view| view.samples_per_pixel),
            has_spectra,
        }
    }
}
