//! Feeds damaged files to readers, and counts what they do: panics, time on the processor, memory.

use std::alloc::{GlobalAlloc, Layout, System};
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::path::Path;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use fluorspar_format as format;
use fluorspar_format::Transfer;

use crate::damage::{Random, change, repair_png};
use crate::readers::{Outcome, Subject};

/// Most memory of an input, bytes.
const MAX_BYTES: usize = 1 << 30;

/// Counts the bytes that are in use, and the most that ever were.
struct Counting;

static IN_USE: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

fn add(bytes: usize) {
    let now = IN_USE.fetch_add(bytes, Relaxed) + bytes;
    MOST.fetch_max(now, Relaxed);
}

// SAFETY: all requests go to the allocator of the system as they are, and its answers come back as they are.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        add(layout.size());
        // SAFETY: the caller keeps to the contract of this method.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        add(layout.size());
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        IN_USE.fetch_sub(layout.size(), Relaxed);
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Panics so far, and where the last one was.
static PANICS: AtomicU64 = AtomicU64::new(0);
static LAST_PANIC: Mutex<String> = Mutex::new(String::new());

/// What the inputs of a reader did.
#[derive(Default)]
pub(crate) struct Report {
    pub(crate) executions: u64,
    pub(crate) read: u64,
    pub(crate) panics_escaped: u64,
    pub(crate) panics_caught: u64,
    pub(crate) slowest_s: f64,
    pub(crate) most_bytes: usize,
    pub(crate) broken: Vec<String>,
}

/// Time of this thread on the processor, seconds; Linux only.
fn processor_s() -> f64 {
    let text = fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9
}

/// Feeds a reader until it has had `executions` inputs in all, none of which may take more than `most_s` seconds.
fn run(
    subject: &Subject,
    folder: &Path,
    (executions, most_s): (u64, f64),
    (random, report): &mut (Random, Report),
    keep: Option<&Path>,
) -> Outcome<()> {
    let path = folder.join(subject.file);
    let opened = folder.join(subject.opened);
    for (name, content) in &subject.companions {
        fs::write(folder.join(name), content)?;
    }
    for number in report.executions..executions {
        let mut bytes = random.one_of(&subject.seeds).clone();
        let other = random.one_of(&subject.seeds);
        // The first inputs are the valid files.
        if number as usize >= subject.seeds.len() {
            for _ in 0..=random.below(4) {
                change(&mut bytes, random, other);
            }
        } else {
            bytes.clone_from(&subject.seeds[number as usize]);
        }
        if subject.file.ends_with(".png") {
            repair_png(&mut bytes);
        }
        fs::write(&path, &bytes)?;
        let before = IN_USE.load(Relaxed);
        MOST.store(before, Relaxed);
        let panics = PANICS.load(Relaxed);
        let begun = processor_s();
        let outcome = catch_unwind(AssertUnwindSafe(|| (subject.read)(&opened)));
        let seconds = processor_s() - begun;
        let most = MOST.load(Relaxed).saturating_sub(before);
        let panicked = PANICS.load(Relaxed) - panics;
        report.executions += 1;
        report.slowest_s = report.slowest_s.max(seconds);
        report.most_bytes = report.most_bytes.max(most);
        match outcome {
            Ok(read) => {
                report.read += u64::from(read);
                report.panics_caught += panicked;
                if !read && (number as usize) < subject.seeds.len() && !subject.name.contains(" and 4") {
                    return Err(format!("{}: seed {number} is refused", subject.name).into());
                }
            }
            Err(_) => report.panics_escaped += 1,
        }
        if panicked > 0 || seconds > most_s || most > MAX_BYTES {
            let place = LAST_PANIC.lock().unwrap_or_else(PoisonError::into_inner).clone();
            let place = if panicked > 0 { place } else { String::new() };
            if report.broken.len() < 20 {
                report.broken.push(format!("input {number}: {seconds:.2} s, {} MiB, {place}", most >> 20));
                if let Some(keep) = keep {
                    fs::write(keep.join(format!("{number}-{}", subject.file.replace('/', "-"))), &bytes)?;
                }
            }
        }
    }
    Ok(())
}

/// Which inputs are made.
pub(crate) struct Plan {
    /// Inputs over all readers, shared by their weights.
    pub(crate) executions: u64,
    /// Inputs of each reader instead.
    pub(crate) each: Option<u64>,
    /// Most time of an input on the processor, seconds.
    pub(crate) most_s: f64,
    /// Where the random numbers start; equal seeds give equal inputs.
    pub(crate) seed: u64,
    /// When to stop, done or not.
    pub(crate) most_time: Duration,
}

/// Counts panics from here on. Readers silence panics that they catch with a hook of their own, which they set once: it must be there
/// before this one.
fn count_panics(folder: &Path) -> Outcome<()> {
    let path = folder.join("t.png");
    format::write_rgb_png(&path, 1, 1, &[7; 3])?;
    format::read_texture_png(&path, Transfer::Srgb)?;
    set_hook(Box::new(|info| {
        PANICS.fetch_add(1, Relaxed);
        *LAST_PANIC.lock().unwrap_or_else(PoisonError::into_inner) = info.to_string().replace('\n', " ");
    }));
    Ok(())
}

/// Feeds all readers, a part of the inputs of each at a time, so that all have had some whenever the time is over. Inputs that break a
/// bound are written to `keep`.
pub(crate) fn feed(
    subjects: &[Subject],
    folder: &Path,
    plan: &Plan,
    keep: Option<&Path>,
) -> Outcome<Vec<Report>> {
    count_panics(folder)?;
    let reports = feed_counted(subjects, folder, plan, keep);
    // Panics that come now are told again
    drop(take_hook());
    reports
}

fn feed_counted(
    subjects: &[Subject],
    folder: &Path,
    plan: &Plan,
    keep: Option<&Path>,
) -> Outcome<Vec<Report>> {
    const ROUNDS: u64 = 200;
    let begun = Instant::now();
    let weights: f64 = subjects.iter().map(|subject| subject.weight).sum();
    let random = |number| Random(plan.seed.wrapping_mul(1_000_003).wrapping_add(number));
    let mut states: Vec<(Random, Report)> =
        (0..subjects.len() as u64).map(|number| (random(number), Report::default())).collect();
    'rounds: for round in 1..=ROUNDS {
        for (subject, state) in subjects.iter().zip(&mut states) {
            let shared = plan.executions as f64 * subject.weight / weights;
            let all = plan.each.map_or(shared, |each| each as f64);
            let executions = (all * round as f64 / ROUNDS as f64).ceil() as u64;
            run(subject, folder, (executions, plan.most_s), state, keep)?;
            if begun.elapsed() >= plan.most_time {
                break 'rounds;
            }
        }
    }
    Ok(states.into_iter().map(|(_, report)| report).collect())
}
