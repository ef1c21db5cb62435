//! Crops around the aircraft, for training at full rate: a sample is a tick at which every view has a box, and shows the surroundings of
//! that box in each.
//!
//! A crop has the pixels of its image, and always the same size: at an edge it is moved into the image, not padded. A box larger than
//! the crop leaves it on both sides. Samples of all scenarios of a side are mixed ([`super::mixed_shards`]).

use dataset::corpus::calibration::CameraEntry;
use dataset::tables::pixel_box::PixelBox;
use serde::Serialize;
use serde_json::Value;

use super::mixed_shards::{self, Stored, Unmixed};
use super::samples::{Decoded, LabelledCorners, each_sample};
use crate::about::split_of;
use crate::error::{Error, Result};
use crate::file_format::{Export, FileFormat, Writing, Written};
use crate::request::{Abilities, BoxUse};
use crate::scenarios::{LabelledBox, Source};

/// The box that a crop is around: of several, the one with the best score.
fn target(boxes: &[LabelledBox]) -> Option<PixelBox> {
    let mut boxes = boxes.iter();
    let first = boxes.next()?;
    let best = boxes.fold(first, |best, other| {
        if other.score > best.score {
            other
        } else {
            best
        }
    });
    Some(best.pixel_box)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
struct Crop {
    left_px: u32,
    top_px: u32,
    width_px: u32,
    height_px: u32,
}

impl Crop {
    /// The crop around a box, moved into the image, which is at least as large.
    fn around(
        target: &PixelBox,
        [width_px, height_px]: [u32; 2],
        [picture_width_px, picture_height_px]: [u32; 2],
    ) -> Self {
        let start = |centre_px: f64, side_px: u32, picture_px: u32| {
            let start = (centre_px - f64::from(side_px - 1) / 2.0).round_ties_even();
            start.clamp(0.0, f64::from(picture_px.saturating_sub(side_px))) as u32
        };
        Self {
            left_px: start(target.cx_px, width_px, picture_width_px),
            top_px: start(target.cy_px, height_px, picture_height_px),
            width_px,
            height_px,
        }
    }

    /// Reduces an image to the crop.
    fn cut(self, picture: &mut Decoded) {
        let [width, left, top] =
            [picture.size_px[0], self.left_px, self.top_px].map(|px| px as usize);
        let row_bytes = 3 * self.width_px as usize;
        for row in 0..self.height_px as usize {
            let start = 3 * ((top + row) * width + left);
            let pixels = start..start + row_bytes;
            picture.rgb.copy_within(pixels, row * row_bytes);
        }
        picture.rgb.truncate(row_bytes * self.height_px as usize);
        picture.size_px = [self.width_px, self.height_px];
    }
}

/// Boxes are in the crop's pixels and may lie outside it.
#[derive(Serialize)]
struct View<'a> {
    crop: Crop,
    #[serde(skip_serializing_if = "Option::is_none")]
    truth: Option<Vec<LabelledCorners>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    detections: Option<Vec<LabelledCorners>>,
    /// Calibration for the whole image.
    calibration: &'a CameraEntry,
}

/// Cuts a view's image, and describes the crop.
fn cropped<'a>(
    source: &'a Source<'_>,
    crop_px: [u32; 2],
    view: &str,
    tick: u32,
    picture: &mut Decoded,
) -> Result<View<'a>> {
    let boxes = source.boxes_of(view, tick);
    let Some(target) = target(boxes) else {
        unreachable!("a sample has a box in each view");
    };
    let crop = Crop::around(&target, crop_px, picture.size_px);
    crop.cut(picture);
    let all = || boxes.iter().chain(source.beside(view, tick));
    let of_kind = |is_there: bool, is_of_kind: fn(&LabelledBox) -> bool| {
        let corners = |labelled| LabelledCorners::within([crop.left_px, crop.top_px], labelled);
        let boxes = || all().filter(|labelled| is_of_kind(labelled)).map(corners);
        is_there.then(|| boxes().collect())
    };
    Ok(View {
        crop,
        truth: of_kind(source.has_truth, |labelled| labelled.truth.is_some()),
        detections: of_kind(source.model.is_some(), |labelled| labelled.score.is_some()),
        calibration: source.view(view)?.1,
    })
}

/// The format.
pub(in crate::formats) struct Crops;

