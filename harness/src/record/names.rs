//! The words of the result file, one enum per vocabulary; [`lapsolve::registry`] and [`lapsolve::backend`] have the
//! same notions without a file format.

use lapsolve::{backend, registry};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Declares an enum whose variants are written as the given words, in files and on the terminal.
macro_rules! vocabulary {
    ($(#[$meta:meta])* $name:ident { $($(#[$doc:meta])* $variant:ident = $word:literal),+ $(,)? }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
        pub enum $name { $($(#[$doc])* #[serde(rename = $word)] $variant),+ }

        impl $name {
            /// The word in files and tables.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $word),+ }
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(self.name())
            }
        }
    };
}

vocabulary! {
    /// How a cell ended.
    #[derive(Default)]
    Status {
        /// Measured, and every checked answer is within the limits of its class.
        Ok = "ok",
        /// An answer is wrong: the row stays and has no time.
        Invalid = "invalid",
        /// The solver says that it did not reach its tolerance.
        NotConverged = "not_converged",
        /// The backend cannot be opened here.
        Unavailable = "unavailable",
        /// The backend does not do this.
        Unsupported = "unsupported",
        /// No answer within the time given to a cell.
        Timeout = "timeout",
        /// Out of memory.
        Oom = "oom",
        /// Anything else: a crash, garbage on the protocol, an unreadable mesh.
        #[default]
        Error = "error",
    }
}

vocabulary! {
    /// What a backend stores its factor in and computes in.
    Precision {
        /// f64 throughout.
        F64 = "f64",
        /// f32 store, f64 residuals and corrections.
        Mixed = "mixed",
        /// f32 store, one pass.
        F32 = "f32",
    }
}

vocabulary! {
    /// What the answers are held to.
    Accuracy {
        /// To the precision of the class.
        Direct = "direct",
        /// To the tolerance asked for.
        Iterative = "iterative",
    }
}

vocabulary! {
    /// Kind of method.
    Family {
        /// Factors the matrix, on the CPU.
        Direct = "direct",
        /// Iterates, on the CPU.
        Iterative = "iterative",
        /// Runs on a Vulkan device.
        Gpu = "gpu",
    }
}

vocabulary! {
    /// Kind of device; software Vulkan is never ranked with real GPUs.
    DeviceType {
        /// The process' own cores.
        Cpu = "cpu",
        /// A Vulkan driver that computes on the CPU.
        SoftwareVulkan = "software-vulkan",
        /// A GPU that shares the CPU's memory.
        Integrated = "integrated",
        /// A GPU with memory of its own.
        Discrete = "discrete",
    }
}

vocabulary! {
    /// Who chose a solver's settings; the two kinds of row are told apart wherever solvers are ranked.
    Division {
        /// Somebody chose them for this kind of work: an ordering, an interface, parameters. All backends of this program.
        Open = "open",
        /// The library's documented defaults; only the problem itself (positive definite, tolerance, threads) is said.
        Closed = "closed",
    }
}

impl From<registry::Precision> for Precision {
    fn from(precision: registry::Precision) -> Self {
        match precision {
            registry::Precision::F64 => Self::F64,
            registry::Precision::Mixed => Self::Mixed,
            registry::Precision::F32 => Self::F32,
        }
    }
}

impl From<Precision> for registry::Precision {
    fn from(precision: Precision) -> Self {
        match precision {
            Precision::F64 => Self::F64,
            Precision::Mixed => Self::Mixed,
            Precision::F32 => Self::F32,
        }
    }
}

impl From<registry::Accuracy> for Accuracy {
    fn from(accuracy: registry::Accuracy) -> Self {
        match accuracy {
            registry::Accuracy::Direct => Self::Direct,
            registry::Accuracy::Iterative => Self::Iterative,
        }
    }
}

impl From<Accuracy> for registry::Accuracy {
    fn from(accuracy: Accuracy) -> Self {
        match accuracy {
            Accuracy::Direct => Self::Direct,
            Accuracy::Iterative => Self::Iterative,
        }
    }
}

impl From<registry::Family> for Family {
    fn from(family: registry::Family) -> Self {
        match family {
            registry::Family::Direct => Self::Direct,
            registry::Family::Iterative => Self::Iterative,
            registry::Family::Gpu => Self::Gpu,
        }
    }
}

impl From<backend::DeviceType> for DeviceType {
    fn from(device: backend::DeviceType) -> Self {
        match device {
            backend::DeviceType::Cpu => Self::Cpu,
            backend::DeviceType::SoftwareVulkan => Self::SoftwareVulkan,
            backend::DeviceType::Integrated => Self::Integrated,
            backend::DeviceType::Discrete => Self::Discrete,
        }
    }
}
