//! What an analysis asks of surfaces, kept in the cache: frames of a finished render are analyzed without meshing, mapping and solving
//! them again.
//!
//! Kept are analyses of experiments that read no files, with an estimate from a family of tissues.

use std::sync::Arc;

use fluorspar::geometry::TriangleMesh;
use fluorspar::material::{FluorophoreAmount, Material, ScalarTexture};
use fluorspar::scene::{Object, Scene, Shape};
use fluorspar::spectral::{Curve, Fluorophore};
use fluorspar::study::{AnalysisPlan, LineEnds, RegionPlan, Study, TissuePrior};
use serde::{Deserialize, Serialize};

use super::analyzed_region::as_analysis;
use super::capture::{OfSurfaces, plan, teeth_around};
use super::region::lies_on_sensor;
use crate::cache::{cache, cache_of_surfaces, cached_solutions};
use crate::preset::{self, has_user_catalogue};
use crate::read::Experiment;
use crate::schema::{AnalysisSection, ExperimentFile, RenderSection, SensorRegionSection};

/// Kind of the entries of the cache.
const KIND: &str = "analysis";

/// The analysis of an experiment with its regions, and as much of its scene as that looks at.
#[derive(Clone, Debug, PartialEq)]
pub struct CachedAnalysis {
    plan: AnalysisPlan,
    regions: Vec<RegionPlan>,
    names: Names,
}

/// Which part holds what: names and numbers alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Names {
    /// The analysis, then its regions.
    analyses: Vec<AnalysisNames>,
    /// Fluorophores of the scene, the first of each analysis.
    of_scene: usize,
    /// Names of parts with the numbers of their materials.
    parts: Vec<(String, usize)>,
    /// Fluorophores of the materials, by number.
    materials: Vec<Vec<usize>>,
}

/// What one analysis asks of surfaces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct AnalysisNames {
    /// Amounts of the bulk before factors, as bits.
    bulk: Vec<(String, u64)>,
    is_of_scene: bool,
    /// The fluorophore whose share is asked for.
    porphyrin: Option<String>,
    site: Option<SiteNames>,
    /// Fluorophores of the plan.
    fluorophores: usize,
}

/// The site of a family of tissues.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct SiteNames {
    name: String,
    /// Its parameters, as bits.
    parameters: Vec<(String, u64)>,
    /// Fluorophores of the prior, behind those of the plan.
    fluorophores: usize,
}

/// Everything that the analysis depends on in what it asks of surfaces, but for the program.
fn key(file: &ExperimentFile) -> Option<String> {
    let captures: Vec<&str> = file.capture.iter().map(|capture| capture.name.as_str()).collect();
    let render = RenderSection {
        width_px: file.render.width_px,
        height_px: file.render.height_px,
        ..RenderSection::default()
    };
    let mut looked_at = ExperimentFile {
        title: String::new(),
        description: String::new(),
        base: None,
        render,
        view_filter: Default::default(),
        concentration: Default::default(),
        capture: Vec::new(),
        motion: None,
        develop: None,
        spectroradiometer: Vec::new(),
        safety: None,
        output: Default::default(),
        ..file.clone()
    };
    // Where a region lies matters to its pixels alone
    for place in places(&mut looked_at) {
        place.rectangle_px = place.rectangle_px.map(|_| [0; 4]);
        place.polygon_px = place.polygon_px.take().map(|_| Vec::new());
    }
    Some(format!("analysis 4 {captures:?} {}", serde_json::to_string(&looked_at).ok()?))
}

/// Where the analysis and its regions lie.
fn places(file: &mut ExperimentFile) -> impl Iterator<Item = &mut SensorRegionSection> {
    file.analysis.iter_mut().flat_map(|section| {
        std::iter::once(&mut section.place).chain(section.region.iter_mut().map(|region| &mut region.place))
    })
}

fn bits((name, value): (&str, f64)) -> (String, u64) {
    (name.to_owned(), value.to_bits())
}

impl AnalysisNames {
    fn of(of: &OfSurfaces) -> Self {
        let site = |prior: &TissuePrior| SiteNames {
            name: prior.site.name().into(),
            parameters: prior.site.parameters().map(|(of, value)| bits((of.name, value))).collect(),
            fluorophores: prior.fluorophores.len(),
        };
        Self {
            bulk: of.bulk.iter().map(|(name, amount)| bits((name, *amount))).collect(),
            is_of_scene: of.line_ends == LineEnds::Scene,
            porphyrin: of.porphyrin.clone(),
            site: of.tissue.as_ref().map(site),
            fluorophores: of.fluorophores.len(),
        }
    }

    /// What the analysis of a section asked of surfaces; takes its fluorophores from a list.
    fn read(
        &self,
        file: &ExperimentFile,
        section: &AnalysisSection,
        list: &mut impl Iterator<Item = Fluorophore>,
    ) -> Option<OfSurfaces> {
        let mut take = |count: usize| {
            let taken: Vec<Fluorophore> = list.by_ref().take(count).collect();
            (taken.len() == count).then_some(taken)
        };
        let fluorophores = take(self.fluorophores)?;
        let tissue = match &self.site {
            None => None,
            Some(kept) => {
                let mut site = preset::site(&kept.name).ok()?;
                for (name, value) in &kept.parameters {
                    site.set(name, f64::from_bits(*value)).ok()?;
                }
                Some(TissuePrior {
                    site,
                    fluorophores: take(kept.fluorophores)?.into_iter().map(Arc::new).collect(),
                    width: section.prior_width,
                    library_error: section.library_error,
                    teeth: teeth_around(file).ok()?,
                    site_probability: section.tissue_probability,
                    others: preset::compared_sites().ok()?,
                    kept: cached_solutions(),
                })
            }
        };
        Some(OfSurfaces {
            bulk: self.bulk.iter().map(|(name, amount)| (name.clone(), f64::from_bits(*amount))).collect(),
            fluorophores,
            tissue,
            line_ends: if self.is_of_scene { LineEnds::Scene } else { LineEnds::FlatSample },
            porphyrin: self.porphyrin.clone(),
        })
    }
}

