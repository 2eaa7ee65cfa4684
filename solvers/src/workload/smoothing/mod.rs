//! `smoothing`: sequences of joint angles made smooth (KR section 2.3, equation 3).
//!
//! ```text
//! a -> outlier windows found, angles unwrapped, gaps interpolated     outliers
//!   -> (I + lambda D'D) b = a                                         Smoother
//! ```
//! b minimises sum_i |a_i - b_i|^2 + lambda sum_i |b_(i-1) - 2 b_i + b_(i+1)|^2, per angle: D is the second difference, of
//! (frames - 2) x frames, and the matrix has five diagonals. One row per frame, one column per angle, one factor for all
//! angles; no mesh. lambda = 1 in the paper; it has no unit but counts frames^4.
//!
//! # Default input
//! A mesh that comes alone gives no more than a size: [`defaults::angles`] are as many frames as it has vertices, of
//! [`defaults::COLUMNS`] angles.
//!
//! # Right when
//! a straight line is unchanged; lambda = 0 is the identity; in the interior the highest frequency, (-1)^i, shrinks by
//! 1 / (1 + 16 lambda).

pub mod defaults;
mod outliers;

pub use outliers::{OutlierRule, Outliers, clean, unwrap};

use crate::backend::{Backend, Factor, PrepareOptions, Solved};
use crate::columns::Columns;
use crate::error::{PrepareError, SolveError};
use crate::sparse::SymmetricCsr;
use crate::system::{System, SystemError};
use thiserror::Error;

/// lambda where nothing else is asked: the paper's.
pub const LAMBDA: f64 = 1.0;

