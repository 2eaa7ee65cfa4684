//! Failures on demand: software devices never run out of memory and are never lost, so tests ask for it here.
use ash::vk;
use std::sync::atomic::{AtomicI64, Ordering};

/// Which of the coming calls fail: a count of calls that still succeed; negative: all do.
pub struct Faults {
    allocations: AtomicI64,
    submissions: AtomicI64,
    waits: AtomicI64,
}

impl Default for Faults {
    fn default() -> Self {
        let never = || AtomicI64::new(-1);
        Self { allocations: never(), submissions: never(), waits: never() }
    }
}

fn count(counter: &AtomicI64, failure: vk::Result) -> Result<(), vk::Result> {
    if !cfg!(test) {
        return Ok(());
    }
    match counter.load(Ordering::Relaxed) {
        0 => Err(failure),
        left => {
            counter.store((left - 1).max(-1), Ordering::Relaxed);
            Ok(())
        }
    }
}

impl Faults {
    /// Before vkAllocateMemory.
    pub fn allocation(&self) -> Result<(), vk::Result> {
        count(&self.allocations, vk::Result::ERROR_OUT_OF_DEVICE_MEMORY)
    }

    /// Before vkQueueSubmit.
    pub fn submission(&self) -> Result<(), vk::Result> {
        count(&self.submissions, vk::Result::ERROR_DEVICE_LOST)
    }

    /// After vkWaitForFences.
    pub fn wait(&self) -> Result<(), vk::Result> {
        count(&self.waits, vk::Result::TIMEOUT)
    }
}

#[cfg(test)]
impl Faults {
    /// All allocations but the next `n` fail.
    pub fn fail_allocations_after(&self, n: i64) {
        self.allocations.store(n, Ordering::Relaxed);
    }

    /// The device is lost after `n` more submissions.
    pub fn lose_device_after(&self, n: i64) {
        self.submissions.store(n, Ordering::Relaxed);
    }

    /// All waits but the next `n` time out.
    pub fn time_out_after(&self, n: i64) {
        self.waits.store(n, Ordering::Relaxed);
    }
}
