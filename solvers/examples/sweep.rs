//! How fast the sweeps of framechol read their factor, against what this machine can read at all.
//!
//! ```text
//! cargo run --release -p lapsolve --example sweep -- [icosphere level] [threads] [backend]
//! ```
//! Solves L x = b with three columns on a displaced icosphere (level 7: 327,680 triangles), one vertex grounded, for the
//! mesh's own positions, and prints the time of every phase, the bytes one solve streams, and both rates. The read rate is that of a plain sum
//! over as many bytes, measured right before each backend.
use lapsolve::aligned::zeros;
use lapsolve::backend::{Factor, Phase, PrepareOptions};
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::{self, OpenOptions};
use lapsolve::system::System;
use std::collections::HashMap;
use std::time::Instant;

const BACKENDS: [&str; 3] = ["framechol-f64", "framechol-f32", "framechol-mixed"];
const COLUMNS: usize = 3;
/// Solves per backend; the fastest tenth is averaged, which a busy machine disturbs least.
const SOLVES: usize = 100;

fn main() {
    let argument =
        |at: usize, default| std::env::args().nth(at).map_or(default, |a| a.parse().expect("a number"));
    let (level, threads) = (argument(1, 6), argument(2, 1));
    let mesh = icosphere(level);
    let laplacian = Laplacian::assemble(&mesh, Weights::Plain).into_matrix();
    let problem = Dirichlet::grounded(laplacian, Some(mesh.positions())).expect("a finite Laplacian");
    let system = problem.system().expect("more than one vertex");
    println!(
        "{} triangles, {} unknowns, {COLUMNS} columns, {threads} thread(s)",
        mesh.triangles().len(),
        system.n()
    );
    let ground = mesh.positions()[problem.fixed()[0] as usize];
    let relative = |&v: &u32| [0, 1, 2].map(|i| mesh.positions()[v as usize][i] - ground[i]);
    let x: Vec<f64> = problem.free().iter().flat_map(relative).collect();
    let mut rhs = vec![0.0; x.len()];
    let n = system.n();
    system.matrix().multiply(Columns::new(&x[..], n, COLUMNS), Columns::new(&mut rhs[..], n, COLUMNS));
    let only = std::env::args().nth(3);
    for id in BACKENDS.into_iter().filter(|id| only.as_ref().is_none_or(|only| only == id)) {
        report(id, system, &rhs, threads);
    }
}

fn report(id: &str, system: &System, rhs: &[f64], threads: usize) {
    let entry = registry::find(id).expect("a built-in backend");
    let backend = (entry.open)(&OpenOptions { threads, ..OpenOptions::default() }).expect("always available");
    let mut marks: Vec<(&str, Instant)> = Vec::new();
    let mut factor = backend
        .prepare(system, &PrepareOptions::columns(COLUMNS), &mut |phase| {
            let name = match phase {
                Phase::Order => "order",
                Phase::Symbolic => "symbolic",
                Phase::Numeric => "numeric",
                Phase::Upload => "upload",
            };
            marks.push((name, Instant::now()));
        })
        .expect("a positive definite matrix");
    marks.push(("end", Instant::now()));
    let (seconds, pairs) = fastest(&mut *factor, system, rhs);
    let footprint = factor.footprint();
    let bytes = footprint.bytes_per_solve.expect("a direct backend knows its bytes");
    let read = read_rate(bytes as usize / 2, threads);
    let rate = bytes as f64 / seconds / 1e9;
    print!("{id}: ");
    for pair in marks.windows(2) {
        print!("{} {:.0} ms, ", pair[0].0, (pair[1].1 - pair[0].1).as_secs_f64() * 1e3);
    }
    let pairs = pairs.map_or(String::new(), |pairs| format!(" ({pairs} sweep pairs)"));
    println!(
        "solve {:.3} ms{pairs}; {:.2}M entries, {:.1} MB per solve at {rate:.1} GB/s of {read:.1} GB/s = {:.0}%; holds {:.0} MB",
        seconds * 1e3,
        footprint.factor_nonzeros.unwrap_or(0) as f64 / 1e6,
        bytes as f64 / 1e6,
        100.0 * rate / read,
        footprint.host_bytes.unwrap_or(0) as f64 / 1e6,
    );
}

