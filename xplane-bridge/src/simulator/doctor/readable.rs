//! Do the datarefs that we need exist, with their expected meaning?
//!
//! X-Plane answers 0 for an unknown name, so a 0 is evidence only where the right dataref has another value.

use std::ops::RangeInclusive;

use super::Check;
use super::talk::{FRAME_PERIOD_S, LATITUDE, LONGITUDE, Talk};
use crate::datarefs::{
    self, AUTOPILOT_MODE, DATE_DAYS, Generation, NAV1_COURSE_MAGNETIC, NAV1_FREQUENCY,
    OVERRIDE_FLIGHT_MODEL, PAUSED, RUNNING_TIME_S, USE_SYSTEM_TIME, VERSION, ZULU_TIME_S,
};

const NAME: &str = "datarefs readable";

/// A dataref, and its possible values. If 0 is not among them, a 0 means that the name is unknown.
type Expected = (&'static str, RangeInclusive<f32>);

fn expected(generation: Generation) -> [Expected; 13] {
    const POSITIVE: RangeInclusive<f32> = f32::MIN_POSITIVE..=f32::MAX;
    const SWITCH: RangeInclusive<f32> = 0.0..=1.0;
    let visibility = match generation {
        Generation::XPlane11 => datarefs::VISIBILITY_M_11,
        Generation::XPlane12 => datarefs::VISIBILITY_SM,
    };
    [
        (VERSION, 110_000.0..=139_999.0),
        (RUNNING_TIME_S, POSITIVE),
        (LATITUDE, -90.0..=90.0),
        (LONGITUDE, -180.0..=180.0),
        (ZULU_TIME_S, 0.0..=86_400.0),
        (DATE_DAYS, 0.0..=365.0),
        (USE_SYSTEM_TIME, SWITCH),
        (PAUSED, SWITCH),
        (OVERRIDE_FLIGHT_MODEL, SWITCH),
        (AUTOPILOT_MODE, 0.0..=2.0),
        // Units of 10 kHz: 108.00 to 117.95 MHz are for navigation.
        (NAV1_FREQUENCY, 10_800.0..=11_795.0),
        (NAV1_COURSE_MAGNETIC, 0.0..=360.0),
        (visibility, POSITIVE),
    ]
}

/// Conclusions about datarefs from their values.
#[derive(Debug, Default, PartialEq)]
struct Findings {
    /// No value came.
    silent: Vec<&'static str>,
    /// Name and value, as text, of datarefs that cannot be the intended ones.
    wrong: Vec<String>,
}

fn judge(expected: &[Expected], values: &[Option<f32>]) -> Findings {
    let mut findings = Findings::default();
    for ((name, range), value) in expected.iter().zip(values) {
        match value {
            None => findings.silent.push(*name),
            Some(value) if range.contains(value) => {}
            Some(value) => findings
                .wrong
                .push(format!("{name} reads {value}, expected {}", words(range))),
        }
    }
    findings
}

fn words(range: &RangeInclusive<f32>) -> String {
    match *range.end() {
        f32::MAX => "more than 0".into(),
        end => format!("{} to {end}", range.start()),
    }
}

/// Reads them all.
pub(super) async fn check(talk: &mut Talk, generation: Generation) -> Check {
    let mut expected = expected(generation).to_vec();
    expected.push((FRAME_PERIOD_S, f32::MIN_POSITIVE..=10.0));
    let names: Vec<&str> = expected.iter().map(|(name, _)| *name).collect();
    let values = talk.read(&names).await;
    let mut findings = judge(&expected, &values);
    let running_s = values[1];
    if let Some(before_s) = running_s.filter(|&before_s| before_s > 0.0) {
        let after_s = talk
            .read_expecting(RUNNING_TIME_S, |after_s| after_s > before_s)
            .await;
        if after_s.is_none_or(|after_s| after_s <= before_s) {
            findings
                .wrong
                .push(format!("{RUNNING_TIME_S} stays at {before_s}"));
        }
    }
    verdict(&findings, names.len())
}

fn verdict(Findings { silent, wrong }: &Findings, all: usize) -> Check {
    if !wrong.is_empty() {
        return Check::failed(
            NAME,
            wrong.join("; "),
            "X-Plane answers 0 for names that it does not have. Load a flight; if that does not help, this is another version than those we \
             know, or another program",
        );
    }
    if !silent.is_empty() {
        return Check::failed(
            NAME,
            format!("no value of {}", silent.join(", ")),
            "Packets get lost, or other clients ask for too much: X-Plane takes some 140 requests a frame",
        );
    }
    Check::ok(NAME, format!("{all} have plausible values"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulator::doctor::Verdict;

    /// Values from a correct X-Plane 12, in the order of [`expected`].
    const SOUND: [f32; 13] = [
        120_400.0, 512.25, 1.35, 103.98, 18_000.0, 200.0, 0.0, 0.0, 0.0, 0.0, 11_030.0, 23.0, 20.0,
    ];

    fn judged(values: &[Option<f32>]) -> Check {
        let findings = judge(&expected(Generation::XPlane12), values);
        verdict(&findings, values.len())
    }

    #[test]
    fn sound_values_pass() {
        assert_eq!(judged(&SOUND.map(Some)).verdict, Verdict::Ok);
    }

    #[test]
    fn a_program_that_answers_zero_to_everything_is_no_simulator() {
        let check = judged(&[Some(0.0); 13]);
        assert_eq!(check.verdict, Verdict::Failed);
        for name in [
            VERSION,
            RUNNING_TIME_S,
            NAV1_FREQUENCY,
            datarefs::VISIBILITY_SM,
        ] {
            assert!(
                check.found.contains(&format!("{name} reads 0")),
                "{}",
                check.found
            );
        }
    }

    #[test]
    fn each_value_out_of_its_range_or_missing_is_named() {
        let expected = expected(Generation::XPlane12);
        for (at, (name, _)) in expected.iter().enumerate() {
            for value in [None, Some(-1_000.0)] {
                let mut values = SOUND.map(Some);
                values[at] = value;
                let check = judged(&values);
                assert_eq!(check.verdict, Verdict::Failed, "{name} {value:?}");
                assert!(check.found.contains(name), "{}", check.found);
            }
        }
    }
}
