//! `doctor`: what makes figures of this machine doubtful and backends unavailable, each with what to do about it.

use super::output::{self, Format};
use super::{Context, Outcome};
use crate::environment::Environment;
use crate::exit::Exit;
use crate::report::rows::Rows;
use lapsolve::registry::OpenOptions;
use serde::Serialize;

/// Look at this machine: what makes figures doubtful, what is missing, and what to do
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Form of the output
    #[arg(long, value_enum, default_value_t)]
    format: Format,
}

/// Something that was looked at.
#[derive(Debug, PartialEq, Eq, Serialize)]
struct Finding {
    subject: String,
    /// Whether it is as it should be; null where it cannot be known.
    good: Option<bool>,
    found: String,
    remedy: Option<String>,
}

/// Looks and prints. What it finds is no error.
///
/// # Errors
/// Where stdout cannot be written.
pub fn run(args: &Args, context: &Context) -> Outcome {
    let environment = Environment::read();
    let mut findings = of_environment(&environment);
    findings.extend(of_backends(context));
    findings.push(of_temporary_place());
    output::print(&match args.format {
        Format::Json => serde_json::to_string_pretty(
            &serde_json::json!({ "environment": environment, "findings": findings }),
        )?,
        format => rows(&findings).render(format),
    })?;
    Ok(Exit::Ok)
}

fn finding(subject: &str, good: Option<bool>, found: impl ToString, remedy: &str) -> Finding {
    let remedy = (good == Some(false)).then(|| remedy.to_owned());
    Finding { subject: subject.to_owned(), good, found: found.to_string(), remedy }
}

/// Load above which somebody else is at work: the program itself has not begun.
const QUIET_LOAD: f64 = 0.5;

/// Least memory for the 300K-triangle cells of the default suite, each under 1 GiB, and the parent.
const ENOUGH_MEMORY: u64 = 4 << 30;

fn of_environment(environment: &Environment) -> Vec<Finding> {
    let (print, info) = (&environment.fingerprint, &environment.info);
    let known = |value: Option<String>| value.unwrap_or_else(|| "unknown".to_owned());
    let release = print.profile.as_deref() == Some("release");
    let governor = info.governor.as_deref();
    vec![
        finding("processor", None, known(print.cpu.clone()), ""),
        finding(
            "build",
            Some(release),
            known(print.profile.clone()),
            "measure with `cargo run --release`; debug builds are many times slower",
        ),
        finding(
            "load",
            info.load1.map(|load| load < QUIET_LOAD),
            known(info.load1.map(|load| format!("{load:.2}"))),
            "other programs are running; end them, or expect noisy and slow figures",
        ),
        finding(
            "governor",
            governor.map(|g| g == "performance"),
            governor.unwrap_or("unknown"),
            "run `sudo cpupower frequency-set -g performance`; otherwise the clock changes while measuring",
        ),
        finding("boost", None, known(info.boost.map(|b| b.to_string())), ""),
        finding(
            "processor time",
            Some(print.cpu_quota.is_none()),
            print.cpu_quota.map_or_else(|| "no quota".to_owned(), |q| format!("a quota of {q} processors")),
            "the container is throttled when it uses more; give it whole processors",
        ),
        finding(
            "virtual machine",
            info.virtual_machine.map(|vm| !vm),
            known(info.virtual_machine.map(|vm| if vm { "yes" } else { "no" }.to_owned())),
            "neighbours share caches and memory; compare only what was measured interleaved",
        ),
        finding(
            "memory",
            info.available_bytes.map(|bytes| bytes >= ENOUGH_MEMORY),
            known(info.available_bytes.map(|bytes| format!("{} MiB available", bytes >> 20))),
            "large meshes need more; cells are then measured in smaller batches",
        ),
    ]
}

fn of_backends(context: &Context) -> Vec<Finding> {
    let look = |entry: &lapsolve::registry::Entry| match (entry.open)(&OpenOptions::default()) {
        Ok(backend) => {
            let found = backend.describe();
            finding(
                &format!("backend {}", entry.id),
                Some(true),
                format!("available on {}", found.device),
                "",
            )
        }
        Err(why) => {
            let what = format!("unavailable: {}", why.what);
            finding(&format!("backend {}", entry.id), Some(false), what, &why.how_to_get_it)
        }
    };
    context.backends.iter().map(look).collect()
}

fn of_temporary_place() -> Finding {
    let place = std::env::temp_dir();
    let works = tempfile::tempfile_in(&place).is_ok();
    let found = format!("{} is {}", place.display(), if works { "writable" } else { "not writable" });
    finding("temporary files", Some(works), found, "set TMPDIR to a writable folder")
}

fn rows(findings: &[Finding]) -> Rows {
    let mut rows = Rows::new(["what", "good", "found", "what to do"]);
    for f in findings {
        let good = match f.good {
            Some(true) => "yes",
            Some(false) => "NO",
            None => "",
        };
        rows.push([&f.subject, good, &f.found, f.remedy.as_deref().unwrap_or_default()]);
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_that_tells_nothing_is_unknown_and_no_panic() {
        let findings = of_environment(&Environment::default());
        assert!(findings.iter().any(|f| f.subject == "governor" && f.good.is_none() && f.found == "unknown"));
        assert!(findings.iter().any(|f| f.subject == "build" && f.good == Some(false) && f.remedy.is_some()));
    }
}
