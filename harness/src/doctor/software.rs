//! Backends, peers and references: what is there, and what to do about the rest.

use super::finding::Finding;
use crate::peers;
use lapsolve::registry::{Entry, OpenOptions};
use std::collections::BTreeMap;

/// One finding for each backend.
pub fn backends(backends: &[Entry]) -> Vec<Finding> {
    let look = |entry: &Entry| {
        let subject = format!("backend {}", entry.id);
        match (entry.open)(&OpenOptions::default()) {
            Ok(backend) => {
                Finding::new(&subject, Some(true), format!("available on {}", backend.describe().device), "")
            }
            Err(why) => {
                Finding::new(&subject, Some(false), format!("unavailable: {}", why.what), &why.how_to_get_it)
            }
        }
    };
    backends.iter().map(look).collect()
}

/// The peers that are installed, and one finding for each reason why others are not.
pub fn peers() -> Vec<Finding> {
    let mut installed = Vec::new();
    let mut missing: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for peer in peers::catalogue() {
        match peer.command() {
            Ok(_) => installed.push(peer.id.clone()),
            Err(reason) => missing.entry(reason).or_default().push(peer.id.clone()),
        }
    }
    let found = if installed.is_empty() { "none".to_owned() } else { installed.join(", ") };
    let mut findings = vec![Finding::info("peers installed", found)];
    findings.extend(
        missing
            .into_iter()
            .map(|(reason, ids)| Finding::new("peers missing", Some(false), ids.join(", "), &reason)),
    );
    findings
}

/// Where children and parent exchange arrays.
pub fn temporary_place() -> Finding {
    let place = std::env::temp_dir();
    let works = tempfile::tempfile_in(&place).is_ok();
    let found = format!("{} is {}", place.display(), if works { "writable" } else { "not writable" });
    Finding::new("temporary files", Some(works), found, "set TMPDIR to a writable folder")
}
