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

#[test]
fn an_unknown_device_is_unavailable_and_names_the_others() {
    let Some(first) = device(&Settings::default()) else { return };
    let name = first.describe(1).device;
    for (choice, found) in [("0", true), (&name[..4], true), ("no such device", false), ("17", false)] {
        match Device::open(Some(choice), &Settings::default()) {
            Ok(_) => assert!(found, "{choice}"),
            Err(reason) => assert!(!found && reason.how_to_get_it.contains(&name), "{choice}: {reason}"),
        }
    }
}

#[test]
fn memory_beyond_the_budget_is_an_error_and_leaves_nothing_behind() {
    let Some(device) = device(&Settings { budget: Some(1 << 20), ..Settings::default() }) else { return };
    let kept = Buffer::new(&device, Place::Device, 1 << 19).unwrap();
    match Buffer::new(&device, Place::Device, 1 << 20) {
        Err(DeviceError::OutOfMemory { bytes }) => assert!(bytes >= 1 << 20),
        other => panic!("{:?}", other.map(|buffer| buffer.bytes())),
    }
    device.faults.fail_allocations_after(0);
    assert!(Buffer::new(&device, Place::Upload, 16).is_err());
    device.faults.fail_allocations_after(-1);
    drop(kept);
    assert_eq!(device.used(), 0);
}

#[test]
fn a_lost_device_and_a_timeout_stay_errors() {
    let Some(device) = device(&Settings::default()) else { return };
    let buffer = Buffer::new(&device, Place::Device, 1024).unwrap();
    let record = || {
        let mut plan = Plan::new(&device);
        plan.clear(&buffer);
        plan.record().unwrap()
    };
    let (mut lost, mut late, mut well) = (record(), record(), record());
    device.faults.lose_device_after(1);
    assert_eq!(lost.run(), Ok(()));
    let error = lost.run().unwrap_err();
    assert!(matches!(&error, DeviceError::Lost(what) if what.contains("vkQueueSubmit")), "{error:?}");
    device.faults.lose_device_after(-1);
    assert_eq!(lost.run(), Err(error), "nothing more is submitted");
    device.faults.time_out_after(0);
    let error = late.run().unwrap_err();
    assert!(matches!(&error, DeviceError::Lost(what) if what.contains("vkWaitForFences")), "{error:?}");
    device.faults.time_out_after(-1);
    drop((lost, late));
    assert_eq!(well.run(), Ok(()), "other recordings are not touched");
}

/// Runs this test binary again on the ignored test `backends::vulkan::NAME` with another environment.
pub fn again(name: &str, variables: &[(&str, &str)]) -> String {
    let mut command = std::process::Command::new(std::env::current_exe().unwrap());
    command.args(["--ignored", "--exact", "--nocapture", &format!("backends::vulkan::{name}")]);
    let output = command.envs(variables.iter().copied()).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    text
}

#[test]
fn a_machine_without_drivers_says_what_to_install() {
    if device(&Settings::default()).is_none() {
        return;
    }
    let nowhere = [("VK_DRIVER_FILES", "/nonexistent.json"), ("VK_ICD_FILENAMES", "/nonexistent.json")];
    let text = again("tests::says_why_there_is_no_device", &nowhere);
    assert!(text.contains("no Vulkan driver") && text.contains("mesa-vulkan-drivers"), "{text}");
}

#[test]
#[ignore = "run by another test, in an environment without drivers"]
fn says_why_there_is_no_device() {
    match Device::open(None, &Settings::default()) {
        Ok(device) => panic!("found {}", device.describe(1).device),
        Err(reason) => println!("{reason}"),
    }
}

#[test]
fn a_machine_without_a_loader_says_what_to_install() {
    let settings = Settings { loader: Some("libno-such-vulkan.so.1"), ..Settings::default() };
    let Err(reason) = Device::open(None, &settings) else { panic!("loaded") };
    assert!(reason.what.contains("loader cannot be loaded"), "{reason}");
    assert!(reason.how_to_get_it.contains("libvulkan1"), "{reason}");
}
