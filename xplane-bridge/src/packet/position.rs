//! `RPOS`: the aircraft's position at a requested rate, with 64-bit coordinates.
//!
//! The order on the wire is longitude, latitude (not the other way round) and pitch, heading, roll.

use serde::{Deserialize, Serialize};

use super::body::{Fields, start, text};
use super::{PacketError, bad_field};

const TAG: &str = "RPOS";

/// `RPOS` to the simulator. One such subscription exists per client.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SubscribePosition {
    /// Rate in 1/s; 0 ends the subscription.
    pub frequency_hz: u32,
}

impl SubscribePosition {
    pub(super) fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        let text = text(TAG, "frequency", Fields::new(TAG, datagram).rest())?;
        match text.trim().parse() {
            Ok(frequency_hz) => Ok(Self { frequency_hz }),
            Err(_) => {
                let expected = "a whole number in decimal characters";
                Err(bad_field(TAG, "frequency", expected, format!("{text:?}")))
            }
        }
    }

    pub(super) fn encode(&self) -> Vec<u8> {
        let digits = self.frequency_hz.to_string();
        let mut datagram = start(b"RPOS", digits.len() + 1);
        datagram.extend(digits.as_bytes());
        datagram.push(0);
        datagram
    }
}

/// `RPOS` from the simulator.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Position {
    /// Longitude, degrees.
    pub longitude_deg: f64,
    /// Latitude, degrees.
    pub latitude_deg: f64,
    /// Height above mean sea level, metres.
    pub elevation_msl_m: f64,
    /// Height above the ground below, metres.
    pub height_agl_m: f32,
    /// Pitch, degrees, nose up positive.
    pub pitch_deg: f32,
    /// Heading, degrees true.
    pub heading_true_deg: f32,
    /// Roll, degrees, right wing down positive.
    pub roll_deg: f32,
    /// Velocity over ground: east, metres per second.
    pub velocity_east_mps: f32,
    /// Velocity over ground: up, metres per second.
    pub velocity_up_mps: f32,
    /// Velocity over ground: south, metres per second.
    pub velocity_south_mps: f32,
    /// Roll rate, radians per second (the datarefs P, Q, R are in degrees per second).
    pub roll_rate_rad_s: f32,
    /// Pitch rate, radians per second.
    pub pitch_rate_rad_s: f32,
    /// Yaw rate, radians per second.
    pub yaw_rate_rad_s: f32,
}

impl Position {
    /// Returns true if every number is finite.
    pub fn is_finite(&self) -> bool {
        self.place().iter().all(|number| number.is_finite())
            && self.motion().iter().all(|number| number.is_finite())
    }

    /// The 64-bit numbers in the order of the datagram.
    fn place(&self) -> [f64; 3] {
        [self.longitude_deg, self.latitude_deg, self.elevation_msl_m]
    }

    /// The 32-bit numbers in the order of the datagram.
    fn motion(&self) -> [f32; 10] {
        [
            self.height_agl_m,
            self.pitch_deg,
            self.heading_true_deg,
            self.roll_deg,
            self.velocity_east_mps,
            self.velocity_up_mps,
            self.velocity_south_mps,
            self.roll_rate_rad_s,
            self.pitch_rate_rad_s,
            self.yaw_rate_rad_s,
        ]
    }

    pub(super) fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        let mut fields = Fields::new(TAG, datagram);
        Ok(Self {
            longitude_deg: fields.f64("longitude")?,
            latitude_deg: fields.f64("latitude")?,
            elevation_msl_m: fields.f64("elevation")?,
            height_agl_m: fields.f32("height above ground")?,
            pitch_deg: fields.f32("pitch")?,
            heading_true_deg: fields.f32("heading")?,
            roll_deg: fields.f32("roll")?,
            velocity_east_mps: fields.f32("velocity east")?,
            velocity_up_mps: fields.f32("velocity up")?,
            velocity_south_mps: fields.f32("velocity south")?,
            roll_rate_rad_s: fields.f32("roll rate")?,
            pitch_rate_rad_s: fields.f32("pitch rate")?,
            yaw_rate_rad_s: fields.f32("yaw rate")?,
        })
    }

    pub(super) fn encode(&self) -> Vec<u8> {
        let mut datagram = start(b"RPOS", 64);
        for coordinate in self.place() {
            datagram.extend(coordinate.to_le_bytes());
        }
        for value in self.motion() {
            datagram.extend(value.to_le_bytes());
        }
        datagram
    }
}
