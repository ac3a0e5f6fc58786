//! Readers of the crates above `fluorspar-experiment`: scenes of pbrt as studies, studies of people, photographs, calibrations, finished runs
//! and searches.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fluorspar_pbrt::PbrtOptions;
use fluorspar_session::design::{DesignKey, FoundDesigns, OptimizeOptions, Place, ProblemOptions, optimize};
use fluorspar_session::fluorophore::{FileOptions, load};
use fluorspar_session::{
    CalibrateOptions, CiteOptions, CompareOptions, ExperimentArgs, Job, Left, Listener, RunOptions,
    calibrate, cite, compare, read_photographs, run,
};
use fluorspar_study::{
    Event, ImportOptions, InitOptions, NormOptions, StudyArgs, import, init, norm, verify,
};
use serde_json::{Value, json};

use crate::readers::{Outcome, Subject};

/// Makes a reader and its valid files, in a folder.
type Make = fn(&Path) -> Outcome<Subject>;

/// All readers, by name. Each is made when it is fuzzed: some take a render.
pub(crate) const FRONTS: [(&str, Make); 12] = [
    ("pbrt_to_study", pbrt_to_study),
    ("study_log", study_log),
    ("study_subjects", |folder| study_table(folder, "subjects.csv", SUBJECTS)),
    ("study_outcomes", |folder| study_table(folder, "outcomes.csv", OUTCOMES)),
    ("norm_JSON", norm_json),
    ("cohort_table", cohort_table),
    ("photographs_table", photographs_table),
    ("calibration_TOML", calibration),
    ("fluorophore_TOML", fluorophore),
    ("results_JSON", results),
    ("report_page", report_page),
    ("found_designs", found_designs),
];

/// Hears nothing.
struct Silent;

impl Listener for Silent {
    fn status(&self, _: &str) {}

    fn warnings(&self, _: &[fluorspar_experiment::Warning]) {}

    fn begin(&self, _: &'static str, _: &'static str, _: Left) -> Box<dyn Fn(f64) + Sync> {
        Box::new(|_| {})
    }
}

fn job() -> Job {
    Job::new(Arc::default(), Arc::new(Silent))
}

fn subject(file: &'static str, seeds: Vec<Vec<u8>>, read: impl Fn(&Path) -> bool + 'static) -> Subject {
    let read = Box::new(read);
    Subject { name: file, file, opened: file, seeds, companions: Vec::new(), weight: 1.0, read }
}

const SCENE: &str = "Option \"seed\" 3 Scale -1 1 1 LookAt 0 0 5 0 0 0 0 1 0\nCamera \"perspective\" \"float fov\" 40\n\
    Film \"rgb\" \"integer xresolution\" 4\nWorldBegin LightSource \"infinite\" \"blackbody L\" 5000 LightSource \"spot\" \"float coneangle\" 20\n\
    Texture \"c\" \"float\" \"checkerboard\" \"float uscale\" 3 \"float tex1\" 0.5\n\
    Texture \"t\" \"spectrum\" \"scale\" \"rgb tex1\" [ 0.1 0.2 0.3 ] \"texture tex2\" \"c\"\n\
    MakeNamedMaterial \"m\" \"string type\" \"matte\" \"texture Kd\" \"t\" \"photolumi f\" [ 400 5 405 0 0 0.1 0 ]\n\
    MakeNamedMaterial \"n\" \"string type\" \"metal\" \"spectrum eta\" [ 400 1 500 2 ] \"float roughness\" 0.1\n\
    MakeNamedMaterial \"x\" \"string type\" \"mix\" \"string materials\" [ \"m\" \"n\" ] \"float amount\" 0.5\n\
    AttributeBegin Translate 0 1 0 NamedMaterial \"x\" Shape \"cylinder\" \"float radius\" 2 AttributeEnd\n\
    NamedMaterial \"m\" AreaLightSource \"diffuse\" \"spectrum L\" [ 400 1 700 2 ] \"float power\" 5\n\
    Shape \"trianglemesh\" \"integer indices\" [ 0 1 2 ] \"point3 P\" [ 0 0 0 1 0 0 0 1 0 ] \"float alpha\" 1\n\
    ObjectBegin \"o\" Material \"glass\" Shape \"disk\" ObjectEnd ObjectInstance \"o\"\n";

fn pbrt_to_study(_: &Path) -> Outcome<Subject> {
    let options = PbrtOptions::default();
    Ok(subject("s.pbrt", vec![SCENE.into()], move |path| fluorspar_pbrt::load(path, &options).is_ok()))
}

const SUBJECTS: &str = "subject,site,sex,age,skin,smoker,consent\nP1,north,f,41.5,II,no,yes\nP-2,,m,,,,no\n";
const OUTCOMES: &str = "subject;method;outcome\nP1;biopsy;healthy\nP1;follow-up;\"leuko;plakia\"\n";

