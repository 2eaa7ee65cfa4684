//! A team of threads that is made once and then works frame after frame.
//!
//! Starting a thread costs tens of microseconds, as much as a small solve. A [`Team`] keeps its threads: after a job they
//! spin briefly, so that the next step of the same frame finds them running, and then park until the next frame. A job
//! takes no lock and allocates nothing. Teams know nothing of each other; each belongs to one handle, `&mut` is its lock.
use std::cell::UnsafeCell;
use std::hint::spin_loop;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicUsize, Ordering};
use std::thread::{self, JoinHandle};

/// How often a waiting thread looks before it parks or yields: some 50 microseconds, the longest serial step of a frame
/// that others wait for, and about what waking a parked thread costs.
const SPINS: u32 = if cfg!(miri) { 1 } else { 4_000 };

/// Threads that run the same job on different items, together with the calling thread.
pub struct Team {
    shared: Arc<Shared>,
    workers: Vec<JoinHandle<()>>,
}

/// What caller and workers see.
struct Shared {
    /// Counts jobs; a change tells the workers that `job` is new.
    generation: AtomicU32,
    /// Workers that have not finished the current job.
    running: AtomicUsize,
    /// A worker's job panicked.
    panicked: AtomicBool,
    /// Workers shall end.
    stop: AtomicBool,
    /// The current job; written by the caller while no worker runs.
    job: UnsafeCell<Job>,
    /// Per worker, whether it is parked or about to be.
    asleep: Vec<AtomicBool>,
}

/// A borrowed closure without its lifetime: called with the number of the thread.
#[derive(Clone, Copy)]
struct Job(*const (dyn Fn(usize) + Sync));

// SAFETY: `job` is written only in `Team::run`, between the end of one job (`running` is 0, acquired) and the release of
// the next `generation`; workers read it after acquiring that generation. The closure behind it is `Sync`.
unsafe impl Sync for Shared {}
// SAFETY: as above; the pointer is followed only while `Team::run` keeps the closure alive.
unsafe impl Send for Shared {}

impl Team {
    /// A team of `threads` (>= 1): the caller and `threads - 1` new threads, which run and wait when this returns.
    ///
    /// # Errors
    /// Where the system refuses a thread.
    pub fn new(threads: usize) -> std::io::Result<Self> {
        assert!(threads > 0, "threads: at least 1");
        let shared = Arc::new(Shared {
            generation: AtomicU32::new(0),
            running: AtomicUsize::new(0),
            panicked: AtomicBool::new(false),
            stop: AtomicBool::new(false),
            job: UnsafeCell::new(Job(&|_| {})),
            asleep: (1..threads).map(|_| AtomicBool::new(false)).collect(),
        });
        let mut team = Self { shared, workers: Vec::new() };
        for number in 1..threads {
            let shared = Arc::clone(&team.shared);
            let name = format!("lapsolve-{number}");
            team.workers.push(thread::Builder::new().name(name).spawn(move || shared.work(number))?);
        }
        // A thread allocates when it begins to run, which on a busy machine may be long after it was made: not in a frame.
        team.run(&|_| {});
        Ok(team)
    }

    /// Number of threads, the caller included.
    pub fn threads(&self) -> usize {
        self.workers.len() + 1
    }

    /// Runs `job(t)` on every thread t of the team and returns when all are done. No allocation, no lock.
    ///
    /// # Panics
    /// If a job panics; the others still run to their end.
    pub fn run(&mut self, job: &(dyn Fn(usize) + Sync)) {
        if self.workers.is_empty() {
            return job(0);
        }
        let pointer: *const (dyn Fn(usize) + Sync + '_) = job;
        // SAFETY: only the lifetime changes; the pointer is not followed after this call has returned, because it
        // returns only when `running` is 0.
        let pointer: *const (dyn Fn(usize) + Sync + 'static) = unsafe { std::mem::transmute(pointer) };
        // SAFETY: no worker runs now (`running` is 0) and none will read before the new generation.
        unsafe { *self.shared.job.get() = Job(pointer) };
        self.shared.running.store(self.workers.len(), Ordering::Relaxed);
        self.shared.generation.fetch_add(1, Ordering::SeqCst);
        self.wake();
        let own = catch_unwind(AssertUnwindSafe(|| job(0)));
        wait_until(|| self.shared.running.load(Ordering::Acquire) == 0);
        if let Err(panic) = own {
            std::panic::resume_unwind(panic);
        }
        assert!(!self.shared.panicked.swap(false, Ordering::Relaxed), "a thread of the team panicked");
    }

    /// Runs `job(i, &mut items[i])` for every item, item i on thread i modulo the number of threads.
    ///
    /// # Panics
    /// As [`run`](Self::run).
    pub fn for_each<T: Send>(&mut self, items: &mut [T], job: impl Fn(usize, &mut T) + Sync) {
        let (count, threads) = (items.len(), self.threads());
        let items = Items(items.as_mut_ptr());
        self.run(&|t| {
            for i in (t..count).step_by(threads) {
                // SAFETY: i is below the length, every i belongs to one thread only, and `items` is borrowed
                // mutably until `run` has returned.
                job(i, unsafe { &mut *items.at(i) });
            }
        });
    }

    /// Cuts `data` into one run of whole groups of `group` items per thread and calls `job(groups, run)` on each thread: the
    /// numbers of its groups, and its run. No allocation.
    ///
    /// # Panics
    /// As [`run`](Self::run), and if `data` is no multiple of `group`.
    pub fn for_each_run<T: Send>(
        &mut self,
        data: &mut [T],
        group: usize,
        job: impl Fn(Range<usize>, &mut [T]) + Sync,
    ) {
        assert!(data.len().is_multiple_of(group), "data: whole groups");
        let (groups, threads) = (data.len() / group, self.threads());
        let items = Items(data.as_mut_ptr());
        self.run(&|t| {
            let own = groups * t / threads..groups * (t + 1) / threads;
            // SAFETY: the runs of the threads do not overlap and lie in `data`, which is borrowed mutably until `run` has
            // returned.
            let run = unsafe {
                std::slice::from_raw_parts_mut(items.at(own.start * group), (own.end - own.start) * group)
            };
            job(own, run);
        });
    }

    fn wake(&self) {
        for (asleep, worker) in self.shared.asleep.iter().zip(&self.workers) {
            if asleep.load(Ordering::SeqCst) {
                worker.thread().unpark();
            }
        }
    }
}

impl Drop for Team {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::SeqCst);
        self.shared.generation.fetch_add(1, Ordering::SeqCst);
        self.wake();
        for worker in self.workers.drain(..) {
            // A worker catches the panics of its jobs, so it can only end well.
            let _ = worker.join();
        }
    }
}

