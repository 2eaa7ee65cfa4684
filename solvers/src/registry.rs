//! The one list of built-in backends. Command line, tests and documents read it; there is no other.

use crate::backend::Backend;
use crate::backends;
use crate::error::Unavailable;
use crate::limits::DEFAULT_TOLERANCE;

/// One backend: its static facts and how to open it.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// The name users type.
    pub id: &'static str,
    /// What kind of method it is.
    pub family: Family,
    /// What it computes in.
    pub precision: Precision,
    /// What its answers may be held to.
    pub accuracy: Accuracy,
    /// SPDX expression of the library that does the work.
    pub licence: &'static str,
    /// Whether a solve starts from the incoming x.
    pub warm_start: bool,
    /// The largest system it takes, in unknowns; beyond that it is a textbook method and the row says `unsupported`.
    pub max_unknowns: Option<usize>,
    /// Opens it, or says what is missing.
    pub open: fn(&OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable>,
}

/// Kind of method.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Family {
    /// Factors the matrix, on the CPU.
    Direct,
    /// Iterates, on the CPU.
    Iterative,
    /// Runs on a Vulkan device.
    Gpu,
}

/// What a backend stores its factor in and computes in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Precision {
    /// f64 throughout.
    F64,
    /// f32 store, f64 residuals and corrections.
    Mixed,
    /// f32 store, one pass: display precision.
    F32,
}

/// What the answers may be held to ([`crate::limits`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Accuracy {
    /// To the precision of its class.
    Direct,
    /// To the tolerance asked for.
    Iterative,
}

/// How to open a backend.
#[derive(Clone, Copy, Debug)]
pub struct OpenOptions<'a> {
    /// Threads a solve may use (>= 1).
    pub threads: usize,
    /// Relative residual at which an iterative backend stops.
    pub tolerance: f64,
    /// Vulkan device by index or part of its name; `None`: the first suitable one.
    pub device: Option<&'a str>,
}

impl Default for OpenOptions<'_> {
    fn default() -> Self {
        Self { threads: 1, tolerance: DEFAULT_TOLERANCE, device: None }
    }
}

/// The opener of a backend behind a cargo feature, or one that says which feature is missing.
macro_rules! gated {
    ($feature:literal, $open:path) => {{
        #[cfg(feature = $feature)]
        {
            $open
        }
        #[cfg(not(feature = $feature))]
        {
            |_: &OpenOptions<'_>| Err(Unavailable::feature($feature))
        }
    }};
}

/// A direct f64 method on the CPU; rows below change what differs.
const DIRECT: Entry = Entry {
    id: "",
    family: Family::Direct,
    precision: Precision::F64,
    accuracy: Accuracy::Direct,
    licence: "MIT OR Apache-2.0",
    warm_start: false,
    max_unknowns: None,
    open: |_| Err(Unavailable::feature("")),
};

/// An iterative f64 method on the CPU.
const ITERATIVE: Entry =
    Entry { family: Family::Iterative, accuracy: Accuracy::Iterative, warm_start: true, ..DIRECT };

/// A direct f64 method on a Vulkan device.
const DEVICE: Entry = Entry { family: Family::Gpu, ..DIRECT };

/// An iterative method on a Vulkan device, f64 results.
const DEVICE_ITERATIVE: Entry = Entry { family: Family::Gpu, ..ITERATIVE };

/// Every built-in backend, also those whose feature is off (their `open` says so).
pub const BACKENDS: &[Entry] = &[
    Entry {
        id: "dense",
        max_unknowns: Some(backends::dense::MAX_UNKNOWNS),
        open: backends::dense::open,
        ..DIRECT
    },
    Entry { id: "framechol-f64", open: backends::framechol::open_f64, ..DIRECT },
    Entry { id: "framechol-f32", precision: Precision::F32, open: backends::framechol::open_f32, ..DIRECT },
    Entry {
        id: "framechol-mixed",
        precision: Precision::Mixed,
        open: backends::framechol::open_mixed,
        ..DIRECT
    },
    Entry { id: "faer-llt", licence: "MIT", open: gated!("faer", backends::faer::open_llt), ..DIRECT },
    Entry { id: "faer-ldlt", licence: "MIT", open: gated!("faer", backends::faer::open_ldlt), ..DIRECT },
    Entry {
        id: "faer-simplicial",
        licence: "MIT",
        open: gated!("faer", backends::faer::open_simplicial),
        ..DIRECT
    },
    Entry {
        id: "nalgebra-cholesky",
        licence: "Apache-2.0",
        open: gated!("nalgebra", backends::nalgebra::open),
        ..DIRECT
    },
    Entry {
        id: "sprs-ldl",
        licence: "LGPL-2.1",
        open: gated!("sprs-ldl", backends::sprs_ldl::open),
        ..DIRECT
    },
    Entry { id: "cg-jacobi", open: backends::cg::open_jacobi, ..ITERATIVE },
    Entry { id: "cg-ic0", open: backends::cg::open_ic0, ..ITERATIVE },
    Entry { id: "cg-fsai", open: backends::cg::open_fsai, ..ITERATIVE },
    Entry { id: "cg-chebyshev", open: backends::cg::open_chebyshev, ..ITERATIVE },
    Entry { id: "cg-approxchol", open: backends::cg::open_approxchol, ..ITERATIVE },
    Entry { id: "cg-amg", open: backends::multigrid::open_amg, ..ITERATIVE },
    Entry { id: "cg-multigrid", open: backends::multigrid::open_cg, ..ITERATIVE },
    Entry { id: "multigrid", open: backends::multigrid::open, ..ITERATIVE },
    Entry { id: "vulkan-direct-f64", open: gated!("vulkan", backends::vulkan::direct::open_f64), ..DEVICE },
    Entry {
        id: "vulkan-direct-mixed",
        precision: Precision::Mixed,
        open: gated!("vulkan", backends::vulkan::direct::open_mixed),
        ..DEVICE
    },
    Entry {
        id: "vulkan-direct-f32",
        precision: Precision::F32,
        open: gated!("vulkan", backends::vulkan::direct::open_f32),
        ..DEVICE
    },
    Entry {
        id: "vulkan-cg-jacobi",
        open: gated!("vulkan", backends::vulkan::cg::open_jacobi),
        ..DEVICE_ITERATIVE
    },
    Entry {
        id: "vulkan-cg-fsai",
        open: gated!("vulkan", backends::vulkan::cg::open_fsai),
        ..DEVICE_ITERATIVE
    },
    Entry {
        id: "vulkan-cg-multigrid",
        open: gated!("vulkan", backends::vulkan::cg::open_multigrid),
        ..DEVICE_ITERATIVE
    },
    Entry { id: "sprs-cg", open: gated!("sprs", backends::sprs_cg::open), ..ITERATIVE },
];

/// The entry of that name.
pub fn find(id: &str) -> Option<&'static Entry> {
    BACKENDS.iter().find(|entry| entry.id == id)
}
