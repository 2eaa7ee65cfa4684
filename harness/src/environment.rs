//! The machine and the build, as far as they are known. What is not known is null, never a guess.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Where a result was made.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Environment {
    /// What must be the same before two results may be compared.
    pub fingerprint: Fingerprint,
    /// What helps to read a result.
    pub info: Info,
}

/// What must match for a comparison of times.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Fingerprint {
    /// Processor model.
    pub cpu: Option<String>,
    /// Cores.
    pub physical_cores: Option<usize>,
    /// Hardware threads.
    pub logical_cores: Option<usize>,
    /// Processors' worth of time that the control group grants; null without a quota.
    pub cpu_quota: Option<f64>,
    /// Vector instruction sets of the processor.
    pub instruction_sets: Vec<String>,
    /// Operating system and architecture.
    pub os: String,
    /// Major and minor version of the kernel.
    pub kernel: Option<String>,
    /// Compiler of the program.
    pub rustc: Option<String>,
    /// Compiler flags beyond the defaults.
    pub rustflags: Option<String>,
    /// "release" or "debug".
    pub profile: Option<String>,
    /// SHA-256 of the dependency lock file.
    pub dependencies_sha256: String,
    /// GPUs and their drivers, as the operating system names them.
    pub gpus: Vec<String>,
}

/// What is worth knowing but may differ.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Info {
    /// UTC, ISO 8601.
    pub time: String,
    /// Version of this program.
    pub program: String,
    /// Commit the program was built from, "-dirty" with local changes.
    pub commit: Option<String>,
    /// Memory of the machine, bytes.
    pub memory_bytes: Option<u64>,
    /// Memory available at the start, bytes.
    pub available_bytes: Option<u64>,
    /// Frequency governor of the first core.
    pub governor: Option<String>,
    /// Whether the processor may exceed its base frequency.
    pub boost: Option<bool>,
    /// Whether cores run two threads.
    pub smt: Option<bool>,
    /// Version of the processor's microcode.
    pub microcode: Option<String>,
    /// Whether addresses are randomised.
    pub aslr: Option<bool>,
    /// Whether a hypervisor runs the machine.
    pub virtual_machine: Option<bool>,
    /// Kind of container, where there are signs of one.
    pub container: Option<String>,
    /// One-minute load average at the start.
    pub load1: Option<f64>,
    /// One-minute load average at the end.
    pub load1_end: Option<f64>,
    /// Share of processor time that the hypervisor took away during the run.
    pub steal: Option<f64>,
}

/// How a program was built.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct BuildRecord {
    /// Commit, "-dirty" with local changes.
    pub commit: Option<String>,
    /// Compiler.
    pub rustc: Option<String>,
    /// Compiler flags beyond the defaults.
    pub rustflags: Option<String>,
    /// "release" or "debug".
    pub profile: Option<String>,
    /// What it was compiled for.
    pub target: Option<String>,
}

impl BuildRecord {
    /// Of this program.
    pub fn of_this_program() -> Self {
        let value = |value: &'static str| (!value.is_empty()).then(|| value.to_owned());
        Self {
            commit: value(env!("LAPBENCH_COMMIT")),
            rustc: value(env!("LAPBENCH_RUSTC")),
            rustflags: value(env!("LAPBENCH_RUSTFLAGS")),
            profile: value(env!("LAPBENCH_PROFILE")),
            target: value(env!("LAPBENCH_TARGET")),
        }
    }
}

impl Environment {
    /// Looks at this machine, now.
    pub fn read() -> Self {
        Self::read_in(&Root::default())
    }

    /// The same with the system's files below another folder.
    pub fn read_in(root: &Root) -> Self {
        let cpuinfo = root.text("proc/cpuinfo").unwrap_or_default();
        Self { fingerprint: Fingerprint::read(root, &cpuinfo), info: Info::read(root, &cpuinfo) }
    }
}

impl Fingerprint {
    fn read(root: &Root, cpuinfo: &str) -> Self {
        let build = BuildRecord::of_this_program();
        Self {
            cpu: field(cpuinfo, "model name").or_else(|| field(cpuinfo, "CPU part")),
            physical_cores: physical_cores(cpuinfo),
            logical_cores: std::thread::available_parallelism().ok().map(Into::into),
            cpu_quota: root.text("sys/fs/cgroup/cpu.max").as_deref().and_then(cpu_quota),
            instruction_sets: instruction_sets(cpuinfo),
            os: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            kernel: root.text("proc/sys/kernel/osrelease").as_deref().and_then(major_minor),
            rustc: build.rustc,
            rustflags: build.rustflags,
            profile: build.profile,
            dependencies_sha256: hexadecimal(&Sha256::digest(include_bytes!("../../Cargo.lock"))),
            gpus: gpus(root),
        }
    }

