//! Renders that are killed, interrupted, resumed, extended, split and merged: the same bytes as in one go.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::support::{fluorspar, tiny};
use fluorspar::image::ComponentImage;
use fluorspar::spectral::Radiance;
use fluorspar_format::{read_component_exr, read_spectral_exr};

fn bytes(folder: &Path, name: &str) -> Vec<u8> {
    fs::read(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// A flat patch that takes a few seconds.
const LONG: [&str; 8] = [
    "render",
    "flat-patch",
    "--components",
    "-q",
    "--spp=1500",
    "--set=render.width_px=64",
    "--set=render.height_px=48",
    "--set=spectral.step_nm=10",
];

/// What makes films large.
const ALL_BANDS: &str = "--set=render.component_bands=all";

fn start(folder: &Path, more: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_fluorspar"))
        .args(LONG)
        .args(more)
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Waits until a file is there, and a moment longer.
fn wait_for(path: &Path) {
    let begun = Instant::now();
    while !path.exists() {
        assert!(begun.elapsed() < Duration::from_secs(60), "{} never came", path.display());
        std::thread::sleep(Duration::from_millis(10));
    }
    std::thread::sleep(Duration::from_millis(200));
}

#[test]
fn a_killed_render_goes_on_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let film = ["--film", "killed.film", "--resume", "--checkpoint-s", "0.1", "--out", "killed.exr"];
    let mut killed = 0;
    for _ in 0..3 {
        let mut child = start(folder, &film);
        wait_for(&folder.join("killed.film"));
        killed += i32::from(child.try_wait().unwrap().is_none());
        // SIGKILL.
        child.kill().unwrap();
        child.wait().unwrap();
    }
    assert!(killed > 0, "the render is too short to be killed");
    assert!(start(folder, &film).wait().unwrap().success());
    assert!(start(folder, &["--out", "whole.exr"]).wait().unwrap().success());
    assert!(bytes(folder, "killed.exr") == bytes(folder, "whole.exr"));
    // Not even of the processes that could not clean up.
    assert_eq!(hidden(folder), Vec::<String>::new());
}

/// Hidden files and folders.
fn hidden(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.filter(|name| name.starts_with('.')).collect()
}

fn send(signal: &str, child: &Child) {
    // Every shell has it, while the program of this name is missing on small systems.
    let sent =
        Command::new("sh").args(["-c", "kill \"$0\" \"$1\"", signal, &child.id().to_string()]).status();
    assert!(sent.unwrap().success());
}

/// The requests to end that a process started from here hears. What this one was started to ignore, as under `nohup` or in the
/// background of a script, its children ignore as well, and rightly go on.
fn heeded() -> Vec<&'static str> {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.map_or(0, |mask| u64::from_str_radix(mask.trim(), 16).unwrap());
    let numbered = [("-INT", 2), ("-TERM", 15), ("-HUP", 1)];
    let signals = numbered.iter().filter(|(_, number)| ignored & (1 << (number - 1)) == 0);
    let signals: Vec<&str> = signals.map(|(signal, _)| *signal).collect();
    assert!(!signals.is_empty(), "whoever runs these tests ignores all requests to end");
    signals
}

#[test]
fn requests_to_end_save_a_render_and_leave_nothing_unfinished() {
    for signal in heeded() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let mut child = start(folder, &["--film", "t.film", "--checkpoint-s", "0.1", "--out", "t.exr"]);
        wait_for(&folder.join("t.film"));
        send(signal, &child);
        assert_eq!(child.wait().unwrap().code(), Some(75), "{signal}");
        // The image so far is there, and nothing else.
        assert!(!bytes(folder, "t.exr").is_empty(), "{signal}");
        assert_eq!(hidden(folder), Vec::<String>::new(), "{signal}");
    }
}

/// Takes some seconds, and has its folder from the beginning.
const SLOW: [&str; 9] =
    ["sensor", "characterize", "pi_camera_3", "--out", "c", "-q", "--levels=200", "--region", "800"];

