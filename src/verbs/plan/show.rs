//! A plan in readable form.

use std::collections::BTreeMap;
use std::fmt::Display;

use dataset::corpus::scenario::Flight;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::plan::PlannedScenario;
use generator::plan::{Estimate, Sight};
use generator::progress::against::Standing;
use indicatif::DecimalBytes;

use super::{Compared, Report};
use crate::verbs::output::{count, print_after, print_table};

/// Maximum number of scenarios that are listed.
const MAX_ROWS: usize = 200;
/// Maximum number of scenarios of a kind that are listed with their difference.
const MAX_DIFFERENCES: usize = 10;

/// States of a scenario, in a word, and what follows it in the summary.
const STANDINGS: [(Standing, &str, &str); 5] = [
    (Standing::Whole, "complete", ""),
    (
        Standing::ToMake,
        "missing",
        ": planned there, not recorded yet",
    ),
    (Standing::New, "new", ""),
    (Standing::Changed, "changed", ""),
    (Standing::Damaged, "damaged", ""),
];

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
        let listed = self.plan.scenarios.iter().take(MAX_ROWS);
        let mut rows: Vec<Vec<String>> = listed.map(|scenario| self.row(scenario)).collect();
        if let Some(compared) = self.compared {
            heading.push("status");
            for (row, standing) in rows.iter_mut().zip(&compared.against.standings) {
                let known = STANDINGS.iter().find(|(of, ..)| of == standing);
                row.extend(known.map(|(_, word, _)| (*word).to_owned()));
            }
        }
        print_table(&heading, &rows);
        let others = self.plan.scenarios.len() - rows.len();
        if others > 0 {
            println!("and {}: --json has all", count(others, "other scenario"));
        }
    }

    fn row(&self, scenario: &PlannedScenario) -> Vec<String> {
        let parameters = &scenario.parameters;
        let flight = match &parameters.live {
            Some(live) => &live.profile_name,
            None => &scenario.flight,
        };
        let start_nm = parameters.start_dtd_m / METERS_PER_NAUTICAL_MILE;
        let visibility_km = parameters.conditions.weather.visibility_m / 1_000.0;
        let sun = self.sun(scenario);
        vec![
            // It contains time and weather.
            scenario.id.clone(),
            flight.clone(),
            format!("{start_nm:.2}"),
            format!("{visibility_km:.1}"),
            format!("{:.1}", sun.elevation_deg),
            format!("{:.0}", sun.azimuth_deg),
            scenario.ticks.to_string(),
        ]
    }

    fn show_totals(&self) {
        let (plan, estimate) = (self.plan, &self.estimate);
        let mut by_source = BTreeMap::new();
        for scenario in &plan.scenarios {
            let source = match scenario.parameters.flight {
                Flight::Live => "live",
                Flight::Computed { .. } => "computed",
                Flight::Recorded { .. } => "recorded",
            };
            *by_source.entry(source).or_insert(0) += 1;
        }
        let sources = by_source.iter();
        let sources: Vec<String> = sources
            .map(|(source, number)| format!("{number} {source}"))
            .collect();
        line("corpus", &plan.corpus);
        line("plan", &plan.plan_hash);
        let scenarios = plan.scenarios.len();
        line("scenarios", format!("{scenarios} ({})", sources.join(", ")));
        let flight = format!(
            "{}: {} ticks at {} per second, {}, {} images",
            hours(estimate.flight_h),
            estimate.ticks,
            plan.common.picture.frame_rate,
            count(plan.common.cameras.len(), "camera"),
            estimate.pictures
        );
        line("flight", flight);
        self.show_outlook();
        show_cost("recording", estimate);
        let basis = &estimate.bytes_basis;
        line("size", format!("{} ({basis})", size(estimate)));
        let room = format!(
            "{} should be free on the disk: X-Plane's scenery needs more than the bundled simulator's",
            DecimalBytes(estimate.room_bytes)
        );
        line("free space", room);
    }

    fn show_outlook(&self) {
        let (runway, outlook) = (&self.plan.common.runway, &self.outlook);
        let place = format!(
            "{} {}, {:.0} m above mean sea level, course {:.2} degrees true, local time is UTC{:+}",
            runway.airport,
            runway.name,
            runway.threshold.altitude_msl_m,
            runway.course_true_deg,
            self.utc_offset_h
        );
        line("runway", place);
        let profiles = outlook.profiles_above_runway_m.iter();
        let profiles = profiles.map(|(name, start_m)| format!("{name} begins at {start_m:.0} m"));
        let clouds = outlook.clouds_above_runway_m.iter();
        let clouds =
            clouds.map(|(name, [base, top])| format!("clouds of {name} {base:.0} to {top:.0} m"));
        let heights: Vec<String> = profiles.chain(clouds).collect();
        if !heights.is_empty() {
            let heights = heights.join(", ");
            line("heights", format!("above the runway: {heights}"));
        }
        for sight in &outlook.views {
            line("view", in_sight(sight));
        }
    }

    fn show_difference(&self, compared: &Compared) {
        let against = &compared.against;
        let difference = &against.difference;
        println!();
        let note = if compared.is_default {
            " (found here; --against names another)"
        } else {
            ""
        };
        line("against", format!("{}{note}", compared.corpus));
        for (standing, word, note) in STANDINGS {
            let count = against.standing(self.plan, standing).count();
            line("", format!("{count:>6} {word}{note}"));
        }
        line("", format!("{:>6} removed", difference.removed.len()));
        // A rejected sweep leaves no scenarios to record.
        let is_rejected = !(difference.changed.is_empty() && difference.removed.is_empty());
        if let Some(left) = self.left.as_ref().filter(|_| !is_rejected) {
            show_cost("left", left);
            if let Some(pace) = against.pace {
                let at_pace = hours(pace.s_per_scenario * left.scenarios as f64 / 3_600.0);
                line(
                    "",
                    format!("{at_pace} at the pace of the scenarios that are there"),
                );
            }
            let room = DecimalBytes(left.room_bytes);
            let size = size(left);
            line(
                "",
                format!("{size} to write, for which {room} should be free"),
            );
        }
        let reported = against.weather.iter();
        for (name, weather) in reported.filter(|(_, weather)| weather.is_reported()) {
            line("weather", format!("{name}, at the aircraft: {weather}"));
        }
        let marked = against.weather.values().flat_map(|weather| &weather.marked);
        let marked = marked.map(|(id, differences)| format!("{id}: {}", differences.join("; ")));
        let damaged = against.damaged.iter();
        let damaged = damaged.map(|(id, what)| format!("{id}: {what}"));
        let changed = difference.changed.iter();
        let changed = changed.map(|change| format!("{}: {}", change.id, change.what));
        let hidden = [
            list("marked", marked.collect()),
            list("damaged", damaged.collect()),
            list("changed", changed.collect()),
            list("removed", difference.removed.clone()),
        ];
        let hidden: usize = hidden.iter().sum();
        if hidden > 0 {
            line("", format!("and {hidden} more; --json lists them all"));
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

/// Prints a text after its name, e.g. `size        14 GB`.
fn line(name: &str, text: impl Display) {
    print_after(&format!("{name:<12}"), &text.to_string());
}

/// Prints the first lines; returns the number of the others.
fn list(name: &str, lines: Vec<String>) -> usize {
    for text in lines.iter().take(MAX_DIFFERENCES) {
        line(name, text);
    }
    lines.len().saturating_sub(MAX_DIFFERENCES)
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

fn show_cost(name: &str, estimate: &Estimate) {
    println!("{name:<11} {}, of which", hours(estimate.making_h));
    let parts = &estimate.durations;
    for (part, part_h, basis) in [
        ("images", parts.pictures_h, &parts.pictures_basis),
        ("live flying", parts.live_flying_h, &parts.live_flying_basis),
        ("loading", parts.loading_h, &parts.loading_basis),
        ("weather", parts.weather_h, &parts.weather_basis),
    ] {
        let name = format!("            {part:<11} ");
        print_after(&name, &format!("{} ({basis})", hours(part_h)));
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
