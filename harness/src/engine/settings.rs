//! How long and how hard a run measures.

use lapsolve::limits::DEFAULT_TOLERANCE;
use std::time::Duration;

/// Frames without a late one that bound the share of late ones by 1% (1 - 0.05^(1/299) < 0.01).
const FRAMES_TO_MEET: u32 = 300;

/// Everything about a run that is not its cells.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Time for the steady solves of a cell, over all rounds.
    pub cell_time: Duration,
    /// Longest wait for one answer of a child.
    pub cell_timeout: Duration,
    /// Fresh processes of a cell, for set-up times and memory; fewer where they take more than twice `cell_time`.
    pub set_ups: u32,
    /// Numbers of columns that steady solves are also timed with.
    pub columns: Vec<usize>,
    /// Rounds: every prepared cell gets a slice of each.
    pub rounds: u32,
    /// Starts per second of the open-loop runs.
    pub rates: Vec<f64>,
    /// Time of one open-loop run; zero leaves them out.
    pub open_loop_time: Duration,
    /// Fewest frames of an open-loop run.
    pub least_frames: u32,
    /// Relative residual asked of iterative backends.
    pub tolerance: f64,
    /// Vulkan device by index or part of its name.
    pub device: Option<String>,
    /// Cap on a child's address space, bytes.
    pub memory_limit: Option<u64>,
    /// Seed of the order of cells within rounds.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            // Keeps the default suite, with Vulkan in software, under three minutes on two cores.
            cell_time: Duration::from_millis(2500),
            cell_timeout: Duration::from_secs(120),
            set_ups: 3,
            columns: vec![1, 3, 4, 7, 32],
            rounds: 5,
            rates: vec![60.0, 90.0, 120.0],
            open_loop_time: Duration::from_secs(1),
            least_frames: FRAMES_TO_MEET,
            tolerance: DEFAULT_TOLERANCE,
            device: None,
            memory_limit: None,
            seed: 1,
        }
    }
}

impl Settings {
    /// Shortened: good for a look, not for a statement.
    pub fn quick() -> Self {
        Self {
            cell_time: Duration::from_millis(400),
            set_ups: 1,
            columns: Vec::new(),
            rounds: 2,
            open_loop_time: Duration::ZERO,
            least_frames: 0,
            ..Self::default()
        }
    }

    /// Time of a cell for the solves with one number of columns.
    pub fn columns_slice(&self) -> Duration {
        self.cell_time / 20
    }

    /// Time of a cell in one round.
    pub fn slice(&self) -> Duration {
        self.cell_time / self.rounds.max(1)
    }
}
