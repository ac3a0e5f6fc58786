//! Commands that are killed or asked to end at random moments: nothing of anybody's is lost, nothing unfinished stays, and
//! the same command again, with `--resume` where a film is kept, gives the bytes of a run that nobody disturbed.
//!
//! The suite does this a few times. `.ci/kills` does it as often as the documents say.

#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "these are tests")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::cohort::contents;
use crate::support::{fluorspar, listing};

/// Random numbers by SplitMix64.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    /// From 0 to 1.
    pub(crate) fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

const SMALL: [&str; 4] =
    ["--set=render.width_px=48", "--set=render.height_px=32", "--set=spectral.step_nm=10", "--seed=3"];

/// Wavelengths of the fit of a tissue.
const FITTED: [&str; 3] = ["--from-nm=450", "--to-nm=700", "--step-nm=25"];

/// Two people in one view.
const COHORT: [&str; 6] = [
    "--set=people.count=2",
    "--set=people.views=[\"lips\"]",
    "--set=render.width_px=32",
    "--set=render.height_px=24",
    "--set=render.samples_per_pixel=1",
    "--set=mouth.detail=0.25",
];

/// Every command that takes a while or writes much. `a.exr`, `1.film`, `2.film` and `white.csv` are in the folder `in`.
fn jobs() -> Vec<(&'static str, Vec<&'static str>)> {
    let film = [
        "render",
        "flat-patch",
        "--components",
        "-q",
        "--film",
        "f.film",
        "--resume",
        "--checkpoint-s",
        "0.1",
    ];
    let bands =
        ["--film", "b.film", "--resume", "--checkpoint-s", "0.1", "--set=render.memory_limit_gib=0.003"];
    vec![
        ("render", [&film[..], &["--preview", "p.png", "--out", "o.exr", "--spp=250"], &SMALL].concat()),
        (
            "render in bands",
            [&["render", "flat-patch", "-q", "--spp=120", "--out", "o.exr"], &bands[..], &SMALL].concat(),
        ),
        ("run", [&["run", "flat-patch", "-q", "--spp=40", "--out", "results"], &SMALL[..]].concat()),
        ("capture", vec!["capture", "in/a.exr", "-q", "--out", "frames"]),
        (
            "merge",
            vec![
                "merge",
                "in/1.film",
                "in/2.film",
                "-q",
                "--components",
                "--out",
                "m.exr",
                "--film",
                "m.film",
            ],
        ),
        ("denoise", vec!["denoise", "in/a.exr", "-q", "--out", "d.npy", "--preview", "d.png"]),
        (
            "mouth generate",
            vec![
                "mouth",
                "generate",
                "--detail=0.25",
                "-q",
                "--out",
                "parts",
                "--out",
                "g.obj",
                "--out",
                "g.glb",
            ],
        ),
        ("mouth sample", vec!["mouth", "sample", "--count=150", "--out", "people"]),
        (
            "mouth view",
            vec!["mouth", "view", "--views=lips,open", "--width=64", "--spp=4", "--detail=0.25", "-q"],
        ),
        (
            "sensor characterize",
            vec![
                "sensor",
                "characterize",
                "pi_camera_3",
                "-q",
                "--levels=40",
                "--region",
                "300",
                "200",
                "--out",
                "c",
            ],
        ),
        ("spectroradiometer", vec!["spectroradiometer", "-q", "--out", "s.csv"]),
        ("lens report", vec!["lens", "report", "wide_3_5mm", "--out", "l.svg"]),
        ("predict", vec!["predict", "--json", "-q"]),
    ]
}

/// Commands about scenes, tissues, designs and the paper.
fn further_jobs() -> Vec<(&'static str, Vec<&'static str>)> {
    vec![
        ("sheet", vec!["sheet", "in/a.exr", "-q", "--width", "200", "--out", "sheet.png"]),
        (
            "scene set",
            vec![
                "scene",
                "set",
                "flat-patch",
                "light.*.strength.irradiance_w_per_m2=30",
                "-q",
                "--out",
                "new.toml",
            ],
        ),
        (
            "tissue mc",
            vec![
                "tissue",
                "mc",
                "dorsal_tongue",
                "--wavelength-nm=405",
                "--photons=20000",
                "-q",
                "--out",
                "mc",
            ],
        ),
        (
            "tissue fit",
            [
                &["tissue", "fit", "dorsal_tongue", "--reflectance", "in/white.csv", "-q", "--out", "fit"],
                &FITTED[..],
            ]
            .concat(),
        ),
        ("validate", vec!["validate", "--case", "figure-4", "-q", "--out", "v"]),
        ("design sweep", vec!["design", "sweep", "two-lights", "-q", "--out", "d"]),
        ("cohort", [&["cohort", "oraleye-2021-surface", "-q", "--out", "c"], &COHORT[..]].concat()),
        ("dataset", [&["dataset", "oraleye-2021-surface", "-q", "--out", "t"], &COHORT[..]].concat()),
    ]
}

