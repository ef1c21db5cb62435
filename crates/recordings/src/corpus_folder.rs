//! The corpus of a recording: a scenario per arrival, labelled, with the boxes as detections.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use dataset::corpus::Corpus;
use dataset::corpus::calibration::{Calibration, CameraEntry, Conventions, RigidTransform};
use dataset::corpus::detections::{
    self, Detection, Detections, Miss, MissReason, NewTables, Provenance, SearchMode,
};
use dataset::corpus::model_identity::ModelIdentity;
use dataset::corpus::scenario::{
    CameraClock, DelayedTrack, Flight, Origin, RECORDED_SCHEMA_VERSION, Recorded, ScenarioRecord,
    SourceFile, UNKNOWN, Versions,
};
use dataset::corpus::seal::{commit_folder, hash_file, seal_folder};
use dataset::corpus::splits::{Assignment, Side, Splits};
use dataset::geometry::camera::{Camera, CameraPose};
use dataset::geometry::geodesy::{Geodetic, LatLon};
use dataset::geometry::pose::{FlightState, Pose};
use dataset::numbers::frame_rate::FrameRate;
use dataset::numbers::limits;
use dataset::numbers::spread::median_of;
use dataset::numbers::units::{Degrees, SECONDS_PER_DAY, SimTime};
use dataset::tables::frames::{Frames, TickRow};
use glam::DVec3;
use labeller::labels_of;
use serde::Serialize;

use crate::alignment::{Alignment, OF_CAMERA};
use crate::description::{CameraDescription, Description, SplitBy};
use crate::error::{Error, Result};
use crate::flight_path::FlightPath;
use crate::matching::{Matched, residual_px};
use crate::sightings::Sightings;

/// Copy of the description in the corpus.
const DESCRIPTION: &str = "recording.toml";
/// Name of detections that came as tables, in place of a model's.
const BOXES: &str = "boxes";
/// Denominator of rates of ticks that were measured.
const RATE_STEPS: f64 = 1_000.0;
/// Share of the arrivals, or days, on the test side; the validation side has as many.
const TEST_SHARE: f64 = 0.2;

/// A camera and its boxes.
pub(crate) struct Seen<'a> {
    pub(crate) camera: &'a CameraDescription,
    pub(crate) sightings: Sightings,
    pub(crate) source: SourceFile,
    pub(crate) matched: Matched,
}

/// Contents of a corpus.
pub(crate) struct Parts<'a> {
    pub(crate) described: &'a Description,
    pub(crate) alignment: &'a Alignment<'a>,
    pub(crate) seen: Vec<Seen<'a>>,
    /// The model that found the boxes; `None` if they came as tables.
    pub(crate) detector: Option<&'a ModelIdentity>,
    /// Numbers of the arrivals that become scenarios.
    pub(crate) flights: &'a [usize],
}

/// `detections/<name>.json`.
#[derive(Serialize)]
struct BoxesRecord<'a> {
    #[serde(flatten)]
    provenance: Provenance,
    /// The tables, or videos, by camera.
    sources: BTreeMap<&'a str, &'a SourceFile>,
    dtd: &'static str,
    detections: usize,
    misses: usize,
}

/// Writes the corpus; returns the identifiers of its scenarios.
pub(crate) fn write(parts: &Parts<'_>, description: &Path, root: &Path) -> Result<Vec<String>> {
    if root.exists() {
        fs::remove_dir_all(root).map_err(dataset::Error::io("remove", root))?;
    }
    let corpus = Corpus::create(root)?;
    let copy = root.join(DESCRIPTION);
    fs::copy(description, &copy).map_err(dataset::Error::io("copy to", &copy))?;
    let description_blake3 = hash_file(description)?;
    let rate = parts.rate()?;
    let mut written = Vec::new();
    for flight in parts.flights {
        let scenario = parts.scenario(*flight, rate)?;
        scenario.write(&corpus, parts, &description_blake3)?;
        written.push((scenario.id, parts.alignment.flights[*flight].path));
    }
    splits(&written, parts.described.split_by)?.write(&corpus.splits_path())?;
    // No other process knows this folder yet, so its claims are not needed.
    let claims = root.join("claims");
    if claims.exists() {
        fs::remove_dir_all(&claims).map_err(dataset::Error::io("remove", &claims))?;
    }
    Ok(written.into_iter().map(|(id, _)| id).collect())
}

