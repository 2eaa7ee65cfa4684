//! The result file, version 1: one object per cell, every member present, null where unknown.
//!
//! Times are integers in nanoseconds, sizes in bytes. Later 1.x versions only add members; readers skip what they do
//! not know and take what is missing as null.

use super::names::{DeviceType, Division, Precision, Status};
use crate::environment::Environment;
use crate::statistics::percentiles::Percentiles;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Version of what is written here.
pub const SCHEMA_VERSION: &str = "1.1";

/// A result file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ResultFile {
    /// Major and minor version, "1.1".
    pub schema_version: String,
    /// The command line that made it.
    pub command: String,
    /// False for shortened runs (`--quick`): good for a look, not for a statement.
    pub quotable: bool,
    /// The machine and the build.
    pub environment: Environment,
    /// One row per mesh, workload, backend and thread count.
    pub cells: Vec<Cell>,
}

/// One cell: a backend on a workload on a mesh.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Cell {
    /// What it was solved on.
    pub mesh: Mesh,
    /// Name of the workload.
    pub workload: String,
    /// Name of the backend or peer.
    pub backend: String,
    /// How it ended.
    pub status: Status,
    /// Why, unless `ok`.
    pub reason: Option<String>,
    /// False while the cell is being measured: what a killed run leaves.
    pub complete: bool,
    /// Whether its settings are tuned or the defaults; null for programs given on the command line.
    pub division: Option<Division>,
    /// What it computes in.
    pub precision: Option<Precision>,
    /// Relative residual asked of an iterative backend; null for direct ones.
    pub tolerance: Option<f64>,
    /// Threads a solve may use.
    pub threads: usize,
    /// Threads that the solver says it uses.
    pub threads_used: Option<usize>,
    /// Columns of the right-hand side (`transfer`: 3 positions; its field has 4).
    pub columns: Option<usize>,
    /// "cpu" or the device's own name.
    pub device: Option<String>,
    /// Kind of device.
    pub device_type: Option<DeviceType>,
    /// Set-up, phase by phase: of the fresh process whose set-up took the median time.
    pub phases_ns: Phases,
    /// Set-up (order, symbolic, numeric and upload together) over all fresh processes.
    pub set_up_ns: Summary,
    /// Every fresh process up to its first solve, in the order they ran.
    pub set_ups: Vec<SetUp>,
    /// Steady solves from x = 0.
    pub solve_ns: Summary,
    /// Whole `transfer` frames, x kept from frame to frame.
    pub frame_ns: Summary,
    /// Medians by name: of the parts of a `transfer` frame where the backend tells them apart; of the phases of a solve on a
    /// device (`device`: all of them as frames time them; `host`: the rest of the solve).
    pub steps_ns: BTreeMap<String, u64>,
    /// New values on the same pattern: update and refactor.
    pub update_ns: Summary,
    /// At the median frame (or solve, where a frame is one).
    pub frames_per_second: Option<f64>,
    /// From the matrix in memory to the first solution: all set-up phases but load and assemble, and the first solve.
    pub first_frame_ns: Option<u64>,
    /// Steady solves with other numbers of columns, from x = 0.
    pub column_sweep: Vec<ColumnsRun>,
    /// Frame rate of the slowest hundredth.
    pub low1_fps: Option<f64>,
    /// Frames of over 2.5 times the average of the 20 before.
    pub stutters: Option<u64>,
    /// Frames started on a schedule.
    pub open_loop: Vec<OpenLoop>,
    /// Every timed frame (`transfer`) or solve, in the order measured.
    pub samples_ns: Vec<u64>,
    /// What the harness found when it checked the answers.
    pub accuracy: Accuracy,
    /// The factor.
    pub factor: Factor,
    /// Peak resident memory of the cell's own process.
    pub peak_rss_bytes: Option<u64>,
    /// Allocations per steady solve or frame, over all threads of the process.
    pub allocations_per_frame: Option<f64>,
    /// Memory traffic.
    pub bandwidth: Bandwidth,
    /// What else the machine did during the rounds.
    pub contention: Contention,
    /// Iterations of a solve, the largest over the columns; null for direct backends.
    pub iterations: Option<u32>,
    /// The course of one solve from x = 0; empty for direct backends, `transfer` and peers that do not tell.
    pub convergence: Convergence,
    /// What the backend says about itself: versions, instruction sets, tuning.
    pub details: BTreeMap<String, String>,
}

