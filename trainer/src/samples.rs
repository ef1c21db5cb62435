//! Corpus samples: one per tick before touchdown, seen or not.
//!
//! Input: `splits.json`, and for each scenario its record, calibration, labelled ticks, one model's detections with their registrations,
//! and the camera health ([`crate::samples::camera_health`]). Boxes cut off by the image's edge are ignored (see
//! [`crate::samples::trusted_boxes`]). The remaining boxes are sorted by score; [`crate::samples::paired_views`] chooses among
//! them for whole flights. Ticks past the touchdown target are ignored, because the distance to touchdown grows again there. A committed
//! scenario that is missing from the split is an error.

pub(crate) mod camera_health;
pub(crate) mod lateral_spread;
pub(crate) mod paired_views;
pub(crate) mod rig;
pub(crate) mod robust_line;
pub(crate) mod row_line;
mod sample;
pub(crate) mod sides;
pub(crate) mod training_cameras;
pub(crate) mod trusted_boxes;
pub(crate) mod truth;
pub(crate) mod view_shift;

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::Path;

use dataset::conditions::{Weather, transmission};
use dataset::corpus::detections::{
    Detection, Detections, NoChoice, RegisteredWith, choose, registered_with,
};
use dataset::corpus::effective_weather::EffectiveWeather;
use dataset::corpus::model_identity::NamedDetections;
use dataset::corpus::open_scenario::OpenScenario;
use dataset::corpus::scenario::{Flight, Graphics, ScenarioRecord};
use dataset::corpus::splits::{Side, Splits};
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::geometry::camera::Camera;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::runway::Runway;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::plan::PlannedScenarios;
use dataset::tables::frames::{Frames, TickRow};
use dataset::tables::health::ViewHealth;
use dataset::tables::registrations::Registration;

use crate::error::{Error, Result};
use crate::samples::camera_health::late_images::{Pair, put_in_time};
use crate::samples::camera_health::{CameraHealth, Corrections};
use crate::samples::rig::Rig;
use crate::samples::sample::image_times::move_to_ticks;
use crate::samples::trusted_boxes::{is_whole, retain_first_aircraft};
use crate::samples::view_shift::ViewShift;

pub use sample::{Candidate, Look};
pub(crate) use sample::{CommonError, Observation, Sample};

/// Maximum distance from a runway on Earth, half its circumference, metres.
pub(crate) const FARTHEST_M: f64 = 10_800.0 * METERS_PER_NAUTICAL_MILE;
pub(crate) const NO_SCENARIOS: &str = "has no complete scenario; record some with `dtd generate`";

/// Range of distances to touchdown whose ticks become samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DistanceRange {
    pub min_nm: f64,
    pub max_nm: Option<f64>,
}

impl DistanceRange {
    pub(crate) fn contains(&self, dtd_m: f64) -> bool {
        let dtd_nm = dtd_m / METERS_PER_NAUTICAL_MILE;
        dtd_nm >= self.min_nm && self.max_nm.is_none_or(|max_nm| dtd_nm <= max_nm)
    }
}

/// Time of the decision about boxes: offline or live.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Moment {
    /// Whole flights: all boxes of confirmed tracks, corrected where a camera was off.
    Hindsight,
    /// The images up to each tick, as in live operation.
    Live,
}

/// A scenario without its samples.
#[derive(Debug, Clone)]
pub(crate) struct ScenarioSummary {
    pub id: String,
    pub folder: ScenarioFolder,
    pub trajectory: String,
    /// Trajectory identity, regardless of names (see [`flight_of`]).
    pub flight: String,
    /// Hash of the sealed manifest.
    pub manifest_blake3: String,
    pub side: Side,
    pub weather: String,
    /// Planned weather; `None` in a recorded scenario.
    pub planned_weather: Option<Weather>,
    /// Graphics settings of the simulator, empty if it does not say.
    pub graphics: Graphics,
    /// Weather that the simulator reported at the aircraft.
    pub effective_weather: Option<EffectiveWeather>,
    /// Local time as named in the sweep.
    pub time_of_day: String,
    /// Aircraft type.
    pub aircraft: String,
    pub runway: Runway,
    pub touchdown: Geodetic,
    /// Cameras in the order of the views, as placed in this scenario.
    pub cameras: Vec<Camera>,
    /// Boxes that camera health changed.
    pub corrections: Corrections,
    /// Cameras used for registration; `None` without registration.
    pub registered_with: Option<RegisteredWith>,
}

