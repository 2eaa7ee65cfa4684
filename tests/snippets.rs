//! The programs that `choose` prints: each stands here as a file, is compiled with these tests, and runs.
//!
//! `LAPBENCH_UPDATE_SNIPPETS=1` writes the files anew.

use lapbench::choose::cost::Cost;
use lapbench::choose::figures::Figures;
use lapbench::choose::question::{Question, Task, Updates};
use lapbench::choose::snippet;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Declares the programs as modules and the list of them.
macro_rules! programs {
    ($($name:ident: $backend:literal, $tolerance:expr, $workload:ident, $updates:ident, $every:literal, $anew:literal;)+) => {
        $(mod $name {
            include!(concat!("snippets/", stringify!($name), ".rs"));
            pub fn run() -> Result<(), Box<dyn std::error::Error>> {
                main()
            }
        })+

        const PROGRAMS: &[Program] = &[$(Program {
            name: stringify!($name),
            backend: $backend,
            tolerance: $tolerance,
            workload: Task::$workload,
            updates: Updates::$updates,
            update_every: $every,
            prepares_anew: $anew,
            run: $name::run,
        }),+];
    };
}

struct Program {
    name: &'static str,
    backend: &'static str,
    tolerance: Option<f64>,
    workload: Task,
    updates: Updates,
    update_every: u64,
    prepares_anew: bool,
    run: fn() -> Result<(), Box<dyn std::error::Error>>,
}

programs! {
    harmonic_never: "framechol-f64", None, Harmonic, Never, 1, false;
    harmonic_values: "framechol-mixed", None, Harmonic, Values, 1, false;
    harmonic_values_anew: "cg-jacobi", Some(5e-9), Harmonic, Values, 3, true;
    harmonic_constraints: "framechol-f64", None, Harmonic, Constraints, 2, false;
    harmonic_constraints_anew: "faer-llt", None, Harmonic, Constraints, 1, true;
    poisson_never: "cg-multigrid", Some(1e-8), Poisson, Never, 1, false;
    poisson_values: "framechol-f64", None, Poisson, Values, 1, false;
    poisson_values_anew: "nalgebra-cholesky", None, Poisson, Values, 5, true;
}

impl Program {
    fn text(&self) -> String {
        let question = Question {
            workload: self.workload,
            updates: self.updates,
            update_every: self.update_every,
            threads: Some(1),
            ..Question::default()
        };
        let choice = Figures {
            backend: self.backend.to_owned(),
            cost: Cost { prepares_anew: self.prepares_anew, ..Cost::default() },
            tolerance: self.tolerance,
            ..Figures::default()
        };
        snippet::program(&choice, &question)
    }

    fn path(&self) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("snippets").join(format!("{}.rs", self.name))
    }
}

#[test]
fn what_is_compiled_here_is_what_is_printed() {
    for program in PROGRAMS {
        if std::env::var_os("LAPBENCH_UPDATE_SNIPPETS").is_some() {
            std::fs::write(program.path(), program.text()).expect("written");
        }
        let stored = std::fs::read_to_string(program.path()).expect("text");
        assert_eq!(stored, program.text(), "{}: run with LAPBENCH_UPDATE_SNIPPETS=1", program.name);
        let id = format!("registry::find({:?})", program.backend);
        assert!(stored.contains(&id), "{} does not use {id}", program.name);
    }
}

#[test]
fn every_program_runs() {
    for program in PROGRAMS {
        (program.run)().unwrap_or_else(|error| panic!("{}: {error}", program.name));
    }
}

/// A new project of the printed lines alone, compiled by cargo without the network.
#[test]
fn the_printed_project_compiles() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let program = &PROGRAMS[0];
    let manifest = format!(
        "[package]\nname = \"chosen\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n[dependencies]\n{}\n",
        snippet::dependency(program.backend)
    );
    std::fs::create_dir(folder.path().join("src")).expect("a folder");
    std::fs::write(folder.path().join("Cargo.toml"), manifest).expect("written");
    std::fs::write(folder.path().join("src/main.rs"), program.text()).expect("written");
    // The versions of this workspace, which are at hand.
    let lock = Path::new(env!("CARGO_MANIFEST_DIR")).join("../Cargo.lock");
    std::fs::copy(lock, folder.path().join("Cargo.lock")).expect("copied");
    let output = Command::new(env!("CARGO"))
        .args(["check", "--offline", "--quiet"])
        .current_dir(folder.path())
        .env("CARGO_TARGET_DIR", Path::new(env!("CARGO_TARGET_TMPDIR")).join("chosen"))
        .output()
        .expect("cargo starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Every backend of the registry that is behind a feature names it in its dependency line.
#[test]
fn features_are_named() {
    for entry in lapsolve::registry::BACKENDS {
        let line = snippet::dependency(entry.id);
        let feature =
            ["faer", "nalgebra", "sprs-ldl", "sprs", "vulkan"].iter().find(|f| entry.id.starts_with(**f));
        match feature {
            Some(feature) => assert!(line.contains(&format!("features = [\"{feature}\"]")), "{line}"),
            None => assert!(line.contains("default-features = false }"), "{line}"),
        }
    }
}
