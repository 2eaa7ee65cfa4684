//! The course of an iterative solve.

use super::clock::nanoseconds;
use super::failed;
use super::prepared::{Handle, Prepared};
use crate::engine::array_file::ArrayFile;
use crate::engine::protocol::{Iterated, Refusal, RefusalKind};
use lapsolve::columns::Columns;
use lapsolve::error::SolveError;
use std::sync::mpsc::{Sender, channel};
use std::time::Instant;

/// Most entries of a course: enough for any picture. Of longer ones every second (fourth, ...) iteration is kept.
const MOST_ENTRIES: usize = 500;

impl Prepared {
    /// `iterate`: see [`crate::engine::protocol::Request::Iterate`].
    pub fn iterate(&mut self, rhs: &ArrayFile) -> Result<Iterated, Refusal> {
        let (b, k) = (self.rhs(rhs)?, rhs.columns);
        let mut x = vec![0.0; self.outputs * k];
        let (b, x) = (Columns::new(&b[..], self.inputs, k), Columns::new(&mut x[..], self.outputs, k));
        let (sender, receiver) = channel();
        let observer = Some(clocked(sender));
        let unsupported = || {
            let message = "has no iterations to report".to_owned();
            Err(Refusal { kind: RefusalKind::Unsupported, message })
        };
        let outcome = match &mut self.handle {
            Handle::System(factor) => {
                if !factor.observe(observer) {
                    return unsupported();
                }
                let outcome = factor.solve(b, x);
                factor.observe(None);
                outcome
            }
            Handle::Harmonic(harmonic) => {
                if !harmonic.observe(observer) {
                    return unsupported();
                }
                let outcome = harmonic.solve(b, x);
                harmonic.observe(None);
                outcome
            }
            Handle::Transfer(_) | Handle::Arap(..) | Handle::Geodesic(_) => return unsupported(),
        };
        match outcome {
            Ok(_) | Err(SolveError::NotConverged { .. }) => Ok(thinned(receiver.iter().collect())),
            Err(error) => Err(failed(error.to_string())),
        }
    }
}

/// Sends every iteration with the time since now.
fn clocked(sender: Sender<(u32, u64, f64)>) -> Box<dyn FnMut(u32, f64) + Send> {
    let start = Instant::now();
    Box::new(move |iteration, residual| {
        // The receiver lives until the solve is over.
        let _ = sender.send((iteration, nanoseconds(start.elapsed()), residual));
    })
}

/// The course with every iteration, or every 2^k-th and the last.
fn thinned(course: Vec<(u32, u64, f64)>) -> Iterated {
    let step = course.len().div_ceil(MOST_ENTRIES).next_power_of_two();
    let last = course.len().saturating_sub(1);
    let mut kept = Iterated::default();
    for (i, (iteration, elapsed, residual)) in course.into_iter().enumerate() {
        if i % step == 0 || i == last {
            kept.iterations.push(iteration);
            kept.elapsed_ns.push(elapsed);
            kept.residuals.push(residual);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_courses_keep_their_ends() {
        for (length, kept) in [(0, 0), (1, 1), (500, 500), (501, 251), (4_000, 501)] {
            let course = thinned((1..=length).map(|i| (i, u64::from(i), 1.0)).collect());
            assert_eq!(course.iterations.len(), kept, "{length}");
            assert_eq!(course.iterations.last().copied(), (length > 0).then_some(length));
        }
    }
}
