//! Interpolation P from the cells of one level to its rows.

use super::cells::{Cells, NONE};
use super::filter::Filtered;
use super::rows::Rows;
use crate::backends::cg::operator::Csr;
use crate::backends::cg::workers::Workers;
use crate::vector::{Vector, dot, sub};
use std::ops::Range;

/// Damping of the Jacobi step: 4/3 over the bound 2 on the eigenvalues of D^-1 F (Vanek, Mandel and Brezina 1996).
const DAMPING: f64 = 2.0 / 3.0;

/// Smoothed aggregation: P = (I - omega D^-1 F) T, T constant on cells. Two to three entries per row.
pub(crate) fn smoothed(workers: &mut Workers, f: &Filtered, cells: &Cells) -> Rows<f32> {
    workers.rows(cells.owner.len(), |rows| smoothed_strip(f, cells, rows))
}

fn smoothed_strip(f: &Filtered, cells: &Cells, rows: Range<usize>) -> Rows<f32> {
    let mut p = Rows::with_capacity(rows.len(), 3 * rows.len());
    for i in rows {
        let start = p.entries();
        if cells.owner[i] != NONE {
            p.push(cells.owner[i], (1.0 - DAMPING) as f32);
        }
        let (columns, strengths) = f.row(i);
        for (&j, &strength) in columns.iter().zip(strengths) {
            let weight = (DAMPING * strength / f.diagonal[i]) as f32;
            let cell = cells.owner[j as usize];
            if cell == NONE {
                continue;
            }
            match p.columns[start..].iter().position(|&c| c == cell) {
                Some(at) => p.values[start + at] += weight,
                None => p.push(cell, weight),
            }
        }
        p.end_row();
    }
    p
}

/// Barycentric interpolation: each row from the corners of the triangle of neighbouring samples nearest to it, among those
/// with the sample of its own cell. At most three entries per row; weights are positive and add up to 1.
/// `positions`: one point per row.
pub(crate) fn barycentric(
    workers: &mut Workers,
    a: Csr<'_>,
    cells: &Cells,
    positions: &[Vector],
) -> Rows<f32> {
    let n = cells.owner.len();
    let sample: Vec<Vector> = cells.samples.iter().map(|&s| positions[s as usize]).collect();
    let members = members(cells);
    let adjacent = workers.rows(cells.count(), |range| adjacency(a, cells, &members, range));
    // Cell by cell, so that its triangles are there for all its members.
    let by_cell = workers.rows(cells.count(), |range| {
        let mut found = Rows::with_capacity(n / cells.count() * range.len(), 0);
        let mut triangles = Triangles::default();
        for cell in range {
            triangles.around(cell, &adjacent, &sample);
            for &i in members.row(cell).0 {
                let offset = sub(positions[i as usize], sample[cell]);
                let (corners, weights) = triangles.nearest(cell as u32, offset);
                for (&corner, &weight) in corners.iter().zip(&weights) {
                    if corner != NONE && weight > 0.0 {
                        found.push(corner, weight as f32);
                    }
                }
                found.end_row();
            }
        }
        found
    });
    let mut place = vec![NONE; n];
    members.columns.iter().enumerate().for_each(|(at, &i)| place[i as usize] = at as u32);
    workers.rows(n, |range| {
        let mut p = Rows::with_capacity(range.len(), 3 * range.len());
        for &at in &place[range] {
            if at != NONE {
                let (corners, weights) = by_cell.row(at as usize);
                p.columns.extend_from_slice(corners);
                p.values.extend_from_slice(weights);
            }
            p.end_row();
        }
        p
    })
}

/// The rows of every cell.
fn members(cells: &Cells) -> Rows<f32> {
    let n = cells.owner.len();
    let mut owner = Rows::with_capacity(n, n);
    for &cell in &cells.owner {
        if cell != NONE {
            owner.push(cell, 0.0);
        }
        owner.end_row();
    }
    owner.transpose(cells.count())
}

/// Neighbouring cells of the cells `range`: those that share an entry of `a`.
fn adjacency(a: Csr<'_>, cells: &Cells, members: &Rows<f32>, range: Range<usize>) -> Rows<f32> {
    let mut adjacent = Rows::with_capacity(range.len(), 8 * range.len());
    let mut seen = vec![NONE; cells.count()];
    for cell in range {
        let cell = cell as u32;
        seen[cell as usize] = cell;
        for &i in members.row(cell as usize).0 {
            for &j in a.row(i as usize).0 {
                let other = cells.owner[j as usize];
                if other != NONE && seen[other as usize] != cell {
                    seen[other as usize] = cell;
                    adjacent.push(other, 0.0);
                }
            }
        }
        adjacent.end_row();
    }
    adjacent
}

