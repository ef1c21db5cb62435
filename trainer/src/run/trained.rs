//! Training results, in memory and as run files.

use std::collections::BTreeSet;

use burn::module::{Module, ModuleVisitor, Param};
use burn::store::{ModuleSnapshot, SafetensorsStore, SafetensorsStoreError};
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
use crate::error::{Error, Result};
use crate::estimators::geometry::self_calibration::SelfCalibrated;
use crate::estimators::geometry::triangulation::CentreOffset;
use crate::estimators::inverse_range::InverseRange;
use crate::estimators::inverse_range::flight_filter::FlightFilter;
use crate::estimators::mono_network::{MonoInputs, MonoNetworks};
use crate::estimators::mono_pinhole::Pinhole;
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

/// Run format, increased whenever numbers change their meaning or are added or removed.
pub(crate) const RUN_FORMAT: u32 = 14;

/// Version information, which decides whether a run can be read.
#[derive(Deserialize)]
struct FormatStamp {
    format: u32,
    dtd: String,
}

/// Training inputs (`run.json`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct RunSummary {
    /// [`RUN_FORMAT`].
    pub format: u32,
    /// Version of dtd.
    pub dtd: String,
    /// File name of the detection model, if it has one.
    pub model: Option<String>,
    /// Name of the detections: the start of the hash over model and settings.
    pub model_hash: String,
    pub rig: String,
    pub runway: Runway,
    /// Cameras by view; those of the first scenario if they vary. The networks apply only to these cameras.
    pub cameras: Cameras,
    /// True if camera positions or directions differ between scenarios.
    pub cameras_vary: bool,
    /// Planned cameras, before scenarios misplace or aim them; missing without a plan.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub planned_cameras: Option<Cameras>,
    /// Cameras that the views were registered with; missing without registration.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub registered_with: Option<RegisteredWith>,
    pub training_trajectories: BTreeSet<String>,
    pub validation_trajectories: BTreeSet<String>,
    /// Flight identities, independent of trajectory names.
    pub training_flights: BTreeSet<String>,
    pub validation_flights: BTreeSet<String>,
    /// Split by scenario, if the settings ask for it: both sides share flights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scenario_split: Option<ScenarioSplit>,
    pub training_scenarios: usize,
    pub validation_scenarios: usize,
    /// Training samples of the networks.
    pub training_samples: usize,
    /// Training boxes that do not contain the aircraft, by view. Formulas are fitted without them; networks learn from them unless the
    /// settings remove them.
    pub dropped_training_boxes: DroppedByView,
    pub validation_samples: usize,
    /// BLAKE3 of the training and validation samples.
    pub samples_blake3: String,
    /// Validation error of `paper_lstm`, percent.
    pub validation_mape_pct: f64,
    pub stages: Vec<StageSummary>,
    pub choice: Choice,
    /// BLAKE3 of the initial weights, unless they were random.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub started_from_blake3: Option<String>,
    /// Refits, in order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub refits: Vec<Refit>,
    /// Wall-clock time, seconds.
    pub training_s: f64,
}

impl RunSummary {
    /// Reads the summary; an error if the format differs.
    pub(crate) fn of(sealed: &SealedRun) -> Result<Self> {
        const WHAT: &str = "run summary";
        let FormatStamp { format, dtd } = sealed.json(RunFolder::SUMMARY, WHAT)?;
        if format != RUN_FORMAT {
            let remedy = if format < RUN_FORMAT {
                "train again"
            } else {
                "update dtd, or train again"
            };
            let fault = format!(
                "belongs to a run of format {format}, written by dtd {dtd}, and this version reads format {RUN_FORMAT}; {remedy}"
            );
            return Err(sealed.refused(RunFolder::SUMMARY, fault));
        }
        sealed.json(RunFolder::SUMMARY, WHAT)
    }

    /// Adds the flights of the run that the training started from, because the networks know them.
    pub(crate) fn with_flights_of(mut self, start: Option<&Self>) -> Self {
        if let Some(before) = start {
            let before = before.clone();
            (self.training_trajectories).extend(before.training_trajectories);
            (self.validation_trajectories).extend(before.validation_trajectories);
            self.training_flights.extend(before.training_flights);
            self.validation_flights.extend(before.validation_flights);
        }
        self
    }

