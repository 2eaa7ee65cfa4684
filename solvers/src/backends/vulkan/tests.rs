//! Tests on whatever device there is, with the validation layer on: any message of it fails (see [`Device`]'s drop).
use super::*;
use std::sync::Arc;

const AXPY_F32: Shader = shader!("axpy", "f32", &[Binding::Reals, Binding::Storage], 2);
const AXPY_F64: Shader = shader!("axpy", "f64", &[Binding::Words, Binding::Storage], 2);

/// A device for a test; `None` after a skip was announced.
pub fn device(settings: &Settings) -> Option<Arc<Device>> {
    match Device::open(None, settings) {
        Ok(device) => Some(device),
        Err(reason) => {
            skip(&reason.to_string());
            None
        }
    }
}

/// Says that a test does not run; a failure where Vulkan is required.
pub fn skip(reason: &str) {
    let required = std::env::var("LAPBENCH_REQUIRE").unwrap_or_default();
    let required = required.split(',').any(|word| ["all", "1", "vulkan"].contains(&word.trim()));
    assert!(!required, "LAPBENCH_REQUIRE forbids to skip the Vulkan tests: {reason}");
    println!("SKIPPED {}: {reason}", std::thread::current().name().unwrap_or("test"));
}

/// Every way of reading, with and without staging.
fn all_settings() -> impl Iterator<Item = Settings> {
    [Access::Texel, Access::Storage].into_iter().flat_map(|access| {
        [false, true].map(|force_staging| Settings {
            access: Some(access),
            force_staging,
            ..Settings::default()
        })
    })
}

/// y + a x in f32 (or f64) on the device, run twice.
fn axpy<T: Plain + Default>(device: &Arc<Device>, shader: &Shader, a: f32, x: &[T], y: &[T]) -> Vec<T> {
    let kernel = Kernel::new(device, shader, &[64]).unwrap();
    let (mut input, mut output) =
        (Input::<T>::new(device, x.len()).unwrap(), Output::<T>::new(device, x.len()).unwrap());
    let rows = (x.len() / 4) as u32;
    let start = constant(device, y).unwrap();
    let mut plan = Plan::new(device);
    plan.mark();
    input.upload(&mut plan);
    plan.copy(&start, output.buffer());
    plan.barrier();
    let slots = [input.buffer().all(), output.buffer().all()];
    plan.dispatch(&kernel, &slots, &[rows, a.to_bits()], rows.div_ceil(64));
    plan.barrier();
    output.download(&mut plan);
    plan.mark();
    let mut recorded = plan.record().unwrap();
    for _ in 0..2 {
        input.host()[..x.len()].copy_from_slice(x);
        recorded.run().unwrap();
    }
    assert!(device.traits().tick_ns.is_none() || recorded.device_ns().unwrap() > 0);
    output.host()[..x.len()].to_vec()
}

#[test]
fn a_kernel_computes_in_both_numbers_with_every_way_of_reading() {
    for settings in all_settings() {
        let Some(device) = device(&settings) else { return };
        for rows in [1, 63, 64, 1001] {
            let x: Vec<f32> = (0..4 * rows).map(|i| i as f32).collect();
            let y: Vec<f32> = (0..4 * rows).map(|i| (i % 7) as f32).collect();
            let expected: Vec<f32> = x.iter().zip(&y).map(|(x, y)| y + 0.5 * x).collect();
            assert_eq!(axpy(&device, &AXPY_F32, 0.5, &x, &y), expected, "{settings:?}");
            if device.traits().f64 {
                let wide = |v: &[f32]| v.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();
                assert_eq!(axpy(&device, &AXPY_F64, 0.5, &wide(&x), &wide(&y)), wide(&expected));
            }
        }
        assert_eq!(device.used(), 0, "everything is released");
    }
}