impl ScenarioSummary {
    fn of(
        scenario: &OpenScenario,
        record: ScenarioRecord,
        cameras: BTreeMap<String, Camera>,
        frames: &Frames,
        side: Side,
    ) -> Self {
        let folder = scenario.folder();
        Self {
            id: folder.id(),
            folder: folder.clone(),
            flight: flight_of(&record.flight, frames),
            manifest_blake3: scenario.seal().manifest_blake3.clone(),
            side,
            weather: record.weather_name().to_owned(),
            time_of_day: record.time_of_day().to_owned(),
            trajectory: record.trajectory,
            planned_weather: record.conditions.map(|planned| planned.weather),
            graphics: record.graphics.unwrap_or_default(),
            effective_weather: record.effective_weather,
            aircraft: record.aircraft,
            runway: record.runway,
            touchdown: record.touchdown,
            cameras: cameras.into_values().collect(),
            corrections: Corrections::default(),
            registered_with: None,
        }
    }

    /// True if the weather at the aircraft differs from the planned one.
    pub(crate) fn is_marked(&self) -> bool {
        let effective = self.effective_weather.as_ref();
        effective.is_some_and(EffectiveWeather::is_marked)
    }
}

#[derive(Debug, Clone)]
pub(crate) struct Samples {
    /// View names, sorted.
    pub views: Vec<String>,
    pub rig: Rig,
    pub detections: NamedDetections,
    /// Sorted by identifier.
    pub scenarios: Vec<ScenarioSummary>,
    /// Scenarios of the split that are missing from the corpus.
    pub absent_scenarios: Vec<String>,
    /// All ticks before touchdown, by scenario and tick, also those that no view saw.
    pub samples: Vec<Sample>,
}

impl Samples {
    pub(crate) fn read(corpus: &Corpus, asked: Option<&str>) -> Result<Self> {
        let splits = corpus.splits()?;
        let (mut found, folders) = Self::begin(corpus, asked)?;
        found.absent_scenarios = absent(&splits, &folders);
        for folder in &folders {
            let scenario = folder.open()?;
            let record = scenario.record()?;
            let side = side_of(&scenario, &record, &splits)?;
            let observed = found.observe(&scenario, record, side, Moment::Hindsight)?;
            found.add_labelled(&scenario, observed)?;
        }
        found.refuse_flights_on_two_sides(corpus)?;
        found.refuse_mixed_registrations()?;
        Ok(found)
    }

    /// Reads the samples of several corpora with the same rig. A flight on different sides of their splits goes to the test side, or else
    /// to validation. A scenario that several corpora contain counts once.
    pub(crate) fn read_all(corpora: &[Corpus], asked: Option<&str>) -> Result<Self> {
        let [first, others @ ..] = corpora else {
            return Err(Error::corpus(Path::new("."), NO_SCENARIOS));
        };
        let mut all = Self::read(first, asked)?;
        let mut sides = all.sides();
        for corpus in others {
            let model = all.detections.hash.clone();
            let mut other = Self::read(corpus, Some(&model))?;
            all.rig.join(first, corpus, &other.rig)?;
            for (flight, side) in other.sides() {
                let known = sides.entry(flight).or_insert(side);
                *known = side.max(*known);
            }
            let there = all.scenarios.iter().map(|s| s.manifest_blake3.clone());
            let there: BTreeSet<String> = there.collect();
            other.retain_scenarios(|scenario| !there.contains(&scenario.manifest_blake3));
            let before = all.scenarios.len();
            for sample in &mut other.samples {
                sample.observed.scenario += before;
            }
            all.samples.append(&mut other.samples);
            all.scenarios.append(&mut other.scenarios);
            all.absent_scenarios.append(&mut other.absent_scenarios);
        }
        for scenario in &mut all.scenarios {
            scenario.side = sides[&scenario.flight];
        }
        all.refuse_mixed_registrations()?;
        Ok(all)
    }