fn characterize(folder: &Path, rows: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fluorspar"));
    command.args(SLOW).arg(rows).current_dir(folder).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

fn wait_until_begun(folder: &Path) {
    let begun = Instant::now();
    while hidden(folder).is_empty() {
        assert!(begun.elapsed() < Duration::from_secs(60), "no folder ever came");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn requests_to_end_remove_the_folder_in_work() {
    for signal in heeded() {
        let folder = tempfile::tempdir().unwrap();
        let mut child = characterize(folder.path(), "600").spawn().unwrap();
        wait_until_begun(folder.path());
        send(signal, &child);
        assert_eq!(child.wait().unwrap().code(), Some(75), "{signal}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "{signal}");
    }
}

#[test]
fn a_folder_that_a_killed_process_left_goes_with_the_next_and_that_of_a_living_one_stays() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut killed = characterize(folder, "600").spawn().unwrap();
    wait_until_begun(folder);
    killed.kill().unwrap();
    killed.wait().unwrap();
    let left = hidden(folder);
    assert_eq!(left.len(), 1);
    // Another one in work, and a folder of the user's with a name that is nearly ours.
    let mut living = characterize(folder, "600").spawn().unwrap();
    let begun = Instant::now();
    while hidden(folder) == left || hidden(folder).is_empty() {
        assert!(begun.elapsed() < Duration::from_secs(60), "the folder that was left stays");
        std::thread::sleep(Duration::from_millis(5));
    }
    let in_work = hidden(folder);
    assert!(in_work.len() == 1 && in_work != left, "{in_work:?}");
    fs::create_dir(folder.join(".c.partial-notes")).unwrap();
    // A third, for the same place.
    let third = characterize(folder, "16").status().unwrap();
    assert!(third.code().is_some());
    let running = living.try_wait().unwrap().is_none();
    assert!(!running || hidden(folder).contains(&in_work[0]), "{:?}", hidden(folder));
    assert!(folder.join(".c.partial-notes").is_dir());
    living.kill().unwrap();
    living.wait().unwrap();
}

#[test]
fn what_was_started_with_nohup_goes_on_when_the_terminal_closes() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = Command::new("sh")
        .args(["-c", "trap '' HUP; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_fluorspar")])
        .args(SLOW)
        .arg("100")
        .current_dir(folder.path())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    wait_until_begun(folder.path());
    send("-HUP", &child);
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(folder.path().join("c/results.json").is_file());
}

#[test]
fn an_interrupted_render_ends_with_75_even_under_a_time_limit_and_goes_on_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let limit = "--set=render.time_limit_s=1000";
    let film = ["--film", "f.film", "--resume", "--checkpoint-s", "0.1", "--out", "i.exr", limit];
    let mut child = start(folder, &film);
    wait_for(&folder.join("f.film"));
    send(heeded()[0], &child);
    assert_eq!(child.wait().unwrap().code(), Some(75));
    // The image so far is there.
    assert!(!bytes(folder, "i.exr").is_empty());
    assert!(start(folder, &film).wait().unwrap().success());
    assert!(start(folder, &["--out", "whole.exr", limit]).wait().unwrap().success());
    assert!(bytes(folder, "i.exr") == bytes(folder, "whole.exr"));
}

#[test]
fn exit_codes_tell_a_time_limit_from_a_signal() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut limited = start(folder, &["--out", "l.exr", "--set=render.time_limit_s=0.2"]);
    assert_eq!(limited.wait().unwrap().code(), Some(0));
    assert!(image(folder, "l.exr").samples_per_pixel < 1500);

    // In bands of rows, where the film is a folder.
    let bands = ["--film", "b.film", "--out", "b.exr", "--set=render.memory_limit_gib=0.001"];
    let mut child = start(folder, &bands);
    wait_for(&folder.join("b.film/picture.film"));
    send(heeded()[0], &child);
    assert_eq!(child.wait().unwrap().code(), Some(75));
    assert!(!folder.join("b.exr").exists());

    // A run, which writes what it has.
    let mut run = LONG.to_vec();
    run[0] = "run";
    run.retain(|arg| *arg != "--components");
    let mut child = Command::new(env!("CARGO_BIN_EXE_fluorspar"))
        .args(run)
        .args(["--out", "results"])
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    wait_until_begun(folder);
    std::thread::sleep(Duration::from_millis(300));
    send(heeded()[0], &child);
    assert_eq!(child.wait().unwrap().code(), Some(75));
    assert_eq!(hidden(folder), Vec::<String>::new());
}

