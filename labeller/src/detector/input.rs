//! Model input: sizes and number of windows, checked before memory is allocated.

use std::fmt;

use dataset::work::memory;
use ort::session::Session;
use ort::value::{TensorElementType, ValueType};

use super::answer::{MAX_RUN_BYTES, numbers_of, too_large};
use super::profile::ModelProfile;
use crate::error::ModelFault;

/// Planes per window: red, green, blue.
pub(super) const CHANNELS: usize = 3;
/// Window side for models that seem to leave their size open but take one size only, px.
const USUAL_WINDOW_PX: u32 = 640;
/// Divisor of window sides for models that leave the size open, px: the coarsest stride of YOLO-like models.
const STRIDE_PX: u32 = 32;
/// A smaller window has no cell of the coarsest stride, pixels.
const MIN_WINDOW_PX: u32 = STRIDE_PX;
/// Maximum window side, px; camera images are smaller.
const MAX_WINDOW_PX: u32 = 4_096;
/// Copies of the pixels in memory: the gathered window, and at least one inside the model.
const COPIES: usize = 2;
/// Windows in one run.
const MAX_BATCH: usize = 256;

/// Sizes of windows that a model takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WindowSize {
    /// This size only.
    Fixed {
        /// Width, pixels.
        width_px: u32,
        /// Height, pixels.
        height_px: u32,
    },
    /// Any size whose sides are multiples of this.
    Any {
        /// Stride, pixels.
        multiple_px: u32,
    },
}

impl WindowSize {
    pub(crate) fn square(side_px: u32) -> Self {
        Self::Fixed {
            width_px: side_px,
            height_px: side_px,
        }
    }

    /// The usual size of windows: the fixed one, else squares of 640 pixels.
    pub(crate) fn usual_px(self) -> [u32; 2] {
        match self {
            Self::Fixed {
                width_px,
                height_px,
            } => [width_px, height_px],
            Self::Any { multiple_px } => [USUAL_WINDOW_PX.next_multiple_of(multiple_px); 2],
        }
    }
}

impl fmt::Display for WindowSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fixed {
                width_px,
                height_px,
            } => write!(f, "windows of {width_px}x{height_px} px"),
            Self::Any { multiple_px } => {
                write!(f, "windows of any multiple of {multiple_px} px")
            }
        }
    }
}

/// Model input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Input {
    pub(super) size: WindowSize,
    /// Windows per run: as many as the model takes, of which missing ones are left empty, or one if it takes any number.
    pub(super) windows: usize,
}

impl Input {
    /// Input of the loaded model. If the model leaves them open, `stride_px` (from the metadata) divides the sides.
    pub(super) fn of(
        session: &Session,
        profile: &ModelProfile,
        stride_px: Option<u32>,
    ) -> Result<Self, ModelFault> {
        let [input] = session.inputs() else {
            let names: Vec<&str> = session.inputs().iter().map(|input| input.name()).collect();
            let how = if names.contains(&"scale_factor") {
                " (PaddleDetection: `exclude_post_process=True`)"
            } else {
                ""
            };
            return Err(ModelFault::new(format!(
                "has {} inputs ({}), expected one; export it without the postprocessor that takes the size of images{how}, so that its \
                 outputs are boxes [batch, candidates, 4] and scores [batch, candidates, classes], and say layout = \"boxes-and-scores\" in \
                 its settings (docs/detectors.md)",
                names.len(),
                names.join(", ")
            )));
        };
        for output in session.outputs() {
            if let ValueType::Tensor { shape, .. } = output.dtype() {
                check_output(output.name(), shape)?;
            }
        }
        match input.dtype() {
            ValueType::Tensor {
                ty: TensorElementType::Float32,
                shape,
                ..
            } => {
                let said_px = profile.input.size_px;
                Self::of_shape(input.name(), shape, said_px, stride_px)?.in_memory()
            }
            other => Err(other_form(input.name(), other)),
        }
    }

    /// Negative lengths of the shape are open.
    fn of_shape(
        name: &str,
        shape: &[i64],
        size_of_profile_px: Option<u32>,
        stride_px: Option<u32>,
    ) -> Result<Self, ModelFault> {
        let &[fixed_batch, channels, height, width] = shape else {
            return Err(other_form(name, &format_args!("of the shape {shape:?}")));
        };
        if channels != CHANNELS as i64 {
            return Err(other_form(name, &format_args!("of the shape {shape:?}")));
        }
        let sizes = MIN_WINDOW_PX..=MAX_WINDOW_PX;
        if let Some(found) = size_of_profile_px.filter(|size| !sizes.contains(size)) {
            return Err(ModelFault::new(format!(
                "its settings say input.size_px = {found}, expected {MIN_WINDOW_PX} to {MAX_WINDOW_PX}"
            )));
        }
        let fixed = |length: i64| {
            let length_px = u32::try_from(length).ok();
            let within = length_px.filter(|length_px| sizes.contains(length_px));
            within.ok_or_else(|| {
                ModelFault::new(format!(
                    "input {name:?} takes windows of {length} px, expected {MIN_WINDOW_PX} to {MAX_WINDOW_PX}"
                ))
            })
        };
        let size = match (width < 0, height < 0, size_of_profile_px) {
            (true, true, None) => WindowSize::Any {
                multiple_px: stride_px.unwrap_or(STRIDE_PX).max(STRIDE_PX),
            },
            (true, true, Some(side_px)) => WindowSize::square(side_px),
            // A single open side is as long as the other.
            (true, false, _) => WindowSize::square(fixed(height)?),
            (false, true, _) => WindowSize::square(fixed(width)?),
            (false, false, _) => WindowSize::Fixed {
                width_px: fixed(width)?,
                height_px: fixed(height)?,
            },
        };
        if let Some(said) = size_of_profile_px
            && size != WindowSize::square(said)
        {
            return Err(ModelFault::new(format!(
                "its settings say input.size_px = {said}, but input {name:?} takes only {size}"
            )));
        }
        let most = most_windows(size.usual_px());
        let windows = match usize::try_from(fixed_batch) {
            Err(_) => 1,
            Ok(fixed) if (1..=most).contains(&fixed) => fixed,
            Ok(_) => {
                return Err(ModelFault::new(format!(
                    "input {name:?} takes {fixed_batch} {size} in a run, expected at most {most}"
                )));
            }
        };
        Ok(Self { size, windows })
    }