/// What others have in the same folder.
const MINE: [&str; 3] = ["mine.txt", "parts.ply", ".g.partial-notes"];

/// A folder to work in, with inputs and files of somebody else; caches are in it, too.
fn prepare(folder: &Path, inputs: &Path) {
    fs::create_dir_all(folder.join("in")).unwrap();
    for input in fs::read_dir(inputs).unwrap() {
        let input = input.unwrap();
        fs::copy(input.path(), folder.join("in").join(input.file_name())).unwrap();
    }
    for name in MINE {
        fs::write(folder.join(name), name).unwrap();
    }
}

fn start(folder: &Path, args: &[&str]) -> Child {
    let answer = fs::File::create(folder.join("answer")).unwrap();
    Command::new(env!("CARGO_BIN_EXE_fluorspar"))
        .args(args)
        .env("XDG_CACHE_HOME", folder.join("cache"))
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(answer)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Names of what is hidden below a folder, but for somebody else's.
fn unfinished(folder: &Path) -> Vec<PathBuf> {
    let hidden = |path: &PathBuf| {
        let name = path.file_name().unwrap().to_string_lossy();
        name.starts_with('.') && !MINE.contains(&&*name)
    };
    listing(folder).into_keys().filter(hidden).collect()
}

/// How a process is disturbed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Blow {
    Kill,
    Signal(&'static str),
}

fn strike(child: &mut Child, blow: Blow) {
    match blow {
        Blow::Kill => child.kill().unwrap(),
        Blow::Signal(name) => {
            let line = ["-c", "kill \"$0\" \"$1\"", name, &child.id().to_string()].map(String::from);
            assert!(Command::new("sh").args(line).status().unwrap().success());
        }
    }
}

/// Disturbs a command, and judges what is there at once and after the command was repeated. `None` if it was too fast.
fn disturb(
    folder: &Path,
    args: &[&str],
    moment: Duration,
    blow: Blow,
    whole: &BTreeMap<PathBuf, Vec<u8>>,
) -> Option<()> {
    let before = contents(folder);
    let mut child = start(folder, args);
    std::thread::sleep(moment);
    let missed = child.try_wait().unwrap().is_some();
    if !missed {
        strike(&mut child, blow);
    }
    let code = child.wait().unwrap().code();
    let now = contents(folder);
    for name in MINE {
        assert_eq!(now.get(Path::new(name)), Some(&name.as_bytes().to_vec()), "{name} was touched");
    }
    let inputs = |files: &BTreeMap<PathBuf, Vec<u8>>| -> BTreeMap<PathBuf, Vec<u8>> {
        files.iter().filter(|(name, _)| name.starts_with("in")).map(|(n, c)| (n.clone(), c.clone())).collect()
    };
    assert!(inputs(&now) == inputs(whole), "an input was touched");
    if blow != Blow::Kill {
        // Before it listens to signals, one ends it as the system has it.
        let changed = |(name, content): (&PathBuf, &Vec<u8>)| {
            before.get(name) != Some(content) && name != Path::new("answer")
        };
        let began = || now.iter().any(changed);
        let fine = matches!(code, Some(0 | 75)) || (code.is_none() && !began());
        assert!(fine, "{blow:?} after {moment:?}: exit code {code:?}");
        assert_eq!(unfinished(folder), Vec::<PathBuf>::new(), "{blow:?} after {moment:?}");
    }
    let again = start(folder, args).wait_with_output().unwrap();
    let told = String::from_utf8_lossy(&again.stderr);
    assert!(again.status.success(), "{args:?}, {blow:?} after {moment:?}, repeated: {told}");
    let after = contents(folder);
    let names = |files: &BTreeMap<PathBuf, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&after), names(whole), "{blow:?} after {moment:?}, repeated");
    for (name, content) in &after {
        assert!(content == &whole[name], "{blow:?} after {moment:?}, repeated: {} differs", name.display());
    }
    assert_eq!(unfinished(folder), Vec::<PathBuf>::new(), "{blow:?} after {moment:?}, repeated");
    (!missed).then_some(())
}

