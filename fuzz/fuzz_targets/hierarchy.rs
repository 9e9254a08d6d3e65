#![no_main]

libfuzzer_sys::fuzz_target!(init: readers::start(), |bytes: &[u8]| readers::try_one(readers::hierarchy, bytes));
