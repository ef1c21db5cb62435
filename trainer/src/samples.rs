//! From a corpus to samples: one per tick before touchdown, seen or not.
//!
//! Input: `splits.json`, and per scenario its record, calibration, labelled ticks, one model's detections, their registrations and the
//! condition of the cameras ([`crate::samples::camera_health`]). Boxes cut off by the image's edge are ignored (see
//! [`crate::samples::trusted_boxes`]). Of the others of a view at a tick the one with the highest score comes first; which one an estimator
//! gets is decided for whole flights ([`crate::samples::paired_views`]). Ticks past the touchdown target are ignored, because the distance
//! to touchdown grows again there. A committed scenario that is missing from the split is an error.

pub(crate) mod camera_health;
pub(crate) mod json_differences;
pub(crate) mod lateral_spread;
pub(crate) mod paired_views;
pub(crate) mod rig;
mod sample;
pub(crate) mod sides;
pub(crate) mod training_cameras;
pub(crate) mod trusted_boxes;
pub(crate) mod truth;
pub(crate) mod view_shift;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use dataset::conditions::{Weather, transmission};
use dataset::corpus::detections::{
    Detection, Detections, NoChoice, RegisteredWith, choose, registered_with,
};
use dataset::corpus::effective_weather::EffectiveWeather;
use dataset::corpus::model_identity::NamedDetections;
use dataset::corpus::open_scenario::OpenScenario;
use dataset::corpus::scenario::{Flight, ScenarioRecord};
use dataset::corpus::splits::{Side, Splits};
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::geometry::camera::Camera;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::runway::Runway;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::plan::PlannedScenarios;
use dataset::tables::frames::{Frames, TickRow};
use dataset::tables::health::{HealthState, ViewHealth, ViewLag, late_views};
use dataset::tables::registrations::Registration;

use crate::error::{CorpusFault, Error, Result};
use crate::samples::camera_health::late_images::{in_time, lateness};
use crate::samples::camera_health::look::Look;
use crate::samples::camera_health::{CameraHealth, Corrections};
use crate::samples::rig::Rig;
use crate::samples::trusted_boxes::is_whole;
use crate::samples::trusted_boxes::other_boxes::{Candidate, Registered};
use crate::samples::view_shift::ViewShift;

pub(crate) use sample::{CommonError, Observation, Sample};

/// Maximum distance from a runway on Earth: half of its circumference, nautical miles.
pub(crate) const FARTHEST_NM: f64 = 10_800.0;

/// The same in metres.
pub(crate) const FARTHEST_M: f64 = FARTHEST_NM * METERS_PER_NAUTICAL_MILE;

/// Range of distances to touchdown whose ticks become samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DistanceRange {
    /// Smallest distance, nautical miles.
    pub min_nm: f64,
    /// Largest distance, nautical miles.
    pub max_nm: Option<f64>,
}

impl DistanceRange {
    /// Everything before touchdown.
    pub(crate) const ALL: Self = Self {
        min_nm: 0.0,
        max_nm: None,
    };

    pub(crate) fn contains(&self, dtd_m: f64) -> bool {
        let dtd_nm = dtd_m / METERS_PER_NAUTICAL_MILE;
        dtd_nm >= self.min_nm && self.max_nm.is_none_or(|max_nm| dtd_nm <= max_nm)
    }
}

/// Moment at which it is decided which boxes of a corpus count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Moment {
    /// Whole flights: all boxes of confirmed tracks, moved where a camera was off.
    Hindsight,
    /// The images up to each tick, as without an end.
    Live,
}

/// Information about a scenario apart from its samples.
#[derive(Debug, Clone)]
pub(crate) struct ScenarioSummary {
    /// Identifier.
    pub id: String,
    /// Its folder.
    pub folder: ScenarioFolder,
    /// Trajectory that it flies.
    pub trajectory: String,
    /// Identity of that trajectory, independent of its name (see [`flight_of`]).
    pub flight: String,
    /// Hash of the manifest that the scenario is sealed with.
    pub manifest_blake3: String,
    /// Side of the split.
    pub side: Side,
    /// Name of the weather.
    pub weather: String,
    /// The weather as planned.
    pub planned_weather: Weather,
    /// The weather at the aircraft, if the simulator reported it.
    pub effective_weather: Option<EffectiveWeather>,
    /// Local time as the sweep names it.
    pub time_of_day: String,
    /// The runway.
    pub runway: Runway,
    /// The touchdown target.
    pub touchdown: Geodetic,
    /// Its cameras, in the order of the views, as placed in this scenario.
    pub cameras: Vec<Camera>,
    /// Boxes that the condition of its cameras changed.
    pub corrections: Corrections,
    /// The cameras that its views were registered with; `None` if they were not.
    pub registered_with: Option<RegisteredWith>,
}

