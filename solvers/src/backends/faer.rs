//! `faer-llt`, `faer-ldlt`, `faer-simplicial`: the sparse Cholesky of the faer library.
//!
//! Through its low-level interface: own scratch sized at prepare, no global parallelism, no allocation in a solve. All work
//! is serial, also with more threads: faer parallelises inside dense panels, whose median width on meshes is about six
//! columns, and its threaded solve is several times slower than its serial one there. The ordering is faer's approximate
//! minimum degree unless one is given; it is recorded as its own phase.

use crate::backend::{Backend, Description, Factor, Footprint, Phase, PrepareOptions, Solved};
use crate::columns::Columns;
use crate::error::{PrepareError, SolveError, Unavailable};
use crate::registry::OpenOptions;
use crate::sparse::{SymmetricCsr, inverse_permutation};
use crate::system::System;
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::{ldlt::factor::LdltError, llt::factor::LltError as PivotError};
use faer::perm::PermRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LdltRef, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky, supernodal::SupernodalLdltRef,
};
use faer::sparse::linalg::{SupernodalThreshold, amd};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};

/// Supernodal L L^T.
pub fn open_llt(_: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(Faer { kind: Kind::Llt, threshold: SupernodalThreshold::FORCE_SUPERNODAL }))
}

/// Supernodal L D L^T.
pub fn open_ldlt(_: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(Faer { kind: Kind::Ldlt, threshold: SupernodalThreshold::FORCE_SUPERNODAL }))
}

/// Simplicial L L^T, column by column.
pub fn open_simplicial(_: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    Ok(Box::new(Faer { kind: Kind::Llt, threshold: SupernodalThreshold::FORCE_SIMPLICIAL }))
}

#[derive(Clone, Copy)]
enum Kind {
    Llt,
    Ldlt,
}

struct Faer {
    kind: Kind,
    threshold: SupernodalThreshold,
}

impl Backend for Faer {
    fn describe(&self) -> Description {
        Description::cpu(1)
    }

    fn prepare(
        &self,
        system: &System,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Factor>, PrepareError> {
        let pattern = system.matrix().clone();
        on(Phase::Order);
        let (order, ordering) = match options.order {
            Some(order) => (order.to_vec(), "given"),
            None => (minimum_degree(&pattern)?, "faer AMD"),
        };
        let position = inverse_permutation(&order);
        on(Phase::Symbolic);
        let symbolic = factorize_symbolic_cholesky(
            csc_pattern(&pattern),
            Side::Lower,
            SymmetricOrdering::Custom(PermRef::new_checked(&order, &position, pattern.n())),
            CholeskySymbolicParams {
                supernodal_flop_ratio_threshold: self.threshold,
                ..CholeskySymbolicParams::default()
            },
        )
        .map_err(|_| OUT_OF_MEMORY)?;
        let scratch = numeric_scratch(self.kind, &symbolic)
            .or(symbolic.solve_in_place_scratch::<f64>(options.max_columns, Par::Seq));
        let memory = MemBuffer::try_new(scratch).map_err(|_| OUT_OF_MEMORY)?;
        let mut values = Vec::new();
        values.try_reserve_exact(symbolic.len_val()).map_err(|_| OUT_OF_MEMORY)?;
        values.resize(symbolic.len_val(), 0.0);
        let scratch_bytes = scratch.unaligned_bytes_required() as u64;
        let mut factor =
            FaerFactor { kind: self.kind, pattern, order, ordering, symbolic, values, memory, scratch_bytes };
        factor.factorise(on)?;
        Ok(Box::new(factor))
    }
}

/// faer does not say how much it asked for.
const OUT_OF_MEMORY: PrepareError = PrepareError::OutOfMemory { bytes: 0 };

fn numeric_scratch(kind: Kind, symbolic: &SymbolicCholesky<u32>) -> StackReq {
    match kind {
        Kind::Llt => symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default()),
        Kind::Ldlt => symbolic.factorize_numeric_ldlt_scratch::<f64>(Par::Seq, Default::default()),
    }
}

/// The stored triangle read by columns: the lower triangle.
fn csc_pattern(matrix: &SymmetricCsr) -> SymbolicSparseColMatRef<'_, u32> {
    let n = matrix.n();
    SymbolicSparseColMatRef::new_checked(n, n, matrix.row_starts(), None, matrix.columns())
}

fn minimum_degree(pattern: &SymmetricCsr) -> Result<Vec<u32>, PrepareError> {
    let (n, entries) = (pattern.n(), pattern.stored());
    let (mut order, mut position) = (vec![0u32; n], vec![0u32; n]);
    let request = amd::order_maybe_unsorted_scratch::<u32>(n, entries);
    let mut memory = MemBuffer::try_new(request).map_err(|_| OUT_OF_MEMORY)?;
    amd::order_maybe_unsorted(
        &mut order,
        &mut position,
        csc_pattern(pattern),
        amd::Control::default(),
        MemStack::new(&mut memory),
    )
    .map_err(|_| OUT_OF_MEMORY)?;
    Ok(order)
}

