//! `mixed`: sweeps in f32 on the device, residuals in f64 on the CPU, so that devices without f64 reach 1e-9 too
//! (J. H. Wilkinson, "Rounding Errors in Algebraic Processes", 1963, section 3.4).
use super::frames::Frames;
use super::{Method, largest};
use crate::backend::Solved;
use crate::backends::framechol::engine::power_of_two;
use crate::backends::framechol::gather::Group;
use crate::columns::Columns;
use crate::error::SolveError;
use crate::sparse::SymmetricCsr;

/// Most sweep pairs of a solve.
const MOST_PAIRS: u32 = 5;
/// Backward error at which refinement stops: a fifth of what the class promises (5e-12), in a smaller norm of A.
const ENOUGH: f64 = 1e-12;
/// Relative size that the error after the last pair may have, estimated as the last step times the contraction seen: a
/// tenth of what the class promises (2e-9).
const SMALL: f64 = 2e-10;

/// The frames with what refinement needs.
pub struct Mixed {
    frames: Frames<f32>,
    matrix: SymmetricCsr,
    /// Its largest diagonal entry: a lower bound of its norm.
    norm: f64,
    /// n x k for the widest group each: residual, step, A times the step.
    residual: Vec<f64>,
    step: Vec<f64>,
    product: Vec<f64>,
}

impl Method<f32> for Mixed {
    const PAIRS: u64 = 2;

    fn new(frames: Frames<f32>, matrix: &SymmetricCsr, values: &[f64], _: usize) -> Self {
        let vector = || vec![0.0; matrix.n() * frames.widest()];
        let (residual, step, product) = (vector(), vector(), vector());
        let mut mixed = Self { frames, matrix: matrix.clone(), norm: 0.0, residual, step, product };
        mixed.renew(values);
        mixed
    }

    fn frames(&mut self) -> &mut Frames<f32> {
        &mut self.frames
    }

    fn frames_ref(&self) -> &Frames<f32> {
        &self.frames
    }

    fn renew(&mut self, values: &[f64]) {
        self.matrix.values_mut().copy_from_slice(values);
        self.norm = (0..self.matrix.n()).map(|i| self.matrix.diagonal(i)).fold(0.0, f64::max);
    }

    fn solve(
        &mut self,
        rhs: Columns<&[f64]>,
        x: &mut Columns<&mut [f64]>,
        group: Group,
    ) -> Result<(bool, Solved), SolveError> {
        let (n, k) = (self.matrix.n(), group.count);
        let columns = group.from..group.from + k;
        let own = Group { from: 0, count: k };
        for i in 0..n {
            self.residual[i * k..(i + 1) * k].copy_from_slice(&rhs.row(i)[columns.clone()]);
            x.row_mut(i)[columns.clone()].fill(0.0);
        }
        let right_hand_side = largest(rhs, group);
        let (mut residual, mut pairs, mut last_step) = (right_hand_side, 0, 0.0);
        let mut device_ns = Some(0);
        while residual > 0.0 && residual.is_finite() && pairs < MOST_PAIRS {
            let scale = 1.0 / power_of_two(residual);
            self.frames.load(Columns::new(&self.residual[..n * k], n, k), own, scale);
            device_ns = device_ns.zip(self.frames.run(own)?).map(|(a, b)| a + b);
            let mut step = Columns::new(&mut self.step[..n * k], n, k);
            if !self.frames.store(&mut step, own, self.frames.tables.scale / scale)? {
                residual = f64::NAN;
                break;
            }
            pairs += 1;
            let step_size = largest(step.view(), own);
            let solution = self.advance(x, group);
            residual = largest(Columns::new(&self.residual[..n * k], n, k), own);
            let backward = residual / (self.norm * solution + right_hand_side);
            let contraction = if pairs == 1 { 1.0 } else { step_size / last_step };
            last_step = step_size;
            if pairs >= 2 && backward <= ENOUGH && contraction * step_size <= SMALL * solution {
                break;
            }
        }
        Ok((residual.is_finite(), Solved { iterations: Some(pairs), device_ns, ..Solved::default() }))
    }

    fn extra_bytes(&self) -> (u64, u64) {
        let matrix = (12 * self.matrix.stored() + 4 * self.matrix.n()) as u64;
        (matrix + 24 * self.residual.len() as u64, matrix)
    }
}

impl Mixed {
    /// x += step, residual -= A step. Returns max |x|.
    fn advance(&mut self, x: &mut Columns<&mut [f64]>, group: Group) -> f64 {
        let (n, k) = (self.matrix.n(), group.count);
        let step = Columns::new(&self.step[..n * k], n, k);
        self.matrix.multiply(step, Columns::new(&mut self.product[..n * k], n, k));
        for (r, p) in self.residual[..n * k].iter_mut().zip(&self.product) {
            *r -= p;
        }
        let mut most = 0.0_f64;
        for (i, step) in self.step[..n * k].chunks_exact(k).enumerate() {
            for (x, d) in x.row_mut(i)[group.from..].iter_mut().zip(step) {
                *x += d;
                most = most.max(x.abs());
            }
        }
        most
    }
}
