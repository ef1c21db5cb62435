//! Images of a corpus: decoded from its videos, with its ground-truth boxes.
//!
//! Input: a labelled corpus. Output: samples for training. Every pixel went through the codec, as it will when the detector is used.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use dataset::corpus::Corpus;
use dataset::corpus::open_scenario::OpenScenario;
use dataset::corpus::splits::Side;
use dataset::plan::PlannedScenarios;
use dataset::tables::pixel_box::{PixelBox, TruthBox};
use dataset::work::memory;
use dataset::work::watch::Watch;
use rayon::prelude::*;

use super::training_picture::{TrainingPicture, is_visible, may_be_visible};
use crate::crop::cover::Cover;
use crate::error::{Error, Result};
use crate::grid::targets::CropTruth;
use crate::samples::{CROP_SIZES, Samples, size_for_width};

/// Whole frames kept of every video as background. Clouds and ground do not move within a scenario; lights and rain do.
const BACKGROUNDS_PER_VIDEO: usize = 3;

/// Distance beyond which two boxes of the aircraft with its lights' glare do not touch, px.
const APART_PX: f64 = 8.0;

/// Frames held at a time by a decoder and its scaler.
const DECODED_FRAMES: u64 = 12;

/// Training memory besides the images: batches have the same size whatever the corpus. Measured: 190 MiB.
const TRAINING_BYTES: u64 = 208 << 20;

/// A corpus video.
#[derive(Debug, Clone)]
pub(crate) struct Video {
    scenario: Arc<OpenScenario>,
    view: String,
}

/// All videos of the training and validation sides.
pub(crate) fn videos(corpus: &Corpus) -> Result<Vec<Video>> {
    // Checked before any table is read: when memory runs out, a decoder or thread may fail with an unrelated message, or silently.
    memory::check("training a detector", TRAINING_BYTES).map_err(dataset::Error::from)?;
    let splits = corpus.splits()?;
    let planned = PlannedScenarios::read(corpus)?;
    let mut videos = Vec::new();
    for folder in corpus.scenarios()? {
        if splits
            .scenarios
            .get(&folder.id())
            .is_some_and(|assignment| assignment.side != Side::Test)
        {
            let scenario = Arc::new(folder.open()?);
            planned.check(&scenario.id(), &scenario.seal().config_hash)?;
            videos.extend(scenario.record()?.views.into_iter().map(|view| Video {
                scenario: scenario.clone(),
                view,
            }));
        }
    }
    if videos.is_empty() {
        return Err(Error::Input(format!(
            "corpus {}: has no recorded scenario on the train or validation side of its split; generate and label it first",
            corpus.root().display()
        )));
    }
    Ok(videos)
}

/// All training samples of the videos.
///
/// # Errors
/// A video or table cannot be read, the images need more memory than available, or the watch stopped it.
pub(crate) fn read_samples(videos: &[Video], watch: &dyn Watch) -> Result<Samples> {
    let mut needed_bytes = decoding_bytes(videos)?.max(TRAINING_BYTES);
    for video in videos {
        let backgrounds = BACKGROUNDS_PER_VIDEO.min(video.frames()?) as u64;
        let pieces: u64 = video
            .boxes()?
            .filter(may_be_visible)
            .map(|truth| {
                let size = CROP_SIZES[size_for_width(truth.pixel_box.width_px)];
                rgb_bytes(size.piece_side_px, size.piece_side_px)
            })
            .sum();
        needed_bytes += backgrounds * video.frame_bytes()? + pieces;
    }
    memory::check("training a detector with these images", needed_bytes)
        .map_err(dataset::Error::from)?;
    watch.begin("detector: reading videos", videos.len() as u64);
    let done = AtomicU64::new(0);
    let read = |video| {
        watch.check()?;
        let samples = samples_of(video, watch)?;
        watch.advance(done.fetch_add(1, Ordering::Relaxed) + 1, "");
        Ok(samples)
    };
    let parts = videos.par_iter().map(read).collect::<Result<Vec<_>>>()?;
    let mut all = Samples::default();
    for part in parts {
        all.backgrounds.extend(part.backgrounds);
        for (pile, more) in all.aircraft.iter_mut().zip(part.aircraft) {
            pile.extend(more);
        }
        all.left_out += part.left_out;
    }
    Ok(all)
}

