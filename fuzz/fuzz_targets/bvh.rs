#![no_main]
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = lapbench::animation::bvh::parse(bytes);
});
