//! Arguments to exit code; everything else is in the library.

use std::process::ExitCode;

use lodestone::platform::allocator::LargePages;

#[global_allocator]
static MEMORY: LargePages = LargePages;

fn main() -> ExitCode {
    lodestone::cli::run()
}
