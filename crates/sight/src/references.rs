//! The ground before a camera in some flights of a training, in several lights and weathers.

use std::cell::OnceCell;

use dataset::geometry::camera::Camera;
use dataset::video::Luma;

use crate::background::Background;
use crate::fit::{Coarse, Freedom, MIN_SD_PX, Reference};
use crate::ground::{Ground, Motion, UNKNOWNS};
use crate::sight::{CONTRADICTS_SD, Sight};

/// Maximum resemblance of other surroundings ([`Reference::resemblance`]). In 16 flights at four times of day and in four weathers, also by
/// night and in fog, the same surroundings have at least 0.47, another view's at most 0.07, and mirrored ones at most 0.22.
const MAX_OTHER_RESEMBLANCE: f64 = 0.3;
/// Minimum information of a background that shows other surroundings, as a part of a reference's: fog resembles nothing.
const MIN_INFORMATION_PART: f64 = 0.3;
/// Maximum standard deviation of a comparison that counts, pixels.
pub const MAX_SD_PX: f64 = 0.5;

/// The references of a view.
#[derive(Debug, Clone)]
pub struct References {
    camera: Camera,
    freedom: Freedom,
    all: Vec<Placed>,
}

/// A reference with the camera's motion from the first one.
#[derive(Debug, Clone)]
pub struct Placed {
    /// The flight.
    pub name: String,
    /// Its background.
    pub background: Background,
    /// The camera's motion from the first reference.
    pub motion: Motion,
    /// Standard deviation of its shift, pixels.
    pub sd_px: f64,
    reference: Reference,
}

impl Placed {
    /// A reference at its motion; `None` if its background shows too little.
    pub fn at(
        name: String,
        background: Background,
        (motion, sd_px): (Motion, f64),
        camera: &Camera,
    ) -> Option<Self> {
        let levels = background.whole();
        let image = Luma::of(&levels, background.width_px);
        Some(Self {
            reference: Reference::of(&image, &Ground::of(camera), background.noise_levels())?,
            name,
            background,
            motion,
            sd_px,
        })
    }

    /// The camera's motion in an image from the first reference.
    fn compared(
        &self,
        image: &Luma<'_>,
        shrunk: &OnceCell<Coarse>,
        freedom: &Freedom,
    ) -> Option<Sight> {
        let fit = self
            .reference
            .find(image, shrunk, Motion::default(), freedom)?;
        let mut found = fit.sight;
        found.motion = found.motion.after(self.motion);
        // All but the lift of the reference are as uncertain as its shift.
        for unknown in 0..UNKNOWNS - 1 {
            found.covariance_px2[unknown][unknown] += self.sd_px * self.sd_px;
        }
        Some(found)
    }
}

impl References {
    /// References with their motions. `can_stand_elsewhere`: the camera's place differs between flights.
    pub fn of(camera: &Camera, all: Vec<Placed>, can_stand_elsewhere: bool) -> Self {
        Self {
            camera: *camera,
            freedom: if can_stand_elsewhere {
                Freedom::MOVED
            } else {
                Freedom::TURN_AND_ZOOM
            },
            all,
        }
    }

    /// References that are placed by one another; one that resembles no other one is left out, unless it is the first.
    pub fn learn(
        camera: &Camera,
        backgrounds: Vec<(String, Background)>,
        can_stand_elsewhere: bool,
    ) -> Self {
        let placed = backgrounds.into_iter().filter_map(|(name, background)| {
            Placed::at(name, background, (Motion::default(), 0.0), camera)
        });
        let mut left: Vec<Placed> = placed.collect();
        let mut known = Self::of(camera, Vec::new(), can_stand_elsewhere);
        if left.is_empty() {
            return known;
        }
        // First the one that shows most, then the most certain one next.
        left.sort_by(|a, b| {
            let [a, b] = [a, b].map(|of| of.reference.information());
            b.total_cmp(&a)
        });
        known.all.push(left.remove(0));
        loop {
            let located = left.iter().enumerate();
            let located =
                located.filter_map(|(at, one)| Some((at, known.compare(&one.background)?)));
            let Some((at, sight)) =
                located.min_by(|(_, a), (_, b)| a.sd_px().total_cmp(&b.sd_px()))
            else {
                return known;
            };
            let mut next = left.remove(at);
            (next.motion, next.sd_px) = (sight.motion, sight.sd_px());
            known.all.push(next);
        }
    }

