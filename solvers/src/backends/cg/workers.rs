//! Threads and vector units of a solve: the rows of every vector are cut into strips, one per thread.
//!
//! Breadth-first numbering makes contiguous rows a piece of the surface with a short border, so a thread finds most of
//! what it gathers in its own strip. Sums are added up per strip, then over the strips in order: the result depends
//! on the number of threads and on nothing else.

use crate::error::PrepareError;
use crate::isa::Isa;
use crate::team::Team;
use std::marker::PhantomData;
use std::ops::Range;

/// Fewest rows of a strip: some ten microseconds of work, a multiple of what handing it to a waiting thread costs.
const LEAST_ROWS: usize = 1_000;

/// The threads of a handle and the instruction set of its kernels.
pub(crate) struct Workers {
    /// What the kernels are compiled for.
    pub(crate) isa: Isa,
    team: Team,
}

impl Workers {
    /// A team of `threads`.
    ///
    /// # Errors
    /// Where the system refuses a thread.
    pub(crate) fn new(threads: usize) -> Result<Self, PrepareError> {
        let team = Team::new(threads).map_err(|error| PrepareError::Unsupported {
            what: format!("{threads} threads: the system refuses to start them ({error})"),
        })?;
        Ok(Self { isa: Isa::best(), team })
    }

    /// The caller's thread alone.
    #[cfg(test)]
    pub(crate) fn one() -> Self {
        Self::new(1).expect("no thread is started")
    }

    /// Number of threads.
    pub(crate) fn threads(&self) -> usize {
        self.team.threads()
    }

    /// Even strips of `rows` rows.
    pub(crate) fn strips(&self, rows: usize) -> Strips {
        let count = self.threads().min(rows / LEAST_ROWS).max(1);
        Strips { bounds: (0..=count).map(|t| t * rows / count).collect() }
    }

    /// Runs `job(t, strip t, its part of `parts`)` for every strip t, each on a thread of its own. No allocation.
    pub(crate) fn run<'a, P: Parts<'a>>(
        &mut self,
        strips: &Strips,
        parts: P,
        job: impl Fn(usize, Range<usize>, P::Part) + Sync,
    ) {
        parts.check(strips);
        let shared = parts.share();
        let work = |t: usize| {
            if t < strips.count() {
                let rows = strips.range(t);
                // SAFETY: `check` has seen that all strips lie within the parts; strips are disjoint, each t runs once, and
                // what the parts were borrowed from stays borrowed until `run` has returned.
                let part = unsafe { P::part(&shared, t, &rows) };
                job(t, rows, part);
            }
        };
        if strips.count() == 1 { work(0) } else { self.team.run(&work) }
    }
}

/// Contiguous ranges of rows, in order, that cover all of them; at most one per thread.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Strips {
    bounds: Vec<usize>,
}

impl Strips {
    /// The strips between `bounds`, which ascend from 0 to the number of rows.
    pub(crate) fn new(bounds: Vec<usize>) -> Self {
        assert!(bounds.len() > 1 && bounds[0] == 0 && bounds.is_sorted(), "bounds: ascending from 0");
        Self { bounds }
    }

    /// Number of strips.
    pub(crate) fn count(&self) -> usize {
        self.bounds.len() - 1
    }

    /// Number of rows.
    pub(crate) fn rows(&self) -> usize {
        self.bounds[self.count()]
    }

    /// Rows of strip `t`.
    pub(crate) fn range(&self, t: usize) -> Range<usize> {
        self.bounds[t]..self.bounds[t + 1]
    }
}

/// What can be cut along strips.
pub(crate) trait Parts<'a> {
    /// The piece of one strip.
    type Part;
    /// The whole, as all threads see it.
    type Shared: Sync;
    /// Panics unless it is as long as the strips.
    fn check(&self, strips: &Strips);
    /// Gives up the exclusive borrow.
    fn share(self) -> Self::Shared;
    /// The piece of strip `t` with the rows `rows`.
    ///
    /// # Safety
    /// `check` has passed for these strips, and no other part of the same strip exists.
    unsafe fn part(shared: &Self::Shared, t: usize, rows: &Range<usize>) -> Self::Part;
}