/// Disturbs commands in turn until so many blows of each kind have hit.
fn disturb_all(jobs: &[(&str, Vec<&str>)], kills: usize, signals: usize, seed: u64) {
    let work = tempfile::tempdir().unwrap();
    let inputs = work.path().join("inputs");
    fs::create_dir(&inputs).unwrap();
    let render = ["render", "flat-patch", "-q", "--spp=32", "--components", "--statistics=light_groups"];
    let render = [&render[..], &SMALL].concat();
    for more in [
        ["--out", "a.exr", "", ""],
        ["--film", "1.film", "--shard", "1/2"],
        ["--film", "2.film", "--shard", "2/2"],
    ] {
        let args: Vec<&str> =
            render.iter().copied().chain(more.into_iter().filter(|arg| !arg.is_empty())).collect();
        fluorspar(&inputs, args).well();
    }
    let white = |nm: u32| format!("{nm},{}\n", 0.2 + f64::from(nm - 450) * 1e-3);
    let white: String = (450..=700).step_by(10).map(white).collect();
    fs::write(inputs.join("white.csv"), format!("wavelength_nm,reflectance\n{white}")).unwrap();
    // What each command gives when nobody disturbs it, and the time that it takes.
    let undisturbed: Vec<(BTreeMap<PathBuf, Vec<u8>>, Duration)> = jobs
        .iter()
        .map(|(name, args)| {
            let folder = work.path().join(name);
            prepare(&folder, &inputs);
            let begun = Instant::now();
            assert!(start(&folder, args).wait().unwrap().success(), "{name}");
            let time = begun.elapsed();
            assert_eq!(unfinished(&folder), Vec::<PathBuf>::new(), "{name}");
            (contents(&folder), time)
        })
        .collect();
    let mut random = Random(seed);
    let blows = [Blow::Signal("-TERM"), Blow::Signal("-INT"), Blow::Signal("-HUP")];
    let (mut killed, mut signaled) = (vec![0; jobs.len()], vec![0; jobs.len()]);
    for turn in 0.. {
        let (hit_kills, hit_signals) = (killed.iter().sum::<usize>(), signaled.iter().sum::<usize>());
        if hit_kills >= kills && hit_signals >= signals {
            break;
        }
        assert!(turn < 20 * (kills + signals), "the commands are too fast to be hit");
        let job = turn % jobs.len();
        let (name, args) = &jobs[job];
        let (whole, time) = &undisturbed[job];
        let kill = hit_signals >= signals || (hit_kills < kills && random.share() < 0.67);
        let blow = if kill { Blow::Kill } else { blows[(random.share() * 3.0) as usize] };
        // Every other time the results of an earlier run are there already.
        let folder = tempfile::tempdir_in(work.path()).unwrap();
        prepare(folder.path(), &inputs);
        let resumes = args.contains(&"--resume");
        if random.share() < 0.5 && !resumes {
            assert!(start(folder.path(), args).wait().unwrap().success(), "{name}, before");
        }
        let moment = time.mul_f64(random.share());
        if disturb(folder.path(), args, moment, blow, whole).is_some() {
            *(if blow == Blow::Kill { &mut killed[job] } else { &mut signaled[job] }) += 1;
        }
    }
    println!("seed {seed}");
    for (((name, _), killed), signaled) in jobs.iter().zip(&killed).zip(&signaled) {
        println!("| {name} | {killed} | {signaled} |");
    }
    println!("| all | {} | {} |", killed.iter().sum::<usize>(), signaled.iter().sum::<usize>());
}

/// A number from the environment, which `.ci/kills` sets.
fn number(name: &str) -> Option<usize> {
    std::env::var(name).ok().map(|text| text.parse().unwrap_or_else(|_| panic!("{name} {text}")))
}

#[test]
fn what_is_killed_or_stopped_at_any_moment_leaves_nothing_and_gives_the_same_when_repeated() {
    match (number("FLUORSPAR_KILLS"), number("FLUORSPAR_SIGNALS")) {
        (None, None) => {
            let some = ["render", "mouth sample", "run"];
            let jobs: Vec<_> = jobs().into_iter().filter(|(name, _)| some.contains(name)).collect();
            disturb_all(&jobs, 4, 2, 1);
        }
        (kills, signals) => {
            let seed = number("FLUORSPAR_SEED").unwrap_or(1) as u64;
            let jobs = [jobs(), further_jobs()].concat();
            disturb_all(&jobs, kills.unwrap_or(0), signals.unwrap_or(0), seed);
        }
    }
}
