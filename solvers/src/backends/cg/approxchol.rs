//! Approximate Cholesky by random elimination (Kyng and Sachdeva 2016; Gao, Kyng and Spielman 2023).
//!
//! Eliminating a vertex of a weighted graph replaces its star (weights w_1 .. w_d, sum W) by a clique of weights
//! w_i w_j / W. Here each star of d edges is replaced by d - 1 sampled ones instead, of the same expectation: with the
//! neighbours in ascending order of weight, number i is joined to j > i with probability w_j / S_i, S_i = sum over k > i of w_k,
//! by an edge of weight w_i S_i / W. So the factor stays as sparse as A. Vertices go in the order of their current
//! degrees. Random numbers come from a fixed seed: the factor is the same in every run.
//!
//! The graph is A with positive off-diagonals lumped into the diagonal; what a row sums to is an edge to the ground. The right
//! choice where weights vary wildly but are all of one sign (intrinsic Delaunay or clamped Laplacians, graphs); caps with
//! large positive off-diagonals are outside of what it can see, and there `cg-multigrid` is better.

use super::operator::Csr;
use super::preconditioner::{AnyPreconditioner, Budget, Preconditioner, Size};
use super::workers::Workers;
use crate::backends::multigrid::rows::Rows;
use crate::error::PrepareError;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// The approximate factor: M = L D L^T, unit diagonals.
pub(crate) struct ApproximateCholesky {
    /// Eliminated vertices, in order.
    order: Vec<u32>,
    /// For each of `order`, its neighbours at that time and w_i / W.
    columns: Rows<f64>,
    /// 1 / W.
    inverse: Vec<f64>,
}

/// Marsaglia's xorshift64* (Vigna 2016).
struct Random(u64);

impl Random {
    /// Uniform in [0, 1).
    fn unit(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1u64 << 53) as f64
    }
}

impl ApproximateCholesky {
    /// Eliminates all vertices of the graph of `a`.
    pub(crate) fn new(a: Csr<'_>) -> Self {
        let n = a.n();
        let (mut edges, mut ground) = graph(a);
        let mut queue: BinaryHeap<_> = (0..n).map(|v| Reverse((edges[v].len(), v as u32))).collect();
        let mut gone = vec![false; n];
        let mut random = Random(0x9E37_79B9_7F4A_7C15);
        let mut factor = Self {
            order: Vec::with_capacity(n),
            columns: Rows::with_capacity(n, a.columns.len()),
            inverse: Vec::with_capacity(n),
        };
        while let Some(Reverse((degree, v))) = queue.pop() {
            if gone[v as usize] {
                continue;
            }
            let mut star = std::mem::take(&mut edges[v as usize]);
            merge(&mut star, &gone);
            if star.len() > degree {
                queue.push(Reverse((star.len(), v))); // it has grown since it was queued
                edges[v as usize] = star;
                continue;
            }
            gone[v as usize] = true;
            let to_ground = ground[v as usize];
            let total = to_ground + star.iter().map(|e| e.1).sum::<f64>();
            // The last vertex of a component without ground: any positive pivot makes M definite.
            let total = if total > 0.0 { total } else { 1.0 };
            factor.order.push(v);
            factor.inverse.push(1.0 / total);
            star.iter().for_each(|&(u, w)| factor.columns.push(u, w / total));
            factor.columns.end_row();
            // The clique with the ground is exact: it costs no edges.
            star.iter().for_each(|&(u, w)| ground[u as usize] += w * to_ground / total);
            sample(&star, total, &mut random, |u, t, w| {
                edges[u as usize].push((t, w));
                edges[t as usize].push((u, w));
            });
        }
        factor
    }
}

/// Weights -a_ij > 0 by rows, and what each row sums to.
fn graph(a: Csr<'_>) -> (Vec<Vec<(u32, f64)>>, Vec<f64>) {
    let row = |i: usize| {
        let (columns, values) = a.row(i);
        let negative = columns.iter().zip(values).filter(|(j, v)| **j as usize != i && **v < 0.0);
        let ground = values.iter().sum::<f64>();
        (negative.map(|(&j, &v)| (j, -v)).collect(), ground.max(0.0))
    };
    (0..a.n()).map(row).unzip()
}

/// Drops eliminated neighbours, adds up parallel edges, and sorts by weight.
fn merge(star: &mut Vec<(u32, f64)>, gone: &[bool]) {
    star.retain(|e| !gone[e.0 as usize]);
    star.sort_by_key(|e| e.0);
    star.dedup_by(|later, first| {
        let same = later.0 == first.0;
        if same {
            first.1 += later.1;
        }
        same
    });
    star.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
}

/// Calls `add` with the sampled edges of a star in ascending order of weight.
fn sample(star: &[(u32, f64)], total: f64, random: &mut Random, mut add: impl FnMut(u32, u32, f64)) {
    let mut rest: f64 = star.iter().map(|e| e.1).sum();
    for (i, &(u, w)) in star.iter().enumerate() {
        rest -= w;
        let others = &star[i + 1..];
        if others.is_empty() || rest <= 0.0 {
            return;
        }
        let mut target = random.unit() * rest;
        let pick = others.iter().position(|e| {
            target -= e.1;
            target < 0.0
        });
        let partner = others[pick.unwrap_or(others.len() - 1)].0;
        add(u, partner, w * rest / total);
    }
}

impl<const W: usize> Preconditioner<f64, W> for ApproximateCholesky {
    /// Forwards, scaled, and backwards: 4 W flops and 24 bytes per entry of the factor.
    fn apply(&mut self, _: &mut Workers, r: &mut [[f64; W]], z: &mut [[f64; W]]) {
        z.copy_from_slice(r);
        for (at, &v) in self.order.iter().enumerate() {
            let (columns, values) = self.columns.row(at);
            let value = z[v as usize];
            for (&u, &l) in columns.iter().zip(values) {
                let z = &mut z[u as usize];
                (0..W).for_each(|c| z[c] += l * value[c]);
            }
            z[v as usize] = value.map(|x| x * self.inverse[at]);
        }
        for (at, &v) in self.order.iter().enumerate().rev() {
            let (columns, values) = self.columns.row(at);
            let mut value = z[v as usize];
            for (&u, &l) in columns.iter().zip(values) {
                let z = &z[u as usize];
                (0..W).for_each(|c| value[c] += l * z[c]);
            }
            z[v as usize] = value;
        }
    }
}

impl AnyPreconditioner<f64> for ApproximateCholesky {
    /// Which edges are sampled depends on the weights: all of it is done again.
    fn update(&mut self, _: &mut Workers, a: Csr<'_>) -> Result<(), PrepareError> {
        *self = Self::new(a);
        Ok(())
    }

    fn budget(&self) -> Budget {
        Budget::SIMPLE
    }

    fn size(&self) -> Size {
        let (entries, n) = (self.columns.entries(), self.order.len());
        Size { entries: (entries + n) as u64, bytes: (self.columns.bytes() + 12 * n) as u64 }
    }
}