    /// The members in which two fingerprints differ, each with both values.
    pub fn differences(&self, other: &Self) -> Vec<String> {
        let members = |f: &Self| serde_json::to_value(f).expect("plain data");
        let (serde_json::Value::Object(a), serde_json::Value::Object(b)) = (members(self), members(other))
        else {
            unreachable!("a struct is an object")
        };
        a.iter()
            .filter(|(k, v)| b.get(*k) != Some(*v))
            .map(|(k, v)| format!("{k}: {v} and {}", b[k]))
            .collect()
    }
}

impl Info {
    fn read(root: &Root, cpuinfo: &str) -> Self {
        let memory = root.text("proc/meminfo").unwrap_or_default();
        Self {
            time: timestamp(SystemTime::now()),
            program: env!("CARGO_PKG_VERSION").to_owned(),
            commit: BuildRecord::of_this_program().commit,
            memory_bytes: crate::process::kilobytes(&memory, "MemTotal"),
            available_bytes: crate::process::kilobytes(&memory, "MemAvailable"),
            governor: root.text("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
            boost: boost(root),
            smt: root.text("sys/devices/system/cpu/smt/active").map(|s| s == "1"),
            microcode: field(cpuinfo, "microcode"),
            aslr: root.text("proc/sys/kernel/randomize_va_space").map(|s| s != "0"),
            virtual_machine: field(cpuinfo, "flags").map(|f| f.split(' ').any(|f| f == "hypervisor")),
            container: container(root),
            load1: load1_in(root),
            load1_end: None,
            steal: None,
        }
    }
}

/// Processor time since boot, in ticks: (stolen by the hypervisor, all). Differences of two readings give a share.
pub fn processor_ticks() -> Option<(u64, u64)> {
    processor_ticks_in(&Root::default())
}

/// The same with the system's files below another folder.
pub fn processor_ticks_in(root: &Root) -> Option<(u64, u64)> {
    let stat = root.text("proc/stat")?;
    let ticks: Vec<u64> =
        stat.lines().next()?.split_whitespace().skip(1).take(8).map_while(|t| t.parse().ok()).collect();
    Some((*ticks.get(7)?, ticks.iter().sum()))
}

/// One-minute load average.
pub fn load1() -> Option<f64> {
    load1_in(&Root::default())
}

fn load1_in(root: &Root) -> Option<f64> {
    root.text("proc/loadavg")?.split(' ').next()?.parse().ok()
}

/// Lower-case hexadecimal digits.
pub fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// The folder below which the system's files are: `/`, or a copy of another machine's.
#[derive(Clone, Debug)]
pub struct Root(pub PathBuf);

impl Default for Root {
    fn default() -> Self {
        Self(PathBuf::from("/"))
    }
}

impl Root {
    /// A path below it: relative ones are taken from there, those that are below it already stay.
    pub fn path(&self, path: impl AsRef<Path>) -> PathBuf {
        let path = path.as_ref();
        if path.starts_with(&self.0) { path.to_owned() } else { self.0.join(path) }
    }

    /// A small text file without surrounding blanks; `None` where it is absent, unreadable or no text.
    pub fn text(&self, path: impl AsRef<Path>) -> Option<String> {
        fs::read_to_string(self.path(path)).ok().map(|s| s.trim().to_owned())
    }

