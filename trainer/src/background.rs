//! Alignment of each scenario's cameras by the stationary background in their images.
//!
//! Cameras that are slightly displaced between scenarios (`[jitter]`, wind, a new mast) show the aircraft at a different position, and
//! everything that learned image positions is off by that amount. Runway, ships and islands reveal the offset. Training keeps some
//! backgrounds from different times of day and weathers as mutually aligned references. Every scenario is aligned with them
//! ([`alignment`]), and its boxes and registered shifts are mapped to the direction of the first reference. The scenario's known camera is
//! turned accordingly, so code that uses it (checks of labels, the oracle) sees the same rays as before. Focal length and horizon row come
//! from the planned cameras; the actual directions are not read.
//!
//! A view that cannot be aligned counts as empty: its boxes are dropped, and the scenario is reported.
//!
//! The images come from the videos: two dozen per flight are enough. Samples are corrected when they are read, so every later stage sees a
//! single camera.

mod alignment;
mod grey_image;
mod motion;

use std::collections::BTreeMap;
use std::fmt;
use std::io::Cursor;
use std::mem;

use dataset::corpus::calibration::CameraEntry;
use dataset::corpus::open_scenario::OpenScenario;
use dataset::corpus::splits::Side;
use dataset::geometry::camera::Camera;
use dataset::numbers::spread::median;
use dataset::tables::health::{CameraTurn, HealthState, ViewHealth};
use dataset::work::watch::Watch;
use glam::{DVec2, DVec3};
use image::{DynamicImage, ImageBuffer, ImageFormat, Luma};
use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::samples::{Observation, Samples, ScenarioSummary};
use alignment::{Aligned, Compared, Reference};
use grey_image::GreyImage;
use motion::{after, matrix, turned};

/// References per view.
const MAX_REFERENCES: usize = 5;
/// Maximum elevation of stationary objects above the horizon, radians.
const ABOVE_HORIZON_RAD: f64 = 0.006;
/// Minimum number of background rows.
const MIN_ROWS: usize = 64;
/// Factor for standard deviations, because backgrounds differ by more than noise, and their minimum, pixels.
const UNDERSTATED: f64 = 3.0;
const MIN_SD_PX: f64 = 0.03;
/// Maximum standard deviation for an aligned scenario's direction, px. Images from a shaking camera that are off by less show the usual
/// direction.
const MAX_SD_PX: f64 = 0.5;
/// Stored levels per grey level.
const PARTS: f32 = 256.0;

#[derive(Debug, Clone)]
pub(crate) struct Backgrounds {
    views: Vec<ViewBackgrounds>,
}

#[derive(Debug, Clone)]
struct ViewBackgrounds {
    place: ViewPlace,
    references: Vec<PlacedReference>,
}

/// A planned view, regardless of the calibration.
#[derive(Debug, Clone)]
struct ViewPlace {
    view: String,
    planned: CameraEntry,
    camera: Camera,
    /// Row of the horizon in the planned camera's image.
    horizon_px: f64,
    /// First background row; `None` if too few rows are below the horizon.
    top: Option<usize>,
}

/// A reference with its direction.
#[derive(Debug, Clone)]
struct PlacedReference {
    scenario: String,
    direction: CameraDirection,
    reference: Reference,
}

/// Camera turn in a scenario from the first reference, and its horizontal standard deviation, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct CameraDirection {
    turn_rad: DVec3,
    sd_px: f64,
}

/// Result of the alignment.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Alignment {
    /// Number of aligned views over all scenarios.
    pub aligned: usize,
    /// Median horizontal standard deviation, pixels; missing without any.
    pub median_sd_px: Option<f64>,
    /// Views that could not be aligned, as `scenario view`: their boxes are dropped.
    pub unaligned: Vec<String>,
}

