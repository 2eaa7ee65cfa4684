//! Buffers of device memory, and the way of numbers between host and device.
use super::device::Device;
use super::error::{DeviceError, calling};
use super::plan::Plan;
use ash::vk;
use std::marker::PhantomData;
use std::sync::Arc;

/// Where a buffer lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// In the device's own memory; the host sees it only where memory is unified ([`Device::is_unified`]).
    Device,
    /// In host memory that the device copies from.
    Upload,
    /// In host memory that the device copies to.
    Readback,
}

/// A buffer with memory of its own, zero at first where the host sees it.
pub struct Buffer {
    device: Arc<Device>,
    raw: vk::Buffer,
    memory: vk::DeviceMemory,
    bytes: u64,
    charged: u64,
    mapped: Option<*mut u8>,
}

// SAFETY: the mapped pointer is only followed by `host`, whose caller promises exclusive use.
unsafe impl Send for Buffer {}
// SAFETY: as above.
unsafe impl Sync for Buffer {}

/// Numbers without padding, any bits allowed: what host and device exchange.
///
/// # Safety
/// Every bit pattern is a value, there is no padding, and the alignment is at most 64 bytes.
pub unsafe trait Plain: Copy + 'static {}
// SAFETY: a plain number.
unsafe impl Plain for f64 {}
// SAFETY: a plain number.
unsafe impl Plain for f32 {}
// SAFETY: a plain number.
unsafe impl Plain for u32 {}
// SAFETY: an array of plain numbers.
unsafe impl<T: Plain, const N: usize> Plain for [T; N] {}

impl Buffer {
    /// A buffer of `bytes` (a multiple of 16 is made of it, at least 16).
    ///
    /// # Errors
    /// Where memory or the budget do not suffice.
    pub fn new(device: &Arc<Device>, place: Place, bytes: u64) -> Result<Arc<Self>, DeviceError> {
        use vk::{BufferUsageFlags as Usage, MemoryPropertyFlags as Memory};
        let bytes = bytes.max(16).next_multiple_of(16);
        let host = Memory::HOST_VISIBLE | Memory::HOST_COHERENT;
        let copies = Usage::TRANSFER_SRC | Usage::TRANSFER_DST;
        let (usage, required, wished) = match place {
            Place::Device => {
                let usage = copies | Usage::STORAGE_BUFFER | Usage::UNIFORM_TEXEL_BUFFER;
                let host = if device.is_unified() { host } else { Memory::empty() };
                (
                    usage,
                    Memory::DEVICE_LOCAL | host,
                    if device.is_unified() { Memory::HOST_CACHED } else { host },
                )
            }
            Place::Upload => (copies | Usage::STORAGE_BUFFER, host, Memory::empty()),
            Place::Readback => (copies | Usage::STORAGE_BUFFER, host, Memory::HOST_CACHED),
        };
        let info = vk::BufferCreateInfo::default().size(bytes).usage(usage);
        // SAFETY: the device is alive; from here on `drop` releases what was made.
        let raw = unsafe { device.raw().create_buffer(&info, None) }
            .map_err(|_| DeviceError::OutOfMemory { bytes })?;
        let mut buffer = Self {
            device: Arc::clone(device),
            raw,
            memory: vk::DeviceMemory::null(),
            bytes,
            charged: 0,
            mapped: None,
        };
        // SAFETY: the buffer is alive.
        let needs = unsafe { device.raw().get_buffer_memory_requirements(raw) };
        buffer.memory = device.allocate(needs, required, wished)?;
        buffer.charged = needs.size;
        // SAFETY: the memory was made for this buffer.
        unsafe { device.raw().bind_buffer_memory(raw, buffer.memory, 0) }
            .map_err(calling("vkBindBufferMemory"))?;
        if required.contains(host) {
            buffer.map()?;
        }
        Ok(Arc::new(buffer))
    }

