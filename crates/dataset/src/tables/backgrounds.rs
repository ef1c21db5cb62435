//! `backgrounds/<model>.parquet`: the surroundings that each fixed camera saw during a flight.
//!
//! Input: the images of a view that show the camera's direction at the beginning of the flight. Output: their mean, from just above the
//! horizon down, without noise, rain and the aircraft. A training keeps some as references, and later flights are compared with them. The
//! table belongs to the detections of the same model, like [`crate::tables::health`].

use schemars::JsonSchema;

use crate::error::Result;
use crate::tables::columns::{Table, TableWriter};
use crate::tables::health::CameraTurn;
use crate::tables::image_rows::ImageRow;
use crate::tables::row_parts::Numbers;

/// A view's background.
#[derive(Debug, Clone, PartialEq, JsonSchema)]
pub struct ViewBackground {
    /// Number of the tick with the last of the images; the background is not available at earlier ticks.
    pub tick: u32,
    /// Identifier of the view.
    pub view: String,
    /// Number of the images.
    pub images: u32,
    /// Row of the camera's image that the background begins with.
    pub top_px: u32,
    /// The flight's usual direction relative to the background's. Standard deviation: of the mean over the flight, by its images' scatter.
    pub usual: CameraTurn,
    /// Grey levels, a PNG as wide as the camera's image.
    pub png: Vec<u8>,
}

impl ImageRow for ViewBackground {
    const NAME: &'static str = "backgrounds";

    fn columns(rows: &[Self]) -> TableWriter {
        let rows = rows.iter();
        TableWriter::new()
            .u32("tick", rows.clone().map(|row| row.tick))
            .text("view", rows.clone().map(|row| &row.view))
            .u32("images", rows.clone().map(|row| row.images))
            .u32("top_px", rows.clone().map(|row| row.top_px))
            .numbers(
                CameraTurn::COLUMNS,
                rows.clone().map(|row| row.usual.to_array()),
            )
            .bytes("png", rows.map(|row| &row.png))
    }

    fn of_table(table: &mut Table) -> Result<Vec<Self>> {
        let ticks = table.u32("tick")?;
        let views = table.text("view")?;
        let [images, tops_px] = [table.u32("images")?, table.u32("top_px")?];
        let turns = table.numbers(CameraTurn::COLUMNS)?;
        let pngs = table.bytes("png")?;
        let rows = ticks.into_iter().zip(views).zip(turns).zip(pngs);
        let rows = rows
            .enumerate()
            .map(|(row, (((tick, view), usual), png))| Self {
                tick,
                view,
                images: images[row],
                top_px: tops_px[row],
                usual: CameraTurn::of_array(usual),
                png,
            });
        Ok(rows.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn backgrounds_are_read_back_as_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc.parquet");
        let row = |tick, view: &str| ViewBackground {
            tick,
            view: view.into(),
            images: 24,
            top_px: 602,
            usual: CameraTurn {
                shift_x_px: 0.25,
                shift_y_px: -0.5,
                roll_deg: 0.01,
                shift_sd_px: 0.02,
            },
            png: vec![0x89, b'P', b'N', b'G', 0, 255],
        };
        for rows in [vec![row(23, "left"), row(40, "right")], Vec::new()] {
            ViewBackground::write(&rows, &path).unwrap();
            let content = std::fs::read(&path).unwrap();
            assert_eq!(ViewBackground::parse(content, &path, 48).unwrap(), rows);
        }
    }
}
