//! One simulator of a run: found or started, reconnected for every scenario, waited for when it is gone.

use std::fmt;
use std::io;
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use tokio::time::{Instant, sleep};
use xplane_bridge::discovery::{DISCOVERY_TIMEOUT, the_announced};
use xplane_bridge::profile::KnownProfile;
use xplane_bridge::{CONNECT_TIMEOUT, ConnectOptions, LocalUdp, Simulator};
use xplane_tape::{TapeError, TapeReader};

use super::error::ScenarioError;
use super::pictures::Pictures;
use crate::stand_in::{StandIn, StandInError, StandInTask};

/// More stand-ins than this on one machine are a typo.
pub(super) const MOST_STAND_INS: usize = 64;

/// Which simulator to use.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SimulatorTarget {
    /// Our own, started for this run.
    StandIn,
    /// The same, with all awkward habits of a live X-Plane.
    AwkwardStandIn,
    /// A running one that receives UDP packets there.
    Address(SocketAddr),
    /// The one that announces itself by X-Plane's beacon.
    Announced,
    /// A session recorded with `dtd record`, replayed for this run.
    Tape(PathBuf),
}

impl SimulatorTarget {
    /// Whether it runs independently of this run, on whatever computer.
    pub(super) fn runs_already(&self) -> bool {
        matches!(self, Self::Address(_) | Self::Announced)
    }
}

/// Why a text names no simulator.
#[derive(Debug, thiserror::Error)]
pub enum BadSimulator {
    /// A number of stand-ins that is none, or too large.
    #[error("{text:?}: expected mock:awkward, or mock:N with N from 1 to {MOST_STAND_INS}")]
    StandIns {
        /// The text.
        text: String,
    },
    /// One simulator for two workers.
    #[error("{text} is named twice; a simulator makes one scenario at a time")]
    Twice {
        /// The text.
        text: String,
    },
    /// The tape cannot be read.
    #[error(transparent)]
    Tape(#[from] TapeError),
    /// Not a target, and no host of this name is known.
    #[error("no simulator address: {text:?}: {cause}; {EXPECTED}")]
    Unresolved {
        /// The text.
        text: String,
        /// Why not.
        cause: io::Error,
    },
    /// A host without addresses.
    #[error("no simulator address: {text:?} has no address; {EXPECTED}")]
    NoAddress {
        /// The text.
        text: String,
    },
}

const EXPECTED: &str =
    "expected `mock`, `mock:awkward`, `auto`, HOST:PORT, e.g. 127.0.0.1:49000, or tape:FILE";

impl FromStr for SimulatorTarget {
    type Err = BadSimulator;

    fn from_str(text: &str) -> Result<Self, BadSimulator> {
        if text == "mock" {
            return Ok(Self::StandIn);
        }
        if text == AWKWARD {
            return Ok(Self::AwkwardStandIn);
        }
        if text == "auto" {
            return Ok(Self::Announced);
        }
        if let Some(tape) = text.strip_prefix("tape:") {
            TapeReader::open(Path::new(tape))?;
            return Ok(Self::Tape(tape.into()));
        }
        let mut found = text
            .to_socket_addrs()
            .map_err(|cause| BadSimulator::Unresolved {
                text: text.to_owned(),
                cause,
            })?;
        // X-Plane listens on IPv4.
        let first = found.next();
        found
            .find(SocketAddr::is_ipv4)
            .filter(|_| first.is_none_or(|a| a.is_ipv6()))
            .or(first)
            .map(Self::Address)
            .ok_or_else(|| BadSimulator::NoAddress {
                text: text.to_owned(),
            })
    }
}

impl fmt::Display for SimulatorTarget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::StandIn => f.write_str("stand-in"),
            Self::AwkwardStandIn => f.write_str("awkward stand-in"),
            Self::Announced => f.write_str("auto"),
            Self::Address(address) => address.fmt(f),
            Self::Tape(tape) => write!(f, "tape {}", tape.display()),
        }
    }
}

/// The stand-in with all awkward habits, as the user names it.
pub(super) const AWKWARD: &str = "mock:awkward";
/// Retry interval for a simulator that is gone.
const POLL_INTERVAL: Duration = Duration::from_secs(1);

pub(super) struct Session {
    target: SimulatorTarget,
    /// Its name in messages.
    name: String,
    program: PathBuf,
    pictures: Pictures,
    local_udp: LocalUdp,
    stand_in: Option<StandIn>,
    /// An unused connection; the next scenario uses it.
    ready: Option<Simulator>,
    /// The known profile, which was reported.
    known: Option<KnownProfile>,
}

impl Session {
    /// The session of the simulator with this number, counted from 0; nothing is started or connected yet.
    pub(super) fn new(
        target: &SimulatorTarget,
        number: usize,
        program: &Path,
        pictures: &Pictures,
        local_udp: LocalUdp,
    ) -> Self {
        let name = match target {
            SimulatorTarget::StandIn | SimulatorTarget::AwkwardStandIn => {
                format!("{target} {}", number + 1)
            }
            other => other.to_string(),
        };
        Self {
            target: target.clone(),
            name,
            program: program.to_owned(),
            pictures: pictures.clone(),
            local_udp,
            stand_in: None,
            ready: None,
            known: None,
        }
    }

    /// What is known about a simulator behind a plugin, if that was not reported yet. The next connection knows it, too.
    pub(super) fn news_of(&mut self, simulator: &Simulator) -> Option<KnownProfile> {
        let known = &simulator.description().profile;
        if simulator.description().plugin.is_none() || self.known.as_ref() == Some(known) {
            return None;
        }
        self.known = Some(known.clone());
        self.known.clone()
    }

