//! Files of tracks: tables of `traffic`, OpenSky, Flightradar24 and others, `trace_full` of readsb (JSON), JSON lines of `jet1090`, and
//! X-Plane's data output; all may be compressed with gzip.

mod jet1090;
mod readsb;
mod tables;
mod x_plane;

use std::collections::BTreeMap;
use std::io::{self, BufRead, BufReader, Read, Take};
use std::path::Path;

use dataset::files::outside_file::{self, FileKind};
use dataset::geometry::geodesy::LatLon;
use dataset::geometry::runway::Runway;
use flate2::bufread::MultiGzDecoder;

pub use tables::{NamedColumn, separator, utc_s};

/// The largest file that is read.
const TRACKS: FileKind = FileKind::new("file of tracks", 1 << 40);
/// Maximum size of a JSON document, which is read whole.
const MAX_DOCUMENT_BYTES: u64 = 256 << 20;
/// Positions further from the runway are not kept, metres.
pub(super) const NEAR_M: f64 = 150_000.0;
/// Beginnings of compressed files and of Parquet tables.
const GZIP: &[u8] = &[0x1f, 0x8b];
const PARQUET: &[u8] = b"PAR1";
/// Maximum ratio of the size of an uncompressed file: tracks shrink to a tenth.
const MAX_EXPANSION: u64 = 100;

/// Receiver's report.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Fix {
    pub(super) time_s: f64,
    pub(super) latitude_deg: f64,
    pub(super) longitude_deg: f64,
    /// Altitude above any datum, by pressure: it is tied to the runway later.
    pub(super) altitude_m: Option<f64>,
    /// Altitude above any datum, by satellite navigation.
    pub(super) geometric_m: Option<f64>,
    pub(super) ground_speed_mps: Option<f64>,
    pub(super) track_deg: Option<f64>,
    pub(super) on_ground: bool,
    pub(super) attitude: Option<Attitude>,
    /// Roll that is reported alone, right wing down positive.
    pub(super) roll_deg: Option<f64>,
    /// True for a simulator's fix: position and altitude above mean sea level are exact.
    pub(super) is_simulated: bool,
}

impl Fix {
    pub(super) fn place(&self) -> LatLon {
        LatLon {
            latitude_deg: self.latitude_deg,
            longitude_deg: self.longitude_deg,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Attitude {
    pub(super) pitch_deg: f64,
    pub(super) roll_deg: f64,
    pub(super) heading_true_deg: Option<f64>,
}

/// An aircraft's fixes in order of time.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Track {
    pub(super) aircraft: Option<String>,
    pub(super) fixes: Vec<Fix>,
    /// Positions that were left out since they come from multilateration or radar.
    pub(super) coarse: usize,
}

/// Reads a file; a table may hold a continent's traffic, so only fixes near the runway are kept.
pub(super) fn read(
    path: &Path,
    named: &[NamedColumn],
    runway: &Runway,
) -> dataset::Result<Vec<Track>> {
    let unreadable = |error| dataset::Error::io("read", path)(error);
    let opened = outside_file::open(path, TRACKS)?;
    let bytes = opened.metadata().map_err(unreadable)?.len();
    let mut plain = BufReader::new(opened);
    let head = plain.fill_buf().map_err(unreadable)?;
    let target = runway.touchdown_target().lat_lon();
    let mut tracks = if head.starts_with(PARQUET) {
        tables::parquet(path, named, target)?
    } else {
        let read = if head.starts_with(GZIP) {
            let most_bytes = bytes.saturating_mul(MAX_EXPANSION);
            let unpacked = Bounded::of(MultiGzDecoder::new(plain), most_bytes);
            text(BufReader::new(unpacked), named, target)
        } else {
            text(plain, named, target)
        };
        read.map_err(|why| dataset::Error::corpus(path, why))?
    };
    for track in &mut tracks {
        track.fixes.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        // Receivers repeat the last position until there is a new one.
        track.fixes.dedup_by(|next, before| {
            next.time_s <= before.time_s || next.place() == before.place()
        });
    }
    Ok(tracks)
}

/// A reader that fails beyond a number of bytes: a shortened table would look like a whole one.
struct Bounded<R>(Take<R>);

impl<R: Read> Bounded<R> {
    fn of(reader: R, most_bytes: u64) -> Self {
        Self(reader.take(most_bytes.saturating_add(1)))
    }
}

impl<R: Read> Read for Bounded<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let bytes = self.0.read(buffer)?;
        if self.0.limit() == 0 {
            return Err(io::Error::other(
                "its content is larger than tracks are; divide it, or unpack it first",
            ));
        }
        Ok(bytes)
    }
}