fn samples_of(video: &Video, watch: &dyn Watch) -> Result<Samples> {
    let mut samples = Samples::default();
    let mut places: [Vec<[usize; 2]>; CROP_SIZES.len()] = Default::default();
    let background_step = video.frames()?.div_ceil(BACKGROUNDS_PER_VIDEO).max(1) as u32;
    video.for_each_frame(|tick, frame, boxes| {
        frame.aircraft = None;
        for truth in boxes {
            let (pixel_box, visible) = (truth.pixel_box, is_visible(frame, truth));
            frame.aircraft = Some(CropTruth { pixel_box, visible });
            if !visible {
                continue;
            }
            let size = size_for_width(pixel_box.width_px);
            let side = CROP_SIZES[size].piece_side_px;
            let place = |center: f64, length: usize| {
                let most = length.saturating_sub(side);
                ((center - side as f64 / 2.0).round().max(0.0) as usize).min(most)
            };
            let (left, top) = (
                place(pixel_box.cx_px, frame.width_px),
                place(pixel_box.cy_px, frame.height_px),
            );
            let (width, height) = (side.min(frame.width_px), side.min(frame.height_px));
            let [x, y] = [left, top].map(|edge| edge as f64 - 0.5);
            let (right, bottom) = (x + width as f64, y + height as f64);
            let piece = PixelBox::from_edges(x, y, right, bottom);
            let shown = boxes.iter().map(|truth| &truth.pixel_box);
            // A network would learn a second aircraft in the piece as background.
            if shown.filter(|of| of.intersection(&piece) > 0.0).count() > 1 {
                samples.left_out += 1;
                continue;
            }
            samples.aircraft[size].push(frame.piece(left, top, width, height));
            places[size].push([left, top]);
        }
        if tick % background_step == background_step / 2 {
            if boxes.len() > 1 {
                samples.left_out += 1;
            } else {
                samples.backgrounds.push(frame.clone());
            }
        }
        !watch.is_stopped()
    })?;
    watch.check()?;
    for (pieces, places) in samples.aircraft.iter_mut().zip(places) {
        for (piece, place) in pieces.iter_mut().zip(places) {
            piece.cover = cover_of(piece, place, &samples.backgrounds);
        }
    }
    let covers: Vec<_> = samples
        .backgrounds
        .iter()
        .map(|frame| cover_of(frame, [0, 0], &samples.backgrounds))
        .collect();
    for (frame, cover) in samples.backgrounds.iter_mut().zip(covers) {
        frame.cover = cover;
    }
    Ok(samples)
}

/// Aircraft pixels in a piece at `(left, top)` of its frame, by comparison with a frame whose aircraft is elsewhere.
fn cover_of(
    piece: &TrainingPicture,
    [left, top]: [usize; 2],
    frames: &[TrainingPicture],
) -> Option<Cover> {
    let here = piece.aircraft?.pixel_box;
    let elsewhere = |frame: &&TrainingPicture| {
        frame.aircraft.is_none_or(|there| {
            let there = there.pixel_box;
            let apart = |a: f64, b: f64, sizes: f64| (a - b).abs() > 0.5 * sizes + APART_PX;
            let sizes = [
                here.width_px + there.width_px,
                here.height_px + there.height_px,
            ];
            apart(here.cx_px + left as f64, there.cx_px, sizes[0])
                || apart(here.cy_px + top as f64, there.cy_px, sizes[1])
        })
    };
    let behind = frames.iter().find(elsewhere)?;
    let behind = behind.piece(left, top, piece.width_px, piece.height_px);
    Some(Cover::of(piece, &behind, &here))
}

/// Memory for decoding, on all threads together.
fn decoding_bytes(videos: &[Video]) -> Result<u64> {
    let mut largest = 0;
    for video in videos {
        largest = largest.max(video.frame_bytes()?);
    }
    let decoders = rayon::current_num_threads().min(videos.len()) as u64;
    Ok(largest * DECODED_FRAMES * decoders)
}

fn rgb_bytes(width_px: usize, height_px: usize) -> u64 {
    3 * width_px as u64 * height_px as u64
}

impl Video {
    fn frames(&self) -> Result<usize> {
        Ok(self.scenario.record()?.ticks as usize)
    }

    /// Memory per frame, bytes.
    fn frame_bytes(&self) -> Result<u64> {
        let cameras = self.scenario.calibration()?.cameras;
        let camera = cameras.get(&self.view).ok_or_else(|| {
            Error::Input(format!(
                "corpus {}: has no camera {} in calibration.json; generate it again",
                self.scenario.folder().root().display(),
                self.view
            ))
        })?;
        Ok(rgb_bytes(
            camera.width_px as usize,
            camera.height_px as usize,
        ))
    }

    /// The ground-truth boxes of the view, of all aircraft.
    fn boxes(&self) -> Result<impl Iterator<Item = TruthBox>> {
        let boxes = self.scenario.truth_boxes()?.into_iter();
        Ok(boxes.filter(|truth| truth.view == self.view))
    }

    /// Decodes the video and passes on every frame with its tick and the boxes of its aircraft, until the receiver returns `false`.
    fn for_each_frame(
        &self,
        mut receive: impl FnMut(u32, &mut TrainingPicture, &[TruthBox]) -> bool,
    ) -> Result<()> {
        let mut boxes: HashMap<u32, Vec<TruthBox>> = HashMap::new();
        for truth in self.boxes()? {
            boxes.entry(truth.tick).or_default().push(truth);
        }
        let mut reader = self.scenario.open_video(&self.view)?;
        let (width_px, height_px) = (reader.width() as usize, reader.height() as usize);
        let mut frame = TrainingPicture {
            rgb: Vec::new(),
            width_px,
            height_px,
            aircraft: None,
            cover: None,
        };
        let mut tick = 0;
        while reader.next_frame(&mut frame.rgb)?.is_some() {
            let here = boxes.get(&tick).map_or(&[][..], Vec::as_slice);
            if !receive(tick, &mut frame, here) {
                break;
            }
            tick += 1;
        }
        Ok(())
    }
}
