//! A plan in readable form.

use std::collections::BTreeMap;

use dataset::corpus::scenario::Flight;
use dataset::plan::PlannedScenario;
use generator::against::Standing;
use generator::plan::{Estimate, Outlook, Sight};
use indicatif::DecimalBytes;

use super::{Compared, Report};
use crate::verbs::output::{count, print_after, print_table};

/// Maximum number of changed or removed scenarios listed.
const MAX_DIFFERENCES: usize = 10;

impl Report<'_> {
    /// Prints the plan: rows, then totals, then the difference.
    pub(super) fn show(&self) {
        self.show_scenarios();
        println!();
        self.show_totals();
        if let Some(compared) = self.compared {
            self.show_difference(compared);
        }
    }

    fn show_scenarios(&self) {
        let mut heading = vec![
            "scenario", "flight", "from NM", "vis. km", "sun", "az.", "ticks",
        ];
        if self.compared.is_some() {
            heading.push("status");
        }
        let scenarios = self.plan.scenarios.iter().enumerate();
        let rows: Vec<Vec<String>> = scenarios
            .map(|(index, scenario)| {
                let mut row = self.row(scenario);
                if let Some(compared) = self.compared {
                    row.push(in_words(compared.against.standings[index]).into());
                }
                row
            })
            .collect();
        print_table(&heading, &rows);
    }

    fn row(&self, scenario: &PlannedScenario) -> Vec<String> {
        let parameters = &scenario.parameters;
        let start_nm = parameters.start_dtd_m / dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
        let visibility_km = parameters.conditions.weather.visibility_m / 1_000.0;
        let sun = self.sun(scenario);
        vec![
            // It contains time and weather.
            scenario.id.clone(),
            flight(scenario).to_owned(),
            format!("{start_nm:.2}"),
            format!("{visibility_km:.1}"),
            format!("{:.1}", sun.elevation_deg),
            format!("{:.0}", sun.azimuth_deg),
            scenario.ticks.to_string(),
        ]
    }

    fn show_totals(&self) {
        let plan = self.plan;
        let scenarios = plan.scenarios.len();
        let mut by_source = BTreeMap::new();
        for scenario in &plan.scenarios {
            let source = match scenario.parameters.flight {
                Flight::Live => "live",
                Flight::Computed { .. } => "computed",
                Flight::Recorded { .. } => "recorded",
            };
            *by_source.entry(source).or_insert(0) += 1;
        }
        let by_source: Vec<String> = by_source
            .iter()
            .map(|(source, number)| format!("{number} {source}"))
            .collect();
        print_after("corpus      ", &plan.corpus);
        print_after("plan        ", &plan.plan_hash);
        print_after(
            "scenarios   ",
            &format!("{scenarios} ({})", by_source.join(", ")),
        );
        let common = &plan.common;
        let estimate = &self.estimate;
        print_after(
            "flight      ",
            &format!(
                "{}: {} ticks at {} per second, {}, {} images",
                hours(estimate.flight_h),
                estimate.ticks,
                common.picture.frame_rate,
                count(common.cameras.len(), "camera"),
                estimate.pictures
            ),
        );
        self.show_outlook();
        show_cost("recording", estimate);
        print_after(
            "size        ",
            &format!("{} ({})", size(estimate), estimate.bytes_basis),
        );
        print_after(
            "free space  ",
            &format!(
                "{} should be free on the disk: X-Plane's scenery needs more than the bundled simulator's",
                DecimalBytes(estimate.room_bytes)
            ),
        );
    }

    fn show_outlook(&self) {
        let runway = &self.plan.common.runway;
        let Outlook {
            views,
            profiles_above_runway_m,
            clouds_above_runway_m,
            ..
        } = &self.outlook;
        print_after(
            "runway      ",
            &format!(
                "{} {}, {:.0} m above mean sea level, course {:.2} degrees true, local time is UTC{:+}",
                runway.airport,
                runway.name,
                runway.threshold.altitude_msl_m,
                runway.course_true_deg,
                self.utc_offset_h
            ),
        );
        let profiles = profiles_above_runway_m.iter();
        let profiles = profiles.map(|(name, start_m)| format!("{name} begins at {start_m:.0} m"));
        let clouds = clouds_above_runway_m.iter();
        let clouds =
            clouds.map(|(name, [base, top])| format!("clouds of {name} {base:.0} to {top:.0} m"));
        let heights: Vec<String> = profiles.chain(clouds).collect();
        if !heights.is_empty() {
            print_after(
                "heights     ",
                &format!("above the runway: {}", heights.join(", ")),
            );
        }
        for sight in views {
            print_after("view        ", &in_sight(sight));
        }
    }

    fn show_difference(&self, compared: &Compared) {
        let against = &compared.against;
        println!();
        let note = if compared.is_default {
            " (found here; --against names another)"
        } else {
            ""
        };
        print_after("against     ", &format!("{}{note}", compared.corpus));
        for (standing, note) in [
            (Standing::Whole, "complete"),
            (Standing::ToMake, "missing: planned there, not recorded yet"),
            (Standing::New, "new"),
            (Standing::Changed, "changed"),
            (Standing::Damaged, "damaged"),
        ] {
            let count = against.standing(self.plan, standing).count();
            println!("            {count:>6} {note}");
        }
        let (changed, removed) = (&against.difference.changed, &against.difference.removed);
        println!("            {:>6} removed", removed.len());
        // A rejected sweep leaves no scenarios to record.
        let is_rejected = !(changed.is_empty() && removed.is_empty());
        if let Some(left) = self.left.as_ref().filter(|_| !is_rejected) {
            show_cost("left", left);
            let room = DecimalBytes(left.room_bytes);
            print_after(
                "            ",
                &format!("{} to write, for which {room} should be free", size(left)),
            );
        }
        for (name, weather) in against
            .weather
            .iter()
            .filter(|(_, weather)| weather.is_reported())
        {
            print_after(
                "weather     ",
                &format!("{name}, at the aircraft: {weather}"),
            );
        }
        let marked = || against.weather.values().flat_map(|weather| &weather.marked);
        for (id, differences) in marked().take(MAX_DIFFERENCES) {
            print_after("marked      ", &format!("{id}: {}", differences.join("; ")));
        }
        for (id, what) in against.damaged.iter().take(MAX_DIFFERENCES) {
            print_after("damaged     ", &format!("{id}: {what}"));
        }
        for change in changed.iter().take(MAX_DIFFERENCES) {
            print_after("changed     ", &format!("{}: {}", change.id, change.what));
        }
        for id in removed.iter().take(MAX_DIFFERENCES) {
            println!("removed     {id}");
        }
        let listed = [
            against.damaged.len(),
            changed.len(),
            removed.len(),
            marked().count(),
        ];
        let hidden: usize = listed
            .map(|number| number.saturating_sub(MAX_DIFFERENCES))
            .iter()
            .sum();
        if hidden > 0 {
            println!("            and {hidden} more; --json lists them all");
        }
        if !against.damaged.is_empty() {
            print_after(
                "",
                "`dtd generate` leaves damaged scenarios out: move their folders out of scenarios/, then it records them again.",
            );
        }
        if is_rejected {
            print_after(
                "",
                "A corpus only grows: `dtd generate` rejects this sweep for it. Use another folder, or give new values new names.",
            );
        }
    }
}

