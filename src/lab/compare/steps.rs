//! How far a comparison has come.

use crate::lab::settings::Step;

/// Counts the steps as they are taken.
pub struct Steps<'a> {
    pub done: std::cell::Cell<usize>,
    pub of: usize,
    pub say: &'a dyn Fn(Step),
}

impl Steps<'_> {
    /// Begins the next step.
    pub fn next(&self, what: String) {
        (self.say)(Step { done: self.done.get(), of: self.of, what });
        self.done.set(self.done.get() + 1);
    }
}
