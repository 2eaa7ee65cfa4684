//! A [`super::Plan`] as a command buffer: made once, run in every frame.
use super::buffer::Slot;
use super::device::Device;
use super::error::{DeviceError, calling};
use super::kernel::Kernel;
use super::plan::Step;
use ash::vk;
use std::sync::Arc;

/// Longest wait for a frame: far beyond any of them; a device that needs longer hangs.
const PATIENCE_NS: u64 = 30_000_000_000;

/// A recorded command buffer with everything it uses.
pub struct Recorded {
    device: Arc<Device>,
    steps: Vec<Step>, // keeps buffers and kernels alive
    commands: vk::CommandPool,
    buffer: vk::CommandBuffer,
    descriptors: vk::DescriptorPool,
    views: Vec<vk::BufferView>,
    fence: vk::Fence,
    queries: vk::QueryPool,
    /// Ticks at the marks of the last run.
    ticks: Vec<u64>,
    intervals: Vec<u64>,
    /// Names of the intervals of a timed plan.
    phases: Vec<String>,
    /// Work was handed over and not seen to end.
    pending: bool,
    /// An earlier run failed: nothing more is handed over.
    failed: Option<DeviceError>,
}

impl Recorded {
    /// Records `steps`; `phases` are the names of the intervals between their marks, where those are told apart.
    pub(super) fn new(
        device: &Arc<Device>,
        steps: Vec<Step>,
        phases: Vec<String>,
    ) -> Result<Self, DeviceError> {
        let mut recorded = Self::empty(device);
        recorded.make(&steps)?;
        recorded.record(&steps)?;
        (recorded.steps, recorded.phases) = (steps, phases);
        Ok(recorded)
    }

    fn empty(device: &Arc<Device>) -> Self {
        Self {
            device: Arc::clone(device),
            steps: Vec::new(),
            commands: vk::CommandPool::null(),
            buffer: vk::CommandBuffer::null(),
            descriptors: vk::DescriptorPool::null(),
            views: Vec::new(),
            fence: vk::Fence::null(),
            queries: vk::QueryPool::null(),
            ticks: Vec::new(),
            intervals: Vec::new(),
            phases: Vec::new(),
            pending: false,
            failed: None,
        }
    }

    /// Pools for all steps.
    fn make(&mut self, steps: &[Step]) -> Result<(), DeviceError> {
        let raw = self.device.raw();
        let info = vk::CommandPoolCreateInfo::default().queue_family_index(self.device.family());
        // SAFETY: here and below, the device is alive; `drop` releases what was made.
        let pool = unsafe { raw.create_command_pool(&info, None) };
        self.commands = pool.map_err(calling("vkCreateCommandPool"))?;
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(self.commands)
            .level(vk::CommandBufferLevel::PRIMARY)
            .command_buffer_count(1);
        // SAFETY: the pool was just made.
        self.buffer =
            unsafe { raw.allocate_command_buffers(&info) }.map_err(calling("vkAllocateCommandBuffers"))?[0];
        let info = vk::FenceCreateInfo::default();
        // SAFETY: as above.
        self.fence = unsafe { raw.create_fence(&info, None) }.map_err(calling("vkCreateFence"))?;
        let marks = steps.iter().filter(|step| matches!(step, Step::Mark)).count();
        if marks > 1 && self.device.traits().tick_ns.is_some() {
            let info = vk::QueryPoolCreateInfo::default()
                .query_type(vk::QueryType::TIMESTAMP)
                .query_count(marks as u32);
            // SAFETY: as above.
            self.queries =
                unsafe { raw.create_query_pool(&info, None) }.map_err(calling("vkCreateQueryPool"))?;
            self.ticks = vec![0; marks];
            self.intervals = vec![0; marks - 1];
        }
        self.make_descriptors(steps)
    }

    fn make_descriptors(&mut self, steps: &[Step]) -> Result<(), DeviceError> {
        let (mut sets, mut texel, mut storage) = (0, 0, 0);
        for step in steps {
            let Step::Dispatch { kernel, .. } = step else { continue };
            sets += 1;
            for at in 0..kernel.bindings() {
                match kernel.descriptor_type(at) {
                    vk::DescriptorType::UNIFORM_TEXEL_BUFFER => texel += 1,
                    _ => storage += 1,
                }
            }
        }
        if sets == 0 {
            return Ok(());
        }
        let size = |ty, count| vk::DescriptorPoolSize { ty, descriptor_count: count };
        let sizes = [
            size(vk::DescriptorType::UNIFORM_TEXEL_BUFFER, texel),
            size(vk::DescriptorType::STORAGE_BUFFER, storage),
        ];
        let sizes: Vec<_> = sizes.into_iter().filter(|size| size.descriptor_count > 0).collect();
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(sets).pool_sizes(&sizes);
        // SAFETY: the device is alive; `drop` releases the pool.
        self.descriptors = unsafe { self.device.raw().create_descriptor_pool(&info, None) }
            .map_err(calling("vkCreateDescriptorPool"))?;
        Ok(())
    }

