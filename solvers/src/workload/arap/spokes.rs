//! The edges at every vertex, and what an iteration computes from them: covariances, rotations, right-hand side.
//!
//! Bytes per vertex of a closed surface (6 spokes of 12 bytes): covariances 72 + 4 + 7 x 64 (two positions, mostly from cache),
//! right-hand side 72 + 4 + 7 x 64 again; 22 MB of spokes in all at 150K vertices. Flops: 24 per spoke for covariances, 36 for
//! the right-hand side, about 150 per Newton step.

use super::polar::{Block, Fit, LANES};
use crate::isa::{Features, Isa, Kernel, multiply_add};
use crate::sparse::SymmetricCsr;
use std::ops::Range;

/// A point in four lanes; the last one is 0.
pub type Padded = [f64; 4];

/// A rotation, stored so that applying it costs the least: sqrt(2) x a unit quaternion (w, u), for which
/// R c = c + w (u x c) + u x (u x c).
pub type Turn = [f64; 4];

/// The turn by nothing.
pub const NO_TURN: Turn = [std::f64::consts::SQRT_2, 0.0, 0.0, 0.0];

/// Spokes by vertices: neighbours with the weights of their edges.
#[derive(Clone, Debug)]
pub struct Spokes {
    isa: Isa,
    starts: Vec<u32>,
    neighbours: Vec<u32>,
    weights: Vec<f64>,
    /// Reference positions.
    rest: Vec<Padded>,
}

impl Spokes {
    /// The off-diagonal entries of `laplacian` (both triangles) as spokes, w_ij = -L_ij.
    pub fn new(laplacian: &SymmetricCsr, rest: &[[f64; 3]]) -> Self {
        let full = laplacian.full_pattern();
        let (mut starts, mut neighbours, mut weights) = (vec![0], Vec::new(), Vec::new());
        for v in 0..laplacian.n() {
            for entry in full.starts[v] as usize..full.starts[v + 1] as usize {
                if full.columns[entry] as usize != v {
                    neighbours.push(full.columns[entry]);
                    weights.push(-laplacian.values()[full.source[entry] as usize]);
                }
            }
            starts.push(neighbours.len() as u32);
        }
        let rest = rest.iter().map(|&[x, y, z]| [x, y, z, 0.0]).collect();
        Self { isa: Isa::best(), starts, neighbours, weights, rest }
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.rest.len()
    }

    /// Reference positions.
    pub fn rest(&self) -> &[Padded] {
        &self.rest
    }

    /// Start of the spokes of every vertex; n + 1.
    pub fn starts(&self) -> &[u32] {
        &self.starts
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        4 * (self.starts.len() + self.neighbours.len()) + 8 * self.weights.len() + 32 * self.rest.len()
    }

    /// The local step for vertices `range`: the rotations that fit the spokes of `positions` best, starting from those in
    /// `turns` (of the range alone) and replacing them.
    pub fn fit(&self, positions: &[Padded], range: Range<usize>, turns: &mut [Turn]) {
        self.isa.run(FitAll { spokes: self, positions, range, turns });
    }

    /// b_v = sum_j w_vj / 2 (R_v + R_j) (p_v - p_j) for one vertex after the other, handed to `put`.
    pub fn gather(&self, turns: &[Turn], vertices: &[u32], rows: &mut [[f64; 3]]) {
        self.isa.run(Gather { spokes: self, turns, vertices, rows });
    }

    fn at(&self, v: usize) -> impl Iterator<Item = (usize, f64)> {
        let range = self.starts[v] as usize..self.starts[v + 1] as usize;
        self.neighbours[range.clone()].iter().map(|&j| j as usize).zip(self.weights[range].iter().copied())
    }

