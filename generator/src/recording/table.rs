//! CSV table with a recorded flight: a header with column names, then a row per state.

use std::fmt::Display;
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
/// Buffer size of readers, bytes: a header fits into it.
pub(super) const HEAD_BYTES: usize = 1 << 16;
const SEPARATORS: [(u8, &str); 3] = [(b',', "a comma"), (b';', "a semicolon"), (b'\t', "a tab")];

#[derive(Debug, Clone)]
pub(super) struct Row {
    /// Line in the file, from 1.
    pub(super) line: u64,
    pub(super) state: FlightState,
    /// The first number that is impossible for an airliner on approach. It matters only if the row is part of the approach.
    pub(super) fault: Option<FieldOutOfLimits>,
    /// True if the row says that its attitude was derived from the path, as `dtd tracks import` writes it.
    pub(super) has_derived_attitude: bool,
}

pub(super) struct Rows<'a, R> {
    path: &'a Path,
    records: csv::StringRecordsIntoIter<R>,
    /// Places of [`COLUMNS`], and of [`ON_GROUND`].
    places: [usize; COLUMNS.len()],
    on_ground: usize,
    attitude: Option<usize>,
}

impl<'a, R: BufRead> Rows<'a, R> {
    pub(super) fn new(path: &'a Path, mut file: R) -> Result<Self, RecordingError> {
        let head = file.fill_buf().map_err(dataset::Error::io("read", path))?;
        if head.len() >= HEAD_BYTES && !head.contains(&b'\n') {
            return Err(not_a_table(
                path,
                format!("no line ends within its first {HEAD_BYTES} bytes; expected a CSV table"),
            ));
        }
        let (separator, separator_name) = separator(head);
        let mut reader = csv::ReaderBuilder::new()
            .delimiter(separator)
            .trim(csv::Trim::All)
            .from_reader(file);
        let header = reader.headers();
        let header = header.map_err(|error| not_a_table(path, error))?.clone();
        let place = |name: &str| header.iter().position(|found| found == name);
        let names = COLUMNS.iter().map(|(name, _)| *name).chain([ON_GROUND]);
        let missing: Vec<&str> = names.filter(|name| place(name).is_none()).collect();
        if !missing.is_empty() {
            return Err(not_a_table(
                path,
                format!(
                    "no column {}; the first line, read with {separator_name} as the separator, names {}",
                    missing.join(", "),
                    header.iter().collect::<Vec<_>>().join(", ")
                ),
            ));
        }
        Ok(Self {
            path,
            records: reader.into_records(),
            places: COLUMNS.map(|(name, _)| place(name).unwrap_or_default()),
            on_ground: place(ON_GROUND).unwrap_or_default(),
            attitude: place("attitude"),
        })
    }

    fn row(&self, record: &csv::StringRecord) -> Result<Row, RecordingError> {
        let line = record.position().map_or(0, csv::Position::line);
        let bad = |column: &str, found: &str, expected: &str| {
            RecordingError::Unusable(format!(
                "{}:{line}: {column} is {found:?}; expected {expected}",
                self.path.display()
            ))
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
            has_derived_attitude: self.attitude.is_some_and(|at| &record[at] == "derived"),
        })
    }
}

impl<R: BufRead> Iterator for Rows<'_, R> {
    type Item = Result<Row, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        Some(match self.records.next()? {
            Ok(record) => self.row(&record),
            Err(error) => Err(not_a_table(self.path, error)),
        })
    }
}

fn not_a_table(path: &Path, why: impl Display) -> RecordingError {
    RecordingError::Unusable(format!("{}: {why}", path.display()))
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
