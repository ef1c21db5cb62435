//! Any bytes as a table of a corpus; the first one selects the kind. No panic, and accepted tables survive writing and reading.

#![no_main]

use std::fs;
use std::path::Path;

use dataset::corpus::detections::Detections;
use dataset::tables::aircraft::AircraftRow;
use dataset::tables::backgrounds::ViewBackground;
use dataset::tables::frames::Frames;
use dataset::tables::health::ViewHealth;
use dataset::tables::image_rows::ImageRow;
use dataset::tables::pixel_box::TruthBox;
use dataset::tables::registrations::Registration;
use dtd_fuzz::place;
use libfuzzer_sys::fuzz_target;

/// As many as a scenario of some minutes has.
const PICTURES: u64 = 2_000;

fuzz_target!(|bytes: &[u8]| {
    let (kind, bytes) = bytes.split_first().unwrap_or((&0, &[]));
    let path = Path::new("table.parquet");
    match kind % 7 {
        0 => {
            if let Ok(frames) = Frames::parse(bytes.to_vec(), path) {
                let again = written(|path| frames.write(path));
                assert_eq!(Frames::parse(again, path).unwrap(), frames);
            }
        }
        1 => {
            if let Ok(boxes) = TruthBox::parse(bytes.to_vec(), path, PICTURES) {
                let again = written(|path| TruthBox::write(&boxes, path));
                assert_eq!(TruthBox::parse(again, path, PICTURES).unwrap(), boxes);
            }
        }
        2 => {
            if let Ok(found) = Detections::parse(bytes.to_vec(), path, PICTURES) {
                let again = written(|path| found.write(path));
                assert_eq!(Detections::parse(again, path, PICTURES).unwrap(), found);
            }
        }
        3 => {
            if let Ok(found) = Registration::parse(bytes.to_vec(), path, PICTURES) {
                let again = written(|path| Registration::write(&found, path));
                assert_eq!(Registration::parse(again, path, PICTURES).unwrap(), found);
            }
        }
        4 => {
            if let Ok(found) = ViewHealth::parse(bytes.to_vec(), path, PICTURES) {
                let again = written(|path| ViewHealth::write(&found, path));
                assert_eq!(ViewHealth::parse(again, path, PICTURES).unwrap(), found);
            }
        }
        5 => {
            if let Ok(found) = ViewBackground::parse(bytes.to_vec(), path, PICTURES) {
                let again = written(|path| ViewBackground::write(&found, path));
                assert_eq!(ViewBackground::parse(again, path, PICTURES).unwrap(), found);
            }
        }
        _ => {
            if let Ok(found) = AircraftRow::parse(bytes.to_vec(), path, PICTURES) {
                let again = written(|path| AircraftRow::write(&found, path));
                assert_eq!(AircraftRow::parse(again, path, PICTURES).unwrap(), found);
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
