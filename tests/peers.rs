//! The installed peers, driven through the harness' own sessions: each solves a system and a harmonic field, and takes
//! new values.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use lapbench::engine::array_file::ArrayFile;
use lapbench::engine::protocol::{
    Described, MatrixFiles, Memory, Prepared, Problem, Request, Timed, VERSION,
};
use lapbench::engine::session::{Failure, Session};
use lapbench::mesh_io;
use lapbench::peers::{self, Peer};
use lapbench::record::names::{Accuracy, Precision, Status};
use lapsolve::backend::PrepareOptions;
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::{self, OpenOptions};
use lapsolve::sparse::SymmetricCsr;
use tests::needs::{self, Need};

const DEADLINE: Duration = Duration::from_secs(60);
const TOLERANCE: f64 = 1e-10;
const COLUMNS: usize = 3;

/// One small problem in both forms, in files, with the solutions that a built-in direct solver finds.
struct Case {
    folder: tempfile::TempDir,
    mesh: TriangleMesh,
    dirichlet: Dirichlet,
    constraints: Vec<f64>,
    field: Vec<f64>,
}

impl Case {
    fn new() -> Self {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../reference/golden/meshes/pieces.obj");
        let mesh = mesh_io::read_mesh(&file).expect("committed mesh").mesh;
        let laplacian = Laplacian::assemble(&mesh, Weights::Plain).into_matrix();
        let fixed = [0, 20, 60, 75];
        let dirichlet = Dirichlet::new(laplacian, None, &fixed).expect("one constraint in each component");
        let constraints: Vec<f64> = (0..fixed.len() * COLUMNS).map(|i| (i as f64 + 1.0).sin()).collect();
        let mut field = vec![0.0; mesh.positions().len() * COLUMNS];
        let oracle = registry::find("dense").expect("a built-in backend");
        let oracle = (oracle.open)(&OpenOptions::default()).expect("always there");
        let mut handle = oracle
            .prepare_harmonic(&dirichlet, &PrepareOptions::columns(COLUMNS), &mut |_| {})
            .expect("well posed");
        let right = Columns::new(&constraints[..], fixed.len(), COLUMNS);
        handle
            .solve(right, Columns::new(&mut field[..], mesh.positions().len(), COLUMNS))
            .expect("well posed");
        Self { folder: tempfile::tempdir().expect("temporary folder"), mesh, dirichlet, constraints, field }
    }

    fn file<T: lapbench::engine::array_file::Number>(
        &self,
        name: &str,
        data: &[T],
        columns: usize,
    ) -> ArrayFile {
        ArrayFile::write(&self.folder.path().join(name), data, columns).expect("temporary folder")
    }

    fn matrix(&self, name: &str, matrix: &SymmetricCsr) -> MatrixFiles {
        MatrixFiles {
            n: matrix.n(),
            row_starts: self.file(&format!("{name}_starts"), matrix.row_starts(), 1),
            columns: self.file(&format!("{name}_columns"), matrix.columns(), 1),
            values: self.file(&format!("{name}_values"), matrix.values(), 1),
        }
    }

    /// L_FF x = b, and the x with sines in it that b is made from.
    fn system(&self) -> (Problem, Vec<f64>, Vec<f64>) {
        let matrix = self.dirichlet.system().expect("free vertices").matrix();
        let x: Vec<f64> = (0..matrix.n() * COLUMNS).map(|i| (i as f64).cos()).collect();
        let problem = Problem::System { matrix: self.matrix("system", matrix), positions: None };
        (problem, x.clone(), multiply(matrix, &x))
    }

    fn harmonic(&self) -> Problem {
        Problem::Harmonic {
            laplacian: self.matrix("laplacian", self.dirichlet.laplacian()),
            positions: Some(self.file("positions", self.mesh.positions().as_flattened(), 3)),
            triangles: Some(self.file("triangles", self.mesh.triangles().as_flattened(), 3)),
            fixed: self.file("fixed", self.dirichlet.fixed(), 1),
        }
    }

