//! Foreign programs on the peer protocol: honest, lying, flooding, silent.

use super::program;
use lapbench::record::names::Status;
use lapbench::record::result::Cell;

/// The cell of a peer that is a shell script (which may use single quotes).
fn cell_of(script: &str) -> Cell {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (path, out) = (folder.path().join("peer.sh"), folder.path().join("r.json"));
    std::fs::write(&path, script).expect("written");
    let output = program()
        .args("run --quick --mesh sphere:1 --workload harmonic --threads 1 --cell-timeout 2 --out".split(' '))
        .arg(&out)
        .arg("--peer")
        .arg(format!("script=sh {}", path.display()))
        .output()
        .expect("the program starts");
    assert!(output.status.code().is_some_and(|code| [0, 1, 4].contains(&code)), "{output:?}");
    super::read(&out).cells.remove(0)
}

const DESCRIBED: &str = r#"{"id":1,"ok":{"protocol":1,"precision":"f64","accuracy":"direct","device":"cpu","device_type":"cpu","threads":1}}"#;

/// A script that describes itself, then does `rest`.
fn described(rest: &str) -> Cell {
    cell_of(&format!("read l; echo '{DESCRIBED}'\n{rest}"))
}

#[test]
fn an_absent_peer_is_unavailable_or_an_error_row() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("r.json");
    let output = program()
        .args("run --quick --mesh sphere:1 --workload harmonic --peer x=/no/such/solver --out".split(' '))
        .arg(&out)
        .output()
        .expect("the program starts");
    assert_eq!(output.status.code(), Some(1));
    let cell = super::read(&out).cells.remove(0);
    assert!(cell.reason.is_some_and(|r| r.contains("/no/such/solver")));
}

#[test]
fn another_protocol_is_unsupported() {
    let cell =
        cell_of(&format!("read l; echo '{}'; read l", DESCRIBED.replace("\"protocol\":1", "\"protocol\":9")));
    assert_eq!(cell.status, Status::Unsupported);
}

#[test]
fn a_refusal_is_the_peer_s_own_word() {
    let cell = described(
        r#"read l; echo '{"id":2,"error":{"kind":"unsupported","message":"no such problem"}}'; read l"#,
    );
    assert_eq!((cell.status, cell.reason.as_deref()), (Status::Unsupported, Some("no such problem")));
}

#[test]
fn a_solution_that_is_not_there_is_an_error() {
    let cell = described(
        r#"read l; echo '{"id":2,"ok":{}}'
           read l; echo '{"id":3,"ok":{"samples_ns":[5]}}'; read l"#,
    );
    assert_eq!(cell.status, Status::Error);
    assert!(cell.reason.is_some_and(|r| r.contains("solution")));
}

#[test]
fn samples_must_be_as_many_as_asked_and_fit_into_the_time() {
    for (samples, word) in [("[]", "0 samples"), ("[1,2]", "2 samples"), ("[999999999999999]", "claims")] {
        let cell = described(&format!(
            "read l; echo '{{\"id\":2,\"ok\":{{}}}}'; read l; echo '{{\"id\":3,\"ok\":{{\"samples_ns\":{samples}}}}}'; read l"
        ));
        assert_eq!(cell.status, Status::Error, "{samples}");
        assert!(cell.reason.as_deref().is_some_and(|r| r.contains(word)), "{:?}", cell.reason);
    }
}

#[test]
fn noise_floods_and_silence() {
    assert_eq!(cell_of("yes").status, Status::Error);
    assert_eq!(cell_of("cat /dev/urandom").status, Status::Error);
    assert_eq!(described("yes >&2").status, Status::Timeout);
    assert_eq!(cell_of("sleep 100").status, Status::Timeout);
    assert_eq!(described("exit 0").status, Status::Error);
}

/// A peer whose answers are right and whose clock is not: `dense`, with every sample divided by 1000 on its way.
#[test]
fn a_clock_that_flatters_is_invalid() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (script, out) = (folder.path().join("peer.py"), folder.path().join("r.json"));
    std::fs::write(&script, FLATTERING).expect("written");
    let program_path = program().get_program().to_owned();
    let output = program()
        .args("run --quick --mesh sphere:4 --workload harmonic --threads 1 --cell-time 1 --out".split(' '))
        .arg(&out)
        .arg("--peer")
        .arg(format!("flattering=python3 {} {}", script.display(), program_path.display()))
        .output()
        .expect("the program starts");
    let cell = super::read(&out).cells.remove(0);
    assert_eq!((output.status.code(), cell.status), (Some(4), Status::Invalid), "{:?}", cell.reason);
    assert!(cell.reason.is_some_and(|r| r.contains("leaves most of the work out")));
    assert_eq!((cell.solve_ns.p50, cell.samples_ns.len()), (None, 0));
}

const FLATTERING: &str = r#"
import json, subprocess, sys
honest = subprocess.Popen([sys.argv[1], "peer", "--backend", "nalgebra-cholesky"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
for line in sys.stdin:
    honest.stdin.write(line)
    honest.stdin.flush()
    answer = json.loads(honest.stdout.readline())
    if "samples_ns" in answer.get("ok", {}):
        answer["ok"]["samples_ns"] = [t // 1000 + 1 for t in answer["ok"]["samples_ns"]]
    print(json.dumps(answer), flush=True)
"#;