    fn sides(&self) -> BTreeMap<String, Side> {
        let scenarios = self.scenarios.iter();
        scenarios.map(|s| (s.flight.clone(), s.side)).collect()
    }

    /// Reads all flights with all ticks. Labels and a split are not needed: there are no samples, and sides have no meaning.
    pub(crate) fn without_truth(
        corpus: &Corpus,
        asked: Option<&str>,
        moment: Moment,
    ) -> Result<(Self, Vec<Observation>)> {
        let (mut found, folders) = Self::begin(corpus, asked)?;
        let mut flights = Vec::new();
        for folder in &folders {
            let scenario = folder.open()?;
            let record = scenario.record()?;
            let (summary, _, observations) =
                found.observe(&scenario, record, Side::Test, moment)?;
            found.scenarios.push(summary);
            flights.extend(observations);
        }
        found.refuse_mixed_registrations()?;
        Ok((found, flights))
    }

    /// Nothing yet of a corpus whose scenarios are all planned, and its scenarios.
    fn begin(corpus: &Corpus, asked: Option<&str>) -> Result<(Self, Vec<ScenarioFolder>)> {
        let planned = PlannedScenarios::read(corpus)?;
        let folders = corpus.scenarios()?;
        refuse_unplanned(&planned, &folders)?;
        let detections = choose_detections(corpus, &folders, asked)?;
        Ok((Self::empty(corpus, &folders, detections)?, folders))
    }

    fn empty(
        corpus: &Corpus,
        folders: &[ScenarioFolder],
        detections: NamedDetections,
    ) -> Result<Self> {
        let rig = Rig::of(corpus, folders)?;
        Ok(Self {
            views: rig.cameras.keys().cloned().collect(),
            rig,
            detections,
            scenarios: Vec::new(),
            absent_scenarios: Vec::new(),
            samples: Vec::new(),
        })
    }

    /// Drops scenarios with their samples.
    pub(crate) fn retain_scenarios(&mut self, is_kept: impl Fn(&ScenarioSummary) -> bool) {
        let mut indices = 0..;
        let new_index = |scenario| is_kept(scenario).then(|| indices.next()).flatten();
        let new: Vec<Option<usize>> = self.scenarios.iter().map(new_index).collect();
        self.samples.retain_mut(|sample| {
            let new = new[sample.scenario];
            sample.observed.scenario = new.unwrap_or_default();
            new.is_some()
        });
        self.scenarios.retain(is_kept);
    }

    /// Rejects training trajectories that reappear on the test side under a different name.
    fn refuse_flights_on_two_sides(&self, corpus: &Corpus) -> Result<()> {
        let mut first: BTreeMap<&str, &ScenarioSummary> = BTreeMap::new();
        for scenario in &self.scenarios {
            let one = *first.entry(&scenario.flight).or_insert(scenario);
            if one.side != scenario.side {
                let described = |s: &ScenarioSummary| {
                    format!("scenario {} ({}, {} side)", s.id, s.trajectory, s.side)
                };
                let fault = format!(
                    "{} and {} fly the same flight on different sides of the split; put both on one side in splits.json",
                    described(one),
                    described(scenario)
                );
                return Err(Error::corpus(corpus.root(), fault));
            }
        }
        Ok(())
    }

    /// Rejects shifts measured with different cameras: they differ by more than their errors.
    fn refuse_mixed_registrations(&self) -> Result<()> {
        let of = |s: &ScenarioSummary| Some((s.folder.clone(), s.registered_with.clone()?));
        let mut registered = self.scenarios.iter().filter_map(of);
        if let Some((first, expected)) = registered.next()
            && let Some((folder, found)) = registered.find(|(_, found)| *found != expected)
        {
            let fault = format!(
                "its views were registered with {found}, the views of scenario {} with {expected}, and shifts by different cameras do \
                 not fit each other; register all again: `dtd detect CORPUS --registration-of RUN`, or `dtd detect CORPUS --force` \
                 for calibration.json",
                first.id()
            );
            return Err(Error::corpus(folder.root(), fault));
        }
        Ok(())
    }

