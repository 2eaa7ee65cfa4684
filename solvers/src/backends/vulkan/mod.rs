//! Solvers on Vulkan devices: real GPUs, and lavapipe on the CPU.
//!
//! ```text
//! Device (loader, choice, queue, budget) -> Buffer, Kernel -> Plan (steps) -> Recorded -> run, frame after frame
//! ```
//! | file | what |
//! |---|---|
//! | `instance.rs`, `device.rs` | the loader at run time, the list of devices, the opened device |
//! | `buffer.rs` | device memory; [`Input`] and [`Output`]: the host's side of a frame |
//! | `kernel.rs`, `shaders.rs` | pipelines from committed SPIR-V |
//! | `plan.rs`, `recorded.rs` | what a frame does; its command buffer, recorded once, run in every frame |
//! | `cg/` | conjugate gradients |
//! | `error.rs`, `messages.rs`, `faults.rs` | failures: what they mean, the validation layer's, and injected ones |
//!
//! Every Vulkan object is owned by one Rust value that releases it, and everything holds the [`Device`] it lives on, so
//! an early return leaks nothing. A frame is: write the inputs, [`Recorded::run`], read the outputs; it allocates nothing
//! and takes one lock, the queue's.
#[macro_use]
mod shaders;
mod buffer;
pub mod cg;
mod device;
pub mod direct;
mod error;
mod faults;
mod instance;
mod kernel;
mod messages;
mod plan;
mod recorded;
#[cfg(test)]
mod tests;

pub use buffer::{Buffer, Input, Output, Place, Plain, Slot, Upload, constant, read};
pub use device::{ALIGNMENT, Access, Device, Settings, Traits};
pub use error::DeviceError;
pub use instance::{Candidate, Instance};
pub use kernel::Kernel;
pub use plan::Plan;
pub use recorded::Recorded;
pub use shaders::{Binding, Shader};
