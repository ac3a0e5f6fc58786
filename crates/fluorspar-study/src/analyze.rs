//! Estimates what has no estimate.

use std::collections::BTreeMap;
use std::path::Path;

use fluorspar_session::{
    Error, ErrorKind, FailedPhotograph, Job, Left, PatientEstimate, Photograph, Result, estimate_photograph,
    region_mask, region_with_mask,
};
use serde::{Deserialize, Serialize};

use crate::event::{Event, LoggedEstimate};
use crate::store::{Study, StudyArgs, check_unchanged};

/// What is estimated.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct AnalyzeStudyOptions {
    /// The study.
    #[command(flatten)]
    #[serde(flatten)]
    pub args: StudyArgs,
    /// Also regions that another version of the program, or another camera.toml, estimated: what these said stays.
    #[arg(long)]
    pub missing: bool,
}

/// What was estimated.
#[derive(Clone, Debug, Serialize)]
pub struct AnalyzedStudy {
    /// Regions with new estimates.
    pub regions: usize,
    /// Regions that had them.
    pub known: usize,
    /// Photographs without a region.
    pub without_region: usize,
    /// Photographs without an answer.
    pub failures: Vec<FailedPhotograph>,
    /// Digest of the experiment.
    pub analysis: String,
    /// Version of the program.
    pub version: String,
}

/// A photograph with its regions.
pub(crate) struct Wanted {
    pub(crate) photograph: String,
    pub(crate) subject: String,
    pub(crate) session: String,
    /// Digest, name, place and verdict of its regions.
    regions: Vec<[String; 4]>,
}

/// Estimates the regions that have no estimate. Each photograph is on the disk before the next begins.
///
/// # Errors
/// A study that can't be opened, a job that is stopped.
pub fn analyze(options: &AnalyzeStudyOptions, job: &Job) -> Result<AnalyzedStudy> {
    let mut study = Study::open(&options.args.study)?;
    let version = env!("CARGO_PKG_VERSION").to_owned();
    let analysis = current_analysis(&mut study, options.missing)?;
    let all = wanted(&study)?;
    let mut done = AnalyzedStudy {
        regions: 0,
        known: 0,
        without_region: all.iter().filter(|photograph| photograph.regions.is_empty()).count(),
        failures: Vec::new(),
        analysis: analysis.clone(),
        version: version.clone(),
    };
    let share_done = job.listener.begin("Analyzing photographs", "the photographs", Left::Results);
    let count = all.len();
    for (number, mut photograph) in all.into_iter().enumerate() {
        if job.is_stopped() {
            let text =
                format!("stopped after {number} of {count} photographs; the same command goes on from there");
            return Err(Error::Stopped(text));
        }
        let before = photograph.regions.len();
        let is_missing = |region: &[String; 4]| {
            has_estimate(&study, &region[0], options.missing.then_some([&analysis, &version])).map(|has| !has)
        };
        let missing: Vec<bool> = photograph.regions.iter().map(is_missing).collect::<Result<_>>()?;
        let mut missing = missing.into_iter();
        photograph.regions.retain(|_| missing.next().unwrap_or(false));
        done.known += before - photograph.regions.len();
        if !photograph.regions.is_empty() {
            estimate_one(&mut study, &photograph, [&analysis, &version], &mut done, job)?;
        }
        share_done((number + 1) as f64 / count as f64);
    }
    Ok(done)
}

/// The digest of the camera of now. From the first numbers by it on the log has it: where it is
/// asked for, or where there is none yet.
fn current_analysis(study: &mut Study, is_asked: bool) -> Result<String> {
    let setup = study.setup()?;
    let known = study.log.entries.iter().rev().find(|entry| matches!(entry.event, Event::Setup { .. }));
    let Event::Setup { analysis, .. } = &setup else { return Ok(String::new()) };
    let analysis = analysis.clone();
    if known.is_none_or(|known| known.event != setup && is_asked) {
        study.commit("analyze", vec![setup])?;
    }
    Ok(analysis)
}

/// Photographs of people who did not withdraw, with their regions.
pub(crate) fn wanted(study: &Study) -> Result<Vec<Wanted>> {
    let sql =
        "SELECT p.photograph, p.subject, p.session FROM photograph p JOIN subject s ON s.subject = p.subject
               WHERE s.withdrawn = 0 ORDER BY p.subject, p.session, p.photograph";
    let mut all = study.index.rows(sql, [], |row| {
        Ok(Wanted {
            photograph: row.get(0)?,
            subject: row.get(1)?,
            session: row.get(2)?,
            regions: Vec::new(),
        })
    })?;
    let sql = "SELECT region_sha256, region, place, verdict FROM region WHERE photograph = ? AND current = 1 ORDER BY region";
    for photograph in &mut all {
        let read = |row: &rusqlite::Row<'_>| Ok([row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?]);
        photograph.regions = study.index.rows(sql, [&photograph.photograph], read)?;
    }
    Ok(all)
}

