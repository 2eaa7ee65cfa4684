//! Stiff rows: eliminated exactly, before any smoothing.
//!
//! In a needle two vertices, in a cap three, are tied together by weights far above those of the rest: there
//! a_ij^2 / (a_ii a_jj) nears 1, where a well-shaped mesh has 1/36. What such a group does as a whole is then all but
//! invisible to a smoother that moves one vertex at a time (its diagonal is that of the tie), and no coarse function is
//! stiff enough to keep the tie. Eliminating the stiffest vertex of each group leaves a Schur complement without the
//! tie. On a scan 0.3 to 2 per cent of the rows go, and a third of the iterations with them.
//!
//! With the eliminated rows V in order, A = (I + N) D (I + N)^T, D = diag(d_V) + S: a Cholesky factorisation (L D L^T) that
//! stops early. Here S keeps the numbering of A; its rows in V hold nothing but their pivot.

use super::rows::Rows;
use crate::backends::cg::operator::Csr;
use crate::backends::cg::workers::{Each, Workers};

/// Coupling above which a pair is stiff. A strip of thin triangles has 1/4 everywhere and must not go as a whole.
const STIFF: f64 = 0.3;
/// Most neighbours of a row that is eliminated: they all become neighbours of each other.
const MOST_NEIGHBOURS: usize = 12;
/// Rounds of looking for stiff pairs; an elimination may leave another one behind.
const ROUNDS: usize = 3;

/// A matrix from which rows are being eliminated.
struct Schur<'a> {
    base: Csr<'a>,
    /// Index into `rows` of each changed row.
    slot: Vec<u32>,
    rows: Vec<Vec<(u32, f64)>>,
    eliminated: Vec<bool>,
}

const UNCHANGED: u32 = u32::MAX;

impl<'a> Schur<'a> {
    fn new(base: Csr<'a>) -> Self {
        let n = base.n();
        Self { base, slot: vec![UNCHANGED; n], rows: Vec::new(), eliminated: vec![false; n] }
    }

    /// Couplings of row `i` as they are now, and its diagonal.
    fn row(&self, i: usize) -> impl Iterator<Item = (u32, f64)> + '_ {
        let changed = self.slot[i] != UNCHANGED;
        let own = if changed { &self.rows[self.slot[i] as usize][..] } else { &[] };
        let (columns, values) = if changed { (&[][..], &[][..]) } else { self.base.row(i) };
        own.iter().copied().chain(columns.iter().copied().zip(values.iter().copied()))
    }

    fn diagonal(&self, i: usize) -> f64 {
        self.row(i).find(|e| e.0 as usize == i).map_or(0.0, |e| e.1)
    }

    fn row_mut(&mut self, i: usize) -> &mut Vec<(u32, f64)> {
        if self.slot[i] == UNCHANGED {
            self.rows.push(self.row(i).collect());
            self.slot[i] = (self.rows.len() - 1) as u32;
        }
        &mut self.rows[self.slot[i] as usize]
    }

    /// Eliminates row `v`: a_ij -= a_iv a_vj / a_vv. Returns its couplings and its pivot.
    fn eliminate(&mut self, v: usize) -> (Vec<(u32, f64)>, f64) {
        let pivot = self.diagonal(v);
        let couplings: Vec<(u32, f64)> = self.row(v).filter(|e| e.0 as usize != v).collect();
        for &(i, a) in &couplings {
            let row = self.row_mut(i as usize);
            row.retain(|e| e.0 as usize != v);
            for &(j, b) in &couplings {
                let change = a * b / pivot;
                match row.iter_mut().find(|e| e.0 == j) {
                    Some(entry) => entry.1 -= change,
                    None => row.push((j, -change)),
                }
            }
        }
        *self.row_mut(v) = vec![(v as u32, pivot)];
        self.eliminated[v] = true;
        (couplings, pivot)
    }

    /// True where `v` is the stiffer end of a stiff pair.
    fn is_stiff(&self, v: usize, diagonal: &[f64]) -> bool {
        let d = diagonal[v];
        self.row(v).any(|(j, a)| {
            let e = diagonal[j as usize];
            j as usize != v && d >= e && a * a > STIFF * d * e
        })
    }

    fn finish(mut self) -> Rows<f64> {
        let n = self.base.n();
        let mut s = Rows::with_capacity(n, self.base.columns.len() + 8 * self.rows.len());
        for i in 0..n {
            if self.slot[i] == UNCHANGED {
                let (columns, values) = self.base.row(i);
                s.columns.extend_from_slice(columns);
                s.values.extend_from_slice(values);
            } else {
                let row = &mut self.rows[self.slot[i] as usize];
                row.sort_unstable_by_key(|e| e.0);
                row.iter().for_each(|&(j, a)| s.push(j, a));
            }
            s.end_row();
        }
        s
    }
}

