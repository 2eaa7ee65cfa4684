//! The lines that put the choice into a program.

use super::figures::Figures;
use super::question::{Question, Task, Updates};
use std::path::PathBuf;

/// The folder of lapsolve, where this program was built from and it still exists.
fn source_folder() -> Option<PathBuf> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../solvers"));
    folder.canonicalize().ok()
}

/// The cargo feature of lapsolve that a built-in backend needs beyond the defaults, if any, and those it can do without.
fn features(backend: &str) -> &'static str {
    let optional = ["faer", "nalgebra", "sprs-ldl", "sprs", "vulkan"];
    match optional.iter().find(|feature| backend == **feature || backend.starts_with(&format!("{feature}-")))
    {
        Some(&"faer") => r#", default-features = false, features = ["faer"]"#,
        Some(&"nalgebra") => r#", default-features = false, features = ["nalgebra"]"#,
        Some(&"sprs-ldl") => r#", default-features = false, features = ["sprs-ldl"]"#,
        Some(&"sprs") => r#", default-features = false, features = ["sprs"]"#,
        Some(_) => r#", default-features = false, features = ["vulkan"]"#,
        None => ", default-features = false",
    }
}

/// What goes under `[dependencies]` of Cargo.toml.
pub fn dependency(backend: &str) -> String {
    let features = features(backend);
    match source_folder() {
        Some(folder) => format!("lapsolve = {{ path = {:?}{features} }}", folder.display().to_string()),
        None => {
            format!("# the folder `solvers` of your checkout:\nlapsolve = {{ path = \"solvers\"{features} }}")
        }
    }
}

/// A whole program that prepares the backend and solves frames as the question has them.
pub fn program(choice: &Figures, question: &Question) -> String {
    let (imports, body) = match question.workload {
        Task::Harmonic => (
            "use lapsolve::backend::{Harmonic, PrepareOptions};\nuse lapsolve::columns::Columns;\nuse lapsolve::dirichlet::Dirichlet;\n",
            harmonic(choice, question),
        ),
        Task::Poisson => (
            "use lapsolve::backend::{Factor, PrepareOptions};\nuse lapsolve::columns::Columns;\nuse lapsolve::dirichlet::Dirichlet;\n",
            poisson(choice, question),
        ),
    };
    format!(
        "{imports}use lapsolve::laplacian::{{Laplacian, Weights}};
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::{{self, OpenOptions}};

fn main() -> Result<(), Box<dyn std::error::Error>> {{
    // Your mesh: positions and triangles.
    let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 0.1]];
    let mesh = TriangleMesh::new(positions, vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])?;
    let laplacian = Laplacian::assemble(&mesh, Weights::Plain).into_matrix();

    let open = OpenOptions {{ {} }};
    let entry = registry::find({:?}).ok_or(\"no such backend\")?;
    let backend = (entry.open)(&open)?;
    let options = PrepareOptions::columns({});

{body}    Ok(())
}}
",
        open_options(choice, question),
        choice.backend,
        question.columns,
    )
}

fn open_options(choice: &Figures, question: &Question) -> String {
    let tolerance = choice.tolerance.map_or_else(String::new, |t| format!("tolerance: {t:e}, "));
    format!("threads: {}, {tolerance}..OpenOptions::default()", question.threads())
}

/// The condition under which a change is due.
fn when_due(question: &Question) -> String {
    match question.update_every {
        1 => "if frame > 0".to_owned(),
        every => format!("if frame > 0 && frame % {every} == 0"),
    }
}

