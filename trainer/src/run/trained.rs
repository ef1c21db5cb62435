//! Results of a training: in memory, and as files of a run folder.

use std::collections::BTreeSet;

use burn::module::{Module, ModuleVisitor, Param};
use burn::store::{ModuleSnapshot, SafetensorsStore};
use burn::tensor::{Device, Tensor};
use dataset::corpus::detections::RegisteredWith;
use dataset::corpus::seal;
use dataset::files::json_file::{write_json_unsynced, write_unsynced};
use dataset::geometry::runway::Runway;
use dataset::numbers::limits::{self, Check};
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::background::{Backgrounds, StoredView};
use crate::config::{PaperDeviation, TrainConfig};
use crate::error::{Error, Result, RunFault};
use crate::estimators::geometry::self_calibration::SelfCalibrated;
use crate::estimators::geometry::triangulation::CentreOffset;
use crate::estimators::inverse_range::InverseRange;
use crate::estimators::inverse_range::flight_filter::FlightFilter;
use crate::estimators::mono::network::{MonoInputs, MonoNetworks};
use crate::estimators::mono::pinhole::Pinhole;
use crate::estimators::no_vision::MeanByTime;
use crate::estimators::paper_lstm::calibration_training::{
    CalibrationLogEntry, CalibrationNetworks,
};
use crate::estimators::paper_lstm::{EstimatorLogEntry, PaperLstm};
use crate::networks::normalisation::Normalisation;
use crate::networks::stage::StageSummary;
use crate::run::choice::Choice;
use crate::run::folder::RunFolder;
use crate::run::place::RunPlace;
use crate::run::refitted_view::Refit;
use crate::run::sealed::SealedRun;
use crate::samples::ScenarioSummary;
use crate::samples::paired_views::PairedViews;
use crate::samples::rig::{Cameras, Rig};
use crate::samples::sides::scenario_split::ScenarioSplit;
use crate::samples::training_cameras::DroppedByView;

/// Format of a run, increased whenever its numbers change their meaning or new ones are added.
pub(crate) const RUN_FORMAT: u32 = 9;

/// Version information that shows whether a run can be read.
#[derive(Deserialize)]
struct FormatStamp {
    /// Missing in runs written before formats were numbered.
    #[serde(default)]
    format: u32,
    dtd: String,
}

/// The inputs of a training (`run.json`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct RunSummary {
    /// [`RUN_FORMAT`].
    pub format: u32,
    /// Version of this software.
    pub dtd: String,
    /// File name of the detection model whose boxes were used for training, if it has one.
    pub model: Option<String>,
    /// Name of its detections, the start of the hash of the model and the settings next to it.
    pub model_hash: String,
    /// Name of the rig.
    pub rig: String,
    /// The runway of the training; missing in older runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub runway: Option<Runway>,
    /// The cameras by view, of the first scenario if they vary. The networks apply only to these.
    pub cameras: Cameras,
    /// True if other scenarios had cameras of the rig in other positions or directions.
    pub cameras_vary: bool,
    /// The cameras as planned, before scenarios misplace or aim them; missing without a plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub planned_cameras: Option<Cameras>,
    /// The cameras that the views of the training were registered with; missing if they were not, and in older runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub registered_with: Option<RegisteredWith>,
    /// Trajectories on the training side.
    pub training_trajectories: BTreeSet<String>,
    /// Trajectories on the validation side.
    pub validation_trajectories: BTreeSet<String>,
    /// Identities of these trajectories, independent of their names.
    pub training_flights: BTreeSet<String>,
    /// The same of the validation side.
    pub validation_flights: BTreeSet<String>,
    /// The split by scenario, if there is one: its sides share flights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scenario_split: Option<ScenarioSplit>,
    /// Scenarios on the training side.
    pub training_scenarios: usize,
    /// Scenarios on the validation side.
    pub validation_scenarios: usize,
    /// Samples on the training side that the networks learned from, as recorded.
    pub training_samples: usize,
    /// By view, boxes of the training side that do not contain the aircraft. Formulas are fitted without them; networks learn from them
    /// unless the settings remove them.
    pub dropped_training_boxes: DroppedByView,
    /// Samples on the validation side.
    pub validation_samples: usize,
    /// BLAKE3 of all that networks and formulas learned from and were judged by.
    pub samples_blake3: String,
    /// Error of `paper_lstm` on the validation side, percent.
    pub validation_mape_pct: f64,
    /// Stages of the training, in their order.
    pub stages: Vec<StageSummary>,
    /// The recommended estimator.
    pub choice: Choice,
    /// BLAKE3 of the weights that the training started from, if they were not random.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub started_from_blake3: Option<String>,
    /// Views that were fitted again after the training, in order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub refits: Vec<Refit>,
    /// Wall-clock time of the training, seconds.
    pub training_s: f64,
}