/// A scenario before it is written.
struct Scenario {
    id: String,
    flight: usize,
    frame_rate: FrameRate,
    /// Time of tick 0 by the track, seconds.
    start_s: f64,
    frames: Frames,
    detections: Detections,
}

impl Parts<'_> {
    /// Rate of the ticks: as stated, or the usual rate of the images.
    fn rate(&self) -> Result<FrameRate> {
        let usual = || {
            median_of(
                self.seen
                    .iter()
                    .map(|seen| seen.sightings.period_s().recip()),
            )
        };
        let rate = self.described.ticks_per_s.or_else(usual).unwrap_or(1.0);
        FrameRate::new(
            (rate * RATE_STEPS).round().max(1.0) as u32,
            RATE_STEPS as u32,
        )
        .map_err(|bad| {
            Error::Unusable(format!(
                "the images' rate is {rate} per second: {bad}; state `ticks_per_s`"
            ))
        })
    }

    /// The ticks of an arrival with the images nearest to them.
    fn scenario(&self, flight: usize, frame_rate: FrameRate) -> Result<Scenario> {
        let path = self.alignment.flights[flight].path;
        let offsets = |camera: usize, time_s: f64| {
            time_s + self.alignment.offset_to_track(camera, flight, time_s)[0]
        };
        let shown: Vec<f64> = (self.seen.iter().enumerate())
            .flat_map(|(camera, seen)| {
                let boxes = seen.sightings.boxes.iter().zip(&seen.matched.flights);
                let boxes = boxes.filter(|(_, shown)| **shown == Some(flight));
                boxes.map(move |(seen, _)| offsets(camera, seen.time_s))
            })
            .collect();
        let start_s = shown.iter().copied().fold(f64::INFINITY, f64::min);
        let last_s = shown.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let period_s = frame_rate.period_s();
        // One tick past the target tells when it is passed.
        let last_s = if last_s > path.to_s - period_s {
            path.to_s + period_s
        } else {
            last_s
        };
        let ticks = ((last_s - start_s) / period_s).floor() as u32 + 1;
        if f64::from(ticks) > limits::TICKS.most {
            return Err(Error::Unusable(format!(
                "{} lasts for {ticks} ticks; state fewer `ticks_per_s`",
                path.id
            )));
        }
        let of_flight = &self.alignment.flights[flight];
        let showing = self.showing(flight);
        let target = self.described.runway.touchdown_target();
        let mut detections = Detections::default();
        let mut image_times_ns = vec![Vec::new(); ticks as usize];
        for (camera, seen) in self.seen.iter().enumerate() {
            let images = &seen.sightings.images_s;
            let offset_s = self
                .alignment
                .offset_to_track(camera, flight, images[images.len() / 2])[0];
            for (tick, times_ns) in image_times_ns.iter_mut().enumerate() {
                let tick = tick as u32;
                let since_s = frame_rate.time_of_tick(tick).seconds();
                let by_camera_s = start_s + since_s - offset_s;
                let image = nearest(images, by_camera_s, period_s / 2.0 + 1.0);
                let image = image.map(|image_s| (image_s, offsets(camera, image_s) - start_s));
                let image = image.filter(|(_, at_s)| (at_s - since_s).abs() <= period_s / 2.0);
                times_ns.push(image.map(|(_, at_s)| (at_s * 1e9).round() as i64));
                if let Some((image_s, _)) = image {
                    seen.add_image(&mut detections, (tick, image_s), flight);
                }
            }
        }
        let row = |(tick, image_times_ns): (usize, Vec<Option<i64>>)| {
            let time = frame_rate.time_of_tick(tick as u32);
            let state = path.trajectory.at(start_s - path.origin_s + time.seconds());
            let SimTime(time_ns) = time;
            let moved_m = of_flight.moved_m(
                start_s + time.seconds(),
                state.pose.altitude_msl_m - target.altitude_msl_m,
            );
            let pose = moved(&state, moved_m);
            let speed_mps = state.velocity_north_mps.hypot(state.velocity_east_mps);
            TickRow {
                tick: tick as u32,
                time_ns,
                pose,
                velocity_ned_mps: [
                    state.velocity_north_mps,
                    state.velocity_east_mps,
                    state.velocity_down_mps,
                ],
                true_airspeed_mps: state.true_airspeed_mps,
                controls: state.controls,
                on_ground: state.on_ground,
                views: Vec::new(),
                image_times_ns,
                labels: None,
                dtd_sd_m: showing.map(|camera| {
                    let [offset_s, _] = self.alignment.offset_to_track(camera, flight, start_s);
                    let by_camera_s = start_s + time.seconds() - offset_s;
                    self.alignment
                        .along_sd_m(camera, flight, by_camera_s, speed_mps)
                }),
            }
        };
        let mut rows: Vec<TickRow> = image_times_ns.into_iter().enumerate().map(row).collect();
        let labels = labels_of(&rows, target, self.described.runway.course_true_deg);
        for (row, labels) in rows.iter_mut().zip(labels) {
            row.labels = Some(labels);
        }
        Ok(Scenario {
            id: path.id.clone(),
            flight,
            frame_rate,
            start_s,
            frames: Frames {
                views: self.views(),
                rows,
            },
            detections,
        })
    }

    fn views(&self) -> Vec<String> {
        self.seen
            .iter()
            .map(|seen| seen.camera.name.clone())
            .collect()
    }

    /// The camera whose clock is known best against an arrival's track, of those that show it.
    fn showing(&self, flight: usize) -> Option<usize> {
        let sd_s = |camera: &usize| {
            let time_s = self.seen[*camera].sightings.images_s[0];
            self.alignment.offset_to_track(*camera, flight, time_s)[1]
        };
        let shows = |camera: &usize| self.seen[*camera].matched.flights.contains(&Some(flight));
        let cameras = (0..self.seen.len()).filter(shows);
        cameras.min_by(|a, b| sd_s(a).total_cmp(&sd_s(b)))
    }

    fn recorded(&self, scenario: &Scenario) -> Recorded {
        let flight = scenario.flight;
        let path = self.alignment.flights[flight].path;
        let by_name = |(camera, seen): (usize, &Seen<'_>)| {
            let by_camera_s = scenario.start_s - (self.alignment.cameras[camera].coarse_s);
            let [offset_s, offset_sd_s] =
                self.alignment.offset_to_track(camera, flight, by_camera_s);
            let clock = CameraClock {
                offset_s: offset_s + seen.camera.to_utc_s,
                offset_sd_s,
                drift_ppm: self.alignment.cameras[camera].values[1],
                drift_sd_ppm: self.alignment.camera_sds(camera)[1],
            };
            (seen.camera.name.clone(), clock)
        };
        let boxes = self
            .seen
            .iter()
            .map(|seen| (seen.camera.name.clone(), seen.source.clone()));
        let residuals = self.seen.iter().enumerate().filter_map(|(camera, seen)| {
            let of = residual_px(
                self.alignment,
                camera,
                &seen.sightings.boxes,
                &seen.matched,
                |of| of == flight,
            )?;
            Some((seen.camera.name.clone(), of))
        });
        let is_guess = self.seen.iter().any(|seen| seen.camera.is_guess);
        let cameras = if is_guess {
            Origin::Derived
        } else {
            Origin::Measured
        };
        let places = if path.is_exact {
            Origin::Measured
        } else {
            Origin::Derived
        };
        let boxes_are = match self.detector {
            Some(_) => Origin::Derived,
            None => Origin::Measured,
        };
        let origins = [
            ("positions", places),
            ("attitudes", Origin::Derived),
            ("controls", Origin::Derived),
            ("image_times", Origin::Derived),
            ("boxes", boxes_are),
            ("cameras", cameras),
            ("runway", Origin::Assumed),
            ("aircraft", Origin::Assumed),
            ("labels", Origin::Derived),
        ];
        Recorded {
            start_utc_s: scenario.start_s,
            origins: origins
                .map(|(name, origin)| (name.to_owned(), origin))
                .into(),
            track: path.source.clone(),
            boxes: boxes.collect(),
            clocks: self.seen.iter().enumerate().map(by_name).collect(),
            delayed_track: DelayedTrack {
                delay_s: self.alignment.flights[flight].delay_s(),
                delay_sd_s: self.alignment.delay_sd_s(flight),
            },
            position_sd_m: path.position_sd_m,
            residual_px: residuals.collect(),
        }
    }

    fn calibration(&self) -> Calibration {
        let entry = |(seen, model): (&Seen<'_>, &crate::alignment::CameraModel)| {
            let given = &seen.camera.entry;
            let entry = if model.values[2..OF_CAMERA].iter().all(|value| *value == 0.0) {
                given.clone()
            } else {
                entry_of(given, &model.camera())
            };
            (seen.camera.name.clone(), entry)
        };
        Calibration {
            conventions: Conventions::default(),
            cameras: self
                .seen
                .iter()
                .zip(&self.alignment.cameras)
                .map(entry)
                .collect(),
        }
    }
}

