//! `PREL`: starts a flight. The order on the wire is latitude, longitude: the reverse of `RPOS`.

use serde::{Deserialize, Serialize};

use super::PacketError;
use super::body::{Fields, push_text, start, text};

/// `PREL` to the simulator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaceAtStart {
    /// Kind of start; 6 is at the given position.
    pub start_type: i32,
    /// Index of the aircraft; 0 is the user's.
    pub plane: i32,
    /// ICAO code, at most seven characters.
    pub airport: String,
    /// Index of the runway at the airport.
    pub runway: i32,
    /// End of the runway, 0 or 1.
    pub runway_end: i32,
    /// Latitude, degrees.
    pub latitude_deg: f64,
    /// Longitude, degrees.
    pub longitude_deg: f64,
    /// Height above mean sea level, metres.
    pub elevation_msl_m: f64,
    /// Heading, degrees true.
    pub heading_true_deg: f64,
    /// Speed, metres per second.
    pub speed_mps: f64,
}

impl PlaceAtStart {
    pub(super) fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        let mut fields = Fields::new("PREL", datagram);
        Ok(Self {
            start_type: fields.i32("kind of start")?,
            plane: fields.i32("plane")?,
            airport: text("PREL", "airport", &fields.array::<8>("airport")?)?,
            runway: fields.i32("runway")?,
            runway_end: fields.i32("runway end")?,
            latitude_deg: fields.f64("latitude")?,
            longitude_deg: fields.f64("longitude")?,
            elevation_msl_m: fields.f64("elevation")?,
            heading_true_deg: fields.f64("heading")?,
            speed_mps: fields.f64("speed")?,
        })
    }

    pub(super) fn encode(&self) -> Result<Vec<u8>, PacketError> {
        let mut datagram = start(b"PREL", 64);
        datagram.extend(self.start_type.to_le_bytes());
        datagram.extend(self.plane.to_le_bytes());
        push_text(&mut datagram, "PREL", "airport", &self.airport, 8)?;
        datagram.extend(self.runway.to_le_bytes());
        datagram.extend(self.runway_end.to_le_bytes());
        for value in [
            self.latitude_deg,
            self.longitude_deg,
            self.elevation_msl_m,
            self.heading_true_deg,
            self.speed_mps,
        ] {
            datagram.extend(value.to_le_bytes());
        }
        Ok(datagram)
    }
}
