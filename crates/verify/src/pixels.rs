//! Compares the ground-truth boxes with the pixels: does every image show the aircraft where and when the tables say?
//!
//! Input: a view's decoded images, one by one, and the ground-truth boxes of the scenario. Each box that is clear enough is examined
//! ([`sight`]). Then all boxes are judged together:
//!
//! - **Filled**: something stands out from the sky in the box. If most boxes in a view are empty, its images belong to a different
//!   view or flight; if single ones are, those images are wrong.
//! - **In step**: what stands out is in the centre of the box. A part of the offset that is proportional to the speed in the image is a
//!   time shift: a late view, which the outline of the aircraft shows ([`lag`]), or images of other ticks ([`timing`]).
//! - **Moving**: an image that equals an earlier one is frozen if the aircraft moved by a pixel in between.
//! - **Not elsewhere**: an image with an empty box that shows the aircraft at a different tick's or view's place is from there
//!   ([`elsewhere`]).
//! - **The same scene**: outside the aircraft an image equals the view's others, and no image is noise ([`scene`]).
//! - **Before a sky**: behind an aircraft in the air the background is smooth. If it is rough in most places, the images show no sky.
//!
//! With traffic, the boxes of the first aircraft are examined, except where another one is near.
//!
//! A box is clear enough if it is complete, above the ground, below all clouds, before a smooth background, and has at least a transmission
//! of [`MIN_TRANSMISSION`]: there an aircraft is visible in any weather. A view without clear boxes proves little; the report lists it.

mod elsewhere;
mod lag;
mod moving_image;
mod outline;
mod repeated;
mod scene;
mod sight;
mod timing;

use serde::Serialize;

use crate::faults::Faults;
use dataset::corpus::calibration::Calibration;
use dataset::corpus::scenario::ScenarioRecord;
use dataset::numbers::spread::median_of;
use dataset::tables::frames::Frames;
use dataset::tables::pixel_box::{PixelBox, TruthBox};
use elsewhere::{Other, Suspect};
pub use lag::PairProof;
pub(super) use lag::judge_lags;
use lag::{Lag, MeasuredView, Offset};
use moving_image::MovingImage;
use repeated::Reference;
use scene::CoarsePicture;
use sight::{BoxContent, DecodedPicture, look};

/// Minimum transmission. With 50 grey levels of scene contrast this leaves 10, twice that of the noisiest background that counts as
/// smooth.
const MIN_TRANSMISSION: f64 = 0.2;
/// Motion of a box between two images that pixels show in any case, pixels.
const MIN_MOTION_PX: f64 = 1.0;
/// Part of the silhouette that must be visible.
const MIN_VISIBLE: f64 = 0.99;
/// Minimum height over the target, metres: below it the aircraft is in front of ground, buildings and lights.
const MIN_HEIGHT_M: f64 = 30.0;
/// Minimum number of clear boxes: with fewer the share of filled ones says nothing about a view; single images are judged all the same.
const MIN_BOXES: usize = 5;
/// At least this part of the clear boxes is filled in the images of the right view; sometimes paint and sky have the same grey, in the
/// worst of the measured scenarios (clouds at noon) in 37 of 100 boxes. In swapped views a tenth was filled.
const MIN_FILLED: f64 = 0.3;
/// An empty box is a fault only if its contrast, by the other boxes and the air, is this many times the visible minimum.
const MIN_TIMES_VISIBLE: f64 = 3.0;
/// The images show no sky if less than this part of the boxes that would be clear has a smooth background ...
const MIN_SMOOTH: f64 = 0.3;
/// ... and the noise of the background is this many grey levels. In the measured scenarios it is below 4.
const MIN_ROUGH: f64 = 20.0;

/// Facts about a scenario before its videos are read.
pub(super) struct Scenario<'a> {
    pub(super) record: &'a ScenarioRecord,
    pub(super) frames: Option<&'a Frames>,
    pub(super) boxes: &'a [TruthBox],
    /// Cameras of the scenario, if they can be read.
    pub(super) calibration: Option<&'a Calibration>,
}

