//! f64 and f32 as the device's kernels have them.
use super::blocks::LANES;
use super::tiles::{Shape, shapes};
use crate::backends::vulkan::buffer::Plain;
use crate::backends::vulkan::device::{Access, Device};
use crate::backends::vulkan::error::DeviceError;
use crate::backends::vulkan::kernel::Kernel;
use crate::backends::vulkan::shaders::{Binding, Shader};
use crate::lanes::Lanes;
use std::sync::Arc;

use Binding::{Indices, Reals, Storage, Words};

/// Invocations per workgroup: eight tiles. On lavapipe a workgroup costs 0.1 us whatever its size up to 64.
pub const GROUP: u32 = 64;

impl Shape {
    /// Invocations per workgroup: whole tiles.
    fn group(self) -> u32 {
        GROUP.max((LANES * self.ways) as u32)
    }

    /// Workgroups for `tiles` tiles.
    pub fn groups(self, tiles: u32) -> u32 {
        tiles.div_ceil(self.group() / (LANES * self.ways) as u32)
    }
}

/// Where the forward sweep takes y from: the SOURCE of `forward.comp`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// `assemble` has written it.
    Assembled = 0,
    /// The right-hand side: for leaves.
    RightHandSide = 1,
    /// Right-hand side and updates, gathered by every tile.
    Gathered = 2,
}

/// A number that kernels compute in.
pub trait Number: Lanes + Plain {
    /// How many fill 16 bytes.
    const PACK: usize;
    /// Vectors between host and device.
    const PACKING: Shader;
    /// A right-hand side from values at constraints.
    const COUPLE: Shader;
    /// Rows to or from their places.
    const SCATTER: Shader;
    /// Unit quaternions from a field.
    const NORMALISE: Shader;
    /// Rotations of triangles.
    const TURN: Shader;
    /// Their differential coordinates.
    const DIVERGENCE: Shader;
    /// y of a level's pivots.
    const ASSEMBLE: Shader;
    /// Tiles of the forward sweep; storage buffers with vectors read by every lane, or handed round.
    const FORWARD: [Shader; 2];
    /// Tiles of the backward sweep; as above.
    const BACKWARD: [Shader; 2];
}

macro_rules! number {
    ($t:ident, $name:literal, $pack:literal, $values:ident) => {
        impl Number for $t {
            const PACK: usize = $pack;
            const PACKING: Shader = storage_shader!("pack", $name, &[Storage, Storage], 3);
            const COUPLE: Shader =
                shader!("couple", $name, &[Indices, Indices, Indices, $values, $values, Storage], 1);
            const SCATTER: Shader = storage_shader!("scatter", $name, &[Storage; 3], 1);
            const NORMALISE: Shader = storage_shader!("normalise", $name, &[Storage; 7], 3);
            const TURN: Shader = storage_shader!("turn", $name, &[Storage; 3], 1);
            const DIVERGENCE: Shader = storage_shader!("divergence", $name, &[Storage; 5], 1);
            const ASSEMBLE: Shader =
                shader!("assemble", $name, &[Indices, $values, Indices, Indices, $values, Storage], 3);
            const FORWARD: [Shader; 2] = shader_pair!(
                "forward",
                $name,
                &[Words, $values, $values, Indices, Indices, Indices, $values, Storage],
                4
            );
            const BACKWARD: [Shader; 2] = shader_pair!(
                "backward",
                $name,
                &[Words, $values, $values, Indices, Indices, $values, Storage],
                4
            );
        }
    };
}

number!(f64, "f64", 2, Words);
number!(f32, "f32", 4, Reals);

/// The kernels of a direct solve, by planes of four columns and by shape.
pub struct Kernels {
    assemble: [Arc<Kernel>; 2],
    forward: [[Vec<Arc<Kernel>>; 2]; 2],
    backward: [Vec<Arc<Kernel>>; 2],
    shapes: [Shape; 3],
    above_leaves: Source,
}

impl Kernels {
    /// Compiles them.
    ///
    /// # Errors
    /// Where the driver refuses.
    pub fn new<T: Number>(device: &Arc<Device>) -> Result<Self, DeviceError> {
        let shapes = shapes(device.access());
        let handed = match device.access() {
            Access::Texel => device.traits().shuffles() && device.traits().subgroup == LANES as u32,
            Access::Storage => device.traits().shuffles() && device.traits().subgroup >= LANES as u32,
        };
        // Gathering again in every tile costs a GPU less than a dispatch of its own, if lanes share it.
        let gathers = handed && device.access() == Access::Storage;
        let above_leaves = if gathers { Source::Gathered } else { Source::Assembled };
        let assemble = |planes| Kernel::new(device, &T::ASSEMBLE, &[GROUP, planes]);
        let each = |pair: &[Shader; 2], planes: u32, last: &[u32]| -> Result<Vec<_>, DeviceError> {
            let one = |shape: &Shape| {
                let group = shape.group();
                let shared = if shape.ways > 1 { planes * group } else { 1 };
                let (rows, ways) = (shape.rows as u32, shape.ways as u32);
                let constants = [group, planes, rows, ways, u32::from(handed), shared];
                Kernel::new(device, &pair[usize::from(handed)], &[&constants[..], last].concat())
            };
            shapes.iter().map(one).collect()
        };
        let forward = |planes, source: Source| each(&T::FORWARD, planes, &[source as u32]);
        let both = |planes| Ok([forward(planes, above_leaves)?, forward(planes, Source::RightHandSide)?]);
        Ok(Self {
            assemble: [assemble(1)?, assemble(2)?],
            forward: [both(1)?, both(2)?],
            backward: [each(&T::BACKWARD, 1, &[])?, each(&T::BACKWARD, 2, &[])?],
            shapes,
            above_leaves,
        })
    }

    /// Where y of blocks with children comes from.
    pub fn above_leaves(&self) -> Source {
        self.above_leaves
    }

    /// y of a level.
    pub fn assemble(&self, planes: usize) -> &Arc<Kernel> {
        &self.assemble[planes - 1]
    }

    /// Forward tiles.
    pub fn forward(&self, planes: usize, leaves: bool, shape: Shape) -> &Arc<Kernel> {
        &self.forward[planes - 1][usize::from(leaves)][self.index(shape)]
    }

    /// Backward tiles.
    pub fn backward(&self, planes: usize, shape: Shape) -> &Arc<Kernel> {
        &self.backward[planes - 1][self.index(shape)]
    }

    fn index(&self, shape: Shape) -> usize {
        self.shapes.iter().position(|&known| known == shape).expect("a compiled shape")
    }
}
