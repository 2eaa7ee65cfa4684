//! Who used the processors during a couple: this program and its children, or others.

use crate::environment::processor_ticks;

/// Readings of the kernel's clocks, in ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ticks {
    /// All processors since boot: stolen by the hypervisor, working, all.
    stolen: u64,
    busy: u64,
    all: u64,
    /// This process and its ended children.
    own: u64,
}

/// Processors' worth of stolen time from which a couple counts as disturbed.
const STOLEN: f64 = 0.1;

/// Share of the processors we leave free that others may use before they get in our way.
const FOREIGN_SHARE: f64 = 0.5;

/// Others may always use so many processors: the resolution of the ticks, daemons.
const FOREIGN_LEAST: f64 = 0.25;

impl Ticks {
    /// Now; `None` where the system does not tell.
    pub fn read() -> Option<Self> {
        let (stolen, all) = processor_ticks()?;
        let idle = idle(&std::fs::read_to_string("/proc/stat").ok()?)?;
        let own = own(&std::fs::read_to_string("/proc/self/stat").ok()?)?;
        Some(Self { stolen, busy: all.saturating_sub(stolen + idle), all, own })
    }

    /// Whether between `self` and `later` others used so much of `processors` processors, of which `threads` were ours, that
    /// times are doubtful.
    pub fn disturbed_until(&self, later: &Self, processors: usize, threads: usize) -> bool {
        let passed = later.all.saturating_sub(self.all) as f64 / processors as f64;
        if passed <= 0.0 {
            return false;
        }
        let busy = later.busy.saturating_sub(self.busy);
        let foreign = busy.saturating_sub(later.own.saturating_sub(self.own)) as f64 / passed;
        let stolen = later.stolen.saturating_sub(self.stolen) as f64 / passed;
        let free = processors.saturating_sub(threads) as f64;
        stolen > STOLEN || foreign > FOREIGN_LEAST.max(FOREIGN_SHARE * free)
    }
}

/// Ticks of all processors idle or waiting for a disk: fields 4 and 5 of the first line of /proc/stat.
fn idle(stat: &str) -> Option<u64> {
    let mut fields = stat.lines().next()?.split_whitespace().skip(4).map_while(|t| t.parse::<u64>().ok());
    Some(fields.next()? + fields.next()?)
}

/// User and system ticks of the process and its ended children: fields 14 to 17 of /proc/self/stat. The second field is the
/// program's name in parentheses and may hold blanks.
fn own(stat: &str) -> Option<u64> {
    let after_name = &stat[stat.rfind(')')? + 1..];
    let fields: Vec<u64> =
        after_name.split_whitespace().skip(11).take(4).map_while(|t| t.parse().ok()).collect();
    (fields.len() == 4).then(|| fields.iter().sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_the_kernel_s_tables() {
        assert_eq!(idle("cpu  10 20 30 400 5 1 2 3 0 0\ncpu0 1"), Some(405));
        let stat = "42 (a b) c) R 1 2 3 4 5 6 7 8 9 10 100 20 3 4 20 0 1";
        assert_eq!(own(stat), Some(127));
        assert_eq!((idle("cpu"), own("42 (a")), (None, None));
    }

    #[test]
    fn a_busy_neighbour_on_two_processors_disturbs_and_one_on_sixty_four_does_not() {
        let begin = Ticks { stolen: 0, busy: 0, all: 0, own: 0 };
        let after = |processors: u64, busy, stolen| Ticks { stolen, busy, all: 100 * processors, own: 90 };
        assert!(begin.disturbed_until(&after(2, 190, 0), 2, 1));
        assert!(!begin.disturbed_until(&after(2, 100, 0), 2, 1));
        assert!(!begin.disturbed_until(&after(64, 190, 0), 64, 1));
        assert!(begin.disturbed_until(&after(2, 90, 15), 2, 1));
        assert!(!begin.disturbed_until(&begin, 2, 1));
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn own_work_is_not_foreign() {
        let begin = Ticks::read().unwrap();
        let work = std::time::Instant::now();
        while work.elapsed().as_millis() < 60 {
            std::hint::black_box(begin);
        }
        let end = Ticks::read().unwrap();
        assert!(end.own > begin.own && end.busy >= begin.busy && end.all > begin.all);
    }
}
