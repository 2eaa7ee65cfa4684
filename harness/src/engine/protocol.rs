//! The peer protocol: what the harness asks a solver process, and what it answers.
//!
//! One JSON object per line on stdin, one on stdout, strictly in turn; arrays as files ([`ArrayFile`]). Every request
//! carries an `id`, which the answer repeats. An answer is `{"id":7,"ok":{...}}` or
//! `{"id":7,"error":{"kind":"...","message":"..."}}`. stderr is free for messages; end of stdin means quit.
//!
//! ```json
//! {"id":1,"do":"describe","protocol":1,"threads":2,"tolerance":1e-10,"device":null}
//! {"id":2,"do":"prepare","max_columns":3,"problem":{"kind":"system","matrix":{"n":9,"row_starts":{..},"columns":{..},"values":{..}},"positions":null}}
//! {"id":3,"do":"solve","rhs":{"path":"..","rows":9,"columns":3},"warmup":1,"times":20,"solution":"path to write"}
//! ```
//! The solver times itself with a monotonic clock and returns raw samples in nanoseconds. Whatever it says, the harness
//! reads the solution and checks it.

use super::array_file::ArrayFile;
use crate::record::names::{Accuracy, DeviceType, Precision};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Version of the protocol; a peer that speaks another one is `unsupported`.
pub const VERSION: u32 = 1;

/// Longest answer that is read, in bytes: a million samples of ten digits.
pub const MAX_LINE: usize = 16 << 20;

/// A request with its number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Envelope {
    /// Repeated in the answer.
    pub id: u64,
    /// What is asked.
    #[serde(flatten)]
    pub request: Request,
}

/// What the harness asks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case")]
pub enum Request {
    /// Open with these settings and say who you are: [`Described`].
    Describe {
        /// [`VERSION`] of the harness.
        protocol: u32,
        /// Threads a solve may use.
        threads: usize,
        /// Relative residual at which iterations stop.
        tolerance: f64,
        /// Device by index or part of its name, where there is a choice.
        device: Option<String>,
    },
    /// Do all work that depends on the matrix only: [`Prepared`].
    Prepare {
        /// What will be solved.
        problem: Problem,
        /// The most columns a right-hand side will have.
        max_columns: usize,
    },
    /// Solve `warmup + times` times and time the last `times` solves: [`Timed`]. Every solve starts from x = 0.
    Solve {
        /// Right-hand side (`system`: n x k) or constraint values (`harmonic`: |C| x k), f64; see [`Problem`] for the others.
        rhs: ArrayFile,
        /// Solves that are done first and not timed.
        warmup: u32,
        /// Solves that are timed, each on its own.
        times: u32,
        /// Where the last solution goes: n x k, f64. `harmonic`: all vertices, absent ones 0.
        solution: PathBuf,
    },
    /// Solve once from x = 0 and note every iteration: [`Iterated`]. Only iterative solvers are asked.
    Iterate {
        /// As for `solve`.
        rhs: ArrayFile,
    },
    /// Take new values on the same pattern and refactor, `times` times: [`Timed`].
    Update {
        /// One value per stored entry of the prepared matrix, f64.
        values: ArrayFile,
        /// Updates that are timed, each on its own.
        times: u32,
    },
    /// Change the constrained vertices of a `harmonic` problem, once: [`Timed`] with one sample. Later right-hand sides have
    /// a row for each vertex of the new set, ascending. A solver that can only prepare anew is `unsupported`.
    Edit {
        /// Vertices that become constrained, ascending, u32.
        add: ArrayFile,
        /// Vertices that become free, ascending, u32.
        remove: ArrayFile,
    },
    /// Do whole `transfer` frames in order, x kept from frame to frame: [`Timed`].
    Frame {
        /// Template positions, one frame per row (3 numbers per vertex), f64.
        template: ArrayFile,
        /// Frames at the start that are not timed.
        warmup: u32,
        /// Where the last frame's target positions go: n x 3, f64.
        solution: PathBuf,
        /// Where the last frame's quaternion field (n x 4) and right-hand side (n x 3) go, if the peer keeps them.
        trace: Option<Trace>,
    },
    /// Start a solve or frame every 1 / hz seconds: [`Timed`], the samples being latencies from the scheduled start.
    OpenLoop {
        /// Starts per second.
        hz: f64,
        /// Number of starts.
        frames: u32,
        /// Give up after this time; the frames done until then count.
        limit_ns: u64,
        /// `system`, `harmonic`: the right-hand side; `transfer`: template positions, cycled through.
        input: ArrayFile,
    },
    /// Memory held: [`Memory`].
    Memory,
    /// End.
    Quit,
}

/// Files for the inner results of a `transfer` frame.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Trace {
    /// Quaternions at the vertices before renormalisation, n x 4 (w, x, y, z).
    pub field: PathBuf,
    /// Right-hand side U of the Poisson system, n x 3.
    pub rhs: PathBuf,
}

