//! Other aircraft: for simulators that announce that they draw them.

use futures_util::future::LocalBoxFuture;

use super::{SWITCH_TIMEOUT, Simulator};
use crate::error::BridgeError;
use crate::link::{Answer, Hello, Request, STATES_PER_REQUEST, TrafficPart, TrafficState};

/// The path of another aircraft.
#[derive(Debug, Clone, PartialEq)]
pub struct TrafficPath {
    /// Aircraft type.
    pub aircraft: String,
    /// Its places, one per tick.
    pub states: Vec<TrafficState>,
}

impl Simulator {
    /// Checks that so many other aircraft can be drawn here, before anything is flown.
    ///
    /// # Errors
    /// [`BridgeError::Setup`] if they cannot.
    pub fn check_traffic(&self, wanted: usize) -> Result<(), BridgeError> {
        let Hello {
            name,
            version,
            plugin,
            traffic: most,
            ..
        } = &self.description;
        if wanted <= *most as usize {
            return Ok(());
        }
        let most = match (most, plugin) {
            (0, Some(_)) => {
                "none: X-Plane does not report where it drew one, so that no box could be proven"
                    .into()
            }
            (0, None) => "none in this version".into(),
            (most, _) => format!("at most {most}"),
        };
        Err(BridgeError::Setup(format!(
            "the sweep's [[traffic]] puts {wanted} other aircraft into a scenario, but {name} {version} draws {most}. Take [[traffic]] out of \
             the sweep, or record with the simulator that this version of dtd bundles (--sim mock)"
        )))
    }

    /// Draws other aircraft from now on, until the next freeze. The simulator is frozen.
    ///
    /// # Errors
    /// The simulator rejects them.
    pub fn show_traffic<'a>(
        &'a mut self,
        paths: &'a [TrafficPath],
    ) -> LocalBoxFuture<'a, Result<(), BridgeError>> {
        Box::pin(async move {
            for (number, path) in (1..).zip(paths) {
                for states in path.states.chunks(STATES_PER_REQUEST) {
                    let part = TrafficPart {
                        number,
                        aircraft: path.aircraft.clone(),
                        states: states.to_vec(),
                    };
                    let request = Request::Traffic(part);
                    self.link
                        .tell(
                            "other aircraft",
                            &request,
                            SWITCH_TIMEOUT,
                            &Answer::TrafficKept,
                        )
                        .await?;
                }
            }
            Ok(())
        })
    }
}
