//! Things that a test may have to do without: asked for here, so that every skip is printed and none is silent.

use std::io::Write;
use std::path::PathBuf;

/// What a test needs besides this tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// The folder of real meshes, `$LAPBENCH_DATA`.
    Data,
    /// The interpreter of the reference programs, `$LAPBENCH_REFERENCE`.
    Reference,
    /// A Vulkan device.
    Vulkan,
    /// Chromium and its driver.
    Browser,
    /// Solvers of others, installed by `cargo xtask setup --peers`.
    Peers,
    /// A kernel that lets this user mount in a namespace of its own.
    Namespaces,
}

impl Need {
    /// The word for this need in `$LAPBENCH_REQUIRE`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Data => "data",
            Self::Reference => "reference",
            Self::Vulkan => "vulkan",
            Self::Browser => "browser",
            Self::Peers => "peers",
            Self::Namespaces => "namespaces",
        }
    }

    /// Whether `$LAPBENCH_REQUIRE` forbids to skip what needs this: it is a list of names with commas; `all` and `1`
    /// stand for every name.
    fn is_required(self) -> bool {
        let list = std::env::var("LAPBENCH_REQUIRE").unwrap_or_default();
        list.split(',').map(str::trim).any(|word| word == "all" || word == "1" || word == self.name())
    }
}

/// Says that a test, or a part of one, does not run for want of `need`. The line goes past the test harness's capture.
///
/// # Panics
/// Where `$LAPBENCH_REQUIRE` names the need.
pub fn skip(need: Need, reason: &str) {
    let test = std::thread::current().name().unwrap_or("test").to_owned();
    assert!(
        !need.is_required(),
        "{test} needs {}, which LAPBENCH_REQUIRE forbids to skip: {reason}",
        need.name()
    );
    let mut out = std::io::stdout().lock();
    let _ = writeln!(out, "SKIPPED {test}: {reason}").and_then(|()| out.flush()); // a closed stdout is no test failure
}

/// The folder of real meshes; `None` after a skip was announced.
pub fn data() -> Option<PathBuf> {
    path(
        Need::Data,
        "LAPBENCH_DATA",
        "set LAPBENCH_DATA to the folder that holds meshes/, bad/ and sequences/",
    )
}

/// The Python interpreter that has the reference libraries; `None` after a skip was announced.
pub fn reference() -> Option<PathBuf> {
    path(
        Need::Reference,
        "LAPBENCH_REFERENCE",
        "run through `cargo xtask test`, which installs the references",
    )
}

/// A path from the environment. One that is set but not there is a mistake, never a skip.
fn path(need: Need, variable: &str, remedy: &str) -> Option<PathBuf> {
    let Some(path) = std::env::var_os(variable).filter(|value| !value.is_empty()).map(PathBuf::from) else {
        skip(need, &format!("{variable} is not set; {remedy}"));
        return None;
    };
    assert!(path.exists(), "{variable} is set to {}, which does not exist; {remedy}", path.display());
    Some(path)
}