/// The tracks in a file that is not a Parquet table; the error is the reason why there are none.
fn text<R: BufRead>(
    mut file: R,
    named: &[NamedColumn],
    target: LatLon,
) -> Result<Vec<Track>, String> {
    let head = file.fill_buf().map_err(|error| error.to_string())?.to_vec();
    if jet1090::is_one(&head) {
        return jet1090::read(file, target);
    }
    if x_plane::is_data_txt(&head) {
        return x_plane::data_txt(file, target);
    }
    match head.iter().find(|byte| !byte.is_ascii_whitespace()) {
        Some(b'{') => {
            let mut document = Vec::new();
            let read = Bounded::of(file, MAX_DOCUMENT_BYTES).read_to_end(&mut document);
            read.map_err(|error| error.to_string())?;
            let trace = serde_json::from_slice(&document).map_err(|error| error.to_string())?;
            let track = readsb::trace_full(&trace);
            track
                .map(|track| vec![track])
                .ok_or_else(|| "no `timestamp` and `trace` as in trace_full of readsb".into())
        }
        Some(b'[') => Err(
            "a JSON list; expected a table, trace_full of readsb or JSON lines of jet1090".into(),
        ),
        _ => tables::csv(&head, file, named, target),
    }
}

/// Fixes kept while a file is read.
#[derive(Default)]
struct NearFixes {
    fixes: Vec<Fix>,
    /// Nearest fix far from the runway, and its distance, metres.
    nearest: Option<(f64, Fix)>,
}

impl NearFixes {
    fn add(&mut self, fix: Fix, target: LatLon) {
        // Receivers repeat the last position until there is a new one.
        let is_repeated = self
            .fixes
            .last()
            .is_some_and(|last| last.time_s <= fix.time_s && last.place() == fix.place());
        if is_repeated {
            return;
        }
        let far_m = target.distance_m(fix.place());
        if far_m < NEAR_M {
            self.fixes.push(fix);
        } else if self.nearest.is_none_or(|(nearest_m, _)| far_m < nearest_m) {
            self.nearest = Some((far_m, fix));
        }
    }

    /// An aircraft that was never near has only its nearest position, for the message.
    fn fixes(self) -> Vec<Fix> {
        match self.nearest {
            Some((_, fix)) if self.fixes.is_empty() => vec![fix],
            _ => self.fixes,
        }
    }
}

fn tracks_of(kept: BTreeMap<String, NearFixes>) -> Vec<Track> {
    let track = |(name, kept): (String, NearFixes)| Track {
        aircraft: (!name.is_empty()).then_some(name),
        fixes: kept.fixes(),
        coarse: 0,
    };
    kept.into_iter().map(track).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_content_than_a_bound_is_an_error_and_not_a_shorter_table() {
        let read = |most_bytes: u64| {
            let mut text = String::new();
            let read = Bounded::of(&b"time,lat"[..], most_bytes).read_to_string(&mut text);
            read.map(|_| text).map_err(|error| error.to_string())
        };
        assert_eq!(read(8).unwrap(), "time,lat");
        let said = read(7).unwrap_err();
        assert!(said.contains("larger than tracks are"), "{said}");
    }

    #[test]
    fn a_json_list_is_named_as_one() {
        let changi = LatLon {
            latitude_deg: 1.36,
            longitude_deg: 103.99,
        };
        let list = br#"[{"lat": 1.3, "lon": 103.9}]"#;
        let said = text(&list[..], &[], changi).err().unwrap();
        assert!(said.starts_with("a JSON list; expected"), "{said}");
    }
}