impl fmt::Display for Alignment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} views aligned by their backgrounds", self.aligned)?;
        if let Some(sd_px) = self.median_sd_px {
            write!(f, ", standard deviation {sd_px:.2} px (median)")?;
        }
        match self.unaligned.as_slice() {
            [] => Ok(()),
            unaligned => write!(f, "; {} not: {}", unaligned.len(), unaligned.join(", ")),
        }
    }
}

/// `backgrounds` in `baselines.json`: description of the images in `backgrounds.png`, from top to bottom.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct StoredView {
    view: String,
    planned: CameraEntry,
    width_px: usize,
    top_px: usize,
    rows: usize,
    references: Vec<StoredReference>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredReference {
    scenario: String,
    turn_rad: [f64; 3],
    sd_px: f64,
}

impl ViewPlace {
    fn of(view: &str, planned: &CameraEntry) -> Self {
        let camera = planned.camera();
        let pitch_rad = planned.placed.pose.pitch_deg.to_radians();
        let horizon_px = camera.principal_px.y + camera.focal_px * pitch_rad.tan();
        let top_px = (horizon_px - ABOVE_HORIZON_RAD * camera.focal_px).max(0.0);
        let top = top_px as usize;
        Self {
            view: view.to_owned(),
            planned: planned.clone(),
            horizon_px,
            top: (top + MIN_ROWS <= camera.height_px as usize).then_some(top),
            camera,
        }
    }

    /// `model`: detections with the health table that identifies images in the usual direction.
    fn picture(&self, scenario: &OpenScenario, model: &str) -> Result<Option<GreyImage>> {
        let size_px = [self.camera.width_px, self.camera.height_px];
        let health = scenario.health(model)?.unwrap_or_default();
        let of_view = health.iter().filter(|row| row.view == self.view);
        let is_usual: Vec<bool> = of_view.map(is_usual).collect();
        let of = |top| GreyImage::of_view(scenario, &self.view, top, size_px, &is_usual);
        self.top.map(of).transpose()
    }
}

/// True for an image with the background in its usual position.
fn is_usual(row: &ViewHealth) -> bool {
    let is_near = |turn: CameraTurn| turn.shift_x_px.hypot(turn.shift_y_px) <= MAX_SD_PX;
    match row.state {
        HealthState::Steady | HealthState::Unknown | HealthState::Inconsistent => true,
        HealthState::Moved | HealthState::Shaking | HealthState::Frozen => {
            row.motion.is_some_and(is_near)
        }
    }
}

impl ViewBackgrounds {
    /// Mutually aligned references from some scenarios.
    fn of(place: ViewPlace, pictures: Vec<(String, GreyImage)>) -> Self {
        let references = pictures
            .into_iter()
            .map(|(scenario, picture)| PlacedReference {
                scenario,
                direction: CameraDirection::default(),
                reference: Reference::of(picture),
            });
        let mut all = Self {
            place,
            references: references.collect(),
        };
        let compared: Vec<Compared> = (all.references.iter())
            .map(|placed| Compared::of(placed.reference.picture()))
            .collect();
        let count = all.references.len();
        let mut motions: BTreeMap<(usize, usize), Aligned> = BTreeMap::new();
        for from in 0..count {
            for to in (0..count).filter(|&to| to != from) {
                let motion = all.motion(from, &compared[to]);
                motions.extend(motion.map(|motion| ((from, to), motion)));
            }
        }
        // First from the placed references to the most certain next one, then again from all others.
        let place = |all: &Self, from: &[usize], to: usize| {
            let measured = from.iter().filter(|&&from| from != to).filter_map(|&from| {
                let motion = motions.get(&(from, to))?;
                Some(all.located(from, motion))
            });
            combined(&measured.collect::<Vec<_>>(), all.place.camera.focal_px)
        };
        let mut done = vec![0];
        loop {
            let left = (1..count).filter(|to| !done.contains(to));
            let next = left.filter_map(|to| Some((to, place(&all, &done, to)?)));
            let next = next.filter(|(_, located)| located.sd_px <= MAX_SD_PX);
            let Some((to, located)) = next.min_by(|(_, a), (_, b)| a.sd_px.total_cmp(&b.sd_px))
            else {
                break;
            };
            all.references[to].direction = located;
            done.push(to);
        }
        for _ in 0..5 {
            for &to in &done[1..] {
                if let Some(located) = place(&all, &done, to) {
                    all.references[to].direction = located;
                }
            }
        }
        let mut numbers = 0..count;
        (all.references).retain(|_| numbers.next().is_some_and(|number| done.contains(&number)));
        all
    }