/// Seconds per solve, and its sweep pairs where they are counted.
fn fastest(factor: &mut dyn Factor, system: &System, rhs: &[f64]) -> (f64, Option<u32>) {
    let n = system.n();
    let mut x = vec![0.0; n * COLUMNS];
    let mut pairs = None;
    let mut times: Vec<f64> = (0..SOLVES)
        .map(|_| {
            let start = Instant::now();
            let solved = factor
                .solve(Columns::new(rhs, n, COLUMNS), Columns::new(&mut x[..], n, COLUMNS))
                .expect("a finite right-hand side");
            pairs = solved.iterations;
            start.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    (times[..SOLVES / 10].iter().sum::<f64>() / (SOLVES / 10) as f64, pairs)
}

/// GB/s of summing `bytes` bytes with `threads` threads: the fastest of ten passes, forwards and backwards like the sweeps.
fn read_rate(bytes: usize, threads: usize) -> f64 {
    let mut data = zeros::<u64>(bytes / 8);
    data.fill(1);
    let pass = |backwards: bool| {
        let start = Instant::now();
        let total: u64 = std::thread::scope(|scope| {
            let parts = data.chunks(data.len().div_ceil(threads));
            let sums: Vec<_> = parts.map(|part| scope.spawn(move || sum(part, backwards))).collect();
            sums.into_iter().map(|s| s.join().expect("a sum")).sum()
        });
        assert_eq!(std::hint::black_box(total), data.len() as u64);
        start.elapsed().as_secs_f64()
    };
    bytes as f64 / (0..10).map(|at| pass(at % 2 == 1)).fold(f64::INFINITY, f64::min) / 1e9
}

/// Eight independent sums, so that loads and not additions are the limit.
fn sum(data: &[u64], backwards: bool) -> u64 {
    let (chunks, rest) = data.as_chunks::<32>();
    let mut lanes = [0_u64; 32];
    let mut add = |chunk: &[u64; 32]| {
        for (lane, v) in lanes.iter_mut().zip(chunk) {
            *lane = lane.wrapping_add(*v);
        }
    };
    if backwards {
        chunks.iter().rev().for_each(&mut add);
    } else {
        chunks.iter().for_each(&mut add);
    }
    lanes.iter().chain(rest).fold(0, |a, v| a.wrapping_add(*v))
}

/// The icosahedron, each triangle cut in four `level` times, on a sphere with smooth bumps.
fn icosphere(level: usize) -> TriangleMesh {
    let g = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut points: Vec<[f64; 3]> = Vec::new();
    for (a, b) in [(-1.0, g), (1.0, g), (-1.0, -g), (1.0, -g)] {
        points.extend([[a, b, 0.0], [0.0, a, b], [b, 0.0, a]]);
    }
    let near =
        |a: [f64; 3], b: [f64; 3]| ((0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>() - 4.0).abs() < 1e-9;
    let volume = |a: [f64; 3], b: [f64; 3], c: [f64; 3]| {
        a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                let [a, b, c] = [points[i], points[j], points[k]];
                if near(a, b) && near(b, c) && near(a, c) {
                    let [j, k] = if volume(a, b, c) > 0.0 { [j, k] } else { [k, j] };
                    triangles.push([i as u32, j as u32, k as u32]);
                }
            }
        }
    }
    for _ in 0..level {
        triangles = refine(&mut points, &triangles);
    }
    for p in &mut points {
        let r = p.iter().map(|x| x * x).sum::<f64>().sqrt();
        let [x, y, z] = p.map(|x| x / r);
        let height = 1.0 + 0.1 * (5.0 * x).sin() * (4.0 * y).cos() + 0.05 * (9.0 * z).sin();
        *p = [x * height, y * height, z * height];
    }
    TriangleMesh::new(points, triangles).expect("a closed sphere")
}

/// Cuts every triangle in four at its edges' midpoints.
fn refine(points: &mut Vec<[f64; 3]>, triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
    let mut finer = Vec::with_capacity(4 * triangles.len());
    for &[a, b, c] in triangles {
        let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(i, j)| {
            *middles.entry((i.min(j), i.max(j))).or_insert_with(|| {
                let (p, q) = (points[i as usize], points[j as usize]);
                let middle: [f64; 3] = std::array::from_fn(|k| p[k] + q[k]);
                let r = middle.iter().map(|x| x * x).sum::<f64>().sqrt();
                points.push(middle.map(|x| x / r));
                points.len() as u32 - 1
            })
        });
        finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    finer
}