struct FaerFactor {
    kind: Kind,
    pattern: SymmetricCsr,
    order: Vec<u32>,
    ordering: &'static str,
    symbolic: SymbolicCholesky<u32>,
    values: Vec<f64>,
    memory: MemBuffer,
    scratch_bytes: u64,
}

impl FaerFactor {
    fn factorise(&mut self, on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        on(Phase::Numeric);
        let matrix = SparseColMatRef::new(csc_pattern(&self.pattern), self.pattern.values());
        let stack = MemStack::new(&mut self.memory);
        let values = &mut self.values[..];
        let broken_at = match self.kind {
            Kind::Llt => self
                .symbolic
                .factorize_numeric_llt(
                    values,
                    matrix,
                    Side::Lower,
                    Default::default(),
                    Par::Seq,
                    stack,
                    Default::default(),
                )
                .err()
                .map(|PivotError::NonPositivePivot { index }| index),
            Kind::Ldlt => self
                .symbolic
                .factorize_numeric_ldlt(
                    values,
                    matrix,
                    Side::Lower,
                    Default::default(),
                    Par::Seq,
                    stack,
                    Default::default(),
                )
                .err()
                .map(|LdltError::ZeroPivot { index }| index),
        };
        match broken_at.or_else(|| self.first_bad_pivot()) {
            // The index counts within the permuted matrix.
            Some(k) => Err(PrepareError::NotPositiveDefinite {
                row: self.order[k.min(self.order.len() - 1)] as usize,
            }),
            None => Ok(()),
        }
    }

    /// L D L^T exists for indefinite matrices too, and NaN passes every comparison of a pivot with zero: look at the
    /// diagonal of what came out.
    fn first_bad_pivot(&self) -> Option<usize> {
        let bad = |d: &f64| d.is_nan() || *d <= 0.0;
        match self.symbolic.raw() {
            SymbolicCholeskyRaw::Simplicial(symbolic) => {
                (0..symbolic.nrows()).find(|&j| bad(&self.values[symbolic.col_ptr()[j] as usize]))
            }
            SymbolicCholeskyRaw::Supernodal(symbolic) => {
                let factor = SupernodalLdltRef::new(symbolic, &self.values);
                (0..symbolic.n_supernodes()).find_map(|s| {
                    let node = factor.supernode(s);
                    let panel = node.val();
                    (0..panel.ncols()).find(|&j| bad(&panel[(j, j)])).map(|j| node.start() + j)
                })
            }
        }
    }
}

impl Factor for FaerFactor {
    fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        let (n, k) = (self.pattern.n(), rhs.k());
        assert_eq!((rhs.n(), x.n(), x.k()), (n, n, k), "rhs, x: both must be n x k");
        x.data_mut().copy_from_slice(rhs.slice());
        let stack = MemStack::new(&mut self.memory);
        let block = MatMut::from_row_major_slice_mut(x.data_mut(), n, k);
        match self.kind {
            Kind::Llt => LltRef::new(&self.symbolic, &self.values).solve_in_place_with_conj(
                Conj::No,
                block,
                Par::Seq,
                stack,
            ),
            Kind::Ldlt => LdltRef::new(&self.symbolic, &self.values).solve_in_place_with_conj(
                Conj::No,
                block,
                Par::Seq,
                stack,
            ),
        }
        match x.data().iter().position(|v| !v.is_finite()) {
            Some(at) => Err(SolveError::NonFinite { row: at / k }),
            None => Ok(Solved::default()),
        }
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        self.pattern.values_mut().copy_from_slice(values);
        self.factorise(on)
    }

    fn permutation(&self) -> Option<&[u32]> {
        Some(&self.order)
    }

    fn footprint(&self) -> Footprint {
        let values = self.values.len() as u64 * 8;
        let indices = 4 * match self.symbolic.raw() {
            SymbolicCholeskyRaw::Simplicial(s) => (s.row_idx().len() + s.col_ptr().len()) as u64,
            SymbolicCholeskyRaw::Supernodal(s) => (s.row_idx().len() + 4 * s.n_supernodes()) as u64,
        };
        let matrix = self.pattern.stored() as u64 * 12 + self.pattern.n() as u64 * 12;
        Footprint {
            host_bytes: Some(values + indices + matrix + self.scratch_bytes),
            factor_nonzeros: Some(self.values.len() as u64),
            factor_bytes: Some(values + indices),
            bytes_per_solve: Some(2 * (values + indices)),
            ordering: Some(self.ordering),
            ..Footprint::default()
        }
    }
}
