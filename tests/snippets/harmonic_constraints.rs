use lapsolve::backend::{Harmonic, PrepareOptions};
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
    let entry = registry::find("framechol-f64").ok_or("no such backend")?;
    let backend = (entry.open)(&open)?;
    let options = PrepareOptions::columns(3);

    // Once: the constrained vertices, and everything that depends on them and the matrix.
    let mut constrained: Vec<u32> = vec![0, 2];
    let problem = Dirichlet::new(laplacian, Some(mesh.positions()), &constrained)?;
    let mut harmonic: Box<dyn Harmonic> = backend.prepare_harmonic(&problem, &options, &mut |_| {})?;

    // Every frame: values at the constrained vertices in, values at all vertices out.
    let n = mesh.positions().len();
    let mut values = vec![0.0; constrained.len() * 3]; // one row per constrained vertex, ascending
    let mut field = vec![0.0; n * 3];
    for frame in 0..10 {
        if frame > 0 && frame % 2 == 0 {
            // Another vertex instead of one: constraint values go in ascending order of the new set.
            let (from, to) = if constrained.contains(&2) { (2, 1) } else { (1, 2) };
            constrained.retain(|&v| v != from);
            constrained.push(to);
            constrained.sort_unstable();
            harmonic.edit_constraints(&[to], &[from])?;
        }
        values.iter_mut().enumerate().for_each(|(i, v)| *v = f64::from(frame) + i as f64);
        harmonic.solve(Columns::new(&values, constrained.len(), 3), Columns::new(&mut field[..], n, 3))?;
    }
    println!("{:?}", &field[..3]);
    Ok(())
}