/// The triangles of samples around one sample, relative to it.
#[derive(Default)]
struct Triangles {
    /// Two further corners, the edges to them, and the inner products uu, uv, vv.
    list: Vec<([u32; 2], [Vector; 2], [f64; 3])>,
    /// Neighbours, for cells without triangles.
    edges: Vec<(u32, Vector)>,
}

impl Triangles {
    fn around(&mut self, cell: usize, adjacent: &Rows<f32>, sample: &[Vector]) {
        self.list.clear();
        self.edges.clear();
        let neighbours = adjacent.row(cell).0;
        for &a in neighbours {
            let u = sub(sample[a as usize], sample[cell]);
            self.edges.push((a, u));
            for &b in adjacent.row(a as usize).0 {
                if b > a && neighbours.contains(&b) {
                    let v = sub(sample[b as usize], sample[cell]);
                    self.list.push(([a, b], [u, v], [dot(u, u), dot(u, v), dot(v, v)]));
                }
            }
        }
    }

    /// Corners and barycentric weights of the point nearest to `q` on any of the triangles (or edges, where there are none).
    fn nearest(&self, cell: u32, q: Vector) -> ([u32; 3], [f64; 3]) {
        let mut best = (dot(q, q), [cell, NONE, NONE], [1.0, 0.0, 0.0]);
        if best.0 == 0.0 {
            return (best.1, best.2); // the sample itself
        }
        let mut offer = |a: (u32, Vector, f64), b: (u32, Vector, f64)| {
            let off: Vector = std::array::from_fn(|i| a.2 * a.1[i] + b.2 * b.1[i] - q[i]);
            let distance = dot(off, off);
            if distance < best.0 {
                best = (distance, [cell, a.0, b.0], [1.0 - a.2 - b.2, a.2, b.2]);
            }
        };
        for &([a, b], [u, v], products) in &self.list {
            let (s, t) = closest(products, dot(q, u), dot(q, v));
            offer((a, u, s), (b, v, t));
        }
        if self.list.is_empty() {
            for &(a, u) in &self.edges {
                offer((a, u, ratio(dot(q, u), dot(u, u))), (NONE, u, 0.0));
            }
        }
        (best.1, best.2)
    }
}

/// x / y within [0, 1]; 0 for 0 / 0.
fn ratio(x: f64, y: f64) -> f64 {
    if y > 0.0 { (x / y).clamp(0.0, 1.0) } else { 0.0 }
}

/// (s, t) with s u + t v nearest to q on the triangle 0, u, v, from its inner products.
fn closest([uu, uv, vv]: [f64; 3], qu: f64, qv: f64) -> (f64, f64) {
    let determinant = uu * vv - uv * uv;
    if determinant > 0.0 {
        let (s, t) = ((qu * vv - qv * uv) / determinant, (qv * uu - qu * uv) / determinant);
        if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
            return (s, t);
        }
    }
    // Outside: the nearest point is on an edge. |s u + t v - q|^2 - |q|^2 decides which one.
    let far = ratio(qu - qv - uv + vv, uu - 2.0 * uv + vv);
    let candidates = [(ratio(qu, uu), 0.0), (0.0, ratio(qv, vv)), (far, 1.0 - far)];
    let excess = |&(s, t): &(f64, f64)| s * s * uu + 2.0 * s * t * uv + t * t * vv - 2.0 * (s * qu + t * qv);
    candidates.into_iter().min_by(|a, b| excess(a).total_cmp(&excess(b))).expect("three candidates")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_points_of_a_triangle() {
        let products = [1.0, 0.0, 1.0]; // the unit right triangle
        let at = |x: f64, y: f64| closest(products, x, y);
        assert_eq!(at(0.25, 0.5), (0.25, 0.5));
        assert_eq!(at(0.5, -3.0), (0.5, 0.0));
        assert_eq!(at(-1.0, -1.0), (0.0, 0.0));
        assert_eq!(at(1.0, 1.0), (0.5, 0.5));
        assert_eq!(at(-2.0, 7.0), (0.0, 1.0));
        assert_eq!(closest([1.0, 2.0, 4.0], 0.5, 1.0), (0.5, 0.0)); // a flat one: u = v / 2
    }
}