    fn solve(&self, session: &mut Session, rhs: &[f64]) -> Result<(Timed, Vec<f64>), Failure> {
        let solution = self.folder.path().join("solution");
        let rhs = self.file("rhs", rhs, COLUMNS);
        let request = Request::Solve { rhs, warmup: 1, times: 3, solution: solution.clone() };
        let timed: Timed = session.ask(request, DEADLINE)?;
        let bytes = std::fs::read(solution).expect("the peer wrote its solution");
        Ok((timed, bytes.as_chunks().0.iter().map(|&number| f64::from_le_bytes(number)).collect()))
    }
}

fn multiply(matrix: &SymmetricCsr, x: &[f64]) -> Vec<f64> {
    let mut product = vec![0.0; x.len()];
    for i in 0..matrix.n() {
        for at in matrix.row_starts()[i] as usize..matrix.row_starts()[i + 1] as usize {
            let (j, value) = (matrix.columns()[at] as usize, matrix.values()[at]);
            for c in 0..COLUMNS {
                product[i * COLUMNS + c] += value * x[j * COLUMNS + c];
                if i != j {
                    product[j * COLUMNS + c] += value * x[i * COLUMNS + c];
                }
            }
        }
    }
    product
}

/// The largest difference; a wrong length or a NaN is infinitely far.
fn distance(x: &[f64], y: &[f64]) -> f64 {
    let differences = x.iter().zip(y).map(|(a, b)| (a - b).abs());
    let worst = differences.fold(0.0, |most: f64, d| if d.is_nan() { f64::INFINITY } else { most.max(d) });
    if x.len() == y.len() { worst } else { f64::INFINITY }
}

fn start(peer: &Peer) -> Result<(Session, Described), String> {
    let mut command = Command::new("sh");
    command.args(["-c", &format!("exec {}", peer.command()?)]);
    let mut session = Session::start(command).map_err(|failure| failure.to_string())?;
    let request = Request::Describe { protocol: VERSION, threads: 1, tolerance: TOLERANCE, device: None };
    match session.ask(request, DEADLINE) {
        Ok(described) => Ok((session, described)),
        Err(failure) if failure.status == Status::Unavailable => Err(failure.to_string()),
        Err(failure) => panic!("{}: {failure}", peer.id),
    }
}

/// Prepares the system; false for a peer that knows harmonic fields only.
fn takes_systems(peer: &Peer, session: &mut Session, case: &Case) -> bool {
    let (problem, _, _) = case.system();
    let answer: Result<Prepared, Failure> =
        session.ask(Request::Prepare { problem, max_columns: COLUMNS }, DEADLINE);
    match answer {
        Ok(prepared) => {
            assert!(prepared.numeric_ns.is_some_and(|ns| ns > 0), "{}: {prepared:?}", peer.id);
            true
        }
        Err(failure) => {
            assert_eq!(
                (failure.status, peer.id.as_str()),
                (Status::Unsupported, "igl-harmonic"),
                "{failure}"
            );
            false
        }
    }
}

/// Solves, takes new values, solves again.
fn check_system(peer: &Peer, session: &mut Session, described: &Described, case: &Case, limit: f64) {
    let id = &peer.id;
    let (_, x, b) = case.system();
    let (timed, solved) = case.solve(session, &b).unwrap_or_else(|failure| panic!("{id}: {failure}"));
    assert_eq!((timed.samples_ns.len(), timed.samples_ns.contains(&0)), (3, false), "{id}");
    assert_eq!(timed.iterations.is_some(), described.accuracy == Accuracy::Iterative, "{id}");
    assert!(distance(&solved, &x) < limit, "{id}: x is off by {:e}", distance(&solved, &x));

    let matrix = case.dirichlet.system().expect("free vertices").matrix();
    let doubled: Vec<f64> = matrix.values().iter().map(|value| 2.0 * value).collect();
    let update = Request::Update { values: case.file("doubled", &doubled, 1), times: 2 };
    let updated: Timed = session.ask(update, DEADLINE).unwrap_or_else(|failure| panic!("{id}: {failure}"));
    assert_eq!(updated.samples_ns.len(), 2, "{id}");
    let (_, halved) = case.solve(session, &b).unwrap_or_else(|failure| panic!("{id}: {failure}"));
    let half: Vec<f64> = x.iter().map(|value| 0.5 * value).collect();
    assert!(
        distance(&halved, &half) < limit,
        "{id}: after an update x is off by {:e}",
        distance(&halved, &half)
    );
}

