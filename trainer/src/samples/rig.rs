//! The rig that recorded a corpus. A network learns one rig.

pub(crate) mod json_differences;
pub(crate) mod moved_rig;

use std::collections::{BTreeMap, BTreeSet};

use dataset::corpus::calibration::CameraEntry;
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::plan::Plan;

use crate::error::{Error, Result};
use crate::samples::NO_SCENARIOS;
use crate::samples::rig::json_differences::{collect, named};

pub(crate) type Cameras = BTreeMap<String, CameraEntry>;

/// The rig for all scenarios.
#[derive(Debug, Clone)]
pub(crate) struct Rig {
    pub name: String,
    /// Cameras in the first scenario.
    pub cameras: Cameras,
    /// Cameras as planned, before scenarios displace or aim them; without a plan, the cameras in the first scenario.
    pub nominal: Cameras,
    /// True if `nominal` comes from a plan.
    pub is_planned: bool,
    /// True if cameras differ between scenarios (jittered or turned).
    pub cameras_vary: bool,
}

impl Rig {
    /// The rig for these scenarios. Cameras may be displaced or turned between scenarios, as each calibration states; other views, image
    /// sizes or rigs are an error.
    pub(crate) fn of(corpus: &Corpus, folders: &[ScenarioFolder]) -> Result<Self> {
        let plan = Plan::of_corpus(corpus)?;
        let planned = plan.map(|plan| plan.common.cameras().into_iter().collect::<Cameras>());
        let mut first: Option<(Self, String)> = None;
        for folder in folders {
            let refused = |fault: String| Err(Error::corpus(folder.root(), fault));
            let scenario = folder.open()?;
            let (name, cameras) = (scenario.record()?.rig, scenario.calibration()?.cameras);
            if let Some((view, fault)) = cameras
                .iter()
                .find_map(|(view, entry)| Some((view, entry.fault()?)))
            {
                return refused(format!("camera {view} of calibration.json {fault}"));
            }
            let Some((common, id)) = &mut first else {
                let is_same_form = |planned: &Cameras| form(planned) == form(&cameras);
                let planned = planned.clone().filter(is_same_form);
                let common = Self {
                    name,
                    is_planned: planned.is_some(),
                    nominal: planned.unwrap_or_else(|| cameras.clone()),
                    cameras,
                    cameras_vary: false,
                };
                first = Some((common, folder.id()));
                continue;
            };
            let kind = |name: &str, cameras| format!("{name} ({})", form(cameras));
            let (found, expected) = (kind(&name, &cameras), kind(&common.name, &common.cameras));
            if found != expected {
                return refused(format!(
                    "its rig {found} differs from the rig of scenario {id}, {expected}; a network learns one rig: keep scenarios of \
                     different rigs in different corpora"
                ));
            }
            common.cameras_vary |= !are_same(&common.cameras, &cameras);
        }
        first
            .map(|(common, _)| common)
            .ok_or_else(|| Error::corpus(corpus.root(), NO_SCENARIOS))
    }

    /// Cameras as planned, if there is a plan.
    pub(crate) fn planned(&self) -> Option<&Cameras> {
        self.is_planned.then_some(&self.nominal)
    }

    /// Extends the rig, which belongs to the corpus `first`, to a second corpus planned with the same rig.
    pub(crate) fn join(&mut self, first: &Corpus, corpus: &Corpus, other: &Self) -> Result<()> {
        let differences = differences((&other.name, &other.nominal), (&self.name, &self.nominal));
        if !differences.is_empty() {
            let fault = format!(
                "its planned cameras differ from the cameras of {}, and a training learns one rig; here, and there: {}. Train on one \
                 at a time, or start from its run (--start-from)",
                first.root().display(),
                differences.join("; ")
            );
            return Err(Error::corpus(corpus.root(), fault));
        }
        self.cameras_vary |= other.cameras_vary || !are_same(&self.cameras, &other.cameras);
        Ok(())
    }
}

/// View names with image sizes.
pub(crate) fn form(cameras: &Cameras) -> String {
    let views = cameras.iter();
    let views: Vec<_> = views
        .map(|(view, entry)| format!("{view} {}x{} px", entry.width_px, entry.height_px))
        .collect();
    views.join(", ")
}

/// Differences between two rigs, each given as name and cameras: path of the value, here and there.
pub(crate) fn differences(here: (&str, &Cameras), there: (&str, &Cameras)) -> Vec<String> {
    let mut found = Vec::new();
    if here.0 != there.0 {
        found.push(format!("rig {} and {}", here.0, there.0));
    }
    let views: BTreeSet<&String> = here.1.keys().chain(there.1.keys()).collect();
    for view in views {
        let camera = |cameras: &Cameras| {
            let entry = cameras.get(view)?;
            let sound = CameraEntry {
                degradation: None,
                ..entry.clone()
            };
            serde_json::to_value(sound).ok()
        };
        match (camera(here.1), camera(there.1)) {
            (Some(here), Some(there)) => collect(view, &here, &there, &mut found),
            (here, _) => {
                let [has, lacks] = match here {
                    Some(_) => ["here", "there"],
                    None => ["there", "here"],
                };
                found.push(format!("camera {view} {has}, none {lacks}"));
            }
        }
    }
    named(found)
}

/// True if all cameras have the same positions and optics, regardless of image degradation.
pub(crate) fn are_same(a: &Cameras, b: &Cameras) -> bool {
    let sound = |cameras: &Cameras| -> Cameras {
        let mut sound = cameras.clone();
        sound
            .values_mut()
            .for_each(|entry| entry.degradation = None);
        sound
    };
    sound(a) == sound(b)
}
