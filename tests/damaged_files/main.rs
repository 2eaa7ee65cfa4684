//! Damaged files: each of a corpus has the declared outcome, and no change to any of them makes a reader panic, hang or
//! take more memory than small files deserve.

use std::sync::Once;
use std::sync::atomic::{AtomicUsize, Ordering};

mod corpus;
mod mutations;
mod protocol;
mod readers;

/// The readers together never hold more than this, or the process ends: the largest file here has 20 KB, and no number
/// in it may be believed.
const MEMORY_LIMIT: usize = 64 << 20;

/// Panics so far, those included that a reader caught: their message would still reach the user.
static PANICS: AtomicUsize = AtomicUsize::new(0);

/// Fails if anything has panicked in this process.
fn check_that_nothing_panicked() {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let report = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            PANICS.fetch_add(1, Ordering::Relaxed);
            report(info);
        }));
    });
    assert_eq!(PANICS.load(Ordering::Relaxed), 0, "panics, caught or not");
}

#[global_allocator]
static ALLOCATOR: cap::Cap<std::alloc::System> = cap::Cap::new(std::alloc::System, MEMORY_LIMIT);

#[test]
fn the_limit_is_in_force() {
    assert_eq!(ALLOCATOR.limit(), MEMORY_LIMIT);
    assert!(Vec::<u8>::new().try_reserve_exact(MEMORY_LIMIT).is_err());
}
