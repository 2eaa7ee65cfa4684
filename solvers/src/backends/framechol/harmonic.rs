//! `harmonic` without its dense right-hand side: only rows next to a constraint are not zero.
//!
//! The forward sweep visits only panels on the paths from those rows to the root of the elimination tree (J. R. Gilbert
//! and T. Peierls, "Sparse partial pivoting in time proportional to arithmetic operations", SIAM J. Sci. Stat. Comput. 9,
//! 1988); the right-hand side is formed in place from the constraint values, and the solution goes straight to the
//! vertices.
use super::gather::{Group, Output, Source};
use super::method::Method;
use super::panels::Reach;
use crate::backend::{Footprint, Harmonic, Phase, Solved};
use crate::columns::Columns;
use crate::dirichlet::Dirichlet;
use crate::error::{PrepareError, SolveError};
use crate::isa::{Isa, Real};
use crate::lanes::Shape;
use crate::ordering::inverse;
use std::ops::Range;

/// A prepared harmonic field.
pub struct HarmonicField<M> {
    method: M,
    /// Number of vertices, absent ones included.
    vertices: usize,
    /// Vertex eliminated k-th.
    vertex: Vec<u32>,
    /// Constrained vertices, ascending.
    fixed: Vec<u32>,
    /// Vertices whose field is zero.
    absent: Vec<u32>,
    coupling: Coupling,
    reach: Reach,
}

/// L_FC by elimination position.
struct Coupling {
    /// (position, constraint row, stored entry of L), ascending by position.
    entries: Vec<(u32, u32, u32)>,
    /// The entry's value.
    weights: Vec<f64>,
}

impl<M: Method> HarmonicField<M> {
    /// Wraps the factor of `problem`'s free rows, eliminated in `order`.
    pub fn new(problem: &Dirichlet, method: M, order: &[u32]) -> Self {
        let position = inverse(order);
        let coupling = problem.coupling().iter().map(|&(f, c, entry)| (position[f as usize], c, entry));
        let mut entries: Vec<_> = coupling.collect();
        entries.sort_unstable();
        let reach = method.reach(entries.iter().map(|e| e.0));
        let mut in_system = vec![false; problem.laplacian().n()];
        problem.fixed().iter().chain(problem.free()).for_each(|&v| in_system[v as usize] = true);
        let mut field = Self {
            method,
            vertices: in_system.len(),
            vertex: order.iter().map(|&row| problem.free()[row as usize]).collect(),
            fixed: problem.fixed().to_vec(),
            absent: (0..in_system.len() as u32).filter(|&v| !in_system[v as usize]).collect(),
            coupling: Coupling { weights: vec![0.0; entries.len()], entries },
            reach,
        };
        field.coupling.update(problem.laplacian().values());
        field
    }
}

impl Coupling {
    fn update(&mut self, values: &[f64]) {
        for (weight, &(_, _, entry)) in self.weights.iter_mut().zip(&self.entries) {
            *weight = values[entry as usize];
        }
    }
}

impl<M: Method> Harmonic for HarmonicField<M> {
    fn solve(
        &mut self,
        constraints: Columns<&[f64]>,
        mut field: Columns<&mut [f64]>,
    ) -> Result<Solved, SolveError> {
        let k = constraints.k();
        assert_eq!(
            (constraints.n(), field.n(), field.k()),
            (self.fixed.len(), self.vertices, k),
            "constraints, field"
        );
        for (row, &v) in self.fixed.iter().enumerate() {
            field.row_mut(v as usize).copy_from_slice(constraints.row(row));
        }
        for &v in &self.absent {
            field.row_mut(v as usize).fill(0.0);
        }
        let source = Boundary { coupling: &self.coupling, reach: &self.reach, constraints };
        let answer = self.method.solve(&source, &self.vertex, &Output::new(&mut field), k);
        if answer.finite {
            return Ok(Solved { iterations: answer.pairs, ..Solved::default() });
        }
        let bad = field.data().iter().position(|v| !v.is_finite()).unwrap_or(0);
        Err(SolveError::NonFinite { row: bad / k })
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        on(Phase::Numeric);
        self.coupling.update(values);
        self.method.factorise(values)
    }

    fn footprint(&self) -> Footprint {
        let own =
            4 * (self.vertex.len() + self.fixed.len() + self.absent.len()) + 20 * self.coupling.entries.len();
        let mut footprint = self.method.footprint();
        footprint.host_bytes = footprint.host_bytes.map(|bytes| bytes + own as u64);
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
    ) -> f64 {
        work.fill(S::Row::default());
        let entries = &self.coupling.entries;
        let start = entries.partition_point(|e| (e.0 as usize) < range.start);
        let mut largest = 0.0_f64;
        for (&(position, row, _), weight) in entries[start..].iter().zip(&self.coupling.weights[start..]) {
            if position as usize >= range.end {
                break;
            }
            let values = &self.constraints.row(row as usize)[group.from..group.from + group.count];
            for (w, &g) in work[position as usize - range.start].as_mut().iter_mut().zip(values) {
                let b = weight * g;
                largest = largest.max(b.abs());
                *w += S::T::from_f64(-b * scale);
            }
        }
        largest
    }

    fn active(&self, part: usize) -> Option<&[u32]> {
        self.reach.panels.get(part).map(|panels| &panels[..])
    }
}
