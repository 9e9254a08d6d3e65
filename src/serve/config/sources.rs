//! What becomes of a data set's files once its octree is published.

use serde::Serialize;

use crate::deserialize_choice;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum OnDone {
    /// They stay where they are.
    #[default]
    Keep,
    /// They go to `done/<name>/` under the root.
    Move,
    /// They are removed.
    Delete,
}

deserialize_choice!(OnDone);

impl OnDone {
    pub fn name(self) -> &'static str {
        match self {
            OnDone::Keep => "keep",
            OnDone::Move => "move",
            OnDone::Delete => "delete",
        }
    }

    pub fn parse(name: &str) -> Option<OnDone> {
        [OnDone::Keep, OnDone::Move, OnDone::Delete].into_iter().find(|what| what.name() == name)
    }
}
