//! What a device call can come back with, and what callers of the library are told.
use crate::error::{PrepareError, SolveError};
use ash::vk;

/// Why a device call failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DeviceError {
    /// The driver or our own budget has no room for so many bytes.
    OutOfMemory {
        /// Bytes asked for.
        bytes: u64,
    },
    /// The device was lost, or the driver failed otherwise: its words.
    Lost(String),
    /// The device cannot do this: a limit or a missing feature.
    Unsupported(String),
}

impl DeviceError {
    /// A failed driver call named `call`.
    pub fn of(call: &'static str, result: vk::Result) -> Self {
        match result {
            vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
                Self::OutOfMemory { bytes: 0 }
            }
            other => Self::Lost(format!("{call}: {other}")),
        }
    }
}

/// `result.map_err(calling("vkQueueSubmit"))`.
pub fn calling(call: &'static str) -> impl Fn(vk::Result) -> DeviceError {
    move |result| DeviceError::of(call, result)
}

impl From<DeviceError> for PrepareError {
    fn from(error: DeviceError) -> Self {
        match error {
            DeviceError::OutOfMemory { bytes } => Self::OutOfMemory { bytes },
            DeviceError::Lost(what) => Self::DeviceLost { what },
            DeviceError::Unsupported(what) => Self::Unsupported { what },
        }
    }
}

impl From<DeviceError> for SolveError {
    fn from(error: DeviceError) -> Self {
        let what = match error {
            DeviceError::OutOfMemory { .. } => "the driver is out of memory".into(),
            DeviceError::Lost(what) | DeviceError::Unsupported(what) => what,
        };
        Self::DeviceLost { what }
    }
}
