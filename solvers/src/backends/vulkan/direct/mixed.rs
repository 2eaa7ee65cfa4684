//! `mixed`: sweeps in f32 on the device, residuals in f64 on the CPU, so that devices without f64 reach 1e-9 too
//! (J. H. Wilkinson, "Rounding Errors in Algebraic Processes", 1963, section 3.4).
use super::Method;
use super::frames::Frames;
use crate::backend::Solved;
use crate::backends::framechol::engine::power_of_two;
use crate::backends::framechol::gather::Group;
use crate::columns::Columns;
use crate::error::SolveError;
use crate::sparse::{FullPattern, SymmetricCsr};
use std::sync::atomic::{AtomicU64, Ordering};

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
    matrix: Rows,
    /// Its largest diagonal entry: a lower bound of its norm.
    norm: f64,
    /// n x k for the widest group each: residual, step, solution.
    residual: Vec<f64>,
    step: Vec<f64>,
    solution: Vec<f64>,
}

/// All entries of a symmetric matrix, row by row: threads share the rows.
struct Rows {
    pattern: FullPattern,
    /// Of the stored triangle.
    values: Vec<f64>,
}

impl Rows {
    fn new(matrix: &SymmetricCsr) -> Self {
        Self { pattern: matrix.full_pattern(), values: vec![0.0; matrix.stored()] }
    }

    fn bytes(&self) -> u64 {
        let FullPattern { starts, columns, source } = &self.pattern;
        (4 * (starts.len() + columns.len() + source.len()) + 8 * self.values.len()) as u64
    }

    /// Rows `first..` of b - A x, k columns each; returns the largest absolute value. `b` is those rows of n x `wide`, from its
    /// column `from` on.
    fn residual<const K: usize>(
        &self,
        first: usize,
        (b, wide, from): (&[f64], usize, usize),
        x: &[f64],
        out: &mut [f64],
    ) -> f64 {
        let FullPattern { starts, columns, source } = &self.pattern;
        let (x, mut most) = (x.as_chunks::<K>().0, [0.0_f64; K]);
        for (i, (out, b)) in out.as_chunks_mut::<K>().0.iter_mut().zip(b.chunks_exact(wide)).enumerate() {
            let mut row = *b[from..].first_chunk::<K>().expect("K columns");
            let range = starts[first + i] as usize..starts[first + i + 1] as usize;
            for (&j, &entry) in columns[range.clone()].iter().zip(&source[range]) {
                let (value, x) = (self.values[entry as usize], &x[j as usize]);
                (0..K).for_each(|c| row[c] -= value * x[c]);
            }
            (0..K).for_each(|c| most[c] = larger(most[c], row[c].abs()));
            *out = row;
        }
        most.into_iter().fold(0.0, larger)
    }
}

/// The larger of two numbers that are not negative; NaN wins.
fn larger(a: f64, b: f64) -> f64 {
    if b <= a { a } else { b }
}

/// A largest absolute value found by several threads: the bits of numbers that are not negative are ordered as they are.
struct Largest(AtomicU64);

impl Largest {
    fn add(&self, value: f64) {
        self.0.fetch_max(value.to_bits(), Ordering::Relaxed);
    }

    fn get(self) -> f64 {
        f64::from_bits(self.0.into_inner())
    }
}

impl Method<f32> for Mixed {
    const PLAIN: bool = false;
    const PAIRS: u64 = 2;

    fn new(frames: Frames<f32>, matrix: &SymmetricCsr, values: &[f64], _: usize) -> Self {
        let vector = || vec![0.0; matrix.n() * frames.widest()];
        let (residual, step, solution) = (vector(), vector(), vector());
        let mut mixed = Self { frames, matrix: Rows::new(matrix), norm: 0.0, residual, step, solution };
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
        self.matrix.values.copy_from_slice(values);
        // Diagonal entries are among them, and in a positive definite matrix one is the largest entry.
        self.norm = values.iter().fold(0.0, |most, v| v.max(most));
    }

