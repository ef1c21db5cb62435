//! The command to run next.

use std::net::SocketAddr;

use super::{Check, DoctorOptions, Verdict};

const NAME: &str = "next";
/// The default sweep.
const USUAL_SWEEP: &str = "SWEEP.toml";

/// Recommended next step after these checks.
pub(super) fn check(
    checks: &[Check],
    address: Option<SocketAddr>,
    options: &DoctorOptions,
) -> Check {
    let sim = address.map_or_else(|| "HOST:PORT".to_owned(), |address| address.to_string());
    let failed: Vec<&str> = checks
        .iter()
        .filter(|check| check.verdict == Verdict::Failed)
        .map(|check| check.name)
        .collect();
    if !failed.is_empty() {
        let found = format!(
            "fix {} first, then run dtd doctor --sim {sim}",
            failed.join(", ")
        );
        return Check::skipped(NAME, found);
    }
    let sweep = options
        .intent
        .as_ref()
        .map_or(USUAL_SWEEP, |intent| intent.sweep.as_str());
    let unseen = checks
        .iter()
        .any(|check| check.name == super::window::NAME && check.verdict == Verdict::Warning);
    if unseen {
        let found =
            format!("fix the window first, then run dtd doctor --sim {sim} --sweep {sweep}");
        return Check::skipped(NAME, found);
    }
    Check::ok(
        NAME,
        format!("dtd generate {sweep} --out corpus --sim {sim}"),
    )
}
