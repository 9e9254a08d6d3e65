//! COPC files: made by a conversion, whatever threads, memory and kills there are.

mod conversion;
mod daemon;
mod killed;
mod support;