fn flight(scenario: &PlannedScenario) -> &str {
    match &scenario.parameters.live {
        Some(live) => &live.profile_name,
        None => &scenario.flight,
    }
}

fn in_sight(sight: &Sight) -> String {
    let range = |[near, far]: [f64; 2]| {
        if far - near < 0.05 {
            format!("{far:.1}")
        } else {
            format!("{near:.1} to {far:.1}")
        }
    };
    match (sight.enters_nm, sight.leaves_nm) {
        (Some(enters_nm), Some(leaves_nm)) => format!(
            "{}: the aircraft enters it {} NM before touchdown, and leaves it at {} NM",
            sight.view,
            range(enters_nm),
            range(leaves_nm)
        ),
        _ => format!("{}: the aircraft is never in it", sight.view),
    }
}

fn in_words(standing: Standing) -> &'static str {
    match standing {
        Standing::Whole => "complete",
        Standing::ToMake => "missing",
        Standing::New => "new",
        Standing::Changed => "changed",
        Standing::Damaged => "damaged",
    }
}

fn show_cost(name: &str, estimate: &Estimate) {
    println!("{name:<11} {}, of which", hours(estimate.making_h));
    let durations = &estimate.durations;
    for (part, part_h, basis) in [
        ("images", durations.pictures_h, &durations.pictures_basis),
        (
            "live flying",
            durations.live_flying_h,
            &durations.live_flying_basis,
        ),
        ("loading", durations.loading_h, &durations.loading_basis),
        ("weather", durations.weather_h, &durations.weather_basis),
    ] {
        print_after(
            &format!("            {part:<11} "),
            &format!("{} ({basis})", hours(part_h)),
        );
    }
}

/// A duration in a readable unit.
fn hours(hours: f64) -> String {
    let (minutes, seconds) = (hours * 60.0, hours * 3_600.0);
    if seconds < 120.0 {
        format!("{seconds:.0} s")
    } else if minutes < 120.0 {
        format!("{minutes:.0} min")
    } else {
        format!("{hours:.1} h")
    }
}

fn size(estimate: &Estimate) -> String {
    match estimate.bytes {
        Some(bytes) => DecimalBytes(bytes).to_string(),
        None => "unknown".into(),
    }
}
