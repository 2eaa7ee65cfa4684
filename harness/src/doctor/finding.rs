//! Something that was looked at.

use serde::Serialize;

/// Something that was looked at.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What.
    pub subject: String,
    /// Whether it is as it should be; null where it cannot be known or is neither.
    pub good: Option<bool>,
    /// What was found; "unknown" where the system does not tell.
    pub found: String,
    /// What to do about it; null unless it is bad.
    pub remedy: Option<String>,
}

impl Finding {
    /// A finding that is good or bad, or of which that is not known.
    pub fn new(subject: &str, good: Option<bool>, found: impl ToString, remedy: &str) -> Self {
        let remedy = (good == Some(false)).then(|| remedy.to_owned());
        Self { subject: subject.to_owned(), good, found: found.to_string(), remedy }
    }

    /// A finding without a judgement.
    pub fn info(subject: &str, found: impl ToString) -> Self {
        Self::new(subject, None, found, "")
    }
}
