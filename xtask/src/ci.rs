//! What must hold before a change is accepted.

use crate::{TestOptions, shell, test_runs};

/// Cheap checks first; the first failure ends the run.
pub fn run(options: &TestOptions) -> anyhow::Result<()> {
    shell::run(&mut shell::cargo(&["fmt", "--all", "--check"]))?;
    build_without_cpp_tools()?;
    shell::run(&mut shell::cargo(&[
        "clippy",
        "--release",
        "--workspace",
        "--all-targets",
        "--",
        "--deny",
        "warnings",
    ]))?;
    document(&[])?;
    document(&["--document-private-items"])?;
    test_runs::run(options)
}

/// The default build needs no C++ compiler, no cmake and no pkg-config. This comes before every other build, so that
/// in a clean clone no build script has run with them.
fn build_without_cpp_tools() -> anyhow::Result<()> {
    for arguments in [
        &["build", "--release", "--workspace"] as &[&str],
        &["build", "--release", "--package", "lapsolve", "--no-default-features"],
    ] {
        let mut build = shell::cargo(arguments);
        shell::run(build.envs(["CXX", "CMAKE", "PKG_CONFIG"].map(|name| (name, "/bin/false"))))?;
    }
    Ok(())
}

fn document(extra: &[&str]) -> anyhow::Result<()> {
    let mut doc = shell::cargo(&["doc", "--release", "--workspace", "--no-deps"]);
    shell::run(doc.args(extra).env("RUSTDOCFLAGS", "--deny warnings"))
}
