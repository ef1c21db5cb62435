//! `health/<model>.parquet`: the condition of each camera at each tick, from its images alone.
//!
//! Input: the measurements of `dtd detect` for each image. Output: a typed row for each image, with the camera's direction relative to the
//! flight's usual one where it could be measured. The table belongs to the detections of the same model: their record names it
//! ([`crate::corpus::detections`]), and it is replaced with them.

use std::collections::BTreeMap;

use glam::DVec2;
use schemars::JsonSchema;

use crate::error::Result;
use crate::geometry::camera::Camera;
use crate::numbers::limits;
use crate::tables::columns::{Table, TableWriter};
use crate::tables::image_rows::ImageRow;
use crate::tables::row_parts::{Numbers, numbers, words};

/// A view at one tick.
#[derive(Debug, Clone, PartialEq, JsonSchema)]
pub struct ViewHealth {
    /// Number of the tick.
    pub tick: u32,
    /// Identifier of the view.
    pub view: String,
    /// Condition of the camera.
    pub state: HealthState,
    /// Its direction relative to the flight's usual one. In the table, numbers are null where it was not measured.
    pub motion: Option<CameraTurn>,
    /// Condition of the camera by the images up to this tick.
    pub state_live: HealthState,
    /// Lag of the view in the whole flight. In the table, numbers are null of the first view, and where it was not measured.
    pub lag: Option<ViewLag>,
}

impl ViewHealth {
    /// True if the direction of the camera could not be measured in this image. An image that repeats an earlier one does not count.
    pub fn hides_direction(&self) -> bool {
        let is_known = matches!(self.state, HealthState::Steady | HealthState::Frozen);
        self.motion.is_none() && !is_known
    }
}

/// Lag of a view's images behind the first view's.
#[derive(Debug, Clone, Copy, PartialEq, JsonSchema)]
pub struct ViewLag {
    /// Time by which the view shows an earlier aircraft than the first one in images of the same tick, milliseconds; negative if it is the
    /// first view that does.
    pub lag_ms: f64,
    /// Its standard deviation, milliseconds.
    pub lag_sd_ms: f64,
}

impl ViewLag {
    /// True if the lag is certain and matters.
    pub fn is_sure(&self) -> bool {
        self.lag_ms.abs() >= MIN_LAG_MS.max(SURE_SD * self.lag_sd_ms)
    }
}

/// Lower limit of the lag's standard deviation, milliseconds. More sightings do not reduce it: views from two sides see different parts of
/// near aircraft, and wrong directions of cameras resemble a lag. Of 275 clean flights whose sightings left less, lags were 8 ms (root mean
/// square).
pub const MIN_LAG_SD_MS: f64 = 10.0;
/// A lag below this does not matter, milliseconds: 0.04 % of the distance at ten kilometres, with masts 600 m apart.
const MIN_LAG_MS: f64 = 100.0;
/// Minimum significance of a lag, in standard deviations: twice what none of 385 flights without a lag reached.
const SURE_SD: f64 = 5.0;

/// Lateness of images.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Late {
    /// Seconds.
    pub seconds: f64,
    /// Standard deviation, seconds.
    pub sd_s: f64,
}

/// A flight's views whose images are late, by the lags that are sure. An image shows the past, never the future: of two views that
/// disagree, the one that shows the earlier aircraft is late.
pub fn late_views(rows: &[ViewHealth]) -> BTreeMap<&str, Late> {
    let mut late: BTreeMap<&str, Late> = BTreeMap::new();
    for row in rows {
        let lag = row.lag.filter(ViewLag::is_sure);
        let of_view = lag.map(|lag| Late {
            seconds: lag.lag_ms / 1e3,
            sd_s: lag.lag_sd_ms / 1e3,
        });
        late.insert(&row.view, of_view.unwrap_or_default());
    }
    let by_seconds = |a: &Late, b: &Late| a.seconds.total_cmp(&b.seconds);
    let Some(first) = late.values().copied().min_by(by_seconds) else {
        return late;
    };
    if first.seconds < 0.0 {
        for of_view in late.values_mut() {
            of_view.seconds -= first.seconds;
            of_view.sd_s = of_view.sd_s.hypot(first.sd_s);
        }
    }
    late.retain(|_, of_view| of_view.seconds > 0.0);
    late
}

