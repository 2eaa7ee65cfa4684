//! The peer protocol from both ends: a served backend answers every line, whatever it says, and the harness reads every
//! answer, however false.

use std::path::Path;

use lapbench::engine::array_file::ArrayFile;
use lapbench::engine::child;
use lapbench::engine::protocol::{Described, Memory, Outcome, Timed, parse_answer};
use lapsolve::registry;
use proptest::prelude::*;
use proptest::sample::Index;

use crate::check_that_nothing_panicked;

/// Arrays of a 3 x 3 system, which the requests of the corpus name as `@NAME`.
struct Files(tempfile::TempDir);

impl Files {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let write = |name: &str| folder.path().join(name);
        ArrayFile::write(&write("starts"), &[0u32, 2, 4, 5], 1).expect("written");
        ArrayFile::write(&write("columns"), &[0u32, 1, 1, 2, 2], 1).expect("written");
        ArrayFile::write(&write("values"), &[2.0, -1.0, 2.0, -1.0, 2.0], 1).expect("written");
        ArrayFile::write(&write("rhs"), &[1.0, 0.0, 1.0], 1).expect("written");
        ArrayFile::write(&write("fixed"), &[0u32], 1).expect("written");
        ArrayFile::write(&write("points"), &[0.0; 9], 3).expect("written");
        ArrayFile::write(&write("triangles"), &[0u32, 1, 2], 3).expect("written");
        Self(folder)
    }

    /// The text with every `@` replaced by this folder.
    fn locate(&self, text: &str) -> String {
        text.replace('@', &format!("{}/", self.0.path().display()))
    }
}

fn corpus(name: &str) -> Vec<(String, String)> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus/protocol").join(name);
    let text = std::fs::read_to_string(path).expect("committed");
    let lines: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).collect();
    lines.chunks_exact(2).map(|pair| (pair[0].to_owned(), pair[1].trim().to_owned())).collect()
}

/// What a served `dense` answers to these bytes, line by line.
fn served(input: &[u8]) -> Vec<String> {
    let mut output = Vec::new();
    let entry = registry::find("dense").expect("always there");
    child::serve(entry, input, &mut output).expect("memory takes everything");
    String::from_utf8(output).expect("answers are text").lines().map(str::to_owned).collect()
}

#[test]
fn every_request_of_the_corpus_has_its_declared_answer() {
    check_that_nothing_panicked();
    let files = Files::new();
    let cases = corpus("requests.txt");
    let input: String = cases.iter().map(|(request, _)| files.locate(request) + "\n").collect();
    let answers = served(input.as_bytes());
    assert_eq!(answers.len(), cases.len(), "one answer for each request");
    for ((request, expected), answer) in cases.iter().zip(&answers) {
        assert!(answer.contains(expected.as_str()), "{request}\n  gave {answer}\n  not {expected}");
    }
    check_that_nothing_panicked();
}

#[test]
fn every_answer_of_the_corpus_is_read_as_declared() {
    for (line, expected) in corpus("answers.txt") {
        let found = match parse_answer::<Timed>(line.as_bytes(), 1) {
            Ok(Outcome::Ok(timed)) => format!("ok {:?}", timed.samples_ns),
            Ok(Outcome::Error(refusal)) => format!("{:?} {}", refusal.kind, refusal.message),
            Err(lie) => format!("lie {lie}"),
        };
        assert!(found.starts_with(&expected), "{line}\n  gave {found}\n  not {expected}");
    }
}

/// Requests of the corpus with a few bytes changed: the words of the protocol at wrong places are what a mistaken
/// program sends.
fn damage(text: &str, changes: &[(Index, u8)]) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    for (at, byte) in changes.iter().filter(|_| !text.is_empty()) {
        let at = at.index(bytes.len());
        bytes[at] = if *byte == b'\n' { b' ' } else { *byte };
    }
    bytes.push(b'\n');
    bytes
}

/// A damaged `solution` path must not be written outside of the temporary folder.
fn stays_inside(line: &[u8], files: &Files) -> bool {
    let text = String::from_utf8_lossy(line);
    let folder = files.0.path().to_string_lossy().into_owned();
    !text.contains("solution") || text.matches(&folder).count() >= 2
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_damaged_session_is_answered_line_by_line(
        which in prop::collection::vec(any::<Index>(), 1..8),
        changes in prop::collection::vec((any::<Index>(), any::<u8>()), 0..4),
    ) {
        thread_local!(static CASES: Vec<(String, String)> = corpus("requests.txt"));
        check_that_nothing_panicked();
        let files = Files::new();
        let lines: Vec<Vec<u8>> = CASES.with(|cases| {
            which.iter().map(|at| damage(&files.locate(&at.get(cases).0), &changes)).collect()
        });
        let lines: Vec<Vec<u8>> = lines.into_iter().filter(|line| stays_inside(line, &files)).collect();
        let answers = served(&lines.concat());
        let ends = answers.iter().position(|a| a.ends_with(r#""ok":{}}"#)).map_or(lines.len(), |at| at + 1);
        prop_assert!(answers.len() == lines.len() || answers.len() == ends);
        for answer in answers {
            let value: serde_json::Value = serde_json::from_str(&answer).expect("JSON");
            prop_assert!(value.get("ok").is_some() != value.get("error").is_some(), "{}", answer);
        }
        check_that_nothing_panicked();
    }

    #[test]
    fn damaged_answers_are_read_or_named(
        which in any::<Index>(),
        changes in prop::collection::vec((any::<Index>(), any::<u8>()), 0..4),
    ) {
        thread_local!(static CASES: Vec<(String, String)> = corpus("answers.txt"));
        let line = CASES.with(|cases| damage(&which.get(cases).0, &changes));
        let _ = parse_answer::<Timed>(&line, 1);
        let _ = parse_answer::<Described>(&line, 1);
        let _ = parse_answer::<Memory>(&line, 1);
        check_that_nothing_panicked();
    }
}