    pub(crate) fn registered_with(&self) -> Option<&RegisteredWith> {
        let mut scenarios = self.scenarios.iter();
        scenarios.find_map(|scenario| scenario.registered_with.as_ref())
    }

    /// Adds a scenario with samples for its labelled ticks.
    fn add_labelled(
        &mut self,
        scenario: &OpenScenario,
        (summary, frames, observations): (ScenarioSummary, Frames, Vec<Observation>),
    ) -> Result<()> {
        let folder = scenario.folder();
        let weather = summary.planned_weather.as_ref();
        let visibility_m = weather.map(|weather| weather.visibility_m);
        for (row, observed) in frames.rows.into_iter().zip(observations) {
            let labels = row.labels.ok_or_else(|| {
                let fault = "has no labels in frames.parquet; run `dtd label` on the corpus first";
                Error::corpus(folder.root(), fault)
            })?;
            for (column, value) in [
                ("dtd_m", labels.dtd_m),
                ("along_track_m", labels.along_track_m),
                ("cross_track_m", labels.cross_track_m),
            ] {
                // NaN is never in range.
                if !(-FARTHEST_M..=FARTHEST_M).contains(&value) {
                    let fault = format!(
                        "frames.parquet: tick {}: {column} is {value:?}, expected a distance on Earth, at most {FARTHEST_M} m; label \
                         the corpus again",
                        row.tick
                    );
                    return Err(Error::corpus(folder.root(), fault));
                }
            }
            if labels.along_track_m <= 0.0 {
                continue;
            }
            let position = row.pose.position();
            self.samples.push(Sample {
                observed,
                dtd_m: labels.dtd_m,
                along_track_m: labels.along_track_m,
                cross_track_m: labels.cross_track_m,
                position,
                transmission: best_transmission(&summary.cameras, position, visibility_m),
            });
        }
        self.scenarios.push(summary);
        Ok(())
    }

    /// Summary, ticks and observations for the next scenario.
    fn observe(
        &self,
        scenario: &OpenScenario,
        record: ScenarioRecord,
        side: Side,
        moment: Moment,
    ) -> Result<(ScenarioSummary, Frames, Vec<Observation>)> {
        let folder = scenario.folder();
        let cameras = cameras_of(scenario)?;
        let health = scenario.health(&self.detections.hash)?.unwrap_or_default();
        let detections = scenario.detections(&self.detections.hash)?;
        let looks = looks(&self.views, &health, moment);
        let look = |tick: u32, view: &String| {
            let view = self.views.binary_search(view).ok();
            let look = view.and_then(|view| looks.get(&(tick, view)));
            look.copied().unwrap_or(Look::Placed)
        };
        let mut detections: Vec<_> = match moment {
            Moment::Hindsight => detections.into_confirmed().collect(),
            Moment::Live => counting_live(detections, look).ok_or_else(|| {
                let fault = "its detections do not say which boxes counted at each moment, because an earlier version made them; run \
                             `dtd detect --force` on the corpus with that model";
                Error::corpus(folder.root(), fault)
            })?,
        };
        if let Some(Detection { view, .. }) = detections
            .iter()
            .find(|detection| !self.views.contains(&detection.view))
        {
            let fault =
                format!("has detections of view {view}, which calibration.json does not list");
            return Err(Error::corpus(folder.root(), fault));
        }
        let mut of_others = HashSet::new();
        if side == Side::Train && !record.traffic.is_empty() {
            let truth = scenario.truth_boxes_if_labelled()?.unwrap_or_default();
            of_others = retain_first_aircraft(&mut detections, &truth);
        }
        let frames = scenario.frames()?;
        let mut detections = whole_boxes(detections, &cameras);
        move_to_ticks(&mut detections, &frames);
        let registrations = scenario
            .registrations(&self.detections.hash)?
            .unwrap_or_default();
        let mut registrations: BTreeMap<(u32, String), Registration> = registrations
            .into_iter()
            .filter(|of| {
                let views = [&of.view, &of.reference];
                !views
                    .iter()
                    .any(|view| of_others.contains(&(of.tick, view.to_string())))
            })
            .map(|registration| ((registration.tick, registration.view.clone()), registration))
            .collect();
        let mut summary = ScenarioSummary::of(scenario, record, cameras, &frames, side);
        summary.registered_with = registered_with(folder, &self.detections.hash)?;
        let observe = |row: &TickRow| {
            let found: Vec<_> = self
                .views
                .iter()
                .map(|view| detections.remove(&(row.tick, view.clone())))
                .collect();
            let shifts: Vec<Option<ViewShift>> = (self.views.iter())
                .map(|view| {
                    let registration = registrations.remove(&(row.tick, view.clone()))?;
                    let reference = self.views.binary_search(&registration.reference).ok()?;
                    Some(ViewShift::of(reference, &registration.result.ok()?))
                })
                .collect();
            let at = (self.scenarios.len(), row.tick, row.time_ns);
            let views = self.views.iter();
            let looks = views.map(|view| {
                let recorded = frames.views.iter().zip(&row.image_times_ns);
                let has_none = recorded
                    .into_iter()
                    .any(|(of, at)| of == view && at.is_none());
                if has_none {
                    Look::Blind
                } else {
                    look(row.tick, view)
                }
            });
            Observation::of(at, found, shifts, looks.collect())
        };
        let mut observations: Vec<Observation> = frames.rows.iter().map(observe).collect();
        if moment == Moment::Hindsight {
            let times_s = observations.iter();
            let times_s = times_s.map(|of| (of.tick, of.time_s())).collect();
            let health = CameraHealth::of(&self.views, &summary.cameras, &health, &times_s);
            observations = (observations.into_iter())
                .map(|observed| health.corrected(observed, &mut summary.corrections))
                .collect();
        }
        Ok((summary, frames, observations))
    }

