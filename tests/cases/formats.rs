//! Versions, point formats, coordinate systems and colors of LAS files.
