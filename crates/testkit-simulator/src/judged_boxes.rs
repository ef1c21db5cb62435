//! An independent check of ground-truth boxes and occlusion: a NumPy program that shares only the meshes with ours.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use airframe::{AircraftType, Configuration};
use serde_json::{Value, json};
use testkit::judged;

/// Verdict of `type_boxes.py` on a corpus by aircraft type, at the ticks with the gear down and one of these flap positions.
pub fn judged_boxes(corpus: &Path, flap_ratios: &[f64]) -> Value {
    let mesh = |of: &AircraftType, flap_ratio: f64| {
        let mesh = of.mesh(Configuration {
            flap_ratio,
            gear_ratio: 1.0,
        });
        let corners: Vec<[f64; 3]> = mesh.vertices.iter().map(|at| at.to_array()).collect();
        let triangles: Vec<[u32; 3]> = mesh.triangles.iter().map(|of| of.indices).collect();
        json!({ "flap_ratio": flap_ratio, "gear_ratio": 1.0, "corners_m": corners, "triangles": triangles })
    };
    let all = |of: &AircraftType| -> (String, Vec<Value>) {
        let meshes = flap_ratios.iter().map(|flaps| mesh(of, *flaps));
        (of.name.clone(), meshes.collect())
    };
    let all: BTreeMap<_, _> = AircraftType::all().iter().map(all).collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("meshes.json");
    fs::write(&path, serde_json::to_vec(&all).unwrap()).unwrap();
    judged("type_boxes.py", &[corpus, &path])
}
