//! Problems that users of other converters reported (`docs/needs.md` lists them).

mod files;
mod geometry;
mod machine;
mod output;
mod watcher;
