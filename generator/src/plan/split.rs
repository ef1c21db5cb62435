//! Split into training, validation and test, by trajectory.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use dataset::corpus::splits::{Assignment, Leak, Side, Splits};
use dataset::plan::{Plan, PlannedScenario};

use crate::seed;
use crate::sweep::SplitFractions;

/// Scenarios that fly the same trajectory and therefore stay together.
struct Group<'a> {
    trajectory: &'a str,
    scenarios: Vec<&'a PlannedScenario>,
}

impl<'a> Group<'a> {
    /// Weather and time of each scenario.
    fn conditions(&self) -> Vec<Condition<'a>> {
        let scenarios = self.scenarios.iter();
        scenarios
            .map(|s| (s.weather.as_str(), s.time_of_day.as_str()))
            .collect()
    }
}

/// Assigns every scenario to a side. The test side is filled first, with weathers and times spread evenly; then validation; the rest is for
/// training. Assignments of `earlier` are kept, so that held-out scenarios stay held out.
pub(crate) fn assign_sides(
    plan: &Plan,
    parts: &SplitFractions,
    master_seed: u64,
    earlier: Option<&Splits>,
) -> Result<Splits, Leak> {
    let mut assigned: BTreeMap<&str, Side> = BTreeMap::new();
    if let Some(earlier) = earlier {
        for scenario in &plan.scenarios {
            if let Some(assignment) = earlier.scenarios.get(&scenario.id) {
                assigned.insert(&scenario.trajectory, assignment.side);
            }
        }
    }
    let groups = groups(plan);
    let total = plan.scenarios.len() as f64;
    for (side, part, others_wanted) in [
        (
            Side::Test,
            parts.test,
            [parts.validation, parts.train]
                .iter()
                .filter(|p| **p > 0.0)
                .count(),
        ),
        (
            Side::Validation,
            parts.validation,
            usize::from(parts.train > 0.0),
        ),
    ] {
        if part > 0.0 {
            let target = ((part * total).round() as usize).max(1);
            fill(
                side,
                target,
                others_wanted,
                &groups,
                master_seed,
                &mut assigned,
            );
        }
    }
    let rest = if parts.train > 0.0 {
        Side::Train
    } else {
        Side::Test
    };
    let scenarios = plan.scenarios.iter().map(|scenario| {
        let side = assigned
            .get(scenario.trajectory.as_str())
            .copied()
            .unwrap_or(rest);
        (
            scenario.id.clone(),
            Assignment {
                trajectory: scenario.trajectory.clone(),
                side,
            },
        )
    });
    Splits::new(scenarios.collect())
}

fn groups(plan: &Plan) -> Vec<Group<'_>> {
    let mut by_trajectory: BTreeMap<&str, Vec<&PlannedScenario>> = BTreeMap::new();
    for scenario in &plan.scenarios {
        by_trajectory
            .entry(&scenario.trajectory)
            .or_default()
            .push(scenario);
    }
    by_trajectory
        .into_iter()
        .map(|(trajectory, scenarios)| Group {
            trajectory,
            scenarios,
        })
        .collect()
}

type Condition<'a> = (&'a str, &'a str);
/// Shuffle key and trajectory.
type Waiting<'a> = (u64, &'a str);

/// Free trajectories that are flown in the same conditions, equally often: they have the same effect on a side.
struct Alike<'a> {
    /// Sorted conditions of a trajectory's scenarios.
    conditions: Vec<Condition<'a>>,
    /// Shuffled, the next one last.
    waiting: Vec<Waiting<'a>>,
}

/// Crowding, shuffle key and name of the next trajectory, and its queue. The heap returns the smallest.
type Entry<'a> = Reverse<(usize, Waiting<'a>, usize)>;

impl<'a> Alike<'a> {
    fn entry(&self, index: usize, on_side: &OnSide<'_>) -> Option<Entry<'a>> {
        let next = *self.waiting.last()?;
        Some(Reverse((on_side.crowding(&self.conditions), next, index)))
    }
}

/// Number of scenarios of each weather and of each time on a side.
#[derive(Default)]
struct OnSide<'a> {
    scenarios: usize,
    weathers: BTreeMap<&'a str, usize>,
    times: BTreeMap<&'a str, usize>,
}

impl<'a> OnSide<'a> {
    fn add(&mut self, weather: &'a str, time: &'a str) {
        self.scenarios += 1;
        *self.weathers.entry(weather).or_default() += 1;
        *self.times.entry(time).or_default() += 1;
    }

    /// Number of times that a trajectory's weathers and times already occur on the side, per thousand scenarios.
    fn crowding(&self, conditions: &[Condition<'_>]) -> usize {
        let count = |counts: &BTreeMap<&str, usize>, key| counts.get(key).copied().unwrap_or(0);
        let shared = conditions
            .iter()
            .map(|(weather, time)| count(&self.weathers, weather) + count(&self.times, time));
        1_000 * shared.sum::<usize>() / conditions.len().max(1)
    }
}

/// Adds trajectories to a side until it has `target` scenarios, leaving at least `reserve` for the other sides. Always takes the
/// one whose weathers and times the side has least of.
///
/// The side only grows, so crowding only grows and space only shrinks: an entry with an outdated crowding is too early in the heap,
/// never too late, and what does not fit will not fit later.
fn fill<'a>(
    side: Side,
    target: usize,
    reserve: usize,
    groups: &[Group<'a>],
    master_seed: u64,
    assigned: &mut BTreeMap<&'a str, Side>,
) {
    let mut on_side = OnSide::default();
    let mut free = 0;
    let mut alike: BTreeMap<Vec<Condition<'_>>, Vec<Waiting<'_>>> = BTreeMap::new();
    for group in groups {
        let mut conditions = group.conditions();
        match assigned.get(group.trajectory) {
            None => {
                conditions.sort_unstable();
                let key = seed::shuffle_key(master_seed, "split", group.trajectory);
                let waiting = alike.entry(conditions).or_default();
                waiting.push((key, group.trajectory));
                free += 1;
            }
            Some(theirs) if *theirs == side => {
                for (weather, time) in conditions {
                    on_side.add(weather, time);
                }
            }
            Some(_) => {}
        }
    }
    let mut alike: Vec<Alike<'a>> = alike
        .into_iter()
        .map(|(conditions, mut waiting)| {
            waiting.sort_unstable_by(|a, b| b.cmp(a));
            Alike {
                conditions,
                waiting,
            }
        })
        .collect();
    let mut heap: BinaryHeap<_> = alike
        .iter()
        .enumerate()
        .filter_map(|(index, alike)| alike.entry(index, &on_side))
        .collect();
    while on_side.scenarios < target && free > reserve {
        let Some(Reverse((crowding, (_, trajectory), index))) = heap.pop() else {
            // A side that is still empty takes the smallest trajectory even if that exceeds its share.
            let free = groups
                .iter()
                .filter(|g| !assigned.contains_key(g.trajectory));
            if on_side.scenarios == 0
                && let Some(smallest) = free.min_by_key(|group| group.scenarios.len())
            {
                assigned.insert(smallest.trajectory, side);
            }
            return;
        };
        let candidate = &mut alike[index];
        if candidate.conditions.len() > target - on_side.scenarios {
            continue;
        }
        if on_side.crowding(&candidate.conditions) == crowding {
            candidate.waiting.pop();
            assigned.insert(trajectory, side);
            free -= 1;
            for (weather, time) in &candidate.conditions {
                on_side.add(weather, time);
            }
        }
        heap.extend(candidate.entry(index, &on_side));
    }
}
