//! What rules a backend out, with the reason.

use super::figures::Figures;
use super::question::{Gpu, Licence, Question};
use crate::record::names::{DeviceType, Family};
use lapsolve::registry::{Entry, OpenOptions};
use serde::Serialize;

/// A backend that is out.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Exclusion {
    /// Its name.
    pub backend: String,
    /// What rules it out.
    pub rule: Rule,
    /// Why, in words.
    pub reason: String,
}

/// What rules a backend out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rule {
    /// It cannot be opened here.
    Unavailable,
    /// Its licence.
    Licence,
    /// It runs on a GPU, or does not.
    Gpu,
    /// The system is too large for it.
    Size,
    /// It failed or gave a wrong answer.
    Failure,
    /// Its error is too large.
    Accuracy,
    /// Its process needs too much memory.
    Memory,
    /// A frame takes too long.
    Deadline,
    /// It was stopped because it already cost more than a better one does in all.
    Cost,
}

impl Rule {
    /// The word in tables.
    pub fn name(self) -> &'static str {
        match self {
            Rule::Unavailable => "unavailable",
            Rule::Licence => "licence",
            Rule::Gpu => "gpu",
            Rule::Size => "size",
            Rule::Failure => "failure",
            Rule::Accuracy => "accuracy",
            Rule::Memory => "memory",
            Rule::Deadline => "deadline",
            Rule::Cost => "cost",
        }
    }
}

impl Exclusion {
    /// `backend` is out by `rule`.
    pub fn new(backend: &str, rule: Rule, reason: impl Into<String>) -> Self {
        Self { backend: backend.to_owned(), rule, reason: reason.into() }
    }
}

/// Licences without copyleft that libraries of this field use.
const PERMISSIVE: [&str; 10] = [
    "MIT",
    "Apache-2.0",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "ISC",
    "Zlib",
    "BSL-1.0",
    "Unlicense",
    "0BSD",
    "CC0-1.0",
];

/// Whether an SPDX expression can be fulfilled by permissive licences alone: one alternative of every `AND` part.
/// Parentheses and `WITH` exceptions are not understood and count as not permissive.
pub fn is_permissive(spdx: &str) -> bool {
    let permissive = |name: &str| PERMISSIVE.contains(&name.trim());
    spdx.split(" OR ").any(|alternative| alternative.split(" AND ").all(permissive))
}

/// What can be said before anything is measured. `unknowns` is the order of the system.
///
/// # Errors
/// Why the backend is out.
pub fn before(entry: &Entry, question: &Question, unknowns: usize) -> Result<(), Exclusion> {
    let out = |rule, reason: String| Err(Exclusion::new(entry.id, rule, reason));
    if question.licence == Licence::Permissive && !is_permissive(entry.licence) {
        return out(Rule::Licence, format!("{} is not permissive", entry.licence));
    }
    match (question.gpu, Family::from(entry.family)) {
        (Gpu::No, Family::Gpu) => return out(Rule::Gpu, "runs on a GPU".into()),
        (Gpu::Yes, Family::Direct | Family::Iterative) => return out(Rule::Gpu, "runs on the CPU".into()),
        _ => {}
    }
    if let Some(most) = entry.max_unknowns.filter(|&most| unknowns > most) {
        return out(Rule::Size, format!("takes at most {most} unknowns, these are {unknowns}"));
    }
    let options = OpenOptions {
        threads: question.threads(),
        tolerance: question.accuracy,
        device: question.device.as_deref(),
    };
    match (entry.open)(&options) {
        Err(why) => out(Rule::Unavailable, why.to_string()),
        Ok(backend) => match DeviceType::from(backend.describe().device_type) {
            DeviceType::SoftwareVulkan => {
                let device = backend.describe().device;
                out(Rule::Gpu, format!("{device} is no GPU: this driver computes on the CPU"))
            }
            _ => Ok(()),
        },
    }
}

