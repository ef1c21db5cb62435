//! `aircraft.parquet`: every aircraft of a scenario with traffic, tick by tick.

use schemars::JsonSchema;

use crate::error::Result;
use crate::geometry::pose::{Controls, Pose};
use crate::numbers::limits;
use crate::tables::columns::{Table, TableWriter};
use crate::tables::image_rows::ImageRow;
use crate::tables::row_parts::Numbers;

/// An aircraft at one tick.
#[derive(Debug, Clone, Copy, PartialEq, JsonSchema)]
pub struct AircraftRow {
    /// Number of the tick.
    pub tick: u32,
    /// Number of the aircraft: 0 is the first, the one of `frames.parquet`; the others are listed in `traffic` of `scenario.json`.
    pub aircraft_number: u32,
    /// Pose of the aircraft's centre of gravity.
    pub pose: Pose,
    /// Flaps and gear.
    pub controls: Controls,
    /// True if a wheel touches the ground.
    pub on_ground: bool,
    /// **Distance to touchdown** of arrivals, metres; null for all others, and before `dtd label` has run.
    pub dtd_m: Option<f64>,
}

/// The table `aircraft.parquet`: "images" are a scenario's ticks times its aircraft.
impl ImageRow for AircraftRow {
    const NAME: &'static str = "aircraft";

    fn columns(rows: &[Self]) -> TableWriter {
        let rows = rows.iter();
        TableWriter::new()
            .u32("tick", rows.clone().map(|row| row.tick))
            .u32(
                "aircraft_number",
                rows.clone().map(|row| row.aircraft_number),
            )
            .numbers(Pose::COLUMNS, rows.clone().map(|row| row.pose.to_array()))
            .numbers(
                Controls::COLUMNS,
                rows.clone().map(|row| row.controls.to_array()),
            )
            .bool("on_ground", rows.clone().map(|row| row.on_ground))
            .optional_f64_within("dtd_m", limits::DTD_M, rows.map(|row| row.dtd_m))
    }

    fn of_table(table: &mut Table) -> Result<Vec<Self>> {
        let tick = table.u32("tick")?;
        let aircraft_number = table.u32("aircraft_number")?;
        let pose = table.numbers(Pose::COLUMNS)?;
        let controls = table.numbers(Controls::COLUMNS)?;
        let on_ground = table.bool("on_ground")?;
        let dtd_m = table.optional_f64_within("dtd_m", limits::DTD_M)?;
        let row = |row: usize| Self {
            tick: tick[row],
            aircraft_number: aircraft_number[row],
            pose: Pose::of_array(pose[row]),
            controls: Controls::of_array(controls[row]),
            on_ground: on_ground[row],
            dtd_m: dtd_m[row],
        };
        Ok((0..table.rows()).map(row).collect())
    }
}

impl AircraftRow {
    /// The first row that is not in its place: each tick has a row for each of `count` aircraft, by number.
    pub fn out_of_place(rows: &[Self], ticks: u32, count: u32) -> Option<String> {
        let expected = u64::from(ticks) * u64::from(count);
        if rows.len() as u64 != expected {
            return Some(format!(
                "has {} rows, expected {expected}: {ticks} ticks of {count} aircraft",
                rows.len()
            ));
        }
        let mut places = (0..ticks).flat_map(|tick| (0..count).map(move |number| (tick, number)));
        let at = rows
            .iter()
            .position(|row| places.next() != Some((row.tick, row.aircraft_number)))?;
        let AircraftRow {
            tick,
            aircraft_number,
            ..
        } = rows[at];
        Some(format!(
            "row {at} is tick {tick} of aircraft {aircraft_number}, expected tick {} of aircraft {}",
            at as u32 / count,
            at as u32 % count
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(tick: u32, aircraft_number: u32) -> AircraftRow {
        AircraftRow {
            tick,
            aircraft_number,
            pose: Pose {
                latitude_deg: 1.3,
                longitude_deg: 103.9,
                altitude_msl_m: 70.0 + f64::from(tick),
                heading_true_deg: 23.0,
                pitch_deg: 2.5,
                roll_deg: 0.0,
            },
            controls: Controls::default(),
            on_ground: aircraft_number == 1,
            dtd_m: (aircraft_number == 0).then_some(900.0),
        }
    }

    #[test]
    fn rows_are_read_back_as_written_and_a_missing_or_exchanged_one_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("aircraft.parquet");
        let rows = vec![row(0, 0), row(0, 1), row(1, 0), row(1, 1)];
        AircraftRow::write(&rows, &path).unwrap();
        let content = std::fs::read(&path).unwrap();
        let read = AircraftRow::parse(content, &path, 4).unwrap();
        assert_eq!(read, rows);
        assert_eq!(AircraftRow::out_of_place(&rows, 2, 2), None);
        let words = AircraftRow::out_of_place(&rows[..3], 2, 2).unwrap();
        assert_eq!(words, "has 3 rows, expected 4: 2 ticks of 2 aircraft");
        let exchanged = [rows[0], rows[1], rows[3], rows[2]];
        let words = AircraftRow::out_of_place(&exchanged, 2, 2).unwrap();
        assert!(words.starts_with("row 2 is tick 1 of aircraft 1, expected tick 1 of aircraft 0"));
    }
}
