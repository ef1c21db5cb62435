//! The true distances of a corpus, whether a detector has searched its images or not.

use dataset::corpus::Corpus;
use dataset::corpus::model_identity::NamedDetections;
use dataset::plan::PlannedScenarios;
use dataset::tables::frames::TickRow;

use crate::error::Result;
use crate::samples::rig::Rig;
use crate::samples::{
    DistanceRange, Observation, Samples, ScenarioSummary, absent, cameras_of, side_of,
};

/// Labelled ticks of a corpus.
pub(crate) struct Truth {
    /// The ticks before touchdown. Their observations have no views, and their detections no name: none were read.
    pub samples: Samples,
    /// Number of ticks of each scenario, past touchdown as well.
    pub ticks: Vec<usize>,
}

impl Truth {
    /// Reads the labels, the split and the conditions of all scenarios.
    ///
    /// # Errors
    /// The corpus has no scenario, no split or no labels, or contradicts its plan.
    pub(crate) fn read(corpus: &Corpus) -> Result<Self> {
        let splits = corpus.splits()?;
        let planned = PlannedScenarios::read(corpus)?;
        let folders = corpus.scenarios()?;
        let rig = Rig::of(corpus, &folders)?;
        let mut samples = Samples {
            views: rig.cameras.keys().cloned().collect(),
            rig,
            detections: NamedDetections {
                hash: String::new(),
                model: None,
            },
            scenarios: Vec::new(),
            absent_scenarios: absent(&splits, &folders),
            samples: Vec::new(),
        };
        let mut ticks = Vec::new();
        for folder in &folders {
            let scenario = folder.open()?;
            planned.check(&scenario.id(), &scenario.seal().config_hash)?;
            let record = scenario.record()?;
            let side = side_of(&scenario, &record, &splits)?;
            let frames = scenario.frames()?;
            let cameras = cameras_of(&scenario)?;
            let summary = ScenarioSummary::of(&scenario, record, cameras, &frames, side);
            let unobserved = |row: &TickRow| Observation {
                scenario: ticks.len(),
                tick: row.tick,
                time_ns: row.time_ns,
                boxes: Vec::new(),
                shifts: Vec::new(),
                tracks: Vec::new(),
                looks: Vec::new(),
                common_errors: Vec::new(),
                others: None,
                cut_off: 0,
            };
            let observations = frames.rows.iter().map(unobserved).collect();
            ticks.push(frames.rows.len());
            let observed = (summary, frames, observations);
            samples.add_labelled(&scenario, observed, DistanceRange::ALL)?;
        }
        samples.refuse_flights_on_two_sides(corpus)?;
        Ok(Self { samples, ticks })
    }
}
