//! Project tasks: `cargo xtask setup`, `cargo xtask test`, `cargo xtask ci`.
fn main() {}
