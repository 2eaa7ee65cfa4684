//! An opened device with its queue, its limits and our own memory budget.
use super::error::{DeviceError, calling};
use super::faults::Faults;
use super::instance::{Candidate, Instance};
use crate::backend::{Description, DeviceType};
use crate::error::Unavailable;
use ash::vk;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// How kernels read buffers that they do not write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Uniform texel buffers, 16 bytes at a time: on lavapipe three to four times as fast as storage buffers.
    Texel,
    /// Storage buffers: what GPUs read best.
    Storage,
}

/// Switches of a device; the default is right for everything but tests.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Have the validation layer check every call. On in this crate's own tests.
    pub validation: bool,
    /// Copy through staging buffers even where the host sees the device's memory.
    pub force_staging: bool,
    /// How kernels read; `None`: by kind of device.
    pub access: Option<Access>,
    /// Bytes that may be allocated; `None`: nine tenths of the device's largest heap.
    pub budget: Option<u64>,
    /// Bytes that a kernel may see of one buffer; `None`: the device's limit.
    pub range: Option<u64>,
    /// Take the device for one without f64 in shaders.
    pub without_f64: bool,
    /// The loader's library; `None`: where the system has it.
    pub loader: Option<&'static str>,
}

/// Every test of this crate runs under the validation layer.
const IN_TESTS: bool = cfg!(test);

impl Default for Settings {
    fn default() -> Self {
        Self {
            validation: IN_TESTS,
            force_staging: false,
            access: None,
            budget: None,
            range: None,
            without_f64: false,
            loader: None,
        }
    }
}

/// Limits and features that decide how we use the device.
#[derive(Clone, Copy, Debug)]
pub struct Traits {
    /// Whether shaders have f64.
    pub f64: bool,
    /// Invocations per subgroup.
    pub subgroup: u32,
    /// Operations within a subgroup.
    pub subgroup_operations: vk::SubgroupFeatureFlags,
    /// Most bytes that a kernel may see of one buffer.
    pub range: u64,
    /// Workgroups per axis.
    pub groups: u32,
    /// Nanoseconds per tick of a timestamp; `None` where the queue has none.
    pub tick_ns: Option<f32>,
    /// Valid bits of a timestamp.
    pub tick_bits: u32,
}

impl Traits {
    /// Whether the lanes of a subgroup can hand numbers round.
    pub fn shuffles(&self) -> bool {
        self.subgroup_operations.contains(vk::SubgroupFeatureFlags::SHUFFLE)
    }
}

/// Parts of a buffer that kernels see start at multiples of this: the largest alignment a driver may ask for.
pub const ALIGNMENT: u64 = 256;

/// A device with one queue. Buffers, kernels and recordings hold it by [`Arc`] and are gone before it.
pub struct Device {
    raw: ash::Device,
    /// The one lock of a frame.
    queue: Mutex<vk::Queue>,
    family: u32,
    memory: vk::PhysicalDeviceMemoryProperties,
    candidate: Candidate,
    traits: Traits,
    access: Access,
    unified: bool,
    budget: u64,
    used: AtomicU64,
    /// Failures that tests ask for.
    pub(super) faults: Faults,
    instance: Instance, // last: dropped after the device is destroyed
}

impl Device {
    /// Opens the device chosen by `choice`: an index of the loader's list, part of a name (case does not matter), or
    /// `None`: the first of the best kind, a discrete GPU before an integrated one before a software device.
    ///
    /// # Errors
    /// What is missing: loader, driver, device, version.
    pub fn open(choice: Option<&str>, settings: &Settings) -> Result<Arc<Self>, Unavailable> {
        let instance = Instance::load(settings.loader, settings.validation)?;
        let candidate = choose(instance.devices()?, choice)?;
        if candidate.version < vk::API_VERSION_1_1 {
            return Err(Unavailable {
                what: format!("{} does not speak Vulkan 1.1", candidate.name),
                how_to_get_it: "update its driver".into(),
            });
        }
        Self::create(instance, candidate, settings).map(Arc::new)
    }