    fn motion(&self, from: usize, to: &Compared) -> Option<Aligned> {
        let ViewPlace {
            camera, horizon_px, ..
        } = &self.place;
        self.references[from]
            .reference
            .motion_to(to, camera, *horizon_px)
            .filter(|motion| motion.sd_px.is_finite())
    }

    fn located(&self, from: usize, measured: &Aligned) -> CameraDirection {
        let from = &self.references[from].direction;
        let sd_px = (UNDERSTATED * measured.sd_px).hypot(from.sd_px);
        CameraDirection {
            turn_rad: after(measured.motion.turn_rad, from.turn_rad),
            sd_px: sd_px.max(MIN_SD_PX),
        }
    }

    /// Camera direction in a scenario; `None` if its background does not resemble the references.
    fn locate(&self, scenario: &OpenScenario, model: &str) -> Result<Option<CameraDirection>> {
        let Some(picture) = self.place.picture(scenario, model)? else {
            return Ok(None);
        };
        let compared = Compared::of(&picture);
        let measured = (0..self.references.len())
            .filter_map(|from| Some(self.located(from, &self.motion(from, &compared)?)));
        let measured: Vec<CameraDirection> = measured.collect();
        let located = combined(&measured, self.place.camera.focal_px);
        Ok(located.filter(|located| located.sd_px <= MAX_SD_PX))
    }
}

/// Weighted mean of directions; contradicting ones have less weight. The standard deviation is at least their spread. `None` without any.
fn combined(measured: &[CameraDirection], focal_px: f64) -> Option<CameraDirection> {
    let surest = measured.iter().min_by(|a, b| a.sd_px.total_cmp(&b.sd_px))?;
    let mut found = *surest;
    for _ in 0..10 {
        let weights: Vec<f64> = measured
            .iter()
            .map(|located| {
                // Horizontal distance, by the turn around the downward axis.
                let away = (located.turn_rad.y - found.turn_rad.y) * focal_px / located.sd_px;
                located.sd_px.powi(-2) / (1.0 + (away / 3.0).powi(2))
            })
            .collect();
        let sum: f64 = weights.iter().sum();
        let mean = |value: &dyn Fn(&CameraDirection) -> DVec3| {
            let weighted = measured
                .iter()
                .zip(&weights)
                .map(|(located, weight)| value(located) * *weight);
            weighted.sum::<DVec3>() / sum
        };
        let turn_rad = mean(&|located| located.turn_rad);
        let squares = measured.iter().zip(&weights).map(|(located, weight)| {
            let away_px = (located.turn_rad.y - turn_rad.y) * focal_px;
            away_px * away_px * weight
        });
        let spread_px = (squares.sum::<f64>() / sum).sqrt();
        found = CameraDirection {
            turn_rad,
            sd_px: sum.sqrt().recip().max(spread_px).max(MIN_SD_PX),
        };
    }
    Some(found)
}