impl ScenarioSummary {
    /// The summary of a scenario with this record, these cameras, and this side of the split.
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
            trajectory: record.trajectory,
            side,
            weather: record.conditions.weather_name,
            planned_weather: record.conditions.weather,
            effective_weather: record.effective_weather,
            time_of_day: record.conditions.time_of_day,
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

/// All samples of a corpus.
#[derive(Debug, Clone)]
pub(crate) struct Samples {
    /// Identifiers of the views, sorted.
    pub views: Vec<String>,
    /// The cameras that they belong to.
    pub rig: Rig,
    /// The detections that the boxes are from.
    pub detections: NamedDetections,
    /// The scenarios, sorted by identifier.
    pub scenarios: Vec<ScenarioSummary>,
    /// Scenarios of the split that are not in the corpus (yet).
    pub absent_scenarios: Vec<String>,
    /// The samples, by scenario and tick: all ticks of a flight within the range, also those that no view saw.
    pub samples: Vec<Sample>,
}

impl Samples {
    /// Reads the samples of a corpus.
    pub(crate) fn read(corpus: &Corpus, asked: Option<&str>, range: DistanceRange) -> Result<Self> {
        let splits = corpus.splits()?;
        let planned = PlannedScenarios::read(corpus)?;
        let folders = corpus.scenarios()?;
        refuse_unplanned(&planned, &folders)?;
        let mut found = Self::empty(corpus, &folders, asked)?;
        found.absent_scenarios = absent(&splits, &folders);
        for folder in &folders {
            let scenario = folder.open()?;
            found.add_scenario(&scenario, &splits, range)?;
        }
        found.refuse_flights_on_two_sides(corpus)?;
        found.refuse_mixed_registrations()?;
        Ok(found)
    }

