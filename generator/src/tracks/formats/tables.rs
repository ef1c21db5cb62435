//! Tables of positions: CSV or Parquet. The names of the columns tell what they hold, and its unit.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::str::FromStr;

use chrono::{DateTime, NaiveDate};
use csv::StringRecord;
use dataset::geometry::geodesy::LatLon;
use dataset::numbers::units::{METERS_PER_FOOT, MPS_PER_KNOT};
use dataset::tables::columns::Table;

use super::{Fix, NearFixes, Track};

/// Times above this are milliseconds since 1970, or a thousandth or a millionth of these.
const MILLISECONDS: f64 = 1e11;
/// Separators of a CSV; the one that occurs most in its first line counts.
const SEPARATORS: [u8; 4] = [b',', b';', b'\t', b'|'];

/// Content of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Meaning {
    Time,
    /// When the position was received, if the rows are snapshots.
    PositionTime,
    /// Day of a time that has none.
    Date,
    Latitude,
    Longitude,
    /// Latitude and longitude with a comma between them.
    Position,
    Altitude,
    Geometric,
    Speed,
    Track,
    Roll,
    OnGround,
    Aircraft,
}

use Meaning::{
    Aircraft, Altitude, Date, Geometric, Latitude, Longitude, OnGround, Position, PositionTime,
    Roll, Speed, Time, Track as Course,
};

/// A meaning, the name of its column or of an argument, and the factor to metres, m/s or degrees.
type Named = (Meaning, &'static str, f64);

/// Columns of programs, in lower case. Flightradar24 writes 0 ft for everything on the ground.
const PROGRAMS: [(&str, &[Named]); 4] = [
    (
        "traffic",
        &[
            (Time, "timestamp", 1.0),
            (PositionTime, "last_position", 1.0),
            (Latitude, "latitude", 1.0),
            (Longitude, "longitude", 1.0),
            (Altitude, "altitude", METERS_PER_FOOT),
            (Geometric, "geoaltitude", METERS_PER_FOOT),
            (Speed, "groundspeed", MPS_PER_KNOT),
            (Course, "track", 1.0),
            (Roll, "roll", 1.0),
            (OnGround, "onground", 1.0),
            (Aircraft, "icao24", 1.0),
        ],
    ),
    (
        "OpenSky",
        &[
            (Time, "time", 1.0),
            (PositionTime, "lastposupdate", 1.0),
            (Latitude, "lat", 1.0),
            (Longitude, "lon", 1.0),
            (Altitude, "baroaltitude", 1.0),
            (Geometric, "geoaltitude", 1.0),
            (Speed, "velocity", 1.0),
            (Course, "heading", 1.0),
            (OnGround, "onground", 1.0),
            (Aircraft, "icao24", 1.0),
        ],
    ),
    (
        FLIGHTRADAR,
        &[
            (Time, "timestamp", 1.0),
            (Position, "position", 1.0),
            (Altitude, "altitude", METERS_PER_FOOT),
            (Speed, "speed", MPS_PER_KNOT),
            (Course, "direction", 1.0),
            (Aircraft, "callsign", 1.0),
        ],
    ),
    (
        "TartanAviation",
        &[
            (Time, "time", 1.0),
            (Date, "date", 1.0),
            (Latitude, "lat", 1.0),
            (Longitude, "lon", 1.0),
            (Altitude, "altitude", METERS_PER_FOOT),
            (Speed, "speed", MPS_PER_KNOT),
            (Course, "heading", 1.0),
            (Aircraft, "id", 1.0),
        ],
    ),
];
const FLIGHTRADAR: &str = "Flightradar24";

/// Names in `--columns`. Those without a unit are in feet and knots, as aviation has them.
const ARGUMENTS: [Named; 16] = [
    (Time, "time", 1.0),
    (Date, "date", 1.0),
    (Latitude, "latitude", 1.0),
    (Longitude, "longitude", 1.0),
    (Position, "position", 1.0),
    (Altitude, "altitude", METERS_PER_FOOT),
    (Altitude, "altitude_m", 1.0),
    (Geometric, "geometric_altitude", METERS_PER_FOOT),
    (Geometric, "geometric_altitude_m", 1.0),
    (Speed, "speed", MPS_PER_KNOT),
    (Speed, "speed_mps", 1.0),
    (Speed, "speed_kmh", 1.0 / 3.6),
    (Course, "track", 1.0),
    (Roll, "roll", 1.0),
    (OnGround, "on_ground", 1.0),
    (Aircraft, "aircraft", 1.0),
];

/// A column that the user names, such as `time=Timestamp`.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedColumn {
    meaning: Meaning,
    factor: f64,
    column: String,
}