impl Scenario<'_> {
    /// Places of other aircraft and of boxes that are not examined, by tick.
    fn traffic(&self, view: &str) -> Vec<Vec<PixelBox>> {
        let mut by_tick = vec![Vec::new(); self.record.ticks as usize];
        for truth in self.boxes {
            let is_other = !truth.is_of_first() || self.is_near_another(truth);
            if truth.view == view
                && is_other
                && let Some(places) = by_tick.get_mut(truth.tick as usize)
            {
                places.push(truth.pixel_box);
            }
        }
        by_tick
    }

    /// True if another aircraft is in the surroundings of a box, or in front of it.
    fn is_near_another(&self, truth: &TruthBox) -> bool {
        if self.record.traffic.is_empty() {
            return false;
        }
        let longer_px = truth.pixel_box.width_px.max(truth.pixel_box.height_px);
        let around = PixelBox {
            width_px: truth.pixel_box.width_px + 2.0 * longer_px,
            height_px: truth.pixel_box.height_px + 2.0 * longer_px,
            ..truth.pixel_box
        };
        let of_tick = self.boxes.partition_point(|of| of.tick < truth.tick);
        let of_tick = self.boxes[of_tick..]
            .iter()
            .take_while(|of| of.tick == truth.tick);
        let mut others =
            of_tick.filter(|of| of.view == truth.view && of.number() != truth.number());
        others.any(|other| other.pixel_box.intersection(&around) > 0.0)
    }

    fn motion_of(&self, view: &str) -> Option<MovingImage> {
        MovingImage::of(self.calibration?.cameras.get(view)?)
    }
}

/// Evidence from a view's images.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct ViewProof {
    /// Identifier of the scenario.
    pub scenario: String,
    /// Identifier of the view.
    pub view: String,
    /// Images decoded.
    pub pictures: u64,
    /// Ground-truth boxes that are clear enough to show the aircraft.
    pub clear_boxes: usize,
    /// Boxes that would be clear, but have no smooth background.
    pub rough_boxes: usize,
    /// Clear boxes with something that stands out.
    pub filled_boxes: usize,
    /// Ticks of the others.
    pub not_filled: Vec<u32>,
    /// Images that could not be of the next tick: there the aircraft would be visibly elsewhere. The others are undecidable.
    pub decided_pictures: usize,
    /// Median distance between the visible object's centre and the box's centre, pixels.
    pub offset_px: Option<f64>,
    /// Lag of the images behind the tables, milliseconds.
    pub lag_ms: Option<f64>,
    /// Standard error of the lag, milliseconds.
    pub lag_error_ms: Option<f64>,
}

/// Examines a view's images as they are decoded.
pub(super) struct Watcher<'a> {
    view: &'a str,
    scenario: &'a Scenario<'a>,
    /// Ground-truth boxes of this view by tick, with their rows.
    boxes: Vec<Option<(usize, &'a TruthBox)>>,
    /// Places of the boxes in the images, which air and mast may move, by tick.
    places: Vec<Option<PixelBox>>,
    /// Places of other aircraft, by tick.
    traffic: Vec<Vec<PixelBox>>,
    /// Places in the other views.
    others: Vec<(&'a str, Vec<Option<PixelBox>>)>,
    seen: Vec<ImageSighting>,
    /// All images, coarsely.
    coarse: Vec<CoarsePicture>,
    /// Images that seem to be from a different tick or view.
    suspects: Vec<Suspect>,
    /// The image that later ones must differ from.
    reference: Reference,
}

/// Observations in one image.
#[derive(Default)]
struct ImageSighting {
    sight: Option<BoxContent>,
    /// The earlier image that this one repeats, though the aircraft moved by this many pixels.
    repeats: Option<(usize, f64)>,
    /// For each other view, whether its box, outside this view's, is filled.
    others: Vec<Option<bool>>,
}

/// A clear box and its content.
struct ClearBox<'a> {
    tick: usize,
    row: usize,
    truth: &'a TruthBox,
    sight: BoxContent,
}