    /// The entries of a folder, sorted; none where it is absent or unreadable.
    pub fn entries(&self, path: impl AsRef<Path>) -> Vec<PathBuf> {
        let mut entries: Vec<PathBuf> =
            fs::read_dir(self.path(path)).into_iter().flatten().flatten().map(|e| e.path()).collect();
        entries.sort();
        entries
    }
}

/// The first `name : value` of /proc/cpuinfo.
fn field(cpuinfo: &str, name: &str) -> Option<String> {
    cpuinfo.lines().find_map(|line| {
        let (key, value) = line.split_once(':')?;
        (key.trim() == name).then(|| value.trim().to_owned())
    })
}

fn physical_cores(cpuinfo: &str) -> Option<usize> {
    let (mut package, mut cores) = (String::new(), BTreeSet::new());
    for line in cpuinfo.lines() {
        match line.split_once(':').map(|(k, v)| (k.trim(), v.trim())) {
            Some(("physical id", id)) => package = id.to_owned(),
            Some(("core id", id)) => drop(cores.insert((package.clone(), id.to_owned()))),
            _ => {}
        }
    }
    (!cores.is_empty()).then_some(cores.len())
}

/// Vector and fused multiply-add instructions that solvers choose by.
fn instruction_sets(cpuinfo: &str) -> Vec<String> {
    const NAMES: [&str; 12] = [
        "sse4_2",
        "avx",
        "avx2",
        "fma",
        "avx512f",
        "avx512dq",
        "avx512bw",
        "avx512vl",
        "avx512_vnni",
        "asimd",
        "sve",
        "sve2",
    ];
    let flags = field(cpuinfo, "flags").or_else(|| field(cpuinfo, "Features")).unwrap_or_default();
    NAMES.iter().filter(|name| flags.split(' ').any(|f| f == **name)).map(|&name| name.to_owned()).collect()
}

/// "200000 100000" is two processors' worth; "max 100000" is no quota.
fn cpu_quota(cpu_max: &str) -> Option<f64> {
    let (quota, period) = cpu_max.split_once(' ')?;
    Some(quota.parse::<f64>().ok()? / period.parse::<f64>().ok()?).filter(|share| share.is_finite())
}

fn major_minor(release: &str) -> Option<String> {
    let mut parts = release.split('.');
    Some(format!("{}.{}", parts.next()?, parts.next()?))
}

fn boost(root: &Root) -> Option<bool> {
    root.text("sys/devices/system/cpu/cpufreq/boost")
        .map(|s| s == "1")
        .or_else(|| root.text("sys/devices/system/cpu/intel_pstate/no_turbo").map(|s| s == "0"))
}

fn container(root: &Root) -> Option<String> {
    let marks = [(".dockerenv", "docker"), ("run/.containerenv", "podman")];
    let by_file = marks.iter().find(|(path, _)| root.path(path).exists()).map(|&(_, kind)| kind.to_owned());
    by_file.or_else(|| root.text("run/systemd/container"))
}

/// GPUs of the proprietary NVIDIA driver, which names them in /proc, and PCI ids of all others.
fn gpus(root: &Root) -> Vec<String> {
    let driver = root
        .text("proc/driver/nvidia/version")
        .and_then(|v| {
            v.split_whitespace().find(|w| w.starts_with(|c: char| c.is_ascii_digit())).map(str::to_owned)
        })
        .unwrap_or_default();
    let nvidia = root
        .entries("proc/driver/nvidia/gpus")
        .into_iter()
        .filter_map(|gpu| field(&root.text(gpu.join("information"))?, "Model"))
        .map(|model| format!("{model} (driver {driver})"));
    let others = root.entries("sys/class/drm").into_iter().filter_map(|card| {
        let name = card.file_name()?.to_str()?.to_owned();
        let digits = name.strip_prefix("card")?;
        digits.bytes().all(|b| b.is_ascii_digit()).then_some(())?;
        let id = |what| root.text(card.join("device").join(what));
        Some(format!("PCI {} {}", id("vendor")?, id("device")?))
    });
    let mut gpus: Vec<String> = nvidia.chain(others).collect();
    gpus.sort();
    gpus
}

/// 2026-03-21T04:05:06Z.
fn timestamp(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
    let (days, rest) = (seconds / 86_400, seconds % 86_400);
    let (year, month, day) = civil(days);
    format!("{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}Z", rest / 3600, rest / 60 % 60, rest % 60)
}

/// Year, month, day of a day number since 1970-01-01, in the Gregorian calendar. Years start in March, so that the leap
/// day comes last and months have lengths 153 m / 5.
fn civil(days: u64) -> (u64, u64, u64) {
    let days = days + 719_468; // from 0000-03-01
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1_460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let date = day - (153 * month + 2) / 5 + 1;
    let (month, carry) = if month < 10 { (month + 3, 0) } else { (month - 9, 1) };
    (400 * era + year + carry, month, date)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    const CPUINFO: &str = "processor\t: 0\nmodel name\t: Some CPU @ 2GHz\nphysical id\t: 0\ncore id\t\t: 0\n\
        flags\t\t: fpu avx avx2 hypervisor\n\nprocessor\t: 1\nphysical id\t: 0\ncore id\t\t: 0\n\
        \nprocessor\t: 2\nphysical id\t: 1\ncore id\t\t: 0\n";

    #[test]
    fn cpuinfo_is_read() {
        assert_eq!(field(CPUINFO, "model name").as_deref(), Some("Some CPU @ 2GHz"));
        assert_eq!(physical_cores(CPUINFO), Some(2));
        assert_eq!(instruction_sets(CPUINFO), ["avx", "avx2"]);
        assert_eq!((physical_cores(""), field("", "flags")), (None, None));
    }

    #[test]
    fn quotas_and_kernels() {
        assert_eq!(cpu_quota("150000 100000"), Some(1.5));
        assert_eq!(cpu_quota("max 100000"), None);
        assert_eq!(major_minor("6.18.44-custom"), Some("6.18".into()));
    }

    #[test]
    fn dates_of_the_calendar() {
        let at = |seconds| timestamp(UNIX_EPOCH + Duration::from_secs(seconds));
        assert_eq!(at(0), "1970-01-01T00:00:00Z");
        assert_eq!(at(951_782_399), "2000-02-28T23:59:59Z");
        assert_eq!(at(951_782_400), "2000-02-29T00:00:00Z");
        assert_eq!(at(1_767_225_599), "2025-12-31T23:59:59Z");
    }

    #[test]
    fn differences_name_the_member() {
        let a = Environment::read().fingerprint;
        let b = Fingerprint { cpu: Some("other".into()), ..a.clone() };
        assert!(a.differences(&a).is_empty());
        assert!(a.differences(&b)[0].starts_with("cpu: "), "{:?}", a.differences(&b));
    }
}
