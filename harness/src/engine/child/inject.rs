//! Slow-downs on request, inside the timed region: what a gate is proved with. Only with the feature `inject`; without it
//! nothing is compiled and the variable means nothing.

use std::time::Instant;

/// Works on for the share of the time since `start` that `LAPBENCH_INJECT` asks for `what` (`solve`, `frame`, `setup`), for
/// example `solve:0.05,setup:0.2`.
#[cfg(feature = "inject")]
pub fn delay(what: &str, start: Instant) {
    static SHARES: std::sync::LazyLock<String> =
        std::sync::LazyLock::new(|| std::env::var("LAPBENCH_INJECT").unwrap_or_default());
    let Some(share) = share(&SHARES, what) else { return };
    let until = start.elapsed().mul_f64(1.0 + share);
    while start.elapsed() < until {
        std::hint::spin_loop();
    }
}

/// Nothing.
#[cfg(not(feature = "inject"))]
pub fn delay(_: &str, _: Instant) {}

/// The share that `list` gives for `what`; `None` where it is not listed, or no number from 0 to 100.
#[cfg(any(feature = "inject", test))]
fn share(list: &str, what: &str) -> Option<f64> {
    let entries = list.split(',').filter_map(|entry| entry.split_once(':'));
    let share = entries.filter(|(name, _)| name.trim() == what).find_map(|(_, x)| x.trim().parse().ok());
    share.filter(|share| (0.0..=100.0).contains(share))
}

#[cfg(test)]
mod tests {
    use super::share;

    #[test]
    fn shares_are_read() {
        assert_eq!(share("solve:0.05, setup:2", "setup"), Some(2.0));
        assert_eq!(share("solve:0.05", "frame"), None);
        for wrong in ["solve", "solve:x", "solve:-1", "solve:inf", "solve:NaN", ""] {
            assert_eq!(share(wrong, "solve"), None, "{wrong}");
        }
    }
}
