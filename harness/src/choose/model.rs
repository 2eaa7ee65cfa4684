//! A cost model: power laws in the number of vertices and of columns, fitted to measured cells.
//!
//! For every backend and figure, ln y = a + b ln n + c ln k by least squares over meshes of several sizes. A surface mesh's
//! factor has O(n log n) entries and takes O(n^1.5) flops (George 1973; Lipton, Rose and Tarjan 1979), iterations of
//! unpreconditioned methods grow like n^0.5: all near power laws over the sizes of interest. The time of an iterative solve
//! goes with the digits asked for. Machines are told apart by one probe, measured on both.

use super::cost::Cost;
use super::figures::Figures;
use super::question::{Question, Updates};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A fitted model, as stored.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Model {
    /// Meshes it was fitted on.
    pub meshes: Vec<String>,
    /// Processor it was fitted on, and threads.
    pub machine: String,
    /// Threads of a solve.
    pub threads: usize,
    /// Error that was asked of iterative backends.
    pub accuracy: f64,
    /// The probe's times there.
    pub probe: Probe,
    /// By backend.
    pub backends: BTreeMap<String, Laws>,
    /// Errors of predictions for meshes left out of the fit, one after the other, by figure.
    pub left_out: BTreeMap<String, Spread>,
}

/// Times of [`PROBE_BACKEND`] on [`PROBE_MESH`], nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Probe {
    /// Set-up.
    pub set_up: f64,
    /// Steady solve.
    pub solve: f64,
}

/// What is measured to compare machines: small enough for a second, large enough to leave the first-level cache.
pub const PROBE_MESH: &str = "sphere:5";
/// With the backend of all builds.
pub const PROBE_BACKEND: &str = "framechol-f64";

/// The figures of one backend.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Laws {
    /// Whether its solves go with the digits asked for.
    pub iterative: bool,
    /// Largest error seen, where the accuracy is its own.
    pub error: Option<f64>,
    /// By figure: [`FIGURES`].
    pub figures: BTreeMap<String, Law>,
}

/// ln y = a + b ln n + c ln k.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the formula names them")]
pub struct Law {
    pub a: f64,
    pub b: f64,
    pub c: f64,
}

/// How far predictions are off: factors, 1.2 is a fifth too much or too little.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Half of the predictions are within this factor.
    pub median: f64,
    /// Nine of ten are.
    pub p90: f64,
    /// How many predictions there were.
    pub count: usize,
}

/// What is predicted: times in nanoseconds, the peak in bytes.
pub const FIGURES: [&str; 6] = ["set-up", "first solve", "solve", "new values", "edit", "peak memory"];

/// One measured cell.
#[derive(Clone, Debug)]
pub struct Observation {
    /// The mesh.
    pub mesh: String,
    /// Its vertices.
    pub vertices: usize,
    /// Columns.
    pub columns: u32,
    /// The backend.
    pub backend: String,
    /// Whether it is iterative.
    pub iterative: bool,
    /// Its error.
    pub error: Option<f64>,
    /// By figure of [`FIGURES`]; none where it was not measured or does not exist.
    pub figures: [Option<f64>; FIGURES.len()],
}

impl Law {
    /// The figure for n vertices and k columns.
    pub fn at(&self, n: usize, k: u32) -> f64 {
        (self.a + self.b * (n.max(1) as f64).ln() + self.c * f64::from(k.max(1)).ln()).exp()
    }

    /// Least squares over points (n, k, y). None without a point; where n or k do not vary, their exponent is 1 and 0.
    pub fn fit(points: &[(usize, u32, f64)]) -> Option<Self> {
        let rows: Vec<[f64; 3]> = points
            .iter()
            .filter(|p| p.2 > 0.0)
            .map(|&(n, k, y)| [(n.max(1) as f64).ln(), f64::from(k.max(1)).ln(), y.ln()])
            .collect();
        if rows.is_empty() {
            return None;
        }
        let mean = |i: usize| rows.iter().map(|r| r[i]).sum::<f64>() / rows.len() as f64;
        let (x, z, y) = (mean(0), mean(1), mean(2));
        let product = |i: usize, j: usize| {
            let (mi, mj) = ([x, z, y][i], [x, z, y][j]);
            rows.iter().map(|r| (r[i] - mi) * (r[j] - mj)).sum::<f64>()
        };
        let (xx, xz, zz, xy, zy) =
            (product(0, 0), product(0, 1), product(1, 1), product(0, 2), product(1, 2));
        let determinant = xx * zz - xz * xz;
        let (b, c) = match (xx > 1e-9, zz > 1e-9) {
            (true, true) if determinant > 1e-9 * xx * zz => {
                ((xy * zz - zy * xz) / determinant, (zy * xx - xy * xz) / determinant)
            }
            (true, _) => (xy / xx, 0.0),
            (false, true) => (1.0, zy / zz),
            (false, false) => (1.0, 0.0),
        };
        Some(Self { a: y - b * x - c * z, b, c })
    }
}

