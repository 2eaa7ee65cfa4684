use lapsolve::backend::{Factor, PrepareOptions};
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::{self, OpenOptions};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Your mesh: positions and triangles.
    let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 0.1]];
    let mesh = TriangleMesh::new(positions, vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])?;
    let laplacian = Laplacian::assemble(&mesh, Weights::Plain).into_matrix();

    let open = OpenOptions { threads: 1, ..OpenOptions::default() };
    let entry = registry::find("nalgebra-cholesky").ok_or("no such backend")?;
    let backend = (entry.open)(&open)?;
    let options = PrepareOptions::columns(3);

    // Once: one vertex of each component held at zero, and everything that depends on the matrix.
    let grounded = Dirichlet::grounded(laplacian, Some(mesh.positions()))?;
    let mut system = grounded.system().ok_or("no triangle has an area")?.clone();
    let mut factor: Box<dyn Factor> = backend.prepare(&system, &options, &mut |_| {})?;
    let mut weights = system.matrix().values().to_vec(); // entry for entry

    // Every frame: right-hand side in, solution out; row i is vertex `grounded.free()[i]`.
    let n = system.n();
    let (mut rhs, mut x) = (vec![0.0; n * 3], vec![0.0; n * 3]);
    for frame in 0..10 {
        if frame > 0 && frame % 5 == 0 {
            weights.iter_mut().for_each(|w| *w *= 1.01); // your new values, same pattern
            system.update_values(&weights)?;
            factor = backend.prepare(&system, &options, &mut |_| {})?;
        }
        rhs.iter_mut().enumerate().for_each(|(i, b)| *b = f64::from(frame) + i as f64);
        factor.solve(Columns::new(&rhs, n, 3), Columns::new(&mut x[..], n, 3))?;
    }
    println!("{:?}", &x[..3]);
    Ok(())
}