impl Seen<'_> {
    /// Adds the boxes of an image. Those of other aircraft stay unconfirmed.
    fn add_image(&self, detections: &mut Detections, (tick, image_s): (u32, f64), flight: usize) {
        let boxes = &self.sightings.boxes;
        let from = boxes.partition_point(|seen| seen.time_s < image_s);
        let to = boxes.partition_point(|seen| seen.time_s <= image_s);
        for (seen, shown) in boxes[from..to].iter().zip(&self.matched.flights[from..to]) {
            let confirmed = *shown == Some(flight);
            detections.boxes.push(Detection {
                track: seen.track,
                confirmed,
                counts_live: Some(confirmed),
                ..Detection::untracked(tick, &*self.camera.name, seen.pixel_box, seen.score, 0)
            });
        }
        if from == to {
            detections.misses.push(Miss {
                tick,
                view: self.camera.name.clone(),
                mode: SearchMode::Full,
                reason: MissReason::Nothing,
            });
        }
    }
}

impl Scenario {
    fn write(&self, corpus: &Corpus, parts: &Parts<'_>, description_blake3: &str) -> Result<()> {
        let described = parts.described;
        let path = parts.alignment.flights[self.flight].path;
        let calibration = parts.calibration();
        let sources: BTreeMap<&str, &SourceFile> = parts
            .seen
            .iter()
            .map(|seen| (&*seen.camera.name, &seen.source))
            .collect();
        let hash_of = |first: &[&str]| {
            let mut hash = blake3::Hasher::new();
            let sources = sources.values().map(|source| &*source.blake3);
            first.iter().copied().chain(sources).for_each(|part| {
                hash.update(part.as_bytes());
                hash.update(b"\n");
            });
            hash.finalize().to_string()
        };
        let detector = parts
            .detector
            .map(ModelIdentity::blake3)
            .unwrap_or_default();
        let config_hash = hash_of(&[&self.id, description_blake3, &path.states_blake3, &detector]);
        let record = ScenarioRecord {
            schema_version: RECORDED_SCHEMA_VERSION,
            id: self.id.clone(),
            trajectory: self.id.clone(),
            seed: None,
            plan_hash: None,
            config_hash: config_hash.clone(),
            aircraft: described
                .aircraft
                .clone()
                .unwrap_or_else(|| UNKNOWN.to_owned()),
            traffic: Vec::new(),
            frame_rate: self.frame_rate,
            ticks: self.frames.rows.len() as u32,
            runway: described.runway.clone(),
            touchdown: described.runway.touchdown_target(),
            flight_touchdown: None,
            geoid: described.geoid.clone(),
            conditions: None,
            effective_weather: None,
            flight: Flight::Recorded {
                file: path.source.file.clone(),
                blake3: path.states_blake3.clone(),
            },
            rig: described.name.clone(),
            views: self.frames.views.clone(),
            blocks: None,
            graphics: None,
            recorded: Some(parts.recorded(self)),
            versions: Versions {
                dtd: env!("CARGO_PKG_VERSION").into(),
                simulator: None,
                capture_link: None,
                pixels: None,
                encoder: None,
            },
        };
        let partial = corpus.partial_scenario(&self.id);
        fs::create_dir_all(partial.root()).map_err(dataset::Error::io("create", partial.root()))?;
        record.write(&partial.record_path())?;
        calibration.write(&partial.calibration_path())?;
        self.frames.write(&partial.frames_path())?;
        seal_folder(partial.root(), &config_hash)?;
        let folder = corpus.scenario(&self.id);
        commit_folder(partial.root(), folder.root())?;
        let detector = parts.detector.cloned().unwrap_or_else(|| ModelIdentity {
            model: Some(BOXES.into()),
            model_blake3: hash_of(&[]),
            profile_blake3: None,
        });
        let tables = NewTables::unregistered(&self.detections);
        let claim = folder.claim()?;
        detections::replace(
            &claim,
            &folder.open()?,
            &detector,
            &detector.name(),
            tables,
            |provenance| BoxesRecord {
                provenance,
                sources: sources.clone(),
                dtd: env!("CARGO_PKG_VERSION"),
                detections: self.detections.boxes.len(),
                misses: self.detections.misses.len(),
            },
        )?;
        Ok(())
    }
}

