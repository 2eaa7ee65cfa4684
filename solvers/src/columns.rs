//! `Columns`: a checked view of an n x k block of numbers, vertex-major.

/// An n x k block: row `i` (the k numbers of vertex i) lies together at `data[i * k .. (i + 1) * k]`.
///
/// That is how positions lie in memory and what vector units want. `Columns<&[f64]>` is `Copy` and read-only;
/// `Columns<&mut [f64]>` is written to and can be [`reborrow`](Columns::reborrow)ed. Right-hand sides and unknowns
/// of every solve in this crate have this form, always in f64.
#[derive(Clone, Copy, Debug)]
pub struct Columns<D> {
    data: D,
    n: usize,
    k: usize,
}

impl<D: AsRef<[f64]>> Columns<D> {
    /// Views `data` as n rows of k columns.
    ///
    /// # Panics
    /// If `k` is 0 or `data` does not hold exactly n * k numbers.
    pub fn new(data: D, n: usize, k: usize) -> Self {
        assert!(k > 0, "k: a block needs at least one column");
        let length = data.as_ref().len();
        assert_eq!(Some(length), n.checked_mul(k), "data: {length} numbers are not {n} rows of {k} columns");
        Self { data, n, k }
    }

    /// Number of rows n.
    pub fn n(&self) -> usize {
        self.n
    }

    /// Number of columns k.
    pub fn k(&self) -> usize {
        self.k
    }

    /// All n * k numbers, row after row.
    pub fn data(&self) -> &[f64] {
        self.data.as_ref()
    }

    /// The k numbers of row `i`.
    pub fn row(&self, i: usize) -> &[f64] {
        &self.data.as_ref()[i * self.k..(i + 1) * self.k]
    }

    /// The same block, read-only.
    pub fn view(&self) -> Columns<&[f64]> {
        Columns { data: self.data.as_ref(), n: self.n, k: self.k }
    }

    /// The largest absolute value of each column, written to `norms` (length k).
    pub fn infinity_norms(&self, norms: &mut [f64]) {
        norms.fill(0.0);
        for row in self.data.as_ref().chunks_exact(self.k) {
            for (norm, x) in norms.iter_mut().zip(row) {
                *norm = norm.max(x.abs());
            }
        }
    }
}

impl<'a> Columns<&'a [f64]> {
    /// The numbers with the lifetime of the viewed slice.
    pub fn slice(self) -> &'a [f64] {
        self.data
    }
}

impl Columns<&mut [f64]> {
    /// A shorter-lived view of the same block, so that it can be handed on and used again.
    pub fn reborrow(&mut self) -> Columns<&mut [f64]> {
        Columns { data: &mut *self.data, n: self.n, k: self.k }
    }

    /// All n * k numbers, row after row, to be written.
    pub fn data_mut(&mut self) -> &mut [f64] {
        self.data
    }

    /// The k numbers of row `i`, to be written.
    pub fn row_mut(&mut self, i: usize) -> &mut [f64] {
        &mut self.data[i * self.k..(i + 1) * self.k]
    }
}
