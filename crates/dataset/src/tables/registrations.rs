//! `registrations/<model>.parquet`: where the aircraft of one view is in another, measured from the pixels of both.
//!
//! Input: what `dtd detect` measured for each tick and each view but the first, the reference. Output: one typed row for each of
//! them, a shift or the reason why there is none. The table belongs to the detections of the same model: their record names it
//! ([`crate::corpus::detections`]), and it is replaced with them.

use std::fmt;
use std::path::Path;

use schemars::JsonSchema;

use crate::error::Result;
use crate::numbers::limits::{self, Limits};
use crate::tables::columns::{ColumnOutOfLimits, Table, TableWriter};
use crate::work::memory;

/// A view compared with the reference view at one tick.
#[derive(Debug, Clone, PartialEq, JsonSchema)]
pub struct Registration {
    /// Number of the tick.
    pub tick: u32,
    /// Identifier of the view.
    pub view: String,
    /// Identifier of the view that it is compared with.
    pub reference: String,
    /// The shift, or the reason why there is none. In the table, numbers are null without a shift, and the reason is null with one.
    pub result: std::result::Result<Shift, NoShift>,
}

/// Position of the aircraft in one view relative to another.
#[derive(Debug, Clone, Copy, PartialEq, JsonSchema)]
pub struct Shift {
    /// The point of the reference view that was followed, the centre of its best box, pixels to the right.
    pub x_px: f64,
    /// The same point, pixels down.
    pub y_px: f64,
    /// Shift (disparity): position of that point in the view minus its position in the reference view, pixels to the right.
    pub dx_px: f64,
    /// The same, pixels down.
    pub dy_px: f64,
    /// Standard deviation of `dx_px`, pixels.
    pub sd_x_px: f64,
    /// Standard deviation of `dy_px`, pixels.
    pub sd_y_px: f64,
    /// Size of the aircraft in the view over that in the reference view.
    pub scale: f64,
    /// Contrast of the aircraft in the view over that in the reference view.
    pub gain: f64,
    /// Correlation of the two images of the aircraft.
    pub correlation: f64,
}

/// Reasons why a tick of a view has no shift.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, JsonSchema)]
#[schemars(rename_all = "kebab-case")]
pub enum NoShift {
    /// One of the views has no detection.
    NoBox,
    /// The image's edge cuts off the aircraft, or its surroundings, in one of the views.
    Edge,
    /// The aircraft does not stand out from what is around it in one of the views.
    Faint,
    /// The two images do not show the same aircraft: correlation below 0.6, or contrasts that differ tenfold or in sign.
    Different,
    /// No shift within some pixels of the boxes' shift fits.
    Lost,
    /// The standard deviation of the fit is above 0.7 px.
    Vague,
}

impl NoShift {
    /// All reasons.
    pub const ALL: [Self; 6] = [
        Self::NoBox,
        Self::Edge,
        Self::Faint,
        Self::Different,
        Self::Lost,
        Self::Vague,
    ];

    /// The word for it in the table.
    pub fn word(self) -> &'static str {
        match self {
            Self::NoBox => "no-box",
            Self::Edge => "edge",
            Self::Faint => "faint",
            Self::Different => "different",
            Self::Lost => "lost",
            Self::Vague => "vague",
        }
    }

    fn of_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|reason| reason.word() == word)
    }
}

