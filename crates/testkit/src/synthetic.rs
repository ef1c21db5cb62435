//! A corpus without videos, made from geometry: the output of a perfect simulator and a noisy detector.
//!
//! For tests, and for working on the trainer before there are recordings
//! (`cargo run --release -p trainer --example synthetic_corpus -- FOLDER`). The aircraft is a box of a B737-800's span and height
//! around its centre of gravity, on approach to Changi 02L, seen by the rig `wide-baseline`.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::fs;
use std::path::Path;

use dataset::conditions::{Clock, Conditions};
use dataset::corpus::Corpus;
use dataset::corpus::calibration::Calibration;
use dataset::corpus::detections::{self, Detection, Detections, NewTables};
use dataset::corpus::model_identity::ModelIdentity;
use dataset::corpus::scenario::{ScenarioRecord, Versions};
use dataset::corpus::seal::seal_folder;
use dataset::corpus::splits::{Assignment, Side, Splits};
use dataset::error::{Error, Result};
use dataset::geometry::camera::Camera;
use dataset::geometry::imaging::Imaging;
use dataset::geometry::pose::{Controls, Pose};
use dataset::geometry::runway::{Runway, RunwayCoordinates};
use dataset::numbers::frame_rate::FrameRate;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::tables::frames::{Frames, TickLabels, TickRow};
use dataset::tables::pixel_box::PixelBox;
use dataset::tables::registrations::{NoShift, Registration, Shift};
use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

use crate::changi_02l;
use crate::rig::{middle, wide_baseline};
use crate::scenario::{calm, frame, record, stamp};
use crate::short_flight::SPEED_MPS;

/// Name of the model's file.
pub const MODEL_FILE: &str = "synthetic.onnx";
/// Name under which the detections are stored.
pub const MODEL_HASH: &str = "53796e7468657469630000000000000000000000000000000000000000000000";
const SPAN_M: f64 = 35.8;
const HEIGHT_M: f64 = 12.5;

/// The detector that the records name as the source of the detections.
pub fn model() -> ModelIdentity {
    ModelIdentity {
        model: Some(MODEL_FILE.into()),
        model_blake3: MODEL_HASH.into(),
        profile_blake3: None,
    }
}

/// A camera that no longer is as in the rig.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Changed {
    /// The view.
    pub view: &'static str,
    /// Turn to the right, degrees.
    pub turned_deg: f64,
    /// Focal length in parts of the rig's.
    pub zoom: f64,
}

/// A synthetic corpus to make.
#[derive(Debug, Clone, PartialEq)]
pub struct SyntheticCorpus {
    /// Trajectories on the training side.
    pub train: usize,
    /// Trajectories on the validation side.
    pub validation: usize,
    /// Trajectories on the test side.
    pub test: usize,
    /// Frame rate.
    pub frame_rate: FrameRate,
    /// Standard deviation of box centres, pixels.
    pub centre_noise_px: f64,
    /// Standard deviation of width and height, pixels.
    pub size_noise_px: f64,
    /// Standard deviation of the shifts between the views, pixels; `None` for views that are not registered.
    pub shift_noise_px: Option<f64>,
    /// Chance that a view misses the aircraft at a tick.
    pub miss_ratio: f64,
    /// Every scenario's cameras are turned by up to this much to either side, degrees.
    pub turned_deg: f64,
    /// True if a third camera stands between the two of the rig.
    pub third_camera: bool,
    /// Ticks by which all views but the first are late.
    pub late_ticks: u32,
    /// A camera that is not as in the rig, in all scenarios.
    pub changed: Option<Changed>,
    /// Lens and air of all cameras.
    pub imaging: Imaging,
    /// Seed.
    pub seed: u64,
}

impl SyntheticCorpus {
    /// A corpus with the demo's scenarios and ticks.
    pub fn demo() -> Self {
        Self {
            train: 7,
            validation: 2,
            test: 3,
            frame_rate: FrameRate {
                numerator: 1,
                denominator: 1,
            },
            centre_noise_px: 0.4,
            size_noise_px: 0.8,
            shift_noise_px: None,
            miss_ratio: 0.08,
            turned_deg: 0.0,
            third_camera: false,
            late_ticks: 0,
            changed: None,
            imaging: Imaging::default(),
            seed: 0,
        }
    }