fn harmonic(choice: &Figures, question: &Question) -> String {
    let k = question.columns;
    let when = when_due(question);
    let mutable = |yes: bool| if yes { "mut " } else { "" };
    let (state, change) = match (question.updates, choice.cost.prepares_anew) {
        (Updates::Never, _) => (String::new(), String::new()),
        (Updates::Values, false) => (
            "    let mut weights = problem.laplacian().values().to_vec(); // entry for entry\n".to_owned(),
            format!(
                "        {when} {{\n            weights.iter_mut().for_each(|w| *w *= 1.01); // your new values, same pattern\n            harmonic.update_values(&weights, &mut |_| {{}})?;\n        }}\n"
            ),
        ),
        (Updates::Values, true) => (
            "    let mut weights = problem.laplacian().values().to_vec(); // entry for entry\n".to_owned(),
            format!(
                "        {when} {{\n            weights.iter_mut().for_each(|w| *w *= 1.01); // your new values, same pattern\n            problem.update_values(&weights)?;\n            harmonic = backend.prepare_harmonic(&problem, &options, &mut |_| {{}})?;\n        }}\n"
            ),
        ),
        (Updates::Constraints, anew) => {
            let change = if anew {
                "            let problem = Dirichlet::new(laplacian.clone(), Some(mesh.positions()), &constrained)?;\n            harmonic = backend.prepare_harmonic(&problem, &options, &mut |_| {})?;\n"
            } else {
                "            harmonic.edit_constraints(&[to], &[from])?;\n"
            };
            (
                String::new(),
                format!(
                    "        {when} {{\n            // Another vertex instead of one: constraint values go in ascending order of the new set.\n            let (from, to) = if constrained.contains(&2) {{ (2, 1) }} else {{ (1, 2) }};\n            constrained.retain(|&v| v != from);\n            constrained.push(to);\n            constrained.sort_unstable();\n{change}        }}\n"
                ),
            )
        }
    };
    let anew = question.updates != Updates::Never && choice.cost.prepares_anew;
    let clone = if question.updates == Updates::Constraints && anew { ".clone()" } else { "" };
    format!(
        "    // Once: the constrained vertices, and everything that depends on them and the matrix.
    let {}constrained: Vec<u32> = vec![0, 2];
    let {}problem = Dirichlet::new(laplacian{clone}, Some(mesh.positions()), &constrained)?;
    let mut harmonic: Box<dyn Harmonic> = backend.prepare_harmonic(&problem, &options, &mut |_| {{}})?;
{state}
    // Every frame: values at the constrained vertices in, values at all vertices out.
    let n = mesh.positions().len();
    let mut values = vec![0.0; constrained.len() * {k}]; // one row per constrained vertex, ascending
    let mut field = vec![0.0; n * {k}];
    for frame in 0..10 {{
{change}        values.iter_mut().enumerate().for_each(|(i, v)| *v = f64::from(frame) + i as f64);
        harmonic.solve(Columns::new(&values, constrained.len(), {k}), Columns::new(&mut field[..], n, {k}))?;
    }}
    println!(\"{{:?}}\", &field[..{k}]);
",
        mutable(question.updates == Updates::Constraints),
        mutable(question.updates == Updates::Values && anew),
    )
}

fn poisson(choice: &Figures, question: &Question) -> String {
    let k = question.columns;
    let when = when_due(question);
    let (state, change) = match (question.updates, choice.cost.prepares_anew) {
        (Updates::Values, anew) => {
            let update = if anew {
                "            system.update_values(&weights)?;\n            factor = backend.prepare(&system, &options, &mut |_| {})?;\n"
            } else {
                "            factor.update_values(&weights, &mut |_| {})?;\n"
            };
            (
                "    let mut weights = system.matrix().values().to_vec(); // entry for entry\n".to_owned(),
                format!(
                    "        {when} {{\n            weights.iter_mut().for_each(|w| *w *= 1.01); // your new values, same pattern\n{update}        }}\n"
                ),
            )
        }
        _ => (String::new(), String::new()),
    };
    let mutable = if question.updates == Updates::Values && choice.cost.prepares_anew { "mut " } else { "" };
    format!(
        "    // Once: one vertex of each component held at zero, and everything that depends on the matrix.
    let grounded = Dirichlet::grounded(laplacian, Some(mesh.positions()))?;
    let {mutable}system = grounded.system().ok_or(\"no triangle has an area\")?.clone();
    let mut factor: Box<dyn Factor> = backend.prepare(&system, &options, &mut |_| {{}})?;
{state}
    // Every frame: right-hand side in, solution out; row i is vertex `grounded.free()[i]`.
    let n = system.n();
    let (mut rhs, mut x) = (vec![0.0; n * {k}], vec![0.0; n * {k}]);
    for frame in 0..10 {{
{change}        rhs.iter_mut().enumerate().for_each(|(i, b)| *b = f64::from(frame) + i as f64);
        factor.solve(Columns::new(&rhs, n, {k}), Columns::new(&mut x[..], n, {k}))?;
    }}
    println!(\"{{:?}}\", &x[..{k}]);
"
    )
}
