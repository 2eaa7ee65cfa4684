//! Frames that keep their volume: the surface moves outwards or inwards until it encloses what it should.

use crate::vector::Vector;
use anyhow::Context;
use lapsolve::backend::Backend;
use lapsolve::mesh::TriangleMesh;
use lapsolve::workload::transfer::TransferProblem;
use lapsolve::workload::volume::{Enclosure, Inflation};
use std::time::Instant;

/// Which volume a frame is to have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Wanted {
    /// That at rest times what the template's volume is times its own at rest
    Template,
    /// That at rest
    Rest,
}

/// What the last frame took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Kept {
    /// Nanoseconds.
    pub ns: u64,
    /// How far the surface moved along its normals, in diagonals of the target at rest; positive outwards.
    pub offset: f64,
}

/// The surface of the target, prepared.
pub struct KeepVolume {
    inflation: Inflation,
    /// The template's surface, where its volume counts.
    template: Option<Enclosure>,
    diagonal: f64,
    last: Kept,
}

impl KeepVolume {
    /// Prepares the target of `problem` on `backend`.
    ///
    /// # Errors
    /// Surfaces that enclose no volume; what the backend says.
    pub fn prepare(
        backend: &dyn Backend,
        wanted: Wanted,
        template: &TriangleMesh,
        problem: &TransferProblem,
        threads: usize,
    ) -> anyhow::Result<Self> {
        let target = problem.target();
        let inflation = Inflation::new(backend, target, threads).context("the target")?;
        let template = match wanted {
            Wanted::Rest => None,
            Wanted::Template => {
                Some(Enclosure::new(template).context("the template (`--keep-volume=rest` does without)")?)
            }
        };
        Ok(Self { inflation, template, diagonal: target.diagonal(), last: Kept::default() })
    }

    /// Moves the surface in `target`, for the template's pose `template` and the `field` of quaternions that it led to, n x 4. Parts
    /// without a mark have none: they move rigidly and keep their volume by themselves.
    ///
    /// # Errors
    /// A volume that cannot be reached.
    pub fn apply(&mut self, template: &[Vector], field: &[f64], target: &mut [Vector]) -> anyhow::Result<()> {
        let begin = Instant::now();
        let ratio = self.template.as_ref().map_or(1.0, |rest| rest.volume(template) / rest.at_rest());
        let offset = self.inflation.restore(ratio, field.as_chunks().0, target)?;
        let outwards = offset * self.inflation.enclosure().at_rest().signum();
        self.last = Kept { ns: begin.elapsed().as_nanos() as u64, offset: outwards / self.diagonal };
        Ok(())
    }

    /// What the last frame took.
    pub fn last(&self) -> Kept {
        self.last
    }
}
