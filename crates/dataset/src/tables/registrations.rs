//! `registrations/<model>.parquet`: where the first view's aircraft is in the others, measured from the pixels of both.
//!
//! Input: what `dtd detect` measured for each tick and each view but the first, the reference. Output: a typed row for each pair, a shift
//! or the reason why there is none. The table belongs to the detections of the same model: their record names it
//! ([`crate::corpus::detections`]), and it is replaced with them.

use schemars::JsonSchema;

use crate::error::Result;
use crate::numbers::limits;
use crate::tables::columns::{Table, TableWriter};
use crate::tables::image_rows::ImageRow;
use crate::tables::row_parts::{Numbers, numbers, words};

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
}

/// Reasons why a view has no shift at a tick.
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

words!(NoShift, 6, {
    NoBox: "no-box",
    Edge: "edge",
    Faint: "faint",
    Different: "different",
    Lost: "lost",
    Vague: "vague",
});

numbers!(Shift, 6, {
    x_px: limits::BOX_PLACE_PX,
    y_px: limits::BOX_PLACE_PX,
    dx_px: limits::SHIFT_PX,
    dy_px: limits::SHIFT_PX,
    sd_x_px: limits::SHIFT_SD_PX,
    sd_y_px: limits::SHIFT_SD_PX,
});

/// True if all numbers can be stored.
pub fn is_within_limits(shift: &Shift) -> bool {
    let mut numbers = Shift::COLUMNS.iter().zip(shift.to_array());
    numbers.all(|((_, limits), number)| limits.hold(number))
}

/// The table `registrations/<model>.parquet`.
impl ImageRow for Registration {
    const NAME: &'static str = "registrations";

    fn columns(rows: &[Self]) -> TableWriter {
        let rows = rows.iter();
        let shifts = rows.clone().map(|row| row.result.ok());
        TableWriter::new()
            .u32("tick", rows.clone().map(|row| row.tick))
            .text("view", rows.clone().map(|row| &row.view))
            .text("reference", rows.clone().map(|row| &row.reference))
            .optional_numbers(
                Shift::COLUMNS,
                shifts.map(|shift| shift.map(Shift::to_array)),
            )
            .optional_text(
                "reason",
                rows.map(|row| row.result.err().map(NoShift::word)),
            )
    }

    fn of_table(table: &mut Table) -> Result<Vec<Self>> {
        let ticks = table.u32("tick")?;
        let shifts = table.optional_numbers(Shift::COLUMNS)?;
        let reasons = table.optional_words::<NoShift>("reason")?;
        let views = table.text("view")?.into_iter();
        let keys = ticks.into_iter().zip(views.zip(table.text("reference")?));
        let results = shifts.into_iter().zip(reasons);
        let rows = keys.zip(results).enumerate();
        rows.map(|(row, ((tick, (view, reference)), (shift, reason)))| {
            let result = match (shift, reason) {
                (Ok(numbers), None) => Ok(Shift::of_array(numbers)),
                (Err(0), Some(reason)) => Err(reason),
                (shift, reason) => {
                    let count = shift.map_or_else(|count| count, |all| all.len());
                    let all = Shift::COLUMNS.len();
                    return Err(table.neither_whole_nor_absent(row, [count, all], reason));
                }
            };
            Ok(Self {
                tick,
                view,
                reference,
                result,
            })
        })
        .collect()
    }
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
            Registration::write(&rows, &path).unwrap();
            let content = std::fs::read(&path).unwrap();
            assert_eq!(Registration::parse(content, &path, 3).unwrap(), rows);
        }
    }

    #[test]
    fn a_row_with_half_a_shift_an_unknown_reason_or_neither_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc.parquet");
        let read = |numbers: [Option<f64>; 6], reason: Option<&str>| {
            let table = TableWriter::new()
                .u32("tick", [0])
                .text("view", ["right"])
                .text("reference", ["left"]);
            let table = Shift::COLUMNS
                .into_iter()
                .zip(numbers)
                .fold(table, |table, ((name, _), number)| {
                    table.optional_f64(name, [number])
                });
            table
                .optional_text("reason", [reason])
                .write(&path)
                .unwrap();
            let content = std::fs::read(&path).unwrap();
            Registration::parse(content, &path, 1)
                .unwrap_err()
                .to_string()
        };
        let whole = [Some(1.0); 6];
        let mut half = whole;
        half[4] = None;
        for (numbers, reason, words) in [
            (half, None, "row 0 has 5 of 6 numbers and no reason"),
            (
                half,
                Some("faint"),
                "row 0 has 5 of 6 numbers and reason \"faint\"",
            ),
            (whole, Some("faint"), "row 0 has 6 of 6 numbers"),
            ([None; 6], None, "row 0 has 0 of 6 numbers and no reason"),
            (
                [None; 6],
                Some("odd"),
                "reason is \"odd\", expected one of no-box, edge",
            ),
            ([Some(f64::NAN); 6], None, "row 0: x_px NaN"),
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
        assert!(Registration::write(&rows, &path).is_err());
    }
}
