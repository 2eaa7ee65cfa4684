//! Merging vertices at exactly the same position.

use std::collections::HashMap;

use super::builder::MeshBuilder;

/// Gives positions their vertex: a new one, or that of an earlier equal position. -0 equals 0.
///
/// The map's hash is keyed at random, so that no file can make it slow.
#[derive(Default)]
pub struct Welder {
    vertex_at: HashMap<[u64; 3], u32>,
    /// How many positions were given an earlier vertex.
    pub merged: usize,
}

impl Welder {
    /// The vertex at `key`; a new one is placed at `position`. NaN equals NaN of the same bits.
    pub fn vertex(&mut self, key: [f64; 3], position: [f64; 3], builder: &mut MeshBuilder) -> u32 {
        let next = builder.positions.len() as u32;
        let vertex = *self.vertex_at.entry(key.map(|x| (x + 0.0).to_bits())).or_insert(next); // -0 + 0 = 0
        if vertex == next {
            builder.positions.push(position);
        } else {
            self.merged += 1;
        }
        vertex
    }
}