    fn create(instance: Instance, candidate: Candidate, settings: &Settings) -> Result<Self, Unavailable> {
        let unavailable = |what: String| Unavailable {
            what: format!("{}: {what}", candidate.name),
            how_to_get_it: "choose another device with --device, or update its driver".into(),
        };
        let (vk, device) = (instance.raw(), candidate.raw);
        // SAFETY: the handle comes from this instance.
        let families = unsafe { vk.get_physical_device_queue_family_properties(device) };
        let family = families
            .iter()
            .position(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE))
            .ok_or_else(|| unavailable("no queue that computes".into()))?;
        let mut traits = traits(vk, device, &families[family]);
        traits.f64 &= !settings.without_f64;
        // SAFETY: as above.
        let memory = unsafe { vk.get_physical_device_memory_properties(device) };
        let raw = make(vk, device, family as u32, traits.f64).map_err(|e| unavailable(e.to_string()))?;
        // SAFETY: the queue was asked for when the device was made.
        let queue = unsafe { raw.get_device_queue(family as u32, 0) };
        let software = candidate.kind == DeviceType::SoftwareVulkan;
        // The kernels that read texel buffers hand numbers round.
        let texel = software && traits.shuffles();
        let access = settings.access.unwrap_or(if texel { Access::Texel } else { Access::Storage });
        let limits = limits(vk, device);
        traits.range = settings.range.unwrap_or(match access {
            Access::Texel => 16 * u64::from(limits.max_texel_buffer_elements),
            Access::Storage => u64::from(limits.max_storage_buffer_range),
        });
        let heaps = memory.memory_heaps_as_slice().iter();
        let local = heaps.filter(|heap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
        let largest = local.map(|heap| heap.size).max().unwrap_or(0);
        let everything = vk::MemoryPropertyFlags::DEVICE_LOCAL
            | vk::MemoryPropertyFlags::HOST_VISIBLE
            | vk::MemoryPropertyFlags::HOST_COHERENT
            | vk::MemoryPropertyFlags::HOST_CACHED;
        let shared = memory.memory_types_as_slice().iter().any(|t| t.property_flags.contains(everything));
        Ok(Self {
            raw,
            queue: Mutex::new(queue),
            family: family as u32,
            memory,
            traits,
            access,
            unified: shared && candidate.kind != DeviceType::Discrete && !settings.force_staging,
            budget: settings.budget.unwrap_or(largest / 10 * 9),
            used: AtomicU64::new(0),
            faults: Faults::default(),
            candidate,
            instance,
        })
    }

    /// Vulkan's device functions.
    pub fn raw(&self) -> &ash::Device {
        &self.raw
    }

    /// Limits and features.
    pub fn traits(&self) -> &Traits {
        &self.traits
    }

    /// How kernels read.
    pub fn access(&self) -> Access {
        self.access
    }

    /// Whether kernels run on a processor of their own and not on the host's: it decides who does what either can do, for a
    /// software device does nothing as well as the host's own code. Those read texel buffers.
    pub fn is_apart(&self) -> bool {
        self.access == Access::Storage
    }

    /// Whether host and device share memory, so that nothing is copied.
    pub fn is_unified(&self) -> bool {
        self.unified
    }

    /// Queue family of command pools.
    pub fn family(&self) -> u32 {
        self.family
    }

    /// Kind of device.
    pub fn kind(&self) -> DeviceType {
        self.candidate.kind
    }

    /// Bytes allocated now.
    pub fn used(&self) -> u64 {
        self.used.load(Ordering::Relaxed)
    }

    /// What the validation layer said so far; empty without it.
    pub fn messages(&self) -> Vec<String> {
        self.instance.messages().map_or(Vec::new(), |messages| messages.list())
    }

    /// For [`crate::backend::Backend::describe`].
    pub fn describe(&self, threads: usize) -> Description {
        let Candidate { name, kind, driver, version, .. } = &self.candidate;
        let version = format!(
            "{}.{}.{}",
            vk::api_version_major(*version),
            vk::api_version_minor(*version),
            vk::api_version_patch(*version)
        );
        let reads = if self.access == Access::Texel { "texel buffers" } else { "storage buffers" };
        let memory = if self.unified { "shared" } else { "staged" };
        Description {
            device: name.clone(),
            device_type: *kind,
            threads,
            details: vec![
                ("driver", driver.trim().into()),
                ("vulkan", version),
                ("subgroup", self.traits.subgroup.to_string()),
                ("reads", reads.into()),
                ("memory", memory.into()),
            ],
        }
    }

    /// An error naming what to use instead, unless shaders have f64.
    ///
    /// # Errors
    /// [`Unavailable`].
    pub fn require_f64(&self, instead: &str) -> Result<(), Unavailable> {
        if self.traits.f64 {
            return Ok(());
        }
        Err(Unavailable {
            what: format!("{} has no f64 in shaders", self.candidate.name),
            how_to_get_it: format!("use {instead}, or choose another device with --device"),
        })
    }