impl<'a> Watcher<'a> {
    pub(super) fn new(view: &'a str, scenario: &'a Scenario<'a>) -> Self {
        let of = |view: &str| {
            let mut by_tick = vec![None; scenario.record.ticks as usize];
            for (row, truth) in scenario.boxes.iter().enumerate() {
                if truth.view == view
                    && truth.is_of_first()
                    && !scenario.is_near_another(truth)
                    && let Some(place) = by_tick.get_mut(truth.tick as usize)
                {
                    *place = Some((row, truth));
                }
            }
            by_tick
        };
        let places = |view: &str, boxes: &[Option<(usize, &TruthBox)>]| {
            let moving = scenario.motion_of(view);
            let boxes = boxes.iter().enumerate();
            boxes
                .map(|(tick, found)| {
                    let place = found.map(|(_, truth)| truth.pixel_box)?;
                    let row = scenario.frames.and_then(|frames| frames.rows.get(tick));
                    let moved = moving.as_ref().zip(row);
                    Some(moved.map_or(place, |(moving, row)| moving.place(place, row)))
                })
                .collect::<Vec<_>>()
        };
        let boxes = of(view);
        Self {
            view,
            scenario,
            places: places(view, &boxes),
            traffic: scenario.traffic(view),
            boxes,
            others: scenario
                .record
                .views
                .iter()
                .filter(|other| *other != view)
                .map(|other| (other.as_str(), places(other, &of(other))))
                .collect(),
            seen: Vec::new(),
            coarse: Vec::new(),
            suspects: Vec::new(),
            reference: Reference::default(),
        }
    }

    /// True if there is anything to check.
    pub(super) fn is_needed(&self) -> bool {
        !self.scenario.boxes.is_empty()
    }

    /// Examines the next image.
    pub(super) fn see(&mut self, rgb: &[u8], width_px: u32, height_px: u32) {
        let tick = self.seen.len();
        let picture = DecodedPicture::new(rgb, width_px, height_px);
        let own = self.places.get(tick).copied().flatten();
        let mut seen = ImageSighting::default();
        let all: Vec<PixelBox> = (self.traffic.get(tick).into_iter().flatten().copied())
            .chain(own)
            .collect();
        self.coarse.push(CoarsePicture::of(&picture, &all));
        if let Some(own) = own {
            seen.sight = look(&picture, &own);
            let would_be_seen = self.would_be_seen(tick);
            let sight = seen.sight;
            seen.repeats = (self.reference).repeated(tick, &picture, &own, sight, would_be_seen);
            let is_empty = seen.sight.is_some_and(|sight| {
                sight.is_empty() && (sight.is_before_smooth() || self.is_above_ground(tick))
            });
            if is_empty && seen.repeats.is_none() && would_be_seen {
                let suspect = Suspect::find(&picture, tick, &own, self.other_places(tick));
                self.suspects.extend(suspect);
            }
        }
        for (_, boxes) in &self.others {
            let other = boxes.get(tick).copied().flatten();
            let apart = other.filter(|other| own.is_none_or(|own| own.iou(other) == 0.0));
            let filled = apart.and_then(|other| look(&picture, &other));
            seen.others.push(filled.map(|sight| sight.is_filled()));
        }
        self.seen.push(seen);
    }

    /// Places of the aircraft in images of other ticks and views.
    fn other_places(&self, tick: usize) -> impl Iterator<Item = (Other, PixelBox)> {
        let ticks = Suspect::ticks_near(tick, self.boxes.len()).filter_map(|other| {
            let (_, truth) = self.boxes[other]?;
            let place = self.places[other].filter(|_| truth.truncation == 0.0)?;
            Some((Other::Tick(other), place))
        });
        let views = self.others.iter().filter_map(move |(view, boxes)| {
            let place = boxes.get(tick).copied().flatten()?;
            Some((Other::View((*view).to_owned()), place))
        });
        ticks.chain(views)
    }

    /// True if some images have to be compared with all others.
    pub(super) fn wants_second_look(&self) -> bool {
        !self.suspects.is_empty()
    }

    /// Compares the suspects with an image, in a second pass over the video.
    pub(super) fn see_again(&mut self, tick: usize, rgb: &[u8], width_px: u32, height_px: u32) {
        let Some(own) = self.places.get(tick).copied().flatten() else {
            return;
        };
        let sight = self.seen.get(tick).and_then(|seen| seen.sight);
        if sight.is_some_and(|sight| sight.is_filled()) {
            let picture = DecodedPicture::new(rgb, width_px, height_px);
            for suspect in &mut self.suspects {
                suspect.compare(&picture, tick, &own);
            }
        }
    }

