//! The Vulkan loader, found at run time, and what devices there are.
use super::messages::Messages;
use crate::backend::DeviceType;
use crate::error::Unavailable;
use ash::{ext, vk};
use std::ffi::{CStr, CString};
use std::sync::Arc;

/// The validation layer of the Khronos group, used by tests.
const VALIDATION: &CStr = c"VK_LAYER_KHRONOS_validation";

/// A loaded Vulkan instance; destroyed with its last owner.
pub struct Instance {
    raw: ash::Instance,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    messages: Option<Arc<Messages>>,
    _entry: ash::Entry, // the library stays loaded as long as its functions are called
}

/// A device that could be opened.
#[derive(Clone)]
pub struct Candidate {
    /// The driver's handle.
    pub raw: vk::PhysicalDevice,
    /// deviceName verbatim.
    pub name: String,
    /// Kind of device.
    pub kind: DeviceType,
    /// Name and version of the driver, where it tells.
    pub driver: String,
    /// Version of Vulkan it speaks.
    pub version: u32,
}

impl Instance {
    /// Loads `libvulkan`, or `library` instead, and makes an instance. With `validation`, the Khronos layer checks every call, with
    /// synchronisation validation, and its warnings and errors are collected in [`messages`](Self::messages).
    ///
    /// # Errors
    /// What is missing and how to get it: the loader, a driver, or the layer.
    pub fn load(library: Option<&str>, validation: bool) -> Result<Self, Unavailable> {
        // SAFETY: loading runs the library's initialisers; a Vulkan loader is meant for that.
        let entry = unsafe { library.map_or_else(|| ash::Entry::load(), |path| ash::Entry::load_from(path)) };
        let entry = entry.map_err(|error| Unavailable {
            what: format!("the Vulkan loader cannot be loaded ({error})"),
            how_to_get_it: "install libvulkan.so.1 (Debian, Ubuntu: libvulkan1)".into(),
        })?;
        let messages = validation.then(|| Arc::new(Messages::default()));
        // SAFETY: the structures passed live until the call returns; the messages live as long as the instance.
        unsafe { Self::create(entry, messages) }
    }

    unsafe fn create(entry: ash::Entry, messages: Option<Arc<Messages>>) -> Result<Self, Unavailable> {
        let application = vk::ApplicationInfo::default()
            .application_name(c"lapsolve")
            .engine_name(c"lapsolve")
            .api_version(vk::API_VERSION_1_2);
        let mut info = vk::InstanceCreateInfo::default().application_info(&application);
        let (layers, extensions) = ([VALIDATION.as_ptr()], [ext::debug_utils::NAME.as_ptr()]);
        let enabled = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&enabled);
        let mut messenger_info = messages.as_deref().map(Messages::messenger);
        if let Some(messenger) = &mut messenger_info {
            has_layer(&entry)?;
            info = info.enabled_layer_names(&layers).enabled_extension_names(&extensions);
            info = info.push_next(&mut features).push_next(messenger);
        }
        // SAFETY: all of `info` is alive.
        let raw = unsafe { entry.create_instance(&info, None) }.map_err(no_driver)?;
        let mut instance = Self { raw, messenger: None, messages, _entry: entry };
        if let Some(messages) = &instance.messages {
            let functions = ext::debug_utils::Instance::new(&instance._entry, &instance.raw);
            // SAFETY: the messages outlive the messenger, which `drop` destroys first.
            let made = unsafe { functions.create_debug_utils_messenger(&messages.messenger(), None) };
            instance.messenger = Some((functions, made.map_err(no_driver)?));
        }
        Ok(instance)
    }

    /// Vulkan's instance functions.
    pub fn raw(&self) -> &ash::Instance {
        &self.raw
    }

    /// What the validation layer said, where it is on.
    pub fn messages(&self) -> Option<&Messages> {
        self.messages.as_deref()
    }

    /// All devices in the loader's order.
    ///
    /// # Errors
    /// Where there is none, or the drivers fail.
    pub fn devices(&self) -> Result<Vec<Candidate>, Unavailable> {
        // SAFETY: the instance is alive.
        let devices = unsafe { self.raw.enumerate_physical_devices() }.map_err(no_driver)?;
        if devices.is_empty() {
            return Err(no_driver(vk::Result::ERROR_INITIALIZATION_FAILED));
        }
        Ok(devices.into_iter().map(|raw| self.candidate(raw)).collect())
    }

    fn candidate(&self, raw: vk::PhysicalDevice) -> Candidate {
        // SAFETY: `raw` comes from this instance.
        let basic = unsafe { self.raw.get_physical_device_properties(raw) };
        let mut driver = vk::PhysicalDeviceDriverProperties::default();
        if basic.api_version >= vk::API_VERSION_1_2 {
            let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut driver);
            // SAFETY: as above, and the device speaks a version that has the structure.
            unsafe { self.raw.get_physical_device_properties2(raw, &mut all) };
        }
        let words = |text: Result<&CStr, _>| text.map_or(String::new(), |t| t.to_string_lossy().into_owned());
        Candidate {
            raw,
            name: words(basic.device_name_as_c_str()),
            kind: match basic.device_type {
                vk::PhysicalDeviceType::CPU => DeviceType::SoftwareVulkan,
                vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceType::Integrated,
                _ => DeviceType::Discrete,
            },
            driver: format!(
                "{} {}",
                words(driver.driver_name_as_c_str()),
                words(driver.driver_info_as_c_str())
            ),
            version: basic.api_version,
        }
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: everything made from the instance holds a reference to it and is gone by now.
        unsafe {
            if let Some((functions, messenger)) = self.messenger.take() {
                functions.destroy_debug_utils_messenger(messenger, None);
            }
            self.raw.destroy_instance(None);
        }
    }
}

fn has_layer(entry: &ash::Entry) -> Result<(), Unavailable> {
    // SAFETY: the loader is loaded.
    let layers = unsafe { entry.enumerate_instance_layer_properties() }.map_err(no_driver)?;
    let wanted: CString = VALIDATION.into();
    if layers.iter().any(|layer| layer.layer_name_as_c_str() == Ok(&wanted)) {
        return Ok(());
    }
    Err(Unavailable {
        what: "the Vulkan validation layer is not installed".into(),
        how_to_get_it: "install it (Debian, Ubuntu: vulkan-validationlayers)".into(),
    })
}

/// What the loader's refusals mean: no driver file at all, or drivers without hardware.
fn no_driver(result: vk::Result) -> Unavailable {
    Unavailable {
        what: format!("no Vulkan driver with a device ({result})"),
        how_to_get_it: "install the GPU's Vulkan driver, or lavapipe for the CPU (Debian, Ubuntu: \
                        mesa-vulkan-drivers); VK_DRIVER_FILES, if set, must name its JSON file"
            .into(),
    }
}
