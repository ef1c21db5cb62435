//! Checks over UDP: version, capture link, writing, menus, position.

pub(crate) mod announcement;
pub(crate) mod web;

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use dataset::conditions::Clock;

use super::{Check, DoctorOptions};
use crate::datarefs::{
    CAPTURE_PORT, COMMAND_PAUSE_OFF, COMMAND_PAUSE_ON, DATE_DAYS, DatarefWrite, FLIGHT_TIME_S,
    NAV1_COURSE_MAGNETIC, PAUSED, VERSION, Version, ZULU_TIME_S,
};
use crate::error::{BridgeError, Silence};
use crate::udp::socket::SimulatorSocket;

/// Oldest version on which XPPython3 runs: 11.52.
const OLDEST: f32 = 115_200.0;

/// Position of the aircraft and height of the ground below it, from the datarefs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PlaceOnGround {
    pub(super) latitude_deg: f64,
    pub(super) longitude_deg: f64,
    pub(super) altitude_msl_m: f64,
    pub(super) ground_msl_m: f64,
}

/// A conversation over UDP.
pub(super) struct Talk {
    udp: Arc<SimulatorSocket>,
    wait: Duration,
}

impl Talk {
    pub(super) async fn begin(
        address: SocketAddr,
        options: &DoctorOptions,
    ) -> Result<Self, BridgeError> {
        Ok(Self {
            udp: SimulatorSocket::open(address, &options.local_udp).await?,
            wait: options.wait,
        })
    }

    pub(super) async fn end(self) {
        self.udp.close().await;
    }

    /// All values, as far as they arrive; none if the socket fails, which is equivalent for a reader.
    pub(super) async fn read(&mut self, names: &[&str]) -> Vec<Option<f32>> {
        let read = self.udp.read_all(names, self.wait).await;
        read.unwrap_or_else(|_| vec![None; names.len()])
    }

    /// Reads a value until it is as expected; returns the last one.
    pub(super) async fn read_expecting(
        &mut self,
        name: &str,
        expected: impl Fn(f32) -> bool,
    ) -> Option<f32> {
        let read = self.udp.read_one(name, self.wait, expected).await;
        read.ok().flatten()
    }

    pub(super) async fn version(&mut self) -> Result<f32, Silence> {
        match self.udp.read_one(VERSION, self.wait, |_| true).await {
            Ok(version) => version.ok_or(Silence::Nothing),
            Err(BridgeError::NobodyAnswers { silence, .. }) => Err(silence),
            Err(_) => Err(Silence::Nothing),
        }
    }

    /// Port of the capture link, if there is one.
    pub(super) async fn capture_port(&mut self) -> Option<u16> {
        let port = self.read(&[CAPTURE_PORT]).await[0]?;
        (1.0..=f32::from(u16::MAX))
            .contains(&port)
            .then_some(port as u16)
    }

    /// Turns the course of the first receiver by a degree and back.
    pub(super) async fn writable(&mut self) -> Check {
        const NAME: &str = "datarefs writable";
        let Some(before) = self.read(&[NAV1_COURSE_MAGNETIC]).await[0] else {
            return Check::skipped(NAME, format!("{NAV1_COURSE_MAGNETIC} could not be read"));
        };
        let turned = DatarefWrite::new(NAV1_COURSE_MAGNETIC, f64::from((before + 1.0) % 360.0));
        let restored = DatarefWrite::new(NAV1_COURSE_MAGNETIC, f64::from(before));
        for (write, doing) in [(turned, "written"), (restored, "put back")] {
            let send =
                async |udp: &SimulatorSocket| udp.write([(write.name.as_str(), write.value)]).await;
            let is_met = |value| write.is_met_by(value);
            if let Err(found) = self.send_until(send, &write.name, is_met).await {
                let found = format!(
                    "{} was {doing} as {}, and reads {found:?}",
                    write.name, write.value
                );
                return Check::failed(
                    NAME,
                    found,
                    "Does another plugin hold it? Are packets to the simulator filtered by length?",
                );
            }
        }
        Check::ok(
            NAME,
            format!(
                "{NAV1_COURSE_MAGNETIC} took {} and {before} again",
                (before + 1.0) % 360.0
            ),
        )
    }

