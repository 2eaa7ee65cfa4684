//! Buffers for numbers that are read in every frame: on cache lines, and on huge pages where the system has them.
use std::ops::{Deref, DerefMut};

/// Bytes of a cache line and of the widest vector register.
const LINE: usize = 64;

/// Numbers whose first one lies on a cache line, so that rows of 16, 32 or 64 bytes never straddle two lines.
pub struct Aligned<T> {
    data: Vec<T>,
    start: usize,
    len: usize,
}

impl<T: Copy + Default> Aligned<T> {
    /// `len` zeros.
    pub fn new(len: usize) -> Self {
        let data: Vec<T> = zeros(len + LINE / size_of::<T>());
        let start = data.as_ptr().align_offset(LINE).min(LINE / size_of::<T>());
        Self { data, start, len }
    }
}

impl<T> Deref for Aligned<T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        &self.data[self.start..self.start + self.len]
    }
}

impl<T> DerefMut for Aligned<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.data[self.start..self.start + self.len]
    }
}

/// `len` zeros, backed by huge pages where the system offers them.
///
/// A sweep streams tens of megabytes and jumps between the rows of a slab of some more: with pages of 4 KiB it waits for
/// the page tables, and a hardware prefetcher stops at every page's end. The first write of a page also is a fault each.
pub fn zeros<T: Copy + Default>(len: usize) -> Vec<T> {
    let data = vec![T::default(); len]; // large ones come from the system as untouched pages
    advise_huge_pages(&data);
    data
}

/// Asks for huge pages behind `data`, best before its pages are touched. A wish: where it is not granted, nothing changes.
#[cfg(all(target_os = "linux", not(miri)))]
pub fn advise_huge_pages<T>(data: &[T]) {
    /// Bytes of a huge page on x86-64 and aarch64; less than that cannot hold one.
    const HUGE: usize = 2 << 20;
    /// madvise takes whole pages; this is a multiple of every page size in use.
    const PAGE: usize = 1 << 16;
    let (start, len) = (data.as_ptr() as usize, size_of_val(data));
    let (first, end) = (start.next_multiple_of(PAGE), (start + len) / PAGE * PAGE);
    if len >= HUGE && first < end {
        let pages = data.as_ptr().cast::<u8>().wrapping_add(first - start).cast_mut().cast();
        // SAFETY: the range lies inside `data`; the advice changes how it is backed, never its content.
        let _ = unsafe { rustix::mm::madvise(pages, end - first, rustix::mm::Advice::LinuxHugepage) };
    }
}

/// Nothing, on this system.
#[cfg(not(all(target_os = "linux", not(miri))))]
pub fn advise_huge_pages<T>(_: &[T]) {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffers_of_every_size_are_zero_and_aligned() {
        for len in [0, 1, 7, 1000, 300_000, 1_000_003] {
            assert!(zeros::<f64>(len).iter().all(|&v| v == 0.0) && zeros::<f32>(len).len() == len);
            let mut aligned = Aligned::<f32>::new(len);
            assert_eq!((aligned.len(), aligned.as_ptr() as usize % LINE), (len, 0));
            aligned.fill(1.0);
        }
    }
}