    /// Judges all images together; returns the lag as well if it could be measured. `file`: the video.
    pub(super) fn judge(
        self,
        file: &str,
        faults: &mut Faults,
    ) -> (ViewProof, Option<MeasuredView<'a>>) {
        let (clear, rough) = self.boxes_before_the_sky();
        let filled: Vec<&ClearBox> = clear.iter().filter(|b| b.sight.is_filled()).collect();
        let mut proof = ViewProof {
            view: self.view.to_owned(),
            pictures: self.seen.len() as u64,
            clear_boxes: clear.len(),
            rough_boxes: rough.len(),
            filled_boxes: filled.len(),
            not_filled: (clear.iter().filter(|found| !found.sight.is_filled()))
                .map(|found| found.tick as u32)
                .collect(),
            ..ViewProof::default()
        };
        self.check_moving(file, faults);
        scene::judge(&self.coarse, file, self.view, faults);
        self.check_sky(&clear, &rough, file, faults);
        let enough = clear.len() >= MIN_BOXES;
        if enough && (filled.len() as f64) < MIN_FILLED * clear.len() as f64 {
            let message = format!(
                "the aircraft is visible in {} of {} ground-truth boxes that are clear enough to show it{}",
                filled.len(),
                clear.len(),
                self.hint()
            );
            faults.view(file, self.view, message);
            return (proof, None);
        }
        let elsewhere: Vec<usize> = (self.suspects.iter())
            .filter(|suspect| suspect.judge(file, self.view, faults))
            .map(|suspect| suspect.tick)
            .collect();
        if enough {
            let others: Vec<&ClearBox> = (clear.iter())
                .filter(|found| !elsewhere.contains(&found.tick))
                .collect();
            self.check_filled(&others, &filled, file, faults);
        }
        let points: Vec<timing::Point> = filled
            .iter()
            .filter_map(|found| self.point(found))
            .collect();
        let period_s = self.scenario.record.frame_rate.period_s();
        proof.decided_pictures = timing::check(&points, period_s, file, self.view, faults);
        proof.offset_px = median_of(points.iter().map(|point| point.offset_px.length()));
        let offsets: Vec<Offset> = (filled.iter())
            .filter_map(|found| self.offsets(found, period_s))
            .flatten()
            .collect();
        let measured = Lag::of(&offsets).map(|lag| {
            proof.lag_ms = Some(lag.lag_s * 1e3);
            proof.lag_error_ms = Some(lag.error_s() * 1e3);
            MeasuredView {
                view: self.view,
                file: file.to_owned(),
                lag,
            }
        });
        (proof, measured)
    }

    /// True if a tick's box is complete, and neither air nor clouds hide the aircraft.
    fn would_be_seen(&self, tick: usize) -> bool {
        let truth = self.boxes.get(tick).copied().flatten();
        let (Some((_, truth)), Some(altitude_m)) = (truth, self.altitude_msl_m(tick)) else {
            return false;
        };
        let Some(weather) = self.scenario.record.weather() else {
            return false;
        };
        truth.truncation == 0.0
            && truth.visible_fraction >= MIN_VISIBLE
            && truth.transmission >= MIN_TRANSMISSION
            && (weather.clouds.iter()).all(|layer| altitude_m < layer.base_msl_m)
    }

    /// True if the background is the sky.
    fn is_above_ground(&self, tick: usize) -> bool {
        let target_m = self.scenario.record.touchdown.altitude_msl_m;
        let altitude_m = self.altitude_msl_m(tick);
        altitude_m.is_some_and(|altitude_m| altitude_m - target_m >= MIN_HEIGHT_M)
    }

    fn altitude_msl_m(&self, tick: usize) -> Option<f64> {
        let row = self.scenario.frames?.rows.get(tick)?;
        Some(row.pose.altitude_msl_m)
    }

    /// The clear boxes, and those that only lack a smooth background.
    fn boxes_before_the_sky(&self) -> (Vec<ClearBox<'a>>, Vec<ClearBox<'a>>) {
        let boxes = self.boxes.iter().zip(&self.seen).enumerate();
        boxes
            .filter(|(tick, _)| self.would_be_seen(*tick) && self.is_above_ground(*tick))
            .filter_map(|(tick, (found, seen))| {
                let (row, truth) = (*found)?;
                Some(ClearBox {
                    tick,
                    row,
                    truth,
                    sight: seen.sight?,
                })
            })
            .partition(|found| found.sight.is_before_smooth())
    }

