//! Records what the program is built from and with, for the environment in every result file.

use std::env;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=src");
    println!("cargo::rerun-if-changed=../solvers/src");
    println!("cargo::rerun-if-changed=../Cargo.lock");
    if let Some(log) = output("git", &["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo::rerun-if-changed={log}");
    }
    let rustc = env::var("RUSTC").unwrap_or_else(|_| "rustc".into());
    let flags = env::var("CARGO_ENCODED_RUSTFLAGS").unwrap_or_default().replace('\u{1f}', " ");
    record("RUSTC", output(&rustc, &["--version"]));
    record("COMMIT", output("git", &["describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]));
    record("RUSTFLAGS", Some(flags));
    record("PROFILE", env::var("PROFILE").ok());
    record("TARGET", env::var("TARGET").ok());
}

/// Hands a value to the compiler; an unknown one is the empty string.
fn record(name: &str, value: Option<String>) {
    println!("cargo::rustc-env=LAPBENCH_{name}={}", value.unwrap_or_default());
}

fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?.trim().to_owned();
    (output.status.success() && !text.is_empty()).then_some(text)
}
