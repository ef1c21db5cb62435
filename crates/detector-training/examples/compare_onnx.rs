//! Writes a detector with random weights as ONNX, a random picture, and this project's own output for it, so that `compare_onnx.py`
//! can compare ONNX Runtime's output with it:
//!
//!     cargo run --release -p detector-training --example compare_onnx -- FOLDER
//!     python crates/detector-training/examples/compare_onnx.py FOLDER
//!
//! All files are raw little-endian 32-bit floats: `picture.f32` `[416, 640, 3]`, `cells.f32` `[4160, 5]` (the network's raw output).
//! `peaks.json` holds the decoded peaks.

use std::error::Error;
use std::fs;
use std::path::PathBuf;

use burn::tensor::Device;
use detector_training::convolution::{GatherTables, normal_weights};
use detector_training::export::onnx_bytes;
use detector_training::grid::{CELL_VALUES, peaks};
use detector_training::network::Network;
use detector_training::patches::PatchBatch;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Not square, so that rows and columns cannot be confused.
const WIDTH_PX: usize = 640;
const HEIGHT_PX: usize = 416;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(
        std::env::args()
            .nth(1)
            .ok_or("expected the folder to write to")?,
    );
    fs::create_dir_all(&folder)?;
    let device = Device::flex();
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let mut network = Network::new(&device, 9);
    // A head as strong as a trained one: sizes and scores then differ from cell to cell.
    network.head.weight = normal_weights(network.head.weight.dims(), 0.2, &device, &mut rng);
    // An untrained network ignores the strength of contrast.
    for layer in [
        &mut network.strength_8,
        &mut network.strength_16,
        &mut network.strength_32,
    ] {
        layer.weight = normal_weights(layer.weight.dims(), 0.02, &device, &mut rng);
    }

    let picture: Vec<f32> = (0..WIDTH_PX * HEIGHT_PX * 3)
        .map(|_| rng.random())
        .collect();
    let mut batch = PatchBatch::new(1, HEIGHT_PX, WIDTH_PX);
    batch.fill(0, &picture);
    let map = network.forward(&batch, &mut GatherTables::new(&device));
    let cells: Vec<f32> = map.rows.into_data().try_into_vec()?;
    assert_eq!(cells.len(), map.width * map.height * CELL_VALUES);
    let found: Vec<[f64; 5]> = peaks(&cells, map.width, map.height, 0.01)
        .into_iter()
        .map(|peak| {
            let b = peak.pixel_box;
            [b.cx_px, b.cy_px, b.width_px, b.height_px, peak.score]
        })
        .collect();

    fs::write(folder.join("model.onnx"), onnx_bytes(&network))?;
    fs::write(
        folder.join("picture.f32"),
        picture
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect::<Vec<u8>>(),
    )?;
    fs::write(
        folder.join("cells.f32"),
        cells
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect::<Vec<u8>>(),
    )?;
    fs::write(folder.join("peaks.json"), serde_json::to_vec(&found)?)?;
    println!("{} peaks, wrote {}", found.len(), folder.display());
    Ok(())
}