    /// Corpus cameras and run cameras that must be the same; `None` if a sweep jitters or turns them and a plan is missing.
    pub(crate) fn comparable<'a>(&'a self, rig: &'a Rig) -> Option<[&'a Cameras; 2]> {
        if !self.cameras_vary && !rig.cameras_vary {
            return Some([&rig.cameras, &self.cameras]);
        }
        Some([rig.planned()?, self.planned_cameras.as_ref()?])
    }

    /// True if the training used the flight, for learning or for decisions.
    pub(crate) fn knows(&self, scenario: &ScenarioSummary) -> bool {
        [&self.training_flights, &self.validation_flights]
            .iter()
            .any(|flights| flights.contains(&scenario.flight))
    }
}

/// Convergence logs of both stages (`convergence.json`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Convergence {
    /// Identifiers of the views.
    pub views: Vec<String>,
    /// Stage one.
    pub calibration: Vec<CalibrationLogEntry>,
    /// Steps of the kept calibration networks.
    pub calibration_kept_step: usize,
    /// Stage two.
    pub estimator: Vec<EstimatorLogEntry>,
    /// Steps of the kept estimator.
    pub estimator_kept_step: usize,
}

/// Fitted formulas (`baselines.json`).
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
    /// Box selection of all estimators.
    pub paired_views: PairedViews,
    /// `no_vision_time` and `no_vision_time_weather`.
    pub mean_by_time: MeanByTime,
    /// Where the cameras looked; content of `backgrounds.png`.
    pub backgrounds: Vec<StoredView>,
}

/// All networks.
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
        let features = config.calibration.features;
        let mono =
            |inputs, random: &mut _| MonoNetworks::new(views, inputs, &config.mono, random, device);
        Self {
            calibration: CalibrationNetworks::new(views, &config.calibration, random, device),
            estimator: PaperLstm::new(features, &config.estimator, random, device),
            mono_size: mono(MonoInputs::Size, random),
            mono_box: mono(MonoInputs::Box, random),
            mono_position: mono(MonoInputs::Position, random),
        }
    }
}

/// Limit of weights and formula coefficients, such as pixels times metres of an airliner's span.
const MAX_NUMBER: f64 = 1e12;

/// Rejects NaN, infinities and numbers that no training produces.
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
        return Err(sealed.refused(RunFolder::NORMALISATION, format!("{fault}; train again")));
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
    for view in &baselines.backgrounds {
        check.part("backgrounds", |check| view.check(check));
    }
    if let Some(fault) = std::mem::take(check).first() {
        return Err(sealed.refused(RunFolder::BASELINES, format!("{fault}; train again")));
    }
    let formulas: Value = sealed.json(RunFolder::BASELINES, "set of baselines")?;
    let refused = |file, number: f64| {
        let fault = format!(
            "has the number {number:e}, expected one up to {MAX_NUMBER:e} in size; train again"
        );
        sealed.refused(file, fault)
    };
    if let Some(number) = impossible_in(&formulas) {
        return Err(refused(RunFolder::BASELINES, number));
    }
    let mut weight = ImpossibleWeight(None);
    networks.visit(&mut weight);
    (weight.0).map_or(Ok(()), |weight| Err(refused(RunFolder::WEIGHTS, weight)))
}

/// True beyond [`MAX_NUMBER`], and for NaN.
fn is_impossible(number: &f64) -> bool {
    !(0.0..=MAX_NUMBER).contains(&number.abs())
}

/// First impossible number in a JSON value.
fn impossible_in(value: &Value) -> Option<f64> {
    match value {
        Value::Number(number) => number.as_f64().filter(is_impossible),
        Value::Array(values) => values.iter().find_map(impossible_in),
        Value::Object(values) => values.values().find_map(impossible_in),
        Value::Null | Value::Bool(_) | Value::String(_) => None,
    }
}

/// First impossible weight.
struct ImpossibleWeight(Option<f64>);

impl ModuleVisitor for ImpossibleWeight {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let data = param.val().into_data();
        self.0 = self.0.or_else(|| data.iter::<f64>().find(is_impossible));
    }
}

/// Run in memory, with networks on a device without autodiff.
#[derive(Debug, Clone)]
pub(crate) struct TrainedRun {
    pub config: TrainConfig,
    pub summary: RunSummary,
    pub normalisation: Normalisation,
    pub baselines: Baselines,
    pub networks: Networks,
    pub convergence: Convergence,
    /// What the cameras saw.
    pub backgrounds: Backgrounds,
    /// True if the cameras were moved to a different runway.
    pub is_elsewhere: bool,
}