/// The start of a slice of which every thread takes another piece.
pub(crate) struct Start<'a, T>(*mut T, PhantomData<&'a mut [T]>);

// SAFETY: the items are `Send`, and every piece is handed to one thread only.
unsafe impl<T: Send> Sync for Start<'_, T> {}

/// A slice with one item per row.
impl<'a, T: Send + 'a> Parts<'a> for &'a mut [T] {
    type Part = &'a mut [T];
    type Shared = Start<'a, T>;

    fn check(&self, strips: &Strips) {
        assert_eq!(self.len(), strips.rows(), "parts: one item per row");
    }

    fn share(self) -> Start<'a, T> {
        Start(self.as_mut_ptr(), PhantomData)
    }

    unsafe fn part(shared: &Start<'a, T>, _: usize, rows: &Range<usize>) -> &'a mut [T] {
        // SAFETY: the rows lie within the slice, and no one else has them.
        unsafe { std::slice::from_raw_parts_mut(shared.0.add(rows.start), rows.len()) }
    }
}

/// A slice with one item per strip (and perhaps more, which stay untouched).
pub(crate) struct Each<'a, T>(pub(crate) &'a mut [T]);

impl<'a, T: Send + 'a> Parts<'a> for Each<'a, T> {
    type Part = &'a mut T;
    type Shared = Start<'a, T>;

    fn check(&self, strips: &Strips) {
        assert!(self.0.len() >= strips.count(), "parts: one item per strip");
    }

    fn share(self) -> Start<'a, T> {
        Start(self.0.as_mut_ptr(), PhantomData)
    }

    unsafe fn part(shared: &Start<'a, T>, t: usize, _: &Range<usize>) -> &'a mut T {
        // SAFETY: there are at least t + 1 items, and no one else has this one.
        unsafe { &mut *shared.0.add(t) }
    }
}

macro_rules! tuple {
    ($($p:ident $i:tt),*) => {
        impl<'a, $($p: Parts<'a>),*> Parts<'a> for ($($p,)*) {
            type Part = ($($p::Part,)*);
            type Shared = ($($p::Shared,)*);

            fn check(&self, strips: &Strips) {
                $(self.$i.check(strips);)*
            }

            fn share(self) -> Self::Shared {
                ($(self.$i.share(),)*)
            }

            unsafe fn part(shared: &Self::Shared, t: usize, rows: &Range<usize>) -> Self::Part {
                // SAFETY: as the caller has promised for all of them.
                ($(unsafe { $p::part(&shared.$i, t, rows) },)*)
            }
        }
    };
}
tuple!(A 0, B 1);
tuple!(A 0, B 1, C 2);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_cover_all_rows_once_and_are_never_tiny() {
        let workers = Workers::new(3).expect("threads");
        for (rows, count) in [(0, 1), (1, 1), (2_500, 2), (10_000, 3), (10_001, 3)] {
            let strips = workers.strips(rows);
            assert_eq!((strips.count(), strips.rows()), (count, rows));
        }
    }

    #[test]
    fn every_row_goes_to_the_thread_of_its_strip() {
        let mut workers = Workers::new(3).expect("threads");
        let strips = Strips::new(vec![0, 4, 4, 9]);
        let (mut rows, mut each) = (vec![(0, 0); 9], vec![0; 5]);
        for _ in 0..100 {
            workers.run(&strips, (&mut rows[..], Each(&mut each)), |t, range, (part, sum)| {
                for (row, i) in part.iter_mut().zip(range.clone()) {
                    *row = (t, i);
                }
                *sum += range.len();
            });
        }
        let expected: Vec<_> = (0..9).map(|i| (if i < 4 { 0 } else { 2 }, i)).collect();
        assert_eq!((rows, each), (expected, vec![400, 0, 500, 0, 0]));
    }

    #[test]
    #[should_panic(expected = "one item per row")]
    fn a_slice_of_another_length_is_refused() {
        Workers::one().run(&Strips::new(vec![0, 5]), &mut [0; 4][..], |_, _, _| {});
    }
}