/// Asks everything of one peer.
fn check(peer: &Peer, mut session: Session, described: &Described, case: &Case) {
    let limit = match (described.precision, described.accuracy) {
        (Precision::F32, _) => 1e-4,
        (_, Accuracy::Iterative) => 1e-7,
        _ => 1e-11,
    };
    assert_eq!(described.protocol, VERSION);
    assert!(described.details.contains_key("version"), "{}: {described:?}", peer.id);
    let id = &peer.id;
    let assembles_itself = !takes_systems(peer, &mut session, case);
    if !assembles_itself {
        check_system(peer, &mut session, described, case, limit);
    }

    let request = Request::Prepare { problem: case.harmonic(), max_columns: COLUMNS };
    match session.ask::<Prepared>(request, DEADLINE) {
        Ok(_) => {}
        // A library that assembles by itself knows no vertices without triangles, of which this case has some.
        Err(failure) if failure.status == Status::Unsupported && assembles_itself => return,
        Err(failure) => panic!("{id}: {failure}"),
    }
    let (_, field) =
        case.solve(&mut session, &case.constraints).unwrap_or_else(|failure| panic!("{id}: {failure}"));
    assert!(
        distance(&field, &case.field) < limit,
        "{id}: the field is off by {:e}",
        distance(&field, &case.field)
    );
    let memory: Memory =
        session.ask(Request::Memory, DEADLINE).unwrap_or_else(|failure| panic!("{id}: {failure}"));
    assert!(memory.peak_rss_bytes.is_some_and(|bytes| bytes > 1 << 20), "{id}: {memory:?}");

    let wrong_shape =
        Request::OpenLoop { hz: 100.0, frames: 2, limit_ns: 1, input: case.file("short", &[1.0], 1) };
    let refused = session.ask::<Timed>(wrong_shape, DEADLINE).expect_err("a right-hand side of one number");
    assert_eq!(refused.status, Status::Error, "{id}: {refused}");
    session.quit();
}

#[test]
fn installed_peers_solve_what_they_are_given() {
    let case = Case::new();
    for peer in peers::catalogue().into_iter().filter(|peer| peer.takes.is_none()) {
        match start(&peer) {
            Ok((session, described)) => check(&peer, session, &described, &case),
            Err(reason) => needs::skip(Need::Peers, &format!("{}: {reason}", peer.id)),
        }
    }
}

/// Every peer that takes a whole pipeline, in a run beside ours: checked there against a refined answer.
#[test]
fn installed_peers_of_pipelines_give_right_answers() {
    for peer in peers::catalogue() {
        let Some(workload) = &peer.takes else { continue };
        match start(&peer) {
            Ok((session, _)) => session.quit(),
            Err(reason) => {
                needs::skip(Need::Peers, &format!("{}: {reason}", peer.id));
                continue;
            }
        }
        let folder = tempfile::tempdir().expect("temporary folder");
        let out = folder.path().join("r.json");
        let arguments = format!(
            "run --quick --mesh sphere:4 --cell-time 0.1 --workload {workload} --backend framechol-f64,{}",
            peer.id
        );
        let output = Command::new(env!("CARGO_BIN_EXE_lapbench-faulty"))
            .args(arguments.split(' '))
            .arg("--out")
            .arg(&out)
            .output()
            .expect("the program starts");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        for cell in lapbench::record::file::read(&out).expect("a result file").cells {
            assert_eq!(cell.status, Status::Ok, "{}: {:?}", cell.backend, cell.reason);
            assert!(cell.accuracy.forward_error.is_some() && cell.solve_ns.p50.is_some(), "{}", cell.backend);
        }
    }
}
