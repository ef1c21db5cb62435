//! The sweeps of the experiment: its corpus, and approaches from beyond the detector's range. Both follow from one file.

use std::path::{Path, PathBuf};

use dataset::files::outside_file::{self, FileKind};
use dataset::numbers::frame_rate::FrameRate;
use generator::sweep::Sweep;
use toml::{Table, Value, toml};
use trainer::TrainConfig;

use crate::args::experiment::{PaperArgs, Scale};
use crate::failure::Failure;
use crate::shipped::Shipped;

/// The weather of the ranges, if the sweep has it.
const CLEAR: &str = "clear";

/// A sweep with the command line's changes.
pub(super) struct PaperSweep {
    path: PathBuf,
    text: String,
    scale: Scale,
    frame_rate: Option<FrameRate>,
    /// Holds the sweep and its flights.
    _shipped: Shipped,
}

impl PaperSweep {
    pub(super) fn read(args: &PaperArgs) -> Result<Self, Failure> {
        let shipped = Shipped::unpack()?;
        let path = args.sweep.clone().unwrap_or_else(|| shipped.paper_sweep());
        Ok(Self {
            text: outside_file::read_text(&path, FileKind::SWEEP).map_err(Failure::bad_input)?,
            path,
            scale: args.scale,
            frame_rate: args.frame_rate,
            _shipped: shipped,
        })
    }

    /// The sweep of the corpus.
    pub(super) fn corpus(&self) -> Result<Sweep, Failure> {
        // Mistakes are shown where the author made them.
        let sweep = self.parse(self.text.clone())?;
        if self.scale == Scale::Full && self.frame_rate.is_none() {
            return Ok(sweep);
        }
        let mut table = self.table()?;
        if self.scale == Scale::Small {
            shrink(&mut table);
        }
        if let Some(rate) = self.frame_rate {
            let fraction = format!("{}/{}", rate.numerator, rate.denominator);
            set(&mut table, "picture", "frame_rate", fraction);
        }
        self.parse(table.to_string())
    }

    /// The sweep of approaches in clear weather from 13 NM.
    pub(super) fn range_corpus(&self) -> Result<Sweep, Failure> {
        let sweep = self.parse(self.text.clone())?;
        let mut table = self.table()?;
        table.remove("recorded");
        table.insert(
            "start".into(),
            Value::Table(toml! {
                fly = "computed"
                dtd_nm = 13.0
                cross_track_m = { mean = 0, sd = 60 }
                profiles = ["step-down"]
            }),
        );
        set(&mut table, "grid", "repeats", 1);
        if self.scale == Scale::Small {
            shrink_grid(&mut table);
            set(&mut table, "picture", "frame_rate", "1/8");
        } else if sweep.picture.frame_rate.period_s() < 1.0 {
            set(&mut table, "picture", "frame_rate", 1);
        }
        set(
            &mut table,
            "corpus",
            "name",
            format!("{}-ranges", sweep.corpus.name),
        );
        if sweep.weathers.contains_key(CLEAR) {
            set(&mut table, "grid", "weathers", vec![CLEAR]);
        }
        self.parse(table.to_string())
    }

    fn table(&self) -> Result<Table, Failure> {
        Ok(self.text.parse()?)
    }

    fn parse(&self, text: String) -> Result<Sweep, Failure> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        Sweep::parse(&self.path, folder, text).map_err(Failure::bad_input)
    }
}

/// The small variant: a time, two weathers, half the width and height, an image every few seconds.
fn shrink(table: &mut Table) {
    shrink_grid(table);
    set(table, "grid", "repeats", 4);
    set(table, "picture", "width_px", 960);
    set(table, "picture", "height_px", 640);
    set(table, "picture", "frame_rate", "1/3");
    // Four flights, so that each recurs.
    let rules = table.get_mut("recorded").and_then(Value::as_array_mut);
    for rule in rules.into_iter().flatten().filter_map(Value::as_table_mut) {
        let files = rule
            .get("files")
            .and_then(Value::as_str)
            .unwrap_or_default();
        let fewer = files.replace("paper-flights/*.csv", "paper-flights/0[1-4].csv");
        rule.insert("files".into(), fewer.into());
    }
}

fn shrink_grid(table: &mut Table) {
    for (key, most) in [("times", 1), ("weathers", 2)] {
        let grid = table.get_mut("grid").and_then(Value::as_table_mut);
        let list = grid
            .and_then(|grid| grid.get_mut(key))
            .and_then(Value::as_array_mut);
        if let Some(list) = list {
            list.truncate(most);
        }
    }
}

fn set(table: &mut Table, part: &str, key: &str, value: impl Into<Value>) {
    if let Some(part) = table.get_mut(part).and_then(Value::as_table_mut) {
        part.insert(key.into(), value.into());
    }
}

/// Settings of the small variant's trainings: hardly any steps.
pub(super) fn small_training() -> TrainConfig {
    let mut config = TrainConfig::demo();
    config.calibration.optimisation.steps = 300;
    config.estimator.optimisation.steps = 600;
    config.mono.optimisation.steps = 300;
    config
}

#[cfg(test)]
mod tests {
    use generator::plan::expand;

    use super::*;

    fn paper(scale: Scale, frame_rate: Option<FrameRate>) -> PaperSweep {
        let shipped = Shipped::unpack().unwrap();
        let path = shipped.paper_sweep();
        PaperSweep {
            text: std::fs::read_to_string(&path).unwrap(),
            path,
            scale,
            frame_rate,
            _shipped: shipped,
        }
    }

    #[test]
    fn the_papers_corpus_is_a_hundred_scenarios_in_which_twenty_flights_recur() {
        let plan = expand(&paper(Scale::Full, None).corpus().unwrap());
        assert_eq!(plan.scenarios.len(), 100);
        let mut flights: Vec<_> = plan.scenarios.iter().map(|s| &s.trajectory).collect();
        flights.sort_unstable();
        flights.dedup();
        assert_eq!(flights.len(), 20);
    }

    #[test]
    fn a_frame_rate_and_the_small_scale_change_that_alone() {
        let rate = FrameRate::new(30, 1).unwrap();
        let sweep = paper(Scale::Full, Some(rate)).corpus().unwrap();
        assert_eq!(sweep.picture.frame_rate, rate);
        assert_eq!(sweep.combinations.len(), 100);
        let sweep = paper(Scale::Small, None).corpus().unwrap();
        assert_eq!(sweep.picture.width_px, 960);
        assert_eq!(sweep.combinations.len(), 8);
        assert_eq!(sweep.rig_name, "seed");
        assert_eq!(sweep.recorded[0].recordings.len(), 4);
    }

    #[test]
    fn ranges_are_measured_on_flights_that_begin_beyond_ten_miles_in_clear_weather() {
        for (scale, scenarios) in [(Scale::Full, 5), (Scale::Small, 1)] {
            let plan = expand(&paper(scale, None).range_corpus().unwrap());
            assert_eq!(plan.scenarios.len(), scenarios);
            for scenario in &plan.scenarios {
                assert_eq!(
                    (&*scenario.weather, &*scenario.flight),
                    ("clear", "computed")
                );
                assert!(scenario.parameters.start_dtd_m > 12.9 * 1_852.0);
            }
        }
    }
}