/// A camera's direction relative to its usual one, as seen in its image.
#[derive(Debug, Clone, Copy, PartialEq, JsonSchema)]
pub struct CameraTurn {
    /// Place of what is usually at the image's centre minus the centre, pixels to the right.
    pub shift_x_px: f64,
    /// The same, pixels down.
    pub shift_y_px: f64,
    /// Rotation of the image about its centre, clockwise, degrees.
    pub roll_deg: f64,
    /// Standard deviation of the shift, pixels, the larger of both axes.
    pub shift_sd_px: f64,
}

impl CameraTurn {
    /// The usual place for a point that appears at `place_px`, pixels.
    pub fn usual_place(&self, camera: &Camera, place_px: DVec2) -> DVec2 {
        let shift_px = DVec2::new(self.shift_x_px, self.shift_y_px);
        let turn = camera.turn(shift_px, self.roll_deg.to_radians());
        camera.pixel_of(turn.transpose() * camera.image_of(place_px).extend(1.0))
    }
}

/// Camera conditions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, JsonSchema)]
#[schemars(rename_all = "kebab-case")]
pub enum HealthState {
    /// It looks in its usual direction, and the image is a new one.
    Steady,
    /// It looks in another direction than usual.
    Moved,
    /// Its direction changes from image to image.
    Shaking,
    /// The image repeats an earlier one, although the aircraft moves.
    Frozen,
    /// The background shows too little to measure the direction.
    Unknown,
}

words!(HealthState, 5, {
    Steady: "steady",
    Moved: "moved",
    Shaking: "shaking",
    Frozen: "frozen",
    Unknown: "unknown",
});

impl HealthState {
    /// True unless boxes of such an image are off or old.
    pub fn is_well(self) -> bool {
        matches!(self, Self::Steady | Self::Unknown)
    }
}

numbers!(CameraTurn, 4, {
    shift_x_px: limits::SHIFT_PX,
    shift_y_px: limits::SHIFT_PX,
    roll_deg: limits::CAMERA_ROLL_DEG,
    shift_sd_px: limits::SHIFT_SD_PX,
});

numbers!(ViewLag, 2, {
    lag_ms: limits::VIEW_LAG_MS,
    lag_sd_ms: limits::VIEW_LAG_SD_MS,
});

/// The table `health/<model>.parquet`.
impl ImageRow for ViewHealth {
    const NAME: &'static str = "health";

    fn columns(rows: &[Self]) -> TableWriter {
        let rows = rows.iter();
        let turns = rows.clone().map(|row| row.motion);
        let lags = rows.clone().map(|row| row.lag);
        TableWriter::new()
            .u32("tick", rows.clone().map(|row| row.tick))
            .text("view", rows.clone().map(|row| &row.view))
            .text("state", rows.clone().map(|row| row.state.word()))
            .optional_numbers(
                CameraTurn::COLUMNS,
                turns.map(|turn| turn.map(CameraTurn::to_array)),
            )
            .text("state_live", rows.clone().map(|row| row.state_live.word()))
            .optional_numbers(ViewLag::COLUMNS, lags.map(|lag| lag.map(ViewLag::to_array)))
    }

    fn of_table(table: &mut Table) -> Result<Vec<Self>> {
        let ticks = table.u32("tick")?;
        let turns = table.optional_numbers(CameraTurn::COLUMNS)?;
        let states = table.words::<HealthState>("state")?;
        let live = table.words::<HealthState>("state_live")?;
        let lags = table.optional_numbers(ViewLag::COLUMNS)?;
        let keys = ticks.into_iter().zip(table.text("view")?).enumerate();
        keys.map(|(row, (tick, view))| {
            Ok(Self {
                tick,
                view,
                state: states[row],
                motion: all_or_none(table, row, turns[row])?.map(CameraTurn::of_array),
                state_live: live[row],
                lag: all_or_none(table, row, lags[row])?.map(ViewLag::of_array),
            })
        })
        .collect()
    }
}

