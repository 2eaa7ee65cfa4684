//! Exit codes: one meaning each, printed on stderr.

use std::fmt;
use std::process::ExitCode;

/// How a command ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Exit {
    /// Everything was done; no cell is in a state below.
    #[default]
    Ok,
    /// A file, an argument or the program failed; or a cell ended in `error` or `oom`; or `--require` is unmet.
    Error,
    /// The command line makes no sense (the argument parser itself ends with the same code).
    Usage,
    /// Slower than allowed: a regression, a cell removed, a counter increased, `--require-hz` missed.
    Regression,
    /// A wrong answer: an `invalid` cell or a failed validation.
    Invalid,
    /// `--strict` only: no statement was possible.
    Inconclusive,
    /// The environments of two results do not match.
    Incomparable,
}

impl Exit {
    /// The code of the process.
    pub fn code(self) -> u8 {
        match self {
            Exit::Ok => 0,
            Exit::Error => 1,
            Exit::Usage => 2,
            Exit::Regression => 3,
            Exit::Invalid => 4,
            Exit::Inconclusive => 5,
            Exit::Incomparable => 6,
        }
    }

    /// The more serious of two: a wrong answer, then a regression, an error, a mismatch, no statement.
    pub fn or(self, other: Self) -> Self {
        let rank = |exit| match exit {
            Exit::Usage => 6,
            Exit::Invalid => 5,
            Exit::Regression => 4,
            Exit::Error => 3,
            Exit::Incomparable => 2,
            Exit::Inconclusive => 1,
            Exit::Ok => 0,
        };
        if rank(other) > rank(self) { other } else { self }
    }
}

impl fmt::Display for Exit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Exit::Ok => "all is well",
            Exit::Error => "an input, a cell or the program failed, or a required backend is missing",
            Exit::Usage => "the command line makes no sense",
            Exit::Regression => "slower than allowed, or a cell or counter got worse",
            Exit::Invalid => "at least one answer is wrong",
            Exit::Inconclusive => "the measurement allows no statement",
            Exit::Incomparable => "the environments do not match",
        })
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        ExitCode::from(exit.code())
    }
}

#[cfg(test)]
mod tests {
    use super::Exit::*;

    #[test]
    fn the_more_serious_outcome_wins() {
        assert_eq!(Ok.or(Error), Error);
        assert_eq!(Error.or(Invalid).or(Ok), Invalid);
        assert_eq!(Regression.or(Error), Regression);
        assert_eq!(Invalid.or(Regression).code(), 4);
    }
}
