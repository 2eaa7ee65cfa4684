//! Several solvers on several problems: geometric means, performance profiles, ties.

/// A solver's time on a problem with the interval of its median; none where it has no valid answer.
pub type Time = Option<(f64, f64, f64)>;

/// Times that differ by less are tied whatever their intervals say: the same program moves that much from run to run.
const NEGLIGIBLE: f64 = 1.03;

/// What an absent time counts as in the penalised mean: this many times the slowest valid one of the problem.
pub const PENALTY: f64 = 10.0;

/// A solver in a rank.
#[derive(Clone, Debug, PartialEq)]
pub struct Standing {
    /// Its row in the table of times.
    pub solver: usize,
    /// 1 for the best; the same number for tied ones.
    pub rank: usize,
    /// Whether another solver has the same rank.
    pub tied: bool,
    /// Problems with a valid time.
    pub solved: usize,
    /// Geometric mean of the ratios to the fastest, over the problems that every solver has; none where there are none.
    pub intersection: Option<f64>,
    /// The same over all problems, absent times penalised.
    pub penalised: f64,
    /// The penalised mean with both ends of the intervals.
    pub interval: (f64, f64),
}

/// Ranks solvers by their penalised mean; `times[solver][problem]`. Solvers without any valid time are left out.
///
/// Two neighbours are tied where the intervals of their means overlap or the means differ by less than 3%.
pub fn rank(times: &[Vec<Time>]) -> Vec<Standing> {
    let problems = times.first().map_or(0, Vec::len);
    let present: Vec<usize> = (0..times.len()).filter(|&s| times[s].iter().any(Option::is_some)).collect();
    let scales: Vec<Option<(f64, f64)>> = (0..problems).map(|p| extremes(times, &present, p)).collect();
    let complete: Vec<usize> =
        (0..problems).filter(|&p| present.iter().all(|&s| times[s][p].is_some())).collect();
    let mut standings: Vec<Standing> = present
        .iter()
        .map(|&solver| {
            let row = &times[solver];
            let mean = |pick: fn((f64, f64, f64)) -> f64| {
                geometric_mean(scales.iter().zip(row).filter_map(|(scale, time)| {
                    let (fastest, slowest) = (*scale)?;
                    Some(time.map_or(PENALTY * slowest, pick) / fastest)
                }))
                .unwrap_or(1.0)
            };
            let common = complete.iter().filter_map(|&p| Some(row[p]?.0 / scales[p]?.0));
            Standing {
                solver,
                rank: 0,
                tied: false,
                solved: row.iter().flatten().count(),
                intersection: geometric_mean(common),
                penalised: mean(|t| t.0),
                interval: (mean(|t| t.1), mean(|t| t.2)),
            }
        })
        .collect();
    standings.sort_by(|a, b| a.penalised.total_cmp(&b.penalised));
    number(&mut standings);
    standings
}

/// The fastest and the slowest median on a problem.
fn extremes(times: &[Vec<Time>], present: &[usize], problem: usize) -> Option<(f64, f64)> {
    let valid = present.iter().filter_map(|&s| times[s][problem]).map(|t| t.0);
    valid.map(|t| (t, t)).reduce(|(low, high), (t, _)| (low.min(t), high.max(t)))
}

/// Gives neighbours that cannot be told apart from the first of them the same rank.
fn number(standings: &mut [Standing]) {
    let mut leader = 0;
    for i in 0..standings.len() {
        let same = i > 0 && alike(&standings[leader], &standings[i]);
        if !same {
            leader = i;
        }
        standings[i].rank = leader + 1;
        standings[i].tied = same;
        standings[leader].tied |= same;
    }
}

fn alike(better: &Standing, worse: &Standing) -> bool {
    worse.interval.0 <= better.interval.1 || worse.penalised <= NEGLIGIBLE * better.penalised
}

/// exp of the mean of logarithms; none of nothing.
pub fn geometric_mean(ratios: impl Iterator<Item = f64>) -> Option<f64> {
    let (count, sum) = ratios.fold((0u32, 0.0), |(count, sum), r| (count + 1, sum + r.ln()));
    (count > 0).then(|| (sum / f64::from(count)).exp())
}