    /// The simulator's name in messages.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// The tape that acts as the simulator, if any.
    pub(super) fn tape(&self) -> Option<&Path> {
        match &self.target {
            SimulatorTarget::Tape(tape) => Some(tape),
            _ => None,
        }
    }

    /// Finds or starts the simulator and connects to it.
    pub(super) async fn open(&mut self) -> Result<(), ScenarioError> {
        let ready = self.connect().await?;
        self.ready = Some(ready);
        Ok(())
    }

    /// An unused connection. A stand-in that died is restarted.
    pub(super) async fn connect(&mut self) -> Result<Simulator, ScenarioError> {
        if let Some(ready) = self.ready.take() {
            return Ok(ready);
        }
        let simulator = match (self.connect_to_target().await, &self.target) {
            (Err(error), SimulatorTarget::Tape(tape)) => {
                return Err(ScenarioError::Tape {
                    tape: tape.clone(),
                    cause: Box::new(error),
                });
            }
            (connected, _) => connected?,
        };
        let mut simulator = self.pictures.set_up(simulator).await?;
        if let Some(known) = &self.known {
            simulator.use_profile(known.clone());
        }
        Ok(simulator)
    }

    async fn connect_to_target(&mut self) -> Result<Simulator, ScenarioError> {
        let address = match &self.target {
            SimulatorTarget::Address(address) => *address,
            // Looked up each time: a restarted one may have another address.
            SimulatorTarget::Announced => {
                the_announced(DISCOVERY_TIMEOUT, &self.local_udp)
                    .await?
                    .address
            }
            SimulatorTarget::StandIn
            | SimulatorTarget::AwkwardStandIn
            | SimulatorTarget::Tape(_) => self.own_address().await?,
        };
        let options = ConnectOptions {
            local_udp: self.local_udp.clone(),
            ..ConnectOptions::from_environment(address)?
        };
        Ok(Simulator::connect_with(address, CONNECT_TIMEOUT, options).await?)
    }

    /// The address of our own process that acts as the simulator, or replays a tape.
    async fn own_address(&mut self) -> Result<SocketAddr, StandInError> {
        if let Some(stand_in) = &mut self.stand_in
            && stand_in.is_running()
        {
            return Ok(stand_in.address());
        }
        let task = match (&self.target, self.pictures.window_px()) {
            (SimulatorTarget::Tape(tape), _) => StandInTask::Play(tape),
            (SimulatorTarget::AwkwardStandIn, _) => StandInTask::BeAwkward,
            (_, Some(picture_px)) => StandInTask::Show(picture_px),
            (_, None) => StandInTask::Simulate,
        };
        let fresh = StandIn::start(&self.program, task).await?;
        Ok(self.stand_in.insert(fresh).address())
    }

    /// Waits up to `limit` for an answer of the simulator; returns whether it came. Our own stand-in is restarted, since its last
    /// behaviour was wrong.
    pub(super) async fn come_back(&mut self, limit: Duration) -> bool {
        self.ready = None;
        if let Some(stand_in) = self.stand_in.take() {
            stand_in.stop().await;
        }
        let until = Instant::now() + limit;
        loop {
            match self.open().await {
                Ok(()) => return true,
                Err(error) => tracing::debug!(simulator = self.name, %error, "still away"),
            }
            if Instant::now() >= until {
                return false;
            }
            sleep(POLL_INTERVAL.min(limit)).await;
        }
    }

    /// Disconnects.
    pub(super) async fn close(self) {
        if let Some(ready) = self.ready
            && let Err(error) = ready.release().await
        {
            tracing::warn!(%error, "the simulator did not confirm its release");
        }
        if let Some(stand_in) = self.stand_in {
            stand_in.stop().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn target(text: &str) -> SimulatorTarget {
        text.parse().unwrap()
    }

    #[test]
    fn a_tape_is_a_target_if_there_is_one() {
        let lost = "tape:no/such.mcap".parse::<SimulatorTarget>();
        let lost = lost.unwrap_err().to_string();
        assert!(lost.contains("no/such.mcap"), "{lost}");
        let stored = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../tests/data/tape/session.mcap"
        );
        assert_eq!(
            target(&format!("tape:{stored}")),
            SimulatorTarget::Tape(stored.into())
        );
        let sweep = concat!(env!("CARGO_MANIFEST_DIR"), "/../demo.toml");
        let none = format!("tape:{sweep}").parse::<SimulatorTarget>();
        assert!(none.unwrap_err().to_string().contains("not a tape"));
    }

    #[test]
    fn targets_are_read_and_wrong_ones_explained() {
        assert_eq!(target("mock"), SimulatorTarget::StandIn);
        assert_eq!(target(AWKWARD), SimulatorTarget::AwkwardStandIn);
        assert_eq!(target("auto"), SimulatorTarget::Announced);
        assert_eq!(
            target("127.0.0.1:49000"),
            SimulatorTarget::Address(([127, 0, 0, 1], 49_000).into())
        );
        for wrong in ["", "mok", "127.0.0.1", "127.0.0.1:99999"] {
            assert!(
                wrong
                    .parse::<SimulatorTarget>()
                    .unwrap_err()
                    .to_string()
                    .contains("HOST:PORT"),
                "{wrong}"
            );
        }
    }
}