impl FromStr for NamedColumn {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = || ARGUMENTS.map(|(_, name, _)| name).join(", ");
        let (name, column) = text
            .split_once('=')
            .ok_or("expected NAME=COLUMN, e.g. time=Timestamp")?;
        let known = ARGUMENTS.iter().find(|(_, known, _)| *known == name.trim());
        let (meaning, _, factor) = known
            .ok_or_else(|| format!("{name:?} is no such name; expected one of {}", names()))?;
        Ok(Self {
            meaning: *meaning,
            factor: *factor,
            column: column.trim().to_owned(),
        })
    }
}

/// The columns of a table: for each meaning its place and factor.
struct Columns {
    places: Vec<(Meaning, usize, f64)>,
    zero_is_ground: bool,
}

impl Columns {
    fn of(header: &StringRecord, named: &[NamedColumn]) -> Result<Self, String> {
        let found = header.iter().collect::<Vec<_>>().join(", ");
        let mut own = Vec::new();
        for NamedColumn {
            meaning,
            factor,
            column,
        } in named
        {
            let place = header.iter().position(|name| name == column);
            let place = place
                .ok_or_else(|| format!("has no column {column:?} (--columns); it has {found}"))?;
            own.push((*meaning, place, *factor));
        }
        let place = |column: &str| {
            let is_it = |name: &str| name.to_lowercase() == column;
            header.iter().position(is_it)
        };
        let mut missing = Vec::new();
        for (program, columns) in PROGRAMS {
            let found = columns
                .iter()
                .filter_map(|(meaning, column, factor)| Some((*meaning, place(column)?, *factor)));
            let mut places = own.clone();
            places.extend(found);
            let has = |meaning| places.iter().any(|(found, ..)| *found == meaning);
            let is_placed = has(Position) || (has(Latitude) && has(Longitude));
            if has(Time) && is_placed && (has(Altitude) || has(Geometric)) {
                return Ok(Self {
                    places,
                    zero_is_ground: program == FLIGHTRADAR,
                });
            }
            let lacks = columns.iter().filter(|(meaning, ..)| {
                [Time, Latitude, Longitude, Position, Altitude].contains(meaning) && !has(*meaning)
            });
            let lacks: Vec<&str> = lacks.map(|(_, column, _)| *column).collect();
            missing.push(format!("{} for {program}", lacks.join(", ")));
        }
        Err(format!(
            "lacks the columns {}; it has {found}. Name them, e.g. `--columns time=Timestamp,latitude=Lat,longitude=Lon,altitude=Alt` (feet; \
             altitude_m is in metres). Other forms that are read: trace_full of readsb, JSON lines of jet1090, X-Plane's Data.txt",
            missing.join("; or ")
        ))
    }

    fn place(&self, meaning: Meaning) -> Option<(usize, f64)> {
        let found = self.places.iter().find(|(found, ..)| *found == meaning);
        found.map(|(_, place, factor)| (*place, *factor))
    }
}

/// A row that is read.
struct Row<'a> {
    columns: &'a Columns,
    fields: &'a StringRecord,
}

