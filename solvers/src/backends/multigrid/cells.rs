//! Cells: every row joins the nearest of some sample rows. The samples are the unknowns of the next level.
//!
//! Distance is counted in strong couplings (the graph Voronoi cells of the samples; Vanek, Mandel and Brezina 1996 call
//! them aggregates). Strong couplings follow short edges, so that thin triangles are gathered across, as the smoother
//! wants it: it evens out an error along strong couplings only.

use super::filter::Filtered;

/// Mark of a row in no cell: it couples to nothing strongly, smoothing alone solves it.
pub(crate) const NONE: u32 = u32::MAX;

/// A partition of the rows.
pub(crate) struct Cells {
    /// Cell of each row, or [`NONE`].
    pub(crate) owner: Vec<u32>,
    /// The row each cell grew from; cells are numbered in the order of their samples, all but a few ascending.
    pub(crate) samples: Vec<u32>,
}

impl Cells {
    /// Samples every row whose strong neighbours are all free, and gives it those; what is left joins the neighbouring
    /// cell that it couples to most, or makes a cell of its own. About one row in seven of a mesh becomes a sample.
    pub(crate) fn new(f: &Filtered) -> Self {
        let n = f.diagonal.len();
        let mut cells = Self { owner: vec![NONE; n], samples: Vec::new() };
        for i in 0..n {
            let neighbours = f.row(i).0;
            let free = |&j: &u32| cells.owner[j as usize] == NONE;
            if cells.owner[i] == NONE && !neighbours.is_empty() && neighbours.iter().all(free) {
                cells.add(i, neighbours);
            }
        }
        let first = cells.owner.clone();
        for i in 0..n {
            if first[i] == NONE {
                cells.owner[i] = strongest(f, i, &first);
            }
        }
        for i in 0..n {
            if cells.owner[i] == NONE && !f.row(i).0.is_empty() {
                cells.add(i, f.row(i).0);
            }
        }
        cells
    }

    /// A new cell of `sample` and those of its `neighbours` that are free.
    fn add(&mut self, sample: usize, neighbours: &[u32]) {
        let cell = self.samples.len() as u32;
        self.samples.push(sample as u32);
        self.owner[sample] = cell;
        for &j in neighbours {
            if self.owner[j as usize] == NONE {
                self.owner[j as usize] = cell;
            }
        }
    }

    /// Number of cells.
    pub(crate) fn count(&self) -> usize {
        self.samples.len()
    }
}

/// The cell that the couplings of row `i` add up to most for; NONE where no neighbour has one.
fn strongest(f: &Filtered, i: usize, owner: &[u32]) -> u32 {
    let (columns, strengths) = f.row(i);
    let mut best = (NONE, 0.0);
    for &j in columns {
        let cell = owner[j as usize];
        if cell == NONE || cell == best.0 {
            continue;
        }
        let inside = columns.iter().zip(strengths).filter(|(k, _)| owner[**k as usize] == cell);
        let total = inside.map(|(_, s)| s).sum();
        if total > best.1 {
            best = (cell, total);
        }
    }
    best.0
}
