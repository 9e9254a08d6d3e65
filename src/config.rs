//! Configuration: TOML, environment and flags.
