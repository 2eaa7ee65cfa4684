//! Open-loop pacing: starts on a schedule, whether the last frame is done or not.
//!
//! A back-to-back loop hides stalls, because a late frame only delays the next start (coordinated omission). Here the
//! latency of a frame counts from the start it was scheduled for, so a late frame makes the next ones late too.

use super::clock::nanoseconds;
use std::time::{Duration, Instant};

/// How long before a start sleeping gives way to spinning: sleeps end up to a timer slack (50 us) and a scheduling
/// delay late, which must not count as the solver's latency.
const SPIN: Duration = Duration::from_micros(300);

/// Runs `frame` at `hz` starts per second, `frames` times or until `limit` has passed; the latencies from scheduled
/// start to completion, in nanoseconds.
///
/// # Errors
/// The first error of `frame`.
pub fn latencies<E>(
    hz: f64,
    frames: u32,
    limit: Duration,
    mut frame: impl FnMut() -> Result<(), E>,
) -> Result<Vec<u64>, E> {
    const ROOM: usize = 1 << 16; // nine minutes at 120 Hz
    let mut latencies = Vec::with_capacity(ROOM.min(frames as usize));
    let period = Duration::from_secs_f64(1.0 / hz);
    let begin = Instant::now();
    for k in 0..frames {
        let scheduled = begin + period * k;
        if begin.elapsed() >= limit {
            break;
        }
        wait_until(scheduled);
        frame()?;
        latencies.push(nanoseconds(scheduled.elapsed()));
    }
    Ok(latencies)
}

fn wait_until(moment: Instant) {
    loop {
        let left = moment.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return;
        }
        if left > SPIN {
            std::thread::sleep(left - SPIN);
        } else {
            std::hint::spin_loop();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_late_frame_delays_the_next_ones() {
        // 100 Hz: 10 ms a frame. The second frame takes 35 ms, so the third starts 15 ms late.
        let mut k = 0;
        let stalled = || {
            k += 1;
            std::thread::sleep(Duration::from_millis(if k == 2 { 35 } else { 1 }));
            Ok::<_, ()>(())
        };
        let latencies = latencies(100.0, 4, Duration::from_secs(5), stalled).unwrap();
        assert_eq!(latencies.len(), 4);
        assert!(latencies[1] >= 35_000_000, "{latencies:?}");
        assert!(latencies[2] >= 26_000_000, "{latencies:?}");
    }

    #[test]
    fn gives_up_at_the_limit() {
        let slow = || {
            std::thread::sleep(Duration::from_millis(20));
            Ok::<_, ()>(())
        };
        let latencies = latencies(1000.0, 1000, Duration::from_millis(50), slow).unwrap();
        assert!((2..=4).contains(&latencies.len()), "{latencies:?}");
    }
}
