//! Numbers of frames that are repeated, missing or half drawn, and frames inserted by a driver: in a paused world every image has to equal
//! the one that was recorded without them.

use std::error::Error;

use generator::generate::Event;
use serde_json::json;

use super::{MARGIN_PX, Recording, sweep, unlike};

/// Two flights from two views then have 2,000 images.
const DTD_NM: f64 = 0.65;
/// Frames by which the scene is behind the numbers.
const LAG: usize = 1;
const FAULTS: [&str; 8] = [
    "repeat=0.001",
    "repeat=0.01",
    "repeat=0.05",
    "repeat=0.2",
    "vanish=0.05",
    "half=0.05",
    "insert=0.2",
    "repeat=0.05,vanish=0.02,half=0.02",
];

pub(crate) async fn codes(size_px: (u32, u32)) -> Result<(), Box<dyn Error>> {
    let toml = sweep(size_px, DTD_NM, &["clear"]);
    // The simulator without faults stays: its corpus is in its folder.
    let undisturbed = Recording::start(size_px, MARGIN_PX, LAG, "").await?;
    let expected = undisturbed
        .generate("codes", toml.clone(), &mut |_| {})
        .await?;
    for faults in FAULTS {
        let recording = Recording::start(size_px, MARGIN_PX, LAG, faults).await?;
        let (mut from, mut to, mut frames) = (0, 0, 0);
        let mut listen = |event: Event<'_>| match event {
            Event::Flown { .. } => from = recording.frames.get(),
            Event::Captured { .. } => to = recording.frames.get(),
            // The simulator draws on while the scenario is sealed.
            Event::Committed { .. } => frames += to - from,
            _ => {}
        };
        let found = recording
            .generate("codes", toml.clone(), &mut listen)
            .await?;
        let (mut pictures, mut wrong, mut by_blocks) = (0, 0, true);
        for scenario in found.scenarios()? {
            let record = scenario.open()?.record()?;
            by_blocks &= record.blocks.is_some_and(|blocks| blocks.held_ticks == 0);
            pictures += u64::from(record.ticks) * record.views.len() as u64;
            wrong += unlike(&expected, &found, &scenario.id(), |one, other| one != other)?;
        }
        println!(
            "{}",
            json!({
                "faults": faults, "size_px": [size_px.0, size_px.1], "pictures": pictures,
                "differ": wrong, "by_blocks": by_blocks,
                "frames_per_picture": frames as f64 / pictures as f64,
            })
        );
    }
    Ok(())
}