/// Performance profile of a solver (Dolan and More 2002): the share of problems that it solves within `factor` times the
/// time of the fastest. Between more than two solvers it says nothing about the second best (Gould and Scott 2016).
pub fn profile(times: &[Vec<Time>], solver: usize, factor: f64) -> f64 {
    let all: Vec<usize> = (0..times.len()).collect();
    let problems = times.first().map_or(0, Vec::len);
    let within = |p: &usize| {
        let fastest = extremes(times, &all, *p).map(|e| e.0);
        times[solver][*p].zip(fastest).is_some_and(|(time, fastest)| time.0 <= factor * fastest)
    };
    if problems == 0 { 0.0 } else { (0..problems).filter(within).count() as f64 / problems as f64 }
}

/// Slope and factor of the least-squares line through logarithms: y = factor x^slope. None below two different x.
pub fn power_law(points: &[(f64, f64)]) -> Option<(f64, f64)> {
    let logs: Vec<(f64, f64)> = points.iter().map(|&(x, y)| (x.ln(), y.ln())).collect();
    let n = logs.len() as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| logs.iter().map(f).sum::<f64>() / n;
    let (mx, my) = (mean(|p| p.0), mean(|p| p.1));
    let (sxx, sxy) = logs
        .iter()
        .fold((0.0, 0.0), |(xx, xy), &(x, y)| (xx + (x - mx) * (x - mx), xy + (x - mx) * (y - my)));
    let slope = sxy / sxx;
    (sxx > 1e-9 && slope.is_finite()).then(|| (slope, (my - slope * mx).exp()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exact(t: f64) -> Time {
        Some((t, t, t))
    }

    #[test]
    fn the_fastest_everywhere_is_first() {
        let standings = rank(&[vec![exact(4.0), exact(9.0)], vec![exact(1.0), exact(1.0)]]);
        assert_eq!(standings.iter().map(|s| (s.solver, s.rank)).collect::<Vec<_>>(), [(1, 1), (0, 2)]);
        assert_eq!(standings[0].intersection, Some(1.0));
        assert!((standings[1].intersection.unwrap() - 6.0).abs() < 1e-12);
    }

    #[test]
    fn absent_times_cost_ten_times_the_slowest_and_do_not_enter_the_intersection() {
        let standings = rank(&[vec![exact(1.0), None], vec![exact(2.0), exact(3.0)], vec![None, None]]);
        assert_eq!(standings.len(), 2);
        let first = standings.iter().find(|s| s.solver == 0).unwrap();
        assert_eq!((first.intersection, first.solved), (Some(1.0), 1));
        assert!((first.penalised - 10f64.sqrt()).abs() < 1e-12, "{first:?}");
        let second = standings.iter().find(|s| s.solver == 1).unwrap();
        assert!((second.penalised - 2f64.sqrt()).abs() < 1e-12 && second.rank == 1);
    }

    #[test]
    fn overlapping_intervals_are_ties() {
        let standings = rank(&[
            vec![Some((1.0, 0.9, 1.2))],
            vec![Some((1.1, 1.15, 1.3))],
            vec![Some((1.31, 1.3, 1.4))],
            vec![Some((1.32, 1.319, 1.321))],
        ]);
        assert_eq!(
            standings.iter().map(|s| (s.rank, s.tied)).collect::<Vec<_>>(),
            [(1, true), (1, true), (3, true), (3, true)]
        );
        let apart = rank(&[vec![exact(1.0)], vec![exact(1.04)]]);
        assert_eq!(apart.iter().map(|s| (s.rank, s.tied)).collect::<Vec<_>>(), [(1, false), (2, false)]);
    }

    #[test]
    fn profiles_count_problems() {
        let times = [vec![exact(1.0), exact(4.0), None], vec![exact(2.0), exact(2.0), exact(1.0)]];
        assert_eq!(profile(&times, 0, 1.0), 1.0 / 3.0);
        assert_eq!(profile(&times, 0, 2.0), 2.0 / 3.0);
        assert_eq!(profile(&times, 1, 2.0), 1.0);
    }

    #[test]
    fn slopes_of_power_laws() {
        let points: Vec<(f64, f64)> = [1e3, 1e4, 1e5].map(|x: f64| (x, 3.0 * x.powf(1.2))).to_vec();
        let (slope, factor) = power_law(&points).unwrap();
        assert!((slope - 1.2).abs() < 1e-12 && (factor - 3.0).abs() < 1e-9);
        assert_eq!(power_law(&[(5.0, 1.0), (5.0, 2.0)]), None);
    }
}