    fn map(&mut self) -> Result<(), DeviceError> {
        let flags = vk::MemoryMapFlags::empty();
        // SAFETY: the memory is visible to the host and not mapped yet; it stays mapped until it is freed.
        let pointer = unsafe { self.device.raw().map_memory(self.memory, 0, vk::WHOLE_SIZE, flags) }
            .map_err(calling("vkMapMemory"))?
            .cast::<u8>();
        // SAFETY: the mapping covers the buffer.
        unsafe { pointer.write_bytes(0, self.bytes as usize) };
        self.mapped = Some(pointer);
        Ok(())
    }

    /// Vulkan's handle.
    pub fn raw(&self) -> vk::Buffer {
        self.raw
    }

    /// Size in bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The whole buffer, for a kernel.
    pub fn all(self: &Arc<Self>) -> Slot {
        Slot { buffer: Arc::clone(self), from: 0, bytes: self.bytes }
    }

    /// `bytes` from byte `from` on (a multiple of [`super::device::ALIGNMENT`]), for a kernel.
    pub fn part(self: &Arc<Self>, from: u64, bytes: u64) -> Slot {
        Slot { buffer: Arc::clone(self), from, bytes }
    }

    /// The content as the host sees it; `None` where it does not.
    ///
    /// # Safety
    /// No submitted work touches the buffer, and no other slice of it is alive.
    #[allow(clippy::mut_from_ref)] // the memory is not part of the struct; see Safety
    pub unsafe fn host<T: Plain>(&self) -> Option<&mut [T]> {
        let pointer = self.mapped?.cast::<T>();
        // SAFETY: mapped for as long as self lives, zeroed when mapped, aligned to at least 64 bytes as Vulkan guarantees
        // (minMemoryMapAlignment), any bits are a T, and the caller promises exclusive use.
        Some(unsafe { std::slice::from_raw_parts_mut(pointer, self.bytes as usize / size_of::<T>()) })
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        // SAFETY: recordings that use the buffer hold a reference to it; freeing memory unmaps it.
        unsafe {
            self.device.raw().destroy_buffer(self.raw, None);
            self.device.raw().free_memory(self.memory, None);
        }
        self.device.release(self.charged);
    }
}

/// What a kernel sees of a buffer.
#[derive(Clone)]
pub struct Slot {
    /// The buffer.
    pub buffer: Arc<Buffer>,
    /// First byte.
    pub from: u64,
    /// Number of bytes.
    pub bytes: u64,
}

/// Numbers that go to the device in every frame: write [`host`](Self::host), record [`upload`](Self::upload).
pub struct Input<T> {
    buffer: Arc<Buffer>,
    staging: Option<Arc<Buffer>>,
    number: PhantomData<T>,
}

/// Numbers that come back in every frame: record [`download`](Self::download), read [`host`](Self::host).
pub struct Output<T> {
    buffer: Arc<Buffer>,
    staging: Option<Arc<Buffer>>,
    number: PhantomData<T>,
}

fn staged(
    device: &Arc<Device>,
    place: Place,
    bytes: u64,
) -> Result<(Arc<Buffer>, Option<Arc<Buffer>>), DeviceError> {
    let buffer = Buffer::new(device, Place::Device, bytes)?;
    let staging = if device.is_unified() { None } else { Some(Buffer::new(device, place, bytes)?) };
    Ok((buffer, staging))
}

impl<T: Plain> Input<T> {
    /// Room for `len` numbers.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn new(device: &Arc<Device>, len: usize) -> Result<Self, DeviceError> {
        let (buffer, staging) = staged(device, Place::Upload, (len * size_of::<T>()) as u64)?;
        Ok(Self { buffer, staging, number: PhantomData })
    }

    /// What kernels read.
    pub fn buffer(&self) -> &Arc<Buffer> {
        &self.buffer
    }

    /// What the host writes before a frame is run: at least as long as asked for.
    pub fn host(&mut self) -> &mut [T] {
        let seen = self.staging.as_ref().unwrap_or(&self.buffer);
        // SAFETY: `&mut self` makes the slice the only one; frames are waited for before they return.
        unsafe { seen.host() }.expect("staging buffers are mapped, and unified memory is")
    }

    /// Records the way to the device, where there is one; a barrier must follow.
    pub fn upload(&self, plan: &mut Plan) {
        if let Some(staging) = &self.staging {
            plan.copy(staging, &self.buffer);
        }
    }
}