impl Backgrounds {
    /// Learns references from the training side.
    pub(crate) fn learn(samples: &Samples, watch: &dyn Watch) -> Result<Self> {
        let chosen = references(samples);
        watch.begin("backgrounds", chosen.len() as u64);
        let places: Vec<ViewPlace> = (samples.views.iter())
            .map(|view| ViewPlace::of(view, &samples.rig.nominal[view]))
            .collect();
        let mut pictures = vec![Vec::new(); places.len()];
        for (done, scenario) in chosen.iter().enumerate() {
            watch.check()?;
            let opened = scenario.folder.open()?;
            for (place, pictures) in places.iter().zip(&mut pictures) {
                let picture = place.picture(&opened, &samples.detections.hash)?;
                pictures.extend(picture.map(|picture| (scenario.id.clone(), picture)));
            }
            watch.advance(done as u64 + 1, &scenario.id);
        }
        let views = places.into_iter().zip(pictures);
        Ok(Self {
            views: views
                .map(|(place, pictures)| ViewBackgrounds::of(place, pictures))
                .collect(),
        })
    }

    /// Aligns scenarios on some sides, and corrects their cameras, boxes and shifts.
    pub(crate) fn align(
        &self,
        samples: &mut Samples,
        sides: &[Side],
        watch: &dyn Watch,
    ) -> Result<Alignment> {
        let mut observations = mem::take(&mut samples.samples);
        let observed = observations.iter_mut().map(|sample| &mut sample.observed);
        let alignment = self.align_observations(samples, sides, observed, watch);
        samples.samples = observations;
        alignment
    }

