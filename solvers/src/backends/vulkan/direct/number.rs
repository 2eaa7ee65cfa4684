//! f64 and f32 as the device's kernels have them.
use super::blocks::LANES;
use super::tiles::ROWS_PER_LANE;
use crate::backends::vulkan::buffer::Plain;
use crate::backends::vulkan::device::Device;
use crate::backends::vulkan::error::DeviceError;
use crate::backends::vulkan::kernel::Kernel;
use crate::backends::vulkan::shaders::{Binding, Shader};
use crate::lanes::Lanes;
use std::sync::Arc;

use Binding::{Indices, Reals, Storage, Words};

/// Invocations per workgroup: eight tiles. On lavapipe a workgroup costs 0.1 us whatever its size up to 64.
pub const GROUP: u32 = 64;

/// Tiles per workgroup.
pub const TILES_PER_GROUP: u32 = GROUP / LANES as u32;

/// A number that kernels compute in.
pub trait Number: Lanes + Plain {
    /// How many fill 16 bytes.
    const PACK: usize;
    /// y of a level's pivots.
    const ASSEMBLE: Shader;
    /// Tiles of the forward sweep.
    const FORWARD: Shader;
    /// Tiles of the backward sweep.
    const BACKWARD: Shader;
}

macro_rules! number {
    ($t:ident, $name:literal, $pack:literal, $values:ident) => {
        impl Number for $t {
            const PACK: usize = $pack;
            const ASSEMBLE: Shader =
                shader!("assemble", $name, &[Indices, $values, Indices, Indices, $values, Storage], 3);
            const FORWARD: Shader = shader!(
                "forward",
                $name,
                &[Words, $values, $values, Indices, Indices, Indices, $values, Storage],
                3
            );
            const BACKWARD: Shader =
                shader!("backward", $name, &[Words, $values, $values, Indices, Indices, $values, Storage], 4);
        }
    };
}

number!(f64, "f64", 2, Words);
number!(f32, "f32", 4, Reals);

/// The kernels of a direct solve, by planes of four columns and rows per lane.
pub struct Kernels {
    assemble: [Arc<Kernel>; 2],
    forward: [[Vec<Arc<Kernel>>; 2]; 2],
    backward: [Vec<Arc<Kernel>>; 2],
}

impl Kernels {
    /// Compiles them.
    ///
    /// # Errors
    /// Where the driver refuses.
    pub fn new<T: Number>(device: &Arc<Device>) -> Result<Self, DeviceError> {
        let assemble = |planes| Kernel::new(device, &T::ASSEMBLE, &[GROUP, planes]);
        let each = |shader: &Shader, planes: u32, leaves: u32| -> Result<Vec<_>, DeviceError> {
            let constants = |rows: usize| [GROUP, planes, rows as u32, leaves];
            ROWS_PER_LANE.iter().map(|&rows| Kernel::new(device, shader, &constants(rows))).collect()
        };
        let forward = |planes, leaves| each(&T::FORWARD, planes, leaves);
        Ok(Self {
            assemble: [assemble(1)?, assemble(2)?],
            forward: [[forward(1, 0)?, forward(1, 1)?], [forward(2, 0)?, forward(2, 1)?]],
            backward: [each(&T::BACKWARD, 1, 0)?, each(&T::BACKWARD, 2, 0)?],
        })
    }

    /// y of a level.
    pub fn assemble(&self, planes: usize) -> &Arc<Kernel> {
        &self.assemble[planes - 1]
    }

    /// Forward tiles.
    pub fn forward(&self, planes: usize, leaves: bool, rows_per_lane: usize) -> &Arc<Kernel> {
        &self.forward[planes - 1][usize::from(leaves)][index(rows_per_lane)]
    }

    /// Backward tiles.
    pub fn backward(&self, planes: usize, rows_per_lane: usize) -> &Arc<Kernel> {
        &self.backward[planes - 1][index(rows_per_lane)]
    }
}

fn index(rows_per_lane: usize) -> usize {
    ROWS_PER_LANE.iter().position(|&rows| rows == rows_per_lane).expect("a compiled number of rows")
}
