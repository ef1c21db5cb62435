//! Is there a beacon?

use std::net::SocketAddr;

use super::{Check, Patient};
use crate::discovery::announced;

const NAME: &str = "beacon";

/// Listens for the beacon of the patient, or of anybody if no address is known; returns where it says that it is.
pub(super) async fn listen(patient: &Patient) -> (Check, Option<SocketAddr>) {
    let heard = match announced(patient.listen).await {
        Ok(heard) => heard,
        Err(error) => return (Check::skipped(NAME, error.to_string()), None),
    };
    // The same simulator may be known under another of its addresses.
    let wanted = |port: u16| patient.address.is_none_or(|wanted| wanted.port() == port);
    if let Some(one) = heard.iter().find(|one| wanted(one.address.port())) {
        let name = one.beacon.name.as_deref().unwrap_or("without a name");
        let found = format!("{name}, version {}, at {}", one.beacon.version, one.address);
        return (Check::ok(NAME, found), Some(one.address));
    }
    let others: Vec<String> = heard.iter().map(|one| one.address.to_string()).collect();
    let found = match others.as_slice() {
        [] => format!("none within {:.1?}", patient.listen),
        others => format!("none of this simulator, but of {}", others.join(", ")),
    };
    let hint = "Not needed if the address is known (--sim HOST:PORT). Multicast may be blocked on the way, or X-Plane not be running";
    (Check::warning(NAME, found, hint), None)
}
