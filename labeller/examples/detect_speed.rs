//! Measures detection speed for divisions of the cores: workers x threads per worker x batch.
//!
//! `cargo run --release -p labeller --example detect_speed -- MODEL.onnx [WIDTH HEIGHT]`, with `ORT_DISABLE_TELEMETRY=1` and
//! `ORT_DYLIB_PATH=$PWD/target/lib/dtd/libonnxruntime.so` in the environment, prints pictures per second of the first pass (all tiles of
//! an empty picture), without decoding. The default of `DetectOptions` is based on it.

use std::path::Path;
use std::time::Instant;

use labeller::detector::{Detector, Device, OrtDetector, OrtOptions, PictureView};
use labeller::tiling::{TilingSettings, find_aircraft};

/// Pictures per worker.
const PICTURES: usize = 12;
/// Workers, threads per worker, batch.
const DIVISIONS: [(usize, usize, usize); 5] =
    [(1, 1, 1), (1, 2, 1), (1, 2, 6), (2, 1, 1), (2, 1, 6)];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some(model) = arguments.first() else {
        return Err("expected MODEL.onnx [WIDTH HEIGHT]".into());
    };
    let number =
        |index: usize, usual: u32| arguments.get(index).map_or(Ok(usual), |text| text.parse());
    let (width_px, height_px) = (number(1, 1920)?, number(2, 1280)?);
    for (workers, threads, batch) in DIVISIONS {
        let mut detectors = (0..workers)
            .map(|_| {
                let library = None;
                OrtDetector::load(
                    Path::new(model),
                    &OrtOptions {
                        library,
                        device: Device::CPU,
                        threads,
                        batch,
                    },
                )
            })
            .collect::<Result<Vec<_>, _>>()?;
        let started = Instant::now();
        std::thread::scope(|scope| {
            let running: Vec<_> = detectors
                .iter_mut()
                .map(|detector| scope.spawn(|| search(detector, width_px, height_px)))
                .collect();
            running
                .into_iter()
                .try_for_each(|worker| worker.join().expect("a worker panicked"))
        })?;
        let per_second = (workers * PICTURES) as f64 / started.elapsed().as_secs_f64();
        println!(
            "{workers} workers x {threads} threads, batch {batch}: {per_second:.2} pictures/s"
        );
    }
    Ok(())
}

fn search(detector: &mut dyn Detector, width_px: u32, height_px: u32) -> labeller::Result<()> {
    let rgb = vec![150; (width_px * height_px * 3) as usize];
    let picture = PictureView {
        rgb: &rgb,
        width_px,
        height_px,
    };
    let settings = TilingSettings::default();
    (0..PICTURES).try_for_each(|_| find_aircraft(detector, &picture, &settings).map(drop))
}