    /// A corpus with the scenarios and ticks of the full corpus: 100 at 30 images per second, with registered views.
    pub fn full() -> Self {
        Self {
            train: 70,
            validation: 15,
            test: 15,
            frame_rate: FrameRate {
                numerator: 30,
                denominator: 1,
            },
            shift_noise_px: Some(0.05),
            ..Self::demo()
        }
    }

    /// Small enough for a test of seconds.
    pub fn tiny() -> Self {
        Self {
            train: 4,
            validation: 1,
            test: 2,
            frame_rate: FrameRate {
                numerator: 1,
                denominator: 3,
            },
            centre_noise_px: 0.25,
            size_noise_px: 0.5,
            ..Self::demo()
        }
    }

    /// Writes the corpus into an empty folder.
    pub fn write(&self, root: &Path) -> Result<Corpus> {
        let corpus = Corpus::create(root)?;
        let mut assignments = BTreeMap::new();
        let sides = [
            (Side::Train, self.train),
            (Side::Validation, self.validation),
            (Side::Test, self.test),
        ];
        let sides = sides
            .into_iter()
            .flat_map(|(side, count)| std::iter::repeat_n(side, count));
        for (number, side) in sides.enumerate() {
            let id = format!("{number:04}");
            let trajectory = format!("synthetic-{}-{number}", self.seed);
            self.write_scenario(&corpus, number, &id, &trajectory)?;
            assignments.insert(id, Assignment { trajectory, side });
        }
        let splits = Splits::new(assignments).map_err(|leak| Error::corpus(root, leak))?;
        splits.write(&corpus.splits_path())?;
        Ok(corpus)
    }

    fn write_scenario(
        &self,
        corpus: &Corpus,
        number: usize,
        id: &str,
        trajectory: &str,
    ) -> Result<()> {
        let folder = corpus.scenario(id);
        fs::create_dir_all(folder.root()).map_err(Error::io("create", folder.root()))?;
        let mut random = ChaCha12Rng::seed_from_u64(self.seed);
        random.set_stream(number as u64);
        let runway = changi_02l();
        let calibration = self.calibration(number, &runway);
        calibration.write(&folder.calibration_path())?;
        let frames = self.fly(&runway, &calibration, &mut random);
        frames.write(&folder.frames_path())?;
        self.record(number, id, trajectory, &frames, &calibration)
            .write(&folder.record_path())?;
        seal_folder(folder.root(), "synthetic")?;
        let detections = self.detect(&frames, &calibration, &mut random);
        let registrations = self.shift_noise_px.map(|noise_px| {
            self.register(&frames, &calibration, &detections, noise_px, &mut random)
        });
        let source = folder.open()?;
        detections::replace(
            &folder.claim()?,
            &source,
            &model(),
            MODEL_HASH,
            NewTables {
                detections: &detections,
                registrations: registrations.as_deref(),
                health: None,
                backgrounds: None,
            },
            |made| made,
        )
    }

    /// The rig, turned a little further in each scenario, from one side to the other.
    fn calibration(&self, number: usize, runway: &Runway) -> Calibration {
        let count = self.train + self.validation + self.test;
        let part = 2.0 * number as f64 / (count - 1).max(1) as f64 - 1.0;
        let third = self.third_camera.then(|| middle(runway));
        let rig = wide_baseline(runway).into_iter().chain(third);
        let rig = rig.map(|(id, mut placed)| {
            placed.pose.heading_true_deg += part * self.turned_deg;
            if let Some(changed) = self.changed.filter(|changed| changed.view == id) {
                placed.pose.heading_true_deg += changed.turned_deg;
                let half = (placed.hfov_deg.to_radians() / 2.0).tan() / changed.zoom;
                placed.hfov_deg = 2.0 * half.atan().to_degrees();
            }
            (id, placed)
        });
        let mut calibration = Calibration::from_poses(rig, 1920, 1280);
        for entry in calibration.cameras.values_mut() {
            *entry = entry.clone().with_imaging(&self.imaging);
        }
        calibration
    }

