//! Memory of this process.

use std::fs;

/// The most memory that this process had while something ran, bytes. Everything else in the process counts, too: a test that measures is
/// alone in its file.
pub fn peak_bytes(run: impl FnOnce()) -> f64 {
    // Resets the peak.
    fs::write("/proc/self/clear_refs", "5").unwrap();
    run();
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    let kib = line.unwrap().split_whitespace().nth(1).unwrap();
    kib.parse::<f64>().unwrap() * 1_024.0
}
