//! LAS and LAZ: the only module that knows the `las` and `laz` crates.