#[test]
fn the_help_lists_the_exit_codes() {
    let folder = tempfile::tempdir().unwrap();
    let help = fluorspar(folder.path(), ["--help"]).well().stdout;
    for code in ["0  done", "1  the machine", "2  something", "75  a signal"] {
        assert!(help.contains(code), "{help}");
    }
}

#[test]
fn the_preview_comes_early_and_the_render_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = start(folder.path(), &["--preview", "p.png", "--out", "p.exr"]);
    wait_for(&folder.path().join("p.png"));
    assert!(bytes(folder.path(), "p.png").starts_with(b"\x89PNG"));
    let running = child.try_wait().unwrap().is_none();
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(running, "the preview came with the end");
    assert!(!folder.path().join("p.exr").exists());
}

/// Two light groups and all fluorophores, more than one tile, samples that end within a block.
fn mouth<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let mut all = tiny(&["render", "oraleye-2021"]);
    all.retain(|arg| !arg.starts_with("render.samples") && !arg.starts_with("render.width"));
    // What is left of a pair whose value went.
    let mut args: Vec<&str> = Vec::new();
    for arg in all {
        if arg == "--set" && args.last() == Some(&"--set") {
            continue;
        }
        args.push(arg);
    }
    args.extend(["--set=render.width_px=40", "--components", "-q"]);
    args.extend(more);
    args
}

#[test]
fn shards_merge_to_the_bytes_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let statistics = ["--statistics", "light_groups", "--spp", "37"];
    let run = |more: &[&str]| {
        let mut all = mouth(&statistics);
        all.extend(more);
        fluorspar(folder, all)
    };
    run(&["--out", "whole.exr"]).well();
    for (by, count) in [("tiles", 3), ("samples", 2)] {
        let names: Vec<String> = (1..=count).map(|i| format!("{by}{i}.film")).collect();
        for (i, name) in names.iter().enumerate() {
            let shard = format!("{}/{count}", i + 1);
            run(&["--shard", &shard, "--shard-by", by, "--film", name]).well();
        }
        // One is missing.
        let merged = format!("{by}.exr");
        let mut args = vec!["merge", "--components", "--out", &merged];
        args.extend(names[1..].iter().map(String::as_str));
        let said = fluorspar(folder, &args);
        assert_eq!(said.code, Some(2));
        assert!(said.stderr.contains("a shard is missing or not finished"), "{}", said.stderr);
        assert!(!folder.join(&merged).exists());
        // All, in any order.
        args.push(&names[0]);
        args.extend(["--film", "merged.film"]);
        fluorspar(folder, &args).well();
        assert!(bytes(folder, &merged) == bytes(folder, "whole.exr"), "{by}");
        // One twice.
        args.push(&names[0]);
        let said = fluorspar(folder, &args);
        assert!(said.code == Some(2) && said.stderr.contains("given twice"), "{}", said.stderr);
    }
    // The merged film gets more samples.
    let more = |more: &[&str]| {
        let mut all = mouth(&["--statistics", "light_groups", "--spp", "50"]);
        all.extend(more);
        fluorspar(folder, all).well();
    };
    more(&["--film", "merged.film", "--resume", "--out", "extended.exr"]);
    more(&["--out", "longer.exr"]);
    assert!(bytes(folder, "extended.exr") == bytes(folder, "longer.exr"));

    // Denoised, and labeled so.
    let said = fluorspar(folder, ["denoise", "longer.exr", "--out", "smooth.exr", "--json"]).json();
    assert!(said["denoised"].as_str().unwrap().contains("strength"), "{said}");
    let said = fluorspar(folder, ["denoise", "smooth.exr", "--out", "again.exr"]);
    assert!(said.code == Some(2) && said.stderr.contains("denoised already"), "{}", said.stderr);
    let said = fluorspar(folder, ["denoise", "longer.exr", "--out", "longer.exr"]);
    assert!(said.code == Some(2) && said.stderr.contains("must stay"), "{}", said.stderr);
}