impl FileFormat for Crops {
    fn abilities(&self) -> Abilities {
        Abilities {
            boxes: BoxUse::Crops,
            has_shards: true,
            ..Abilities::of_stills("crops")
        }
    }

    /// Refuses crops that are larger than an image.
    fn check(&mut self, source: &Source<'_>, export: &Export<'_>) -> Result<()> {
        let crop_px = export.request.crop_px();
        for view in &source.selected.views {
            let camera = source.view(view)?.1;
            let picture_px = [camera.width_px, camera.height_px];
            if crop_px[0] > picture_px[0] || crop_px[1] > picture_px[1] {
                let id = &source.record.id;
                let ([width, height], [most_width, most_height]) = (crop_px, picture_px);
                return Err(Error::Request(format!(
                    "scenario {id}, view {view}: a crop of {width}x{height} px does not fit into images of {most_width}x{most_height} px; \
                     choose a smaller one with --crop-px"
                )));
            }
        }
        Ok(())
    }

    /// Writes the samples, which are mixed with other scenarios later.
    fn write(&self, scenario: &Writing<'_>) -> Result<Value> {
        let source = &scenario.source;
        let mut unmixed = Unmixed::create(&scenario.folder, &source.record.id)?;
        let crop_px = scenario.export.request.crop_px();
        let show =
            |view: &str, tick, picture: &mut _| cropped(source, crop_px, view, tick, picture);
        let path = unmixed.path().to_owned();
        let append = |tick, entries: Vec<u8>| unmixed.append(tick, &entries);
        each_sample(scenario, &path, show, append)?;
        scenario.part(&unmixed.finish()?)
    }

    fn finish(&self, written: &Written<'_>) -> Result<()> {
        let scenarios = written
            .export
            .scenarios
            .iter()
            .zip(written.parts::<Vec<Stored>>());
        let stored = scenarios.map(|(scenario, stored)| {
            let selected = &scenario.selected;
            Ok((selected.id(), split_of(selected.side), stored?))
        });
        let shards = written.export.request.shards();
        mixed_shards::mix(&written.folder(), shards, stored, written.watch)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(cx_px: f64, score: Option<f64>) -> LabelledBox {
        LabelledBox {
            pixel_box: PixelBox {
                cx_px,
                cy_px: 5.0,
                width_px: 4.0,
                height_px: 2.0,
            },
            score,
            truth: None,
        }
    }

    #[test]
    fn a_crop_is_around_the_box_with_the_best_score() {
        let boxes = [0.4, 0.9, 0.9, 0.1].map(Some);
        let boxes: Vec<_> = (0..4)
            .map(|at| found(f64::from(at), boxes[at as usize]))
            .collect();
        assert_eq!(target(&boxes).unwrap().cx_px, 1.0);
        assert_eq!(target(&[found(7.0, None)]).unwrap().cx_px, 7.0);
        assert!(target(&[]).is_none());
    }

    #[test]
    fn a_crop_is_centred_on_its_box_and_moved_into_the_picture_at_every_edge() {
        let corner = |cx_px, cy_px| {
            let target = PixelBox {
                cx_px,
                cy_px,
                width_px: 3.0,
                height_px: 3.0,
            };
            let crop = Crop::around(&target, [8, 5], [40, 30]);
            assert_eq!([crop.width_px, crop.height_px], [8, 5]);
            [crop.left_px, crop.top_px]
        };
        // Pixels 17 to 24 and 8 to 12: the crop is centred on the box.
        assert_eq!(corner(20.5, 10.0), [17, 8]);
        assert_eq!(corner(0.0, 0.0), [0, 0]);
        assert_eq!(corner(39.0, 29.0), [32, 25]);
        assert_eq!(corner(-50.0, 100.0), [0, 25]);
    }

    #[test]
    fn a_crop_has_the_pixels_of_its_place() {
        let picture: Vec<u8> = (0..6 * 4).flat_map(|pixel| [pixel, 100, 200]).collect();
        let crop = Crop {
            left_px: 2,
            top_px: 1,
            width_px: 3,
            height_px: 2,
        };
        let mut picture = Decoded {
            rgb: picture,
            size_px: [6, 4],
        };
        crop.cut(&mut picture);
        let reds: Vec<u8> = picture.rgb.iter().step_by(3).copied().collect();
        assert_eq!(reds, [8, 9, 10, 14, 15, 16]);
        assert_eq!((picture.rgb.len(), picture.size_px), (18, [3, 2]));
    }
}