    /// Missing evidence is a fault if no sky of any weather would hide it.
    fn check_sky(&self, clear: &[ClearBox], rough: &[ClearBox], file: &str, faults: &mut Faults) {
        let all = clear.len() + rough.len();
        let noise = median_of(rough.iter().map(|found| found.sight.noise)).unwrap_or(0.0);
        let are_few = (clear.len() as f64) < MIN_SMOOTH * all as f64;
        if all >= MIN_BOXES && are_few && noise >= MIN_ROUGH {
            let message = format!(
                "the images show no sky: around {} of {all} ground-truth boxes of an aircraft in the air the noise is {noise:.0} grey levels, expected less than {MIN_ROUGH:.0}",
                rough.len()
            );
            faults.view(file, self.view, message);
        }
    }

    /// A hint for a message if the images would match a different view.
    fn hint(&self) -> String {
        for (index, (other, _)) in self.others.iter().enumerate() {
            let looked = || self.seen.iter().filter_map(|seen| seen.others[index]);
            let (filled, all) = (looked().filter(|filled| *filled).count(), looked().count());
            if all >= MIN_BOXES && filled as f64 >= MIN_FILLED * all as f64 {
                return format!(
                    "; but in {filled} of {all} boxes of view {other}: are the views swapped?"
                );
            }
        }
        String::new()
    }

    /// A clear box is filled if the other boxes and the air imply that the aircraft must be visible in it.
    fn check_filled(
        &self,
        clear: &[&ClearBox],
        filled: &[&ClearBox],
        file: &str,
        faults: &mut Faults,
    ) {
        let typical = median_of(
            filled
                .iter()
                .map(|found| found.sight.contrast / found.truth.transmission),
        );
        let Some(typical) = typical else { return };
        for empty in clear.iter().filter(|b| b.sight.is_empty()) {
            let expected = typical * empty.truth.transmission;
            if expected >= MIN_TIMES_VISIBLE * empty.sight.least_to_be_filled() {
                let message = format!(
                    "in the ground-truth box (row {} of boxes_truth.parquet) nothing stands out by more than {:.1} grey levels, expected {expected:.0}",
                    empty.row, empty.sight.contrast
                );
                faults.view_row(
                    self.view,
                    file,
                    empty.tick,
                    "the aircraft is not where its box is",
                    message,
                );
            }
        }
    }

    /// No image is frozen while the aircraft moves.
    fn check_moving(&self, file: &str, faults: &mut Faults) {
        for (tick, seen) in self.seen.iter().enumerate() {
            if let Some((earlier, moved_px)) = seen.repeats {
                let message = format!(
                    "is the image of tick {earlier} again, but the aircraft moved by {moved_px:.1} pixels since"
                );
                faults.view_row(self.view, file, tick, "frozen or doubled", message);
            }
        }
    }

    /// The offsets of the outline along both axes.
    fn offsets(&self, found: &ClearBox, period_s: f64) -> Option<[Offset; 2]> {
        let point = self.point(found)?;
        let outline = found.sight.outline?;
        Some([0, 1].map(|axis| Offset {
            time_s: point.tick as f64 * period_s,
            offset_px: outline.offset_px[axis],
            motion_px_s: point.per_tick_px[axis] / period_s,
            size_px: point.size_px[axis],
            outline_px: outline.size_px[axis],
            speed_mps: point.speed_mps,
        }))
    }

    /// Time information from a filled box; missing at the flight's ends.
    fn point(&self, found: &ClearBox) -> Option<timing::Point> {
        let at = |tick: usize| {
            let (_, truth) = self.boxes.get(tick).copied().flatten()?;
            (truth.truncation == 0.0).then_some(truth.pixel_box)
        };
        let (before, after) = (at(found.tick.checked_sub(1)?)?, at(found.tick + 1)?);
        let own = found.truth.pixel_box;
        let row = self.scenario.frames?.rows.get(found.tick)?;
        let [north_mps, east_mps, _] = row.velocity_ned_mps;
        let rain_ratio = self.scenario.record.weather()?.rain_ratio;
        Some(timing::Point {
            tick: found.tick,
            offset_px: found.sight.offset_px,
            per_tick_px: glam::DVec2::new(
                (after.cx_px - before.cx_px) / 2.0,
                (after.cy_px - before.cy_px) / 2.0,
            ),
            size_px: glam::DVec2::new(own.width_px, own.height_px),
            is_plain: found.sight.outline.is_some() && rain_ratio == 0.0,
            speed_mps: north_mps.hypot(east_mps),
        })
    }
}
