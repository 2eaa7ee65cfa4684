//! What a frame does on the device: listed as a [`Plan`], recorded once as a [`Recorded`] command buffer, run in every
//! frame.
use super::buffer::{Buffer, Slot};
use super::device::Device;
use super::error::DeviceError;
use super::kernel::Kernel;
use super::recorded::Recorded;
use std::sync::Arc;

/// A part of a [`Plan`].
pub(super) enum Step {
    Dispatch { kernel: Arc<Kernel>, slots: Vec<Slot>, push: Vec<u32>, groups: u32 },
    Copy { from: Arc<Buffer>, to: Arc<Buffer> },
    Clear(Arc<Buffer>),
    Barrier,
    Mark,
}

/// A list of steps. Steps without a barrier between them may run at the same time.
pub struct Plan {
    device: Arc<Device>,
    steps: Vec<Step>,
    /// Names of the phases so far, where they are timed.
    phases: Option<Vec<String>>,
    /// What the names of phases begin with.
    part: &'static str,
}

impl Plan {
    /// An empty list.
    pub fn new(device: &Arc<Device>) -> Self {
        Self { device: Arc::clone(device), steps: Vec::new(), phases: None, part: "" }
    }

    /// An empty list whose phases are timed one by one ([`Recorded::phases`]). That costs time: not for frames.
    pub fn timed(device: &Arc<Device>) -> Self {
        let mut plan = Self { phases: Some(Vec::new()), ..Self::new(device) };
        plan.mark();
        plan
    }

    /// Names of phases begin with `name` from here on: for plans that do a thing twice.
    pub fn part(&mut self, name: &'static str) {
        self.part = name;
    }

    /// The phase `name` ends here: what follows waits for it anyway. Counts only in a [`timed`](Self::timed) plan.
    pub fn phase(&mut self, name: impl FnOnce() -> String) {
        if let Some(phases) = &mut self.phases {
            phases.push(format!("{}{}", self.part, name()));
            self.mark();
        }
    }

    /// Runs `groups` workgroups of `kernel` on `slots`, one for each of its bindings. More groups than the device takes
    /// along an axis become two-dimensional: kernels count with `group_index()` of `common.glsl` and may be given a few
    /// groups too many.
    ///
    /// # Panics
    /// If slots or push constants are not as many as the kernel has.
    pub fn dispatch(&mut self, kernel: &Arc<Kernel>, slots: &[Slot], push: &[u32], groups: u32) {
        assert_eq!(slots.len(), kernel.bindings(), "slots: one per binding");
        assert_eq!(push.len(), kernel.push_words(), "push: all words of the kernel");
        if groups > 0 {
            let (kernel, slots, push) = (Arc::clone(kernel), slots.to_vec(), push.to_vec());
            self.steps.push(Step::Dispatch { kernel, slots, push, groups });
        }
    }

    /// What came before is seen by what comes after.
    pub fn barrier(&mut self) {
        self.steps.push(Step::Barrier);
    }

    /// Copies a whole buffer to one of the same size.
    pub fn copy(&mut self, from: &Arc<Buffer>, to: &Arc<Buffer>) {
        self.steps.push(Step::Copy { from: Arc::clone(from), to: Arc::clone(to) });
    }

    /// Fills a buffer with zeros.
    pub fn clear(&mut self, buffer: &Arc<Buffer>) {
        self.steps.push(Step::Clear(Arc::clone(buffer)));
    }

    /// Takes the time when all before is done: the intervals are [`Recorded::intervals_ns`].
    pub fn mark(&mut self) {
        self.steps.push(Step::Mark);
    }

    /// Number of dispatches.
    pub fn dispatches(&self) -> usize {
        self.steps.iter().filter(|step| matches!(step, Step::Dispatch { .. })).count()
    }

    /// Records all steps, with a barrier to the host at the end.
    ///
    /// # Errors
    /// Where the driver refuses, or a slot is larger than kernels may see on this device.
    pub fn record(self) -> Result<Recorded, DeviceError> {
        Recorded::new(&self.device, self.steps, self.phases.unwrap_or_default())
    }
}
