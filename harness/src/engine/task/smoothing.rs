//! The `smoothing` workload of a run: a sequence of angles, and the system of five diagonals.

use crate::engine::equations::Equations;
use crate::engine::inputs::Inputs;
use crate::engine::source::Sequence;
use lapsolve::workload::smoothing::{self, defaults};

/// (I + lambda D'D) b = a for angles from a file.
///
/// # Errors
/// A lambda that is not acceptable.
pub fn of_angles(sequence: &Sequence, inputs: &Inputs) -> anyhow::Result<Equations> {
    let frames = sequence.angles.len() / sequence.columns;
    let system = smoothing::system(frames, inputs.lambda)?;
    Ok(Equations::System { system, b: sequence.angles.clone(), k: sequence.columns, vertices: None })
}

/// The default sequence of `frames` frames.
///
/// # Errors
/// A lambda that is not acceptable.
pub fn of_size(frames: usize, inputs: &Inputs) -> anyhow::Result<Equations> {
    let columns = inputs.columns.map_or(defaults::COLUMNS, |k| k as usize);
    of_angles(&Sequence { angles: defaults::angles(frames, columns), columns }, inputs)
}