    fn solve(
        &mut self,
        rhs: Columns<&[f64]>,
        x: &mut Columns<&mut [f64]>,
        group: Group,
    ) -> Result<(bool, Solved), SolveError> {
        let (n, k) = (rhs.n(), group.count);
        let own = Group { from: 0, count: k };
        let (mut residual, mut right_hand_side) = (0.0, 0.0);
        let (mut pairs, mut last_step, mut device_ns) = (0, 0.0, Some(0));
        while pairs < MOST_PAIRS {
            let mut scale = 1.0 / power_of_two(residual);
            if pairs == 0 {
                right_hand_side = self.frames.load(rhs, group, 1.0);
                scale = 1.0 / power_of_two(right_hand_side);
                if !(1.0 / 65_536.0..=65_536.0).contains(&scale) {
                    self.frames.load(rhs, group, scale);
                } else {
                    scale = 1.0; // near enough
                }
                residual = right_hand_side;
            } else {
                self.frames.load(Columns::new(&self.residual[..n * k], n, k), own, scale);
            }
            if !(residual > 0.0 && residual.is_finite()) {
                break;
            }
            device_ns = device_ns.zip(self.frames.run(own)?).map(|(a, b)| a + b);
            let mut step = Columns::new(&mut self.step[..n * k], n, k);
            if !self.frames.store(&mut step, own, self.frames.tables.scale / scale)? {
                residual = f64::NAN;
                break;
            }
            let (step_size, solution);
            (step_size, solution, residual) = self.advance(rhs, group, pairs == 0);
            pairs += 1;
            let backward = residual / (self.norm * solution + right_hand_side);
            let contraction = if pairs == 1 { 1.0 } else { step_size / last_step };
            last_step = step_size;
            if pairs >= 2 && backward <= ENOUGH && contraction * step_size <= SMALL * solution {
                break;
            }
        }
        self.write(x, group, pairs > 0);
        Ok((residual.is_finite(), Solved { iterations: Some(pairs), device_ns, ..Solved::default() }))
    }

    fn extra_bytes(&self) -> (u64, u64) {
        let matrix = self.matrix.bytes();
        (matrix + 24 * self.residual.len() as u64, matrix)
    }
}

impl Mixed {
    /// solution += step (or := the first one), residual := rhs - A solution. Returns their largest absolute values: (step,
    /// solution, residual).
    fn advance(&mut self, rhs: Columns<&[f64]>, group: Group, first: bool) -> (f64, f64, f64) {
        let (n, k, wide) = (rhs.n(), group.count, rhs.k());
        let Self { frames, matrix, residual, step, solution, .. } = self;
        let [steps, solutions, residuals] = [const { Largest(AtomicU64::new(0)) }; 3];
        frames.team.for_each_run(&mut solution[..n * k], k, |rows, solution| {
            let (mut longest, mut most) = (0.0, 0.0);
            for (x, d) in solution.iter_mut().zip(&step[rows.start * k..rows.end * k]) {
                *x = if first { *d } else { *x + d };
                (longest, most) = (larger(longest, d.abs()), larger(most, x.abs()));
            }
            steps.add(longest);
            solutions.add(most);
        });
        frames.team.for_each_run(&mut residual[..n * k], k, |rows, out| {
            let b = (&rhs.slice()[rows.start * wide..rows.end * wide], wide, group.from);
            let (i, x) = (rows.start, &solution[..n * k]);
            residuals.add(match k {
                1 => matrix.residual::<1>(i, b, x, out),
                2 => matrix.residual::<2>(i, b, x, out),
                3 => matrix.residual::<3>(i, b, x, out),
                4 => matrix.residual::<4>(i, b, x, out),
                5 => matrix.residual::<5>(i, b, x, out),
                6 => matrix.residual::<6>(i, b, x, out),
                7 => matrix.residual::<7>(i, b, x, out),
                _ => matrix.residual::<8>(i, b, x, out),
            });
        });
        (steps.get(), solutions.get(), residuals.get())
    }

    /// The solution, or zeros where there is none, to a group of columns of `x`.
    fn write(&mut self, x: &mut Columns<&mut [f64]>, group: Group, solved: bool) {
        let (k, solution, wide) = (group.count, &self.solution, x.k());
        self.frames.team.for_each_run(x.data_mut(), wide, |rows, x| {
            for (x, i) in x.chunks_exact_mut(wide).zip(rows) {
                let x = &mut x[group.from..group.from + k];
                if solved { x.copy_from_slice(&solution[i * k..(i + 1) * k]) } else { x.fill(0.0) }
            }
        });
    }
}