#[test]
fn films_of_other_scenes_and_films_in_the_way_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let run = |more: &[&str]| {
        let mut all = vec!["render", "flat-patch", "-q", "--spp=2", "--film", "a.film"];
        all.extend(["--set=render.width_px=8", "--set=render.height_px=8"]);
        // A part of several gives no image
        all.extend(if more.contains(&"--shard") { &[][..] } else { &["--out", "a.exr"] });
        all.extend(more);
        fluorspar(folder, all)
    };
    run(&[]).well();
    let film = bytes(folder, "a.film");
    for (more, message) in [
        (vec![], "add --resume"),
        (vec!["--resume", "--seed", "7"], "made for another scene, seed, depth"),
        (vec!["--resume", "--depth", "3"], "made for another scene, seed, depth"),
        (vec!["--resume", "--set", "light.0.strength.power_mw=3"], ""),
        (vec!["--resume", "--statistics", "components"], "request the same"),
        (vec!["--resume", "--shard", "3/2"], "must be I/N"),
        (
            vec!["--resume", "--shard", "1/9", "--shard-by", "samples"],
            "9 shards by samples are too many for 2 samples",
        ),
        (vec!["--resume", "--checkpoint-s", "0"], "must be between"),
    ] {
        let said = run(&more);
        assert_eq!(said.code, Some(2), "{more:?}: {}", said.stderr);
        assert!(said.stderr.contains(message), "{more:?}: {}", said.stderr);
        assert!(bytes(folder, "a.film") == film, "{more:?}");
    }
    fs::write(folder.join("a.film"), &film[..film.len() - 100]).unwrap();
    let said = run(&["--resume"]);
    assert!(said.code == Some(2) && said.stderr.contains("Copy the file again"), "{}", said.stderr);
}

/// Two components: light that a patch reflects once, and none that fluoresces.
const PLAIN: &str = r#"
format = 1
spectral.edges_nm = [350.0, 420.0, 490.0, 560.0, 630.0, 700.0]
render = { samples_per_pixel = 1, max_depth = 1, width_px = 300, height_px = 300 }
camera = { position_mm = [0.0, 0.0, 100.0], horizontal_field_deg = 40.0 }
[[light]]
name = "lamp"
type = "distant"
aim.direction = [0.0, 0.0, -1.0]
spectrum = "led_385"
strength.irradiance_w_per_m2 = 1000.0
[[material]]
name = "patch"
reflectance = "tongue_dorsum"
[[object]]
name = "patch"
material = "patch"
type = "quad"
corner_mm = [-99.0, -99.0, 0.0]
edge_u_mm = [198.0, 0.0, 0.0]
edge_v_mm = [0.0, 198.0, 0.0]
"#;

#[test]
fn maps_of_all_pixels_are_in_memory_once() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("plain.toml"), PLAIN).unwrap();
    let render = |more: &[&str]| {
        let said = fluorspar(folder, [&["render", "plain.toml", "--json", "-q"], more].concat()).json();
        said["peak_memory_bytes"].as_u64().map(|peak| (peak as f64, said))
    };
    let Some((scene, _)) = render(&["--set=render.width_px=4", "--set=render.height_px=3"]) else {
        eprintln!("skipped: this system does not tell the memory of a process");
        return;
    };
    // The maps are 26 bytes per pixel: a second copy of them does not fit beside the limit and 64 MiB.
    let size = ["--set=render.width_px=2400", "--set=render.height_px=1800", "--film", "f.film"];
    let (peak, said) = render(&[&size[..], &["--set=render.memory_limit_gib=0.14"]].concat()).unwrap();
    let (film, limit) = (said["film_bytes"].as_f64().unwrap(), said["memory_limit_bytes"].as_f64().unwrap());
    let mib = f64::from(1 << 20);
    eprintln!("scene {:.0}, limit {:.0}, peak {:.0} MiB", scene / mib, limit / mib, peak / mib);
    assert!(film > limit, "{film} {limit}");
    assert!(peak < scene + limit + 64.0 * mib, "{peak} {scene} {limit}");
}

