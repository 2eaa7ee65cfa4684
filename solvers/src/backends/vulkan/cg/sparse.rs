//! A sparse matrix on the device: rows in chunks of four entries.
//!
//! A chunk is one word of four columns and one of four values, which a kernel reads with one fetch each; the last chunk of
//! a row is filled up with zeros (of column 0). For a mesh (7 entries per row) that adds a seventh.

use super::super::{Buffer, Device, DeviceError, constant};
use super::kernels::Number;
use crate::backends::cg::operator::Csr;
use crate::backends::multigrid::rows::Rows;
use crate::isa::Real;
use std::sync::Arc;

/// Entries of a chunk.
const CHUNK: usize = 4;

/// The device's copy.
pub(super) struct Sparse {
    pub(super) starts: Arc<Buffer>,
    pub(super) columns: Arc<Buffer>,
    pub(super) values: Arc<Buffer>,
    /// Number of rows.
    pub(super) rows: u32,
    /// Chunks, times four.
    pub(super) entries: usize,
}

impl Sparse {
    /// Packs and uploads the rows `row(0) .. row(n - 1)`.
    fn new<'a, T: Number, V: Real>(
        device: &Arc<Device>,
        n: usize,
        row: impl Fn(usize) -> (&'a [u32], &'a [V]),
    ) -> Result<Self, DeviceError> {
        let (mut starts, mut columns, mut values) = (vec![0u32], Vec::new(), Vec::new());
        for i in 0..n {
            let (own, numbers) = row(i);
            columns.extend_from_slice(own);
            values.extend(numbers.iter().map(|v| T::from_f64(v.to_f64())));
            columns.resize(columns.len().next_multiple_of(CHUNK), 0);
            values.resize(columns.len(), T::default());
            starts.push((columns.len() / CHUNK) as u32);
        }
        Ok(Self {
            starts: constant(device, &starts)?,
            columns: constant(device, &columns)?,
            values: constant(device, &values)?,
            rows: n as u32,
            entries: columns.len(),
        })
    }

    /// From rows.
    pub(super) fn of_rows<T: Number, V: Real>(
        device: &Arc<Device>,
        m: &Rows<V>,
    ) -> Result<Self, DeviceError> {
        Self::new::<T, V>(device, m.n(), |i| m.row(i))
    }

    /// From a full matrix.
    pub(super) fn of_csr<T: Number>(device: &Arc<Device>, a: Csr<'_>) -> Result<Self, DeviceError> {
        Self::new::<T, f64>(device, a.n(), |i| a.row(i))
    }
}

/// A number per row, as the kernels read weights.
pub(super) fn weights<T: Number>(
    device: &Arc<Device>,
    weights: impl Iterator<Item = f64>,
) -> Result<Arc<Buffer>, DeviceError> {
    constant(device, &weights.map(T::from_f64).collect::<Vec<_>>())
}