    /// Memory of one of the types in `allowed` with all flags of `required` and, where there is one, of `wished`.
    ///
    /// # Errors
    /// Over the budget, or where the driver refuses.
    pub(super) fn allocate(
        &self,
        needs: vk::MemoryRequirements,
        required: vk::MemoryPropertyFlags,
        wished: vk::MemoryPropertyFlags,
    ) -> Result<vk::DeviceMemory, DeviceError> {
        let bytes = needs.size;
        let types = self.memory.memory_types_as_slice();
        let find = |flags| {
            let fits =
                |i: usize| needs.memory_type_bits >> i & 1 == 1 && types[i].property_flags.contains(flags);
            (0..types.len()).find(|&i| fits(i))
        };
        let index = find(required | wished)
            .or_else(|| find(required))
            .ok_or_else(|| DeviceError::Unsupported(format!("no memory of the kind {required:?}")))?;
        let out_of_memory = |_| DeviceError::OutOfMemory { bytes };
        self.faults.allocation().map_err(out_of_memory)?;
        if self.used.fetch_add(bytes, Ordering::Relaxed) + bytes > self.budget {
            self.release(bytes);
            return Err(DeviceError::OutOfMemory { bytes });
        }
        let info = vk::MemoryAllocateInfo::default().allocation_size(bytes).memory_type_index(index as u32);
        // SAFETY: the device is alive, the type index valid.
        unsafe { self.raw.allocate_memory(&info, None) }.map_err(|result| {
            self.release(bytes);
            out_of_memory(result)
        })
    }

    /// Takes bytes back into the budget.
    pub(super) fn release(&self, bytes: u64) {
        self.used.fetch_sub(bytes, Ordering::Relaxed);
    }

    /// Hands a recorded command buffer to the queue.
    pub(super) fn submit(&self, commands: vk::CommandBuffer, fence: vk::Fence) -> Result<(), DeviceError> {
        self.faults.submission().map_err(calling("vkQueueSubmit"))?;
        let commands = [commands];
        let info = [vk::SubmitInfo::default().command_buffers(&commands)];
        let queue = self.queue.lock().map_err(|_| DeviceError::Lost("a frame panicked".into()))?;
        // SAFETY: the command buffer is recorded, not pending, and kept alive by its owner until the fence signals.
        unsafe { self.raw.queue_submit(*queue, &info, fence) }.map_err(calling("vkQueueSubmit"))
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: all objects of the device held a reference to it and are gone.
        unsafe { self.raw.destroy_device(None) };
        if cfg!(test) && !std::thread::panicking() {
            let messages = self.messages();
            assert!(messages.is_empty(), "the validation layer says: {messages:#?}");
        }
    }
}

/// The device meant by `choice`.
fn choose(devices: Vec<Candidate>, choice: Option<&str>) -> Result<Candidate, Unavailable> {
    let rank = |device: &Candidate| match device.kind {
        DeviceType::Discrete => 0,
        DeviceType::Integrated => 1,
        DeviceType::SoftwareVulkan | DeviceType::Cpu => 2,
    };
    let Some(choice) = choice else {
        return Ok(devices.into_iter().min_by_key(rank).expect("the list is not empty"));
    };
    let wanted = choice.to_lowercase();
    let found = match choice.parse::<usize>() {
        Ok(index) => devices.get(index),
        Err(_) => devices.iter().find(|device| device.name.to_lowercase().contains(&wanted)),
    };
    found.cloned().ok_or_else(|| {
        let names = devices.iter().enumerate().map(|(i, device)| format!("{i} = {}", device.name));
        Unavailable {
            what: format!("there is no Vulkan device `{choice}`"),
            how_to_get_it: format!("choose one of: {}", names.collect::<Vec<_>>().join(", ")),
        }
    })
}

fn limits(vk: &ash::Instance, device: vk::PhysicalDevice) -> vk::PhysicalDeviceLimits {
    // SAFETY: the handle comes from this instance.
    unsafe { vk.get_physical_device_properties(device) }.limits
}

fn traits(vk: &ash::Instance, device: vk::PhysicalDevice, family: &vk::QueueFamilyProperties) -> Traits {
    let mut subgroup = vk::PhysicalDeviceSubgroupProperties::default();
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut subgroup);
    // SAFETY: the handle comes from this instance, and the device speaks 1.1.
    let features = unsafe {
        vk.get_physical_device_properties2(device, &mut all);
        vk.get_physical_device_features(device)
    };
    let limits = all.properties.limits;
    Traits {
        f64: features.shader_float64 == vk::TRUE,
        subgroup: subgroup.subgroup_size,
        subgroup_operations: subgroup.supported_operations,
        range: 0,
        groups: limits.max_compute_work_group_count[0].min(limits.max_compute_work_group_count[1]),
        tick_ns: (family.timestamp_valid_bits > 0).then_some(limits.timestamp_period),
        tick_bits: family.timestamp_valid_bits,
    }
}

fn make(
    vk: &ash::Instance,
    device: vk::PhysicalDevice,
    family: u32,
    f64: bool,
) -> Result<ash::Device, vk::Result> {
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
    let features = vk::PhysicalDeviceFeatures::default().shader_float64(f64);
    let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_features(&features);
    // SAFETY: the handle comes from this instance; everything in `info` is alive.
    unsafe { vk.create_device(device, &info, None) }
}
