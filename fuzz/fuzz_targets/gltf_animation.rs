#![no_main]
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = lapbench::mesh_io::parse_animation(bytes, None);
});