/// What is to be solved.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Problem {
    /// A x = b with A symmetric positive definite.
    System {
        /// A.
        matrix: MatrixFiles,
        /// One point per row, n x 3, where the rows are vertices of a mesh.
        positions: Option<ArrayFile>,
    },
    /// L_FF u_F = -L_FC g, u_C = g.
    Harmonic {
        /// L, all vertices.
        laplacian: MatrixFiles,
        /// Vertex positions, n x 3.
        positions: Option<ArrayFile>,
        /// Triangles, m x 3, u32, for libraries that assemble by themselves.
        #[serde(default)]
        triangles: Option<ArrayFile>,
        /// C, ascending, u32.
        fixed: ArrayFile,
    },
    /// Whole frames: a moving template drives a target mesh.
    Transfer {
        /// The mesh that is to move.
        target: MeshFiles,
        /// The template in its reference pose.
        template: MeshFiles,
        /// Corresponding triangles (template, target), u32.
        marks: ArrayFile,
    },
    /// As-rigid-as-possible deformation ([`lapsolve::workload::arap`]). A right-hand side holds the handles' positions, one row
    /// per handle; a solution those of all vertices after the first global step and `iterations` iterations.
    Arap {
        /// The mesh in its reference pose.
        mesh: MeshFiles,
        /// Handles, ascending, u32.
        handles: ArrayFile,
        /// Iterations of every solve.
        iterations: u32,
    },
    /// Distances by the heat method ([`lapsolve::workload::geodesic`]). A right-hand side is 1 at the sources and 0 elsewhere;
    /// a solution holds one distance per vertex, infinite where no source is reached.
    Geodesic {
        /// The mesh.
        mesh: MeshFiles,
    },
}

/// A symmetric matrix: upper triangle by rows, columns ascending, the diagonal entry first in each row.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MatrixFiles {
    /// Order.
    pub n: usize,
    /// Start of each row, n + 1, u32.
    pub row_starts: ArrayFile,
    /// Column indices, u32, 0-based.
    pub columns: ArrayFile,
    /// Values, f64.
    pub values: ArrayFile,
}

/// A triangle mesh.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MeshFiles {
    /// Vertex positions, n x 3, f64.
    pub positions: ArrayFile,
    /// Triangles, m x 3, u32, 0-based.
    pub triangles: ArrayFile,
}

/// Who a peer is and how it runs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Described {
    /// Version of the protocol that the peer speaks.
    pub protocol: u32,
    /// What it computes in.
    pub precision: Precision,
    /// What its answers are held to.
    pub accuracy: Accuracy,
    /// "cpu", or the device's name.
    pub device: String,
    /// Kind of device.
    pub device_type: DeviceType,
    /// Threads it really uses.
    pub threads: usize,
    /// Largest system it takes.
    #[serde(default)]
    pub max_unknowns: Option<usize>,
    /// Versions, build flags, tuning. `convention` names the program whose definition of a pipeline the answers follow where
    /// definitions differ (`open3d`, `libigl`, `geometry-central`); they are checked against a refined answer of that definition.
    #[serde(default)]
    pub details: BTreeMap<String, String>,
}

/// A preparation, phase by phase. A phase that did not occur is null.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Prepared {
    /// Assembly of the Laplacian, by a library that does it itself, nanoseconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub assemble_ns: Option<u64>,
    /// Ordering, nanoseconds.
    #[serde(default)]
    pub order_ns: Option<u64>,
    /// Symbolic factorisation, nanoseconds.
    #[serde(default)]
    pub symbolic_ns: Option<u64>,
    /// Numeric factorisation, nanoseconds.
    #[serde(default)]
    pub numeric_ns: Option<u64>,
    /// Transfer to a device, nanoseconds.
    #[serde(default)]
    pub upload_ns: Option<u64>,
}

/// Timed repetitions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Timed {
    /// One entry per timed repetition, in order, nanoseconds.
    pub samples_ns: Vec<u64>,
    /// Iterations of the last one, the largest over the columns.
    #[serde(default)]
    pub iterations: Option<u32>,
    /// Allocations during the timed repetitions, over all threads; null where the peer does not count.
    #[serde(default)]
    pub allocations: Option<u64>,
    /// Time on the device, per repetition, where it has a clock of its own.
    #[serde(default)]
    pub device_ns: Vec<u64>,
    /// Parts of a frame or solve by name, where the peer tells them apart: an entry per timed repetition, or fewer.
    #[serde(default)]
    pub steps_ns: BTreeMap<String, Vec<u64>>,
}

/// The course of one iterative solve: an entry per iteration noted, in order. A solve that misses the tolerance has one, too.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Iterated {
    /// Number of the iteration.
    pub iterations: Vec<u32>,
    /// Time since the start of the solve, nanoseconds.
    pub elapsed_ns: Vec<u64>,
    /// Largest relative residual over the columns, as the solver has it.
    pub residuals: Vec<f64>,
}

