//! Exit codes, formats, files.

use super::{lapbench, program, read, run};
use lapbench::record::names::Status;

fn code(arguments: &str) -> i32 {
    lapbench(arguments).status.code().expect("an exit code")
}

fn stdout(arguments: &str) -> String {
    let output = lapbench(arguments);
    assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

#[test]
fn usage_errors_are_2() {
    for arguments in [
        "run --no-such-flag",
        "run --backend nobody",
        "run --workload nothing",
        "run --threads 0",
        "run --tol -1",
        "run --shard 3/3",
        "solve --mesh sphere:1 --out x.csv",
        "peer",
        "peer --backend nobody",
    ] {
        assert_eq!(code(arguments), 2, "{arguments}");
    }
}

#[test]
fn a_cell_has_every_figure_of_the_contract() {
    let (exit, cells, stderr) = run("--backend dense");
    assert_eq!((exit, cells.len()), (0, 1), "{stderr}");
    let cell = &cells[0];
    assert_eq!(cell.status, Status::Ok, "{:?}", cell.reason);
    assert!(cell.complete && cell.solve_ns.samples.is_some_and(|n| n > 1));
    assert_eq!(cell.allocations_per_frame, Some(0.0));
    let p = &cell.phases_ns;
    assert!(p.load.is_some() && p.assemble.is_some() && p.numeric.is_some() && p.first_solve.is_some());
    assert!(cell.accuracy.backward_error.is_some_and(|eta| eta < 1e-14));
    assert_eq!(cell.accuracy.certifiable, Some(true));
    assert!(cell.update_ns.p50.is_some() && cell.bandwidth.fraction_of_read.is_some());
    assert!(cell.peak_rss_bytes.is_some_and(|bytes| bytes > 1 << 20));
    assert_eq!(cell.mesh.sha256.as_ref().map(String::len), Some(64));
}

#[test]
fn edits_are_timed_and_checked_where_a_backend_has_them() {
    let (_, cells, stderr) = run("--workload harmonic-edit --backend framechol-f64,dense");
    let cells: Vec<_> = cells.into_iter().filter(|cell| cell.workload == "harmonic-edit").collect();
    let [edits, none] = &cells[..] else { panic!("{stderr}") };
    assert_eq!(edits.status, Status::Ok, "{:?}", edits.reason);
    assert!(edits.solve_ns.samples.is_some_and(|n| n > 1) && edits.bandwidth.bytes_per_solve.is_none());
    assert_eq!(edits.accuracy.certifiable, Some(true), "the last field has a reference");
    assert_eq!(none.status, Status::Unsupported, "{:?}", none.reason);
}

#[test]
fn every_format_of_every_listing() {
    let json: serde_json::Value = serde_json::from_str(&stdout("list --format json")).expect("JSON");
    for (kind, id) in
        [("backends", "dense"), ("backends", "absent"), ("workloads", "harmonic"), ("meshes", "body:N")]
    {
        let rows = json[kind].as_array().expect("rows");
        assert!(rows.iter().any(|row| row["id"] == id), "{kind} {id}");
    }
    let absent =
        json["backends"].as_array().expect("rows").iter().find(|row| row["id"] == "absent").expect("a row");
    assert_eq!(
        (absent["available"].as_bool(), absent["reason"].as_str()),
        (Some(false), Some("no such device: buy one"))
    );
    assert!(stdout("list --format csv").starts_with("kind,name,"));
    assert!(stdout("list --format markdown").starts_with("| kind | name |"));
    for format in ["human", "json", "csv", "markdown"] {
        assert!(!stdout(&format!("doctor --seconds 0 --format {format}")).is_empty());
    }
    for shell in ["bash", "zsh", "fish"] {
        assert!(stdout(&format!("completions {shell}")).contains("lapbench"));
    }
}

#[test]
fn run_prints_its_result_in_every_format() {
    let base = "run --quick --mesh sphere:2 --workload harmonic --backend dense --threads 1 --cell-time 0.05 --format";
    let json: serde_json::Value = serde_json::from_str(&stdout(&format!("{base} json"))).expect("JSON");
    assert_eq!(json["cells"][0]["status"], "ok");
    let csv = stdout(&format!("{base} csv"));
    assert_eq!(csv.lines().count(), 2);
    assert_eq!(
        csv.lines().next().map(|l| l.split(',').count()),
        csv.lines().nth(1).map(|l| l.split(',').count())
    );
    assert!(stdout(&format!("{base} markdown")).contains("| sphere:2 | harmonic | dense | 1 | ok |"));
    assert!(stdout(&format!("{base} human")).lines().all(|line| line.chars().count() <= 120));
}

#[test]
fn the_schema_describes_the_file() {
    let schema: serde_json::Value = serde_json::from_str(&stdout("schema")).expect("JSON");
    let (_, cells, _) = run("--backend dense");
    let cell = serde_json::to_value(&cells[0]).expect("plain data");
    let described = schema.pointer("/$defs/Cell/properties").and_then(|p| p.as_object()).expect("a cell");
    for member in cell.as_object().expect("an object").keys() {
        assert!(described.contains_key(member), "{member} is not in the schema");
    }
}

#[test]
fn an_unreadable_mesh_is_an_error_row_and_the_others_still_run() {
    let (exit, cells, stderr) = run("--backend dense --mesh absent.ply");
    assert_eq!(exit, 1);
    assert!(stderr.contains("absent.ply") && stderr.contains("exit 1"), "{stderr}");
    let status = |mesh: &str| cells.iter().find(|c| c.mesh.name == mesh).map(|c| c.status);
    assert_eq!(status("absent.ply"), Some(Status::Error));
    assert_eq!(status("sphere:3"), Some(Status::Ok));
}

#[test]
fn an_unwritable_result_is_found_before_anything_is_measured() {
    for out in ["/proc/no/such/folder", "/dev/full", "/dev/null/r.json", "/"] {
        let begin = std::time::Instant::now();
        let output = lapbench(&format!("run --mesh body:294000 --backend dense --out {out}"));
        assert_eq!(output.status.code(), Some(1), "{out}");
        assert!(String::from_utf8_lossy(&output.stderr).contains(out), "{out}");
        assert!(begin.elapsed().as_secs() < 5, "{out}");
    }
    let output = program().arg("run").env("TMPDIR", "/no/such/folder").output().expect("starts");
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("TMPDIR"));
}