    fn record(&mut self, steps: &[Step]) -> Result<(), DeviceError> {
        let device = Arc::clone(&self.device);
        let raw = device.raw();
        let info = vk::CommandBufferBeginInfo::default();
        // SAFETY: the command buffer was just made; what it will use lives in `steps`, kept by self.
        unsafe {
            raw.begin_command_buffer(self.buffer, &info).map_err(calling("vkBeginCommandBuffer"))?;
            if self.queries != vk::QueryPool::null() {
                raw.cmd_reset_query_pool(self.buffer, self.queries, 0, self.ticks.len() as u32);
            }
        }
        let mut marks = 0;
        for step in steps {
            match step {
                Step::Dispatch { kernel, slots, push, groups } => {
                    let set = self.describe(kernel, slots)?;
                    self.record_dispatch(kernel, set, push, *groups);
                }
                Step::Copy { from, to } => {
                    let regions = [vk::BufferCopy::default().size(from.bytes().min(to.bytes()))];
                    // SAFETY: both buffers allow copies and are alive.
                    unsafe { raw.cmd_copy_buffer(self.buffer, from.raw(), to.raw(), &regions) };
                }
                // SAFETY: the buffer allows transfers.
                Step::Clear(buffer) => unsafe {
                    raw.cmd_fill_buffer(self.buffer, buffer.raw(), 0, vk::WHOLE_SIZE, 0);
                },
                Step::Barrier => self.record_barrier(false),
                Step::Mark if self.queries != vk::QueryPool::null() => {
                    let stage = vk::PipelineStageFlags::BOTTOM_OF_PIPE;
                    // SAFETY: the pool has a query for every mark.
                    unsafe { raw.cmd_write_timestamp(self.buffer, stage, self.queries, marks) };
                    marks += 1;
                }
                Step::Mark => {}
            }
        }
        self.record_barrier(true);
        // SAFETY: recording was begun above.
        unsafe { raw.end_command_buffer(self.buffer) }.map_err(calling("vkEndCommandBuffer"))
    }

    fn record_dispatch(&self, kernel: &Kernel, set: vk::DescriptorSet, push: &[u32], groups: u32) {
        let raw = self.device.raw();
        let (_, layout, pipeline) = kernel.raw();
        let words: Vec<u8> = push.iter().flat_map(|word| word.to_ne_bytes()).collect();
        let x = groups.min(self.device.traits().groups);
        // SAFETY: kernel and set live as long as self; counts were checked by `Plan::dispatch`.
        unsafe {
            let point = vk::PipelineBindPoint::COMPUTE;
            raw.cmd_bind_pipeline(self.buffer, point, pipeline);
            raw.cmd_bind_descriptor_sets(self.buffer, point, layout, 0, &[set], &[]);
            if !words.is_empty() {
                raw.cmd_push_constants(self.buffer, layout, vk::ShaderStageFlags::COMPUTE, 0, &words);
            }
            raw.cmd_dispatch(self.buffer, x, groups.div_ceil(x), 1);
        }
    }

    fn record_barrier(&self, to_host: bool) {
        use vk::{AccessFlags as A, PipelineStageFlags as S};
        let work = S::COMPUTE_SHADER | S::TRANSFER;
        let (stages, reads) = if to_host {
            (S::HOST, A::HOST_READ)
        } else {
            (work, A::SHADER_READ | A::SHADER_WRITE | A::TRANSFER_READ | A::TRANSFER_WRITE)
        };
        let barrier = [vk::MemoryBarrier::default()
            .src_access_mask(A::SHADER_WRITE | A::TRANSFER_WRITE)
            .dst_access_mask(reads)];
        let flags = vk::DependencyFlags::empty();
        // SAFETY: the command buffer is being recorded.
        unsafe {
            self.device.raw().cmd_pipeline_barrier(self.buffer, work, stages, flags, &barrier, &[], &[]);
        }
    }

    /// A descriptor set for these slots.
    fn describe(&mut self, kernel: &Kernel, slots: &[Slot]) -> Result<vk::DescriptorSet, DeviceError> {
        let layouts = [kernel.raw().0];
        let info =
            vk::DescriptorSetAllocateInfo::default().descriptor_pool(self.descriptors).set_layouts(&layouts);
        // SAFETY: the pool has room for all sets of the plan.
        let set = unsafe { self.device.raw().allocate_descriptor_sets(&info) }
            .map_err(calling("vkAllocateDescriptorSets"))?[0];
        for (at, slot) in slots.iter().enumerate() {
            let limit = self.device.traits().range;
            if slot.bytes > limit {
                let what = format!("a buffer of {} bytes: this device's kernels see {limit}", slot.bytes);
                return Err(DeviceError::Unsupported(what));
            }
            self.write_descriptor(kernel, set, at, slot)?;
        }
        Ok(set)
    }

