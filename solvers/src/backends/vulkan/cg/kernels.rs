//! The compiled kernels and how each is dispatched.

use super::super::{Binding, Buffer, Device, DeviceError, Kernel, Plain, Plan, Shader, Slot};
use super::sparse::Sparse;
use crate::backend::DeviceType;
use crate::isa::Real;
use std::sync::Arc;

/// f32 or f64 on the device.
pub(super) trait Number: Real + Plain {
    /// Reduction of the residual over which the recurrence in these numbers is believed.
    const TRUST: f64;
    /// The kernels for these numbers.
    const SHADERS: Shaders;
}

/// The kernels of the iteration.
pub(super) struct Shaders {
    sparse: Shader,
    scale: Shader,
    dots: Shader,
    update: Shader,
    direction: Shader,
    scalars: Shader,
}

macro_rules! number {
    ($t:ty, $real:literal, $vectors:ident, $trust:expr) => {
        impl Number for $t {
            const TRUST: f64 = $trust;
            const SHADERS: Shaders = {
                use Binding::{Indices, Storage, Words, $vectors as Vectors};
                Shaders {
                    sparse: shader!(
                        "cg_sparse",
                        $real,
                        &[Indices, Words, Vectors, Vectors, Vectors, Vectors, Storage],
                        1
                    ),
                    scale: shader!("cg_scale", $real, &[Vectors, Vectors, Storage], 1),
                    dots: shader!("cg_dots", $real, &[Vectors, Vectors, Storage], 2),
                    update: shader!(
                        "cg_update",
                        $real,
                        &[Vectors, Vectors, Vectors, Storage, Storage, Storage],
                        2
                    ),
                    direction: shader!("cg_direction", $real, &[Vectors, Vectors, Storage], 1),
                    scalars: shader!("cg_scalars", $real, &[Vectors, Storage, Storage], 2),
                }
            };
        }
    };
}
number!(f64, "f64", Words, 0.0);
number!(f32, "f32", Reals, 1e-4); // as on the CPU: three digits above the unit roundoff

