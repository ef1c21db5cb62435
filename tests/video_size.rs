//! Images of another size than the calibration's are no images of that camera: every box in them would be elsewhere.

use std::fs;

use dataset::corpus::calibration::Calibration;
use dataset::corpus::seal::seal_folder;
use testkit::command::{Dtd, Ending, text};
use testkit::{onnx_runtime, short_corpus};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));

#[test]
fn videos_of_another_size_than_the_calibration_are_not_searched() {
    let folder = tempfile::tempdir().unwrap();
    let grey = |_: &str, _: u32, rgb: &mut [u8]| rgb.fill(128);
    let corpus = short_corpus::write_with_videos(folder.path(), &["0001-a"], 480, 320, Some(&grey));
    let scenario = corpus.scenario("0001-a");
    let mut calibration = scenario.open().unwrap().calibration().unwrap();
    for camera in calibration.cameras.values_mut() {
        camera.width_px = 640;
    }
    Calibration::write(&calibration, &scenario.calibration_path()).unwrap();
    seal_folder(scenario.root(), "config").unwrap();

    let message = scenario
        .open()
        .unwrap()
        .open_video("left")
        .err()
        .unwrap()
        .to_string();
    assert!(
        message.contains("has images of 480 x 320 px, expected 640 x 320 px"),
        "{message}"
    );
    DTD.command(&[
        "detect",
        text(folder.path()),
        "--model",
        "models/aircraft.onnx",
    ])
    .env("ORT_DYLIB_PATH", onnx_runtime())
    .ends_with(3, &["expected 640 x 320 px"]);
    assert!(!fs::exists(scenario.root().join("detections")).unwrap());
}