/// Chooses the rows to eliminate, in order.
pub(crate) fn choose(workers: &mut Workers, a: Csr<'_>) -> Vec<u32> {
    let mut schur = Schur::new(a);
    let mut diagonal = a.diagonal();
    let mut order = Vec::new();
    let mut candidates = stiff_rows(workers, &schur, &diagonal);
    for _ in 0..ROUNDS {
        candidates.retain(|&v| !schur.eliminated[v as usize] && schur.is_stiff(v as usize, &diagonal));
        candidates.sort_by(|&v, &w| diagonal[w as usize].total_cmp(&diagonal[v as usize]).then(v.cmp(&w)));
        let mut next = Vec::new();
        for &v in &candidates {
            let v = v as usize;
            let neighbours = schur.row(v).count() - 1;
            if neighbours > MOST_NEIGHBOURS || diagonal[v] <= 0.0 || !schur.is_stiff(v, &diagonal) {
                continue;
            }
            for (j, _) in schur.eliminate(v).0 {
                diagonal[j as usize] = schur.diagonal(j as usize);
                next.push(j);
            }
            order.push(v as u32);
        }
        next.sort_unstable();
        next.dedup();
        candidates = next;
    }
    order
}

/// All rows that are the stiffer end of a stiff pair.
fn stiff_rows(workers: &mut Workers, schur: &Schur<'_>, diagonal: &[f64]) -> Vec<u32> {
    let strips = workers.strips(diagonal.len());
    let mut parts = vec![Vec::new(); strips.count()];
    workers.run(&strips, Each(&mut parts), |_, rows, part| {
        part.extend(rows.filter(|&v| schur.is_stiff(v, diagonal)).map(|v| v as u32));
    });
    parts.concat()
}

/// The factor of the eliminated rows, in f32.
pub(crate) struct Stiff {
    /// Eliminated rows, in order.
    order: Vec<u32>,
    /// -a_vj / d_v, one row for each of `order`; columns are rows of A.
    weights: Rows<f32>,
    /// Rows that the forward substitution changes.
    touched: Vec<u32>,
    /// What they held, W lanes each.
    saved: Vec<f32>,
}

impl Stiff {
    /// Eliminates the rows `order` of `a`; returns the factor and S.
    ///
    /// # Errors
    /// The row whose pivot is not positive.
    pub(crate) fn factor(a: Csr<'_>, order: Vec<u32>, width: usize) -> Result<(Self, Rows<f64>), usize> {
        let mut schur = Schur::new(a);
        let mut weights = Rows::with_capacity(order.len(), 6 * order.len());
        for &v in &order {
            let (couplings, pivot) = schur.eliminate(v as usize);
            if pivot.is_nan() || pivot <= 0.0 {
                return Err(v as usize);
            }
            couplings.iter().for_each(|&(j, a)| weights.push(j, (-a / pivot) as f32));
            weights.end_row();
        }
        let mut touched = weights.columns.clone();
        touched.sort_unstable();
        touched.dedup();
        let saved = vec![0.0; touched.len() * width];
        Ok((Self { order, weights, touched, saved }, schur.finish()))
    }

    /// The eliminated rows, to be eliminated again with other values.
    pub(crate) fn order(&self) -> &[u32] {
        &self.order
    }

    /// r := (I + N)^-1 r, so that S and the pivots can be solved with it.
    pub(crate) fn forward<const W: usize>(&mut self, r: &mut [[f32; W]]) {
        for (saved, &i) in self.saved.as_chunks_mut::<W>().0.iter_mut().zip(&self.touched) {
            *saved = r[i as usize];
        }
        for (at, &v) in self.order.iter().enumerate() {
            let (columns, weights) = self.weights.row(at);
            let value = r[v as usize];
            for (&j, &w) in columns.iter().zip(weights) {
                for c in 0..W {
                    r[j as usize][c] += w * value[c];
                }
            }
        }
    }

    /// z := (I + N)^-T z, and r as it was before [`forward`](Self::forward).
    pub(crate) fn backward<const W: usize>(&self, z: &mut [[f32; W]], r: &mut [[f32; W]]) {
        for (at, &v) in self.order.iter().enumerate().rev() {
            let (columns, weights) = self.weights.row(at);
            let mut value = z[v as usize];
            for (&j, &w) in columns.iter().zip(weights) {
                for c in 0..W {
                    value[c] += w * z[j as usize][c];
                }
            }
            z[v as usize] = value;
        }
        for (saved, &i) in self.saved.as_chunks::<W>().0.iter().zip(&self.touched) {
            r[i as usize] = *saved;
        }
    }

    /// Entries and bytes.
    pub(crate) fn size(&self) -> (usize, usize) {
        (self.weights.entries(), self.weights.bytes() + 4 * (self.order.len() + self.touched.len()))
    }
}
