//! `detections/<model>.parquet`: the boxes that a model found, and why images without a box have none.
//!
//! Input: what `dtd detect` found in each image, one view at one tick. Output: a typed row for each box, and one with a reason for each
//! image without one.

use std::path::Path;

use schemars::JsonSchema;

use crate::error::Result;
use crate::numbers::limits;
use crate::tables::columns::{Table, TableWriter};
use crate::tables::image_rows::ImageRow;
use crate::tables::pixel_box::PixelBox;
use crate::tables::row_parts::{NumberColumn, Numbers, words};

/// A model's detections in a scenario's images.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Detections {
    /// The boxes, by tick.
    pub boxes: Vec<Detection>,
    /// Images without a box, by tick.
    pub misses: Vec<Miss>,
}

/// A detected aircraft in one view at one tick.
#[derive(Debug, Clone, PartialEq, JsonSchema)]
pub struct Detection {
    /// Number of the tick.
    pub tick: u32,
    /// Identifier of the view.
    pub view: String,
    /// The box in the original frame.
    pub pixel_box: PixelBox,
    /// Confidence of the model.
    pub score: f64,
    /// Number of the window of the first pass that saw it, row by row from 0; in images of the mode `tracked`, number of the crop.
    pub tile: u32,
    /// Number of the track, which is one aircraft in one view; null without tracking.
    pub track: Option<u32>,
    /// Search mode of the image.
    pub mode: SearchMode,
    /// Whether the box counts: its track has enough boxes and does not stand still (docs/tracks.md). True without tracking, false in rows
    /// without a box.
    pub confirmed: bool,
    /// True if the box counts at its tick, by the images up to it: its track has been confirmed by then, and does not stand still. Missing
    /// without tracking, false in rows without a box.
    pub counts_live: Option<bool>,
}

/// An image without a box.
#[derive(Debug, Clone, PartialEq, JsonSchema)]
pub struct Miss {
    /// Number of the tick.
    pub tick: u32,
    /// Identifier of the view.
    pub view: String,
    /// Search mode of the image.
    pub mode: SearchMode,
    /// The reason why it has no box. In the table, rows with a box have none, and rows with a reason have no numbers.
    pub reason: MissReason,
}

/// Search modes of images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, JsonSchema)]
#[schemars(rename_all = "kebab-case")]
pub enum SearchMode {
    /// The whole image, pixel by pixel.
    Full,
    /// Only where known tracks were expected.
    Tracked,
    /// The whole image, made smaller.
    Scaled,
}

/// Reasons why an image has no box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, JsonSchema)]
#[schemars(rename_all = "kebab-case")]
pub enum MissReason {
    /// The search found no box, or, in a shrunk image, only faint boxes that do not count.
    Nothing,
    /// The first pass found something that the second did not confirm, or only as a faint box that does not count.
    Refuted,
    /// The windows of the known tracks were empty, and the rest was not searched.
    Lost,
    /// There was no track to follow, and the next full search was not due.
    NotSearched,
}

words!(SearchMode, 3, {
    Full: "full",
    Tracked: "tracked",
    Scaled: "scaled",
});

words!(MissReason, 4, {
    Nothing: "nothing",
    Refuted: "refuted",
    Lost: "lost",
    NotSearched: "not-searched",
});

impl Detection {
    /// A box from a full search without tracking. It counts as confirmed, for lack of other evidence.
    pub fn untracked(
        tick: u32,
        view: impl Into<String>,
        pixel_box: PixelBox,
        score: f64,
        tile: u32,
    ) -> Self {
        Self {
            tick,
            view: view.into(),
            pixel_box,
            score,
            tile,
            track: None,
            mode: SearchMode::Full,
            confirmed: true,
            counts_live: None,
        }
    }
}

impl Detections {
    /// Writes `detections/<model>.parquet`, by tick.
    pub fn write(&self, path: &Path) -> Result<()> {
        let boxes = self.boxes.iter().cloned().map(Row::Box);
        let misses = self.misses.iter().cloned().map(Row::Miss);
        let mut rows: Vec<_> = boxes.chain(misses).collect();
        rows.sort_by_key(Row::tick);
        Row::write(&rows, path)
    }

    /// Reads the content of `detections/<model>.parquet` for this number of images; messages name it as `path`.
    ///
    /// # Errors
    /// A number is outside its limits, or a row has neither a whole box nor a known reason.
    pub fn parse(content: Vec<u8>, path: &Path, images: u64) -> Result<Self> {
        Ok(Row::parse(content, path, images)?.into())
    }

    /// The boxes that count.
    pub fn into_confirmed(self) -> impl Iterator<Item = Detection> {
        self.boxes.into_iter().filter(|found| found.confirmed)
    }
}