impl RunSummary {
    /// The summary in these files; an error if they have another format.
    pub(crate) fn of(sealed: &SealedRun) -> Result<Self> {
        const WHAT: &str = "run summary";
        let FormatStamp { format, dtd } = sealed.json(RunFolder::SUMMARY, WHAT)?;
        if format != RUN_FORMAT {
            let readable = RUN_FORMAT;
            let fault = RunFault::OtherFormat {
                format,
                readable,
                dtd,
            };
            return Err(sealed.refused(RunFolder::SUMMARY, fault));
        }
        sealed.json(RunFolder::SUMMARY, WHAT)
    }

    /// With the flights of the run that the training started from, which its networks know.
    pub(crate) fn with_flights_of(mut self, start: Option<&Self>) -> Self {
        if let Some(before) = start {
            let pairs = [
                (
                    &mut self.training_trajectories,
                    &before.training_trajectories,
                ),
                (
                    &mut self.validation_trajectories,
                    &before.validation_trajectories,
                ),
                (&mut self.training_flights, &before.training_flights),
                (&mut self.validation_flights, &before.validation_flights),
            ];
            for (seen, known) in pairs {
                seen.extend(known.iter().cloned());
            }
        }
        self
    }

    /// The cameras of a corpus and of the run that must be the same; `None` if a sweep jitters or turns them and one of the two has no
    /// plan.
    pub(crate) fn comparable<'a>(&'a self, rig: &'a Rig) -> Option<[&'a Cameras; 2]> {
        if !self.cameras_vary && !rig.cameras_vary {
            return Some([&rig.cameras, &self.cameras]);
        }
        Some([rig.planned()?, self.planned_cameras.as_ref()?])
    }

    /// True if a flight was used for training or for its decisions.
    pub(crate) fn knows(&self, scenario: &ScenarioSummary) -> bool {
        [&self.training_flights, &self.validation_flights]
            .iter()
            .any(|flights| flights.contains(&scenario.flight))
    }
}

/// Both convergence logs (`convergence.json`): errors of training and validation by step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Convergence {
    /// Identifiers of the views.
    pub views: Vec<String>,
    /// Stage one.
    pub calibration: Vec<CalibrationLogEntry>,
    /// Steps that made the calibration networks of the run.
    pub calibration_kept_step: usize,
    /// Stage two.
    pub estimator: Vec<EstimatorLogEntry>,
    /// Steps that made the estimator of the run.
    pub estimator_kept_step: usize,
}

/// The fitted formulas (`baselines.json`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Baselines {
    /// Identifiers of the views.
    pub views: Vec<String>,
    /// `mono_pinhole`, per view; `null` for a view with too few boxes.
    pub pinholes: Vec<Option<Pinhole>>,
    /// `triangulation`, per view.
    pub centre_offsets: Vec<CentreOffset>,
    /// `inverse_range`.
    pub inverse_range: InverseRange,
    /// `self_calibrated`; `null` if fewer than two views saw the aircraft often enough.
    pub self_calibrated: Option<SelfCalibrated>,
    /// `inverse_range_filtered` and `inverse_range_smoothed`.
    pub flight_filter: FlightFilter,
    /// The boxes that all estimators get.
    pub paired_views: PairedViews,
    /// `no_vision_time` and `no_vision_time_weather`.
    pub mean_by_time: MeanByTime,
    /// Content of `backgrounds.png`; missing without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub backgrounds: Option<Vec<StoredView>>,
}

/// All networks of a run.
#[derive(Module, Debug)]
pub(crate) struct Networks {
    /// Stage one.
    pub calibration: CalibrationNetworks,
    /// Stage two.
    pub estimator: PaperLstm,
    /// `mono_network`.
    pub mono_size: MonoNetworks,
    /// `mono_network_box`.
    pub mono_box: MonoNetworks,
    /// `mono_network_position`.
    pub mono_position: MonoNetworks,
}

impl Networks {
    fn untrained(views: usize, config: &TrainConfig, device: &Device) -> Self {
        let random = &mut ChaCha12Rng::seed_from_u64(config.seed);
        let mono =
            |inputs, random: &mut _| MonoNetworks::new(views, inputs, &config.mono, random, device);
        Self {
            calibration: CalibrationNetworks::new(views, &config.calibration, random, device),
            estimator: PaperLstm::new(
                config.calibration.features,
                &config.estimator,
                random,
                device,
            ),
            mono_size: mono(MonoInputs::Size, random),
            mono_box: mono(MonoInputs::Box, random),
            mono_position: mono(MonoInputs::Position, random),
        }
    }
}