#[test]
fn a_resumed_run_keeps_what_is_finished() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("r.json").display().to_string();
    let base = "run --quick --mesh sphere:2 --workload harmonic --threads 1 --cell-time 0.05";
    assert_eq!(code(&format!("{base} --backend dense --out {path}")), 0);
    let first = read(path.as_ref()).cells.remove(0);
    assert_eq!(code(&format!("{base} --backend slow,dense --resume {path}")), 0);
    let cells = read(path.as_ref()).cells;
    assert_eq!(cells.len(), 2);
    assert!(cells.contains(&first));

    let elsewhere =
        std::fs::read_to_string(&path).expect("text").replacen("\"cpu\":", "\"cpu\":\"other\",\"x\":", 1);
    std::fs::write(&path, elsewhere).expect("written");
    assert_eq!(code(&format!("{base} --backend dense --resume {path}")), 6);
}

#[test]
fn shards_share_the_cells() {
    let ids = |shard: &str| {
        let (_, cells, _) = run(&format!("--backend dense,slow,allocates --shard {shard}"));
        cells.iter().map(|c| c.backend.clone()).collect::<Vec<_>>()
    };
    assert_eq!((ids("0/2"), ids("1/2")), (vec!["dense".into(), "allocates".into()], vec!["slow".to_owned()]));
}

#[test]
fn compare_finds_what_got_worse() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = |name: &str| folder.path().join(name).display().to_string();
    let base = "run --quick --mesh sphere:2 --workload harmonic --threads 1 --cell-time 0.05";
    assert_eq!(code(&format!("{base} --backend dense,slow --out {}", file("a"))), 0);
    assert_eq!(code(&format!("{base} --backend dense --out {}", file("b"))), 0);
    let output = stdout(&format!("compare {} {} --format json", file("b"), file("a")));
    let pairs: serde_json::Value = serde_json::from_str(&output).expect("JSON");
    assert!(pairs[0]["ratio"].as_f64().is_some_and(|r| r > 0.0));
    assert_eq!(code(&format!("compare {} {}", file("a"), file("b"))), 3, "a cell is gone");
    assert_eq!(code(&format!("compare {} {}", file("a"), file("none"))), 1);
}

