//! Does X-Plane 12's Web API answer, does it belong to the same simulator, and is a flight loaded?

use std::net::SocketAddr;
use std::time::Duration;

use crate::simulator::connect_options::find_web_api::{NotUsed, find};
use crate::simulator::doctor::Check;
use crate::web_api::{WebApi, WebApiError};

const NAME: &str = "web api";
const TIMEOUT: Duration = Duration::from_secs(2);
const HINT: &str = "Needed only to begin flights with weather in one request (X-Plane 12.4); UDP does without. X-Plane serves it on its \
                    own computer, port 8086, if \"Accept incoming connections\" is on. Another place: the environment variable \
                    DTD_WEB_API=HOST:PORT, or --web-api HOST:PORT for this examination alone";

/// Tries the Web API there as a client would.
pub(crate) async fn check(place: Option<SocketAddr>, capture_port: Option<u16>) -> Check {
    let Some(address) = place else {
        let reason = "not looked for: switched off (DTD_WEB_API=off), or the simulator is on another computer, where only \
                      DTD_WEB_API=HOST:PORT can tell where it is";
        return Check::skipped(NAME, reason);
    };
    let Some(capture_port) = capture_port else {
        // It may be another's: only the port of the capture link shows whose it is.
        return Check::skipped(
            NAME,
            "without the plugin nothing shows which simulator it belongs to",
        );
    };
    match find(address, capture_port).await {
        Ok(api) => {
            let can = if api.has_flights() {
                "begins"
            } else {
                "cannot begin"
            };
            let found = format!(
                "{address}, X-Plane {}, the same simulator; it {can} flights",
                api.simulator_version()
            );
            Check::ok(NAME, found)
        }
        Err(reason) => {
            let hint = match reason {
                NotUsed::NoFlight { .. } => "Load any flight in X-Plane, and try again",
                NotUsed::OtherSimulator { .. } => {
                    "It is left alone. If this simulator has one too, say where: DTD_WEB_API=HOST:PORT"
                }
                NotUsed::Fails(_) => HINT,
            };
            Check::warning(NAME, reason.to_string(), hint)
        }
    }
}

/// True if a simulator reports through its Web API that it accepts no connections.
pub(crate) async fn refuses(address: SocketAddr) -> bool {
    matches!(
        WebApi::connect(address, TIMEOUT).await,
        Err(WebApiError::Forbidden { .. })
    )
}
