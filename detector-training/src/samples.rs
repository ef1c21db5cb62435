//! The pool of samples for training batches.
//!
//! Input: images around aircraft, sorted by the matching crop size, and whole frames as background. Output: batches of crops with
//! their targets. Places where the network reported a false aircraft are drawn more often (hard negatives).

pub mod corpus_samples;
pub mod training_picture;

use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use super::crop::augmentation::Augmentation;
use super::crop::{Placement, random_crop};
use super::grid::targets::Targets;
use super::network::patches::PatchBatch;
use training_picture::TrainingPicture;

/// A size of crop, the aircraft that it suits, and how often it is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CropSize {
    /// Side of the crop, pixels.
    pub side_px: usize,
    /// Maximum width of the aircraft that it suits.
    pub widest_px: f64,
    /// Side of the piece that is kept around an aircraft, so that the crop can be moved and scaled.
    pub piece_side_px: usize,
    /// Crops per batch.
    pub batch: usize,
    /// Share of batches.
    pub share: f64,
}

/// The sizes of crops. Batches hold about the same number of pixels.
pub(crate) const CROP_SIZES: [CropSize; 3] = [
    CropSize {
        side_px: 128,
        widest_px: 56.0,
        piece_side_px: 288,
        batch: 32,
        share: 0.66,
    },
    CropSize {
        side_px: 256,
        widest_px: 120.0,
        piece_side_px: 512,
        batch: 8,
        share: 0.22,
    },
    CropSize {
        side_px: 384,
        widest_px: f64::INFINITY,
        piece_side_px: 640,
        batch: 4,
        share: 0.12,
    },
];

/// Share of background crops in a batch.
const BACKGROUND_SHARE: f64 = 0.35;
/// Share of background crops that are drawn from the hard ones, once there are any.
const HARD_SHARE: f64 = 0.4;
/// Share of crops whose aircraft suits the next smaller size: small aircraft with large surroundings.
const SMALLER_SHARE: f64 = 0.35;
/// Number of hard places remembered.
const HARD_PLACES: usize = 4_000;
/// Maximum shift before a hard place is cropped again, px.
const HARD_SHIFT_PX: f64 = 24.0;
/// Weight for boxes in varied crops: edges behind texture are uncertain, and their large errors would outweigh the tenths of a pixel that
/// can be learned.
const VARIED_BOX_WEIGHT: f32 = 0.3;

/// The size that suits an aircraft of this width: an index into [`CROP_SIZES`].
pub(crate) fn size_for_width(width_px: f64) -> usize {
    CROP_SIZES
        .iter()
        .position(|size| width_px <= size.widest_px)
        .unwrap_or(CROP_SIZES.len() - 1)
}

/// A background region that the network got wrong.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HardPlace {
    picture: usize,
    placement: Placement,
}

/// Training sample pool.
#[derive(Debug, Default)]
pub struct Samples {
    /// Pieces around visible aircraft, by the index of their size in [`CROP_SIZES`].
    pub aircraft: [Vec<TrainingPicture>; CROP_SIZES.len()],
    /// Whole frames, mostly empty.
    pub backgrounds: Vec<TrainingPicture>,
    /// Number of pieces and whole frames that are left out because they show several aircraft.
    pub left_out: usize,
}

/// A batch.
#[derive(Debug)]
pub struct Batch {
    /// Pixels.
    pub pictures: PatchBatch,
    /// The desired output of the network.
    pub targets: Targets,
    /// For crops of background: where they came from.
    pub places: Vec<Option<HardPlace>>,
}

impl Samples {
    /// Number of pieces with an aircraft.
    pub(crate) fn aircraft_count(&self) -> usize {
        self.aircraft.iter().map(Vec::len).sum()
    }

    /// A random size that has something to draw, an index into [`CROP_SIZES`].
    pub(crate) fn random_size(&self, rng: &mut impl Rng) -> usize {
        let mut point = rng.random::<f64>() * CROP_SIZES.iter().map(|size| size.share).sum::<f64>();
        let drawn = CROP_SIZES.iter().position(|size| {
            point -= size.share;
            point <= 0.0
        });
        let fits = |size: &usize| self.source(*size).is_some();
        drawn
            .filter(fits)
            .or_else(|| (0..CROP_SIZES.len()).find(fits))
            .unwrap_or(0)
    }

