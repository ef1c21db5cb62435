//! Any bytes as a JSON file of a corpus; the first one selects the kind. No panic, and accepted input survives writing and reading.

#![no_main]

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::path::Path;

use dataset::corpus::calibration::Calibration;
use dataset::corpus::detections::Provenance;
use dataset::corpus::scenario::ScenarioRecord;
use dataset::corpus::seal::{Seal, is_within, sealed_files};
use dataset::corpus::splits::Splits;
use dataset::files::json_file::parse_json;
use dataset::plan::{Difference, Plan};
use generator::plan::is_seeded_by;
use libfuzzer_sys::fuzz_target;
use serde::Serialize;

fuzz_target!(|bytes: &[u8]| {
    let (kind, bytes) = bytes.split_first().unwrap_or((&0, &[]));
    let path = Path::new("record.json");
    match kind % 7 {
        0 => {
            if let Some(plan) = survives(bytes, |bytes| Plan::parse(bytes, path)) {
                assert_eq!(Difference::between(&plan, &plan).conflict(), None);
                let _ = (plan.check_hashes(), is_seeded_by(&plan, 3));
            }
        }
        1 => {
            if let Some(splits) = survives(bytes, |bytes| Splits::parse(bytes, path)) {
                assert_eq!(splits.leak(), None);
            }
        }
        2 => {
            if let Some(record) = survives(bytes, |bytes| ScenarioRecord::parse(bytes, path)) {
                let _ = record.pictures();
            }
        }
        3 => {
            if let Some(calibration) = survives(bytes, |bytes| Calibration::parse(bytes, path)) {
                for entry in calibration.cameras.values() {
                    if entry.fault().is_none() {
                        let _ = entry.camera();
                    }
                }
            }
        }
        4 => drop(survives(bytes, |bytes| {
            parse_json::<Provenance>(bytes, path, "record of detections")
        })),
        5 => drop(survives(bytes, |bytes| {
            parse_json::<Seal>(bytes, path, "seal")
        })),
        // A manifest is trusted because its hash is in the seal: it is fuzzed without that.
        _ => {
            let manifest = String::from_utf8_lossy(bytes);
            let seal = Seal {
                config_hash: String::new(),
                manifest_blake3: blake3::hash(manifest.as_bytes()).to_string(),
                video_bytes: BTreeMap::new(),
            };
            for file in sealed_files(&manifest, &seal).into_iter().flatten() {
                assert!(is_within(file.name.as_ref()), "{}", file.name);
            }
        }
    }
});

/// The input, if it is accepted; then it must be accepted again after writing.
fn survives<T: Serialize + PartialEq + Debug, E: Debug>(
    bytes: &[u8],
    read: impl Fn(&[u8]) -> Result<T, E>,
) -> Option<T> {
    let first = read(bytes).ok()?;
    let again = read(&serde_json::to_vec(&first).unwrap());
    assert_eq!(again.unwrap(), first);
    Some(first)
}