impl Shared {
    /// The life of worker `number`.
    fn work(&self, number: usize) {
        let mut seen = 0;
        loop {
            self.await_change(number, seen);
            seen = seen.wrapping_add(1);
            if self.stop.load(Ordering::SeqCst) {
                return;
            }
            // SAFETY: a new generation was acquired, so `job` holds a closure that lives until `running` is 0.
            let job = unsafe { &*(*self.job.get()).0 };
            if catch_unwind(AssertUnwindSafe(|| job(number))).is_err() {
                self.panicked.store(true, Ordering::Relaxed);
            }
            self.running.fetch_sub(1, Ordering::Release);
        }
    }

    /// Waits until the generation is no longer `seen`: spinning first, then parked.
    fn await_change(&self, number: usize, seen: u32) {
        let changed = || self.generation.load(Ordering::SeqCst) != seen;
        for _ in 0..SPINS {
            if changed() {
                return;
            }
            spin_loop();
        }
        // Either the caller sees `asleep` after it has changed the generation, or this thread sees the change.
        let asleep = &self.asleep[number - 1];
        asleep.store(true, Ordering::SeqCst);
        while !changed() {
            thread::park();
        }
        asleep.store(false, Ordering::SeqCst);
    }
}

/// Spins, then gives the core away between looks: the awaited thread may need it.
fn wait_until(done: impl Fn() -> bool) {
    let mut spins = 0;
    while !done() {
        if spins < SPINS {
            spins += 1;
            spin_loop();
        } else {
            thread::yield_now();
        }
    }
}

/// The start of a slice whose items are handed to different threads.
struct Items<T>(*mut T);

impl<T> Items<T> {
    fn at(&self, i: usize) -> *mut T {
        self.0.wrapping_add(i)
    }
}

// SAFETY: the items are `Send`, and `for_each` hands each one to a single thread.
unsafe impl<T: Send> Sync for Items<T> {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_item_is_visited_once_per_job() {
        for threads in [1, 2, 3] {
            let mut team = Team::new(threads).expect("threads");
            for count in [0, 1, 2, 7] {
                let mut items = vec![0_usize; count];
                for round in 1..20 {
                    team.for_each(&mut items, |i, item| *item += i + 1);
                    assert!(
                        items.iter().enumerate().all(|(i, &v)| v == round * (i + 1)),
                        "{threads} {count}"
                    );
                }
            }
        }
    }

    #[test]
    fn runs_of_groups_cover_everything_once() {
        for threads in [1, 2, 3] {
            let mut team = Team::new(threads).expect("threads");
            for count in [0, 1, 2, 7] {
                let mut items = vec![0_usize; 3 * count];
                team.for_each_run(&mut items, 3, |groups, run| {
                    assert_eq!(run.len(), 3 * groups.len());
                    run.chunks_exact_mut(3).zip(groups).for_each(|(group, g)| group.fill(g + 1));
                });
                assert!(items.iter().enumerate().all(|(i, &v)| v == i / 3 + 1), "{threads} {items:?}");
            }
        }
    }

    #[test]
    fn parked_threads_wake_up_again() {
        let mut team = Team::new(2).expect("threads");
        let mut items = [0; 2];
        for _ in 0..3 {
            while !team.shared.asleep[0].load(Ordering::SeqCst) {
                thread::yield_now();
            }
            team.for_each(&mut items, |_, item| *item += 1);
        }
        assert_eq!(items, [3, 3]);
    }

    #[test]
    fn a_panic_reaches_the_caller_and_the_team_lives_on() {
        let mut team = Team::new(2).expect("threads");
        for bad in 0..2 {
            let mut items = [0; 2];
            let result = catch_unwind(AssertUnwindSafe(|| {
                team.for_each(&mut items, |i, item| {
                    assert!(i != bad, "on purpose");
                    *item = 1;
                });
            }));
            assert!(result.is_err());
            assert_eq!(items[1 - bad], 1);
        }
        let mut items = [0; 4];
        team.for_each(&mut items, |i, item| *item = i);
        assert_eq!(items, [0, 1, 2, 3]);
    }
}
