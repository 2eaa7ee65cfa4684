//! The solvers that others would pick, for runs that compare with them: one C++ program, and optional Python wheels.

use std::path::Path;

use crate::{python, shell, system};

/// Python peers, each with a lock file of its own in `reference/peers`: one that has no wheel for this machine is
/// noted and left out.
const WHEELS: [&str; 4] = ["pypardiso", "pyamg", "cholespy", "potpourri3d"];

/// Installs every peer that this machine can have; only the C++ tools themselves are a must.
pub fn install(python: &Path) -> anyhow::Result<()> {
    for wheel in WHEELS {
        let lock_file = shell::root().join("reference/peers").join(wheel).with_extension("txt");
        if let Err(cause) = python::install_optional(python, wheel, &lock_file) {
            eprintln!("xtask: peer {wheel} left out: {cause:#}");
        }
    }
    system::install(system::FOR_PEERS)
}
