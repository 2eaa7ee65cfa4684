//! Counts allocations, and the bytes they hold, over all threads of the process.
//!
//! A counter per thread would miss the worker threads that libraries start; this one is process-wide. It is the reason
//! why `allocations_per_frame` of a cell can be believed.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

/// Bytes asked for and not yet given back.
static HELD: AtomicI64 = AtomicI64::new(0);

/// The system's allocator, counting every request for memory (allocate, reallocate), whichever thread makes it.
///
/// A program that wants `allocations_per_frame` in its results declares it:
/// ```
/// #[global_allocator]
/// static ALLOCATOR: lapbench::engine::allocation::CountingAllocator = lapbench::engine::allocation::CountingAllocator;
/// assert!(lapbench::engine::allocation::is_counting());
/// ```
pub struct CountingAllocator;

// SAFETY: every call is handed on unchanged to the system's allocator, which keeps the contract of `GlobalAlloc`;
// counting touches atomic integers and neither allocates nor unwinds.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        hold(layout.size(), 0);
        // SAFETY: the caller's promises about `layout` are the ones `System` asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        hold(layout.size(), 0);
        // SAFETY: as for `alloc`.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        hold(size, layout.size());
        // SAFETY: `block` came from `System` with this `layout`, as all blocks of this allocator do.
        unsafe { System.realloc(block, layout, size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        hold(0, layout.size());
        // SAFETY: as for `realloc`.
        unsafe { System.dealloc(block, layout) }
    }
}

/// Allocations of the process so far, over all threads; stays 0 unless [`CountingAllocator`] is the global allocator.
pub fn count() -> u64 {
    ALLOCATIONS.load(Ordering::Relaxed)
}

/// `more` bytes are asked for and `less` given back; no block is larger than an i64 holds.
fn hold(more: usize, less: usize) {
    HELD.fetch_add(more as i64 - less as i64, Ordering::Relaxed);
}

/// Bytes that the process has asked for and not given back, over all threads; stays 0 like [`count`].
pub fn held() -> i64 {
    HELD.load(Ordering::Relaxed)
}

/// Whether this process counts: false in a program that did not declare [`CountingAllocator`].
pub fn is_counting() -> bool {
    let before = count();
    drop(std::hint::black_box(Box::new(0u8)));
    count() > before
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_without_the_allocator_says_so() {
        assert!(!is_counting());
    }
}
