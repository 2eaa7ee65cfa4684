//! `harmonic` without its dense right-hand side: only rows next to a constraint are not zero.
//!
//! The forward sweep visits only panels on the paths from those rows to the root of the elimination tree (J. R. Gilbert
//! and T. Peierls, "Sparse partial pivoting in time proportional to arithmetic operations", SIAM J. Sci. Stat. Comput. 9,
//! 1988); the right-hand side is formed in place from the constraint values, and the solution goes straight to the
//! vertices. A few edited vertices border the factor at hand ([`super::bordered`]); when they become many, the set is
//! factored anew: constrained vertices are unit rows of one fixed pattern, so that needs no ordering and no analysis.
use super::bordered::{Base, Border};
use super::constraints::Constraints;
use super::gather::{Group, Output, Source};
use super::method::Method;
use super::panels::Reach;
use crate::backend::{Footprint, Harmonic, Phase, Solved};
use crate::columns::Columns;
use crate::error::{EditError, PrepareError, SolveError};
use crate::isa::{Isa, Real};
use crate::lanes::Shape;
use crate::ordering::inverse;
use std::ops::Range;
use std::sync::Arc;

/// A prepared harmonic field.
pub struct HarmonicField<M> {
    method: M,
    constraints: Constraints,
    /// Vertex eliminated k-th, and its inverse.
    order: Arc<[u32]>,
    position: Vec<u32>,
    coupling: Coupling,
    reach: Reach,
    /// Edits since the last factorisation.
    border: Border,
}

/// L_FC by elimination position.
#[derive(Default)]
struct Coupling {
    /// (position, constraint row, stored entry of L), ascending by position.
    entries: Vec<(u32, u32, u32)>,
    /// The entry's value.
    weights: Vec<f64>,
}

impl Coupling {
    /// Of the base's entries those whose constraint is still in force, by its row in the set in force.
    fn new(constraints: &Constraints, position: &[u32]) -> Self {
        let row_now = |row: u32| constraints.fixed().binary_search(&constraints.base()[row as usize]).ok();
        let coupling = constraints
            .coupling()
            .iter()
            .filter_map(|&(v, row, entry)| row_now(row).map(|row| (position[v as usize], row as u32, entry)));
        let mut entries: Vec<_> = coupling.collect();
        entries.sort_unstable();
        let mut out = Self { weights: vec![0.0; entries.len()], entries };
        out.update(constraints.laplacian().values());
        out
    }

    fn update(&mut self, values: &[f64]) {
        for (weight, &(_, _, entry)) in self.weights.iter_mut().zip(&self.entries) {
            *weight = values[entry as usize];
        }
    }
}

impl<M: Method> HarmonicField<M> {
    /// Wraps `method`, which has factored `constraints.values()` with the vertices eliminated in `order`.
    pub fn new(constraints: Constraints, method: M, order: Arc<[u32]>, max_columns: usize) -> Self {
        let position = inverse(&order);
        let reach = Reach { panels: Vec::new(), skipped_bytes: 0 };
        let (coupling, border) = (Coupling::default(), Border::new(max_columns));
        let mut field = Self { method, constraints, order, position, coupling, reach, border };
        field.couple();
        field
    }

    /// The right-hand side's places for the constraints at hand.
    fn couple(&mut self) {
        self.coupling = Coupling::new(&self.constraints, &self.position);
        self.reach = self.method.reach(self.coupling.entries.iter().map(|e| e.0));
    }

    /// Factors the set in force, which becomes the base.
    fn rebase(&mut self) -> Result<(), PrepareError> {
        self.border.clear();
        self.constraints.refresh();
        self.method.factorise(self.constraints.values())?;
        self.couple();
        Ok(())
    }

    /// Borders the base's factor for the set in force; false where that does not do.
    fn extend_border(&mut self) -> bool {
        let Self { method, constraints, order, position, border, .. } = self;
        let laplacian = constraints.laplacian();
        let mut base = Base { method, laplacian, order, position, fixed: constraints.base() };
        border.reach(&mut base, constraints.fixed())
    }

