//! Tests that cannot run everywhere.

use std::env;
use std::io::Write as _;

/// Says on standard error, past the test harness's capture, that a test is skipped; in CI, which skips none, it fails.
pub fn skipped(why: &str) {
    assert!(
        env::var_os("CI").is_none(),
        "CI skips no test, and this one cannot run here: {why}"
    );
    let test = std::thread::current();
    let name = test.name().unwrap_or("a test");
    let _ = writeln!(std::io::stderr(), "skipped: {name}: {why}");
}
