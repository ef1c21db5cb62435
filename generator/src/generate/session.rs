//! A run's simulator: found or started, reconnected for every scenario, waited for when it is gone.

pub(super) mod followed;
pub(crate) mod restart;
pub(crate) mod simulators;
mod starting;

use std::fmt;
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use dataset::corpus::scenario::Graphics;
use tokio::time::{Instant, sleep};
use xplane_bridge::profile::{KnownProfile, RecordedPace};
use xplane_bridge::udp::discovery::{DISCOVERY_TIMEOUT, the_announced};
use xplane_bridge::{
    BridgeError, CONNECT_TIMEOUT, ConnectOptions, KnownBlocks, LocalUdp, Simulator,
};
use xplane_tape::{TapeError, TapeReader};

use super::error::ScenarioError;
use super::record::image_source::ImageSource;
use crate::generate::stand_in::{StandIn, StandInError, StandInTask};
use followed::Followed;

/// Maximum number of stand-ins on one machine: more are a typo.
pub(super) const MAX_STAND_INS: usize = 64;

/// Simulator to use.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SimulatorTarget {
    /// Our own, started for this run.
    StandIn,
    /// Our own, with all awkward habits of live X-Planes.
    AwkwardStandIn,
    /// A running one that receives UDP packets there.
    Address(SocketAddr),
    /// The one that announces itself by X-Plane's beacon.
    Announced,
    /// A session recorded with `dtd tape`, replayed for this run.
    Tape(PathBuf),
}

impl SimulatorTarget {
    /// True if it runs independently of this run, on any computer.
    pub(super) fn runs_already(&self) -> bool {
        matches!(self, Self::Address(_) | Self::Announced)
    }
}

/// Reasons why a text does not name a simulator.
#[derive(Debug, thiserror::Error)]
pub enum BadSimulator {
    /// The text is wrong.
    #[error("{0}")]
    BadText(String),
    /// The tape cannot be read.
    #[error(transparent)]
    Tape(#[from] TapeError),
}

impl BadSimulator {
    fn no_address(what: fmt::Arguments<'_>) -> Self {
        Self::BadText(format!(
            "no simulator address: {what}; expected `mock`, `mock:awkward`, `auto`, HOST:PORT, e.g. 127.0.0.1:49000, or tape:FILE"
        ))
    }
}

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
            .map_err(|cause| BadSimulator::no_address(format_args!("{text:?}: {cause}")))?;
        // X-Plane listens on IPv4.
        let first = found.next();
        found
            .find(SocketAddr::is_ipv4)
            .filter(|_| first.is_none_or(|a| a.is_ipv6()))
            .or(first)
            .map(Self::Address)
            .ok_or_else(|| BadSimulator::no_address(format_args!("{text:?} has no address")))
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
    name: String,
    program: PathBuf,
    pictures: ImageSource,
    local_udp: LocalUdp,
    stand_in: Option<StandIn>,
    /// An unused connection; the next scenario uses it.
    ready: Option<Simulator>,
    /// The known profile, which was reported.
    known: Option<KnownProfile>,
    /// Known block properties, for the next connection.
    pub(super) known_blocks: KnownBlocks,
    /// The scenario that was recorded last, and what drew it.
    pub(super) drawn_with: Option<(String, Graphics)>,
    /// Versions of simulator and plugin in this run.
    versions: Option<String>,
    /// Live flights since the simulator was started for this run, or restarted.
    pub(super) live_flights: u32,
    /// Restarts since the last recorded scenario.
    pub(super) restarts_in_vain: u32,
    /// True if the simulator has stored the durations of a recording.
    pace_kept: bool,
    /// Weather quantities that it follows, learned from its scenarios.
    pub(super) followed: Followed,
}