/// A study of two people below a folder, and its log.
fn study(folder: &Path) -> Outcome<(PathBuf, Vec<u8>)> {
    let study = folder.join("study");
    let args = StudyArgs { study: study.clone() };
    init(&InitOptions { args: args.clone(), experiment: "flat-patch".into(), ..Default::default() }, &job())?;
    let (subjects, outcomes) = (folder.join("people.csv"), folder.join("became.csv"));
    fs::write(&subjects, SUBJECTS)?;
    fs::write(&outcomes, OUTCOMES)?;
    let options =
        ImportOptions { args, subjects: Some(subjects), outcomes: Some(outcomes), ..Default::default() };
    import(&options, &job())?;
    let log = fs::read(study.join("log.jsonl"))?;
    Ok((study, log))
}

/// A log is chained anew first, so that what it tells is looked at; every other one is read as it is.
fn study_log(folder: &Path) -> Outcome<Subject> {
    let (study, log) = study(folder)?;
    let args = StudyArgs { study };
    Ok(subject("study/log.jsonl", vec![log], move |path| {
        let text = fs::read(path).unwrap_or_default();
        let chained = if text.len() % 2 == 0 { chained_anew(&text) } else { None };
        if let Some(chained) = chained {
            fs::write(path, chained).expect("the log can be written");
        }
        verify(&args, &job()).is_ok()
    }))
}

/// A log with the numbers and digests of its lines made right.
fn chained_anew(log: &[u8]) -> Option<String> {
    let (mut text, mut before) = (String::new(), String::new());
    for (number, line) in log.split(|byte| *byte == b'\n').filter(|line| !line.is_empty()).enumerate() {
        let entry: Value = serde_json::from_slice(line).ok()?;
        let event: Event = serde_json::from_value(entry.get("event")?.clone()).ok()?;
        let word = |key: &str| entry.get(key).and_then(Value::as_str).map(|word| json!(word).to_string());
        let of = |digest: &str| {
            let (when, who, command) = (word("when")?, word("who")?, word("command")?);
            let event = serde_json::to_string(&event).ok()?;
            Some(format!(
                "{{\"seq\":{},\"before\":\"{before}\",\"when\":{when},\"who\":{who},\"command\":{command},\"event\":{event},\"sha256\":\"{digest}\"}}",
                number + 1
            ))
        };
        let digest = fluorspar::digest::sha256_hex([of("")?]);
        text += &(of(&digest)? + "\n");
        before = digest;
    }
    Some(text)
}

/// A table that a study takes in; the log is as before each time.
fn study_table(folder: &Path, file: &'static str, text: &str) -> Outcome<Subject> {
    let (study, log) = study(folder)?;
    Ok(subject(file, vec![text.into()], move |path| {
        fs::write(study.join("log.jsonl"), &log).expect("the log can be written");
        let given = Some(path.to_path_buf());
        let mut options = ImportOptions { args: StudyArgs { study: study.clone() }, ..Default::default() };
        *(if file == "subjects.csv" { &mut options.subjects } else { &mut options.outcomes }) = given;
        import(&options, &job()).is_ok()
    }))
}

/// A cohort of twelve people.
fn cohort(shift: f64) -> String {
    let rows = (0..12).map(|person| {
        format!("{person},tongue,,,red_share,0,{}\n", 0.1 + shift + 0.01 * f64::from(person * person % 7))
    });
    "person,part,channel,name,quantity,has_lesion_here,value\n".to_owned() + &rows.collect::<String>()
}

fn norm_json(folder: &Path) -> Outcome<Subject> {
    let norm_of = |shift: f64| -> Outcome<Vec<u8>> {
        let path = folder.join("cohort.csv");
        fs::write(&path, cohort(shift))?;
        let mut made = norm(&NormOptions { cohort: Some(path), ..Default::default() }, &job())?.norm;
        // Of one analysis, so that they can be pooled
        made.analysis[1] = "ab".into();
        Ok(serde_json::to_vec(&made)?)
    };
    let (seed, other) = (norm_of(0.0)?, norm_of(0.02)?);
    let mut subject = subject("n.json", vec![seed], |path| {
        let pool = vec![path.to_path_buf(), path.with_file_name("other.json")];
        norm(&NormOptions { pool, ..Default::default() }, &job()).is_ok()
    });
    subject.companions.push(("other.json", other));
    Ok(subject)
}

fn cohort_table(_: &Path) -> Outcome<Subject> {
    Ok(subject("c.csv", vec![cohort(0.0).into()], |path| {
        norm(&NormOptions { cohort: Some(path.into()), ..Default::default() }, &job()).is_ok()
    }))
}

fn photographs_table(_: &Path) -> Outcome<Subject> {
    let text = "patient,visit,capture,frame,dark,flat,region,where,verdict\nP1,1,blue,a.dng,,,tongue,\"1,2,30,40\",ok\n\
        P1,1,blue,a.dng,,,lip,m.png,wrong\nP2,2,white,b.tiff,d.tiff,f.tiff,,,guess\n";
    let other = "\u{feff}patient;frame\nP1;a.dng\n";
    Ok(subject("photographs.csv", vec![text.into(), other.into()], |path| read_photographs(path).is_ok()))
}

