//! A run's part of the plan.
//!
//! Scenarios are dealt out like cards, sorted by weather, time of day and length, so that every shard gets its share of each: their cost
//! depends on all three. Shards may write into one corpus at the same time. The shard is given by `--shard 2/8`, or read from the
//! environment of Slurm's job arrays and Kubernetes' Indexed Jobs.

use std::fmt;
use std::str::FromStr;

use dataset::plan::PlannedScenario;

/// Part `index` of `count`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    index: u32,
    count: u32,
}

/// Reason why a shard is invalid.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct BadShard(String);

impl Shard {
    /// The whole plan.
    pub const WHOLE: Self = Self { index: 0, count: 1 };

    /// Part `index`, from 0, of `count`.
    pub fn new(index: u32, count: u32) -> Result<Self, BadShard> {
        if index < count {
            Ok(Self { index, count })
        } else {
            Err(BadShard(format!(
                "there is no shard {index}/{count}: expected I/N with I from 0 to N-1"
            )))
        }
    }

    /// The shard that a scheduler's environment names, and the variable that did; `None` without a scheduler.
    ///
    /// # Errors
    /// The environment names an index without a count, an array with gaps, or an index and count that do not match.
    pub fn from_environment(
        variable: impl Fn(&str) -> Option<String>,
    ) -> Result<Option<(Self, &'static str)>, BadShard> {
        let number = |name: &'static str| -> Result<Option<u32>, BadShard> {
            let Some(text) = variable(name) else {
                return Ok(None);
            };
            let number = text.trim().parse::<u32>();
            let bad = |_| BadShard(format!("{name} is {text:?}, expected a number"));
            number.map(Some).map_err(bad)
        };
        let needed = |index: &'static str, name: &'static str| {
            number(name)?.ok_or_else(|| {
                BadShard(format!(
                    "{index} is set, but {name} is not; say --shard I/N"
                ))
            })
        };
        const SLURM: &str = "SLURM_ARRAY_TASK_ID";
        const INDEXED_JOB: &str = "JOB_COMPLETION_INDEX";
        if let Some(id) = number(SLURM)? {
            let min = needed(SLURM, "SLURM_ARRAY_TASK_MIN")?;
            let max = needed(SLURM, "SLURM_ARRAY_TASK_MAX")?;
            let count = needed(SLURM, "SLURM_ARRAY_TASK_COUNT")?;
            if !(min..=max).contains(&id) || max - min + 1 != count {
                return Err(BadShard(format!(
                    "the Slurm array has {count} tasks from {min} to {max}, so its tasks cannot be counted: use an array without gaps, or say \
                     --shard I/N"
                )));
            }
            return Self::new(id - min, count).map(|shard| Some((shard, SLURM)));
        }
        if let Some(index) = number(INDEXED_JOB)? {
            let count = needed(INDEXED_JOB, "DTD_SHARDS")?;
            return Self::new(index, count).map(|shard| Some((shard, INDEXED_JOB)));
        }
        Ok(None)
    }

    /// True if it is the whole plan.
    pub fn is_whole(self) -> bool {
        self.count == 1
    }

    /// Scenarios of this part, in plan order.
    pub fn part_of(self, scenarios: &[PlannedScenario]) -> impl Iterator<Item = &PlannedScenario> {
        let mut dealt: Vec<usize> = (0..scenarios.len()).collect();
        dealt.sort_by_key(|&index| {
            let scenario = &scenarios[index];
            (&scenario.weather, &scenario.time_of_day, scenario.ticks)
        });
        let mine = dealt.into_iter().skip(self.index as usize);
        let mut mine: Vec<usize> = mine.step_by(self.count as usize).collect();
        mine.sort_unstable();
        mine.into_iter().map(|index| &scenarios[index])
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

impl FromStr for Shard {
    type Err = BadShard;

    fn from_str(text: &str) -> Result<Self, BadShard> {
        let parts = text
            .split_once('/')
            .and_then(|(index, count)| Some((index.parse().ok()?, count.parse().ok()?)));
        let (index, count) = parts.ok_or_else(|| {
            BadShard(format!(
                "no shard: {text:?}: expected I/N with I from 0 to N-1, e.g. 2/8"
            ))
        })?;
        Self::new(index, count)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::plan::expand;
    use crate::sweep::Sweep;

    fn environment(variables: &[(&str, &str)]) -> Result<Option<(Shard, &'static str)>, BadShard> {
        Shard::from_environment(|name| {
            variables
                .iter()
                .find(|(known, _)| *known == name)
                .map(|(_, value)| (*value).to_owned())
        })
    }

    #[test]
    fn a_shard_is_read_as_it_is_written() {
        for text in ["0/1", "7/8"] {
            assert_eq!(text.parse::<Shard>().unwrap().to_string(), text);
        }
        for wrong in ["8/8", "0/0", "1", "a/b", "-1/2"] {
            let message = wrong.parse::<Shard>().unwrap_err().to_string();
            assert!(message.contains("I from 0 to N-1"), "{wrong}: {message}");
        }
    }

    #[test]
    fn every_shard_gets_its_share_of_each_weather_and_of_the_ticks() {
        let sweep = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios.toml");
        let scenarios = expand(&Sweep::read(&sweep).unwrap()).scenarios;
        for count in [2, 3, 4, 7] {
            let shards: Vec<Vec<&PlannedScenario>> = (0..count)
                .map(|index| Shard::new(index, count).unwrap().part_of(&scenarios))
                .map(Iterator::collect)
                .collect();
            let mut ids: Vec<&str> = shards.iter().flatten().map(|s| s.id.as_str()).collect();
            ids.sort_unstable();
            let mut all: Vec<&str> = scenarios.iter().map(|s| s.id.as_str()).collect();
            all.sort_unstable();
            assert_eq!(ids, all);
            for weather in ["clear", "cloudy", "stormy", "foggy"] {
                let each = shards
                    .iter()
                    .map(|shard| shard.iter().filter(|s| s.weather == weather).count());
                let (fewest, most) = (each.clone().min().unwrap(), each.max().unwrap());
                assert!(
                    most - fewest <= 1,
                    "{count} shards, {weather}: {fewest} to {most}"
                );
            }
            let ticks =
                |shard: &Vec<&PlannedScenario>| shard.iter().map(|s| u64::from(s.ticks)).sum();
            let each: Vec<u64> = shards.iter().map(ticks).collect();
            let longest_scenario = scenarios.iter().map(|s| u64::from(s.ticks)).max().unwrap();
            let spread = each.iter().max().unwrap() - each.iter().min().unwrap();
            assert!(spread <= 2 * longest_scenario, "{count} shards: {each:?}");
        }
    }

    #[test]
    fn slurm_and_kubernetes_say_which_shard_this_is() {
        assert_eq!(environment(&[]), Ok(None));
        let slurm = |id, min, max, count| {
            environment(&[
                ("SLURM_ARRAY_TASK_ID", id),
                ("SLURM_ARRAY_TASK_MIN", min),
                ("SLURM_ARRAY_TASK_MAX", max),
                ("SLURM_ARRAY_TASK_COUNT", count),
            ])
        };
        let shard = slurm("3", "1", "4", "4").unwrap().unwrap().0;
        assert_eq!(shard.to_string(), "2/4");
        assert!(
            slurm("7", "3", "7", "2")
                .unwrap_err()
                .to_string()
                .contains("gaps")
        );
        let job = environment(&[("JOB_COMPLETION_INDEX", "1"), ("DTD_SHARDS", "3")]);
        assert_eq!(job.unwrap().unwrap().0.to_string(), "1/3");
        let lost = environment(&[("JOB_COMPLETION_INDEX", "1")]);
        let lost = lost.unwrap_err().to_string();
        assert!(lost.contains("DTD_SHARDS"), "{lost}");
    }
}