/// Why a sequence cannot be smoothed.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SmoothingError {
    /// There is no frame.
    #[error("the sequence has no frames")]
    Empty,
    /// An angle is NaN or infinite.
    #[error("frame {frame}, column {column}: the angle is not finite")]
    NonFinite {
        /// 0-based frame.
        frame: usize,
        /// 0-based column.
        column: usize,
    },
    /// lambda is negative or not a number.
    #[error("lambda is {lambda}; it must be finite and not negative")]
    Lambda {
        /// The value.
        lambda: f64,
    },
    /// A window of fewer than two frames has no variance.
    #[error("an outlier window of {window} frame(s) has no variance; take at least 2")]
    Window {
        /// The length.
        window: usize,
    },
    /// Every window is an outlier: the threshold is too low.
    #[error("all {windows} windows vary by more than {threshold:e}: raise the threshold")]
    AllOutliers {
        /// Number of windows.
        windows: usize,
        /// The threshold.
        threshold: f64,
    },
    /// The matrix is not acceptable (lambda overflows).
    #[error(transparent)]
    System(#[from] SystemError),
    /// The backend cannot prepare it.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// The backend cannot solve it.
    #[error(transparent)]
    Solve(#[from] SolveError),
}

/// I + lambda D'D of a sequence of `frames` frames. Fewer than three frames have no second difference: I.
///
/// # Errors
/// [`SmoothingError::Empty`], [`SmoothingError::Lambda`].
pub fn system(frames: usize, lambda: f64) -> Result<System, SmoothingError> {
    if frames == 0 {
        return Err(SmoothingError::Empty);
    }
    if !(lambda >= 0.0 && lambda.is_finite()) {
        return Err(SmoothingError::Lambda { lambda });
    }
    const SECOND: [f64; 3] = [1.0, -2.0, 1.0];
    let (mut starts, mut columns, mut values) = (vec![0], Vec::new(), Vec::new());
    for i in 0..frames {
        for j in i..frames.min(i + SECOND.len()) {
            // Row r of D has its weights at r, r + 1, r + 2.
            let rows = j.saturating_sub(2)..(i + 1).min(frames.saturating_sub(2));
            let product: f64 = rows.map(|r| SECOND[i - r] * SECOND[j - r]).sum();
            columns.push(j as u32);
            values.push(if i == j { 1.0 } else { 0.0 } + lambda * product);
        }
        starts.push(columns.len() as u32);
    }
    Ok(System::new(SymmetricCsr::from_sorted(starts, columns, values), None)?)
}

/// A prepared smoothing: any number of sequences of the same length.
pub struct Smoother {
    factor: Box<dyn Factor>,
    frames: usize,
}

impl Smoother {
    /// Prepares sequences of `frames` frames and at most `columns` angles on `backend`.
    ///
    /// # Errors
    /// [`SmoothingError`].
    ///
    /// # Panics
    /// If `columns` is 0.
    pub fn prepare(
        backend: &dyn Backend,
        frames: usize,
        columns: usize,
        lambda: f64,
    ) -> Result<Self, SmoothingError> {
        let system = system(frames, lambda)?;
        let factor = backend.prepare(&system, &PrepareOptions::columns(columns), &mut |_| {})?;
        Ok(Self { factor, frames })
    }

    /// Smooths `angles` (frames x k, unwrapped: see [`clean`] and [`unwrap`]) into `smooth`, column by column.
    ///
    /// # Errors
    /// [`SmoothingError::NonFinite`] naming the first bad angle; [`SmoothingError::Solve`].
    ///
    /// # Panics
    /// If a shape does not fit what was prepared.
    pub fn solve(
        &mut self,
        angles: Columns<&[f64]>,
        smooth: Columns<&mut [f64]>,
    ) -> Result<Solved, SmoothingError> {
        assert_eq!(angles.n(), self.frames, "angles: one row per frame");
        check_finite(angles)?;
        Ok(self.factor.solve(angles, smooth)?)
    }
}

/// Mean squared second difference over frames and columns, in squared units of the angles: what smoothing lowers.
/// 0 for fewer than three frames.
pub fn roughness(angles: Columns<&[f64]>) -> f64 {
    let k = angles.k();
    let triples = angles.n().saturating_sub(2);
    let second = |f: usize, c: usize| angles.row(f)[c] - 2.0 * angles.row(f + 1)[c] + angles.row(f + 2)[c];
    let sum: f64 =
        (0..triples).flat_map(|f| (0..k).map(move |c| (f, c))).map(|(f, c)| second(f, c).powi(2)).sum();
    sum / ((triples * k).max(1) as f64)
}

fn check_finite(angles: Columns<&[f64]>) -> Result<(), SmoothingError> {
    match angles.data().iter().position(|x| !x.is_finite()) {
        Some(at) => Err(SmoothingError::NonFinite { frame: at / angles.k(), column: at % angles.k() }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registry::{OpenOptions, find};

    fn smooth(a: &[f64], k: usize, lambda: f64) -> Vec<f64> {
        let backend = (find("dense").expect("built in").open)(&OpenOptions::default()).expect("always there");
        let frames = a.len() / k;
        let mut smoother = Smoother::prepare(&*backend, frames, k, lambda).expect("definite");
        let mut b = vec![0.0; a.len()];
        smoother.solve(Columns::new(a, frames, k), Columns::new(&mut b, frames, k)).expect("solves");
        b
    }

    #[test]
    fn lines_stay_and_nothing_changes_without_lambda() {
        let lines: Vec<f64> = (0..50).flat_map(|i| [f64::from(i), 3.0 - 0.5 * f64::from(i)]).collect();
        for lambda in [0.0, 1.0, 1e4] {
            let b = smooth(&lines, 2, lambda);
            assert!(b.iter().zip(&lines).all(|(x, y)| (x - y).abs() < 1e-9), "{lambda}");
        }
        let any: Vec<f64> = (0..40).map(|i| (f64::from(i * i) * 0.3).sin()).collect();
        assert_eq!(smooth(&any, 2, 0.0), any);
        for frames in 1..5 {
            let b = smooth(&any[..frames], 1, 5.0);
            assert!(frames > 2 || b == any[..frames], "{frames}");
        }
    }

    #[test]
    fn the_highest_frequency_shrinks_as_foretold() {
        let zigzag: Vec<f64> = (0..101).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
        for lambda in [0.1, 1.0, 10.0] {
            let b = smooth(&zigzag, 1, lambda);
            let expected = 1.0 / (1.0 + 16.0 * lambda);
            assert!((b[50] - expected).abs() < 1e-9, "{lambda}: {} {expected}", b[50]);
        }
        let b = smooth(&zigzag, 1, 1.0);
        fn view(x: &[f64]) -> Columns<&[f64]> {
            Columns::new(x, 101, 1)
        }
        assert!((roughness(view(&zigzag)) - 16.0).abs() < 1e-12);
        assert!(roughness(view(&b)) < 0.1);
    }

    #[test]
    fn minimises_what_it_says() {
        let a: Vec<f64> = (0..12).map(|i| (f64::from(i) * 1.7).sin()).collect();
        let energy = |b: &[f64]| {
            let near: f64 = a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum();
            near + 2.5 * b.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).powi(2)).sum::<f64>()
        };
        let b = smooth(&a, 1, 2.5);
        for i in 0..12 {
            for step in [-1e-3, 1e-3] {
                let mut other = b.clone();
                other[i] += step;
                assert!(energy(&other) > energy(&b), "{i}");
            }
        }
    }

    #[test]
    fn bad_input_is_named() {
        assert_eq!(system(0, 1.0).map(|_| ()), Err(SmoothingError::Empty));
        assert!(matches!(system(5, -1.0), Err(SmoothingError::Lambda { .. })));
        assert!(matches!(system(5, f64::NAN), Err(SmoothingError::Lambda { .. })));
        assert!(matches!(system(5, 1e308), Err(SmoothingError::System(_))));
        let backend = (find("dense").expect("built in").open)(&OpenOptions::default()).expect("always there");
        let mut smoother = Smoother::prepare(&*backend, 2, 2, 1.0).expect("definite");
        let solved =
            smoother.solve(Columns::new(&[0.0, 1.0, 2.0, f64::NAN], 2, 2), Columns::new(&mut [0.0; 4], 2, 2));
        assert_eq!(solved.map(|_| ()), Err(SmoothingError::NonFinite { frame: 1, column: 1 }));
    }
}