    /// Alignment for observations without ground truth.
    pub(crate) fn align_observations<'a>(
        &self,
        samples: &mut Samples,
        sides: &[Side],
        observations: impl Iterator<Item = &'a mut Observation>,
        watch: &dyn Watch,
    ) -> Result<Alignment> {
        let model = &samples.detections.hash;
        let scenarios = &mut samples.scenarios;
        watch.begin("alignment", scenarios.len() as u64);
        let mut alignment = Alignment::default();
        let mut sds_px = Vec::new();
        let mut turns: Vec<Vec<Option<DVec3>>> = Vec::new();
        for (done, scenario) in scenarios.iter_mut().enumerate() {
            watch.check()?;
            watch.advance(done as u64 + 1, &scenario.id);
            if !sides.contains(&scenario.side) {
                turns.push(vec![Some(DVec3::ZERO); self.views.len()]);
                continue;
            }
            let opened = scenario.folder.open()?;
            let mut of_views = Vec::new();
            for (view, camera) in self.views.iter().zip(&mut scenario.cameras) {
                let located = view.locate(&opened, model)?;
                match located {
                    Some(located) => {
                        camera.ecef_from_camera *= matrix(located.turn_rad);
                        sds_px.push(located.sd_px);
                        tracing::debug!("{} {}: {located:?}", scenario.id, view.place.view);
                    }
                    None => {
                        tracing::warn!(
                            "{}: the background of view {} could not be aligned; its boxes do not count",
                            scenario.id,
                            view.place.view
                        );
                        let named = format!("{} {}", scenario.id, view.place.view);
                        alignment.unaligned.push(named);
                    }
                }
                of_views.push(located.map(|located| located.turn_rad));
            }
            turns.push(of_views);
        }
        for observed in observations {
            self.correct(observed, &turns[observed.scenario]);
        }
        alignment.aligned = sds_px.len();
        alignment.median_sd_px = (!sds_px.is_empty()).then(|| median(&mut sds_px));
        Ok(alignment)
    }

    /// Maps an observation to the first references' directions.
    fn correct(&self, observed: &mut Observation, turns: &[Option<DVec3>]) {
        let place = |view: usize, place: DVec2| {
            let back = matrix(turns[view]?).transpose();
            Some(turned(&self.views[view].place.camera, back, place))
        };
        *observed = observed.moved(place);
    }

    pub(crate) fn views(&self) -> usize {
        self.views.len()
    }

    /// Entries of the backgrounds in `baselines.json`.
    pub(crate) fn stored(&self) -> Vec<StoredView> {
        let views = self
            .views
            .iter()
            .map(|ViewBackgrounds { place, references }| StoredView {
                view: place.view.clone(),
                planned: place.planned.clone(),
                width_px: place.camera.width_px as usize,
                top_px: place.top.unwrap_or_default(),
                rows: references
                    .first()
                    .map_or(0, |placed| placed.reference.picture().rows()),
                references: references
                    .iter()
                    .map(|placed| StoredReference {
                        scenario: placed.scenario.clone(),
                        turn_rad: placed.direction.turn_rad.to_array(),
                        sd_px: placed.direction.sd_px,
                    })
                    .collect(),
            });
        views.collect()
    }

    /// Reference images, one below the other: a PNG with 16 bits.
    pub(crate) fn png(&self) -> Vec<u8> {
        let pictures = || {
            self.views
                .iter()
                .flat_map(|view| &view.references)
                .map(|placed| placed.reference.picture())
        };
        let width = pictures().map(|picture| picture.width).max().unwrap_or(1);
        let mut light: Vec<u16> = Vec::new();
        for picture in pictures() {
            for row in picture.light.chunks_exact(picture.width) {
                light.extend(row.iter().map(|level| (level * PARTS).round() as u16));
                light.resize(light.len() + width - picture.width, 0);
            }
        }
        light.resize(light.len().max(width), 0);
        let height = light.len() / width;
        let mut png = Cursor::new(Vec::new());
        let picture: Option<ImageBuffer<Luma<u16>, _>> =
            ImageBuffer::from_raw(width as u32, height as u32, light);
        let picture = DynamicImage::ImageLuma16(picture.expect("as many levels as pixels"));
        picture
            .write_to(&mut png, ImageFormat::Png)
            .expect("memory takes any image");
        png.into_inner()
    }

    /// Restores stored references; `None` if the images do not match.
    pub(crate) fn of(stored: &[StoredView], png: &[u8]) -> Option<Self> {
        let picture = image::load_from_memory_with_format(png, ImageFormat::Png)
            .ok()?
            .into_luma16();
        let width = picture.width() as usize;
        let mut rows = picture.as_raw().chunks_exact(width.max(1));
        let mut views = Vec::new();
        for view in stored {
            let place = ViewPlace::of(&view.view, &view.planned);
            let is_whole = view.width_px <= width
                && view.width_px == place.camera.width_px as usize
                && view.top_px + view.rows <= place.camera.height_px as usize
                && view.rows >= MIN_ROWS;
            if !is_whole && !view.references.is_empty() {
                return None;
            }
            let mut references = Vec::new();
            for placed in &view.references {
                let mut light = Vec::with_capacity(view.rows * view.width_px);
                for _ in 0..view.rows {
                    let row = rows.next()?;
                    light.extend(
                        row[..view.width_px]
                            .iter()
                            .map(|&level| f32::from(level) / PARTS),
                    );
                }
                let picture = GreyImage {
                    width: view.width_px,
                    top: view.top_px,
                    light,
                };
                references.push(PlacedReference {
                    scenario: placed.scenario.clone(),
                    direction: CameraDirection {
                        turn_rad: DVec3::from_array(placed.turn_rad),
                        sd_px: placed.sd_px,
                    },
                    reference: Reference::of(picture),
                });
            }
            views.push(ViewBackgrounds { place, references });
        }
        Some(Self { views })
    }
}

/// Training scenarios that differ in weather and time of day, as evenly chosen as possible.
fn references(samples: &Samples) -> Vec<&ScenarioSummary> {
    let mut conditions: BTreeMap<(&str, &str), &ScenarioSummary> = BTreeMap::new();
    for scenario in samples
        .scenarios
        .iter()
        .filter(|scenario| scenario.side == Side::Train)
    {
        let condition = (scenario.time_of_day.as_str(), scenario.weather.as_str());
        conditions.entry(condition).or_insert(scenario);
    }
    let all: Vec<&ScenarioSummary> = conditions.into_values().collect();
    let count = all.len().min(MAX_REFERENCES);
    (0..count).map(|i| all[i * all.len() / count]).collect()
}

#[cfg(test)]
mod tests;