impl TrainedRun {
    /// Deviations of `paper_lstm` from the paper.
    pub(crate) fn deviations_from_paper(&self) -> Vec<PaperDeviation> {
        let mut found = self.config.deviations_from_paper();
        if !self.summary.refits.is_empty() {
            found.push(PaperDeviation::RefittedView);
        }
        found
    }

    /// Writes all files into an existing folder.
    pub(crate) fn write(&self, folder: &RunFolder) -> Result<()> {
        let path = |name| folder.root().join(name);
        write_json_unsynced(&path(RunFolder::CONFIG), &self.config)?;
        write_json_unsynced(&path(RunFolder::NORMALISATION), &self.normalisation)?;
        write_json_unsynced(&path(RunFolder::BASELINES), &self.baselines)?;
        write_json_unsynced(&path(RunFolder::CONVERGENCE), &self.convergence)?;
        write_unsynced(&path(RunFolder::WEIGHTS), &self.weights(folder)?)?;
        write_unsynced(&path(RunFolder::BACKGROUNDS), &self.backgrounds.png())?;
        Ok(write_json_unsynced(
            &path(RunFolder::SUMMARY),
            &self.summary,
        )?)
    }

    /// Writes the run into the new folder of `place` and moves it into place, as a whole.
    pub(crate) fn commit(&self, place: &RunPlace, new: &RunFolder) -> Result<()> {
        self.write(new)?;
        place.commit(&seal::hash_file(&new.root().join(RunFolder::CONFIG))?)
    }

    /// Networks in Safetensors format. The same numbers give the same bytes, because the metadata has a single entry: with several, their
    /// order varies between processes.
    pub(crate) fn weights(&self, folder: &RunFolder) -> Result<Vec<u8>> {
        let failed = |error: SafetensorsStoreError| {
            let fault = format!("weights cannot be written: {error}");
            Error::run(&folder.weights_path(), fault)
        };
        let mut store = SafetensorsStore::from_bytes(None)
            .clear_metadata()
            .metadata("producer", "dtd");
        self.networks.save_into(&mut store).map_err(failed)?;
        store.get_bytes().map_err(failed)
    }

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
            let fault = format!(
                "it and baselines.json have {views} views and numbers for {lengths:?}, expected as many for each, 1 to {}",
                limits::MAX_VIEWS
            );
            return Err(sealed.refused(RunFolder::NORMALISATION, fault));
        }
        let fitted = baselines.self_calibrated.as_ref();
        let formulas = [
            ("inverse_range", baselines.inverse_range.is_of(views)),
            (
                "self_calibrated",
                fitted.is_none_or(|fitted| fitted.is_of(views)),
            ),
            (
                "flight_filter",
                baselines.flight_filter.is_of(&baselines.inverse_range),
            ),
            ("paired_views", baselines.paired_views.is_of(views)),
            ("mean_by_time", baselines.mean_by_time.is_whole()),
        ];
        if let Some((formula, _)) = formulas.into_iter().find(|(_, is_fit)| !is_fit) {
            let fault = format!(
                "{formula} does not fit the {views} views of the run, or lacks some of its numbers; train again"
            );
            return Err(sealed.refused(RunFolder::BASELINES, fault));
        }
        let mut networks = Networks::untrained(views, &config, &Device::flex());
        let weights = sealed.bytes(RunFolder::WEIGHTS).to_vec();
        let loaded = networks
            .load_from(&mut SafetensorsStore::from_bytes(Some(weights)))
            .map_err(|error| {
                let fault =
                    format!("weights do not fit the networks of config.json: {error}; train again");
                sealed.refused(RunFolder::WEIGHTS, fault)
            })?;
        if !loaded.unused.is_empty() {
            let fault = format!(
                "holds {}, which the networks of config.json do not have; train again",
                loaded.unused.join(", ")
            );
            return Err(sealed.refused(RunFolder::WEIGHTS, fault));
        }
        check_numbers(sealed, &normalisation, &baselines, &networks)?;
        let png = sealed.bytes(RunFolder::BACKGROUNDS);
        let backgrounds = Backgrounds::of(&baselines.backgrounds, png);
        let backgrounds = backgrounds
            .filter(|of| of.views() == views)
            .ok_or_else(|| {
                let fault =
                    "does not match the backgrounds recorded in baselines.json; train again";
                sealed.refused(RunFolder::BACKGROUNDS, fault)
            })?;
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
