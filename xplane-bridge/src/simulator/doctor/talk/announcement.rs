//! Is there a beacon?

use std::net::SocketAddr;

use crate::error::BridgeError;
use crate::simulator::doctor::{Check, DoctorOptions};
use crate::udp::discovery::{Announced, announced, choose, is_same};
use crate::udp::simulator_address::reachable;

const NAME: &str = "beacon";

/// Listens for the beacon of the examined simulator, or of any if no address is known; returns the announced address. If several
/// announce themselves and none was specified, the check fails.
pub(crate) async fn listen(options: &DoctorOptions) -> (Check, Option<SocketAddr>) {
    let wanted = options.address.map(reachable);
    let heard = match announced(options.listen, wanted).await {
        Ok(heard) => heard,
        Err(error) => return (Check::skipped(NAME, error.to_string()), None),
    };
    let Some(wanted) = wanted else {
        return match choose(heard, options.listen, &options.local_udp).await {
            Ok(one) => well(&one),
            Err(error @ BridgeError::SeveralAnnounced { .. }) => {
                let hint = "Say which one to examine: --sim HOST:PORT";
                (Check::failed(NAME, error.to_string(), hint), None)
            }
            Err(_) => (unheard(format!("none within {:.1?}", options.listen)), None),
        };
    };
    match heard.iter().find(|one| is_same(wanted, one.address)) {
        Some(one) => well(one),
        None if heard.is_empty() => (unheard(format!("none within {:.1?}", options.listen)), None),
        None => {
            let others: Vec<String> = heard.iter().map(|one| one.address.to_string()).collect();
            let found = format!("none of this simulator, but of {}", others.join(", "));
            (unheard(found), None)
        }
    }
}

fn well(one: &Announced) -> (Check, Option<SocketAddr>) {
    let name = one.beacon.name.as_deref().unwrap_or("without a name");
    let found = format!("{name}, version {}, at {}", one.beacon.version, one.address);
    (Check::ok(NAME, found), Some(one.address))
}

fn unheard(found: String) -> Check {
    let hint = "Not needed if the address is known (--sim HOST:PORT). Multicast may be blocked on the way, or X-Plane not be running";
    Check::warning(NAME, found, hint)
}
