//! How much of the work is done.

use std::sync::atomic::{AtomicUsize, Ordering};

/// Counts steps from any thread and reports the share that is done, 0 to 1.
pub(crate) struct Progress<'a> {
    done: AtomicUsize,
    steps: usize,
    report: &'a (dyn Fn(f64) + Sync),
}

impl<'a> Progress<'a> {
    pub(crate) fn new(steps: usize, report: &'a (dyn Fn(f64) + Sync)) -> Self {
        Self { done: AtomicUsize::new(0), steps, report }
    }

    pub(crate) fn step(&self) {
        let done = 1 + self.done.fetch_add(1, Ordering::Relaxed);
        (self.report)(done as f64 / self.steps as f64);
    }
}
