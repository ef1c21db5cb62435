//! The input of a model: size and number of its windows, checked before memory is allocated for them.

use dataset::memory::{self, TooMuchMemory};
use ort::session::Session;
use ort::value::{TensorElementType, ValueType};

use super::answer::{MOST_RUN_BYTES, numbers_of};
use super::profile::ModelProfile;

/// Planes of a window: red, green, blue.
pub(super) const CHANNELS: usize = 3;
/// Window size of a model that leaves it open, pixels.
const USUAL_WINDOW_PX: u32 = 640;
/// The coarsest cells of YOLO-like models have this size, pixels: a smaller window has none.
const LEAST_WINDOW_PX: u32 = 32;
/// Larger than the sides of any camera's pictures, pixels.
const MOST_WINDOW_PX: u32 = 4_096;
/// Copies of a window's pixels in memory: where they are gathered, and at least one inside the model.
const COPIES: usize = 2;
/// Windows in one run.
const MOST_BATCH: usize = 256;

/// Windows per run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Batch {
    /// The model takes exactly this many; missing ones are left empty.
    Exactly(usize),
    /// The model takes any number.
    UpTo(usize),
}

/// The input of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Input {
    pub(super) window_px: u32,
    pub(super) batch: Batch,
}

/// Why a model's input or output cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum InputFault {
    #[error("has {found} inputs, expected one")]
    Inputs { found: usize },
    #[error("has {found} outputs, expected one; export it with its grid")]
    Outputs { found: usize },
    #[error("input {name:?} is {found}, expected floats of the shape [batch, 3, size, size]")]
    Form { name: String, found: String },
    #[error(
        "input {name:?} takes windows of {found} px, expected {LEAST_WINDOW_PX} to {MOST_WINDOW_PX}"
    )]
    WindowSize { name: String, found: i64 },
    #[error(
        "its profile says input.size_px = {found}, expected {LEAST_WINDOW_PX} to {MOST_WINDOW_PX}"
    )]
    ProfileSize { found: u32 },
    #[error(
        "input {name:?} takes {batch} windows of {window_px} px in a run, expected at most {most}"
    )]
    BatchSize {
        name: String,
        batch: i64,
        window_px: u32,
        most: usize,
    },
    #[error(
        "output {name:?} has the shape {shape:?}, more than {MOST_RUN_BYTES} bytes; expected a few thousand candidates a window"
    )]
    Output { name: String, shape: Vec<i64> },
    #[error(transparent)]
    Memory(#[from] TooMuchMemory),
}

impl Input {
    /// Of a loaded model, with at most `batch` windows per run if it leaves that open.
    pub(super) fn of(
        session: &Session,
        profile: &ModelProfile,
        batch: usize,
    ) -> Result<Self, InputFault> {
        let [input] = session.inputs() else {
            let found = session.inputs().len();
            return Err(InputFault::Inputs { found });
        };
        let [output] = session.outputs() else {
            let found = session.outputs().len();
            return Err(InputFault::Outputs { found });
        };
        if let ValueType::Tensor { shape, .. } = output.dtype() {
            check_output(output.name(), shape)?;
        }
        match input.dtype() {
            ValueType::Tensor {
                ty: TensorElementType::Float32,
                shape,
                ..
            } => Self::of_shape(input.name(), shape, profile.input.size_px, batch)?.in_memory(),
            other => Err(InputFault::Form {
                name: input.name().to_owned(),
                found: format!("{other:?}"),
            }),
        }
    }

    /// From the shape of a model's input, in which a negative length is open.
    fn of_shape(
        name: &str,
        shape: &[i64],
        size_of_profile_px: Option<u32>,
        batch: usize,
    ) -> Result<Self, InputFault> {
        let name = || name.to_owned();
        let &[fixed_batch, channels, height, width] = shape else {
            let found = format!("of the shape {shape:?}");
            return Err(InputFault::Form {
                name: name(),
                found,
            });
        };
        if channels != CHANNELS as i64 || height != width {
            let found = format!("of the shape {shape:?}");
            return Err(InputFault::Form {
                name: name(),
                found,
            });
        }
        let sizes = LEAST_WINDOW_PX..=MOST_WINDOW_PX;
        if let Some(found) = size_of_profile_px.filter(|size| !sizes.contains(size)) {
            return Err(InputFault::ProfileSize { found });
        }
        let window_px = if width < 0 {
            size_of_profile_px.unwrap_or(USUAL_WINDOW_PX)
        } else {
            u32::try_from(width)
                .ok()
                .filter(|size| sizes.contains(size))
                .ok_or_else(|| InputFault::WindowSize {
                    name: name(),
                    found: width,
                })?
        };
        let most = most_windows(window_px);
        let batch = match usize::try_from(fixed_batch) {
            Err(_) => Batch::UpTo(batch.clamp(1, most)),
            Ok(fixed) if (1..=most).contains(&fixed) => Batch::Exactly(fixed),
            Ok(_) => {
                return Err(InputFault::BatchSize {
                    name: name(),
                    batch: fixed_batch,
                    window_px,
                    most,
                });
            }
        };
        Ok(Self { window_px, batch })
    }