    /// Reads the samples of several corpora of one rig. A flight that their splits have on different sides is on the one farthest from
    /// training: the test side, or else validation. A scenario that is in several of them counts once.
    pub(crate) fn read_all(
        corpora: &[Corpus],
        asked: Option<&str>,
        range: DistanceRange,
    ) -> Result<Self> {
        let [first, others @ ..] = corpora else {
            return Err(Error::corpus(Path::new("."), CorpusFault::NoScenarios));
        };
        let mut all = Self::read(first, asked, range)?;
        let mut sides = all.sides();
        for corpus in others {
            let model = all.detections.hash.clone();
            let mut other = Self::read(corpus, Some(&model), range)?;
            all.rig.join(first, corpus, &other.rig)?;
            for (flight, side) in other.sides() {
                let known = sides.entry(flight).or_insert(side);
                *known = farther_from_training(*known, side);
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

    /// The side of each flight.
    fn sides(&self) -> BTreeMap<String, Side> {
        let scenarios = self.scenarios.iter();
        scenarios.map(|s| (s.flight.clone(), s.side)).collect()
    }

    /// The flights of a corpus, with all of their ticks. It needs neither labels nor a split: there are no samples, and sides are
    /// meaningless.
    pub(crate) fn without_truth(
        corpus: &Corpus,
        asked: Option<&str>,
        moment: Moment,
    ) -> Result<(Self, Vec<Observation>)> {
        let planned = PlannedScenarios::read(corpus)?;
        let folders = corpus.scenarios()?;
        refuse_unplanned(&planned, &folders)?;
        let mut found = Self::empty(corpus, &folders, asked)?;
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

    fn empty(corpus: &Corpus, folders: &[ScenarioFolder], asked: Option<&str>) -> Result<Self> {
        let detections = choose_detections(corpus, folders, asked)?;
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
        let mut kept = 0;
        let places: Vec<Option<usize>> = (self.scenarios.iter())
            .map(|scenario| {
                is_kept(scenario).then(|| {
                    kept += 1;
                    kept - 1
                })
            })
            .collect();
        self.samples
            .retain_mut(|sample| match places[sample.scenario] {
                Some(place) => {
                    sample.observed.scenario = place;
                    true
                }
                None => false,
            });
        self.scenarios.retain(is_kept);
    }

    /// A copy of a trajectory under another name would be tested by what it was trained on.
    fn refuse_flights_on_two_sides(&self, corpus: &Corpus) -> Result<()> {
        let mut first: BTreeMap<&str, &ScenarioSummary> = BTreeMap::new();
        for scenario in &self.scenarios {
            let one = *first.entry(&scenario.flight).or_insert(scenario);
            if one.side != scenario.side {
                let described = |s: &ScenarioSummary| (s.id.clone(), s.trajectory.clone(), s.side);
                let fault = CorpusFault::FlightOnTwoSides {
                    one: described(one),
                    other: described(scenario),
                };
                return Err(Error::corpus(corpus.root(), fault));
            }
        }
        Ok(())
    }

    /// Shifts that follow from different cameras differ by more than their errors.
    fn refuse_mixed_registrations(&self) -> Result<()> {
        let of = |s: &ScenarioSummary| Some((s.folder.clone(), s.registered_with.clone()?));
        let mut registered = self.scenarios.iter().filter_map(of);
        let Some((first, expected)) = registered.next() else {
            return Ok(());
        };
        match registered.find(|(_, found)| *found != expected) {
            None => Ok(()),
            Some((folder, found)) => {
                let fault = CorpusFault::OtherRegistration {
                    found,
                    first: first.id(),
                    expected,
                };
                Err(Error::corpus(folder.root(), fault))
            }
        }
    }

    /// The cameras that all registered views were registered with.
    pub(crate) fn registered_with(&self) -> Option<&RegisteredWith> {
        let mut scenarios = self.scenarios.iter();
        scenarios.find_map(|scenario| scenario.registered_with.as_ref())
    }

    fn add_scenario(
        &mut self,
        scenario: &OpenScenario,
        splits: &Splits,
        range: DistanceRange,
    ) -> Result<()> {
        let record = scenario.record()?;
        let side = side_of(scenario, &record, splits)?;
        let observed = self.observe(scenario, record, side, Moment::Hindsight)?;
        self.add_labelled(scenario, observed, range)
    }

    /// Adds a scenario with the samples of its labelled ticks.
    fn add_labelled(
        &mut self,
        scenario: &OpenScenario,
        (summary, frames, observations): (ScenarioSummary, Frames, Vec<Observation>),
        range: DistanceRange,
    ) -> Result<()> {
        let folder = scenario.folder();
        let refused = |fault| Error::corpus(folder.root(), fault);
        let visibility_m = summary.planned_weather.visibility_m;
        for (row, observed) in frames.rows.into_iter().zip(observations) {
            let labels = (row.labels).ok_or_else(|| refused(CorpusFault::NoLabels))?;
            for (column, value) in [
                ("dtd_m", labels.dtd_m),
                ("along_track_m", labels.along_track_m),
                ("cross_track_m", labels.cross_track_m),
            ] {
                // NaN is never in range.
                if !(-FARTHEST_M..=FARTHEST_M).contains(&value) {
                    let tick = row.tick;
                    return Err(refused(CorpusFault::NotOnEarth {
                        tick,
                        column,
                        value,
                        most_m: FARTHEST_M,
                    }));
                }
            }
            if labels.along_track_m <= 0.0 || !range.contains(labels.dtd_m) {
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

    /// Summary of the next scenario, its ticks, and the observation at each.
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
        let detections: Vec<_> = match moment {
            Moment::Hindsight => detections.into_confirmed().collect(),
            Moment::Live => counting_live(detections, look)
                .ok_or_else(|| Error::corpus(folder.root(), CorpusFault::NoLiveBoxes))?,
        };
        if let Some(Detection { view, .. }) = detections
            .iter()
            .find(|detection| !self.views.contains(&detection.view))
        {
            let fault = CorpusFault::UnknownView(view.clone());
            return Err(Error::corpus(folder.root(), fault));
        }
        let mut detections = whole_boxes(detections, &cameras);
        let registrations = scenario
            .registrations(&self.detections.hash)?
            .unwrap_or_default();
        let mut registrations: BTreeMap<(u32, String), Registration> = registrations
            .into_iter()
            .map(|registration| ((registration.tick, registration.view.clone()), registration))
            .collect();
        let mut corrections = Corrections::default();
        if moment == Moment::Hindsight {
            let contradicts = |row: &&ViewHealth| row.state == HealthState::Inconsistent;
            for row in health.iter().filter(contradicts) {
                let shift = registrations.remove(&(row.tick, row.view.clone()));
                corrections.contradicting += usize::from(shift.is_some());
            }
        }
        let frames = scenario.frames()?;
        let mut summary = ScenarioSummary::of(scenario, record, cameras, &frames, side);
        summary.registered_with = registered_with(folder, &self.detections.hash)?;
        let observe = |row: &TickRow| {
            let found: Vec<_> = self
                .views
                .iter()
                .map(|view| detections.remove(&(row.tick, view.clone())))
                .collect();
            let registered: Vec<Option<Registered>> = (self.views.iter())
                .map(|view| {
                    let registration = registrations.remove(&(row.tick, view.clone()))?;
                    let reference = self.views.binary_search(&registration.reference).ok()?;
                    Some((reference, registration.result.ok()?))
                })
                .collect();
            let at = (self.scenarios.len(), row.tick, row.time_ns);
            let views = self.views.iter();
            let looks = views.map(|view| look(row.tick, view));
            Observation::of(at, &found, &registered, looks.collect())
        };
        if moment == Moment::Live {
            let observations: Vec<Observation> = frames.rows.iter().map(observe).collect();
            let late = late_views(&health, ViewLag::is_sure);
            let boxes = observations
                .iter()
                .flat_map(|of| of.boxes.iter().zip(&self.views));
            let late =
                boxes.filter(|(seen, view)| seen.is_some() && late.contains_key(view.as_str()));
            corrections.late_kept = late.count();
            summary.corrections = corrections;
            return Ok((summary, frames, observations));
        }
        let late = lateness(&self.views, &health);
        let health = CameraHealth::of(&self.views, &summary.cameras, health);
        let observations = (frames.rows.iter().map(observe))
            .map(|observed| health.corrected(observed, &mut corrections))
            .collect();
        let observations = in_time(observations, &late, &mut corrections);
        summary.corrections = corrections;
        Ok((summary, frames, observations))
    }

    /// The samples of one side of the split that at least one view saw.
    pub(crate) fn of_side(&self, side: Side) -> Vec<&Sample> {
        self.ticks_of_side(side)
            .filter(|sample| sample.detections() > 0)
            .collect()
    }

    /// Makes the common errors of all samples part of their shifts' deviations, for a training ([`Sample::move_common_to_shifts`]).
    pub(crate) fn move_common_to_shifts(&mut self) {
        self.samples
            .iter_mut()
            .for_each(Sample::move_common_to_shifts);
    }

    /// Puts all scenarios on the test side.
    pub(crate) fn test_all(&mut self) {
        for scenario in &mut self.scenarios {
            scenario.side = Side::Test;
        }
    }

    /// All ticks of one side of the split, seen or not, flight by flight in the order of time.
    pub(crate) fn ticks_of_side(&self, side: Side) -> impl Iterator<Item = &Sample> {
        self.samples
            .iter()
            .filter(move |sample| self.scenarios[sample.scenario].side == side)
    }

    /// The flights of one side, each with all of its ticks in the order of time.
    pub(crate) fn flights_of_side(&self, side: Side) -> impl Iterator<Item = &[Sample]> {
        let flights = self.samples.chunk_by(|a, b| a.scenario == b.scenario);
        flights.filter(move |flight| self.scenarios[flight[0].scenario].side == side)
    }

    /// BLAKE3 over the scenarios of these sides, what the cameras saw in them, the truth, and the cameras as planned.
    pub(crate) fn hash(&self, sides: &[Side]) -> String {
        let mut hash = blake3::Hasher::new();
        hash.update(format!("{:?}\n", self.rig.planned()).as_bytes());
        for scenario in &self.scenarios {
            if sides.contains(&scenario.side) {
                let ScenarioSummary {
                    id,
                    manifest_blake3,
                    side,
                    ..
                } = scenario;
                hash.update(format!("{id} {manifest_blake3} {side:?}\n").as_bytes());
            }
        }
        for sample in &self.samples {
            if !sides.contains(&self.scenarios[sample.scenario].side) {
                continue;
            }
            hash.update(&sample.tick.to_le_bytes());
            hash.update(&sample.dtd_m.to_le_bytes());
            hash.update(&sample.cut_off.to_le_bytes());
            for CommonError { view, sd_px } in &sample.common_errors {
                for number in [*view as f64, sd_px.x, sd_px.y] {
                    hash.update(&number.to_le_bytes());
                }
            }
            for (view, (seen, shift)) in sample.boxes.iter().zip(&sample.shifts).enumerate() {
                let seen = seen.map(|b| [b.cx_px, b.cy_px, b.width_px, b.height_px]);
                let shift = shift.map(|shift| {
                    let ViewShift {
                        reference,
                        shift_px,
                        sd_px,
                        scale,
                        gain,
                        correlation,
                    } = shift;
                    let [x, y, sd_x, sd_y] = [shift_px.x, shift_px.y, sd_px.x, sd_px.y];
                    [reference as f64, x, y, sd_x, sd_y, scale, gain, correlation]
                });
                let numbers = (seen.iter().flatten()).chain(shift.iter().flatten());
                hash.update(&[
                    view as u8,
                    u8::from(seen.is_some()),
                    u8::from(shift.is_some()),
                ]);
                for number in numbers {
                    hash.update(&number.to_le_bytes());
                }
                for candidate in sample.candidates(view) {
                    let Candidate {
                        pixel_box: b,
                        track,
                    } = candidate;
                    for number in [b.cx_px, b.cy_px, b.width_px, b.height_px] {
                        hash.update(&number.to_le_bytes());
                    }
                    hash.update(&track.map_or(u64::MAX, u64::from).to_le_bytes());
                }
            }
        }
        hash.finalize().to_string()
    }

    /// Identities of the flights on one side of the split.
    pub(crate) fn flights(&self, side: Side) -> BTreeSet<String> {
        let scenarios = self.scenarios.iter().filter(|s| s.side == side);
        scenarios.map(|s| s.flight.clone()).collect()
    }

    /// Number of scenarios on one side of the split.
    pub(crate) fn scenario_count(&self, side: Side) -> usize {
        self.scenarios.iter().filter(|s| s.side == side).count()
    }

    /// The trajectories of one side of the split.
    pub(crate) fn trajectories(&self, side: Side) -> BTreeSet<String> {
        self.scenarios
            .iter()
            .filter(|s| s.side == side)
            .map(|s| s.trajectory.clone())
            .collect()
    }
}

fn farther_from_training(one: Side, other: Side) -> Side {
    match (one, other) {
        (Side::Test, _) | (_, Side::Test) => Side::Test,
        (Side::Validation, _) | (_, Side::Validation) => Side::Validation,
        (Side::Train, Side::Train) => Side::Train,
    }
}

/// The images of a scenario as they were judged at that moment. In hindsight none is blind: [`CameraHealth`] leaves images out, and
/// corrects others.
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

/// Boxes that counted at their ticks, without those of blind images; `None` if the detections do not say which counted.
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

/// The side of a scenario's trajectory.
fn side_of(scenario: &OpenScenario, record: &ScenarioRecord, splits: &Splits) -> Result<Side> {
    let folder = scenario.folder();
    let refused = |fault| Error::corpus(folder.root(), fault);
    let assignment =
        (splits.scenarios.get(&folder.id())).ok_or_else(|| refused(CorpusFault::NotInSplit))?;
    if assignment.trajectory != record.trajectory {
        return Err(refused(CorpusFault::OtherTrajectory {
            recorded: record.trajectory.clone(),
            split: assignment.trajectory.clone(),
        }));
    }
    Ok(assignment.side)
}

/// The cameras of a scenario by view.
fn cameras_of(scenario: &OpenScenario) -> Result<BTreeMap<String, Camera>> {
    let calibration = scenario.calibration()?;
    let cameras = calibration.cameras.iter();
    Ok(cameras
        .map(|(view, entry)| (view.clone(), entry.camera()))
        .collect())
}

fn absent(splits: &Splits, folders: &[ScenarioFolder]) -> Vec<String> {
    let present: BTreeSet<String> = folders.iter().map(ScenarioFolder::id).collect();
    splits
        .scenarios
        .keys()
        .filter(|id| !present.contains(*id))
        .cloned()
        .collect()
}

/// A flight is known by its places at these times, of those that it lasts; seconds.
const KNOWN_BY_S: [i64; 4] = [0, 60, 120, 180];

/// Identity of a trajectory, independent of its name: the hash of the recording that it replays, or of the flown path. Live flights of two
/// sweeps may share a name, and copies of a recording may have several. The path is identified by its positions after whole minutes, since
/// the same flight may be recorded at different frame rates; by all of its ticks if it is shorter than a minute.
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

/// Rejects scenarios that the plan does not have, or has with other parameters. Before anything else of the plan is read: a foreign plan
/// may have other cameras.
fn refuse_unplanned(planned: &PlannedScenarios, folders: &[ScenarioFolder]) -> Result<()> {
    for folder in folders {
        let scenario = folder.open()?;
        planned.check(&scenario.id(), &scenario.seal().config_hash)?;
    }
    Ok(())
}

/// The whole boxes per tick and view, the highest score first; none where the image's edge cuts off all of them.
fn whole_boxes(
    detections: Vec<Detection>,
    cameras: &BTreeMap<String, Camera>,
) -> BTreeMap<(u32, String), Vec<Candidate>> {
    let mut found: BTreeMap<(u32, String), Vec<Scored>> = BTreeMap::new();
    for Detection {
        tick,
        view,
        pixel_box,
        score,
        track,
        ..
    } in detections
    {
        let candidate = Candidate { pixel_box, track };
        found
            .entry((tick, view))
            .or_default()
            .push((score, candidate));
    }
    let whole = |((tick, view), found): ((u32, String), Vec<Scored>)| {
        let whole = whole_of(found, &cameras[&view]);
        ((tick, view), whole)
    };
    found.into_iter().map(whole).collect()
}

/// A box with its score.
pub(crate) type Scored = (f64, Candidate);

/// The whole boxes of an image, the highest score first.
pub(crate) fn whole_of(found: impl IntoIterator<Item = Scored>, camera: &Camera) -> Vec<Candidate> {
    let mut whole: Vec<Scored> = Vec::new();
    for (score, candidate) in found {
        if is_whole(&candidate.pixel_box, camera) {
            let lower = whole.iter().position(|(other, _)| *other < score);
            whole.insert(lower.unwrap_or(whole.len()), (score, candidate));
        }
    }
    whole.into_iter().map(|(_, candidate)| candidate).collect()
}

/// Share of contrast that remains over the distance to the nearest camera whose image contains the aircraft.
fn best_transmission(cameras: &[Camera], position: Geodetic, visibility_m: f64) -> Option<f64> {
    let aircraft_m = position.to_ecef();
    cameras
        .iter()
        .filter(|camera| camera.shows(aircraft_m))
        .map(|camera| transmission(camera.center_ecef_m.distance(aircraft_m), visibility_m))
        .reduce(f64::max)
}

/// The requested detections, by the model's file name or by hash, or the only ones that there are.
fn choose_detections(
    corpus: &Corpus,
    folders: &[ScenarioFolder],
    asked: Option<&str>,
) -> Result<NamedDetections> {
    let fault = match (choose(folders, asked)?, asked.map(str::to_owned)) {
        (Ok(chosen), _) => return Ok(chosen),
        (Err(NoChoice::None), Some(asked)) => CorpusFault::NoDetectionsOf(asked),
        (Err(NoChoice::None), None) => CorpusFault::NoDetections,
        (Err(NoChoice::Others(listed)), asked) => CorpusFault::OtherDetections {
            asked: asked.unwrap_or_default(),
            listed,
        },
        (Err(NoChoice::Several(listed)), _) => CorpusFault::SeveralModels(listed),
    };
    Err(Error::corpus(corpus.root(), fault))
}

#[cfg(test)]
mod edited_files;

#[cfg(test)]
mod tests;