impl<T: Plain> Output<T> {
    /// Room for `len` numbers.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn new(device: &Arc<Device>, len: usize) -> Result<Self, DeviceError> {
        let (buffer, staging) = staged(device, Place::Readback, (len * size_of::<T>()) as u64)?;
        Ok(Self { buffer, staging, number: PhantomData })
    }

    /// What kernels write.
    pub fn buffer(&self) -> &Arc<Buffer> {
        &self.buffer
    }

    /// What the host reads after a frame was run.
    pub fn host(&mut self) -> &mut [T] {
        let seen = self.staging.as_ref().unwrap_or(&self.buffer);
        // SAFETY: `&mut self` makes the slice the only one; frames are waited for before they return.
        unsafe { seen.host() }.expect("staging buffers are mapped, and unified memory is")
    }

    /// Records the way from the device, where there is one; a barrier must stand before it.
    pub fn download(&self, plan: &mut Plan) {
        if let Some(staging) = &self.staging {
            plan.copy(&self.buffer, staging);
        }
    }
}

/// A way to fill a buffer on the device once: write [`host`](Self::host), then [`finish`](Self::finish). Where memory is not
/// shared it goes through a staging buffer that lives as long as this.
pub struct Upload<T> {
    device: Arc<Device>,
    buffer: Arc<Buffer>,
    staging: Option<Arc<Buffer>>,
    number: PhantomData<T>,
}

impl<T: Plain> Upload<T> {
    /// To fill `buffer`.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    ///
    /// # Safety
    /// Until this is dropped no submitted work uses the buffer, and nothing else writes to it from the host.
    pub unsafe fn new(device: &Arc<Device>, buffer: &Arc<Buffer>) -> Result<Self, DeviceError> {
        let staging = if device.is_unified() {
            None
        } else {
            Some(Buffer::new(device, Place::Upload, buffer.bytes())?)
        };
        Ok(Self { device: Arc::clone(device), buffer: Arc::clone(buffer), staging, number: PhantomData })
    }

    /// The new content.
    pub fn host(&mut self) -> &mut [T] {
        let seen = self.staging.as_ref().unwrap_or(&self.buffer);
        // SAFETY: promised by the caller of `new`.
        unsafe { seen.host() }.expect("staging buffers are mapped, and unified memory is")
    }

    /// Copies to the device.
    ///
    /// # Errors
    /// Where the driver fails.
    pub fn finish(self) -> Result<(), DeviceError> {
        let Some(staging) = &self.staging else { return Ok(()) };
        let mut plan = Plan::new(&self.device);
        plan.copy(staging, &self.buffer);
        plan.record()?.run()
    }
}

/// A buffer on the device with this content.
///
/// # Errors
/// As [`Buffer::new`], or where the copy fails.
pub fn constant<T: Plain>(device: &Arc<Device>, content: &[T]) -> Result<Arc<Buffer>, DeviceError> {
    let buffer = Buffer::new(device, Place::Device, size_of_val(content) as u64)?;
    // SAFETY: nobody else knows the buffer yet.
    let mut upload = unsafe { Upload::new(device, &buffer) }?;
    upload.host()[..content.len()].copy_from_slice(content);
    upload.finish()?;
    Ok(buffer)
}

/// The first `len` numbers of a buffer on the device. Not for frames: it allocates.
///
/// # Errors
/// As [`Buffer::new`], or where the copy fails.
pub fn read<T: Plain>(device: &Arc<Device>, buffer: &Arc<Buffer>, len: usize) -> Result<Vec<T>, DeviceError> {
    let staging = if device.is_unified() {
        Arc::clone(buffer)
    } else {
        let staging = Buffer::new(device, Place::Readback, buffer.bytes())?;
        let mut plan = Plan::new(device);
        plan.copy(buffer, &staging);
        plan.record()?.run()?;
        staging
    };
    // SAFETY: frames are waited for, and the slice is gone when this returns.
    let host = unsafe { staging.host::<T>() }.expect("readback buffers are mapped, and unified memory is");
    Ok(host[..len].to_vec())
}
