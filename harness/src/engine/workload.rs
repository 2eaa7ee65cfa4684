//! The names of the workloads.

use clap::ValueEnum;

/// What is solved on a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, ValueEnum)]
pub enum Workload {
    /// Harmonic field from values at 50 vertices: L u = 0 on the free vertices
    Harmonic,
    /// Harmonic field while ten of its constraints move: edit and solve
    HarmonicEdit,
    /// Whole frames: a moving template drives the mesh (harmonic rotations, then L x = U)
    Transfer,
    /// L x = U with the right-hand side of a transfer frame
    Poisson,
    /// Screened Poisson (M + t L) u = M x
    Screened,
    /// (L + M) u = M x, the public benchmark's k = 1
    #[value(name = "kharmonic-1")]
    Kharmonic1,
    /// (L M^-1 L + M) u = M x, k = 2
    #[value(name = "kharmonic-2")]
    Kharmonic2,
    /// (L M^-1 L M^-1 L + M) u = M x, k = 3
    #[value(name = "kharmonic-3")]
    Kharmonic3,
    /// Bone weights by heat equilibrium: (L + M H) w = M H p, one column per bone
    Skinning,
    /// Joint angles made smooth: (I + lambda D'D) b = a, five diagonals, one column per angle
    Smoothing,
    /// As-rigid-as-possible deformation by handles: local rotations and a global solve, ten times
    Arap,
    /// Distances along the surface by the heat method: two solves
    Geodesic,
    /// A x = b for a matrix given with --matrix
    Matrix,
}

impl Workload {
    /// All workloads.
    pub const ALL: [Self; 13] = [
        Self::Harmonic,
        Self::HarmonicEdit,
        Self::Transfer,
        Self::Poisson,
        Self::Screened,
        Self::Kharmonic1,
        Self::Kharmonic2,
        Self::Kharmonic3,
        Self::Skinning,
        Self::Smoothing,
        Self::Arap,
        Self::Geodesic,
        Self::Matrix,
    ];

    /// The name on the command line and in results.
    pub fn name(self) -> &'static str {
        match self {
            Workload::Harmonic => "harmonic",
            Workload::HarmonicEdit => "harmonic-edit",
            Workload::Transfer => "transfer",
            Workload::Poisson => "poisson",
            Workload::Screened => "screened",
            Workload::Kharmonic1 => "kharmonic-1",
            Workload::Kharmonic2 => "kharmonic-2",
            Workload::Kharmonic3 => "kharmonic-3",
            Workload::Skinning => "skinning",
            Workload::Smoothing => "smoothing",
            Workload::Arap => "arap",
            Workload::Geodesic => "geodesic",
            Workload::Matrix => "matrix",
        }
    }

    /// What it is, in a line.
    pub fn meaning(self) -> String {
        let help = self.to_possible_value().and_then(|value| value.get_help().map(ToString::to_string));
        help.unwrap_or_default()
    }

    /// Whether it needs a mesh (all but matrix input).
    pub fn needs_mesh(self) -> bool {
        self != Workload::Matrix
    }
}

impl std::fmt::Display for Workload {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}
