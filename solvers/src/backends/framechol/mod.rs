//! `framechol`: supernodal Cholesky made for meshes that are factored once and solved in every frame.
//!
//! ```text
//! graph -> order -> supernodes -> tasks -> symbolic -> numeric (fronts) -> panels -> sweeps, frame after frame
//! ```
//! `DESIGN.md` of this crate has the layout of the factor, the task graph, the precisions, and what did not pay.
mod engine;
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
use crate::lanes::Lanes;
use crate::ordering::{self, Graph};
use crate::registry::OpenOptions;
use crate::sparse::inverse_permutation;
use crate::system::System;
use engine::{Engine, in_groups};
use gather::{Dense, Output};
use std::marker::PhantomData;
use std::sync::Arc;
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
    threads: usize,
    stored: PhantomData<fn() -> T>,
}

impl<T: Lanes> FrameChol<T> {
    fn new(options: &OpenOptions<'_>) -> Self {
        Self { isa: Isa::best(), threads: options.threads, stored: PhantomData }
    }
}

impl<T: Lanes> Backend for FrameChol<T> {
    fn describe(&self) -> Description {
        Description { details: vec![("isa", self.isa.name().into())], ..Description::cpu(self.threads) }
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
                let ordering = ordering::nested_dissection(&graph);
                (ordering.order, ordering.name)
            }
        };
        on(Phase::Symbolic);
        let symbolic = Symbolic::new(matrix, &graph, &order, self.threads);
        drop((graph, order));
        let lanes = if options.max_columns > 4 { 8 } else { 4 };
        let order = Arc::clone(&symbolic.order);
        let mut handle = Handle::<T> { engine: Engine::new(self.isa, symbolic, lanes, name, |_| ())?, order };
        handle.update_values(matrix.values(), on)?;
        Ok(Box::new(handle))
    }
}

/// A factored system: one sweep pair per solve.
struct Handle<T> {
    engine: Engine<T, ()>,
    /// Row eliminated k-th.
    order: Arc<[u32]>,
}

impl<T: Lanes> Factor for Handle<T> {
    fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        let (n, k) = (self.order.len(), rhs.k());
        assert_eq!((rhs.n(), x.n(), x.k()), (n, n, k), "rhs, x: both must be n x k");
        let rows = &self.order[..];
        let source = Dense { order: rows, block: rhs };
        let out = Output::new(&mut x);
        let finite = in_groups(k, self.engine.widest(), |group| {
            if group.count > 4 {
                self.engine.frame::<T::Eight>(&source, rows, &out, group)
            } else {
                self.engine.frame::<T::Four>(&source, rows, &out, group)
            }
        });
        if finite {
            Ok(Solved::default())
        } else {
            Err(SolveError::NonFinite { row: first_bad_row(rhs, x.view()) })
        }
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        on(Phase::Numeric);
        self.engine.factorise(values)
    }

    fn permutation(&self) -> Option<&[u32]> {
        Some(&self.order)
    }

    fn footprint(&self) -> Footprint {
        self.engine.footprint()
    }
}

/// The first row with a number that is not finite in the right-hand side, or else in the solution.
fn first_bad_row(rhs: Columns<&[f64]>, x: Columns<&[f64]>) -> usize {
    let bad =
        |block: Columns<&[f64]>| block.slice().iter().position(|v| !v.is_finite()).map(|at| at / block.k());
    bad(rhs).or_else(|| bad(x)).unwrap_or(0)
}
