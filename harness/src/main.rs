//! The `lapbench` program: built-in backends only. A program with backends of its own looks exactly like this and
//! passes them to [`lapbench::main_with`].

use lapbench::engine::allocation::CountingAllocator;
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

fn main() -> ExitCode {
    lapbench::main_with(&[])
}
