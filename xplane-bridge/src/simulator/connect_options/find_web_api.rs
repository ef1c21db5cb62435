//! Checks that a Web API belongs to the simulator at the other end of the UDP connection.
//!
//! It does if it reports the same capture link. A second X-Plane on the same computer must be left alone: a flight started there would
//! never begin here.

use std::net::SocketAddr;
use std::time::Duration;

use crate::datarefs::{CAPTURE_PORT, VERSION};
use crate::web_api::{WebApi, WebApiError};

/// Timeout of the Web API's first answer.
pub(super) const TIMEOUT: Duration = Duration::from_secs(1);

/// Reason why a Web API is not used.
#[derive(Debug, thiserror::Error)]
pub(crate) enum NotUsed {
    /// There is none, or it does not answer.
    #[error(transparent)]
    Fails(#[from] WebApiError),
    /// It has no datarefs at all.
    #[error(
        "no flight is loaded: the Web API at {address} (X-Plane {version}) has no datarefs while the main menu shows"
    )]
    NoFlight {
        address: SocketAddr,
        /// X-Plane's version.
        version: String,
    },
    /// It belongs to a different simulator.
    #[error(
        "the Web API at {address} belongs to another simulator: its capture link is {}, expected port {expected}",
        .found.map_or("not there".to_owned(), |port| format!("at port {port}"))
    )]
    OtherSimulator {
        address: SocketAddr,
        /// Port of the reported capture link, if any.
        found: Option<f64>,
        /// Port of ours.
        expected: u16,
    },
}

/// The Web API there, if it belongs to the simulator whose capture link has this port.
pub(crate) async fn find(address: SocketAddr, capture_port: u16) -> Result<WebApi, NotUsed> {
    let api = WebApi::connect(address, TIMEOUT).await?;
    let other = |found| NotUsed::OtherSimulator {
        address,
        found,
        expected: capture_port,
    };
    match api.read_number(CAPTURE_PORT).await {
        Ok(port) if port == f64::from(capture_port) => Ok(api),
        Ok(port) => Err(other(Some(port))),
        // Every X-Plane has a version, but none has datarefs before a flight is loaded.
        Err(WebApiError::Unknown { .. }) => match api.dataref(VERSION).await {
            Ok(_) => Err(other(None)),
            Err(WebApiError::Unknown { .. }) => Err(NotUsed::NoFlight {
                address,
                version: api.simulator_version().to_owned(),
            }),
            Err(error) => Err(error.into()),
        },
        Err(error) => Err(error.into()),
    }
}

/// [`find`]; `None`, with the reason in the log, if it cannot be used.
pub(crate) async fn usable(address: SocketAddr, capture_port: u16) -> Option<WebApi> {
    match find(address, capture_port).await {
        Ok(api) => Some(api),
        Err(NotUsed::Fails(error @ WebApiError::NotReached { .. })) => {
            tracing::debug!(%error, "no Web API");
            None
        }
        Err(reason) => {
            tracing::info!(%reason, "the Web API is not used");
            None
        }
    }
}