fn all_or_none<const N: usize>(
    table: &Table,
    row: usize,
    numbers: std::result::Result<[f64; N], usize>,
) -> Result<Option<[f64; N]>> {
    match numbers {
        Ok(numbers) => Ok(Some(numbers)),
        Err(0) => Ok(None),
        Err(some) => Err(table.fault(format!(
            "row {row} has {some} of {N} numbers, expected all or none"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows() -> Vec<ViewHealth> {
        let turn = CameraTurn {
            shift_x_px: 1.5,
            shift_y_px: -0.25,
            roll_deg: 0.01,
            shift_sd_px: 0.04,
        };
        (0..)
            .zip(HealthState::ALL)
            .map(|(tick, state)| ViewHealth {
                tick,
                view: "left".into(),
                state,
                motion: (state != HealthState::Unknown).then_some(turn),
                state_live: HealthState::Steady,
                lag: (tick % 2 == 0).then_some(ViewLag {
                    lag_ms: 450.0,
                    lag_sd_ms: 20.0,
                }),
            })
            .collect()
    }

    #[test]
    fn of_two_views_the_one_that_shows_the_past_is_late_if_that_is_certain() {
        let rows = |lag_ms: f64, lag_sd_ms: f64| {
            let row = |view: &str, lag: Option<ViewLag>| ViewHealth {
                view: view.into(),
                lag,
                ..rows()[0].clone()
            };
            let lag = ViewLag { lag_ms, lag_sd_ms };
            [row("left", None), row("right", Some(lag))]
        };
        let late = |lag_ms, lag_sd_ms| {
            let rows = rows(lag_ms, lag_sd_ms);
            let late = late_views(&rows).into_iter();
            late.map(|(view, late)| (view.to_owned(), late))
                .collect::<Vec<_>>()
        };
        let expected = Late {
            seconds: 0.45,
            sd_s: 0.02,
        };
        assert_eq!(late(450.0, 20.0), [("right".to_owned(), expected)]);
        assert_eq!(late(-450.0, 20.0), [("left".to_owned(), expected)]);
        assert_eq!(late(450.0, 100.0), []);
        assert_eq!(late(90.0, 1.0), []);
    }

    #[test]
    fn health_is_read_back_as_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc.parquet");
        let mut unmeasured = rows();
        for row in &mut unmeasured {
            row.lag = None;
        }
        for rows in [rows(), unmeasured, Vec::new()] {
            ViewHealth::write(&rows, &path).unwrap();
            let content = std::fs::read(&path).unwrap();
            assert_eq!(ViewHealth::parse(content, &path, 6).unwrap(), rows);
        }
    }

    #[test]
    fn an_unknown_state_and_half_a_turn_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc.parquet");
        let read = |state: &str, numbers: [Option<f64>; 4]| {
            let table = TableWriter::new()
                .u32("tick", [0])
                .text("view", ["left"])
                .text("state", [state])
                .text("state_live", ["steady"])
                .optional_f64("lag_ms", [None])
                .optional_f64("lag_sd_ms", [None]);
            let named = CameraTurn::COLUMNS.into_iter().zip(numbers);
            let table = named.fold(table, |table, ((name, _), number)| {
                table.optional_f64(name, [number])
            });
            table.write(&path).unwrap();
            let content = std::fs::read(&path).unwrap();
            ViewHealth::parse(content, &path, 1)
                .unwrap_err()
                .to_string()
        };
        let whole = [Some(1.0); 4];
        let half = [Some(1.0), None, None, Some(0.1)];
        for (state, numbers, words) in [
            (
                "ill",
                whole,
                "row 0: state is \"ill\", expected one of steady, moved",
            ),
            ("moved", half, "row 0 has 2 of 4 numbers"),
            ("moved", [Some(f64::NAN); 4], "row 0: shift_x_px NaN"),
        ] {
            let message = read(state, numbers);
            assert!(message.contains(words), "{message}");
        }
    }
}
