//! Judges that look at a page in Chromium.

use std::ffi::OsStr;
use std::process::Command;

use crate::command::said;
use crate::{program_of_venv, repository, skipped};

/// Runs a judge of `tests/judges/` with an address or a file, and fails as it does; skipped where there is no Chromium.
pub fn judge_in_chromium(judge: &str, page: impl AsRef<OsStr>) {
    let browser = Command::new("chromium").arg("--version").output();
    if !browser.is_ok_and(|output| output.status.success()) {
        skipped("it needs Chromium (scripts/setup.sh installs it)");
        return;
    }
    let judged = Command::new(program_of_venv("python"))
        .arg(repository().join("tests/judges").join(judge))
        .arg(page)
        .output();
    let judged = judged.expect("the judge can be started");
    assert!(judged.status.success(), "{}", said(&judged));
}
