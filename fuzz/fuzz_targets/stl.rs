#![no_main]
use lapbench::mesh_io::{Format, parse_mesh};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Ok((mesh, _)) = parse_mesh(bytes, Some(Format::Stl), None) {
        lapsolve::topology::Topology::of(&mesh);
    }
});