#[test]
fn frames_are_checked_and_a_subdivided_mesh_follows_its_coarse_form() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("r.json");
    for (arguments, name) in [("", "sphere:2"), ("--subdivide 1", "sphere:2+loop1")] {
        let base =
            "run --quick --workload transfer --backend dense --threads 1 --cell-time 0.1 --mesh sphere:2";
        assert_eq!(code(&format!("{base} {arguments} --out {}", out.display())), 0);
        let cell = &read(&out).cells[0];
        assert_eq!(cell.mesh.name, name);
        assert_eq!(cell.status, Status::Ok, "{:?}", cell.reason);
        assert!(
            cell.frame_ns.p50.is_some() && cell.solve_ns.p50.is_none() && cell.frames_per_second.is_some()
        );
        assert_eq!(cell.allocations_per_frame, Some(0.0));
        let accuracy = &cell.accuracy;
        assert!(accuracy.backward_error.is_some() && accuracy.constraint_error.is_some(), "{accuracy:?}");
        assert!(accuracy.forward_error.is_some_and(|e| e < 1e-9), "{accuracy:?}");
    }
    let (exit, cells, _) = run("--workload transfer --backend wrong");
    let wrong = cells.iter().find(|c| c.workload == "transfer").expect("a row");
    assert_eq!((exit, wrong.status), (4, Status::Invalid), "{:?}", wrong.reason);
}

#[test]
fn requirements() {
    assert_eq!(run("--backend dense --require dense").0, 0);
    let (exit, cells, stderr) = run("--backend absent --require abs");
    assert_eq!((exit, cells[0].status), (1, Status::Unavailable));
    assert!(stderr.contains("--require abs"));
    assert_eq!(run("--backend absent").0, 0, "unavailable alone is no failure");
}

#[test]
fn rates_are_kept_or_missed() {
    let (exit, cells, _) = run("--backend slow --require-hz 1000");
    assert_eq!(exit, 3);
    let run_at = &cells[0].open_loop[0];
    assert!(run_at.misses == run_at.frames && run_at.frames > 0, "{run_at:?}");
    let (exit, cells, stderr) = run("--backend dense --require-hz 200 --mesh sphere:1");
    assert_ne!(exit, 4, "{stderr}");
    // A busy machine may end the schedule before its 600 frames; it never makes up a rate.
    let rates = cells.iter().map(|c| c.open_loop.first().map(|o| (o.hz, o.frames > 300)));
    assert!(rates.clone().all(|rate| rate == Some((200.0, true))), "{:?}", rates.collect::<Vec<_>>());
}

#[test]
fn solve_and_matrix_write_what_they_say() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = |name: &str| folder.path().join(name).display().to_string();
    let (csv, npy, mtx) = (file("x.csv"), file("x.npy"), file("a.mtx"));
    let solve = "solve --mesh sphere:2 --workload harmonic --backend dense --out";
    assert_eq!((code(&format!("{solve} {csv}")), code(&format!("{solve} {npy}"))), (0, 0));
    let text = std::fs::read_to_string(&csv).expect("text");
    assert!(text.lines().count() == 162 && text.lines().all(|l| l.split(',').count() == 4));
    assert_eq!(lapbench::mesh_io::npy::read(npy.as_ref()).expect("an array").shape, [162, 4]);
    assert_eq!(code(&format!("matrix --mesh sphere:2 --which screened --out {mtx}")), 0);
    assert_eq!(code(&format!("solve --matrix {mtx} --backend dense --out {csv}")), 0);
    assert_eq!(code("solve --mesh sphere:2 --backend wrong --out /dev/null"), 4);
    assert_eq!(code("solve --mesh sphere:2 --backend absent --out /dev/null"), 1);
    assert_eq!(code(&format!("solve --mesh absent.ply --backend dense --out {csv}")), 1);
}
