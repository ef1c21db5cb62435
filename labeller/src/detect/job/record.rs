//! `detections/<model>.json`: the origin of the detections next to it, of their registrations and of the cameras' health.

use std::path::PathBuf;

use dataset::corpus::ScenarioFolder;
use dataset::corpus::detections::{self, Provenance, RegisteredWith};
use dataset::corpus::open_scenario::OpenScenario;
use dataset::files::json_file::read_json;
use serde::{Deserialize, Serialize};

use crate::detect::Model;
use crate::detect::mode::Mode;
use crate::detect::pairs::fitted_cameras::FittedCameras;
use crate::detect::sequence::FULL_SEARCH_S;
use crate::detect::view_search::cpu_time::CpuTime;
use crate::detector::ModelProfile;
use crate::error::Result;
use crate::registration::METHOD;
use crate::tiling::TilingSettings;
use crate::tracking;
use crate::view_health;

/// Origin of detections: one model, one scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct DetectionRecord {
    /// The model, its input, and the hash of the table.
    #[serde(flatten)]
    pub provenance: Provenance,
    /// The settings next to the model, whose hash is in the provenance; missing if there were none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub profile: Option<ModelProfile>,
    /// Output layout and window size.
    pub detector: String,
    /// Device that the model ran on, such as `cpu` or `cuda:0`.
    pub device: String,
    #[serde(flatten)]
    pub searching: Searching,
    /// Version of this software.
    pub dtd: String,
    /// Number of images.
    pub pictures: u64,
    /// Boxes in the table.
    pub detections: u64,
    /// Images without a box.
    pub misses: u64,
    /// Windows that the model was run on.
    pub windows: u64,
    /// Processor time of the search, with the registration.
    pub cpu_s: CpuTime,
    /// Total time of the workers, seconds.
    pub seconds: f64,
    /// Registration of the views; missing if they were not registered.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub registration: Option<RegistrationRecord>,
    /// Condition of the cameras; missing if it was not measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub health: Option<HealthRecord>,
}

/// Settings of the search: detections made with other settings are replaced.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Searching {
    /// Thresholds and windows of the search.
    pub settings: TilingSettings,
    /// Parts of the images that were searched.
    pub modes: RecordedMode,
    /// Version of the rules of tracks.
    pub tracking: u32,
}

/// Mode of the search, and the time between searches of whole images.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RecordedMode {
    mode: Mode,
    full_search_s: f64,
}

impl Searching {
    pub(crate) fn with(settings: TilingSettings, mode: Mode) -> Self {
        Self {
            settings,
            modes: RecordedMode {
                mode,
                full_search_s: FULL_SEARCH_S,
            },
            tracking: tracking::METHOD,
        }
    }
}

/// View registration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct RegistrationRecord {
    /// Version of the measurement.
    pub method: u32,
    /// The view that the others are compared with.
    pub reference: String,
    /// BLAKE3 hash of the run that has fitted the cameras; missing for those of `calibration.json`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cameras_of_run: Option<String>,
    /// Rows of the table.
    pub pairs: u64,
    /// Pairs with a shift.
    pub answered: u64,
    /// Time that the measurement took, without decoding, seconds.
    pub seconds: f64,
}

/// Camera condition.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct HealthRecord {
    /// Version of the measurement.
    pub method: u32,
}

/// Progress per model and scenario.
pub(crate) enum Standing {
    /// No detections that can be used.
    Missing,
    /// Detections, but their views are still to be registered, or the condition of the cameras is not measured.
    Unmeasured(Box<DetectionRecord>),
    Whole,
}

impl DetectionRecord {
    /// Path of the record.
    pub(crate) fn path(folder: &ScenarioFolder, model: &str) -> PathBuf {
        detections::record_path(folder, model)
    }

    /// The run whose cameras the views were registered with, if it was one.
    pub(crate) fn cameras_of_run(&self) -> Option<RegisteredWith> {
        let run = self.registration.as_ref()?.cameras_of_run.clone()?;
        Some(RegisteredWith::Run(run))
    }

    /// Progress of this model's work with these settings on the scenario's current videos. `cameras`: those that the views must be
    /// registered with; `None`: any.
    pub(crate) fn standing(
        scenario: &OpenScenario,
        model: &Model,
        searching: &Searching,
        cameras: Option<&FittedCameras>,
    ) -> Result<Standing> {
        if scenario.detections(&model.name()).is_err() {
            // Missing, for different videos, or damaged: detecting again repairs all.
            return Ok(Standing::Missing);
        }
        let path = Self::path(scenario.folder(), &model.name());
        let Ok(record) = read_json::<Self>(&path, "record of detections") else {
            return Ok(Standing::Missing);
        };
        let made_by = &record.provenance.detector;
        let is_same = made_by.is_same_content(&model.identity) && record.searching == *searching;
        if !is_same {
            return Ok(Standing::Missing);
        }
        let is_current = |made: &RegistrationRecord| {
            let is_of =
                |cameras: &FittedCameras| made.cameras_of_run.as_ref() == Some(&cameras.run_blake3);
            made.method == METHOD && cameras.is_none_or(is_of)
        };
        let is_registered = record.registration.as_ref().is_some_and(is_current)
            && matches!(scenario.registrations(&model.name()), Ok(Some(_)));
        let method = record.health.as_ref().map(|made| made.method);
        let is_watched = method == Some(view_health::METHOD)
            && matches!(scenario.health(&model.name()), Ok(Some(_)))
            && matches!(scenario.backgrounds(&model.name()), Ok(Some(_)));
        Ok(
            if is_watched && (is_registered || scenario.record()?.views.len() < 2) {
                Standing::Whole
            } else {
                Standing::Unmeasured(Box::new(record))
            },
        )
    }
}