/// Frames without a gain: what the file says is read, what they measure is not.
fn calibration(folder: &Path) -> Outcome<Subject> {
    let frame = [[0_u8; 8], [1; 8]].concat();
    ["d.tiff", "f.tiff"].iter().try_for_each(|name| fs::write(folder.join(name), &frame))?;
    let text = "format = 1\ntitle = \"c\"\nexperiment = \"flat-patch\"\ndark = [\"d.tiff\", \"d.tiff\"]\nflat = \"f.tiff\"\n[[target]]\n\
        name = \"tile\"\nframes = \"f.tiff\"\ncapture = \"blue\"\nviewing_filter = false\nreflectance = 0.95\nuncertainty_percent = 2.0\n\
        region_px = [1, 1, 2, 2]\n[[target]]\nname = \"sphere\"\nframes = [\"f.tiff\"]\ncapture = \"blue\"\nspectrum = \"halogen\"\n\
        radiance_w_per_sr_m2 = 30.0\nuncertainty_percent = 3.0\n";
    Ok(subject("calibration.toml", vec![text.into()], |path| {
        let out = Some(path.with_file_name("calibrated"));
        calibrate(&CalibrateOptions { file: path.into(), out }, &job()).is_ok()
    }))
}

fn fluorophore(folder: &Path) -> Outcome<Subject> {
    fs::write(
        folder.join("table.csv"),
        "wavelength_nm,excitation,emission\n400,1,0\n450,0.5,0.2\n500,0,1\n",
    )?;
    let text = "[[fluorophore]]\nname = \"dye\"\nphoton_yield = 0.4\nsource = { csv = \"table.csv\" }\n";
    let options: FileOptions = serde_json::from_str("{}")?;
    Ok(subject("f.toml", vec![text.into()], move |path| load(&path.to_string_lossy(), &options).is_ok()))
}

/// A finished run of a few pixels.
fn finished(folder: &Path) -> Outcome<PathBuf> {
    let out = folder.join("other");
    let set = ["render.width_px=16", "render.height_px=12", "sensor.columns=32", "sensor.rows=24"];
    let mut experiment = ExperimentArgs { experiment: Some("flat-patch".into()), ..Default::default() };
    experiment.changes.set = set.map(String::from).to_vec();
    experiment.render.spp = Some(2);
    run(&RunOptions { experiment, out: Some(out.clone()), ..Default::default() }, &job())?;
    Ok(out)
}

fn results(folder: &Path) -> Outcome<Subject> {
    let b = finished(folder)?;
    let seed = fs::read(b.join("results.json"))?;
    fs::create_dir_all(folder.join("one"))?;
    fs::copy(b.join("experiment.toml"), folder.join("one/experiment.toml"))?;
    Ok(subject("one/results.json", vec![seed], move |path| {
        compare(&CompareOptions { a: path.into(), b: b.clone(), out: None }, &job()).is_ok()
    }))
}

/// Results of a search among four lights.
fn found_designs(folder: &Path) -> Outcome<Subject> {
    let out = folder.join("found");
    let mut problem = ProblemOptions { design: Some("two-lights".into()), ..Default::default() };
    let set = ["search.keep=4", "vary.light.led.peaks_nm=[340.0, 385.0, 405.0, 420.0]"];
    problem.changes.set = set.map(String::from).to_vec();
    optimize(
        &OptimizeOptions { problem, place: Place { out: Some(out.clone()) }, ..Default::default() },
        &job(),
    )?;
    let mut small: Value = serde_json::from_slice(&fs::read(out.join("results.json"))?)?;
    for key in ["best", "pareto_front"] {
        let designs = small[key].as_array_mut().into_iter().flatten();
        designs.for_each(|design| *design = json!({ "number": design["number"] }));
    }
    let kept = ["search", "left_out", "recommended", "best", "pareto_front"];
    let small: Value = kept.iter().map(|key| ((*key).to_owned(), small[key].clone())).collect();
    Ok(subject("found/results.json", vec![serde_json::to_vec(&small)?], move |_| {
        let page = |found: FoundDesigns| {
            let keys: Vec<DesignKey> = found.recommended.into_iter().collect();
            found.sections(&keys).is_ok() && !found.criterion().is_empty()
        };
        FoundDesigns::open(&out, &job()).is_ok_and(page)
    }))
}

/// The page without its pictures.
fn report_page(folder: &Path) -> Outcome<Subject> {
    let page = fs::read_to_string(finished(folder)?.join("report.html"))?;
    let at = page.find("id=\"fluorspar-experiment\"").ok_or("the page holds no experiment")?;
    let from = page[..at].rfind("<script").unwrap_or(0);
    let to = page[at..].find("</script>").map_or(page.len(), |end| at + end + 9);
    let seed = format!("<html>{}</html>", &page[from..to]);
    Ok(subject("r.html", vec![seed.into()], |path| {
        cite(&CiteOptions { report: Some(path.to_string_lossy().into_owned()) }, &job()).is_ok()
    }))
}