    /// An approach that captures the localizer from a random side and flies level before the glide path.
    fn fly(&self, runway: &Runway, calibration: &Calibration, random: &mut ChaCha12Rng) -> Frames {
        let target = runway.touchdown_target();
        let start_m = METERS_PER_NAUTICAL_MILE * random.random_range(9.7..10.2);
        let offset_m = random.random_range(-60.0..60.0);
        let wander_m = random.random_range(1.0..6.0);
        let phase = random.random_range(0.0..TAU);
        let steepness = (runway.glide_path_deg + random.random_range(-0.03..0.03))
            .to_radians()
            .tan();
        let level_m = random.random_range(600.0..900.0);
        let ticks = (start_m / SPEED_MPS / self.frame_rate.period_s()).ceil() as u32 + 4;
        let row = |tick: u32| {
            let time = self.frame_rate.time_of_tick(tick);
            let along_m = start_m - SPEED_MPS * time.seconds();
            let part = (along_m / start_m).clamp(0.0, 1.0);
            let cross_m =
                offset_m * part.powi(3) + wander_m * part * (phase + 5.0 * PI * part).sin();
            let height_m = (along_m * steepness).clamp(3.0, level_m);
            let position = runway
                .point_on_approach(along_m, cross_m)
                .at_altitude_m(target.altitude_msl_m + height_m);
            let pose = Pose {
                latitude_deg: position.latitude_deg,
                longitude_deg: position.longitude_deg,
                altitude_msl_m: position.altitude_msl_m,
                heading_true_deg: runway.course_true_deg,
                pitch_deg: 2.5,
                roll_deg: 0.0,
            };
            let found = RunwayCoordinates::of(position, target, runway.course_true_deg);
            let bare = frame(tick, self.frame_rate, pose);
            let stamps = calibration
                .cameras
                .values()
                .map(|entry| stamp(u64::from(tick), &bare, self.frame_rate, entry.placed));
            TickRow {
                views: stamps.collect(),
                velocity_ned_mps: [0.0, 0.0, 0.0],
                true_airspeed_mps: SPEED_MPS,
                controls: Controls {
                    flap_ratio: 1.0,
                    gear_ratio: 1.0,
                },
                labels: Some(TickLabels {
                    dtd_m: found.dtd_m,
                    along_track_m: found.along_track_m,
                    cross_track_m: found.cross_track_m,
                    height_over_target_m: found.height_over_target_m,
                    time_to_touchdown_s: (along_m > 0.0).then_some(along_m / SPEED_MPS),
                }),
                ..bare
            }
        };
        Frames {
            views: calibration.cameras.keys().cloned().collect(),
            rows: (0..ticks).map(row).collect(),
        }
    }

    fn detect(
        &self,
        frames: &Frames,
        calibration: &Calibration,
        random: &mut ChaCha12Rng,
    ) -> Detections {
        let mut found = Vec::new();
        for row in &frames.rows {
            for (index, (view, entry)) in calibration.cameras.iter().enumerate() {
                let camera = entry.camera();
                let exact = perfect_box(&camera, self.shown_m(frames, row.tick, index));
                let noisy = PixelBox {
                    cx_px: exact.cx_px + self.centre_noise_px * normal(random),
                    cy_px: exact.cy_px + self.centre_noise_px * normal(random),
                    width_px: (exact.width_px + self.size_noise_px * normal(random)).max(1.0),
                    height_px: (exact.height_px + self.size_noise_px * normal(random)).max(1.0),
                };
                if is_whole(&noisy, &camera) && !random.random_bool(self.miss_ratio) {
                    found.push(Detection {
                        counts_live: Some(true),
                        ..Detection::untracked(row.tick, view, noisy, 0.9, 0)
                    });
                }
            }
        }
        found.into()
    }

    /// Position of the aircraft in a view's image of a tick.
    fn shown_m(&self, frames: &Frames, tick: u32, view: usize) -> DVec3 {
        let late = if view > 0 { self.late_ticks } else { 0 };
        let row = &frames.rows[tick.saturating_sub(late) as usize];
        row.pose.position().to_ecef()
    }