    /// Replaces the open size by the usual one.
    pub(super) fn of_usual_size(self) -> Self {
        let [width_px, height_px] = self.size.usual_px();
        let size = WindowSize::Fixed {
            width_px,
            height_px,
        };
        Self { size, ..self }
    }

    /// Checks that a run fits into the available memory.
    fn in_memory(self) -> Result<Self, ModelFault> {
        let Self { size, windows } = self;
        let window_bytes = (numbers_in(size.usual_px()) * size_of::<f32>() * COPIES) as u64;
        let what = format!("a run of {windows} {size}");
        memory::check(what, windows as u64 * window_bytes).map_err(ModelFault::new)?;
        Ok(self)
    }
}

/// The input has a different type or number of dimensions.
fn other_form(name: &str, found: &dyn fmt::Display) -> ModelFault {
    ModelFault::new(format!(
        "input {name:?} is {found}, expected floats of the shape [batch, 3, height, width]"
    ))
}

pub(super) fn numbers_in([width_px, height_px]: [u32; 2]) -> usize {
    CHANNELS * width_px as usize * height_px as usize
}

/// Number of windows that fit into a run's memory.
fn most_windows(size_px: [u32; 2]) -> usize {
    (MAX_RUN_BYTES / (numbers_in(size_px) * size_of::<f32>())).min(MAX_BATCH)
}

/// Rejects an output that would not fit into memory, as far as the model declares its size.
fn check_output(name: &str, shape: &[i64]) -> Result<(), ModelFault> {
    let said: Vec<usize> = shape
        .iter()
        .filter_map(|&length| usize::try_from(length).ok())
        .collect();
    match numbers_of(&said) {
        Some(_) => Ok(()),
        None => Err(ModelFault::new(format!(
            "output {name:?} {}",
            too_large(&shape)
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(shape: &[i64], size_of_profile_px: Option<u32>) -> Result<Input, ModelFault> {
        Input::of_shape("pictures", shape, size_of_profile_px, None)
    }

    #[test]
    fn open_lengths_are_chosen_and_fixed_ones_are_kept() {
        let any = Input {
            size: WindowSize::Any { multiple_px: 32 },
            windows: 1,
        };
        assert_eq!(of(&[-1, 3, -1, -1], None), Ok(any));
        assert_eq!(any.of_usual_size().size, WindowSize::square(640));
        let small = Input {
            size: WindowSize::square(416),
            windows: 4,
        };
        assert_eq!(of(&[4, 3, -1, -1], Some(416)), Ok(small));
        assert_eq!(of(&[4, 3, 416, -1], None), Ok(small));
        assert_eq!(of(&[4, 3, 416, 416], None), Ok(small));
        let wide = WindowSize::Fixed {
            width_px: 640,
            height_px: 384,
        };
        assert_eq!(of(&[1, 3, 384, 640], None).unwrap().size, wide);
        assert_eq!(most_windows([MAX_WINDOW_PX; 2]), 5);
    }

    #[test]
    fn windows_and_batches_that_cannot_be_are_refused_before_memory_is_taken() {
        let cases: [(&[i64], Option<u32>, &str); 13] = [
            (&[1, 3, 0, 0], None, "windows of 0 px, expected 32 to 4096"),
            (&[1, 3, 20_000, 20_000], None, "windows of 20000 px"),
            (&[1, 3, 1 << 33, 1 << 33], None, "windows of 8589934592 px"),
            (&[-1, 3, -1, -1], Some(0), "input.size_px = 0"),
            (&[-1, 3, -1, -1], Some(20_000), "input.size_px = 20000"),
            (
                &[1_000_000_000, 3, 640, 640],
                None,
                "takes 1000000000 windows of 640x640 px in a run, expected at most 218",
            ),
            (&[0, 3, 640, 640], None, "takes 0 windows"),
            (&[1, 3, 640, 20], None, "windows of 20 px"),
            (
                &[1, 3, 640, 640],
                Some(416),
                "input.size_px = 416, but input \"pictures\" takes only windows of 640x640 px",
            ),
            (
                &[1, 3, 384, 640],
                Some(640),
                "takes only windows of 640x384 px",
            ),
            (
                &[1, 3, -1, 640],
                Some(320),
                "takes only windows of 640x640 px",
            ),
            (&[1, 1, 640, 640], None, "[1, 1, 640, 640]"),
            (&[], None, "[batch, 3, height, width]"),
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
