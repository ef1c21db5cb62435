//! Device that runs a model: the processor, used by ONNX Runtime itself or by OpenVINO, or an accelerator through one of the other
//! execution providers.
//!
//! Only execution providers in the loaded library can be requested, and then they are used or the run fails: nothing falls back to the
//! processor in silence. ONNX Runtime runs operators that an accelerator lacks on the processor.
//!
//! The device is recorded, but does not identify detections: it only changes rounding, OpenVINO in bfloat16 more than others.

use std::fmt;
use std::str::FromStr;

use ort::ep::{
    self, ArbitrarilyConfigurableExecutionProvider, ExecutionProvider, ExecutionProviderDispatch,
};
use serde::{Serialize, Serializer};

use super::onnx_runtime::{PATH_VARIABLE, Runtime};
use crate::error::{Error, Result};

/// A processor or an accelerator, e.g. `cpu` or `cuda:1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Device {
    provider: Provider,
    /// Index among several; `None` is the provider's choice, usually the first.
    number: Option<u16>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Provider {
    #[default]
    Cpu,
    Cuda,
    TensorRt,
    OpenVino,
}

impl Provider {
    const ALL: [Self; 4] = [Self::Cpu, Self::Cuda, Self::TensorRt, Self::OpenVino];

    const fn word(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Cuda => "cuda",
            Self::TensorRt => "tensorrt",
            Self::OpenVino => "openvino",
        }
    }

    /// Advice for finding a library that has it.
    const fn advice(self) -> &'static str {
        match self {
            Self::Cpu => "every build of ONNX Runtime has it",
            Self::Cuda => {
                "the Python package onnxruntime-gpu has it, and needs NVIDIA's CUDA and cuDNN libraries in the versions that it names"
            }
            Self::TensorRt => {
                "the Python package onnxruntime-gpu has it, and needs NVIDIA's CUDA, cuDNN and TensorRT libraries in the versions that it \
                 names"
            }
            Self::OpenVino => {
                "the Python package onnxruntime-openvino has it; a GPU also needs Intel's driver"
            }
        }
    }

    /// True if several devices are numbered.
    const fn is_numbered(self) -> bool {
        !matches!(self, Self::Cpu)
    }

    /// True if the loaded library has the provider.
    fn is_available(self) -> bool {
        let found = match self {
            Self::Cpu => return true,
            Self::Cuda => ep::CUDA::is_available(),
            Self::TensorRt => ep::TensorRT::is_available(),
            Self::OpenVino => ep::OpenVINO::is_available(),
        };
        found.unwrap_or(false)
    }
}

impl Device {
    /// The processor.
    pub const CPU: Self = Self {
        provider: Provider::Cpu,
        number: None,
    };

    /// Execution providers for a session besides ONNX Runtime's own, the preferred first. `threads`: for runs on the processor.
    pub(super) fn providers(
        self,
        runtime: &Runtime,
        threads: usize,
    ) -> Result<Vec<ExecutionProviderDispatch>> {
        if !self.provider.is_available() {
            let available = Provider::ALL.into_iter();
            let available = available.filter(|provider| provider.is_available());
            let available: Vec<_> = available.map(Provider::word).collect();
            return Err(Error::Runtime(format!(
                "{} cannot run a model on {self}: it has only {}; {}; name its library with --onnx-runtime or {PATH_VARIABLE}",
                runtime.library.display(),
                available.join(", "),
                self.provider.advice()
            )));
        }
        let number = self.number.map(i32::from);
        /// A provider with the device number, if given.
        macro_rules! numbered {
            ($provider:ty) => {{
                let provider = <$provider>::default();
                match number {
                    Some(number) => provider.with_device_id(number),
                    None => provider,
                }
                .build()
            }};
        }
        let providers = match self.provider {
            Provider::Cpu => vec![],
            Provider::Cuda => vec![numbered!(ep::CUDA)],
            // CUDA runs the operators that TensorRT lacks.
            Provider::TensorRt => vec![numbered!(ep::TensorRT), numbered!(ep::CUDA)],
            Provider::OpenVino => {
                let openvino = ep::OpenVINO::default();
                let openvino = match number {
                    Some(number) => openvino.with_device_type(format!("GPU.{number}")),
                    None => openvino
                        .with_device_type("CPU")
                        .with_num_threads(threads)
                        .with_arbitrary_config("load_config", openvino_on_processor()),
                };
                vec![openvino.build()]
            }
        };
        let providers = providers.into_iter();
        Ok(providers
            .map(ExecutionProviderDispatch::error_on_failure)
            .collect())
    }

    /// True if models run faster with a window size that is known before loading.
    pub(super) fn prefers_known_shapes(self) -> bool {
        self.provider == Provider::OpenVino
    }

    /// The library has the provider, but it does not start.
    pub(super) fn fails(self, runtime: &Runtime, error: &dyn fmt::Display) -> Error {
        Error::Runtime(format!(
            "{} cannot run a model on {self}: {error}; {}",
            runtime.library.display(),
            self.provider.advice()
        ))
    }
}

/// OpenVINO's properties for a run on the processor, as JSON. ONNX Runtime asks it for 32-bit floats, which takes twice the time where
/// the processor has instructions for bfloat16; and each session would pin its threads to the same first cores.
fn openvino_on_processor() -> String {
    #[cfg(target_arch = "x86_64")]
    let has_bfloat16 = std::arch::is_x86_feature_detected!("avx512bf16");
    #[cfg(not(target_arch = "x86_64"))]
    let has_bfloat16 = false;
    let precision = if has_bfloat16 { "bf16" } else { "f32" };
    serde_json::json!({ "CPU": { "INFERENCE_PRECISION_HINT": precision, "ENABLE_CPU_PINNING": "NO" } })
        .to_string()
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.provider.word())?;
        self.number.map_or(Ok(()), |number| write!(f, ":{number}"))
    }
}

impl Serialize for Device {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl FromStr for Device {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let (word, number) = match text.split_once(':') {
            Some((word, number)) => (word, Some(number)),
            None => (text, None),
        };
        let provider = Provider::ALL
            .into_iter()
            .find(|provider| provider.word() == word)
            .ok_or(
                "expected cpu, cuda, tensorrt or openvino, and :N for number N from 0 on, e.g. cuda:1",
            )?;
        let number = number.map(|found| {
            if !provider.is_numbered() {
                return Err(format!("{word} takes no number"));
            }
            found.parse().map_err(|_| {
                let most = u16::MAX;
                format!("{found:?} is not a valid device index; expected 0 to {most}")
            })
        });
        Ok(Self {
            provider,
            number: number.transpose()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_is_read_as_it_is_written() {
        for text in ["cpu", "cuda", "cuda:0", "cuda:1", "tensorrt:2", "openvino"] {
            assert_eq!(text.parse::<Device>().unwrap().to_string(), text);
        }
        assert_eq!(Device::default().to_string(), "cpu");
    }

    #[test]
    fn what_is_no_device_is_refused_with_what_is_one() {
        for (text, words) in [
            ("gpu", "expected cpu, cuda, tensorrt"),
            ("CUDA", "expected cpu, cuda, tensorrt"),
            ("", "expected cpu"),
            ("cuda:", "\"\" is not a valid device index"),
            ("cuda:-1", "\"-1\" is not a valid device index"),
            ("cuda:65536", "0 to 65535"),
            ("cpu:0", "cpu takes no number"),
        ] {
            let said = text.parse::<Device>().unwrap_err().to_string();
            assert!(said.contains(words), "{text}: {said}");
        }
    }
}
