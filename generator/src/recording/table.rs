//! The CSV table of a recorded flight: a header with the names of the columns, then a row per state.

use std::io::BufRead;
use std::path::Path;

use dataset::geometry::pose::{Controls, FlightState, Pose};
use dataset::numbers::limits::{self, Check, FieldOutOfLimits, Limits};

use super::RecordingError;

/// The columns, in any order in a file; others are ignored.
const COLUMNS: [(&str, Limits); 13] = [
    ("t_s", limits::FLIGHT_TIME_S),
    ("latitude_deg", limits::LATITUDE_DEG),
    ("longitude_deg", limits::LONGITUDE_DEG),
    ("altitude_msl_m", limits::ALTITUDE_MSL_M),
    ("pitch_deg", limits::PITCH_DEG),
    ("roll_deg", limits::ROLL_DEG),
    ("heading_true_deg", limits::HEADING_TRUE_DEG),
    ("tas_mps", limits::TRUE_AIRSPEED_MPS),
    ("v_north_mps", limits::VELOCITY_MPS),
    ("v_east_mps", limits::VELOCITY_MPS),
    ("v_down_mps", limits::VELOCITY_DOWN_MPS),
    ("flap_norm", limits::RATIO),
    ("gear_norm", limits::RATIO),
];
/// The one column that is no number: 0 or 1.
const ON_GROUND: &str = "on_ground";
/// Separators of fields.
const SEPARATORS: [(u8, &str); 3] = [(b',', "a comma"), (b';', "a semicolon"), (b'\t', "a tab")];

/// A row of the table.
#[derive(Debug, Clone)]
pub(super) struct Row {
    /// Its line in the file, from 1.
    pub(super) line: u64,
    pub(super) state: FlightState,
    /// The first number that is impossible for an airliner on approach. It matters only if the row is part of the approach.
    pub(super) fault: Option<FieldOutOfLimits>,
}

/// The rows of a table, one after the other.
pub(super) struct Rows<'a, R> {
    path: &'a Path,
    records: csv::StringRecordsIntoIter<R>,
    /// Places of [`COLUMNS`], and of [`ON_GROUND`].
    places: [usize; COLUMNS.len()],
    on_ground: usize,
}

impl<'a, R: BufRead> Rows<'a, R> {
    /// Reads the header of the file at `path`.
    pub(super) fn new(path: &'a Path, mut file: R) -> Result<Self, RecordingError> {
        let unreadable = |cause| RecordingError::NotATable {
            path: path.to_owned(),
            cause,
        };
        let head = file.fill_buf().map_err(|error| unreadable(error.into()))?;
        let (separator, separator_name) = separator(head);
        let mut reader = csv::ReaderBuilder::new()
            .delimiter(separator)
            .trim(csv::Trim::All)
            .from_reader(file);
        let header = reader.headers().map_err(unreadable)?.clone();
        let place = |name: &str| header.iter().position(|found| found == name);
        let names = COLUMNS.iter().map(|(name, _)| *name).chain([ON_GROUND]);
        let missing: Vec<&str> = names.filter(|name| place(name).is_none()).collect();
        if !missing.is_empty() {
            return Err(RecordingError::MissingColumns {
                path: path.to_owned(),
                missing: missing.join(", "),
                found: header.iter().collect::<Vec<_>>().join(", "),
                separator: separator_name,
            });
        }
        Ok(Self {
            path,
            records: reader.into_records(),
            places: COLUMNS.map(|(name, _)| place(name).unwrap_or_default()),
            on_ground: place(ON_GROUND).unwrap_or_default(),
        })
    }

    fn row(&self, record: &csv::StringRecord) -> Result<Row, RecordingError> {
        let line = record.position().map_or(0, csv::Position::line);
        let bad =
            |column: &'static str, found: &str, expected: &'static str| RecordingError::NotAValue {
                path: self.path.to_owned(),
                line,
                column,
                found: found.to_owned(),
                expected,
            };
        let mut numbers = [0.0; COLUMNS.len()];
        for ((number, at), (column, _)) in numbers.iter_mut().zip(self.places).zip(COLUMNS) {
            let text = &record[at];
            *number = text
                .parse()
                .map_err(|_| bad(column, text, expected_number(column, text)))?;
        }
        let is_on_ground = truth(&record[self.on_ground])
            .ok_or_else(|| bad(ON_GROUND, &record[self.on_ground], "0, 1, false or true"))?;
        let mut check = Check::default();
        for (number, (column, limits)) in numbers.iter().zip(COLUMNS) {
            check.number(column, *number, limits);
        }
        Ok(Row {
            line,
            state: state(numbers, is_on_ground),
            fault: check.first(),
        })
    }
}

impl<R: BufRead> Iterator for Rows<'_, R> {
    type Item = Result<Row, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        Some(match self.records.next()? {
            Ok(record) => self.row(&record),
            Err(cause) => Err(RecordingError::NotATable {
                path: self.path.to_owned(),
                cause,
            }),
        })
    }
}

/// The separator that finds the most of our columns in the first line.
fn separator(head: &[u8]) -> (u8, &'static str) {
    let header = head.split(|byte| *byte == b'\n').next().unwrap_or_default();
    let known = |separator: u8| {
        let fields = header.split(|byte| *byte == separator);
        let names = fields.map(|field| {
            String::from_utf8_lossy(field)
                .trim()
                .trim_matches('"')
                .to_owned()
        });
        names
            .filter(|name| COLUMNS.iter().any(|(column, _)| column == name))
            .count()
    };
    let mut best = SEPARATORS[0];
    for candidate in &SEPARATORS[1..] {
        if known(candidate.0) > known(best.0) {
            best = *candidate;
        }
    }
    best
}

fn expected_number(column: &str, found: &str) -> &'static str {
    if found.is_empty() {
        "a number in every row"
    } else if column == "t_s" && found.contains(':') {
        "seconds since any moment, as a number"
    } else if found.contains(',') {
        "a number with a decimal point"
    } else {
        "a number, such as 2.5"
    }
}

/// 0 or 1 as programs write them.
fn truth(text: &str) -> Option<bool> {
    match text.to_ascii_lowercase().as_str() {
        "false" | "f" => Some(false),
        "true" | "t" => Some(true),
        number => match number.parse::<f64>() {
            Ok(0.0) => Some(false),
            Ok(1.0) => Some(true),
            _ => None,
        },
    }
}

/// `numbers` are in the order of [`COLUMNS`].
fn state(numbers: [f64; COLUMNS.len()], on_ground: bool) -> FlightState {
    let [
        time_s,
        latitude_deg,
        longitude_deg,
        altitude_msl_m,
        pitch_deg,
        roll_deg,
        heading_true_deg,
        true_airspeed_mps,
        velocity_north_mps,
        velocity_east_mps,
        velocity_down_mps,
        flap_ratio,
        gear_ratio,
    ] = numbers;
    FlightState {
        time_s,
        pose: Pose {
            latitude_deg,
            longitude_deg,
            altitude_msl_m,
            heading_true_deg,
            pitch_deg,
            roll_deg,
        },
        velocity_north_mps,
        velocity_east_mps,
        velocity_down_mps,
        true_airspeed_mps,
        controls: Controls {
            flap_ratio,
            gear_ratio,
        },
        on_ground,
    }
}
