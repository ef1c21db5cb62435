//! Ground truth for a corpus, with or without detections.

use dataset::corpus::Corpus;
use dataset::corpus::model_identity::NamedDetections;
use dataset::plan::PlannedScenarios;
use dataset::tables::frames::TickRow;

use crate::error::Result;
use crate::samples::{Observation, Samples, ScenarioSummary, absent, cameras_of, side_of};

/// Labelled ticks.
pub(crate) struct Truth {
    /// The ticks before touchdown. Observations have no views, and detections no name.
    pub samples: Samples,
    /// Ticks per scenario, also past touchdown.
    pub ticks: Vec<usize>,
}

impl Truth {
    /// Reads the labels, the split and the conditions of all scenarios.
    pub(crate) fn read(corpus: &Corpus) -> Result<Self> {
        let splits = corpus.splits()?;
        let planned = PlannedScenarios::read(corpus)?;
        let folders = corpus.scenarios()?;
        let detections = NamedDetections {
            hash: String::new(),
            model: None,
        };
        let mut samples = Samples::empty(corpus, &folders, detections)?;
        samples.absent_scenarios = absent(&splits, &folders);
        let mut ticks = Vec::new();
        for folder in &folders {
            let scenario = folder.open()?;
            planned.check(&scenario.id(), &scenario.seal().config_hash)?;
            let record = scenario.record()?;
            let side = side_of(&scenario, &record, &splits)?;
            let frames = scenario.frames()?;
            let cameras = cameras_of(&scenario)?;
            let summary = ScenarioSummary::of(&scenario, record, cameras, &frames, side);
            let unobserved =
                |row: &TickRow| Observation::unseen((ticks.len(), row.tick, row.time_ns), 0);
            let observations = frames.rows.iter().map(unobserved).collect();
            ticks.push(frames.rows.len());
            let observed = (summary, frames, observations);
            samples.add_labelled(&scenario, observed)?;
        }
        samples.refuse_flights_on_two_sides(corpus)?;
        Ok(Self { samples, ticks })
    }
}
