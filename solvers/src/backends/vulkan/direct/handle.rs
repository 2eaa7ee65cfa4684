//! A factored system.
use super::core::Core;
use super::frames::Frames;
use crate::backend::{Factor, Footprint, Phase, Solved};
use crate::backends::framechol::engine::groups;
use crate::backends::framechol::first_bad_row;
use crate::columns::Columns;
use crate::error::{PrepareError, SolveError};

/// Frames with a row per row of the matrix.
pub struct Handle<C: Core> {
    frames: Frames<C>,
    ordering: &'static str,
}

impl<C: Core> Handle<C> {
    /// Wraps frames.
    pub fn new(frames: Frames<C>, ordering: &'static str) -> Self {
        Self { frames, ordering }
    }
}

impl<C: Core> Factor for Handle<C> {
    fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        let (n, k) = (self.frames.core.tables().rows(), rhs.k());
        assert_eq!((rhs.n(), x.n(), x.k()), (n, n, k), "rhs, x: both must be n x k");
        let mut all = Solved { device_ns: Some(0), ..Solved::default() };
        for group in groups(k, self.frames.widest()) {
            let (finite, solved) = self.frames.solve(rhs, &mut x, group)?;
            if !finite {
                return Err(SolveError::NonFinite { row: first_bad_row(rhs, x.view()) });
            }
            all = together(all, solved);
        }
        Ok(all)
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        on(Phase::Numeric);
        self.frames.core.factorise(values)
    }

    fn device_phases(&mut self) -> Result<Vec<(String, u64)>, SolveError> {
        Ok(self.frames.device_phases()?)
    }

    fn permutation(&self) -> Option<&[u32]> {
        Some(&self.frames.core.tables().symbolic().order)
    }

    fn footprint(&self) -> Footprint {
        self.frames.footprint(self.ordering)
    }
}

/// What two groups of columns, solved one after the other, have to report.
pub fn together(a: Solved, b: Solved) -> Solved {
    Solved {
        iterations: a.iterations.max(b.iterations),
        residual: None,
        device_ns: a.device_ns.zip(b.device_ns).map(|(a, b)| a + b),
    }
}