#[test]
fn what_fits_in_one_go_need_not_fit_in_bands() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("plain.toml"), PLAIN).unwrap();
    let render = |more: &[&str]| {
        let one_band = ["render", "plain.toml", "--set=spectral.edges_nm=[350, 700]"];
        fluorspar(folder, [&one_band[..], more].concat())
    };
    // A film of 19 x 19 tiles takes 1.4 MiB; the maps that bands need beside theirs take 2.7 MiB.
    render(&["--set=render.memory_limit_gib=0.0015"]).well();
    let said = render(&["--set=render.memory_limit_gib=0.0013"]);
    assert!(
        said.code == Some(2)
            && said.stderr.contains("need 1.42 MiB")
            && said.stderr.contains("limit of 1.34 MiB"),
        "{}",
        said.stderr
    );
    assert!(!said.stderr.contains("in bands"), "{}", said.stderr);
    // A folder selects bands.
    fs::create_dir(folder.join("f.film")).unwrap();
    let film = ["--film", "f.film", "--resume", "--components", "--out", "f.exr"];
    let said = render(&[&film[..], &["--set=render.memory_limit_gib=0.0015"]].concat());
    assert!(said.code == Some(2) && said.stderr.contains("name a file"), "{}", said.stderr);
    let said = render(&film).well();
    assert!(
        said.stderr.contains("fits into the limit") && said.stderr.contains("is a folder"),
        "{}",
        said.stderr
    );
    render(&["--components", "--out", "whole.exr"]).well();
    assert!(image(folder, "f.exr") == image(folder, "whole.exr"));
}

#[test]
fn memory_is_scene_film_and_64_mib_or_the_limit_instead_of_the_film() {
    let folder = tempfile::tempdir().unwrap();
    let render = |width: &str, height: &str, limit_gib: &str| {
        let args =
            ["render", "oraleye-2021", "--spp=1", "--components", "--json", "--out", "m.exr", ALL_BANDS];
        let size = [format!("--set=render.width_px={width}"), format!("--set=render.height_px={height}")];
        let limit = format!("--set=render.memory_limit_gib={limit_gib}");
        let args = args.map(String::from).into_iter().chain(size).chain([limit]);
        let said = fluorspar(folder.path(), args).json();
        let peak = said["peak_memory_bytes"].as_u64();
        peak.map(|peak| (peak as f64, said["film_bytes"].as_u64().unwrap() as f64))
    };
    let Some((scene, _)) = render("4", "3", "8") else {
        eprintln!("skipped: this system does not tell the memory of a process");
        return;
    };
    let mib = f64::from(1 << 20);
    // In one go, then in bands.
    for (limit_gib, limit) in [("8", f64::INFINITY), ("0.05", 51.2 * mib)] {
        let (peak, film) = render("160", "120", limit_gib).unwrap();
        eprintln!("scene {:.0}, film {:.0}, peak {:.0} MiB", scene / mib, film / mib, peak / mib);
        assert!(film > 150.0 * mib, "{film}");
        assert!(peak < scene + film.min(limit) + 64.0 * mib, "{peak} {scene} {film} {limit}");
    }
}

/// The image and all that belongs to it; files differ in the memory limit, which is part of what they say of their origin.
fn image(folder: &Path, name: &str) -> ComponentImage {
    read_component_exr(&folder.join(name)).unwrap_or_else(|error| panic!("{error}")).image
}

