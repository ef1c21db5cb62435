//! Bounding boxes, and the table of the ground truth (`boxes_truth.parquet`). The table of detected boxes is in
//! [`crate::corpus::detections`].
//!
//! Pixel (0, 0) is the centre of the top-left pixel, so a box that covers exactly that pixel has its centre at (0, 0) and is one pixel
//! wide.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::numbers::limits;
use crate::tables::columns::{Table, TableWriter};
use crate::tables::image_rows::ImageRow;
use crate::tables::row_parts::{NumberColumn, Numbers, numbers};

/// A detector is expected to find the aircraft if more than this part is in the image.
const EXPECTED_VISIBLE_FRACTION: f64 = 0.5;

/// An axis-parallel box, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PixelBox {
    /// Centre of the box, pixels to the right.
    pub cx_px: f64,
    /// Centre of the box, pixels down.
    pub cy_px: f64,
    /// Width of the box, pixels.
    pub width_px: f64,
    /// Height of the box, pixels.
    pub height_px: f64,
}

numbers!(PixelBox, 4, {
    cx_px: limits::BOX_PLACE_PX,
    cy_px: limits::BOX_PLACE_PX,
    width_px: limits::BOX_SIZE_PX,
    height_px: limits::BOX_SIZE_PX,
});

impl PixelBox {
    /// The box with these edges.
    pub fn from_edges(left: f64, top: f64, right: f64, bottom: f64) -> Self {
        Self {
            cx_px: (left + right) / 2.0,
            cy_px: (top + bottom) / 2.0,
            width_px: right - left,
            height_px: bottom - top,
        }
    }

    /// Left, top, right and bottom edge.
    pub fn edges(&self) -> [f64; 4] {
        let (half_width, half_height) = (self.width_px / 2.0, self.height_px / 2.0);
        [
            self.cx_px - half_width,
            self.cy_px - half_height,
            self.cx_px + half_width,
            self.cy_px + half_height,
        ]
    }

    /// Area, square pixels.
    pub fn area(&self) -> f64 {
        self.width_px.max(0.0) * self.height_px.max(0.0)
    }

    /// The part inside an image of this size, or `None` if it is entirely outside.
    pub fn clipped_to(&self, picture_width_px: u32, picture_height_px: u32) -> Option<Self> {
        let [left, top, right, bottom] = self.edges();
        let clipped = Self::from_edges(
            left.max(-0.5),
            top.max(-0.5),
            right.min(f64::from(picture_width_px) - 0.5),
            bottom.min(f64::from(picture_height_px) - 0.5),
        );
        (clipped.width_px > 0.0 && clipped.height_px > 0.0).then_some(clipped)
    }

    /// Area of the overlap with a second box, square pixels.
    pub fn intersection(&self, other: &Self) -> f64 {
        let [a, b] = [self.edges(), other.edges()];
        let width = (a[2].min(b[2]) - a[0].max(b[0])).max(0.0);
        let height = (a[3].min(b[3]) - a[1].max(b[1])).max(0.0);
        width * height
    }

    /// Intersection over union with a second box, 0 to 1.
    pub fn iou(&self, other: &Self) -> f64 {
        let intersection = self.intersection(other);
        let union = self.area() + other.area() - intersection;
        if union > 0.0 {
            intersection / union
        } else {
            0.0
        }
    }
}

/// The ground-truth box of the aircraft in one view at one tick.
#[derive(Debug, Clone, PartialEq, JsonSchema)]
pub struct TruthBox {
    /// Number of the tick.
    pub tick: u32,
    /// Identifier of the view.
    pub view: String,
    /// Class name: always `aircraft`.
    pub class: String,
    /// Box of the projected mesh, clipped to the image.
    pub pixel_box: PixelBox,
    /// Part of the aircraft's silhouette that is inside the image and above the ground; clouds are ignored.
    pub visible_fraction: f64,
    /// Part of the unclipped box that is outside the image.
    pub truncation: f64,
    /// Share of contrast that remains over this distance: `exp(-3.912 * range / visibility)`.
    pub transmission: f64,
    /// Only in scenarios with traffic: number of the aircraft, 0 the first.
    pub aircraft_number: Option<u32>,
    /// Only in scenarios with traffic: part of the visible silhouette that nearer aircraft hide.
    pub occluded_fraction: Option<f64>,
}

const OCCLUDED: &str = "occluded_fraction";
const RATIOS: [NumberColumn; 3] = [
    ("visible_fraction", limits::RATIO),
    ("truncation", limits::RATIO),
    ("transmission", limits::RATIO),
];

impl TruthBox {
    /// True if a detector is expected to find this aircraft: most is in the image, and not behind other aircraft.
    pub fn is_expected(&self) -> bool {
        let shown = 1.0 - self.occluded_fraction.unwrap_or(0.0);
        self.visible_fraction * shown > EXPECTED_VISIBLE_FRACTION
    }

