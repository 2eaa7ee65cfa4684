//! The `lapbench` program.
fn main() {}
