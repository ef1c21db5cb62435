//! Published tables of a runway: its ends (X-Plane's `apt.dat`, OurAirports) and its landing aids (X-Plane's `earth_nav.dat`).
//!
//! Tables of the whole world are read line by line; the kind of a file follows from its content, never from its name.

mod apt_dat;
mod earth_nav;
mod our_airports;

use std::io::{self, BufRead, BufReader, Read, Seek};
use std::path::{Path, PathBuf};

use dataset::files::outside_file::{self, FileKind};
use dataset::geometry::geodesy::LatLon;

/// A table of airports; the whole world in `apt.dat` has 400 MB.
const AIRPORT_TABLE: FileKind = FileKind::new("table of airports", 4 << 30);
/// Bytes of a file that tell its kind, and the longest line.
const HEAD_BYTES: u64 = 4_096;
const MAX_LINE: u64 = 65_536;

/// One end of a runway.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct End {
    /// Its designator, e.g. `02L`.
    pub(super) name: String,
    /// The end of the pavement on the centreline.
    pub(super) place: LatLon,
    /// Distance of the landing threshold from there, metres.
    pub(super) displaced_m: f64,
    /// Height above mean sea level, metres.
    pub(super) elevation_m: Option<f64>,
}

/// A runway by one table, seen from the end where aircraft land.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Ends {
    /// The table.
    pub(super) source: &'static str,
    pub(super) near: End,
    pub(super) far: End,
    /// Its length as the table states it, metres.
    pub(super) stated_length_m: Option<f64>,
    /// Its width, metres.
    pub(super) width_m: Option<f64>,
}

/// A transmitter of the instrument landing system.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Aid {
    Localizer {
        place: LatLon,
        frequency_mhz: f64,
        /// As the table states it, degrees.
        course_magnetic_deg: Option<f64>,
    },
    GlidePath {
        place: LatLon,
        elevation_m: f64,
        angle_deg: f64,
    },
}

/// The content of files on one runway.
#[derive(Debug, Default)]
pub(super) struct Facts {
    pub(super) ends: Vec<Ends>,
    pub(super) aids: Vec<Aid>,
    /// Localizer of the opposite direction, which stands before this threshold.
    pub(super) opposite: Option<LatLon>,
    /// The runways of the airport that were seen, for a message.
    pub(super) seen: Vec<String>,
}

/// Reasons why a file says nothing.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// It cannot be opened.
    #[error(transparent)]
    Unusable(#[from] dataset::Error),
    /// It cannot be read.
    #[error("cannot read {}: {cause}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Cause.
        cause: io::Error,
    },
    /// Another kind of file.
    #[error(
        "{} is no table of runways: expected X-Plane's apt.dat or earth_nav.dat, or runways.csv of OurAirports",
        path.display()
    )]
    Unknown {
        /// The file.
        path: PathBuf,
    },
    /// A line that is not as its table says.
    #[error("{}:{line}: {why}", path.display())]
    BadLine {
        /// The file.
        path: PathBuf,
        /// Its number, from 1.
        line: u64,
        /// Expected and found.
        why: String,
    },
}

/// The airport and the runway that are looked for.
pub(super) struct Wanted<'a> {
    pub(super) airport: &'a str,
    pub(super) runway: &'a str,
}

impl Wanted<'_> {
    /// The same runway in the other direction: 20R for 02L.
    fn opposite(&self) -> Option<String> {
        let digits = self
            .runway
            .trim_end_matches(|letter: char| !letter.is_ascii_digit());
        let number: u32 = digits
            .parse()
            .ok()
            .filter(|number| (1..=36).contains(number))?;
        let side = match &self.runway[digits.len()..] {
            "L" => "R",
            "R" => "L",
            other => other,
        };
        Some(format!("{:02}{side}", (number + 17) % 36 + 1))
    }
}

impl Facts {
    /// Adds what a file says.
    pub(super) fn read(&mut self, path: &Path, wanted: &Wanted<'_>) -> Result<(), SourceError> {
        let unreadable = |cause| SourceError::Unreadable {
            path: path.to_owned(),
            cause,
        };
        let mut file = outside_file::open(path, AIRPORT_TABLE)?;
        let mut head = Vec::new();
        (&mut file)
            .take(HEAD_BYTES)
            .read_to_end(&mut head)
            .map_err(unreadable)?;
        file.rewind().map_err(unreadable)?;
        let head = String::from_utf8_lossy(&head);
        let lines = Lines {
            path,
            reader: BufReader::new(file),
            number: 0,
        };
        if our_airports::is_one(&head) {
            our_airports::read(lines, wanted, self)
        } else if apt_dat::is_one(&head) {
            apt_dat::read(lines, wanted, self)
        } else if earth_nav::is_one(&head) {
            earth_nav::read(lines, wanted, self)
        } else {
            Err(SourceError::Unknown {
                path: path.to_owned(),
            })
        }
    }
}

/// The lines of a file, with bounded memory.
struct Lines<'a, R> {
    path: &'a Path,
    reader: R,
    number: u64,
}

impl<R: BufRead> Lines<'_, R> {
    /// The next line, without bytes that are not UTF-8.
    fn next(&mut self) -> Result<Option<String>, SourceError> {
        let mut bytes = Vec::new();
        let length = (&mut self.reader)
            .take(MAX_LINE)
            .read_until(b'\n', &mut bytes)
            .map_err(|cause| SourceError::Unreadable {
                path: self.path.to_owned(),
                cause,
            })?;
        self.number += 1;
        if length as u64 == MAX_LINE {
            return Err(self.bad(format!("a line of more than {MAX_LINE} bytes")));
        }
        Ok((length > 0).then(|| String::from_utf8_lossy(&bytes).trim_end().to_owned()))
    }

    fn bad(&self, why: String) -> SourceError {
        SourceError::BadLine {
            path: self.path.to_owned(),
            line: self.number,
            why,
        }
    }

    /// A field as a number in a range.
    fn number(
        &self,
        what: &str,
        text: Option<&str>,
        range: std::ops::RangeInclusive<f64>,
    ) -> Result<f64, SourceError> {
        let text = text.unwrap_or_default();
        let number = text.parse().ok().filter(|number| range.contains(number));
        number.ok_or_else(|| {
            let (least, most) = (range.start(), range.end());
            self.bad(format!("{what} is {text:?}; expected {least} to {most}"))
        })
    }

    /// Latitude and longitude, degrees.
    fn place(
        &self,
        latitude: Option<&str>,
        longitude: Option<&str>,
    ) -> Result<LatLon, SourceError> {
        Ok(LatLon {
            latitude_deg: self.number("the latitude", latitude, -90.0..=90.0)?,
            longitude_deg: self.number("the longitude", longitude, -180.0..=180.0)?,
        })
    }
}
