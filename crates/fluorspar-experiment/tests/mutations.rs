//! Damaged files for every reader: none may panic, hang or take more than 1 GiB.
//!
//! A program of its own, because it counts the memory and the panics of the whole process. `examples/mutate_inputs` feeds as many files
//! as one likes to the same readers.

#![allow(unsafe_code, reason = "an allocator that counts is an unsafe trait")]

#[path = "../examples/mutate_inputs/damage.rs"]
mod damage;
#[path = "../examples/mutate_inputs/readers.rs"]
mod readers;
#[path = "../examples/mutate_inputs/trials.rs"]
mod trials;

use std::time::Duration;

use readers::Subjects;
use trials::{Plan, feed};

/// Damaged files of each reader.
const EACH: u64 = 200;

/// Time on the processor beyond which a reader hangs, seconds: unoptimized, and on a busy machine.
const HANGS_S: f64 = 60.0;
/// Stack of the thread that reads, as the first thread of a program has it: unoptimized readers of deeply nested tables need more than the
/// two MiB of other threads.
const STACK_BYTES: usize = 8 << 20;

#[test]
fn damaged_files_are_refused_or_read_without_panic_hang_or_much_memory() {
    let feed_all = || {
        let folder = tempfile::tempdir().unwrap();
        let subjects = Subjects::all(folder.path()).unwrap().list;
        let plan =
            Plan { executions: 0, each: Some(EACH), most_s: HANGS_S, seed: 1, most_time: Duration::MAX };
        let reports = feed(&subjects, folder.path(), &plan, None).unwrap();
        for (subject, report) in subjects.iter().zip(&reports) {
            assert_eq!(report.executions, EACH, "{}", subject.name);
            // A reader that refuses or takes everything would not look at what is damaged
            assert!((1..EACH).contains(&report.read), "{}: {} read", subject.name, report.read);
            assert!(report.broken.is_empty(), "{}: {:?}", subject.name, report.broken);
            assert_eq!(report.panics_escaped, 0, "{}", subject.name);
        }
    };
    let reader = std::thread::Builder::new().stack_size(STACK_BYTES).spawn(feed_all).unwrap();
    reader.join().unwrap();
}
