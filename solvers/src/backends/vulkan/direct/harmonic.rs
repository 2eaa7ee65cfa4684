//! `harmonic` on the device: the values at the constraints go up, the field comes down in the order of the vertices.
//!
//! The factor is that of L_FF. Its vectors have a row per vertex, so that nothing is gathered or scattered on the host;
//! rows next to a constraint are formed on the device, and the forward sweep leaves out blocks that they do not reach
//! (J. R. Gilbert and T. Peierls, "Sparse partial pivoting in time proportional to arithmetic operations", SIAM J. Sci.
//! Stat. Comput. 9, 1988).
use super::core::Core;
use super::frames::Frames;
use super::handle::together;
use crate::backend::{Footprint, Harmonic, Phase, Solved};
use crate::backends::framechol::engine::groups;
use crate::columns::Columns;
use crate::dirichlet::Dirichlet;
use crate::error::{PrepareError, SolveError};

/// A prepared harmonic field.
pub struct Field<C: Core> {
    problem: Dirichlet,
    frames: Frames<C>,
    ordering: &'static str,
}

impl<C: Core> Field<C> {
    /// Wraps frames from values at the constraints of `problem`.
    pub fn new(problem: &Dirichlet, frames: Frames<C>, ordering: &'static str) -> Self {
        Self { problem: problem.clone(), frames, ordering }
    }
}

impl<C: Core> Harmonic for Field<C> {
    fn solve(
        &mut self,
        constraints: Columns<&[f64]>,
        mut field: Columns<&mut [f64]>,
    ) -> Result<Solved, SolveError> {
        let (k, fixed) = (constraints.k(), self.problem.fixed());
        assert_eq!((constraints.n(), k), (fixed.len(), field.k()), "constraints: |C| x k");
        assert_eq!(field.n(), self.problem.laplacian().n(), "field: one row per vertex");
        let (mut finite, mut all) = (true, Solved { device_ns: Some(0), ..Solved::default() });
        for group in groups(k, self.frames.widest()) {
            let (good, solved) = self.frames.solve(constraints, &mut field, group)?;
            finite &= good;
            all = together(all, solved);
        }
        for (row, &v) in fixed.iter().enumerate() {
            field.row_mut(v as usize).copy_from_slice(constraints.row(row));
        }
        match if finite { None } else { field.data().iter().position(|v| !v.is_finite()) } {
            Some(at) => Err(SolveError::NonFinite { row: at / k }),
            None => Ok(all),
        }
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        self.problem.update_values(values)?;
        on(Phase::Numeric);
        let system = self.problem.system().expect("something is free");
        self.frames.core.factorise(system.matrix().values())?;
        Ok(self.frames.couple(values)?)
    }

    fn device_phases(&mut self) -> Result<Vec<(String, u64)>, SolveError> {
        Ok(self.frames.device_phases()?)
    }

    fn footprint(&self) -> Footprint {
        self.frames.footprint(self.ordering)
    }
}
