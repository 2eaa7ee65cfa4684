//! What the system says about the machine: clock, threads, neighbours, memory.

use super::finding::Finding;
use crate::environment::{Environment, Root};
use std::collections::BTreeSet;

/// Load above which somebody else is at work: the program itself has not begun.
const QUIET_LOAD: f64 = 0.5;

/// Least memory for the 300K-triangle cells of the default suite, each under 1 GiB, and the parent.
const ENOUGH_MEMORY: u64 = 4 << 30;

/// Share of stolen processor time that goes under in the noise of a shared machine.
const STEAL: f64 = 0.005;

/// The machine as `environment` and the files below `root` have it.
pub fn findings(root: &Root, environment: &Environment) -> Vec<Finding> {
    let (print, info) = (&environment.fingerprint, &environment.info);
    let known = |value: Option<String>| value.unwrap_or_else(|| "unknown".to_owned());
    let release = print.profile.as_deref() == Some("release");
    let cores = match (print.physical_cores, print.logical_cores) {
        (Some(cores), Some(threads)) => format!("{cores} cores, {threads} threads usable"),
        (None, Some(threads)) => format!("{threads} threads usable"),
        (cores, None) => known(cores.map(|c| format!("{c} cores"))),
    };
    vec![
        Finding::info("processor", known(print.cpu.clone())),
        Finding::info("cores", cores),
        Finding::new(
            "build",
            Some(release),
            known(print.profile.clone()),
            "measure with `cargo run --release`; debug builds are many times slower",
        ),
        Finding::new(
            "load",
            info.load1.map(|load| load < QUIET_LOAD),
            known(info.load1.map(|load| format!("{load:.2}"))),
            "other programs are running; end them, or expect noisy and slow figures",
        ),
        governor(root),
        Finding::new(
            "turbo",
            info.boost.map(|on| !on),
            known(info.boost.map(|on| if on { "on" } else { "off" }.to_owned())),
            "the clock depends on heat and on the other cores; for steady figures switch it off: \
             `echo 0 | sudo tee /sys/devices/system/cpu/cpufreq/boost` (Intel: `echo 1 | sudo tee \
             /sys/devices/system/cpu/intel_pstate/no_turbo`)",
        ),
        Finding::new(
            "SMT",
            info.smt.map(|on| !on),
            known(info.smt.map(|on| if on { "on" } else { "off" }.to_owned())),
            "two threads share a core; measure with at most as many --threads as there are cores, or `echo off | sudo tee \
             /sys/devices/system/cpu/smt/control`",
        ),
        Finding::new(
            "processor time",
            Some(print.cpu_quota.is_none()),
            print.cpu_quota.map_or_else(|| "no quota".to_owned(), |q| format!("a quota of {q} processors")),
            "the container is throttled when it uses more; give it whole processors",
        ),
        Finding::new(
            "virtual machine",
            info.virtual_machine.map(|vm| !vm),
            known(info.virtual_machine.map(|vm| if vm { "yes" } else { "no" }.to_owned())),
            "neighbours share caches and memory; compare only what was measured interleaved",
        ),
        Finding::info("container", info.container.as_deref().unwrap_or("no sign of one")),
        Finding::new(
            "memory",
            info.available_bytes.map(|bytes| bytes >= ENOUGH_MEMORY),
            known(info.available_bytes.map(|bytes| format!("{} MiB available", bytes >> 20))),
            "large meshes need more; cells are then measured in smaller batches",
        ),
        huge_pages(root),
    ]
}

/// The frequency governors of all cores.
fn governor(root: &Root) -> Finding {
    let cores = root.entries("sys/devices/system/cpu");
    let governors: BTreeSet<String> =
        cores.iter().filter_map(|core| root.text(core.join("cpufreq/scaling_governor"))).collect();
    let all = governors.iter().cloned().collect::<Vec<_>>().join(", ");
    Finding::new(
        "governor",
        (!governors.is_empty()).then(|| governors.iter().all(|g| g == "performance")),
        if all.is_empty() { "unknown".to_owned() } else { all },
        "run `sudo cpupower frequency-set -g performance`; otherwise the clock changes while measuring",
    )
}

/// Transparent huge pages: with `always` the kernel decides in the background when a factor gets them.
fn huge_pages(root: &Root) -> Finding {
    let setting = root.text("sys/kernel/mm/transparent_hugepage/enabled");
    let chosen = setting.and_then(|s| Some(s.split_once('[')?.1.split_once(']')?.0.to_owned()));
    Finding::info("huge pages", chosen.unwrap_or_else(|| "unknown".to_owned()))
}