/// Whether a region has an estimate, by this analysis and version where they count.
fn has_estimate(study: &Study, region: &str, by: Option<[&String; 2]>) -> Result<bool> {
    let any = "SELECT 1 FROM estimate WHERE region_sha256 = ?1 LIMIT 1";
    let own = "SELECT 1 FROM estimate WHERE region_sha256 = ?1 AND analysis = ?2 AND version = ?3 LIMIT 1";
    let read = |row: &rusqlite::Row<'_>| row.get::<_, i64>(0);
    let found = match by {
        None => study.index.rows(any, [region], read)?,
        Some([analysis, version]) => study.index.rows(own, [region, analysis, version], read)?,
    };
    Ok(!found.is_empty())
}

fn estimate_one(
    study: &mut Study,
    wanted: &Wanted,
    [analysis, version]: [&String; 2],
    done: &mut AnalyzedStudy,
    job: &Job,
) -> Result<()> {
    let photograph = photograph_of(study, wanted)?;
    let unchanged = check_files(study, &wanted.photograph);
    let found = match unchanged.and_then(|()| estimate_photograph(&study.analysis(), &photograph, job)) {
        Ok(found) => found,
        Err(error) if error.kind() != ErrorKind::Input => return Err(error),
        Err(error) => {
            let failed = FailedPhotograph { frame: photograph.frames[0].1.clone(), why: error.to_string() };
            done.failures.push(failed);
            return Ok(());
        }
    };
    let digests: BTreeMap<&str, &str> =
        wanted.regions.iter().map(|[sha256, name, ..]| (name.as_str(), sha256.as_str())).collect();
    let event = |of: PatientEstimate| {
        Event::Estimate(LoggedEstimate {
            photograph: wanted.photograph.clone(),
            region_sha256: digests.get(of.number.region.as_str()).copied().unwrap_or_default().to_owned(),
            number: of.number,
            analysis: analysis.clone(),
            version: version.clone(),
        })
    };
    done.regions += wanted.regions.len();
    study.commit("analyze", found.into_iter().map(event).collect())
}

/// Refuses a photograph of which a file is not as it was taken in: numbers would be those of something else.
pub(crate) fn check_files(study: &Study, photograph: &str) -> Result<()> {
    let sql = "SELECT path, sha256 FROM file f WHERE photograph = ? AND (role <> 'mask' OR EXISTS (SELECT 1 FROM region r
               WHERE r.photograph = f.photograph AND r.current = 1 AND instr(r.place, f.path) > 0))";
    let files: Vec<[String; 2]> =
        study.index.rows(sql, [photograph], |row| Ok([row.get(0)?, row.get(1)?]))?;
    files.iter().try_for_each(|[path, sha256]| check_unchanged(&study.path(Path::new(path)), sha256))
}

/// A photograph with its files as the working folder has them.
pub(crate) fn photograph_of(study: &Study, wanted: &Wanted) -> Result<Photograph> {
    let sql = "SELECT role, path, sha256 FROM file WHERE photograph = ? ORDER BY path";
    let files: Vec<[String; 3]> =
        study.index.rows(sql, [&wanted.photograph], |row| Ok([row.get(0)?, row.get(1)?, row.get(2)?]))?;
    let of_role = |role: &str| {
        let found = files.iter().filter(|[of, ..]| of == role);
        found.map(|[_, path, _]| study.path(Path::new(path))).collect::<Vec<_>>()
    };
    let is_frame = |role: &str| !["dark", "flat", "mask", "description"].contains(&role);
    let mut frames: Vec<&[String; 3]> = files.iter().filter(|[role, ..]| is_frame(role)).collect();
    frames.sort_by_key(|[_, _, sha256]| *sha256 != wanted.photograph);
    let region = |[_, name, at, verdict]: &[String; 4]| {
        let mut region = [name.clone(), at.clone(), verdict.clone()];
        if let Some(mask) = region_mask(&region)? {
            region[1] = region_with_mask(&region, &study.path(&mask))?;
        }
        Ok(region)
    };
    Ok(Photograph {
        patient: wanted.subject.clone(),
        visit: wanted.session.clone(),
        frames: frames.iter().map(|[role, path, _]| (role.clone(), study.path(Path::new(path)))).collect(),
        dark: of_role("dark"),
        flat: of_role("flat"),
        regions: wanted.regions.iter().map(region).collect::<Result<_>>()?,
    })
}
