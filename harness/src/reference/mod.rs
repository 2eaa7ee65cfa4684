//! Comparison with programs of others: libigl and Open3D, run live through the Python programs of `reference/`.
//!
//! The programs are part of this binary; what they need is an interpreter with the pinned libraries, which
//! `cargo xtask setup` installs. Data flows one way: mesh -> file -> Python -> `.npy` files -> [`Agreement`]s.

pub mod igl;
pub mod open3d;
pub mod pipelines;
mod python;

pub use python::{Python, ReferenceError};

use lapsolve::dirichlet::DirichletError;
use lapsolve::error::{PrepareError, SolveError};

/// How far one quantity of ours is from a reference, over everything that was compared.
#[derive(Clone, Debug, PartialEq)]
pub struct Agreement {
    /// What was compared.
    pub quantity: &'static str,
    /// Numbers compared.
    pub compared: usize,
    /// The largest difference, relative to the scale of the quantity; NaN where one of the numbers is no number.
    pub worst: f64,
    /// Where it is.
    pub place: String,
    /// The largest that is accepted.
    pub limit: f64,
}

impl Agreement {
    /// Starts with nothing compared.
    pub fn new(quantity: &'static str, limit: f64) -> Self {
        Self { quantity, compared: 0, worst: 0.0, place: String::new(), limit }
    }

    /// Takes |ours - theirs| / scale into account; `place` is asked for when this is the worst so far. A scale that is not
    /// positive makes every difference infinite.
    pub fn add(&mut self, ours: f64, theirs: f64, scale: f64, place: impl FnOnce() -> String) {
        let difference = (ours - theirs).abs();
        let relative = if difference == 0.0 { 0.0 } else { difference / scale.max(0.0) };
        self.compared += 1;
        if relative > self.worst || (relative.is_nan() && !self.worst.is_nan()) {
            self.worst = relative;
            self.place = place();
        }
    }

    /// Whether everything is within the limit; a NaN is not.
    pub fn holds(&self) -> bool {
        self.worst <= self.limit
    }
}

/// Why a comparison could not be made.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// The reference did not run or answered something else.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// The reference's constraints are none for this mesh.
    #[error(transparent)]
    Dirichlet(#[from] DirichletError),
    /// The backend could not prepare the system.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// The backend could not solve it.
    #[error(transparent)]
    Solve(#[from] SolveError),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_difference_and_its_place_are_kept() {
        let mut agreement = Agreement::new("numbers", 0.1);
        agreement.add(1.0, 1.0, 1.0, || "same".into());
        agreement.add(1.0, 1.2, 4.0, || "far".into());
        agreement.add(1.0, 1.1, 4.0, || "near".into());
        assert!(agreement.holds());
        assert_eq!((agreement.compared, agreement.place.as_str()), (3, "far"));
        agreement.add(f64::NAN, 1.0, 1.0, || "nan".into());
        agreement.add(9.0, 1.0, 1.0, || "after".into());
        assert!(!agreement.holds());
        assert_eq!(agreement.place, "nan");
    }

    #[test]
    fn a_difference_without_scale_is_none_that_holds() {
        let mut agreement = Agreement::new("numbers", 1.0);
        agreement.add(0.0, 0.0, 0.0, String::new);
        assert!(agreement.holds());
        let zero = agreement.clone();
        for scale in [0.0, -1.0] {
            agreement.clone_from(&zero);
            agreement.add(1e-300, 0.0, scale, String::new);
            assert!(!agreement.holds(), "scale {scale}");
        }
    }
}
