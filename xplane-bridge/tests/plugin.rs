//! The plugin's own Python tests (`plugin/tests/`), run by the system's Python with only its standard library.
//!
//! They decode the golden messages in Python, and run the whole plugin against the in-memory fake `xp` module.

use std::path::Path;
use std::process::Command;

#[test]
fn the_plugins_python_tests_pass() {
    let plugin = Path::new(env!("CARGO_MANIFEST_DIR")).join("plugin");
    let output = Command::new("python3")
        // Only the standard library: neither the user's packages nor a virtual environment's.
        .args(["-I", "-S", "-B", "-c", RUN])
        .arg(plugin.join("tests"))
        .output()
        .unwrap_or_else(|error| panic!("python3 is needed for this test: {error}"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let ran = said
        .lines()
        .find_map(|line| line.strip_prefix("Ran ")?.split(' ').next())
        .and_then(|count| count.parse::<u32>().ok());
    assert!(ran.is_some_and(|count| count >= 30), "{said}");
    if said.contains("skipped=") {
        testkit::skipped(&format!("some of the plugin's tests: {said}"));
    }
}

/// Finds and runs a folder's tests.
const RUN: &str = "import sys, unittest; sys.path.insert(0, sys.argv[1]); \
    unittest.main(module=None, argv=['plugin', 'discover', '-s', sys.argv[1], '-t', sys.argv[1]])";
