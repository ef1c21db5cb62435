//! Prints, for each scenario of a corpus, the labelled tick nearest to touchdown, the bounding boxes of the aircraft there and the size of
//! the images.
//!
//! `cargo run --release -p dataset --example nearest_tick -- corpus`

use std::path::PathBuf;

use dataset::corpus::Corpus;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let root = PathBuf::from(
        std::env::args()
            .nth(1)
            .ok_or("expected the folder of a corpus")?,
    );
    for scenario in Corpus::open(&root)?.scenarios()? {
        // One state of the scenario: its hashes are checked, and a writer that changes it meanwhile is not seen.
        let scenario = scenario.open()?;
        let (record, frames) = (scenario.record()?, scenario.frames()?);
        let labelled = frames
            .rows
            .iter()
            .filter_map(|row| Some((row.tick, row.labels?)));
        let Some((tick, labels)) = labelled.min_by(|a, b| a.1.dtd_m.total_cmp(&b.1.dtd_m)) else {
            println!("{}: {} ticks, not labelled", record.id, record.ticks);
            continue;
        };
        println!(
            "{}: tick {tick} is {:.1} m before touchdown",
            record.id, labels.dtd_m
        );
        for truth in scenario
            .truth_boxes()?
            .iter()
            .filter(|truth| truth.tick == tick && truth.is_of_first())
        {
            let mut video = scenario.open_video(&truth.view)?;
            let mut rgb = Vec::new();
            for _ in 0..tick {
                video.skip_frame()?;
            }
            video.next_frame(&mut rgb)?;
            let (width, height) = (video.width(), video.height());
            println!(
                "  {}: {:?} in {width}x{height}",
                truth.view, truth.pixel_box
            );
        }
    }
    Ok(())
}