    /// Writes g at the constraints in force, and turns the base's field into that of the edited set. Returns whether all
    /// went well.
    fn finish(&mut self, g: Columns<&[f64]>, field: &mut Columns<&mut [f64]>) -> bool {
        let Self { method, constraints, border, .. } = self;
        let (fixed, base) = (constraints.fixed(), constraints.base());
        for (row, v) in fixed.iter().enumerate() {
            if border.is_empty() || base.binary_search(v).is_ok() {
                field.row_mut(*v as usize).copy_from_slice(g.row(row));
            }
        }
        if border.is_empty() {
            return true;
        }
        let (values, k) = (g.slice(), g.k());
        let value = |v: u32| {
            let row = fixed.binary_search(&v).expect("an added vertex is constrained");
            &values[row * k..(row + 1) * k]
        };
        let (team, isa) = method.team();
        border.correct(team, isa, field, value)
    }
}

impl<M: Method> Harmonic for HarmonicField<M> {
    fn solve(
        &mut self,
        constraints: Columns<&[f64]>,
        mut field: Columns<&mut [f64]>,
    ) -> Result<Solved, SolveError> {
        let (k, fixed) = (constraints.k(), self.constraints.fixed());
        assert_eq!((constraints.n(), constraints.k()), (fixed.len(), field.k()), "constraints: |C| x k");
        assert_eq!(field.n(), self.order.len(), "field: one row per vertex");
        let source = Boundary { coupling: &self.coupling, reach: &self.reach, constraints };
        let answer = self.method.solve(&source, &self.order, &Output::new(&mut field), k);
        let finite = self.finish(constraints, &mut field) && answer.finite;
        let bad = || field.data().iter().position(|v| !v.is_finite());
        match if finite { None } else { bad() } {
            Some(at) => Err(SolveError::NonFinite { row: at / k }),
            None => Ok(Solved { iterations: answer.pairs, ..Solved::default() }),
        }
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        on(Phase::Numeric);
        self.constraints.update_values(values);
        if !self.border.is_empty() {
            return self.rebase();
        }
        self.coupling.update(values);
        self.method.factorise(self.constraints.values())
    }

    /// Up to [`MOST_COLUMNS`](super::bordered::MOST_COLUMNS) vertices since the last factorisation: one solve for every four
    /// new ones. Beyond that one numeric factorisation on the pattern at hand.
    fn edit_constraints(&mut self, add: &[u32], remove: &[u32]) -> Result<(), EditError> {
        self.constraints.edit(add, remove)?;
        if self.extend_border() {
            self.couple();
            return Ok(());
        }
        if let Err(error) = self.rebase() {
            self.constraints.edit(remove, add)?;
            self.rebase()?;
            return Err(error.into());
        }
        Ok(())
    }

    fn footprint(&self) -> Footprint {
        let laplacian = self.constraints.laplacian();
        // Per vertex four numbers of 4 bytes (row start, component, row, position) and a kind of 1; per stored entry a
        // column and two values.
        let own = 17 * laplacian.n() + 20 * laplacian.stored() + 20 * self.coupling.entries.len();
        let (border, read) = (self.border.bytes(), self.border.bytes_per_frame());
        let mut footprint = self.method.footprint();
        footprint.host_bytes = footprint.host_bytes.map(|bytes| bytes + own as u64 + border);
        footprint.bytes_per_solve =
            footprint.bytes_per_solve.map(|bytes| bytes - self.reach.skipped_bytes + read);
        footprint
    }
}

/// -L_FC g as a right-hand side.
struct Boundary<'a> {
    coupling: &'a Coupling,
    reach: &'a Reach,
    constraints: Columns<&'a [f64]>,
}

impl Source for Boundary<'_> {
    fn load<S: Shape>(
        &self,
        _: Isa,
        range: Range<usize>,
        group: Group,
        scale: f64,
        work: &mut [S::Row],
    ) -> [f64; 8] {
        work.fill(S::Row::default());
        let entries = &self.coupling.entries;
        let start = entries.partition_point(|e| (e.0 as usize) < range.start);
        let mut largest = [0.0_f64; 8];
        for (&(position, row, _), weight) in entries[start..].iter().zip(&self.coupling.weights[start..]) {
            if position as usize >= range.end {
                break;
            }
            let values = &self.constraints.row(row as usize)[group.from..group.from + group.count];
            let row = work[position as usize - range.start].as_mut();
            for ((w, &g), largest) in row.iter_mut().zip(values).zip(&mut largest) {
                let b = weight * g;
                *largest = largest.max(b.abs());
                *w += S::T::from_f64(-b * scale);
            }
        }
        largest
    }

    fn active(&self, part: usize) -> Option<&[u32]> {
        self.reach.panels.get(part).map(|panels| &panels[..])
    }
}