    /// Samples on one side that at least one view saw.
    pub(crate) fn of_side(&self, side: Side) -> Vec<&Sample> {
        self.ticks_of_side(side)
            .filter(|sample| sample.detections() > 0)
            .collect()
    }

    /// Corrects late images on some sides, by rows that a run knows, or else by the planned cameras.
    pub(crate) fn put_in_time(&mut self, sides: &[Side], pairs: &[Pair]) -> Vec<String> {
        let counts: Vec<bool> = (self.scenarios.iter())
            .map(|scenario| sides.contains(&scenario.side))
            .collect();
        let observations = self.samples.iter_mut().map(|sample| &mut sample.observed);
        let observations = observations.filter(|observed| counts[observed.scenario]);
        put_in_time(&self.views, &mut self.scenarios, observations, pairs)
    }

    /// Drops the ticks outside a range of distances.
    pub(crate) fn retain_within(&mut self, range: DistanceRange) {
        self.samples.retain(|sample| range.contains(sample.dtd_m));
    }

    /// Includes common errors in the deviations of the shifts, for training ([`Observation::move_common_to_shifts`]).
    pub(crate) fn move_common_to_shifts(&mut self) {
        for sample in &mut self.samples {
            sample.observed.move_common_to_shifts();
        }
    }

    pub(crate) fn test_all(&mut self) {
        for scenario in &mut self.scenarios {
            scenario.side = Side::Test;
        }
    }

    /// All ticks on one side, seen or not, flight by flight in temporal order.
    pub(crate) fn ticks_of_side(&self, side: Side) -> impl Iterator<Item = &Sample> {
        self.samples
            .iter()
            .filter(move |sample| self.scenarios[sample.scenario].side == side)
    }

    /// Flights on one side, each with all its ticks in temporal order.
    pub(crate) fn flights_of_side(&self, side: Side) -> impl Iterator<Item = &[Sample]> {
        let flights = self.samples.chunk_by(|a, b| a.scenario == b.scenario);
        flights.filter(move |flight| self.scenarios[flight[0].scenario].side == side)
    }

