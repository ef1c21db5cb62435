//! Published runway tables: ends (X-Plane's `apt.dat`, OurAirports) and landing aids (X-Plane's `earth_nav.dat`).
//!
//! Tables of the whole world are read line by line; file kinds follow from the content, never from the name.

mod apt_dat;
mod earth_nav;
mod our_airports;

use std::io::{BufRead, BufReader, Read, Seek};
use std::path::Path;

use dataset::files::outside_file::{self, FileKind};
use dataset::geometry::geodesy::LatLon;

/// A table of airports; the whole world in `apt.dat` has 400 MB.
const AIRPORT_TABLE: FileKind = FileKind::new("table of airports", 4 << 30);
/// Bytes that determine a file's kind, and the longest line.
const HEAD_BYTES: u64 = 4_096;
const MAX_LINE: u64 = 65_536;

#[derive(Debug, Clone, PartialEq)]
pub(super) struct End {
    pub(super) name: String,
    /// End of the pavement on the centreline.
    pub(super) place: LatLon,
    /// Distance to the landing threshold, metres.
    pub(super) displaced_m: f64,
    /// Height above mean sea level, metres.
    pub(super) elevation_m: Option<f64>,
}

/// Runway by one table, seen from the landing end.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Ends {
    pub(super) source: &'static str,
    pub(super) near: End,
    pub(super) far: End,
    pub(super) stated_length_m: Option<f64>,
    pub(super) width_m: Option<f64>,
}

/// A transmitter of the instrument landing system.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Aid {
    Localizer {
        place: LatLon,
        frequency_mhz: f64,
        course_magnetic_deg: Option<f64>,
    },
    GlidePath {
        place: LatLon,
        elevation_m: f64,
        angle_deg: f64,
    },
}

/// Facts about a runway, from all files.
#[derive(Debug, Default)]
pub(super) struct Facts {
    pub(super) ends: Vec<Ends>,
    pub(super) aids: Vec<Aid>,
    /// Localizer of the opposite direction, which stands before this threshold.
    pub(super) opposite: Option<LatLon>,
    /// Elevation of the airport.
    pub(super) field_elevation_m: Option<f64>,
    /// The runways of the airport that were seen, for a message.
    pub(super) seen: Vec<String>,
}

/// The airport and the runway that are looked for.
pub(super) struct Wanted<'a> {
    pub(super) airport: &'a str,
    pub(super) runway: &'a str,
}

impl Wanted<'_> {
    /// Designator of the opposite direction: 20R for 02L.
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
    /// Adds a file's facts.
    pub(super) fn read(&mut self, path: &Path, wanted: &Wanted<'_>) -> dataset::Result<()> {
        let mut file = outside_file::open(path, AIRPORT_TABLE)?;
        let mut head = Vec::new();
        (&mut file)
            .take(HEAD_BYTES)
            .read_to_end(&mut head)
            .map_err(dataset::Error::io("read", path))?;
        file.rewind().map_err(dataset::Error::io("read", path))?;
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
            Err(dataset::Error::corpus(
                path,
                "is no table of runways: expected X-Plane's apt.dat or earth_nav.dat, or runways.csv of OurAirports",
            ))
        }
    }
}

/// Line reader with bounded memory.
struct Lines<'a, R> {
    path: &'a Path,
    reader: R,
    number: u64,
}

impl<R: BufRead> Lines<'_, R> {
    /// The next line, without bytes that are not UTF-8.
    fn next(&mut self) -> dataset::Result<Option<String>> {
        let mut bytes = Vec::new();
        let length = (&mut self.reader)
            .take(MAX_LINE)
            .read_until(b'\n', &mut bytes)
            .map_err(dataset::Error::io("read", self.path))?;
        self.number += 1;
        if length as u64 == MAX_LINE {
            return Err(self.bad(&format!("a line of more than {MAX_LINE} bytes")));
        }
        Ok((length > 0).then(|| String::from_utf8_lossy(&bytes).trim_end().to_owned()))
    }

    fn bad(&self, why: &str) -> dataset::Error {
        let place = format!("{}:{}", self.path.display(), self.number);
        dataset::Error::corpus(Path::new(&place), why)
    }

    /// A field as a number in a range.
    fn number(
        &self,
        what: &str,
        text: Option<&str>,
        range: std::ops::RangeInclusive<f64>,
    ) -> dataset::Result<f64> {
        let text = text.unwrap_or_default();
        let number = text.parse().ok().filter(|number| range.contains(number));
        number.ok_or_else(|| {
            let (least, most) = (range.start(), range.end());
            self.bad(&format!("{what} is {text:?}; expected {least} to {most}"))
        })
    }

    fn place(&self, latitude: Option<&str>, longitude: Option<&str>) -> dataset::Result<LatLon> {
        Ok(LatLon {
            latitude_deg: self.number("the latitude", latitude, -90.0..=90.0)?,
            longitude_deg: self.number("the longitude", longitude, -180.0..=180.0)?,
        })
    }
}
