//! What a check found: a named value against a limit, or why there is none.

use schemars::JsonSchema;
use serde::Serialize;
use std::fmt;

/// What a check looks at. Each level trusts the ones before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, JsonSchema)]
pub enum Level {
    /// The mesh itself.
    #[serde(rename = "L0 input")]
    Input,
    /// Laplacian and mass matrix, no solver.
    #[serde(rename = "L1 matrix")]
    Matrix,
    /// Residuals.
    #[serde(rename = "L2 residual")]
    Residual,
    /// Distance from the exact solution of the equations.
    #[serde(rename = "L3 forward")]
    Forward,
    /// Distance from the solution of the continuous problem, and its order.
    #[serde(rename = "L4 discretisation")]
    Discretisation,
    /// What every solution does, whatever the mesh.
    #[serde(rename = "L5 behaviour")]
    Behaviour,
}

impl fmt::Display for Level {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Level::Input => "L0 input",
            Level::Matrix => "L1 matrix",
            Level::Residual => "L2 residual",
            Level::Forward => "L3 forward",
            Level::Discretisation => "L4 discretisation",
            Level::Behaviour => "L5 behaviour",
        })
    }
}

/// How a check ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Within the limit.
    Passed,
    /// Beyond it, or no answer.
    Failed,
    /// The condition of the problem allows no statement.
    NotCertifiable,
    /// An iterative backend said that it did not converge: legal on slivered meshes.
    NotConverged,
    /// Not done; the note says why.
    Skipped,
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Outcome::Passed => "passed",
            Outcome::Failed => "FAILED",
            Outcome::NotCertifiable => "not certifiable",
            Outcome::NotConverged => "not converged",
            Outcome::Skipped => "skipped",
        })
    }
}

/// One check on one case.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Finding {
    /// What it looks at.
    pub level: Level,
    /// Name of the check.
    pub check: &'static str,
    /// The mesh or shape.
    pub case: String,
    /// The backend; null where none is involved.
    pub backend: Option<String>,
    /// What was measured.
    pub value: Option<f64>,
    /// What it must not exceed.
    pub limit: Option<f64>,
    /// How it ended.
    pub outcome: Outcome,
    /// Anything to add.
    pub note: String,
}

/// Findings as they are made, all about one case and backend at a time.
#[derive(Clone, Debug, Default)]
pub struct Findings {
    /// All findings, in order.
    pub all: Vec<Finding>,
    case: String,
    backend: Option<String>,
}

impl Findings {
    /// From now on findings are about `case` and `backend`.
    pub fn about(&mut self, case: impl Into<String>, backend: Option<&str>) {
        self.case = case.into();
        self.backend = backend.map(str::to_owned);
    }

    /// `value` must not exceed `limit`; NaN does.
    pub fn at_most(
        &mut self,
        level: Level,
        check: &'static str,
        value: f64,
        limit: f64,
        note: impl Into<String>,
    ) {
        let outcome = if value <= limit { Outcome::Passed } else { Outcome::Failed };
        self.push(level, check, Some(value), Some(limit), outcome, note);
    }

    /// A finding without figures.
    pub fn note(&mut self, level: Level, check: &'static str, outcome: Outcome, note: impl Into<String>) {
        self.push(level, check, None, None, outcome, note);
    }

    /// A finding as it is.
    pub fn push(
        &mut self,
        level: Level,
        check: &'static str,
        value: Option<f64>,
        limit: Option<f64>,
        outcome: Outcome,
        note: impl Into<String>,
    ) {
        let value = value.filter(|v| v.is_finite()); // JSON has no other numbers; the outcome says enough
        let (case, backend) = (self.case.clone(), self.backend.clone());
        self.all.push(Finding { level, check, case, backend, value, limit, outcome, note: note.into() });
    }

    /// Those that failed.
    pub fn failures(&self) -> impl Iterator<Item = &Finding> {
        self.all.iter().filter(|f| f.outcome == Outcome::Failed)
    }
}