/// Residual over iterations and time; three lists of the same length.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Convergence {
    /// Number of the iteration; long courses keep every second (fourth, ...) one and the last.
    pub iterations: Vec<u32>,
    /// Time since the start of the solve.
    pub elapsed_ns: Vec<u64>,
    /// Largest relative residual over the columns, as the recurrence of the solver has it.
    pub residuals: Vec<f64>,
}

/// The mesh (or matrix) of a cell.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Mesh {
    /// As given on the command line; files without their folder.
    pub name: String,
    /// Number of triangles; null for a matrix.
    pub triangles: Option<usize>,
    /// Number of vertices, or rows of a matrix.
    pub vertices: Option<usize>,
    /// SHA-256 of positions and triangles, hexadecimal; null where it could not be read.
    pub sha256: Option<String>,
}

/// Set-up times.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Phases {
    /// Reading or making the mesh; done once for all cells of the mesh.
    pub load: Option<u64>,
    /// Assembling the mesh's plain cotangent Laplacian (median of five): once for all cells of the mesh, with all threads.
    /// By the library itself where it assembles its own.
    pub assemble: Option<u64>,
    /// Elimination order, or structure of a hierarchy.
    pub order: Option<u64>,
    /// Symbolic factorisation.
    pub symbolic: Option<u64>,
    /// Numeric factorisation, or the numbers of a preconditioner.
    pub numeric: Option<u64>,
    /// Transfer to a device.
    pub upload: Option<u64>,
    /// The first solve or frame.
    pub first_solve: Option<u64>,
}

/// A fresh process of a cell: set-up, first solve, memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct SetUp {
    /// The phases; load and assemble are null, they happen once for all.
    pub phases_ns: Phases,
    /// Peak resident memory after the first solve, bytes.
    pub peak_rss_bytes: Option<u64>,
}

/// Steady solves of right-hand sides with this many columns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct ColumnsRun {
    /// Columns.
    pub columns: usize,
    /// Solves.
    pub solve_ns: Summary,
}

/// What else used the processors while the cell was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Contention {
    /// Rounds that were watched.
    pub rounds: u32,
    /// Rounds in which others used more than a tenth of a processor or the hypervisor took more than 1%.
    pub contended: u32,
    /// Most processors' worth of time that other processes used in a round.
    pub others_max: Option<f64>,
    /// Largest share of processor time that the hypervisor took in a round.
    pub steal_max: Option<f64>,
    /// Highest one-minute load average at the end of a round; the run itself is in it.
    pub load1_max: Option<f64>,
}

/// Order statistics of timed repetitions. p95 needs 200 samples, p99 1,000, p99.9 10,000.
/// `p50_low` and `p50_high` are the ends of a distribution-free 95% interval of the median; they need 6 samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[expect(missing_docs, reason = "the names say it")]
pub struct Summary {
    pub samples: Option<usize>,
    pub min: Option<u64>,
    pub p50: Option<u64>,
    pub p50_low: Option<u64>,
    pub p50_high: Option<u64>,
    pub p95: Option<u64>,
    pub p99: Option<u64>,
    pub p999: Option<u64>,
    pub max: Option<u64>,
}

/// Frames started on a schedule; latencies count from the scheduled start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct OpenLoop {
    /// Starts per second.
    pub hz: f64,
    /// Frames done.
    pub frames: u64,
    /// Frames that took longer than 1 / hz.
    pub misses: u64,
    /// Upper 95% bound of the miss rate (Clopper-Pearson).
    pub miss_upper95: f64,
    /// Lower 95% bound of the miss rate.
    pub miss_lower95: f64,
    /// The same three for frames that took longer than half of 1 / hz: what an application sees that leaves the solver half.
    pub half_misses: Option<u64>,
    /// Upper 95% bound of their share.
    pub half_upper95: Option<f64>,
    /// Lower 95% bound of their share.
    pub half_lower95: Option<f64>,
    /// Latencies.
    pub latency_ns: Summary,
}

