//! `framechol`: supernodal Cholesky made for meshes that are factored once and solved in every frame.
//!
//! ```text
//! graph -> order -> supernodes -> tasks -> symbolic -> numeric (fronts) -> panels -> sweeps, frame after frame
//! ```
//! `DESIGN.md` of this crate has the layout of the factor, the task graph, the precisions, and what did not pay.
mod bordered;
mod careful;
pub(super) mod constraints;
pub(super) mod engine;
pub(super) mod front;
pub(super) mod gather;
mod harmonic;
mod lu;
mod method;
mod norms;
pub(super) mod numeric;
mod panels;
mod passes;
mod refine;
mod rows;
pub(super) mod supernodes;
mod sweep;
pub(super) mod symbolic;
mod tasks;
#[cfg(test)]
mod tests;

use crate::backend::{Backend, Description, Factor, Footprint, Harmonic, Phase, PrepareOptions, Solved};
use crate::columns::Columns;
use crate::dirichlet::{Dirichlet, ReducedHarmonic};
use crate::error::{PrepareError, SolveError, Unavailable};
use crate::isa::Isa;
use crate::ordering::{self, Graph};
use crate::registry::OpenOptions;
use crate::sparse::{SymmetricCsr, inverse_permutation};
use crate::system::System;
use careful::Careful;
use constraints::{Constraints, extend_order};
use gather::{Dense, Output};
use harmonic::HarmonicField;
use method::{Method, Plan, Single};
use refine::Refined;
use std::marker::PhantomData;
use std::sync::Arc;
use supernodes::Supernodes;
use symbolic::Symbolic;

/// Opens `framechol-f64`: stored and swept in f64, twice where the system is ill-conditioned.
pub fn open_f64(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(FrameChol::<Careful<Single<f64>>>::new(options)?))
}

/// Opens `framechol-f32`: factored in f64, stored and swept in f32.
pub fn open_f32(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(FrameChol::<Single<f32>>::new(options)?))
}

/// Opens `framechol-mixed`: stored and swept in f32, refined with residuals in f64, once more where the system is
/// ill-conditioned.
pub fn open_mixed(options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(FrameChol::<Careful<Refined>>::new(options)?))
}

/// Sweep cost in entries from which a second thread pays. Waking a parked thread takes some 50 microseconds at the start
/// of a frame; a smaller factor is swept by one thread in little more than that.
const LEAST_PARALLEL: u64 = 400_000;

struct FrameChol<M> {
    isa: Isa,
    threads: usize,
    least_parallel: u64,
    method: PhantomData<fn() -> M>,
}

impl<M: Method> FrameChol<M> {
    fn new(options: &OpenOptions<'_>) -> Result<Self, Unavailable> {
        Ok(Self {
            isa: Isa::from_environment()?,
            threads: options.threads,
            least_parallel: LEAST_PARALLEL,
            method: PhantomData,
        })
    }

    /// Orders, analyses and factors a matrix of the pattern of `matrix` with these values. Returns the method and the
    /// elimination order.
    fn factorise(
        &self,
        matrix: &SymmetricCsr,
        values: &[f64],
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<(M, Arc<[u32]>), PrepareError> {
        assert!(options.max_columns > 0, "max_columns: at least 1");
        on(Phase::Order);
        let pool = thread_pool(self.threads)?;
        let graph = Graph::from_triangle_of_matrix(matrix.row_starts(), matrix.columns());
        let (order, ordering) = match options.order {
            Some(order) => {
                assert_eq!(order.len(), matrix.n(), "order: one entry per row");
                inverse_permutation(order); // panics where a row is missing
                (order.to_vec(), "given")
            }
            None => {
                let ordering = pool.install(|| ordering::nested_dissection(&graph));
                (ordering.order, ordering.name)
            }
        };
        on(Phase::Symbolic);
        let symbolic = pool.install(|| {
            let groups = Supernodes::new(&graph, &order);
            let threads = if groups.total_cost() < self.least_parallel { 1 } else { self.threads };
            Symbolic::new(matrix, &graph, &groups, &order, threads)
        });
        drop((pool, graph, order));
        let order = Arc::clone(&symbolic.order);
        let max_columns = options.max_columns;
        let mut method = M::new(Plan { isa: self.isa, symbolic, matrix, max_columns, ordering })?;
        on(Phase::Numeric);
        method.factorise(values)?;
        method.judge(matrix, values);
        Ok((method, order))
    }
}

impl<M: Method> Backend for FrameChol<M> {
    fn describe(&self) -> Description {
        Description { details: vec![("isa", self.isa.name().into())], ..Description::cpu(self.threads) }
    }

