//! A backend of your own, in one file: an envelope ("skyline") Cholesky factorisation.
//!
//! `cargo run --release -p lapsolve --example own_backend` checks it against the contract, as your test should:
//! `assert!(lapsolve::conformance::check(&ENTRY).unwrap().is_empty())`.
//! A built-in backend is this same file under `src/backends/` plus its row in `src/registry.rs`.

use lapsolve::backend::{Backend, Description, Factor, Footprint, Phase, PrepareOptions, Solved};
use lapsolve::columns::Columns;
use lapsolve::error::{PrepareError, SolveError, Unavailable};
use lapsolve::registry::{Accuracy, Entry, Family, OpenOptions, Precision};
use lapsolve::sparse::SymmetricCsr;
use lapsolve::system::System;

/// The registry row: static facts, and how to open the backend.
pub const ENTRY: Entry = Entry {
    id: "envelope",
    family: Family::Direct,
    precision: Precision::F64,
    accuracy: Accuracy::Direct,
    licence: "MIT OR Apache-2.0",
    warm_start: false,
    max_unknowns: None,
    open: |_: &OpenOptions<'_>| -> Result<Box<dyn Backend>, Unavailable> { Ok(Box::new(Envelope)) },
};

struct Envelope;

impl Backend for Envelope {
    fn describe(&self) -> Description {
        Description::cpu(1)
    }

    fn prepare(
        &self,
        system: &System,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Factor>, PrepareError> {
        on(Phase::Order);
        let order = options.order.map_or_else(|| (0..system.n() as u32).collect(), <[u32]>::to_vec);
        let (matrix, source) = system.matrix().permuted(&order);
        on(Phase::Symbolic);
        let mut factor = EnvelopeFactor::new(order, matrix, source, options.max_columns);
        on(Phase::Numeric);
        factor.factorise()?;
        Ok(Box::new(factor))
    }
}

/// L with P A P^T = L L^T: row i is stored from its first entry `first[i]` to the diagonal, gaps included.
struct EnvelopeFactor {
    order: Vec<u32>,
    matrix: SymmetricCsr,
    source: Vec<u32>,
    first: Vec<usize>,
    /// `l[start[i] + j - first[i]]` is l_ij.
    start: Vec<usize>,
    l: Vec<f64>,
    work: Vec<f64>,
}

impl EnvelopeFactor {
    fn new(order: Vec<u32>, matrix: SymmetricCsr, source: Vec<u32>, max_columns: usize) -> Self {
        let n = matrix.n();
        let mut first: Vec<usize> = (0..n).collect();
        for i in 0..n {
            for &j in matrix.row(i).0 {
                first[j as usize] = first[j as usize].min(i);
            }
        }
        let mut start = vec![0];
        for i in 0..n {
            start.push(start[i] + i - first[i] + 1);
        }
        let l = vec![0.0; start[n]];
        Self { order, matrix, source, first, start, l, work: vec![0.0; n * max_columns] }
    }

    /// Row i of the envelope, from column `first[i]` to the diagonal.
    fn row(&self, i: usize) -> &[f64] {
        &self.l[self.start[i]..self.start[i + 1]]
    }

    /// l_ij = (a_ij - sum_k l_ik l_jk) / l_jj row by row, sums over the overlap of the two rows.
    fn factorise(&mut self) -> Result<(), PrepareError> {
        self.l.fill(0.0);
        for j in 0..self.matrix.n() {
            let (rows, values) = self.matrix.row(j);
            for (&i, &a) in rows.iter().zip(values) {
                let i = i as usize;
                self.l[self.start[i] + j - self.first[i]] = a;
            }
        }
        for i in 0..self.matrix.n() {
            for j in self.first[i]..=i {
                self.l[self.start[i] + j - self.first[i]] = self.entry(i, j)?;
            }
        }
        Ok(())
    }

    /// l_ij, once all earlier entries of rows i and j are known.
    fn entry(&self, i: usize, j: usize) -> Result<f64, PrepareError> {
        let from = self.first[i].max(self.first[j]);
        let overlap = |row: usize| &self.row(row)[from - self.first[row]..j - self.first[row]];
        let known: f64 = overlap(i).iter().zip(overlap(j)).map(|(x, y)| x * y).sum();
        let value = self.row(i)[j - self.first[i]] - known;
        let row = self.order[i] as usize;
        match value {
            v if j < i => Ok(v / self.pivot(j)),
            v if !v.is_finite() => Err(PrepareError::NonFinite { row }),
            v if v <= 0.0 => Err(PrepareError::NotPositiveDefinite { row }),
            v => Ok(v.sqrt()),
        }
    }

    fn pivot(&self, i: usize) -> f64 {
        self.l[self.start[i + 1] - 1]
    }

    /// L y = b forwards and L^T x = y backwards, in place, for k columns.
    fn sweep(&self, y: &mut [f64], k: usize) {
        let n = self.matrix.n();
        for i in 0..n {
            for c in 0..k {
                let known: f64 =
                    (self.first[i]..i).map(|j| self.row(i)[j - self.first[i]] * y[j * k + c]).sum();
                y[i * k + c] = (y[i * k + c] - known) / self.pivot(i);
            }
        }
        for i in (0..n).rev() {
            for c in 0..k {
                y[i * k + c] /= self.pivot(i);
                for j in self.first[i]..i {
                    y[j * k + c] -= self.row(i)[j - self.first[i]] * y[i * k + c];
                }
            }
        }
    }
}

impl Factor for EnvelopeFactor {
    fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        let k = rhs.k();
        let mut y = std::mem::take(&mut self.work); // moved out and back: no allocation
        for (i, &row) in self.order.iter().enumerate() {
            y[i * k..][..k].copy_from_slice(rhs.row(row as usize));
        }
        self.sweep(&mut y, k);
        for (i, &row) in self.order.iter().enumerate() {
            x.row_mut(row as usize).copy_from_slice(&y[i * k..][..k]);
        }
        self.work = y;
        match x.data().iter().position(|v| !v.is_finite()) {
            Some(at) => Err(SolveError::NonFinite { row: at / k }),
            None => Ok(Solved::default()),
        }
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        on(Phase::Numeric);
        for (value, &entry) in self.matrix.values_mut().iter_mut().zip(&self.source) {
            *value = values[entry as usize];
        }
        self.factorise()
    }

    fn permutation(&self) -> Option<&[u32]> {
        Some(&self.order)
    }

    fn footprint(&self) -> Footprint {
        let bytes = self.l.len() as u64 * 8;
        Footprint {
            host_bytes: Some(bytes + (self.work.len() * 8 + self.matrix.stored() * 16) as u64),
            factor_nonzeros: Some(self.l.len() as u64),
            factor_bytes: Some(bytes),
            bytes_per_solve: Some(2 * bytes),
            ordering: Some("natural or given"),
            ..Footprint::default()
        }
    }
}

fn main() {
    let violations = lapsolve::conformance::check(&ENTRY).expect("nothing can be missing");
    for violation in &violations {
        eprintln!("{violation}");
    }
    println!("{}: {} violation(s) of the contract", ENTRY.id, violations.len());
    std::process::exit(i32::from(!violations.is_empty()));
}