/// How good the checked answers are; the worst of all checks of the cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Accuracy {
    /// Normwise backward error, infinity norms, compensated residual, largest over the columns.
    pub backward_error: Option<f64>,
    /// Its limit; null where the relative residual rules.
    pub backward_limit: Option<f64>,
    /// Componentwise backward error, guarded zeros.
    pub componentwise: Option<f64>,
    /// ||b - A x||_2 / ||b||_2, largest over the columns.
    pub relative_residual: Option<f64>,
    /// Its limit; null where the backward error rules.
    pub residual_limit: Option<f64>,
    /// Distance from the reference solution, in the workload's unit (diagonal, largest constraint, largest |x|).
    pub forward_error: Option<f64>,
    /// Largest deviation on constrained vertices, relative to the largest constraint.
    pub constraint_error: Option<f64>,
    /// What the reference solution is.
    pub reference: Option<String>,
    /// Limit of the forward error.
    pub limit: Option<f64>,
    /// False where two references differ by more than a tenth of the limit: no statement on the forward error.
    pub certifiable: Option<bool>,
}

/// What a prepared handle holds.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Factor {
    /// Entries of the factor, or of all levels of a preconditioner.
    pub nonzeros: Option<u64>,
    /// Their bytes as stored.
    pub bytes: Option<u64>,
    /// Bytes on a device.
    pub device_bytes: Option<u64>,
    /// Flops of the numeric factorisation.
    pub flops: Option<u64>,
    /// Programs started on a device in one solve or frame.
    pub dispatches: Option<u64>,
    /// Ordering that ran.
    pub ordering: Option<String>,
}

/// Memory traffic of a steady solve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Bandwidth {
    /// Bytes of matrix and factor that a solve reads, by the backend's account.
    pub bytes_per_solve: Option<u64>,
    /// Those bytes over the median time.
    pub gb_per_s: Option<f64>,
    /// The same against `read_gb_per_s`.
    pub fraction_of_read: Option<f64>,
    /// Read bandwidth of the host's memory measured between the rounds, at the cell's threads and the factor's size; null
    /// where the factor lies in a card's own.
    pub read_gb_per_s: Option<f64>,
}

impl Summary {
    /// Order statistics of `samples`; all null where there are none.
    pub fn of(samples: &[u64]) -> Self {
        let Percentiles { min, p50, p50_interval, p95, p99, p999, max } = Percentiles::of(samples);
        let count = (!samples.is_empty()).then_some(samples.len());
        let (p50_low, p50_high) = p50_interval.unzip();
        Self { samples: count, min, p50, p50_low, p50_high, p95, p99, p999, max }
    }
}

impl SetUp {
    /// Everything between the matrix in memory and a handle that solves; null where no phase is known.
    pub fn total_ns(&self) -> Option<u64> {
        self.phases_ns.set_up()
    }
}

impl Phases {
    /// Everything between the assembled matrix and the first solve; null where no phase is known.
    pub fn set_up(&self) -> Option<u64> {
        let phases = [self.order, self.symbolic, self.numeric, self.upload];
        phases.iter().any(Option::is_some).then(|| phases.into_iter().flatten().sum())
    }
}

impl Cell {
    /// Whether both are the same mesh, workload, backend and thread count.
    pub fn same_as(&self, other: &Self) -> bool {
        let key = |c: &Self| (c.mesh.name.clone(), c.workload.clone(), c.backend.clone(), c.threads);
        key(self) == key(other)
    }

    /// "A wrong answer has no time": removes every figure of time, rate and traffic.
    pub fn without_times(&mut self) {
        *self = Self {
            mesh: std::mem::take(&mut self.mesh),
            workload: std::mem::take(&mut self.workload),
            backend: std::mem::take(&mut self.backend),
            reason: self.reason.take(),
            device: self.device.take(),
            accuracy: std::mem::take(&mut self.accuracy),
            factor: std::mem::take(&mut self.factor),
            details: std::mem::take(&mut self.details),
            status: self.status,
            complete: self.complete,
            division: self.division,
            precision: self.precision,
            tolerance: self.tolerance,
            threads: self.threads,
            threads_used: self.threads_used,
            columns: self.columns,
            device_type: self.device_type,
            peak_rss_bytes: self.peak_rss_bytes,
            ..Self::default()
        };
    }
}
