//! Compute backend for training networks: the CPU, or a GPU if this build supports it.
//!
//! Networks are stored, saved and evaluated on the CPU, wherever they were trained. There is no silent fallback to the CPU.

#[cfg(feature = "wgpu")]
use std::sync::Mutex;

use burn::tensor::Device;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// A processor or a GPU.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum TrainingBackend {
    /// The processor.
    #[default]
    Cpu,
    /// A GPU by Vulkan, Metal or DirectX 12. Needs the cargo feature `wgpu`.
    Wgpu,
    /// An NVIDIA GPU by CUDA. The cargo feature `cuda` has it.
    Cuda,
}

impl TrainingBackend {
    /// Name in settings.
    const fn word(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Wgpu => "wgpu",
            Self::Cuda => "cuda",
        }
    }

    /// The device, ready for tensors, without autodiff.
    pub(crate) fn open(self) -> Result<Device> {
        match self {
            Self::Cpu => Ok(Device::flex()),
            #[cfg(feature = "wgpu")]
            Self::Wgpu => wgpu(),
            #[cfg(feature = "cuda")]
            Self::Cuda => Ok(Device::cuda(burn::tensor::DeviceIndex::Default)),
            #[cfg(not(all(feature = "wgpu", feature = "cuda")))]
            other => Err(other.invalid(format!(
                "cpu: this dtd was built without {word}; build it with `cargo build --release --features {word}`",
                word = other.word()
            ))),
        }
    }

    fn invalid(self, expected: String) -> Error {
        Error::setting("backend", format_args!("{:?}", self.word()), expected)
    }
}

/// The device of this process: it can be opened once.
#[cfg(feature = "wgpu")]
fn wgpu() -> Result<Device> {
    static OPEN: Mutex<Option<Device>> = Mutex::new(None);
    let mut open = OPEN
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner);
    if let Some(device) = &*open {
        return Ok(device.clone());
    }
    let device = Device::wgpu_options().init().map_err(|error| {
        TrainingBackend::Wgpu.invalid(format!(
            "cpu, or a GPU with a driver for Vulkan, Metal or DirectX 12: {error}"
        ))
    })?;
    *open = Some(device.clone());
    Ok(device)
}

#[cfg(test)]
mod tests {
    #[cfg(not(feature = "wgpu"))]
    #[test]
    fn a_backend_that_this_build_lacks_is_refused_with_the_way_to_get_it() {
        let error = super::TrainingBackend::Wgpu.open().unwrap_err().to_string();
        assert_eq!(
            error,
            "configuration: backend is \"wgpu\", expected cpu: this dtd was built without wgpu; build it with \
             `cargo build --release --features wgpu`"
        );
    }
}
