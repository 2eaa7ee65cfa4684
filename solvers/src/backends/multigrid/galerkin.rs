//! Coarse matrices A_c = P^T A P.

use super::rows::Rows;
use crate::backends::cg::operator::Csr;
use crate::backends::cg::workers::Workers;
use std::ops::Range;

/// P^T A P by rows, columns ascending; `r` is P^T. About 45 multiplications per fine row of a mesh.
pub(crate) fn product(workers: &mut Workers, a: Csr<'_>, p: &Rows<f32>, r: &Rows<f32>) -> Rows<f64> {
    workers.rows(r.n(), |rows| strip(a, p, r, rows))
}

/// Rows `rows` of P^T A P.
fn strip(a: Csr<'_>, p: &Rows<f32>, r: &Rows<f32>, rows: Range<usize>) -> Rows<f64> {
    const FREE: u32 = u32::MAX;
    let mut slot = vec![FREE; r.n()];
    let mut c = Rows::with_capacity(rows.len(), 16 * rows.len());
    let mut row: Vec<(u32, f64)> = Vec::new();
    for big in rows {
        let (fine, weights) = r.row(big);
        for (&i, &w) in fine.iter().zip(weights) {
            let (columns, values) = a.row(i as usize);
            for (&j, &v) in columns.iter().zip(values) {
                let wv = f64::from(w) * v;
                let (targets, shares) = p.row(j as usize);
                for (&t, &s) in targets.iter().zip(shares) {
                    let at = &mut slot[t as usize];
                    if *at == FREE {
                        *at = row.len() as u32;
                        row.push((t, 0.0));
                    }
                    row[*at as usize].1 += wv * f64::from(s);
                }
            }
        }
        row.iter().for_each(|&(t, _)| slot[t as usize] = FREE);
        row.sort_unstable_by_key(|e| e.0);
        row.drain(..).for_each(|(t, v)| c.push(t, v));
        c.end_row();
    }
    c
}
