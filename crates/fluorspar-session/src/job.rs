//! What a task runs with: what ends it early, and who hears of it.

use std::any::Any;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use fluorspar_experiment::Warning;

/// What a task runs with. Every task has its own: one that is stopped stops no other.
#[derive(Clone)]
pub struct Job {
    /// Set from any thread: ends the task early, with what it has where it can give that.
    pub stop: Arc<AtomicBool>,
    /// Hears what is done, and what the user should know.
    pub listener: Arc<dyn Listener>,
    /// Whether a time limit set `stop`.
    is_out_of_time: Arc<AtomicBool>,
}

impl Job {
    /// A task that a flag ends.
    pub fn new(stop: Arc<AtomicBool>, listener: Arc<dyn Listener>) -> Self {
        Self { stop, listener, is_out_of_time: Arc::default() }
    }

    /// Whether the task was asked to end, other than by a time limit of its own.
    pub fn is_interrupted(&self) -> bool {
        self.is_stopped() && !self.is_out_of_time.load(Ordering::SeqCst)
    }

    /// Whether the task is to end.
    pub fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::SeqCst)
    }

    /// Ends the task for its time limit.
    pub(crate) fn end_by_time(&self) {
        if !self.stop.swap(true, Ordering::SeqCst) {
            self.is_out_of_time.store(true, Ordering::SeqCst);
        }
    }

    /// Says what is being done or was done.
    pub fn status(&self, text: impl AsRef<str>) {
        self.listener.status(text.as_ref());
    }

    /// Warns of what makes a result doubtful.
    pub fn warn(&self, warnings: &[Warning]) {
        self.listener.warnings(warnings);
    }
}

/// Who hears of a task.
pub trait Listener: Send + Sync {
    /// What is being done or was done, one or more lines.
    fn status(&self, text: &str);

    /// Whether anybody hears that: what only it needs is left out otherwise.
    fn hears_status(&self) -> bool {
        true
    }

    /// What makes a result doubtful.
    fn warnings(&self, warnings: &[Warning]);

    /// Work that takes a while begins. What is returned is called from any thread with the share that is done, from 0 to 1, and dropped at the
    /// end. `title` is what is done, at the beginning of a line, `name` the same within a sentence, `left` what a stop leaves.
    fn begin(&self, title: &'static str, name: &'static str, left: Left) -> Box<dyn Fn(f64) + Sync>;

    /// A large file is being written, until what is returned is dropped.
    fn begin_writing(&self, _file: &Path) -> Box<dyn Any> {
        Box::new(())
    }
}

/// What is left of work that is stopped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Left {
    /// The image with the samples so far.
    #[default]
    Image = 1,
    /// The film, with which the render goes on.
    Film = 2,
    /// The results so far.
    Results = 3,
    /// Nothing.
    Nothing = 0,
}
