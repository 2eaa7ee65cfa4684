//! `framechol`: supernodal Cholesky made for meshes that are factored once and solved in every frame.
//!
//! ```text
//! graph -> order -> supernodes -> tasks -> symbolic -> numeric (fronts) -> panels -> sweeps, frame after frame
//! ```
//! `DESIGN.md` of this crate has the layout of the factor, the task graph, the precisions, and what did not pay.
mod front;
mod gather;
mod numeric;
mod panels;
mod supernodes;
mod sweep;
mod symbolic;
mod tasks;

use crate::backend::{Backend, Description, Factor, Footprint, Phase, PrepareOptions, Solved};
use crate::columns::Columns;
use crate::error::{PrepareError, SolveError, Unavailable};
use crate::isa::Isa;
use crate::lanes::{Lanes, Shape};
use crate::ordering::{self, Graph};
use crate::registry::OpenOptions;
use crate::sparse::inverse_permutation;
use crate::system::System;
use gather::{Gather, Group, Scatter};
use numeric::{Breakdown, FactorPart, Workspace};
use panels::Panels;
use std::marker::PhantomData;
use sweep::{Backward, Forward};
use symbolic::Symbolic;

/// Opens `framechol-f64`: stored and swept in f64.
pub fn open_f64(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(FrameChol::<f64>::new(options)))
}

/// Opens `framechol-f32`: factored in f64, stored and swept in f32.
pub fn open_f32(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(FrameChol::<f32>::new(options)))
}

struct FrameChol<T> {
    isa: Isa,
    stored: PhantomData<fn() -> T>,
}

impl<T: Lanes> FrameChol<T> {
    fn new(_: &OpenOptions<'_>) -> Self {
        Self { isa: Isa::best(), stored: PhantomData }
    }
}

impl<T: Lanes> Backend for FrameChol<T> {
    fn describe(&self) -> Description {
        Description { details: vec![("isa", self.isa.name().into())], ..Description::cpu(1) }
    }

    fn prepare(
        &self,
        system: &System,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Factor>, PrepareError> {
        assert!(options.max_columns > 0, "max_columns: at least 1");
        on(Phase::Order);
        let matrix = system.matrix();
        let graph = Graph::from_triangle_of_matrix(matrix.row_starts(), matrix.columns());
        let (order, name) = match options.order {
            Some(order) => {
                assert_eq!(order.len(), matrix.n(), "order: one entry per row");
                inverse_permutation(order);
                (order.to_vec(), "given")
            }
            None => {
                let ordering = ordering::minimum_degree(&graph);
                (ordering.order, ordering.name)
            }
        };
        on(Phase::Symbolic);
        let symbolic = Symbolic::new(matrix, &graph, &order, 1);
        drop((graph, order));
        let panels = symbolic.parts.iter().map(Panels::new).collect();
        let work = symbolic.parts.iter().map(Workspace::new).collect();
        let lanes = if options.max_columns > 4 { 8 } else { 4 };
        let vectors = vec![T::default(); lanes * symbolic.order.len()];
        let mut handle = Handle { isa: self.isa, symbolic, panels, work, vectors, name };
        handle.factorise(matrix.values(), on)?;
        Ok(Box::new(handle))
    }
}

/// The first row with a number that is not finite in the right-hand side, or else in the solution.
fn first_bad_row(rhs: Columns<&[f64]>, x: Columns<&[f64]>) -> usize {
    let bad =
        |block: Columns<&[f64]>| block.slice().iter().position(|v| !v.is_finite()).map(|at| at / block.k());
    bad(rhs).or_else(|| bad(x)).unwrap_or(0)
}

/// A factored system.
struct Handle<T> {
    isa: Isa,
    symbolic: Symbolic,
    panels: Vec<Panels<T>>,
    work: Vec<Workspace>,
    vectors: Vec<T>,
    name: &'static str,
}

impl<T: Lanes> Handle<T> {
    fn factorise(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        on(Phase::Numeric);
        let (part, work, out) = (&self.symbolic.parts[0], &mut self.work[0], &mut self.panels[0]);
        self.isa.run(FactorPart { part, values, below: &[], work, out }).map_err(
            |Breakdown { position, pivot }| {
                let row = self.symbolic.order[position as usize] as usize;
                if pivot.is_finite() {
                    PrepareError::NotPositiveDefinite { row }
                } else {
                    PrepareError::NonFinite { row }
                }
            },
        )
    }

    /// A group of columns in one sweep pair. Returns whether the solution is finite.
    fn sweep<S: Shape<T = T>>(&mut self, rhs: Columns<&[f64]>, x: Columns<&mut [f64]>, group: Group) -> bool {
        let order = &self.symbolic.order[..];
        let work = &mut S::rows(&mut self.vectors)[..order.len()];
        self.isa.run(Gather::<S> { order, block: rhs, group, work });
        self.isa.run(Forward::<S> { panels: &self.panels[0], work });
        self.isa.run(Backward::<S> { panels: &self.panels[0], work });
        self.isa.run(Scatter::<S> { order, block: x, group, work })
    }
}

impl<T: Lanes> Factor for Handle<T> {
    fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        let (n, k) = (self.symbolic.order.len(), rhs.k());
        assert_eq!((rhs.n(), x.n(), x.k()), (n, n, k), "rhs, x: both must be n x k");
        let widest = self.vectors.len() / n;
        let (mut from, mut finite) = (0, true);
        while from < k {
            let count = (k - from).min(widest);
            let group = Group { from, count };
            finite &= if count > 4 {
                self.sweep::<T::Eight>(rhs, x.reborrow(), group)
            } else {
                self.sweep::<T::Four>(rhs, x.reborrow(), group)
            };
            from += count;
        }
        if finite {
            Ok(Solved::default())
        } else {
            Err(SolveError::NonFinite { row: first_bad_row(rhs, x.view()) })
        }
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        self.factorise(values, on)
    }

    fn permutation(&self) -> Option<&[u32]> {
        Some(&self.symbolic.order)
    }

    fn footprint(&self) -> Footprint {
        let panels: u64 = self.panels.iter().map(Panels::bytes).sum();
        let work: u64 = self.work.iter().map(Workspace::bytes).sum();
        let vectors = size_of_val(&self.vectors[..]) as u64;
        Footprint {
            host_bytes: Some(panels + work + vectors),
            device_bytes: None,
            factor_nonzeros: Some(self.symbolic.nonzeros),
            factor_bytes: Some(panels),
            bytes_per_solve: Some(self.panels.iter().map(Panels::bytes_per_solve).sum()),
            factor_flops: Some(self.symbolic.flops),
            ordering: Some(self.name),
        }
    }
}
