//! What stands between right-hand side and solution on the device: one sweep pair, or several with residuals between them.
use super::number::Number;
use super::tables::Tables;
use crate::backends::vulkan::buffer::Buffer;
use crate::backends::vulkan::plan::Plan;
use crate::error::PrepareError;
use std::ops::Range;
use std::sync::Arc;

/// A factor and what is done with it.
pub trait Core: Send + Sized + 'static {
    /// Numbers of right-hand sides and solutions.
    type Outer: Number;
    /// Numbers of the factor.
    type Inner: Number;
    /// Sweep pairs of a usual solve.
    const PAIRS: u32;
    /// Most sweep pairs of a solve.
    const MOST: u32;
    /// Largest entries of right-hand sides that are taken as they are.
    const COMFORTABLE: Range<f64>;

    /// The factor.
    fn tables(&self) -> &Tables<Self::Inner>;

    /// Factors these values, by stored entry of the matrix, in the place of those before.
    ///
    /// # Errors
    /// As [`Tables::factorise`].
    fn factorise(&mut self, values: &[f64]) -> Result<(), PrepareError>;

    /// Lists sweep pairs `pairs`, the first of which is 0, of a solve of [`scale`](Tables::scale) A x = b. Begins without a
    /// barrier and ends with one.
    fn list(&self, plan: &mut Plan, b: &Arc<Buffer>, x: &Arc<Buffer>, planes: usize, pairs: Range<u32>);

    /// Lists zeros in all vectors.
    fn clear(&self, plan: &mut Plan);

    /// Whether the solution after so many pairs will do.
    fn enough(&mut self, pairs: u32) -> bool;

    /// Bytes beside the factor: those on the device, and how many of them a pair reads.
    fn extra_bytes(&self) -> (u64, u64);
}

impl<T: Number> Core for Tables<T> {
    type Outer = T;
    type Inner = T;
    const PAIRS: u32 = 1;
    const MOST: u32 = 1;
    const COMFORTABLE: Range<f64> = <T as crate::lanes::Lanes>::COMFORTABLE;

    fn tables(&self) -> &Self {
        self
    }

    fn factorise(&mut self, values: &[f64]) -> Result<(), PrepareError> {
        Tables::factorise(self, values)
    }

    fn list(&self, plan: &mut Plan, b: &Arc<Buffer>, x: &Arc<Buffer>, planes: usize, _: Range<u32>) {
        self.sweep(plan, b, x, planes);
    }

    fn clear(&self, plan: &mut Plan) {
        Tables::clear(self, plan);
    }

    fn enough(&mut self, _: u32) -> bool {
        true
    }

    fn extra_bytes(&self) -> (u64, u64) {
        (0, 0)
    }
}