impl From<Vec<Detection>> for Detections {
    fn from(boxes: Vec<Detection>) -> Self {
        Self {
            boxes,
            misses: Vec::new(),
        }
    }
}

/// Missing in tables made without tracking.
const COUNTS_LIVE: &str = "counts_live";

/// Columns of boxes and their scores.
const SCORED_BOX: [NumberColumn; 5] = {
    let [cx, cy, width, height] = PixelBox::COLUMNS;
    [cx, cy, width, height, ("score", limits::SCORE)]
};

/// A row of the table.
#[derive(Debug, Clone, PartialEq)]
pub enum Row {
    /// A detected box.
    Box(Detection),
    /// An image without any.
    Miss(Miss),
}

impl Row {
    /// Number of the tick.
    pub fn tick(&self) -> u32 {
        match self {
            Self::Box(Detection { tick, .. }) | Self::Miss(Miss { tick, .. }) => *tick,
        }
    }

    /// Identifier of the view.
    pub fn view(&self) -> &String {
        match self {
            Self::Box(Detection { view, .. }) | Self::Miss(Miss { view, .. }) => view,
        }
    }

    fn mode(&self) -> SearchMode {
        match self {
            Self::Box(Detection { mode, .. }) | Self::Miss(Miss { mode, .. }) => *mode,
        }
    }

    fn found(&self) -> Option<&Detection> {
        match self {
            Self::Box(found) => Some(found),
            Self::Miss(_) => None,
        }
    }

    fn reason(&self) -> Option<MissReason> {
        match self {
            Self::Box(_) => None,
            Self::Miss(miss) => Some(miss.reason),
        }
    }
}

impl From<Vec<Row>> for Detections {
    /// Other programs may have written the rows in a different order.
    fn from(mut rows: Vec<Row>) -> Self {
        rows.sort_by_key(Row::tick);
        let mut detections = Self::default();
        for row in rows {
            match row {
                Row::Box(found) => detections.boxes.push(found),
                Row::Miss(miss) => detections.misses.push(miss),
            }
        }
        detections
    }
}

/// The table `detections/<model>.parquet`.
impl ImageRow for Row {
    const NAME: &'static str = "detections";
    const MAX_PER_IMAGE: u64 = limits::MAX_DETECTIONS_PER_PICTURE;

    fn columns(rows: &[Self]) -> TableWriter {
        let found = rows.iter().map(Self::found);
        let numbers = found.clone().map(|found| {
            let Detection {
                pixel_box, score, ..
            } = found?;
            let [cx, cy, width, height] = pixel_box.to_array();
            Some([cx, cy, width, height, *score])
        });
        let confirmed = |found: Option<&Detection>| found.is_some_and(|found| found.confirmed);
        let reasons = rows.iter().map(|row| row.reason().map(MissReason::word));
        let table = TableWriter::new()
            .u32("tick", rows.iter().map(Self::tick))
            .text("view", rows.iter().map(Self::view))
            .optional_numbers(SCORED_BOX, numbers)
            .optional_u32("tile", found.clone().map(|found| Some(found?.tile)))
            .optional_u32("track", found.clone().map(|found| found?.track))
            .text("mode", rows.iter().map(|row| row.mode().word()))
            .bool("confirmed", found.clone().map(confirmed))
            .optional_text("reason", reasons);
        let live = found.map(|found| found.map_or(Some(false), |found| found.counts_live));
        match live.collect::<Option<Vec<bool>>>() {
            Some(live) => table.bool(COUNTS_LIVE, live),
            None => table,
        }
    }

