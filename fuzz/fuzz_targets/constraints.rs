#![no_main]
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = lapbench::mesh_io::table::parse_constraints(bytes, 8);
});