/// A pose moved along the path, to the right, and up, metres.
fn moved(state: &FlightState, by_m: DVec3) -> Pose {
    if by_m == DVec3::ZERO {
        return state.pose;
    }
    let course_deg = state
        .velocity_east_mps
        .atan2(state.velocity_north_mps)
        .to_degrees();
    let place = LatLon {
        latitude_deg: state.pose.latitude_deg,
        longitude_deg: state.pose.longitude_deg,
    };
    let place = place
        .destination(course_deg, by_m.x)
        .destination(course_deg + 90.0, by_m.y);
    Pose {
        latitude_deg: place.latitude_deg,
        longitude_deg: place.longitude_deg,
        altitude_msl_m: state.pose.altitude_msl_m + by_m.z,
        ..state.pose
    }
}

/// The time nearest to another, if within a reach.
fn nearest(times_s: &[f64], at_s: f64, within_s: f64) -> Option<f64> {
    let after = times_s.partition_point(|time_s| *time_s < at_s);
    let near = times_s[after.saturating_sub(1)..(after + 1).min(times_s.len())]
        .iter()
        .copied();
    let near = near.filter(|time_s| (time_s - at_s).abs() <= within_s);
    near.min_by(|a, b| (a - at_s).abs().total_cmp(&(b - at_s).abs()))
}