#[test]
fn images_larger_than_the_limit_come_in_bands_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let limit = "--set=render.memory_limit_gib=0.006";
    let render = |more: &[&str]| {
        let mut all = vec!["render", "flat-patch", "--set=render.width_px=50"];
        all.extend(if more.contains(&"--spp=9") { None } else { Some("--spp=5") });
        all.extend(["--set=render.height_px=70", "--set=spectral.step_nm=10", "--statistics=light_groups"]);
        all.extend(more);
        fluorspar(folder, all)
    };
    let said = render(&["--components", "--out", "bands.exr", limit]).well();
    assert!(said.stderr.contains("bands of up to") && said.stderr.contains("Rows "), "{}", said.stderr);
    render(&["--components", "--out", "whole.exr"]).well();
    assert!(image(folder, "bands.exr") == image(folder, "whole.exr"));
    let json = |more: &[&str]| render(&[&["--json", "-q"], more].concat()).json();
    let (bands, whole) = (json(&["--out", "sum-bands.exr", limit]), json(&["--out", "sum.exr"]));
    let sum = |name: &str| read_spectral_exr::<Radiance>(&folder.join(name)).unwrap().image;
    assert!(sum("sum-bands.exr") == sum("sum.exr"));
    assert_eq!(bands["mean_radiance"], whole["mean_radiance"]);
    // With a folder of films: more samples later, and merged where there is memory.
    let film = ["--components", "--film", "f.film", "--out", "f.exr", limit];
    render(&film).well();
    let said = render(&film);
    assert!(said.code == Some(2) && said.stderr.contains("add --resume"), "{}", said.stderr);
    assert!(fs::read_dir(folder.join("f.film")).unwrap().count() > 2);
    let more: Vec<&str> = film.iter().copied().chain(["--resume", "--spp=9"]).collect();
    render(&more).well();
    render(&["--components", "--out", "nine.exr", "--spp=9"]).well();
    assert!(image(folder, "f.exr") == image(folder, "nine.exr"));
    // Another seed is refused before anything in the folder is changed.
    let reseeded: Vec<&str> = more.iter().copied().chain(["--set=render.seed=2"]).collect();
    let picture = bytes(folder, "f.film/picture.film");
    for present in [false, true] {
        if present {
            fs::write(folder.join("f.film/picture.film"), &picture).unwrap();
        } else {
            fs::remove_file(folder.join("f.film/picture.film")).unwrap();
        }
        let said = render(&reseeded);
        assert!(said.code == Some(2) && said.stderr.contains("another scene, seed"), "{}", said.stderr);
        assert_eq!(folder.join("f.film/picture.film").exists(), present);
    }
    assert!(bytes(folder, "f.film/picture.film") == picture);
    fluorspar(folder, ["merge", "f.film", "--components", "--out", "merged.exr"]).well();
    assert!(image(folder, "merged.exr") == image(folder, "nine.exr"));
    // A folder of other things stays as it is.
    fs::create_dir(folder.join("results")).unwrap();
    fs::write(folder.join("results/report.html"), "a report").unwrap();
    let said = render(&["--components", "--film", "results", "--out", "r.exr", "--resume", limit]);
    assert!(said.code == Some(2) && said.stderr.contains("none of which is a film"), "{}", said.stderr);
    assert_eq!(fs::read_dir(folder.join("results")).unwrap().count(), 1);
    // A limit below that of the films, and what can't be had in bands.
    for (more, message) in [
        (
            vec!["--film", "f.film", "--resume", "--set=render.memory_limit_gib=0.003"],
            "raise render.memory_limit_gib",
        ),
        (vec![limit, "--preview", "p.png"], "leave the preview out"),
        (vec!["--film", "f.film", "--resume", "--preview", "p.png"], "--film names a folder"),
        (vec![limit, "--out", "a.npy"], "write an .exr file"),
        (vec![limit, "--set=render.time_limit_s=9"], "would lack rows"),
        (vec![limit, "--film", "whole.exr", "--resume"], "folder of films"),
        (vec![limit, "--film", "s.film", "--shard", "1/2"], "leave --shard out"),
        (
            vec!["--set=render.memory_limit_gib=0.001"],
            "in bands of 16 rows, as `fluorspar render` would take them",
        ),
    ] {
        let said = render(&more);
        assert!(said.code == Some(2) && said.stderr.contains(message), "{more:?}: {}", said.stderr);
    }
    let size = ["--set=render.width_px=50", "--set=render.height_px=70", "--set=spectral.step_nm=10"];
    let said = fluorspar(folder, [&["run", "flat-patch", "--spp=1", limit, ALL_BANDS], &size[..]].concat());
    assert!(said.code == Some(2) && said.stderr.contains("in bands of rows"), "{}", said.stderr);
}

#[test]
fn a_killed_render_in_bands_goes_on_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let limit = "--set=render.memory_limit_gib=0.001";
    let film = ["--film", "k.film", "--resume", "--checkpoint-s", "0.1", "--out", "k.exr", limit];
    let mut killed = 0;
    for band in 0..2 {
        let mut child = start(folder, &film);
        let begun = Instant::now();
        let films = || fs::read_dir(folder.join("k.film")).map_or(0, |films| films.count());
        // The whole image's, and that of the band in work.
        while films() < 2 + band && child.try_wait().unwrap().is_none() {
            assert!(begun.elapsed() < Duration::from_secs(60), "{} films", films());
            std::thread::sleep(Duration::from_millis(10));
        }
        killed += i32::from(child.try_wait().unwrap().is_none());
        // SIGKILL.
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(!folder.join("k.exr").exists());
    }
    assert!(killed > 0, "the render is too short to be killed");
    assert!(start(folder, &film).wait().unwrap().success());
    assert!(start(folder, &["--out", "whole.exr"]).wait().unwrap().success());
    assert!(image(folder, "k.exr") == image(folder, "whole.exr"));
    // Nothing but the requested output is left.
    let mut names: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["k.exr", "k.film", "whole.exr"]);
}