impl Session {
    /// The session of the simulator with this number, counted from 0; it is neither started nor connected yet.
    pub(super) fn new(
        target: &SimulatorTarget,
        number: usize,
        program: &Path,
        pictures: &ImageSource,
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
            known_blocks: KnownBlocks::default(),
            drawn_with: None,
            versions: None,
            live_flights: 0,
            restarts_in_vain: 0,
            pace_kept: false,
            followed: Followed::default(),
        }
    }

    /// Stores the duration of the first scenario since the run or the simulator was started in the simulator's profile. A failure to store
    /// it has no effect on the run.
    pub(super) async fn keep_pace(&mut self, simulator: &mut Simulator, pace: RecordedPace) {
        let has_profile = matches!(simulator.profile(), KnownProfile::Current(_));
        if self.pace_kept || simulator.description().replayed || !has_profile {
            return;
        }
        match simulator.keep_pace(&pace).await {
            Ok(()) => {
                self.pace_kept = true;
                self.known = Some(simulator.profile().clone());
            }
            Err(error) => tracing::warn!(%error, "how long a scenario takes was not kept"),
        }
    }

    /// Keeps what is known of its blocks for the next connection. If they are refused from now on, the next scenario's duration replaces
    /// the one that was kept.
    pub(super) fn note_blocks(&mut self, simulator: &Simulator) {
        let known = simulator.known_blocks();
        if known.is_refused() && !self.known_blocks.is_refused() {
            self.pace_kept = false;
        }
        self.known_blocks = known;
    }

    /// Disconnects before a restart. The profile is read anew afterwards.
    pub(super) async fn leave_to_restart(&mut self) {
        self.live_flights = 0;
        self.restarts_in_vain += 1;
        self.pace_kept = false;
        self.known = None;
        self.known_blocks = self.known_blocks.in_another_process();
        if let Some(ready) = self.ready.take()
            && let Err(error) = ready.release().await
        {
            tracing::debug!(%error, "the simulator that is to be restarted did not confirm its release");
        }
    }

    /// Plugin simulator's profile, if it was not reported yet. It is kept for the next connection.
    pub(super) fn news_of(&mut self, simulator: &Simulator) -> Option<KnownProfile> {
        let known = simulator.profile();
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

    /// True if the simulator was not started by this run.
    pub(super) fn runs_already(&self) -> bool {
        self.target.runs_already()
    }

    /// True if a simulator that cannot be used yet is starting on this computer: something holds its port, or a process has X-Plane's name.
    pub(super) fn may_be_starting(&self, trouble: &ScenarioError) -> bool {
        let is_silent = matches!(
            trouble,
            ScenarioError::Bridge(BridgeError::NobodyAnswers { .. } | BridgeError::NoPlugin { .. })
        );
        is_silent
            && match &self.target {
                SimulatorTarget::Address(address) => {
                    let is_here = address.ip().is_loopback();
                    is_here && (starting::holds_port(*address) || starting::has_process())
                }
                SimulatorTarget::Announced => starting::has_process(),
                SimulatorTarget::StandIn
                | SimulatorTarget::AwkwardStandIn
                | SimulatorTarget::Tape(_) => false,
            }
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
        let simulator = self.of_the_same_version(simulator).await?;
        let mut simulator = self.pictures.set_up(simulator).await?;
        if let Some(known) = &self.known {
            simulator.use_profile(known.clone());
        }
        simulator.use_known_blocks(self.known_blocks);
        simulator.set_not_followed(self.followed.not_followed());
        Ok(simulator)
    }

    /// Rejects a simulator or a plugin that was updated while it was restarted: no check compares images of two versions.
    async fn of_the_same_version(
        &mut self,
        simulator: Simulator,
    ) -> Result<Simulator, ScenarioError> {
        let found = simulator.description().versions();
        match &self.versions {
            Some(before) if *before != found => {
                let before = before.clone();
                if let Err(error) = simulator.release().await {
                    tracing::debug!(%error, "the simulator did not confirm its release");
                }
                Err(ScenarioError::OtherSimulator { before, found })
            }
            _ => {
                self.versions = Some(found);
                Ok(simulator)
            }
        }
    }

    async fn connect_to_target(&mut self) -> Result<Simulator, ScenarioError> {
        let address = match &self.target {
            SimulatorTarget::Address(address) => *address,
            // Looked up each time: after a restart the address may differ.
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

    /// Waits up to `limit` for the simulator, with its images; the error is the last reason why it cannot be used. Our own stand-in is
    /// restarted, since its last behaviour was wrong.
    pub(super) async fn come_back(&mut self, limit: Duration) -> Result<(), ScenarioError> {
        self.ready = None;
        self.known_blocks = self.known_blocks.in_another_process();
        if let Some(stand_in) = self.stand_in.take() {
            stand_in.stop().await;
        }
        let until = Instant::now() + limit;
        loop {
            let Err(error) = self.open().await else {
                return Ok(());
            };
            tracing::debug!(simulator = self.name, %error, "still away");
            if Instant::now() >= until {
                return Err(error);
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