    fn write_descriptor(
        &mut self,
        kernel: &Kernel,
        set: vk::DescriptorSet,
        at: usize,
        slot: &Slot,
    ) -> Result<(), DeviceError> {
        let (ty, raw) = (kernel.descriptor_type(at), self.device.raw());
        let write = vk::WriteDescriptorSet::default()
            .dst_set(set)
            .dst_binding(at as u32)
            .descriptor_type(ty)
            .descriptor_count(1);
        if ty == vk::DescriptorType::UNIFORM_TEXEL_BUFFER {
            let info = vk::BufferViewCreateInfo::default()
                .buffer(slot.buffer.raw())
                .format(kernel.texel_format(at))
                .offset(slot.from)
                .range(slot.bytes);
            // SAFETY: the buffer allows texel views; `drop` destroys them.
            let view =
                unsafe { raw.create_buffer_view(&info, None) }.map_err(calling("vkCreateBufferView"))?;
            self.views.push(view);
            let views = [view];
            // SAFETY: set and view are alive, and the set is not in use.
            unsafe { raw.update_descriptor_sets(&[write.texel_buffer_view(&views)], &[]) };
        } else {
            let info = [vk::DescriptorBufferInfo {
                buffer: slot.buffer.raw(),
                offset: slot.from,
                range: slot.bytes,
            }];
            // SAFETY: set and buffer are alive, and the set is not in use.
            unsafe { raw.update_descriptor_sets(&[write.buffer_info(&info)], &[]) };
        }
        Ok(())
    }

    /// Submits and waits. No allocation. After an error every later run returns the same error.
    ///
    /// # Errors
    /// Where the device is lost or does not answer.
    pub fn run(&mut self) -> Result<(), DeviceError> {
        if let Some(error) = &self.failed {
            return Err(error.clone());
        }
        let outcome = self.submit_and_wait();
        self.failed = outcome.clone().err();
        outcome
    }

    fn submit_and_wait(&mut self) -> Result<(), DeviceError> {
        self.device.submit(self.buffer, self.fence)?;
        self.pending = true;
        let (raw, fences) = (self.device.raw(), [self.fence]);
        // SAFETY: the fence is ours.
        unsafe { raw.wait_for_fences(&fences, true, PATIENCE_NS) }
            .and_then(|()| self.device.faults.wait())
            .map_err(calling("vkWaitForFences"))?;
        self.pending = false;
        // SAFETY: the fence has signalled, nothing waits for it.
        unsafe { raw.reset_fences(&fences) }.map_err(calling("vkResetFences"))?;
        if self.queries != vk::QueryPool::null() {
            self.read_marks()?;
        }
        Ok(())
    }

    fn read_marks(&mut self) -> Result<(), DeviceError> {
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
        let (raw, traits) = (self.device.raw(), self.device.traits());
        // SAFETY: the pool has as many queries as `ticks`, all written by the run that just ended.
        unsafe { raw.get_query_pool_results(self.queries, 0, &mut self.ticks, flags) }
            .map_err(calling("vkGetQueryPoolResults"))?;
        let mask = u64::MAX >> (64 - traits.tick_bits.clamp(1, 64));
        let tick = f64::from(traits.tick_ns.unwrap_or(0.0));
        for (interval, ticks) in self.intervals.iter_mut().zip(self.ticks.windows(2)) {
            *interval = ((ticks[1].wrapping_sub(ticks[0]) & mask) as f64 * tick) as u64;
        }
        Ok(())
    }

    /// Nanoseconds on the device between the marks of the last run; empty without timestamps.
    pub fn intervals_ns(&self) -> &[u64] {
        &self.intervals
    }

    /// Names and nanoseconds of the phases of a timed plan in the last run; empty without timestamps.
    pub fn phases(&self) -> Vec<(String, u64)> {
        self.phases.iter().cloned().zip(self.intervals.iter().copied()).collect()
    }

    /// Nanoseconds on the device from the first to the last mark of the last run.
    pub fn device_ns(&self) -> Option<u64> {
        (!self.intervals.is_empty()).then(|| self.intervals.iter().sum())
    }
}

impl Drop for Recorded {
    fn drop(&mut self) {
        let raw = self.device.raw();
        // SAFETY: nothing is in use once the device is idle (or lost); null handles are ignored.
        unsafe {
            if self.pending {
                let _ = raw.device_wait_idle(); // lost or idle: both mean that nothing runs
            }
            raw.destroy_command_pool(self.commands, None);
            raw.destroy_descriptor_pool(self.descriptors, None);
            self.views.iter().for_each(|&view| raw.destroy_buffer_view(view, None));
            raw.destroy_fence(self.fence, None);
            raw.destroy_query_pool(self.queries, None);
        }
    }
}
