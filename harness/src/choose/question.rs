//! What the user wants to know.

use clap::ValueEnum;
use serde::Serialize;

/// A use of a solver: how often it solves, what changes meanwhile, what it may take.
#[derive(Clone, Debug, Serialize, clap::Args)]
pub struct Question {
    /// What is solved per frame
    #[arg(long, value_name = "WORKLOAD", value_enum, default_value_t = Task::Harmonic)]
    pub workload: Task,
    /// Columns of a right-hand side: 3 for positions, 4 for quaternions
    #[arg(long, value_name = "K", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub columns: u32,
    /// Frames that will be solved; 1 is a single solve
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    pub frames: u64,
    /// What changes between frames besides the right-hand side
    #[arg(long, value_enum, default_value_t = Updates::Never)]
    pub updates: Updates,
    /// Frames from one such change to the next
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    pub update_every: u64,
    /// Largest error of a solution, relative to the largest constraint value (harmonic) or the mesh's diagonal (poisson)
    #[arg(long, value_name = "ERROR", default_value_t = 1e-8, value_parser = fraction)]
    pub accuracy: f64,
    /// Most milliseconds of a frame (change and solve)
    #[arg(long, value_name = "MS", value_parser = milliseconds)]
    pub budget_ms: Option<f64>,
    /// Most memory of the solving process at its peak: 500MB, 2GiB, or bytes
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub max_memory: Option<u64>,
    /// Licences that will do
    #[arg(long, value_enum, default_value_t = Licence::Any)]
    pub licence: Licence,
    /// Whether it runs on a GPU
    #[arg(long, value_enum, default_value_t = Gpu::Any)]
    pub gpu: Gpu,
    /// Threads of a solve [default: all cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Vulkan device: index or part of its name
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<String>,
}

/// What is solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Task {
    /// A harmonic field from values at constrained vertices
    Harmonic,
    /// L x = b, grounded
    Poisson,
}

/// What changes from frame to frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Updates {
    /// The right-hand side alone
    Never,
    /// Ten constrained vertices move elsewhere
    Constraints,
    /// The values of the matrix, on the same pattern
    Values,
}

/// Which licences will do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Licence {
    /// All
    Any,
    /// No copyleft: MIT, Apache, BSD and their kind
    Permissive,
}

/// Where it may run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Gpu {
    /// On a GPU only
    Yes,
    /// On the CPU only
    No,
    /// Wherever it is fastest
    Any,
}

impl Default for Question {
    /// What the command line has without arguments.
    fn default() -> Self {
        Self {
            workload: Task::Harmonic,
            columns: 3,
            frames: 1000,
            updates: Updates::Never,
            update_every: 1,
            accuracy: 1e-8,
            budget_ms: None,
            max_memory: None,
            licence: Licence::Any,
            gpu: Gpu::Any,
            threads: None,
            device: None,
        }
    }
}

impl Question {
    /// Threads of a solve.
    pub fn threads(&self) -> usize {
        self.threads.map_or_else(|| std::thread::available_parallelism().map_or(1, Into::into), usize::from)
    }

    /// The question in a line.
    pub fn sentence(&self) -> String {
        let every = |n: u64| if n == 1 { "every frame".to_owned() } else { format!("every {n} frames") };
        let changes = match self.updates {
            Updates::Never => "nothing but the right-hand side changes".to_owned(),
            Updates::Constraints => format!("ten constraints move {}", every(self.update_every)),
            Updates::Values => format!("the matrix has new values {}", every(self.update_every)),
        };
        let workload = match self.workload {
            Task::Harmonic => "harmonic",
            Task::Poisson => "poisson",
        };
        let (k, n) = (self.columns, self.frames);
        let plural = |n: u64| if n == 1 { "" } else { "s" };
        format!(
            "{workload}, {k} column{}, {n} frame{}, {changes}, error at most {:.0e}, {} thread{}",
            plural(u64::from(k)),
            plural(n),
            self.accuracy,
            self.threads(),
            plural(self.threads() as u64)
        )
    }
}

/// A relative error that can be asked for: below 1 there is no f64 solution, and at 1 zero is one.
fn fraction(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (1e-15..1.0).contains(&value) { Ok(value) } else { Err("must be at least 1e-15 and below 1".into()) }
}

fn milliseconds(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if value > 0.0 && value.is_finite() { Ok(value) } else { Err("must be above 0".into()) }
}

/// A number of bytes with an optional unit, decimal (kB, MB, GB) or binary (KiB, MiB, GiB).
fn bytes(text: &str) -> Result<u64, String> {
    let digits = text.trim().trim_end_matches(|c: char| c.is_ascii_alphabetic()).trim();
    let unit = text.trim()[digits.len()..].trim().to_ascii_lowercase();
    let factor = match unit.as_str() {
        "" | "b" => 1.0,
        "k" | "kb" => 1e3,
        "m" | "mb" => 1e6,
        "g" | "gb" => 1e9,
        "kib" => 1024.0,
        "mib" => 1_048_576.0,
        "gib" => 1_073_741_824.0,
        _ => return Err(format!("`{unit}` is no unit; use kB, MB, GB, KiB, MiB or GiB")),
    };
    let value: f64 = digits.parse().map_err(|_| "not a size, for example 500MB".to_owned())?;
    let size = value * factor;
    if (1.0..1e18).contains(&size) { Ok(size as u64) } else { Err("out of range".to_owned()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_units() {
        assert_eq!(bytes("500MB"), Ok(500_000_000));
        assert_eq!(bytes("1.5 GiB"), Ok(1_610_612_736));
        assert_eq!(bytes("4096"), Ok(4096));
        for wrong in ["", "MB", "-5MB", "5 parsecs", "0", "1e40GB", "nan"] {
            assert!(bytes(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn errors_are_fractions() {
        assert_eq!(fraction("1e-8"), Ok(1e-8));
        for wrong in ["0", "1", "-1e-8", "nan", "inf", "x", "1e-20"] {
            assert!(fraction(wrong).is_err(), "{wrong}");
        }
    }
}