/// Whether the error is small enough.
///
/// # Errors
/// Both numbers, where it is not.
pub fn accuracy(figures: &Figures, question: &Question) -> Result<(), Exclusion> {
    figures.error.filter(|&error| error > question.accuracy).map_or(Ok(()), |error| {
        let reason = format!("error {error:.1e}, {:.0e} asked for", question.accuracy);
        Err(Exclusion::new(&figures.backend, Rule::Accuracy, reason))
    })
}

/// What measured or predicted figures say.
///
/// # Errors
/// Why the backend is out.
pub fn after(figures: &Figures, question: &Question) -> Result<(), Exclusion> {
    accuracy(figures, question)?;
    let out = |rule, reason: String| Err(Exclusion::new(&figures.backend, rule, reason));
    if let (Some(peak), Some(most)) = (figures.peak_bytes, question.max_memory)
        && peak > most
    {
        let [peak, most] = [peak, most].map(|b| b as f64 * 1e-6);
        return out(Rule::Memory, format!("{peak:.0} MB at its peak, {most:.0} MB allowed"));
    }
    let frame = figures.cost.longest_frame(question) * 1e-6;
    match question.budget_ms {
        Some(budget) if frame > budget => {
            out(Rule::Deadline, format!("a frame takes {frame:.3} ms, {budget} ms allowed"))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::choose::cost::{Cost, tests::question};
    use crate::choose::question::Updates;
    use lapsolve::registry::{BACKENDS, find};

    #[test]
    fn licences() {
        for yes in ["MIT", "MIT OR Apache-2.0", "LGPL-2.1 OR MIT", "MIT AND BSD-3-Clause"] {
            assert!(is_permissive(yes), "{yes}");
        }
        for no in ["LGPL-2.1", "GPL-2.0-or-later", "MIT AND LGPL-2.1", "MPL-2.0", ""] {
            assert!(!is_permissive(no), "{no}");
        }
        let copyleft: Vec<_> = BACKENDS.iter().filter(|e| !is_permissive(e.licence)).map(|e| e.id).collect();
        assert_eq!(copyleft, ["sprs-ldl"]);
    }

    #[test]
    fn what_is_known_beforehand_rules_out() {
        let rule =
            |id: &str, question: &Question, n| before(find(id).unwrap(), question, n).map_err(|e| e.rule);
        let any = question(Updates::Never, 1);
        assert_eq!(rule("framechol-f64", &any, 1_000_000), Ok(()));
        assert_eq!(rule("dense", &any, 1_000_000), Err(Rule::Size));
        let permissive = Question { licence: Licence::Permissive, ..any.clone() };
        assert_eq!(rule("sprs-ldl", &permissive, 10), Err(Rule::Licence));
        assert_eq!(rule("framechol-f64", &Question { gpu: Gpu::Yes, ..any }, 10), Err(Rule::Gpu));
    }

    #[test]
    fn figures_rule_out_with_both_numbers() {
        let figures = Figures {
            backend: "a".into(),
            cost: Cost { set_up: 1e8, first: 2e6, solve: 2e6, change: 1e6, prepares_anew: false },
            error: Some(1e-6),
            peak_bytes: Some(600_000_000),
            ..Figures::default()
        };
        let base = Question { accuracy: 1e-5, ..question(Updates::Values, 10) };
        let rule = |question: Question| after(&figures, &question).map_err(|e| e.rule);
        assert_eq!(rule(base.clone()), Ok(()));
        assert_eq!(rule(Question { accuracy: 1e-8, ..base.clone() }), Err(Rule::Accuracy));
        assert_eq!(rule(Question { max_memory: Some(500_000_000), ..base.clone() }), Err(Rule::Memory));
        assert_eq!(rule(Question { budget_ms: Some(2.5), ..base.clone() }), Err(Rule::Deadline));
        assert_eq!(rule(Question { budget_ms: Some(2.5), updates: Updates::Never, ..base }), Ok(()));
    }
}
