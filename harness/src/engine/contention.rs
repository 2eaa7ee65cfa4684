//! What else the machine does while a cell is measured: other processes and the hypervisor.
//!
//! Contended rounds are marked, never dropped: which samples count must not depend on what they show.

use crate::environment;
use crate::record::result::Contention;
use std::fs;
use std::time::Instant;

/// Ticks per second of /proc/stat and /proc/PID/stat (USER_HZ, 100 on every Linux).
const TICKS_PER_SECOND: f64 = 100.0;

/// Others may use a tenth of a processor: the kernel's own work and the granularity of ticks stay below it.
const OTHERS: f64 = 0.1;

/// More than this share of processor time taken by the hypervisor is contention.
const STEAL: f64 = 0.01;

/// A reading of the clocks at the start of a round.
pub struct Watch {
    begin: Instant,
    machine: Option<Machine>,
    own: Option<u64>,
    child: u32,
}

/// Ticks of the whole machine since boot.
#[derive(Clone, Copy)]
struct Machine {
    busy: u64,
    stolen: u64,
    all: u64,
}

impl Watch {
    /// Starts to watch; the time of this process and of `child` is not others'.
    pub fn start(child: u32) -> Self {
        Self { begin: Instant::now(), machine: machine(), own: ours(child), child }
    }

    /// Ends a round and adds what was seen. Where the system does not say, only the round is counted.
    pub fn end(self, contention: &mut Contention) {
        contention.rounds += 1;
        contention.load1_max = larger(contention.load1_max, environment::load1());
        let (Some(before), Some(after)) = (self.machine, machine()) else { return };
        let all = after.all.saturating_sub(before.all);
        let steal = (all > 0).then(|| after.stolen.saturating_sub(before.stolen) as f64 / all as f64);
        let others = self.own.zip(ours(self.child)).map(|(own_before, own_after)| {
            let busy = after.busy.saturating_sub(before.busy);
            let others = busy.saturating_sub(own_after.saturating_sub(own_before));
            others as f64 / TICKS_PER_SECOND / self.begin.elapsed().as_secs_f64()
        });
        if steal.is_some_and(|s| s > STEAL) || others.is_some_and(|o| o > OTHERS) {
            contention.contended += 1;
        }
        contention.steal_max = larger(contention.steal_max, steal);
        contention.others_max = larger(contention.others_max, others);
    }
}

fn larger(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    a.into_iter().chain(b).reduce(f64::max)
}

/// The first line of /proc/stat: user, nice, system, idle, iowait, irq, softirq, steal.
fn machine() -> Option<Machine> {
    let text = fs::read_to_string("/proc/stat").ok()?;
    let ticks: Vec<u64> =
        text.lines().next()?.split_whitespace().skip(1).take(8).map_while(|t| t.parse().ok()).collect();
    let &[user, nice, system, _, _, irq, softirq, stolen] = ticks.as_slice() else { return None };
    Some(Machine { busy: user + nice + system + irq + softirq, stolen, all: ticks.iter().sum() })
}

/// Ticks that this process and `child` used, all threads; the child counts while it lives.
fn ours(child: u32) -> Option<u64> {
    Some(used("self")? + used(&child.to_string()).unwrap_or(0))
}

/// utime + stime of a process: the 14th and 15th field, counted after the name, which may hold blanks.
fn used(process: &str) -> Option<u64> {
    let text = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let mut fields = text.rsplit_once(')')?.1.split_whitespace().skip(11);
    Some(fields.next()?.parse::<u64>().ok()? + fields.next()?.parse::<u64>().ok()?)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use std::process::{Command, Stdio};
    use std::time::Duration;

    /// A process that spins is seen, unless it is the one that is measured.
    #[test]
    fn a_busy_neighbour_is_others_work() {
        let mut spinner =
            Command::new("sh").args(["-c", "while :; do :; done"]).stdout(Stdio::null()).spawn().unwrap();
        let watched = |child| {
            let (mut seen, watch) = (Contention::default(), Watch::start(child));
            std::thread::sleep(Duration::from_millis(500));
            watch.end(&mut seen);
            seen
        };
        const NO_CHILD: u32 = u32::MAX; // above every process
        let (neighbour, own) = (watched(NO_CHILD), watched(spinner.id()));
        spinner.kill().unwrap();
        spinner.wait().unwrap();
        assert_eq!((neighbour.rounds, neighbour.contended), (1, 1), "{neighbour:?}");
        let (a, b) = (neighbour.others_max.unwrap(), own.others_max.unwrap());
        assert!(a > 0.15, "the spinner is not seen: {a}");
        assert!(b < a + 0.5, "{a} {b}");
    }
}
