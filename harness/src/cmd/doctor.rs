//! `doctor`: what makes figures of this machine doubtful and backends unavailable, each with what to do about it.

use super::output::{self, Format};
use super::{Context, Outcome};
use crate::choose::question::Question;
use crate::doctor::finding::Finding;
use crate::doctor::{machine, noise, software, triad, vulkan};
use crate::environment::{Environment, Root, processor_ticks_in};
use crate::exit::Exit;
use crate::report::rows::Rows;
use std::path::PathBuf;
use std::time::Duration;

/// Look at this machine: what makes figures doubtful, what is missing, and what to do
///
/// What it finds is no error: the exit code is 0.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Seconds for the noise floor, an A/A comparison; 0 leaves out everything that is measured
    #[arg(long, value_name = "S", default_value_t = 10.0, value_parser = seconds)]
    seconds: f64,
    /// Folder below which the system's files (/proc, /sys, /usr) are looked for
    #[arg(long, value_name = "FOLDER", default_value = "/", hide = true)]
    root: PathBuf,
    /// Form of the output
    #[arg(long, value_enum, default_value_t)]
    format: Format,
}

fn seconds(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (0.0..=3600.0).contains(&value) { Ok(value) } else { Err("must be between 0 and 3600".to_owned()) }
}

/// Looks and prints. What it finds is no error.
///
/// # Errors
/// Where stdout cannot be written.
pub fn run(args: &Args, context: &Context) -> Outcome {
    let root = Root(args.root.clone());
    let environment = Environment::read_in(&root); // before the measurements make a load of their own
    let mut findings = machine::findings(&root, &environment);
    if args.seconds > 0.0 {
        findings.extend(measured(&root, args.seconds, context));
    }
    findings.extend(vulkan::installed(&root, |name| std::env::var_os(name)));
    findings.extend(vulkan::devices());
    findings.extend(software::backends(&context.backends));
    findings.extend(software::peers());
    findings.push(software::temporary_place());
    output::print(&match args.format {
        Format::Json => serde_json::to_string_pretty(
            &serde_json::json!({ "environment": environment, "findings": findings }),
        )?,
        Format::Human => text(&findings),
        format => rows(&findings).render(format),
    })?;
    Ok(Exit::Ok)
}

/// Bandwidth and noise floor, and how much time was stolen meanwhile.
fn measured(root: &Root, seconds: f64, context: &Context) -> Vec<Finding> {
    let before = processor_ticks_in(root);
    eprintln!("measuring memory bandwidth and, for {seconds} s, the noise floor");
    let threads = std::thread::available_parallelism().map_or(1, Into::into);
    let bandwidth = triad::finding(threads);
    let noise = noise::measure(&Question::default(), &context.backends, Duration::from_secs_f64(seconds));
    vec![bandwidth, noise::finding(noise), machine::steal(before, processor_ticks_in(root))]
}

fn mark(good: Option<bool>) -> &'static str {
    match good {
        Some(true) => "yes",
        Some(false) => "NO",
        None => "",
    }
}

/// For people: what was found, then what to do, each on its own line.
fn text(findings: &[Finding]) -> String {
    let width = findings.iter().map(|f| f.subject.len()).max().unwrap_or(0);
    let line = |f: &Finding| format!("{:3} {:width$}  {}\n", mark(f.good), f.subject, f.found);
    let mut text: String = findings.iter().map(line).collect();
    let bad: Vec<&Finding> = findings.iter().filter(|f| f.good == Some(false)).collect();
    if bad.is_empty() {
        text += "\nNothing to do.\n";
    } else {
        text += "\nWhat to do:\n";
        for finding in bad {
            let remedy = finding.remedy.as_deref().unwrap_or_default();
            text += &format!("  {}: {remedy}\n", finding.subject);
        }
    }
    text
}

fn rows(findings: &[Finding]) -> Rows {
    let mut rows = Rows::new(["what", "good", "found", "what to do"]);
    for f in findings {
        rows.push([&f.subject, mark(f.good), &f.found, f.remedy.as_deref().unwrap_or_default()]);
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn remedies_follow_what_is_bad() {
        let findings = [Finding::new("a", Some(false), "x", "mend it"), Finding::info("b", "y")];
        let text = text(&findings);
        assert!(
            text.contains("NO  a  x\n    b  y\n") && text.ends_with("What to do:\n  a: mend it\n"),
            "{text}"
        );
        assert!(super::text(&findings[1..]).ends_with("Nothing to do.\n"));
    }
}