    /// Place of each view's aircraft in the first view, for views that both have a box.
    fn register(
        &self,
        frames: &Frames,
        calibration: &Calibration,
        detections: &Detections,
        noise_px: f64,
        random: &mut ChaCha12Rng,
    ) -> Vec<Registration> {
        let mut found = Vec::new();
        let mut boxes: BTreeMap<u32, Vec<&Detection>> = BTreeMap::new();
        for seen in &detections.boxes {
            boxes.entry(seen.tick).or_default().push(seen);
        }
        let mut views = calibration.cameras.iter();
        let (reference, first) = views.next().expect("a rig has cameras");
        let first = first.camera();
        for (index, (view, entry)) in (1..).zip(views) {
            let camera = entry.camera();
            for row in &frames.rows {
                let seen = |view: &String| {
                    let mut of_tick = boxes.get(&row.tick)?.iter().copied();
                    of_tick.find(|seen| seen.view == *view)
                };
                let mut shift = || {
                    let (in_reference, _) = (seen(reference)?, seen(view)?);
                    let [here_m, there_m] =
                        [0, index].map(|view| self.shown_m(frames, row.tick, view));
                    let exact = camera.project(there_m)? - first.project(here_m)?;
                    Some(Shift {
                        x_px: in_reference.pixel_box.cx_px,
                        y_px: in_reference.pixel_box.cy_px,
                        dx_px: exact.x + noise_px * normal(random),
                        dy_px: exact.y + noise_px * normal(random),
                        sd_x_px: noise_px.max(0.01),
                        sd_y_px: noise_px.max(0.01),
                    })
                };
                found.push(Registration {
                    tick: row.tick,
                    view: view.clone(),
                    reference: reference.clone(),
                    result: shift().ok_or(NoShift::NoBox),
                });
            }
        }
        found
    }

    fn record(
        &self,
        number: usize,
        id: &str,
        trajectory: &str,
        frames: &Frames,
        calibration: &Calibration,
    ) -> ScenarioRecord {
        let weathers = ["clear", "cloudy", "foggy", "stormy"];
        let times = ["06:00", "08:00", "12:00", "17:00", "18:00"];
        let plain = record(id, self.frame_rate, frames.rows.len() as u32);
        ScenarioRecord {
            trajectory: trajectory.into(),
            seed: Some(self.seed),
            plan_hash: Some("synthetic".into()),
            config_hash: "synthetic".into(),
            aircraft: "B738".into(),
            views: calibration.cameras.keys().cloned().collect(),
            conditions: Some(Conditions {
                time_of_day: times[number % times.len()].into(),
                clock: Clock {
                    day_of_year: 80,
                    zulu_time_s: 0.0,
                },
                weather_name: weathers[number % weathers.len()].into(),
                weather: calm(20_000.0),
            }),
            blocks: None,
            graphics: None,
            versions: Versions {
                dtd: env!("CARGO_PKG_VERSION").into(),
                simulator: Some("geometry".into()),
                capture_link: Some(0),
                pixels: Some("link".into()),
                encoder: None,
            },
            ..plain
        }
    }
}

/// Box around an aircraft that flies towards the camera: as wide as its span, as high as itself, its centre 1 m above the centre of
/// gravity. Points behind the camera have a box far outside the image.
pub(crate) fn perfect_box(camera: &Camera, ecef_m: DVec3) -> PixelBox {
    let range_m = camera.to_camera(ecef_m).z;
    let outside = glam::DVec2::splat(-1e6);
    let centre = camera.project(ecef_m).unwrap_or(outside);
    let px_per_m = camera.focal_px / range_m.abs().max(1.0);
    PixelBox {
        cx_px: centre.x,
        cy_px: centre.y - px_per_m,
        width_px: SPAN_M * px_per_m,
        height_px: HEIGHT_M * px_per_m,
    }
}

/// True if a box is completely in the image, and far enough from its edge for a detector that places an edge within 2 pixels.
fn is_whole(seen: &PixelBox, camera: &Camera) -> bool {
    let [left, top, right, bottom] = seen.edges();
    // Pixel (0, 0) covers -0.5 to 0.5.
    left > 1.5
        && top > 1.5
        && right < f64::from(camera.width_px) - 2.5
        && bottom < f64::from(camera.height_px) - 2.5
}

/// A draw from the normal distribution (Box and Muller).
fn normal(random: &mut ChaCha12Rng) -> f64 {
    let radius = (-2.0 * (1.0 - random.random::<f64>()).ln()).sqrt();
    radius * (TAU * random.random::<f64>()).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_makes_the_same_corpus() {
        let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        let manifests = folders.each_ref().map(|folder| {
            let corpus = SyntheticCorpus::tiny().write(folder.path()).unwrap();
            fs::read(corpus.scenario("0001").root().join("MANIFEST.b3")).unwrap()
        });
        assert_eq!(manifests[0], manifests[1]);
    }
}