/// A number in a JSON value that no training produces in a formula.
fn excessive(value: &Value) -> Option<f64> {
    match value {
        Value::Number(number) => number.as_f64().filter(|n| n.abs() > MAX_OF_A_FORMULA),
        Value::Array(values) => values.iter().find_map(excessive),
        Value::Object(values) => values.values().find_map(excessive),
        Value::Null | Value::Bool(_) | Value::String(_) => None,
    }
}

/// No training produces such a number in a network.
const MAX_WEIGHT: f32 = 1e6;
/// ... or in a formula: pixels times metres of an airliner's span, or metres to the target.
const MAX_OF_A_FORMULA: f64 = 1e12;

/// Rejects numbers that make every answer meaningless: NaN, infinities, and those that no training produces.
fn check_numbers(
    sealed: &SealedRun,
    normalisation: &Normalisation,
    baselines: &Baselines,
    networks: &Networks,
) -> Result<()> {
    let Normalisation {
        offset_px,
        scale_px,
        range_px,
        ..
    } = normalisation;
    let check = &mut Check::default();
    let ranges = range_px.iter().flatten().flatten().flatten();
    for &place in offset_px.iter().flatten().chain(ranges) {
        check.number("offset_px or range_px", place, limits::BOX_PLACE_PX);
    }
    for &scale in scale_px.iter().flatten() {
        check.number("scale_px", scale, limits::FEATURE_SCALE_PX);
    }
    if let Some(fault) = std::mem::take(check).first() {
        return Err(sealed.refused(RunFolder::NORMALISATION, RunFault::OutOfLimits(fault)));
    }
    for place in baselines.inverse_range.offsets_px() {
        check.number("inverse_range offset_px", place, limits::BOX_PLACE_PX);
    }
    for scale in baselines.inverse_range.scales_px() {
        check.number("inverse_range scale_px", scale, limits::FEATURE_SCALE_PX);
    }
    if let Some(fitted) = &baselines.self_calibrated {
        check.part("self_calibrated", |check| fitted.check(check));
    }
    if let Some(fault) = std::mem::take(check).first() {
        return Err(sealed.refused(RunFolder::BASELINES, RunFault::OutOfLimits(fault)));
    }
    let formulas: Value = sealed.json(RunFolder::BASELINES, "set of baselines")?;
    if let Some(number) = excessive(&formulas) {
        return Err(sealed.refused(
            RunFolder::BASELINES,
            RunFault::Formula {
                number,
                most: MAX_OF_A_FORMULA,
            },
        ));
    }
    let mut worst = WorstWeight(None);
    networks.visit(&mut worst);
    match worst.0 {
        None => Ok(()),
        Some(weight) => Err(sealed.refused(
            RunFolder::WEIGHTS,
            RunFault::Weight {
                weight,
                most: MAX_WEIGHT,
            },
        )),
    }
}

/// An impossible weight, if there is one.
struct WorstWeight(Option<f32>);

impl ModuleVisitor for WorstWeight {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let data = param.val().into_data();
        let bad = data
            .iter::<f32>()
            .find(|weight| !(0.0..=MAX_WEIGHT).contains(&weight.abs()));
        self.0 = self.0.or(bad);
    }
}

/// A trained run in memory. Its networks are on a device without autodiff.
#[derive(Debug, Clone)]
pub(crate) struct TrainedRun {
    /// Settings.
    pub config: TrainConfig,
    /// Its inputs.
    pub summary: RunSummary,
    /// Features.
    pub normalisation: Normalisation,
    /// Formulas.
    pub baselines: Baselines,
    /// Networks.
    pub networks: Networks,
    /// Logs.
    pub convergence: Convergence,
    /// References for aligning cameras, if the settings ask for it.
    pub backgrounds: Option<Backgrounds>,
    /// True if its cameras were moved to another runway.
    pub is_elsewhere: bool,
}

impl TrainedRun {
    /// Deviations from the paper; empty for its method.
    pub(crate) fn deviations_from_paper(&self) -> Vec<PaperDeviation> {
        let mut found = self.config.deviations_from_paper();
        if !self.summary.refits.is_empty() {
            found.push(PaperDeviation::RefittedView);
        }
        found
    }

