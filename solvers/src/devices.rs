//! The Vulkan devices of this machine, for those who want to list them before they open a backend.

use crate::backend::DeviceType;
use crate::error::Unavailable;

/// What a driver says of a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VulkanDevice {
    /// Its name, verbatim.
    pub name: String,
    /// Kind of device.
    pub kind: DeviceType,
    /// Name and version of the driver.
    pub driver: String,
    /// Major and minor version of Vulkan that it speaks.
    pub version: (u32, u32),
}

/// All devices, in the loader's order: their indices are what `OpenOptions::device` takes.
///
/// # Errors
/// What is missing: the feature `vulkan`, the loader, a driver.
pub fn vulkan_devices() -> Result<Vec<VulkanDevice>, Unavailable> {
    #[cfg(feature = "vulkan")]
    {
        let instance = crate::backends::vulkan::Instance::load(None, false)?;
        let version = |v: u32| (ash::vk::api_version_major(v), ash::vk::api_version_minor(v));
        let device = |c: crate::backends::vulkan::Candidate| VulkanDevice {
            name: c.name,
            kind: c.kind,
            driver: c.driver.trim().to_owned(),
            version: version(c.version),
        };
        Ok(instance.devices()?.into_iter().map(device).collect())
    }
    #[cfg(not(feature = "vulkan"))]
    Err(Unavailable::feature("vulkan"))
}
