//! The split of a corpus into train, validation and test, by trajectory.

use std::collections::BTreeMap;

use dataset::splits::{Assignment, Side, Splits};

use super::{Plan, PlannedScenario};
use crate::seed;
use crate::sweep::SplitFractions;

/// Scenarios that fly the same trajectory and therefore stay together.
struct Group<'a> {
    trajectory: &'a str,
    scenarios: Vec<&'a PlannedScenario>,
}

/// Assigns every scenario of a plan to a side. The test side gets its part first, chosen so that weathers and times are spread over it
/// evenly; then validation; the rest trains. Assignments of `earlier` are kept, so that what was ever held out stays held out.
pub fn assign_sides(
    plan: &Plan,
    parts: &SplitFractions,
    master_seed: u64,
    earlier: Option<&Splits>,
) -> Result<Splits, String> {
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

/// Adds trajectories to a side until it has `target` scenarios, leaving at least `reserve` for the other sides.
fn fill<'a>(
    side: Side,
    target: usize,
    reserve: usize,
    groups: &[Group<'a>],
    master_seed: u64,
    assigned: &mut BTreeMap<&'a str, Side>,
) {
    loop {
        let on_side: Vec<&PlannedScenario> = groups
            .iter()
            .filter(|group| assigned.get(group.trajectory) == Some(&side))
            .flat_map(|group| group.scenarios.iter().copied())
            .collect();
        let free: Vec<&Group<'a>> = groups
            .iter()
            .filter(|group| !assigned.contains_key(group.trajectory))
            .collect();
        if on_side.len() >= target || free.len() <= reserve {
            return;
        }
        let room = target - on_side.len();
        let fitting = free
            .iter()
            .filter(|group| group.scenarios.len() <= room)
            .min_by_key(|group| {
                (
                    crowding(group, &on_side),
                    seed::shuffle_key(master_seed, "split", group.trajectory),
                )
            });
        // A side that is still empty takes the smallest trajectory even if that is more than its part.
        let smallest = || {
            free.iter()
                .min_by_key(|group| group.scenarios.len())
                .filter(|_| on_side.is_empty())
        };
        let Some(chosen) = fitting.or_else(smallest) else {
            return;
        };
        assigned.insert(chosen.trajectory, side);
    }
}

/// How often the weathers and times of a trajectory are already on a side, per thousand scenarios of it.
fn crowding(group: &Group<'_>, on_side: &[&PlannedScenario]) -> usize {
    let shared = group.scenarios.iter().flat_map(|s| {
        on_side.iter().map(|o| {
            usize::from(o.weather == s.weather) + usize::from(o.time_of_day == s.time_of_day)
        })
    });
    1_000 * shared.sum::<usize>() / group.scenarios.len().max(1)
}