impl fmt::Display for NoShift {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

/// Name of a value of a shift, its limits, and its accessor.
type ShiftField = (&'static str, Limits, fn(&Shift) -> f64);

const FIELDS: [ShiftField; 9] = [
    ("x_px", limits::BOX_PLACE_PX, |s| s.x_px),
    ("y_px", limits::BOX_PLACE_PX, |s| s.y_px),
    ("dx_px", limits::SHIFT_PX, |s| s.dx_px),
    ("dy_px", limits::SHIFT_PX, |s| s.dy_px),
    ("sd_x_px", limits::SHIFT_SD_PX, |s| s.sd_x_px),
    ("sd_y_px", limits::SHIFT_SD_PX, |s| s.sd_y_px),
    ("scale", limits::VIEW_SCALE, |s| s.scale),
    ("gain", limits::VIEW_GAIN, |s| s.gain),
    ("correlation", limits::CORRELATION, |s| s.correlation),
];

/// True if all numbers of a shift can be stored.
pub fn is_within_limits(shift: &Shift) -> bool {
    FIELDS
        .iter()
        .all(|(_, limits, get)| limits.check(get(shift)).is_ok())
}

/// Writes `registrations/<model>.parquet`.
pub fn write_registrations(path: &Path, registrations: &[Registration]) -> Result<()> {
    registration_columns(registrations).write(path)
}

/// The table `registrations/<model>.parquet` with its columns.
pub fn registration_columns(registrations: &[Registration]) -> TableWriter {
    let table = TableWriter::new()
        .u32("tick", registrations.iter().map(|row| row.tick))
        .text("view", registrations.iter().map(|row| &row.view))
        .text("reference", registrations.iter().map(|row| &row.reference));
    let shifts = registrations.iter().map(|row| row.result.as_ref().ok());
    FIELDS
        .into_iter()
        .fold(table, |table, (name, limits, get)| {
            table.optional_f64_within(name, limits, shifts.clone().map(|shift| shift.map(get)))
        })
        .optional_text(
            "reason",
            registrations
                .iter()
                .map(|row| row.result.err().map(NoShift::word)),
        )
}

/// Reads the content of `registrations/<model>.parquet` of a scenario with this many images, each with at most one row; messages
/// name it as `path`.
///
/// # Errors
/// A number is outside its limits, or a row has neither a whole shift nor a known reason.
pub fn parse_registrations(
    content: Vec<u8>,
    path: &Path,
    pictures: u64,
) -> Result<Vec<Registration>> {
    registrations_of(&mut Table::parse(content, path, pictures)?)
}

/// The same from a file, but collecting numbers outside their limits.
pub fn read_registrations_with_faults(
    path: &Path,
    pictures: u64,
) -> Result<(Vec<Registration>, Vec<ColumnOutOfLimits>)> {
    let mut table = Table::read(path, pictures)?.collecting();
    let registrations = registrations_of(&mut table)?;
    Ok((registrations, table.into_collected()))
}

fn registrations_of(table: &mut Table) -> Result<Vec<Registration>> {
    let row_bytes = 2 * size_of::<Registration>() + 96;
    memory::check("table of registrations", (table.rows() * row_bytes) as u64)?;
    let ticks = table.u32("tick")?;
    let mut columns = Vec::with_capacity(FIELDS.len());
    for (name, limits, _) in FIELDS {
        columns.push(table.optional_f64_within(name, limits)?);
    }
    let reasons = table.optional_text("reason")?;
    let views = table.text("view")?.into_iter();
    let words = views.zip(table.text("reference")?).zip(reasons);
    let rows = ticks.into_iter().zip(words).enumerate();
    rows.map(|(row, (tick, ((view, reference), reason)))| {
        let numbers: Vec<_> = columns.iter().filter_map(|column| column[row]).collect();
        let result = match (numbers.as_slice(), reason) {
            (&[x_px, y_px, dx_px, dy_px, sd_x_px, sd_y_px, scale, gain, correlation], None) => {
                Ok(Shift {
                    x_px,
                    y_px,
                    dx_px,
                    dy_px,
                    sd_x_px,
                    sd_y_px,
                    scale,
                    gain,
                    correlation,
                })
            }
            ([], Some(word)) => Err(NoShift::of_word(&word).ok_or_else(|| {
                let known = NoShift::ALL.map(NoShift::word).join(", ");
                table.fault(format!("row {row}: reason is {word:?}, expected one of {known}"))
            })?),
            (numbers, reason) => {
                let reason = reason.map_or_else(|| "no reason".into(), |r| format!("reason {r:?}"));
                return Err(table.fault(format!(
                    "row {row} has {} of {} numbers and {reason}, expected all numbers, or none and a reason",
                    numbers.len(),
                    FIELDS.len()
                )));
            }
        };
        Ok(Registration {
            tick,
            view,
            reference,
            result,
        })
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shift() -> Shift {
        Shift {
            x_px: 100.0,
            y_px: 50.5,
            dx_px: -3.25,
            dy_px: 0.5,
            sd_x_px: 0.05,
            sd_y_px: 0.04,
            scale: 1.01,
            gain: 0.9,
            correlation: 0.97,
        }
    }

    fn rows() -> Vec<Registration> {
        let results = [Ok(shift()), Err(NoShift::NoBox), Err(NoShift::Vague)];
        (0..)
            .zip(results)
            .map(|(tick, result)| Registration {
                tick,
                view: "right".into(),
                reference: "left".into(),
                result,
            })
            .collect()
    }

    #[test]
    fn registrations_are_read_back_as_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc.parquet");
        for rows in [rows(), Vec::new()] {
            write_registrations(&path, &rows).unwrap();
            let content = std::fs::read(&path).unwrap();
            assert_eq!(parse_registrations(content, &path, 3).unwrap(), rows);
        }
    }

    #[test]
    fn every_reason_has_a_word_of_its_own() {
        for reason in NoShift::ALL {
            assert_eq!(NoShift::of_word(reason.word()), Some(reason));
        }
        assert_eq!(NoShift::of_word("whatever"), None);
    }

    #[test]
    fn a_row_with_half_a_shift_an_unknown_reason_or_neither_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc.parquet");
        let read = |numbers: [Option<f64>; 9], reason: Option<&str>| {
            let table = TableWriter::new()
                .u32("tick", [0])
                .text("view", ["right"])
                .text("reference", ["left"]);
            let table = FIELDS
                .iter()
                .zip(numbers)
                .fold(table, |table, ((name, ..), number)| {
                    table.optional_f64(name, [number])
                });
            table
                .optional_text("reason", [reason])
                .write(&path)
                .unwrap();
            let content = std::fs::read(&path).unwrap();
            parse_registrations(content, &path, 1)
                .unwrap_err()
                .to_string()
        };
        let whole = [Some(1.0); 9];
        let mut half = whole;
        half[4] = None;
        for (numbers, reason, words) in [
            (half, None, "row 0 has 8 of 9 numbers and no reason"),
            (
                half,
                Some("faint"),
                "row 0 has 8 of 9 numbers and reason \"faint\"",
            ),
            (whole, Some("faint"), "row 0 has 9 of 9 numbers"),
            ([None; 9], None, "row 0 has 0 of 9 numbers and no reason"),
            (
                [None; 9],
                Some("odd"),
                "reason is \"odd\", expected one of no-box, edge",
            ),
            ([Some(f64::NAN); 9], None, "row 0: x_px NaN"),
        ] {
            let message = read(numbers, reason);
            assert!(message.contains(words), "{message}");
        }
    }

    #[test]
    fn a_shift_beyond_the_limits_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let mut rows = rows();
        let wild = Shift {
            sd_x_px: f64::INFINITY,
            ..shift()
        };
        assert!(!is_within_limits(&wild) && is_within_limits(&shift()));
        rows[0].result = Ok(wild);
        let path = folder.path().join("abc.parquet");
        assert!(write_registrations(&path, &rows).is_err());
    }
}