    /// BLAKE3 hash over the scenarios on these sides: observations, ground truth, and planned cameras.
    pub(crate) fn hash(&self, sides: &[Side]) -> String {
        let mut hash = blake3::Hasher::new();
        hash.update(format!("{:?}\n", self.rig.planned()).as_bytes());
        for scenario in &self.scenarios {
            if sides.contains(&scenario.side) {
                let (id, side) = (&scenario.id, scenario.side);
                let manifest = &scenario.manifest_blake3;
                hash.update(format!("{id} {manifest} {side:?}\n").as_bytes());
            }
        }
        for side in sides {
            for sample in self.ticks_of_side(*side) {
                // The shortest digits that tell each number from all others.
                hash.update(format!("{sample:?}\n").as_bytes());
            }
        }
        hash.finalize().to_string()
    }

    pub(crate) fn scenarios_of(&self, side: Side) -> impl Iterator<Item = &ScenarioSummary> {
        self.scenarios.iter().filter(move |s| s.side == side)
    }

    /// Flight identities on one side.
    pub(crate) fn flights(&self, side: Side) -> BTreeSet<String> {
        let scenarios = self.scenarios_of(side);
        scenarios.map(|s| s.flight.clone()).collect()
    }

    pub(crate) fn scenario_count(&self, side: Side) -> usize {
        self.scenarios_of(side).count()
    }

    pub(crate) fn trajectories(&self, side: Side) -> BTreeSet<String> {
        let scenarios = self.scenarios_of(side);
        scenarios.map(|s| s.trajectory.clone()).collect()
    }
}

/// Image usability, as known at that moment. In hindsight no image is blind: [`CameraHealth`] excludes images or corrects them.
fn looks(views: &[String], health: &[ViewHealth], moment: Moment) -> BTreeMap<(u32, usize), Look> {
    let judged = health.iter().filter_map(|row| {
        let look = match moment {
            Moment::Hindsight if row.hides_direction() => Look::Unplaced,
            Moment::Hindsight => Look::Placed,
            Moment::Live => Look::of(row.state_live),
        };
        Some(((row.tick, views.binary_search(&row.view).ok()?), look))
    });
    judged.collect()
}

/// Boxes accepted live, without those in blind images; `None` if the detections do not record it.
fn counting_live(
    detections: Detections,
    look: impl Fn(u32, &String) -> Look,
) -> Option<Vec<Detection>> {
    let mut counting = Vec::new();
    for found in detections.boxes {
        if found.counts_live? && look(found.tick, &found.view) != Look::Blind {
            counting.push(found);
        }
    }
    Some(counting)
}

fn side_of(scenario: &OpenScenario, record: &ScenarioRecord, splits: &Splits) -> Result<Side> {
    let folder = scenario.folder();
    let assignment = splits.scenarios.get(&folder.id()).ok_or_else(|| {
        let fault =
            "is not in splits.json, so it is on no side; make the corpus again from one plan";
        Error::corpus(folder.root(), fault)
    })?;
    if assignment.trajectory != record.trajectory {
        let fault = format!(
            "flies trajectory {} by its scenario.json but {} by splits.json; the split cannot be trusted",
            record.trajectory, assignment.trajectory
        );
        return Err(Error::corpus(folder.root(), fault));
    }
    Ok(assignment.side)
}

fn cameras_of(scenario: &OpenScenario) -> Result<BTreeMap<String, Camera>> {
    let calibration = scenario.calibration()?;
    let cameras = calibration.cameras.iter();
    Ok(cameras
        .map(|(view, entry)| (view.clone(), entry.camera()))
        .collect())
}

fn absent(splits: &Splits, folders: &[ScenarioFolder]) -> Vec<String> {
    let present: BTreeSet<String> = folders.iter().map(ScenarioFolder::id).collect();
    let planned = splits.scenarios.keys();
    planned
        .filter(|id| !present.contains(*id))
        .cloned()
        .collect()
}

/// Sampling times for flight identities, seconds.
const KNOWN_BY_S: [i64; 4] = [0, 60, 120, 180];

