//! The simulator of a run: found or started, connected afresh for every scenario.

use std::net::{SocketAddr, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use xplane_bridge::{CONNECT_TIMEOUT, Simulator};

use super::error::ScenarioError;
use crate::stand_in::{StandIn, StandInError};

/// Which simulator to use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SimulatorTarget {
    /// Our own, started for this run.
    StandIn,
    /// One that runs already and takes UDP packets there.
    Address(SocketAddr),
}

impl FromStr for SimulatorTarget {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "mock" {
            return Ok(Self::StandIn);
        }
        let expected = "expected `mock` or HOST:PORT, e.g. 127.0.0.1:49000";
        let mut found = text
            .to_socket_addrs()
            .map_err(|e| format!("no simulator address: {text:?}: {e}; {expected}"))?;
        // X-Plane listens on IPv4.
        let first = found.next();
        found
            .find(SocketAddr::is_ipv4)
            .filter(|_| first.is_none_or(|a| a.is_ipv6()))
            .or(first)
            .map(Self::Address)
            .ok_or_else(|| format!("no simulator address: {text:?} has no address; {expected}"))
    }
}

pub(super) struct Session {
    program: PathBuf,
    address: SocketAddr,
    stand_in: Option<StandIn>,
    /// The connection with which the session was opened; the first scenario uses it.
    ready: Option<Simulator>,
}

impl Session {
    /// Finds or starts the simulator and connects to it.
    pub(super) async fn open(
        target: &SimulatorTarget,
        program: &Path,
    ) -> Result<Self, super::GenerateError> {
        let stand_in = match target {
            SimulatorTarget::StandIn => Some(StandIn::start(program).await?),
            SimulatorTarget::Address(_) => None,
        };
        let address = match (target, &stand_in) {
            (SimulatorTarget::Address(address), _) => *address,
            (SimulatorTarget::StandIn, Some(stand_in)) => stand_in.address(),
            (SimulatorTarget::StandIn, None) => unreachable!("the stand-in was started above"),
        };
        let ready = Simulator::connect(address, CONNECT_TIMEOUT).await?;
        Ok(Self {
            program: program.to_owned(),
            address,
            stand_in,
            ready: Some(ready),
        })
    }

    /// A connection that nobody used yet. A stand-in that died is started again.
    pub(super) async fn connect(&mut self) -> Result<Simulator, ScenarioError> {
        if let Some(ready) = self.ready.take() {
            return Ok(ready);
        }
        self.revive().await?;
        Ok(Simulator::connect(self.address, CONNECT_TIMEOUT).await?)
    }

    async fn revive(&mut self) -> Result<(), StandInError> {
        if let Some(stand_in) = &mut self.stand_in
            && !stand_in.is_running()
        {
            tracing::warn!("the stand-in simulator died and is started again");
            let fresh = StandIn::start(&self.program).await?;
            self.address = fresh.address();
            *stand_in = fresh;
        }
        Ok(())
    }

    /// Takes leave.
    pub(super) async fn close(self) {
        if let Some(ready) = self.ready
            && let Err(error) = ready.release().await
        {
            tracing::warn!(%error, "the simulator did not take leave");
        }
        if let Some(stand_in) = self.stand_in {
            stand_in.stop().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_read_and_wrong_ones_explained() {
        assert_eq!("mock".parse(), Ok(SimulatorTarget::StandIn));
        assert_eq!(
            "127.0.0.1:49000".parse(),
            Ok(SimulatorTarget::Address(([127, 0, 0, 1], 49_000).into()))
        );
        for wrong in ["", "mok", "127.0.0.1", "127.0.0.1:99999"] {
            assert!(
                wrong
                    .parse::<SimulatorTarget>()
                    .unwrap_err()
                    .contains("HOST:PORT"),
                "{wrong}"
            );
        }
    }
}