    fn of_table(table: &mut Table) -> Result<Vec<Self>> {
        let ticks = table.u32("tick")?;
        let boxes = table.optional_numbers(SCORED_BOX)?;
        let tiles = table.optional_u32("tile")?;
        let tracks = table.optional_u32("track")?;
        let modes = table.words::<SearchMode>("mode")?;
        let confirmed = table.bool("confirmed")?;
        let live = if table.has(COUNTS_LIVE) {
            Some(table.bool(COUNTS_LIVE)?)
        } else {
            None
        };
        let reasons = table.optional_words::<MissReason>("reason")?;
        let keys = ticks.into_iter().zip(table.text("view")?).enumerate();
        keys.map(|(row, (tick, view))| {
            let mode = modes[row];
            match (boxes[row], tiles[row], reasons[row]) {
                (Ok([cx, cy, width, height, score]), Some(tile), None) => {
                    Ok(Self::Box(Detection {
                        tick,
                        view,
                        pixel_box: PixelBox::of_array([cx, cy, width, height]),
                        score,
                        tile,
                        track: tracks[row],
                        mode,
                        confirmed: confirmed[row],
                        counts_live: live.as_ref().map(|live| live[row]),
                    }))
                }
                (Err(0), None, Some(reason)) => Ok(Self::Miss(Miss {
                    tick,
                    view,
                    mode,
                    reason,
                })),
                (numbers, tile, reason) => {
                    let count = numbers.map_or_else(|count| count, |all| all.len());
                    let counts = [count + usize::from(tile.is_some()), SCORED_BOX.len() + 1];
                    Err(table.neither_whole_nor_absent(row, counts, reason))
                }
            }
        })
        .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(tick: u32, track: Option<u32>) -> Detection {
        let pixel_box = PixelBox::from_edges(10.0, 20.0, 30.0, 26.0);
        Detection {
            track,
            ..Detection::untracked(tick, "left", pixel_box, 0.75, 2)
        }
    }

    fn sample() -> Detections {
        let miss = |tick, mode, reason| Miss {
            tick,
            view: "left".into(),
            mode,
            reason,
        };
        Detections {
            boxes: vec![
                found(0, None),
                Detection {
                    mode: SearchMode::Tracked,
                    confirmed: false,
                    ..found(2, Some(7))
                },
                Detection {
                    mode: SearchMode::Scaled,
                    ..found(6, Some(0))
                },
            ],
            misses: vec![
                miss(1, SearchMode::Full, MissReason::Nothing),
                miss(3, SearchMode::Tracked, MissReason::Lost),
                miss(4, SearchMode::Tracked, MissReason::NotSearched),
                miss(5, SearchMode::Scaled, MissReason::Refuted),
            ],
        }
    }

    fn read(path: &Path) -> Result<Detections> {
        Detections::parse(std::fs::read(path).unwrap(), path, 7)
    }

    #[test]
    fn boxes_and_misses_are_read_back_as_written_and_lie_in_the_order_of_ticks() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc.parquet");
        let mut live = sample();
        for found in &mut live.boxes {
            found.counts_live = Some(found.tick > 0);
        }
        for detections in [sample(), live, Detections::default()] {
            detections.write(&path).unwrap();
            assert_eq!(read(&path).unwrap(), detections);
        }
        sample().write(&path).unwrap();
        let ticks = Table::read(&path, 7).unwrap().u32("tick").unwrap();
        assert_eq!(ticks, [0, 1, 2, 3, 4, 5, 6]);
    }

    /// A table with one row, without mode and reason.
    fn row_of(numbers: [Option<f64>; 5], tile: Option<u32>) -> TableWriter {
        let table = TableWriter::new().u32("tick", [0]).text("view", ["left"]);
        ["cx_px", "cy_px", "width_px", "height_px", "score"]
            .into_iter()
            .zip(numbers)
            .fold(table, |table, (name, number)| {
                table.optional_f64(name, [number])
            })
            .optional_u32("tile", [tile])
            .optional_u32("track", [None])
            .bool("confirmed", [true])
    }

    const WHOLE: [Option<f64>; 5] = [Some(20.0), Some(23.0), Some(20.0), Some(6.0), Some(0.75)];

    #[test]
    fn a_row_with_half_a_box_an_unknown_word_or_neither_box_nor_reason_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc.parquet");
        let mut half = WHOLE;
        half[3] = None;
        for (numbers, tile, mode, reason, words) in [
            (
                half,
                Some(2),
                "full",
                None,
                "row 0 has 5 of 6 numbers and no reason",
            ),
            (
                WHOLE,
                None,
                "full",
                None,
                "row 0 has 5 of 6 numbers and no reason",
            ),
            (
                WHOLE,
                Some(2),
                "full",
                Some("lost"),
                "row 0 has 6 of 6 numbers and reason \"lost\"",
            ),
            (
                [None; 5],
                None,
                "full",
                None,
                "row 0 has 0 of 6 numbers and no reason",
            ),
            (
                [None; 5],
                None,
                "full",
                Some("odd"),
                "reason is \"odd\", expected one of nothing, refuted",
            ),
            (
                WHOLE,
                Some(2),
                "half",
                None,
                "mode is \"half\", expected one of full, tracked",
            ),
        ] {
            row_of(numbers, tile)
                .text("mode", [mode])
                .optional_text("reason", [reason])
                .write(&path)
                .unwrap();
            let message = read(&path).unwrap_err().to_string();
            assert!(message.contains(words), "{message}");
        }
    }

    #[test]
    fn a_box_beyond_the_limits_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let mut detections = sample();
        detections.boxes[1].pixel_box.width_px = f64::NAN;
        let path = folder.path().join("abc.parquet");
        assert!(detections.write(&path).is_err());
    }
}