/// What a product with a sparse matrix becomes; the numbers are the MODE of `cg_sparse.comp`.
#[derive(Clone, Copy)]
pub(super) enum Product<'a> {
    /// M x
    Plain,
    /// b - M x
    Residual(&'a Arc<Buffer>),
    /// b + M x
    Plus(&'a Arc<Buffer>),
    /// x + w (b - M x), w per row
    Smooth(&'a Arc<Buffer>, &'a Arc<Buffer>),
}

/// A step of the scalars; the numbers are the MODE of `cg_scalars.comp`.
#[derive(Clone, Copy, Debug)]
pub(super) enum Scalars {
    /// r . z at the start.
    Start = 0,
    /// alpha from p . q.
    Alpha = 1,
    /// r . r: who has arrived.
    Norm = 2,
    /// beta from the new r . z.
    Beta = 3,
}

/// Compiled kernels.
pub(super) struct Kernels {
    sparse: [Arc<Kernel>; 4],
    scale: Arc<Kernel>,
    dots: Arc<Kernel>,
    update: Arc<Kernel>,
    direction: Arc<Kernel>,
    scalars: [Arc<Kernel>; 4],
    /// Rows per invocation of the kernels with sums.
    rows: u32,
    /// Their workgroup.
    sum_width: u32,
}

/// Workgroup of kernels without sums.
const WIDTH: u32 = 256;
/// Workgroup of the scalars, which is alone on the device.
const SCALARS_WIDTH: u32 = 64;

impl Kernels {
    /// Compiles all of them.
    pub(super) fn new<T: Number>(device: &Arc<Device>) -> Result<Self, DeviceError> {
        // On lavapipe few long invocations cost least, on GPUs many short ones.
        let (sum_width, rows) = if device.kind() == DeviceType::SoftwareVulkan { (64, 32) } else { (256, 4) };
        let make = |shader: &Shader, constants: &[u32]| Kernel::new(device, shader, constants);
        let sparse = |mode| make(&T::SHADERS.sparse, &[WIDTH, mode]);
        let scalars = |mode| make(&T::SHADERS.scalars, &[SCALARS_WIDTH, mode, SCALARS_WIDTH]);
        Ok(Self {
            sparse: [sparse(0)?, sparse(1)?, sparse(2)?, sparse(3)?],
            scale: make(&T::SHADERS.scale, &[WIDTH])?,
            dots: make(&T::SHADERS.dots, &[sum_width, rows])?,
            update: make(&T::SHADERS.update, &[sum_width, rows])?,
            direction: make(&T::SHADERS.direction, &[WIDTH])?,
            scalars: [scalars(0)?, scalars(1)?, scalars(2)?, scalars(3)?],
            rows,
            sum_width,
        })
    }

    /// Number of partial sums over `n` rows.
    pub(super) fn partials(&self, n: u32) -> u32 {
        n.div_ceil(self.rows * self.sum_width) * self.sum_width
    }

    /// y = `product`; x, y and b are different buffers.
    pub(super) fn sparse(
        &self,
        plan: &mut Plan,
        product: Product<'_>,
        m: &Sparse,
        x: &Arc<Buffer>,
        y: &Arc<Buffer>,
    ) {
        let (mode, b, weights) = match product {
            Product::Plain => (0, x, x), // not looked at
            Product::Residual(b) => (1, b, x),
            Product::Plus(b) => (2, b, x),
            Product::Smooth(b, weights) => (3, b, weights),
        };
        let slots = [&m.starts, &m.columns, &m.values, x, b, weights, y].map(Buffer::all);
        plan.dispatch(&self.sparse[mode], &slots, &[m.rows], m.rows.div_ceil(WIDTH));
        plan.barrier();
    }

    /// y = weights b.
    pub(super) fn scale(
        &self,
        plan: &mut Plan,
        n: u32,
        weights: &Arc<Buffer>,
        b: &Arc<Buffer>,
        y: &Arc<Buffer>,
    ) {
        plan.dispatch(&self.scale, &[b, weights, y].map(Buffer::all), &[n], n.div_ceil(WIDTH));
        plan.barrier();
    }

    /// Partial sums of a . b.
    pub(super) fn dots(
        &self,
        plan: &mut Plan,
        n: u32,
        a: &Arc<Buffer>,
        b: &Arc<Buffer>,
        partials: &Arc<Buffer>,
    ) {
        let count = self.partials(n);
        plan.dispatch(&self.dots, &[a, b, partials].map(Buffer::all), &[n, count], count / self.sum_width);
        plan.barrier();
    }

    /// x += alpha p, r -= alpha q, partial sums of r . r. Slots: p, q, state, x, r, partials.
    pub(super) fn update(&self, plan: &mut Plan, n: u32, slots: [&Arc<Buffer>; 6]) {
        let count = self.partials(n);
        plan.dispatch(&self.update, &slots.map(Buffer::all), &[n, count], count / self.sum_width);
        plan.barrier();
    }

    /// p = z + beta p.
    pub(super) fn direction(
        &self,
        plan: &mut Plan,
        n: u32,
        z: &Arc<Buffer>,
        state: &Arc<Buffer>,
        p: &Arc<Buffer>,
    ) {
        plan.dispatch(&self.direction, &[z, state, p].map(Buffer::all), &[n], n.div_ceil(WIDTH));
        plan.barrier();
    }

    /// A step of the scalars from partial sums over `n` rows. Slots: partials, state, history (written at `slot`).
    pub(super) fn scalars(
        &self,
        plan: &mut Plan,
        step: Scalars,
        n: u32,
        slots: [&Arc<Buffer>; 3],
        slot: u32,
    ) {
        let slots: [Slot; 3] = slots.map(Buffer::all);
        plan.dispatch(&self.scalars[step as usize], &slots, &[self.partials(n), slot], 1);
        plan.barrier();
    }
}
