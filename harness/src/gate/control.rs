//! The control kernel: fixed work that shares no code with any solver. What moves it is the machine.

use std::hint::black_box;
use std::time::Instant;

/// Numbers in each array of the triad: three arrays of 2 MiB, beyond the second-level cache like the factors under test.
const TRIAD: usize = 1 << 18;

/// Side of the grid whose 5-point matrix is multiplied.
const SIDE: usize = 192;

/// Passes in one repetition: about 1.5 ms, several times a scheduler's wake-up.
const PASSES: usize = 4;

/// Repetitions, of which the median counts, as it does for the solves under test.
const REPETITIONS: usize = 5;

/// Arrays of the kernel, made once.
#[derive(Debug)]
pub struct ControlKernel {
    a: Vec<f64>,
    b: Vec<f64>,
    c: Vec<f64>,
    starts: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<f64>,
    x: Vec<f64>,
    y: Vec<f64>,
}

impl Default for ControlKernel {
    fn default() -> Self {
        let ramp = |n: usize| (0..n).map(|i| (i % 17) as f64).collect::<Vec<f64>>();
        let (starts, columns, values) = five_point(SIDE);
        let n = SIDE * SIDE;
        let (a, y) = (vec![0.0; TRIAD], vec![0.0; n]);
        Self { a, b: ramp(TRIAD), c: ramp(TRIAD), starts, columns, values, x: ramp(n), y }
    }
}

impl ControlKernel {
    /// Median time of a repetition, nanoseconds. About 8 ms in all.
    pub fn time_ns(&mut self) -> f64 {
        let mut times: Vec<f64> = (0..REPETITIONS)
            .map(|_| {
                let begin = Instant::now();
                for _ in 0..PASSES {
                    self.pass();
                }
                begin.elapsed().as_nanos() as f64
            })
            .collect();
        times.sort_by(f64::total_cmp);
        times[REPETITIONS / 2]
    }

    /// a = b + s c, then y = A x.
    fn pass(&mut self) {
        let s = black_box(1.5);
        for ((a, b), c) in self.a.iter_mut().zip(&self.b).zip(&self.c) {
            *a = b + s * c;
        }
        black_box(&self.a);
        for (i, y) in self.y.iter_mut().enumerate() {
            let row = self.starts[i] as usize..self.starts[i + 1] as usize;
            *y = row.map(|k| self.values[k] * self.x[self.columns[k] as usize]).sum();
        }
        black_box(&self.y);
    }
}

/// The 5-point matrix of a `side` x `side` grid by rows: starts, columns, values.
fn five_point(side: usize) -> (Vec<u32>, Vec<u32>, Vec<f64>) {
    let (mut starts, mut columns, mut values) = (vec![0], Vec::new(), Vec::new());
    for i in 0..side {
        for j in 0..side {
            let at = |i: usize, j: usize| (i * side + j) as u32;
            let neighbours = [
                (i > 0).then(|| at(i - 1, j)),
                (j > 0).then(|| at(i, j - 1)),
                (j + 1 < side).then(|| at(i, j + 1)),
                (i + 1 < side).then(|| at(i + 1, j)),
            ];
            columns.push(at(i, j));
            values.push(4.0);
            for column in neighbours.into_iter().flatten() {
                columns.push(column);
                values.push(-1.0);
            }
            starts.push(columns.len() as u32);
        }
    }
    (starts, columns, values)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_computes_what_it_says() {
        let mut kernel = ControlKernel::default();
        kernel.pass();
        assert_eq!(kernel.a[16], 16.0 + 1.5 * 16.0);
        // Inside, x_i = i mod 17 and 192 = 5 mod 17: 4 x - (x - 1) - (x + 1) - (x - 5) - (x + 5) = 0 without a wrap.
        let i = 100 * SIDE + 100;
        let x = |k: usize| (k % 17) as f64;
        assert_eq!(kernel.y[i], 4.0 * x(i) - x(i - 1) - x(i + 1) - x(i - SIDE) - x(i + SIDE));
        assert!(kernel.time_ns() > 1e4);
    }
}
