//! Vulkan: the loader, the drivers that are installed, and the devices.

use super::finding::Finding;
use crate::environment::Root;
use crate::record::names::DeviceType;
use lapsolve::devices::{VulkanDevice, vulkan_devices};
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Folders where a Linux system keeps shared libraries.
const LIBRARIES: [&str; 8] = [
    "usr/lib",
    "usr/lib64",
    "lib",
    "lib64",
    "usr/lib/x86_64-linux-gnu",
    "usr/lib/aarch64-linux-gnu",
    "usr/local/lib",
    "run/opengl-driver/lib",
];

/// Folders of the manifests by which drivers announce themselves to the loader.
const MANIFESTS: [&str; 4] = [
    "usr/share/vulkan/icd.d",
    "etc/vulkan/icd.d",
    "usr/local/share/vulkan/icd.d",
    "run/opengl-driver/share/vulkan/icd.d",
];

/// Loader and drivers as files below `root`, and the drivers that the environment names.
pub fn installed(root: &Root, variable: impl Fn(&str) -> Option<OsString>) -> Vec<Finding> {
    let loaders: Vec<String> = LIBRARIES
        .iter()
        .flat_map(|folder| root.entries(folder))
        .filter(|path| name(path).starts_with("libvulkan.so.1"))
        .map(|path| format!("/{}", path.strip_prefix(&root.0).unwrap_or(&path).display()))
        .collect();
    let value = |name| variable(name).filter(|value| !value.is_empty());
    // The second is the first's former name. Either takes the place of the loader's folders.
    let instead = value("VK_DRIVER_FILES").or_else(|| value("VK_ICD_FILENAMES"));
    let searched = if instead.is_some() { &[][..] } else { &MANIFESTS[..] };
    let besides = value("VK_ADD_DRIVER_FILES");
    let named = instead.iter().chain(&besides).flat_map(std::env::split_paths);
    let (present, missing): (Vec<_>, Vec<_>) = named.partition(|path| path.exists());
    let of_folder = |path: PathBuf| match path.is_dir() {
        true => std::fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.path()).collect(),
        false => vec![path],
    };
    let drivers: BTreeSet<String> = searched
        .iter()
        .flat_map(|folder| root.entries(folder))
        .chain(present.into_iter().flat_map(of_folder))
        .map(|path| name(&path))
        .filter(|name| name.ends_with(".json"))
        .map(|name| name.trim_end_matches(".json").to_owned())
        .chain(
            missing
                .iter()
                .map(|path| format!("{} (named by the environment, does not exist)", path.display())),
        )
        .collect();
    let list =
        |items: Vec<String>, none: &str| if items.is_empty() { none.to_owned() } else { items.join(", ") };
    vec![
        Finding::new(
            "Vulkan loader",
            Some(!loaders.is_empty()),
            list(loaders, "not found"),
            "install it, with Debian `apt-get install libvulkan1`; without it no GPU backend runs",
        ),
        Finding::new(
            "Vulkan drivers",
            Some(drivers.len() > missing.len()),
            list(drivers.into_iter().collect(), "none"),
            "install the driver of your GPU (AMD, Intel: `apt-get install mesa-vulkan-drivers`, which has software Vulkan \
             for tests too; NVIDIA: its own driver)",
        ),
    ]
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Every device that the loader finds, with what its driver says of itself.
pub fn devices() -> Vec<Finding> {
    let found = match vulkan_devices() {
        Ok(found) => found,
        Err(why) => {
            return vec![Finding::new("Vulkan device", Some(false), why.what, &why.how_to_get_it)];
        }
    };
    let finding = |device: &VulkanDevice| {
        let kind = DeviceType::from(device.kind);
        let (major, minor) = device.version;
        Finding::new(
            "Vulkan device",
            Some(kind != DeviceType::SoftwareVulkan),
            format!("{} ({kind}), driver {}, Vulkan {major}.{minor}", device.name, device.driver),
            "this driver computes on the CPU: good for tests, not for figures; a GPU needs its own driver and access to \
             /dev/dri",
        )
    };
    found.iter().map(finding).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_installed_is_said_with_the_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let found = installed(&Root(folder.path().to_owned()), |_| None);
        assert!(found.iter().all(|f| f.good == Some(false) && f.remedy.is_some()), "{found:?}");
    }

    #[test]
    fn loader_and_drivers_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let file = |path: &str| {
            let path = folder.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        };
        file("usr/lib64/libvulkan.so.1");
        file("usr/share/vulkan/icd.d/lvp_icd.x86_64.json");
        file("usr/share/vulkan/icd.d/README");
        let found = installed(&Root(folder.path().to_owned()), |_| None);
        assert_eq!(found[0].found, "/usr/lib64/libvulkan.so.1");
        assert_eq!((found[1].found.as_str(), found[1].good), ("lvp_icd.x86_64", Some(true)));
    }

    #[test]
    fn drivers_named_by_the_environment_take_the_place_of_the_folders() {
        let folder = tempfile::tempdir().unwrap();
        let own = folder.path().join("own_icd.json");
        std::fs::write(&own, "").unwrap();
        let manifests = folder.path().join("usr/share/vulkan/icd.d");
        std::fs::create_dir_all(&manifests).unwrap();
        std::fs::write(manifests.join("lvp_icd.json"), "").unwrap();
        let root = Root(folder.path().to_owned());
        let drivers = |name: &'static str, value: OsString| {
            let found = installed(&root, move |variable| (variable == name).then(|| value.clone()));
            (found[1].found.clone(), found[1].good)
        };
        assert_eq!(drivers("VK_DRIVER_FILES", own.clone().into()), ("own_icd".into(), Some(true)));
        assert_eq!(drivers("VK_ADD_DRIVER_FILES", own.into()), ("lvp_icd, own_icd".into(), Some(true)));
        let (found, good) = drivers("VK_DRIVER_FILES", "/nonexistent/none.json".into());
        assert!(found.starts_with("/nonexistent/none.json") && good == Some(false), "{found}");
    }
}