/// The entry of a corrected camera.
fn entry_of(given: &CameraEntry, camera: &Camera) -> CameraEntry {
    let position = Geodetic::from_ecef(camera.center_ecef_m);
    let ned_from_camera = position.ecef_from_ned().transpose() * camera.ecef_from_camera;
    let [right, forward] = [DVec3::X, DVec3::Z].map(|axis| ned_from_camera * axis);
    let level_right = DVec3::new(-forward.y, forward.x, 0.0).normalize_or_zero();
    let down = forward.cross(level_right);
    let half_width = f64::from(camera.width_px) / 2.0;
    CameraEntry {
        k: camera.k(),
        ecef_from_camera: RigidTransform {
            rotation: camera.ecef_from_camera.transpose().to_cols_array_2d(),
            translation_m: camera.center_ecef_m.to_array(),
        },
        placed: CameraPose {
            pose: Pose {
                latitude_deg: position.latitude_deg,
                longitude_deg: position.longitude_deg,
                altitude_msl_m: position.altitude_msl_m,
                heading_true_deg: Degrees(forward.y.atan2(forward.x).to_degrees())
                    .wrapped_360()
                    .0,
                pitch_deg: (-forward.z).asin().to_degrees(),
                roll_deg: right.dot(down).atan2(right.dot(level_right)).to_degrees(),
            },
            hfov_deg: 2.0 * (half_width / camera.focal_px).atan().to_degrees(),
        },
        ..given.clone()
    }
}

/// Sides by arrival or by day, in an order that only the flights determine.
fn splits(written: &[(String, &FlightPath)], by: SplitBy) -> Result<Splits> {
    let unit = |path: &FlightPath| match by {
        SplitBy::Arrival => path.states_blake3.clone(),
        SplitBy::Day => {
            blake3::hash(format!("{}", (path.from_s / SECONDS_PER_DAY).floor()).as_bytes())
                .to_string()
        }
    };
    let mut units: Vec<String> = written.iter().map(|(_, path)| unit(path)).collect();
    units.sort();
    units.dedup();
    let held =
        ((units.len() as f64 * TEST_SHARE).round() as usize).max(usize::from(units.len() > 1));
    let side = |path: &FlightPath| match units.binary_search(&unit(path)).unwrap_or_default() {
        first if first < held => Side::Test,
        first if first < 2 * held && units.len() > 2 => Side::Validation,
        _ => Side::Train,
    };
    let assignment = |(id, path): &(String, &FlightPath)| {
        let assigned = Assignment {
            trajectory: id.clone(),
            side: side(path),
        };
        (id.clone(), assigned)
    };
    Splits::new(written.iter().map(assignment).collect())
        .map_err(|leak| Error::Unusable(leak.to_string()))
}