/// Processor time that the hypervisor took away between two readings of (stolen, all) ticks.
pub fn steal(before: Option<(u64, u64)>, after: Option<(u64, u64)>) -> Finding {
    let share = before.zip(after).and_then(|((s0, t0), (s1, t1))| {
        let all = t1.checked_sub(t0).filter(|&all| all > 0)?;
        Some(s1.saturating_sub(s0) as f64 / all as f64)
    });
    Finding::new(
        "steal",
        share.map(|share| share <= STEAL),
        share.map_or_else(|| "unknown".to_owned(), |share| format!("{:.1}% of the time", 100.0 * share)),
        "the hypervisor gives this machine's processors to others; measure at a quieter hour or on another machine",
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::processor_ticks_in;
    use std::fs;

    fn look(files: &[(&str, &[u8])]) -> Vec<Finding> {
        let folder = tempfile::tempdir().unwrap();
        for (path, content) in files {
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, content).unwrap();
        }
        let root = Root(folder.path().to_owned());
        let mut found = findings(&root, &Environment::read_in(&root));
        found.push(steal(processor_ticks_in(&root), processor_ticks_in(&root)));
        found
    }

    fn of<'a>(findings: &'a [Finding], subject: &str) -> &'a Finding {
        findings.iter().find(|f| f.subject == subject).unwrap()
    }

    #[test]
    fn a_machine_without_any_file_is_unknown() {
        let found = look(&[]);
        for subject in ["processor", "load", "governor", "turbo", "SMT", "steal", "virtual machine", "memory"]
        {
            assert_eq!(
                (of(&found, subject).good, of(&found, subject).found.as_str()),
                (None, "unknown"),
                "{subject}"
            );
        }
    }

    #[test]
    fn garbage_is_unknown() {
        let garbage: &[u8] = b"\xff\xfe\x00 99999999999999999999999 kB [ : :";
        let found = look(&[
            ("proc/cpuinfo", garbage),
            ("proc/meminfo", b"MemAvailable: 99999999999999999999 kB"),
            ("proc/loadavg", b"very high"),
            ("proc/stat", b"cpu 1 2 three"),
            ("sys/fs/cgroup/cpu.max", b"0 0 0"),
            ("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor/folder", b"x"),
            ("sys/devices/system/cpu/smt/active", garbage),
            ("sys/kernel/mm/transparent_hugepage/enabled", b"]always["),
        ]);
        for subject in ["processor", "load", "governor", "SMT", "steal", "memory", "huge pages"] {
            assert_eq!(of(&found, subject).found, "unknown", "{subject}");
        }
    }

    #[test]
    fn a_noisy_machine_is_told_what_to_do() {
        let found = look(&[
            ("proc/cpuinfo", b"model name : Some CPU\nflags : hypervisor\n"),
            ("proc/loadavg", b"3.50 1 1 1/1 1"),
            ("proc/meminfo", b"MemAvailable: 1000 kB"),
            ("sys/fs/cgroup/cpu.max", b"150000 100000"),
            ("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", b"performance"),
            ("sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", b"powersave"),
            ("sys/devices/system/cpu/intel_pstate/no_turbo", b"0"),
            ("sys/devices/system/cpu/smt/active", b"1"),
            ("sys/kernel/mm/transparent_hugepage/enabled", b"always [madvise] never"),
        ]);
        for (subject, part) in [
            ("load", "3.50"),
            ("governor", "performance, powersave"),
            ("turbo", "on"),
            ("SMT", "on"),
            ("processor time", "1.5"),
            ("virtual machine", "yes"),
            ("memory", "0 MiB"),
        ] {
            let finding = of(&found, subject);
            assert!(finding.good == Some(false) && finding.found.contains(part), "{finding:?}");
            assert!(finding.remedy.as_ref().is_some_and(|r| r.len() > 20), "{finding:?}");
        }
        assert_eq!(of(&found, "huge pages").found, "madvise");
    }

    #[test]
    fn stolen_time_is_a_share() {
        assert_eq!(steal(Some((0, 0)), Some((1, 100))).good, Some(false));
        assert_eq!(steal(Some((5, 1000)), Some((5, 2000))).good, Some(true));
        for (before, after) in
            [(None, Some((0, 1))), (Some((9, 9)), Some((9, 9))), (Some((9, 9)), Some((1, 1)))]
        {
            assert_eq!(steal(before, after).good, None);
        }
    }
}
