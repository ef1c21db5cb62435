//! Does X-Plane 12's Web API answer, and is it that of the same simulator?

use std::net::SocketAddr;
use std::time::Duration;

use super::Check;
use crate::web_api::WebApi;

const NAME: &str = "web api";
const TIMEOUT: Duration = Duration::from_secs(2);
const HINT: &str = "Needed only to begin flights with weather in one request (X-Plane 12.4); UDP does without. X-Plane serves it on its \
                    own computer, port 8086, if \"Accept incoming connections\" is on. Another place: --web-api HOST:PORT here, the \
                    environment variable DTD_WEB_API=HOST:PORT for `dtd generate`";

pub(super) async fn check(address: SocketAddr) -> Check {
    match WebApi::connect(address, TIMEOUT).await {
        Err(error) => Check::warning(NAME, error.to_string(), HINT),
        Ok(api) => {
            let can = |what: bool| if what { "yes" } else { "no" };
            let found = format!(
                "{address}, X-Plane {}; commands: {}, beginning flights: {}",
                api.simulator_version(),
                can(api.has_commands()),
                can(api.has_flights())
            );
            Check::ok(NAME, found)
        }
    }
}