    /// The pools whose pieces suit a size: its own and, if the pieces are large enough, the next smaller.
    fn source(&self, size: usize) -> Option<(&[TrainingPicture], Option<&[TrainingPicture]>)> {
        let own = Some(self.aircraft[size].as_slice()).filter(|pile| !pile.is_empty());
        let smaller = size
            .checked_sub(1)
            .map(|smaller| self.aircraft[smaller].as_slice())
            .filter(|pile| !pile.is_empty());
        match (own, smaller) {
            (Some(own), smaller) => Some((own, smaller)),
            (None, Some(smaller)) => Some((smaller, None)),
            (None, None) => None,
        }
    }

    /// Draws a batch of `count` crops.
    pub fn batch(
        &self,
        size: usize,
        count: usize,
        augmentation: &Augmentation,
        hard: &HardPlaces,
        rng: &mut impl Rng,
    ) -> Batch {
        let side = CROP_SIZES[size].side_px;
        let mut batch = Batch {
            pictures: PatchBatch::new(count, side, side),
            targets: Targets::new(count, side, side),
            places: vec![None; count],
        };
        let source = self.source(size);
        for index in 0..count {
            let background = !self.backgrounds.is_empty()
                && (source.is_none() || rng.random_bool(BACKGROUND_SHARE));
            let (picture, placement) = match source {
                Some((own, smaller)) if !background => {
                    let pile = smaller
                        .filter(|_| rng.random_bool(SMALLER_SHARE))
                        .unwrap_or(own);
                    let picture = &pile[rng.random_range(0..pile.len())];
                    let near = picture
                        .aircraft
                        .as_ref()
                        .map(|aircraft| &aircraft.pixel_box);
                    (picture, Placement::random(picture, near, side, rng))
                }
                _ => {
                    let place = self.background(side, hard, rng);
                    batch.places[index] = Some(place);
                    (&self.backgrounds[place.picture], place.placement)
                }
            };
            let (pixels, truth, varied) = random_crop(picture, &placement, side, augmentation, rng);
            batch.pictures.fill(index, &pixels);
            if let Some(truth) = truth {
                batch.targets.add(index, &truth);
                if varied {
                    batch.targets.weigh_boxes(index, VARIED_BOX_WEIGHT);
                }
            }
        }
        batch
    }

    /// A place in the background: a hard one, moved a little, or any.
    fn background(&self, side: usize, hard: &HardPlaces, rng: &mut impl Rng) -> HardPlace {
        if hard.is_empty() || !rng.random_bool(HARD_SHARE) {
            let picture = rng.random_range(0..self.backgrounds.len());
            return HardPlace {
                picture,
                placement: Placement::random(&self.backgrounds[picture], None, side, rng),
            };
        }
        let HardPlace {
            picture,
            mut placement,
        } = hard.places[rng.random_range(0..hard.places.len())];
        let TrainingPicture {
            width_px,
            height_px,
            ..
        } = self.backgrounds[picture];
        let mut moved = |at: f64, length: usize| {
            let most = length as f64 - 1.0 - placement.scale * (side as f64 - 1.0);
            (at + rng.random_range(-HARD_SHIFT_PX..HARD_SHIFT_PX).round()).clamp(0.0, most.max(0.0))
        };
        placement.left_px = moved(placement.left_px, width_px);
        placement.top_px = moved(placement.top_px, height_px);
        placement.mirrored = rng.random_bool(0.5);
        HardPlace { picture, placement }
    }
}

/// Regions that the network got wrong, up to a limit.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct HardPlaces {
    places: Vec<HardPlace>,
}

impl HardPlaces {
    /// Remembers a place; forgets a random one if there are too many.
    pub(crate) fn remember(&mut self, place: HardPlace, rng: &mut impl Rng) {
        if self.places.len() < HARD_PLACES {
            self.places.push(place);
        } else {
            let index = rng.random_range(0..HARD_PLACES);
            self.places[index] = place;
        }
    }

    /// Forgets places in images that do not exist. A checkpoint may list such places if the corpus has shrunk.
    pub(crate) fn forget_beyond(&mut self, pictures: usize) {
        self.places.retain(|place| place.picture < pictures);
    }

    /// Number of places.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// True if there are no places.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }
}
