//! COPC files: made by a conversion, whatever threads, memory and kills there are.

mod conversion;
mod killed;
mod support;