/// What a peer holds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Memory {
    /// Peak resident memory of the process, bytes.
    #[serde(default)]
    pub peak_rss_bytes: Option<u64>,
    /// Entries of the factor.
    #[serde(default)]
    pub factor_nonzeros: Option<u64>,
    /// Bytes of the factor as stored.
    #[serde(default)]
    pub factor_bytes: Option<u64>,
    /// Bytes on the device.
    #[serde(default)]
    pub device_bytes: Option<u64>,
    /// Bytes of matrix and factor that one solve (iterative: one iteration) reads.
    #[serde(default)]
    pub bytes_per_solve: Option<u64>,
    /// Flops of the numeric factorisation.
    #[serde(default)]
    pub factor_flops: Option<u64>,
    /// Programs started on a device in one solve or frame.
    #[serde(default)]
    pub dispatches: Option<u64>,
    /// Ordering that ran.
    #[serde(default)]
    pub ordering: Option<String>,
}

/// Nothing to say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Done {}

/// Why a peer could not do what it was asked.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Refusal {
    /// What kind of obstacle.
    pub kind: RefusalKind,
    /// The words for the result file.
    pub message: String,
}

/// Kinds of obstacle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RefusalKind {
    /// It cannot run here.
    Unavailable,
    /// It does not do this.
    Unsupported,
    /// The tolerance was not reached.
    NotConverged,
    /// Memory is not enough.
    OutOfMemory,
    /// A pivot is not positive: the matrix, as rounded, has no Cholesky factor.
    NotPositiveDefinite,
    /// Anything else.
    #[serde(other)]
    Failed,
}

/// An answer with its number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Answer<T> {
    /// The request's number.
    pub id: u64,
    /// What came of it.
    #[serde(flatten)]
    pub outcome: Outcome<T>,
}

/// What came of a request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome<T> {
    /// It was done.
    Ok(T),
    /// It was not.
    Error(Refusal),
}

/// Reads an answer to request `id`.
///
/// # Errors
/// What is wrong with the line, for the result file.
pub fn parse_answer<T: DeserializeOwned>(line: &[u8], id: u64) -> Result<Outcome<T>, String> {
    let answer: Answer<T> = serde_json::from_slice(line)
        .map_err(|error| format!("answered what the protocol does not know ({error}): {}", excerpt(line)))?;
    if answer.id != id {
        return Err(format!("answered request {} instead of {id}", answer.id));
    }
    Ok(answer.outcome)
}

/// The start of a line that makes no sense, printable.
fn excerpt(line: &[u8]) -> String {
    const SHOWN: usize = 60;
    let start = &line[..line.len().min(SHOWN)];
    let dots = if line.len() > SHOWN { "..." } else { "" };
    format!("\"{}{dots}\"", String::from_utf8_lossy(start).escape_debug())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn requests_have_the_documented_form() {
        let request = Request::Describe { protocol: VERSION, threads: 2, tolerance: 1e-10, device: None };
        let line = serde_json::to_string(&Envelope { id: 1, request }).unwrap();
        assert_eq!(
            line,
            r#"{"id":1,"do":"describe","protocol":1,"threads":2,"tolerance":1e-10,"device":null}"#
        );
        let quit: Envelope = serde_json::from_str(r#"{"id":9,"do":"quit"}"#).unwrap();
        assert_eq!(quit, Envelope { id: 9, request: Request::Quit });
    }

    #[test]
    fn answers_are_read_and_lies_are_named() {
        let ok = br#"{"id":3,"ok":{"samples_ns":[5,6],"iterations":null,"later":1}}"#;
        let timed = Timed { samples_ns: vec![5, 6], ..Timed::default() };
        assert_eq!(parse_answer::<Timed>(ok, 3), Ok(Outcome::Ok(timed)));
        assert!(parse_answer::<Timed>(ok, 4).unwrap_err().contains("request 3 instead of 4"));
        assert!(parse_answer::<Timed>(b"Intel MKL WARNING", 4).unwrap_err().contains("Intel MKL"));
        let unknown_kind = br#"{"id":3,"error":{"kind":"on_fire","message":"help"}}"#;
        let refusal = Refusal { kind: RefusalKind::Failed, message: "help".into() };
        assert_eq!(parse_answer::<Timed>(unknown_kind, 3), Ok(Outcome::Error(refusal)));
    }

    proptest! {
        #[test]
        fn no_bytes_panic(line in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = parse_answer::<Timed>(&line, 1);
            let _ = parse_answer::<Described>(&line, 1);
            let _ = serde_json::from_slice::<Envelope>(&line);
        }

        /// Nearly right answers: a valid one with one byte changed.
        #[test]
        fn no_damaged_answer_panics(at in 0usize..80, byte in any::<u8>()) {
            let mut line = br#"{"id":1,"ok":{"samples_ns":[5,6],"iterations":3,"allocations":0,"device_ns":[]}}"#.to_vec();
            line[at] = byte;
            let _ = parse_answer::<Timed>(&line, 1);
            let _ = parse_answer::<Memory>(&line, 1);
        }
    }
}
