//! The one table of accuracy limits: what a solution must reach to count, by precision and accuracy class.
//!
//! Limits follow from what the registry row declares, never from a backend's name. They were calibrated on real meshes,
//! slivers included (best direct f64 solvers reach 2.7 eps there), and are raised only with evidence.

use crate::registry::{Accuracy, Precision};

/// Relative accuracy of the largest quantities a solve may be asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest normwise backward error ([`crate::residual::Residual::backward_error`]); `None` where the residual rules.
    pub backward_error: Option<f64>,
    /// Largest true relative residual ||b - A x||_2 / ||b||_2; `None` where the backward error rules.
    pub relative_residual: Option<f64>,
    /// Largest error of `harmonic`, relative to max |g|.
    pub harmonic: f64,
    /// Largest error of `poisson` and every other system of a mesh, relative to the diagonal or the largest |x|.
    pub poisson: f64,
    /// Largest error of a solve with any given matrix, relative to the largest |x|. `None` for f32: its other limits are
    /// those of what a frame displays, smooth fields and positions; a rough solution of an ill-conditioned matrix has
    /// eps32 times the condition, and only its backward error says whether the solver did its work.
    pub matrix: Option<f64>,
    /// Largest error of a `transfer` frame, relative to the diagonal.
    pub transfer: f64,
    /// Largest error of an `arap` deformation, relative to the diagonal. Rotations that are fitted in f32, as libigl does, leave
    /// 3e-6 on well-shaped meshes after five iterations and 3e-4 where negative weights make some of them hard to tell.
    pub arap: f64,
}

/// Residual an iterative backend aims at when nothing else is asked.
pub const DEFAULT_TOLERANCE: f64 = 1e-10;

/// 30 eps: twice LAPACK's test threshold (30 times its eps of 2^-53, on a denominator without ||b||).
const BACKWARD_F64: f64 = 30.0 * f64::EPSILON;
/// The same in f32.
const BACKWARD_F32: f64 = 30.0 * f32::EPSILON as f64;
/// Two sweep pairs with a factor stored in f32 gain five digits each; a third is taken where they do not reach this.
const BACKWARD_MIXED: f64 = 5e-12;
/// An iterative backend may miss its tolerance by a tenth: its own residual is a recurrence.
const ITERATIVE_SLACK: f64 = 1.1;
/// Forward error an iterative solution may have, in tolerances.
const ITERATIVE_FORWARD: f64 = 100.0;

impl Limits {
    /// Limits of a class; `tolerance` counts for iterative backends only.
    pub fn of(precision: Precision, accuracy: Accuracy, tolerance: f64) -> Self {
        let direct = |eta, harmonic, poisson, transfer, arap| Self {
            backward_error: Some(eta),
            relative_residual: None,
            harmonic,
            poisson,
            matrix: (precision != Precision::F32).then_some(poisson),
            transfer,
            arap,
        };
        match (accuracy, precision) {
            (Accuracy::Direct, Precision::F64) => direct(BACKWARD_F64, 1e-9, 1e-9, 1e-9, 1e-9),
            (Accuracy::Direct, Precision::Mixed) => direct(BACKWARD_MIXED, 2e-9, 2e-9, 2e-9, 2e-9),
            (Accuracy::Direct, Precision::F32) => direct(BACKWARD_F32, 1e-5, 5e-6, 2e-5, 1e-3),
            (Accuracy::Iterative, _) => {
                let forward = ITERATIVE_FORWARD * tolerance;
                Self {
                    backward_error: None,
                    relative_residual: Some(ITERATIVE_SLACK * tolerance),
                    harmonic: forward,
                    poisson: forward,
                    matrix: Some(forward),
                    transfer: forward,
                    arap: forward,
                }
            }
        }
    }

    /// True where `residual` is within the limit of this class.
    pub fn accepts(&self, residual: &crate::residual::Residual) -> bool {
        self.backward_error.is_none_or(|limit| residual.backward_error <= limit)
            && self.relative_residual.is_none_or(|limit| residual.relative <= limit)
    }
}
