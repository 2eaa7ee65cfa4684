//! What a process can learn about and ask of the operating system. Linux has it all; elsewhere the answers are `None`.

use std::io;

/// Peak resident memory of this process in bytes (`VmHWM`).
pub fn peak_resident_bytes() -> Option<u64> {
    kilobytes(&std::fs::read_to_string("/proc/self/status").ok()?, "VmHWM")
}

/// Memory of this machine that can be had without swapping, in bytes (`MemAvailable`).
pub fn available_bytes() -> Option<u64> {
    kilobytes(&std::fs::read_to_string("/proc/meminfo").ok()?, "MemAvailable")
}

/// The value of `name: 123 kB` in bytes.
pub fn kilobytes(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// How often the kernel has killed a process for lack of memory, since boot.
pub fn out_of_memory_kills() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/vmstat").ok()?;
    text.lines().find_map(|line| line.strip_prefix("oom_kill "))?.trim().parse().ok()
}

/// Asks the kernel to kill this process when its parent ends, so that nothing is left running.
pub fn die_with_parent() {
    #[cfg(target_os = "linux")]
    {
        // Without it a child still ends when it sees the end of its stdin.
        let _ = rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::KILL));
    }
}

/// Caps the address space of this process (`RLIMIT_AS`); allocations beyond it fail.
///
/// # Errors
/// Where the system refuses, for instance above a hard limit.
pub fn limit_memory(bytes: u64) -> io::Result<()> {
    #[cfg(unix)]
    {
        use rustix::process::{Resource, Rlimit, setrlimit};
        let limit = Rlimit { current: Some(bytes), maximum: Some(bytes) };
        setrlimit(Resource::As, limit).map_err(Into::into)
    }
    #[cfg(not(unix))]
    {
        let _ = bytes;
        Err(io::Error::from(io::ErrorKind::Unsupported))
    }
}

/// Kills the process group that `leader` leads: a solver process and whatever it started.
pub fn kill_group(leader: u32) {
    #[cfg(unix)]
    {
        use rustix::process::{Pid, Signal, kill_process_group};
        if let Some(group) = i32::try_from(leader).ok().and_then(Pid::from_raw) {
            let _ = kill_process_group(group, Signal::KILL); // it may be gone already
        }
    }
    #[cfg(not(unix))]
    let _ = leader;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_the_kernel_s_tables() {
        let text = "VmPeak:\t  200 kB\nVmHWM:\t   100 kB\nVmHWMX: 3 kB\n";
        assert_eq!(kilobytes(text, "VmHWM"), Some(102_400));
        assert_eq!(kilobytes(text, "VmSwap"), None);
        assert_eq!(kilobytes("VmHWM: 99999999999999999999 kB", "VmHWM"), None);
        assert_eq!(kilobytes("VmHWM: 18446744073709551615 kB", "VmHWM"), None);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn the_peak_is_at_least_what_was_touched() {
        let block = vec![1u8; 50 << 20];
        assert!(std::hint::black_box(&block).iter().all(|&b| b == 1));
        assert!(peak_resident_bytes().unwrap() > 50 << 20);
    }
}
