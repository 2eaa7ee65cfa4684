//! System libraries and tools: found by looking for the files themselves, so that any distribution will do;
//! installed with apt where that is there and we are root, else named one by one.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::bail;

use crate::shell;

/// Something the tests need from the system.
pub struct Requirement {
    /// Debian's package.
    package: &'static str,
    purpose: &'static str,
    probe: Probe,
}

/// How to see that a requirement is there.
enum Probe {
    /// A file in one of the folders for shared libraries, by the beginning of its name.
    Library(&'static str),
    /// A file in one of these folders, by the beginning of its name.
    File { folders: &'static [&'static str], prefix: &'static str },
    /// A program on the path that exits with 0.
    Program { name: &'static str, arguments: &'static [&'static str] },
}

const VULKAN_DRIVERS: &[&str] =
    &["/usr/share/vulkan/icd.d", "/usr/local/share/vulkan/icd.d", "/etc/vulkan/icd.d"];
const VULKAN_LAYERS: &[&str] = &[
    "/usr/share/vulkan/explicit_layer.d",
    "/usr/local/share/vulkan/explicit_layer.d",
    "/etc/vulkan/explicit_layer.d",
];
const HEADERS: &[&str] =
    &["/usr/include", "/usr/include/suitesparse", "/usr/include/eigen3", "/usr/local/include"];

/// What `cargo xtask test` uses.
pub const FOR_TESTS: &[Requirement] = &[
    Requirement {
        package: "python3-venv",
        purpose: "Python 3.11 or newer with venv and pip, for the reference programs",
        probe: Probe::Program {
            name: "python3",
            arguments: &["-c", "import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))"],
        },
    },
    Requirement {
        package: "libusb-1.0-0",
        purpose: "loaded by Open3D",
        probe: Probe::Library("libusb-1.0.so.0"),
    },
    Requirement { package: "libgl1", purpose: "loaded by Open3D", probe: Probe::Library("libGL.so.1") },
    Requirement { package: "libegl1", purpose: "loaded by Open3D", probe: Probe::Library("libEGL.so.1") },
    Requirement { package: "libgomp1", purpose: "loaded by Open3D", probe: Probe::Library("libgomp.so.1") },
    Requirement {
        package: "libvulkan1",
        purpose: "the Vulkan loader",
        probe: Probe::Library("libvulkan.so.1"),
    },
    Requirement {
        package: "mesa-vulkan-drivers",
        purpose: "lavapipe, the Vulkan device of machines without a GPU",
        probe: Probe::File { folders: VULKAN_DRIVERS, prefix: "lvp_icd" },
    },
    Requirement {
        package: "vulkan-validationlayers",
        purpose: "checks every Vulkan call of the tests",
        probe: Probe::File { folders: VULKAN_LAYERS, prefix: "VkLayer_khronos_validation" },
    },
    Requirement {
        package: "glslang-tools",
        purpose: "compiles the shaders again, to compare with the ones in the tree",
        probe: Probe::Program { name: "glslangValidator", arguments: &["--version"] },
    },
];

/// What the test of the HTML report opens it with.
pub const FOR_BROWSER: &[Requirement] = &[
    Requirement {
        package: "chromium",
        purpose: "opens the HTML report in a test",
        probe: Probe::Program { name: "chromium", arguments: &["--version"] },
    },
    Requirement {
        package: "chromium-driver",
        purpose: "drives the browser of that test",
        probe: Probe::Program { name: "chromedriver", arguments: &["--version"] },
    },
];

/// What the C++ peers are built with.
pub const FOR_PEERS: &[Requirement] = &[
    Requirement {
        package: "g++",
        purpose: "compiles the C++ peer",
        probe: Probe::Program { name: "g++", arguments: &["--version"] },
    },
    Requirement {
        package: "libsuitesparse-dev",
        purpose: "CHOLMOD",
        probe: Probe::File { folders: HEADERS, prefix: "cholmod.h" },
    },
    Requirement {
        package: "libeigen3-dev",
        purpose: "Eigen",
        probe: Probe::File { folders: HEADERS, prefix: "Eigen" },
    },
    Requirement {
        package: "libmetis-dev",
        purpose: "METIS",
        probe: Probe::File { folders: HEADERS, prefix: "metis.h" },
    },
    Requirement {
        package: "nlohmann-json3-dev",
        purpose: "JSON, for the peer protocol",
        probe: Probe::File { folders: HEADERS, prefix: "nlohmann" },
    },
    Requirement {
        package: "libopenblas-dev",
        purpose: "the BLAS of CHOLMOD's supernodal code",
        probe: Probe::Library("libopenblas.so"),
    },
];

/// Installs what is missing, or fails naming each package and what it is for.
pub fn install(requirements: &[Requirement]) -> anyhow::Result<()> {
    let missing = missing(requirements);
    if missing.is_empty() {
        return Ok(());
    }
    let packages: Vec<&str> = missing.iter().map(|requirement| requirement.package).collect();
    if !is_root() || !shell::succeeds(&mut shell::command("apt-get", &["--version"])) {
        bail!("{}", explanation(&missing, "without root and apt nothing can be installed here"));
    }
    let mut install = vec!["install", "--yes", "--no-install-recommends"];
    install.extend(&packages);
    let installed = apt(&["update"]).and_then(|()| apt(&install));
    let still_missing = self::missing(requirements);
    match (installed, still_missing.is_empty()) {
        (_, true) => Ok(()),
        (Err(cause), false) => {
            Err(cause.context(explanation(&still_missing, "apt could not install all (no network?)")))
        }
        (Ok(()), false) => {
            bail!("{}", explanation(&still_missing, "apt reports success, but these are not found"))
        }
    }
}

/// Installs what is missing, or says what will be skipped without it.
pub fn install_optional(requirements: &[Requirement]) {
    if let Err(cause) = install(requirements) {
        eprintln!("xtask: going on without: {cause:#}");
    }
}

fn missing(requirements: &[Requirement]) -> Vec<&Requirement> {
    requirements.iter().filter(|requirement| !requirement.probe.finds()).collect()
}

fn explanation(missing: &[&Requirement], reason: &str) -> String {
    let mut text = format!("missing on this machine ({reason}):\n");
    for Requirement { package, purpose, .. } in missing {
        text += &format!("  {package:<24} {purpose}\n");
    }
    let packages: Vec<&str> = missing.iter().map(|requirement| requirement.package).collect();
    text + &format!(
        "on Debian or Ubuntu: sudo apt-get install --no-install-recommends {}",
        packages.join(" ")
    )
}

fn apt(arguments: &[&str]) -> anyhow::Result<()> {
    shell::run(shell::command("apt-get", arguments).env("DEBIAN_FRONTEND", "noninteractive"))
}

fn is_root() -> bool {
    let id = shell::command("id", &["-u"]).output();
    id.is_ok_and(|output| output.stdout.trim_ascii() == b"0")
}

impl Probe {
    fn finds(&self) -> bool {
        match self {
            Self::Library(prefix) => library_folders().iter().any(|folder| holds(folder, prefix)),
            Self::File { folders, prefix } => folders.iter().any(|folder| holds(Path::new(folder), prefix)),
            Self::Program { name, arguments } => shell::succeeds(&mut shell::command(name, arguments)),
        }
    }
}

/// Debian's folder for this processor, and those of other distributions.
fn library_folders() -> Vec<PathBuf> {
    let debian = format!("/usr/lib/{}-linux-gnu", std::env::consts::ARCH);
    [debian.as_str(), "/usr/lib64", "/usr/lib", "/usr/local/lib"].iter().map(PathBuf::from).collect()
}

fn holds(folder: &Path, prefix: &str) -> bool {
    let Ok(entries) = fs::read_dir(folder) else { return false };
    entries.flatten().any(|entry| entry.file_name().to_string_lossy().starts_with(prefix))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_library_is_named_with_its_package_and_purpose() {
        let absent = Requirement {
            package: "libnone1",
            purpose: "loaded by nobody",
            probe: Probe::Library("libnone.so.1"),
        };
        let requirements = [absent];
        let missing = missing(&requirements);
        let text = explanation(&missing, "reason");
        assert!(
            text.contains("libnone1")
                && text.contains("loaded by nobody")
                && text.contains("apt-get install"),
            "{text}"
        );
    }

    #[test]
    fn probes_tell_present_from_absent() {
        assert!(Probe::Library("libc.so").finds());
        assert!(Probe::Program { name: "sh", arguments: &["-c", "exit 0"] }.finds());
        assert!(!Probe::Program { name: "sh", arguments: &["-c", "exit 1"] }.finds());
        assert!(!Probe::File { folders: &["/nowhere"], prefix: "" }.finds());
    }
}