    /// Corrects the references' motions by what is known of each, relative to the corrected first one. Returns the first one's correction.
    pub fn place(&mut self, corrected: impl Fn(&Sight) -> Sight) -> Motion {
        let mut first = None;
        for placed in &mut self.all {
            // As in comparisons, all but the lift are as uncertain as the shift.
            let [sd_px, of_lift_px] = [placed.sd_px, 0.0];
            let sds_px = [sd_px, sd_px, sd_px, sd_px, of_lift_px];
            let mut known = Sight::expected(sds_px.map(|sd_px| sd_px.max(MIN_SD_PX)));
            known.motion = placed.motion;
            let found = corrected(&known);
            let first = *first.get_or_insert(found.motion);
            (placed.motion, placed.sd_px) = (found.motion.after(first.back()), found.sd_px());
        }
        first.unwrap_or_default()
    }

    /// The references.
    pub fn all(&self) -> &[Placed] {
        &self.all
    }

    /// The camera of the training.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// True if a background clearly shows other surroundings than all references.
    pub fn is_elsewhere(&self, background: &Background) -> bool {
        let levels = background.whole();
        let image = Luma::of(&levels, background.width_px);
        let own = Reference::of(&image, &Ground::of(&self.camera), background.noise_levels());
        let own = own.map_or(0.0, |own| own.information());
        let shrunk = OnceCell::new();
        let is_other = |Placed { reference, .. }: &Placed| {
            reference.resemblance(&image, &shrunk) < MAX_OTHER_RESEMBLANCE
                && own >= MIN_INFORMATION_PART * reference.information()
        };
        !self.all.is_empty() && self.all.iter().all(is_other)
    }

    /// The camera's motion since the training; `None` if the background resembles none of the references.
    pub fn compare(&self, background: &Background) -> Option<Sight> {
        let levels = background.whole();
        let image = Luma::of(&levels, background.width_px);
        let shrunk = OnceCell::new();
        let compared = self.all.iter();
        let compared: Vec<Sight> = compared
            .filter_map(|placed| placed.compared(&image, &shrunk, &self.freedom))
            .collect();
        let surest = compared
            .iter()
            .min_by(|a, b| a.sd_px().total_cmp(&b.sd_px()))?;
        let mut found = *surest;
        let mut spread_px = 0.0;
        // Comparisons that are far from the mean count less.
        for _ in 0..5 {
            let weights: Vec<f64> = compared
                .iter()
                .map(|one| {
                    let away = one.motion.shift_px.distance(found.motion.shift_px) / one.sd_px();
                    one.sd_px().powi(-2) / (1.0 + (away / CONTRADICTS_SD).powi(2))
                })
                .collect();
            let sum: f64 = weights.iter().sum();
            let mut mean = [0.0; UNKNOWNS];
            for (one, weight) in compared.iter().zip(&weights) {
                for (mean, number) in mean.iter_mut().zip(one.motion.to_px(&self.camera)) {
                    *mean += number * weight / sum;
                }
            }
            found.motion = Motion::of_px(mean, &self.camera);
            let off_px2 = compared.iter().zip(&weights).map(|(one, weight)| {
                one.motion.shift_px.distance_squared(found.motion.shift_px) * weight / sum
            });
            spread_px = off_px2.sum::<f64>().sqrt();
        }
        let found = found.widened((spread_px / surest.sd_px()).max(1.0));
        (found.sd_px() <= MAX_SD_PX).then_some(found)
    }
}
