//! Does X-Plane's own log complain about us?
//!
//! X-Plane 12 logs deprecated datarefs and misplaced calls, and shows some complaints over the scene, where they would be in the images.
//! The plugin reads the log, on any computer.

use std::time::Duration;

use super::Check;
use crate::Simulator;
use crate::error::BridgeError;
use crate::link::{Answer, Request};
use crate::simulator::wrong;

const NAME: &str = "complaints";
/// A log of many megabytes on a slow disk.
const TIMEOUT: Duration = Duration::from_secs(20);

/// Has the plugin read the log.
pub(super) async fn check(simulator: &mut Simulator) -> Check {
    if simulator.description().plugin.is_none() {
        return Check::skipped(NAME, "the simulator serves its link without a plugin");
    }
    verdict(simulator.complaints().await)
}

impl Simulator {
    /// Lines of X-Plane's log that complain about the plugin.
    async fn complaints(&mut self) -> Result<Vec<String>, BridgeError> {
        let request = Request::Complaints;
        match self.link.ask("X-Plane's log", &request, TIMEOUT).await? {
            Answer::Complaints { lines } => Ok(lines),
            other => Err(wrong("complaints", &other)),
        }
    }
}

fn verdict(read: Result<Vec<String>, BridgeError>) -> Check {
    match read {
        Ok(lines) if lines.is_empty() => {
            Check::ok(NAME, "X-Plane's Log.txt has no complaint about us")
        }
        Ok(lines) => Check::warning(
            NAME,
            format!(
                "X-Plane's Log.txt complains about us: {}",
                lines.join(" | ")
            ),
            "Look whether X-Plane shows an error over the scene, and close it: it would be in the images. Please report these lines, with \
             the version of X-Plane",
        ),
        // An older plugin, or a log that cannot be read.
        Err(error) => Check::skipped(NAME, error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulator::doctor::Verdict;

    #[test]
    fn each_complaint_is_quoted_with_what_to_do() {
        let line = "[XPPython3]: Dataref 'sim/cockpit2/controls/flap_ratio' has been replaced. Please use the new name.";
        let check = verdict(Ok(vec![line.into()]));
        assert_eq!(check.verdict, Verdict::Warning);
        assert!(check.found.contains(line), "{}", check.found);
        assert!(check.hint.unwrap().contains("over the scene"));
        assert_eq!(verdict(Ok(vec![])).verdict, Verdict::Ok);
        assert_eq!(
            verdict(Err(BridgeError::LinkClosed)).verdict,
            Verdict::Skipped
        );
    }
}