    /// Behind a menu or a dialog X-Plane answers, but its time stands still, also without a pause.
    pub(super) async fn menus(&mut self) -> Check {
        const NAME: &str = "menus";
        let was_paused = self.read(&[PAUSED]).await[0].is_some_and(|value| value != 0.0);
        if was_paused && !self.set_pause(false).await {
            // The commands may still be obeyed, late.
            self.set_pause(true).await;
            return Check::failed(
                NAME,
                format!(
                    "X-Plane is paused, and {COMMAND_PAUSE_OFF} has no effect: whether a menu is open cannot be seen"
                ),
                "Resume it in X-Plane (P). Does a dialog or another plugin hold the pause?",
            );
        }
        let before_s = self.read(&[FLIGHT_TIME_S]).await[0];
        let moves = |now_s: f32| before_s.is_some_and(|before_s| now_s > before_s);
        let now_s = self.read_expecting(FLIGHT_TIME_S, moves).await;
        if was_paused {
            self.set_pause(true).await;
        }
        match (before_s, now_s) {
            (Some(_), Some(now_s)) if moves(now_s) => {
                Check::ok(NAME, "simulated time runs: none is open")
            }
            (Some(before_s), Some(_)) => Check::failed(
                NAME,
                format!(
                    "{FLIGHT_TIME_S} stays at {before_s}: a menu or a dialog is open, or no flight is loaded"
                ),
                "Close it in X-Plane (Escape), or start a flight",
            ),
            _ => Check::skipped(NAME, format!("{FLIGHT_TIME_S} could not be read")),
        }
    }

    /// Pauses or resumes; returns true if the simulator took it.
    async fn set_pause(&mut self, paused: bool) -> bool {
        let command = if paused {
            COMMAND_PAUSE_ON
        } else {
            COMMAND_PAUSE_OFF
        };
        let is_so = |value: f32| (value != 0.0) == paused;
        let send = async |udp: &SimulatorSocket| udp.command(command).await;
        self.send_until(send, PAUSED, is_so).await.is_ok()
    }

    /// Sends something, which may be lost, until a dataref shows its effect; the error is its last value.
    async fn send_until(
        &mut self,
        send: impl AsyncFn(&SimulatorSocket) -> Result<(), BridgeError>,
        name: &str,
        shows: impl Fn(f32) -> bool,
    ) -> Result<(), Option<f32>> {
        let mut found = None;
        for _ in 0..3 {
            let _ = send(&self.udp).await;
            found = self.read_expecting(name, &shows).await;
            if found.is_some_and(&shows) {
                return Ok(());
            }
        }
        Err(found)
    }

    /// The simulator's clock.
    pub(super) async fn clock(&mut self) -> Option<Clock> {
        let values = self.read(&[DATE_DAYS, ZULU_TIME_S]).await;
        let [Some(days), Some(zulu_time_s)] = values[..] else {
            return None;
        };
        Some(Clock {
            day_of_year: days as u32 + 1,
            zulu_time_s: zulu_time_s.into(),
        })
    }

    pub(super) async fn place(&mut self) -> Option<PlaceOnGround> {
        let names = [
            "sim/flightmodel/position/latitude",
            "sim/flightmodel/position/longitude",
            "sim/flightmodel/position/elevation",
            "sim/flightmodel/position/y_agl",
        ];
        let values: Option<Vec<f32>> = self.read(&names).await.into_iter().collect();
        let [latitude, longitude, altitude, above_ground] = values?[..] else {
            return None;
        };
        Some(PlaceOnGround {
            latitude_deg: latitude.into(),
            longitude_deg: longitude.into(),
            altitude_msl_m: altitude.into(),
            ground_msl_m: f64::from(altitude) - f64::from(above_ground),
        })
    }
}

pub(super) fn version_check(version: f32) -> Check {
    const NAME: &str = "version";
    let found = format!(
        "X-Plane {}, internal version {version}",
        Version::of_number(version as u32)
    );
    if version >= OLDEST {
        Check::ok(NAME, found)
    } else {
        Check::failed(NAME, found, "XPPython3 needs 11.52 or newer")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulator::doctor::Verdict;

    #[test]
    fn versions_are_told_apart() {
        assert!(version_check(124_009.0).found.contains("X-Plane 12.4.0,"));
        let eleven = version_check(115_501.0);
        assert!(eleven.found.contains("X-Plane 11.55,") && eleven.verdict == Verdict::Ok);
        assert_eq!(version_check(105_000.0).verdict, Verdict::Failed);
    }
}
