//! Any bytes as a table of a corpus; the first one selects the kind. No panic, and accepted tables survive writing and reading.

#![no_main]

use std::fs;
use std::path::Path;

use dataset::corpus::detections::{parse_detections, write_detections};
use dataset::tables::frames::Frames;
use dataset::tables::health::{parse_health, write_health};
use dataset::tables::pixel_box::{parse_truth_boxes, write_truth_boxes};
use dataset::tables::registrations::{parse_registrations, write_registrations};
use dtd_fuzz::place;
use libfuzzer_sys::fuzz_target;

/// As many as a scenario of some minutes has.
const PICTURES: u64 = 2_000;

fuzz_target!(|bytes: &[u8]| {
    let (kind, bytes) = bytes.split_first().unwrap_or((&0, &[]));
    let path = Path::new("table.parquet");
    match kind % 5 {
        0 => {
            if let Ok(frames) = Frames::parse(bytes.to_vec(), path) {
                let again = written(|path| frames.write(path));
                assert_eq!(Frames::parse(again, path).unwrap(), frames);
            }
        }
        1 => {
            if let Ok(boxes) = parse_truth_boxes(bytes.to_vec(), path, PICTURES) {
                let again = written(|path| write_truth_boxes(path, &boxes));
                assert_eq!(parse_truth_boxes(again, path, PICTURES).unwrap(), boxes);
            }
        }
        2 => {
            if let Ok(found) = parse_detections(bytes.to_vec(), path, PICTURES) {
                let again = written(|path| write_detections(path, &found));
                assert_eq!(parse_detections(again, path, PICTURES).unwrap(), found);
            }
        }
        3 => {
            if let Ok(found) = parse_registrations(bytes.to_vec(), path, PICTURES) {
                let again = written(|path| write_registrations(path, &found));
                assert_eq!(parse_registrations(again, path, PICTURES).unwrap(), found);
            }
        }
        _ => {
            if let Ok(found) = parse_health(bytes.to_vec(), path, PICTURES) {
                let again = written(|path| write_health(path, &found));
                assert_eq!(parse_health(again, path, PICTURES).unwrap(), found);
            }
        }
    }
});

/// The bytes of the table that is written.
fn written(write: impl FnOnce(&Path) -> dataset::Result<()>) -> Vec<u8> {
    let path = place("again.parquet");
    write(&path).unwrap();
    fs::read(&path).unwrap()
}