impl Row<'_> {
    fn text(&self, meaning: Meaning) -> &str {
        let place = self.columns.place(meaning);
        place
            .and_then(|(place, _)| self.fields.get(place))
            .unwrap_or_default()
    }

    fn number(&self, meaning: Meaning) -> Result<Option<f64>, String> {
        let Some((place, factor)) = self.columns.place(meaning) else {
            return Ok(None);
        };
        let number = number(self.text(meaning));
        let number = number.map_err(|why| format!("column {}: {why}", place + 1))?;
        Ok(number.map(|number| number * factor))
    }

    fn place(&self) -> Result<Option<(f64, f64)>, String> {
        if self.columns.place(Latitude).is_some() {
            return Ok(self.number(Latitude)?.zip(self.number(Longitude)?));
        }
        let Some((latitude, longitude)) = self.text(Position).split_once(',') else {
            return Ok(None);
        };
        Ok(number(latitude)?.zip(number(longitude)?))
    }

    fn time_s(&self) -> Result<Option<f64>, String> {
        let received_s = seconds(self.text(PositionTime), "")?;
        Ok(received_s.or(seconds(self.text(Time), self.text(Date))?))
    }

    fn fix(&self) -> Result<Option<Fix>, String> {
        let (Some(time_s), Some((latitude_deg, longitude_deg))) = (self.time_s()?, self.place()?)
        else {
            return Ok(None);
        };
        let altitude_m = self.number(Altitude)?;
        let on_ground = self.text(OnGround).to_ascii_lowercase();
        Ok(Some(Fix {
            time_s,
            latitude_deg,
            longitude_deg,
            altitude_m: altitude_m.filter(|m| *m != 0.0 || !self.columns.zero_is_ground),
            geometric_m: self.number(Geometric)?,
            ground_speed_mps: self.number(Speed)?,
            track_deg: self.number(Course)?,
            roll_deg: self.number(Roll)?,
            on_ground: matches!(on_ground.as_str(), "true" | "1" | "1.0" | "t"),
            ..Fix::default()
        }))
    }
}

fn number(text: &str) -> Result<Option<f64>, String> {
    match text.trim() {
        "" | "null" | "None" | "NaT" => Ok(None),
        text => match text.parse::<f64>() {
            Ok(number) => Ok(Some(number).filter(|number| number.is_finite())),
            Err(_) => Err(format!("{text:?} is not a number")),
        },
    }
}

/// Seconds since 1970 of a number (seconds, milliseconds or less), or of a date with a time (UTC without a zone); the error says what is
/// wrong with it.
///
/// # Errors
/// It is neither.
pub fn utc_s(text: &str) -> Result<f64, String> {
    seconds(text, "")?.ok_or_else(|| "no time".to_owned())
}

/// Seconds since 1970 of a number, or of a date with a time (UTC without a zone) in one text or two.
fn seconds(text: &str, date: &str) -> Result<Option<f64>, String> {
    if !date.is_empty() {
        let moment = || {
            let [year, month, day] = numbers_in(date)?;
            let [hours, minutes, seconds] = numbers_in(text)?;
            let date = NaiveDate::from_ymd_opt(year as i32, month as u32, day as u32)?;
            let midnight_s = date.and_hms_opt(0, 0, 0)?.and_utc().timestamp();
            Some(midnight_s as f64 + 3_600.0 * hours + 60.0 * minutes + seconds)
        };
        let wrong = || format!("{date:?} and {text:?} are not a date and a time of day");
        return moment().map(Some).ok_or_else(wrong);
    }
    if text.len() > 10 && text.as_bytes()[4] == b'-' {
        let text = text.replacen(' ', "T", 1);
        let date = DateTime::parse_from_rfc3339(&text)
            .or_else(|_| DateTime::parse_from_rfc3339(&format!("{text}Z")))
            .map_err(|error| format!("{text:?} is not a date and time: {error}"))?;
        return Ok(Some(date.timestamp_micros() as f64 / 1e6));
    }
    let scales = [1.0, 1e3, 1e6, 1e9];
    let scaled = |time: f64| {
        let seconds = scales.map(|scale| time / scale).into_iter();
        let mut plausible = seconds.filter(|time_s| *time_s <= MILLISECONDS);
        let wrong = || format!("{text:?} is not a time: seconds to nanoseconds since 1970");
        plausible.next().ok_or_else(wrong)
    };
    number(text)?.map(scaled).transpose()
}