    /// With as many windows per run as fit into memory, if that is open.
    fn in_memory(self) -> Result<Self, InputFault> {
        let Self { window_px, batch } = self;
        let window_bytes = (self.plane_numbers() * size_of::<f32>() * COPIES) as u64;
        let (windows, batch) = match batch {
            Batch::Exactly(windows) => (windows, batch),
            Batch::UpTo(windows) => {
                let fitting = memory::available().bytes / window_bytes;
                let windows = windows
                    .min(usize::try_from(fitting).unwrap_or(usize::MAX))
                    .max(1);
                (windows, Batch::UpTo(windows))
            }
        };
        let what = format!("a run of {windows} windows of {window_px} px");
        memory::check(what, windows as u64 * window_bytes)?;
        Ok(Self { window_px, batch })
    }

    /// Elements of one window.
    pub(super) fn plane_numbers(&self) -> usize {
        plane_numbers(self.window_px)
    }
}

fn plane_numbers(window_px: u32) -> usize {
    CHANNELS * (window_px as usize).pow(2)
}

/// How many windows fit into the memory of one run.
fn most_windows(window_px: u32) -> usize {
    (MOST_RUN_BYTES / (plane_numbers(window_px) * size_of::<f32>())).min(MOST_BATCH)
}

/// Rejects an output that would not fit into memory, as far as the model declares its size.
fn check_output(name: &str, shape: &[i64]) -> Result<(), InputFault> {
    let said: Vec<usize> = shape
        .iter()
        .filter_map(|&length| usize::try_from(length).ok())
        .collect();
    match numbers_of(&said) {
        Some(_) => Ok(()),
        None => Err(InputFault::Output {
            name: name.to_owned(),
            shape: shape.to_vec(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(shape: &[i64], size_of_profile_px: Option<u32>) -> Result<Input, InputFault> {
        Input::of_shape("pictures", shape, size_of_profile_px, 6)
    }

    #[test]
    fn open_lengths_are_chosen_and_fixed_ones_are_kept() {
        let any = Input {
            window_px: 640,
            batch: Batch::UpTo(6),
        };
        assert_eq!(of(&[-1, 3, -1, -1], None), Ok(any));
        let small = Input {
            window_px: 416,
            batch: Batch::Exactly(4),
        };
        assert_eq!(of(&[4, 3, -1, -1], Some(416)), Ok(small));
        assert_eq!(of(&[4, 3, 416, 416], None), Ok(small));
        assert_eq!(most_windows(MOST_WINDOW_PX), 5);
    }

    #[test]
    fn windows_and_batches_that_cannot_be_are_refused_before_memory_is_taken() {
        let cases: [(&[i64], Option<u32>, &str); 10] = [
            (&[1, 3, 0, 0], None, "windows of 0 px, expected 32 to 4096"),
            (&[1, 3, 20_000, 20_000], None, "windows of 20000 px"),
            (&[1, 3, 1 << 33, 1 << 33], None, "windows of 8589934592 px"),
            (&[-1, 3, -1, -1], Some(0), "input.size_px = 0"),
            (&[-1, 3, -1, -1], Some(20_000), "input.size_px = 20000"),
            (
                &[1_000_000_000, 3, 640, 640],
                None,
                "takes 1000000000 windows of 640 px in a run, expected at most 218",
            ),
            (&[0, 3, 640, 640], None, "takes 0 windows"),
            (&[1, 3, 640, 416], None, "[1, 3, 640, 416]"),
            (&[1, 1, 640, 640], None, "[1, 1, 640, 640]"),
            (&[], None, "[batch, 3, size, size]"),
        ];
        for (shape, size_of_profile_px, expected) in cases {
            let said = of(shape, size_of_profile_px).unwrap_err().to_string();
            assert!(said.contains(expected), "{expected} in {said}");
        }
        let said = check_output("boxes", &[1, 1 << 40, 6])
            .unwrap_err()
            .to_string();
        assert!(said.contains("\"boxes\""), "{said}");
        assert_eq!(check_output("boxes", &[-1, -1, 6]), Ok(()));
    }
}