/// Keeps what the analysis of an experiment, the first of a list, and its regions asked of surfaces. The experiment must have been
/// resolved without error or file.
pub(crate) fn keep_analysis(file: &ExperimentFile, all: &[OfSurfaces], scene: &Scene) {
    let has_prior = all.first().is_some_and(|of| of.tissue.is_some());
    let (Some(cache), true, Some(key)) = (cache_of_surfaces(), has_prior, key(file)) else { return };
    if has_user_catalogue() || cache.has(KIND, key.as_bytes()) {
        return;
    }
    let names = Names {
        analyses: all.iter().map(AnalysisNames::of).collect(),
        of_scene: scene.fluorophores.len(),
        parts: scene.objects.iter().map(|object| (object.name.clone(), object.material)).collect(),
        materials: scene
            .materials
            .iter()
            .map(|material| material.fluorophores.iter().map(|held| held.fluorophore).collect())
            .collect(),
    };
    let of_prior = |of: &OfSurfaces| -> Vec<Fluorophore> {
        of.tissue.iter().flat_map(|prior| prior.fluorophores.iter().map(|f| (**f).clone())).collect()
    };
    let list: Vec<Fluorophore> =
        all.iter().flat_map(|of| of.fluorophores.iter().cloned().chain(of_prior(of))).collect();
    let (Ok(names), Some(tables)) = (serde_json::to_vec(&names), Fluorophore::list_to_bytes(&list)) else {
        return;
    };
    let length = (names.len() as u64).to_le_bytes();
    cache.put(KIND, key.as_bytes(), &[&length, names.as_slice(), &tables].concat());
}

/// The analysis of an experiment with its regions, where one was kept whose surfaces are the same.
pub fn cached_analysis(experiment: &Experiment) -> Option<CachedAnalysis> {
    let file = &experiment.file;
    let section = file.analysis.as_ref()?;
    let all = std::iter::once(&section.place).chain(section.region.iter().map(|region| &region.place));
    if has_user_catalogue() || !all.into_iter().all(|place| lies_on_sensor(file, place)) {
        return None;
    }
    let bytes = cache()?.get(KIND, key(file)?.as_bytes())?;
    let (length, rest) = bytes.split_first_chunk::<8>()?;
    let (names, tables) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    let names: Names = serde_json::from_slice(names).ok()?;
    let mut fluorophores = Fluorophore::list_from_bytes(tables)?.into_iter();
    let (main, of_regions) = names.analyses.split_first()?;
    if of_regions.len() != section.region.len() {
        return None;
    }
    let main = plan(file, section, main.read(file, section, &mut fluorophores)?);
    let mut regions = Vec::with_capacity(of_regions.len());
    for (kept, region) in of_regions.iter().zip(&section.region) {
        let section = as_analysis(region, section);
        let analysis = plan(file, &section, kept.read(file, &section, &mut fluorophores)?);
        regions.push(RegionPlan { name: region.name.clone(), analysis });
    }
    let is_whole = names.of_scene <= main.fluorophores.len()
        && names.parts.iter().all(|(_, material)| *material < names.materials.len())
        && names.materials.iter().flatten().all(|number| *number < names.of_scene);
    is_whole.then_some(CachedAnalysis { plan: main, regions, names })
}

impl CachedAnalysis {
    /// The analysis, then those of its regions.
    pub fn plans(&self) -> impl Iterator<Item = &AnalysisPlan> {
        std::iter::once(&self.plan).chain(self.regions.iter().map(|region| &region.analysis))
    }

    /// The study of the captures of the render ([`super::resolve_captures`]) with this analysis. Its parts have no surface, its
    /// materials no spectra: only which part holds which fluorophore is there.
    #[must_use]
    pub fn complete(self, captures: Study) -> Study {
        let Self { plan, regions, names } = self;
        let no_surface = Arc::new(TriangleMesh::default());
        let object = |(name, material): (String, usize)| Object {
            name,
            shape: Shape::Mesh(Arc::clone(&no_surface)),
            material,
            emission: None,
        };
        let material = |held: Vec<usize>| {
            let amount = |fluorophore| FluorophoreAmount {
                fluorophore,
                concentration: ScalarTexture::Constant(1.0),
                in_tissue: None,
            };
            let mut material = Material::lambertian("", Curve::constant(0.0));
            material.fluorophores = held.into_iter().map(amount).collect();
            material
        };
        let scene = Scene {
            objects: names.parts.into_iter().map(object).collect(),
            materials: names.materials.into_iter().map(material).collect(),
            fluorophores: plan.fluorophores[..names.of_scene].to_vec(),
            ..captures.scene
        };
        Study { scene, analysis: Some(plan), regions, ..captures }
    }
}
