//! A recording that begins hours before its approach is read in little memory. The test runs in a separate process, whose peak it measures.

use std::fs::{self, File};
use std::io::{BufWriter, Write};

use generator::airports;
use generator::recording::Recording;
use testkit::repository;

const MIN_BYTES: usize = 48 << 20;
const MAX_BYTES: u64 = 12 << 20;

/// The most memory that this process has had, bytes.
fn peak_bytes() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    let kib: u64 = line
        .unwrap()
        .split_whitespace()
        .nth(1)
        .unwrap()
        .parse()
        .unwrap();
    kib << 10
}

#[test]
fn a_recording_of_hours_before_its_approach_is_read_in_little_memory() {
    let flight =
        fs::read_to_string(repository().join("tests/data/flights/01_calm_ils.csv")).unwrap();
    let (header, rows) = flight.split_once('\n').unwrap();
    let (_, parked) = rows.trim_end().rsplit_once('\n').unwrap();
    let (_, parked) = parked.split_once(',').unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.csv");
    let mut file = BufWriter::new(File::create(&path).unwrap());
    writeln!(file, "{header}").unwrap();
    let count = MIN_BYTES / parked.len();
    for row in 0..count {
        writeln!(file, "{},{parked}", row as f64 * 0.02 - count as f64).unwrap();
    }
    file.write_all(rows.as_bytes()).unwrap();
    file.flush().unwrap();
    let runway = airports::bundled("WSSS", "02L").unwrap();
    let before = peak_bytes();
    let recording = Recording::read(&path, &runway, 18_520.0, &[]).unwrap();
    assert!(recording.trajectory.touchdown().is_some());
    let more = peak_bytes() - before;
    assert!(more < MAX_BYTES, "{more} bytes for {MIN_BYTES}");
}