/// The three numbers in a text such as `14:29:18.5` or `['2021', '10', '07']`.
fn numbers_in(text: &str) -> Option<[f64; 3]> {
    let parts = text.split(|letter: char| !letter.is_ascii_digit() && letter != '.');
    let numbers = parts.filter(|part| !part.is_empty()).map(str::parse);
    let numbers: Vec<f64> = numbers.collect::<Result<_, _>>().ok()?;
    numbers.try_into().ok()
}

/// The tracks near a place in rows, each with its number in the file.
fn tracks<E: ToString>(
    header: &StringRecord,
    rows: impl Iterator<Item = Result<(u64, StringRecord), E>>,
    named: &[NamedColumn],
    target: LatLon,
) -> Result<Vec<Track>, String> {
    let columns = Columns::of(header, named)?;
    let mut tracks: BTreeMap<String, NearFixes> = BTreeMap::new();
    for row in rows {
        let (number, fields) = row.map_err(|error| error.to_string())?;
        let row = Row {
            columns: &columns,
            fields: &fields,
        };
        // An aircraft without any position is counted as well.
        let kept = tracks.entry(row.text(Aircraft).to_owned()).or_default();
        let fix = row.fix().map_err(|why| format!("line {number}: {why}"))?;
        if let Some(fix) = fix {
            kept.add(fix, target);
        }
    }
    Ok(super::tracks_of(tracks))
}

/// The separator of a table, by its first line.
pub fn separator(head: &[u8]) -> u8 {
    let first = head.split(|byte| *byte == b'\n').next().unwrap_or_default();
    let count = |separator: &u8| first.iter().filter(|byte| *byte == separator).count();
    let most = SEPARATORS.into_iter().rev().max_by_key(count);
    most.unwrap_or(b',')
}

pub(super) fn csv<R: Read>(
    head: &[u8],
    file: R,
    named: &[NamedColumn],
    target: LatLon,
) -> Result<Vec<Track>, String> {
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(separator(head))
        .trim(csv::Trim::All)
        .from_reader(file);
    let header = reader.headers().map_err(|error| error.to_string())?.clone();
    let rows = reader.into_records().map(|record| {
        let record = record?;
        let line = record.position().map_or(0, csv::Position::line);
        Ok::<_, csv::Error>((line, record))
    });
    tracks(&header, rows, named, target)
}

/// A Parquet table, as `traffic` writes it. Columns that are not used may hold anything.
pub(super) fn parquet(
    path: &Path,
    named: &[NamedColumn],
    target: LatLon,
) -> dataset::Result<Vec<Track>> {
    let table = Table::read(path, u64::from(u32::MAX))?;
    let header: StringRecord = table.column_names().collect();
    let columns = Columns::of(&header, named).map_err(|why| table.fault(why))?;
    let cells_of = |column: &str| -> dataset::Result<Vec<String>> {
        if let Ok(numbers) = table.any_numbers(column) {
            let text = |number: Option<f64>| number.map_or(String::new(), |n| n.to_string());
            return Ok(numbers.into_iter().map(text).collect());
        }
        if let Ok(truths) = table.bool(column) {
            return Ok(truths.iter().map(bool::to_string).collect());
        }
        let texts = table.optional_text(column)?.into_iter();
        Ok(texts.map(Option::unwrap_or_default).collect())
    };
    let mut cells = vec![Vec::new(); header.len()];
    for (_, place, _) in columns.places {
        cells[place] = cells_of(&header[place])?;
    }
    let row = |row: usize| -> StringRecord {
        let field = |column: &Vec<String>| column.get(row).cloned().unwrap_or_default();
        cells.iter().map(field).collect()
    };
    let rows = (0..table.rows()).map(|index| Ok::<_, String>((index as u64, row(index))));
    tracks(&header, rows, named, target).map_err(|why| table.fault(why))
}