/// Trajectory identity, regardless of names: the hash of the replayed recording, or of the flown path. Live flights from
/// two sweeps may share a name, and copied recordings may have different ones. A path is identified by its positions at whole minutes,
/// because the same flight may be recorded at different frame rates; a path shorter than a minute, by all its ticks.
fn flight_of(flight: &Flight, frames: &Frames) -> String {
    if let Flight::Recorded { blake3, .. } = flight {
        return blake3.clone();
    }
    let at = |seconds: i64| {
        let mut rows = frames.rows.iter();
        rows.find(|row| row.time_ns == seconds * 1_000_000_000)
    };
    let known: Vec<&TickRow> = KNOWN_BY_S.into_iter().map_while(at).collect();
    let rows = match known.len() {
        0 | 1 => frames.rows.iter().collect(),
        _ => known,
    };
    let mut path = blake3::Hasher::new();
    for row in rows {
        path.update(&row.time_ns.to_le_bytes());
        let Geodetic {
            latitude_deg,
            longitude_deg,
            altitude_msl_m,
        } = row.pose.position();
        for number in [latitude_deg, longitude_deg, altitude_msl_m] {
            path.update(&number.to_le_bytes());
        }
    }
    path.finalize().to_string()
}

/// Rejects scenarios that are missing from the plan or have other parameters there. This runs before the rest of the plan is read: a
/// foreign plan may have other cameras.
fn refuse_unplanned(planned: &PlannedScenarios, folders: &[ScenarioFolder]) -> Result<()> {
    for folder in folders {
        let scenario = folder.open()?;
        planned.check(&scenario.id(), &scenario.seal().config_hash)?;
    }
    Ok(())
}

/// Whole boxes per tick and view, sorted by score; an empty list where the image's edge cuts all boxes off.
fn whole_boxes(
    detections: Vec<Detection>,
    cameras: &BTreeMap<String, Camera>,
) -> BTreeMap<(u32, String), Vec<Candidate>> {
    let mut found: BTreeMap<(u32, String), Vec<Candidate>> = BTreeMap::new();
    for Detection {
        tick,
        view,
        pixel_box,
        score,
        track,
        ..
    } in detections
    {
        found.entry((tick, view)).or_default().push(Candidate {
            pixel_box,
            score,
            track,
        });
    }
    for ((_, view), found) in &mut found {
        keep_whole(found, &cameras[view]);
    }
    found
}

/// Keeps the whole boxes of an image, and sorts them by score.
pub(crate) fn keep_whole(found: &mut Vec<Candidate>, camera: &Camera) {
    found.retain(|candidate| is_whole(&candidate.pixel_box, camera));
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
}

/// Share of contrast that remains over the distance to the nearest camera whose image contains the aircraft; an
/// unknown weather counts as clear.
fn best_transmission(
    cameras: &[Camera],
    position: Geodetic,
    visibility_m: Option<f64>,
) -> Option<f64> {
    let aircraft_m = position.to_ecef();
    cameras
        .iter()
        .filter(|camera| camera.shows(aircraft_m))
        .map(|camera| {
            let range_m = camera.center_ecef_m.distance(aircraft_m);
            visibility_m.map_or(1.0, |visibility_m| transmission(range_m, visibility_m))
        })
        .reduce(f64::max)
}

/// Detections by model file name or hash, or the only ones available.
fn choose_detections(
    corpus: &Corpus,
    folders: &[ScenarioFolder],
    asked: Option<&str>,
) -> Result<NamedDetections> {
    let fault = match (choose(folders, asked)?, asked) {
        (Ok(chosen), _) => return Ok(chosen),
        (Err(NoChoice::None), Some(asked)) => {
            format!("has no detections of model {asked}; run `dtd detect` first")
        }
        (Err(NoChoice::None), None) => "has no detections; run `dtd detect` first".to_owned(),
        (Err(NoChoice::Others(listed)), asked) => {
            let asked = asked.unwrap_or_default();
            format!("has no detections of model {asked}, only of {listed}")
        }
        (Err(NoChoice::Several(listed)), _) => format!(
            "has detections of several models: {listed}; choose one with --detections, by its file or hash"
        ),
    };
    Err(Error::corpus(corpus.root(), fault))
}

#[cfg(test)]
pub(crate) mod tests;