    /// Number of the aircraft: 0, the first one, without traffic.
    pub fn number(&self) -> u32 {
        self.aircraft_number.unwrap_or(0)
    }

    /// True if it is the box of the first aircraft, whose distance the scenario is about.
    pub fn is_of_first(&self) -> bool {
        self.number() == 0
    }

    /// The table with all its columns, also those that only scenarios with traffic have.
    pub fn columns_with_traffic(boxes: &[Self]) -> TableWriter {
        let occluded = boxes.iter().map(|b| b.occluded_fraction.unwrap_or(0.0));
        Self::columns_of_one(boxes)
            .u32("aircraft_number", boxes.iter().map(Self::number))
            .f64_within(OCCLUDED, limits::RATIO, occluded)
    }

    fn columns_of_one(boxes: &[Self]) -> TableWriter {
        let boxes = boxes.iter();
        let ratios = |b: &Self| [b.visible_fraction, b.truncation, b.transmission];
        TableWriter::new()
            .u32("tick", boxes.clone().map(|b| b.tick))
            .text("view", boxes.clone().map(|b| &b.view))
            .text("class", boxes.clone().map(|b| &b.class))
            .numbers(
                PixelBox::COLUMNS,
                boxes.clone().map(|b| b.pixel_box.to_array()),
            )
            .numbers(RATIOS, boxes.map(ratios))
    }
}

/// The table `boxes_truth.parquet`.
impl ImageRow for TruthBox {
    const NAME: &'static str = "boxes";

    fn columns(boxes: &[Self]) -> TableWriter {
        if boxes.iter().any(|b| b.aircraft_number.is_some()) {
            Self::columns_with_traffic(boxes)
        } else {
            Self::columns_of_one(boxes)
        }
    }

    fn of_table(table: &mut Table) -> Result<Vec<Self>> {
        let tick = table.u32("tick")?;
        let boxes = table.numbers(PixelBox::COLUMNS)?;
        let ratios = table.numbers(RATIOS)?;
        let numbers = if table.has("aircraft_number") {
            let occluded = table.f64_within(OCCLUDED, limits::RATIO)?;
            Some((table.u32("aircraft_number")?, occluded))
        } else {
            None
        };
        let words = table.text("view")?.into_iter().zip(table.text("class")?);
        Ok(words
            .enumerate()
            .map(|(row, (view, class))| {
                let [visible_fraction, truncation, transmission] = ratios[row];
                Self {
                    tick: tick[row],
                    view,
                    class,
                    pixel_box: PixelBox::of_array(boxes[row]),
                    visible_fraction,
                    truncation,
                    transmission,
                    aircraft_number: numbers.as_ref().map(|(number, _)| number[row]),
                    occluded_fraction: numbers.as_ref().map(|(_, occluded)| occluded[row]),
                }
            })
            .collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> PixelBox {
        PixelBox {
            cx_px: 0.0,
            cy_px: 0.0,
            width_px: 2.0,
            height_px: 4.0,
        }
    }

    #[test]
    fn a_box_half_outside_the_picture_keeps_the_inner_part() {
        let inner = sample().clipped_to(100, 100).unwrap();
        assert_eq!(inner.edges(), [-0.5, -0.5, 1.0, 2.0]);
        assert_eq!(
            PixelBox {
                cx_px: -9.0,
                ..sample()
            }
            .clipped_to(100, 100),
            None
        );
    }

    #[test]
    fn iou_of_a_box_with_itself_is_one_and_with_its_half_is_a_half() {
        assert_eq!(sample().iou(&sample()), 1.0);
        assert_eq!(
            sample().iou(&PixelBox {
                height_px: 2.0,
                ..sample()
            }),
            0.5
        );
        assert_eq!(
            sample().iou(&PixelBox {
                cx_px: 50.0,
                ..sample()
            }),
            0.0
        );
    }

    #[test]
    fn truth_boxes_are_read_back_as_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("boxes.parquet");
        let truth = vec![TruthBox {
            tick: 3,
            view: "left".into(),
            class: "aircraft".into(),
            pixel_box: sample(),
            visible_fraction: 0.5,
            truncation: 0.25,
            transmission: 0.9,
            aircraft_number: None,
            occluded_fraction: None,
        }];
        TruthBox::write(&truth, &path).unwrap();
        let read = TruthBox::read_with_faults(&path, 1).unwrap();
        assert_eq!(read, (truth.clone(), vec![]));

        let numbered = vec![TruthBox {
            aircraft_number: Some(2),
            occluded_fraction: Some(0.25),
            visible_fraction: 0.8,
            ..truth[0].clone()
        }];
        TruthBox::write(&numbered, &path).unwrap();
        let read = TruthBox::read_with_faults(&path, 1).unwrap();
        assert_eq!(read, (numbered.clone(), vec![]));
        assert!(numbered[0].is_expected() && !numbered[0].is_of_first());
        let hidden = TruthBox {
            occluded_fraction: Some(0.5),
            ..numbered[0].clone()
        };
        assert!(!hidden.is_expected());
    }
}
