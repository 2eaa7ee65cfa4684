#![no_main]
use lapbench::engine::child;
use lapbench::engine::protocol::{Described, Memory, Prepared, Timed, parse_answer};
use lapsolve::registry;

// A served backend answers whatever lines it gets, and the harness reads whatever lines a peer answers. Requests that
// write files are left out: their paths are for the harness to choose.
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = parse_answer::<Described>(bytes, 1);
    let _ = parse_answer::<Prepared>(bytes, 1);
    let _ = parse_answer::<Timed>(bytes, 1);
    let _ = parse_answer::<Memory>(bytes, 1);
    if !String::from_utf8_lossy(bytes).contains("solution") {
        let entry = registry::find("dense").expect("always there");
        let _ = child::serve(entry, bytes, &mut std::io::sink());
    }
});