impl Model {
    /// The model that the program carries.
    pub fn built_in() -> Self {
        serde_json::from_str(include_str!("model.json")).expect("the stored model is valid")
    }

    /// Fits all laws.
    pub fn fit(observations: &[Observation]) -> BTreeMap<String, Laws> {
        let mut backends: BTreeMap<String, Laws> = BTreeMap::new();
        for o in observations {
            let laws = backends.entry(o.backend.clone()).or_default();
            laws.iterative = o.iterative;
            if !o.iterative {
                laws.error = [laws.error, o.error].into_iter().flatten().reduce(f64::max);
            }
        }
        for (backend, laws) in &mut backends {
            for (i, name) in FIGURES.iter().enumerate() {
                let points: Vec<_> = observations
                    .iter()
                    .filter(|o| o.backend == *backend)
                    .filter_map(|o| Some((o.vertices, o.columns, o.figures[i]?)))
                    .collect();
                if let Some(law) = Law::fit(&points) {
                    laws.figures.insert((*name).to_owned(), law);
                }
            }
        }
        backends
    }

    /// Errors of predictions by figure: each mesh is predicted by a fit to all others.
    pub fn leave_one_out(observations: &[Observation]) -> BTreeMap<String, Spread> {
        let mut meshes: Vec<&str> = observations.iter().map(|o| o.mesh.as_str()).collect();
        meshes.sort_unstable();
        meshes.dedup();
        let mut factors: BTreeMap<String, Vec<f64>> = BTreeMap::new();
        for mesh in meshes {
            let (out, rest): (Vec<_>, Vec<_>) = observations.iter().cloned().partition(|o| o.mesh == mesh);
            let laws = Self::fit(&rest);
            collect_factors(&laws, &out, [1.0; FIGURES.len()], &mut factors);
        }
        factors.into_iter().map(|(name, factors)| (name, Spread::of(factors))).collect()
    }

    /// Errors of this model's predictions for measured cells, by figure, on a machine with that probe.
    pub fn errors(&self, observations: &[Observation], probe: &Probe) -> BTreeMap<String, Spread> {
        let mut factors = BTreeMap::new();
        collect_factors(&self.backends, observations, self.scales(probe), &mut factors);
        factors.into_iter().map(|(name, factors)| (name, Spread::of(factors))).collect()
    }

    /// How much slower this machine is than that of the fit, for each of [`FIGURES`].
    fn scales(&self, probe: &Probe) -> [f64; FIGURES.len()] {
        let ratio = |here: f64, there: f64| if here > 0.0 && there > 0.0 { here / there } else { 1.0 };
        let set_up = ratio(probe.set_up, self.probe.set_up);
        let solve = ratio(probe.solve, self.probe.solve);
        [set_up, solve, solve, set_up, set_up, 1.0]
    }

    /// Predicted figures of a backend on a mesh of n vertices; none where it was not fitted.
    pub fn predict(&self, backend: &str, n: usize, question: &Question, probe: &Probe) -> Option<Figures> {
        let laws = self.backends.get(backend)?;
        let scales = self.scales(probe);
        let digits = if laws.iterative { question.accuracy.ln() / self.accuracy.ln() } else { 1.0 };
        let at = |i: usize| Some(scales[i] * laws.figures.get(FIGURES[i])?.at(n, question.columns));
        let set_up = at(0)?;
        let (change, prepares_anew) = match question.updates {
            Updates::Never => (0.0, false),
            Updates::Values => at(3).map_or((set_up, true), |t| (t, false)),
            Updates::Constraints => at(4).map_or((set_up, true), |t| (t, false)),
        };
        Some(Figures {
            backend: backend.to_owned(),
            cost: Cost { set_up, first: digits * at(1)?, solve: digits * at(2)?, change, prepares_anew },
            error: laws.error,
            peak_bytes: at(5).map(|bytes| bytes.round() as u64),
            ..Figures::default()
        })
    }
}