    fn prepare(
        &self,
        system: &System,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Factor>, PrepareError> {
        let matrix = system.matrix();
        let (method, order) = self.factorise(matrix, matrix.values(), options, on)?;
        Ok(Box::new(Handle { method, order }))
    }

    fn prepare_harmonic(
        &self,
        problem: &Dirichlet,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Harmonic>, PrepareError> {
        if problem.free().is_empty() {
            return Ok(Box::new(ReducedHarmonic::new(problem.clone(), None, options.max_columns)));
        }
        let order = options.order.map(|order| extend_order(problem, order));
        let options = PrepareOptions { order: order.as_deref(), ..*options };
        let constraints = Constraints::new(problem);
        let (method, order) = self
            .factorise(constraints.laplacian(), constraints.values(), &options, on)
            .map_err(|error| in_rows_of(problem, error))?;
        Ok(Box::new(HarmonicField::new(constraints, method, order, options.max_columns)))
    }
}

/// Threads for ordering and analysis.
///
/// # Errors
/// Where the system refuses to start them.
pub(super) fn thread_pool(threads: usize) -> Result<rayon::ThreadPool, PrepareError> {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(|error| {
        let what = format!("{threads} threads: the system refuses to start them ({error})");
        PrepareError::Unsupported { what }
    })
}

/// The error with a row of the reduced system where it names a vertex.
pub(super) fn in_rows_of(problem: &Dirichlet, error: PrepareError) -> PrepareError {
    let row = |vertex: usize| problem.free().binary_search(&(vertex as u32)).unwrap_or(vertex);
    match error {
        PrepareError::NotPositiveDefinite { row: v } => PrepareError::NotPositiveDefinite { row: row(v) },
        PrepareError::NonFinite { row: v } => PrepareError::NonFinite { row: row(v) },
        other => other,
    }
}

/// A factored system.
struct Handle<M> {
    method: M,
    /// Row eliminated k-th.
    order: Arc<[u32]>,
}

impl<M: Method> Factor for Handle<M> {
    fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        let (n, k) = (self.order.len(), rhs.k());
        assert_eq!((rhs.n(), x.n(), x.k()), (n, n, k), "rhs, x: both must be n x k");
        let source = Dense { order: &self.order, block: rhs };
        let answer = self.method.solve(&source, &self.order, &Output::new(&mut x), k);
        if answer.finite {
            Ok(Solved { iterations: answer.pairs, ..Solved::default() })
        } else {
            Err(SolveError::NonFinite { row: first_bad_row(rhs, x.view()) })
        }
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        on(Phase::Numeric);
        self.method.factorise(values)
    }

    fn permutation(&self) -> Option<&[u32]> {
        Some(&self.order)
    }

    fn footprint(&self) -> Footprint {
        self.method.footprint()
    }
}

/// The first row with a number that is not finite in the right-hand side, or else in the solution.
pub(super) fn first_bad_row(rhs: Columns<&[f64]>, x: Columns<&[f64]>) -> usize {
    let bad =
        |block: Columns<&[f64]>| block.slice().iter().position(|v| !v.is_finite()).map(|at| at / block.k());
    bad(rhs).or_else(|| bad(x)).unwrap_or(0)
}
