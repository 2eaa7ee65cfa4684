//! Changed, cut and spliced files of the corpus, and arbitrary bytes: readers answer or refuse, nothing else.

use proptest::prelude::*;
use proptest::sample::Index;

use crate::readers::{READERS, Reader};
use crate::{check_that_nothing_panicked, corpus};

/// Words that have broken readers before: they replace whatever word stands at a place of a text.
const NUMBERS: [&str; 10] =
    ["4294967295", "-1", "0", "1e999", "nan", "-0.0", "18446744073709551615", "2147483648", "1e-400", ""];

/// One change to a file.
#[derive(Clone, Debug)]
enum Change {
    Cut(Index),
    Flip(Index, u8),
    Overwrite(Index, Vec<u8>),
    Insert(Index, Vec<u8>),
    Repeat(Index, Index),
    Remove(Index, Index),
    Number(Index, usize),
}

impl Change {
    fn apply(&self, bytes: &mut Vec<u8>) {
        if bytes.is_empty() {
            return;
        }
        let span = |a: &Index, b: &Index, length: usize| {
            let (a, b) = (a.index(length), b.index(length));
            a.min(b)..a.max(b)
        };
        match self {
            Change::Cut(at) => bytes.truncate(at.index(bytes.len())),
            Change::Flip(at, bit) => {
                let at = at.index(bytes.len());
                bytes[at] ^= 1 << (bit % 8);
            }
            Change::Overwrite(at, new) => {
                let at = at.index(bytes.len());
                let end = bytes.len().min(at + new.len());
                bytes[at..end].copy_from_slice(&new[..end - at]);
            }
            Change::Insert(at, new) => {
                let at = at.index(bytes.len());
                bytes.splice(at..at, new.iter().copied());
            }
            Change::Repeat(a, b) => {
                let span = span(a, b, bytes.len());
                let piece = bytes[span.clone()].to_vec();
                bytes.splice(span.end..span.end, piece);
            }
            Change::Remove(a, b) => drop(bytes.drain(span(a, b, bytes.len()))),
            Change::Number(at, which) => {
                let at = at.index(bytes.len());
                let start = bytes[..at].iter().rposition(|b| !b.is_ascii_alphanumeric()).map_or(0, |i| i + 1);
                let end = bytes[at..]
                    .iter()
                    .position(|b| !b.is_ascii_alphanumeric())
                    .map_or(bytes.len(), |i| at + i);
                bytes.splice(start..end, NUMBERS[which % NUMBERS.len()].bytes());
            }
        }
    }
}

fn change() -> impl Strategy<Value = Change> {
    let index = any::<Index>;
    let few_bytes = || prop::collection::vec(any::<u8>(), 1..9);
    prop_oneof![
        1 => index().prop_map(Change::Cut),
        4 => (index(), any::<u8>()).prop_map(|(at, bit)| Change::Flip(at, bit)),
        2 => (index(), few_bytes()).prop_map(|(at, new)| Change::Overwrite(at, new)),
        1 => (index(), few_bytes()).prop_map(|(at, new)| Change::Insert(at, new)),
        1 => (index(), index()).prop_map(|(a, b)| Change::Repeat(a, b)),
        1 => (index(), index()).prop_map(|(a, b)| Change::Remove(a, b)),
        3 => (index(), any::<usize>()).prop_map(|(at, which)| Change::Number(at, which)),
    ]
}

fn refused_or_read(reader: &Reader, bytes: &[u8]) {
    check_that_nothing_panicked();
    if let Err(fault) = (reader.parse)(bytes) {
        assert!(!fault.problem.is_empty() && !fault.remedy.is_empty(), "{fault}");
    }
    check_that_nothing_panicked();
}

/// Files of at most 4 KB: a mutation of a larger one seldom hits what matters.
fn seeds(reader: &Reader) -> Vec<Vec<u8>> {
    let files = std::fs::read_dir(corpus::folder().join(reader.folder)).unwrap();
    let mut paths: Vec<_> = files.map(|file| file.unwrap().path()).collect();
    paths.sort();
    let bytes = paths.iter().map(|path| std::fs::read(path).unwrap());
    bytes.filter(|bytes| bytes.len() <= 4096).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn changed_files(which in any::<Index>(), seed in any::<Index>(), changes in prop::collection::vec(change(), 1..6)) {
        thread_local!(static SEEDS: Vec<Vec<Vec<u8>>> = READERS.iter().map(seeds).collect());
        let reader = which.index(READERS.len());
        let mut bytes = SEEDS.with(|seeds| seed.get(&seeds[reader]).clone());
        changes.iter().for_each(|change| change.apply(&mut bytes));
        refused_or_read(&READERS[reader], &bytes);
    }

    #[test]
    fn arbitrary_bytes(which in any::<Index>(), bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        refused_or_read(which.get(&READERS), &bytes);
    }

    #[test]
    fn arbitrary_words(which in any::<Index>(), words in prop::collection::vec("[-+.0-9a-zA-Z%#/\\\\]{1,6}[ \n\t,]", 0..60)) {
        refused_or_read(which.get(&READERS), words.concat().as_bytes());
    }
}