/// max(y / prediction, prediction / y) for every figure that is both measured and predicted.
fn collect_factors(
    laws: &BTreeMap<String, Laws>,
    observations: &[Observation],
    scales: [f64; FIGURES.len()],
    into: &mut BTreeMap<String, Vec<f64>>,
) {
    for o in observations {
        let Some(laws) = laws.get(&o.backend) else { continue };
        for (i, name) in FIGURES.iter().enumerate() {
            if let (Some(y), Some(law)) = (o.figures[i].filter(|&y| y > 0.0), laws.figures.get(*name)) {
                let ratio = scales[i] * law.at(o.vertices, o.columns) / y;
                into.entry((*name).to_owned()).or_default().push(ratio.max(1.0 / ratio));
            }
        }
    }
}

impl Spread {
    fn of(mut factors: Vec<f64>) -> Self {
        factors.sort_by(f64::total_cmp);
        let at = |share: f64| {
            factors.get(((share * factors.len() as f64).ceil() as usize).max(1) - 1).copied().unwrap_or(1.0)
        };
        Self { median: at(0.5), p90: at(0.9), count: factors.len() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::choose::cost::tests::question;

    #[test]
    fn an_exact_power_law_is_found() {
        let law = Law { a: 2.0, b: 1.25, c: 0.5 };
        let points: Vec<_> =
            [(1000, 1), (5000, 3), (20_000, 1), (90_000, 4)].map(|(n, k)| (n, k, law.at(n, k))).to_vec();
        let found = Law::fit(&points).unwrap();
        assert!((found.a - 2.0).abs() + (found.b - 1.25).abs() + (found.c - 0.5).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn what_does_not_vary_gets_a_sane_exponent() {
        let one = Law::fit(&[(1000, 3, 5.0)]).unwrap();
        assert!((one.b, one.c) == (1.0, 0.0) && (one.at(2000, 3) - 10.0).abs() < 1e-9, "{one:?}");
        let columns = Law::fit(&[(1000, 1, 5.0), (1000, 2, 10.0)]).unwrap();
        assert!((columns.c - 1.0).abs() < 1e-9);
        assert_eq!(Law::fit(&[]), None);
    }

    fn observation(mesh: &str, vertices: usize, solve: f64) -> Observation {
        let figures = [Some(10.0 * solve), Some(solve), Some(solve), None, None, Some(1e6)];
        let backend = "a".to_owned();
        let mesh = mesh.to_owned();
        Observation { mesh, vertices, columns: 3, backend, iterative: false, error: Some(1e-12), figures }
    }

    #[test]
    fn a_mesh_is_predicted_by_the_others_only() {
        let linear = [("a", 1000), ("b", 2000), ("c", 4000)].map(|(m, n)| observation(m, n, n as f64));
        assert!(Model::leave_one_out(&linear)["solve"].p90 < 1.0 + 1e-9);
        let odd = [linear.to_vec(), vec![observation("d", 3000, 9000.0)]].concat();
        assert!(Model::leave_one_out(&odd)["solve"].p90 > 2.0);
    }

    #[test]
    fn a_slower_machine_is_slower_and_tighter_answers_take_longer() {
        let mut observation = observation("m", 1000, 1e6);
        observation.iterative = true;
        let model = Model {
            accuracy: 1e-8,
            probe: Probe { set_up: 1.0, solve: 1.0 },
            backends: Model::fit(&[observation]),
            ..Model::default()
        };
        let probe = Probe { set_up: 2.0, solve: 3.0 };
        let q = question(Updates::Values, 10);
        let figures = model.predict("a", 1000, &q, &probe).unwrap();
        assert!((figures.cost.set_up - 2e7).abs() < 1.0 && (figures.cost.solve - 3e6).abs() < 1.0);
        assert!(figures.cost.prepares_anew && figures.peak_bytes == Some(1_000_000));
        let tight = Question { accuracy: 1e-12, ..q };
        assert!((model.predict("a", 1000, &tight, &probe).unwrap().cost.solve - 4.5e6).abs() < 1.0);
        assert!(model.predict("b", 1000, &tight, &probe).is_none());
    }

    #[test]
    fn the_stored_model_knows_the_main_backends() {
        let model = Model::built_in();
        let probe = model.probe;
        let q = question(Updates::Values, 100);
        for id in [PROBE_BACKEND, "framechol-mixed", "cg-multigrid", "cg-jacobi"] {
            let figures =
                model.predict(id, 50_000, &q, &probe).unwrap_or_else(|| panic!("{id} is not in it"));
            let cost = figures.cost;
            assert!(
                [cost.set_up, cost.first, cost.solve, cost.change].iter().all(|&t| t > 1e3 && t < 1e11),
                "{id}: {cost:?}"
            );
        }
        assert!(model.left_out.values().all(|s| s.median >= 1.0 && s.median < 3.0), "{:?}", model.left_out);
    }
}