    /// sum_ij w_ij |x_i - x_j - R_i (p_i - p_j)|^2 over all spokes: what the iterations lower where no weight is negative.
    pub fn energy(&self, positions: &[Padded], turns: &[Turn]) -> f64 {
        let mut sum = 0.0;
        for v in 0..self.vertices() {
            for (j, w) in self.at(v) {
                let (e, x) =
                    (difference(&self.rest[v], &self.rest[j]), difference(&positions[v], &positions[j]));
                let r = turn(&turns[v], e);
                sum += w * (0..3).map(|i| (x[i] - r[i]).powi(2)).sum::<f64>();
            }
        }
        sum
    }
}

struct FitAll<'a> {
    spokes: &'a Spokes,
    positions: &'a [Padded],
    range: Range<usize>,
    turns: &'a mut [Turn],
}

impl Kernel for FitAll<'_> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let mut block = Block::default();
        let first = self.range.start;
        for (chunk, turns) in self.turns.chunks_mut(LANES).enumerate() {
            for (l, turn) in turns.iter().enumerate() {
                let s = covariance::<F>(self.spokes, self.positions, first + chunk * LANES + l);
                for i in 0..3 {
                    for j in 0..3 {
                        block.s[3 * i + j][l] = s[i][j];
                    }
                }
                (0..4).for_each(|c| block.q[c][l] = turn[c] * std::f64::consts::FRAC_1_SQRT_2);
            }
            for l in turns.len()..LANES {
                // Nothing to fit: the lane repeats the first one.
                (0..9).for_each(|e| block.s[e][l] = block.s[e][0]);
                (0..4).for_each(|c| block.q[c][l] = block.q[c][0]);
            }
            Fit(&mut block).run::<F>();
            for (l, turn) in turns.iter_mut().enumerate() {
                *turn = std::array::from_fn(|c| block.q[c][l] * std::f64::consts::SQRT_2);
            }
        }
    }
}

/// sum_j w (p_v - p_j) (x_v - x_j)^T, rows padded.
#[inline(always)]
fn covariance<F: Features>(spokes: &Spokes, positions: &[Padded], v: usize) -> [Padded; 3] {
    let (p, x) = (spokes.rest[v], positions[v]);
    let mut sum = [[0.0; 4]; 3];
    for (j, w) in spokes.at(v) {
        let (q, y) = (&spokes.rest[j], &positions[j]);
        let e: Padded = std::array::from_fn(|c| w * (p[c] - q[c]));
        let d: Padded = std::array::from_fn(|c| x[c] - y[c]);
        for (row, e) in sum.iter_mut().zip(e) {
            *row = std::array::from_fn(|c| multiply_add::<F, f64>(e, d[c], row[c]));
        }
    }
    sum
}

struct Gather<'a> {
    spokes: &'a Spokes,
    turns: &'a [Turn],
    vertices: &'a [u32],
    rows: &'a mut [[f64; 3]],
}

impl Kernel for Gather<'_> {
    type Output = ();

    #[inline(always)]
    fn run<F: Features>(self) {
        let Self { spokes, turns, .. } = self;
        for (row, &v) in self.rows.iter_mut().zip(self.vertices) {
            let v = v as usize;
            let p = &spokes.rest[v];
            // R_v is common to all spokes of v: it turns their sum.
            let (mut own, mut others) = ([0.0; 3], [0.0; 3]);
            for (j, w) in spokes.at(v) {
                let e = difference(p, &spokes.rest[j]).map(|x| 0.5 * w * x);
                let r = turn(&turns[j], e);
                for i in 0..3 {
                    own[i] += e[i];
                    others[i] += r[i];
                }
            }
            let own = turn(&turns[v], own);
            *row = std::array::from_fn(|i| own[i] + others[i]);
        }
    }
}

#[inline(always)]
fn difference(a: &Padded, b: &Padded) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// R c of a [`Turn`].
#[inline(always)]
fn turn(&[w, x, y, z]: &Turn, c: [f64; 3]) -> [f64; 3] {
    let cross = |a: [f64; 3]| [y * a[2] - z * a[1], z * a[0] - x * a[2], x * a[1] - y * a[0]];
    let s = cross(c);
    let r = cross(s);
    std::array::from_fn(|i| c[i] + (w * s[i] + r[i]))
}