    /// Writes all files into an existing folder.
    pub(crate) fn write(&self, folder: &RunFolder) -> Result<()> {
        write_json_unsynced(&folder.config_path(), &self.config)?;
        write_json_unsynced(&folder.normalisation_path(), &self.normalisation)?;
        write_json_unsynced(&folder.baselines_path(), &self.baselines)?;
        write_json_unsynced(&folder.convergence_path(), &self.convergence)?;
        write_unsynced(&folder.weights_path(), &self.weights(folder)?)?;
        if let Some(backgrounds) = &self.backgrounds {
            write_unsynced(&folder.backgrounds_path(), &backgrounds.png())?;
        }
        Ok(write_json_unsynced(&folder.summary_path(), &self.summary)?)
    }

    /// Puts the run into a place that we hold, as a whole.
    pub(crate) fn commit(&self, place: &RunPlace) -> Result<()> {
        let new = place.begin()?;
        self.write(&new)?;
        let config_hash = seal::hash_file(&new.config_path())?;
        place.commit(&config_hash)
    }

    /// All networks in the format of Safetensors. The same numbers give the same bytes: with several entries, the library writes
    /// the metadata in an order that varies between processes.
    pub(crate) fn weights(&self, folder: &RunFolder) -> Result<Vec<u8>> {
        let failed = |error| Error::run(&folder.weights_path(), RunFault::NotWritten(error));
        let mut store = SafetensorsStore::from_bytes(None)
            .clear_metadata()
            .metadata("producer", "dtd");
        self.networks.save_into(&mut store).map_err(failed)?;
        store.get_bytes().map_err(failed)
    }

    /// The run in these files.
    pub(crate) fn of(sealed: &SealedRun) -> Result<Self> {
        let summary = RunSummary::of(sealed)?;
        let config: TrainConfig = sealed.json(RunFolder::CONFIG, "training configuration")?;
        config.check()?;
        let normalisation: Normalisation =
            sealed.json(RunFolder::NORMALISATION, "normalisation")?;
        let baselines: Baselines = sealed.json(RunFolder::BASELINES, "set of baselines")?;
        let views = normalisation.views.len();
        let lengths = [
            normalisation.offset_px.len(),
            normalisation.scale_px.len(),
            normalisation.range_px.len(),
            baselines.pinholes.len(),
            baselines.centre_offsets.len(),
        ];
        let is_possible = (1..=limits::MAX_VIEWS).contains(&views);
        if !is_possible || lengths.iter().any(|&length| length != views) {
            let fault = RunFault::Lengths { views, lengths };
            return Err(sealed.refused(RunFolder::NORMALISATION, fault));
        }
        if !baselines.inverse_range.is_of(views) {
            let fault = RunFault::InverseRange { views };
            return Err(sealed.refused(RunFolder::BASELINES, fault));
        }
        let fitted = baselines.self_calibrated.as_ref();
        if fitted.is_some_and(|fitted| !fitted.is_of(views)) {
            let fault = RunFault::FittedCameras { views };
            return Err(sealed.refused(RunFolder::BASELINES, fault));
        }
        if !baselines.flight_filter.is_of(&baselines.inverse_range) {
            return Err(sealed.refused(RunFolder::BASELINES, RunFault::FlightFilter));
        }
        if !baselines.paired_views.is_of(views) {
            let fault = RunFault::PairedViews { views };
            return Err(sealed.refused(RunFolder::BASELINES, fault));
        }
        if !baselines.mean_by_time.is_whole() {
            return Err(sealed.refused(RunFolder::BASELINES, RunFault::MeanByTime));
        }
        let mut networks = Networks::untrained(views, &config, &Device::flex());
        let weights = sealed.bytes(RunFolder::WEIGHTS).to_vec();
        let loaded = networks
            .load_from(&mut SafetensorsStore::from_bytes(Some(weights)))
            .map_err(|error| sealed.refused(RunFolder::WEIGHTS, RunFault::OtherNetworks(error)))?;
        if !loaded.unused.is_empty() {
            let fault = RunFault::UnknownWeights(loaded.unused);
            return Err(sealed.refused(RunFolder::WEIGHTS, fault));
        }
        check_numbers(sealed, &normalisation, &baselines, &networks)?;
        let backgrounds = match (&baselines.backgrounds, sealed.optional_bytes()) {
            (Some(stored), Some(png)) => Backgrounds::of(stored, png),
            _ => None,
        };
        let expected = config.align_backgrounds.then_some(views);
        if backgrounds.as_ref().map(Backgrounds::views) != expected {
            return Err(sealed.refused(RunFolder::BACKGROUNDS, RunFault::Backgrounds));
        }
        Ok(Self {
            backgrounds,
            summary,
            convergence: sealed.json(RunFolder::CONVERGENCE, "convergence log")?,
            baselines,
            config,
            normalisation,
            networks,
            is_elsewhere: false,
        })
    }
}
